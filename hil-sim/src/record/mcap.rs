//! Records as MCAP, the format of Foxglove and PlotJuggler: one channel of JSON messages, one per
//! tick, with the columns of the CSV as fields, and their JSON schema.

use crate::error::BadInput;
use crate::output::NotWritten;
use crate::record::columns::{COLUMNS, Cell, Column};
use crate::record::{Record, TIME_S};
use mcap::parse_record;
use mcap::records::{MessageHeader, Metadata, Record as McapRecord, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, WriteOptions, Writer};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Longest MCAP record that is read, above any chunk that [`McapWriter`] writes \[bytes\].
const RECORD_LEN_MAX: usize = 1 << 26;
/// The channel's name.
const TOPIC: &str = "/assist";

/// The name of the metadata.
const METADATA: &str = "hil-sim";

/// Where a record comes from, in its metadata beside the version of this program.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The rig, if it is known: its file, or words.
    pub rig: Option<String>,
    /// The seed of random numbers, if there were any.
    pub seed: Option<u64>,
}

impl Origin {
    fn metadata(&self) -> Metadata {
        let version = Some(env!("CARGO_PKG_VERSION").into());
        let seed = self.seed.map(|seed| seed.to_string());
        let entries = [
            ("version", version),
            ("rig", self.rig.clone()),
            ("seed", seed),
        ];
        let entries = entries
            .into_iter()
            .filter_map(|(key, value)| Some((key.into(), value?)));
        Metadata {
            name: METADATA.into(),
            metadata: entries.collect(),
        }
    }
}

/// Writes an MCAP file in chunks.
pub struct McapWriter {
    path: String,
    writer: Writer<BufWriter<File>>,
    channel: u16,
    sequence: u32,
}

impl McapWriter {
    /// Creates the file at `path` with metadata, schema and channel.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(path: &Path, origin: &Origin) -> Result<McapWriter, NotWritten> {
        let name = path.display().to_string();
        let begin = || {
            // Without seeking, each chunk is written whole and at once.
            let options = WriteOptions::new().compression(None).disable_seeking(true);
            let mut writer = options.create(BufWriter::new(File::create(path)?))?;
            writer.write_metadata(&origin.metadata())?;
            let schema = schema().to_string();
            let schema = writer.add_schema("assist.Tick", "jsonschema", schema.as_bytes())?;
            let channel = writer.add_channel(schema, TOPIC, "json", &BTreeMap::new())?;
            Ok((writer, channel))
        };
        let (writer, channel) = begin().map_err(|error| not_written(&name, error))?;
        Ok(McapWriter {
            path: name,
            writer,
            channel,
            sequence: 0,
        })
    }

    /// Adds a message with the cells of [`COLUMNS`].
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push(&mut self, time_s: f64, cells: &[Cell]) -> Result<(), NotWritten> {
        let fields =
            COLUMNS
                .iter()
                .zip(cells)
                .filter_map(|(Column { name, .. }, cell)| match cell {
                    Cell::Missing => None,
                    Cell::Number(number) => Some((String::from(*name), json!(number))),
                    Cell::Text(word) => Some((String::from(*name), json!(word))),
                });
        let message = Value::Object(fields.collect()).to_string();
        let time_ns = (time_s * 1e9).round().max(0.0) as u64;
        let header = MessageHeader {
            channel_id: self.channel,
            sequence: self.sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.sequence = self.sequence.wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, message.as_bytes())
            .map_err(|error| not_written(&self.path, error))
    }

    /// Ends the chunk and writes it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), NotWritten> {
        let flushed = self.writer.flush();
        flushed.map_err(|error| not_written(&self.path, error))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<(), NotWritten> {
        let finished = self.writer.finish();
        finished.map_err(|error| not_written(&self.path, error))?;
        Ok(())
    }
}

fn not_written(path: &str, error: McapError) -> NotWritten {
    let source = match error {
        McapError::Io(source) => source,
        other => std::io::Error::other(other),
    };
    NotWritten::new(path, source)
}

/// The JSON schema of a message. The unit is in the description too, as viewers do not know `unit`.
fn schema() -> Value {
    let property = |column: &Column| match (column.unit, column.description) {
        (None, text) => json!({ "type": "string", "description": text }),
        (Some(unit), text) => json!({
            "type": "number",
            "description": format!("{text} [{unit}]"),
            "unit": unit,
        }),
    };
    let properties: Map<String, Value> = COLUMNS
        .iter()
        .map(|column| (String::from(column.name), property(column)))
        .collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "assist.Tick",
        "type": "object",
        "properties": properties,
    })
}

/// The messages on [`TOPIC`]. An incomplete chunk ends the file.
fn messages(bytes: &[u8]) -> Result<Vec<Vec<u8>>, McapError> {
    let options = LinearReaderOptions::default()
        .with_skip_end_magic(true)
        // Without a limit the crate's arithmetic on a damaged length may overflow.
        .with_record_length_limit(RECORD_LEN_MAX);
    let mut reader = LinearReader::new_with_options(options);
    let (mut channels, mut messages) = (Vec::new(), Vec::new());
    let (mut rest, mut begun) = (bytes, false);
    while let Some(event) = reader.next_event() {
        let record = match event {
            Ok(LinearReadEvent::ReadRequest(len)) => {
                let (next, later) = rest.split_at(len.min(rest.len()));
                reader.insert(next.len()).copy_from_slice(next);
                reader.notify_read(next.len());
                rest = later;
                continue;
            }
            // Attachments are not needed, and the crate panics at one that is too short.
            Ok(LinearReadEvent::Record { data, opcode }) => match opcode {
                op::CHANNEL | op::MESSAGE => parse_record(opcode, data).map(Some),
                _ => Ok(None),
            },
            Err(error) => Err(error),
        };
        match record {
            Ok(Some(McapRecord::Channel(channel))) if channel.topic == TOPIC => {
                channels.push(channel.id)
            }
            Ok(Some(McapRecord::Message { header, data }))
                if channels.contains(&header.channel_id) =>
            {
                messages.push(data.into_owned());
            }
            Ok(_) => {}
            Err(error) if !begun => return Err(error),
            Err(_) => break,
        }
        begun = true;
    }
    Ok(messages)
}

/// Reads a record that [`McapWriter`] wrote. Of a truncated file the complete chunks are read.
///
/// # Errors
/// The file cannot be read, is not such a file, or holds no ticks.
pub fn read(path: &Path) -> Result<Record, BadInput> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path)
        .map_err(|error| BadInput::file(&name, format!("a readable file, {error}")))?;
    parse(&name, &bytes)
}

/// Reads a record from the bytes of the file `name`, as [`read`].
///
/// # Errors
/// As [`read`].
pub fn parse(name: &str, bytes: &[u8]) -> Result<Record, BadInput> {
    let bad = |expected: String| BadInput::file(name, expected);
    let messages = messages(bytes).map_err(|error| bad(format!("an MCAP file, {error}")))?;
    let mut csv = csv::Writer::from_writer(Vec::new());
    let _ = csv.write_record(COLUMNS.iter().map(|column| column.name));
    for message in messages {
        let fields: Map<String, Value> = serde_json::from_slice(&message)
            .map_err(|error| bad(format!("messages in JSON, {error}")))?;
        let cells = COLUMNS.iter().map(|column| match fields.get(column.name) {
            Some(Value::String(word)) => word.clone(),
            Some(Value::Number(number)) => number.to_string(),
            _ => String::new(),
        });
        let _ = csv.write_record(cells);
    }
    let record = Record::parse(name, &csv.into_inner().unwrap_or_default())?;
    if record.time_s().is_empty() {
        return Err(bad(format!(
            "`{TIME_S}` in messages on {TOPIC}, found none"
        )));
    }
    Ok(record)
}

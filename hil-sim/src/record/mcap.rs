//! Records as MCAP, the format of Foxglove and PlotJuggler: one channel of JSON messages, one per
//! tick, with the columns of the CSV as fields, and their JSON schema.

use crate::error::BadInput;
use crate::input;
use crate::output::NotWritten;
use crate::record::columns::{COLUMNS, Cell, Column, Software};
use crate::record::{self, Record, TIME_S};
use mcap::parse_record;
use mcap::records::{MessageHeader, Metadata, Record as McapRecord, op};
use mcap::{MAGIC, McapError, WriteOptions, Writer};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read};
use std::path::Path;
use std::time::Duration;

/// Most bytes of a chunk that are unpacked, above any that MCAP's writers make.
const CHUNK_LEN_MAX: usize = 1 << 26;
/// Length of an MCAP record's opcode and length \[bytes\].
const RECORD_HEADER_LEN: usize = 9;
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
    /// The board's firmware, its settings' safety block and who has changed them, by name.
    pub board: Vec<(&'static str, String)>,
    /// The programs that make the record.
    pub software: Software,
    /// Time since 1970 at which the record starts: the viewers' time of its `time_s` 0.
    pub started: Duration,
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
        let board = self.board.iter();
        let entries = entries.chain(board.map(|(key, value)| ((*key).to_owned(), value.clone())));
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
    started: Duration,
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
            started: origin.started,
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
        let time_ns = self.started.as_nanos() as u64 + (time_s * 1e9).round().max(0.0) as u64;
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

/// Plots of the layout for viewers: title, and the columns with one unit that it has.
const PLOTS: [(&str, &[&str]); 4] = [
    (
        "Pressure (gauge) [Pa]",
        &[
            record::PRESSURE_REF_PA,
            record::PRESSURE_PA,
            record::EXACT_PRESSURE_REF_PA,
        ],
    ),
    ("Contraction [1]", &[record::CONTRACTION]),
    (
        "Force [N]",
        &[
            record::FORCE_N,
            record::INPUT_FORCE_N,
            record::REFERENCE_FORCE_N,
        ],
    ),
    ("Finger [m]", &[record::FINGER_M]),
];
/// Text of the layout beside them: when the controller changes its state, and why.
const STATES: [&str; 3] = [record::MODE, record::FAULT, record::REQUEST];

/// The layout of panels with which Foxglove and Lichtblick show a record (its menu «Import from
/// file»): plots with a common time, and the controller's state.
pub fn layout() -> Value {
    let paths = |columns: &[&str]| {
        let path = |column: &&str| {
            json!({
                "value": format!("{TOPIC}.{column}"), "label": column, "enabled": true,
                "timestampMethod": "receiveTime",
            })
        };
        columns.iter().map(path).collect::<Vec<Value>>()
    };
    let plots = PLOTS.iter().enumerate().map(|(number, (title, columns))| {
        let panel = json!({
            "foxglovePanelTitle": title, "paths": paths(columns), "xAxisVal": "timestamp",
            "isSynced": true, "showLegend": true, "legendDisplay": "floating",
            "showPlotValuesInLegend": true, "showXAxisLabels": true, "showYAxisLabels": true,
            "sidebarDimension": 240,
        });
        (format!("Plot!{number}"), panel)
    });
    let states = json!({
        "foxglovePanelTitle": "Controller", "paths": paths(&STATES), "isSynced": true,
    });
    let panels: Map<String, Value> = plots
        .chain([("StateTransitions!0".to_owned(), states)])
        .collect();
    // Below each other, each as high as the others.
    let below = |(above, count): (Value, u32), name: &String| {
        let share = 100.0 * f64::from(count) / f64::from(count + 1);
        let both = json!({
            "direction": "column", "first": above, "second": name, "splitPercentage": share,
        });
        (both, count + 1)
    };
    let mut names = panels.keys();
    let first = (json!(names.next()), 1);
    let (tree, _) = names.fold(first, below);
    json!({
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": tree,
    })
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

/// Passes the schemas, channels and messages of the file `name` to `take`, up to its end or the
/// place where it is damaged, which is returned in words. The records may have `unpacked_max` bytes
/// in all.
///
/// # Errors
/// The bytes are not of an MCAP file, or have more when unpacked; those of `take`.
pub(super) fn each_record(
    name: &str,
    bytes: &[u8],
    unpacked_max: usize,
    mut take: impl FnMut(McapRecord) -> Result<(), BadInput>,
) -> Result<Option<String>, BadInput> {
    let Some(records) = bytes.strip_prefix(MAGIC) else {
        return Err(BadInput::file(name, "an MCAP file, found none"));
    };
    let mut reader = RecordReader {
        name,
        unpacked_max,
        unpacked: 0,
    };
    match reader.each(records, false, &mut take) {
        Ok(()) => Ok(None),
        Err(End::Bad(error)) => Err(error),
        Err(End::Damaged(error)) if reader.unpacked == 0 => {
            Err(BadInput::file(name, format!("an MCAP file, {error}")))
        }
        Err(End::Damaged(error)) => Ok(Some(error)),
    }
}

/// Why a file is not read any further.
enum End {
    /// It is damaged there, in words.
    Damaged(String),
    Bad(BadInput),
}

/// Reads records one after another. The crate's own reader does not end in a chunk whose packed
/// bytes end too early.
struct RecordReader<'a> {
    name: &'a str,
    unpacked_max: usize,
    /// Bytes of the records so far.
    unpacked: usize,
}

impl RecordReader<'_> {
    fn each(
        &mut self,
        mut bytes: &[u8],
        in_chunk: bool,
        take: &mut dyn FnMut(McapRecord) -> Result<(), BadInput>,
    ) -> Result<(), End> {
        let early = || End::Damaged("it ends within a record".into());
        while let Some((opcode, rest)) = bytes.split_first() {
            let (length, rest) = rest.split_first_chunk().ok_or_else(early)?;
            let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
            let (body, rest) = rest.split_at_checked(length).unwrap_or((rest, &[]));
            let is_whole = body.len() == length;
            match *opcode {
                // Of one that is cut off what there is.
                op::CHUNK if !in_chunk => {
                    let left = self.unpacked_max - self.unpacked;
                    let chunk = Chunk::new(body).ok_or_else(early)?;
                    let (records, end) = chunk.unpacked(CHUNK_LEN_MAX.min(left));
                    if records.len() > left {
                        return Err(self.more_than(self.unpacked_max, ""));
                    }
                    if records.len() > CHUNK_LEN_MAX {
                        return Err(self.more_than(CHUNK_LEN_MAX, " in a chunk"));
                    }
                    self.each(&records, true, take)?;
                    end.map_err(|error| End::Damaged(format!("a chunk is not unpacked, {error}")))?;
                }
                _ if !is_whole => {}
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    self.count(body.len())?;
                    let record = parse_record(*opcode, body);
                    let record = record.map_err(|error| End::Damaged(error.to_string()))?;
                    take(record).map_err(End::Bad)?;
                }
                op::FOOTER => break,
                // A chunk has no chunks. Attachments are not needed, and the crate panics at one
                // that is too short.
                _ => self.count(body.len())?,
            }
            if !is_whole {
                return Err(early());
            }
            bytes = rest;
        }
        Ok(())
    }

    fn count(&mut self, length: usize) -> Result<(), End> {
        self.unpacked = self.unpacked.saturating_add(RECORD_HEADER_LEN + length);
        if self.unpacked > self.unpacked_max {
            return Err(self.more_than(self.unpacked_max, ""));
        }
        Ok(())
    }

    fn more_than(&self, most: usize, place: &str) -> End {
        let expected = format!("at most {most} unpacked bytes{place}, found more");
        End::Bad(BadInput::file(self.name, expected))
    }
}

/// Packed records.
struct Chunk<'a> {
    compression: &'a [u8],
    data: &'a [u8],
}

impl<'a> Chunk<'a> {
    /// That of a record's body, of which the end may be cut off.
    fn new(body: &'a [u8]) -> Option<Chunk<'a>> {
        // Two times, the unpacked size and its checksum.
        let (_, rest) = body.split_at_checked(8 + 8 + 8 + 4)?;
        let (length, rest) = rest.split_first_chunk()?;
        let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
        let (compression, rest) = rest.split_at_checked(length)?;
        let (length, data) = rest.split_first_chunk()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let data = &data[..length.min(data.len())];
        Some(Chunk { compression, data })
    }

    /// Its first `most` bytes and one more, up to where they cannot be unpacked.
    fn unpacked(&self, most: usize) -> (Cow<'a, [u8]>, io::Result<()>) {
        let mut records = Vec::new();
        let reader: io::Result<Box<dyn Read>> = match self.compression {
            b"" => return (Cow::Borrowed(self.data), Ok(())),
            #[cfg(feature = "formats")]
            b"lz4" => lz4::Decoder::new(self.data).map(|reader| Box::new(reader) as _),
            #[cfg(feature = "formats")]
            b"zstd" => zstd::Decoder::new(self.data).map(|reader| Box::new(reader) as _),
            _ => Err(io::ErrorKind::Unsupported.into()),
        };
        let end = reader.and_then(|reader| {
            let read = reader.take(most as u64 + 1).read_to_end(&mut records);
            read.map(|_| ())
        });
        (Cow::Owned(records), end)
    }
}

/// The messages on [`TOPIC`]. An incomplete chunk ends the file.
fn messages(name: &str, bytes: &[u8]) -> Result<Vec<Vec<u8>>, BadInput> {
    let (mut channels, mut messages) = (Vec::new(), Vec::new());
    each_record(name, bytes, usize::MAX, |record| {
        match record {
            McapRecord::Channel(channel) if channel.topic == TOPIC => channels.push(channel.id),
            McapRecord::Message { header, data } if channels.contains(&header.channel_id) => {
                messages.push(data.into_owned());
            }
            _ => {}
        }
        Ok(())
    })?;
    Ok(messages)
}

/// Reads a record that [`McapWriter`] wrote. Of a truncated file the complete chunks are read.
///
/// # Errors
/// The file cannot be read, is not such a file, or holds no ticks.
pub fn read(path: &Path) -> Result<Record, BadInput> {
    let name = path.display().to_string();
    parse(&name, &input::read(path, "a readable file")?)
}

/// Reads a record from the bytes of the file `name`, as [`read`].
///
/// # Errors
/// As [`read`].
pub fn parse(name: &str, bytes: &[u8]) -> Result<Record, BadInput> {
    let bad = |expected: String| BadInput::file(name, expected);
    let messages = messages(name, bytes)?;
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

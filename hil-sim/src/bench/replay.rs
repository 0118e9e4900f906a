//! Replay: feeds a record's inputs to a controller again, in this program or on a board, and
//! compares its outputs tick by tick.
//!
//! A record can be compared from a start of its controller, when its state is known, up to the
//! first missing tick.

use crate::bench::board_settings;
use crate::bench::error::Error;
use crate::bench::port::client::{Client, LinkError, Transport};
use crate::error::BadInput;
use crate::record::columns::{COLUMNS, Cell, Column, Row};
use crate::record::{self, Record};
use model_core::controller::Controller;
use model_core::io::{Output, Request, Sensors};
use model_core::settings::Settings;
use model_core::signal::{AdcCount, EncoderCount};
use serde::Serialize;
use std::ops::Range;

/// The columns that are compared, in the order in which differences are reported.
const COMPARED: [&str; 8] = [
    record::VALVE_COUNT,
    record::MODE,
    record::FAULT,
    record::EXACT_PRESSURE_REF_PA,
    record::REFERENCE_FORCE_N,
    record::INPUT_FORCE_N,
    record::CONTRACTION,
    record::PRESSURE_PA,
];

/// How often a segment is tried on a board whose controller restarts during it.
const ATTEMPTS: usize = 3;

/// A record's inputs, and its segments that can be replayed.
pub struct Inputs<'a> {
    record: &'a Record,
    sensors: Vec<Sensors>,
    segments: Vec<(Settings, Range<usize>)>,
}

impl<'a> Inputs<'a> {
    /// Reads the inputs of `record`.
    ///
    /// # Errors
    /// The record lacks inputs, or the settings of its controller.
    pub fn new(record: &'a Record) -> Result<Inputs<'a>, BadInput> {
        let sensors = sensors(record)?;
        let starts = starts(record)?;
        let mut segments: Vec<(Settings, Range<usize>)> = Vec::new();
        // Whether the last row belongs to a segment.
        let mut known = false;
        for (row, start) in starts.into_iter().enumerate() {
            if let Some(settings) = start {
                segments.push((settings, row..row));
                known = true;
            }
            known = known && (start.is_some() || follows(record, row));
            if let (true, Some((_, rows))) = (known, segments.last_mut()) {
                rows.end = row + 1;
            }
        }
        if segments.is_empty() {
            let why = "the controller's settings at a start of the controller (a recording with \
                       --from-start), found none";
            return Err(record.bad(record::SETTINGS, why));
        }
        record.require(record::VALVE_COUNT)?;
        Ok(Inputs {
            record,
            sensors,
            segments,
        })
    }

    /// Number of ticks that can be compared.
    pub fn ticks(&self) -> usize {
        self.segments.iter().map(|(_, rows)| rows.len()).sum()
    }
}

/// A column of whole numbers.
fn counts(record: &Record, column: &str) -> Result<Vec<u32>, BadInput> {
    let values = record.require(column)?.iter().zip(record.time_s());
    values
        .map(|(value, time_s)| {
            if value.fract() == 0.0 {
                Ok(*value as u32)
            } else {
                let why = format!("a whole number in column `{column}`, found `{value}`");
                Err(record.bad_at(*time_s, &why))
            }
        })
        .collect()
}

fn sensors(record: &Record) -> Result<Vec<Sensors>, BadInput> {
    let bridge = counts(record, record::BRIDGE_COUNT)?;
    let pressure = counts(record, record::PRESSURE_COUNT)?;
    let encoder = counts(record, record::ENCODER_COUNT)?;
    let missed = counts(record, record::MISSED_TICKS)?;
    let read_back = read_back(record)?;
    let requests = record.require_text(record::REQUEST)?;
    let request = |row: usize| {
        let name = &requests[row];
        Request::from_name(name).ok_or_else(|| {
            let why =
                format!("None, Assist, Hold, Vent, Reset or Play(…) as request, found `{name}`");
            record.bad_at(record.time_s()[row], &why)
        })
    };
    (0..record.time_s().len())
        .map(|row| {
            Ok(Sensors {
                // The columns' ranges are those of the types.
                bridge: AdcCount(bridge[row] as u16),
                pressure: AdcCount(pressure[row] as u16),
                encoder: EncoderCount(encoder[row]),
                read_back: AdcCount(read_back[row] as u16),
                missed_ticks: missed[row] as u8,
                request: request(row)?,
            })
        })
        .collect()
}

/// The valve's voltage as it was read back. A record of earlier firmware has none: what was set in
/// the row before, and 0 V at a start of the controller.
fn read_back(record: &Record) -> Result<Vec<u32>, BadInput> {
    if record.column(record::READ_BACK_COUNT).is_some() {
        return counts(record, record::READ_BACK_COUNT);
    }
    let mut set = counts(record, record::VALVE_COUNT)?;
    set.rotate_right(1);
    for (row, start) in starts(record)?.iter().enumerate() {
        if row == 0 || start.is_some() {
            set[row] = 0;
        }
    }
    Ok(set)
}

/// For each row, the settings of a controller that starts in it.
fn starts(record: &Record) -> Result<Vec<Option<Settings>>, BadInput> {
    let cells = record.require_text(record::SETTINGS)?;
    let rows = cells.iter().zip(record.time_s());
    rows.map(|(cell, time_s)| {
        if cell.is_empty() {
            return Ok(None);
        }
        let bad = |why: String| record.bad_at(*time_s, &why);
        let bytes = unhex(cell).ok_or_else(|| bad("settings as hexadecimal digits".into()))?;
        let settings = Settings::decode(&bytes);
        let settings = settings.map_err(|error| bad(format!("settings that pass, {error}")))?;
        Ok(Some(settings))
    })
    .collect()
}

fn unhex(digits: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u8>> = digits
        .chars()
        .map(|digit| digit.to_digit(16).map(|value| value as u8))
        .collect();
    let (pairs, rest) = (digits.as_deref()?).as_chunks::<2>();
    let bytes = pairs.iter().map(|[high, low]| high << 4 | low).collect();
    rest.is_empty().then_some(bytes)
}

/// True unless ticks are missing before `row`. With hardware in the loop a board also counts ticks
/// in which its controller does not tick.
fn follows(record: &Record, row: usize) -> bool {
    let from_pins = record
        .text(record::SOURCE)
        .is_some_and(|source| source[row] == "Pins");
    match (record.column(record::TICK), row.checked_sub(1)) {
        (Some(tick), Some(before)) if from_pins => {
            (tick[row] as u32).wrapping_sub(tick[before] as u32) == 1
        }
        _ => true,
    }
}

/// A controller for a replay.
pub trait Replayer {
    /// Starts the controller with `settings`.
    ///
    /// # Errors
    /// The board has other settings or does not answer.
    fn start(&mut self, settings: &Settings) -> Result<(), Error>;

    /// One tick; none if the controller has restarted since the last one.
    ///
    /// # Errors
    /// The board no longer answers.
    fn tick(&mut self, sensors: &Sensors) -> Result<Option<Output>, Error>;
}

/// A controller in this program.
#[derive(Default)]
pub struct OnPc(Option<Controller>);

impl Replayer for OnPc {
    fn start(&mut self, settings: &Settings) -> Result<(), Error> {
        self.0 = Some(Controller::new(*settings));
        Ok(())
    }

    fn tick(&mut self, sensors: &Sensors) -> Result<Option<Output>, Error> {
        Ok(self.0.as_mut().map(|controller| controller.tick(sensors)))
    }
}

/// A controller on a board, with hardware in the loop.
pub struct OnBoard<'a, P> {
    /// The link to it.
    pub client: &'a mut Client<P>,
    /// Name of the port.
    pub port: &'a str,
    /// Whether the record's settings may be stored on it.
    pub may_write_settings: bool,
}

impl<P: Transport> Replayer for OnBoard<'_, P> {
    fn start(&mut self, settings: &Settings) -> Result<(), Error> {
        let may_write = self.may_write_settings;
        board_settings::ensure(self.client, *settings, self.port, "the record", may_write)?;
        self.client.restart_in_loop()?;
        Ok(())
    }

    fn tick(&mut self, sensors: &Sensors) -> Result<Option<Output>, Error> {
        let answer = self.client.exchange(sensors)?;
        Ok((!answer.restarted).then_some(answer.output))
    }
}

/// Where a replay first differs from its record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Divergence {
    /// The record's row, from 1.
    pub row: usize,
    /// Its time \[s\].
    pub time_s: f64,
    /// The column.
    pub column: &'static str,
    /// The recorded value.
    pub recorded: String,
    /// The replayed value.
    pub replayed: String,
    /// The difference of numbers.
    pub difference: Option<f64>,
}

/// The result of a replay.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Replay {
    /// Ticks of the record.
    pub ticks: usize,
    /// Ticks that were compared; the others are before the controller's first known start, or after
    /// a missing tick.
    pub compared_ticks: usize,
    /// Ticks that differ in any output.
    pub differing_ticks: usize,
    /// Starts of the controller.
    pub starts: usize,
    /// The first difference.
    pub first_divergence: Option<Divergence>,
    /// The largest difference of each output that differs.
    pub largest_differences: Vec<(&'static str, f64)>,
}

impl Replay {
    /// The result as text.
    pub fn verdict(&self) -> String {
        let (differing, compared) = (self.differing_ticks, self.compared_ticks);
        let mut words = format!("{differing} of {compared} ticks differ.");
        if self.compared_ticks < self.ticks {
            let left_out = self.ticks - self.compared_ticks;
            words += &format!(
                " {left_out} more cannot be compared: the controller's state is not known there."
            );
        }
        if let Some(first) = &self.first_divergence {
            words += &format!(
                "\nThe first: row {}, {} s, {}: recorded `{}`, replayed `{}`",
                first.row, first.time_s, first.column, first.recorded, first.replayed
            );
            match first.difference {
                Some(difference) => words += &format!(", a difference of {difference:e}."),
                None => words += ".",
            }
        }
        for (column, difference) in &self.largest_differences {
            words += &format!("\nLargest difference of {column}: {difference:e}.");
        }
        words
    }
}

/// Replays `inputs` on the controller `on`; `progress` is called with the number of finished ticks.
///
/// # Errors
/// The controller does not answer, or restarts in each attempt.
pub fn replay(
    inputs: &Inputs,
    on: &mut impl Replayer,
    mut progress: impl FnMut(usize),
) -> Result<Replay, Error> {
    let mut result = Replay {
        ticks: inputs.sensors.len(),
        starts: inputs.segments.len(),
        ..Replay::default()
    };
    for (settings, rows) in &inputs.segments {
        let mut outputs = None;
        for _ in 0..ATTEMPTS {
            let done = result.compared_ticks;
            outputs = segment(on, settings, &inputs.sensors[rows.clone()], |ticks| {
                progress(done + ticks);
            })?;
            if outputs.is_some() {
                break;
            }
        }
        let outputs = outputs.ok_or(LinkError::NoAnswer(0.5))?;
        for (row, output) in rows.clone().zip(outputs) {
            result.compared_ticks += 1;
            compare(inputs, row, &output, &mut result);
        }
    }
    Ok(result)
}

/// The outputs over a segment; none if the controller has restarted during it.
fn segment(
    on: &mut impl Replayer,
    settings: &Settings,
    sensors: &[Sensors],
    mut progress: impl FnMut(usize),
) -> Result<Option<Vec<Output>>, Error> {
    on.start(settings)?;
    let mut outputs = Vec::with_capacity(sensors.len());
    for sensors in sensors {
        let Some(output) = on.tick(sensors)? else {
            return Ok(None);
        };
        outputs.push(output);
        progress(outputs.len());
    }
    Ok(Some(outputs))
}

fn compare(inputs: &Inputs, row: usize, output: &Output, result: &mut Replay) {
    let record = inputs.record;
    let replayed = Row {
        time_s: record.time_s()[row],
        pressure_ref_pa: f64::NAN,
        shut: None,
        sensors: inputs.sensors[row],
        output: *output,
        plant: None,
        board: None,
        start_settings: None,
        software: None,
    };
    let mut differs = false;
    for Column {
        name: column,
        value,
        ..
    } in COLUMNS
    {
        if !COMPARED.contains(&column) {
            continue;
        }
        let Some((recorded, now, difference)) = difference(record, row, column, &value(&replayed))
        else {
            continue;
        };
        differs = true;
        if let Some(difference) = difference {
            let largest = &mut result.largest_differences;
            match largest.iter_mut().find(|(name, _)| *name == column) {
                Some((_, largest)) => *largest = largest.max(difference.abs()),
                None => largest.push((column, difference.abs())),
            }
        }
        result.first_divergence.get_or_insert(Divergence {
            row: row + 1,
            time_s: replayed.time_s,
            column,
            recorded,
            replayed: now,
            difference,
        });
    }
    result.differing_ticks += usize::from(differs);
}

/// Recorded and replayed value of an output, and their difference; none if they are equal to the
/// last bit, or the record has no value there.
fn difference(
    record: &Record,
    row: usize,
    column: &str,
    replayed: &Cell,
) -> Option<(String, String, Option<f64>)> {
    if let Some(numbers) = record.column(column) {
        let (recorded, Cell::Number(now)) = (numbers[row], replayed) else {
            return None;
        };
        let same = recorded.to_bits() == now.to_bits() || recorded.is_nan();
        return (!same).then(|| (recorded.to_string(), now.to_string(), Some(now - recorded)));
    }
    let recorded = &record.text(column)?[row];
    let now = match replayed {
        Cell::Text(word) => word.as_str(),
        _ => "",
    };
    (recorded != now).then(|| (recorded.clone(), now.into(), None))
}

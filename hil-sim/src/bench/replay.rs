//! Replay: a record's inputs once more through a controller, here or on a board, and tick by tick
//! the question whether it decides the same.
//!
//! A record can be compared from where its controller began anew, as from there on its state is
//! known, up to where ticks are missing.

use crate::bench::closed_loop::settings_with;
use crate::bench::link::{Client, LinkError, Port};
use crate::bench::recorder::{COLUMNS, Cell, Row};
use crate::error::BadInput;
use crate::record::{self, Record};
use crate::rig::Rig;
use model_core::controller::Controller;
use model_core::io::{Output, Request, Sensors};
use model_core::settings::Settings;
use model_core::signal::{AdcCount, EncoderCount};
use serde::Serialize;
use std::ops::Range;

/// The columns that are compared, those of the valve first.
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

/// How often a stretch is tried on a board that loses its controller's state on the way.
const ATTEMPTS: usize = 3;

/// A record's inputs.
pub struct Inputs<'a> {
    record: &'a Record,
    sensors: Vec<Sensors>,
    stretches: Vec<(Settings, Range<usize>)>,
}

impl<'a> Inputs<'a> {
    /// Takes the inputs out of `record`.
    ///
    /// # Errors
    /// It lacks them, or the settings of its controller.
    pub fn new(record: &'a Record) -> Result<Inputs<'a>, BadInput> {
        let sensors = sensors(record)?;
        let begins = begins(record)?;
        let mut stretches: Vec<(Settings, Range<usize>)> = Vec::new();
        // Whether the last row belongs to a stretch.
        let mut known = false;
        for (row, begin) in begins.into_iter().enumerate() {
            if let Some(settings) = begin {
                stretches.push((settings, row..row));
                known = true;
            }
            known = known && (begin.is_some() || follows(record, row));
            if let (true, Some((_, rows))) = (known, stretches.last_mut()) {
                rows.end = row + 1;
            }
        }
        if stretches.is_empty() {
            let why = "the controller's settings where it has begun anew (a recording from the \
                       start), found none";
            return Err(record.bad(record::SETTINGS, why));
        }
        record.require(record::VALVE_COUNT)?;
        Ok(Inputs {
            record,
            sensors,
            stretches,
        })
    }

    /// Ticks that can be compared.
    pub fn ticks(&self) -> usize {
        self.stretches.iter().map(|(_, rows)| rows.len()).sum()
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
                missed_ticks: missed[row] as u8,
                request: request(row)?,
            })
        })
        .collect()
}

/// The settings that the controller begins anew with, where it does.
fn begins(record: &Record) -> Result<Vec<Option<Settings>>, BadInput> {
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

/// True unless ticks are missing before `row`. With hardware in the loop a board also counts the
/// ticks in which its controller stands still.
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

/// Where a controller runs that is to do it again.
pub trait Replayer {
    /// Begins a controller with `settings`.
    ///
    /// # Errors
    /// There is none to be had.
    fn begin(&mut self, settings: &Settings) -> Result<(), Error>;

    /// One tick; none if the controller has meanwhile begun anew.
    ///
    /// # Errors
    /// There is none any more.
    fn tick(&mut self, sensors: &Sensors) -> Result<Option<Output>, Error>;
}

/// Why a replay did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The record, or the board's settings.
    #[error(transparent)]
    Input(#[from] BadInput),
    /// The board.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// A controller in this program.
#[derive(Default)]
pub struct OnPc(Option<Controller>);

impl Replayer for OnPc {
    fn begin(&mut self, settings: &Settings) -> Result<(), Error> {
        self.0 = Some(Controller::new(*settings));
        Ok(())
    }

    fn tick(&mut self, sensors: &Sensors) -> Result<Option<Output>, Error> {
        Ok(self.0.as_mut().map(|controller| controller.tick(sensors)))
    }
}

/// The firmware, with hardware in the loop.
pub struct OnBoard<'a, P> {
    /// The way to it.
    pub client: &'a mut Client<P>,
    /// What the port is called.
    pub port: &'a str,
    /// Whether other settings may be stored on it.
    pub may_write_settings: bool,
}

impl<P: Port> Replayer for OnBoard<'_, P> {
    fn begin(&mut self, settings: &Settings) -> Result<(), Error> {
        let may_write = self.may_write_settings;
        store(self.client, *settings, self.port, "the record", may_write)?;
        self.client.begin_anew()?;
        Ok(())
    }

    fn tick(&mut self, sensors: &Sensors) -> Result<Option<Output>, Error> {
        let answer = self.client.exchange(sensors)?;
        Ok((!answer.began_anew).then_some(answer.output))
    }
}

fn other_settings(port: &str, whose: &str) -> BadInput {
    let why = format!(
        "a board with the settings of {whose}, found other ones: \
         --write-settings stores them on the board"
    );
    BadInput::file(port, why)
}

/// The board's settings, those of `rig` among them; stores them if they are not.
///
/// # Errors
/// They are others, and may not be stored.
pub fn settle<P: Port>(
    client: &mut Client<P>,
    rig: &Rig,
    port: &str,
    may_write_settings: bool,
) -> Result<Settings, Error> {
    let wanted = settings_with(rig, &client.settings()?)?;
    store(client, wanted, port, "the rig", may_write_settings)
}

/// The settings that are `wanted`, stored on the board if it has others; `whose` in words.
///
/// # Errors
/// They are others, and may not be stored.
pub fn store<P: Port>(
    client: &mut Client<P>,
    wanted: Settings,
    port: &str,
    whose: &str,
    may_write_settings: bool,
) -> Result<Settings, Error> {
    if *wanted.values() != client.settings()? {
        if !may_write_settings {
            return Err(other_settings(port, whose).into());
        }
        client.write_settings(wanted.values())?;
    }
    Ok(wanted)
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
    /// What it holds.
    pub recorded: String,
    /// What came out now.
    pub replayed: String,
    /// The difference, of numbers.
    pub difference: Option<f64>,
}

/// What came of a replay.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Replay {
    /// Ticks of the record.
    pub ticks: usize,
    /// Ticks that were compared; the others come before the controller's first known start, or
    /// after missing ones.
    pub compared_ticks: usize,
    /// Ticks that differ in any output.
    pub differing_ticks: usize,
    /// How often the controller has begun anew.
    pub starts: usize,
    /// The first that differs.
    pub first_divergence: Option<Divergence>,
    /// The largest difference of each output that differs.
    pub largest_differences: Vec<(&'static str, f64)>,
}

impl Replay {
    /// In words.
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

/// Replays `inputs`; `progress` is told how many ticks are done.
///
/// # Errors
/// The controller cannot be had, or forgets its state each time.
pub fn replay(
    inputs: &Inputs,
    on: &mut impl Replayer,
    mut progress: impl FnMut(usize),
) -> Result<Replay, Error> {
    let mut result = Replay {
        ticks: inputs.sensors.len(),
        starts: inputs.stretches.len(),
        ..Replay::default()
    };
    for (settings, rows) in &inputs.stretches {
        let mut outputs = None;
        for _ in 0..ATTEMPTS {
            let done = result.compared_ticks;
            outputs = stretch(on, settings, &inputs.sensors[rows.clone()], |ticks| {
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

/// The outputs over a stretch; none if the controller has begun anew on the way.
fn stretch(
    on: &mut impl Replayer,
    settings: &Settings,
    sensors: &[Sensors],
    mut progress: impl FnMut(usize),
) -> Result<Option<Vec<Output>>, Error> {
    on.begin(settings)?;
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
        begins_with: None,
    };
    let mut differs = false;
    for (column, _, value) in COLUMNS {
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
                Some((_, most)) => *most = most.max(difference.abs()),
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

/// Recorded and replayed value of an output, and their difference; none if they are the same to
/// the last bit, or the record has no value there.
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

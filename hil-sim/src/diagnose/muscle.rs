//! The muscle rig as the engine sees it: its blocks on measured inputs, and their residuals.
//!
//! - *gas*: reference and measured contraction in, pressure simulated, against the measured one.
//! - *force* (with a force channel): measured pressure and contraction in, against measured force.
//! - *load*: the balance of forces on the weight. Acceleration and speed come from the measured
//!   contraction through a smooth kernel, which takes the derivatives; where the weight stands
//!   still, static friction may be anything up to its limit.

use super::Calibrated;
use super::along::Along;
use super::begin::{UNKNOWNS, fading_n, forgotten, likeliest};
use super::choice::NOISE_ONLY;
use super::engine::{Active, Candidate, Coordinate, Model, Parameter};
use super::least_squares::Residuals;
use super::repeats::force_repeatability_n;
use crate::check::{Check, Finding, Signal, check};
use crate::effects::CATALOGUE;
use crate::error::BadInput;
use crate::plant::load::{GRAVITY_M_PER_S2, LoadBlock, LoadPoint};
use crate::plant::sensors::Reading;
use crate::plant::simulation::Initial;
use crate::plant::term::Terms;
use crate::plant::{Plant, Simulated, Term};
use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA};
use crate::rig::{Effect, Load, Rig, Tolerance, Weight};
use crate::simulate::{Inputs, simulate};
use model_core::pressure::GaugePa;
use std::borrow::Cow;
use std::ops::{ControlFlow, Range};

/// Width (standard deviation) of the smooth kernel \[s\]: below the periods of weight on muscle.
const KERNEL_S: f64 = 0.04;
/// The kernel reaches so many widths.
const KERNEL_REACH: f64 = 4.0;
/// The same in a fall onto the stop, which takes a tenth of a second \[s\].
const FALL_KERNEL_S: f64 = 0.01;
/// Residuals through a kernel stand so many widths apart: neighbours hardly share noise.
const SPACING: f64 = 2.5;
/// The begin of a record that is not compared, as the gas may not have been at rest \[s\].
const SKIP_S: f64 = 0.6;
/// Tolerance of the simulations.
const TOLERANCE: f64 = 1e-4;
/// A speed is one when it is so many of its standard errors.
const SPEED_ERRORS: f64 = 5.0;
/// An encoder that has moved by so many times its noise is taken along, over one of these numbers
/// of rows before and after.
const CONTACT_NOISES: f64 = 6.0;
const CONTACT_ROWS: [usize; 4] = [1, 2, 4, 8];
/// So near to a change of direction the weight may still be stuck, or be so already \[s\].
const TURN_S: f64 = 0.03;
/// An encoder that rests for longer than this has more to it than a turn of the motion \[s\].
const TURN_LONG_S: f64 = 0.3;
/// So near to its lowest reading the weight may rest on the stop, which holds it from below \[-\].
const STOP_REACH: f64 = 5e-3;
/// It surely rests there where the muscle pulls less than this share of the weight, and it has not
/// moved for so long before and after \[s\].
const STOP_SHARE: f64 = 0.5;
const STOP_REST_S: f64 = 0.3;
/// The stop is where the contraction is 0, to within this \[-\].
const STOP_PLACE: f64 = 1e-4;
/// So long after a landing on the stop the gas is not compared \[s\]: between two samples the
/// contraction is not known there.
const LANDING_S: f64 = 0.1;
/// Speed of a landing that matters \[1/s\].
const LANDING_PER_S: f64 = 0.05;
/// A simulation that takes more steps than this in a second, and a row, is given up: its parameters
/// are far from those of any rig.
const STEPS_PER_S: f64 = 300.0;
const STEPS_PER_ROW: f64 = 2.0;
/// A free motion is as good as it can be when it is within so many times the noise: where a weight
/// sticks is decided by less.
const MOTION_NOISES: f64 = 5.0;
/// Stops of a record that are independent of each other.
const MOTION_STOPS: f64 = 8.0;
/// Share of a nominal value that is left at least.
const LEAST_SHARE: f64 = 0.05;
/// Share of the nominal mass that a payload leaves at least: with less it is another rig's.
const LEAST_SHARE_OF_MASS: f64 = 0.5;
/// The least time between rows that are compared \[s\]: the fastest effects take a few of them, and
/// rows between them would cost time and tell little.
const PERIOD_S: f64 = 0.008;
/// The same where nothing changes by so many times its noise \[s\].
const REST_S: f64 = 0.1;
const CHANGE_NOISES: f64 = 6.0;
/// Shares by which noise may be larger than it is taken to be: of a sensor, from many samples; of
/// what a bench repeats, from few runs (as many as a block may be above its noise).
const DOUBT_OF_NOISE: f64 = 0.02;
const DOUBT_OF_REPEATABILITY: f64 = NOISE_ONLY - 1.0;
/// Force that no bench of this kind resolves, so no residual is judged finer \[N\].
const FORCE_FLOOR_N: f64 = 0.1;

/// Muscle and instruments, on measured pressure and contraction.
const FORCE_ALONE: Simulated = Simulated {
    pressure: false,
    motion: false,
};

const GAS: &str = "gas";
const FORCE: &str = "force";
const LOAD: &str = "load";

/// Standard deviations of a record's noise.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Noise {
    /// Of the pressure \[Pa\].
    pub pressure_pa: f64,
    /// Of the contraction \[-\].
    pub contraction: f64,
    /// Of the force \[N\].
    pub force_n: f64,
}

impl Noise {
    /// That of the signal in a column.
    pub fn of(&self, signal: &str) -> f64 {
        match signal {
            PRESSURE_PA => self.pressure_pa,
            CONTRACTION => self.contraction,
            _ => self.force_n,
        }
    }
}

/// One place where the balance of forces is looked at.
struct Place {
    kernel: Kernel,
    /// One over the standard deviation of the balance's noise \[1/N\].
    per_noise: f64,
}

/// The least and the most that a sensor can read, as far as a record shows it by being clipped.
#[derive(Clone, Copy)]
struct Span {
    least: f64,
    most: f64,
}

impl Span {
    fn of(checked: &Check, name: &str) -> Span {
        let mut span = Span {
            least: f64::NEG_INFINITY,
            most: f64::INFINITY,
        };
        for warning in &checked.warnings {
            if let Finding::Clipped { signal, value, .. } = warning
                && *signal == name
            {
                match checked.signal(name) {
                    Some(own) if *value == own.min => span.least = *value,
                    _ => span.most = *value,
                }
            }
        }
        span
    }

    /// What the sensor makes of `value`.
    fn read(self, value: f64) -> f64 {
        value.clamp(self.least, self.most)
    }

    /// It reads its bound.
    fn clips(self, read: f64) -> bool {
        read <= self.least || read >= self.most
    }
}

/// A record made ready.
struct Prepared {
    /// With the reference, for the gas; without, for force and load.
    gas: Option<Record>,
    measured: Record,
    noise: Noise,
    places: Vec<Place>,
    /// Rows in which the weight rests on its stop, as far apart as the places.
    stops: Vec<usize>,
    /// Of each row: smoothed ε̇ \[1/s\]; and +1 or −1 where the weight surely moves, else 0.
    rates_per_s: Vec<f64>,
    directions: Vec<f64>,
    /// Of each row: where the contraction has surely moved to \[-\].
    path: Vec<f64>,
    /// Of each row: on which side of a play the motion has left the encoder, from −1 to 1; and
    /// whether the muscle surely takes the encoder along.
    sides: Vec<f64>,
    in_contact: Vec<bool>,
    /// Rows in which pressure and force are compared.
    gas_rows: Vec<usize>,
    force_rows: Vec<usize>,
    /// Of each row that is compared: one over the standard deviation of the force's noise \[1/N\].
    per_force_noise: Vec<f64>,
    /// What the sensors of pressure \[Pa\] and force \[N\] can read at all.
    pressure_span: Span,
    force_span: Span,
    contraction_moves: bool,
    /// Its effects are settled as it begins.
    settled: bool,
    /// What is doubtful about it.
    warnings: Vec<String>,
}

/// Which way the muscle surely takes an encoder with play along: +1, −1, or 0 where it may not.
/// Over one of the `reaches`, numbers of rows: slow motion shows over many only.
fn contacts(contraction: &[f64], noise: f64, reaches: &[usize]) -> Vec<f64> {
    let last = contraction.len() - 1;
    let moved = |from: usize, to: usize| {
        let way = contraction[to] - contraction[from];
        if way.abs() > CONTACT_NOISES * noise {
            way.signum()
        } else {
            0.0
        }
    };
    let contact = |row: usize| {
        let mut ways = reaches.iter().map(|reach| {
            let (from, to) = (row.saturating_sub(*reach), (row + reach).min(last));
            let (before, after) = (moved(from, row), moved(row, to));
            if before == after { before } else { 0.0 }
        });
        ways.find(|way| *way != 0.0).unwrap_or(0.0)
    };
    (0..=last).map(contact).collect()
}

/// Directions with each rest of the encoder crossed: in a short one the motion turns, with a steady
/// acceleration; in a long one the muscle goes with the pressure.
fn bridged(time_s: &[f64], directions: &[f64], pressure_pa: Option<&[f64]>) -> Vec<f64> {
    let moving: Vec<usize> = (0..directions.len())
        .filter(|row| directions[*row] != 0.0)
        .collect();
    let mut sides = directions.to_vec();
    let (Some(first), Some(last)) = (moving.first(), moving.last()) else {
        return sides;
    };
    sides[..*first].fill(directions[*first]);
    sides[*last..].fill(directions[*last]);
    for pair in moving.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        for row in from + 1..to {
            let by_time = (time_s[row] - time_s[from]) / (time_s[to] - time_s[from]);
            let long = time_s[to] - time_s[from] > TURN_LONG_S;
            let by_pressure = pressure_pa.map(|p| (p[row] - p[from]) / (p[to] - p[from]));
            let by_pressure = by_pressure.filter(|share| long && share.is_finite());
            let share = by_pressure.unwrap_or(by_time * by_time);
            let whole = directions[to] - directions[from];
            sides[row] = directions[from] + share.clamp(0.0, 1.0) * whole;
        }
    }
    sides
}

/// When a weight lands on its stop with a speed.
fn landings_s(time_s: &[f64], contraction: &[f64], rates_per_s: &[f64]) -> Vec<f64> {
    let lowest = contraction.iter().copied().fold(f64::INFINITY, f64::min);
    let low = |value: f64| value < lowest + 1e-3;
    let rows = 3..time_s.len();
    let lands = rows.filter(|row| low(contraction[*row]) && !low(contraction[row - 1]));
    let fast = lands.filter(|row| {
        rates_per_s[row - 3..*row]
            .iter()
            .any(|r| *r < -LANDING_PER_S)
    });
    fast.map(|row| time_s[row]).collect()
}

/// The rig with its records.
pub struct MuscleModel {
    rig: Rig,
    records: Vec<Prepared>,
    fitted: usize,
    /// What the force is off from run to run \[N\], where that is known.
    repeatability_n: Option<f64>,
    blocks: Vec<&'static str>,
    nominal_blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
}

/// By which factor a nominal value moves with so many of its standard deviations: never through 0,
/// where a heat transfer or a friction would drive the plant.
fn moved_by(tolerance: &Tolerance, deviations: f64) -> f64 {
    (1.0 + tolerance.relative_sigma * deviations).max(LEAST_SHARE)
}

/// The blocks on which a nominal value of a section acts.
fn blocks_of(section: &str, key: &str) -> &'static [&'static str] {
    match (section, key) {
        ("muscle", "volume_d1_m3" | "volume_d2_m3" | "volume_d3_m3") => &[GAS],
        ("muscle", "initial_length_m") => &[GAS, LOAD],
        ("muscle", _) => &[FORCE],
        ("load", _) => &[LOAD],
        _ => &[GAS],
    }
}

/// The blocks that an effect changes.
fn blocks_of_effect(name: &str, place: &str) -> &'static [&'static str] {
    match (name, place) {
        ("line-dynamics", _) => &[GAS, FORCE],
        ("contraction-sensor-offset" | "backlash", _) => &[GAS, FORCE, LOAD],
        // Where the force is measured, the balance of the load is taken with it.
        ("force-sensor-offset", _) => &[FORCE, LOAD],
        (_, "sensor") => &[GAS, FORCE],
        (_, "muscle-force") => &[FORCE],
        (_, "load") => &[LOAD],
        _ => &[GAS],
    }
}

/// Whether records can show an effect at all: what they measure and move.
fn can_show(name: &str, place: &str, force_measured: bool, contraction_moves: bool) -> bool {
    match (name, place) {
        ("force-sensor-offset", _) => force_measured,
        // It is in the contraction's direction and way; at rest it is a constant that others are.
        ("hysteresis", _) | (_, "load") => contraction_moves,
        _ => true,
    }
}

impl MuscleModel {
    /// The model of `rig` with the records that are fitted; effects named in `without` are left
    /// out.
    ///
    /// # Errors
    /// The records lack what every diagnosis needs.
    pub fn new(
        rig: &Rig,
        fit: &[Record],
        validate: &[Record],
        without: &[String],
    ) -> Result<Self, BadInput> {
        let records = || fit.iter().chain(validate);
        let has = |name: &str| records().all(|record| record.column(name).is_some());
        let bench = rig.load == Load::Prescribed && has(FORCE_N);
        let repeatability_n = force_repeatability_n(records().filter(|_| bench));
        let prepared = Prepared::all(rig, records(), repeatability_n)?;
        let moves = prepared.iter().any(|record| record.contraction_moves);
        let mut blocks = Vec::new();
        if has(PRESSURE_REF_PA) && rig.valve.is_some() {
            blocks.push(GAS);
        }
        if has(FORCE_N) {
            blocks.push(FORCE);
        }
        if matches!(rig.load, Load::Weight(_)) {
            blocks.push(LOAD);
        }
        // Without a force channel the balance of the load stands for both.
        let places = |names: &[&str]| -> Vec<usize> {
            let mut places: Vec<usize> = names
                .iter()
                .filter_map(|name| {
                    let instead = if *name == FORCE && !blocks.contains(&FORCE) {
                        LOAD
                    } else {
                        name
                    };
                    blocks.iter().position(|block| *block == instead)
                })
                .collect();
            places.sort_unstable();
            places.dedup();
            places
        };
        let nominal = |tolerance: &Tolerance| places(blocks_of(&tolerance.section, &tolerance.key));
        let nominal_blocks = rig.tolerances.iter().map(nominal).collect();
        let kinds = CATALOGUE.iter().filter(|kind| {
            !without.iter().any(|name| name == kind.name)
                && can_show(kind.name, kind.block, has(FORCE_N), moves)
        });
        let forms = kinds.flat_map(|kind| kind.forms.iter().map(move |form| (kind, form)));
        let candidates = forms.map(|(kind, form)| Candidate {
            effect: kind.name,
            form: form.name,
            parameters: form
                .parameters
                .iter()
                .map(|p| Parameter {
                    name: p.name,
                    unit: p.unit,
                    range: (p.min, p.max),
                    usual: p.usual,
                    log: p.log,
                    neutral: p.neutral,
                })
                .collect(),
            blocks: places(blocks_of_effect(kind.name, kind.block)),
        });
        // An effect on no block that was measured cannot be seen.
        let candidates = candidates
            .filter(|candidate| !candidate.blocks.is_empty())
            .collect();
        Ok(MuscleModel {
            fitted: fit.len(),
            repeatability_n,
            records: prepared,
            rig: rig.clone(),
            blocks,
            nominal_blocks,
            candidates,
        })
    }

    /// The rig with its nominal values moved by `nominal` standard deviations, and effects added.
    pub fn fitted(&self, nominal: &[f64], effects: &[Active]) -> Rig {
        let mut rig = self.rig.clone();
        for (tolerance, deviation) in self.rig.tolerances.iter().zip(nominal) {
            if let Some(value) = rig.value_mut(&tolerance.section, &tolerance.key) {
                *value *= moved_by(tolerance, *deviation);
            }
        }
        for (candidate, values) in effects {
            let candidate = &self.candidates[*candidate];
            let kind = crate::effects::find(candidate.effect);
            if let Some((kind, form)) = kind.and_then(|k| Some((k, k.form(candidate.form)?))) {
                let values = values.clone();
                rig.effects.push(Effect { kind, form, values });
            }
        }
        rig
    }

    /// The nominal values that `nominal` moves.
    pub fn calibrated(&self, nominal: &[f64]) -> Vec<Calibrated> {
        let mut rig = self.rig.clone();
        let values = self.rig.tolerances.iter().zip(nominal);
        let of = |(tolerance, deviation): (&Tolerance, &f64)| {
            let value = *rig.value_mut(&tolerance.section, &tolerance.key)?;
            Some(Calibrated {
                key: format!("{}.{}", tolerance.section, tolerance.key),
                values: [value, value * moved_by(tolerance, *deviation)],
                deviation: *deviation,
            })
        };
        values.filter_map(of).collect()
    }

    /// The equations that a block is made of.
    pub fn places(&self, block: &str) -> Vec<&'static str> {
        match block {
            GAS => vec![GAS],
            FORCE => vec!["muscle-force"],
            _ if self.blocks.contains(&FORCE) => vec![LOAD],
            // One balance of forces for both.
            _ => vec!["muscle-force", LOAD],
        }
    }

    /// What the records cannot show.
    pub fn warnings(&self) -> Vec<String> {
        let numbered = self.records.iter().enumerate();
        let mut warnings: Vec<String> = numbered
            .flat_map(|(number, record)| {
                let (kind, number) = match number.checked_sub(self.fitted) {
                    None => ("fitted", number + 1),
                    Some(later) => ("validation", later + 1),
                };
                let words = record.warnings.iter();
                words.map(move |words| format!("{kind} record {number}: {words}"))
            })
            .collect();
        if let Some(repeatability_n) = self.repeatability_n {
            warnings.push(format!(
                "at the same contraction, pressure and direction the force differs by \
                 {repeatability_n:.1} N RMS from run to run (zeros, mounting, run-in): no effect \
                 below that is looked for"
            ));
        }
        if !self.blocks.contains(&FORCE) {
            warnings.push("no force_n: the muscle's force is judged by the weight alone".into());
        }
        if !self.blocks.contains(&GAS) {
            warnings.push("no pressure_ref_pa or valve: nothing is said of valve and gas".into());
        }
        warnings
    }

    /// Whether records tell how well the rig repeats itself.
    pub fn repeated(&self) -> bool {
        self.repeatability_n.is_some()
    }

    /// The noise of each record; of the force, with what a bench does not repeat.
    pub fn noise(&self) -> Vec<Noise> {
        let of = |record: &Prepared| Noise {
            force_n: record
                .noise
                .force_n
                .hypot(self.repeatability_n.unwrap_or(0.0)),
            ..record.noise
        };
        self.records.iter().map(of).collect()
    }
}

/// `record` with no more rows than the fastest effects ask for. On a `bench`, where the pressure is
/// an input, rows in which nothing has changed are rarer; with a reference there is one where that
/// changes. A cell without a sample has the next one before the next such row.
fn thinned(record: &Record, noise: &Noise, bench: bool) -> Record {
    let time_s = record.time_s();
    let reference_pa = record.column(PRESSURE_REF_PA);
    let signals = [PRESSURE_PA, CONTRACTION, FORCE_N];
    let signals = signals.map(|name| (record.column(name), CHANGE_NOISES * noise.of(name)));
    let changes = |from: usize, to: usize| {
        let mut signals = signals.iter();
        signals.any(|(values, change)| {
            values.is_some_and(|values| (values[to] - values[from]).abs() > *change)
        })
    };
    let mut begins = vec![0];
    let mut last = 0;
    for row in 1..time_s.len() {
        let due = match reference_pa {
            Some(reference_pa) => {
                let (own, before) = (reference_pa[row], reference_pa[row - 1]);
                time_s[row] >= time_s[last] + PERIOD_S || own != before && !own.is_nan()
            }
            None if time_s[row] < time_s[last] + PERIOD_S => false,
            // A weight's balance at rest bounds its static friction.
            None if !bench => true,
            None => {
                let changed = changes(last, row);
                // What comes at once is not spread over the time before it.
                if changed && time_s[row - 1] >= time_s[last] + PERIOD_S {
                    begins.push(row - 1);
                }
                changed || time_s[row] >= time_s[last] + REST_S
            }
        };
        if due {
            begins.push(row);
            last = row;
        }
    }
    if begins.len() == time_s.len() {
        return record.clone();
    }
    let mut thin = Record::new(begins.iter().map(|row| time_s[*row]).collect());
    let ends = begins.iter().skip(1).copied().chain([time_s.len()]);
    let stretches: Vec<_> = begins.iter().zip(ends).map(|(a, b)| *a..b).collect();
    for name in [
        PRESSURE_REF_PA,
        PRESSURE_PA,
        CONTRACTION,
        FORCE_N,
        SUPPLY_PA,
    ] {
        if let Some(values) = record.column(name) {
            let first = |rows: &Range<usize>| {
                let mut present = values[rows.clone()].iter().filter(|value| !value.is_nan());
                present.next().copied().unwrap_or(f64::NAN)
            };
            thin.set(name, stretches.iter().map(first).collect());
        }
    }
    thin
}

/// Whether what drives a rig is at rest as `record` begins: the pressure, and a contraction that is
/// no weight's.
fn begins_at_rest(rig: &Rig, record: &Record, noise: &Noise) -> bool {
    let time_s = record.time_s();
    let begin = time_s.partition_point(|t| *t < time_s[0] + SKIP_S);
    let contraction = (rig.load == Load::Prescribed).then_some(CONTRACTION);
    let mut driving = [PRESSURE_PA].into_iter().chain(contraction);
    driving.all(|name| {
        let values = record.column(name).unwrap_or_default();
        let present = values.iter().take(begin).filter(|value| !value.is_nan());
        let most = present.clone().copied().fold(f64::NEG_INFINITY, f64::max);
        let least = present.copied().fold(f64::INFINITY, f64::min);
        // Noise goes either way.
        most - least <= 2.0 * CHANGE_NOISES * noise.of(name)
    })
}

/// A record with some columns of another.
fn with_columns(record: &Record, names: &[&str]) -> Record {
    let mut copy = Record::new(record.time_s().to_vec());
    for name in names {
        if let Some(values) = record.column(name) {
            copy.set(name, values.to_vec());
        }
    }
    copy
}

/// How far the encoder of `rig` may be behind the muscle, either way \[-\].
fn play(rig: &Rig) -> f64 {
    let length_m = rig.muscle.initial_length_m;
    let plays = rig
        .effects
        .iter()
        .map(|effect| match (effect.form.build)(&effect.values) {
            Term::Sensor(term) => term.play(length_m),
            _ => 0.0,
        });
    plays.sum()
}

impl Prepared {
    /// `record` with the contraction that an encoder with `play` has read so; where the encoder
    /// rests the muscle is where it `may` be in the play, from −1 to 1, or where it most likely is.
    fn unplayed<'a>(&self, play: f64, record: &'a Record, may: Option<f64>) -> Cow<'a, Record> {
        let Some(contraction) = record.column(CONTRACTION).filter(|_| play > 0.0) else {
            return Cow::Borrowed(record);
        };
        let place = |row: usize| may.filter(|_| !self.in_contact[row]);
        let rows = contraction.iter().zip(&self.sides).enumerate();
        let true_contraction = rows
            .map(|(row, (c, side))| c + play * place(row).unwrap_or(*side))
            .collect();
        let mut record = record.clone();
        record.set(CONTRACTION, true_contraction);
        Cow::Owned(record)
    }

    /// What states that were off at the begin add to the force, row by row \[N\]; none where they
    /// were settled.
    fn fading_n(&self, rig: &Rig) -> Option<Vec<Vec<f64>>> {
        if self.settled {
            return Some(Vec::new());
        }
        fading_n(rig, &self.measured).ok()
    }

    /// The least and the most force that the muscle can have, row by row \[N\], if it began with
    /// such a memory.
    fn forces_n(&self, rig: &Rig, memory: Option<f64>) -> Option<Vec<(f64, f64)>> {
        let play = play(rig);
        let of = |may: Option<f64>| {
            let read = run(rig, &self.unplayed(play, &self.measured, may), memory)?;
            Some(
                read.into_iter()
                    .map(|(read, force_n)| (read.force_n, force_n)),
            )
        };
        if play == 0.0 {
            return Some(of(None)?.map(|(read_n, _)| (read_n, read_n)).collect());
        }
        let pairs = of(Some(1.0))?.zip(of(Some(-1.0))?);
        Some(pairs.map(|((a, _), (b, _))| (a.min(b), a.max(b))).collect())
    }

    fn all<'a>(
        rig: &Rig,
        records: impl Iterator<Item = &'a Record>,
        repeatability_n: Option<f64>,
    ) -> Result<Vec<Prepared>, BadInput> {
        let mut prepared = records
            .map(|record| Prepared::new(rig, record, repeatability_n))
            .collect::<Result<Vec<_>, _>>()?;
        // Who does not wait before one record does not before the others; some may begin in a hold.
        let settled = prepared.iter().all(|record| record.settled);
        for record in &mut prepared {
            record.settled = settled;
        }
        Ok(prepared)
    }

    /// `repeatability_n` is what the force is off from run to run, if that is known.
    fn new(rig: &Rig, record: &Record, repeatability_n: Option<f64>) -> Result<Prepared, BadInput> {
        let checked = check(record);
        checked.refuse(record)?;
        let of = |name: &str| checked.signal(name).map_or(0.0, |signal| signal.noise);
        let noise = Noise {
            pressure_pa: of(PRESSURE_PA).max(1.0),
            contraction: of(CONTRACTION).max(1e-7),
            force_n: of(FORCE_N).max(1e-3),
        };
        let warnings = checked.warnings.iter().map(ToString::to_string).collect();
        let record = &thinned(record, &noise, rig.load == Load::Prescribed);
        let contraction = record.require(CONTRACTION)?;
        let mut prepared = Prepared {
            gas: record.column(PRESSURE_REF_PA).is_some().then(|| {
                with_columns(
                    record,
                    &[PRESSURE_REF_PA, PRESSURE_PA, CONTRACTION, SUPPLY_PA],
                )
            }),
            measured: with_columns(record, &[PRESSURE_PA, CONTRACTION, FORCE_N]),
            noise,
            places: Vec::new(),
            stops: Vec::new(),
            rates_per_s: vec![0.0; contraction.len()],
            directions: vec![0.0; contraction.len()],
            path: Vec::with_capacity(contraction.len()),
            sides: vec![0.0; contraction.len()],
            in_contact: vec![true; contraction.len()],
            gas_rows: Vec::new(),
            force_rows: Vec::new(),
            per_force_noise: Vec::new(),
            pressure_span: Span::of(&checked, PRESSURE_PA),
            force_span: Span::of(&checked, FORCE_N),
            contraction_moves: checked.signal(CONTRACTION).is_some_and(Signal::moves),
            settled: begins_at_rest(rig, record, &noise),
            warnings,
        };
        prepared.motion(record, contraction);
        let time_s = record.time_s();
        let begin = time_s.partition_point(|t| *t < time_s[0] + SKIP_S);
        let rows = |name: &str| -> Vec<usize> {
            let column = record.column(name).unwrap_or_default();
            (begin..column.len())
                .filter(|row| !column[*row].is_nan())
                .collect()
        };
        prepared.gas_rows = rows(PRESSURE_PA);
        prepared.force_rows = rows(FORCE_N);
        prepared.weigh_forces(rig, record, repeatability_n.unwrap_or(0.0));
        let Load::Weight(weight) = rig.load else {
            return Ok(prepared);
        };
        let landings_s = landings_s(time_s, contraction, &prepared.rates_per_s);
        prepared.gas_rows.retain(|row| {
            let mut landings = landings_s.iter();
            !landings.any(|s| (-0.02..LANDING_S).contains(&(time_s[*row] - s)))
        });
        // Surely one way only where all of the neighbourhood goes that way.
        let surely: Vec<f64> = (0..time_s.len())
            .map(|row| {
                let from = time_s.partition_point(|t| *t < time_s[row] - TURN_S);
                let to = time_s.partition_point(|t| *t <= time_s[row] + TURN_S);
                let own = prepared.directions[row];
                let agree = prepared.directions[from..to].iter().all(|d| *d == own);
                if agree { own } else { 0.0 }
            })
            .collect();
        prepared.directions = surely;
        prepared.places(rig, &weight);
        prepared.stops(rig, &weight);
        Ok(prepared)
    }

    /// How well the force is known in each row that is compared: by its noise and the pressure's.
    fn weigh_forces(&mut self, rig: &Rig, record: &Record, repeatability_n: f64) {
        let contraction = record.column(CONTRACTION).unwrap_or_default();
        self.force_rows.retain(|row| !contraction[*row].is_nan());
        if let Some(pressure_pa) = record.column(PRESSURE_PA) {
            let span = self.pressure_span;
            // The muscle's own pressure is not known there.
            self.force_rows.retain(|row| !span.clips(pressure_pa[*row]));
        }
        let per_noise = |row: &usize| {
            let per_pressure_m2 = rig.muscle.force_per_pressure_m2(contraction[*row]);
            let noise_n = (per_pressure_m2 * self.noise.pressure_pa)
                .hypot(self.noise.force_n)
                .hypot(FORCE_FLOOR_N.max(repeatability_n));
            noise_n.recip()
        };
        self.per_force_noise = self.force_rows.iter().map(per_noise).collect();
    }

    /// Rates, directions, the path, and on which side of a play the encoder is.
    fn motion(&mut self, record: &Record, contraction: &[f64]) {
        for row in 0..contraction.len() {
            let time_s = record.time_s()[row];
            let kernel = Kernel::at(record.time_s(), time_s, 0.5 * KERNEL_S);
            let rate_per_s = kernel.first(contraction);
            let place = kernel.value(contraction);
            let play = SPEED_ERRORS * self.noise.contraction * norm(&kernel.value);
            let last = self.path.last().copied().unwrap_or(place);
            // Not `clamp`, which refuses the NaN of a gap; noise must not be a way without end.
            self.path.push(last.max(place - play).min(place + play));
            // Rows that are farther apart than the kernel reaches show none.
            if !rate_per_s.is_finite() {
                continue;
            }
            let error = self.noise.contraction * norm(&kernel.first);
            self.rates_per_s[row] = rate_per_s;
            if rate_per_s.abs() > SPEED_ERRORS * error {
                self.directions[row] = rate_per_s.signum();
            }
        }
        let contacts = contacts(contraction, self.noise.contraction, &CONTACT_ROWS);
        // Between two contacts on one side the muscle may have been at the other.
        self.in_contact = contacts.iter().map(|way| *way != 0.0).collect();
        self.sides = bridged(record.time_s(), &contacts, record.column(PRESSURE_PA));
    }

    /// Where the weight rests on its stop.
    fn stops(&mut self, rig: &Rig, weight: &Weight) {
        let time_s = self.measured.time_s();
        let Some(pressure_pa) = self.measured.column(PRESSURE_PA) else {
            return;
        };
        let most_n = STOP_SHARE * weight.mass_kg * GRAVITY_M_PER_S2;
        let loose = |row: usize| rig.muscle.force_n(0.0, GaugePa(pressure_pa[row])) < most_n;
        let mut next_s = time_s[0] + SKIP_S;
        for row in 0..time_s.len() {
            let from = time_s.partition_point(|t| *t < time_s[row] - STOP_REST_S);
            let to = time_s.partition_point(|t| *t <= time_s[row] + STOP_REST_S);
            let rests = self.directions[from..to].iter().all(|d| *d == 0.0);
            if time_s[row] >= next_s && rests && (from..to).all(loose) {
                self.stops.push(row);
                next_s = time_s[row] + SPACING * KERNEL_S;
            }
        }
    }

    /// What the encoder reads on the stop, where a muscle is as long as it can be.
    fn stop_residuals(&self, rig: &Rig) -> Option<Residuals> {
        if self.stops.is_empty() {
            return Some(Residuals::default());
        }
        let inputs = Inputs::new(rig, &self.measured).ok()?;
        let noise = self.noise.contraction.hypot(STOP_PLACE);
        let read = |row: &usize| inputs.contraction(*row).unwrap_or(0.0) / noise;
        Some(Residuals {
            values: self.stops.iter().map(read).collect(),
            slack: vec![play(rig) / noise; self.stops.len()],
        })
    }

    /// Where the balance of the load is looked at: away from ends, gaps and the stop.
    fn places(&mut self, rig: &Rig, weight: &Weight) {
        let time_s = self.measured.time_s();
        let (Some(contraction), Some(pressure_pa)) = (
            self.measured.column(CONTRACTION),
            self.measured.column(PRESSURE_PA),
        ) else {
            return;
        };
        let present = |kernel: &Kernel| {
            let mut rows = kernel.rows.clone();
            rows.len() >= 5 && rows.all(|r| !contraction[r].is_nan() && !pressure_pa[r].is_nan())
        };
        // An encoder with an offset or with play reads something else than 0 on the stop.
        let lowest = contraction.iter().copied().fold(f64::INFINITY, f64::min);
        let lifted = |kernel: &Kernel| {
            let mut rows = kernel.rows.clone();
            rows.all(|r| contraction[r] > lowest + STOP_REACH)
        };
        // Whatever it reads there, it does not fall on.
        let ways = contacts(contraction, self.noise.contraction, &[1]);
        let falls = |kernel: &Kernel| kernel.rows.clone().all(|r| ways[r] < 0.0);
        let (first_s, last_s) = (time_s[0], time_s[time_s.len() - 1]);
        let whole_s = last_s - first_s - SKIP_S - KERNEL_REACH * KERNEL_S;
        let kernels = |width_s: f64| {
            let spacing_s = SPACING * width_s;
            let count = (whole_s / spacing_s).max(0.0) as usize;
            let times_s = (0..count).map(move |n| first_s + SKIP_S + n as f64 * spacing_s);
            times_s.map(move |at_s| Kernel::at(time_s, at_s, width_s))
        };
        let wide = kernels(KERNEL_S).filter(|kernel| present(kernel) && lifted(kernel));
        // A fall onto the stop leaves no room for the wide kernel; there alone would a muscle have
        // to push.
        let narrow = kernels(FALL_KERNEL_S).filter(|kernel| {
            let about = || Kernel::at(time_s, time_s[kernel.middle()], KERNEL_S);
            present(kernel) && falls(kernel) && !lifted(&about())
        });
        let mut kernels: Vec<Kernel> = wide.chain(narrow).collect();
        kernels.sort_by_key(Kernel::middle);
        let places = kernels.into_iter().map(|kernel| Place {
            per_noise: self.balance_noise_n(rig, weight, &kernel).recip(),
            kernel,
        });
        self.places = places.collect();
    }

    /// Standard deviation of the noise of the balance of forces through `kernel` \[N\].
    fn balance_noise_n(&self, rig: &Rig, weight: &Weight, kernel: &Kernel) -> f64 {
        let column = |name| self.measured.column(name).unwrap_or_default();
        let (contraction, pressure_pa) = (column(CONTRACTION), column(PRESSURE_PA));
        let middle = kernel.middle();
        let (at, pressure) = (contraction[middle], GaugePa(pressure_pa[middle]));
        let per_pressure_m2 = rig.muscle.force_per_pressure_m2(at);
        let stiffness_n = (rig.muscle.force_n(at + 1e-4, pressure)
            - rig.muscle.force_n(at - 1e-4, pressure))
            / 2e-4;
        let length_m = rig.muscle.initial_length_m;
        let by_contraction: Vec<f64> = (0..kernel.rows.len())
            .map(|i| {
                stiffness_n * kernel.value[i]
                    - weight.mass_kg * length_m * kernel.second[i]
                    - weight.viscous_damping_ns_per_m * length_m * kernel.first[i]
            })
            .collect();
        let from_pressure_n = per_pressure_m2 * self.noise.pressure_pa * norm(&kernel.value);
        let from_contraction_n = self.noise.contraction * norm(&by_contraction);
        // Between samples the pressure is taken to be straight.
        let bent = |row: usize| {
            let at = |row: usize| pressure_pa[row.min(pressure_pa.len() - 1)];
            let second = at(row + 1) - 2.0 * at(row) + at(row.saturating_sub(1));
            (second.abs() - 3.0 * self.noise.pressure_pa).max(0.0) / 12.0
        };
        let weights = kernel.value.iter().zip(kernel.rows.clone());
        let from_sampling_n =
            per_pressure_m2 * weights.map(|(weight, row)| weight * bent(row)).sum::<f64>();
        from_pressure_n
            .hypot(from_contraction_n)
            .hypot(from_sampling_n)
            .hypot(FORCE_FLOOR_N)
    }
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// A Gaussian and its derivatives as weights of rows: what value, slope and curvature of a signal
/// smoothed by the Gaussian are. Smoothing a balance of forces with the first leaves its other two
/// to the contraction.
struct Kernel {
    rows: Range<usize>,
    value: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Kernel {
    fn at(time_s: &[f64], at_s: f64, width_s: f64) -> Kernel {
        let reach_s = KERNEL_REACH * width_s;
        let start = time_s.partition_point(|t| *t < at_s - reach_s);
        let end = time_s.partition_point(|t| *t <= at_s + reach_s);
        let last = time_s.len() - 1;
        let base = |row: usize| {
            let z = (time_s[row] - at_s) / width_s;
            let span_s = 0.5 * (time_s[(row + 1).min(last)] - time_s[row.saturating_sub(1)]);
            (z, span_s * (-0.5 * z * z).exp())
        };
        let weights = |polynomial: fn(f64) -> f64, moment: i32, of: f64| -> Vec<f64> {
            let rows = (start..end).map(base);
            let mut weights: Vec<f64> = rows.clone().map(|(z, g)| polynomial(z) * g).collect();
            // Exact for constants, whatever the rows' times.
            if moment > 0 {
                let excess =
                    weights.iter().sum::<f64>() / rows.clone().map(|(_, g)| g).sum::<f64>();
                for (weight, (_, g)) in weights.iter_mut().zip(rows.clone()) {
                    *weight -= excess * g;
                }
            }
            let found: f64 = weights
                .iter()
                .zip(rows)
                .map(|(w, (z, _))| w * z.powi(moment))
                .sum();
            weights.iter().map(|weight| weight * of / found).collect()
        };
        Kernel {
            rows: start..end,
            value: weights(|_| 1.0, 0, 1.0),
            first: weights(|z| z, 1, 1.0 / width_s),
            second: weights(|z| z * z - 1.0, 2, 2.0 / (width_s * width_s)),
        }
    }

    /// The row in the middle.
    fn middle(&self) -> usize {
        self.rows.start + self.rows.len() / 2
    }

    fn value(&self, values: &[f64]) -> f64 {
        dot(&self.value, &values[self.rows.clone()])
    }

    fn first(&self, values: &[f64]) -> f64 {
        dot(&self.first, &values[self.rows.clone()])
    }

    fn second(&self, values: &[f64]) -> f64 {
        dot(&self.second, &values[self.rows.clone()])
    }
}

fn dot(weights: &[f64], values: &[f64]) -> f64 {
    weights
        .iter()
        .zip(values)
        .map(|(weight, value)| weight * value)
        .sum()
}

impl Model for MuscleModel {
    fn records(&self) -> usize {
        self.records.len()
    }

    fn fitted(&self) -> usize {
        self.fitted
    }

    fn blocks(&self) -> &[&'static str] {
        &self.blocks
    }

    fn nominal_blocks(&self) -> &[Vec<usize>] {
        &self.nominal_blocks
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn rows(&self, record: usize, block: usize) -> usize {
        let record = &self.records[record];
        match self.blocks[block] {
            GAS => record.gas_rows.len(),
            FORCE => record.force_rows.len() + UNKNOWNS,
            _ => record.places.len() + self.unknowns(block) + record.stops.len(),
        }
    }

    /// States at the begin, told where the muscle's force is judged.
    fn unknowns(&self, block: usize) -> usize {
        match self.blocks[block] {
            FORCE => UNKNOWNS,
            LOAD if !self.blocks.contains(&FORCE) => UNKNOWNS,
            _ => 0,
        }
    }

    /// Where the weight rests, friction takes up what it can.
    fn proportional(&self, block: usize) -> bool {
        self.blocks[block] == GAS
    }

    /// What a bench does not repeat is off for a whole run, not from row to row.
    fn doubt_of_noise(&self, block: usize) -> f64 {
        if self.blocks[block] == FORCE && self.repeatability_n.is_some() {
            DOUBT_OF_REPEATABILITY
        } else {
            DOUBT_OF_NOISE
        }
    }

    /// The motion from the measured pressure: where the weight stays after each stop tells
    /// friction, play and slack far better than the balance of forces does, which knows only a tube
    /// there.
    fn free_run(&self, record: usize, nominal: &[f64], effects: &[Active]) -> Option<f64> {
        let rig = self.fitted(nominal, effects);
        if !matches!(rig.load, Load::Weight(_)) {
            return Some(0.0);
        }
        let record = &self.records[record];
        let simulated = simulate(&rig, &record.measured, TOLERANCE).ok()?;
        let (is, was) = (
            simulated.column(CONTRACTION)?,
            record.measured.column(CONTRACTION)?,
        );
        let pairs = is.iter().zip(was).filter(|(_, was)| !was.is_nan());
        let mean = pairs.clone().map(|(a, b)| (a - b).powi(2)).sum::<f64>() / pairs.count() as f64;
        let scale = MOTION_NOISES * record.noise.contraction;
        let cost = 0.5 * MOTION_STOPS * (1.0 + mean / (scale * scale)).ln();
        cost.is_finite().then_some(cost)
    }

    fn context(&self, record: usize, block: usize) -> Vec<Coordinate> {
        let record = &self.records[record];
        let rows: Vec<usize> = match self.blocks[block] {
            GAS => record.gas_rows.clone(),
            FORCE => [&record.force_rows[..], &[0; UNKNOWNS]].concat(),
            _ => {
                let places = record.places.iter().map(|place| place.kernel.middle());
                let unknown = std::iter::repeat_n(0, self.unknowns(block));
                let rows = places.chain(unknown);
                rows.chain(record.stops.iter().copied()).collect()
            }
        };
        let time_s = record.measured.time_s();
        let pressure_pa = record.measured.column(PRESSURE_PA).unwrap_or_default();
        let contraction = record.measured.column(CONTRACTION).unwrap_or_default();
        let of = |name, unit, value: &dyn Fn(usize) -> f64| Coordinate {
            name,
            unit,
            values: rows.iter().map(|row| value(*row)).collect(),
        };
        vec![
            of("direction", "", &|row| record.directions[row]),
            of("pressure", "Pa", &|row| pressure_pa[row]),
            of("contraction", "", &|row| contraction[row]),
            of("rate", "1/s", &|row| record.rates_per_s[row].abs()),
            of("pressure rate", "Pa/s", &|row| {
                let (from, to) = (row.saturating_sub(1), (row + 1).min(time_s.len() - 1));
                (pressure_pa[to] - pressure_pa[from]) / (time_s[to] - time_s[from])
            }),
            of("time", "s", &|row| time_s[row] - time_s[0]),
        ]
    }

    fn residuals(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        let record = &self.records[record];
        let mut rig = self.fitted(nominal, effects);
        match self.blocks[block] {
            GAS => gas_residuals(record, rig),
            FORCE => begun_best(&rig, |memory| force_residuals(record, rig.clone(), memory)),
            _ => {
                let balance = |memory| self.balances(record, rig.clone(), memory);
                let mut residuals = if self.blocks.contains(&FORCE) {
                    balance(None)?.0
                } else {
                    begun_best(&rig, balance)?
                };
                rig.load = Load::Prescribed;
                residuals.extend(record.stop_residuals(&rig)?);
                Some(residuals)
            }
        }
    }
}

/// Residuals, and how each state at the begin that is unknown changes them.
type Begun = (Residuals, Vec<Vec<f64>>);

/// Residuals of `rig` that began as fits best: with what a motion before may have left in effects
/// with a memory and in those that fade.
fn begun_best(rig: &Rig, begun: impl Fn(Option<f64>) -> Option<Begun>) -> Option<Residuals> {
    let mut effects = rig.effects.iter();
    let remembers = effects.any(|effect| match (effect.form.build)(&effect.values) {
        Term::Muscle(term) => term.remembers(),
        _ => false,
    });
    if !remembers {
        let (residuals, unknown) = begun(None)?;
        return Some(forgotten(residuals, &unknown, None));
    }
    // The share is sought as if all were in proportion to it, and no memory is beyond its ends.
    let ((out, mut unknown), (drawn_in, _)) = (begun(Some(-1.0))?, begun(Some(1.0))?);
    let half = |a: &[f64], b: &[f64], sign: f64| -> Vec<f64> {
        a.iter().zip(b).map(|(a, b)| 0.5 * (b + sign * a)).collect()
    };
    unknown.push(half(&out.values, &drawn_in.values, -1.0));
    let middle = Residuals {
        values: half(&out.values, &drawn_in.values, 1.0),
        slack: half(&out.slack, &drawn_in.slack, 1.0),
    };
    let share = likeliest(&middle, &unknown).iter().last()?.clamp(-1.0, 1.0);
    let (residuals, unknown) = begun(Some(share))?;
    Some(forgotten(residuals, &unknown, Some(share)))
}

/// Runs `rig` with a prescribed load on the inputs of `record`, beginning with such a memory: what
/// is read, and the true force.
fn run(rig: &Rig, record: &Record, memory: Option<f64>) -> Option<Vec<(Reading, f64)>> {
    run_on(rig, Inputs::new(rig, record).ok()?, record, memory)
}

fn run_on(
    rig: &Rig,
    inputs: Inputs,
    record: &Record,
    memory: Option<f64>,
) -> Option<Vec<(Reading, f64)>> {
    let mut plant = Plant::new(rig, inputs.simulated).ok()?;
    plant.memory = memory;
    let first = |name: &str| {
        record
            .column(name)
            .and_then(|c| c.iter().find(|v| !v.is_nan()))
    };
    let initial = Initial {
        time_s: record.time_s()[0],
        contraction: inputs.contraction(0)?,
        contraction_rate_per_s: 0.0,
        pressure: inputs
            .pressure(0)
            .or(first(PRESSURE_PA).map(|p| GaugePa(*p)))?,
        temperature_k: plant.ambient_temperature_k,
    };
    let rows = record.time_s().len();
    let mut out = Vec::with_capacity(rows);
    let start_s = record.time_s()[0];
    let visit = |row: usize, simulation: &crate::plant::simulation::Simulation| {
        out.push((simulation.read(), simulation.force_n()));
        let spent_s = record.time_s()[row] - start_s;
        let most = STEPS_PER_S * (1.0 + spent_s) + STEPS_PER_ROW * row as f64;
        if simulation.work().steps as f64 > most {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    };
    inputs.run(plant, &initial, TOLERANCE, rows, visit).ok()?;
    (out.len() == rows).then_some(out)
}

fn gas_residuals(record: &Prepared, mut rig: Rig) -> Option<Residuals> {
    let inert = matches!(rig.load, Load::Weight(_));
    rig.load = Load::Prescribed;
    let played = record.unplayed(play(&rig), record.gas.as_ref()?, None);
    let measured = played.column(PRESSURE_PA)?;
    let mut inputs = Inputs::new(&rig, &played).ok()?;
    inputs.inert = inert;
    let read = run_on(&rig, inputs, &played, None)?;
    let residual = |row: &usize| {
        let simulated_pa = record.pressure_span.read(read[*row].0.pressure.0);
        (simulated_pa - measured[*row]) / record.noise.pressure_pa
    };
    Some(Residuals::exact(
        record.gas_rows.iter().map(residual).collect(),
    ))
}

fn force_residuals(record: &Prepared, mut rig: Rig, memory: Option<f64>) -> Option<Begun> {
    rig.load = Load::Prescribed;
    let measured = record.measured.column(FORCE_N)?;
    let forces_n = record.forces_n(&rig, memory)?;
    // Where a force is clipped at its bottom the muscle hangs loose: Eq 1, which would push, is not
    // right because the sensor cannot tell.
    let most_n = record.force_span.most;
    let residual = |(row, per_noise): (&usize, &f64)| {
        let (least_n, most_n) = (forces_n[*row].0.min(most_n), forces_n[*row].1.min(most_n));
        let middle_n = 0.5 * (least_n + most_n);
        (
            (middle_n - measured[*row]) * per_noise,
            0.5 * (most_n - least_n) * per_noise,
        )
    };
    let rows = record.force_rows.iter().zip(&record.per_force_noise);
    let (values, slack) = rows.clone().map(residual).unzip();
    let unknown = record.fading_n(&rig)?.into_iter().map(|fading_n| {
        let rows = rows.clone();
        rows.map(|(row, per_noise)| fading_n[*row] * per_noise)
            .collect()
    });
    Some((Residuals { values, slack }, unknown.collect()))
}

/// The weight of `rig` with its effects, and how many states they have.
fn load_block(rig: &Rig, weight: Weight) -> (LoadBlock, usize) {
    let mut load = LoadBlock {
        weight,
        initial_length_m: rig.muscle.initial_length_m,
        terms: Terms::default(),
    };
    let mut states = 0;
    let effects = rig.effects.iter();
    for effect in effects.filter(|effect| effect.kind.block == "load") {
        if let Term::Load(term) = (effect.form.build)(&effect.values) {
            states += load.terms.push(term, states);
        }
    }
    (load, states)
}

impl MuscleModel {
    /// The least and the most force that works on the weight, row by row \[N\]: the measured one,
    /// where there is one.
    fn loading_n(
        &self,
        record: &Prepared,
        rig: &mut Rig,
        memory: Option<f64>,
    ) -> Option<Vec<(f64, f64)>> {
        if !self.blocks.contains(&FORCE) {
            rig.load = Load::Prescribed;
            return record.forces_n(rig, memory);
        }
        let sensors = Plant::new(rig, FORCE_ALONE).ok()?.sensors;
        let measured_n = record.measured.column(FORCE_N)?.iter();
        let truth = |(force_n, time_s): (&f64, &f64)| {
            let reading = Reading {
                pressure: GaugePa(0.0),
                contraction: 0.0,
                force_n: *force_n,
            };
            let true_n = sensors.truth(*time_s, reading).force_n;
            (true_n, true_n)
        };
        Some(
            measured_n
                .zip(record.measured.time_s())
                .map(truth)
                .collect(),
        )
    }

    /// How far the balance of forces on the weight lies outside what friction can take up.
    fn balances(&self, record: &Prepared, mut rig: Rig, memory: Option<f64>) -> Option<Begun> {
        let Load::Weight(weight) = rig.load else {
            return None;
        };
        let (load, states) = load_block(&rig, weight);
        let play = play(&rig);
        let played = record.unplayed(play, &record.measured, None);
        let forces_n = self.loading_n(record, &mut rig, memory)?;
        let contraction = played.column(CONTRACTION)?;
        let time_s = record.measured.time_s();
        let mut along = Along::new(states);
        let rows: Vec<[f64; 3]> = (0..time_s.len())
            .map(|row| {
                let direction = record.directions[row];
                let at = LoadPoint {
                    time_s: time_s[row],
                    contraction: contraction[row],
                    contraction_rate_per_s: record.rates_per_s[row],
                    direction,
                    initial_length_m: load.initial_length_m,
                };
                let place = record.path[row] + play * record.sides[row];
                let (weight, lifting_n, doubt_n) = along.constants(&load, &at, place);
                let (middle_n, reach_n) = if direction == 0.0 {
                    (0.0, weight.static_friction_n)
                } else {
                    (direction * weight.coulomb_friction_n, 0.0)
                };
                let weight_n = weight.mass_kg * GRAVITY_M_PER_S2;
                let (least_n, most_n) = forces_n[row];
                [
                    0.5 * (least_n + most_n) + lifting_n - weight_n - middle_n,
                    reach_n + doubt_n + 0.5 * (most_n - least_n),
                    weight.mass_kg,
                ]
            })
            .collect();
        // With hardly a weight the balance holds for any muscle that is slack.
        let least_kg = LEAST_SHARE_OF_MASS * load.weight.mass_kg;
        if rows.iter().any(|row| row[2] < least_kg) {
            return None;
        }
        let residuals = record.places.iter().map(|place| {
            let (mut balance_n, mut reach_n, mut mass_kg) = (0.0, 0.0, 0.0);
            let kernel = &place.kernel;
            for (weight, row) in kernel.value.iter().zip(&rows[kernel.rows.clone()]) {
                balance_n += weight * row[0];
                reach_n += weight * row[1];
                mass_kg += weight * row[2];
            }
            balance_n -= mass_kg * load.initial_length_m * kernel.second(contraction)
                + load.weight.viscous_damping_ns_per_m
                    * load.initial_length_m
                    * kernel.first(contraction);
            (balance_n * place.per_noise, reach_n * place.per_noise)
        });
        let (values, slack) = residuals.unzip();
        // A measured force has them in it.
        let fading = if self.blocks.contains(&FORCE) {
            Vec::new()
        } else {
            record.fading_n(&rig)?
        };
        let unknown = fading.into_iter().map(|fading_n| {
            let places = record.places.iter();
            places
                .map(|place| place.kernel.value(&fading_n) * place.per_noise)
                .collect()
        });
        Some((Residuals { values, slack }, unknown.collect()))
    }
}

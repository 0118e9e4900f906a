//! A record made ready: its noise, its motion, and where its force and balance are looked at.

use super::begin::KeptForces;
use super::kernel::{KERNEL_REACH, Kernel, norm};
use super::play::{bridged, contacts, dips, reaches};
use super::smoothed::{smoothed, without_short_ways};
use super::thinned::{CHANGE_NOISES, gas_told, period_s, thinned};
use crate::error::BadInput;
use crate::record::check::{Check, Finding, Signal, check};
use crate::record::{
    CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA, VALVE_OPEN,
};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use muscle_plant::nominal::{Gas, Load, Weight};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use std::ops::Range;
use std::sync::OnceLock;

/// Columns that tell of the gas.
const OF_GAS: [&str; 5] = [
    PRESSURE_REF_PA,
    PRESSURE_PA,
    CONTRACTION,
    SUPPLY_PA,
    VALVE_OPEN,
];
/// Width (standard deviation) of the smooth kernel \[s\]: below the periods of weight on muscle,
/// and at least the rows' distance: then a swing of up to a third of the rows' rate has its
/// curvature to 1 %, to which its mirror above half of that rate adds.
const KERNEL_S: f64 = 0.04;
/// The same in a fall onto the stop, which takes a tenth of a second \[s\].
const FALL_KERNEL_S: f64 = 0.01;
/// Residuals through a kernel stand so many widths apart: neighbours hardly share noise.
const SPACING: f64 = 2.5;
/// The begin of a record that is not compared, as the gas may not have been at rest \[s\].
const SKIP_S: f64 = 0.6;
/// Relative standard error of the noise's variance as one sample tells it, by simulation of white
/// noise, and by how many errors two records may differ that have the same noise.
const NOISE_ERROR: f64 = 4.1;
const POOLED_ERRORS: f64 = 3.0;
/// A speed is one when it is so many of its standard errors.
const SPEED_ERRORS: f64 = 5.0;
/// A way back of less than so many times the noise is none: from a single value that is off by
/// three, as one in 370 is, to smooth ones that are off by one to the other side.
const SHORT_NOISES: f64 = 4.0;
/// So near to a change of direction the weight may still be stuck, or be so already \[s\].
const TURN_S: f64 = 0.03;
/// So near to its lowest reading the weight may rest on the stop, which holds it from below \[-\].
const STOP_REACH: f64 = 5e-3;
/// It surely rests there where the muscle pulls less than this share of the weight, and it has not
/// moved for so long before and after \[s\].
const STOP_SHARE: f64 = 0.5;
const STOP_REST_S: f64 = 0.3;
/// So long after a landing on the stop the gas is not compared \[s\]: between two samples the
/// contraction is not known there.
const LANDING_S: f64 = 0.1;
/// So long after a cock is to be opened the gas is not compared \[s\]: a hand may be late.
const OPENING_S: f64 = 2.0;
/// Speed of a landing that matters \[1/s\].
const LANDING_PER_S: f64 = 0.05;
/// Force that no bench of this kind resolves, so no residual is judged finer \[N\].
const FORCE_FLOOR_N: f64 = 0.1;

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
    /// That of sensors whose records are `checked`: a sensor has the same noise in each, and what a
    /// record shows beyond it is motion that its samples do not resolve. The least alone would be
    /// too small by what such an estimate is off.
    fn found(checked: &[Check]) -> Noise {
        let of = |name: &str| {
            let signals = checked.iter().filter_map(|checked| checked.signal(name));
            let mut found: Vec<(f64, f64)> = signals
                .filter(|signal| signal.noise > 0.0)
                .map(|signal| (signal.noise.powi(2), signal.samples as f64))
                .collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut found = found.into_iter();
            let (mut pooled, mut count) = found.next().unwrap_or((0.0, 1.0));
            for (variance, samples) in found {
                let error = NOISE_ERROR * (1.0 / samples + 1.0 / count).sqrt();
                if variance <= pooled * (1.0 + POOLED_ERRORS * error) {
                    pooled = (count * pooled + samples * variance) / (count + samples);
                    count += samples;
                }
            }
            pooled.sqrt()
        };
        Noise {
            pressure_pa: of(PRESSURE_PA).max(1.0),
            contraction: of(CONTRACTION).max(1e-7),
            force_n: of(FORCE_N).max(1e-3),
        }
    }

    /// That of the signal in a column.
    pub fn of(&self, signal: &str) -> f64 {
        match signal {
            PRESSURE_PA => self.pressure_pa,
            CONTRACTION => self.contraction,
            _ => self.force_n,
        }
    }
}

/// What all records of a rig have in common.
struct Common<'a> {
    rig: &'a Rig,
    noise: Noise,
    /// What the force is off from run to run \[N\]; 0 where that is not known.
    repeatability_n: f64,
    /// All records have the muscle's force as a sensor reads it.
    force_read: bool,
    /// Time between rows that are compared \[s\].
    period_s: f64,
}

/// One place where the balance of forces is looked at.
pub(super) struct Place {
    pub(super) kernel: Kernel,
    /// Slope of the nominal muscle's force by pressure \[m²\].
    pub(super) per_pressure_m2: f64,
    /// One over the standard deviation of the nominal balance's noise \[1/N\].
    pub(super) per_noise: f64,
    /// How far the mean pressure may be from that of straight lines between the rows \[Pa\].
    pub(super) pressure_doubt_pa: f64,
    /// How much curvature a dip makes at most, per way that the muscle goes back in it \[1/s²\].
    pub(super) dip_per_s2: f64,
    /// How much of a jump of friction at most is in the acceleration and not in the forces, or the
    /// other way round; 0 where the weight surely moves one way, or rests.
    pub(super) jump_share: f64,
}

/// The least and the most that a sensor can read, as far as a record shows it by being clipped.
#[derive(Clone, Copy)]
pub(super) struct Span {
    pub(super) least: f64,
    pub(super) most: f64,
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
    pub(super) fn read(self, value: f64) -> f64 {
        value.clamp(self.least, self.most)
    }

    /// It reads its bound.
    pub(super) fn clips(self, read: f64) -> bool {
        read <= self.least || read >= self.most
    }
}

/// A record made ready.
pub(super) struct Prepared {
    /// With the reference and a smoothed contraction, for the gas; without, for force and load.
    pub(super) gas: Option<Record>,
    pub(super) measured: Record,
    /// As `measured`, with pressure and contraction smoothed, and the contraction without ways back
    /// that noise makes: inputs of the muscle's force and of the load's states. Of such ways a
    /// Bouc–Wen hysteresis would forget a third of its force in a second at rest.
    pub(super) smooth: Record,
    /// Of each row: the pressure with less noise \[Pa\], where it is smooth.
    pub(super) smooth_pressure_pa: Vec<f64>,
    /// Rows of `gas` from one of which to the next it is simulated; none without it.
    pub(super) gas_told: Vec<usize>,
    pub(super) noise: Noise,
    pub(super) places: Vec<Place>,
    /// Rows in which the weight rests on its stop, as far apart as the places.
    pub(super) stops: Vec<usize>,
    /// Of each row: smoothed ε̇ \[1/s\]; and +1 or −1 where the weight surely moves, else 0.
    pub(super) rates_per_s: Vec<f64>,
    pub(super) directions: Vec<f64>,
    /// Of each row: on which side of a play the motion has left the encoder, from −1 to 1; and
    /// whether the muscle surely takes the encoder along, or may have gone back and come again.
    pub(super) sides: Vec<f64>,
    pub(super) in_contact: Vec<bool>,
    dips: Vec<bool>,
    /// Rows in which pressure and force are compared.
    pub(super) gas_rows: Vec<usize>,
    pub(super) force_rows: Vec<usize>,
    /// Of each row that is compared: one over the standard deviation of the force's noise \[1/N\].
    pub(super) per_force_noise: Vec<f64>,
    /// What the force is off from run to run \[N\]; 0 where that is not known.
    repeatability_n: f64,
    /// The balance takes the force as it is read.
    pub(super) force_read: bool,
    /// What the sensors of pressure \[Pa\] and force \[N\] can read at all.
    pub(super) pressure_span: Span,
    pub(super) force_span: Span,
    pub(super) contraction_moves: bool,
    /// Of each row: by how much the mean pressure about it is above that of a smooth one through
    /// the rows \[Pa\]; empty where that is not known.
    pub(super) between_pa: Vec<f64>,
    /// Of each row: by how much more that is if the gas has missed readings from the begin of each
    /// interval on, by one standard deviation of when it has \[Pa\]; empty where that is not known.
    pub(super) missed_pa: Vec<f64>,
    /// Of each row: how far the gas may be off for what the contraction does between the rows
    /// \[Pa\]; empty where that is not known.
    pub(super) gas_doubts_pa: Vec<f64>,
    /// Its effects are settled as it begins.
    pub(super) settled: bool,
    pub(super) zeros: Zeros,
    pub(super) kept_forces: KeptForces,
    /// What is doubtful about it.
    pub(super) warnings: Vec<String>,
}

/// How what a record has of its own changes residuals, each once it is asked for.
#[derive(Default)]
pub(super) struct Zeros {
    pub(super) of_gas: OnceLock<Vec<Vec<f64>>>,
    pub(super) of_force: OnceLock<Vec<Vec<f64>>>,
    pub(super) of_balances: OnceLock<Vec<Vec<f64>>>,
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

/// When a cock is opened.
fn openings_s(record: &Record) -> Vec<f64> {
    let shut = record.shut();
    let opens = (1..shut.len()).filter(|row| shut[row - 1] && !shut[*row]);
    opens.map(|row| record.time_s()[row]).collect()
}

/// Whether the pressure of a weight's muscle is at rest as `record` begins. A bench is: what its
/// states would have had to be cannot be told from its zeros.
fn begins_at_rest(rig: &Rig, record: &Record, noise: &Noise) -> bool {
    let time_s = record.time_s();
    let begin = time_s.partition_point(|t| *t < time_s[0] + SKIP_S);
    let pressure_pa = record.column(PRESSURE_PA).unwrap_or_default();
    let present = pressure_pa.iter().take(begin).filter(|p| !p.is_nan());
    let most = present.clone().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = present.copied().fold(f64::INFINITY, f64::min);
    // Noise goes either way.
    rig.nominal.load == Load::Prescribed || most - least <= 2.0 * CHANGE_NOISES * noise.pressure_pa
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

/// Takes out of `measured` the pressures that no gas has, as a sensor at the end of a ringing tube
/// may read them: they are not the muscle's. The rows.
pub(super) fn without_vacuum(rig: &Rig, measured: &mut Record) -> Vec<usize> {
    let gas = rig.nominal.gas.unwrap_or(Gas::STANDARD);
    let read_pa = measured.column(PRESSURE_PA).unwrap_or_default();
    let impossible = |pa: f64| GaugePa(pa).to_absolute(gas.atmospheric_pressure).0 <= 0.0;
    let rows = (0..read_pa.len()).filter(|row| impossible(read_pa[*row]));
    let rows: Vec<usize> = rows.collect();
    if !rows.is_empty() {
        let mut pressure_pa = read_pa.to_vec();
        for row in &rows {
            pressure_pa[*row] = f64::NAN;
        }
        measured.set(PRESSURE_PA, pressure_pa);
    }
    rows
}

/// What is said of rows that were taken out of `record`, if there are such.
fn left_out(record: &Record, rows: &[usize]) -> Option<String> {
    let first_s = record.time_s()[*rows.first()?];
    Some(format!(
        "`{PRESSURE_PA}` is below vacuum in {} rows, the first at {first_s} s: muscle and load are \
         not judged there",
        rows.len()
    ))
}

impl Prepared {
    pub(super) fn all<'a>(
        rig: &Rig,
        records: impl Iterator<Item = &'a Record> + Clone,
        repeatability_n: Option<f64>,
    ) -> Result<Vec<Prepared>, BadInput> {
        let force_read = records
            .clone()
            .all(|record| record.column(FORCE_N).is_some());
        let mut checks = Vec::new();
        for record in records.clone() {
            let checked = check(record);
            checked.refuse(record)?;
            checks.push(checked);
        }
        let time_s = records.clone().map(Record::time_s);
        let together_s = time_s.map(|time_s| time_s[time_s.len() - 1] - time_s[0]);
        let common = Common {
            rig,
            period_s: period_s(together_s.sum()),
            noise: Noise::found(&checks),
            repeatability_n: repeatability_n.unwrap_or(0.0),
            force_read,
        };
        let mut prepared = records
            .zip(&checks)
            .map(|(record, checked)| Prepared::new(&common, record, checked))
            .collect::<Result<Vec<_>, _>>()?;
        // Who does not wait before one record does not before the others; some may begin in a hold.
        let settled = prepared.iter().all(|record| record.settled);
        for record in &mut prepared {
            record.settled = settled;
        }
        Ok(prepared)
    }

    fn new(common: &Common, record: &Record, checked: &Check) -> Result<Prepared, BadInput> {
        let Common { rig, noise, .. } = *common;
        let warnings = checked.warnings.iter().map(ToString::to_string);
        let bench = rig.nominal.load == Load::Prescribed;
        let record = &thinned(record, &noise, common.period_s, bench);
        let contraction = record.require(CONTRACTION)?;
        let mut measured = with_columns(record, &[PRESSURE_PA, CONTRACTION, FORCE_N]);
        let cut = without_vacuum(rig, &mut measured);
        let warnings = warnings.chain(left_out(record, &cut)).collect();
        let mut prepared = Prepared {
            gas: record
                .column(PRESSURE_REF_PA)
                .is_some()
                .then(|| with_columns(record, &OF_GAS)),
            smooth: measured.clone(),
            measured,
            smooth_pressure_pa: Vec::new(),
            gas_told: Vec::new(),
            noise,
            places: Vec::new(),
            stops: Vec::new(),
            rates_per_s: vec![0.0; contraction.len()],
            directions: vec![0.0; contraction.len()],
            sides: vec![0.0; contraction.len()],
            in_contact: vec![true; contraction.len()],
            dips: vec![false; contraction.len()],
            gas_rows: Vec::new(),
            force_rows: Vec::new(),
            per_force_noise: Vec::new(),
            repeatability_n: 0.0,
            force_read: common.force_read,
            pressure_span: Span::of(checked, PRESSURE_PA),
            force_span: Span::of(checked, FORCE_N),
            contraction_moves: checked.signal(CONTRACTION).is_some_and(Signal::moves),
            between_pa: Vec::new(),
            missed_pa: Vec::new(),
            gas_doubts_pa: Vec::new(),
            settled: begins_at_rest(rig, record, &noise),
            zeros: Zeros::default(),
            kept_forces: KeptForces::default(),
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
        prepared.skip_gas(time_s, &openings_s(record), 0.0..OPENING_S);
        prepared.force_rows = rows(FORCE_N);
        prepared.weigh_forces(rig, record, common.repeatability_n);
        let Load::Weight(weight) = rig.nominal.load else {
            return Ok(prepared);
        };
        let landings_s = landings_s(time_s, contraction, &prepared.rates_per_s);
        prepared.skip_gas(time_s, &landings_s, -0.02..LANDING_S);
        prepared.directions = prepared.sure_directions();
        let wide_s = KERNEL_S.max(checked.sampling.period_s);
        prepared.places(rig, &weight, wide_s);
        prepared.stops(rig, &weight);
        Ok(prepared)
    }

    /// The directions of rows all of whose neighbourhood goes one way, else 0.
    fn sure_directions(&self) -> Vec<f64> {
        let time_s = self.measured.time_s();
        let sure = |row: usize| {
            let from = time_s.partition_point(|t| *t < time_s[row] - TURN_S);
            let to = time_s.partition_point(|t| *t <= time_s[row] + TURN_S);
            let own = self.directions[row];
            let agree = self.directions[from..to].iter().all(|d| *d == own);
            if agree { own } else { 0.0 }
        };
        (0..time_s.len()).map(sure).collect()
    }

    /// Has the gas not compared within `span_s` about some times.
    fn skip_gas(&mut self, time_s: &[f64], about_s: &[f64], span_s: Range<f64>) {
        self.gas_rows.retain(|row| {
            let mut about = about_s.iter();
            !about.any(|s| span_s.contains(&(time_s[*row] - s)))
        });
    }

    /// How well the force is known in each row that is compared: by its noise and the pressure's.
    fn weigh_forces(&mut self, rig: &Rig, record: &Record, repeatability_n: f64) {
        let contraction = record.column(CONTRACTION).unwrap_or_default();
        self.force_rows.retain(|row| !contraction[*row].is_nan());
        let pressures_pa = [record, &self.measured].map(|record| record.column(PRESSURE_PA));
        if let [Some(read_pa), Some(pressure_pa)] = pressures_pa {
            let span = self.pressure_span;
            // The muscle's own pressure is not known there; in a gap it is taken to be straight.
            let left_out = |row: usize| pressure_pa[row].is_nan() && !read_pa[row].is_nan();
            let known = |row: &usize| !span.clips(read_pa[*row]) && !left_out(*row);
            self.force_rows.retain(known);
        }
        self.repeatability_n = repeatability_n;
        let per_noise = |row: &usize| {
            let per_pressure_m2 = rig.nominal.muscle.force_per_pressure_m2(contraction[*row]);
            self.force_noise_n(per_pressure_m2).recip()
        };
        self.per_force_noise = self.force_rows.iter().map(per_noise).collect();
    }

    /// Standard deviation of how far the force of a muscle whose force depends on pressure by this
    /// slope is from what is read \[N\].
    pub(super) fn force_noise_n(&self, per_pressure_m2: f64) -> f64 {
        // Not `hypot`, which guards against overflow and takes ten times as long.
        let parts_n = [
            per_pressure_m2 * self.noise.pressure_pa,
            self.noise.force_n,
            FORCE_FLOOR_N.max(self.repeatability_n),
        ];
        parts_n.map(|n| n * n).iter().sum::<f64>().sqrt()
    }

    /// Rates, directions, on which side of a play the encoder is, what drives the gas.
    fn motion(&mut self, record: &Record, contraction: &[f64]) {
        let reaches = reaches(record.time_s());
        let contacts = contacts(contraction, self.noise.contraction, &reaches);
        for (row, contact) in contacts.iter().enumerate() {
            let time_s = record.time_s()[row];
            let kernel = Kernel::at(record.time_s(), time_s, 0.5 * KERNEL_S);
            let rate_per_s = kernel.first(contraction);
            // Rows that are farther apart than the kernel reaches show none.
            if !rate_per_s.is_finite() {
                continue;
            }
            let error = self.noise.contraction * norm(&kernel.first);
            self.rates_per_s[row] = rate_per_s;
            // In a short rest the kernel sees the motion before and after.
            let moves = *contact == rate_per_s.signum();
            if moves && rate_per_s.abs() > SPEED_ERRORS * error {
                self.directions[row] = rate_per_s.signum();
            }
        }
        // Between two contacts on one side the muscle may have been at the other.
        self.in_contact = contacts.iter().map(|way| *way != 0.0).collect();
        self.dips = dips(record.time_s(), &contacts);
        self.sides = bridged(record.time_s(), &contacts, record.column(PRESSURE_PA));
        let smooth = smoothed(record.time_s(), contraction, self.noise.contraction);
        let least = SHORT_NOISES * self.noise.contraction;
        self.smooth
            .set(CONTRACTION, without_short_ways(&smooth, least));
        let pressure_pa = record.column(PRESSURE_PA).unwrap_or_default();
        self.smooth_pressure_pa = smoothed(record.time_s(), pressure_pa, self.noise.pressure_pa);
        // What is no pressure of the gas stays out.
        if let Some(pressure_pa) = self.measured.column(PRESSURE_PA) {
            let smooth = smoothed(record.time_s(), pressure_pa, self.noise.pressure_pa);
            self.smooth.set(PRESSURE_PA, smooth);
        }
        if let Some(gas) = &mut self.gas {
            gas.set(CONTRACTION, smooth);
            self.gas_told = gas_told(gas, &self.smooth_pressure_pa, &self.noise);
        }
    }

    /// Where the weight rests on its stop.
    fn stops(&mut self, rig: &Rig, weight: &Weight) {
        let time_s = self.measured.time_s();
        let Some(pressure_pa) = self.measured.column(PRESSURE_PA) else {
            return;
        };
        let most_n = STOP_SHARE * weight.mass_kg * GRAVITY_M_PER_S2;
        let loose =
            |row: usize| rig.nominal.muscle.force_n(0.0, GaugePa(pressure_pa[row])) < most_n;
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

    /// Where the balance of the load is looked at, through kernels `wide_s` wide but in falls: away
    /// from ends, gaps and the stop.
    fn places(&mut self, rig: &Rig, weight: &Weight, wide_s: f64) {
        let time_s = self.measured.time_s();
        let (Some(contraction), Some(pressure_pa)) = (
            self.measured.column(CONTRACTION),
            self.measured.column(PRESSURE_PA),
        ) else {
            return;
        };
        let present = |kernel: &Kernel| {
            let mut rows = kernel.rows.clone();
            // Beside a gap in time what is smoothed is not what is sloped.
            let whole = rows.len() >= 5 && kernel.value.iter().all(|weight| *weight >= 0.0);
            whole && rows.all(|r| !contraction[r].is_nan() && !pressure_pa[r].is_nan())
        };
        // An encoder with an offset or with play reads something else than 0 on the stop.
        let lowest = contraction.iter().copied().fold(f64::INFINITY, f64::min);
        let lifted = |kernel: &Kernel| {
            let mut rows = kernel.rows.clone();
            rows.all(|r| contraction[r] > lowest + STOP_REACH)
        };
        // Whatever it reads there, it does not fall on.
        let nearest = &reaches(time_s)[..1];
        let ways = contacts(contraction, self.noise.contraction, nearest);
        let falls = |kernel: &Kernel| kernel.rows.clone().all(|r| ways[r] < 0.0);
        let (first_s, last_s) = (time_s[0], time_s[time_s.len() - 1]);
        let whole_s = last_s - first_s - SKIP_S - KERNEL_REACH * wide_s;
        let kernels = |width_s: f64| {
            let spacing_s = SPACING * width_s;
            let count = (whole_s / spacing_s).max(0.0) as usize;
            let times_s = (0..count).map(move |n| first_s + SKIP_S + n as f64 * spacing_s);
            times_s.map(move |at_s| Kernel::at(time_s, at_s, width_s))
        };
        let wide = kernels(wide_s).filter(|kernel| present(kernel) && lifted(kernel));
        // A fall onto the stop leaves no room for the wide kernel; there alone would a muscle have
        // to push.
        let narrow = kernels(FALL_KERNEL_S).filter(|kernel| {
            let about = || Kernel::at(time_s, time_s[kernel.middle()], wide_s);
            present(kernel) && falls(kernel) && !lifted(&about())
        });
        let mut kernels: Vec<Kernel> = wide.chain(narrow).collect();
        kernels.sort_by_key(Kernel::middle);
        let places = kernels.into_iter().map(|kernel| {
            let muscle = &rig.nominal.muscle;
            let place = Place {
                per_pressure_m2: muscle.force_per_pressure_m2(contraction[kernel.middle()]),
                per_noise: 0.0,
                pressure_doubt_pa: self.bent_pa(&kernel),
                dip_per_s2: self.dip_per_s2(&kernel),
                jump_share: self.jump_share(&kernel),
                kernel,
            };
            self.weighed(rig, weight, place)
        });
        self.places = places.collect();
    }

    /// How much curvature dips make at most through `kernel`, per way that the muscle goes back in
    /// them: it may be back by any share of that \[1/s²\].
    fn dip_per_s2(&self, kernel: &Kernel) -> f64 {
        let dips = &self.dips[kernel.rows.clone()];
        let seconds = kernel.second.iter().zip(dips).filter(|(_, dips)| **dips);
        let [up, down] = [1.0, -1.0].map(|sign: f64| {
            let seconds = seconds.clone().map(|(second, _)| sign * second);
            seconds.filter(|second| *second > 0.0).sum::<f64>()
        });
        up.max(down)
    }

    /// See [`Place::jump_share`].
    fn jump_share(&self, kernel: &Kernel) -> f64 {
        let directions = &self.directions;
        if directions[kernel.rows.clone()]
            .iter()
            .all(|own| *own == 0.0)
        {
            return 0.0;
        }
        kernel.jump_share(self.measured.time_s(), |row| {
            directions[row] == 0.0 || directions[row] != directions[row + 1]
        })
    }

    /// `place` with how well its nominal balance is known.
    pub(super) fn weighed(&self, rig: &Rig, weight: &Weight, place: Place) -> Place {
        let per_pressure_m2 = if self.force_read {
            0.0
        } else {
            place.per_pressure_m2
        };
        let noise_n = self.balance_noise_n(rig, weight, &place, per_pressure_m2);
        Place {
            per_noise: noise_n.recip(),
            ..place
        }
    }

    /// Standard deviation of the noise of the balance of forces at `place` \[N\]: with the muscle's
    /// force as it is read, or as pressure and contraction make it.
    pub(super) fn balance_noise_n(
        &self,
        rig: &Rig,
        weight: &Weight,
        place: &Place,
        per_pressure_m2: f64,
    ) -> f64 {
        let column = |name| self.measured.column(name).unwrap_or_default();
        let (contraction, pressure_pa) = (column(CONTRACTION), column(PRESSURE_PA));
        let kernel = &place.kernel;
        let middle = kernel.middle();
        let (at, pressure) = (contraction[middle], GaugePa(pressure_pa[middle]));
        let muscle = &rig.nominal.muscle;
        let (force_noise_n, stiffness_n) = if self.force_read {
            (self.noise.force_n, 0.0)
        } else {
            let noise_n = per_pressure_m2 * self.noise.pressure_pa;
            (noise_n, muscle.stiffness_n(at, pressure))
        };
        let length_m = muscle.initial_length_m;
        let by_contraction = (0..kernel.rows.len()).map(|i| {
            stiffness_n * kernel.value[i]
                + weight.mass_kg * length_m * kernel.second[i]
                + weight.viscous_damping_ns_per_m * length_m * kernel.first[i]
        });
        let from_contraction_n =
            self.noise.contraction * by_contraction.map(|n| n * n).sum::<f64>().sqrt();
        let per_pressure_m2 = if self.force_read {
            muscle.force_per_pressure_m2(at)
        } else {
            per_pressure_m2
        };
        (force_noise_n * norm(&kernel.value))
            .hypot(from_contraction_n)
            .hypot(per_pressure_m2 * place.pressure_doubt_pa)
            .hypot(FORCE_FLOOR_N)
    }

    /// How far the mean pressure is at most from that of straight lines between samples \[Pa\].
    fn bent_pa(&self, kernel: &Kernel) -> f64 {
        let pressure_pa = self.measured.column(PRESSURE_PA).unwrap_or_default();
        let bent = |row: usize| {
            let at = |row: usize| pressure_pa[row.min(pressure_pa.len() - 1)];
            let second = at(row + 1) - 2.0 * at(row) + at(row.saturating_sub(1));
            (second.abs() - 3.0 * self.noise.pressure_pa).max(0.0) / 12.0
        };
        let weights = kernel.value.iter().zip(kernel.rows.clone());
        weights.map(|(weight, row)| weight * bent(row)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::SeedableRng;

    /// Rows of 10 ms, with pressure and contraction by the time, and some noise.
    fn record(pressure_pa: impl Fn(f64) -> f64, contraction: impl Fn(f64) -> f64) -> Record {
        let time_s: Vec<f64> = (0..600).map(|row| 0.01 * f64::from(row)).collect();
        let mut record = Record::new(time_s.clone());
        record.set(
            PRESSURE_PA,
            time_s
                .iter()
                .map(|t| pressure_pa(*t) + 300.0 * (9.1e3 * t).sin())
                .collect(),
        );
        record.set(
            CONTRACTION,
            time_s
                .iter()
                .map(|t| contraction(*t) + 3e-5 * (3.7e3 * t).sin())
                .collect(),
        );
        record
    }

    /// The same noise in each of four records, of which the least is too small, and a fifth record
    /// that moves faster than its samples tell.
    #[test]
    fn the_noise_of_a_sensor_is_that_of_its_records_together() {
        let white = |seed: u64, fast: f64| {
            let mut rng = Pcg64::seed_from_u64(seed);
            let normal = Normal::new(0.0, 300.0).expect("a deviation");
            let mut record = Record::new((0..600).map(|row| 0.01 * f64::from(row)).collect());
            let pressure_pa = (0..600).map(|row| {
                let moved = 1e4 * (0.01 * f64::from(row)).sin() + fast * f64::from(row).sin();
                2e5 + moved + normal.sample(&mut rng)
            });
            record.set(PRESSURE_PA, pressure_pa.collect());
            check(&record)
        };
        let sets = (0..40).map(|set| {
            let mut checks: Vec<Check> = (0..4).map(|n| white(4 * set + n, 0.0)).collect();
            checks.push(white(1000 + set, 3e3));
            let noise = |own: &Check| own.signal(PRESSURE_PA).map_or(0.0, |own| own.noise);
            let least = checks.iter().map(noise).fold(f64::INFINITY, f64::min);
            [Noise::found(&checks).pressure_pa / 300.0, least / 300.0]
        });
        let sums = sets.fold([0.0, 0.0], |sums, set| [sums[0] + set[0], sums[1] + set[1]]);
        let [found, least] = sums.map(|sum| sum / 40.0);
        // Of one record 8 %, of four in the mean of forty sets 0.7 %, and its own bias of 3 %.
        assert!((found - 1.0).abs() < 0.05, "{found}");
        assert!(least < 0.95, "{least}");
    }

    #[test]
    fn a_weight_begins_at_rest_where_its_pressure_does_and_a_bench_always() {
        let lifts = |t: f64| 0.05 + 0.04 * (t - 1.0).clamp(0.0, 4.0) / 4.0;
        let held = record(|t| 2e5 + 5e4 * (t - 1.0).max(0.0), lifts);
        let moving = record(|t| 2e5 + 5e4 * t, lifts);
        let weight = Rig::reference();
        let mut bench = weight.clone();
        bench.nominal.load = Load::Prescribed;
        let settled = |rig: &Rig, records: &[&Record]| {
            let prepared = Prepared::all(rig, records.iter().copied(), None).expect("prepared");
            prepared.iter().all(|record| record.settled)
        };
        assert!(settled(&weight, &[&held]));
        assert!(!settled(&weight, &[&moving]));
        assert!(settled(&bench, &[&moving]));
        // One in motion tells that nobody waited.
        assert!(!settled(&weight, &[&held, &moving]));
    }

    /// A tube that rings reads −300 kPa: its rows are said and not judged, the others are.
    #[test]
    fn a_pressure_that_no_gas_has_is_none_of_the_muscles() {
        let rings = |t: f64| if (3.0..3.05).contains(&t) { -3e5 } else { 2e5 };
        let mut rung = record(rings, |_| 0.1);
        for (column, value) in [(FORCE_N, 100.0), (PRESSURE_REF_PA, 2e5)] {
            rung.set(column, vec![value; rung.time_s().len()]);
        }
        let prepared = Prepared::all(&Rig::reference(), [&rung].into_iter(), None);
        let prepared = &prepared.expect("prepared")[0];
        let said = "below vacuum in 5 rows, the first at 3 s";
        assert!(prepared.warnings.iter().any(|words| words.contains(said)));
        let judged = |row: &usize| !(300..305).contains(row);
        assert!(prepared.force_rows.iter().all(judged));
        assert!(prepared.force_rows.len() > 500);
        for of in [&prepared.measured, &prepared.smooth] {
            let pressure_pa = of.column(PRESSURE_PA).expect("a pressure");
            assert!(pressure_pa.iter().all(|pa| pa.is_nan() || *pa > -1e5));
        }
        let mut places = prepared.places.iter();
        assert!(places.all(|place| place.kernel.rows.clone().all(|row| judged(&row))));
    }

    /// A weight that swings at 3 Hz, in rows of 40 ms, moves one way for four of them: between its
    /// turns its friction is known.
    #[test]
    fn a_weight_s_direction_is_known_between_rows_that_are_far_apart() {
        let time_s: Vec<f64> = (0..500).map(|row| 0.04 * f64::from(row)).collect();
        let rate = |t: f64| (std::f64::consts::TAU * 3.0 * t).cos();
        let swing = |t: f64| (std::f64::consts::TAU * 3.0 * t).sin();
        let mut record = Record::new(time_s.clone());
        let pressure_pa = time_s.iter().map(|t| 2e5 + 300.0 * (9.1e3 * t).sin());
        record.set(PRESSURE_PA, pressure_pa.collect());
        // It rests at first, which tells the encoder's noise.
        let contraction = time_s.iter().map(|t| {
            let size = if *t < 10.0 { 0.0 } else { 0.02 };
            0.1 + size * swing(*t) + 3e-5 * (3.7e3 * t).sin()
        });
        record.set(CONTRACTION, contraction.collect());
        let prepared = Prepared::all(&Rig::reference(), [&record].into_iter(), None);
        let directions = &prepared.expect("prepared")[0].directions;
        let (mut known, mut within) = (0, 0);
        for row in 260..490 {
            let (own, way) = (directions[row], rate(time_s[row]).signum());
            assert!(own == 0.0 || own == way, "{} s", time_s[row]);
            known += u32::from(own != 0.0);
            let same = |other: usize| rate(time_s[other]).signum() == way;
            within += u32::from(same(row - 1) && same(row + 1));
        }
        // Where a row has no turn within its neighbours' times: two of four.
        assert!(known > 9 * within / 10, "{known} of {within}");
        assert!(within > 100);
    }

    /// 40 mm in a tenth of a second: the wide kernel has no room in it, and sees the stop.
    #[test]
    fn a_fall_onto_the_stop_is_seen_through_the_narrow_kernel() {
        let falls = |t: f64| (0.13 - 1.3 * (t - 3.0).max(0.0)).max(0.0);
        let fallen = record(|t| 2e5 - 8e5 * (t - 2.9).clamp(0.0, 0.2), falls);
        let prepared = Prepared::all(&Rig::reference(), [&fallen].into_iter(), None);
        let prepared = &prepared.expect("prepared")[0];
        let seen_s = |row: usize| prepared.measured.time_s()[row];
        let reach_s = |place: &Place| {
            let rows = &place.kernel.rows;
            seen_s(rows.end - 1) - seen_s(rows.start)
        };
        let narrow: Vec<f64> = prepared
            .places
            .iter()
            .filter(|place| reach_s(place) < 0.1)
            .map(|place| seen_s(place.kernel.middle()))
            .collect();
        assert!(!narrow.is_empty());
        assert!(narrow.iter().all(|s| (3.0..3.1).contains(s)), "{narrow:?}");
    }
}

//! The muscle rig as the engine sees it: its blocks on measured inputs, and their residuals.
//!
//! - *gas*: reference and measured contraction in, pressure simulated, against the measured one.
//! - *force* (with a force channel): measured pressure and contraction in, against measured force.
//! - *load*: the balance of forces on the weight. Acceleration and speed come from the measured
//!   contraction through a smooth kernel, which takes the derivatives; where the weight stands
//!   still, static friction may be anything up to its limit.

mod along;
mod begin;
mod between;
mod finer;
mod force;
mod kernel;
mod play;
mod prepared;
mod residuals;
mod smoothed;
mod thinned;

use crate::error::BadInput;
use crate::identify::repeats::force_repeatability_n;
use crate::identify::simulate::simulate;
use crate::record::{CONTRACTION, FORCE_N, PRESSURE_REF_PA, Record};
use crate::rig::{KEYS, Key, Rig, Tolerance};
use begin::{Begin, UNKNOWNS, without};
use force::{Force, ForceRange, remembers};
use model_discrepancy::engine::{Active, Candidate, Coordinate, Model, Near, Parameter};
use model_discrepancy::evidence::Blocks;
use model_discrepancy::least_squares::{Residuals, loss};
use model_discrepancy::rows::Timeline;
use muscle_plant::effects::{Catalogue, Effect, EffectKind, Equation, Quantity, Requirement};
use muscle_plant::nominal::Load;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
pub use prepared::Noise;
use prepared::Prepared;
use rayon::prelude::*;
use residuals::{balances, force_residuals, gas_residuals, measured_n};
use serde::Serialize;

/// Tolerance of free runs.
const FREE_RUN_TOLERANCE: f64 = 1e-4;
/// A free motion is as good as it can be when it is within so many times the noise: where a weight
/// sticks is decided by less.
const MOTION_NOISES: f64 = 5.0;
/// Stops of a record that are independent of each other.
const MOTION_STOPS: f64 = 8.0;
/// Share of a nominal value that is left at least.
const LEAST_SHARE: f64 = 0.05;
/// What the nominal model of a sound rig may leave: a share of the sensor's noise, and errors of
/// the interpolation between samples \[Pa\], \[N\], and as a share of the weight.
const BASE_NOISES: f64 = 0.3;
const BASE_PA: f64 = 10.0;
const BASE_N: f64 = 0.1;
const BASE_SHARE: f64 = 2.5e-3;

/// The nominal value that is refined on simulations.
const STATIC_FRICTION: (&str, &str) = ("load", "static_friction_n");
/// Steps to either side, and their sizes in standard deviations of the tolerance, in which it is
/// refined: first within three of the nominal value, then as fine as it is known.
const REFINING_REACH: i32 = 6;
const REFINING_STEPS: [f64; 2] = [0.5, 0.1];

pub(super) const GAS: &str = "gas";
pub(super) const FORCE: &str = "force";
pub(super) const LOAD: &str = "load";

/// A nominal value, calibrated within its tolerance.
#[derive(Clone, Debug, Serialize)]
pub struct Calibrated {
    /// `section.key`.
    pub key: String,
    /// As in the nominal rig, and as fitted.
    pub values: [f64; 2],
    /// By how many standard deviations of its tolerance it was moved.
    pub deviation: f64,
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

/// The nominal value that the refined one must not be below.
const COULOMB_FRICTION: (&str, &str) = ("load", "coulomb_friction_n");
/// Share of a value beyond its rounding errors.
const ROUNDING: f64 = 1e-12;

/// By which factor a nominal value moves with so many of its standard deviations: never through 0,
/// where a heat transfer or a friction would drive the plant.
fn moved_by(tolerance: &Tolerance, deviations: f64) -> f64 {
    (1.0 + tolerance.relative_sigma * deviations).max(LEAST_SHARE)
}

/// What is above 0 of a muscle.
type Positive = fn(&Rig) -> Vec<f64>;

/// Values of the muscle that may each be within their range and together be no muscle, and what
/// they must keep above 0: its pull at rest, its volumes.
const TOGETHER: [(&[&str], Positive); 2] = [
    (&["alpha_m2", "beta_m2"], |rig| {
        vec![rig.nominal.muscle.alpha_m2 + rig.nominal.muscle.beta_m2]
    }),
    (&["volume_d1_m3", "volume_d2_m3", "volume_d3_m3"], |rig| {
        rig.volumes_m3().map(|(_, volume_m3)| volume_m3).collect()
    }),
];
/// Halvings that find how far values may be moved, to a millionth.
const HALVINGS: u32 = 20;

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
fn blocks_of_effect(kind: &EffectKind) -> Vec<&'static str> {
    kind.equations
        .iter()
        .map(|equation| match equation {
            Equation::Gas => GAS,
            Equation::MuscleForce => FORCE,
            Equation::Load => LOAD,
        })
        .collect()
}

/// Whether records can show an effect at all: what they measure and move.
fn can_show(kind: &EffectKind, force_measured: bool, contraction_moves: bool) -> bool {
    kind.requires.iter().all(|requirement| match requirement {
        Requirement::MeasuredForce => force_measured,
        Requirement::Motion => contraction_moves,
        // How far the others matter, the fit shows.
        _ => true,
    })
}

/// Records made ready, with the pressure between their rows.
fn prepared<'a>(
    rig: &Rig,
    records: impl Iterator<Item = &'a Record> + Clone,
    repeatability_n: Option<f64>,
) -> Result<Vec<Prepared>, BadInput> {
    let mut prepared = Prepared::all(rig, records, repeatability_n)?;
    let tell = |record: &mut Prepared| between::tell(record, rig);
    prepared.par_iter_mut().for_each(tell);
    Ok(prepared)
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
        let bench = rig.nominal.load == Load::Prescribed && has(FORCE_N);
        let repeatability_n = force_repeatability_n(records().filter(|_| bench));
        let prepared = prepared(rig, records(), repeatability_n)?;
        let moves = prepared.iter().any(|record| record.contraction_moves);
        let mut blocks = Vec::new();
        if has(PRESSURE_REF_PA) && rig.nominal.valve.is_some() {
            blocks.push(GAS);
        }
        if has(FORCE_N) {
            blocks.push(FORCE);
        }
        if matches!(rig.nominal.load, Load::Weight(_)) {
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
        let kinds = rig.catalogue.kinds().filter(|kind| {
            !without.iter().any(|name| name == kind.name) && can_show(kind, has(FORCE_N), moves)
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
                    usual: p.typical,
                    log: p.log,
                    neutral: p.neutral,
                    ends: p.physical_bounds,
                })
                .collect(),
            blocks: places(&blocks_of_effect(kind)),
            form_doubt: kind.discrepancy_ratio,
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
    pub fn fitted<'a>(
        &self,
        nominal: &[f64],
        effects: impl IntoIterator<Item = &'a Active>,
    ) -> Rig {
        let mut rig = self.rig.clone();
        for (tolerance, deviation) in self.rig.tolerances.iter().zip(nominal) {
            if let Some(value) = rig.value_mut(&tolerance.section, &tolerance.key) {
                *value *= moved_by(tolerance, *deviation);
            }
        }
        for (candidate, values) in effects {
            let candidate = &self.candidates[*candidate];
            let kind = rig.catalogue.find(candidate.effect);
            if let Some((kind, form)) = kind.and_then(|k| Some((k, k.form(candidate.form)?))) {
                let values = values.clone();
                rig.effects.push(Effect { kind, form, values });
            }
        }
        rig
    }

    /// `nominal` with static friction refined on simulations of the fitted records: a dead zone
    /// that is too wide has no residuals, so that they hardly bound it from above, but where the
    /// weight stops in a simulation does.
    pub fn refined(&self, nominal: &[f64], effects: &[Active]) -> Vec<f64> {
        let mut refined = nominal.to_vec();
        let place = self.toleranced(STATIC_FRICTION);
        let load = self.blocks.iter().position(|block| *block == LOAD);
        let (Some(place), Some(load)) = (place, load) else {
            return refined;
        };
        let cost = |deviation: f64| {
            let mut nominal = nominal.to_vec();
            nominal[place] = deviation;
            if !self.above_coulomb(&nominal) {
                return None;
            }
            let of_record = |record| {
                let residuals = self.residuals(record, load, &nominal, effects)?.edged();
                let outside: f64 = residuals.outside().map(loss).sum();
                Some(outside + self.free_run(record, &nominal, effects)?)
            };
            let cost = (0..self.fitted).map(of_record).sum::<Option<f64>>()?;
            Some(0.5 * deviation * deviation + cost)
        };
        for (middle, step) in [(Some(0.0), REFINING_STEPS[0]), (None, REFINING_STEPS[1])] {
            let best = refined[place];
            let middle = middle.unwrap_or(best);
            let around = (-REFINING_REACH..=REFINING_REACH).map(f64::from);
            let mut deviations: Vec<f64> = around.map(|n| middle + n * step).collect();
            deviations.push(best);
            let costs = deviations.into_par_iter();
            let costs: Vec<(f64, f64)> = costs.filter_map(|at| Some((at, cost(at)?))).collect();
            let least = costs.iter().min_by(|a, b| a.1.total_cmp(&b.1));
            refined[place] = least.map_or(best, |(at, _)| *at);
        }
        refined
    }

    /// Whether the rig that `nominal` makes has a static friction not below the Coulomb friction.
    fn above_coulomb(&self, nominal: &[f64]) -> bool {
        match self.fitted(nominal, []).nominal.load {
            Load::Weight(weight) => weight.static_friction_n >= weight.coulomb_friction_n,
            Load::Prescribed => false,
        }
    }

    /// `nominal` with a static friction that is not below the Coulomb friction, or, if only that
    /// has a tolerance, a Coulomb friction that is not above the static one: each is fitted for
    /// itself, and a weight that breaks away below its Coulomb friction stops at once, without end.
    fn with_static_friction_above_coulomb(&self, mut nominal: Vec<f64>) -> Vec<f64> {
        let loads = [
            self.rig.nominal.load,
            self.fitted(&nominal, []).nominal.load,
        ];
        let [Load::Weight(from), Load::Weight(fitted)] = loads else {
            return nominal;
        };
        if fitted.static_friction_n >= fitted.coulomb_friction_n {
            return nominal;
        }
        let mut set = |place: usize, share: f64| {
            nominal[place] = (share - 1.0) / self.rig.tolerances[place].relative_sigma;
        };
        if let Some(place) = self.toleranced(STATIC_FRICTION) {
            let to_n = (1.0 + ROUNDING) * fitted.coulomb_friction_n;
            set(place, to_n / from.static_friction_n);
        } else if let Some(place) = self.toleranced(COULOMB_FRICTION) {
            let to_n = (1.0 - ROUNDING) * fitted.static_friction_n;
            set(place, to_n / from.coulomb_friction_n);
        }
        nominal
    }

    /// `nominal` of a rig that can be read: each value within the range of its key, and, where
    /// several together leave less than a twentieth of the nominal volume or of the pull at rest,
    /// these moved back toward the nominal rig. The fitted records may not reach there.
    pub fn readable(&self, mut nominal: Vec<f64>) -> Vec<f64> {
        let mut rig = self.rig.clone();
        for (tolerance, deviation) in self.rig.tolerances.iter().zip(&mut nominal) {
            let is_its = |key: &&Key| key.section == tolerance.section && key.name == tolerance.key;
            let key = KEYS.iter().find(is_its);
            if let Some((key, value)) = key.and_then(|key| Some((key, *(key.value)(&mut rig)?))) {
                let moved = value * moved_by(tolerance, *deviation);
                let within = moved.clamp(key.min, key.max);
                if within != moved {
                    *deviation = (within / value - 1.0) / tolerance.relative_sigma;
                }
            }
        }
        for (keys, positive) in TOGETHER {
            let least = positive(&self.rig);
            let moved = |share: f64| -> Vec<f64> {
                let values = self.rig.tolerances.iter().zip(&nominal);
                let values = values.map(|(tolerance, deviation)| {
                    let is_one =
                        tolerance.section == "muscle" && keys.contains(&&tolerance.key[..]);
                    if is_one {
                        share * deviation
                    } else {
                        *deviation
                    }
                });
                values.collect()
            };
            let is_muscle = |share: f64| {
                let left = positive(&self.fitted(&moved(share), []));
                let mut both = left.iter().zip(&least);
                both.all(|(left, least)| *left >= LEAST_SHARE * least)
            };
            if !is_muscle(1.0) {
                let (mut share, mut beyond) = (0.0, 1.0);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (share + beyond);
                    if is_muscle(middle) {
                        share = middle;
                    } else {
                        beyond = middle;
                    }
                }
                nominal = moved(share);
            }
        }
        self.with_static_friction_above_coulomb(nominal)
    }

    /// Where a nominal value stands among those with a tolerance.
    fn toleranced(&self, value: (&str, &str)) -> Option<usize> {
        let mut tolerances = self.rig.tolerances.iter();
        tolerances.position(|own| (&own.section[..], &own.key[..]) == value)
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

    /// The subsystems of a set of blocks.
    pub fn unknown_in(&self, blocks: Blocks) -> Vec<&'static str> {
        let numbered = self.blocks.iter().enumerate();
        let own = numbered.filter(|(block, _)| blocks & (1 << block) != 0);
        own.flat_map(|(_, name)| self.places(name)).collect()
    }

    /// The effects that the rig may name.
    pub fn catalogue(&self) -> &Catalogue {
        &self.rig.catalogue
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

    /// The row of a record in which each residual of a block is.
    fn record_rows(&self, record: &Prepared, block: usize) -> Vec<usize> {
        match self.blocks[block] {
            GAS => [&record.gas_rows[..], &[0; UNKNOWNS]].concat(),
            FORCE => [&record.force_rows[..], &[0; UNKNOWNS]].concat(),
            _ => {
                let places = record.places.iter().map(|place| place.kernel.middle());
                let unknown = [0; UNKNOWNS];
                let rows = places.chain(unknown);
                rows.chain(record.stops.iter().copied()).collect()
            }
        }
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

/// The name of a quantity among the coordinates of residuals.
fn coordinate(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Pressure => "pressure",
        Quantity::PressureRate => "pressure rate",
        Quantity::Contraction => "contraction",
        Quantity::ContractionRate => "rate",
    }
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
            GAS => record.gas_rows.len() + UNKNOWNS,
            FORCE => record.force_rows.len() + UNKNOWNS,
            _ => record.places.len() + UNKNOWNS + record.stops.len(),
        }
    }

    /// What each record has of its own.
    fn unknowns(&self, _block: usize) -> usize {
        UNKNOWNS
    }

    /// Where the weight rests, friction takes up what it can.
    fn proportional(&self, block: usize) -> bool {
        self.blocks[block] != LOAD
    }

    /// The motion from the measured pressure: where the weight stays after each stop tells
    /// friction, play and slack far better than the balance of forces does, which knows only a tube
    /// there.
    fn free_run(&self, record: usize, nominal: &[f64], effects: &[Active]) -> Option<f64> {
        let rig = self.fitted(nominal, effects);
        if !matches!(rig.nominal.load, Load::Weight(_)) {
            return Some(0.0);
        }
        let record = &self.records[record];
        let scale = MOTION_NOISES * record.noise.contraction;
        let cost = |mean_square: f64| {
            let cost = 0.5 * MOTION_STOPS * (1.0 + mean_square / (scale * scale)).ln();
            cost.is_finite().then_some(cost)
        };
        let Ok(simulated) = simulate(&rig, &record.measured, FREE_RUN_TOLERANCE) else {
            // A motion that cannot be followed is missed by all that a muscle can contract.
            return cost(1.0);
        };
        let (is, was) = (
            simulated.column(CONTRACTION)?,
            record.measured.column(CONTRACTION)?,
        );
        let pairs = is.iter().zip(was).filter(|(_, was)| !was.is_nan());
        let sum = pairs.clone().map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        cost(sum / pairs.count() as f64)
    }

    fn context(&self, record: usize, block: usize) -> Vec<Coordinate> {
        let record = &self.records[record];
        let rows = self.record_rows(record, block);
        let time_s = record.measured.time_s();
        // A law that knew the noise of a row would explain it.
        let pressure_pa = &record.smooth_pressure_pa;
        let contraction = record.measured.column(CONTRACTION).unwrap_or_default();
        let of = |name, unit, value: &dyn Fn(usize) -> f64| Coordinate {
            name,
            unit,
            values: rows.iter().map(|row| value(*row)).collect(),
        };
        vec![
            of("direction", "", &|row| record.directions[row]),
            of(coordinate(Quantity::Pressure), "Pa", &|row| {
                pressure_pa[row]
            }),
            of(coordinate(Quantity::Contraction), "", &|row| {
                contraction[row]
            }),
            of(coordinate(Quantity::ContractionRate), "1/s", &|row| {
                record.rates_per_s[row].abs()
            }),
            of(coordinate(Quantity::PressureRate), "Pa/s", &|row| {
                let (from, to) = (row.saturating_sub(1), (row + 1).min(time_s.len() - 1));
                (pressure_pa[to] - pressure_pa[from]) / (time_s[to] - time_s[from])
            }),
            of("time", "s", &|row| time_s[row] - time_s[0]),
        ]
    }

    fn varies_with(&self, candidate: usize, quantity: &str) -> bool {
        let kind = self.rig.catalogue.find(self.candidates[candidate].effect);
        let varies = |kind: &EffectKind| {
            let mut known = kind.law_quantities.iter();
            known.any(|known| coordinate(*known) == quantity)
        };
        kind.is_some_and(varies)
    }

    fn timeline(&self, record_number: usize, block: usize) -> Timeline {
        let record = &self.records[record_number];
        let weight_n = match self.rig.nominal.load {
            Load::Weight(weight) => weight.mass_kg * GRAVITY_M_PER_S2,
            Load::Prescribed => 0.0,
        };
        let repeatability_n = self.repeatability_n.unwrap_or(0.0);
        let base_n = (BASE_NOISES * record.noise.force_n)
            .hypot(repeatability_n)
            .hypot(BASE_N)
            .hypot(BASE_SHARE * weight_n);
        let base_pressure = BASE_NOISES.hypot(BASE_PA / record.noise.pressure_pa);
        let mut bases: Vec<f64> = match self.blocks[block] {
            GAS => record
                .gas_rows
                .iter()
                .map(|row| {
                    let doubt_pa = record.gas_doubts_pa.get(*row).copied().unwrap_or(0.0);
                    base_pressure.hypot(doubt_pa / record.noise.pressure_pa)
                })
                .collect(),
            FORCE => record
                .per_force_noise
                .iter()
                .map(|per| base_n * per)
                .collect(),
            _ => record
                .places
                .iter()
                .map(|place| base_n * place.per_noise)
                .collect(),
        };
        // What a record has of its own is no measurement; a reading at the stop is exact.
        bases.resize(self.rows(record_number, block), 0.0);
        let time_s = record.measured.time_s();
        let rows = self.record_rows(record, block);
        Timeline {
            time_s: rows
                .into_iter()
                .map(|row| time_s[row] - time_s[0])
                .collect(),
            base: bases,
        }
    }

    fn residuals(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        self.residuals_with((true, None), (record, block), nominal, effects)
    }

    /// With sensors whose zeros are right.
    fn residuals_as_expected(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        self.residuals_with((false, None), (record, block), nominal, effects)
    }

    /// With the memory of a hysteresis where it was found to begin.
    fn near<'a>(
        &'a self,
        (record, block): (usize, usize),
        as_expected: bool,
        (nominal, effects): (&[f64], &[Active]),
        found: &[f64],
    ) -> Option<Near<'a>> {
        let begin = self.begin((record, block), (nominal, effects), found)?;
        Some(Box::new(move |nominal, effects| {
            let own = (!as_expected, Some(&begin));
            self.residuals_with(own, (record, block), nominal, effects)
        }))
    }
}

impl MuscleModel {
    /// Where a record began whose residuals in a block are `found` with these values; none where
    /// nothing is remembered.
    fn begin(
        &self,
        (record, block): (usize, usize),
        (nominal, effects): (&[f64], &[Active]),
        found: &[f64],
    ) -> Option<Begin> {
        let record = &self.records[record];
        let name = self.blocks[block];
        let (force, rows) = match name {
            FORCE => (Force::Read, record.force_rows.len()),
            LOAD if !self.blocks.contains(&FORCE) => (Force::True, record.places.len()),
            _ => return None,
        };
        let rig = self.fitted(nominal, self.on(block, effects));
        if !remembers(&rig) {
            return None;
        }
        let deviation = found[rows + UNKNOWNS - 1];
        let residuals = |forces: &[ForceRange]| match name {
            FORCE => force_residuals(record, forces),
            _ => balances(record, &rig, forces),
        };
        record.with_forces((&rig, force), |forces| {
            Begin::found(forces, deviation, residuals)
        })
    }

    /// Those of `effects` that change a block: what does not need not be followed.
    fn on<'e>(
        &self,
        block: usize,
        effects: &'e [Active],
    ) -> impl Iterator<Item = &'e Active> + use<'_, 'e> {
        let changes = move |own: &&Active| self.candidates[own.0].blocks.contains(&block);
        effects.iter().filter(changes)
    }

    /// Residuals of a block over a record, with the zeros of the sensors as they most likely are,
    /// or as they should be, and with a memory that begins where it fits best, or near a place.
    fn residuals_with(
        &self,
        (zeros, begin): (bool, Option<&Begin>),
        (record, block): (usize, usize),
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        let record = &self.records[record];
        let mut rig = self.fitted(nominal, self.on(block, effects));
        match self.blocks[block] {
            GAS => {
                let known = || record.zeros_of_gas(&self.rig);
                let zeros = zeros.then(|| &record.zeros.of_gas.get_or_init(known)[..]);
                gas_residuals(record, rig, zeros.unwrap_or_default())
            }
            FORCE => {
                // What differs from run to run is known with the zeros in it.
                let zeros = zeros && self.repeatability_n.is_none();
                let known = || record.zeros_of_force(&self.rig);
                let zeros = zeros.then(|| &record.zeros.of_force.get_or_init(known)[..]);
                let zeros = zeros.unwrap_or_default();
                let residuals = |forces: &[ForceRange]| force_residuals(record, forces);
                record.begun((&rig, Force::Read), zeros, begin, residuals)
            }
            _ => {
                let balances = |forces: &[ForceRange]| balances(record, &rig, forces);
                let force_read = self.blocks.contains(&FORCE);
                let known = || record.zeros_of_balances(&self.rig, force_read);
                let zeros = zeros.then(|| &record.zeros.of_balances.get_or_init(known)[..]);
                let zeros = zeros.unwrap_or_default();
                let mut residuals = if force_read {
                    without(balances(&measured_n(record, &rig)?)?, zeros, None)
                } else {
                    record.begun((&rig, Force::True), zeros, begin, balances)?
                };
                rig.nominal.load = Load::Prescribed;
                residuals.extend(record.stop_residuals(&rig)?);
                Some(residuals)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::PRESSURE_PA;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::SeedableRng;

    /// A static friction of 12 N that dead zones alone have widened to 16 N. The steps of the
    /// reference change the muscle's force by about 4 N each, so that the weight stops where
    /// friction lets it.
    #[test]
    fn static_friction_that_is_too_large_is_refined_on_simulations() {
        let text =
            Rig::REFERENCE_TOML.replace("static_friction_n = 7.0", "static_friction_n = 12.0");
        let text = text + "\n[tolerance.load]\nstatic_friction_n = 0.2\n";
        let rig = Rig::parse("rig.toml", &text).expect("a rig");
        let time_s: Vec<f64> = (0..2400).map(|row| f64::from(row) * 0.01).collect();
        let steps = |time_s: &f64| {
            let phase = (time_s / 0.4).floor() % 40.0;
            3e5 + 2e3 * if phase < 20.0 { phase } else { 40.0 - phase }
        };
        let mut drive = Record::new(time_s.clone());
        drive.set(PRESSURE_REF_PA, time_s.iter().map(steps).collect());
        let first = |value: f64| {
            let rows = (0..time_s.len()).map(|row| if row == 0 { value } else { f64::NAN });
            rows.collect()
        };
        drive.set(PRESSURE_PA, first(3e5));
        drive.set(CONTRACTION, first(0.1));
        let clean = simulate(&rig, &drive, 1e-5).expect("a run");
        let mut random = Pcg64::seed_from_u64(5);
        let mut record = drive.clone();
        for (name, noise) in [(PRESSURE_PA, 250.0), (CONTRACTION, 3e-5)] {
            let normal = Normal::new(0.0, noise).expect("a spread");
            let column = clean.column(name).expect("a column").iter();
            let noisy = column.map(|value| value + normal.sample(&mut random));
            record.set(name, noisy.collect());
        }
        let model = MuscleModel::new(&rig, &[record], &[], &[]).expect("a model");
        let static_n = |deviation: f64| 12.0 * (1.0 + 0.2 * deviation);
        let refined = model.refined(&[1.7], &[]);
        // A weight is stopped by one step of the reference, or the next.
        assert!((static_n(refined[0]) - 12.0).abs() < 2.0, "{refined:?}");
        // What was 4 N wide and is within 2 N: half of the gap, and the force no worse.
        let gap = |deviation: f64, name: &str| {
            let mut other = rig.clone();
            *other.value_mut("load", "static_friction_n").expect("a key") = static_n(deviation);
            let simulated = simulate(&other, &drive, 1e-5).expect("a run");
            let columns = [&simulated, &clean].map(|run| run.column(name).expect("a column"));
            let squares = columns[0]
                .iter()
                .zip(columns[1])
                .map(|(a, b)| (a - b).powi(2));
            (squares.sum::<f64>() / time_s.len() as f64).sqrt()
        };
        let gaps = |name| (gap(refined[0], name), gap(1.7, name));
        let (after, before) = gaps(CONTRACTION);
        assert!(after < before / 2.0, "{after} {before}");
        let (after, before) = gaps(FORCE_N);
        assert!(after <= before, "{after} {before}");
    }

    /// Where the weight rests, a law's place is known better than a reading tells it: noise that is
    /// in the place and in the residual would look like a law.
    #[test]
    fn a_law_s_place_has_little_of_the_noise_of_its_row() {
        const NOISE_PA: f64 = 250.0;
        let rig = Rig::parse("rig.toml", Rig::REFERENCE_TOML).expect("a rig");
        let mut record = Record::new((0..1000).map(|row| 0.01 * f64::from(row)).collect());
        let mut random = Pcg64::seed_from_u64(11);
        let normal = Normal::new(0.0, NOISE_PA).expect("a spread");
        let mut around = |middle: f64, share: f64| {
            let noisy = (0..1000).map(|_| middle + share * normal.sample(&mut random));
            noisy.collect::<Vec<f64>>()
        };
        record.set(PRESSURE_REF_PA, vec![2e5; 1000]);
        record.set(PRESSURE_PA, around(2e5, 1.0));
        record.set(CONTRACTION, around(0.1, 1e-7));
        let model = MuscleModel::new(&rig, &[record], &[], &[]).expect("a model");
        let place = |name: &str| {
            let mut context = model.context(0, 0).into_iter();
            let own = context.find(|own| own.name == name);
            let mut values = own.expect("a place").values;
            values.truncate(values.len() - UNKNOWNS);
            values
        };
        let spread = |values: &[f64], middle: f64| {
            let squares: f64 = values.iter().map(|value| (value - middle).powi(2)).sum();
            (squares / values.len() as f64).sqrt()
        };
        // A parabola through 65 rows leaves a fifth of the noise.
        assert!(spread(&place("pressure"), 2e5) < NOISE_PA / 4.0);
        // Of two readings 20 ms apart it would be as large as this.
        let of_readings = NOISE_PA * 2.0_f64.sqrt() / 0.02;
        assert!(spread(&place("pressure rate"), 0.0) < of_readings / 4.0);
    }

    /// Each friction is fitted for itself, here to a Coulomb friction of 9 N and a static one of
    /// 3.5 N: the rig that is written can be read and simulated.
    #[test]
    fn no_static_friction_stays_below_the_coulomb_friction() {
        let both = "static_friction_n = 0.5\ncoulomb_friction_n = 0.5\n";
        let only_coulomb = "coulomb_friction_n = 0.5\n";
        for (tolerances, static_n) in [(both, 9.0), (only_coulomb, 7.0)] {
            let text = format!("{}\n[tolerance.load]\n{tolerances}", Rig::REFERENCE_TOML);
            let rig = Rig::parse("rig.toml", &text).expect("a rig");
            let mut record = Record::new((0..200).map(|row| 0.01 * f64::from(row)).collect());
            record.set(PRESSURE_PA, vec![3e5; 200]);
            record.set(CONTRACTION, vec![0.1; 200]);
            let model = MuscleModel::new(&rig, &[record], &[], &[]).expect("a model");
            let moved = rig
                .tolerances
                .iter()
                .map(|tolerance| match &tolerance.key[..] {
                    "static_friction_n" => -1.0,
                    _ => 2.0,
                });
            let moved: Vec<f64> = moved.collect();
            assert!(!model.above_coulomb(&moved));
            let nominal = model.with_static_friction_above_coulomb(moved);
            assert!(model.above_coulomb(&nominal));
            let Load::Weight(weight) = model.fitted(&nominal, []).nominal.load else {
                panic!("a weight");
            };
            assert!(
                (weight.static_friction_n - static_n).abs() < 1e-9,
                "{weight:?}"
            );
            assert!(
                (weight.coulomb_friction_n - static_n).abs() < 1e-9,
                "{weight:?}"
            );
            // What needed no change has none.
            let again = model.with_static_friction_above_coulomb(nominal.clone());
            assert_eq!(again, nominal);
        }
    }

    /// A volume that is negative at a contraction of 0.3, a muscle that pushes at rest, and a room
    /// at 90 K: what is written can be read, is changed no more than that, and only where it must.
    #[test]
    fn a_fitted_rig_can_be_read() {
        let tolerances = "\n[tolerance.muscle]\nalpha_m2 = 0.05\nbeta_m2 = 0.04\n\
                          volume_d1_m3 = 0.05\nvolume_d3_m3 = 0.05\n\
                          [tolerance.gas]\nambient_temperature_k = 0.01\n";
        let text = format!("{}{tolerances}", Rig::REFERENCE_TOML);
        let rig = Rig::parse("rig.toml", &text).expect("a rig");
        let mut record = Record::new((0..200).map(|row| 0.01 * f64::from(row)).collect());
        record.set(PRESSURE_PA, vec![3e5; 200]);
        record.set(CONTRACTION, vec![0.1; 200]);
        let model = MuscleModel::new(&rig, &[record], &[], &[]).expect("a model");
        let written = |nominal: &[f64]| {
            let written = model.fitted(nominal, []).rewritten(&text).expect("TOML");
            Rig::parse("rig.fitted.toml", &written).map_err(|error| error.to_string())
        };
        for (place, moved, says) in [
            (0, [-18.0, 0.5, 0.1, -0.1, 1.0], "muscle.beta_m2"),
            (2, [0.2, 0.5, 40.0, -5.0, 1.0], "a volume above 0"),
            (4, [0.2, 0.5, 0.1, -0.1, -70.0], "from 150 to 500"),
        ] {
            let refused = written(&moved).expect_err("refused as it is fitted");
            assert!(refused.contains(says), "{refused}");
            let nominal = model.readable(moved.to_vec());
            written(&nominal).expect("a rig");
            let changed = |place: &usize| nominal[*place] != moved[*place];
            let changed: Vec<usize> = (0..5).filter(changed).collect();
            assert_eq!(changed[0], place, "{nominal:?}");
            assert!(changed.len() <= 2 && changed.iter().all(|own| own / 2 == place / 2));
            assert_eq!(model.readable(nominal.clone()), nominal);
        }
    }

    /// Twice the payload misses twice as much: a heavy weight is not more probable because
    /// pressures, which are as noisy as ever, move it less.
    #[test]
    fn a_heavier_weight_is_not_rewarded() {
        let rig = Rig::parse("rig.toml", Rig::REFERENCE_TOML).expect("a rig");
        let time_s: Vec<f64> = (0..1000).map(|row| f64::from(row) * 0.01).collect();
        let mut record = Record::new(time_s.clone());
        let noise = |row: usize| (12.9 * row as f64).sin();
        let pressure_pa = (0..1000).map(|row| 3e5 + 300.0 * noise(row));
        record.set(PRESSURE_PA, pressure_pa.collect());
        let contraction = time_s
            .iter()
            .zip(0..)
            .map(|(time_s, row)| 0.1 + 0.01 * (2.0 * time_s).sin() + 3e-5 * noise(7 * row));
        record.set(CONTRACTION, contraction.collect());
        let model = MuscleModel::new(&rig, &[record], &[], &[]).expect("a model");
        let load = model.blocks.iter().position(|block| *block == LOAD);
        let mut candidates = model.candidates.iter();
        let payload = candidates.position(|own| own.effect == "payload");
        let (load, payload) = (load.expect("a load"), payload.expect("a payload"));
        let nominal = vec![0.0; model.rig.tolerances.len()];
        let missed = |mass_kg: f64| {
            let residuals = model.residuals(0, load, &nominal, &[(payload, vec![mass_kg])]);
            let residuals = residuals.expect("residuals").values;
            residuals.iter().take(50).sum::<f64>() / 50.0
        };
        let (first, second) = (missed(12.0) - missed(6.0), missed(18.0) - missed(12.0));
        assert!(first < -10.0, "{first}");
        assert!((second / first - 1.0).abs() < 0.05, "{first}, {second}");
    }
}

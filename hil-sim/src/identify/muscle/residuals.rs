//! Residuals of each block: what a rig makes of a record's inputs, against what was measured.

use super::along::Along;
use super::begin::{Begin, KnownForces, begun, without};
use super::finer::{finer, parts};
use super::force::{Fading, Force, ForceRange, Forces, remembers};
use super::play::{play, without_further_play};
use super::prepared::{Place, Prepared};
use super::thinned::at_rows;
use crate::identify::inputs::Inputs;
use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA, Record};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use model_discrepancy::least_squares::Residuals;
use muscle_plant::nominal::{Load, Weight};
use muscle_plant::simulation::Simulated;
use muscle_plant::simulation::{Initial, Simulation, TOLERANCE};
use muscle_plant::subsystem::load::{GRAVITY_M_PER_S2, LoadPoint, LoadSubsystem};
use muscle_plant::subsystem::sensors::Reading;
use muscle_plant::subsystem::term::Terms;
use muscle_plant::subsystem::{Subsystem, Term};
use std::ops::ControlFlow;
use std::sync::Arc;

/// The stop is where the contraction is 0, to within this \[-\].
const STOP_PLACE: f64 = 1e-4;
/// Tolerance of simulations of the gas. With [`TOLERANCE`] what the lengths of steps leave is rough
/// where a small muscle follows its valve in milliseconds: slopes of that look thirty times too
/// steep, fits stop where they begin, and intervals are too narrow.
const SMOOTH: f64 = 0.3 * TOLERANCE;
/// A simulation that takes more steps than this in a second, and a row, is given up: its parameters
/// are far from those of any rig.
const STEPS_PER_S: f64 = 300.0;
const STEPS_PER_ROW: f64 = 4.0;
/// A muscle whose force depends on pressure by so many times more or less is none of this rig.
const SLOPE_RATIO: f64 = 4.0;
/// Share of the nominal mass that a payload leaves at least: with less it is another rig's.
const LEAST_SHARE_OF_MASS: f64 = 0.5;

/// Rows further apart than this \[s\] are simulated in parts of at most so long \[s\]: of a weight
/// on its muscle, of some 3 Hz, straight lines of 20 ms cut off less than 2 %.
const FAR_S: f64 = 0.025;
const PART_S: f64 = 0.02;
/// Standard deviation of the share by which the pressure may bow more or less between rows than the
/// rig's valve makes it: a valve or a line that is slower takes all of it off at two of them, and a
/// reading at the rows alone does not show it.
const BOW_SHARE: f64 = 0.5;
/// Standard deviation of how much warmer or colder the gas is where a record begins in motion
/// \[K\]: after a change of pressure by an eighth without exchange of heat.
const BEGIN_K: f64 = 10.0;

/// The pressure that is read in each row \[Pa\], with the contraction as an input. With
/// `corrected_pa` it is predicted from one row to the next: the muscle has that pressure in each
/// row, or, where it is NaN, the one predicted. The gas begins so much warmer than the room.
pub(super) fn pressures_pa(
    rig: &Rig,
    inputs: Inputs,
    record: &Record,
    corrected_pa: Option<&[f64]>,
    warmer_k: f64,
) -> Option<Vec<f64>> {
    let plant = rig.plant(inputs.simulated).ok()?;
    let mut pressure_pa = record.column(PRESSURE_PA)?.iter();
    let initial = Initial {
        time_s: record.time_s()[0],
        contraction: inputs.contraction(0)?,
        contraction_rate_per_s: 0.0,
        pressure: GaugePa(*pressure_pa.find(|pressure_pa| !pressure_pa.is_nan())?),
        temperature_k: plant.ambient_temperature_k + warmer_k,
    };
    let rows = record.time_s().len();
    let mut out = Vec::with_capacity(rows);
    let start_s = record.time_s()[0];
    let visit = |row: usize, simulation: &mut Simulation| {
        out.push(simulation.read().pressure.0);
        if let Some(pressure_pa) = corrected_pa.map(|all| all[row]).filter(|pa| !pa.is_nan()) {
            let reading = Reading {
                pressure: GaugePa(pressure_pa),
                contraction: simulation.contraction(),
                force_n: 0.0,
            };
            let sensors = &simulation.plant().sensors;
            let truth = sensors.truth(record.time_s()[row], reading);
            simulation.prescribe_pressure(truth.pressure);
        }
        let spent_s = record.time_s()[row] - start_s;
        let most = STEPS_PER_S * (1.0 + spent_s) + STEPS_PER_ROW * row as f64;
        if simulation.work().steps as f64 > most {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    };
    inputs.run(plant, &initial, SMOOTH, rows, visit).ok()?;
    (out.len() == rows).then_some(out)
}

/// Whether rows so far apart are simulated in parts.
pub(super) fn is_far(length_s: f64) -> bool {
    length_s > FAR_S
}

/// The pressure that `rig` reads in each row of `told` \[Pa\], with the contraction between rows
/// that are far apart as a cubic: straight lines cut the tops of what the weight does in between.
fn finer_pressures_pa(rig: &Rig, told: &Record, inert: bool, warmer_k: f64) -> Option<Vec<f64>> {
    let simulated_pa = |record: &Record| {
        let mut inputs = Inputs::new(rig, record).ok()?;
        inputs.inert = inert;
        pressures_pa(rig, inputs, record, None, warmer_k)
    };
    let parts = parts(told.time_s(), |length_s| match is_far(length_s) {
        true => (length_s / PART_S).ceil() as usize,
        false => 1,
    });
    if parts.iter().all(|parts| *parts == 1) {
        return simulated_pa(told);
    }
    let (fine, is_row) = finer(told, &parts)?;
    let fine_pa = simulated_pa(&fine)?.into_iter();
    let rows = fine_pa.zip(is_row).filter(|(_, is_row)| *is_row);
    Some(rows.map(|(pressure_pa, _)| pressure_pa).collect())
}

/// The pressure that `rig` reads in each row of `record`, whose `gas` may be changed \[Pa\]:
/// simulated from one row that tells something to the next, and linear in between.
pub(super) fn gas_pressures_pa(
    record: &Prepared,
    mut rig: Rig,
    gas: &Record,
    warmer_k: f64,
) -> Option<Vec<f64>> {
    let inert = matches!(rig.nominal.load, Load::Weight(_));
    rig.nominal.load = Load::Prescribed;
    let played = record.unplayed(&rig, gas, None);
    let told = at_rows(&played, &record.gas_told);
    let told_pa = finer_pressures_pa(&rig, &told, inert, warmer_k)?;
    let time_s = played.time_s();
    let mut read_pa = Vec::with_capacity(time_s.len());
    for (ends, ends_pa) in record.gas_told.windows(2).zip(told_pa.windows(2)) {
        let (from, to) = (ends[0], ends[1]);
        let per_s = (ends_pa[1] - ends_pa[0]) / (time_s[to] - time_s[from]);
        read_pa.extend((from..to).map(|row| ends_pa[0] + per_s * (time_s[row] - time_s[from])));
    }
    read_pa.extend(told_pa.last());
    Some(read_pa)
}

/// With what is off in the record (`zeros`) as it most likely is.
pub(super) fn gas_residuals(record: &Prepared, rig: Rig, zeros: &[Vec<f64>]) -> Option<Residuals> {
    let measured = record.gas.as_ref()?.column(PRESSURE_PA)?;
    let read_pa = gas_pressures_pa(record, rig, record.gas.as_ref()?, 0.0)?;
    let residual = |row: &usize| {
        let simulated_pa = record.pressure_span.read(read_pa[*row]);
        (simulated_pa - measured[*row]) / record.noise.pressure_pa
    };
    let residuals = Residuals::exact(record.gas_rows.iter().map(residual).collect());
    Some(without(residuals, zeros, None))
}

/// What a row misses, its dead zone, and the noise of that in this rig and in the nominal one.
struct Weighed {
    value: f64,
    slack: f64,
    noise: f64,
    nominal_noise: f64,
}

/// Residuals of rows in units of their noise.
///
/// The density of a row is that of its noise, 1/σ exp(−r²/2σ²): a rig whose noise is larger misses
/// less in units of it, and is no more probable for that. About the most probable rig, where the
/// mean square of r/σ is 1, the sum of squares has the same slope as the logarithm of the density
/// if all rows are weighed by the geometric mean of σ over that of the nominal rig.
fn weighed(rows: &[Weighed]) -> Residuals {
    let logs = rows.iter().map(|row| (row.noise / row.nominal_noise).ln());
    let scale = (logs.sum::<f64>() / rows.len().max(1) as f64).exp();
    let of = |row: &Weighed| {
        let per_noise = scale / row.noise;
        (row.value * per_noise, row.slack * per_noise)
    };
    let (values, slack) = rows.iter().map(of).unzip();
    Residuals { values, slack }
}

/// Of the force that the muscle may read, row by row.
///
/// The pressure's noise counts as this muscle makes force of it, row by row.
pub(super) fn force_residuals(record: &Prepared, forces: &[ForceRange]) -> Option<Residuals> {
    let measured = record.measured.column(FORCE_N)?;
    // Where a force is clipped at its bottom the muscle hangs loose: Eq 1, which would push, is not
    // right because the sensor cannot tell.
    let most_n = record.force_span.most;
    let residual = |(row, per_nominal_noise): (&usize, &f64)| {
        let force = forces[*row];
        let (least_n, most_n) = (force.least_n.min(most_n), force.most_n.min(most_n));
        let noise_n = record.force_noise_n(force.per_pressure_m2);
        Weighed {
            value: 0.5 * (least_n + most_n) - measured[*row],
            slack: 0.5 * (most_n - least_n),
            noise: noise_n,
            nominal_noise: per_nominal_noise.recip(),
        }
    };
    let rows = record.force_rows.iter().zip(&record.per_force_noise);
    Some(weighed(&rows.map(residual).collect::<Vec<_>>()))
}

impl Prepared {
    /// What states that were off at the begin add to the force; none where they were settled.
    pub(super) fn fading(&self, forces: &Forces) -> Option<Vec<Fading>> {
        if self.settled {
            return Some(Vec::new());
        }
        forces.fading()
    }

    /// What `of` makes of the force of the muscle of `rig`.
    pub(super) fn with_forces<T>(
        &self,
        (rig, force): (&Rig, Force),
        of: impl FnOnce(&Forces) -> Option<T>,
    ) -> Option<T> {
        let ways = self.ways(rig);
        of(&Forces::new(rig, &ways, force)?)
    }

    /// Residuals, by the force of its muscle, with a memory that begins where it fits best or near
    /// a `begin`; see [`begun`].
    pub(super) fn begun(
        &self,
        (rig, force): (&Rig, Force),
        zeros: &[Vec<f64>],
        begin: Option<&Begin>,
        residuals: impl Fn(&[ForceRange]) -> Option<Residuals>,
    ) -> Option<Residuals> {
        let remembers = remembers(rig);
        let begin = begin.filter(|_| remembers);
        if begin.is_none() && remembers {
            return self.with_forces((rig, force), |forces| {
                begun(forces, &self.fading(forces)?, zeros, residuals)
            });
        }
        let share = begin.map(Begin::share);
        let compute = || {
            self.with_forces((rig, force), |forces| {
                KnownForces::new(forces, self.fading(forces)?, share)
            })
        };
        let known = match force {
            // Where the force is read, what moves are values of the muscle.
            Force::Read => Arc::new(compute()?),
            Force::True => self.kept_forces.get_or_compute(rig, share, compute)?,
        };
        known.residuals(zeros, begin, residuals)
    }

    /// How the residuals of the gas change by the zero of its sensor, off by its noise: whoever
    /// sets it sees no less; by the pressure at the begin, which is that of a noisy reading: a slow
    /// valve takes seconds to forget it; and, where the record begins in motion, by the temperature
    /// there.
    pub(super) fn zeros_of_gas(&self, rig: &Rig) -> Vec<Vec<f64>> {
        let zero = vec![1.0; self.gas_rows.len()];
        let begins = self.begins_of_gas(rig).unwrap_or_default();
        [vec![zero], begins].concat()
    }

    fn begins_of_gas(&self, rig: &Rig) -> Option<Vec<Vec<f64>>> {
        let gas = self.gas.as_ref()?;
        let mut read_pa = gas.column(PRESSURE_PA)?.to_vec();
        let begin = read_pa
            .iter()
            .position(|pressure_pa| !pressure_pa.is_nan())?;
        read_pa[begin] += self.noise.pressure_pa;
        let mut higher = gas.clone();
        higher.set(PRESSURE_PA, read_pa);
        let own_pa = gas_pressures_pa(self, rig.clone(), gas, 0.0)?;
        let off = |other_pa: Vec<f64>| -> Vec<f64> {
            let rows = self.gas_rows.iter();
            rows.map(|row| (other_pa[*row] - own_pa[*row]) / self.noise.pressure_pa)
                .collect()
        };
        let mut begins = vec![off(gas_pressures_pa(self, rig.clone(), &higher, 0.0)?)];
        if !self.settled {
            begins.push(off(gas_pressures_pa(self, rig.clone(), gas, BEGIN_K)?));
        }
        Some(begins)
    }

    /// The same of the muscle's force: by the zeros of pressure, contraction and force.
    pub(super) fn zeros_of_force(&self, rig: &Rig) -> Vec<Vec<f64>> {
        let rows = || self.force_rows.iter().zip(&self.per_force_noise);
        let zeros_n = self.zeros_n(rig).into_iter();
        let zeros_n = zeros_n.chain([vec![self.noise.force_n; self.directions.len()]]);
        let zeros = zeros_n.map(|n| rows().map(|(row, per)| n[*row] * per).collect());
        zeros.collect()
    }

    /// The same of the load's balance, with the muscle's force as it is read or, else, as pressure
    /// and contraction make it.
    pub(super) fn zeros_of_balances(&self, rig: &Rig, force_read: bool) -> Vec<Vec<f64>> {
        let mut zeros_n = if force_read {
            vec![vec![self.noise.force_n; self.directions.len()]]
        } else {
            self.zeros_n(rig)
        };
        zeros_n.extend(self.between_n(rig));
        let at = |place: &Place, n: &[f64]| place.kernel.value(n) * place.per_noise;
        let of = |n: &Vec<f64>| self.places.iter().map(|place| at(place, n)).collect();
        zeros_n.iter().map(of).collect()
    }

    /// What the muscle's force is more, row by row \[N\], if the simulated valve has missed
    /// readings from the begin of each interval on, and if the pressure bows [`BOW_SHARE`] more
    /// between rows than the simulated one does; none where it is not known to bow.
    fn between_n(&self, rig: &Rig) -> Vec<Vec<f64>> {
        let contraction = self.measured.column(CONTRACTION).unwrap_or_default();
        let of = |(share, bows_pa): (f64, &Vec<f64>)| {
            let bow_n = |(contraction, bow_pa): (&f64, &f64)| {
                let n = share * bow_pa * rig.nominal.muscle.force_per_pressure_m2(*contraction);
                if n.is_finite() { n } else { 0.0 }
            };
            let rows = contraction.iter().zip(bows_pa);
            (!bows_pa.is_empty()).then(|| rows.map(bow_n).collect())
        };
        let unknown = [(1.0, &self.missed_pa), (BOW_SHARE, &self.between_pa)];
        unknown.into_iter().filter_map(of).collect()
    }

    /// What the zeros of pressure and contraction, off by their noise, make of the muscle's force,
    /// row by row \[N\]. In a gap of the record nothing, as nothing is compared there.
    fn zeros_n(&self, rig: &Rig) -> Vec<Vec<f64>> {
        let column = |name| self.measured.column(name).unwrap_or_default().iter();
        let muscle = &rig.nominal.muscle;
        let rows = || column(CONTRACTION).zip(column(PRESSURE_PA));
        let known = |n: f64| if n.is_finite() { n } else { 0.0 };
        let by_pressure = rows().map(|(contraction, _)| {
            known(muscle.force_per_pressure_m2(*contraction) * self.noise.pressure_pa)
        });
        let by_contraction = rows().map(|(contraction, pressure_pa)| {
            let stiffness_n = muscle.stiffness_n(*contraction, GaugePa(*pressure_pa));
            known(stiffness_n * self.noise.contraction)
        });
        vec![by_pressure.collect(), by_contraction.collect()]
    }

    /// What the encoder reads on the stop, where a muscle is as long as it can be.
    pub(super) fn stop_residuals(&self, rig: &Rig) -> Option<Residuals> {
        if self.stops.is_empty() {
            return Some(Residuals::default());
        }
        let read = without_further_play(rig, &self.measured);
        let inputs = Inputs::new(rig, &read).ok()?;
        let noise = self.noise.contraction.hypot(STOP_PLACE);
        let read = |row: &usize| inputs.contraction(*row).unwrap_or(0.0) / noise;
        Some(Residuals {
            values: self.stops.iter().map(read).collect(),
            slack: vec![play(rig) / noise; self.stops.len()],
        })
    }
}

/// The weight of `rig` with its effects, and how many states they have.
fn load_block(rig: &Rig, weight: Weight) -> (LoadSubsystem, usize) {
    let mut load = LoadSubsystem {
        weight,
        initial_length_m: rig.nominal.muscle.initial_length_m,
        terms: Terms::default(),
    };
    let mut states = 0;
    let effects = rig.effects.iter();
    for effect in effects.filter(|effect| effect.kind.subsystem == Subsystem::Load) {
        if let Term::Load(term) = (effect.form.build)(&effect.values) {
            states += load.terms.push(term, states);
        }
    }
    (load, states)
}

/// The measured force as it works on the weight, row by row \[N\].
pub(super) fn measured_n(record: &Prepared, rig: &Rig) -> Option<Vec<ForceRange>> {
    let sensors = rig.plant(Simulated::FORCE_ONLY).ok()?.sensors;
    let measured_n = record.measured.column(FORCE_N)?.iter();
    let truth = |(force_n, time_s): (&f64, &f64)| {
        let reading = Reading {
            pressure: GaugePa(0.0),
            contraction: 0.0,
            force_n: *force_n,
        };
        let true_n = sensors.truth(*time_s, reading).force_n;
        ForceRange {
            least_n: true_n,
            most_n: true_n,
            per_pressure_m2: 0.0,
        }
    };
    Some(
        measured_n
            .zip(record.measured.time_s())
            .map(truth)
            .collect(),
    )
}

/// Of each row: the forces on the weight without its acceleration and damping \[N\], what friction
/// can take up \[N\], the mass \[kg\], and by how much friction can jump \[N\]; with the
/// `contraction` that the muscle has.
fn forces_on_weight(
    record: &Prepared,
    rig: &Rig,
    (load, states): (&LoadSubsystem, usize),
    contraction: &[f64],
    forces: &[ForceRange],
) -> Option<Vec<[f64; 4]>> {
    let read = record.measured.column(CONTRACTION)?;
    // Noise must not be a way without end, nor the way be late by it: bristles are stiff.
    let smooth = record.smooth.column(CONTRACTION)?;
    let time_s = record.measured.time_s();
    let mut along = Along::new(states);
    let of_row = |row: usize| {
        let direction = record.directions[row];
        let at = LoadPoint {
            time_s: time_s[row],
            contraction: contraction[row],
            contraction_rate_per_s: record.rates_per_s[row],
            direction,
            initial_length_m: load.initial_length_m,
        };
        let place = smooth[row] + contraction[row] - read[row];
        let (weight, lifting_n, doubt_n) = along.advance(load, &at, place);
        let (middle_n, reach_n) = if direction == 0.0 {
            (0.0, weight.static_friction_n)
        } else {
            (direction * weight.coulomb_friction_n, 0.0)
        };
        let weight_n = weight.mass_kg * GRAVITY_M_PER_S2;
        let ForceRange {
            least_n, most_n, ..
        } = forces[row];
        let between_pa = record.between_pa.get(row).copied().unwrap_or(0.0);
        let between_n = rig.nominal.muscle.force_per_pressure_m2(contraction[row]) * between_pa;
        [
            0.5 * (least_n + most_n) + between_n + lifting_n - weight_n - middle_n,
            reach_n + doubt_n + 0.5 * (most_n - least_n),
            weight.mass_kg,
            // It stops from a sliding friction that may be opposite to the static one.
            weight.coulomb_friction_n + weight.static_friction_n,
        ]
    };
    Some((0..time_s.len()).map(of_row).collect())
}

/// How far the balance of forces on the weight lies outside what friction can take up, under
/// the least and the most force that the muscle may have, in each place in units of its noise.
pub(super) fn balances(record: &Prepared, rig: &Rig, forces: &[ForceRange]) -> Option<Residuals> {
    let Load::Weight(weight) = rig.nominal.load else {
        return None;
    };
    let (load, states) = load_block(rig, weight);
    let play = play(rig);
    let played = record.unplayed(rig, &record.measured, None);
    let contraction = played.column(CONTRACTION)?;
    let rows = forces_on_weight(record, rig, (&load, states), contraction, forces)?;
    // With hardly a weight the balance holds for any muscle that is slack.
    let least_kg = LEAST_SHARE_OF_MASS * load.weight.mass_kg;
    if rows.iter().any(|row| row[2] < least_kg) {
        return None;
    }
    let residual = |place: &Place| {
        let (mut balance_n, mut reach_n, mut mass_kg, mut jump_n) = (0.0, 0.0, 0.0, 0.0);
        let kernel = &place.kernel;
        for (weight, row) in kernel.value.iter().zip(&rows[kernel.rows.clone()]) {
            balance_n += weight * row[0];
            reach_n += weight * row[1];
            mass_kg += weight * row[2];
            jump_n += weight * row[3];
        }
        let dip_per_s2 = 2.0 * play * place.dip_per_s2;
        reach_n += mass_kg * load.initial_length_m * dip_per_s2;
        reach_n += place.jump_share * jump_n;
        balance_n -= mass_kg * load.initial_length_m * kernel.second(contraction)
            + load.weight.viscous_damping_ns_per_m
                * load.initial_length_m
                * kernel.first(contraction);
        let moved = Weight {
            mass_kg,
            ..load.weight
        };
        let per_pressure_m2 = forces[kernel.middle()].per_pressure_m2;
        // Without a measured force the balance is one of pressures: in a rig whose forces are all
        // larger, noise of the pressure is as likely as in this one.
        let scale = if record.force_read {
            1.0
        } else {
            let ratio = per_pressure_m2 / place.per_pressure_m2;
            ratio.clamp(SLOPE_RATIO.recip(), SLOPE_RATIO).recip()
        };
        Weighed {
            value: scale * balance_n,
            slack: scale * reach_n,
            noise: scale * record.balance_noise_n(rig, &moved, place, per_pressure_m2),
            nominal_noise: place.per_noise.recip(),
        }
    };
    let rows: Vec<Weighed> = record.places.iter().map(residual).collect();
    Some(weighed(&rows))
}

#[cfg(test)]
mod tests {
    use super::super::begin::UNKNOWNS;
    use super::*;
    use crate::identify::simulate::simulate;
    use crate::record::PRESSURE_REF_PA;
    use nalgebra::DVector;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::SeedableRng;
    use std::borrow::Cow;

    /// The shortest lags that a delay is dispersed by, where each row has another reference and
    /// another contraction, and the delay cuts them: the most steps that a likely rig takes.
    #[test]
    fn the_shortest_lags_are_followed() {
        let (delay_s, lag_s) = (0.0303_f64, 2.6e-3);
        let dispersion = lag_s * 2.0_f64.sqrt() / delay_s;
        let effect = format!(
            "[[effect]]\nname = \"transport-delay\"\nform = \"dispersed\"\n\
             delay_s = {delay_s:?}\ndispersion = {dispersion:?}\n"
        );
        let rig = Rig::parse("rig.toml", &format!("{}{effect}", Rig::REFERENCE_TOML));
        let rig = rig.expect("a rig");
        let time_s: Vec<f64> = (0..4000).map(|row| 0.01 * f64::from(row)).collect();
        let mut record = Record::new(time_s.clone());
        let swings = |size: f64| move |t: &f64| size * (1.3 * t).sin();
        let around = |middle: f64, size: f64| {
            let values = time_s.iter().map(swings(size));
            values.map(|value| middle + value).collect::<Vec<f64>>()
        };
        record.set(PRESSURE_REF_PA, around(2.5e5, 2e5));
        record.set(PRESSURE_PA, around(2.5e5, 2e5));
        record.set(CONTRACTION, around(0.12, 0.1));
        let prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        assert!(gas_residuals(&prepared[0], rig, &[]).is_some());
    }

    const NOISE_PA: f64 = 300.0;

    /// Steps, each held for three seconds, from a row on, with noise.
    fn steps_from(rig: &Rig, begin: usize) -> Record {
        let time_s: Vec<f64> = (0..1500).map(|row| 0.01 * f64::from(row)).collect();
        let mut drive = Record::new(time_s.clone());
        let steps = [1.5e5, 2.2e5, 2.0e5, 2.6e5, 1.8e5];
        let of = |t: &f64| steps[((*t + 1e-9) / 3.0).floor() as usize % steps.len()];
        drive.set(PRESSURE_REF_PA, time_s.iter().map(of).collect());
        let first = |value: f64| {
            let rows = (0..time_s.len()).map(|row| if row == 0 { value } else { f64::NAN });
            rows.collect()
        };
        drive.set(PRESSURE_PA, first(1.5e5));
        drive.set(CONTRACTION, first(0.05));
        let run = simulate(rig, &drive, TOLERANCE).expect("a motion");
        let mut random = Pcg64::seed_from_u64(3);
        let mut record = Record::new(time_s[begin..].to_vec());
        for (name, noise) in [(PRESSURE_PA, NOISE_PA), (CONTRACTION, 1e-5)] {
            let normal = Normal::new(0.0, noise).expect("a deviation");
            let values = run.column(name).expect("a signal")[begin..].iter();
            let noisy = values.map(|value| value + normal.sample(&mut random));
            record.set(name, noisy.collect());
        }
        record.set(PRESSURE_REF_PA, time_s[begin..].iter().map(of).collect());
        record
    }

    /// A record that begins 0.2 s after a step, of a muscle that keeps its heat for seconds, as a
    /// wide one does: the gas is warmer than the room, and what follows from that is no residual.
    /// Taken to be as warm as the room it is one.
    #[test]
    fn a_gas_that_begins_warm_is_no_effect() {
        let slow = Rig::REFERENCE_TOML.replace("= 1.3e-7", "= 6.1e-9");
        let wide = slow
            .replace("= 120.0", "= 15.0")
            .replace("= 80.0", "= 10.0");
        let rig = Rig::parse("rig.toml", &wide).expect("a rig");
        let record = steps_from(&rig, 320);
        let prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        let prepared = &prepared[0];
        assert!(!prepared.settled);
        let zeros = prepared.zeros_of_gas(&rig);
        let rms = |zeros: &[Vec<f64>]| {
            let left = gas_residuals(prepared, rig.clone(), zeros).expect("residuals");
            // Of the first second.
            let squares = left.values[..100].iter().map(|value| value * value);
            (squares.sum::<f64>() / 100.0).sqrt()
        };
        let (known, unknown) = (rms(&zeros[..2]), rms(&zeros));
        // The scatter of an RMS over 100 rows is 7 %.
        assert!((unknown - 1.0).abs() < 0.21, "{unknown}");
        // For ten nats an effect is tried.
        let gain_nats = 0.5 * 100.0 * (known.powi(2) - unknown.powi(2));
        assert!(gain_nats > 10.0, "{gain_nats}");
    }

    /// A run-in of half of the force that is over when a record begins, and one that there is not,
    /// are the same: what is left of the load's balance is no smaller for the slope that the run-in
    /// would have given the force.
    #[test]
    fn a_run_in_that_is_over_shrinks_no_residuals() {
        let rig = Rig::parse("rig.toml", Rig::REFERENCE_TOML).expect("a rig");
        let run_in = "[[effect]]\nname = \"run-in\"\nform = \"exponential\"\nshare = 0.5\n\
                      distance = 20.0\n";
        let over = format!("{}{run_in}", Rig::REFERENCE_TOML);
        let over = Rig::parse("rig.toml", &over).expect("a rig");
        let record = steps_from(&rig, 320);
        let prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        let prepared = &prepared[0];
        let zeros = prepared.zeros_of_balances(&rig, false);
        let rms = |rig: &Rig| {
            let balances = |forces: &[ForceRange]| balances(prepared, rig, forces);
            let left = prepared.begun((rig, Force::True), &zeros, None, balances);
            let left = left.expect("residuals");
            let (rows, own) = left.values.split_at(left.values.len() - UNKNOWNS);
            // Half of the run-in is one deviation.
            let taken = own[zeros.len()];
            let squares: f64 = rows.iter().map(|value| value * value).sum();
            let count = rows.len() as f64;
            (taken, (squares / count).sqrt())
        };
        let ((_, none), (taken, over)) = (rms(&rig), rms(&over));
        assert!((taken + 2.0).abs() < 0.1, "{taken}");
        // With the slope that is taken back residuals were two thirds of what they are.
        assert!((over / none - 1.0).abs() < 0.05, "{over}, {none}");
    }

    /// At rest the gas is simulated in few rows, and what lies between them is off by a third of
    /// what a sound rig may leave, a ninth of the variance.
    #[test]
    fn a_gas_at_rest_is_simulated_in_few_rows() {
        let rig = Rig::parse("rig.toml", Rig::REFERENCE_TOML).expect("a rig");
        let record = steps_from(&rig, 0);
        let time_s = record.time_s();
        let mut prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        let prepared = &mut prepared[0];
        let gas = prepared.gas.clone().expect("a reference");
        let few = gas_pressures_pa(prepared, rig.clone(), &gas, 0.0).expect("pressures");
        assert!(
            prepared.gas_told.len() < time_s.len() / 2,
            "{}",
            prepared.gas_told.len()
        );
        prepared.gas_told = (0..time_s.len()).collect();
        let all = gas_pressures_pa(prepared, rig, &gas, 0.0).expect("pressures");
        let squares = few.iter().zip(&all).map(|(few, all)| (few - all).powi(2));
        let off_pa = (squares.sum::<f64>() / time_s.len() as f64).sqrt();
        assert!(off_pa < 0.1 * NOISE_PA, "{off_pa} Pa");
    }

    /// With one way to go a Dahl friction keeps its begin in proportion; of a sum of sliders each
    /// comes to its end after another way.
    #[test]
    fn a_memory_at_the_begin_is_found() {
        find_memory("duhem", "reach = 0.05\nasymmetry = 1.0", 0.5);
        find_memory(
            "maxwell-slip",
            "reach = 0.015\nspread = 7.0\ntaper = 0.6",
            0.2,
        );
    }

    fn find_memory(form: &str, values: &str, share: f64) {
        let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
        let effect = format!(
            "[[effect]]\nname = \"hysteresis\"\nform = \"{form}\"\nforce_n = 20.0\n{values}\n\
             base_share = 0.2\n"
        );
        let rig = Rig::parse("rig.toml", &(text + &effect)).expect("a rig");
        let time_s: Vec<f64> = (0..300).map(|row| 0.01 * f64::from(row)).collect();
        let mut record = Record::new(time_s.clone());
        record.set(
            CONTRACTION,
            time_s.iter().map(|t| 0.05 + 0.02 * t).collect(),
        );
        let pressure_pa = time_s.iter().map(|t| 2e5 + 5e4 * (3.0 * t).sin());
        record.set(PRESSURE_PA, pressure_pa.collect());
        let begun_n = {
            let records = [Cow::Borrowed(&record)];
            let forces = Forces::new(&rig, &records, Force::Read).expect("driven");
            forces.begun_n(share)
        };
        let force_n = begun_n.expect("forces").iter().map(|n| n.least_n).collect();
        record.set(FORCE_N, force_n);
        let prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        let prepared = &prepared[0];
        let records = prepared.ways(&rig);
        let forces = Forces::new(&rig, &records, Force::Read).expect("driven");
        let residuals = |forces: &[ForceRange]| force_residuals(prepared, forces);
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let settled = residuals(&forces.settled_n().expect("forces"));
        let settled = settled.expect("residuals").values;
        let best = prepared.begun((&rig, Force::Read), &[], None, residuals);
        let best = best.expect("residuals").values;
        let (best, told) = best.split_at(best.len() - UNKNOWNS);
        assert!(best.len() > 200, "{}", best.len());
        assert!(largest(&settled) > 10.0, "{}", largest(&settled));
        // What it costs is known to half a nat, and so is what it costs elsewhere.
        let squares: f64 = best.iter().map(|own| own * own).sum();
        assert!(0.5 * squares < 1.0, "{squares}");
        // In standard deviations of 0.5.
        assert!((told[UNKNOWNS - 1] - 2.0 * share).abs() < 0.02, "{told:?}");
        // Near that place residuals are smooth: a slope by a step that is half as long is the same.
        let begin = Begin::found(&forces, told[UNKNOWNS - 1], residuals);
        let begin = begin.expect("a memory");
        let near = |larger: f64| {
            let mut rig = rig.clone();
            rig.effects[0].values[0] *= larger;
            let near = prepared.begun((&rig, Force::Read), &[], Some(&begin), residuals);
            DVector::from_vec(near.expect("residuals").values)
        };
        let own = near(1.0);
        let slopes = [1e-3, 5e-4].map(|step| (near(1.0 + step) - &own) / step);
        let apart = (&slopes[0] - &slopes[1]).norm() / slopes[0].norm();
        assert!(slopes[0].norm() > 1.0 && apart < 1e-3, "{apart}");
    }

    /// Noise to and fro is no motion: at rest a hysteresis keeps its force, of which a measured
    /// contraction as it is would take half in three seconds.
    #[test]
    fn noise_at_rest_does_not_take_a_memory() {
        let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
        let effect = "[[effect]]\nname = \"hysteresis\"\nform = \"bouc-wen\"\nforce_n = 20.0\n\
                      reach = 0.01\nsharpness = 2.0\nbase_share = 1.0\n";
        let rig = Rig::parse("rig.toml", &(text + effect)).expect("a rig");
        let time_s: Vec<f64> = (0..400).map(|row| 0.01 * f64::from(row)).collect();
        let mut random = Pcg64::seed_from_u64(3);
        let noise = Normal::new(0.0, 1e-4).expect("a spread");
        let read = time_s.iter().map(|t| 0.05 + 0.1 * t.min(1.0));
        let read = read
            .map(|place| place + noise.sample(&mut random))
            .collect();
        let mut record = Record::new(time_s);
        record.set(CONTRACTION, read);
        let wave =
            |size: f64| (0..400).map(move |row| size * (1.0 + 0.1 * (0.1 * f64::from(row)).sin()));
        record.set(PRESSURE_PA, wave(3e5).collect());
        record.set(FORCE_N, wave(100.0).collect());
        let prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        let without = Rig::parse(
            "rig.toml",
            &Rig::REFERENCE_TOML.replace("weight\"", "prescribed\""),
        );
        let without = without.expect("a rig");
        let lost_n = |records: &[Cow<Record>]| {
            let of_effect_n = |row: usize| {
                let [with, without] = [&rig, &without].map(|rig| {
                    let forces = Forces::new(rig, records, Force::True).expect("driven");
                    forces.settled_n().expect("forces")[row].least_n
                });
                with - without
            };
            (of_effect_n(105) - of_effect_n(399)).abs()
        };
        let lost_n = [
            lost_n(&prepared[0].ways(&rig)),
            lost_n(&[Cow::Borrowed(&record)]),
        ];
        assert!(lost_n[0] < 0.5 && lost_n[1] > 5.0, "{lost_n:?}");
    }

    /// Noise in the pressure of which the force is made does not make its slope look smaller: α is
    /// found, beside γ, to within its error in the mean of sixteen records. Of the pressure as it
    /// is read it would be too small by the noise's share of its variance, 1 in 300.
    #[test]
    fn noise_of_the_pressure_takes_nothing_from_the_slope() {
        let found = (0..16).map(share_and_error_of_alpha);
        let sums = found.fold([0.0, 0.0], |sums, own| [sums[0] + own[0], sums[1] + own[1]]);
        let [share, error] = sums.map(|sum| sum / 16.0);
        let dilution = 2.0 * (MUCH_NOISE_PA / MOVES_PA).powi(2);
        assert!(error < 0.2 * dilution, "{error}");
        assert!(share.abs() < 3.0 * error / 4.0, "{share} ± {error} / 4");
    }

    const MOVES_PA: f64 = 5e4;
    const MUCH_NOISE_PA: f64 = 2000.0;

    /// By which share α is found too large, and the standard error of that.
    fn share_and_error_of_alpha(seed: u64) -> [f64; 2] {
        let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
        let rig = Rig::parse("rig.toml", &text).expect("a rig");
        let time_s: Vec<f64> = (0..4000).map(|row| 0.01 * f64::from(row)).collect();
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut noise = |sd: f64| Normal::new(0.0, sd).expect("a deviation").sample(&mut rng);
        let mut record = Record::new(time_s.clone());
        let contraction = time_s.iter().map(|t| 0.1 + 0.05 * (0.9 * t).sin());
        let contraction: Vec<f64> = contraction.collect();
        let pressure_pa = time_s.iter().map(|t| 2e5 + MOVES_PA * (1.7 * t).sin());
        let pressure_pa: Vec<f64> = pressure_pa.collect();
        let pairs = contraction.iter().zip(&pressure_pa);
        let force_n = pairs.map(|(contraction, pressure_pa)| {
            let pressure = GaugePa(*pressure_pa);
            rig.nominal.muscle.force_n(*contraction, pressure) + noise(0.5)
        });
        record.set(FORCE_N, force_n.collect());
        let read_pa = pressure_pa.iter().map(|pa| pa + noise(MUCH_NOISE_PA));
        record.set(PRESSURE_PA, read_pa.collect());
        record.set(CONTRACTION, contraction);
        let prepared = Prepared::all(&rig, [&record].into_iter(), None).expect("prepared");
        let missed = |rig: &Rig| {
            let ways = prepared[0].ways(rig);
            let forces = Forces::new(rig, &ways, Force::Read).expect("driven");
            let residuals = force_residuals(&prepared[0], &forces.settled_n().expect("forces"));
            DVector::from_vec(residuals.expect("residuals").values)
        };
        let own = missed(&rig);
        let slope = |change: &dyn Fn(&mut Rig)| {
            let mut other = rig.clone();
            change(&mut other);
            (missed(&other) - &own) / 1e-3
        };
        let by_alpha = slope(&|rig| rig.nominal.muscle.alpha_m2 *= 1.001);
        let by_gamma = slope(&|rig| rig.nominal.muscle.gamma_n += 1e-3);
        let slopes = nalgebra::DMatrix::from_columns(&[by_alpha, by_gamma]);
        let covariance = (slopes.transpose() * &slopes)
            .try_inverse()
            .expect("a slope");
        let found = -(&covariance * slopes.transpose() * own)[0];
        [found, covariance[(0, 0)].sqrt()]
    }

    /// About the rig whose residuals have a mean square of 1, the sum of squares changes with the
    /// rig as the negative log density does, in which a larger noise has its price.
    #[test]
    fn a_larger_noise_is_not_rewarded() {
        let rows = 400;
        let raw = |row: usize| (12.9898 * row as f64).sin();
        let rms = ((0..rows).map(|row| raw(row).powi(2)).sum::<f64>() / rows as f64).sqrt();
        let nominal_noise = |row: usize| 1.0 + 0.5 * (0.7 * row as f64).cos();
        let misfit = |row: usize| nominal_noise(row) * raw(row) / rms;
        let noise = |row: usize, by: f64| nominal_noise(row) * (1.0 + by * (row % 5) as f64);
        let squares = |by: f64| {
            let of = |row| Weighed {
                value: misfit(row),
                slack: 0.0,
                noise: noise(row, by),
                nominal_noise: nominal_noise(row),
            };
            let residuals = weighed(&(0..rows).map(of).collect::<Vec<_>>());
            0.5 * residuals.values.iter().map(|r| r * r).sum::<f64>()
        };
        let minus_log_density = |by: f64| {
            let of = |row| 0.5 * (misfit(row) / noise(row, by)).powi(2) + noise(row, by).ln();
            (0..rows).map(of).sum::<f64>()
        };
        let slope = |of: &dyn Fn(f64) -> f64| (of(1e-4) - of(-1e-4)) / 2e-4;
        let (found, expected) = (slope(&squares), slope(&minus_log_density));
        assert!((found - expected).abs() < 1e-3, "{found}, {expected}");
        // Without the common scale it falls by as many nats as there are rows, times their mean.
        let unscaled = |by: f64| {
            let of = |row| 0.5 * (misfit(row) / noise(row, by)).powi(2);
            (0..rows).map(of).sum::<f64>()
        };
        assert!(slope(&unscaled) < expected - 100.0);
    }
}

//! The initial state of a record, estimated from the measurements of its first second.
//!
//! The same for every rig: a weight whose measured contraction shows no trend at first is at rest
//! at the measured contraction; otherwise contraction and rate are fitted. In either case pressure
//! and gas temperature are fitted. The fit minimizes the squares of simulated − measured over the
//! first half second.

use crate::design;
use crate::error::BadInput;
use crate::identify::inputs::{Inputs, above_vacuum};
use crate::record::{self, Record};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use model_discrepancy::least_squares::{
    Goal, OUTLIER, Prior, Problem, Residuals, Slopes, minimize,
};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Drive, Initial, Simulation};
use muscle_plant::subsystem::sensors::Reading;
use nalgebra::{DVector, Matrix3, Vector3};
use std::ops::ControlFlow;

/// Length of the record's beginning that is used \[s\].
const LOOK_S: f64 = 1.0;
/// Time over which the contraction of a weight at rest shows no trend \[s\].
const REST_S: f64 = 0.1;
/// No muscle contracts by its whole length in that time \[1/s\].
const RATE_PER_S_MAX: f64 = 1.0 / REST_S;
/// Time over which the simulation is fitted \[s\]: several time constants of the heat exchange
/// between gas and wall.
const FIT_S: f64 = 0.5;
/// Standard deviation of the gas temperature about the ambient one if it was not measured \[K\]: a
/// fast stroke before the record leaves some tens of kelvin at most.
const TEMPERATURE_PRIOR_K: f64 = 10.0;
/// Least temperature of the fit \[K\]: air condenses below.
const TEMPERATURE_K_MIN: f64 = 80.0;
/// Least number of samples in each of these times.
const SAMPLES_MIN: usize = 6;
/// A slope of more than this many standard errors is a motion.
const SLOPE_ERRORS: f64 = 4.0;
/// Least standard deviation of the noise: contraction \[-\], pressure \[Pa\].
const NOISE_MIN: [f64; 2] = [1e-6, 1.0];
/// Integration tolerance of the fit, fine enough for its difference quotients.
const TOLERANCE: f64 = 1e-9;
/// Difference in the unknowns, in units of [`Fit::UNITS`], for difference quotients.
const STEP: f64 = 1e-3;
/// When the fit ends: a relative decrease of the squares that moves no unknown by a noticeable
/// share of its standard error.
const GOAL: Goal = Goal {
    relative: 1e-10,
    absolute: 0.0,
    evaluations: 60,
    certain: true,
};

/// Samples of one measured signal.
#[derive(Clone, Debug, Default)]
struct Samples {
    rows: Vec<usize>,
    time_s: Vec<f64>,
    values: Vec<f64>,
}

impl Samples {
    /// The samples of a column in the record's first second.
    fn of(record: &Record, name: &str) -> Samples {
        let mut samples = Samples::default();
        let start_s = record.time_s()[0];
        let values = record.column(name).unwrap_or_default().iter();
        for (row, (time_s, value)) in record.time_s().iter().zip(values).enumerate() {
            if time_s - start_s > LOOK_S {
                break;
            }
            if !value.is_nan() {
                samples.rows.push(row);
                samples.time_s.push(time_s - start_s);
                samples.values.push(*value);
            }
        }
        samples
    }

    /// Number of samples in the first `span_s`, but at least [`SAMPLES_MIN`] if there are as many.
    fn within(&self, span_s: f64) -> usize {
        let count = self.time_s.partition_point(|time_s| *time_s <= span_s);
        count.max(SAMPLES_MIN).min(self.values.len())
    }

    /// Standard deviation of the noise, from the median magnitude of second differences: a smooth
    /// signal contributes little to them, and a few jumps do not move their median.
    fn noise(&self) -> f64 {
        let triples = self.values.windows(3);
        let mut differences: Vec<f64> = triples.map(|v| (v[0] - 2.0 * v[1] + v[2]).abs()).collect();
        if differences.is_empty() {
            return 0.0;
        }
        differences.sort_by(f64::total_cmp);
        // Second differences of white noise have the standard deviation σ√6, and their median
        // magnitude is 0.6745 of that.
        differences[differences.len() / 2] / (0.6745 * 6.0_f64.sqrt())
    }
}

/// Contraction and its rate \[1/s\] at the first row, from the first samples of the contraction.
fn contraction_and_rate(samples: &Samples) -> (f64, f64) {
    let count = samples.within(REST_S);
    let (time_s, values) = (&samples.time_s[..count], &samples.values[..count]);
    let size = count as f64;
    let mean = values.iter().sum::<f64>() / size;
    let mean_s = time_s.iter().sum::<f64>() / size;
    let spread: f64 = time_s.iter().map(|t| (t - mean_s).powi(2)).sum();
    let products = time_s.iter().zip(values).map(|(t, v)| (t - mean_s) * v);
    let slope = if spread > 0.0 {
        products.sum::<f64>() / spread
    } else {
        0.0
    };
    let noise = samples.noise().max(NOISE_MIN[0]);
    if slope.abs() <= SLOPE_ERRORS * noise / spread.sqrt() {
        return (mean, 0.0);
    }
    // The weight moves: the fit starts from a parabola's value and slope.
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, v) in time_s.iter().zip(values) {
        let powers = Vector3::new(1.0, *t, t * t);
        normal += powers * powers.transpose();
        right += powers * *v;
    }
    match normal.lu().solve(&right) {
        Some(parabola) => (parabola[0], parabola[1]),
        None => (mean - slope * mean_s, slope),
    }
}

/// The pressure at which the valve holds the muscle: the reference, at most the supply.
///
/// # Errors
/// The rig has no valve.
pub(crate) fn held_pressure(rig: &Rig, drive: &Drive) -> Result<GaugePa<f64>, BadInput> {
    let nominal = rig.require_valve()?.supply_pressure;
    let supply_pa = drive.supply.map_or(nominal.0, |supply| supply.value);
    Ok(GaugePa(drive.reference.0.min(supply_pa).max(0.0)))
}

/// The contraction at which the weight hangs on the muscle \[-\]; 0 on its stop, and without a
/// weight.
pub(crate) fn hanging_contraction(rig: &Rig, pressure: GaugePa<f64>) -> f64 {
    match &rig.nominal.load {
        Load::Weight(weight) => {
            design::equilibrium(&rig.nominal.muscle, pressure, weight.mass_kg).unwrap_or(0.0)
        }
        Load::Prescribed => 0.0,
    }
}

/// The initial state for a simulation of `rig` with the `inputs` of `record`.
///
/// # Errors
/// The rig lacks a section that the record asks for, or the first pressure is below vacuum.
pub(crate) fn estimate(rig: &Rig, record: &Record, inputs: &Inputs) -> Result<Initial, BadInput> {
    let plant = rig.plant(inputs.simulated)?;
    let time_s = record.time_s()[0];
    let measured_contraction = Samples::of(record, record::CONTRACTION);
    let measured_pressure = Samples::of(record, record::PRESSURE_PA);
    let temperature = Samples::of(record, record::TEMPERATURE_K);

    let truth = |pressure_pa: f64, contraction: f64| {
        let pressure = GaugePa(pressure_pa);
        let reading = Reading {
            pressure,
            contraction,
            force_n: 0.0,
        };
        plant.sensors.truth(time_s, reading)
    };
    let pressure = match (inputs.pressure(0), measured_pressure.values.first()) {
        (Some(input), _) => input,
        (None, Some(first)) => {
            let (row, pressure) = (measured_pressure.rows[0], truth(*first, 0.0).pressure);
            above_vacuum(plant.atmospheric, record, row, pressure)?
        }
        (None, None) => held_pressure(rig, &inputs.drive(0))?,
    };
    let (contraction, contraction_rate_per_s) = match (inputs.contraction(0), &rig.nominal.load) {
        (Some(input), _) => (input, inputs.drive(0).contraction_rate_per_s),
        (None, _) if !measured_contraction.values.is_empty() => {
            let (contraction, rate) = contraction_and_rate(&measured_contraction);
            (truth(0.0, contraction).contraction.max(0.0), rate)
        }
        (None, _) => (hanging_contraction(rig, pressure), 0.0),
    };
    let start = Initial {
        time_s,
        contraction,
        contraction_rate_per_s,
        pressure,
        temperature_k: match temperature.values.first() {
            Some(first) => *first,
            None => plant.ambient_temperature_k,
        },
    };
    let moving = inputs.simulated.motion && contraction_rate_per_s != 0.0;
    let measured = [measured_contraction, measured_pressure];
    let temperature_unknown = temperature.values.is_empty();
    Ok(Fit::new(rig, inputs, start, measured, moving, temperature_unknown).solve())
}

/// The fit of the unknown part of the initial state to measurements.
struct Fit<'a> {
    rig: &'a Rig,
    inputs: &'a Inputs<'a>,
    start: Initial,
    /// Contraction and its rate are unknown.
    moving: bool,
    /// The pressure is unknown.
    pressure: bool,
    /// The gas's temperature is unknown.
    temperature: bool,
    /// Contraction and pressure: samples, and one over their noise.
    measured: [(Samples, f64); 2],
    /// Factor of all residuals. It keeps the largest residual at the start, and so every residual
    /// of a better point, within [`OUTLIER`]: there the loss is the square, and the minimum does
    /// not depend on the factor.
    scale: f64,
}

impl<'a> Fit<'a> {
    /// Units of the unknowns: contraction \[-\], its rate \[1/s\], pressure \[Pa\], temperature
    /// \[K\].
    const UNITS: [f64; 4] = [1e-3, 1e-2, 1e3, 1.0];

    fn new(
        rig: &'a Rig,
        inputs: &'a Inputs<'a>,
        start: Initial,
        [mut contraction, mut pressure]: [Samples; 2],
        moving: bool,
        temperature_unknown: bool,
    ) -> Self {
        let noise = [
            contraction.noise().max(NOISE_MIN[0]),
            pressure.noise().max(NOISE_MIN[1]),
        ];
        contraction
            .rows
            .truncate(if moving { contraction.within(FIT_S) } else { 0 });
        let fits_pressure = inputs.simulated.pressure && !pressure.values.is_empty();
        pressure.rows.truncate(if fits_pressure {
            pressure.within(FIT_S)
        } else {
            0
        });
        let temperature = fits_pressure && temperature_unknown && pressure.rows.len() > SAMPLES_MIN;
        Fit {
            rig,
            inputs,
            start,
            moving,
            pressure: fits_pressure,
            temperature,
            measured: [(contraction, 1.0 / noise[0]), (pressure, 1.0 / noise[1])],
            scale: 1.0,
        }
    }

    /// The units of the unknowns that are fitted, in the order of the coordinates.
    fn units(&self) -> Vec<f64> {
        let fitted = [self.moving, self.moving, self.pressure, self.temperature];
        let units = Self::UNITS.into_iter().zip(fitted);
        units
            .filter_map(|(unit, fitted)| fitted.then_some(unit))
            .collect()
    }

    /// The state at `x`, deviations from the start in units of [`Fit::UNITS`].
    fn initial(&self, x: &DVector<f64>) -> Initial {
        let mut initial = self.start;
        let mut deviations = x.iter();
        let mut next = |unit: f64| deviations.next().map_or(0.0, |deviation| deviation * unit);
        if self.moving {
            initial.contraction = (initial.contraction + next(Self::UNITS[0])).max(0.0);
            initial.contraction_rate_per_s += next(Self::UNITS[1]);
        }
        if self.pressure {
            initial.pressure.0 += next(Self::UNITS[2]);
        }
        if self.temperature {
            initial.temperature_k += next(Self::UNITS[3]);
        }
        initial
    }

    /// Simulated − measured in units of the noise; `None` if the simulation fails.
    fn differences(&self, x: &DVector<f64>) -> Option<Vec<f64>> {
        let [(contraction, per_contraction), (pressure, per_pressure)] = &self.measured;
        let last = contraction.rows.iter().chain(&pressure.rows).max()?;
        let plant = self.rig.plant(self.inputs.simulated).ok()?;
        let mut differences = Vec::new();
        let mut readings = Vec::with_capacity(last + 1);
        let initial = self.initial(x);
        let visit = |_: usize, simulation: &mut Simulation| {
            readings.push(simulation.read());
            ControlFlow::Continue(())
        };
        self.inputs
            .run(plant, &initial, TOLERANCE, last + 1, visit)
            .ok()?;
        for (row, value) in contraction.rows.iter().zip(&contraction.values) {
            differences.push((readings[*row].contraction - value) * per_contraction);
        }
        for (row, value) in pressure.rows.iter().zip(&pressure.values) {
            differences.push((readings[*row].pressure.0 - value) * per_pressure);
        }
        Some(differences)
    }

    fn solve(mut self) -> Initial {
        let samples = self.measured.iter().map(|(samples, _)| samples.rows.len());
        let start = DVector::zeros(self.units().len());
        if start.is_empty() || samples.sum::<usize>() < start.len() {
            return self.start;
        }
        let Some(differences) = self.differences(&start) else {
            return self.start;
        };
        let norm = DVector::from_vec(differences).norm();
        self.scale = OUTLIER / norm.max(OUTLIER);
        match minimize(&mut self, start, GOAL) {
            Some(found) => self.initial(&found.x),
            None => self.start,
        }
    }
}

impl Problem for Fit<'_> {
    fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals> {
        let differences = self.differences(x)?;
        let scaled = differences.iter().map(|difference| self.scale * difference);
        Some(Residuals::exact(scaled.collect()))
    }

    fn slopes(&mut self, x: &DVector<f64>, residuals: &Residuals) -> Option<Slopes> {
        Slopes::by_differences(x, residuals, |_| STEP, |moved| self.residuals(moved))
    }

    /// Of the temperature, which is the last coordinate; the others have none.
    fn priors(&self, x: &DVector<f64>) -> Vec<Prior> {
        let mut priors = vec![(0.0, 0.0); x.len()];
        if let (true, Some(prior)) = (self.temperature, priors.last_mut()) {
            let slope = self.scale * Self::UNITS[3] / TEMPERATURE_PRIOR_K;
            *prior = (slope * x[x.len() - 1], slope);
        }
        priors
    }

    /// Keeps the contraction at or above the weight's stop at 0, its rate within what a muscle
    /// does, beyond which the simulation has no end, and the temperature above that at which air
    /// condenses.
    fn bounded(&self, mut x: DVector<f64>) -> DVector<f64> {
        if self.moving {
            x[0] = x[0].max(-self.start.contraction / Self::UNITS[0]);
            let [least, most] = [-RATE_PER_S_MAX, RATE_PER_S_MAX]
                .map(|rate| (rate - self.start.contraction_rate_per_s) / Self::UNITS[1]);
            x[1] = x[1].clamp(least.min(0.0), most.max(0.0));
        }
        if let (true, Some(deviation)) = (self.temperature, x.as_mut_slice().last_mut()) {
            let least_k = TEMPERATURE_K_MIN - self.start.temperature_k;
            *deviation = deviation.max(least_k / Self::UNITS[3]);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOVING: Initial = Initial {
        time_s: 0.0,
        contraction: 0.08,
        contraction_rate_per_s: 0.2,
        pressure: GaugePa(2.0e5),
        temperature_k: 298.0,
    };

    /// The first second of a rig that starts from `truth`, without noise.
    fn record(rig: &Rig, truth: &Initial) -> Record {
        let time_s: Vec<f64> = (0..200).map(|row| 0.005 * f64::from(row)).collect();
        let mut record = Record::new(time_s.clone());
        record.set(record::PRESSURE_REF_PA, vec![2.5e5; time_s.len()]);
        let (mut pressure_pa, mut contraction) = (Vec::new(), Vec::new());
        let inputs = Inputs::new(rig, &record).expect("the inputs of the rig");
        let plant = rig.plant(inputs.simulated).expect("a plant");
        let visit = |_: usize, simulation: &mut Simulation| {
            let reading = simulation.read();
            pressure_pa.push(reading.pressure.0);
            contraction.push(reading.contraction);
            ControlFlow::Continue(())
        };
        let run = inputs.run(plant, truth, TOLERANCE, time_s.len(), visit);
        run.expect("a simulation");
        record.set(record::PRESSURE_PA, pressure_pa);
        record.set(record::CONTRACTION, contraction);
        record
    }

    /// A weight that noise lets begin in motion, and pressures that no valve makes: whatever rate a
    /// step asks for, one is tried that a muscle may have. Beyond, a run took minutes.
    #[test]
    fn no_rate_is_tried_that_no_muscle_has() {
        let rig = Rig::reference();
        let start = Initial {
            contraction: 0.0,
            contraction_rate_per_s: 0.03,
            ..MOVING
        };
        let record = record(&rig, &start);
        let inputs = Inputs::new(&rig, &record).expect("the inputs of the rig");
        let measured = [record::CONTRACTION, record::PRESSURE_PA];
        let measured = measured.map(|name| Samples::of(&record, name));
        let fit = Fit::new(&rig, &inputs, start, measured, true, false);
        for asked in [-1e9, 1e9] {
            let mut x = DVector::zeros(fit.units().len());
            x[1] = asked;
            let rate_per_s = fit.initial(&fit.bounded(x)).contraction_rate_per_s;
            assert!(
                (rate_per_s.abs() - RATE_PER_S_MAX).abs() < 1e-9,
                "{rate_per_s}"
            );
        }
    }

    #[test]
    fn the_state_of_a_record_that_starts_in_motion_is_recovered() {
        let rig = Rig::reference();
        let truth = MOVING;
        let record = record(&rig, &truth);
        let inputs = Inputs::new(&rig, &record).expect("the inputs of the rig");
        let initial = estimate(&rig, &record, &inputs).expect("an estimate");
        // A hundredth of the least noise, and for rate and temperature what follows from it.
        assert!((initial.contraction - truth.contraction).abs() < 1e-8);
        let rate_per_s = initial.contraction_rate_per_s;
        assert!((rate_per_s - truth.contraction_rate_per_s).abs() < 1e-6);
        assert!((initial.pressure.0 - truth.pressure.0).abs() < 1e-2);
        assert!((initial.temperature_k - truth.temperature_k).abs() < 1e-2);
    }
}

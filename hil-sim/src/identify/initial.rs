//! The initial state of a record, estimated from what it measured in its first second.
//!
//! The same way for every rig: a weight whose measured contraction shows no trend at first is at
//! rest where it was measured; else place and speed are fitted, and in either case the pressure and
//! the gas's temperature, so that the simulation of the first half second meets the measurements.

use crate::design;
use crate::error::BadInput;
use crate::identify::simulate::{Inputs, above_vacuum};
use crate::record::{self, Record};
use crate::rig::Rig;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use model_core::pressure::GaugePa;
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Initial, Simulation};
use muscle_plant::subsystem::sensors::Reading;
use nalgebra::{DMatrix, DVector, Dyn, Matrix3, Owned, Vector3};
use std::ops::ControlFlow;

/// Only this much of a record is looked at \[s\].
const LOOK_S: f64 = 1.0;
/// In this time a weight at rest shows no trend \[s\].
const REST_S: f64 = 0.1;
/// Simulation and measurement are made to meet over this time \[s\]: some times the one in which a
/// muscle's gas takes the temperature of its wall.
const FIT_S: f64 = 0.5;
/// Standard deviation of the gas's temperature about the ambient one, where it was not measured
/// \[K\]: a fast stroke before the record leaves some tens of kelvin at most.
const TEMPERATURE_PRIOR_K: f64 = 10.0;
/// Each of these is at least so many samples.
const SAMPLES_MIN: usize = 6;
/// A slope is a motion when it is so many of its standard errors.
const SLOPE_ERRORS: f64 = 4.0;
/// Least noise assumed: contraction \[-\], pressure \[Pa\].
const NOISE_MIN: [f64; 2] = [1e-6, 1.0];
/// Integration tolerance of the fit, fine enough for its difference quotients.
const TOLERANCE: f64 = 1e-9;

/// One measured signal's samples.
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

    /// How many samples lie in the first `span_s`, but at least [`SAMPLES_MIN`] if there are.
    fn within(&self, span_s: f64) -> usize {
        let count = self.time_s.partition_point(|time_s| *time_s <= span_s);
        count.max(SAMPLES_MIN).min(self.values.len())
    }

    /// Standard deviation of the noise, from second differences (which a smooth signal leaves
    /// small) and their median (which a few jumps do not move).
    fn noise(&self) -> f64 {
        let triples = self.values.windows(3);
        let mut differences: Vec<f64> = triples.map(|v| (v[0] - 2.0 * v[1] + v[2]).abs()).collect();
        if differences.is_empty() {
            return 0.0;
        }
        differences.sort_by(f64::total_cmp);
        // Of white noise: σ√6, whose median magnitude is 0.6745 of that.
        differences[differences.len() / 2] / (0.6745 * 6.0_f64.sqrt())
    }
}

/// Value and slope \[1/s\] at time 0 of the weight, from the begin of its samples.
fn place_and_rate(samples: &Samples) -> (f64, f64) {
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
    // Moving: a parabola gives the fit its start.
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

/// The initial state for simulating `rig` with `inputs` of `record`.
///
/// # Errors
/// Rig and record do not fit together.
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
        // The valve takes the muscle to its reference, as far as the supply reaches.
        (None, None) => {
            let drive = inputs.drive(0);
            let nominal = rig.require_valve()?.supply_pressure;
            let supply_pa = drive.supply.map_or(nominal.0, |supply| supply.value);
            GaugePa(drive.reference.0.min(supply_pa).max(0.0))
        }
    };
    let (contraction, contraction_rate_per_s) = match (inputs.contraction(0), &rig.nominal.load) {
        (Some(input), _) => (input, inputs.drive(0).contraction_rate_per_s),
        (None, _) if !measured_contraction.values.is_empty() => {
            let (place, rate) = place_and_rate(&measured_contraction);
            (truth(0.0, place).contraction.max(0.0), rate)
        }
        (None, Load::Weight(weight)) => {
            let hanging = design::equilibrium(&rig.nominal.muscle, pressure, weight.mass_kg);
            (hanging.unwrap_or(0.0), 0.0)
        }
        (None, Load::Prescribed) => (0.0, 0.0),
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
    let warm = temperature.values.is_empty();
    Ok(Fit::new(rig, inputs, start, measured, moving, warm).solve())
}

/// The unknown part of the initial state, and the measurements it is to meet.
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
    /// Deviations from `start`, in units of [`Fit::UNITS`].
    parameters: DVector<f64>,
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
        warm: bool,
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
        let temperature = fits_pressure && warm && pressure.rows.len() > SAMPLES_MIN;
        let unknowns = 2 * usize::from(moving)
            + [fits_pressure, temperature]
                .map(usize::from)
                .iter()
                .sum::<usize>();
        Fit {
            rig,
            inputs,
            start,
            moving,
            pressure: fits_pressure,
            temperature,
            measured: [(contraction, 1.0 / noise[0]), (pressure, 1.0 / noise[1])],
            parameters: DVector::zeros(unknowns),
        }
    }

    fn initial(&self, parameters: &DVector<f64>) -> Initial {
        let mut initial = self.start;
        let mut values = parameters.iter();
        if self.moving {
            let place = values.next().map_or(0.0, |value| value * Self::UNITS[0]);
            let rate = values.next().map_or(0.0, |value| value * Self::UNITS[1]);
            initial.contraction = (initial.contraction + place).max(0.0);
            initial.contraction_rate_per_s += rate;
        }
        if self.pressure {
            initial.pressure.0 += values.next().map_or(0.0, |value| value * Self::UNITS[2]);
        }
        if self.temperature {
            initial.temperature_k += values.next().map_or(0.0, |value| value * Self::UNITS[3]);
        }
        initial
    }

    /// Simulation less measurement, in units of the noise; `None` where there is no simulation.
    fn differences(&self, parameters: &DVector<f64>) -> Option<DVector<f64>> {
        let [(contraction, per_contraction), (pressure, per_pressure)] = &self.measured;
        let last = contraction.rows.iter().chain(&pressure.rows).max()?;
        let plant = self.rig.plant(self.inputs.simulated).ok()?;
        let mut differences = Vec::new();
        let mut readings = Vec::with_capacity(last + 1);
        let initial = self.initial(parameters);
        let visit = |_: usize, simulation: &Simulation| {
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
        if self.temperature {
            let warmer_k = initial.temperature_k - self.start.temperature_k;
            differences.push(warmer_k / TEMPERATURE_PRIOR_K);
        }
        Some(DVector::from_vec(differences))
    }

    fn solve(self) -> Initial {
        let measured: usize = self
            .measured
            .iter()
            .map(|(samples, _)| samples.rows.len())
            .sum();
        if self.parameters.is_empty() || measured < self.parameters.len() {
            return self.start;
        }
        let (fit, report) = LevenbergMarquardt::new().with_patience(10).minimize(self);
        if report.termination.was_successful() {
            fit.initial(&fit.parameters)
        } else {
            fit.start
        }
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Fit<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        self.parameters.copy_from(parameters);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.differences(&self.parameters)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        const STEP: f64 = 1e-3;
        let base = self.residuals()?;
        let mut jacobian = DMatrix::zeros(base.len(), self.parameters.len());
        for column in 0..self.parameters.len() {
            let mut moved = self.parameters.clone();
            moved[column] += STEP;
            let change = (self.differences(&moved)? - &base) / STEP;
            jacobian.set_column(column, &change);
        }
        Some(jacobian)
    }
}

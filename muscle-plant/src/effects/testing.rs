//! Simulations for the tests of effects: the reference rig, clamped or with its weight.

use super::kind::{Effect, EffectKind};
use crate::nominal::{Load, Nominal};
use crate::simulation::{Drive, Initial, Plant, Simulated, Simulation};
use crate::subsystem::sensors::{Reading, SensorPoint};
use model_core::pressure::GaugePa;

/// Tolerance of the integrator, far below those of the tests.
pub(super) const TOLERANCE: f64 = 1e-9;
/// Interval between rows \[s\].
pub(super) const STEP_S: f64 = 0.01;
/// The reference rig with its muscle clamped.
pub(super) const CLAMPED: Nominal = Nominal {
    load: Load::Prescribed,
    ..Nominal::REFERENCE
};
/// K_G of the reference rig \[kg/(Pa·s)\].
pub(super) const FLOW_GAIN_KG_PER_PA_S: f64 = 1.3e-7;
/// Pressure of the air around the reference rig \[Pa\].
pub(super) const ATMOSPHERIC_PA: f64 = 101_325.0;

/// Inputs of a simulation, row by row.
pub(super) struct Inputs {
    /// Interval between rows \[s\].
    pub step_s: f64,
    /// Reference, held from its row on \[Pa\]; empty where the pressure is an input.
    pub reference_pa: Vec<f64>,
    /// Pressure, linear between rows \[Pa\]; only the first where it is simulated.
    pub pressure_pa: Vec<f64>,
    /// Contraction, linear between rows \[-\]; only the first with a weight.
    pub contraction: Vec<f64>,
}

/// Outputs of a simulation, row by row, as the instruments read them.
pub(super) struct Signals {
    /// Pressure \[Pa\].
    pub pressure_pa: Vec<f64>,
    /// Contraction \[-\].
    pub contraction: Vec<f64>,
    /// Force \[N\].
    pub force_n: Vec<f64>,
}

fn sampled(step_s: f64, rows: usize, value: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..rows).map(|row| value(row as f64 * step_s)).collect()
}

/// A reference by time, from 200 kPa at a contraction of 0.1.
pub(super) fn driven(seconds: f64, reference_pa: impl Fn(f64) -> f64) -> Inputs {
    driven_every(STEP_S, seconds, reference_pa)
}

/// The same with another interval between rows \[s\].
pub(super) fn driven_every(step_s: f64, seconds: f64, reference_pa: impl Fn(f64) -> f64) -> Inputs {
    let rows = (seconds / step_s).round() as usize;
    Inputs {
        step_s,
        reference_pa: sampled(step_s, rows, reference_pa),
        pressure_pa: vec![2e5; rows],
        contraction: vec![0.1; rows],
    }
}

/// A reference that steps to 300, 240, 260 and 200 kPa every 0.5 s.
pub(super) fn steps(seconds: f64) -> Inputs {
    driven(seconds, |time_s| {
        [2e5, 3e5, 2.4e5, 2.6e5][(2.0 * time_s) as usize % 4]
    })
}

/// Pressure and contraction as inputs, so that the muscle's force alone is simulated.
pub(super) fn bench(
    step_s: f64,
    rows: usize,
    contraction: impl Fn(f64) -> f64,
    pressure_pa: impl Fn(f64) -> f64,
) -> Inputs {
    Inputs {
        step_s,
        reference_pa: Vec::new(),
        pressure_pa: sampled(step_s, rows, pressure_pa),
        contraction: sampled(step_s, rows, contraction),
    }
}

/// An effect with its parameters by name.
pub(super) fn effect(kind: &'static EffectKind, form: &str, values: &[(&str, f64)]) -> Effect {
    let form = kind.form(form).expect("a form");
    assert_eq!(form.parameters.len(), values.len(), "{}", form.name);
    let value = |name| {
        let value = values.iter().find(|(known, _)| *known == name);
        value.unwrap_or_else(|| panic!("no {name}")).1
    };
    Effect {
        kind,
        form,
        values: form.parameters.iter().map(|p| value(p.name)).collect(),
    }
}

/// Difference quotient between a row and the next; 0 in the last row.
fn slope(values: &[f64], row: usize, step_s: f64) -> f64 {
    values
        .get(row + 1)
        .map_or(0.0, |next| (next - values[row]) / step_s)
}

/// The readings of a rig with `effects`, from a long rest; `None` if the plant has no solution.
pub(super) fn try_run(
    nominal: &Nominal,
    effects: &[Effect],
    inputs: &Inputs,
    tolerance: f64,
) -> Option<Signals> {
    let simulated = Simulated {
        pressure: !inputs.reference_pa.is_empty(),
        motion: matches!(nominal.load, Load::Weight(_)),
    };
    let plant = Plant::new(nominal, effects.iter().map(Effect::term), simulated).ok()?;
    let drive = |row: usize| Drive {
        reference: GaugePa(inputs.reference_pa.get(row).copied().unwrap_or(0.0)),
        contraction_rate_per_s: if simulated.motion {
            0.0
        } else {
            slope(&inputs.contraction, row, inputs.step_s)
        },
        pressure_rate_pa_per_s: if simulated.pressure {
            0.0
        } else {
            slope(&inputs.pressure_pa, row, inputs.step_s)
        },
        ..Drive::default()
    };
    let initial = Initial {
        time_s: 0.0,
        contraction: inputs.contraction[0],
        contraction_rate_per_s: drive(0).contraction_rate_per_s,
        pressure: GaugePa(inputs.pressure_pa[0]),
        temperature_k: plant.ambient_temperature_k,
    };
    let mut simulation = Simulation::new(plant, &initial, &drive(0), tolerance);
    let rows = inputs.contraction.len();
    let mut signals = Signals {
        pressure_pa: Vec::with_capacity(rows),
        contraction: Vec::with_capacity(rows),
        force_n: Vec::with_capacity(rows),
    };
    for row in 0..rows {
        let drive = drive(row);
        if !simulated.motion {
            let rate_per_s = drive.contraction_rate_per_s;
            simulation.prescribe_contraction(inputs.contraction[row], rate_per_s);
        }
        if !simulated.pressure {
            simulation.prescribe_pressure(GaugePa(inputs.pressure_pa[row]));
        }
        let reading = simulation.read();
        signals.pressure_pa.push(reading.pressure.0);
        signals.contraction.push(reading.contraction);
        signals.force_n.push(reading.force_n);
        if row + 1 < rows {
            let until_s = (row + 1) as f64 * inputs.step_s;
            simulation.advance(&drive, until_s).ok()?;
        }
    }
    Some(signals)
}

/// The readings of a rig with `effects`, from a long rest.
pub(super) fn run(nominal: &Nominal, effects: &[Effect], inputs: &Inputs) -> Signals {
    try_run(nominal, effects, inputs, TOLERANCE).expect("a plant with a solution")
}

/// Pressure readings of the clamped rig \[Pa\].
pub(super) fn pressure_pa(effects: &[Effect], inputs: &Inputs) -> Vec<f64> {
    run(&CLAMPED, effects, inputs).pressure_pa
}

/// Force readings of the clamped rig \[N\].
pub(super) fn force_n(effects: &[Effect], inputs: &Inputs) -> Vec<f64> {
    run(&CLAMPED, effects, inputs).force_n
}

/// Force that an effect adds to the clamped rig, row by row \[N\].
pub(super) fn added_n(effect: &Effect, inputs: &Inputs) -> Vec<f64> {
    let with = force_n(std::slice::from_ref(effect), inputs);
    let without = force_n(&[], inputs);
    with.iter()
        .zip(&without)
        .map(|(with, without)| with - without)
        .collect()
}

/// Pressure of the clamped rig 9.5 s after a step of the reference from 200 kPa \[Pa\].
pub(super) fn steady_pa(effects: &[Effect], reference_pa: f64) -> f64 {
    let step = driven(10.0, |time_s| if time_s < 0.5 { 2e5 } else { reference_pa });
    pressure_pa(effects, &step)[999]
}

/// Pressure of the nominal rig every 10 ms for 2 s, under a reference that is constant for 0.1 ms
/// with its value in the middle of that \[Pa\].
pub(super) fn nominal_under(reference_pa: impl Fn(f64) -> f64) -> Vec<f64> {
    let inputs = driven_every(1e-4, 2.0, |time_s| reference_pa(time_s + 0.5e-4));
    pressure_pa(&[], &inputs)
        .iter()
        .step_by(100)
        .copied()
        .collect()
}

/// Readings of sensors with `effect` for true values, and true values estimated from them.
pub(super) fn read_and_inverted(effect: &Effect, time_s: f64, truth: Reading) -> [Reading; 2] {
    let plant = Plant::new(&CLAMPED, [effect.term()], Simulated::FORCE_ONLY);
    let sensors = plant.expect("a plant").sensors;
    let point = SensorPoint {
        time_s,
        initial_length_m: sensors.initial_length_m,
        truth,
    };
    let reading = sensors.read(&point, &[]);
    [reading, sensors.truth(time_s, reading)]
}

/// True values of pressure \[Pa\] and contraction \[-\], with a force of 200 N.
pub(super) fn truth(pressure_pa: f64, contraction: f64) -> Reading {
    Reading {
        pressure: GaugePa(pressure_pa),
        contraction,
        force_n: 200.0,
    }
}

/// A polygon through corners `(time, value)`, constant before the first and after the last.
pub(super) fn through<const N: usize>(corners: [(f64, f64); N]) -> impl Fn(f64) -> f64 {
    move |time_s| {
        let after = corners.iter().position(|(corner_s, _)| *corner_s > time_s);
        match after {
            Some(0) => corners[0].1,
            None => corners[N - 1].1,
            Some(to) => {
                let ((from_s, from), (to_s, to)) = (corners[to - 1], corners[to]);
                from + (to - from) * (time_s - from_s) / (to_s - from_s)
            }
        }
    }
}

/// Largest difference of two signals.
pub(super) fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

/// Asserts that a value is within `tolerance` of the expected one.
#[track_caller]
pub(super) fn assert_near(found: f64, expected: f64, tolerance: f64, what: &str) {
    let difference = (found - expected).abs();
    assert!(
        difference <= tolerance,
        "{what}: {found}, expected {expected} to {tolerance}"
    );
}

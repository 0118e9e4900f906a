//! Tests of the generator: physics, the signature of each effect, and the cases.

mod cases;
mod gas_signatures;
mod load_signatures;
mod muscle_signatures;
mod physics;

use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::drive::Drive;
use crate::effects::{CATALOGUE, Drawn, Form};
use crate::hidden::{Hidden, Reading};
use crate::record::Run;
use crate::rig::Rig;

const PERIOD_S: f64 = 0.01;

/// A piecewise linear drive: duration, start and end of each piece.
fn pieces(pieces: &[(f64, f64, f64)]) -> Run {
    let mut reference_pa = Vec::new();
    for (duration_s, from_pa, to_pa) in pieces {
        let samples = (duration_s / PERIOD_S).round() as usize;
        for i in 0..samples {
            reference_pa.push(from_pa + (to_pa - from_pa) * i as f64 / samples as f64);
        }
    }
    reference_pa.push(pieces.last().expect("a piece").2);
    Run {
        drive: Drive {
            period_s: PERIOD_S,
            reference_pa,
            shut: Vec::new(),
        },
        unrecorded: 0,
    }
}

/// Holds, each with its duration.
fn holds(holds: &[(f64, f64)]) -> Run {
    let all: Vec<_> = holds
        .iter()
        .map(|(duration_s, pa)| (*duration_s, *pa, *pa))
        .collect();
    pieces(&all)
}

fn forms(effect: &str) -> &'static [Form] {
    CATALOGUE
        .iter()
        .find(|entry| entry.name == effect)
        .expect("an effect")
        .forms
}

fn draw(form: &Form, size: f64, rig: &Rig) -> Drawn {
    (form.draw)(size, rig, &mut Pcg64::seed_from_u64(11))
}

impl Drawn {
    fn number(&self, parameter: &str) -> f64 {
        self.parameters[parameter].as_f64().expect("a number")
    }
}

fn bare(run: &Run, rig: &Rig) -> Vec<Reading> {
    run.simulate(rig, &[])
}

fn with(run: &Run, rig: &Rig, drawn: &Drawn) -> Vec<Reading> {
    let hidden: &dyn Hidden = drawn.hidden.as_ref();
    run.simulate(rig, &[hidden])
}

/// The sample at `time_s`.
fn at(readings: &[Reading], time_s: f64) -> Reading {
    readings[(time_s / PERIOD_S).round() as usize]
}

/// A rig without dry friction: the weight comes to rest at the balance of forces.
fn frictionless() -> Rig {
    Rig {
        coulomb_friction_n: 0.0,
        static_friction_n: 0.0,
        ..Rig::default()
    }
}

/// A weight that the muscle cannot lift: contraction stays at zero.
fn isometric() -> Rig {
    Rig {
        mass_kg: 500.0,
        ..Rig::default()
    }
}

/// Measured force less Eq 1 on measured pressure and contraction.
fn force_residual_n(rig: &Rig, reading: &Reading) -> f64 {
    let area_m2 = rig.alpha_m2 * (1.0 - reading.contraction).powi(2) + rig.beta_m2;
    reading.force_n - area_m2 * reading.pressure_pa - rig.gamma_n
}

/// Residuals at the crossings of `contraction`, by direction: contracting, extending.
fn residuals_at(rig: &Rig, readings: &[Reading], contraction: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut inward, mut outward) = (Vec::new(), Vec::new());
    for two in readings.windows(2) {
        let (a, b) = (&two[0], &two[1]);
        let from = a.contraction - contraction;
        let to = b.contraction - contraction;
        if from * to > 0.0 || from == to {
            continue;
        }
        let share = from / (from - to);
        let residual_n =
            (1.0 - share) * force_residual_n(rig, a) + share * force_residual_n(rig, b);
        if to > from {
            inward.push(residual_n)
        } else {
            outward.push(residual_n)
        }
    }
    (inward, outward)
}

fn mean(values: &[f64]) -> f64 {
    assert!(!values.is_empty());
    values.iter().sum::<f64>() / values.len() as f64
}

#[track_caller]
fn near(value: f64, expected: f64, tolerance: f64) {
    let off = (value - expected).abs();
    assert!(
        off <= tolerance,
        "{value} is not {expected} within {tolerance}"
    );
}

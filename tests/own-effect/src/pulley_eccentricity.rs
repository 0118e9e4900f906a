//! `pulley-eccentricity`: the rope to the force sensor runs over a pulley that is not concentric
//! with its axle.

use muscle_plant::effects::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
use muscle_plant::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use muscle_plant::subsystem::term::Dynamics;
use muscle_plant::subsystem::{Subsystem, Term};
use std::f64::consts::TAU;

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "pulley-eccentricity",
    subsystem: Subsystem::Sensor,
    equations: &[Equation::MuscleForce, Equation::Load],
    requires: &[Requirement::MeasuredForce, Requirement::Motion],
    signature: "The force reading oscillates with contraction at a fixed period, in proportion to \
                the force.",
    test_signal: "slow triangles of contraction at two pressures; the period does not depend on \
                  pressure.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Contraction],
    compensation: CompensationMethod::Unavailable(
        "the pulley belongs to the test bench and not to the assist",
    ),
    forms: &[Form {
        name: "first-harmonic",
        parameters: &[
            Parameter::new("cosine", "1", (-0.5, 0.5), 0.05).neutral(0.0),
            Parameter::new("sine", "1", (-0.5, 0.5), 0.05).neutral(0.0),
            // A turn of more than the stroke is a gain.
            Parameter::new("turn", "1", (0.02, 0.2), 0.1)
                .log()
                .physical_max(),
        ],
        equation: "Reading = F · (1 + cosine · cos φ + sine · sin φ), φ = 2π ε/turn",
        source: "Reading = truth · (1 + cosine · cos φ + sine · sin φ) with φ = 2π · contraction \
                 / turn.",
        leaves_out: "higher harmonics",
        build: &|values| {
            Term::Sensor(Box::new(PulleyEccentricity {
                cosine: values[0],
                sine: values[1],
                turn: values[2],
            }))
        },
        observation: None,
    }],
};

struct PulleyEccentricity {
    cosine: f64,
    sine: f64,
    turn: f64,
}

impl Dynamics<SensorPoint> for PulleyEccentricity {}

impl SensorTerm for PulleyEccentricity {
    fn read(&self, point: &SensorPoint, _: &[f64], reading: &mut Reading) {
        let angle = TAU * point.truth.contraction / self.turn;
        let ripple = self.cosine * angle.cos() + self.sine * angle.sin();
        reading.force_n += ripple * point.truth.force_n;
    }
}

//! `line-dynamics`: the hose between the valve's port, where the pressure is measured, and the
//! muscle.

use super::{
    AIR_TEMPERATURE_K, EffectKind, Form, INSTANT_S, Parameter, REFERENCE_PRESSURE_PA, STATE_PA,
    lagged,
};
use crate::plant::Term;
use crate::plant::gas::GAS_CONSTANT_J_PER_KG_K;
use crate::plant::line::{LinePoint, LineTerm};
use crate::plant::muscle::{MusclePoint, MuscleTerm};
use crate::plant::term::Dynamics;
use core::f64::consts::TAU;
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;

const HOSE_VOLUME_M3: Parameter = Parameter::new("hose_volume_m3", "m³", (1e-6, 1e-3), 1e-5).log();
const PERIOD_S: Parameter = Parameter::new("period_s", "s", (0.0, 1.0), 0.05).neutral(0.0);
const DAMPING_RATIO: Parameter = Parameter::new("damping_ratio", "1", (0.01, 5.0), 0.2).log();

pub(super) const KIND: EffectKind = EffectKind {
    name: "line-dynamics",
    block: "line",
    mark: "The force lags the measured pressure, or the pressure rings at one frequency after each \
           fast change while the force does not.",
    experiment: "fast steps sampled at 1 kHz with sensors at the valve and at the muscle.",
    forms: &[
        Form {
            name: "resistance",
            parameters: &[
                Parameter::new("lag_s", "s", (0.0, 0.5), 5e-3).neutral(0.0),
                HOSE_VOLUME_M3,
            ],
            source: "A hose's volume at the port and a linear resistance behind it, stated as the \
                     lag of the muscle's pressure behind the port's. Leaves out the resistance \
                     of turbulent flow, which grows with it, and lags that change with volume.",
            build: |values| {
                Term::Line(Box::new(Resistance {
                    lag_s: values[0],
                    hose_volume_m3: values[1],
                }))
            },
        },
        Form {
            name: "inertance",
            parameters: &[PERIOD_S, DAMPING_RATIO, HOSE_VOLUME_M3],
            source: "A hose's volume at the port, then its inertance and a laminar resistance: one \
                     lump of a line (Stecki & Davis 1986). Period and damping are those of the \
                     hose's volume against a muscle that holds 300 kPa. Leaves out higher modes \
                     and turbulence.",
            build: |values| {
                Term::Line(Box::new(Inertance {
                    period_s: values[0],
                    damping_ratio: values[1],
                    hose_volume_m3: values[2],
                }))
            },
        },
        Form {
            name: "sensor-tube",
            parameters: &[PERIOD_S, DAMPING_RATIO],
            source: "The sensor at the end of a tube with a small volume: a Helmholtz resonator, \
                     which takes no air to speak of (Bergh & Tijdeman 1965, first mode). Leaves \
                     out higher modes.",
            build: |values| {
                Term::Line(Box::new(SensorTube {
                    period_s: values[0],
                    damping_ratio: values[1],
                }))
            },
        },
    ],
};

/// RT of the air in the hose \[J/kg\].
const RT_J_PER_KG: f64 = GAS_CONSTANT_J_PER_KG_K * AIR_TEMPERATURE_K;
/// Unit of the flow in states \[kg/s\].
const STATE_KG_PER_S: f64 = 1e-3;

/// The state is the port's pressure.
struct Resistance {
    lag_s: f64,
    hose_volume_m3: f64,
}

impl Resistance {
    /// Flow from the port into the muscle \[kg/s\].
    fn hose_flow_kg_per_s(&self, at: &LinePoint, port_pa: f64) -> f64 {
        // The hose's own time is this lag by the ratio of the volumes.
        let lag_s = self
            .lag_s
            .max(INSTANT_S * at.volume_m3 / self.hose_volume_m3);
        (port_pa - at.muscle.0) * at.volume_m3 / (RT_J_PER_KG * lag_s)
    }
}

impl Dynamics<LinePoint> for Resistance {
    fn states(&self) -> usize {
        usize::from(self.lag_s >= INSTANT_S)
    }

    fn settle(&self, at: &LinePoint, state: &mut [f64]) {
        state[0] = at.muscle.0 / STATE_PA;
    }

    fn rates(&self, at: &LinePoint, state: &[f64], rates: &mut [f64]) {
        let stored_kg_per_s =
            at.valve_flow_kg_per_s - self.hose_flow_kg_per_s(at, state[0] * STATE_PA);
        rates[0] = stored_kg_per_s * RT_J_PER_KG / (self.hose_volume_m3 * STATE_PA);
    }
}

impl LineTerm for Resistance {
    fn port(&self, _: &LinePoint, state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        state.first().map_or(port, |port| GaugePa(port * STATE_PA))
    }

    fn flow_kg_per_s(&self, at: &LinePoint, state: &[f64], flow_kg_per_s: f64) -> f64 {
        state.first().map_or(flow_kg_per_s, |port| {
            self.hose_flow_kg_per_s(at, port * STATE_PA)
        })
    }

    fn with_measured_pressure(&self) -> Option<Box<dyn MuscleTerm>> {
        Some(Box::new(LaggingMuscle { lag_s: self.lag_s }))
    }
}

/// A muscle whose pressure lags the measured one. The state is its pressure.
struct LaggingMuscle {
    lag_s: f64,
}

impl Dynamics<MusclePoint> for LaggingMuscle {
    fn states(&self) -> usize {
        usize::from(self.lag_s >= INSTANT_S)
    }

    fn settle(&self, at: &MusclePoint, state: &mut [f64]) {
        state[0] = at.pressure.0 / STATE_PA;
    }

    fn rates(&self, at: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        rates[0] = (at.pressure.0 / STATE_PA - state[0]) / self.lag_s;
    }

    fn follow(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        let drives = [from, to].map(|at| at.pressure.0 / STATE_PA);
        for state in state {
            *state = lagged(*state, drives, to.time_s - from.time_s, self.lag_s);
        }
    }
}

impl MuscleTerm for LaggingMuscle {
    fn force_n(&self, at: &MusclePoint, law: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        let missing_pa = state
            .first()
            .map_or(0.0, |own| at.pressure.0 - own * STATE_PA);
        force_n - law.force_per_pressure_m2(at.contraction) * missing_pa
    }
}

/// The states are the port's pressure and the flow in the hose.
struct Inertance {
    period_s: f64,
    damping_ratio: f64,
    hose_volume_m3: f64,
}

impl Inertance {
    fn rings(&self) -> bool {
        self.period_s >= TAU * INSTANT_S
    }
}

impl Dynamics<LinePoint> for Inertance {
    fn states(&self) -> usize {
        if self.rings() { 2 } else { 0 }
    }

    fn settle(&self, at: &LinePoint, state: &mut [f64]) {
        state.copy_from_slice(&[at.muscle.0 / STATE_PA, 0.0]);
    }

    fn rates(&self, at: &LinePoint, state: &[f64], rates: &mut [f64]) {
        let per_capacity_pa_per_kg = RT_J_PER_KG / self.hose_volume_m3;
        let flow_kg_per_s = state[1] * STATE_KG_PER_S;
        rates[0] = (at.valve_flow_kg_per_s - flow_kg_per_s) * per_capacity_pa_per_kg / STATE_PA;
        let angular_per_s = TAU / self.period_s;
        let driving_pa = state[0] * STATE_PA - at.muscle.0;
        // What is laminar resists a mass flow in inverse proportion to the density.
        let muscle_pa = at.muscle.0 + at.atmospheric.0;
        let thinness = (REFERENCE_PRESSURE_PA + at.atmospheric.0) / muscle_pa;
        // 1/I = ω²·(V/RT); the resistance is 2ζωI.
        rates[1] = angular_per_s * angular_per_s * driving_pa
            / (per_capacity_pa_per_kg * STATE_KG_PER_S)
            - 2.0 * self.damping_ratio * thinness * angular_per_s * state[1];
    }
}

impl LineTerm for Inertance {
    fn port(&self, _: &LinePoint, state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        state.first().map_or(port, |port| GaugePa(port * STATE_PA))
    }

    fn flow_kg_per_s(&self, _: &LinePoint, state: &[f64], flow_kg_per_s: f64) -> f64 {
        state
            .get(1)
            .map_or(flow_kg_per_s, |flow| flow * STATE_KG_PER_S)
    }
}

/// The states are the sensor's pressure and its rate over the angular frequency.
struct SensorTube {
    period_s: f64,
    damping_ratio: f64,
}

impl Dynamics<LinePoint> for SensorTube {
    fn states(&self) -> usize {
        if self.period_s >= TAU * INSTANT_S {
            2
        } else {
            0
        }
    }

    fn settle(&self, at: &LinePoint, state: &mut [f64]) {
        state.copy_from_slice(&[at.muscle.0 / STATE_PA, 0.0]);
    }

    fn rates(&self, at: &LinePoint, state: &[f64], rates: &mut [f64]) {
        let angular_per_s = TAU / self.period_s;
        let pull = at.muscle.0 / STATE_PA - state[0] - 2.0 * self.damping_ratio * state[1];
        rates[0] = angular_per_s * state[1];
        rates[1] = angular_per_s * pull;
    }
}

impl LineTerm for SensorTube {
    fn sensor(&self, _: &LinePoint, state: &[f64], sensor: GaugePa<f64>) -> GaugePa<f64> {
        state
            .first()
            .map_or(sensor, |sensor| GaugePa(sensor * STATE_PA))
    }
}

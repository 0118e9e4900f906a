//! The line: delay of the command, and hose dynamics.

use std::f64::consts::TAU;

use serde::Serialize;

use super::{Drawn, Form, between, scale};
use crate::hidden::{Hidden, Moment, Reading};
use crate::machine::GAS_CONSTANT_J_PER_KG_K;
use crate::rig::Rig;

/// The command acts later.
#[derive(Serialize)]
struct Delay {
    delay_s: f64,
}

/// To the integrator's step, so that a delayed step falls between two of its steps.
fn on_step(time_s: f64) -> f64 {
    (time_s * 1.0e4).round() * 1.0e-4
}

impl Hidden for Delay {
    fn command_time_s(&self, time_s: f64) -> f64 {
        time_s - self.delay_s
    }
}

/// A delay with dispersion, as of a long line.
#[derive(Serialize)]
struct DispersedDelay {
    delay_s: f64,
    smear_s: f64,
}

impl Hidden for DispersedDelay {
    fn states(&self) -> usize {
        3
    }
    fn command_time_s(&self, time_s: f64) -> f64 {
        time_s - self.delay_s
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.command_pa);
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let mut before_pa = reference_pa;
        for i in 0..3 {
            dx[i] = 3.0 * (before_pa - x[i]) / self.smear_s;
            before_pa = x[i];
        }
        before_pa
    }
}

/// A bus that polls the command periodically and transmits it with a delay.
#[derive(Serialize)]
struct PolledDelay {
    delay_s: f64,
    period_s: f64,
}

impl Hidden for PolledDelay {
    fn command_time_s(&self, time_s: f64) -> f64 {
        ((time_s - self.delay_s) / self.period_s).floor() * self.period_s
    }
}

pub(super) const DELAY: &[Form] = &[
    Form::standard("pure", &["delay_s"], |size, _, _| {
        Drawn::new(Delay {
            delay_s: on_step(scale(size, 0.003, 0.09)),
        })
    }),
    Form::new("dispersed", |size, _, rng| {
        let delay_s = on_step(scale(size, 0.003, 0.09));
        Drawn::new(DispersedDelay {
            delay_s,
            smear_s: delay_s * between(rng, 0.05, 0.2),
        })
    }),
    Form::new("polled", |size, _, rng| {
        let delay_s = on_step(scale(size, 0.004, 0.08));
        let period_s = on_step(delay_s * between(rng, 0.2, 0.4));
        Drawn::new(PolledDelay { delay_s, period_s })
    }),
];

/// Air column between muscle and sensor: the reading oscillates, the pressure in the muscle does
/// not.
#[derive(Serialize)]
struct Ringing {
    frequency_hz: f64,
    damping: f64,
    /// Turbulent resistance: damping that grows with the amplitude.
    turbulent_per_pa: f64,
}

impl Hidden for Ringing {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.pressure_pa;
        x[1] = 0.0;
    }
    fn heat_w(&self, heat_w: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        // no heat: only where the muscle's pressure is known and states have rates
        let angular = TAU * self.frequency_hz;
        let resistance = 2.0 * self.damping + self.turbulent_per_pa * x[1].abs() / angular;
        dx[0] = x[1];
        dx[1] = angular * (angular * (now.pressure_pa - x[0]) - resistance * x[1]);
        heat_w
    }
    fn read(&self, reading: &mut Reading, now: &Moment, x: &[f64]) {
        reading.pressure_pa += x[0] - now.pressure_pa;
    }
}

/// Volume of the valve's port, where the sensor sits too.
const PORT_M3: f64 = 8.0e-6;
/// Between isothermal and adiabatic.
const POLYTROPIC: f64 = 1.2;

/// Flow resistance of the hose between port and muscle: the pressure in the muscle lags that at the
/// valve and sensor.
#[derive(Serialize)]
struct HoseResistance {
    conductance_kg_per_pa_s: f64,
    /// Difference above which the flow grows with its root; none: laminar.
    #[serde(skip_serializing_if = "Option::is_none")]
    turbulent_above_pa: Option<f64>,
    #[serde(skip)]
    heat_j_per_kg: f64,
}

/// State: pressure of the port, gauge.
impl Hidden for HoseResistance {
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.pressure_pa;
    }
    fn valve_side_pa(&self, _: f64, x: &[f64]) -> f64 {
        x[0]
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let across_pa = x[0] - now.pressure_pa;
        let slowed = match self.turbulent_above_pa {
            None => 1.0,
            Some(above_pa) => (1.0 + across_pa.abs() / above_pa).sqrt(),
        };
        let through = self.conductance_kg_per_pa_s * across_pa / slowed;
        dx[0] = POLYTROPIC * self.heat_j_per_kg / PORT_M3 * (flow - through);
        through
    }
    fn read(&self, reading: &mut Reading, now: &Moment, x: &[f64]) {
        reading.pressure_pa += x[0] - now.pressure_pa;
    }
}

/// A hose through which a muscle of 0.1 L follows with `lag_s`.
fn hose(rig: &Rig, lag_s: f64, turbulent_above_pa: Option<f64>) -> Drawn {
    let heat_j_per_kg = GAS_CONSTANT_J_PER_KG_K * rig.ambient_temperature_k;
    let conductance_kg_per_pa_s = 1.0e-4 / (heat_j_per_kg * lag_s);
    Drawn::new(HoseResistance {
        conductance_kg_per_pa_s,
        turbulent_above_pa,
        heat_j_per_kg,
    })
}

pub(super) const DYNAMICS: &[Form] = &[
    Form::standard("ringing", &["frequency_hz", "damping"], |size, _, rng| {
        Drawn::new(Ringing {
            frequency_hz: scale(size, 30.0, 6.0),
            damping: between(rng, 0.08, 0.35),
            turbulent_per_pa: 0.0,
        })
    }),
    Form::standard(
        "ringing-turbulent",
        &["frequency_hz", "damping", "turbulent_per_pa"],
        |size, _, rng| {
            Drawn::new(Ringing {
                frequency_hz: scale(size, 30.0, 6.0),
                damping: between(rng, 0.05, 0.15),
                turbulent_per_pa: between(rng, 0.2e-5, 1.0e-5),
            })
        },
    ),
    Form::new("hose-resistance", |size, rig, _| {
        hose(rig, scale(size, 0.003, 0.025), None)
    }),
    Form::new("hose-turbulent", |size, rig, rng| {
        hose(
            rig,
            scale(size, 0.003, 0.02),
            Some(between(rng, 1.0e4, 5.0e4)),
        )
    }),
];

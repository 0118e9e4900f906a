//! The valve: lag, dead zone, flow limit.

use std::f64::consts::TAU;

use serde::Serialize;

use super::{Drawn, Form, between, choke, scale};
use crate::hidden::{Hidden, Moment};
use crate::rig::Rig;

/// First-order lags of the reference in series.
#[derive(Serialize)]
struct Lags {
    time_constant_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    second_time_constant_s: Option<f64>,
}

impl Hidden for Lags {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.command_pa);
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        dx[0] = (reference_pa - x[0]) / self.time_constant_s;
        match self.second_time_constant_s {
            None => {
                dx[1] = 0.0;
                x[0]
            }
            Some(second_s) => {
                dx[1] = (x[0] - x[1]) / second_s;
                x[1]
            }
        }
    }
}

/// A servo loop of second order.
#[derive(Serialize)]
struct SecondOrder {
    frequency_hz: f64,
    damping: f64,
}

impl Hidden for SecondOrder {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.command_pa;
        x[1] = 0.0;
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let angular = TAU * self.frequency_hz;
        dx[0] = x[1];
        dx[1] = angular * (angular * (reference_pa - x[0]) - 2.0 * self.damping * x[1]);
        x[0]
    }
}

pub(super) const LAG: &[Form] = &[
    Form::standard("first-order", &["time_constant_s"], |size, _, _| {
        Drawn::new(Lags {
            time_constant_s: scale(size, 0.003, 0.08),
            second_time_constant_s: None,
        })
    }),
    Form::new("unequal-poles", |size, _, rng| {
        let slow_s = scale(size, 0.003, 0.06);
        let fast_s = slow_s * between(rng, 0.2, 0.6);
        Drawn::new(Lags {
            time_constant_s: slow_s,
            second_time_constant_s: Some(fast_s),
        })
    }),
    Form::standard(
        "second-order",
        &["frequency_hz", "damping"],
        |size, _, rng| {
            let damping = between(rng, 0.6, 1.1);
            let lag_s = scale(size, 0.003, 0.08);
            Drawn::new(SecondOrder {
                frequency_hz: 2.0 * damping / (lag_s * TAU),
                damping,
            })
        },
    ),
];

/// Overlap of the spool: small errors do not open the valve.
#[derive(Serialize)]
struct DeadZone {
    /// Half of the zone, for filling and for venting.
    width_pa: f64,
    venting_width_pa: f64,
    #[serde(skip)]
    flow_gain_kg_per_pa_s: f64,
    #[serde(skip)]
    opened_pa: fn(error_pa: f64, width_pa: f64) -> f64,
}

fn sharp_opened_pa(error_pa: f64, width_pa: f64) -> f64 {
    (error_pa - width_pa).max(0.0)
}

/// Leaks through the overlap with the square of the error, then opens.
fn rounded_opened_pa(error_pa: f64, width_pa: f64) -> f64 {
    let corner_pa = 2.0 * width_pa;
    if error_pa < corner_pa {
        error_pa * error_pa / (2.0 * corner_pa)
    } else {
        error_pa - width_pa
    }
}

impl Hidden for DeadZone {
    fn flow_kg_per_s(&self, flow: f64, _: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let error_pa = flow / self.flow_gain_kg_per_pa_s;
        let width_pa = if flow > 0.0 {
            self.width_pa
        } else {
            self.venting_width_pa
        };
        let opened_pa = (self.opened_pa)(error_pa.abs(), width_pa);
        self.flow_gain_kg_per_pa_s * opened_pa.copysign(error_pa)
    }
}

fn dead_zone(size: f64, rig: &Rig, ratio: f64, opened_pa: fn(f64, f64) -> f64) -> Drawn {
    let width_pa = scale(size, 0.8e3, 15.0e3);
    Drawn::new(DeadZone {
        width_pa,
        venting_width_pa: ratio * width_pa,
        flow_gain_kg_per_pa_s: rig.flow_gain_kg_per_pa_s,
        opened_pa,
    })
}

pub(super) const DEAD_ZONE: &[Form] = &[
    Form::standard("sharp", &["width_pa"], |size, rig, _| {
        dead_zone(size, rig, 1.0, sharp_opened_pa)
    }),
    Form::new("rounded", |size, rig, _| {
        dead_zone(size, rig, 1.0, rounded_opened_pa)
    }),
    Form::new("asymmetric", |size, rig, rng| {
        dead_zone(size, rig, between(rng, 0.4, 0.8), sharp_opened_pa)
    }),
];

/// Flow limited by an orifice of ISO 6358, different in each direction.
#[derive(Serialize)]
struct FlowLimit {
    fill_kg_per_pa_s: f64,
    vent_kg_per_pa_s: f64,
    critical_ratio: f64,
    #[serde(skip)]
    supply_absolute_pa: f64,
    #[serde(skip)]
    atmospheric_pa: f64,
    #[serde(skip)]
    limited: fn(flow: f64, most: f64) -> f64,
}

impl Hidden for FlowLimit {
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let muscle_pa = now.pressure_pa + self.atmospheric_pa;
        let most = if flow > 0.0 {
            let open = choke(self.supply_absolute_pa, muscle_pa, self.critical_ratio);
            self.fill_kg_per_pa_s * self.supply_absolute_pa * open
        } else {
            let open = choke(muscle_pa, self.atmospheric_pa, self.critical_ratio);
            self.vent_kg_per_pa_s * muscle_pa * open
        };
        if most > 0.0 {
            (self.limited)(flow.abs(), most).copysign(flow)
        } else {
            0.0
        }
    }
}

type Limited = fn(f64, f64) -> f64;

fn flow_limit(size: f64, rig: &Rig, ratio: f64, critical_ratio: f64, limited: Limited) -> Drawn {
    let fill_kg_per_pa_s = scale(size, 1.5e-8, 0.7e-9);
    Drawn::new(FlowLimit {
        fill_kg_per_pa_s,
        vent_kg_per_pa_s: ratio * fill_kg_per_pa_s,
        critical_ratio,
        supply_absolute_pa: rig.supply_pressure_pa + rig.atmospheric_pressure_pa,
        atmospheric_pa: rig.atmospheric_pressure_pa,
        limited,
    })
}

pub(super) const FLOW_LIMIT: &[Form] = &[
    Form::standard(
        "iso6358",
        &["fill_kg_per_pa_s", "vent_kg_per_pa_s", "critical_ratio"],
        |size, rig, rng| {
            let (ratio, critical) = (between(rng, 0.7, 1.5), between(rng, 0.2, 0.5));
            flow_limit(size, rig, ratio, critical, f64::min)
        },
    ),
    Form::new("smooth", |size, rig, rng| {
        let (ratio, critical) = (between(rng, 0.7, 1.5), between(rng, 0.2, 0.5));
        flow_limit(size, rig, ratio, critical, |flow, most| {
            most * (flow / most).tanh()
        })
    }),
    // two orifices in series: the squares of what they resist add
    Form::new("series", |size, rig, rng| {
        let (ratio, critical) = (between(rng, 0.7, 1.5), between(rng, 0.2, 0.5));
        flow_limit(size, rig, ratio, critical, |flow, most| {
            flow * most / flow.hypot(most)
        })
    }),
];

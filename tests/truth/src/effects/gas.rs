//! The gas: leaks, and heat exchanged with more than the paper's wall.

use serde::Serialize;

use super::{Drawn, Form, between, choke, scale};
use crate::hidden::{Hidden, Moment};
use crate::rig::Rig;

/// In proportion to pressure.
#[derive(Serialize)]
struct LinearLeak {
    conductance_kg_per_pa_s: f64,
}

impl Hidden for LinearLeak {
    fn leak_kg_per_s(&self, now: &Moment) -> f64 {
        self.conductance_kg_per_pa_s * now.pressure_pa
    }
}

/// Through a small hole.
#[derive(Serialize)]
struct OrificeLeak {
    sonic_kg_per_pa_s: f64,
    critical_ratio: f64,
    #[serde(skip)]
    atmospheric_pa: f64,
}

impl Hidden for OrificeLeak {
    fn leak_kg_per_s(&self, now: &Moment) -> f64 {
        let absolute_pa = now.pressure_pa + self.atmospheric_pa;
        let open = choke(absolute_pa, self.atmospheric_pa, self.critical_ratio);
        // no inflow: the edges of the hole close
        if now.pressure_pa > 0.0 {
            self.sonic_kg_per_pa_s * absolute_pa * open
        } else {
            0.0
        }
    }
}

/// A crack that pressure opens.
#[derive(Serialize)]
struct CrackLeak {
    conductance_at_300_kpa_kg_per_pa_s: f64,
    power: f64,
}

impl Hidden for CrackLeak {
    fn leak_kg_per_s(&self, now: &Moment) -> f64 {
        let pressure_pa = now.pressure_pa.max(0.0);
        let open = (pressure_pa / 3.0e5).powf(self.power);
        self.conductance_at_300_kpa_kg_per_pa_s * open * pressure_pa
    }
}

/// Relative to the valve's gain, which determines the pressure drop that the leak causes.
fn conductance(size: f64, rig: &Rig) -> f64 {
    rig.flow_gain_kg_per_pa_s * scale(size, 2.0e-3, 8.0e-2)
}

pub(super) const LEAK: &[Form] = &[
    Form::standard("linear", &["conductance_kg_per_pa_s"], |size, rig, _| {
        Drawn::new(LinearLeak {
            conductance_kg_per_pa_s: conductance(size, rig),
        })
    }),
    Form::new("orifice", |size, rig, rng| {
        Drawn::new(OrificeLeak {
            sonic_kg_per_pa_s: 0.75 * conductance(size, rig),
            critical_ratio: between(rng, 0.25, 0.5),
            atmospheric_pa: rig.atmospheric_pressure_pa,
        })
    }),
    Form::new("crack", |size, rig, rng| {
        Drawn::new(CrackLeak {
            conductance_at_300_kpa_kg_per_pa_s: conductance(size, rig),
            power: between(rng, 0.3, 0.8),
        })
    }),
];

/// Heat transfer of the paper times a factor.
#[derive(Serialize)]
struct ScaledHeat {
    factor: f64,
}

impl Hidden for ScaledHeat {
    fn heat_w(&self, heat_w: f64, _: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        self.factor * heat_w
    }
}

/// Transfer that rises with the flow that stirs the gas.
#[derive(Serialize)]
struct StirredHeat {
    factor: f64,
    stirring_kg_per_s: f64,
}

impl Hidden for StirredHeat {
    fn heat_w(&self, heat_w: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let stirred = (now.flow_kg_per_s.abs() / self.stirring_kg_per_s).powf(0.6);
        (0.5 * self.factor + 0.5 * self.factor * stirred.min(4.0)).max(1.0) * heat_w
    }
}

/// Bladder and braid as a store of heat between gas and room.
#[derive(Serialize)]
struct WallHeat {
    gas_side_w_per_m2_k: f64,
    room_side_w_per_m2_k: f64,
    wall_j_per_k: f64,
}

/// State: temperature of the wall.
impl Hidden for WallHeat {
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.ambient_k;
    }
    fn heat_w(&self, _: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let into_gas_w = self.gas_side_w_per_m2_k * now.surface_m2 * (x[0] - now.temperature_k);
        let from_room_w = self.room_side_w_per_m2_k * now.surface_m2 * (now.ambient_k - x[0]);
        dx[0] = (from_room_w - into_gas_w) / self.wall_j_per_k;
        into_gas_w
    }
}

pub(super) const HEAT_EXCHANGE: &[Form] = &[
    Form::standard("scaled", &["factor"], |size, _, _| {
        Drawn::new(ScaledHeat {
            factor: scale(size, 3.0, 60.0),
        })
    }),
    Form::new("stirred", |size, _, rng| {
        Drawn::new(StirredHeat {
            factor: scale(size, 3.0, 50.0),
            stirring_kg_per_s: between(rng, 0.5e-3, 3.0e-3),
        })
    }),
    Form::new("wall-store", |size, _, rng| {
        Drawn::new(WallHeat {
            gas_side_w_per_m2_k: 100.0 * scale(size, 3.0, 60.0),
            room_side_w_per_m2_k: between(rng, 10.0, 40.0),
            wall_j_per_k: between(rng, 3.0, 25.0),
        })
    }),
];

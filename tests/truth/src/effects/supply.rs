//! Supply: a reservoir behind a restriction.

use serde::Serialize;

use super::{Drawn, Form, between, choke, scale};
use crate::hidden::{Hidden, Moment};
use crate::machine::GAS_CONSTANT_J_PER_KG_K;
use crate::rig::Rig;

/// How the reservoir is filled up again.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Refill {
    /// In proportion to what is missing; gas may flow back from the muscle.
    Linear,
    /// Through an orifice; a check valve keeps gas in the muscle.
    Orifice,
}

/// State: the reservoir's pressure, gauge.
#[derive(Serialize)]
struct Reservoir {
    reservoir_m3: f64,
    recovery_s: f64,
    refill: Refill,
    #[serde(skip)]
    supply_pa: f64,
    #[serde(skip)]
    atmospheric_pa: f64,
    #[serde(skip)]
    heat_j_per_kg: f64,
}

impl Reservoir {
    fn refill_pa_per_s(&self, reservoir_pa: f64) -> f64 {
        match self.refill {
            Refill::Linear => (self.supply_pa - reservoir_pa) / self.recovery_s,
            Refill::Orifice => {
                let upstream_pa = self.supply_pa + self.atmospheric_pa;
                let open = choke(upstream_pa, reservoir_pa + self.atmospheric_pa, 0.4);
                // the recovery is that of 100 kPa at full flow
                1.0e5 / self.recovery_s * open
            }
        }
    }
}

impl Hidden for Reservoir {
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = self.supply_pa;
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], _: &mut [f64]) -> f64 {
        reference_pa.min(x[0])
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let open_to_supply = now.reference_pa >= x[0];
        let (passed, taken) = match self.refill {
            Refill::Linear if open_to_supply => (flow, flow),
            Refill::Orifice if open_to_supply => (flow.max(0.0), flow.max(0.0)),
            _ => (flow, flow.max(0.0)),
        };
        dx[0] = self.refill_pa_per_s(x[0]) - self.heat_j_per_kg / self.reservoir_m3 * taken;
        passed
    }
}

fn reservoir(size: f64, rig: &Rig, recovery_s: f64, refill: Refill) -> Drawn {
    Drawn::new(Reservoir {
        reservoir_m3: scale(size, 2.5e-3, 0.4e-3),
        recovery_s,
        refill,
        supply_pa: rig.supply_pressure_pa,
        atmospheric_pa: rig.atmospheric_pressure_pa,
        heat_j_per_kg: GAS_CONSTANT_J_PER_KG_K * rig.ambient_temperature_k,
    })
}

/// Supply pressure falls with recent use, which is smoothed: no reservoir of its own.
#[derive(Serialize)]
struct SmoothedUse {
    drop_pa_per_kg: f64,
    recovery_s: f64,
    #[serde(skip)]
    supply_pa: f64,
}

impl Hidden for SmoothedUse {
    fn states(&self) -> usize {
        1
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], _: &mut [f64]) -> f64 {
        reference_pa.min(self.supply_pa - x[0])
    }
    fn flow_kg_per_s(&self, flow: f64, _: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        dx[0] = self.drop_pa_per_kg * flow.max(0.0) - x[0] / self.recovery_s;
        flow
    }
}

pub(super) const DROOP: &[Form] = &[
    Form::new("linear", |size, rig, rng| {
        reservoir(size, rig, between(rng, 0.5, 3.0), Refill::Linear)
    }),
    Form::new("orifice", |size, rig, rng| {
        reservoir(size, rig, between(rng, 0.5, 2.5), Refill::Orifice)
    }),
    Form::new("smoothed-use", |size, rig, rng| {
        Drawn::new(SmoothedUse {
            drop_pa_per_kg: scale(size, 3.0e7, 2.0e8),
            recovery_s: between(rng, 0.5, 3.0),
            supply_pa: rig.supply_pressure_pa,
        })
    }),
];

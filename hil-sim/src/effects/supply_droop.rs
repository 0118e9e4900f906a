//! `supply-droop`: a small reservoir behind a restriction feeds the valve.

use super::{EffectKind, Parameter};
use crate::plant::Term;
use crate::plant::gas::GAS_CONSTANT_J_PER_KG_K;
use crate::plant::supply::{SupplyPoint, SupplyTerm};
use crate::plant::term::Dynamics;
use model_core::pressure::GaugePa;

pub(super) const KIND: EffectKind = EffectKind {
    name: "supply-droop",
    block: "supply",
    parameters: &[
        Parameter {
            name: "reservoir_volume_m3",
            unit: "m³",
            min: 1e-6,
            max: 10.0,
        },
        Parameter {
            name: "recovery_time_s",
            unit: "s",
            min: 1e-3,
            max: 1e3,
        },
    ],
    mark: "Upward steps near supply pressure run short after heavy use; downward ones do not.",
    source: "Isothermal reservoir, linear restriction towards the nominal supply. Leaves out a \
             regulator's own dynamics.",
    build: |values| {
        Term::Supply(Box::new(SupplyDroop {
            reservoir_volume_m3: values[0],
            recovery_time_s: values[1],
        }))
    },
};

/// Temperature of the air in the reservoir \[K\].
const RESERVOIR_TEMPERATURE_K: f64 = 293.0;
/// Unit of the state, which is the droop \[Pa\].
const DROOP_PA: f64 = 1e5;

struct SupplyDroop {
    reservoir_volume_m3: f64,
    recovery_time_s: f64,
}

impl Dynamics<SupplyPoint> for SupplyDroop {
    fn states(&self) -> usize {
        1
    }

    fn rates(&self, at: &SupplyPoint, state: &[f64], rates: &mut [f64]) {
        let drawn_pa_per_s = at.drawn_kg_per_s * GAS_CONSTANT_J_PER_KG_K * RESERVOIR_TEMPERATURE_K
            / self.reservoir_volume_m3;
        rates[0] = drawn_pa_per_s / DROOP_PA - state[0] / self.recovery_time_s;
    }
}

impl SupplyTerm for SupplyDroop {
    fn pressure(&self, _: &SupplyPoint, state: &[f64], supply: GaugePa<f64>) -> GaugePa<f64> {
        GaugePa((supply.0 - state[0] * DROOP_PA).max(0.0))
    }
}

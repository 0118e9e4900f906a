//! `supply-droop`: a small reservoir behind a restriction feeds the valve.

use super::orifice::Orifice;
use super::{
    AIR_TEMPERATURE_K, CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form,
    Parameter, STATE_PA,
};
use crate::subsystem::gas::GAS_CONSTANT_J_PER_KG_K;
use crate::subsystem::supply::{SupplyPoint, SupplyTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::pressure::{AbsolutePa, GaugePa};

/// Volume of a reservoir whose pressure is constant, to rounding \[m³\].
const LARGE_M3: f64 = 1e9;

const RESERVOIR_VOLUME_M3: Parameter =
    Parameter::new("reservoir_volume_m3", "m³", (1e-6, LARGE_M3), 1e-3).log();

const RECOVERY_TIME_S: Parameter = Parameter::new("recovery_time_s", "s", (1e-3, 1e3), 1.0).log();

const REFILL: Parameter =
    Parameter::new("conductance_kg_per_pa_s", "kg/(Pa·s)", (1e-12, 1e-7), 2e-9).log();

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "supply-droop",
    subsystem: Subsystem::Supply,
    equations: &[Equation::Gas],
    requires: &[],
    signature: "Upward steps near supply pressure fall short after large air consumption; downward \
                ones do not.",
    test_signal: "ten large steps up in quick succession, with the supply pressure recorded.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    compensation: CompensationMethod::Unavailable("the supply cannot deliver more air than this"),
    forms: &[
        Form {
            name: "linear",
            parameters: &[RESERVOIR_VOLUME_M3.neutral(LARGE_M3), RECOVERY_TIME_S],
            source: "Isothermal reservoir with a linear restriction towards the nominal supply; \
                     air that flows back from the muscle returns to it. Leaves out the dynamics of \
                     a regulator.",
            build: |values| linear(values, false),
            observation: None,
        },
        Form {
            name: "checked",
            // No neutral value: the check valve acts with any volume.
            parameters: &[RESERVOIR_VOLUME_M3, RECOVERY_TIME_S],
            source: "The same behind a check valve, which keeps air from flowing back. Leaves out \
                     the dynamics of a regulator.",
            build: |values| linear(values, true),
            observation: None,
        },
        Form {
            name: "orifice",
            parameters: &[RESERVOIR_VOLUME_M3.neutral(LARGE_M3), REFILL],
            source: "Isothermal reservoir that the nominal supply refills through an orifice by \
                     ISO 6358-1 with a critical ratio of 0.5: a half-shut regulator. Leaves out \
                     the dynamics of a regulator.",
            build: |values| orifice(values, false),
            observation: None,
        },
        Form {
            name: "checked-orifice",
            parameters: &[RESERVOIR_VOLUME_M3, REFILL],
            source: "The same behind a check valve. Leaves out the dynamics of a regulator.",
            build: |values| orifice(values, true),
            observation: None,
        },
    ],
};

fn linear(values: &[f64], checked: bool) -> Term {
    let recovery_time_s = values[1];
    reservoir(values[0], Refill::Linear { recovery_time_s }, checked)
}

fn orifice(values: &[f64], checked: bool) -> Term {
    let orifice = Orifice {
        conductance_kg_per_pa_s: values[1],
        critical_ratio: 0.5,
    };
    reservoir(values[0], Refill::Orifice(orifice), checked)
}

fn reservoir(volume_m3: f64, refill: Refill, checked: bool) -> Term {
    Term::Supply(Box::new(Reservoir {
        volume_m3,
        refill,
        checked,
    }))
}

/// The flow that refills the reservoir.
enum Refill {
    /// Proportional to the droop.
    Linear { recovery_time_s: f64 },
    /// The flow of an orifice.
    Orifice(Orifice),
}

/// The state is the droop.
struct Reservoir {
    volume_m3: f64,
    refill: Refill,
    /// A check valve keeps air from flowing back into it.
    checked: bool,
}

impl Dynamics<SupplyPoint> for Reservoir {
    fn states(&self) -> usize {
        1
    }

    fn rates(&self, point: &SupplyPoint, state: &[f64], rates: &mut [f64]) {
        let per_mass = GAS_CONSTANT_J_PER_KG_K * AIR_TEMPERATURE_K / (self.volume_m3 * STATE_PA);
        let refill_per_s = match &self.refill {
            Refill::Linear { recovery_time_s } => state[0] / recovery_time_s,
            Refill::Orifice(orifice) => {
                let supply = AbsolutePa(point.nominal.0 + point.atmospheric.0);
                let reservoir = AbsolutePa(supply.0 - state[0] * STATE_PA);
                orifice.flow_kg_per_s(supply, reservoir) * per_mass
            }
        };
        rates[0] = point.drawn_kg_per_s * per_mass - refill_per_s;
    }
}

impl SupplyTerm for Reservoir {
    fn pressure(&self, _: &SupplyPoint, state: &[f64], supply: GaugePa<f64>) -> GaugePa<f64> {
        GaugePa((supply.0 - state[0] * STATE_PA).max(0.0))
    }

    fn checks(&self) -> bool {
        self.checked
    }
}

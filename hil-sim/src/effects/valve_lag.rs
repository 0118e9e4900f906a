//! `valve-lag`: the valve follows its reference with a first-order lag.

use super::{EffectKind, Parameter};
use crate::plant::Term;
use crate::plant::term::Dynamics;
use crate::plant::valve::{ValvePoint, ValveTerm};
use model_core::pressure::GaugePa;

pub(super) const KIND: EffectKind = EffectKind {
    name: "valve-lag",
    block: "valve",
    parameters: &[Parameter {
        name: "time_constant_s",
        unit: "s",
        min: 1e-4,
        max: 2.0,
    }],
    mark: "Every change of the pressure is rounded by the same time constant, at any amplitude.",
    source: "First-order lag of the reference. Leaves out a second-order spool.",
    build: |values| {
        Term::Valve(Box::new(ValveLag {
            time_constant_s: values[0],
        }))
    },
};

/// Unit of the state, which is the lagging reference \[Pa\].
const REFERENCE_PA: f64 = 1e5;

struct ValveLag {
    time_constant_s: f64,
}

impl Dynamics<ValvePoint> for ValveLag {
    fn states(&self) -> usize {
        1
    }

    fn settle(&self, at: &ValvePoint, state: &mut [f64]) {
        state[0] = at.reference.0 / REFERENCE_PA;
    }

    fn rates(&self, at: &ValvePoint, state: &[f64], rates: &mut [f64]) {
        rates[0] = (at.reference.0 / REFERENCE_PA - state[0]) / self.time_constant_s;
    }
}

impl ValveTerm for ValveLag {
    fn reference(&self, _: &ValvePoint, state: &[f64], _: GaugePa<f64>) -> GaugePa<f64> {
        GaugePa(state[0] * REFERENCE_PA)
    }
}

//! `leak`: air escapes from the muscle to the surroundings.

use super::{EffectKind, Parameter};
use crate::plant::Term;
use crate::plant::gas::{Exchange, GasPoint, GasTerm};
use crate::plant::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "leak",
    block: "gas",
    parameters: &[Parameter {
        name: "conductance_kg_per_pa_s",
        unit: "kg/(Pa·s)",
        min: 0.0,
        max: 1e-6,
    }],
    mark: "The pressure settles below its reference in proportion to itself, and falls with the \
           valve shut.",
    source: "Laminar leak, flow in proportion to the gauge pressure. Leaves out choking.",
    build: |values| {
        Term::Gas(Box::new(Leak {
            conductance_kg_per_pa_s: values[0],
        }))
    },
};

struct Leak {
    conductance_kg_per_pa_s: f64,
}

impl Dynamics<GasPoint> for Leak {}

impl GasTerm for Leak {
    fn exchange(&self, at: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        let gauge_pa = at.pressure.to_gauge(at.atmospheric).0;
        exchange.outflow_kg_per_s += self.conductance_kg_per_pa_s * gauge_pa.max(0.0);
    }
}

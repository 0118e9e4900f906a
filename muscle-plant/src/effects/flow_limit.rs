//! `flow-limit`: the ports of the valve limit its flow.

use super::orifice::Orifice;
use super::{CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter};
use crate::subsystem::term::Dynamics;
use crate::subsystem::valve::{ValvePoint, ValveTerm};
use crate::subsystem::{Subsystem, Term};
use model_core::pressure::AbsolutePa;

/// No limit, to rounding \[kg/(s·Pa)\].
const WIDE_KG_PER_PA_S: f64 = 1e-3;
/// No limit, to rounding \[kg/s\].
const WIDE_KG_PER_S: f64 = 1e3;

const FILLING: Parameter = Parameter::new(
    "filling_conductance_kg_per_pa_s",
    "kg/(Pa·s)",
    (1e-12, WIDE_KG_PER_PA_S),
    2e-9,
)
.log()
.neutral(WIDE_KG_PER_PA_S);
const EXHAUSTING: Parameter = Parameter {
    name: "exhausting_conductance_kg_per_pa_s",
    ..FILLING
};
/// Catalogues of pneumatic valves give 0.2 to 0.5.
const CRITICAL_RATIO: Parameter = Parameter::new("critical_ratio", "1", (0.0, 0.6), 0.3);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "flow-limit",
    subsystem: Subsystem::Valve,
    equations: &[Equation::Gas],
    requires: &[],
    signature: "The pressure rises at a limited rate after large steps and not after small ones: \
                visible in an amplitude sweep.",
    test_signal: "steps of 20, 50, 100 and 200 kPa, up and down; only the large ones become ramps.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    compensation: CompensationMethod::Unavailable("the valve cannot supply more flow than this"),
    forms: &[
        Form {
            name: "choked-orifice",
            parameters: &[FILLING, EXHAUSTING, CRITICAL_RATIO],
            source: "Upper limits of the flow by ISO 6358-1 for the supply port and the exhaust \
                     port, with sonic conductances as mass flow over upstream pressure and one \
                     critical ratio. Leaves out temperature and a rounded onset.",
            build: |values| orifices(values, false),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[FILLING, EXHAUSTING, CRITICAL_RATIO],
            source: "The choked orifices in series with the valve's linear opening, G⁻² = Σ G⁻²: \
                     resistances of turbulent flow add so. Leaves out temperature.",
            build: |values| orifices(values, true),
            observation: None,
        },
        Form {
            name: "saturation",
            parameters: &[
                Parameter::new("flow_kg_per_s", "kg/s", (1e-7, WIDE_KG_PER_S), 1e-3)
                    .log()
                    .neutral(WIDE_KG_PER_S),
            ],
            source: "One largest flow, approached as tanh. Leaves out that the flow limit grows \
                     with upstream pressure.",
            build: |values| {
                Term::Valve(Box::new(Saturation {
                    flow_kg_per_s: values[0],
                }))
            },
            observation: None,
        },
    ],
};

fn orifices(values: &[f64], rounded: bool) -> Term {
    let orifice = |conductance_kg_per_pa_s| Orifice {
        conductance_kg_per_pa_s,
        critical_ratio: values[2],
    };
    Term::Valve(Box::new(Orifices {
        filling: orifice(values[0]),
        exhausting: orifice(values[1]),
        rounded,
    }))
}

struct Orifices {
    filling: Orifice,
    exhausting: Orifice,
    rounded: bool,
}

impl Orifices {
    /// Largest flow in the direction of `flow_kg_per_s` \[kg/s\].
    fn limit_kg_per_s(&self, point: &ValvePoint, flow_kg_per_s: f64) -> f64 {
        let absolute = |pressure: f64| AbsolutePa(pressure + point.atmospheric.0);
        let port = absolute(point.port.0);
        if flow_kg_per_s > 0.0 {
            self.filling.flow_kg_per_s(absolute(point.supply.0), port)
        } else {
            self.exhausting.flow_kg_per_s(port, point.atmospheric)
        }
    }
}

impl Dynamics<ValvePoint> for Orifices {}

impl ValveTerm for Orifices {
    fn flow_kg_per_s(&self, point: &ValvePoint, _: &[f64], flow_kg_per_s: f64) -> f64 {
        if flow_kg_per_s == 0.0 {
            return 0.0;
        }
        let limit_kg_per_s = self.limit_kg_per_s(point, flow_kg_per_s);
        if self.rounded {
            let ratio = limit_kg_per_s / flow_kg_per_s;
            limit_kg_per_s.copysign(flow_kg_per_s) / (1.0 + ratio * ratio).sqrt()
        } else {
            flow_kg_per_s
                .abs()
                .min(limit_kg_per_s)
                .copysign(flow_kg_per_s)
        }
    }
}

struct Saturation {
    flow_kg_per_s: f64,
}

impl Dynamics<ValvePoint> for Saturation {}

impl ValveTerm for Saturation {
    fn flow_kg_per_s(&self, _: &ValvePoint, _: &[f64], flow_kg_per_s: f64) -> f64 {
        self.flow_kg_per_s * (flow_kg_per_s / self.flow_kg_per_s).tanh()
    }
}

//! `flow-limit`: the ports of the valve limit its flow.

use super::orifice::Orifice;
use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
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
    requires: &[Requirement::MeasuredSupply, Requirement::ReferenceStep],
    signature: "The pressure rises at a limited rate after large steps and not after small ones: \
                visible in an amplitude sweep.",
    test_signal: "steps of 20, 50, 100 and 200 kPa, up and down; only the large ones become ramps.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure],
    compensation: CompensationMethod::Unavailable("the valve cannot supply more flow than this"),
    forms: &[
        Form {
            name: "choked-orifice",
            parameters: &[FILLING, EXHAUSTING, CRITICAL_RATIO],
            equation: "|G| = min(K_G |P_r − P|, G_max); G_max = C p₁ √(1 − ((q − b)/(1 − b))²), q \
                       = max(p₂/p₁, b), b = critical_ratio; C = filling_conductance_kg_per_pa_s \
                       from supply to port, exhausting_conductance_kg_per_pa_s from port to \
                       atmosphere",
            source: "Upper limits of the flow by ISO 6358-1 for the supply port and the exhaust \
                     port, with sonic conductances as mass flow over upstream pressure and one \
                     critical ratio.",
            leaves_out: "temperature and a rounded onset",
            build: &|values| orifices(values, false),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[FILLING, EXHAUSTING, CRITICAL_RATIO],
            equation: "1/G² = 1/(K_G (P_r − P))² + 1/G_max²; G_max = C p₁ √(1 − ((q − b)/(1 − \
                       b))²), q = max(p₂/p₁, b), b = critical_ratio; C = \
                       filling_conductance_kg_per_pa_s from supply to port, \
                       exhausting_conductance_kg_per_pa_s from port to atmosphere",
            source: "The choked orifices in series with the valve's linear opening, G⁻² = Σ G⁻²: \
                     resistances of turbulent flow add so.",
            leaves_out: "temperature",
            build: &|values| orifices(values, true),
            observation: None,
        },
        Form {
            name: "saturation",
            parameters: &[
                Parameter::new("flow_kg_per_s", "kg/s", (1e-7, WIDE_KG_PER_S), 1e-3)
                    .log()
                    .neutral(WIDE_KG_PER_S),
            ],
            equation: "G = flow_kg_per_s · tanh(K_G (P_r − P)/flow_kg_per_s)",
            source: "One largest flow, approached as tanh.",
            leaves_out: "that the flow limit grows with upstream pressure",
            build: &|values| {
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

#[cfg(test)]
mod tests {
    use super::super::testing::{
        ATMOSPHERIC_PA, CLAMPED, FLOW_GAIN_KG_PER_PA_S, assert_near, driven_every, effect,
        pressure_pa,
    };
    use super::KIND;
    use crate::effects::{AIR_TEMPERATURE_K, Effect};
    use crate::subsystem::gas::{GAS_CONSTANT_J_PER_KG_K, HEAT_RATIO};

    const FILLING_KG_PER_PA_S: f64 = 2e-9;
    const EXHAUSTING_KG_PER_PA_S: f64 = 3e-9;
    /// Choked flow from the supply \[kg/s\].
    const CHOKED_KG_PER_S: f64 = FILLING_KG_PER_PA_S * (5e5 + ATMOSPHERIC_PA);

    fn ports(form: &str, critical_ratio: f64) -> Effect {
        let parameters = [
            ("filling_conductance_kg_per_pa_s", FILLING_KG_PER_PA_S),
            ("exhausting_conductance_kg_per_pa_s", EXHAUSTING_KG_PER_PA_S),
            ("critical_ratio", critical_ratio),
        ];
        effect(&KIND, form, &parameters)
    }

    /// Flow right after a step of the reference: rate of the pressure over κRθ/V, in a row of
    /// 0.1 ms, in which the pressure changes by less than 1 % of the step.
    fn flow_kg_per_s(effects: &[Effect], from_pa: f64, to_pa: f64) -> f64 {
        const ROW_S: f64 = 1e-4;
        let step_s = 39.5 * ROW_S;
        let mut inputs = driven_every(ROW_S, 80.0 * ROW_S, |t| {
            if t < step_s { from_pa } else { to_pa }
        });
        inputs.pressure_pa.fill(from_pa);
        let found_pa = pressure_pa(effects, &inputs);
        let volume_m3 = CLAMPED.volume.expect("a volume").volume_m3(0.1);
        let rate_pa_per_s = (found_pa[41] - found_pa[40]) / ROW_S;
        rate_pa_per_s * volume_m3 / (HEAT_RATIO * GAS_CONSTANT_J_PER_KG_K * AIR_TEMPERATURE_K)
    }

    #[track_caller]
    fn assert_flow(effect: Effect, [from_pa, to_pa]: [f64; 2], expected: f64, share: f64) {
        let found = flow_kg_per_s(&[effect], from_pa, to_pa);
        assert_near(found, expected, share * expected.abs(), "flow");
    }

    #[test]
    fn choked_ports_limit_large_steps_and_not_small_ones() {
        let exhausting = EXHAUSTING_KG_PER_PA_S * (3e5 + ATMOSPHERIC_PA);
        assert_flow(
            ports("choked-orifice", 0.3),
            [5e4, 2e5],
            CHOKED_KG_PER_S,
            0.01,
        );
        assert_flow(ports("choked-orifice", 0.3), [3e5, 1e5], -exhausting, 0.01);
        let small = flow_kg_per_s(&[], 5e4, 5.5e4);
        assert_flow(ports("choked-orifice", 0.3), [5e4, 5.5e4], small, 1e-6);
    }

    /// From 400 kPa the supply port is subsonic: the ellipse of ISO 6358-1.
    #[test]
    fn a_port_that_is_not_choked_follows_the_ellipse() {
        let ratio: f64 = (4e5 + ATMOSPHERIC_PA) / (5e5 + ATMOSPHERIC_PA);
        for critical_ratio in [0.3, 0.5] {
            let relative = (ratio - critical_ratio) / (1.0 - critical_ratio);
            let subsonic = CHOKED_KG_PER_S * (1.0 - relative.powi(2)).sqrt();
            let ports = ports("choked-orifice", critical_ratio);
            assert_flow(ports, [4e5, 5e5], subsonic, 0.01);
        }
    }

    #[test]
    fn rounded_and_saturated_flows_follow_their_formulas() {
        let linear = FLOW_GAIN_KG_PER_PA_S * 1e4;
        let series = linear * CHOKED_KG_PER_S / linear.hypot(CHOKED_KG_PER_S);
        assert_flow(ports("rounded", 0.3), [5e4, 6e4], series, 0.02);
        let saturation = effect(&KIND, "saturation", &[("flow_kg_per_s", 1e-3)]);
        assert_flow(saturation, [5e4, 6e4], 1e-3 * (linear / 1e-3).tanh(), 0.02);
    }
}

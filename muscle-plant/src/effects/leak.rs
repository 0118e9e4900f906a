//! `leak`: air flows between the muscle and its surroundings, towards the lower pressure.

use super::orifice::Orifice;
use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    REFERENCE_PRESSURE_PA, Requirement,
};
use crate::subsystem::gas::{Exchange, GasPoint, GasTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

const CONDUCTANCE: Parameter =
    Parameter::new("conductance_kg_per_pa_s", "kg/(Pa·s)", (0.0, 1e-6), 4e-9).neutral(0.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "leak",
    subsystem: Subsystem::Gas,
    equations: &[Equation::Gas],
    requires: &[Requirement::ReferenceHold],
    signature: "The steady pressure is below its reference in proportion to itself, and falls with \
                the valve shut.",
    test_signal: "a shut-off valve between valve and pressure sensor, shut at four pressures for \
                  60 s (`hil-sim experiment --part shut-holds`); the pressure then falls at a rate \
                  that depends on the pressure.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::Contraction],
    compensation: CompensationMethod::Unavailable(
        "it needs a raised reference for a steady flow, for which the controller has no stage",
    ),
    forms: &[
        Form {
            name: "linear",
            parameters: &[CONDUCTANCE],
            equation: "G_leak = conductance_kg_per_pa_s · P",
            source: "Laminar leak, flow proportional to the gauge pressure.",
            leaves_out: "choking",
            build: &|values| {
                Term::Gas(Box::new(Gap {
                    conductance_kg_per_pa_s: values[0],
                    power: 1.0,
                }))
            },
            observation: None,
        },
        Form {
            name: "orifice",
            parameters: &[CONDUCTANCE],
            equation: "G_leak = conductance_kg_per_pa_s · p₁ √(1 − ((q − 0.5)/0.5)²), q = \
                       max(p₂/p₁, 0.5), absolute pressures p₁ > p₂ of muscle and atmosphere",
            source: "A hole by ISO 6358-1, with the sonic conductance as mass flow over absolute \
                     pressure and a critical ratio of 0.5.",
            leaves_out: "temperature",
            build: &|values| {
                Term::Gas(Box::new(Hole(Orifice {
                    conductance_kg_per_pa_s: values[0],
                    critical_ratio: HOLE_CRITICAL_RATIO,
                })))
            },
            observation: None,
        },
        Form {
            name: "power",
            parameters: &[
                CONDUCTANCE,
                // A flow that hardly depends on the pressure is not a leak.
                Parameter::new("power", "1", (0.2, 5.0), 1.0)
                    .log()
                    .physical_min(),
            ],
            equation: "G_leak = conductance_kg_per_pa_s · 300 kPa · (P/300 kPa)^power",
            source: "Flow proportional to a power of the gauge pressure, with the conductance at \
                     300 kPa: a power of about 0.5 if turbulent, above 1 if pressure opens the \
                     gap (a tear, a seal).",
            leaves_out: "choking",
            build: &|values| {
                Term::Gas(Box::new(Gap {
                    conductance_kg_per_pa_s: values[0],
                    power: values[1],
                }))
            },
            observation: None,
        },
    ],
};

/// Pressure difference below which any leak is laminar \[Pa\]: the slope of a root is infinite at
/// 0.
const LAMINAR_PA: f64 = 100.0;
/// Critical ratio of a short hole, near that of a nozzle \[-\].
const HOLE_CRITICAL_RATIO: f64 = 0.5;

struct Gap {
    conductance_kg_per_pa_s: f64,
    power: f64,
}

impl Gap {
    /// Mass flow towards the lower pressure at a difference ≥ 0 \[kg/s\].
    fn flow_kg_per_s(&self, difference_pa: f64) -> f64 {
        let turbulent_pa = difference_pa.max(LAMINAR_PA);
        let share = (turbulent_pa / REFERENCE_PRESSURE_PA).powf(self.power);
        let laminar = difference_pa / turbulent_pa;
        self.conductance_kg_per_pa_s * REFERENCE_PRESSURE_PA * share * laminar
    }
}

impl Dynamics<GasPoint> for Gap {}

impl GasTerm for Gap {
    fn exchange(&self, point: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        let gauge_pa = point.pressure.to_gauge(point.atmospheric).0;
        let flow_kg_per_s = self.flow_kg_per_s(gauge_pa.abs());
        if gauge_pa >= 0.0 {
            exchange.outflow_kg_per_s += flow_kg_per_s;
        } else {
            exchange.inflow_kg_per_s += flow_kg_per_s;
        }
    }
}

struct Hole(Orifice);

impl Dynamics<GasPoint> for Hole {}

impl GasTerm for Hole {
    fn exchange(&self, point: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        exchange.outflow_kg_per_s += self.0.flow_kg_per_s(point.pressure, point.atmospheric);
        exchange.inflow_kg_per_s += self.0.flow_kg_per_s(point.atmospheric, point.pressure);
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        ATMOSPHERIC_PA, FLOW_GAIN_KG_PER_PA_S, assert_near, effect, steady_pa,
    };
    use super::KIND;

    const CONDUCTANCE_KG_PER_PA_S: f64 = 4e-9;
    const SIZE: (&str, f64) = ("conductance_kg_per_pa_s", CONDUCTANCE_KG_PER_PA_S);

    /// K_G (P_r − P) = g P at rest.
    #[test]
    fn a_linear_leak_lowers_the_steady_pressure_in_proportion() {
        let leak = effect(&KIND, "linear", &[SIZE]);
        let ratio = FLOW_GAIN_KG_PER_PA_S / (FLOW_GAIN_KG_PER_PA_S + CONDUCTANCE_KG_PER_PA_S);
        for reference_pa in [1e5, 3e5] {
            let expected_pa = reference_pa * ratio;
            let found_pa = steady_pa(std::slice::from_ref(&leak), reference_pa);
            assert_near(found_pa, expected_pa, 1e-4 * expected_pa, "linear");
        }
    }

    /// K_G (P_r − P) = c (P + P_a) at rest, where the flow is choked.
    #[test]
    fn a_leak_through_a_hole_chokes() {
        let hole = effect(&KIND, "orifice", &[SIZE]);
        for reference_pa in [2.5e5, 4e5] {
            let expected_pa = (FLOW_GAIN_KG_PER_PA_S * reference_pa
                - CONDUCTANCE_KG_PER_PA_S * ATMOSPHERIC_PA)
                / (FLOW_GAIN_KG_PER_PA_S + CONDUCTANCE_KG_PER_PA_S);
            let found_pa = steady_pa(std::slice::from_ref(&hole), reference_pa);
            assert_near(found_pa, expected_pa, 20.0, "orifice");
        }
    }

    /// K_G (P_r − P) = g P₀ (P/P₀)ⁿ at rest, with P₀ = 300 kPa.
    #[test]
    fn a_leak_by_a_power_law_draws_the_flow_of_its_formula() {
        for power in [0.5, 2.0] {
            let leak = effect(&KIND, "power", &[SIZE, ("power", power)]);
            for reference_pa in [1e5, 4e5] {
                let found_pa = steady_pa(std::slice::from_ref(&leak), reference_pa);
                let leaking = CONDUCTANCE_KG_PER_PA_S * 3e5 * (found_pa / 3e5).powf(power);
                let filling = FLOW_GAIN_KG_PER_PA_S * (reference_pa - found_pa);
                assert_near(filling, leaking, 1e-3 * leaking, "power");
            }
        }
    }
}

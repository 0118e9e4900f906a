//! `valve-dead-zone`: the valve does not respond to small errors of the pressure.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, DeadZoneWidths, Effect, EffectKind, Equation, Form,
    Parameter, Quantity, Requirement,
};
use crate::subsystem::term::Dynamics;
use crate::subsystem::valve::{ValvePoint, ValveTerm};
use crate::subsystem::{Subsystem, Term};
use model_core::pressure::GaugePa;

const HALF_WIDTH_PA: Parameter =
    Parameter::new("half_width_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "valve-dead-zone",
    subsystem: Subsystem::Valve,
    equations: &[Equation::Gas],
    requires: &[Requirement::ReferenceHold],
    signature: "The pressure stops short of its reference by up to the width, from either side, \
                with a slow tail.",
    test_signal: "slow ramps of the reference through five pressures, up and down, at one \
                  contraction.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure],
    compensation: CompensationMethod::ValveDeadZone(widths),
    forms: &[
        Form {
            name: "sharp",
            parameters: &[HALF_WIDTH_PA],
            equation: "Eq 9 with the error e in place of P_r − P; e = [P_r − P − half_width_pa] − \
                       [P − P_r − half_width_pa], [x] = max(x, 0)",
            source: "A spool with the same overlap on both sides.",
            leaves_out: "leakage past the overlap",
            build: &|values| dead_zone(values[0], values[0], 0.0),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[
                HALF_WIDTH_PA,
                Parameter::new("rounding_pa", "Pa", (0.0, 2e5), 3e3),
            ],
            equation: "Eq 9 with the error e in place of P_r − P; e = [P_r − P − half_width_pa] − \
                       [P − P_r − half_width_pa], [x] = (x + √(x² + rounding_pa²))/2",
            source: "Hyperbolas about the corners of the sharp dead zone: leakage past the \
                     overlap.",
            leaves_out: "a gain that differs near the edge",
            build: &|values| dead_zone(values[0], values[0], values[1]),
            observation: None,
        },
        Form {
            name: "asymmetric",
            parameters: &[
                Parameter::new("filling_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0),
                Parameter::new("exhausting_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0),
            ],
            equation: "Eq 9 with the error e in place of P_r − P; e = [P_r − P − filling_pa] − [P \
                       − P_r − exhausting_pa], [x] = max(x, 0)",
            source: "A spool with different overlaps at its supply port and its exhaust port.",
            leaves_out: "leakage past the overlap",
            build: &|values| dead_zone(values[0], values[1], 0.0),
            observation: None,
        },
    ],
};

fn widths(effect: &Effect) -> DeadZoneWidths {
    let either_pa = effect.value("half_width_pa").unwrap_or(0.0);
    DeadZoneWidths {
        filling_pa: either_pa + effect.value("filling_pa").unwrap_or(0.0),
        exhausting_pa: either_pa + effect.value("exhausting_pa").unwrap_or(0.0),
    }
}

fn dead_zone(filling_pa: f64, exhausting_pa: f64, rounding_pa: f64) -> Term {
    Term::Valve(Box::new(DeadZone {
        filling_pa,
        exhausting_pa,
        rounding_pa,
    }))
}

struct DeadZone {
    filling_pa: f64,
    exhausting_pa: f64,
    rounding_pa: f64,
}

impl DeadZone {
    /// The part of `error_pa` beyond an edge at 0.
    fn beyond(&self, error_pa: f64) -> f64 {
        if self.rounding_pa == 0.0 {
            return error_pa.max(0.0);
        }
        // Not `hypot`: its guard against overflow costs time and is not needed for pressures.
        let root_pa = (error_pa * error_pa + self.rounding_pa * self.rounding_pa).sqrt();
        0.5 * (error_pa + root_pa)
    }
}

impl Dynamics<ValvePoint> for DeadZone {}

impl ValveTerm for DeadZone {
    fn ported(&self, point: &ValvePoint, reference: GaugePa<f64>) -> GaugePa<f64> {
        let error_pa = reference.0 - point.port.0;
        let effective_pa =
            self.beyond(error_pa - self.filling_pa) - self.beyond(-error_pa - self.exhausting_pa);
        GaugePa(point.port.0 + effective_pa)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        assert_near, driven, effect, largest_difference, pressure_pa, steady_pa, steps,
    };
    use super::super::valve_lag;
    use super::KIND;

    #[test]
    fn the_pressure_stops_short_of_its_reference_from_either_side() {
        let sharp = [effect(&KIND, "sharp", &[("half_width_pa", 8e3)])];
        assert_near(steady_pa(&sharp, 3e5), 2.92e5, 1.0, "up");
        assert_near(steady_pa(&sharp, 1e5), 1.08e5, 1.0, "down");
        let widths = [("filling_pa", 5e3), ("exhausting_pa", 12e3)];
        let asymmetric = [effect(&KIND, "asymmetric", &widths)];
        assert_near(steady_pa(&asymmetric, 3e5), 2.95e5, 1.0, "up");
        assert_near(steady_pa(&asymmetric, 1e5), 1.12e5, 1.0, "down");
    }

    #[test]
    fn leakage_past_a_rounded_dead_zone_continues_slowly() {
        let parameters = [("half_width_pa", 8e3), ("rounding_pa", 1e3)];
        let rounded = [effect(&KIND, "rounded", &parameters)];
        let early = driven(0.7, |time_s| if time_s < 0.5 { 2e5 } else { 3e5 });
        let early_pa = pressure_pa(&rounded, &early)[69];
        assert_near(early_pa, 2.92e5, 2e3, "0.2 s after the step");
        assert!(steady_pa(&rounded, 3e5) > 2.94e5);
    }

    /// The spool lags and its ports overlap, in whatever order the effects were added.
    #[test]
    fn a_lagging_valve_keeps_its_dead_zone() {
        let half_width_pa = 1e4;
        let lag = effect(
            &valve_lag::KIND,
            "first-order",
            &[("time_constant_s", 0.05)],
        );
        let zone = effect(&KIND, "sharp", &[("half_width_pa", half_width_pa)]);
        let with = |effects: &[_]| pressure_pa(effects, &steps(20.0));
        let both_pa = with(&[lag.clone(), zone.clone()]);
        assert!(largest_difference(&both_pa, &with(&[zone.clone(), lag.clone()])) < 1.0);
        assert!(largest_difference(&both_pa, &with(&[lag])) > 0.9 * half_width_pa);
        assert!(largest_difference(&both_pa, &with(&[zone])) > 0.9 * half_width_pa);
    }
}

//! `valve-dead-zone`: the valve does not respond to small errors of the pressure.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, DeadZoneWidths, Effect, EffectKind, Equation, Form,
    Parameter,
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
    requires: &[],
    signature: "The pressure stops short of its reference by up to the width, from either side, \
                with a slow tail.",
    test_signal: "slow ramps of the reference through five pressures, up and down, at one \
                  contraction.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    compensation: CompensationMethod::ValveDeadZone(widths),
    forms: &[
        Form {
            name: "sharp",
            parameters: &[HALF_WIDTH_PA],
            source: "A spool with the same overlap on both sides. Leaves out leakage past the \
                     overlap.",
            build: |values| dead_zone(values[0], values[0], 0.0),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[
                HALF_WIDTH_PA,
                Parameter::new("rounding_pa", "Pa", (0.0, 2e5), 3e3),
            ],
            source: "Hyperbolas about the corners of the sharp dead zone: leakage past the \
                     overlap. Leaves out a gain that differs near the edge.",
            build: |values| dead_zone(values[0], values[0], values[1]),
            observation: None,
        },
        Form {
            name: "asymmetric",
            parameters: &[
                Parameter::new("filling_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0),
                Parameter::new("exhausting_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0),
            ],
            source: "A spool with different overlaps at its supply port and its exhaust port. \
                     Leaves out leakage past the overlap.",
            build: |values| dead_zone(values[0], values[1], 0.0),
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

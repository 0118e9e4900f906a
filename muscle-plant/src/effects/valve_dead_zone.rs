//! `valve-dead-zone`: the valve does not answer to small errors of the pressure.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::term::Dynamics;
use crate::subsystem::valve::{ValvePoint, ValveTerm};
use model_core::pressure::GaugePa;

const HALF_WIDTH_PA: Parameter =
    Parameter::new("half_width_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "valve-dead-zone",
    place: "valve",
    signature: "The pressure stops short of its reference by up to the width, from either side, with a \
           slow tail.",
    test_signal: "slow ramps of the reference through five pressures, up and down, at one \
                 contraction.",
    forms: &[
        Form {
            name: "sharp",
            parameters: &[HALF_WIDTH_PA],
            source: "A spool that overlaps its ports by the same on both sides. Leaves out what \
                     leaks past the overlap.",
            build: |values| dead_zone(values[0], values[0], 0.0),
        },
        Form {
            name: "rounded",
            parameters: &[
                HALF_WIDTH_PA,
                Parameter::new("rounding_pa", "Pa", (0.0, 2e5), 3e3),
            ],
            source: "Hyperbolas about the corners of the sharp one: a little leaks past the \
                     overlap. Leaves out a gain that differs near the edge.",
            build: |values| dead_zone(values[0], values[0], values[1]),
        },
        Form {
            name: "asymmetric",
            parameters: &[
                Parameter::new("filling_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0),
                Parameter::new("exhausting_pa", "Pa", (0.0, 2e5), 8e3).neutral(0.0),
            ],
            source: "A spool that overlaps its supply port and its exhaust port differently. \
                     Leaves out what leaks past the overlap.",
            build: |values| dead_zone(values[0], values[1], 0.0),
        },
    ],
};

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
    /// What is left of `error_pa` beyond an edge at 0.
    fn beyond(&self, error_pa: f64) -> f64 {
        if self.rounding_pa == 0.0 {
            return error_pa.max(0.0);
        }
        // Not `hypot`, which guards against pressures that none has, and takes its time.
        let root_pa = (error_pa * error_pa + self.rounding_pa * self.rounding_pa).sqrt();
        0.5 * (error_pa + root_pa)
    }
}

impl Dynamics<ValvePoint> for DeadZone {}

impl ValveTerm for DeadZone {
    fn ported(&self, at: &ValvePoint, reference: GaugePa<f64>) -> GaugePa<f64> {
        let error_pa = reference.0 - at.port.0;
        let left_pa =
            self.beyond(error_pa - self.filling_pa) - self.beyond(-error_pa - self.exhausting_pa);
        GaugePa(at.port.0 + left_pa)
    }
}

//! `transport-delay`: the reference reaches the valve late.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::line::{LinePoint, LineTerm};
use crate::plant::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "transport-delay",
    block: "line",
    mark: "Nothing moves for a fixed time after each change of the reference.",
    experiment: "steps sampled at 1 kHz; a delay leaves a flat beginning, a lag none.",
    forms: &[Form {
        name: "pure",
        parameters: &[Parameter::new("delay_s", "s", (0.0, 1.0), 0.03).neutral(0.0)],
        source: "Pure delay of the command. Leaves out the rounding of a long hose.",
        build: |values| Term::Line(Box::new(TransportDelay { delay_s: values[0] })),
    }],
};

struct TransportDelay {
    delay_s: f64,
}

impl Dynamics<LinePoint> for TransportDelay {}

impl LineTerm for TransportDelay {
    fn delay_s(&self) -> f64 {
        self.delay_s
    }
}

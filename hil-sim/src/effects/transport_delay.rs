//! `transport-delay`: the reference reaches the valve late.

use super::{EffectKind, Parameter};
use crate::plant::Term;
use crate::plant::line::{LinePoint, LineTerm};
use crate::plant::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "transport-delay",
    block: "line",
    parameters: &[Parameter {
        name: "delay_s",
        unit: "s",
        min: 0.0,
        max: 1.0,
    }],
    mark: "Nothing moves for a fixed time after each change of the reference.",
    source: "Pure delay of the command. Leaves out the rounding of a long hose.",
    build: |values| Term::Line(Box::new(TransportDelay { delay_s: values[0] })),
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

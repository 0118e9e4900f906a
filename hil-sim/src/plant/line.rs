//! The line block: the command line's delay, and the hose between valve and muscle.
//!
//! The nominal line is ideal: no delay, and the pressure at the valve's port, which the sensor
//! reads, is the muscle's.

use super::term::{Dynamics, Terms};
use model_core::pressure::GaugePa;

/// What a term of the line block sees.
#[derive(Clone, Copy, Debug)]
pub struct LinePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Pressure in the muscle.
    pub muscle: GaugePa<f64>,
    /// Mass flow from the valve into the line \[kg/s\]; zero where `settle` asks.
    pub valve_flow_kg_per_s: f64,
}

/// A term of the line block.
pub trait LineTerm: Dynamics<LinePoint> + Send + Sync {
    /// Time that the reference takes to the valve \[s\].
    fn delay_s(&self) -> f64 {
        0.0
    }

    /// Pressure at the valve's end, from the one that comes to the term. It must not read
    /// [`LinePoint::valve_flow_kg_per_s`], which follows from it.
    fn port(&self, _at: &LinePoint, _state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        port
    }

    /// Mass flow into the muscle, from the flow that comes to the term \[kg/s\].
    fn flow_kg_per_s(&self, _at: &LinePoint, _state: &[f64], flow_kg_per_s: f64) -> f64 {
        flow_kg_per_s
    }
}

/// The line.
#[derive(Default)]
pub struct LineBlock {
    /// Added effects.
    pub terms: Terms<dyn LineTerm>,
}

impl LineBlock {
    /// Time that the reference takes to the valve \[s\].
    pub fn delay_s(&self) -> f64 {
        self.terms.iter(&[]).map(|(term, _)| term.delay_s()).sum()
    }

    /// Pressure at the valve's port.
    #[inline]
    pub fn port(&self, at: &LinePoint, state: &[f64]) -> GaugePa<f64> {
        self.terms
            .change(at, state, at.muscle, |term, at, own, port| {
                term.port(at, own, port)
            })
    }

    /// Mass flow into the muscle \[kg/s\].
    #[inline]
    pub fn flow_kg_per_s(&self, at: &LinePoint, state: &[f64]) -> f64 {
        let flow = at.valve_flow_kg_per_s;
        self.terms.change(at, state, flow, |term, at, own, flow| {
            term.flow_kg_per_s(at, own, flow)
        })
    }
}

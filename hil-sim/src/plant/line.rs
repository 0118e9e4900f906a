//! The line block: the command line's delay, and the hose between valve and muscle.
//!
//! The nominal line is ideal: no delay, and the pressure at the valve's port, which the sensor
//! reads, is the muscle's.

use super::muscle::MuscleTerm;
use super::term::{Dynamics, Terms};
use model_core::pressure::{AbsolutePa, GaugePa};

/// What a term of the line block sees.
#[derive(Clone, Copy, Debug)]
pub struct LinePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Pressure in the muscle.
    pub muscle: GaugePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
    /// Volume of the muscle \[m³\].
    pub volume_m3: f64,
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

    /// Pressure at the sensor, from the one that comes to the term: the port's, which it sits on.
    fn sensor(&self, _at: &LinePoint, _state: &[f64], sensor: GaugePa<f64>) -> GaugePa<f64> {
        sensor
    }

    /// What the term leaves of itself where the sensor's pressure is an input: a term on the force,
    /// of a muscle whose pressure is not quite the one that was measured.
    fn with_measured_pressure(&self) -> Option<Box<dyn MuscleTerm>> {
        None
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
        self.terms.all().map(LineTerm::delay_s).sum()
    }

    /// Pressure at the valve's port.
    #[inline]
    pub fn port(&self, at: &LinePoint, state: &[f64]) -> GaugePa<f64> {
        if self.terms.is_empty() {
            return at.muscle;
        }
        self.port_with_terms(*at, state)
    }

    #[inline(never)]
    fn port_with_terms(&self, at: LinePoint, state: &[f64]) -> GaugePa<f64> {
        let mut port = at.muscle;
        for (term, own) in self.terms.iter(state) {
            port = term.port(&at, own, port);
        }
        port
    }

    /// Pressure at the sensor.
    pub fn sensor(&self, at: &LinePoint, state: &[f64]) -> GaugePa<f64> {
        let mut sensor = self.port(at, state);
        for (term, own) in self.terms.iter(state) {
            sensor = term.sensor(at, own, sensor);
        }
        sensor
    }

    /// Mass flow into the muscle \[kg/s\].
    #[inline]
    pub fn flow_kg_per_s(&self, at: &LinePoint, state: &[f64]) -> f64 {
        if self.terms.is_empty() {
            return at.valve_flow_kg_per_s;
        }
        self.with_terms_kg_per_s(*at, state)
    }

    #[inline(never)]
    fn with_terms_kg_per_s(&self, at: LinePoint, state: &[f64]) -> f64 {
        let mut flow = at.valve_flow_kg_per_s;
        for (term, own) in self.terms.iter(state) {
            flow = term.flow_kg_per_s(&at, own, flow);
        }
        flow
    }
}

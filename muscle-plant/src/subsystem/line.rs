//! The line: the delay of the command line, and the hose between valve and muscle.
//!
//! The nominal line is ideal: no delay, and the pressure at the valve's port, which the sensor
//! reads, is that of the muscle.

use super::gas::GasSubsystem;
use super::muscle::MuscleTerm;
use super::term::{Dynamics, Terms};
use model_core::muscle::Volume;
use model_core::pressure::{AbsolutePa, GaugePa};

/// The inputs of a line term.
#[derive(Clone, Copy, Debug)]
pub struct LinePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// The reference after the pure delay.
    pub reference: GaugePa<f64>,
    /// Pressure in the muscle.
    pub muscle: GaugePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
    /// Volume of the muscle \[m³\].
    pub volume_m3: f64,
    /// Mass flow from the valve into the line \[kg/s\]; 0 in [`Dynamics::steady_state`].
    pub valve_flow_kg_per_s: f64,
}

/// A term of the line.
pub trait LineTerm: Dynamics<LinePoint> + Send + Sync {
    /// Pure delay of the reference \[s\].
    fn delay_s(&self) -> f64 {
        0.0
    }

    /// The reference at the valve, from the reference after the terms before this one.
    fn reference(&self, _at: &LinePoint, _state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        reference
    }

    /// Pressure at the valve's port, from the pressure after the terms before this one. It must not
    /// read [`LinePoint::valve_flow_kg_per_s`], which follows from it.
    fn port(&self, _at: &LinePoint, _state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        port
    }

    /// Called when the term is added to a plant: the valve's flow gain K_G \[kg/(Pa·s)\] and the
    /// muscle's volume.
    fn join(&mut self, _flow_gain_kg_per_pa_s: f64, _volume: &Volume<f64>) {}

    /// Conductance of a resistance without volume at the valve's port \[kg/(Pa·s)\]. The plant
    /// solves for the pressure before it, which does not come through [`LineTerm::port`].
    fn conductance_kg_per_pa_s(&self, _at: &LinePoint) -> Option<f64> {
        None
    }

    /// Mass flow into the muscle, from the flow after the terms before this one \[kg/s\].
    fn flow_kg_per_s(&self, _at: &LinePoint, _state: &[f64], flow_kg_per_s: f64) -> f64 {
        flow_kg_per_s
    }

    /// Pressure at the sensor, from the pressure after the terms before this one; the sensor is at
    /// the port.
    fn sensor(&self, _at: &LinePoint, _state: &[f64], sensor: GaugePa<f64>) -> GaugePa<f64> {
        sensor
    }

    /// The term to add to the muscle force where the measured pressure is an input, because the
    /// pressure in the muscle differs from it; `air` is the muscle's air, if the rig has it.
    fn with_measured_pressure(&self, _air: Option<GasSubsystem>) -> Option<Box<dyn MuscleTerm>> {
        None
    }
}

/// The line.
#[derive(Default)]
pub struct LineSubsystem {
    /// Added effects.
    pub terms: Terms<dyn LineTerm>,
}

impl LineSubsystem {
    /// Pure delay of the reference \[s\].
    pub fn delay_s(&self) -> f64 {
        self.terms.all().map(LineTerm::delay_s).sum()
    }

    /// The reference at the valve.
    #[inline]
    pub fn reference(&self, point: &LinePoint, state: &[f64]) -> GaugePa<f64> {
        if self.terms.is_empty() {
            return point.reference;
        }
        self.reference_with_terms(*point, state)
    }

    #[inline(never)]
    fn reference_with_terms(&self, point: LinePoint, state: &[f64]) -> GaugePa<f64> {
        let mut reference = point.reference;
        for (term, state) in self.terms.iter(state) {
            reference = term.reference(&point, state, reference);
        }
        reference
    }

    /// Pressure at the valve's port, or behind the [`LineSubsystem::resistance`] there.
    #[inline]
    pub fn port(&self, point: &LinePoint, state: &[f64]) -> GaugePa<f64> {
        if self.terms.is_empty() {
            return point.muscle;
        }
        self.port_with_terms(*point, state)
    }

    #[inline(never)]
    fn port_with_terms(&self, point: LinePoint, state: &[f64]) -> GaugePa<f64> {
        let mut port = point.muscle;
        for (term, state) in self.terms.iter(state) {
            port = term.port(&point, state, port);
        }
        port
    }

    /// The resistances without volume at the valve's end, in series.
    #[inline]
    pub fn resistance(&self, point: &LinePoint) -> Option<PortResistance> {
        if self.terms.is_empty() {
            return None;
        }
        self.resistance_of_terms(*point)
    }

    #[inline(never)]
    fn resistance_of_terms(&self, point: LinePoint) -> Option<PortResistance> {
        let per_conductance: f64 = self
            .terms
            .all()
            .filter_map(|term| term.conductance_kg_per_pa_s(&point))
            .map(f64::recip)
            .sum();
        (per_conductance > 0.0).then(|| PortResistance {
            conductance_kg_per_pa_s: per_conductance.recip(),
        })
    }

    /// Pressure at the sensor, from that at the valve's port.
    pub fn sensor(&self, point: &LinePoint, port: GaugePa<f64>, state: &[f64]) -> GaugePa<f64> {
        let mut sensor = port;
        for (term, state) in self.terms.iter(state) {
            sensor = term.sensor(point, state, sensor);
        }
        sensor
    }

    /// Mass flow into the muscle \[kg/s\].
    #[inline]
    pub fn flow_kg_per_s(&self, point: &LinePoint, state: &[f64]) -> f64 {
        if self.terms.is_empty() {
            return point.valve_flow_kg_per_s;
        }
        self.with_terms_kg_per_s(*point, state)
    }

    #[inline(never)]
    fn with_terms_kg_per_s(&self, point: LinePoint, state: &[f64]) -> f64 {
        let mut flow = point.valve_flow_kg_per_s;
        for (term, state) in self.terms.iter(state) {
            flow = term.flow_kg_per_s(&point, state, flow);
        }
        flow
    }
}

/// A resistance at the valve's port with a volume that is negligible beside the valve's flow.
pub struct PortResistance {
    conductance_kg_per_pa_s: f64,
}

/// Accuracy of the pressure before the resistance \[Pa\]: far below any sensor, far above rounding.
const SAME_PA: f64 = 1e-6;
/// Largest number of steps; a flow that is piecewise linear or smooth needs some ten.
const STEPS_MAX: usize = 60;

impl PortResistance {
    /// Pressure before the resistance, with `behind` behind it, at which its flow is that of the
    /// valve. The flow of a valve falls with the pressure at its port, is 0 at supply pressure and
    /// above, and is not negative below the atmosphere.
    ///
    /// Regula falsi with the Illinois modification (Dowell & Jarratt, BIT 11 (1971)), which needs
    /// one step for a linear flow such as Eq 9.
    pub fn before(
        &self,
        behind: GaugePa<f64>,
        supply: GaugePa<f64>,
        valve_flow_kg_per_s: impl Fn(GaugePa<f64>) -> f64,
    ) -> GaugePa<f64> {
        let stored_kg_per_s = |port_pa: f64| {
            let passing_kg_per_s = self.conductance_kg_per_pa_s * (port_pa - behind.0);
            valve_flow_kg_per_s(GaugePa(port_pa)) - passing_kg_per_s
        };
        let (mut from_pa, mut from) = (behind.0, stored_kg_per_s(behind.0));
        let same_kg_per_s = SAME_PA * self.conductance_kg_per_pa_s;
        let unlimited_pa = behind.0 + from / self.conductance_kg_per_pa_s;
        let mut to_pa = if from > 0.0 {
            unlimited_pa.min(supply.0.max(behind.0))
        } else {
            unlimited_pa.max(behind.0.min(0.0))
        };
        let mut to = stored_kg_per_s(to_pa);
        for _ in 0..STEPS_MAX {
            if to.abs() <= same_kg_per_s || from == to {
                break;
            }
            let next_pa = (from_pa * to - to_pa * from) / (to - from);
            let next = stored_kg_per_s(next_pa);
            if (next > 0.0) == (to > 0.0) {
                from *= 0.5;
            } else {
                (from_pa, from) = (to_pa, to);
            }
            (to_pa, to) = (next_pa, next);
        }
        GaugePa(to_pa)
    }
}

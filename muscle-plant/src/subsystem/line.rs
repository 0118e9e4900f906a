//! The line block: the command line's delay, and the hose between valve and muscle.
//!
//! The nominal line is ideal: no delay, and the pressure at the valve's port, which the sensor
//! reads, is the muscle's.

use super::gas::GasSubsystem;
use super::muscle::MuscleTerm;
use super::term::{Dynamics, Terms};
use model_core::muscle::Volume;
use model_core::pressure::{AbsolutePa, GaugePa};

/// What a term of the line block sees.
#[derive(Clone, Copy, Debug)]
pub struct LinePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// The reference that has come through its pure delay.
    pub reference: GaugePa<f64>,
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
    /// Time that the reference takes to the valve at least \[s\].
    fn delay_s(&self) -> f64 {
        0.0
    }

    /// The reference as it arrives at the valve, from the one that comes to the term.
    fn reference(&self, _at: &LinePoint, _state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        reference
    }

    /// Pressure at the valve's end, from the one that comes to the term. It must not read
    /// [`LinePoint::valve_flow_kg_per_s`], which follows from it.
    fn port(&self, _at: &LinePoint, _state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        port
    }

    /// Told of the plant that it joins: the valve's flow gain K_G \[kg/(Pa·s)\] and the muscle's
    /// volume.
    fn join(&mut self, _flow_gain_kg_per_pa_s: f64, _volume: &Volume<f64>) {}

    /// Conductance of a resistance that stores no air, at the valve's end \[kg/(Pa·s)\]. The
    /// pressure before it is the valve's to find, and does not come through [`LineTerm::port`].
    fn conductance_kg_per_pa_s(&self, _at: &LinePoint) -> Option<f64> {
        None
    }

    /// Mass flow into the muscle, from the flow that comes to the term \[kg/s\].
    fn flow_kg_per_s(&self, _at: &LinePoint, _state: &[f64], flow_kg_per_s: f64) -> f64 {
        flow_kg_per_s
    }

    /// Pressure at the sensor, from the one that comes to the term: the port's, which it sits on.
    fn sensor(&self, _at: &LinePoint, _state: &[f64], sensor: GaugePa<f64>) -> GaugePa<f64> {
        sensor
    }

    /// The pressure \[Pa\] that the sensor has read as `read_pa` at `time_s` \[s\], where it is
    /// slower than the line; as well as differences of the readings tell it.
    fn before_sensor_pa(&self, _time_s: &[f64], _read_pa: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// What the term leaves of itself where the sensor's pressure is an input: a term on the force,
    /// of a muscle whose pressure is not quite the one that was measured; `air` is in it, if the
    /// rig says.
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
    /// Time that the reference takes to the valve at least \[s\].
    pub fn delay_s(&self) -> f64 {
        self.terms.all().map(LineTerm::delay_s).sum()
    }

    /// The reference as it arrives at the valve.
    #[inline]
    pub fn reference(&self, at: &LinePoint, state: &[f64]) -> GaugePa<f64> {
        if self.terms.is_empty() {
            return at.reference;
        }
        self.reference_with_terms(*at, state)
    }

    #[inline(never)]
    fn reference_with_terms(&self, at: LinePoint, state: &[f64]) -> GaugePa<f64> {
        let mut reference = at.reference;
        for (term, own) in self.terms.iter(state) {
            reference = term.reference(&at, own, reference);
        }
        reference
    }

    /// Pressure at the valve's port, or behind the [`LineSubsystem::resistance`] there.
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

    /// The resistances without volume at the valve's end, in series.
    #[inline]
    pub fn resistance(&self, at: &LinePoint) -> Option<PortResistance> {
        if self.terms.is_empty() {
            return None;
        }
        self.resistance_of_terms(*at)
    }

    #[inline(never)]
    fn resistance_of_terms(&self, at: LinePoint) -> Option<PortResistance> {
        let own = |term: &dyn LineTerm| term.conductance_kg_per_pa_s(&at);
        let per_conductance: f64 = self.terms.all().filter_map(own).map(f64::recip).sum();
        (per_conductance > 0.0).then(|| PortResistance {
            conductance_kg_per_pa_s: per_conductance.recip(),
        })
    }

    /// Pressure at the sensor, from that at the valve's port.
    pub fn sensor(&self, at: &LinePoint, port: GaugePa<f64>, state: &[f64]) -> GaugePa<f64> {
        let mut sensor = port;
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

/// A resistance at the valve's port, whose own volume is nothing beside the valve's flow.
pub struct PortResistance {
    conductance_kg_per_pa_s: f64,
}

/// The pressure to which valve and resistance must agree \[Pa\]: far below what is seen, far above
/// rounding.
const SAME_PA: f64 = 1e-6;
/// Steps to it: the flow is linear by pieces or smooth, for which some ten do.
const STEPS_MAX: usize = 60;

impl PortResistance {
    /// Pressure before it, with `behind` behind it: where as much passes as the valve gives. What
    /// that gives falls as its port's pressure rises, is none at the supply and beyond, and draws
    /// none below the atmosphere.
    ///
    /// Regula falsi with the halving of Illinois (Dowell & Jarratt, BIT 11 (1971)), which needs one
    /// step where the flow is linear, as Eq 9 is.
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
        let all_pa = behind.0 + from / self.conductance_kg_per_pa_s;
        let mut to_pa = if from > 0.0 {
            all_pa.min(supply.0.max(behind.0))
        } else {
            all_pa.max(behind.0.min(0.0))
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

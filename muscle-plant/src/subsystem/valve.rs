//! The servo valve (Eq 9).

use super::term::{Dynamics, Terms};
use model_core::pressure::{AbsolutePa, GaugePa};
use model_core::valve::mass_flow_kg_per_s;

/// The inputs of a valve term.
#[derive(Clone, Copy, Debug)]
pub struct ValvePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Reference pressure at the valve, before any term.
    pub reference: GaugePa<f64>,
    /// Pressure at the valve's output port.
    pub port: GaugePa<f64>,
    /// Supply pressure.
    pub supply: GaugePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
}

/// A term of the valve.
pub trait ValveTerm: Dynamics<ValvePoint> + Send + Sync {
    /// The reference that moves the spool, from the reference after the terms before this one.
    fn reference(&self, _at: &ValvePoint, _state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        reference
    }

    /// The effective reference of the ports, from the reference that has moved the spool.
    fn ported(&self, _at: &ValvePoint, reference: GaugePa<f64>) -> GaugePa<f64> {
        reference
    }

    /// Mass flow from the valve towards the muscle, from the flow after the terms before this one
    /// \[kg/s\].
    fn flow_kg_per_s(&self, _at: &ValvePoint, _state: &[f64], flow_kg_per_s: f64) -> f64 {
        flow_kg_per_s
    }
}

/// The servo valve.
pub struct ValveSubsystem {
    /// K_G \[kg/(Pa·s)\].
    pub flow_gain_kg_per_pa_s: f64,
    /// Added effects.
    pub terms: Terms<dyn ValveTerm>,
}

impl ValveSubsystem {
    /// Mass flow towards the muscle \[kg/s\]: Eq 9 with the reference limited to 0…supply, as a
    /// valve cannot fill above its supply nor exhaust below the atmosphere.
    #[inline]
    pub fn flow_kg_per_s(&self, point: &ValvePoint, state: &[f64]) -> f64 {
        if self.terms.is_empty() {
            return self.nominal_kg_per_s(point, point.reference);
        }
        self.with_terms_kg_per_s(*point, state)
    }

    #[inline]
    fn nominal_kg_per_s(&self, point: &ValvePoint, reference: GaugePa<f64>) -> f64 {
        let limited = GaugePa(reference.0.min(point.supply.0).max(0.0));
        mass_flow_kg_per_s(self.flow_gain_kg_per_pa_s, limited, point.port)
    }

    /// The effective reference: terms that move the spool act before those of its ports, in
    /// whatever order they were added.
    fn reference(&self, point: &ValvePoint, state: &[f64]) -> GaugePa<f64> {
        let mut reference = point.reference;
        for (term, state) in self.terms.iter(state) {
            reference = term.reference(point, state, reference);
        }
        for term in self.terms.all() {
            reference = term.ported(point, reference);
        }
        reference
    }

    /// Whether the valve is open to its supply: its effective reference is at or above the supply
    /// pressure, also if that has fallen below the pressure at the port.
    pub fn open_to_supply(&self, point: &ValvePoint, state: &[f64]) -> bool {
        self.reference(point, state).0 >= point.supply.0
    }

    #[inline(never)]
    fn with_terms_kg_per_s(&self, point: ValvePoint, state: &[f64]) -> f64 {
        let mut flow = self.nominal_kg_per_s(&point, self.reference(&point, state));
        for (term, state) in self.terms.iter(state) {
            flow = term.flow_kg_per_s(&point, state, flow);
        }
        flow
    }
}

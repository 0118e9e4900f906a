//! The valve block (Eq 9).

use super::term::{Dynamics, Terms};
use model_core::pressure::{AbsolutePa, GaugePa};
use model_core::valve::mass_flow_kg_per_s;

/// What a term of the valve block sees.
#[derive(Clone, Copy, Debug)]
pub struct ValvePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Reference pressure as it reaches the valve, before any term.
    pub reference: GaugePa<f64>,
    /// Pressure at the valve's output port.
    pub port: GaugePa<f64>,
    /// Supply pressure.
    pub supply: GaugePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
}

/// A term of the valve block.
pub trait ValveTerm: Dynamics<ValvePoint> + Send + Sync {
    /// The reference that moves the spool, from the one that comes to the term.
    fn reference(&self, _at: &ValvePoint, _state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        reference
    }

    /// The reference that the spool's ports act on, from the one that has moved it there.
    fn ported(&self, _at: &ValvePoint, reference: GaugePa<f64>) -> GaugePa<f64> {
        reference
    }

    /// Mass flow that leaves the valve towards the muscle, from the flow that comes to the term
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
    /// valve cannot fill above its supply nor draw below the atmosphere.
    #[inline]
    pub fn flow_kg_per_s(&self, at: &ValvePoint, state: &[f64]) -> f64 {
        if self.terms.is_empty() {
            return self.nominal_kg_per_s(at, at.reference);
        }
        self.with_terms_kg_per_s(*at, state)
    }

    #[inline]
    fn nominal_kg_per_s(&self, at: &ValvePoint, reference: GaugePa<f64>) -> f64 {
        let limited = GaugePa(reference.0.min(at.supply.0).max(0.0));
        mass_flow_kg_per_s(self.flow_gain_kg_per_pa_s, limited, at.port)
    }

    /// The reference that it acts on: what moves the spool comes before its ports, in whatever
    /// order they were added.
    fn reference(&self, at: &ValvePoint, state: &[f64]) -> GaugePa<f64> {
        let mut reference = at.reference;
        for (term, own) in self.terms.iter(state) {
            reference = term.reference(at, own, reference);
        }
        for term in self.terms.all() {
            reference = term.ported(at, reference);
        }
        reference
    }

    /// Whether it would fill beyond its supply, and so is open to that, also where the pressure
    /// there has fallen below the port's.
    pub fn open_to_supply(&self, at: &ValvePoint, state: &[f64]) -> bool {
        self.reference(at, state).0 >= at.supply.0
    }

    #[inline(never)]
    fn with_terms_kg_per_s(&self, at: ValvePoint, state: &[f64]) -> f64 {
        let mut flow = self.nominal_kg_per_s(&at, self.reference(&at, state));
        for (term, own) in self.terms.iter(state) {
            flow = term.flow_kg_per_s(&at, own, flow);
        }
        flow
    }
}

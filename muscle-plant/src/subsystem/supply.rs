//! The air supply: the pressure at the inlet of the valve.

use super::term::{Dynamics, Terms};
use model_core::pressure::{AbsolutePa, GaugePa};

/// The inputs of a supply term.
#[derive(Clone, Copy, Debug)]
pub struct SupplyPoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Mass flow out of the supply \[kg/s\], negative where air flows back; 0 in
    /// [`SupplyTerm::pressure`].
    pub drawn_kg_per_s: f64,
    /// Nominal supply pressure.
    pub nominal: GaugePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
}

/// A term of the supply.
pub trait SupplyTerm: Dynamics<SupplyPoint> + Send + Sync {
    /// Supply pressure, from the pressure after the terms before this one. It must not read
    /// [`SupplyPoint::drawn_kg_per_s`], which follows from it.
    fn pressure(&self, point: &SupplyPoint, state: &[f64], supply: GaugePa<f64>) -> GaugePa<f64>;

    /// Whether a check valve keeps air from flowing back.
    fn checks(&self) -> bool {
        false
    }
}

/// The supply.
pub struct SupplySubsystem {
    /// Nominal supply pressure P_s, constant.
    pub nominal: GaugePa<f64>,
    /// Added effects.
    pub terms: Terms<dyn SupplyTerm>,
}

impl SupplySubsystem {
    /// Supply pressure at the valve.
    #[inline]
    pub fn pressure(&self, point: &SupplyPoint, state: &[f64]) -> GaugePa<f64> {
        if self.terms.is_empty() {
            return self.nominal;
        }
        self.with_terms(*point, state)
    }

    /// Whether a check valve keeps air from flowing back.
    pub fn checks(&self) -> bool {
        self.terms.all().any(|term| term.checks())
    }

    #[inline(never)]
    fn with_terms(&self, point: SupplyPoint, state: &[f64]) -> GaugePa<f64> {
        let mut supply = self.nominal;
        for (term, state) in self.terms.iter(state) {
            supply = term.pressure(&point, state, supply);
        }
        supply
    }
}

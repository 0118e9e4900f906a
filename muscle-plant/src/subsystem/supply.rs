//! The supply block: the pressure that feeds the valve.

use super::term::{Dynamics, Terms};
use model_core::pressure::{AbsolutePa, GaugePa};

/// What a term of the supply block sees.
#[derive(Clone, Copy, Debug)]
pub struct SupplyPoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Mass flow that the valve draws \[kg/s\], negative where air flows back through it; zero
    /// where only the pressure is asked for.
    pub drawn_kg_per_s: f64,
    /// Nominal supply pressure.
    pub nominal: GaugePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
}

/// A term of the supply block.
pub trait SupplyTerm: Dynamics<SupplyPoint> + Send + Sync {
    /// Supply pressure, from the one that comes to the term. It must not read
    /// [`SupplyPoint::drawn_kg_per_s`], which follows from it.
    fn pressure(&self, at: &SupplyPoint, state: &[f64], supply: GaugePa<f64>) -> GaugePa<f64>;

    /// Whether a check valve keeps air from flowing back.
    fn checks(&self) -> bool {
        false
    }
}

/// The supply.
pub struct SupplySubsystem {
    /// Nominal supply pressure P_s, held.
    pub nominal: GaugePa<f64>,
    /// Added effects.
    pub terms: Terms<dyn SupplyTerm>,
}

impl SupplySubsystem {
    /// Supply pressure at the valve.
    #[inline]
    pub fn pressure(&self, at: &SupplyPoint, state: &[f64]) -> GaugePa<f64> {
        if self.terms.is_empty() {
            return self.nominal;
        }
        self.with_terms(*at, state)
    }

    /// Whether a check valve keeps air from flowing back.
    pub fn checks(&self) -> bool {
        self.terms.all().any(|term| term.checks())
    }

    #[inline(never)]
    fn with_terms(&self, at: SupplyPoint, state: &[f64]) -> GaugePa<f64> {
        let mut supply = self.nominal;
        for (term, own) in self.terms.iter(state) {
            supply = term.pressure(&at, own, supply);
        }
        supply
    }
}

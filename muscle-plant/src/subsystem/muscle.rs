//! The muscle force (Eq 1).

use super::term::{Dynamics, Terms};
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;

/// The inputs of a muscle-force term.
#[derive(Clone, Copy, Debug)]
pub struct MusclePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Contraction ε \[-\].
    pub contraction: f64,
    /// Contraction rate \[1/s\].
    pub contraction_rate_per_s: f64,
    /// Direction of motion in the present regime: 1 contracting, −1 extending, 0 at rest. A step
    /// may extend beyond a reversal that is then located; rates that take their sign from here and
    /// not from the speed remain smooth there. 0 except in [`Dynamics::rates`].
    pub direction: f64,
    /// Pressure in the muscle.
    pub pressure: GaugePa<f64>,
}

/// A term of the muscle force.
pub trait MuscleTerm: Dynamics<MusclePoint> + Send + Sync {
    /// Muscle force \[N\], from the force `force_n` of Eq 1 and the terms before this one; `law` is
    /// Eq 1.
    fn force_n(&self, point: &MusclePoint, law: &Muscle<f64>, state: &[f64], force_n: f64) -> f64;

    /// The force that the muscle can exert \[N\], from the force `force_n` with all terms.
    fn limit_n(&self, force_n: f64) -> f64 {
        force_n
    }
}

/// The muscle as a force.
pub struct MuscleSubsystem {
    /// Eq 1.
    pub law: Muscle<f64>,
    /// Added effects.
    pub terms: Terms<dyn MuscleTerm>,
}

impl MuscleSubsystem {
    /// Muscle force F \[N\].
    #[inline]
    pub fn force_n(&self, point: &MusclePoint, state: &[f64]) -> f64 {
        let force_n = self.law.force_n(point.contraction, point.pressure);
        if self.terms.is_empty() {
            return force_n;
        }
        self.with_terms_n(*point, state, force_n)
    }

    #[inline(never)]
    fn with_terms_n(&self, point: MusclePoint, state: &[f64], mut force: f64) -> f64 {
        for (term, state) in self.terms.iter(state) {
            force = term.force_n(&point, &self.law, state, force);
        }
        for term in self.terms.all() {
            force = term.limit_n(force);
        }
        force
    }
}

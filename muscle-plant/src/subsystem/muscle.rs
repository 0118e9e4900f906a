//! The muscle-force block (Eq 1).

use super::term::{Dynamics, Terms};
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;

/// What a term of the muscle-force block sees.
#[derive(Clone, Copy, Debug)]
pub struct MusclePoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Contraction ε \[-\].
    pub contraction: f64,
    /// Contraction rate \[1/s\].
    pub contraction_rate_per_s: f64,
    /// Where the motion goes in the present regime: 1 contracting, −1 paying out, 0 at rest. A step
    /// may reach past a reversal that is then located; rates that take their sign from here and not
    /// from the speed stay smooth there. Zero except where [`Dynamics::rates`] asks.
    pub direction: f64,
    /// Pressure in the muscle.
    pub pressure: GaugePa<f64>,
}

/// A term of the muscle-force block.
pub trait MuscleTerm: Dynamics<MusclePoint> + Send + Sync {
    /// Muscle force \[N\], from the one that comes to the term; `law` is Eq 1's.
    fn force_n(&self, at: &MusclePoint, law: &Muscle<f64>, state: &[f64], force_n: f64) -> f64;

    /// For each state that fades, in proportion to what it is off by: what one unit of it adds to
    /// the force \[N\], and its time constant \[s\], infinite where only what `state` remembers of
    /// the motion lets it fade.
    fn fading(&self, _at: &MusclePoint, _law: &Muscle<f64>, _state: &[f64]) -> Vec<(f64, f64)> {
        Vec::new()
    }

    /// Whether it has a memory of the motion, which [`Dynamics::bias_memory`] sets.
    fn remembers(&self) -> bool {
        false
    }

    /// What the muscle can exert at all of `force_n`, to which every other term has added \[N\].
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
    pub fn force_n(&self, at: &MusclePoint, state: &[f64]) -> f64 {
        let force_n = self.law.force_n(at.contraction, at.pressure);
        if self.terms.is_empty() {
            return force_n;
        }
        self.with_terms_n(*at, state, force_n)
    }

    #[inline(never)]
    fn with_terms_n(&self, at: MusclePoint, state: &[f64], mut force: f64) -> f64 {
        for (term, own) in self.terms.iter(state) {
            force = term.force_n(&at, &self.law, own, force);
        }
        for term in self.terms.all() {
            force = term.limit_n(force);
        }
        force
    }
}

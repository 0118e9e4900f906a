//! The load block: the weight, its friction, and the stop it rests on (Eq 5).

use super::term::{Dynamics, Terms};
use crate::nominal::Weight;
pub use model_core::constants::GRAVITY_M_PER_S2;

/// What a term of the load block sees.
#[derive(Clone, Copy, Debug)]
pub struct LoadPoint {
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
    /// L \[m\].
    pub initial_length_m: f64,
}

/// A term of the load block.
pub trait LoadTerm: Dynamics<LoadPoint> + Send + Sync {
    /// Changes the weight's constants, and adds to `force_n`, an external force that lifts \[N\].
    fn change(&self, at: &LoadPoint, state: &[f64], weight: &mut Weight, force_n: &mut f64);
}

/// How the weight moves just now. Between two changes of it Eq 5 is smooth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// At rest, held by static friction or by the stop.
    Stuck,
    /// The muscle contracts: friction pulls down.
    Rising,
    /// The muscle pays out: friction pulls up.
    Falling,
}

/// The weight on the muscle.
pub struct LoadSubsystem {
    /// Nominal constants.
    pub weight: Weight,
    /// L \[m\].
    pub initial_length_m: f64,
    /// Added effects.
    pub terms: Terms<dyn LoadTerm>,
}

impl LoadSubsystem {
    /// The constants in force, and the external force that lifts \[N\].
    #[inline]
    pub fn constants(&self, at: &LoadPoint, state: &[f64]) -> (Weight, f64) {
        if self.terms.is_empty() {
            return (self.weight, 0.0);
        }
        self.with_terms(*at, state)
    }

    #[inline(never)]
    fn with_terms(&self, at: LoadPoint, state: &[f64]) -> (Weight, f64) {
        let (mut weight, mut force_n) = (self.weight, 0.0);
        for (term, own) in self.terms.iter(state) {
            term.change(&at, own, &mut weight, &mut force_n);
        }
        (weight, force_n)
    }

    /// ε̈ \[1/s²\] while moving, Eq 5: M L ε̈ = F − L C ε̇ − M g ∓ F_c, friction against
    /// the motion.
    #[inline]
    pub fn acceleration_per_s2(
        &self,
        at: &LoadPoint,
        state: &[f64],
        muscle_force_n: f64,
        motion: Motion,
    ) -> f64 {
        let (weight, lifting_n) = self.constants(at, state);
        let friction_n = match motion {
            Motion::Stuck => return 0.0,
            Motion::Rising => weight.coulomb_friction_n,
            Motion::Falling => -weight.coulomb_friction_n,
        };
        let rate_m_per_s = self.initial_length_m * at.contraction_rate_per_s;
        let net_n = muscle_force_n + lifting_n
            - weight.viscous_damping_ns_per_m * rate_m_per_s
            - weight.mass_kg * GRAVITY_M_PER_S2
            - friction_n;
        net_n / (weight.mass_kg * self.initial_length_m)
    }

    /// How far the weight at rest is from moving \[N\]: positive once static friction (and the
    /// stop, which holds it from below at ε ≤ 0) is exceeded; and where it then goes.
    #[inline]
    pub fn breakaway_n(&self, at: &LoadPoint, state: &[f64], muscle_force_n: f64) -> (f64, Motion) {
        let (weight, lifting_n) = self.constants(at, state);
        let net_n = muscle_force_n + lifting_n - weight.mass_kg * GRAVITY_M_PER_S2;
        if net_n > 0.0 || at.contraction <= 0.0 {
            (net_n - weight.static_friction_n, Motion::Rising)
        } else {
            (-net_n - weight.static_friction_n, Motion::Falling)
        }
    }
}

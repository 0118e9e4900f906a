//! The load: the weight, its friction, and the stop that it rests on (Eq 5).

use super::term::{Dynamics, Terms};
use crate::nominal::Weight;
pub use model_core::constants::GRAVITY_M_PER_S2;

/// The inputs of a load term.
#[derive(Clone, Copy, Debug)]
pub struct LoadPoint {
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
    /// L \[m\].
    pub initial_length_m: f64,
}

/// A term of the load.
pub trait LoadTerm: Dynamics<LoadPoint> + Send + Sync {
    /// Changes the constants of the weight, and adds to `force_n`, an external lifting force \[N\].
    fn change(&self, point: &LoadPoint, state: &[f64], weight: &mut Weight, force_n: &mut f64);
}

/// The present motion of the weight. Between two changes of it Eq 5 is smooth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// At rest, by static friction or on the stop.
    Stuck,
    /// The muscle contracts; friction acts downward.
    Rising,
    /// The muscle extends; friction acts upward.
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
    /// The constants with all terms, and the external lifting force \[N\].
    #[inline]
    pub fn constants(&self, point: &LoadPoint, state: &[f64]) -> (Weight, f64) {
        if self.terms.is_empty() {
            return (self.weight, 0.0);
        }
        self.with_terms(*point, state)
    }

    #[inline(never)]
    fn with_terms(&self, point: LoadPoint, state: &[f64]) -> (Weight, f64) {
        let (mut weight, mut force_n) = (self.weight, 0.0);
        for (term, state) in self.terms.iter(state) {
            term.change(&point, state, &mut weight, &mut force_n);
        }
        (weight, force_n)
    }

    /// ε̈ \[1/s²\] in motion, Eq 5: M L ε̈ = F − L C ε̇ − M g ∓ F_c with friction against the
    /// motion; 0 at rest.
    #[inline]
    pub fn acceleration_per_s2(
        &self,
        point: &LoadPoint,
        state: &[f64],
        muscle_force_n: f64,
        motion: Motion,
    ) -> f64 {
        let (weight, lifting_n) = self.constants(point, state);
        let friction_n = match motion {
            Motion::Stuck => return 0.0,
            Motion::Rising => weight.coulomb_friction_n,
            Motion::Falling => -weight.coulomb_friction_n,
        };
        let rate_m_per_s = self.initial_length_m * point.contraction_rate_per_s;
        let net_n = muscle_force_n + lifting_n
            - weight.viscous_damping_ns_per_m * rate_m_per_s
            - weight.mass_kg * GRAVITY_M_PER_S2
            - friction_n;
        net_n / (weight.mass_kg * self.initial_length_m)
    }

    /// Net force on the weight at rest beyond static friction (and the stop, which supports it at
    /// ε ≤ 0) \[N\], positive if it starts to move; and the direction of that motion.
    #[inline]
    pub fn breakaway_n(
        &self,
        point: &LoadPoint,
        state: &[f64],
        muscle_force_n: f64,
    ) -> (f64, Motion) {
        let (weight, lifting_n) = self.constants(point, state);
        let net_n = muscle_force_n + lifting_n - weight.mass_kg * GRAVITY_M_PER_S2;
        if net_n > 0.0 || point.contraction <= 0.0 {
            (net_n - weight.static_friction_n, Motion::Rising)
        } else {
            (-net_n - weight.static_friction_n, Motion::Falling)
        }
    }
}

//! The force with which the weight would meet a limb, from its energy.
//!
//! A weight that moves against its muscle is a mass on a spring: whatever the reference has put
//! into its swing, a limb in the way receives.

use crate::constants::TICK_S;
use crate::limits::{
    FLICKER_COUNTS, LIMB_FORCE_N, LIMB_RESTING_M_PER_S, LIMB_STIFFNESS_N_PER_M, STOP_CONTRACTION,
};
use crate::number::Number;
use crate::pressure::GaugePa;
use crate::settings::SettingsValues;

/// The weight's motion at the reading before the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// ε \[-\], from home.
    pub contraction: f32,
    /// Speed \[m/s\], upwards, over the readings about it.
    pub speed_m_per_s: f32,
}

impl Motion {
    /// True if the weight may meet a limb: it is off its stop and does not rest. One that rests,
    /// perhaps on a limb, has no energy that the limb could receive.
    pub fn may_meet_limb(&self, values: &SettingsValues) -> bool {
        self.is_off_stop() && libm::fabsf(self.speed_m_per_s) > resting_m_per_s(values)
    }

    /// True if the weight is not on its stop.
    pub fn is_off_stop(&self) -> bool {
        self.contraction >= STOP_CONTRACTION
    }

    /// True if the weight rests.
    pub fn is_rest(&self, values: &SettingsValues) -> bool {
        libm::fabsf(self.speed_m_per_s) <= resting_m_per_s(values)
    }

    /// Whether a reference of `next_pa` after `now_pa` takes the weight further from balance and
    /// gives it more energy than a limb may receive, which is that of [`LIMB_FORCE_N`].
    ///
    /// With M the weight, v its speed, ΔF = F(P_r, ε) − F_0 the force (Eq 1) by which the reference
    /// is away from balance, `balance_n` F_0, and k_m = f_c/L the muscle's stiffness, the weight
    /// swings with the energy ½Mv² + ΔF²/(2k_m) about its rest position. A limb of stiffness k
    /// against something rigid that stops it has then received all of it, at a force F_l of at most
    ///
    /// F_l²/(2k) = ½Mv² + ΔF²/(2k_m),
    ///
    /// as ISO/TS 15066:2016, A.3.4 has it for ΔF = 0: F_l = v√(kM). N, m/s, N/m, kg; for speeds of
    /// up to 1.5 m/s, for which encoder readings are plausible, in either direction; for a muscle
    /// that has the reference's pressure and a weight of `load_kg`. Never true of a step towards
    /// balance, and of a NaN: the reference's other limits remain.
    pub fn exceeds_limb_energy(
        &self,
        values: &SettingsValues,
        balance_n: f32,
        now_pa: f32,
        next_pa: f32,
    ) -> bool {
        let (muscle, contraction) = (&values.muscle, self.contraction);
        // The muscle pulls on a rope, which cannot push.
        let force_n = |pressure| muscle.force_n(contraction, pressure).at_least(0.0);
        let (now, next) = (GaugePa(now_pa), GaugePa(next_pa));
        let from_balance_n = force_n(next) - balance_n;
        let stiffness_n_per_m = muscle.stiffness_n(contraction, next) / muscle.initial_length_m;
        let twice_permitted_j = LIMB_FORCE_N * LIMB_FORCE_N / LIMB_STIFFNESS_N_PER_M;
        let twice_kinetic_j = values.load_kg * self.speed_m_per_s * self.speed_m_per_s;
        let is_away = (force_n(next) - force_n(now)) * from_balance_n > 0.0;
        // Twice the energy, times k_m: no quotient of two small numbers.
        is_away
            && from_balance_n * from_balance_n
                > stiffness_n_per_m * (twice_permitted_j - twice_kinetic_j)
    }
}

/// Way that an encoder shows at rest \[m\]. Its counts may fall as the muscle contracts.
pub(crate) fn flicker_m(values: &SettingsValues) -> f32 {
    FLICKER_COUNTS as f32 * libm::fabsf(values.encoder_m_per_count)
}

/// Speed up to which a weight rests \[m/s\]; what a coarse encoder's flicker looks like is rest,
/// too.
fn resting_m_per_s(values: &SettingsValues) -> f32 {
    LIMB_RESTING_M_PER_S.at_least(flicker_m(values) / (2.0 * TICK_S))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::GRAVITY_M_PER_S2;
    use crate::reference::reference_pressure;

    const VALUES: SettingsValues = SettingsValues::reference();
    const CONTRACTION: f32 = 0.15;
    const WEIGHT_N: f32 = VALUES.load_kg * GRAVITY_M_PER_S2 as f32;

    /// The reference \[Pa\] with which the muscle pulls so much more than the weight \[N\].
    fn away_pa(from_balance_n: f32) -> f32 {
        let force_n = WEIGHT_N + from_balance_n;
        let supply = GaugePa(VALUES.supply_pressure_pa);
        reference_pressure(&VALUES.muscle, force_n, CONTRACTION, 0.3, supply).0
    }

    /// Whether a step of 1 N to so much above balance \[N\], or below, is refused at this speed.
    fn is_refused(from_balance_n: f32, speed_m_per_s: f32) -> bool {
        let motion = Motion {
            contraction: CONTRACTION,
            speed_m_per_s,
        };
        let before_n = from_balance_n - from_balance_n.signum();
        motion.exceeds_limb_energy(
            &VALUES,
            WEIGHT_N,
            away_pa(before_n),
            away_pa(from_balance_n),
        )
    }

    /// The largest force on a limb of a weight that falls on it \[N\], by integration: the muscle
    /// is a spring about the rest position that the reference gives it.
    fn limb_n(from_balance_n: f64, speed_m_per_s: f64, above_m: f64) -> f64 {
        let muscle = &VALUES.muscle;
        let pressure = GaugePa(away_pa(from_balance_n as f32));
        let stiffness_n_per_m =
            f64::from(muscle.stiffness_n(CONTRACTION, pressure) / muscle.initial_length_m);
        let (limb_n_per_m, mass_kg) =
            (f64::from(LIMB_STIFFNESS_N_PER_M), f64::from(VALUES.load_kg));
        let (mut height_m, mut speed_m_per_s, mut most_n) = (above_m, speed_m_per_s, 0.0_f64);
        const STEP_S: f64 = 1e-5;
        for _ in 0..40_000 {
            let push_n = limb_n_per_m * (-height_m).max(0.0);
            let pull_n = from_balance_n - stiffness_n_per_m * (height_m - above_m);
            speed_m_per_s += STEP_S * (push_n + pull_n) / mass_kg;
            height_m += STEP_S * speed_m_per_s;
            most_n = most_n.max(push_n);
        }
        most_n
    }

    /// Wherever the limb is, and whichever way the weight moves: the largest force is reached where
    /// the limb stops it in balance.
    #[test]
    fn what_is_just_permitted_meets_a_limb_with_the_permitted_force() {
        for speed_m_per_s in [0.0_f32, 0.1, -0.1, 0.2, -0.2, 0.26, -0.26] {
            let mut below_n = 0.0;
            while !is_refused(below_n - 0.5, speed_m_per_s) {
                below_n -= 0.5;
                assert!(below_n > -100.0, "{speed_m_per_s}: nothing is refused");
            }
            let forces_n = (0..60)
                .map(|mm| limb_n(below_n.into(), speed_m_per_s.into(), 5e-4 * f64::from(mm)));
            let most_n = forces_n.fold(0.0, f64::max);
            assert!(
                (250.0..262.0).contains(&most_n),
                "{speed_m_per_s} m/s, {below_n} N: {most_n} N"
            );
        }
    }

    #[test]
    fn a_step_towards_balance_is_never_refused_and_a_fast_weight_is_not_driven_on() {
        let motion = |speed_m_per_s| Motion {
            contraction: CONTRACTION,
            speed_m_per_s,
        };
        for speed_m_per_s in [0.1, -0.1, 0.3, -0.3, 5.0, -5.0] {
            let towards = [(-90.0, -80.0), (90.0, 80.0), (-2.0, -1.0)];
            for (from_n, to_n) in towards {
                let (from_pa, to_pa) = (away_pa(from_n), away_pa(to_n));
                assert!(
                    !motion(speed_m_per_s).exceeds_limb_energy(&VALUES, WEIGHT_N, from_pa, to_pa)
                );
            }
        }
        // 260 N are 0.274 m/s of 12 kg on 75 N/mm.
        for away_n in [2.0, -2.0] {
            assert!(!is_refused(away_n, 0.27) && !is_refused(away_n, -0.27));
            assert!(is_refused(away_n, 0.28) && is_refused(away_n, -0.28));
        }
    }

    /// At ε = 0.1 the rope is slack below 110 kPa: there the reference changes no force.
    #[test]
    fn where_the_rope_is_slack_nothing_is_refused() {
        let motion = Motion {
            contraction: 0.1,
            speed_m_per_s: -0.25,
        };
        let refused =
            |now_pa, next_pa| motion.exceeds_limb_energy(&VALUES, WEIGHT_N, now_pa, next_pa);
        assert!(refused(1.3e5, 1.28e5) && !refused(0.9e5, 0.88e5));
    }

    #[test]
    fn nothing_is_refused_by_what_is_no_number() {
        let motion = |contraction, speed_m_per_s| Motion {
            contraction,
            speed_m_per_s,
        };
        let nan = f32::NAN;
        for (motion, now_pa, next_pa) in [
            (motion(nan, -1.0), 2e5, 1e5),
            (motion(CONTRACTION, nan), 2e5, 1e5),
            (motion(CONTRACTION, -1.0), nan, 1e5),
            (motion(CONTRACTION, -1.0), 2e5, nan),
        ] {
            assert!(
                !motion.exceeds_limb_energy(&VALUES, WEIGHT_N, now_pa, next_pa),
                "{motion:?}"
            );
        }
        let may = |contraction, speed| motion(contraction, speed).may_meet_limb(&VALUES);
        assert!(!may(nan, -1.0) && !may(CONTRACTION, nan));
        assert!(!may(0.01, -1.0) && may(0.03, -1.0));
        assert!(!may(0.1, 0.01) && may(0.1, 0.03));
        // Two counts of 1 mm in two ticks are 0.1 m/s.
        let coarse = SettingsValues {
            encoder_m_per_count: 1e-3,
            ..VALUES
        };
        for (speed_m_per_s, expected) in [(0.09, false), (0.11, true), (-0.11, true)] {
            assert_eq!(motion(0.1, speed_m_per_s).may_meet_limb(&coarse), expected);
        }
    }
}

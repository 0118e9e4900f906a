//! Are the sensors consistent with each other, and the muscle with its reference? Each reading may
//! be plausible by itself and the set of them still impossible.

use crate::constants::{GRAVITY_M_PER_S2, TICK_S};
use crate::limits::{FORCE_BALANCE_MEAN_S, OVER_SPEED, OVER_SPEED_TICKS, STOP_CONTRACTION};
use crate::number::Number;
use crate::plausibility::BadTickCount;
use crate::pressure::GaugePa;
use crate::settings::SettingsValues;
use serde::{Deserialize, Serialize};

/// The pressure that the slowest acceptable valve would reach while it follows the reference.
///
/// dP_s/dt = (P_r − P_s)/τ, which is Eq 9 with Eq 3 linearised at constant temperature and volume:
/// τ = V/(RθK_G). A healthy muscle's pressure lies between P_s and P_r.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PressureFollower {
    /// P_s \[Pa\].
    slow_pa: f32,
    /// Ticks with the pressure outside.
    outside: BadTickCount,
}

impl PressureFollower {
    /// One tick later, in which the reference was `reference_pa` and `pressure_pa` was read.
    pub fn next(
        mut self,
        values: &SettingsValues,
        reference_pa: f32,
        pressure_pa: f32,
    ) -> PressureFollower {
        let share = (TICK_S / values.pressure_lag_s).at_most(1.0);
        self.slow_pa += share * (reference_pa - self.slow_pa);
        let low_pa = self.slow_pa.at_most(reference_pa) - values.pressure_error_pa_max;
        let high_pa = self.slow_pa.at_least(reference_pa) + values.pressure_error_pa_max;
        let within = pressure_pa >= low_pa && pressure_pa <= high_pa;
        self.outside.add(!within, values.suspect_ticks);
        self
    }

    /// P_s \[Pa\].
    pub fn slow_pa(&self) -> f32 {
        self.slow_pa
    }

    /// True if the pressure has been between P_s and P_r for a while.
    pub fn is_calm(&self) -> bool {
        self.outside.is_empty()
    }

    /// True if the pressure was outside for too long.
    pub fn has_failed(&self, values: &SettingsValues) -> bool {
        self.outside.is_full(values.suspect_ticks)
    }
}

/// Eq 5 as a test: the residual of M L ε̈ = F(P, ε) − M g, averaged over a tenth of a second.
///
/// The tolerance includes friction and damping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceBalance {
    /// Contraction and force \[N\] of the last tick; contraction of the one before.
    last: Option<(f32, f32)>,
    before: Option<f32>,
    /// The mean residual \[N\].
    error_n: f32,
    /// Ticks with the residual outside its tolerance.
    outside: BadTickCount,
    /// Ticks in a row in which the weight was too fast.
    fast_ticks: u8,
}

impl ForceBalance {
    /// One tick later; `missed` if ticks are missing in between.
    pub fn next(
        mut self,
        values: &SettingsValues,
        contraction: f32,
        pressure_pa: f32,
        missed: bool,
    ) -> ForceBalance {
        let muscle = &values.muscle;
        // The muscle pulls on a rope, which cannot push.
        let force_n = muscle
            .force_n(contraction, GaugePa(pressure_pa))
            .at_least(0.0);
        if let (Some(before), Some((last, last_n)), false) = (self.before, self.last, missed) {
            let change_per_tick2 = contraction - 2.0 * last + before;
            let acceleration_m_per_s2 =
                muscle.initial_length_m * change_per_tick2 / (TICK_S * TICK_S);
            let weight_n = values.load_kg * (GRAVITY_M_PER_S2 as f32 + acceleration_m_per_s2);
            let residual_n = last_n - weight_n;
            // On its stop the weight is carried by the stop as far as the muscle does not.
            let residual_n = if last < STOP_CONTRACTION {
                residual_n.at_least(0.0)
            } else {
                residual_n
            };
            self.error_n += (TICK_S / FORCE_BALANCE_MEAN_S) * (residual_n - self.error_n);
        }
        let within = libm::fabsf(self.error_n) <= values.force_error_n_max;
        self.outside.add(!within, values.suspect_ticks);
        let two_ticks_m = self.before.map_or(0.0, |before| {
            muscle.initial_length_m * (contraction - before)
        });
        let fast_m = OVER_SPEED * values.reference_speed_m_per_s_max * 2.0 * TICK_S;
        let fast = !missed && libm::fabsf(two_ticks_m) > fast_m;
        self.fast_ticks = if fast {
            self.fast_ticks.saturating_add(1)
        } else {
            0
        };
        self.before = if missed {
            None
        } else {
            self.last.map(|(last, _)| last)
        };
        self.last = Some((contraction, force_n));
        self
    }

    /// True if the weight was too fast for longer than a jump of the encoder stays in the
    /// differences over two ticks.
    pub fn is_too_fast(&self) -> bool {
        self.fast_ticks >= OVER_SPEED_TICKS
    }

    /// True if the residual was outside its tolerance for too long.
    pub fn has_failed(&self, values: &SettingsValues) -> bool {
        self.outside.is_full(values.suspect_ticks)
    }
}

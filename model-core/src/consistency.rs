//! Do the sensors fit each other, and the muscle its reference? What no single reading tells.

use crate::plausibility::Tally;
use crate::pressure::GaugePa;
use crate::settings::{STOP_CONTRACTION, SettingsValues, TICK_S};
use serde::{Deserialize, Serialize};

/// Standard gravity g \[m/s²\].
const GRAVITY_M_PER_S2: f32 = 9.80665;
/// Time over which the force balance is averaged \[s\]: longer than an oscillation of hose or
/// encoder, shorter than the weight's on the muscle (a quarter of a second).
const BALANCE_S: f32 = 0.1;

/// The pressure of the slowest valve that would still do, on its way after the reference.
///
/// dP_s/dt = (P_r − P_s)/τ, which is Eq 9 with Eq 3 linearised at constant temperature and volume:
/// τ = V/(RθK_G). A healthy muscle's pressure lies between P_s and P_r.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PressureFollower {
    /// P_s \[Pa\].
    slow_pa: f32,
    astray: Tally,
}

impl PressureFollower {
    /// One tick later, in which the reference was `reference_pa` and `pressure_pa` was read.
    pub fn next(
        mut self,
        values: &SettingsValues,
        reference_pa: f32,
        pressure_pa: f32,
    ) -> PressureFollower {
        let share = (TICK_S / values.pressure_lag_s).min(1.0);
        self.slow_pa += share * (reference_pa - self.slow_pa);
        let low_pa = self.slow_pa.min(reference_pa) - values.pressure_error_pa_max;
        let high_pa = self.slow_pa.max(reference_pa) + values.pressure_error_pa_max;
        let within = pressure_pa >= low_pa && pressure_pa <= high_pa;
        self.astray.add(!within, values.suspect_ticks);
        self
    }

    /// P_s \[Pa\].
    pub fn slow_pa(&self) -> f32 {
        self.slow_pa
    }

    /// The pressure was where it is to be, for a while.
    pub fn is_calm(&self) -> bool {
        self.astray.is_empty()
    }

    /// The pressure was elsewhere for too long.
    pub fn has_failed(&self, values: &SettingsValues) -> bool {
        self.astray.is_full(values.suspect_ticks)
    }
}

/// Eq 5 as a test: M L ε̈ = F(P, ε) − M g, the mean of what is left over a tenth of a second.
///
/// Friction and damping are left in the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceBalance {
    /// Contraction and force \[N\] of the last tick; contraction of the one before.
    last: Option<(f32, f32)>,
    before: Option<f32>,
    /// The mean \[N\].
    error_n: f32,
    astray: Tally,
    /// Ticks in a row in which the weight was too fast.
    fast_ticks: u8,
}

/// The speed that is a fault, over the reference's: what swings is stopped before it is twice as
/// fast, as a weight on a spring is whose rest begins to move.
pub const OVER_SPEED: f32 = 1.5;

impl ForceBalance {
    /// One tick later, `missed` where ticks are missing in between.
    pub fn next(
        mut self,
        values: &SettingsValues,
        contraction: f32,
        pressure_pa: f32,
        missed: bool,
    ) -> ForceBalance {
        let muscle = &values.muscle;
        // A rope does not push.
        let force_n = muscle.force_n(contraction, GaugePa(pressure_pa)).max(0.0);
        if let (Some(before), Some((last, last_n)), false) = (self.before, self.last, missed) {
            let change_per_tick2 = contraction - 2.0 * last + before;
            let acceleration_m_per_s2 =
                muscle.initial_length_m * change_per_tick2 / (TICK_S * TICK_S);
            let weight_n = values.load_kg * (GRAVITY_M_PER_S2 + acceleration_m_per_s2);
            let left_n = last_n - weight_n;
            // The stop carries what the muscle does not.
            let left_n = if last < STOP_CONTRACTION {
                left_n.max(0.0)
            } else {
                left_n
            };
            self.error_n += (TICK_S / BALANCE_S) * (left_n - self.error_n);
        }
        let within =
            self.error_n <= values.force_error_n_max && self.error_n >= -values.force_error_n_max;
        self.astray.add(!within, values.suspect_ticks);
        let two_ticks_m = self.before.map_or(0.0, |before| {
            muscle.initial_length_m * (contraction - before)
        });
        let fast_m = OVER_SPEED * values.reference_speed_m_per_s_max * 2.0 * TICK_S;
        let fast = !missed && (two_ticks_m > fast_m || two_ticks_m < -fast_m);
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

    /// The weight was too fast, for longer than a jump of the encoder lasts in two differences.
    pub fn is_too_fast(&self) -> bool {
        self.fast_ticks >= 2
    }

    /// The forces did not fit for too long.
    pub fn has_failed(&self, values: &SettingsValues) -> bool {
        self.astray.is_full(values.suspect_ticks)
    }
}

//! Are the sensors consistent with each other, and the muscle with its reference? Each reading may
//! be plausible by itself and the set of them still impossible.

use crate::constants::{GRAVITY_M_PER_S2, TICK_S};
use crate::contact::Motion;
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
    /// So many ticks later, in which the reference was `reference_pa` and `pressure_pa` was read at
    /// the end.
    pub fn next(
        mut self,
        values: &SettingsValues,
        reference_pa: f32,
        pressure_pa: f32,
        ticks: u16,
    ) -> PressureFollower {
        let share = (f32::from(ticks) * TICK_S / values.pressure_lag_s).at_most(1.0);
        self.slow_pa += share * (reference_pa - self.slow_pa);
        let off_pa = pressure_pa - self.limited_pa(reference_pa, pressure_pa);
        let within = libm::fabsf(off_pa) <= values.pressure_error_pa_max;
        let outside_ticks = if within { 0 } else { ticks };
        self.outside.add_ticks(outside_ticks, values.suspect_ticks);
        self
    }

    /// P_s \[Pa\].
    pub fn slow_pa(&self) -> f32 {
        self.slow_pa
    }

    /// `pressure_pa`, limited to between P_s and the reference; the larger of the two for NaN.
    pub fn limited_pa(&self, reference_pa: f32, pressure_pa: f32) -> f32 {
        let least_pa = self.slow_pa.at_most(reference_pa);
        let most_pa = self.slow_pa.at_least(reference_pa);
        pressure_pa.at_most(most_pa).at_least(least_pa)
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

/// Eq 5 as a test: the residual of M L ε̈ = F(P, ε) − M g, averaged over a tenth of a second. And
/// the speed of the weight.
///
/// Both are taken over the ticks that have passed, of which some may have been missed. The
/// tolerance of the residual includes friction and damping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ForceBalance {
    /// What was read last.
    last: Option<Read>,
    /// What was read before that.
    before: Option<Read>,
    /// Acceleration at the reading before the last \[m/s²\], upwards.
    acceleration_m_per_s2: f32,
    /// Mean of the residual \[N\].
    error_n: f32,
    /// Ticks with the residual outside its tolerance.
    outside: BadTickCount,
    /// Speed over the last two ticks \[m/s\], upwards.
    speed_m_per_s: f32,
    /// Ticks in a row in which the weight was too fast.
    fast_ticks: u16,
}

/// What a tick has read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Read {
    contraction: f32,
    force_n: f32,
    /// Ticks since the reading before it.
    ticks: u16,
}

impl ForceBalance {
    /// So many ticks later.
    pub fn next(
        mut self,
        values: &SettingsValues,
        contraction: f32,
        pressure_pa: f32,
        ticks: u16,
    ) -> ForceBalance {
        let muscle = &values.muscle;
        // The muscle pulls on a rope, which cannot push.
        let force_n = muscle
            .force_n(contraction, GaugePa(pressure_pa))
            .at_least(0.0);
        let now = Read {
            contraction,
            force_n,
            ticks,
        };
        let passed_s = f32::from(ticks) * TICK_S;
        if let (Some(before), Some(last)) = (self.before, self.last) {
            let change_per_s2 = change_per_s2(&before, &last, &now);
            self.acceleration_m_per_s2 = muscle.initial_length_m * change_per_s2;
            let residual_n = residual_n(values, &last, self.acceleration_m_per_s2);
            let share = (passed_s / FORCE_BALANCE_MEAN_S).at_most(1.0);
            self.error_n += share * (residual_n - self.error_n);
        }
        let within = libm::fabsf(self.error_n) <= values.force_error_n_max;
        let outside_ticks = if within { 0 } else { ticks };
        self.outside.add_ticks(outside_ticks, values.suspect_ticks);
        // Over two ticks at least, in which counts of the encoder are no speed yet.
        let (since, since_s) = match (self.before, self.last) {
            (Some(before), Some(last)) if ticks < 2 => {
                (Some(before), passed_s + f32::from(last.ticks) * TICK_S)
            }
            (_, last) => (last.filter(|_| ticks >= 2), passed_s),
        };
        let moved_m = since.map_or(0.0, |since| {
            muscle.initial_length_m * (contraction - since.contraction)
        });
        self.speed_m_per_s = moved_m / since_s;
        let fast_m = OVER_SPEED * values.reference_speed_m_per_s_max * since_s;
        self.fast_ticks = if libm::fabsf(moved_m) > fast_m {
            self.fast_ticks.saturating_add(ticks)
        } else {
            0
        };
        (self.before, self.last) = (self.last, Some(now));
        self
    }

    /// True if the weight was too fast for longer than a jump of the encoder stays in the
    /// differences over two ticks.
    pub fn is_too_fast(&self) -> bool {
        self.fast_ticks >= OVER_SPEED_TICKS
    }

    /// Speed over the last two ticks \[m/s\], upwards; 0 before the second one.
    pub fn speed_m_per_s(&self) -> f32 {
        self.speed_m_per_s
    }

    /// The weight's motion at the reading before the last; none before the second reading.
    pub fn motion(&self) -> Option<Motion> {
        let before = self.before?;
        Some(Motion {
            contraction: before.contraction,
            speed_m_per_s: self.speed_m_per_s,
        })
    }

    /// Acceleration at the reading before the last \[m/s²\], upwards; 0 before the third reading.
    pub fn acceleration_m_per_s2(&self) -> f32 {
        self.acceleration_m_per_s2
    }

    /// True if the residual was outside its tolerance for too long.
    pub fn has_failed(&self, values: &SettingsValues) -> bool {
        self.outside.is_full(values.suspect_ticks)
    }
}

/// d²ε/dt² \[1/s²\] at `last`, by the three readings about it: exact for a parabola, however many
/// ticks lie between them.
fn change_per_s2(before: &Read, last: &Read, now: &Read) -> f32 {
    let [first_s, second_s] = [last.ticks, now.ticks].map(|ticks| f32::from(ticks) * TICK_S);
    let rate_before_per_s = (last.contraction - before.contraction) / first_s;
    let rate_after_per_s = (now.contraction - last.contraction) / second_s;
    (rate_after_per_s - rate_before_per_s) / (0.5 * (first_s + second_s))
}

/// Residual of Eq 5 \[N\] at `last`, where the weight has this acceleration.
fn residual_n(values: &SettingsValues, last: &Read, acceleration_m_per_s2: f32) -> f32 {
    let weight_n = values.load_kg * (GRAVITY_M_PER_S2 as f32 + acceleration_m_per_s2);
    let residual_n = last.force_n - weight_n;
    // On its stop the weight is carried by the stop as far as the muscle does not.
    if last.contraction < STOP_CONTRACTION {
        residual_n.at_least(0.0)
    } else {
        residual_n
    }
}

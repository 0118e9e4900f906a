//! Retreat: lifts the weight off what it was let down on, such as a foot.
//!
//! A limb below the weight looks like this: the weight rests above its stop, although the muscle
//! carries nothing of it. What a payload leaves that was lost does not rest there, it falls.

use crate::constants::GRAVITY_M_PER_S2;
use crate::contact::Motion;
use crate::limits::{
    RETREAT_CARRIED, RETREAT_M, RETREAT_MOVED, RETREAT_RESTS_TICKS, RETREAT_TICKS, RETREATS_MAX,
};
use crate::number::Number;
use crate::pressure::GaugePa;
use crate::reference::reference_pressure;
use crate::settings::SettingsValues;
use crate::supervisor::{Fault, Mode};
use serde::{Deserialize, Serialize};

/// State of the retreat between ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Retreat {
    /// The weight has not been on its stop since the muscle carried it: what an encoder that jumps
    /// lifts from there is no limb's.
    is_up: bool,
    /// Ticks for which the weight has rested on something; the count saturates.
    rests_ticks: u8,
    /// Ticks of all retreats up to now: one is going on unless they are a multiple of
    /// [`RETREAT_TICKS`].
    ticks: u16,
    /// P_r \[Pa\] to which the weight is lifted.
    pressure_pa: f32,
}

/// Ticks of all retreats.
const TICKS_MAX: u16 = RETREATS_MAX as u16 * RETREAT_TICKS as u16;

/// What a tick knows of the weight.
#[derive(Clone, Copy, Debug)]
pub struct Rest {
    /// The weight's motion.
    pub motion: Motion,
    /// The pressure that the muscle may have at most \[Pa\], and when the encoder last moved.
    pub pressure_pa: f32,
    /// See `pressure_pa`.
    pub moved_at_pa: f32,
}

impl Rest {
    /// Whether the muscle carries less than this share of the weight with a pressure \[Pa\].
    fn carries_less(&self, values: &SettingsValues, pressure_pa: f32, share: f32) -> bool {
        let (weight_n, pressure) = (weight_n(values), GaugePa(pressure_pa));
        values.muscle.force_n(self.motion.contraction, pressure) < share * weight_n
    }

    /// Whether the weight rests although the muscle carries nothing of it, by an encoder that has
    /// moved since friction could hold it. One that stands still because it is frozen has not.
    fn is_on_something(&self, values: &SettingsValues) -> bool {
        self.motion.is_rest(values)
            && self.carries_less(values, self.pressure_pa, RETREAT_CARRIED)
            && self.carries_less(values, self.moved_at_pa, RETREAT_MOVED)
    }
}

fn weight_n(values: &SettingsValues) -> f32 {
    values.load_kg * GRAVITY_M_PER_S2 as f32
}

/// Whether a weight may be lifted in this mode, after this fault: the encoder is then right, and
/// air and valve are.
pub fn may_retreat(mode: Mode, fault: Option<Fault>) -> bool {
    let leaves_the_muscle = matches!(
        fault,
        None | Some(
            Fault::Bridge(_)
                | Fault::Pressure(_)
                | Fault::MissedTicks
                | Fault::ForceBalance
                | Fault::OverSpeed
                | Fault::Memory
                | Fault::EmergencyStop
                | Fault::StopContactsDiffer
        )
    );
    mode == Mode::Venting && leaves_the_muscle
}

impl Retreat {
    /// One tick later, with what it knows, if anything; `is_allowed` if [`may_retreat`] and the
    /// encoder is not in doubt. A retreat ends when it is no longer allowed, or the weight is on its
    /// stop.
    pub fn next(
        mut self,
        values: &SettingsValues,
        rest: Option<&Rest>,
        is_allowed: bool,
    ) -> Retreat {
        self.is_up = rest.is_some_and(|rest| {
            let is_carried = !rest.carries_less(values, rest.pressure_pa, RETREAT_MOVED);
            rest.motion.is_off_stop() && (self.is_up || is_carried)
        });
        let resting = rest.filter(|rest| self.is_up && rest.is_on_something(values));
        self.rests_ticks = resting.map_or(0, |_| self.rests_ticks.saturating_add(1));
        if !is_allowed || !self.is_up {
            self.end();
        } else if self.is_going_on() {
            self.ticks = self.ticks.saturating_add(1);
        }
        let may_begin = is_allowed && !self.is_going_on() && self.ticks < TICKS_MAX;
        if let Some(rest) = resting
            && may_begin
            && self.rests_on_something()
        {
            let muscle = &values.muscle;
            let lifted = rest.motion.contraction + RETREAT_M / muscle.initial_length_m;
            let (most, most_pa) = (values.contraction_max, GaugePa(values.pressure_pa_max));
            let lifted_pa = reference_pressure(muscle, weight_n(values), lifted, most, most_pa);
            self.pressure_pa = lifted_pa.0.at_least(0.0);
            self.ticks = self.ticks.saturating_add(1);
        }
        self
    }

    /// True if the weight has rested on something for a while.
    pub fn rests_on_something(&self) -> bool {
        self.rests_ticks >= RETREAT_RESTS_TICKS
    }

    fn is_going_on(&self) -> bool {
        !self.ticks.is_multiple_of(RETREAT_TICKS.into())
    }

    /// P_r \[Pa\] to which the weight is lifted, during a retreat.
    pub fn lifts_to_pa(&self) -> Option<f32> {
        self.is_going_on().then_some(self.pressure_pa)
    }

    /// Ends a retreat.
    pub fn end(&mut self) {
        self.ticks = self.ticks.next_multiple_of(RETREAT_TICKS.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plausibility::Doubt;

    const VALUES: SettingsValues = SettingsValues::reference();
    const WEIGHT_N: f32 = 12.0 * GRAVITY_M_PER_S2 as f32;

    /// Pressure \[Pa\] with which the muscle carries this share of the weight at ε = 0.1.
    fn carrying_pa(share: f32) -> f32 {
        let area_m2 = VALUES.muscle.force_per_pressure_m2(0.1);
        (share * WEIGHT_N - VALUES.muscle.gamma_n) / area_m2
    }

    /// A weight that rests at ε = 0.1 on something.
    fn at_rest() -> Rest {
        Rest {
            motion: Motion {
                contraction: 0.1,
                speed_m_per_s: 0.0,
            },
            pressure_pa: carrying_pa(0.0),
            moved_at_pa: carrying_pa(0.2),
        }
    }

    /// When the muscle carries the weight.
    fn carried() -> Retreat {
        let rest = Rest {
            pressure_pa: carrying_pa(1.0),
            ..at_rest()
        };
        Retreat::default().next(&VALUES, Some(&rest), true)
    }

    /// After so many ticks of this.
    fn rested(ticks: u8, change: impl Fn(&mut Rest), is_allowed: bool) -> Retreat {
        let mut rest = at_rest();
        change(&mut rest);
        (0..ticks).fold(carried(), |retreat, _| {
            retreat.next(&VALUES, Some(&rest), is_allowed)
        })
    }

    #[test]
    fn retreat_lifts_to_where_the_muscle_carries_the_weight_higher_up() {
        let nothing = |_: &mut Rest| {};
        assert_eq!(
            rested(RETREAT_RESTS_TICKS - 1, nothing, true).lifts_to_pa(),
            None
        );
        let retreat = rested(RETREAT_RESTS_TICKS, nothing, true);
        let pressure_pa = retreat.lifts_to_pa().expect("a retreat");
        let lifted = 0.1 + RETREAT_M / VALUES.muscle.initial_length_m;
        let force_n = VALUES.muscle.force_n(lifted, GaugePa(pressure_pa));
        assert!((force_n - WEIGHT_N).abs() < 1.0, "{force_n} N");
    }

    /// The muscle still pulls with 28 N when friction stops the weight on the limb; not with 47 N.
    #[test]
    fn what_friction_holds_on_a_limb_is_lifted_off() {
        for (share, lifts) in [(0.235, true), (0.4, false)] {
            let moved_at = |rest: &mut Rest| rest.moved_at_pa = carrying_pa(share);
            let retreat = rested(RETREAT_RESTS_TICKS, moved_at, true);
            assert_eq!(retreat.lifts_to_pa().is_some(), lifts, "{share}");
        }
    }

    #[test]
    fn nothing_is_lifted_that_no_limb_carries() {
        type Change = fn(&mut Rest);
        let none: [(&str, Change, bool); 8] = [
            ("not allowed", |_| {}, false),
            ("on its stop", |rest| rest.motion.contraction = 0.01, true),
            ("falls", |rest| rest.motion.speed_m_per_s = -0.05, true),
            ("rises", |rest| rest.motion.speed_m_per_s = 0.05, true),
            ("carried", |rest| rest.pressure_pa = carrying_pa(0.2), true),
            (
                "the encoder last moved when the muscle carried it: it is frozen",
                |rest| rest.moved_at_pa = carrying_pa(1.0),
                true,
            ),
            ("no number", |rest| rest.motion.contraction = f32::NAN, true),
            ("no pressure", |rest| rest.pressure_pa = f32::NAN, true),
        ];
        for (what, change, is_allowed) in none {
            assert_eq!(rested(40, change, is_allowed).lifts_to_pa(), None, "{what}");
        }
        // An encoder that jumps while the weight is on its stop.
        let on_stop = rested(1, |rest| rest.motion.contraction = 0.01, true);
        for begun in [
            Retreat::default(),
            on_stop,
            carried().next(&VALUES, None, true),
        ] {
            let jumped = (0..40).fold(begun, |retreat, _| {
                retreat.next(&VALUES, Some(&at_rest()), true)
            });
            assert_eq!(jumped.lifts_to_pa(), None);
        }
    }

    /// One that is found again and again is lifted three times, each time for 2.5 s.
    #[test]
    fn retreats_end_by_themselves_and_with_what_allows_them() {
        let (mut retreat, mut lifted_ticks) = (carried(), 0);
        for _ in 0..2000 {
            retreat = retreat.next(&VALUES, Some(&at_rest()), true);
            lifted_ticks += u32::from(retreat.lifts_to_pa().is_some());
        }
        assert_eq!(lifted_ticks, 3 * 249);
        let retreat = rested(RETREAT_RESTS_TICKS, |_| {}, true);
        let retreat = retreat.next(&VALUES, Some(&at_rest()), false);
        assert_eq!(retreat.lifts_to_pa(), None);
    }

    #[test]
    fn a_weight_is_lifted_only_while_venting_with_encoder_air_and_valve_intact() {
        for (mode, _) in Mode::NAMED {
            assert_eq!(may_retreat(*mode, None), *mode == Mode::Venting);
        }
        for fault in [
            Fault::Encoder(Doubt::Stuck),
            Fault::OverPressure,
            Fault::PressureControl,
            Fault::ValveVoltage,
            Fault::Uncommanded,
        ] {
            assert!(!may_retreat(Mode::Venting, Some(fault)), "{fault:?}");
        }
        for fault in [Fault::ForceBalance, Fault::Pressure(Doubt::Stuck)] {
            assert!(may_retreat(Mode::Venting, Some(fault)), "{fault:?}");
        }
    }
}

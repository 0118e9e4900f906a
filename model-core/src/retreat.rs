//! Retreat: lifts the weight off what it was let down on, such as a foot.
//!
//! A limb below the weight looks like this: the weight rests above its stop, although the muscle
//! carries nothing of it, some millimetres below where the muscle last carried it. A shelf looks
//! the same.

use crate::contact::{Motion, flicker_m};
use crate::limits::{
    RETREAT_CARRIED, RETREAT_CLEARS_M, RETREAT_GIVES_WAY_M, RETREAT_LACKING,
    RETREAT_LACKING_TOLERANCE, RETREAT_LET_GO, RETREAT_M, RETREAT_RESTS_TICKS, RETREAT_TICKS,
    RETREATS_MAX,
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
    /// ε \[-\] where the muscle last carried the weight, and some of it; or where it last fell.
    carried_at: f32,
    /// See `carried_at`.
    let_go_at: f32,
    /// Ticks for which the weight has rested on something; the count saturates.
    rests_ticks: u8,
    /// Ticks of all retreats up to now: one is going on unless they are a multiple of
    /// [`RETREAT_TICKS`].
    ticks: u16,
}

/// Ticks of all retreats.
const TICKS_MAX: u16 = RETREATS_MAX as u16 * RETREAT_TICKS as u16;

/// What a tick knows of the weight.
#[derive(Clone, Copy, Debug)]
pub struct Observed {
    /// The weight's motion, and its acceleration \[m/s²\], upwards.
    pub motion: Motion,
    /// See `motion`.
    pub acceleration_m_per_s2: f32,
    /// The pressure of the muscle \[Pa\]: at most, and P_r, which it is not much below while P_r
    /// falls.
    pub pressure_pa: f32,
    /// See `pressure_pa`.
    pub reference_pa: f32,
}

impl Observed {
    /// The muscle's force \[N\] with a pressure \[Pa\].
    fn force_n(&self, values: &SettingsValues, pressure_pa: f32) -> f32 {
        let pressure = GaugePa(pressure_pa);
        values.muscle.force_n(self.motion.contraction, pressure)
    }

    /// Whether the muscle carries this share of the weight at least, or the weight falls.
    fn carries(&self, values: &SettingsValues, share: f32) -> bool {
        let inertia_n = values.load_kg * self.acceleration_m_per_s2;
        let force_n = self.force_n(values, self.reference_pa).at_least(0.0);
        force_n - inertia_n >= share * values.weight_n()
    }

    /// Whether the weight rests although the muscle carries nothing of it.
    fn is_uncarried(&self, values: &SettingsValues) -> bool {
        let tolerance_n = RETREAT_LACKING_TOLERANCE * values.force_error_n_max;
        let lacking_n = (RETREAT_LACKING * values.weight_n()).at_least(tolerance_n);
        let lacks_n = values.weight_n() - self.force_n(values, self.pressure_pa);
        self.motion.is_off_stop() && self.motion.is_rest(values) && lacks_n >= lacking_n
    }
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
    /// encoder is not in doubt. A retreat ends, and counts as one, when it is no longer allowed,
    /// or the weight is on its stop.
    pub fn next(
        mut self,
        values: &SettingsValues,
        observed: Option<&Observed>,
        is_allowed: bool,
    ) -> Retreat {
        let Some(now) = observed.filter(|now| now.motion.contraction.is_finite()) else {
            self.rests_ticks = 0;
            self.end();
            return self;
        };
        if now.carries(values, RETREAT_CARRIED) && !self.is_going_on() {
            self.carried_at = now.motion.contraction;
        }
        if now.carries(values, RETREAT_LET_GO) {
            self.let_go_at = now.motion.contraction;
        }
        self.rests_ticks = if now.is_uncarried(values) && self.gives_way(values, now) {
            self.rests_ticks.saturating_add(1)
        } else {
            0
        };
        if !is_allowed || !now.motion.is_off_stop() {
            self.end();
        } else if self.is_going_on() || self.rests_on_something() && self.ticks < TICKS_MAX {
            self.ticks = self.ticks.saturating_add(1);
        }
        self
    }

    /// Whether the weight has sunk into what carries it, up to the end: an encoder that is frozen
    /// shows no such way, one that loses counts a longer one, or one that ends with a stop.
    fn gives_way(&self, values: &SettingsValues, now: &Observed) -> bool {
        let sunk_m = |from: f32| values.muscle.initial_length_m * (from - now.motion.contraction);
        RETREAT_GIVES_WAY_M.contains(&sunk_m(self.carried_at))
            && sunk_m(self.let_go_at) > flicker_m(values)
    }

    /// True if the weight has rested on something for a while.
    pub fn rests_on_something(&self) -> bool {
        self.rests_ticks >= RETREAT_RESTS_TICKS
    }

    fn is_going_on(&self) -> bool {
        !self.ticks.is_multiple_of(RETREAT_TICKS.into())
    }

    /// P_r \[Pa\] towards which it moves in a retreat, from `now_pa` at ε = `contraction`: no
    /// higher than friction and hysteresis may hold the weight back, and no higher than it is once
    /// the encoder shows that nothing else carries the weight.
    pub fn lifts_to_pa(
        &self,
        values: &SettingsValues,
        contraction: f32,
        now_pa: f32,
    ) -> Option<f32> {
        let muscle = &values.muscle;
        let clear = self.carried_at + RETREAT_CLEARS_M / muscle.initial_length_m;
        let highest = clear + RETREAT_M / muscle.initial_length_m;
        let most_pa = if contraction >= clear {
            now_pa
        } else {
            values.pressure_pa_max
        };
        self.is_going_on().then(|| {
            let (most, most_pa) = (values.contraction_max, GaugePa(most_pa));
            reference_pressure(muscle, values.weight_n(), highest, most, most_pa).0
        })
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

    /// Pressure \[Pa\] with which the muscle carries this share of the weight of these settings.
    fn carrying_pa(values: &SettingsValues, contraction: f32, share: f32) -> f32 {
        let area_m2 = values.muscle.force_per_pressure_m2(contraction);
        (share * values.weight_n() - values.muscle.gamma_n) / area_m2
    }

    /// A weight of these settings that is carried at ε = 0.1 and then has sunk by so much \[m\] to
    /// where it rests on something.
    fn on_limb(values: &SettingsValues, sunk_m: f32) -> (Retreat, Observed) {
        let observed = |sunk_m: f32, share: f32| {
            let contraction = 0.1 - sunk_m / values.muscle.initial_length_m;
            let pressure_pa = carrying_pa(values, contraction, share);
            Observed {
                motion: Motion {
                    contraction,
                    speed_m_per_s: 0.0,
                },
                acceleration_m_per_s2: 0.0,
                pressure_pa,
                reference_pa: pressure_pa,
            }
        };
        let carried = Retreat::default().next(values, Some(&observed(0.0, 1.0)), true);
        (carried, observed(sunk_m, -0.4))
    }

    /// After so many ticks of this.
    fn rested(ticks: u8, sunk_m: f32, change: impl Fn(&mut Observed), allowed: bool) -> Retreat {
        let (carried, mut observed) = on_limb(&VALUES, sunk_m);
        change(&mut observed);
        (0..ticks).fold(carried, |retreat, _| {
            retreat.next(&VALUES, Some(&observed), allowed)
        })
    }

    const LIMB_M: f32 = 1.6e-3;

    #[test]
    fn what_rests_on_a_limb_for_a_while_is_lifted() {
        let nothing = |_: &mut Observed| {};
        let before = rested(RETREAT_RESTS_TICKS - 1, LIMB_M, nothing, true);
        assert!(!before.is_going_on());
        let begun = rested(RETREAT_RESTS_TICKS, LIMB_M, nothing, true);
        assert!(begun.is_going_on());
    }

    /// A foot clamped with 59 N, which no balance of forces with a tolerance of 105 N tells.
    #[test]
    fn a_light_weight_is_lifted_off_too() {
        let values = SettingsValues {
            load_kg: 6.0,
            ..VALUES
        };
        let (carried, observed) = on_limb(&values, 0.8e-3);
        let rested = (0..RETREAT_RESTS_TICKS).fold(carried, |retreat, _| {
            retreat.next(&values, Some(&observed), true)
        });
        assert!(rested.is_going_on());
    }

    /// An encoder that freezes after the weight has begun to press, whichever way it counts, or
    /// that shows a stop: the weight does not sink to the end.
    #[test]
    fn what_does_not_sink_to_the_end_is_no_limb() {
        let counts = VALUES.encoder_m_per_count;
        for encoder_m_per_count in [counts, -counts] {
            let values = SettingsValues {
                encoder_m_per_count,
                ..VALUES
            };
            let lifts = |frozen_share: f32| {
                let (carried, mut observed) = on_limb(&values, 1e-3);
                let last_pa = observed.pressure_pa;
                observed.reference_pa = carrying_pa(&values, 0.1, frozen_share);
                observed.pressure_pa = observed.reference_pa;
                let begun = carried.next(&values, Some(&observed), true);
                (observed.reference_pa, observed.pressure_pa) = (last_pa, last_pa);
                let rested = (0..40).fold(begun, |retreat, _| {
                    retreat.next(&values, Some(&observed), true)
                });
                rested.is_going_on()
            };
            assert!(!lifts(0.3) && lifts(0.1), "{encoder_m_per_count}");
        }
    }

    /// To where the muscle carries the weight 8 mm higher, or as high as the encoder shows.
    #[test]
    fn a_lift_ends_by_the_encoder() {
        let begun = rested(RETREAT_RESTS_TICKS, LIMB_M, |_| {}, true);
        let (_, on_limb) = on_limb(&VALUES, LIMB_M);
        let length_m = VALUES.muscle.initial_length_m;
        let clear = 0.1 + RETREAT_CLEARS_M / length_m;
        let highest_pa = carrying_pa(&VALUES, clear + RETREAT_M / length_m, 1.0);
        for (contraction, expected_pa) in [
            (on_limb.motion.contraction, highest_pa),
            (clear - 1e-4, highest_pa),
            (clear + 1e-4, 1.5e5),
        ] {
            let next_pa = begun.lifts_to_pa(&VALUES, contraction, 1.5e5);
            let next_pa = next_pa.expect("a retreat");
            assert!(
                (next_pa - expected_pa).abs() < 10.0,
                "{next_pa} {expected_pa}"
            );
        }
    }

    #[test]
    fn nothing_is_lifted_that_no_limb_carries() {
        type Change = fn(&mut Observed);
        let nothing: Change = |_| {};
        let none: [(&str, f32, Change, bool); 10] = [
            ("not allowed", LIMB_M, nothing, false),
            ("the encoder is frozen", 0.0, nothing, true),
            (
                "it loses counts, or gives way like a rope",
                0.02,
                nothing,
                true,
            ),
            ("it jumps upwards on the stop", -0.014, nothing, true),
            (
                "on its stop",
                LIMB_M,
                |observed| observed.motion.contraction = 0.01,
                true,
            ),
            (
                "falls",
                LIMB_M,
                |observed| observed.motion.speed_m_per_s = -0.05,
                true,
            ),
            (
                "rises",
                LIMB_M,
                |observed| observed.motion.speed_m_per_s = 0.05,
                true,
            ),
            (
                "carried",
                LIMB_M,
                |observed| observed.pressure_pa = carrying_pa(&VALUES, 0.1, 0.2),
                true,
            ),
            (
                "no number",
                LIMB_M,
                |observed| observed.motion.contraction = f32::NAN,
                true,
            ),
            (
                "no pressure",
                LIMB_M,
                |observed| observed.pressure_pa = f32::NAN,
                true,
            ),
        ];
        for (what, sunk_m, change, is_allowed) in none {
            let rested = rested(40, sunk_m, change, is_allowed);
            assert!(!rested.is_going_on(), "{what}");
        }
    }

    /// One that is found again and again is lifted three times, each time for 2.5 s.
    #[test]
    fn retreats_end_by_themselves_and_with_what_allows_them() {
        let (mut retreat, observed) = on_limb(&VALUES, LIMB_M);
        let mut lifted_ticks = 0;
        for _ in 0..2000 {
            retreat = retreat.next(&VALUES, Some(&observed), true);
            lifted_ticks += u32::from(retreat.is_going_on());
        }
        assert_eq!(lifted_ticks, 3 * 249);
        let retreat = rested(RETREAT_RESTS_TICKS, LIMB_M, |_| {}, true);
        let on_stop = Observed {
            motion: Motion {
                contraction: 0.01,
                ..observed.motion
            },
            ..observed
        };
        for ended in [
            retreat.next(&VALUES, Some(&observed), false),
            retreat.next(&VALUES, Some(&on_stop), true),
            retreat.next(&VALUES, None, true),
        ] {
            assert!(!ended.is_going_on());
        }
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

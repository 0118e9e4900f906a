//! Retreat: lifts the weight off what it was let down on, such as a foot.
//!
//! A limb below the weight looks like this: the muscle carries less and less of the weight, until
//! it carries nothing, and meanwhile the weight sinks by the few millimetres that the limb gives
//! way. A payload that was lost leaves the muscle without force, too, but then the weight moves.

use crate::constants::GRAVITY_M_PER_S2;
use crate::limits::{
    RETREAT_FRICTION, RETREAT_GIVES_WAY_M, RETREAT_M, RETREAT_RESTS_TICKS, RETREAT_TICKS,
    RETREATS_MAX,
};
use crate::number::Number;
use crate::pressure::GaugePa;
use crate::reference::reference_pressure;
use crate::settings::SettingsValues;
use crate::supervisor::{Fault, Mode};
use serde::{Deserialize, Serialize};

/// State of the retreat between ticks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Retreat {
    /// ε \[-\] where the muscle last carried the weight.
    carried_at: f32,
    /// Ticks since then, at most [`GONE`]; this if the weight has moved further from there than a
    /// limb gives way, or was never carried.
    carried_ticks: u8,
    /// Ticks of all retreats up to now: one is going on unless they are a multiple of
    /// [`RETREAT_TICKS`].
    ticks: u16,
    /// P_r \[Pa\] to which the weight is lifted.
    pressure_pa: f32,
}

/// See [`Retreat::carried_ticks`].
const GONE: u8 = u8::MAX;

/// Ticks of all retreats.
const TICKS_MAX: u16 = RETREATS_MAX as u16 * RETREAT_TICKS as u16;

impl Default for Retreat {
    fn default() -> Retreat {
        Retreat {
            carried_at: 0.0,
            carried_ticks: GONE,
            ticks: 0,
            pressure_pa: 0.0,
        }
    }
}

/// What a tick knows of the weight.
#[derive(Clone, Copy, Debug)]
pub struct Carried {
    /// ε \[-\], from home.
    pub contraction: f32,
    /// The residual of the force balance \[N\], and ε \[-\] for which it was taken.
    pub residual: Option<(f32, f32)>,
    /// The measured pressure \[Pa\].
    pub pressure_pa: f32,
    /// Pressures \[Pa\] that the muscle may have instead: the reference's, and the one at which the
    /// encoder last moved.
    pub reference_pa: f32,
    /// See `reference_pa`.
    pub moved_at_pa: f32,
    /// The force balance has failed.
    pub is_out_of_balance: bool,
}

/// Whether a weight may be lifted in this mode, after this fault: pressure and encoder are then
/// right, and air and valve are.
pub fn may_retreat(mode: Mode, fault: Option<Fault>) -> bool {
    let leaves_the_muscle = matches!(
        fault,
        None | Some(
            Fault::Bridge(_)
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
    /// One tick later; `is_allowed` if [`may_retreat`] and no reading is in doubt. A retreat ends
    /// when it is no longer allowed.
    pub fn next(mut self, values: &SettingsValues, now: &Carried, is_allowed: bool) -> Retreat {
        let muscle = &values.muscle;
        let weight_n = values.load_kg * GRAVITY_M_PER_S2 as f32;
        let lacks_n =
            |pressure_pa| weight_n - muscle.force_n(now.contraction, GaugePa(pressure_pa));
        let sunk_m = |from: f32| muscle.initial_length_m * (from - now.contraction);
        let (least_m, most_m) = RETREAT_GIVES_WAY_M;
        // Also of a weight that falls: nothing carries it.
        if let Some((residual_n, contraction)) = now.residual
            && residual_n >= -0.5 * values.force_error_n_max
        {
            (self.carried_at, self.carried_ticks) = (contraction, 0);
        }
        let is_near = libm::fabsf(sunk_m(self.carried_at)) <= most_m;
        if self.carried_ticks < GONE - 1 && is_near {
            self.carried_ticks += 1;
        } else if !is_near {
            self.carried_ticks = GONE;
        }
        if !is_allowed {
            self.end();
        } else if self.is_going_on() {
            self.ticks = self.ticks.saturating_add(1);
        }
        let may_begin = is_allowed && !self.is_going_on() && self.ticks < TICKS_MAX;
        if may_begin
            && (RETREAT_RESTS_TICKS..GONE).contains(&self.carried_ticks)
            && now.is_out_of_balance
            && lacks_n(now.pressure_pa) > values.force_error_n_max
            && lacks_n(now.reference_pa) > values.force_error_n_max
            && lacks_n(now.moved_at_pa) > (1.0 - RETREAT_FRICTION) * values.force_error_n_max
            && sunk_m(self.carried_at) >= least_m
        {
            let lifted = now.contraction + RETREAT_M / muscle.initial_length_m;
            let (most, most_pa) = (values.contraction_max, GaugePa(values.pressure_pa_max));
            let lifted_pa = reference_pressure(muscle, weight_n, lifted, most, most_pa);
            self.pressure_pa = lifted_pa.0.at_least(0.0);
            self.ticks = self.ticks.saturating_add(1);
        }
        self
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

    const VALUES: SettingsValues = SettingsValues::reference();
    const WEIGHT_N: f32 = 12.0 * GRAVITY_M_PER_S2 as f32;

    /// Force of the muscle \[N\] of a weight that sinks by so much \[m\] from ε = 0.1 while it
    /// carries this share less: as readings, at a pressure for that force.
    fn carried(share: f32, sunk_m: f32) -> Carried {
        let muscle = &VALUES.muscle;
        let contraction = 0.1 - sunk_m / muscle.initial_length_m;
        let area_m2 = muscle.force_per_pressure_m2(contraction);
        let pressure_pa = (share * WEIGHT_N - muscle.gamma_n) / area_m2;
        Carried {
            contraction,
            residual: Some(((share - 1.0) * WEIGHT_N, contraction)),
            pressure_pa,
            reference_pa: pressure_pa,
            moved_at_pa: pressure_pa,
            is_out_of_balance: share < 0.06,
        }
    }

    /// The muscle carries less and less, down to a twentieth, while the weight sinks to `sunk_m`.
    fn let_down(sunk_m: f32, change: impl Fn(&mut Carried), is_allowed: bool) -> Retreat {
        (0..=40).fold(Retreat::default(), |retreat, step| {
            let share = 1.0 - 0.95 * step as f32 / 40.0;
            let mut now = carried(share, sunk_m * step as f32 / 40.0);
            change(&mut now);
            retreat.next(&VALUES, &now, is_allowed)
        })
    }

    #[test]
    fn retreat_lifts_to_where_the_muscle_carries_the_weight_higher_up() {
        let retreat = let_down(1.6e-3, |_| {}, true);
        let pressure_pa = retreat.lifts_to_pa().expect("a retreat");
        let lifted = 0.1 + (RETREAT_M - 1.6e-3) / VALUES.muscle.initial_length_m;
        let force_n = VALUES.muscle.force_n(lifted, GaugePa(pressure_pa));
        assert!((force_n - WEIGHT_N).abs() < 1.0, "{force_n} N");
    }

    /// The muscle still pulls with 28 N when friction stops the weight on the limb; not with 47 N.
    #[test]
    fn what_friction_holds_on_a_limb_is_lifted_off() {
        for (share, lifts) in [(0.235, true), (0.4, false)] {
            let moved_at_pa = carried(share, 1.6e-3).pressure_pa;
            let retreat = let_down(1.6e-3, |now| now.moved_at_pa = moved_at_pa, true);
            assert_eq!(retreat.lifts_to_pa().is_some(), lifts, "{share}");
        }
    }

    #[test]
    fn nothing_is_lifted_that_no_limb_carries() {
        let nothing = |_: &mut Carried| {};
        let limb_m = 1.6e-3;
        let none = [
            ("stands still", let_down(0.0, nothing, true)),
            ("payload is lost and rises", let_down(-0.02, nothing, true)),
            ("payload is lost and falls", let_down(0.02, nothing, true)),
            ("not allowed", let_down(limb_m, nothing, false)),
            (
                "in balance with its acceleration",
                let_down(limb_m, |now| now.is_out_of_balance = false, true),
            ),
            (
                "the reference carries it: the pressure sensor is wrong",
                let_down(limb_m, |now| now.reference_pa = 2e5, true),
            ),
            (
                "the encoder last moved when the muscle carried it: it is frozen",
                let_down(limb_m, |now| now.moved_at_pa = 1.5e5, true),
            ),
            (
                "no number",
                let_down(limb_m, |now| now.contraction = f32::NAN, true),
            ),
        ];
        for (what, retreat) in none {
            assert_eq!(retreat.lifts_to_pa(), None, "{what}");
        }
    }

    /// One that is found again and again is lifted three times, each time for 2.5 s.
    #[test]
    fn retreats_end_by_themselves_and_with_what_allows_them() {
        let mut retreat = let_down(1.6e-3, |_| {}, true);
        let now = carried(0.05, 1.6e-3);
        let mut lifted_ticks = 0;
        for _ in 0..2000 {
            lifted_ticks += u32::from(retreat.lifts_to_pa().is_some());
            retreat = retreat.next(&VALUES, &now, true);
        }
        assert_eq!(lifted_ticks, 3 * 249);
        let retreat = let_down(1.6e-3, |_| {}, true).next(&VALUES, &now, false);
        assert_eq!(retreat.lifts_to_pa(), None);
    }

    #[test]
    fn a_weight_is_lifted_only_while_venting_with_sensors_air_and_valve_intact() {
        for (mode, _) in Mode::NAMED {
            assert_eq!(may_retreat(*mode, None), *mode == Mode::Venting);
        }
        for fault in [
            Fault::OverPressure,
            Fault::PressureControl,
            Fault::Uncommanded,
        ] {
            assert!(!may_retreat(Mode::Venting, Some(fault)), "{fault:?}");
        }
        assert!(may_retreat(Mode::Venting, Some(Fault::ForceBalance)));
    }
}

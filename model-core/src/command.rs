//! The command of a tick: the force that the assist law demands, and the reference pressure that
//! follows, within its limits.

use crate::assist::reference_force_n;
use crate::constants::TICK_S;
use crate::contact::Motion;
use crate::io::Output;
use crate::limits::{CATCH_TICKS, DRIVEN_SPEED, EMPTIED_TICKS};
use crate::number::{Number, limited};
use crate::pressure::GaugePa;
use crate::reference::reference_pressure;
use crate::settings::SettingsValues;
use crate::state::{State, limited_pa};
use crate::supervisor::Mode;

/// The force to be reached, and the limits on the way there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// F_b \[N\], tared and limited.
    pub finger_force_n: f32,
    /// F_c \[N\], Eq 7, with the compensation of the load.
    pub reference_force_n: f32,
    /// The force of Eq 8 \[N\]: F_c with the compensation of the muscle's hysteresis.
    pub force_n: f32,
    /// ε \[-\].
    pub contraction: f32,
    /// Fastest change of the reference pressure \[Pa/s\]: it moves no faster than a weight in
    /// balance moves at the settings' speed.
    pub rate_pa_per_s_max: f32,
    /// True beyond the limit of travel: there the pressure may only fall.
    pub may_only_fall: bool,
    /// Speed of the weight \[m/s\], upwards, if it is faster than the reference may move it: the
    /// reference does not drive it on.
    pub fast_m_per_s: f32,
    /// The weight's motion, if it may meet a limb: the reference does not put more energy into it
    /// than a limb may receive.
    pub motion: Option<Motion>,
    /// Force of the muscle with which the weight rests \[N\]: M g, and what the compensation adds.
    pub balance_n: f32,
}

impl Target {
    /// The target at this `contraction`. The compensation follows the contraction.
    pub fn new(values: &SettingsValues, state: &mut State, contraction: f32) -> Target {
        let finger_force_n = limited(
            state.bridge.value() - state.tare_n,
            values.finger_force_n_max,
        );
        let (settings, muscle) = (&values.compensation, &values.muscle);
        let compensation = &mut state.compensation;
        compensation.follow(settings, muscle, contraction);
        let load_n = compensation.load_n(settings, muscle);
        let reference_force_n = reference_force_n(values.gain, finger_force_n) + load_n;
        let pressure = GaugePa(state.pressure.value());
        let hysteresis_n = compensation.hysteresis_n(settings, pressure);
        Target {
            finger_force_n,
            reference_force_n,
            force_n: reference_force_n + hysteresis_n,
            contraction,
            rate_pa_per_s_max: muscle.moving_rate_pa_per_s(
                values.reference_speed_m_per_s_max,
                contraction.at_least(0.0).at_most(values.contraction_max),
                GaugePa(state.pressure_ref_pa),
            ),
            may_only_fall: contraction > values.contraction_max,
            fast_m_per_s: fast_m_per_s(values, state.balance.speed_m_per_s()),
            motion: state
                .balance
                .motion()
                .filter(|motion| motion.may_meet_limb(values)),
            balance_n: values.weight_n() + load_n + hysteresis_n,
        }
    }
}

/// Moves the reference pressure as the state's mode has it; returns the tick's output.
pub fn act(values: &SettingsValues, state: &mut State, target: &Target) -> Output {
    let (now_pa, engaged) = (state.pressure_ref_pa, state.engaged);
    let mut next_pa = next_reference_pa(values, state, target);
    if is_step_refused(values, state, target, next_pa) {
        (next_pa, state.engaged) = (now_pa, engaged);
    }
    state.pressure_ref_pa = limited_pa(values, next_pa);
    state.empty_ticks = if state.pressure_ref_pa > 0.0 {
        0
    } else {
        state.empty_ticks.saturating_add(1)
    };
    if state.mode == Mode::Venting && state.empty_ticks >= EMPTIED_TICKS {
        state.port_open = false;
    }
    let pressure_ref = GaugePa(state.pressure_ref_pa);
    state.valve = values.valve_drive.count(pressure_ref);
    Output {
        valve: state.valve,
        mode: state.mode,
        fault: state.fault,
        pressure_ref,
        finger_force_n: target.finger_force_n,
        reference_force_n: target.reference_force_n,
        contraction: target.contraction,
        pressure: GaugePa(state.pressure.value()),
    }
}

/// `speed_m_per_s` if it is above that of the reference by [`DRIVEN_SPEED`], otherwise 0.
fn fast_m_per_s(values: &SettingsValues, speed_m_per_s: f32) -> f32 {
    let driven_m_per_s = DRIVEN_SPEED * values.reference_speed_m_per_s_max;
    if libm::fabsf(speed_m_per_s) > driven_m_per_s {
        speed_m_per_s
    } else {
        0.0
    }
}

/// Whether a limb in the weight's way could receive too much with a reference of `next_pa`. Not
/// while a test signal is played, where no person is near. On the ramp down only while the weight
/// falls, as one that rises may have lost its payload or have more pressure than the reference, and
/// only for [`CATCH_TICKS`], which no encoder can extend.
fn is_step_refused(values: &SettingsValues, state: &State, target: &Target, next_pa: f32) -> bool {
    let Some(motion) = target.motion else {
        return false;
    };
    let is_limited = match state.mode {
        Mode::Assisting => true,
        Mode::Venting => motion.speed_m_per_s < 0.0 && state.mode_ticks < CATCH_TICKS,
        Mode::SelfCheck | Mode::Ready | Mode::Holding | Mode::Playing => false,
    };
    let (balance_n, now_pa) = (target.balance_n, state.pressure_ref_pa);
    is_limited && motion.exceeds_limb_energy(values, balance_n, now_pa, next_pa)
}

/// Whether the reference is above the pressure in the muscle: the higher of the measured and the
/// expected one, as the sensor may have failed.
fn is_above_muscle(state: &State) -> bool {
    let reached_pa = state.pressure.value().at_least(state.follower.slow_pa());
    state.pressure_ref_pa > reached_pa
}

/// P_r \[Pa\] for the state's mode, limited in rate: Eq 8 while assisting.
fn next_reference_pa(values: &SettingsValues, state: &mut State, target: &Target) -> f32 {
    let now_pa = state.pressure_ref_pa;
    let rate_pa_per_s_max = target.rate_pa_per_s_max;
    let change_pa = |target_pa: f32| {
        let may_rise = !target.may_only_fall && target.fast_m_per_s <= 0.0;
        let may_fall = target.fast_m_per_s >= 0.0;
        let least_pa = if may_fall { 0.0 } else { now_pa };
        let most_pa = if may_rise { f32::MAX } else { now_pa };
        target_pa.at_least(least_pa).at_most(most_pa) - now_pa
    };
    match state.mode {
        Mode::SelfCheck | Mode::Ready => 0.0,
        Mode::Holding => now_pa,
        Mode::Venting => {
            let slow_pa_per_s = rate_pa_per_s_max.at_most(values.vent_rate_pa_per_s);
            match state
                .retreat
                .lifts_to_pa(values, target.contraction, now_pa)
            {
                Some(pressure_pa) => {
                    now_pa + limited(change_pa(pressure_pa), slow_pa_per_s * TICK_S)
                }
                // A weight that falls is not lowered on, for a time that no encoder can extend.
                None if target.fast_m_per_s < 0.0 && state.mode_ticks < CATCH_TICKS => now_pa,
                // The weight does not sink while the reference is above the pressure in the muscle.
                None if is_above_muscle(state) => now_pa - rate_pa_per_s_max * TICK_S,
                None => now_pa - slow_pa_per_s * TICK_S,
            }
        }
        Mode::Playing => {
            let requested_pa = state.played_pa.at_most(values.play_pressure_pa_max);
            now_pa + limited(change_pa(requested_pa), rate_pa_per_s_max * TICK_S)
        }
        Mode::Assisting => {
            let law = reference_pressure(
                &values.muscle,
                target.force_n,
                target.contraction,
                values.contraction_max,
                GaugePa(values.pressure_pa_max),
            );
            let rate_pa_per_s = if state.engaged {
                rate_pa_per_s_max
            } else {
                rate_pa_per_s_max.at_most(values.engage_rate_pa_per_s)
            };
            let pressure = GaugePa(state.pressure.value());
            let compensation = &mut state.compensation;
            let change_pa =
                change_pa(compensation.pressure_pa(&values.compensation, law.0, pressure));
            let step_pa = limited(change_pa, rate_pa_per_s * TICK_S);
            state.engaged = state.engaged || step_pa == change_pa;
            now_pa + step_pa
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALUES: SettingsValues = SettingsValues::reference();
    const BEFORE_PA: f32 = 2e5;

    /// The change of the reference \[Pa\] in a tick of this mode, for a demanded force, of a weight
    /// that moves so fast and meets no limb.
    fn change_pa(mode: Mode, force_n: f32, speed_m_per_s: f32, mode_ticks: u16) -> f32 {
        change_near_limb_pa(mode, force_n, speed_m_per_s, mode_ticks, false)
    }

    /// The same of one that may meet a limb, if `is_near_limb`.
    fn change_near_limb_pa(
        mode: Mode,
        force_n: f32,
        speed_m_per_s: f32,
        mode_ticks: u16,
        is_near_limb: bool,
    ) -> f32 {
        let mut state = State {
            mode,
            mode_ticks,
            pressure_ref_pa: BEFORE_PA,
            engaged: true,
            played_pa: 1e3 * force_n,
            ..State::default()
        };
        for tick in 0..3 {
            let moved = speed_m_per_s * TICK_S * tick as f32 / VALUES.muscle.initial_length_m;
            state.balance = state.balance.next(&VALUES, 0.1 + moved, BEFORE_PA, 1);
        }
        let target = Target::new(&VALUES, &mut state, 0.1);
        let target = Target {
            force_n,
            rate_pa_per_s_max: 4e5,
            motion: target.motion.filter(|_| is_near_limb),
            ..target
        };
        act(&VALUES, &mut state, &target).pressure_ref.0 - BEFORE_PA
    }

    /// It still moves against the motion, and while the weight is slower.
    #[test]
    fn a_fast_weight_is_not_driven_on() {
        let down_and_up = [
            (Mode::Assisting, 0.0, -1.0),
            (Mode::Assisting, 400.0, 1.0),
            (Mode::Playing, 0.0, -1.0),
        ];
        for (mode, force_n, sign) in down_and_up {
            for (speed_m_per_s, moves) in [(0.31, false), (0.29, true), (-0.31, true)] {
                let change_pa = change_pa(mode, force_n, sign * speed_m_per_s, 0);
                let expected_pa = if moves { sign * 4e3 } else { 0.0 };
                assert!(
                    (change_pa - expected_pa).abs() < 0.1,
                    "{mode:?} {change_pa}"
                );
            }
        }
    }

    /// The ramp down waits for it, but not for ever: an encoder may be wrong.
    #[test]
    fn the_ramp_waits_half_a_second_for_a_weight_that_falls() {
        for (speed_m_per_s, mode_ticks, falls) in [
            (-0.31, 0, false),
            (-0.31, 49, false),
            (-0.31, 50, true),
            (-0.29, 0, true),
            (0.31, 0, true),
            (f32::NAN, 0, true),
        ] {
            let change_pa = change_pa(Mode::Venting, 0.0, speed_m_per_s, mode_ticks);
            assert_eq!(change_pa < 0.0, falls, "{speed_m_per_s}, {mode_ticks}");
        }
    }

    /// At 200 kPa and ε = 0.1 the muscle pulls with 32 N more than the weight. The reference
    /// does not go further from balance, and always may go towards it.
    #[test]
    fn energy_that_a_limb_may_not_receive_is_not_added() {
        let change_pa = |mode, force_n, speed_m_per_s, mode_ticks| {
            change_near_limb_pa(mode, force_n, speed_m_per_s, mode_ticks, true)
        };
        for (speed_m_per_s, rises) in [(0.25, false), (-0.25, false), (0.01, true)] {
            let change = change_pa(Mode::Assisting, 400.0, speed_m_per_s, 0);
            assert_eq!(change > 0.0, rises, "{speed_m_per_s}");
            assert!(change_pa(Mode::Assisting, 0.0, speed_m_per_s, 0) < 0.0);
            for mode_ticks in [0, 49, 50] {
                assert!(change_pa(Mode::Venting, 0.0, speed_m_per_s, mode_ticks) < 0.0);
            }
        }
    }

    /// It waits half a second for a weight that would fall on a limb too hard, and so does what the
    /// lever asks for. A weight that rises is let down at once.
    #[test]
    fn the_ramp_does_not_drive_a_falling_weight_on() {
        let falls = |mode, mode_ticks, speed_m_per_s| {
            let mut state = State {
                mode,
                mode_ticks,
                pressure_ref_pa: 1.3e5,
                ..State::default()
            };
            let target = Target {
                motion: Some(Motion {
                    contraction: 0.1,
                    speed_m_per_s,
                }),
                ..Target::new(&VALUES, &mut state, 0.1)
            };
            let output = act(&VALUES, &mut state, &target);
            assert!(!state.engaged);
            output.pressure_ref.0 < 1.3e5
        };
        for (mode_ticks, expected) in [(0, false), (49, false), (50, true)] {
            assert_eq!(falls(Mode::Venting, mode_ticks, -0.2), expected);
            assert!(falls(Mode::Venting, mode_ticks, 0.2));
            assert!(falls(Mode::Venting, mode_ticks, f32::NAN));
            assert!(falls(Mode::Playing, mode_ticks, -0.2));
            assert!(!falls(Mode::Assisting, mode_ticks, -0.2));
            assert!(!falls(Mode::Assisting, mode_ticks, 0.2));
        }
    }
}

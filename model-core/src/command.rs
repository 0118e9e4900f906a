//! The command of a tick: the force that the assist law demands, and the reference pressure that
//! follows, within its limits.

use crate::assist::reference_force_n;
use crate::constants::TICK_S;
use crate::io::Output;
use crate::limits::EMPTIED_TICKS;
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
        let reference_force_n =
            reference_force_n(values.gain, finger_force_n) + compensation.load_n(settings, muscle);
        let pressure = GaugePa(state.pressure.value());
        Target {
            finger_force_n,
            reference_force_n,
            force_n: reference_force_n + compensation.hysteresis_n(settings, pressure),
            contraction,
            rate_pa_per_s_max: muscle.moving_rate_pa_per_s(
                values.reference_speed_m_per_s_max,
                contraction.at_least(0.0).at_most(values.contraction_max),
                GaugePa(state.pressure_ref_pa),
            ),
            may_only_fall: contraction > values.contraction_max,
        }
    }
}

/// Moves the reference pressure as the state's mode has it; returns the tick's output.
pub fn act(values: &SettingsValues, state: &mut State, target: &Target) -> Output {
    state.pressure_ref_pa = limited_pa(values, next_reference_pa(values, state, target));
    state.empty_ticks = if state.pressure_ref_pa > 0.0 {
        0
    } else {
        state.empty_ticks.saturating_add(1)
    };
    if state.mode == Mode::Venting && state.empty_ticks >= EMPTIED_TICKS {
        state.port_open = false;
    }
    let pressure_ref = GaugePa(state.pressure_ref_pa);
    Output {
        valve: values.valve_drive.count(pressure_ref),
        mode: state.mode,
        fault: state.fault,
        pressure_ref,
        finger_force_n: target.finger_force_n,
        reference_force_n: target.reference_force_n,
        contraction: target.contraction,
        pressure: GaugePa(state.pressure.value()),
    }
}

/// P_r \[Pa\] for the state's mode, limited in rate: Eq 8 while assisting.
fn next_reference_pa(values: &SettingsValues, state: &mut State, target: &Target) -> f32 {
    let now_pa = state.pressure_ref_pa;
    let rate_pa_per_s_max = target.rate_pa_per_s_max;
    let change_pa = |target_pa: f32| {
        if target.may_only_fall {
            target_pa.at_most(now_pa) - now_pa
        } else {
            target_pa - now_pa
        }
    };
    match state.mode {
        Mode::SelfCheck | Mode::Ready => 0.0,
        Mode::Holding => now_pa,
        Mode::Venting => {
            // The weight does not sink while the reference is above the pressure in the muscle. The
            // higher of the measured and the expected pressure is used, as the sensor may have
            // failed.
            let reached_pa = state.pressure.value().at_least(state.follower.slow_pa());
            let rate_pa_per_s = if now_pa > reached_pa {
                rate_pa_per_s_max
            } else {
                rate_pa_per_s_max.at_most(values.vent_rate_pa_per_s)
            };
            now_pa - rate_pa_per_s * TICK_S
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

//! Flipped bits in the device's memory.

use model_core::device::Hil;
use model_core::settings::SettingsValues;
use model_core::state::State;
use model_core::supervisor::{Fault, Mode};

/// Flips one bit of the state; `bit` is taken modulo their number.
pub fn flip_state(state: &mut State, bit: usize) {
    let float = |value: &mut f32, bit: usize| {
        let flipped = f32::from_bits(value.to_bits() ^ 1 << bit);
        // A flipped sign of zero has no effect: flips the lowest bit as well.
        let same = flipped == *value;
        *value = f32::from_bits(flipped.to_bits() ^ u32::from(same));
    };
    let (value, bit) = (bit / 32 % 12, bit % 32);
    match value {
        0 => float(&mut state.pressure_ref_pa, bit),
        1 => float(&mut state.tare_n, bit),
        2 => state.home.0 ^= 1 << bit,
        3 => state.mode = [Mode::SelfCheck, Mode::Ready, Mode::Holding, Mode::Venting][bit % 4],
        4 => state.engaged = !state.engaged,
        5 => state.mode_ticks ^= 1 << (bit % 16),
        6 => state.fault = state.fault.xor(Some(Fault::OverPressure)),
        7 => state.moved_to.0 ^= 1 << bit,
        8 => float(&mut state.moved_at_pa, bit),
        9 => float(&mut state.played_pa, bit),
        10 => state.silent_ticks ^= 1 << (bit % 8),
        _ => state.empty_ticks ^= 1 << (bit % 16),
    }
}

/// Flips one bit of the settings, whether the result is valid or not; `bit` is taken modulo their
/// number.
pub fn flip_settings(values: &mut SettingsValues, bit: usize) {
    let floats = [
        &mut values.gain,
        &mut values.pressure_pa_max,
        &mut values.muscle.alpha_m2,
        &mut values.bridge.per_count,
        &mut values.encoder_m_per_count,
        &mut values.valve_drive.pa_per_v,
        &mut values.vent_rate_pa_per_s,
        &mut values.reference_speed_m_per_s_max,
    ];
    let value = &mut *floats[bit / 32 % 8];
    *value = f32::from_bits(value.to_bits() ^ 1 << (bit % 32));
}

/// Switches hardware in the loop on or off.
pub fn flip_hil(hil: &mut Option<Hil>) {
    *hil = match hil {
        None => Some(Hil::default()),
        Some(_) => None,
    };
}

//! Limits, in two tables: those of the supervisor that are the same for every rig, and the physical
//! limits of every setting, which validation, messages and tests read.
//!
//! The supervisor's other limits are settings of a rig (`pressure_trip_pa`, `contraction_trip`, …):
//! [`SettingsValues`] holds them.

use crate::settings::SettingsValues;
use crate::signal::COUNT_MAX;
use core::ops::RangeInclusive;

/// Defines constants; each row has name, value, unit and reason.
macro_rules! supervisor_limits {
    ($($name:ident: $type:ty = $value:expr, $unit:literal, $reason:literal;)*) => {
        $(
            #[doc = concat!($reason, " Unit: ", $unit, ".")]
            pub const $name: $type = $value;
        )*
    };
}

supervisor_limits! {
    // Plausibility of one reading.
    ADC_VALID: RangeInclusive<u16> = 16..=COUNT_MAX - 16, "count",
        "Readings with an intact wire: nearer to an end of the scale it is open or shorted.";
    PRESSURE_PA_MIN: f32 = -2e4, "Pa, gauge",
        "Lowest plausible pressure: muscle and valve draw no vacuum.";
    STOP_CONTRACTION: f32 = 0.02, "1",
        "Contraction within which the weight is on its stop: 6 mm of the paper's muscle.";
    FLICKER_COUNTS: u32 = 2, "count",
        "Counts by which an encoder at rest may flicker.";
    RECOVERY_TICKS: u16 = 10, "tick",
        "Good ticks that take back a bad one: an intermittent fault is detected too.";

    // Consistency of the sensors with each other and with the reference.
    FORCE_BALANCE_MEAN_S: f32 = 0.1, "s",
        "Time over which the force balance is averaged: longer than an oscillation of hose or \
         encoder, shorter than the weight's on the muscle (a quarter of a second).";
    OVER_SPEED: f32 = 1.5, "1",
        "Speed that is a fault, over the reference's: the weight is stopped before it moves twice \
         as fast, as a weight on a spring does whose rest position begins to move.";
    OVER_SPEED_TICKS: u16 = 2, "tick",
        "Ticks in a row of that speed: a jump of the encoder stays in two differences.";

    // The valve's voltage, read back.
    READ_BACK_OFF_COUNTS: u16 = 64, "count",
        "Largest difference of the valve's voltage from the one that was set, as read back: offset \
         41 and nonlinearity 12 of an MCP4922 (DS22250), 5 of the converter that reads it. Of the \
         chip's DAC: 12 and 4 (DS10693), and 19 for 1 µA of leakage in its 15 kΩ.";
    READ_BACK_OFF_SHARE: u16 = 64, "1",
        "And this part of it besides, 1.6 %: 1 MΩ take 1.5 % behind 15 kΩ, the gain is off by \
         0.5 % (MCP4922: by 1 %, nothing is taken).";

    // What the reference does about a weight that is fast, before that is a fault.
    DRIVEN_SPEED: f32 = 1.2, "1",
        "Speed from which the reference does not drive the weight on, over the reference's: a \
         lever that is shaken with the weight's own frequency adds twice the reference's speed in \
         half a period.";
    CATCH_TICKS: u16 = 50, "tick",
        "Time in which the ramp down waits for a weight that falls: twice its own period.";

    // What a limb in the weight's way receives (crate::contact).
    LIMB_FORCE_N: f32 = 260.0, "N",
        "Force with which the weight may meet a foot that it does not clamp for longer than half a \
         second: ISO/TS 15066:2016, table A.2, lower leg, twice 130 N. 280 N are a hand's.";
    LIMB_STIFFNESS_N_PER_M: f32 = 75e3, "N/m",
        "Stiffness of the limb: the hand's (table A.3). The lower leg's 60 N/mm give less force.";
    LIMB_RESTING_M_PER_S: f32 = 0.02, "m/s",
        "Speed up to which the weight rests, so that the reference may go on: on a limb of 75 N/mm \
         the ramp moves it by 5 mm/s, and the encoder's flicker is 1.3 mm/s.";

    ENCODER_HELD: (f32, f32) = (0.8, 0.75), "1",
        "Largest change of the muscle's force without a count from the encoder, as a share of the \
         weight, which it is at most while the weight is let down, and at least of \
         `force_error_n_max`, as friction and hysteresis may hold that. `encoder_stuck_pa` may be \
         less.";

    // Retreat from what the weight was let down on.
    RETREAT_CARRIED: f32 = 0.5, "1",
        "Share of the weight with which the muscle carries it.";
    RETREAT_LET_GO: f32 = 0.15, "1",
        "The same from which on it does not: into a limb the weight sinks up to the end, by 0.1 mm \
         with this share on 200 N/mm.";
    RETREAT_LACKING: f32 = 0.9, "1",
        "Share of the weight that the muscle does not carry at least of what rests on something: \
         with the rest of it the weight does not hang, as the ramp goes on below it.";
    RETREAT_LACKING_TOLERANCE: f32 = 0.5, "1",
        "The same in `force_error_n_max`: what friction, hysteresis and the muscle's values make \
         of a weight that rests (docs/safety.md has up to 53 N).";
    RETREAT_GIVES_WAY_M: RangeInclusive<f32> = 2e-4..=6e-3, "m",
        "By how much the weight sinks while that half goes over to a limb: 59 N on 200 N/mm, \
         stiffer than a skull, to 10 N/mm, softer than a chest (ISO/TS 15066, table A.3).";
    RETREAT_RESTS_TICKS: u8 = 15, "tick",
        "Time for which it has rested then: at a turning point it does so for a tick or two.";
    RETREAT_CLEARS_M: f32 = 3e-3, "m",
        "Height of a retreat above where the muscle carried half of the weight: the other half has \
         pressed in a chest by 2.4 mm.";
    RETREAT_M: f32 = 5e-3, "m",
        "Height above that, up to which friction and hysteresis may hold the weight back (20 N \
         over the muscle's 4 N/mm): no reference for more. With an encoder that has jumped by \
         15 mm, which its step limit lets pass, 23 mm: in 25 mm no finger is crushed (ISO 13854).";
    RETREAT_TICKS: u8 = 250, "tick",
        "Time of a retreat: half a second to a second to rise at the ramp's rate, the rest to draw \
         a limb away.";
    RETREATS_MAX: u8 = 3, "1",
        "Retreats after a self-check: what is still below then is no limb.";

    // Time limits.
    EMPTIED_TICKS: u16 = 500, "tick",
        "Time after which a vented valve has emptied a muscle whose pressure sensor has failed.";
    PLAY_SILENCE_TICKS: u8 = 50, "tick",
        "Time without a requested pressure after which an experiment ends: half a second.";
    HIL_SILENCE_TICKS: u8 = 50, "tick",
        "Time without a message after which hardware in the loop ends: half a second.";
}

/// The limits of one setting.
#[derive(Clone, Copy)]
pub struct Limit {
    /// Its name.
    pub name: &'static str,
    /// Smallest value.
    pub min: f32,
    /// Largest value.
    pub max: f32,
    /// The reason for these limits.
    pub source: &'static str,
    /// The value in a set of settings.
    pub value: fn(&SettingsValues) -> f32,
    /// It belongs to the safety block, which the link alone does not change ([`crate::gate`]).
    pub is_safety: bool,
    /// Changes the value in a set of settings.
    #[cfg(test)]
    pub set: fn(&mut SettingsValues, f32),
}

macro_rules! limits {
    ($($block:ident { $($($field:ident).+: $min:expr, $max:expr, $source:expr;)* })*) => {
        &[$($(Limit {
            name: stringify!($($field).+),
            min: $min,
            max: $max,
            source: $source,
            value: |values| values.$($field).+ as f32,
            is_safety: $block::IS_SAFETY,
            #[cfg(test)]
            set: |values, value| values.$($field).+ = value as _,
        }),*),*]
    };
}

mod safety {
    pub const IS_SAFETY: bool = true;
}

mod tuning {
    pub const IS_SAFETY: bool = false;
}

/// Every setting's limits. Tuning is what the safety block bounds: whatever it is, the compensation
/// adds at most `compensation.force_n_max` and `compensation.pressure_pa_max`.
pub const LIMITS: &[Limit] = limits! { safety {
    muscle.alpha_m2: 1e-6, 1.0, "1 mm² to the size of a person";
    muscle.beta_m2: -1.0, 0.0, "negative: the braid's end caps push (Eq 1)";
    muscle.gamma_n: -1e4, 0.0, "the rubber's own force, which opposes (Eq 1)";
    muscle.initial_length_m: 0.01, 10.0, "muscles that are sold";
    gain: 0.0, 100.0, "a hundredfold force is beyond a lever's purpose";
    bridge.zero_count: 0.0, 4095.0, "12-bit scale";
    bridge.per_count: -1.0, 1.0, "N per count; 1 N is too coarse for a finger";
    pressure_sensor.zero_count: 0.0, 4095.0, "12-bit scale";
    pressure_sensor.per_count: 1.0, 1e4, "Pa per count: 4 kPa to 40 MPa full scale";
    encoder_m_per_count: -1e-2, 1e-2, "1 cm is too coarse to control";
    valve_drive.pa_per_v: 1e2, 1e7, "valves of 0–10 V and 1 kPa to 100 MPa";
    valve_drive.amplifier_gain: 0.1, 100.0, "one stage";
    valve_drive.dac_full_scale_v: 0.5, 5.5, "supply of a microcontroller";
    supply_pressure_pa: 1e4, 2e6, "hand-held pneumatics";
    pressure_pa_max: 1e3, 2e6, "at most the supply";
    pressure_trip_pa: 1e3, 3e6, "above what the loop may ask for";
    reference_speed_m_per_s_max: 1e-3, 2.0, "a crawl to a throw";
    pressure_lag_s: 0.02, 10.0, "two ticks to what no assist can use";
    pressure_error_pa_max: 1e3, 1e6, "above any sensor's error";
    engage_rate_pa_per_s: 1e3, 1e7, "slower than assisting";
    play_pressure_pa_max: 0.0, 2e6, "0: the link alone moves nothing";
    vent_rate_pa_per_s: 1e3, 1e6, "lets the weight down, does not drop it";
    vented_pa: 1e2, 1e5, "below what lifts anything";
    contraction_max: 0.01, 0.9, "before Eq 8 is singular";
    contraction_trip: 0.01, 0.95, "above contraction_max";
    finger_force_n_max: 0.1, 1e3, "a finger to an arm";
    tare_n_max: 0.0, 100.0, "a hand that rests on the lever";
    bridge_step_n_max: 0.1, 1e3, "a person's fastest";
    pressure_step_pa_max: 1e3, 2e6, "what the valve can do in a tick";
    encoder_step_m_max: 1e-4, 1.0, "a falling weight: 10 m/s";
    encoder_stuck_pa: 1e3, 1e6, "static friction over ∂F/∂P";
    load_kg: 0.0, 1e3, "nothing to a machine's part";
    force_error_n_max: 1.0, 1e4, "friction and hysteresis, to a person's weight tenfold";
    stuck_ticks: 0.0, 1000.0, "10 s; 0 where the converters have no noise";
    suspect_ticks: 1.0, 100.0, "up to a second on a guess";
    missed_ticks_max: 0.0, 10.0, "up to a tenth of a second blind";
    enabling_device: 0.0, 1.0, "one hand has one";
    self_check_ticks: 10.0, 1000.0, "0.1 to 10 s";
    compensation.force_n_max: 0.0, 200.0, "below what lifts anything by itself";
    compensation.pressure_pa_max: 0.0, 1e5, "a fifth of the supply's";
} tuning {
    self_check_ticks_max: 10.0, 65535.0, "at least self_check_ticks";
    compensation.hysteresis_area_m2: 0.0, 5e-4, "150 N at 300 kPa, above any muscle's loop";
    compensation.hysteresis_reach: 0.0, 0.5, "0: none; the muscle's whole stroke";
    compensation.friction_n: 0.0, 50.0, "a bearing, not a brake";
    compensation.friction_reach_m: 0.0, 0.01, "0: none; as far as a lever is felt to move";
    compensation.payload_kg: -10.0, 10.0, "a tool, not another load";
    compensation.lead_s: 0.0, 0.2, "a slower valve does not assist";
    compensation.dead_zone_filling_pa: 0.0, 3e4, "twice what a spool overlaps";
    compensation.dead_zone_exhausting_pa: 0.0, 3e4, "twice what a spool overlaps";
} };

/// A number for the values of the safety block: FNV-1a of their bits (draft-eastlake-fnv). It
/// names a block in records; it is no protection against somebody who looks for another block with
/// the same number.
pub fn safety_hash(values: &SettingsValues) -> u32 {
    let block = LIMITS.iter().filter(|limit| limit.is_safety);
    let bits = block.map(|limit| (limit.value)(values).to_bits());
    bits.flat_map(u32::to_le_bytes)
        .fold(0x811C_9DC5, |sum, byte| {
            (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193)
        })
}

/// Whether two settings have the same safety block, or are the same in all, bit by bit.
pub fn agree(one: &SettingsValues, other: &SettingsValues, in_all: bool) -> bool {
    let mut compared = LIMITS.iter().filter(|limit| in_all || limit.is_safety);
    compared.all(|limit| (limit.value)(one).to_bits() == (limit.value)(other).to_bits())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::settings::Settings;

    /// The reference settings with this one changed, and valid.
    pub fn changed(limit: &Limit) -> SettingsValues {
        let value = (limit.value)(&SettingsValues::reference());
        let others = [1.01 * value, value + 1.0, value - 1.0, limit.max];
        let with = |value| {
            let mut values = SettingsValues::reference();
            (limit.set)(&mut values, value);
            values
        };
        let mut tried = others.into_iter().map(with);
        let differs = |values: &SettingsValues| *values != SettingsValues::reference();
        let found = tried.find(|values| differs(values) && Settings::new(*values).is_ok());
        found.unwrap_or_else(|| panic!("no valid step of {}", limit.name))
    }

    #[test]
    fn hash_is_that_of_the_safety_block_and_of_nothing_else() {
        let reference = SettingsValues::reference();
        for limit in LIMITS {
            let other = changed(limit);
            let differs = safety_hash(&other) != safety_hash(&reference);
            assert_eq!(differs, limit.is_safety, "{}", limit.name);
            assert_eq!(agree(&reference, &other, false), !limit.is_safety);
            assert!(!agree(&reference, &other, true));
        }
    }
}

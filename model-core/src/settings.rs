//! The controller's settings: one struct that is valid once it exists.

use crate::compensation::Compensation;
use crate::constants::GRAVITY_M_PER_S2;
use crate::error::SettingsError;
use crate::limits::LIMITS;
use crate::muscle::Muscle;
use crate::pressure::GaugePa;
use crate::signal::{AdcScale, DacCount, ValveDrive};
use crc::{CRC_32_ISO_HDLC, Crc};
use serde::{Deserialize, Serialize};

/// Version of [`SettingsValues`]: it changes with every change of the struct.
pub const VERSION: u16 = 4;
/// A buffer of this size holds any encoded settings.
pub const ENCODED_LEN_MAX: usize = 256;

const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const VERSION_LEN: usize = 2;
const CHECKSUM_LEN: usize = 4;

/// Finest encoder that is accepted \[m\]: with a finer one noise would look like motion.
const ENCODER_M_PER_COUNT_MIN: f32 = 1e-7;

/// Whether the relation holds, its setting, and what the setting must be.
type Relation = (bool, &'static str, &'static str);

/// The values, not yet validated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettingsValues {
    /// Eq 1.
    pub muscle: Muscle<f32>,
    /// K of Eq 7 \[-\].
    pub gain: f32,

    /// Strain-gauge bridge, in N.
    pub bridge: AdcScale,
    /// Pressure sensor, in Pa gauge.
    pub pressure_sensor: AdcScale,
    /// Shortening of the muscle per count, four counts a line \[m\]; negative if it counts down.
    pub encoder_m_per_count: f32,
    /// DAC, amplifier and valve.
    pub valve_drive: ValveDrive,

    /// P_s, gauge \[Pa\].
    pub supply_pressure_pa: f32,
    /// Highest reference pressure, gauge \[Pa\].
    pub pressure_pa_max: f32,
    /// Measured pressure that is a fault, gauge \[Pa\].
    pub pressure_trip_pa: f32,
    /// The reference pressure moves no faster than a weight in balance moves at this speed \[m/s\].
    pub reference_speed_m_per_s_max: f32,
    /// Time constant of the slowest acceptable valve, on the muscle at its largest volume \[s\].
    pub pressure_lag_s: f32,
    /// Largest difference of the pressure from the range that reference and valve allow \[Pa\].
    pub pressure_error_pa_max: f32,
    /// Fastest change of the reference until it has met the assist law \[Pa/s\].
    pub engage_rate_pa_per_s: f32,
    /// Highest pressure that an experiment over the link may request, gauge \[Pa\]; 0: none.
    pub play_pressure_pa_max: f32,
    /// Rate at which the reference falls while venting \[Pa/s\].
    pub vent_rate_pa_per_s: f32,
    /// Below this the muscle counts as vented, gauge \[Pa\].
    pub vented_pa: f32,

    /// Contraction beyond which the pressure may not rise; Eq 8 is computed at most there \[-\].
    pub contraction_max: f32,
    /// Contraction that is a fault \[-\].
    pub contraction_trip: f32,
    /// Finger force beyond which F_c grows no further \[N\].
    pub finger_force_n_max: f32,

    /// Largest force that the self-check accepts as the bridge's zero \[N\].
    pub tare_n_max: f32,
    /// Largest change of the finger force in a tick \[N\].
    pub bridge_step_n_max: f32,
    /// Largest change of the pressure in a tick \[Pa\].
    pub pressure_step_pa_max: f32,
    /// Largest travel in a tick \[m\].
    pub encoder_step_m_max: f32,
    /// A pressure change without a count from the encoder, off the stop, that is a fault \[Pa\]; at
    /// most one of a force that moves the weight ([`ENCODER_HELD`](crate::limits::ENCODER_HELD)).
    pub encoder_stuck_pa: f32,
    /// M: the weight on the muscle \[kg\].
    pub load_kg: f32,
    /// Largest residual of the force balance, acceleration included \[N\].
    pub force_error_n_max: f32,
    /// So many equal readings of an ADC in a row are a fault; 0: never.
    pub stuck_ticks: u16,
    /// So many implausible readings in a row are a fault; more, with few good ones in between.
    pub suspect_ticks: u8,
    /// More missed ticks in a row are a fault.
    pub missed_ticks_max: u8,
    /// 1 if the rig has an enabling device: then nothing begins or goes on without it.
    pub enabling_device: u8,
    /// Duration of the self-check.
    pub self_check_ticks: u16,
    /// The self-check gives up after so many ticks.
    pub self_check_ticks_max: u16,
    /// Compensation of effects that are not in the paper's equations.
    pub compensation: Compensation,
}

impl SettingsValues {
    /// M g \[N\]: the weight's force.
    pub fn weight_n(&self) -> f32 {
        self.load_kg * GRAVITY_M_PER_S2 as f32
    }

    /// The paper's rig with the electronics of docs/theory.md.
    ///
    /// docs/safety.md derives the values that concern safety. `encoder_stuck_pa`: static friction
    /// of 7 N both ways over ∂F/∂P ≥ 3.0e-4 m² (at `contraction_trip`) is 46 kPa.
    pub const fn reference() -> SettingsValues {
        SettingsValues {
            muscle: Muscle {
                alpha_m2: 3.7718e-3,
                beta_m2: -1.39e-3,
                gamma_n: -183.0,
                initial_length_m: 0.3,
            },
            gain: 20.0,
            // ±25 N on 4096 counts.
            bridge: AdcScale {
                zero_count: 2048.0,
                per_count: 50.0 / 4096.0,
            },
            // 0–700 kPa on 10–90 % of the scale.
            pressure_sensor: AdcScale {
                zero_count: 409.6,
                per_count: 7e5 / 3276.8,
            },
            encoder_m_per_count: 12.5e-6,
            // 0–500 kPa for 0–10 V, from 0–3.3 V.
            valve_drive: ValveDrive {
                pa_per_v: 5e4,
                amplifier_gain: 10.0 / 3.3,
                dac_full_scale_v: 3.3,
            },
            supply_pressure_pa: 5e5,
            pressure_pa_max: 5e5,
            pressure_trip_pa: 5.6e5,
            reference_speed_m_per_s_max: 0.25,
            pressure_lag_s: 0.3,
            pressure_error_pa_max: 9e4,
            engage_rate_pa_per_s: 2.5e5,
            play_pressure_pa_max: 0.0,
            vent_rate_pa_per_s: 2e5,
            vented_pa: 2e4,
            contraction_max: 0.30,
            contraction_trip: 0.33,
            finger_force_n_max: 20.0,
            tare_n_max: 2.0,
            bridge_step_n_max: 15.0,
            pressure_step_pa_max: 2e5,
            encoder_step_m_max: 0.015,
            encoder_stuck_pa: 6e4,
            load_kg: 12.0,
            force_error_n_max: 105.0,
            stuck_ticks: 50,
            suspect_ticks: 3,
            missed_ticks_max: 2,
            enabling_device: 0,
            self_check_ticks: 50,
            self_check_ticks_max: 500,
            compensation: Compensation::OFF,
        }
    }

    /// Relations that the limits of the loop must satisfy.
    fn loop_relations(&self) -> [Relation; 9] {
        let at_max_m2 = self.muscle.force_per_pressure_m2(self.contraction_max);
        [
            (
                // A tenth of the force at rest keeps Eq 8 well away from its singularity.
                at_max_m2 > 0.1 * self.muscle.force_per_pressure_m2(0.0) && at_max_m2 > 0.0,
                "contraction_max",
                "where the muscle still pulls with a tenth of its force per pressure",
            ),
            (
                self.contraction_trip > self.contraction_max,
                "contraction_trip",
                "above contraction_max",
            ),
            (
                self.pressure_pa_max <= self.supply_pressure_pa,
                "pressure_pa_max",
                "at most supply_pressure_pa",
            ),
            (
                self.play_pressure_pa_max <= self.pressure_pa_max,
                "play_pressure_pa_max",
                "at most pressure_pa_max",
            ),
            (
                self.pressure_trip_pa > self.pressure_pa_max,
                "pressure_trip_pa",
                "above pressure_pa_max",
            ),
            (
                self.vented_pa < self.pressure_pa_max,
                "vented_pa",
                "below pressure_pa_max",
            ),
            (
                // Otherwise no error of the pressure could be detected.
                self.pressure_error_pa_max < self.pressure_pa_max,
                "pressure_error_pa_max",
                "below pressure_pa_max",
            ),
            (
                // Otherwise a muscle whose encoder is stuck could pull with any force undetected.
                self.muscle.force_n(0.0, GaugePa(self.pressure_pa_max))
                    > self.weight_n() + self.force_error_n_max,
                "force_error_n_max",
                "such that the muscle can exceed it above the weight",
            ),
            (
                self.self_check_ticks_max >= self.self_check_ticks,
                "self_check_ticks_max",
                "at least self_check_ticks",
            ),
        ]
    }

    /// Relations that the instruments' scales must satisfy.
    fn instrument_relations(&self) -> [Relation; 7] {
        let drive = &self.valve_drive;
        let bridge_ends_n = self.bridge.ends();
        let force_n = self.finger_force_n_max + self.tare_n_max;
        [
            (
                // 0.1 % for the rounding of f32.
                drive.pressure(DacCount::new(u16::MAX)).0 >= 0.999 * self.pressure_pa_max,
                "pressure_pa_max",
                "within the valve drive's full scale",
            ),
            (
                // The command is rounded to counts.
                drive.pressure(DacCount::new(1)).0 <= 0.01 * self.pressure_pa_max,
                "valve_drive.pa_per_v",
                "such that a DAC count is at most a hundredth of pressure_pa_max",
            ),
            (
                bridge_ends_n.0 <= -force_n && bridge_ends_n.1 >= force_n,
                "bridge.per_count",
                "such that the scale holds finger_force_n_max and tare_n_max, either way",
            ),
            (
                // Otherwise no step could be detected.
                self.bridge_step_n_max < 2.0 * self.finger_force_n_max,
                "bridge_step_n_max",
                "below twice finger_force_n_max",
            ),
            (
                self.pressure_sensor.ends().1 > self.pressure_trip_pa,
                "pressure_trip_pa",
                "within the pressure sensor's scale",
            ),
            (
                self.pressure_step_pa_max < self.pressure_trip_pa,
                "pressure_step_pa_max",
                "below pressure_trip_pa",
            ),
            (
                self.encoder_m_per_count.abs() >= ENCODER_M_PER_COUNT_MIN,
                "encoder_m_per_count",
                "at least 0.1 µm, up or down",
            ),
        ]
    }
}

/// Settings that have passed validation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings(SettingsValues);

impl Settings {
    /// Validates `values`.
    ///
    /// # Errors
    /// The first value that is outside its limits or contradicts another.
    #[inline(never)]
    pub fn new(values: SettingsValues) -> Result<Settings, SettingsError> {
        for limit in LIMITS {
            let value = (limit.value)(&values);
            if !(value >= limit.min && value <= limit.max) {
                return Err(SettingsError::OutOfRange {
                    name: limit.name,
                    min: limit.min,
                    max: limit.max,
                });
            }
        }
        let loop_relations = values.loop_relations();
        let instrument_relations = values.instrument_relations();
        match loop_relations
            .iter()
            .chain(&instrument_relations)
            .find(|(holds, ..)| !holds)
        {
            Some((_, name, must)) => Err(SettingsError::Contradiction { name, must }),
            None => Ok(Settings(values)),
        }
    }

    /// The values.
    pub fn values(&self) -> &SettingsValues {
        &self.0
    }

    /// Writes version, values (postcard) and CRC-32 into `buffer`; returns the bytes written.
    ///
    /// # Errors
    /// The buffer is too short; [`ENCODED_LEN_MAX`] is enough.
    pub fn encode<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], SettingsError> {
        let (version, rest) = buffer
            .split_first_chunk_mut::<VERSION_LEN>()
            .ok_or(SettingsError::Length)?;
        *version = VERSION.to_le_bytes();
        let payload = postcard::to_slice(&self.0, rest).map_err(|_| SettingsError::Length)?;
        let end = VERSION_LEN + payload.len();
        let (covered, rest) = buffer
            .split_at_mut_checked(end)
            .ok_or(SettingsError::Length)?;
        let checksum = rest
            .first_chunk_mut::<CHECKSUM_LEN>()
            .ok_or(SettingsError::Length)?;
        *checksum = CHECKSUM.checksum(covered).to_le_bytes();
        buffer
            .get(..end + CHECKSUM_LEN)
            .ok_or(SettingsError::Length)
    }

    /// Reads settings that [`Settings::encode`] has written.
    ///
    /// # Errors
    /// The bytes are damaged or of another version, or the values do not pass validation.
    #[inline(never)]
    pub fn decode(bytes: &[u8]) -> Result<Settings, SettingsError> {
        let (covered, checksum) = bytes
            .split_last_chunk::<CHECKSUM_LEN>()
            .ok_or(SettingsError::Length)?;
        if CHECKSUM.checksum(covered) != u32::from_le_bytes(*checksum) {
            return Err(SettingsError::Checksum);
        }
        let (version, payload) = covered
            .split_first_chunk::<VERSION_LEN>()
            .ok_or(SettingsError::Length)?;
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return Err(SettingsError::Version(version));
        }
        match postcard::take_from_bytes(payload) {
            Ok((values, [])) => Settings::new(values),
            _ => Err(SettingsError::Length),
        }
    }
}

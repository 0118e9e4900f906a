//! Readings over a second: their levels, which channel has moved, and what that means.

use crate::commission::cause::Cause;
use model_core::io::Request;
use model_core::limits::{ADC_VALID, FLICKER_COUNTS};
use model_core::link::Telemetry;
use model_core::settings::SettingsValues;
use model_core::signal::{AdcCount, EncoderCount};

/// Ticks of a second.
pub const SECOND_TICKS: usize = 100;
/// A change of a converter's reading that a person has made \[counts\]: 0.5 N, or 9 kPa.
const ADC_MOVED: f64 = 40.0;
/// A change of the encoder that a person has made \[counts\]: a quarter of a millimetre.
const ENCODER_MOVED: i32 = 20;
/// Noise of a channel whose wires are intact \[counts rms\], with a margin of ten.
const NOISE_MAX: f64 = 20.0;
/// How near to the other's zero two swapped channels are \[counts\]: 0.12 V.
const SWAPPED_NEAR: f64 = 150.0;

/// Mean and standard deviation of a converter's reading \[counts\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Level {
    /// Mean \[counts\].
    pub count: f64,
    /// Standard deviation of one reading \[counts\].
    pub sd: f64,
}

/// The readings of some ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// Strain-gauge bridge.
    pub bridge: Level,
    /// Pressure sensor.
    pub pressure: Level,
    /// The encoder's last count.
    pub encoder: EncoderCount,
}

fn level(counts: impl Iterator<Item = AdcCount> + Clone) -> Level {
    let values = counts.map(|count| f64::from(count.0));
    let n = values.clone().count().max(1) as f64;
    let count = values.clone().sum::<f64>() / n;
    let square = values.map(|value| (value - count).powi(2)).sum::<f64>();
    Level {
        count,
        sd: (square / n).sqrt(),
    }
}

/// The levels of `ticks`.
pub fn readings(ticks: &[Telemetry]) -> Readings {
    let sensors = ticks.iter().map(|tick| tick.sensors);
    Readings {
        bridge: level(sensors.clone().map(|sensors| sensors.bridge)),
        pressure: level(sensors.clone().map(|sensors| sensors.pressure)),
        encoder: ticks
            .last()
            .map_or(EncoderCount(0), |last| last.sensors.encoder),
    }
}

/// Changes from rest to the end of `ticks` \[counts\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Movement {
    /// Of the bridge.
    pub bridge: f64,
    /// Of the pressure sensor.
    pub pressure: f64,
    /// Of the encoder.
    pub encoder: i32,
    /// How often the encoder's count has changed.
    pub encoder_changes: usize,
}

/// What has moved since `rest`, judged by the last second of `ticks`.
pub fn movement(rest: &Readings, ticks: &[Telemetry]) -> Movement {
    let last = &ticks[ticks.len().saturating_sub(SECOND_TICKS)..];
    let now = readings(last);
    let pairs = ticks.iter().zip(ticks.iter().skip(1));
    Movement {
        bridge: now.bridge.count - rest.bridge.count,
        pressure: now.pressure.count - rest.pressure.count,
        encoder: now.encoder.since(rest.encoder),
        encoder_changes: pairs
            .filter(|(one, next)| one.sensors.encoder != next.sensors.encoder)
            .count(),
    }
}

impl Movement {
    fn bridge_moved(&self) -> bool {
        self.bridge.abs() > ADC_MOVED
    }

    fn pressure_moved(&self) -> bool {
        self.pressure.abs() > ADC_MOVED
    }

    fn encoder_moved(&self) -> bool {
        self.encoder.abs() > ENCODER_MOVED
    }

    /// The channels that have moved, as text.
    pub fn words(&self) -> String {
        let mut words = Vec::new();
        if self.bridge_moved() {
            words.push(format!("bridge {:+.0} counts", self.bridge));
        }
        if self.pressure_moved() {
            words.push(format!("pressure {:+.0} counts", self.pressure));
        }
        if self.encoder_moved() || (words.is_empty() && self.encoder_changes > 0) {
            let times = self.encoder_changes;
            words.push(format!(
                "encoder {:+} counts ({times} changes)",
                self.encoder
            ));
        }
        if words.is_empty() {
            words.push("nothing".into());
        }
        words.join(", ")
    }
}

/// What is wrong with the readings at rest: nobody touches the rig, no pressure.
pub fn at_rest(rest: &Readings, expected: &SettingsValues) -> Option<Cause> {
    let low = f64::from(*ADC_VALID.start());
    let high = f64::from(*ADC_VALID.end());
    let near = |level: Level, zero: f32| (level.count - f64::from(zero)).abs() < SWAPPED_NEAR;
    let zeros = (
        expected.bridge.zero_count,
        expected.pressure_sensor.zero_count,
    );
    if rest.bridge.count < low || rest.bridge.count > high {
        Some(Cause::BridgeOpen)
    } else if rest.pressure.count < low {
        Some(Cause::PressureOpen)
    } else if rest.pressure.count > high {
        Some(Cause::PressureHigh)
    } else if rest.bridge.sd > NOISE_MAX || rest.pressure.sd > NOISE_MAX {
        Some(Cause::Noisy)
    } else if near(rest.bridge, zeros.1) && near(rest.pressure, zeros.0) {
        Some(Cause::BridgeAndPressureSwapped)
    } else {
        None
    }
}

/// What is wrong with the bridge, after a finger has pressed the lever as if to lift.
pub fn lever_pressed(movement: &Movement, expected: &SettingsValues) -> Option<Cause> {
    if !movement.bridge_moved() {
        Some(match movement.pressure_moved() {
            true => Cause::BridgeAndPressureSwapped,
            false => Cause::BridgeSilent,
        })
    } else if movement.bridge * f64::from(expected.bridge.per_count) < 0.0 {
        Some(Cause::BridgeInverted)
    } else {
        None
    }
}

/// What is wrong with the encoder, after a hand has lifted the weight.
pub fn weight_lifted(movement: &Movement, expected: &SettingsValues) -> Option<Cause> {
    if !movement.encoder_moved() {
        let flickers = movement.encoder.unsigned_abs() <= FLICKER_COUNTS;
        Some(match flickers && movement.encoder_changes > 0 {
            true => Cause::EncoderOneChannel,
            false => Cause::EncoderSilent,
        })
    } else if f64::from(movement.encoder) * f64::from(expected.encoder_m_per_count) < 0.0 {
        Some(Cause::EncoderSwapped)
    } else {
        None
    }
}

/// What is wrong with the pressure sensor, after a hand pump has raised the pressure.
pub fn hose_pumped(movement: &Movement, expected: &SettingsValues) -> Option<Cause> {
    if !movement.pressure_moved() {
        Some(match movement.bridge_moved() {
            true => Cause::BridgeAndPressureSwapped,
            false => Cause::PressureSilent,
        })
    } else if movement.pressure * f64::from(expected.pressure_sensor.per_count) < 0.0 {
        Some(Cause::PressureInverted)
    } else {
        None
    }
}

/// What is wrong with the emergency stop, which has been pressed during `ticks`.
pub fn stop_pressed(ticks: &[Telemetry]) -> Option<Cause> {
    let demands = |request| ticks.iter().any(|tick| tick.sensors.request == request);
    if demands(Request::StopContactsDiffer) {
        Some(Cause::StopContact)
    } else if demands(Request::Stop) {
        None
    } else {
        Some(Cause::StopSilent)
    }
}

/// What is wrong with the emergency stop, which nobody has pressed during `ticks`.
pub fn stop_released(ticks: &[Telemetry]) -> Option<Cause> {
    let stops = |tick: &Telemetry| {
        matches!(
            tick.sensors.request,
            Request::Stop | Request::StopContactsDiffer
        )
    };
    ticks.iter().any(stops).then_some(Cause::StopOpen)
}

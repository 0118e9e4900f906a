//! Scales of the instruments from points whose quantity is known.

use crate::commission::cause::Cause;
use crate::commission::readings::{Level, SECOND_TICKS};
use model_core::link::Telemetry;
use model_core::settings::SettingsValues;
use model_core::signal::AdcScale;

/// Ratio of a bridge's gain to its expected one, either way: gauges, glue and amplifier.
const BRIDGE_GAIN: f64 = 1.25;
/// Distance of a weight from the line, as a share of the largest: a mistyped weight is further off.
const CURVED: f64 = 0.02;
/// Ratio of a pressure sensor's gain to its expected one, either way: a sensor within 1.5 %, a
/// gauge of class 1.6 at half scale.
const PRESSURE_GAIN: f64 = 1.05;
/// Distance of a pressure sensor's zero from the expected one \[counts\]: 3 % of the scale.
const PRESSURE_ZERO: f64 = 123.0;
/// Ratio of an encoder's scale to its expected one, either way: a spacer of 10 mm within 0.3 mm.
const ENCODER_SCALE: f64 = 1.03;
/// Counts by which an encoder may be off when the weight is back on its stop.
const ENCODER_HOME: i32 = 8;
/// Share of the pressure that a tight hose loses in a second at most.
const LEAK_PER_S: f64 = 0.01;

/// A point of a scale: the reading and the quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The reading.
    pub level: Level,
    /// The quantity in its SI unit.
    pub quantity: f64,
}

/// A straight line through points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// The scale.
    pub scale: AdcScale,
    /// Standard deviation of its gain from the readings' noise, relative.
    pub relative_sd: f64,
    /// Largest distance of a point from the line, as a share of the largest quantity.
    pub curved: f64,
}

/// The line of least squares through `points`, of which two differ.
pub fn line(points: &[Point]) -> Line {
    let n = points.len() as f64;
    let mean = |of: fn(&Point) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (count, quantity) = (
        mean(|point| point.level.count),
        mean(|point| point.quantity),
    );
    let mut square = 0.0;
    let mut product = 0.0;
    let mut variance = 0.0;
    for point in points {
        let off = point.level.count - count;
        square += off * off;
        product += off * (point.quantity - quantity);
        variance += (off * point.level.sd).powi(2) / SECOND_TICKS as f64;
    }
    let per_count = product / square;
    let zero_count = count - quantity / per_count;
    let largest = points.iter().map(|point| point.quantity.abs());
    let largest = largest.fold(f64::MIN_POSITIVE, f64::max);
    let distance = |point: &Point| {
        let read = (point.level.count - zero_count) * per_count;
        (read - point.quantity).abs() / largest
    };
    Line {
        scale: AdcScale {
            zero_count: zero_count as f32,
            per_count: per_count as f32,
        },
        relative_sd: variance.sqrt() / square,
        curved: points.iter().map(distance).fold(0.0, f64::max),
    }
}

/// True if `ratio` is further from 1 than `limit`, either way.
fn is_off(ratio: f64, limit: f64) -> bool {
    !(1.0 / limit..=limit).contains(&ratio)
}

/// What is wrong with a bridge of the scale `line`.
pub fn bridge(line: &Line, expected: &SettingsValues) -> Option<Cause> {
    let ratio = f64::from(line.scale.per_count / expected.bridge.per_count);
    let (low_n, high_n) = line.scale.ends();
    let needed_n = expected.finger_force_n_max + expected.tare_n_max;
    if line.curved > CURVED {
        Some(Cause::BridgeCurved)
    } else if ratio < 0.0 {
        Some(Cause::BridgeInverted)
    } else if is_off(ratio, BRIDGE_GAIN) {
        Some(Cause::BridgeGain)
    } else if low_n > -needed_n || high_n < needed_n {
        Some(Cause::BridgeZero)
    } else {
        None
    }
}

/// What is wrong with a pressure sensor of the scale `line`.
pub fn pressure(line: &Line, expected: &SettingsValues) -> Option<Cause> {
    let ratio = f64::from(line.scale.per_count / expected.pressure_sensor.per_count);
    let zero = f64::from(line.scale.zero_count - expected.pressure_sensor.zero_count);
    if ratio < 0.0 {
        Some(Cause::PressureInverted)
    } else if zero.abs() > PRESSURE_ZERO {
        Some(Cause::PressureZero)
    } else if is_off(ratio, PRESSURE_GAIN) {
        Some(Cause::PressureRange)
    } else {
        None
    }
}

/// Share of the pressure that is lost in a second while the pump is shut: from the first to the
/// last half second of `ticks`.
pub fn loss_per_s(zero: Level, ticks: &[Telemetry]) -> f64 {
    let half = (SECOND_TICKS / 2).min(ticks.len() / 2);
    let mean = |ticks: &[Telemetry]| {
        let counts = ticks.iter().map(|tick| f64::from(tick.sensors.pressure.0));
        counts.sum::<f64>() / ticks.len().max(1) as f64 - zero.count
    };
    let (first, last) = (mean(&ticks[..half]), mean(&ticks[ticks.len() - half..]));
    let duration_s = (ticks.len() - half) as f64 / SECOND_TICKS as f64;
    (first - last) / (first * duration_s)
}

/// Whether a hose that loses this share of its pressure in a second leaks.
pub fn leaks(loss_per_s: f64) -> bool {
    loss_per_s > LEAK_PER_S
}

/// What is wrong with an encoder that measures `m_per_count`, and is off by `home` counts when the
/// weight is back on its stop.
pub fn encoder(m_per_count: f64, home: i32, expected: &SettingsValues) -> Option<Cause> {
    let ratio = m_per_count / f64::from(expected.encoder_m_per_count);
    if ratio < 0.0 {
        Some(Cause::EncoderSwapped)
    } else if home.abs() > ENCODER_HOME {
        Some(Cause::EncoderLosesCounts)
    } else if is_off(ratio, ENCODER_SCALE) {
        Some(Cause::EncoderScale)
    } else {
        None
    }
}

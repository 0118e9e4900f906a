//! Sensor values for long runs; `tests/board` includes this file too.

use model_core::io::{Output, Request, Sensors};
use model_core::signal::{AdcCount, EncoderCount};

/// Sensor values that lead the controller through all of its modes, including faults: a muscle with
/// the reference settings in balance with its weight, whose pressure reading fails occasionally.
/// `before` is the output of the tick before.
pub fn wander(tick: u32, before: &Output) -> Sensors {
    let noise = f64::from(tick.wrapping_mul(2_654_435_761) >> 30);
    let at = f64::from(tick % 1_000);
    let ramp = |from: f64, to: f64| ((at - from) / (to - from)).clamp(0.0, 1.0);
    // Engaged, pulled until the weight hangs on the muscle, lifted, and back.
    let engaged = ramp(110.0, 160.0) - ramp(800.0, 840.0);
    let swing = (ramp(200.0, 750.0) * std::f64::consts::PI).sin().powi(2);
    let (carried, lifted) = ((3.0 * swing).min(1.0), (1.5 * swing - 0.5).max(0.0));
    let (force_n, contraction) = (117.68 * carried, 0.15 * lifted);
    let area_m2 = 3.7718e-3 * (1.0 - contraction).powi(2) - 1.39e-3;
    let pressure_pa = engaged * (force_n + 183.0) / area_m2;
    let request = match tick % 1_000 {
        110 => Request::Assist,
        600 => Request::Hold,
        650 => Request::Assist,
        800 => Request::Vent,
        970 => Request::Reset,
        _ => Request::None,
    };
    let broken = tick % 10_000 > 9_400 && tick % 10_000 < 9_420;
    let pressure = if broken {
        0.0
    } else {
        409.6 + pressure_pa * 3_276.8 / 7e5 + noise
    };
    Sensors {
        // A twentieth of the force, 82 counts a newton.
        bridge: AdcCount((2_048.0 + 0.05 * force_n * 81.92 + noise) as u16),
        pressure: AdcCount(pressure as u16),
        encoder: EncoderCount((contraction * 0.3 / 12.5e-6) as u32),
        read_back: AdcCount(before.valve.get()),
        missed_ticks: 0,
        request,
    }
}

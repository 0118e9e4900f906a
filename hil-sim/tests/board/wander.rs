//! Sensors for runs that are long; `tests/board` includes this file too.

use model_core::frame::{Request, Sensors};
use model_core::signal::{AdcCount, EncoderCount};

/// Sensors that wander through everything the controller may do, faults included.
pub fn wander(tick: u32) -> Sensors {
    let noise = (tick.wrapping_mul(2_654_435_761) >> 30) as f64;
    // At rest, then up and down.
    let swing = ((f64::from(tick % 1_000) - 200.0) / 550.0).clamp(0.0, 1.0);
    let lift = (swing * std::f64::consts::PI).sin().powi(2);
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
        409.0 + 1_500.0 * lift + noise
    };
    Sensors {
        bridge: AdcCount((2048.0 + 700.0 * lift + noise) as u16),
        pressure: AdcCount(pressure as u16),
        encoder: EncoderCount((4_000.0 * lift) as u32),
        missed_ticks: 0,
        request,
    }
}

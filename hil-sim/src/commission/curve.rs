//! The valve: reference to pressure, and the supply, from a staircase on the plugged hose.

use crate::commission::cause::Cause;
use model_core::link::Telemetry;
use model_core::settings::SettingsValues;
use model_core::supervisor::Mode;

/// Ticks of a level of the staircase, after its ramp.
pub const HOLD_TICKS: usize = 60;
/// Ticks at the end of a level that are averaged.
const MEAN_TICKS: usize = 20;
/// Levels of the staircase, up and as many down.
pub const LEVELS: usize = 8;
/// Ratio of pressure to reference, either way: valve, amplifier and sensor within 5 %.
const GAIN: f64 = 1.05;
/// Share of the reference below which no pressure has come.
const NOTHING: f64 = 0.1;
/// Rise of the pressure over that of the reference, relative to the levels below, at which the
/// supply is reached.
const SATURATED: f64 = 0.5;
/// Supply relative to what was entered.
const SUPPLY: f64 = 0.95;
/// Pressure at 0 V that is none \[Pa\]: the zero of sensor and valve.
const ZERO_PA: f64 = 2e4;

/// A level of the staircase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Reference at the valve, by the settings \[Pa\].
    pub reference_pa: f64,
    /// Measured pressure \[Pa\].
    pub pressure_pa: f64,
    /// It follows a higher one.
    pub down: bool,
}

/// The curve of a valve.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// The levels.
    pub levels: Vec<Level>,
    /// Pressure over reference \[-\].
    pub gain: f64,
    /// Its standard deviation.
    pub gain_sd: f64,
    /// Pressure at reference zero \[Pa\].
    pub offset_pa: f64,
    /// The supply \[Pa\], if the pressure has reached it.
    pub supply_pa: Option<f64>,
}

/// The levels in `ticks`: where the valve's command stands still while playing.
fn levels(values: &SettingsValues, ticks: &[Telemetry]) -> Vec<Level> {
    let playing: Vec<_> = ticks
        .iter()
        .filter(|tick| tick.output.mode == Mode::Playing)
        .collect();
    let same = |one: &&Telemetry, next: &&Telemetry| one.output.valve == next.output.valve;
    let mut found: Vec<Level> = Vec::new();
    for run in playing.chunk_by(same) {
        // The tick's reading is older than its command.
        if run.len() < HOLD_TICKS / 2 {
            continue;
        }
        let last = &run[run.len() - MEAN_TICKS..];
        let reference_pa = f64::from(values.valve_drive.pressure(last[0].output.valve).0);
        let read =
            |tick: &&Telemetry| f64::from(values.pressure_sensor.value(tick.sensors.pressure));
        let before = found.last().map_or(0.0, |level| level.reference_pa);
        found.push(Level {
            reference_pa,
            pressure_pa: last.iter().map(read).sum::<f64>() / last.len() as f64,
            down: reference_pa < before,
        });
    }
    found
}

/// The curve in `ticks`, played with the settings `values`.
pub fn curve(values: &SettingsValues, ticks: &[Telemetry]) -> Curve {
    let levels = levels(values, ticks);
    let up: Vec<&Level> = levels.iter().filter(|level| !level.down).collect();
    // The gain of the lowest levels tells where the rise ends.
    let begin = fit(&up[..up.len().min(4)]);
    let ends = |pair: &[&Level]| {
        let rise = pair[1].pressure_pa - pair[0].pressure_pa;
        rise < SATURATED * begin.0 * (pair[1].reference_pa - pair[0].reference_pa)
    };
    let risen = begin.0 > NOTHING;
    let last = up.windows(2).position(ends).filter(|_| risen);
    let free = &up[..last.map_or(up.len(), |last| last + 1)];
    let (gain, offset_pa, gain_sd) = fit(free);
    let supply_pa = last.map(|last| {
        let at_end = &up[last + 1..];
        at_end.iter().map(|level| level.pressure_pa).sum::<f64>() / at_end.len() as f64
    });
    Curve {
        gain,
        gain_sd,
        offset_pa,
        supply_pa,
        levels,
    }
}

/// Gain, offset and the gain's standard deviation of the line of least squares.
fn fit(levels: &[&Level]) -> (f64, f64, f64) {
    let n = levels.len() as f64;
    if levels.len() < 2 {
        return (0.0, 0.0, f64::INFINITY);
    }
    let reference = levels.iter().map(|level| level.reference_pa).sum::<f64>() / n;
    let pressure = levels.iter().map(|level| level.pressure_pa).sum::<f64>() / n;
    let sum = |of: &dyn Fn(&Level) -> f64| levels.iter().map(|level| of(level)).sum::<f64>();
    let square = sum(&|level| (level.reference_pa - reference).powi(2));
    let product = sum(&|level| (level.reference_pa - reference) * (level.pressure_pa - pressure));
    let gain = product / square;
    let offset = pressure - gain * reference;
    let residual = sum(&|level| (level.pressure_pa - offset - gain * level.reference_pa).powi(2));
    let sd = (residual / (n - 2.0).max(1.0) / square).sqrt();
    (gain, offset, sd)
}

/// What is wrong with the valve whose pressure at 0 V is `rest_pa`, before it plays.
pub fn at_zero(rest_pa: f64) -> Option<Cause> {
    (rest_pa > ZERO_PA).then_some(Cause::ValveReversed)
}

/// What is wrong with a valve of this curve at a supply of `supply_pa`.
pub fn valve(curve: &Curve, supply_pa: f64) -> Option<Cause> {
    let highest = |of: fn(&Level) -> f64| curve.levels.iter().map(of).fold(0.0, f64::max);
    let (asked_pa, reached_pa) = (
        highest(|level| level.reference_pa),
        highest(|level| level.pressure_pa),
    );
    if curve.gain < -NOTHING {
        Some(Cause::ValveReversed)
    } else if curve.gain < NOTHING {
        Some(match reached_pa > ZERO_PA.max(NOTHING * asked_pa) {
            true => Cause::ValveStuck,
            false => Cause::NoAir,
        })
    } else if !(1.0 / GAIN..=GAIN).contains(&curve.gain) {
        Some(Cause::AmplifierGain)
    } else if curve
        .supply_pa
        .is_some_and(|found| found < SUPPLY * supply_pa)
    {
        Some(Cause::LowSupply)
    } else {
        None
    }
}

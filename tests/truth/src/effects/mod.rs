//! The catalogue of hidden effects: for each name the forms it can take.

mod gas;
mod line;
mod load;
mod muscle;
mod muscle_memory;
mod sensor;
mod supply;
mod unlisted;
mod valve;

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;
use serde_json::Value;

use crate::hidden::Hidden;
use crate::rig::Rig;

/// An effect with its parameters.
pub(crate) struct Drawn {
    pub(crate) hidden: Box<dyn Hidden>,
    pub(crate) parameters: Value,
}

impl Drawn {
    fn new<E: Hidden + Serialize + 'static>(effect: E) -> Self {
        let parameters = serde_json::to_value(&effect).expect("plain numbers");
        Self {
            hidden: Box::new(effect),
            parameters,
        }
    }
}

/// One form of an effect.
pub struct Form {
    /// Name within its effect.
    pub name: &'static str,
    /// Parameters of the effect's simplest textbook form, if this is that form.
    pub standard: &'static [&'static str],
    /// Draws the effect for a size from 0 (barely visible) to 1 (obvious).
    pub(crate) draw: fn(f64, &Rig, &mut Pcg64) -> Drawn,
}

impl Form {
    const fn new(name: &'static str, draw: fn(f64, &Rig, &mut Pcg64) -> Drawn) -> Self {
        Self {
            name,
            standard: &[],
            draw,
        }
    }

    const fn standard(
        name: &'static str,
        standard: &'static [&'static str],
        draw: fn(f64, &Rig, &mut Pcg64) -> Drawn,
    ) -> Self {
        Self {
            name,
            standard,
            draw,
        }
    }
}

/// One effect.
pub struct Entry {
    /// Name, as in a diagnosis where the effect is listed.
    pub name: &'static str,
    /// Its subsystem.
    pub place: &'static str,
    /// Whether a diagnosis can name it.
    pub listed: bool,
    /// The forms it can take.
    pub forms: &'static [Form],
}

const fn listed(name: &'static str, place: &'static str, forms: &'static [Form]) -> Entry {
    Entry {
        name,
        place,
        listed: true,
        forms,
    }
}

const fn unlisted(name: &'static str, place: &'static str, forms: &'static [Form]) -> Entry {
    Entry {
        name,
        place,
        listed: false,
        forms,
    }
}

/// Every effect; two in one rig act in this order.
pub static CATALOGUE: &[Entry] = &[
    listed("dead-band", "muscle-force", muscle::DEAD_BAND),
    listed(
        "bladder-elasticity",
        "muscle-force",
        muscle::BLADDER_ELASTICITY,
    ),
    listed("hysteresis", "muscle-force", muscle_memory::HYSTERESIS),
    listed("creep", "muscle-force", muscle_memory::CREEP),
    listed("run-in", "muscle-force", muscle_memory::RUN_IN),
    listed("slack", "muscle-force", muscle::SLACK),
    listed("friction", "load", load::FRICTION),
    listed("payload", "load", load::PAYLOAD),
    listed("backlash", "load", load::BACKLASH),
    listed("valve-lag", "valve", valve::LAG),
    listed("valve-dead-zone", "valve", valve::DEAD_ZONE),
    listed("flow-limit", "valve", valve::FLOW_LIMIT),
    listed("supply-droop", "supply", supply::DROOP),
    listed("transport-delay", "line", line::DELAY),
    listed("line-dynamics", "line", line::DYNAMICS),
    listed("leak", "gas", gas::LEAK),
    listed("heat-exchange", "gas", gas::HEAT_EXCHANGE),
    listed("pressure-sensor-gain", "sensor", sensor::PRESSURE_GAIN),
    listed("pressure-sensor-offset", "sensor", sensor::PRESSURE_OFFSET),
    listed("pressure-sensor-drift", "sensor", sensor::PRESSURE_DRIFT),
    listed(
        "contraction-sensor-offset",
        "sensor",
        sensor::CONTRACTION_OFFSET,
    ),
    unlisted("cogging", "load", unlisted::COGGING),
    unlisted("swinging-payload", "load", unlisted::SWINGING_PAYLOAD),
    unlisted("force-pulses", "load", unlisted::FORCE_PULSES),
    unlisted("floor-vibration", "load", unlisted::FLOOR_VIBRATION),
    unlisted("position-friction", "load", unlisted::POSITION_FRICTION),
    unlisted("pressure-pulses", "valve", unlisted::PRESSURE_PULSES),
    unlisted("sticking-valve", "valve", unlisted::STICKING_VALVE),
    unlisted("valve-dropout", "valve", unlisted::VALVE_DROPOUT),
    unlisted("ambient-drift", "gas", unlisted::AMBIENT_DRIFT),
    unlisted("lost-counts", "sensor", unlisted::LOST_COUNTS),
    unlisted(
        "encoder-eccentricity",
        "sensor",
        unlisted::ENCODER_ECCENTRICITY,
    ),
    unlisted("pressure-hum", "sensor", unlisted::PRESSURE_HUM),
];

/// Between `low` at size 0 and `high` at size 1, by equal ratios.
fn scale(size: f64, low: f64, high: f64) -> f64 {
    low * (high / low).powf(size)
}

/// Plus or minus one.
fn sign(rng: &mut Pcg64) -> f64 {
    if rng.random_bool(0.5) { 1.0 } else { -1.0 }
}

/// A uniform draw.
fn between(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

/// The positive part of `value`, smoothed over `width` around zero.
fn soft_positive(value: f64, width: f64) -> f64 {
    if value > 30.0 * width {
        value
    } else {
        width * (value / width).exp().ln_1p()
    }
}

/// The centre of a band of half-width `half` that `value` drags along.
fn dragged(centre: f64, value: f64, half: f64) -> f64 {
    centre.clamp(value - half, value + half)
}

/// Share of the choked flow through an orifice with critical pressure ratio `critical`.
fn choke(upstream_absolute_pa: f64, downstream_absolute_pa: f64, critical: f64) -> f64 {
    let ratio = downstream_absolute_pa / upstream_absolute_pa;
    if ratio <= critical {
        1.0
    } else {
        (1.0 - ((ratio - critical) / (1.0 - critical)).powi(2))
            .max(0.0)
            .sqrt()
    }
}

//! Laws of effects, drawn at random from the signature of each.

mod gas;
mod line;
mod load;
mod memory;
mod muscle;
mod sensor;
mod supply;
mod unlisted;
mod valve;

use rand_pcg::Pcg64;
use serde::Serialize;
use serde_json::Value;

use super::bench::Bench;
use crate::hidden::Hidden;

/// An effect with its law.
pub(crate) struct Law {
    pub(crate) hidden: Box<dyn Hidden>,
    /// Family of the law, in a word or two.
    pub(crate) form: String,
    /// Description of the law.
    pub(crate) words: String,
    /// The law in numbers; a shape as nine values at equal distances.
    pub(crate) numbers: Value,
}

impl Law {
    fn new<E: Hidden + Serialize + 'static>(
        effect: E,
        form: impl Into<String>,
        words: impl Into<String>,
    ) -> Self {
        let numbers = serde_json::to_value(&effect).expect("plain numbers");
        Self {
            hidden: Box::new(effect),
            form: form.into(),
            words: words.into(),
            numbers,
        }
    }
}

/// Draws a law for a rig and a size from 0, barely visible at reference noise, to 1, plain.
type Draw = fn(&Bench, f64, &mut Pcg64) -> Law;

/// An effect whose law is drawn.
pub struct Entry {
    /// Its name, as in a diagnosis if it is listed.
    pub name: &'static str,
    /// The subsystem that it is in.
    pub place: &'static str,
    /// Whether a diagnosis can name it.
    pub listed: bool,
    /// Whether it is visible only in the force.
    pub(crate) needs_force: bool,
    /// Whether it is visible only near the supply pressure.
    pub(crate) near_supply: bool,
    pub(crate) draw: Draw,
}

const fn listed(name: &'static str, place: &'static str, draw: Draw) -> Entry {
    Entry {
        name,
        place,
        listed: true,
        needs_force: false,
        near_supply: false,
        draw,
    }
}

const fn unlisted(name: &'static str, place: &'static str, draw: Draw) -> Entry {
    Entry {
        listed: false,
        ..listed(name, place, draw)
    }
}

const fn in_force(entry: Entry) -> Entry {
    Entry {
        needs_force: true,
        ..entry
    }
}

/// Every effect; several in one rig act in this order.
pub static DRAWN: &[Entry] = &[
    listed("dead-band", "muscle-force", muscle::dead_band),
    listed(
        "bladder-elasticity",
        "muscle-force",
        muscle::bladder_elasticity,
    ),
    listed("hysteresis", "muscle-force", memory::hysteresis),
    listed("creep", "muscle-force", memory::creep),
    listed("run-in", "muscle-force", memory::run_in),
    in_force(listed("slack", "muscle-force", muscle::slack)),
    listed("friction", "load", load::friction),
    listed("payload", "load", load::payload),
    listed("backlash", "load", load::backlash),
    listed("valve-lag", "valve", valve::lag),
    listed("valve-dead-zone", "valve", valve::dead_zone),
    listed("flow-limit", "valve", valve::flow_limit),
    Entry {
        near_supply: true,
        ..listed("supply-droop", "supply", supply::droop)
    },
    listed("transport-delay", "line", line::delay),
    listed("line-dynamics", "line", line::dynamics),
    listed("leak", "gas", gas::leak),
    listed("heat-exchange", "gas", gas::heat_exchange),
    listed("pressure-sensor-gain", "sensor", sensor::pressure_gain),
    listed("pressure-sensor-offset", "sensor", sensor::pressure_offset),
    listed("pressure-sensor-drift", "sensor", sensor::pressure_drift),
    listed(
        "contraction-sensor-offset",
        "sensor",
        sensor::contraction_offset,
    ),
    in_force(listed(
        "force-sensor-offset",
        "sensor",
        sensor::force_offset,
    )),
    unlisted("cogging", "load", unlisted::cogging),
    unlisted("swinging-payload", "load", unlisted::swinging_payload),
    unlisted("force-pulses", "load", unlisted::force_pulses),
    unlisted("floor-vibration", "load", unlisted::floor_vibration),
    unlisted("random-gusts", "load", unlisted::random_gusts),
    unlisted("position-friction", "load", unlisted::position_friction),
    in_force(unlisted(
        "pinched-bladder",
        "muscle-force",
        unlisted::pinched_bladder,
    )),
    unlisted("pressure-pulses", "valve", unlisted::pressure_pulses),
    unlisted("sticking-valve", "valve", unlisted::sticking_valve),
    unlisted("valve-dropout", "valve", unlisted::valve_dropout),
    unlisted("flow-ripple", "valve", unlisted::flow_ripple),
    unlisted("valve-fade", "valve", unlisted::valve_fade),
    unlisted("ambient-drift", "gas", unlisted::ambient_drift),
    unlisted("lost-counts", "sensor", unlisted::lost_counts),
    unlisted(
        "encoder-eccentricity",
        "sensor",
        unlisted::encoder_eccentricity,
    ),
    unlisted("slipped-encoder", "sensor", unlisted::slipped_encoder),
    unlisted("frozen-reading", "sensor", unlisted::frozen_reading),
    unlisted("pressure-hum", "sensor", unlisted::pressure_hum),
];

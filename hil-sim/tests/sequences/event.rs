//! What may happen in a case: faults that begin and end, and what a person does.

use rand::{Rng, RngExt};
use std::ops::Range;

/// A fault or an action, without its times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    Snag,
    /// Force on the weight \[N\]: a helper, or somebody who leans on it.
    Force(f64),
    /// Factor of the mass.
    Exchanged(f64),
    /// The valve is shut.
    ValveShut,
    /// The valve controls the pressure to this share of the supply.
    ValveAt(f64),
    /// The same with this share of its flow: it does not close. Scenarios have it, random cases do
    /// not.
    ValveAjar(f64, f64),
    /// The supply falls to this share; again and again with this period \[s\].
    Supply(f64, Option<f64>),
    /// This bit of the DAC is always 0.
    DacBit(u16),
    /// The DAC's voltage drifts by this share of its scale a second, up to that. Scenarios have it,
    /// random cases do not.
    DacDrift(f64, f64),
    /// The gauge drifts at this rate \[N/s\] to this error \[N\].
    GaugeCreep(f64, f64),
    /// Amplitude \[N\] and frequency \[Hz\] of a ripple on the gauge.
    GaugeRipple(f64, f64),
    /// A wire of the gauge opens: its amplifier drifts to its end at this rate \[N/s\]. Scenarios
    /// have it, random cases do not.
    GaugeOpens(f64),
    /// The gauge is off by this force \[N\].
    GaugeZero(f64),
    GaugeFrozen,
    PressureFrozen,
    /// The pressure reads too much by this \[Pa\].
    PressureZero(f64),
    EncoderFrozen,
    /// The encoder jumps by this \[m\].
    EncoderJump(f64),
    /// The encoder loses this share of its counts. Scenarios have it, random cases do not.
    EncoderLoses(f64),
    /// Every n-th tick is missed.
    TicksHalting(u32),
    /// Every n-th tick is left. Scenarios have it, random cases do not.
    TicksLeft(u32),
    /// So many ticks are missed in a row, at the beginning.
    TicksMissed(u32),
    /// A bit of the reference flips in a copy of the state, at the beginning.
    Flip(usize),
    /// This bit of the reference flips in two copies of the state. Scenarios have it, random cases
    /// do not.
    FlipTwo(usize),
    /// Another bit of the reference flips in each copy of the state, this one in the first.
    /// Scenarios have it, random cases do not.
    FlipAll(usize),
    /// The person lets go of everything.
    LetsGo,
    /// Somebody presses the emergency stop. Scenarios have it, random cases do not.
    Stops,
    /// Amplitude \[m\] and frequency \[Hz\] of the finger beside its lift.
    Shakes(f64, f64),
    /// The finger moves to this place in 50 ms \[m\].
    Pushes(f64),
    /// Requests to hold, to assist and to vent, one after another.
    Requests,
}

/// A fault or an action with its times \[s\].
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    pub what: What,
    pub during_s: Range<f64>,
}

impl What {
    pub fn draw(random: &mut impl Rng) -> What {
        let share = random.random_range(0.0..1.0);
        let sign = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        match random.random_range(0..22) {
            0 => What::Snag,
            1 => What::Force(sign * (20.0 + 100.0 * share)),
            2 => What::Exchanged(if sign > 0.0 {
                1.0 + share
            } else {
                1.0 - 0.9 * share
            }),
            3 => What::ValveShut,
            4 => What::ValveAt(share),
            5 => What::Supply(share, None),
            6 => What::Supply(share, Some(0.1 + share)),
            7 => What::DacBit(random.random_range(5..12)),
            8 => What::GaugeCreep(sign * (1.0 + 4.0 * share), sign * (2.0 + 8.0 * share)),
            9 => What::GaugeRipple(2.0 + 6.0 * share, random.random_range(1.0..150.0)),
            10 => What::GaugeZero(sign * (1.0 + 6.0 * share)),
            11 => What::GaugeFrozen,
            12 => What::PressureFrozen,
            13 => What::PressureZero(sign * 8e4 * share),
            14 => What::EncoderFrozen,
            15 => What::EncoderJump(sign * 0.014 * share),
            16 => What::TicksHalting(random.random_range(2..12)),
            17 => What::TicksMissed(random.random_range(1..6)),
            18 => What::Flip(random.random_range(0..1 << 12)),
            19 => What::LetsGo,
            20 => What::Shakes(0.01 + 0.05 * share, random.random_range(0.5..4.0)),
            _ if sign > 0.0 => What::Pushes(random.random_range(-0.05..0.15)),
            _ => What::Requests,
        }
    }

    /// Air, load or valve move the weight, whatever the controller commands: only hardware limits
    /// the energy, as docs/safety.md says.
    pub fn needs_hardware(&self) -> bool {
        match self {
            What::ValveShut
            | What::ValveAt(_)
            | What::ValveAjar(..)
            | What::Supply(..)
            | What::Snag => true,
            What::Exchanged(_) | What::Force(_) => true,
            What::DacBit(bit) => *bit >= 8,
            _ => false,
        }
    }

    /// The controller's own tests find it before assistance begins, or not at all.
    pub fn is_latent(&self) -> bool {
        matches!(
            self,
            What::Flip(_) | What::EncoderFrozen | What::PressureFrozen
        )
    }
}

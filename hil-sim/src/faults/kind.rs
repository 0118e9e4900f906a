//! Every fault of the campaign: what breaks, in which sizes, and what then decides.

use super::Moment;
use Decides::{Controller, Physics};
use Inject::{
    AnalogGain, Dac, Damage, Drift, EncoderLoses, Freeze, Hang, Healthy, HoseOff, Jump, Leak,
    Lever, Link, Load, Noise, Reading, Reversed, Settings, Supply, Ticks, Valve,
};
use model_core::plausibility::Doubt;
use model_core::supervisor::Fault;

/// An instrument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instrument {
    /// The strain-gauge bridge on the lever.
    Bridge,
    /// The pressure sensor.
    Pressure,
    /// The encoder.
    Encoder,
}

/// What happens to the ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TickFault {
    /// Each valve output comes later, by the size \[s\].
    Late,
    /// So many do not happen, once.
    Missed,
    /// Every second one does not happen, so many times.
    Halting,
    /// The period is longer by this ratio.
    Clock,
}

/// What happens on the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFault {
    /// Valid messages without end: none that a person would send.
    Flooded,
    /// Frames with flipped bytes, and noise.
    Corrupted,
    /// A frame is cut, and nothing follows.
    Cut,
}

/// What happened to the stored settings before the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingsFault {
    /// So many bits have flipped.
    Flipped,
    /// The last write ended after this share.
    HalfWritten,
    /// They are of another version.
    OtherVersion,
    /// The flash is erased.
    Erased,
    /// Power was lost while the sector was erased, after this share of its cells.
    CutWhileErasing,
}

/// What is done to the controller's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// A bit of a copy of the state.
    State,
    /// A bit of a copy of the settings.
    Settings,
    /// A copy of whether hardware in the loop is on.
    Hil,
}

/// A fault, its size apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inject {
    /// Nothing: a rig within its tolerances, with one of the catalogue's effects.
    Healthy,
    /// The converter reads this count whatever it measures, so many counts of noise on it.
    Reading(Instrument, f64),
    /// The reading stays where it is, this many counts of noise on it.
    Freeze(Instrument),
    /// The reading runs away at so many units (N, Pa, m) a second.
    Drift(Instrument),
    /// Noise of so many units rms.
    Noise(Instrument),
    /// The reading is the truth times this.
    AnalogGain(Instrument),
    /// The reading's sign is reversed.
    Reversed(Instrument),
    /// The reading jumps by this.
    Jump(Instrument),
    /// The encoder loses this share of its counts.
    EncoderLoses,
    /// The valve acts on this share of the supply, whatever it is told; below 0 it is shut.
    Valve,
    /// The valve follows with this time constant \[s\].
    ValveSlow,
    /// Air leaves the muscle: conductance \[kg/(Pa·s)\].
    Leak,
    /// The supply falls to this share of itself within the time \[s\].
    Supply(f64),
    /// The hose comes off a fitting of this conductance \[kg/(Pa·s)\].
    HoseOff,
    /// The load is multiplied by this.
    Load,
    /// The lever is slammed to this place \[m\] in 30 ms.
    Lever,
    /// The DAC stays at this share of its scale; below 0 where it is.
    Dac,
    /// The program hangs for so long \[s\], then the watchdog resets it.
    Hang,
    /// The supply voltage is away for so long \[s\].
    PowerLost,
    /// The ticks.
    Ticks(TickFault),
    /// The link.
    Link(LinkFault),
    /// Stored settings.
    Settings(SettingsFault),
    /// Bits in memory; the size is which.
    Damage(Memory),
}

/// Who decides how fast the weight is after the fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decides {
    /// The controller can, and must.
    Controller,
    /// Energy alone does, in these directions.
    Physics {
        /// Upwards.
        up: bool,
        /// Downwards.
        down: bool,
    },
}

const FLUNG: Decides = Physics {
    up: true,
    down: true,
};
const DROPPED: Decides = Physics {
    up: false,
    down: true,
};

/// One kind of fault.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Its name.
    pub name: &'static str,
    /// What is done.
    pub inject: Inject,
    /// In these sizes.
    pub sizes: &'static [f64],
    /// The sizes' unit.
    pub unit: &'static str,
    /// Who decides.
    pub decides: Decides,
    /// What must be latched, where a reason can be seen: docs/safety.md says where not, and why.
    pub latched: Option<Latched>,
    /// Assistance must not begin on it.
    pub bars_start: bool,
}

/// A reason that must be latched.
#[derive(Clone, Copy, Debug)]
pub struct Latched {
    /// Within this time of a fault of the size \[s\].
    pub within_s: fn(f64) -> f64,
    /// Where the fault falls in one of these moments.
    pub moments: &'static [Moment],
    /// Where the weight was at least so high \[m\]: one that comes to rest on its stop is safe.
    pub above_m: f64,
    /// One of these.
    pub is_right: fn(Fault) -> bool,
}

const IN_USE: &[Moment] = &[
    Moment::Rest,
    Moment::Lifting,
    Moment::Holding,
    Moment::Lowering,
    Moment::Playing,
];
const WAITING: &[Moment] = &[Moment::Ready];
const HELD: &[Moment] = &[Moment::Holding];

const fn latched(
    within_s: fn(f64) -> f64,
    moments: &'static [Moment],
    is_right: fn(Fault) -> bool,
) -> Option<Latched> {
    Some(Latched {
        within_s,
        moments,
        above_m: 0.0,
        is_right,
    })
}

fn bridge(fault: Fault) -> bool {
    matches!(fault, Fault::Bridge(_))
}

/// Or what the weight does by then.
fn bridge_or_weight(fault: Fault) -> bool {
    bridge(fault) || weight(fault)
}

/// Or what it does not fit.
fn pressure_or_weight(fault: Fault) -> bool {
    pressure(fault) || weight(fault)
}

fn encoder(fault: Fault) -> bool {
    matches!(fault, Fault::Encoder(_))
}

fn pressure(fault: Fault) -> bool {
    matches!(fault, Fault::Pressure(_) | Fault::PressureControl)
}

fn weight(fault: Fault) -> bool {
    matches!(fault, Fault::ForceBalance | Fault::OverSpeed)
}

const fn kind(
    name: &'static str,
    inject: Inject,
    sizes: &'static [f64],
    unit: &'static str,
    decides: Decides,
    latched: Option<Latched>,
) -> Kind {
    Kind {
        name,
        inject,
        sizes,
        unit,
        decides,
        latched,
        bars_start: false,
    }
}

impl Kind {
    const fn bars_start(self) -> Kind {
        Kind {
            bars_start: true,
            ..self
        }
    }
}

use Inject::{PowerLost, ValveSlow};
use Instrument::{Bridge, Encoder, Pressure};

/// Three suspect ticks, and the tick in which the fault falls \[s\].
const AT_ONCE_S: f64 = 0.04;
/// Fifty equal readings besides \[s\].
const STUCK_S: f64 = 0.5 + AT_ONCE_S;

/// All kinds.
pub const KINDS: &[Kind] = &[
    kind("healthy", Healthy, &[0.0], "", Controller, None),
    kind(
        "gauge open",
        Reading(Bridge, 1.0),
        &[0.0, 6.0, 4089.0, 4095.0],
        "count",
        Controller,
        latched(|_| AT_ONCE_S, IN_USE, bridge),
    )
    .bars_start(),
    kind(
        "gauge shorted",
        Reading(Bridge, 0.0),
        &[2048.0],
        "count",
        Controller,
        latched(|_| STUCK_S, IN_USE, bridge_or_weight),
    ),
    kind(
        "gauge frozen",
        Freeze(Bridge),
        &[0.0],
        "counts of noise",
        Controller,
        latched(|_| STUCK_S, IN_USE, bridge_or_weight),
    ),
    kind(
        "gauge frozen, noisy",
        Freeze(Bridge),
        &[1.0, 3.0],
        "counts of noise",
        Controller,
        None,
    ),
    kind(
        "gauge drifting",
        Drift(Bridge),
        &[-20.0, -5.0, -2.0, 1.0, 5.0, 20.0],
        "N/s",
        Controller,
        // The whole scale, ±25 N, at this rate: as far as the hand gives way to it.
        latched(
            |n_per_s| 50.0 / n_per_s.abs() + AT_ONCE_S,
            IN_USE,
            |fault| fault == Fault::Bridge(Doubt::Range),
        ),
    ),
    kind(
        "gauge noisy",
        Noise(Bridge),
        &[0.2, 1.0, 5.0, 15.0],
        "N rms",
        Controller,
        None,
    ),
    kind(
        "gauge gain",
        AnalogGain(Bridge),
        &[0.0, 0.5, 1.5, 2.0, 4.0, 8.0],
        "1",
        Controller,
        None,
    ),
    kind(
        "gauge reversed",
        Reversed(Bridge),
        &[0.0],
        "",
        Controller,
        None,
    ),
    kind(
        "gauge jumps",
        Jump(Bridge),
        &[-14.0, -5.0, 5.0, 10.0, 14.0],
        "N",
        Controller,
        None,
    )
    .bars_start(),
    kind(
        "encoder frozen",
        Freeze(Encoder),
        &[0.0, 1.0],
        "counts of noise",
        Controller,
        None,
    ),
    kind(
        "encoder loses counts",
        EncoderLoses,
        &[0.05, 0.2, 0.5, 0.9],
        "1",
        Controller,
        None,
    ),
    kind(
        "encoder reversed",
        Reversed(Encoder),
        &[0.0],
        "",
        Controller,
        None,
    ),
    kind(
        "encoder jumps",
        Jump(Encoder),
        &[-0.014, -0.007, 0.007, 0.014],
        "m",
        Controller,
        None,
    ),
    kind(
        "encoder home lost",
        Jump(Encoder),
        &[-10.0, -0.05, 0.05, 1.0],
        "m",
        Controller,
        latched(|_| AT_ONCE_S, IN_USE, encoder),
    ),
    kind(
        "pressure sensor open",
        Reading(Pressure, 1.0),
        &[0.0, 6.0, 4089.0, 4095.0],
        "count",
        Controller,
        latched(|_| AT_ONCE_S, IN_USE, pressure),
    )
    .bars_start(),
    kind(
        "pressure sensor shorted",
        Reading(Pressure, 0.0),
        &[410.0],
        "count",
        Controller,
        latched(|_| STUCK_S, IN_USE, pressure_or_weight),
    ),
    kind(
        "pressure sensor frozen",
        Freeze(Pressure),
        &[0.0],
        "counts of noise",
        Controller,
        latched(|_| STUCK_S, IN_USE, pressure_or_weight),
    ),
    kind(
        "pressure sensor frozen, noisy",
        Freeze(Pressure),
        &[1.0, 3.0],
        "counts of noise",
        Controller,
        None,
    ),
    kind(
        "pressure sensor drifting",
        Drift(Pressure),
        &[-1e6, -1e5, -2e4, 2e4, 1e5, 1e6],
        "Pa/s",
        Controller,
        None,
    ),
    kind(
        "pressure sensor noisy",
        Noise(Pressure),
        &[2e3, 2e4, 1e5],
        "Pa rms",
        Controller,
        None,
    ),
    kind(
        "pressure sensor gain",
        AnalogGain(Pressure),
        &[0.0, 0.5, 0.8, 1.25, 2.0],
        "1",
        Controller,
        None,
    ),
    kind(
        "pressure sensor reversed",
        Reversed(Pressure),
        &[0.0],
        "",
        Controller,
        None,
    ),
    kind(
        "pressure sensor jumps",
        Jump(Pressure),
        &[-1.9e5, -1e5, -5e4, 5e4, 1e5, 1.9e5],
        "Pa",
        Controller,
        None,
    ),
    kind(
        "valve stuck open",
        Valve,
        &[1.0, 0.8],
        "of supply",
        FLUNG,
        latched(|_| 0.1, HELD, pressure_or_weight),
    )
    .bars_start(),
    kind(
        "valve ajar",
        Valve,
        &[0.1, 0.2],
        "of supply",
        DROPPED,
        latched(|_| AT_ONCE_S, WAITING, |fault| fault == Fault::Uncommanded),
    ),
    kind(
        "valve stuck at the exhaust",
        Valve,
        &[0.0],
        "of supply",
        DROPPED,
        latched(|_| 0.1, HELD, pressure),
    ),
    kind("valve stuck shut", Valve, &[-1.0], "", Controller, None),
    kind(
        "valve slow",
        ValveSlow,
        &[0.02, 0.1, 0.5, 2.0],
        "s",
        Controller,
        None,
    ),
    kind(
        "valve leaking",
        Leak,
        &[1e-9, 1e-8, 5e-8],
        "kg/(Pa·s)",
        Controller,
        None,
    ),
    kind(
        "supply lost",
        Supply(0.0),
        &[0.005, 0.1, 1.0],
        "s",
        DROPPED,
        None,
    ),
    kind(
        "supply halved",
        Supply(0.5),
        &[0.005, 0.1, 1.0],
        "s",
        DROPPED,
        None,
    ),
    kind(
        "supply sagging",
        Supply(0.8),
        &[0.1, 1.0],
        "s",
        Controller,
        None,
    ),
    // Twice V/(RθC) of the smallest hole and the largest muscle, which is 0.33 s.
    kind(
        "hose off",
        HoseOff,
        &[5e-9, 2e-8, 1e-7],
        "kg/(Pa·s)",
        DROPPED,
        latched(|_| 0.65, HELD, pressure_or_weight),
    ),
    kind(
        "payload lost",
        Load,
        &[0.05],
        "of the load",
        FLUNG,
        latched(|_| 0.06, HELD, |fault| fault == Fault::OverSpeed),
    ),
    kind("payload halved", Load, &[0.5], "of the load", FLUNG, None),
    kind(
        "payload half as much again",
        Load,
        &[1.5],
        "of the load",
        DROPPED,
        None,
    ),
    // It swings first, √2 of a quarter of a second; 105 of 118 N are 2.2 times the mean's 0.1 s.
    kind(
        "payload doubled",
        Load,
        &[2.0],
        "of the load",
        DROPPED,
        Some(Latched {
            within_s: |_| 0.35 + 0.22 + AT_ONCE_S,
            moments: HELD,
            above_m: 0.04,
            is_right: weight,
        }),
    ),
    kind(
        "lever slammed",
        Lever,
        &[-0.15, 0.05, 0.15, 0.3],
        "m",
        Controller,
        None,
    )
    .bars_start(),
    kind("DAC stuck", Dac, &[-1.0], "", Controller, None),
    kind(
        "DAC at full scale",
        Dac,
        &[1.0],
        "of scale",
        FLUNG,
        latched(|_| 0.1, HELD, pressure_or_weight),
    )
    .bars_start(),
    kind(
        "DAC at zero",
        Dac,
        &[0.0],
        "of scale",
        DROPPED,
        latched(|_| 0.1, HELD, pressure),
    ),
    kind(
        "ADC overrun",
        Hang,
        &[0.034, 0.064, 0.094],
        "s to the watchdog",
        DROPPED,
        None,
    ),
    kind(
        "tick late",
        Ticks(TickFault::Late),
        &[0.002, 0.005, 0.009],
        "s",
        Controller,
        None,
    ),
    kind(
        "tick missed",
        Ticks(TickFault::Missed),
        &[1.0, 2.0],
        "ticks",
        Controller,
        None,
    ),
    kind(
        "ticks missed",
        Ticks(TickFault::Missed),
        // Of four the watchdog may make a reset.
        &[3.0],
        "ticks",
        Controller,
        latched(|_| 0.06, IN_USE, |fault| fault == Fault::MissedTicks),
    ),
    kind(
        "ticks halting",
        Ticks(TickFault::Halting),
        &[10.0, 100.0],
        "times",
        Controller,
        None,
    ),
    kind(
        "clock wrong",
        Ticks(TickFault::Clock),
        &[-0.02, 0.02],
        "1",
        Controller,
        None,
    ),
    kind(
        "link flooded",
        Link(LinkFault::Flooded),
        &[1.0, 15.0],
        "frames a tick",
        Controller,
        None,
    ),
    kind(
        "link corrupted",
        Link(LinkFault::Corrupted),
        &[1.0, 15.0],
        "frames a tick",
        Controller,
        None,
    ),
    kind(
        "link cut",
        Link(LinkFault::Cut),
        &[1.0],
        "",
        Controller,
        None,
    ),
    kind(
        "settings flipped",
        Settings(SettingsFault::Flipped),
        &[1.0, 2.0, 8.0],
        "bits",
        Controller,
        None,
    ),
    kind(
        "settings half written",
        Settings(SettingsFault::HalfWritten),
        &[0.1, 0.5, 0.9],
        "of the bytes",
        Controller,
        None,
    ),
    kind(
        "settings of another version",
        Settings(SettingsFault::OtherVersion),
        &[1.0],
        "",
        Controller,
        None,
    ),
    kind(
        "settings erased",
        Settings(SettingsFault::Erased),
        &[1.0],
        "",
        Controller,
        None,
    ),
    kind(
        "power lost while settings are erased",
        Settings(SettingsFault::CutWhileErasing),
        &[0.1, 0.5, 0.9],
        "of the cells",
        Controller,
        None,
    ),
    kind(
        "reset by the watchdog",
        Hang,
        &[0.034, 0.094],
        "s to the watchdog",
        DROPPED,
        None,
    ),
    kind("power lost", PowerLost, &[0.02, 0.5], "s", DROPPED, None),
    kind(
        "bit flip in the state",
        Damage(Memory::State),
        &[0.0, 1.0, 2.0],
        "copy",
        Controller,
        latched(|_| 0.02, IN_USE, |fault| fault == Fault::Memory),
    ),
    kind(
        "bit flip in the settings",
        Damage(Memory::Settings),
        &[0.0, 1.0, 2.0],
        "copy",
        Controller,
        latched(|_| 0.02, IN_USE, |fault| fault == Fault::Memory),
    ),
    kind(
        "bit flip in the source",
        Damage(Memory::Hil),
        &[0.0, 1.0, 2.0],
        "copy",
        Controller,
        None,
    ),
];

//! The kinds of fault of the campaign: what is injected, in which sizes, and which bounds hold.

use super::Moment;
use Inject::{
    AnalogGain, Dac, DacOff, Damage, Drift, EncoderLoses, Freeze, Hang, Healthy, HoseOff, Jump,
    Leak, Lever, Link, Load, Noise, Reading, Reversed, Settings, Supply, Ticks, Valve,
};
use LimitedBy::{Controller, Physics};
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

/// A fault of the ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TickFault {
    /// Each valve output is late by the size \[s\].
    Late,
    /// The size is the number of consecutive ticks that are missed, once.
    Missed,
    /// Every second tick is missed; the size is the number of missed ticks.
    Halting,
    /// The size is the relative error of the period.
    Clock,
}

/// A fault of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFault {
    /// Continuous valid messages, none of them a person's request.
    Flooded,
    /// Frames with flipped bytes, and noise.
    Corrupted,
    /// The connection ends within a frame.
    Cut,
}

/// A fault of the stored settings before the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingsFault {
    /// The size is the number of flipped bits.
    Flipped,
    /// The last write ended after this share of its bytes.
    HalfWritten,
    /// They are of another version.
    OtherVersion,
    /// The flash is erased.
    Erased,
    /// Power was lost while the sector was erased; the size is the share of erased cells.
    CutWhileErasing,
}

/// The part of the device's memory in which bits flip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// The controller's state.
    State,
    /// The settings.
    Settings,
    /// The flag that switches hardware in the loop on.
    Hil,
}

/// The copies in which a bit flips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Copies {
    /// One; the size is its index.
    One,
    /// The same bit in two that follow each other; the size is the index of the first.
    Two,
    /// Another bit in each.
    All,
}

/// An injected fault, without its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inject {
    /// No fault: a rig within its tolerances, with one of the catalogue's effects.
    Healthy,
    /// The converter reads the size as a constant count, with noise of this RMS \[counts\].
    Reading(Instrument, f64),
    /// The reading stays constant; the size is the RMS of its noise \[counts\].
    Freeze(Instrument),
    /// The reading drifts; the size is the rate in the instrument's unit (N, Pa, m) per second.
    Drift(Instrument),
    /// Added noise; the size is its RMS in the instrument's unit.
    Noise(Instrument),
    /// The size is the gain of the reading relative to the correct one.
    AnalogGain(Instrument),
    /// The reading's sign is reversed.
    Reversed(Instrument),
    /// The reading jumps by the size, in the instrument's unit.
    Jump(Instrument),
    /// The size is the share of its counts that the encoder loses.
    EncoderLoses,
    /// The valve ignores its reference: it controls the pressure to this share of the supply, or
    /// is shut if the size is below 0.
    Valve,
    /// The size is the valve's time constant \[s\].
    ValveSlow,
    /// The muscle leaks; the size is the conductance \[kg/(Pa·s)\].
    Leak,
    /// The supply falls to this share of its pressure; the size is the duration of the fall \[s\].
    Supply(f64),
    /// The hose comes off; the size is the conductance of the open fitting \[kg/(Pa·s)\].
    HoseOff,
    /// The mass of the load is multiplied by the size.
    Load,
    /// The lever is moved to the position given by the size \[m\] within 30 ms.
    Lever,
    /// The DAC stays at this share of its scale, or at its present value if the size is below 0.
    Dac,
    /// The DAC's voltage is off by this share of its scale.
    DacOff,
    /// The program hangs; the size is the time until the watchdog resets it \[s\].
    Hang,
    /// The size is the duration of a loss of the supply voltage \[s\].
    PowerLost,
    /// A fault of the ticks.
    Ticks(TickFault),
    /// A fault of the link.
    Link(LinkFault),
    /// A fault of the stored settings.
    Settings(SettingsFault),
    /// Bit flips in these copies of a part of the memory.
    Damage(Memory, Copies),
    /// These contacts of the emergency stop, or their wires, open.
    Stop([bool; 2]),
}

/// What limits the motion of the weight after the fault, and so determines its bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitedBy {
    /// The controller can limit it, and must.
    Controller,
    /// Only the available energy limits it, in these directions.
    Physics {
        /// Upwards.
        up: bool,
        /// Downwards.
        down: bool,
    },
}

const UP_AND_DOWN: LimitedBy = Physics {
    up: true,
    down: true,
};
const DOWN: LimitedBy = Physics {
    up: false,
    down: true,
};

/// One kind of fault.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Its name.
    pub name: &'static str,
    /// The injected fault.
    pub inject: Inject,
    /// The sizes, of which each case draws one.
    pub sizes: &'static [f64],
    /// The sizes' unit.
    pub unit: &'static str,
    /// What limits the motion.
    pub limited_by: LimitedBy,
    /// The reason that must be latched, if the fault is observable; docs/safety.md states when it
    /// is not, and why.
    pub latched: Option<Latched>,
    /// Whether assistance must not begin with this fault.
    pub bars_start: bool,
}

/// A reason that must be latched.
#[derive(Clone, Copy, Debug)]
pub struct Latched {
    /// Time limit \[s\] after the fault, as a function of its size.
    pub within_s: fn(f64) -> f64,
    /// The moments of the fault in which it must be latched.
    pub moments: &'static [Moment],
    /// Height of the weight from which it must be latched \[m\]: below, the weight comes to rest on
    /// its stop, which is safe.
    pub above_m: f64,
    /// Whether a latched reason is a right one.
    pub is_right: fn(Fault) -> bool,
}

impl Latched {
    /// Whether only a weight that hangs shows it: on its stop it may no longer.
    pub fn is_of_hanging(&self) -> bool {
        self.moments == HELD
    }
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

/// Bit flips in copies of what the controller knows, which it must notice in the next tick.
const fn flips(
    name: &'static str,
    memory: Memory,
    copies: Copies,
    sizes: &'static [f64],
    unit: &'static str,
) -> Kind {
    let noticed = latched(|_| 0.02, IN_USE, |fault| matches!(fault, Fault::Memory));
    kind(
        name,
        Damage(memory, copies),
        sizes,
        unit,
        Controller,
        noticed,
    )
}

/// The bridge, or the motion of the weight that its fault causes.
fn bridge_or_weight(fault: Fault) -> bool {
    bridge(fault) || weight(fault)
}

/// The pressure, or the weight with which it is not in balance.
fn pressure_or_weight(fault: Fault) -> bool {
    pressure(fault) || weight(fault)
}

fn encoder(fault: Fault) -> bool {
    matches!(fault, Fault::Encoder(_))
}

fn pressure(fault: Fault) -> bool {
    matches!(fault, Fault::Pressure(_) | Fault::PressureControl)
}

/// The valve's voltage, or what follows from it.
fn voltage_pressure_or_weight(fault: Fault) -> bool {
    fault == Fault::ValveVoltage || pressure_or_weight(fault)
}

fn weight(fault: Fault) -> bool {
    matches!(fault, Fault::ForceBalance | Fault::OverSpeed)
}

const fn kind(
    name: &'static str,
    inject: Inject,
    sizes: &'static [f64],
    unit: &'static str,
    limited_by: LimitedBy,
    latched: Option<Latched>,
) -> Kind {
    Kind {
        name,
        inject,
        sizes,
        unit,
        limited_by,
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

/// Detection time of a suspect reading \[s\]: three ticks, and the one in which the fault occurs.
const SUSPECT_S: f64 = 0.04;
/// Detection time of a constant reading \[s\]: fifty equal readings more.
const STUCK_S: f64 = 0.5 + SUSPECT_S;

/// All kinds.
pub const KINDS: &[Kind] = &[
    kind("healthy", Healthy, &[0.0], "", Controller, None),
    kind(
        "gauge open",
        Reading(Bridge, 1.0),
        &[0.0, 6.0, 4089.0, 4095.0],
        "count",
        Controller,
        latched(|_| SUSPECT_S, IN_USE, bridge),
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
        // The time in which it drifts over the whole scale, ±25 N; the hand may follow it so far.
        latched(
            |n_per_s| 50.0 / n_per_s.abs() + SUSPECT_S,
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
        latched(|_| SUSPECT_S, IN_USE, encoder),
    ),
    kind(
        "pressure sensor open",
        Reading(Pressure, 1.0),
        &[0.0, 6.0, 4089.0, 4095.0],
        "count",
        Controller,
        latched(|_| SUSPECT_S, IN_USE, pressure),
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
        UP_AND_DOWN,
        latched(|_| 0.1, HELD, pressure_or_weight),
    )
    .bars_start(),
    kind(
        "valve ajar",
        Valve,
        &[0.1, 0.2],
        "of supply",
        DOWN,
        latched(|_| SUSPECT_S, WAITING, |fault| fault == Fault::Uncommanded),
    ),
    kind(
        "valve stuck at the exhaust",
        Valve,
        &[0.0],
        "of supply",
        DOWN,
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
        DOWN,
        None,
    ),
    kind(
        "supply halved",
        Supply(0.5),
        &[0.005, 0.1, 1.0],
        "s",
        DOWN,
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
        DOWN,
        latched(|_| 0.65, HELD, pressure_or_weight),
    ),
    kind(
        "payload lost",
        Load,
        &[0.05],
        "of the load",
        UP_AND_DOWN,
        latched(|_| 0.06, HELD, |fault| fault == Fault::OverSpeed),
    ),
    kind(
        "payload halved",
        Load,
        &[0.5],
        "of the load",
        UP_AND_DOWN,
        None,
    ),
    kind(
        "payload half as much again",
        Load,
        &[1.5],
        "of the load",
        DOWN,
        None,
    ),
    // One period of oscillation, √2 times 0.25 s; then 105 of 118 N, 2.2 time constants of the
    // force balance, 0.1 s each.
    kind(
        "payload doubled",
        Load,
        &[2.0],
        "of the load",
        DOWN,
        Some(Latched {
            within_s: |_| 0.35 + 0.22 + SUSPECT_S,
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
        UP_AND_DOWN,
        latched(|_| SUSPECT_S + 0.01, IN_USE, voltage_pressure_or_weight),
    )
    .bars_start(),
    kind(
        "DAC at zero",
        Dac,
        &[0.0],
        "of scale",
        DOWN,
        latched(|_| SUSPECT_S + 0.01, HELD, voltage_pressure_or_weight),
    ),
    // It is read back a tick after it was set.
    kind(
        "DAC off",
        DacOff,
        &[-0.1, -0.03, 0.03, 0.1],
        "of scale",
        Controller,
        latched(
            |_| SUSPECT_S + 0.01,
            HELD,
            |fault| fault == Fault::ValveVoltage,
        ),
    ),
    kind(
        "ADC overrun",
        Hang,
        &[0.034, 0.064, 0.094],
        "s to the watchdog",
        DOWN,
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
        // Four may cause a reset by the watchdog.
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
        // Seven, and the next one, and the one in which the fault occurs.
        latched(|_| 0.16, IN_USE, |fault| fault == Fault::MissedTicks),
    ),
    kind(
        "clock wrong",
        Ticks(TickFault::Clock),
        // The tolerance of the chip's oscillator from -10 to 85 °C.
        &[-0.04, 0.04],
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
        DOWN,
        None,
    ),
    kind("power lost", PowerLost, &[0.02, 0.5], "s", DOWN, None),
    flips(
        "bit flip in the state",
        Memory::State,
        Copies::One,
        &[0.0, 1.0, 2.0, 3.0],
        "copy",
    ),
    flips(
        "bit flip in the settings",
        Memory::Settings,
        Copies::One,
        &[0.0, 1.0, 2.0, 3.0],
        "copy",
    ),
    flips(
        "bit flip in two copies of the state",
        Memory::State,
        Copies::Two,
        &[0.0, 1.0, 2.0],
        "first copy",
    ),
    flips(
        "bit flips in all copies of the state",
        Memory::State,
        Copies::All,
        &[0.0],
        "",
    ),
    flips(
        "bit flip in two copies of the settings",
        Memory::Settings,
        Copies::Two,
        &[0.0, 1.0, 2.0],
        "first copy",
    ),
    flips(
        "bit flips in all copies of the settings",
        Memory::Settings,
        Copies::All,
        &[0.0],
        "",
    ),
    kind(
        "bit flip in the source",
        Damage(Memory::Hil, Copies::One),
        &[0.0, 1.0, 2.0, 3.0],
        "copy",
        Controller,
        None,
    ),
    kind(
        "emergency stop pressed",
        Inject::Stop([true, true]),
        &[1.0],
        "",
        Controller,
        latched(|_| 0.02, IN_USE, |fault| fault == Fault::EmergencyStop),
    ),
    kind(
        "wire of the emergency stop broken",
        Inject::Stop([true, false]),
        &[1.0],
        "",
        Controller,
        latched(|_| 0.02, IN_USE, |fault| fault == Fault::EmergencyStop),
    ),
];

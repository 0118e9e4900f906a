//! The supervisor: the modes, the faults, and which findings lead from one mode to another. Its
//! limits are in [`crate::limits`] and in the settings.
//!
//! ```text
//! SelfCheck ──passed──▶ Ready ──Assist──▶ Assisting ◀──Assist / reading good again── Holding
//!     ▲                   │                   └──────Hold / reading suspect──────────▶ │
//!     │                   └─────────────Vent, or any fault─────────────┐               │
//!     └──Reset, vented── Venting ◀─────────────────────────────────────┴───────────────┘
//! ```
//!
//! Ready ──Play──▶ Playing ──Vent, silence or any fault──▶ Venting: an experiment's pressures,
//! if the settings allow them. An experiment needs no hand on the lever, so it ends as soon as the
//! requests for pressure stop.
//!
//! A fault is latched with its reason until it is reset, also while venting on request. Of several
//! faults the first one is latched. Venting lowers the reference at a limited rate, so that the
//! weight is let down and not dropped. The emergency stop lets it down, too: at once it would drop.

use crate::io::Request;
use crate::limits::PLAY_SILENCE_TICKS;
use crate::names::names;
use crate::plausibility::{Doubt, SensorStatus};
use crate::settings::SettingsValues;
use crate::start::StartFault;
use serde::{Deserialize, Serialize};

/// What the controller does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Vented: checks the sensors and takes their zeros.
    #[default]
    SelfCheck,
    /// Vented, waits for a request.
    Ready,
    /// The muscle carries K times the finger's force.
    Assisting,
    /// The pressure reference stays where it is.
    Holding,
    /// The pressure reference falls to zero and stays there.
    Venting,
    /// The pressure reference follows the requested pressures: an experiment.
    Playing,
}

/// Why the controller vents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// The strain-gauge bridge has failed.
    Bridge(Doubt),
    /// The pressure sensor has failed.
    Pressure(Doubt),
    /// The encoder has failed.
    Encoder(Doubt),
    /// The pressure is above its trip level.
    OverPressure,
    /// The contraction is above its trip level.
    OverContraction,
    /// Too many consecutive ticks were missed.
    MissedTicks,
    /// At start, the lever was loaded.
    LoadedLever,
    /// At start, the muscle was under pressure.
    NotVented,
    /// At start, the muscle was moving.
    NotStill,
    /// The muscle had pressure, or lifted, without a request.
    Uncommanded,
    /// The pressure does not follow its reference: valve, supply, hose, or pressure sensor.
    PressureControl,
    /// Pressure, contraction and weight are not in balance: a sensor, the load, or the muscle.
    ForceBalance,
    /// The weight is faster than the reference may move it.
    OverSpeed,
    /// A bit of the controller's memory has flipped.
    Memory,
    /// The emergency stop was pressed.
    EmergencyStop,
    /// The contacts of the emergency stop differ: one of them, or its wire, is broken.
    StopContactsDiffer,
    /// The start-up self-test has failed.
    Start(StartFault),
    /// The valve's voltage is not the one that was set.
    ValveVoltage,
}

names! { Mode:
    "SelfCheck" = Mode::SelfCheck;
    "Ready" = Mode::Ready;
    "Assisting" = Mode::Assisting;
    "Holding" = Mode::Holding;
    "Venting" = Mode::Venting;
    "Playing" = Mode::Playing;
}

names! { Fault:
    "Bridge(Range)" = Fault::Bridge, Doubt::Range;
    "Bridge(Step)" = Fault::Bridge, Doubt::Step;
    "Bridge(Stuck)" = Fault::Bridge, Doubt::Stuck;
    "Pressure(Range)" = Fault::Pressure, Doubt::Range;
    "Pressure(Step)" = Fault::Pressure, Doubt::Step;
    "Pressure(Stuck)" = Fault::Pressure, Doubt::Stuck;
    "Encoder(Range)" = Fault::Encoder, Doubt::Range;
    "Encoder(Step)" = Fault::Encoder, Doubt::Step;
    "Encoder(Stuck)" = Fault::Encoder, Doubt::Stuck;
    "OverPressure" = Fault::OverPressure;
    "OverContraction" = Fault::OverContraction;
    "MissedTicks" = Fault::MissedTicks;
    "LoadedLever" = Fault::LoadedLever;
    "NotVented" = Fault::NotVented;
    "NotStill" = Fault::NotStill;
    "Uncommanded" = Fault::Uncommanded;
    "PressureControl" = Fault::PressureControl;
    "ForceBalance" = Fault::ForceBalance;
    "OverSpeed" = Fault::OverSpeed;
    "Memory" = Fault::Memory;
    "EmergencyStop" = Fault::EmergencyStop;
    "StopContactsDiffer" = Fault::StopContactsDiffer;
    "Start(Image)" = Fault::Start, StartFault::Image;
    "Start(Ram)" = Fault::Start, StartFault::Ram;
    "Start(Stack)" = Fault::Start, StartFault::Stack;
    "Start(Supply)" = Fault::Start, StartFault::Supply;
    "Start(ValveVoltage)" = Fault::Start, StartFault::ValveVoltage;
    "Start(BrownOut)" = Fault::Start, StartFault::BrownOut;
    "Start(Clock)" = Fault::Start, StartFault::Clock;
    "ValveVoltage" = Fault::ValveVoltage;
}

/// What the analysis of a tick's sensors has found: all that [`decide`] needs.
#[derive(Clone, Copy, Debug)]
pub struct Findings {
    /// Status of the strain-gauge bridge.
    pub bridge: SensorStatus,
    /// Status of the pressure sensor.
    pub pressure: SensorStatus,
    /// Status of the encoder.
    pub encoder: SensorStatus,
    /// ε \[-\], from home.
    pub contraction: f32,
    /// The request of the person or the link.
    pub request: Request,
    /// The reference is at zero, and so is the pressure, unless its sensor has failed: then the
    /// reference has been at zero for long enough.
    pub vented: bool,
    /// What disturbs the self-check, or the rest after it.
    pub unready: Option<Fault>,
    /// Ticks in this mode.
    pub mode_ticks: u16,
    /// Undisturbed ticks of the self-check in a row.
    pub window_ticks: u16,
    /// Ticks since an experiment's pressure was last requested.
    pub silent_ticks: u8,
    /// The controller holds only until a suspect reading is good again.
    pub awaits_reading: bool,
    /// A fault is latched.
    pub latched: bool,
    /// A bit of the memory had flipped.
    pub memory_damaged: bool,
    /// The pressure is above its trip level.
    pub over_pressure: bool,
    /// The contraction is above its trip level.
    pub over_contraction: bool,
    /// More ticks were missed than the settings allow.
    pub ticks_missed: bool,
    /// The rest was disturbed for too long.
    pub uncommanded: bool,
    /// The valve's voltage was not the one that was set.
    pub voltage_astray: bool,
    /// The pressure does not follow its reference.
    pub pressure_astray: bool,
    /// The weight was too fast.
    pub too_fast: bool,
    /// The forces are not in balance.
    pub force_astray: bool,
}

/// What the supervisor decides about the mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decision {
    /// The mode stays.
    Stay,
    /// Another mode begins.
    Go(Mode),
    /// Hold until a suspect reading is good again or has failed.
    AwaitReading,
    /// Latch the fault and vent.
    Fail(Fault),
}

impl Findings {
    /// The fault to be latched; the first in this order if there are several.
    fn fault(&self, mode: Mode) -> Option<Fault> {
        if self.memory_damaged {
            return Some(Fault::Memory);
        }
        match (self.bridge, self.pressure, self.encoder) {
            (SensorStatus::Failed(doubt), ..) => return Some(Fault::Bridge(doubt)),
            (_, SensorStatus::Failed(doubt), _) => return Some(Fault::Pressure(doubt)),
            (.., SensorStatus::Failed(doubt)) => return Some(Fault::Encoder(doubt)),
            _ => {}
        }
        let faults = [
            (self.stops(mode), Fault::EmergencyStop),
            (
                self.request == Request::StopContactsDiffer,
                Fault::StopContactsDiffer,
            ),
            // Before what a wrong voltage leads to.
            (self.voltage_astray, Fault::ValveVoltage),
            (self.over_pressure, Fault::OverPressure),
            (self.over_contraction, Fault::OverContraction),
            (self.ticks_missed, Fault::MissedTicks),
            (self.uncommanded, Fault::Uncommanded),
            (self.pressure_astray, Fault::PressureControl),
            (self.too_fast, Fault::OverSpeed),
            (self.force_astray, Fault::ForceBalance),
        ];
        faults
            .into_iter()
            .find_map(|(is_found, fault)| is_found.then_some(fault))
    }

    /// The emergency stop ends what it is for; elsewhere it only prevents a beginning.
    fn stops(&self, mode: Mode) -> bool {
        let acts = matches!(mode, Mode::Assisting | Mode::Holding | Mode::Playing);
        acts && self.request == Request::Stop
    }

    fn suspect(&self) -> bool {
        [self.bridge, self.pressure, self.encoder].contains(&SensorStatus::Suspect)
    }
}

/// What follows from `findings` in `mode`.
pub fn decide(values: &SettingsValues, mode: Mode, findings: &Findings) -> Decision {
    if let Some(fault) = findings.fault(mode)
        && !findings.latched
    {
        return Decision::Fail(fault);
    }
    match mode {
        Mode::Venting => from_venting(findings),
        _ if findings.request == Request::Vent => Decision::Go(Mode::Venting),
        Mode::SelfCheck => from_self_check(values, findings),
        Mode::Ready => from_ready(values, findings),
        Mode::Assisting => from_assisting(findings),
        Mode::Holding => from_holding(findings),
        Mode::Playing => from_playing(findings),
    }
}

/// Passes after an undisturbed window. If that takes too long, the fault names the disturbance.
fn from_self_check(values: &SettingsValues, findings: &Findings) -> Decision {
    match findings.unready {
        None if findings.window_ticks >= values.self_check_ticks => Decision::Go(Mode::Ready),
        Some(reason) if findings.mode_ticks >= values.self_check_ticks_max => {
            Decision::Fail(reason)
        }
        _ => Decision::Stay,
    }
}

fn from_ready(values: &SettingsValues, findings: &Findings) -> Decision {
    let may_begin = findings.unready.is_none() && !findings.suspect();
    match findings.request {
        Request::Assist if may_begin => Decision::Go(Mode::Assisting),
        Request::Play(_) if may_begin && values.play_pressure_pa_max > 0.0 => {
            Decision::Go(Mode::Playing)
        }
        _ => Decision::Stay,
    }
}

/// An experiment is run by a program: when its requests stop, the experiment is unattended.
fn from_playing(findings: &Findings) -> Decision {
    if findings.silent_ticks >= PLAY_SILENCE_TICKS {
        Decision::Go(Mode::Venting)
    } else {
        Decision::Stay
    }
}

fn from_assisting(findings: &Findings) -> Decision {
    if findings.request == Request::Hold {
        Decision::Go(Mode::Holding)
    } else if findings.suspect() {
        Decision::AwaitReading
    } else {
        Decision::Stay
    }
}

/// A requested hold ends with a request to assist; one over a suspect reading ends with that.
fn from_holding(findings: &Findings) -> Decision {
    let resumes = findings.request == Request::Assist || findings.awaits_reading;
    if findings.awaits_reading && findings.request == Request::Hold {
        Decision::Go(Mode::Holding)
    } else if resumes && !findings.suspect() {
        Decision::Go(Mode::Assisting)
    } else {
        Decision::Stay
    }
}

fn from_venting(findings: &Findings) -> Decision {
    if findings.request == Request::Reset && findings.vented {
        Decision::Go(Mode::SelfCheck)
    } else {
        Decision::Stay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALM: Findings = Findings {
        bridge: SensorStatus::Good,
        pressure: SensorStatus::Good,
        encoder: SensorStatus::Good,
        contraction: 0.0,
        request: Request::None,
        vented: true,
        unready: None,
        mode_ticks: 0,
        window_ticks: 0,
        silent_ticks: 0,
        awaits_reading: false,
        latched: false,
        memory_damaged: false,
        over_pressure: false,
        over_contraction: false,
        ticks_missed: false,
        uncommanded: false,
        voltage_astray: false,
        pressure_astray: false,
        too_fast: false,
        force_astray: false,
    };

    #[test]
    fn emergency_stop_ends_every_mode_that_moves_and_changes_no_other() {
        let stopped = Findings {
            request: Request::Stop,
            ..CALM
        };
        let values = SettingsValues::reference();
        for (mode, _) in Mode::NAMED {
            let expected = match mode {
                Mode::Assisting | Mode::Holding | Mode::Playing => {
                    Decision::Fail(Fault::EmergencyStop)
                }
                Mode::SelfCheck | Mode::Ready | Mode::Venting => Decision::Stay,
            };
            assert_eq!(decide(&values, *mode, &stopped), expected, "{mode:?}");
        }
    }

    /// Records contain these names: a variant may be renamed, its name may not.
    #[test]
    fn names_of_modes_and_faults_are_those_of_records() {
        let modes = "SelfCheck Ready Assisting Holding Venting Playing";
        assert!(
            modes
                .split(' ')
                .eq(Mode::NAMED.iter().map(|(_, name)| *name))
        );
        let faults = "Bridge(Range) Bridge(Step) Bridge(Stuck) \
                      Pressure(Range) Pressure(Step) Pressure(Stuck) \
                      Encoder(Range) Encoder(Step) Encoder(Stuck) \
                      OverPressure OverContraction MissedTicks LoadedLever NotVented NotStill \
                      Uncommanded PressureControl ForceBalance OverSpeed Memory EmergencyStop \
                      StopContactsDiffer Start(Image) Start(Ram) Start(Stack) Start(Supply) \
                      Start(ValveVoltage) Start(BrownOut) Start(Clock) ValveVoltage";
        assert!(
            faults
                .split(' ')
                .eq(Fault::NAMED.iter().map(|(_, name)| *name))
        );
        for (mode, name) in Mode::NAMED {
            assert_eq!((mode.name(), Mode::from_name(name)), (*name, Some(*mode)));
        }
        for (fault, name) in Fault::NAMED {
            assert_eq!(
                (fault.name(), Fault::from_name(name)),
                (*name, Some(*fault))
            );
        }
        assert_eq!(
            (Mode::from_name("ready"), Fault::from_name("Bridge")),
            (None, None)
        );
    }
}

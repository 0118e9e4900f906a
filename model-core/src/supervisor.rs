//! Modes, and what leads from one to another.
//!
//! ```text
//! SelfCheck ──passed──▶ Ready ──Assist──▶ Assisting ◀──Assist / reading good again── Holding
//!     ▲                   │                   └──────Hold / reading suspect──────────▶ │
//!     │                   └─────────────Vent, or any fault─────────────┐               │
//!     └──Reset, vented── Venting ◀─────────────────────────────────────┴───────────────┘
//! ```
//!
//! Ready ──Play──▶ Playing ──Vent, silence or any fault──▶ Venting: an experiment's pressures,
//! where the settings allow them. Nobody has to hold a lever for it, so it ends when nobody asks
//! any more.
//!
//! A fault is latched with its reason until it is reset, also while venting on request; the first
//! one counts. Venting lowers the reference at a limited rate: the weight is let down, not dropped.

use crate::io::Request;
use crate::plausibility::{Doubt, Verdict};
use crate::safety::{SafetyFunction, Switches};
use crate::settings::SettingsValues;
use serde::{Deserialize, Serialize};

/// An experiment ends after so many ticks in which no pressure was asked for: half a second.
pub const PLAY_SILENCE_TICKS: u8 = 50;

/// What the controller does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Vented, watching the sensors, taking their zeros.
    #[default]
    SelfCheck,
    /// Vented, waiting to be asked.
    Ready,
    /// The muscle carries K times the finger's force.
    Assisting,
    /// The pressure reference stays where it is.
    Holding,
    /// The pressure reference falls to zero and stays there.
    Venting,
    /// The pressure reference follows what is asked for: an experiment.
    Playing,
}

/// Why the controller vents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// The strain-gauge bridge is not to be believed.
    Bridge(Doubt),
    /// The pressure sensor is not to be believed.
    Pressure(Doubt),
    /// The encoder is not to be believed.
    Encoder(Doubt),
    /// The pressure is above its trip level.
    OverPressure,
    /// The contraction is above its trip level.
    OverContraction,
    /// Too many ticks in a row did not happen.
    MissedTicks,
    /// At start, the lever was loaded.
    LoadedLever,
    /// At start, the muscle was under pressure.
    NotVented,
    /// At start, the muscle was moving.
    NotStill,
    /// The muscle had pressure, or lifted, before it was asked to.
    Uncommanded,
    /// The pressure does not follow its reference: valve, supply, hose, or pressure sensor.
    PressureControl,
    /// Pressure, contraction and weight do not fit: a sensor, the load, or the muscle.
    ForceBalance,
    /// The weight is faster than the reference ever is.
    OverSpeed,
    /// The controller's memory has changed by itself.
    Memory,
}

/// What a tick has found out, before anything is decided.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Findings {
    pub bridge: Verdict,
    pub pressure: Verdict,
    pub encoder: Verdict,
    pub pressure_pa: f32,
    pub contraction: f32,
    pub missed_ticks: u8,
    pub request: Request,
    /// The reference is at zero, and the pressure is too or cannot be known.
    pub vented: bool,
    /// What disturbs the self-check, or the rest after it.
    pub unready: Option<Fault>,
    /// The rest was disturbed for too long.
    pub uncommanded: bool,
    /// Ticks in this mode, and good ones in a row of the self-check.
    pub mode_ticks: u16,
    pub window_ticks: u16,
    /// Ticks since an experiment's pressure was asked for.
    pub silent_ticks: u8,
    /// Holding only because a reading was suspect.
    pub bridging: bool,
    /// A fault is latched.
    pub latched: bool,
    /// The pressure is not where reference and valve have it.
    pub pressure_astray: bool,
    /// The forces are not in balance.
    pub force_astray: bool,
    /// The weight was too fast.
    pub too_fast: bool,
    /// A bit of the memory had flipped.
    pub memory_damaged: bool,
    /// What is looked at.
    pub switches: Switches,
}

/// What is decided about the mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Decision {
    Stay,
    Go(Mode),
    /// Hold until a suspect reading is good again or has failed.
    Bridge,
    Fail(Fault),
}

impl Findings {
    fn fault(&self, values: &SettingsValues) -> Option<Fault> {
        let looked_at = |function| self.switches.on(function);
        if self.memory_damaged {
            return Some(Fault::Memory);
        }
        match (self.bridge, self.pressure, self.encoder) {
            (Verdict::Failed(doubt), ..) => return Some(Fault::Bridge(doubt)),
            (_, Verdict::Failed(doubt), _) => return Some(Fault::Pressure(doubt)),
            (.., Verdict::Failed(doubt)) => return Some(Fault::Encoder(doubt)),
            _ => {}
        }
        let over_pressure = self.pressure_pa > values.pressure_trip_pa;
        let over_contraction = self.contraction > values.contraction_trip;
        let missed_ticks = self.missed_ticks > values.missed_ticks_max;
        if over_pressure && looked_at(SafetyFunction::PressureWatch) {
            Some(Fault::OverPressure)
        } else if over_contraction && looked_at(SafetyFunction::WeightWatch) {
            Some(Fault::OverContraction)
        } else if missed_ticks && looked_at(SafetyFunction::MissedTicks) {
            Some(Fault::MissedTicks)
        } else if self.uncommanded && looked_at(SafetyFunction::RestWatch) {
            Some(Fault::Uncommanded)
        } else if self.pressure_astray && looked_at(SafetyFunction::PressureWatch) {
            Some(Fault::PressureControl)
        } else if self.too_fast && looked_at(SafetyFunction::SpeedTrip) {
            Some(Fault::OverSpeed)
        } else if self.force_astray && looked_at(SafetyFunction::WeightWatch) {
            Some(Fault::ForceBalance)
        } else {
            None
        }
    }

    fn suspect(&self) -> bool {
        [self.bridge, self.pressure, self.encoder].contains(&Verdict::Suspect)
    }
}

/// What follows from `findings` in `mode`.
pub(crate) fn decide(values: &SettingsValues, mode: Mode, findings: &Findings) -> Decision {
    if let Some(fault) = findings.fault(values)
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

/// Passes after an undisturbed window; gives up, naming what disturbs, when it takes too long.
fn from_self_check(values: &SettingsValues, findings: &Findings) -> Decision {
    let checks = findings.switches.on(SafetyFunction::SelfCheck);
    let (unready, good_ticks) = if checks {
        (findings.unready, findings.window_ticks)
    } else {
        (None, findings.mode_ticks)
    };
    match unready {
        None if good_ticks >= values.self_check_ticks => Decision::Go(Mode::Ready),
        Some(reason) if findings.mode_ticks >= values.self_check_ticks_max => {
            Decision::Fail(reason)
        }
        _ => Decision::Stay,
    }
}

fn from_ready(values: &SettingsValues, findings: &Findings) -> Decision {
    let watched = findings.switches.on(SafetyFunction::RestWatch);
    let at_rest = findings.unready.is_none() || !watched;
    let may_begin = at_rest && !findings.suspect();
    match findings.request {
        Request::Assist if may_begin => Decision::Go(Mode::Assisting),
        Request::Play(_) if may_begin && values.play_pressure_pa_max > 0.0 => {
            Decision::Go(Mode::Playing)
        }
        _ => Decision::Stay,
    }
}

/// An experiment has a program behind it: when that is silent, nobody is watching.
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
        Decision::Bridge
    } else {
        Decision::Stay
    }
}

/// A hold that was asked for ends when assistance is; one over a suspect reading ends with it.
fn from_holding(findings: &Findings) -> Decision {
    let resumes = findings.request == Request::Assist || findings.bridging;
    if findings.bridging && findings.request == Request::Hold {
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

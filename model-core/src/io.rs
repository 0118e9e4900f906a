//! Input and output of a tick. Both are complete, so that a record of them can be replayed.

use crate::pressure::GaugePa;
use crate::signal::{AdcCount, DacCount, EncoderCount};
use crate::supervisor::{Fault, Mode};
use core::fmt;
use serde::{Deserialize, Serialize};

/// A request of the person or the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Request {
    /// No request.
    #[default]
    None,
    /// Begin to assist, or resume.
    Assist,
    /// Hold the pressure.
    Hold,
    /// Let the weight down and switch off.
    Vent,
    /// Clear the fault and check again, once vented.
    Reset,
    /// Bring the pressure to this value \[Pa\], as far as the settings allow: an experiment. To be
    /// repeated each tick or so.
    Play(u32),
    /// The emergency stop is open: let the weight down, and begin nothing.
    Stop,
    /// The contacts of the emergency stop differ: one, or its wire, is broken.
    StopContactsDiffer,
}

/// The name of this request in records; `Play(…)` contains its pressure \[Pa\].
impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Request::None => "None",
            Request::Assist => "Assist",
            Request::Hold => "Hold",
            Request::Vent => "Vent",
            Request::Reset => "Reset",
            Request::Stop => "Stop",
            Request::StopContactsDiffer => "StopContactsDiffer",
            Request::Play(pressure_pa) => return write!(f, "Play({pressure_pa})"),
        })
    }
}

impl Request {
    /// The request that `name` stands for in records, if any.
    pub fn from_name(name: &str) -> Option<Request> {
        match name {
            "None" => Some(Request::None),
            "Assist" => Some(Request::Assist),
            "Hold" => Some(Request::Hold),
            "Vent" => Some(Request::Vent),
            "Reset" => Some(Request::Reset),
            "Stop" => Some(Request::Stop),
            "StopContactsDiffer" => Some(Request::StopContactsDiffer),
            other => {
                let pressure_pa = other.strip_prefix("Play(")?.strip_suffix(')')?;
                pressure_pa.parse().ok().map(Request::Play)
            }
        }
    }
}

/// Input of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sensors {
    /// Strain-gauge bridge of the lever.
    pub bridge: AdcCount,
    /// Muscle pressure sensor.
    pub pressure: AdcCount,
    /// Muscle displacement encoder.
    pub encoder: EncoderCount,
    /// The valve's voltage, read back before this tick sets another.
    pub read_back: AdcCount,
    /// Ticks missed since the last one.
    pub missed_ticks: u8,
    /// The request of the person or the link.
    pub request: Request,
}

/// Output of a tick: the valve's command, and what is logged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Output {
    /// What the valve's DAC is set to.
    pub valve: DacCount,
    /// The mode after this tick.
    pub mode: Mode,
    /// The fault that is latched, if any.
    pub fault: Option<Fault>,
    /// P_r: `valve` before it is rounded to counts.
    pub pressure_ref: GaugePa<f32>,
    /// F_b \[N\], tared.
    pub finger_force_n: f32,
    /// F_c \[N\], Eq 7.
    pub reference_force_n: f32,
    /// ε \[-\], from home.
    pub contraction: f32,
    /// Muscle pressure.
    pub pressure: GaugePa<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Records contain these names: a variant may be renamed, its name may not.
    #[test]
    fn names_of_requests_are_those_of_records() {
        let words = [
            (Request::None, "None"),
            (Request::Assist, "Assist"),
            (Request::Hold, "Hold"),
            (Request::Vent, "Vent"),
            (Request::Reset, "Reset"),
            (Request::Stop, "Stop"),
            (Request::StopContactsDiffer, "StopContactsDiffer"),
            (Request::Play(0), "Play(0)"),
            (Request::Play(u32::MAX), "Play(4294967295)"),
        ];
        for (request, word) in words {
            assert_eq!(request.to_string(), word);
            assert_eq!(Request::from_name(word), Some(request));
        }
        for word in [
            "",
            "assist",
            "Play",
            "Play()",
            "Play(-1)",
            "Play(4294967296)",
        ] {
            assert_eq!(Request::from_name(word), None, "{word}");
        }
    }
}

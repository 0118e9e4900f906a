//! What goes into a tick and what comes out: all of it, so that a record of both can be replayed.

use crate::pressure::GaugePa;
use crate::signal::{AdcCount, DacCount, EncoderCount};
use crate::supervisor::{Fault, Mode};
use serde::{Deserialize, Serialize};

/// What the person or the link asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Request {
    /// Nothing: go on.
    #[default]
    None,
    /// Begin or resume to assist.
    Assist,
    /// Hold the pressure.
    Hold,
    /// Let the weight down and switch off.
    Vent,
    /// Forget the fault and check again, once vented.
    Reset,
    /// Bring the pressure to so many pascals, as far as the settings allow: an experiment, to be
    /// repeated each tick or so.
    Play(u32),
}

/// All that a tick may read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sensors {
    /// Strain-gauge bridge of the lever.
    pub bridge: AdcCount,
    /// Muscle pressure sensor.
    pub pressure: AdcCount,
    /// Muscle displacement encoder.
    pub encoder: EncoderCount,
    /// Ticks that did not happen since the last one.
    pub missed_ticks: u8,
    /// What is asked for.
    pub request: Request,
}

/// All that a tick decides: the valve's command, and what is logged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Output {
    /// What the valve's DAC is set to.
    pub valve: DacCount,
    /// The mode after this tick.
    pub mode: Mode,
    /// The fault that is latched, if any.
    pub fault: Option<Fault>,
    /// P_r: what `valve` stands for, before rounding to counts.
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

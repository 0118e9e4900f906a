//! One tick of a run: the plant's state at sampling, the controller's input and its output.

use crate::record::Record;
use crate::record::columns::{self, Row, Software};
use model_core::constants::TICK_PERIOD_MS;
use model_core::io::{Output, Sensors};
use model_core::pressure::GaugePa;
use model_core::settings::Settings;

/// Period of the controller's tick \[s\].
pub const TICK_S: f64 = TICK_PERIOD_MS as f64 / 1e3;

/// One tick of a run with a simulated plant.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Time of sampling \[s\].
    pub time_s: f64,
    /// Finger displacement x \[m\].
    pub finger_m: f64,
    /// Finger force F_b \[N\], Eq 6.
    pub finger_force_n: f64,
    /// Muscle force F \[N\].
    pub force_n: f64,
    /// Contraction ε \[-\].
    pub contraction: f64,
    /// Pressure in the muscle.
    pub pressure: GaugePa<f64>,
    /// Gas temperature \[K\].
    pub temperature_k: f64,
    /// Reference pressure at the valve's input from this tick on.
    pub valve_reference: GaugePa<f64>,
    /// While a test signal is played: whether the shut-off valve between valve and muscle is to be
    /// shut.
    pub shut: Option<bool>,
    /// The controller's input.
    pub sensors: Sensors,
    /// The controller's output.
    pub output: Output,
}

impl Tick {
    /// The tick as a record's row, with the plant's muscle force as a load cell would measure it.
    pub fn row(&self) -> Row {
        Row {
            time_s: self.time_s,
            pressure_ref_pa: self.valve_reference.0,
            shut: self.shut,
            sensors: self.sensors,
            output: self.output,
            plant: Some((self.force_n, self.finger_m)),
            board: None,
            start_settings: None,
            software: None,
        }
    }
}

/// The record of a run whose controller started with `settings`.
///
/// # Panics
/// If there are no ticks.
pub fn record(settings: &Settings, ticks: &[Tick]) -> Record {
    let mut rows: Vec<Row> = ticks.iter().map(Tick::row).collect();
    if let Some(first) = rows.first_mut() {
        first.start_settings = Some(*settings);
        first.software = Some(Software::default());
    }
    columns::record(&rows)
}

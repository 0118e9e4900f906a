//! The board's electrical side: physical quantities to the counts that its converters read, and
//! the DAC's counts to the pressure that the valve is asked for.

use model_core::io::{Output, Request, Sensors};
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, DacCount, EncoderCount};

/// What the instruments measure at one instant.
#[derive(Clone, Copy)]
pub(crate) struct Measurands {
    /// Force on the strain-gauge bridge \[N\].
    pub(crate) bridge_n: f64,
    /// Pressure in the muscle, gauge \[Pa\].
    pub(crate) pressure_pa: f64,
    /// Travel of the encoder from its zero \[m\].
    pub(crate) travel_m: f64,
}

/// Counts of the two analog channels, bridge and pressure sensor. Their 12 bits are coarser than
/// single precision.
pub(crate) fn adc_counts(values: &SettingsValues, measured: &Measurands) -> [AdcCount; 2] {
    [
        values.bridge.count(measured.bridge_n as f32),
        values.pressure_sensor.count(measured.pressure_pa as f32),
    ]
}

/// Counts of the encoder from its zero.
pub(crate) fn encoder_counts(values: &SettingsValues, measured: &Measurands) -> i64 {
    (measured.travel_m / f64::from(values.encoder_m_per_count)).round() as i64
}

/// The input of a tick that the board's converters give after one with this valve output, with a
/// request from the link.
pub(crate) fn sample(
    values: &SettingsValues,
    measured: &Measurands,
    valve: DacCount,
    request: Request,
) -> Sensors {
    let [bridge, pressure] = adc_counts(values, measured);
    Sensors {
        bridge,
        pressure,
        encoder: EncoderCount(encoder_counts(values, measured) as i32 as u32),
        read_back: AdcCount(valve.get()),
        missed_ticks: 0,
        request,
    }
}

/// The reference pressure at the valve's input for the DAC count of `output`.
pub fn valve_reference(settings: &Settings, output: &Output) -> GaugePa<f64> {
    let pressure = settings.values().valve_drive.pressure(output.valve);
    GaugePa(pressure.0.into())
}

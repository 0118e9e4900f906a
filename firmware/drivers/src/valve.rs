//! The voltage of the servo valve.

use model_core::signal::DacCount;

/// An analog output for the valve's amplifier; `embedded-hal` 1.0 has no such trait.
///
/// Its voltage is 0 V before the first call, and after a reset of the chip without any program.
pub trait AnalogOutput {
    /// Sets the voltage.
    fn set(&mut self, count: DacCount);
}

//! The valve's converter on a board whose chip has none: MCP4922 (datasheet DS22250), 12 bits, of
//! which channel A is used. Its LDAC is tied low: the voltage changes when CS rises.
//!
//! A reset of the chip does not reset this converter. A pull-down at SHDN therefore shuts it down
//! while the chip's pins float; its output is then open, and the resistor at the amplifier holds it
//! at 0 V.

use crate::valve::AnalogOutput;
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{MODE_0, Mode, SpiBus};
use model_core::signal::DacCount;
use model_core::start::VALVE_LEVELS;

/// The SPI mode; the converter also takes mode 3.
pub const MODE: Mode = MODE_0;
/// Highest SPI clock at 3.3 V \[Hz\].
pub const CLOCK_HZ_MAX: u32 = 20_000_000;

/// What the chip's converter may read back at [`VALVE_LEVELS`] \[counts\]: 0 V is that of the open
/// output; at the second level the offset is 41, the gain error 5, the nonlinearity 12 (datasheet,
/// 1 % of full scale, 1 % and 12 LSB), and the reading converter's error 5.
pub const READ_BACK: [(u16, u16); VALVE_LEVELS.len()] = [(0, 40), (449, 575)];

/// Channel A, reference unbuffered (its range then includes the supply), gain 1, active.
const COMMAND: u16 = 0x3000;

/// The converter on its bus: `select` is CS, `shutdown` is SHDN; low shuts it down.
pub struct Mcp4922<B, S, D> {
    bus: B,
    select: S,
    shutdown: D,
}

impl<B: SpiBus, S: OutputPin, D: OutputPin> Mcp4922<B, S, D> {
    /// A converter that is shut down until the first [`AnalogOutput::set`].
    pub fn new(bus: B, mut select: S, mut shutdown: D) -> Mcp4922<B, S, D> {
        let _ = shutdown.set_low();
        let _ = select.set_high();
        Mcp4922 {
            bus,
            select,
            shutdown,
        }
    }

    /// None on any failure of a pin or the bus.
    fn write(&mut self, word: u16) -> Option<()> {
        self.select.set_low().ok()?;
        let written = self.bus.write(&word.to_be_bytes());
        let flushed = self.bus.flush();
        // The rising edge ends the word in any case: the converter ignores one that is cut short.
        self.select.set_high().ok()?;
        written.ok().and(flushed.ok())
    }
}

impl<B: SpiBus, S: OutputPin, D: OutputPin> AnalogOutput for Mcp4922<B, S, D> {
    /// Shuts the converter down if the bus fails, as the voltage would be that of another tick, and
    /// at 0 V: nothing answers on the bus, and a word that a broken wire loses leaves the
    /// voltage as it is, but SHDN has a wire of its own.
    fn set(&mut self, count: DacCount) {
        let _ = match self.write(COMMAND | count.get()) {
            Some(()) if count != DacCount::default() => self.shutdown.set_high(),
            _ => self.shutdown.set_low(),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as PinState};
    use embedded_hal_mock::eh1::spi::{Mock as Spi, Transaction};
    use std::vec;

    extern crate std;

    fn states<const N: usize>(states: [State; N]) -> Pin {
        Pin::new(&states.map(PinState::set))
    }

    #[test]
    fn word_of_channel_a_is_framed_by_select_and_ends_the_shutdown() {
        use State::{High, Low};
        let mut spi = Spi::new(&[
            Transaction::write_vec(vec![0x30, 0x01]),
            Transaction::flush(),
            Transaction::write_vec(vec![0x3a, 0xbc]),
            Transaction::flush(),
        ]);
        let mut select = states([High, Low, High, Low, High]);
        let mut shutdown = states([Low, High, High]);
        let mut valve = Mcp4922::new(spi.clone(), select.clone(), shutdown.clone());
        valve.set(DacCount::new(1));
        valve.set(DacCount::new(0xabc));
        spi.done();
        select.done();
        shutdown.done();
    }

    #[test]
    fn zero_volts_need_no_word_to_arrive() {
        use State::{High, Low};
        // The chip sees no difference between a converter and a broken wire.
        let mut spi = Spi::new(&[
            Transaction::write_vec(vec![0x38, 0x00]),
            Transaction::flush(),
            Transaction::write_vec(vec![0x30, 0x00]),
            Transaction::flush(),
        ]);
        let mut select = states([High, Low, High, Low, High]);
        let mut shutdown = states([Low, High, Low]);
        let mut valve = Mcp4922::new(spi.clone(), select.clone(), shutdown.clone());
        valve.set(DacCount::new(0x800));
        valve.set(DacCount::default());
        spi.done();
        select.done();
        shutdown.done();
    }

    /// A bus that fails.
    struct Broken;

    impl embedded_hal::spi::ErrorType for Broken {
        type Error = embedded_hal::spi::ErrorKind;
    }

    impl SpiBus for Broken {
        fn read(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn write(&mut self, _: &[u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn transfer(&mut self, _: &mut [u8], _: &[u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn transfer_in_place(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn flush(&mut self) -> Result<(), Self::Error> {
            Ok(())
        }
    }

    #[test]
    fn failure_of_the_bus_shuts_the_converter_down() {
        use State::{High, Low};
        let mut select = states([High, Low, High]);
        let mut shutdown = states([Low, Low]);
        let mut valve = Mcp4922::new(Broken, select.clone(), shutdown.clone());
        valve.set(DacCount::new(0x800));
        select.done();
        shutdown.done();
    }
}

//! SPI as `embedded-hal` 1.0 means it.

use crate::board;
use embedded_hal::spi::{ErrorType, SpiBus};
use stm32f4xx_hal::nb;
use stm32f4xx_hal::spi::{self, Instance, Spi};

/// The bus, whose `flush` waits for the last bit: that of the HAL does nothing, and CS would rise
/// when the last bit is sampled, half a clock too early.
pub struct Bus<SPI: Instance>(pub Spi<SPI>);

impl<SPI: Instance> ErrorType for Bus<SPI> {
    type Error = spi::Error;
}

impl<SPI: Instance> SpiBus for Bus<SPI> {
    fn read(&mut self, words: &mut [u8]) -> Result<(), spi::Error> {
        self.0.read(words)
    }
    fn write(&mut self, words: &[u8]) -> Result<(), spi::Error> {
        self.0.write(words)
    }
    fn transfer(&mut self, read: &mut [u8], write: &[u8]) -> Result<(), spi::Error> {
        self.0.transfer(read, write)
    }
    /// Bounded, unlike the HAL's: a unit that an interference has switched off must not hold up
    /// the tick.
    fn transfer_in_place(&mut self, words: &mut [u8]) -> Result<(), spi::Error> {
        for word in words {
            bounded(|| self.0.write_nonblocking(*word))?;
            *word = bounded(|| self.0.read_nonblocking())?;
        }
        Ok(())
    }
    fn flush(&mut self) -> Result<(), spi::Error> {
        while self.0.is_busy() {}
        Ok(())
    }
}

/// Attempts before a word counts as lost: more than 20 µs at 96 MHz, in which 15 bytes pass.
const ATTEMPTS: u32 = 500;

/// The result as soon as there is one.
fn bounded<T>(mut attempt: impl FnMut() -> nb::Result<T, spi::Error>) -> Result<T, spi::Error> {
    for _ in 0..ATTEMPTS {
        match attempt() {
            Err(nb::Error::WouldBlock) => {}
            Err(nb::Error::Other(error)) => return Err(error),
            Ok(value) => return Ok(value),
        }
    }
    Err(spi::Error::ModeFault)
}

/// Whether SPI2 and SPI3 have this clock. The HAL would take the next divider below, which is a
/// faster one.
pub const fn divides_to(clock_hz: u32) -> bool {
    let divider = board::PCLK1_HZ / clock_hz;
    divider * clock_hz == board::PCLK1_HZ && divider.is_power_of_two()
}

//! The voltage of the servo valve: an MCP4922 on SPI2, for chips without a DAC.

use super::spi_bus::{self, Bus};
use crate::board::{self, ValvePins, ValveReadBackPin, ValveSelectPin, ValveShutdownPin};
use model_core::signal::DacCount;
use rig_drivers::mcp4922::{CLOCK_HZ_MAX, MODE, Mcp4922};
use rig_drivers::valve::AnalogOutput;
use stm32f4xx_hal::pac::SPI2;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;

/// What may be read back.
pub use rig_drivers::mcp4922::READ_BACK;
/// The unit of the chip behind the valve's voltage.
pub use stm32f4xx_hal::pac::SPI2 as Unit;

/// SPI clock \[Hz\]: a word takes 2.7 µs, and the wires may be long.
const CLOCK_HZ: u32 = 6_000_000;
const _: () = assert!(CLOCK_HZ <= CLOCK_HZ_MAX && spi_bus::divides_to(CLOCK_HZ));

/// The valve output.
pub struct Valve {
    converter: Mcp4922<Bus<SPI2>, ValveSelectPin, ValveShutdownPin>,
    /// The output's wire to a channel of the chip's converter.
    pub read_back: ValveReadBackPin,
}

impl Valve {
    /// Brings the output to 0 V.
    pub fn new(spi: SPI2, pins: ValvePins, rcc: &mut Rcc) -> Valve {
        let bus = spi.spi(
            (Some(pins.clock), SPI2::NoMiso, Some(pins.data)),
            MODE,
            CLOCK_HZ.Hz(),
            rcc,
        );
        let mut valve = Valve {
            converter: Mcp4922::new(Bus(bus), pins.select, pins.shutdown),
            read_back: pins.read_back,
        };
        valve.set(DacCount::default());
        valve
    }
}

impl AnalogOutput for Valve {
    fn set(&mut self, count: DacCount) {
        self.converter.set(count);
    }
}

/// Sets 0 V from any context, also from a fault handler that has interrupted a transfer: shuts the
/// converter down, which needs no transfer. While the pin still floats its pull-down does.
pub fn make_safe() {
    board::shut_valve_converter_down();
}

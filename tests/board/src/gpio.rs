//! GPIO: modes, alternate functions, levels (RM0390 chapter 7; functions: datasheet table 11).

use crate::adc::Imperfection;
use crate::ads1220::ConverterFaults;
use crate::pin::{Pin, pin};
use crate::pwr::REGULATOR_NS;

const MODER: usize = 0x00;
const OSPEEDR: usize = 0x08;
const PUPDR: usize = 0x0c;
const IDR: usize = 0x10;
const ODR: usize = 0x14;
const BSRR: usize = 0x18;
const LCKR: usize = 0x1c;
const AFRL: usize = 0x20;
/// Ports A to H.
pub const PORTS: usize = 8;

/// Configuration of a pin.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mode {
    /// Digital input.
    Input,
    /// Output of ODR.
    Output,
    /// Connected to a peripheral.
    Alternate(u8),
    /// Analog; the digital input is off.
    Analog,
}

/// Timer (2 to 5), channel (1 or 2), alternate function and pin of the counter inputs.
pub const TIMER_INPUTS: [(usize, usize, u8, Pin); 19] = [
    (2, 1, 1, pin('A', 0)),
    (2, 1, 1, pin('A', 5)),
    (2, 1, 1, pin('A', 15)),
    (2, 1, 1, pin('B', 8)),
    (2, 2, 1, pin('A', 1)),
    (2, 2, 1, pin('B', 3)),
    (2, 2, 1, pin('B', 9)),
    (3, 1, 2, pin('A', 6)),
    (3, 1, 2, pin('B', 4)),
    (3, 1, 2, pin('C', 6)),
    (3, 2, 2, pin('A', 7)),
    (3, 2, 2, pin('B', 5)),
    (3, 2, 2, pin('C', 7)),
    (4, 1, 2, pin('B', 6)),
    (4, 1, 2, pin('D', 12)),
    (4, 2, 2, pin('B', 7)),
    (4, 2, 2, pin('D', 13)),
    (5, 1, 2, pin('A', 0)),
    (5, 2, 2, pin('A', 1)),
];
/// Pin of USART2, alternate function 7, connected to the ST-LINK.
pub const LINK_TX: Pin = pin('A', 2);
/// See [`LINK_TX`].
pub const LINK_RX: Pin = pin('A', 3);
/// Pins of the two DAC channels.
pub const DAC_PINS: [Pin; 2] = [pin('A', 4), pin('A', 5)];

/// The valve's voltage: the pin of the DAC, or wired to the MCP4922 in its place.
pub const VALVE: Pin = pin('A', 4);
/// Pins of the MCP4922 on a board whose chip has no DAC: SCK and SDI at SPI2, CS, SHDN.
pub const CONVERTER_CLOCK: Pin = pin('B', 13);
/// See [`CONVERTER_CLOCK`].
pub const CONVERTER_DATA: Pin = pin('B', 15);
/// See [`CONVERTER_CLOCK`].
pub const CONVERTER_SELECT: Pin = pin('B', 12);
/// See [`CONVERTER_CLOCK`].
pub const CONVERTER_SHUTDOWN: Pin = pin('B', 14);

/// Pins of the ADS1220: SCLK, DIN and DOUT at SPI3, CS, DRDY.
pub const BRIDGE_CLOCK: Pin = pin('C', 10);
/// See [`BRIDGE_CLOCK`].
pub const BRIDGE_DATA_IN: Pin = pin('C', 12);
/// See [`BRIDGE_CLOCK`].
pub const BRIDGE_DATA_OUT: Pin = pin('C', 11);
/// See [`BRIDGE_CLOCK`].
pub const BRIDGE_SELECT: Pin = pin('B', 7);
/// See [`BRIDGE_CLOCK`].
pub const BRIDGE_READY: Pin = pin('C', 2);
/// The bridge's signal: the voltage of its amplifier at the chip's converter. An ADS1220 has the
/// bridge itself, of which the same scale is ±1.953 mV/V; then half of its supply is at the pin.
pub const BRIDGE: Pin = pin('C', 0);

/// The pin of an ADC channel; none for the internal ones.
pub fn adc_pin(channel: u32) -> Option<Pin> {
    match channel as u8 {
        n @ 0..=7 => Some(pin('A', n)),
        n @ 8..=9 => Some(pin('B', n - 8)),
        n @ 10..=15 => Some(pin('C', n - 10)),
        _ => None,
    }
}

/// External signals at the pins; resets of the chip do not change them.
#[derive(Clone)]
pub struct External {
    /// Voltage that a pin is driven to.
    pub volts: [[f64; 16]; PORTS],
    /// Level that a pin is driven to; none if it is not driven.
    pub levels: [[Option<bool>; 16]; PORTS],
    /// Voltage that the valve's output is pulled to by what is connected; none if it is not loaded.
    pub valve_load: Option<f64>,
    /// How the converter differs from an ideal one.
    pub converter: Imperfection,
    /// Time that the core's regulator takes to its voltage \[ns\]; none if it never gets there, as
    /// without its capacitors.
    pub regulator_ns: Option<u64>,
    /// What is wrong with the bridge's converter; none if there is no such converter.
    pub bridge_converter: Option<ConverterFaults>,
}

impl Default for External {
    fn default() -> Self {
        External {
            volts: [[0.0; 16]; PORTS],
            levels: [[None; 16]; PORTS],
            valve_load: None,
            converter: Imperfection::default(),
            regulator_ns: Some(REGULATOR_NS),
            bridge_converter: None,
        }
    }
}

/// The registers of all ports.
pub struct Gpio {
    words: [[u32; 10]; PORTS],
}

impl Default for Gpio {
    fn default() -> Self {
        let mut gpio = Gpio {
            words: [[0; 10]; PORTS],
        };
        (0..PORTS).for_each(|port| gpio.reset(port));
        gpio
    }
}

impl Gpio {
    /// Resets a port; the debug pins of ports A and B are alternate functions after a reset.
    pub fn reset(&mut self, port: usize) {
        self.words[port] = [0; 10];
        let (moder, ospeedr, pupdr) = match port {
            0 => (0xa800_0000, 0x0c00_0000, 0x6400_0000),
            1 => (0x280, 0xc0, 0x100),
            _ => (0, 0, 0),
        };
        self.words[port][MODER / 4] = moder;
        self.words[port][OSPEEDR / 4] = ospeedr;
        self.words[port][PUPDR / 4] = pupdr;
    }

    /// Configuration of `pin`.
    pub fn mode(&self, pin: Pin) -> Mode {
        let words = &self.words[usize::from(pin.port)];
        let number = usize::from(pin.number);
        match words[MODER / 4] >> (2 * number) & 3 {
            0 => Mode::Input,
            1 => Mode::Output,
            2 => Mode::Alternate((words[AFRL / 4 + number / 8] >> (4 * (number % 8)) & 15) as u8),
            _ => Mode::Analog,
        }
    }

    /// Whether an output pin has the lowest speed: up to 4 MHz at 50 pF (datasheets, OSPEEDR 00).
    pub fn is_slow(&self, pin: Pin) -> bool {
        self.words[usize::from(pin.port)][OSPEEDR / 4] >> (2 * pin.number) & 3 == 0
    }

    /// Level of an output pin; none if the pin is not an output.
    pub fn output(&self, pin: Pin) -> Option<bool> {
        let odr = self.words[usize::from(pin.port)][ODR / 4];
        (self.mode(pin) == Mode::Output).then_some(odr >> pin.number & 1 != 0)
    }

    /// The pins connected to inputs 1 and 2 of `timer`; the first in the table has priority.
    pub fn timer_inputs(&self, timer: usize) -> [Option<Pin>; 2] {
        [1, 2].map(|channel| {
            let fits = |row: &&(usize, usize, u8, Pin)| {
                row.0 == timer && row.1 == channel && self.mode(row.3) == Mode::Alternate(row.2)
            };
            TIMER_INPUTS.iter().find(fits).map(|row| row.3)
        })
    }

    /// Reads a register; `external` gives the levels that IDR shows.
    pub fn read(&self, port: usize, offset: u32, external: &External) -> u32 {
        match offset as usize {
            IDR => (0..16).fold(0, |word, number| {
                let pin = Pin {
                    port: port as u8,
                    number,
                };
                word | u32::from(self.level(pin, external)) << number
            }),
            BSRR => 0,
            offset => self.words[port].get(offset / 4).copied().unwrap_or(0),
        }
    }

    fn level(&self, pin: Pin, external: &External) -> bool {
        let (port, number) = (usize::from(pin.port), usize::from(pin.number));
        let pulled_up = self.words[port][PUPDR / 4] >> (2 * number) & 3 == 1;
        match self.mode(pin) {
            Mode::Analog => false,
            _ => self
                .output(pin)
                .or(external.levels[port][number])
                .unwrap_or(pulled_up),
        }
    }

    /// Writes a register.
    pub fn write(&mut self, port: usize, offset: u32, value: u32) {
        let words = &mut self.words[port];
        match offset as usize {
            IDR | LCKR => {}
            BSRR => words[ODR / 4] = words[ODR / 4] & !(value >> 16) | value & 0xffff,
            offset if offset / 4 < words.len() => words[offset / 4] = value,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reset_values_are_those_of_the_manual() {
        let (gpio, external) = (Gpio::default(), External::default());
        assert_eq!(gpio.read(0, 0, &external), 0xa800_0000);
        assert_eq!(gpio.read(1, 0, &external), 0x280);
        assert_eq!(gpio.mode(pin('C', 3)), Mode::Input);
        assert_eq!(gpio.mode(pin('A', 13)), Mode::Alternate(0));
    }

    #[test]
    fn bsrr_sets_before_it_clears() {
        let (mut gpio, external) = (Gpio::default(), External::default());
        gpio.write(2, BSRR as u32, 0x0003_0001);
        assert_eq!(gpio.read(2, ODR as u32, &external), 1);
    }

    #[test]
    fn timer_inputs_need_the_right_function() {
        let mut gpio = Gpio::default();
        gpio.write(0, MODER as u32, 0b1010);
        gpio.write(0, AFRL as u32, 0x22);
        assert_eq!(gpio.timer_inputs(5), [Some(pin('A', 0)), Some(pin('A', 1))]);
        assert_eq!(gpio.timer_inputs(2), [None, None]);
        gpio.write(0, AFRL as u32, 0x12);
        assert_eq!(gpio.timer_inputs(5), [Some(pin('A', 0)), None]);
        assert_eq!(gpio.timer_inputs(2), [None, Some(pin('A', 1))]);
    }

    #[test]
    fn input_shows_the_external_level_or_its_pull_up() {
        let (mut gpio, mut external) = (Gpio::default(), External::default());
        gpio.write(2, PUPDR as u32, 1 << 26);
        assert_eq!(gpio.read(2, IDR as u32, &external), 1 << 13);
        external.levels[2][13] = Some(false);
        assert_eq!(gpio.read(2, IDR as u32, &external), 0);
        gpio.write(2, MODER as u32, 3 << 26);
        external.levels[2][13] = Some(true);
        assert_eq!(gpio.read(2, IDR as u32, &external), 0, "analog pins read 0");
    }
}

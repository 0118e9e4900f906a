//! SPI2 and SPI3 as masters (RM0383 chapter 20), and the MCP4922 at SPI2 (datasheet DS22250).

use crate::adc::VREF_VOLTS;
use crate::errors::Context;
use crate::time::{NEVER, Time, UNITS_PER_S};

const MSTR: u32 = 1 << 2;
const SPE: u32 = 1 << 6;
const DFF: u32 = 1 << 11;
const RXNE: u32 = 1;
const TXE: u32 = 2;
const OVR: u32 = 1 << 6;
const BSY: u32 = 1 << 7;

/// The registers. Words take their time; there is no second one in the buffer.
pub struct Spi {
    name: &'static str,
    cr1: u32,
    cr2: u32,
    unit: Time,
    /// End of the word on the wire.
    done_at: Time,
    received: bool,
    overrun: bool,
    /// The word that MISO sends.
    pub reply: u32,
}

impl Spi {
    /// The state after a reset, on a bus with this period.
    pub fn new(name: &'static str, unit: Time) -> Spi {
        Spi {
            name,
            cr1: 0,
            cr2: 0,
            unit,
            done_at: NEVER,
            received: false,
            overrun: false,
            reply: 0,
        }
    }

    /// Sets the period of the bus.
    pub fn set_clock(&mut self, unit: Time) {
        self.unit = unit;
    }

    /// Period of SCK.
    fn clock(&self) -> Time {
        self.unit << (1 + (self.cr1 >> 3 & 7))
    }

    /// Frequency of SCK \[Hz\].
    pub fn clock_hz(&self) -> u64 {
        UNITS_PER_S / self.clock()
    }

    /// Polarity and phase, as the number of the mode.
    pub fn mode(&self) -> u32 {
        (self.cr1 & 2) | (self.cr1 & 1)
    }

    fn update(&mut self, now: Time) {
        if self.done_at <= now {
            self.done_at = NEVER;
            self.overrun |= self.received;
            self.received = true;
        }
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now: Time) -> u32 {
        self.update(now);
        let busy = self.done_at != NEVER;
        match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => {
                let flags = [
                    (self.received, RXNE),
                    (!busy, TXE),
                    (self.overrun, OVR),
                    (busy, BSY),
                ];
                flags
                    .iter()
                    .filter(|(on, _)| *on)
                    .map(|(_, flag)| flag)
                    .sum()
            }
            0x0c => {
                self.received = false;
                self.reply
            }
            _ => 0,
        }
    }

    /// Writes a register; returns the word that goes out, and its bits.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) -> Option<(u32, u32)> {
        self.update(cx.now);
        match offset {
            0x00 => self.cr1 = value,
            0x04 => self.cr2 = value,
            0x0c if self.cr1 & (SPE | MSTR) != SPE | MSTR => {
                cx.error(format!(
                    "{}: data written while it is not a master that is on",
                    self.name
                ));
            }
            0x0c if self.done_at != NEVER => {
                cx.error(format!("{}: data written while a word is sent", self.name));
            }
            0x0c => {
                let bits = if self.cr1 & DFF != 0 { 16 } else { 8 };
                self.done_at = cx.now + self.clock() * Time::from(bits);
                return Some((value & ((1 << bits) - 1), bits));
            }
            _ => {}
        }
        None
    }
}

/// The converter. A reset of the chip does not reset it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mcp4922 {
    selected: bool,
    shift: u32,
    bits: u32,
    /// The last complete word for channel A.
    word: u32,
}

impl Mcp4922 {
    /// Takes bits from SDI, if they arrive and CS is low.
    pub fn shift(&mut self, word: u32, bits: u32) {
        if self.selected {
            self.shift = self.shift << bits | word;
            self.bits += bits;
        }
    }

    /// Takes the level of CS: a word of sixteen bits counts when it rises, as LDAC is low.
    pub fn select(&mut self, low: bool) {
        if low && !self.selected {
            (self.shift, self.bits) = (0, 0);
        }
        if !low && self.selected && self.bits == 16 && self.shift >> 15 == 0 {
            self.word = self.shift;
        }
        self.selected = low;
    }

    /// Voltage of channel A; none if it is shut down by its word or by SHDN, which has a pull-down.
    pub fn volts(&self, shutdown: Option<bool>) -> Option<f64> {
        let active = self.word & 1 << 12 != 0 && shutdown == Some(true);
        let gain = if self.word & 1 << 13 != 0 { 1.0 } else { 2.0 };
        let volts = f64::from(self.word & 0xfff) / 4096.0 * VREF_VOLTS * gain;
        active.then_some(volts.min(VREF_VOLTS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    #[test]
    fn word_of_sixteen_bits_counts_when_select_rises() {
        let mut converter = Mcp4922::default();
        converter.shift(0x38, 8);
        converter.select(true);
        converter.shift(0x38, 8);
        converter.shift(0x00, 8);
        assert_eq!(converter.volts(Some(true)), None);
        converter.select(false);
        assert_eq!(converter.volts(Some(true)), Some(1.65));
        assert_eq!(
            [None, Some(false)].map(|low| converter.volts(low)),
            [None; 2]
        );
        converter.select(true);
        converter.shift(0x30, 8);
        converter.select(false);
        assert_eq!(converter.volts(Some(true)), Some(1.65), "a word cut short");
    }

    #[test]
    fn word_takes_its_time_and_a_second_one_too_early_is_an_error() {
        let (mut spi, mut errors) = (Spi::new("SPI2", 10), Errors::default());
        spi.write(0, SPE | MSTR | 1 << 3, &mut test_context(&mut errors, 0));
        let out = spi.write(0x0c, 0x1aa, &mut test_context(&mut errors, 0));
        assert_eq!(out, Some((0xaa, 8)));
        assert_eq!(spi.read(8, 319), BSY);
        assert_eq!(
            spi.write(0x0c, 1, &mut test_context(&mut errors, 319)),
            None
        );
        assert_eq!(errors.list.len(), 1);
        assert_eq!(spi.read(8, 320), TXE | RXNE);
        assert_eq!(spi.clock_hz(), UNITS_PER_S / 40);
        spi.read(0x0c, 320);
        assert_eq!(spi.read(8, 320), TXE);
    }
}

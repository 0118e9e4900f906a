//! DAC1 and DAC2: holding and output registers, triggers, output buffer (RM0390 chapter 14).

use crate::adc::VREF_VOLTS;
use crate::errors::Context;

/// Distance of the buffered output from the rails (datasheet, DAC_OUT min and max with buffer).
const BUFFER_RAIL_VOLTS: f64 = 0.2;

/// Both channels.
#[derive(Default)]
pub struct Dac {
    cr: u32,
    dhr: [u32; 2],
    dor: [u32; 2],
}

/// Timer of a TSEL code; 0 if it is not modelled.
fn trigger_timer(tsel: u32) -> usize {
    [6, 0, 7, 5, 2, 4, 0, 0][tsel as usize & 7]
}

impl Dac {
    fn field(&self, channel: usize, shift: u32, mask: u32) -> u32 {
        self.cr >> (16 * channel as u32 + shift) & mask
    }

    /// Voltage of a channel (0 or 1); none while the channel is disabled.
    pub fn volts(&self, channel: usize) -> Option<f64> {
        if self.field(channel, 0, 1) == 0 {
            return None;
        }
        let volts = f64::from(self.dor[channel]) * VREF_VOLTS / 4095.0;
        let buffered = self.field(channel, 1, 1) == 0;
        let rail = if buffered { BUFFER_RAIL_VOLTS } else { 0.0 };
        Some(volts.clamp(rail, VREF_VOLTS - rail))
    }

    /// Handles an edge on the trigger output of a timer.
    pub fn trigger(&mut self, timer: usize) {
        for channel in 0..2 {
            let waits = self.field(channel, 2, 1) != 0;
            if waits && trigger_timer(self.field(channel, 3, 7)) == timer {
                self.dor[channel] = self.dhr[channel];
            }
        }
    }

    fn hold(&mut self, channel: usize, value: u32) {
        self.dhr[channel] = value & 0xfff;
        if self.field(channel, 2, 1) == 0 {
            self.dor[channel] = self.dhr[channel];
        }
    }

    /// Reads a register.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.cr,
            0x08 | 0x14 => self.dhr[(offset == 0x14) as usize],
            0x0c | 0x18 => self.dhr[(offset == 0x18) as usize] << 4,
            0x10 | 0x1c => self.dhr[(offset == 0x1c) as usize] >> 4,
            0x20 => self.dhr[0] | self.dhr[1] << 16,
            0x2c => self.dor[0],
            0x30 => self.dor[1],
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) {
        match offset {
            0x00 => {
                self.cr = value;
                for channel in 0..2 {
                    let [wave, dma] = [(6, 3), (12, 1)].map(|(s, m)| self.field(channel, s, m));
                    if wave | dma != 0 {
                        cx.error("model: the DAC has no wave generation and no DMA requests");
                    }
                }
            }
            0x04 => {
                for channel in 0..2 {
                    let software = self.field(channel, 2, 1) != 0 && self.field(channel, 3, 7) == 7;
                    if value >> channel & 1 != 0 && software {
                        self.dor[channel] = self.dhr[channel];
                    }
                }
            }
            0x08 | 0x14 => self.hold((offset == 0x14) as usize, value),
            0x0c | 0x18 => self.hold((offset == 0x18) as usize, value >> 4),
            0x10 | 0x1c => self.hold((offset == 0x1c) as usize, (value & 0xff) << 4),
            0x20 => {
                self.hold(0, value);
                self.hold(1, value >> 16);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    fn write(dac: &mut Dac, offset: u32, value: u32) {
        dac.write(offset, value, &mut test_context(&mut Errors::default(), 0));
    }

    #[test]
    fn drives_only_while_enabled() {
        let mut dac = Dac::default();
        write(&mut dac, 0x08, 1365);
        assert_eq!(dac.volts(0), None);
        write(&mut dac, 0, 1);
        assert_eq!(dac.volts(0), Some(1.1));
        assert_eq!(dac.volts(1), None);
    }

    #[test]
    fn buffer_does_not_reach_the_rails() {
        let mut dac = Dac::default();
        write(&mut dac, 0, 1 | 3 << 16);
        assert_eq!(dac.volts(0), Some(0.2));
        assert_eq!(dac.volts(1), Some(0.0));
        write(&mut dac, 0x20, 0x0fff_0fff);
        assert_eq!(dac.volts(0), Some(VREF_VOLTS - 0.2));
        assert_eq!(dac.volts(1), Some(VREF_VOLTS));
    }

    #[test]
    fn triggered_channel_changes_only_on_its_trigger() {
        let mut dac = Dac::default();
        write(&mut dac, 0, 1 | 1 << 2 | 4 << 3);
        write(&mut dac, 0x08, 1000);
        dac.trigger(6);
        assert_eq!(dac.read(0x2c), 0);
        dac.trigger(2);
        assert_eq!(dac.read(0x2c), 1000);
    }

    #[test]
    fn alignments_write_the_same_register() {
        let mut dac = Dac::default();
        write(&mut dac, 0x0c, 0x1230);
        assert_eq!(dac.read(0x08), 0x123);
        write(&mut dac, 0x10, 0x45);
        assert_eq!(dac.read(0x08), 0x450);
    }
}

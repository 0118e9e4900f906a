//! ADC1: regular conversions, scan, external trigger, DMA, overrun (RM0390 chapter 13).

use crate::errors::Context;
use crate::flash::mix;
use crate::time::{NEVER, Time};

const EOC: u32 = 1 << 1;
const STRT: u32 = 1 << 4;
const OVR: u32 = 1 << 5;
const EOCIE: u32 = 1 << 5;
const SCAN: u32 = 1 << 8;
const OVRIE: u32 = 1 << 26;
const ADON: u32 = 1;
const CONT: u32 = 1 << 1;
const DMA: u32 = 1 << 8;
const DDS: u32 = 1 << 9;
const EOCS: u32 = 1 << 10;
const ALIGN: u32 = 1 << 11;
const JSWSTART: u32 = 1 << 22;
const SWSTART: u32 = 1 << 30;
/// Reference voltage \[V\].
pub const VREF_VOLTS: f64 = 3.3;
/// The internal reference, channel 17 \[V\].
pub const VREFINT_VOLTS: f64 = 1.21;

/// The converter's sampling capacitor is charged through this: 6 kΩ, 7 pF (datasheet, maxima).
const SAMPLING_TAU_S: f64 = 6e3 * 7e-12;
/// The internal channels need to be sampled for so long \[s\].
const INTERNAL_SAMPLING_S: f64 = 10e-6;

/// How the converter differs from an ideal one; resets of the chip do not change it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Imperfection {
    /// Offset \[counts\].
    pub offset_counts: f64,
    /// Each conversion is off by up to this, either way \[counts\].
    pub noise_counts: f64,
    /// Voltage of the reference, which is the supply \[V\].
    pub vref_volts: f64,
}

impl Default for Imperfection {
    fn default() -> Imperfection {
        Imperfection {
            offset_counts: 0.0,
            noise_counts: 0.0,
            vref_volts: VREF_VOLTS,
        }
    }
}

/// Source of a trigger edge: timer number, and its channel or `None` for TRGO.
pub type Trigger = (usize, Option<usize>);

/// Decodes EXTSEL of the regular group; `None` for timers that are not modelled.
fn trigger_source(extsel: u32) -> Option<Trigger> {
    Some(match extsel {
        3 => (2, Some(2)),
        4 => (2, Some(3)),
        5 => (2, Some(4)),
        6 => (2, None),
        7 => (3, Some(1)),
        8 => (3, None),
        9 => (4, Some(4)),
        10 => (5, Some(1)),
        11 => (5, Some(2)),
        12 => (5, Some(3)),
        _ => return None,
    })
}

/// The converter.
#[derive(Default)]
pub struct Adc {
    sr: u32,
    cr1: u32,
    cr2: u32,
    smpr: [u32; 2],
    sqr: [u32; 3],
    dr: u32,
    ccr: u32,
    /// Duration of one clock of APB2.
    pclk2: Time,
    /// Rank of the conversion in progress, and when it ends.
    running: Option<(u32, Time)>,
    /// True while a value waits for the DMA.
    pub wants_dma: bool,
    /// The stream has moved its last item and DDS is off.
    dma_ended: bool,
    /// Voltage of the sampling capacitor.
    held_volts: f64,
    /// State of the noise.
    seed: u64,
}

impl Adc {
    /// The state after a reset.
    pub fn new(pclk2: Time) -> Adc {
        Adc {
            pclk2,
            ..Adc::default()
        }
    }

    /// Sets the clock of the bus, which applies from the next conversion.
    pub fn set_clock(&mut self, pclk2: Time) {
        self.pclk2 = pclk2;
    }

    /// Time at which the conversion in progress ends.
    pub fn next(&self) -> Time {
        self.running.map_or(NEVER, |(_, done_at)| done_at)
    }

    /// Level of the interrupt line.
    pub fn irq(&self) -> bool {
        self.sr & EOC != 0 && self.cr1 & EOCIE != 0 || self.sr & OVR != 0 && self.cr1 & OVRIE != 0
    }

    /// Channel of the conversion in progress.
    pub fn channel(&self) -> u32 {
        let rank = self.running.map_or(0, |(rank, _)| rank);
        self.sqr[2 - (rank / 6) as usize] >> (5 * (rank % 6)) & 31
    }

    /// Whether VREFINT and the temperature sensor are connected to their channels.
    pub fn internal_channels(&self) -> bool {
        self.ccr & 1 << 23 != 0
    }

    fn adcclk(&self) -> Time {
        self.pclk2 * (2 * (u64::from(self.ccr >> 16 & 3) + 1))
    }

    fn sampling_time(&self, channel: u32) -> Time {
        let code = match channel {
            0..=9 => self.smpr[1] >> (3 * channel),
            _ => self.smpr[0] >> (3 * (channel - 10)),
        };
        self.adcclk() * [3, 15, 28, 56, 84, 112, 144, 480][(code & 7) as usize]
    }

    fn conversion_time(&self, channel: u32) -> Time {
        let bits = 12 - 2 * u64::from(self.cr1 >> 24 & 3);
        self.sampling_time(channel) + self.adcclk() * bits
    }

    /// Charges the sampling capacitor, from what it held of the channel before.
    fn sample(&mut self, volts: f64, cx: &mut Context) -> f64 {
        let channel = self.channel();
        let sampled_s = self.sampling_time(channel) as f64 / crate::time::UNITS_PER_S as f64;
        if channel > 15 && sampled_s < INTERNAL_SAMPLING_S {
            cx.error(format!(
                "ADC1: channel {channel} is sampled for less than 10 µs"
            ));
        }
        let left = (-sampled_s / SAMPLING_TAU_S).exp();
        self.held_volts = volts + (self.held_volts - volts) * left;
        self.held_volts
    }

    fn begin(&mut self, rank: u32, now: Time) {
        self.running = Some((rank, now));
        let done_at = now + self.conversion_time(self.channel());
        self.running = Some((rank, done_at));
    }

    /// Starts a sequence, by software or by a trigger.
    fn start(&mut self, cx: &mut Context) {
        if self.cr2 & ADON == 0 {
            return cx.error("ADC1: started while off");
        }
        if self.sr & OVR != 0 {
            return cx.error("ADC1: trigger ignored, an overrun is not cleared");
        }
        if self.running.is_some() {
            return cx.error("ADC1: trigger ignored, a conversion is in progress");
        }
        // 36 MHz is the limit at this supply
        if crate::time::UNITS_PER_S > 36_000_000 * self.adcclk() {
            cx.error("ADC1: clock above 36 MHz");
        }
        self.sr |= STRT;
        self.begin(0, cx.now);
    }

    /// Handles an edge from `source`: starts a sequence if it is the selected trigger.
    pub fn trigger(&mut self, source: Trigger, cx: &mut Context) {
        let enabled = self.cr2 >> 28 & 3 != 0;
        if enabled && trigger_source(self.cr2 >> 24 & 15) == Some(source) {
            self.start(cx);
        }
    }

    /// Completes the conversion of a voltage.
    pub fn finish(&mut self, volts: f64, imperfection: &Imperfection, cx: &mut Context) {
        let now = cx.now;
        if self.running.is_none() {
            return;
        }
        let volts = self.sample(volts, cx);
        let Some((rank, _)) = self.running.take() else {
            return;
        };
        let bits = 12 - 2 * (self.cr1 >> 24 & 3);
        let full = f64::from((1 << bits) - 1);
        // Uniform between -1 and 1.
        let noise = (mix(&mut self.seed) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
        let off = imperfection.offset_counts + imperfection.noise_counts * noise;
        let code = volts / imperfection.vref_volts * full + off;
        let code = code.round().clamp(0.0, full) as u32;
        let tracked = self.cr2 & (DMA | EOCS) != 0;
        if tracked && (self.sr & EOC != 0 && self.cr2 & DMA == 0 || self.wants_dma) {
            self.sr |= OVR;
            self.wants_dma = false;
            return;
        }
        self.dr = if self.cr2 & ALIGN != 0 {
            code << (16 - bits)
        } else {
            code
        };
        let last = self.cr1 & SCAN == 0 || rank == self.sqr[0] >> 20 & 15;
        if last || self.cr2 & EOCS != 0 {
            self.sr |= EOC;
        }
        self.wants_dma = self.cr2 & DMA != 0 && !self.dma_ended;
        if !last {
            self.begin(rank + 1, now);
        } else if self.cr2 & CONT != 0 {
            self.begin(0, now);
        }
    }

    /// The stream has moved its last item: without DDS no more requests follow.
    pub fn stream_ended(&mut self) {
        self.dma_ended = self.cr2 & DDS == 0;
    }

    /// Reads a register; reading DR clears EOC.
    pub fn read(&mut self, offset: u32) -> u32 {
        match offset {
            0x00 => self.sr,
            0x04 => self.cr1,
            0x08 => self.cr2,
            0x0c | 0x10 => self.smpr[(offset as usize - 0x0c) / 4],
            0x2c..=0x34 => self.sqr[(offset as usize - 0x2c) / 4],
            0x4c => {
                self.sr &= !EOC;
                self.wants_dma = false;
                self.dr
            }
            0x300 => self.sr & 0x3f,
            0x304 => self.ccr,
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) {
        match offset {
            0x00 => self.sr &= value,
            0x04 => {
                self.cr1 = value;
                if value & (1 << 23 | 1 << 22 | 1 << 11 | 1 << 12 | 1 << 10) != 0 {
                    cx.error(
                        "model: ADC1 has no analog watchdog, no discontinuous or injected mode",
                    );
                }
            }
            0x08 => self.control(value, cx),
            0x0c | 0x10 => self.smpr[(offset as usize - 0x0c) / 4] = value,
            0x2c..=0x34 => self.sqr[(offset as usize - 0x2c) / 4] = value,
            0x304 => self.ccr = value,
            _ => {}
        }
    }

    fn control(&mut self, value: u32, cx: &mut Context) {
        let old = self.cr2;
        self.cr2 = value & !(SWSTART | JSWSTART);
        if value & ADON == 0 {
            self.running = None;
        }
        if value & !old & DMA != 0 {
            self.dma_ended = false;
        }
        if value >> 28 & 3 != 0 && trigger_source(value >> 24 & 15).is_none() {
            cx.error("model: ADC1 is triggered by an event that is not modelled");
        }
        if value & JSWSTART != 0 {
            cx.error("model: ADC1 has no injected conversions");
        }
        if value & SWSTART != 0 {
            self.start(cx);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    /// One clock of 90 MHz.
    const PCLK2: Time = 560;

    fn adc(writes: &[(u32, u32)]) -> (Adc, Errors) {
        let (mut adc, mut errors) = (Adc::new(PCLK2), Errors::default());
        // All channels are sampled for 84 clocks.
        let sampling = [(0x0c, 0x0492_4924), (0x10, 0x2492_4924)];
        let on = [(0x304, 1 << 16), (0x08, ADON), sampling[0], sampling[1]];
        for (offset, value) in on.iter().chain(writes) {
            adc.write(*offset, *value, &mut test_context(&mut errors, 0));
        }
        (adc, errors)
    }

    const LATER: Time = 1_000_000;

    fn write(adc: &mut Adc, offset: u32, value: u32) -> Vec<String> {
        let mut errors = Errors::default();
        adc.write(offset, value, &mut test_context(&mut errors, LATER));
        errors.list.into_iter().map(|e| e.text).collect()
    }

    fn finish(adc: &mut Adc, volts: f64) {
        let mut errors = Errors::default();
        let now = adc.next().min(LATER);
        adc.finish(
            volts,
            &Imperfection::default(),
            &mut test_context(&mut errors, now),
        );
        assert!(errors.list.is_empty(), "{:?}", errors.list);
    }

    /// 84 clocks of 22.5 MHz are 89 time constants; 3 are 3.2, which leave 4 % of the difference.
    #[test]
    fn short_sampling_leaves_part_of_the_channel_before() {
        for (code, expected) in [(4, [4095, 0]), (0, [3924, 164])] {
            let (mut adc, _) = adc(&[(0x04, SCAN), (0x2c, 1 << 20), (0x34, 1 | 2 << 5)]);
            write(&mut adc, 0x10, code << 3 | code << 6);
            write(&mut adc, 0x08, ADON | DMA | DDS | SWSTART);
            let codes = [3.3, 0.0].map(|volts| {
                finish(&mut adc, volts);
                adc.read(0x4c)
            });
            assert_eq!(codes, expected);
        }
    }

    #[test]
    fn imperfect_converter_is_off_by_its_offset_noise_and_reference() {
        let imperfect = Imperfection {
            offset_counts: 5.0,
            noise_counts: 20.0,
            vref_volts: 3.0,
        };
        let (mut adc, mut errors) = adc(&[(0x10, 4)]);
        let codes: Vec<u32> = (0..400)
            .map(|_| {
                write(&mut adc, 0x08, ADON | SWSTART);
                adc.finish(1.5, &imperfect, &mut test_context(&mut errors, LATER));
                adc.read(0x4c)
            })
            .collect();
        let mean = codes.iter().sum::<u32>() as f64 / 400.0;
        // The noise's standard deviation is 20/√3 counts, that of the mean 0.6 counts.
        assert!((mean - 2052.5).abs() < 2.0, "{mean}");
        assert!(codes.iter().all(|code| (2032..=2073).contains(code)));
        assert!(codes.iter().any(|code| *code < 2036) && codes.iter().any(|code| *code > 2069));
    }

    #[test]
    fn conversion_takes_sampling_plus_twelve_clocks() {
        let (mut adc, _) = adc(&[(0x10, 4), (0x34, 0)]);
        assert!(write(&mut adc, 0x08, ADON | SWSTART).is_empty());
        assert_eq!(adc.next(), LATER + 96 * 4 * PCLK2);
        finish(&mut adc, 1.65);
        assert_eq!((adc.read(0) & EOC, adc.read(0x4c)), (EOC, 2048));
        assert_eq!(adc.read(0) & EOC, 0);
    }

    #[test]
    fn full_scale_does_not_overflow() {
        for (volts, code) in [
            (3.3, 4095),
            (9.0, 4095),
            (-1.0, 0),
            (0.0004, 0),
            (0.0005, 1),
        ] {
            let (mut adc, _) = adc(&[]);
            write(&mut adc, 0x08, ADON | SWSTART);
            finish(&mut adc, volts);
            assert_eq!(adc.read(0x4c), code, "{volts} V");
        }
    }

    #[test]
    fn scan_converts_the_ranks_in_order_and_requests_dma_for_each() {
        let (mut adc, _) = adc(&[(0x04, SCAN), (0x2c, 1 << 20), (0x34, 10 | 11 << 5)]);
        write(&mut adc, 0x08, ADON | DMA | DDS | SWSTART);
        assert_eq!(adc.channel(), 10);
        finish(&mut adc, 1.0);
        assert_eq!(
            (adc.channel(), adc.wants_dma, adc.read(0) & EOC),
            (11, true, 0)
        );
        assert_eq!(adc.read(0x4c), 1241);
        finish(&mut adc, 2.0);
        assert_eq!((adc.next(), adc.read(0) & EOC), (NEVER, EOC));
    }

    #[test]
    fn value_that_was_not_read_causes_an_overrun() {
        let (mut adc, _) = adc(&[(0x04, SCAN), (0x2c, 1 << 20)]);
        write(&mut adc, 0x08, ADON | DMA | SWSTART);
        finish(&mut adc, 1.0);
        finish(&mut adc, 1.0);
        assert_ne!(adc.read(0) & OVR, 0);
        assert_eq!(write(&mut adc, 0x08, ADON | DMA | SWSTART).len(), 1);
    }

    #[test]
    fn only_the_selected_trigger_starts_a_sequence() {
        let (mut adc, mut errors) = adc(&[(0x08, ADON | 1 << 28 | 8 << 24)]);
        adc.trigger((2, None), &mut test_context(&mut errors, LATER));
        assert_eq!(adc.next(), NEVER);
        adc.trigger((3, None), &mut test_context(&mut errors, LATER));
        assert_ne!(adc.next(), NEVER);
        assert!(errors.list.is_empty());
    }

    #[test]
    fn errors_of_use_are_reported() {
        let (mut off, _) = adc(&[(0x08, 0)]);
        assert_eq!(write(&mut off, 0x08, SWSTART), ["ADC1: started while off"]);
        let (mut fast, _) = adc(&[(0x304, 0)]);
        assert_eq!(
            write(&mut fast, 0x08, ADON | SWSTART),
            ["ADC1: clock above 36 MHz"]
        );
    }
}

//! TIM2 to TIM7: up-counting with prescaler, compare events, encoder mode, trigger output
//! (RM0390 chapters 17 and 19). Times are exact, without rounding.

use crate::errors::Context;
use crate::time::{NEVER, Time};

const CEN: u32 = 1;
const UDIS: u32 = 2;
const URS: u32 = 4;
const OPM: u32 = 8;
const DIR: u32 = 0x10;
const ARPE: u32 = 0x80;
const UIF: u32 = 1;

/// Output edges of a timer at one time.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug)]
pub struct Pulses {
    /// An edge on the trigger output.
    pub trgo: bool,
    /// Bit n: channel n + 1 matched and its output is enabled.
    pub compare: u8,
}

/// One timer.
pub struct Tim {
    number: usize,
    /// Duration of one clock of the timer.
    clock: Time,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    ccr: [u32; 4],
    psc: u32,
    arr: u32,
    /// The values in force, loaded by the last update event.
    psc_now: u32,
    arr_now: u32,
    /// The count at the time `since`.
    count: u32,
    since: Time,
    update_at: Time,
    compare_at: [Time; 4],
}

impl Tim {
    /// Timer `number` (2 to 7) in the state after a reset.
    pub fn new(number: usize, clock: Time) -> Tim {
        let mut tim = Tim {
            number,
            clock,
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            ccr: [0; 4],
            psc: 0,
            arr: 0,
            psc_now: 0,
            arr_now: 0,
            count: 0,
            since: 0,
            update_at: NEVER,
            compare_at: [NEVER; 4],
        };
        tim.arr = tim.mask();
        tim.arr_now = tim.arr;
        tim
    }

    /// Maximum count: TIM2 and TIM5 are 32 bits wide, the others 16.
    fn mask(&self) -> u32 {
        if matches!(self.number, 2 | 5) {
            u32::MAX
        } else {
            0xffff
        }
    }

    fn is_basic(&self) -> bool {
        self.number >= 6
    }

    fn is_encoder(&self) -> bool {
        matches!(self.smcr & 7, 1..=3)
    }

    fn runs(&self) -> bool {
        self.cr1 & CEN != 0 && !self.is_encoder() && self.arr_now != 0
    }

    fn step(&self) -> Time {
        self.clock * (Time::from(self.psc_now) + 1)
    }

    /// Counts until the counter wraps: at ARR, or at its full width if it is above ARR.
    fn to_wrap(&self) -> u64 {
        let top = if self.count > self.arr_now {
            self.mask()
        } else {
            self.arr_now
        };
        u64::from(top - self.count) + 1
    }

    /// The counter at `now`.
    pub fn counter(&self, now: Time) -> u32 {
        let steps = if self.runs() {
            (now - self.since) / self.step()
        } else {
            0
        };
        // a due update event has been executed before, so that the count does not wrap here
        self.count.wrapping_add(steps as u32) & self.mask()
    }

    /// Sets the clock.
    pub fn set_clock(&mut self, now: Time, clock: Time) {
        self.rebase(now);
        self.clock = clock;
        self.since = now;
        self.plan();
    }

    /// Moves `since` to the last count before `now`.
    fn rebase(&mut self, now: Time) {
        let count = self.counter(now);
        self.since = if self.runs() {
            now - (now - self.since) % self.step()
        } else {
            now
        };
        self.count = count;
    }

    fn plan(&mut self) {
        self.update_at = NEVER;
        self.compare_at = [NEVER; 4];
        if !self.runs() {
            return;
        }
        self.update_at = self.since + self.to_wrap() * self.step();
        for channel in 0..4 {
            let ccr = self.ccr[channel];
            if self.watches(channel) && ccr > self.count && ccr <= self.arr_now {
                self.compare_at[channel] = self.since + u64::from(ccr - self.count) * self.step();
            }
        }
    }

    /// Whether a compare event of `channel` has an effect.
    fn watches(&self, channel: usize) -> bool {
        let used_as_trgo = match self.cr2 >> 4 & 7 {
            3 => channel == 0,
            mms => mms >= 4 && channel == mms as usize - 4,
        };
        self.dier >> (1 + channel) & 1 != 0 || self.ccer >> (4 * channel) & 1 != 0 || used_as_trgo
    }

    /// Time of the next event.
    pub fn next(&self) -> Time {
        self.compare_at
            .iter()
            .fold(self.update_at, |next, at| next.min(*at))
    }

    /// Level of the interrupt line.
    pub fn irq(&self) -> bool {
        self.sr & self.dier & 0x1f != 0
    }

    /// Executes the events that are due.
    pub fn fire(&mut self, now: Time) -> Pulses {
        let mut pulses = Pulses::default();
        for channel in 0..4 {
            if self.compare_at[channel] <= now {
                self.compare_at[channel] = NEVER;
                self.matched(channel, &mut pulses);
            }
        }
        if self.update_at <= now {
            let wrapped_beyond = self.count > self.arr_now;
            (self.since, self.count) = (self.update_at, 0);
            if !wrapped_beyond {
                self.update(true, &mut pulses);
            }
            self.plan();
        }
        pulses
    }

    /// Whether the output rises at the update event: in PWM mode 1 it is active until the match.
    fn rises_at_update(&self, channel: usize) -> bool {
        self.ccmr[channel / 2] >> (8 * (channel % 2) + 4) & 7 == 6
    }

    fn matched(&mut self, channel: usize, pulses: &mut Pulses) {
        self.sr |= 2 << channel;
        if !self.rises_at_update(channel) {
            self.output_edge(channel, pulses);
        }
        pulses.trgo |= self.cr2 >> 4 & 7 == 3 && channel == 0;
    }

    fn output_edge(&self, channel: usize, pulses: &mut Pulses) {
        if self.ccer >> (4 * channel) & 1 != 0 {
            pulses.compare |= 1 << channel;
        }
        let mms = self.cr2 >> 4 & 7;
        pulses.trgo |= mms >= 4 && mms as usize - 4 == channel;
    }

    /// Executes an update event, caused by overflow or by UG.
    fn update(&mut self, overflow: bool, pulses: &mut Pulses) {
        if self.cr1 & UDIS == 0 {
            self.psc_now = self.psc;
            self.arr_now = self.arr;
            if overflow || self.cr1 & URS == 0 {
                self.sr |= UIF;
            }
            pulses.trgo |= self.cr2 >> 4 & 7 == 2;
        }
        if overflow && self.cr1 & OPM != 0 {
            self.cr1 &= !CEN;
        }
        pulses.trgo |= !overflow && self.cr2 >> 4 & 7 == 0;
        for channel in 0..4 {
            if overflow && self.watches(channel) {
                if self.ccr[channel] == 0 {
                    self.matched(channel, pulses);
                }
                if self.rises_at_update(channel) && self.ccr[channel] > 0 {
                    self.output_edge(channel, pulses);
                }
            }
        }
    }

    /// Moves the counter by `delta` edges of a quadrature signal on inputs 1 and 2.
    pub fn encoder_edges(&mut self, delta: i64) {
        if self.cr1 & CEN == 0 || !self.is_encoder() || delta == 0 {
            return;
        }
        // in mode 3 edges of both inputs count, else every other edge
        let counts = if self.smcr & 7 == 3 { delta } else { delta / 2 };
        let inverted = (self.ccer >> 1 & 1) ^ (self.ccer >> 5 & 1) != 0;
        let counts = if inverted { -counts } else { counts };
        let period = i64::from(self.arr_now) + 1;
        let sum = i64::from(self.count) + counts;
        self.count = sum.rem_euclid(period) as u32;
        self.cr1 = self.cr1 & !DIR | if counts < 0 { DIR } else { 0 };
        if sum < 0 || sum >= period {
            self.sr |= UIF;
        }
    }

    /// Reads a register.
    pub fn read(&self, offset: u32, now: Time) -> u32 {
        match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x0c => self.dier,
            0x10 => self.sr,
            0x24 => self.counter(now),
            0x28 => self.psc,
            0x2c => self.arr,
            _ if self.is_basic() => 0,
            0x08 => self.smcr,
            0x18 | 0x1c => self.ccmr[(offset as usize - 0x18) / 4],
            0x20 => self.ccer,
            0x34..=0x40 => self.ccr[(offset as usize - 0x34) / 4],
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) -> Pulses {
        let mut pulses = Pulses::default();
        self.rebase(cx.now);
        match offset {
            0x00 => {
                let starts = value & !self.cr1 & CEN != 0;
                pulses.trgo = starts && self.cr2 >> 4 & 7 == 1;
                self.cr1 = value;
            }
            0x04 => self.cr2 = value,
            0x0c => self.dier = value,
            0x10 => self.sr &= value,
            0x14 if value & 1 != 0 => {
                (self.count, self.since) = (0, cx.now);
                self.update(false, &mut pulses);
            }
            0x24 => (self.count, self.since) = (value & self.mask(), cx.now),
            0x28 => self.psc = value & 0xffff,
            0x2c => {
                self.arr = value & self.mask();
                if self.cr1 & ARPE == 0 {
                    self.arr_now = self.arr;
                }
            }
            _ if self.is_basic() => {}
            0x08 => self.smcr = value,
            0x18 | 0x1c => self.ccmr[(offset as usize - 0x18) / 4] = value,
            0x20 => self.ccer = value,
            0x34..=0x40 => self.ccr[(offset as usize - 0x34) / 4] = value & self.mask(),
            _ => {}
        }
        self.check(cx);
        self.plan();
        pulses
    }

    /// Reports the use of what is not modelled.
    fn check(&self, cx: &mut Context) {
        let number = self.number;
        if self.cr1 & (0x60 | DIR) != 0 && !self.is_encoder() {
            cx.error(format!("model: TIM{number} counts up only"));
        }
        if self.smcr & 7 > 3 || self.smcr & 1 << 14 != 0 {
            cx.error(format!(
                "model: TIM{number} has no slave mode except encoder mode"
            ));
        }
        if self.dier & 0x7f00 != 0 {
            cx.error(format!("model: TIM{number} has no DMA requests"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    const CLOCK: Time = 560;

    fn timer(number: usize, writes: &[(u32, u32)]) -> Tim {
        let (mut tim, mut errors) = (Tim::new(number, CLOCK), Errors::default());
        for (offset, value) in writes {
            tim.write(*offset, *value, &mut test_context(&mut errors, 0));
        }
        assert!(errors.list.is_empty(), "{:?}", errors.list);
        tim
    }

    fn write(tim: &mut Tim, now: Time, offset: u32, value: u32) -> Pulses {
        tim.write(
            offset,
            value,
            &mut test_context(&mut Errors::default(), now),
        )
    }

    #[test]
    fn writes_do_not_shift_the_update_events() {
        // 90 MHz / 9 / 100 000 = 100 Hz
        let mut tim = timer(
            2,
            &[(0x28, 8), (0x2c, 99_999), (0x14, 1), (0x10, 0), (0x00, CEN)],
        );
        let period = CLOCK * 9 * 100_000;
        for n in 1..100 {
            assert_eq!(tim.next(), n * period);
            tim.fire(n * period);
            assert_eq!(tim.read(0x10, n * period), UIF);
            write(&mut tim, n * period + 12_345 * n, 0x10, 0);
            write(&mut tim, n * period + 77_777 * n, 0x0c, 1);
        }
    }

    #[test]
    fn prescaler_takes_effect_at_the_update() {
        let mut tim = timer(3, &[(0x2c, 9), (0x00, CEN), (0x28, 1)]);
        assert_eq!(tim.next(), 10 * CLOCK);
        tim.fire(10 * CLOCK);
        assert_eq!(tim.next(), 30 * CLOCK);
        assert_eq!(tim.counter(15 * CLOCK), 2);
    }

    #[test]
    fn urs_prevents_the_update_flag_on_ug() {
        let mut tim = timer(3, &[(0x00, URS), (0x14, 1)]);
        assert_eq!(tim.read(0x10, 0), 0);
        write(&mut tim, 0, 0x00, 0);
        write(&mut tim, 0, 0x14, 1);
        assert_eq!(tim.read(0x10, 0), UIF);
    }

    #[test]
    fn one_pulse_mode_stops_at_the_update() {
        let mut tim = timer(6, &[(0x2c, 4), (0x00, CEN | OPM)]);
        tim.fire(5 * CLOCK);
        assert_eq!((tim.next(), tim.read(0, 5 * CLOCK) & CEN), (NEVER, 0));
    }

    #[test]
    fn compare_matches_once_per_period() {
        let mut tim = timer(2, &[(0x2c, 9), (0x38, 4), (0x20, 0x10), (0x00, CEN)]);
        assert_eq!(tim.next(), 4 * CLOCK);
        assert_eq!(tim.fire(4 * CLOCK).compare, 0b10);
        assert_eq!(tim.next(), 10 * CLOCK);
        tim.fire(10 * CLOCK);
        assert_eq!(tim.next(), 14 * CLOCK);
    }

    #[test]
    fn update_is_the_trigger_output_if_selected() {
        let mut tim = timer(3, &[(0x04, 2 << 4), (0x2c, 9), (0x00, CEN)]);
        assert!(tim.fire(10 * CLOCK).trgo);
        let mut tim = timer(3, &[(0x2c, 9), (0x00, CEN)]);
        assert!(!tim.fire(10 * CLOCK).trgo);
    }

    #[test]
    fn encoder_wraps_in_both_directions_and_obeys_polarity() {
        let mut tim = timer(3, &[(0x08, 3), (0x00, CEN)]);
        tim.encoder_edges(-1);
        assert_eq!(tim.counter(0), 0xffff);
        assert_ne!(tim.read(0, 0) & DIR, 0);
        tim.encoder_edges(0x1_0002);
        assert_eq!(tim.counter(0), 1);
        write(&mut tim, 0, 0x20, 2);
        tim.encoder_edges(5);
        assert_eq!(tim.counter(0), 0xfffc);
        let mut wide = timer(5, &[(0x08, 3), (0x00, CEN)]);
        wide.encoder_edges(-1);
        assert_eq!(wide.counter(0), u32::MAX);
    }

    #[test]
    fn counter_beyond_arr_wraps_at_full_width_without_an_update() {
        let mut tim = timer(3, &[(0x24, 100), (0x2c, 9), (0x00, CEN)]);
        assert_eq!(tim.next(), (65536 - 100) * CLOCK);
        tim.fire(tim.next());
        assert_eq!(tim.read(0x10, 0), 0);
    }
}

//! RTC: write protection, initialisation and the sub-second prescaler (RM0390 chapter 22). The
//! calendar itself does not run.

use crate::errors::Context;
use crate::time::{Time, period};

const TR: u32 = 0x00;
const DR: u32 = 0x04;
const ISR: u32 = 0x0c;
const PRER: u32 = 0x10;
const WPR: u32 = 0x24;
const SSR: u32 = 0x28;
const INIT: u32 = 1 << 7;
const INITF: u32 = 1 << 6;
/// Periods of the oscillator until the registers can be initialised.
const INIT_PERIODS: Time = 2;

/// The unit. It is in the backup domain, which only loses its state without a supply.
#[derive(Clone)]
pub struct Rtc {
    /// Period of the oscillator; none if it is not connected, or stands still.
    clock: Option<Time>,
    /// The keys that have been written, of two.
    unlocked: usize,
    init: bool,
    /// Time at which the initialisation was asked for.
    init_since: Time,
    prer: u32,
    /// Periods of the oscillator up to `upto`.
    periods: u64,
    upto: Time,
}

impl Default for Rtc {
    fn default() -> Rtc {
        Rtc {
            clock: None,
            unlocked: 0,
            init: false,
            init_since: 0,
            prer: 0x007f_00ff,
            periods: 0,
            upto: 0,
        }
    }
}

impl Rtc {
    /// Connects the oscillator with this frequency, or none.
    pub fn set_clock(&mut self, now: Time, hz: Option<u64>) {
        self.advance(now);
        self.clock = hz.filter(|hz| *hz > 0).map(|hz| period(hz).0);
    }

    /// Counts up to `now`.
    fn advance(&mut self, now: Time) {
        let Some(clock) = self.clock.filter(|_| !self.init) else {
            self.upto = now;
            return;
        };
        let periods = (now - self.upto) / clock;
        self.periods += periods;
        self.upto += periods * clock;
    }

    fn may_be_initialised(&self, now: Time) -> bool {
        let ready = |clock| now >= self.init_since + INIT_PERIODS * clock;
        self.init && self.clock.is_some_and(ready)
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now: Time) -> u32 {
        self.advance(now);
        let divider = u64::from(self.prer >> 16 & 0x7f) + 1;
        let seconds_at = u64::from(self.prer & 0x7fff) + 1;
        match offset {
            ISR => {
                let initialised = u32::from(self.may_be_initialised(now)) * INITF;
                (u32::from(self.init) * INIT) | initialised
            }
            PRER => self.prer,
            SSR => (seconds_at - 1 - self.periods / divider % seconds_at) as u32,
            _ => 0,
        }
    }

    /// Writes a register; `is_open` is whether the backup domain may be written to.
    pub fn write(&mut self, offset: u32, value: u32, is_open: bool, cx: &mut Context) {
        self.advance(cx.now);
        if !is_open {
            cx.error("RTC: written without DBP: ignored");
            return;
        }
        let keys = [0xca, 0x53];
        match offset {
            WPR => {
                let next = keys
                    .get(self.unlocked)
                    .is_some_and(|key| *key == value & 0xff);
                self.unlocked = if next { self.unlocked + 1 } else { 0 };
            }
            _ if self.unlocked < keys.len() => cx.error("RTC: written without its keys: ignored"),
            ISR => {
                let init = value & INIT != 0;
                if init && !self.init {
                    self.init_since = cx.now;
                }
                self.init = init;
            }
            PRER | TR | DR if !self.may_be_initialised(cx.now) => {
                cx.error("RTC: initialised before INITF: ignored");
            }
            PRER => (self.prer, self.periods) = (value, 0),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::Errors;
    use crate::time::UNITS_PER_S;

    fn write(rtc: &mut Rtc, at: Time, writes: &[(u32, u32)]) -> usize {
        let mut errors = Errors::default();
        for (offset, value) in writes {
            let mut cx = Context {
                now: at,
                pc: 0,
                errors: &mut errors,
            };
            rtc.write(*offset, *value, true, &mut cx);
        }
        errors.list.len()
    }

    #[test]
    fn the_sub_seconds_count_down_from_the_prescaler() {
        let mut rtc = Rtc::default();
        rtc.set_clock(0, Some(32_000));
        assert_eq!(
            write(&mut rtc, 0, &[(WPR, 0xca), (WPR, 0x53), (ISR, INIT)]),
            0
        );
        assert_eq!(rtc.read(ISR, 0), INIT);
        let ready = 2 * UNITS_PER_S / 32_000;
        assert_eq!(rtc.read(ISR, ready), INIT | INITF);
        let prescaler = 31 << 16 | 0x7fff;
        assert_eq!(write(&mut rtc, ready, &[(PRER, prescaler), (ISR, 0)]), 0);
        assert_eq!(rtc.read(SSR, ready), 0x7fff);
        assert_eq!(rtc.read(SSR, ready + UNITS_PER_S), 0x7fff - 1000);
        rtc.set_clock(ready + UNITS_PER_S, Some(16_000));
        assert_eq!(rtc.read(SSR, ready + 2 * UNITS_PER_S), 0x7fff - 1500);
        assert_eq!(
            rtc.read(SSR, ready + 2 * UNITS_PER_S + 65 * UNITS_PER_S),
            0x7fff - 1232
        );
    }

    #[test]
    fn nothing_is_written_without_the_keys_or_too_early() {
        let mut rtc = Rtc::default();
        rtc.set_clock(0, Some(32_000));
        assert_eq!(write(&mut rtc, 0, &[(ISR, INIT)]), 1);
        assert_eq!(
            write(&mut rtc, 0, &[(WPR, 0xca), (WPR, 0xca), (ISR, INIT)]),
            1
        );
        assert_eq!(rtc.read(ISR, 0), 0);
        let early = [(WPR, 0xca), (WPR, 0x53), (ISR, INIT), (PRER, 0)];
        assert_eq!(write(&mut rtc, 0, &early), 1);
        assert_eq!(rtc.read(PRER, 0), 0x007f_00ff);
    }
}

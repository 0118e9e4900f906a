//! SysTick, and the cycle counter of the DWT (ARMv7-M, B3.3 and C1.8).

use crate::time::{NEVER, Time};

/// The 24-bit down-counter.
pub struct SysTick {
    csr: u32,
    reload: u32,
    cycle: Time,
    /// Time at which the counter was at `start`.
    since: Time,
    start: u32,
}

impl SysTick {
    /// The state after a reset.
    pub fn new(cycle: Time) -> SysTick {
        SysTick {
            csr: 0,
            reload: 0,
            cycle,
            since: 0,
            start: 0,
        }
    }

    fn step(&self) -> Time {
        if self.csr & 4 != 0 {
            self.cycle
        } else {
            8 * self.cycle
        }
    }

    fn runs(&self) -> bool {
        self.csr & 1 != 0
    }

    /// The counter at `now`.
    fn value(&self, now: Time) -> u32 {
        let steps = if self.runs() {
            (now - self.since) / self.step()
        } else {
            0
        };
        self.start.saturating_sub(steps as u32)
    }

    /// Time at which the counter next reaches 0.
    pub fn next(&self) -> Time {
        let stopped = !self.runs() || self.start == 0 && self.reload == 0;
        if stopped {
            NEVER
        } else {
            self.since + u64::from(self.start.max(1)) * self.step()
        }
    }

    /// Executes the events that are due; true if the exception becomes pending.
    pub fn fire(&mut self, now: Time) -> bool {
        if self.next() > now {
            return false;
        }
        let was_loading = self.start == 0;
        // one more step from 0 to the reload value
        self.since = self.next() + if was_loading { 0 } else { self.step() };
        self.start = self.reload;
        if was_loading {
            return false;
        }
        self.csr |= 1 << 16;
        self.csr & 2 != 0
    }

    /// Sets the clock.
    pub fn set_clock(&mut self, now: Time, cycle: Time) {
        self.start = self.value(now.max(self.since));
        self.since = now;
        self.cycle = cycle;
    }

    /// Reads a register; `address` is the low part after 0xE000_Exxx.
    pub fn read(&mut self, address: u32, now: Time) -> u32 {
        match address {
            0x010 => {
                let csr = self.csr;
                self.csr &= !(1 << 16);
                csr
            }
            0x014 => self.reload,
            0x018 => self.value(now.max(self.since)),
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, address: u32, value: u32, now: Time) {
        match address {
            0x010 => {
                self.start = self.value(now.max(self.since));
                self.since = now;
                self.csr = value & 7;
            }
            0x014 => self.reload = value & 0xff_ffff,
            0x018 => (self.start, self.since) = (0, now),
            _ => {}
        }
    }
}

/// CYCCNT. It stops while the core sleeps, unless DBGMCU keeps HCLK running.
pub struct CycleCounter {
    /// DWT_CTRL.CYCCNTENA
    enabled: bool,
    /// DEMCR.TRCENA
    pub trace_on: bool,
    /// DBGMCU_CR.DBG_SLEEP
    pub runs_in_sleep: bool,
    cycles: u32,
    fraction: Time,
    upto: Time,
    cycle: Time,
}

impl CycleCounter {
    /// The state after a reset.
    pub fn new(cycle: Time) -> CycleCounter {
        CycleCounter {
            enabled: false,
            trace_on: false,
            runs_in_sleep: false,
            cycles: 0,
            fraction: 0,
            upto: 0,
            cycle,
        }
    }

    /// Counts up to `now`; `asleep` is whether the core slept since the last call.
    pub fn advance(&mut self, now: Time, asleep: bool) {
        if self.enabled && self.trace_on && (!asleep || self.runs_in_sleep) {
            let time = self.fraction + (now - self.upto);
            self.cycles = self.cycles.wrapping_add((time / self.cycle) as u32);
            self.fraction = time % self.cycle;
        }
        self.upto = now;
    }

    /// Sets the clock.
    pub fn set_clock(&mut self, now: Time, cycle: Time) {
        self.advance(now, false);
        (self.cycle, self.fraction) = (cycle, 0);
    }

    /// Reads DWT_CTRL or CYCCNT; `address` is the low part after 0xE000_1xxx.
    pub fn read(&mut self, address: u32, now: Time) -> u32 {
        self.advance(now, false);
        match address {
            0 => 0x4000_0000 | u32::from(self.enabled),
            4 => self.cycles,
            _ => 0,
        }
    }

    /// Writes DWT_CTRL or CYCCNT.
    pub fn write(&mut self, address: u32, value: u32, now: Time) {
        self.advance(now, false);
        match address {
            0 => self.enabled = value & 1 != 0,
            4 => self.cycles = value,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systick_period_is_the_reload_value_plus_one() {
        let mut tick = SysTick::new(280);
        tick.write(0x014, 999, 0);
        tick.write(0x018, 0, 0);
        tick.write(0x010, 7, 0);
        let mut times = vec![];
        while times.len() < 3 {
            let now = tick.next();
            if tick.fire(now) {
                times.push(now / 280);
            }
        }
        assert_eq!(times[1] - times[0], 1000);
        assert_eq!(times[2] - times[1], 1000);
        assert_ne!(tick.read(0x010, times[2] * 280) & 1 << 16, 0);
    }

    #[test]
    fn cycle_counter_stops_while_the_core_sleeps() {
        let mut counter = CycleCounter::new(280);
        counter.write(0, 1, 0);
        assert_eq!(counter.read(4, 2800), 0, "trace is off");
        counter.trace_on = true;
        assert_eq!(counter.read(4, 5600), 10);
        counter.advance(8400, true);
        assert_eq!(counter.read(4, 8400), 10);
        counter.runs_in_sleep = true;
        counter.advance(11_200, true);
        assert_eq!(counter.read(4, 11_200), 20);
    }
}

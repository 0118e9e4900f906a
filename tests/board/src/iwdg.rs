//! IWDG: keys, prescaler, reload and timeout (RM0390 chapter 21).

use crate::time::{NEVER, Time, period};

/// Nominal frequency of the LSI oscillator.
pub const LSI_HZ: u64 = 32_000;

/// The watchdog.
pub struct Iwdg {
    prescaler: u32,
    reload: u32,
    open: bool,
    started: bool,
    /// Time until which PVU and RVU are set; before the start they are never cleared.
    updating_until: Time,
    updating: u32,
    expires_at: Time,
    /// The time that was left when a debugger stopped it.
    frozen: Option<Time>,
    /// Period of the LSI oscillator.
    lsi: Time,
}

impl Iwdg {
    /// The state after a reset, with an oscillator of this frequency.
    pub fn new(lsi_hz: u64) -> Self {
        Iwdg {
            lsi: period(lsi_hz).0,
            prescaler: 0,
            reload: 0xfff,
            open: false,
            started: false,
            updating_until: 0,
            updating: 0,
            expires_at: NEVER,
            frozen: None,
        }
    }

    /// Sets the oscillator's frequency, which applies from the next feed.
    pub fn set_lsi(&mut self, lsi_hz: u64) {
        self.lsi = period(lsi_hz).0;
    }

    /// Time at which the watchdog resets the chip unless it is fed.
    pub fn next(&self) -> Time {
        self.expires_at
    }

    /// Stops it, or lets it continue.
    pub fn freeze(&mut self, frozen: bool, now: Time) {
        if frozen && self.frozen.is_none() && self.started {
            self.frozen = Some(self.expires_at.saturating_sub(now));
            self.expires_at = NEVER;
        } else if !frozen && let Some(left) = self.frozen.take() {
            self.expires_at = now + left;
        }
    }

    /// Reads a register.
    pub fn read(&self, offset: u32, now: Time) -> u32 {
        match offset {
            0x04 => self.prescaler,
            0x08 => self.reload,
            0x0c if !self.started || now < self.updating_until => self.updating,
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now: Time) {
        let lsi = self.lsi;
        match (offset, value & 0xffff) {
            (0x00, 0x5555) => self.open = true,
            (0x00, key) => {
                self.open = false;
                self.started |= key == 0xcccc;
                if self.started && matches!(key, 0xaaaa | 0xcccc) {
                    let divider = 4 << self.prescaler.min(6);
                    self.expires_at = now + (Time::from(self.reload) + 1) * divider * lsi;
                    self.updating_until = self.updating_until.max(now);
                }
            }
            (0x04 | 0x08, value) if self.open => {
                let (field, bit) = match offset {
                    0x04 => (&mut self.prescaler, 1),
                    _ => (&mut self.reload, 2),
                };
                *field = value & if offset == 0x04 { 7 } else { 0xfff };
                self.updating = bit
                    | if now < self.updating_until {
                        self.updating
                    } else {
                        0
                    };
                self.updating_until = now + 5 * lsi;
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::from_ns;

    const MS: u64 = 1_000_000;

    fn started(prescaler: u32, reload: u32) -> Iwdg {
        let mut iwdg = Iwdg::new(LSI_HZ);
        for (offset, value) in [(0, 0x5555), (4, prescaler), (8, reload), (0, 0xcccc)] {
            iwdg.write(offset, value, 0);
        }
        iwdg
    }

    #[test]
    fn timeout_is_reload_plus_one_prescaled_clocks() {
        assert_eq!(started(0, 399).next(), from_ns(50 * MS));
        assert_eq!(started(3, 0xfff).next(), from_ns(4096 * MS));
    }

    #[test]
    fn frozen_watchdog_continues_with_the_time_left() {
        let mut iwdg = started(0, 399);
        iwdg.freeze(true, from_ns(20 * MS));
        assert_eq!(iwdg.next(), NEVER);
        iwdg.freeze(false, from_ns(100 * MS));
        assert_eq!(iwdg.next(), from_ns(130 * MS));
    }

    #[test]
    fn feeding_restarts_the_timeout_only_after_the_start() {
        let mut iwdg = Iwdg::new(LSI_HZ);
        iwdg.write(0, 0xaaaa, 0);
        assert_eq!(iwdg.next(), NEVER);
        let mut iwdg = started(0, 399);
        iwdg.write(0, 0xaaaa, from_ns(20 * MS));
        assert_eq!(iwdg.next(), from_ns(70 * MS));
    }

    #[test]
    fn registers_are_locked_without_the_key() {
        let mut iwdg = started(0, 399);
        iwdg.write(8, 1, 0);
        assert_eq!(iwdg.read(8, 0), 399);
    }

    #[test]
    fn update_flags_clear_only_after_the_start() {
        let mut iwdg = Iwdg::new(LSI_HZ);
        iwdg.write(0, 0x5555, 0);
        iwdg.write(4, 1, 0);
        assert_eq!(iwdg.read(0x0c, from_ns(100 * MS)), 1);
        iwdg.write(0, 0xcccc, from_ns(100 * MS));
        assert_eq!(iwdg.read(0x0c, from_ns(101 * MS)), 0);
    }
}

//! PWR: voltage scaling and over-drive, which 180 MHz needs (RM0390 and RM0383 chapter 5).
//!
//! On F446 and F411 the regulator is at scale 3 while the PLL is off; when the PLL is switched on
//! it goes to the scale of PWR_CR, and VOSRDY tells when it is there. The F407 keeps its scale. No
//! manual states how long it takes.

use crate::chip::Chip;
use crate::time::{NEVER, Time, from_ns};

const ODEN: u32 = 1 << 16;
const ODSWEN: u32 = 1 << 17;
/// The backup domain may be written to.
const DBP: u32 = 1 << 8;
const VOSRDY: u32 = 1 << 14;
/// Scale 3 in the field VOS.
const SCALE_3: u32 = 1;
/// Time that the regulator takes by default \[ns\]: an assumption.
pub const REGULATOR_NS: u64 = 100_000;

/// PWR_CR and the state that depends on it.
pub struct Pwr {
    chip: Chip,
    cr: u32,
    /// When the regulator reaches the scale of PWR_CR.
    ready_at: Time,
}

impl Pwr {
    /// The state after a reset.
    pub fn new(chip: Chip) -> Pwr {
        Pwr {
            chip,
            cr: chip.pwr_cr(),
            ready_at: NEVER,
        }
    }

    /// Follows the PLL; the regulator takes `regulator_ns`, or never gets ready.
    pub fn set_pll(&mut self, on: bool, regulator_ns: Option<u64>, now: Time) {
        self.ready_at = match (self.chip, on, regulator_ns) {
            (_, _, None) => NEVER,
            (Chip::F407, ..) => 0,
            (_, false, _) => NEVER,
            (_, true, Some(ns)) => self.ready_at.min(now + from_ns(ns)),
        };
    }

    /// Reads PWR_CR or PWR_CSR.
    pub fn read(&self, offset: u32, now: Time) -> u32 {
        match offset {
            0 => self.cr,
            4 => (u32::from(self.ready_at <= now) * VOSRDY) | self.cr & (ODEN | ODSWEN),
            _ => 0,
        }
    }

    /// Writes PWR_CR. Over-drive switching takes effect only after over-drive was enabled.
    pub fn write(&mut self, offset: u32, value: u32) {
        if offset == 0 {
            let ready = self.cr & ODEN != 0;
            self.cr = if ready { value } else { value & !ODSWEN };
        }
    }

    /// Whether the backup domain may be written to.
    pub fn is_backup_open(&self) -> bool {
        self.cr & DBP != 0
    }

    /// Maximum HCLK for the voltage scale in force \[Hz\].
    pub fn hclk_max_hz(&self, now: Time) -> u64 {
        if self.chip != Chip::F407 && self.ready_at > now {
            return self.chip.hclk_max_hz(SCALE_3, false);
        }
        self.chip
            .hclk_max_hz(self.cr >> 14 & 3, self.cr & ODSWEN != 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn over_drive_must_be_enabled_before_it_is_switched_on() {
        let mut pwr = Pwr::new(Chip::F446);
        pwr.set_pll(true, Some(0), 0);
        pwr.write(0, 0xc000 | ODEN | ODSWEN);
        assert_eq!(pwr.hclk_max_hz(0), 168_000_000);
        pwr.write(0, 0xc000 | ODEN | ODSWEN);
        assert_eq!(pwr.hclk_max_hz(0), 180_000_000);
        assert_eq!(pwr.read(4, 0) & (ODEN | ODSWEN), ODEN | ODSWEN);
    }

    #[test]
    fn regulator_leaves_scale_3_some_time_after_the_pll_is_on() {
        let mut pwr = Pwr::new(Chip::F411);
        pwr.write(0, 0xc000);
        let later = from_ns(REGULATOR_NS);
        for (pll_on, now, expected_hz) in [
            (false, later, 64_000_000),
            (true, later, 64_000_000),
            // Switched on again: it has not been off.
            (true, 2 * later - 1, 64_000_000),
            (true, 2 * later, 100_000_000),
            (false, 2 * later, 64_000_000),
        ] {
            pwr.set_pll(pll_on, Some(REGULATOR_NS), now);
            assert_eq!(pwr.hclk_max_hz(now), expected_hz, "{pll_on} {now}");
            assert_eq!(pwr.read(4, now) & VOSRDY != 0, expected_hz > 64_000_000);
        }
    }
}

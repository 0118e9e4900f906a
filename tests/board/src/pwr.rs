//! PWR: voltage scaling and over-drive, which 180 MHz needs (RM0390 chapter 5).

use crate::chip::Chip;

const ODEN: u32 = 1 << 16;
const ODSWEN: u32 = 1 << 17;

/// PWR_CR and the state that depends on it.
pub struct Pwr {
    chip: Chip,
    cr: u32,
}

impl Pwr {
    /// The state after a reset.
    pub fn new(chip: Chip) -> Pwr {
        Pwr {
            chip,
            cr: chip.pwr_cr(),
        }
    }

    /// Reads PWR_CR or PWR_CSR; the regulator is ready at once.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0 => self.cr,
            4 => 1 << 14 | self.cr & (ODEN | ODSWEN),
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

    /// Maximum HCLK for the voltage scale in force \[Hz\].
    pub fn hclk_max_hz(&self) -> u64 {
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
        pwr.write(0, 0xc000 | ODEN | ODSWEN);
        assert_eq!(pwr.hclk_max_hz(), 168_000_000);
        pwr.write(0, 0xc000 | ODEN | ODSWEN);
        assert_eq!(pwr.hclk_max_hz(), 180_000_000);
        assert_eq!(pwr.read(4) & (ODEN | ODSWEN), ODEN | ODSWEN);
    }
}

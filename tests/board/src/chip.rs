//! What distinguishes the chips (RM0390 and the datasheet of the F446, RM0090 of the F407, RM0383
//! of the F411). Flash and RAM that the firmware uses are the same on the three boards.

use crate::elf::BadElf;
use crate::rcc::Bus;

/// A chip.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Chip {
    /// STM32F446RE.
    #[default]
    F446,
    /// STM32F407VE.
    F407,
    /// STM32F411RE.
    F411,
}

impl Chip {
    /// The chip for which a firmware with these symbols was built: its memory.x defines one.
    pub fn of(symbols: &[(String, u32)]) -> Result<Chip, BadElf> {
        let mut names = symbols
            .iter()
            .filter_map(|(name, _)| name.strip_prefix("chip_"));
        match names.next() {
            Some(name) if name.starts_with("STM32F446") => Ok(Chip::F446),
            Some(name) if name.starts_with("STM32F407") => Ok(Chip::F407),
            Some(name) if name.starts_with("STM32F411") => Ok(Chip::F411),
            Some(name) => Err(BadElf(format!("the chip {name} is not modelled"))),
            None => Err(BadElf("no symbol chip_… names the chip".into())),
        }
    }

    /// Whether a peripheral with a clock gate exists.
    pub fn has(self, bus: Bus, bit: u32) -> bool {
        // The F411 has neither TIM6 and TIM7 nor a DAC.
        self != Chip::F411 || !matches!((bus, bit), (Bus::Apb1, 4 | 5 | 29))
    }

    /// Limits of HCLK, PCLK1 and PCLK2 \[Hz\].
    pub fn clocks_max_hz(self) -> [u64; 3] {
        match self {
            Chip::F446 => [180_000_000, 45_000_000, 90_000_000],
            Chip::F407 => [168_000_000, 42_000_000, 84_000_000],
            Chip::F411 => [100_000_000, 50_000_000, 100_000_000],
        }
    }

    /// Lowest frequency of the PLL's oscillator \[Hz\].
    pub fn vco_min_hz(self) -> u64 {
        match self {
            Chip::F407 => 192_000_000,
            Chip::F446 | Chip::F411 => 100_000_000,
        }
    }

    /// PWR_CR after a reset.
    pub fn pwr_cr(self) -> u32 {
        match self {
            Chip::F446 => 0xc000,
            Chip::F407 => 0x4000,
            Chip::F411 => 0x8000,
        }
    }

    /// Maximum HCLK for a voltage scale, which is the field VOS \[Hz\].
    pub fn hclk_max_hz(self, vos: u32, over_drive: bool) -> u64 {
        match (self, vos, over_drive) {
            (Chip::F446, 3, true) => 180_000_000,
            (Chip::F446, 3, false) | (Chip::F446, 2, true) => 168_000_000,
            (Chip::F446, 2, false) => 144_000_000,
            (Chip::F446, ..) => 120_000_000,
            // One bit.
            (Chip::F407, 1 | 3, _) => 168_000_000,
            (Chip::F407, ..) => 144_000_000,
            (Chip::F411, 3, _) => 100_000_000,
            (Chip::F411, 2, _) => 84_000_000,
            (Chip::F411, ..) => 64_000_000,
        }
    }

    /// DBGMCU_IDCODE.
    pub fn idcode(self) -> u32 {
        match self {
            Chip::F446 => 0x1000_6421,
            Chip::F407 => 0x1007_6413,
            Chip::F411 => 0x1000_6431,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chip_is_that_of_the_symbol() {
        let symbols = |name: &str| [("main".to_string(), 0), (name.to_string(), 1)];
        assert_eq!(Chip::of(&symbols("chip_STM32F411RETx")), Ok(Chip::F411));
        assert!(Chip::of(&symbols("chip_STM32F103C8")).is_err());
        assert!(Chip::of(&symbols("_start")).is_err());
    }
}

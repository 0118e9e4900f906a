//! RCC: clock tree, clock gates, peripheral resets and reset flags (RM0390 chapter 6).

use crate::chip::Chip;
use crate::errors::Context;
use crate::iwdg::LSI_HZ;
use crate::time::{Time, period};

/// Clock from the ST-LINK at OSC_IN of a NUCLEO-F446RE \[Hz\]; no crystal is fitted.
pub const HSE_HZ: u64 = 8_000_000;
const HSI_HZ: u64 = 16_000_000;

/// The oscillators; resets of the chip do not change them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Oscillators {
    /// Frequency of LSI, the watchdog's \[Hz\]; 17 to 47 kHz in real chips.
    pub lsi_hz: u64,
    /// Frequency of HSI \[Hz\].
    pub hsi_hz: u64,
    /// Whether HSI oscillates.
    pub hsi_runs: bool,
    /// Whether the ST-LINK's clock arrives at OSC_IN.
    pub hse_runs: bool,
}

impl Default for Oscillators {
    fn default() -> Oscillators {
        Oscillators {
            lsi_hz: LSI_HZ,
            hsi_hz: HSI_HZ,
            hsi_runs: true,
            hse_runs: true,
        }
    }
}

const CR: usize = 0x00;
const PLLCFGR: usize = 0x04;
const CFGR: usize = 0x08;
/// Register of the backup domain.
pub const BDCR: usize = 0x70;
/// Its bit that resets that domain.
pub const BDRST: u32 = 1 << 16;
const CSR: usize = 0x74;
const DCKCFGR: usize = 0x8c;
const REGISTERS: usize = 0x98 / 4;

/// A bus whose peripherals have clock gates; the value is the offset of its enable register.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Bus {
    /// AHB1
    Ahb1 = 0x30,
    /// APB1
    Apb1 = 0x40,
    /// APB2
    Apb2 = 0x44,
}

/// Cause of a reset.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ResetCause {
    /// Supply switched on.
    Power,
    /// NRST pulled low from outside.
    Pin,
    /// AIRCR.SYSRESETREQ
    Software,
    /// The independent watchdog was not fed.
    Watchdog,
}

impl ResetCause {
    /// Flags in RCC_CSR. Every reset of the chip drives NRST low, so PINRSTF is always set.
    fn flags(self) -> u32 {
        match self {
            ResetCause::Power => 0x0e00_0000,
            ResetCause::Pin => 0x0400_0000,
            ResetCause::Software => 0x1400_0000,
            ResetCause::Watchdog => 0x2400_0000,
        }
    }
}

/// Frequencies of the clock tree.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Clocks {
    /// Core, memories, DMA \[Hz\].
    pub hclk_hz: u64,
    /// APB1 \[Hz\].
    pub pclk1_hz: u64,
    /// APB2 \[Hz\].
    pub pclk2_hz: u64,
    /// Timers on APB1 \[Hz\].
    pub timclk1_hz: u64,
}

impl Clocks {
    /// Duration of a core cycle.
    pub fn cycle(&self) -> Time {
        period(self.hclk_hz).0
    }
}

/// The registers and the clocks that they configure.
pub struct Rcc {
    words: [u32; REGISTERS],
    /// The clocks in force.
    pub clocks: Clocks,
    oscillators: Oscillators,
    /// The chip, whose limits are checked.
    pub chip: Chip,
}

impl Rcc {
    /// The state after a reset; `flags` are those of RCC_CSR before it.
    pub fn new(cause: ResetCause, flags: u32, oscillators: Oscillators) -> Rcc {
        let mut words = [0; REGISTERS];
        words[CR / 4] = 0x81;
        words[PLLCFGR / 4] = 0x2400_3010;
        words[0x50 / 4] = 0x7fff_ffff;
        words[0x60 / 4] = 0x7fff_ffff;
        words[0x64 / 4] = 0x7fff_ffff;
        let kept = if cause == ResetCause::Power { 0 } else { flags };
        words[CSR / 4] = kept | cause.flags();
        let mut rcc = Rcc {
            words,
            clocks: Clocks::default(),
            oscillators,
            chip: Chip::default(),
        };
        rcc.clocks = rcc.tree();
        rcc
    }

    /// The oscillators.
    pub fn oscillators(&self) -> Oscillators {
        self.oscillators
    }

    /// Changes the oscillators; true if the clocks may have changed.
    pub fn set_oscillators(&mut self, oscillators: Oscillators) -> bool {
        self.oscillators = oscillators;
        let before = self.clocks;
        self.clocks = self.tree();
        before != self.clocks
    }

    /// Whether the oscillator behind the system clock oscillates. Without clock security the core
    /// and all buses stop with it.
    pub fn is_clocked(&self) -> bool {
        let from_hse = match self.source() {
            0 => false,
            1 => true,
            _ => self.words[PLLCFGR / 4] & 1 << 22 != 0,
        };
        if from_hse {
            self.oscillators.hse_runs
        } else {
            self.oscillators.hsi_runs
        }
    }

    /// Whether the PLL is on.
    pub fn is_pll_on(&self) -> bool {
        self.words[CR / 4] & 1 << 24 != 0
    }

    /// Frequency of the oscillator that is connected to the RTC; only LSI can be.
    pub fn rtc_hz(&self) -> Option<u64> {
        let bdcr = self.words[BDCR / 4];
        let is_lsi = bdcr & 1 << 15 != 0 && bdcr >> 8 & 3 == 2;
        is_lsi.then_some(self.oscillators.lsi_hz)
    }

    /// Takes over what a reset of the chip does not change.
    pub fn keep_backup_domain(&mut self, before: &Rcc) {
        self.words[BDCR / 4] = before.words[BDCR / 4];
    }

    /// The reset flags, as RCC_CSR shows them.
    pub fn reset_flags(&self) -> u32 {
        self.words[CSR / 4] & 0xfe00_0000
    }

    /// Whether the clock of the peripheral at `bit` of `bus` is enabled.
    pub fn is_on(&self, bus: Bus, bit: u32) -> bool {
        self.words[bus as usize / 4] >> bit & 1 != 0
    }

    /// Reads a register; clock sources are ready as soon as they are switched on.
    pub fn read(&self, offset: u32) -> u32 {
        let index = offset as usize / 4;
        let word = self.words.get(index).copied().unwrap_or(0);
        match index * 4 {
            CR => word | (word & 0x1501_0001 & !self.hse_dead()) << 1,
            CFGR => word & !0xc | self.source() << 2,
            BDCR | CSR => word | (word & 1) << 1,
            _ => word,
        }
    }

    /// HSEON if HSE never gets ready: without bypass, because the board has no crystal, or without
    /// the ST-LINK's clock.
    fn hse_dead(&self) -> u32 {
        let cr = self.words[CR / 4];
        if cr & 1 << 18 == 0 || !self.oscillators.hse_runs {
            cr & 1 << 16
        } else {
            0
        }
    }

    fn source(&self) -> u32 {
        self.words[CFGR / 4] & 3
    }

    /// Writes a register; true if the clocks may have changed.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) -> bool {
        let index = offset as usize / 4;
        if index >= REGISTERS {
            return false;
        }
        if index * 4 == PLLCFGR && self.is_pll_on() {
            if value != self.words[PLLCFGR / 4] {
                cx.error("RCC: PLLCFGR written while the PLL is on: ignored");
            }
            return false;
        }
        self.words[index] = match index * 4 {
            // `read` sets the ready bits
            CR => value & !0x2a02_0002,
            // The source stays until the domain's reset.
            BDCR if value & BDRST != 0 => BDRST,
            BDCR if self.words[BDCR / 4] >> 8 & 3 != 0 => {
                value & !0x300 | self.words[BDCR / 4] & 0x300
            }
            CSR if value & 1 << 24 != 0 => value & 1,
            CSR => self.words[CSR / 4] & 0xfe00_0000 | value & 1,
            _ => value,
        };
        if !matches!(index * 4, CR | PLLCFGR | CFGR | DCKCFGR) {
            return false;
        }
        if self.hse_dead() != 0 {
            cx.error("RCC: HSE on without bypass or without its clock: it never gets ready");
        }
        let before = self.clocks;
        self.clocks = self.tree();
        self.check(cx);
        before != self.clocks
    }

    fn pll(&self) -> (u64, u64, u64) {
        let word = u64::from(self.words[PLLCFGR / 4]);
        let source = if word & 1 << 22 != 0 {
            HSE_HZ
        } else {
            self.oscillators.hsi_hz
        };
        let input_hz = source / (word & 0x3f).max(1);
        let vco_hz = input_hz * (word >> 6 & 0x1ff);
        (input_hz, vco_hz, vco_hz / ((word >> 16 & 3) * 2 + 2))
    }

    fn tree(&self) -> Clocks {
        let cfgr = self.words[CFGR / 4];
        let sysclk_hz = match self.source() {
            0 => self.oscillators.hsi_hz,
            1 => HSE_HZ,
            _ => self.pll().2.max(1),
        };
        let ahb = match cfgr >> 4 & 15 {
            code @ 8..=11 => 2 << (code - 8),
            code @ 12.. => 64 << (code - 12),
            _ => 1,
        };
        let apb = |code: u32| if code & 4 != 0 { 2 << (code & 3) } else { 1 };
        let hclk_hz = sysclk_hz / ahb;
        let (div1, div2) = (apb(cfgr >> 10), apb(cfgr >> 13));
        let wide = self.words[DCKCFGR / 4] & 1 << 24 != 0;
        let times = match (wide, div1) {
            (_, 1) => 1,
            (false, _) | (true, 2) => 2,
            (true, _) => 4,
        };
        Clocks {
            hclk_hz,
            pclk1_hz: hclk_hz / div1,
            pclk2_hz: hclk_hz / div2,
            timclk1_hz: hclk_hz / div1 * times,
        }
    }

    /// Checks the limits of the clock tree (RM0390 6.2.3, 6.3.2; datasheet).
    fn check(&self, cx: &mut Context) {
        let cr = self.words[CR / 4];
        let clocks = self.clocks;
        if self.source() == 2 && cr & 1 << 24 == 0 {
            cx.error("RCC: system clock switched to the PLL while it is off");
        }
        if cr & 1 << 24 != 0 {
            let (input_hz, vco_hz, _) = self.pll();
            if !(950_000..=2_100_000).contains(&input_hz) {
                cx.error(format!(
                    "RCC: PLL input {input_hz} Hz is outside 0.95 to 2.1 MHz"
                ));
            }
            let vco_min_hz = self.chip.vco_min_hz();
            if !(vco_min_hz..=432_000_000).contains(&vco_hz) {
                cx.error(format!(
                    "RCC: VCO {vco_hz} Hz is outside {} to 432 MHz",
                    vco_min_hz / 1_000_000
                ));
            }
        }
        let [hclk, pclk1, pclk2] = self.chip.clocks_max_hz();
        let limits = [
            ("HCLK", clocks.hclk_hz, hclk),
            ("PCLK1", clocks.pclk1_hz, pclk1),
            ("PCLK2", clocks.pclk2_hz, pclk2),
        ];
        for (name, hz, limit_hz) in limits {
            if hz > limit_hz {
                cx.error(format!("RCC: {name} {hz} Hz is above its limit"));
            }
        }
        if !period(clocks.hclk_hz).1 && self.oscillators.hsi_hz == HSI_HZ {
            cx.error(format!(
                "model: HCLK {} Hz is not a divisor of the time unit",
                clocks.hclk_hz
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    fn write_all(rcc: &mut Rcc, writes: &[(usize, u32)]) -> Vec<String> {
        let mut errors = Errors::default();
        for (offset, value) in writes {
            rcc.write(*offset as u32, *value, &mut test_context(&mut errors, 0));
        }
        errors.list.into_iter().map(|e| e.text).collect()
    }

    /// M = 4, N = 180, P = 2 from HSE; PPRE1 = 4, PPRE2 = 2.
    const TO_180_MHZ: [(usize, u32); 4] = [
        (CR, 0x0005_0081),
        (PLLCFGR, 1 << 22 | 180 << 6 | 4),
        (CR, 0x0105_0081),
        (CFGR, 0b100 << 13 | 0b101 << 10 | 2),
    ];

    #[test]
    fn runs_on_hsi_after_reset() {
        let rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        assert_eq!(rcc.clocks.hclk_hz, 16_000_000);
        assert_eq!(rcc.read(CR as u32), 0x83);
        assert_eq!(rcc.read(CSR as u32), 0x0e00_0000);
    }

    #[test]
    fn configuration_for_180_mhz_has_no_errors() {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        assert_eq!(write_all(&mut rcc, &TO_180_MHZ), Vec::<String>::new());
        let clocks = rcc.clocks;
        assert_eq!((clocks.hclk_hz, clocks.pclk1_hz), (180_000_000, 45_000_000));
        assert_eq!(
            (clocks.pclk2_hz, clocks.timclk1_hz),
            (90_000_000, 90_000_000)
        );
        assert_eq!(rcc.read(CFGR as u32) >> 2 & 3, 2);
    }

    #[test]
    fn timpre_doubles_the_timer_clock() {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        write_all(&mut rcc, &TO_180_MHZ);
        write_all(&mut rcc, &[(DCKCFGR, 1 << 24)]);
        assert_eq!(rcc.clocks.timclk1_hz, 180_000_000);
    }

    #[test]
    fn hse_without_bypass_never_gets_ready() {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        assert_eq!(write_all(&mut rcc, &[(CR, 0x0001_0081)]).len(), 1);
        assert_eq!(rcc.read(CR as u32) & 1 << 17, 0);
    }

    #[test]
    fn system_clock_stops_with_the_oscillator_behind_it() {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        write_all(&mut rcc, &TO_180_MHZ);
        rcc.set_oscillators(Oscillators {
            hsi_runs: false,
            ..Oscillators::default()
        });
        assert!(rcc.is_clocked());
        rcc.set_oscillators(Oscillators {
            hse_runs: false,
            ..Oscillators::default()
        });
        assert!(!rcc.is_clocked());
        assert_eq!(rcc.read(CR as u32) & 1 << 17, 0, "HSE is not ready");
    }

    #[test]
    fn pll_from_hsi_follows_its_tolerance() {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        let to_144_mhz = [
            (PLLCFGR, 144 << 6 | 8),
            (CR, 0x0100_0081),
            (CFGR, 0b100 << 13 | 0b101 << 10 | 2),
        ];
        assert_eq!(write_all(&mut rcc, &to_144_mhz), Vec::<String>::new());
        assert_eq!(rcc.clocks.hclk_hz, 144_000_000);
        rcc.set_oscillators(Oscillators {
            hsi_hz: 16_500_000,
            ..Oscillators::default()
        });
        assert_eq!(rcc.clocks.hclk_hz, 148_500_000);
    }

    #[test]
    fn clocks_above_their_limits_are_reported() {
        let mut rcc = Rcc::new(ResetCause::Power, 0, Oscillators::default());
        let too_fast = [TO_180_MHZ[0], TO_180_MHZ[1], TO_180_MHZ[2], (CFGR, 2)];
        assert_eq!(
            write_all(&mut rcc, &too_fast).len(),
            2,
            "PCLK1 and PCLK2 at 180 MHz"
        );
    }

    #[test]
    fn reset_flags_accumulate_until_cleared() {
        let mut rcc = Rcc::new(ResetCause::Watchdog, 0x0e00_0000, Oscillators::default());
        assert_eq!(rcc.reset_flags(), 0x2e00_0000);
        write_all(&mut rcc, &[(CSR, 1 << 24)]);
        assert_eq!(rcc.reset_flags(), 0);
    }
}

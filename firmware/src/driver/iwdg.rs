//! The independent watchdog (IWDG), and the cause of the last reset.

use model_core::link::ResetCause;
use rig_drivers::watchdog::{LONG_TIMEOUT_MS, WatchdogTimer};
use stm32f4xx_hal::pac::{DBGMCU, IWDG, RCC};

/// Prescaler codes of a count per millisecond, and of 125 counts per second, of the nominal 32 kHz.
/// The oscillator has 17 to 47 kHz: nominal 50 ms are 34 to 94 ms.
const PRESCALERS: [u8; 2] = [3, 6];
/// Longest timeout of the first prescaler \[ms\].
const FINE_MS_MAX: u32 = 4_095;

/// Whether the watchdog stands still while a debugger halts the CPU. Then the valve keeps its
/// voltage for as long as the halt lasts: only with the valve's supply off.
pub const STOPS_IN_DEBUG: bool = cfg!(feature = "debugger");

/// The running watchdog timer.
pub struct Iwdg {
    iwdg: IWDG,
    debug: DBGMCU,
}

impl Iwdg {
    /// Starts the watchdog. Nothing stops it, unless [`STOPS_IN_DEBUG`].
    pub fn start(iwdg: IWDG, debug: DBGMCU) -> Iwdg {
        iwdg.kr().write(|w| w.key().start());
        let mut timer = Iwdg { iwdg, debug };
        timer.overrule_debugger();
        timer
    }

    /// Debuggers set this bit when they attach (OpenOCD does), and only power-on clears it.
    fn overrule_debugger(&mut self) {
        self.debug
            .apb1_fz()
            .modify(|_, w| w.dbg_iwdg_stop().bit(STOPS_IN_DEBUG));
    }
}

impl WatchdogTimer for Iwdg {
    fn set_timeout_ms(&mut self, timeout_ms: u32) {
        set_timeout(&self.iwdg, timeout_ms);
    }

    fn feed(&mut self) {
        self.iwdg.kr().write(|w| w.key().feed());
        self.overrule_debugger();
    }
}

/// Switches back to the long timeout, after the last tick before a reset.
pub fn expect_no_ticks() {
    // SAFETY: no tick runs any more, and nothing else uses the watchdog.
    #[allow(unsafe_code)]
    let iwdg = unsafe { IWDG::steal() };
    set_timeout(&iwdg, LONG_TIMEOUT_MS);
}

fn set_timeout(iwdg: &IWDG, timeout_ms: u32) {
    let [fine, coarse] = PRESCALERS;
    let (prescaler, counts) = if timeout_ms <= FINE_MS_MAX {
        (fine, timeout_ms)
    } else {
        (coarse, timeout_ms / 8)
    };
    iwdg.kr().write(|w| w.key().unlock());
    // SAFETY: every value of the field is valid.
    #[allow(unsafe_code)]
    iwdg.pr().write(|w| unsafe { w.bits(prescaler.into()) });
    iwdg.rlr().write(|w| w.rl().set(counts.min(0xfff) as u16));
    // Both registers are updated in the slow clock domain; a feed before that would restart the
    // old timeout.
    while iwdg.sr().read().bits() != 0 {}
    iwdg.kr().write(|w| w.key().feed());
}

/// Reads the cause of the last reset, and clears its flags.
pub fn reset_cause(rcc: &RCC) -> ResetCause {
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    // Every reset also sets the pin flag: the pin is the cause only if no other flag is set.
    if flags.porrstf().bit() || flags.borrstf().bit() {
        ResetCause::Power
    } else if flags.wdgrstf().bit() {
        ResetCause::Watchdog
    } else if flags.sftrstf().bit() {
        ResetCause::Software
    } else if flags.padrstf().bit() {
        ResetCause::Pin
    } else {
        ResetCause::Other
    }
}

//! The independent watchdog (IWDG), and the cause of the last reset.

use model_core::link::ResetCause;
use stm32f4xx_hal::pac::{DBGMCU, IWDG, RCC};

/// Prescaler code and reload value while ticks run: four ticks may be missed. 32 kHz / 32 is one
/// count per millisecond; the oscillator has 17 to 47 kHz, so that the nominal 50 ms are 34 to
/// 94 ms.
const TICK_TIMEOUT: (u8, u16) = (3, 50);
/// The same while no ticks run: erasing a sector may take 4 s. 32 kHz / 256 is 125 counts per
/// second, so that this is nominally 20 s.
const LONG_TIMEOUT: (u8, u16) = (6, 20 * 125);

/// The running watchdog.
pub struct Watchdog(IWDG);

impl Watchdog {
    /// Starts the watchdog with the long timeout. Only a debugger that halts the CPU can stop it.
    pub fn start(iwdg: IWDG, debug: &DBGMCU) -> Watchdog {
        debug.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
        iwdg.kr().write(|w| w.key().start());
        set_timeout(&iwdg, LONG_TIMEOUT);
        Watchdog(iwdg)
    }

    /// Switches to the short timeout: from now on ticks must complete.
    pub fn expect_ticks(&mut self) {
        set_timeout(&self.0, TICK_TIMEOUT);
    }

    /// Restarts the timeout. Call it after a complete tick and nowhere else: the link task is not
    /// monitored, because a reset vents the muscle and lowers the weight, whereas the tick can
    /// assist without the PC.
    pub fn feed(&mut self) {
        self.0.kr().write(|w| w.key().feed());
    }
}

/// Switches back to the long timeout, after the last tick before a reset.
pub fn expect_no_ticks() {
    // SAFETY: no tick runs any more, and nothing else uses the watchdog.
    #[allow(unsafe_code)]
    let iwdg = unsafe { IWDG::steal() };
    set_timeout(&iwdg, LONG_TIMEOUT);
}

fn set_timeout(iwdg: &IWDG, (prescaler, counts): (u8, u16)) {
    iwdg.kr().write(|w| w.key().unlock());
    // SAFETY: every value of the field is valid.
    #[allow(unsafe_code)]
    iwdg.pr().write(|w| unsafe { w.bits(prescaler.into()) });
    iwdg.rlr().write(|w| w.rl().set(counts));
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

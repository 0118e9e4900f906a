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

/// Whether the watchdog stands still while a debugger halts the CPU. Then the valve keeps its
/// voltage for as long as the halt lasts: only with the valve's supply off.
pub const STOPS_IN_DEBUG: bool = cfg!(feature = "debugger");

/// The running watchdog.
pub struct Watchdog {
    iwdg: IWDG,
    debug: DBGMCU,
}

impl Watchdog {
    /// Starts the watchdog with the long timeout. Nothing stops it, unless [`STOPS_IN_DEBUG`].
    pub fn start(iwdg: IWDG, debug: DBGMCU) -> Watchdog {
        iwdg.kr().write(|w| w.key().start());
        set_timeout(&iwdg, LONG_TIMEOUT);
        let mut watchdog = Watchdog { iwdg, debug };
        watchdog.overrule_debugger();
        watchdog
    }

    /// Switches to the short timeout: from now on ticks must complete.
    pub fn expect_ticks(&mut self) {
        set_timeout(&self.iwdg, TICK_TIMEOUT);
    }

    /// Restarts the timeout. Call it after a complete tick and nowhere else: the link task is not
    /// monitored, because a reset vents the muscle and lowers the weight, whereas the tick can
    /// assist without the PC.
    pub fn feed(&mut self) {
        self.iwdg.kr().write(|w| w.key().feed());
        self.overrule_debugger();
    }

    /// Debuggers set this bit when they attach (OpenOCD does), and only power-on clears it.
    fn overrule_debugger(&mut self) {
        self.debug
            .apb1_fz()
            .modify(|_, w| w.dbg_iwdg_stop().bit(STOPS_IN_DEBUG));
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

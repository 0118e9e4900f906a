//! The independent watchdog, and why the chip was reset last.

use model_core::link::ResetCause;
use stm32f4xx_hal::pac::{DBGMCU, IWDG, RCC};

/// Four ticks may fail. 32 kHz / 32 is a count a millisecond; as the oscillator is between 17 and
/// 47 kHz, the 50 ms are 34 to 94 ms.
const TICK_TIMEOUT: (u8, u16) = (3, 50);
/// Outside of the ticks: a sector's erasure may take 4 s. 32 kHz / 256 is 125 counts a second.
const LONG_TIMEOUT: (u8, u16) = (6, 20 * 125);

/// The running watchdog.
pub struct Watchdog(IWDG);

impl Watchdog {
    /// Starts it, with a long time; there is no way to stop it but the debugger's.
    pub fn start(iwdg: IWDG, debug: &DBGMCU) -> Watchdog {
        debug.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
        iwdg.kr().write(|w| w.key().start());
        set_timeout(&iwdg, LONG_TIMEOUT);
        Watchdog(iwdg)
    }

    /// From now on ticks must complete.
    pub fn expect_ticks(&mut self) {
        set_timeout(&self.0, TICK_TIMEOUT);
    }

    /// To be called after a complete tick, and nowhere else. The link is not waited for: a tick
    /// that assists is worth more than a PC that listens, and a reset lets the weight down.
    pub fn feed(&mut self) {
        self.0.kr().write(|w| w.key().feed());
    }
}

/// The long time again, when ticks have ended for good.
pub fn expect_no_ticks() {
    // SAFETY: the ticks, which use the watchdog otherwise, have ended.
    #[allow(unsafe_code)]
    let iwdg = unsafe { IWDG::steal() };
    set_timeout(&iwdg, LONG_TIMEOUT);
}

fn set_timeout(iwdg: &IWDG, (prescaler, counts): (u8, u16)) {
    iwdg.kr().write(|w| w.key().unlock());
    // SAFETY: any value will do.
    #[allow(unsafe_code)]
    iwdg.pr().write(|w| unsafe { w.bits(prescaler.into()) });
    iwdg.rlr().write(|w| w.rl().set(counts));
    // The slow clock takes both over; only then a feeding begins the new time.
    while iwdg.sr().read().bits() != 0 {}
    iwdg.kr().write(|w| w.key().feed());
}

/// Reads and forgets the reset's cause.
pub fn reset_cause(rcc: &RCC) -> ResetCause {
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    // Each reset pulls the pin too: it is the cause if there is no other.
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

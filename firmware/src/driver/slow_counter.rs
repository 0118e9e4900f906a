//! The slow counter: the sub-second prescaler of the calendar (RTC), clocked by the chip's slow
//! oscillator (LSI), which is the watchdog's.

use model_core::clock::SLOW_COUNT_MAX;
use stm32f4xx_hal::pac::{PWR, RCC, RTC};

/// Divider of the oscillator.
const DIVIDER: u8 = 32;
/// A wrong key, which locks the registers.
const LOCK: u8 = 0xff;
/// Keys that unlock them. A reset of the chip does not lock them, and a second first key would.
const UNLOCK: [u8; 3] = [LOCK, 0xca, 0x53];
/// Reads of a flag that the oscillator sets within four of its periods: more than 4 ms at 72 MHz.
/// Without the oscillator it is never set, and the counter stands still.
const FLAG_READS: u32 = 100_000;

/// The counter, running.
pub struct SlowCounter(RTC);

impl SlowCounter {
    /// Starts the counter. What another program has left of the calendar is lost.
    pub fn start(rtc: RTC, rcc: &RCC, power: &PWR) -> SlowCounter {
        rcc.csr().modify(|_, w| w.lsion().on());
        power.cr().modify(|_, w| w.dbp().set_bit());
        if !rcc.bdcr().read().rtcsel().is_lsi() {
            // The source is fixed until this reset.
            rcc.bdcr().modify(|_, w| w.bdrst().enabled());
            rcc.bdcr().modify(|_, w| w.bdrst().disabled());
        }
        rcc.bdcr().modify(|_, w| w.rtcsel().lsi().rtcen().enabled());
        for key in UNLOCK {
            rtc.wpr().write(|w| w.key().set(key));
        }
        rtc.isr().modify(|_, w| w.init().init_mode());
        let _ = (0..FLAG_READS).any(|_| rtc.isr().read().initf().is_allowed());
        // Two separate writes.
        rtc.prer().modify(|_, w| w.prediv_s().set(SLOW_COUNT_MAX));
        rtc.prer().modify(|_, w| w.prediv_a().set(DIVIDER - 1));
        rtc.isr().modify(|_, w| w.init().free_running_mode());
        rtc.wpr().write(|w| w.key().set(LOCK));
        SlowCounter(rtc)
    }

    /// The count, which rises.
    pub fn count(&self) -> u16 {
        let down = self.0.ssr().read().ss().bits();
        // Reading the sub-seconds locks the date until it is read, too.
        let _ = self.0.dr().read().bits();
        SLOW_COUNT_MAX.wrapping_sub(down)
    }
}

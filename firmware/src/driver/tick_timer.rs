//! The tick timer: the update event of TIM2 triggers the ADC. The last scan of a period starts the
//! tick.

use crate::board;
use stm32f4xx_hal::pac::TIM2;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

/// The timer, stopped.
pub struct TickTimer(TIM2);

impl TickTimer {
    /// Switches the timer's clock on.
    pub fn new(timer: TIM2, rcc: &mut Rcc) -> TickTimer {
        TIM2::enable(rcc);
        TIM2::reset(rcc);
        TickTimer(timer)
    }

    /// Starts the scans; the first one begins at once, the first tick after a whole period.
    pub fn start(&self) {
        let timer = &self.0;
        timer
            .psc()
            .write(|w| w.psc().set((board::TICK_PRESCALER - 1) as u16));
        timer.arr().write(|w| w.set(board::SCAN_COUNTS - 1));
        timer.cr2().write(|w| w.mms().update());
        // The bridge's converter is read at each scan.
        timer
            .dier()
            .write(|w| w.uie().bit(cfg!(feature = "ads1220")));
        // The update event loads the prescaler, and is the first trigger.
        timer.egr().write(|w| w.ug().set_bit());
        timer.cr1().write(|w| w.cen().set_bit());
    }

    /// Clears the interrupt of the update event.
    #[cfg(feature = "ads1220")]
    pub fn clear_update(&self) {
        self.0.sr().write(|w| w.uif().clear_bit());
    }
}

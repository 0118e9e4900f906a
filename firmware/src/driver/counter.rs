//! The counter of the encoder's edges: TIM5, which has 32 bits.

use crate::board::EncoderPins;
use rig_drivers::encoder::EdgeCounter;
use stm32f4xx_hal::pac::TIM5;
use stm32f4xx_hal::qei::Qei;
use stm32f4xx_hal::rcc::Rcc;

/// The code of that filter in the field of the second input, which has no names.
const FILTER: u8 = 0b1111;

/// The counter.
pub struct Counter(TIM5);

impl Counter {
    /// Starts counting at 0.
    pub fn new(timer: TIM5, pins: EncoderPins, rcc: &mut Rcc) -> Counter {
        // The HAL sets the timer up, but reads it through embedded-hal 0.2 only.
        let (timer, _) = Qei::new(timer, pins, rcc).release();
        // Eight equal samples at TIMER_HZ / 32 before an edge counts: 3.6 µs at 72 MHz, 2.7 µs at
        // 96 MHz, which no interference of a switching supply lasts. A is then followed up to 140
        // or 187 kHz, the weight up to 7 or 9 m/s.
        timer
            .ccmr1_input()
            .modify(|_, w| w.ic1f().fdts_div32_n8().ic2f().set(FILTER));
        Counter(timer)
    }
}

impl EdgeCounter for Counter {
    const BITS: u32 = 32;

    fn edges(&self) -> u32 {
        self.0.cnt().read().cnt().bits()
    }
}

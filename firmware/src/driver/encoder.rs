//! The encoder of the muscle: TIM5 counts every edge of A and B in a 32-bit counter that wraps.

use crate::board::EncoderPins;
use model_core::signal::EncoderCount;
use stm32f4xx_hal::pac::TIM5;
use stm32f4xx_hal::qei::Qei;
use stm32f4xx_hal::rcc::Rcc;

/// The encoder.
pub struct Encoder(TIM5);

impl Encoder {
    /// Starts counting at 0.
    pub fn new(timer: TIM5, pins: EncoderPins, rcc: &mut Rcc) -> Encoder {
        // The HAL sets the timer up, but reads it through embedded-hal 0.2 only.
        let (timer, _) = Qei::new(timer, pins, rcc).release();
        Encoder(timer)
    }

    /// The position.
    pub fn read(&self) -> EncoderCount {
        EncoderCount(self.0.cnt().read().cnt().bits())
    }
}

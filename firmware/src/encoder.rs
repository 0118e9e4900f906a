//! The muscle's encoder: TIM5 counts each edge of A and B, on 32 bits that wrap.

use crate::board::EncoderPins;
use embedded_hal_02::Qei as _;
use model_core::signal::EncoderCount;
use stm32f4xx_hal::pac::TIM5;
use stm32f4xx_hal::qei::Qei;
use stm32f4xx_hal::rcc::Rcc;

/// The encoder.
pub struct Encoder(Qei<TIM5>);

impl Encoder {
    /// Begins to count, from zero.
    pub fn new(timer: TIM5, pins: EncoderPins, rcc: &mut Rcc) -> Encoder {
        Encoder(Qei::new(timer, pins, rcc))
    }

    /// The position.
    pub fn read(&self) -> EncoderCount {
        EncoderCount(self.0.count())
    }
}

//! Pins of the boards, which share them; docs/wiring.md draws the wiring.
//!
//! | signal          | pin      | peripheral             | served by                        |
//! |-----------------|----------|------------------------|----------------------------------|
//! | strain bridge   | PC0 (A5) | ADC1 channel 10        | DMA2 stream 0 channel 0          |
//! | pressure sensor | PC1 (A4) | ADC1 channel 11        | DMA2 stream 0 channel 0          |
//! | encoder A, B    | PA0, PA1 | TIM5 channels 1, 2     | 32-bit counter, encoder mode 3   |
//! | valve           | PA4 (A2) | DAC channel 1          | written by the tick              |
//! | link TX         | PA2      | USART2 (the ST-LINK's) | DMA1 stream 6 channel 4          |
//! | link RX         | PA3      | USART2                 | DMA1 stream 5 channel 4          |
//! | user button B1  | PC13     | input, low if pressed  | read by the tick                 |
//! | emergency stop  | PB10 (D6), PA8 (D7) | inputs, low if open | read by the tick         |
//! | valve in the port | PB5 (D4) | output, alternates   | written by the tick              |
//! | status lamp     | PA5 (D13, LD2) | output, high is lit | written by the tick           |
//!
//! The update event of TIM2 starts a scan of the ADC; after sixteen of them DMA2 stream 0 requests
//! the interrupt of the tick. TIM3 requests the interrupt of the link task every millisecond.

use stm32f4xx_hal::gpio::{
    Alternate, Analog, Input, Output, PA0, PA1, PA2, PA3, PA4, PA5, PA8, PB5, PB10, PC0, PC1, PC13,
};
use stm32f4xx_hal::pac::{GPIOA, GPIOB, GPIOC};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;

/// Strain bridge.
pub type BridgePin = PC0<Analog>;
/// Pressure sensor.
pub type PressurePin = PC1<Analog>;
/// Encoder A and B.
pub type EncoderPins = (PA0<Alternate<2>>, PA1<Alternate<2>>);
/// Valve.
pub type ValvePin = PA4<Analog>;
/// Link TX and RX.
pub type LinkPins = (PA2, PA3);
/// User button, with pull-up.
pub type ButtonPin = PC13<Input>;
/// Contacts of the emergency stop, with pull-down.
pub type StopPins = (PB10<Input>, PA8<Input>);
/// Pulses for the valve in the muscle's port.
pub type PortPin = PB5<Output>;
/// Status lamp.
pub type LampPin = PA5<Output>;

/// All pins in use, configured.
pub struct Pins {
    /// Strain bridge.
    pub bridge: BridgePin,
    /// Pressure sensor.
    pub pressure: PressurePin,
    /// Encoder A and B.
    pub encoder: EncoderPins,
    /// Valve.
    pub valve: ValvePin,
    /// Link TX and RX.
    pub link: LinkPins,
    /// User button.
    pub button: ButtonPin,
    /// Emergency stop.
    pub stop: StopPins,
    /// Valve in the muscle's port, low.
    pub port: PortPin,
    /// Status lamp, dark.
    pub lamp: LampPin,
}

impl Pins {
    /// Configures the pins.
    pub fn new(a: GPIOA, b: GPIOB, c: GPIOC, rcc: &mut Rcc) -> Pins {
        let a = a.split(rcc);
        let b = b.split(rcc);
        let c = c.split(rcc);
        Pins {
            bridge: c.pc0.into_analog(),
            pressure: c.pc1.into_analog(),
            encoder: (
                a.pa0.into_alternate().internal_pull_up(true),
                a.pa1.into_alternate().internal_pull_up(true),
            ),
            valve: a.pa4.into_analog(),
            link: (a.pa2, a.pa3),
            button: c.pc13.into_pull_up_input(),
            stop: (b.pb10.into_pull_down_input(), a.pa8.into_pull_down_input()),
            port: b.pb5.into_push_pull_output(),
            lamp: a.pa5.into_push_pull_output(),
        }
    }
}

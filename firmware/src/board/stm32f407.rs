//! A board with an STM32F405 or F407, an 8 MHz crystal, and the NUCLEO-F446RE's signals on the
//! same pins; the link needs a serial adapter of 3.3 V. Compiled, never run: measure first.

use model_core::link::Board;
use stm32f4xx_hal::gpio::{Alternate, Analog, Input, PA0, PA1, PA2, PA3, PA4, PC0, PC1, PC13};
use stm32f4xx_hal::pac::{GPIOA, GPIOC};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::{Config, Rcc};

/// What the link calls it.
pub const BOARD: Board = Board::Stm32f407;
/// The crystal.
pub const HSE_HZ: u32 = 8_000_000;
/// The fastest that an F407 runs.
pub const SYSCLK_HZ: u32 = 168_000_000;
/// Makes microseconds of the timers' 84 MHz.
pub const TICK_PRESCALER: u32 = 84;

/// Where the clock comes from.
pub fn clock_source() -> Config {
    Config::hse(HSE_HZ.Hz())
}

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

/// The button.
pub struct Button(PC13<Input>);

impl Button {
    /// True while it is pressed.
    pub fn is_pressed(&self) -> bool {
        self.0.is_low()
    }
}

/// Every pin that is used.
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
    /// The button.
    pub button: Button,
}

impl Pins {
    /// Sets the pins up.
    pub fn new(a: GPIOA, c: GPIOC, rcc: &mut Rcc) -> Pins {
        let a = a.split(rcc);
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
            button: Button(c.pc13.into_pull_up_input()),
        }
    }
}

//! A board with an STM32F405 or F407, and the signals on the same pins as the NUCLEO-F446RE; the
//! link needs a 3.3 V serial adapter. Its image runs on the emulated board, and has never run on a
//! real one: measure before use.
//!
//! | signal          | pin      | peripheral             | served by                        |
//! |-----------------|----------|------------------------|----------------------------------|
//! | strain bridge   | PC0 (A5) | ADC1 channel 10        | DMA2 stream 0 channel 0          |
//! | pressure sensor | PC1 (A4) | ADC1 channel 11        | DMA2 stream 0 channel 0          |
//! | encoder A, B    | PA0, PA1 | TIM5 channels 1, 2     | 32-bit counter, encoder mode 3   |
//! | valve           | PA4 (A2) | DAC channel 1, ADC1 channel 4 | written by the tick       |
//! | link TX         | PA2      | USART2                 | DMA1 stream 6 channel 4          |
//! | link RX         | PA3      | USART2                 | DMA1 stream 5 channel 4          |
//! | user button     | PC13     | input, low if pressed  | read by the tick                 |
//! | emergency stop  | PB10 (D6), PA8 (D7) | inputs, low if open | read by the tick         |
//! | enabling device | PC7 (D9) | input, low if open    | read by the tick                 |
//! | valve in the port | PB5 (D4) | output, alternates   | written by the tick              |
//! | status lamp     | PA5 (D13) | output, high is lit | written by the tick              |
//!
//! Chip and memory are in `stm32f407.x`.

use super::{Pins, Ports};
use core::ops::Range;
use stm32f4xx_hal::gpio::{
    Alternate, Analog, Input, Output, PA0, PA1, PA2, PA3, PA4, PA5, PA8, PB5, PB10, PC0, PC1, PC7,
    PC13,
};
use stm32f4xx_hal::pac::PWR;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::{Config, Rcc};

/// The board's name, as the link reports it.
pub const NAME: &str = "STM32F407";

/// Flash sectors of the settings: number, and range as offset from the start of the flash.
/// stm32f407.x keeps the program out of them.
pub const SETTINGS_SECTORS: [(u8, Range<usize>); 2] =
    [(6, 0x4_0000..0x6_0000), (7, 0x6_0000..0x8_0000)];

/// CPU clock \[Hz\], by PLL from the chip's own oscillator (HSI, 16 MHz): no plug, probe or crystal
/// can take it away. HSI is within 1 % at 25 °C, within 4 % from -10 to 85 °C (datasheet); at 4 %
/// more every clock is still within the chip's limits: CPU 150 of 168 MHz with 4 wait states of the
/// flash, APB1 37.5 of 42 MHz. From 144 MHz the divider of [`super::LINK_BAUD`] is off by 0.16 %,
/// exactly as the ST-LINK's is from its 72 MHz.
pub const SYSCLK_HZ: u32 = 144_000_000;
/// Clock of the timers on APB1 \[Hz\]: APB1 runs at SYSCLK / 4, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ / 2;

/// The clocks. The regulator's scale after a reset allows them.
pub fn clocks(_: &PWR) -> Config {
    Config::hsi().sysclk(SYSCLK_HZ.Hz())
}

/// Strain bridge.
pub type BridgePin = PC0<Analog>;
/// Pressure sensor.
pub type PressurePin = PC1<Analog>;
/// Encoder A and B.
pub type EncoderPins = (PA0<Alternate<2>>, PA1<Alternate<2>>);
/// Valve.
pub type ValvePins = PA4<Analog>;
/// Link TX and RX.
pub type LinkPins = (PA2, PA3);
/// User button, with pull-up.
pub type ButtonPin = PC13<Input>;
/// Contacts of the emergency stop, with pull-down.
pub type StopPins = (PB10<Input>, PA8<Input>);
/// Contact of the enabling device, with pull-down.
pub type EnablingPin = PC7<Input>;
/// Pulses for the valve in the muscle's port.
pub type PortPin = PB5<Output>;
/// Status lamp.
pub type LampPin = PA5<Output>;

/// Configures the pins.
pub fn pins(ports: Ports, rcc: &mut Rcc) -> Pins {
    let a = ports.a.split(rcc);
    let b = ports.b.split(rcc);
    let c = ports.c.split(rcc);
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
        enabling: c.pc7.into_pull_down_input(),
        port: b.pb5.into_push_pull_output(),
        lamp: a.pa5.into_push_pull_output(),
    }
}

//! A board with an STM32F405 or F407, an 8 MHz crystal, and the signals on the same pins as the
//! NUCLEO-F446RE; the link needs a 3.3 V serial adapter. Compiled but never run: measure before
//! use.

pub use super::pins::*;
use core::ops::Range;
use model_core::link::Board;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// The board's name in the link protocol.
pub const BOARD: Board = Board::Stm32f407;
/// Frequency at HSE \[Hz\]: the crystal.
pub const HSE_HZ: u32 = 8_000_000;
/// CPU clock \[Hz\]: the maximum of an F407.
pub const SYSCLK_HZ: u32 = 168_000_000;
/// Prescaler of the tick timer: 84 MHz to 1 MHz.
pub const TICK_PRESCALER: u32 = 84;
/// Flash sectors of the settings: number, and range as offset from the start of the flash.
/// memory.x keeps the program out of them.
pub const SETTINGS_SECTORS: [(u8, Range<usize>); 2] =
    [(6, 0x4_0000..0x6_0000), (7, 0x6_0000..0x8_0000)];

/// The clock source.
pub fn clock_source() -> Config {
    Config::hse(HSE_HZ.Hz())
}

//! A board with an STM32F405 or F407, an 8 MHz crystal, and the NUCLEO-F446RE's signals on the
//! same pins; the link needs a serial adapter of 3.3 V. Compiled, never run: measure first.

pub use super::pins::*;
use model_core::link::Board;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

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

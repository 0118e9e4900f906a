//! NUCLEO-F446RE: the clock comes from its ST-LINK.

pub use super::pins::*;
use model_core::link::Board;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// What the link calls it.
pub const BOARD: Board = Board::NucleoF446re;
/// The ST-LINK's clock output drives HSE.
pub const HSE_HZ: u32 = 8_000_000;
/// The fastest that an F446 runs, with over-drive.
pub const SYSCLK_HZ: u32 = 180_000_000;
/// Makes microseconds of the timers' 90 MHz.
pub const TICK_PRESCALER: u32 = 90;

/// Where the clock comes from.
pub fn clock_source() -> Config {
    Config::hse(HSE_HZ.Hz()).bypass_hse_oscillator()
}

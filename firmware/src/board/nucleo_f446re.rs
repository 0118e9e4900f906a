//! NUCLEO-F446RE: STM32F446RET6, clocked by its ST-LINK.

pub use super::pins::*;
use core::ops::Range;
use model_core::link::Board;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// The board's name in the link protocol.
pub const BOARD: Board = Board::NucleoF446re;
/// Frequency at HSE \[Hz\]: the clock output of the ST-LINK.
pub const HSE_HZ: u32 = 8_000_000;
/// CPU clock \[Hz\]: the maximum of an F446, with over-drive.
pub const SYSCLK_HZ: u32 = 180_000_000;
/// Prescaler of the tick timer: 90 MHz to 1 MHz.
pub const TICK_PRESCALER: u32 = 90;
/// Flash sectors of the settings: number, and range as offset from the start of the flash.
/// memory.x keeps the program out of them.
pub const SETTINGS_SECTORS: [(u8, Range<usize>); 2] =
    [(6, 0x4_0000..0x6_0000), (7, 0x6_0000..0x8_0000)];

/// The clock source.
pub fn clock_source() -> Config {
    Config::hse(HSE_HZ.Hz()).bypass_hse_oscillator()
}

//! NUCLEO-F446RE: STM32F446RET6.

pub use super::pins::*;
use core::ops::Range;
use model_core::link::Board;

/// The board's name in the link protocol.
pub const BOARD: Board = Board::NucleoF446re;
/// Flash sectors of the settings: number, and range as offset from the start of the flash.
/// memory.x keeps the program out of them.
pub const SETTINGS_SECTORS: [(u8, Range<usize>); 2] =
    [(6, 0x4_0000..0x6_0000), (7, 0x6_0000..0x8_0000)];

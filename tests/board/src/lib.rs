//! An emulated board with an STM32F446, F407 or F411: the unmodified firmware runs on the PC.
//!
//! A [`Board`] takes the ELF file that is flashed to a real board. The caller drives the pins,
//! reads the DAC and the serial link, and advances time; so a plant on the PC is coupled in
//! lockstep:
//!
//! ```no_run
//! use emulated_board::{Board, pin};
//! let elf = std::fs::read("firmware.elf").unwrap();
//! let mut board = Board::new(&elf).unwrap();
//! for step in 1..=1000 {
//!     board.set_analog(pin('C', 0), 1.65);
//!     board.set_encoder(step);
//!     board.run_until(step as u64 * 1_000_000);
//!     println!("{} V", board.dac_volts(1));
//! }
//! assert!(board.errors().is_empty(), "{}", board.error_report());
//! ```
//!
//! Runs are deterministic: two runs with the same inputs execute the same instructions at the same
//! times. What a real board silently ignores (a peripheral without its clock, a pin with the wrong
//! function) has no effect here either, and is listed by [`Board::errors`].
//!
//! Each instruction takes one cycle. On a real core most take one to three, so that durations of
//! code are lower bounds; times that hardware determines (timers, conversions, bytes) are exact.

mod adc;
mod ads1220;
mod board;
mod chip;
mod cost;
mod counters;
mod cpu;
mod dac;
mod dma;
mod elf;
mod engine;
mod errors;
mod exceptions;
mod flash;
mod gpio;
mod iwdg;
mod log;
mod nvic;
mod pin;
mod pwr;
mod rcc;
mod rtc;
mod scb;
mod soc;
mod spi;
mod tim;
mod time;
mod usart;

pub use adc::Imperfection;
pub use ads1220::ConverterFaults;
pub use board::{Board, LinkByte, Reset};
pub use chip::Chip;
pub use cost::Cost;
pub use cpu::ExceptionEvent;
pub use elf::BadElf;
pub use errors::BoardError;
pub use pin::{Pin, pin};
pub use rcc::{Oscillators, ResetCause};
pub use soc::DacEvent;

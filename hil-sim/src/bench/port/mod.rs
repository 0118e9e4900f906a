//! Where a board is: at a serial port, or emulated in a process.

pub mod emulated;
pub mod serial;

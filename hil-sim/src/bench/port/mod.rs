//! Where a controller runs: in this program, or on a board at a serial port or in an emulator.

pub mod client;
pub mod emulated;
pub mod in_process;
#[cfg(feature = "serial")]
pub mod serial;

use crate::bench::tick::Tick;
use crate::error::BadInput;
use model_core::io::{Output, Sensors};

/// A controller in the closed loop, which ticks every 10 ms.
pub trait ControllerPort {
    /// Why a tick may fail.
    type Error: From<BadInput>;

    /// One tick of the controller.
    ///
    /// # Errors
    /// The controller no longer answers.
    fn tick(&mut self, sensors: &Sensors) -> Result<Output, Self::Error>;

    /// Takes note of a tick with the plant's state, after [`ControllerPort::tick`].
    ///
    /// # Errors
    /// The run cannot go on, for example because its record cannot be written.
    fn observe(&mut self, tick: Tick) -> Result<(), Self::Error>;
}

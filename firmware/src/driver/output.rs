//! A digital output: the pulses for the valve in the muscle's port, or the status lamp.

use core::convert::Infallible;
use embedded_hal::digital::{OutputPin, PinState};

/// An output on its pin.
pub struct Output<P>(pub P);

impl<P: OutputPin<Error = Infallible>> Output<P> {
    /// Drives the pin high or low.
    pub fn set(&mut self, high: bool) {
        let Ok(()) = self.0.set_state(PinState::from(high));
    }
}

//! A digital output: the pulses for the valve in the muscle's port, or the status lamp.

use embedded_hal::digital::{OutputPin, PinState};

/// An output on its pin.
pub struct Output<P>(pub P);

impl<P: OutputPin> Output<P> {
    /// Drives the pin high or low. A pin that cannot be driven stays as it is: the valve in the
    /// port then closes.
    pub fn set(&mut self, high: bool) {
        let _ = self.0.set_state(PinState::from(high));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::digital::{Mock, State, Transaction};

    #[test]
    fn level_is_that_of_the_argument() {
        let mut pin = Mock::new(&[Transaction::set(State::High), Transaction::set(State::Low)]);
        let mut output = Output(pin.clone());
        output.set(true);
        output.set(false);
        pin.done();
    }
}

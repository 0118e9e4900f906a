//! The user button: connects its pin to ground while it is pressed.

use embedded_hal::digital::InputPin;

/// The button on its pin, which has a pull-up.
pub struct Button<P>(pub P);

impl<P: InputPin> Button<P> {
    /// True while the button is pressed; not debounced. An input that cannot be read is a button
    /// that is not pressed: a press may start assistance.
    pub fn is_pressed(&mut self) -> bool {
        self.0.is_low().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::MockError;
    use embedded_hal_mock::eh1::digital::{Mock, State, Transaction};
    use std::io::ErrorKind;

    extern crate std;

    #[test]
    fn low_is_pressed_and_an_error_is_not() {
        let mut pin = Mock::new(&[
            Transaction::get(State::Low),
            Transaction::get(State::High),
            Transaction::get(State::Low).with_error(MockError::Io(ErrorKind::Other)),
        ]);
        let mut button = Button(pin.clone());
        let seen = [(); 3].map(|()| button.is_pressed());
        assert_eq!(seen, [true, false, false]);
        pin.done();
    }
}

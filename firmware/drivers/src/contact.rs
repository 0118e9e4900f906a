//! A contact that connects its pin to 3.3 V while it is closed.

use embedded_hal::digital::InputPin;

/// The contact on a pin with a pull-down.
pub struct Contact<P>(pub P);

impl<P: InputPin> Contact<P> {
    /// True while it is closed; false if its input cannot be read. Not debounced.
    pub fn is_closed(&mut self) -> bool {
        self.0.is_high().unwrap_or(false)
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
    fn high_is_closed_and_an_error_is_open() {
        let failed = Transaction::get(State::High).with_error(MockError::Io(ErrorKind::Other));
        let mut pin = Mock::new(&[
            Transaction::get(State::High),
            Transaction::get(State::Low),
            failed,
        ]);
        let mut contact = Contact(pin.clone());
        assert_eq!([(); 3].map(|()| contact.is_closed()), [true, false, false]);
        pin.done();
    }
}

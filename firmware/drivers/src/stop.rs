//! The contacts of the emergency stop: each connects its pin to 3.3 V while it is closed.

use embedded_hal::digital::InputPin;

/// The contacts on a pair of pins, which have pull-downs.
pub struct Stop<P>(pub P);

impl<A: InputPin, B: InputPin> Stop<(A, B)> {
    /// True for each contact that is open, or whose input cannot be read; not debounced.
    pub fn open(&mut self) -> [bool; 2] {
        let (first, second) = &mut self.0;
        [
            first.is_low().unwrap_or(true),
            second.is_low().unwrap_or(true),
        ]
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
    fn each_contact_is_read_and_an_error_is_an_open_one() {
        let failed = Transaction::get(State::High).with_error(MockError::Io(ErrorKind::Other));
        let get = Transaction::get;
        let mut first = Mock::new(&[get(State::High), get(State::Low), get(State::High)]);
        let mut second = Mock::new(&[get(State::Low), get(State::High), failed]);
        let mut stop = Stop((first.clone(), second.clone()));
        let seen = [(); 3].map(|()| stop.open());
        assert_eq!(seen, [[false, true], [true, false], [false, true]]);
        first.done();
        second.done();
    }
}

//! The contacts of the emergency stop: each connects its pin to 3.3 V while it is closed.

use core::convert::Infallible;
use embedded_hal::digital::InputPin;

/// The contacts on a pair of pins, which have pull-downs.
pub struct Stop<P>(pub P);

impl<A, B> Stop<(A, B)>
where
    A: InputPin<Error = Infallible>,
    B: InputPin<Error = Infallible>,
{
    /// True for each contact that is open; not debounced.
    pub fn open(&mut self) -> [bool; 2] {
        let (first, second) = &mut self.0;
        let (Ok(first), Ok(second)) = (first.is_low(), second.is_low());
        [first, second]
    }
}

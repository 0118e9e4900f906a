//! The user button: connects its pin to ground while it is pressed.

use core::convert::Infallible;
use embedded_hal::digital::InputPin;

/// The button on its pin, which has a pull-up.
pub struct Button<P>(pub P);

impl<P: InputPin<Error = Infallible>> Button<P> {
    /// True while the button is pressed; not debounced.
    pub fn is_pressed(&mut self) -> bool {
        let Ok(low) = self.0.is_low();
        low
    }
}

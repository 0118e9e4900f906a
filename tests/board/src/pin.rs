//! Names of the pins of the chip.

use std::fmt;

/// One pin of ports A to H.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pin {
    /// 0 for port A.
    pub port: u8,
    /// 0 to 15.
    pub number: u8,
}

/// `pin('A', 5)` is PA5. Panics if the pin does not exist.
pub const fn pin(port: char, number: u8) -> Pin {
    assert!(port >= 'A' && port <= 'H' && number < 16);
    Pin {
        port: port as u8 - b'A',
        number,
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "P{}{}", char::from(b'A' + self.port), self.number)
    }
}

impl fmt::Debug for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

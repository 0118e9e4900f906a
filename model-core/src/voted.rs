//! Memory that survives a flipped bit: three copies, of which two that agree are right.

use crate::safety::{SafetyFunction, Switches};

/// A value in three copies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voted<T>([T; 3]);

impl<T: Copy + PartialEq> Voted<T> {
    /// Three copies of `value`.
    pub const fn new(value: T) -> Voted<T> {
        Voted([value; 3])
    }

    /// Sets all copies.
    pub fn set(&mut self, value: T) {
        for copy in &mut self.0 {
            *copy = value;
        }
    }

    /// The value that two copies agree on; the first copy where all differ (see
    /// [`Voted::is_intact`]).
    pub fn get(&self) -> &T {
        let [a, b, c] = &self.0;
        if a != b && b == c { b } else { a }
    }

    /// True where all copies agree. NaN agrees with nothing, and has no place here.
    pub fn is_intact(&self) -> bool {
        let [a, b, c] = &self.0;
        a == b && b == c
    }

    /// True where at least two copies agree.
    pub fn is_known(&self) -> bool {
        let [a, b, c] = &self.0;
        a == b || b == c || a == c
    }

    /// As [`Voted::get`] with its vote; the first copy, right or wrong, without it.
    pub(crate) fn get_as(&self, switches: Switches) -> &T {
        let [first, ..] = &self.0;
        if switches.on(SafetyFunction::MemoryVote) {
            self.get()
        } else {
            first
        }
    }

    /// The copies, to damage one.
    #[cfg(feature = "fault-injection")]
    pub fn copies(&mut self) -> &mut [T; 3] {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_damaged_copy_is_outvoted_and_noticed() {
        for damaged in 0..3 {
            let mut voted = Voted::new(7);
            assert!(voted.is_intact() && voted.is_known());
            voted.0[damaged] = 8;
            assert_eq!(*voted.get(), 7, "copy {damaged}");
            assert!(!voted.is_intact() && voted.is_known());
        }
        assert!(!Voted([1, 2, 3]).is_known());
    }
}

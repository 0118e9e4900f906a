//! Memory that tolerates a flipped bit: three copies with a majority vote.

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
    /// [`Voted::has_majority`]).
    pub fn get(&self) -> &T {
        let [a, b, c] = &self.0;
        if a != b && b == c { b } else { a }
    }

    /// True if all copies agree. A value that contains NaN never agrees.
    pub fn is_intact(&self) -> bool {
        let [a, b, c] = &self.0;
        a == b && b == c
    }

    /// True if at least two copies agree.
    pub fn has_majority(&self) -> bool {
        let [a, b, c] = &self.0;
        a == b || b == c || a == c
    }

    /// The copies, as the fault campaign reads them.
    pub fn copies(&self) -> &[T; 3] {
        &self.0
    }

    /// The copies, for the fault campaign to damage one. The controller never writes a single one.
    pub fn copies_mut(&mut self) -> &mut [T; 3] {
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
            assert!(voted.is_intact() && voted.has_majority());
            voted.copies_mut()[damaged] = 8;
            assert_eq!(*voted.get(), 7, "copy {damaged}");
            assert!(!voted.is_intact() && voted.has_majority());
        }
        assert!(!Voted([1, 2, 3]).has_majority());
    }
}

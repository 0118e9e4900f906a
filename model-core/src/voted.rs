//! Memory that tolerates flipped bits: four copies, of which those that agree tell.

/// Copies: two that are damaged in the same way are not taken for the value.
pub const COPIES: usize = 4;

/// A value in several copies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voted<T>([T; COPIES]);

impl<T: Copy + PartialEq> Voted<T> {
    /// Copies of `value`.
    pub const fn new(value: T) -> Voted<T> {
        Voted([value; COPIES])
    }

    /// Sets all copies. Out of line, so that a value is made once and copied.
    #[inline(never)]
    pub fn set(&mut self, value: T) {
        for copy in &mut self.0 {
            *copy = value;
        }
    }

    /// The value on which most copies agree, none if that is none or not one; and whether a copy is
    /// damaged. A value that contains NaN agrees with nothing.
    pub fn recall(&self) -> (Option<&T>, bool) {
        if self.is_intact() {
            (Some(self.get()), false)
        } else {
            (self.elected(), true)
        }
    }

    /// Out of line, as it is seldom needed.
    #[inline(never)]
    fn elected(&self) -> Option<&T> {
        let votes = |value: &T| self.0.iter().filter(|copy| agree(*copy, value)).count();
        let most = self.0.iter().map(votes).max().unwrap_or(0);
        let mut elected = self.0.iter().filter(|copy| votes(copy) == most);
        let value = elected.next()?;
        (most > 1 && elected.all(|copy| agree(copy, value))).then_some(value)
    }

    /// The value as it was set, if nothing has damaged the first copy since then.
    pub fn get(&self) -> &T {
        let [first, ..] = &self.0;
        first
    }

    fn is_intact(&self) -> bool {
        let [first, others @ ..] = &self.0;
        others.iter().all(|copy| agree(copy, first))
    }

    /// The copies, as the fault campaign reads them.
    pub fn copies(&self) -> &[T; COPIES] {
        &self.0
    }

    /// The copies, for the fault campaign to damage them. The controller never writes a single one.
    pub fn copies_mut(&mut self) -> &mut [T; COPIES] {
        &mut self.0
    }
}

/// Whether two copies agree; out of line, as it is large and often needed.
#[inline(never)]
fn agree<T: PartialEq>(one: &T, other: &T) -> bool {
    one == other
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damaged_copy_is_outvoted_and_noticed() {
        assert_eq!(Voted::new(7).recall(), (Some(&7), false));
        for copy in 0..COPIES {
            let mut voted = Voted::new(7);
            voted.copies_mut()[copy] = 8;
            assert_eq!(voted.recall(), (Some(&7), true), "{copy}");
        }
    }

    /// Of two copies that are damaged in the same way nobody knows which are right.
    #[test]
    fn the_largest_number_that_agrees_tells_or_none() {
        assert_eq!(Voted([7, 1, 2, 7]).recall(), (Some(&7), true));
        assert_eq!(Voted([1, 7, 7, 1]).recall(), (None, true));
        assert_eq!(Voted([1, 2, 3, 4]).recall(), (None, true));
    }
}

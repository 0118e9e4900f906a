//! Memory that tolerates flipped bits: four copies, one of them inverted, of which those that agree
//! tell.

use crate::words::invert;
use serde::Serialize;

/// Copies as they are.
pub const PLAIN: usize = 3;
/// All copies: two that are damaged in the same way are not taken for the value.
pub const COPIES: usize = PLAIN + 1;

/// A value in several copies, the last of them inverted in at most `N` words.
///
/// What makes all copies alike, such as zeros or ones everywhere, does not make the inverted one
/// agree with the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voted<T, const N: usize> {
    plain: [T; PLAIN],
    inverted: [u32; N],
}

impl<T: Copy + PartialEq + Serialize, const N: usize> Voted<T, N> {
    /// Copies of `value`. Out of line, as it is seldom needed.
    #[inline(never)]
    pub fn new(value: T) -> Voted<T, N> {
        let mut inverted = [0; N];
        invert(&value, &mut inverted);
        Voted {
            plain: [value; PLAIN],
            inverted,
        }
    }

    /// Sets all copies. Out of line, so that a value is made once and copied.
    #[inline(never)]
    pub fn set(&mut self, value: T) {
        for copy in &mut self.plain {
            *copy = value;
        }
        self.set_inverted(&value);
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
    ///
    /// A value for which the inverted copy does not vote is believed only if that differs in a
    /// single word, as by a flipped bit of its own.
    #[inline(never)]
    fn elected(&self) -> Option<&T> {
        let [a, b, c] = &self.plain;
        let is_inverted = |copy: &&T| agree(*copy, *copy) && self.differing_words(copy) == 0;
        let value = if agree(a, b) || agree(a, c) {
            a
        } else if agree(b, c) {
            b
        } else {
            return self.plain.iter().find(is_inverted);
        };
        let mut others = self.plain.iter().filter(|copy| !agree(*copy, value));
        let is_one = !others.any(|copy| is_inverted(&copy));
        (is_one && self.differing_words(value) <= 1).then_some(value)
    }

    /// The value as it was set, if nothing has damaged the first copy since then.
    pub fn get(&self) -> &T {
        let [first, ..] = &self.plain;
        first
    }

    fn is_intact(&self) -> bool {
        let [first, others @ ..] = &self.plain;
        others.iter().all(|copy| agree(copy, first)) && self.differing_words(first) == 0
    }

    /// Words of the inverted copy that are not those of this value.
    #[inline(never)]
    fn differing_words(&self, value: &T) -> usize {
        let mut inverted = [0; N];
        let count = invert(value, &mut inverted);
        let pairs = inverted.iter().zip(&self.inverted).take(count);
        pairs.filter(|(one, other)| one != other).count()
    }

    /// The copies that are not inverted, as the fault campaign reads them.
    pub fn plain(&self) -> &[T; PLAIN] {
        &self.plain
    }

    /// Those copies, for the fault campaign to damage them. The controller never writes a single
    /// one.
    pub fn plain_mut(&mut self) -> &mut [T; PLAIN] {
        &mut self.plain
    }

    /// Sets the inverted copy only: the fault campaign damages it so.
    pub fn set_inverted(&mut self, value: &T) {
        invert(value, &mut self.inverted);
    }

    /// The inverted copy, for the fault campaign to damage it.
    pub fn inverted_mut(&mut self) -> &mut [u32; N] {
        &mut self.inverted
    }
}

/// Whether two copies agree; out of line, as it is large and often needed.
#[inline(never)]
fn agree<T: PartialEq>(one: &T, other: &T) -> bool {
    one == other
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Words that the value has; all must fit.
    pub fn words<T: Serialize, const N: usize>(voted: &Voted<T, N>, value: &T) -> (usize, usize) {
        (invert(value, &mut voted.inverted.clone()), N)
    }

    fn voted(value: u32) -> Voted<[u32; 3], 3> {
        Voted::new([value; 3])
    }

    #[test]
    fn a_damaged_copy_is_outvoted_and_noticed() {
        let intact = voted(7);
        assert_eq!(intact.recall(), (Some(&[7; 3]), false));
        for copy in 0..PLAIN {
            let mut voted = intact;
            voted.plain_mut()[copy] = [8; 3];
            assert_eq!(voted.recall(), (Some(&[7; 3]), true), "{copy}");
        }
        for bit in 0..32 {
            let mut voted = intact;
            voted.inverted_mut()[bit % 3] ^= 1 << bit;
            assert_eq!(voted.recall(), (Some(&[7; 3]), true), "{bit}");
        }
    }

    /// Of two copies that are damaged in the same way nobody knows which are right, also if one of
    /// them is the inverted one.
    #[test]
    fn the_largest_number_that_agrees_tells_or_none() {
        let with = |plain: [u32; PLAIN], inverted: u32| Voted {
            plain: plain.map(|value| [value; 3]),
            inverted: [!inverted; 3],
        };
        let seven = Some(&[7; 3]);
        assert_eq!(with([7, 1, 2], 7).recall(), (seven, true));
        for (plain, inverted) in [
            ([1, 7, 7], 1),
            ([1, 1, 7], 7),
            ([1, 7, 1], 7),
            ([1, 2, 3], 4),
            ([1, 2, 3], 1),
        ] {
            let expected = (plain, inverted) == ([1, 2, 3], 1);
            let recalled = with(plain, inverted);
            let one = [1; 3];
            let value = expected.then_some(&one);
            assert_eq!(recalled.recall(), (value, true), "{plain:?} {inverted}");
        }
        // Also if they differ in a single word.
        let mut voted = voted(7);
        voted.plain_mut()[0][1] = 1;
        voted.plain_mut()[1][1] = 1;
        assert_eq!(voted.recall(), (None, true));
    }

    #[test]
    fn no_number_agrees_with_nothing() {
        let voted: Voted<_, 2> = Voted::new([1.0, f32::NAN]);
        assert_eq!(voted.recall(), (None, true));
    }

    /// All copies are overwritten with the same, or three of them.
    #[test]
    fn what_makes_all_copies_alike_is_no_value() {
        for pattern in [0, u32::MAX, 0xAAAA_AAAA] {
            let mut wiped = voted(7);
            *wiped.plain_mut() = [[pattern; 3]; PLAIN];
            assert_eq!(wiped.recall(), (None, true), "{pattern}: the plain ones");
            *wiped.inverted_mut() = [pattern; 3];
            assert_eq!(wiped.recall(), (None, true), "{pattern}: all");
            wiped.plain_mut()[0] = [7; 3];
            assert_eq!(wiped.recall(), (None, true), "{pattern}: all but one");
        }
    }
}

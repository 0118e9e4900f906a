//! Memory that tolerates flipped bits: three copies, and a checksum that tells what is right where
//! they differ.

use crate::settings::{ENCODED_LEN_MAX, SettingsValues};
use serde::Serialize;

/// A value in three copies, with a checksum of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voted<T> {
    copies: [T; 3],
    checksum: u32,
}

impl<T: Copy + PartialEq + Serialize> Voted<T> {
    /// Three copies of `value`.
    pub fn new(value: T) -> Voted<T> {
        Voted {
            copies: [value; 3],
            checksum: checksum(&value),
        }
    }

    /// Sets all copies.
    pub fn set(&mut self, value: T) {
        // What stays as it is needs no new checksum.
        if self.copies != [value; 3] {
            *self = Voted::new(value);
        }
    }

    /// The value: a copy that has the checksum, else what two copies agree on; none where there is
    /// neither.
    pub fn recall(&self) -> Option<T> {
        let [a, b, c] = &self.copies;
        if self.is_intact() {
            return Some(*a);
        }
        let right = self.copies.iter().find(|copy| self.is_right(copy));
        let agreed = if a == b || a == c { Some(a) } else { None };
        let agreed = agreed.or(if b == c { Some(b) } else { None });
        right.or(agreed).copied()
    }

    /// The value as it was set, if nothing has damaged the first copy since then.
    pub fn get(&self) -> &T {
        let [first, ..] = &self.copies;
        first
    }

    /// True if all copies agree. A value that contains NaN never agrees.
    pub fn is_intact(&self) -> bool {
        let [a, b, c] = &self.copies;
        a == b && b == c
    }

    fn is_right(&self, copy: &T) -> bool {
        checksum(copy) == self.checksum
    }

    /// The copies, as the fault campaign reads them.
    pub fn copies(&self) -> &[T; 3] {
        &self.copies
    }

    /// The copies, for the fault campaign to damage them. The controller never writes a single one.
    pub fn copies_mut(&mut self) -> &mut [T; 3] {
        &mut self.copies
    }
}

impl Voted<SettingsValues> {
    /// What the copies agree on bit by bit, if that has the checksum.
    pub fn mended(&self) -> Option<SettingsValues> {
        let mut encoded = [[0; ENCODED_LEN_MAX]; 3];
        for (copy, buffer) in self.copies.iter().zip(&mut encoded) {
            postcard::to_slice(copy, buffer).ok()?;
        }
        let [mut mended, second, third] = encoded;
        for ((a, b), c) in mended.iter_mut().zip(&second).zip(&third) {
            *a = (*a & b) | (b & c) | (*a & c);
        }
        let (values, _) = postcard::take_from_bytes(&mended).ok()?;
        self.is_right(&values).then_some(values)
    }
}

/// FNV-1a of the value's bytes (Fowler, Noll, Vo: draft-eastlake-fnv). Each step is invertible, so
/// that no change of a single byte leaves it as it is. Out of line: it is large.
#[inline(never)]
fn checksum(value: &impl Serialize) -> u32 {
    let mut buffer = [0; ENCODED_LEN_MAX];
    // Every value fits.
    let encoded = postcard::to_slice(value, &mut buffer).unwrap_or_default();
    let step = |sum: u32, byte: &u8| (sum ^ u32::from(*byte)).wrapping_mul(0x0100_0193);
    encoded.iter().fold(0x811C_9DC5, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn damaged(copies: [u32; 3]) -> Voted<u32> {
        let mut voted = Voted::new(7);
        *voted.copies_mut() = copies;
        assert!(!voted.is_intact());
        voted
    }

    #[test]
    fn one_damaged_copy_is_outvoted_and_noticed() {
        assert!(Voted::new(7).is_intact());
        for copies in [[8, 7, 7], [7, 8, 7], [7, 7, 8]] {
            assert_eq!(damaged(copies).recall(), Some(7), "{copies:?}");
        }
    }

    /// The same bit in two copies, or others, leave the third right, whichever that is.
    #[test]
    fn where_two_copies_are_damaged_the_third_is_taken() {
        for others in [8, 9] {
            for copies in [[7, 8, others], [8, 7, others], [8, others, 7]] {
                assert_eq!(damaged(copies).recall(), Some(7), "{copies:?}");
            }
        }
    }

    #[test]
    fn other_bits_in_all_copies_of_the_settings_are_mended() {
        let values = SettingsValues::reference();
        let mut voted = Voted::new(values);
        let [a, b, c] = voted.copies_mut();
        (a.gain, b.load_kg, c.suspect_ticks) = (-20.0, 0.0, 2);
        assert_eq!((voted.recall(), voted.mended()), (None, Some(values)));
        // The same bit in two is not.
        voted.copies_mut()[1].gain = -20.0;
        assert_eq!(voted.mended(), None);
    }

    /// A checksum that is damaged with a copy leaves two that agree.
    #[test]
    fn without_a_checksum_two_copies_tell_and_without_those_nothing_does() {
        let mut voted = Voted::new(7);
        voted.checksum ^= 1;
        assert!(voted.is_intact());
        for copy in 0..3 {
            let mut voted = voted;
            voted.copies_mut()[copy] = 8;
            assert_eq!(voted.recall(), Some(7));
        }
        *voted.copies_mut() = [7, 8, 9];
        assert_eq!(voted.recall(), None);
        voted.set(5);
        assert_eq!(voted, Voted::new(5));
    }
}

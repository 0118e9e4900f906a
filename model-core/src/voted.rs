//! Memory that tolerates flipped bits: three copies, and a checksum that tells what is right where
//! they differ.

use crate::settings::ENCODED_LEN_MAX;
use postcard::ser_flavors::Flavor;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A value in three copies, with a checksum of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voted<T> {
    copies: [T; 3],
    checksum: u32,
}

impl<T: Copy + PartialEq + Serialize + DeserializeOwned> Voted<T> {
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

    /// The value: a copy that has the checksum, else what two copies agree on, else what they agree
    /// on bit by bit if that has the checksum; none where there is neither.
    pub fn recall(&self) -> Option<T> {
        let [a, b, c] = &self.copies;
        if self.is_intact() {
            return Some(*a);
        }
        let right = self.copies.iter().find(|copy| self.is_right(copy));
        let agreed = if a == b || a == c { Some(a) } else { None };
        let agreed = agreed.or(if b == c { Some(b) } else { None });
        right.or(agreed).copied().or_else(|| self.mended())
    }

    /// What the copies agree on bit by bit, if that has the checksum. Out of line, so that it takes
    /// no stack from the ticks that do not need it.
    #[inline(never)]
    fn mended(&self) -> Option<T> {
        let mut encoded = [[0; ENCODED_LEN_MAX]; 3];
        for (copy, buffer) in self.copies.iter().zip(&mut encoded) {
            postcard::to_slice(copy, buffer).ok()?;
        }
        let [mut mended, second, third] = encoded;
        for ((a, b), c) in mended.iter_mut().zip(&second).zip(&third) {
            *a = (*a & b) | (b & c) | (*a & c);
        }
        let value = postcard::from_bytes(&mended).ok()?;
        self.is_right(&value).then_some(value)
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

/// FNV-1a of the value's bytes (Fowler, Noll, Vo: draft-eastlake-fnv). Each step is invertible, so
/// that no change of a single byte leaves it as it is.
struct Fnv1a(u32);

impl Flavor for Fnv1a {
    type Output = u32;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.0 = (self.0 ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<u32> {
        Ok(self.0)
    }
}

fn checksum(value: &impl Serialize) -> u32 {
    // Nothing in it can fail.
    postcard::serialize_with_flavor(value, Fnv1a(0x811C_9DC5)).unwrap_or_default()
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
    fn other_bits_in_all_copies_are_mended() {
        assert_eq!(damaged([6, 5, 3]).recall(), Some(7));
        // Two bits in the same place are not.
        assert_eq!(damaged([6, 4, 3]).recall(), None);
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

//! The encoder of the muscle.

use model_core::signal::EncoderCount;

/// Counts every edge of A and B; `embedded-hal` 1.0 has no such trait.
pub trait EdgeCounter {
    /// The counter's bits; a narrower one than 32 wraps earlier.
    const BITS: u32;

    /// The edges counted, modulo 2 to the power of [`EdgeCounter::BITS`].
    fn edges(&self) -> u32;
}

/// The encoder, with a position of 32 bits that wraps, whatever the width of its counter.
pub struct Encoder<C> {
    counter: C,
    position: u32,
}

impl<C: EdgeCounter> Encoder<C> {
    /// The present position is that of the counter.
    pub fn new(counter: C) -> Encoder<C> {
        let position = counter.edges();
        Encoder { counter, position }
    }

    /// The position. Between two calls the encoder must move by less than half the counter's range:
    /// 32 768 edges of 12.5 µs are 0.4 m in a tick.
    pub fn read(&mut self) -> EncoderCount {
        let unused = 32 - C::BITS;
        let moved = self.counter.edges().wrapping_sub(self.position) << unused;
        let moved = (moved as i32) >> unused;
        self.position = self.position.wrapping_add_signed(moved);
        EncoderCount(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::Cell;

    struct Counter<'a, const BITS: u32>(&'a Cell<i64>);

    impl<const BITS: u32> EdgeCounter for Counter<'_, BITS> {
        const BITS: u32 = BITS;

        fn edges(&self) -> u32 {
            (self.0.get() as u64 & ((1 << BITS) - 1)) as u32
        }
    }

    /// Positions that a counter of this width reports for these, one after the other.
    fn seen<const BITS: u32, const N: usize>(positions: [i64; N]) -> [u32; N] {
        let position = Cell::new(0);
        let mut encoder = Encoder::new(Counter::<BITS>(&position));
        positions.map(|at| {
            position.set(at);
            encoder.read().0
        })
    }

    #[test]
    fn width_of_the_counter_does_not_matter() {
        let positions = [1, -1, -30_000, -60_000, -30_000, 0, 32_000, 64_000, 96_000];
        let expected = positions.map(|at| at as u32);
        assert_eq!(seen::<16, 9>(positions), expected);
        assert_eq!(seen::<32, 9>(positions), expected);
    }
}

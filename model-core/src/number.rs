//! The smaller and the larger of two numbers, by libm: to the bit the same on every machine.

use num_traits::float::FloatCore;

/// `f32` on the board, `f64` in the simulator.
///
/// `min` and `max` of the core library leave open which of +0 and −0 they return, and processors
/// differ. libm's are the same code everywhere.
pub trait Number: FloatCore {
    /// The smaller of `self` and `bound`; of two zeros `bound`, of a number and a NaN the number.
    fn at_most(self, bound: Self) -> Self;

    /// The larger of `self` and `bound`; of two zeros `self`, of a number and a NaN the number.
    fn at_least(self, bound: Self) -> Self;
}

impl Number for f32 {
    #[inline]
    fn at_most(self, bound: f32) -> f32 {
        libm::fminf(self, bound)
    }

    #[inline]
    fn at_least(self, bound: f32) -> f32 {
        libm::fmaxf(self, bound)
    }
}

impl Number for f64 {
    #[inline]
    fn at_most(self, bound: f64) -> f64 {
        libm::fmin(self, bound)
    }

    #[inline]
    fn at_least(self, bound: f64) -> f64 {
        libm::fmax(self, bound)
    }
}

/// `value` limited to ±`magnitude`; zero for NaN.
pub(crate) fn limited<T: Number>(value: T, magnitude: T) -> T {
    if value.is_nan() {
        T::zero()
    } else {
        value.at_least(-magnitude).at_most(magnitude)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_of_zero_is_defined_and_a_nan_gives_way_to_a_number() {
        for (a, b) in [(0.0_f32, -0.0_f32), (-0.0, 0.0)] {
            assert_eq!(a.at_least(b).to_bits(), a.to_bits());
            assert_eq!(a.at_most(b).to_bits(), b.to_bits());
        }
        for (a, b) in [(1.0, f64::NAN), (f64::NAN, 1.0)] {
            assert_eq!((a.at_least(b), a.at_most(b)), (1.0, 1.0));
        }
        assert_eq!(limited(f32::NAN, 2.0), 0.0_f32);
        assert_eq!(
            [-9.0, 1.0, 9.0].map(|value| limited(value, 2.0)),
            [-2.0, 1.0, 2.0]
        );
    }
}

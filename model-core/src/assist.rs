//! The power assist: the finger's force (Eq 6) and the muscle's reference force (Eq 7).

use num_traits::float::FloatCore;

/// The input lever and the assist law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assist<T> {
    /// K \[-\]: reference force over finger force.
    pub gain: T,
    /// K_s \[N/m\]: stiffness of the input lever.
    pub input_stiffness_n_per_m: T,
    /// l \[m\]: length of the main lever.
    pub lever_length_m: T,
    /// d \[m\]: diameter of the pulley (the paper's Table 1 gives the muscle's under this letter).
    pub pulley_diameter_m: T,
}

impl<T: FloatCore> Assist<T> {
    /// Lever travel per unit contraction \[m\]: Ll/2d of Eq 6, with the factor as printed (the
    /// lever's geometry alone would give 2Ll/d; see the errata).
    #[inline]
    pub fn lever_travel_m(&self, initial_length_m: T) -> T {
        let two = T::one() + T::one();
        initial_length_m * self.lever_length_m / (two * self.pulley_diameter_m)
    }

    /// Finger force F_b \[N\], Eq 6: F_b = K_s(x − (Ll/2d)ε), positive when the finger lifts.
    #[inline]
    pub fn finger_force_n(&self, finger_m: T, contraction: T, initial_length_m: T) -> T {
        self.input_stiffness_n_per_m
            * (finger_m - self.lever_travel_m(initial_length_m) * contraction)
    }
}

/// Reference force F_c \[N\], Eq 7: F_c = K F_b. A controller measures F_b; it needs no lever.
#[inline]
pub fn reference_force_n<T: FloatCore>(gain: T, finger_force_n: T) -> T {
    gain * finger_force_n
}

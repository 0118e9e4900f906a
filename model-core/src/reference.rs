//! The reference pressure (Eq 8), limited.

use crate::muscle::Muscle;
use crate::number::Number;
use crate::pressure::GaugePa;

/// Reference pressure P_r (gauge), Eq 8: P_r = (F_c − γ)/(α(1−ε)² + β), limited to 0…`supply`.
///
/// Eq 8 is singular where α(1−ε)² + β → 0: the contraction is limited to 0…`contraction_max`,
/// which must lie before that. Any input that leaves no finite answer (NaN, a contraction limit
/// past the singularity) gives zero, the vented muscle; an infinite force gives the limit on its
/// side.
#[inline]
pub fn reference_pressure<T: Number>(
    muscle: &Muscle<T>,
    reference_force_n: T,
    contraction: T,
    contraction_max: T,
    supply: GaugePa<T>,
) -> GaugePa<T> {
    if contraction.is_nan() || reference_force_n.is_nan() {
        return GaugePa(T::zero());
    }
    let limited = contraction.at_most(contraction_max).at_least(T::zero());
    let area_m2 = muscle.force_per_pressure_m2(limited);
    let pressure_pa = (reference_force_n - muscle.gamma_n) / area_m2;
    // A limit below zero is none.
    if area_m2 > T::zero() && supply.0 > T::zero() {
        GaugePa(T::zero().at_least(pressure_pa).at_most(supply.0))
    } else {
        GaugePa(T::zero())
    }
}

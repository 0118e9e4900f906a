//! The rubber artificial muscle: force (Eq 1) and volume (Eq 2).
//!
//! Contraction ε = y/L is a fraction of the initial length, positive when the muscle is shorter.

use crate::number::Number;
use crate::pressure::GaugePa;
use num_traits::float::FloatCore;

/// The constants of one muscle's force, of the paper's Eq 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Muscle<T> {
    /// α \[m²\]: force per pressure that vanishes with full contraction.
    pub alpha_m2: T,
    /// β \[m²\]: force per pressure that does not depend on contraction, negative.
    pub beta_m2: T,
    /// γ \[N\]: force without pressure, negative.
    pub gamma_n: T,
    /// L \[m\]: length at ε = 0.
    pub initial_length_m: T,
}

/// The constants of one muscle's volume, of the paper's Eq 2.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Volume<T> {
    /// D₁ \[m³\].
    pub d1_m3: T,
    /// D₂ \[m³\].
    pub d2_m3: T,
    /// D₃ \[m³\]: the volume at ε = 0.
    pub d3_m3: T,
}

impl<T: Number> Muscle<T> {
    /// Contraction force F \[N\], Eq 1: F = α(1−ε)²P + βP + γ with P gauge.
    #[inline]
    pub fn force_n(&self, contraction: T, pressure: GaugePa<T>) -> T {
        self.force_per_pressure_m2(contraction) * pressure.0 + self.gamma_n
    }

    /// ∂F/∂P \[m²\] of Eq 1: f_p = α(1−ε)² + β. It falls with ε and reaches zero at the contraction
    /// beyond which no pressure makes the muscle pull.
    #[inline]
    pub fn force_per_pressure_m2(&self, contraction: T) -> T {
        let shortened = T::one() - contraction;
        self.alpha_m2 * shortened * shortened + self.beta_m2
    }

    /// −∂F/∂ε \[N\] of Eq 1: f_c = 2α(1−ε)P, the muscle's stiffness per unit contraction (Eq 11).
    #[inline]
    pub fn stiffness_n(&self, contraction: T, pressure: GaugePa<T>) -> T {
        let shortened = T::one() - contraction;
        (self.alpha_m2 + self.alpha_m2) * shortened * pressure.0
    }

    /// Rate of the pressure \[Pa/s\] that moves a weight in balance at `speed_m_per_s`.
    ///
    /// At constant force Eq 1 gives f_p dP = f_c dε: dP/dt = (v/L) f_c/f_p. Pressures below the one
    /// at which the muscle at its full length begins to pull move nothing and are replaced by it.
    /// The rate grows with pressure and contraction, up to where f_p is zero.
    #[inline]
    pub fn moving_rate_pa_per_s(
        &self,
        speed_m_per_s: T,
        contraction: T,
        pressure: GaugePa<T>,
    ) -> T {
        let begins_pa = -self.gamma_n / self.force_per_pressure_m2(T::zero());
        let stiffness_n = self.stiffness_n(contraction, GaugePa(pressure.0.at_least(begins_pa)));
        let slope_pa = stiffness_n / self.force_per_pressure_m2(contraction);
        speed_m_per_s / self.initial_length_m * slope_pa
    }
}

impl<T: FloatCore> Volume<T> {
    /// Volume V \[m³\], Eq 2: V = D₁ε² + D₂ε + D₃.
    #[inline]
    pub fn volume_m3(&self, contraction: T) -> T {
        (self.d1_m3 * contraction + self.d2_m3) * contraction + self.d3_m3
    }

    /// dV/dε \[m³\] of Eq 2: V_c = 2D₁ε + D₂.
    #[inline]
    pub fn slope_m3(&self, contraction: T) -> T {
        (self.d1_m3 + self.d1_m3) * contraction + self.d2_m3
    }
}

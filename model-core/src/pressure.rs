//! Gauge and absolute pressure, as two types that do not mix.
//!
//! Force, reference pressure and sensors are in gauge pressure, the ideal-gas law is in absolute
//! pressure. The two methods here convert with the atmospheric pressure.

use num_traits::float::FloatCore;

/// Pressure above the atmosphere \[Pa\].
#[derive(
    Clone, Copy, Debug, Default, PartialEq, PartialOrd, serde::Serialize, serde::Deserialize,
)]
pub struct GaugePa<T>(pub T);

/// Pressure above vacuum \[Pa\].
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct AbsolutePa<T>(pub T);

impl<T: FloatCore> GaugePa<T> {
    /// The same pressure above vacuum.
    #[inline]
    pub fn to_absolute(self, atmospheric: AbsolutePa<T>) -> AbsolutePa<T> {
        AbsolutePa(self.0 + atmospheric.0)
    }
}

impl<T: FloatCore> AbsolutePa<T> {
    /// The same pressure above the atmosphere.
    #[inline]
    pub fn to_gauge(self, atmospheric: AbsolutePa<T>) -> GaugePa<T> {
        GaugePa(self.0 - atmospheric.0)
    }
}

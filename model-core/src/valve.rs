//! The servo valve's static characteristic (Eq 9).

use crate::pressure::GaugePa;
use num_traits::float::FloatCore;

/// Mass flow into the muscle G \[kg/s\], Eq 9: G = K_G(P_r − P), negative when the muscle vents.
#[inline]
pub fn mass_flow_kg_per_s<T: FloatCore>(
    flow_gain_kg_per_pa_s: T,
    reference: GaugePa<T>,
    pressure: GaugePa<T>,
) -> T {
    flow_gain_kg_per_pa_s * (reference.0 - pressure.0)
}

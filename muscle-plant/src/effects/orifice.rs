//! Flow through a restriction that may choke; several effects and data sheets of valves use it.

use model_core::pressure::AbsolutePa;

/// Ratio of pressures above which the flow is laminar, linear in their difference: by ISO 6358-1
/// the slope would be infinite at equal pressures.
const LAMINAR_RATIO: f64 = 0.999;

/// A flow-rate characteristic of ISO 6358-1:2013 at reference temperature.
#[derive(Clone, Copy, Debug)]
pub struct Orifice {
    /// Mass flow over upstream pressure when choked, C ρ₀ of the standard \[kg/(s·Pa)\].
    pub conductance_kg_per_pa_s: f64,
    /// Critical ratio of pressures b \[-\], below which the flow chokes.
    pub critical_ratio: f64,
}

impl Orifice {
    /// Mass flow \[kg/s\] from `upstream` to `downstream`; 0 if the pressure there is higher.
    pub fn flow_kg_per_s(&self, upstream: AbsolutePa<f64>, downstream: AbsolutePa<f64>) -> f64 {
        let ratio = downstream.0 / upstream.0;
        // Also in a trial step that has left the physical range.
        if ratio.is_nan() || ratio >= 1.0 || upstream.0 <= 0.0 {
            return 0.0;
        }
        let share = if ratio > LAMINAR_RATIO {
            self.subsonic(LAMINAR_RATIO) * (1.0 - ratio) / (1.0 - LAMINAR_RATIO)
        } else {
            self.subsonic(ratio.max(self.critical_ratio))
        };
        self.conductance_kg_per_pa_s * upstream.0 * share
    }

    /// The ellipse of the standard: flow relative to the choked one.
    fn subsonic(&self, ratio: f64) -> f64 {
        let relative = (ratio - self.critical_ratio) / (1.0 - self.critical_ratio);
        (1.0 - relative * relative).sqrt()
    }
}

//! What happens to the plant, between two times each; and the limbs in the weight's way.

use super::body::Region;
use model_core::pressure::GaugePa;
use muscle_plant::nominal::Weight;
use muscle_plant::subsystem::load::{LoadPoint, LoadTerm};
use muscle_plant::subsystem::supply::{SupplyPoint, SupplyTerm};
use muscle_plant::subsystem::term::Dynamics;
use muscle_plant::subsystem::valve::{ValvePoint, ValveTerm};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Something in the weight's guide, which holds it.
pub struct Snag(pub Range<f64>);

impl Dynamics<LoadPoint> for Snag {}

impl LoadTerm for Snag {
    fn change(&self, at: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        if self.0.contains(&at.time_s) {
            weight.viscous_damping_ns_per_m += 3e3;
            weight.coulomb_friction_n += 300.0;
            weight.static_friction_n += 480.0;
        }
    }
}

/// Height up to which a helper lifts \[m\], and over which the force fades out below it.
const REACH_M: (f64, f64) = (0.15, 0.03);

/// A force on the weight \[N\], upwards: a helper, as far as he reaches, or somebody who leans on
/// it.
pub struct Force(pub Range<f64>, pub f64);

impl Dynamics<LoadPoint> for Force {}

impl LoadTerm for Force {
    fn change(&self, at: &LoadPoint, _: &[f64], _: &mut Weight, force_n: &mut f64) {
        if self.0.contains(&at.time_s) {
            let left_m = REACH_M.0 - at.contraction * at.initial_length_m;
            let share = if self.1 > 0.0 {
                (left_m / REACH_M.1).clamp(0.0, 1.0)
            } else {
                1.0
            };
            *force_n += share * self.1;
        }
    }
}

/// Another weight, by this factor.
pub struct Exchanged(pub Range<f64>, pub f64);

impl Dynamics<LoadPoint> for Exchanged {}

impl LoadTerm for Exchanged {
    fn change(&self, at: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        if self.0.contains(&at.time_s) {
            weight.mass_kg *= self.1;
        }
    }
}

/// A limb of this stiffness, against something rigid, that the weight meets at this height once it
/// is there: above the weight it pushes down, below up.
#[derive(Clone)]
pub struct Limb {
    pub region: Region,
    pub height_m: f64,
    pub is_above: bool,
    pub is_there: Arc<AtomicBool>,
}

impl Limb {
    pub fn force_n(&self, height_m: f64) -> f64 {
        let beyond_m = height_m - self.height_m;
        let pressed_m = if self.is_above { beyond_m } else { -beyond_m };
        self.region.stiffness_n_per_m * pressed_m.max(0.0)
    }
}

impl Dynamics<LoadPoint> for Limb {}

impl LoadTerm for Limb {
    fn change(&self, at: &LoadPoint, _: &[f64], _: &mut Weight, force_n: &mut f64) {
        if self.is_there.load(Ordering::Relaxed) {
            let push_n = self.force_n(at.contraction * at.initial_length_m);
            *force_n += if self.is_above { -push_n } else { push_n };
        }
    }
}

/// A valve that controls the pressure to a share of the supply, with a share of its flow; with
/// none of it, it is shut.
pub struct Valve(pub Range<f64>, pub f64, pub f64);

impl Dynamics<ValvePoint> for Valve {}

impl ValveTerm for Valve {
    fn reference(&self, at: &ValvePoint, _: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        if self.0.contains(&at.time_s) {
            GaugePa(self.1 * at.supply.0)
        } else {
            reference
        }
    }

    fn flow_kg_per_s(&self, at: &ValvePoint, _: &[f64], flow_kg_per_s: f64) -> f64 {
        if self.0.contains(&at.time_s) {
            self.2 * flow_kg_per_s
        } else {
            flow_kg_per_s
        }
    }
}

/// A supply that falls to a share, once or again and again with this period.
pub struct Supply(pub Range<f64>, pub f64, pub Option<f64>);

impl Dynamics<SupplyPoint> for Supply {}

impl SupplyTerm for Supply {
    fn pressure(&self, at: &SupplyPoint, _: &[f64], supply: GaugePa<f64>) -> GaugePa<f64> {
        let since_s = at.time_s - self.0.start;
        let is_low = self
            .2
            .is_none_or(|period_s| since_s.rem_euclid(period_s) < 0.5 * period_s);
        if self.0.contains(&at.time_s) && is_low {
            GaugePa(self.1 * supply.0)
        } else {
            supply
        }
    }
}

//! Formulas for what has no name: terms that are candidates as effects are, so that the same
//! evidence chooses between both.

use super::{Present, candidate, parameter};
use model_discrepancy::engine::{Active, Candidate};

/// The terms of a formula of one quantity at a place in a law: each is named after both, and has
/// its size as its parameter.
macro_rules! terms {
    ($place:literal, $blocks:expr, $size:expr, $($term:literal),*) => {
        vec![$(candidate(concat!($place, "-", $term), $term, $blocks, &[$size])),*]
    };
}

/// Of a tank's outflow over its level as a share of the largest, beside the root of the level.
pub fn outflows() -> Vec<Candidate> {
    let size = parameter("root_v", "√V", (-5.0, 5.0), 0.2);
    let upper = terms!("upper-outflow", &[0], size, "constant", "linear", "square");
    let lower = terms!("lower-outflow", &[0], size, "constant", "linear", "square");
    [upper, lower].concat()
}

/// Of an axis's friction over its speed in [`super::axis::SPEED_M_PER_S`], beside Coulomb's and a
/// viscous one.
pub fn friction() -> Vec<Candidate> {
    let size = parameter("force_n", "N", (-100.0, 100.0), 5.0);
    let both = &[0, 1];
    terms!(
        "friction",
        both,
        size,
        "size",
        "square",
        "signed-square",
        "cube"
    )
}

impl Present<'_> {
    /// What the terms of a formula at `place` add where its quantity is `x`, in their own unit.
    pub fn formula(&self, place: &str, x: f64) -> f64 {
        let added = |(own, values): &Active| {
            let Candidate { effect, form, .. } = &self.candidates[*own];
            let term = effect
                .strip_prefix(place)
                .and_then(|term| term.strip_prefix('-'));
            let is_here = term == Some(form);
            let basis = match *form {
                _ if !is_here => 0.0,
                "constant" => 1.0,
                "linear" => x,
                "size" => x.abs(),
                "square" => x * x,
                "signed-square" => x * x.abs(),
                "cube" => x * x * x,
                _ => 0.0,
            };
            values[0] * basis
        };
        self.effects.iter().map(added).sum()
    }
}

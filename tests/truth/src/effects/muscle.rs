//! Muscle force that Eq 1 lacks, without memory.

use serde::Serialize;

use super::{Drawn, Form, between, scale, sign, soft_positive};
use crate::hidden::{Hidden, Moment};

/// Pressure that does not reach the braid.
#[derive(Serialize)]
struct DeadBand {
    threshold_pa: f64,
    #[serde(skip)]
    lost_pa: fn(pressure_pa: f64, threshold_pa: f64) -> f64,
}

fn sharp_lost_pa(pressure_pa: f64, threshold_pa: f64) -> f64 {
    pressure_pa.clamp(0.0, threshold_pa)
}

fn rounded_lost_pa(pressure_pa: f64, threshold_pa: f64) -> f64 {
    let width_pa = 0.3 * threshold_pa;
    let rest_pa = soft_positive(-threshold_pa, width_pa);
    pressure_pa + rest_pa - soft_positive(pressure_pa - threshold_pa, width_pa)
}

fn saturating_lost_pa(pressure_pa: f64, threshold_pa: f64) -> f64 {
    threshold_pa * (pressure_pa / threshold_pa).tanh()
}

impl Hidden for DeadBand {
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        force_n - now.area_m2 * (self.lost_pa)(now.pressure_pa, self.threshold_pa)
    }
}

fn dead_band(size: f64, lost_pa: fn(f64, f64) -> f64) -> Drawn {
    Drawn::new(DeadBand {
        threshold_pa: scale(size, 3.0e3, 40.0e3),
        lost_pa,
    })
}

pub(super) const DEAD_BAND: &[Form] = &[
    Form::standard("sharp", &["threshold_pa"], |size, _, _| {
        dead_band(size, sharp_lost_pa)
    }),
    Form::new("rounded", |size, _, _| dead_band(size, rounded_lost_pa)),
    Form::new("saturating", |size, _, _| {
        dead_band(size, saturating_lost_pa)
    }),
];

/// Contraction at which the sizes of bladder forces are stated.
const TOLD_AT: f64 = 0.25;

/// Force that the bladder takes; zero at rest length.
#[derive(Serialize)]
struct Bladder {
    force_at_quarter_n: f64,
    shape: f64,
    #[serde(skip)]
    curve: fn(contraction: f64, shape: f64) -> f64,
}

impl Hidden for Bladder {
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let share = (self.curve)(now.contraction, self.shape) / (self.curve)(TOLD_AT, self.shape);
        force_n - self.force_at_quarter_n * share
    }
}

/// Stress of a Mooney–Rivlin tube that shortens, with `shape` the share of its second constant.
fn rubber_tube(contraction: f64, shape: f64) -> f64 {
    let stretch = 1.0 - contraction;
    (1.0 / (stretch * stretch) - stretch) * (1.0 + shape / stretch)
}

pub(super) const BLADDER_ELASTICITY: &[Form] = &[
    Form::new("exponential", |size, _, rng| {
        Drawn::new(Bladder {
            force_at_quarter_n: scale(size, 8.0, 120.0),
            shape: between(rng, 6.0, 16.0),
            curve: |contraction, shape| (shape * contraction).exp_m1(),
        })
    }),
    Form::new("polynomial", |size, _, rng| {
        Drawn::new(Bladder {
            force_at_quarter_n: scale(size, 8.0, 120.0),
            shape: between(rng, 10.0, 60.0),
            curve: |contraction, shape| contraction + shape * contraction.powi(3),
        })
    }),
    Form::new("rubber-tube", |size, _, rng| {
        Drawn::new(Bladder {
            force_at_quarter_n: scale(size, 8.0, 120.0),
            shape: between(rng, 0.1, 1.0),
            curve: rubber_tube,
        })
    }),
];

/// The force is never negative.
#[derive(Serialize)]
struct SharpSlack {
    least_n: f64,
}

impl Hidden for SharpSlack {
    fn force_n(&self, force_n: f64, _: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        force_n.max(self.least_n)
    }
}

/// Straightens over a width of force.
#[derive(Serialize)]
struct RoundedSlack {
    width_n: f64,
}

impl Hidden for RoundedSlack {
    fn force_n(&self, force_n: f64, _: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        soft_positive(force_n, self.width_n)
    }
}

/// Buckling: a share of the negative force remains.
#[derive(Serialize)]
struct BuckledSlack {
    push_share: f64,
}

impl Hidden for BuckledSlack {
    fn force_n(&self, force_n: f64, _: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        if force_n < 0.0 {
            self.push_share * force_n
        } else {
            force_n
        }
    }
}

pub(super) const SLACK: &[Form] = &[
    Form::new("sharp", |_, _, _| Drawn::new(SharpSlack { least_n: 0.0 })),
    Form::new("rounded", |_, _, rng| {
        Drawn::new(RoundedSlack {
            width_n: between(rng, 1.5, 8.0),
        })
    }),
    Form::new("buckled", |size, _, rng| {
        let push_share = (0.3 * (1.0 - size) + 0.02 * sign(rng)).max(0.01);
        Drawn::new(BuckledSlack { push_share })
    }),
];

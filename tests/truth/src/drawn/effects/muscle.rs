//! Muscle force that Eq 1 lacks, without memory.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Coordinate, Modulation, Ramp, between, log_between, log_scale};
use super::Law;
use crate::hidden::{Hidden, Moment};

/// How the pressure that is lost reaches its full value.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Saturation {
    /// (1 + u^−n)^(−1/n): sharp for a large power n.
    Power(f64),
    /// A random monotone shape that is complete at this multiple of the threshold.
    Monotone(f64, Ramp),
}

impl Saturation {
    fn at(&self, u: f64) -> f64 {
        match self {
            _ if u <= 0.0 => 0.0,
            Saturation::Power(power) => u / (1.0 + u.powf(*power)).powf(power.recip()),
            Saturation::Monotone(complete, ramp) => ramp.saturated(u / complete),
        }
    }
}

/// Pressure that does not reach the braid, the same at every contraction.
#[derive(Serialize)]
struct DeadBand {
    threshold_pa: f64,
    saturation: Saturation,
}

impl Hidden for DeadBand {
    fn commits(&self) -> bool {
        false
    }
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let lost_pa = self.threshold_pa * self.saturation.at(now.pressure_pa / self.threshold_pa);
        force_n - now.area_m2 * lost_pa
    }
}

pub(super) fn dead_band(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let threshold_pa = log_scale(size, 0.012, 0.15) * bench.middle_pa();
    let saturation = if rng.random_bool(0.5) {
        Saturation::Power(log_between(rng, 1.5, 20.0))
    } else {
        Saturation::Monotone(between(rng, 1.0, 2.0), Ramp::draw(rng, 8.0))
    };
    Law::new(
        DeadBand {
            threshold_pa,
            saturation,
        },
        "saturating",
        format!("{threshold_pa:.0} Pa lost above a threshold, reached along a random shape"),
    )
}

/// Force that the bladder takes, rising with contraction from nothing at rest length.
#[derive(Serialize)]
struct Bladder {
    force_n: f64,
    contraction: f64,
    power: f64,
    shape: Ramp,
    modulation: Modulation,
}

impl Hidden for Bladder {
    fn commits(&self) -> bool {
        false
    }
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let u = (now.contraction / self.contraction).max(0.0);
        let share = self.shape.at(u.powf(self.power));
        force_n - self.force_n * self.modulation.at(now) * share
    }
}

pub(super) fn bladder_elasticity(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = log_scale(size, 0.01, 0.15) * bench.blocked_n;
    let contraction = 0.72 * bench.contraction_most;
    let modulation = Modulation::draw(rng, &[Coordinate::Pressure], bench);
    let words = format!(
        "{force_n:.1} N taken at contraction {contraction:.2}, along a random rising shape{}",
        modulation.words()
    );
    Law::new(
        Bladder {
            force_n,
            contraction,
            power: log_between(rng, 0.8, 3.0),
            shape: Ramp::draw(rng, 6.0),
            modulation,
        },
        "rising",
        words,
    )
}

/// A muscle that buckles under a negative force.
#[derive(Serialize)]
struct Slack {
    /// Force over which it straightens.
    width_n: f64,
    /// Remaining share of a negative force.
    push_share: f64,
    /// 1 for a corner like a logistic's, larger for a sharper one.
    power: f64,
}

impl Slack {
    /// Zero far below, `force_n` far above, and never less than either.
    fn positive_n(&self, force_n: f64) -> f64 {
        let u = force_n / self.width_n;
        if u > 30.0 {
            return force_n;
        }
        if u < -30.0 {
            return 0.0;
        }
        let sharp = self.power * u;
        self.width_n / self.power * sharp.max(0.0)
            + self.width_n / self.power * (-sharp.abs()).exp().ln_1p()
    }
}

impl Hidden for Slack {
    fn commits(&self) -> bool {
        false
    }
    fn force_n(&self, force_n: f64, _: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        (1.0 - self.push_share) * self.positive_n(force_n) + self.push_share * force_n
    }
}

pub(super) fn slack(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let width_n = bench.weight_n() * log_between(rng, 0.002, 0.06);
    let push_share = between(rng, 0.0, 0.25) * (1.0 - size);
    Law::new(
        Slack {
            width_n,
            push_share,
            power: log_between(rng, 1.0, 4.0),
        },
        "no-push",
        format!("{push_share:.2} of a push is left, rounded over {width_n:.2} N"),
    )
}

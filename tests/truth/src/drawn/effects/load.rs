//! Effects of the load: friction, payload, backlash.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{
    Coordinate, Curve, Modulation, between, log_between, log_scale, shares, sign,
};
use super::Law;
use crate::hidden::{Hidden, Load, Moment, Reading};
use crate::machine::GRAVITY_M_PER_S2;

/// Dry friction that depends on speed and direction, not on pressure or position.
#[derive(Serialize)]
struct Friction {
    force_n: f64,
    /// At rest over that at low speed.
    breakaway: f64,
    with_velocity: Modulation,
    /// Presliding elements instead of a force that jumps: reaches and shares.
    bristles: Vec<(f64, f64)>,
    length_m: f64,
}

impl Friction {
    fn stretch_m(&self, i: usize, slider_m: f64, at_m: f64) -> f64 {
        let reach_m = self.bristles[i].0;
        (at_m - slider_m).clamp(-reach_m, reach_m)
    }
}

/// States: sliders of the bristles.
impl Hidden for Friction {
    fn commits(&self) -> bool {
        !self.bristles.is_empty()
    }
    fn states(&self) -> usize {
        self.bristles.len()
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(self.length_m * now.contraction);
    }
    fn load(&self, load: &mut Load, now: &Moment, x: &[f64], _: &mut [f64]) {
        let slipping_n = self.force_n * self.with_velocity.at(now);
        if self.bristles.is_empty() {
            load.coulomb_n += slipping_n;
            load.static_n += self.force_n * self.breakaway;
            return;
        }
        let at_m = self.length_m * now.contraction;
        for (i, (reach_m, share)) in self.bristles.iter().enumerate() {
            load.pull_n += slipping_n * share * self.stretch_m(i, x[i], at_m) / reach_m;
        }
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        let at_m = self.length_m * now.contraction;
        for (i, slider_m) in x.iter_mut().enumerate() {
            *slider_m = at_m - self.stretch_m(i, *slider_m, at_m);
        }
    }
}

pub(super) fn friction(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = log_scale(size, 0.012, 0.16) * bench.weight_n();
    let coordinates = [Coordinate::Speed, Coordinate::Velocity];
    let with_velocity = Modulation::draw(rng, &coordinates, bench);
    let presliding = rng.random_bool(0.35);
    let bristles: Vec<(f64, f64)> = if presliding {
        let count = rng.random_range(2..=4);
        let parts = shares(rng, count);
        let reach = |share| (log_between(rng, 1.0e-5, 1.2e-4), share);
        parts.into_iter().map(reach).collect()
    } else {
        Vec::new()
    };
    let form = if presliding { "presliding" } else { "dry" };
    let words = format!("{force_n:.1} N against motion{}", with_velocity.words());
    Law::new(
        Friction {
            force_n,
            breakaway: between(rng, 1.0, 2.0),
            with_velocity,
            bristles,
            length_m: bench.rig.initial_length_m,
        },
        form,
        words,
    )
}

/// Weight that is not in the nominal mass.
#[derive(Serialize)]
struct Payload {
    mass_kg: f64,
    /// Mass over height, of a load that is picked up link by link.
    #[serde(skip_serializing_if = "Option::is_none")]
    along: Option<Curve>,
    /// Frequency and damping of a strap that gives.
    #[serde(skip_serializing_if = "Option::is_none")]
    strap: Option<(f64, f64)>,
    contraction_most: f64,
    length_m: f64,
}

impl Payload {
    fn rigid(&self, load: &mut Load, now: &Moment) {
        let Some(curve) = &self.along else {
            load.mass_kg += self.mass_kg;
            return;
        };
        let u = now.contraction / self.contraction_most;
        let mass_kg = self.mass_kg * curve.at(u);
        let du = 1.0e-3;
        let slope_kg_per_m = self.mass_kg * (curve.at(u + du) - curve.at(u - du))
            / (2.0 * du * self.contraction_most * self.length_m);
        let speed_m_per_s = self.length_m * now.rate_per_s;
        load.mass_kg += mass_kg;
        // Lagrange's equation of ½ m(y) ẏ²
        load.pull_n += 0.5 * slope_kg_per_m * speed_m_per_s * speed_m_per_s;
    }
}

/// States: extension of the strap, and speed of its weight.
impl Hidden for Payload {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x.fill(0.0);
        if let Some((frequency_hz, _)) = self.strap {
            x[0] = GRAVITY_M_PER_S2 / (TAU * frequency_hz).powi(2);
        }
    }
    fn load(&self, load: &mut Load, now: &Moment, x: &[f64], dx: &mut [f64]) {
        let Some((frequency_hz, damping)) = self.strap else {
            return self.rigid(load, now);
        };
        let angular = TAU * frequency_hz;
        dx[0] = self.length_m * now.rate_per_s - x[1];
        // a strap does not push
        let pull = (angular * angular * x[0] + 2.0 * damping * angular * dx[0]).max(0.0);
        dx[1] = pull - GRAVITY_M_PER_S2;
        load.pull_n += self.mass_kg * pull;
    }
}

pub(super) fn payload(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let mass_kg = sign(rng) * log_scale(size, 0.012, 0.22) * bench.rig.mass_kg;
    let kind = rng.random_range(0..10);
    let along = (kind >= 8).then(|| Curve::draw(rng, 1.6));
    let strapped = mass_kg > 0.0 && (5..8).contains(&kind);
    let strap = strapped.then(|| {
        let swing_hz = bench.angular_per_s() / TAU;
        let frequency_hz = swing_hz * between(rng, 2.0, 4.0);
        (frequency_hz, between(rng, 0.1, 0.3))
    });
    let form = match (&along, strap) {
        (None, None) => "rigid",
        (None, Some(_)) => "strapped",
        _ => "along-height",
    };
    Law::new(
        Payload {
            mass_kg,
            along,
            strap,
            contraction_most: bench.contraction_most,
            length_m: bench.rig.initial_length_m,
        },
        form,
        format!("{mass_kg:.3} kg beyond nominal"),
    )
}

/// Play between the load and the encoder, in stages and with a width that varies along the way.
#[derive(Serialize)]
struct Backlash {
    gap_m: f64,
    /// Of the gap, and of the reading.
    stages: Vec<(f64, f64)>,
    along: Curve,
    contraction_most: f64,
    length_m: f64,
}

impl Backlash {
    fn follower(&self, i: usize, follower: f64, contraction: f64) -> f64 {
        let width = self.gap_m * self.along.at(contraction / self.contraction_most);
        let half = 0.5 * self.stages[i].0 * width / self.length_m;
        follower.clamp(contraction - half, contraction + half)
    }
}

/// States: where each stage stands.
impl Hidden for Backlash {
    fn states(&self) -> usize {
        self.stages.len()
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.contraction);
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        for (i, follower) in x.iter_mut().enumerate() {
            *follower = self.follower(i, *follower, now.contraction);
        }
    }
    fn read(&self, reading: &mut Reading, now: &Moment, x: &[f64]) {
        let terms = x
            .iter()
            .zip(&self.stages)
            .map(|(at, (_, share))| share * at);
        reading.contraction += terms.sum::<f64>() - now.contraction;
    }
}

pub(super) fn backlash(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let gap_m = log_scale(size, 0.1e-3, 3.0e-3);
    let count = rng.random_range(1..=4);
    let parts = shares(rng, count);
    let widths: Vec<f64> = (0..count).map(|_| log_between(rng, 0.4, 1.0)).collect();
    let mean: f64 = parts.iter().zip(&widths).map(|(p, w)| p * w).sum();
    let stage = |(share, width): (f64, f64)| (width / mean, share);
    let along = if rng.random_bool(0.5) {
        Curve::draw(rng, 3.0)
    } else {
        Curve::flat()
    };
    let words = format!(
        "{:.2} mm in {count} stages, by a factor of {:.2} along the way",
        1e3 * gap_m,
        along.ratio()
    );
    Law::new(
        Backlash {
            gap_m,
            stages: parts.into_iter().zip(widths).map(stage).collect(),
            along,
            contraction_most: bench.contraction_most,
            length_m: bench.rig.initial_length_m,
        },
        format!("{count}-stage"),
        words,
    )
}

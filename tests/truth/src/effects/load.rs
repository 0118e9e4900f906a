//! Effects of the load: friction, payload, backlash.

use serde::Serialize;

use super::{Drawn, Form, between, dragged, scale, sign};
use crate::hidden::{Hidden, Load, Moment, Reading};
use crate::machine::GRAVITY_M_PER_S2;

/// The same more at rest and moving.
#[derive(Serialize)]
struct Coulomb {
    coulomb_n: f64,
}

impl Hidden for Coulomb {
    fn load(&self, load: &mut Load, _: &Moment, _: &[f64], _: &mut [f64]) {
        load.coulomb_n += self.coulomb_n;
        load.static_n += self.coulomb_n;
    }
}

/// More at rest than moving, falling over a speed.
#[derive(Serialize)]
struct Stribeck {
    static_n: f64,
    coulomb_n: f64,
    speed_m_per_s: f64,
    initial_length_m: f64,
}

impl Hidden for Stribeck {
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        let speed = self.initial_length_m * now.rate_per_s / self.speed_m_per_s;
        let slow = (-speed * speed).exp();
        load.static_n += self.static_n;
        load.coulomb_n += self.coulomb_n + (self.static_n - self.coulomb_n) * slow;
    }
}

/// Bristles instead of the nominal dry friction, with presliding.
#[derive(Serialize)]
struct LuGre {
    coulomb_n: f64,
    static_n: f64,
    stiffness_n_per_m: f64,
    damping_ns_per_m: f64,
    speed_m_per_s: f64,
    initial_length_m: f64,
}

impl Hidden for LuGre {
    fn states(&self) -> usize {
        1
    }
    fn load(&self, load: &mut Load, now: &Moment, x: &[f64], dx: &mut [f64]) {
        let speed = self.initial_length_m * now.rate_per_s;
        let slow = (-(speed / self.speed_m_per_s).powi(2)).exp();
        let coulomb_n = load.coulomb_n + self.coulomb_n;
        let static_n = load.static_n + self.static_n;
        let held_n = coulomb_n + (static_n - coulomb_n) * slow;
        dx[0] = speed - self.stiffness_n_per_m * speed.abs() / held_n * x[0];
        load.pull_n += self.stiffness_n_per_m * x[0] + self.damping_ns_per_m * slow * dx[0];
        load.coulomb_n = 0.0;
        load.static_n = 0.0;
    }
}

pub(super) const FRICTION: &[Form] = &[
    Form::standard("coulomb", &["coulomb_n"], |size, _, _| {
        Drawn::new(Coulomb {
            coulomb_n: scale(size, 1.5, 20.0),
        })
    }),
    Form::new("stribeck", |size, rig, rng| {
        let coulomb_n = scale(size, 1.2, 15.0);
        Drawn::new(Stribeck {
            static_n: coulomb_n * between(rng, 1.3, 2.0),
            coulomb_n,
            speed_m_per_s: between(rng, 0.005, 0.03),
            initial_length_m: rig.initial_length_m,
        })
    }),
    Form::new("lugre", |size, rig, rng| {
        let coulomb_n = scale(size, 1.5, 18.0);
        Drawn::new(LuGre {
            coulomb_n,
            static_n: coulomb_n * between(rng, 1.0, 1.4),
            stiffness_n_per_m: between(rng, 2.0e4, 6.0e4),
            damping_ns_per_m: between(rng, 200.0, 600.0),
            speed_m_per_s: between(rng, 0.005, 0.02),
            initial_length_m: rig.initial_length_m,
        })
    }),
];

/// More or less weight.
#[derive(Serialize)]
struct Payload {
    /// Mass in addition to the nominal mass.
    mass_kg: f64,
}

impl Hidden for Payload {
    fn load(&self, load: &mut Load, _: &Moment, _: &[f64], _: &mut [f64]) {
        load.mass_kg += self.mass_kg;
    }
}

/// A weight on a strap that gives.
#[derive(Serialize)]
struct StrappedPayload {
    mass_kg: f64,
    frequency_hz: f64,
    damping: f64,
    initial_length_m: f64,
}

impl StrappedPayload {
    fn angular_per_s(&self) -> f64 {
        std::f64::consts::TAU * self.frequency_hz
    }
}

/// States: extension of the strap, and speed of the weight.
impl Hidden for StrappedPayload {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = GRAVITY_M_PER_S2 / self.angular_per_s().powi(2);
        x[1] = 0.0;
    }
    fn load(&self, load: &mut Load, now: &Moment, x: &[f64], dx: &mut [f64]) {
        let angular = self.angular_per_s();
        dx[0] = self.initial_length_m * now.rate_per_s - x[1];
        // a strap does not push
        let pull = (angular * angular * x[0] + 2.0 * self.damping * angular * dx[0]).max(0.0);
        dx[1] = pull - GRAVITY_M_PER_S2;
        load.pull_n += self.mass_kg * pull;
    }
}

pub(super) const PAYLOAD: &[Form] = &[
    Form::standard("rigid", &["mass_kg"], |size, _, rng| {
        Drawn::new(Payload {
            mass_kg: sign(rng) * scale(size, 0.1, 2.5),
        })
    }),
    Form::new("strapped", |size, rig, rng| {
        Drawn::new(StrappedPayload {
            mass_kg: scale(size, 0.1, 2.5),
            frequency_hz: between(rng, 9.0, 18.0),
            damping: between(rng, 0.1, 0.3),
            initial_length_m: rig.initial_length_m,
        })
    }),
];

/// Play of the encoder: shares of the reading, each with its own play.
#[derive(Serialize)]
struct Backlash {
    gap_m: f64,
    /// Of the gap, for each half of the reading.
    shares: [f64; 2],
    initial_length_m: f64,
}

impl Backlash {
    fn half(&self, i: usize) -> f64 {
        0.5 * self.gap_m * self.shares[i] / self.initial_length_m
    }
}

impl Hidden for Backlash {
    fn states(&self) -> usize {
        2
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        for (i, centre) in x.iter_mut().enumerate() {
            *centre = dragged(*centre, now.contraction, self.half(i));
        }
    }
    fn read(&self, reading: &mut Reading, now: &Moment, x: &[f64]) {
        reading.contraction += 0.5 * (x[0] + x[1]) - now.contraction;
    }
}

pub(super) const BACKLASH: &[Form] = &[
    Form::standard("sharp", &["gap_m"], |size, rig, _| {
        Drawn::new(Backlash {
            gap_m: scale(size, 0.1e-3, 3.0e-3),
            shares: [1.0, 1.0],
            initial_length_m: rig.initial_length_m,
        })
    }),
    Form::standard("graded", &["gap_m"], |size, rig, rng| {
        let wide = between(rng, 1.2, 1.6);
        Drawn::new(Backlash {
            gap_m: scale(size, 0.1e-3, 3.0e-3),
            shares: [wide, 2.0 - wide],
            initial_length_m: rig.initial_length_m,
        })
    }),
];

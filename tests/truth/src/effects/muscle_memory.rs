//! Muscle force with memory: hysteresis, creep, run-in.

use serde::Serialize;

use super::{Drawn, Form, between, dragged, scale, sign};
use crate::hidden::{Hidden, Moment};

/// Pressure at which the sizes of hysteresis are stated.
const TOLD_AT_PA: f64 = 3.0e5;

/// A sum of stops in contraction, in proportion to pressure.
#[derive(Serialize)]
struct PlaySum {
    half_width_n: f64,
    reach: [f64; 4],
    share: [f64; 4],
}

impl Hidden for PlaySum {
    fn states(&self) -> usize {
        4
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], _: &mut [f64]) -> f64 {
        let mut share = 0.0;
        for (i, centre) in x.iter().enumerate() {
            let centre = dragged(*centre, now.contraction, self.reach[i]);
            share += self.share[i] * (now.contraction - centre) / self.reach[i];
        }
        force_n - self.half_width_n * share * now.pressure_pa.max(0.0) / TOLD_AT_PA
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        for (centre, reach) in x.iter_mut().zip(self.reach) {
            *centre = dragged(*centre, now.contraction, reach);
        }
    }
}

/// Bouc–Wen in contraction, growing with pressure by a power below one.
#[derive(Serialize)]
struct BoucWen {
    half_width_n: f64,
    reach: f64,
    sharpness: f64,
    softening: f64,
    pressure_power: f64,
}

impl Hidden for BoucWen {
    fn states(&self) -> usize {
        1
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let rate = now.rate_per_s / self.reach;
        let bent = x[0].abs().powf(self.sharpness);
        let along = (rate * x[0]).signum();
        dx[0] = rate * (1.0 - bent * (self.softening * along + 1.0 - self.softening));
        let pressure = (now.pressure_pa.max(0.0) / TOLD_AT_PA).powf(self.pressure_power);
        force_n - self.half_width_n * x[0] * pressure
    }
}

/// Duhem with a different reach and height in each direction: wider while extending than while
/// contracting.
#[derive(Serialize)]
struct Duhem {
    half_width_n: f64,
    reach_in: f64,
    reach_out: f64,
    height_out: f64,
    share_at_zero: f64,
}

impl Hidden for Duhem {
    fn states(&self) -> usize {
        1
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        dx[0] = if now.rate_per_s > 0.0 {
            now.rate_per_s * (1.0 - x[0]) / self.reach_in
        } else {
            now.rate_per_s * (self.height_out + x[0]) / self.reach_out
        };
        let pressure = now.pressure_pa.max(0.0) / TOLD_AT_PA;
        let share = self.share_at_zero + (1.0 - self.share_at_zero) * pressure;
        force_n - self.half_width_n * x[0] * share
    }
}

pub(super) const HYSTERESIS: &[Form] = &[
    Form::new("play-sum", |size, _, rng| {
        let first = between(rng, 0.003, 0.006);
        let spread = between(rng, 1.8, 2.6);
        Drawn::new(PlaySum {
            half_width_n: scale(size, 2.5, 40.0),
            reach: [0, 1, 2, 3].map(|i| first * spread.powi(i)),
            share: [0.35, 0.3, 0.2, 0.15],
        })
    }),
    Form::new("bouc-wen", |size, _, rng| {
        Drawn::new(BoucWen {
            half_width_n: scale(size, 2.5, 40.0),
            reach: between(rng, 0.008, 0.025),
            sharpness: between(rng, 0.8, 1.8),
            softening: between(rng, 0.5, 0.8),
            pressure_power: between(rng, 0.7, 1.0),
        })
    }),
    Form::new("duhem", |size, _, rng| {
        Drawn::new(Duhem {
            half_width_n: scale(size, 2.5, 40.0),
            reach_in: between(rng, 0.008, 0.02),
            reach_out: between(rng, 0.012, 0.03),
            height_out: between(rng, 1.2, 1.7),
            share_at_zero: between(rng, 0.1, 0.4),
        })
    }),
];

/// Relaxing branches that resist a change of contraction.
#[derive(Serialize)]
struct StrainCreep {
    branch_n: Vec<f64>,
    time_constant_s: Vec<f64>,
}

impl Hidden for StrainCreep {
    fn states(&self) -> usize {
        self.branch_n.len()
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.contraction);
    }
    fn force_n(&self, mut force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        for i in 0..x.len() {
            let strain = now.contraction - x[i];
            dx[i] = strain / self.time_constant_s[i];
            force_n -= self.branch_n[i] * strain;
        }
        force_n
    }
}

/// A share of the pressure's force that comes late.
#[derive(Serialize)]
struct PressureCreep {
    share: [f64; 2],
    time_constant_s: [f64; 2],
}

impl Hidden for PressureCreep {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.pressure_pa);
    }
    fn force_n(&self, mut force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        for i in 0..2 {
            let late_pa = now.pressure_pa - x[i];
            dx[i] = late_pa / self.time_constant_s[i];
            force_n -= self.share[i] * now.area_m2 * late_pa;
        }
        force_n
    }
}

pub(super) const CREEP: &[Form] = &[
    Form::new("strain-branches", |size, _, rng| {
        let whole_n = scale(size, 25.0, 400.0);
        let fast = between(rng, 0.35, 0.65);
        Drawn::new(StrainCreep {
            branch_n: vec![fast * whole_n, (1.0 - fast) * whole_n],
            time_constant_s: vec![between(rng, 0.8, 3.0), between(rng, 8.0, 25.0)],
        })
    }),
    Form::new("pressure-branches", |size, _, rng| {
        let whole = scale(size, 0.015, 0.2);
        let fast = between(rng, 0.35, 0.65);
        Drawn::new(PressureCreep {
            share: [fast * whole, (1.0 - fast) * whole],
            time_constant_s: [between(rng, 0.8, 3.0), between(rng, 8.0, 25.0)],
        })
    }),
    // equal branches three to a decade let go with the logarithm of time
    Form::new("logarithmic", |size, _, rng| {
        let decade_n = scale(size, 15.0, 200.0);
        let first_s = between(rng, 0.15, 0.4);
        Drawn::new(StrainCreep {
            branch_n: vec![decade_n / 3.0; 9],
            time_constant_s: (0..9)
                .map(|i| first_s * 10_f64.powf(f64::from(i) / 3.0))
                .collect(),
        })
    }),
];

/// Force off by a share that falls with the way travelled.
#[derive(Serialize)]
struct TravelRunIn {
    share: f64,
    cycles: f64,
    cycle_contraction: f64,
    /// Zero: exponential, else by this power of one and the cycles done.
    power: f64,
}

impl Hidden for TravelRunIn {
    fn states(&self) -> usize {
        1
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        dx[0] = now.rate_per_s.abs() / (2.0 * self.cycle_contraction);
        let done = x[0] / self.cycles;
        let left = if self.power > 0.0 {
            (1.0 + done).powf(-self.power)
        } else {
            (-done).exp()
        };
        force_n * (1.0 + self.share * left)
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = 0.0;
    }
}

/// Force off by a share that falls at each reversal of more than a least stroke.
#[derive(Serialize)]
struct CycleRunIn {
    share: f64,
    cycles: f64,
    least_stroke: f64,
}

/// States: share left, smoothed share left, last extreme, direction.
impl Hidden for CycleRunIn {
    fn states(&self) -> usize {
        4
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.copy_from_slice(&[1.0, 1.0, now.contraction, 0.0]);
    }
    fn force_n(&self, force_n: f64, _: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        dx[1] = (x[0] - x[1]) / 0.15;
        force_n * (1.0 + self.share * x[1])
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        let way = now.contraction - x[2];
        if way * x[3] > 0.0 {
            x[2] = now.contraction;
        } else if way.abs() > self.least_stroke {
            if x[3] != 0.0 {
                x[0] *= (-0.5 / self.cycles).exp();
            }
            x[2] = now.contraction;
            x[3] = way.signum();
        }
    }
}

pub(super) const RUN_IN: &[Form] = &[
    Form::new("travel-exponential", |size, _, rng| {
        Drawn::new(TravelRunIn {
            share: sign(rng) * scale(size, 0.008, 0.1),
            cycles: between(rng, 1.0, 3.0),
            cycle_contraction: 0.1,
            power: 0.0,
        })
    }),
    Form::new("travel-power", |size, _, rng| {
        Drawn::new(TravelRunIn {
            share: sign(rng) * scale(size, 0.008, 0.1),
            cycles: between(rng, 0.5, 1.5),
            cycle_contraction: 0.1,
            power: between(rng, 1.0, 2.0),
        })
    }),
    Form::new("cycle", |size, _, rng| {
        Drawn::new(CycleRunIn {
            share: sign(rng) * scale(size, 0.008, 0.1),
            cycles: between(rng, 1.0, 3.0),
            least_stroke: between(rng, 0.02, 0.04),
        })
    }),
];

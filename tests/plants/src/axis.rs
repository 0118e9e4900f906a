//! An electro-mechanical axis: a car on a ball screw, driven by a DC motor (Janot, Gautier & Brunot
//! 2019). F = M a + Fv v + Fc sgn v + F0, the force of the drive.
//!
//! What is missed is smoothed: its slow part tells of friction, the fast one of inertia and delays.

use super::signal::{at, columns, rate, slid, smooth};
use super::{Law, Present, candidate, parameter, scale};
use model_discrepancy::engine::Candidate;
use std::path::Path;

/// M \[kg\], Fv \[N·s/m\], Fc \[N\] and F0 \[N\] with standard deviations: of a data sheet, of
/// friction that nobody knows, and of an analog output's zero, 10 mV at 35 N/V.
const NOMINAL: [(f64, f64); 4] = [(95.0, 10.0), (200.0, 60.0), (20.0, 6.0), (0.0, 0.35)];
/// Period of the screw's ripple \[m\], and the standard deviation of its sine and cosine, 5 % of
/// the friction \[N\]. Its phase is another one each time the encoder is switched on.
const RIPPLE_M: f64 = 2.5e-3;
const RIPPLE_N: f64 = 1.0;
/// Noise of a smoothed row \[N\].
pub const NOISE_N: f64 = 0.1;
/// Samples \[s\], those that are averaged before all else and for the slow part, and from row to
/// row in each block; how long a discrepancy lasts \[s\].
pub const SAMPLE_S: f64 = 1e-3;
const AVERAGED: usize = 5;
const SLOW: usize = 21;
const ROWS: [usize; 2] = [20, 5];
const LASTS_S: f64 = 0.1;
/// Largest speed, in which formulas are written \[m/s\].
pub const SPEED_M_PER_S: f64 = 0.1;

/// A record.
pub struct Axis {
    /// Force of the drive \[N\].
    pub force_n: Vec<f64>,
    /// Position of the car \[m\].
    pub position_m: Vec<f64>,
    smooth_n: Vec<f64>,
    speed: Vec<f64>,
    acceleration: Vec<f64>,
}

/// M, Fv, Fc and F0, which is what one record tells of another.
pub fn values(nominal: &[f64]) -> [f64; 4] {
    std::array::from_fn(|i| NOMINAL[i].0 + NOMINAL[i].1 * nominal[i])
}

/// Force \[N\] against a motion, but for inertia, at `(x, v)` \[m, m/s\] when so much
/// has [`slid`].
pub fn resistance(nominal: &[f64], effects: &Present, (x, v): (f64, f64), slid: f64) -> f64 {
    let [_, viscous, coulomb, constant] = values(nominal);
    let size = |effect| effects.size(effect);
    let width = effects.value("low-speed-friction", 1).max(1e-9);
    let friction = coulomb + effects.size("low-speed-friction") * (-v.abs() / width).exp();
    let uneven = effects.value("asymmetric-friction", 1) * v.abs();
    let along = size("friction-along-screw") * x;
    let late = effects.value("low-speed-friction", 2) * (slid - v.signum());
    let more = size("asymmetric-friction") + uneven + size("cable-spring") * x + late;
    let more = more + effects.formula("friction", v / SPEED_M_PER_S);
    (friction + along) * v.signum() + (viscous + size("drag") * v.abs()) * v + constant + more
}

impl Axis {
    /// A record of the benchmark; `None` if it cannot be read.
    pub fn read(path: &Path) -> Option<Axis> {
        let [force_n, position_m] = columns(path, ["force_n", "position_m"])?;
        let speed = rate(&smooth(&position_m, AVERAGED), SAMPLE_S);
        Some(Axis {
            smooth_n: smooth(&force_n, AVERAGED),
            acceleration: rate(&speed, SAMPLE_S),
            force_n,
            position_m,
            speed,
        })
    }

    fn rows(&self, block: usize) -> impl Iterator<Item = usize> {
        (100..self.force_n.len() - 100).step_by(ROWS[block])
    }
}

impl Law for Axis {
    const BLOCKS: &[&str] = &["slow force", "fast force"];
    /// 5 % of the friction, 1 N, and a third of that.
    const BASE: &[f64] = &[1.0 / NOISE_N, 0.3 / NOISE_N];
    const NOMINALS: usize = NOMINAL.len() + 2;

    fn catalogue() -> Vec<Candidate> {
        let force = |name| parameter(name, "N", (-50.0, 50.0), 5.0);
        let viscous = parameter("more_n_s_per_m", "N·s/m", (-300.0, 300.0), 30.0);
        let delay = parameter("delay_s", "s", (0.0, 0.01), 5e-4);
        let drag = parameter("n_s2_per_m2", "N·s²/m²", (-2e3, 2e3), 300.0);
        let spring = parameter("n_per_m", "N/m", (-500.0, 500.0), 20.0);
        let speed = scale("speed_m_per_s", "m/s", (1e-4, 0.1), 0.01);
        let distance = scale("distance_m", "m", (1e-6, 1e-3), 3e-5);
        let late = parameter("late_n", "N", (0.0, 50.0), 5.0);
        let slow = [force("more_n"), speed, late, distance];
        let uneven = [force("difference_n"), viscous];
        let both = &[0, 1];
        vec![
            candidate("asymmetric-friction", "coulomb", both, &uneven[..1]),
            candidate("asymmetric-friction", "viscous", both, &uneven),
            candidate("delay", "pure", both, &[delay]),
            candidate("low-speed-friction", "stribeck", both, &slow[..2]),
            candidate("low-speed-friction", "stribeck-and-presliding", both, &slow),
            candidate("drag", "quadratic", both, &[drag]),
            candidate("cable-spring", "linear", both, &[spring]),
            candidate("friction-along-screw", "linear", both, &[spring]),
        ]
    }

    fn times(&self, block: usize) -> Vec<f64> {
        let rows = self.rows(block);
        rows.map(|row| row as f64 * SAMPLE_S / LASTS_S).collect()
    }

    fn missed(&self, block: usize, nominal: &[f64], effects: &Present) -> Vec<f64> {
        let motion = self.position_m.iter().zip(&self.speed);
        let resistance = motion.scan(0.0, |share, (x, v)| {
            *share = slid(*share, v * SAMPLE_S, effects.value("low-speed-friction", 3));
            let (sine, cosine) = (std::f64::consts::TAU * x / RIPPLE_M).sin_cos();
            let ripple_n = RIPPLE_N * (nominal[4] * sine + nominal[5] * cosine);
            Some(resistance(nominal, effects, (*x, *v), *share) + ripple_n)
        });
        let (mass, delay) = (values(nominal)[0], effects.size("delay") / SAMPLE_S);
        let resistance = smooth(&resistance.collect::<Vec<f64>>(), AVERAGED);
        let missed = |(row, resistance): (usize, &f64)| {
            mass * self.acceleration[row] + resistance - at(&self.smooth_n, row as f64 - delay)
        };
        let whole: Vec<f64> = resistance.iter().enumerate().map(missed).collect();
        let slow = smooth(&whole, SLOW);
        let part = |row: usize| slow[row] + block as f64 * (whole[row] - 2.0 * slow[row]);
        self.rows(block).map(|row| part(row) / NOISE_N).collect()
    }
}

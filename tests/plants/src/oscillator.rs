//! A mass on a spring with a hysteretic force (Noël & Schoukens 2016), simulated; in the nominal
//! model m y'' + c y' + k y = F.

use super::signal::{at, between, columns};
use super::{Law, Present, candidate, parameter, scale};
use model_discrepancy::engine::Candidate;
use std::path::Path;

/// m \[kg\], c \[N·s/m\] and k \[N/m\] with standard deviations: m and c are published, of k only
/// that the resonance is near 35 Hz at small amplitudes.
const NOMINAL: [(f64, f64); 3] = [(2.0, 0.1), (10.0, 3.0), (1e5, 5e4)];
/// Noise of the mean period's position \[m\], by what periods differ.
pub const NOISE_M: f64 = 5e-6;
/// Samples \[s\], those before a period in which a transient dies, integration steps in each, and
/// how long a discrepancy lasts \[s\].
const SAMPLE_S: f64 = 1.0 / 750.0;
const LEAD: usize = 1000;
const STEPS: usize = 4;
const LASTS_S: f64 = 0.1;

/// A record, or the mean of its periods.
pub struct Oscillator {
    /// Force \[N\] at each half of a step, from `lead` samples before the first position.
    drive_n: Vec<f64>,
    lead: usize,
    /// Position \[m\].
    pub position_m: Vec<f64>,
}

/// m, c and k.
pub fn values(nominal: &[f64]) -> [f64; 3] {
    std::array::from_fn(|i| NOMINAL[i].0 + NOMINAL[i].1 * nominal[i])
}

impl Oscillator {
    /// A record of `periods` equal ones, or of none, which starts at rest.
    pub fn read(path: &Path, periods: usize) -> Option<Oscillator> {
        let [force_n, position_m] = columns(path, ["force_n", "displacement_m"])?;
        let count = position_m.len() / periods.max(1);
        let lead = if periods == 0 { 0 } else { LEAD };
        let led = [&force_n[count - lead..count], &force_n[..count]].concat();
        let of_phase = |i: usize| position_m[i..].iter().step_by(count).sum::<f64>();
        Some(Oscillator {
            drive_n: between(&led, 2 * STEPS),
            lead,
            position_m: (0..count)
                .map(|i| of_phase(i) / periods.max(1) as f64)
                .collect(),
        })
    }

    /// Position \[m\] and hysteretic force \[N\] at each sample, by Runge and Kutta.
    pub fn run(&self, nominal: &[f64], effects: &Present) -> Vec<[f64; 2]> {
        let [mass, damping, stiffness] = values(nominal);
        let size = |effect| effects.size(effect);
        let [to_z, decay, skew] = std::array::from_fn(|i| effects.value("hysteresis", i));
        let (coulomb, drag, play) = (size("coulomb"), size("drag"), size("play"));
        let (cubic, uneven) = (size("cubic-spring"), size("uneven-spring"));
        let late = (2 * STEPS) as f64 * size("delay") / SAMPLE_S;
        let rates = |[x, v, z]: [f64; 3], half: usize| {
            let spring = stiffness * (x - x.clamp(-play, play)) + (uneven + cubic * x) * x * x;
            let friction = (damping + drag * v.abs()) * v + coulomb * (v / 1e-3).tanh();
            let force = at(&self.drive_n, half as f64 - late) - spring - friction - z;
            let rate = to_z * v - decay * v.abs() * z - skew * v * z.abs();
            [v, force / mass, rate]
        };
        let step_s = SAMPLE_S / STEPS as f64;
        let mut state = [0.0; 3];
        let mut run = Vec::with_capacity(self.position_m.len());
        for step in 0..STEPS * (self.lead + self.position_m.len()) {
            if step % STEPS == 0 && step >= STEPS * self.lead {
                run.push([state[0], state[2]]);
            }
            let moved =
                |k: [f64; 3], share: f64| std::array::from_fn(|i| state[i] + share * step_s * k[i]);
            let k1 = rates(state, 2 * step);
            let k2 = rates(moved(k1, 0.5), 2 * step + 1);
            let k3 = rates(moved(k2, 0.5), 2 * step + 1);
            let k4 = rates(moved(k3, 1.0), 2 * step + 2);
            let mean = |i| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0;
            state = moved(std::array::from_fn(mean), 1.0);
        }
        run
    }
}

impl Law for Oscillator {
    const BLOCKS: &[&str] = &["position"];
    const NOMINALS: usize = NOMINAL.len();

    fn catalogue() -> Vec<Candidate> {
        let stiffness = parameter("n_per_m", "N/m", (0.0, 2e5), 3e4);
        let decay = scale("decay_per_m", "1/m", (1.0, 1e6), 1e3);
        let skew = parameter("skew_per_m", "1/m", (-1e4, 1e4), 500.0);
        let force = parameter("force_n", "N", (0.0, 500.0), 10.0);
        let cubic = parameter("n_per_m3", "N/m³", (-1e11, 1e11), 1e9);
        let uneven = parameter("n_per_m2", "N/m²", (-1e8, 1e8), 1e6);
        let drag = parameter("n_s2_per_m2", "N·s²/m²", (0.0, 1e4), 100.0);
        let play = parameter("half_width_m", "m", (0.0, 5e-3), 1e-4);
        let delay = parameter("delay_s", "s", (0.0, 0.01), 5e-4);
        vec![
            candidate("hysteresis", "dahl", &[0], &[stiffness, decay]),
            candidate("hysteresis", "bouc-wen", &[0], &[stiffness, decay, skew]),
            candidate("coulomb", "tanh", &[0], &[force]),
            candidate("cubic-spring", "cubic", &[0], &[cubic]),
            candidate("uneven-spring", "quadratic", &[0], &[uneven]),
            candidate("drag", "quadratic", &[0], &[drag]),
            candidate("play", "dead-zone", &[0], &[play]),
            candidate("delay", "pure", &[0], &[delay]),
        ]
    }

    /// Every second sample.
    fn times(&self, _: usize) -> Vec<f64> {
        let rows = (0..self.position_m.len()).step_by(2);
        rows.map(|row| row as f64 * SAMPLE_S / LASTS_S).collect()
    }

    fn missed(&self, _: usize, nominal: &[f64], effects: &Present) -> Vec<f64> {
        let run = self.run(nominal, effects).into_iter();
        let missed = run.zip(&self.position_m).step_by(2);
        missed.map(|([is, _], was)| (is - was) / NOISE_M).collect()
    }
}

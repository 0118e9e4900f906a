//! Two water tanks in cascade: a pump fills the upper one, which drains into the lower one, whose
//! level is measured (Schoukens & Noël 2017). By Torricelli h1' = k4 u − k1 √h1 and
//! h2' = k1 √h1 − k3 √h2, in volts of the level sensor; h1 as in a tank as wide as the lower one.

use super::signal::columns;
use super::{Law, Present, candidate, parameter, scale};
use model_discrepancy::engine::Candidate;
use std::path::Path;

/// k1, k3 \[√V/s\], k4 \[1/s\] and the initial h1 \[V\] of tanks that empty in some minutes and are
/// half full at half of the pump's voltage, and the standard deviation of their logarithms.
const NOMINAL: [f64; 4] = [0.05, 0.05, 0.04, 5.0];
const SIGMA: f64 = 0.5;
/// Noise at the published 40 dB below the signal \[V\].
const NOISE_V: f64 = 0.02;
/// Where the sensor, and the lower tank with it, ends \[V\].
pub const MOST_V: f64 = 10.0;
/// Samples \[s\], integration steps in each, and one in the tanks' time constant, 100 s.
const SAMPLE_S: f64 = 4.0;
const STEPS: usize = 4;
const ROW: f64 = SAMPLE_S / 100.0;
/// Samples over which a level is predicted from a measured one: it moves by some times its noise.
const HORIZON: usize = 4;

/// A record.
pub struct Tanks {
    /// Voltage of the pump \[V\].
    pub pump_v: Vec<f64>,
    /// The lower level as its sensor reads it \[V\].
    pub level_v: Vec<f64>,
    /// Whether the level is simulated from the first sample on, instead of over each horizon.
    pub simulated: bool,
}

impl Tanks {
    /// A record of the benchmark; `None` if it cannot be read.
    pub fn read(path: &Path, simulated: bool) -> Option<Tanks> {
        let [pump_v, level_v] = columns(path, ["pump_volt", "lower_tank_level_volt"])?;
        Some(Tanks {
            pump_v,
            level_v,
            simulated,
        })
    }

    /// The lower level \[V\] as its sensor would read it if it had no end.
    pub fn run(&self, nominal: &[f64], effects: &Present) -> Vec<f64> {
        let nominal = std::array::from_fn(|i| NOMINAL[i] * (SIGMA * nominal[i]).exp());
        let [k1, k3, k4, mut upper_v] = nominal;
        let [brim_v, share] = std::array::from_fn(|i| effects.value("overflow", i));
        let most_v = if brim_v > 0.0 { brim_v } else { 1e9 };
        let (dead_v, lag_s) = (effects.size("pump-dead-zone"), effects.size("pump-lag"));
        let offset_v = effects.size("level-sensor-offset");
        let (form, more) = effects.of("outflow-law");
        let more = |tank: usize| more.iter().rev().nth(1 - tank).unwrap_or(&0.0);
        let places = ["upper-outflow", "lower-outflow"];
        let formula = |tank: usize, level_v| effects.formula(places[tank], level_v / MOST_V);
        let out = |level_v: f64, tank: usize| match form.starts_with("power") {
            true => level_v.powf((0.5 + more(tank)).max(0.01)),
            false => level_v.sqrt() + more(tank) * level_v + formula(tank, level_v),
        };
        let step_s = SAMPLE_S / STEPS as f64;
        let follows = 1.0 - (-step_s / lag_s.max(1e-6)).exp();
        let (mut pumped_v, mut lower_v) = (self.pump_v[0], (self.level_v[0] - offset_v).max(0.0));
        let mut read_v = Vec::with_capacity(self.level_v.len());
        for (row, (pump_v, level_v)) in self.pump_v.iter().zip(&self.level_v).enumerate() {
            read_v.push(lower_v + offset_v);
            if !self.simulated && row % HORIZON == 0 {
                lower_v = (level_v - offset_v).max(0.0);
            }
            for _ in 0..STEPS {
                pumped_v += follows * ((pump_v - dead_v).max(0.0) - pumped_v);
                let through = k1 * out(upper_v, 0);
                let full_v = upper_v + step_s * (k4 * pumped_v - through);
                upper_v = full_v.clamp(0.0, most_v);
                let rate = through - k3 * out(lower_v, 1) - effects.size("leak") * lower_v;
                let spilt_v = share * (full_v - most_v).max(0.0);
                lower_v = (lower_v + step_s * rate + spilt_v).clamp(0.0, MOST_V);
            }
        }
        read_v
    }

    /// Ends of horizons in which the sensor has not reached its end, beyond which it is blind.
    fn ends(&self) -> impl Iterator<Item = usize> {
        let is_below = |level_v: &f64| *level_v < MOST_V - 0.01;
        let ends = (HORIZON..self.level_v.len()).step_by(HORIZON);
        ends.filter(move |end| self.level_v[end - HORIZON..=*end].iter().all(is_below))
    }
}

impl Law for Tanks {
    const BLOCKS: &[&str] = &["lower tank"];
    const NOMINALS: usize = NOMINAL.len();
    /// An overflow begins at a level.
    const PROPORTIONAL: bool = false;

    fn catalogue() -> Vec<Candidate> {
        let level = scale("level_v", "V", (2.0, 40.0), MOST_V);
        let share = parameter("share", "1", (0.0, 1.0), 0.5);
        let each = |unit| ["upper", "lower"].map(|tank| parameter(tank, unit, (-1.0, 1.0), 0.1));
        let dead = parameter("dead_v", "V", (0.0, 3.0), 0.3);
        let lag = parameter("lag_s", "s", (0.0, 100.0), 10.0);
        let offset = parameter("offset_v", "V", (-3.0, 3.0), 0.5);
        let leak = parameter("per_s", "1/s", (0.0, 0.1), 2e-3);
        vec![
            candidate("overflow", "lost", &[0], &[level]),
            candidate("overflow", "into-lower", &[0], &[level, share]),
            candidate("outflow-law", "powers", &[0], &each("1")),
            candidate("outflow-law", "linear-terms", &[0], &each("1/√V")),
            candidate("outflow-law", "power-below", &[0], &each("1")[1..]),
            candidate("outflow-law", "linear-term-below", &[0], &each("1/√V")[1..]),
            candidate("pump-dead-zone", "sharp", &[0], &[dead]),
            candidate("pump-lag", "first-order", &[0], &[lag]),
            candidate("level-sensor-offset", "constant", &[0], &[offset]),
            candidate("leak", "linear", &[0], &[leak]),
        ]
    }

    fn times(&self, _: usize) -> Vec<f64> {
        self.ends().map(|row| row as f64 * ROW).collect()
    }

    fn missed(&self, _: usize, nominal: &[f64], effects: &Present) -> Vec<f64> {
        let read_v = self.run(nominal, effects);
        // A change has the noise of both its ends.
        let noise_v = NOISE_V * if self.simulated { 1.0 } else { 2_f64.sqrt() };
        let missed = |row: usize| (read_v[row] - self.level_v[row]) / noise_v;
        self.ends().map(missed).collect()
    }
}

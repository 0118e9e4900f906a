//! A DC motor with a gear and encoders on both of its shafts: u = R i + K ω + L i' of the winding,
//! K i = J ω' + b ω + T sgn ω of the torque, and the load's angle, which is the motor's over the
//! gear's ratio.

use super::{Law, Present, candidate, parameter, scale};
use model_discrepancy::engine::Candidate;

/// R \[Ω\], K \[V·s\], J \[kg·m²\], b \[N·m·s\] and T \[N·m\] with relative tolerances of a data
/// sheet, and the blocks that depend on each.
const NOMINAL: [(f64, f64, &[usize]); 5] = [
    (1.0, 0.05, &[0]),
    (0.05, 0.03, &[0, 1]),
    (2e-5, 0.1, &[1]),
    (2e-5, 0.2, &[1]),
    (4e-3, 0.2, &[1]),
];
const INDUCTANCE_H: f64 = 1e-3;
/// The gear's ratio.
pub const RATIO: f64 = 20.0;
/// Noise of a row of each block \[V\], \[N·m\], \[rad\].
const NOISE: [f64; 3] = [5e-3, 1.2e-4, 1e-3];
/// Samples \[s\].
pub const SAMPLE_S: f64 = 2e-3;
/// Samples before and after one over which a balance is taken.
const REACH: usize = 5;
/// Speed below which the motion may reverse \[rad/s\].
const TURNING_RAD_PER_S: f64 = 1.0;

/// A record.
#[derive(Default)]
pub struct Motor {
    /// Voltage \[V\].
    pub volt: Vec<f64>,
    /// Current \[A\].
    pub ampere: Vec<f64>,
    /// Speed of the motor \[rad/s\].
    pub speed_rad_per_s: Vec<f64>,
    /// Angle of the motor \[rad\].
    pub motor_rad: Vec<f64>,
    /// Angle of the load \[rad\].
    pub load_rad: Vec<f64>,
}

impl Motor {
    /// Middles of windows that do not overlap.
    fn rows(&self) -> impl Iterator<Item = usize> {
        (2 * REACH..self.volt.len() - REACH).step_by(2 * REACH)
    }
}

impl Law for Motor {
    const BLOCKS: &[&str] = &["winding", "torque", "gear"];
    /// Friction is not known to better than 5 % where the motion reverses: 2e-4 N·m.
    const BASE: &[f64] = &[0.3, 2e-4 / NOISE[1], 0.3];
    const NOMINALS: usize = NOMINAL.len();

    fn catalogue() -> Vec<Candidate> {
        let torque = |name| parameter(name, "N·m", (-0.05, 0.05), 2e-3);
        let speed = scale("speed_rad_per_s", "rad/s", (1.0, 500.0), 20.0);
        let friction = [torque("torque_n_m"), torque("at_rest_n_m"), speed];
        let drop = parameter("drop_v", "V", (0.0, 3.0), 0.5);
        let lost = parameter("lost", "1", (0.0, 0.8), 0.2);
        let half_width = parameter("half_width_rad", "rad", (0.0, 0.2), 0.01);
        let soft = parameter("rad_per_n_m", "rad/(N·m)", (0.0, 10.0), 0.5);
        vec![
            candidate("brush-drop", "constant", &[0], &[drop]),
            candidate("weak-magnet", "constant", &[0, 1], &[lost]),
            candidate("friction", "coulomb", &[1], &friction[..1]),
            candidate("friction", "stribeck", &[1], &friction),
            candidate("eccentric-gear", "cosine", &[1], &friction[..1]),
            candidate("backlash", "play", &[2], &[half_width]),
            candidate("soft-gear", "linear", &[2], &[soft]),
        ]
    }

    fn nominal_blocks() -> Vec<Vec<usize>> {
        NOMINAL.map(|(.., blocks)| blocks.to_vec()).to_vec()
    }

    fn times(&self, _: usize) -> Vec<f64> {
        self.rows().map(|row| row as f64 * SAMPLE_S).collect()
    }

    fn missed(&self, block: usize, nominal: &[f64], effects: &Present) -> Vec<f64> {
        let [r, k, j, b, t] =
            std::array::from_fn(|i| NOMINAL[i].0 * (1.0 + NOMINAL[i].1 * nominal[i]));
        let k = k * (1.0 - effects.size("weak-magnet"));
        let voltage = |row: usize| {
            let drop_v = effects.size("brush-drop") * self.ampere[row].signum();
            r * self.ampere[row] + k * self.speed_rad_per_s[row] + drop_v - self.volt[row]
        };
        let friction = |speed: f64| match effects.of("friction").1 {
            [more, at_rest, scale] => t + more + at_rest * (-speed.abs() / scale).exp(),
            _ => t + effects.size("friction"),
        };
        let torque = |row: usize| {
            let speed = self.speed_rad_per_s[row];
            let direction = (speed / TURNING_RAD_PER_S).clamp(-1.0, 1.0);
            let uneven = effects.size("eccentric-gear") * (self.motor_rad[row] / RATIO).cos();
            friction(speed) * direction + b * speed + uneven - k * self.ampere[row]
        };
        let mut load_rad = self.load_rad[0];
        let mut angle = |row: usize| {
            for motor_rad in &self.motor_rad[row + 1 - 2 * REACH..=row] {
                let play = motor_rad / RATIO - load_rad;
                let half_width = effects.size("backlash");
                load_rad += play - play.clamp(-half_width, half_width);
            }
            load_rad - effects.size("soft-gear") * k * self.ampere[row] - self.load_rad[row]
        };
        let balance = |storage: f64, of: &[f64], flow: &dyn Fn(usize) -> f64, row: usize| {
            let (from, to) = (row - REACH, row + REACH);
            let flows: f64 = (from..to).map(|i| 0.5 * (flow(i) + flow(i + 1))).sum();
            let stored = storage * (of[to] - of[from]) / SAMPLE_S;
            (flows + stored) / (2 * REACH) as f64
        };
        let missed = |row: usize| match block {
            0 => balance(INDUCTANCE_H, &self.ampere, &voltage, row),
            1 => balance(j, &self.speed_rad_per_s, &torque, row),
            _ => angle(row),
        };
        self.rows()
            .map(missed)
            .map(|own| own / NOISE[block])
            .collect()
    }
}

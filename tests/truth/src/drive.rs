//! Reference pressures: sequences of staircases, triangles, sweeps and holds.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

/// Below this the weight stays on its stop (the paper's rig lifts off at 126 kPa).
const LIFTED_PA: f64 = 1.45e5;
/// Within the supply's 500 kPa.
const GREATEST_PA: f64 = 4.85e5;
/// A larger step up would throw the weight.
const LARGEST_RISE_PA: f64 = 1.8e5;

/// The shape of a section of a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Stretch {
    /// Small and large steps with holds, occasionally down to zero.
    Staircase,
    /// Two long holds after a large step.
    LongHold,
    /// Fast large steps near supply pressure.
    Burst,
    /// Up and down at three rates, with minor loops.
    Triangles,
    /// Steps of growing size around a middle pressure.
    AmplitudeSweep,
    /// Sum of slow and fast sines.
    Multisine,
}

use Stretch::{AmplitudeSweep, Burst, LongHold, Multisine, Staircase, Triangles};

/// Stretches of a record and their shares of its time.
pub(crate) type Recipe = &'static [(Stretch, f64)];

pub(crate) const FIT: [Recipe; 2] = [
    &[(Staircase, 0.45), (Burst, 0.15), (LongHold, 0.4)],
    &[(Triangles, 0.5), (AmplitudeSweep, 0.3), (Multisine, 0.2)],
];
pub(crate) const VALIDATE: [Recipe; 2] = [
    &[(Staircase, 0.35), (LongHold, 0.35), (AmplitudeSweep, 0.3)],
    &[(Triangles, 0.45), (Multisine, 0.4), (Burst, 0.15)],
];
pub(crate) const UNSEEN: [Recipe; 1] = [&[
    (Multisine, 0.25),
    (LongHold, 0.25),
    (Staircase, 0.25),
    (Triangles, 0.25),
]];

/// A reference with a zero-order hold.
#[derive(Clone, Debug)]
pub struct Drive {
    /// Sampling period.
    pub period_s: f64,
    /// Reference pressures of the valve, at least one.
    pub reference_pa: Vec<f64>,
    /// For each sample whether the shut-off valve between valve and muscle is shut; empty if it
    /// never is.
    pub shut: Vec<bool>,
}

impl Drive {
    /// The sample that holds at `time_s`; before the first that does.
    fn sample(&self, time_s: f64) -> usize {
        // the small term prevents that rounding delays a step
        let index = ((time_s + 1e-9) / self.period_s).max(0.0) as usize;
        index.min(self.reference_pa.len() - 1)
    }

    /// The reference at `time_s`.
    pub(crate) fn at(&self, time_s: f64) -> f64 {
        self.reference_pa[self.sample(time_s)]
    }

    /// Whether the shut-off valve is shut at `time_s`.
    pub(crate) fn is_shut(&self, time_s: f64) -> bool {
        let shut = self.shut.get(self.sample(time_s));
        shut.copied().unwrap_or(false)
    }

    /// Samples of a drive of `duration_s`, both ends included.
    pub(crate) fn samples(duration_s: f64, period_s: f64) -> usize {
        (duration_s / period_s).round() as usize + 1
    }

    /// Draws a drive of `duration_s` from a recipe, its stretches in any order.
    pub(crate) fn draw(recipe: Recipe, duration_s: f64, period_s: f64, rng: &mut Pcg64) -> Self {
        let mut stretches = recipe.to_vec();
        stretches.shuffle(rng);
        let mut pen = Pen {
            period_s,
            reference_pa: Vec::new(),
            due_s: 0.0,
        };
        let first_pa = if rng.random_bool(0.3) {
            0.0
        } else {
            pen.level(rng)
        };
        pen.hold(first_pa, 1.2);
        let left_s = duration_s - pen.due_s;
        for (stretch, share) in stretches {
            pen.stretch(stretch, pen.due_s + share * left_s, rng);
        }
        let last_pa = pen.last_pa();
        let samples = Drive::samples(duration_s, period_s);
        pen.reference_pa.resize(samples, last_pa);
        Self {
            period_s,
            reference_pa: pen.reference_pa,
            shut: Vec::new(),
        }
    }
}

/// Where a drive is being written.
struct Pen {
    period_s: f64,
    reference_pa: Vec<f64>,
    due_s: f64,
}

impl Pen {
    fn last_pa(&self) -> f64 {
        *self.reference_pa.last().unwrap_or(&0.0)
    }

    /// Writes `duration_s` of a shape, to 10 Pa.
    fn write(&mut self, duration_s: f64, shape: impl Fn(f64) -> f64) {
        let from_s = self.due_s;
        self.due_s += duration_s;
        loop {
            let time_s = self.reference_pa.len() as f64 * self.period_s;
            if time_s >= self.due_s - 1e-9 {
                return;
            }
            let pressure_pa = shape(time_s - from_s).clamp(0.0, GREATEST_PA);
            self.reference_pa.push((pressure_pa / 10.0).round() * 10.0);
        }
    }

    /// Steps and holds; far up in two steps.
    fn hold(&mut self, pressure_pa: f64, duration_s: f64) {
        let from_pa = if self.reference_pa.is_empty() {
            pressure_pa
        } else {
            self.last_pa()
        };
        if pressure_pa - from_pa > LARGEST_RISE_PA {
            let between_pa = pressure_pa - LARGEST_RISE_PA;
            let share_s = 0.4 * duration_s;
            self.write(share_s, |_| between_pa);
            return self.write(duration_s - share_s, |_| pressure_pa);
        }
        self.write(duration_s, |_| pressure_pa);
    }

    fn ramp(&mut self, to_pa: f64, duration_s: f64) {
        let from_pa = self.last_pa();
        self.write(duration_s, |time_s| {
            from_pa + (to_pa - from_pa) * time_s / duration_s
        });
    }

    fn level(&self, rng: &mut Pcg64) -> f64 {
        rng.random_range(LIFTED_PA..GREATEST_PA)
    }

    fn stretch(&mut self, stretch: Stretch, until_s: f64, rng: &mut Pcg64) {
        match stretch {
            Staircase => self.staircase(until_s, rng),
            LongHold => self.long_hold(until_s, rng),
            Burst => self.burst(until_s, rng),
            Triangles => self.triangles(until_s, rng),
            AmplitudeSweep => self.amplitude_sweep(until_s, rng),
            Multisine => self.multisine(until_s, rng),
        }
    }

    fn staircase(&mut self, until_s: f64, rng: &mut Pcg64) {
        let vent_at_s = rng.random_range(self.due_s..until_s - 4.0_f64.min(until_s - self.due_s));
        let mut vented = false;
        while self.due_s < until_s - 0.3 {
            let hold_s = rng.random_range(0.8_f64..3.0).min(until_s - self.due_s);
            if !vented && self.due_s >= vent_at_s {
                vented = true;
                self.hold(rng.random_range(0.0..4.0e4), hold_s.min(1.5));
                continue;
            }
            let level_pa = if rng.random_bool(0.4) {
                let small_pa = rng.random_range(1.0e4..3.0e4);
                let up = self.last_pa() < 2.5e5 || rng.random_bool(0.5);
                self.last_pa() + if up { small_pa } else { -small_pa }
            } else {
                self.level(rng)
            };
            self.hold(level_pa, hold_s);
        }
    }

    fn long_hold(&mut self, until_s: f64, rng: &mut Pcg64) {
        let half_s = 0.5 * (until_s - self.due_s);
        let low_pa = rng.random_range(LIFTED_PA..2.4e5);
        let high_pa = rng.random_range(3.4e5..GREATEST_PA);
        let (first_pa, second_pa) = if rng.random_bool(0.5) {
            (low_pa, high_pa)
        } else {
            (high_pa, low_pa)
        };
        self.hold(first_pa, half_s);
        self.hold(second_pa, until_s - self.due_s);
    }

    fn burst(&mut self, until_s: f64, rng: &mut Pcg64) {
        while self.due_s < until_s - 0.2 {
            let hold_s = rng.random_range(0.35_f64..0.8).min(until_s - self.due_s);
            let level_pa = if self.last_pa() < 4.0e5 {
                rng.random_range(4.5e5..GREATEST_PA)
            } else {
                rng.random_range(2.5e5..3.4e5)
            };
            self.hold(level_pa, hold_s);
        }
    }

    fn triangles(&mut self, until_s: f64, rng: &mut Pcg64) {
        let mut leg_s: [f64; 3] = [3.0, 1.5, 0.8];
        leg_s.shuffle(rng);
        let mut up = self.last_pa() < 2.8e5;
        for i in 0.. {
            let left_s = until_s - self.due_s;
            if left_s < 0.2 {
                return;
            }
            let major_s = (leg_s[(i / 2) % 3] * rng.random_range(0.8..1.2)).min(left_s);
            let to_pa = if up {
                rng.random_range(3.8e5..GREATEST_PA)
            } else {
                rng.random_range(LIFTED_PA..2.2e5)
            };
            if left_s > 2.0 * major_s && rng.random_bool(0.5) {
                // a minor loop half way
                let turn_pa =
                    self.last_pa() + rng.random_range(0.5..0.7) * (to_pa - self.last_pa());
                let back_pa = turn_pa - rng.random_range(0.2..0.35) * (to_pa - self.last_pa());
                self.ramp(turn_pa, 0.5 * major_s);
                self.ramp(back_pa, 0.25 * major_s);
                self.ramp(to_pa, 0.75 * major_s);
            } else {
                self.ramp(to_pa, major_s);
            }
            up = !up;
        }
    }

    fn amplitude_sweep(&mut self, until_s: f64, rng: &mut Pcg64) {
        let middle_pa = rng.random_range(2.7e5..3.3e5);
        let half_s = rng.random_range(0.5..0.8);
        let growing = rng.random_bool(0.7);
        let pairs = ((until_s - self.due_s) / (2.0 * half_s)).floor().max(1.0);
        self.hold(
            middle_pa,
            (until_s - self.due_s - 2.0 * half_s * pairs).max(0.0),
        );
        for i in 0..pairs as u32 {
            let done = f64::from(i) / (pairs - 1.0).max(1.0);
            let share = if growing { done } else { 1.0 - done };
            let amplitude_pa = 5.0e3 * 20.0_f64.powf(share);
            self.hold(middle_pa + amplitude_pa, half_s);
            self.hold(middle_pa - amplitude_pa, half_s);
        }
    }

    fn multisine(&mut self, until_s: f64, rng: &mut Pcg64) {
        let middle_pa = rng.random_range(2.6e5..3.4e5);
        let mut sines = Vec::new();
        for (low_hz, high_hz, amplitude_pa) in [
            (0.08, 0.2, 6.0e4),
            (0.3, 0.6, 4.0e4),
            (0.8, 1.5, 2.5e4),
            (2.0, 4.0, 1.2e4),
        ] {
            let angular = TAU * rng.random_range(low_hz..high_hz);
            sines.push((angular, rng.random_range(0.0..TAU), amplitude_pa));
        }
        let shape = move |time_s: f64| {
            let sum: f64 = sines
                .iter()
                .map(|(w, phase, a)| a * (w * time_s + phase).sin())
                .sum();
            middle_pa + sum
        };
        let ramp_s = 0.8_f64.min(0.5 * (until_s - self.due_s));
        self.ramp(shape(0.0), ramp_s);
        self.write(until_s - self.due_s, shape);
    }
}

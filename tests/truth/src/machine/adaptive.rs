//! Adaptive step size: a Runge–Kutta pair of third and second order
//! (Shu and Osher 1988, with the trapezoidal rule embedded).

use super::{CONTRACTION, ENERGY, EVENT_S, MASS, Machine, Motion, OWN, RATE, STATES, State};

/// Longest step.
const LONGEST_S: f64 = 1.0e-2;
/// Shortest step, which is accepted with any error, as the law of the flow is not smooth.
const SHORTEST_S: f64 = 1.0e-5;
/// Tolerance of the time of a change of motion.
const LOCATED_S: f64 = 1.0e-7;
/// Error a step, of mass and energy relative, of contraction, and of its rate \[1/s\].
const GAS_ERROR: f64 = 2.0e-6;
const CONTRACTION_ERROR: f64 = 3.0e-8;
const RATE_ERROR: f64 = 3.0e-6;
/// Error a step of an effect's state, relative to the largest that it has been.
const EFFECT_ERROR: f64 = 1.0e-5;
/// Least size that an effect's state is taken to have, in its own unit.
const EFFECT_SIZE: f64 = 1.0e-4;

/// What one step leaves to the next.
pub(super) struct Pace {
    step_s: f64,
    /// Errors allowed, over the usual ones.
    tolerance: f64,
    /// Largest magnitude so far of each of the effects' states.
    size: State,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            step_s: 1.0e-4,
            tolerance: 1.0,
            size: [EFFECT_SIZE; STATES],
        }
    }
}

impl Machine<'_> {
    /// Allows errors `tolerance` times as large as usual.
    pub(crate) fn set_tolerance(&mut self, tolerance: f64) {
        self.pace.tolerance = tolerance;
    }

    fn states(&self) -> usize {
        self.hidden.last().map_or(OWN, |(.., to)| *to)
    }

    /// The state `step_s` later from rates `first` now, and its error over what is allowed.
    fn trial(&self, step_s: f64, first: &State) -> (State, f64) {
        let len = self.states();
        let (mut second, mut third) = ([0.0; STATES], [0.0; STATES]);
        let mut x = self.x;
        for i in 0..len {
            x[i] += step_s * first[i];
        }
        self.evaluate(self.time_s + step_s, &x, &mut second);
        for i in 0..len {
            x[i] = self.x[i] + 0.25 * step_s * (first[i] + second[i]);
        }
        self.evaluate(self.time_s + 0.5 * step_s, &x, &mut third);
        let mut worst = 0.0_f64;
        for i in 0..len {
            let ends = first[i] + second[i];
            x[i] = self.x[i] + step_s / 6.0 * (ends + 4.0 * third[i]);
            let error = step_s / 3.0 * (2.0 * third[i] - ends).abs();
            let allowed = match i {
                MASS | ENERGY => GAS_ERROR * x[i].abs(),
                CONTRACTION => CONTRACTION_ERROR,
                RATE => RATE_ERROR,
                _ => EFFECT_ERROR * self.pace.size[i].max(x[i].abs()),
            };
            worst = worst.max(error / (allowed * self.pace.tolerance));
        }
        (x, if worst.is_nan() { f64::INFINITY } else { worst })
    }

    /// Accepts a state, and lets the effects change theirs.
    fn take(&mut self, step_s: f64, x: State) {
        self.x = x;
        self.time_s += step_s;
        for (size, x) in self.pace.size.iter_mut().zip(&x) {
            *size = size.max(x.abs());
        }
        if self.hidden.iter().any(|(effect, ..)| effect.commits()) {
            let now = self.balance().now;
            for (effect, from, to) in &self.hidden {
                effect.commit(&now, &mut self.x[*from..*to]);
            }
        }
    }

    /// The first moment within `step_s` at which the present motion has ended.
    fn end_of_motion(&self, step_s: f64, first: &State) -> f64 {
        let (mut before_s, mut after_s) = (0.0, step_s);
        while after_s - before_s > LOCATED_S {
            let middle_s = 0.5 * (before_s + after_s);
            if self.ended(middle_s, &self.trial(middle_s, first).0) {
                after_s = middle_s;
            } else {
                before_s = middle_s;
            }
        }
        after_s
    }

    /// Runs until `until_s` under a constant command.
    pub(crate) fn advance(&mut self, until_s: f64, command_pa: f64) {
        self.command_pa = command_pa;
        // limits the number of changes of motion, as a chattering weight would have no end
        let mut turns = 0;
        while self.time_s < until_s - EVENT_S {
            let mut first = [0.0; STATES];
            let mut balance = self.evaluate(self.time_s, &self.x, &mut first);
            if self.motion == Motion::Rest
                && let Some(motion) = self.torn(&balance)
            {
                self.motion = motion;
                first = [0.0; STATES];
                balance = self.evaluate(self.time_s, &self.x, &mut first);
            }
            debug_assert!(balance.net_n.is_finite(), "the rig has left physics");
            let left_s = until_s - self.time_s;
            let step_s = self.pace.step_s.min(left_s);
            let (x, error) = self.trial(step_s, &first);
            let scale = (0.9 / error.cbrt()).clamp(0.2, 3.0);
            if error > 1.0 && step_s > SHORTEST_S {
                self.pace.step_s = (step_s * scale).max(SHORTEST_S);
                continue;
            }
            // what ends at a row says little of how long a step may be
            let proposed_s = (step_s * scale).clamp(SHORTEST_S, LONGEST_S);
            self.pace.step_s = if step_s < self.pace.step_s {
                self.pace.step_s.max(proposed_s)
            } else {
                proposed_s
            };
            if turns > 200 || !self.ended(step_s, &x) {
                self.take(step_s, x);
                continue;
            }
            turns += 1;
            let end_s = self.end_of_motion(step_s, &first);
            let (mut x, _) = self.trial(end_s, &first);
            x[RATE] = 0.0;
            x[CONTRACTION] = x[CONTRACTION].max(0.0);
            self.take(end_s, x);
            self.motion = Motion::Rest;
        }
        self.time_s = until_s;
    }
}

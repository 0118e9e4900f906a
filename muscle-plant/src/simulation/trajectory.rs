//! The state of a plant in time: adaptive steps between two jumps of the drive.
//!
//! Between two jumps of the drive and two changes of [`Regime`] the equations are smooth, and no
//! step spans one: breakaway, standstill, the stop and the reversal of the flow are located on the
//! step's continuous extension (`events.rs`), and the next step begins there.

use super::drive::{Drive, Regime};
use super::integrate::Step;
use super::plant::{CONTRACTION, CONTRACTION_RATE, NOMINAL_STATES, PRESSURE, Plant, TEMPERATURE};
use crate::subsystem::load::{LoadSubsystem, Motion};
use crate::subsystem::term::Update;
use model_core::pressure::GaugePa;

/// Default local error per step, relative to each state's range; the work-precision table of the
/// benchmark shows its cost and accuracy.
pub const TOLERANCE: f64 = 1e-5;

/// Ranges that the tolerance is relative to: ε, ε̇ \[1/s\], P \[Pa\], θ \[K\]; 1 for effects.
const RANGES: [f64; NOMINAL_STATES] = [0.25, 1.0, 4e5, 100.0];
/// Shortest step \[s\]: a shorter one means that the state has left the physical range.
const STEP_S_MIN: f64 = 1e-11;
/// Largest number of events in one advance; some five in 10 ms are physical.
const EVENTS_MAX: u32 = 10_000;
/// Smallest factor between two steps.
const GROWTH_MIN: f64 = 0.2;
/// Largest factor between two steps.
const GROWTH_MAX: f64 = 5.0;
/// Safety factor on the estimated step.
const SAFETY: f64 = 0.9;
/// Relative error below which a step may grow by [`GROWTH_MAX`]: (SAFETY / GROWTH_MAX)⁵.
const ERROR_NEGLIGIBLE: f64 = 1.889568e-4;
/// Relative error of a trial step that must be repeated, as its error is not finite.
const REFUSED: f64 = f64::INFINITY;

/// Reasons for which a simulation cannot continue.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// No step is short enough: the state has left the physical range.
    #[error(
        "the plant's equations have no solution past {time_s:.6} s (step below {step_s:.1e} s)"
    )]
    NoStep {
        /// Time \[s\].
        time_s: f64,
        /// The step that was refused \[s\].
        step_s: f64,
    },
    /// The weight starts and stops repeatedly.
    #[error("the weight starts and stops more than 10 000 times at {time_s:.6} s")]
    Chatter {
        /// Time \[s\].
        time_s: f64,
    },
}

impl SimulationError {
    /// Time at which it could not continue \[s\].
    pub fn time_s(&self) -> f64 {
        match self {
            SimulationError::NoStep { time_s, .. } | SimulationError::Chatter { time_s } => *time_s,
        }
    }
}

/// Initial state of a simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Initial {
    /// Time \[s\].
    pub time_s: f64,
    /// Contraction ε \[-\].
    pub contraction: f64,
    /// Contraction rate \[1/s\].
    pub contraction_rate_per_s: f64,
    /// Pressure in the muscle.
    pub pressure: GaugePa<f64>,
    /// Gas temperature \[K\].
    pub temperature_k: f64,
}

impl Initial {
    /// At time 0: `plant` at rest on its stop, with a vented muscle and the gas at ambient
    /// temperature.
    pub fn vented(plant: &Plant) -> Initial {
        Initial {
            time_s: 0.0,
            contraction: 0.0,
            contraction_rate_per_s: 0.0,
            pressure: GaugePa(0.0),
            temperature_k: plant.ambient_temperature_k,
        }
    }
}

/// Counts of the integrator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Accepted steps.
    pub steps: u64,
    /// Steps that were repeated with a shorter length.
    pub refused: u64,
    /// Events: changes of the regime.
    pub events: u64,
    /// Evaluations of the plant's equations.
    pub evaluations: u64,
}

/// A state of `N` values in time.
pub(super) struct Trajectory<const N: usize> {
    pub(super) time_s: f64,
    pub(super) state: [f64; N],
    pub(super) regime: Regime,
    /// The flow stays at zero: the heat transfer of either sign would reverse it.
    pub(super) sliding: bool,
    /// Rates of the state under a drive, where they are known.
    pub(super) rates: Option<(Drive, [f64; N])>,
    /// Per state: reciprocal of the admitted error.
    pub(super) per_error: [f64; N],
    /// A reversed flow up to this is not an event \[kg/s\].
    pub(super) flow_error_kg_per_s: f64,
    /// The length of the first step after the last jump of the drive, and the present length \[s\].
    pub(super) step_s_after_jump: f64,
    pub(super) step_s: f64,
    pub(super) work: Work,
}

impl<const N: usize> Trajectory<N> {
    pub(super) fn new(
        plant: &Plant,
        initial: &Initial,
        drive: &Drive,
        tolerance: f64,
    ) -> Box<Self> {
        let mut state = [0.0; N];
        state[CONTRACTION] = initial.contraction;
        state[CONTRACTION_RATE] = initial.contraction_rate_per_s;
        state[PRESSURE] = initial.pressure.to_absolute(plant.atmospheric).0;
        state[TEMPERATURE] = initial.temperature_k;
        plant.steady_state(initial.time_s, drive, &mut state);
        let mut per_error = [1.0 / tolerance; N];
        for (per_error, range) in per_error.iter_mut().zip(RANGES) {
            *per_error /= range;
        }
        let valve = plant.pneumatics.as_ref().map(|part| &part.valve);
        let flow_gain = valve.map_or(0.0, |valve| valve.flow_gain_kg_per_pa_s);
        let mut trajectory = Box::new(Trajectory {
            time_s: initial.time_s,
            state,
            regime: Regime {
                motion: Motion::Stuck,
                charging: false,
            },
            sliding: false,
            rates: None,
            per_error,
            flow_error_kg_per_s: flow_gain * tolerance * RANGES[PRESSURE],
            step_s_after_jump: 1e-3,
            step_s: 1e-3,
            work: Work::default(),
        });
        if let Some(load) = &plant.load {
            trajectory.regime.motion = if initial.contraction_rate_per_s > 0.0 {
                Motion::Rising
            } else if initial.contraction_rate_per_s < 0.0 {
                Motion::Falling
            } else {
                trajectory.at_rest(plant, load)
            };
        }
        trajectory
    }

    /// Next motion of a weight without speed.
    pub(super) fn at_rest(&self, plant: &Plant, load: &LoadSubsystem) -> Motion {
        let (breakaway_n, motion) = plant.breakaway_n(load, self.time_s, &self.state);
        if breakaway_n > 0.0 {
            motion
        } else {
            Motion::Stuck
        }
    }

    /// Largest estimated error of a step, relative to the admitted one.
    #[inline]
    fn relative_error(&self, step: &Step<N>) -> f64 {
        let error = step.error();
        let mut worst = 0.0;
        for (error, per_error) in error.iter().zip(&self.per_error) {
            let relative = (error * per_error).abs();
            // Not `max`, which drops a NaN.
            if relative > worst || relative.is_nan() {
                worst = relative;
            }
        }
        if worst.is_nan() { REFUSED } else { worst }
    }

    /// Length of the next step after one of `length_s` with this error. A step that was short
    /// because the drive ended, with a negligible error, does not limit the next one.
    fn fitting_s(&self, length_s: f64, error: f64) -> f64 {
        let fitting_s = length_s * growth(error);
        if error < ERROR_NEGLIGIBLE {
            fitting_s.max(self.step_s)
        } else {
            fitting_s
        }
    }

    /// The rates after a jump of the drive, with the sign of the new flow and the step length that
    /// was found after the last jump.
    fn rates_after_jump(&mut self, plant: &Plant, drive: &Drive) -> [f64; N] {
        let flow = plant.flow_kg_per_s(self.time_s, drive, &self.state);
        self.regime.charging = flow > 0.0;
        self.sliding = false;
        self.step_s = self.step_s_after_jump;
        self.work.evaluations += 1;
        plant.rates(self.time_s, drive, self.regime, &self.state)
    }

    pub(super) fn advance(
        &mut self,
        plant: &Plant,
        drive: &Drive,
        until_s: f64,
    ) -> Result<(), SimulationError> {
        if plant.load.is_none() && plant.pneumatics.is_none() {
            self.follow_inputs(plant, drive, until_s);
            return Ok(());
        }
        let (mut after_jump, mut rates) = match self.rates.take() {
            Some((known, rates)) if known == *drive => (false, rates),
            _ => (true, self.rates_after_jump(plant, drive)),
        };
        let mut events = 0;
        while self.time_s < until_s {
            let remaining_s = until_s - self.time_s;
            // Equal steps to the end instead of a short last one.
            let steps = if remaining_s <= self.step_s {
                1.0
            } else {
                (remaining_s / self.step_s).ceil()
            };
            let length_s = remaining_s / steps;
            let step = self.trial(plant, drive, &rates, length_s);
            self.work.evaluations += 6;
            let error = self.relative_error(&step);
            let fitting_s = self.fitting_s(length_s, error);
            if error > 1.0 {
                self.work.refused += 1;
                self.step_s = fitting_s;
                if length_s < STEP_S_MIN {
                    let (time_s, step_s) = (self.time_s, length_s);
                    return Err(SimulationError::NoStep { time_s, step_s });
                }
                continue;
            }
            self.work.steps += 1;
            if after_jump {
                self.step_s_after_jump = fitting_s;
                after_jump = false;
            }
            self.step_s = fitting_s;
            match self.event(plant, drive, &step) {
                None => {
                    self.time_s = if steps == 1.0 {
                        until_s
                    } else {
                        self.time_s + length_s
                    };
                    self.state = step.end;
                    rates = step.rates[6];
                }
                Some((fraction, event)) => {
                    self.pass(plant, drive, &step, fraction, event);
                    rates = self.current_rates(plant, drive);
                    self.work.evaluations += 1;
                    events += 1;
                    if events > EVENTS_MAX {
                        let time_s = self.time_s;
                        return Err(SimulationError::Chatter { time_s });
                    }
                }
            }
            if N > NOMINAL_STATES {
                let before = self.state;
                plant.update_terms(Update::AcceptStep, self.time_s, drive, &mut self.state);
                if self.state != before {
                    rates = self.current_rates(plant, drive);
                    self.work.evaluations += 1;
                }
            }
        }
        self.rates = Some((*drive, rates));
        Ok(())
    }

    /// Advances to `until_s` where pressure and contraction are inputs, linear between samples.
    fn follow_inputs(&mut self, plant: &Plant, drive: &Drive, until_s: f64) {
        let (from_s, before) = (self.time_s, self.state);
        let length_s = until_s - from_s;
        self.state[CONTRACTION] += drive.contraction_rate_per_s * length_s;
        self.state[PRESSURE] += drive.pressure_rate_pa_per_s * length_s;
        self.time_s = until_s;
        if N > NOMINAL_STATES {
            plant.propagate((from_s, &before), until_s, &mut self.state);
        }
    }

    /// A step in the present regime.
    #[inline(always)]
    fn trial(&self, plant: &Plant, drive: &Drive, rates: &[f64; N], length_s: f64) -> Step<N> {
        if self.sliding {
            return self.sliding_step(plant, drive, rates, length_s);
        }
        let regime = self.regime;
        let f = |time_s: f64, state: &[f64; N]| plant.rates(time_s, drive, regime, state);
        Step::take(f, self.time_s, &self.state, rates, length_s)
    }

    /// A step at zero flow.
    #[cold]
    fn sliding_step(
        &self,
        plant: &Plant,
        drive: &Drive,
        rates: &[f64; N],
        length_s: f64,
    ) -> Step<N> {
        let f =
            |time_s: f64, state: &[f64; N]| plant.at_reversal(time_s, drive, self.regime, state).1;
        Step::take(f, self.time_s, &self.state, rates, length_s)
    }

    /// Rates after a change of the regime or the state.
    fn current_rates(&self, plant: &Plant, drive: &Drive) -> [f64; N] {
        if self.sliding {
            plant
                .at_reversal(self.time_s, drive, self.regime, &self.state)
                .1
        } else {
            plant.rates(self.time_s, drive, self.regime, &self.state)
        }
    }
}

/// Factor on the step length from the relative error, for a method of order 5.
#[inline]
fn growth(error: f64) -> f64 {
    // Most steps of a weight at rest; avoids the cost of the power function.
    if error < ERROR_NEGLIGIBLE {
        return GROWTH_MAX;
    }
    // Single precision is sufficient, and cheaper.
    let fitting = f64::from((error as f32).powf(-0.2));
    (SAFETY * fitting).clamp(GROWTH_MIN, GROWTH_MAX)
}

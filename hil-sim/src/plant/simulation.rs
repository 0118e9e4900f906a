//! The plant in time: adaptive steps, with stick, slip and the stop located between them.
//!
//! Between two jumps of the drive and two changes of [`Regime`] the equations are smooth, and a
//! step never spans one: breakaway, standstill, the stop and the flow's reversal are found on the
//! step's continuous extension, and the next step begins there.

use super::integrate::Step;
use super::load::{LoadBlock, Motion};
use super::sensors::Reading;
use super::term::Update;
use super::{
    CONTRACTION, CONTRACTION_RATE, Drive, NOMINAL_STATES, PRESSURE, Plant, Regime, STATES_MAX,
    TEMPERATURE,
};
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::pressure::{AbsolutePa, GaugePa};
use std::collections::VecDeque;

/// Default local error per step, relative to each state's range: the benchmark's work-precision
/// table shows what it costs and gives.
pub const TOLERANCE: f64 = 1e-5;

/// Ranges that the tolerance is relative to: ε, ε̇ \[1/s\], P \[Pa\], θ \[K\]; 1 for effects.
const RANGES: [f64; NOMINAL_STATES] = [0.25, 1.0, 4e5, 100.0];
/// Shortest step \[s\]: below it the equations have left physics.
const STEP_S_MIN: f64 = 1e-11;
/// Times that differ by less are the same: a delay of whole rows must not leave steps of rounding.
const SAME_S: f64 = 1e-9;
/// Changes of motion that one advance may see; physics needs a handful in 10 ms.
const EVENTS_MAX: u32 = 10_000;
/// The share of a step to which a change of motion is located: below 1e-15 s of 10 ms.
const MOTION_FRACTION: f64 = 5e-14;
/// The share of a step to which the flow's reversal is located: heat transfer jumps, states do not.
const FLOW_FRACTION: f64 = 1e-6;
/// What a step may shrink by.
const GROWTH_MIN: f64 = 0.2;
/// What a step may grow by.
const GROWTH_MAX: f64 = 5.0;
/// The share of the estimated step that is dared.
const SAFETY: f64 = 0.9;
/// Relative error below which a step may grow by [`GROWTH_MAX`]: (SAFETY / GROWTH_MAX)⁵.
const ERROR_NEGLIGIBLE: f64 = 1.889568e-4;
/// Trial steps that are no steps: the error is not finite, say.
const REFUSED: f64 = f64::INFINITY;

/// Why a simulation could not go on.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// No step is short enough: the state has left physics.
    #[error(
        "the plant's equations have no solution past {time_s:.6} s (step below {step_s:.1e} s)"
    )]
    NoStep {
        /// When \[s\].
        time_s: f64,
        /// The step that was refused \[s\].
        step_s: f64,
    },
    /// The weight starts and stops without end.
    #[error("the weight starts and stops without end at {time_s:.6} s")]
    Chatter {
        /// When \[s\].
        time_s: f64,
    },
}

impl SimulationError {
    /// When it could not go on \[s\].
    pub fn time_s(&self) -> f64 {
        match self {
            SimulationError::NoStep { time_s, .. } | SimulationError::Chatter { time_s } => *time_s,
        }
    }

    /// What is said to the user of `rig`, which has no inputs that could be at fault.
    pub fn of(&self, rig: &Rig) -> BadInput {
        rig.bad_file(&format!("a rig whose plant can be followed, {self}"))
    }
}

/// Where a simulation begins.
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
    /// At time 0: `plant` at rest on its stop, its muscle vented, its gas at ambient temperature.
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

/// What the integrator did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// Accepted steps.
    pub steps: u64,
    /// Steps tried again, shorter.
    pub refused: u64,
    /// Changes of motion.
    pub events: u64,
    /// Evaluations of the plant's equations.
    pub evaluations: u64,
}

/// A plant with its state.
pub struct Simulation {
    plant: Plant,
    core: Core,
    delay_s: f64,
    /// References under way in the command line: when each arrives \[s\], and what it is.
    pending: VecDeque<(f64, GaugePa<f64>)>,
    /// The reference that was sent last, and the one that has arrived last.
    sent: GaugePa<f64>,
    arrived: GaugePa<f64>,
    /// What has brought the state to where it is.
    drive: Drive,
}

/// The state, in an array that fits the plant: the nominal one is the fast one.
enum Core {
    Nominal(Box<Trajectory<NOMINAL_STATES>>),
    Few(Box<Trajectory<8>>),
    Several(Box<Trajectory<16>>),
    Many(Box<Trajectory<STATES_MAX>>),
}

macro_rules! each {
    ($core:expr, $trajectory:ident => $body:expr) => {
        match $core {
            Core::Nominal($trajectory) => $body,
            Core::Few($trajectory) => $body,
            Core::Several($trajectory) => $body,
            Core::Many($trajectory) => $body,
        }
    };
}

impl Simulation {
    /// `plant` at `initial`, its effects settled under `drive`.
    ///
    /// # Panics
    /// If the effects together have more states than [`Plant::new`] admits.
    pub fn new(plant: Plant, initial: &Initial, drive: &Drive, tolerance: f64) -> Simulation {
        let core = match plant.states() {
            NOMINAL_STATES => Core::Nominal(Trajectory::new(&plant, initial, drive, tolerance)),
            5..=8 => Core::Few(Trajectory::new(&plant, initial, drive, tolerance)),
            9..=16 => Core::Several(Trajectory::new(&plant, initial, drive, tolerance)),
            17..=STATES_MAX => Core::Many(Trajectory::new(&plant, initial, drive, tolerance)),
            states => panic!("{states} states"),
        };
        let delay_s = plant.pneumatics.as_ref().map_or(0.0, |p| p.line.delay_s());
        Simulation {
            plant,
            core,
            delay_s,
            pending: VecDeque::new(),
            sent: drive.reference,
            arrived: drive.reference,
            drive: *drive,
        }
    }

    /// Runs to `until_s` under `drive`, whose reference is sent now.
    ///
    /// # Errors
    /// See [`SimulationError`].
    pub fn advance(&mut self, drive: &Drive, until_s: f64) -> Result<(), SimulationError> {
        self.drive = *drive;
        let Simulation { plant, core, .. } = self;
        if self.delay_s <= 0.0 {
            return each!(core, trajectory => trajectory.advance(plant, drive, until_s));
        }
        if drive.reference != self.sent {
            self.sent = drive.reference;
            let arrival_s = each!(core, trajectory => trajectory.time_s) + self.delay_s;
            self.pending.push_back((arrival_s, drive.reference));
        }
        let mut drive = *drive;
        loop {
            let now_s = each!(core, trajectory => trajectory.time_s);
            let next = self.pending.front().copied();
            let stretch_s = match next {
                Some((arrival_s, reference)) if arrival_s <= now_s + SAME_S => {
                    self.arrived = reference;
                    self.pending.pop_front();
                    continue;
                }
                Some((arrival_s, _)) if arrival_s < until_s - SAME_S => arrival_s,
                _ => until_s,
            };
            drive.reference = self.arrived;
            self.drive = drive;
            each!(core, trajectory => trajectory.advance(plant, &drive, stretch_s))?;
            if stretch_s == until_s {
                return Ok(());
            }
        }
    }

    /// Sets the contraction and its rate where they are inputs.
    pub fn prescribe_contraction(&mut self, contraction: f64, rate_per_s: f64) {
        each!(&mut self.core, trajectory => {
            trajectory.state[CONTRACTION] = contraction;
            trajectory.state[CONTRACTION_RATE] = rate_per_s;
            trajectory.rates = None;
        });
    }

    /// Sets the pressure where it is an input.
    pub fn prescribe_pressure(&mut self, pressure: GaugePa<f64>) {
        let absolute = pressure.to_absolute(self.plant.atmospheric);
        each!(&mut self.core, trajectory => {
            trajectory.state[PRESSURE] = absolute.0;
            trajectory.rates = None;
        });
    }

    /// The plant.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Time \[s\].
    pub fn time_s(&self) -> f64 {
        each!(&self.core, trajectory => trajectory.time_s)
    }

    /// Contraction ε \[-\].
    pub fn contraction(&self) -> f64 {
        self.state()[CONTRACTION]
    }

    /// Contraction rate \[1/s\].
    pub fn contraction_rate_per_s(&self) -> f64 {
        self.state()[CONTRACTION_RATE]
    }

    /// Pressure in the muscle.
    pub fn pressure(&self) -> GaugePa<f64> {
        AbsolutePa(self.state()[PRESSURE]).to_gauge(self.plant.atmospheric)
    }

    /// Gas temperature \[K\].
    pub fn temperature_k(&self) -> f64 {
        self.state()[TEMPERATURE]
    }

    /// Muscle force \[N\].
    pub fn force_n(&self) -> f64 {
        self.plant.force_n(self.time_s(), self.state())
    }

    /// What the instruments read, without noise, before the reference of this instant is sent.
    pub fn read(&self) -> Reading {
        self.plant.read(self.time_s(), &self.drive, self.state())
    }

    /// How the weight moves.
    pub fn motion(&self) -> Motion {
        each!(&self.core, trajectory => trajectory.regime.motion)
    }

    /// What the integrator did so far.
    pub fn work(&self) -> Work {
        each!(&self.core, trajectory => trajectory.work)
    }

    fn state(&self) -> &[f64] {
        each!(&self.core, trajectory => &trajectory.state)
    }
}

/// A state of `N` values on its way.
struct Trajectory<const N: usize> {
    time_s: f64,
    state: [f64; N],
    regime: Regime,
    /// The flow stays at its reversal: either sign's heat transfer would turn it back.
    sliding: bool,
    /// Rates of the state, where they are known for the drive.
    rates: Option<(Drive, [f64; N])>,
    /// Per state: 1 over the error that is allowed.
    per_error: [f64; N],
    /// A flow within this is no reversal \[kg/s\].
    flow_error_kg_per_s: f64,
    /// The step that fitted after the last jump of the drive, and the one that fits now \[s\].
    step_s_after_jump: f64,
    step_s: f64,
    work: Work,
}

/// What ends a regime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// The weight stops, meets the stop, or breaks away.
    Motion,
    /// The flow into the muscle reverses.
    Flow,
}

impl<const N: usize> Trajectory<N> {
    fn new(plant: &Plant, initial: &Initial, drive: &Drive, tolerance: f64) -> Box<Self> {
        let mut state = [0.0; N];
        state[CONTRACTION] = initial.contraction;
        state[CONTRACTION_RATE] = initial.contraction_rate_per_s;
        state[PRESSURE] = initial.pressure.to_absolute(plant.atmospheric).0;
        state[TEMPERATURE] = initial.temperature_k;
        plant.settle(initial.time_s, drive, &mut state);
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

    /// How a weight without speed goes on.
    fn at_rest(&self, plant: &Plant, load: &LoadBlock) -> Motion {
        let (breakaway_n, motion) = plant.breakaway_n(load, self.time_s, &self.state);
        if breakaway_n > 0.0 {
            motion
        } else {
            Motion::Stuck
        }
    }

    /// Largest estimated error of a step, over the allowed one.
    #[inline]
    fn relative_error(&self, step: &Step<N>) -> f64 {
        let error = step.error();
        let mut worst = 0.0;
        for (error, per_error) in error.iter().zip(&self.per_error) {
            let relative = (error * per_error).abs();
            // Not `max`, which would hide a NaN.
            if relative > worst || relative.is_nan() {
                worst = relative;
            }
        }
        if worst.is_nan() { REFUSED } else { worst }
    }

    /// The step that fits after one of `length_s` with this error: one that was cut short by the
    /// drive, and has none, tells nothing of longer ones.
    fn fitting_s(&self, length_s: f64, error: f64) -> f64 {
        let fitting_s = length_s * growth(error);
        if error < ERROR_NEGLIGIBLE {
            fitting_s.max(self.step_s)
        } else {
            fitting_s
        }
    }

    /// The rates after a jump of the drive: the flow has its sign anew, and the step is the one
    /// that fitted after the last jump.
    fn rates_after_jump(&mut self, plant: &Plant, drive: &Drive) -> [f64; N] {
        let flow = plant.flow_kg_per_s(self.time_s, drive, &self.state);
        self.regime.charging = flow > 0.0;
        self.sliding = false;
        self.step_s = self.step_s_after_jump;
        self.work.evaluations += 1;
        plant.rates(self.time_s, drive, self.regime, &self.state)
    }

    fn advance(
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
            // Equal steps to the end, rather than a short last one.
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
                plant.update_terms(Update::Commit, self.time_s, drive, &mut self.state);
                if self.state != before {
                    rates = self.current_rates(plant, drive);
                    self.work.evaluations += 1;
                }
            }
        }
        self.rates = Some((*drive, rates));
        Ok(())
    }

    /// Goes to `until_s` where all is input, and straight between its samples.
    fn follow_inputs(&mut self, plant: &Plant, drive: &Drive, until_s: f64) {
        let (from_s, before) = (self.time_s, self.state);
        let way_s = until_s - from_s;
        self.state[CONTRACTION] += drive.contraction_rate_per_s * way_s;
        self.state[PRESSURE] += drive.pressure_rate_pa_per_s * way_s;
        self.time_s = until_s;
        if N > NOMINAL_STATES {
            plant.follow((from_s, &before), until_s, &mut self.state);
        }
    }

    /// Goes to `event` in `step` and into the regime that follows it.
    fn pass(&mut self, plant: &Plant, drive: &Drive, step: &Step<N>, fraction: f64, event: Event) {
        self.time_s += fraction * step.length_s;
        self.state = step.interpolate(fraction);
        match event {
            Event::Motion => self.change_motion(plant),
            Event::Flow => self.change_flow(plant, drive),
        }
        self.work.events += 1;
    }

    /// What ends the regime first in `step`, and where, as a fraction of it.
    #[inline]
    fn event(&self, plant: &Plant, drive: &Drive, step: &Step<N>) -> Option<(f64, Event)> {
        let motion = plant.load.as_ref().and_then(|load| {
            let end = self.motion_end(plant, load, step)?;
            Some((end, Event::Motion))
        });
        let flow = self
            .flow_end(plant, drive, step)
            .map(|end| (end, Event::Flow));
        match (motion, flow) {
            (Some(motion), Some(flow)) if flow.0 < motion.0 => Some(flow),
            (motion, flow) => motion.or(flow),
        }
    }

    /// Where in `step` the flow has reversed.
    #[inline]
    fn flow_end(&self, plant: &Plant, drive: &Drive, step: &Step<N>) -> Option<f64> {
        plant.pneumatics.as_ref()?;
        if self.sliding {
            return self.slide_end(plant, drive, step);
        }
        let sign = if self.regime.charging { 1.0 } else { -1.0 };
        let margin = |fraction: f64, state: &[f64]| {
            let time_s = self.time_s + fraction * step.length_s;
            sign * plant.flow_kg_per_s(time_s, drive, state) + self.flow_error_kg_per_s
        };
        (margin(1.0, &step.end) < 0.0).then(|| {
            bracket(1.0, FLOW_FRACTION, |fraction| {
                margin(fraction, &step.interpolate(fraction))
            })
            .1
        })
    }

    /// Where in `step` the flow leaves its reversal.
    #[cold]
    fn slide_end(&self, plant: &Plant, drive: &Drive, step: &Step<N>) -> Option<f64> {
        let margin = |fraction: f64, state: &[f64; N]| {
            let time_s = self.time_s + fraction * step.length_s;
            let share = plant.at_reversal(time_s, drive, self.regime, state).0;
            share.min(1.0 - share)
        };
        (margin(1.0, &step.end) < 0.0).then(|| {
            bracket(1.0, FLOW_FRACTION, |fraction| {
                margin(fraction, &step.interpolate(fraction))
            })
            .1
        })
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

    /// A step along the flow's reversal.
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

    /// Brings a flow that is at its reversal to the other sign, or keeps it there: where charging
    /// turns it outward and discharging inward it can have neither sign.
    fn change_flow(&mut self, plant: &Plant, drive: &Drive) {
        let (share, _) = plant.at_reversal(self.time_s, drive, self.regime, &self.state);
        if self.sliding {
            self.sliding = false;
            self.regime.charging = share > 0.5;
        } else {
            self.regime.charging = !self.regime.charging;
            self.sliding = share > 0.0 && share < 1.0;
        }
    }

    /// Where in `step` the weight stops, meets the stop, or breaks away.
    #[inline]
    fn motion_end(&self, plant: &Plant, load: &LoadBlock, step: &Step<N>) -> Option<f64> {
        let (begin, end) = (&step.rates[0], &step.rates[6]);
        let sign = match self.regime.motion {
            Motion::Stuck => {
                let margin = |fraction: f64, state: &[f64]| {
                    let time_s = self.time_s + fraction * step.length_s;
                    -plant.breakaway_n(load, time_s, state).0
                };
                let margin_at = |fraction: f64| margin(fraction, &step.interpolate(fraction));
                // The pressure may pass a maximum within the step: look at its middle too.
                let turns = begin[PRESSURE] * end[PRESSURE] < 0.0;
                return if turns && margin_at(0.5) < 0.0 {
                    Some(bracket(0.5, MOTION_FRACTION, margin_at).1)
                } else if margin(1.0, &step.end) < 0.0 {
                    Some(bracket(1.0, MOTION_FRACTION, margin_at).1)
                } else {
                    None
                };
            }
            Motion::Rising => 1.0,
            Motion::Falling => -1.0,
        };
        // The stop ends a fall as well as standstill does.
        let margin = |state: &[f64; N]| {
            let speed_per_s = sign * state[CONTRACTION_RATE];
            if sign > 0.0 {
                speed_per_s
            } else {
                speed_per_s.min(state[CONTRACTION])
            }
        };
        let margin_at = |fraction: f64| margin(&step.interpolate(fraction));
        if margin(&step.end) < 0.0 {
            return Some(bracket(1.0, MOTION_FRACTION, margin_at).0);
        }
        // The speed may pass through zero and back within the step.
        if sign * begin[CONTRACTION_RATE] < 0.0 && sign * end[CONTRACTION_RATE] > 0.0 {
            let slopes = [begin, end].map(|rates| sign * step.length_s * rates[CONTRACTION_RATE]);
            let lowest = lowest(margin(&step.begin), margin(&step.end), slopes, margin_at);
            if margin_at(lowest) < 0.0 {
                return Some(bracket(lowest, MOTION_FRACTION, margin_at).0);
            }
        }
        None
    }

    /// Brings a weight that has just stopped, met the stop, or broken away into its next motion.
    fn change_motion(&mut self, plant: &Plant) {
        let Some(load) = &plant.load else { return };
        self.state[CONTRACTION_RATE] = 0.0;
        // The stop takes the weight without a bounce.
        if self.regime.motion == Motion::Falling && self.state[CONTRACTION] < CONTACT {
            self.state[CONTRACTION] = 0.0;
        }
        self.regime.motion = self.at_rest(plant, load);
    }
}

/// Below this contraction the weight touches the stop: far below any encoder, far above rounding.
const CONTACT: f64 = 1e-12;

/// Factor on the step, from the error relative to the allowed one, for a method of order 5.
#[inline]
fn growth(error: f64) -> f64 {
    // Most steps of a weight at rest: spares the power.
    if error < ERROR_NEGLIGIBLE {
        return GROWTH_MAX;
    }
    // Single precision is plenty, and cheaper.
    let fitting = f64::from((error as f32).powf(-0.2));
    (SAFETY * fitting).clamp(GROWTH_MIN, GROWTH_MAX)
}

/// The place in [0, 1] where `value` is lowest, from its ends and its slopes there, of which the
/// first falls and the second rises: that of the cubic through them, made better by a
/// parabola about it.
fn lowest(begin: f64, end: f64, slopes: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    let cubic = slopes[0] + slopes[1] + 2.0 * (begin - end);
    let square = 3.0 * (end - begin) - 2.0 * slopes[0] - slopes[1];
    let root = (square * square - 3.0 * cubic * slopes[0]).max(0.0).sqrt();
    let lowest = (-slopes[0] / (square + root)).clamp(0.01, 0.99);
    let reach = 0.1 * lowest.min(1.0 - lowest);
    let [left, middle, right] = [lowest - reach, lowest, lowest + reach].map(value);
    let curvature = left - 2.0 * middle + right;
    if curvature > 0.0 {
        lowest + (0.5 * reach * (left - right) / curvature).clamp(-reach, reach)
    } else {
        lowest
    }
}

/// Narrows [0, `to`], where `margin` is ≥ 0 at 0 and below at `to`, to `width_max`: the last place
/// where it is not negative and the first where it is. By the method of Oliveira and Takahashi
/// (ITP, ACM TOMS 47 (2020) 5): the steps of regula falsi, one more than bisection's at most.
fn bracket(to: f64, width_max: f64, margin: impl Fn(f64) -> f64) -> (f64, f64) {
    let (mut yes, mut no) = (0.0, to);
    let (mut margin_yes, mut margin_no) = (margin(yes).max(0.0), margin(no));
    let mut radius = to;
    while no - yes > width_max {
        let (width, middle) = (no - yes, 0.5 * (yes + no));
        let falsi = (yes * margin_no - no * margin_yes) / (margin_no - margin_yes);
        let truncation = (0.2 * width * width / to).min((middle - falsi).abs());
        let toward = (middle - falsi).signum();
        let truncated = falsi + toward * truncation;
        let place = if (truncated - middle).abs() <= radius - 0.5 * width + width_max {
            truncated
        } else {
            middle - toward * (radius - 0.5 * width + width_max)
        };
        // Rounding must not leave the bracket, nor stand on its edge.
        let place = if place > yes && place < no {
            place
        } else {
            middle
        };
        let found = margin(place);
        if found >= 0.0 {
            (yes, margin_yes) = (place, found);
        } else {
            (no, margin_no) = (place, found);
        }
        radius *= 0.5;
    }
    (yes, no)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::Simulated;

    /// A reference that arrives a little after each row cuts that off; the rest of the row is no
    /// more work for it.
    #[test]
    fn a_stretch_that_is_cut_short_leaves_the_next_step_as_long_as_it_was() {
        const ROWS: u32 = 400;
        let tried = |delay_s: f64| {
            let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
            let delay = format!("[[effect]]\nname = \"transport-delay\"\ndelay_s = {delay_s:?}\n");
            let rig = Rig::parse("rig.toml", &(text + &delay)).expect("a rig");
            let clamped = Simulated {
                pressure: true,
                motion: false,
            };
            let plant = Plant::new(&rig, clamped).expect("a plant");
            let drive = |row: u32| Drive {
                reference: GaugePa(2e5 + 5e3 * f64::from(row).sin()),
                contraction_rate_per_s: 0.01 * f64::from(row).cos(),
                ..Drive::default()
            };
            let initial = Initial::vented(&plant);
            let mut simulation = Simulation::new(plant, &initial, &drive(0), TOLERANCE);
            for row in 0..ROWS {
                let until_s = 0.01 * f64::from(row + 1);
                let advanced = simulation.advance(&drive(row), until_s);
                advanced.expect("a solution");
            }
            simulation.work().steps + simulation.work().refused
        };
        let (whole, cut) = (tried(0.03), tried(0.03003));
        // One more for each row, and a few that are tried.
        let most = whole + u64::from(ROWS) * 5 / 4;
        assert!(cut <= most, "{whole}, {cut}");
    }
}

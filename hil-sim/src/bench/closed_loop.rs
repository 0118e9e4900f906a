//! The assist experiment: a finger, the lever, the electronics around the controller, the plant.
//!
//! Every 10 ms the instruments are sampled into the counts that a board would see, the controller
//! ticks, and its DAC value reaches the valve a moment later. All randomness comes from one seed.

use crate::bench::player::Player;
use crate::bench::recorder::{self, Row};
use crate::design;
use crate::error::BadInput;
use crate::record::Record;
use crate::rig::Rig;
use model_core::assist::Assist;
use model_core::constants::TICK_PERIOD_MS;
use model_core::error::SettingsError;
use model_core::io::{Output, Request, Sensors};
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, AdcScale, EncoderCount};
use model_core::supervisor::Mode;
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Drive, Simulated};
use muscle_plant::simulation::{Initial, Simulation};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::Serialize;
use std::ops::Range;

/// By then the controller has checked itself \[s\].
pub const CHECKED_S: f64 = 1.0;

/// Period of the controller's tick \[s\].
pub const TICK_S: f64 = TICK_PERIOD_MS as f64 / 1e3;

/// What the person's hand does, as an intended position of the finger on the lever.
#[derive(Clone, Debug, PartialEq)]
pub enum Finger {
    /// Up along a half cosine, a hold, and down along another.
    Lift {
        /// When it begins \[s\].
        start_s: f64,
        /// How far \[m\].
        travel_m: f64,
        /// How long the way up takes \[s\].
        rise_s: f64,
        /// How long it is held \[s\].
        hold_s: f64,
        /// How long the way down takes \[s\].
        lower_s: f64,
    },
    /// A recorded path, linear between its samples and held at its ends.
    Recorded {
        /// Times, rising \[s\].
        time_s: Vec<f64>,
        /// Finger displacement at these times \[m\].
        finger_m: Vec<f64>,
    },
}

impl Finger {
    /// The paper's lift: 0.12 m in 1 s, once the controller has checked itself.
    pub const PAPER: Finger = Finger::Lift {
        start_s: CHECKED_S,
        travel_m: 0.12,
        rise_s: 1.0,
        hold_s: 4.0,
        lower_s: 1.5,
    };

    /// A recorded path on the experiment's clock. It begins at 0, or so much later that the finger
    /// does not move before the controller has checked itself.
    pub fn recorded(time_s: &[f64], finger_m: Vec<f64>) -> Finger {
        let Some(begin_s) = time_s.first() else {
            return Finger::Recorded {
                time_s: Vec::new(),
                finger_m: Vec::new(),
            };
        };
        let still = finger_m
            .iter()
            .take_while(|place_m| **place_m == finger_m[0]);
        let rest_s = time_s[still.count() - 1] - begin_s;
        let wait_s = (CHECKED_S - rest_s).max(0.0);
        Finger::Recorded {
            time_s: time_s.iter().map(|t| t - begin_s + wait_s).collect(),
            finger_m,
        }
    }

    /// From its first movement to the end of what is asked of it \[s\]: of a lift to the end of its
    /// hold, of a recorded path to its end.
    pub fn followed_s(&self) -> Range<f64> {
        match self {
            Finger::Lift {
                start_s,
                rise_s,
                hold_s,
                ..
            } => *start_s..start_s + rise_s + hold_s,
            Finger::Recorded { time_s, finger_m } => {
                let moves = finger_m.iter().position(|place_m| *place_m != finger_m[0]);
                let begin_s = time_s.get(moves.unwrap_or(0).saturating_sub(1)).copied();
                begin_s.unwrap_or(0.0)..time_s.last().copied().unwrap_or(0.0)
            }
        }
    }

    /// Intended displacement at `time_s` \[m\].
    pub fn intended_m(&self, time_s: f64) -> f64 {
        let half_cosine =
            |share: f64| 0.5 * (1.0 - (core::f64::consts::PI * share.clamp(0.0, 1.0)).cos());
        match self {
            Finger::Lift {
                start_s,
                travel_m,
                rise_s,
                hold_s,
                lower_s,
            } => {
                let up = half_cosine((time_s - start_s) / rise_s);
                let down = half_cosine((time_s - start_s - rise_s - hold_s) / lower_s);
                travel_m * (up - down)
            }
            Finger::Recorded {
                time_s: times_s,
                finger_m,
            } => {
                let after = times_s.partition_point(|t| *t <= time_s);
                match (after.checked_sub(1), finger_m.get(after)) {
                    (None, first) => first.copied().unwrap_or(0.0),
                    (Some(last), None) => finger_m[last],
                    (Some(before), Some(next)) => {
                        let span_s = times_s[after] - times_s[before];
                        let share = (time_s - times_s[before]) / span_s;
                        finger_m[before] + share * (next - finger_m[before])
                    }
                }
            }
        }
    }
}

/// One run of the experiment.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// What the hand intends.
    pub finger: Finger,
    /// An experiment's pressures to play, in place of assisting.
    pub play: Option<Player>,
    /// Stiffness of the person's arm between intent and finger \[N/m\]; infinite for a finger that
    /// goes exactly where it is meant to.
    pub arm_stiffness_n_per_m: f64,
    /// Duration \[s\].
    pub duration_s: f64,
    /// Time from sampling the instruments to the new valve voltage \[s\], within one tick.
    pub output_delay_s: f64,
    /// Time from the tick in which a played experiment asks for the cock to be shut or opened until
    /// it is \[s\].
    pub cock_delay_s: f64,
    /// Noise of the strain-gauge bridge \[N rms\].
    pub bridge_noise_n: f64,
    /// Noise of the pressure sensor \[Pa rms\].
    pub pressure_noise_pa: f64,
    /// Seed of all noise.
    pub seed: u64,
    /// Tolerance of the integrator.
    pub tolerance: f64,
}

impl Experiment {
    /// The paper's lift and hold.
    pub const PAPER: Experiment = Experiment {
        finger: Finger::PAPER,
        play: None,
        arm_stiffness_n_per_m: f64::INFINITY,
        duration_s: 6.0,
        output_delay_s: 100e-6,
        cock_delay_s: 0.0,
        bridge_noise_n: 0.02,
        pressure_noise_pa: 250.0,
        seed: 1,
        tolerance: muscle_plant::simulation::TOLERANCE,
    };
}

/// One tick: the truth when the instruments were sampled, and what the controller made of it.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Time of sampling \[s\].
    pub time_s: f64,
    /// Finger displacement x \[m\].
    pub finger_m: f64,
    /// Finger force F_b \[N\], Eq 6.
    pub finger_force_n: f64,
    /// Muscle force F \[N\].
    pub force_n: f64,
    /// Contraction ε \[-\].
    pub contraction: f64,
    /// Pressure in the muscle.
    pub pressure: GaugePa<f64>,
    /// Gas temperature \[K\].
    pub temperature_k: f64,
    /// Reference pressure at the valve's input from this tick on.
    pub valve_reference: GaugePa<f64>,
    /// While an experiment is played: whether the cock between valve and muscle is to be shut.
    pub shut: Option<bool>,
    /// What the controller read.
    pub sensors: Sensors,
    /// What the controller did.
    pub output: Output,
}

/// The lever and the hand on it.
pub(crate) struct Hand {
    pub(crate) assist: Assist<f64>,
    pub(crate) initial_length_m: f64,
    pub(crate) arm_stiffness_n_per_m: f64,
}

impl Hand {
    /// Finger displacement \[m\]: the lever's spring (Eq 6) and the arm's share the way between
    /// the intended place and the main lever.
    pub(crate) fn finger_m(&self, intended_m: f64, contraction: f64) -> f64 {
        if self.arm_stiffness_n_per_m.is_infinite() {
            return intended_m;
        }
        let lever_m = self.assist.lever_travel_m(self.initial_length_m) * contraction;
        let (arm, lever) = (
            self.arm_stiffness_n_per_m,
            self.assist.input_stiffness_n_per_m,
        );
        (arm * intended_m + lever * lever_m) / (arm + lever)
    }

    pub(crate) fn force_n(&self, finger_m: f64, contraction: f64) -> f64 {
        self.assist
            .finger_force_n(finger_m, contraction, self.initial_length_m)
    }
}

/// What the board's converters make of the instruments' signals.
fn sample(
    settings: &Settings,
    bridge_n: f64,
    pressure_pa: f64,
    contraction: f64,
    request: Request,
) -> Sensors {
    let values = settings.values();
    let travel_m = contraction * f64::from(values.muscle.initial_length_m);
    let counts = (travel_m / f64::from(values.encoder_m_per_count)).round();
    // The converters' 12 bits are coarser than single precision.
    let adc = |scale: &AdcScale, value: f64| -> AdcCount { scale.count(value as f32) };
    Sensors {
        bridge: adc(&values.bridge, bridge_n),
        pressure: adc(&values.pressure_sensor, pressure_pa),
        encoder: EncoderCount(counts as i32 as u32),
        missed_ticks: 0,
        request,
    }
}

/// The settings of a board on `rig`: the rig's muscle, gain and supply, with the electronics and
/// limits of [`SettingsValues::reference`].
///
/// # Errors
/// The rig asks for what no board may do; a section is missing.
pub fn settings(rig: &Rig) -> Result<Settings, BadInput> {
    settings_with(rig, &SettingsValues::reference())
}

/// As [`settings`], with the electronics and limits of `board`.
///
/// # Errors
/// The rig asks for what no board may do; a section is missing.
pub fn settings_with(rig: &Rig, board: &SettingsValues) -> Result<Settings, BadInput> {
    let mut values = *board;
    let (muscle, assist, valve) = (
        &rig.nominal.muscle,
        rig.require_assist()?,
        rig.require_valve()?,
    );
    values.muscle = Muscle {
        alpha_m2: muscle.alpha_m2 as f32,
        beta_m2: muscle.beta_m2 as f32,
        gamma_n: muscle.gamma_n as f32,
        initial_length_m: muscle.initial_length_m as f32,
    };
    values.gain = assist.gain as f32;
    if let Load::Weight(weight) = &rig.nominal.load {
        values.load_kg = weight.mass_kg as f32;
    }
    let supply_pa = valve.supply_pressure.0 as f32;
    values.supply_pressure_pa = supply_pa;
    values.pressure_pa_max = values.pressure_pa_max.min(supply_pa);
    values.play_pressure_pa_max = values.play_pressure_pa_max.min(values.pressure_pa_max);
    Settings::new(values).map_err(|error| {
        let (SettingsError::OutOfRange { name, .. } | SettingsError::Contradiction { name, .. }) =
            error
        else {
            return rig.bad_file(&format!("a rig a board can run, {error}"));
        };
        let key = match name {
            "gain" => "assist.gain",
            "supply_pressure_pa" | "pressure_pa_max" => "valve.supply_pressure_pa",
            "contraction_max" => "muscle.beta_m2",
            "load_kg" | "force_error_n_max" => "load.mass_kg",
            name if name.starts_with("muscle.") => name,
            _ => "assist",
        };
        rig.bad(key, &format!("a rig a board can run, {error}"))
    })
}

/// What ticks each 10 ms, in whatever place it runs.
pub trait Ticker {
    /// Why it may fail.
    type Error: From<BadInput>;

    /// One tick of the controller.
    ///
    /// # Errors
    /// There is none any more.
    fn tick(&mut self, sensors: &Sensors) -> Result<Output, Self::Error>;

    /// Told of each tick, once it is known to its end.
    ///
    /// # Errors
    /// It cannot go on.
    fn seen(&mut self, tick: Tick) -> Result<(), Self::Error>;
}

/// A controller in this program.
struct InProcess<F> {
    tick: F,
    ticks: Vec<Tick>,
}

impl<F: FnMut(&Sensors) -> Output> Ticker for InProcess<F> {
    type Error = BadInput;

    fn tick(&mut self, sensors: &Sensors) -> Result<Output, BadInput> {
        Ok((self.tick)(sensors))
    }

    fn seen(&mut self, tick: Tick) -> Result<(), BadInput> {
        self.ticks.push(tick);
        Ok(())
    }
}

/// Runs `experiment` on `rig`'s plant with the electronics of `settings` and a controller `tick`.
///
/// # Errors
/// As [`run_with`].
pub fn run(
    rig: &Rig,
    settings: &Settings,
    experiment: &Experiment,
    tick: impl FnMut(&Sensors) -> Output,
) -> Result<Vec<Tick>, BadInput> {
    let mut controller = InProcess {
        tick,
        ticks: Vec::new(),
    };
    run_with(rig, settings, experiment, &mut controller)?;
    Ok(controller.ticks)
}

/// Runs `experiment` on `rig`'s plant with the electronics of `settings` and a controller in
/// whatever place it runs. The muscle begins vented, the weight on its stop.
///
/// # Errors
/// The rig lacks a section; the plant has no solution; the controller fails.
pub fn run_with<T: Ticker>(
    rig: &Rig,
    settings: &Settings,
    experiment: &Experiment,
    controller: &mut T,
) -> Result<(), T::Error> {
    let plant = rig.plant(Simulated::WHOLE)?;
    let hand = Hand {
        assist: *rig.require_assist()?,
        initial_length_m: rig.nominal.muscle.initial_length_m,
        arm_stiffness_n_per_m: experiment.arm_stiffness_n_per_m,
    };
    let initial = Initial::vented(&plant);
    let mut drive = Drive::default();
    let mut simulation = Simulation::new(plant, &initial, &drive, experiment.tolerance);
    let mut noise = Pcg64Mcg::seed_from_u64(experiment.seed);
    let mut request = Request::None;
    let mut player = experiment.play.clone();
    let cock_delay_ticks = (experiment.cock_delay_s / TICK_S).round() as usize;
    let ticks = ((experiment.duration_s / TICK_S).round() as usize).max(1);
    for number in 0..ticks {
        let time_s = number as f64 * TICK_S;
        let reading = simulation.read();
        let finger_m = hand.finger_m(
            experiment.finger.intended_m(time_s),
            simulation.contraction(),
        );
        let finger_force_n = hand.force_n(finger_m, simulation.contraction());
        let mut normal = || -> f64 { StandardNormal.sample(&mut noise) };
        let bridge_n = finger_force_n + experiment.bridge_noise_n * normal();
        let pressure_pa = reading.pressure.0 + experiment.pressure_noise_pa * normal();
        let sensors = sample(
            settings,
            bridge_n,
            pressure_pa,
            reading.contraction,
            request,
        );
        let output = controller.tick(&sensors)?;
        request = match &mut player {
            Some(player) => player.request(number as u32, &output),
            // The person asks for assistance as soon as it is offered.
            None if output.mode == Mode::Ready => Request::Assist,
            None => Request::None,
        };
        let valve_reference = valve_reference(settings, &output);
        let shut = player.as_ref().map(|player| player.is_shut(number as u32));
        controller.seen(Tick {
            time_s,
            finger_m,
            finger_force_n,
            force_n: simulation.force_n(),
            contraction: simulation.contraction(),
            pressure: simulation.pressure(),
            temperature_k: simulation.temperature_k(),
            valve_reference,
            shut,
            sensors,
            output,
        })?;
        let mut advance = |drive: &Drive, time_s| {
            let advanced = simulation.advance(drive, time_s);
            advanced.map_err(|error| rig.unsolvable(error))
        };
        advance(&drive, time_s + experiment.output_delay_s)?;
        drive.reference = valve_reference;
        drive.shut = player.as_ref().is_some_and(|player| {
            number >= cock_delay_ticks && player.is_shut((number - cock_delay_ticks) as u32)
        });
        advance(&drive, (number + 1) as f64 * TICK_S)?;
    }
    Ok(())
}

/// The reference pressure at the valve's input that `output` stands for.
pub fn valve_reference(settings: &Settings, output: &Output) -> GaugePa<f64> {
    let pressure = settings.values().valve_drive.pressure(output.valve);
    GaugePa(pressure.0.into())
}

impl Tick {
    /// The tick as a record's row: what was read and sent, with the force of the plant as a load
    /// cell would see it.
    pub fn row(&self) -> Row {
        Row {
            time_s: self.time_s,
            pressure_ref_pa: self.valve_reference.0,
            shut: self.shut,
            sensors: self.sensors,
            output: self.output,
            plant: Some((self.force_n, self.finger_m)),
            board: None,
            begins_with: None,
        }
    }
}

/// The record of `run` with a controller that began with `settings`.
pub fn record(settings: &Settings, run: &[Tick]) -> Record {
    let mut rows: Vec<Row> = run.iter().map(Tick::row).collect();
    if let Some(first) = rows.first_mut() {
        first.begins_with = Some(*settings);
    }
    recorder::record(&rows)
}

/// How well F followed F_c while the finger lifted and held (see [`Finger::followed_s`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tracking {
    /// RMS of F_c − F \[N\].
    pub error_n_rms: f64,
    /// Highest F_c \[N\].
    pub reference_force_n_max: f64,
    /// Mean delay of F behind F_c while both rise from 10 % to 90 % of the weight \[s\].
    pub lag_s: Option<f64>,
    /// How far the weight was lifted \[m\].
    pub lift_m_max: f64,
}

/// When a rising signal first reaches `level` \[s\], between ticks on the line.
fn reaches(run: &[Tick], level: f64, value: fn(&Tick) -> f64) -> Option<f64> {
    let pair = run
        .windows(2)
        .find(|pair| value(&pair[0]) < level && value(&pair[1]) >= level)?;
    let share = (level - value(&pair[0])) / (value(&pair[1]) - value(&pair[0]));
    Some(pair[0].time_s + share * (pair[1].time_s - pair[0].time_s))
}

/// Tracking of a run of `rig` in a span of time.
///
/// # Errors
/// The rig has no weight.
pub fn tracking(rig: &Rig, run: &[Tick], span_s: &Range<f64>) -> Result<Tracking, BadInput> {
    let weight_n = design::weight(rig)?.mass_kg * GRAVITY_M_PER_S2;
    // Half a tick about, for the rounding of times.
    let until = |time_s: f64| run.partition_point(|tick| tick.time_s < time_s - 0.5 * TICK_S);
    let run = &run[until(span_s.start)..until(span_s.end).max(until(span_s.start))];
    let asked = |tick: &Tick| f64::from(tick.output.reference_force_n);
    let largest = |value: &dyn Fn(&Tick) -> f64| run.iter().map(value).fold(0.0, f64::max);
    let squares = run
        .iter()
        .map(|tick| (asked(tick) - tick.force_n).powi(2))
        .sum::<f64>();
    let levels = (1..10).map(|tenth| 0.1 * f64::from(tenth) * weight_n);
    let delays: Option<Vec<f64>> = levels
        .map(|level| {
            let asked_s = reaches(run, level, |tick| tick.output.reference_force_n.into())?;
            Some(reaches(run, level, |tick| tick.force_n)? - asked_s)
        })
        .collect();
    Ok(Tracking {
        error_n_rms: (squares / run.len().max(1) as f64).sqrt(),
        reference_force_n_max: largest(&asked),
        lag_s: delays.map(|delays| delays.iter().sum::<f64>() / delays.len() as f64),
        lift_m_max: rig.nominal.muscle.initial_length_m * largest(&|tick| tick.contraction),
    })
}

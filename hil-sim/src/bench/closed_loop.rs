//! The closed loop of the assist device: person, lever, instruments, controller, valve and plant.
//!
//! Every 10 ms the instruments are sampled into the counts that a board would read, the controller
//! ticks, and its DAC value reaches the valve after a delay. All noise comes from one seed.

use crate::bench::instruments::{Measurands, sample, valve_reference};
use crate::bench::person::{Finger, Hand};
use crate::bench::player::Player;
use crate::bench::port::ControllerPort;
use crate::bench::port::in_process::InProcess;
use crate::bench::tick::{TICK_S, Tick};
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::io::{Output, Request, Sensors};
use model_core::settings::Settings;
use model_core::signal::DacCount;
use model_core::supervisor::Mode;
use muscle_plant::simulation::{Drive, Initial, Simulation};
use muscle_plant::simulation::{Simulated, TOLERANCE};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// One run of the closed loop: the person's motion, noise and delays.
#[derive(Clone, Debug)]
pub struct Run {
    /// The intended path of the finger.
    pub finger: Finger,
    /// A test signal to play instead of assisting.
    pub play: Option<Player>,
    /// Stiffness of the person's arm between intended and actual finger position \[N/m\]; infinite
    /// for a finger that follows its intended path exactly.
    pub arm_stiffness_n_per_m: f64,
    /// Duration \[s\].
    pub duration_s: f64,
    /// Time from sampling the instruments to the new valve voltage \[s\], within one tick.
    pub output_delay_s: f64,
    /// Time from the tick in which a test signal asks for the shut-off valve to be shut or opened
    /// until it is \[s\].
    pub shutoff_delay_s: f64,
    /// Noise of the strain-gauge bridge \[N rms\].
    pub bridge_noise_n: f64,
    /// Noise of the pressure sensor \[Pa rms\].
    pub pressure_noise_pa: f64,
    /// Seed of all noise.
    pub seed: u64,
    /// Tolerance of the integrator.
    pub tolerance: f64,
}

impl Run {
    /// The paper's lift and hold.
    pub const PAPER: Run = Run {
        finger: Finger::PAPER,
        play: None,
        arm_stiffness_n_per_m: f64::INFINITY,
        duration_s: 6.0,
        output_delay_s: 100e-6,
        shutoff_delay_s: 0.0,
        bridge_noise_n: 0.02,
        pressure_noise_pa: 250.0,
        seed: 1,
        tolerance: TOLERANCE,
    };
}

/// Executes `run` on `rig`'s plant with the electronics of `settings` and a controller `tick`.
///
/// # Errors
/// As [`run_on`].
pub fn run_in_process(
    rig: &Rig,
    settings: &Settings,
    run: &Run,
    tick: impl FnMut(&Sensors) -> Output,
) -> Result<Vec<Tick>, BadInput> {
    let mut controller = InProcess::new(tick);
    run_on(rig, settings, run, &mut controller)?;
    Ok(controller.ticks)
}

/// Executes `run` on `rig`'s plant with the electronics of `settings` and the controller at a port.
/// The muscle starts vented, with the weight on its stop.
///
/// # Errors
/// The rig lacks a section; the plant has no solution; the controller fails.
pub fn run_on<T: ControllerPort>(
    rig: &Rig,
    settings: &Settings,
    run: &Run,
    controller: &mut T,
) -> Result<(), T::Error> {
    let values = settings.values();
    let plant = rig.plant(Simulated::WHOLE)?;
    let hand = Hand {
        assist: *rig.require_assist()?,
        initial_length_m: rig.nominal.muscle.initial_length_m,
        arm_stiffness_n_per_m: run.arm_stiffness_n_per_m,
    };
    let initial = Initial::vented(&plant);
    let mut drive = Drive::default();
    let mut simulation = Simulation::new(plant, &initial, &drive, run.tolerance);
    let mut noise = Pcg64Mcg::seed_from_u64(run.seed);
    let mut request = Request::None;
    let mut valve = DacCount::default();
    let mut player = run.play.clone();
    let shutoff_delay_ticks = (run.shutoff_delay_s / TICK_S).round() as usize;
    let ticks = ((run.duration_s / TICK_S).round() as usize).max(1);
    for number in 0..ticks {
        let time_s = number as f64 * TICK_S;
        let reading = simulation.read();
        let intended_m = run.finger.intended_m(time_s);
        let finger_m = hand.finger_m(intended_m, simulation.contraction());
        let finger_force_n = hand.force_n(finger_m, simulation.contraction());
        let mut normal = || -> f64 { StandardNormal.sample(&mut noise) };
        let measured = Measurands {
            bridge_n: finger_force_n + run.bridge_noise_n * normal(),
            pressure_pa: reading.pressure.0 + run.pressure_noise_pa * normal(),
            travel_m: reading.contraction * f64::from(values.muscle.initial_length_m),
        };
        let sensors = sample(values, &measured, valve, request);
        let output = controller.tick(&sensors)?;
        valve = output.valve;
        request = match &mut player {
            Some(player) => player.request(number as u32, &output),
            // The person asks for assistance as soon as it is offered.
            None if output.mode == Mode::Ready => Request::Assist,
            None => Request::None,
        };
        let valve_reference = valve_reference(settings, &output);
        let shut = player.as_ref().map(|player| player.is_shut(number as u32));
        controller.observe(Tick {
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
        advance(&drive, time_s + run.output_delay_s)?;
        drive.reference = valve_reference;
        drive.shut = player.as_ref().is_some_and(|player| {
            let asked = number.checked_sub(shutoff_delay_ticks);
            asked.is_some_and(|asked| player.is_shut(asked as u32))
        });
        advance(&drive, (number + 1) as f64 * TICK_S)?;
    }
    Ok(())
}

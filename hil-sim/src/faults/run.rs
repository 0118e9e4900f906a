//! One case: the closed loop with a fault in it.

use super::bounds::bounds;
use super::instruments::{Instruments, noise_on_link};
use super::kind::{Inject, LinkFault, TickFault};
use super::outcome::{CaseMonitor, Outcome};
use super::plant::{BrokenValve, FallingSupply, Hardware, Hole, LOCK_S, OtherLoad};
use super::unit::{Stored, Told, Unit, frame};
use super::{ASKS_S, Case, Moment};
use crate::bench::board_settings;
use crate::bench::closed_loop::Run;
use crate::bench::person::Hand;
use crate::bench::tick::{TICK_S, Tick};
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::device::{Command, Pins};
use model_core::io::{Request, Sensors};
use model_core::link::ToDevice;
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{COUNT_MAX, DacCount};
use model_core::supervisor::Mode;
use muscle_plant::simulation::{Drive, Plant, Simulated};
use muscle_plant::simulation::{Initial, Simulation};
use muscle_plant::subsystem::Term;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Time that the program takes from a reset to its first tick \[s\].
const BOOT_S: f64 = 0.005;
/// The peak speed is looked for so often in a tick.
const LOOKS: u32 = 5;
/// An experiment's pressure over what a finger would travel: 180 to 360 kPa.
const PLAYED_PA_PER_M: f64 = 3e6;
/// The highest that the settings of such a case allow \[Pa\].
const PLAYED_PA_MAX: f32 = 4e5;
/// The link that nothing comes over any more.
const CUT: Inject = Inject::Link(LinkFault::Cut);
/// A lever is slammed within this \[s\].
const SLAM_S: f64 = 0.03;

/// The plant of a case, its faults and hardware in it.
fn plant(case: &Case) -> Result<Plant, BadInput> {
    let mut plant = case.rig.plant(Simulated::WHOLE)?;
    let valve = case.rig.require_valve()?;
    let (begins_s, size) = (case.fault_s, case.size);
    let locks = case.hardware == Hardware::CheckValve;
    let hole = |conductance_kg_per_pa_s, until_s| Hole {
        from_s: begins_s,
        to_s: if locks { until_s } else { f64::INFINITY },
        conductance_kg_per_pa_s,
    };
    let mut loses_air = false;
    match case.kind.inject {
        Inject::Valve => {
            let share = size;
            plant.add(Term::Valve(Box::new(BrokenValve { begins_s, share })));
        }
        Inject::Leak => plant.add(Term::Gas(Box::new(hole(size, f64::INFINITY)))),
        Inject::HoseOff => {
            loses_air = true;
            plant.add(Term::Valve(Box::new(BrokenValve {
                begins_s,
                share: -1.0,
            })));
            plant.add(Term::Gas(Box::new(hole(size, begins_s + LOCK_S))));
        }
        Inject::Supply(share) => {
            loses_air = true;
            let within_s = size;
            plant.add(Term::Supply(Box::new(FallingSupply {
                begins_s,
                within_s,
                share,
            })));
        }
        Inject::Load => {
            let factor = size;
            plant.add(Term::Load(Box::new(OtherLoad { begins_s, factor })));
        }
        Inject::Hang | Inject::PowerLost => loses_air = true,
        _ => {}
    }
    // After a reset the valve is at its exhaust only then.
    let loses_s = match case.kind.inject {
        Inject::Hang => begins_s + size,
        _ => begins_s,
    };
    let gain = valve.flow_gain_kg_per_pa_s;
    for term in case.hardware.terms(loses_s, loses_air, gain) {
        plant.add(term);
    }
    Ok(plant)
}

/// When the device does not tick.
struct Schedule {
    /// It hangs until here, the DAC as it was, and is reset.
    reset_s: Option<f64>,
    /// Its first tick after that.
    ticks_again_s: f64,
    /// Ticks to be left out in a row, and those of which every second one is.
    leave_out: u32,
    halting: u32,
    /// Ticks left out since the last one; before the first there is none to miss.
    missed: Option<u8>,
    period_s: f64,
}

impl Schedule {
    const REGULAR: Schedule = Schedule {
        reset_s: None,
        ticks_again_s: 0.0,
        leave_out: 0,
        halting: 0,
        missed: None,
        period_s: TICK_S,
    };

    /// True where this tick does not happen.
    fn leaves_out(&mut self) -> bool {
        let halts = self.halting > 0 && self.halting.is_multiple_of(2);
        self.halting = self.halting.saturating_sub(1);
        let leaves_out = halts || self.leave_out > 0;
        self.leave_out = self.leave_out.saturating_sub(1);
        self.missed = self.missed.map(|missed| missed + u8::from(leaves_out));
        leaves_out
    }

    fn hangs(&self, time_s: f64) -> bool {
        self.reset_s.is_some() || time_s < self.ticks_again_s
    }
}

/// What a tick read of the hand and the plant.
struct Reading {
    finger_m: f64,
    finger_force_n: f64,
    pins: Pins,
}

/// A case while it runs.
struct Scene<'a> {
    case: &'a Case,
    values: &'a SettingsValues,
    hand: Hand,
    simulation: Simulation,
    drive: Drive,
    random: Pcg64Mcg,
    instruments: Instruments<'a>,
    schedule: Schedule,
    monitor: CaseMonitor<'a>,
    told: Told,
    /// Assistance has been asked for.
    asked: bool,
    /// The fault has fallen.
    fallen: bool,
    /// Where a slow valve is, and where a stuck DAC \[Pa\].
    slow_pa: f64,
    stuck_pa: Option<f64>,
}

impl<'a> Scene<'a> {
    fn new(case: &'a Case, values: &'a SettingsValues) -> Result<Scene<'a>, BadInput> {
        let plant = plant(case)?;
        let initial = Initial::vented(&plant);
        let drive = Drive::default();
        let tolerance = Run::PAPER.tolerance;
        Ok(Scene {
            case,
            values,
            hand: Hand {
                assist: *case.rig.require_assist()?,
                initial_length_m: case.rig.nominal.muscle.initial_length_m,
                arm_stiffness_n_per_m: case.arm_stiffness_n_per_m,
            },
            simulation: Simulation::new(plant, &initial, &drive, tolerance),
            drive,
            random: Pcg64Mcg::seed_from_u64(case.seed),
            instruments: Instruments::new(case, values),
            schedule: Schedule::REGULAR,
            monitor: CaseMonitor::new(case, bounds(case, values)),
            told: Told::default(),
            asked: false,
            fallen: false,
            slow_pa: 0.0,
            stuck_pa: None,
        })
    }

    /// The fault, where it has fallen, and \[s\] since then.
    fn fault(&self, time_s: f64) -> Option<(Inject, f64)> {
        let since_s = time_s - self.case.fault_s;
        self.fallen.then_some((self.case.kind.inject, since_s))
    }

    /// What happens at once when the fault falls.
    fn fall(&mut self, unit: &mut impl Unit, time_s: f64) {
        let (case, schedule) = (self.case, &mut self.schedule);
        match case.kind.inject {
            Inject::Hang => {
                schedule.reset_s = Some(time_s + case.size);
                schedule.ticks_again_s = time_s + case.size + BOOT_S;
            }
            Inject::PowerLost => {
                schedule.reset_s = Some(time_s);
                schedule.ticks_again_s = time_s + case.size + BOOT_S;
            }
            Inject::Ticks(TickFault::Clock) => schedule.period_s *= 1.0 + case.size,
            Inject::Ticks(TickFault::Missed) => schedule.leave_out = case.size as u32,
            Inject::Ticks(TickFault::Halting) => schedule.halting = 2 * case.size as u32,
            Inject::Damage(memory) => {
                let bit = self.random.random_range(0..1 << 12);
                unit.damage(memory, case.size as usize, bit);
            }
            _ => {}
        }
        self.fallen = true;
        self.monitor.begin(&self.simulation);
    }

    /// What the hand does and the instruments make of it.
    fn read(&mut self, time_s: f64) -> Reading {
        let fault = self.fault(time_s);
        let reading = self.simulation.read();
        let mut intended_m = self.case.finger.intended_m(time_s);
        if let Some((Inject::Lever, since_s)) = fault {
            intended_m += (self.case.size - intended_m) * (since_s / SLAM_S).min(1.0);
        }
        let contraction = self.simulation.contraction();
        let finger_m = self.hand.finger_m(intended_m, contraction);
        // While a test signal is played the lever is free, unless the fault slams it.
        let let_go =
            self.case.moment == Moment::Playing && !matches!(fault, Some((Inject::Lever, _)));
        let finger_force_n = if let_go {
            0.0
        } else {
            self.hand.force_n(finger_m, contraction)
        };
        let mut normal = || -> f64 { StandardNormal.sample(&mut self.random) };
        let truth = [
            finger_force_n + Run::PAPER.bridge_noise_n * normal(),
            reading.pressure.0 + Run::PAPER.pressure_noise_pa * normal(),
            reading.contraction * self.hand.initial_length_m,
        ];
        let since_s = fault.map(|(_, since_s)| since_s);
        Reading {
            finger_m,
            finger_force_n,
            pins: self.instruments.pins(truth, since_s, normal),
        }
    }

    /// What is asked for: assistance once, as soon as it is offered, or an experiment in each tick,
    /// until it falls silent.
    fn request(&mut self, time_s: f64) -> Request {
        let mode = self.told.output.mode;
        let plays = self.case.moment == Moment::Playing;
        let may_ask = time_s >= ASKS_S && !matches!(self.fault(time_s), Some((CUT, _)));
        match mode {
            Mode::Ready | Mode::Playing if may_ask && plays && time_s < self.case.used_s => {
                Request::Play((PLAYED_PA_PER_M * self.case.finger.intended_m(time_s)) as u32)
            }
            Mode::Ready if may_ask && !plays && !self.asked => {
                self.asked = true;
                Request::Assist
            }
            _ => Request::None,
        }
    }

    /// What comes over the link.
    fn bytes(&mut self, time_s: f64, begins: bool) -> (Request, Vec<u8>) {
        let (request, mut bytes) = (self.request(time_s), Vec::new());
        if request != Request::None {
            bytes = frame(&ToDevice::Command(Command::Request(request)));
        }
        if let Some((Inject::Link(fault), _)) = self.fault(time_s) {
            let (size, random) = (self.case.size, &mut self.random);
            bytes.extend(noise_on_link(fault, size, begins, random));
        }
        (request, bytes)
    }

    /// The device's tick; returns the ticks missed before it, or nothing where it does not happen.
    fn tick(&mut self, unit: &mut impl Unit, time_s: f64, pins: &Pins, bytes: &[u8]) -> Option<u8> {
        let schedule = &mut self.schedule;
        if schedule.reset_s.is_some_and(|reset_s| time_s >= reset_s) {
            unit.restart();
            self.told = Told::default();
            schedule.reset_s = None;
        }
        if schedule.leaves_out() {
            unit.skip();
            return None;
        }
        if schedule.hangs(time_s) {
            return None;
        }
        let missed_ticks = schedule.missed.replace(0).unwrap_or(0);
        let late_s = match self.fault(time_s) {
            Some((Inject::Ticks(TickFault::Late), _)) => self.case.size,
            _ => 0.0,
        };
        self.told = unit.tick(pins, missed_ticks, late_s, bytes);
        self.monitor.told(time_s, &self.told);
        Some(missed_ticks)
    }

    /// What comes out of the DAC and its amplifier \[Pa\].
    fn sent_pa(&mut self) -> f64 {
        let pa = |count| f64::from(self.values.valve_drive.pressure(count).0);
        match (self.case.kind.inject, self.fallen) {
            (Inject::Dac, true) if self.case.size < 0.0 => {
                *self.stuck_pa.get_or_insert(self.drive.reference.0)
            }
            (Inject::Dac, true) => self.case.size * pa(DacCount::new(COUNT_MAX)),
            _ => pa(self.told.valve),
        }
    }

    fn advance(&mut self, until_s: f64) -> Result<(), BadInput> {
        let advanced = self.simulation.advance(&self.drive, until_s);
        advanced.map_err(|error| self.case.rig.unsolvable(error))?;
        self.monitor.look(until_s, &self.simulation);
        Ok(())
    }

    /// The plant's part of a tick, in which the valve comes to `sent_pa`; returns when it ends.
    fn advance_a_tick(&mut self, time_s: f64, sent_pa: f64) -> Result<f64, BadInput> {
        let (delay_s, slow) = match self.fault(time_s) {
            Some((Inject::Ticks(TickFault::Late), _)) => (self.case.size, false),
            Some((Inject::ValveSlow, _)) => (Run::PAPER.output_delay_s, true),
            _ => (Run::PAPER.output_delay_s, false),
        };
        let (begins_s, ends_s) = (time_s + delay_s, time_s + self.schedule.period_s);
        self.advance(begins_s)?;
        if !slow {
            self.slow_pa = sent_pa;
        }
        for look in 1..=LOOKS {
            let until_s = begins_s + (ends_s - begins_s) * f64::from(look) / f64::from(LOOKS);
            if slow {
                let share = self.schedule.period_s / f64::from(LOOKS) / self.case.size;
                self.slow_pa += (sent_pa - self.slow_pa) * share.min(1.0);
            }
            self.drive.reference = GaugePa(self.slow_pa);
            self.advance(until_s)?;
        }
        Ok(ends_s)
    }
}

/// Runs `case` on `unit`, a board with `settings`; `seen` is told of each tick.
///
/// # Errors
/// The case's rig does not fit, or its plant cannot be followed.
pub fn run(
    case: &Case,
    settings: &Settings,
    unit: &mut impl Unit,
    mut seen: impl FnMut(&Tick),
) -> Result<Outcome, BadInput> {
    let mut scene = Scene::new(case, settings.values())?;
    let mut time_s = 0.0;
    while time_s < scene.monitor.ends_s() {
        let begins = !scene.fallen && time_s >= case.fault_s;
        if begins {
            scene.fall(unit, time_s);
        }
        let read = scene.read(time_s);
        let (request, bytes) = scene.bytes(time_s, begins);
        let ticked = scene.tick(unit, time_s, &read.pins, &bytes);
        let sent_pa = scene.sent_pa();
        if let Some(missed_ticks) = ticked {
            let simulation = &scene.simulation;
            seen(&Tick {
                time_s,
                finger_m: read.finger_m,
                finger_force_n: read.finger_force_n,
                force_n: simulation.force_n(),
                contraction: simulation.contraction(),
                pressure: simulation.pressure(),
                temperature_k: simulation.temperature_k(),
                valve_reference: GaugePa(sent_pa),
                shut: None,
                sensors: sensors(&read.pins, missed_ticks, request),
                output: scene.told.output,
            });
        }
        time_s = scene.advance_a_tick(time_s, sent_pa)?;
    }
    Ok(scene.monitor.outcome(&scene.told))
}

fn sensors(pins: &Pins, missed_ticks: u8, request: Request) -> Sensors {
    Sensors {
        bridge: pins.bridge,
        pressure: pins.pressure,
        encoder: pins.encoder,
        missed_ticks,
        request,
    }
}

/// What the flash of a case's board holds, where something is stored in it.
pub fn stored(case: &Case) -> Option<Stored> {
    let plays = case.moment == Moment::Playing;
    let board = SettingsValues {
        play_pressure_pa_max: if plays { PLAYED_PA_MAX } else { 0.0 },
        ..SettingsValues::reference()
    };
    match case.kind.inject {
        Inject::Settings(fault) => {
            let mut random = Pcg64Mcg::seed_from_u64(case.seed);
            Some(Stored::after(&board, fault, case.size, &mut random))
        }
        _ if plays => Some(Stored::new(&board)),
        _ => None,
    }
}

/// The settings of a case's board, and whether it may have them: the nominal rig's, or what is left
/// of stored ones.
///
/// # Errors
/// The rig does not fit a board.
pub fn settings(case: &Case) -> Result<(Settings, bool), BadInput> {
    match stored(case) {
        Some(stored) => Ok(stored.load()),
        None => Ok((board_settings::from_rig(&Rig::reference())?, true)),
    }
}

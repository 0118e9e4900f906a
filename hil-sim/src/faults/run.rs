//! Runs one case: the closed loop with a fault.

use super::bounds::bounds;
use super::instruments::{Instruments, noise_on_link};
use super::kind::{Copies, Inject, LinkFault, TickFault};
use super::outcome::{CaseMonitor, Outcome};
use super::plant::{
    BrokenValve, CHECK_VALVE_S, FallingSupply, Hardware, Hole, OtherLoad, PULSES_LAST_S,
};
use super::unit::{DeviceOutput, Stored, Unit, frame};
use super::{Case, Moment, REQUEST_S};
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
use model_core::signal::{AdcCount, COUNT_MAX, DacCount};
use model_core::supervisor::Mode;
use model_core::voted::COPIES;
use muscle_plant::simulation::{Drive, Plant, Simulated};
use muscle_plant::simulation::{Initial, Simulation};
use muscle_plant::subsystem::Term;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Time from a reset of the device to its first tick \[s\].
const BOOT_S: f64 = 0.005;
/// Number of samples per tick for the peaks of the plant's state.
const SAMPLES_PER_TICK: u32 = 5;
/// Pressure of the played test signal per intended travel of the finger: it reaches 180 to 360 kPa.
const PLAYED_PA_PER_M: f64 = 3e6;
/// Highest pressure of a test signal that the settings allow in such a case \[Pa\].
const PLAYED_PA_MAX: f32 = 4e5;
/// The fault after which nothing is received over the link.
const CUT: Inject = Inject::Link(LinkFault::Cut);
/// Time in which the lever is slammed to its position \[s\].
const SLAM_S: f64 = 0.03;

/// The plant of a case, with its fault and protective hardware.
fn plant(case: &Case) -> Result<Plant, BadInput> {
    let mut plant = case.rig.plant(Simulated::WHOLE)?;
    let valve = case.rig.require_valve()?;
    let (begins_s, size) = (case.fault_s, case.size);
    let has_check_valve = case.hardware == Hardware::CheckValve;
    let hole = |conductance_kg_per_pa_s, until_s| Hole {
        from_s: begins_s,
        to_s: if has_check_valve {
            until_s
        } else {
            f64::INFINITY
        },
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
            plant.add(Term::Gas(Box::new(hole(size, begins_s + CHECK_VALVE_S))));
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
        Inject::PowerLost => loses_air = true,
        _ => {}
    }
    let gain = valve.flow_gain_kg_per_pa_s;
    for term in case.hardware.terms(begins_s, loses_air, gain) {
        plant.add(term);
    }
    Ok(plant)
}

/// The ticks that the device misses.
struct Schedule {
    /// Time until which it hangs, with a constant DAC output, and is then reset.
    reset_s: Option<f64>,
    /// Time of its first tick after the reset.
    ticks_again_s: f64,
    /// Number of the next ticks that are missed.
    leave_out: u32,
    /// Number of the next ticks of which every second one is missed.
    halting: u32,
    /// Ticks missed since the last one; `None` before the first tick.
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

    /// Whether this tick is missed.
    fn is_missed(&mut self) -> bool {
        // A board that is still starting has no ticks that could halt.
        let begun = self.missed.is_some();
        let halts = begun && self.halting > 0 && self.halting.is_multiple_of(2);
        self.halting = self.halting.saturating_sub(begun.into());
        let is_missed = halts || self.leave_out > 0;
        self.leave_out = self.leave_out.saturating_sub(1);
        self.missed = self.missed.map(|missed| missed + u8::from(is_missed));
        is_missed
    }

    /// Whether the device is reset now.
    fn is_reset(&self, time_s: f64) -> bool {
        self.reset_s.is_some_and(|reset_s| time_s >= reset_s)
    }

    fn hangs(&self, time_s: f64) -> bool {
        self.reset_s.is_some() || time_s < self.ticks_again_s
    }
}

/// The hand and the pins at the beginning of a tick.
struct Reading {
    finger_m: f64,
    finger_force_n: f64,
    pins: Pins,
}

/// The state of a running case.
struct CaseRun<'a> {
    case: &'a Case,
    values: &'a SettingsValues,
    hand: Hand,
    simulation: Simulation,
    drive: Drive,
    random: Pcg64Mcg,
    instruments: Instruments<'a>,
    schedule: Schedule,
    monitor: CaseMonitor<'a>,
    device: DeviceOutput,
    /// When the level for the valve in the port last changed \[s\].
    pulsed_s: f64,
    assist_requested: bool,
    fault_occurred: bool,
    /// Effective reference of a slow valve \[Pa\].
    slow_pa: f64,
    /// Reference at which the DAC is stuck \[Pa\].
    stuck_pa: Option<f64>,
    /// The DAC's voltage since the last tick.
    read_back: AdcCount,
}

impl<'a> CaseRun<'a> {
    fn new(case: &'a Case, values: &'a SettingsValues) -> Result<CaseRun<'a>, BadInput> {
        let plant = plant(case)?;
        let initial = Initial::vented(&plant);
        let drive = Drive::default();
        let tolerance = Run::PAPER.tolerance;
        Ok(CaseRun {
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
            device: DeviceOutput::default(),
            pulsed_s: f64::NEG_INFINITY,
            assist_requested: false,
            fault_occurred: false,
            slow_pa: 0.0,
            stuck_pa: None,
            read_back: AdcCount::default(),
        })
    }

    /// The fault, if it has occurred, and the time since then \[s\].
    fn fault(&self, time_s: f64) -> Option<(Inject, f64)> {
        let since_s = time_s - self.case.fault_s;
        self.fault_occurred
            .then_some((self.case.kind.inject, since_s))
    }

    /// Starts the fault.
    fn start_fault(&mut self, unit: &mut impl Unit, time_s: f64) {
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
            Inject::Damage(memory, copies) => {
                let named = case.size as usize;
                let same = self.random.random_range(0..1 << 12);
                for copy in 0..COPIES {
                    let bit = match copies {
                        Copies::One => (copy == named).then_some(same),
                        Copies::Two => (copy.wrapping_sub(named) < 2).then_some(same),
                        Copies::All => Some(self.random.random_range(0..1 << 12)),
                    };
                    if let Some(bit) = bit {
                        unit.damage(memory, copy, bit);
                    }
                }
            }
            _ => {}
        }
        self.fault_occurred = true;
        self.monitor.record_fault(&self.simulation);
    }

    /// Reads the hand and the instruments.
    fn read(&mut self, time_s: f64) -> Reading {
        let fault = self.fault(time_s);
        let reading = self.simulation.read();
        let mut intended_m = self.case.finger.intended_m(time_s);
        if let Some((Inject::Lever, since_s)) = fault {
            intended_m += (self.case.size - intended_m) * (since_s / SLAM_S).min(1.0);
        }
        let contraction = self.simulation.contraction();
        let finger_m = self.hand.finger_m(intended_m, contraction);
        // While a test signal is played the lever is released, unless the fault slams it.
        let is_released =
            self.case.moment == Moment::Playing && !matches!(fault, Some((Inject::Lever, _)));
        let finger_force_n = if is_released {
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
        let mut pins = self.instruments.pins(truth, since_s, normal);
        // A reset brings it to 0 V.
        if !self.schedule.is_reset(time_s) {
            pins.read_back = self.read_back;
        }
        if let Some((Inject::Stop(open), _)) = fault {
            pins.stop_open = open;
        }
        Reading {
            finger_m,
            finger_force_n,
            pins,
        }
    }

    /// The request of the PC: assistance once, as soon as the device is ready; or the pressure of a
    /// test signal in each tick, until its end.
    fn request(&mut self, time_s: f64) -> Request {
        let mode = self.device.output.mode;
        let plays = self.case.moment == Moment::Playing;
        let may_request = time_s >= REQUEST_S && !matches!(self.fault(time_s), Some((CUT, _)));
        match mode {
            Mode::Ready | Mode::Playing if may_request && plays && time_s < self.case.used_s => {
                Request::Play((PLAYED_PA_PER_M * self.case.finger.intended_m(time_s)) as u32)
            }
            Mode::Ready if may_request && !plays && !self.assist_requested => {
                self.assist_requested = true;
                Request::Assist
            }
            _ => Request::None,
        }
    }

    /// The request and the bytes on the link; `begins` in the tick in which the fault occurs.
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

    /// Runs the device's tick and returns the number of ticks missed before it; `None` if this tick
    /// is missed.
    fn tick(&mut self, unit: &mut impl Unit, time_s: f64, pins: &Pins, bytes: &[u8]) -> Option<u8> {
        let schedule = &mut self.schedule;
        if schedule.is_reset(time_s) {
            unit.restart();
            self.device = DeviceOutput::default();
            schedule.reset_s = None;
        }
        if schedule.is_missed() {
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
        let device = unit.tick(pins, missed_ticks, late_s, bytes);
        if device.port_pulse != self.device.port_pulse {
            self.pulsed_s = time_s + late_s;
        }
        self.device = device;
        self.monitor.record_output(time_s, &self.device);
        Some(missed_ticks)
    }

    /// The valve's reference at the output of the DAC's amplifier \[Pa\].
    fn valve_reference_pa(&mut self) -> f64 {
        let reference_pa = self.dac_pa();
        let count = self.values.valve_drive.count(GaugePa(reference_pa as f32));
        self.read_back = AdcCount(count.get());
        reference_pa
    }

    fn dac_pa(&mut self) -> f64 {
        let pa = |count| f64::from(self.values.valve_drive.pressure(count).0);
        let full_pa = pa(DacCount::new(COUNT_MAX));
        match (self.case.kind.inject, self.fault_occurred) {
            (Inject::Dac, true) if self.case.size < 0.0 => {
                *self.stuck_pa.get_or_insert(self.drive.reference.0)
            }
            (Inject::Dac, true) => self.case.size * full_pa,
            (Inject::DacOff, true) => {
                (pa(self.device.valve) + self.case.size * full_pa).clamp(0.0, full_pa)
            }
            _ => pa(self.device.valve),
        }
    }

    fn advance(&mut self, until_s: f64) -> Result<(), BadInput> {
        let shuts_s = self.pulsed_s + PULSES_LAST_S + CHECK_VALVE_S;
        self.drive.shut = self.case.hardware == Hardware::CheckValve && until_s > shuts_s;
        let advanced = self.simulation.advance(&self.drive, until_s);
        advanced.map_err(|error| self.case.rig.unsolvable(error))?;
        self.monitor.record_state(until_s, &self.simulation);
        Ok(())
    }

    /// Advances the plant by a tick with the valve's new reference `reference_pa`; returns the end
    /// of the tick \[s\].
    fn advance_a_tick(&mut self, time_s: f64, reference_pa: f64) -> Result<f64, BadInput> {
        let (delay_s, slow) = match self.fault(time_s) {
            Some((Inject::Ticks(TickFault::Late), _)) => (self.case.size, false),
            Some((Inject::ValveSlow, _)) => (Run::PAPER.output_delay_s, true),
            _ => (Run::PAPER.output_delay_s, false),
        };
        let (begins_s, ends_s) = (time_s + delay_s, time_s + self.schedule.period_s);
        self.advance(begins_s)?;
        if !slow {
            self.slow_pa = reference_pa;
        }
        for sample in 1..=SAMPLES_PER_TICK {
            let share = f64::from(sample) / f64::from(SAMPLES_PER_TICK);
            let until_s = begins_s + (ends_s - begins_s) * share;
            if slow {
                let share = self.schedule.period_s / f64::from(SAMPLES_PER_TICK) / self.case.size;
                self.slow_pa += (reference_pa - self.slow_pa) * share.min(1.0);
            }
            self.drive.reference = GaugePa(self.slow_pa);
            self.advance(until_s)?;
        }
        Ok(ends_s)
    }
}

/// Runs `case` on `unit`, a device with `settings`; `on_tick` is called with each tick.
///
/// # Errors
/// The rig lacks a section that the case needs, or its plant cannot be integrated.
pub fn run(
    case: &Case,
    settings: &Settings,
    unit: &mut impl Unit,
    mut on_tick: impl FnMut(&Tick),
) -> Result<Outcome, BadInput> {
    let mut case_run = CaseRun::new(case, settings.values())?;
    let mut time_s = 0.0;
    while time_s < case_run.monitor.ends_s() {
        let begins = !case_run.fault_occurred && time_s >= case.fault_s;
        if begins {
            case_run.start_fault(unit, time_s);
        }
        let read = case_run.read(time_s);
        let (request, bytes) = case_run.bytes(time_s, begins);
        let ticked = case_run.tick(unit, time_s, &read.pins, &bytes);
        let reference_pa = case_run.valve_reference_pa();
        if let Some(missed_ticks) = ticked {
            let simulation = &case_run.simulation;
            on_tick(&Tick {
                time_s,
                finger_m: read.finger_m,
                finger_force_n: read.finger_force_n,
                force_n: simulation.force_n(),
                contraction: simulation.contraction(),
                pressure: simulation.pressure(),
                temperature_k: simulation.temperature_k(),
                valve_reference: GaugePa(reference_pa),
                shut: None,
                sensors: sensors(&read.pins, missed_ticks, request),
                output: case_run.device.output,
            });
        }
        time_s = case_run.advance_a_tick(time_s, reference_pa)?;
    }
    Ok(case_run.monitor.outcome(&case_run.device))
}

fn sensors(pins: &Pins, missed_ticks: u8, request: Request) -> Sensors {
    Sensors {
        bridge: pins.bridge,
        pressure: pins.pressure,
        encoder: pins.encoder,
        read_back: pins.read_back,
        missed_ticks,
        request,
    }
}

/// The content of the flash of a case's board, if settings are stored in it.
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

/// The settings of a case's board, and whether they are valid: those of the nominal rig, or those
/// read from its flash.
///
/// # Errors
/// The settings of the nominal rig exceed the limits of a board.
pub fn settings(case: &Case) -> Result<(Settings, bool), BadInput> {
    match stored(case) {
        Some(stored) => Ok(stored.load()),
        None => Ok((board_settings::from_rig(&Rig::reference())?, true)),
    }
}

//! One case: the closed loop with a fault in it, and what is measured of it.

use super::bounds::{Bounds, bounds, fallen_m_per_s};
use super::kind::{Inject, Instrument, Kind, LinkFault, TickFault};
use super::plant::{BrokenValve, FallingSupply, Hardware, Hole, LOCK_S, OtherLoad};
use super::unit::{Told, Unit, frame};
use super::{ASKS_S, Case, Moment};
use crate::closed_loop::{self, Experiment, Hand, TICK_S, Tick};
use crate::error::BadInput;
use crate::plant::simulation::{Initial, Simulation};
use crate::plant::{Drive, Plant, Simulated, Term};
use model_core::device::{Command, Pins};
use model_core::frame::{Output, Request, Sensors};
use model_core::link::ToDevice;
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, COUNT_MAX, DacCount, EncoderCount};
use model_core::supervisor::{Fault, Mode};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Serialize, Serializer};

/// Time that the program takes from a reset to its first tick \[s\].
const BOOT_S: f64 = 0.005;
/// The peak speed is looked for so often in a tick.
const LOOKS: u32 = 5;
/// Stretch at the end over which the weight must be at rest \[s\].
const END_S: f64 = 0.3;

/// What has become of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Its number.
    pub case: u64,
    /// The fault in words.
    pub fault: String,
    /// When it fell.
    pub moment: Moment,
    /// The same \[s\].
    pub fault_s: f64,
    /// From the fault to a latched reason \[s\].
    pub latched_after_s: Option<f64>,
    /// Highest pressure after the fault \[Pa\].
    pub pressure_pa_max: f64,
    /// Fastest upwards after the fault \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Fastest downwards after the fault \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Fastest in the last 0.3 s \[m/s\].
    pub speed_m_per_s_final: f64,
    /// How far the weight rose above its place at the fault \[m\].
    pub rise_m: f64,
    /// How far it fell below it \[m\].
    pub fall_m: f64,
    /// Its highest place \[m\].
    pub height_m_max: f64,
    /// It was thrown: the rope went slack beyond the muscle's stroke.
    pub thrown: bool,
    /// The controller's last mode.
    #[serde(serialize_with = "in_words")]
    pub mode: Mode,
    /// The reason that it has latched.
    #[serde(serialize_with = "maybe_in_words")]
    pub reason: Option<Fault>,
    /// What it must stay within.
    pub bounds: Bounds,
    /// What it is outside of.
    pub outside: Vec<&'static str>,
}

fn in_words<S: Serializer>(mode: &Mode, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{mode:?}"))
}

fn maybe_in_words<S: Serializer>(fault: &Option<Fault>, serializer: S) -> Result<S::Ok, S::Error> {
    match fault {
        None => serializer.serialize_none(),
        Some(fault) => serializer.collect_str(&format_args!("{fault:?}")),
    }
}

/// The electrical side: what the pins get of the plant.
struct Instruments<'a> {
    values: &'a SettingsValues,
    inject: Inject,
    size: f64,
    /// Readings in physical units and counts when the fault fell.
    frozen: Option<([u16; 2], i64)>,
    /// Counts that the encoder has lost, and its last true count.
    lost: f64,
    last: i64,
}

impl Instruments<'_> {
    /// The pins, `since_s` after the fault where it has fallen.
    fn pins(
        &mut self,
        truth: [f64; 3],
        since_s: Option<f64>,
        mut normal: impl FnMut() -> f64,
    ) -> Pins {
        let size = self.size;
        let mut truth = truth;
        let place = |instrument| match instrument {
            Instrument::Bridge => 0,
            Instrument::Pressure => 1,
            Instrument::Encoder => 2,
        };
        if let Some(since_s) = since_s {
            match self.inject {
                Inject::Drift(instrument) => truth[place(instrument)] += size * since_s,
                Inject::Noise(instrument) => truth[place(instrument)] += size * normal(),
                Inject::AnalogGain(instrument) => truth[place(instrument)] *= size,
                Inject::Reversed(instrument) => truth[place(instrument)] *= -1.0,
                Inject::Jump(instrument) => truth[place(instrument)] += size,
                _ => {}
            }
        }
        let [bridge_n, pressure_pa, travel_m] = truth;
        let values = self.values;
        let mut adc = [
            values.bridge.count(bridge_n as f32).0,
            values.pressure_sensor.count(pressure_pa as f32).0,
        ];
        let mut encoder = (travel_m / f64::from(values.encoder_m_per_count)).round() as i64;
        let moved = encoder - std::mem::replace(&mut self.last, encoder);
        if since_s.is_some() {
            let (frozen, home) = *self.frozen.get_or_insert((adc, encoder));
            let mut flicker = || (size * normal()).round() as i64;
            match self.inject {
                Inject::Reading(instrument) => adc[place(instrument)] = size as u16,
                Inject::Freeze(Instrument::Encoder) => encoder = home + flicker(),
                Inject::Freeze(instrument) => {
                    let count = i64::from(frozen[place(instrument)]) + flicker();
                    adc[place(instrument)] = count.clamp(0, COUNT_MAX.into()) as u16;
                }
                Inject::EncoderLoses => self.lost += size * moved as f64,
                _ => {}
            }
        }
        Pins {
            bridge: AdcCount(adc[0]),
            pressure: AdcCount(adc[1]),
            encoder: EncoderCount((encoder - self.lost.round() as i64) as i32 as u32),
            button_pressed: false,
        }
    }
}

/// Bytes on the link in a tick of a broken one.
fn noise_on_link(fault: LinkFault, size: f64, first: bool, random: &mut impl Rng) -> Vec<u8> {
    let mut bytes = Vec::new();
    let valid = [
        ToDevice::Identify,
        ToDevice::ReadSettings,
        ToDevice::Command(Command::EnterHil),
        ToDevice::Command(Command::LeaveHil),
    ];
    match fault {
        LinkFault::Cut => {
            if first {
                let whole = frame(&valid[2]);
                bytes.extend(&whole[..whole.len() / 2]);
            }
        }
        LinkFault::Flooded => {
            for _ in 0..size as usize {
                bytes.extend(frame(&valid[random.random_range(0..valid.len())]));
            }
        }
        LinkFault::Corrupted => {
            for _ in 0..size as usize {
                let asked = [
                    Request::Assist,
                    Request::Reset,
                    Request::Hold,
                    Request::Vent,
                ];
                let asked = asked[random.random_range(0..asked.len())];
                let mut damaged = frame(&ToDevice::Command(Command::Request(asked)));
                let place = random.random_range(0..damaged.len());
                damaged[place] ^= random.random_range(1..=u8::MAX);
                bytes.extend(damaged);
                bytes.extend((0..random.random_range(0..8)).map(|_| random.random::<u8>()));
            }
            bytes.push(0);
        }
    }
    bytes
}

/// The plant of a case, its faults and hardware in it.
fn plant(case: &Case) -> Result<Plant, BadInput> {
    let mut plant = Plant::new(&case.rig, Simulated::WHOLE)?;
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
    /// Single ticks that are left out.
    missed: u8,
    period_s: f64,
}

/// Runs `case` on `unit`, a board with `settings`; `seen` is told of each tick.
///
/// # Errors
/// The case's rig does not fit.
// A tick from top to bottom, in the order in which things happen.
#[allow(clippy::too_many_lines)]
pub fn run(
    case: &Case,
    settings: &Settings,
    unit: &mut impl Unit,
    mut seen: impl FnMut(&Tick),
) -> Result<Outcome, BadInput> {
    let values = settings.values();
    let plant = plant(case)?;
    let hand = Hand {
        assist: *case.rig.require_assist()?,
        initial_length_m: case.rig.muscle.initial_length_m,
        arm_stiffness_n_per_m: case.arm_stiffness_n_per_m,
    };
    let initial = Initial {
        time_s: 0.0,
        contraction: 0.0,
        contraction_rate_per_s: 0.0,
        pressure: GaugePa(0.0),
        temperature_k: plant.ambient_temperature_k,
    };
    let mut drive = Drive::default();
    let tolerance = Experiment::PAPER.tolerance;
    let mut simulation = Simulation::new(plant, &initial, &drive, tolerance);
    let mut random = Pcg64Mcg::seed_from_u64(case.seed);
    let mut instruments = Instruments {
        values,
        inject: case.kind.inject,
        size: case.size,
        frozen: None,
        lost: 0.0,
        last: 0,
    };
    let mut schedule = Schedule {
        reset_s: None,
        ticks_again_s: 0.0,
        missed: 0,
        period_s: TICK_S,
    };
    let mut watch = Watch::new(case, bounds(case, values));
    let mut told = Told {
        valve: DacCount::default(),
        output: Output::default(),
    };
    let (mut asked, mut fallen, mut slow_pa, mut stuck) = (false, false, 0.0, None);
    let mut halts = 0_u32;
    let mut time_s = 0.0;
    while time_s < case.ends_s {
        let begins = !fallen && time_s >= case.fault_s;
        fallen |= begins;
        if begins {
            fall(case, unit, &mut schedule, time_s, &mut random);
            watch.begin(&simulation);
        }
        let since_s = fallen.then_some(time_s - case.fault_s);
        let reading = simulation.read();
        let mut intended_m = case.finger.intended_m(time_s);
        if let (Inject::Lever, Some(since_s)) = (case.kind.inject, since_s) {
            intended_m += (case.size - intended_m) * (since_s / SLAM_S).min(1.0);
        }
        let finger_m = hand.finger_m(intended_m, simulation.contraction());
        let finger_force_n = hand.force_n(finger_m, simulation.contraction());
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let truth = [
            finger_force_n + Experiment::PAPER.bridge_noise_n * normal(),
            reading.pressure.0 + Experiment::PAPER.pressure_noise_pa * normal(),
            reading.contraction * hand.initial_length_m,
        ];
        let pins = instruments.pins(truth, since_s, normal);
        // The person asks for assistance once, as soon as it is offered.
        let request = if told.output.mode == Mode::Ready && !asked && time_s >= ASKS_S {
            asked = true;
            Request::Assist
        } else {
            Request::None
        };
        let mut bytes = Vec::new();
        if request != Request::None {
            bytes = frame(&ToDevice::Command(Command::Request(request)));
        }
        if let (Inject::Link(fault), true) = (case.kind.inject, fallen) {
            bytes.extend(noise_on_link(fault, case.size, begins, &mut random));
        }
        if let Some(reset_s) = schedule.reset_s
            && time_s >= reset_s
        {
            unit.restart();
            told.valve = DacCount::default();
            told.output = Output::default();
            schedule.reset_s = None;
        }
        let halting = case.kind.inject == Inject::Ticks(TickFault::Halting) && fallen;
        let left_out = halting && f64::from(halts) < 2.0 * case.size && {
            halts += 1;
            halts % 2 == 1
        };
        let hangs = schedule.reset_s.is_some() || time_s < schedule.ticks_again_s;
        let mut ticked = false;
        if left_out || f64::from(schedule.missed) < missing(case, since_s) {
            schedule.missed = schedule.missed.saturating_add(1);
        } else if !hangs {
            let missed = if since_s.is_some_and(|since_s| since_s >= 0.0) {
                schedule.missed_now(case)
            } else {
                0
            };
            told = unit.tick(&pins, missed, &bytes);
            ticked = true;
        }
        let sent_pa = f64::from(values.valve_drive.pressure(told.valve).0);
        let sent_pa = match (case.kind.inject, fallen) {
            (Inject::Dac, true) if case.size < 0.0 => *stuck.get_or_insert(drive.reference.0),
            (Inject::Dac, true) => {
                let full = values.valve_drive.pressure(DacCount::new(COUNT_MAX));
                case.size * f64::from(full.0)
            }
            _ => sent_pa,
        };
        if ticked {
            watch.told(time_s, &told);
            let (valve_reference, output) = (GaugePa(sent_pa), told.output);
            seen(&Tick {
                time_s,
                finger_m,
                finger_force_n,
                force_n: simulation.force_n(),
                contraction: simulation.contraction(),
                pressure: simulation.pressure(),
                temperature_k: simulation.temperature_k(),
                valve_reference,
                sensors: sensors(&pins, schedule.told_missed(case), request),
                output,
            });
        }
        let next_s = time_s + schedule.period_s;
        let delay_s = match (case.kind.inject, fallen) {
            (Inject::Ticks(TickFault::Late), true) => case.size,
            _ => Experiment::PAPER.output_delay_s,
        };
        let mut advance = |drive: &Drive, until_s| match simulation.advance(drive, until_s) {
            Ok(()) => {
                watch.look(until_s, &simulation);
                true
            }
            Err(_) => {
                watch.thrown(&simulation);
                false
            }
        };
        let slow = case.kind.inject == Inject::ValveSlow && fallen;
        let mut goes_on = advance(&drive, time_s + delay_s);
        if !slow {
            slow_pa = sent_pa;
        }
        for look in 1..=LOOKS {
            let until_s =
                time_s + delay_s + (next_s - time_s - delay_s) * f64::from(look) / f64::from(LOOKS);
            if slow {
                let share = (next_s - time_s) / f64::from(LOOKS) / case.size;
                slow_pa += (sent_pa - slow_pa) * share.min(1.0);
            }
            drive.reference = GaugePa(slow_pa);
            goes_on = goes_on && advance(&drive, until_s);
        }
        if !goes_on {
            break;
        }
        time_s = next_s;
    }
    Ok(watch.outcome(&told))
}

/// A lever is slammed within this \[s\].
const SLAM_S: f64 = 0.03;

/// How many ticks in a row are to be left out from the fault on.
fn missing(case: &Case, since_s: Option<f64>) -> f64 {
    match (case.kind.inject, since_s) {
        (Inject::Ticks(TickFault::Missed), Some(_)) => case.size,
        _ => 0.0,
    }
}

impl Schedule {
    /// Ticks that were left out before this one, told once.
    fn missed_now(&mut self, case: &Case) -> u8 {
        match case.kind.inject {
            // Left out for good: the count stays, so that none is left out again.
            Inject::Ticks(TickFault::Missed) if f64::from(self.missed) == case.size => {
                self.missed = self.missed.saturating_add(1);
                case.size as u8
            }
            Inject::Ticks(TickFault::Halting) => std::mem::take(&mut self.missed),
            _ => 0,
        }
    }

    fn told_missed(&self, _: &Case) -> u8 {
        0
    }
}

/// What happens at once when the fault falls.
fn fall(
    case: &Case,
    unit: &mut impl Unit,
    schedule: &mut Schedule,
    time_s: f64,
    random: &mut impl Rng,
) {
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
        Inject::Damage(memory) => {
            unit.damage(memory, case.size as usize, random.random_range(0..1 << 12));
        }
        _ => {}
    }
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

/// Keeps the worst of a case.
struct Watch<'a> {
    case: &'a Case,
    outcome: Outcome,
    fallen: bool,
    begins_m: f64,
    has_assisted: bool,
}

impl Watch<'_> {
    fn new(case: &Case, bounds: Bounds) -> Watch<'_> {
        let outcome = Outcome {
            case: case.number,
            fault: case.words(),
            moment: case.moment,
            fault_s: case.fault_s,
            latched_after_s: None,
            pressure_pa_max: 0.0,
            speed_up_m_per_s_max: 0.0,
            speed_down_m_per_s_max: 0.0,
            speed_m_per_s_final: 0.0,
            rise_m: 0.0,
            fall_m: 0.0,
            height_m_max: 0.0,
            thrown: false,
            mode: Mode::SelfCheck,
            reason: None,
            bounds,
            outside: Vec::new(),
        };
        Watch {
            case,
            outcome,
            fallen: false,
            begins_m: 0.0,
            has_assisted: false,
        }
    }

    fn begin(&mut self, simulation: &Simulation) {
        self.fallen = true;
        self.begins_m = self.height_m(simulation);
    }

    fn height_m(&self, simulation: &Simulation) -> f64 {
        simulation.contraction() * self.case.rig.muscle.initial_length_m
    }

    fn look(&mut self, time_s: f64, simulation: &Simulation) {
        if !self.fallen {
            return;
        }
        let height_m = self.height_m(simulation);
        let speed_m_per_s =
            simulation.contraction_rate_per_s() * self.case.rig.muscle.initial_length_m;
        let outcome = &mut self.outcome;
        let most = |worst: &mut f64, value: f64| *worst = worst.max(value);
        most(&mut outcome.pressure_pa_max, simulation.pressure().0);
        most(&mut outcome.speed_up_m_per_s_max, speed_m_per_s);
        most(&mut outcome.speed_down_m_per_s_max, -speed_m_per_s);
        most(&mut outcome.height_m_max, height_m);
        most(&mut outcome.rise_m, height_m - self.begins_m);
        most(&mut outcome.fall_m, self.begins_m - height_m);
        if time_s > self.case.ends_s - END_S {
            most(&mut outcome.speed_m_per_s_final, speed_m_per_s.abs());
        }
    }

    /// The plant's equations end where the muscle's do: what flies on, flies on.
    fn thrown(&mut self, simulation: &Simulation) {
        let length_m = self.case.rig.muscle.initial_length_m;
        let speed_m_per_s = (simulation.contraction_rate_per_s() * length_m).max(0.0);
        let height_m = self.height_m(simulation)
            + speed_m_per_s.powi(2) / (2.0 * crate::plant::load::GRAVITY_M_PER_S2);
        let outcome = &mut self.outcome;
        outcome.thrown = true;
        outcome.height_m_max = outcome.height_m_max.max(height_m);
        outcome.rise_m = outcome.rise_m.max(height_m - self.begins_m);
        outcome.speed_down_m_per_s_max =
            outcome.speed_down_m_per_s_max.max(fallen_m_per_s(height_m));
    }

    fn told(&mut self, time_s: f64, told: &Told) {
        // A hand that pulls as much as the gauge is off makes it whole again.
        let assists = told.output.mode == Mode::Assisting;
        self.has_assisted |= assists && time_s < self.case.finger.followed_s().start;
        let outcome = &mut self.outcome;
        if told.output.fault.is_some() {
            outcome.reason = told.output.fault;
            if self.fallen && outcome.latched_after_s.is_none() {
                outcome.latched_after_s = Some(time_s - self.case.fault_s);
            }
        }
    }

    fn outcome(mut self, told: &Told) -> Outcome {
        let outcome = &mut self.outcome;
        outcome.mode = told.output.mode;
        let bounds = outcome.bounds;
        let Kind {
            latched,
            bars_start,
            ..
        } = self.case.kind;
        let must = latched.filter(|latched| {
            latched.moments.contains(&self.case.moment) && self.begins_m >= latched.above_m
        });
        let late = must.is_some_and(|must| {
            let after_s = outcome.latched_after_s;
            after_s.is_none_or(|after_s| after_s > must.within_s)
        });
        let wrong = must.is_some_and(|must| {
            let reason = outcome.reason;
            reason.is_some_and(|reason| !(must.is_right)(reason))
        });
        let begun = *bars_start && self.case.moment == Moment::Start && self.has_assisted;
        let false_alarm = self.case.kind.inject == Inject::Healthy && outcome.reason.is_some();
        let checks = [
            (
                "speed up",
                outcome.speed_up_m_per_s_max > bounds.speed_up_m_per_s,
            ),
            (
                "speed down",
                outcome.speed_down_m_per_s_max > bounds.speed_down_m_per_s,
            ),
            ("height", outcome.height_m_max > bounds.height_m),
            ("pressure", outcome.pressure_pa_max > bounds.pressure_pa),
            ("reason late", late),
            ("reason wrong", wrong),
            ("begun", begun),
            ("false alarm", false_alarm),
        ];
        let outside = checks.into_iter().filter(|(_, is_outside)| *is_outside);
        outcome.outside = outside.map(|(name, _)| name).collect();
        self.outcome
    }
}

/// The settings of a case's board: the nominal rig's, or what is left of stored ones.
///
/// # Errors
/// The rig does not fit a board.
pub fn settings(case: &Case) -> Result<(Settings, bool), BadInput> {
    let nominal = crate::rig::Rig::reference();
    match case.kind.inject {
        Inject::Settings(fault) => {
            let mut random = Pcg64Mcg::seed_from_u64(case.seed);
            Ok(super::unit::stored_settings(
                &nominal,
                fault,
                case.size,
                &mut random,
            ))
        }
        _ => Ok((closed_loop::settings(&nominal)?, true)),
    }
}

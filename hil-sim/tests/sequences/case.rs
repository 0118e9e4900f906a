//! One case: a rig, a person, limbs in the way, and a sequence of events.

use super::body::{CONTROLLED_M_PER_S, FOOT, HAND, TRANSIENT_S, TRIP_M_PER_S};
use super::event::{Event, What};
use super::plant::{Exchanged, Force, Limb, Snag, Supply, Valve};
use hil_sim::bench::board_settings::from_rig_and_board;
use hil_sim::bench::person::Finger;
use hil_sim::faults::memory::flip_copy;
use hil_sim::faults::unit::DeviceOutput;
use hil_sim::rig::Rig;
use model_core::controller::Control;
use model_core::device::{Command, Device, Pins};
use model_core::io::Request;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, COUNT_MAX, DacCount, EncoderCount};
use model_core::supervisor::{Fault, Mode};
use model_core::timing::Timing;
use model_core::voted::COPIES;
use muscle_plant::effects::{Effect, slack};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Drive, Initial, Plant, Simulated, Simulation, TOLERANCE};
use muscle_plant::subsystem::Term;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const TICK_S: f64 = 0.01;
/// Time after the last edge of the pulses in which the valve in the port shuts, at most \[s\]: its
/// coil is switched off after 23.3 ms (docs/wiring.md), its spring takes 10 ms.
const PORT_SHUTS_S: f64 = 0.0233 + 0.01;
/// Time after which the last event has ended \[s\].
const EVENTS_S: f64 = 6.0;
/// Time in which the weight comes to rest again \[s\].
const AFTER_S: f64 = 3.8;
/// Time in which a person draws a limb away that is free \[s\].
const DRAWN_AWAY_S: f64 = 1.0;
/// The board takes the mean of so many conversions, over the whole period.
const SCANS: u32 = 16;

/// What is under test: the device on this PC, or a board.
pub trait Unit {
    /// One tick, before which so many were missed.
    fn tick(&mut self, pins: &Pins, missed_ticks: u8, request: Request) -> DeviceOutput;

    /// Misses a tick.
    fn skip(&mut self);

    /// Flips a bit of the reference in a copy of the state.
    fn flip(&mut self, copy: usize, bit: usize);
}

/// The device on this PC.
struct OnPc<C>(Device<C>);

impl<C: Control> Unit for OnPc<C> {
    fn tick(&mut self, pins: &Pins, missed_ticks: u8, request: Request) -> DeviceOutput {
        let command = (request != Request::None).then_some(Command::Request(request));
        let timing = Timing {
            missed_ticks,
            ..Timing::default()
        };
        let tick = self.0.tick(pins, timing, command.into_iter());
        DeviceOutput {
            valve: tick.valve,
            output: tick.telemetry.output,
            port_pulse: tick.port_pulse,
        }
    }

    fn skip(&mut self) {}

    fn flip(&mut self, copy: usize, bit: usize) {
        let state = &mut self.0.controller_mut().memory_mut().state;
        flip_copy(state, copy, |state| {
            let bits = state.pressure_ref_pa.to_bits() ^ 1 << (bit % 32);
            state.pressure_ref_pa = f32::from_bits(bits);
        });
    }
}

/// A case.
#[derive(Clone, Debug)]
pub struct Case {
    pub events: Vec<Event>,
    /// The rig has an enabling device, which the person lets go with everything else.
    pub enabling: bool,
    /// The rig has the valve in the muscle's port (docs/wiring.md).
    pub port: bool,
    /// A limb is in the way: above at this height \[m\], below at that.
    pub hand_m: Option<f64>,
    pub foot_m: Option<f64>,
    pub finger: Finger,
    /// The rig that the board's settings are for.
    pub nominal: Rig,
    /// That rig with values within their tolerances.
    pub rig: Rig,
    pub seed: u64,
}

/// What has happened.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    pub up_m_per_s: f64,
    pub down_m_per_s: f64,
    /// Highest rise while nobody is at the lever \[m\].
    pub unasked_m: f64,
    /// Highest force on the limb \[N\], and how long it was above its lasting limit \[s\].
    pub limb_n: f64,
    pub pressed_s: f64,
    /// Longest contact of the limb \[s\].
    pub contact_s: f64,
    pub fault: Option<Fault>,
    pub needs_hardware: bool,
}

impl Case {
    /// The case of this seed on the reference rig: one to four events.
    pub fn new(seed: u64) -> Case {
        Case::on(Rig::reference(), seed)
    }

    /// The case of this seed on a rig that it draws.
    pub fn on_another_rig(seed: u64) -> Case {
        Case::on(another_rig(seed), seed)
    }

    fn on(nominal: Rig, seed: u64) -> Case {
        let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 24);
        let count = random.random_range(1..=4);
        let mut event = |_| {
            let what = What::draw(&mut random);
            let from_s = match what.is_latent() {
                true if random.random_bool(0.5) => 0.0,
                _ => random.random_range(0.7..EVENTS_S - 1.0),
            };
            let length_s = random.random_range(0.05..2.5);
            // The integrator ends a step there.
            let at_tick = |time_s: f64| (time_s / TICK_S).round() * TICK_S;
            Event {
                what,
                during_s: at_tick(from_s)..at_tick((from_s + length_s).min(EVENTS_S)),
            }
        };
        let mut events: Vec<Event> = (0..count).map(&mut event).collect();
        if random.random_bool(0.25) {
            let from_s = (random.random_range(1.2..4.0_f64) / TICK_S).round() * TICK_S;
            events.push(Event {
                what: What::LetsGo,
                during_s: from_s..EVENTS_S + AFTER_S,
            });
        }
        // Of the reference rig's length.
        let share = nominal.nominal.muscle.initial_length_m / 0.3;
        let mut case = Case::with(nominal, events, seed);
        case.enabling = random.random_bool(0.5);
        match random.random_range(0..4) {
            0 => case.hand_m = Some(share * random.random_range(0.01..0.09)),
            1 => case.foot_m = Some(random.random_range(0.01..0.05)),
            _ => {}
        }
        case
    }

    /// A person who lifts and holds, with these events.
    pub fn with(nominal: Rig, events: Vec<Event>, seed: u64) -> Case {
        let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x5eed);
        let mut rig = nominal.clone();
        let share = rig.nominal.muscle.initial_length_m / 0.3;
        let mut within = |value: &mut f64, relative: f64| {
            *value *= 1.0 + random.random_range(-relative..relative);
        };
        within(&mut rig.nominal.muscle.alpha_m2, 0.01);
        if let Load::Weight(weight) = &mut rig.nominal.load {
            within(&mut weight.mass_kg, 0.02);
            within(&mut weight.viscous_damping_ns_per_m, 0.3);
        }
        // A rope does not push.
        let slack = Effect::typical(&slack::KIND, &slack::KIND.forms[0]);
        rig.effects.push(slack);
        let rise_s = random.random_range(0.6..1.5);
        Case {
            events,
            enabling: false,
            port: false,
            hand_m: None,
            foot_m: None,
            finger: Finger::Lift {
                start_s: 1.3,
                travel_m: share * random.random_range(0.06..0.12),
                rise_s,
                hold_s: random.random_range(0.5..2.5),
                lower_s: rise_s,
            },
            nominal,
            rig,
            seed,
        }
    }

    /// The force with which the weight may rest on something \[N\]: its own, and that of the
    /// friction that holds it down where it has sunk into that.
    pub fn resting_n(&self) -> f64 {
        let friction_n = match self.rig.nominal.load {
            Load::Weight(weight) => weight.coulomb_friction_n,
            Load::Prescribed => 0.0,
        };
        mass_kg(&self.rig) * GRAVITY_M_PER_S2 + friction_n
    }

    /// Height by which a weight that moves as fast as the controller lets it goes on by itself
    /// \[m\]: v/ω, on the stop, where the muscle is softest.
    pub fn swing_m(&self) -> f64 {
        let muscle = &self.nominal.nominal.muscle;
        let mass_kg = mass_kg(&self.nominal);
        let area_m2 = muscle.alpha_m2 + muscle.beta_m2;
        let lifts_pa = (mass_kg * GRAVITY_M_PER_S2 - muscle.gamma_n) / area_m2;
        let stiffness_n_per_m = 2.0 * muscle.alpha_m2 * lifts_pa / muscle.initial_length_m;
        TRIP_M_PER_S / (stiffness_n_per_m / mass_kg).sqrt()
    }

    fn happens(&self, time_s: f64) -> impl Iterator<Item = (&What, f64)> {
        let now = move |event: &&Event| event.during_s.contains(&time_s);
        self.events
            .iter()
            .filter(now)
            .map(move |event| (&event.what, time_s - event.during_s.start))
    }

    fn is_let_go(&self, time_s: f64) -> bool {
        self.happens(time_s).any(|(what, _)| *what == What::LetsGo)
    }

    fn plant(&self, limb: Option<&Limb>) -> Plant {
        let mut plant = self.rig.plant(Simulated::WHOLE).expect("the reference rig");
        for Event { what, during_s } in &self.events {
            let during_s = during_s.clone();
            match *what {
                What::Snag => plant.add(Term::Load(Box::new(Snag(during_s)))),
                What::Force(n) => plant.add(Term::Load(Box::new(Force(during_s, n)))),
                What::Exchanged(by) => plant.add(Term::Load(Box::new(Exchanged(during_s, by)))),
                What::ValveShut => plant.add(Term::Valve(Box::new(Valve(during_s, 0.0, 0.0)))),
                What::ValveAt(share) => {
                    plant.add(Term::Valve(Box::new(Valve(during_s, share, 1.0))));
                }
                What::ValveAjar(share, flow) => {
                    plant.add(Term::Valve(Box::new(Valve(during_s, share, flow))));
                }
                What::Supply(share, period_s) => {
                    plant.add(Term::Supply(Box::new(Supply(during_s, share, period_s))));
                }
                _ => {}
            }
        }
        if let Some(limb) = limb {
            plant.add(Term::Load(Box::new(limb.clone())));
        }
        plant
    }

    fn limb(&self) -> Option<Limb> {
        let (region, height_m, is_above) = match (self.hand_m, self.foot_m) {
            (Some(height_m), _) => (HAND, height_m, true),
            (None, Some(height_m)) => (FOOT, height_m, false),
            (None, None) => return None,
        };
        Some(Limb {
            region,
            height_m,
            is_above,
            // A foot gets below a weight that is lifted.
            is_there: Arc::new(AtomicBool::new(is_above)),
        })
    }

    /// Intended place of the finger \[m\].
    fn finger_m(&self, time_s: f64) -> f64 {
        let lift_m = self.finger.intended_m(time_s);
        self.happens(time_s)
            .fold(lift_m, |finger_m, (what, since_s)| match *what {
                What::Shakes(m, hz) => finger_m + m * (core::f64::consts::TAU * hz * since_s).sin(),
                What::Pushes(m) => finger_m + (m - finger_m) * (since_s / 0.05).min(1.0),
                _ => finger_m,
            })
    }

    fn request(&self, time_s: f64, mode: Mode, tick: u32) -> Request {
        let begins = mode == Mode::Ready && time_s > 1.0 && self.events_allow(time_s);
        for (what, _) in self.happens(time_s) {
            if *what == What::Requests {
                let cycle = [
                    Request::Hold,
                    Request::Assist,
                    Request::Vent,
                    Request::Reset,
                ];
                return cycle[(tick / 20) as usize % 4];
            }
        }
        if begins {
            Request::Assist
        } else {
            Request::None
        }
    }

    /// Nobody asks for assistance who has let go.
    fn events_allow(&self, time_s: f64) -> bool {
        !self.is_let_go(time_s)
    }

    /// Runs it with this controller, on this PC.
    pub fn run<C: Control>(&self, controller: C, settings: &Settings) -> Outcome {
        let mut unit = OnPc(Device::with_controller(controller));
        self.run_on(&mut unit, settings)
    }

    /// Runs it on a unit with these settings.
    pub fn run_on(&self, unit: &mut impl Unit, settings: &Settings) -> Outcome {
        let limb = self.limb();
        let plant = self.plant(limb.as_ref());
        let initial = Initial::vented(&plant);
        let drive = Drive::default();
        let simulation = Simulation::new(plant, &initial, &drive, TOLERANCE);
        let mut run = Running {
            case: self,
            values: settings.values(),
            simulation,
            drive,
            limb,
            unit,
            random: Pcg64Mcg::seed_from_u64(self.seed),
            frozen: None,
            outcome: Outcome::default(),
            let_go_m: None,
            over_s: 0.0,
            touched_s: 0.0,
            free_s: None,
            missed: 0,
            read_back: AdcCount::default(),
            lost_m: 0.0,
            travelled_m: 0.0,
            port_pulse: false,
            pulsed_s: 0.0,
            mode: Mode::SelfCheck,
            flipped: false,
            is_beyond: false,
        };
        run.outcome.needs_hardware = self.events.iter().any(|event| event.what.needs_hardware());
        let mut tick = 0;
        while f64::from(tick) * TICK_S < EVENTS_S + AFTER_S {
            run.tick(tick);
            tick += 1;
            if run.is_beyond {
                break;
            }
        }
        run.outcome
    }

    /// The settings of the board.
    pub fn settings(&self) -> Settings {
        let board = SettingsValues {
            enabling_device: self.enabling.into(),
            ..SettingsValues::reference()
        };
        from_rig_and_board(&self.nominal, &board).expect("a rig that a board can run")
    }
}

struct Running<'a, U> {
    case: &'a Case,
    values: &'a SettingsValues,
    simulation: Simulation,
    drive: Drive,
    limb: Option<Limb>,
    unit: &'a mut U,
    random: Pcg64Mcg,
    /// Bridge, pressure and encoder as they were when they froze.
    frozen: Option<(AdcCount, AdcCount, EncoderCount)>,
    outcome: Outcome,
    /// Height since when nobody is at the lever, the lowest.
    let_go_m: Option<f64>,
    over_s: f64,
    touched_s: f64,
    /// Time for which the limb has been free since it was touched \[s\].
    free_s: Option<f64>,
    missed: u8,
    /// The DAC's voltage since the last tick.
    read_back: AdcCount,
    /// Travel that the encoder has lost, and the travel at the last tick \[m\].
    lost_m: f64,
    travelled_m: f64,
    /// The last level for the valve in the port, and since when it is that.
    port_pulse: bool,
    pulsed_s: f64,
    mode: Mode,
    flipped: bool,
    is_beyond: bool,
}

impl<U: Unit> Running<'_, U> {
    fn height_m(&self) -> f64 {
        self.simulation.contraction() * self.case.rig.nominal.muscle.initial_length_m
    }

    fn tick(&mut self, number: u32) {
        let time_s = f64::from(number) * TICK_S;
        self.flip(time_s);
        let pins = self.pins(time_s);
        if self.misses(time_s, number) {
            self.unit.skip();
        } else {
            let request = self.case.request(time_s, self.mode, number);
            let missed_ticks = std::mem::take(&mut self.missed);
            let tick = self.unit.tick(&pins, missed_ticks, request);
            let output = tick.output;
            (self.mode, self.outcome.fault) = (output.mode, output.fault.or(self.outcome.fault));
            if tick.port_pulse != self.port_pulse {
                (self.port_pulse, self.pulsed_s) = (tick.port_pulse, time_s);
            }
            let count = self.dac(time_s, tick.valve);
            self.read_back = AdcCount(count.get());
            self.drive.reference.0 = f64::from(self.values.valve_drive.pressure(count).0);
        }
        for part in 1..=5 {
            let until_s = time_s + f64::from(part) * TICK_S / 5.0;
            self.drive.shut = self.case.port && until_s > self.pulsed_s + PORT_SHUTS_S;
            if self.simulation.advance(&self.drive, until_s).is_err() {
                // The weight is flung beyond what the plant models.
                self.outcome.up_m_per_s = f64::INFINITY;
                self.is_beyond = true;
                return;
            }
            self.record(until_s, TICK_S / 5.0);
        }
    }

    /// Whether this tick is missed.
    fn misses(&mut self, time_s: f64, number: u32) -> bool {
        let missed = self
            .case
            .happens(time_s)
            .any(|(what, since_s)| match *what {
                What::TicksHalting(every) => number.is_multiple_of(every),
                What::TicksLeft(every) => !number.is_multiple_of(every),
                What::TicksMissed(count) => since_s < f64::from(count) * TICK_S - 1e-9,
                _ => false,
            });
        // The board counts its own start.
        let missed = missed && number > 0;
        self.missed = self.missed.saturating_add(missed.into());
        missed
    }

    fn flip(&mut self, time_s: f64) {
        let mut flips = self
            .case
            .happens(time_s)
            .filter_map(|(what, _)| match *what {
                What::Flip(bit) => Some((bit % COPIES..bit % COPIES + 1, bit, 0)),
                What::FlipTwo(bit) => Some((0..2, bit, 0)),
                What::FlipAll(bit) => Some((0..COPIES, bit, 1)),
                _ => None,
            });
        let Some((copies, bit, further)) = flips.next() else {
            return;
        };
        drop(flips);
        if !std::mem::replace(&mut self.flipped, true) {
            for copy in copies {
                self.unit.flip(copy, bit + further * copy);
            }
        }
    }

    fn dac(&self, time_s: f64, count: DacCount) -> DacCount {
        let count =
            self.case
                .happens(time_s)
                .fold(
                    f64::from(count.get()),
                    |count, (what, since_s)| match *what {
                        What::DacBit(bit) => f64::from(count as u16 & !(1 << bit)),
                        What::DacDrift(share_per_s, most) => {
                            count + f64::from(COUNT_MAX) * (share_per_s * since_s).min(most)
                        }
                        _ => count,
                    },
                );
        DacCount::new(count as u16)
    }

    fn pins(&mut self, time_s: f64) -> Pins {
        let case = self.case;
        let is_let_go = case.is_let_go(time_s);
        let contraction = self.simulation.contraction();
        let length_m = case.rig.nominal.muscle.initial_length_m;
        let assist = case.rig.require_assist().expect("the reference rig");
        let hand_n = if is_let_go {
            0.0
        } else {
            assist.finger_force_n(case.finger_m(time_s), contraction, length_m)
        };
        let reading = self.simulation.read();
        let normal: [f64; 2] = [(); 2].map(|()| StandardNormal.sample(&mut self.random));
        let (mut gauge_n, mut pressure_pa) = (hand_n + 0.02 * normal[0], reading.pressure.0);
        pressure_pa += 250.0 * normal[1];
        let travel_m = self.read_travel_m(time_s, reading.contraction * length_m);
        for (what, since_s) in case.happens(time_s) {
            match *what {
                What::GaugeZero(n) => gauge_n += n,
                What::GaugeCreep(n_per_s, most_n) => {
                    gauge_n += (n_per_s * since_s).clamp(-most_n.abs(), most_n.abs());
                }
                What::GaugeRipple(n, hz) => gauge_n += n * mean_sine(hz, time_s),
                What::GaugeOpens(n_per_s) => gauge_n += n_per_s * since_s,
                What::PressureZero(pa) => pressure_pa += pa,
                _ => {}
            }
        }
        let encoder = (travel_m / f64::from(self.values.encoder_m_per_count)).round() as i64;
        let mut read = (
            self.values.bridge.count(gauge_n as f32),
            self.values.pressure_sensor.count(pressure_pa as f32),
            EncoderCount(encoder as i32 as u32),
        );
        let opens = |(what, _): (&What, f64)| matches!(what, What::GaugeOpens(_));
        if case.happens(time_s).any(opens) {
            // An amplifier ends before the converter's scale does, and it is never still.
            let (count, most) = (f64::from(read.0.0), self.random.random_range(4088..=4090));
            read.0 = AdcCount(count.clamp(6.0, f64::from(most)) as u16);
        }
        let frozen = *self.frozen.get_or_insert(read);
        let freezes = |kind| case.happens(time_s).any(|(what, _)| *what == kind);
        let chosen = (
            if freezes(What::GaugeFrozen) {
                frozen.0
            } else {
                read.0
            },
            if freezes(What::PressureFrozen) {
                frozen.1
            } else {
                read.1
            },
            if freezes(What::EncoderFrozen) {
                frozen.2
            } else {
                read.2
            },
        );
        self.frozen = Some(chosen);
        Pins {
            bridge: chosen.0,
            pressure: chosen.1,
            encoder: chosen.2,
            read_back: self.read_back,
            // It is gripped after the self-check.
            enabling_closed: case.enabling && !is_let_go && time_s > 0.8,
            stop_open: [case.happens(time_s).any(|(what, _)| *what == What::Stops); 2],
            ..Pins::default()
        }
    }

    /// What the encoder makes of a travel.
    fn read_travel_m(&mut self, time_s: f64, travel_m: f64) -> f64 {
        let moved_m = travel_m - std::mem::replace(&mut self.travelled_m, travel_m);
        let mut read_m = travel_m;
        for (what, _) in self.case.happens(time_s) {
            match *what {
                What::EncoderJump(m) => read_m += m,
                What::EncoderLoses(share) => self.lost_m += share * moved_m,
                _ => {}
            }
        }
        read_m - self.lost_m
    }

    fn record(&mut self, time_s: f64, step_s: f64) {
        let height_m = self.height_m();
        let length_m = self.case.rig.nominal.muscle.initial_length_m;
        let speed_m_per_s = self.simulation.contraction_rate_per_s() * length_m;
        let outcome = &mut self.outcome;
        outcome.up_m_per_s = outcome.up_m_per_s.max(speed_m_per_s);
        outcome.down_m_per_s = outcome.down_m_per_s.max(-speed_m_per_s);
        self.let_go_m = match (self.case.is_let_go(time_s), self.let_go_m) {
            (false, _) => None,
            (true, from_m) => Some(from_m.unwrap_or(height_m).min(height_m)),
        };
        if let Some(from_m) = self.let_go_m {
            outcome.unasked_m = outcome.unasked_m.max(height_m - from_m);
        }
        let Some(limb) = &self.limb else { return };
        // A foot gets below what is lifted, and what was drawn away is not there again.
        let is_drawn_away = self.free_s.is_some_and(|free_s| free_s > DRAWN_AWAY_S);
        let gets_below = time_s > 2.5 && height_m > limb.height_m + 0.005;
        if is_drawn_away {
            limb.is_there.store(false, Ordering::Relaxed);
        } else if !limb.is_above && gets_below {
            limb.is_there.store(true, Ordering::Relaxed);
        }
        let force_n = if limb.is_there.load(Ordering::Relaxed) {
            limb.force_n(height_m)
        } else {
            0.0
        };
        outcome.limb_n = outcome.limb_n.max(force_n);
        self.over_s = if force_n > limb.region.lasting_n {
            self.over_s + step_s
        } else {
            0.0
        };
        self.touched_s = if force_n > 20.0 {
            self.free_s = Some(0.0);
            self.touched_s + step_s
        } else {
            0.0
        };
        if let Some(free_s) = &mut self.free_s {
            *free_s = if force_n > 0.0 { 0.0 } else { *free_s + step_s };
        }
        outcome.pressed_s = outcome.pressed_s.max(self.over_s);
        outcome.contact_s = outcome.contact_s.max(self.touched_s);
    }
}

fn mass_kg(rig: &Rig) -> f64 {
    match &rig.nominal.load {
        Load::Weight(weight) => weight.mass_kg,
        Load::Prescribed => 0.0,
    }
}

/// The reference rig with another muscle: `area` times its cross-section, with a bladder of the
/// same thickness, whose force goes with the circumference; `length` times as long.
pub fn rig_of_muscle(area: f64, length: f64) -> Rig {
    let mut rig = Rig::reference();
    for (key, factor) in [
        ("alpha_m2", area),
        ("beta_m2", area),
        ("gamma_n", area.sqrt()),
        ("initial_length_m", length),
        ("volume_d1_m3", area * length),
        ("volume_d2_m3", area * length),
        ("volume_d3_m3", area * length),
    ] {
        *rig.value_mut("muscle", key).expect("a key of the rig") *= factor;
    }
    rig
}

/// A rig of another size: muscle, weight, valve, lever.
fn another_rig(seed: u64) -> Rig {
    let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x7165);
    let mut rig = rig_of_muscle(
        random.random_range(0.7..1.5),
        random.random_range(0.67..1.67),
    );
    let friction_n = random.random_range(1.0..8.0);
    for (section, key, value) in [
        ("load", "mass_kg", random.random_range(6.0..18.0)),
        (
            "load",
            "viscous_damping_ns_per_m",
            random.random_range(20.0..100.0),
        ),
        ("load", "coulomb_friction_n", friction_n),
        ("load", "static_friction_n", 1.6 * friction_n),
        (
            "valve",
            "flow_gain_kg_per_pa_s",
            1.3e-7 * random.random_range(0.7..2.0),
        ),
        ("assist", "gain", random.random_range(10.0..25.0)),
        (
            "assist",
            "input_stiffness_n_per_m",
            random.random_range(100.0..250.0),
        ),
    ] {
        *rig.value_mut(section, key).expect("a key of the rig") = value;
    }
    rig
}

/// What the board makes of a sine of this frequency: the mean over the period before `time_s`.
fn mean_sine(hz: f64, time_s: f64) -> f64 {
    let at = |scan: u32| {
        let before_s = f64::from(scan) / f64::from(SCANS) * TICK_S;
        (core::f64::consts::TAU * hz * (time_s - before_s)).sin()
    };
    (0..SCANS).map(at).sum::<f64>() / f64::from(SCANS)
}

impl Outcome {
    /// The bounds of the body that were violated.
    pub fn violations(&self, case: &Case) -> Vec<&'static str> {
        let limb = case.limb().map(|limb| limb.region);
        let speed_m_per_s = if self.needs_hardware {
            HAND.speed_m_per_s(mass_kg(&case.nominal))
        } else {
            CONTROLLED_M_PER_S
        };
        let checks = [
            ("speed up", self.up_m_per_s > speed_m_per_s),
            ("speed down", self.down_m_per_s > speed_m_per_s),
            (
                "height not asked for",
                self.unasked_m > super::body::UNASKED_M,
            ),
            (
                "transient force",
                limb.is_some_and(|limb| self.limb_n > limb.transient_n),
            ),
            ("lasting force", self.pressed_s > TRANSIENT_S),
            ("not released", self.contact_s > super::body::RELEASE_S),
        ];
        let violated = checks.into_iter().filter(|(_, is_violated)| *is_violated);
        violated.map(|(name, _)| name).collect()
    }
}

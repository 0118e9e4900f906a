//! A rig to be commissioned, with its errors, and the person in front of it.

use hil_sim::bench::error::Error;
use hil_sim::commission::cause::{Cause, Step};
use hil_sim::commission::person::{Person, Question};
use hil_sim::error::BadInput;
use hil_sim::rig::Rig;
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use model_core::signal::{COUNT_MAX, DacCount};
use model_core::start::StartFault;
use muscle_plant::effects::{Catalogue, Effect};
use muscle_plant::simulation::{Drive, Initial, Plant, Simulated, Simulation, TOLERANCE};
use muscle_plant::subsystem::Term;
use std::sync::{Arc, Mutex};

/// How a rig is wired, or what is wrong with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wiring {
    /// As docs/wiring.md has it.
    Right,
    EncoderSwapped,
    EncoderALoose,
    EncoderBLoose,
    EncoderLoose,
    EncoderHalf,
    EncoderSlips,
    BridgeInverted,
    BridgeLoose,
    BridgeUnpowered,
    BridgeGain,
    BridgeZero,
    BridgePressureSwapped,
    PressureLoose,
    PressureCurrent,
    PressureCurrentResistor,
    PressureOtherRange,
    NoGround,
    MonitorMixedUp,
    FittingLeaks,
    StopLoose,
    StopOneContact,
    StopJumpers,
    LampDark,
    DacStuck,
    ValveReversed,
    NoAir,
    Amplifier,
    HalfSupply,
    HoseOnMuscle,
    LoadLight,
    LoadHeavy,
    WeightBlocked,
    MuscleLeaks,
    EncoderLooseLater,
}

/// A wrong rig: what it is, and which step says what.
pub struct Miswired {
    pub wiring: Wiring,
    pub words: &'static str,
    pub step: Step,
    pub cause: Cause,
}

const fn wrong(wiring: Wiring, words: &'static str, step: Step, cause: Cause) -> Miswired {
    Miswired {
        wiring,
        words,
        step,
        cause,
    }
}

/// Every wrong rig, in the order of the steps.
pub const MISWIRED: [Miswired; 34] = [
    wrong(
        Wiring::DacStuck,
        "DAC stuck at 0.8 V",
        Step::Start,
        Cause::StartTest(StartFault::ValveVoltage),
    ),
    wrong(
        Wiring::BridgeLoose,
        "bridge: loose signal wire",
        Step::Start,
        Cause::BridgeOpen,
    ),
    wrong(
        Wiring::PressureLoose,
        "pressure sensor: loose wire",
        Step::Start,
        Cause::PressureOpen,
    ),
    wrong(
        Wiring::PressureCurrent,
        "4–20 mA sensor at the 0–10 V input",
        Step::Start,
        Cause::PressureHigh,
    ),
    wrong(
        Wiring::BridgePressureSwapped,
        "bridge and pressure sensor swapped",
        Step::Start,
        Cause::BridgeAndPressureSwapped,
    ),
    wrong(
        Wiring::NoGround,
        "bridge amplifier without ground",
        Step::Start,
        Cause::Noisy,
    ),
    wrong(
        Wiring::StopLoose,
        "emergency stop: a loose wire",
        Step::Stop,
        Cause::StopOpen,
    ),
    wrong(
        Wiring::StopOneContact,
        "emergency stop: one contact bridged",
        Step::Stop,
        Cause::StopContact,
    ),
    wrong(
        Wiring::StopJumpers,
        "emergency stop: jumpers",
        Step::Stop,
        Cause::StopSilent,
    ),
    wrong(Wiring::LampDark, "lamp dark", Step::Stop, Cause::Lamp),
    wrong(
        Wiring::BridgeInverted,
        "bridge inverted",
        Step::Wiring,
        Cause::BridgeInverted,
    ),
    wrong(
        Wiring::BridgeUnpowered,
        "bridge without excitation",
        Step::Wiring,
        Cause::BridgeSilent,
    ),
    wrong(
        Wiring::EncoderSwapped,
        "encoder channels swapped",
        Step::Wiring,
        Cause::EncoderSwapped,
    ),
    wrong(
        Wiring::EncoderALoose,
        "encoder: A loose",
        Step::Wiring,
        Cause::EncoderOneChannel,
    ),
    wrong(
        Wiring::EncoderBLoose,
        "encoder: B loose",
        Step::Wiring,
        Cause::EncoderOneChannel,
    ),
    wrong(
        Wiring::EncoderLoose,
        "encoder: plug out",
        Step::Wiring,
        Cause::EncoderSilent,
    ),
    wrong(
        Wiring::MonitorMixedUp,
        "DAC and monitor mixed up: the pressure input reads the DAC",
        Step::Wiring,
        Cause::PressureSilent,
    ),
    wrong(
        Wiring::BridgeGain,
        "bridge amplifier with gain 0.7",
        Step::Bridge,
        Cause::BridgeGain,
    ),
    wrong(
        Wiring::BridgeZero,
        "bridge zero off by 5 N",
        Step::Bridge,
        Cause::BridgeZero,
    ),
    wrong(
        Wiring::PressureOtherRange,
        "pressure sensor of 1 MPa for 700 kPa",
        Step::Pressure,
        Cause::PressureRange,
    ),
    wrong(
        Wiring::PressureCurrentResistor,
        "4–20 mA sensor at 165 Ω",
        Step::Pressure,
        Cause::PressureZero,
    ),
    wrong(
        Wiring::FittingLeaks,
        "fitting at the hose leaks",
        Step::Pressure,
        Cause::Leak,
    ),
    wrong(
        Wiring::EncoderHalf,
        "encoder of half the resolution",
        Step::Encoder,
        Cause::EncoderScale,
    ),
    wrong(
        Wiring::EncoderSlips,
        "encoder loses counts",
        Step::Encoder,
        Cause::EncoderLosesCounts,
    ),
    wrong(
        Wiring::ValveReversed,
        "valve mounted the wrong way round",
        Step::Valve,
        Cause::ValveReversed,
    ),
    wrong(Wiring::NoAir, "no air", Step::Valve, Cause::NoAir),
    wrong(
        Wiring::Amplifier,
        "valve amplifier with gain 0.7 of its nominal one",
        Step::Valve,
        Cause::AmplifierGain,
    ),
    wrong(
        Wiring::HalfSupply,
        "half the supply",
        Step::Valve,
        Cause::LowSupply,
    ),
    wrong(
        Wiring::HoseOnMuscle,
        "muscle left on the hose",
        Step::Valve,
        Cause::HoseOnMuscle,
    ),
    wrong(
        Wiring::LoadLight,
        "load of 6 kg for 12 kg",
        Step::Lift,
        Cause::LoadLighter,
    ),
    wrong(
        Wiring::LoadHeavy,
        "load of 18 kg for 12 kg",
        Step::Lift,
        Cause::LoadHeavier,
    ),
    wrong(
        Wiring::WeightBlocked,
        "weight blocked",
        Step::Lift,
        Cause::NotLifted,
    ),
    wrong(
        Wiring::MuscleLeaks,
        "fitting at the muscle leaks",
        Step::Lift,
        Cause::MuscleLeak,
    ),
    wrong(
        Wiring::EncoderLooseLater,
        "encoder comes loose before the lift",
        Step::Lift,
        Cause::NotLifted,
    ),
];

/// Noise of the converters \[counts\], uniform to either side.
const NOISE: u64 = 3;
/// Speed of the person's hands: a second from one state to the next.
const HAND_TICKS: f64 = 100.0;

/// Questions of a session that goes round in circles.
const QUESTIONS_MAX: usize = 200;

/// What the person does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Hands {
    lever_n: f64,
    lift_m: f64,
    pump_pa: f64,
    stop: bool,
}

/// What is at the end of the hose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hose {
    Pump,
    Plug,
    Muscle,
}

/// Voltages at the board's inputs as counts, and its contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    pub bridge: u16,
    pub pressure: u16,
    pub encoder: i32,
    pub stop_open: [bool; 2],
}

/// The rig and its person.
pub struct World {
    pub wiring: Wiring,
    /// Electronics as they really are.
    truth: SettingsValues,
    /// The rig as it really is.
    pub rig: Rig,
    hands: Hands,
    wanted: Hands,
    hose: Hose,
    air: bool,
    simulation: Simulation,
    drive: Drive,
    time_s: f64,
    pump_leak: f64,
    lost_counts: i32,
    random: u64,
    /// Furthest that air has moved the weight \[m\].
    pub moved_m: f64,
    /// The questions so far.
    questions: usize,
}

impl World {
    pub fn new(wiring: Wiring) -> World {
        let mut rig = Rig::reference();
        match wiring {
            Wiring::LoadLight => *rig.value_mut("load", "mass_kg").unwrap() = 6.0,
            Wiring::LoadHeavy => *rig.value_mut("load", "mass_kg").unwrap() = 18.0,
            Wiring::WeightBlocked => *rig.value_mut("load", "mass_kg").unwrap() = 200.0,
            Wiring::HalfSupply => *rig.value_mut("valve", "supply_pressure_pa").unwrap() = 2.5e5,
            _ => {}
        }
        let truth = SettingsValues::reference();
        let (simulation, drive) = simulation(&rig, wiring, Hose::Pump);
        World {
            wiring,
            truth,
            rig,
            hands: Hands::default(),
            wanted: Hands::default(),
            hose: Hose::Pump,
            air: false,
            simulation,
            drive,
            time_s: 0.0,
            pump_leak: 1.0,
            lost_counts: 0,
            random: 0x9e37_79b9_7f4a_7c15,
            moved_m: 0.0,
            questions: 0,
        }
    }

    /// Where the weight is now \[m\].
    pub fn travel_m(&self) -> f64 {
        f64::from(self.truth.muscle.initial_length_m) * self.simulation.contraction()
    }

    fn connect(&mut self, hose: Hose) {
        let hose = match (self.wiring, hose) {
            (Wiring::HoseOnMuscle, Hose::Plug) => Hose::Muscle,
            _ => hose,
        };
        (self.simulation, self.drive) = simulation(&self.rig, self.wiring, hose);
        (self.hose, self.time_s) = (hose, 0.0);
    }

    /// The person corrects what is wrong.
    pub fn repair(&mut self) {
        self.wiring = Wiring::Right;
        self.rig = Rig::reference();
    }

    fn noise(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        ((self.random >> 33) % (2 * NOISE + 1)) as f64 - NOISE as f64
    }

    /// Ten milliseconds with this DAC count at the valve's amplifier; the inputs at their end.
    pub fn pass(&mut self, valve: DacCount) -> Inputs {
        let share = 1.0 / HAND_TICKS;
        let toward = |now: f64, to: f64, span: f64| now + (to - now).clamp(-span, span);
        let (hands, wanted) = (&mut self.hands, self.wanted);
        hands.lever_n = toward(hands.lever_n, wanted.lever_n, 20.0 * share);
        hands.lift_m = toward(hands.lift_m, wanted.lift_m, 0.0173 * share);
        hands.pump_pa = toward(hands.pump_pa, wanted.pump_pa, 3e5 * share);
        hands.stop = wanted.stop;
        if self.wiring == Wiring::FittingLeaks {
            self.pump_leak *= 1.0 - 5e-4;
        }
        self.drive.reference = self.at_valve(valve);
        self.time_s += 0.01;
        if self.hose != Hose::Pump {
            self.simulation
                .advance(&self.drive, self.time_s)
                .expect("the plant can be integrated");
        }
        self.moved_m = self.moved_m.max(self.travel_m());
        self.inputs(valve)
    }

    /// The reference at the valve for a DAC count.
    fn at_valve(&self, valve: DacCount) -> GaugePa<f64> {
        let pressure_pa = f64::from(self.truth.valve_drive.pressure(valve).0);
        let supply_pa = self.rig.require_valve().unwrap().supply_pressure.0;
        GaugePa(match self.wiring {
            _ if !self.air => 0.0,
            Wiring::NoAir | Wiring::MonitorMixedUp => 0.0,
            Wiring::Amplifier => 0.7 * pressure_pa,
            Wiring::ValveReversed => supply_pa - pressure_pa,
            _ => pressure_pa,
        })
    }

    fn inputs(&mut self, valve: DacCount) -> Inputs {
        let truth = self.truth;
        let pressure_pa = match self.hose {
            Hose::Pump => self.hands.pump_pa * self.pump_leak,
            _ => self.simulation.read().pressure.0,
        };
        let noise = [self.noise(), self.noise()];
        let counts = |scale: model_core::signal::AdcScale, quantity: f64| {
            f64::from(scale.zero_count) + quantity / f64::from(scale.per_count)
        };
        let mut bridge = counts(truth.bridge, self.hands.lever_n);
        let mut pressure = counts(truth.pressure_sensor, pressure_pa);
        match self.wiring {
            Wiring::BridgeInverted => bridge = 4096.0 - bridge,
            Wiring::BridgeUnpowered => bridge = 2048.0,
            Wiring::BridgeGain => bridge = 2048.0 + 0.7 * (bridge - 2048.0),
            Wiring::BridgeZero => bridge += 410.0,
            Wiring::BridgeLoose => bridge = 0.0,
            Wiring::NoGround => bridge += 30.0 * noise[1],
            Wiring::BridgePressureSwapped => std::mem::swap(&mut bridge, &mut pressure),
            Wiring::PressureLoose => pressure = 0.0,
            Wiring::PressureCurrent => pressure = 4095.0,
            // 4–20 mA for 0–700 kPa at 165 Ω.
            Wiring::PressureCurrentResistor => {
                pressure = 4095.0 * (0.2 + 0.8 * pressure_pa / 7e5);
            }
            Wiring::PressureOtherRange => pressure = 409.6 + 3276.8 * pressure_pa / 1e6,
            // The monitor's 0.5–4.5 V over its range, and the valve gets nothing.
            Wiring::MonitorMixedUp => {
                pressure = 409.6 + 3276.8 * f64::from(valve.get()) / f64::from(COUNT_MAX);
            }
            _ => {}
        }
        let count = |value: f64, noise: f64| {
            (value + noise).round().clamp(0.0, f64::from(COUNT_MAX)) as u16
        };
        Inputs {
            bridge: count(bridge, noise[0]),
            pressure: count(pressure, noise[1]),
            encoder: self.encoder(),
            stop_open: self.stop_open(),
        }
    }

    fn encoder(&mut self) -> i32 {
        let travel_m = self.travel_m().max(self.hands.lift_m);
        let count = (travel_m / f64::from(self.truth.encoder_m_per_count)).round() as i32;
        match self.wiring {
            Wiring::EncoderSwapped => -count,
            Wiring::EncoderHalf => count / 2,
            Wiring::EncoderLoose => 0,
            // With the other channel still, each edge of this one goes to and fro.
            Wiring::EncoderALoose => count.div_euclid(2).rem_euclid(2),
            Wiring::EncoderBLoose => (count + 1).div_euclid(2).rem_euclid(2),
            Wiring::EncoderLooseLater if self.hose == Hose::Muscle => 0,
            Wiring::EncoderSlips => {
                self.lost_counts = self.lost_counts.max(count / 20);
                count - self.lost_counts
            }
            _ => count,
        }
    }

    fn stop_open(&self) -> [bool; 2] {
        let open = self.hands.stop;
        match self.wiring {
            Wiring::StopLoose => [true, open],
            Wiring::StopOneContact => [open, false],
            Wiring::StopJumpers => [false; 2],
            _ => [open; 2],
        }
    }

    /// What the board's start-up test finds.
    pub fn start_fault(&self) -> Option<StartFault> {
        (self.wiring == Wiring::DacStuck).then_some(StartFault::ValveVoltage)
    }

    /// The person acts and answers.
    pub fn act(&mut self, name: &str) -> String {
        self.questions += 1;
        self.move_hands(name);
        match name {
            "pressure-gauge" => self.pump_leak = 1.0,
            "plug" => {
                self.air = false;
                self.connect(Hose::Plug);
            }
            "supply" => self.air = true,
            "muscle-on" => {
                self.air = true;
                self.connect(Hose::Muscle);
            }
            _ => {}
        }
        let answer = match name {
            "bridge-mass-1" => "0.5",
            "bridge-mass-2" => "1",
            "pressure-gauge" => "2.5e5",
            "spacer" => "0.02",
            "supply" => "5e5",
            "load" => "12",
            "lamp" if self.wiring == Wiring::LampDark => "n",
            "lamp" | "write" => "y",
            // It has moved, or it is not free.
            "higher" => match self.wiring {
                Wiring::WeightBlocked | Wiring::EncoderLooseLater => "n",
                _ => "y",
            },
            "finding" => "q",
            _ => "",
        };
        answer.into()
    }

    fn move_hands(&mut self, name: &str) {
        let rest = Hands {
            pump_pa: self.wanted.pump_pa,
            ..Hands::default()
        };
        let weight_n = 9.806_65;
        let lever = |lever_n| Hands { lever_n, ..rest };
        let lift = |lift_m| Hands { lift_m, ..rest };
        let pump = |pump_pa| Hands { pump_pa, ..rest };
        let stop = Hands { stop: true, ..rest };
        // Quick ones are over before the answer.
        let (hands, quick) = match name {
            "stop-press" => (stop, true),
            "stop-release" | "bridge-zero" | "encoder-stop" | "encoder-home" => (rest, true),
            "lever" => (lever(5.0), false),
            "lift-by-hand" => (lift(0.01), false),
            "pump" => (pump(1e5), false),
            "bridge-mass-1" => (lever(0.5 * weight_n), true),
            "bridge-mass-2" => (lever(weight_n), true),
            "pressure-gauge" => (pump(2.5e5), true),
            "spacer" => (lift(0.02), true),
            "pressure-zero" | "plug" | "muscle-on" => (Hands::default(), true),
            _ => return,
        };
        self.wanted = hands;
        if quick {
            self.hands = hands;
        }
    }
}

fn leak(conductance_kg_per_pa_s: f64) -> Term {
    let catalogue = Catalogue::standard();
    let kind = catalogue.find("leak").expect("a leak");
    let effect = Effect {
        kind,
        form: &kind.forms[0],
        values: vec![conductance_kg_per_pa_s],
    };
    effect.term()
}

fn simulation(rig: &Rig, wiring: Wiring, hose: Hose) -> (Simulation, Drive) {
    let simulated = match hose {
        Hose::Muscle => Simulated::WHOLE,
        Hose::Pump | Hose::Plug => Simulated::GAS_ONLY,
    };
    let mut plant: Plant = rig.plant(simulated).expect("a plant");
    if wiring == Wiring::MuscleLeaks && hose == Hose::Muscle {
        // A tenth of the valve's flow gain.
        plant.add(leak(1.3e-8));
    }
    let drive = Drive::default();
    let initial = Initial::vented(&plant);
    let simulation = Simulation::new(plant, &initial, &drive, TOLERANCE);
    (simulation, drive)
}

/// The person in front of a world: acts as each question says, and answers.
pub struct Someone {
    pub world: Arc<Mutex<World>>,
    /// What the program has told.
    pub told: String,
    /// Whether the person corrects what a step has found.
    pub repairs: bool,
    /// Other answers than the usual ones.
    pub answers: Vec<(&'static str, &'static str)>,
}

impl Person for Someone {
    fn ask(&mut self, question: &Question) -> Result<String, Error> {
        let mut world = self.world.lock().unwrap();
        if world.questions > QUESTIONS_MAX {
            return Err(BadInput::file("person", "fewer questions").into());
        }
        let answer = world.act(question.name);
        if question.name == "finding" && self.repairs {
            world.repair();
            return Ok("r".into());
        }
        let other = self.answers.iter().find(|(name, _)| *name == question.name);
        Ok(other.map_or(answer, |(_, other)| other.to_string()))
    }

    fn tell(&mut self, text: &str) {
        self.told += text;
    }
}

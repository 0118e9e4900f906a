//! Attacks over the serial link, with nothing but docs/link.md in hand: what they reach on a rig
//! with a person at the lever, with nobody there, and with a person at the button.

mod wire;

use hil_sim::faults::kind::{KINDS, Memory};
use hil_sim::faults::outcome::Outcome;
use hil_sim::faults::run::run;
use hil_sim::faults::unit::{DeviceOutput, Unit};
use hil_sim::faults::{Case, Moment};
use model_core::device::{Command, Device, Pins, SimulatedSensors};
use model_core::gate::{Decision, SettingsGate};
use model_core::io::{Request, Sensors};
use model_core::limits::{LIMITS, safety_hash};
use model_core::link::{Decoder, FRAME_LEN_MAX, FromDevice, Signature, Source, ToDevice, encode};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::Mode;
use model_core::timing::Timing;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

/// What a person does at the device.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Button {
    /// Nothing.
    Untouched,
    /// Presses it shortly when the device is ready, to begin: an ordinary user.
    Begins,
    /// Tied down.
    Stuck,
}

/// Settings as an attacker wants them: valid, and each limit as loose as its range allows.
fn loosened(random: &mut impl Rng) -> SettingsValues {
    let mut values = SettingsValues::reference();
    let all = random.random_bool(0.5);
    let mut takes = || all || random.random_bool(0.3);
    if takes() {
        values.reference_speed_m_per_s_max = 2.0;
    }
    if takes() {
        values.vent_rate_pa_per_s = 1e6;
    }
    if takes() {
        values.engage_rate_pa_per_s = 1e7;
    }
    if takes() {
        values.force_error_n_max = 800.0;
    }
    if takes() {
        (values.pressure_error_pa_max, values.pressure_lag_s) = (4.9e5, 10.0);
    }
    if takes() {
        values.play_pressure_pa_max = 5e5;
    }
    if takes() {
        (values.encoder_step_m_max, values.encoder_stuck_pa) = (1.0, 1e6);
    }
    if takes() {
        values.gain = 100.0;
    }
    if takes() {
        values.compensation.force_n_max = 200.0;
        values.compensation.payload_kg = 10.0;
    }
    values
}

/// What the settings allow that are not in the safety block.
fn detuned(random: &mut impl Rng) -> SettingsValues {
    let mut values = SettingsValues::reference();
    let most = |name: &str| LIMITS.iter().find(|limit| limit.name == name).unwrap().max;
    values.compensation.payload_kg = most("compensation.payload_kg");
    values.compensation.friction_n = most("compensation.friction_n");
    values.compensation.hysteresis_area_m2 = most("compensation.hysteresis_area_m2");
    values.compensation.dead_zone_filling_pa = most("compensation.dead_zone_filling_pa");
    values.compensation.lead_s = random.random_range(0.0..0.2);
    values
}

fn message(random: &mut impl Rng, sequence: u32) -> ToDevice {
    let request = |request| ToDevice::Command(Command::Request(request));
    match random.random_range(0..14) {
        0..3 => ToDevice::WriteSettings(loosened(random)),
        3 => ToDevice::WriteSettings(detuned(random)),
        // The board is to tell that a person has confirmed.
        4 => ToDevice::Sign(Signature {
            utc_s: random.next_u32(),
            author: [b'a'; 16],
            is_confirmed: true,
        }),
        5 => request(Request::Assist),
        6 => request(Request::Play(500_000)),
        7 => request(Request::Reset),
        8 => request(Request::Hold),
        9 => request(Request::Vent),
        10 => ToDevice::Command(Command::EnterHil),
        11 => ToDevice::Command(Command::LeaveHil),
        12 => ToDevice::Command(Command::Sensors(SimulatedSensors {
            sequence,
            sensors: Sensors {
                bridge: AdcCount(random.random_range(1000..3000)),
                pressure: AdcCount(410),
                encoder: EncoderCount(random.random_range(0..5)),
                request: Request::Assist,
                ..Sensors::default()
            },
        })),
        _ => ToDevice::ReadChange(random.random_range(0..9)),
    }
}

/// What an attacker has seen of the board.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Assistance or a test signal has begun, or the valve has had a voltage.
    moves: bool,
    /// Messages that the board has understood, by their number.
    messages: [usize; 6],
}

fn postcard_number(message: &ToDevice) -> usize {
    match message {
        ToDevice::Identify => 0,
        ToDevice::ReadSettings => 1,
        ToDevice::WriteSettings(_) => 2,
        ToDevice::Command(_) => 3,
        ToDevice::Sign(_) => 4,
        ToDevice::ReadChange(_) => 5,
    }
}

/// The board's program, and an attacker at its link.
struct Attacked {
    device: Device,
    in_force: SettingsValues,
    /// None: settings are stored as they come, unless armed, as before there was a safety block.
    gate: Option<SettingsGate>,
    signature: Signature,
    button: Button,
    random: Pcg64Mcg,
    /// Probability of a message in a tick.
    rate: f64,
    /// Sends bytes instead of messages.
    bytes: Option<(wire::Attacker, Decoder)>,
    /// The message that is repeated for a while, as a plain attack needs it.
    repeated: Option<ToDevice>,
    ticks: u32,
    pressed_ticks: u32,
    mode: Mode,
    /// Modes that were reached, and messages that were understood, by their number.
    seen: Seen,
    /// Signatures that say that a person has confirmed.
    confirmed: usize,
}

impl Attacked {
    fn new(settings: Settings, seed: u64, is_gated: bool, button: Button) -> Attacked {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        Attacked {
            device: Device::new(settings),
            in_force: *settings.values(),
            gate: is_gated.then(SettingsGate::default),
            signature: Signature::default(),
            button,
            rate: [0.02, 0.1, 1.0][random.random_range(0..3)],
            random,
            bytes: None,
            repeated: None,
            ticks: 0,
            pressed_ticks: 0,
            mode: Mode::SelfCheck,
            seen: Seen::default(),
            confirmed: 0,
        }
    }

    fn presses(&mut self) -> bool {
        match self.button {
            Button::Untouched => false,
            Button::Stuck => true,
            Button::Begins => {
                let begins = self.mode == Mode::Ready && self.random.random_bool(0.02);
                if self.pressed_ticks > 0 {
                    self.pressed_ticks -= 1;
                } else if begins {
                    self.pressed_ticks = self.random.random_range(5..60);
                }
                self.pressed_ticks > 0
            }
        }
    }

    fn carry_out(&mut self, decision: Decision) {
        match decision {
            Decision::Answer(_) => {}
            Decision::Ask(number) => self.device.propose(Some(number)),
            Decision::Withdraw => self.device.propose(None),
            Decision::Store(settings, signature) => {
                if !self.device.is_armed() {
                    self.confirmed += usize::from(signature.is_confirmed);
                    self.in_force = *settings.values();
                    self.device = Device::new(settings);
                    self.gate = self.gate.map(|_| SettingsGate::default());
                }
            }
        }
    }

    /// The commands in the bytes that arrive in a tick.
    fn receive_bytes(&mut self, random_rate: bool) -> Vec<Command> {
        let Some((mut attacker, mut decoder)) = self.bytes.take() else {
            return Vec::new();
        };
        let mut commands = Vec::new();
        if random_rate {
            for byte in attacker.bytes(&mut self.random) {
                if let Some(Ok(message)) = decoder.push::<ToDevice>(byte) {
                    // The first byte of the body is the message's number.
                    let number = postcard_number(&message);
                    self.seen.messages[number] += 1;
                    commands.extend(self.receive(message));
                }
            }
        }
        self.bytes = Some((attacker, decoder));
        commands
    }

    fn receive(&mut self, message: ToDevice) -> Option<Command> {
        match message {
            ToDevice::Command(command) => return Some(command),
            ToDevice::WriteSettings(values) => {
                let armed = self.device.is_armed();
                let decision = match (&mut self.gate, Settings::new(values)) {
                    (Some(gate), _) => gate.offer(&self.in_force, values, self.signature, armed),
                    (None, Ok(settings)) => Decision::Store(settings, self.signature),
                    (None, Err(_)) => return None,
                };
                self.carry_out(decision);
            }
            ToDevice::Sign(signature) => self.signature = signature,
            _ => {}
        }
        None
    }
}

impl Unit for Attacked {
    fn tick(&mut self, pins: &Pins, missed_ticks: u8, _: f64, _: &[u8]) -> DeviceOutput {
        self.ticks += 1;
        let mut commands = Vec::new();
        let sends = self.random.random_bool(self.rate);
        commands.extend(self.receive_bytes(sends));
        if sends && self.bytes.is_none() {
            let message = message(&mut self.random, self.ticks);
            if self.random.random_bool(0.2) {
                self.repeated = self.random.random_bool(0.7).then_some(message);
            }
            commands.extend(self.receive(message));
        }
        if let Some(message) = self.repeated {
            commands.extend(self.receive(message));
        }
        let pins = Pins {
            button_pressed: self.presses(),
            ..*pins
        };
        let timing = Timing {
            missed_ticks,
            ..Timing::default()
        };
        let tick = self.device.tick(&pins, timing, commands.into_iter());
        self.mode = tick.telemetry.output.mode;
        let from_pins = tick.telemetry.source == Source::Pins;
        self.seen.moves |= from_pins && matches!(self.mode, Mode::Assisting | Mode::Playing);
        self.seen.moves |= tick.valve.get() > 0;
        let gate = self.gate.as_mut();
        if let Some(decision) = tick.verdict.and_then(|verdict| gate?.decide(verdict)) {
            self.carry_out(decision);
        }
        DeviceOutput {
            valve: tick.valve,
            output: tick.telemetry.output,
            port_pulse: tick.port_pulse,
        }
    }

    fn skip(&mut self) {}

    fn restart(&mut self) {}

    fn damage(&mut self, _: Memory, _: usize, _: usize) {}
}

/// What an attack has reached.
#[derive(Clone, Copy, Debug, Default)]
struct Reached {
    up_m_per_s: f64,
    down_m_per_s: f64,
    height_m: f64,
    pressure_pa: f64,
    /// The safety block is another one.
    disarmed: bool,
    forged: bool,
    beyond: bool,
}

/// A healthy rig, with a person who lifts, or with nobody at the lever.
fn attacked_case(seed: u64) -> Case {
    let mut case = Case::of(&KINDS[0], 7, seed);
    // From the start on.
    case.moment = match seed % 2 {
        0 => Moment::Start,
        _ => Moment::Playing,
    };
    case.fault_s = 0.0;
    case.ends_s += 10.0;
    case
}

fn attack(seed: u64, is_gated: bool, button: Button) -> Reached {
    let case = attacked_case(seed);
    let settings = Settings::new(SettingsValues::reference()).unwrap();
    let mut unit = Attacked::new(settings, seed, is_gated, button);
    let outcome = run(&case, &settings, &mut unit, |_| {}).unwrap();
    reached(&unit, &settings, &outcome)
}

fn reached(unit: &Attacked, settings: &Settings, outcome: &Outcome) -> Reached {
    let bounds = outcome.bounds;
    Reached {
        up_m_per_s: outcome.speed_up_m_per_s_max,
        down_m_per_s: outcome.speed_down_m_per_s_max,
        height_m: outcome.height_m_max,
        pressure_pa: outcome.pressure_pa_max,
        disarmed: safety_hash(&unit.in_force) != safety_hash(settings.values()),
        forged: unit.confirmed > 0,
        beyond: outcome.speed_up_m_per_s_max > bounds.speed_up_m_per_s
            || outcome.speed_down_m_per_s_max > bounds.speed_down_m_per_s
            || outcome.height_m_max > bounds.height_m
            || outcome.pressure_pa_max > bounds.pressure_pa,
    }
}

fn attacks(count: u64, is_gated: bool, button: Button) -> Vec<Reached> {
    let seeds = (0..count).into_par_iter();
    let reached: Vec<_> = seeds.map(|seed| attack(seed, is_gated, button)).collect();
    let most = |value: fn(&Reached) -> f64| reached.iter().map(value).fold(0.0, f64::max);
    println!(
        "gate {is_gated}, {button:?}: {count} attacks, {} disarmed, {} beyond a bound; at most \
         {:.2} m/s up, {:.2} m/s down, {:.0} mm, {:.0} kPa",
        reached.iter().filter(|one| one.disarmed).count(),
        reached.iter().filter(|one| one.beyond).count(),
        most(|one| one.up_m_per_s),
        most(|one| one.down_m_per_s),
        most(|one| 1e3 * one.height_m),
        most(|one| 1e-3 * one.pressure_pa),
    );
    reached
}

#[test]
fn no_attack_over_the_link_changes_the_safety_block_or_moves_beyond_the_bounds() {
    for button in [Button::Untouched, Button::Begins, Button::Stuck] {
        for (seed, reached) in attacks(200, true, button).iter().enumerate() {
            let held = !reached.disarmed && !reached.forged && !reached.beyond;
            assert!(held, "{button:?}, seed {seed}: {reached:?}");
        }
    }
}

/// So the attacks are worth something.
#[test]
fn the_same_attacks_disarm_a_board_without_the_gate() {
    let reached = attacks(200, false, Button::Begins);
    assert!(reached.iter().filter(|one| one.disarmed).count() > 50);
    assert!(reached.iter().any(|one| one.beyond));
}

/// With bytes that follow docs/link.md and bytes that do not: on a rig with an enabling device that
/// nobody holds nothing moves; on one without nothing moves beyond its bounds. In neither the
/// safety block changes, unless the gate is missing.
fn attack_with_bytes(seed: u64, is_gated: bool, enabling: bool, button: Button) -> (Reached, Seen) {
    let case = attacked_case(seed);
    let values = SettingsValues {
        enabling_device: enabling.into(),
        // The most dangerous experiment is allowed.
        play_pressure_pa_max: 5e5,
        ..SettingsValues::reference()
    };
    let settings = Settings::new(values).unwrap();
    let mut unit = Attacked::new(settings, seed, is_gated, button);
    let mut buffer = [0; FRAME_LEN_MAX];
    let heard = encode(&FromDevice::Settings(values), &mut buffer).unwrap();
    unit.bytes = Some((wire::Attacker::new(heard), Decoder::new()));
    unit.rate = 1.0;
    let outcome = run(&case, &settings, &mut unit, |_| {}).unwrap();
    (reached(&unit, &settings, &outcome), unit.seen)
}

/// Number of attacks with bytes, each way: `ATTACKS`; a few by default.
fn byte_attacks() -> u64 {
    let asked = std::env::var("ATTACKS").ok();
    asked.map_or(60, |asked| asked.parse().expect("ATTACKS: a number"))
}

#[test]
fn no_bytes_on_the_link_move_what_nobody_enables_or_change_the_safety_block() {
    let mut understood = [0; 6];
    for (enabling, button) in [
        (true, Button::Untouched),
        (true, Button::Begins),
        (true, Button::Stuck),
        (false, Button::Untouched),
        (false, Button::Begins),
        (false, Button::Stuck),
    ] {
        let seeds = (0..byte_attacks()).into_par_iter();
        let attacks: Vec<_> = seeds
            .map(|seed| attack_with_bytes(seed, true, enabling, button))
            .collect();
        for (seed, (reached, seen)) in attacks.iter().enumerate() {
            let held = !reached.disarmed && !reached.forged && !reached.beyond;
            assert!(held, "{enabling} {button:?}, seed {seed}: {reached:?}");
            assert!(!(enabling && seen.moves), "{button:?}, seed {seed} moves");
        }
        let moved = attacks.iter().filter(|(_, seen)| seen.moves).count();
        for (_, seen) in &attacks {
            let counts = understood.iter_mut().zip(seen.messages);
            counts.for_each(|(count, more)| *count += more);
        }
        let count = attacks.len();
        println!("enabling {enabling}, {button:?}: {count} attacks with bytes, {moved} move");
        // So the attacks are worth something.
        assert!(enabling || 2 * moved > count, "{moved}");
    }
    println!("messages that were understood, by number: {understood:?}");
    assert!(understood.iter().all(|count| *count > 1_000));
}

#[test]
fn the_same_bytes_disarm_a_board_without_the_gate() {
    let seeds = (0..40).into_par_iter();
    let disarmed = seeds.filter(|seed| {
        let (reached, _) = attack_with_bytes(*seed, false, false, Button::Untouched);
        reached.disarmed
    });
    let disarmed = disarmed.count();
    println!("without the gate: {disarmed} of 40 disarmed");
    assert!(disarmed > 10, "{disarmed}");
}

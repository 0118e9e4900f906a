//! One tick of the power assist: the page to read first.
//!
//! Sensors come in as counts, the valve's command goes out as counts, and everything between is
//! here: analyse what was read, decide the mode, then act. Settings are read-only, the state is
//! small and visible, and nothing else enters: the same settings, state and sensors give the same
//! output, on the board and on the PC.
//!
//! Signs: forces lift, contraction shortens the muscle, pressure is gauge.

use crate::assist::reference_force_n;
use crate::compensation::{Memory, limited};
use crate::consistency::{ForceBalance, PressureFollower};
use crate::io::{Output, Request, Sensors};
use crate::plausibility::{Bounds, Tally, Verdict, Watch};
use crate::pressure::GaugePa;
use crate::reference::reference_pressure;
use crate::safety::{SafetyFunction, Switches};
use crate::settings::{STOP_CONTRACTION, Settings, SettingsValues, TICK_S};
use crate::signal::{ADC_VALID, AdcCount, EncoderCount};
use crate::supervisor::{Decision, Fault, Findings, Mode, decide};
use crate::voted::Voted;
use serde::{Deserialize, Serialize};

/// A gauge pressure below this is none: muscle and valve draw no vacuum.
const PRESSURE_PA_MIN: f32 = -2e4;
/// Counts that an encoder at rest may flicker by.
const FLICKER_COUNTS: u32 = 2;
/// Ticks after which a vented valve has emptied a muscle whose pressure sensor has failed.
const EMPTIED_TICKS: u16 = 500;

/// What a controller remembers from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The mode, and for how many ticks (it saturates).
    pub mode: Mode,
    /// Ticks in this mode.
    pub mode_ticks: u16,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Ticks for which the valve has been vented.
    pub empty_ticks: u16,
    /// P_r \[Pa\] as commanded by the last tick.
    pub pressure_ref_pa: f32,
    /// The reference has met the assist law: from then on it may move fast.
    pub engaged: bool,
    /// Holding only until a suspect reading is good again.
    pub bridging: bool,
    /// The bridge's reading without a finger \[N\].
    pub tare_n: f32,
    /// The encoder's count at the stop, ε = 0.
    pub home: EncoderCount,
    /// Undisturbed ticks of the self-check, and the sum of the bridge's readings \[N\] over them.
    pub window_ticks: u16,
    /// See `window_ticks`.
    pub window_sum_n: f32,
    /// The encoder's count, and the pressure \[Pa\], when it last moved by more than flicker.
    pub moved_to: EncoderCount,
    /// See `moved_to`.
    pub moved_at_pa: f32,
    /// P_r \[Pa\] that an experiment asked for last, and ticks since then (they saturate).
    pub played_pa: f32,
    /// See `played_pa`.
    pub silent_ticks: u8,
    /// Ticks in which the muscle did what nobody asked for.
    pub uncommanded: Tally,
    /// The strain-gauge bridge \[N\].
    pub bridge: Watch,
    /// The pressure sensor \[Pa\].
    pub pressure: Watch,
    /// The encoder \[m\] from home.
    pub encoder: Watch,
    /// Does the pressure follow?
    pub follower: PressureFollower,
    /// Do the forces fit?
    pub balance: ForceBalance,
    /// The compensation's.
    pub compensation: Memory,
}

/// The controller: settings and state, each safe from a flipped bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controller {
    settings: Voted<Settings>,
    state: Voted<State>,
    switches: Switches,
}

impl Controller {
    /// A controller that begins with its self-check.
    pub fn new(settings: Settings) -> Controller {
        Controller {
            settings: Voted::new(settings),
            state: Voted::new(State::default()),
            switches: Switches::default(),
        }
    }

    /// One tick, to be called every 10 ms: reads `sensors`, returns the valve's command.
    ///
    /// Takes a bounded time without loops over data, never panics, and whatever comes in commands
    /// a pressure between zero and the settings' limit. A tick that is missed is to be reported
    /// with the next one.
    pub fn tick(&mut self, sensors: &Sensors) -> Output {
        let voted = self.switches.on(SafetyFunction::MemoryVote);
        let intact = self.settings.is_intact() && self.state.is_intact();
        let known = self.settings.is_known() && self.state.is_known();
        let settings = *self.settings.get_as(self.switches);
        let mut state = *self.state.get_as(self.switches);
        if voted && !known {
            // More than one copy is damaged: nothing is known but how to switch off.
            state = State {
                mode: Mode::Venting,
                ..State::default()
            };
        }
        let (damaged, switches) = (voted && !intact, self.switches);
        let output = tick(&settings, &mut state, sensors, damaged, switches);
        self.settings.set(settings);
        self.state.set(state);
        output
    }

    /// Begins with the self-check again.
    pub fn restart(&mut self) {
        self.settings.set(*self.settings.get());
        self.state.set(State::default());
    }

    /// What it remembers.
    pub fn state(&self) -> &State {
        self.state.get()
    }

    /// Its settings.
    pub fn settings(&self) -> &Settings {
        self.settings.get()
    }
}

#[cfg(feature = "fault-injection")]
#[allow(clippy::indexing_slicing)]
impl Controller {
    /// A controller that lacks a safety function, to show that it is needed.
    pub fn without(settings: Settings, function: SafetyFunction) -> Controller {
        Controller {
            switches: Switches::without(function),
            ..Controller::new(settings)
        }
    }

    /// One of the three copies of the state, to damage it.
    pub fn state_copy(&mut self, copy: usize) -> &mut State {
        &mut self.state.copies()[copy]
    }

    /// One of the three copies of the settings, to damage it.
    pub fn settings_copy(&mut self, copy: usize) -> &mut Settings {
        &mut self.settings.copies()[copy]
    }
}

/// See [`Controller::tick`].
fn tick(
    settings: &Settings,
    state: &mut State,
    sensors: &Sensors,
    memory_damaged: bool,
    switches: Switches,
) -> Output {
    let values = settings.values();

    // Analyse: what the sensors say, and whether to believe them.
    let (mut next, verdicts) = sense(values, state, sensors, switches);
    listen(&mut next, &verdicts, sensors.request);
    let unready = match state.mode {
        Mode::SelfCheck => watch_window(values, &mut next, &verdicts, sensors),
        _ => watch_rest(values, &mut next),
    };
    watch_consistency(values, &mut next, sensors);
    let findings = Findings {
        memory_damaged,
        switches,
        ..findings(values, &next, &verdicts, unready, sensors)
    };
    let contraction = findings.contraction;

    // Decide: the analysis is complete, nothing above this line has had an effect.
    *state = next;
    match decide(values, state.mode, &findings) {
        Decision::Stay => state.mode_ticks = state.mode_ticks.saturating_add(1),
        Decision::Go(mode) => enter(values, state, mode),
        Decision::Bridge => {
            enter(values, state, Mode::Holding);
            state.bridging = true;
        }
        Decision::Fail(fault) => {
            state.fault = Some(fault);
            if state.mode != Mode::Venting {
                enter(values, state, Mode::Venting);
            }
        }
    }

    // Act: the one thing that leaves is the valve's command.
    let finger_force_n = limited(
        state.bridge.value() - state.tare_n,
        values.finger_force_n_max,
    );
    let compensation = &values.compensation;
    let memory = &mut state.compensation;
    memory.follow(compensation, &values.muscle, contraction);
    let reference_force_n = reference_force_n(values.gain, finger_force_n)
        + memory.load_n(compensation, &values.muscle);
    let pressure = GaugePa(state.pressure.value());
    let target = Target {
        force_n: reference_force_n + memory.hysteresis_n(compensation, pressure),
        contraction,
    };
    state.pressure_ref_pa = next_reference_pa(settings, state, &target, switches);
    state.empty_ticks = if state.pressure_ref_pa > 0.0 {
        0
    } else {
        state.empty_ticks.saturating_add(1)
    };
    let pressure_ref = GaugePa(state.pressure_ref_pa);
    Output {
        valve: values.valve_drive.count(pressure_ref),
        mode: state.mode,
        fault: state.fault,
        pressure_ref,
        finger_force_n,
        reference_force_n,
        contraction,
        pressure: GaugePa(state.pressure.value()),
    }
}

/// What is thought of the bridge, the pressure sensor and the encoder.
type Verdicts = [Verdict; 3];

/// The state with the sensors' new readings, and what is thought of them.
fn sense(
    values: &SettingsValues,
    state: &State,
    sensors: &Sensors,
    switches: Switches,
) -> (State, Verdicts) {
    let mut next = *state;
    // Missed ticks widen what is plausible, never what is done.
    let ticks = 1.0 + sensors.missed_ticks as f32;
    let bounds = |count: AdcCount, step_max: f32| Bounds {
        out_of_range: !ADC_VALID.contains(&count.0),
        at_standstill: false,
        step_max,
        stuck_ticks: values.stuck_ticks,
        suspect_ticks: values.suspect_ticks,
        ticks,
        switches,
    };
    let (count, bridge_n) = (sensors.bridge, values.bridge.value(sensors.bridge));
    let bridge_bounds = bounds(count, values.bridge_step_n_max);
    let (bridge, bridge_verdict) = state.bridge.next(count.0.into(), bridge_n, &bridge_bounds);

    let (count, pressure_pa) = (
        sensors.pressure,
        values.pressure_sensor.value(sensors.pressure),
    );
    let mut pressure_bounds = bounds(count, values.pressure_step_pa_max);
    pressure_bounds.out_of_range |= pressure_pa < PRESSURE_PA_MIN;
    let (pressure, pressure_verdict) =
        state
            .pressure
            .next(count.0.into(), pressure_pa, &pressure_bounds);

    let travel = sensors.encoder.since(state.home);
    let travel_m = travel as f32 * values.encoder_m_per_count;
    let moved = sensors.encoder.since(state.moved_to).unsigned_abs() > FLICKER_COUNTS;
    let encoder_bounds = Bounds {
        // Home is not known before the self-check has found it.
        out_of_range: state.mode != Mode::SelfCheck
            && travel_m < -STOP_CONTRACTION * values.muscle.initial_length_m,
        at_standstill: !moved && stands_still(values, state, pressure.value(), travel_m),
        step_max: values.encoder_step_m_max,
        stuck_ticks: 0,
        suspect_ticks: values.suspect_ticks,
        ticks,
        switches,
    };
    let (encoder, encoder_verdict) =
        state
            .encoder
            .next(sensors.encoder.0, travel_m, &encoder_bounds);
    if moved || state.mode == Mode::SelfCheck {
        next.moved_to = sensors.encoder;
        next.moved_at_pa = pressure.value();
    }
    next.bridge = bridge;
    next.pressure = pressure;
    next.encoder = encoder;
    (next, [bridge_verdict, pressure_verdict, encoder_verdict])
}

/// What an experiment asks for. On a suspect reading the pressure may only fall.
fn listen(next: &mut State, verdicts: &Verdicts, request: Request) {
    next.silent_ticks = next.silent_ticks.saturating_add(1);
    if let Request::Play(pressure_pa) = request {
        next.played_pa = pressure_pa as f32;
        next.silent_ticks = 0;
    }
    if verdicts.contains(&Verdict::Suspect) {
        next.played_pa = next.played_pa.min(next.pressure_ref_pa);
    }
}

/// True where the pressure has changed by more than static friction can hold since the encoder
/// moved. On its stop the weight rests until it is lifted, which the force balance tells; an
/// encoder with play does not come back to the very count.
fn stands_still(values: &SettingsValues, state: &State, pressure_pa: f32, travel_m: f32) -> bool {
    let on_stop = travel_m < STOP_CONTRACTION * values.muscle.initial_length_m;
    // A pressure that is astray says nothing about the encoder.
    if on_stop || !state.follower.is_calm() {
        return false;
    }
    let change_pa = pressure_pa - state.moved_at_pa;
    change_pa > values.encoder_stuck_pa || change_pa < -values.encoder_stuck_pa
}

/// Carries the self-check's window on, or begins it anew; returns what disturbs it.
fn watch_window(
    values: &SettingsValues,
    next: &mut State,
    verdicts: &Verdicts,
    sensors: &Sensors,
) -> Option<Fault> {
    let bridge_n = next.bridge.value();
    let moved = sensors.encoder.since(next.home).unsigned_abs() > FLICKER_COUNTS;
    let disturbed = if next.pressure.value() > values.vented_pa {
        Some(Fault::NotVented)
    } else if bridge_n > values.tare_n_max || bridge_n < -values.tare_n_max {
        Some(Fault::LoadedLever)
    } else if moved || verdicts.contains(&Verdict::Suspect) {
        Some(Fault::NotStill)
    } else {
        None
    };
    if disturbed.is_some() {
        next.window_ticks = 0;
        next.window_sum_n = 0.0;
        next.home = sensors.encoder;
        next.encoder = Watch::default();
    } else {
        next.window_ticks = next.window_ticks.saturating_add(1);
        next.window_sum_n += bridge_n;
    }
    disturbed
}

fn contraction(values: &SettingsValues, state: &State) -> f32 {
    state.encoder.value() / values.muscle.initial_length_m
}

/// Tells whether a muscle that waits to be asked has pressure, or has lifted.
fn watch_rest(values: &SettingsValues, next: &mut State) -> Option<Fault> {
    let lifted = contraction(values, next) > STOP_CONTRACTION;
    let astir = next.mode == Mode::Ready && (lifted || next.pressure.value() > values.vented_pa);
    next.uncommanded.add(astir, values.suspect_ticks);
    astir.then_some(Fault::Uncommanded)
}

/// Compares what the sensors say with each other and with what was asked for.
fn watch_consistency(values: &SettingsValues, next: &mut State, sensors: &Sensors) {
    let (pressure_pa, missed) = (next.pressure.value(), sensors.missed_ticks > 0);
    if next.mode == Mode::SelfCheck {
        (next.follower, next.balance) = Default::default();
        return;
    }
    let reference_pa = next.pressure_ref_pa;
    next.follower = next.follower.next(values, reference_pa, pressure_pa);
    let contraction = contraction(values, next);
    next.balance = next.balance.next(values, contraction, pressure_pa, missed);
}

fn findings(
    values: &SettingsValues,
    next: &State,
    verdicts: &Verdicts,
    unready: Option<Fault>,
    sensors: &Sensors,
) -> Findings {
    let [bridge, pressure, encoder] = *verdicts;
    let latched = matches!(next.fault, Some(Fault::Pressure(_)));
    let empty = if latched || matches!(pressure, Verdict::Failed(_)) {
        next.empty_ticks >= EMPTIED_TICKS
    } else {
        next.pressure.value() <= values.vented_pa
    };
    Findings {
        bridge,
        pressure,
        encoder,
        pressure_pa: next.pressure.value(),
        contraction: contraction(values, next),
        missed_ticks: sensors.missed_ticks,
        request: sensors.request,
        vented: next.pressure_ref_pa == 0.0 && empty,
        unready,
        uncommanded: next.uncommanded.is_full(values.suspect_ticks),
        mode_ticks: next.mode_ticks,
        window_ticks: next.window_ticks,
        silent_ticks: next.silent_ticks,
        bridging: next.bridging,
        latched: next.fault.is_some(),
        pressure_astray: next.follower.has_failed(values),
        force_astray: next.balance.has_failed(values),
        too_fast: next.balance.is_too_fast(),
        memory_damaged: false,
        switches: Switches::default(),
    }
}

/// Begins `mode`.
fn enter(values: &SettingsValues, state: &mut State, mode: Mode) {
    match (state.mode, mode) {
        (Mode::SelfCheck, Mode::Ready) => {
            state.tare_n = state.window_sum_n / state.window_ticks.max(1) as f32;
        }
        // From where the pressure is, gently, until the law is met.
        (Mode::Ready, Mode::Assisting) => {
            state.pressure_ref_pa = state.pressure.value();
            state.engaged = false;
        }
        // After a hold that was asked for the law may be far away; after a bridged reading not.
        (Mode::Holding, Mode::Assisting) => state.engaged = state.engaged && state.bridging,
        // Everything anew, as after power-on.
        (_, Mode::SelfCheck) => *state = State::default(),
        _ => {}
    }
    state.bridging = false;
    state.compensation.begin();
    state.mode = mode;
    state.mode_ticks = 0;
    state.pressure_ref_pa = limited_pa(values, state.pressure_ref_pa);
}

/// What the assist law is to reach.
struct Target {
    /// F_c \[N\].
    force_n: f32,
    contraction: f32,
}

/// P_r \[Pa\] for the state's mode: Eq 8 while assisting, limited in value and rate.
fn next_reference_pa(
    settings: &Settings,
    state: &mut State,
    target: &Target,
    switches: Switches,
) -> f32 {
    let values = settings.values();
    let now_pa = state.pressure_ref_pa;
    let moving_pa_per_s = if switches.on(SafetyFunction::ReferenceSpeed) {
        let contraction = target.contraction.max(0.0).min(values.contraction_max);
        values.muscle.moving_rate_pa_per_s(
            values.reference_speed_m_per_s_max,
            contraction,
            GaugePa(now_pa),
        )
    } else {
        f32::MAX
    };
    // Past the limit of travel the pressure may only fall.
    let too_short = target.contraction > values.contraction_max;
    let way_pa = |target_pa: f32| {
        if too_short && switches.on(SafetyFunction::WeightWatch) {
            target_pa.min(now_pa) - now_pa
        } else {
            target_pa - now_pa
        }
    };
    let next_pa = match state.mode {
        Mode::SelfCheck | Mode::Ready => 0.0,
        Mode::Holding => now_pa,
        Mode::Venting if !switches.on(SafetyFunction::VentRamp) => 0.0,
        Mode::Venting => {
            // What the muscle does not yet have needs no letting down, whatever one sensor says.
            let reached_pa = state.pressure.value().max(state.follower.slow_pa());
            let rate_pa_per_s = if now_pa > reached_pa {
                moving_pa_per_s
            } else {
                moving_pa_per_s.min(values.vent_rate_pa_per_s)
            };
            now_pa - rate_pa_per_s * TICK_S
        }
        Mode::Playing => {
            let asked_pa = state.played_pa.min(values.play_pressure_pa_max);
            now_pa + limited(way_pa(asked_pa), moving_pa_per_s * TICK_S)
        }
        Mode::Assisting => {
            let law = reference_pressure(
                &values.muscle,
                target.force_n,
                target.contraction,
                values.contraction_max,
                settings.pressure_max(),
            );
            let rate_pa_per_s = if state.engaged {
                moving_pa_per_s
            } else {
                moving_pa_per_s.min(values.engage_rate_pa_per_s)
            };
            let pressure = GaugePa(state.pressure.value());
            let memory = &mut state.compensation;
            let way_pa = way_pa(memory.pressure_pa(&values.compensation, law.0, pressure));
            let step_pa = limited(way_pa, rate_pa_per_s * TICK_S);
            state.engaged = state.engaged || step_pa == way_pa;
            now_pa + step_pa
        }
    };
    limited_pa(values, next_pa)
}

/// A reference within its limits; zero for NaN.
fn limited_pa(values: &SettingsValues, pressure_pa: f32) -> f32 {
    if pressure_pa.is_nan() {
        0.0
    } else {
        pressure_pa.max(0.0).min(values.pressure_pa_max)
    }
}

#[cfg(feature = "fault-injection")]
#[allow(clippy::indexing_slicing)]
impl State {
    /// Flips a bit of one of its values; `bit` is reduced to those that are there.
    pub fn flip(&mut self, bit: usize) {
        let float = |value: &mut f32, bit: usize| {
            let flipped = f32::from_bits(value.to_bits() ^ 1 << bit);
            // The sign of zero changes nothing: another bit.
            let same = flipped == *value;
            *value = f32::from_bits(flipped.to_bits() ^ u32::from(same));
        };
        let (value, bit) = (bit / 32 % 12, bit % 32);
        match value {
            0 => float(&mut self.pressure_ref_pa, bit),
            1 => float(&mut self.tare_n, bit),
            2 => self.home.0 ^= 1 << bit,
            3 => self.mode = [Mode::SelfCheck, Mode::Ready, Mode::Holding, Mode::Venting][bit % 4],
            4 => self.engaged = !self.engaged,
            5 => self.mode_ticks ^= 1 << (bit % 16),
            6 => self.fault = self.fault.xor(Some(Fault::OverPressure)),
            7 => self.moved_to.0 ^= 1 << bit,
            8 => float(&mut self.moved_at_pa, bit),
            9 => float(&mut self.played_pa, bit),
            10 => self.silent_ticks ^= 1 << (bit % 8),
            _ => self.empty_ticks ^= 1 << (bit % 16),
        }
    }
}

//! The device around the controller: which sensors it reads, and which requests it takes.
//!
//! The firmware reads pins and bytes. This module decides what follows from them.

use crate::controller::{Control, Controller};
use crate::enabling::Enabling;
use crate::gate::{Confirmation, Verdict};
use crate::io::{Output, Request, Sensors};
use crate::lamp;
use crate::limits::HIL_SILENCE_TICKS;
use crate::link::{Source, Telemetry};
use crate::settings::Settings;
use crate::signal::{AdcCount, DacCount, EncoderCount};
use crate::start::StartFault;
use crate::stop::StopContacts;
use crate::supervisor::{Fault, Mode};
use crate::timing::Timing;
use crate::voted::Voted;
use serde::{Deserialize, Serialize};

/// Ticks for which the button must read pressed: contacts bounce for some milliseconds.
const BUTTON_TICKS: u8 = 3;

/// Words of hardware in the loop, and of what the start has found, with those that say whether
/// there is any.
pub const HIL_WORDS: usize = 4;
const START_WORDS: usize = 2;

/// A command of the link for a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// A request to the controller. With hardware in the loop requests come with the sensors
    /// instead.
    Request(Request),
    /// Begin hardware in the loop: sensors from the link, the valve at its safe voltage. Does
    /// nothing while armed.
    EnterHil,
    /// End hardware in the loop.
    LeaveHil,
    /// The next tick's sensors, with hardware in the loop.
    Sensors(SimulatedSensors),
}

/// Sensor readings from the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SimulatedSensors {
    /// Counts up with each message; one that does not is dropped.
    pub sequence: u32,
    /// The readings.
    pub sensors: Sensors,
}

/// Readings of the pins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pins {
    /// Strain-gauge bridge.
    pub bridge: AdcCount,
    /// Pressure sensor.
    pub pressure: AdcCount,
    /// Encoder.
    pub encoder: EncoderCount,
    /// The valve's voltage, read back.
    pub read_back: AdcCount,
    /// The button.
    pub button_pressed: bool,
    /// The two contacts of the emergency stop, or their wires, are open.
    pub stop_open: [bool; 2],
    /// The contact of the enabling device is closed: it is held in its middle position.
    pub enabling_closed: bool,
}

/// Result of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    /// The value for the valve's DAC.
    pub valve: DacCount,
    /// Level for the valve in the muscle's port. It alternates from tick to tick while that valve
    /// is to be open: neither level keeps it open.
    pub port_pulse: bool,
    /// The status lamp is lit.
    pub lamp: bool,
    /// The muscle is or may be under pressure: settings must not change.
    pub armed: bool,
    /// What was done at the device about proposed settings, in the tick in which it was.
    pub verdict: Option<Verdict>,
    /// Telemetry for the link.
    pub telemetry: Telemetry,
}

/// A controller with its button, its link and hardware in the loop.
#[derive(Clone, Debug)]
pub struct Device<C = Controller> {
    controller: C,
    /// A flipped bit must not put the valve to its safe voltage, which drops the weight.
    hil: Voted<Option<Hil>, HIL_WORDS>,
    button: Button,
    stop: StopContacts,
    enabling: Enabling,
    confirmation: Confirmation,
    /// A flipped bit must not put the valve to 0 V.
    start: Voted<Option<StartFault>, START_WORDS>,
    /// What the self-test in the background has found.
    found: Option<StartFault>,
    /// The fault that was latched before hardware in the loop: that must not reset it, which takes
    /// a request, and the enabling device if there is one.
    latched: Option<Fault>,
    tick: u32,
    /// The last tick's output.
    output: Output,
}

impl Device {
    /// A device that begins with the controller's self-check.
    pub fn new(settings: Settings) -> Device {
        Device::with_controller(Controller::new(settings))
    }
}

impl<C: Control> Device<C> {
    /// A device with this controller.
    pub fn with_controller(controller: C) -> Device<C> {
        Device {
            controller,
            hil: Voted::new(None),
            button: Button::default(),
            stop: StopContacts::default(),
            enabling: Enabling::default(),
            confirmation: Confirmation::default(),
            start: Voted::new(None),
            found: None,
            latched: None,
            tick: 0,
            output: Output::default(),
        }
    }

    /// The device with this result of the start-up self-test. If it prevents assistance, the valve
    /// stays at 0 V until the next reset; hardware in the loop is possible.
    pub fn started(mut self, fault: Option<StartFault>) -> Device<C> {
        self.start = Voted::new(fault);
        self
    }

    /// The self-test in the background has found this: the weight is let down along the ramp, and
    /// nothing begins until the next reset.
    pub fn fail(&mut self, fault: StartFault) {
        self.found = Some(fault);
    }

    /// Asks at the device for the proposed settings of this number (see [`crate::gate`]), or asks
    /// no longer.
    pub fn propose(&mut self, number: Option<u32>) {
        self.confirmation.propose(number);
    }

    /// The controller, for the fault campaign to damage its memory.
    pub fn controller_mut(&mut self) -> &mut C {
        &mut self.controller
    }

    /// Hardware in the loop, if it is on, for the fault campaign to damage a copy.
    pub fn hil_mut(&mut self) -> &mut Voted<Option<Hil>, HIL_WORDS> {
        &mut self.hil
    }

    /// One tick. Takes from `commands` what belongs to it: with hardware in the loop, that ends
    /// with the first sensors.
    pub fn tick(
        &mut self,
        pins: &Pins,
        timing: Timing,
        commands: impl Iterator<Item = Command>,
    ) -> Tick {
        self.tick = self.tick.wrapping_add(1);
        let is_armed = self.is_armed();
        let verdict = self.confirmation.tick(pins.button_pressed, is_armed);
        let mut pressed = self.button.request(pins.button_pressed, self.output.mode);
        // A press that answers is no request; one that ends a motion is.
        if !is_armed && (self.confirmation.is_asking() || verdict.is_some()) {
            pressed = Request::None;
        }
        let stop = self.stop.request(pins.stop_open);
        let mut request = if stop == Request::None { pressed } else { stop };
        let mut hil = self.hil.recall().0.copied().flatten();
        let mut simulated = None;
        for command in commands {
            match command {
                // A later command overrides neither venting nor the emergency stop.
                Command::Request(_) if stop != Request::None || request == Request::Vent => {}
                Command::Request(asked) => request = asked,
                Command::EnterHil => self.enter_hil(&mut hil),
                Command::LeaveHil => self.leave_hil(&mut hil),
                Command::Sensors(message) => {
                    simulated = hil.as_mut().and_then(|hil| hil.accept(message));
                    if simulated.is_some() {
                        break;
                    }
                }
            }
        }
        if self.found.is_some() {
            request = Request::Vent;
        }
        let (source, sensors) = match (hil, simulated) {
            (Some(_), Some(message)) => (Source::Link(message.sequence), message.sensors),
            (Some(_), None) => (Source::Silence, Sensors::default()),
            (None, _) => {
                let request = self.enabled(pins.enabling_closed, request);
                (Source::Pins, from_pins(pins, timing, request))
            }
        };
        // Of what nothing is known no assistance begins; what is lifted may not drop.
        if self.start.recall().0.is_none() {
            self.found = Some(StartFault::Ram);
        }
        let start = self.start.recall().0.copied().flatten();
        // A copy that has flipped is outvoted only while the two others are intact.
        self.start.set(start);
        self.control(source, &sensors, start);
        let telemetry = Telemetry {
            tick: self.tick,
            source,
            sensors,
            output: self.output,
            timing,
        };
        self.count_silence(&mut hil, source);
        self.hil.set(hil);
        Tick {
            valve: if source == Source::Pins {
                self.output.valve
            } else {
                DacCount::default()
            },
            port_pulse: source == Source::Pins && self.opens_port() && self.tick % 2 == 1,
            lamp: self.is_lit(stop, start),
            armed: self.is_armed(),
            verdict,
            telemetry,
        }
    }

    /// Runs the controller, unless there are no sensors or the start prevents it.
    fn control(&mut self, source: Source, sensors: &Sensors, start: Option<StartFault>) {
        match start.filter(|fault| fault.prevents_assistance()) {
            Some(fault) if source == Source::Pins => {
                self.output = Output {
                    mode: Mode::Venting,
                    fault: Some(Fault::Start(fault)),
                    ..Output::default()
                };
            }
            _ if source == Source::Silence => {}
            _ => {
                self.output = self.controller.tick(sensors);
                self.output.fault = self.output.fault.or(self.found.map(Fault::Start));
            }
        }
    }

    /// True unless the reference pressure is zero and stays there until a request.
    pub fn is_armed(&self) -> bool {
        // As any copy has it: this is asked more often than a tick.
        let mut copies = self.controller.memory().state.plain().iter();
        copies.any(|state| {
            let moves = matches!(state.mode, Mode::Assisting | Mode::Holding | Mode::Playing);
            moves || state.pressure_ref_pa > 0.0
        })
    }

    fn is_lit(&self, stop: Request, start: Option<StartFault>) -> bool {
        if self.confirmation.is_asking() {
            return lamp::asks(self.confirmation.is_held(), self.tick);
        }
        let warns = start == Some(StartFault::BrownOut);
        lamp::is_lit(self.output.mode, self.output.fault, stop, warns, self.tick)
    }

    /// The request that the enabling device leaves, if the rig has one: as any copy has it.
    fn enabled(&mut self, is_closed: bool, request: Request) -> Request {
        let mut copies = self.controller.memory().settings.plain().iter();
        if copies.any(|values| values.enabling_device != 0) {
            self.enabling.allow(is_closed, self.output.mode, request)
        } else {
            request
        }
    }

    fn opens_port(&self) -> bool {
        self.controller.memory().state.get().port_open
    }

    fn enter_hil(&mut self, hil: &mut Option<Hil>) {
        if hil.is_none() && !self.is_armed() {
            *hil = Some(Hil::default());
            self.latched = self.controller.memory().state.get().fault;
            self.restart(None);
        }
    }

    fn leave_hil(&mut self, hil: &mut Option<Hil>) {
        if hil.take().is_some() {
            let latched = self.latched.take();
            self.restart(latched);
        }
    }

    /// Restarts the controller: its state belongs to the plant that it leaves, but for what is
    /// latched on the one that it comes to.
    fn restart(&mut self, latched: Option<Fault>) {
        self.controller.memory_mut().restart(latched);
        self.output = Output::default();
    }

    fn count_silence(&mut self, hil: &mut Option<Hil>, source: Source) {
        if let Some(on) = hil {
            on.silent_ticks = match source {
                Source::Silence => on.silent_ticks.saturating_add(1),
                _ => 0,
            };
            if on.silent_ticks >= HIL_SILENCE_TICKS {
                self.leave_hil(hil);
            }
        }
    }
}

fn from_pins(pins: &Pins, timing: Timing, request: Request) -> Sensors {
    Sensors {
        bridge: pins.bridge,
        pressure: pins.pressure,
        encoder: pins.encoder,
        read_back: pins.read_back,
        missed_ticks: timing.missed_ticks,
        request,
    }
}

/// State of hardware in the loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Hil {
    sequence: Option<u32>,
    silent_ticks: u8,
}

impl Hil {
    /// The message, unless it is an old one.
    fn accept(&mut self, message: SimulatedSensors) -> Option<SimulatedSensors> {
        let is_new = self
            .sequence
            .is_none_or(|last| message.sequence.wrapping_sub(last).wrapping_sub(1) <= u32::MAX / 2);
        if is_new {
            self.sequence = Some(message.sequence);
        }
        is_new.then_some(message)
    }
}

/// The button: its request depends on the mode.
#[derive(Clone, Copy, Debug)]
struct Button {
    pressed_ticks: u8,
}

impl Default for Button {
    /// Pressed for long, so that a button that is stuck does nothing.
    fn default() -> Button {
        Button {
            pressed_ticks: u8::MAX,
        }
    }
}

impl Button {
    fn request(&mut self, pressed: bool, mode: Mode) -> Request {
        self.pressed_ticks = if pressed {
            self.pressed_ticks.saturating_add(1)
        } else {
            0
        };
        if self.pressed_ticks != BUTTON_TICKS {
            return Request::None;
        }
        match mode {
            Mode::SelfCheck => Request::None,
            Mode::Ready => Request::Assist,
            Mode::Assisting | Mode::Holding | Mode::Playing => Request::Vent,
            Mode::Venting => Request::Reset,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::SettingsValues;
    use crate::state::State;
    use crate::supervisor::Fault;
    use crate::voted::PLAIN;
    use crate::voted::tests::words;

    fn settings() -> Settings {
        Settings::new(SettingsValues {
            stuck_ticks: 0,
            ..SettingsValues::reference()
        })
        .unwrap()
    }

    /// No finger, no pressure, the muscle on its stop.
    fn resting() -> Pins {
        Pins {
            bridge: AdcCount(2048),
            pressure: AdcCount(410),
            encoder: EncoderCount(7),
            read_back: AdcCount(0),
            button_pressed: false,
            stop_open: [false; 2],
            enabling_closed: false,
        }
    }

    /// A tick with the valve's voltage as it was set.
    fn tick(device: &mut Device, pins: &Pins, commands: &[Command]) -> Tick {
        let read_back = AdcCount(device.output.valve.get());
        let pins = Pins { read_back, ..*pins };
        device.tick(&pins, Timing::default(), commands.iter().copied())
    }

    /// A device that has passed its self-check.
    fn ready() -> Device {
        let mut device = Device::new(settings());
        for _ in 0..60 {
            tick(&mut device, &resting(), &[]);
        }
        assert_eq!(device.controller.state().mode, Mode::Ready);
        device
    }

    fn simulated(sequence: u32, request: Request) -> Command {
        simulated_after(sequence, request, DacCount::default())
    }

    /// The same after a tick with this output.
    fn simulated_after(sequence: u32, request: Request, valve: DacCount) -> Command {
        Command::Sensors(SimulatedSensors {
            sequence,
            sensors: Sensors {
                read_back: AdcCount(valve.get()),
                // A finger pulls with 10 N.
                bridge: AdcCount(if sequence < 60 { 2048 } else { 2867 }),
                request,
                ..from_pins(&resting(), Timing::default(), request)
            },
        })
    }

    fn mode(tick: &Tick) -> Mode {
        tick.telemetry.output.mode
    }

    #[test]
    fn venting_is_not_overridden_within_a_tick() {
        let mut device = ready();
        let both = [Request::Vent, Request::Assist].map(Command::Request);
        assert_eq!(mode(&tick(&mut device, &resting(), &both)), Mode::Venting);
    }

    #[test]
    fn each_press_of_the_button_causes_one_request() {
        let mut device = ready();
        let pressed = Pins {
            button_pressed: true,
            ..resting()
        };
        let mut press = |expected| {
            for n in 0..40 {
                let seen = mode(&tick(&mut device, &pressed, &[]));
                assert_eq!(seen == expected, n + 1 >= BUTTON_TICKS, "{seen:?} at {n}");
            }
            tick(&mut device, &resting(), &[]);
        };
        press(Mode::Assisting);
        press(Mode::Venting);
        press(Mode::SelfCheck);
    }

    #[test]
    fn contacts_that_bounce_do_not_press_the_button() {
        let mut device = ready();
        for n in 0..100 {
            let bounces = Pins {
                button_pressed: n % 3 != 0,
                ..resting()
            };
            assert_eq!(mode(&tick(&mut device, &bounces, &[])), Mode::Ready);
        }
    }

    #[test]
    fn an_experiment_is_armed_and_the_button_ends_it() {
        let values = SettingsValues {
            stuck_ticks: 0,
            play_pressure_pa_max: 1e5,
            ..SettingsValues::reference()
        };
        let mut device = Device::new(Settings::new(values).unwrap());
        let play = [Command::Request(Request::Play(0))];
        let mut seen = tick(&mut device, &resting(), &play);
        for _ in 0..60 {
            seen = tick(&mut device, &resting(), &play);
        }
        assert_eq!((mode(&seen), seen.armed), (Mode::Playing, true));
        let pressed = Pins {
            button_pressed: true,
            ..resting()
        };
        for _ in 0..BUTTON_TICKS {
            seen = tick(&mut device, &pressed, &[]);
        }
        assert_eq!(mode(&seen), Mode::Venting);
    }

    /// Along the ramp, as the weight may be up; a reason that was latched before stays.
    #[test]
    fn what_is_found_in_the_background_lets_the_weight_down_until_a_reset() {
        let mut device = ready();
        let assist = [Command::Request(Request::Assist)];
        let mut seen = tick(&mut device, &resting(), &assist);
        for _ in 0..50 {
            seen = tick(&mut device, &resting(), &[]);
        }
        let before_pa = seen.telemetry.output.pressure_ref.0;
        assert!(before_pa > 5e4, "{before_pa}");
        device.fail(StartFault::Ram);
        let seen = tick(&mut device, &resting(), &assist).telemetry.output;
        let expected = (Mode::Venting, Some(Fault::Start(StartFault::Ram)));
        assert_eq!((seen.mode, seen.fault), expected);
        let step_pa = before_pa - seen.pressure_ref.0;
        assert!((1.0..5e3).contains(&step_pa), "{step_pa}");
        // Neither a request nor the button resets it.
        let pressed = Pins {
            button_pressed: true,
            ..resting()
        };
        for n in 0..400 {
            let pins = if n % 20 < 10 { pressed } else { resting() };
            let request = [Request::Reset, Request::Assist][n % 2];
            let seen = tick(&mut device, &pins, &[Command::Request(request)]);
            let output = seen.telemetry.output;
            assert_eq!((output.mode, output.fault), expected);
        }
        assert!(!device.is_armed());
    }

    #[test]
    fn emergency_stop_lets_the_weight_down_and_nothing_overrules_it() {
        let mut device = ready();
        let assist = [Command::Request(Request::Assist)];
        tick(&mut device, &resting(), &assist);
        let stopped = Pins {
            stop_open: [true; 2],
            ..resting()
        };
        assert_eq!(mode(&tick(&mut device, &stopped, &[])), Mode::Assisting);
        let seen = tick(&mut device, &stopped, &assist);
        let output = seen.telemetry.output;
        assert_eq!(
            (output.mode, output.fault),
            (Mode::Venting, Some(Fault::EmergencyStop))
        );
        // Neither a request nor the button resets it.
        let reset = [Command::Request(Request::Reset)];
        for _ in 0..200 {
            let pressed = Pins {
                button_pressed: true,
                ..stopped
            };
            assert_eq!(mode(&tick(&mut device, &pressed, &reset)), Mode::Venting);
        }
        for _ in 0..60 {
            tick(&mut device, &resting(), &reset);
        }
        assert_eq!(device.controller.state().mode, Mode::Ready);
    }

    #[test]
    fn nothing_begins_while_the_emergency_stop_is_open() {
        let stopped = Pins {
            stop_open: [true; 2],
            ..resting()
        };
        let mut device = ready();
        tick(&mut device, &stopped, &[]);
        for _ in 0..200 {
            tick(&mut device, &stopped, &[Command::Request(Request::Assist)]);
        }
        let state = device.controller.state();
        assert_eq!((state.mode, state.fault), (Mode::Ready, None));
    }

    #[test]
    fn broken_wire_of_the_emergency_stop_is_told() {
        for broken in 0..2 {
            let mut device = ready();
            let mut pins = resting();
            pins.stop_open[broken] = true;
            for _ in 0..60 {
                tick(&mut device, &pins, &[]);
            }
            let fault = device.controller.state().fault;
            assert_eq!(fault, Some(Fault::StopContactsDiffer));
        }
    }

    #[test]
    fn held_button_answers_the_question_and_requests_nothing() {
        let mut device = ready();
        device.propose(Some(3));
        let pressed = Pins {
            button_pressed: true,
            ..resting()
        };
        assert_eq!(tick(&mut device, &resting(), &[]).verdict, None);
        let verdicts = (0..300).filter_map(|_| {
            let seen = tick(&mut device, &pressed, &[]);
            assert_eq!(mode(&seen), Mode::Ready);
            seen.verdict
        });
        let confirmed = Verdict {
            number: 3,
            is_confirmed: true,
        };
        assert_eq!(verdicts.collect::<Vec<_>>(), [confirmed]);
    }

    #[test]
    fn question_does_not_keep_the_button_from_ending_a_motion() {
        let mut device = ready();
        tick(
            &mut device,
            &resting(),
            &[Command::Request(Request::Assist)],
        );
        device.propose(Some(3));
        let pressed = Pins {
            button_pressed: true,
            ..resting()
        };
        for _ in 0..BUTTON_TICKS {
            tick(&mut device, &pressed, &[]);
        }
        assert_eq!(device.controller.state().mode, Mode::Venting);
    }

    #[test]
    fn rig_with_an_enabling_device_needs_it() {
        let values = SettingsValues {
            stuck_ticks: 0,
            enabling_device: 1,
            ..SettingsValues::reference()
        };
        let held = Pins {
            enabling_closed: true,
            ..resting()
        };
        let mut device = Device::new(Settings::new(values).unwrap());
        let mut run = |pins: &Pins, request| {
            let commands = [Command::Request(request)];
            (0..60).fold(Mode::Venting, |_, _| {
                mode(&tick(&mut device, pins, &commands))
            })
        };
        assert_eq!(run(&resting(), Request::None), Mode::Ready);
        assert_eq!(run(&resting(), Request::Assist), Mode::Ready);
        assert_eq!(run(&held, Request::Assist), Mode::Assisting);
        assert_eq!(run(&resting(), Request::Assist), Mode::Venting);
        assert_eq!(run(&resting(), Request::Reset), Mode::Venting);
        // The reset begins the self-check, after which the switch has to be let go once.
        assert_eq!(run(&held, Request::Reset), Mode::Ready);
        assert_eq!(run(&held, Request::Assist), Mode::Ready);
    }

    /// Whether the level for the valve in the muscle's port changes from tick to tick: an edge in
    /// each, or none.
    fn pulses(device: &mut Device, pins: &Pins) -> bool {
        let levels: Vec<bool> = (0..20)
            .map(|_| tick(device, pins, &[]).port_pulse)
            .collect();
        let edges = levels.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(edges == 0 || edges == 19, "{levels:?}");
        assert!(edges > 0 || !levels[0], "not pulsed is low");
        edges > 0
    }

    #[test]
    fn port_is_open_from_a_passed_self_check_until_the_muscle_is_empty() {
        let mut device = Device::new(settings());
        assert!(!pulses(&mut device, &resting()), "self-check");
        for _ in 0..40 {
            tick(&mut device, &resting(), &[]);
        }
        assert!(pulses(&mut device, &resting()), "ready");
        tick(
            &mut device,
            &resting(),
            &[Command::Request(Request::Assist)],
        );
        assert!(pulses(&mut device, &resting()), "assisting");
        tick(&mut device, &resting(), &[Command::Request(Request::Vent)]);
        assert!(pulses(&mut device, &resting()), "venting");
        for _ in 0..600 {
            tick(&mut device, &resting(), &[]);
        }
        assert!(!pulses(&mut device, &resting()), "empty");
        tick(&mut device, &resting(), &[Command::EnterHil]);
        assert!(!pulses(&mut device, &resting()), "hardware in the loop");
    }

    /// The valve at the muscle may be at its exhaust after a reset: opening the port drops the
    /// weight.
    #[test]
    fn port_stays_closed_after_a_reset_with_air_in_the_muscle() {
        let mut device = Device::new(settings());
        let lifted = Pins {
            pressure: AdcCount(2000),
            ..resting()
        };
        for _ in 0..100 {
            assert!(!pulses(&mut device, &lifted));
        }
        let fault = device.controller.state().fault;
        assert_eq!(fault, Some(Fault::NotVented));
    }

    #[test]
    fn port_closes_at_once_on_a_pressure_that_does_not_obey() {
        let mut device = ready();
        assert!(pulses(&mut device, &resting()));
        let ajar = Pins {
            pressure: AdcCount(700),
            ..resting()
        };
        for _ in 0..10 {
            tick(&mut device, &ajar, &[]);
        }
        let fault = device.controller.state().fault;
        assert_eq!(fault, Some(Fault::Uncommanded));
        assert!(!pulses(&mut device, &ajar));
    }

    /// The weight stays where it is: what a converter that does not obey would do is unknown.
    #[test]
    fn port_closes_at_once_on_a_wrong_voltage_of_the_valve() {
        let mut device = ready();
        tick(
            &mut device,
            &resting(),
            &[Command::Request(Request::Assist)],
        );
        assert!(pulses(&mut device, &resting()));
        let wrong = Pins {
            read_back: AdcCount(device.output.valve.get() + 200),
            ..resting()
        };
        for expected in [None, None, Some(Fault::ValveVoltage)] {
            let seen = device.tick(&wrong, Timing::default(), core::iter::empty());
            assert_eq!(seen.telemetry.output.fault, expected);
        }
        assert!(!pulses(&mut device, &resting()));
    }

    #[test]
    fn stuck_button_does_nothing() {
        let mut device = Device::new(settings());
        let pressed = Pins {
            button_pressed: true,
            ..resting()
        };
        for _ in 0..1000 {
            tick(&mut device, &pressed, &[]);
        }
        assert_eq!(device.controller.state().mode, Mode::Ready);
    }

    #[test]
    fn hardware_in_the_loop_assists_with_the_valve_safe() {
        let mut device = ready();
        tick(&mut device, &resting(), &[Command::EnterHil]);
        let mut asked_for = 0;
        // Not for long: the pressure stays where it is, which is a fault then.
        for sequence in 0..105 {
            let request = if sequence == 55 {
                Request::Assist
            } else {
                Request::None
            };
            let message = simulated_after(sequence, request, device.output.valve);
            let seen = tick(&mut device, &resting(), &[message]);
            assert_eq!(seen.telemetry.source, Source::Link(sequence));
            assert_eq!(seen.valve.get(), 0);
            asked_for = asked_for.max(seen.telemetry.output.valve.get());
        }
        assert!(device.is_armed());
        assert!(asked_for > 800, "{asked_for}");
    }

    #[test]
    fn hardware_in_the_loop_is_the_bare_controller_whatever_the_link_repeats() {
        let mut device = ready();
        tick(&mut device, &resting(), &[Command::EnterHil]);
        let mut bare = Controller::new(settings());
        for sequence in 1..300_u32 {
            let request = if sequence == 55 {
                Request::Assist
            } else {
                Request::None
            };
            let message = simulated_after(sequence, request, bare.state().valve);
            let old = simulated(sequence.saturating_sub(3), Request::Vent);
            let queue = [old, Command::Request(Request::Vent), message, message];
            let seen = if sequence == 1 {
                tick(&mut device, &resting(), &[message])
            } else {
                tick(&mut device, &resting(), &queue)
            };
            let Command::Sensors(message) = message else {
                unreachable!()
            };
            assert_eq!(seen.telemetry.output, bare.tick(&message.sensors));
        }
    }

    #[test]
    fn one_message_a_tick_the_rest_waits() {
        let mut device = ready();
        let mut queue = [
            Command::EnterHil,
            simulated(5, Request::None),
            simulated(6, Request::None),
        ]
        .into_iter();
        let sources: Vec<Source> = (0..3)
            .map(|_| {
                device
                    .tick(&resting(), Timing::default(), &mut queue)
                    .telemetry
                    .source
            })
            .collect();
        assert_eq!(sources, [Source::Link(5), Source::Link(6), Source::Silence]);
    }

    #[test]
    fn hardware_in_the_loop_is_refused_while_armed() {
        let mut device = ready();
        let seen = tick(
            &mut device,
            &resting(),
            &[Command::Request(Request::Assist)],
        );
        assert!(seen.armed);
        let seen = tick(&mut device, &resting(), &[Command::EnterHil]);
        assert_eq!(
            (seen.telemetry.source, mode(&seen)),
            (Source::Pins, Mode::Assisting)
        );
    }

    #[test]
    fn silence_ends_hardware_in_the_loop_with_a_self_check() {
        let mut device = ready();
        tick(&mut device, &resting(), &[Command::EnterHil]);
        tick(&mut device, &resting(), &[simulated(0, Request::None)]);
        for _ in 0..HIL_SILENCE_TICKS {
            let seen = tick(&mut device, &resting(), &[]);
            assert_eq!(
                (seen.telemetry.source, seen.valve.get()),
                (Source::Silence, 0)
            );
        }
        let seen = tick(&mut device, &resting(), &[]);
        assert_eq!(
            (seen.telemetry.source, mode(&seen)),
            (Source::Pins, Mode::SelfCheck)
        );
    }

    /// It would be a way around the contact that a reset needs.
    #[test]
    fn hardware_in_the_loop_resets_no_fault() {
        let mut device = ready();
        let stopped = Pins {
            stop_open: [true, false],
            ..resting()
        };
        for _ in 0..100 {
            tick(&mut device, &stopped, &[]);
        }
        let fault = Some(Fault::StopContactsDiffer);
        assert_eq!(device.controller.state().fault, fault);
        tick(&mut device, &resting(), &[Command::EnterHil]);
        let seen = tick(&mut device, &resting(), &[simulated(0, Request::None)]);
        assert_eq!(
            (mode(&seen), seen.telemetry.output.fault),
            (Mode::SelfCheck, None)
        );
        tick(&mut device, &resting(), &[Command::LeaveHil]);
        for _ in 0..100 {
            let seen = tick(&mut device, &resting(), &[]);
            assert_eq!(
                (mode(&seen), seen.telemetry.output.fault),
                (Mode::Venting, fault)
            );
        }
        tick(&mut device, &resting(), &[Command::Request(Request::Reset)]);
        let seen = tick(&mut device, &resting(), &[]);
        assert_eq!(
            (mode(&seen), seen.telemetry.output.fault),
            (Mode::SelfCheck, None)
        );
    }

    #[test]
    fn failed_start_keeps_the_valve_at_zero_whatever_is_requested() {
        for (fault, _) in StartFault::NAMED {
            let mut device = Device::new(settings()).started(Some(*fault));
            let commands = [Request::Reset, Request::Assist].map(Command::Request);
            let mut seen = tick(&mut device, &resting(), &[]);
            for _ in 0..200 {
                seen = tick(&mut device, &resting(), &commands);
            }
            let output = seen.telemetry.output;
            if *fault == StartFault::BrownOut {
                assert_eq!((output.mode, output.fault), (Mode::Assisting, None));
                continue;
            }
            let expected = (Mode::Venting, Some(Fault::Start(*fault)));
            assert_eq!((output.mode, output.fault), expected);
            assert_eq!((seen.valve, seen.port_pulse), (DacCount::default(), false));
            assert!(!seen.armed, "settings can be changed");
            // The plant of a PC does not use what has failed.
            tick(&mut device, &resting(), &[Command::EnterHil]);
            let seen = tick(&mut device, &resting(), &[simulated(1, Request::None)]);
            assert_eq!(mode(&seen), Mode::SelfCheck);
            assert_eq!(seen.valve, DacCount::default());
        }
    }

    #[test]
    fn lamp_warns_of_a_brown_out_only() {
        for (fault, _) in StartFault::NAMED {
            let mut device = Device::new(settings()).started(Some(*fault));
            tick(&mut device, &resting(), &[Command::EnterHil]);
            let mut in_loop = |n| tick(&mut device, &resting(), &[simulated(n, Request::None)]);
            (1..=60).for_each(|n| _ = in_loop(n));
            let period = (61..=260).map(in_loop);
            let lit_ticks = period
                .inspect(|seen| assert_eq!(mode(seen), Mode::Ready))
                .filter(|seen| seen.lamp)
                .count();
            let flashes = if *fault == StartFault::BrownOut { 3 } else { 1 };
            assert_eq!(lit_ticks, 10 * flashes, "{fault:?}");
        }
    }

    #[test]
    fn flips_of_the_start_up_fault_do_not_accumulate() {
        for fault in [None, Some(StartFault::Ram)] {
            let mut device = Device::new(settings()).started(fault);
            for copy in 0..=PLAIN {
                match device.start.plain_mut().get_mut(copy) {
                    Some(start) => *start = Some(StartFault::Supply),
                    None => device.start.set_inverted(&Some(StartFault::Supply)),
                }
                tick(&mut device, &resting(), &[]);
                assert_eq!(device.start, Voted::new(fault), "copy {copy}");
            }
        }
    }

    #[test]
    fn inverted_copies_hold_all_words() {
        let device = Device::new(settings());
        let hil = Some(Hil {
            sequence: Some(1),
            silent_ticks: 0,
        });
        assert_eq!(words(&device.hil, &hil), (HIL_WORDS, HIL_WORDS));
        let start = Some(StartFault::Ram);
        assert_eq!(words(&device.start, &start), (START_WORDS, START_WORDS));
    }

    /// The weight is let down from the measured pressure, and nothing begins any more.
    #[test]
    fn memory_of_the_device_that_was_overwritten_lets_the_weight_down() {
        let mut device = ready();
        let mut lifted = resting();
        tick(
            &mut device,
            &resting(),
            &[Command::Request(Request::Assist)],
        );
        lifted.pressure = AdcCount(1500);
        let state = *device.controller.state();
        let memory = device.controller.memory_mut();
        *memory.state.plain_mut() = [State::default(); PLAIN];
        memory.state.inverted_mut().fill(0);
        *device.start.plain_mut() = [Some(StartFault::Image); PLAIN];
        *device.start.inverted_mut() = [0; START_WORDS];
        *device.hil.inverted_mut() = [0; HIL_WORDS];
        assert_eq!(state.mode, Mode::Assisting);
        let mut before_pa = settings().values().pressure_sensor.value(lifted.pressure);
        for _ in 0..5 {
            let seen = tick(&mut device, &lifted, &[Command::Request(Request::Assist)]);
            let output = seen.telemetry.output;
            assert_eq!(
                (output.mode, output.fault),
                (Mode::Venting, Some(Fault::Memory))
            );
            let step_pa = before_pa - output.pressure_ref.0;
            assert!((0.0..=2e3 + 1.0).contains(&step_pa), "{step_pa} Pa");
            before_pa = output.pressure_ref.0;
        }
        for _ in 0..2000 {
            let command = Command::Request(Request::Reset);
            let seen = tick(&mut device, &resting(), &[command]);
            assert_eq!(mode(&seen), Mode::Venting);
        }
    }

    /// Otherwise the link could ask for the pressure that a sensor reads too much.
    #[test]
    fn after_hardware_in_the_loop_a_latched_fault_leaves_the_valve_at_zero() {
        let mut device = ready();
        let mut offset = resting();
        offset.pressure = AdcCount(434);
        let pulled = Pins {
            stop_open: [true, false],
            ..resting()
        };
        (0..100).for_each(|_| _ = tick(&mut device, &pulled, &[]));
        let fault = Some(Fault::StopContactsDiffer);
        for _ in 0..10 {
            let seen = [Command::EnterHil, Command::LeaveHil]
                .map(|command| tick(&mut device, &offset, &[command]));
            for seen in seen {
                assert_eq!(seen.valve, DacCount::default());
            }
            assert_eq!(device.controller.state().fault, fault);
        }
    }

    #[test]
    fn missed_ticks_reach_the_supervisor() {
        let mut device = ready();
        let timing = Timing {
            missed_ticks: 3,
            ..Timing::default()
        };
        let seen = device.tick(&resting(), timing, core::iter::empty());
        assert_eq!(seen.telemetry.output.fault, Some(Fault::MissedTicks));
    }
}

//! The board in memory: model-core's device behind the link, with a world at its pins.

use super::world::World;
use hil_sim::bench::person::ButtonHolder;
use hil_sim::bench::port::client::{Transport, TransportError};
use model_core::device::{Command, Device, Pins};
use model_core::gate::{Decision, SettingsGate};
use model_core::link::{
    Decoder, FRAME_LEN_MAX, FromDevice, Identity, ResetCause, SettingsSource, Signature, ToDevice,
    Written, board_name, encode,
};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, DacCount, EncoderCount};
use model_core::supervisor::Mode;
use model_core::timing::Timing;
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const TICK: Duration = Duration::from_millis(10);

/// What the board has stored, and how often.
pub struct Log {
    pub settings: SettingsValues,
    pub written: usize,
}

/// The board.
pub struct InMemory {
    world: Arc<Mutex<World>>,
    log: Arc<Mutex<Log>>,
    /// Somebody beside the board, who holds the button when the lamp asks.
    hand: ButtonHolder,
    pressed: bool,
    gate: SettingsGate,
    device: Device,
    decoder: Decoder,
    commands: VecDeque<Command>,
    to_pc: Vec<u8>,
    to_next_tick: Duration,
    valve: DacCount,
    /// It plays what the program sends tick by tick.
    pub playing: bool,
    /// Travel of the weight \[m\] at which the user presses Ctrl-C.
    pub interrupt: Option<(f64, Arc<AtomicBool>)>,
    /// Travel of the weight \[m\] from which no command reaches the board, for so many ticks.
    pub silence: Option<(f64, u32)>,
}

impl InMemory {
    pub fn new(world: Arc<Mutex<World>>, settings: SettingsValues) -> InMemory {
        let mut board = InMemory {
            world,
            log: Arc::new(Mutex::new(Log {
                settings,
                written: 0,
            })),
            hand: ButtonHolder::default(),
            pressed: false,
            gate: SettingsGate::default(),
            device: Device::new(Settings::new(settings).unwrap()),
            decoder: Decoder::new(),
            commands: VecDeque::new(),
            to_pc: Vec::new(),
            to_next_tick: TICK,
            valve: DacCount::default(),
            playing: false,
            interrupt: None,
            silence: None,
        };
        board.reset();
        board
    }

    pub fn log(&self) -> Arc<Mutex<Log>> {
        Arc::clone(&self.log)
    }

    fn reset(&mut self) {
        let settings = self.log.lock().unwrap().settings;
        let start = self.world.lock().unwrap().start_fault();
        self.device = Device::new(Settings::new(settings).unwrap()).started(start);
        self.commands.clear();
        self.gate = SettingsGate::default();
        self.valve = DacCount::default();
    }

    fn transmit(&mut self, message: &impl Serialize) {
        let mut buffer = [0; FRAME_LEN_MAX];
        self.to_pc
            .extend_from_slice(encode(message, &mut buffer).unwrap());
    }

    fn identity(&mut self) {
        let identity = Identity {
            firmware: [0, 1, 0],
            commit: 0,
            board: board_name("in memory"),
            cpu_hz: 144_000_000,
            reset: ResetCause::Software,
            crash: None,
            fault: None,
            start: self.world.lock().unwrap().start_fault(),
            settings: SettingsSource::Stored,
            safety_hash: 0,
            stack_free_bytes: 0,
            frames_rejected: 0,
            messages_dropped: 0,
        };
        self.transmit(&FromDevice::Identity(identity));
    }

    fn read(&mut self, message: ToDevice) {
        match message {
            ToDevice::Identify => self.identity(),
            ToDevice::ReadSettings => {
                let settings = self.log.lock().unwrap().settings;
                self.transmit(&FromDevice::Settings(settings));
            }
            ToDevice::Command(command) => self.commands.push_back(command),
            ToDevice::WriteSettings(values) => {
                let in_force = self.log.lock().unwrap().settings;
                let armed = self.device.is_armed();
                let signature = Signature::default();
                let decision = self.gate.offer(&in_force, values, signature, armed);
                self.carry_out(decision);
            }
            ToDevice::Sign(_) | ToDevice::ReadChange(_) => {}
        }
    }

    /// As the firmware does.
    fn carry_out(&mut self, decision: Decision) {
        let written = match decision {
            Decision::Answer(written) => written,
            Decision::Ask(number) => {
                self.device.propose(Some(number));
                Written::AwaitsButton
            }
            Decision::Withdraw => {
                self.device.propose(None);
                Written::NotConfirmed
            }
            Decision::Store(..) if self.device.is_armed() => Written::Armed,
            Decision::Store(settings, _) => {
                self.transmit(&FromDevice::Written(Written::Stored));
                let mut log = self.log.lock().unwrap();
                (log.settings, log.written) = (*settings.values(), log.written + 1);
                drop(log);
                self.reset();
                return self.identity();
            }
        };
        self.transmit(&FromDevice::Written(written));
    }

    fn tick(&mut self) {
        let inputs = self.world.lock().unwrap().pass(self.valve);
        let pins = Pins {
            bridge: AdcCount(inputs.bridge),
            pressure: AdcCount(inputs.pressure),
            encoder: EncoderCount(inputs.encoder as u32),
            read_back: AdcCount(self.valve.get()),
            button_pressed: self.pressed,
            stop_open: inputs.stop_open,
            enabling_closed: false,
        };
        let moved_m = self.world.lock().unwrap().moved_m;
        if let Some((at_m, ticks)) = &mut self.silence
            && moved_m > *at_m
            && *ticks > 0
        {
            *ticks -= 1;
            self.commands.clear();
        }
        let commands = &mut self.commands;
        let queued = std::iter::from_fn(|| commands.pop_front());
        let tick = self.device.tick(&pins, Timing::default(), queued);
        self.valve = tick.valve;
        self.playing = tick.telemetry.output.mode == Mode::Playing;
        if let Some((_, stop)) = self.interrupt.take_if(|(at_m, _)| moved_m > *at_m) {
            stop.store(true, Ordering::Relaxed);
        }
        self.pressed = self.hand.presses(tick.lamp);
        self.transmit(&FromDevice::Telemetry(tick.telemetry));
        if let Some(decision) = tick.verdict.and_then(|verdict| self.gate.decide(verdict)) {
            self.carry_out(decision);
        }
    }
}

impl Transport for InMemory {
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError> {
        for byte in bytes {
            if let Some(Ok(message)) = self.decoder.push(*byte) {
                self.read(message);
            }
        }
        Ok(())
    }

    fn receive(
        &mut self,
        received: &mut Vec<u8>,
        wait: Duration,
    ) -> Result<Duration, TransportError> {
        let mut passed = Duration::ZERO;
        if self.to_pc.is_empty() {
            passed = self.to_next_tick.min(wait);
            self.to_next_tick -= passed;
            if self.to_next_tick.is_zero() {
                self.to_next_tick = TICK;
                self.tick();
            }
        }
        received.append(&mut self.to_pc);
        Ok(passed)
    }
}

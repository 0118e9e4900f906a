//! A board in memory: model-core's device behind the link, over a line that may be faulty.

// Not every test uses all of it.
#![allow(dead_code, unused_imports)]

mod wander;

pub use wander::wander;

use hil_sim::bench::person::ButtonHolder;
use hil_sim::bench::port::client::{Transport, TransportError};
use model_core::device::{Command, Device, Pins};
use model_core::gate::{Decision, SettingsGate};
use model_core::io::{Request, Sensors};
use model_core::limits::safety_hash;
use model_core::link::{
    Change, Decoder, FRAME_LEN_MAX, FromDevice, Identity, ResetCause, SettingsSource, Signature,
    ToDevice, Written, board_name, encode,
};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, DacCount, EncoderCount};
use model_core::timing::Timing;
use serde::Serialize;
use std::collections::VecDeque;
use std::time::Duration;

/// The board's tick.
pub const TICK: Duration = Duration::from_millis(10);
const QUEUE: usize = 15;

/// Faults of the line, each with its probability in 65 536ths.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    pub lost: u16,
    pub flipped: u16,
    pub repeated: u16,
    pub exchanged: u16,
    /// A received block is repeated.
    pub echoed: u16,
}

/// An event before a tick of the board.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// The plug is pulled for this number of ticks; the board continues to run.
    Unplugged(u32),
    /// The board is reset.
    Reset,
}

/// The board and the wire.
#[derive(Debug)]
pub struct DeviceBoard {
    pub settings: SettingsValues,
    pub faults: Faults,
    /// Events and their ticks since the start, in ascending order.
    pub events: VecDeque<(u32, Event)>,
    /// Somebody beside the board holds the button when the lamp asks.
    pub hand: Option<ButtonHolder>,
    /// Is pressed in the next tick.
    pressed: bool,
    /// What the valve was set to in the last one.
    valve: DacCount,
    gate: SettingsGate,
    signature: Signature,
    /// What was stored, the newest last.
    pub changes: Vec<Change>,
    device: Device,
    decoder: Decoder,
    commands: VecDeque<Command>,
    to_pc: Vec<u8>,
    to_next_tick: Duration,
    ticks: u32,
    unplugged_until: u32,
    random: u64,
    frames_rejected: u32,
}

impl DeviceBoard {
    pub fn new(seed: u64) -> DeviceBoard {
        let settings = SettingsValues::reference();
        DeviceBoard {
            settings,
            faults: Faults::default(),
            events: VecDeque::new(),
            hand: Some(ButtonHolder::default()),
            pressed: false,
            valve: DacCount::default(),
            gate: SettingsGate::default(),
            signature: Signature::default(),
            changes: Vec::new(),
            device: Device::new(Settings::new(settings).unwrap()),
            decoder: Decoder::new(),
            commands: VecDeque::new(),
            to_pc: Vec::new(),
            to_next_tick: TICK,
            ticks: 0,
            unplugged_until: 0,
            random: seed | 1,
            frames_rejected: 0,
        }
    }

    /// Ticks since the start.
    pub fn ticks(&self) -> u32 {
        self.ticks
    }

    fn chance(&mut self, of_65536: u16) -> bool {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 40) as u16 % u16::MAX < of_65536
    }

    fn over_the_wire(&mut self, bytes: &[u8]) -> Vec<u8> {
        let faults = self.faults;
        let mut arrived = Vec::new();
        if self.ticks < self.unplugged_until {
            return arrived;
        }
        for byte in bytes {
            if self.chance(faults.lost) {
                continue;
            }
            let flip = u8::from(self.chance(faults.flipped)) << (self.random % 8);
            arrived.push(byte ^ flip);
            if self.chance(faults.repeated) {
                arrived.push(byte ^ flip);
            }
            let len = arrived.len();
            if len >= 2 && self.chance(faults.exchanged) {
                arrived.swap(len - 1, len - 2);
            }
        }
        if self.chance(faults.echoed) {
            arrived.extend_from_within(..);
        }
        arrived
    }

    fn reset(&mut self) {
        self.device = Device::new(Settings::new(self.settings).unwrap());
        self.valve = DacCount::default();
        self.commands.clear();
        self.gate = SettingsGate::default();
        self.decoder = Decoder::new();
        self.transmit_identity();
    }

    fn transmit(&mut self, message: &impl Serialize) {
        let mut buffer = [0; FRAME_LEN_MAX];
        let frame = encode(message, &mut buffer).unwrap();
        let arrived = self.over_the_wire(frame);
        self.to_pc.extend(arrived);
    }

    fn transmit_identity(&mut self) {
        let identity = Identity {
            firmware: [0, 1, 0],
            commit: 0,
            board: board_name("NUCLEO-F446RE"),
            cpu_hz: 180_000_000,
            reset: ResetCause::Pin,
            crash: None,
            fault: None,
            start: None,
            settings: SettingsSource::Reference,
            safety_hash: safety_hash(&self.settings),
            stack_free_bytes: 0,
            frames_rejected: self.frames_rejected,
            messages_dropped: 0,
        };
        self.transmit(&FromDevice::Identity(identity));
    }

    fn receive_message(&mut self, message: ToDevice) {
        match message {
            ToDevice::Identify => self.transmit_identity(),
            ToDevice::ReadSettings => self.transmit(&FromDevice::Settings(self.settings)),
            ToDevice::Command(command) if self.commands.len() < QUEUE => {
                self.commands.push_back(command);
            }
            ToDevice::Command(_) => {}
            ToDevice::WriteSettings(values) => {
                let (signature, armed) = (self.signature, self.device.is_armed());
                let decision = self.gate.offer(&self.settings, values, signature, armed);
                self.carry_out(decision);
            }
            ToDevice::Sign(signature) => self.signature = signature,
            ToDevice::ReadChange(back) => {
                let back = usize::from(back);
                let change = self.changes.iter().rev().nth(back).copied();
                self.transmit(&FromDevice::Change(change));
            }
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
            Decision::Store(settings, signature) => {
                self.settings = *settings.values();
                self.changes.push(Change {
                    number: self.changes.len() as u32,
                    signature,
                    values: self.settings,
                });
                self.transmit(&FromDevice::Written(Written::Stored));
                return self.reset();
            }
        };
        self.transmit(&FromDevice::Written(written));
    }

    /// One tick, with its telemetry.
    fn tick(&mut self) {
        self.ticks += 1;
        while self.events.front().is_some_and(|(at, _)| *at <= self.ticks) {
            match self.events.pop_front().unwrap().1 {
                Event::Unplugged(ticks) => self.unplugged_until = self.ticks + ticks,
                Event::Reset => self.reset(),
            }
        }
        let wobble = (self.ticks % 3) as u16;
        let pins = Pins {
            bridge: AdcCount(2047 + wobble),
            pressure: AdcCount(409 + wobble),
            read_back: AdcCount(self.valve.get()),
            button_pressed: self.pressed,
            ..Pins::default()
        };
        let commands = &mut self.commands;
        let queued = std::iter::from_fn(|| commands.pop_front());
        let tick = self.device.tick(&pins, Timing::default(), queued);
        self.valve = tick.valve;
        self.pressed = self
            .hand
            .as_mut()
            .is_some_and(|hand| hand.presses(tick.lamp));
        self.transmit(&FromDevice::Telemetry(tick.telemetry));
        if let Some(decision) = tick.verdict.and_then(|verdict| self.gate.decide(verdict)) {
            self.carry_out(decision);
        }
    }
}

impl Transport for DeviceBoard {
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError> {
        for byte in self.over_the_wire(bytes) {
            match self.decoder.push(byte) {
                Some(Ok(message)) => self.receive_message(message),
                Some(Err(_)) => self.frames_rejected += 1,
                None => {}
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

//! A board with the firmware, wired as in docs/wiring.md, and the PC at its link.

use emulated_board::{Board, ExceptionEvent, Pin, pin};
use model_core::io::{Request, Sensors};
use model_core::link::{Decoder, FRAME_LEN_MAX, FromDevice, Identity, Telemetry, ToDevice, encode};
use model_core::sampling::{INPUTS, SCANS};
use model_core::settings::SettingsValues;

/// Nanoseconds in a millisecond.
pub const MS: u64 = 1_000_000;
/// Nanoseconds in a tick.
pub const TICK_NS: u64 = 10 * MS;
/// Exception number of the tick: the interrupt of DMA2 stream 0.
pub const TICK_EXCEPTION: usize = 16 + 56;
/// Pin of the strain bridge.
pub const BRIDGE: Pin = pin('C', 0);
/// Pin of the pressure sensor.
pub const PRESSURE: Pin = pin('C', 1);
/// Pins of the emergency stop's contacts.
pub const STOP: [Pin; 2] = [pin('B', 10), pin('A', 8)];
/// Pin of the enabling device's contact.
pub const ENABLING: Pin = pin('C', 7);
/// Pin of the pulses for the valve in the muscle's port.
pub const PORT: Pin = pin('B', 5);
/// Pin of the status lamp.
pub const LAMP: Pin = pin('A', 5);
/// Pin of the user button.
pub const BUTTON: Pin = pin('C', 13);
/// Half of 5 V, as the chip's converter reads it.
const HALF_BRIDGE_SUPPLY: u16 = 3_102;
const LINK_BAUD: u32 = 921_600;

/// The voltage that the ADC converts to `count`.
pub fn volts(count: u16) -> f64 {
    f64::from(count) * 3.3 / 4095.0
}

/// The ELF of the firmware. Panics if `FIRMWARE` is not the path of a readable file.
fn firmware() -> Vec<u8> {
    let path = std::env::var_os("FIRMWARE").expect("FIRMWARE: the path of the firmware's ELF");
    std::fs::read(&path).unwrap_or_else(|error| panic!("FIRMWARE: {path:?}: {error}"))
}

/// The board and the PC at its link.
pub struct Rig {
    /// The board.
    pub board: Board,
    decoder: Decoder,
    /// Count of the calls of [`Rig::dither`].
    dithers: u16,
    /// Count of frames that could not be decoded.
    pub rejected: usize,
}

impl Rig {
    /// A board at rest: no finger force, no pressure, the emergency stop not pressed.
    pub fn new() -> Rig {
        let mut board = Board::new(&firmware()).expect("an ELF for this board");
        board.set_link_baud(LINK_BAUD);
        board.set_brown_out_level(0);
        board.set_level(BUTTON, Some(true));
        for contact in STOP {
            board.set_level(contact, Some(true));
        }
        let mut rig = Rig {
            board,
            decoder: Decoder::new(),
            dithers: 0,
            rejected: 0,
        };
        rig.dither();
        rig
    }

    /// A board that has run for `ms` with noise on its sensors.
    pub fn after_ms(ms: u64) -> Rig {
        let mut rig = Rig::new();
        rig.run_ms(ms);
        rig
    }

    /// Sets the sensors to their values at rest with noise of one count, as real sensors have it,
    /// which a mean over a tick does not remove.
    pub fn dither(&mut self) {
        self.dithers = self.dithers.wrapping_add(1);
        // Not periodic: the mean over a tick could then stand still, whatever its phase.
        let noise = (u32::from(self.dithers / 4).wrapping_mul(2_654_435_761) >> 16) as u16 % 3;
        self.board.set_analog(BRIDGE, volts(2047 + noise));
        self.board.set_analog(PRESSURE, volts(409 + noise));
    }

    /// Runs for `ms`, with new sensor noise every 5 ms.
    pub fn run_ms(&mut self, ms: u64) {
        let end_ns = self.board.time_ns() + ms * MS;
        while self.board.time_ns() < end_ns {
            self.dither();
            let next_ns = (self.board.time_ns() + 5 * MS).min(end_ns);
            self.board.run_until(next_ns);
        }
    }

    /// Sends a message.
    pub fn send(&mut self, message: &ToDevice) {
        let mut buffer = [0; FRAME_LEN_MAX];
        let frame = encode(message, &mut buffer).expect("short enough");
        self.board.link_send(frame);
    }

    /// Stores settings, and holds the button if they change the safety block.
    pub fn store(&mut self, values: SettingsValues) {
        let resets = self.board.resets().len();
        self.send(&ToDevice::WriteSettings(values));
        self.run_ms(50);
        if self.board.resets().len() == resets {
            self.board.set_level(BUTTON, Some(false));
            self.run_ms(2_050);
            self.board.set_level(BUTTON, Some(true));
        }
        assert_eq!(self.board.resets().len(), resets + 1, "a restart with them");
    }

    /// Messages since the last call, each with its time of arrival \[ns\].
    pub fn messages(&mut self) -> Vec<(u64, FromDevice)> {
        let mut messages = vec![];
        for received in self.board.link_receive() {
            match self.decoder.push(received.byte) {
                Some(Ok(message)) => messages.push((received.time_ns, message)),
                Some(Err(_)) => self.rejected += 1,
                None => {}
            }
        }
        messages
    }

    /// Telemetry since the last call; discards other messages.
    pub fn telemetry(&mut self) -> Vec<Telemetry> {
        let telemetry = |(_, message)| match message {
            FromDevice::Telemetry(telemetry) => Some(telemetry),
            _ => None,
        };
        self.messages().into_iter().filter_map(telemetry).collect()
    }

    /// Runs for 20 ms and returns the last telemetry.
    pub fn last_telemetry(&mut self) -> Telemetry {
        self.run_ms(20);
        self.telemetry().pop().expect("telemetry each tick")
    }

    /// Requests the identity.
    pub fn identity(&mut self) -> Identity {
        self.messages();
        self.send(&ToDevice::Identify);
        self.run_ms(20);
        let messages = self.messages();
        let identity = messages.iter().find_map(|(_, message)| match message {
            FromDevice::Identity(identity) => Some(*identity),
            _ => None,
        });
        identity.expect("an answer")
    }

    /// Sets the voltages of bridge and pressure sensor since the last tick. The conversions of this
    /// period that have already been made are replaced, as if the voltages had changed right after
    /// that tick: the plant answers a tick whose output is read some milliseconds later.
    pub fn set_analog_since_tick(&mut self, counts: [u16; INPUTS - 2]) {
        self.board.set_analog(BRIDGE, volts(counts[0]));
        self.board.set_analog(PRESSURE, volts(counts[1]));
        let conversions = self.board.symbol_with("CONVERSIONS");
        let address = conversions.expect("the buffer of the conversions");
        let mut scan = counts;
        // The bridge has a converter of its own, and the chip's converts half of its supply.
        if let Some(address) = self.board.symbol_with("BRIDGE_CODES") {
            let code = (i32::from(counts[0]) - 2048) * 1024 + 520;
            self.board
                .write_ram(address, &code.to_le_bytes().repeat(SCANS));
            scan[0] = HALF_BRIDGE_SUPPLY;
        }
        let bytes = scan.map(u16::to_le_bytes).concat();
        for scan in 0..SCANS {
            let offset = scan * INPUTS * size_of::<u16>();
            self.board.write_ram(address + offset as u32, &bytes);
        }
    }

    /// Applies sensor readings to the pins, and the request to the link.
    pub fn apply(&mut self, sensors: &Sensors) {
        self.set_analog_since_tick([sensors.bridge.0, sensors.pressure.0]);
        self.board.set_encoder(i64::from(sensors.encoder.0 as i32));
        if sensors.request != Request::None {
            let command = model_core::device::Command::Request(sensors.request);
            self.send(&ToDevice::Command(command));
        }
    }

    /// Runs in steps until a tick has begun, at the time that is returned, or until `end_ns`.
    fn run_to_tick(&mut self, step_ns: u64, end_ns: u64) -> Option<u64> {
        self.board.exceptions();
        self.board.trace_exceptions(true);
        let entered = |e: &ExceptionEvent| e.entered && e.exception == TICK_EXCEPTION;
        let mut tick = None;
        while tick.is_none() && self.board.time_ns() < end_ns {
            self.board.run_for(step_ns);
            tick = self.board.exceptions().into_iter().find(entered);
        }
        self.board.trace_exceptions(false);
        tick.map(|tick| tick.time_ns)
    }

    /// Runs until the next tick has begun, or 2 ms.
    pub fn run_into_tick(&mut self) {
        let end_ns = self.board.time_ns() + 2 * MS;
        self.run_to_tick(200, end_ns);
    }

    /// Time at which the next tick is due: one period after the last one, which it waits for.
    pub fn next_tick_ns(&mut self) -> u64 {
        let tick_ns = self.run_to_tick(MS / 10, u64::MAX);
        tick_ns.expect("a tick") + TICK_NS
    }

    /// Panics if the board has detected an error of the firmware.
    pub fn assert_no_errors(&self) {
        assert!(
            self.board.errors().is_empty(),
            "{}",
            self.board.error_report()
        );
    }

    /// Address of the function `name`.
    pub fn code(&self, name: &str) -> u32 {
        self.board
            .symbol(name)
            .unwrap_or_else(|| panic!("no {name} in the ELF"))
            & !1
    }
}

//! A board with the firmware, wired as docs/wiring.md says, and what its link tells.

use emulated_board::{Board, Pin, pin};
use model_core::io::{Request, Sensors};
use model_core::link::{Decoder, FRAME_LEN_MAX, FromDevice, Identity, Telemetry, ToDevice, encode};
use std::io::Write;

/// Nanoseconds in a millisecond.
pub const MS: u64 = 1_000_000;
/// Nanoseconds in a tick.
pub const TICK_NS: u64 = 10 * MS;
/// Exception number of the interrupt that ticks: DMA2 stream 0.
pub const TICK_EXCEPTION: usize = 16 + 56;
/// docs/wiring.md
pub const BRIDGE: Pin = pin('C', 0);
/// docs/wiring.md
pub const PRESSURE: Pin = pin('C', 1);
/// docs/wiring.md
pub const BUTTON: Pin = pin('C', 13);
const LINK_BAUD: u32 = 921_600;

/// The voltage that an ADC reads as `count`.
pub fn volts(count: u16) -> f64 {
    f64::from(count) * 3.3 / 4095.0
}

/// The firmware's ELF; if there is none, says so even when the test's output is captured.
pub fn firmware() -> Option<Vec<u8>> {
    let Some(path) = std::env::var_os("FIRMWARE") else {
        let name = std::thread::current().name().unwrap_or("?").to_string();
        let text = format!("SKIPPED {name}: FIRMWARE names no ELF, nothing was tested\n");
        let _ = std::io::stderr().write_all(text.as_bytes());
        return None;
    };
    Some(std::fs::read(&path).unwrap_or_else(|error| panic!("{path:?}: {error}")))
}

/// The board and the PC at its link.
pub struct Rig {
    /// The board.
    pub board: Board,
    decoder: Decoder,
    /// Counts up with each call of [`Rig::dither`].
    dithers: u16,
    /// Frames that did not decode.
    pub rejected: usize,
}

impl Rig {
    /// A board at rest: no finger, no pressure; none if there is no firmware.
    pub fn new() -> Option<Rig> {
        let mut board = Board::new(&firmware()?).expect("an ELF for this board");
        board.set_link_baud(LINK_BAUD);
        board.set_level(BUTTON, Some(true));
        let mut rig = Rig {
            board,
            decoder: Decoder::new(),
            dithers: 0,
            rejected: 0,
        };
        rig.dither();
        Some(rig)
    }

    /// A board that has run for `ms`, its sensors alive.
    pub fn after_ms(ms: u64) -> Option<Rig> {
        let mut rig = Rig::new()?;
        rig.run_ms(ms);
        Some(rig)
    }

    /// Sensors at rest, but not standing still: real ones are never quiet.
    pub fn dither(&mut self) {
        self.dithers = self.dithers.wrapping_add(1);
        let wobble = self.dithers % 3;
        self.board.set_analog(BRIDGE, volts(2047 + wobble));
        self.board.set_analog(PRESSURE, volts(409 + wobble));
    }

    /// Runs on, the sensors dithering each 5 ms.
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

    /// Messages since the last call, and when each had arrived.
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

    /// Telemetry since the last call, other messages dropped.
    pub fn telemetry(&mut self) -> Vec<Telemetry> {
        let telemetry = |(_, message)| match message {
            FromDevice::Telemetry(telemetry) => Some(telemetry),
            _ => None,
        };
        self.messages().into_iter().filter_map(telemetry).collect()
    }

    /// The last telemetry, after 20 ms more.
    pub fn last_telemetry(&mut self) -> Telemetry {
        self.run_ms(20);
        self.telemetry().pop().expect("telemetry each tick")
    }

    /// Asks who is there.
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

    /// Puts a sensor reading onto the pins, and what is asked for onto the link.
    pub fn apply(&mut self, sensors: &Sensors) {
        self.board.set_analog(BRIDGE, volts(sensors.bridge.0));
        self.board.set_analog(PRESSURE, volts(sensors.pressure.0));
        self.board.set_encoder(i64::from(sensors.encoder.0 as i32));
        if sensors.request != Request::None {
            let command = model_core::device::Command::Request(sensors.request);
            self.send(&ToDevice::Command(command));
        }
    }

    /// Panics if the board has found a mistake of the firmware.
    pub fn assert_no_errors(&self) {
        assert!(
            self.board.errors().is_empty(),
            "{}",
            self.board.error_report()
        );
    }

    /// Code of the symbol `name`.
    pub fn code(&self, name: &str) -> u32 {
        self.board
            .symbol(name)
            .unwrap_or_else(|| panic!("no {name} in the ELF"))
            & !1
    }
}

//! The link task's end of the serial link: messages to and from frames on the serial port.

use crate::board;
use crate::driver::serial::Serial;
use core::num::NonZeroU32;
use embedded_hal::delay::DelayNs;
use model_core::limits::safety_hash;
use model_core::link::{
    self, Decoder, FRAME_LEN_MAX, FromDevice, Identity, Note, ResetCause, SettingsSource,
    Telemetry, ToDevice,
};
use model_core::settings::SettingsValues;
use model_core::start::StartFault;
use model_core::timing::LinkLoad;

/// Bytes that the link carries per second, of ten bits each.
const BYTES_PER_S: NonZeroU32 = NonZeroU32::new(board::LINK_BAUD / 10).unwrap();

/// The link.
pub struct Link {
    serial: Serial,
    decoder: Decoder,
    load: LinkLoad,
    /// Count of damaged frames received.
    pub frames_rejected: u32,
    /// Count of messages dropped because a buffer or queue was full.
    pub messages_dropped: u32,
}

impl Link {
    /// A link on a serial port.
    pub fn new(serial: Serial) -> Link {
        Link {
            serial,
            decoder: Decoder::new(),
            load: LinkLoad::new(BYTES_PER_S),
            frames_rejected: 0,
            messages_dropped: 0,
        }
    }

    /// The next received message, if there is one.
    pub fn receive(&mut self) -> Option<ToDevice> {
        while let Some(byte) = self.serial.read() {
            self.load.received();
            match self.decoder.push(byte) {
                Some(Ok(message)) => return Some(message),
                Some(Err(link::Rejected)) => {
                    self.frames_rejected = self.frames_rejected.saturating_add(1);
                }
                None => {}
            }
        }
        None
    }

    /// Queues telemetry for [`Link::pump`], with the link's load; drops it if there is no room.
    pub fn send(&mut self, mut telemetry: Telemetry) {
        telemetry.timing.link_per_mille = self.load.tick();
        self.enqueue(&FromDevice::Telemetry(telemetry), 0);
    }

    /// Queues an answer; drops it unless there is room for telemetry besides. So telemetry is not
    /// lost if the PC sends too many requests.
    pub fn answer(&mut self, message: &FromDevice) {
        self.enqueue(message, 2 * FRAME_LEN_MAX);
    }

    fn enqueue(&mut self, message: &FromDevice, room_left_min: usize) {
        let mut buffer = [0; FRAME_LEN_MAX];
        let frame = link::encode(message, &mut buffer).unwrap_or_default();
        if frame.is_empty() || frame.len() + room_left_min > self.serial.room() {
            self.messages_dropped = self.messages_dropped.saturating_add(1);
            return;
        }
        self.load.sent(frame.len());
        self.serial.write(frame);
    }

    /// Starts sending what is queued.
    pub fn pump(&mut self) {
        self.serial.pump();
    }

    /// Sends everything queued and waits until it is sent.
    pub fn flush(&mut self, delay: &mut impl DelayNs) {
        self.serial.flush(delay);
    }
}

/// The identity of the board, with all counters at 0.
pub fn identity(
    reset: ResetCause,
    note: Note,
    settings: SettingsSource,
    values: &SettingsValues,
    start: Option<StartFault>,
) -> Identity {
    let number = |text: &str| text.parse().unwrap_or(0);
    Identity {
        firmware: [
            number(env!("CARGO_PKG_VERSION_MAJOR")),
            number(env!("CARGO_PKG_VERSION_MINOR")),
            number(env!("CARGO_PKG_VERSION_PATCH")),
        ],
        commit: u32::from_str_radix(env!("COMMIT"), 16).unwrap_or(0),
        board: link::board_name(board::NAME),
        cpu_hz: board::SYSCLK_HZ,
        reset,
        crash: note.crash,
        fault: note.fault,
        start,
        settings,
        safety_hash: safety_hash(values),
        stack_free_bytes: 0,
        frames_rejected: 0,
        messages_dropped: 0,
    }
}

//! The serial link: messages, and frames that carry them. docs/link.md is the specification.
//!
//! ```text
//! message ─ postcard ─▶ version │ body │ CRC-32 ─ COBS ─▶ bytes without a zero │ 0
//! ```
//!
//! A zero byte separates frames and occurs nowhere else: whatever is lost, flipped or repeated, the
//! decoder is synchronised at the next zero. A frame that does not pass its checksum is dropped.

use crate::device::Command;
pub use crate::gate::{Author, Signature, Written};
use crate::io::{Output, Sensors};
use crate::settings::SettingsValues;
use crate::start::StartFault;
use crate::supervisor::Fault;
use crate::timing::Timing;
use crc::{CRC_32_ISO_HDLC, Crc, Digest};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Version of the messages. It rises with every change of one, settings included, and also with a
/// fault that is added at the end. `hil-sim/tests/link_format.rs` fails if it does not.
pub const VERSION: u8 = 9;
/// A buffer of this size holds any frame.
pub const FRAME_LEN_MAX: usize = 255;

static CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const CHECKSUM_LEN: usize = 4;
/// The first COBS code and the terminating zero.
const OVERHEAD_LEN: usize = 2;

/// From the PC to the board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToDevice {
    /// Requests [`FromDevice::Identity`].
    Identify,
    /// Requests [`FromDevice::Settings`].
    ReadSettings,
    /// Stores settings and restarts with them; refused while armed.
    WriteSettings(SettingsValues),
    /// A command for the next tick.
    Command(Command),
    /// Who changes settings, and when, for the next [`ToDevice::WriteSettings`].
    Sign(Signature),
    /// Requests [`FromDevice::Change`] of the settings so many changes before those in force.
    ReadChange(u16),
}

/// Settings that were stored.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Counts up with each change.
    pub number: u32,
    /// Who changed them, and when.
    pub signature: Signature,
    /// What they were.
    pub values: SettingsValues,
}

/// From the board to the PC.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromDevice {
    /// After a reset, and on request.
    Identity(Identity),
    /// The settings in force.
    Settings(SettingsValues),
    /// Result of [`ToDevice::WriteSettings`].
    Written(Written),
    /// Each tick.
    Telemetry(Telemetry),
    /// Answer to [`ToDevice::ReadChange`]; none if there is no such change, or it is unreadable.
    Change(Option<Change>),
}

/// Where a tick's sensor readings came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Source {
    /// The pins.
    #[default]
    Pins,
    /// Hardware in the loop: the link, with the message's number.
    Link(u32),
    /// Hardware in the loop without a message: the controller has not ticked.
    Silence,
}

/// Input, output and timing of one tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Ticks since the reset.
    pub tick: u32,
    /// Where `sensors` came from.
    pub source: Source,
    /// The controller's input.
    pub sensors: Sensors,
    /// The controller's output. With hardware in the loop the board's own valve stays vented.
    pub output: Output,
    /// Timing of the tick, by the board's clock.
    pub timing: Timing,
}

/// A board's name: ASCII, and zeros to its end.
pub type BoardName = [u8; 16];

/// The first sixteen bytes of `name`.
pub fn board_name(name: &str) -> BoardName {
    let mut bytes = BoardName::default();
    for (target, byte) in bytes.iter_mut().zip(name.bytes()) {
        *target = byte;
    }
    bytes
}

/// The board's firmware, hardware and condition.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// The first eight digits of its git commit; 0: unknown.
    pub commit: u32,
    /// The hardware.
    pub board: BoardName,
    /// CPU cycles per second, for [`Timing`].
    pub cpu_hz: u32,
    /// Cause of the last reset.
    pub reset: ResetCause,
    /// The crash before that reset, if any.
    pub crash: Option<Crash>,
    /// The fault that was latched before that reset, if any.
    pub fault: Option<Fault>,
    /// What the start-up self-test has found.
    pub start: Option<StartFault>,
    /// Where its settings came from.
    pub settings: SettingsSource,
    /// The safety block in force: see [`crate::limits::safety_hash`].
    pub safety_hash: u32,
    /// Stack that was never used \[byte\].
    pub stack_free_bytes: u16,
    /// Frames that were dropped because they were damaged.
    pub frames_rejected: u32,
    /// Messages that were dropped because they came faster than they could be processed.
    pub messages_dropped: u32,
}

/// Where the settings in force came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SettingsSource {
    /// [`SettingsValues::reference`]: none were stored.
    Reference,
    /// [`SettingsValues::reference`]: the stored ones are of another version or cannot be read.
    ReferenceAsUnreadable,
    /// The flash.
    Stored,
}

/// Cause of a reset of the microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetCause {
    /// Power-on, or a supply voltage below the chip's minimum.
    Power,
    /// The reset button or the programmer.
    Pin,
    /// The firmware itself: new settings, or a crash.
    Software,
    /// The watchdog, because ticks did not complete.
    Watchdog,
    /// None of these.
    Other,
}

/// A crash of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Crash {
    /// A panic.
    Panic {
        /// The line of the source file.
        line: u32,
        /// The last bytes of the source file's path.
        file_end: [u8; 16],
    },
    /// A hard fault of the CPU.
    HardFault {
        /// Program counter.
        pc: u32,
        /// Link register: the caller.
        lr: u32,
        /// The CPU's configurable fault status register, which tells the cause.
        cfsr: u32,
    },
    /// The stack has exceeded its memory.
    StackOverflow {
        /// The stack pointer.
        sp: u32,
    },
    /// An interrupt without a handler: its number.
    Interrupt(i16),
}

impl ResetCause {
    /// Its name, for the log.
    pub fn name(self) -> &'static str {
        match self {
            ResetCause::Power => "Power",
            ResetCause::Pin => "Pin",
            ResetCause::Software => "Software",
            ResetCause::Watchdog => "Watchdog",
            ResetCause::Other => "Other",
        }
    }
}

impl Crash {
    /// Its name, for the log; the identity has the details.
    pub fn name(self) -> &'static str {
        match self {
            Crash::Panic { .. } => "Panic",
            Crash::HardFault { .. } => "HardFault",
            Crash::StackOverflow { .. } => "StackOverflow",
            Crash::Interrupt(_) => "Interrupt",
        }
    }
}

/// Data that the firmware keeps across a reset, as a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Note {
    /// For [`Identity::crash`].
    pub crash: Option<Crash>,
    /// For [`Identity::fault`].
    pub fault: Option<Fault>,
}

/// The message does not fit into a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong;

/// A frame that was dropped: damaged, of another version, or not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejected;

/// Places of the checksum and of the length of a flashed image, from its start \[byte\]: reserved
/// words of the vector table, which scripts/seal-image.sh fills in.
pub const IMAGE_CHECKSUM_AT: usize = 0x1c;
/// See [`IMAGE_CHECKSUM_AT`].
pub const IMAGE_LENGTH_AT: usize = 0x20;

/// What is known of the image in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageState {
    /// A part of it is not yet read.
    Unfinished,
    /// It was flashed without a checksum.
    Unsealed,
    /// It has its checksum, or has another.
    Sealed(bool),
}

/// Compares the image in flash with its checksum, a part at a time, again and again. The checksum
/// is the CRC-32 of the image with 0 in its own place.
pub struct ImageCheck {
    digest: Digest<'static, u32>,
    /// Bytes that are read.
    at: usize,
}

impl Default for ImageCheck {
    fn default() -> ImageCheck {
        ImageCheck {
            digest: CHECKSUM.digest(),
            at: 0,
        }
    }
}

impl ImageCheck {
    /// Reads so many more bytes of `flash`, which begins with an image, at most. Restarts with a
    /// result.
    pub fn step(&mut self, flash: &[u8], bytes: usize) -> ImageState {
        let word = |at: usize| {
            let bytes = flash.get(at..at.checked_add(4)?)?.try_into().ok()?;
            Some(u32::from_le_bytes(bytes))
        };
        let (Some(expected), Some(length)) = (word(IMAGE_CHECKSUM_AT), word(IMAGE_LENGTH_AT))
        else {
            return ImageState::Unsealed;
        };
        if length == 0 && expected == 0 {
            return ImageState::Unsealed;
        }
        let length = length as usize;
        if self.at == IMAGE_CHECKSUM_AT {
            self.digest.update(&[0; 4]);
            self.at = IMAGE_LENGTH_AT;
        } else if self.at < length {
            // The checksum begins a part of its own.
            let ends_at = if self.at < IMAGE_CHECKSUM_AT {
                IMAGE_CHECKSUM_AT
            } else {
                length
            };
            let part = self.at..ends_at.min(self.at.saturating_add(bytes));
            self.at = part.end;
            // An image that is longer than the flash is none.
            self.digest.update(flash.get(part).unwrap_or_default());
        }
        if self.at < length.max(IMAGE_LENGTH_AT) && length <= flash.len() {
            return ImageState::Unfinished;
        }
        let done = core::mem::take(self);
        ImageState::Sealed(length <= flash.len() && done.digest.finalize() == expected)
    }
}

/// Whether `flash`, which begins with an image, has the image's checksum; none if the image was
/// flashed without one.
pub fn check_image(flash: &[u8]) -> Option<bool> {
    let mut check = ImageCheck::default();
    // Before the checksum, the checksum, and after it.
    let states = [(); 3].map(|()| check.step(flash, usize::MAX));
    states.into_iter().find_map(|state| match state {
        ImageState::Sealed(is_right) => Some(is_right),
        _ => None,
    })
}

/// Writes `message` as a frame into `buffer`; returns the frame with its terminating zero.
///
/// # Errors
/// The message is too long. The messages of this module never are.
pub fn encode<'a, M: Serialize>(
    message: &M,
    buffer: &'a mut [u8; FRAME_LEN_MAX],
) -> Result<&'a [u8], TooLong> {
    // The first byte is reserved for the first COBS code; the payload follows.
    let (first, payload) = buffer.split_first_mut().ok_or(TooLong)?;
    *first = 0;
    let (version, rest) = payload.split_first_mut().ok_or(TooLong)?;
    *version = VERSION;
    let body_len = postcard::to_slice(message, rest)
        .map_err(|_| TooLong)?
        .len();
    let (covered, rest) = payload.split_at_mut_checked(1 + body_len).ok_or(TooLong)?;
    let checksum = rest.first_chunk_mut::<CHECKSUM_LEN>().ok_or(TooLong)?;
    *checksum = CHECKSUM.checksum(covered).to_le_bytes();
    let frame_len = 1 + body_len + CHECKSUM_LEN + OVERHEAD_LEN;
    let frame = buffer.get_mut(..frame_len).ok_or(TooLong)?;
    stuff(frame);
    Ok(frame)
}

/// Replaces each zero of `frame`, which begins with one, by the distance to the next; the last
/// byte becomes the only zero. Distances fit: a frame is at most 255 bytes long.
fn stuff(frame: &mut [u8]) {
    let mut distance = 0_u8;
    for (from_end, byte) in frame.iter_mut().rev().enumerate() {
        if from_end == 0 {
            *byte = 0;
        } else if *byte == 0 {
            *byte = distance;
            distance = 0;
        }
        distance = distance.wrapping_add(1);
    }
}

/// Reverses [`stuff`] on a frame without its last zero; none if the frame is not stuffed.
fn unstuff(frame: &mut [u8]) -> Option<&[u8]> {
    let mut distance = 0_u8;
    for byte in frame.iter_mut() {
        if distance == 0 {
            distance = *byte;
            *byte = 0;
        }
        distance = distance.checked_sub(1)?;
    }
    // The last distance leads to the zero that has ended the frame.
    let (_, payload) = frame.split_first()?;
    (distance == 0).then_some(payload)
}

fn decode<M: DeserializeOwned>(frame: &mut [u8]) -> Option<M> {
    let payload = unstuff(frame)?;
    let (covered, checksum) = payload.split_last_chunk::<CHECKSUM_LEN>()?;
    if CHECKSUM.checksum(covered) != u32::from_le_bytes(*checksum) {
        return None;
    }
    match covered.split_first()? {
        (&VERSION, body) => match postcard::take_from_bytes(body) {
            Ok((message, [])) => Some(message),
            _ => None,
        },
        _ => None,
    }
}

/// Finds frames in a stream of bytes.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: [u8; FRAME_LEN_MAX],
    /// Bytes since the last zero, those that did not fit included.
    len: usize,
}

impl Default for Decoder {
    fn default() -> Decoder {
        Decoder::new()
    }
}

impl Decoder {
    /// A decoder that waits for a frame's first byte.
    pub const fn new() -> Decoder {
        Decoder {
            buffer: [0; FRAME_LEN_MAX],
            len: 0,
        }
    }

    /// Takes one byte; returns the message that it completes, if it does.
    pub fn push<M: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<M, Rejected>> {
        if byte != 0 {
            if let Some(place) = self.buffer.get_mut(self.len) {
                *place = byte;
            }
            self.len = self.len.saturating_add(1);
            return None;
        }
        let len = core::mem::take(&mut self.len);
        // Repeated zeros are allowed: an empty frame is skipped.
        if len == 0 {
            return None;
        }
        Some(self.buffer.get_mut(..len).and_then(decode).ok_or(Rejected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Request;
    use crate::plausibility::Doubt;
    use crate::signal::{AdcCount, EncoderCount};
    use proptest::collection::vec;
    use proptest::prelude::*;

    /// Commands that differ from each other, with many zeros and ones among their bytes.
    fn command() -> impl Strategy<Value = ToDevice> {
        let counts = prop_oneof![Just(0_u32), Just(1), any::<u32>()];
        let request = prop_oneof![Just(Request::None), Just(Request::Vent)];
        (counts.clone(), 0..4096_u16, 0..4096_u16, counts, request).prop_map(
            |(sequence, bridge, pressure, encoder, request)| {
                ToDevice::Command(Command::Sensors(crate::device::SimulatedSensors {
                    sequence,
                    sensors: Sensors {
                        bridge: AdcCount(bridge),
                        pressure: AdcCount(pressure),
                        encoder: EncoderCount(encoder),
                        read_back: AdcCount(pressure),
                        missed_ticks: 0,
                        request,
                    },
                }))
            },
        )
    }

    fn frame(message: &ToDevice) -> Vec<u8> {
        encode(message, &mut [0xAA; FRAME_LEN_MAX])
            .unwrap()
            .to_vec()
    }

    /// Each frame's message; none for a rejected frame.
    fn received(bytes: &[u8]) -> Vec<Option<ToDevice>> {
        let mut decoder = Decoder::new();
        let pushed = bytes.iter().filter_map(|byte| decoder.push(*byte));
        pushed.map(Result::ok).collect()
    }

    #[test]
    fn the_longest_messages_fit() {
        let mut settings = SettingsValues::reference();
        settings.stuck_ticks = u16::MAX;
        settings.self_check_ticks = u16::MAX;
        settings.self_check_ticks_max = u16::MAX;
        let message = ToDevice::WriteSettings(settings);
        assert_eq!(received(&frame(&message)), [Some(message)]);
        let change = FromDevice::Change(Some(Change {
            number: u32::MAX,
            signature: Signature {
                utc_s: u32::MAX,
                author: [0xFF; 16],
                is_confirmed: true,
            },
            values: settings,
        }));
        assert!(encode(&change, &mut [0; FRAME_LEN_MAX]).is_ok());
        let crash = Crash::Panic {
            line: u32::MAX,
            file_end: [0xFF; 16],
        };
        let identity = FromDevice::Identity(Identity {
            firmware: [u8::MAX; 3],
            commit: u32::MAX,
            board: board_name("NUCLEO-F446RE"),
            cpu_hz: u32::MAX,
            reset: ResetCause::Other,
            crash: Some(crash),
            fault: Some(Fault::Encoder(Doubt::Stuck)),
            start: Some(StartFault::ValveVoltage),
            settings: SettingsSource::Stored,
            safety_hash: u32::MAX,
            stack_free_bytes: u16::MAX,
            frames_rejected: u32::MAX,
            messages_dropped: u32::MAX,
        });
        assert!(encode(&identity, &mut [0; FRAME_LEN_MAX]).is_ok());
        let longest = [[1_u8; 31]; 8];
        let len = |encoded: Result<&[u8], TooLong>| encoded.map(<[u8]>::len);
        assert_eq!(
            len(encode(&longest, &mut [0; FRAME_LEN_MAX])),
            Ok(FRAME_LEN_MAX)
        );
        let longer = (longest, 1_u8);
        assert_eq!(len(encode(&longer, &mut [0; FRAME_LEN_MAX])), Err(TooLong));
    }

    proptest! {
        #[test]
        fn any_bytes_are_recovered(bytes in vec(prop_oneof![Just(0_u8), any::<u8>()], 0..32)) {
            let mut decoder = Decoder::new();
            let mut array = [0; 32];
            array[..bytes.len()].copy_from_slice(&bytes);
            let mut buffer = [0xAA; FRAME_LEN_MAX];
            let (last, body) = encode(&array, &mut buffer).unwrap().split_last().unwrap();
            prop_assert!(*last == 0 && !body.contains(&0));
            for byte in body {
                prop_assert_eq!(decoder.push::<[u8; 32]>(*byte), None);
            }
            prop_assert_eq!(decoder.push::<[u8; 32]>(0), Some(Ok(array)));
        }

        /// After any noise, one zero synchronises the decoder.
        #[test]
        fn a_frame_arrives_after_noise(noise in vec(any::<u8>(), 0..600), message in command()) {
            let mut bytes = noise;
            bytes.push(0);
            let before = received(&bytes).len();
            bytes.extend(frame(&message));
            let all = received(&bytes);
            prop_assert_eq!(all.len(), before + 1);
            prop_assert!(all[..before].iter().all(Option::is_none));
            prop_assert_eq!(all[before], Some(message));
        }

        /// Bytes lost, flipped, repeated and exchanged: what arrives was sent, and frames that were
        /// not touched arrive.
        #[test]
        fn damage_never_makes_a_message(
            messages in vec(command(), 4..12),
            damages in vec((any::<prop::sample::Index>(), 0..4_u8, 1..=255_u8), 1..6),
        ) {
            let mut bytes: Vec<u8> = messages.iter().flat_map(frame).collect();
            for (place, kind, flip) in &damages {
                let place = place.index(bytes.len() - 1);
                match kind {
                    0 => drop(bytes.remove(place)),
                    1 => bytes[place] ^= flip,
                    2 => bytes.insert(place, bytes[place]),
                    _ => bytes.swap(place, place + 1),
                }
            }
            let got: Vec<ToDevice> = received(&bytes).into_iter().flatten().collect();
            let mut sent = messages.iter();
            // In order, each one of those that were sent.
            prop_assert!(got.iter().all(|message| sent.any(|one| one == message)));
            // A damaged byte spoils two frames at most: its own, and the next if it was the zero.
            prop_assert!(got.len() + 2 * damages.len() >= messages.len());
        }

        /// A frame that is truncated anywhere and sent again arrives the second time.
        #[test]
        fn a_truncated_frame_is_skipped(message in command(), cut in any::<prop::sample::Index>()) {
            let whole = frame(&message);
            let mut bytes = whole[..cut.index(whole.len())].to_vec();
            bytes.extend(&whole);
            bytes.extend(&whole);
            let all = received(&bytes);
            prop_assert_eq!(all.last(), Some(&Some(message)));
        }
    }

    /// An image of 200 bytes with its length and its checksum, in a flash of 256.
    fn sealed() -> [u8; 256] {
        let mut flash: [u8; 256] = core::array::from_fn(|at| at as u8);
        flash[IMAGE_LENGTH_AT..][..4].copy_from_slice(&200_u32.to_le_bytes());
        flash[IMAGE_CHECKSUM_AT..][..4].fill(0);
        let checksum = CHECKSUM.checksum(&flash[..200]);
        flash[IMAGE_CHECKSUM_AT..][..4].copy_from_slice(&checksum.to_le_bytes());
        flash
    }

    /// The first result with parts of this length, and the second.
    fn results(flash: &[u8], bytes: usize) -> [Option<ImageState>; 2] {
        let mut check = ImageCheck::default();
        let mut results = (0..1000)
            .map(|_| check.step(flash, bytes))
            .filter(|state| *state != ImageState::Unfinished);
        [results.next(), results.next()]
    }

    #[test]
    fn image_is_checked_in_parts_of_any_length_again_and_again() {
        let flash = sealed();
        for bytes in [1, 3, 28, 32, 200, usize::MAX] {
            let right = Some(ImageState::Sealed(true));
            assert_eq!(results(&flash, bytes), [right; 2], "{bytes}");
        }
        assert_eq!(check_image(&flash), Some(true));
        let unsealed = [7; IMAGE_CHECKSUM_AT];
        assert_eq!(check_image(&unsealed), None);
        let mut unsealed = flash;
        unsealed[IMAGE_CHECKSUM_AT..][..8].fill(0);
        assert_eq!(check_image(&unsealed), None);
        assert_eq!(results(&unsealed, 32), [Some(ImageState::Unsealed); 2]);
    }

    #[test]
    fn any_changed_bit_of_an_image_is_found() {
        for bit in 0..8 * 200 {
            let mut flash = sealed();
            flash[bit / 8] ^= 1 << (bit % 8);
            let wrong = Some(ImageState::Sealed(false));
            assert_eq!(results(&flash, 32), [wrong; 2], "bit {bit}");
            assert_eq!(check_image(&flash), Some(false), "bit {bit}");
        }
    }
}

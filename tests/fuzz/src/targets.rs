//! What is fuzzed: each takes any bytes, and panics where something does not hold. The fuzzer's
//! programs run these, and tests/tests/fuzz_seeds.rs on the seeds that are kept.

use crc::{CRC_32_ISO_HDLC, Crc};
use hil_sim::bench::port::emulated::answer;
use hil_sim::record::Record;
use hil_sim::record::import::Map;
use hil_sim::rig::Rig;
use model_core::device::{Device, Pins, Tick};
use model_core::link::{Decoder, FRAME_LEN_MAX, FromDevice, ToDevice, encode};
use model_core::settings::{self, Settings, SettingsValues};
use model_core::signal::{AdcCount, EncoderCount};
use model_core::store::{self, SLOT_LEN};
use model_core::timing::Timing;
use serde::ser::{Serialize, SerializeTuple, Serializer};

/// The target of that name.
pub fn target(name: &str) -> Option<fn(&[u8])> {
    match name {
        "import" => Some(import),
        "link" => Some(link),
        "mcap" => Some(mcap),
        "pipe" => Some(pipe),
        "record" => Some(record),
        "rig" => Some(rig),
        "settings" => Some(settings),
        _ => None,
    }
}

/// Takes `count` bytes off, or what is left.
fn take<'a>(bytes: &mut &'a [u8], count: usize) -> &'a [u8] {
    let (taken, rest) = bytes.split_at(count.min(bytes.len()));
    *bytes = rest;
    taken
}

fn word(bytes: &mut &[u8]) -> u32 {
    let mut word = [0; 4];
    for (place, byte) in word.iter_mut().zip(take(bytes, 4)) {
        *place = *byte;
    }
    u32::from_le_bytes(word)
}

fn reference() -> Settings {
    Settings::new(SettingsValues::reference()).expect("the reference is valid")
}

/// A body that is any bytes: no fuzzer finds a CRC-32 by itself.
struct Body<'a>(&'a [u8]);

impl Serialize for Body<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        for byte in self.0 {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

/// Bytes on the link, some of them in whole frames: no panic, no valve beyond its settings, and a
/// device that heard only invalid frames is as it was.
pub fn link(mut bytes: &[u8]) {
    let (mut device, mut quiet) = (Device::new(reference()), Device::new(reference()));
    let (mut decoder, mut at_pc) = (Decoder::new(), Decoder::new());
    let mut pins = Pins {
        bridge: AdcCount(2048),
        pressure: AdcCount(410),
        encoder: EncoderCount(7),
        button_pressed: false,
        stop_open: [false; 2],
    };
    let mut heard = false;
    while let [control, rest @ ..] = bytes {
        bytes = rest;
        let part = take(&mut bytes, usize::from(control & 0x3F) * 4);
        let mut buffer = [0; FRAME_LEN_MAX];
        let part = match encode(&Body(part), &mut buffer) {
            Ok(frame) if control & 0x80 != 0 => frame,
            _ => part,
        };
        let mut commands = Vec::new();
        for byte in part {
            let _ = at_pc.push::<FromDevice>(*byte);
            match decoder.push::<ToDevice>(*byte) {
                Some(Ok(ToDevice::Command(command))) => commands.push(command),
                // The firmware stores valid ones unless armed, and restarts with them.
                Some(Ok(ToDevice::WriteSettings(values))) => {
                    if let (Ok(settings), false) = (Settings::new(values), device.is_armed()) {
                        (device, heard) = (Device::new(settings), true);
                    }
                }
                _ => {}
            }
        }
        heard |= !commands.is_empty();
        let mut ticks = 1;
        if control & 0x40 != 0 {
            let at = word(&mut bytes);
            ticks = 1 + at % 4;
            pins = Pins {
                bridge: AdcCount((at >> 8) as u16 & 0xFFF),
                pressure: AdcCount((at >> 20) as u16),
                encoder: EncoderCount(word(&mut bytes)),
                button_pressed: at & 0x80 != 0,
                stop_open: [at & 0x40 != 0, at & 0x20 != 0],
            };
        }
        let mut commands = commands.into_iter();
        for _ in 0..ticks {
            let told = device.tick(&pins, Timing::default(), &mut commands);
            let same = quiet.tick(&pins, Timing::default(), core::iter::empty());
            assert!(heard || told == same, "{told:?}");
            within_settings(&told);
        }
    }
}

fn within_settings(told: &Tick) {
    let output = told.telemetry.output;
    // Settings allow 2 MPa at most; NaN is not within.
    assert!((0.0..=2e6).contains(&output.pressure_ref.0), "{output:?}");
}

/// Records: one, or one line that says what is wrong; what is written of one is read again.
pub fn record(bytes: &[u8]) {
    match Record::parse("record.csv", bytes) {
        Ok(record) => {
            let again = Record::parse("again.csv", &record.to_csv()).expect("it was written");
            assert_eq!(again.time_s(), record.time_s());
        }
        Err(bad) => assert_eq!(bad.to_string().lines().count(), 1),
    }
}

/// Files of other programs, read with the mapping that their first byte chooses: a record, which is
/// read again, or one line that says what is wrong.
pub fn import(bytes: &[u8]) {
    let Some((choice, file)) = bytes.split_first() else {
        return;
    };
    let map = &IMPORT_MAPS[usize::from(*choice) % IMPORT_MAPS.len()];
    let map = Map::parse("map.toml", map).expect("a mapping");
    match map.import("file", file) {
        Ok(imported) => {
            let written = imported.record.to_csv();
            let again = Record::parse("again.csv", &written).expect("it was written");
            assert_eq!(again.time_s(), imported.record.time_s());
        }
        Err(bad) => assert_eq!(bad.to_string().lines().count(), 1),
    }
}

/// Of MATLAB's variables, of the example, and of a CSV file whose clock restarts.
const IMPORT_MAPS: [&str; 3] = [
    "[time]\ncolumn = \"t_ms\"\nunit = \"ms\"\n\
     [columns.pressure_pa]\ncolumn = \"p\"\nunit = \"bar\"\n\
     [columns.contraction]\ncolumn = \"data(:,2)\"\nunit = \"%\"\n\
     [columns.force_n]\ncolumn = \"s.x\"\nunit = \"N\"\n",
    Map::EXAMPLE_TOML,
    "[time]\ncolumn = 1\nunit = \"s\"\nrepeated = \"spread\"\nrestarted = \"continue\"\n\
     [columns.force_n]\ncolumn = 2\nunit = \"N\"\n",
];

/// The same as MCAP.
pub fn mcap(bytes: &[u8]) {
    if let Err(bad) = hil_sim::record::mcap::parse("record.mcap", bytes) {
        assert_eq!(bad.to_string().lines().count(), 1);
    }
}

/// What the emulated board's program answers: its parts, nothing made up, or an error.
pub fn pipe(bytes: &[u8]) {
    let (mut rest, mut received) = (bytes, Vec::new());
    while let Ok((passed, lines)) = answer(&mut rest, &mut received) {
        assert!(!passed.is_zero());
        // What does not decode is told by a character of three bytes.
        let told: usize = lines.iter().map(String::len).sum();
        assert!(received.len() + told <= 3 * bytes.len());
    }
}

/// Rig files: one, or one line that says what is wrong.
pub fn rig(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes)
        && let Err(bad) = Rig::parse("rig.toml", text)
    {
        assert_eq!(bad.to_string().lines().count(), 1);
    }
}

const SLOTS: usize = 2;
const SECTOR_LEN: usize = SLOTS * SLOT_LEN;

fn with_checksum(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

/// A slot: blank, of any bytes, or valid with any settings or the reference's in it.
fn slot(bytes: &mut &[u8]) -> Vec<u8> {
    let control = take(bytes, 1).first().copied().unwrap_or(0);
    let encoded = match control % 4 {
        0 => return Vec::new(),
        1 => return take(bytes, 2 * usize::from(control)).to_vec(),
        2 => {
            let mut encoded = settings::VERSION.to_le_bytes().to_vec();
            encoded.extend(take(bytes, usize::from(control)));
            with_checksum(encoded)
        }
        _ => {
            let mut buffer = [0; settings::ENCODED_LEN_MAX];
            reference().encode(&mut buffer).expect("it fits").to_vec()
        }
    };
    let written = store::store([&[0xFF; SLOT_LEN], &[]], &reference()).expect("they fit");
    let mut slot = written.bytes()[..2].to_vec();
    slot.extend((encoded.len() as u16).to_le_bytes());
    // After the highest number none is newer; no flash lives to see 2³¹ writes.
    slot.extend((word(bytes) >> 1).to_le_bytes());
    slot.extend(encoded);
    with_checksum(slot)
}

/// Flash of any content: only valid settings come out; what is written next lies in a slot that is
/// blank, is read again, and at no moment of it are valid settings lost.
pub fn settings(mut bytes: &[u8]) {
    let mut flash = [[0xFF_u8; SECTOR_LEN]; 2];
    for sector in &mut flash {
        for place in sector.chunks_mut(SLOT_LEN) {
            let slot = slot(&mut bytes);
            for (cell, byte) in place.iter_mut().zip(&slot) {
                *cell = *byte;
            }
        }
    }
    let load = |flash: &[[u8; SECTOR_LEN]; 2]| store::load([&flash[0], &flash[1]]);
    let before = load(&flash);
    if let Ok(Some(settings)) = before {
        assert_eq!(Settings::new(*settings.values()), Ok(settings));
    }
    let other = Settings::new(SettingsValues {
        gain: 3.0,
        ..SettingsValues::reference()
    });
    let other = other.expect("valid settings");
    let write = store::store([&flash[0], &flash[1]], &other).expect("settings fit into a slot");
    let len = write.bytes().len();
    assert!(write.sector < 2 && write.offset.is_multiple_of(SLOT_LEN) && len <= SLOT_LEN);
    assert!(write.offset < SECTOR_LEN);
    if write.erase {
        flash[write.sector] = [0xFF; SECTOR_LEN];
        assert!(load(&flash) == before || before.is_err() || before == Ok(None));
    }
    let cells = &mut flash[write.sector][write.offset..][..len];
    assert!(cells.iter().all(|cell| *cell == 0xFF), "programmed twice");
    for (cell, byte) in cells.iter_mut().zip(write.bytes()) {
        *cell = *byte;
    }
    assert_eq!(load(&flash), Ok(Some(other)));
}

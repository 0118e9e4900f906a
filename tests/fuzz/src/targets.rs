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
use std::io::{Cursor, Write};
use std::sync::LazyLock;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// The target of that name.
pub fn target(name: &str) -> Option<fn(&[u8])> {
    match name {
        "import" => Some(import),
        "import-hdf5" => Some(import_hdf5),
        "import-log" => Some(import_log),
        "import-matlab" => Some(import_matlab),
        "import-ros" => Some(import_ros),
        "import-sheet" => Some(import_sheet),
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
        ..Pins::default()
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
                read_back: pins.read_back,
                button_pressed: at & 0x80 != 0,
                stop_open: [at & 0x40 != 0, at & 0x20 != 0],
                enabling_closed: at & 0x10 != 0,
            };
        }
        let mut commands = commands.into_iter();
        for _ in 0..ticks {
            let told = device.tick(&pins, Timing::default(), &mut commands);
            let same = quiet.tick(&pins, Timing::default(), core::iter::empty());
            assert!(heard || told == same, "{told:?}");
            pins.read_back = AdcCount(told.valve.get());
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

/// CSV files of other programs, read with the mapping that their first byte chooses.
pub fn import(bytes: &[u8]) {
    if let Some((choice, file)) = bytes.split_first() {
        imported(&IMPORT_MAPS[usize::from(*choice) % IMPORT_MAPS.len()], file);
    }
}

/// A record, which is read again, or one line that says what is wrong.
fn imported(map: &Map, file: &[u8]) {
    match map.import("file", file) {
        Ok(imported) => {
            let written = imported.record.to_csv();
            let again = Record::parse("again.csv", &written).expect("it was written");
            assert_eq!(again.time_s(), imported.record.time_s());
        }
        Err(bad) => assert_eq!(bad.to_string().lines().count(), 1),
    }
}

/// MATLAB 5 files without their header, which is always the same.
pub fn import_matlab(bytes: &[u8]) {
    let mut file = b"MATLAB 5.0".to_vec();
    file.resize(124, b' ');
    file.extend([0, 1, b'I', b'M']);
    file.extend(bytes);
    imported(&IMPORT_MAPS[0], &file);
}

/// HDF5 files. The command reads them in a process with limits; here are small ones only.
pub fn import_hdf5(bytes: &[u8]) {
    if bytes.starts_with(b"\x89HDF") {
        imported(&IMPORT_MAPS[0], bytes);
    }
}

/// MCAP files: all of their bytes, or the records behind the signature.
pub fn import_log(bytes: &[u8]) {
    let signature = b"\x89MCAP0\r\n";
    if bytes.starts_with(signature) {
        imported(&LOG_MAP, bytes);
    } else {
        imported(&LOG_MAP, &[signature, bytes].concat());
    }
}

/// A definition and messages of ROS 2, apart by zeros, in a sound log.
pub fn import_ros(bytes: &[u8]) {
    let end = bytes
        .iter()
        .position(|byte| *byte == 0)
        .unwrap_or(bytes.len());
    let (definition, rest) = bytes.split_at(end);
    let mut log = b"\x89MCAP0\r\n".to_vec();
    let text = |text: &[u8]| [&(text.len() as u32).to_le_bytes()[..], text].concat();
    let mut record = |kind: u8, parts: &[&[u8]]| {
        let parts = parts.concat();
        log.push(kind);
        log.extend((parts.len() as u64).to_le_bytes());
        log.extend(parts);
    };
    record(
        3,
        &[&[1, 0], &text(b"a/B"), &text(b"ros2msg"), &text(definition)],
    );
    record(4, &[&[1, 0, 1, 0], &text(b"/t"), &text(b"cdr"), &text(b"")]);
    for (time, message) in rest.chunks(32).enumerate() {
        // A little-endian one of the file's bytes.
        let times = (time as u64).to_le_bytes();
        record(
            5,
            &[&[1, 0, 0, 0, 0, 0], &times, &times, &[0, 1, 0, 0], message],
        );
    }
    imported(&LOG_MAP, &log);
}

/// Workbooks whose parts are the bytes between zeros: relations, workbook, sheet, texts, styles.
pub fn import_sheet(bytes: &[u8]) {
    const PARTS: [(&str, &[u8]); 5] = [
        ("xl/worksheets/sheet1.xml", b""),
        ("xl/sharedStrings.xml", b"<sst></sst>"),
        ("xl/styles.xml", b"<styleSheet></styleSheet>"),
        (
            "xl/workbook.xml",
            b"<workbook><sheets><sheet name=\"a\" sheetId=\"1\" r:id=\"r1\"/></sheets></workbook>",
        ),
        (
            "xl/_rels/workbook.xml.rels",
            b"<Relationships><Relationship Id=\"r1\" Type=\"http://schemas.openxmlformats.org/\
              officeDocument/2006/relationships/worksheet\" Target=\"worksheets/sheet1.xml\"/>\
              </Relationships>",
        ),
    ];
    const RELATIONS: &[u8] = b"<Relationships><Relationship Id=\"r1\" Type=\"http://schemas.\
        openxmlformats.org/officeDocument/2006/relationships/officeDocument\" \
        Target=\"xl/workbook.xml\"/></Relationships>";
    let mut given = bytes.split(|byte| *byte == 0);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut part = |name: &str, bytes: &[u8]| {
        zip.start_file(name, options).expect("memory");
        zip.write_all(bytes).expect("memory");
    };
    part("[Content_Types].xml", b"<Types/>");
    part("_rels/.rels", RELATIONS);
    for (name, usual) in PARTS {
        part(
            name,
            given
                .next()
                .filter(|bytes| !bytes.is_empty())
                .unwrap_or(usual),
        );
    }
    let file = zip.finish().expect("memory").into_inner();
    imported(&IMPORT_MAPS[2], &file);
}

fn mapping(text: &str) -> Map {
    Map::parse("map.toml", text).expect("a mapping")
}

/// Of a log with one topic.
static LOG_MAP: LazyLock<Map> = LazyLock::new(|| {
    mapping(
        "[time]\ncolumn = \"log_time_s\"\nunit = \"s\"\nrepeated = \"spread\"\n\
         [columns.force_n]\ncolumn = \"a\"\nunit = \"N\"\n",
    )
});

/// Of MATLAB's variables, of the example, and of a CSV file whose clock restarts.
static IMPORT_MAPS: LazyLock<[Map; 3]> = LazyLock::new(|| {
    [
        "[time]\ncolumn = \"t_ms\"\nunit = \"ms\"\n\
         [columns.pressure_pa]\ncolumn = \"p\"\nunit = \"bar\"\n\
         [columns.contraction]\ncolumn = \"data(:,2)\"\nunit = \"%\"\n\
         [columns.force_n]\ncolumn = \"s.x\"\nunit = \"N\"\n",
        Map::EXAMPLE_TOML,
        "[time]\ncolumn = 1\nunit = \"s\"\nrepeated = \"spread\"\nrestarted = \"continue\"\n\
         [columns.force_n]\ncolumn = 2\nunit = \"N\"\n",
    ]
    .map(mapping)
});

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

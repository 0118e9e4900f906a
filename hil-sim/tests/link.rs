//! The PC's end of the link against a board in memory.

mod board;

use board::{DeviceBoard, Event, Faults, wander};
use hil_sim::bench::board_settings;
use hil_sim::bench::closed_loop::{self, Run};
use hil_sim::bench::hil::{self, Job};
use hil_sim::bench::port::client::{Client, LinkError, Transport};
use hil_sim::bench::recorder::{Recorder, Timeline};
use hil_sim::bench::replay::{Inputs, OnBoard, OnPc, replay};
use hil_sim::bench::settings_file;
use hil_sim::bench::tick;
use hil_sim::bench::view::View;
use hil_sim::record::Record;
use hil_sim::record::columns::{Firmware, Row, Software};
use hil_sim::record::mcap::{self, Origin};
use hil_sim::rig::Rig;
use model_core::controller::Controller;
use model_core::device::Command;
use model_core::io::{Output, Request, Sensors};
use model_core::limits::safety_hash;
use model_core::link::{FromDevice, Telemetry, ToDevice, Written};
use model_core::settings::{Settings, SettingsValues};
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::time::Duration;

const GIVE_UP: Duration = Duration::from_secs(60);

fn client<P: Transport>(port: P) -> Client<P> {
    Client::new(port, GIVE_UP, Arc::default())
}

fn reference() -> Settings {
    Settings::new(SettingsValues::reference()).unwrap()
}

#[test]
fn hardware_in_the_loop_equals_the_closed_loop_to_the_last_bit() {
    let rig = Rig::reference();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    let experiment = Run {
        duration_s: 4.0,
        ..Run::PAPER
    };
    let mut client = client(DeviceBoard::new(1));
    let settings = board_settings::ensure_from_rig(&mut client, &rig, "board", false).unwrap();
    let job = Job {
        rig: &rig,
        settings,
        run: &experiment,
        real_time: false,
        progress: |_, _, _| {},
    };
    let recorder = Recorder::create(&path, &Origin::default()).unwrap();
    let view = Mutex::new(View::default());
    let (ticks, report) = hil::run(&mut client, "run", &job, recorder, &view).unwrap();
    let mut controller = Controller::new(settings);
    let here =
        closed_loop::run_in_process(&rig, &settings, &experiment, |s| controller.tick(s)).unwrap();
    assert_eq!(ticks.len(), 400);
    for (there, here) in ticks.iter().zip(&here) {
        assert_eq!(there.output, here.output);
        assert_eq!(there.force_n.to_bits(), here.force_n.to_bits());
    }
    assert_eq!(
        (report.ticks, report.restarts, report.link.telemetry_lost),
        (400, 0, 0)
    );
    assert!(
        ticks.iter().any(|tick| tick.contraction > 0.1),
        "the weight was lifted"
    );
    // What was streamed is what the run's record holds, but for the board's own columns.
    let streamed = Record::read(&path).unwrap();
    let whole = tick::record(&settings, &here);
    for column in [
        "pressure_ref_pa",
        "force_n",
        "bridge_count",
        "exact_pressure_ref_pa",
    ] {
        assert_eq!(streamed.column(column), whole.column(column), "{column}");
    }
    let again = replay(&Inputs::new(&whole).unwrap(), &mut OnPc::default(), |_| {}).unwrap();
    assert_eq!((again.compared_ticks, again.differing_ticks), (400, 0));
}

/// When the records start: 2026-11-24 01:20:00 UTC.
const STARTED: Duration = Duration::from_secs(1_795_483_200);

/// The firmware that the records state.
const FIRMWARE: Firmware = Firmware {
    version: [1, 2, 3],
    commit: 0x0a2b_3c4d,
};

/// Runs `ticks` ticks of [`wander`] on `client`'s board and records them.
fn record_wandering<P: Transport>(client: &mut Client<P>, ticks: u32, path: &Path) {
    let origin = Origin {
        rig: Some("none".into()),
        seed: Some(u64::MAX),
        started: STARTED,
        software: Software {
            firmware: Some(FIRMWARE),
        },
        ..Origin::default()
    };
    let mut recorder = Recorder::create(path, &origin).unwrap();
    client.restart_in_loop().unwrap();
    let mut before = Output::default();
    for tick in 0..ticks {
        let sensors = wander(tick, &before);
        let answer = client.exchange(&sensors).unwrap();
        before = answer.output;
        let begins = tick == 0 || answer.restarted;
        let told = answer.telemetry;
        let row = Row {
            time_s: f64::from(tick) * 0.01,
            pressure_ref_pa: 0.0,
            shut: None,
            sensors,
            output: answer.output,
            plant: None,
            board: told.map(|told| (told.tick, told.source, told.timing)),
            start_settings: begins.then(reference),
            software: None,
        };
        recorder.push(&row).unwrap();
    }
    assert_eq!(recorder.finish().unwrap(), ticks as usize);
}

#[test]
fn hundred_thousand_recorded_ticks_replay_without_a_difference() {
    const TICKS: usize = 100_000;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.csv");
    let mut client = client(DeviceBoard::new(2));
    record_wandering(&mut client, TICKS as u32, &path);
    let record = Record::read(&path).unwrap();
    let faults = record.text("fault").unwrap();
    assert!(
        faults.iter().any(|fault| !fault.is_empty()),
        "faults come up too"
    );
    let inputs = Inputs::new(&record).unwrap();
    let mut on_board = OnBoard {
        client: &mut client,
        port: "board",
        may_write_settings: false,
    };
    let there = replay(&inputs, &mut on_board, |_| {}).unwrap();
    let here = replay(&inputs, &mut OnPc::default(), |_| {}).unwrap();
    for result in [here, there] {
        assert_eq!(
            (result.compared_ticks, result.differing_ticks),
            (TICKS, 0),
            "{result:?}"
        );
    }
    let record = mcap::read(&path.with_extension("mcap")).unwrap();
    let inputs = Inputs::new(&record).unwrap();
    let from_mcap = replay(&inputs, &mut OnPc::default(), |_| {}).unwrap();
    assert_eq!(
        (from_mcap.compared_ticks, from_mcap.differing_ticks),
        (TICKS, 0)
    );
}

#[test]
fn a_changed_output_is_found_with_its_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    record_wandering(&mut client(DeviceBoard::new(3)), 500, &path);
    let mut record = Record::read(&path).unwrap();
    let mut valve = record.column("valve_count").unwrap().to_vec();
    valve[321] += 3.0;
    valve[400] -= 7.0;
    record.set("valve_count", valve);
    let result = replay(&Inputs::new(&record).unwrap(), &mut OnPc::default(), |_| {}).unwrap();
    assert_eq!((result.compared_ticks, result.differing_ticks), (500, 2));
    let first = result.first_divergence.clone().unwrap();
    assert_eq!(
        (first.row, first.column, first.difference),
        (322, "valve_count", Some(-3.0))
    );
    assert_eq!(result.largest_differences, [("valve_count", 7.0)]);
    assert!(
        result.verdict().contains("row 322, 3.21 s, valve_count"),
        "{}",
        result.verdict()
    );
}

/// So that whoever investigates an accident knows which program has run.
#[test]
fn a_record_states_the_versions_of_its_programs_in_its_first_row() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    record_wandering(&mut client(DeviceBoard::new(3)), 3, &path);
    let this = concat!("hil-sim ", env!("CARGO_PKG_VERSION"));
    let with_board = format!("{this}, firmware 1.2.3 (0a2b3c4d)");
    let of_mcap = mcap::read(&path.with_extension("mcap")).unwrap();
    for record in [Record::read(&path).unwrap(), of_mcap] {
        assert_eq!(record.text("software").unwrap(), [&with_board, "", ""]);
    }
    let (rig, settings) = (Rig::reference(), reference());
    let ticks = closed_loop::run_in_process(&rig, &settings, &Run::PAPER, |_| Output::default());
    let in_process = tick::record(&settings, &ticks.unwrap()[..2]);
    assert_eq!(in_process.text("software").unwrap(), [this, ""]);
}

/// MCAP as others read it: the crate's own reader, summary, metadata, schema, every message.
#[test]
fn mcap_has_the_contents_that_viewers_need() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    record_wandering(&mut client(DeviceBoard::new(3)), 120, &path);
    let bytes = std::fs::read(path.with_extension("mcap")).unwrap();
    let summary = ::mcap::Summary::read(&bytes).unwrap().expect("a summary");
    assert_eq!(summary.stats.expect("statistics").message_count, 120);
    let [index] = &summary.metadata_indexes[..] else {
        panic!("{:?}", summary.metadata_indexes);
    };
    let metadata = ::mcap::read::metadata(&bytes, index).unwrap();
    let expected = [
        ("rig", "none"),
        ("seed", "18446744073709551615"),
        ("version", env!("CARGO_PKG_VERSION")),
    ];
    assert_eq!(metadata.name, "hil-sim");
    assert!(
        metadata
            .metadata
            .iter()
            .map(|(key, value)| (key.as_str(), value.as_str()))
            .eq(expected)
    );
    let mut messages = 0_u64;
    for message in ::mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().expect("a schema");
        assert_eq!(
            (&*schema.encoding, &*message.channel.message_encoding),
            ("jsonschema", "json")
        );
        let schema: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
        let fields: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        for (name, value) in fields.as_object().unwrap() {
            let expected = if value.is_number() {
                "number"
            } else {
                "string"
            };
            let property = &schema["properties"][name];
            assert_eq!(property["type"], expected, "{name}");
            assert_eq!(property["unit"].is_string(), value.is_number(), "{name}");
            let description = property["description"].as_str().expect("a description");
            let unit = property["unit"].as_str().map(|unit| format!(" [{unit}]"));
            assert!(description.ends_with(&unit.unwrap_or_default()), "{name}");
            // The unit at the end of a name is the unit of the schema.
            for (ending, unit) in [("_pa", "Pa"), ("_n", "N"), ("_s", "s"), ("_m", "m")] {
                if name.ends_with(ending) {
                    assert_eq!(property["unit"], unit, "{name}");
                }
            }
        }
        let time = STARTED + Duration::from_millis(10) * messages as u32;
        assert_eq!(u128::from(message.log_time), time.as_nanos());
        messages += 1;
    }
    assert_eq!(messages, 120);
}

/// The format's own reader in Python: times, metadata, units.
const READ_IN_PYTHON: &str = r#"
import json, sys
from mcap.reader import make_reader
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file)
    [metadata] = reader.iter_metadata()
    assert metadata.name == "hil-sim" and metadata.metadata["rig"] == "none", metadata
    rows = []
    for schema, channel, message in reader.iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        units = json.loads(schema.data)["properties"]
        assert units["pressure_ref_pa"]["unit"] == "Pa"
        rows.append((message.log_time, json.loads(message.data)["time_s"]))
assert rows == sorted(rows)
print(len(rows), rows[0][0], rows[-1][0])
"#;

#[test]
#[ignore = "needs Python's package `mcap`"]
fn python_reads_the_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    record_wandering(&mut client(DeviceBoard::new(3)), 120, &path);
    let output = std::process::Command::new("python3")
        .args(["-c", READ_IN_PYTHON])
        .arg(path.with_extension("mcap"))
        .output()
        .expect("python3 runs");
    let error = String::from_utf8_lossy(&output.stderr);
    let first = STARTED.as_nanos();
    let last = (STARTED + Duration::from_millis(1190)).as_nanos();
    let printed = String::from_utf8_lossy(&output.stdout);
    assert_eq!(printed, format!("120 {first} {last}\n"), "{error}");
}

/// Each panel of the layout is placed once, and shows columns that a record has, with one unit a
/// plot.
#[test]
fn the_layout_shows_columns_of_the_record() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    record_wandering(&mut client(DeviceBoard::new(3)), 5, &path);
    let text = std::fs::read_to_string(path.with_extension("layout.json")).unwrap();
    let layout: serde_json::Value = serde_json::from_str(&text).unwrap();
    let (mut placed, mut open) = (Vec::new(), vec![&layout["layout"]]);
    while let Some(node) = open.pop() {
        match node.as_str() {
            Some(name) => placed.push(name),
            None => open.extend([&node["first"], &node["second"]]),
        }
    }
    placed.sort_unstable();
    let panels = layout["configById"].as_object().unwrap();
    assert!(panels.keys().eq(placed), "{text}");
    let header = std::fs::read_to_string(&path).unwrap();
    let header: Vec<&str> = header.lines().next().unwrap().split(',').collect();
    for (name, panel) in panels {
        let mut units = std::collections::HashSet::new();
        for shown in panel["paths"].as_array().unwrap() {
            let column = shown["value"]
                .as_str()
                .unwrap()
                .strip_prefix("/assist.")
                .unwrap();
            assert!(header.contains(&column), "{name}: {column}");
            if name.starts_with("Plot") {
                units.insert(column.rsplit_once('_').map_or("", |(_, unit)| unit));
            }
        }
        assert!(units.len() <= 1, "{name}: {units:?}");
    }
}

/// A record that is truncated in its last block is read up to that block.
#[test]
fn a_truncated_mcap_file_is_read_up_to_its_last_complete_block() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.csv");
    record_wandering(&mut client(DeviceBoard::new(3)), 500, &path);
    let mcap_path = path.with_extension("mcap");
    let bytes = std::fs::read(&mcap_path).unwrap();
    let mut rows_before = 0;
    for share in 2..10 {
        std::fs::write(&mcap_path, &bytes[..bytes.len() * share / 10]).unwrap();
        let rows = mcap::read(&mcap_path).unwrap().time_s().len();
        assert!(rows >= rows_before, "{rows}");
        rows_before = rows;
        // Only the truncated block of 50 rows is lost.
        assert!(rows + 50 >= 500 * share / 10, "{rows} of {share} tenths");
    }
}

#[test]
fn settings_are_stored_only_if_allowed() {
    let rig = Rig::reference();
    let mut client = client(DeviceBoard::new(1));
    let other = SettingsValues {
        gain: 12.5,
        ..SettingsValues::reference()
    };
    client.write_settings(&other).unwrap();
    assert_eq!(client.settings().unwrap(), other);
    let refused = board_settings::ensure_from_rig(&mut client, &rig, "COM7", false).unwrap_err();
    assert!(
        refused.to_string().starts_with("COM7: expected"),
        "{refused}"
    );
    let settled = board_settings::ensure_from_rig(&mut client, &rig, "COM7", true).unwrap();
    assert_eq!(client.settings().unwrap(), *settled.values());
    let invalid = SettingsValues {
        gain: -1.0,
        ..other
    };
    assert!(matches!(
        client.write_settings(&invalid),
        Err(LinkError::NotStored(_))
    ));
}

#[test]
fn settings_of_the_safety_block_wait_for_the_button() {
    let faster = SettingsValues {
        reference_speed_m_per_s_max: 1.0,
        ..SettingsValues::reference()
    };
    let mut tuned = SettingsValues::reference();
    tuned.compensation.friction_n = 1.0;
    let mut board = DeviceBoard::new(1);
    board.hand = None;
    let mut client = client(board).with_person("A. Person", |_| {});
    let refused = client.write_settings(&faster);
    assert!(
        matches!(refused, Err(LinkError::NotConfirmed)),
        "{refused:?}"
    );
    assert_eq!(client.settings().unwrap(), SettingsValues::reference());
    // Others need nobody at the board.
    client.write_settings(&tuned).unwrap();
    let change = client.change(0).unwrap().unwrap();
    assert_eq!(change.values, tuned);
    assert!(!change.signature.is_confirmed && change.signature.utc_s > 1_700_000_000);
    let said = settings_file::changed(&change, Some(&SettingsValues::reference()));
    assert!(said.contains("by A. Person, 20"), "{said}");
    assert!(said.contains("compensation.friction_n: 0 → 1\n"), "{said}");
    assert_eq!(client.change(1).unwrap(), None);
}

#[test]
fn held_button_stores_them_and_signs() {
    let faster = SettingsValues {
        reference_speed_m_per_s_max: 1.0,
        ..SettingsValues::reference()
    };
    let mut client = client(DeviceBoard::new(1));
    client.write_settings(&faster).unwrap();
    assert_eq!(client.settings().unwrap(), faster);
    assert_eq!(client.identity().unwrap().safety_hash, safety_hash(&faster));
    assert!(client.change(0).unwrap().unwrap().signature.is_confirmed);
}

#[test]
fn an_armed_board_is_not_changed() {
    let mut client = client(DeviceBoard::new(1));
    for _ in 0..70 {
        client.next(Duration::from_millis(20)).unwrap();
    }
    let assist = Command::Request(Request::Assist);
    client.send(&ToDevice::Command(assist)).unwrap();
    client.next(Duration::from_millis(20)).unwrap();
    assert!(matches!(client.restart_in_loop(), Err(LinkError::Armed(_))));
    let other = SettingsValues {
        gain: 12.5,
        ..SettingsValues::reference()
    };
    let stored = client.write_settings(&other);
    assert!(matches!(stored, Err(LinkError::NotStored(Written::Armed))));
}

#[test]
fn a_line_without_telemetry_is_given_up() {
    let mut board = DeviceBoard::new(1);
    board.events.push_back((20, Event::Unplugged(u32::MAX / 2)));
    let mut client = client(board);
    client.restart_in_loop().unwrap();
    let rest = Output::default();
    let error = (0..100).find_map(|tick| client.exchange(&wander(tick, &rest)).err());
    assert!(matches!(error, Some(LinkError::NoAnswer(_))), "{error:?}");
}

/// Telemetry of a board that reads its pins, as `record` writes it, with gaps and a reset.
#[test]
fn a_recorded_rig_is_replayed_from_each_known_start() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.csv");
    let mut board = DeviceBoard::new(5);
    board.faults.echoed = 6_000;
    board
        .events
        .extend([(300, Event::Unplugged(20)), (500, Event::Reset)]);
    let mut client = client(board);
    let mut recorder = Recorder::create(&path, &Origin::default()).unwrap();
    let mut timeline = Timeline::new(reference(), Some(client.restart_in_loop().unwrap()));
    client.send(&ToDevice::Command(Command::LeaveHil)).unwrap();
    let mut told: Vec<Telemetry> = Vec::new();
    while told.len() < 700 {
        match client.next(Duration::from_millis(20)).unwrap() {
            Some(FromDevice::Telemetry(telemetry)) => told.push(telemetry),
            _ => continue,
        }
        if let Some(row) = timeline.row(&told[told.len() - 1], 0.0) {
            recorder.push(&row).unwrap();
        }
    }
    recorder.finish().unwrap();
    let record = Record::read(&path).unwrap();
    let result = replay(&Inputs::new(&record).unwrap(), &mut OnPc::default(), |_| {}).unwrap();
    assert_eq!((result.starts, result.differing_ticks), (2, 0));
    // Replayed up to the gap, and from the reset on.
    let ticks: Vec<u32> = told.iter().map(|told| told.tick).collect();
    let place = |is_break: fn(&[u32]) -> bool| ticks.windows(2).position(is_break);
    let gap = place(|pair| pair[1] > pair[0] + 1).expect("the plug was pulled");
    let reset = place(|pair| pair[1] < pair[0]).expect("the board was reset");
    assert_eq!(result.ticks - result.compared_ticks, reset - gap);
}

/// A line that damages bytes, a plug that is pulled, a board that is reset.
fn bad_board() -> impl Strategy<Value = DeviceBoard> {
    let rate = 0..500_u16;
    let faults = (rate.clone(), rate.clone(), rate.clone(), rate, 0..3_000_u16);
    let event = prop_oneof![(1..120_u32).prop_map(Event::Unplugged), Just(Event::Reset)];
    let events = prop::collection::vec((20..400_u32, event), 0..3);
    (any::<u64>(), faults, events).prop_map(|(seed, faults, mut events)| {
        let mut board = DeviceBoard::new(seed);
        let (lost, flipped, repeated, exchanged, echoed) = faults;
        board.faults = Faults {
            lost,
            flipped,
            repeated,
            exchanged,
            echoed,
        };
        events.sort_by_key(|(at, _)| *at);
        board.events = events.into();
        board
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever the line does: each sensors message is read once, in order, its output is the one
    /// that is reported, and where the controller has restarted this is known. So a controller
    /// here that is told the same decides the same.
    #[test]
    fn a_faulty_line_causes_no_wrong_state(board in bad_board()) {
        let mut client = client(board);
        client.restart_in_loop().unwrap();
        let mut here = Controller::new(reference());
        let mut before = Output::default();
        for tick in 0..400 {
            if tick == 200 {
                client.restart_in_loop().unwrap();
                here = Controller::new(reference());
                before = Output::default();
            }
            let sensors: Sensors = wander(tick + 60, &before);
            let answer = client.exchange(&sensors).unwrap();
            before = answer.output;
            if answer.restarted {
                here = Controller::new(reference());
            }
            prop_assert_eq!(answer.output, here.tick(&sensors), "tick {}", tick);
            if let Some(told) = answer.telemetry {
                prop_assert_eq!(told.sensors, sensors);
            }
        }
    }
}

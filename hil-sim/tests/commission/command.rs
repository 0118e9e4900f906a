//! The command at a pseudo terminal: a board in memory behind it, a person at stdin and stderr.

use super::device::InMemory;
use super::world::{Wiring, World};
use hil_sim::bench::port::client::Transport;
use hil_sim::bench::settings_file;
use hil_sim::rig::Rig;
use model_core::settings::SettingsValues;
use serialport::{SerialPort, TTYPort};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const TICK: Duration = Duration::from_millis(10);

/// How long a program that answers nothing is waited for.
const IDLE: Duration = Duration::from_millis(1);
/// The same while it plays, when it answers each tick, on a machine that does other things, too.
const ANSWER: Duration = Duration::from_millis(50);

/// Runs `board` at `port`: a tick passes once the program has read what it was sent before, and has
/// sent what is played next.
fn serve(mut board: InMemory, mut port: TTYPort, mut program_end: TTYPort, end: &AtomicBool) {
    let (mut heard, mut told) = ([0; 256], Vec::new());
    while !end.load(Ordering::Relaxed) {
        let wait = if board.playing { ANSWER } else { IDLE };
        port.set_timeout(wait).expect("a timeout");
        let count = port.read(&mut heard).unwrap_or(0);
        board.send(&heard[..count]).expect("a board in memory");
        if program_end.read(&mut []).is_ok() {
            continue;
        }
        board.receive(&mut told, TICK).expect("a board in memory");
        port.write_all(&told).expect("the port takes the bytes");
        told.clear();
    }
}

/// How the command has ended.
struct Ended {
    status: i32,
    /// Its stdout.
    json: serde_json::Value,
    /// Its stderr.
    told: String,
    /// Settings on the board.
    stored: SettingsValues,
}

/// The command with a person who answers so many questions.
fn commission(folder: &Path, wiring: Wiring, patience: usize, args: &[&str]) -> Ended {
    let world = Arc::new(Mutex::new(World::new(wiring)));
    let board = InMemory::new(Arc::clone(&world), SettingsValues::reference());
    let log = board.log();
    let (port, mut program_end) = TTYPort::pair().expect("a pseudo terminal");
    program_end.set_timeout(Duration::ZERO).expect("a timeout");
    let name = program_end.name().expect("a name");
    let end = Arc::new(AtomicBool::new(false));
    let ends = Arc::clone(&end);
    let thread = std::thread::spawn(move || serve(board, port, program_end, &ends));
    let mut child = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(["commission", "--json", "--port", &name])
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut answers = Some(child.stdin.take().expect("its stdin"));
    let questions = BufReader::new(child.stderr.take().expect("its stderr"));
    let (mut told, mut asked) = (String::new(), 0);
    for line in questions.lines().map_while(Result::ok) {
        told += &format!("{line}\n");
        let name = line.strip_prefix('[').and_then(|line| line.split_once(']'));
        if let Some((name, _)) = name {
            asked += 1;
            answers = answers.filter(|_| asked <= patience);
            let answer = world.lock().expect("the world").act(name);
            if let Some(answers) = &mut answers {
                writeln!(answers, "# {name}\n{answer}").expect("the program reads");
            }
        }
    }
    let output = child.wait_with_output().expect("the program ends");
    end.store(true, Ordering::Relaxed);
    thread.join().expect("the board");
    let stored = log.lock().expect("the log").settings;
    Ended {
        status: output.status.code().expect("a status"),
        json: serde_json::from_slice(&output.stdout).unwrap_or_default(),
        told,
        stored,
    }
}

#[test]
fn the_command_writes_settings_rig_and_report_at_its_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let args = ["--out", "done"];
    let ended = commission(folder.path(), Wiring::Right, usize::MAX, &args);
    let (status, stored) = (ended.status, ended.stored);
    assert_eq!(
        (status, &ended.json["complete"]),
        (0, &true.into()),
        "{}",
        ended.told
    );
    let out = folder.path().join("done");
    let settings = settings_file::read(&out.join("settings.toml")).expect("settings");
    assert_eq!(*settings.values(), stored);
    assert_ne!(stored, SettingsValues::reference());
    let mut rig = Rig::read(&out.join("rig.toml")).expect("a rig");
    let static_n = *rig.value_mut("load", "static_friction_n").expect("the key");
    let sigma = |key: &str| {
        let mut tolerances = rig.tolerances.iter();
        tolerances
            .find(|own| own.key == key)
            .map(|own| own.relative_sigma)
    };
    // By the gauge, as the pressure did not reach the supply; by scatter or at least 10 %.
    assert_eq!(sigma("supply_pressure_pa"), Some(0.016));
    let static_sigma = sigma("static_friction_n").expect("a tolerance");
    assert!((0.1..0.2).contains(&static_sigma), "{static_sigma}");
    // A program that is late plays another signal.
    let off = static_n / 7.0 - 1.0;
    assert!(off.abs() < 2.0 * static_sigma, "{static_n}");
    let report = std::fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(report.contains("friction: slow triangles"));
}

#[test]
fn an_early_end_writes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let ended = commission(folder.path(), Wiring::LoadLight, usize::MAX, &[]);
    let (status, json, stored) = (ended.status, ended.json, ended.stored);
    assert_eq!((status, &json["complete"]), (1, &false.into()));
    let last = json["steps"]
        .as_array()
        .and_then(|steps| steps.last())
        .expect("steps");
    assert_eq!(last["step"], "lift");
    assert_eq!(
        last["probably_wrong"][0],
        "the mass: lighter than entered; or a stronger muscle"
    );
    assert_eq!(stored, SettingsValues::reference());
    assert_eq!(
        std::fs::read_dir(folder.path())
            .expect("the folder")
            .count(),
        0
    );
}

#[test]
fn answers_that_end_are_bad_input() {
    let folder = tempfile::tempdir().expect("a folder");
    let ended = commission(folder.path(), Wiring::Right, 3, &[]);
    assert_eq!(ended.status, 2);
    let last = ended.told.lines().last();
    let expected = "hil-sim: stdin: expected an answer to [lamp], found the end";
    assert_eq!(last, Some(expected));
    assert_eq!(ended.stored, SettingsValues::reference());
}

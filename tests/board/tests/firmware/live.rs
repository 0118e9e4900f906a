//! The program against the image in real time: a pseudo terminal with the emulated board behind it,
//! whose clock is the machine's.
//!
//! `HIL_SIM` names the program `hil-sim`.

use crate::commission::Emulated;
use crate::commission::world::{Wiring, World};
use hil_sim::bench::port::client::Transport;
use hil_sim::bench::settings_file;
use model_core::settings::SettingsValues;
use serialport::{SerialPort, TTYPort};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// BOR_LEV of a new chip.
const NO_BROWN_OUT_RESET: u8 = 3;
/// Longest time that the board runs before it looks at its port again.
const STEP: Duration = Duration::from_millis(2);

/// How the board kept up with the clock.
struct Pace {
    /// Furthest that the board was behind the clock.
    behind: Duration,
    /// Time that the emulation took, of the time that passed.
    busy: Duration,
    passed: Duration,
}

/// Runs the board at the end of `port` until `end`.
fn serve(mut board: Emulated, mut port: TTYPort, end: &AtomicBool) -> Pace {
    let mut pace = Pace {
        behind: Duration::ZERO,
        busy: Duration::ZERO,
        passed: Duration::ZERO,
    };
    let (mut heard, mut told) = ([0; 256], Vec::new());
    let start = Instant::now();
    while !end.load(Ordering::Relaxed) {
        // Waits for a millisecond if nothing arrives.
        let count = port.read(&mut heard).unwrap_or(0);
        board.send(&heard[..count]).expect("an emulated board");
        let due = start.elapsed();
        pace.behind = pace.behind.max(due.saturating_sub(pace.passed));
        while pace.passed < due {
            let wait = STEP.min(due - pace.passed);
            let passed = board.receive(&mut told, wait);
            pace.passed += passed.expect("an emulated board");
            // Nobody may be listening: what does not fit is lost, as at a real port.
            let _ = port.write_all(&told);
            told.clear();
        }
        pace.busy += start.elapsed() - due;
    }
    board.wired.assert_no_errors();
    pace
}

/// The program with these words, in this folder.
fn program_at(folder: &Path, words: &str) -> Command {
    let program = std::env::var_os("HIL_SIM").expect("HIL_SIM: the path of hil-sim");
    let mut command = Command::new(program);
    command.current_dir(folder).args(words.split(' '));
    command
}

/// A board at a pseudo terminal.
struct Live {
    name: String,
    world: Arc<Mutex<World>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<Pace>>,
    /// Keeps the terminal open between two programs.
    _program_end: TTYPort,
}

impl Live {
    fn new(brown_out_level: u8) -> Live {
        let (mut port, program_end) = TTYPort::pair().expect("a pseudo terminal");
        port.set_timeout(Duration::from_millis(1))
            .expect("a timeout");
        let name = program_end.name().expect("a name");
        let world = Arc::new(Mutex::new(World::new(Wiring::Right)));
        let end = Arc::new(AtomicBool::new(false));
        let (its_world, its_end) = (Arc::clone(&world), Arc::clone(&end));
        let thread = std::thread::spawn(move || {
            let mut board = Emulated::new(its_world);
            board.wired.board.set_brown_out_level(brown_out_level);
            serve(board, port, &its_end)
        });
        Live {
            name,
            world,
            end,
            thread: Some(thread),
            _program_end: program_end,
        }
    }

    /// The program with these words, at this board.
    fn command(&self, folder: &Path, words: &str) -> Command {
        let mut command = program_at(folder, words);
        command.args(["--port", &self.name]);
        command
    }

    /// What the program prints.
    fn run(&self, folder: &Path, words: &str) -> Vec<u8> {
        let output = self.command(folder, words).output();
        let output = output.expect("the program runs");
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{words}: {message}");
        output.stdout
    }

    fn json(&self, folder: &Path, words: &str) -> serde_json::Value {
        let printed = self.run(folder, &format!("{words} --json"));
        serde_json::from_slice(&printed).expect("JSON")
    }

    /// Ends the board; how it kept up with the clock.
    fn stop(mut self) -> Pace {
        self.end.store(true, Ordering::Relaxed);
        let thread = self.thread.take().expect("a board");
        thread.join().expect("a board without errors")
    }

    /// Ends the board, which must have kept up with the clock.
    fn end(self) {
        let pace = self.stop();
        let share = pace.passed.as_secs_f64() / pace.busy.as_secs_f64();
        println!(
            "{:.0} s in real time, {share:.0} times faster if not held back, up to {:.1} ms behind",
            pace.passed.as_secs_f64(),
            pace.behind.as_secs_f64() * 1e3
        );
        assert!(share > 1.0);
    }
}

#[test]
#[ignore = "needs FIRMWARE and HIL_SIM"]
fn settings_records_and_experiments_work_at_a_port_in_real_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let live = Live::new(0);
    live.run(path, "settings --out board.toml");
    let settings = settings_file::read(&path.join("board.toml")).expect("settings");
    assert_eq!(*settings.values(), SettingsValues::reference());

    let record = live.json(path, "record --from-start --duration 4 --out bench.csv");
    let ticks = record["ticks"].as_u64();
    assert!(ticks >= Some(399), "{record}");
    let replay = &live.json(path, "replay bench.csv")["replay"];
    assert_eq!(replay["compared_ticks"].as_u64(), ticks);
    assert_eq!(replay["differing_ticks"], 0, "{replay}");

    let hil = live.json(path, "hil --duration 4 --out hil");
    for run in hil["runs"].as_array().expect("runs") {
        assert_eq!(run["differing_ticks"], 0, "{run}");
        for count in ["missed_ticks", "restarts"] {
            assert_eq!(run["board"][count], 0, "{run}");
        }
        assert_eq!(run["board"]["ticks"], 400, "{run}");
    }
    live.end();
}

/// What the program prints at this board, and the questions that it has asked: the person in front
/// of the world answers.
fn answered(live: &Live, folder: &Path, words: &str) -> (serde_json::Value, Vec<String>) {
    let mut child = live
        .command(folder, words)
        .arg("--json")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut answers = child.stdin.take().expect("its stdin");
    let questions = BufReader::new(child.stderr.take().expect("its stderr"));
    let (mut told, mut asked) = (String::new(), Vec::new());
    for line in questions.lines().map_while(Result::ok) {
        told += &format!("{line}\n");
        let name = line.strip_prefix('[').and_then(|line| line.split_once(']'));
        if let Some((name, _)) = name {
            let answer = live.world.lock().expect("the world").act(name);
            writeln!(answers, "{answer}").expect("the program reads");
            asked.push(name.to_owned());
        }
    }
    let output = child.wait_with_output().expect("the program ends");
    assert!(output.status.success(), "{words}: {told}");
    let summary = serde_json::from_slice(&output.stdout).expect("JSON");
    (summary, asked)
}

/// The texts between backticks.
fn quoted(text: &str) -> Vec<String> {
    text.split('`').skip(1).step_by(2).map(Into::into).collect()
}

/// Every command of docs/commissioning.md in turn, as it stands there, at a board with a new chip
/// and the right rig; the questions are those of its table, in its order.
#[test]
#[ignore = "needs FIRMWARE and HIL_SIM"]
fn the_page_from_a_bare_board_to_the_first_lift_holds() {
    let page = include_str!("../../../../docs/commissioning.md");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let mut live = None;
    let mut asked = Vec::new();
    let mut done = Vec::new();
    let commands = page.lines().filter_map(|line| line.strip_prefix("    "));
    for command in commands {
        let at_port = command.replace(" --port /dev/ttyACM0", "");
        let (program, words) = at_port.split_once(' ').expect("a command");
        let name = words.split(' ').next().expect("a word");
        done.push(format!("{program} {name}"));
        let board = || live.as_ref().expect("a flashed board");
        match (program, name) {
            // HIL_SIM and FIRMWARE are built.
            ("eval", _) | ("cargo", "install") => {}
            ("cargo", "firmware-flash") => live = Some(Live::new(NO_BROWN_OUT_RESET)),
            ("STM32_Programmer_CLI", _) => {
                let (_, level) = words.split_once("BOR_LEV=").expect("the option");
                // Too short to be judged by its pace.
                live.take().expect("a flashed board").stop();
                live = Some(Live::new(level.parse().expect("a level")));
            }
            ("hil-sim", "settings") => {
                let output = board().command(path, words).output().expect("it runs");
                let told = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{command}: {told}");
                let is_new = !done.iter().any(|command| command.starts_with("STM32"));
                assert_eq!(told.contains("BrownOut"), is_new, "{told}");
            }
            ("hil-sim", "commission") => {
                let (summary, questions) = answered(board(), path, words);
                assert_eq!(summary["complete"], true, "{summary}");
                if !words.contains("--check") {
                    asked = questions;
                    // At the end of each step.
                    asked.retain(|name| name != "next");
                }
            }
            ("hil-sim", "record") => {
                let ticks = board().json(path, words)["ticks"].as_u64();
                assert!(ticks >= Some(999), "{ticks:?}");
            }
            ("hil-sim", _) => {
                let output = program_at(path, &format!("{words} --json")).output();
                let output = output.expect("it runs");
                let told = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{command}: {told}");
                if name == "replay" {
                    let result: serde_json::Value =
                        serde_json::from_slice(&output.stdout).expect("JSON");
                    assert_eq!(result["replay"]["differing_ticks"], 0, "{result}");
                }
            }
            _ => panic!("a command that no test runs: {command}"),
        }
    }
    live.expect("a flashed board").end();
    assert_eq!(done.len(), 11, "{done:?}");
    let read = |file: &str| std::fs::read_to_string(path.join(file)).expect("settings");
    assert_eq!(read("stored.toml"), read("commissioned/settings.toml"));
    assert_ne!(read("stored.toml"), read("before.toml"));

    let rows = page.lines().filter_map(|line| {
        let step = line
            .strip_prefix("| ")?
            .starts_with(|c: char| c.is_ascii_digit());
        step.then(|| line.rsplit('|').nth(1).expect("a last column"))
    });
    let mut listed: Vec<_> = rows.flat_map(quoted).collect();
    listed.push("write".into());
    assert_eq!(asked, listed);
}

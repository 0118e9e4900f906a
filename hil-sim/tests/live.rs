//! The commands against a board at a serial port: a pseudo terminal with a board in memory behind
//! it.
#![cfg(unix)]

mod board;

use board::{DeviceBoard, TICK};
use hil_sim::bench::port::client::Transport;
use hil_sim::bench::replay::{Inputs, OnPc, replay};
use hil_sim::record::Record;
use hil_sim::record::mcap;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Timeout against hanging; no test needs a significant part of it.
const HANGING: Duration = Duration::from_secs(300);

/// Time on the board's clock for which the plug is out: longer than the half second after
/// which the board ends hardware in the loop.
const UNPLUGGED_TICKS: u32 = 80;

/// A board in memory behind a pseudo terminal, whose symbolic link in the file system plays the
/// port's name.
///
/// The board's clock is not the machine's: a tick passes once the program has read what it was sent
/// in the tick before, so that a busy machine makes a test slower but changes nothing in it.
struct Plugged {
    path: PathBuf,
    signals: Arc<Signals>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Signals {
    /// Ticks of the board.
    ticks: AtomicU32,
    end: AtomicBool,
}

/// Held while a child could inherit a pseudo terminal, and so keep it plugged.
static FORKING: Mutex<()> = Mutex::new(());

/// A new pseudo terminal under the name `path`: the board's end, and a copy of the program's end
/// that tells how much the program has not read yet.
fn plug(path: &Path) -> (TTYPort, TTYPort) {
    let forking = FORKING.lock();
    let (board_end, program_end) = TTYPort::pair().expect("a pseudo terminal");
    let name = program_end.name().unwrap();
    // The copies are closed in children.
    let [mut board_end, mut program_end] =
        [board_end, program_end].map(|end| end.try_clone_native().unwrap());
    drop(forking);
    board_end.set_timeout(Duration::from_millis(1)).unwrap();
    program_end.set_timeout(Duration::ZERO).unwrap();
    let _ = std::fs::remove_file(path);
    std::os::unix::fs::symlink(name, path).unwrap();
    (board_end, program_end)
}

/// The program has not read all that it was sent. Counting the bytes would not do: only a poll,
/// with which this read of nothing begins, waits for those that the kernel has not passed on yet.
fn has_unread(program_end: &mut TTYPort) -> bool {
    program_end.read(&mut []).is_ok()
}

/// Runs the board; the plug is pulled at the tick `unplugged_at`.
fn serve(path: &Path, signals: &Signals, unplugged_at: Option<u32>) {
    let mut board = DeviceBoard::new(1);
    let (mut port, mut program_end) = plug(path);
    let (mut heard, mut told) = ([0; 256], Vec::new());
    while !signals.end.load(Ordering::Relaxed) {
        let count = port.read(&mut heard).unwrap_or(0);
        board.send(&heard[..count]).unwrap();
        if has_unread(&mut program_end) {
            continue;
        }
        if unplugged_at == Some(board.ticks()) {
            let _ = std::fs::remove_file(path);
            drop((port, program_end));
            while board.ticks() < unplugged_at.unwrap_or(0) + UNPLUGGED_TICKS {
                board.receive(&mut told, TICK).unwrap();
            }
            told.clear();
            (port, program_end) = plug(path);
        }
        board.receive(&mut told, TICK).unwrap();
        port.write_all(&told).unwrap();
        told.clear();
        signals.ticks.store(board.ticks(), Ordering::Relaxed);
    }
}

impl Plugged {
    fn new(folder: &Path) -> Plugged {
        Plugged::pulled_at(folder, None)
    }

    /// A board whose plug is pulled at a tick of its clock, and inserted again 80 ticks later.
    fn pulled_at(folder: &Path, tick: Option<u32>) -> Plugged {
        let path = folder.join("tty");
        let signals = Arc::<Signals>::default();
        let for_thread = (path.clone(), Arc::clone(&signals));
        let thread = std::thread::spawn(move || serve(&for_thread.0, &for_thread.1, tick));
        wait_until("the port is there", || path.exists());
        Plugged {
            path,
            signals,
            thread: Some(thread),
        }
    }

    fn name(&self) -> &str {
        self.path.to_str().unwrap()
    }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        self.signals.end.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || matches!(ended, Some(Ok(()))));
    }
}

fn wait_until(event: &str, mut has_come: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !has_come() {
        assert!(begin.elapsed() < HANGING, "waited in vain until {event}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Waits until the file has so many lines.
fn wait_for_lines(file: &Path, lines: usize) {
    wait_until(&format!("{} has {lines} lines", file.display()), || {
        let bytes = std::fs::read(file).unwrap_or_default();
        bytes.iter().filter(|byte| **byte == b'\n').count() >= lines
    });
}

fn start(folder: &Path, args: &[&str]) -> Child {
    let _forking = FORKING.lock();
    Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts")
}

/// As Ctrl-C does.
fn interrupt(child: &Child) {
    let kill = format!("kill -INT {}", child.id());
    let status = Command::new("sh").args(["-c", &kill]).status();
    assert!(status.expect("a shell").success());
}

fn succeeded(output: Output) -> (serde_json::Value, String) {
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{message}");
    (
        serde_json::from_slice(&output.stdout).expect("JSON"),
        message,
    )
}

#[test]
fn a_recorder_that_is_killed_leaves_readable_files() {
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::new(folder.path());
    let args = [
        "record",
        "--port",
        board.name(),
        "--out",
        "rec.csv",
        "--from-start",
    ];
    let mut recorder = start(folder.path(), &args);
    wait_for_lines(&folder.path().join("rec.csv"), 200);
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let told = f64::from(board.signals.ticks.load(Ordering::Relaxed));
    let csv = Record::read(&folder.path().join("rec.csv")).unwrap();
    let mcap = mcap::read(&folder.path().join("rec.mcap")).unwrap();
    for record in [csv, mcap] {
        let ticks = record.time_s().len();
        // At most two half seconds are lost: the one being written, and the one being collected.
        let last = *record.column("tick").unwrap().last().unwrap();
        assert!(told - last <= 100.0, "{last} of {told}");
        let result = replay(&Inputs::new(&record).unwrap(), &mut OnPc::default(), |_| {}).unwrap();
        assert_eq!(
            (result.compared_ticks, result.differing_ticks),
            (ticks, 0),
            "{result:?}"
        );
    }
}

#[test]
fn a_recorder_counts_the_ticks_it_lost_while_the_plug_was_out() {
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::pulled_at(folder.path(), Some(120));
    let args = [
        "record",
        "--port",
        board.name(),
        "--out",
        "rec.csv",
        "--json",
    ];
    let recorder = start(folder.path(), &args);
    // More than the board has sent before the plug is pulled.
    wait_for_lines(&folder.path().join("rec.csv"), 200);
    interrupt(&recorder);
    let (summary, message) = succeeded(recorder.wait_with_output().unwrap());
    assert!(
        message.contains("has gone") && message.contains("is back"),
        "{message}"
    );
    let record = Record::read(&folder.path().join("rec.csv")).unwrap();
    let times_s = record.time_s();
    assert_eq!(summary["ticks"], times_s.len());
    let lost = summary["link"]["telemetry_lost"].as_u64().unwrap();
    assert!(lost >= UNPLUGGED_TICKS.into(), "{lost}");
    let spanned_s = times_s[times_s.len() - 1] - times_s[0];
    let told = times_s.len() as u64 + lost;
    assert_eq!((spanned_s / 0.01).round() as u64 + 1, told);
    let gaps = times_s.windows(2).filter(|pair| pair[1] - pair[0] > 0.5);
    assert_eq!(gaps.count(), 1);
}

#[test]
fn hardware_in_the_loop_restarts_once_after_the_plug_was_out() {
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::pulled_at(folder.path(), Some(150));
    std::fs::write(
        folder.path().join("rig.toml"),
        include_str!("../src/rig/reference_rig.toml"),
    )
    .unwrap();
    let args = [
        "hil",
        "--port",
        board.name(),
        "--rig",
        "rig.toml",
        "--duration",
        "3",
        "--json",
    ];
    let experiment = start(folder.path(), &args);
    let (summary, _) = succeeded(experiment.wait_with_output().unwrap());
    let run = &summary["runs"][0];
    assert_eq!(
        (&run["board"]["ticks"], &run["board"]["restarts"]),
        (&300.into(), &1.into())
    );
    assert_eq!(
        (&run["differing_ticks"], &run["stopped"]),
        (&0.into(), &false.into())
    );
    let args = ["replay", "out/assist.csv", "--port", board.name(), "--json"];
    let (summary, _) = succeeded(start(folder.path(), &args).wait_with_output().unwrap());
    assert_eq!(summary["replay"]["compared_ticks"], 300);
    assert_eq!(summary["replay"]["differing_ticks"], 0);
}

/// The board in memory has no muscle: its pressure stays constant, as that of this test signal may.
#[test]
fn a_test_signal_is_played_if_the_board_permits_it() {
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::new(folder.path());
    let drive = "time_s,pressure_ref_pa\n0,0\n0.5,20000\n1,10000\n1.5,0\n";
    std::fs::write(folder.path().join("exp.csv"), drive).unwrap();
    let play = |out: &str, more: &[&str]| {
        let args = [
            "record",
            "--port",
            board.name(),
            "--out",
            out,
            "--play",
            "exp.csv",
        ];
        let args = [&args[..], &["--from-start", "--json"], more].concat();
        start(folder.path(), &args).wait_with_output().unwrap()
    };
    let refused = play("no.csv", &[]);
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(
        message.contains("play_pressure_pa_max is at least 20000, found 0"),
        "{message}"
    );
    assert!(!folder.path().join("no.csv").exists());

    let (summary, _) = succeeded(play("rec.csv", &["--write-settings"]));
    assert_eq!(summary["played"], "played to its end");
    let record = Record::read(&folder.path().join("rec.csv")).unwrap();
    let modes = record.text("mode").unwrap();
    let played = modes.iter().filter(|mode| *mode == "Playing").count();
    // All rows, and the ticks until the request to vent is received.
    assert!((151..=160).contains(&played), "{played} of 151 ticks");
    let reference_pa = record.column("pressure_ref_pa").unwrap();
    let most_pa = reference_pa.iter().copied().fold(0.0, f64::max);
    assert!(
        (most_pa - 2e4).abs() < 123.0,
        "to a count of the DAC: {most_pa}"
    );
    assert_eq!(modes.last().map(String::as_str), Some("Venting"));
    let result = replay(&Inputs::new(&record).unwrap(), &mut OnPc::default(), |_| {}).unwrap();
    assert_eq!(
        (result.compared_ticks, result.differing_ticks),
        (modes.len(), 0),
        "{result:?}"
    );
    // The previous setting is restored.
    assert_eq!(play("again.csv", &[]).status.code(), Some(2));
}

/// An interrupt while the test signal plays: the board vents, and no longer allows a test signal.
#[test]
fn an_interrupted_test_signal_leaves_the_board_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::new(folder.path());
    let drive = "time_s,pressure_ref_pa\n0,0\n0.5,20000\n9000,0\n";
    std::fs::write(folder.path().join("exp.csv"), drive).unwrap();
    let args = [
        "record",
        "--port",
        board.name(),
        "--out",
        "rec.csv",
        "--play",
        "exp.csv",
        "--write-settings",
        "--from-start",
        "--json",
    ];
    let mut recorder = start(folder.path(), &args);
    let record = folder.path().join("rec.csv");
    wait_until("the board plays", || {
        assert!(
            recorder.try_wait().unwrap().is_none(),
            "the recorder has ended"
        );
        std::fs::read_to_string(&record).is_ok_and(|text| text.contains("Playing"))
    });
    interrupt(&recorder);
    let (summary, message) = succeeded(recorder.wait_with_output().unwrap());
    assert_eq!(summary["played"], "interrupted");
    assert!(!message.contains("could not be restored"), "{message}");
    let args = ["settings", "--port", board.name(), "--json"];
    let (settings, _) = succeeded(start(folder.path(), &args).wait_with_output().unwrap());
    assert!(
        settings
            .to_string()
            .contains("\"play_pressure_pa_max\":0.0"),
        "{settings}"
    );
}

/// `--duration 0` ends before the first tick, whose timing is then unknown.
#[test]
fn a_board_that_was_not_heard_has_no_timing() {
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::new(folder.path());
    let args = [
        "record",
        "--port",
        board.name(),
        "--out",
        "rec.csv",
        "--duration",
        "0",
        "--json",
    ];
    let (summary, _) = succeeded(start(folder.path(), &args).wait_with_output().unwrap());
    assert_eq!(
        (&summary["ticks"], summary.get("timing")),
        (&0.into(), None)
    );
}

//! The commands against a board at a serial port: a pseudo terminal with a board in memory behind
//! it, in real time.
#![cfg(unix)]

mod board;

use board::DeviceBoard;
use hil_sim::bench::link::Port;
use hil_sim::bench::replay::{Inputs, OnPc, replay};
use hil_sim::record::Record;
use hil_sim::record::mcap;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A board at the end of a link in the file system, which plays the port's name.
struct Plugged {
    path: PathBuf,
    signals: Arc<Signals>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Signals {
    /// The command has spoken to the board.
    heard: AtomicBool,
    pull: AtomicBool,
    end: AtomicBool,
}

/// Held while a child could inherit a pseudo terminal, and so keep it plugged.
static FORKING: Mutex<()> = Mutex::new(());

/// A new pseudo terminal under the name `path`.
fn plug(path: &Path) -> TTYPort {
    let forking = FORKING.lock();
    let (inheritable, theirs) = TTYPort::pair().expect("a pseudo terminal");
    // The copy is closed in children.
    let mut ours = inheritable.try_clone_native().unwrap();
    let name = theirs.name().unwrap();
    drop((inheritable, theirs, forking));
    ours.set_timeout(Duration::from_millis(1)).unwrap();
    let _ = std::fs::remove_file(path);
    std::os::unix::fs::symlink(name, path).unwrap();
    ours
}

fn serve(path: &Path, signals: &Signals) {
    let mut board = DeviceBoard::new(1);
    let mut port = plug(path);
    let begin = Instant::now();
    let mut passed = Duration::ZERO;
    let (mut heard, mut told) = ([0; 256], Vec::new());
    while !signals.end.load(Ordering::Relaxed) {
        if signals.pull.swap(false, Ordering::Relaxed) {
            drop(port);
            let _ = std::fs::remove_file(path);
            // Longer than the board's patience.
            while begin.elapsed() < passed + Duration::from_millis(800) {
                std::thread::sleep(Duration::from_millis(5));
            }
            port = plug(path);
        }
        // Fails while nobody has opened the port.
        let count = port.read(&mut heard).unwrap_or(0);
        signals.heard.fetch_or(count > 0, Ordering::Relaxed);
        std::thread::sleep(Duration::from_micros(500));
        board.send(&heard[..count]).unwrap();
        while passed < begin.elapsed() {
            let step = Duration::from_millis(1);
            passed += board.receive(&mut told, step).unwrap();
        }
        let _ = port.write_all(&told);
        told.clear();
    }
}

impl Plugged {
    fn new(folder: &Path) -> Plugged {
        let path = folder.join("tty");
        let signals = Arc::<Signals>::default();
        let for_thread = (path.clone(), Arc::clone(&signals));
        let thread = std::thread::spawn(move || serve(&for_thread.0, &for_thread.1));
        while !path.exists() {
            std::thread::sleep(Duration::from_millis(1));
        }
        Plugged {
            path,
            signals,
            thread: Some(thread),
        }
    }

    fn name(&self) -> &str {
        self.path.to_str().unwrap()
    }

    /// Returns `seconds` after the command has begun to speak: its start takes what it takes.
    fn in_use_for(&self, seconds: f64) {
        let begin = Instant::now();
        while !self.signals.heard.load(Ordering::Relaxed) {
            assert!(begin.elapsed() < Duration::from_secs(60), "nobody speaks");
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_secs_f64(seconds));
    }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        self.signals.end.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || matches!(ended, Some(Ok(()))));
    }
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

fn succeeded(output: Output) -> (serde_json::Value, String) {
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{message}");
    (
        serde_json::from_slice(&output.stdout).expect("JSON"),
        message,
    )
}

/// The tests keep real time: each has the cores for itself.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
fn a_recorder_that_is_killed_leaves_readable_files() {
    let _alone = alone();
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
    board.in_use_for(2.5);
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let csv = Record::read(&folder.path().join("rec.csv")).unwrap();
    let mcap = mcap::read(&folder.path().join("rec.mcap")).unwrap();
    for record in [csv, mcap] {
        let ticks = record.time_s().len();
        assert!((100..=300).contains(&ticks), "{ticks} of about 250");
        let result = replay(&Inputs::new(&record).unwrap(), &mut OnPc::default(), |_| {}).unwrap();
        assert_eq!(
            (result.compared_ticks, result.differing_ticks),
            (ticks, 0),
            "{result:?}"
        );
    }
}

#[test]
fn the_plug_is_pulled_while_recording() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::new(folder.path());
    let args = [
        "record",
        "--port",
        board.name(),
        "--out",
        "rec.csv",
        "--duration",
        "3",
        "--json",
    ];
    let recorder = start(folder.path(), &args);
    board.in_use_for(1.2);
    board.signals.pull.store(true, Ordering::Relaxed);
    let (summary, message) = succeeded(recorder.wait_with_output().unwrap());
    assert!(
        message.contains("has gone") && message.contains("is back"),
        "{message}"
    );
    let record = Record::read(&folder.path().join("rec.csv")).unwrap();
    let times_s = record.time_s();
    assert_eq!(summary["ticks"], times_s.len());
    let lost = summary["link"]["telemetry_lost"].as_u64().unwrap();
    assert!(lost >= 60, "{lost} ticks in 0.8 s");
    let spanned_s = times_s[times_s.len() - 1] - times_s[0];
    let told = times_s.len() as u64 + lost;
    assert_eq!((spanned_s / 0.01).round() as u64 + 1, told);
    let gaps = times_s.windows(2).filter(|pair| pair[1] - pair[0] > 0.5);
    assert_eq!(gaps.count(), 1);
}

#[test]
fn the_plug_is_pulled_with_hardware_in_the_loop() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let board = Plugged::new(folder.path());
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
    board.in_use_for(1.5);
    board.signals.pull.store(true, Ordering::Relaxed);
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

/// The board in memory has no muscle: its pressure stays where it is, which this drive's may too.
#[test]
fn an_experiment_is_played_where_the_board_allows_it() {
    let _alone = alone();
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
    assert!((145..=160).contains(&played), "{played} of 151 ticks");
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
    // It is forbidden again.
    assert_eq!(play("again.csv", &[]).status.code(), Some(2));
}

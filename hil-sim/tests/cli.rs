//! The command line, run as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

fn hil_sim(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(args)
        .output()
        .expect("the command runs")
}

/// Runs it and expects success: what is on stdout.
fn stdout(folder: &Path, args: &[&str]) -> String {
    let output = hil_sim(folder, args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{args:?}: {message}");
    String::from_utf8(output.stdout).expect("text")
}

fn json(folder: &Path, args: &[&str]) -> serde_json::Value {
    serde_json::from_str(&stdout(folder, args)).expect("JSON")
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().expect("a number")
}

/// The figures that the paper states or that follow from its numbers (§3.1, §4, §5, Figs 2, 7, 8).
#[test]
fn the_paper_comes_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let summary = json(folder.path(), &["paper", "--json"]);
    let natural_hz = number(&summary["natural_frequency_hz"]);
    assert!(
        (natural_hz - 4.0).abs() < 0.05,
        "printed as 4 Hz: {natural_hz}"
    );
    let ratio = number(&summary["volume_ratio"]);
    assert!((5.8..=6.2).contains(&ratio), "{ratio}");
    let needed = number(&summary["flow_gain_needed_kg_per_pa_s"]);
    assert!(
        (2.5e-8..3.5e-8).contains(&needed),
        "3e-8 to its one digit: {needed}"
    );
    let [valve_a, valve_b] = [0, 1].map(|valve| summary["valves"][valve].clone());
    assert_eq!(valve_a["sufficient"], false);
    assert_eq!(valve_b["sufficient"], true);
    let lag_s = |valve: &serde_json::Value| number(&valve["tracking"]["lag_s"]);
    let rms_n = |valve: &serde_json::Value| number(&valve["tracking"]["error_n_rms"]);
    // A tick is the shortest lag a sampled controller can have: B is within two, A is not.
    assert!(lag_s(&valve_b) < 0.02 && lag_s(&valve_a) > 0.03);
    // The reference rig's figures: 55 N and 5 N in one way to cut the window, ours in another.
    assert!(
        (45.0..65.0).contains(&rms_n(&valve_a)),
        "{}",
        rms_n(&valve_a)
    );
    assert!((4.0..6.0).contains(&rms_n(&valve_b)), "{}", rms_n(&valve_b));
    let peak_n = number(&valve_b["tracking"]["reference_force_n_max"]);
    assert!(peak_n < 165.0, "{peak_n}");
    for file in ["out/report.html", "out/valve-A.csv", "out/valve-B.csv"] {
        assert!(folder.path().join(file).exists(), "{file}");
    }
}

#[test]
fn words_say_the_verdict() {
    let folder = tempfile::tempdir().expect("a folder");
    let words = stdout(folder.path(), &[]);
    assert!(
        words.contains("valve A") && words.contains("valve B"),
        "{words}"
    );
    assert!(words.contains("4.00 Hz"), "{words}");
}

#[test]
fn a_seed_repeats_a_run_to_the_last_byte() {
    let folder = tempfile::tempdir().expect("a folder");
    let record = |out: &str, seed: &str| {
        stdout(
            folder.path(),
            &["run", "--out", out, "--seed", seed, "--duration", "3"],
        );
        std::fs::read(folder.path().join(out).join("valve-B.csv")).expect("the record")
    };
    let first = record("a", "7");
    assert_eq!(first, record("b", "7"));
    assert_ne!(first, record("c", "8"));
}

#[test]
fn a_run_is_repeated_from_its_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new"]);
    let first = json(path, &["run", "--rig", "rig.toml", "--out", "a", "--json"]);
    let args = [
        "run",
        "--rig",
        "rig.toml",
        "--finger",
        "a/assist.csv",
        "--out",
        "b",
        "--json",
    ];
    let again = json(path, &args);
    let lift_m = |run: &serde_json::Value| number(&run["runs"][0]["tracking"]["lift_m_max"]);
    // The finger's path is sampled at the ticks, where alone it is looked at.
    assert!((lift_m(&first) - lift_m(&again)).abs() < 1e-12);
    let simulate = [
        "simulate",
        "--rig",
        "rig.toml",
        "--drive",
        "a/assist.csv",
        "--out",
        "s.csv",
    ];
    stdout(path, &simulate);
    let simulated = std::fs::read_to_string(path.join("s.csv")).expect("a record");
    assert!(
        simulated
            .lines()
            .next()
            .is_some_and(|header| header.contains("finger_m"))
    );
}

#[test]
fn design_answers_which_valve() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let rig = stdout(path, &["rig", "new"]);
    assert_eq!(rig, "");
    let rig = std::fs::read_to_string(path.join("rig.toml")).expect("a rig");
    let valve_a = rig.replace(
        "flow_gain_kg_per_pa_s = 1.3e-7",
        "flow_gain_kg_per_pa_s = 6.1e-9",
    );
    std::fs::write(path.join("a.toml"), valve_a).expect("written");
    let design = |rig: &str| json(path, &["design", "--rig", rig, "--json"]);
    assert_eq!(design("rig.toml")["sufficient"], true);
    assert_eq!(design("a.toml")["sufficient"], false);
}

#[test]
fn a_rig_file_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new"]);
    let again = hil_sim(path, &["rig", "new"]);
    assert_eq!(again.status.code(), Some(2));
    stdout(path, &["rig", "new", "--force"]);
    assert!(stdout(path, &["rig", "check", "rig.toml"]).contains("0 effects"));
}

#[test]
fn help_completions_and_bad_arguments() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for command in [
        "run", "hil", "record", "replay", "paper", "design", "simulate", "rig",
    ] {
        assert!(
            stdout(path, &[command, "--help"]).contains("hil-sim"),
            "{command}"
        );
        assert!(stdout(path, &["--help"]).contains(command), "{command}");
    }
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        assert!(
            stdout(path, &["completions", shell]).contains("simulate"),
            "{shell}"
        );
    }
    for args in [
        ["run", "--travel", "NaN"],
        ["run", "--duration", "-1"],
        ["run", "--finger", "nothing.csv"],
        ["run", "--output-delay", "0.011"],
    ] {
        let output = hil_sim(path, &args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(!path.join("out").exists(), "nothing written: {args:?}");
    }
}

/// Runs it with nothing that could be found by chance; expects exit status 2 and one line.
fn refused(folder: &Path, args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .env_remove("FIRMWARE")
        .env_remove("EMULATED_BOARD")
        .env_remove("CARGO_TARGET_DIR")
        .args(args)
        .output()
        .expect("the command runs");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {message}");
    assert_eq!(message.lines().count(), 1, "{args:?}: {message}");
    message
}

#[test]
fn a_missing_board_or_record_is_said_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for args in [&["hil"][..], &["hil", "--emulated"]] {
        assert!(refused(path, args).contains("cargo firmware"), "{args:?}");
    }
    for command in [
        &["hil", "--port", "no-port"][..],
        &["record", "--port", "no-port", "--out", "rec.csv"],
    ] {
        let message = refused(path, command);
        assert!(
            message.contains("no-port: expected a serial port"),
            "{message}"
        );
    }
    assert!(!path.join("rec.csv").exists() && !path.join("out").exists());
    std::fs::create_dir_all(path.join("target/thumbv7em-none-eabihf/release")).expect("made");
    let elf = path.join("target/thumbv7em-none-eabihf/release/firmware");
    std::fs::write(&elf, "no ELF").expect("written");
    assert!(refused(path, &["hil"]).contains("found another file"));
    std::fs::write(&elf, "\x7fELF").expect("written");
    assert!(refused(path, &["hil"]).contains("tests/board/Cargo.toml"));
    let record = |out| ["record", "--port", "no-port", "--out", out];
    assert!(refused(path, &record("rec.mcap")).contains("the CSV file"));
    std::fs::write(path.join("there.csv"), "").expect("written");
    assert!(refused(path, &record("there.csv")).contains("--force"));
    refused(path, &["replay", "nothing.csv"]);
    refused(path, &["replay", "nothing.mcap"]);
    std::fs::write(path.join("not.mcap"), "time_s").expect("written");
    refused(path, &["replay", "not.mcap"]);
}

#[test]
fn a_run_is_replayed_without_a_difference() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["run", "--duration", "3"]);
    let result = json(path, &["replay", "out/valve-B.csv", "--json"]);
    let result = &result["replay"];
    assert_eq!(number(&result["compared_ticks"]), 300.0);
    assert_eq!(number(&result["differing_ticks"]), 0.0);
    assert!(stdout(path, &["replay", "out/valve-A.csv"]).contains("0 of 300 ticks differ."));
    // Neither half a count nor a record without counts is for a board.
    let record = std::fs::read_to_string(path.join("out/valve-B.csv")).expect("a record");
    let half = record.replacen(",None,", ",Nothing,", 1);
    std::fs::write(path.join("half.csv"), half).expect("written");
    assert!(refused(path, &["replay", "half.csv"]).contains("half.csv:2: expected None"));
    std::fs::write(path.join("bare.csv"), "time_s,pressure_pa\n0,1\n").expect("written");
    assert!(refused(path, &["replay", "bare.csv"]).contains("bridge_count"));
}

//! The firmware on the emulated board, through the command line.
//!
//! `FIRMWARE` names the firmware's ELF, `EMULATED_BOARD` the emulated board's program. If both
//! exist: `cargo test --test emulated -- --ignored`.

use hil_sim::rig::Rig;
use std::path::Path;
use std::process::Command;

/// What the command prints. `--emulated` would fall back to programs in the target folder, which
/// may be out of date: both must be named.
fn json(folder: &Path, args: &[&str]) -> serde_json::Value {
    for name in ["FIRMWARE", "EMULATED_BOARD"] {
        assert!(std::env::var_os(name).is_some(), "{name} names no file");
    }
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(args)
        .output()
        .expect("the command runs");
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {message}");
    assert!(!message.contains("MISTAKE"), "{message}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn experiments_with_the_firmware_equal_those_without() {
    let folder = tempfile::tempdir().expect("a folder");
    let there = json(folder.path(), &["hil", "--out", "hil", "--json"]);
    let here = json(folder.path(), &["run", "--out", "run", "--json"]);
    for run in 0..2 {
        let (there, here) = (&there["runs"][run], &here["runs"][run]);
        assert_eq!(there["tracking"], here["tracking"]);
        assert_eq!(there["differing_ticks"], 0);
        let board = &there["board"];
        for count in ["missed_ticks", "restarts"] {
            assert_eq!(board[count], 0, "{board}");
        }
        for count in [
            "silent_ticks",
            "telemetry_lost",
            "frames_rejected",
            "messages_repeated",
        ] {
            assert_eq!(board["link"][count], 0, "{board}");
        }
    }
}

#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn other_settings_are_stored_and_replayed() {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = include_str!("../src/rig/reference_rig.toml");
    let other = rig.replace("gain = 20.0", "gain = 14.0");
    assert_ne!(rig, other);
    std::fs::write(folder.path().join("rig.toml"), other).expect("written");
    let run = ["hil", "--rig", "rig.toml", "--duration", "3", "--json"];
    assert_eq!(json(folder.path(), &run)["runs"][0]["differing_ticks"], 0);
    for record in ["out/assist.csv", "out/assist.mcap"] {
        let result = json(folder.path(), &["replay", record, "--emulated", "--json"]);
        let result = &result["replay"];
        assert_eq!(
            (&result["compared_ticks"], &result["differing_ticks"]),
            (&300.into(), &0.into())
        );
    }
}

/// A hidden effect in the plant, a test signal, and the record of both.
#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn an_experiment_is_played_on_the_firmware() {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = include_str!("../src/rig/reference_rig.toml").to_owned();
    let hidden = "[[effect]]\nname = \"hysteresis\"\nforce_n = 20.0\n\
                  reach = 0.01\nspread = 8.0\ntaper = 0.0\nbase_share = 0.0\n";
    std::fs::write(folder.path().join("hidden.toml"), rig + hidden).expect("written");
    let drive = [
        "--rig",
        "hidden.toml",
        "--out",
        "exp.csv",
        "--part",
        "sweep",
        "--json",
    ];
    let drive = json(folder.path(), &[&["experiment"], &drive[..]].concat());
    let length_s = drive["length_s"].as_f64().expect("a number");
    let run = [
        "record",
        "--emulated",
        "hidden.toml",
        "--play",
        "exp.csv",
        "--out",
        "rec.csv",
    ];
    let run = json(folder.path(), &[&run[..], &["--json"]].concat());
    assert_eq!(run["played"], "played to its end");
    let ticks = run["ticks"].as_f64().expect("a number");
    assert!(ticks > 100.0 * length_s, "{ticks} in {length_s} s");
    let result = json(folder.path(), &["replay", "rec.csv", "--json"]);
    assert_eq!(result["replay"]["compared_ticks"], run["ticks"]);
    assert_eq!(result["replay"]["differing_ticks"], 0);
}

/// The complete workflow: a hidden effect, the test signal, its record, the diagnosis, the
/// settings, and the assistance that they improve.
#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn diagnosis_of_a_firmware_record_improves_the_assistance() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let nominal = Rig::template();
    let hidden = "[[effect]]\nname = \"hysteresis\"\nform = \"bouc-wen\"\nforce_n = 20.0\n\
         reach = 0.015\nsharpness = 1.5\nbase_share = 0.0\n";
    std::fs::write(path.join("nominal.toml"), &nominal).expect("written");
    std::fs::write(path.join("hidden.toml"), nominal + hidden).expect("written");
    let run = |words: &str| json(path, &words.split(' ').collect::<Vec<_>>());
    for part in ["triangles", "sweep"] {
        run(&format!(
            "experiment --rig nominal.toml --out {part}.exp.csv --part {part} --json"
        ));
        let played = run(&format!(
            "record --emulated hidden.toml --play {part}.exp.csv --out {part}.csv --json"
        ));
        assert_eq!(played["played"], "played to its end");
    }
    let records = "--fit triangles.csv --validate sweep.csv";
    let diagnosis = run(&format!(
        "diagnose --rig nominal.toml {records} --out diagnosis --json"
    ));
    assert_eq!(diagnosis["effects"][0]["name"], "hysteresis", "{diagnosis}");
    run("compensate --rig diagnosis/rig.fitted.toml --out compensation --json");
    let plain = run("hil --rig hidden.toml --out plain --json");
    let settings = "--settings compensation/settings.toml --write-settings";
    let better = run(&format!(
        "hil --rig hidden.toml {settings} --out better --json"
    ));
    let [plain_n, better_n] = [&plain, &better].map(|done| {
        let run = &done["runs"][0];
        assert_eq!(run["differing_ticks"], 0);
        run["tracking"]["error_n_rms"].as_f64().expect("a number")
    });
    println!("RMS of F_c − F on the board: {plain_n:.1} N plain, {better_n:.1} N compensated");
    assert!(better_n <= 0.5 * plain_n, "{plain_n} N, then {better_n} N");
}

/// The long one: a thousand seconds recorded with the firmware, replayed on the PC.
#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn hundred_thousand_ticks_of_the_firmware_replay_on_the_pc() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(
        folder.path().join("rig.toml"),
        include_str!("../src/rig/reference_rig.toml"),
    )
    .expect("written");
    // At rest for the self-check, then up and down.
    let finger: String = (0..=200)
        .map(|n| format!("{},{}\n", 2 + 5 * n, 0.12 * f64::from(n % 2)))
        .collect();
    std::fs::write(
        folder.path().join("finger.csv"),
        format!("time_s,finger_m\n{finger}"),
    )
    .expect("written");
    let run = [
        "hil",
        "--rig",
        "rig.toml",
        "--finger",
        "finger.csv",
        "--duration",
        "1000",
        "--json",
    ];
    let run = json(folder.path(), &run);
    let run = &run["runs"][0];
    assert_eq!(run["board"]["ticks"], 100_000);
    let lift_m = run["tracking"]["lift_m_max"].as_f64();
    assert!(lift_m > Some(0.03), "{lift_m:?}");
    let result = json(folder.path(), &["replay", "out/assist.csv", "--json"]);
    let result = &result["replay"];
    assert_eq!(
        (&result["compared_ticks"], &result["differing_ticks"]),
        (&100_000.into(), &0.into())
    );
}

/// Every command of docs/rig-to-board.md, as it stands there.
#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn the_page_from_records_to_a_board_holds() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = include_str!("../../docs/rig-to-board.md");
    let commands: Vec<_> = page
        .lines()
        .filter_map(|line| line.strip_prefix("    "))
        .collect();
    assert_eq!(commands.len(), 6);
    let mut errors_n = Vec::new();
    for command in commands {
        let words: Vec<_> = command.split(' ').collect();
        match words[0] {
            "cargo" => {
                let manifest = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml");
                let built = Command::new(env!("CARGO"))
                    .current_dir(folder.path())
                    .args([words[1], "--manifest-path", manifest])
                    .args(&words[2..])
                    .status();
                assert!(built.expect("cargo runs").success(), "{command}");
            }
            // It prints TOML or, with --out, nothing.
            "hil-sim" if words[1] == "settings" => {
                let stored = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
                    .current_dir(folder.path())
                    .args(&words[1..])
                    .status();
                assert!(stored.expect("the command runs").success(), "{command}");
            }
            _ => {
                let result = json(folder.path(), &[&words[1..], &["--json"]].concat());
                match words[1] {
                    "compensate" => {
                        let [before_n, after_n] = ["before", "after"]
                            .map(|run| result[run]["load_error_n_rms"].as_f64().expect("a number"));
                        let quoted = format!("falls from {before_n:.1} to {after_n:.1} N RMS");
                        assert!(
                            page.contains(&quoted),
                            "the page has other numbers: {quoted}"
                        );
                    }
                    "diagnose" => assert_eq!(result["effects"][0]["name"], "leak"),
                    "hil" => {
                        let error_n = result["runs"][0]["tracking"]["error_n_rms"].as_f64();
                        errors_n.push(error_n.expect("a number"));
                    }
                    _ => {}
                }
            }
        }
    }
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).expect("settings");
    assert_eq!(
        read("out/board.toml"),
        read("out/compensation/settings.toml")
    );
    // From 10.2 to 4.6 N with what `compensate` simulates.
    assert!(errors_n[1] < 0.6 * errors_n[0], "{errors_n:?}");
}

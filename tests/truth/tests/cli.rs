//! Tests of the command line.

use std::process::Command;

fn truth() -> Command {
    Command::new(env!("CARGO_BIN_EXE_truth"))
}

#[test]
fn writes_cases_and_answers_to_separate_folders() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a name");
    let arguments = [
        "--out", out, "--seed", "4", "--cases", "none", "--count", "1",
    ];
    let output = truth().args(arguments).output().expect("it runs");
    assert!(output.status.success());
    assert!(output.stdout.starts_with(b"seed 4, working set\n"));
    // the first case with nothing hidden
    let given = folder.path().join("cases/d4-00002");
    let names = [
        "fit_1.csv",
        "fit_2.csv",
        "rig.toml",
        "validate_1.csv",
        "validate_2.csv",
    ];
    let entries = std::fs::read_dir(&given).expect("a folder");
    let found = entries.map(|entry| entry.expect("a file").file_name());
    let mut found: Vec<_> = found.collect();
    found.sort();
    assert_eq!(found, names, "nothing else may be there to see");
    let held_back = folder.path().join("held-back/d4-00002");
    assert!(held_back.join("unseen.csv").is_file());
    let answer = std::fs::read_to_string(held_back.join("truth.json"));
    assert!(answer.expect("an answer").contains("\"kind\": \"none\""));

    let old = [
        "--family",
        "catalogue-like",
        "--cases",
        "none",
        "--count",
        "1",
    ];
    let output = truth()
        .args(old)
        .args(["--out", out, "--seed", "4"])
        .output();
    assert!(output.expect("it runs").stdout.starts_with(b"seed 4\n"));
    assert!(folder.path().join("cases/s4-00003/rig.toml").is_file());
}

#[test]
fn lists_effects_and_refuses_unknown_ones() {
    let output = truth().arg("list").output().expect("it runs");
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(text.contains("hysteresis") && text.contains("bouc-wen") && text.contains("cogging"));
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a name");
    let refused = truth()
        .args(["--out", out, "--effect", "gremlins"])
        .output()
        .expect("it runs");
    assert_eq!(refused.status.code(), Some(2));
}

//! The program: what it writes and what it refuses.

use std::process::Command;

fn truth() -> Command {
    Command::new(env!("CARGO_BIN_EXE_truth"))
}

#[test]
fn writes_cases_and_apart_from_them_answers() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a name");
    let arguments = [
        "--out", out, "--seed", "4", "--cases", "none", "--count", "1",
    ];
    let output = truth().args(arguments).output().expect("it runs");
    assert!(output.status.success());
    assert!(output.stdout.starts_with(b"seed 4\n"));
    // the first case with nothing hidden
    let case = folder.path().join("cases/s4-00003");
    for name in [
        "rig.toml",
        "fit-1.csv",
        "fit-2.csv",
        "validate-1.csv",
        "validate-2.csv",
        "unseen-1.csv",
    ] {
        assert!(case.join(name).is_file(), "{name}");
    }
    let answer = std::fs::read_to_string(folder.path().join("answers/s4-00003.json"));
    assert!(answer.expect("an answer").contains("\"kind\": \"none\""));
}

#[test]
fn lists_effects_and_refuses_what_is_not_one() {
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

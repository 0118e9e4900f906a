//! docs/own-rig.md, as it stands there: each file that it shows is written and each command typed,
//! in a copy of the repository, by a shell.
//!
//! `FIRMWARE` and `EMULATED_BOARD` as for the tests of `emulated.rs`, and `CARGO_TARGET_DIR` or
//! `target` for what the page builds:
//! `cargo test --test own_rig -- --ignored`.
#![cfg(unix)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

const PAGE: &str = include_str!("../../docs/own-rig.md");

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The files of the repository as they are, without what git ignores.
fn copy_repository(to: &Path) {
    let listed = Command::new("git")
        .current_dir(root())
        .args(["ls-files", "-z", "--cached", "--others"])
        .arg("--exclude-standard")
        .output()
        .expect("git");
    for name in String::from_utf8(listed.stdout).expect("names").split('\0') {
        let from = root().join(name);
        if name.is_empty() || !from.is_file() {
            continue;
        }
        let to = to.join(name);
        std::fs::create_dir_all(to.parent().expect("a folder")).expect("made");
        std::fs::copy(from, to).expect("copied");
    }
}

/// The page as a script: a fenced block below `name`: is a file, an indented line a command.
fn script() -> String {
    let (mut script, mut name, mut in_block) = (String::from("set -euo pipefail\n"), "", false);
    for line in PAGE.lines() {
        if let Some(of_file) = line.strip_prefix('`').and_then(|l| l.strip_suffix("`:")) {
            name = of_file;
        } else if line.starts_with("```") {
            in_block = !in_block;
            let command = format!("cat > {name} <<'END OF FILE'");
            let command = if in_block { &command } else { "END OF FILE" };
            writeln!(script, "{command}").expect("a string");
        } else if in_block {
            writeln!(script, "{line}").expect("a string");
        } else if let Some(command) = line.strip_prefix("    ") {
            writeln!(script, "{command}").expect("a string");
        }
    }
    // The first installation is of this program, which is built.
    let installed = script.replacen("cargo install --path hil-sim\n", "", 1);
    assert_eq!(installed.matches("cargo install").count(), 1);
    // The second replaces that copy, of which cargo does not know.
    installed.replacen("cargo install", "cargo install --force", 1)
}

fn json(path: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(path).expect("a file");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
#[ignore = "needs FIRMWARE and EMULATED_BOARD"]
fn the_page_from_a_data_sheet_to_a_board_holds() {
    for name in ["FIRMWARE", "EMULATED_BOARD"] {
        assert!(std::env::var_os(name).is_some(), "{name} names no file");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (copy, programs) = (folder.path().join("copy"), folder.path().join("bin"));
    copy_repository(&copy);
    std::fs::create_dir(&programs).expect("made");
    let this = env!("CARGO_BIN_EXE_hil-sim");
    std::fs::copy(this, programs.join("hil-sim")).expect("copied");
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), PathBuf::from);
    // What is installed goes through this place, where others look for the program.
    let built = target.join("release/hil-sim");
    let before = std::fs::read(&built);
    let path = std::env::var_os("PATH").expect("a path");
    let paths = [programs].into_iter().chain(std::env::split_paths(&path));
    let typed = Command::new("bash")
        .args(["-c", &script()])
        .current_dir(&copy)
        .env("PATH", std::env::join_paths(paths).expect("a path"))
        .env("CARGO_INSTALL_ROOT", folder.path())
        .env("CARGO_TARGET_DIR", target)
        .output()
        .expect("bash");
    match before {
        Ok(program) => std::fs::write(built, program).expect("put back"),
        Err(_) => drop(std::fs::remove_file(built)),
    }
    let told = String::from_utf8_lossy(&typed.stdout);
    let complaint = String::from_utf8_lossy(&typed.stderr);
    assert!(typed.status.success(), "{told}\n{complaint}");
    let quotes: Vec<_> = PAGE.lines().filter_map(|l| l.strip_prefix("> ")).collect();
    assert_eq!(quotes.len(), 4);
    for quote in quotes {
        assert!(told.contains(quote), "{quote}\n{told}");
    }

    let own = copy.join("out/own");
    let answer = json(&copy.join("out/bench/held-back/s1-00425/truth.json"));
    let hidden = &answer["effects"][0]["parameters"];
    let found = json(&own.join("second/diagnosis.json"));
    assert_eq!(found["effects"].as_array().map(Vec::len), Some(1));
    let parameters = &found["effects"][0]["parameters"];
    let value = |key: &str| parameters[key]["value"].as_f64().expect("a value");
    // Four of the standard errors that the intervals state, as one of a thousand exceeds three.
    let near = |key: &str, hidden: f64| {
        let ci95 = &parameters[key]["ci95"];
        let [low, high] = [0, 1].map(|end| ci95[end].as_f64().expect("an interval"));
        let standard_error = (high - low) / (2.0 * 1.96);
        assert!(
            (value(key).abs() - hidden).abs() < 4.0 * standard_error,
            "{parameters}"
        );
    };
    near("pitch", hidden["pitch"].as_f64().expect("a pitch"));
    near(
        "sine_n",
        hidden["amplitude_n"].as_f64().expect("an amplitude"),
    );
    let settings = ["compensation/settings.toml", "board.toml"]
        .map(|name| std::fs::read_to_string(own.join(name)).expect("settings"));
    assert_eq!(settings[0], settings[1]);
}

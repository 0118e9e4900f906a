//! What the scripts say on a machine that has nothing yet.
#![cfg(unix)]

use std::os::unix::fs::symlink;
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Status and stderr of a script where only the programs that every system has are found.
fn on_bare_machine(script: &str) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = std::env::var_os("PATH").unwrap();
    for program in ["bash", "dirname", "uname"] {
        let mut found = std::env::split_paths(&path).map(|folder| folder.join(program));
        let found = found.find(|file| file.is_file()).expect(program);
        symlink(found, folder.path().join(program)).unwrap();
    }
    let output = Command::new(folder.path().join("bash"))
        .arg(format!("{ROOT}/{script}"))
        .env("PATH", folder.path())
        .output()
        .expect("bash runs");
    let told = String::from_utf8(output.stderr).expect("UTF-8");
    (output.status.code(), told)
}

/// A missing libclang is found by its file: this machine may have it.
#[test]
fn scripts_list_at_once_what_is_missing_and_how_to_install_it() {
    for (script, name, tools) in [
        (
            "scripts/emulated-hil.sh",
            "emulated-hil",
            "rustup cargo cc pkg-config",
        ),
        ("scripts/budget.sh", "budget", "cargo cc pkg-config"),
        (
            "tests/board/mutants.sh",
            "mutants",
            "cargo git cc pkg-config",
        ),
    ] {
        let (status, told) = on_bare_machine(script);
        assert_eq!(status, Some(2), "{told}");
        let told = told.replace(" libclang-dev", "").replace(" libclang", "");
        let lines: Vec<_> = told.lines().collect();
        let missing = lines[0].strip_prefix(&format!("{name}: missing: {tools} pip"));
        assert!(missing.is_some(), "{told}");
        assert!(lines[1].ends_with("https://rustup.rs"), "{told}");
        let apt = lines[2]
            .rsplit_once("sudo apt install ")
            .expect("a command");
        for package in ["build-essential", "pkg-config", "python3-pip"] {
            assert!(apt.1.split(' ').any(|word| word == package), "{told}");
        }
        assert_eq!(lines.len(), 3, "{told}");
    }
}

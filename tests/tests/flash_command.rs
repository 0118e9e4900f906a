//! The command that flashes a release image must not let the probe halt it.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The value of `key` in a line `key = "value"` of .cargo/config.toml.
fn configured(key: &str) -> &'static str {
    let config = include_str!("../../.cargo/config.toml");
    let value = config.lines().find_map(|line| {
        line.strip_prefix(key)?
            .strip_prefix(" = \"")?
            .strip_suffix('"')
    });
    value.unwrap_or_else(|| panic!("no line {key} = \"…\" in .cargo/config.toml"))
}

/// Status and output of the configured runner for an image with these symbols; a program in place
/// of probe-rs prints its arguments.
fn run(symbols: &str) -> (bool, String) {
    let folder = tempfile::tempdir().unwrap();
    let probe_rs = folder.path().join("probe-rs");
    fs::write(&probe_rs, "#!/bin/sh\necho \"$@\"\n").unwrap();
    fs::set_permissions(&probe_rs, fs::Permissions::from_mode(0o755)).unwrap();
    let elf = folder.path().join("image");
    fs::write(
        &elf,
        [b"\x7fELF\0main\0", symbols.as_bytes(), b"\0"].concat(),
    )
    .unwrap();
    let path = std::env::var("PATH").unwrap();
    let output = Command::new(format!("{ROOT}/{}", configured("runner")))
        .arg(&elf)
        .env("PATH", format!("{}:{path}", folder.path().display()))
        .output()
        .unwrap();
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8(text).unwrap())
}

/// probe-rs catches both unless it is told not to. A caught hard fault halts the core before the
/// firmware's handler brings the valve to 0 V.
#[test]
fn flashing_catches_neither_reset_nor_hard_fault() {
    let (done, arguments) = run("chip_STM32F446RETx");
    let expected = "run --chip STM32F446RETx --no-catch-reset --no-catch-hardfault /";
    assert!(done && arguments.starts_with(expected), "{arguments}");
    let flash: Vec<&str> = configured("firmware-flash").split(' ').collect();
    assert!(!flash.contains(&"--features"), "{flash:?}");
}

#[test]
fn image_for_a_debugger_may_be_halted() {
    let (done, arguments) = run("chip_STM32F411RETx\0watchdog_stops_in_debug");
    assert!(
        done && arguments.starts_with("run --chip STM32F411RETx /"),
        "{arguments}"
    );
}

#[test]
fn image_that_names_no_chip_is_refused() {
    let (done, text) = run("main");
    assert!(!done && text.contains("names no chip"), "{text}");
}

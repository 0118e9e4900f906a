//! The command that flashes a release image must not let the probe halt it.
#![cfg(unix)]

use model_core::link::IMAGE_LENGTH_AT;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

const FLASH: u32 = 0x0800_0000;
const SEGMENT_LEN: usize = 64;
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

/// An ELF file with one segment at the start of the flash, and these symbols.
fn elf(symbols: &str) -> Vec<u8> {
    let mut elf = vec![0; 52 + 32 + SEGMENT_LEN];
    let mut put = |at: usize, value: u32| elf[at..at + 4].copy_from_slice(&value.to_le_bytes());
    put(28, 52);
    put(42, 32);
    put(44, 1);
    let length = SEGMENT_LEN as u32;
    let fields = [
        (0, 1),
        (4, 84),
        (8, FLASH),
        (12, FLASH),
        (16, length),
        (20, length),
    ];
    for (field, value) in fields {
        put(52 + field, value);
    }
    [&elf, symbols.as_bytes(), b"\0"].concat()
}

/// Status and output of the configured runner for an image with these symbols, called as cargo does
/// with options of probe-rs; a program in place of probe-rs prints its arguments.
fn run(symbols: &str, options: &[&str]) -> (bool, String) {
    let folder = tempfile::tempdir().unwrap();
    let probe_rs = folder.path().join("probe-rs");
    fs::write(&probe_rs, "#!/bin/sh\necho \"$@\"\n").unwrap();
    fs::set_permissions(&probe_rs, fs::Permissions::from_mode(0o755)).unwrap();
    let elf = folder.path().join("image");
    fs::write(&elf, self::elf(symbols)).unwrap();
    let path = std::env::var("PATH").unwrap();
    let output = Command::new(format!("{ROOT}/{}", configured("runner")))
        .arg(&elf)
        .args(options)
        .env("PATH", format!("{}:{path}", folder.path().display()))
        .output()
        .unwrap();
    if output.status.success() {
        // The length; the firmware on the emulated board compares the checksum.
        let arguments = String::from_utf8(output.stdout.clone()).unwrap();
        let sealed = fs::read(arguments.trim_end().rsplit(' ').next().unwrap()).unwrap();
        let at = 52 + 32 + IMAGE_LENGTH_AT;
        assert_eq!(sealed[at..at + 4], [SEGMENT_LEN as u8, 0, 0, 0]);
        assert_eq!(fs::read(&elf).unwrap(), self::elf(symbols), "cargo's image");
    }
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8(text).unwrap())
}

/// probe-rs catches both unless it is told not to. A caught hard fault halts the core before the
/// firmware's handler brings the valve to 0 V.
#[test]
fn flashing_catches_neither_reset_nor_hard_fault() {
    let (done, arguments) = run("chip_STM32F446RETx", &[]);
    let expected = "run --chip STM32F446RETx --no-catch-reset --no-catch-hardfault /";
    assert!(done && arguments.starts_with(expected), "{arguments}");
    let flash: Vec<&str> = configured("firmware-flash").split(' ').collect();
    assert!(!flash.contains(&"--features"), "{flash:?}");
}

#[test]
fn image_for_a_debugger_may_be_halted() {
    let (done, arguments) = run("chip_STM32F411RETx\0watchdog_stops_in_debug", &[]);
    assert!(
        done && arguments.starts_with("run --chip STM32F411RETx /"),
        "{arguments}"
    );
}

/// `cargo firmware-flash -- --probe 0483:374b`
#[test]
fn options_of_probe_rs_follow_the_image() {
    let (done, arguments) = run("chip_STM32F446RETx", &["--probe", "0483:374b"]);
    assert!(
        done && arguments.contains(" --probe 0483:374b /"),
        "{arguments}"
    );
}

#[test]
fn image_that_names_no_chip_is_refused() {
    let (done, text) = run("main", &[]);
    assert!(!done && text.contains("names no chip"), "{text}");
}

//! model-core on the board's instruction set: a Cortex-M4F in QEMU (Debian: qemu-system-arm).
//!
//! `cargo cortex-m-tests` builds the program, whose path is in `CORTEX_M_TESTS`: see
//! tests/cortex-m/README.md.

use std::collections::BTreeSet;
use std::fs::{read_dir, read_to_string};
use std::path::Path;
use std::process::Command;

#[path = "../cortex-m/src/battery.rs"]
mod battery;

/// Instructions in 1 % of a tick's 10 ms at 144 MHz, where each takes a cycle at least.
const INSTRUCTIONS_MAX: u64 = 14_400;

/// The output of the program; one instruction takes one nanosecond of virtual time.
fn run_in_qemu(program: &std::ffi::OsStr) -> String {
    let output = Command::new("qemu-system-arm")
        .args(["-machine", "mps2-an386", "-nographic", "-monitor", "none"])
        .args([
            "-icount",
            "shift=0",
            "-semihosting-config",
            "enable=on,target=native",
        ])
        .arg("-kernel")
        .arg(program)
        .output()
        .expect("qemu-system-arm starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success() && text.ends_with("passed\n"),
        "{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    text
}

/// Number of tests of model-core, without those that need threads or their variables.
fn tests_of_model_core() -> usize {
    let model_core = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-core");
    let folders = ["src", "tests"].map(|folder| read_dir(model_core.join(folder)).expect("it"));
    let files = folders
        .into_iter()
        .flatten()
        .map(|file| file.expect("a file").path());
    let texts = files.map(|file| read_to_string(file).expect("Rust"));
    let has_threads = |text: &str| text.contains("std::thread") || text.contains("thread_local!");
    let texts = texts.filter(|text| !has_threads(text));
    texts.map(|text| text.matches("#[test]").count()).sum()
}

#[test]
#[ignore = "needs QEMU and the program at CORTEX_M_TESTS"]
fn model_core_passes_its_tests_on_a_cortex_m4f_and_is_bit_identical_to_the_pc() {
    let program = std::env::var_os("CORTEX_M_TESTS").expect("CORTEX_M_TESTS names the program");
    let printed = run_in_qemu(&program);
    println!("{printed}");
    for (name, checksum) in battery::PARTS {
        let here = format!("battery {name}: {:016x}", checksum());
        assert!(printed.lines().any(|line| line == here), "here {here}");
    }
    let ran = printed.lines().filter(|line| line.starts_with("test "));
    assert_eq!(ran.count(), tests_of_model_core());
    let of_tick = printed.lines().find_map(|line| {
        let (_, longest) = line
            .strip_prefix("instructions of a tick: ")?
            .split_once("mean, ")?;
        longest.strip_suffix(" at most")?.parse().ok()
    });
    assert!((1..INSTRUCTIONS_MAX).contains(&of_tick.expect("the count of instructions")));
}

/// All modes except playing, which the reference settings do not permit.
#[test]
fn the_battery_reaches_every_mode_and_a_fault_of_each_instrument() {
    let (mut modes, mut faults) = (BTreeSet::new(), BTreeSet::new());
    battery::run_controllers(|output| {
        modes.insert(format!("{:?}", output.mode));
        faults.extend(output.fault.map(|fault| format!("{fault:?}")));
    });
    let expected = ["Assisting", "Holding", "Ready", "SelfCheck", "Venting"];
    assert_eq!(modes, expected.map(String::from).into());
    for instrument in ["Bridge", "Encoder", "Pressure", "ValveVoltage"] {
        let is_reached = faults.iter().any(|fault| fault.starts_with(instrument));
        assert!(is_reached, "{instrument}: {faults:?}");
    }
}

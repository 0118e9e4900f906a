//! model-core on the board's instruction set: a Cortex-M4F in QEMU (Debian: qemu-system-arm).
//!
//! `cargo cortex-m-tests` builds the program; `CORTEX_M_TESTS` names it:
//! `CORTEX_M_TESTS=target/thumbv7em-none-eabihf/release/cortex-m-tests cargo test --test cortex_m
//! -- --ignored`.

use std::collections::BTreeSet;
use std::process::Command;

#[path = "../cortex-m/src/battery.rs"]
mod battery;

/// Instructions in 1 % of a tick's 10 ms at 180 MHz, where each takes a cycle at least.
const INSTRUCTIONS_MAX: u64 = 18_000;

/// What the program prints, an instruction taking a nanosecond of its time.
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

#[test]
#[ignore = "needs QEMU and the program at CORTEX_M_TESTS"]
fn model_core_passes_its_tests_on_a_cortex_m4f_and_equals_the_pc_to_the_last_bit() {
    let program = std::env::var_os("CORTEX_M_TESTS").expect("CORTEX_M_TESTS names the program");
    let printed = run_in_qemu(&program);
    println!("{printed}");
    for (name, checksum) in battery::PARTS {
        let here = format!("battery {name}: {:016x}", checksum());
        assert!(printed.lines().any(|line| line == here), "here {here}");
    }
    let tests = printed.lines().filter(|line| line.starts_with("test "));
    assert!(tests.count() >= 50);
    let of_tick = printed.lines().find_map(|line| {
        let (_, longest) = line
            .strip_prefix("instructions of a tick: ")?
            .split_once("mean, ")?;
        longest.strip_suffix(" at most")?.parse().ok()
    });
    assert!((1..INSTRUCTIONS_MAX).contains(&of_tick.expect("it is told")));
}

/// What is compared is worth it.
#[test]
fn the_battery_reaches_every_mode_and_most_faults() {
    let mut seen = BTreeSet::new();
    battery::run_controllers(|output| {
        seen.insert(format!("{:?}", output.mode));
        seen.extend(output.fault.map(|fault| format!("{fault:?}")));
    });
    assert!(seen.len() >= 5 + 8, "{seen:?}");
}

//! The command that flashes a release image must not let the probe halt it.

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

/// probe-rs catches both unless it is told not to. A caught hard fault halts the core before the
/// firmware's handler brings the valve to 0 V.
#[test]
fn flashing_catches_neither_reset_nor_hard_fault() {
    let runner: Vec<&str> = configured("runner").split(' ').collect();
    for option in ["--no-catch-reset", "--no-catch-hardfault"] {
        assert!(runner.contains(&option), "{runner:?}");
    }
    let flash: Vec<&str> = configured("firmware-flash").split(' ').collect();
    assert!(!flash.contains(&"--features"), "{flash:?}");
}

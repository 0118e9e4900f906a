//! A plant takes at most a hundred lines.

#[test]
fn a_plant_takes_at_most_a_hundred_lines() {
    let plants = [
        ("tanks", include_str!("../src/tanks.rs")),
        ("axis", include_str!("../src/axis.rs")),
        ("motor", include_str!("../src/motor.rs")),
        ("oscillator", include_str!("../src/oscillator.rs")),
    ];
    for (name, text) in plants {
        let is_code = |line: &&str| {
            !["", "//", "use "].iter().any(|none| match *none {
                "" => line.is_empty(),
                start => line.starts_with(start),
            })
        };
        let lines = text.lines().map(str::trim).filter(is_code).count();
        assert!(lines <= 100, "{name} takes {lines} lines");
    }
}

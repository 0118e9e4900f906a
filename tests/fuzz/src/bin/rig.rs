//! Rig files: a rig or one line that says what is wrong, no panic.
#![no_main]

use hil_sim::rig::Rig;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Err(bad) = Rig::parse("rig.toml", text) {
        assert!(!bad.to_string().is_empty());
    }
});

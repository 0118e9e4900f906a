//! Records: a record or one line that says what is wrong, no panic.
#![no_main]

use hil_sim::record::Record;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Err(bad) = Record::parse("record.csv", bytes) {
        assert!(!bad.to_string().is_empty());
    }
});

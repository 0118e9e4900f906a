//! Malformed rigs and records: exit status 2, one line with the position, and no output file.

use hil_sim::identify::simulate::simulate;
use hil_sim::record::Record;
use hil_sim::rig::Rig;
use proptest::prelude::*;
use std::path::Path;
use std::process::Command;

const RECORD: &str = "\
time_s,pressure_ref_pa,pressure_pa,contraction,note
0,2e5,0,0,start
0.01,2e5,1.9e5,0.001,
0.02,2e5,2e5,0.004,\"a, b\"
0.03,1e5,,,
";

/// Lines of the reference rig, their replacements, and the expected message.
const RIGS: [(&str, &str, &str); 34] = [
    (
        "schema = 1",
        "schema = 2",
        ":4: key `schema`: expected 1, found 2",
    ),
    (
        "schema = 1",
        "",
        "key `schema`: expected 1, found no such key",
    ),
    (
        "schema = 1",
        "schema = \"1\"",
        ":4: key `schema`: expected a number, found string",
    ),
    ("schema = 1", "schema = ", ":4: expected TOML"),
    (
        "schema = 1",
        "schema = 1\nschema = 1",
        ":5: expected each key and each section once, found `schema` again",
    ),
    (
        "schema = 1",
        "schema = 1\nrig = 7",
        ":5: key `rig`: expected one of the keys",
    ),
    (
        "schema = 1",
        "schema = 1\nmuscle = 7",
        "expected each key and each section once, found `muscle` again",
    ),
    ("[muscle]", "[muscle", "expected TOML"),
    (
        "[muscle]",
        "[muscles]",
        "key `muscles`: expected one of the keys",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "",
        ":6: key `muscle.alpha_m2`: expected a number, found no such",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = 1e-3",
        "key `muscle.beta_m2`: expected more than",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = nan",
        "key `muscle.alpha_m2`: expected a number from",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = -inf",
        "key `muscle.alpha_m2`: expected a number from",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = \"big\"",
        "expected a number, found string",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = [1.0]",
        "expected a number, found array",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = 1979-05-27",
        "expected a number, found datetime",
    ),
    (
        "alpha_m2 = 3.7718e-3",
        "alpha_m2 = 3,7718e-3",
        ":7: expected a decimal point, found 3,7718e-3",
    ),
    (
        "beta_m2 = -1.39e-3",
        "betta_m2 = -1.39e-3",
        ":8: key `muscle.betta_m2`: expected one of",
    ),
    (
        "volume_d2_m3 = 7.005e-4",
        "",
        "key `muscle.volume_d2_m3`: expected a number, found no",
    ),
    (
        "volume_d3_m3 = 2.30e-5",
        "volume_d3_m3 = 0",
        "key `muscle.volume_d3_m3`: expected a number",
    ),
    (
        "volume_d1_m3 = -9.90e-4",
        "volume_d1_m3 = -9.0",
        "expected a volume above 0, found",
    ),
    (
        "initial_length_m = 0.3",
        "initial_length_m = -0.3",
        "key `muscle.initial_length_m`",
    ),
    (
        "kind = \"weight\"",
        "kind = \"wait\"",
        "expected \"weight\" or \"prescribed\", found \"wait\"",
    ),
    (
        "kind = \"weight\"",
        "kind = 7",
        "key `load.kind`: expected a string, found integer",
    ),
    (
        "mass_kg = 12.0",
        "mass_kg = 0.0",
        "key `load.mass_kg`: expected a number from",
    ),
    (
        "mass_kg = 12.0",
        "mass_kg = true",
        "key `load.mass_kg`: expected a number, found boolean",
    ),
    (
        "static_friction_n = 7.0",
        "static_friction_n = 1.0",
        "expected at least coulomb_friction_n",
    ),
    (
        "[valve]",
        "[[valve]]",
        "key `valve`: expected a section, found array of tables",
    ),
    (
        "supply_pressure_pa = 5.0e5",
        "supply_pressure_pa = 0",
        "key `valve.supply_pressure_pa`",
    ),
    (
        "ambient_temperature_k = 293.0",
        "ambient_temperature_k = 20.0",
        "`gas.ambient_temperature_k`",
    ),
    (
        "# Effects beyond",
        "[tolerance.muscles]\n# Effects",
        "key `tolerance.muscles`: expected one of",
    ),
    (
        "# [[effect]]",
        "[[effect]]\nname = \"leek\"",
        "key `effect.name`: expected one of",
    ),
    (
        "# [[effect]]",
        "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4e-9\n\n\
         [[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4.0e-9",
        "key `effect.name`: expected each effect once",
    ),
    (
        "# [[effect]]",
        "[[effect]]\nname = \"leak\"",
        "key `effect.conductance_kg_per_pa_s`",
    ),
];

/// Complete records, and the expected message.
const RECORDS: [(&str, &str); 32] = [
    ("", ":1: expected a"),
    ("\n\n\n", ":1: expected a"),
    (
        "time_s,contraction\n",
        ":2: expected at least one row of samples, found none",
    ),
    (
        "contraction\n0\n",
        ":1: expected a header line with a column `time_s`",
    ),
    (
        "time,contraction\n0,0\n",
        ":1: column `time`: expected the name of a known column: did you mean `time_s`?",
    ),
    (
        "0,1\n0.01,1\n",
        ":1: expected a header line with a column `time_s`",
    ),
    (
        "time_s,time_s\n0,0\n",
        ":1: expected each column once, found `time_s` again",
    ),
    (
        "time_s,,contraction\n0,0,0\n",
        ":1: expected a name for column 2, found none",
    ),
    (
        "time_s,pressure_ref_pa\n0,0,0\n",
        ":2: expected 2 cells as in the header, found 3",
    ),
    (
        "time_s,pressure_ref_pa\n0\n",
        ":2: expected 2 cells as in the header, found 1",
    ),
    (
        "time_s;pressure_ref_pa\n0;0\n",
        ":1: expected a header line with a column `time_s`, found `time_s;pressure_ref_pa`",
    ),
    (
        "time_s,pressure_ref_pa\n0,\n1,1e5\n",
        ":2: column `pressure_ref_pa`: expected a reference",
    ),
    (
        "time_s,pressure_ref_pa\n0,abc\n",
        ":2: column `pressure_ref_pa`: expected a number",
    ),
    (
        "time_s,pressure_ref_pa\n0,1e9\n",
        ":2: column `pressure_ref_pa`: expected a number from",
    ),
    (
        "time_s,pressure_ref_pa\n0,inf\n",
        ":2: column `pressure_ref_pa`: expected a number or",
    ),
    (
        "time_s,pressure_ref_pa\n0,NaN\n",
        ":2: column `pressure_ref_pa`: expected a number or an empty cell, found `NaN` (`hil-sim",
    ),
    (
        "time_s,pressure_ref_pa\n0,\"1\n",
        ":2: expected a closing quote",
    ),
    (
        "time_s,pressure_ref_pa\n,1\n",
        ":2: column `time_s`: expected a time in every row",
    ),
    (
        "time_s,pressure_ref_pa\n0,1\n0,1\n",
        ":3: column `time_s`: expected a time after 0",
    ),
    (
        "time_s,pressure_ref_pa\n0,1\n-1,1\n",
        ":3: column `time_s`: expected a time after 0",
    ),
    (
        "time_s,pressure_ref_pa\n0,1\n0x1,1\n",
        ":3: column `time_s`: expected a number",
    ),
    (
        "time_s,contraction\n0,0\n",
        ": column `pressure_pa`: expected this column, found none",
    ),
    (
        "time_s,pressure_pa\n0,\n1,\n",
        ": column `pressure_pa`: expected at least one sample",
    ),
    (
        "time_s,pressure_ref_pa,contraction\n0,0,7\n",
        ": column `contraction`: expected contractions y/L as a ratio",
    ),
    // Milliseconds, microseconds.
    (
        "time_s,pressure_ref_pa\n0,1e5\n1e9,2e5\n2e9,1e5\n",
        ":3: column `time_s`: expected seconds, at most 10000 from row to row",
    ),
    // Blank lines are not rows, but count as lines.
    (
        "time_s,pressure_ref_pa\n\n\n0,abc\n",
        ":4: column `pressure_ref_pa`: expected a number",
    ),
    (
        "time_s,pressure_ref_pa\r\n\r\n0,1e5\r\n1,abc\r\n",
        ":4: column `pressure_ref_pa`: expected a number",
    ),
    (
        "time_s,pressure_ref_pa,note\n0,1e5,\"a\nb\"\n\n1,1e5\n",
        ":5: expected 3 cells",
    ),
    (
        "time_s,pressure_ref_pa\n\n0,\n1,1e5\n",
        ":3: column `pressure_ref_pa`: expected a reference in the first row",
    ),
    // Below vacuum.
    (
        "time_s,pressure_pa\n0,1e5\n\n1,-1e7\n",
        ":4: column `pressure_pa`: expected a gauge pressure above vacuum",
    ),
    (
        "time_s,pressure_ref_pa,pressure_pa\n0,1e5,\n0.1,1e5,-2e5\n",
        ": column `pressure_pa`: expected gauge pressures, which fill the muscle",
    ),
    (
        "time_s,pressure_ref_pa,note\n0,1e5,5\" hose\n1,1e5,\"x\n",
        ":3: expected a closing quote",
    ),
];

fn rig_with(from: &str, to: &str) -> String {
    assert!(Rig::REFERENCE_TOML.contains(from), "{from}");
    Rig::REFERENCE_TOML.replacen(from, to, 1)
}

/// Runs `simulate` in `folder` on the bytes of a rig and a record: exit status and stderr.
fn run(folder: &Path, rig: &[u8], record: &[u8]) -> (Option<i32>, String) {
    let out = folder.join("sim.csv");
    std::fs::write(folder.join("rig.toml"), rig).expect("written");
    std::fs::write(folder.join("drive.csv"), record).expect("written");
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args([
            // The columns that nothing reads would be a line, too.
            "-q",
            "simulate",
            "--rig",
            "rig.toml",
            "--drive",
            "drive.csv",
            "--out",
            "sim.csv",
        ])
        .output()
        .expect("the command runs");
    assert_eq!(
        out.exists(),
        output.status.success(),
        "a record, whole or not at all"
    );
    let _ = std::fs::remove_file(out);
    (
        output.status.code(),
        String::from_utf8(output.stderr).expect("text"),
    )
}

fn assert_refused(result: (Option<i32>, String), file: &str, says: &str) {
    let (status, message) = result;
    assert_eq!(status, Some(2), "{message}, should say {says}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(
        message.starts_with(&format!("hil-sim: {file}")),
        "{message}"
    );
    assert!(message.contains(says), "{message}\nshould say: {says}");
}

#[test]
fn malformed_rigs_are_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    for (from, to, says) in RIGS {
        let rig = rig_with(from, to);
        let result = run(folder.path(), rig.as_bytes(), RECORD.as_bytes());
        assert_refused(result, "rig.toml", says);
    }
    let result = run(folder.path(), b"schema = 1 # \xff", RECORD.as_bytes());
    assert_refused(result, "rig.toml", "expected text in UTF-8");
}

#[test]
fn rigs_that_lack_a_section_for_the_record_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let until = |end: &str| {
        Rig::REFERENCE_TOML
            .split(end)
            .next()
            .expect("a begin")
            .to_owned()
    };
    for (rig, says) in [
        (until("[muscle]"), "key `muscle`: expected this section"),
        (until("[load]"), "key `load`: expected this section"),
        (
            until("[valve]"),
            "key `valve`: expected this section, as the record has a `pressure_ref_pa`",
        ),
        (
            until("[gas]"),
            "key `gas`: expected this section, as the pressure is simulated",
        ),
        (
            Rig::REFERENCE_TOML.replace("volume_d", "# volume_d"),
            "key `muscle.volume_d1_m3`: expected the volume, as the pressure is simulated",
        ),
    ] {
        let result = run(folder.path(), rig.as_bytes(), RECORD.as_bytes());
        assert_refused(result, "rig.toml", says);
    }
}

#[test]
fn malformed_records_are_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let rig = Rig::REFERENCE_TOML.as_bytes();
    for (record, says) in RECORDS {
        let result = run(folder.path(), rig, record.as_bytes());
        assert_refused(result, "drive.csv", says);
    }
    let rows = (0..103).map(|row| format!("{},1e5\n", 9_999 * row));
    let long = "time_s,pressure_ref_pa\n".to_owned() + &rows.collect::<String>();
    let result = run(folder.path(), rig, long.as_bytes());
    let says = ":103: column `time_s`: expected seconds, at most 1000000 in all";
    assert_refused(result, "drive.csv", says);
    let result = run(folder.path(), rig, b"time_s,pressure_ref_pa\n0,\xff\n");
    assert_refused(result, "drive.csv", ":2: expected text in UTF-8");
}

#[test]
fn missing_files_are_named() {
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .args([
            "simulate",
            "--rig",
            "no/rig.toml",
            "--drive",
            "no.csv",
            "--out",
            "no.csv",
        ])
        .output()
        .expect("the command runs");
    let message = String::from_utf8(output.stderr).expect("text");
    assert_refused(
        (output.status.code(), message),
        "no/rig.toml",
        "expected a readable TOML file",
    );
}

/// `text` with a few of its bytes replaced, removed, or doubled.
fn mutated(text: &'static str) -> impl Strategy<Value = Vec<u8>> {
    let change = (0..text.len(), 0..4_u8, any::<u8>(), 1..40_usize);
    prop::collection::vec(change, 0..6).prop_map(move |changes| {
        let mut bytes = text.as_bytes().to_vec();
        for (place, how, byte, length) in changes {
            let place = place.min(bytes.len().saturating_sub(1));
            let end = (place + length).min(bytes.len());
            match how {
                0 if !bytes.is_empty() => bytes[place] = byte,
                // Characters that are significant in numbers and tables.
                1 => bytes.insert(place, b"-.e9,\n\"=[]#0"[usize::from(byte) % 12]),
                2 => drop(bytes.drain(place..end)),
                _ => {
                    let piece = bytes[place..end].to_vec();
                    bytes.splice(place..place, piece);
                }
            }
        }
        bytes
    })
}

fn simulated(rig: &[u8], record: &[u8]) -> Result<Record, String> {
    let text = std::str::from_utf8(rig).map_err(|error| error.to_string())?;
    let rig = Rig::parse("rig.toml", text).map_err(|error| error.to_string())?;
    let record = Record::parse("drive.csv", record).map_err(|error| error.to_string())?;
    simulate(&rig, &record, 1e-4).map_err(|error| error.to_string())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    /// No panic, at most one line of error, and finite numbers from accepted files.
    #[test]
    fn fuzzed_files_are_accepted_or_refused_in_one_line(
        rig in mutated(Rig::REFERENCE_TOML),
        record in mutated(RECORD),
        which in 0..3,
    ) {
        let rig = if which == 0 { Rig::REFERENCE_TOML.as_bytes() } else { &rig };
        let record = if which == 1 { RECORD.as_bytes() } else { &record };
        match simulated(rig, record) {
            Err(message) => prop_assert_eq!(message.lines().count(), 1, "{}", message),
            Ok(simulated) => for column in ["pressure_pa", "contraction", "force_n"] {
                let values = simulated.column(column).expect("simulated");
                prop_assert!(values.iter().all(|value| value.is_finite()));
            },
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn fuzzed_files_end_with_status_0_or_2(
        rig in mutated(Rig::REFERENCE_TOML),
        record in mutated(RECORD),
    ) {
        let folder = tempfile::tempdir().expect("a folder");
        let (status, message) = run(folder.path(), &rig, &record);
        prop_assert!(matches!(status, Some(0 | 2)), "{:?}: {}", status, message);
        prop_assert_eq!(message.lines().count(), usize::from(status == Some(2)));
    }
}

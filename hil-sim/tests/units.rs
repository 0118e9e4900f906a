//! Records whose numbers are not in the units that their names say: found, named, and converted
//! back by the command that the error names.
//!
//! The records are those of `truth`: rigs and effects drawn at random, with noise.

use hil_sim::record::check::{Finding, check};
use hil_sim::record::import::Map;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, TIME_S};
use hil_sim::rig::Rig;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;
use truth::{Case, drawn};

const SEED: u64 = 22;
const COUNT: u64 = 6;

/// A rig with one record of it.
struct Measured {
    rig: Rig,
    text: String,
}

/// Cases of which the first record is used.
static CASES: LazyLock<Vec<Measured>> = LazyLock::new(|| {
    let case = |index| drawn::case(SEED, index);
    let cases = (0..COUNT).map(case);
    let measured = cases.map(|case: Case| Measured {
        rig: Rig::parse("rig.toml", &case.rig_toml).expect("a rig"),
        text: case.fit[0].clone(),
    });
    measured.collect()
});

fn doubts(text: &str, rig: Option<&Rig>) -> Vec<Finding> {
    let record = Record::parse("a.csv", text.as_bytes()).expect("a record");
    check(&record).units(&record, rig)
}

/// `text` with another value in each cell of some columns.
fn changed(text: &str, columns: &[&str], value: impl Fn(f64) -> f64) -> String {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut out = header.join(",") + "\n";
    for line in lines {
        let cells = line.split(',').zip(&header).map(|(cell, name)| {
            match (columns.contains(name), cell.parse::<f64>()) {
                (true, Ok(number)) => value(number).to_string(),
                _ => cell.into(),
            }
        });
        out += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    out
}

/// The options of the `hil-sim import` that the findings name.
fn options(findings: &[Finding]) -> Vec<String> {
    let Some(Finding::Unit { command, .. }) = findings.first() else {
        return Vec::new();
    };
    let mut words = command.split(' ');
    let mut options = Vec::new();
    while let Some(word) = words.next() {
        if word == "--unit" {
            options.extend(words.next().map(str::to_owned));
        }
    }
    options
}

#[test]
fn records_in_si_units_are_not_doubted() {
    for (case, Measured { rig, text }) in CASES.iter().enumerate() {
        assert_eq!(rig.check_units(), Ok(()), "{case}");
        assert_eq!(doubts(text, Some(rig)), [], "{case}");
        assert_eq!(doubts(text, None), [], "{case}, without its rig");
    }
}

/// Converted back by the named command, a record is the original one again.
#[test]
fn a_record_in_other_units_is_named_with_the_command_that_converts_it() {
    let pressures = [PRESSURE_PA, PRESSURE_REF_PA];
    let by = |size: f64| move |value: f64| value / size;
    for (case, Measured { rig, text }) in CASES.iter().enumerate() {
        let mm = rig.nominal.muscle.initial_length_m * 1e3;
        let has_force = text.lines().next().expect("a header").contains(FORCE_N);
        let mut others = vec![
            ("bar", changed(text, &pressures, by(1e5))),
            ("kPa", changed(text, &pressures, by(1e3))),
            ("MPa", changed(text, &pressures, by(1e6))),
            ("psi", changed(text, &pressures, by(6_894.757_293_168_361))),
            ("kPa", changed(text, &[PRESSURE_PA], by(1e3))),
            ("bar", changed(text, &[PRESSURE_REF_PA], by(1e5))),
            ("scale=-1", changed(text, &[PRESSURE_PA], by(-1.0))),
            ("contraction=%", changed(text, &[CONTRACTION], by(0.01))),
            ("contraction=1", changed(text, &[CONTRACTION], by(1.0 / mm))),
            (
                "contraction=1",
                changed(text, &[CONTRACTION], by(10.0 / mm)),
            ),
            (
                "contraction=1",
                changed(text, &[CONTRACTION], by(1000.0 / mm)),
            ),
            (
                "contraction=1,scale=-",
                changed(text, &[CONTRACTION], |ratio| 1e-3 * mm * (1.0 - ratio)),
            ),
            (
                "contraction=1,scale=-1",
                changed(text, &[CONTRACTION], by(-1.0)),
            ),
            ("time_s=ms", changed(text, &[TIME_S], by(1e-3))),
            ("time_s=h", changed(text, &[TIME_S], by(3600.0))),
        ];
        if has_force {
            others.push(("force_n=kN", changed(text, &[FORCE_N], by(1e3))));
            others.push(("force_n=N,scale=-1", changed(text, &[FORCE_N], by(-1.0))));
        }
        // Where the force law is too uncertain to tell, nothing is said.
        let absolute = changed(text, &pressures, |pa| pa + 101_325.0);
        let absolute = options(&doubts(&absolute, Some(rig)));
        let is_offset = |option: &String| option.contains("_pa=Pa,offset=-");
        assert!(absolute.iter().all(is_offset), "case {case}: {absolute:?}");
        let original = Record::parse("a.csv", text.as_bytes()).expect("a record");
        for (unit, other) in others {
            let options = options(&doubts(&other, Some(rig)));
            assert!(
                !options.is_empty() && options.iter().all(|option| option.contains(unit)),
                "case {case}: {unit}: {options:?}"
            );
            let map = Map::of_record("a.csv", other.as_bytes(), &options).expect("options");
            let back = map.import("a.csv", other.as_bytes()).expect("a record");
            for column in [PRESSURE_PA, PRESSURE_REF_PA, CONTRACTION, FORCE_N] {
                let values = (back.record.column(column), original.column(column));
                let (Some(back), Some(original)) = values else {
                    assert_eq!(values.0, values.1);
                    continue;
                };
                let largest = original
                    .iter()
                    .copied()
                    .fold(0.0, |a: f64, b| a.max(b.abs()));
                let is_near = |(a, b): (&f64, &f64)| {
                    (a - b).abs() <= 1e-9 * largest || a.is_nan() && b.is_nan()
                };
                assert!(back.iter().zip(original).all(is_near), "{unit}: {column}");
            }
        }
    }
}

/// On the tutorial's kind of rig with a vented muscle.
#[test]
fn absolute_pressures_are_named() {
    // 40 s: vented, then steps of 1 and 3 bar that a valve follows within 50 ms.
    let mut text = String::from("time_s,pressure_ref_pa,pressure_pa,contraction\n");
    let mut pressure_pa: f64 = 0.0;
    for row in 0..4000_u32 {
        let reference_pa = [0.0, 1e5, 3e5][row as usize / 400 % 3];
        pressure_pa += 0.2 * (reference_pa - pressure_pa);
        let noise_pa = f64::from(row * 7919 % 101);
        let contraction = f64::max(0.0, 1e-6 * (pressure_pa - 1.3e5));
        text += &format!(
            "{},{reference_pa},{},{contraction}\n",
            f64::from(row) / 100.0,
            pressure_pa + noise_pa
        );
    }
    assert_eq!(doubts(&text, None), []);
    for column in [PRESSURE_PA, PRESSURE_REF_PA] {
        let absolute = changed(&text, &[column], |pa| pa + 1.01e5);
        let expected = format!("{column}=Pa,offset=-101325");
        assert_eq!(options(&doubts(&absolute, None)), [expected]);
    }
}

/// Runs `hil-sim` in `folder`.
fn run(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("hil-sim runs");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

#[test]
fn commands_refuse_other_units_and_accept_them_if_told_to() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let write = |name: &str, text: &str| {
        std::fs::write(folder.join(name), text).expect("written");
    };
    let text = &CASES[0].text;
    write("rig.toml", &Rig::template());
    write(
        "a.csv",
        &changed(text, &[PRESSURE_PA, PRESSURE_REF_PA], |pa| pa / 1e5),
    );
    let command = "hil-sim import a.csv --unit pressure_ref_pa=bar --unit pressure_pa=bar --out \
                   new.csv";
    let simulate = [
        "simulate", "--rig", "rig.toml", "--drive", "a.csv", "--out", "s.csv",
    ];
    let diagnose = [
        "diagnose",
        "--rig",
        "rig.toml",
        "--fit",
        "a.csv",
        "--validate",
        "b.csv",
        "--out",
        "d",
    ];
    for arguments in [&simulate[..], &diagnose[..]] {
        let (status, _, error) = run(folder, arguments);
        assert_eq!(status, Some(2), "{error}");
        assert!(
            error.starts_with("hil-sim: a.csv: column `pressure_ref_pa`: "),
            "{error}"
        );
        assert!(
            error.contains("most likely bar") && error.contains(command),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    let (status, _, error) = run(folder, &[&simulate[..], &["--accept"]].concat());
    assert_eq!(status, Some(0), "{error}");
    assert!(
        error.starts_with("hil-sim: warning: a.csv: column `pressure_ref_pa`"),
        "{error}"
    );

    let findings = |arguments: &[&str]| {
        let (status, out, error) = run(folder, arguments);
        assert_eq!(status, Some(0), "{error}");
        let json: serde_json::Value = serde_json::from_str(&out).expect("JSON");
        ["errors", "warnings"].map(|list| {
            let list = json[list].as_array().expect("a list");
            list.iter()
                .filter(|finding| finding["finding"] == "unit")
                .count()
        })
    };
    assert_eq!(findings(&["check", "a.csv", "--json"]), [2, 0]);
    assert_eq!(findings(&["check", "a.csv", "--json", "--accept"]), [0, 2]);

    let arguments: Vec<&str> = command.split(' ').skip(1).collect();
    assert_eq!(run(folder, &arguments).0, Some(0));
    assert_eq!(findings(&["check", "new.csv", "--json"]), [0, 0]);
}

#[test]
fn a_rig_in_other_units_is_refused_where_it_is_read_and_accepted_if_told_to() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let rig = Rig::template().replace("5.0e5", "5.0");
    std::fs::write(folder.join("rig.toml"), rig).expect("written");
    for arguments in [
        &["rig", "check", "rig.toml"][..],
        &["design", "--rig", "rig.toml"],
    ] {
        let (status, _, error) = run(folder, arguments);
        assert_eq!(status, Some(2));
        assert!(
            error.contains("most likely bar: write 5e5; --accept takes"),
            "{error}"
        );
    }
    let accept = ["rig", "check", "rig.toml", "--accept"];
    assert_eq!(run(folder, &accept).0, Some(0));
}

/// A record of the assistance with one row each `period_s`: the finger goes up and down once while
/// the pressure follows, and the muscle is vented for most of the time.
fn assistance(period_s: f64, lifts: bool) -> String {
    let mut text =
        String::from("time_s,pressure_ref_pa,pressure_pa,contraction,force_n,finger_m\n");
    for row in 0..200 {
        let share = (f64::from(row - 120) / 40.0).clamp(0.0, 1.0) * f64::from(u8::from(lifts));
        let up = (std::f64::consts::PI * share).sin();
        let force_n = if up > 0.05 { 117.0 } else { -183.0 };
        let [pressure_pa, contraction, finger_m] = [3e5 * up, 0.2 * up, 0.1 * up];
        let time_s = period_s * f64::from(row);
        text +=
            &format!("{time_s},{pressure_pa},{pressure_pa},{contraction},{force_n},{finger_m}\n");
    }
    text
}

#[test]
fn rows_that_are_slower_than_a_person_are_in_ms() {
    let rig = Rig::reference();
    assert_eq!(doubts(&assistance(0.01, true), Some(&rig)), []);
    let found = doubts(&assistance(10.0, true), Some(&rig));
    assert_eq!(options(&found), ["time_s=ms"]);
    let told = found[0].to_string();
    assert!(told.contains("a person moves `finger_m`"), "{told}");
}

#[test]
fn dates_of_a_spreadsheet_are_days() {
    let text = assistance(0.01, true);
    let found = doubts(
        &changed(&text, &[TIME_S], |s| 45_990.5 + s / 86_400.0),
        None,
    );
    assert_eq!(options(&found), ["time_s=d"]);
    let told = found[0].to_string();
    assert!(told.contains("from a spreadsheet's date"), "{told}");
    assert_eq!(
        doubts(&changed(&text, &[TIME_S], |s| 45_990.5 + s), None),
        []
    );
}

/// Eq 1 has a negative force there, as the simulator reads it.
#[test]
fn the_force_of_a_vented_muscle_is_not_of_the_wrong_sign() {
    let rig = Rig::reference();
    assert_eq!(doubts(&assistance(0.01, true), Some(&rig)), []);
    assert_eq!(doubts(&assistance(0.01, false), Some(&rig)), []);
    let other = changed(&assistance(0.01, true), &[FORCE_N], |force_n| -force_n);
    assert_eq!(options(&doubts(&other, Some(&rig))), ["force_n=N,scale=-1"]);
}

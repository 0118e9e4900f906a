//! `hil-sim diagnose` with bad data, with unusual records, and with several threads.

use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

/// The seed of the hidden effects.
const SEED: u64 = 11;

/// The first case of [`SEED`] without hidden effects.
static HEALTHY_INDEX: LazyLock<u64> = LazyLock::new(|| {
    let found = (0..100).find(|index| truth::plan(SEED, *index).kind == truth::Kind::None);
    found.expect("a case without hidden effects")
});

/// A rig without hidden effects, and its records.
static HEALTHY: LazyLock<truth::Case> = LazyLock::new(|| truth::case(SEED, *HEALTHY_INDEX));

/// The first case of a seed with these hidden effects, in the order of the truth's catalogue.
fn hiding(seed: u64, names: &[&str]) -> truth::Case {
    let hides = |index: &u64| {
        let plan = truth::plan(seed, *index);
        let hidden = plan.effects.iter().map(|effect| effect.entry.name);
        hidden.eq(names.iter().copied())
    };
    let index = (0..10_000).find(hides).expect("a case of these effects");
    println!("case {index} of seed {seed}");
    truth::case(seed, index)
}

/// Number of rows used of each record: 8 s.
const ROWS: usize = 800;

/// A rig with a record to fit, a.csv, and one to validate, b.csv; out/ is for results.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Bench {
        Bench::of(&HEALTHY)
    }

    fn of(case: &truth::Case) -> Bench {
        let bench = Bench {
            folder: tempfile::tempdir().expect("a folder"),
        };
        bench.write("rig.toml", &case.rig_toml);
        bench.write("a.csv", &rows(&case.fit[0], ROWS));
        bench.write("b.csv", &rows(&case.validate[0], ROWS));
        bench
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.folder.path().join(name), text).expect("a file");
    }

    fn out(&self) -> std::path::PathBuf {
        self.folder.path().join("out")
    }

    /// Status and stderr of `diagnose` with additional arguments.
    fn run(&self, validate: &str, arguments: &[&str]) -> (Option<i32>, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .current_dir(self.folder.path())
            .args(["diagnose", "--rig", "rig.toml", "--fit", "a.csv"])
            .args(["--validate", validate, "--out", "out"])
            .args(arguments)
            // 2026-11-24 01:20:00 UTC
            .env("SOURCE_DATE_EPOCH", "1795483200")
            .output()
            .expect("the program runs");
        let message = String::from_utf8(output.stderr).expect("text");
        (output.status.code(), message)
    }

    fn diagnosis(&self) -> Value {
        let text = std::fs::read_to_string(self.out().join("diagnosis.json"));
        serde_json::from_str(&text.expect("a diagnosis")).expect("JSON")
    }

    /// Asserts that `bad` is refused as the record to fit and as the one to validate.
    fn refuses(&self, bad: &str, says: &str) {
        for name in ["a.csv", "b.csv"] {
            let good = std::fs::read_to_string(self.folder.path().join(name)).expect("a record");
            self.write(name, bad);
            let result = self.run("b.csv", &[]);
            refused(&result, &self.out(), &[name, "expected", says]);
            self.write(name, &good);
        }
    }
}

fn refused((status, message): &(Option<i32>, String), out: &Path, says: &[&str]) {
    assert_eq!(*status, Some(2), "{message}, should say {says:?}");
    assert_eq!(message.lines().count(), 1, "{message}");
    for words in says {
        assert!(message.contains(words), "{message} should say {words}");
    }
    assert!(!out.exists(), "something was written");
}

/// The header and the first `count` rows.
fn rows(record: &str, count: usize) -> String {
    let lines: Vec<&str> = record.lines().take(1 + count).collect();
    lines.join("\n") + "\n"
}

/// The record with the cells of a column changed; `change` gets the row and the cell.
fn with_cells(record: &str, column: &str, change: impl Fn(usize, &str) -> String) -> String {
    let header = record.lines().next().expect("a header");
    let place = header.split(',').position(|name| name == column);
    let place = place.expect("the column");
    let mut text = format!("{header}\n");
    for (row, line) in record.lines().skip(1).enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[place] = change(row, &cells[place]);
        text += &(cells.join(",") + "\n");
    }
    text
}

/// Removes most effects from the catalogue, so that the test is fast enough without optimisation.
fn few() -> Vec<&'static str> {
    const FEW: [&str; 5] = ["hysteresis", "friction", "leak", "valve-lag", "payload"];
    let names = muscle_plant::effects::Catalogue::standard()
        .kinds()
        .map(|kind| kind.name);
    let others = names.filter(|name| !FEW.contains(name));
    others.flat_map(|name| ["--without", name]).collect()
}

/// A cog that the catalogue lacks gets no name, but a formula: with it the rig predicts a record
/// that nothing has seen, and it is a file of effects of one's own.
#[test]
fn what_has_no_name_gets_a_formula_that_predicts() {
    let case = hiding(6161, &["cogging"]);
    let bench = Bench::of(&case);
    bench.write("a.csv", &case.fit[0]);
    bench.write("b.csv", &case.validate[0]);
    bench.write("c.csv", &case.fit[1]);
    bench.write("d.csv", &case.validate[1]);
    bench.write("unseen.csv", &case.unseen[0]);
    let without = few();
    let more = [
        "--fit",
        "c.csv",
        "--validate",
        "d.csv",
        "--add",
        "formula.toml",
    ];
    let arguments = [&without[..], &more].concat();
    let (status, message) = bench.run("b.csv", &arguments);
    assert_eq!(status, Some(0), "{message}");
    let diagnosis = bench.diagnosis();
    assert_eq!(diagnosis["verdict"], "unexplained");
    assert_eq!(diagnosis["effects"], serde_json::json!([]));
    let terms = diagnosis["formula"]["terms"].as_array().expect("terms");
    assert_eq!(terms[0]["name"], "formula-load-by-turns", "{terms:?}");
    let contraction = |record: &str| -> Vec<f64> {
        let record = hil_sim::record::Record::parse("record.csv", record.as_bytes());
        let record = record.expect("a record");
        record.require("contraction").expect("the column").to_vec()
    };
    let measured = contraction(&case.unseen[0]);
    let gap = |rig: &str| -> f64 {
        let folder = bench.folder.path();
        let status = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .current_dir(folder)
            .args([
                "-q",
                "simulate",
                "--drive",
                "unseen.csv",
                "--out",
                "s.csv",
                "--rig",
                rig,
            ])
            .status();
        assert!(status.expect("the program runs").success());
        let simulated = std::fs::read_to_string(folder.join("s.csv")).expect("a record");
        let pairs = contraction(&simulated).into_iter().zip(&measured);
        let squares = pairs
            .map(|(is, was)| (is - was).powi(2))
            .filter(|square| !square.is_nan());
        (squares.sum::<f64>() / measured.len() as f64).sqrt()
    };
    let [nominal, fitted] = ["rig.toml", "out/rig.fitted.toml"].map(gap);
    assert!(fitted < 0.5 * nominal, "{nominal} {fitted}");
    let declared = std::fs::read_to_string(bench.folder.path().join("formula.toml"));
    let declared = hil_sim::own_effect::from_toml("formula.toml", &declared.expect("written"));
    assert_eq!(declared.expect("effects").len(), terms.len());
}

#[test]
fn insufficient_records_are_refused() {
    let bench = Bench::new();
    let good = rows(&HEALTHY.fit[0], ROWS);
    bench.refuses("", ":1: expected a header line with a column `time_s`");
    bench.refuses(&rows(&good, 0), ":2: expected at least one row of samples");
    bench.refuses(&rows(&good, 50), "at least 100 rows, found 50");
}

#[test]
fn cells_that_are_not_samples_are_refused() {
    let bench = Bench::new();
    let good = rows(&HEALTHY.fit[0], ROWS);
    let at = |row, column, bad: &str| {
        with_cells(&good, column, |own, cell| {
            if own == row { bad } else { cell }.to_owned()
        })
    };
    let back = at(30, "time_s", "0.1");
    bench.refuses(
        &back,
        ":32: column `time_s`: expected a time after 0.29, found 0.1",
    );
    for column in ["pressure_ref_pa", "pressure_pa", "contraction"] {
        for bad in ["NaN", "inf", "high"] {
            let says = format!(":9: column `{column}`: expected a number");
            bench.refuses(&at(7, column, bad), &says);
        }
    }
}

#[test]
fn a_dead_channel_is_refused() {
    let bench = Bench::new();
    let good = rows(&HEALTHY.fit[0], ROWS);
    let all = |column, value: &str| with_cells(&good, column, |_, _| value.to_owned());
    bench.refuses(&all("pressure_pa", "0"), "column `pressure_pa`");
    for column in ["pressure_ref_pa", "pressure_pa", "contraction"] {
        let says = format!("column `{column}`: expected at least one sample");
        bench.refuses(&all(column, ""), &says);
    }
}

#[test]
fn a_dead_encoder_is_not_named_as_an_effect() {
    let bench = Bench::new();
    for name in ["a.csv", "b.csv"] {
        let good = std::fs::read_to_string(bench.folder.path().join(name)).expect("a record");
        bench.write(
            name,
            &with_cells(&good, "contraction", |_, _| "0".to_owned()),
        );
    }
    let (status, message) = bench.run("b.csv", &few());
    if status == Some(2) {
        return refused(&(status, message), &bench.out(), &["a.csv", "contraction"]);
    }
    let found = bench.diagnosis();
    assert_ne!(found["verdict"], "explained", "{}", found["effects"]);
}

#[test]
fn a_record_cannot_be_fitted_and_validated() {
    let bench = Bench::new();
    let says = "a record that is not fitted too";
    let result = bench.run("a.csv", &[]);
    refused(&result, &bench.out(), &["a.csv", "expected", says]);
}

/// Refused with the command that prints the lines to paste, after which it is taken; or taken as
/// exact, which the diagnosis then says.
#[test]
fn a_rig_without_tolerances_is_refused_or_taken_as_exact() {
    let bench = Bench::new();
    let (values, _) = HEALTHY.rig_toml.split_once("[tolerance").expect("some");
    bench.write("rig.toml", values);
    let result = bench.run("b.csv", &few());
    refused(
        &result,
        &bench.out(),
        &["`hil-sim rig tolerances rig.toml`", "--exact"],
    );
    let exact = [&few()[..], &["--exact"]].concat();
    let (status, message) = bench.run("b.csv", &exact);
    assert_eq!(status, Some(0), "{message}");
    let warnings = bench.diagnosis()["warnings"].to_string();
    assert!(
        warnings.contains("rests on its values being exact"),
        "{warnings}"
    );
    let printed = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(bench.folder.path())
        .args(["rig", "tolerances", "rig.toml"])
        .output()
        .expect("the program runs");
    let tables = String::from_utf8(printed.stdout).expect("text");
    bench.write("rig.toml", &format!("{values}{tables}"));
    // With tolerances --exact would say two things.
    let (status, message) = bench.run("b.csv", &exact);
    assert_eq!(status, Some(2), "{message}");
    assert!(
        message.contains("no [tolerance.*] tables with --exact"),
        "{message}"
    );
    let (status, message) = bench.run("b.csv", &few());
    assert_eq!(status, Some(0), "{message}");
}

#[test]
fn an_unknown_effect_cannot_be_removed() {
    let bench = Bench::new();
    let (status, message) = bench.run("b.csv", &["--without", "hysteria"]);
    let first = message.lines().next().unwrap_or_default().to_owned();
    let nearest = "did you mean hysteresis?";
    for words in [
        "--without",
        "hysteria",
        "expected one of hysteresis",
        nearest,
    ] {
        assert!(first.contains(words), "{message}");
    }
    assert_eq!(status, Some(2));
    assert!(!bench.out().exists());
}

#[test]
fn a_rig_of_half_the_length_causes_a_warning_and_no_explanation() {
    let bench = Bench::new();
    let halved = |line: &str| match line.split_once(" = ") {
        Some((key, value)) if key.starts_with("volume_d") || key == "initial_length_m" => {
            let value: f64 = value.parse().expect("a number");
            format!("{key} = {}\n", 0.5 * value)
        }
        _ => format!("{line}\n"),
    };
    let rig: String = HEALTHY.rig_toml.lines().map(halved).collect();
    assert_ne!(rig, HEALTHY.rig_toml);
    bench.write("rig.toml", &rig);
    let (status, message) = bench.run("b.csv", &few());
    assert_eq!(status, Some(0), "{message}");
    let found = bench.diagnosis();
    assert_ne!(found["verdict"], "explained", "{}", found["effects"]);
    let doubts = found["warnings"].to_string();
    assert!(
        doubts.contains("the records may be of another rig"),
        "{doubts}"
    );
    assert!(
        doubts.contains("worse than the nominal one"),
        "nothing is said of the predictions: {doubts}"
    );
    // The report ends each of them with a full stop.
    assert!(!doubts.contains('?'), "{doubts}");
}

/// The reference changes while the shut-off valve is shut, and the person opens it late. A
/// diagnosis that ignored `valve_open` would have a residual of hundreds of standard deviations of
/// the noise.
#[test]
fn a_shut_shut_off_valve_is_not_an_effect() {
    let reference_pa: Vec<f64> = (0..=ROWS)
        .map(|row| if row % 300 < 100 { 2e5 } else { 3.5e5 })
        .collect();
    let shut = (0..=ROWS).map(|row| (450..650).contains(&row));
    let drive = truth::Drive {
        period_s: 0.01,
        reference_pa,
        shut: shut.collect(),
    };
    let bench = Bench::new();
    let record = truth::experiment(SEED, *HEALTHY_INDEX, drive);
    let text = with_cells(&record, "valve_open", |row, cell| match row {
        550..650 => "1".into(),
        _ => cell.into(),
    });
    bench.write("a.csv", &text);
    let (status, message) = bench.run("b.csv", &few());
    assert_eq!(status, Some(0), "{message}");
    let found = bench.diagnosis();
    assert_eq!(found["verdict"], "consistent", "{found}");
}

/// The names of the effects that a diagnosis finds.
fn names(diagnosis: &Value) -> Vec<&str> {
    let effects = diagnosis["effects"].as_array().expect("effects").iter();
    let names = effects.filter_map(|effect| effect["name"].as_str());
    names.collect()
}

fn assert_result_does_not_depend_on_threads(case: &truth::Case, effects: &[&str]) {
    let diagnosis = |threads: &str| {
        let bench = Bench::of(case);
        let arguments = [few(), vec!["--threads", threads]].concat();
        let (status, message) = bench.run("b.csv", &arguments);
        assert_eq!(status, Some(0), "{message}");
        let mut found = bench.diagnosis();
        for stage in found["stages"].as_array_mut().expect("stages") {
            assert!(stage["spent_s"].take().is_number());
        }
        let rig = std::fs::read_to_string(bench.out().join("rig.fitted.toml"));
        (found, rig.expect("a fitted rig"))
    };
    let one = diagnosis("1");
    assert_eq!(names(&one.0), effects);
    for name in ["rig.toml", "a.csv", "b.csv"] {
        let lines = one.1.lines().take_while(|line| line.starts_with('#'));
        let files = lines.filter(|line| line.ends_with(&format!("  {name}")));
        assert_eq!(files.count(), 1, "{}", one.1);
    }
    let rig = hil_sim::rig::Rig::parse("rig.fitted.toml", &one.1).expect("a rig");
    let provenance = rig.provenance.expect("a table");
    assert_eq!(provenance.date.to_string(), "2026-11-24T01:20:00Z");
    assert_eq!(provenance.verdict, one.0["verdict"]);
    for (written, named) in provenance.effects.iter().zip(effects) {
        assert_eq!(written.name, *named);
        // Each effect here is far above the noise.
        assert!(written.probability > 0.9, "{written:?}");
        assert!(!written.ci95.is_empty());
    }
    assert_eq!(provenance.effects.len(), effects.len());
    let files = provenance.records.iter();
    let files: Vec<_> = files
        .map(|r| (&r.source.file[..], &r.used_to[..]))
        .collect();
    assert_eq!(files, [("a.csv", "fit"), ("b.csv", "validate")]);
    assert_eq!(one, diagnosis("2"));
}

#[test]
fn result_does_not_depend_on_the_number_of_threads() {
    assert_result_does_not_depend_on_threads(&HEALTHY, &[]);
}

#[test]
fn result_with_two_effects_does_not_depend_on_the_number_of_threads() {
    assert_result_does_not_depend_on_threads(
        &hiding(SEED, &["valve-lag", "leak"]),
        &["valve-lag", "leak"],
    );
}

/// The offset is small compared with the slack, but observable in equations that do not depend on a
/// slack.
#[test]
fn a_small_effect_is_found_besides_a_large_one_in_other_equations() {
    let case = hiding(2046, &["slack", "contraction-sensor-offset"]);
    let bench = Bench::of(&case);
    bench.write("a.csv", &case.fit[0]);
    bench.write("b.csv", &case.validate[0]);
    let (status, message) = bench.run("b.csv", &[]);
    assert_eq!(status, Some(0), "{message}");
    let found = bench.diagnosis();
    assert_eq!(names(&found), ["slack", "contraction-sensor-offset"]);
}

/// Runs the commands of docs/diagnosis.md; only `out/` is in another place.
#[test]
#[cfg_attr(
    debug_assertions,
    ignore = "needs an optimised build: `cargo test --release --test diagnose`"
)]
fn the_tutorial_prints_its_quoted_results() {
    let tutorial = include_str!("../../docs/diagnosis.md");
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().display().to_string();
    // Without the section that needs a board.
    let (before, after) = tutorial
        .split_once("## The next experiment")
        .expect("the section");
    let (_, after) = after.split_once("## What").expect("the next one");
    let lines = [before, after].into_iter().flat_map(str::lines);
    let lines = lines.filter_map(|line| line.strip_prefix("    "));
    let script: Vec<String> = lines
        .map(|line| line.replace(" out/", &format!(" {out}/")))
        .collect();
    assert_eq!(script.join("\n").matches("cargo run --release").count(), 3);
    let output = Command::new("sh")
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .args(["-e", "-c", &script.join("\n")])
        .output()
        .expect("a shell");
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{message}");
    let printed = String::from_utf8(output.stdout).expect("text");
    for quoted in tutorial.lines().filter_map(|line| line.strip_prefix("> ")) {
        assert!(printed.contains(quoted), "{printed}");
    }
    let read = |name: &str| -> Value {
        let text = std::fs::read_to_string(folder.path().join(name)).expect("a file");
        serde_json::from_str(&text).expect("JSON")
    };
    let found = read("diagnosis/diagnosis.json");
    let verdict = format!("\"verdict\": {}", found["verdict"]);
    assert!(tutorial.contains(&verdict), "{verdict}");
    let effects = found["effects"].as_array().expect("effects");
    assert_eq!(effects.len(), 1);
    assert_eq!(effects[0]["name"], "leak");
    // The confidence interval contains the hidden value.
    let name = "conductance_kg_per_pa_s";
    let answer = read("hidden/held-back/s1-00030/truth.json");
    let hidden = answer["effects"][0]["standard"][name].as_f64();
    let ci95 = &effects[0]["parameters"][name]["ci95"];
    assert!(
        ci95[0].as_f64() <= hidden && hidden <= ci95[1].as_f64(),
        "{ci95}"
    );
    assert!(folder.path().join("unseen.csv").exists());
}

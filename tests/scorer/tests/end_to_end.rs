//! Tests of the command line with a stub instead of `hil-sim`.

use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A stub of the tool, and a folder for the score.
struct Bench(TempDir);

impl Bench {
    fn new() -> Bench {
        let bench = Bench(TempDir::new().expect("a folder"));
        let tool = bench.path("tool");
        fs::write(&tool, include_str!("fake-tool.sh")).expect("a script");
        fs::set_permissions(&tool, fs::Permissions::from_mode(0o755)).expect("a script");
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Sets the stub's result for a case.
    fn says(&self, id: &str, verdict: &str, names: &[&str]) {
        let effect =
            |name: &&str| json!({"name": name, "where": "", "parameters": {}, "alternatives": []});
        let effects: Vec<Value> = names.iter().map(effect).collect();
        let gap = json!({"before": 10003.0, "after": 0.0, "noise": 250.0});
        let diagnosis = json!({
            "schema": 1, "verdict": verdict, "effects": effects,
            "gap": {"pressure_pa": gap, "contraction": gap, "force_n": gap},
            "remaining": {"where": [], "when": ""}, "next_experiment": "",
        });
        fs::write(self.path(&format!("{id}.json")), diagnosis.to_string()).expect("a file");
    }

    fn score(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_score"));
        command.arg(arguments[0]).arg("--out").arg(self.path("out"));
        if ["run", "without"].contains(&arguments[0]) {
            command.arg("--diagnose").arg(self.path("tool"));
        }
        if ["run", "without"].contains(&arguments[0]) {
            command.args(["--family", "catalogue-like"]);
        }
        command.args(&arguments[1..]).output().expect("it runs")
    }

    fn asked(&self) -> usize {
        let asked = fs::read_to_string(self.path("asked")).unwrap_or_default();
        asked.lines().count()
    }
}

fn read(path: &Path) -> Value {
    let text = fs::read_to_string(path).expect("a file");
    serde_json::from_str(&text).expect("JSON")
}

/// The hidden effects of case `index` of seed 5.
fn hidden(index: u64) -> Vec<&'static str> {
    let plan = truth::plan(5, index);
    plan.effects
        .iter()
        .map(|planned| planned.entry.name)
        .collect()
}

#[test]
fn a_run_is_scored_continued_and_repeated() {
    let bench = Bench::new();
    bench.says("s5-00000", "explained", &hidden(0));
    fs::write(bench.path("s5-00001.json"), "{\"schema\": 1").expect("a file");
    fs::write(bench.path("s5-00002.sleep"), "").expect("a file");
    bench.says("s5-00003", "consistent", &[]);
    let few = bench.score(&["run", "--seed", "5", "--count", "2"]);
    assert!(few.status.success(), "{few:?}");
    assert_eq!(bench.asked(), 2);
    // Only this one has a limit that it reaches, however fast the machine is.
    let slow = "run --seed 5 --first 2 --count 1 --time-limit-s 1";
    let slow = bench.score(&slow.split(' ').collect::<Vec<_>>());
    assert!(slow.status.success(), "{slow:?}");
    assert_eq!(bench.asked(), 3);

    let output = bench.score(&["run", "--seed", "5", "--count", "5", "--check"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert_eq!(bench.asked(), 5);
    let text = String::from_utf8(output.stdout).expect("text");
    for part in [
        "not a diagnosis",
        "ended at the time limit",
        "exit status 1: no diagnosis for you",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let score = read(&bench.path("out/score.json"));
    let cases = score["cases"].as_array().expect("cases");
    let outcomes: Vec<&str> = cases
        .iter()
        .filter_map(|case| case["outcome"].as_str())
        .collect();
    assert_eq!(
        outcomes,
        ["right", "no-answer", "no-answer", "right", "no-answer"]
    );
    // the gap is removed entirely, as the stub's simulation equals the record
    assert!(cases[0]["share_unseen"].as_f64().expect("a share") > 1.0);
    assert!(cases[0]["wall_s"].as_f64().expect("a time") > 0.0);
    assert!(cases[0]["peak_memory_bytes"].as_f64().expect("memory") > 1e5);
    assert!(fs::read_to_string(bench.path("out/score.html")).is_ok());

    // other arguments require another run
    let again = bench.score(&["run", "--seed", "5", "--count", "1", "--", "--threads", "1"]);
    assert!(again.status.success());
    assert_eq!(bench.asked(), 6);
    let again = bench.score(&["run", "--seed", "5", "--count", "1", "--again"]);
    assert!(again.status.success());
    assert_eq!(bench.asked(), 7);

    // from existing results, without the tool
    fs::remove_file(bench.path("tool")).expect("it was there");
    let report = bench.score(&["report"]);
    assert!(report.status.success(), "{report:?}");
    assert_eq!(
        read(&bench.path("out/score.json"))["cases"]
            .as_array()
            .map(Vec::len),
        Some(5)
    );
    let mut compare = Command::new(env!("CARGO_BIN_EXE_score"));
    let compare = compare.arg("compare").arg(bench.path("out")).output();
    let table = String::from_utf8(compare.expect("it runs").stdout).expect("text");
    assert!(
        table.contains("| out |") && table.contains("| 3/5 = 60 %"),
        "{table}"
    );
    let shuffled = bench.score(&["shuffled", "--permutations", "20"]);
    assert!(shuffled.status.success(), "{shuffled:?}");
    assert!(bench.path("out/shuffled.html").is_file());
}

#[test]
fn drawn_cases_are_the_default_and_their_set_is_reported() {
    let bench = Bench::new();
    bench.says("d10000-00007", "consistent", &[]);
    let mut command = Command::new(env!("CARGO_BIN_EXE_score"));
    let arguments = ["run", "--seed", "10000", "--first", "7", "--count", "1"];
    command
        .args(arguments)
        .arg("--diagnose")
        .arg(bench.path("tool"));
    let output = command.arg("--out").arg(bench.path("out")).output();
    let output = output.expect("it runs");
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.starts_with("seed 10000, reporting set"), "{said}");
    let score = read(&bench.path("out/score.json"));
    assert_eq!(score["cases"][0]["answer"]["family"], "drawn");
    assert_eq!(score["cases"][0]["outcome"], "right");
    let html = fs::read_to_string(bench.path("out/score.html")).expect("a report");
    assert!(html.contains("Reliability diagram"));
}

#[test]
fn an_effect_is_removed_for_its_own_cases() {
    let bench = Bench::new();
    bench.says("without-payload", "unexplained", &[]);
    bench.says("without-leak", "explained", &["creep"]);
    let arguments = ["without", "payload", "leak", "--seed", "5", "--count", "1"];
    let output = bench.score(&arguments);
    assert!(output.status.success(), "{output:?}");
    let parts = read(&bench.path("out/without.json"));
    assert_eq!(parts[0]["name"], "payload");
    assert_eq!(parts[0]["abstained"]["hits"], 1);
    assert_eq!(parts[1]["misnamed"]["hits"], 1);
    // not repeated, as it was run before
    assert!(bench.score(&arguments).status.success());
    assert_eq!(bench.asked(), 2);
}

#[test]
fn errors_of_running_are_reported() {
    let bench = Bench::new();
    let unknown = bench.score(&["run", "--effect", "gremlins"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("only 0 such cases"));
    fs::remove_file(bench.path("tool")).expect("it was there");
    let gone = bench.score(&["run", "--count", "1"]);
    assert_eq!(gone.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&gone.stderr).contains("tool: No such file"));
    let nothing = bench.score(&["report"]);
    assert_eq!(nothing.status.code(), Some(2));
}

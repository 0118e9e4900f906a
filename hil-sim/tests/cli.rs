//! The command line, run as a user runs it.

use hil_sim::faults::kind::KINDS;
use hil_sim::rig::Rig;
use std::path::Path;
use std::process::{Command, Output};

fn hil_sim(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(args)
        .output()
        .expect("the command runs")
}

/// Runs it and expects success: what is on stdout.
fn stdout(folder: &Path, args: &[&str]) -> String {
    let output = hil_sim(folder, args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{args:?}: {message}");
    String::from_utf8(output.stdout).expect("text")
}

fn json(folder: &Path, args: &[&str]) -> serde_json::Value {
    serde_json::from_str(&stdout(folder, args)).expect("JSON")
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().expect("a number")
}

/// The figures that the paper states or that follow from its numbers (§3.1, §4, §5, Figs 2, 7, 8).
#[test]
fn the_papers_figures_are_reproduced() {
    let folder = tempfile::tempdir().expect("a folder");
    let summary = json(folder.path(), &["paper", "--json"]);
    let natural_hz = number(&summary["natural_frequency_hz"]);
    assert!(
        (natural_hz - 4.0).abs() < 0.05,
        "printed as 4 Hz: {natural_hz}"
    );
    let ratio = number(&summary["volume_ratio"]);
    assert!((5.8..=6.2).contains(&ratio), "{ratio}");
    let needed = number(&summary["flow_gain_needed_kg_per_pa_s"]);
    assert!(
        (2.5e-8..3.5e-8).contains(&needed),
        "3e-8 to its one digit: {needed}"
    );
    let [valve_a, valve_b] = [0, 1].map(|valve| summary["valves"][valve].clone());
    assert_eq!(valve_a["sufficient"], false);
    assert_eq!(valve_b["sufficient"], true);
    let lag_s = |valve: &serde_json::Value| number(&valve["tracking"]["lag_s"]);
    let rms_n = |valve: &serde_json::Value| number(&valve["tracking"]["error_n_rms"]);
    // A sampled controller has a lag of at least one tick: B is within two, A is not.
    assert!(lag_s(&valve_b) < 0.02 && lag_s(&valve_a) > 0.03);
    // The reference rig's figures: 55 N and 5 N in one way to cut the window, ours in another.
    assert!(
        (45.0..65.0).contains(&rms_n(&valve_a)),
        "{}",
        rms_n(&valve_a)
    );
    assert!((4.0..6.0).contains(&rms_n(&valve_b)), "{}", rms_n(&valve_b));
    let peak_n = number(&valve_b["tracking"]["reference_force_n_max"]);
    assert!(peak_n < 165.0, "{peak_n}");
    for file in ["out/report.html", "out/valve-A.csv", "out/valve-B.csv"] {
        assert!(folder.path().join(file).exists(), "{file}");
    }
}

#[test]
fn the_text_output_contains_the_verdict() {
    let folder = tempfile::tempdir().expect("a folder");
    let words = stdout(folder.path(), &[]);
    assert!(
        words.contains("valve A") && words.contains("valve B"),
        "{words}"
    );
    assert!(words.contains("4.00 Hz"), "{words}");
}

#[test]
fn without_a_command_the_options_of_paper_apply() {
    let folder = tempfile::tempdir().expect("a folder");
    let paper = json(folder.path(), &["paper", "--json"]);
    assert_eq!(json(folder.path(), &["--json", "--out", "other"]), paper);
    assert!(folder.path().join("other/report.html").exists());
    let both = hil_sim(folder.path(), &["--json", "design"]);
    assert_eq!(both.status.code(), Some(2));
    let help = stdout(folder.path(), &["--help"]);
    assert!(
        help.contains("compare with the paper") && help.contains("--rig"),
        "{help}"
    );
}

#[test]
fn a_case_of_the_fault_campaign_is_printed_as_text_or_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    // Found by its name, as the numbers of cases change with the kinds of faults.
    let named = |name| {
        let found = KINDS.iter().position(|kind| kind.name == name);
        found.expect("a kind")
    };
    let case = named("wire of the emergency stop broken") + 16 * KINDS.len();
    let case_text = case.to_string();
    let args = ["faults", "--case", &case_text];
    let words = stdout(path, &args);
    assert!(words.contains("It violates none of its bounds."), "{words}");
    let outcome = json(path, &[&args[..], &["--json"]].concat());
    assert_eq!(outcome["case"], case);
    let fault = outcome["fault"].as_str().expect("a name");
    let reason = outcome["reason"].as_str().expect("a fault that latches");
    let latched = format!(
        "{reason} latched after {:.2} s",
        number(&outcome["latched_after_s"])
    );
    let bounds = &outcome["bounds"];
    let pressure = [&outcome["pressure_pa_max"], &bounds["pressure_pa"]];
    let [highest, bound] = pressure.map(|pa| format!("{:.0} kPa", 1e-3 * number(pa)));
    for shown in [fault, &latched, &highest, &bound] {
        assert!(words.contains(shown), "{shown}: {words}");
    }
    assert!(path.join(format!("out/fault-{case}.csv")).exists());
    // The emergency stop is pressed, and nothing sees it.
    let pressed = (named("emergency stop pressed") + KINDS.len()).to_string();
    let args = ["faults", "--case", &pressed, "--without", "EmergencyStop"];
    let output = hil_sim(path, &args);
    let words = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(
        words.contains("It violates bounds: reason late."),
        "{words}"
    );
}

#[test]
fn a_seed_reproduces_a_run_exactly() {
    let folder = tempfile::tempdir().expect("a folder");
    let record = |out: &str, seed: &str| {
        stdout(
            folder.path(),
            &["run", "--out", out, "--seed", seed, "--duration", "3"],
        );
        std::fs::read(folder.path().join(out).join("valve-B.csv")).expect("the record")
    };
    let first = record("a", "7");
    assert_eq!(first, record("b", "7"));
    assert_ne!(first, record("c", "8"));
}

#[test]
fn a_run_is_reproduced_from_its_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new"]);
    let first = json(path, &["run", "--rig", "rig.toml", "--out", "a", "--json"]);
    let args = [
        "run",
        "--rig",
        "rig.toml",
        "--finger",
        "a/assist.csv",
        "--out",
        "b",
        "--json",
    ];
    let again = json(path, &args);
    let lift_m = |run: &serde_json::Value| number(&run["runs"][0]["tracking"]["lift_m_max"]);
    // The finger's motion is recorded at the ticks, the only times at which it is used.
    assert!((lift_m(&first) - lift_m(&again)).abs() < 1e-12);
    let simulate = [
        "simulate",
        "--rig",
        "rig.toml",
        "--drive",
        "a/assist.csv",
        "--out",
        "s.csv",
    ];
    stdout(path, &simulate);
    let simulated = std::fs::read_to_string(path.join("s.csv")).expect("a record");
    assert!(
        simulated
            .lines()
            .next()
            .is_some_and(|header| header.contains("finger_m"))
    );
}

#[test]
fn design_prints_the_required_flow_gain() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let rig = stdout(path, &["rig", "new"]);
    assert_eq!(rig, "");
    let rig = std::fs::read_to_string(path.join("rig.toml")).expect("a rig");
    let valve_a = rig.replace(
        "flow_gain_kg_per_pa_s = 1.3e-7",
        "flow_gain_kg_per_pa_s = 6.1e-9",
    );
    std::fs::write(path.join("a.toml"), valve_a).expect("written");
    let design = |rig: &str| json(path, &["design", "--rig", rig, "--json"]);
    assert_eq!(design("rig.toml")["sufficient"], true);
    assert_eq!(design("a.toml")["sufficient"], false);
    // Both need the same valve, and a valve with the flow on its data sheet is sufficient.
    let needed = &design("a.toml")["valve_needed"];
    for (symbol, key, sufficient) in [
        ("Q", "nominal_flow_l_per_min", 1.001),
        ("Q", "nominal_flow_l_per_min", 0.999),
        ("C", "conductance_dm3_per_s_bar", 1.001),
        ("Kv", "kv_m3_per_h", 1.001),
        ("Cv", "cv_us_gal_per_min", 0.999),
    ] {
        let valve = format!("{symbol}={}", sufficient * number(&needed[key]));
        stdout(
            path,
            &["rig", "new", "b.toml", "--force", "--valve", &valve],
        );
        assert_eq!(design("b.toml")["sufficient"], sufficient > 1.0, "{valve}");
    }
    let text = stdout(path, &["design", "--rig", "a.toml"]);
    assert!(
        text.contains(" l/min (ANR) from 6 to 5 bar, C = "),
        "{text}"
    );
    assert!(
        text.contains("a proportional directional valve of "),
        "{text}"
    );
}

/// A table of Eq 1 with the paper's constants, in bar and percent, rounded to 1 N.
fn muscle_table() -> String {
    let mut table = String::from("pressure_bar,contraction_percent,force_n\n");
    for pressure_bar in 1..=5 {
        for contraction_percent in [0, 5, 10, 15, 20] {
            let shortened = 1.0 - f64::from(contraction_percent) / 100.0;
            let area_m2 = 3.7718e-3 * shortened * shortened - 1.39e-3;
            let force_n = area_m2 * f64::from(pressure_bar) * 1e5 - 183.0;
            if force_n > 0.0 {
                table += &format!("{pressure_bar},{contraction_percent},{force_n:.0}\n");
            }
        }
    }
    table
}

#[test]
fn a_rig_is_made_from_data_sheets() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("table.csv"), muscle_table()).expect("written");
    let sheets = "--muscle table.csv --length 0.3 --diameter 0.02 --braid-angle 25 --valve Q=700";
    let sheets: Vec<_> = sheets.split(' ').collect();
    let new = [
        &["rig", "new", "--json", "--report", "fit.html"],
        sheets.as_slice(),
    ]
    .concat();
    let summary = json(path, &new);
    let value = |key: &str, what: &str| {
        let values = summary["values"].as_array().expect("values");
        let value = values.iter().find(|value| value["key"] == key);
        number(&value.expect("the key")[what])
    };
    // Forces rounded to 1 N, of some 100 to 1000 N, move the constants by less than 1 %.
    for (key, expected) in [
        ("alpha_m2", 3.7718e-3),
        ("beta_m2", -1.39e-3),
        ("gamma_n", -183.0),
    ] {
        assert!((value(key, "value") / expected - 1.0).abs() < 0.01, "{key}");
    }
    // Muscles of a type differ; a measured one has the fit's tolerance alone.
    assert!(value("alpha_m2", "relative_sigma") >= 0.05);
    let measured = [&["--measured", "--force"], new.as_slice()];
    let measured = json(path, &[measured[1], measured[0]].concat());
    assert!(number(&measured["values"][0]["relative_sigma"]) < 0.01);
    stdout(path, &["rig", "check", "rig.toml"]);
    let rig = std::fs::read_to_string(path.join("rig.toml")).expect("a rig");
    assert!(rig.contains("[tolerance.muscle]\nalpha_m2 = "), "{rig}");
    assert!(path.join("fit.html").exists());
    // It has all that a design needs.
    assert_eq!(
        json(path, &["design", "--rig", "rig.toml", "--json"])["sufficient"],
        true
    );
    // The values' tolerances stand where the template's did.
    let place = |key: &str| rig.rfind(&format!("\n{key} = ")).expect("the key");
    assert!(place("alpha_m2") < place("gamma_n") && place("gamma_n") < place("initial_length_m"));
    // Without a volume, the template's would be that of another muscle.
    let bench = "rig new bench.toml --muscle table.csv --length 0.3";
    stdout(path, &bench.split(' ').collect::<Vec<_>>());
    let bench = std::fs::read_to_string(path.join("bench.toml")).expect("a rig");
    assert!(!bench.contains("volume_d1_m3"), "{bench}");
}

#[test]
fn a_bad_data_sheet_leaves_no_rig() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("table.csv"), "pressure,force_n\n1,2\n").expect("written");
    for (arguments, says) in [
        (
            "--muscle table.csv --length 0.3",
            "table.csv:1: expected a column contraction or",
        ),
        (
            "--muscle absent.csv --length 0.3",
            "absent.csv: expected a readable CSV file",
        ),
        ("--muscle table.csv", "--length"),
        ("--valve 700", "Q=…[,from=…,to=…]"),
        ("--valve C=2,from=6,to=5", "Q=…[,from=…,to=…]"),
        ("--report fit.html", "--muscle"),
    ] {
        let arguments: Vec<_> = arguments.split(' ').collect();
        let output = hil_sim(path, &[&["rig", "new"], arguments.as_slice()].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(says), "{message}");
        assert!(!path.join("rig.toml").exists());
    }
}

/// What is printed does not change what is written.
#[test]
fn a_template_is_the_same_with_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new", "plain.toml"]);
    let summary = json(path, &["rig", "new", "json.toml", "--json"]);
    assert_eq!(summary["values"], serde_json::json!([]));
    let read = |name: &str| std::fs::read_to_string(path.join(name)).expect("a rig");
    assert_eq!(read("plain.toml"), read("json.toml"));
}

#[test]
fn a_rig_that_cannot_be_written_leaves_no_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let new = "rig new absent/rig.toml --valve Q=700 --report fit.html";
    let output = hil_sim(path, &new.split(' ').collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(2));
    assert!(!path.join("fit.html").exists());
}

/// With an empty table, too, what is printed would be a second one.
#[test]
fn tolerances_are_not_printed_for_a_rig_that_has_a_table() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let template = include_str!("../src/rig/reference_rig.toml");
    std::fs::write(path.join("none.toml"), template).expect("written");
    let printed = stdout(path, &["rig", "tolerances", "none.toml"]);
    assert!(printed.contains("[tolerance.muscle]"), "{printed}");
    let empty = format!("{template}\n[tolerance.muscle]\n");
    std::fs::write(path.join("empty.toml"), empty).expect("written");
    stdout(path, &["rig", "check", "empty.toml"]);
    let output = hil_sim(path, &["rig", "tolerances", "empty.toml"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty());
    assert!(
        message.contains("empty.toml: expected a rig without [tolerance.*]"),
        "{message}"
    );
}

#[test]
fn a_rig_file_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new"]);
    let again = hil_sim(path, &["rig", "new"]);
    assert_eq!(again.status.code(), Some(2));
    stdout(path, &["rig", "new", "--force"]);
    assert!(stdout(path, &["rig", "check", "rig.toml"]).contains("0 effects"));
}

#[test]
fn the_record_of_the_finger_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new"]);
    std::fs::create_dir(path.join("out")).expect("a folder");
    let record = path.join("out/assist.csv");
    let finger = "time_s,finger_m\n0,0\n1,0.01\n";
    std::fs::write(&record, finger).expect("written");
    let finger_s = ["--rig", "rig.toml", "--finger", "out/../out/assist.csv"];
    for command in ["run", "hil"] {
        let output = hil_sim(path, &[&[command][..], &finger_s].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains("would be overwritten"), "{message}");
        assert_eq!(std::fs::read_to_string(&record).expect("there"), finger);
    }
}

#[test]
fn help_completions_and_bad_arguments() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for command in [
        "run",
        "hil",
        "record",
        "replay",
        "paper",
        "design",
        "simulate",
        "effects",
        "rig",
        "completions",
    ] {
        let help = stdout(path, &[command, "--help"]);
        let examples = help.split("Example").nth(1).unwrap_or_default();
        let example = format!("  hil-sim {command}");
        assert!(examples.contains(&example), "{command}: {help}");
        assert!(stdout(path, &["--help"]).contains(command), "{command}");
    }
    assert!(stdout(path, &["rig", "new", "--help"]).contains("  hil-sim rig new"));
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        assert!(
            stdout(path, &["completions", shell]).contains("simulate"),
            "{shell}"
        );
    }
    for args in [
        ["run", "--travel", "NaN"],
        ["run", "--duration", "-1"],
        ["run", "--duration", "0"],
        ["run", "--duration", "0.004"],
        ["design", "--mass", "1e-310"],
        ["run", "--finger", "nothing.csv"],
        ["run", "--output-delay", "0.011"],
    ] {
        let output = hil_sim(path, &args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(!path.join("out").exists(), "nothing written: {args:?}");
    }
    let negative = hil_sim(path, &["run", "--duration", "-1"]);
    let error = String::from_utf8_lossy(&negative.stderr);
    assert!(error.contains("expected a number from 0.01"), "{error}");
}

#[test]
fn effects_are_listed_and_shown_with_lines_that_a_rig_takes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let kinds = json(path, &["effects", "--json"]);
    let listed = stdout(path, &["effects"]);
    let text = |value: &serde_json::Value| value.as_str().expect("text").to_owned();
    let catalogue = muscle_plant::effects::Catalogue::standard();
    for (number, kind) in catalogue.kinds().enumerate() {
        let shown = &kinds[number];
        assert_eq!(shown["name"], kind.name);
        assert_eq!(shown["signature"], kind.signature);
        assert!(listed.contains(&format!("  {}  ", kind.name)), "{listed}");
        for (number, form) in kind.forms.iter().enumerate() {
            assert!(listed.contains(form.name), "{listed}");
            let toml = text(&shown["forms"][number]["toml"]);
            let rig = hil_sim::rig::Rig::REFERENCE_TOML.to_owned() + &toml;
            let rig = hil_sim::rig::Rig::parse("rig.toml", &rig).expect("a rig");
            let typical = form.parameters.iter().map(|parameter| parameter.typical);
            assert_eq!(rig.effects[0].form.name, form.name);
            assert_eq!(rig.effects[0].values, typical.collect::<Vec<_>>());
        }
    }
    let leak = stdout(path, &["effects", "leak"]);
    let shown = json(path, &["effects", "leak", "--json"]);
    for key in ["subsystem", "signature", "test_signal", "compensation"] {
        assert!(leak.contains(&text(&shown[key])), "{key}: {leak}");
    }
    for form in shown["forms"].as_array().expect("forms") {
        for key in ["name", "source", "toml"] {
            assert!(leak.contains(&text(&form[key])), "{key}: {leak}");
        }
    }
    let row = "  conductance_kg_per_pa_s  kg/(Pa·s)  0.0   1e-6";
    assert!(leak.contains(row), "{leak}");
    assert!(refused(path, &["effects", "leek"]).contains("did you mean leak?"));
}

/// Runs it where no firmware or emulated board can be found; expects exit status 2 and one line.
fn refused(folder: &Path, args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .env_remove("FIRMWARE")
        .env_remove("EMULATED_BOARD")
        .env_remove("CARGO_TARGET_DIR")
        .args(args)
        .output()
        .expect("the command runs");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {message}");
    assert_eq!(message.lines().count(), 1, "{args:?}: {message}");
    message
}

#[test]
fn a_misspelled_column_is_refused_by_the_commands_that_would_miss_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("rig.toml"), Rig::REFERENCE_TOML).expect("written");
    let good = "time_s,pressure_ref_pa\n0,1e5\n0.01,1e5\n";
    std::fs::write(path.join("good.csv"), good).expect("written");
    let simulate = "simulate --rig rig.toml --drive bad.csv --out sim.csv";
    for (column, says) in [
        ("presure_pa", "did you mean `pressure_pa`?"),
        ("pressure_bar", "`hil-sim import bad.csv --map map.toml"),
    ] {
        let bad = format!("time_s,pressure_ref_pa,{column}\n0,1e5,1\n0.01,1e5,1\n");
        std::fs::write(path.join("bad.csv"), bad).expect("written");
        for command in [
            "check bad.csv",
            simulate,
            "diagnose --rig rig.toml --fit bad.csv --validate good.csv --out out",
            "diagnose --rig rig.toml --fit good.csv --validate bad.csv --out out",
        ] {
            let args: Vec<&str> = command.split(' ').collect();
            let message = refused(path, &args);
            let place = format!("hil-sim: bad.csv:1: column `{column}`: expected ");
            assert!(message.starts_with(&place), "{message}");
            assert!(message.contains(says), "{message}");
        }
        assert!(!path.join("out").exists() && !path.join("sim.csv").exists());
    }
}

#[test]
fn a_missing_board_or_record_is_reported_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for args in [&["hil"][..], &["hil", "--emulated"]] {
        assert!(refused(path, args).contains("cargo firmware"), "{args:?}");
    }
    for command in [
        &["hil", "--port", "no-port"][..],
        &["record", "--port", "no-port", "--out", "rec.csv"],
    ] {
        let message = refused(path, command);
        assert!(
            message.contains("no-port: expected a serial port"),
            "{message}"
        );
    }
    assert!(!path.join("rec.csv").exists() && !path.join("out").exists());
    std::fs::create_dir_all(path.join("target/thumbv7em-none-eabihf/release")).expect("made");
    let elf = path.join("target/thumbv7em-none-eabihf/release/firmware");
    std::fs::write(&elf, "no ELF").expect("written");
    assert!(refused(path, &["hil"]).contains("found another file"));
    std::fs::write(&elf, "\x7fELF").expect("written");
    assert!(refused(path, &["hil"]).contains("scripts/emulated-hil.sh"));
    let record = |out| ["record", "--port", "no-port", "--out", out];
    assert!(refused(path, &record("rec.mcap")).contains("the CSV file"));
    std::fs::write(path.join("there.csv"), "").expect("written");
    assert!(refused(path, &record("there.csv")).contains("--force"));
    refused(path, &["replay", "nothing.csv"]);
    refused(path, &["replay", "nothing.mcap"]);
    std::fs::write(path.join("not.mcap"), "time_s").expect("written");
    refused(path, &["replay", "not.mcap"]);
}

#[test]
fn a_run_is_replayed_without_a_difference() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["run", "--duration", "3"]);
    let result = json(path, &["replay", "out/valve-B.csv", "--json"]);
    let result = &result["replay"];
    assert_eq!(number(&result["compared_ticks"]), 300.0);
    assert_eq!(number(&result["differing_ticks"]), 0.0);
    assert!(stdout(path, &["replay", "out/valve-A.csv"]).contains("0 of 300 ticks differ."));
    // Half a count and a record without counts cannot be replayed.
    let record = std::fs::read_to_string(path.join("out/valve-B.csv")).expect("a record");
    let half = record.replacen(",None,", ",Nothing,", 1);
    std::fs::write(path.join("half.csv"), half).expect("written");
    assert!(refused(path, &["replay", "half.csv"]).contains("half.csv:2: expected None"));
    std::fs::write(path.join("bare.csv"), "time_s,pressure_pa\n0,1\n").expect("written");
    assert!(refused(path, &["replay", "bare.csv"]).contains("bridge_count"));
}

/// The reference rig in a folder as rig.toml, with something replaced.
fn rig_file(folder: &Path, from: &str, to: &str) {
    let rig = hil_sim::rig::Rig::REFERENCE_TOML;
    assert!(rig.contains(from), "{from}");
    std::fs::write(folder.join("rig.toml"), rig.replacen(from, to, 1)).expect("written");
}

/// Runs `simulate` on rig.toml and the record `drive`: what is on stdout, and the record's text.
fn simulated(folder: &Path, drive: &str) -> (String, String) {
    std::fs::write(folder.join("d.csv"), drive).expect("written");
    let args = "simulate --rig rig.toml --drive d.csv --out s.csv";
    let words = stdout(folder, &args.split(' ').collect::<Vec<_>>());
    let record = std::fs::read_to_string(folder.join("s.csv")).expect("a record");
    (words, record)
}

const DRIVE: &str = "time_s,pressure_ref_pa\n0,100000\n0.1,200000\n";

#[test]
fn the_stability_limit_depends_on_the_product_of_stiffness_and_gain() {
    let folder = tempfile::tempdir().expect("a folder");
    let limits = |gain: &str| {
        rig_file(folder.path(), "gain = 20.0", &format!("gain = {gain}"));
        let design = json(folder.path(), &["design", "--rig", "rig.toml", "--json"]);
        design["stiffness_gain_limits"].clone()
    };
    let paper = limits("20.0");
    assert!(
        (number(&paper["without_delay_n_per_m"]) - 8394.0).abs() < 20.0,
        "{paper}"
    );
    assert!(
        (number(&paper["with_one_tick_n_per_m"]) - 6414.0).abs() < 20.0,
        "{paper}"
    );
    assert_eq!(paper, limits("0.07"));
    assert_eq!(paper, limits("0.0"));
    let words = stdout(folder.path(), &["design", "--rig", "rig.toml"]);
    assert!(
        words.contains("below the examined range") && !words.contains("inf"),
        "{words}"
    );
}

#[test]
fn without_a_measured_pressure_the_initial_pressure_is_the_reference() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    rig_file(path, "kind", "kind");
    let begin = |drive: &str| {
        let (_, record) = simulated(path, drive);
        let mut reader = csv::Reader::from_reader(record.as_bytes());
        let header = reader.headers().expect("a header").clone();
        let column = header.iter().position(|name| name == "pressure_pa");
        let row = reader.records().next().expect("a row").expect("cells");
        let cell = row.get(column.expect("the column")).expect("a cell");
        cell.parse::<f64>().expect("a number")
    };
    for (reference_pa, begins_pa) in [("8e5", 5e5), ("-8e4", 0.0), ("3e5", 3e5)] {
        let drive = format!("time_s,pressure_ref_pa\n0,{reference_pa}\n0.01,2e5\n");
        assert!((begin(&drive) - begins_pa).abs() < 1e-6, "{reference_pa}");
    }
    let measured = "time_s,pressure_ref_pa,supply_pa\n0,8e5,4e5\n0.01,2e5,4e5\n";
    assert!((begin(measured) - 4e5).abs() < 1e-6);
}

#[test]
fn inputs_have_no_gap_and_a_constant_signal_has_no_percentage() {
    let folder = tempfile::tempdir().expect("a folder");
    rig_file(folder.path(), "\"weight\"", "\"prescribed\"");
    let drive = "time_s,pressure_pa,contraction,force_n\n0,123456.7,0.1,10\n\
                 0.01,133333.3,0.11,10\n0.02,123456.1,0.12,10\n";
    let (words, record) = simulated(folder.path(), drive);
    assert!(!words.contains("pressure misses"), "{words}");
    assert!(
        words.contains("force misses") && !words.contains("inf"),
        "{words}"
    );
    assert!(record.contains("0,123456.7,0.1,"), "{record}");
    // A simulated record is reproduced exactly.
    let (words, _) = simulated(folder.path(), &record);
    assert!(
        words.contains("force misses the measured one by 0 N RMS"),
        "{words}"
    );
}

#[test]
fn a_simulated_test_signal_shows_what_the_rig_would_do() {
    let folder = tempfile::tempdir().expect("a folder");
    rig_file(folder.path(), "kind", "kind");
    let (words, _) = simulated(folder.path(), DRIVE);
    assert!(words.contains("nothing is compared"), "{words}");
    let row = |name: &str| {
        words
            .lines()
            .find(|line| line.trim_start().starts_with(name))
    };
    let pressure = row("gauge pressure").expect("its row");
    assert!(pressure.contains("kPa"), "{words}");
    assert!(
        row("contraction").is_some() && row("force").is_some(),
        "{words}"
    );
}

#[test]
fn optional_columns_without_a_sample_are_absent() {
    let folder = tempfile::tempdir().expect("a folder");
    rig_file(folder.path(), "kind", "kind");
    simulated(
        folder.path(),
        "time_s,pressure_ref_pa,supply_pa\n0,1e5,\n0.01,1e5,\n",
    );
    simulated(
        folder.path(),
        "time_s,pressure_ref_pa,pressure_pa\n0,,1e5\n0.01,,1.1e5\n",
    );
    let note = "time_s,pressure_ref_pa,note\n0,1e5,5\" hose\n0.01,1e5,x\n";
    assert!(simulated(folder.path(), note).1.contains("hose"));
}

#[test]
fn outputs_do_not_overwrite_inputs() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    rig_file(path, "kind", "kind");
    std::fs::write(path.join("d.csv"), DRIVE).expect("written");
    for outputs in [
        "--out d.csv",
        "--out ./rig.toml",
        "--out s.csv --report s.csv",
        "--out s.csv --report no/gap.html",
    ] {
        let args = format!("simulate --rig rig.toml --drive d.csv {outputs}");
        let output = hil_sim(path, &args.split(' ').collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(2), "{outputs}");
        assert!(!path.join("s.csv").exists(), "{outputs}");
    }
    let drive = std::fs::read_to_string(path.join("d.csv")).expect("a record");
    assert_eq!(drive, DRIVE);
}

#[cfg(unix)]
#[test]
fn symbolic_links_are_kept_and_streams_are_written_to() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    rig_file(path, "kind", "kind");
    std::fs::write(path.join("d.csv"), DRIVE).expect("written");
    std::fs::write(path.join("real.csv"), "").expect("written");
    std::os::unix::fs::symlink("real.csv", path.join("link.csv")).expect("a link");
    let out = |out: &str| {
        let args = [
            "simulate", "--rig", "rig.toml", "--drive", "d.csv", "--out", out,
        ];
        stdout(path, &args)
    };
    out("link.csv");
    assert!(path.join("link.csv").is_symlink());
    let record = std::fs::read_to_string(path.join("real.csv")).expect("a record");
    assert!(record.starts_with("time_s,"));
    assert!(out("/dev/stdout").starts_with(&record));
}

#[cfg(target_os = "linux")]
#[test]
fn paths_may_contain_invalid_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    std::fs::write(path.join("d.csv"), DRIVE).expect("written");
    let rig = std::ffi::OsStr::from_bytes(b"\xff.toml");
    std::fs::write(path.join(rig), hil_sim::rig::Rig::REFERENCE_TOML).expect("written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command
        .current_dir(path)
        .args(["simulate", "--rig"])
        .arg(rig);
    command.args(["--drive", "d.csv", "--out", "s.csv", "--report", "r.html"]);
    let output = command.output().expect("the command runs");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn run_reports_a_fault_and_shifts_a_recorded_clock() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    rig_file(path, "kind", "kind");
    let run = |begin_s: f64, more: &[&str]| {
        let rows = (0..300).map(|row| {
            let time_s = 0.01 * f64::from(row);
            format!("{},{}\n", begin_s + time_s, 0.12 * time_s.min(1.0))
        });
        let record = "time_s,finger_m\n".to_owned() + &rows.collect::<String>();
        std::fs::write(path.join("f.csv"), record).expect("written");
        let args = ["run", "--rig", "rig.toml", "--finger", "f.csv"];
        json(path, &[&args, more, &["--json"]].concat())["runs"][0].clone()
    };
    for begin_s in [0.0, 1.7e9] {
        let moved = run(begin_s, &[]);
        assert_eq!(moved["fault"], serde_json::Value::Null, "{moved}");
        assert_eq!(moved["mode"], "Assisting");
        assert!(number(&moved["tracking"]["lift_m_max"]) > 0.02, "{moved}");
    }
    // A finger that presses the lever from the start.
    std::fs::write(path.join("f.csv"), "time_s,finger_m\n0,0.05\n20,0.05\n").expect("written");
    let args = ["run", "--rig", "rig.toml", "--finger", "f.csv"];
    let words = stdout(path, &args);
    assert!(words.contains("stopped assisting (LoadedLever)"), "{words}");
    let summary = json(path, &[&args[..], &["--json"]].concat());
    assert_eq!(summary["runs"][0]["fault"], "LoadedLever");
}

#[test]
fn run_and_paper_give_the_same_figures() {
    let folder = tempfile::tempdir().expect("a folder");
    let paper = json(folder.path(), &["paper", "--json"]);
    let tracking = |args: &[&str]| json(folder.path(), args)["runs"][1]["tracking"].clone();
    let run = tracking(&["run", "--json"]);
    assert_eq!(paper["valves"][1]["tracking"], run);
    assert_eq!(tracking(&["run", "--duration", "20", "--json"]), run);
}

#[test]
fn a_rig_that_cannot_run_is_bad_input_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |rig: &str, says: &str| {
        std::fs::write(folder.path().join("rig.toml"), rig).expect("written");
        let output = hil_sim(folder.path(), &["run", "--rig", "rig.toml", "--accept"]);
        let message = String::from_utf8(output.stderr).expect("text");
        assert_eq!(output.status.code(), Some(2), "{message}");
        let is_warning = |line: &&str| line.starts_with("hil-sim: warning: ");
        let errors: Vec<_> = message.lines().filter(|line| !is_warning(line)).collect();
        assert_eq!(errors.len(), 1, "{message}");
        assert!(errors[0].contains(says), "{message}");
    };
    let rig = hil_sim::rig::Rig::REFERENCE_TOML;
    let high = rig.replace("supply_pressure_pa = 5.0e5", "supply_pressure_pa = 5.0e6");
    let line = 1 + high
        .lines()
        .position(|line| line.starts_with("supply"))
        .expect("the key");
    let says = format!("rig.toml:{line}: key `valve.supply_pressure_pa`");
    refused(&high, &says);
    let stiff = rig
        .replace("volume_d1_m3 = -9.90e-4", "volume_d1_m3 = 0.0")
        .replace("volume_d2_m3 = 7.005e-4", "volume_d2_m3 = 0.0")
        .replace("volume_d3_m3 = 2.30e-5", "volume_d3_m3 = 1e-12")
        .replace(
            "flow_gain_kg_per_pa_s = 1.3e-7",
            "flow_gain_kg_per_pa_s = 1e-3",
        );
    refused(
        &stiff,
        "rig.toml: expected a rig whose plant can be integrated",
    );
    let valve_lag = |ms| format!("[[effect]]\nname = \"valve-lag\"\ntime_constant_s = 0.0{ms}\n");
    let lags: String = (11..48).map(valve_lag).collect();
    refused(&(rig.to_owned() + &lags), "key `effect`");
}

#[test]
fn the_papers_report_of_another_rig_distinguishes_the_sources_of_values() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    rig_file(path, "mass_kg = 12.0", "mass_kg = 8.0");
    stdout(path, &["paper", "--rig", "rig.toml"]);
    let report = std::fs::read_to_string(path.join("out/report.html")).expect("a report");
    assert!(!report.contains("with 12 kg") && report.contains("with 8 kg"));
    assert!(report.contains("paper --rig rig.toml"));
}

#[test]
fn a_long_run_is_decimated_in_the_report() {
    let folder = tempfile::tempdir().expect("a folder");
    stdout(folder.path(), &["run", "--duration", "200"]);
    let report = std::fs::metadata(folder.path().join("out/report.html")).expect("a report");
    assert!(report.len() < 2_000_000, "{} bytes", report.len());
}

#[test]
fn the_page_of_effects_is_what_the_effects_declare() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = stdout(folder.path(), &["effects", "--markdown"]);
    assert!(
        page == include_str!("../../docs/effects.md"),
        "repeat: cargo run -- effects --markdown > docs/effects.md"
    );
}

#[test]
fn an_effect_is_shown_with_its_equation_and_plots() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let text = stdout(path, &["effects", "leak", "--report", "leak.html"]);
    for shown in [
        "Form linear: G_leak = conductance_kg_per_pa_s · P",
        "  Leaves out: choking.",
        "Signature: ",
        "Test signal: ",
        "Compensation: none",
        "[[effect]]\nname = \"leak\"",
    ] {
        assert!(text.contains(shown), "{shown}\n{text}");
    }
    let html = std::fs::read_to_string(path.join("leak.html")).expect("a report");
    assert!(html.contains("Change of pressure"));
}

#[test]
fn quiet_leaves_results_and_errors_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for command in [
        ["-q", "rig", "new", "a.toml"],
        ["rig", "new", "b.toml", "--quiet"],
    ] {
        let output = hil_sim(path, &command);
        assert!(output.status.success(), "{command:?}");
        assert_eq!(String::from_utf8_lossy(&output.stderr), "", "{command:?}");
    }
    let loud = hil_sim(path, &["rig", "new", "c.toml"]);
    assert!(String::from_utf8_lossy(&loud.stderr).contains("written: c.toml"));
    let refused = hil_sim(path, &["rig", "new", "a.toml", "-q"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).starts_with("hil-sim: a.toml: expected"));
}

#[test]
fn errors_are_coloured_where_it_is_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    for (when, colored) in [("always", true), ("never", false), ("auto", false)] {
        // One error of the command, one of its arguments.
        for rest in [
            ["rig", "check", "absent.toml"],
            ["rig", "check", "--absent"],
        ] {
            let output = hil_sim(folder.path(), &[&["--color", when][..], &rest].concat());
            assert_eq!(output.status.code(), Some(2));
            assert_eq!(output.stderr.contains(&0x1b), colored, "{when} {rest:?}");
            let message = String::from_utf8_lossy(&output.stderr);
            assert!(message.contains(rest[2]), "{message}");
        }
    }
}

#[test]
fn an_option_of_paper_before_another_command_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = hil_sim(folder.path(), &["--json", "rig", "new"]);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        message.contains("'--json' stands before the command: `hil-sim rig …`"),
        "{message}"
    );
    assert!(!folder.path().join("rig.toml").exists());
}

#[test]
fn completions_and_man_pages_are_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["completions", "--dir", "share"]);
    for (file, says) in [
        ("hil-sim.bash", "diagnose"),
        ("_hil-sim", "diagnose"),
        ("hil-sim.fish", "diagnose"),
        ("hil-sim.1", "hil\\-sim\\-diagnose(1)"),
        ("hil-sim-diagnose.1", "\\-\\-validate"),
        ("hil-sim-rig-new.1", "\\-\\-braid\\-angle"),
    ] {
        let text = std::fs::read_to_string(path.join("share").join(file)).expect(file);
        assert!(text.contains(says), "{file}");
    }
    assert_eq!(hil_sim(path, &["completions"]).status.code(), Some(2));
    let written = json(path, &["completions", "--dir", "share", "--json"]);
    let files = written["files"].as_array().expect("files");
    let entries = std::fs::read_dir(path.join("share")).expect("a folder");
    assert_eq!(files.len(), entries.count());
    assert!(files.contains(&"share/hil-sim-diagnose.1".into()));
    let script = json(path, &["completions", "bash", "--json"]);
    assert_eq!(script["script"], stdout(path, &["completions", "bash"]));
}

/// A campaign of some minutes is interrupted as soon as it has begun.
#[test]
#[cfg(all(unix, feature = "terminal"))]
fn an_interrupt_ends_with_status_130_and_writes_nothing() {
    use std::io::BufRead;
    let folder = tempfile::tempdir().expect("a folder");
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder.path())
        .args(["faults", "--cases", "1000000"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the command runs");
    let mut line = String::new();
    let stderr = child.stderr.take().expect("a pipe");
    let mut stderr = std::io::BufReader::new(stderr);
    stderr.read_line(&mut line).expect("a line");
    assert_eq!(line, "seed: 1\n");
    let kill = format!("kill -INT {}", child.id());
    let killed = std::process::Command::new("sh")
        .args(["-c", &kill])
        .status();
    assert!(killed.expect("a shell").success());
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    let left = std::fs::read_dir(folder.path()).expect("the folder");
    assert_eq!(left.count(), 0);
}

#[cfg(feature = "formats")]
#[test]
fn an_fmu_needs_the_library_of_its_crate() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stdout(path, &["rig", "new", "rig.toml"]);
    let help = stdout(path, &["export", "--help"]);
    assert!(help.contains("  hil-sim export --fmu"), "{help}");
    std::fs::write(path.join("other.so"), "\u{7f}ELF of something else").expect("written");
    for (fmu, library, expected) in [
        (
            "rig.fmu",
            "none.so",
            "none.so: expected the shared library that is built by `cargo build --release -p fmu`",
        ),
        (
            "rig.fmu",
            "other.so",
            "other.so: expected a shared library of the crate `fmu`",
        ),
        (
            "rig.toml",
            "other.so",
            "rig.toml: expected an output that is not an input too",
        ),
    ] {
        let args = ["export", "--fmu", fmu, "--library", library, "rig.toml"];
        let output = hil_sim(path, &args);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(
            message.contains(expected) && message.lines().count() == 1,
            "{message}"
        );
        assert!(!path.join("rig.fmu").exists());
    }
    let mut elf = b"\x7fELF".to_vec();
    elf.resize(64, 0);
    elf[18] = 62;
    elf.extend_from_slice(b"fmi3InstantiateCoSimulation");
    std::fs::write(path.join("library.so"), elf).expect("written");
    let args = [
        "export",
        "--fmu",
        "rig.fmu",
        "--library",
        "library.so",
        "rig.toml",
    ];
    stdout(path, &args);
    assert!(path.join("rig.fmu").exists());
    // The record of another kind of rig gives no initial state.
    std::fs::write(path.join("rec.csv"), "time_s,contraction\n0,0.1\n1,0.1\n").expect("written");
    let output = hil_sim(path, &[&args[..], &["--drive", "rec.csv"]].concat());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        message.contains("column `pressure_ref_pa`: expected this column"),
        "{message}"
    );
}

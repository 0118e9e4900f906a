//! `hil-sim compare`: two diagnoses beside each other.

use hil_sim::rig::{FileHash, Provenance, Rig, UsedRecord};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// Writes a diagnosis that names `effects`, each with its conductance, to a folder.
fn write(folder: &Path, verdict: &str, effects: &[(&str, f64)], gaps: Value) {
    let named = effects.iter().map(|(name, value)| {
        let ci95 = [0.9 * value, 1.1 * value];
        let estimate = json!({ "value": value, "ci95": ci95, "unit": "kg/(Pa·s)" });
        json!({
            "name": name, "where": "gas", "alternatives": [], "evidence": {},
            "parameters": { "conductance_kg_per_pa_s": estimate },
        })
    });
    let diagnosis = json!({
        "schema": 1, "verdict": verdict, "effects": named.collect::<Vec<_>>(), "gap": gaps,
        "remaining": { "where": [], "when": "" }, "next_experiment": "none",
    });
    std::fs::create_dir_all(folder).expect("a folder");
    std::fs::write(folder.join("diagnosis.json"), format!("{diagnosis:#}")).expect("a file");
}

/// Writes a fitted rig that was validated with a record of this hash.
fn write_rig(folder: &Path, sha256: &str) {
    let file = |name: &str| FileHash {
        file: name.into(),
        sha256: sha256.into(),
    };
    let provenance = Provenance {
        tool: "hil-sim".into(),
        version: "0.1.0".into(),
        date: "2026-01-02T03:04:05Z".parse().expect("a date"),
        verdict: "explained".into(),
        nominal_rig: file("rig.toml"),
        records: vec![UsedRecord {
            source: file("v.csv"),
            used_to: "validate".into(),
        }],
        effects: Vec::new(),
    };
    let text = provenance.around(Rig::REFERENCE_TOML).expect("TOML");
    std::fs::write(folder.join("rig.fitted.toml"), text).expect("a file");
}

fn gap(before: f64, after: f64, noise: f64) -> Value {
    json!({ "before": before, "after": after, "noise": noise })
}

/// Status, stdout and stderr of `compare` in `folder`.
fn compare(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .arg("compare")
        .args(arguments)
        .output()
        .expect("the program runs");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

/// Two diagnoses: of a leak, and of a larger leak with less of a gap in contraction.
fn two() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let gaps = |contraction: f64| {
        json!({
            "pressure_pa": gap(1800.0, 260.0, 250.0),
            "contraction": gap(8e-3, contraction, 3e-5),
        })
    };
    write(
        &folder.path().join("a"),
        "explained",
        &[("leak", 4e-9)],
        gaps(6e-4),
    );
    write(
        &folder.path().join("b"),
        "explained",
        &[("leak", 8e-9)],
        gaps(2e-4),
    );
    folder
}

#[test]
fn verdicts_intervals_and_gaps_stand_beside_each_other() {
    let folder = two();
    let (status, text, message) = compare(folder.path(), &["a", "b/diagnosis.json"]);
    assert_eq!(status, Some(0), "{message}");
    let (worst, other) = (text.find("  contraction "), text.find("  gauge pressure "));
    assert!(
        worst < other,
        "the largest gap above its noise is first: {text}"
    );
    for said in [
        "Both diagnoses say explained (leak).",
        "The intervals of conductance_kg_per_pa_s of leak do not overlap.",
        "B is nearer in contraction (0.02000 % RMS against 0.06000 %)",
        "both miss gauge pressure by 0.2600 kPa RMS",
        "whether the validation records are the same is not known",
        "4.00e-9 kg/(Pa·s) (3.60e-9 kg/(Pa·s) to 4.40e-9 kg/(Pa·s))",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let (status, text, _) = compare(folder.path(), &["a", "b", "--json"]);
    assert_eq!(status, Some(0));
    let json: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["verdicts"], json!(["explained", "explained"]));
    let parameter = &json["effects"][0]["parameters"]["conductance_kg_per_pa_s"];
    assert_eq!(parameter["overlap"], false);
    assert_eq!(parameter["estimates"][1]["value"], 8e-9);
    assert_eq!(json["gap"]["contraction"][1], gap(8e-3, 2e-4, 3e-5));
    assert_eq!(json["same_validation_records"], Value::Null);
}

#[test]
fn different_verdicts_and_different_validation_records_are_said() {
    let folder = two();
    write(&folder.path().join("b"), "unexplained", &[], json!({}));
    for (sha256, same) in [("01", false), ("00", true)] {
        write_rig(&folder.path().join("a"), "00");
        write_rig(&folder.path().join("b"), sha256);
        let (status, text, message) = compare(folder.path(), &["a", "b", "--report", "c.html"]);
        assert_eq!(status, Some(0), "{message}");
        let differ = "The diagnoses differ: A says explained (leak), B says unexplained.";
        assert!(text.contains(differ), "{text}");
        assert!(text.contains("not named"), "{text}");
        let said = text.contains("the validation records are not the same");
        assert_eq!(said, !same, "{text}");
        let page = std::fs::read_to_string(folder.path().join("c.html")).expect("a report");
        assert!(page.contains("hil-sim 0.1.0, 2026-01-02T03:04:05Z"));
        assert!(
            page.contains("compare a b --report c.html"),
            "the command to repeat"
        );
    }
}

#[test]
fn what_is_no_diagnosis_is_refused_with_its_place() {
    let folder = two();
    let path = folder.path();
    std::fs::write(path.join("text.json"), "{\n \"schema\": 1,\n oops }").expect("a file");
    std::fs::write(path.join("rig.json"), "{ \"schema\": 1 }").expect("a file");
    write(&path.join("later"), "explained", &[], json!({}));
    let later = path.join("later/diagnosis.json");
    let text = std::fs::read_to_string(&later).expect("it");
    std::fs::write(&later, text.replace("\"schema\": 1", "\"schema\": 9")).expect("a file");
    for (arguments, says) in [
        (&["a", "nowhere"][..], "nowhere: expected a diagnosis"),
        (&["a", "text.json"], "text.json:3: expected a diagnosis"),
        (&["rig.json", "a"], "missing field `verdict`"),
        (&["a", "later"], "expected schema 1 or 2, found 9"),
        (&["a", "b", "--report", "b/diagnosis.json"], "not an input"),
    ] {
        let (status, printed, message) = compare(path, arguments);
        assert_eq!(status, Some(2), "{arguments:?}");
        assert_eq!(
            (message.lines().count(), &printed[..]),
            (1, ""),
            "{message}"
        );
        assert!(message.contains(says), "{says}: {message}");
    }
}

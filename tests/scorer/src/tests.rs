//! Tests of the scores of synthetic answers and diagnoses.

use crate::answer::{Answer, Hidden, Kind};
use crate::child::Ended;
use crate::compare::{Method, markdown};
use crate::diagnosis::Diagnosis;
use crate::figures::{REACH, Score};
use crate::gap::{BySignal, Gaps};
use crate::outcome::{Outcome, column, outcome};
use crate::report::{Origin, full, summary};
use crate::run::{Collected, Run};
use crate::scored::Scored;
use crate::statistics::Rate;
use crate::{shuffled, without};
use serde_json::{Value, json};

/// An answer with the hidden effects `names`, each with this ratio of change to noise.
fn answer(kind: Kind, names: &[&str], over_noise: f64) -> Answer {
    let hidden = |name: &&str| Hidden {
        name: (*name).into(),
        form: "linear".into(),
        size: 0.5,
        standard: [("conductance_kg_per_pa_s".to_owned(), 4e-9)].into(),
        most_over_noise: over_noise,
        indistinguishable_from: Vec::new(),
    };
    Answer {
        family: "drawn".into(),
        id: "s1-00007".into(),
        seed: 1,
        index: 7,
        kind,
        force_channel: false,
        records: "usual".into(),
        starts_moving: false,
        effects: names.iter().map(hidden).collect(),
        noise: by_signal(250.0, 3e-5),
    }
}

fn by_signal(pressure_pa: f64, contraction: f64) -> BySignal {
    [("pressure_pa", pressure_pa), ("contraction", contraction)]
        .map(|(signal, value)| (signal.to_owned(), value))
        .into()
}

/// A diagnosis with names and, after a slash, their alternatives: `leak/creep,slack`.
fn diagnosis_json(verdict: &str, names: &[&str]) -> Value {
    let effect = |name: &&str| {
        let (name, others) = name.split_once('/').unwrap_or((name, ""));
        let others: Vec<&str> = others.split(',').filter(|name| !name.is_empty()).collect();
        json!({
            "name": name, "where": "gas",
            "parameters": {
                "conductance_kg_per_pa_s": {
                    "value": 4.1e-9, "ci95": [3.8e-9, 4.4e-9], "unit": "kg/(Pa·s)"
                }
            },
            "alternatives": others,
            "evidence": { "anything": [1, 2] },
        })
    };
    json!({
        "schema": 1,
        "verdict": verdict,
        "effects": names.iter().map(effect).collect::<Vec<_>>(),
        "gap": {
            "pressure_pa": { "before": 2250.0, "after": 450.0, "noise": 250.0 },
            "contraction": { "before": 3e-5, "after": 3e-5, "noise": 3e-5 },
        },
        "remaining": { "where": [], "when": "" },
        "next_experiment": "",
    })
}

fn diagnosis(verdict: &str, names: &[&str]) -> Diagnosis {
    Diagnosis::parse(&diagnosis_json(verdict, names).to_string()).expect("a diagnosis")
}

fn ended(exit: Option<i32>) -> Ended {
    Ended {
        exit,
        timed_out: false,
        wall_s: 2.0,
        cpu_s: 3.0,
        peak_memory_bytes: 50_000_000,
    }
}

fn collected(answer: Answer, diagnosis: Result<Diagnosis, String>) -> Collected {
    let gaps = |pressure_pa: f64| Gaps {
        before: by_signal(2250.0, 3e-5),
        after: by_signal(pressure_pa, 3e-5),
    };
    Collected {
        answer,
        run: Run {
            arguments: Vec::new(),
            experiment: vec!["zero".into()],
            program_crc32: 0,
            ended: ended(Some(0)),
            last_words: String::new(),
            validation: Ok(gaps(450.0)),
            unseen: Ok(gaps(650.0)),
        },
        diagnosis,
        forms: [].into(),
    }
}

fn judged(kind: Kind, hidden: &[&str], verdict: &str, named: &[&str]) -> Scored {
    let diagnosis = diagnosis(verdict, named);
    Scored::new(&collected(answer(kind, hidden, 10.0), Ok(diagnosis)))
}

#[test]
fn a_single_effect_is_right_if_only_its_name_is_given() {
    let said = |verdict, named: &[&str]| judged(Kind::Single, &["leak"], verdict, named).outcome;
    assert_eq!(said("explained", &["leak"]), Outcome::Right);
    assert_eq!(
        said("explained", &["leak/pressure-sensor-gain"]),
        Outcome::Right
    );
    assert_eq!(said("explained", &["leak", "creep"]), Outcome::Extra);
    assert_eq!(said("explained", &["creep"]), Outcome::Wrong);
    assert_eq!(said("explained", &["creep/slack"]), Outcome::Wrong);
    assert_eq!(said("explained", &["creep/slack,leak"]), Outcome::Ambiguous);
    // an additional effect is not ambiguous, whatever its alternatives
    assert_eq!(said("explained", &["creep/leak", "slack"]), Outcome::Wrong);
    assert_eq!(said("consistent", &[]), Outcome::Missed);
    assert_eq!(said("unexplained", &[]), Outcome::Abstained);
    assert_eq!(said("unexplained", &["leak"]), Outcome::Right);
    assert_eq!(said("unexplained", &["creep"]), Outcome::Wrong);
}

#[test]
fn a_pair_is_right_if_both_names_are_given() {
    let said = |named: &[&str]| judged(Kind::Pair, &["leak", "creep"], "explained", named).outcome;
    assert_eq!(said(&["creep", "leak"]), Outcome::Right);
    assert_eq!(said(&["creep"]), Outcome::Partial);
    assert_eq!(said(&["slack"]), Outcome::Wrong);
    assert_eq!(said(&["leak", "slack"]), Outcome::Wrong);
    assert_eq!(said(&["leak", "slack", "creep"]), Outcome::Extra);
    assert_eq!(said(&["leak", "slack/creep"]), Outcome::Ambiguous);
    assert_eq!(said(&["slack/leak", "run-in/creep"]), Outcome::Ambiguous);
    // both lead to the same name: the other was not found
    assert_eq!(said(&["leak", "slack/leak"]), Outcome::Wrong);
    assert_eq!(said(&["slack/leak,creep", "friction"]), Outcome::Wrong);
}

#[test]
fn a_healthy_case_must_be_consistent_and_an_unlisted_effect_unexplained() {
    let none = |verdict, named: &[&str]| judged(Kind::None, &[], verdict, named).outcome;
    assert_eq!(none("consistent", &[]), Outcome::Right);
    assert_eq!(none("explained", &["leak"]), Outcome::FalseAlarm);
    assert_eq!(none("unexplained", &["leak"]), Outcome::FalseAlarm);
    assert_eq!(none("unexplained", &[]), Outcome::Abstained);
    let cogging =
        |verdict, named: &[&str]| judged(Kind::Unlisted, &["cogging"], verdict, named).outcome;
    assert_eq!(cogging("unexplained", &[]), Outcome::Right);
    assert_eq!(cogging("consistent", &[]), Outcome::Missed);
    assert_eq!(cogging("explained", &["friction"]), Outcome::Wrong);
    assert_eq!(cogging("unexplained", &["friction"]), Outcome::Wrong);
    assert_eq!(cogging("explained", &["friction/cogging"]), Outcome::Wrong);
}

#[test]
fn a_triple_is_right_if_all_names_are_given() {
    let hidden = ["leak", "creep", "slack"];
    let said = |named: &[&str]| judged(Kind::Triple, &hidden, "explained", named).outcome;
    assert_eq!(said(&["slack", "leak", "creep"]), Outcome::Right);
    assert_eq!(said(&["leak", "creep"]), Outcome::Partial);
    assert_eq!(
        said(&["leak", "creep", "slack/run-in", "payload"]),
        Outcome::Extra
    );
    assert_eq!(said(&["leak", "creep", "run-in/slack"]), Outcome::Ambiguous);
    assert_eq!(said(&["leak", "payload"]), Outcome::Wrong);
}

/// A diagnosis of schema 2 that names `leak` with a probability.
fn probable(verdict: &str, probability: f64) -> Value {
    let mut value = diagnosis_json(verdict, &["leak"]);
    value["schema"] = json!(2);
    value["effects"][0]["probability"] = json!(probability);
    value["hypotheses"] = json!([
        { "effects": ["leak"], "unknown": [], "probability": probability },
        { "effects": [], "unknown": ["gas"], "probability": 1.0 - probability },
    ]);
    value
}

#[test]
fn probabilities_are_compared_with_the_hidden_effects() {
    let scored = |kind, hidden: &[&str], probability| {
        let text = probable("partial", probability).to_string();
        let diagnosis = Diagnosis::parse(&text).expect("schema 2");
        Scored::new(&collected(answer(kind, hidden, 10.0), Ok(diagnosis)))
    };
    let right = scored(Kind::Single, &["leak"], 0.95);
    assert!(right.right_with_remainder() && right.said().starts_with("leak, partial"));
    assert_eq!(right.named_probabilities, [(0.95, true)]);
    assert_eq!(right.hypothesis_probabilities[0], (0.95, true));
    assert!(!right.hypothesis_probabilities[1].1);
    // for an unlisted effect the hypothesis of an unknown effect is right
    let unlisted = scored(Kind::Unlisted, &["cogging"], 0.75);
    assert_eq!(unlisted.named_probabilities, [(0.75, false)]);
    assert_eq!(
        unlisted.hypothesis_probabilities,
        [(0.75, false), (0.25, true)]
    );
    let score = Score::of(vec![right, unlisted]);
    assert_eq!(score.names.bins[9].count, 1);
    assert_eq!(score.visible.sure_names, Rate::new(1, 1));
    let error = score.visible.calibration_error.expect("two names");
    assert!((error - 0.5 * (0.05 + 0.75)).abs() < 1e-12);

    let broken = |change: fn(&mut Value)| {
        let mut value = probable("partial", 0.9);
        change(&mut value);
        Diagnosis::parse(&value.to_string()).expect_err("broken")
    };
    assert!(broken(|v| v["effects"][0]["probability"] = json!(1.2)).contains("probability 1.2"));
    assert!(broken(|v| v["hypotheses"] = json!([])).contains("sum to 0.000"));
    assert!(broken(|v| v["effects"] = json!([])).contains("partial, yet"));
}

#[test]
fn a_signal_that_is_predicted_worse_needs_a_warning() {
    let case = |after: f64, warnings: Value| {
        let mut value = diagnosis_json("explained", &["leak"]);
        value["warnings"] = warnings;
        let diagnosis = Diagnosis::parse(&value.to_string()).expect("a diagnosis");
        let mut case = collected(answer(Kind::Single, &["leak"], 10.0), Ok(diagnosis));
        case.run.unseen = Ok(Gaps {
            before: by_signal(2250.0, 1e-4),
            after: by_signal(450.0, after),
        });
        Scored::new(&case).worse_unwarned
    };
    assert_eq!(case(1.2e-4, json!([])), ["contraction"]);
    assert!(
        case(
            1.2e-4,
            json!(["contraction is predicted worse than before"])
        )
        .is_empty()
    );
    // within the sampling of its noise
    assert!(case(1.04e-4, json!([])).is_empty());
    assert!(case(0.9e-4, json!([])).is_empty());
}

#[test]
fn cases_with_indistinguishable_effects_are_reported_separately() {
    let mut tied = answer(Kind::Single, &["leak"], 10.0);
    tied.effects[0].indistinguishable_from = vec!["pressure-sensor-gain".into()];
    let diagnosis = diagnosis("explained", &["leak/pressure-sensor-gain"]);
    let score = Score::of(vec![Scored::new(&collected(tied, Ok(diagnosis)))]);
    assert_eq!(score.visible.cases, 0);
    assert!(score.outcomes.is_empty() && score.faint_outcomes.is_empty());
    assert_eq!(
        score.tied_outcomes[&Kind::Single].values().sum::<usize>(),
        1
    );
}

#[test]
fn an_unreadable_diagnosis_is_wrong_with_its_reason() {
    let broken = |change: fn(&mut Value)| {
        let mut value = diagnosis_json("explained", &["leak"]);
        change(&mut value);
        Diagnosis::parse(&value.to_string()).expect_err("broken")
    };
    assert!(broken(|v| *v = json!([])).contains("not a diagnosis"));
    assert!(broken(|v| v["verdict"] = json!("perhaps")).contains("perhaps"));
    assert!(broken(|v| v["schema"] = json!(3)).contains("schema 1 or 2, found 3"));
    assert!(broken(|v| v["schema"] = json!(2)).contains("no probability of `leak`"));
    assert!(broken(|v| v["verdict"] = json!("consistent")).contains("consistent, yet"));
    assert!(broken(|v| v["effects"] = json!([])).contains("by no effect"));
    assert!(broken(|v| v["gap"]["pressure_pa"]["after"] = json!(null)).contains("null"));
    let missing = broken(|v| {
        v["effects"][0]
            .as_object_mut()
            .expect("an effect")
            .remove("alternatives");
    });
    assert!(missing.contains("alternatives"));
    let twice = broken(|v| v["effects"] = json!([v["effects"][0], v["effects"][0]]));
    assert!(twice.contains("twice"));
    let reversed = broken(|v| {
        v["effects"][0]["parameters"]["conductance_kg_per_pa_s"]["ci95"] = json!([2, 1]);
    });
    assert!(reversed.contains("upside down"));
    let read = diagnosis("explained", &["leak"]);
    assert!(read.covers(["pressure_pa", "contraction"]).is_ok());
    assert!(
        read.covers(["force_n"])
            .expect_err("missing")
            .contains("force_n")
    );

    let fault = "exit status 1: no such luck";
    let case = collected(answer(Kind::Single, &["leak"], 10.0), Err(fault.into()));
    let case = Scored::new(&case);
    assert_eq!(case.outcome, Outcome::NoAnswer);
    assert_eq!(case.said(), format!("no answer: {fault}"));
    // it does not reduce the gap
    assert_eq!(
        (case.share_validation, case.share_unseen),
        (Some(0.0), Some(0.0))
    );
}

#[test]
fn a_diagnosis_is_assigned_to_its_column_of_the_confusion_matrix() {
    let of = |verdict, named: &[&str]| column(Some(&diagnosis(verdict, named)));
    assert_eq!(of("consistent", &[]), "none");
    assert_eq!(of("unexplained", &[]), "unexplained");
    assert_eq!(of("explained", &["leak"]), "leak");
    assert_eq!(of("explained", &["leak", "creep"]), "several");
    assert_eq!(column(None), "no answer");
    assert_eq!(
        outcome(&answer(Kind::None, &[], 0.0), None),
        Outcome::NoAnswer
    );
}

#[test]
fn a_scored_case_has_all_of_its_values() {
    let case = judged(Kind::Single, &["leak"], "unexplained", &["leak/creep"]);
    assert!(case.right_with_remainder());
    assert_eq!(case.said(), "leak, unexplained (or creep)");
    assert!((case.share_validation.expect("a share") - 0.9).abs() < 1e-12);
    assert!((case.share_unseen.expect("a share") - 0.8).abs() < 1e-12);
    // only the pressure had a gap
    assert_eq!(case.share_by_signal.len(), 1);
    assert_eq!(case.claim_difference, Some(0.0));
    assert_eq!(case.noise_ratio["contraction"], 1.0);
    assert_eq!(case.parameters.len(), 1);
    assert_eq!(case.parameters[0].inside(), Some(true));
    let mut other_form = collected(
        answer(Kind::Single, &["leak"], 10.0),
        Ok(diagnosis("explained", &["leak"])),
    );
    other_form.forms.insert("leak".into(), "orifice".into());
    let other_form = Scored::new(&other_form);
    assert_eq!(other_form.forms_shared, [false]);
    assert!(other_form.parameters.is_empty());
    // parameters of a wrong effect are not scored
    assert!(
        judged(Kind::Single, &["leak"], "explained", &["creep"])
            .parameters
            .is_empty()
    );

    let mut broken = collected(
        answer(Kind::Single, &["leak"], 10.0),
        Ok(diagnosis("explained", &["leak"])),
    );
    broken.run.unseen = Err("simulate with rig.fitted.toml: exit status 2".into());
    let broken = Scored::new(&broken);
    assert_eq!(broken.share_unseen, Some(0.0));
    assert!(broken.gap_fault.expect("a fault").contains("exit status 2"));
}

/// A benchmark with one case of each kind of error.
fn benchmark() -> Vec<Collected> {
    let mut cases = Vec::new();
    let mut add = |kind, hidden: &[&str], over_noise, said: Option<(&str, &[&str])>| {
        let mut answer = answer(kind, hidden, over_noise);
        answer.index = cases.len() as u64;
        answer.force_channel = answer.index.is_multiple_of(2);
        let diagnosis = said.map(|(verdict, named)| diagnosis(verdict, named));
        cases.push(collected(answer, diagnosis.ok_or("gone".into())));
    };
    add(
        Kind::Single,
        &["leak"],
        10.0,
        Some(("explained", &["leak"])),
    );
    add(
        Kind::Single,
        &["leak"],
        10.0,
        Some(("explained", &["creep/leak"])),
    );
    add(
        Kind::Single,
        &["creep"],
        10.0,
        Some(("explained", &["creep"])),
    );
    add(Kind::Single, &["slack"], 10.0, None);
    add(Kind::Single, &["slack"], 2.9, Some(("consistent", &[])));
    add(
        Kind::Pair,
        &["leak", "creep"],
        10.0,
        Some(("explained", &["leak", "creep"])),
    );
    add(
        Kind::Pair,
        &["leak", "slack"],
        10.0,
        Some(("explained", &["leak"])),
    );
    add(Kind::None, &[], 0.0, Some(("consistent", &[])));
    add(Kind::None, &[], 0.0, Some(("explained", &["leak"])));
    add(
        Kind::Unlisted,
        &["cogging"],
        10.0,
        Some(("unexplained", &[])),
    );
    add(
        Kind::Unlisted,
        &["cogging"],
        10.0,
        Some(("explained", &["friction"])),
    );
    cases
}

#[test]
fn figures_are_of_visible_cases_and_the_others_are_separate() {
    let score = Score::of(benchmark().iter().map(Scored::new).collect());
    let figures = &score.visible;
    assert_eq!(figures.cases, 10);
    assert_eq!(figures.single, Rate::new(2, 4));
    assert_eq!(figures.pair, Rate::new(1, 2));
    assert_eq!(figures.consistent, Rate::new(1, 2));
    assert_eq!(figures.false_alarms, Rate::new(1, 2));
    assert_eq!(figures.abstained, Rate::new(1, 2));
    assert_eq!(figures.unnamed, Rate::new(1, 2));
    assert_eq!(figures.ambiguous, Rate::new(1, 6));
    assert_eq!(figures.share_validation.of, 6);
    // the leaks alone: their truth has a form that the tool has
    assert_eq!(figures.inside_ci95, Rate::new(2, 2));
    assert_eq!(figures.forms_shared, Rate::new(2, 2));
    assert_eq!(score.with_force.single, Rate::new(2, 2));
    assert_eq!(score.without_force.single, Rate::new(0, 2));
    assert_eq!(score.faint_outcomes[&Kind::Single][&Outcome::Missed], 1);
    assert_eq!(score.outcomes[&Kind::Pair][&Outcome::Partial], 1);
    assert_eq!(score.confusion["leak"]["creep"], 1);
    assert_eq!(score.confusion["slack"]["no answer"], 1);
    assert_eq!(score.confusion["none"]["none"], 1);
    let effect = score
        .dimensions
        .iter()
        .find(|d| d.name == "effect")
        .expect("by effect");
    // a pair is a case of both its effects
    assert_eq!(effect.parts["leak"].pair, Rate::new(1, 2));
    assert_eq!(effect.parts["creep"].single, Rate::new(1, 1));
    assert_eq!(score.wrong().count(), 5);
    assert!(!score.reached());
    let met = REACH.map(|reach| reach.met(&score.visible));
    assert_eq!(met[0], Some(false));
    let fallen = collected(answer(Kind::None, &[], 0.0), Err("gone".into()));
    assert!(!Score::of(vec![Scored::new(&fallen)]).reached());
    let reached = |name: &str| {
        let place = REACH.iter().position(|reach| reach.name == name);
        met[place.expect("a figure")]
    };
    // two of two inside do not show that intervals are too wide; one false alarm of two is one
    assert_eq!(reached("true parameter inside its ci95"), Some(true));
    assert_eq!(reached("false alarms on none"), Some(false));
    assert_eq!(reached("expected calibration error"), None);
}

#[test]
fn the_reports_contain_every_table() {
    let score = Score::of(benchmark().iter().map(Scored::new).collect());
    let origin = Origin {
        command: "score run".into(),
        out: "out/x".into(),
        programs: " --diagnose other".into(),
        warnings: vec!["Warning: old.".into()],
    };
    let text = summary(&score, &origin).to_text();
    for part in [
        "exact name of single effects",
        "2/4 = 50 % (15–85)",
        "NOT REACHED",
        "Warning: old.",
        "leak     creep 1, leak 1",
        "no answer: gone",
        "--family drawn --seed 1 --first 3 --count 1 --again --out out/x-again --diagnose other \
         --experiment zero",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let html = full(&score, &origin).to_html();
    assert!(html.contains("By form") && html.contains("cogging") && html.contains("3 leak"));
    let json = serde_json::to_value(&score).expect("JSON");
    assert_eq!(json["visible"]["single"]["hits"], 2);
    assert_eq!(json["cases"].as_array().map(Vec::len), Some(11));
    // nothing was run: nothing to show, and nothing that falls over
    let empty = Score::of(Vec::new());
    assert!(empty.reached());
    assert!(full(&empty, &origin).to_html().contains("no case"));
}

#[test]
fn shuffled_answers_reach_the_figures_of_chance() {
    // each of ten names five times, all right
    let names = without::listed(truth::Family::Drawn);
    let mut cases = Vec::new();
    for name in names[..10].iter().cycle().take(50) {
        let diagnosis = diagnosis("explained", &[name]);
        cases.push(collected(
            answer(Kind::Single, &[name], 10.0),
            Ok(diagnosis),
        ));
    }
    let chances = shuffled::shuffled(&cases, 500, 3);
    assert_eq!(chances[0].own, Rate::new(50, 50));
    assert!((chances[0].mean - 0.1).abs() < 0.02, "{chances:?}");
    assert_eq!(chances[0].as_good, 0.0);
    let again = shuffled::shuffled(&cases, 500, 3);
    assert_eq!(format!("{chances:?}"), format!("{again:?}"));
    let text = shuffled::report(&chances, 500, "score shuffled").to_text();
    assert!(
        text.contains("50/50 = 100.0 %") && text.contains("no case"),
        "{text}"
    );
}

#[test]
fn without_its_effect_in_the_catalogue_a_case_must_be_unexplained() {
    let case = |verdict, named: &[&str]| judged(Kind::Single, &["leak"], verdict, named);
    let with_share = |share, case| Scored {
        share_explained: share,
        ..case
    };
    let faint = collected(
        answer(Kind::Single, &["leak"], 1.0),
        Ok(diagnosis("consistent", &[])),
    );
    let cases = [
        case("unexplained", &[]),
        case("consistent", &[]),
        with_share(Some(0.97), case("explained", &["creep"])),
        // the name of the removed effect counts as named, too
        with_share(Some(0.999), case("explained", &["leak"])),
        Scored::new(&faint),
    ];
    let part = without::judge("leak", &cases);
    assert_eq!(part.to_the_noise, Rate::new(1, 4));
    assert_eq!(part.abstained, Rate::new(1, 4));
    assert_eq!(part.missed, Rate::new(1, 4));
    assert_eq!(part.misnamed, Rate::new(2, 4));
    assert_eq!(
        without::total(&[part.clone(), part.clone()])[2],
        Rate::new(4, 8)
    );
    let text = without::report(&[part], "score without").to_text();
    assert!(
        text.contains("25 % are left unexplained and 50 % get a wrong name; in 25 %"),
        "{text}"
    );
    assert!(text.contains("s1-00007: creep"), "{text}");
}

/// A method that gives `named` as what is hidden in two cases, a leak and nothing.
fn method(name: &str, named: &[&str]) -> Method {
    let case = |kind, hidden: &[&str], index: u64| {
        let verdict = if named.is_empty() {
            "consistent"
        } else {
            "explained"
        };
        let mut case = collected(answer(kind, hidden, 10.0), Ok(diagnosis(verdict, named)));
        case.answer.id = format!("s1-{index:05}");
        case
    };
    let cases = [case(Kind::Single, &["leak"], 7), case(Kind::None, &[], 8)];
    Method::new(name.into(), &cases)
}

#[test]
fn methods_are_compared_on_the_same_cases() {
    let (mine, yours) = (method("mine", &["leak"]), method("yours", &[]));
    let table = markdown(&[mine, yours]).expect("a table");
    let rows: Vec<Vec<&str>> = table
        .lines()
        .map(|row| row.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    assert!(rows.len() == 4 && rows.iter().all(|row| row.len() == rows[0].len()));
    let cell = |row: usize, column: &str| {
        let place = rows[0].iter().position(|name| *name == column);
        rows[row][place.expect("a column")]
    };
    assert_eq!(cell(2, "method"), "mine");
    assert_eq!(cell(2, "one, exactly named"), "1/1 = 100 % (21–100)");
    assert_eq!(cell(3, "one, exactly named"), "0/1 = 0 % (0–79)");
    assert_eq!(cell(2, "false alarms"), "1/1 = 100 % (21–100)");
    assert_eq!(cell(3, "false alarms"), "0/1 = 0 % (0–79)");
    assert_eq!(cell(2, "two"), "");
    let sure = "right names of those given with 0.9 to 1";
    assert_eq!(cell(2, sure), "no probabilities");
    assert_eq!(cell(2, "processor time [s], median, largest"), "3.0, 3.0");
    assert_eq!(cell(2, "memory [MB], largest"), "50");
}

#[test]
fn methods_with_other_cases_are_not_compared() {
    let (mine, mut yours) = (method("mine", &[]), method("yours", &[]));
    yours.score.cases.pop();
    let error = markdown(&[mine, yours]).expect_err("one case is missing");
    let expected = "mine was run on case s1-00008, yours was not: run both on it";
    assert_eq!(error.to_string(), expected);
}

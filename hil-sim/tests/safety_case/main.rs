//! The safety case: hazard, requirement, code, evidence, and the result of this commit.
//!
//! `SAFETY_CASE=write` writes docs/safety-case/README.md; otherwise it must be what is generated.
//! `TEST_LOGS` is a folder with what `cargo test` has printed: then each test that is named must
//! have been run and passed.

mod evidence;
mod figures;
mod level;
mod page;
#[path = "../sequences"]
#[allow(dead_code, reason = "the sequences' own tests use the rest")]
mod sequences {
    pub mod body;
    pub mod case;
    pub mod event;
    pub mod plant;
    pub mod run;
    pub mod scenario;
}
mod source;

use evidence::{Results, missing};
use figures::Figures;
use hil_sim::faults::ablation::SafetyFunction;
use hil_sim::faults::kind::KINDS;
use model_core::supervisor::Fault;
use source::{Requirement, Source, repository};
use std::collections::BTreeSet;
use std::path::Path;

/// What of `all` no requirement names, and what requirements name that is not there.
fn differences(
    what: &str,
    all: impl Iterator<Item = String>,
    source: &Source,
    named: impl Fn(&Requirement) -> Vec<String>,
) -> Vec<String> {
    let all: BTreeSet<String> = all.collect();
    let named: BTreeSet<String> = source.requirement.iter().flat_map(named).collect();
    let differing = all.symmetric_difference(&named);
    differing.map(|one| format!("{what}: {one}")).collect()
}

#[test]
fn each_hazard_reason_kind_of_fault_and_safety_function_has_a_requirement() {
    let source = Source::read();
    let mut wrong = Vec::new();
    let hazards = source.hazard.iter().map(|hazard| hazard.id.clone());
    wrong.extend(differences("hazard", hazards, &source, |one| {
        one.hazards.clone()
    }));
    let reasons = Fault::NAMED.iter().map(|(_, name)| name.to_string());
    wrong.extend(differences("reason", reasons, &source, |one| {
        one.reasons.clone()
    }));
    let kinds = KINDS.iter().map(|kind| kind.name.to_string());
    wrong.extend(differences("kind of fault", kinds, &source, |one| {
        one.kinds.clone()
    }));
    let functions = SafetyFunction::ALL.iter().map(|one| one.name().to_string());
    wrong.extend(differences("safety function", functions, &source, |one| {
        one.switch.iter().cloned().collect()
    }));
    let ids: BTreeSet<&str> = source
        .requirement
        .iter()
        .map(|one| one.id.as_str())
        .collect();
    assert_eq!(
        ids.len(),
        source.requirement.len(),
        "numbers of requirements"
    );
    assert_eq!(wrong, [] as [String; 0]);
}

#[test]
fn each_place_in_the_code_and_each_test_exists() {
    let source = Source::read();
    let places = source.requirement.iter().flat_map(|one| {
        assert!(!one.code.is_empty() && !one.tests.is_empty(), "{}", one.id);
        let code = one.code.iter().filter_map(|place| missing(place, false));
        code.chain(one.tests.iter().filter_map(|test| missing(test, true)))
    });
    assert_eq!(places.collect::<Vec<_>>(), [] as [String; 0]);
}

/// The rows of the first table in docs/safety.md whose header begins so.
fn table_of_safety(header: &str) -> Vec<String> {
    let page = std::fs::read_to_string(repository().join("docs/safety.md")).expect("the page");
    let mut lines = page.lines().skip_while(|line| !line.starts_with(header));
    assert!(lines.next().is_some(), "no table «{header}»");
    let rows = lines.take_while(|line| line.starts_with('|'));
    rows.map(String::from).collect()
}

#[test]
fn each_table_of_safety_functions_has_all_of_them() {
    let tables = [
        ("| unsafe control action", true),
        ("| without | violations", false),
        ("| without | speed", true),
        ("| without | what happens", true),
    ];
    for (header, needs_limb) in tables {
        let rows = table_of_safety(header).join("\n");
        for function in SafetyFunction::ALL {
            let is_named = rows.contains(&format!("`{}`", function.name()));
            // The campaign has no limb.
            let is_expected = needs_limb || !function.needs_limb();
            assert_eq!(is_named, is_expected, "{header}: {function:?}");
        }
    }
}

#[test]
fn page_is_what_is_generated() {
    let source = Source::read();
    let logs = std::env::var_os("TEST_LOGS");
    let results = match &logs {
        Some(folder) => Results::read(Path::new(folder)),
        None => Results::Claimed,
    };
    let page = page::page(&source, &results, &Figures::new());
    let path = repository().join("docs/safety-case/README.md");
    if std::env::var("SAFETY_CASE").is_ok_and(|value| value == "write") {
        std::fs::write(&path, &page).expect("docs/safety-case/README.md");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let differing = committed
        .lines()
        .zip(page.lines())
        .find(|(committed, generated)| committed != generated);
    assert!(
        committed == page,
        "docs/safety-case/README.md is not what is generated (SAFETY_CASE=write writes it); \
         committed and generated: {differing:#?}"
    );
}

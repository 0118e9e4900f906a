//! The outcomes as a page and as a table for the docs.

use crate::Outcome;
use hil_sim::report::{Report, Section, Table};

const COLUMNS: [&str; 7] = [
    "set",
    "Eq 1, or the set's own law, alone misses",
    "with the named effects",
    "noise and repeatability",
    "verdict",
    "named: size (published)",
    "s",
];

fn number(value: f64, outcome: &Outcome) -> String {
    if outcome.range == 0.0 {
        return "–".into();
    }
    let percent = 100.0 * value / outcome.range;
    format!("{value:.3} {} ({percent:.1} %)", outcome.unit)
}

fn row(outcome: &Outcome) -> Vec<String> {
    let named = outcome.effects.iter().map(|found| {
        let mut words = found.name.clone();
        if !found.size.is_empty() {
            words += &format!(": {}", found.size);
        }
        if !found.published.is_empty() {
            words += &format!(" ({})", found.published);
        }
        if !found.alternatives.is_empty() {
            words += &format!(", or {}", found.alternatives.join(" or "));
        }
        words
    });
    let named: Vec<String> = named.collect();
    vec![
        outcome.set.clone(),
        number(outcome.calibrated, outcome),
        number(outcome.after, outcome),
        number(outcome.noise, outcome),
        outcome.verdict.clone(),
        if named.is_empty() {
            "–".into()
        } else {
            named.join("; ")
        },
        format!("{:.0}", outcome.spent_s),
    ]
}

/// The table, in Markdown.
pub fn markdown(outcomes: &[Outcome]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&COLUMNS.map(String::from));
    text += &line(&COLUMNS.map(|_| "---".into()));
    for outcome in outcomes {
        text += &line(&row(outcome));
    }
    text
}

/// The page.
pub fn report(outcomes: &[Outcome]) -> Report {
    let explained = outcomes.iter().filter(|o| o.verdict == "explained").count();
    let table = Table {
        caption: "Root mean square over held-out records, in brackets of their range".into(),
        columns: COLUMNS.map(String::from).to_vec(),
        rows: outcomes.iter().map(row).collect(),
    };
    let mut sections = vec![Section {
        heading: "All sets".into(),
        tables: vec![table],
        ..Section::default()
    }];
    for outcome in outcomes {
        let mut text = Vec::new();
        if !outcome.fitted.is_empty() {
            text.push(format!("Fitted: {}.", outcome.fitted.join(", ")));
            text.push(format!("Held out: {}.", outcome.held_out.join(", ")));
        }
        text.extend((!outcome.remains.is_empty()).then(|| outcome.remains.clone()));
        text.extend(
            outcome
                .warnings
                .iter()
                .map(|warning| format!("Note: {warning}.")),
        );
        let next = &outcome.next_experiment;
        text.extend((!next.is_empty()).then(|| format!("Next experiment: {next}")));
        sections.push(Section {
            heading: format!("{}: {}", outcome.set, outcome.verdict),
            text,
            plots: outcome.plots.clone(),
            ..Section::default()
        });
    }
    Report {
        title: "What laboratories have measured".into(),
        verdict: vec![format!(
            "{explained} of {} sets are explained.",
            outcomes.len()
        )],
        sections,
        repeat: vec!["cargo run --release -p measured -- --data DIR".into()],
    }
}

//! The outcomes as a page and as a table for the docs.

use crate::Outcome;
use crate::benchmarks::Figure;
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

const FIGURE_COLUMNS: [&str; 3] = ["on the test record", "method", "figure"];

/// Rows of the benchmarks' figures; what a set measures is named once.
fn figure_rows(figures: &[Figure]) -> Vec<Vec<String>> {
    let mut last = "";
    let row = |figure: &Figure| {
        let measure = if figure.measure == last {
            ""
        } else {
            figure.measure
        };
        last = figure.measure;
        let origin = if figure.computed {
            "computed here"
        } else {
            "published"
        };
        vec![
            measure.into(),
            format!("{} ({origin})", figure.method),
            format!("{} {}", digits(figure.value), figure.unit),
        ]
    };
    figures.iter().map(row).collect()
}

/// Three digits.
fn digits(value: f64) -> String {
    let places = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.places$}")
}

/// The tables, in Markdown.
pub fn markdown(outcomes: &[Outcome], figures: &[Figure]) -> String {
    let table = |columns: &[&str], rows: Vec<Vec<String>>| {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let heads: Vec<String> = columns.iter().map(|own| (*own).into()).collect();
        let rule = vec!["---".to_string(); columns.len()];
        let body = rows.iter().map(|row| line(row));
        line(&heads) + &line(&rule) + &body.collect::<String>()
    };
    let mut text = table(&COLUMNS, outcomes.iter().map(row).collect());
    if !figures.is_empty() {
        text += "\n";
        text += &table(&FIGURE_COLUMNS, figure_rows(figures));
    }
    text
}

/// The page.
pub fn report(outcomes: &[Outcome], figures: &[Figure]) -> Report {
    let explained = outcomes.iter().filter(|o| o.verdict == "explained").count();
    let table = Table {
        caption: "Root mean square over held-out records, in brackets of their range".into(),
        columns: COLUMNS.map(String::from).to_vec(),
        rows: outcomes.iter().map(row).collect(),
    };
    let benchmarks = Table {
        caption: "Published benchmarks, by their official split".into(),
        columns: FIGURE_COLUMNS.map(String::from).to_vec(),
        rows: figure_rows(figures),
    };
    let is_some = |table: &Table| !table.rows.is_empty();
    let mut sections = vec![Section {
        heading: "All sets".into(),
        tables: [table, benchmarks].into_iter().filter(is_some).collect(),
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

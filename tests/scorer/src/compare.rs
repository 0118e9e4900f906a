//! A table of methods that were run on the same cases.

use crate::figures::{Figures, Score};
use crate::report::{median, rate};
use crate::run::{Collected, Error};
use crate::scored::Scored;
use crate::statistics::Rate;
use std::collections::BTreeSet;

/// A method and its score.
pub struct Method {
    /// Its name.
    pub name: String,
    /// Its score.
    pub score: Score,
}

/// The text of a table cell from a score.
type Cell = fn(&Score) -> String;

/// The columns of the table, after the method's name.
const CELLS: [(&str, Cell); 11] = [
    ("one, exactly named", |s| rate(s.visible.single)),
    ("two", |s| rate(s.visible.pair)),
    ("three", |s| rate(s.visible.triple)),
    ("false alarms", |s| rate(s.visible.false_alarms)),
    ("unlisted, yet named", |s| rate(others(s.visible.unnamed))),
    ("gap removed, unseen record", |s| {
        median(s.visible.share_unseen)
    }),
    ("a signal worse without a warning", |s| {
        rate(others(s.visible.none_worse))
    }),
    ("right names of those given with 0.9 to 1", sure_names),
    ("no answer", |s| rate(unanswered(s))),
    ("processor time [s], median, largest", |s| {
        format!("{:.1}, {:.1}", s.cost.cpu_s[0], s.cost.cpu_s[2])
    }),
    ("memory [MB], largest", |s| {
        format!("{:.0}", 1e-6 * s.cost.peak_memory_bytes[2])
    }),
];

/// The share of cases that did not.
fn others(rate: Rate) -> Rate {
    Rate::new(rate.of - rate.hits, rate.of)
}

/// Cases without a diagnosis that can be read.
fn unanswered(score: &Score) -> Rate {
    Rate::among(&score.cases, |case| case.fault.is_some())
}

/// Whether names hold that were given with a high probability, or that there are none.
fn sure_names(score: &Score) -> String {
    let Figures { sure_names, .. } = score.visible;
    let given = score.names.bins.iter().any(|bin| bin.count > 0);
    match (given, sure_names.of) {
        (false, _) => "no probabilities".into(),
        (true, 0) => "none given".into(),
        (true, _) => rate(sure_names),
    }
}

impl Method {
    /// Scores the cases of a method.
    pub fn new(name: String, cases: &[Collected]) -> Method {
        let score = Score::of(cases.iter().map(Scored::new).collect());
        Method { name, score }
    }

    fn cases(&self) -> BTreeSet<&str> {
        let cases = self.score.cases.iter();
        cases.map(|case| case.answer.id.as_str()).collect()
    }
}

/// The methods as a Markdown table, a row for each.
///
/// # Errors
/// They were not run on the same cases.
pub fn markdown(methods: &[Method]) -> Result<String, Error> {
    for pair in methods.windows(2) {
        let (first, second) = (pair[0].cases(), pair[1].cases());
        if let Some(id) = first.symmetric_difference(&second).next() {
            let (has, lacks) = match first.contains(id) {
                true => (&pair[0].name, &pair[1].name),
                false => (&pair[1].name, &pair[0].name),
            };
            let why = format!("{has} was run on case {id}, {lacks} was not: run both on it");
            return Err(Error::Other(why));
        }
    }
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let names = CELLS.iter().map(|(name, _)| (*name).to_owned());
    let mut table = line(std::iter::once("method".to_owned()).chain(names).collect());
    table += &line(vec!["---".into(); CELLS.len() + 1]);
    for method in methods {
        let cells = CELLS.iter().map(|(_, cell)| cell(&method.score));
        table += &line(std::iter::once(method.name.clone()).chain(cells).collect());
    }
    Ok(table)
}

//! One diagnosis against one answer.

use crate::answer::{Answer, Kind};
use crate::diagnosis::{Diagnosis, Named, Verdict};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// How a diagnosis did.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// What had to be said, and nothing else.
    Right,
    /// As many effects as are hidden, a true name among the `alternatives` instead of on top.
    Ambiguous,
    /// Some of the hidden effects, nothing false.
    Partial,
    /// All hidden effects, and more.
    Extra,
    /// A name of something that is not there.
    Wrong,
    /// A name where nothing is hidden.
    FalseAlarm,
    /// `consistent`, though something is hidden.
    Missed,
    /// `unexplained` without a name, where a name or `consistent` was right.
    Abstained,
    /// No diagnosis, or one that cannot be read.
    NoAnswer,
}

impl Outcome {
    /// All of them, best first.
    pub const ALL: [Outcome; 9] = [
        Outcome::Right,
        Outcome::Ambiguous,
        Outcome::Partial,
        Outcome::Extra,
        Outcome::Wrong,
        Outcome::FalseAlarm,
        Outcome::Missed,
        Outcome::Abstained,
        Outcome::NoAnswer,
    ];

    /// In a table.
    pub fn name(self) -> &'static str {
        match self {
            Outcome::Right => "right",
            Outcome::Ambiguous => "ambiguous",
            Outcome::Partial => "some",
            Outcome::Extra => "and more",
            Outcome::Wrong => "wrong name",
            Outcome::FalseAlarm => "false alarm",
            Outcome::Missed => "missed",
            Outcome::Abstained => "abstained",
            Outcome::NoAnswer => "no answer",
        }
    }
}

/// How `diagnosis` did; `None` is one that cannot be read.
pub fn outcome(answer: &Answer, diagnosis: Option<&Diagnosis>) -> Outcome {
    let Some(diagnosis) = diagnosis else {
        return Outcome::NoAnswer;
    };
    if diagnosis.effects.is_empty() {
        return match (answer.kind, diagnosis.verdict) {
            (Kind::None, Verdict::Consistent) | (Kind::Unlisted, Verdict::Unexplained) => {
                Outcome::Right
            }
            (_, Verdict::Unexplained) => Outcome::Abstained,
            _ => Outcome::Missed,
        };
    }
    match answer.kind {
        Kind::None => Outcome::FalseAlarm,
        // its name is in no catalogue: whatever was named instead is not there
        Kind::Unlisted => Outcome::Wrong,
        Kind::Single | Kind::Pair | Kind::Triple => named(answer, diagnosis),
    }
}

/// As [`outcome`], where something listed is hidden and something is named.
fn named(answer: &Answer, diagnosis: &Diagnosis) -> Outcome {
    let hidden: BTreeSet<&str> = answer.effects.iter().map(|e| e.name.as_str()).collect();
    let said = diagnosis.names();
    if said == hidden {
        Outcome::Right
    } else if said.is_superset(&hidden) {
        Outcome::Extra
    } else if said.is_subset(&hidden) {
        Outcome::Partial
    } else if said.len() == hidden.len() && told_apart(&hidden, &diagnosis.effects) {
        Outcome::Ambiguous
    } else {
        Outcome::Wrong
    }
}

/// Each hidden name can be given a named effect of its own that is it or lists it.
fn told_apart(hidden: &BTreeSet<&str>, named: &[Named]) -> bool {
    let Some(first) = hidden.first() else {
        return true;
    };
    let mut rest = hidden.clone();
    rest.pop_first();
    (0..named.len()).any(|i| {
        let candidate = &named[i];
        let others = [&named[..i], &named[i + 1..]].concat();
        let listed = candidate.alternatives.iter().any(|name| name == first);
        (candidate.name == *first || listed) && told_apart(&rest, &others)
    })
}

/// A diagnosis as a column of the confusion matrix.
pub fn column(diagnosis: Option<&Diagnosis>) -> String {
    let Some(diagnosis) = diagnosis else {
        return "no answer".into();
    };
    match (diagnosis.effects.as_slice(), diagnosis.verdict) {
        ([], Verdict::Unexplained) => "unexplained".into(),
        ([], _) => "none".into(),
        ([one], _) => one.name.clone(),
        _ => "several".into(),
    }
}

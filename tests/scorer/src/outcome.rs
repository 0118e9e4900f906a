//! Compares a diagnosis with the answer of its case.

use crate::answer::{Answer, Kind};
use crate::diagnosis::{Diagnosis, Named, Verdict};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The outcome of a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The right result.
    Right,
    /// The right number of effects, but a true name only among the `alternatives`.
    Ambiguous,
    /// Some of the hidden effects, and no other.
    Partial,
    /// All hidden effects, and others.
    Extra,
    /// An effect that is not hidden.
    Wrong,
    /// An effect is named, but none is hidden.
    FalseAlarm,
    /// `consistent`, although an effect is hidden.
    Missed,
    /// `unexplained` without a name, although a name or `consistent` is right.
    Abstained,
    /// No readable diagnosis.
    NoAnswer,
}

impl Outcome {
    /// All outcomes, best first.
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

    /// The name in tables.
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

/// The outcome of `diagnosis`; `None` if it cannot be read.
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
        // its name is in no catalogue: every named effect is false
        Kind::Unlisted => Outcome::Wrong,
        Kind::Single | Kind::Pair | Kind::Triple => named(answer, diagnosis),
    }
}

/// As [`outcome`], if listed effects are hidden and effects are named.
fn named(answer: &Answer, diagnosis: &Diagnosis) -> Outcome {
    let hidden: BTreeSet<&str> = answer.effects.iter().map(|e| e.name.as_str()).collect();
    let said = diagnosis.names();
    if said == hidden {
        Outcome::Right
    } else if said.is_superset(&hidden) {
        Outcome::Extra
    } else if said.is_subset(&hidden) {
        Outcome::Partial
    } else if said.len() == hidden.len() && are_assignable(&hidden, &diagnosis.effects) {
        Outcome::Ambiguous
    } else {
        Outcome::Wrong
    }
}

/// Whether each hidden effect can be assigned to a different named effect that has its name or
/// lists it as an alternative.
fn are_assignable(hidden: &BTreeSet<&str>, named: &[Named]) -> bool {
    let Some(first) = hidden.first() else {
        return true;
    };
    let mut rest = hidden.clone();
    rest.pop_first();
    (0..named.len()).any(|i| {
        let candidate = &named[i];
        let others = [&named[..i], &named[i + 1..]].concat();
        let listed = candidate.alternatives.iter().any(|name| name == first);
        (candidate.name == *first || listed) && are_assignable(&rest, &others)
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

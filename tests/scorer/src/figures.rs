//! The benchmark's figures, of all cases and of subsets.

use crate::answer::Kind;
use crate::outcome::Outcome;
use crate::reliability::Reliability;
use crate::scored::Scored;
use crate::statistics::{Median, Rate, quantile};
use serde::Serialize;
use std::collections::BTreeMap;

/// Figures of some cases.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Number of cases.
    pub cases: usize,
    /// Single effects whose name, and no other, is given.
    pub single: Rate,
    /// Pairs of which both names, and no other, are given.
    pub pair: Rate,
    /// Three effects of which all names, and no other, are given.
    pub triple: Rate,
    /// Cases without hidden effects and with the verdict `consistent`.
    pub consistent: Rate,
    /// Cases without hidden effects in which an effect is named (false alarms).
    pub false_alarms: Rate,
    /// Unlisted effects that were left `unexplained` and unnamed.
    pub abstained: Rate,
    /// Unlisted effects without a named effect, with any verdict.
    pub unnamed: Rate,
    /// Listed effects that were only among the alternatives.
    pub ambiguous: Rate,
    /// Right names with the verdict that they do not explain all of the data.
    pub right_with_remainder: Rate,
    /// Share of the gap above the noise that is removed, of listed effects, on validation records.
    pub share_validation: Median,
    /// The same on records that were used neither for the fit nor for the validation.
    pub share_unseen: Median,
    /// Cases in which no signal is predicted worse than before without a warning.
    pub none_worse: Rate,
    /// Of the names given with a probability of 0.9 and more, the right ones.
    pub sure_names: Rate,
    /// Expected calibration error of the probabilities of names; `None` without any.
    pub calibration_error: Option<f64>,
    /// True parameters inside their intervals.
    pub inside_ci95: Rate,
    /// Rightly named effects fitted in their true form, of those whose true form the tool has.
    pub forms_shared: Rate,
    /// Parameters of these that the diagnosis does not give.
    pub parameters_missing: Rate,
    /// Time of a diagnosis \[s\].
    pub wall_s: Median,
}

impl Figures {
    /// The figures of `cases`.
    pub fn of(cases: &[&Scored]) -> Figures {
        let with = |kind: Kind, outcome: Outcome| {
            let of_kind = cases.iter().filter(|case| case.answer.kind == kind);
            Rate::among(of_kind, |case| case.outcome == outcome)
        };
        let listed = || cases.iter().filter(|case| case.listed());
        let right = listed().filter(|case| case.outcome == Outcome::Right);
        let parameters = || cases.iter().flat_map(|case| &case.parameters);
        let answered = cases.iter().filter(|case| case.fault.is_none());
        let unlisted = cases
            .iter()
            .filter(|case| case.answer.kind == Kind::Unlisted && case.outcome != Outcome::NoAnswer);
        let probabilities = || cases.iter().flat_map(|case| &case.named_probabilities);
        let sure = probabilities().filter(|(probability, _)| *probability >= 0.9);
        let reliability = Reliability::of(probabilities().copied());
        Figures {
            cases: cases.len(),
            single: with(Kind::Single, Outcome::Right),
            pair: with(Kind::Pair, Outcome::Right),
            triple: with(Kind::Triple, Outcome::Right),
            consistent: with(Kind::None, Outcome::Right),
            false_alarms: with(Kind::None, Outcome::FalseAlarm),
            abstained: with(Kind::Unlisted, Outcome::Right),
            unnamed: Rate::among(unlisted, |case| case.named.is_empty()),
            none_worse: Rate::among(answered, |case| case.worse_unwarned.is_empty()),
            sure_names: Rate::among(sure, |(_, right)| *right),
            calibration_error: reliability.error,
            ambiguous: Rate::among(listed(), |case| case.outcome == Outcome::Ambiguous),
            right_with_remainder: Rate::among(right, |case| case.right_with_remainder()),
            share_validation: Median::new(listed().filter_map(|case| case.share_validation)),
            share_unseen: Median::new(listed().filter_map(|case| case.share_unseen)),
            inside_ci95: Rate::among(parameters().filter_map(|p| p.inside()), |inside| *inside),
            forms_shared: Rate::among(cases.iter().flat_map(|c| &c.forms_shared), |same| **same),
            parameters_missing: Rate::among(parameters(), |p| p.estimate.is_none()),
            wall_s: Median::new(cases.iter().map(|case| case.wall_s)),
        }
    }
}

/// A figure with its interval.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(untagged)]
pub enum Figure {
    /// A share of cases.
    Rate(Rate),
    /// A median.
    Median(Median),
    /// A number.
    Number(Option<f64>),
}

impl Figure {
    /// The figure, if there are cases.
    pub fn value(self) -> Option<f64> {
        match self {
            Figure::Rate(rate) => rate.value,
            Figure::Median(median) => median.value,
            Figure::Number(value) => value,
        }
    }
}

/// A required range of a figure.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Reach {
    /// In words.
    pub name: &'static str,
    /// Lower limit.
    pub least: f64,
    /// Upper limit.
    pub most: f64,
    /// The figure.
    #[serde(skip)]
    pub pick: fn(&Figures) -> Figure,
}

/// The required ranges on visible cases.
pub const REACH: [Reach; 11] = [
    reach("exact name of single effects", 0.97, 1.0, |f| {
        Figure::Rate(f.single)
    }),
    reach("both names of pairs", 0.9, 1.0, |f| Figure::Rate(f.pair)),
    reach("all names of triples", 0.7, 1.0, |f| Figure::Rate(f.triple)),
    reach("false alarms on none", 0.0, 0.005, |f| {
        Figure::Rate(f.false_alarms)
    }),
    reach("no name of unlisted effects", 0.95, 1.0, |f| {
        Figure::Rate(f.unnamed)
    }),
    reach("gap removed, validation records", 0.9, f64::INFINITY, |f| {
        Figure::Median(f.share_validation)
    }),
    reach("gap removed, unseen record", 0.9, f64::INFINITY, |f| {
        Figure::Median(f.share_unseen)
    }),
    reach("no signal worse without a warning", 1.0, 1.0, |f| {
        Figure::Rate(f.none_worse)
    }),
    reach("right names of those with 0.9 and more", 0.95, 1.0, |f| {
        Figure::Rate(f.sure_names)
    }),
    reach("expected calibration error", 0.0, 0.03, |f| {
        Figure::Number(f.calibration_error)
    }),
    reach("true parameter inside its ci95", 0.9, 0.99, |f| {
        Figure::Rate(f.inside_ci95)
    }),
];

const fn reach(name: &'static str, least: f64, most: f64, pick: fn(&Figures) -> Figure) -> Reach {
    Reach {
        name,
        least,
        most,
        pick,
    }
}

impl Reach {
    /// Whether the figure is within its range; `None` if there are no cases.
    pub fn met(&self, figures: &Figures) -> Option<bool> {
        let value = (self.pick)(figures).value()?;
        // with few cases a high coverage does not show that intervals are too wide
        let most = match (self.pick)(figures) {
            Figure::Rate(rate) if self.least > 0.0 => rate.ci95.map_or(value, |ci95| ci95[0]),
            _ => value,
        };
        Some(value >= self.least && most <= self.most)
    }

    /// In words.
    pub fn target(&self) -> String {
        // decimals that are zero are omitted
        let percent = |share: f64| format!("{} %", (1e4 * share).round() / 1e2);
        match (self.least, self.most) {
            (0.0, most) => format!("≤ {}", percent(most)),
            (least, 1.0..) => format!("≥ {}", percent(least)),
            (least, most) => format!("{} to {}", percent(least), percent(most)),
        }
    }
}

/// The criterion of a subset of the cases; a case may be in several subsets, or in none.
type Keys = fn(&Scored) -> Vec<String>;

/// The criteria by which the cases are divided.
const DIMENSIONS: [(&str, Keys); 7] = [
    ("kind", |case| vec![case.answer.kind.name().into()]),
    ("effect", |case| {
        case.answer.effects.iter().map(|e| e.name.clone()).collect()
    }),
    ("form", |case| {
        let forms = case.answer.effects.iter();
        forms.map(|e| format!("{}, {}", e.name, e.form)).collect()
    }),
    ("size", |case| {
        case.answer
            .least_size()
            .map(size_class)
            .into_iter()
            .collect()
    }),
    ("force channel", |case| {
        vec![
            if case.answer.force_channel {
                "with"
            } else {
                "without"
            }
            .into(),
        ]
    }),
    ("records", |case| vec![case.answer.records.clone()]),
    ("beginning", |case| {
        vec![
            if case.answer.starts_moving {
                "in motion"
            } else {
                "at rest"
            }
            .into(),
        ]
    }),
];

/// Third of the range of sizes.
fn size_class(size: f64) -> String {
    match size {
        ..0.333_333 => "1: barely visible",
        ..0.666_667 => "2: middling",
        _ => "3: plain",
    }
    .into()
}

/// The cases divided by one criterion.
#[derive(Clone, Debug, Serialize)]
pub struct Dimension {
    /// Name of the criterion.
    pub name: &'static str,
    /// Figures of each subset.
    pub parts: BTreeMap<String, Figures>,
}

/// The cases divided by each criterion.
pub fn dimensions(cases: &[&Scored]) -> Vec<Dimension> {
    let part = |(name, keys): (&'static str, Keys)| {
        let mut parts: BTreeMap<String, Vec<&Scored>> = BTreeMap::new();
        for case in cases {
            for key in keys(case) {
                parts.entry(key).or_default().push(case);
            }
        }
        let figures = parts
            .into_iter()
            .map(|(key, cases)| (key, Figures::of(&cases)));
        Dimension {
            name,
            parts: figures.collect(),
        }
    };
    DIMENSIONS.map(part).into()
}

/// Number of cases by true label and column.
pub type Confusion = BTreeMap<String, BTreeMap<String, usize>>;

/// The confusion matrix of all but pairs and triples.
pub fn confusion(cases: &[&Scored]) -> Confusion {
    let mut matrix = Confusion::new();
    let several = [Kind::Pair, Kind::Triple];
    for case in cases
        .iter()
        .filter(|case| !several.contains(&case.answer.kind))
    {
        let row = matrix.entry(case.answer.label()).or_default();
        *row.entry(case.column.clone()).or_default() += 1;
    }
    matrix
}

/// Number of cases by kind and outcome.
pub type Outcomes = BTreeMap<Kind, BTreeMap<Outcome, usize>>;

/// Outcomes by kind.
pub fn outcomes(cases: &[&Scored]) -> Outcomes {
    let mut counts = Outcomes::new();
    for case in cases {
        let row = counts.entry(case.answer.kind).or_default();
        *row.entry(case.outcome).or_default() += 1;
    }
    counts
}

/// Time and memory of the diagnoses.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Cost {
    /// Median, 95 % quantile and largest time \[s\].
    pub wall_s: [f64; 3],
    /// The same of time on processors \[s\].
    pub cpu_s: [f64; 3],
    /// The same of the largest memory.
    pub peak_memory_bytes: [f64; 3],
}

impl Cost {
    /// Of `cases`.
    pub fn of(cases: &[&Scored]) -> Cost {
        let of = |value: fn(&Scored) -> f64| {
            let mut sorted: Vec<f64> = cases.iter().map(|case| value(case)).collect();
            sorted.sort_by(f64::total_cmp);
            [0.5, 0.95, 1.0].map(|share| quantile(&sorted, share).unwrap_or(0.0))
        };
        Cost {
            wall_s: of(|case| case.wall_s),
            cpu_s: of(|case| case.cpu_s),
            peak_memory_bytes: of(|case| case.peak_memory_bytes as f64),
        }
    }
}

/// All figures of a benchmark.
#[derive(Clone, Debug, Serialize)]
pub struct Score {
    /// Version of this format.
    pub schema: u32,
    /// Figures of the visible cases, on which all figures except the last ones are based.
    pub visible: Figures,
    /// Figures of the visible cases with the force channel.
    pub with_force: Figures,
    /// Figures of the visible cases without it.
    pub without_force: Figures,
    /// Figures of subsets of the visible cases.
    pub dimensions: Vec<Dimension>,
    /// Confusion of names.
    pub confusion: Confusion,
    /// Outcomes by kind.
    pub outcomes: Outcomes,
    /// Outcomes of the cases that are not visible.
    pub faint_outcomes: Outcomes,
    /// Outcomes of the cases in which an effect cannot be distinguished from another.
    pub tied_outcomes: Outcomes,
    /// Reliability diagram of the probabilities of names, of all cases.
    pub names: Reliability,
    /// Reliability diagram of the probabilities of hypotheses.
    pub hypotheses: Reliability,
    /// Time and memory, of all cases.
    pub cost: Cost,
    /// Every case.
    pub cases: Vec<Scored>,
}

impl Score {
    /// Of `cases`.
    pub fn of(cases: Vec<Scored>) -> Score {
        let all: Vec<&Scored> = cases.iter().collect();
        let (visible, faint): (Vec<&Scored>, Vec<&Scored>) = all
            .iter()
            .filter(|case| !case.tied)
            .partition(|case| case.visible);
        let tied: Vec<&Scored> = all.iter().copied().filter(|case| case.tied).collect();
        let (with, without): (Vec<&Scored>, Vec<&Scored>) =
            visible.iter().partition(|case| case.answer.force_channel);
        Score {
            schema: 2,
            visible: Figures::of(&visible),
            with_force: Figures::of(&with),
            without_force: Figures::of(&without),
            dimensions: dimensions(&visible),
            confusion: confusion(&visible),
            outcomes: outcomes(&visible),
            faint_outcomes: outcomes(&faint),
            tied_outcomes: outcomes(&tied),
            names: Reliability::of(all.iter().flat_map(|c| &c.named_probabilities).copied()),
            hypotheses: Reliability::of(
                all.iter()
                    .flat_map(|c| &c.hypothesis_probabilities)
                    .copied(),
            ),
            cost: Cost::of(&all),
            cases,
        }
    }

    /// Visible cases that are not right.
    pub fn wrong(&self) -> impl Iterator<Item = &Scored> {
        let wrong = |case: &&Scored| case.visible && case.outcome != Outcome::Right;
        self.cases.iter().filter(wrong)
    }

    /// Whether every figure with cases is within its required range, and every case has a diagnosis
    /// (a tool that fails on each case would have no false alarm).
    pub fn reached(&self) -> bool {
        let answered = |case: &Scored| case.outcome != Outcome::NoAnswer;
        let met = |reach: &Reach| reach.met(&self.visible) != Some(false);
        self.cases.iter().all(answered) && REACH.iter().all(met)
    }
}

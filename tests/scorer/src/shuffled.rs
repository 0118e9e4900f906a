//! Ablation with the answers permuted among the cases: the figures that chance reaches.

use crate::answer::{Answer, Kind};
use crate::diagnosis::Diagnosis;
use crate::outcome::{Outcome, outcome};
use crate::run::Collected;
use crate::statistics::{Rate, quantile};
use hil_sim::report::{Report, Section, Table};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::Serialize;

/// One figure, true and by chance.
#[derive(Clone, Debug, Serialize)]
pub struct Chance {
    /// In words.
    pub name: &'static str,
    /// With each case's own answer.
    pub own: Rate,
    /// Mean over the permutations.
    pub mean: f64,
    /// Its 2.5 % and 97.5 % quantiles over the permutations.
    pub ci95: [f64; 2],
    /// Share of permutations that do as well as the own answers.
    pub as_good: f64,
}

/// What is counted: a name, the kind of case, the outcome.
const COUNTED: [(&str, Kind, Outcome); 5] = [
    ("exact name of single effects", Kind::Single, Outcome::Right),
    ("both names of pairs", Kind::Pair, Outcome::Right),
    ("all names of triples", Kind::Triple, Outcome::Right),
    (
        "consistent where nothing is hidden",
        Kind::None,
        Outcome::Right,
    ),
    (
        "abstention on unlisted effects",
        Kind::Unlisted,
        Outcome::Right,
    ),
];

fn rates(pairs: &[(&Answer, Option<&Diagnosis>)]) -> [Rate; 5] {
    COUNTED.map(|(_, kind, counted)| {
        let of_kind = pairs
            .iter()
            .filter(|(answer, _)| answer.kind == kind && answer.visible());
        Rate::among(of_kind, |(answer, diagnosis)| {
            outcome(answer, *diagnosis) == counted
        })
    })
}

/// Figures with the answers permuted `permutations` times.
pub fn shuffled(cases: &[Collected], permutations: usize, seed: u64) -> Vec<Chance> {
    let mut answers: Vec<&Answer> = cases.iter().map(|case| &case.answer).collect();
    let diagnoses = || cases.iter().map(|case| case.diagnosis.as_ref().ok());
    let own: Vec<_> = answers.iter().copied().zip(diagnoses()).collect();
    let own = rates(&own);
    let rng = &mut Pcg64::seed_from_u64(seed);
    let mut by_chance: [Vec<f64>; 5] = Default::default();
    for _ in 0..permutations {
        answers.shuffle(rng);
        let pairs: Vec<_> = answers.iter().copied().zip(diagnoses()).collect();
        for (values, rate) in by_chance.iter_mut().zip(rates(&pairs)) {
            values.extend(rate.value);
        }
    }
    let chance = |i: usize| {
        let values = &mut by_chance[i];
        values.sort_by(f64::total_cmp);
        let count = values.len() as f64;
        let at = |share| quantile(values, share).unwrap_or(0.0);
        let as_good = values
            .iter()
            .filter(|value| own[i].value.is_some_and(|own| **value >= own));
        Chance {
            name: COUNTED[i].0,
            own: own[i],
            mean: values.iter().sum::<f64>() / count.max(1.0),
            ci95: [at(0.025), at(0.975)],
            as_good: as_good.count() as f64 / count.max(1.0),
        }
    };
    (0..COUNTED.len()).map(chance).collect()
}

/// The report.
pub fn report(chances: &[Chance], permutations: usize, command: &str) -> Report {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let row = |chance: &Chance| {
        let own = chance.own;
        vec![
            chance.name.into(),
            own.value.map_or("no case".into(), |v| {
                format!("{}/{} = {}", own.hits, own.of, percent(v))
            }),
            percent(chance.mean),
            format!("{} to {}", percent(chance.ci95[0]), percent(chance.ci95[1])),
            percent(chance.as_good),
        ]
    };
    let columns = [
        "figure",
        "own answers",
        "shuffled",
        "95 % of them",
        "as good as own",
    ];
    Report {
        title: "Ablation: answers shuffled among the cases".into(),
        verdict: vec![format!(
            "With the answers permuted {permutations} times, this is what chance reaches."
        )],
        sections: vec![Section {
            heading: "Chance".into(),
            tables: vec![Table {
                caption: "Of cases in which what is hidden shows".into(),
                columns: columns.map(String::from).into(),
                rows: chances.iter().map(row).collect(),
            }],
            ..Section::default()
        }],
        repeat: vec![command.into()],
    }
}

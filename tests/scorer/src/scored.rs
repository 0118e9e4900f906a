//! The score of one case, on which the figures are based.

use crate::answer::{Answer, Hidden, Kind};
use crate::diagnosis::{Diagnosis, Hypothesis, Named, Verdict};
use crate::gap::Gaps;
use crate::outcome::{Outcome, column, outcome};
use crate::run::Collected;
use crate::shared::Shared;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A parameter with the same meaning in the truth and in the diagnosis.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterScore {
    /// The effect.
    pub effect: String,
    /// The parameter, under the tool's name.
    pub parameter: String,
    /// Its true value.
    pub truth: f64,
    /// Value and interval in the diagnosis; `None` if it lacks the parameter.
    pub estimate: Option<(f64, [f64; 2])>,
}

impl ParameterScore {
    /// Whether the true value is inside the interval; `None` without an estimate.
    pub fn inside(&self) -> Option<bool> {
        let (_, [low, high]) = self.estimate?;
        Some((low..=high).contains(&self.truth))
    }
}

/// A scored case.
#[derive(Clone, Debug, Serialize)]
pub struct Scored {
    /// The answer.
    pub answer: Answer,
    /// Arguments of the tool besides those of the case.
    pub arguments: Vec<String>,
    /// Parts of the tool's own experiment, of which it was given a record, too.
    pub experiment: Vec<String>,
    /// Every hidden effect changes a held-out signal by enough of its noise, and none can be taken
    /// for another by any method.
    pub visible: bool,
    /// Some hidden effect can be taken for another by any method.
    pub tied: bool,
    /// The verdict.
    pub verdict: Option<Verdict>,
    /// Names of the effects that were named.
    pub named: Vec<String>,
    /// Names that these cannot be told from, as the diagnosis has it.
    pub alternatives: Vec<String>,
    /// Column of the confusion matrix.
    pub column: String,
    /// The outcome.
    pub outcome: Outcome,
    /// Why there is no diagnosis.
    pub fault: Option<String>,
    /// Least share of a signal's gap above the noise that is removed, by the diagnosis itself.
    pub share_explained: Option<f64>,
    /// Share of the gap above the noise that is gone on the validation records.
    pub share_validation: Option<f64>,
    /// The same on records that neither fit nor validation saw.
    pub share_unseen: Option<f64>,
    /// As `share_validation`, by signal.
    pub share_by_signal: BTreeMap<String, f64>,
    /// Largest relative difference between the gaps that the diagnosis claims and the measured.
    pub claim_difference: Option<f64>,
    /// Noise in the diagnosis over the true noise, by signal.
    pub noise_ratio: BTreeMap<String, f64>,
    /// Why gaps could not be measured.
    pub gap_fault: Option<String>,
    /// Each rightly named effect whose true form the tool has: fitted in that form.
    pub forms_shared: Vec<bool>,
    /// Parameters of those that are.
    pub parameters: Vec<ParameterScore>,
    /// Probability of each named effect, and whether it is hidden.
    pub named_probabilities: Vec<(f64, bool)>,
    /// Probability of each hypothesis, and whether it is what is hidden.
    pub hypothesis_probabilities: Vec<(f64, bool)>,
    /// Signals that the fitted rig predicts worse than the nominal one, with no warning of it.
    pub worse_unwarned: Vec<String>,
    /// Time the diagnosis took \[s\].
    pub wall_s: f64,
    /// Time on processors \[s\].
    pub cpu_s: f64,
    /// Largest memory.
    pub peak_memory_bytes: u64,
}

/// Parameters of `hidden` that mean the same in truth and diagnosis.
fn parameters(hidden: &Hidden, shared: &Shared, diagnosis: &Diagnosis) -> Vec<ParameterScore> {
    let named = diagnosis.effects.iter().find(|e| e.name == hidden.name);
    let estimate = |name| {
        let parameter = named?.parameters.get(name)?;
        Some((parameter.value, parameter.ci95))
    };
    let score = |(parameter, truth): (&'static str, f64)| ParameterScore {
        effect: hidden.name.clone(),
        parameter: parameter.into(),
        truth,
        estimate: estimate(parameter),
    };
    let values = shared.values(&hidden.standard);
    values.into_iter().map(score).collect()
}

fn claimed(diagnosis: &Diagnosis) -> Gaps {
    let pick = |pick: fn(&crate::diagnosis::Gap) -> f64| {
        let gaps = diagnosis.gap.iter();
        gaps.map(|(signal, gap)| (signal.clone(), pick(gap)))
            .collect()
    };
    Gaps {
        before: pick(|gap| gap.before),
        after: pick(|gap| gap.after),
    }
}

/// Probability of each named effect, and whether it is hidden.
fn named_probabilities(answer: &Answer, named: &[Named]) -> Vec<(f64, bool)> {
    let hides = |name: &str| answer.effects.iter().any(|hidden| hidden.name == name);
    let probability = |named: &Named| Some((named.probability?, hides(&named.name)));
    named.iter().filter_map(probability).collect()
}

/// Probability of each hypothesis, and whether it is what is hidden.
fn hypothesis_probabilities(answer: &Answer, diagnosis: Option<&Diagnosis>) -> Vec<(f64, bool)> {
    let unlisted = answer.kind == Kind::Unlisted;
    let hidden: BTreeSet<&str> = match unlisted {
        true => BTreeSet::new(),
        false => answer.effects.iter().map(|e| e.name.as_str()).collect(),
    };
    let is_hidden = |hypothesis: &Hypothesis| {
        let effects: BTreeSet<&str> = hypothesis.effects.iter().map(String::as_str).collect();
        effects == hidden && hypothesis.unknown.is_empty() != unlisted
    };
    let hypotheses = diagnosis.into_iter().flat_map(|d| &d.hypotheses);
    hypotheses.map(|h| (h.probability, is_hidden(h))).collect()
}

/// Relative growth of a gap that is more than the sampling of its noise explains.
const WORSE: f64 = 1.05;
/// Multiple of the noise below which a gap counts as zero.
const AT_NOISE: f64 = 1.1;

/// Signals with a larger gap after the diagnosis than before, with no warning of it.
fn worse_unwarned(case: &Collected) -> Vec<String> {
    let Ok(diagnosis) = &case.diagnosis else {
        return Vec::new();
    };
    let worse = |gaps: &Gaps, signal: &str, noise: f64| {
        let (before, after) = (gaps.before.get(signal), gaps.after.get(signal));
        let grows = |(before, after): (&f64, &f64)| *after > WORSE * before;
        after.is_some_and(|after| *after > AT_NOISE * noise) && before.zip(after).is_some_and(grows)
    };
    let records = [&case.run.validation, &case.run.unseen];
    let signals = case.answer.noise.iter().filter(|(signal, noise)| {
        let mut gaps = records.iter().filter_map(|gaps| gaps.as_ref().ok());
        gaps.any(|gaps| worse(gaps, signal, **noise)) && !diagnosis.warns_of(signal)
    });
    signals.map(|(signal, _)| signal.clone()).collect()
}

impl Scored {
    /// Judges a case.
    pub fn new(case: &Collected) -> Scored {
        let (answer, run) = (&case.answer, &case.run);
        let diagnosis = case.diagnosis.as_ref().ok();
        let outcome = outcome(answer, diagnosis);
        let validation = run.validation.as_ref().ok();
        let share = |gaps: Option<&Gaps>| match (diagnosis, gaps) {
            (Some(_), Some(gaps)) => gaps.share_removed(&answer.noise),
            // no diagnosis, or a fitted rig that cannot be simulated, removes nothing
            _ => Some(0.0),
        };
        let of_signal = |signal: &String| {
            let share = validation?.share_removed_of(signal, &answer.noise)?;
            Some((signal.clone(), share))
        };
        let noise_ratio = |(signal, noise): (&String, &f64)| {
            let claimed = diagnosis?.gap.get(signal)?.noise;
            Some((signal.clone(), claimed / noise))
        };
        let right = diagnosis.filter(|_| outcome == Outcome::Right);
        let shared: Vec<(&Hidden, &Shared, bool)> = answer
            .effects
            .iter()
            .filter(|hidden| right.is_some() && !hidden.standard.is_empty())
            .filter_map(|hidden| Some((hidden, Shared::find(&hidden.name, &hidden.form)?)))
            .map(|(hidden, shared)| {
                let form = case.forms.get(&hidden.name).map(String::as_str);
                (hidden, shared, shared.is_form(form))
            })
            .collect();
        let same = shared.iter().filter(|(_, _, same)| *same);
        let parameters = same
            .flat_map(|(hidden, shared, _)| right.map(|d| parameters(hidden, shared, d)))
            .flatten()
            .collect();
        let effects = diagnosis.map(|d| d.effects.as_slice()).unwrap_or_default();
        let difference = |d| validation.map(|gaps| gaps.largest_difference(&claimed(d)));
        Scored {
            answer: answer.clone(),
            arguments: run.arguments.clone(),
            experiment: run.experiment.clone(),
            visible: answer.visible() && answer.distinguishable(),
            tied: !answer.distinguishable(),
            verdict: diagnosis.map(|d| d.verdict),
            named: effects.iter().map(|e| e.name.clone()).collect(),
            alternatives: effects
                .iter()
                .flat_map(|e| e.alternatives.clone())
                .collect(),
            column: column(diagnosis),
            outcome,
            fault: case.diagnosis.as_ref().err().cloned(),
            share_explained: diagnosis.and_then(Diagnosis::removed_least),
            share_validation: share(validation),
            share_unseen: share(run.unseen.as_ref().ok()),
            share_by_signal: answer.noise.keys().filter_map(of_signal).collect(),
            claim_difference: diagnosis.and_then(difference),
            noise_ratio: answer.noise.iter().filter_map(noise_ratio).collect(),
            gap_fault: run
                .validation
                .as_ref()
                .and(run.unseen.as_ref())
                .err()
                .cloned(),
            forms_shared: shared.iter().map(|(_, _, same)| *same).collect(),
            parameters,
            named_probabilities: named_probabilities(answer, effects),
            hypothesis_probabilities: hypothesis_probabilities(answer, diagnosis),
            worse_unwarned: worse_unwarned(case),
            wall_s: run.ended.wall_s,
            cpu_s: run.ended.cpu_s,
            peak_memory_bytes: run.ended.peak_memory_bytes,
        }
    }

    /// Whether a listed effect is hidden.
    pub fn listed(&self) -> bool {
        matches!(self.answer.kind, Kind::Single | Kind::Pair | Kind::Triple)
    }

    /// Whether the names are right, with the verdict that they do not explain all of the data.
    pub fn right_with_remainder(&self) -> bool {
        self.listed()
            && self.outcome == Outcome::Right
            && matches!(self.verdict, Some(Verdict::Unexplained | Verdict::Partial))
    }

    /// The result of the diagnosis as text.
    pub fn said(&self) -> String {
        if let Some(fault) = &self.fault {
            return format!("no answer: {fault}");
        }
        let verdict = match self.verdict {
            Some(Verdict::Consistent) => "consistent",
            Some(Verdict::Unexplained) => "unexplained",
            Some(Verdict::Partial) => "partial",
            Some(Verdict::Explained) | None => "",
        };
        let names = self.named.join(" + ");
        let mut said = match (verdict, names.as_str()) {
            ("", names) => names.into(),
            (verdict, "") => verdict.to_owned(),
            (verdict, names) => format!("{names}, {verdict}"),
        };
        if !self.alternatives.is_empty() {
            said += &format!(" (or {})", self.alternatives.join(", "));
        }
        said
    }
}

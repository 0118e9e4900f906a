//! Real measurements, diagnosed set by set, beside what is published.
//!
//! The sets have no licence to be kept here, but for the cylinder's: a folder that the user names
//! holds them, one folder a set, as records or CSV in SI units. No number here is fitted to them:
//! [`muscle`] starts from the braid's geometry, [`cylinder`] from the bore, [`tanks`] from what the
//! benchmark says of itself.

pub mod cylinder;
pub mod muscle;
pub mod report;
pub mod tanks;

use hil_sim::report::Plot;
use model_discrepancy::engine::{Candidate, Model, Parameter};
use model_discrepancy::verdict::{Choice, Verdict};
use serde::Serialize;
use std::path::Path;

/// What became of one set.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Outcome {
    /// What was measured.
    pub set: String,
    /// What was fitted.
    pub fitted: Vec<String>,
    /// What was held out.
    pub held_out: Vec<String>,
    /// The signal that is compared, and its unit.
    pub signal: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Largest less smallest value of it, held out.
    pub range: f64,
    /// What the model alone misses on held-out records, root mean square, calibrated to the fitted
    /// records.
    pub calibrated: f64,
    /// What it misses with the named effects.
    pub after: f64,
    /// What no model can explain: noise, and what the rig does not repeat.
    pub noise: f64,
    /// The verdict, in a word; `refused` where the tool takes no such record.
    pub verdict: String,
    /// Named effects with their sizes.
    pub effects: Vec<Found>,
    /// What remains, or why it was refused.
    pub remains: String,
    /// The experiment that would tell.
    pub next_experiment: String,
    /// What the tool doubts.
    pub warnings: Vec<String>,
    /// Time it took \[s\].
    pub spent_s: f64,
    /// Plots of a held-out record.
    #[serde(skip)]
    pub plots: Vec<Plot>,
}

/// A named effect.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    /// Its name.
    pub name: String,
    /// Its size, in words.
    pub size: String,
    /// What is published of it.
    pub published: &'static str,
    /// Other effects that would do as well.
    pub alternatives: Vec<&'static str>,
}

impl Outcome {
    /// A set that the tool refuses, with its words.
    pub fn refused(set: &str, why: String) -> Outcome {
        Outcome {
            set: set.into(),
            verdict: "refused".into(),
            remains: why,
            ..Outcome::default()
        }
    }

    /// What a model other than the muscle's has chosen.
    fn chosen<M: Model>(&mut self, model: &M, choice: &Choice, published: &[(&str, &'static str)]) {
        self.verdict = word(choice.verdict).into();
        if choice.verdict != Verdict::Explained {
            return;
        }
        for (place, (candidate, values)) in choice.best.fit.effects.iter().enumerate() {
            let candidate = &model.candidates()[*candidate];
            let parameters = candidate.parameters.iter().zip(values);
            let sizes: Vec<String> = parameters
                .map(|(parameter, value)| {
                    format!("{} {value:.3e} {}", parameter.name, parameter.unit)
                })
                .collect();
            let known = published.iter().find(|(name, _)| *name == candidate.effect);
            self.effects.push(Found {
                name: candidate.effect.into(),
                size: sizes.join(", "),
                published: known.map_or("", |(_, words)| words),
                alternatives: choice.alternatives.get(place).cloned().unwrap_or_default(),
            });
        }
    }
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Consistent => "consistent",
        Verdict::Explained => "explained",
        Verdict::Unexplained => "unexplained",
    }
}

/// Root mean square.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0_f64), |(sum, count), v| (sum + v * v, count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

/// Diagnoses every set that `folder` has; the others are told on stderr.
pub fn all(folder: &Path) -> Vec<Outcome> {
    let mut outcomes = muscle::all(folder);
    outcomes.extend(cylinder::all(folder));
    outcomes.extend(tanks::all(folder));
    outcomes
}

/// The folder of a set; none, reported on stderr, if it is missing.
fn set_of(folder: &Path, set: &str) -> Option<std::path::PathBuf> {
    let path = folder.join(set);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("{set} is left out: {} does not have it", folder.display());
    None
}

/// What a fit leaves over held-out records, root mean square, where one noise is the unit of all
/// residuals.
fn held_out<M: Model>(model: &M, fit: &model_discrepancy::engine::Fit, noise: f64) -> f64 {
    let records = model.fitted()..model.records();
    let residuals = records.flat_map(|record| {
        let blocks = 0..model.blocks().len();
        let of = move |block| model.residuals(record, block, &fit.nominal, &fit.effects);
        blocks.filter_map(of).flat_map(|all| all.values)
    });
    noise * rms(residuals)
}

/// Standard deviation of white noise on a smooth signal, from its third differences.
fn noise_of(values: &[f64]) -> f64 {
    let third = values
        .windows(4)
        .map(|v| v[3] - 3.0 * v[2] + 3.0 * v[1] - v[0]);
    // Their variance is σ²(1+9+9+1).
    rms(third) / 20.0_f64.sqrt()
}

/// Largest less smallest.
fn range(values: impl Iterator<Item = f64>) -> f64 {
    let all = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    all.1 - all.0
}

/// An effect of a model that has one block.
fn candidate(
    (effect, form, parameters): (&'static str, &'static str, Vec<Parameter>),
) -> Candidate {
    Candidate {
        effect,
        form,
        parameters,
        blocks: vec![0],
        form_doubt: 0.05,
    }
}

/// A parameter whose usual size is given.
fn parameter(name: &'static str, unit: &'static str, range: (f64, f64), usual: f64) -> Parameter {
    Parameter {
        name,
        unit,
        range,
        usual,
        log: false,
        neutral: Some(0.0),
        ends: [false; 2],
    }
}

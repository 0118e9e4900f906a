//! Diagnosis of published measurements, compared with the published results.
//!
//! Except for the cylinder's, the licences of the data sets do not permit a copy here: they are in
//! a folder that the user names, one folder per set, as records or CSV in SI units. No number here
//! is fitted to them: [`muscle`] starts from the braid's geometry, [`cylinder`] from the bore,
//! [`benchmarks`] from their descriptions.

pub mod benchmarks;
pub mod cylinder;
pub mod muscle;
// Built with the packaged estimator, too. A doc comment here would take its links for this file's.
#[path = "../../plants/src/lib.rs"]
pub mod plants;
pub mod report;

use hil_sim::report::Plot;
use model_discrepancy::engine::{Candidate, Model, Parameter};
use model_discrepancy::verdict::Selection;
use plants::parameter;
use plants::signal::rms;
use serde::Serialize;
use std::path::Path;

/// The outcome of one set.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Outcome {
    /// Description of the measurement.
    pub set: String,
    /// Description of the fitted records.
    pub fitted: Vec<String>,
    /// Description of the held-out records.
    pub held_out: Vec<String>,
    /// The compared signal.
    pub signal: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Range of the signal in the held-out records.
    pub range: f64,
    /// Root mean square error on the held-out records of the model without effects, calibrated with
    /// the fitted records.
    pub calibrated: f64,
    /// The same error with the named effects.
    pub after: f64,
    /// Lower limit of the error: noise and repeatability.
    pub noise: f64,
    /// The verdict; `refused` if the tool refuses the records.
    pub verdict: String,
    /// Named effects with their sizes.
    pub effects: Vec<Found>,
    /// Description of the remaining residual, or the reason of the refusal.
    pub remains: String,
    /// The recommended experiment.
    pub next_experiment: String,
    /// Warnings of the tool.
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
    /// Its size, as text.
    pub size: String,
    /// The published value.
    pub published: &'static str,
    /// Other effects that explain the data equally well.
    pub alternatives: Vec<&'static str>,
}

impl Outcome {
    /// The outcome of a set that the tool refuses, with its message.
    pub fn refused(set: &str, why: String) -> Outcome {
        Outcome {
            set: set.into(),
            verdict: "refused".into(),
            remains: why,
            ..Outcome::default()
        }
    }

    /// Adds the result of a model other than the muscle's.
    fn selected<M: Model>(
        &mut self,
        model: &M,
        selection: &Selection,
        published: &[(&str, &'static str)],
    ) {
        self.verdict = selection.verdict.name().into();
        for (place, (candidate, values)) in selection.named.fit.effects.iter().enumerate() {
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
                alternatives: selection
                    .alternatives
                    .get(place)
                    .cloned()
                    .unwrap_or_default(),
            });
        }
    }
}

/// Diagnoses every set in `folder`; missing sets are reported on stderr.
pub fn all(folder: &Path) -> Vec<Outcome> {
    let mut outcomes = muscle::all(folder);
    outcomes.extend(cylinder::all(folder));
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

/// Root mean square residual of a fit on the held-out records, if the unit of all residuals is the
/// same noise.
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

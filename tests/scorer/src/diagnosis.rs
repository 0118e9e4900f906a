//! Reads `diagnosis.json`, strictly.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The nominal model explains the data.
    Consistent,
    /// The named effects explain the data.
    Explained,
    /// The named effects are certain, but do not explain all of the data.
    Partial,
    /// No known effects explain the data.
    Unexplained,
}

/// One parameter of a named effect.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Parameter {
    /// Its value, in `unit`.
    pub value: f64,
    /// Its 95 % confidence interval.
    pub ci95: [f64; 2],
    /// Its unit.
    pub unit: String,
}

/// One named effect.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Its subsystem.
    #[serde(rename = "where")]
    pub place: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, Parameter>,
    /// Effects that the data do not distinguish from this one.
    pub alternatives: Vec<String>,
    /// Posterior probability that it is present; from schema 2 on.
    pub probability: Option<f64>,
}

/// One hypothesis: a set of effects and its posterior probability.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Hypothesis {
    /// Its names.
    pub effects: Vec<String>,
    /// Subsystems with an unknown effect.
    #[serde(default)]
    pub unknown: Vec<String>,
    /// Its posterior probability.
    pub probability: f64,
}

/// Root mean square differences of one signal on the validation records.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Gap {
    /// With the nominal rig.
    pub before: f64,
    /// With the fitted rig.
    pub after: f64,
    /// Noise floor estimated from the data.
    pub noise: f64,
    /// Share of the gap above the noise that is removed, if the diagnosis has it.
    pub removed: Option<f64>,
}

/// A remaining residual.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Remaining {
    /// The equations in which it occurs.
    #[serde(rename = "where")]
    pub places: Vec<String>,
    /// The states in which it occurs, as text.
    pub when: String,
}

/// A diagnosis.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Version of the format.
    pub schema: u32,
    /// The verdict.
    pub verdict: Verdict,
    /// Effects that the nominal model lacks.
    pub effects: Vec<Named>,
    /// Gaps by signal.
    pub gap: BTreeMap<String, Gap>,
    /// Remaining residuals.
    pub remaining: Remaining,
    /// The recommended experiment.
    pub next_experiment: String,
    /// The posterior over sets of effects; from schema 2 on.
    #[serde(default)]
    pub hypotheses: Vec<Hypothesis>,
    /// Warnings; one about a signal that the fitted rig predicts worse than the nominal one
    /// contains the column's name.
    #[serde(default)]
    pub warnings: Vec<String>,
}

impl Diagnosis {
    /// The least share of a gap above the noise that is removed, over all signals that have one.
    pub fn removed_least(&self) -> Option<f64> {
        let removed = self.gap.values().filter_map(|gap| gap.removed);
        removed.min_by(f64::total_cmp)
    }

    /// Reads a diagnosis.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn parse(text: &str) -> Result<Diagnosis, String> {
        let diagnosis: Diagnosis =
            serde_json::from_str(text).map_err(|error| format!("not a diagnosis: {error}"))?;
        diagnosis.check()?;
        Ok(diagnosis)
    }

    /// Checks that it is consistent and has the gap of each of `signals`.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn covers<'a>(&self, signals: impl IntoIterator<Item = &'a str>) -> Result<(), String> {
        match signals
            .into_iter()
            .find(|signal| !self.gap.contains_key(*signal))
        {
            Some(signal) => Err(format!("no gap of `{signal}`, which was measured")),
            None => Ok(()),
        }
    }

    fn check(&self) -> Result<(), String> {
        if !(1..=2).contains(&self.schema) {
            return Err(format!("schema 1 or 2, found {}", self.schema));
        }
        self.check_probabilities()?;
        if self.names().len() < self.effects.len() {
            return Err("an effect is named twice".into());
        }
        match self.verdict {
            Verdict::Consistent if !self.effects.is_empty() => {
                return Err("consistent, yet it names an effect".into());
            }
            Verdict::Explained if self.effects.is_empty() => {
                return Err("explained, yet by no effect".into());
            }
            Verdict::Partial if self.effects.is_empty() => {
                return Err("partial, yet it names no effect".into());
            }
            _ => {}
        }
        for effect in &self.effects {
            let reversed = |p: &&Parameter| p.ci95[0] > p.ci95[1];
            if effect.parameters.values().any(|p| reversed(&p)) {
                return Err(format!("an interval of `{}` is upside down", effect.name));
            }
        }
        Ok(())
    }

    fn check_probabilities(&self) -> Result<(), String> {
        for effect in &self.effects {
            match effect.probability {
                Some(probability) if !(0.0..=1.0).contains(&probability) => {
                    return Err(format!("probability {probability} of `{}`", effect.name));
                }
                None if self.schema >= 2 => {
                    return Err(format!("no probability of `{}`", effect.name));
                }
                _ => {}
            }
        }
        let hypotheses = self.hypotheses.iter();
        let sum = hypotheses.fold(0.0, |sum, hypothesis| sum + hypothesis.probability);
        if self.schema >= 2 && (sum - 1.0).abs() > 0.01 {
            return Err(format!("probabilities of hypotheses sum to {sum:.3}"));
        }
        Ok(())
    }

    /// Whether a warning contains `signal`.
    pub fn warns_of(&self, signal: &str) -> bool {
        self.warnings.iter().any(|warning| warning.contains(signal))
    }

    /// Names of the effects.
    pub fn names(&self) -> BTreeSet<&str> {
        self.effects.iter().map(|e| e.name.as_str()).collect()
    }
}

//! The answer of a case, written by the generator: its hidden effects.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An effect is visible if it changes a held-out signal by at least this multiple of its noise.
pub const VISIBLE_OVER_NOISE: f64 = 3.0;

/// The kind of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// One listed effect.
    Single,
    /// Two listed effects.
    Pair,
    /// Three listed effects.
    Triple,
    /// No hidden effect.
    None,
    /// One effect that is in no catalogue of a diagnosis.
    Unlisted,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 5] = [
        Kind::Single,
        Kind::Pair,
        Kind::Triple,
        Kind::None,
        Kind::Unlisted,
    ];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        truth::Kind::from(self).name()
    }
}

impl From<Kind> for truth::Kind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Single => truth::Kind::Single,
            Kind::Pair => truth::Kind::Pair,
            Kind::Triple => truth::Kind::Triple,
            Kind::None => truth::Kind::None,
            Kind::Unlisted => truth::Kind::Unlisted,
        }
    }
}

/// One hidden effect.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Hidden {
    /// Its name.
    pub name: String,
    /// Its form.
    pub form: String,
    /// Size from 0 (barely visible) to 1 (obvious).
    pub size: f64,
    /// Parameters of the effect's simplest textbook form.
    pub standard: BTreeMap<String, f64>,
    /// Largest change of a signal on held-out records, over that signal's noise.
    pub most_over_noise: f64,
    /// Effects that can produce the same data, as far as the generator has computed them.
    #[serde(default)]
    pub indistinguishable_from: Vec<String>,
}

/// The answer to a case.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// Family of the laws: `drawn` or `catalogue-like`.
    pub family: String,
    /// Name of the case.
    pub id: String,
    /// Seed of the benchmark.
    pub seed: u64,
    /// Number of the case.
    pub index: u64,
    /// Kind of the case.
    pub kind: Kind,
    /// Whether the records contain the muscle's force.
    pub force_channel: bool,
    /// Kind of records: their length or their rate.
    pub records: String,
    /// Whether the records begin in motion.
    pub starts_moving: bool,
    /// The hidden effects.
    pub effects: Vec<Hidden>,
    /// Each measured signal's noise, in the column's unit.
    pub noise: BTreeMap<String, f64>,
}

impl Answer {
    /// Whether every hidden effect is visible; true without hidden effects.
    pub fn visible(&self) -> bool {
        let shows = |hidden: &Hidden| hidden.most_over_noise >= VISIBLE_OVER_NOISE;
        self.effects.iter().all(shows)
    }

    /// Whether every hidden effect can be distinguished from the others.
    pub fn distinguishable(&self) -> bool {
        let alone = |hidden: &Hidden| hidden.indistinguishable_from.is_empty();
        self.effects.iter().all(alone)
    }

    /// Names of the hidden effects with `+` between them, or `none`.
    pub fn label(&self) -> String {
        let names: Vec<&str> = self.effects.iter().map(|e| e.name.as_str()).collect();
        if names.is_empty() {
            "none".into()
        } else {
            names.join(" + ")
        }
    }

    /// Size of the smallest hidden effect.
    pub fn least_size(&self) -> Option<f64> {
        self.effects.iter().map(|e| e.size).reduce(f64::min)
    }

    /// Smallest ratio of an effect's change to the noise.
    pub fn least_over_noise(&self) -> Option<f64> {
        let changes = self.effects.iter().map(|e| e.most_over_noise);
        changes.reduce(f64::min)
    }
}

//! What a case hides, as the generator's answer tells it.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An effect counts where it changes a held-out signal by at least this many times its noise.
pub const VISIBLE_OVER_NOISE: f64 = 3.0;

/// What kind of thing is hidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// One listed effect.
    Single,
    /// Two listed effects.
    Pair,
    /// Three listed effects.
    Triple,
    /// Nothing.
    None,
    /// One effect that no diagnosis has a name for.
    Unlisted,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 5] = [
        Kind::Single,
        Kind::Pair,
        Kind::Triple,
        Kind::None,
        Kind::Unlisted,
    ];

    /// In a table.
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
    /// The form it takes.
    pub form: String,
    /// From 0, barely visible, to 1, plain.
    pub size: f64,
    /// Parameters that mean the same in the effect's simplest textbook form.
    pub standard: BTreeMap<String, f64>,
    /// Largest change of a signal on held-out records, over that signal's noise.
    pub most_over_noise: f64,
    /// Effects whose laws can make the same data, as far as the generator has computed it.
    #[serde(default)]
    pub indistinguishable_from: Vec<String>,
}

/// The answer to a case.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// How its laws are made: `drawn` or `catalogue-like`.
    pub family: String,
    /// Name of the case.
    pub id: String,
    /// Seed of the benchmark.
    pub seed: u64,
    /// Number of the case.
    pub index: u64,
    /// What kind of thing is hidden.
    pub kind: Kind,
    /// The records have the muscle's force.
    pub force_channel: bool,
    /// Kind of records: their length or their rate.
    pub records: String,
    /// The records begin in motion.
    pub starts_moving: bool,
    /// What is hidden.
    pub effects: Vec<Hidden>,
    /// Each measured signal's noise, in the column's unit.
    pub noise: BTreeMap<String, f64>,
}

impl Answer {
    /// Every hidden effect shows; so does having none.
    pub fn visible(&self) -> bool {
        let shows = |hidden: &Hidden| hidden.most_over_noise >= VISIBLE_OVER_NOISE;
        self.effects.iter().all(shows)
    }

    /// No hidden effect can be taken for another by any method.
    pub fn distinguishable(&self) -> bool {
        let alone = |hidden: &Hidden| hidden.indistinguishable_from.is_empty();
        self.effects.iter().all(alone)
    }

    /// Names of what is hidden, `+` between them; `none` if nothing is.
    pub fn label(&self) -> String {
        let names: Vec<&str> = self.effects.iter().map(|e| e.name.as_str()).collect();
        if names.is_empty() {
            "none".into()
        } else {
            names.join(" + ")
        }
    }

    /// Size of the least hidden effect: all of them have to be found.
    pub fn least_size(&self) -> Option<f64> {
        self.effects.iter().map(|e| e.size).reduce(f64::min)
    }

    /// Least of the effects' change over noise.
    pub fn least_over_noise(&self) -> Option<f64> {
        let changes = self.effects.iter().map(|e| e.most_over_noise);
        changes.reduce(f64::min)
    }
}

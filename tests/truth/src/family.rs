//! The two families of cases.

use clap::ValueEnum;

use crate::case::{Case, Kind};
use crate::drawn;
use crate::drive::Drive;

/// How the laws of hidden effects are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Family {
    /// Every law is drawn at random.
    #[default]
    Drawn,
    /// A few forms of each effect, on the paper's rig: for tests that need a known form.
    CatalogueLike,
}

impl Family {
    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Family::Drawn => "drawn",
            Family::CatalogueLike => "catalogue-like",
        }
    }

    /// Kind of case `index` of `seed`, and the names of its hidden effects.
    #[must_use]
    pub fn plan(self, seed: u64, index: u64) -> (Kind, Vec<&'static str>) {
        match self {
            Family::Drawn => {
                let plan = drawn::plan(seed, index);
                let names = plan.effects.iter().map(|(entry, _)| entry.name);
                (plan.kind, names.collect())
            }
            Family::CatalogueLike => {
                let plan = crate::plan(seed, index);
                let names = plan.effects.iter().map(|planned| planned.entry.name);
                (plan.kind, names.collect())
            }
        }
    }

    /// Name of case `index` of `seed`, which does not reveal the answer.
    #[must_use]
    pub fn id(self, seed: u64, index: u64) -> String {
        let letter = match self {
            Family::Drawn => 'd',
            Family::CatalogueLike => 's',
        };
        format!("{letter}{seed}-{index:05}")
    }

    /// Rows of each record of case `index` of `seed`, known without simulating it.
    #[must_use]
    pub fn rows(self, seed: u64, index: u64) -> usize {
        match self {
            Family::Drawn => drawn::rows(seed, index),
            Family::CatalogueLike => crate::rows(seed, index),
        }
    }

    /// Simulates case `index` of `seed`.
    #[must_use]
    pub fn case(self, seed: u64, index: u64) -> Case {
        match self {
            Family::Drawn => drawn::case(seed, index),
            Family::CatalogueLike => crate::case(seed, index),
        }
    }

    /// An additional record of a case with the given test signal, as CSV.
    ///
    /// # Panics
    /// If the drive has no sample, or leads to a state that is not physical.
    #[must_use]
    pub fn experiment(self, seed: u64, index: u64, drive: Drive) -> String {
        match self {
            Family::Drawn => drawn::experiment(seed, index, drive),
            Family::CatalogueLike => crate::experiment(seed, index, drive),
        }
    }

    /// Names of the effects that a diagnosis may have in its catalogue.
    #[must_use]
    pub fn listed(self) -> Vec<&'static str> {
        match self {
            Family::Drawn => {
                let listed = drawn::DRAWN.iter().filter(|entry| entry.listed);
                listed.map(|entry| entry.name).collect()
            }
            Family::CatalogueLike => {
                let listed = crate::CATALOGUE.iter().filter(|entry| entry.listed);
                listed.map(|entry| entry.name).collect()
            }
        }
    }
}

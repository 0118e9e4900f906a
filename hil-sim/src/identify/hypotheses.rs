//! How probable each set of missing effects is, whatever law they have.
//!
//! [`diagnose`](super::diagnosis::diagnose) does not use it: it is not good enough. Of the first
//! 21 cases of seed 11 of the catalogue-like truth, from their four records, the most probable set
//! is the true one in 13 (single effects 7 of 11, pairs 2 of 4, none 2 of 2, unlisted 2 of 4), and
//! wrong ones have probabilities above 0.9, too. A weight at rest is left out, so that friction,
//! backlash and slack are missed. Of two effects of the gas the second is found only if the first
//! is among the leading ones alone. Without a measured force, a payload is taken for nominal values
//! that are three standard deviations off.

use super::diagnosis::driven;
use super::muscle::MuscleModel;
use crate::error::BadInput;
use crate::record::Record;
use crate::rig::Rig;
use serde::Serialize;

/// Less probable hypotheses are not listed.
const PROBABILITY_MIN: f64 = 1e-6;

/// A set of missing effects.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hypothesis {
    /// Their names; none if nothing of the catalogue is missing.
    pub effects: Vec<&'static str>,
    /// Subsystems in which something else is missing that no effect of the catalogue does.
    pub unknown: Vec<&'static str>,
    /// Posterior probability \[-\].
    pub probability: f64,
}

/// The hypotheses on some records.
#[derive(Clone, Debug, Serialize)]
pub struct Posterior {
    /// Sets of missing effects, the most probable first.
    pub hypotheses: Vec<Hypothesis>,
    /// What is doubtful about the records.
    pub warnings: Vec<String>,
}

/// The probabilities of sets of effects that `rig` lacks in `records`; effects named in `without`
/// are left out of the catalogue. The method is in [`model_discrepancy::evidence`].
///
/// # Errors
/// Rig and records do not fit together, or do not suffice.
pub fn hypotheses(
    rig: &Rig,
    records: &[Record],
    without: &[String],
) -> Result<Posterior, BadInput> {
    let model = MuscleModel::new(rig, &driven(rig, records)?, &[], without)?;
    let expected = "a rig whose plant can follow the records";
    let posterior = model.hypotheses().ok_or_else(|| rig.bad_file(expected))?;
    let listed = posterior.into_iter().map(|(effects, own)| Hypothesis {
        effects,
        unknown: model.unknown_in(own.unknown),
        probability: own.probability,
    });
    Ok(Posterior {
        hypotheses: listed
            .filter(|own| own.probability >= PROBABILITY_MIN)
            .collect(),
        warnings: model.warnings(),
    })
}

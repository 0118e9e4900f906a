//! Selects the parts of a compensation, their order and their sizes.

use super::sizes::Sizes;
use super::trial::{Quality, Trial};
use super::{OFF_BY, Part, Stage};
use rayon::prelude::*;

/// Shares of a size that are tried; the best robust one is applied. With the second, a size that
/// was estimated too large by [`OFF_BY`] is compensated in full and not overcompensated.
const SHARES: [f64; 4] = [1.0, 1.0 / (1.0 + OFF_BY), 0.5, 0.3];
/// With this factor a distance that was estimated too short by [`OFF_BY`] is long enough.
const LONGER: f64 = 1.0 / (1.0 - OFF_BY);
/// Factors of distances that are tried: a longer distance is less steep where the motion reverses,
/// which leaves the loop margin for more of the size, or for a lead.
const DISTANCE_FACTORS: [f64; 3] = [LONGER, LONGER * LONGER, LONGER * LONGER * LONGER];
/// A part is applied if the error falls to this share of the error without it.
const BETTER: f64 = 0.98;
/// Step between leads that are tried \[s\].
const LEAD_STEP_S: f64 = 2.5e-3;
/// Number of those steps: leads up to 120 ms.
const LEAD_STEPS: u32 = 48;

/// Name of the part that compensates the lag of the whole loop, which every rig has.
const LAG: &str = "lag";

/// A part of the compensation that can be applied.
pub(super) struct Candidate {
    /// The names of the effects.
    pub name: String,
    /// The stage that compensates them.
    pub stage: Stage,
    /// Its sizes in full.
    pub sizes: Sizes,
}

/// An order in which parts are applied, and the factor of their distances.
#[derive(Clone, Copy)]
pub(super) struct Order {
    distance_factor: f64,
    /// Number of candidates before the lag.
    before_lag: usize,
}

impl Order {
    /// All orders that can differ in their result: each of [`DISTANCE_FACTORS`], with the lag last,
    /// as the others change it, and right after the sensors, as a small part of another candidate
    /// can cost most of the lead.
    pub fn all(candidates: &[Candidate]) -> Vec<Order> {
        let mut sizes = candidates.iter().map(|candidate| &candidate.sizes);
        let factors = if sizes.any(Sizes::have_distance) {
            &DISTANCE_FACTORS[..]
        } else {
            &DISTANCE_FACTORS[..1]
        };
        let sensors = candidates
            .iter()
            .filter(|candidate| candidate.stage.is_sensor())
            .count();
        let mut positions = vec![candidates.len(), sensors];
        positions.dedup();
        let with_factor = |distance_factor: &'static f64| {
            positions.iter().map(|before_lag| Order {
                distance_factor: *distance_factor,
                before_lag: *before_lag,
            })
        };
        factors.iter().flat_map(with_factor).collect()
    }
}

/// The parts that are applied or rejected, and the result.
pub(super) struct Selection {
    pub parts: Vec<Part>,
    pub sizes: Sizes,
    /// With these sizes; without margins.
    pub quality: Quality,
}

impl Selection {
    /// Nothing applied, with the quality `before`.
    pub fn none(before: &Quality) -> Selection {
        Selection {
            parts: Vec::new(),
            sizes: Sizes::default(),
            quality: *before,
        }
    }

    /// The `candidates` and the lag, in `order`; `before` is the quality without compensation.
    pub fn new(
        trial: &Trial,
        candidates: &[Candidate],
        before: &Quality,
        order: Order,
    ) -> Selection {
        let mut selection = Selection::none(before);
        let (early, late) = candidates.split_at(order.before_lag);
        for candidate in early {
            selection.apply(trial, candidate, before, order.distance_factor);
        }
        let lag = Candidate {
            name: LAG.into(),
            stage: Stage::Lag,
            sizes: Sizes::lead(best_lead_s(trial, &selection.sizes)),
        };
        selection.apply(trial, &lag, before, order.distance_factor);
        for candidate in late {
            selection.apply(trial, candidate, before, order.distance_factor);
        }
        selection
    }

    /// Applies the best share of `candidate` that is robust, if there is one.
    fn apply(
        &mut self,
        trial: &Trial,
        candidate: &Candidate,
        before: &Quality,
        distance_factor: f64,
    ) {
        let error = |quality: &Quality| candidate.stage.error(quality);
        let shares: &[f64] = if candidate.stage.is_sensor() {
            &[1.0]
        } else {
            &SHARES
        };
        let tried = shares.iter().filter_map(|share| {
            let sizes = self.sizes.with(&candidate.sizes, *share, distance_factor);
            let (quality, _) = trial.evaluate(sizes.settings(&trial.plain).ok()?).ok()?;
            Some((*share, sizes, quality))
        });
        let mut better: Vec<_> = tried
            .filter(|(.., quality)| error(quality) < BETTER * error(&self.quality))
            .collect();
        // The check of robustness takes long: the best first.
        better.sort_by(|(.., a), (.., b)| error(a).total_cmp(&error(b)));
        let best = better
            .into_iter()
            .find(|(_, sizes, quality)| trial.is_robust(sizes, quality, before));
        let words = if let Some((share, sizes, quality)) = best {
            let unit = if candidate.stage.is_sensor() {
                "Pa"
            } else {
                "N"
            };
            let (from, to) = (error(&self.quality), error(&quality));
            let percent = 100.0 * share;
            let distance = if candidate.sizes.have_distance() {
                format!(" over {distance_factor:.1} times its distance")
            } else {
                String::new()
            };
            (self.sizes, self.quality) = (sizes, quality);
            format!(
                "{percent:.0} % of it{distance}; the error falls from {from:.1} to {to:.1} {unit}"
            )
        } else {
            "off: in this rig's closed loop it does not reduce the error, or is not robust".into()
        };
        self.parts.push(Part {
            name: candidate.name.clone(),
            compensated: best.is_some(),
            words,
        });
    }
}

/// The lead beside `sizes` with which F follows F_c best \[s\]: the lag of the whole loop, from
/// hold, delay, valve and gas.
fn best_lead_s(trial: &Trial, sizes: &Sizes) -> f64 {
    let error_n = |lead_s: f64| {
        let settings = sizes.with_lead(lead_s).settings(&trial.plain).ok()?;
        let (quality, _) = trial.evaluate(settings).ok()?;
        Some((quality.tracking.error_n_rms, lead_s))
    };
    let leads_s: Vec<f64> = (0..=LEAD_STEPS)
        .map(|step| f64::from(step) * LEAD_STEP_S)
        .collect();
    leads_s
        .par_iter()
        .filter_map(|lead_s| error_n(*lead_s))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(0.0, |(_, lead_s)| lead_s)
}

//! What an effect would explain in another form than its own.
//!
//! No rig has a form of the catalogue exactly. What an effect leaves as its form is another's must
//! not be taken for a second effect, so the first is allowed to differ: in proportion to what
//! stands beside the residuals, or as part of it acts at another scale.

use super::{Active, Engine, Found, Hypothesis, Model, Problem, START_FACTOR, change};
use crate::least_squares::{Linearized, Problem as _, Slopes, at};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Share of an effect by which its form may differ from the rig's, larger or smaller with each
/// quantity beside the residuals.
const RESHAPED: f64 = 0.2;
/// Dampings with which such a share is sought, in curvatures of the cost.
const RESHAPINGS: [f64; 5] = [1e-6, 0.03, 0.3, 3.0, 30.0];

impl<M: Model> Engine<'_, M> {
    /// What `hypothesis` would cost over the first `records` if the candidates `reshaped` had other
    /// forms; only of the groups of blocks that have some of `of`.
    pub fn reshaped(
        &self,
        hypothesis: &Hypothesis,
        reshaped: &[usize],
        (records, of): (usize, &[usize]),
    ) -> Option<f64> {
        let groups = self.groups(&hypothesis.candidates).into_iter();
        let own = groups.filter(|(blocks, _)| of.iter().any(|block| blocks.contains(block)));
        let costs = own.map(|(blocks, candidates)| {
            let all = self.model.candidates();
            let reshaped = reshaped.iter().copied();
            let own = reshaped.filter(|c| candidates.contains(c) && all[*c].form_doubt > 0.0);
            let own: Vec<usize> = own.collect();
            let group = (records, &blocks[..], &candidates[..]);
            self.group_reshaped(hypothesis, group, &own)
        });
        costs.sum()
    }

    /// The blocks that the candidates of `hypothesis` and the nominal values tie to those of
    /// `candidate`.
    pub fn tied(&self, hypothesis: &Hypothesis, candidate: usize) -> Vec<usize> {
        let groups = self.groups(&hypothesis.candidates).into_iter();
        let own = groups.filter(|(_, candidates)| candidates.contains(&candidate));
        own.flat_map(|(blocks, _)| blocks).collect()
    }

    fn group_reshaped(
        &self,
        hypothesis: &Hypothesis,
        (records, blocks, candidates): (usize, &[usize], &[usize]),
        reshaped: &[usize],
    ) -> Option<f64> {
        let free = self.free(blocks);
        let x = self.coordinates(hypothesis, &free, candidates);
        let mut problem = Problem::new(self.model, blocks, &free, candidates);
        problem.records = records;
        let found = at(&mut problem, DVector::from_vec(x))?;
        if reshaped.is_empty() {
            return Some(found.cost);
        }
        // At the edge of what has a solution, nothing tells how it would change.
        let Some(mut slopes) = problem.slopes(&found.x, &found.residuals) else {
            return Some(found.cost);
        };
        let mut priors = problem.priors(&found.x);
        let own = priors.len();
        for candidate in reshaped {
            for share in self.shares((records, blocks), hypothesis, *candidate, &found) {
                slopes = slopes.beside(&share);
                priors.push((0.0, 0.0));
            }
        }
        let within = RESHAPINGS.iter().find_map(|damping| {
            let curvatures = slopes.values.column_iter().enumerate();
            let curvatures = curvatures.map(|(place, column)| {
                let damping = if place < own { 1e-9 } else { *damping };
                damping * column.norm_squared() + 1e-9
            });
            let linearized = Linearized {
                residuals: &found.residuals,
                slopes: &slopes,
                priors: &priors,
                damping: DVector::from_iterator(priors.len(), curvatures),
            };
            let step = linearized.minimum();
            let most = step.iter().skip(own).fold(0.0, |a: f64, b| a.max(b.abs()));
            (most <= RESHAPED).then(|| linearized.cost(&step))
        });
        Some(within.unwrap_or(found.cost).min(found.cost))
    }

    /// How residuals change as an effect of `hypothesis` vanishes, in proportion to each shape, or
    /// gives way to the same effect at another scale; what has no solution is left out.
    fn shares(
        &self,
        pieces: (usize, &[usize]),
        hypothesis: &Hypothesis,
        number: usize,
        found: &Found,
    ) -> Vec<Slopes> {
        let candidate = &self.model.candidates()[number];
        let effects = &hypothesis.fit.effects;
        let others = effects.iter().filter(|own| own.0 != number).cloned();
        let others: Vec<Active> = others.collect();
        let with = |own: &[Active]| {
            let with = [&others[..], own].concat();
            let with = (&hypothesis.fit.nominal[..], &with[..]);
            let moves = |block| candidate.blocks.contains(&block);
            change(self.model, pieces, &moves, with, (&found.residuals, false))
        };
        let mut shares = Vec::new();
        if let Some(whole) = with(&[]) {
            let shapes = self.shapes(pieces).into_iter();
            shares.extend(shapes.map(|shape| Slopes {
                values: whole.values.component_mul(&shape),
                slack: whole.slack.component_mul(&shape),
            }));
        }
        for (_, values) in effects.iter().filter(|own| own.0 == number) {
            let scales = candidate.parameters.iter().enumerate();
            for (place, parameter) in scales.filter(|(_, parameter)| parameter.log) {
                for factor in [START_FACTOR, START_FACTOR.recip()] {
                    let mut scaled = values.clone();
                    scaled[place] *= factor;
                    let (least, most) = parameter.range;
                    if (least..=most).contains(&scaled[place]) {
                        shares.extend(with(&[(number, scaled)]));
                    }
                }
            }
        }
        shares
    }

    /// One, and the quantities beside the residuals of `blocks` over `records`, from −1 to 1;
    /// without direction and time, by which other effects are told.
    fn shapes(&self, (records, blocks): (usize, &[usize])) -> Vec<DMatrix<f64>> {
        let mut shapes: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        let mut rows = 0;
        for record in 0..records {
            for block in blocks {
                for coordinate in self.model.context(record, *block) {
                    if !["time", "direction"].contains(&coordinate.name) {
                        let values = shapes.entry(coordinate.name).or_default();
                        values.resize(rows, 0.0);
                        values.extend(coordinate.values);
                    }
                }
                rows += self.model.rows(record, *block);
            }
        }
        let scaled = |mut values: Vec<f64>| {
            values.resize(rows, 0.0);
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let half = (0.5 * (most - least)).max(f64::MIN_POSITIVE);
            DMatrix::from_iterator(
                rows,
                1,
                values.iter().map(|v| {
                    if v.is_nan() {
                        0.0
                    } else {
                        (v - least) / half - 1.0
                    }
                }),
            )
        };
        let one = DMatrix::from_element(rows, 1, 1.0);
        let scaled: Vec<_> = shapes.into_values().map(scaled).collect();
        std::iter::once(one).chain(scaled).collect()
    }
}

//! Log evidence of a hypothesis: the probability density of all records, with nominal values,
//! parameters and laws of effects integrated out about their fit.

use super::{
    Active, Candidate, EFFECT_PRIOR, Engine, Found, Hypothesis, Model, Problem, START_FACTOR,
};
use crate::evidence::{Blocks, Linear, Prior};
use crate::least_squares::{Problem as _, at};
use crate::rows::{Rows, Timeline};
use nalgebra::{Cholesky, DMatrix, DVector};
use std::collections::BTreeMap;
use std::ops::Range;

/// Standard deviation of how far a rig's law may be from its form's, with each quantity beside the
/// residuals from its least to its largest value, and by acting in part at another scale.
const LAW: f64 = 0.4;
/// An effect stands beside what is unknown in the same block if it is so many times as large: then
/// the unknown is a hundredth of the variance.
const STANDS: f64 = 10.0;
/// A box's variance is this share of its squared half width.
const BOX_VARIANCE: f64 = 1.0 / 3.0;
/// Dead zones wider than this keep only rows so far apart \[s\]: what friction takes up is the same
/// as long as the weight rests.
const WIDE: f64 = 0.5;
const REST_S: f64 = 0.4;

/// Rows nearer together than this are merged into their mean \[s\]: what is left changes little in
/// that time.
const MERGED_S: f64 = 0.03;

/// A hypothesis with unknowns in some blocks.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// The blocks.
    pub unknown: Blocks,
    /// Its log evidence.
    pub log_evidence: f64,
    /// The candidates that do much more in some block than what is unknown there, and are not where
    /// they end: the others may be what explains most of that, and not be there.
    pub standing: Vec<usize>,
}

/// What a candidate does in a block that neither nominal values nor the others do, and what a sound
/// rig and other laws of the others may leave there, in bases.
struct Shown {
    candidate: usize,
    place: usize,
    size: f64,
    left: f64,
}

/// An effect in one block: its size, and how its law may change it.
struct Law {
    candidate: usize,
    /// How the residuals change as the effect vanishes.
    whole: DMatrix<f64>,
    /// How they change as its law does.
    shapes: Vec<DMatrix<f64>>,
}

impl<M: Model> Engine<'_, M> {
    /// `hypothesis` with an unknown in no block and in each set of blocks; `None` if an effect of
    /// it does not show, or without a solution.
    pub fn judgements(&self, hypothesis: &Hypothesis) -> Option<Vec<Judgement>> {
        let mut all = vec![Judgement {
            unknown: 0,
            log_evidence: -hypothesis.fit.free_run,
            standing: Vec::new(),
        }];
        for (blocks, candidates) in self.groups(&hypothesis.candidates) {
            let own = self.group_judgements(hypothesis, &blocks, &candidates)?;
            let both = |one: &Judgement, other: &Judgement| Judgement {
                unknown: one.unknown | other.unknown,
                log_evidence: one.log_evidence + other.log_evidence,
                standing: [&one.standing[..], &other.standing].concat(),
            };
            let pairs = all
                .iter()
                .flat_map(|one| own.iter().map(move |other| both(one, other)));
            all = pairs.collect();
        }
        // Without an unknown each has to show.
        let candidates = &hypothesis.candidates;
        let shows = |own: &Judgement| candidates.iter().all(|c| own.standing.contains(c));
        let every = all.iter().any(|own| own.unknown == 0 && shows(own));
        // What is beyond the end of an effect is another one, which may be in no catalogue.
        for (own, values) in &hypothesis.fit.effects {
            if self.model.candidates()[*own].ended(values).next().is_some() {
                for judgement in &mut all {
                    judgement.standing.retain(|candidate| candidate != own);
                }
            }
        }
        every.then_some(all)
    }

    /// Nominal values of `null`, which has no effects, with an unknown in every block: as far as
    /// records tell them if something is missing.
    pub fn nominal_beside_unknown(&self, null: &Hypothesis) -> Option<Vec<f64>> {
        let mut nominal = null.fit.nominal.clone();
        for (blocks, _) in self.groups(&[]) {
            let (linear, ..) = self.linear(null, &blocks, &[])?;
            let weights = linear.weights_beside_unknown()?;
            for (place, weight) in self.free(&blocks).into_iter().zip(&weights) {
                nominal[place] += weight;
            }
        }
        Some(nominal)
    }

    /// Judgements of the blocks of a group alone.
    fn group_judgements(
        &self,
        hypothesis: &Hypothesis,
        blocks: &[usize],
        candidates: &[usize],
    ) -> Option<Vec<Judgement>> {
        let key = self.place_of(hypothesis, blocks, candidates);
        if let Some(known) = self.judged.lock().ok()?.get(&key) {
            return known.clone();
        }
        let (linear, shown) = self.linear(hypothesis, blocks, candidates)?;
        let unknown = std::iter::once((0, 0));
        let unknown = unknown.chain(blocks.iter().enumerate().map(|(n, b)| (1 << n, 1 << b)));
        let judgements = unknown.map(|(own, all)| {
            let (log_evidence, amplitudes) = linear.log_evidence(own)?;
            let stands = |shown: &&Shown| {
                let is_unknown = own & (1 << shown.place) != 0;
                let unknown = if is_unknown {
                    amplitudes[shown.place]
                } else {
                    0.0
                };
                shown.size > (STANDS * unknown).max(1.0 + shown.left)
            };
            Some(Judgement {
                unknown: all,
                log_evidence,
                standing: shown.iter().filter(stands).map(|s| s.candidate).collect(),
            })
        });
        let found = judgements.collect::<Option<Vec<Judgement>>>();
        self.judged.lock().ok()?.insert(key, found.clone());
        found
    }

    /// The residuals of a group linear about the fit, and what the candidates do in its blocks.
    fn linear(
        &self,
        hypothesis: &Hypothesis,
        blocks: &[usize],
        candidates: &[usize],
    ) -> Option<(Linear, Vec<Shown>)> {
        let free = self.free(blocks);
        let x = self.coordinates(hypothesis, &free, candidates);
        let mut problem = Problem::new(self.model, blocks, &free, candidates).over_all();
        let found = at(&mut problem, DVector::from_vec(x))?;
        let slopes = problem.slopes(&found.x, &found.residuals)?.values;
        let laws: Vec<Law> = candidates
            .iter()
            .map(|own| self.law(blocks, hypothesis, *own, &found))
            .collect::<Option<_>>()?;
        let (nominal, parameters) = found.x.as_slice().split_at(free.len());
        let prior = |mean: f64, deviation: f64| Prior { mean, deviation };
        let mut priors: Vec<Prior> = nominal.iter().map(|x| prior(-x, 1.0)).collect();
        priors.extend(parameters.iter().map(|x| prior(1.0 - x, EFFECT_PRIOR)));
        let shapes = laws.iter().flat_map(|law| &law.shapes);
        priors.extend(shapes.map(|_| prior(0.0, LAW)));
        let mut linear = Vec::new();
        let mut shown = Vec::new();
        for (place, block) in blocks.iter().enumerate() {
            let (rows, merged) = self.rows_of(blocks, *block, &found);
            let wholes: Vec<DVector<f64>> = laws
                .iter()
                .map(|law| in_bases(&law.whole, &rows, &merged))
                .collect();
            let errors = laws.iter().zip(&wholes).map(|(law, whole)| {
                self.model.candidates()[law.candidate].form_doubt * whole.norm()
            });
            let errors: Vec<f64> = errors.collect();
            let nominal = (0..free.len())
                .map(|own| in_bases(&slopes.columns(own, 1).into_owned(), &rows, &merged));
            let nominal: Vec<DVector<f64>> = nominal.collect();
            for (number, law) in laws.iter().enumerate() {
                let without = |other: &usize| *other != number;
                let left: f64 = (0..laws.len()).filter(without).map(|n| errors[n]).sum();
                let others = (0..laws.len()).filter(without).map(|n| &wholes[n]);
                let others: Vec<&DVector<f64>> = nominal.iter().chain(others).collect();
                shown.push(Shown {
                    candidate: law.candidate,
                    place,
                    size: beyond(&wholes[number], &others),
                    left,
                });
            }
            let values = merged_values(&slopes, &laws, &found.residuals.values, &merged);
            linear.push((rows, values, errors.iter().sum()));
        }
        let nominal_blocks = free.iter().map(|nominal| {
            let acts = &self.model.nominal_blocks()[*nominal];
            let own = blocks.iter().enumerate();
            own.filter(|(_, block)| acts.contains(block))
                .fold(0, |mask, (place, _)| mask | (1 << place))
        });
        let nominal_blocks = nominal_blocks.collect();
        Some((Linear::new(linear, priors, nominal_blocks), shown))
    }

    /// The rows of `block` among the residuals of `blocks` over all records, each with those that
    /// it merges.
    fn rows_of(&self, blocks: &[usize], block: usize, found: &Found) -> (Rows, Vec<Range<usize>>) {
        let (mut rows, mut merged) = (Rows::default(), Vec::new());
        let mut first = 0;
        for record in 0..self.model.records() {
            for own in blocks {
                let count = self.model.rows(record, *own);
                if own == &block {
                    let slack = &found.residuals.slack[first..first + count];
                    rows.add(
                        &self.model.timeline(record, block),
                        slack,
                        (first, &mut merged),
                    );
                }
                first += count;
            }
        }
        (rows, merged)
    }

    /// How residuals change as an effect of `hypothesis` vanishes, and as its law is another.
    fn law(
        &self,
        blocks: &[usize],
        hypothesis: &Hypothesis,
        number: usize,
        found: &Found,
    ) -> Option<Law> {
        let candidate = &self.model.candidates()[number];
        let problem = Problem::new(self.model, blocks, &[], &[]).over_all();
        let effects = &hypothesis.fit.effects;
        let others = effects.iter().filter(|own| own.0 != number).cloned();
        let others: Vec<Active> = others.collect();
        let with = |own: &[Active]| {
            let with = [&others[..], own].concat();
            let with = (&hypothesis.fit.nominal[..], &with[..]);
            let moves = |block| candidate.blocks.contains(&block);
            problem.change(&found.residuals, &moves, with)
        };
        let whole = with(&[])?.values;
        let mut shapes = Vec::new();
        if candidate.form_doubt > 0.0 {
            let modulations = self.modulations((problem.records, blocks)).into_iter();
            shapes.extend(modulations.map(|shape| whole.component_mul(&shape)));
            let values = effects.iter().filter(|own| own.0 == number);
            shapes.extend(
                values
                    .flat_map(|(_, values)| scaled(candidate, values))
                    .filter_map(|values| Some(with(&[(number, values)])?.values)),
            );
        }
        Some(Law {
            candidate: number,
            whole,
            shapes,
        })
    }

    /// The quantities beside the residuals of `blocks` over `records`, from −1 to 1; without
    /// direction and time, by which other effects are told.
    fn modulations(&self, (records, blocks): (usize, &[usize])) -> Vec<DMatrix<f64>> {
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
            let place = |value: &f64| {
                if value.is_nan() {
                    0.0
                } else {
                    (value - least) / half - 1.0
                }
            };
            DMatrix::from_iterator(rows, 1, values.iter().map(place))
        };
        shapes.into_values().map(scaled).collect()
    }
}

impl Rows {
    /// Adds the rows of a record, which begin at `first`, and which of these each merges.
    fn add(
        &mut self,
        timeline: &Timeline,
        slack: &[f64],
        (first, merged): (usize, &mut Vec<Range<usize>>),
    ) {
        let mut begins = true;
        let mut rested_s = f64::NEG_INFINITY;
        let mut row = 0;
        while row < slack.len() {
            let (time_s, base) = (timeline.time_s[row], timeline.base[row]);
            let half_width = slack[row].max(0.0);
            let is_exact = |row: usize| slack[row] <= 0.0 && timeline.base[row] > 0.0;
            let mut end = row + 1;
            if is_exact(row) {
                while end < slack.len() && is_exact(end) && timeline.time_s[end] < time_s + MERGED_S
                {
                    end += 1;
                }
            }
            let is_again = half_width > WIDE && base > 0.0 && time_s < rested_s + REST_S;
            if !is_again {
                if half_width > WIDE && base > 0.0 {
                    rested_s = time_s;
                }
                let members = end - row;
                self.time_s.push(time_s);
                self.base.push(base * (members as f64).sqrt());
                self.begins.push(std::mem::take(&mut begins));
                let variance = 1.0 + BOX_VARIANCE * half_width * half_width;
                self.deviation.push(variance.sqrt());
                merged.push(first + row..first + end);
            }
            row = end;
        }
    }
}

/// Values of an effect with each of its scales larger and smaller.
fn scaled(candidate: &Candidate, values: &[f64]) -> Vec<Vec<f64>> {
    let scales = candidate.parameters.iter().enumerate();
    let scales = scales.filter(|(_, parameter)| parameter.log);
    let all = scales.flat_map(|(place, parameter)| {
        [START_FACTOR, START_FACTOR.recip()]
            .into_iter()
            .filter_map(move |factor| {
                let mut scaled = values.to_vec();
                scaled[place] *= factor;
                let (least, most) = parameter.range;
                (least..=most).contains(&scaled[place]).then_some(scaled)
            })
    });
    all.collect()
}

/// Slopes, shapes of laws and residuals, a column for each of some merged rows: the mean of equal
/// noises, in units of its own.
fn merged_values(
    slopes: &DMatrix<f64>,
    laws: &[Law],
    residuals: &[f64],
    merged: &[Range<usize>],
) -> DMatrix<f64> {
    let shapes: Vec<&DMatrix<f64>> = laws.iter().flat_map(|law| &law.shapes).collect();
    let weights = slopes.ncols() + shapes.len();
    let mut values = DMatrix::zeros(weights + 1, merged.len());
    for (mut target, members) in values.column_iter_mut().zip(merged) {
        let share = (members.len() as f64).sqrt().recip();
        for row in members.clone() {
            for own in 0..slopes.ncols() {
                target[own] += share * slopes[(row, own)];
            }
            for (own, shape) in shapes.iter().enumerate() {
                target[slopes.ncols() + own] += share * shape[(row, 0)];
            }
            target[weights] += share * residuals[row];
        }
    }
    values
}

/// A column over merged rows, in units of their base, so that its norm is an RMS.
fn in_bases(column: &DMatrix<f64>, rows: &Rows, merged: &[Range<usize>]) -> DVector<f64> {
    let pairs = merged.iter().zip(&rows.base);
    let pairs = pairs.filter(|(_, base)| **base > 0.0);
    let count = pairs.clone().count().max(1) as f64;
    let scaled = pairs.map(|(members, base)| {
        let sum: f64 = members.clone().map(|row| column[(row, 0)]).sum();
        sum / (members.len() as f64).sqrt() / base / count.sqrt()
    });
    DVector::from_vec(scaled.collect())
}

/// RMS of what `own` does that the others, moved by one deviation at the price of one base, do not.
fn beyond(own: &DVector<f64>, others: &[&DVector<f64>]) -> f64 {
    let count = others.len();
    let matrix = DMatrix::from_fn(count, count, |i, j| {
        others[i].dot(others[j]) + if i == j { 1.0 } else { 0.0 }
    });
    let vector = DVector::from_iterator(count, others.iter().map(|other| other.dot(own)));
    let explained = Cholesky::new(matrix).map_or(0.0, |f| f.solve(&vector).dot(&vector));
    (own.norm_squared() - explained).max(0.0).sqrt()
}

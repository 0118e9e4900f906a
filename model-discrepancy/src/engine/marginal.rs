//! Log evidence of a hypothesis: the probability density of all records, with nominal values,
//! parameters and laws of effects integrated out about their fit.

use super::{
    About, Active, Candidate, EFFECT_PRIOR, Engine, Found, Hypothesis, Model, Parameter, Problem,
    START_FACTOR,
};
use crate::evidence::{Beside, Blocks, Evidence, Linear, Prior, Remainder, Unknown, log_sum};
use crate::least_squares::{Residuals, Slopes, at, broyden, loss};
use crate::rows::{Rows, Timeline};
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Standard deviation of how far a rig's law may be from its form's, with each quantity beside the
/// residuals from its least to its largest value, and by acting in part at another scale.
const LAW: f64 = 0.4;
/// A law along a quantity is a sum of Legendre polynomials of degree 1, 2 and 3, whose standard
/// deviations are these shares of [`LAW`]: those of a Gaussian process with a squared exponential
/// covariance, as long as half of the quantity's range.
const DEGREES: [f64; 3] = [1.0, 0.54, 0.23];
/// Least and largest weight of a law: two and a half standard deviations or more.
const LAW_RANGE: (f64, f64) = (-1.0, 1.0);
/// An effect stands beside what is unknown in the same block if it is so many times as large: then
/// the unknown is a hundredth of the variance.
const STANDS: f64 = 10.0;
/// Standard deviations of a nominal value that are no surprise.
const TOLERATED: f64 = 2.0;
/// Points at which a shape is told.
const SHAPE_POINTS: usize = 9;
/// A box's variance is this share of its squared half width.
const BOX_VARIANCE: f64 = 1.0 / 3.0;
/// Of rows with dead zones wider than this one is kept as long as the weight rests and friction
/// takes up about the same, within half of the zone: what it takes up there is by chance once.
const WIDE: f64 = 0.5;

/// Rows nearer together than this are merged into their mean \[s\]: what is left changes little in
/// that time.
const MERGED_S: f64 = 0.03;
/// The evidence is expanded anew so often at most, as long as a step to the most probable values
/// promises so many nats.
const EXPANSIONS: usize = 12;
const PROMISED: f64 = 1.0;
/// An expansion is corrected so often in a row, as long as a step redeems this share of its
/// promise.
const CORRECTIONS: usize = 5;
const REDEEMED: f64 = 0.5;
/// The evidence is off by less than this share of what a step promises, as what is gained by one
/// that a trust region takes for good is between half of its promise and twice that.
const MISSING: f64 = 0.5;
/// Damping of the first step that is not as good as it promised, and by how much more or less the
/// next is damped.
const DAMPING: f64 = 1e-4;
const DAMPING_FACTOR: f64 = 10.0;

/// A hypothesis with unknowns in some blocks.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// The blocks.
    pub unknown: Blocks,
    /// Its log evidence.
    pub log_evidence: f64,
    /// By how much that may be more about its own mode.
    pub missing: f64,
    /// The candidates that do much more in some block than what is unknown there, and are not where
    /// they end: the others may be what explains most of that, and not be there.
    pub standing: Vec<usize>,
    /// Whether nothing is unknown, and each candidate shows somewhere.
    shows: bool,
}

impl Judgement {
    /// What its log evidence may be about its own mode.
    pub fn reach(&self) -> f64 {
        self.log_evidence + self.missing
    }
}

/// By how much records that were not fitted are missed beyond their noise and what a sound rig
/// leaves, in nats, and the standard deviation of that if there is nothing but these (of half a
/// sum of squares).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Missed {
    pub(crate) nats: f64,
    pub(crate) deviation: f64,
}

impl Missed {
    /// Of a block of which `fitted` rows were, at weights that these have made most probable, but
    /// for rows that are priors or have no part in the process.
    fn of(Remainder { rows, values, .. }: &Remainder, fitted: usize, weights: &[f64]) -> Missed {
        let with_residual = DVector::from_row_slice(&[weights, &[1.0]].concat());
        let (mut nats, mut squares) = (0.0, 0.0);
        for row in (fitted..values.ncols()).filter(|row| rows.base[*row] > 0.0) {
            let deviation = rows.deviation[row];
            let variance = 1.0 + (rows.base[row] / deviation).powi(2);
            nats += loss(values.column(row).dot(&with_residual) / deviation) - 0.5 * variance;
            squares += variance * variance;
        }
        Missed {
            nats: nats.max(0.0),
            deviation: (0.5_f64 * squares).sqrt(),
        }
    }
}

/// What a candidate does in a block that neither nominal values nor the others do, and what a sound
/// rig and other laws of the others may leave there, in bases.
struct Shown {
    candidate: usize,
    place: usize,
    size: f64,
    left: f64,
    /// How the block's merged rows change as the candidate vanishes, but for its laws.
    whole: Vec<f64>,
    /// The weights of its laws.
    laws: Range<usize>,
}

impl Shown {
    /// Whether the residuals of the block are less than they were without the candidate and its
    /// laws. Where an effect does something that the records do not show, and explains something in
    /// another block, it may be another one there.
    fn explains(&self, Remainder { rows, values, .. }: &Remainder, weights: &DVector<f64>) -> bool {
        let sum = |column: &[f64], places: Range<usize>| -> f64 {
            places.map(|n| weights[n] * column[n]).sum()
        };
        let gain = |row: usize| {
            let column = values.column(row);
            let column = column.as_slice();
            let residual = sum(column, 0..weights.len()) + column[weights.len()];
            let without = residual - sum(column, self.laws.clone()) + self.whole[row];
            (without * without - residual * residual) / rows.deviation[row].powi(2)
        };
        (0..values.ncols()).map(gain).sum::<f64>() > 0.0
    }
}

/// Blocks that stand or fall together, and the candidates on them.
type Group<'g> = (&'g [usize], &'g [usize]);

/// What is left in one block, and the rows that each of its rows merges.
#[derive(Clone)]
struct Left {
    remainder: Remainder,
    merged: Vec<Range<usize>>,
}

/// A group of a hypothesis, linear about its values.
struct Expansion {
    hypothesis: Hypothesis,
    linear: Linear,
    /// What `linear` is of, block by block.
    left: Vec<Left>,
    shown: Arc<[Shown]>,
    /// What nominal values do in each block: their products, in bases.
    nominal: Vec<DMatrix<f64>>,
    /// What weights of laws along a quantity belong to: candidate, its first weight, quantity.
    along: Vec<(usize, usize, Along)>,
    /// How many weights are of nominal values and parameters; those of laws' shapes follow.
    values: usize,
}

impl Expansion {
    /// The group after `step`, with the columns of its values corrected by what the step has shown
    /// (see [`broyden`]); laws, what is shown, which rows count and the zones in which a load may
    /// rest stay as they were. Costs one evaluation; none where it has no solution.
    fn corrected<M: Model>(
        &self,
        engine: &Engine<M>,
        group: Group,
        step: &DVector<f64>,
    ) -> Option<Expansion> {
        let hypothesis = self.moved(engine, group, step);
        let free = engine.free(group.0);
        let (_, found) = engine.found(&hypothesis, group, &free)?;
        let before = engine.coordinates(&self.hypothesis, &free, group.1);
        let step = &found.x - DVector::from_vec(before);
        let values = 0..self.values;
        let mut scale: DVector<f64> = DVector::zeros(self.values);
        for own in &self.left {
            let columns = own.remainder.values.rows_range(values.clone());
            scale +=
                DVector::from_iterator(self.values, columns.row_iter().map(|r| r.norm_squared()));
        }
        let along = broyden(&scale, &step);
        let mut left = self.left.clone();
        for (own, block) in left.iter_mut().zip(group.0) {
            let columns = &mut own.remainder.values;
            let last = columns.nrows() - 1;
            for (row, members) in own.merged.iter().enumerate() {
                let now = of_merged(members, |row| found.residuals.values[row]);
                if engine.model.proportional(*block) {
                    let half_width = half_width(&found.residuals.slack, members);
                    own.remainder.rows.deviation[row] = box_deviation(half_width);
                }
                let expected = columns[(last, row)]
                    + values
                        .clone()
                        .map(|n| columns[(n, row)] * step[n])
                        .sum::<f64>();
                columns[(last, row)] = now;
                if let Some(along) = &along {
                    for n in values.clone() {
                        columns[(n, row)] += along[n] * (now - expected);
                    }
                }
            }
        }
        let remainders = left.iter().map(|own| &own.remainder);
        let mut priors = engine.priors(free.len(), &found.x, group.1);
        priors.extend_from_slice(&self.linear.priors()[self.values..]);
        Some(Expansion {
            linear: Linear::new(remainders, priors, engine.places_of(&free, group.0)),
            hypothesis,
            left,
            shown: Arc::clone(&self.shown),
            nominal: self.nominal.clone(),
            along: self.along.clone(),
            values: self.values,
        })
    }

    /// What nominal values do in a block at `weights` beyond their tolerances, as an RMS in bases.
    fn excess(&self, place: usize, weights: &DVector<f64>) -> f64 {
        let products = &self.nominal[place];
        let beyond = DVector::from_fn(products.nrows(), |own, _| {
            // A value is as far from nominal as its prior is from it.
            let x = weights[own] - self.linear.priors()[own].mean;
            x - x.clamp(-TOLERATED, TOLERATED)
        });
        beyond.dot(&(products * &beyond)).max(0.0).sqrt()
    }

    /// Log density beside `unknown` at `weights`, with those of laws where they are most probable.
    fn settled_log_density(&self, unknown: Unknown, weights: &DVector<f64>) -> Option<f64> {
        let settled = self.linear.settled(unknown, self.values, weights)?;
        Some(self.linear.log_density(unknown, &settled))
    }

    /// The hypothesis with its values moved.
    fn moved<M: Model>(
        &self,
        engine: &Engine<M>,
        (blocks, candidates): Group,
        step: &DVector<f64>,
    ) -> Hypothesis {
        let mut moved = self.hypothesis.clone();
        let mut steps = step.iter();
        for (free, step) in engine.free(blocks).into_iter().zip(&mut steps) {
            moved.fit.nominal[free] += step;
        }
        let fit = &mut moved.fit;
        for ((own, values), coordinates) in fit.effects.iter_mut().zip(&mut fit.coordinates) {
            if !candidates.contains(own) {
                continue;
            }
            let parameters = &engine.model.candidates()[*own].parameters;
            let places = values.iter_mut().zip(coordinates).zip(parameters);
            for (((value, x), parameter), step) in places.zip(&mut steps) {
                let (least, most) = parameter.reach();
                *x = (*x + step).clamp(least, most);
                *value = parameter.value(*x);
            }
        }
        moved
    }
}

/// An expansion with what it is of.
pub(super) struct Expanded<'a> {
    expansion: Expansion,
    pub(super) about: About<'a>,
    pub(super) slopes: Slopes,
    pub(super) found: Found,
    pub(super) of_laws: Vec<Law>,
}

impl Expanded<'_> {
    /// What is left at the most probable values and laws.
    pub(super) fn beside_laws(&self) -> Option<BesideLaws> {
        let Expansion { linear, left, .. } = &self.expansion;
        let evidence = linear.evidence(Unknown::process(0))?;
        let remainders = left.iter().map(|own| &own.remainder);
        Some(BesideLaws {
            beside: linear.beside(&evidence, remainders)?,
            merged: left.iter().map(|own| own.merged.clone()).collect(),
        })
    }
}

/// What is left beside a hypothesis and its laws.
pub(super) struct BesideLaws {
    beside: Beside,
    /// The rows that each row of a block merges.
    merged: Vec<Vec<Range<usize>>>,
}

impl BesideLaws {
    /// By how much the log density grows by a share of `change`, and that share.
    pub(super) fn gain(&self, change: &DMatrix<f64>) -> (f64, f64) {
        let merged = self.merged.iter();
        self.beside
            .gain(merged.map(|merged| merged_column(change, merged)))
    }

    /// By how much it grows if the residuals, with their dead zones, are these.
    pub(super) fn gain_of(&self, Residuals { values, slack }: &Residuals) -> Option<f64> {
        let of_block = |merged: &Vec<Range<usize>>| {
            let deviation = |members| box_deviation(half_width(slack, members));
            let residual = |members| of_merged(members, |row| values[row]);
            (
                merged.iter().map(residual).collect(),
                merged.iter().map(deviation).collect(),
            )
        };
        self.beside.gain_of(self.merged.iter().map(of_block))
    }
}

/// The evidence of a hypothesis beside an unknown, about the mode of that.
struct Mode {
    evidence: Evidence,
    /// See [`Judgement`].
    missing: f64,
    about: Arc<Expansion>,
    /// The weights there, which are 0 but for those of laws.
    weights: DVector<f64>,
}

impl Mode {
    /// Log density there beside `unknown`, laws where they are most probable beside that.
    fn log_density(&self, unknown: Unknown) -> Option<f64> {
        self.about.settled_log_density(unknown, &self.weights)
    }

    /// Covariance of the weights.
    fn covariance(&self) -> Option<DMatrix<f64>> {
        self.about.linear.covariance(&self.evidence)
    }

    /// The candidates that stand beside processes of these amplitudes in the blocks, and beside
    /// those that have `ended`: what is beyond the end of an effect is another one, which may be in
    /// no catalogue.
    fn standing(&self, ended: &[usize], amplitude: impl Fn(usize) -> f64) -> Vec<usize> {
        let weights = &self.evidence.weights;
        let explains =
            |shown: &&Shown| shown.explains(&self.about.left[shown.place].remainder, weights);
        let shown = self.about.shown.iter().filter(explains);
        let (ended, open): (Vec<&Shown>, Vec<&Shown>) =
            shown.partition(|shown| ended.contains(&shown.candidate));
        let unknown = |place: usize| {
            let there = ended.iter().filter(|own| own.place == place);
            there.map(|own| own.size).fold(amplitude(place), f64::max)
        };
        let stands =
            |shown: &&Shown| shown.size > (STANDS * unknown(shown.place)).max(1.0 + shown.left);
        let standing = open.into_iter().filter(stands);
        standing.map(|shown| shown.candidate).collect()
    }
}

/// A quantity beside residuals, with its least value and half of its range.
#[derive(Clone, Copy)]
struct Along {
    name: &'static str,
    unit: &'static str,
    least: f64,
    half: f64,
    /// Means of the polynomials where the effect acts: a law is 1 there in the mean, as an effect's
    /// size is a parameter of its own. Else a law could take away all of what an effect does in one
    /// place, and be any function there.
    means: [f64; DEGREES.len()],
}

impl Along {
    /// The shape of a law of these weights, whose residuals change as an effect vanishes.
    fn shape(self, weights: Weights) -> Shape {
        let places = (0..SHAPE_POINTS).map(|n| 2.0 * n as f64 / (SHAPE_POINTS - 1) as f64 - 1.0);
        let degrees = places.clone().map(|place| {
            DVector::from(legendre(place).to_vec()) - DVector::from(self.means.to_vec())
        });
        let sd = degrees.clone().map(|degrees| {
            let variance = degrees.dot(&(&weights.covariance * &degrees));
            variance.max(0.0).sqrt()
        });
        Shape {
            coordinate: self.name,
            unit: self.unit,
            at: places
                .map(|place| self.least + self.half * (1.0 + place))
                .collect(),
            value: degrees
                .map(|degrees| 1.0 - degrees.dot(&weights.mean))
                .collect(),
            sd: sd.collect(),
        }
    }
}

/// Legendre polynomials of the degrees of a law, between −1 and 1; 0 where a quantity is not known.
fn legendre(place: f64) -> [f64; DEGREES.len()] {
    if place.is_nan() {
        return [0.0; DEGREES.len()];
    }
    let square = place * place;
    [place, 1.5 * square - 0.5, (2.5 * square - 1.5) * place]
}

/// The weights of a law along one quantity.
struct Weights {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Weights {
    fn new(mode: &Mode, covariance: &DMatrix<f64>, first: usize) -> Weights {
        let count = DEGREES.len();
        Weights {
            mean: mode.evidence.weights.rows(first, count).into_owned(),
            covariance: covariance.view((first, first), (count, count)).into_owned(),
        }
    }

    /// How many standard deviations they are from 0, squared.
    fn clearness(&self) -> f64 {
        let factor = Cholesky::new(self.covariance.clone());
        factor.map_or(0.0, |factor| self.mean.dot(&factor.solve(&self.mean)))
    }
}

/// How much larger than its form an effect is over one quantity: that over which it differs most
/// clearly.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Shape {
    /// The quantity.
    pub coordinate: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its values, over the records' range.
    pub at: Vec<f64>,
    /// Size of the effect there, in that of its form.
    pub value: Vec<f64>,
    /// Standard deviation of that.
    pub sd: Vec<f64>,
}

/// An effect in one block: its size, and how its law may change it.
pub(super) struct Law {
    candidate: usize,
    /// See [`Candidate::form_doubt`].
    form_doubt: f64,
    /// How the residuals change as the effect vanishes.
    whole: DMatrix<f64>,
    /// How they change as its law does: along quantities, then by acting at other scales.
    pub(super) shapes: Vec<DMatrix<f64>>,
    /// Standard deviations of the weights of these.
    pub(super) deviations: Vec<f64>,
    along: Vec<Along>,
}

impl<M: Model> Engine<'_, M> {
    /// `hypothesis` with an unknown in no block and in each set of blocks; `None` if an effect of
    /// it does not show, or without a solution.
    ///
    /// What may reach the log evidence `floor` is expanded about its own mode, the rest about the
    /// fit.
    pub fn judgements(&self, hypothesis: &Hypothesis, floor: f64) -> Option<Vec<Judgement>> {
        let groups = self.groups(&hypothesis.candidates);
        let of_group = |(blocks, candidates): &(Vec<usize>, Vec<usize>), floor| {
            self.group_judgements(hypothesis, (blocks, candidates), floor)
        };
        let about_fit = groups.iter().map(|group| of_group(group, f64::INFINITY));
        let mut by_group: Vec<Vec<Judgement>> = about_fit.collect::<Option<_>>()?;
        if floor < f64::INFINITY {
            let most = |own: &Vec<Judgement>| {
                let reach = own.iter().map(Judgement::reach);
                reach.fold(f64::NEG_INFINITY, f64::max)
            };
            let reach = by_group.iter().map(most).sum::<f64>() - hypothesis.fit.free_run;
            for (group, own) in groups.iter().zip(&mut by_group) {
                *own = of_group(group, floor - (reach - most(own)))?;
            }
        }
        let mut all = vec![Judgement {
            unknown: 0,
            log_evidence: -hypothesis.fit.free_run,
            missing: 0.0,
            standing: Vec::new(),
            shows: true,
        }];
        for own in by_group {
            let both = |one: &Judgement, other: &Judgement| Judgement {
                unknown: one.unknown | other.unknown,
                log_evidence: one.log_evidence + other.log_evidence,
                missing: one.missing + other.missing,
                standing: [&one.standing[..], &other.standing].concat(),
                shows: one.shows && other.shows,
            };
            let pairs = all
                .iter()
                .flat_map(|one| own.iter().map(move |other| both(one, other)));
            all = pairs.collect();
        }
        let shows = all.iter().any(|own| own.shows);
        shows.then_some(all)
    }

    /// Nominal values of `null`, which has no effects, with an unknown in every block: as far as
    /// records tell them if something is missing.
    pub fn nominal_beside_unknown(&self, null: &Hypothesis) -> Option<Vec<f64>> {
        let mut nominal = null.fit.nominal.clone();
        for (blocks, _) in self.groups(&[]) {
            let mode = self.mode_of(null, (&blocks, &[]), Unknown::process(Blocks::MAX))?;
            for place in self.free(&blocks) {
                nominal[place] = mode.about.hypothesis.fit.nominal[place];
            }
        }
        Some(nominal)
    }

    /// What is missed in the records that were not fitted with values and laws as they are most
    /// probable by those that were, linear about the fit; none without a solution.
    pub(crate) fn missed(&self, hypothesis: &Hypothesis) -> Option<Missed> {
        let mut whole = Missed::default();
        for (blocks, candidates) in self.groups(&hypothesis.candidates) {
            let own = self.expansion(hypothesis.clone(), (&blocks, &candidates))?;
            let is_fitted = |(record, _): &(usize, usize)| *record < self.model.fitted();
            let fitted = self.located(&blocks).filter(|(piece, _)| is_fitted(piece));
            let end = fitted.map(|(_, rows)| rows.end).last().unwrap_or(0);
            let count = |left: &Left| left.merged.partition_point(|rows| rows.start < end);
            let of_fitted = |left: &Left| left.remainder.first(count(left));
            let remainders: Vec<Remainder> = own.left.iter().map(of_fitted).collect();
            let (priors, places) = (own.linear.priors().to_vec(), self.free(&blocks));
            let linear = Linear::new(remainders.iter(), priors, self.places_of(&places, &blocks));
            let weights = linear.evidence(Unknown::process(0))?.weights;
            for left in &own.left {
                let block = Missed::of(&left.remainder, count(left), weights.as_slice());
                whole.nats += block.nats;
                whole.deviation = whole.deviation.hypot(block.deviation);
            }
        }
        Some(whole)
    }

    /// The shapes of the candidates of `hypothesis` over the quantities beside the residuals, about
    /// the mode of the evidence; none where a candidate's name says its form.
    pub fn shapes(&self, hypothesis: &Hypothesis) -> Vec<Option<Shape>> {
        let groups = self.groups(&hypothesis.candidates);
        let modes = groups.iter().filter_map(|(blocks, candidates)| {
            let mode = self.mode_of(hypothesis, (blocks, candidates), Unknown::process(0))?;
            let covariance = mode.covariance()?;
            Some((mode, covariance))
        });
        let modes: Vec<(Mode, DMatrix<f64>)> = modes.collect();
        let of = |candidate: &usize| {
            let laws = modes.iter().flat_map(|(mode, covariance)| {
                let own = mode.about.along.iter().filter(|own| own.0 == *candidate);
                own.map(|(_, first, along)| (Weights::new(mode, covariance, *first), *along))
            });
            let clearest = laws.max_by(|a, b| a.0.clearness().total_cmp(&b.0.clearness()));
            clearest.map(|(weights, along)| along.shape(weights))
        };
        hypothesis.candidates.iter().map(of).collect()
    }

    /// 95 % intervals of the parameters of the candidates of `hypothesis` beside an unknown in
    /// every block, about the mode of that.
    pub fn intervals_beside_unknown(&self, hypothesis: &Hypothesis) -> Option<Vec<Vec<[f64; 2]>>> {
        let all = self.model.candidates();
        let mut intervals = vec![Vec::new(); hypothesis.candidates.len()];
        for (blocks, candidates) in self.groups(&hypothesis.candidates) {
            let group = (&blocks[..], &candidates[..]);
            let mode = self.mode_of(hypothesis, group, Unknown::process(Blocks::MAX))?;
            let nominals = self.free(&blocks);
            let x = self.coordinates(&mode.about.hypothesis, &nominals, &candidates);
            let deviations = mode.covariance()?.diagonal().map(f64::sqrt);
            let weights = mode.evidence.weights.iter().zip(&deviations);
            let values = x.iter().zip(weights).skip(nominals.len());
            let parameters = candidates
                .iter()
                .flat_map(|own| all[*own].parameters.iter().map(move |p| (own, p)));
            for ((own, parameter), (x, (step, deviation))) in parameters.zip(values) {
                let [low, high] = [-1.96, 1.96].map(|z| parameter.value(x + step + z * deviation));
                let place = hypothesis.candidates.iter().position(|c| c == own)?;
                intervals[place].push([low.min(high), low.max(high)]);
            }
        }
        Some(intervals)
    }

    /// Judgements of the blocks of a group alone.
    fn group_judgements(
        &self,
        hypothesis: &Hypothesis,
        group: Group,
        floor: f64,
    ) -> Option<Vec<Judgement>> {
        let key = self.place_of(hypothesis, group.0, group.1);
        if let Some(known) = self.judged.lock().ok()?.get(&key) {
            let is_enough = |own: &Judgement| own.missing <= 0.0 || own.reach() < floor;
            if known.iter().flatten().all(is_enough) {
                return known.clone();
            }
        }
        let found = self.group_judged(hypothesis, group, floor);
        self.judged.lock().ok()?.insert(key, found.clone());
        found
    }

    fn group_judged(
        &self,
        hypothesis: &Hypothesis,
        group: Group,
        floor: f64,
    ) -> Option<Vec<Judgement>> {
        let fit = Arc::new(self.expansion(hypothesis.clone(), group)?);
        let blocks = 0..group.0.len();
        let of_block = |place: usize| {
            let block: Blocks = 1 << place;
            [Unknown::process(block), Unknown::outside(block)]
        };
        let unknowns = std::iter::once(Unknown::process(0)).chain(blocks.flat_map(of_block));
        let unknowns: Vec<Unknown> = unknowns.collect();
        let mut modes = self.modes(&fit, group, &unknowns, floor).into_iter();
        let named = modes.next()??;
        let showing = named.standing(&[], |_| 0.0);
        let all = self.model.candidates();
        let effects = hypothesis.fit.effects.iter();
        let ended = effects.filter(|(own, values)| all[*own].ended(values).next().is_some());
        let ended: Vec<usize> = ended.map(|(own, _)| *own).collect();
        let mut judgements = vec![Judgement {
            unknown: 0,
            log_evidence: named.evidence.log,
            missing: named.missing,
            standing: named.standing(&ended, |_| 0.0),
            shows: group.1.iter().all(|own| showing.contains(own)),
        }];
        for (place, block) in group.0.iter().enumerate() {
            // A process of any amplitude or, as probably, nominal values outside their tolerances.
            let process = modes.next()??;
            let outside = modes.next()?;
            let both = [Some(&process), outside.as_ref()].into_iter().flatten();
            let log = log_sum(both.clone().map(|own| own.evidence.log));
            let reach = log_sum(both.map(|own| own.evidence.log + own.missing));
            let amplitude = process.evidence.amplitudes[place];
            let of_process = |own| if own == place { amplitude } else { 0.0 };
            judgements.push(Judgement {
                unknown: 1 << block,
                log_evidence: log - 2.0_f64.ln(),
                missing: if reach - log < PROMISED {
                    0.0
                } else {
                    reach - log
                },
                standing: match outside {
                    Some(own) if own.evidence.log > process.evidence.log => {
                        // Alone, a block has nothing else that holds its values.
                        let is_alone = self.model.blocks().len() == 1;
                        own.standing(&ended, |place| {
                            if is_alone {
                                0.0
                            } else {
                                own.about.excess(place, &own.evidence.weights)
                            }
                        })
                    }
                    _ => process.standing(&ended, of_process),
                },
                shows: false,
            });
        }
        Some(judgements)
    }

    /// The evidence beside each of `unknowns`, about its mode, of which the first begins at the fit
    /// and the others where more is probable beside them: there, or at the mode of the first.
    ///
    /// Where dead zones end the residuals have corners, at which steps to a mode may stop short.
    /// That of another may lie on the other side of such a corner: there they begin again.
    fn modes(
        &self,
        fit: &Arc<Expansion>,
        group: Group,
        unknowns: &[Unknown],
        floor: f64,
    ) -> Vec<Option<Mode>> {
        let at_fit = || (Arc::clone(fit), DVector::zeros(fit.linear.weights()));
        let Some((first, others)) = unknowns.split_first() else {
            return Vec::new();
        };
        let first = self.mode(at_fit(), group, *first, floor);
        let begin = |unknown: Unknown| {
            let at_fit = at_fit();
            let density = fit.settled_log_density(unknown, &at_fit.1);
            let first = first.as_ref();
            let first = first.filter(|first| first.log_density(unknown) > density);
            first.map_or(at_fit, |first| {
                (Arc::clone(&first.about), first.weights.clone())
            })
        };
        let others = others.par_iter();
        let others = others.map(|unknown| self.mode(begin(*unknown), group, *unknown, floor));
        let others: Vec<Option<Mode>> = others.collect();
        let mut modes: Vec<Option<Mode>> = std::iter::once(first).chain(others).collect();
        for (place, unknown) in unknowns.iter().enumerate() {
            let density = |own: &Mode| own.log_density(*unknown);
            let reached = modes[place].as_ref().and_then(density);
            let others = modes.iter().flatten();
            let others = others.filter_map(|own| Some((density(own)?, own)));
            let best = others.max_by(|a, b| a.0.total_cmp(&b.0));
            let is_more = |other: f64| reached.is_none_or(|own| other > own + PROMISED);
            let Some((_, other)) = best.filter(|best| is_more(best.0)) else {
                continue;
            };
            let there = (Arc::clone(&other.about), other.weights.clone());
            modes[place] = self.mode(there, group, *unknown, floor);
        }
        modes
    }

    /// The evidence beside `unknown`, about its mode if it may reach `floor` there: where what is
    /// unknown explains much, the most probable values are not those of the fit, which knows
    /// nothing but noise, and the residuals are not linear from there to here.
    fn mode(
        &self,
        (mut about, mut weights): (Arc<Expansion>, DVector<f64>),
        group: Group,
        unknown: Unknown,
        floor: f64,
    ) -> Option<Mode> {
        let settled = |own: &Expansion, weights: &DVector<f64>| {
            own.linear.settled(unknown, own.values, weights)
        };
        let density =
            |own: &Expansion, weights: &DVector<f64>| own.linear.log_density(unknown, weights);
        weights = settled(&about, &weights)?;
        let mut evidence = about.linear.evidence(unknown)?;
        let mut missing = 0.0;
        let mut damping = 0.0;
        let mut left = EXPANSIONS;
        loop {
            let reached = density(&about, &weights);
            let promised = density(&about, &evidence.weights) - reached;
            if promised < PROMISED {
                break;
            }
            if evidence.log + MISSING * promised < floor {
                missing = MISSING * promised;
                break;
            }
            let next = (left > 0)
                .then(|| self.stepped((&about, &weights, &evidence), group, unknown, damping))
                .flatten();
            let Some((hypothesis, there, needed)) = next else {
                // What no step redeems is not there.
                evidence.log -= promised;
                break;
            };
            left -= 1;
            let fresh = self.expansion(hypothesis, group).and_then(|fresh| {
                let there = settled(&fresh, &there)?;
                Some((fresh.linear.evidence(unknown)?, there, fresh))
            });
            match fresh.filter(|(_, there, fresh)| density(fresh, there) > reached) {
                Some((own, there, fresh)) => {
                    (about, weights, evidence) = (Arc::new(fresh), there, own);
                    damping = if needed > DAMPING {
                        needed / DAMPING_FACTOR
                    } else {
                        0.0
                    };
                }
                None => damping = (needed * DAMPING_FACTOR).max(DAMPING),
            }
        }
        Some(Mode {
            evidence,
            missing,
            about,
            weights,
        })
    }

    /// Where steps from an expansion and its weights to the most probable ones redeem what they
    /// promise about that expansion, corrected by what each has shown, and the damping that they
    /// needed, at least this one. None where no step promises and redeems anything.
    fn stepped(
        &self,
        (about, weights, evidence): (&Expansion, &DVector<f64>, &Evidence),
        group: Group,
        unknown: Unknown,
        mut damping: f64,
    ) -> Option<(Hypothesis, DVector<f64>, f64)> {
        // After a step: the expansion there, the weights, and whether it was as good as promised.
        let step = |own: &Expansion, weights: &DVector<f64>, aim: DVector<f64>| {
            let before = own.linear.log_density(unknown, weights);
            let promised = own.linear.log_density(unknown, &aim) - before;
            // Not of what is no number either.
            let is_worth = promised >= PROMISED;
            let after = is_worth.then(|| own.corrected(self, group, &(&aim - weights)));
            let mut there = aim;
            there.rows_mut(0, own.values).fill(0.0);
            let after = after.flatten().and_then(|next| {
                let gain = next.linear.log_density(unknown, &there) - before;
                (gain > 0.0).then_some((next, there, gain > REDEEMED * promised))
            });
            (is_worth, after)
        };
        let (mut own, mut there, mut is_good) = loop {
            let aim = about.linear.damped(evidence, weights, damping)?;
            match step(about, weights, aim) {
                (false, _) => return None,
                (true, Some(after)) => break after,
                (true, None) => damping = (damping * DAMPING_FACTOR).max(DAMPING),
            }
        };
        for _ in 1..CORRECTIONS {
            let evidence = is_good.then(|| own.linear.evidence(unknown)).flatten();
            let aim = evidence.and_then(|evidence| own.linear.damped(&evidence, &there, damping));
            let Some(after) = aim.and_then(|aim| step(&own, &there, aim).1) else {
                break;
            };
            (own, there, is_good) = after;
        }
        Some((own.hypothesis, there, damping))
    }

    /// The evidence of a group of `hypothesis` beside `unknown`, about its mode wherever that is.
    fn mode_of(&self, hypothesis: &Hypothesis, group: Group, unknown: Unknown) -> Option<Mode> {
        let fit = Arc::new(self.expansion(hypothesis.clone(), group)?);
        let begin = DVector::zeros(fit.linear.weights());
        self.mode((fit, begin), group, unknown, f64::NEG_INFINITY)
    }

    /// The residuals of a group of `hypothesis`, with its nominal values that are `free`.
    fn found<'p>(
        &'p self,
        hypothesis: &Hypothesis,
        (blocks, candidates): Group<'p>,
        free: &'p [usize],
    ) -> Option<(Problem<'p, M>, Found)> {
        let x = self.coordinates(hypothesis, free, candidates);
        let mut problem = Problem::new(self.model, blocks, free, candidates).over_all();
        let found = at(&mut problem, DVector::from_vec(x))?;
        Some((problem, found))
    }

    /// The residuals of a group linear about `hypothesis`, and what the candidates do in its
    /// blocks.
    fn expansion(&self, hypothesis: Hypothesis, group: Group) -> Option<Expansion> {
        Some(self.expanded(hypothesis, group)?.expansion)
    }

    /// The same, with what it is of.
    pub(super) fn expanded(
        &self,
        hypothesis: Hypothesis,
        (blocks, candidates): Group,
    ) -> Option<Expanded<'_>> {
        let free = self.free(blocks);
        let (problem, mut found) = self.found(&hypothesis, (blocks, candidates), &free)?;
        let values = (&hypothesis.fit.nominal[..], &hypothesis.fit.effects[..]);
        let about = About::new(self.model, &problem, &found.residuals, values)?;
        let mut all_slopes = problem.slopes_about(&found.x, &about)?;
        let laws: Vec<Law> = candidates
            .iter()
            .map(|own| self.law(blocks, &hypothesis, *own, &about))
            .collect::<Option<_>>()?;
        let given = self.given(blocks, &hypothesis);
        self.hold_zones(blocks, &given, (&mut found, &mut all_slopes, free.len()));
        let slopes = &all_slopes.values;
        let mut priors = self.priors(free.len(), &found.x, candidates);
        priors.extend(laws.iter().flat_map(Law::priors));
        let (mut left, mut shown, mut products) = (Vec::new(), Vec::new(), Vec::new());
        for (place, block) in blocks.iter().enumerate() {
            let (rows, merged) = self.rows_of(blocks, *block, (&given, &found));
            let wholes: Vec<DVector<f64>> = laws
                .iter()
                .map(|law| in_bases(&law.whole, &rows, &merged))
                .collect();
            let error = |(law, whole): (&Law, &DVector<f64>)| law.form_doubt * whole.norm();
            let errors: Vec<f64> = laws.iter().zip(&wholes).map(error).collect();
            let nominal: Vec<DVector<f64>> = (0..free.len())
                .map(|own| in_bases(&slopes.columns(own, 1).into_owned(), &rows, &merged))
                .collect();
            let values = merged_values(slopes, &laws, &found.residuals.values, &merged);
            let mut first = found.x.len();
            for (number, law) in laws.iter().enumerate() {
                let weights = first..first + law.shapes.len();
                first = weights.end;
                let without = |other: &usize| *other != number;
                let left: f64 = (0..laws.len()).filter(without).map(|n| errors[n]).sum();
                let others = (0..laws.len()).filter(without).map(|n| &wholes[n]);
                let others: Vec<&DVector<f64>> = nominal.iter().chain(others).collect();
                shown.push(Shown {
                    candidate: law.candidate,
                    place,
                    size: beyond(&wholes[number], &others),
                    left,
                    whole: merged_column(&law.whole, &merged),
                    laws: weights,
                });
            }
            products.push(products_of(&nominal));
            let remainder = Remainder {
                rows,
                values,
                form_error: errors.iter().sum(),
            };
            left.push(Left { remainder, merged });
        }
        let remainders = left.iter().map(|own| &own.remainder);
        let expansion = Expansion {
            values: found.x.len(),
            linear: Linear::new(remainders, priors, self.places_of(&free, blocks)),
            left,
            hypothesis,
            shown: shown.into(),
            nominal: products,
            along: places_along(found.x.len(), &laws),
        };
        Some(Expanded {
            expansion,
            about,
            slopes: all_slopes,
            found,
            of_laws: laws,
        })
    }

    /// The priors of the steps from `x`, of which so many coordinates are of nominal values and the
    /// rest of parameters.
    fn priors(&self, nominals: usize, x: &DVector<f64>, candidates: &[usize]) -> Vec<Prior> {
        let (nominal, parameters) = x.as_slice().split_at(nominals);
        let all = self.model.candidates();
        let ranges = candidates
            .iter()
            .flat_map(|own| all[*own].parameters.iter().map(Parameter::reach));
        let in_range = |(x, (least, most)): (&f64, (f64, f64))| Prior {
            range: ((least - x).min(0.0), (most - x).max(0.0)),
            ..Prior::new(1.0 - x, EFFECT_PRIOR)
        };
        let mut priors: Vec<Prior> = nominal.iter().map(|x| Prior::new(-x, 1.0)).collect();
        priors.extend(parameters.iter().zip(ranges).map(in_range));
        priors
    }

    /// Of each nominal value the places of the blocks among `blocks` on which it acts.
    fn places_of(&self, nominals: &[usize], blocks: &[usize]) -> Vec<Blocks> {
        let of = |nominal: &usize| {
            let acts = &self.model.nominal_blocks()[*nominal];
            let own = blocks.iter().enumerate();
            own.filter(|(_, block)| acts.contains(block))
                .fold(0, |mask, (place, _)| mask | (1 << place))
        };
        nominals.iter().map(of).collect()
    }

    /// The rows of `block` among the residuals of `blocks` over all records, each with those that
    /// it merges.
    fn rows_of(
        &self,
        blocks: &[usize],
        block: usize,
        (given, found): (&[Vec<Cow<Residuals>>], &Found),
    ) -> (Rows, Vec<Range<usize>>) {
        let (mut rows, mut merged) = (Rows::default(), Vec::new());
        for (((record, own), range), given) in self.located(blocks).zip(given) {
            if own == block {
                rows.add(
                    &self.model.timeline(record, block),
                    &found.residuals.slack[range.clone()],
                    given,
                    (range.start, &mut merged),
                );
            }
        }
        (rows, merged)
    }

    /// The pieces of `blocks` over all records, each with its rows among their residuals.
    fn located<'b>(
        &'b self,
        blocks: &'b [usize],
    ) -> impl Iterator<Item = ((usize, usize), Range<usize>)> + use<'b, M> {
        let problem = Problem::new(self.model, blocks, &[], &[]).over_all();
        problem.located()
    }

    /// Of each of `blocks` over each record in which a load may rest: residuals with nominal values
    /// as given, without effects, computed once, and with those of `hypothesis` that act on it;
    /// those that have a solution.
    fn given(&self, blocks: &[usize], hypothesis: &Hypothesis) -> Vec<Vec<Cow<'_, Residuals>>> {
        let nominal = vec![0.0; self.model.nominal_blocks().len()];
        let effects = &hypothesis.fit.effects;
        let all = self.model.candidates();
        let pieces: Vec<_> = self.located(blocks).map(|(piece, _)| piece).collect();
        let of = |(record, block): (usize, usize)| {
            if self.model.proportional(block) {
                return Vec::new();
            }
            let residuals = |effects: &[Active]| {
                let residuals = self.model.residuals(record, block, &nominal, effects);
                residuals.filter(Residuals::finite)
            };
            let place = record * self.model.blocks().len() + block;
            let without = self.as_given[place].get_or_init(|| residuals(&[]));
            let mut acting = effects.iter();
            let acts = acting.any(|own| all[own.0].blocks.contains(&block));
            let with = acts.then(|| residuals(effects)).flatten();
            let without = without.iter().map(Cow::Borrowed);
            without.chain(with.map(Cow::Owned)).collect()
        };
        pieces.into_par_iter().map(of).collect()
    }

    /// Makes the dead zones in which a load may rest as wide as they are with the nominal values as
    /// `given` and the effects, whatever so many nominal values are. Friction is not uniform in its
    /// zone: with the fitted width a narrower zone would be more probable, by 24 nats for each
    /// standard deviation of a static friction at 20 Hz, for nothing but that loads seldom rest at
    /// its edges.
    fn hold_zones(
        &self,
        blocks: &[usize],
        given: &[Vec<Cow<Residuals>>],
        (found, slopes, nominals): (&mut Found, &mut Slopes, usize),
    ) {
        for ((_, rows), given) in self.located(blocks).zip(given) {
            if let Some(zone) = given.last() {
                let mut widened = slopes.slack.rows_range_mut(rows.clone());
                widened.columns_range_mut(..nominals).fill(0.0);
                found.residuals.slack[rows].copy_from_slice(&zone.slack);
            }
        }
    }

    /// How residuals change as an effect of `hypothesis` vanishes, and as its law is another.
    fn law(
        &self,
        blocks: &[usize],
        hypothesis: &Hypothesis,
        number: usize,
        about: &About,
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
            problem.change(about, &moves, with)
        };
        let whole = with(&[])?.values;
        let (mut shapes, mut deviations, mut along) = (Vec::new(), Vec::new(), Vec::new());
        if candidate.form_doubt > 0.0 {
            for (mut own, places) in self.modulations(number, (problem.records, blocks)) {
                for (degree, share) in DEGREES.into_iter().enumerate() {
                    let by = places.map(|place| legendre(place)[degree]);
                    let (shape, mean) = beside(&whole, whole.component_mul(&by));
                    own.means[degree] = mean;
                    shapes.push(shape);
                    deviations.push(LAW * share);
                }
                along.push(own);
            }
            let values = effects.iter().filter(|own| own.0 == number);
            for (_, values) in values {
                let scaled = scaled(candidate, values).into_iter();
                let others = scaled.map(|values| (number, values));
                shapes.extend(
                    others
                        .chain(self.other_forms((number, values)))
                        .map(|other| match with(&[other]) {
                            Some(change) => beside(&whole, change.values).0,
                            // Where it has no solution, no rig has it.
                            None => DMatrix::zeros(whole.nrows(), 1),
                        }),
                );
            }
        }
        deviations.resize(shapes.len(), LAW);
        Some(Law {
            candidate: number,
            form_doubt: candidate.form_doubt,
            whole,
            shapes,
            deviations,
            along,
        })
    }

    /// The same effect in its other forms that have a size of the same name: without one nothing
    /// says how large it would be.
    fn other_forms(&self, (number, values): (usize, &[f64])) -> Vec<Active> {
        let all = self.model.candidates();
        let forms = (0..all.len()).filter(|form| all[*form].effect == all[number].effect);
        let is_size = |own: &Parameter, other: &Parameter| {
            own.name == other.name && (own.neutral.is_some() || other.neutral.is_some())
        };
        let is_sized = |form: &usize| {
            let mut parameters = all[number].parameters.iter();
            parameters.any(|own| {
                all[*form]
                    .parameters
                    .iter()
                    .any(|other| is_size(own, other))
            })
        };
        let forms = forms.filter(|form| *form != number && is_sized(form));
        let others = forms.map(|form| {
            let coordinates = self.in_form((number, values), form);
            let parameters = all[form].parameters.iter().zip(coordinates);
            (form, parameters.map(|(own, x)| own.value(x)).collect())
        });
        others.collect()
    }

    /// The quantities beside the residuals of `blocks` over `records`, from −1 to 1, with which the
    /// law of a candidate may vary.
    fn modulations(
        &self,
        candidate: usize,
        (records, blocks): (usize, &[usize]),
    ) -> Vec<(Along, DMatrix<f64>)> {
        let mut shapes: BTreeMap<(&'static str, &'static str), Vec<f64>> = BTreeMap::new();
        let mut rows = 0;
        for record in 0..records {
            for block in blocks {
                for coordinate in self.model.context(record, *block) {
                    if self.model.varies_with(candidate, coordinate.name) {
                        let values = shapes.entry((coordinate.name, coordinate.unit));
                        let values = values.or_default();
                        values.resize(rows, 0.0);
                        values.extend(coordinate.values);
                    }
                }
                rows += self.model.rows(record, *block);
            }
        }
        let scaled = |((name, unit), mut values): ((&'static str, &'static str), Vec<f64>)| {
            values.resize(rows, 0.0);
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let half = (0.5 * (most - least)).max(f64::MIN_POSITIVE);
            let place = |value: &f64| (value - least) / half - 1.0;
            let along = Along {
                name,
                unit,
                least,
                half,
                means: [0.0; DEGREES.len()],
            };
            (
                along,
                DMatrix::from_iterator(rows, 1, values.iter().map(place)),
            )
        };
        shapes.into_iter().map(scaled).collect()
    }
}

impl Rows {
    /// Adds the rows of a record, which begin at `first`, and which of these each merges: the same
    /// ones whatever nominal values are fitted. Where the weight rests in a dead zone few are kept:
    /// those that are with nominal values as `given`, in the first of these in which the zone is
    /// there. What is left out counts as noise makes it in the mean. With the zone that is fitted
    /// the evidence would be of other data: a wider one, of fewer rests, would be more probable, or
    /// less, for that alone.
    fn add(
        &mut self,
        timeline: &Timeline,
        slack: &[f64],
        given: &[Cow<Residuals>],
        (first, merged): (usize, &mut Vec<Range<usize>>),
    ) {
        let mut begins = true;
        // What was left over where the weight began to rest, and by which of `given`.
        let mut rested = None;
        let mut row = 0;
        while row < slack.len() {
            let (time_s, base) = (timeline.time_s[row], timeline.base[row]);
            let follows =
                |row: usize| timeline.base[row] > 0.0 && timeline.time_s[row] < time_s + MERGED_S;
            let mut end = row + 1;
            while base > 0.0 && end < slack.len() && follows(end) {
                end += 1;
            }
            let members = row..end;
            let zone = |(which, given): (usize, &Cow<Residuals>)| {
                let value = of_merged(&members, |row| given.values[row]);
                let half_width = half_width(&given.slack, &members);
                Some((which, value, half_width)).filter(|_| half_width > WIDE)
            };
            let zone = given.iter().enumerate().find_map(zone);
            let zone = zone.filter(|_| base > 0.0);
            let is_same = |(which, value, half): (usize, f64, f64)| {
                rested.is_some_and(|(by, rested): (usize, f64)| {
                    by == which && (value - rested).abs() < half
                })
            };
            if zone.is_some_and(is_same) {
                self.left_out += 1;
            } else {
                if base > 0.0 {
                    rested = zone.map(|(which, value, _)| (which, value));
                }
                self.time_s.push(time_s);
                self.base.push(base * ((end - row) as f64).sqrt());
                self.begins.push(std::mem::take(&mut begins));
                self.deviation
                    .push(box_deviation(half_width(slack, &members)));
                merged.push(first + row..first + end);
            }
            row = end;
        }
    }
}

impl Law {
    /// The priors of its weights.
    fn priors(&self) -> impl Iterator<Item = Prior> {
        self.deviations.iter().map(|deviation| Prior {
            range: LAW_RANGE,
            ..Prior::new(0.0, *deviation)
        })
    }
}

/// What the weights of `laws` along a quantity belong to, and the first of them, which follow
/// `values`.
fn places_along(values: usize, laws: &[Law]) -> Vec<(usize, usize, Along)> {
    let mut along = Vec::new();
    let mut first = values;
    for law in laws {
        let own = law.along.iter().enumerate();
        let weights = |place: usize| first + place * DEGREES.len();
        along.extend(own.map(|(place, along)| (law.candidate, weights(place), *along)));
        first += law.shapes.len();
    }
    along
}

/// What of `shape` is not in proportion to `whole`, and the share of that in it.
fn beside(whole: &DMatrix<f64>, shape: DMatrix<f64>) -> (DMatrix<f64>, f64) {
    let square = whole.norm_squared();
    let share = if square > 0.0 {
        shape.dot(whole) / square
    } else {
        0.0
    };
    (shape - share * whole, share)
}

/// Values of an effect with each of its scales larger and smaller.
fn scaled(candidate: &Candidate, values: &[f64]) -> Vec<Vec<f64>> {
    let scales = candidate.parameters.iter().enumerate();
    let scales = scales.filter(|(_, parameter)| parameter.log);
    let all = scales.flat_map(|(place, parameter)| {
        [START_FACTOR, START_FACTOR.recip()]
            .into_iter()
            .map(move |factor| {
                let mut scaled = values.to_vec();
                let (least, most) = parameter.range;
                scaled[place] = (scaled[place] * factor).clamp(least, most);
                scaled
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
        for (own, slopes) in slopes.column_iter().enumerate() {
            target[own] = of_merged(members, |row| slopes[row]);
        }
        for (own, shape) in shapes.iter().enumerate() {
            target[slopes.ncols() + own] = of_merged(members, |row| shape[(row, 0)]);
        }
        target[weights] = of_merged(members, |row| residuals[row]);
    }
    values
}

/// A column over merged rows.
fn merged_column(column: &DMatrix<f64>, merged: &[Range<usize>]) -> Vec<f64> {
    let of = |members: &Range<usize>| of_merged(members, |row| column[(row, 0)]);
    merged.iter().map(of).collect()
}

/// What several rows of equal noise are as one: their mean, in units of its own noise.
fn of_merged(members: &Range<usize>, value: impl Fn(usize) -> f64) -> f64 {
    let sum: f64 = members.clone().map(value).sum();
    sum / (members.len() as f64).sqrt()
}

/// The dead zone of merged rows.
fn half_width(slack: &[f64], members: &Range<usize>) -> f64 {
    of_merged(members, |row| slack[row].max(0.0))
}

/// Standard deviation of noise of 1 and of what is anywhere within a dead zone.
fn box_deviation(half_width: f64) -> f64 {
    (1.0 + BOX_VARIANCE * half_width * half_width).sqrt()
}

/// A column over merged rows, in units of their base, so that its norm is an RMS.
fn in_bases(column: &DMatrix<f64>, rows: &Rows, merged: &[Range<usize>]) -> DVector<f64> {
    let pairs = merged.iter().zip(&rows.base);
    let pairs = pairs.filter(|(_, base)| **base > 0.0);
    let count = pairs.clone().count().max(1) as f64;
    let scaled = pairs
        .map(|(members, base)| of_merged(members, |row| column[(row, 0)]) / base / count.sqrt());
    DVector::from_vec(scaled.collect())
}

/// Products of columns with each other.
fn products_of(columns: &[DVector<f64>]) -> DMatrix<f64> {
    let count = columns.len();
    DMatrix::from_fn(count, count, |own, other| columns[own].dot(&columns[other]))
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

#[cfg(test)]
mod tests {
    use super::super::{BASE, Coordinate, Parameter};
    use super::*;

    const ROWS: usize = 400;

    /// One block of so many rows, 30 ms apart, with a load that swings.
    struct Rows30 {
        nominal_blocks: Vec<Vec<usize>>,
        candidates: Vec<Candidate>,
        residual: fn(usize, &[f64], &[Active]) -> f64,
        law_of_load: bool,
        /// Half width of a dead zone, which is a fifth wider for each deviation of the first
        /// nominal value.
        zone: f64,
        /// Of as many rows each; the first one is fitted.
        records: usize,
    }

    impl Rows30 {
        /// With one nominal value, and laws that vary with the load.
        fn new(
            candidates: Vec<Candidate>,
            residual: fn(usize, &[f64], &[Active]) -> f64,
        ) -> Rows30 {
            Rows30 {
                nominal_blocks: vec![vec![0]],
                candidates,
                residual,
                law_of_load: true,
                zone: 0.0,
                records: 1,
            }
        }
    }

    fn load(row: usize) -> f64 {
        (0.21 * row as f64).sin()
    }

    impl Model for Rows30 {
        fn records(&self) -> usize {
            self.records
        }
        fn fitted(&self) -> usize {
            1
        }
        fn blocks(&self) -> &[&'static str] {
            &["block"]
        }
        fn nominal_blocks(&self) -> &[Vec<usize>] {
            &self.nominal_blocks
        }
        fn candidates(&self) -> &[Candidate] {
            &self.candidates
        }
        fn residuals(
            &self,
            record: usize,
            _: usize,
            nominal: &[f64],
            effects: &[Active],
        ) -> Option<Residuals> {
            let rows = record * ROWS..(record + 1) * ROWS;
            let rows = rows.map(|row| (self.residual)(row, nominal, effects));
            Some(Residuals {
                slack: vec![self.zone * (1.0 + 0.2 * nominal[0]); ROWS],
                ..Residuals::exact(rows.collect())
            })
        }
        fn rows(&self, _: usize, _: usize) -> usize {
            ROWS
        }
        fn proportional(&self, _: usize) -> bool {
            self.zone == 0.0
        }
        fn context(&self, record: usize, _: usize) -> Vec<Coordinate> {
            let coordinate = |name, unit, value: fn(usize) -> f64| Coordinate {
                name,
                unit,
                values: (record * ROWS..(record + 1) * ROWS).map(value).collect(),
            };
            vec![
                coordinate("load", "N", load),
                coordinate("time", "s", |row| 0.03 * row as f64),
            ]
        }
        fn varies_with(&self, _: usize, quantity: &str) -> bool {
            quantity == "load" && self.law_of_load
        }
    }

    /// A nominal value on which residuals do not depend linearly, and a slow disturbance, which a
    /// fit by noise alone takes for a wrong nominal value.
    fn disturbed(row: usize, nominal: &[f64], _: &[Active]) -> f64 {
        let phase = row as f64 / 30.0;
        let value = nominal[0] * (1.0 + 0.1 * phase.cos());
        value + 0.1 * value * value * phase.cos() - 90.0 * (0.3 * phase).sin().powi(2)
    }

    /// An effect that is larger by 0.3 of itself where the load is largest than in its middle, of
    /// which the catalogue's form knows nothing; nominal values that do nothing.
    fn modulated(row: usize, nominal: &[f64], effects: &[Active]) -> f64 {
        let size: f64 = effects.iter().map(|(_, values)| values[0]).sum();
        let shape = 40.0 * (0.5 * row as f64).cos();
        let noise = (7.3 * row as f64).sin() + 0.01 * nominal[0];
        shape * (size - 1.0 - 0.3 * load(row)) + noise
    }

    fn sized_waves() -> Candidate {
        let size = Parameter {
            name: "size",
            unit: "",
            range: (-10.0, 10.0),
            usual: 1.0,
            log: false,
            neutral: Some(0.0),
            ends: [false; 2],
        };
        Candidate {
            effect: "waves",
            form: "waves",
            parameters: vec![size],
            blocks: vec![0],
            form_doubt: 0.05,
        }
    }

    #[test]
    fn a_shape_is_found_that_no_form_has() {
        let model = Rows30::new(vec![sized_waves()], modulated);
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[0]).expect("a fit");
        let [Some(shape)] = &engine.shapes(&fitted)[..] else {
            panic!("no shape");
        };
        assert_eq!((shape.coordinate, shape.unit), ("load", "N"));
        for ((at, value), sd) in shape.at.iter().zip(&shape.value).zip(&shape.sd) {
            let expected = 1.0 + 0.3 * at;
            assert!((value - expected).abs() < 2.0 * sd + 0.01, "{shape:?}");
            assert!(*sd < 0.05, "{shape:?}");
        }
    }

    /// What feels nothing of the load is no larger where that is.
    #[test]
    fn a_law_varies_with_nothing_that_its_part_cannot_feel() {
        let model = Rows30 {
            law_of_load: false,
            ..Rows30::new(vec![sized_waves()], modulated)
        };
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[0]).expect("a fit");
        assert!(engine.shapes(&fitted)[0].is_none());
        let judged = engine.judgements(&fitted, f64::NEG_INFINITY);
        let judged = judged.expect("judgements");
        // 0.3 of the wave is left, and unknown.
        assert!(judged[1].log_evidence > judged[0].log_evidence + 10.0);
    }

    /// The same, and a second effect that does what no form but a law of the first one does.
    fn modulated_or_both(row: usize, nominal: &[f64], effects: &[Active]) -> f64 {
        let size_of = |candidate: usize| -> f64 {
            let own = effects.iter().filter(|own| own.0 == candidate);
            own.map(|(_, values)| values[0]).sum()
        };
        let waves: Vec<Active> = effects.iter().filter(|own| own.0 == 0).cloned().collect();
        let shape = 40.0 * (0.5 * row as f64).cos();
        modulated(row, nominal, &waves) + size_of(1) * shape * load(row)
    }

    /// The same in the first record, and with the law the other way round in the second.
    fn modulated_either_way(row: usize, nominal: &[f64], effects: &[Active]) -> f64 {
        let shape = 40.0 * (0.5 * row as f64).cos();
        let turned = if row < ROWS { 0.0 } else { 0.6 };
        modulated(row, nominal, effects) + turned * shape * load(row)
    }

    /// What the law of the fitted record predicts of the other one.
    #[test]
    fn a_law_predicts_where_it_is_the_same() {
        let missed = |residual, law_of_load| {
            let model = Rows30 {
                records: 2,
                law_of_load,
                ..Rows30::new(vec![sized_waves()], residual)
            };
            let engine = Engine::new(&model);
            let of = |candidates: &[usize]| {
                let fitted = engine.hypothesis(candidates).expect("a fit");
                engine.missed(&fitted).expect("residuals")
            };
            (of(&[]), of(&[0]))
        };
        let (null, with_law) = missed(modulated, true);
        assert!(null.nats > 100.0 * null.deviation, "{null:?}");
        assert!(with_law.nats < 2.0 * with_law.deviation, "{with_law:?}");
        let (_, without_law) = missed(modulated, false);
        assert!(
            without_law.nats > 50.0 * without_law.deviation,
            "{without_law:?}"
        );
        let (_, turned) = missed(modulated_either_way, true);
        assert!(turned.nats > without_law.nats, "{turned:?}");
    }

    /// By the cost it promises much; the law of the first effect leaves it nothing.
    #[test]
    fn an_effect_promises_what_laws_of_others_leave() {
        let mut another = sized_waves();
        another.effect = "another";
        let model = Rows30::new(vec![sized_waves(), another], modulated_or_both);
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[0]).expect("a fit");
        let both = engine.hypothesis(&[0, 1]).expect("a fit");
        let gained = fitted.fit.score() - both.fit.score();
        assert!(gained > 500.0, "{gained}");
        let promises = engine.promises(&fitted).expect("promises");
        assert!(promises[1] > 500.0, "{promises:?}");
        let is_promising = |least: f64| engine.is_promising(&fitted, &[1], |_| least);
        // A weight of 0.3, of 0.4: the law has to pay 0.3 nats for it.
        assert!(!is_promising(1.0));
        assert!(is_promising(0.1));
    }

    /// A wave whose length is a parameter, and which is larger where the load is.
    fn stretched(row: usize, nominal: &[f64], effects: &[Active]) -> f64 {
        let wave = |size: f64, length: f64| size * 40.0 * (0.02 * row as f64 / length).sin();
        let own = effects.iter().map(|(_, values)| wave(values[0], values[1]));
        let noise = (7.3 * row as f64).sin() + 0.01 * nominal[0];
        own.sum::<f64>() - wave(1.0 + 0.8 * load(row), 1.0) + noise
    }

    /// The law's columns are those of another length after a step: what it did for the step before
    /// may be far from what it does now.
    #[test]
    fn no_step_makes_a_mode_less_probable() {
        let mut candidate = sized_waves();
        candidate.parameters.push(Parameter {
            name: "length",
            range: (0.1, 10.0),
            log: true,
            neutral: None,
            ..candidate.parameters[0]
        });
        let model = Rows30::new(vec![candidate], stretched);
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[0]).expect("a fit");
        let (group, unknown) = ((&[0][..], &[0][..]), Unknown::process(0));
        for length in [0.6, 0.8, 1.3, 1.7] {
            let mut begun = fitted.clone();
            begun.fit.effects[0].1[1] = length;
            begun.fit.coordinates[0][1] = model.candidates[0].parameters[1].coordinate(length);
            let begin = Arc::new(engine.expansion(begun, group).expect("residuals"));
            let none = DVector::zeros(begin.linear.weights());
            let begin_log = begin.settled_log_density(unknown, &none).expect("weights");
            let mode = engine.mode((begin, none), group, unknown, f64::NEG_INFINITY);
            let reached = mode.and_then(|mode| mode.log_density(unknown));
            let reached = reached.expect("a mode");
            assert!(reached >= begin_log, "{length}: {reached} from {begin_log}");
        }
    }

    /// What is unknown explains the disturbance with a right nominal value, wherever the fit is.
    #[test]
    fn evidence_does_not_depend_on_where_the_fit_is() {
        let model = Rows30::new(Vec::new(), disturbed);
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[]).expect("a fit");
        let mut right = fitted.clone();
        right.fit.nominal[0] = 0.0;
        let difference = |floor: f64| {
            let log = |hypothesis| {
                let judgements = engine.judgements(hypothesis, floor).expect("judgements");
                judgements[1].log_evidence
            };
            (log(&fitted) - log(&right)).abs()
        };
        assert!(fitted.fit.nominal[0] > 2.0, "{:?}", fitted.fit.nominal);
        let about_fit = difference(f64::INFINITY);
        let about_mode = difference(f64::NEG_INFINITY);
        assert!(about_fit > 10.0 * PROMISED, "{about_fit}");
        assert!(about_mode < PROMISED, "{about_mode}");
    }

    /// A value that a dead zone keeps above 2.6, although its prior and the other rows would have
    /// it at 1.5; and one that the rows tell.
    fn cornered(row: usize, nominal: &[f64], _: &[Active]) -> f64 {
        match row % 4 {
            0 => 30.0 * (2.6 - nominal[0]).max(0.0),
            1 => 0.1 * (nominal[0] - 2.9),
            _ => 0.3 * (nominal[1] - 2.0) + (7.3 * row as f64).sin(),
        }
    }

    /// Steps that would cross the corner are refused, and the other value goes nowhere with them;
    /// where the first is hardly held by its tolerance it does.
    #[test]
    fn a_corner_does_not_hold_what_it_has_no_part_in() {
        let model = Rows30 {
            nominal_blocks: vec![vec![0], vec![0]],
            ..Rows30::new(Vec::new(), cornered)
        };
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[]).expect("a fit");
        let log_evidence = |nominal: [f64; 2]| {
            let mut there = fitted.clone();
            there.fit.nominal = nominal.to_vec();
            let judgements = engine.judgements(&there, f64::NEG_INFINITY);
            judgements.expect("judgements")[0].log_evidence
        };
        let (short, right) = (log_evidence([2.601, -1.0]), log_evidence([2.601, 2.0]));
        assert!(short > right - PROMISED, "{short}, {right}");
    }

    /// An effect that acts at one end of a quantity only.
    fn placed(row: usize, nominal: &[f64], effects: &[Active]) -> f64 {
        let size: f64 = effects.iter().map(|(_, values)| values[0]).sum();
        let acts = if load(row) < -0.8 {
            40.0 * (1.0 + load(row))
        } else {
            0.0
        };
        acts * (size - 1.0) + (7.3 * row as f64).sin() + 0.01 * nominal[0]
    }

    /// Where an effect acts, a law has no part in proportion to it: it could be any function there,
    /// of an effect of any size.
    #[test]
    fn no_law_takes_away_what_an_effect_does_in_one_place() {
        let model = Rows30::new(vec![sized_waves()], placed);
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[0]).expect("a fit");
        let expansion = engine.expansion(fitted, (&[0], &[0])).expect("residuals");
        let shown = &expansion.shown[0];
        let whole = DVector::from_vec(shown.whole.clone());
        assert!(shown.laws.len() >= DEGREES.len() && whole.norm() > 10.0);
        for law in shown.laws.clone() {
            let shape = expansion.left[0].remainder.values.row(law).transpose();
            // Only about, as rows are merged; Legendre's by themselves have a share of 0.5 to 0.9.
            assert!(shape.dot(&whole).abs() < 0.05 * whole.norm_squared());
            assert!(shape.norm() < 0.2 * whole.norm());
        }
    }

    /// What a nominal value does, by an integrator whose steps are chosen anew for each value.
    fn rough(row: usize, nominal: &[f64], _: &[Active]) -> f64 {
        let chosen = (1e6 * nominal[0] * (1.0 + 0.37 * row as f64)).sin();
        0.45 * load(row) * nominal[0] + 1e-3 * chosen
    }

    #[test]
    fn what_an_integrator_leaves_is_no_slope() {
        let model = Rows30::new(Vec::new(), rough);
        let engine = Engine::new(&model);
        let mut hypothesis = engine.hypothesis(&[]).expect("a fit");
        hypothesis.fit.nominal[0] = 0.5;
        let expansion = engine.expansion(hypothesis, (&[0], &[]));
        let slope = &expansion.expect("residuals").left[0].remainder.values;
        let expected = (0..ROWS).map(|row| (0.45 * load(row)).powi(2));
        let ratio = slope.row(0).norm() / expected.sum::<f64>().sqrt();
        // With steps of 1e-3 it is 3.
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }

    /// A nominal value that acts the more the larger it is.
    fn curved(row: usize, nominal: &[f64], _: &[Active]) -> f64 {
        let wave = (7.3 * row as f64).sin();
        5.0 * load(row) * (nominal[0] + 0.4 * nominal[0].powi(2)) + wave * (1.0 + nominal[1])
    }

    /// The corrected columns say of the step what it has shown, and of ways across it what they
    /// did.
    #[test]
    fn a_corrected_expansion_agrees_with_its_step() {
        let model = Rows30 {
            nominal_blocks: vec![vec![0], vec![0]],
            ..Rows30::new(Vec::new(), curved)
        };
        let engine = Engine::new(&model);
        let mut hypothesis = engine.hypothesis(&[]).expect("a fit");
        hypothesis.fit.nominal = vec![0.5, 0.0];
        let group = (&[0][..], &[][..]);
        let before = engine.expansion(hypothesis, group).expect("residuals");
        let step = DVector::from_vec(vec![0.3, 0.0]);
        let after = before.corrected(&engine, group, &step).expect("residuals");
        let fresh = engine
            .expansion(after.hypothesis.clone(), group)
            .expect("residuals");
        let [before, after, fresh] =
            [&before, &after, &fresh].map(|own| &own.left[0].remainder.values);
        let far = |a: f64, b: f64| (a - b).abs() > 1e-6;
        for row in 0..before.ncols() {
            let [was, is, expected] = [before, after, fresh].map(|own| own[(2, row)]);
            assert!(!far(is, expected));
            assert!(!far(is - was, 0.3 * after[(0, row)]));
            assert!(!far(before[(1, row)], after[(1, row)]));
        }
    }

    /// A weight that rests, and of which friction takes up a part in one place and another part in
    /// a second, and one that moves.
    #[test]
    fn a_rest_counts_once_as_long_as_friction_takes_up_about_the_same() {
        let half_width = 5.0;
        let values: Vec<f64> = (0..ROWS)
            .map(|row| if row < ROWS / 2 { -3.0 } else { 3.0 } + (0.3 * row as f64).sin())
            .collect();
        let timeline = Timeline {
            time_s: (0..ROWS).map(|row| 0.1 * row as f64).collect(),
            base: vec![BASE; ROWS],
        };
        let kept = |half_width: f64, given: &[f64]| {
            let (mut rows, mut merged) = (Rows::default(), Vec::new());
            let own = |half_width: &f64| {
                Cow::Owned(Residuals {
                    values: values.clone(),
                    slack: vec![*half_width; ROWS],
                })
            };
            let given: Vec<Cow<Residuals>> = given.iter().map(own).collect();
            let slack = [half_width; ROWS];
            rows.add(&timeline, &slack, &given, (0, &mut merged));
            assert_eq!(rows.left_out + merged.len(), ROWS);
            let firsts: Vec<usize> = merged.iter().map(|members| members.start).collect();
            firsts
        };
        // The zone of the rig as given, or else with an effect.
        assert_eq!(kept(half_width, &[half_width, 0.0]), [0, ROWS / 2]);
        assert_eq!(kept(half_width, &[0.0, half_width]), [0, ROWS / 2]);
        let all: Vec<usize> = (0..ROWS).collect();
        assert_eq!(kept(half_width, &[]), all);
        assert_eq!(kept(half_width, &[0.9 * WIDE, 0.0]), all);
        // Whatever is fitted.
        assert_eq!(kept(2.0 * half_width, &[half_width]), [0, ROWS / 2]);
        assert_eq!(kept(0.0, &[half_width]), [0, ROWS / 2]);
    }

    /// A load that comes to rest about halfway to what friction can hold, now here, now there: each
    /// rest counts, as it is by more than half of the zone, from edge to edge, from the one before.
    fn resting(row: usize, _: &[f64], _: &[Active]) -> f64 {
        3.05 * if row.is_multiple_of(2) { 1.0 } else { -1.0 }
    }

    #[test]
    fn a_narrower_zone_is_no_more_probable_for_what_rests_in_it() {
        let model = Rows30 {
            zone: 6.0,
            ..Rows30::new(Vec::new(), resting)
        };
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[]).expect("a fit");
        let log_evidence = |deviations: f64| {
            let mut there = fitted.clone();
            there.fit.nominal = vec![deviations];
            let judged = engine.judgements(&there, f64::INFINITY);
            judged.expect("judgements")[0].log_evidence
        };
        // By its own width it would be by 6 nats.
        let gained = log_evidence(-0.5) - log_evidence(0.0);
        assert!(gained.abs() < PROMISED, "{gained}");
    }

    /// What is left out counts as noise makes it in the mean.
    #[test]
    fn rows_that_are_left_out_cost_half_a_nat_each() {
        let log = |left_out: usize| {
            let rows = Rows {
                left_out,
                ..Rows::default()
            };
            let remainder = Remainder {
                rows,
                values: DMatrix::zeros(1, 0),
                form_error: 0.0,
            };
            let linear = Linear::new([&remainder].into_iter(), Vec::new(), Vec::new());
            linear.evidence(Unknown::process(0)).expect("a density").log
        };
        assert!((log(0) - log(10) - 5.0).abs() < 1e-9);
    }

    /// A wave in the residuals that an effect explains, and one that it adds. The only weight is
    /// that of its law, which may take that away again.
    #[test]
    fn effect_shows_only_where_it_explains_something() {
        let other = |row: usize| (0.5 * row as f64).cos();
        // Without the effect the residuals were `left + whole`.
        let explained = |left: f64, whole: f64, more: f64, weight: f64| {
            let remainder = Remainder {
                rows: Rows {
                    deviation: vec![1.0; ROWS],
                    ..Rows::default()
                },
                values: DMatrix::from_fn(2, ROWS, |place, row| [4.0, left][place] * load(row)),
                form_error: 0.0,
            };
            let shown = Shown {
                candidate: 0,
                place: 0,
                size: 1.0,
                left: 0.0,
                whole: (0..ROWS)
                    .map(|row| whole * load(row) + more * other(row))
                    .collect(),
                laws: 0..1,
            };
            shown.explains(&remainder, &DVector::from_element(1, weight))
        };
        let by_form = |left: f64, whole: f64| explained(left, whole, 0.0, 0.0);
        assert!(by_form(0.0, 2.0) && by_form(0.5, -2.0) && by_form(-0.9, 2.0));
        assert!(!by_form(-2.0, 2.0) && !by_form(1.1, -2.0));
        assert!(!explained(-4.0, 4.0, 1.0, 0.0) && explained(-4.0, 4.0, 1.0, 1.0));
    }
}

//! Which effect is missing: fits, predictions and the choice between them. It knows no muscle.
//!
//! A model has *blocks*, each with residuals that are computed from measured inputs alone, in units
//! of their noise. Its *nominal* values have priors; its *candidates* are effects in their forms. A
//! fit moves nominal values within their priors and the parameters of some candidates. Blocks that
//! no candidate ties together are fitted apart, and what was fitted once is kept.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::sync::Mutex;

/// One parameter of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Its key, with the unit.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Smallest and largest value.
    pub range: (f64, f64),
    /// A usual size.
    pub usual: f64,
    /// Fitted by its logarithm.
    pub log: bool,
}

impl Parameter {
    /// The value at coordinate `x`: 1 is the usual size.
    fn value(&self, x: f64) -> f64 {
        let value = if self.log {
            self.usual * (x - 1.0).clamp(-50.0, 50.0).exp()
        } else {
            self.usual * x
        };
        value.clamp(self.range.0, self.range.1)
    }
}

/// One effect in one form.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The effect's name.
    pub effect: &'static str,
    /// The form's name.
    pub form: &'static str,
    /// What is fitted.
    pub parameters: Vec<Parameter>,
    /// The blocks whose residuals it changes.
    pub blocks: Vec<usize>,
}

/// A candidate with values of its parameters.
pub type Active = (usize, Vec<f64>);

/// A quantity beside each residual of a block.
#[derive(Clone, Debug)]
pub struct Coordinate {
    /// Its name. A `direction` is −1, 0 or 1.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its values.
    pub values: Vec<f64>,
}

/// What is diagnosed.
pub trait Model: Sync {
    /// How many records there are; those that are fitted come first.
    fn records(&self) -> usize;
    /// How many records are fitted; the others are predicted.
    fn fitted(&self) -> usize;
    /// The blocks' names.
    fn blocks(&self) -> &[&'static str];
    /// For each nominal value with a tolerance: the blocks that depend on it.
    fn nominal_blocks(&self) -> &[Vec<usize>];
    /// The effects that may be missing.
    fn candidates(&self) -> &[Candidate];
    /// Residuals of a block over a record, in units of their noise; `nominal` in standard
    /// deviations of its prior. Their number does not depend on `nominal` and `effects`. `None`
    /// where the model has no solution.
    fn residuals(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Vec<f64>>;
    /// Whether residuals of a block change about in proportion to a small effect, so that what a
    /// candidate promises can be believed.
    fn proportional(&self, block: usize) -> bool;
    /// How badly free runs of a record miss what no block's residuals show well, as a cost with
    /// bounded influence; 0 where there is no such thing.
    fn free_run(&self, record: usize, nominal: &[f64], effects: &[Active]) -> Option<f64>;
    /// Against what the residuals of a block over a record are looked at.
    fn context(&self, record: usize, block: usize) -> Vec<Coordinate>;
}

/// Half a sum of squares, tamed, and of how many residuals.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Half the sum.
    pub cost: f64,
    /// How many.
    pub count: usize,
}

/// One block under a fit.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Which block.
    pub block: usize,
    /// Over the records that were fitted.
    pub fitted: Tally,
    /// Over the others.
    pub predicted: Tally,
}

impl Part {
    /// Over all records.
    pub fn total(&self) -> Tally {
        let mut total = self.fitted;
        total += self.predicted;
        total
    }
}

/// A fit of some blocks.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Deviations of all nominal values, in standard deviations of their priors.
    pub nominal: Vec<f64>,
    /// Values of the candidates' parameters, candidate by candidate.
    pub effects: Vec<Active>,
    /// Block by block.
    pub parts: Vec<Part>,
    /// Half the sum of squares of the priors.
    pub prior: f64,
    /// Cost of free runs over all records; 0 until it is asked for.
    pub free_run: f64,
    /// Parameters of the candidates as the fit moves them, candidate by candidate.
    coordinates: Vec<Vec<f64>>,
}

impl Fit {
    fn nothing(nominals: usize) -> Fit {
        Fit {
            nominal: vec![0.0; nominals],
            effects: Vec::new(),
            parts: Vec::new(),
            prior: 0.0,
            free_run: 0.0,
            coordinates: Vec::new(),
        }
    }

    /// Adds the fit of other blocks.
    fn join(&mut self, other: Fit) {
        for (own, value) in self.nominal.iter_mut().zip(&other.nominal) {
            *own += value;
        }
        self.effects.extend(other.effects);
        self.parts.extend(other.parts);
        self.prior += other.prior;
        self.coordinates.extend(other.coordinates);
    }

    /// Puts effects and blocks in the model's order.
    fn sort(&mut self) {
        self.parts.sort_by_key(|part| part.block);
        let mut effects: Vec<_> = self
            .effects
            .drain(..)
            .zip(self.coordinates.drain(..))
            .collect();
        effects.sort_by_key(|((candidate, _), _)| *candidate);
        (self.effects, self.coordinates) = effects.into_iter().unzip();
    }

    /// Cost of what was fitted, predicted and run freely, priors included.
    pub fn score(&self) -> f64 {
        let parts = self.parts.iter().map(|part| part.total().cost);
        self.prior + self.free_run + parts.sum::<f64>()
    }
}

/// How far the prior of a parameter lets it go: its coordinate is 1 ± this.
const EFFECT_PRIOR: f64 = 5.0;
/// Residuals beyond this many standard deviations count less.
const OUTLIER: f64 = 4.0;
/// Step of the difference quotients.
const STEP: f64 = 1e-3;
/// A parameter that is fitted by its logarithm is started at its usual size, and this many times
/// above and below.
const START_FACTOR: f64 = 4.0;
/// Starts that are followed.
const STARTS: usize = 2;
/// Relative changes of cost and parameters below which a fit ends, and evaluations it may take: for
/// a comparison, and for a result.
const LOOSE: (f64, f64, usize) = (3e-4, 1e-3, 36);
const TIGHT: (f64, f64, usize) = (1e-6, 1e-4, 60);
/// Stretches of time into which a record is cut for the scatter of its residuals.
const CLUSTERS: usize = 20;

struct Problem<'a, M> {
    model: &'a M,
    blocks: &'a [usize],
    /// The nominal values that are free.
    free: &'a [usize],
    candidates: &'a [usize],
    /// The nominal values are held for now.
    held: bool,
    x: DVector<f64>,
    /// The residuals at `x`, block by block of each record.
    at: Option<Vec<Vec<f64>>>,
}

impl<'a, M: Model> Problem<'a, M> {
    fn new(
        model: &'a M,
        blocks: &'a [usize],
        free: &'a [usize],
        candidates: &'a [usize],
    ) -> Problem<'a, M> {
        Problem {
            model,
            blocks,
            free,
            candidates,
            held: false,
            x: DVector::zeros(0),
            at: None,
        }
    }

    fn nominal(&self, x: &DVector<f64>) -> Vec<f64> {
        let mut nominal = vec![0.0; self.model.nominal_blocks().len()];
        for (place, free) in self.free.iter().enumerate() {
            nominal[*free] = x[place];
        }
        nominal
    }

    fn effects(&self, x: &DVector<f64>) -> Vec<Active> {
        let mut place = self.free.len();
        let candidates = self.model.candidates();
        let values = |candidate: &usize| {
            let parameters = &candidates[*candidate].parameters;
            let values = parameters.iter().map(|parameter| {
                place += 1;
                parameter.value(x[place - 1])
            });
            (*candidate, values.collect())
        };
        self.candidates.iter().map(values).collect()
    }

    fn pieces(&self) -> impl Iterator<Item = (usize, usize)> {
        let records = 0..self.model.fitted();
        records.flat_map(|record| self.blocks.iter().map(move |block| (record, *block)))
    }

    fn piece(&self, x: &DVector<f64>, (record, block): (usize, usize)) -> Option<Vec<f64>> {
        let (nominal, effects) = (self.nominal(x), self.effects(x));
        let residuals = self.model.residuals(record, block, &nominal, &effects)?;
        residuals.iter().all(|r| r.is_finite()).then_some(residuals)
    }

    /// Whether coordinate `place` changes the residuals of `block`.
    fn moves(&self, place: usize, block: usize) -> bool {
        if let Some(nominal) = self.free.get(place) {
            return self.model.nominal_blocks()[*nominal].contains(&block);
        }
        let mut left = place - self.free.len();
        for candidate in self.candidates {
            let candidate = &self.model.candidates()[*candidate];
            if left < candidate.parameters.len() {
                return candidate.blocks.contains(&block);
            }
            left -= candidate.parameters.len();
        }
        false
    }

    /// The prior's residual of a coordinate, and its slope.
    fn prior(&self, place: usize) -> (f64, f64) {
        if place < self.free.len() {
            (self.x[place], 1.0)
        } else {
            ((self.x[place] - 1.0) / EFFECT_PRIOR, 1.0 / EFFECT_PRIOR)
        }
    }

    /// The problem at its minimum near `x`.
    fn minimized(mut self, x: &DVector<f64>, (cost, step, evaluations): (f64, f64, usize)) -> Self {
        self.set_params(x);
        if x.is_empty() || self.at.is_none() {
            return self;
        }
        let minimizer = LevenbergMarquardt::new()
            .with_patience(1 + evaluations / x.len())
            .with_ftol(cost)
            .with_xtol(step);
        let (mut found, _) = minimizer.minimize(self);
        if found.at.is_none() {
            found.set_params(x);
        }
        found
    }

    /// Cost at `x`.
    fn cost_at(&mut self, x: &DVector<f64>) -> f64 {
        self.set_params(x);
        self.residuals().map_or(f64::INFINITY, |r| r.norm_squared())
    }

    /// The fit where the problem stands, with what it predicts.
    fn into_fit(self) -> Option<Fit> {
        let (nominal, effects) = (self.nominal(&self.x), self.effects(&self.x));
        let part = |block: &usize| Part {
            block: *block,
            fitted: Tally::default(),
            predicted: Tally::default(),
        };
        let mut parts: Vec<Part> = self.blocks.iter().map(part).collect();
        for ((_, block), residuals) in self.pieces().zip(self.at.as_ref()?) {
            for part in parts.iter_mut().filter(|part| part.block == block) {
                part.fitted += tally(residuals);
            }
        }
        for record in self.model.fitted()..self.model.records() {
            for part in &mut parts {
                let residuals = self
                    .model
                    .residuals(record, part.block, &nominal, &effects)?;
                part.predicted += tally(&residuals);
            }
        }
        let priors = (0..self.x.len()).map(|place| self.prior(place).0);
        let mut values = self.x.iter().skip(self.free.len()).copied();
        let all = self.model.candidates();
        let own = |c: &usize| values.by_ref().take(all[*c].parameters.len()).collect();
        Some(Fit {
            prior: 0.5 * priors.map(|r| r * r).sum::<f64>(),
            free_run: 0.0,
            coordinates: self.candidates.iter().map(own).collect(),
            nominal,
            effects,
            parts,
        })
    }

    fn evaluate(&mut self) {
        self.at = self
            .pieces()
            .map(|piece| self.piece(&self.x, piece))
            .collect();
    }

    /// How the residuals of `piece`, which are `base`, change with coordinate `place`.
    fn column(&self, place: usize, piece: (usize, usize), base: &[f64]) -> Option<Vec<f64>> {
        if !self.moves(place, piece.1) || (self.held && place < self.free.len()) {
            return Some(vec![0.0; base.len()]);
        }
        let mut moved = self.x.clone();
        moved[place] += STEP;
        let residuals = self.piece(&moved, piece)?;
        Some(
            residuals
                .iter()
                .zip(base)
                .map(|(a, b)| (a - b) / STEP)
                .collect(),
        )
    }
}

impl<M: Model> LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, M> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.x.clone_from(x);
        self.evaluate();
    }

    fn params(&self) -> DVector<f64> {
        self.x.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let pieces = self.at.as_ref()?;
        let priors = (0..self.x.len()).map(|place| self.prior(place).0);
        let all = pieces.iter().flatten().map(|r| tamed(*r).0).chain(priors);
        Some(DVector::from_vec(all.collect()))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let pieces = self.at.as_ref()?;
        let size = self.x.len();
        let rows = pieces.iter().map(Vec::len).sum::<usize>() + size;
        let mut jacobian = DMatrix::zeros(rows, size);
        let mut row = 0;
        for (piece, base) in self.pieces().zip(pieces) {
            for place in 0..size {
                let column = self.column(place, piece, base)?;
                for (i, change) in column.iter().enumerate() {
                    jacobian[(row + i, place)] = change * tamed(base[i]).1;
                }
            }
            row += base.len();
        }
        for place in 0..size {
            jacobian[(row + place, place)] = self.prior(place).1;
        }
        Some(jacobian)
    }
}

/// A residual whose square grows like the residual itself beyond [`OUTLIER`] (Huber's loss), so
/// that
/// the few moments that a block does not see right do not rule the fit; and its slope.
fn tamed(residual: f64) -> (f64, f64) {
    let size = residual.abs();
    if size <= OUTLIER {
        return (residual, 1.0);
    }
    let tame = (OUTLIER * (2.0 * size - OUTLIER)).sqrt();
    (residual.signum() * tame, OUTLIER / tame)
}

/// Half the sum of squares of tamed residuals.
fn tally(residuals: &[f64]) -> Tally {
    Tally {
        cost: 0.5 * residuals.iter().map(|r| tamed(*r).0.powi(2)).sum::<f64>(),
        count: residuals.len(),
    }
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Tally) {
        self.cost += other.cost;
        self.count += other.count;
    }
}

/// Fits by their blocks and candidates.
type Fits = HashMap<(Vec<usize>, Vec<usize>), Option<Fit>>;

/// Fits and what they predict, each made once.
pub struct Engine<'a, M> {
    /// The model.
    pub model: &'a M,
    fits: Mutex<Fits>,
}

/// A hypothesis: which candidates are present, and how well it fits and predicts.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// The candidates.
    pub candidates: Vec<usize>,
    /// The fit.
    pub fit: Fit,
}

impl<'a, M: Model> Engine<'a, M> {
    /// An engine for `model`.
    pub fn new(model: &'a M) -> Self {
        Engine {
            model,
            fits: Mutex::default(),
        }
    }

    /// The groups of blocks that `candidates` tie together, with the candidates of each.
    fn groups(&self, candidates: &[usize]) -> Vec<(Vec<usize>, Vec<usize>)> {
        let blocks = self.model.blocks().len();
        let mut group: Vec<usize> = (0..blocks).collect();
        let all = self.model.candidates();
        let ties = candidates.iter().map(|candidate| &all[*candidate].blocks);
        for tied in ties.chain(self.model.nominal_blocks()) {
            let Some(first) = tied.first().map(|block| group[*block]) else {
                continue;
            };
            let joined: Vec<usize> = tied.iter().map(|block| group[*block]).collect();
            for own in &mut group {
                if joined.contains(own) {
                    *own = first;
                }
            }
        }
        let names: BTreeSet<usize> = group.iter().copied().collect();
        let members = |name: usize| (0..blocks).filter(|b| group[*b] == name).collect();
        let groups = names.into_iter().map(|name| {
            let blocks: Vec<usize> = members(name);
            let touching = candidates.iter().copied();
            let touching = touching.filter(|c| all[*c].blocks.iter().any(|b| blocks.contains(b)));
            let touching = touching.collect();
            (blocks, touching)
        });
        groups.collect()
    }

    /// Fits the blocks' residuals with `candidates`; `None` without a solution.
    pub fn group(&self, blocks: &[usize], candidates: &[usize]) -> Option<Fit> {
        let key = (blocks.to_vec(), candidates.to_vec());
        if let Some(known) = self.fits.lock().ok()?.get(&key) {
            return known.clone();
        }
        let fit = self.fit(blocks, candidates);
        self.fits.lock().ok()?.insert(key, fit.clone());
        fit
    }

    fn fit(&self, blocks: &[usize], candidates: &[usize]) -> Option<Fit> {
        let free = self.free(blocks);
        let all = self.model.candidates();
        let mut problem = Problem::new(self.model, blocks, &free, candidates);
        problem.held = !candidates.is_empty();
        let starts = match candidates {
            [] => vec![Vec::new()],
            [alone] => starts(&all[*alone].parameters),
            several => self.starts_together(several)?,
        };
        // Every start is looked at, the best are followed with the effects alone: else nominal
        // values take up what is theirs. The best of that is followed with all.
        let mut begun: Vec<(f64, DVector<f64>)> = Vec::new();
        let only = starts.len() <= STARTS;
        for start in starts {
            let x: Vec<f64> = free.iter().map(|_| 0.0).chain(start).collect();
            let x = DVector::from_vec(x);
            let cost = if only { 0.0 } else { problem.cost_at(&x) };
            begun.push((cost, x));
        }
        begun.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(f64, DVector<f64>)> = None;
        for (_, x) in begun.into_iter().take(STARTS) {
            if problem.held {
                problem = problem.minimized(&x, LOOSE);
            } else {
                problem.set_params(&x);
            }
            let Some(residuals) = problem.residuals() else {
                continue;
            };
            let cost = residuals.norm_squared();
            if best.as_ref().is_none_or(|best| cost < best.0) {
                best = Some((cost, problem.x.clone()));
            }
        }
        problem.held = false;
        // Every comparison is with the fit without effects.
        let goal = if candidates.is_empty() { TIGHT } else { LOOSE };
        problem.minimized(&best?.1, goal).into_fit()
    }

    /// Where a fit of several candidates begins: where each alone has ended, unless that was
    /// nowhere; and where each would begin alone.
    fn starts_together(&self, candidates: &[usize]) -> Option<Vec<Vec<f64>>> {
        let all = self.model.candidates();
        let mut together = [Vec::new(), Vec::new()];
        for candidate in candidates {
            let parameters = &all[*candidate].parameters;
            let begin = starts(parameters).swap_remove(0);
            let alone = self.joined(&[*candidate]);
            let ended = alone.and_then(|fit| fit.coordinates.into_iter().next());
            let somewhere = ended.filter(|ended| {
                ended.iter().zip(parameters).all(|(x, parameter)| {
                    let value = parameter.value(*x);
                    parameter.range.0 < value && value < parameter.range.1
                })
            });
            together[0].extend(somewhere.unwrap_or_else(|| begin.clone()));
            together[1].extend(begin);
        }
        let [ended, begun] = together;
        Some(if ended == begun {
            vec![begun]
        } else {
            vec![ended, begun]
        })
    }

    /// The fits of the groups of `candidates`, joined.
    fn joined(&self, candidates: &[usize]) -> Option<Fit> {
        let mut joint = Fit::nothing(self.model.nominal_blocks().len());
        for (blocks, touching) in self.groups(candidates) {
            joint.join(self.group(&blocks, &touching)?);
        }
        Some(joint)
    }

    /// The nominal values on which `blocks` depend.
    fn free(&self, blocks: &[usize]) -> Vec<usize> {
        let nominal_blocks = self.model.nominal_blocks();
        let depends = |n: &usize| {
            nominal_blocks[*n]
                .iter()
                .any(|block| blocks.contains(block))
        };
        (0..nominal_blocks.len()).filter(depends).collect()
    }

    fn finished(&self, candidates: Vec<usize>, mut fit: Fit) -> Option<Hypothesis> {
        fit.sort();
        for record in 0..self.model.records() {
            fit.free_run += self.model.free_run(record, &fit.nominal, &fit.effects)?;
        }
        Some(Hypothesis { candidates, fit })
    }

    /// `hypothesis` with its minimum found to the last digit that matters.
    pub fn polished(&self, hypothesis: &Hypothesis) -> Option<Hypothesis> {
        let mut joint = Fit::nothing(self.model.nominal_blocks().len());
        for (blocks, touching) in self.groups(&hypothesis.candidates) {
            let free = self.free(&blocks);
            let coordinates = touching.iter().flat_map(|candidate| {
                let effects = hypothesis.fit.effects.iter();
                let place = effects.take_while(|(own, _)| own != candidate).count();
                hypothesis.fit.coordinates[place].clone()
            });
            let nominal = free.iter().map(|n| hypothesis.fit.nominal[*n]);
            let x: Vec<f64> = nominal.chain(coordinates).collect();
            let problem = Problem::new(self.model, &blocks, &free, &touching);
            let problem = problem.minimized(&DVector::from_vec(x), TIGHT);
            let x = problem.x.clone();
            joint.join(problem.minimized(&x, TIGHT).into_fit()?);
        }
        self.finished(hypothesis.candidates.clone(), joint)
    }

    /// Standard errors of the parameters of the candidates of `hypothesis`, as their 95 %
    /// intervals.
    ///
    /// From the Jacobian and the scatter of its products with the residuals from one stretch of
    /// time to the next (White's estimator, clustered), which holds when residuals are not white,
    /// or
    /// their noise is not the assumed one; never narrower than the assumed noise makes them.
    pub fn intervals(&self, hypothesis: &Hypothesis) -> Option<Vec<Vec<[f64; 2]>>> {
        let blocks: Vec<usize> = (0..self.model.blocks().len()).collect();
        let free = self.free(&blocks);
        let own = hypothesis.fit.coordinates.iter().flatten();
        let nominal = free.iter().map(|n| &hypothesis.fit.nominal[*n]);
        let x: Vec<f64> = nominal.chain(own).copied().collect();
        let mut problem = Problem::new(self.model, &blocks, &free, &hypothesis.candidates);
        problem.set_params(&DVector::from_vec(x));
        let residuals = problem.residuals()?;
        let jacobian = problem.jacobian()?;
        let bread = (jacobian.transpose() * &jacobian).try_inverse()?;
        let size = problem.x.len();
        let mut filling = DMatrix::zeros(size, size);
        let mut row = 0;
        let mut clusters = 0;
        for piece in problem.at.as_ref()? {
            let length = piece.len().div_ceil(CLUSTERS).max(1);
            for start in (0..piece.len()).step_by(length) {
                let rows = length.min(piece.len() - start);
                let part = jacobian.rows(row + start, rows);
                let product = part.transpose() * residuals.rows(row + start, rows);
                filling += &product * product.transpose();
                clusters += 1;
            }
            row += piece.len();
        }
        // The priors count as observations that are met on average.
        for place in 0..size {
            filling[(place, place)] += problem.prior(place).1.powi(2);
        }
        let few = clusters as f64 / (clusters as f64 - size as f64).max(1.0);
        let robust = &bread * filling * &bread * few;
        let mut place = free.len();
        let all = self.model.candidates();
        let of = |candidate: &usize| {
            let parameters = all[*candidate].parameters.iter().map(|parameter| {
                let variance = robust[(place, place)].max(bread[(place, place)]);
                let (x, reach) = (problem.x[place], 1.96 * variance.max(0.0).sqrt());
                place += 1;
                [parameter.value(x - reach), parameter.value(x + reach)]
            });
            parameters.map(|[a, b]| [a.min(b), a.max(b)]).collect()
        };
        Some(hypothesis.candidates.iter().map(of).collect())
    }

    /// What each candidate promises beyond `base`: by how much it would lower the cost of what is
    /// fitted, if residuals changed in proportion to it; the best of its starts. Costs one
    /// evaluation a start.
    pub fn promises(&self, base: &Hypothesis) -> Option<Vec<f64>> {
        let blocks: Vec<usize> = (0..self.model.blocks().len()).collect();
        let free: Vec<usize> = (0..self.model.nominal_blocks().len()).collect();
        let own = base.fit.coordinates.iter().flatten();
        let x: Vec<f64> = base.fit.nominal.iter().chain(own).copied().collect();
        let mut problem = Problem::new(self.model, &blocks, &free, &base.candidates);
        problem.set_params(&DVector::from_vec(x));
        let at = problem.at.as_ref()?;
        let residuals = problem.residuals()?;
        let jacobian = problem.jacobian()?;
        // What the present parameters can take up is no promise.
        let orthonormal = jacobian.qr().q();
        let left = &residuals - &orthonormal * (orthonormal.transpose() * &residuals);
        let nominal = problem.nominal(&problem.x);
        let effects = problem.effects(&problem.x);
        let promise = |(place, candidate): (usize, &Candidate)| {
            let promised = starts(&candidate.parameters)
                .into_iter()
                .filter_map(|start| {
                    let values = candidate.parameters.iter().zip(start);
                    let mut with = effects.clone();
                    with.push((place, values.map(|(p, x)| p.value(x)).collect()));
                    let mut change = Vec::with_capacity(residuals.len());
                    for ((record, block), base) in problem.pieces().zip(at) {
                        if candidate.blocks.contains(&block) {
                            let moved = self.model.residuals(record, block, &nominal, &with)?;
                            let pairs = moved.iter().zip(base);
                            change.extend(pairs.map(|(to, from)| (to - from) * tamed(*from).1));
                        } else {
                            change.extend(std::iter::repeat_n(0.0, base.len()));
                        }
                    }
                    change.resize(residuals.len(), 0.0);
                    let change = DVector::from_vec(change);
                    let new = &change - &orthonormal * (orthonormal.transpose() * &change);
                    let size = new.norm_squared();
                    let gain = 0.5 * left.dot(&new).powi(2) / size;
                    (size > 1e-9 && gain.is_finite()).then_some(gain)
                });
            promised.fold(0.0, f64::max)
        };
        let candidates = self.model.candidates();
        Some(candidates.par_iter().enumerate().map(promise).collect())
    }

    /// How well `candidates` together fit; `None` without a solution.
    pub fn hypothesis(&self, candidates: &[usize]) -> Option<Hypothesis> {
        let mut candidates = candidates.to_vec();
        candidates.sort_unstable();
        let joint = self.joined(&candidates)?;
        self.finished(candidates, joint)
    }
}

/// Where a fit of effect parameters begins: sizes at half the usual one, in either direction where
/// there are two; what is fitted by its logarithm also well above and below.
fn starts(parameters: &[Parameter]) -> Vec<Vec<f64>> {
    let mut starts = vec![Vec::new()];
    for parameter in parameters {
        let values: Vec<f64> = if parameter.log {
            let reach = START_FACTOR.ln();
            let low = (parameter.range.0 / parameter.usual).ln();
            let high = (parameter.range.1 / parameter.usual).ln();
            [0.0, -reach, reach]
                .iter()
                .map(|x| 1.0 + x.clamp(low, high))
                .collect()
        } else if parameter.range.0 < 0.0 {
            vec![0.5, -0.5]
        } else {
            vec![0.5]
        };
        let longer = starts.iter().flat_map(|start: &Vec<f64>| {
            values.iter().map(move |value| {
                let mut longer = start.clone();
                longer.push(*value);
                longer
            })
        });
        starts = longer.collect();
    }
    starts
}

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
    /// Where the effect belongs.
    pub place: &'static str,
    /// What is fitted.
    pub parameters: Vec<Parameter>,
    /// The blocks whose residuals it changes.
    pub blocks: Vec<usize>,
}

/// A candidate with values of its parameters.
pub type Active = (usize, Vec<f64>);

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
    /// Residuals of a block over a record, in units of their noise; `nominal` in standard deviations
    /// of its prior. Their number does not depend on `nominal` and `effects`. `None` where the
    /// model has no solution.
    fn residuals(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Vec<f64>>;
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
    /// Parameters of the candidates as the fit moves them, candidate by candidate.
    coordinates: Vec<Vec<f64>>,
}

impl Fit {
    fn cost(&self) -> f64 {
        self.prior + self.parts.iter().map(|part| part.fitted.cost).sum::<f64>()
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

struct Problem<'a, M> {
    model: &'a M,
    blocks: &'a [usize],
    /// The nominal values that are free.
    free: &'a [usize],
    candidates: &'a [usize],
    x: DVector<f64>,
    /// The residuals at `x`, block by block of each record.
    at: Option<Vec<Vec<f64>>>,
}

impl<M: Model> Problem<'_, M> {
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

    fn evaluate(&mut self) {
        self.at = self.pieces().map(|piece| self.piece(&self.x, piece)).collect();
    }

    /// How the residuals of `piece`, which are `base`, change with coordinate `place`.
    fn column(&self, place: usize, piece: (usize, usize), base: &[f64]) -> Option<Vec<f64>> {
        if !self.moves(place, piece.1) {
            return Some(vec![0.0; base.len()]);
        }
        let mut moved = self.x.clone();
        moved[place] += STEP;
        let residuals = self.piece(&moved, piece)?;
        Some(residuals.iter().zip(base).map(|(a, b)| (a - b) / STEP).collect())
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

/// A residual whose square grows like the residual itself beyond [`OUTLIER`] (Huber's loss), so that
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

/// Fits and what they predict, each made once.
pub struct Engine<'a, M> {
    /// The model.
    pub model: &'a M,
    fits: Mutex<HashMap<(Vec<usize>, Vec<usize>), Option<Fit>>>,
}

/// A hypothesis: which candidates are present, and how well it fits and predicts.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// The candidates.
    pub candidates: Vec<usize>,
    /// The fit.
    pub fit: Fit,
}

impl Hypothesis {
    /// Cost of what was fitted, priors included.
    pub fn cost(&self) -> f64 {
        self.fit.cost()
    }
    /// Cost of what was predicted.
    pub fn predicted(&self) -> f64 {
        self.fit.parts.iter().map(|part| part.predicted.cost).sum()
    }
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
        let nominal_blocks = self.model.nominal_blocks();
        let free: Vec<usize> = (0..nominal_blocks.len())
            .filter(|n| nominal_blocks[*n].iter().any(|block| blocks.contains(block)))
            .collect();
        let parameters: Vec<Parameter> = candidates
            .iter()
            .flat_map(|candidate| self.model.candidates()[*candidate].parameters.clone())
            .collect();
        let mut problem = Problem {
            model: self.model,
            blocks,
            free: &free,
            candidates,
            x: DVector::zeros(0),
            at: None,
        };
        // Look at every start, follow the best.
        let mut begun: Vec<(f64, Vec<f64>)> = Vec::new();
        let starts = starts(&parameters);
        let single = starts.len() == 1;
        for start in starts {
            let x: Vec<f64> = free.iter().map(|_| 0.0).chain(start).collect();
            let cost = if single {
                0.0
            } else {
                problem.set_params(&DVector::from_vec(x.clone()));
                problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared())
            };
            begun.push((cost, x));
        }
        begun.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(f64, DVector<f64>)> = None;
        for (_, x) in begun.into_iter().take(STARTS) {
            problem.set_params(&DVector::from_vec(x));
            if problem.at.is_none() {
                continue;
            }
            if !problem.x.is_empty() {
                let minimizer = LevenbergMarquardt::new()
                    .with_patience(1 + 24 / problem.x.len())
                    .with_ftol(1e-4)
                    .with_xtol(1e-3);
                (problem, _) = minimizer.minimize(problem);
            }
            let Some(residuals) = problem.residuals() else { continue };
            let cost = residuals.norm_squared();
            if best.as_ref().is_none_or(|best| cost < best.0) {
                best = Some((cost, problem.x.clone()));
            }
        }
        let (_, x) = best?;
        problem.set_params(&x);
        let (nominal, effects) = (problem.nominal(&x), problem.effects(&x));
        let mut parts: Vec<Part> = blocks
            .iter()
            .map(|block| Part {
                block: *block,
                fitted: Tally::default(),
                predicted: Tally::default(),
            })
            .collect();
        for ((_, block), residuals) in problem.pieces().zip(problem.at.as_ref()?) {
            if let Some(part) = parts.iter_mut().find(|part| part.block == block) {
                part.fitted += tally(residuals);
            }
        }
        for record in self.model.fitted()..self.model.records() {
            for part in &mut parts {
                let residuals = self.model.residuals(record, part.block, &nominal, &effects)?;
                part.predicted += tally(&residuals);
            }
        }
        let priors = (0..x.len()).map(|place| problem.prior(place).0);
        Some(Fit {
            prior: 0.5 * priors.map(|r| r * r).sum::<f64>(),
            nominal,
            effects,
            parts,
            coordinates: {
                let mut values = x.iter().skip(free.len()).copied();
                let of = |c: &usize| self.model.candidates()[*c].parameters.len();
                candidates.iter().map(|c| values.by_ref().take(of(c)).collect()).collect()
            },
        })
    }

    /// What each candidate promises beyond `base`: by how much it would lower the cost of what is
    /// fitted, if residuals changed in proportion to it; the best of its starts. Costs one
    /// evaluation a start.
    pub fn promises(&self, base: &Hypothesis) -> Option<Vec<f64>> {
        let blocks: Vec<usize> = (0..self.model.blocks().len()).collect();
        let free: Vec<usize> = (0..self.model.nominal_blocks().len()).collect();
        let mut problem = Problem {
            model: self.model,
            blocks: &blocks,
            free: &free,
            candidates: &base.candidates,
            x: {
                let own = base.fit.coordinates.iter().flatten();
                DVector::from_vec(base.fit.nominal.iter().chain(own).copied().collect())
            },
            at: None,
        };
        problem.evaluate();
        let at = problem.at.as_ref()?;
        let residuals = problem.residuals()?;
        let jacobian = problem.jacobian()?;
        // What the present parameters can take up is no promise.
        let orthonormal = jacobian.qr().q();
        let left = &residuals - &orthonormal * (orthonormal.transpose() * &residuals);
        let nominal = problem.nominal(&problem.x);
        let effects = problem.effects(&problem.x);
        let promise = |(place, candidate): (usize, &Candidate)| {
            let promised = starts(&candidate.parameters).into_iter().filter_map(|start| {
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
        let mut joint = Fit {
            nominal: vec![0.0; self.model.nominal_blocks().len()],
            effects: Vec::new(),
            parts: Vec::new(),
            prior: 0.0,
            coordinates: Vec::new(),
        };
        for (blocks, touching) in self.groups(&candidates) {
            let fit = self.group(&blocks, &touching)?;
            for (place, value) in fit.nominal.iter().enumerate() {
                joint.nominal[place] += value;
            }
            joint.effects.extend(fit.effects);
            joint.coordinates.extend(fit.coordinates);
            joint.parts.extend(fit.parts);
            joint.prior += fit.prior;
        }
        joint.parts.sort_by_key(|part| part.block);
        // In the candidates' order, after the nominal values.
        let mut order: Vec<usize> = (0..joint.effects.len()).collect();
        order.sort_by_key(|place| joint.effects[*place].0);
        joint.effects = order.iter().map(|place| joint.effects[*place].clone()).collect();
        let coordinates = order.iter().map(|place| joint.coordinates[*place].clone()).collect();
        joint.coordinates = coordinates;
        Some(Hypothesis {
            candidates,
            fit: joint,
        })
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
            [0.0, -reach, reach].iter().map(|x| 1.0 + x.clamp(low, high)).collect()
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

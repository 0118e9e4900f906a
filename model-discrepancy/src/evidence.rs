//! Probabilities of sets of effects, by the evidence of effects with free shapes.
//!
//! Residuals of each block are linear in the weights of columns: of nominal values and sensors'
//! zeros, which every hypothesis has, and of its effects. An effect is a Gaussian vector in the
//! span of its [`Signature`]: the span makes it that effect, its law is free within the span. What
//! no column explains is white noise and an Ornstein–Uhlenbeck process in time, one for each block.
//! A rig that has the effects of a hypothesis leaves little of this process: a base, and a share of
//! the effects, as no span contains a rig's law exactly. A hypothesis with an *unknown* in a block
//! leaves any amount of it there.
//!
//! The evidence for given amplitudes of the process is in closed form: the residuals are whitened
//! by a scalar Kalman filter, and Bayesian linear regression follows (Rasmussen & Williams 2006,
//! sections 2.1 and B.2). Amplitudes and time constants of the process and sizes of the effects are
//! maximized over grids with their priors.

use super::rows::{Column, Rows};
use super::signature::Signature;
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;

/// A set of blocks, a bit for each.
pub type Blocks = u32;

/// Amplitudes of the process, in units of the base, beside 0.
const AMPLITUDES: [f64; 11] = [
    0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0,
];
/// Time constants of the process \[s\].
const TIME_CONSTANTS_S: [f64; 2] = [0.1, 1.0];
/// Sizes of an effect: the standard deviation of its weights, in units of the base.
const SIZES: [f64; 5] = [0.5, 2.0, 8.0, 32.0, 128.0];
/// Share of an effect that the span of its signature may leave of a rig's law.
const FORM_ERROR: f64 = 0.15;
/// Standard deviations of its prior by which a weight may change to take the part of an effect, at
/// the price of one base.
const FAR: f64 = 3.0;
/// Prior probabilities of a set of no effect, one, two and three.
const SET_PRIOR: [f64; 4] = [0.3, 0.4, 0.2, 0.1];
/// Prior probability of an unknown.
const UNKNOWN_PRIOR: f64 = 0.15;
/// Single effects and pairs of which larger sets are made.
const LEADING: [usize; 2] = [6, 4];
/// Passes over the blocks, and over the effects, until nothing changes.
const PASSES: usize = 4;

/// All that the evidence is computed from.
pub struct Evidence {
    blocks: Vec<Block>,
    effects: Vec<Effect>,
    common: usize,
}

struct Effect {
    form_error: f64,
    signed: bool,
    log_prior: f64,
    mean: Vec<f64>,
    columns: Range<usize>,
}

struct Block {
    /// Place of each column in the matrices, if it changes the block.
    places: Vec<Option<usize>>,
    /// Mean products of the columns in units of the base.
    products: DMatrix<f64>,
    /// For each amplitude and time constant of the process.
    whitened: Vec<Whitened>,
}

struct Whitened {
    /// In units of the base.
    amplitude: f64,
    /// Products of the columns, the residual last.
    gram: DMatrix<f64>,
    half_log_determinant: f64,
}

/// The most probable state of a hypothesis.
#[derive(Clone, Debug)]
pub struct State {
    /// Log evidence, without the prior of the set.
    pub log_evidence: f64,
    /// Weights of the common columns, then of the effects in their order.
    pub weights: Vec<f64>,
    /// Amplitude of the process in each block, in units of the base.
    pub amplitudes: Vec<f64>,
}

/// A set of effects, perhaps with an unknown.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Its effects, in ascending order.
    pub effects: Vec<usize>,
    /// Blocks with an unknown.
    pub unknown: Blocks,
    /// Its probability.
    pub probability: f64,
}

impl Block {
    fn new(rows: &Rows, number: usize, columns: &[&Column]) -> Block {
        let changes = |column: &usize| !columns[*column][number].is_empty();
        let own: Vec<usize> = (0..columns.len()).filter(changes).collect();
        let mut places = vec![None; columns.len()];
        for (place, column) in own.iter().enumerate() {
            places[*column] = Some(place);
        }
        // A row of the block is a column here: its values lie together.
        let values = DMatrix::from_fn(own.len() + 1, rows.residual.len(), |place, row| {
            own.get(place)
                .map_or(rows.residual[row], |column| columns[*column][number][row])
        });
        let mut in_bases = values.clone();
        for (mut row, base) in in_bases.column_iter_mut().zip(&rows.base) {
            row /= *base;
        }
        let per_count = (rows.residual.len().max(1) as f64).recip();
        let with_times =
            AMPLITUDES.map(|amplitude| TIME_CONSTANTS_S.map(|time_s| (amplitude, time_s)));
        let mut grid = vec![(0.0, TIME_CONSTANTS_S[0])];
        grid.extend(with_times.as_flattened());
        let whitened = grid.into_par_iter().map(|(amplitude, time_constant_s)| {
            let (whitened, half_log_determinant) =
                rows.whitened(values.clone(), amplitude, time_constant_s);
            Whitened {
                amplitude,
                gram: &whitened * whitened.transpose(),
                half_log_determinant,
            }
        });
        Block {
            whitened: whitened.collect(),
            products: &in_bases * in_bases.transpose() * per_count,
            places,
        }
    }

    /// Where columns stand in the matrices, each with its place among `columns`.
    fn places(&self, columns: impl Iterator<Item = usize>) -> Vec<(usize, usize)> {
        let places = columns.enumerate();
        places
            .filter_map(|(at, column)| Some((at, self.places[column]?)))
            .collect()
    }

    /// Mean square of `own` columns with weights in units of the base.
    fn mean_square(&self, own: &[(usize, f64)]) -> f64 {
        let pairs = own.iter().flat_map(|a| own.iter().map(move |b| (a, b)));
        pairs
            .map(|((a, x), (b, y))| x * y * self.products[(*a, *b)])
            .sum::<f64>()
            .max(0.0)
    }

    /// Mean square of what `own` columns do that `others`, with these prior precisions, could not.
    fn mean_square_beyond(&self, own: &[(usize, f64)], others: &[(usize, f64)]) -> f64 {
        let product = |a: usize, b: usize| self.products[(a, b)];
        let matrix = DMatrix::from_fn(others.len(), others.len(), |i, j| {
            let price = if i == j {
                others[i].1 / (FAR * FAR)
            } else {
                0.0
            };
            product(others[i].0, others[j].0) + price
        });
        let with =
            |(other, _): &(usize, f64)| own.iter().map(|(c, w)| w * product(*other, *c)).sum();
        let vector = DVector::from_iterator(others.len(), others.iter().map(with));
        let Some(factor) = Cholesky::new(matrix) else {
            return 0.0;
        };
        (self.mean_square(own) - factor.solve(&vector).dot(&vector)).max(0.0)
    }
}

/// The columns of a hypothesis and their prior precisions.
struct Problem {
    columns: Vec<usize>,
    precisions: Vec<f64>,
    /// Where the columns of each effect stand.
    ranges: Vec<Range<usize>>,
    /// For each block, where the columns stand here and in its matrices.
    places: Vec<Vec<(usize, usize)>>,
}

impl Problem {
    fn half_log_prior(&self) -> f64 {
        0.5 * self.precisions.iter().map(|p| p.ln()).sum::<f64>()
    }
}

impl Evidence {
    /// Of `blocks`, with columns that all hypotheses have, whose weights have unit prior variance,
    /// and effects.
    pub fn new(blocks: &[Rows], common: &[Column], effects: &[Signature]) -> Evidence {
        let mut columns: Vec<&Column> = common.iter().collect();
        let effects = effects.iter().map(|signature| {
            let first = columns.len();
            columns.extend(&signature.columns);
            Effect {
                form_error: if signature.of.exact { 0.0 } else { FORM_ERROR },
                signed: signature.of.signed,
                log_prior: signature.log_prior,
                mean: signature.mean.clone(),
                columns: first..columns.len(),
            }
        });
        let effects = effects.collect();
        let blocks = blocks.iter().enumerate();
        Evidence {
            effects,
            blocks: blocks
                .map(|(number, rows)| Block::new(rows, number, &columns))
                .collect(),
            common: common.len(),
        }
    }

    fn problem(&self, set: &[usize], sizes: &[f64]) -> Problem {
        let mut columns: Vec<usize> = (0..self.common).collect();
        let mut precisions = vec![1.0; self.common];
        let mut ranges = Vec::new();
        for (effect, size) in set.iter().zip(sizes) {
            let own = self.effects[*effect].columns.clone();
            ranges.push(columns.len()..columns.len() + own.len());
            precisions.resize(columns.len() + own.len(), (size * size).recip());
            columns.extend(own);
        }
        let places = self.blocks.iter();
        let places = places.map(|block| block.places(columns.iter().copied()));
        Problem {
            places: places.collect(),
            columns,
            precisions,
            ranges,
        }
    }

    /// Adds a block's part to the normal equations; the square of its residual and half its log
    /// determinant.
    fn add(
        &self,
        (matrix, vector): (&mut DMatrix<f64>, &mut DVector<f64>),
        problem: &Problem,
        block: usize,
        at: usize,
    ) -> [f64; 2] {
        let whitened = &self.blocks[block].whitened[at];
        let gram = &whitened.gram;
        let last = gram.nrows() - 1;
        for (own, place) in &problem.places[block] {
            for (other, other_place) in &problem.places[block] {
                matrix[(*other, *own)] += gram[(*other_place, *place)];
            }
            vector[*own] += gram[(last, *place)];
        }
        [gram[(last, last)], whitened.half_log_determinant]
    }

    /// The most probable state of a set with effects of these sizes, found from `grid` on, and the
    /// place of each block's process in its grid.
    fn state(
        &self,
        set: &[usize],
        sizes: &[f64],
        unknown: Blocks,
        mut grid: Vec<usize>,
    ) -> Option<(State, Vec<usize>)> {
        let problem = self.problem(set, sizes);
        let size = problem.columns.len();
        let mut best = None;
        for _ in 0..PASSES {
            let before = grid.clone();
            for block in 0..self.blocks.len() {
                let mut matrix =
                    DMatrix::from_diagonal(&DVector::from_row_slice(&problem.precisions));
                let mut vector = DVector::zeros(size);
                let mut rest = [0.0; 2];
                for other in (0..self.blocks.len()).filter(|other| *other != block) {
                    let part = self.add((&mut matrix, &mut vector), &problem, other, grid[other]);
                    rest = [rest[0] + part[0], rest[1] + part[1]];
                }
                let mut leading: Option<(f64, usize, f64, Vec<f64>)> = None;
                for at in 0..self.blocks[block].whitened.len() {
                    let (mut matrix, mut vector) = (matrix.clone(), vector.clone());
                    let own = self.add((&mut matrix, &mut vector), &problem, block, at);
                    let Some(factor) = Cholesky::new(matrix) else {
                        continue;
                    };
                    let weights = factor.solve(&vector);
                    let square = rest[0] + own[0] - weights.dot(&vector);
                    let diagonal = factor.l_dirty().diagonal();
                    let half_log = diagonal.iter().map(|d| d.ln()).sum::<f64>();
                    let log =
                        -0.5 * square - half_log + problem.half_log_prior() - rest[1] - own[1];
                    if !log.is_finite() {
                        continue;
                    }
                    let weights: Vec<f64> = weights.iter().copied().collect();
                    let prior = self.log_process_prior(block, at, set, &problem, &weights, unknown);
                    if leading
                        .as_ref()
                        .is_none_or(|(most, ..)| log + prior > *most)
                    {
                        leading = Some((log + prior, at, log, weights));
                    }
                }
                let (_, at, log, weights) = leading?;
                grid[block] = at;
                best = Some((log, weights));
            }
            if grid == before {
                break;
            }
        }
        let (mut log_evidence, weights) = best?;
        log_evidence -= set.len() as f64 * (SIZES.len() as f64).ln();
        log_evidence += set
            .iter()
            .map(|own| self.effects[*own].log_prior)
            .sum::<f64>();
        for (block, at) in grid.iter().enumerate() {
            log_evidence += self.log_process_prior(block, *at, set, &problem, &weights, unknown);
        }
        if !self.is_admissible(set, &problem, &weights) {
            return None;
        }
        let amplitudes = self.blocks.iter().zip(&grid);
        let amplitudes = amplitudes.map(|(block, at)| block.whitened[*at].amplitude);
        let state = State {
            log_evidence,
            weights,
            amplitudes: amplitudes.collect(),
        };
        Some((state, grid))
    }

    /// The columns of an effect of a set in a block's matrices, with their weights.
    fn weighted(
        &self,
        (problem, weights): (&Problem, &[f64]),
        block: usize,
        number: usize,
    ) -> Vec<(usize, f64)> {
        let range = &problem.ranges[number];
        let own = problem.places[block].iter();
        own.filter(|(at, _)| range.contains(at))
            .map(|(at, place)| (*place, weights[*at]))
            .collect()
    }

    /// Root of the sum of squares, in units of the base, of what the forms of effects of a set may
    /// leave in a block; without its effect `but`.
    fn form_error(
        &self,
        set: &[usize],
        state: (&Problem, &[f64]),
        block: usize,
        but: Option<usize>,
    ) -> f64 {
        let others = set
            .iter()
            .enumerate()
            .filter(|(number, _)| Some(*number) != but);
        let square = |(number, effect): (usize, &usize)| {
            let share = self.effects[*effect].form_error;
            share * share * self.blocks[block].mean_square(&self.weighted(state, block, number))
        };
        others.map(square).sum::<f64>().sqrt()
    }

    /// Log prior of the process in a block: twice its standard deviation is what a sound rig and
    /// the forms of the effects may leave; of an unknown any amplitude is as probable.
    fn log_process_prior(
        &self,
        block: usize,
        at: usize,
        set: &[usize],
        problem: &Problem,
        weights: &[f64],
        unknown: Blocks,
    ) -> f64 {
        let grid = &self.blocks[block].whitened;
        if unknown & (1 << block) != 0 {
            return -(grid.len() as f64).ln();
        }
        let left = 1.0 + self.form_error(set, (problem, weights), block, None);
        let log = |amplitude: f64| -0.5 * (2.0 * amplitude / left).powi(2);
        let sum: f64 = grid.iter().map(|own| log(own.amplitude).exp()).sum();
        log(grid[at].amplitude) - sum.ln()
    }

    /// Whether each effect has its sign, and does something in a block that neither a sound rig,
    /// nor nominal values, nor the other effects or errors of their forms do.
    fn is_admissible(&self, set: &[usize], problem: &Problem, weights: &[f64]) -> bool {
        let sound = |(number, effect): (usize, &usize)| {
            let effect = &self.effects[*effect];
            let own = &weights[problem.ranges[number].clone()];
            let along: f64 = effect.mean.iter().zip(own).map(|(m, w)| m * w).sum();
            if !effect.signed && along <= 0.0 {
                return false;
            }
            (0..self.blocks.len()).any(|block| {
                let own = self.weighted((problem, weights), block, number);
                let others = problem.places[block].iter();
                let others = others.filter(|(at, _)| !problem.ranges[number].contains(at));
                let others: Vec<(usize, f64)> = others
                    .map(|(at, place)| (*place, problem.precisions[*at]))
                    .collect();
                let size = self.blocks[block].mean_square_beyond(&own, &others).sqrt();
                size > 1.0 + self.form_error(set, (problem, weights), block, Some(number))
            })
        };
        set.iter().enumerate().all(sound)
    }

    /// The most probable state of a set over the sizes of its effects; `None` if in none of them
    /// each effect has its sign and shows.
    pub fn solve(&self, set: &[usize], unknown: Blocks) -> Option<State> {
        let mut sizes = vec![SIZES[SIZES.len() / 2]; set.len()];
        // Blocks of which nothing is explained yet must not pull weights that they share.
        let mut grid: Vec<usize> = self
            .blocks
            .iter()
            .map(|block| block.whitened.len() - 1)
            .collect();
        if set.is_empty() {
            return Some(self.state(set, &sizes, unknown, grid)?.0);
        }
        let mut best: Option<State> = None;
        for _ in 0..PASSES {
            let before = sizes.clone();
            for place in 0..set.len() {
                for size in SIZES {
                    let mut tried = sizes.clone();
                    tried[place] = size;
                    let Some((state, found)) = self.state(set, &tried, unknown, grid.clone())
                    else {
                        continue;
                    };
                    if best
                        .as_ref()
                        .is_none_or(|b| state.log_evidence > b.log_evidence)
                    {
                        (best, sizes, grid) = (Some(state), tried, found);
                    }
                }
            }
            if sizes == before {
                break;
            }
        }
        best
    }

    fn log_prior(&self, set: &[usize], unknown: Blocks) -> f64 {
        let effects = self.effects.len() as f64;
        let sets = (0..set.len()).map(|n| (effects - n as f64) / (n + 1) as f64);
        let unknown = match unknown {
            0 => 1.0 - UNKNOWN_PRIOR,
            _ => UNKNOWN_PRIOR / self.blocks.len() as f64,
        };
        (SET_PRIOR[set.len()] * unknown / sets.product::<f64>()).ln()
    }

    /// The probabilities of hypotheses, the most probable first: of no effect, each effect alone,
    /// and those pairs and triples that contain a leading smaller set; each without an unknown and
    /// with one in each block. `None` if there is no state at all.
    ///
    /// `beside` is the evidence with the columns as they are beside an effect that is there
    /// already: sets of several effects that contain it are judged by the best of these.
    pub fn posterior(&self, beside: &[(usize, Evidence)]) -> Option<Vec<Hypothesis>> {
        let mut scores: BTreeMap<(Vec<usize>, Blocks), f64> = BTreeMap::new();
        let mut sets = vec![Vec::new()];
        for size in 0..SET_PRIOR.len() {
            let unknown = || std::iter::once(0).chain((0..self.blocks.len()).map(|b| 1 << b));
            let keys = sets.iter();
            let keys: Vec<(Vec<usize>, Blocks)> = keys
                .flat_map(|set: &Vec<usize>| unknown().map(move |u| (set.clone(), u)))
                .collect();
            let score = |(set, unknown): (Vec<usize>, Blocks)| {
                let own = beside
                    .iter()
                    .filter(|own| set.len() > 1 && set.contains(&own.0));
                let own: Vec<&Evidence> = own.map(|own| &own.1).collect();
                let all = if own.is_empty() { vec![self] } else { own };
                let states = all.into_iter().filter_map(|own| own.solve(&set, unknown));
                let log_evidence = states.map(|own| own.log_evidence).reduce(f64::max)?;
                let score = log_evidence + self.log_prior(&set, unknown);
                Some(((set, unknown), score))
            };
            let found: Vec<_> = keys.into_par_iter().filter_map(score).collect();
            scores.extend(found);
            let leading = match size {
                0 => usize::MAX,
                _ => LEADING.get(size - 1).copied().unwrap_or(0),
            };
            sets = self.larger(&leaders(&scores, size, leading));
        }
        let most = scores.values().copied().reduce(f64::max)?;
        let sum: f64 = scores.values().map(|score| (score - most).exp()).sum();
        let mut posterior: Vec<Hypothesis> = scores
            .into_iter()
            .map(|((effects, unknown), score)| Hypothesis {
                effects,
                unknown,
                probability: (score - most).exp() / sum,
            })
            .collect();
        posterior.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        Some(posterior)
    }

    /// The sets with one effect more than one of `sets`.
    fn larger(&self, sets: &[Vec<usize>]) -> Vec<Vec<usize>> {
        let mut larger = Vec::new();
        for set in sets {
            for effect in (0..self.effects.len()).filter(|effect| !set.contains(effect)) {
                let mut own = set.clone();
                own.push(effect);
                own.sort_unstable();
                larger.push(own);
            }
        }
        larger.sort();
        larger.dedup();
        larger
    }
}

/// The sets of a size with the best scores, with or without an unknown.
fn leaders(
    scores: &BTreeMap<(Vec<usize>, Blocks), f64>,
    size: usize,
    count: usize,
) -> Vec<Vec<usize>> {
    let mut best: BTreeMap<&Vec<usize>, f64> = BTreeMap::new();
    for ((set, _), score) in scores.iter().filter(|((set, _), _)| set.len() == size) {
        let own = best.entry(set).or_insert(f64::NEG_INFINITY);
        *own = own.max(*score);
    }
    let mut best: Vec<(&Vec<usize>, f64)> = best.into_iter().collect();
    best.sort_by(|a, b| b.1.total_cmp(&a.1));
    best.into_iter()
        .take(count)
        .map(|(set, _)| set.clone())
        .collect()
}

#[cfg(test)]
mod tests;

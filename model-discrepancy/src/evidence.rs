//! Log evidence of residuals that are linear in weights with Gaussian priors.
//!
//! What no column explains is white noise and, in each block, an Ornstein–Uhlenbeck process in time
//! whose amplitude and time constant are unknown. A rig that has the effects of a hypothesis leaves
//! little of this process: a base, and a share of the effects, as no law of a catalogue is a rig's
//! exactly. A hypothesis with an *unknown* in a block leaves any amount of it there; or
//! its nominal values are far outside their tolerances.
//!
//! For a given process the evidence is in closed form: the residuals are whitened by a scalar
//! Kalman filter, and Bayesian linear regression follows (Rasmussen & Williams 2006, sections 2.1
//! and B.2). It is summed over a grid of processes with their prior.

use super::rows::Rows;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A set of blocks, a bit for each.
pub type Blocks = u32;

/// Amplitudes of the process, in units of the base, beside 0.
const AMPLITUDES: [f64; 8] = [0.3, 0.75, 1.9, 4.7, 11.7, 29.0, 73.0, 183.0];
/// Time constants of the process \[s\].
const TIME_CONSTANTS_S: [f64; 3] = [0.1, 1.0, 10.0];
/// Standard deviation of a nominal value of which the tolerance tells nothing, in those of it.
const OUTSIDE: f64 = 6.0;
/// Share of a column that rounding leaves of it.
const ROUNDING: f64 = 1e-9;
/// Times that weights at an end of their range are let go at most.
const RELEASES: usize = 8;
/// Passes over the blocks until no process changes.
const PASSES: usize = 4;

/// Prior of a weight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// Its mean, and its standard deviation.
    pub(crate) mean: f64,
    pub(crate) deviation: f64,
    /// The least and the largest value.
    pub(crate) range: (f64, f64),
}

impl Prior {
    /// Of a weight that may have any value.
    pub(crate) const fn new(mean: f64, deviation: f64) -> Prior {
        Prior {
            mean,
            deviation,
            range: (f64::NEG_INFINITY, f64::INFINITY),
        }
    }
}

/// What a hypothesis does not explain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unknown {
    /// Blocks with processes of any amplitude.
    processes: Blocks,
    /// Blocks whose nominal values are outside their tolerances.
    outside: Blocks,
}

impl Unknown {
    /// A process of any amplitude in each of these blocks.
    pub(crate) fn process(blocks: Blocks) -> Unknown {
        Unknown {
            processes: blocks,
            outside: 0,
        }
    }

    /// Whether that of a block may have any amplitude.
    fn has_process(self, block: usize) -> bool {
        self.processes & (1 << block) != 0
    }

    /// Nominal values of these blocks outside their tolerances.
    pub(crate) fn outside(blocks: Blocks) -> Unknown {
        Unknown {
            processes: 0,
            outside: blocks,
        }
    }
}

/// Evidence of a hypothesis.
pub(crate) struct Evidence {
    /// Its logarithm.
    pub(crate) log: f64,
    /// The most probable weights.
    pub(crate) weights: DVector<f64>,
    /// Beside what.
    unknown: Unknown,
    /// The most probable process of each block, by its place in the grid.
    places: Vec<usize>,
    /// The amplitude of the most probable process of each block, in bases.
    pub(crate) amplitudes: Vec<f64>,
}

/// Residuals of some blocks, linear in weights that they share.
pub(crate) struct Linear {
    blocks: Vec<Block>,
    /// Those of nominal values first.
    priors: Vec<Prior>,
    /// The blocks on which each nominal value acts.
    nominal_blocks: Vec<Blocks>,
}

/// What is left in one block, linear in weights about where these are 0.
#[derive(Clone)]
pub(crate) struct Remainder {
    pub(crate) rows: Rows,
    /// The weights' columns and the residual last, a column for each row.
    pub(crate) values: DMatrix<f64>,
    /// The RMS in bases that laws of named effects may leave.
    pub(crate) form_error: f64,
}

impl Remainder {
    /// That of the first rows.
    pub(crate) fn first(&self, count: usize) -> Remainder {
        Remainder {
            rows: self.rows.first(count),
            values: self.values.columns(0, count).into_owned(),
            form_error: self.form_error,
        }
    }

    /// Products of the columns, the residual last, and half the log determinant of the covariance.
    fn whitened(&self, amplitude: f64, time_constant_s: f64) -> Whitened {
        let (whitened, half_log_determinant) =
            self.rows
                .whitened(self.values.clone(), amplitude, time_constant_s);
        Whitened {
            gram: &whitened * whitened.transpose(),
            half_log_determinant: half_log_determinant + 0.5 * self.rows.left_out as f64,
        }
    }
}

/// One block, whitened for each process of the grid.
struct Block {
    whitened: Vec<Whitened>,
    /// Logarithms of the prior of each process, with a name for the block and without.
    named: Vec<f64>,
    unknown: f64,
}

struct Whitened {
    /// Products of the columns, the residual last.
    gram: DMatrix<f64>,
    half_log_determinant: f64,
}

impl Whitened {
    fn log_density(&self, weights: &DVector<f64>) -> f64 {
        let with_residual = weights.clone().push(1.0);
        let square = (&self.gram * &with_residual).dot(&with_residual);
        -0.5 * square - self.half_log_determinant
    }
}

/// The normal equations of some blocks.
#[derive(Clone)]
struct Normal {
    matrix: DMatrix<f64>,
    vector: DVector<f64>,
    square: f64,
    half_log_determinant: f64,
}

impl Normal {
    fn add(&mut self, whitened: &Whitened) {
        let gram = &whitened.gram;
        let size = self.vector.len();
        self.matrix += gram.view((0, 0), (size, size));
        self.vector -= gram.view((0, size), (size, 1));
        self.square += gram[(size, size)];
        self.half_log_determinant += whitened.half_log_determinant;
    }

    /// Log density at `weights`, but for the prior's normalization.
    fn log_density(&self, weights: &DVector<f64>) -> f64 {
        let square =
            self.square - 2.0 * self.vector.dot(weights) + (&self.matrix * weights).dot(weights);
        -0.5 * square - self.half_log_determinant
    }

    /// Log evidence, but for the prior's normalization, and the most probable weights in the range
    /// of their `priors`: a Gaussian about these.
    fn solved(&self, priors: &[Prior]) -> Option<(f64, DVector<f64>)> {
        let factor = Cholesky::new(self.matrix.clone())?;
        let open = (0..priors.len()).collect();
        let weights = self.in_range(factor.solve(&self.vector), open, priors)?;
        let half_log: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        let log = self.log_density(&weights) - half_log;
        log.is_finite().then_some((log, weights))
    }

    /// The most probable weights in the range of their `priors`, of which `weights` have those that
    /// are `open` where they are most probable anywhere: those that are beyond it are held at its
    /// end, and the others solved for again; what has been held for others, and would be within
    /// now, is let go.
    fn in_range(
        &self,
        mut weights: DVector<f64>,
        open: Vec<usize>,
        priors: &[Prior],
    ) -> Option<DVector<f64>> {
        let (mut free, mut held) = (open, Vec::new());
        for _ in 0..RELEASES {
            loop {
                let is_in = |place: &usize| {
                    let (least, most) = priors[*place].range;
                    (least..=most).contains(&weights[*place])
                };
                let (within, beyond): (Vec<usize>, Vec<usize>) = free.into_iter().partition(is_in);
                free = within;
                if beyond.is_empty() {
                    break;
                }
                for place in &beyond {
                    let (least, most) = priors[*place].range;
                    weights[*place] = weights[*place].clamp(least, most);
                }
                held.extend(beyond);
                weights = self.beside(weights, &free)?;
            }
            let pull = &self.vector - &self.matrix * &weights;
            let is_inward = |place: &usize| {
                let (least, most) = priors[*place].range;
                let pull = pull[*place];
                least < most
                    && if weights[*place] >= most {
                        pull < 0.0
                    } else {
                        pull > 0.0
                    }
            };
            let (freed, kept): (Vec<usize>, Vec<usize>) = held.into_iter().partition(is_inward);
            held = kept;
            if freed.is_empty() {
                break;
            }
            free.extend(freed);
            weights = self.beside(weights, &free)?;
        }
        for place in free {
            let (least, most) = priors[place].range;
            weights[place] = weights[place].clamp(least, most);
        }
        Some(weights)
    }

    /// `weights` with those that are `open` where they are most probable beside the others.
    fn beside(&self, mut weights: DVector<f64>, open: &[usize]) -> Option<DVector<f64>> {
        for place in open {
            weights[*place] = 0.0;
        }
        let rest = (&self.vector - &self.matrix * &weights).select_rows(open);
        let matrix = self.matrix.select_rows(open).select_columns(open);
        let solved = Cholesky::new(matrix)?.solve(&rest);
        for (place, value) in open.iter().zip(&solved) {
            weights[*place] = *value;
        }
        Some(weights)
    }

    /// The same, with weights drawn to `weights` so many times as strongly as the data and the
    /// prior hold each of them by itself.
    fn damped(mut self, damping: f64, weights: &DVector<f64>) -> Normal {
        let pull = damping * self.matrix.diagonal();
        self.vector += pull.component_mul(weights);
        self.matrix += DMatrix::from_diagonal(&pull);
        self
    }
}

/// Logarithm of a sum of exponentials.
pub(crate) fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return most;
    }
    most + logs.map(|log| (log - most).exp()).sum::<f64>().ln()
}

/// The grid of processes: amplitude, time constant.
fn grid() -> impl Iterator<Item = (f64, f64)> + Clone {
    let with_times = AMPLITUDES
        .into_iter()
        .flat_map(|amplitude| TIME_CONSTANTS_S.into_iter().map(move |s| (amplitude, s)));
    std::iter::once((0.0, 1.0)).chain(with_times)
}

impl Linear {
    /// Of what is left in each block. The first weights are those of nominal values, which act on
    /// `nominal_blocks`.
    pub(crate) fn new<'a>(
        blocks: impl Iterator<Item = &'a Remainder>,
        priors: Vec<Prior>,
        nominal_blocks: Vec<Blocks>,
    ) -> Linear {
        let block = |own: &Remainder| {
            let whitened =
                grid().map(|(amplitude, time_constant_s)| own.whitened(amplitude, time_constant_s));
            // Half-normal in the amplitude; its deviation is what may be left.
            let left = 1.0 + own.form_error;
            let log = |amplitude: f64| -0.5 * (amplitude / left).powi(2);
            let logs = grid().map(|(amplitude, _)| log(amplitude));
            let sum = log_sum(logs.clone());
            Block {
                whitened: whitened.collect(),
                named: logs.map(|log| log - sum).collect(),
                unknown: -(grid().count() as f64).ln(),
            }
        };
        Linear {
            blocks: blocks.map(block).collect(),
            priors,
            nominal_blocks,
        }
    }

    /// The prior, with nominal values outside their tolerances if they act on some blocks.
    fn prior(&self, outside: Blocks) -> Normal {
        let deviations = self.priors.iter().enumerate().map(|(place, prior)| {
            let blocks = self.nominal_blocks.get(place).copied().unwrap_or(0);
            let factor = if blocks & outside != 0 { OUTSIDE } else { 1.0 };
            factor * prior.deviation
        });
        let precisions = deviations.map(|deviation| deviation.powi(-2));
        let precisions = DVector::from_iterator(self.priors.len(), precisions);
        let means = self.priors.iter().map(|prior| prior.mean);
        let means = DVector::from_iterator(self.priors.len(), means);
        let vector = precisions.component_mul(&means);
        Normal {
            square: vector.dot(&means),
            matrix: DMatrix::from_diagonal(&precisions),
            half_log_determinant: -0.5 * precisions.iter().map(|p| p.ln()).sum::<f64>(),
            vector,
        }
    }

    /// The weights' priors.
    pub(crate) fn priors(&self) -> &[Prior] {
        &self.priors
    }

    /// How many weights there are.
    pub(crate) fn weights(&self) -> usize {
        self.priors.len()
    }

    /// Log density of the residuals at `weights`, by the same measure as the evidence.
    pub(crate) fn log_density(&self, unknown: Unknown, weights: &DVector<f64>) -> f64 {
        let blocks = self.blocks.iter().enumerate().map(|(number, block)| {
            log_sum(block.log_densities(unknown.has_process(number), weights))
        });
        self.prior(unknown.outside).log_density(weights) + blocks.sum::<f64>()
    }

    /// The normal equations with the most probable process.
    fn normal(&self, evidence: &Evidence) -> Normal {
        self.normal_of(evidence.unknown, &evidence.places)
    }

    /// The normal equations with a process for each block.
    fn normal_of(&self, unknown: Unknown, places: &[usize]) -> Normal {
        let mut normal = self.prior(unknown.outside);
        for (block, place) in self.blocks.iter().zip(places) {
            normal.add(&block.whitened[*place]);
        }
        normal
    }

    /// Covariance of the weights, with the most probable process.
    pub(crate) fn covariance(&self, evidence: &Evidence) -> Option<DMatrix<f64>> {
        Some(Cholesky::new(self.normal(evidence).matrix)?.inverse())
    }

    /// Weights between `weights` and the most probable ones, the nearer to these the less damping
    /// (Levenberg and Marquardt's step).
    pub(crate) fn damped(
        &self,
        evidence: &Evidence,
        weights: &DVector<f64>,
        damping: f64,
    ) -> Option<DVector<f64>> {
        let normal = self.normal(evidence).damped(damping, weights);
        Some(normal.solved(&self.priors)?.1)
    }

    /// `weights` with those from `first` on where they are most probable beside the others, which
    /// are held: no less probable than they are.
    pub(crate) fn settled(
        &self,
        unknown: Unknown,
        first: usize,
        weights: &DVector<f64>,
    ) -> Option<DVector<f64>> {
        let open: Vec<usize> = (first..self.weights()).collect();
        let mut settled = weights.clone();
        let mut places = Vec::new();
        for _ in 0..PASSES {
            let before = places;
            places = self.places(unknown, &settled);
            if places == before {
                break;
            }
            let normal = self.normal_of(unknown, &places);
            settled = normal.beside(settled, &open)?;
            settled = normal.in_range(settled, open.clone(), &self.priors)?;
        }
        // About the most probable processes, of which the density has all.
        let log = |weights| self.log_density(unknown, weights);
        let is_more = log(&settled) >= log(weights);
        Some(if is_more { settled } else { weights.clone() })
    }

    /// The most probable process of each block at `weights`.
    fn places(&self, unknown: Unknown, weights: &DVector<f64>) -> Vec<usize> {
        let place = |(number, block): (usize, &Block)| {
            let logs = block.log_densities(unknown.has_process(number), weights);
            let most = logs.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
            most.map_or(0, |(place, _)| place)
        };
        self.blocks.iter().enumerate().map(place).collect()
    }

    /// What is left of `blocks`, which these are, beside the most probable weights.
    pub(crate) fn beside<'a>(
        &self,
        evidence: &Evidence,
        blocks: impl Iterator<Item = &'a Remainder>,
    ) -> Option<Beside> {
        let with_residual = evidence.weights.clone().push(1.0);
        // Those at an end of their range stay there.
        let is_open = |place: &usize| {
            let (least, most) = self.priors[*place].range;
            least < evidence.weights[*place] && evidence.weights[*place] < most
        };
        let open: Vec<usize> = (0..self.weights()).filter(is_open).collect();
        let whitened = |(own, place): (&Remainder, &usize)| {
            let process = grid().nth(*place)?;
            let (columns, _) = own.rows.whitened(own.values.clone(), process.0, process.1);
            Some(WhitenedBlock {
                remainder: own.clone(),
                process,
                residual: columns.tr_mul(&with_residual),
                columns: columns.select_rows(&open),
            })
        };
        let normal = self.normal(evidence);
        let matrix = normal.matrix.select_rows(&open).select_columns(&open);
        Some(Beside {
            blocks: blocks
                .zip(&evidence.places)
                .map(whitened)
                .collect::<Option<_>>()?,
            priors: self.priors.clone(),
            prior: self.prior(evidence.unknown.outside),
            log_density: normal.log_density(&evidence.weights),
            factor: Cholesky::new(matrix)?,
        })
    }

    /// The evidence beside an unknown.
    pub(crate) fn evidence(&self, unknown: Unknown) -> Option<Evidence> {
        let prior = self.prior(unknown.outside);
        // Blocks of which nothing is explained yet must not pull weights that they share.
        let mut places = vec![grid().count() - 1; self.blocks.len()];
        let mut best = None;
        for _ in 0..PASSES {
            let before = places.clone();
            // What the grid of each block adds to the evidence of its best place.
            let mut widths = 0.0;
            for (number, block) in self.blocks.iter().enumerate() {
                let mut others = prior.clone();
                for (other, place) in places.iter().enumerate().filter(|(n, _)| *n != number) {
                    others.add(&self.blocks[other].whitened[*place]);
                    others.half_log_determinant -=
                        self.blocks[other].log_prior(*place, unknown.has_process(other));
                }
                let solved = |place: usize| {
                    let mut normal = others.clone();
                    normal.add(&block.whitened[place]);
                    let prior = block.log_prior(place, unknown.has_process(number));
                    let (log, weights) = normal.solved(&self.priors)?;
                    Some((log + prior, place, weights))
                };
                let all = (0..block.whitened.len()).filter_map(solved);
                let all: Vec<(f64, usize, DVector<f64>)> = all.collect();
                let sum = log_sum(all.iter().map(|own| own.0));
                let (log, place, weights) = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
                widths += sum - log;
                places[number] = place;
                best = Some((log, weights));
            }
            if let Some(best) = &mut best {
                best.0 += widths;
            }
            if places == before {
                break;
            }
        }
        let (log, weights) = best?;
        let amplitudes = places.iter().filter_map(|place| grid().nth(*place));
        Some(Evidence {
            log,
            weights,
            amplitudes: amplitudes.map(|(amplitude, _)| amplitude).collect(),
            unknown,
            places,
        })
    }
}

/// What is left of some blocks beside their most probable weights and processes, for what is not
/// among these.
pub(crate) struct Beside {
    blocks: Vec<WhitenedBlock>,
    priors: Vec<Prior>,
    prior: Normal,
    /// Of the normal equations of the weights within their ranges.
    factor: Cholesky<f64, Dyn>,
    /// At the most probable weights.
    log_density: f64,
}

/// One block with its most probable process.
struct WhitenedBlock {
    remainder: Remainder,
    /// Amplitude and time constant.
    process: (f64, f64),
    /// The whitened columns of the same weights, a column for each row, and the residual.
    columns: DMatrix<f64>,
    residual: DVector<f64>,
}

impl Beside {
    /// By how much the log density grows with a weight of `columns`, the rows of each block, that
    /// has no prior, and the weight; all others move with it.
    pub(crate) fn gain(&self, columns: impl Iterator<Item = Vec<f64>>) -> (f64, f64) {
        let (mut square, mut pull) = (0.0, 0.0);
        let mut shared = DVector::zeros(self.factor.l_dirty().nrows());
        for (block, column) in self.blocks.iter().zip(columns) {
            let column = DMatrix::from_row_slice(1, column.len(), &column);
            let (amplitude, time_constant_s) = block.process;
            let rows = &block.remainder.rows;
            let (whitened, _) = rows.whitened(column, amplitude, time_constant_s);
            let own = whitened.row(0).transpose();
            square += own.norm_squared();
            pull -= own.dot(&block.residual);
            shared += &block.columns * own;
        }
        let alone = square - shared.dot(&self.factor.solve(&shared));
        // What the others do as well has no way of its own but rounding.
        if alone <= ROUNDING * square {
            return (0.0, 0.0);
        }
        (0.5 * pull * pull / alone, pull / alone)
    }

    /// By how much the log density grows if residuals and their deviations are these in the rows of
    /// each block, and all weights move.
    pub(crate) fn gain_of(&self, rows: impl Iterator<Item = (Vec<f64>, Vec<f64>)>) -> Option<f64> {
        let mut normal = self.prior.clone();
        for (block, (residual, deviation)) in self.blocks.iter().zip(rows) {
            let mut remainder = block.remainder.clone();
            let last = remainder.values.nrows() - 1;
            let residual = DVector::from_vec(residual).transpose();
            remainder.values.set_row(last, &residual);
            remainder.rows.deviation = deviation;
            normal.add(&remainder.whitened(block.process.0, block.process.1));
        }
        let (_, weights) = normal.solved(&self.priors)?;
        Some(normal.log_density(&weights) - self.log_density)
    }
}

impl Block {
    /// Log density at `weights` with each process of the grid, times its prior.
    fn log_densities(
        &self,
        unknown: bool,
        weights: &DVector<f64>,
    ) -> impl Iterator<Item = f64> + Clone {
        let processes = self.whitened.iter().enumerate();
        processes.map(move |(place, whitened)| {
            whitened.log_density(weights) + self.log_prior(place, unknown)
        })
    }

    fn log_prior(&self, place: usize, unknown: bool) -> f64 {
        if unknown {
            self.unknown
        } else {
            self.named[place]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 40;
    const DAMPING_PER_S: f64 = 0.7;

    /// Two records of the same length, of which one row has no part in the process.
    fn rows() -> Rows {
        let half = COUNT / 2;
        Rows {
            time_s: (0..COUNT).map(|row| 0.02 * (row % half) as f64).collect(),
            begins: (0..COUNT).map(|row| row % half == 0).collect(),
            deviation: (0..COUNT).map(|row| 1.0 + 0.1 * (row % 3) as f64).collect(),
            base: (0..COUNT)
                .map(|row| if row == 7 { 0.0 } else { 0.3 })
                .collect(),
            left_out: 0,
        }
    }

    fn wave(frequency: f64) -> impl Fn(usize) -> f64 {
        move |row| (frequency * row as f64 + DAMPING_PER_S).sin()
    }

    /// Log density of the residuals from their covariance.
    fn log_density(amplitude: f64, time_constant_s: f64, priors: &[Prior]) -> f64 {
        let rows = rows();
        let columns = [wave(0.3), wave(1.1)];
        let covariance = DMatrix::from_fn(COUNT, COUNT, |i, j| {
            let is_same_record = (i < COUNT / 2) == (j < COUNT / 2);
            let passed_s = (rows.time_s[i] - rows.time_s[j]).abs();
            let process = if is_same_record {
                let decay = (-passed_s / time_constant_s).exp();
                rows.base[i] * rows.base[j] * amplitude * amplitude * decay
            } else {
                0.0
            };
            let white = if i == j {
                rows.deviation[i].powi(2)
            } else {
                0.0
            };
            let pairs = columns.iter().zip(priors);
            let weighted = pairs.map(|(c, p)| c(i) * c(j) * p.deviation * p.deviation);
            white + process + weighted.sum::<f64>()
        });
        let mean = |row: usize| {
            let pairs = columns.iter().zip(priors);
            pairs.map(|(c, p)| c(row) * p.mean).sum::<f64>()
        };
        let residual = DVector::from_fn(COUNT, |row, _| wave(0.9)(row) * 3.0 + mean(row));
        let factor = Cholesky::new(covariance).expect("positive");
        let half_log: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        -0.5 * factor.solve(&residual).dot(&residual) - half_log
    }

    #[test]
    fn what_is_settled_is_most_probable_beside_what_is_held() {
        let linear = linear(&[Prior::new(0.0, 1.0), Prior::new(0.0, 2.0)], 0.0);
        let unknown = Unknown::process(1);
        let begin = DVector::from_vec(vec![0.7, -5.0]);
        let settled = linear.settled(unknown, 1, &begin).expect("weights");
        assert_eq!(settled[0], 0.7);
        let log = |second: f64| linear.log_density(unknown, &DVector::from_vec(vec![0.7, second]));
        let most = log(settled[1]);
        assert!(most > log(begin[1]));
        // Each process has a most probable weight of its own: the sum over all has it nearby.
        for away in [-0.5, 0.5] {
            assert!(most > log(settled[1] + away), "{away}");
        }
    }

    fn linear(priors: &[Prior], form_error: f64) -> Linear {
        let (one, other, residual) = (wave(0.3), wave(1.1), wave(0.9));
        let values = DMatrix::from_fn(3, COUNT, |place, row| match place {
            0 => one(row),
            1 => other(row),
            _ => 3.0 * residual(row),
        });
        let remainder = Remainder {
            rows: rows(),
            values,
            form_error,
        };
        Linear::new([&remainder].into_iter(), priors.to_vec(), vec![1])
    }

    /// A weight that is held for what another would do, which is held too, is within its range
    /// beside that one's end.
    #[test]
    fn what_was_held_for_others_is_let_go() {
        let matrix = DMatrix::from_row_slice(2, 2, &[1.0, 0.9, 0.9, 1.0]);
        let most_probable = DVector::from_vec(vec![3.0, -1.5]);
        let normal = Normal {
            vector: &matrix * &most_probable,
            matrix,
            square: 0.0,
            half_log_determinant: 0.0,
        };
        let prior = Prior {
            range: (-1.0, 1.0),
            ..Prior::new(0.0, 1.0)
        };
        let found = normal.in_range(most_probable, vec![0, 1], &[prior; 2]);
        let found = found.expect("weights");
        assert!((found[0] - 1.0).abs() < 1e-12 && (found[1] - 0.3).abs() < 1e-12);
    }

    const PRIORS: [Prior; 2] = [Prior::new(0.4, 1.0), Prior::new(-2.0, 5.0)];

    /// The evidence is the density of the residuals from their covariance, summed over processes
    /// with their prior: half-normal in the amplitude, or uniform where something is unknown.
    #[test]
    fn evidence_is_the_density_of_the_residuals() {
        let form_error = 2.0;
        let linear = linear(&PRIORS, form_error);
        let half_normal = |amplitude: f64| -0.5 * (amplitude / (1.0 + form_error)).powi(2);
        let named = grid().map(|(amplitude, _)| half_normal(amplitude));
        let normalization = log_sum(named);
        let densities = |priors: &[Prior]| -> Vec<f64> {
            grid().map(|(a, s)| log_density(a, s, priors)).collect()
        };
        let named = |densities: &[f64]| {
            let logs = grid().zip(densities);
            log_sum(logs.map(|((a, _), log)| log + half_normal(a) - normalization))
        };
        let own = densities(&PRIORS);
        let found = linear.evidence(Unknown::process(0)).expect("a density").log;
        assert!((found - named(&own)).abs() < 1e-8, "{found}");
        let count = grid().count() as f64;
        let process = log_sum(own.iter().map(|log| log - count.ln()));
        let outside = Prior {
            deviation: OUTSIDE * PRIORS[0].deviation,
            ..PRIORS[0]
        };
        let outside = named(&densities(&[outside, PRIORS[1]]));
        for (unknown, expected) in [
            (Unknown::process(1), process),
            (Unknown::outside(1), outside),
        ] {
            let found = linear.evidence(unknown).expect("a density").log;
            assert!((found - expected).abs() < 1e-8, "{found}, {expected}");
        }
    }

    /// Residuals of two blocks that share no weight are independent.
    #[test]
    fn blocks_without_common_weights_add_up() {
        let none = Unknown::process(0);
        let own = linear(&PRIORS, 0.0).evidence(none).expect("a density").log;
        let (one, other, residual) = (wave(0.3), wave(1.1), wave(0.9));
        let block = |first: usize| {
            let values = DMatrix::from_fn(5, COUNT, |place, row| match place {
                4 => 3.0 * residual(row),
                place if place == first => one(row),
                place if place == first + 2 => other(row),
                _ => 0.0,
            });
            Remainder {
                rows: rows(),
                values,
                form_error: 0.0,
            }
        };
        let priors = [PRIORS[0], PRIORS[0], PRIORS[1], PRIORS[1]];
        let blocks = [block(0), block(1)];
        let both = Linear::new(blocks.iter(), priors.to_vec(), vec![1, 2]);
        let both = both.evidence(none).expect("a density").log;
        assert!((both - 2.0 * own).abs() < 1e-8, "{both}, {own}");
    }

    /// What a column promises beside others is what the log density grows by with that among them;
    /// and what is off in residuals and dead zones is what it falls by.
    #[test]
    fn what_is_beside_counts_as_if_it_was_among_the_weights() {
        let none = Unknown::process(0);
        let (one, other, more, residual) = (wave(0.3), wave(1.1), wave(0.55), wave(0.9));
        let remainder = |columns: usize, share: f64, wider: f64| {
            let values = DMatrix::from_fn(columns + 1, COUNT, |place, row| match place {
                place if place == columns => 3.0 * residual(row) + share * more(row),
                0 => one(row),
                1 => other(row),
                _ => more(row),
            });
            let mut rows = rows();
            rows.deviation.iter_mut().for_each(|own| *own += wider);
            Remainder {
                rows,
                values,
                form_error: 0.0,
            }
        };
        let of = |remainder: &Remainder, priors: &[Prior]| {
            Linear::new([remainder].into_iter(), priors.to_vec(), vec![1])
        };
        // Also with a weight that is held at the end of its range, far from where it would be.
        let held = Prior {
            range: (f64::NEG_INFINITY, -20.0),
            ..PRIORS[0]
        };
        for priors in [PRIORS, [held, PRIORS[1]]] {
            let base = remainder(2, 5.0, 0.0);
            let linear = of(&base, &priors);
            let evidence = linear.evidence(none).expect("a density");
            let beside = linear
                .beside(&evidence, [&base].into_iter())
                .expect("equations");
            // With the most probable process, at the most probable weights.
            let density = |linear: &Linear| {
                let normal = linear.normal(&evidence);
                let (_, weights) = normal.solved(&linear.priors).expect("weights");
                (normal.log_density(&weights), weights)
            };
            let alone = density(&linear).0;
            let (gain, weight) = beside.gain([(0..COUNT).map(&more).collect()].into_iter());
            let any = [priors[0], priors[1], Prior::new(0.0, 1e6)];
            let (among, weights) = density(&of(&remainder(3, 5.0, 0.0), &any));
            // The prior's own density was left out.
            let expected = among - alone + 1e6_f64.ln();
            assert!(
                gain > 1.0 && (gain - expected).abs() < 1e-6,
                "{gain}, {expected}"
            );
            assert!((weight - weights[2]).abs() < 1e-6, "{weight}, {weights}");
            let off = remainder(2, 5.7, 0.2);
            let rows = (
                off.values.row(2).iter().copied().collect(),
                off.rows.deviation.clone(),
            );
            let found = beside.gain_of([rows].into_iter()).expect("a density");
            let expected = density(&of(&off, &priors)).0 - alone;
            assert!((found - expected).abs() < 1e-9, "{found}, {expected}");
        }
    }

    /// A weight that the data want beyond its range is held there, and the others follow: the
    /// evidence is that of a Gaussian about this place.
    #[test]
    fn weights_stay_in_their_range() {
        let none = Unknown::process(0);
        let anywhere = linear(&PRIORS, 0.0);
        let free = anywhere.evidence(none).expect("a density");
        let most = free.weights[0] - 0.2;
        let held = Prior {
            range: (f64::NEG_INFINITY, most),
            ..PRIORS[0]
        };
        let held = linear(&[held, PRIORS[1]], 0.0)
            .evidence(none)
            .expect("a density");
        assert_eq!(held.weights[0], most);
        let density =
            |other: f64| anywhere.log_density(none, &DVector::from_vec(vec![most, other]));
        let best = density(held.weights[1]);
        assert!(best > density(held.weights[1] + 1e-2) && best > density(held.weights[1] - 1e-2));
        assert!(held.log < free.log, "{}, {}", held.log, free.log);
    }
}

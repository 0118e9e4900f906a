//! Least squares with dead zones and outliers.
//!
//! Where a weight rests, static friction takes up any force to its limit: the residual is only what
//! lies outside. A Gauss–Newton step knows nothing of rows that are inside and would be outside
//! after it, so that a minimizer of smooth problems creeps: hundreds of evaluations, unfinished,
//! were seen. Here only the model is linearized; dead zones and Huber's loss stay as they are, and
//! the convex problem that this makes is solved to its end at each step, which costs no evaluation
//! of the model (prox-linear method: Lewis & Wright 2016; damping: Marquardt 1963).

use nalgebra::{DMatrix, DVector};

/// Residuals beyond this many standard deviations count less.
pub const OUTLIER: f64 = 4.0;
/// Noise that is expected beyond the edge of a dead zone, in standard deviations.
const EDGE: f64 = 3.0;
/// Iterations that the convex problem may take, and the decrease below which it ends: at all, and
/// of the whole so far.
const INNER: usize = 60;
const INNER_COST: f64 = 1e-4;
const INNER_SHARE: f64 = 1e-3;
/// The same where nothing may be left.
const EXACT_COST: f64 = 1e-14;
/// Change of a single coordinate below which it is where the cost is least.
const EXACT_STEP: f64 = 1e-12;
/// Points of a line search, and the share of the first slope that is left where it ends.
const SEARCH: usize = 30;
const LEVEL: f64 = 0.05;
/// Corrected slopes serve so often in a row, while the cost falls as they promise.
const REUSES: usize = 5;
/// Damping of a coordinate that is held: far above any curvature.
const HELD: f64 = 1e15;
/// Damping at the start, at its least, and where a fit is given up.
const DAMPING: [f64; 3] = [1e-4, 1e-9, 1e6];

/// Residuals with their dead zones: a value within ± its slack is none.
#[derive(Clone, Debug, Default)]
pub struct Residuals {
    /// The values, in units of their noise.
    pub values: Vec<f64>,
    /// The slacks, not negative, as many.
    pub slack: Vec<f64>,
}

impl Residuals {
    /// Values without slack.
    pub fn exact(values: Vec<f64>) -> Residuals {
        let slack = vec![0.0; values.len()];
        Residuals { values, slack }
    }

    /// What of each value lies outside its slack.
    pub fn outside(&self) -> impl Iterator<Item = f64> {
        let pairs = self.values.iter().zip(&self.slack);
        pairs.map(|(value, slack)| outside(*value, *slack))
    }

    /// Whether all are numbers.
    pub fn finite(&self) -> bool {
        let mut all = self.values.iter().chain(&self.slack);
        all.all(|value| value.is_finite())
    }

    /// With dead zones that noise at their edges does not push out. What lies beyond an edge by
    /// noise alone asks for a wider zone, where nothing inside asks for a narrower one: by 0.4 of
    /// the noise a row at the edge, on average, by 0.0004 of what is left with `EDGE` about it. A
    /// slack within the noise has a share of that, and none has none.
    pub fn edged(mut self) -> Residuals {
        for slack in &mut self.slack {
            *slack += EDGE * *slack / (1.0 + *slack);
        }
        self
    }

    /// Adds those of another piece.
    pub fn extend(&mut self, other: Residuals) {
        self.values.extend(other.values);
        self.slack.extend(other.slack);
    }
}

fn outside(value: f64, slack: f64) -> f64 {
    (value.abs() - slack.max(0.0)).max(0.0).copysign(value)
}

/// By how much what lies `outside` a dead zone grows with its `slack`: what is above falls as that
/// grows, if there is one.
fn of_slack(outside: f64, slack: f64) -> f64 {
    if slack < 0.0 { 0.0 } else { -outside.signum() }
}

/// What lies outside, and the slope of that, a share of a way on, along which a value and its slack
/// change.
fn beyond((value, slack): (f64, f64), (along, widening): (f64, f64), share: f64) -> (f64, f64) {
    let slack = slack + share * widening;
    let outside = outside(value + share * along, slack);
    (outside, along + of_slack(outside, slack) * widening)
}

/// Weight of a residual in a weighted sum of squares that touches the loss where it is.
fn weight(residual: f64) -> f64 {
    (OUTLIER / residual.abs()).min(1.0)
}

/// Huber's loss: half the square, growing like the residual itself beyond some noises, so that the
/// few moments that a block does not see right do not rule the fit.
pub fn loss(residual: f64) -> f64 {
    let size = residual.abs();
    if size <= OUTLIER {
        0.5 * size * size
    } else {
        OUTLIER * (size - 0.5 * OUTLIER)
    }
}

/// What a dead zone of so many standard deviations takes of half the square of the noise, 0.5, on
/// average: all but (1 + s²) Q(s) − s φ(s) for a normal one, here to 0.003.
pub fn hidden(slack: f64) -> f64 {
    let slack = slack.max(0.0);
    0.5 - 0.5 * (-1.596 * slack - 0.27 * slack * slack).exp()
}

/// How residuals change with coordinates: rows by coordinates, of values and of slacks.
#[derive(Clone, Debug)]
pub struct Slopes {
    /// Of the values.
    pub values: DMatrix<f64>,
    /// Of the slacks.
    pub slack: DMatrix<f64>,
}

impl Slopes {
    /// Of values without slack: difference quotients about `x`, where the residuals are
    /// `residuals`, with a step for each value of a coordinate. `None` where `moved_to` has none.
    pub fn by_differences(
        x: &DVector<f64>,
        residuals: &Residuals,
        step: impl Fn(f64) -> f64,
        mut moved_to: impl FnMut(&DVector<f64>) -> Option<Residuals>,
    ) -> Option<Slopes> {
        let rows = residuals.values.len();
        let mut values = DMatrix::zeros(rows, x.len());
        for (place, mut column) in values.column_iter_mut().enumerate() {
            let step = step(x[place]);
            let mut moved = x.clone();
            moved[place] += step;
            let moved = moved_to(&moved)?;
            let pairs = moved.values.iter().zip(&residuals.values);
            for (slope, (moved, base)) in column.iter_mut().zip(pairs) {
                *slope = (moved - base) / step;
            }
        }
        let slack = DMatrix::zeros(rows, x.len());
        Some(Slopes { values, slack })
    }

    /// What lies outside at `residuals`, and its slopes, 0 inside, by the roots of their weights:
    /// the least squares that touch the loss there.
    pub fn weighted(&self, residuals: &Residuals) -> (DVector<f64>, DMatrix<f64>) {
        let outside = DVector::from_iterator(residuals.values.len(), residuals.outside());
        let roots = outside.map(|row| weight(row).sqrt());
        let slopes = DMatrix::from_fn(self.values.nrows(), self.values.ncols(), |row, place| {
            let share = of_slack(outside[row], residuals.slack[row]);
            let slope = self.values[(row, place)] + share * self.slack[(row, place)];
            if outside[row] == 0.0 {
                0.0
            } else {
                roots[row] * slope
            }
        });
        (outside.component_mul(&roots), slopes)
    }

    /// Corrects the slopes by what the step between two points has shown (see [`broyden`]). Whether
    /// it could.
    fn correct(&mut self, from: &Found, to: &Found, scale: &DVector<f64>) -> bool {
        let step = &to.x - &from.x;
        let Some(along) = broyden(scale, &step) else {
            return false;
        };
        let correct = |slopes: &mut DMatrix<f64>, from: &[f64], to: &[f64]| {
            let moved = from.iter().zip(to).map(|(from, to)| to - from);
            let missed = DVector::from_iterator(from.len(), moved) - &*slopes * &step;
            slopes.ger(1.0, &missed, &along, 1.0);
        };
        let (from, to) = (&from.residuals, &to.residuals);
        correct(&mut self.values, &from.values, &to.values);
        correct(&mut self.slack, &from.slack, &to.slack);
        true
    }

    /// The slopes beside `more` ones.
    pub fn beside(&self, more: &Slopes) -> Slopes {
        let join = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
            let mut joined = a.clone().resize_horizontally(a.ncols() + b.ncols(), 0.0);
            joined.columns_mut(a.ncols(), b.ncols()).copy_from(b);
            joined
        };
        Slopes {
            values: join(&self.values, &more.values),
            slack: join(&self.slack, &more.slack),
        }
    }
}

/// By how much each slope changes for each unit that `step` was missed by: the least change, in
/// units of `scale`, that explains it (Broyden 1965). None where the step tells nothing.
pub(crate) fn broyden(scale: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
    let along = scale.component_mul(step);
    let along = &along / along.dot(step);
    along.iter().all(|value| value.is_finite()).then_some(along)
}

/// A prior on one coordinate: its residual, and the slope of that.
pub type Prior = (f64, f64);

/// A model, linearized, with dead zones and loss as they are.
pub struct Linearized<'a> {
    /// The residuals.
    pub residuals: &'a Residuals,
    /// Their slopes.
    pub slopes: &'a Slopes,
    /// The coordinates' priors.
    pub priors: &'a [Prior],
    /// Weights of squared steps.
    pub damping: DVector<f64>,
}

impl Linearized<'_> {
    /// The residuals after `step`.
    pub fn moved(&self, step: &DVector<f64>) -> Residuals {
        let add = |base: &[f64], slopes: &DMatrix<f64>| {
            let change = slopes * step;
            base.iter().zip(&change).map(|(a, b)| a + b).collect()
        };
        Residuals {
            values: add(&self.residuals.values, &self.slopes.values),
            slack: add(&self.residuals.slack, &self.slopes.slack),
        }
    }

    /// Cost after `step`, without damping.
    pub fn cost(&self, step: &DVector<f64>) -> f64 {
        let rows: f64 = self.moved(step).outside().map(loss).sum();
        let priors = self.priors.iter().zip(step);
        let priors = priors.map(|((residual, slope), step)| (residual + slope * step).powi(2));
        rows + 0.5 * priors.sum::<f64>()
    }

    /// Gradient and curvature of cost and damping after `step`, which brings the residuals to
    /// `moved`: the curvature of the least squares that touch the loss, or the loss's `own`.
    fn bend(
        &self,
        step: &DVector<f64>,
        moved: &Residuals,
        own: bool,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let size = step.len();
        let mut gradient = DVector::zeros(size);
        let mut curvature = DMatrix::zeros(size, size);
        let mut block = Block::new(size);
        let mut row = 0;
        while row < moved.values.len() {
            row = block.fill(moved, row, own);
            block.gather(self.slopes);
            block.add(&mut gradient, &mut curvature);
        }
        for (place, (residual, slope)) in self.priors.iter().enumerate() {
            for other in 0..place {
                curvature[(other, place)] = curvature[(place, other)];
            }
            gradient[place] +=
                slope * (residual + slope * step[place]) + self.damping[place] * step[place];
            curvature[(place, place)] += slope * slope + self.damping[place];
        }
        (gradient, curvature)
    }

    /// Slope of cost and damping along `direction`, a share of it after `step`, which brings the
    /// residuals to `moved`.
    fn slope(
        &self,
        step: &DVector<f64>,
        moved: &Residuals,
        direction: &Direction,
        share: f64,
    ) -> f64 {
        let priors = self.priors.iter().enumerate();
        let priors = priors.map(|(place, (residual, slope))| {
            let step = step[place] + share * direction.step[place];
            let prior = slope * (residual + slope * step);
            (prior + self.damping[place] * step) * direction.step[place]
        });
        let priors: f64 = priors.sum();
        let (values, slack) = (&moved.values[..], &moved.slack[..]);
        let (along, widening) = (direction.values.as_slice(), direction.slack.as_slice());
        // As `beyond`, without branches.
        let of_row = |row: usize| {
            let slack = slack[row] + share * widening[row];
            let widening = if slack < 0.0 { 0.0 } else { widening[row] };
            let value = values[row] + share * along[row];
            let size = (value.abs() - slack.max(0.0)).clamp(0.0, OUTLIER);
            size * (along[row] * 1.0_f64.copysign(value) - widening)
        };
        let rows = values.len().min(slack.len());
        let rows = rows.min(along.len()).min(widening.len());
        let mut sums = [0.0; 2];
        for pair in 0..rows / 2 {
            sums = [sums[0] + of_row(2 * pair), sums[1] + of_row(2 * pair + 1)];
        }
        let last = if rows % 2 == 0 { 0.0 } else { of_row(rows - 1) };
        sums[0] + sums[1] + last + priors
    }

    /// The step to the minimum of cost and damping, as near as is worth it.
    pub fn minimum(&self) -> DVector<f64> {
        self.minimum_within(INNER_COST, INNER_SHARE, false)
    }

    /// The same to the last digit, for what difference quotients are taken of, and with no
    /// coordinate beyond `most` either way; each needs a prior.
    pub fn exact_minimum(&self, most: f64) -> DVector<f64> {
        if self.priors.len() == 1 {
            return DVector::from_element(1, self.minimum_of_one(most));
        }
        let exact = |rest: &Linearized| rest.minimum_within(EXACT_COST, 0.0, true);
        let none = DVector::zeros(self.priors.len());
        self.bounded(&none, |x| x.map(|x| x.clamp(-most, most)), exact)
    }

    /// The same of a single coordinate: where the slope of the cost, which grows with it, is 0, by
    /// Newton's steps within a bracket.
    fn minimum_of_one(&self, most: f64) -> f64 {
        let (mut low, mut high) = (-most, most);
        let mut place = 0.0_f64;
        for _ in 0..INNER {
            let (slope, curvature) = self.slope_of_one(place);
            if slope > 0.0 {
                high = place;
            } else {
                low = place;
            }
            let newton = (place - slope / curvature).clamp(-most, most);
            let outside = newton < low || newton > high;
            let next = if outside { 0.5 * (low + high) } else { newton };
            if !next.is_finite() || (next - place).abs() <= EXACT_STEP * (1.0 + place.abs()) {
                break;
            }
            place = next;
        }
        place
    }

    /// Slope and curvature of cost and damping at a place of the only coordinate.
    fn slope_of_one(&self, place: f64) -> (f64, f64) {
        let (residual, of_prior) = self.priors[0];
        let mut slope = of_prior * (residual + of_prior * place) + self.damping[0] * place;
        let mut curvature = of_prior * of_prior + self.damping[0];
        let rows = self.residuals.values.iter().zip(&self.residuals.slack);
        let slopes = self.slopes.values.iter().zip(&self.slopes.slack);
        for ((value, slack), (by_value, by_slack)) in rows.zip(slopes) {
            let (outside, along) = beyond((*value, *slack), (*by_value, *by_slack), place);
            if outside == 0.0 {
                continue;
            }
            slope += outside.clamp(-OUTLIER, OUTLIER) * along;
            if outside.abs() <= OUTLIER {
                curvature += along * along;
            }
        }
        (slope, curvature)
    }

    /// Until a step gains less than `cost` and this share of all that was gained. With the loss's
    /// `own` curvature, which outliers have none of: the steps are Newton's, and end.
    fn minimum_within(&self, cost: f64, share: f64, own: bool) -> DVector<f64> {
        let mut step = DVector::zeros(self.priors.len());
        let mut moved = self.residuals.clone();
        let widens = self.slopes.slack.iter().any(|slope| *slope != 0.0);
        let mut whole = 0.0;
        for _ in 0..INNER {
            let (gradient, curvature) = self.bend(&step, &moved, own);
            let Some(newton) = curvature.cholesky().map(|c| -c.solve(&gradient)) else {
                return step;
            };
            let direction = Direction {
                values: &self.slopes.values * &newton,
                slack: match widens {
                    true => &self.slopes.slack * &newton,
                    false => DVector::zeros(moved.slack.len()),
                },
                step: newton,
            };
            let fall = -gradient.dot(&direction.step);
            let length = level(fall, |part| self.slope(&step, &moved, &direction, part));
            direction.apply(length, &mut step, &mut moved);
            let fallen = fall * length.max(0.1);
            whole += fallen;
            if fallen < cost + share * whole {
                break;
            }
        }
        step
    }

    /// The step from `x` to what `minimum` finds within the range into which `back` puts a point: a
    /// coordinate that is cut stays at its bound, and the others go on without it.
    fn bounded(
        &self,
        x: &DVector<f64>,
        back: impl Fn(DVector<f64>) -> DVector<f64>,
        minimum: impl Fn(&Linearized) -> DVector<f64>,
    ) -> DVector<f64> {
        let mut cut = DVector::zeros(x.len());
        let mut damping = self.damping.clone();
        let mut held = vec![false; x.len()];
        loop {
            let priors = self.priors.iter().zip(&cut);
            let priors = priors.map(|((residual, slope), cut)| (residual + slope * cut, *slope));
            let rest = Linearized {
                residuals: &self.moved(&cut),
                slopes: self.slopes,
                priors: &priors.collect::<Vec<Prior>>(),
                damping: damping.clone(),
            };
            let free = x + &cut + minimum(&rest);
            let within = back(free.clone());
            let new = |place: &usize| !held[*place] && within[*place] != free[*place];
            let new: Vec<usize> = (0..x.len()).filter(new).collect();
            if new.is_empty() {
                return within - x;
            }
            for place in new {
                held[place] = true;
                damping[place] = HELD;
                cut[place] = within[place] - x[place];
            }
        }
    }
}

/// The share of a way, on which the cost begins to fall with the slope −`fall`, and slopes grow,
/// where little of that is left, or all of it (regula falsi, Illinois: Dowell & Jarratt 1971).
fn level(fall: f64, slope: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = ((0.0, -fall), (1.0, slope(1.0)));
    if high.1 <= LEVEL * fall {
        return 1.0;
    }
    let mut above = true;
    for _ in 0..SEARCH {
        let share = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
        let found = (share, slope(share));
        if found.1.abs() <= LEVEL * fall {
            return share;
        }
        // An end that stays twice loses weight.
        let again = above == (found.1 > 0.0);
        let weight = if again { 0.5 } else { 1.0 };
        above = found.1 > 0.0;
        if above {
            high = found;
            low.1 *= weight;
        } else {
            low = found;
            high.1 *= weight;
        }
    }
    low.0
}

/// Rows that are summed over at a time: their columns stay in the nearest memory.
const BLOCK: usize = 128;

/// Rows outside their dead zones: what is summed over for gradient and curvature.
struct Block {
    rows: Vec<usize>,
    /// What lies outside, by its weight.
    pull: [f64; BLOCK],
    /// Weight in the curvature.
    weight: [f64; BLOCK],
    /// How much of the slope of its slack a row has.
    of_slack: [f64; BLOCK],
    /// Slopes of what lies outside, a column for each coordinate.
    slopes: Vec<[f64; BLOCK]>,
}

impl Block {
    fn new(coordinates: usize) -> Block {
        Block {
            rows: Vec::with_capacity(BLOCK),
            pull: [0.0; BLOCK],
            weight: [0.0; BLOCK],
            of_slack: [0.0; BLOCK],
            slopes: vec![[0.0; BLOCK]; coordinates],
        }
    }

    /// Takes rows from `first` on until it is full, and returns the row after the last. Outliers
    /// have no curvature of the loss's `own`.
    fn fill(&mut self, residuals: &Residuals, first: usize, own: bool) -> usize {
        self.rows.clear();
        let rows = residuals.values[first..]
            .iter()
            .zip(&residuals.slack[first..]);
        let mut next = residuals.values.len();
        for (row, (value, slack)) in (first..).zip(rows) {
            let outside = outside(*value, *slack);
            if outside == 0.0 {
                continue;
            }
            let place = self.rows.len();
            if place == BLOCK {
                next = row;
                break;
            }
            let weight = weight(outside);
            self.rows.push(row);
            self.pull[place] = weight * outside;
            self.weight[place] = match own {
                true if weight < 1.0 => 0.0,
                true => 1.0,
                false => weight,
            };
            self.of_slack[place] = of_slack(outside, *slack);
        }
        // Of the last block some places are left.
        self.pull[self.rows.len()..].fill(0.0);
        self.weight[self.rows.len()..].fill(0.0);
        next
    }

    fn gather(&mut self, slopes: &Slopes) {
        let length = slopes.values.nrows().max(1);
        let columns = slopes.values.as_slice().chunks_exact(length);
        let columns = columns.zip(slopes.slack.as_slice().chunks_exact(length));
        for (own, (values, slack)) in self.slopes.iter_mut().zip(columns) {
            let rows = self.rows.iter().zip(&self.of_slack);
            for (own, (row, share)) in own.iter_mut().zip(rows) {
                *own = values[*row] + share * slack[*row];
            }
        }
    }

    /// Adds the rows to a gradient and the lower triangle of a curvature.
    fn add(&self, gradient: &mut DVector<f64>, curvature: &mut DMatrix<f64>) {
        for (place, slopes) in self.slopes.iter().enumerate() {
            gradient[place] += dot(slopes, &self.pull);
            let mut weighed = *slopes;
            for (own, weight) in weighed.iter_mut().zip(&self.weight) {
                *own *= weight;
            }
            for (other, slopes) in self.slopes[..=place].iter().enumerate() {
                curvature[(place, other)] += dot(&weighed, slopes);
            }
        }
    }
}

/// The product, summed in four places side by side, as processors do and rounding forbids them to.
fn dot(a: &[f64; BLOCK], b: &[f64; BLOCK]) -> f64 {
    let mut sums = [0.0; 4];
    for quarter in 0..BLOCK / 4 {
        let first = 4 * quarter;
        sums = [
            sums[0] + a[first] * b[first],
            sums[1] + a[first + 1] * b[first + 1],
            sums[2] + a[first + 2] * b[first + 2],
            sums[3] + a[first + 3] * b[first + 3],
        ];
    }
    sums[0] + sums[1] + sums[2] + sums[3]
}

/// A way to go, and how residuals change on it.
struct Direction {
    step: DVector<f64>,
    values: DVector<f64>,
    slack: DVector<f64>,
}

impl Direction {
    /// Goes a share of it.
    fn apply(&self, share: f64, step: &mut DVector<f64>, moved: &mut Residuals) {
        *step += share * &self.step;
        let values = moved.values.iter_mut().zip(&self.values);
        let slack = moved.slack.iter_mut().zip(&self.slack);
        for (own, change) in values.chain(slack) {
            *own += share * change;
        }
    }
}

/// When a fit ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Decrease of the cost below which it does, of the cost itself and at all.
    pub relative: f64,
    /// See above.
    pub absolute: f64,
    /// Evaluations that it may take.
    pub evaluations: usize,
    /// Ends only where slopes that were not corrected say so.
    pub certain: bool,
}

/// What is minimized.
pub trait Problem {
    /// The residuals at `x`; `None` where there are none.
    fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals>;
    /// The slopes at `x`, where the residuals are `residuals`.
    fn slopes(&mut self, x: &DVector<f64>, residuals: &Residuals) -> Option<Slopes>;
    /// The priors at `x`.
    fn priors(&self, x: &DVector<f64>) -> Vec<Prior>;
    /// `x` put back into its range.
    fn bounded(&self, x: DVector<f64>) -> DVector<f64>;
}

/// Half the sum of squares, tamed, priors included.
fn cost(residuals: &Residuals, priors: &[Prior]) -> f64 {
    let priors = priors.iter().map(|(residual, _)| 0.5 * residual * residual);
    residuals.outside().map(loss).sum::<f64>() + priors.sum::<f64>()
}

/// A point with its residuals and its cost.
pub struct Found {
    /// The point.
    pub x: DVector<f64>,
    /// Its residuals.
    pub residuals: Residuals,
    /// Its cost.
    pub cost: f64,
}

/// The point `x` of `problem`; `None` where it has no residuals.
pub fn at(problem: &mut impl Problem, x: DVector<f64>) -> Option<Found> {
    let residuals = problem.residuals(&x)?;
    let cost = cost(&residuals, &problem.priors(&x));
    Some(Found { x, residuals, cost })
}

/// The minimum of `problem` near `x`; `None` where it has no residuals there.
pub fn minimize(problem: &mut impl Problem, x: DVector<f64>, goal: Goal) -> Option<Found> {
    let mut found = at(problem, x)?;
    let mut evaluations = 1;
    let mut damping = DAMPING[0];
    let mut scale = DVector::<f64>::zeros(found.x.len());
    // Slopes with how often they have been corrected.
    let mut kept: Option<(usize, Slopes)> = None;
    while evaluations < goal.evaluations && !found.x.is_empty() {
        let known = kept.take();
        let new = || Some((0, problem.slopes(&found.x, &found.residuals)?));
        let Some((served, mut slopes)) = known.or_else(new) else {
            break;
        };
        let fresh = served == 0;
        for (place, column) in slopes.values.column_iter().enumerate() {
            scale[place] = scale[place].max(column.norm_squared());
        }
        let priors = problem.priors(&found.x);
        let enough = goal.absolute + goal.relative * found.cost;
        let before = found.cost;
        let linearized = Linearized {
            residuals: &found.residuals,
            slopes: &slopes,
            priors: &priors,
            damping: damping * &scale,
        };
        let step = linearized.bounded(&found.x, |x| problem.bounded(x), |rest| rest.minimum());
        let promised = found.cost - linearized.cost(&step);
        if promised.is_nan() || promised < 0.1 * enough || damping > DAMPING[2] {
            // Slopes that were corrected, and promise worse, are wrong.
            if fresh || !goal.certain && promised >= 0.0 {
                return Some(found);
            }
            continue;
        }
        evaluations += 1;
        let next = at(problem, &found.x + &step);
        // Where the promise is not kept, half the way may do better: behind a threshold an effect
        // does nothing, and shows no way back.
        let poor = |next: &Found| before - next.cost < 0.75 * promised;
        let half = fresh && next.as_ref().is_none_or(poor);
        let half = half.then(|| at(problem, &found.x + 0.5 * &step)).flatten();
        evaluations += usize::from(half.is_some());
        let both = [next, half].into_iter().flatten();
        let best = both.min_by(|a, b| a.cost.total_cmp(&b.cost));
        let share = |next: &Found| (before - next.cost) / promised;
        match best {
            Some(next) if share(&next) > 1e-3 => {
                let share = share(&next);
                damping *= match share {
                    0.75.. => 0.1,
                    0.25.. => 1.0,
                    _ => 4.0,
                };
                damping = damping.max(DAMPING[1]);
                let small = before - next.cost < enough;
                let good = share > 0.5 && !small && served < REUSES;
                if good && slopes.correct(&found, &next, &scale) {
                    kept = Some((served + 1, slopes));
                }
                found = next;
                if small && (fresh || !goal.certain) {
                    break;
                }
            }
            _ if !fresh => {}
            _ => {
                damping = (damping * 8.0).max(1e-3);
                kept = Some((0, slopes));
            }
        }
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line through points, each with a dead zone, and a prior of 1 on both coordinates: what
    /// a balance of forces with a friction's tube is.
    struct Line {
        rows: Vec<[f64; 3]>,
    }

    impl Line {
        fn new() -> Line {
            let row = |i: u32| {
                let z = f64::from(i) / 40.0;
                // Nearly the same along one direction, and far from it across.
                [50.0 * (1.0 + 0.01 * z), 50.0, 0.3 * (7.0 * z).sin() - 1.0]
            };
            Line {
                rows: (0..80).map(row).collect(),
            }
        }
    }

    impl Problem for Line {
        fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals> {
            let value = |row: &[f64; 3]| row[0] * x[0] + row[1] * x[1] + row[2];
            Some(Residuals {
                values: self.rows.iter().map(value).collect(),
                slack: vec![0.5; self.rows.len()],
            })
        }

        fn slopes(&mut self, _: &DVector<f64>, _: &Residuals) -> Option<Slopes> {
            let rows = self.rows.len();
            Some(Slopes {
                values: DMatrix::from_fn(rows, 2, |row, place| self.rows[row][place]),
                slack: DMatrix::zeros(rows, 2),
            })
        }

        fn priors(&self, x: &DVector<f64>) -> Vec<Prior> {
            x.iter().map(|x| (*x - 3.0, 1.0)).collect()
        }

        fn bounded(&self, x: DVector<f64>) -> DVector<f64> {
            x
        }
    }

    const GOAL: Goal = Goal {
        relative: 1e-9,
        absolute: 1e-6,
        evaluations: 20,
        certain: true,
    };

    #[test]
    fn a_dead_zone_hides_what_it_takes_of_normal_noise() {
        for slack in [0.0, 0.1, 0.3, 1.0, 2.0, 5.0] {
            let density = |z: f64| (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
            let noise = (-8000..8000).map(|i| 1e-3 * f64::from(i));
            let seen: f64 = noise
                .map(|z| 1e-3 * density(z) * 0.5 * outside(z, slack).powi(2))
                .sum();
            assert!(
                (hidden(slack) - (0.5 - seen)).abs() < 0.003,
                "{slack}: {} against {}",
                hidden(slack),
                0.5 - seen
            );
        }
    }

    /// With outliers or without: nowhere about it is less, and the cost is level there.
    #[test]
    fn an_exact_minimum_is_level() {
        for amplitude in [1.0, 40.0, 150.0, 400.0] {
            let mut line = Line::new();
            let x = DVector::zeros(2);
            let mut residuals = line.residuals(&x).expect("residuals");
            for (row, value) in residuals.values.iter_mut().enumerate() {
                *value += amplitude * (0.3 * row as f64).cos();
            }
            let slopes = line.slopes(&x, &residuals).expect("slopes");
            let linearized = Linearized {
                residuals: &residuals,
                slopes: &slopes,
                priors: &line.priors(&x),
                damping: DVector::zeros(2),
            };
            let least = linearized.exact_minimum(f64::INFINITY);
            for place in 0..2 {
                let moved = |by: f64| {
                    let mut moved = least.clone();
                    moved[place] += by;
                    linearized.cost(&moved)
                };
                let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                assert!(slope.abs() < 0.1, "{amplitude}, {place}: {slope}");
            }
        }
    }

    /// The same as with a second coordinate that does nothing, within bounds and at them.
    #[test]
    fn an_exact_minimum_of_one_coordinate_is_that_of_two() {
        let line = Line::new();
        for (amplitude, shift) in [(1.0, 0.0), (40.0, 3.0), (400.0, -20.0), (1.0, 900.0)] {
            let wave = |row: usize| amplitude * (0.3 * row as f64).cos() + shift;
            let rows = line.rows.len();
            let residuals = Residuals {
                values: (0..rows).map(wave).collect(),
                slack: (0..rows).map(|row| 0.2 * (row % 4) as f64).collect(),
            };
            let minimum = |columns: usize| {
                let of = |size: f64| move |_, place| if place == 0 { size } else { 0.0 };
                let slopes = Slopes {
                    values: DMatrix::from_fn(rows, columns, of(2.0)),
                    slack: DMatrix::from_fn(rows, columns, of(0.1)),
                };
                let linearized = Linearized {
                    residuals: &residuals,
                    slopes: &slopes,
                    priors: &vec![(0.3, 1.0); columns],
                    damping: DVector::zeros(columns),
                };
                linearized.exact_minimum(3.0)[0]
            };
            assert!(
                (minimum(1) - minimum(2)).abs() < 1e-6,
                "{amplitude}, {shift}: {} and {}",
                minimum(1),
                minimum(2)
            );
        }
    }

    /// Half of the rows lie in the middle of their zone, half at an edge, as where friction has
    /// stopped a motion; the zone's width is sought, with a prior that knows little.
    #[test]
    fn noise_at_an_edge_does_not_widen_a_dead_zone() {
        struct Zone {
            edged: bool,
        }
        impl Problem for Zone {
            fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals> {
                let normal = |i: u32| {
                    let uniform = |n: u32| (0.5 + f64::from(n)) / 1009.0;
                    let radius = (-2.0 * uniform(i).ln()).sqrt();
                    radius * (std::f64::consts::TAU * uniform(i * 313 % 1009)).cos()
                };
                // In units of the noise; what is known beside is a place at the edge.
                let values = (0..1009).map(|i| 5.0 * f64::from(i % 2) + normal(i));
                let values: Vec<f64> = values.collect();
                let zones = Residuals {
                    slack: vec![x[0]; values.len()],
                    values,
                };
                let mut all = if self.edged { zones.edged() } else { zones };
                let known = (0..300).map(|i| 5.0 - x[0] + normal(3 * i));
                all.extend(Residuals::exact(known.collect()));
                Some(all)
            }

            fn slopes(&mut self, x: &DVector<f64>, base: &Residuals) -> Option<Slopes> {
                let moved = self.residuals(&x.add_scalar(1e-4))?;
                let slope = |a: &[f64], b: &[f64]| {
                    let pairs = a.iter().zip(b);
                    DMatrix::from_iterator(a.len(), 1, pairs.map(|(a, b)| (a - b) / 1e-4))
                };
                Some(Slopes {
                    values: slope(&moved.values, &base.values),
                    slack: slope(&moved.slack, &base.slack),
                })
            }

            fn priors(&self, x: &DVector<f64>) -> Vec<Prior> {
                vec![((x[0] - 5.0) / 100.0, 0.01)]
            }

            fn bounded(&self, x: DVector<f64>) -> DVector<f64> {
                x
            }
        }
        let width = |edged: bool| {
            let start = DVector::from_element(1, 4.0);
            minimize(&mut Zone { edged }, start, GOAL)
                .expect("a minimum")
                .x[0]
        };
        assert!(width(false) > 5.2, "{}", width(false));
        assert!((width(true) - 5.0).abs() < 0.15, "{}", width(true));
    }

    #[test]
    fn a_valley_between_dead_zones_is_followed_to_its_end() {
        let mut line = Line::new();
        let start = DVector::from_vec(vec![5.0, -4.0]);
        let found = minimize(&mut line, start, GOAL).expect("a minimum");
        // The cost is convex: where no step to any side lowers it, it is least.
        for angle in 0..360 {
            let angle = f64::from(angle).to_radians();
            for length in [1e-4, 1e-3, 1e-2, 0.1] {
                let step = DVector::from_vec(vec![length * angle.cos(), length * angle.sin()]);
                let beside = at(&mut line, &found.x + step).expect("residuals");
                assert!(beside.cost > found.cost - 1e-4, "{angle} {length}");
            }
        }
    }

    /// Both coordinates would go below the bound of the first together; the clipped step would be
    /// uphill.
    #[test]
    fn beside_a_bound_the_others_go_their_own_way() {
        struct Bound;
        impl Problem for Bound {
            fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals> {
                Some(Residuals::exact(vec![x[0] - x[1]]))
            }

            fn slopes(&mut self, _: &DVector<f64>, _: &Residuals) -> Option<Slopes> {
                Some(Slopes {
                    values: DMatrix::from_row_slice(1, 2, &[1.0, -1.0]),
                    slack: DMatrix::zeros(1, 2),
                })
            }

            fn priors(&self, x: &DVector<f64>) -> Vec<Prior> {
                vec![(0.1 * (x[0] + 3.0), 0.1), (0.1 * (x[1] - 1.0), 0.1)]
            }

            fn bounded(&self, x: DVector<f64>) -> DVector<f64> {
                DVector::from_vec(vec![x[0].max(0.0), x[1]])
            }
        }
        for begin in [0.0, 1e-9, 0.5] {
            let begin = DVector::from_vec(vec![begin, 0.0]);
            let found = minimize(&mut Bound, begin, GOAL).expect("a minimum");
            assert_eq!(found.x[0], 0.0);
            assert!((found.x[1] - 1.0 / 101.0).abs() < 1e-5, "{}", found.x[1]);
        }
    }

    /// Slopes that grow evenly, with a kink, and with a jump; or never reach the level.
    #[test]
    fn a_search_ends_where_it_is_level() {
        let search = |slope: &dyn Fn(f64) -> f64| {
            let points = std::cell::Cell::new(0);
            let share = level(1.0, |share| {
                points.set(points.get() + 1);
                slope(share)
            });
            (share, points.get())
        };
        assert_eq!(search(&|x| 2.0 * x - 1.0), (0.5, 2));
        assert_eq!(search(&|x| 0.5 * x - 1.0), (1.0, 1));
        let (share, points) = search(&|x| (10.0 * x - 1.0).min(0.1 * x - 0.01 + 0.9 * x));
        assert!(
            (10.0 * share - 1.0).abs() <= LEVEL && points < 8,
            "{share} {points}"
        );
        let (share, _) = search(&|x| if x < 0.3 { -1.0 } else { 5.0 });
        assert!((share - 0.3).abs() < 0.01, "{share}");
    }

    #[test]
    fn inside_the_dead_zone_nothing_is_missed_and_outliers_count_less() {
        assert_eq!(outside(0.3, 0.5), 0.0);
        assert_eq!(outside(-0.8, 0.5), -0.8 + 0.5);
        assert_eq!(loss(2.0), 2.0);
        assert!((loss(OUTLIER + 1e-9) - loss(OUTLIER)).abs() < 1e-6);
        assert!((loss(10.0) - loss(9.0) - OUTLIER).abs() < 1e-12);
        assert_eq!(weight(2.0 * OUTLIER), 0.5);
    }
}

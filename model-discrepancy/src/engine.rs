//! Which effect is missing: fits, predictions and the choice between them. It knows no muscle.
//!
//! A model has *blocks*, each with residuals that are computed from measured inputs alone, in units
//! of their noise. Its *nominal* values have priors; its *candidates* are effects in their forms. A
//! fit moves nominal values within their priors and the parameters of some candidates. Blocks that
//! no candidate ties together are fitted apart, and what was fitted once is kept.

mod marginal;
mod promises;

use super::least_squares::{
    Found, Goal, Prior, Problem as _, Residuals, Slopes, at, hidden, loss, minimize,
};
use super::rows::Timeline;
pub use marginal::{Judgement, Shape};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::ops::Range;
use std::sync::{Mutex, OnceLock};

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
    /// Its value where it does nothing, if there is one.
    pub neutral: Option<f64>,
    /// Whether the effect ends at its smallest, and at its largest value: what is beyond is
    /// another, or none.
    pub ends: [bool; 2],
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

    /// The coordinate of `value`.
    fn coordinate(&self, value: f64) -> f64 {
        if self.log {
            1.0 + (value / self.usual).ln().max(-50.0)
        } else {
            value / self.usual
        }
    }

    /// Whether `value` is where the effect ends, or the largest that the catalogue knows of a size.
    fn at_end(&self, value: f64) -> bool {
        let x = self.coordinate(value);
        let ends = [self.range.0, self.range.1].map(|end| self.coordinate(end));
        let mut ends = ends.into_iter().zip(self.ends);
        let is_end = |end: f64| (x - end).abs() < AT_END;
        let none = self.neutral.map(|none| self.coordinate(none));
        ends.any(|(end, ends)| {
            let is_size = none.is_some_and(|none| (none - end).abs() >= AT_END);
            (ends || is_size) && is_end(end)
        })
    }

    /// The least and the largest coordinate.
    fn reach(&self) -> (f64, f64) {
        let (a, b) = (self.coordinate(self.range.0), self.coordinate(self.range.1));
        (a.min(b), a.max(b))
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
    /// Share of it by which a rig may have it in another form; 0 where its name says the form.
    pub form_doubt: f64,
}

impl Candidate {
    /// Whether a size of it may be on either side of where it does nothing.
    fn has_two_signs(&self) -> bool {
        let sizes = self.parameters.iter();
        let mut sizes = sizes.filter_map(|own| Some((own.range, own.neutral?)));
        sizes.any(|((least, most), none)| least < none && none < most)
    }

    /// The parameters of which `values` are where the effect ends, with these.
    pub fn ended<'a>(&'a self, values: &'a [f64]) -> impl Iterator<Item = (&'a Parameter, f64)> {
        let values = self.parameters.iter().zip(values.iter().copied());
        values.filter(|(parameter, value)| parameter.at_end(*value))
    }
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

/// Residuals as a function of nominal values, in standard deviations, and effects.
pub type Near<'a> = Box<dyn Fn(&[f64], &[Active]) -> Option<Residuals> + Send + Sync + 'a>;

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
    ) -> Option<Residuals>;
    /// The same with what a record has of its own, and what is bounded, as expected: where such an
    /// unknown meets its bound residuals have a kink, at which a fit stays. By default the same.
    fn residuals_as_expected(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        self.residuals(record, block, nominal, effects)
    }
    /// Residuals of a block over a record close to where they are `found`, `as_expected` or not:
    /// what the model seeks for each record stays where it was found there, but for what is linear
    /// about it, so that they are smooth. `None`, by default, where they are that themselves.
    fn near<'a>(
        &'a self,
        _piece: (usize, usize),
        _as_expected: bool,
        _values: (&[f64], &[Active]),
        _found: &[f64],
    ) -> Option<Near<'a>> {
        None
    }
    /// How many residuals a block has over a record.
    fn rows(&self, record: usize, block: usize) -> usize;
    /// How many residuals of a block over a record are no measurements, but priors of what is
    /// estimated with them.
    fn unknowns(&self, _block: usize) -> usize {
        0
    }
    /// Whether residuals of a block change about in proportion to a small effect, so that what a
    /// candidate promises can be believed.
    fn proportional(&self, block: usize) -> bool;
    /// How badly free runs of a record miss what no block's residuals show well, as a cost with
    /// bounded influence; by default there is no such thing.
    fn free_run(&self, _record: usize, _nominal: &[f64], _effects: &[Active]) -> Option<f64> {
        Some(0.0)
    }
    /// Against what the residuals of a block over a record are looked at.
    fn context(&self, record: usize, block: usize) -> Vec<Coordinate>;
    /// Whether the law of a candidate may vary, beyond every form, with a quantity of the context:
    /// with those that the part which has the effect can feel. By default with all but direction
    /// and time, by which effects are told from each other.
    fn varies_with(&self, _candidate: usize, quantity: &str) -> bool {
        !["direction", "time"].contains(&quantity)
    }
    /// When the residuals of a block over a record were measured, and how far they may be off in a
    /// sound rig; by default in the order of their coordinate `time`, if there is one, and by a
    /// third of their noise.
    fn timeline(&self, record: usize, block: usize) -> Timeline {
        let rows = self.rows(record, block);
        let mut context = self.context(record, block).into_iter();
        let time = context.find(|coordinate| coordinate.name == "time");
        let by_row = || (0..rows).map(|row| row as f64).collect();
        Timeline {
            time_s: time.map_or_else(by_row, |time| time.values),
            base: vec![BASE; rows],
        }
    }
}

/// Half a sum of squares, tamed, and of how many residuals.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Half the sum of what lies outside dead zones.
    pub outside: f64,
    /// The same with the noise that dead zones hide: a wider one must not be better by that alone.
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

    /// Cost of what was fitted, priors included, as it is minimized.
    fn fitted(&self) -> f64 {
        let parts = self.parts.iter().map(|part| part.fitted.outside);
        self.prior + parts.sum::<f64>()
    }

    /// Cost of what was fitted, predicted and run freely, priors included.
    pub fn score(&self) -> f64 {
        let parts = self.parts.iter().map(|part| part.total().cost);
        self.prior + self.free_run + parts.sum::<f64>()
    }
}

/// What the nominal model of a sound rig may leave, as a share of the noise.
const BASE: f64 = 0.3;
/// How far the prior of a parameter lets it go: its coordinate is 1 ± this.
const EFFECT_PRIOR: f64 = 5.0;
/// What is nearer to the end of a range is at it, in coordinates.
const AT_END: f64 = 0.01;
/// Largest and least step of the difference quotients. What an integrator makes of residuals by
/// choosing its steps anew is divided by it, and looks like a slope.
const STEPS: (f64, f64) = (0.03, 1e-3);
/// Change of residuals, as a norm, to which a step is shortened: far above what is rough, and no
/// further than a value that is well known will move.
const CHANGE: f64 = 3.0;
/// A parameter that is fitted by its logarithm is started at its usual size, and up to this many
/// times above and below.
const START_FACTOR: f64 = 4.0;
/// Starts of an effect that are followed.
const STARTS: usize = 2;
/// For a place to begin.
const ROUGH: Goal = Goal {
    relative: 1e-2,
    absolute: 2.0,
    evaluations: 12,
    certain: false,
};
/// For a comparison.
const LOOSE: Goal = Goal {
    relative: 1e-3,
    absolute: 0.5,
    evaluations: 40,
    certain: true,
};
/// For a result.
const TIGHT: Goal = Goal {
    relative: 1e-6,
    absolute: 0.01,
    evaluations: 80,
    certain: true,
};
/// Share of its noise by which every residual may be off the same way, as inputs are known at
/// samples only: of a pressure with 250 Pa of noise, 8 Pa were seen.
const SYSTEMATIC: f64 = 0.04;
/// Stretches of time into which a record is cut for the scatter of its residuals.
const CLUSTERS: usize = 20;

/// Residuals of the pieces of a problem about a place, for difference quotients.
struct About<'a> {
    pieces: Vec<Piece<'a>>,
    /// What records have of their own is as expected there.
    expected: bool,
}

struct Piece<'a> {
    record: usize,
    block: usize,
    near: Option<Near<'a>>,
    base: Residuals,
}

impl<'a> About<'a> {
    /// The pieces of `problem`, which is of `model`, about a place with `values`, where their
    /// residuals are `base`.
    fn new<M: Model>(
        model: &'a M,
        problem: &Problem<M>,
        base: &Residuals,
        values: (&[f64], &[Active]),
    ) -> Option<About<'a>> {
        let located: Vec<_> = problem.located().collect();
        let pieces = located.into_par_iter().map(|((record, block), rows)| {
            let found = &base.values[rows.clone()];
            let near = model.near((record, block), problem.expected, values, found);
            let own = match &near {
                Some(near) => problem.finished(near(values.0, values.1))?,
                None => Residuals {
                    values: found.to_vec(),
                    slack: base.slack[rows].to_vec(),
                },
            };
            Some(Piece {
                record,
                block,
                near,
                base: own,
            })
        });
        Some(About {
            pieces: pieces.collect::<Option<_>>()?,
            expected: problem.expected,
        })
    }

    fn rows(&self) -> usize {
        let pieces = self.pieces.iter();
        pieces.map(|piece| piece.base.values.len()).sum()
    }
}

struct Problem<'a, M> {
    model: &'a M,
    blocks: &'a [usize],
    /// The nominal values that are free.
    free: &'a [usize],
    candidates: &'a [usize],
    /// The records whose residuals count, from the first on.
    records: usize,
    /// The nominal values are held for now.
    held: bool,
    /// Dead zones are not to be pushed out by noise at their edges.
    edged: bool,
    /// What records have of their own is as expected for now.
    expected: bool,
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
            records: model.fitted(),
            held: false,
            edged: false,
            expected: false,
        }
    }

    /// Over all records, the predicted ones too.
    fn over_all(mut self) -> Problem<'a, M> {
        self.records = self.model.records();
        self
    }

    fn nominal(&self, x: &DVector<f64>) -> Vec<f64> {
        let mut nominal = vec![0.0; self.model.nominal_blocks().len()];
        for (place, free) in self.free.iter().enumerate() {
            nominal[*free] = x[place];
        }
        nominal
    }

    fn parameters(&self) -> impl Iterator<Item = (&'a Candidate, &'a Parameter)> {
        let all = self.model.candidates();
        self.candidates.iter().flat_map(move |own| {
            let parameters = all[*own].parameters.iter();
            parameters.map(move |parameter| (&all[*own], parameter))
        })
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

    fn pieces(&self) -> impl Iterator<Item = (usize, usize)> + use<'a, M> {
        let (records, blocks) = (0..self.records, self.blocks);
        records.flat_map(move |record| blocks.iter().map(move |block| (record, *block)))
    }

    /// The pieces, each with its rows among the residuals of all.
    fn located(&self) -> impl Iterator<Item = ((usize, usize), Range<usize>)> + use<'a, M> {
        let (model, mut first) = (self.model, 0);
        self.pieces().map(move |(record, block)| {
            let rows = first..first + model.rows(record, block);
            first = rows.end;
            ((record, block), rows)
        })
    }

    fn piece(&self, x: &DVector<f64>, (record, block): (usize, usize)) -> Option<Residuals> {
        let (nominal, effects) = (self.nominal(x), self.effects(x));
        self.computed((record, block), self.expected, &nominal, &effects)
    }

    fn computed(
        &self,
        (record, block): (usize, usize),
        expected: bool,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        if expected {
            self.model
                .residuals_as_expected(record, block, nominal, effects)
        } else {
            self.model.residuals(record, block, nominal, effects)
        }
    }

    /// Residuals that are numbers, with dead zones as they are asked for.
    fn finished(&self, residuals: Option<Residuals>) -> Option<Residuals> {
        let residuals = residuals.filter(Residuals::finite)?;
        Some(if self.edged {
            residuals.edged()
        } else {
            residuals
        })
    }

    /// How the residuals change from those `about` a place with other nominal values and effects,
    /// where they move a block at all.
    fn change(
        &self,
        about: &About,
        moves: &dyn Fn(usize) -> bool,
        (nominal, effects): (&[f64], &[Active]),
    ) -> Option<Slopes> {
        let mut values = DMatrix::zeros(about.rows(), 1);
        let mut slack = values.clone();
        let mut row = 0;
        for piece in &about.pieces {
            let base = &piece.base;
            if !moves(piece.block) {
                row += base.values.len();
                continue;
            }
            let moved = match &piece.near {
                Some(near) => near(nominal, effects),
                None => {
                    let place = (piece.record, piece.block);
                    self.computed(place, about.expected, nominal, effects)
                }
            };
            let moved = self.finished(moved)?;
            let own = moved.values.iter().zip(&moved.slack);
            for ((value, slack_moved), (own, own_slack)) in
                own.zip(base.values.iter().zip(&base.slack))
            {
                values[row] = value - own;
                slack[row] = slack_moved - own_slack;
                row += 1;
            }
        }
        Some(Slopes { values, slack })
    }

    /// Whether coordinate `place` changes the residuals of `block`.
    fn moves(&self, place: usize, block: usize) -> bool {
        match place.checked_sub(self.free.len()) {
            None => !self.held && self.model.nominal_blocks()[self.free[place]].contains(&block),
            Some(number) => {
                let parameter = self.parameters().nth(number);
                parameter.is_some_and(|(candidate, _)| candidate.blocks.contains(&block))
            }
        }
    }

    /// The largest step of the difference quotient of coordinate `place` at `x`: inwards at its
    /// end.
    fn step(&self, x: &DVector<f64>, place: usize) -> f64 {
        let number = place.checked_sub(self.free.len());
        let parameter = number.and_then(|number| self.parameters().nth(number));
        let most = parameter.map_or(f64::INFINITY, |(_, parameter)| parameter.reach().1);
        let (step, _) = STEPS;
        if x[place] + step > most { -step } else { step }
    }

    /// Slopes of the residuals `about` the place `x`.
    fn slopes_about(&self, x: &DVector<f64>, about: &About) -> Option<Slopes> {
        let rows = about.rows();
        let mut slopes = Slopes {
            values: DMatrix::zeros(rows, x.len()),
            slack: DMatrix::zeros(rows, x.len()),
        };
        let slope = |place: usize| {
            let moves = |block| self.moves(place, block);
            let by = |step: f64| {
                let mut moved = x.clone();
                moved[place] += step;
                let with = (&self.nominal(&moved)[..], &self.effects(&moved)[..]);
                let change = self.change(about, &moves, with)?;
                Some((step, change))
            };
            // Beside a place without a solution the other way may have one.
            let step = self.step(x, place);
            let (step, change) = by(step).or_else(|| by(-step))?;
            let shorter = CHANGE / change.values.norm().max(change.slack.norm());
            if shorter < 1.0 {
                by(step * shorter.max(STEPS.1 / STEPS.0)).or(Some((step, change)))
            } else {
                Some((step, change))
            }
        };
        let columns = (0..x.len()).into_par_iter().map(slope);
        let columns: Vec<(f64, Slopes)> = columns.collect::<Option<_>>()?;
        for (place, (step, change)) in columns.into_iter().enumerate() {
            slopes
                .values
                .set_column(place, &(change.values.column(0) / step));
            slopes
                .slack
                .set_column(place, &(change.slack.column(0) / step));
        }
        Some(slopes)
    }

    /// The fit at `found`, with what it predicts.
    fn fit(&self, found: &Found) -> Option<Fit> {
        let (nominal, effects) = (self.nominal(&found.x), self.effects(&found.x));
        let part = |block: &usize| Part {
            block: *block,
            fitted: Tally::default(),
            predicted: Tally::default(),
        };
        let mut parts: Vec<Part> = self.blocks.iter().map(part).collect();
        for record in 0..self.model.records() {
            for part in &mut parts {
                let residuals = self.piece(&found.x, (record, part.block))?;
                let unknowns = self.model.unknowns(part.block);
                if record < self.model.fitted() {
                    part.fitted += tally(&residuals, unknowns);
                } else {
                    part.predicted += tally(&residuals, unknowns);
                }
            }
        }
        let priors = self.priors(&found.x);
        let mut values = found.x.iter().skip(self.free.len()).copied();
        let all = self.model.candidates();
        let own = |c: &usize| values.by_ref().take(all[*c].parameters.len()).collect();
        Some(Fit {
            prior: 0.5 * priors.iter().map(|(r, _)| r * r).sum::<f64>(),
            free_run: 0.0,
            coordinates: self.candidates.iter().map(own).collect(),
            nominal,
            effects,
            parts,
        })
    }
}

impl<M: Model> super::least_squares::Problem for Problem<'_, M> {
    fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals> {
        let pieces: Vec<_> = self.pieces().collect();
        let pieces = pieces
            .into_par_iter()
            .map(|piece| self.finished(self.piece(x, piece)));
        let pieces: Vec<Residuals> = pieces.collect::<Option<_>>()?;
        let mut all = Residuals::default();
        for piece in pieces {
            all.extend(piece);
        }
        Some(all)
    }

    fn slopes(&mut self, x: &DVector<f64>, base: &Residuals) -> Option<Slopes> {
        let values = (&self.nominal(x)[..], &self.effects(x)[..]);
        let about = About::new(self.model, self, base, values)?;
        self.slopes_about(x, &about)
    }

    fn priors(&self, x: &DVector<f64>) -> Vec<Prior> {
        let nominals = self.free.len();
        let prior = |(place, x): (usize, &f64)| match place {
            _ if place >= nominals => ((x - 1.0) / EFFECT_PRIOR, 1.0 / EFFECT_PRIOR),
            // Held: no step is the best.
            _ if self.held => (0.0, 1.0),
            _ => (*x, 1.0),
        };
        x.iter().enumerate().map(prior).collect()
    }

    fn bounded(&self, mut x: DVector<f64>) -> DVector<f64> {
        let own = x.iter_mut().skip(self.free.len());
        for (x, (_, parameter)) in own.zip(self.parameters()) {
            let (least, most) = parameter.reach();
            *x = x.clamp(least, most);
        }
        x
    }
}

/// Cost of residuals, of which so many are no measurements.
///
/// What a dead zone hides of the noise is 0.5 where the truth is well inside, and half of that
/// where it is at an edge, which the noise then crosses: what lies outside tells which, and is not
/// noise once more.
fn tally(residuals: &Residuals, unknowns: usize) -> Tally {
    let (mut outside, mut whole) = (0.0, 0.0);
    let (mut crossed, mut most) = (0.0, 0.0);
    for (beyond, slack) in residuals.outside().zip(&residuals.slack) {
        let (cost, hides) = (loss(beyond), hidden(*slack));
        outside += cost;
        whole += hides;
        crossed += 2.0 * hides * (cost - (0.5 - hides));
        if cost > 0.0 {
            most += hides;
        }
    }
    Tally {
        outside,
        cost: outside + whole - crossed.clamp(0.0, most),
        count: residuals.values.len() - unknowns,
    }
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Tally) {
        self.outside += other.outside;
        self.cost += other.cost;
        self.count += other.count;
    }
}

/// What a fit is of: blocks and candidates.
pub(crate) type Key = (Vec<usize>, Vec<usize>);

/// Fits and what they predict, each made once.
pub struct Engine<'a, M> {
    /// The model.
    pub model: &'a M,
    fits: Mutex<HashMap<Key, Option<Fit>>>,
    /// What candidates promise, and whether from all of their starts.
    promised: Mutex<HashMap<(promises::Place, usize), (f64, bool)>>,
    judged: Mutex<HashMap<promises::Place, Option<Vec<Judgement>>>>,
    /// Residuals of each record's blocks with nominal values as given and without effects.
    as_given: Vec<OnceLock<Option<Residuals>>>,
}

/// A hypothesis: which candidates are present, and how well it fits and predicts.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// The candidates.
    pub candidates: Vec<usize>,
    /// The fit.
    pub fit: Fit,
}

/// A candidate of a hypothesis, and another form of the same effect for its place.
pub struct OtherForm<'h> {
    /// The hypothesis.
    pub of: &'h Hypothesis,
    /// Its candidate.
    pub own: usize,
    /// The other form.
    pub form: usize,
}

impl<'a, M: Model> Engine<'a, M> {
    /// An engine for `model`.
    pub fn new(model: &'a M) -> Self {
        Engine {
            model,
            fits: Mutex::default(),
            promised: Mutex::default(),
            judged: Mutex::default(),
            as_given: (0..model.records() * model.blocks().len())
                .map(|_| OnceLock::new())
                .collect(),
        }
    }

    /// The groups of blocks that `candidates` tie together, with the candidates of each.
    pub fn groups(&self, candidates: &[usize]) -> Vec<(Vec<usize>, Vec<usize>)> {
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

    /// Those of `groups` that a candidate touches.
    pub(crate) fn touched<'g>(
        &self,
        groups: &'g [Key],
        candidate: usize,
    ) -> impl Iterator<Item = &'g Key> {
        let own = &self.model.candidates()[candidate].blocks;
        let is_touched = |group: &&Key| own.iter().any(|block| group.0.contains(block));
        groups.iter().filter(is_touched)
    }

    /// Fits the blocks' residuals with `candidates`; `None` without a solution.
    fn group(&self, blocks: &[usize], candidates: &[usize]) -> Option<Fit> {
        let key = (blocks.to_vec(), candidates.to_vec());
        if let Some(known) = self.fits.lock().ok()?.get(&key) {
            return known.clone();
        }
        let fit = self.fit(blocks, candidates);
        self.fits.lock().ok()?.insert(key, fit.clone());
        fit
    }

    /// Fits blocks with candidates of `hypothesis`, from where it is.
    fn refitted(
        &self,
        hypothesis: &Hypothesis,
        (blocks, candidates): (&[usize], &[usize]),
        goal: Goal,
        edged: bool,
    ) -> Option<Fit> {
        let free = self.free(blocks);
        let x = self.coordinates(hypothesis, &free, candidates);
        let mut problem = Problem::new(self.model, blocks, &free, candidates);
        problem.edged = edged;
        let found = minimize(&mut problem, DVector::from_vec(x), goal)?;
        problem.fit(&found)
    }

    fn fit(&self, blocks: &[usize], candidates: &[usize]) -> Option<Fit> {
        let free = self.free(blocks);
        let mut problem = Problem::new(self.model, blocks, &free, candidates);
        problem.expected = true;
        if candidates.is_empty() {
            // Every comparison is with this fit.
            let begun = minimize(&mut problem, DVector::zeros(free.len()), ROUGH)?;
            problem.expected = false;
            let found = minimize(&mut problem, begun.x, TIGHT)?;
            return problem.fit(&found);
        }
        let mut begun = Vec::new();
        let least = |a: &Found, b: &Found| a.cost.total_cmp(&b.cost);
        if let [own] = candidates {
            // With nominal values as given, else they take up what is the effect's.
            problem.held = true;
            let nothing = Fit::nothing(self.model.nominal_blocks().len());
            let starts = self.begin(&mut problem, (*own, &nothing))?;
            let held = starts.into_iter();
            let held = held.filter_map(|x| minimize(&mut problem, x, ROUGH));
            let held = held.min_by(least);
            problem.held = false;
            begun.extend(held.and_then(|held| minimize(&mut problem, held.x, ROUGH)));
        }
        // From where the others alone have put them.
        for own in candidates {
            let mut others = candidates.to_vec();
            others.retain(|other| other != own);
            let Some(without) = self.joined(&others) else {
                continue;
            };
            let starts = self.begin(&mut problem, (*own, &without))?;
            for x in starts.into_iter().take(1) {
                begun.extend(minimize(&mut problem, x, ROUGH));
            }
        }
        let best = begun.into_iter().min_by(least)?;
        problem.expected = false;
        let found = minimize(&mut problem, best.x, LOOSE)?;
        problem.fit(&found)
    }

    /// Where a fit begins, best first: nominal values and the other candidates of `problem` where
    /// they are in `without`, its candidate `own`, which is not there, wherever it may start.
    fn begin(
        &self,
        problem: &mut Problem<M>,
        (own, without): (usize, &Fit),
    ) -> Option<Vec<DVector<f64>>> {
        let all = self.model.candidates();
        let nominal = problem.free.iter().map(|n| without.nominal[*n]);
        let mut begun = vec![nominal.collect::<Vec<f64>>()];
        for candidate in problem.candidates {
            let places = if *candidate == own {
                starts(&all[own].parameters)
            } else {
                let mut effects = without.effects.iter();
                let place = effects.position(|(other, _)| other == candidate)?;
                vec![without.coordinates[place].clone()]
            };
            let longer = begun.iter().flat_map(|start| {
                places
                    .iter()
                    .map(move |place| [&start[..], &place[..]].concat())
            });
            begun = longer.collect();
        }
        let begun = begun.into_iter().map(DVector::from_vec);
        if begun.len() == 1 {
            return Some(begun.collect());
        }
        let costs = begun.filter_map(|x| at(problem, x));
        let mut costs: Vec<Found> = costs.collect();
        costs.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        // Starts that do nothing are all the same.
        costs.dedup_by(|a, b| (a.cost - b.cost).abs() < 1e-9 * b.cost);
        costs.truncate(STARTS);
        Some(costs.into_iter().map(|found| found.x).collect())
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
        self.tightened(hypothesis, false)
    }

    /// `hypothesis` as it is estimated: noise at the edges of dead zones, which is the same for
    /// all that are compared, does not push them out.
    pub fn estimated(&self, hypothesis: &Hypothesis) -> Option<Hypothesis> {
        self.tightened(hypothesis, true)
    }

    fn tightened(&self, hypothesis: &Hypothesis, edged: bool) -> Option<Hypothesis> {
        let mut joint = Fit::nothing(self.model.nominal_blocks().len());
        for (blocks, touching) in self.groups(&hypothesis.candidates) {
            joint.join(if touching.is_empty() && !edged {
                // It is tight already.
                self.group(&blocks, &touching)?
            } else {
                self.refitted(hypothesis, (&blocks, &touching), TIGHT, edged)?
            });
        }
        self.finished(hypothesis.candidates.clone(), joint)
    }

    /// Hypotheses with one candidate in another form of the same effect, and fitted from
    /// where they are, as what has the same name in both is about the same. A form with several
    /// scales may have valleys in which it stays when it is started elsewhere.
    pub fn reformed(&self, others: &[OtherForm]) -> Vec<Hypothesis> {
        self.fitted_there(others.iter().filter_map(|other| self.with_form(other)))
    }

    /// `of` without each of its candidates, the others fitted from where they are in it: alone they
    /// may have stayed in another valley.
    pub fn reduced(&self, of: &Hypothesis) -> Vec<Hypothesis> {
        let effects = of.fit.effects.iter().enumerate();
        self.fitted_there(effects.map(|(place, (own, _))| {
            let mut begun = of.clone();
            begun.fit.effects.remove(place);
            begun.fit.coordinates.remove(place);
            begun.candidates.retain(|candidate| candidate != own);
            (begun, *own)
        }))
    }

    /// Hypotheses that differ from others by a candidate, fitted from where they begin.
    fn fitted_there(&self, begun: impl Iterator<Item = (Hypothesis, usize)>) -> Vec<Hypothesis> {
        let begun: Vec<(Hypothesis, usize)> = begun.collect();
        let fits = begun.par_iter();
        let fits = fits.filter_map(|(begun, other)| self.refits(begun, *other));
        let fits: Vec<Vec<(Key, Fit)>> = fits.collect();
        // Not while others fit, which would begin by chance.
        self.keep(fits.into_iter().flatten());
        let found = begun.par_iter();
        let found = found.filter_map(|(begun, _)| self.hypothesis(&begun.candidates));
        found.collect()
    }

    /// Where the fit with another form begins, and that form.
    fn with_form(&self, other: &OtherForm) -> Option<(Hypothesis, usize)> {
        let OtherForm { of, own, form } = *other;
        let mut begun = of.clone();
        let place = of.fit.effects.iter().position(|(c, _)| *c == own)?;
        begun.fit.coordinates[place] = self.in_form((own, &of.fit.effects[place].1), form);
        begun.fit.effects[place].0 = form;
        begun.candidates.retain(|candidate| *candidate != own);
        begun.candidates.push(form);
        begun.candidates.sort_unstable();
        Some((begun, form))
    }

    /// The coordinates of another `form` of the effect of a candidate with these values, as what
    /// has the same name in both is about the same.
    fn in_form(&self, (own, values): (usize, &[f64]), form: usize) -> Vec<f64> {
        let all = self.model.candidates();
        let known = |parameter: &Parameter| {
            let mut names = all[own].parameters.iter().zip(values);
            names.find(|(same, _)| same.name == parameter.name)
        };
        let mut sizes = all[form].parameters.iter().filter(|p| p.neutral.is_some());
        let sized = sizes.any(|size| known(size).is_some());
        let coordinate = |parameter: &Parameter| {
            let x = match (known(parameter), parameter.neutral) {
                (Some((_, value)), _) => parameter.coordinate(*value),
                // What a form has beside the known size does nothing yet.
                (None, Some(none)) if sized && !parameter.log => parameter.coordinate(none),
                (None, _) => 1.0,
            };
            let (least, most) = parameter.reach();
            x.clamp(least, most)
        };
        all[form].parameters.iter().map(coordinate).collect()
    }

    /// Fits of the groups of `begun` that `candidate`, in it or not, touches.
    fn refits(&self, begun: &Hypothesis, candidate: usize) -> Option<Vec<(Key, Fit)>> {
        let groups = self.groups(&begun.candidates);
        let touched = self.touched(&groups, candidate).cloned();
        let touched = touched.filter(|(_, touching)| !touching.is_empty());
        let fitted = touched.map(|(blocks, touching)| {
            let fit = self.refitted(begun, (&blocks, &touching), LOOSE, false)?;
            Some(((blocks, touching), fit))
        });
        fitted.collect()
    }

    /// Keeps fits that are better than what is known: what is fitted with more than they have
    /// begins there.
    fn keep(&self, found: impl Iterator<Item = (Key, Fit)>) {
        let Ok(mut fits) = self.fits.lock() else {
            return;
        };
        for (key, fit) in found {
            let known = fits.entry(key).or_default();
            let better = |known: &Fit| fit.fitted() < known.fitted();
            if known.as_ref().is_none_or(better) {
                *known = Some(fit);
            }
        }
    }

    /// Standard errors of the parameters of the candidates of `hypothesis`, which is estimated, as
    /// their 95 % intervals.
    ///
    /// From the Jacobian and the scatter of its products with the residuals from one stretch of
    /// time to the next (White's estimator, clustered), which holds when residuals are not white
    /// or their noise is not the assumed one; never narrower than the assumed noise makes them,
    /// and with what a common error of all residuals may do.
    pub fn intervals(&self, hypothesis: &Hypothesis) -> Option<Vec<Vec<[f64; 2]>>> {
        let blocks: Vec<usize> = (0..self.model.blocks().len()).collect();
        let free = self.free(&blocks);
        let x = self.coordinates(hypothesis, &free, &hypothesis.candidates);
        let mut problem = Problem::new(self.model, &blocks, &free, &hypothesis.candidates);
        problem.edged = true;
        let found = at(&mut problem, DVector::from_vec(x))?;
        let x = &found.x;
        let slopes = problem.slopes(x, &found.residuals)?;
        let (residuals, slopes) = slopes.weighted(&found.residuals);
        let priors = problem.priors(x);
        let size = x.len();
        let mut bread = slopes.tr_mul(&slopes);
        for (place, (_, slope)) in priors.iter().enumerate() {
            bread[(place, place)] += slope * slope;
        }
        let bread = bread.try_inverse()?;
        let mut filling = DMatrix::zeros(size, size);
        let mut row = 0;
        let mut clusters = 0;
        for (record, block) in problem.pieces() {
            let count = self.model.rows(record, block);
            let length = count.div_ceil(CLUSTERS).max(1);
            for start in (0..count).step_by(length) {
                let rows = length.min(count - start);
                let part = slopes.rows(row + start, rows);
                let product = part.tr_mul(&residuals.rows(row + start, rows));
                filling += &product * product.transpose();
                clusters += 1;
            }
            row += count;
        }
        // The priors count as observations that are met on average.
        for place in 0..size {
            filling[(place, place)] += priors[place].1.powi(2);
        }
        let few = clusters as f64 / (clusters as f64 - size as f64).max(1.0);
        let robust = &bread * filling * &bread * few;
        let influence = &bread * slopes.transpose();
        let together = |place: usize| {
            let all: f64 = influence.row(place).iter().map(|share| share.abs()).sum();
            (SYSTEMATIC * all).powi(2)
        };
        let mut place = free.len();
        let all = self.model.candidates();
        let of = |candidate: &usize| {
            let parameters = all[*candidate].parameters.iter().map(|parameter| {
                let variance = robust[(place, place)].max(bread[(place, place)]);
                let variance = variance + together(place);
                let (x, reach) = (x[place], 1.96 * variance.max(0.0).sqrt());
                place += 1;
                [parameter.value(x - reach), parameter.value(x + reach)]
            });
            parameters.map(|[a, b]| [a.min(b), a.max(b)]).collect()
        };
        Some(hypothesis.candidates.iter().map(of).collect())
    }

    /// Where the fit of `hypothesis` is, in the coordinates of a problem.
    fn coordinates(
        &self,
        hypothesis: &Hypothesis,
        free: &[usize],
        candidates: &[usize],
    ) -> Vec<f64> {
        let fit = &hypothesis.fit;
        let coordinates = candidates.iter().flat_map(|candidate| {
            let effects = fit.effects.iter();
            let place = effects.take_while(|(own, _)| own != candidate).count();
            fit.coordinates[place].iter().copied()
        });
        let nominal = free.iter().map(|n| fit.nominal[*n]);
        nominal.chain(coordinates).collect()
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
/// there are two; what is fitted by its logarithm also above and below.
fn starts(parameters: &[Parameter]) -> Vec<Vec<f64>> {
    let mut starts = vec![Vec::new()];
    for parameter in parameters {
        let (least, most) = parameter.reach();
        let values: Vec<f64> = if parameter.log {
            let reach = START_FACTOR.ln();
            let shares: &[f64] = if parameters.len() == 1 {
                &[0.0, -0.5, 0.5, -1.0, 1.0]
            } else {
                &[0.0, -1.0, 1.0]
            };
            let places = shares.iter().map(|share| 1.0 + share * reach);
            places.map(|x| x.clamp(least, most)).collect()
        } else if parameter.range.0 < 0.0 {
            vec![0.5, -0.5]
        } else {
            vec![0.5_f64.clamp(least, most)]
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows that only differ by noise cost that, wherever in their dead zones they lie, and what is
    /// beyond it counts.
    #[test]
    fn noise_costs_the_same_inside_a_dead_zone_at_its_edge_and_without_one() {
        let rows = 4001_u32;
        // By its quantiles, the logistic being near enough to the normal to stay within a percent.
        let uniform = |i: u32| (0.5 + f64::from(i)) / f64::from(rows);
        let normal = |i: u32| {
            let odds = uniform(i) / (1.0 - uniform(i));
            // Of unit variance.
            odds.ln() * 3.0_f64.sqrt() / std::f64::consts::PI
        };
        let cost = |place: f64, slack: f64| {
            let residuals = Residuals {
                values: (0..rows).map(|i| place + normal(i)).collect(),
                slack: vec![slack; rows as usize],
            };
            tally(&residuals, 0).cost / f64::from(rows)
        };
        let noise = cost(0.0, 0.0);
        for (place, slack) in [(0.0, 8.0), (4.0, 8.0), (8.0, 8.0), (-3.0, 3.0)] {
            let cost = cost(place, slack);
            assert!(
                (cost - noise).abs() < 0.03,
                "{place}, {slack}: {cost} of {noise}"
            );
        }
        assert!(cost(10.0, 8.0) > 3.0 * noise);
        // One row in ten is two standard deviations off.
        let values = (0..rows).map(|i| normal(i) + if i % 10 == 0 { 10.0 } else { 0.0 });
        let off = Residuals {
            values: values.collect(),
            slack: vec![8.0; rows as usize],
        };
        let off = tally(&off, 0).cost / f64::from(rows);
        assert!(off > noise + 0.1, "{off} of {noise}");
        assert!(cost(2.0, 0.0) > 3.0 * noise);
    }
}

//! Plants of others, each with a catalogue of its own, on the public interface of the crate
//! `model-discrepancy` only. See `docs/own-plant.md`.
//!
//! A plant implements [`Law`] for one of its records; [`Plant`] makes a [`Model`] of some.

pub mod axis;
pub mod formula;
pub mod motor;
pub mod oscillator;
pub mod signal;
pub mod tanks;

use model_discrepancy::engine::{Active, Candidate, Coordinate, Model, Parameter};
use model_discrepancy::least_squares::Residuals;
use model_discrepancy::rows::Timeline;

/// What a plant's record has to say.
pub trait Law: Sync {
    /// The blocks' names.
    const BLOCKS: &'static [&'static str];
    /// Share of the noise by which a sound plant may be off, block by block.
    const BASE: &'static [f64] = &[0.3; 32];
    /// The effects that may be missing.
    fn catalogue() -> Vec<Candidate>;
    /// How many nominal values have a prior.
    const NOMINALS: usize;
    /// The blocks on which each nominal value acts; by default all.
    fn nominal_blocks() -> Vec<Vec<usize>> {
        vec![(0..Self::BLOCKS.len()).collect(); Self::NOMINALS]
    }
    /// When the rows of a block are measured, in units of which a discrepancy lasts about one.
    fn times(&self, block: usize) -> Vec<f64>;
    /// What the law misses in each row of a block, in units of the noise.
    fn missed(&self, block: usize, nominal: &[f64], effects: &Present) -> Vec<f64>;
    /// Whether rows change in proportion to a small effect.
    const PROPORTIONAL: bool = true;
}

/// Records of a plant, of which the first ones are fitted.
pub struct Plant<L> {
    /// The records.
    pub records: Vec<L>,
    fitted: usize,
    /// The effects that may be missing.
    pub candidates: Vec<Candidate>,
    nominal_blocks: Vec<Vec<usize>>,
}

impl<L: Law> Plant<L> {
    /// Of these records, of which so many are fitted and the others predicted.
    pub fn new(records: Vec<L>, fitted: usize) -> Plant<L> {
        Plant {
            records,
            fitted,
            candidates: L::catalogue(),
            nominal_blocks: L::nominal_blocks(),
        }
    }

    /// The same with the terms of formulas in the place of these effects of its catalogue.
    #[must_use]
    pub fn with_formulas(mut self, effects: &[&str], terms: Vec<Candidate>) -> Plant<L> {
        let is_there = |effect: &&str| self.candidates.iter().any(|own| own.effect == *effect);
        debug_assert!(effects.iter().all(is_there), "{effects:?}");
        let is_kept = |own: &Candidate| !effects.contains(&own.effect);
        self.candidates.retain(is_kept);
        self.candidates.extend(terms);
        self
    }
}

impl<L: Law> Model for Plant<L> {
    fn records(&self) -> usize {
        self.records.len()
    }
    fn fitted(&self) -> usize {
        self.fitted
    }
    fn blocks(&self) -> &[&'static str] {
        L::BLOCKS
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
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        let effects = Present::new(&self.candidates, effects);
        let missed = self.records[record].missed(block, nominal, &effects);
        Some(Residuals::exact(missed))
    }
    fn rows(&self, record: usize, block: usize) -> usize {
        self.records[record].times(block).len()
    }
    fn proportional(&self, _: usize) -> bool {
        L::PROPORTIONAL
    }
    fn context(&self, record: usize, block: usize) -> Vec<Coordinate> {
        vec![Coordinate {
            name: "time",
            unit: "s",
            values: self.records[record].times(block),
        }]
    }
    fn timeline(&self, record: usize, block: usize) -> Timeline {
        let time_s = self.records[record].times(block);
        Timeline {
            base: vec![L::BASE[block]; time_s.len()],
            time_s,
        }
    }
}

/// The effects of a hypothesis, by their names.
pub struct Present<'e> {
    candidates: &'e [Candidate],
    effects: &'e [Active],
}

impl<'e> Present<'e> {
    /// These `effects` among `candidates`.
    pub fn new(candidates: &'e [Candidate], effects: &'e [Active]) -> Present<'e> {
        Present {
            candidates,
            effects,
        }
    }

    /// The form and the values of an effect; an empty form and no values if it is not there.
    pub fn of(&self, effect: &str) -> (&'static str, &'e [f64]) {
        let mut present = self.effects.iter();
        let found = present.find(|(own, _)| self.candidates[*own].effect == effect);
        found.map_or(("", &[]), |(own, values)| {
            (self.candidates[*own].form, values)
        })
    }

    /// A value of an effect; 0 if it is not there.
    pub fn value(&self, effect: &str, place: usize) -> f64 {
        self.of(effect).1.get(place).copied().unwrap_or(0.0)
    }

    /// The first value of an effect; 0 if it is not there.
    pub fn size(&self, effect: &str) -> f64 {
        self.value(effect, 0)
    }
}

/// A parameter that does nothing at 0.
pub const fn parameter(
    name: &'static str,
    unit: &'static str,
    range: (f64, f64),
    usual: f64,
) -> Parameter {
    Parameter {
        name,
        unit,
        range,
        usual,
        log: false,
        neutral: Some(0.0),
        ends: [false; 2],
    }
}

/// A parameter that sets a scale: positive, fitted by its logarithm, and nothing by itself.
pub const fn scale(
    name: &'static str,
    unit: &'static str,
    range: (f64, f64),
    usual: f64,
) -> Parameter {
    Parameter {
        log: true,
        neutral: None,
        ..parameter(name, unit, range, usual)
    }
}

/// An effect in one form on some blocks.
pub fn candidate(
    effect: &'static str,
    form: &'static str,
    blocks: &[usize],
    parameters: &[Parameter],
) -> Candidate {
    Candidate {
        effect,
        form,
        parameters: parameters.to_vec(),
        blocks: blocks.to_vec(),
        form_doubt: 0.05,
    }
}

//! What effects promise beside those that are there, before they are fitted.

use super::{About, Candidate, Engine, Hypothesis, Key, Model, Parameter, Problem, starts, tally};
use crate::least_squares::{Linearized, Prior, Problem as _, Residuals, Slopes, at};
use nalgebra::DVector;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Share of the largest promise from a first start up to which others are not looked at.
const SHARE_OF_FIRST: f64 = 0.1;
/// Share of a start at which an effect begins.
const SMALL: f64 = 1e-2;

/// Blocks that stand or fall together, the candidates on them, and the bits of where those and the
/// nominal values are: what a promise depends on.
pub(super) type Place = (Vec<usize>, Vec<usize>, Vec<u64>);

/// Some blocks of a hypothesis, linearized.
struct Base<'a> {
    nominal: Vec<f64>,
    residuals: Residuals,
    about: About<'a>,
    slopes: Slopes,
    priors: Vec<Prior>,
    /// Their cost where the hypothesis has moved as it would alone: that is nobody's promise.
    least: f64,
}

impl<M: Model> Engine<'_, M> {
    /// What each candidate promises beyond `base`: by how much it would lower the cost of all
    /// records, if residuals changed in proportion to it, nominal values and effects of `base`
    /// moved with it; the best of its starts. The predicted records count, as an effect may not be
    /// moved in the others. Costs one evaluation a start, or two; beside others, what promises
    /// little from its first start is left at that, and an effect of `base` promises nothing. What
    /// all starts have promised where `base` is no other is known.
    pub fn promises(&self, base: &Hypothesis) -> Option<Vec<f64>> {
        let all = self.model.candidates();
        let groups = self.groups(&base.candidates);
        let places: Vec<Place> = all.iter().map(|c| self.place(base, &groups, c)).collect();
        let has = |effect| base.candidates.iter().any(|own| all[*own].effect == effect);
        let known: Vec<Option<f64>> = {
            let promised = self.promised.lock().ok()?;
            let known = |(c, place): (usize, &Place)| {
                let known = promised.get(&(place.clone(), c)).copied();
                has(all[c].effect).then_some(0.0).or(known)
            };
            places.iter().enumerate().map(known).collect()
        };
        let mut bases = BTreeMap::new();
        for (place, known) in places.iter().zip(&known) {
            if known.is_none() && !bases.contains_key(place) {
                bases.insert(place, self.bases(base, place)?);
            }
        }
        let promise = |c: usize, start: &[f64]| {
            let of_bases = bases[&places[c]].iter();
            let mut promised = of_bases.filter_map(|own| self.beside(own, base, (c, start)));
            if !places[c].1.is_empty() || all[c].has_two_signs() {
                return promised.next().map(|(promise, _)| promise);
            }
            // The problem is convex: what gains by less of it than none gains nothing by any.
            let mut gains =
                promised.map(|(promise, share)| if share < 0.0 { 0.0 } else { promise });
            let first = gains.next()?;
            Some(if first > 0.0 {
                first
            } else {
                gains.fold(first, f64::max)
            })
        };
        // Also as it begins: what is large moves what takes its place, or leaves a dead zone.
        let begins = |c: usize, start: &[f64]| {
            let mut blocks = all[c].blocks.iter();
            if blocks.all(|block| self.model.proportional(*block)) {
                return None;
            }
            promise(c, &small(&all[c].parameters, start))
        };
        let starts: Vec<_> = all.iter().map(|c| starts(&c.parameters)).collect();
        let first = (0..all.len()).into_par_iter().map(|c| {
            let start = starts[c].first()?;
            let tried = || [promise(c, start), begins(c, start)];
            known[c].or_else(|| tried().into_iter().flatten().reduce(f64::max))
        });
        let first: Vec<Option<f64>> = first.collect();
        let most = first.iter().flatten().copied().fold(0.0, f64::max);
        // The best, and whether all starts have been tried for it.
        let best = |c: usize| {
            let first_promise = first[c].unwrap_or(0.0).max(0.0);
            if known[c].is_some() {
                return (first_promise, true);
            }
            let little = first[c].is_some() && first_promise < SHARE_OF_FIRST * most;
            if little && !base.candidates.is_empty() {
                return (first_promise, false);
            }
            let others = starts[c].par_iter().skip(1);
            let others = others.filter_map(|start| promise(c, start));
            (others.reduce(|| first_promise, f64::max), true)
        };
        let promises: Vec<(f64, bool)> = (0..all.len()).into_par_iter().map(best).collect();
        let mut promised = self.promised.lock().ok()?;
        for (c, place) in places.into_iter().enumerate() {
            if let (None, (promise, true)) = (known[c], promises[c]) {
                promised.insert((place, c), promise);
            }
        }
        Some(promises.into_iter().map(|(promise, _)| promise).collect())
    }

    /// What a candidate promises, and by which share of its start, on the blocks of a base of
    /// `hypothesis`.
    fn beside(
        &self,
        base: &Base,
        hypothesis: &Hypothesis,
        (c, start): (usize, &[f64]),
    ) -> Option<(f64, f64)> {
        let candidate = &self.model.candidates()[c];
        let values = candidate.parameters.iter().zip(start);
        let mut with = hypothesis.fit.effects.clone();
        with.push((c, values.map(|(p, x)| p.value(*x)).collect()));
        let with = (&base.nominal[..], &with[..]);
        let moves = |block| candidate.blocks.contains(&block);
        let problem = self.problem(&[], &[], &[]);
        let change = problem.change(&base.about, &moves, with)?;
        let with = base.slopes.beside(&change);
        let (least, step) = linearized_least(&base.residuals, &with, &base.priors);
        Some((base.least - least, step[step.len() - 1]))
    }

    /// All records, with what they have of their own as expected.
    fn problem<'p>(
        &'p self,
        blocks: &'p [usize],
        free: &'p [usize],
        candidates: &'p [usize],
    ) -> Problem<'p, M> {
        let mut problem = Problem::new(self.model, blocks, free, candidates).over_all();
        problem.expected = true;
        problem
    }

    /// What a promise of `candidate` beside `base`, whose blocks are tied in `groups`, depends on.
    fn place(&self, base: &Hypothesis, groups: &[Key], candidate: &Candidate) -> Place {
        let own = |blocks: &[usize]| candidate.blocks.iter().any(|b| blocks.contains(b));
        let touched = groups.iter().filter(|(blocks, _)| own(blocks)).cloned();
        let (blocks, candidates): (Vec<_>, Vec<_>) = touched.unzip();
        let (blocks, candidates) = (blocks.concat(), candidates.concat());
        self.place_of(base, &blocks, &candidates)
    }

    /// The same of some blocks and the candidates on them.
    pub(super) fn place_of(
        &self,
        base: &Hypothesis,
        blocks: &[usize],
        candidates: &[usize],
    ) -> Place {
        let x = self.coordinates(base, &self.free(blocks), candidates);
        (
            blocks.to_vec(),
            candidates.to_vec(),
            x.into_iter().map(f64::to_bits).collect(),
        )
    }

    /// Blocks about `base`, and, where that has no effect on them, also about nominal values as
    /// given: where a fit has moved those for what is missing, it may look as if there was less
    /// than nothing of that.
    fn bases(&self, base: &Hypothesis, place: &Place) -> Option<Vec<Base<'_>>> {
        let mut bases = vec![self.base(base, place)?];
        if place.1.is_empty() {
            let mut given = base.clone();
            given.fit.nominal.fill(0.0);
            bases.extend(self.base(&given, place));
        }
        Some(bases)
    }

    fn base(&self, base: &Hypothesis, (blocks, candidates, _): &Place) -> Option<Base<'_>> {
        let free = self.free(blocks);
        let x = self.coordinates(base, &free, candidates);
        let mut problem = self.problem(blocks, &free, candidates);
        let found = at(&mut problem, DVector::from_vec(x))?;
        let values = (
            &problem.nominal(&found.x)[..],
            &problem.effects(&found.x)[..],
        );
        let about = About::new(self.model, &problem, &found.residuals, values)?;
        let slopes = problem.slopes_about(&found.x, &about)?;
        let mut priors = problem.priors(&found.x);
        let (least, _) = linearized_least(&found.residuals, &slopes, &priors);
        // The candidate's share has none.
        priors.push((0.0, 0.0));
        Some(Base {
            nominal: problem.nominal(&found.x),
            residuals: found.residuals,
            about,
            slopes,
            priors,
            least,
        })
    }
}

/// The least cost of residuals that change in proportion to coordinates, and where it is. What dead
/// zones hide of the noise is added to it: a wider one promises nothing by that alone.
fn linearized_least(
    residuals: &Residuals,
    slopes: &Slopes,
    priors: &[Prior],
) -> (f64, DVector<f64>) {
    let linearized = Linearized {
        residuals,
        slopes,
        priors,
        damping: DVector::from_element(priors.len(), 1e-9),
    };
    let step = linearized.minimum();
    let rows = tally(&linearized.moved(&step), 0);
    let least = linearized.cost(&step) + rows.cost - rows.outside;
    (least, step)
}

/// `start` with the sizes that it begins with.
fn small(parameters: &[Parameter], start: &[f64]) -> Vec<f64> {
    let pairs = parameters.iter().zip(start);
    let small = pairs.map(|(p, x)| match p.neutral.map(|none| p.coordinate(none)) {
        Some(none) if !p.log => none + SMALL * (x - none),
        _ => *x,
    });
    small.collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Active, Candidate, Coordinate};
    use super::*;

    const ROWS: usize = 200;
    const NOMINAL: f64 = 10.0;
    const EFFECT: f64 = 40.0;
    const ZERO_MOST: f64 = 3.0;

    /// A nominal value that shifts all rows, an effect that also waves, and a zero of the sensor,
    /// which shifts all rows too, but not far.
    struct Shifted {
        nominal_blocks: Vec<Vec<usize>>,
        candidates: Vec<Candidate>,
        /// The effect in the records.
        there: f64,
    }

    impl Shifted {
        fn of(there: f64, least: f64) -> Shifted {
            let parameter = Parameter {
                name: "size",
                unit: "",
                range: (least, 10.0),
                usual: 1.0,
                log: false,
                neutral: Some(0.0),
                ends: [false; 2],
            };
            Shifted {
                nominal_blocks: vec![vec![0]],
                candidates: vec![Candidate {
                    effect: "waves",
                    form: "waves",
                    parameters: vec![parameter],
                    blocks: vec![0],
                    form_doubt: 0.0,
                }],
                there,
            }
        }

        fn missed(&self, nominal: f64, effects: &[Active]) -> Vec<f64> {
            let effect: f64 = effects.iter().map(|(_, values)| values[0]).sum();
            let shape = |row: usize| 1.0 + 0.5 * (0.7 * row as f64).sin();
            let of = |row| NOMINAL * nominal + EFFECT * (effect - self.there) * shape(row);
            (0..ROWS).map(of).collect()
        }
    }

    impl Model for Shifted {
        fn records(&self) -> usize {
            1
        }
        fn fitted(&self) -> usize {
            1
        }
        fn blocks(&self) -> &[&'static str] {
            &["shifted"]
        }
        fn nominal_blocks(&self) -> &[Vec<usize>] {
            &self.nominal_blocks
        }
        fn candidates(&self) -> &[Candidate] {
            &self.candidates
        }
        fn residuals(
            &self,
            _: usize,
            _: usize,
            nominal: &[f64],
            effects: &[Active],
        ) -> Option<Residuals> {
            let mut rows = self.missed(nominal[0], effects);
            let mean = rows.iter().sum::<f64>() / (ROWS as f64 + 1.0);
            let zero = mean.clamp(-ZERO_MOST, ZERO_MOST);
            for row in &mut rows {
                *row -= zero;
            }
            rows.push(zero);
            Some(Residuals::exact(rows))
        }
        fn residuals_as_expected(
            &self,
            _: usize,
            _: usize,
            nominal: &[f64],
            effects: &[Active],
        ) -> Option<Residuals> {
            let mut rows = self.missed(nominal[0], effects);
            rows.push(0.0);
            Some(Residuals::exact(rows))
        }
        fn rows(&self, _: usize, _: usize) -> usize {
            ROWS + 1
        }
        fn unknowns(&self, _: usize) -> usize {
            1
        }
        fn proportional(&self, _: usize) -> bool {
            true
        }
        fn context(&self, _: usize, _: usize) -> Vec<Coordinate> {
            Vec::new()
        }
    }

    /// The zero is free at the fit without effects and would take up all that the nominal value
    /// does, so that this seems to do nothing: with both in proportion an effect promises little.
    #[test]
    fn a_bounded_zero_does_not_hide_what_an_effect_promises() {
        let model = Shifted::of(1.0, -10.0);
        let engine = Engine::new(&model);
        let null = engine.hypothesis(&[]).expect("a fit");
        let promised = engine.promises(&null).expect("promises")[0];
        let gained = null.fit.score() - engine.hypothesis(&[0]).expect("a fit").fit.score();
        assert!(gained > 5000.0, "{gained}");
        assert!(
            (promised / gained - 1.0).abs() < 0.05,
            "{promised} of {gained}"
        );
    }

    /// Where the records have less than none of an effect whose size has one sign.
    #[test]
    fn an_effect_promises_nothing_by_the_wrong_sign() {
        let promised = |there: f64, least: f64| {
            let model = Shifted::of(there, least);
            let engine = Engine::new(&model);
            let null = engine.hypothesis(&[]).expect("a fit");
            engine.promises(&null).expect("promises")[0]
        };
        assert!(promised(1.0, 0.0) > 5000.0);
        assert!(promised(-1.0, -10.0) > 5000.0);
        assert_eq!(promised(-1.0, 0.0), 0.0);
    }
}

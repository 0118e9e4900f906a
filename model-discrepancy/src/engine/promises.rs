//! What effects promise beside those that are there, before they are fitted.

use super::marginal::BesideLaws;
use super::{
    About, Candidate, EFFECT_PRIOR, Engine, Hypothesis, Key, Model, Parameter, Problem, starts,
    tally,
};
use crate::least_squares::{Linearized, Prior, Problem as _, Residuals, Slopes, at};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Share of the largest promise from a first start up to which others are not looked at.
const SHARE_OF_FIRST: f64 = 0.1;
/// Share of a start at which an effect begins.
const SMALL: f64 = 1e-2;
/// Dead zones that change by less than this share of what their values do matter little to a
/// promise.
const WIDENS: f64 = 0.1;

/// Blocks that stand or fall together, the candidates on them, and the bits of where those and the
/// nominal values are: what a promise depends on.
pub(super) type Place = (Vec<usize>, Vec<usize>, Vec<u64>);

/// Bases by place, each with what it costs alone.
type Bases<'a, 'p> = BTreeMap<&'p Place, Vec<(Base<'a>, f64)>>;

/// Some blocks of a hypothesis, linearized.
struct Base<'a> {
    nominal: Vec<f64>,
    residuals: Residuals,
    about: About<'a>,
    slopes: Slopes,
    priors: Vec<Prior>,
}

impl<M: Model> Engine<'_, M> {
    /// What each candidate promises beyond `base`: by how much it would lower the cost of all
    /// records, if residuals changed in proportion to it, nominal values and effects of `base`
    /// moved with it; the best of its starts. The predicted records count, as an effect may not be
    /// moved in the others. Costs one evaluation a start, or two. A candidate is tried from its
    /// first start only if, beside others, that promises little, or, where there are none, all its
    /// blocks have dead zones, in which promises cannot be believed; an effect of `base` promises
    /// nothing. What was promised where `base` is no other is known.
    pub fn promises(&self, base: &Hypothesis) -> Option<Vec<f64>> {
        let all = self.model.candidates();
        let groups = self.groups(&base.candidates);
        let places = (0..all.len()).map(|c| self.place(base, &groups, c));
        let places: Vec<Place> = places.collect();
        let has = |effect| base.candidates.iter().any(|own| all[*own].effect == effect);
        let known: Vec<Option<(f64, bool)>> = {
            let promised = self.promised.lock().ok()?;
            let known = |(c, place): (usize, &Place)| {
                let known = promised.get(&(place.clone(), c)).copied();
                has(all[c].effect).then_some((0.0, true)).or(known)
            };
            places.iter().enumerate().map(known).collect()
        };
        let mut bases = BTreeMap::new();
        let is_new = |c: &usize| known[*c].is_none();
        let new = (0..all.len()).filter(is_new).map(|c| &places[c]);
        self.add_bases(&mut bases, base, new)?;
        let promise = |bases: &Bases, c: usize, start: &[f64]| {
            let is_signed = places[c].1.is_empty() && !all[c].has_two_signs();
            self.promise(&bases[&places[c]], base, (c, start), is_signed)
        };
        let starts: Vec<_> = all.iter().map(|c| starts(&c.parameters)).collect();
        let first = (0..all.len()).into_par_iter().map(|c| {
            let start = starts[c].first()?;
            let tried = || {
                // Also as it begins: what is large moves what takes its place, or leaves a dead
                // zone.
                let begins = || promise(&bases, c, &small(&all[c].parameters, start));
                let begins = (!self.is_proportional(&all[c])).then(begins).flatten();
                [promise(&bases, c, start), begins]
            };
            let new = || tried().into_iter().flatten().reduce(f64::max);
            known[c].map(|(promise, _)| promise).or_else(new)
        });
        let first: Vec<Option<f64>> = first.collect();
        let most = first.iter().flatten().copied().fold(0.0, f64::max);
        let is_left = |c: usize| {
            let Some(promise) = first[c] else {
                return false;
            };
            if base.candidates.is_empty() {
                let mut blocks = all[c].blocks.iter();
                blocks.all(|block| !self.model.proportional(*block))
            } else {
                // In blocks of their own the others are none.
                !places[c].1.is_empty() && promise.max(0.0) < SHARE_OF_FIRST * most
            }
        };
        let was_all = |c: usize| known[c].is_some_and(|(_, of_all)| of_all);
        let is_open = |c: &usize| !was_all(*c) && !is_left(*c);
        let has_more = |c: &usize| is_open(c) && starts[*c].len() > 1;
        let open = (0..all.len()).filter(has_more).map(|c| &places[c]);
        self.add_bases(&mut bases, base, open)?;
        let best = |c: usize| {
            let first_promise = first[c].unwrap_or(0.0).max(0.0);
            let others = if is_open(&c) { &starts[c][..] } else { &[] };
            let others = others.par_iter().skip(1);
            let others = others.filter_map(|start| promise(&bases, c, start));
            (
                others.reduce(|| first_promise, f64::max),
                was_all(c) || is_open(&c),
            )
        };
        let promises: Vec<(f64, bool)> = (0..all.len()).into_par_iter().map(best).collect();
        let mut promised = self.promised.lock().ok()?;
        for (c, place) in places.into_iter().enumerate() {
            if !was_all(c) {
                promised.insert((place, c), promises[c]);
            }
        }
        Some(promises.into_iter().map(|(promise, _)| promise).collect())
    }

    /// Adds the bases of those `places` that have none.
    fn add_bases<'e, 'p>(
        &'e self,
        bases: &mut Bases<'e, 'p>,
        hypothesis: &Hypothesis,
        places: impl Iterator<Item = &'p Place>,
    ) -> Option<()> {
        for place in places {
            if !bases.contains_key(place) {
                bases.insert(place, self.bases(hypothesis, place)?);
            }
        }
        Some(())
    }

    /// Whether one of some candidates promises more than `least` of it beside `base` and what laws
    /// of its effects, or a sound rig, may leave: by how much it would raise the log density, if
    /// residuals changed in proportion to it and all but the processes moved with it. True where
    /// that cannot be said.
    pub fn is_promising(
        &self,
        base: &Hypothesis,
        candidates: &[usize],
        least: impl Fn(usize) -> f64 + Sync,
    ) -> bool {
        let groups = self.groups(&base.candidates);
        let mut by_place: BTreeMap<Place, Vec<usize>> = BTreeMap::new();
        for c in candidates {
            let place = self.place(base, &groups, *c);
            by_place.entry(place).or_default().push(*c);
        }
        by_place.iter().any(|((blocks, own, _), candidates)| {
            let Some((own_base, laws)) = self.base_beside_laws(base, (blocks, own)) else {
                return true;
            };
            let candidates = candidates.par_iter();
            candidates.any(|c| self.is_more_than(least(*c), (&own_base, &laws), base, *c))
        })
    }

    /// Whether one candidate promises more than `least` beside laws, from any of its starts.
    fn is_more_than(
        &self,
        least: f64,
        (base, laws): (&Base, &BesideLaws),
        hypothesis: &Hypothesis,
        c: usize,
    ) -> bool {
        let candidate = &self.model.candidates()[c];
        // With laws and all values free there is nothing that takes up what is missing.
        let is_right = |share: f64| share > 0.0 || candidate.has_two_signs();
        let promises = |start: &[f64], scale: f64| {
            let change = self.change(base, hypothesis, (c, start));
            let promised = change.map(|change| promised_beside_laws(base, laws, &change, scale));
            let mut promised = promised.into_iter().flatten().flatten();
            promised.any(|(promise, share)| is_right(share) && promise > least)
        };
        let starts = starts(&candidate.parameters);
        let mut starts = starts.iter();
        starts.any(|start| {
            let begins = || promises(&small(&candidate.parameters, start), SMALL);
            promises(start, 1.0) || !self.is_proportional(candidate) && begins()
        })
    }

    /// Whether each block that `candidate` acts on changes about in proportion to it.
    fn is_proportional(&self, candidate: &Candidate) -> bool {
        let mut blocks = candidate.blocks.iter();
        blocks.all(|block| self.model.proportional(*block))
    }

    /// What a candidate promises from `start` about the first of some bases of `hypothesis`. Where
    /// it `is_signed` it promises nothing if all of them say so: the problem is convex, and what
    /// gains by less of it than none gains nothing by any.
    fn promise(
        &self,
        bases: &[(Base, f64)],
        hypothesis: &Hypothesis,
        (c, start): (usize, &[f64]),
        is_signed: bool,
    ) -> Option<f64> {
        let mut gains = bases.iter().filter_map(|(base, alone)| {
            let change = self.change(base, hypothesis, (c, start))?;
            let with = base.slopes.beside(&change);
            // The candidate's share has no prior.
            let priors = [&base.priors[..], &[(0.0, 0.0)]].concat();
            let (linearized, step) = linearized(&base.residuals, &with, &priors);
            let is_wrong = is_signed && step[step.len() - 1] < 0.0;
            Some(if is_wrong {
                0.0
            } else {
                alone - least(&linearized, &step)
            })
        });
        let first = gains.next()?;
        Some(if first > 0.0 || !is_signed {
            first
        } else {
            gains.fold(first, f64::max)
        })
    }

    /// How a candidate changes the blocks of a base of `hypothesis`.
    fn change(
        &self,
        base: &Base,
        hypothesis: &Hypothesis,
        (c, start): (usize, &[f64]),
    ) -> Option<Slopes> {
        let candidate = &self.model.candidates()[c];
        let values = candidate.parameters.iter().zip(start);
        let mut with = hypothesis.fit.effects.clone();
        with.push((c, values.map(|(p, x)| p.value(*x)).collect()));
        let with = (&base.nominal[..], &with[..]);
        let moves = |block| candidate.blocks.contains(&block);
        self.problem(&[], &[], &[])
            .change(&base.about, &moves, with)
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

    /// What a promise of a candidate beside `base`, whose blocks are tied in `groups`, depends on.
    fn place(&self, base: &Hypothesis, groups: &[Key], candidate: usize) -> Place {
        let touched = self.touched(groups, candidate).cloned();
        let (blocks, candidates): (Vec<_>, Vec<_>) = touched.unzip();
        self.place_of(base, &blocks.concat(), &candidates.concat())
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
    ///
    /// Each with its cost where the hypothesis has moved as it would alone: that is nobody's
    /// promise.
    fn bases(&self, base: &Hypothesis, place: &Place) -> Option<Vec<(Base<'_>, f64)>> {
        let mut bases = vec![self.base(base, place)?];
        if place.1.is_empty() {
            let mut given = base.clone();
            given.fit.nominal.fill(0.0);
            bases.extend(self.base(&given, place));
        }
        Some(bases)
    }

    fn base(&self, base: &Hypothesis, (blocks, candidates, _): &Place) -> Option<(Base<'_>, f64)> {
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
        let priors = problem.priors(&found.x);
        let (linearized, step) = linearized(&found.residuals, &slopes, &priors);
        let alone = least(&linearized, &step);
        let base = Base {
            nominal: problem.nominal(&found.x),
            residuals: found.residuals,
            about,
            slopes,
            priors,
        };
        Some((base, alone))
    }

    /// Blocks about `base` with the laws of its effects, and what is left beside these.
    fn base_beside_laws(
        &self,
        base: &Hypothesis,
        group: (&[usize], &[usize]),
    ) -> Option<(Base<'_>, BesideLaws)> {
        let expanded = self.expanded(base.clone(), group)?;
        let laws = expanded.beside_laws()?;
        let free = self.free(group.0);
        let problem = self.problem(group.0, &free, group.1);
        let found = expanded.found;
        let of_laws = || expanded.of_laws.iter();
        let deviations = of_laws().flat_map(|law| &law.deviations);
        let mut priors = problem.priors(&found.x);
        priors.extend(deviations.map(|deviation| (0.0, deviation.recip())));
        let shapes: Vec<_> = of_laws().flat_map(|law| &law.shapes).collect();
        let rows = found.residuals.values.len();
        let slopes = expanded.slopes.beside(&Slopes {
            values: DMatrix::from_fn(rows, shapes.len(), |row, place| shapes[place][(row, 0)]),
            slack: DMatrix::zeros(rows, shapes.len()),
        });
        let base = Base {
            nominal: problem.nominal(&found.x),
            residuals: found.residuals,
            about: expanded.about,
            slopes,
            priors,
        };
        Some((base, laws))
    }
}

/// By how much the log density grows by shares of `change`, of an effect of this `scale` of its
/// start, beside laws, and these shares: by its values alone and, as of a wider dead zone the
/// evidence is not linear, where the cost would be least with that.
fn promised_beside_laws(
    base: &Base,
    laws: &BesideLaws,
    change: &Slopes,
    scale: f64,
) -> [Option<(f64, f64)>; 2] {
    let of_values = Some(laws.gain(&change.values));
    if change.slack.norm() <= WIDENS * change.values.norm() {
        return [of_values, None];
    }
    let with = base.slopes.beside(change);
    // Without a prior of the share what is best is a zone without end.
    let priors = [&base.priors[..], &[(0.0, scale / EFFECT_PRIOR)]].concat();
    let (linearized, mut step) = linearized(&base.residuals, &with, &priors);
    let last = step.len() - 1;
    let share = step[last];
    step.rows_mut(0, last).fill(0.0);
    let widened = laws.gain_of(&linearized.moved(&step));
    [of_values, widened.map(|gain| (gain, share))]
}

/// Residuals that change in proportion to coordinates, and where their cost is least.
fn linearized<'a>(
    residuals: &'a Residuals,
    slopes: &'a Slopes,
    priors: &'a [Prior],
) -> (Linearized<'a>, DVector<f64>) {
    let linearized = Linearized {
        residuals,
        slopes,
        priors,
        damping: DVector::from_element(priors.len(), 1e-9),
    };
    let step = linearized.minimum();
    (linearized, step)
}

/// The least cost. What dead zones hide of the noise is added to it: a wider one promises nothing
/// by that alone.
fn least(linearized: &Linearized, step: &DVector<f64>) -> f64 {
    let rows = tally(&linearized.moved(step), 0);
    linearized.cost(step) + rows.cost - rows.outside
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
            let own = effects.iter().filter(|own| own.0 == 0);
            let effect: f64 = own.map(|(_, values)| values[0]).sum();
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

    /// One with which nothing changes, beside another at whose fit the zero is not as expected.
    #[test]
    fn what_does_nothing_promises_nothing() {
        let mut model = Shifted::of(1.0, -10.0);
        let mut idle = model.candidates[0].clone();
        idle.effect = "idle";
        model.candidates.push(idle);
        let engine = Engine::new(&model);
        let fitted = engine.hypothesis(&[0]).expect("a fit");
        let mut off = fitted.clone();
        off.fit.nominal[0] += 1.0;
        for base in [&fitted, &off] {
            assert!(!engine.is_promising(base, &[1], |_| 1e-6));
        }
    }
}

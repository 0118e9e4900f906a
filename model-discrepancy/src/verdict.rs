//! The choice between hypotheses: which effects are missing, and when nothing may be named.
//!
//! Effects are tried alone, then in pairs and more: each set that leads, over all, over one block
//! alone, near the nominal values or where it was fitted, is joined with what promises most beyond
//! it. A set is taken if each of its members is needed: without it much of what is then left would
//! be explained by nothing else. What promises most in a member's place is tried there, and of sets
//! that cannot be told apart the one with the fewest parameters is taken. What the set leaves, and
//! where its values are, decide whether it is named at all.

use super::engine::{Active, Engine, Fit, Hypothesis, Model, OtherForm, Part, Tally};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Mutex;

/// Names that lead over all, and over each block alone.
const LEADERS: [usize; 2] = [2, 2];
/// Names that are tried beside a leader.
const FOLLOWERS: usize = 3;
/// Forms of an effect that are tried before it leads, where promises can be believed, beside those
/// that promise no less than one over this of theirs.
const FORMS: usize = 2;
const BETTER: f64 = 2.0;
/// Leading sets of which every form is tried.
const VARIED: usize = 3;
/// Leading sets whose fit is made exact.
const POLISHED: usize = 4;
/// Share of what some of a set gains that the rest must gain before its other forms are tried: as
/// much as its form may leave where forms are known best.
const SHARE_OF_PART: f64 = 0.05 * 0.05;
/// Effects that are named together at most, and what it is to try so many.
const MEMBERS: usize = 3;
const STAGES: [&str; MEMBERS] = ["effects alone", "two effects", "three effects"];
/// Mean square of residuals, tamed, up to which a block is as good as its noise.
pub const NOISE_ONLY: f64 = 1.3;
/// Gain in cost that noise alone does not give: of 75 healthy rigs the best gained 19. Also what a
/// calibration within the tolerances costs at most: of theirs the farthest cost 8.
const GAIN: f64 = 24.0;
/// Cost by which the free motion may be worse than with nothing: where a weight sticks is chance.
const WORSE: f64 = 16.0;
/// Promised gain that is worth a fit where nothing is above the noise.
const PROMISE: f64 = 10.0;
/// Share of what another effect on no other block promises that is worth a fit.
const SHARE_OF_PROMISE: f64 = 0.03;
/// The same where calibration has taken nominal values far, so that no promise is sure: single
/// effects were seen to promise 0.26 of it there at least.
const SHARE_OF_PROMISE_FAR: f64 = 0.01;
/// Gain that each parameter of an effect gives by itself, with room.
const GAIN_PARAMETER: f64 = 4.0;
/// Share of what is left without an effect that the effect must explain.
const SHARE_OF_MEMBER: f64 = 0.4;
/// Share of what other forms of the others leave that it must explain if they explain more than it.
const SHARE_OF_REST: f64 = 0.2;
/// A size is none below this share of the usual one.
const NOTHING: f64 = 1e-6;
/// Share by which forms of the others are doubted where nothing is above the noise without a
/// member.
const DOUBT_WHERE_QUIET: f64 = 0.12;
/// Share of what its blocks cost without it that it must gain beside others: what their forms leave
/// is not white, and weighs more than noise.
const SHARE_OF_WHOLE: f64 = 0.05;
/// Share of what a member gains that nominal values may be moved for it.
const SHARE_OF_CALIBRATION: f64 = 0.01;
/// What nominal values may cost beside what is gained.
const SHARE_OF_PRIOR: f64 = 0.05;
/// Share of what is above the noise that all named effects must explain.
pub const SHARE: f64 = 0.7;
/// The same where they plainly leave something in a block that they change: half the square of two
/// noises. Of hidden effects the right name has left less than two tenths there, also in another
/// form, and so it does on real rigs; a wrong one in its place up to three.
const SHARE_PLAIN: f64 = 0.8;
const PLAIN: f64 = 2.0;
/// The same of effects that have one form only: of 63 right ones none left anything.
const SHARE_OF_EXACT: f64 = 0.97;
/// Share of what is above the noise in one block that must be explained where it has half the
/// square of √2 noises left: less is of nominal values that the block shares with others, and the
/// rest another effect's.
const SHARE_OF_BLOCK: f64 = 1.0 / 3.0;
/// Standard deviations by which named effects may move a nominal value. In other forms than the
/// rig's, 6 of 854 right ones moved a friction or a flow gain farther, and wrong ones a γ by up to
/// 37.
pub const TOO_FAR: f64 = 10.0;
/// Share of what is above the noise that may be left before three effects are tried together.
const SHARE_LEFT: f64 = 0.15;
/// Names whose sets cost less than this more, beside what is left, cannot be told apart.
const MARGIN: f64 = 12.0;

/// What the data say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The nominal model explains the data.
    Consistent,
    /// The named effects do.
    Explained,
    /// Something is left that no effect of the catalogue explains.
    Unexplained,
}

impl Verdict {
    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Explained => "explained",
            Verdict::Unexplained => "unexplained",
            Verdict::Consistent => "consistent",
        }
    }
}

/// What was chosen.
pub struct Choice {
    /// The verdict.
    pub verdict: Verdict,
    /// Without any effect.
    pub null: Hypothesis,
    /// The best set of effects, named or not.
    pub best: Hypothesis,
    /// Share of what was above the noise that `best` explains.
    pub share: f64,
    /// For each candidate of `best`: other effects that would do as well in its place.
    pub alternatives: Vec<Vec<&'static str>>,
    /// Blocks in which something is left beside what is named.
    pub left: Vec<usize>,
    /// Nothing is left there but what calibration has taken up, far outside the tolerances.
    pub far: bool,
    /// All that was tried, best first.
    pub tried: Vec<Hypothesis>,
}

impl Choice {
    /// What the rig is taken to be: the best set, if it is named.
    pub fn taken(&self) -> &Hypothesis {
        match self.verdict {
            Verdict::Unexplained | Verdict::Consistent => &self.null,
            Verdict::Explained => &self.best,
        }
    }
}

/// What residuals have above their noise.
fn excess_in(tally: &Tally) -> f64 {
    (tally.outside - 0.5 * NOISE_ONLY * tally.count as f64).max(0.0)
}

/// What a block has above its noise, fitted and predicted.
fn excess_of(fit: &Fit, block: usize) -> f64 {
    let parts = fit.parts.iter().filter(|part| part.block == block);
    parts.map(|part| excess_in(&part.total())).sum()
}

fn excess(fit: &Fit) -> f64 {
    let blocks = fit.parts.iter().map(|part| excess_of(fit, part.block));
    blocks.sum::<f64>()
}

fn predicted(fit: &Fit) -> f64 {
    fit.parts.iter().map(|part| part.predicted.cost).sum()
}

/// What is being done.
#[derive(Clone, Debug)]
pub enum Step {
    /// A stage begins, in which so many sets of effects are tried, if any.
    Stage(&'static str, usize),
    /// A set of effects is tried.
    Try(Vec<&'static str>),
}

/// Is told what is being done, from any thread.
pub type Watch<'a> = &'a (dyn Fn(Step) + Sync);

struct Search<'a, 'b, M> {
    engine: &'b Engine<'a, M>,
    watch: Watch<'b>,
    /// All that was tried.
    tried: Vec<Hypothesis>,
    /// What is needed beyond other forms: a set and its cost, a member's place, and the same of
    /// what is without it.
    beyond: Mutex<HashMap<(Compared, usize, Compared), bool>>,
}

/// A set as it was compared: its candidates, and the bits of its cost.
type Compared = (Vec<usize>, u64);

fn compared(hypothesis: &Hypothesis) -> Compared {
    let cost = hypothesis.fit.score().to_bits();
    (hypothesis.candidates.clone(), cost)
}

impl<M: Model> Search<'_, '_, M> {
    fn name(&self, candidate: usize) -> &'static str {
        self.engine.model.candidates()[candidate].effect
    }

    fn names(&self, candidates: &[usize]) -> Vec<&'static str> {
        candidates.iter().map(|c| self.name(*c)).collect()
    }

    fn parameters(&self, candidates: &[usize]) -> usize {
        let all = self.engine.model.candidates();
        candidates.iter().map(|c| all[*c].parameters.len()).sum()
    }

    /// Cost with what parameters gain by themselves.
    fn score(&self, hypothesis: &Hypothesis) -> f64 {
        hypothesis.fit.score() + self.gain_of_parameters(hypothesis)
    }

    /// The same of what was fitted alone.
    fn fitted_score(&self, hypothesis: &Hypothesis) -> f64 {
        hypothesis.fit.fitted_score() + self.gain_of_parameters(hypothesis)
    }

    fn gain_of_parameters(&self, hypothesis: &Hypothesis) -> f64 {
        GAIN_PARAMETER * self.parameters(&hypothesis.candidates) as f64
    }

    /// What was tried without any effect.
    fn null(&self) -> Option<&Hypothesis> {
        self.of_size(0).next()
    }

    /// What was tried with so many members, best first.
    fn of_size(&self, members: usize) -> impl Iterator<Item = &Hypothesis> {
        let tried = self.tried.iter();
        tried.filter(move |h| h.candidates.len() == members)
    }

    fn sort(&mut self) {
        let mut tried = std::mem::take(&mut self.tried);
        tried.sort_by(|a, b| {
            let by_score = self.score(a).total_cmp(&self.score(b));
            by_score.then_with(|| a.candidates.cmp(&b.candidates))
        });
        self.tried = tried;
    }

    /// Fits `sets`, and makes the leading ones exact.
    fn try_all(&mut self, sets: &[Vec<usize>]) {
        let Some(members) = sets.first().map(Vec::len) else {
            return;
        };
        let fitted: Vec<Hypothesis> = sets
            .par_iter()
            .filter_map(|set| {
                (self.watch)(Step::Try(self.names(set)));
                self.engine.hypothesis(set)
            })
            .collect();
        self.tried.extend(fitted);
        self.sort();
        self.polish(members);
    }

    /// Makes the leading sets of `members` exact.
    fn polish(&mut self, members: usize) {
        let leading: Vec<Hypothesis> = self
            .of_size(members)
            .take(POLISHED)
            .filter(|h| !h.polished)
            .cloned()
            .collect();
        let polished: Vec<Hypothesis> = leading
            .par_iter()
            .filter_map(|h| self.engine.polished(h))
            .collect();
        self.improve(polished);
    }

    /// Keeps what is better than the same set is so far.
    fn improve(&mut self, found: Vec<Hypothesis>) {
        for new in found {
            let same = |h: &&mut Hypothesis| h.candidates == new.candidates;
            match self.tried.iter_mut().find(same) {
                Some(known) if new.fit.score() < known.fit.score() => {
                    *known = new;
                }
                Some(known) => known.polished |= new.polished,
                None => self.tried.push(new),
            }
        }
        self.sort();
    }

    /// Of sets in order of preference, the first `count` that differ in their names.
    fn distinct(&self, sets: impl Iterator<Item = Vec<usize>>, count: usize) -> Vec<Vec<usize>> {
        let mut names: Vec<Vec<&str>> = Vec::new();
        let mut distinct = Vec::new();
        for set in sets {
            let of_set = self.names(&set);
            if distinct.len() < count && !names.contains(&of_set) {
                names.push(of_set);
                distinct.push(set);
            }
        }
        distinct
    }

    /// The sets of `members` that lead.
    fn leaders(&self, null: &Hypothesis, members: usize) -> Vec<Vec<usize>> {
        let mut leaders = self.leading(members, LEADERS[0]);
        if members > 1 {
            leaders.truncate(1);
            return leaders;
        }
        // What leads may have taken the rig far, where nothing is named; and what is needed for the
        // fit may predict badly until another effect is beside it.
        let near = |h: &Hypothesis| self.score(h) + h.fit.prior / SHARE_OF_PRIOR;
        let fitted = |h: &Hypothesis| self.fitted_score(h);
        for cost in [&near as &dyn Fn(&Hypothesis) -> f64, &fitted] {
            let least = self
                .of_size(members)
                .min_by(|a, b| cost(a).total_cmp(&cost(b)));
            let least = least.map(|least| least.candidates.clone());
            leaders.extend(least.filter(|least| !leaders.contains(least)));
        }
        for part in &null.fit.parts {
            if excess_of(&null.fit, part.block) < GAIN {
                continue;
            }
            let all = self.engine.model.candidates();
            let touches = |h: &&Hypothesis| match h.candidates[..] {
                [candidate] => all[candidate].blocks.contains(&part.block),
                _ => false,
            };
            let touching: Vec<&Hypothesis> = self.tried.iter().filter(touches).collect();
            let alone = touching.par_iter().filter_map(|single| {
                let cost = self.engine.cost_alone(part.block, single)?;
                Some((cost, single.candidates[0]))
            });
            let mut alone: Vec<(f64, usize)> = alone.collect();
            alone.sort_by(|a, b| a.0.total_cmp(&b.0));
            let sets = alone.into_iter().map(|(_, candidate)| vec![candidate]);
            for leader in self.distinct(sets, LEADERS[1]) {
                if !leaders.contains(&leader) {
                    leaders.push(leader);
                }
            }
        }
        leaders
    }

    /// Whether no candidate promises more than noise gives.
    fn only_noise(&self, promises: &[f64]) -> bool {
        let mut promises = promises.iter().enumerate();
        promises.all(|(candidate, promise)| {
            promise - GAIN_PARAMETER * (self.parameters(&[candidate]) as f64) < GAIN
        })
    }

    /// Leaders joined with what promises most beside them.
    fn joined(&self, leaders: &[Vec<usize>]) -> Vec<Vec<usize>> {
        let mut sets = Vec::new();
        for leader in leaders {
            for set in self.beside(leader, &[]) {
                if !sets.contains(&set) {
                    sets.push(set);
                }
            }
        }
        sets
    }

    /// A set that was tried with what promises most beside it, of other names than its own and
    /// `barred` ones.
    fn beside(&self, leader: &[usize], barred: &[&str]) -> Vec<Vec<usize>> {
        let known = self.tried.iter().find(|h| h.candidates == leader);
        let Some(promises) = known.and_then(|known| self.engine.promises(known)) else {
            return Vec::new();
        };
        let mut order: Vec<usize> = (0..promises.len()).collect();
        order.sort_by(|a, b| promises[*b].total_cmp(&promises[*a]));
        order.retain(|candidate| {
            let blocks = &self.engine.model.candidates()[*candidate].blocks;
            let certain = blocks
                .iter()
                .all(|block| self.engine.model.proportional(*block));
            let name = self.name(*candidate);
            let mut own = leader.iter().map(|own| self.name(*own));
            let new = !own.any(|own| own == name) && !barred.contains(&name);
            new && (promises[*candidate] > PROMISE || !certain)
        });
        let followers = order.into_iter().map(|candidate| vec![candidate]);
        let followers = self.distinct(followers, FOLLOWERS).into_iter();
        let sets = followers.map(|follower| {
            let mut set = [leader, &follower[..]].concat();
            set.sort_unstable();
            set
        });
        sets.collect()
    }

    /// The sets of `members` that cost least, with different names.
    fn leading(&self, members: usize, count: usize) -> Vec<Vec<usize>> {
        let sets = self.of_size(members).map(|h| h.candidates.clone());
        self.distinct(sets, count)
    }

    /// Leading sets of which other forms are tried: none that fits no better than some of it does.
    fn varied(&self, members: usize) -> Vec<Vec<usize>> {
        let cost = |h: &Hypothesis| self.fitted_score(h);
        let null = self.null();
        let idle = |set: &&Hypothesis| {
            let mut parts = self.tried.iter().filter(|h| h.candidates.len() < members);
            parts.any(|part| {
                let gained = null.map_or(0.0, |null| cost(null) - cost(part));
                part.candidates
                    .iter()
                    .all(|own| set.candidates.contains(own))
                    && cost(part) - cost(set) < GAIN.max(SHARE_OF_PART * gained)
            })
        };
        let moved = self.of_size(members).filter(|set| !idle(set));
        self.distinct(moved.map(|h| h.candidates.clone()), VARIED)
    }

    /// The leading sets with one member each time in another form of the same effect.
    fn variants(&self, members: usize) -> Vec<Vec<usize>> {
        let all = self.engine.model.candidates();
        let mut variants = Vec::new();
        for set in self.varied(members) {
            for (place, own) in set.iter().enumerate() {
                for other in 0..all.len() {
                    let mut variant = set.clone();
                    variant[place] = other;
                    variant.sort_unstable();
                    let known = self.tried.iter().any(|h| h.candidates == variant);
                    if all[other].effect == all[*own].effect && !known {
                        variants.push(variant);
                    }
                }
            }
        }
        variants
    }

    /// Fits other forms of the members of the leading sets once more, from where these are.
    fn reform(&mut self, members: usize) {
        let all = self.engine.model.candidates();
        let mut forms = Vec::new();
        for set in self.varied(members) {
            let Some(of) = self.tried.iter().find(|h| h.candidates == set) else {
                continue;
            };
            for own in set {
                let others = (0..all.len()).filter(|c| all[*c].effect == all[own].effect);
                let others = others.filter(|form| *form != own);
                forms.extend(others.map(|form| OtherForm { of, own, form }));
            }
        }
        (self.watch)(Step::Stage("other forms from there", forms.len()));
        let reformed = self.engine.reformed(&forms);
        self.improve(reformed);
        self.polish(members);
    }

    /// Tries what promises most in the place of each member of `best`. Whether there was any.
    fn replace(&mut self, best: &Hypothesis) -> bool {
        let mut sets = Vec::new();
        for place in 0..best.candidates.len() {
            let mut others = best.candidates.clone();
            let own = self.name(others.remove(place));
            sets.extend(self.beside(&others, &[own]));
        }
        sets.retain(|set| self.tried.iter().all(|h| h.candidates != *set));
        (self.watch)(Step::Stage("others in their place", sets.len()));
        self.try_all(&sets);
        !sets.is_empty()
    }

    /// Fits a set without each of its members from where the others are in it.
    fn reduce(&mut self, set: &Hypothesis) {
        let members = set.candidates.len();
        (self.watch)(Step::Stage("without each of them", members));
        self.improve(self.engine.reduced(set));
        self.polish(members - 1);
        // What was found for some blocks is part of other sets, too.
        let again = self.of_size(members).take(POLISHED);
        let again = again.filter_map(|h| self.engine.hypothesis(&h.candidates));
        let again: Vec<Hypothesis> = again.collect();
        self.improve(again);
        self.polish(members);
    }

    /// The best set whose members are all needed, also once it was reduced.
    fn taken_reduced(&mut self) -> Option<Hypothesis> {
        let mut reduced: Vec<Vec<usize>> = Vec::new();
        loop {
            let taken = self.taken()?;
            if taken.candidates.is_empty() || reduced.contains(&taken.candidates) {
                return Some(taken);
            }
            self.reduce(&taken);
            reduced.push(taken.candidates);
        }
    }

    /// What is left of the leading sets that are varied without one of their members.
    fn subsets(&self, members: usize) -> Vec<Vec<usize>> {
        let mut subsets = Vec::new();
        for set in self.varied(members) {
            for place in 0..members {
                let mut subset = set.clone();
                subset.remove(place);
                let known = self.tried.iter().any(|h| h.candidates == subset);
                if !known && !subsets.contains(&subset) {
                    subsets.push(subset);
                }
            }
        }
        subsets
    }

    /// Whether an effect does nothing with its values.
    fn vanishes(&self, (candidate, values): &Active) -> bool {
        let parameters = &self.engine.model.candidates()[*candidate].parameters;
        let pairs = parameters.iter().zip(values);
        let sizes = || pairs.clone().filter_map(|(p, v)| Some((p, v - p.neutral?)));
        sizes().next().is_some() && sizes().all(|(p, size)| size.abs() < NOTHING * p.usual.abs())
    }

    /// Whether each member of `hypothesis` is needed.
    fn needed(&self, hypothesis: &Hypothesis) -> bool {
        let names = self.names(&hypothesis.candidates);
        if (1..names.len()).any(|place| names[..place].contains(&names[place])) {
            return false;
        }
        let own = self.score(hypothesis);
        let null = self.null();
        if hypothesis
            .fit
            .effects
            .iter()
            .any(|active| self.vanishes(active))
        {
            return false;
        }
        // What makes the free motion worse than nothing does is no explanation, unless nothing has
        // to take a rig far from the nominal one for it.
        let worse = |null: &Hypothesis| {
            let nearer = (null.fit.prior - hypothesis.fit.prior).max(0.0);
            hypothesis.fit.free_run > null.fit.free_run + nearer + WORSE
        };
        if null.is_some_and(worse) {
            return false;
        }
        // Nor what takes the rig for another one.
        let far = |null: &Hypothesis| {
            let gained = self.score(null) - own;
            hypothesis.fit.prior > GAIN + SHARE_OF_PRIOR * gained
        };
        if null.is_some_and(far) {
            return false;
        }
        (0..hypothesis.candidates.len()).all(|place| {
            let mut others = hypothesis.candidates.clone();
            others.remove(place);
            // In place of the member, another form of the effects that remain may do.
            let kept = |c: &usize| {
                others
                    .iter()
                    .any(|other| self.name(*other) == self.name(*c))
            };
            let keeps = |h: &&Hypothesis| {
                h.candidates.iter().all(kept) && h.candidates.len() <= hypothesis.candidates.len()
            };
            let without = self.tried.iter().find(keeps);
            without.is_some_and(|without| {
                // What is better only where it was fitted is fitted to what does not come back,
                // unless it brings nominal values back.
                let lost = predicted(&hypothesis.fit) - predicted(&without.fit);
                let nearer = (without.fit.prior - hypothesis.fit.prior).max(0.0);
                lost <= nearer + self.gain_of_parameters(hypothesis)
                    && hypothesis.fit.free_run < without.fit.free_run + nearer + GAIN
                    && self.agreed(hypothesis, place, without)
                    && self.gains(hypothesis, place, without)
                    && self.beyond_form(hypothesis, place, without)
            })
        })
    }

    /// Cost that a block may have as the noise, and how the model is solved, are not known better.
    fn doubt(&self, part: &Part) -> f64 {
        self.engine.model.doubt_of_noise(part.block) * 0.5 * part.total().count as f64
    }

    /// Whether no block that the member at `place` of `hypothesis` changes is worse for it: an
    /// encoder or a line is the same to gas, force and load.
    fn agreed(&self, hypothesis: &Hypothesis, place: usize, without: &Hypothesis) -> bool {
        let blocks = &self.engine.model.candidates()[hypothesis.candidates[place]].blocks;
        let parts = hypothesis.fit.parts.iter();
        let mut own = parts.filter(|part| blocks.contains(&part.block));
        own.all(|part| {
            let mut others = without.fit.parts.iter();
            let other = others.find(|other| other.block == part.block);
            let before = other.map(Part::total).unwrap_or_default().outside;
            part.total().outside - before <= GAIN.max(self.doubt(part))
        })
    }

    /// Whether the member at `place` of `hypothesis` explains what no other form of the other
    /// members would, which are all that is in `without`; computed once.
    fn beyond_form(&self, hypothesis: &Hypothesis, place: usize, without: &Hypothesis) -> bool {
        let key = (compared(hypothesis), place, compared(without));
        let known = || self.beyond.lock().ok()?.get(&key).copied();
        known().unwrap_or_else(|| {
            let beyond = self.is_beyond_form(hypothesis, place, without);
            if let Ok(mut known) = self.beyond.lock() {
                known.insert(key, beyond);
            }
            beyond
        })
    }

    fn is_beyond_form(&self, hypothesis: &Hypothesis, place: usize, without: &Hypothesis) -> bool {
        let mut others = hypothesis.candidates.clone();
        let own = others.remove(place);
        let tied = self.engine.tied(hypothesis, own);
        let blocks = &self.engine.model.candidates()[own].blocks;
        let parts = without.fit.parts.iter();
        let parts = parts.filter(|part| blocks.contains(&part.block));
        let left: f64 = parts.clone().map(|part| excess_in(&part.fitted)).sum();
        // Where nothing is left of what is fitted, the effect may not have been moved there, and
        // what is predicted decides.
        let (records, left, gain) = if left >= 0.5 * GAIN {
            (self.engine.model.fitted(), left, 0.5 * GAIN)
        } else {
            let left = parts.map(|part| excess_in(&part.total())).sum();
            (self.engine.model.records(), left, GAIN)
        };
        let costs = || {
            let of = (records, &tied[..]);
            let with = self.engine.reshaped(hypothesis, &others, of)?;
            let plain = self.engine.reshaped(without, &[], of)?;
            let without = self.engine.reshaped(without, &without.candidates, of)?;
            Some((with, plain, without))
        };
        costs().is_some_and(|(with, plain, reshaped)| {
            let left = left - (plain - reshaped);
            // More than another form, too, or a good part of all.
            let of_form = (plain - reshaped).min(SHARE_OF_REST * reshaped);
            reshaped - with >= gain.max(SHARE_OF_MEMBER * left).max(of_form)
        })
    }

    /// Whether the member at `place` of `hypothesis` gains enough over what is `without` it, in all
    /// or in the blocks that no other member changes.
    fn gains(&self, hypothesis: &Hypothesis, place: usize, without: &Hypothesis) -> bool {
        let gain = self.score(without) - self.score(hypothesis);
        gain >= self.asked(hypothesis, place, without)
            || gain >= GAIN && self.gains_apart(hypothesis, place, without)
    }

    /// Whether it does in these, where no form of the others can be what it explains: nor do
    /// nominal values tie them to what the others change.
    fn gains_apart(&self, hypothesis: &Hypothesis, place: usize, without: &Hypothesis) -> bool {
        let all = self.engine.model.candidates();
        let mut others = hypothesis.candidates.clone();
        let own = &all[others.remove(place)];
        let groups = self.engine.groups(&others).into_iter();
        let free = groups.filter(|(_, touching)| touching.is_empty());
        let free: Vec<usize> = free.flat_map(|(blocks, _)| blocks).collect();
        let apart = |part: &&Part| own.blocks.contains(&part.block) && free.contains(&part.block);
        let cost = |h: &Hypothesis| -> f64 {
            let parts = h.fit.parts.iter().filter(apart);
            parts.map(|part| part.total().cost).sum::<f64>() + h.fit.prior
        };
        let noise = hypothesis.fit.parts.iter().filter(apart);
        let noise: f64 = noise.map(|part| self.doubt(part)).sum();
        let moved = (hypothesis.fit.prior - without.fit.prior - GAIN) / SHARE_OF_CALIBRATION;
        let gain = cost(without) - cost(hypothesis) - GAIN_PARAMETER * own.parameters.len() as f64;
        // What another effect would explain better there is not this one's.
        let rival = |h: &Hypothesis| {
            let named = |name: &str| h.candidates.iter().any(|c| self.name(*c) == name);
            h.candidates.len() == hypothesis.candidates.len()
                && others.iter().all(|other| named(self.name(*other)))
                && !named(own.effect)
                && cost(h) < cost(hypothesis) - MARGIN
        };
        gain >= GAIN.max(noise).max(moved) && !self.tried.iter().any(rival)
    }

    /// What the member at `place` of `hypothesis` must gain over what is `without` it.
    fn asked(&self, hypothesis: &Hypothesis, place: usize, without: &Hypothesis) -> f64 {
        let all = self.engine.model.candidates();
        let blocks = &all[hypothesis.candidates[place]].blocks;
        let own = |part: &&Part| blocks.contains(&part.block);
        let noise = hypothesis.fit.parts.iter().filter(own);
        let noise = noise.map(|part| self.doubt(part));
        // Only what is fitted to the same residuals, and may have another form, leaves something.
        let others = || without.candidates.iter().map(|other| &all[*other]);
        let touching = |block: usize| others().filter(move |other| other.blocks.contains(&block));
        let beside =
            |part: &&Part| own(part) && touching(part.block).any(|other| other.form_doubt > 0.0);
        let sum = |h: &Hypothesis, of: fn(&Tally) -> f64| -> f64 {
            let parts = h.fit.parts.iter().filter(beside);
            parts.map(|part| of(&part.total())).sum()
        };
        let cost = |h: &Hypothesis| sum(h, |total| total.outside);
        let null = self.null();
        let doubt = if sum(without, excess_in) < GAIN {
            DOUBT_WHERE_QUIET
        } else {
            let touching = blocks.iter().flat_map(|block| touching(*block));
            touching.map(|other| other.form_doubt).fold(0.0, f64::max)
        };
        let rest = SHARE_OF_WHOLE * cost(without);
        let of_others = null.map_or(0.0, |null| cost(null) - cost(without));
        let prior = hypothesis.fit.prior - without.fit.prior;
        GAIN.max(noise.sum())
            .max(doubt.powi(2) * of_others)
            .max(rest)
            .max((prior - GAIN) / SHARE_OF_CALIBRATION)
    }

    /// What was tried with as many members and cannot be told from `best`.
    fn near(&self, best: &Hypothesis) -> impl Iterator<Item = &Hypothesis> {
        let most = self.score(best) + MARGIN.max(0.05 * excess(&best.fit));
        let members = best.candidates.len();
        let tried = self.tried.iter();
        tried.filter(move |h| h.candidates.len() == members && self.score(h) < most)
    }

    /// Other effects that would do as well as a member of `best`.
    fn alternatives(&self, best: &Hypothesis) -> Vec<Vec<&'static str>> {
        let near = self.near(best);
        let near: Vec<Vec<&'static str>> = near.map(|h| self.names(&h.candidates)).collect();
        let names = self.names(&best.candidates);
        let of = |place: usize| {
            let mut found: Vec<&'static str> = Vec::new();
            for set in &near {
                let others = names
                    .iter()
                    .enumerate()
                    .filter(|(other, _)| *other != place);
                if others.into_iter().all(|(_, name)| set.contains(name)) {
                    for name in set {
                        if !names.contains(name) && !found.contains(name) {
                            found.push(name);
                        }
                    }
                }
            }
            found
        };
        (0..names.len()).map(of).collect()
    }

    /// The best set whose members are all needed.
    fn taken(&self) -> Option<Hypothesis> {
        let best = self.tried.iter().find(|h| self.needed(h))?;
        let best = self.simpler(best).unwrap_or(best);
        Some(self.inside(best).unwrap_or(best).clone())
    }

    /// If an effect of `best` is where it ends: what cannot be told from it, of the same names in
    /// other forms, and is not.
    fn inside(&self, best: &Hypothesis) -> Option<&Hypothesis> {
        let names = |h: &Hypothesis| self.names(&h.candidates);
        let mut near = self.near(best).filter(|_| self.at_end(best));
        near.find(|h| names(h) == names(best) && !self.at_end(h) && self.needed(h))
    }

    /// Of what cannot be told from `best`, with one member of another name, that with the fewest
    /// parameters, if it has fewer: what is more free looks like much.
    fn simpler(&self, best: &Hypothesis) -> Option<&Hypothesis> {
        let others = |a: &Hypothesis, b: &Hypothesis| -> Vec<&str> {
            let own = a.candidates.iter().map(|c| self.name(*c));
            let names = self.names(&b.candidates);
            own.filter(|name| !names.contains(name)).collect()
        };
        let parameters = |h: &Hypothesis| self.parameters(&h.candidates);
        let near = self.near(best).filter(|h| {
            others(h, best).len() == 1
                && excess(&h.fit) <= excess(&best.fit) + MARGIN
                && parameters(h) < parameters(best)
        });
        let mut near: Vec<&Hypothesis> = near.collect();
        near.sort_by_key(|h| parameters(h));
        near.into_iter().find(|h| self.needed(h))
    }

    /// Whether `best` explains hardly any of what a block has, and leaves plenty.
    fn hardly_explained(&self, null: &Hypothesis, best: &Hypothesis, block: usize) -> bool {
        let (before, after) = (excess_of(&null.fit, block), excess_of(&best.fit, block));
        let mut parts = best.fit.parts.iter().filter(|part| part.block == block);
        let plenty = parts.any(|part| part.total().outside > part.total().count as f64);
        plenty && after > (1.0 - SHARE_OF_BLOCK) * before
    }

    /// Whether an effect of `hypothesis` is where it ends.
    fn at_end(&self, hypothesis: &Hypothesis) -> bool {
        let all = self.engine.model.candidates();
        let mut effects = hypothesis.fit.effects.iter();
        effects.any(|(own, values)| all[*own].ended(values).next().is_some())
    }

    /// Whether `best` may be named: what it leaves, where its parameters are, and how far it moves
    /// nominal values.
    fn named(&self, null: &Hypothesis, best: &Hypothesis, share: f64) -> bool {
        let mut moved = best.fit.nominal.iter().map(|deviations| deviations.abs());
        if best.candidates.is_empty() || self.at_end(best) || moved.any(|by| by > TOO_FAR) {
            return false;
        }
        if excess(&null.fit) < GAIN {
            // What brings values back within their tolerances leaves nothing to explain.
            return true;
        }
        let all = self.engine.model.candidates();
        let changes = |part: &&Part| {
            let mut own = best.candidates.iter();
            own.any(|own| all[*own].blocks.contains(&part.block))
        };
        let plain = best.fit.parts.iter().filter(changes).any(|part| {
            let total = part.total();
            total.outside > PLAIN * total.count as f64
        });
        let mut own = best.candidates.iter();
        let asked = if own.all(|own| all[*own].form_doubt == 0.0) {
            SHARE_OF_EXACT
        } else if plain {
            SHARE_PLAIN
        } else {
            SHARE
        };
        let mut parts = best.fit.parts.iter();
        let hardly = parts.any(|part| self.hardly_explained(null, best, part.block));
        share >= asked && !hardly
    }

    /// Tries effects alone, then what leads among them together.
    fn run(&mut self, mut null: Hypothesis) -> Option<()> {
        // Where a block is as good as its noise, what does not even promise to be seen is not
        // fitted.
        let promises = self.engine.promises(&null)?;
        let far = null.fit.prior > GAIN;
        let share = if far {
            SHARE_OF_PROMISE_FAR
        } else {
            SHARE_OF_PROMISE
        };
        let worth = |candidate: &usize| {
            let all = self.engine.model.candidates();
            let blocks = &all[*candidate].blocks;
            let same = |c: &usize| all[*c].effect == all[*candidate].effect;
            let better = |c: &usize| promises[*c] > BETTER * promises[*candidate];
            let better = (0..all.len()).filter(same).filter(better).count();
            let rivals =
                (0..all.len()).filter(|c| all[*c].blocks.iter().all(|b| blocks.contains(b)));
            let most = rivals.map(|c| promises[c]).fold(0.0, f64::max);
            let unsure = |block: &usize| !self.engine.model.proportional(*block);
            let least = PROMISE.max(share * most);
            let few = far || better < FORMS || blocks.iter().any(unsure);
            promises[*candidate] > least && few || blocks.iter().all(unsure)
        };
        let candidates = (0..self.engine.model.candidates().len()).filter(worth);
        let mut sets: Vec<Vec<usize>> = candidates.map(|candidate| vec![candidate]).collect();
        for members in 1..=MEMBERS {
            (self.watch)(Step::Stage(STAGES[members - 1], sets.len()));
            self.try_all(&sets);
            if members > 1 {
                let variants = self.variants(members);
                (self.watch)(Step::Stage("effects in other forms", variants.len()));
                self.try_all(&variants);
            }
            self.reform(members);
            if members > 1 {
                self.try_all(&self.subsets(members));
            }
            let mut taken = self.taken_reduced();
            let whole = taken
                .as_ref()
                .filter(|best| best.candidates.len() == members);
            if whole.is_some_and(|best| members > 1 && self.replace(best)) {
                taken = self.taken_reduced();
            }
            // Fitted from where effects led, it may be better than it began.
            null = self.null()?.clone();
            let found = taken.as_ref().map_or(0, |best| best.candidates.len());
            // Three together only where two are better than one, or much is left.
            if members == MEMBERS || found < members && (members > 1 || excess(&null.fit) < GAIN) {
                break;
            }
            // Where little is left, a third is not asked for, and a second only if it promises more
            // than noise gives.
            if let Some(taken) = taken {
                let left = excess(&taken.fit);
                let enough = if found > 1 {
                    left < GAIN.max(SHARE_LEFT * excess(&null.fit))
                } else {
                    left < GAIN
                        && self
                            .engine
                            .promises(&taken)
                            .is_some_and(|promises| self.only_noise(&promises))
                };
                if enough {
                    break;
                }
            }
            let leaders = self.leaders(&null, members);
            sets = self.joined(&leaders);
            if sets.is_empty() {
                break;
            }
        }
        Some(())
    }
}

/// Chooses. `None` where the model has no solution at all.
pub fn choose<M: Model>(engine: &Engine<M>, watch: Watch) -> Option<Choice> {
    watch(Step::Stage("without effects", 0));
    let null = engine.hypothesis(&[])?;
    let mut search = Search {
        engine,
        watch,
        tried: vec![null.clone()],
        beyond: Mutex::default(),
    };
    search.run(null)?;
    let null = search.null()?.clone();
    let best = search.taken().unwrap_or_else(|| null.clone());
    let above = excess(&null.fit);
    let share = if above > 0.0 {
        1.0 - excess(&best.fit) / above
    } else {
        1.0
    };
    let verdict = if search.named(&null, &best, share) {
        Verdict::Explained
    } else if above < GAIN && null.fit.prior < GAIN {
        Verdict::Consistent
    } else {
        Verdict::Unexplained
    };
    // Only a calibration that went too far is left then.
    let far = verdict == Verdict::Unexplained && above < GAIN;
    let deviations = null.fit.nominal.iter().zip(engine.model.nominal_blocks());
    let farthest = deviations.max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
    let left = (0..engine.model.blocks().len()).filter(|block| match verdict {
        Verdict::Unexplained if far => farthest.is_some_and(|(_, blocks)| blocks.contains(block)),
        Verdict::Unexplained => {
            excess_of(&null.fit, *block) > 0.1 * above
                || share >= SHARE && search.hardly_explained(&null, &best, *block)
        }
        Verdict::Consistent | Verdict::Explained => false,
    });
    Some(Choice {
        verdict,
        alternatives: search.alternatives(&best),
        left: left.collect(),
        far,
        share,
        null,
        best,
        tried: search.tried,
    })
}

//! Which sets of effects are judged.
//!
//! Effects are tried alone, then in pairs and triples. A set is fitted by its cost, and judged by
//! its log evidence. The sets that lead, with an unknown in no block and in each set of blocks, are
//! joined with the effects that promise most beside them; the leading ones are tried in all their
//! forms. The search only decides what is tried: every set that was judged takes part in the
//! posterior.

use super::engine::{Engine, Hypothesis, Judgement, Model, OtherForm};
use super::evidence::Blocks;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Effects that are named together at most, and what it is to try so many.
pub(crate) const MEMBERS: usize = 3;
const STAGES: [&str; MEMBERS] = ["effects alone", "two effects", "three effects"];
/// Sets that lead with each set of blocks unknown: alone, and of several effects.
const LEADERS: [usize; MEMBERS] = [2, 1, 1];
/// Effects that are tried beside a leader, of those that touch the same groups of its blocks.
const FOLLOWERS: usize = 3;
/// Forms of an effect that are tried before it leads, where promises can be believed, beside those
/// that promise no less than one over this of theirs.
const FORMS: usize = 2;
const BETTER: f64 = 2.0;
/// Leading sets of which every form is tried, by their number of effects.
const VARIED: [usize; MEMBERS] = [1, 2, 2];
/// Most probable sets whose fit is made exact.
const POLISHED: usize = 4;
/// Sets of different names that are judged, by their number of effects, and forms of each.
const JUDGED: [usize; MEMBERS + 1] = [1, 12, 12, 8];
const JUDGED_FORMS: usize = 2;
/// What is so many nats less probable than the most probable set does not matter: a thousandth.
const MATTERS: f64 = 7.0;
/// Gain that each parameter of an effect gives by itself, with room.
const GAIN_PARAMETER: f64 = 4.0;
/// Promised gain, beside that of its parameters, for which an effect is tried: what has a rival
/// that was not tried looks too probable.
const PROMISE: f64 = 10.0;
/// Share of what another effect on no other block promises that is worth a fit.
const SHARE_OF_PROMISE: f64 = 0.01;

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

/// A set that was tried.
struct Tried {
    hypothesis: Hypothesis,
    /// Its judgements, once it was judged; none if an effect of it does not show.
    judgements: Option<Option<Vec<Judgement>>>,
}

pub(crate) struct Search<'a, 'b, M> {
    pub(crate) engine: &'b Engine<'a, M>,
    watch: Watch<'b>,
    /// All that was tried, the lowest cost first.
    tried: Vec<Tried>,
}

impl<'a, 'b, M: Model> Search<'a, 'b, M> {
    /// Searches. `None` where the model has no solution at all.
    pub(crate) fn run(engine: &'b Engine<'a, M>, watch: Watch<'b>) -> Option<Self> {
        watch(Step::Stage("without effects", 0));
        let null = engine.hypothesis(&[])?;
        let mut search = Search {
            engine,
            watch,
            tried: Vec::new(),
        };
        let mut sets = search.worthwhile(&null)?;
        search.improve(vec![null]);
        search.judge(0);
        for members in 1..=MEMBERS {
            (search.watch)(Step::Stage(STAGES[members - 1], sets.len()));
            search.try_all(&sets);
            if members > 1 {
                let variants = search.variants(members);
                (search.watch)(Step::Stage("effects in other forms", variants.len()));
                search.try_all(&variants);
            }
            search.reform(members);
            search.reduce(members);
            search.judge(members - 1);
            search.judge(members);
            if members == MEMBERS || search.is_enough(members) {
                break;
            }
            // About a fit what is not linear looks unknown.
            search.polish();
            if search.is_enough(members) {
                break;
            }
            sets = search.joined(members);
            if sets.is_empty() {
                break;
            }
        }
        search.polish();
        Some(search)
    }

    pub(crate) fn name(&self, candidate: usize) -> &'static str {
        self.engine.model.candidates()[candidate].effect
    }

    pub(crate) fn names(&self, candidates: &[usize]) -> Vec<&'static str> {
        candidates.iter().map(|c| self.name(*c)).collect()
    }

    /// Cost with what parameters gain by themselves.
    fn score(&self, hypothesis: &Hypothesis) -> f64 {
        hypothesis.fit.score() + self.gain_of_parameters(&hypothesis.candidates)
    }

    /// Promise from which a candidate is worth a fit.
    fn worth_a_fit(&self, candidate: usize) -> f64 {
        PROMISE + self.gain_of_parameters(&[candidate])
    }

    fn gain_of_parameters(&self, candidates: &[usize]) -> f64 {
        let all = self.engine.model.candidates();
        let parameters = candidates.iter().map(|c| all[*c].parameters.len());
        GAIN_PARAMETER * parameters.sum::<usize>() as f64
    }

    /// What was tried with so many members, best first.
    fn of_size(&self, members: usize) -> impl Iterator<Item = &Hypothesis> {
        let tried = self.tried.iter().map(|own| &own.hypothesis);
        tried.filter(move |h| h.candidates.len() == members)
    }

    /// Effects that promise to be seen. Where a dead zone hides what is small, none is left out.
    fn worthwhile(&self, null: &Hypothesis) -> Option<Vec<Vec<usize>>> {
        let promises = self.engine.promises(null)?;
        let all = self.engine.model.candidates();
        let worth = |candidate: &usize| {
            let blocks = &all[*candidate].blocks;
            let same = |c: &usize| all[*c].effect == all[*candidate].effect;
            let better = |c: &usize| promises[*c] > BETTER * promises[*candidate];
            let better = (0..all.len()).filter(same).filter(better).count();
            let rivals =
                (0..all.len()).filter(|c| all[*c].blocks.iter().all(|b| blocks.contains(b)));
            let most = rivals.map(|c| promises[c]).fold(0.0, f64::max);
            let unsure = |block: &usize| !self.engine.model.proportional(*block);
            let least = self.worth_a_fit(*candidate).max(SHARE_OF_PROMISE * most);
            let few = better < FORMS || blocks.iter().any(unsure);
            promises[*candidate] > least && few || blocks.iter().all(unsure)
        };
        let candidates = (0..all.len()).filter(worth);
        Some(candidates.map(|candidate| vec![candidate]).collect())
    }

    /// Fits `sets`.
    fn try_all(&mut self, sets: &[Vec<usize>]) {
        let fitted: Vec<Hypothesis> = sets
            .par_iter()
            .filter_map(|set| {
                (self.watch)(Step::Try(self.names(set)));
                self.engine.hypothesis(set)
            })
            .collect();
        self.improve(fitted);
    }

    /// Keeps what is better than the same set is so far.
    fn improve(&mut self, found: Vec<Hypothesis>) {
        for new in found {
            let same = |own: &&mut Tried| own.hypothesis.candidates == new.candidates;
            match self.tried.iter_mut().find(same) {
                Some(known) if new.fit.score() < known.hypothesis.fit.score() => {
                    *known = Tried {
                        hypothesis: new,
                        judgements: None,
                    };
                }
                Some(_) => {}
                None => self.tried.push(Tried {
                    hypothesis: new,
                    judgements: None,
                }),
            }
        }
        let mut tried = std::mem::take(&mut self.tried);
        tried.sort_by(|a, b| {
            let (a, b) = (&a.hypothesis, &b.hypothesis);
            let by_score = self.score(a).total_cmp(&self.score(b));
            by_score.then_with(|| a.candidates.cmp(&b.candidates))
        });
        self.tried = tried;
    }

    /// Finds the evidence of the leading sets of `members`.
    fn judge(&mut self, members: usize) {
        let mut forms: BTreeMap<Vec<&str>, usize> = BTreeMap::new();
        let mut chosen = Vec::new();
        for (place, own) in self.tried.iter().enumerate() {
            let candidates = &own.hypothesis.candidates;
            if candidates.len() != members {
                continue;
            }
            let names = self.names(candidates);
            let is_twice = (1..names.len()).any(|place| names[..place].contains(&names[place]));
            let is_new = !forms.contains_key(&names);
            if is_twice || is_new && forms.len() == JUDGED[members] {
                continue;
            }
            let count = forms.entry(names).or_default();
            *count += 1;
            if *count <= JUDGED_FORMS && own.judgements.is_none() {
                chosen.push(place);
            }
        }
        (self.watch)(Step::Stage("evidence", chosen.len()));
        let judgements: Vec<Option<Vec<Judgement>>> = chosen
            .par_iter()
            .map(|place| {
                let hypothesis = &self.tried[*place].hypothesis;
                self.engine.judgements(hypothesis, f64::INFINITY)
            })
            .collect();
        for (place, judgements) in chosen.into_iter().zip(judgements) {
            self.tried[place].judgements = Some(judgements);
        }
    }

    /// Expands the evidence of what may be as probable as the most probable set about its own mode,
    /// the most probable first.
    fn expand(&mut self) {
        (self.watch)(Step::Stage("evidence about its mode", 0));
        loop {
            let exact = self.judged().filter(|own| own.1.missing <= 0.0);
            let exact = exact.map(|own| own.1.log_evidence);
            let floor = exact.fold(f64::MIN, f64::max) - MATTERS;
            let most = |own: &Tried| {
                let open = own.judgements.iter().flatten().flatten();
                let open = open.filter(|own| own.missing > 0.0 && own.reach() >= floor);
                open.map(|own| own.log_evidence).reduce(f64::max)
            };
            let open = self.tried.iter().enumerate();
            let open = open.filter_map(|(place, own)| Some((place, most(own)?)));
            let Some((place, _)) = open.max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            let judgements = self.engine.judgements(&self.tried[place].hypothesis, floor);
            self.tried[place].judgements = Some(judgements);
        }
    }

    /// Makes the fits of the most probable sets exact, and judges them again: the evidence is
    /// linear about the fit, and what that misses looks unknown.
    fn polish(&mut self) {
        let mut order: Vec<(f64, &Hypothesis)> = Vec::new();
        for own in &self.tried {
            let logs = own.judgements.iter().flatten().flatten();
            if let Some(log) = logs.map(|own| own.log_evidence).reduce(f64::max) {
                order.push((log, &own.hypothesis));
            }
        }
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        let leading = order.into_iter().take(POLISHED);
        let leading: Vec<Hypothesis> = leading.map(|(_, own)| own.clone()).collect();
        let polished: Vec<Hypothesis> = leading
            .par_iter()
            .filter_map(|hypothesis| self.engine.polished(hypothesis))
            .collect();
        self.improve(polished);
        for members in 0..=MEMBERS {
            self.judge(members);
        }
        self.expand();
    }

    /// The sets that were judged, with each set of blocks unknown.
    pub(crate) fn judged(&self) -> impl Iterator<Item = (&Hypothesis, &Judgement)> {
        self.tried.iter().flat_map(|own| {
            let judgements = own.judgements.iter().flatten().flatten();
            judgements.map(|judgement| (&own.hypothesis, judgement))
        })
    }

    /// The most probable set, but for priors, and whether it has an unknown.
    fn best(&self) -> Option<(&Hypothesis, Blocks)> {
        let judged = self.judged();
        let best = judged.max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence))?;
        Some((best.0, best.1.unknown))
    }

    /// Whether more effects than `members` need not be tried: fewer are more probable, or nothing
    /// is unknown and no effect promises anything beside them.
    fn is_enough(&self, members: usize) -> bool {
        let Some((best, unknown)) = self.best() else {
            return false;
        };
        if unknown != 0 {
            return false;
        }
        if best.candidates.len() < members {
            return true;
        }
        let Some(promises) = self.engine.promises(best) else {
            return false;
        };
        let least = |candidate: usize| self.worth_a_fit(candidate);
        let doubted = (0..promises.len()).filter(|c| promises[*c] >= least(*c));
        let doubted: Vec<usize> = doubted.collect();
        !self.engine.is_promising(best, &doubted, least)
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

    /// The sets of `members` that lead with each set of blocks unknown.
    fn leaders(&self, members: usize) -> Vec<Vec<usize>> {
        let mut by_unknown: BTreeMap<Blocks, Vec<(f64, Vec<usize>)>> = BTreeMap::new();
        for (hypothesis, judgement) in self.judged() {
            if hypothesis.candidates.len() == members {
                let sets = by_unknown.entry(judgement.unknown).or_default();
                sets.push((judgement.log_evidence, hypothesis.candidates.clone()));
            }
        }
        let mut leaders: Vec<Vec<usize>> = Vec::new();
        for (_, mut sets) in by_unknown {
            sets.sort_by(|a, b| b.0.total_cmp(&a.0));
            let sets = sets.into_iter().map(|(_, set)| set);
            for leader in self.distinct(sets, LEADERS[members - 1]) {
                if !leaders.contains(&leader) {
                    leaders.push(leader);
                }
            }
        }
        leaders
    }

    /// Leaders joined with what promises most beside them.
    fn joined(&self, members: usize) -> Vec<Vec<usize>> {
        let mut sets = Vec::new();
        for leader in self.leaders(members) {
            for set in self.beside(&leader) {
                if !sets.contains(&set) && self.tried.iter().all(|t| t.hypothesis.candidates != set)
                {
                    sets.push(set);
                }
            }
        }
        sets
    }

    /// A set that was tried with what promises most beside it, of other names than its own.
    fn beside(&self, leader: &[usize]) -> Vec<Vec<usize>> {
        let mut tried = self.tried.iter().map(|own| &own.hypothesis);
        let known = tried.find(|h| h.candidates == leader);
        let Some(promises) = known.and_then(|known| self.engine.promises(known)) else {
            return Vec::new();
        };
        let own = self.names(leader);
        let mut order: Vec<usize> = (0..promises.len()).collect();
        order.retain(|candidate| {
            let blocks = &self.engine.model.candidates()[*candidate].blocks;
            let is_unsure = |block: &usize| !self.engine.model.proportional(*block);
            let is_worth = promises[*candidate] > self.worth_a_fit(*candidate);
            !own.contains(&self.name(*candidate)) && (is_worth || blocks.iter().any(is_unsure))
        });
        order.sort_by(|a, b| promises[*b].total_cmp(&promises[*a]));
        // What is missing elsewhere is no rival.
        let groups = self.engine.groups(leader);
        let mut by_groups: BTreeMap<Vec<usize>, Vec<Vec<usize>>> = BTreeMap::new();
        for candidate in order {
            let touched = self.engine.touched(&groups, candidate);
            let blocks = touched.flat_map(|(blocks, _)| blocks).copied();
            let followers = by_groups.entry(blocks.collect()).or_default();
            followers.push(vec![candidate]);
        }
        let places = by_groups.into_values();
        let followers = places.flat_map(|own| self.distinct(own.into_iter(), FOLLOWERS));
        let sets = followers.map(|follower| {
            let mut set = [leader, &follower[..]].concat();
            set.sort_unstable();
            set
        });
        sets.collect()
    }

    /// The sets of `members` that cost least, with different names.
    fn varied(&self, members: usize) -> Vec<Vec<usize>> {
        let sets = self.of_size(members).map(|h| h.candidates.clone());
        self.distinct(sets, VARIED[members - 1])
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
                    let is_known = self
                        .tried
                        .iter()
                        .any(|own| own.hypothesis.candidates == variant);
                    if all[other].effect == all[*own].effect && !is_known {
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
            let Some(of) = self.of_size(members).find(|h| h.candidates == set) else {
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
    }

    /// Fits the leading set without each of its members, from where the others are in it.
    fn reduce(&mut self, members: usize) {
        let leading = self.of_size(members).next().cloned();
        if let Some(leading) = leading.filter(|_| members > 1) {
            (self.watch)(Step::Stage("without each of them", members));
            self.improve(self.engine.reduced(&leading));
        }
    }
}

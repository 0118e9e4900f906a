//! The posterior over sets of effects, and the verdict.
//!
//! Each set that the search judged has a log evidence with an unknown in no block and in each set
//! of blocks; with the prior of the set this is its probability. An effect is named if it is
//! probable enough for what a wrong name costs against a missing one; where several are so only
//! together, they are named as alternatives. What is left then is unknown.

use super::engine::{Engine, Hypothesis, Judgement, Model, Part};
use super::evidence::{Blocks, log_sum};
use super::search::{MEMBERS, Search};
pub use super::search::{Step, Watch};
use std::collections::{BTreeMap, BTreeSet};

/// Prior probabilities of a set of no effect, one, two and three.
const SET_PRIOR: [f64; MEMBERS + 1] = [0.3, 0.4, 0.2, 0.1];
/// Prior probability of an unknown in a block.
const UNKNOWN_PRIOR: f64 = 0.05;
/// Effects that are named as alternatives at most.
const ALTERNATIVES: usize = 3;
/// Standard deviations of noise beyond which something is more than it.
const NOISE: f64 = 4.0;
/// Probability from which something is more probable than not.
pub const PROBABLE: f64 = 0.5;

/// What the data say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The nominal model explains the data.
    Consistent,
    /// The named effects do.
    Explained,
    /// The named effects are certain, and something else is left.
    Partial,
    /// Something is left that no effect of the catalogue explains.
    Unexplained,
}

impl Verdict {
    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Explained => "explained",
            Verdict::Partial => "partial",
            Verdict::Unexplained => "unexplained",
            Verdict::Consistent => "consistent",
        }
    }
}

/// What wrong answers cost, in any unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// To name an effect that is not there.
    pub wrong_name: f64,
    /// Not to name one that is.
    pub missing_name: f64,
}

impl Default for Costs {
    /// A wrong name sends its reader to the wrong part of the rig.
    fn default() -> Costs {
        Costs {
            wrong_name: 9.0,
            missing_name: 1.0,
        }
    }
}

impl Costs {
    /// Probability from which to name an effect costs less than not to.
    pub fn threshold(self) -> f64 {
        self.wrong_name / (self.wrong_name + self.missing_name)
    }
}

/// A set of effects, perhaps with unknowns.
#[derive(Clone, Debug)]
pub struct Set {
    /// The effects' names, in alphabetical order.
    pub effects: Vec<&'static str>,
    /// Blocks with an unknown.
    pub unknown: Blocks,
    /// Its probability, and the logarithm of that.
    pub probability: f64,
    /// See `probability`.
    pub log_probability: f64,
}

/// What was selected.
pub struct Selection {
    /// The verdict.
    pub verdict: Verdict,
    /// Without any effect.
    pub null: Hypothesis,
    /// The effects that are named, in their most probable forms; `null` if none is.
    pub named: Hypothesis,
    /// `named` as it is estimated (see [`Engine::estimated`]), or as it was fitted if it cannot be.
    pub estimated: Hypothesis,
    /// For each candidate of `named`, the probability that its effect, or one of its alternatives,
    /// is present.
    pub probabilities: Vec<f64>,
    /// For each candidate of `named`: other effects that the data cannot tell from it.
    pub alternatives: Vec<Vec<&'static str>>,
    /// Blocks in which something is left beside what is named.
    pub left: Vec<usize>,
    /// All sets, the most probable first; the probabilities sum to 1.
    pub posterior: Vec<Set>,
}

impl Selection {
    /// The same without names, where what is named does not predict.
    #[must_use]
    pub fn unnamed(self) -> Selection {
        let left = if self.left.is_empty() {
            most_missed(&self.null)
        } else {
            self.left
        };
        Selection {
            verdict: Verdict::Unexplained,
            named: self.null.clone(),
            estimated: self.null.clone(),
            probabilities: Vec::new(),
            alternatives: Vec::new(),
            left,
            ..self
        }
    }

    /// By how much the log probability of the most probable set with an effect exceeds that of the
    /// most probable set without it, in nats; `None` if there is none with it, or none without.
    pub fn gain_nats(&self, effect: &str) -> Option<f64> {
        let most = |with: bool| {
            let mut sets = self.posterior.iter();
            sets.find(|set| set.effects.contains(&effect) == with)
        };
        Some(most(true)?.log_probability - most(false)?.log_probability)
    }

    /// The most probable set of effects in their best forms, as it is estimated, whether or not it
    /// is probable enough for names: for terms of a formula, which are none. `None` if that set has
    /// no effect.
    pub fn most_probable<M: Model>(&self, engine: &Engine<M>) -> Option<Hypothesis> {
        let set = self.posterior.first()?;
        let all = engine.model.candidates();
        let mut sets: Vec<Vec<usize>> = vec![Vec::new()];
        for name in &set.effects {
            let forms = (0..all.len()).filter(|own| all[*own].effect == *name);
            let longer = |form: usize| sets.iter().map(move |set| [&set[..], &[form]].concat());
            sets = forms.flat_map(longer).collect();
        }
        let fits = sets.iter().filter(|set| !set.is_empty());
        let fits = fits.filter_map(|set| engine.hypothesis(set));
        let best = fits.min_by(|a, b| a.fit.score().total_cmp(&b.fit.score()))?;
        engine.estimated(&best).or(Some(best))
    }
}

/// A set that was judged, with the logarithm of its evidence times its prior.
struct Judged<'h> {
    hypothesis: &'h Hypothesis,
    names: Vec<&'static str>,
    /// Those of effects that stand beside what is unknown.
    standing: Vec<&'static str>,
    unknown: Blocks,
    log: f64,
}

fn judged<'s, M: Model>(search: &'s Search<M>) -> Vec<Judged<'s>> {
    let all = search.engine.model.candidates();
    let blocks = search.engine.model.blocks().len();
    let effects: BTreeSet<&str> = all.iter().map(|candidate| candidate.effect).collect();
    let forms = |name: &str| all.iter().filter(|other| other.effect == name).count() as f64;
    let of = |(hypothesis, judgement): (&'s Hypothesis, &Judgement)| {
        let unknown = judgement.unknown;
        let mut names = search.names(&hypothesis.candidates);
        let members = names.len();
        let sets = (0..members).map(|n| (effects.len() - n) as f64 / (n + 1) as f64);
        let forms: f64 = names.iter().map(|name| forms(name)).product();
        let unknowns = unknown.count_ones() as i32;
        let of_unknown =
            UNKNOWN_PRIOR.powi(unknowns) * (1.0 - UNKNOWN_PRIOR).powi(blocks as i32 - unknowns);
        let prior = SET_PRIOR[members] / sets.product::<f64>() / forms * of_unknown;
        names.sort_unstable();
        Judged {
            hypothesis,
            names,
            standing: search.names(&judgement.standing),
            unknown,
            log: judgement.log_evidence + prior.ln(),
        }
    };
    search.judged().map(of).collect()
}

/// The probability of each set of names and unknowns.
fn posterior(judged: &[Judged]) -> Vec<Set> {
    let mut logs: BTreeMap<(&[&'static str], Blocks), Vec<f64>> = BTreeMap::new();
    for own in judged {
        logs.entry((&own.names, own.unknown))
            .or_default()
            .push(own.log);
    }
    let total = log_sum(judged.iter().map(|own| own.log));
    let set = |((names, unknown), logs): ((&[&'static str], Blocks), Vec<f64>)| Set {
        effects: names.to_vec(),
        unknown,
        log_probability: log_sum(logs.into_iter()) - total,
        probability: 0.0,
    };
    let mut posterior: Vec<Set> = logs.into_iter().map(set).collect();
    posterior.sort_by(|a, b| b.log_probability.total_cmp(&a.log_probability));
    for set in &mut posterior {
        set.probability = set.log_probability.exp();
    }
    posterior
}

/// Sum of the probabilities of sets.
pub fn probability(posterior: &[Set], of: impl Fn(&Set) -> bool) -> f64 {
    let sets = posterior.iter().filter(|set| of(set));
    // Rounding must not make it more than 1.
    sets.map(|set| set.probability).sum::<f64>().min(1.0)
}

/// The sets with those effects only that stand beside what is unknown.
fn standing(posterior: &[Set], judged: &[Judged]) -> Vec<Set> {
    let of = |set: &Set| {
        let same = |own: &&Judged| own.names == set.effects && own.unknown == set.unknown;
        let forms = judged.iter().filter(same);
        let most = forms.max_by(|a, b| a.log.total_cmp(&b.log));
        let mut set = set.clone();
        set.effects
            .retain(|effect| most.is_some_and(|most| most.standing.contains(effect)));
        set
    };
    posterior.iter().map(of).collect()
}

/// Names that are certain, each with its alternatives.
fn certain(posterior: &[Set], threshold: f64) -> Vec<(&'static str, Vec<&'static str>, f64)> {
    let names: BTreeSet<&'static str> = posterior.iter().flat_map(|s| s.effects.clone()).collect();
    let present = |names: &[&str]| {
        probability(posterior, |set| {
            set.effects.iter().any(|effect| names.contains(effect))
        })
    };
    let mut named = Vec::new();
    let mut open: Vec<(f64, &'static str)> = Vec::new();
    for name in names {
        let own = present(&[name]);
        if own >= threshold {
            named.push((name, Vec::new(), own));
        } else {
            open.push((own, name));
        }
    }
    named.sort_by(|a, b| b.2.total_cmp(&a.2));
    open.sort_by(|a, b| b.0.total_cmp(&a.0));
    let together: Vec<&'static str> = open.iter().take(ALTERNATIVES).map(|own| own.1).collect();
    let enough = |count: &usize| present(&together[..*count]) >= threshold;
    if let Some(count) = (2..=together.len()).find(enough) {
        let probability = present(&together[..count]);
        named.push((together[0], together[1..count].to_vec(), probability));
    }
    named
}

/// Selects by what wrong answers cost. `None` where the model has no solution at all.
pub fn select<M: Model>(engine: &Engine<M>, costs: Costs, watch: Watch) -> Option<Selection> {
    let search = Search::run(engine, watch)?;
    let judged = judged(&search);
    let posterior = posterior(&judged);
    let certain = certain(&standing(&posterior, &judged), costs.threshold());
    let most = |of: &dyn Fn(&Judged) -> bool| {
        let sets = judged.iter().filter(|own| of(own));
        let most = sets.max_by(|a, b| a.log.total_cmp(&b.log));
        most.map(|own| own.hypothesis.clone())
    };
    let null = most(&|own| own.names.is_empty())?;
    let of_names = |names: &[&str]| {
        // Names that are certain only in different sets have no set of their own.
        let some = |own: &Judged| {
            !own.names.is_empty() && own.names.iter().all(|name| names.contains(name))
        };
        let named = most(&|own| own.names == names).or_else(|| most(&some));
        named.unwrap_or_else(|| null.clone())
    };
    let names = sorted_names(&certain);
    let named = of_names(&names);
    let estimated = engine.estimated(&named);
    let is_certain = |effect: &&str| {
        let mut certain = certain.iter();
        certain.any(|own| own.0 == *effect || own.1.contains(effect))
    };
    let more = probability(&posterior, |set| {
        set.unknown != 0 || !set.effects.iter().all(is_certain)
    });
    let is_more = more >= PROBABLE || !predicts(engine, &null, &named);
    let verdict = match (named.candidates.is_empty(), is_more) {
        (true, false) => Verdict::Consistent,
        (true, true) => Verdict::Unexplained,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::Partial,
    };
    let of_named = |candidate: &usize| {
        let name = search.name(*candidate);
        let own = certain.iter().find(|own| own.0 == name);
        own.map_or((0.0, Vec::new()), |own| (own.2, own.1.clone()))
    };
    let (probabilities, alternatives) = named.candidates.iter().map(of_named).unzip();
    let left = match verdict {
        Verdict::Unexplained | Verdict::Partial => {
            let left = left(engine.model, &posterior, &names);
            if left.is_empty() {
                most_missed(&named)
            } else {
                left
            }
        }
        Verdict::Consistent | Verdict::Explained => Vec::new(),
    };
    Some(Selection {
        verdict,
        probabilities,
        alternatives,
        left,
        null,
        estimated: estimated.unwrap_or_else(|| named.clone()),
        named,
        posterior,
    })
}

/// The names that are certain, in alphabetical order.
fn sorted_names(certain: &[(&'static str, Vec<&'static str>, f64)]) -> Vec<&'static str> {
    let mut names: Vec<&str> = certain.iter().map(|own| own.0).collect();
    names.sort_unstable();
    names
}

/// The block in which the records that were not fitted are missed most.
fn most_missed(fitted: &Hypothesis) -> Vec<usize> {
    let missed = |part: &&Part| part.predicted.outside - 0.5 * part.predicted.count as f64;
    let parts = fitted.fit.parts.iter();
    let most = parts.max_by(|a, b| missed(a).total_cmp(&missed(b)));
    most.map(|part| part.block).into_iter().collect()
}

/// Whether what is named predicts the records that were not fitted: it removes half of what is
/// missed there without it, if that is more than noise. Laws that explain all records, but with
/// other values in each, do not. Where no record is held out, or nothing can be predicted, nothing
/// speaks against it.
fn predicts<M: Model>(engine: &Engine<M>, null: &Hypothesis, named: &Hypothesis) -> bool {
    if named.candidates.is_empty() {
        return true;
    }
    let missed = engine.missed(null).zip(engine.missed(named));
    missed.is_none_or(|(before, after)| {
        before.nats <= NOISE * before.deviation || after.nats < 0.5 * before.nats
    })
}

/// Blocks in which probably something is left beside what is named.
fn left<M: Model>(model: &M, posterior: &[Set], named: &[&str]) -> Vec<usize> {
    let all = model.candidates();
    let touches = |effect: &str, block: usize| {
        let mut own = all.iter().filter(|candidate| candidate.effect == effect);
        own.any(|candidate| candidate.blocks.contains(&block))
    };
    let in_block = |block: usize| {
        probability(posterior, |set| {
            let mut rest = set.effects.iter().filter(|effect| !named.contains(effect));
            set.unknown & (1 << block) != 0 || rest.any(|effect| touches(effect, block))
        })
    };
    let blocks = 0..model.blocks().len();
    blocks
        .filter(|block| in_block(*block) >= PROBABLE)
        .collect()
}

//! Finds where simulation and measurement disagree, and which effect is missing.
//!
//! [`model_discrepancy::engine`] fits and predicts, [`model_discrepancy::verdict`] decides,
//! [`model_discrepancy::left`] tells where residuals live: none of them knows a muscle.
//! [`super::muscle`] is the rig as they see it. Here it becomes a diagnosis.

use super::muscle::{Calibrated, MuscleModel};
use crate::error::{BadInput, significant};
use crate::identify::formula::{self, Estimate, Formula, Rhythms};
use crate::identify::gap;
use crate::identify::inputs::above_vacuum;
use crate::identify::simulate::{simulate, simulated};
use crate::record::{PRESSURE_PA, PRESSURE_REF_PA, Record};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use model_discrepancy::engine::{Active, Engine, Hypothesis as Fitted, Model, Part, Shape, Tally};
use model_discrepancy::evidence::Blocks;
use model_discrepancy::left::{Profile, profiles, when};
use model_discrepancy::verdict::{Costs, Selection, Step, Verdict, Watch, select};
use muscle_plant::nominal::Gas;
use muscle_plant::simulation::TOLERANCE;
use rayon::prelude::*;
use serde::Serialize;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::time::Instant;

/// Why an effect is named.
#[derive(Clone, Debug, Serialize)]
pub struct Evidence {
    /// By how much the log probability of the most probable set with it exceeds that of the most
    /// probable set without it, in nats; none if every set that was judged has it.
    pub gain_nats: Option<f64>,
    /// Its signature.
    pub signature: &'static str,
    /// Where its equations come from.
    pub source: &'static str,
    /// What they leave out.
    pub leaves_out: &'static str,
}

/// A named effect.
#[derive(Clone, Debug, Serialize)]
pub struct Named {
    /// Its name.
    pub name: &'static str,
    /// The form of its equations.
    pub form: &'static str,
    /// Where it is.
    #[serde(rename = "where")]
    pub place: &'static str,
    /// Its parameters.
    pub parameters: BTreeMap<&'static str, Estimate>,
    /// How large it is over a quantity, in the size that its parameters say; none where its name
    /// says its form.
    pub shape: Option<Shape>,
    /// Probability that it, or one of its alternatives, is present.
    pub probability: f64,
    /// Effects that the data cannot tell from it.
    pub alternatives: Vec<&'static str>,
    /// Why it is named.
    pub evidence: Evidence,
}

/// How far free runs are from the validation records, root mean square, in the column's unit.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct GapOf {
    /// With the nominal rig.
    pub before: f64,
    /// With the fitted rig.
    pub after: f64,
    /// The sensor's noise.
    pub noise: f64,
    /// Share of the gap above the noise that the fitted rig removes, negative if it adds to it;
    /// none if the nominal rig's gap is hardly above the noise.
    pub removed: Option<f64>,
}

impl GapOf {
    /// The gaps with the nominal and with the fitted rig, beside the noise.
    pub fn new([before, after, noise]: [f64; 3]) -> GapOf {
        let above = |gap: f64| (gap * gap - noise * noise).max(0.0).sqrt();
        let seen = before > SEEN_ABOVE_NOISE * noise;
        GapOf {
            before,
            after,
            noise,
            removed: seen.then(|| 1.0 - above(after) / above(before)),
        }
    }

    /// Whether the fitted rig misses the signal by more than its noise.
    fn remains(&self) -> bool {
        self.after > ABOVE_NOISE * self.noise
    }

    /// Whether the fitted rig misses the signal by more than the nominal one and than the noise.
    pub fn is_worse(&self) -> bool {
        self.remains() && self.after > self.before
    }

    /// Orders gaps, the worst first: signals that got worse, by how much; then those of which least
    /// is removed; then those that were within their noise.
    fn worst_first(&self, other: &GapOf) -> Ordering {
        let worse = |gap: &GapOf| {
            let times = gap.after / gap.before.max(gap.noise);
            if gap.is_worse() { times } else { 0.0 }
        };
        let removed = |gap: &GapOf| gap.removed.unwrap_or(f64::INFINITY);
        let by_worse = worse(other).total_cmp(&worse(self));
        by_worse.then(removed(self).total_cmp(&removed(other)))
    }
}

/// Writes gaps by signal as a JSON object in their order.
fn as_object<S: serde::Serializer>(
    gaps: &[(&'static str, GapOf)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(gaps.iter().copied())
}

/// What no effect explains.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Remaining {
    /// In which equations.
    #[serde(rename = "where")]
    pub places: Vec<&'static str>,
    /// When: at which direction, pressure, rate, time.
    pub when: String,
}

/// A set of effects, perhaps with unknowns, and its posterior probability.
#[derive(Clone, Debug, Serialize)]
pub struct Hypothesis {
    /// The effects' names.
    pub effects: Vec<&'static str>,
    /// Subsystems with an unknown.
    pub unknown: Vec<&'static str>,
    /// Its probability.
    pub probability: f64,
}

/// A block, before and after.
#[derive(Clone, Debug, Serialize)]
pub struct BlockOf {
    /// Its name.
    pub block: &'static str,
    /// Mean square of its residuals in units of their noise with the nominal rig, calibrated.
    pub before: f64,
    /// With what is named.
    pub after: f64,
    /// Where its residuals live, before and after.
    pub profiles: [Vec<Profile>; 2],
}

/// A stage, and how long it took.
#[derive(Clone, Debug, Serialize)]
pub struct Stage {
    /// What was done.
    pub stage: String,
    /// Time it took \[s\].
    pub spent_s: f64,
}

/// The result, as `diagnosis.json` has it.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// Version of the format.
    pub schema: u32,
    /// The verdict.
    pub verdict: Verdict,
    /// What is missing from the nominal model.
    pub effects: Vec<Named>,
    /// By signal, the worst first.
    #[serde(serialize_with = "as_object")]
    pub gap: Vec<(&'static str, GapOf)>,
    /// What is left.
    pub remaining: Remaining,
    /// What is left as a sum of terms, if one explains it: no name, and held by the fitted rig.
    pub formula: Option<Formula>,
    /// The experiment that would tell more.
    pub next_experiment: String,
    /// Nominal values that were calibrated.
    pub calibrated: Vec<Calibrated>,
    /// Block by block.
    pub blocks: Vec<BlockOf>,
    /// The posterior, the most probable first: as many as are needed for all but a thousandth.
    pub hypotheses: Vec<Hypothesis>,
    /// What the records lack.
    pub warnings: Vec<String>,
    /// Where the time went.
    pub stages: Vec<Stage>,
}

impl Diagnosis {
    /// The gap of a signal, if it is compared.
    pub fn gap_of(&self, signal: &str) -> Option<&GapOf> {
        let mut gaps = self.gap.iter();
        gaps.find(|(name, _)| *name == signal).map(|(_, gap)| gap)
    }
}

/// A diagnosis with what belongs to it.
pub struct Diagnosed {
    /// The result.
    pub diagnosis: Diagnosis,
    /// The rig with calibrated values and named effects.
    pub fitted: Rig,
    /// Each validation record as simulated with the nominal and with the fitted rig.
    pub free_runs: Vec<[Record; 2]>,
}

/// Probability of the hypotheses that are not listed in the result.
const UNLISTED: f64 = 1e-3;
/// A nominal value that had to move by more than this many standard deviations is not what it was
/// said to be.
const FAR: f64 = 4.0;
/// A gap above this multiple of the noise is more than noise, whose estimate is less uncertain.
const ABOVE_NOISE: f64 = 1.1;
/// Of a gap below this multiple of the noise one cannot say which share is removed.
const SEEN_ABOVE_NOISE: f64 = 1.2;

/// Keeps the time.
pub(super) struct Clock {
    begin: Instant,
    pub(super) stages: Vec<Stage>,
}

impl Clock {
    pub(super) fn new() -> Clock {
        Clock {
            begin: Instant::now(),
            stages: Vec::new(),
        }
    }

    pub(super) fn lap(&mut self, stage: &str) {
        let spent_s = self.begin.elapsed().as_secs_f64();
        self.stages.push(Stage {
            stage: stage.into(),
            spent_s,
        });
        self.begin = Instant::now();
    }
}

/// `records` as they drive `rig`: without a valve a reference drives nothing.
///
/// # Errors
/// A pressure that drives it and that no gas has.
pub(super) fn driven(rig: &Rig, records: &[Record]) -> Result<Vec<Record>, BadInput> {
    let mut records = records.to_vec();
    let gas = rig.nominal.gas.unwrap_or(Gas::STANDARD);
    for record in &mut records {
        if rig.nominal.valve.is_none() {
            record.remove(PRESSURE_REF_PA);
        }
        if record.column(PRESSURE_REF_PA).is_some() {
            continue;
        }
        let pressures_pa = record.column(PRESSURE_PA).unwrap_or_default();
        let present = pressures_pa
            .iter()
            .enumerate()
            .filter(|(_, pa)| !pa.is_nan());
        for (row, pa) in present {
            above_vacuum(gas.atmospheric_pressure, record, row, GaugePa(*pa))?;
        }
    }
    Ok(records)
}

/// How a diagnosis is made.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Names of effects that are left out of the catalogue.
    pub without: Vec<String>,
    /// What wrong answers cost.
    pub costs: Costs,
    /// Whether what has no name gets no formula.
    pub no_formula: bool,
}

/// Diagnoses `rig` from records to `fit`, judged by records to `validate`; `watch` is told what is
/// being done.
///
/// # Errors
/// Rig and records do not fit together, or do not suffice.
pub fn diagnose(
    rig: &Rig,
    fit: &[Record],
    validate: &[Record],
    options: &Options,
    watch: Watch,
) -> Result<Diagnosed, BadInput> {
    let mut clock = Clock::new();
    watch(Step::Stage("data and noise", 0));
    let (fit, validate) = (&driven(rig, fit)?[..], &driven(rig, validate)?[..]);
    let model = MuscleModel::new(rig, fit, validate, &without(rig, options))?;
    clock.lap("data and noise");
    let engine = Engine::new(&model);
    let expected = "a rig whose plant can follow the records";
    let mut selection =
        select(&engine, options.costs, watch).ok_or_else(|| rig.bad_file(expected))?;
    clock.lap("effects");
    watch(Step::Stage("intervals and simulations", 0));
    let simulated = |record| simulate(rig, record, TOLERANCE);
    let nominal_runs = validate.par_iter().map(simulated);
    let nominal_runs = nominal_runs.collect::<Result<Vec<_>, BadInput>>()?;
    let mut run = FreeRuns::new(rig, &engine, &selection, (validate, &nominal_runs))?;
    if !selection.named.candidates.is_empty() && run.is_worse_everywhere() {
        selection = selection.unnamed();
        run = FreeRuns::new(rig, &engine, &selection, (validate, &nominal_runs))?;
    }
    clock.lap("simulations");
    let left = |block: &usize| model.blocks()[*block];
    let places = selection.left.iter().map(left);
    let places: Vec<_> = places.flat_map(|block| model.places(block)).collect();
    let records = (fit, validate, &nominal_runs[..]);
    let rhythms = || Rhythms::of(&model, fit, &selection.estimated, &selection.left);
    let left = (&places[..], &rhythms as Seek);
    let (formula, run) = with_formula(rig, run, left, records, options, watch)?;
    clock.lap("formula");
    let FreeRuns {
        nominal,
        fitted,
        free_runs,
        gap,
    } = run;
    let taken = &selection.estimated;
    let effects = named(&engine, &selection, taken);
    clock.lap("intervals");
    let blocks = blocks(&model, &selection.null, taken);
    let of_left = blocks
        .iter()
        .enumerate()
        .filter(|(place, _)| selection.left.contains(place));
    let words: Vec<String> = of_left.map(|(_, block)| when(&block.profiles[1])).collect();
    let calibrated = model.calibrated(&nominal);
    let mut warnings = warnings(&model, &calibrated);
    warnings.extend(predictions(&gap, selection.verdict));
    clock.lap("report");
    let diagnosis = Diagnosis {
        schema: 2,
        verdict: selection.verdict,
        next_experiment: next_experiment(&model, &selection, &effects),
        effects,
        gap,
        remaining: Remaining {
            places,
            when: words.join("; "),
        },
        calibrated,
        blocks,
        formula,
        hypotheses: hypotheses(&selection, |unknown| model.unknown_in(unknown)),
        warnings,
        stages: clock.stages,
    };
    Ok(Diagnosed {
        diagnosis,
        fitted,
        free_runs,
    })
}

/// The effects that are not tried: what an earlier formula is made of is no name.
fn without(rig: &Rig, options: &Options) -> Vec<String> {
    let kinds = rig.catalogue.kinds().filter(|kind| formula::is_term(kind));
    let terms = kinds.map(|kind| kind.name.into());
    options.without.iter().cloned().chain(terms).collect()
}

/// The fitted rig, and what it and the nominal one make of the validation records.
struct FreeRuns {
    nominal: Vec<f64>,
    fitted: Rig,
    free_runs: Vec<[Record; 2]>,
    gap: Vec<(&'static str, GapOf)>,
}

impl FreeRuns {
    fn new(
        rig: &Rig,
        engine: &Engine<MuscleModel>,
        selection: &Selection,
        (validate, nominal_runs): (&[Record], &[Record]),
    ) -> Result<FreeRuns, BadInput> {
        let nominal = nominal_of(engine, selection, &selection.estimated);
        FreeRuns::of(
            rig,
            engine,
            &selection.estimated,
            nominal,
            (validate, nominal_runs),
        )
    }

    fn of(
        rig: &Rig,
        engine: &Engine<MuscleModel>,
        taken: &Fitted,
        nominal: Vec<f64>,
        (validate, nominal_runs): (&[Record], &[Record]),
    ) -> Result<FreeRuns, BadInput> {
        let fitted = engine.model.fitted(&nominal, &taken.fit.effects);
        let free_run = |(record, nominal): (&Record, &Record)| {
            let run = simulate(&fitted, record, TOLERANCE);
            // The record is none the worse for it.
            Ok([
                nominal.clone(),
                run.map_err(|_| rig.bad_file(&astray(record)))?,
            ])
        };
        let free_runs = validate
            .par_iter()
            .zip(nominal_runs)
            .map(free_run)
            .collect::<Result<Vec<_>, BadInput>>()?;
        let gap = gaps(engine.model, rig, validate, &free_runs);
        Ok(FreeRuns {
            nominal,
            fitted,
            free_runs,
            gap,
        })
    }

    /// Whether every signal is predicted worse than by the nominal rig.
    fn is_worse_everywhere(&self) -> bool {
        let is_worse = |(_, gap): &(&str, GapOf)| gap.after > gap.before;
        !self.gap.is_empty() && self.gap.iter().all(is_worse)
    }

    /// The gap of each signal here and in `other`.
    fn pairs(&self, other: &FreeRuns) -> impl Iterator<Item = (&'static str, GapOf, GapOf)> {
        self.gap.iter().filter_map(|(signal, before)| {
            let mut known = other.gap.iter();
            let (_, after) = known.find(|(known, _)| known == signal)?;
            Some((*signal, *before, *after))
        })
    }

    /// Whether no signal is predicted worse than by `other`, and the one that `other` misses most
    /// is predicted better.
    fn predicts_better_than(&self, other: &FreeRuns) -> bool {
        let is_no_worse =
            |(_, before, after): (_, GapOf, GapOf)| !after.remains() || after.after <= before.after;
        let times_noise = |gap: &GapOf| gap.after / gap.noise;
        let most = other.pairs(self);
        let most = most.max_by(|(_, a, _), (_, b, _)| times_noise(a).total_cmp(&times_noise(b)));
        other.pairs(self).all(is_no_worse)
            && most.is_some_and(|(_, before, after)| after.after < before.after)
    }
}

/// Seeks the rhythms in what is left, which only a formula needs.
type Seek<'a> = &'a dyn Fn() -> Rhythms;

/// A formula for what `run` leaves in these places and with these rhythms, and the free runs of the
/// rig with it; none where nothing is left, or nothing is found.
fn with_formula(
    rig: &Rig,
    run: FreeRuns,
    left: (&[&str], Seek),
    records: (&[Record], &[Record], &[Record]),
    options: &Options,
    watch: Watch,
) -> Result<(Option<Formula>, FreeRuns), BadInput> {
    let found = match left {
        _ if options.no_formula => None,
        ([], _) => None,
        left => formula_of(rig, &run, left, records, options, watch)?,
    };
    Ok(match found {
        Some((formula, better)) => (Some(formula), better),
        None => (None, run),
    })
}

/// The terms of the most probable set, whatever is unknown beside them. None if these predict some
/// signal of the validation records worse, or the signal that is missed most no better.
fn formula_of(
    rig: &Rig,
    run: &FreeRuns,
    (places, rhythms): (&[&str], Seek),
    (fit, validate, nominal_runs): (&[Record], &[Record], &[Record]),
    options: &Options,
    watch: Watch,
) -> Result<Option<(Formula, FreeRuns)>, BadInput> {
    watch(Step::Stage("formula", 0));
    let mut base = rig.clone();
    base.effects.clone_from(&run.fitted.effects);
    // What cannot be fitted with terms is a diagnosis all the same.
    let Ok((base, tables)) = formula::with_terms(&base, places, rhythms()) else {
        return Ok(None);
    };
    let Ok(model) = MuscleModel::new(&base, fit, validate, &[]) else {
        return Ok(None);
    };
    let engine = Engine::new(&model);
    let selection = select(&engine, options.costs, watch);
    let Some((selection, taken)) = selection.and_then(|selection| {
        let taken = selection.most_probable(&engine)?;
        Some((selection, taken))
    }) else {
        return Ok(None);
    };
    let nominal = model.readable(model.refined(&taken.fit.nominal, &taken.fit.effects));
    // A formula with which the rig cannot follow the records is none.
    let better = FreeRuns::of(&base, &engine, &taken, nominal, (validate, nominal_runs));
    let Some(mut better) = better
        .ok()
        .filter(|better| better.predicts_better_than(run))
    else {
        return Ok(None);
    };
    let removed = run.pairs(&better).map(|(signal, before, after)| {
        let gap = GapOf::new([before.after, after.after, after.noise]);
        (signal, gap.removed)
    });
    let found = Formula {
        removed: removed.collect(),
        supported: formula::supported(fit),
        terms: formula::terms(&engine, &selection, &taken, &tables),
    };
    let kinds = better.fitted.effects.iter().map(|own| own.kind);
    let found_terms = kinds.filter_map(|kind| Some((kind, tables.get(kind.name)?.clone())));
    let found_terms: Vec<_> = found_terms.collect();
    better.fitted.catalogue = rig.catalogue.clone();
    for (kind, table) in found_terms {
        better.fitted.declare(kind, table);
    }
    Ok(Some((found, better)))
}

/// What is expected of a rig of which calibrated values are no plant that can follow `record`.
fn astray(record: &Record) -> String {
    format!(
        "tolerances within which the plant can follow {}, found calibrated values with which it \
         cannot; smaller ones keep them from there",
        record.file()
    )
}

/// The posterior, without what hardly anything speaks for.
pub(super) fn hypotheses(
    selection: &Selection,
    unknown_in: impl Fn(Blocks) -> Vec<&'static str>,
) -> Vec<Hypothesis> {
    let mut left = 1.0;
    let mut listed = selection.posterior.iter().take_while(|set| {
        let is_listed = left > UNLISTED;
        left -= set.probability;
        is_listed
    });
    listed
        .by_ref()
        .map(|set| Hypothesis {
            effects: set.effects.clone(),
            unknown: unknown_in(set.unknown),
            probability: set.probability,
        })
        .collect()
}

/// What is doubtful about records and rig.
fn warnings(model: &MuscleModel, calibrated: &[Calibrated]) -> Vec<String> {
    let mut warnings = model.warnings();
    for value in calibrated
        .iter()
        .filter(|value| value.deviation.abs() > FAR)
    {
        warnings.push(format!(
            "{} is off by {:.1} of its standard deviations: the records may be of another rig",
            value.key, value.deviation
        ));
    }
    warnings
}

/// Of signals that the fitted rig may predict worse than the nominal one: those that it does on
/// the validation records, and those of which something is left without a name, as values
/// calibrated in place of an unknown effect hold for the records that they were fitted to.
fn predictions(gap: &[(&'static str, GapOf)], verdict: Verdict) -> Vec<String> {
    let remaining = gap.iter().filter(|(_, gap)| gap.remains());
    let (worse, rest): (Vec<_>, Vec<_>) = remaining.partition(|(_, gap)| gap.is_worse());
    let mut warnings: Vec<String> = worse
        .iter()
        .map(|(signal, gap)| {
            format!(
                "{signal}: the fitted rig predicts the validation records worse than the nominal \
                 one, by {} in place of {} root mean square",
                significant(gap.after),
                significant(gap.before)
            )
        })
        .collect();
    if matches!(verdict, Verdict::Unexplained | Verdict::Partial) && !rest.is_empty() {
        let signals: Vec<&str> = rest.iter().map(|(signal, _)| *signal).collect();
        warnings.push(format!(
            "{}: what is left has no name, so the calibrated values may predict other records \
             worse than the nominal ones",
            signals.join(", ")
        ));
    }
    warnings
}

/// The deviations of the nominal values of the rig that is written, in standard deviations.
fn nominal_of(engine: &Engine<MuscleModel>, selection: &Selection, taken: &Fitted) -> Vec<f64> {
    let model = engine.model;
    let nominal = if selection.verdict == Verdict::Unexplained {
        // What is unknown must not be taken up by nominal values.
        let weights = engine.nominal_beside_unknown(&selection.null);
        weights.unwrap_or_else(|| vec![0.0; taken.fit.nominal.len()])
    } else {
        model.refined(&taken.fit.nominal, &taken.fit.effects)
    };
    model.readable(nominal)
}

fn named(engine: &Engine<MuscleModel>, selection: &Selection, taken: &Fitted) -> Vec<Named> {
    let all = engine.model.candidates();
    let intervals = engine.intervals(taken);
    let shapes = engine.shapes(taken);
    let of = |(place, (candidate, values)): (usize, &Active)| {
        let (effect, form) = (all[*candidate].effect, all[*candidate].form);
        let kind = engine.model.catalogue().find(effect)?;
        let parameters = all[*candidate].parameters.iter().zip(values).enumerate();
        let parameters = parameters.map(|(number, (parameter, value))| {
            let known = intervals.as_ref().map(|all| all[place][number]);
            let estimate = Estimate {
                value: *value,
                ci95: known.unwrap_or([parameter.range.0, parameter.range.1]),
                unit: parameter.unit,
            };
            (parameter.name, estimate)
        });
        Some(Named {
            name: effect,
            form,
            place: kind.subsystem.name(),
            parameters: parameters.collect(),
            shape: shapes.get(place).cloned().flatten(),
            probability: *selection.probabilities.get(place)?,
            alternatives: selection
                .alternatives
                .get(place)
                .cloned()
                .unwrap_or_default(),
            evidence: Evidence {
                gain_nats: selection.gain_nats(effect),
                signature: kind.signature,
                source: kind.form(form)?.source,
                leaves_out: kind.form(form)?.leaves_out,
            },
        })
    };
    taken
        .fit
        .effects
        .iter()
        .enumerate()
        .filter_map(of)
        .collect()
}

pub(super) fn blocks(model: &impl Model, null: &Fitted, taken: &Fitted) -> Vec<BlockOf> {
    // Where nothing is named, before is as after, not as it was compared.
    let named = !taken.candidates.is_empty();
    let null = if named { null } else { taken };
    let mean = |h: &Fitted, block: usize| {
        let part = h.fit.parts.iter().find(|part| part.block == block);
        let Tally { outside, count, .. } = part.map(Part::total).unwrap_or_default();
        2.0 * outside / count.max(1) as f64
    };
    let of = |(block, name): (usize, &&'static str)| BlockOf {
        block: name,
        before: mean(null, block),
        after: mean(taken, block),
        profiles: [null, taken].map(|h| profiles(model, h, block)),
    };
    model.blocks().iter().enumerate().map(of).collect()
}

fn gaps(
    model: &MuscleModel,
    rig: &Rig,
    validate: &[Record],
    free_runs: &[[Record; 2]],
) -> Vec<(&'static str, GapOf)> {
    let mut sums: BTreeMap<&'static str, ([f64; 3], f64)> = BTreeMap::new();
    let noise = model.noise();
    let noise = &noise[noise.len() - validate.len()..];
    for ((record, runs), noise) in validate.iter().zip(free_runs).zip(noise) {
        let which = simulated(rig, record);
        let [before, after] = [0, 1].map(|place| gap::gaps(record, &runs[place], which));
        for (before, after) in before.iter().zip(&after) {
            let (squares, samples) = sums.entry(before.signal).or_default();
            let size = before.samples as f64;
            let values = [before.rms, after.rms, noise.of(before.signal)];
            for (sum, value) in squares.iter_mut().zip(values) {
                *sum += size * value * value;
            }
            *samples += size;
        }
    }
    let gap_of = |(signal, (squares, samples)): (&'static str, ([f64; 3], f64))| {
        (
            signal,
            GapOf::new(squares.map(|sum| (sum / samples).sqrt())),
        )
    };
    let mut gaps: Vec<_> = sums.into_iter().map(gap_of).collect();
    gaps.sort_by(|(_, one), (_, other)| one.worst_first(other));
    gaps
}

/// The experiment that would tell what the records leave open.
fn next_experiment(model: &MuscleModel, selection: &Selection, effects: &[Named]) -> String {
    let told = |name: &str| model.catalogue().find(name).map(|kind| kind.test_signal);
    if let Some(open) = effects
        .iter()
        .find(|effect| !effect.alternatives.is_empty())
    {
        let names = open.alternatives.join(", ");
        let experiment = told(open.name).unwrap_or_default();
        return format!("To tell {} from {names}: {experiment}", open.name);
    }
    if let Some(effect) = effects.first() {
        let experiment = told(effect.name).unwrap_or_default();
        return format!("To know {} better: {experiment}", effect.name);
    }
    match selection.verdict {
        Verdict::Consistent => "None: the records ask for no effect. To be surer, record larger \
                                and faster motions."
            .into(),
        _ if model.repeated() => {
            "Hold the pressure where the gap is largest, rising and falling, at each \
                          length twice: what comes back belongs to the rig."
                .into()
        }
        _ => "Repeat one record unchanged: what comes back at the same place belongs to the rig, \
              what does not is a disturbance. Then hold the pressure where the gap is largest."
            .into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_gap_is_first() {
        let noise = 1.0;
        let gap = |before, after| GapOf::new([before, after, noise]);
        let worst_first = [
            gap(10.0, 30.0),
            gap(1.0, 2.0),
            gap(10.0, 9.0),
            gap(10.0, 5.0),
            gap(10.0, 1.0),
            gap(1.1, 1.0),
        ];
        let mut sorted = worst_first;
        sorted.reverse();
        sorted.sort_by(GapOf::worst_first);
        let after = |gaps: [GapOf; 6]| gaps.map(|gap| (gap.before, gap.after));
        assert_eq!(after(sorted), after(worst_first));
        assert_eq!(
            worst_first.map(|gap| gap.is_worse())[..3],
            [true, true, false]
        );
        // Of what is above the noise: √(10² − 1) before, √(5² − 1) after.
        let removed = worst_first[3].removed.expect("a share");
        assert!((removed - (1.0 - (24.0_f64 / 99.0).sqrt())).abs() < 1e-12);
        assert_eq!(worst_first[4].removed, Some(1.0));
        assert_eq!(worst_first[5].removed, None, "within the noise");
    }
}

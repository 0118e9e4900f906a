//! A formula for what has no name: which terms of a list, over the inputs of the subsystem and its
//! memories, explain what is left, by the same evidence that names effects.

use super::muscle::{FORCE, GAS, LOAD, MuscleModel};
use super::rhythm::{Left, Rhythm, rhythm};
use crate::error::BadInput;
use crate::own_effect;
use crate::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record, TIME_S};
use crate::rig::{Rig, effect_toml};
use model_discrepancy::engine::{Active, Engine, Hypothesis, Model};
use model_discrepancy::rows::Timeline;
use model_discrepancy::verdict::{Selection, probability};
use muscle_plant::effects::{Catalogue, EffectKind};
use muscle_plant::nominal::Load;
use serde::Serialize;
use std::collections::BTreeMap;
use toml_edit::{Array, DocumentMut, Item, Table, value};

/// The terms, each a table `[own_effect.NAME]` in one paragraph.
const TERMS: &str = include_str!("terms.toml");
/// With what their names begin.
const PREFIX: &str = "formula-";

/// A parameter of a named effect.
#[derive(Clone, Debug, Serialize)]
pub struct Estimate {
    /// Its value, in `unit`.
    pub value: f64,
    /// Its 95 % confidence interval.
    pub ci95: [f64; 2],
    /// Its unit.
    pub unit: &'static str,
}

/// A quantity of a term that is not fitted.
#[derive(Clone, Debug, Serialize)]
pub struct Constant {
    /// Its value, in `unit`.
    pub value: f64,
    /// Its unit.
    pub unit: String,
}

/// One term of a formula.
#[derive(Clone, Debug, Serialize)]
pub struct Term {
    /// Its name in the fitted rig; it says what it depends on, not what it is.
    pub name: &'static str,
    /// The subsystem that it acts on.
    #[serde(rename = "where")]
    pub place: &'static str,
    /// What is added, as an expression of inputs, states, parameters and constants.
    pub expression: &'static str,
    /// Its constants.
    pub constants: BTreeMap<String, Constant>,
    /// Its parameters.
    pub parameters: BTreeMap<&'static str, Estimate>,
    /// Probability that the formula needs it.
    pub probability: f64,
}

/// A sum of terms in the place of an effect without a name.
#[derive(Clone, Debug, Serialize)]
pub struct Formula {
    /// The terms.
    pub terms: Vec<Term>,
    /// By signal: share of the gap above the noise that it removes on the validation records,
    /// beside what is named; none where the gap was hardly above the noise.
    pub removed: BTreeMap<&'static str, Option<f64>>,
    /// The range of each input in the fitted records: it holds there only.
    pub supported: BTreeMap<&'static str, [f64; 2]>,
}

/// The strongest rhythms in what is left in each block.
#[derive(Clone, Copy, Default)]
pub(super) struct Rhythms {
    gas: Option<Rhythm>,
    force: Option<Rhythm>,
    load: Option<Rhythm>,
}

impl Rhythms {
    /// In what `hypothesis` leaves of `fitted`, the records that were fitted, in the blocks `left`.
    pub(super) fn of(
        model: &MuscleModel,
        fitted: &[Record],
        hypothesis: &Hypothesis,
        left: &[usize],
    ) -> Rhythms {
        let fit = &hypothesis.fit;
        let of_record = |block: usize, record: usize| -> Option<Left> {
            let residuals = model.residuals(record, block, &fit.nominal, &fit.effects)?;
            let begin_s = fitted[record].time_s().first()?;
            let Timeline { time_s, base } = model.timeline(record, block);
            let rows = time_s.iter().zip(&base).zip(residuals.outside());
            // What is exact, or a record's own, was measured at no time.
            let measured = rows.filter(|((_, base), _)| **base > 0.0);
            Some(
                measured
                    .map(|((since_s, _), left)| (begin_s + since_s, left))
                    .unzip(),
            )
        };
        let of = |name: &str| {
            let block = left.iter().find(|block| model.blocks()[**block] == name)?;
            let records = (0..fitted.len()).filter_map(|record| of_record(*block, record));
            rhythm(&records.collect::<Vec<_>>())
        };
        Rhythms {
            gas: of(GAS),
            force: of(FORCE),
            load: of(LOAD),
        }
    }

    /// The paragraph of a term of [`TERMS`] with its periods; none of one without them.
    fn write(&self, paragraph: &str) -> Option<String> {
        if !paragraph.contains("PERIOD") {
            return Some(paragraph.into());
        }
        let acts_on = |place: &str| paragraph.contains(&format!("subsystem = \"{place}\""));
        let rhythm = if acts_on("load") {
            self.load?
        } else if acts_on("muscle-force") {
            // Without measured force the balance of forces tells of the muscle's, too.
            self.force.or(self.load)?
        } else {
            self.gas?
        };
        // The longer words first, of which others are a part.
        let words = [
            ("PULSE_PERIOD_S", rhythm.pulse_period_s),
            ("PULSE_AT_S", rhythm.pulse_at_s),
            ("PERIOD_S", rhythm.period_s),
            // Anywhere in a wide pulse may be its largest part.
            ("LATER_MAX_S", 6.0 * rhythm.part_s()),
            ("LATER_S", 0.5 * rhythm.part_s()),
        ];
        let put =
            |text: String, (word, value): (&str, f64)| text.replace(word, &format!("{value:e}"));
        Some(words.into_iter().fold(paragraph.into(), put))
    }
}

/// The tables of all terms by their names, with sizes for the rig and, of those in time, the
/// periods of `rhythms`.
fn tables(rig: &Rig, rhythms: Rhythms) -> Table {
    let muscle = &rig.nominal.muscle;
    let force_n = match rig.nominal.load {
        Load::Weight(weight) => weight.mass_kg * model_core::constants::GRAVITY_M_PER_S2,
        Load::Prescribed => 1e5 * muscle.force_per_pressure_m2(0.0).abs(),
    };
    let valve = rig.nominal.valve.as_ref();
    let flow = 1e5 * valve.map_or(1e-7, |valve| valve.flow_gain_kg_per_pa_s);
    let number = |value: f64| format!("{value:.3e}");
    let paragraphs = TERMS.split("\n\n");
    let paragraphs: Vec<_> = paragraphs.filter_map(|own| rhythms.write(own)).collect();
    // The longer words first, of which others are a part.
    let text = paragraphs
        .join("\n\n")
        .replace("MANY_N", &number(10.0 * force_n))
        .replace("FORCE_N", &number(0.05 * force_n))
        .replace("MANY_FLOW", &number(2.0 * flow))
        .replace("FLOW", &number(0.05 * flow))
        .replace("PRESSURE_PA", "3e5");
    let mut tables = own_effect::tables(text.parse().unwrap_or_default());
    // What has no name may vary with anything.
    let quantities: Array = own_effect::QUANTITIES
        .iter()
        .map(|(name, _)| *name)
        .collect();
    for (_, table) in tables.iter_mut() {
        table["law_quantities"] = value(quantities.clone());
    }
    tables
}

/// `rig` with the terms on `places`, and of readings, in the place of all effects that may be
/// found, and the tables of the terms. Those that the rig has are not found again.
///
/// # Errors
/// None that a test does not exclude.
pub(super) fn with_terms(
    rig: &Rig,
    places: &[&str],
    rhythms: Rhythms,
) -> Result<(Rig, Table), BadInput> {
    let mut tables = tables(rig, rhythms);
    let acts = |table: &Item| {
        // What is left of the gas may be the valve's.
        let place = table.get("subsystem").and_then(Item::as_str);
        place.is_some_and(|place| {
            places.contains(&place)
                || place == "valve" && places.contains(&"gas")
                || place == "sensor"
        })
    };
    let has = |name: &str| rig.effects.iter().any(|effect| effect.kind.name == name);
    tables.retain(|name, table| acts(table) && !has(name));
    let mut document = DocumentMut::new();
    document.insert(own_effect::KEY, Item::Table(tables.clone()));
    let declared = own_effect::from_toml("terms.toml", &document.to_string())?;
    let mut rig = rig.clone();
    rig.catalogue = declared
        .into_iter()
        .fold(Catalogue::empty(), Catalogue::with);
    Ok((rig, tables))
}

/// The constants of a term's table.
fn constants(table: &Item) -> BTreeMap<String, Constant> {
    let all = table.get("constant").and_then(Item::as_table_like);
    let all = all.into_iter().flat_map(|all| all.iter());
    let constant = |(name, own): (&str, &Item)| {
        let value = own.get("value")?;
        let whole = || value.as_integer().map(|value| value as f64);
        let constant = Constant {
            value: value.as_float().or_else(whole)?,
            unit: own.get("unit")?.as_str()?.into(),
        };
        Some((name.into(), constant))
    };
    all.filter_map(constant).collect()
}

/// The effects of `taken`, the most probable set of `selection`, as terms, which `tables` declare.
pub(super) fn terms(
    engine: &Engine<MuscleModel>,
    selection: &Selection,
    taken: &Hypothesis,
    tables: &Table,
) -> Vec<Term> {
    let is_certain = selection
        .posterior
        .first()
        .is_some_and(|set| set.unknown == 0);
    let intervals = match is_certain {
        true => engine.intervals(taken),
        false => engine.intervals_beside_unknown(taken),
    };
    let all = engine.model.candidates();
    let of = |(place, (candidate, values)): (usize, &Active)| {
        let own = &all[*candidate];
        let kind = engine.model.catalogue().find(own.effect)?;
        let parameters = own.parameters.iter().zip(values).enumerate();
        let parameters = parameters.map(|(number, (parameter, value))| {
            let (low, high) = parameter.range;
            let known = intervals.as_ref().map(|all| all[place][number]);
            let estimate = Estimate {
                value: *value,
                ci95: known.unwrap_or([low, high]),
                unit: parameter.unit,
            };
            (parameter.name, estimate)
        });
        Some(Term {
            name: kind.name,
            place: kind.subsystem.name(),
            expression: kind.form(own.form)?.equation,
            constants: tables.get(kind.name).map(constants).unwrap_or_default(),
            parameters: parameters.collect(),
            probability: probability(&selection.posterior, |set| {
                set.effects.contains(&own.effect)
            }),
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

/// Whether `kind` is a term of a formula.
pub(super) fn is_term(kind: &EffectKind) -> bool {
    kind.name.starts_with(PREFIX)
}

/// The range of time and of each measured input of a formula in `records`.
pub(super) fn supported(records: &[Record]) -> BTreeMap<&'static str, [f64; 2]> {
    let range = |name: &'static str, columns: Vec<&[f64]>| {
        let values = columns.into_iter().flatten().copied();
        let empty = [f64::INFINITY, f64::NEG_INFINITY];
        let known = values.filter(|value| !value.is_nan());
        let [low, high] = known.fold(empty, |[low, high], value| {
            [low.min(value), high.max(value)]
        });
        (low <= high).then_some((name, [low, high]))
    };
    let inputs = [PRESSURE_REF_PA, PRESSURE_PA, CONTRACTION].into_iter();
    let inputs = inputs.filter_map(|name| {
        let columns = records.iter().filter_map(|record| record.column(name));
        range(name, columns.collect())
    });
    let times = records.iter().map(Record::time_s).collect();
    inputs.chain(range(TIME_S, times)).collect()
}

/// The formula's terms as a file of effects of one's own, to be renamed, with the lines that add
/// them to a rig as comments.
pub fn as_own_effects(fitted: &Rig) -> Option<String> {
    let is_used = |name: &str| fitted.effects.iter().any(|effect| effect.kind.name == name);
    let mut declared = fitted.own_effects.clone();
    declared.retain(|name, _| name.starts_with(PREFIX) && is_used(name));
    if declared.is_empty() {
        return None;
    }
    let effects = fitted.effects.iter().filter(|own| is_term(own.kind));
    let lines = effects.map(effect_toml).collect::<Vec<_>>().join("\n");
    let lines = lines
        .lines()
        .map(|line| format!("# {line}\n"))
        .collect::<String>();
    declared.set_implicit(true);
    let mut document = DocumentMut::new();
    document.insert(own_effect::KEY, Item::Table(declared));
    Some(format!(
        "# A formula that diagnose found where no effect has a name. It holds in the range of its\n\
         # records. Rename it when you know what it is. For a rig that has it:\n\
         #\n{lines}{document}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use muscle_plant::effects::Effect;

    #[test]
    fn the_terms_are_effects_of_ones_own_for_any_rig() {
        let rig = Rig::reference();
        let places = ["muscle-force", "load", "gas"];
        let known = Some(Rhythm {
            period_s: 1.3,
            pulse_period_s: 2.5,
            pulse_at_s: 0.2,
        });
        let rhythms = Rhythms {
            gas: known,
            force: known,
            load: known,
        };
        let (terms, tables) = with_terms(&rig, &places, rhythms).expect("terms");
        assert_eq!(
            terms.catalogue.kinds().count(),
            TERMS.matches("\nsubsystem = ").count()
        );
        assert!(
            terms
                .catalogue
                .kinds()
                .all(|kind| kind.name.starts_with("formula-"))
        );
        let (gas, _) = with_terms(&rig, &["gas"], rhythms).expect("terms");
        assert_eq!(gas.catalogue.kinds().count(), 8);
        let (calm, _) = with_terms(&rig, &["gas"], Rhythms::default()).expect("terms");
        assert_eq!(calm.catalogue.kinds().count(), 5);
        let of_pulses = constants(&tables["formula-load-pulses"]);
        assert_eq!(of_pulses["period_s"].value, 2.5);
        assert_eq!(of_pulses["period_s"].unit, "s");
        // Each can be written into a rig, and read again.
        for kind in terms.catalogue.kinds() {
            let mut with = rig.clone();
            with.effects.push(Effect::typical(kind, &kind.forms[0]));
            with.declare(kind, tables[kind.name].clone());
            assert!(as_own_effects(&with).is_some());
            let text = with.rewritten(Rig::REFERENCE_TOML).expect("TOML");
            let read = Rig::parse("rig.toml", &text).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(read.effects[0].kind.name, kind.name);
            // Nothing is declared twice, and no term that the rig has is found again.
            let mut again = read.clone();
            again.declare(kind, tables[kind.name].clone());
            assert_eq!(again.rewritten(&text).as_ref(), Ok(&text));
            let (other, _) = with_terms(&read, &places, rhythms).expect("terms");
            assert!(other.catalogue.find(kind.name).is_none());
        }
    }
}

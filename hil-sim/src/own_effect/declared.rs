//! Reading the tables `[own_effect.NAME]`.

use super::dimension::Dimension;
use super::expression::{Expression, is_reserved};
use super::term::{self, Change, OwnTerm, Place, State, VALUES_MAX};
use super::tried;
use crate::error::{BadInput, one_of, shown};
use crate::input::read_text;
use indexmap::IndexMap;
use muscle_plant::effects::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
use muscle_plant::subsystem::Subsystem;
use serde::Deserialize;
use serde_spanned::Spanned;
use std::collections::HashMap;
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use toml_edit::{DocumentMut, Item, Table};

/// The key of the tables in a rig file.
pub const KEY: &str = "own_effect";
/// The key of the files beside a rig file that have such tables.
pub const FILES_KEY: &str = "own_effect_files";
/// Parameters at most: a diagnosis resolves no more.
const PARAMETERS_MAX: usize = 5;
/// States at most.
const STATES_MAX: usize = 6;
/// The quantities with which the law of an effect may vary, by name.
pub(crate) const QUANTITIES: [(&str, Quantity); 4] = [
    ("pressure_pa", Quantity::Pressure),
    ("pressure_rate_pa_per_s", Quantity::PressureRate),
    ("contraction", Quantity::Contraction),
    ("contraction_rate_per_s", Quantity::ContractionRate),
];
/// Typical values of a state, in SI units.
const TYPICAL: RangeInclusive<f64> = 1e-12..=1e12;

/// One table: an effect with one form, which stands in the table itself, or with several.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Declared {
    subsystem: Spanned<String>,
    #[serde(default = "not_stated")]
    signature: String,
    #[serde(default = "not_stated")]
    test_signal: String,
    discrepancy_ratio: Option<Spanned<f64>>,
    law_quantities: Option<Vec<Spanned<String>>>,
    #[serde(default)]
    form: IndexMap<String, Spanned<DeclaredForm>>,
    source: Option<String>,
    leaves_out: Option<String>,
    parameter: Option<IndexMap<String, Spanned<DeclaredParameter>>>,
    constant: Option<IndexMap<String, Spanned<Constant>>>,
    state: Option<IndexMap<String, Spanned<DeclaredState>>>,
    adds: Option<Spanned<IndexMap<String, Spanned<String>>>>,
}

/// One set of equations.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DeclaredForm {
    #[serde(default = "not_stated")]
    source: String,
    #[serde(default = "nothing_stated")]
    leaves_out: String,
    #[serde(default)]
    parameter: IndexMap<String, Spanned<DeclaredParameter>>,
    #[serde(default)]
    constant: IndexMap<String, Spanned<Constant>>,
    #[serde(default)]
    state: IndexMap<String, Spanned<DeclaredState>>,
    adds: Spanned<IndexMap<String, Spanned<String>>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DeclaredParameter {
    unit: Option<String>,
    min: f64,
    max: f64,
    typical: f64,
    #[serde(default)]
    log: bool,
    neutral: Option<f64>,
    #[serde(default)]
    physical_min: bool,
    #[serde(default)]
    physical_max: bool,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Constant {
    unit: Option<String>,
    value: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DeclaredState {
    unit: Option<String>,
    typical: f64,
    steady: Spanned<String>,
    rate: Option<Spanned<String>>,
    update: Option<Spanned<String>>,
    after_contraction: Option<Spanned<String>>,
    after_extension: Option<Spanned<String>>,
}

fn not_stated() -> String {
    "not stated.".into()
}

fn nothing_stated() -> String {
    "nothing that is stated".into()
}

/// What is wrong, and where in the text.
pub(super) struct Wrong {
    pub key: String,
    pub span: Range<usize>,
    pub expected: String,
}

/// The effects that `text`, TOML of the file `file`, declares.
///
/// # Errors
/// A table is not an effect that can be simulated, with line, key and what was expected.
pub fn from_toml(file: &str, text: &str) -> Result<Vec<&'static EffectKind>, BadInput> {
    #[derive(Deserialize)]
    struct File {
        #[serde(default)]
        own_effect: IndexMap<String, Spanned<Declared>>,
    }
    /// What makes two declarations the same, wherever they stand.
    #[derive(Default, Deserialize)]
    struct Contents {
        #[serde(default)]
        own_effect: IndexMap<String, serde_json::Value>,
    }
    let bad = |span: Option<Range<usize>>, key: String, expected: String| BadInput {
        file: file.into(),
        line: span.map(|span| 1 + text[..span.start].matches('\n').count()),
        place: Some(format!("key `{key}`")),
        expected,
    };
    let read: Result<File, _> = toml_edit::de::from_str(text);
    let read = read.map_err(|error| {
        let expected = format!(
            "an effect of your own, {}",
            error.message().replace('\n', " ")
        );
        bad(error.span(), KEY.into(), expected)
    })?;
    let contents: Contents = toml_edit::de::from_str(text).unwrap_or_default();
    let kinds = read.own_effect.iter().map(|(name, declared)| {
        let contents = contents.own_effect.get(name);
        let identity = contents.map(|contents| format!("{name} {contents}"));
        kind(name, declared, identity.unwrap_or_else(|| text.into())).map_err(|wrong| {
            let key = format!("{KEY}.{name}{}", wrong.key);
            bad(Some(wrong.span), key, wrong.expected)
        })
    });
    kinds.collect()
}

/// The effects that the file at `path` declares, and their tables by their names.
///
/// # Errors
/// It cannot be read, has something else, or as [`from_toml`].
pub fn read_file(path: &Path) -> Result<(Vec<&'static EffectKind>, Table), BadInput> {
    let file = path.display().to_string();
    let text = read_text(path, "a readable TOML file of effects")?;
    let kinds = from_toml(&file, &text)?;
    let expected = "tables `[own_effect.NAME]`";
    let document: DocumentMut = text.parse().map_err(|_| BadInput::file(&file, expected))?;
    if let Some((other, _)) = document.iter().find(|(key, _)| *key != KEY) {
        let expected = format!("{expected} and nothing else, found {other}");
        return Err(BadInput::file(&file, &expected));
    }
    let table = tables(document);
    if table.is_empty() {
        return Err(BadInput::file(&file, format!("{expected}, found none")));
    }
    Ok((kinds, table))
}

/// The tables of a document's effects by their names, free to be put into another document.
pub fn tables(mut document: DocumentMut) -> Table {
    let table = document.remove(KEY).and_then(|item| item.into_table().ok());
    let mut table = table.unwrap_or_default();
    unplace(&mut table);
    table
}

/// Forgets where a table and those in it stood in their document.
fn unplace(table: &mut Table) {
    table.set_position(None);
    for (_, item) in table.iter_mut() {
        if let Item::Table(inner) = item {
            unplace(inner);
        }
    }
}

/// The effects that were declared so far, by their declaration: they live as long as the program,
/// as those of the catalogue do.
static DECLARED: Mutex<Option<HashMap<String, &'static EffectKind>>> = Mutex::new(None);

fn kind(
    name: &str,
    declared: &Spanned<Declared>,
    identity: String,
) -> Result<&'static EffectKind, Wrong> {
    let mut known = DECLARED.lock().unwrap_or_else(PoisonError::into_inner);
    let known = known.get_or_insert_default();
    if let Some(kind) = known.get(&identity) {
        return Ok(kind);
    }
    let wrong = |expected: &str| Wrong {
        key: String::new(),
        span: declared.span(),
        expected: expected.into(),
    };
    let is_kebab =
        |letter: char| letter.is_ascii_lowercase() || letter == '-' || letter.is_ascii_digit();
    if name.is_empty() || !name.chars().all(is_kebab) {
        return Err(wrong("a name of small letters, digits and hyphens"));
    }
    let kind = with_forms(name, declared)?;
    let kind: &'static EffectKind = Box::leak(Box::new(kind));
    known.insert(identity, kind);
    Ok(kind)
}

/// The name of a form that stands in the effect's own table.
const ONLY_FORM: &str = "own";

fn with_forms(name: &str, spanned: &Spanned<Declared>) -> Result<EffectKind, Wrong> {
    let declared = spanned.get_ref();
    let (subsystem, place) = place(&declared.subsystem)?;
    let only = declared.adds.as_ref().map(|adds| DeclaredForm {
        source: declared.source.clone().unwrap_or_else(not_stated),
        leaves_out: declared.leaves_out.clone().unwrap_or_else(nothing_stated),
        parameter: declared.parameter.clone().unwrap_or_default(),
        constant: declared.constant.clone().unwrap_or_default(),
        state: declared.state.clone().unwrap_or_default(),
        adds: adds.clone(),
    });
    let inline =
        declared.parameter.is_some() || declared.constant.is_some() || declared.state.is_some();
    if only.is_some() != declared.form.is_empty() || inline && only.is_none() {
        return Err(Wrong {
            key: ".adds".into(),
            span: spanned.span(),
            expected: "what the effect `adds`, or tables `form.NAME` that each say so".into(),
        });
    }
    let form = |own: &DeclaredForm, form: &str, key: String| {
        let read = Reading::new(own, subsystem, place).and_then(|reading| reading.form(form));
        read.map_err(|wrong| Wrong {
            key: key + &wrong.key,
            ..wrong
        })
    };
    let forms: Vec<Form> = match &only {
        Some(own) => vec![form(own, ONLY_FORM, String::new())?],
        None => declared
            .form
            .iter()
            .map(|(name, own)| form(own.get_ref(), name, format!(".form.{name}")))
            .collect::<Result<_, _>>()?,
    };
    let discrepancy_ratio = declared.discrepancy_ratio.as_ref();
    if let Some(ratio) = discrepancy_ratio.filter(|ratio| !(0.0..1.0).contains(ratio.get_ref())) {
        return Err(Wrong {
            key: ".discrepancy_ratio".into(),
            span: ratio.span(),
            expected: format!("a number from 0 to 1, found {}", ratio.get_ref()),
        });
    }
    let adds = |quantity: &str| {
        let forms = only
            .iter()
            .chain(declared.form.values().map(Spanned::get_ref));
        forms
            .into_iter()
            .any(|own| own.adds.get_ref().contains_key(quantity))
    };
    let (equations, requires) = shows(subsystem, adds);
    Ok(EffectKind {
        name: leaked(name),
        subsystem,
        equations,
        requires,
        signature: leaked(&declared.signature),
        test_signal: leaked(&declared.test_signal),
        discrepancy_ratio: discrepancy_ratio.map_or(DISCREPANCY_RATIO, |ratio| *ratio.get_ref()),
        law_quantities: law_quantities(declared.law_quantities.as_deref(), subsystem)?,
        compensation: CompensationMethod::Unavailable(
            "the controller does not know effects of one's own",
        ),
        forms: forms.leak(),
    })
}

/// The equations that an effect of `subsystem` changes, and what a record must contain.
fn shows(
    subsystem: Subsystem,
    adds: impl Fn(&str) -> bool,
) -> (&'static [Equation], &'static [Requirement]) {
    match subsystem {
        Subsystem::MuscleForce => (&[Equation::MuscleForce], &[]),
        Subsystem::Load => (&[Equation::Load], &[Requirement::Motion]),
        Subsystem::Sensor if adds("contraction") => {
            (&[Equation::Gas, Equation::MuscleForce, Equation::Load], &[])
        }
        Subsystem::Sensor if adds("pressure_pa") => (&[Equation::Gas, Equation::MuscleForce], &[]),
        Subsystem::Sensor => (
            &[Equation::MuscleForce, Equation::Load],
            &[Requirement::MeasuredForce],
        ),
        _ => (&[Equation::Gas], &[]),
    }
}

/// The quantities of those names, with which the law of an effect may vary; without names those
/// that a part of `subsystem` can feel: a valve knows nothing of the contraction.
fn law_quantities(
    names: Option<&[Spanned<String>]>,
    subsystem: Subsystem,
) -> Result<&'static [Quantity], Wrong> {
    let Some(names) = names else {
        return Ok(match subsystem {
            Subsystem::MuscleForce => &[
                Quantity::Pressure,
                Quantity::Contraction,
                Quantity::ContractionRate,
            ],
            Subsystem::Load => &[Quantity::Contraction, Quantity::ContractionRate],
            Subsystem::Sensor => &[Quantity::Pressure, Quantity::Contraction],
            Subsystem::Valve | Subsystem::Line | Subsystem::Supply => {
                &[Quantity::Pressure, Quantity::PressureRate]
            }
            Subsystem::Gas => Quantity::ALL,
        });
    };
    let quantity = |name: &Spanned<String>| {
        let found = QUANTITIES.iter().find(|(own, _)| own == name.get_ref());
        let found = found.map(|(_, quantity)| *quantity);
        found.ok_or_else(|| Wrong {
            key: ".law_quantities".into(),
            span: name.span(),
            expected: one_of(&QUANTITIES.map(|(own, _)| own), name.get_ref()),
        })
    };
    let quantities: Vec<_> = names.iter().map(quantity).collect::<Result<_, _>>()?;
    Ok(quantities.leak())
}

/// The subsystem of that name.
fn place(name: &Spanned<String>) -> Result<(Subsystem, Place), Wrong> {
    let places = [
        (Subsystem::MuscleForce, term::MUSCLE),
        (Subsystem::Load, term::LOAD),
        (Subsystem::Valve, term::VALVE),
        (Subsystem::Line, term::LINE),
        (Subsystem::Gas, term::GAS),
        (Subsystem::Supply, term::SUPPLY),
        (Subsystem::Sensor, term::SENSOR),
    ];
    let found = places
        .into_iter()
        .find(|(own, _)| own.name() == name.get_ref());
    found.ok_or_else(|| Wrong {
        key: ".subsystem".into(),
        span: name.span(),
        expected: one_of(&places.map(|(own, _)| own.name()), name.get_ref()),
    })
}

/// A form whose names are known: inputs, states, parameters and constants, with a dimension
/// for each that has a unit.
struct Reading<'a> {
    declared: &'a DeclaredForm,
    subsystem: Subsystem,
    place: Place,
    names: Vec<&'a str>,
    dimensions: Vec<Option<Dimension>>,
}

impl<'a> Reading<'a> {
    fn new(
        declared: &'a DeclaredForm,
        subsystem: Subsystem,
        place: Place,
    ) -> Result<Reading<'a>, Wrong> {
        let mut reading = Reading {
            declared,
            subsystem,
            place,
            names: vec![""; VALUES_MAX],
            dimensions: vec![None; VALUES_MAX],
        };
        reading.check_counts()?;
        let inputs = [place.inputs, place.inputs_of_states];
        let longest = inputs.into_iter().max_by_key(|inputs| inputs.len());
        for (index, (name, unit)) in longest.unwrap_or_default().iter().enumerate() {
            reading.names[index] = name;
            reading.dimensions[index] = Dimension::of_unit(unit).ok();
        }
        let first = VALUES_MAX - declared.state.len();
        for (index, (name, state)) in declared.state.iter().enumerate() {
            let key = format!(".state.{name}");
            let dimension = reading.new_name(&key, name, state.span(), &state.get_ref().unit)?;
            (
                reading.names[first + index],
                reading.dimensions[first + index],
            ) = (name, dimension);
        }
        for (name, parameter) in &declared.parameter {
            let key = format!(".parameter.{name}");
            let unit = &parameter.get_ref().unit;
            let dimension = reading.new_name(&key, name, parameter.span(), unit)?;
            reading.names.push(name);
            reading.dimensions.push(dimension);
        }
        for (name, constant) in &declared.constant {
            let key = format!(".constant.{name}");
            let unit = &constant.get_ref().unit;
            let dimension = reading.new_name(&key, name, constant.span(), unit)?;
            reading.names.push(name);
            reading.dimensions.push(dimension);
        }
        Ok(reading)
    }

    fn check_counts(&self) -> Result<(), Wrong> {
        let declared = self.declared;
        // A delay depends on nothing that changes.
        let states_max = if self.subsystem == Subsystem::Line {
            0
        } else {
            STATES_MAX
        };
        let counts = [
            ("parameter", declared.parameter.len(), 0, PARAMETERS_MAX),
            ("state", declared.state.len(), 0, states_max),
            (
                "adds",
                declared.adds.get_ref().len(),
                1,
                self.place.adds.len(),
            ),
        ];
        for (key, found, min, max) in counts {
            if !(min..=max).contains(&found) {
                return Err(Wrong {
                    key: format!(".{key}"),
                    span: declared.adds.span(),
                    expected: format!("{min} to {max} keys, found {found}"),
                });
            }
        }
        Ok(())
    }

    /// The dimension of a name that is not taken.
    fn new_name(
        &self,
        key: &str,
        name: &str,
        span: Range<usize>,
        unit: &Option<String>,
    ) -> Result<Option<Dimension>, Wrong> {
        let wrong = |expected: String| Wrong {
            key: key.into(),
            span: span.clone(),
            expected,
        };
        let mut letters = name.chars();
        let starts = letters
            .next()
            .is_some_and(|first| first.is_ascii_alphabetic());
        if !starts || !letters.all(|letter| letter.is_ascii_alphanumeric() || letter == '_') {
            return Err(wrong("a name of letters, digits and underscores".into()));
        }
        if self.names.contains(&name) || is_reserved(name) || ["name", "form"].contains(&name) {
            return Err(wrong(format!("a name that is not taken, found {name}")));
        }
        let dimension = unit.as_ref().map(|unit| Dimension::of_unit(unit));
        dimension.transpose().map_err(wrong)
    }

    /// An expression over the first `inputs` inputs, states, parameters and constants (put in), of
    /// the dimension `expected`.
    fn expression(
        &self,
        key: &str,
        text: &Spanned<String>,
        inputs: usize,
        expected: Option<Dimension>,
    ) -> Result<Expression, Wrong> {
        let wrong = |expected: String| Wrong {
            key: key.into(),
            span: text.span(),
            expected,
        };
        let states = VALUES_MAX - self.declared.state.len();
        let known = |(index, name): (usize, &&'a str)| match index {
            index if index >= inputs && index < states => "",
            _ => *name,
        };
        let names: Vec<_> = self.names.iter().enumerate().map(known).collect();
        let read = Expression::parse(text.get_ref(), &names).map_err(wrong)?;
        let first = VALUES_MAX + self.declared.parameter.len();
        let constants = self.declared.constant.values();
        let constants: Vec<f64> = constants.map(|own| own.get_ref().value).collect();
        let number = |index: usize| constants.get(index.checked_sub(first)?).copied();
        let found = read.dimension(&self.dimensions, &names, &number);
        let found = found.map_err(wrong)?;
        match (found, expected) {
            (Some(found), Some(expected)) if found != expected => {
                return Err(wrong(format!(
                    "an expression in {expected}, found {found}: if a number in it is a quantity, \
                     declare it as a constant with its unit"
                )));
            }
            _ => {}
        }
        Ok(read.with(&number))
    }

    fn state(&self, index: usize, name: &str, own: &DeclaredState) -> Result<State, Wrong> {
        let key = |part: &str| format!(".state.{name}.{part}");
        let own_index = VALUES_MAX - self.declared.state.len() + index;
        let dimension = self.dimensions[own_index];
        let inputs = self.place.inputs_of_states.len();
        let read = |part: &str, text| self.expression(&key(part), text, inputs, dimension);
        let second = Dimension::of_unit("s").ok();
        let change = match (&own.rate, &own.update) {
            (Some(rate), None) => {
                let per_time = dimension.zip(second);
                let per_time = per_time.map(|(own, second)| own.times(second.to_power(-1.0)));
                Change::Rate(self.expression(&key("rate"), rate, inputs, per_time)?, None)
            }
            (None, Some(update)) => Change::Update(read("update", update)?),
            _ => {
                return Err(Wrong {
                    key: key("rate"),
                    span: own.steady.span(),
                    expected: "either `rate`, per second, or `update`, after each step".into(),
                });
            }
        };
        if !TYPICAL.contains(&own.typical) {
            return Err(Wrong {
                key: key("typical"),
                span: own.steady.span(),
                expected: format!(
                    "a number from {} to {}, found {}",
                    shown(*TYPICAL.start()),
                    shown(*TYPICAL.end()),
                    shown(own.typical)
                ),
            });
        }
        let after_motion = match (&own.after_contraction, &own.after_extension) {
            (Some(up), Some(down)) => Some([
                read("after_contraction", up)?,
                read("after_extension", down)?,
            ]),
            (None, None) => None,
            _ => {
                return Err(Wrong {
                    key: key("after_contraction"),
                    span: own.steady.span(),
                    expected: "both `after_contraction` and `after_extension`, or none".into(),
                });
            }
        };
        Ok(State {
            typical: own.typical,
            steady: read("steady", &own.steady)?,
            change,
            after_motion,
        })
    }

    fn parameter(&self, name: &str, own: &Spanned<DeclaredParameter>) -> Result<Parameter, Wrong> {
        let (span, own) = (own.span(), own.get_ref());
        let is_inside = |value: f64| (own.min..=own.max).contains(&value);
        let expected = if !(own.min < own.max && own.min.is_finite() && own.max.is_finite()) {
            format!("`min` below `max`, found {} and {}", own.min, own.max)
        } else if !is_inside(own.typical) || own.typical == 0.0 {
            format!("`typical` in its range and not 0, found {}", own.typical)
        } else if !own.neutral.is_none_or(is_inside) {
            "`neutral` in its range".into()
        } else if own.log && own.min <= 0.0 {
            format!(
                "`min` above 0, as it is fitted by its logarithm, found {}",
                own.min
            )
        } else {
            return Ok(Parameter {
                name: leaked(name),
                unit: leaked(own.unit.as_deref().unwrap_or("-")),
                min: own.min,
                max: own.max,
                typical: own.typical,
                log: own.log,
                neutral: own.neutral,
                physical_bounds: [own.physical_min, own.physical_max],
            });
        };
        Err(Wrong {
            key: format!(".parameter.{name}"),
            span,
            expected,
        })
    }

    /// The expressions of the term, in which the parameters are names.
    fn term(&self) -> Result<OwnTerm, Wrong> {
        let declared = self.declared;
        let states = declared.state.iter().enumerate();
        let states = states.map(|(index, (name, own))| self.state(index, name, own.get_ref()));
        let adds = declared.adds.get_ref();
        let known: Vec<_> = self.place.adds.iter().map(|(name, _)| *name).collect();
        if let Some((unknown, text)) = adds
            .iter()
            .find(|(name, _)| !known.contains(&name.as_str()))
        {
            return Err(Wrong {
                key: format!(".adds.{unknown}"),
                span: text.span(),
                expected: one_of(&known, unknown),
            });
        }
        let added = self.place.adds.iter().map(|(name, unit)| {
            let text = adds.get(*name)?;
            let inputs = if self.subsystem == Subsystem::Line {
                0
            } else {
                self.place.inputs.len()
            };
            let unit = Dimension::of_unit(unit).ok();
            Some(self.expression(&format!(".adds.{name}"), text, inputs, unit))
        });
        Ok(OwnTerm {
            states: states.collect::<Result<_, _>>()?,
            adds: added.map(Option::transpose).collect::<Result<_, _>>()?,
        })
    }

    fn form(&self, name: &str) -> Result<Form, Wrong> {
        let declared = self.declared;
        let parameters = declared.parameter.iter();
        let parameters = parameters.map(|(name, own)| self.parameter(name, own));
        let parameters: Vec<Parameter> = parameters.collect::<Result<_, _>>()?;
        let term = self.term()?;
        let bind = move |values: &[f64]| bound(&term, values);
        let tried = tried::check(&bind, &parameters, &self.place, &self.names[..VALUES_MAX]);
        tried.map_err(|why| Wrong {
            key: ".adds".into(),
            span: declared.adds.span(),
            expected: why,
        })?;
        let bind: &'static (dyn Fn(&[f64]) -> OwnTerm + Sync) = Box::leak(Box::new(bind));
        let make = self.place.term;
        let is_muscle = self.subsystem == Subsystem::MuscleForce && !declared.state.is_empty();
        Ok(Form {
            name: leaked(name),
            parameters: parameters.leak(),
            equation: leaked(&self.equation()),
            source: leaked(&declared.source),
            leaves_out: leaked(declared.leaves_out.trim_end_matches('.')),
            build: Box::leak(Box::new(move |values: &[f64]| make(bind(values)))),
            observation: if is_muscle {
                Some(Box::leak(Box::new(move |values: &[f64]| {
                    Box::new(bind(values)) as _
                })))
            } else {
                None
            },
        })
    }

    /// What is added, and how the states change, as it was written.
    fn equation(&self) -> String {
        let declared = self.declared;
        let adds = declared.adds.get_ref().iter();
        let adds = adds.map(|(name, text)| format!("{name} + {}", text.get_ref()));
        let states = declared.state.iter().map(|(name, own)| {
            let own = own.get_ref();
            match (&own.rate, &own.update) {
                (Some(rate), _) => format!("d {name}/dt = {}", rate.get_ref()),
                (_, update) => {
                    let update = update.as_ref().map_or("", |text| text.get_ref());
                    format!("{name} = {update} after each step")
                }
            }
        });
        adds.chain(states).collect::<Vec<_>>().join("; ")
    }
}

/// The term with the values of its parameters.
fn bound(term: &OwnTerm, values: &[f64]) -> OwnTerm {
    let put = |expression: &Expression| {
        expression.with(&|index| values.get(index.checked_sub(VALUES_MAX)?).copied())
    };
    let first = VALUES_MAX - term.states.len();
    let state = |(index, own): (usize, &State)| State {
        typical: own.typical,
        steady: put(&own.steady),
        change: match &own.change {
            Change::Update(to) => Change::Update(put(to)),
            Change::Rate(rate, _) => {
                let rate = put(rate);
                let is_other = |name: usize| name >= first && name != first + index;
                let slope = match rate.derivative(first + index) {
                    Some(Expression::Number(slope)) if !rate.any(&is_other) => Some(slope),
                    _ => None,
                };
                Change::Rate(rate, slope)
            }
        },
        after_motion: own
            .after_motion
            .as_ref()
            .map(|after| [put(&after[0]), put(&after[1])]),
    };
    OwnTerm {
        states: term.states.iter().enumerate().map(state).collect(),
        adds: term
            .adds
            .iter()
            .map(|added| added.as_ref().map(put))
            .collect(),
    }
}

fn leaked(text: &str) -> &'static str {
    String::from(text).leak()
}

//! The variables of an FMU, made from its rig: the same list for the model description and for the
//! shared library. The value reference of a variable is its place in the list.

use crate::error::{BadInput, shown};
use crate::identify::simulate::initial_state;
use crate::record::{self, Record};
use crate::rig::{KEYS, Key, Rig};
use muscle_plant::effects::{Effect, EffectKind};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Simulated, Simulation};
use muscle_plant::subsystem::Subsystem;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// Contractions from which a simulation may start: from the weight's stop on \[-\].
const CONTRACTIONS: [f64; 2] = [0.0, 0.999];
/// Gas temperatures from which a simulation may start: air is a gas \[K\].
const TEMPERATURES_K: [f64; 2] = [80.0, 2000.0];

/// An input, which may change at each communication point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Input {
    /// Held over the step.
    ReferencePa,
    /// Held over the step.
    ValveOpen,
    SupplyPa,
    SupplyRate,
    PressurePa,
    PressureRate,
    Contraction,
    ContractionRate,
}

/// A parameter that is no number of the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Setting {
    /// The supply pressure is an input instead of the rig's.
    SupplyIsInput,
    /// The initial state is computed from the inputs, and the four settings below are ignored.
    StartsAtRest,
    InitialContraction,
    InitialContractionRate,
    InitialPressurePa,
    InitialTemperatureK,
}

/// What a variable is in the simulation.
#[derive(Clone, Copy, Debug)]
pub(super) enum Role {
    Time,
    Input(Input),
    Setting(Setting),
    /// A number of the rig's sections.
    Number(&'static Key),
    /// Whether the effect of this number is on.
    EffectOn(usize),
    /// A parameter of an effect: their numbers.
    EffectValue(usize, usize),
    Output(fn(&Simulation) -> f64),
}

/// One variable.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    pub name: String,
    pub description: String,
    /// `None`: the variable is a Boolean, 0 or 1.
    pub unit: Option<&'static str>,
    pub start: f64,
    /// Smallest and largest value.
    pub range: Option<[f64; 2]>,
    pub role: Role,
}

impl Variable {
    /// Its causality and variability in the model description.
    pub fn kind(&self) -> (&'static str, &'static str) {
        match (self.role, self.unit) {
            (Role::Time, _) => ("independent", "continuous"),
            (Role::Input(_), Some(_)) => ("input", "continuous"),
            (Role::Input(_), None) => ("input", "discrete"),
            (Role::Output(_), _) => ("output", "continuous"),
            _ => ("parameter", "fixed"),
        }
    }

    /// `value`, if the variable may have it.
    ///
    /// # Errors
    /// What was expected.
    pub fn checked(&self, value: f64) -> Result<f64, String> {
        let [min, max] = self.range.unwrap_or([f64::MIN, f64::MAX]);
        if (min..=max).contains(&value) {
            return Ok(value);
        }
        let (name, found) = (&self.name, shown(value));
        Err(match self.range {
            None => format!("variable `{name}`: expected a finite number, found {found}"),
            Some(_) => {
                let (min, max) = (shown(min), shown(max));
                format!("variable `{name}`: expected a number from {min} to {max}, found {found}")
            }
        })
    }
}

/// A rig with the effects that can be switched on, and its variables.
#[derive(Clone, Debug)]
pub struct Model {
    /// The rig; its effects are first those of its file, then the others of its catalogue.
    pub(super) rig: Rig,
    pub(super) simulated: Simulated,
    pub(super) variables: Vec<Variable>,
    /// The rig's file.
    text: String,
}

impl Model {
    /// The model of the rig in `text`, a TOML file named `name`. The pressure is simulated if the
    /// rig has a valve, and an input otherwise; the contraction is an input if the load is
    /// prescribed.
    ///
    /// # Errors
    /// The text is not a rig, or the rig lacks a section.
    pub fn new(name: &str, text: &str) -> Result<Model, BadInput> {
        let mut rig = Rig::parse(name, text)?;
        let simulated = Simulated {
            pressure: rig.nominal.valve.is_some(),
            motion: matches!(rig.nominal.load, Load::Weight(_)),
        };
        rig.plant(simulated)?;
        let in_file = rig.effects.len();
        for kind in rig.catalogue.clone().kinds() {
            let is_of_rig = rig
                .effects
                .iter()
                .any(|effect| effect.kind.name == kind.name);
            if !is_of_rig && acts(kind, simulated) {
                rig.effects.push(Effect::typical(kind, &kind.forms[0]));
            }
        }
        let mut model = Model {
            rig,
            simulated,
            variables: Vec::new(),
            text: text.into(),
        };
        model.add_signals();
        model.add_settings();
        model.add_numbers();
        model.add_effects(in_file);
        Ok(model)
    }

    /// The rig's file.
    #[cfg(feature = "formats")]
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// Starts from the state that `record` measured in its first second and from its first row's
    /// inputs, as `simulate` does.
    ///
    /// # Errors
    /// The record lacks an input of the rig.
    pub fn start_from(&mut self, record: &Record) -> Result<(), BadInput> {
        let starts: Vec<_> = self.variables.iter().map(|one| one.start).collect();
        let rig = self.rig_with(&starts);
        if self.simulated.pressure {
            record.require(record::PRESSURE_REF_PA)?;
        }
        let initial = initial_state(&rig, record)?;
        let first = |name: &str| {
            let mut values = record.column(name).unwrap_or_default().iter().copied();
            values.find(|value| !value.is_nan())
        };
        for variable in &mut self.variables {
            let start = match variable.role {
                Role::Input(Input::ReferencePa) => first(record::PRESSURE_REF_PA),
                Role::Input(Input::ValveOpen) => first(record::VALVE_OPEN),
                Role::Input(Input::SupplyPa) => first(record::SUPPLY_PA),
                Role::Input(Input::PressurePa) => Some(initial.pressure.0),
                Role::Input(Input::Contraction) => Some(initial.contraction),
                Role::Setting(Setting::StartsAtRest) => Some(0.0),
                Role::Setting(Setting::SupplyIsInput) => first(record::SUPPLY_PA).map(|_| 1.0),
                Role::Setting(Setting::InitialContraction) => Some(initial.contraction),
                Role::Setting(Setting::InitialContractionRate) => {
                    Some(initial.contraction_rate_per_s)
                }
                Role::Setting(Setting::InitialPressurePa) => Some(initial.pressure.0),
                Role::Setting(Setting::InitialTemperatureK) => Some(initial.temperature_k),
                _ => None,
            };
            variable.start = start.unwrap_or(variable.start);
        }
        Ok(())
    }

    /// The rig with the `values` of all variables: its numbers, and the effects that are on.
    pub(super) fn rig_with(&self, values: &[f64]) -> Rig {
        let mut rig = self.rig.clone();
        let mut on = vec![true; rig.effects.len()];
        for (variable, value) in self.variables.iter().zip(values) {
            match variable.role {
                Role::Number(key) => {
                    if let Some(number) = (key.value)(&mut rig) {
                        *number = *value;
                    }
                }
                Role::EffectOn(number) => on[number] = *value == 1.0,
                Role::EffectValue(number, place) => rig.effects[number].values[place] = *value,
                _ => {}
            }
        }
        let mut on = on.into_iter();
        rig.effects.retain(|_| on.next() == Some(true));
        rig
    }

    /// The start values of inputs and settings, for [`Model::set_starts`].
    pub fn starts(&self) -> String {
        let is_start = |role| matches!(role, Role::Input(_) | Role::Setting(_));
        let variables = self
            .variables
            .iter()
            .filter(|variable| is_start(variable.role));
        let starts: BTreeMap<_, _> = variables.map(|one| (&one.name, one.start)).collect();
        // Names and finite numbers are always valid JSON.
        serde_json::to_string_pretty(&starts).unwrap_or_default()
    }

    /// Sets the start values that [`Model::starts`] wrote to the file `name`.
    ///
    /// # Errors
    /// The text is another.
    pub fn set_starts(&mut self, name: &str, text: &str) -> Result<(), BadInput> {
        let bad = |expected: String| BadInput::file(name, expected);
        let starts: BTreeMap<String, f64> = serde_json::from_str(text)
            .map_err(|error| bad(format!("an object of names and numbers, {error}")))?;
        for (variable, start) in starts {
            let mut variables = self.variables.iter_mut();
            let found = variables.find(|one| one.name == variable);
            let found = found.ok_or_else(|| bad(format!("no `{variable}`, found it")))?;
            found.start = found.checked(start).map_err(bad)?;
        }
        Ok(())
    }

    /// The instantiation token: identifies the rig, and the variables with their start values. A
    /// library of another version makes other variables, and refuses the model description.
    pub(super) fn token(&self) -> String {
        let mut digest = Sha256::new();
        digest.update(&self.text);
        for variable in &self.variables {
            let (name, start) = (&variable.name, variable.start);
            digest.update(format!("\n{name} {:?} {start:?}", variable.kind()));
        }
        let bytes = digest.finalize();
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn add(&mut self, role: Role, name: &str, unit: Option<&'static str>, description: &str) {
        self.variables.push(Variable {
            name: name.into(),
            description: description.into(),
            unit,
            start: 0.0,
            range: None,
            role,
        });
    }

    /// As [`Model::add`], with a start value.
    fn add_from(
        &mut self,
        start: f64,
        role: Role,
        (name, unit): (&str, Option<&'static str>),
        description: &str,
    ) {
        self.add(role, name, unit, description);
        if let Some(variable) = self.variables.last_mut() {
            variable.start = start;
        }
    }

    /// Sets the range of the last variable.
    fn limit(&mut self, range: [f64; 2]) {
        if let Some(variable) = self.variables.last_mut() {
            variable.range = Some(range);
        }
    }

    /// Time, inputs and outputs.
    fn add_signals(&mut self) {
        self.add(Role::Time, "time", Some("s"), "Time");
        let input = Role::Input;
        if let Some(valve) = self.rig.nominal.valve.filter(|_| self.simulated.pressure) {
            let name = record::PRESSURE_REF_PA;
            let words = "Reference pressure sent to the valve (gauge), held over the step";
            self.add(input(Input::ReferencePa), name, Some("Pa"), words);
            let words = "Whether the shut-off valve between valve and muscle is open";
            self.add_from(
                1.0,
                input(Input::ValveOpen),
                (record::VALVE_OPEN, None),
                words,
            );
            let supply_pa = valve.supply_pressure.0;
            let words = "Supply pressure (gauge) at the communication point, if supply_is_input";
            let supply = (record::SUPPLY_PA, Some("Pa"));
            self.add_from(supply_pa, input(Input::SupplyPa), supply, words);
            let words = "Rate of supply_pa over the step";
            self.add(
                input(Input::SupplyRate),
                "supply_rate_pa_per_s",
                Some("Pa/s"),
                words,
            );
        } else {
            let words = "Pressure in the muscle (gauge) at the communication point";
            self.add(
                input(Input::PressurePa),
                "prescribed_pressure_pa",
                Some("Pa"),
                words,
            );
            let (name, words) = (
                "prescribed_pressure_rate_pa_per_s",
                "Rate of prescribed_pressure_pa over the step",
            );
            self.add(input(Input::PressureRate), name, Some("Pa/s"), words);
        }
        if !self.simulated.motion {
            let words = "Contraction of the muscle at the communication point";
            self.add(
                input(Input::Contraction),
                "prescribed_contraction",
                Some("1"),
                words,
            );
            let (name, words) = (
                "prescribed_contraction_rate_per_s",
                "Rate of prescribed_contraction over the step",
            );
            self.add(input(Input::ContractionRate), name, Some("1/s"), words);
        }
        for (name, unit, words, value) in OUTPUTS {
            self.add(Role::Output(*value), name, Some(*unit), words);
        }
    }

    /// The parameters that are no numbers of the rig.
    fn add_settings(&mut self) {
        let setting = Role::Setting;
        if self.simulated.pressure {
            let words = "supply_pa replaces the rig's supply pressure and its effects";
            self.add(
                setting(Setting::SupplyIsInput),
                "supply_is_input",
                None,
                words,
            );
        }
        if !(self.simulated.pressure || self.simulated.motion) {
            return;
        }
        let name = "initial.at_rest";
        let words = "The muscle holds its weight at rest under the inputs at the start, with the \
                     gas at ambient temperature; the other values of `initial` are ignored";
        self.add_from(1.0, setting(Setting::StartsAtRest), (name, None), words);
        if self.simulated.motion {
            let role = setting(Setting::InitialContraction);
            self.add(
                role,
                "initial.contraction",
                Some("1"),
                "Contraction at the start",
            );
            self.limit(CONTRACTIONS);
            let (name, words) = ("initial.contraction_rate_per_s", "Its rate at the start");
            self.add(
                setting(Setting::InitialContractionRate),
                name,
                Some("1/s"),
                words,
            );
        }
        if self.simulated.pressure {
            let (name, words) = ("initial.pressure_pa", "Pressure (gauge) at the start");
            self.add(setting(Setting::InitialPressurePa), name, Some("Pa"), words);
            let ambient_k = self
                .rig
                .nominal
                .gas
                .map_or(0.0, |gas| gas.ambient_temperature_k);
            let name = ("initial.temperature_k", Some("K"));
            let role = setting(Setting::InitialTemperatureK);
            self.add_from(ambient_k, role, name, "Gas temperature at the start");
            self.limit(TEMPERATURES_K);
        }
    }

    /// The numbers of the rig's sections that the plant uses.
    fn add_numbers(&mut self) {
        for key in KEYS.iter().filter(|key| key.section != "assist") {
            let Some(start) = (key.value)(&mut self.rig).map(|value| *value) else {
                continue;
            };
            self.variables.push(Variable {
                name: format!("{}.{}", key.section, key.name),
                description: format!("Key `{}` of section `{}` of the rig", key.name, key.section),
                unit: Some(fmi_unit(key.unit)),
                start,
                range: Some([key.min, key.max]),
                role: Role::Number(key),
            });
        }
    }

    /// A switch for each effect, and its parameters. The first `in_file` effects are the rig's.
    fn add_effects(&mut self, in_file: usize) {
        let mut names: Vec<String> = Vec::new();
        let effects = self.rig.effects.iter().enumerate();
        for (number, effect) in effects.filter(|(_, one)| acts(one.kind, self.simulated)) {
            let is_of_rig = number < in_file;
            let plain = effect
                .kind
                .name
                .replace(|letter: char| !letter.is_alphanumeric(), "_");
            let count = 1 + names.iter().filter(|name| **name == plain).count();
            let name = match count {
                1 => format!("effect.{plain}"),
                count => format!("effect.{plain}_{count}"),
            };
            names.push(plain);
            self.variables.push(Variable {
                name: format!("{name}.on"),
                description: format!(
                    "Effect `{}`, form `{}`, {}: {}",
                    effect.kind.name,
                    effect.form.name,
                    if is_of_rig {
                        "of the rig"
                    } else {
                        "not of the rig"
                    },
                    effect.form.equation
                ),
                unit: None,
                start: f64::from(u8::from(is_of_rig)),
                range: None,
                role: Role::EffectOn(number),
            });
            let parameters = effect.form.parameters.iter().zip(&effect.values);
            for (place, (parameter, value)) in parameters.enumerate() {
                self.variables.push(Variable {
                    name: format!("{name}.{}", parameter.name),
                    description: format!("Parameter of effect `{}`", effect.kind.name),
                    unit: Some(fmi_unit(parameter.unit)),
                    start: *value,
                    range: Some([parameter.min, parameter.max]),
                    role: Role::EffectValue(number, place),
                });
            }
        }
    }
}

/// A rig's unit in the model description, where a number without one has the unit 1.
fn fmi_unit(unit: &'static str) -> &'static str {
    if unit == "-" { "1" } else { unit }
}

/// Whether an effect of this kind can act on the `simulated` part of the plant.
fn acts(kind: &EffectKind, simulated: Simulated) -> bool {
    match kind.subsystem {
        Subsystem::Valve | Subsystem::Gas | Subsystem::Supply => simulated.pressure,
        Subsystem::Load => simulated.motion,
        Subsystem::Line | Subsystem::MuscleForce | Subsystem::Sensor => true,
    }
}

/// An output: name, unit, description, value.
type Output = (
    &'static str,
    &'static str,
    &'static str,
    fn(&Simulation) -> f64,
);

/// The readings have the names of a record's columns.
const OUTPUTS: &[Output] = &[
    (
        record::PRESSURE_PA,
        "Pa",
        "Reading of the pressure sensor (gauge)",
        |simulation| simulation.read().pressure.0,
    ),
    (
        record::CONTRACTION,
        "1",
        "Reading of the contraction",
        |simulation| simulation.read().contraction,
    ),
    (
        record::FORCE_N,
        "N",
        "Reading of the muscle's force",
        |simulation| simulation.read().force_n,
    ),
    (
        record::TEMPERATURE_K,
        "K",
        "Gas temperature",
        Simulation::temperature_k,
    ),
    (
        "true_pressure_pa",
        "Pa",
        "Pressure in the muscle (gauge), without sensor",
        |simulation| simulation.pressure().0,
    ),
    (
        "true_contraction",
        "1",
        "Contraction of the muscle, without sensor",
        Simulation::contraction,
    ),
    (
        "true_contraction_rate_per_s",
        "1/s",
        "Contraction rate, without sensor",
        Simulation::contraction_rate_per_s,
    ),
    (
        "true_force_n",
        "N",
        "Force of the muscle, without sensor",
        Simulation::force_n,
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_has_a_switch_for_each_effect_and_no_name_twice() {
        let two = "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4e-9\n\
                   [[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 5e-9\n";
        let model = Model::new("rig.toml", &(Rig::REFERENCE_TOML.to_owned() + two));
        let model = model.expect("a model");
        let mut names: Vec<_> = model
            .variables
            .iter()
            .map(|one| one.name.as_str())
            .collect();
        let start = |name: &str| {
            let mut variables = model.variables.iter();
            variables.find(|one| one.name == name).map(|one| one.start)
        };
        for kind in model.rig.catalogue.kinds() {
            let name = format!("effect.{}.on", kind.name.replace('-', "_"));
            let expected = f64::from(u8::from(kind.name == "leak"));
            assert_eq!(start(&name), Some(expected), "{name}");
        }
        assert_eq!(start("effect.leak_2.on"), Some(1.0));
        assert_eq!(start("effect.leak_2.conductance_kg_per_pa_s"), Some(5e-9));
        assert_eq!(start("load.mass_kg"), Some(12.0));
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]));
    }

    /// A muscle on a test bench without a valve: nothing of valve, gas, supply and weight.
    #[test]
    fn a_part_that_is_not_simulated_has_no_variables() {
        let begin = Rig::REFERENCE_TOML.find("[valve]").expect("the section");
        let length = Rig::REFERENCE_TOML[begin..]
            .find("[gas]")
            .expect("the next section");
        let leak = "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4e-9\n";
        let mut text = Rig::REFERENCE_TOML.replace("\"weight\"", "\"prescribed\"") + leak;
        let moved = text.find("[valve]").expect("the section");
        text.replace_range(moved..moved + length, "");
        let model = Model::new("rig.toml", &text).expect("a model");
        assert_eq!(model.simulated, Simulated::FORCE_ONLY);
        let names: Vec<_> = model
            .variables
            .iter()
            .map(|one| one.name.as_str())
            .collect();
        for absent in [
            "pressure_ref_pa",
            "valve",
            "load",
            "effect.leak",
            "effect.payload",
            "initial",
        ] {
            let mut with = names.iter().filter(|name| name.starts_with(absent));
            assert_eq!(with.next(), None);
        }
        for present in [
            "prescribed_pressure_pa",
            "prescribed_contraction",
            "effect.slack.on",
        ] {
            assert!(names.contains(&present), "{present}");
        }
    }
}

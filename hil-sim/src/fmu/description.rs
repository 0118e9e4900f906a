//! `modelDescription.xml` of an FMU (FMI 3.0, co-simulation).

use super::MODEL_IDENTIFIER;
use super::variables::{Model, Variable};
use crate::own_effect::Dimension;
use muscle_plant::simulation::TOLERANCE;
use std::collections::BTreeSet;
use std::fmt::Write;

/// What an importer simulates if it is told nothing else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experiment {
    /// First communication point \[s\].
    pub start_s: f64,
    /// Last communication point \[s\].
    pub stop_s: f64,
    /// Communication step \[s\].
    pub step_s: f64,
}

/// From 0 to 10 s, with the step of the board's tick.
impl Default for Experiment {
    fn default() -> Experiment {
        Experiment {
            start_s: 0.0,
            stop_s: 10.0,
            step_s: 0.01,
        }
    }
}

impl Model {
    /// The model description, with `name` as the model's name.
    pub fn description(&self, name: &str, experiment: Experiment) -> String {
        let (name, token) = (escaped(name), self.token());
        let version = env!("CARGO_PKG_VERSION");
        let Experiment {
            start_s,
            stop_s,
            step_s,
        } = experiment;
        let units: String = self.units().into_iter().map(unit_definition).collect();
        let variables = self.variables.iter().enumerate();
        let variables: String = variables.map(|(index, one)| element(index, one)).collect();
        let outputs = || {
            let variables = self.variables.iter().enumerate();
            variables.filter(|(_, variable)| variable.kind().0 == "output")
        };
        let mut structure = String::new();
        for kind in ["Output", "InitialUnknown"] {
            for (index, _) in outputs() {
                let _ = writeln!(structure, "    <{kind} valueReference=\"{index}\"/>");
            }
        }
        format!(
            r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token}"
  description="A pneumatic muscle with its load, valve and air" generationTool="hil-sim {version}"
  variableNamingConvention="structured">
  <CoSimulation modelIdentifier="{MODEL_IDENTIFIER}"
    canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions>
{units}  </UnitDefinitions>
  <LogCategories>
    <Category name="logStatusError" description="Why a function returned fmi3Error"/>
  </LogCategories>
  <DefaultExperiment startTime="{start_s:?}" stopTime="{stop_s:?}" tolerance="{TOLERANCE:?}"
    stepSize="{step_s:?}"/>
  <ModelVariables>
{variables}  </ModelVariables>
  <ModelStructure>
{structure}  </ModelStructure>
</fmiModelDescription>
"#
        )
    }

    fn units(&self) -> BTreeSet<&'static str> {
        self.variables.iter().filter_map(|one| one.unit).collect()
    }
}

/// The definition of a unit; that of an own effect need not be one of SI, and then has no base.
fn unit_definition(unit: &str) -> String {
    let base = Dimension::of_unit(unit).map_or_else(
        |_| String::new(),
        |dimension| {
            let bases = ["kg", "m", "s", "K"].iter().zip(dimension.exponents());
            let factors = bases.filter(|(_, exponent)| *exponent != 0.0);
            let factors: String = factors
                .map(|(base, n)| format!(" {base}=\"{n}\""))
                .collect();
            format!("<BaseUnit{factors}/>")
        },
    );
    let unit = escaped(unit);
    format!("    <Unit name=\"{unit}\">{base}</Unit>\n")
}

/// The element of a variable.
fn element(index: usize, variable: &Variable) -> String {
    let (name, words) = (escaped(&variable.name), escaped(&variable.description));
    let (causality, variability) = variable.kind();
    let mut text = format!(
        "name=\"{name}\" valueReference=\"{index}\" description=\"{words}\"\n      \
         causality=\"{causality}\" variability=\"{variability}\""
    );
    let has_start = ["input", "parameter"].contains(&causality);
    let kind = match variable.unit {
        None => {
            let _ = write!(text, " start=\"{}\"", variable.start == 1.0);
            "Boolean"
        }
        Some(unit) => {
            let _ = write!(text, " unit=\"{}\"", escaped(unit));
            if let Some([min, max]) = variable.range {
                let _ = write!(text, " min=\"{min:?}\" max=\"{max:?}\"");
            }
            if has_start {
                let _ = write!(text, " start=\"{:?}\"", variable.start);
            }
            "Float64"
        }
    };
    format!("    <{kind} {text}/>\n")
}

/// `text` in an attribute of XML, in one line.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            letter if letter.is_control() => escaped.push(' '),
            letter => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    #[test]
    fn all_units_of_the_catalogue_are_defined_in_base_units() {
        let model = Model::new("rig.toml", Rig::REFERENCE_TOML).expect("a model");
        for unit in model.units() {
            let definition = unit_definition(unit);
            assert!(definition.contains("<BaseUnit"), "{definition}");
        }
        let flow_gain = unit_definition("kg/(Pa·s)");
        let expected = "    <Unit name=\"kg/(Pa·s)\"><BaseUnit m=\"1\" s=\"1\"/></Unit>\n";
        assert_eq!(flow_gain, expected);
    }

    #[test]
    fn text_cannot_end_its_attribute() {
        assert_eq!(escaped("a \"<&>\"\n"), "a &quot;&lt;&amp;&gt;&quot; ");
    }
}

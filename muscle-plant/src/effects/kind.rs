//! What an effect declares: where it acts, what shows it, its forms and their parameters, and how
//! the controller compensates it.

use super::compensation::CompensationMethod;
use super::observation::Observation;
use crate::subsystem::{Subsystem, Term};
use std::fmt;

/// One parameter of a form, as it stands in `[[effect]]` of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Its key; the unit is part of it.
    pub name: &'static str,
    /// Its unit, in the field's notation.
    pub unit: &'static str,
    /// Smallest value that is accepted.
    pub min: f64,
    /// Largest value that is accepted.
    pub max: f64,
    /// A typical value: where a fit starts, and the scale of its steps.
    pub typical: f64,
    /// The parameter spans decades and is fitted by its logarithm; then `min` is above 0.
    pub log: bool,
    /// Its value in a rig without the effect. The effect vanishes where all parameters that have
    /// such a value are at it; an effect of which no parameter has one does not vanish.
    pub neutral: Option<f64>,
    /// Whether `min`, and whether `max`, is a physical bound: a fit that reaches it describes
    /// another effect, or none.
    pub physical_bounds: [bool; 2],
}

impl Parameter {
    /// A parameter with its range and a typical value, fitted linearly.
    pub const fn new(
        name: &'static str,
        unit: &'static str,
        (min, max): (f64, f64),
        typical: f64,
    ) -> Parameter {
        Parameter {
            name,
            unit,
            min,
            max,
            typical,
            log: false,
            neutral: None,
            physical_bounds: [false; 2],
        }
    }

    /// The same, fitted by its logarithm.
    pub const fn log(self) -> Parameter {
        Parameter { log: true, ..self }
    }

    /// The same, with the value at which it has no effect.
    pub const fn neutral(self, value: f64) -> Parameter {
        Parameter {
            neutral: Some(value),
            ..self
        }
    }

    /// The same, with `min` as a physical bound.
    pub const fn physical_min(self) -> Parameter {
        let [_, max] = self.physical_bounds;
        Parameter {
            physical_bounds: [true, max],
            ..self
        }
    }

    /// The same, with `max` as a physical bound.
    pub const fn physical_max(self) -> Parameter {
        let [min, _] = self.physical_bounds;
        Parameter {
            physical_bounds: [min, true],
            ..self
        }
    }
}

/// Makes a term from the values of a form's parameters, in their order.
pub type Build = &'static (dyn Fn(&[f64]) -> Term + Sync);
/// Makes an observation from the values of a form's parameters, in their order.
pub type Observe = &'static (dyn Fn(&[f64]) -> Box<dyn Observation> + Sync);

/// One set of equations of an effect.
#[derive(Clone, Copy)]
pub struct Form {
    /// Its name, unique within the effect.
    pub name: &'static str,
    /// Its parameters, all required.
    pub parameters: &'static [Parameter],
    /// Its equation, with each parameter by its key.
    pub equation: &'static str,
    /// Where it comes from, and what its parameters mean.
    pub source: &'static str,
    /// What a rig does and this form leaves out.
    pub leaves_out: &'static str,
    /// Makes the term from the values of `parameters`, in their order.
    pub build: Build,
    /// Makes, from the same values, what a diagnosis needs beside the term; `None` where it needs
    /// nothing.
    pub observation: Option<Observe>,
}

impl fmt::Debug for Form {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut shown = f.debug_struct("Form");
        shown.field("name", &self.name).finish_non_exhaustive()
    }
}

/// An equation whose residuals a diagnosis looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Equation {
    /// Reference pressure to pressure: Eqs 3, 4 and 9.
    Gas,
    /// Pressure and contraction to force: Eq 1.
    MuscleForce,
    /// The balance of forces on the weight: Eq 5.
    Load,
}

/// A quantity with which the law of an effect may vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The muscle's pressure.
    Pressure,
    /// Its rate, as a flow makes it.
    PressureRate,
    /// The muscle's contraction.
    Contraction,
    /// The size of its rate.
    ContractionRate,
}

impl Quantity {
    /// All of them.
    pub const ALL: &'static [Quantity] = &[
        Quantity::Pressure,
        Quantity::PressureRate,
        Quantity::Contraction,
        Quantity::ContractionRate,
    ];
}

/// What a record must contain so that an effect can show in it.
///
/// Without [`MeasuredForce`](Self::MeasuredForce) or [`Motion`](Self::Motion) the effect changes
/// nothing that was measured, and the diagnosis does not try it. Without one of the others it is
/// tried, but hardly shows or is hard to distinguish from other effects, as `hil-sim check` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Requirement {
    /// A measured muscle force.
    MeasuredForce,
    /// A contraction that changes.
    Motion,
    /// A measured supply pressure, which distinguishes a falling supply from a limited flow.
    MeasuredSupply,
    /// A row every 20 ms or faster, for effects that last as long as that.
    FastSampling,
    /// A step of the reference pressure.
    ReferenceStep,
    /// A reference pressure that is held for 10 s, or a shut valve.
    ReferenceHold,
    /// A muscle pressure that is held for 10 s.
    PressureHold,
    /// A vented muscle, below 8 kPa (gauge): no force hides the offsets of its sensors.
    Vented,
    /// Two reversals of the contraction: one closed loop.
    TwoReversals,
    /// Three cycles of the contraction, from one to the next of which something changes.
    ThreeCycles,
}

/// One kind of effect.
#[derive(Clone, Copy, Debug)]
pub struct EffectKind {
    /// Its name, as other programs know it.
    pub name: &'static str,
    /// The subsystem that it is attributed to.
    pub subsystem: Subsystem,
    /// The equations that it changes, as seen from measured signals. A sensor's effect changes each
    /// equation that the sensor's reading goes into.
    pub equations: &'static [Equation],
    /// What a record must contain to show it, beside the signals of its equations;
    /// [`Requirement`] says without which the diagnosis does not try it.
    pub requires: &'static [Requirement],
    /// The signature that it leaves in data, in words.
    pub signature: &'static str,
    /// The test signal that distinguishes it from similar effects.
    pub test_signal: &'static str,
    /// Share of the effect that is expected to remain as a residual because a rig's equations
    /// differ from every form here \[-\]; 0 where the name determines the form.
    pub discrepancy_ratio: f64,
    /// What a rig's law of the effect may vary with beyond every form here: what the part of the
    /// rig that has the effect can feel. A valve knows nothing of the contraction, and a mass,
    /// which may hang on a chain, of nothing but that.
    pub law_quantities: &'static [Quantity],
    /// How the controller compensates it, or why it does not.
    pub compensation: CompensationMethod,
    /// Its forms; a rig that names none has the first.
    pub forms: &'static [Form],
}

/// Discrepancy ratio where nothing better is known: no form was seen to agree with a rig to better
/// than 5 %.
pub const DISCREPANCY_RATIO: f64 = 0.05;

impl EffectKind {
    /// The form of that name.
    pub fn form(&self, name: &str) -> Option<&'static Form> {
        self.forms.iter().find(|form| form.name == name)
    }
}

/// An effect of a rig: a kind, one of its forms, and values of the form's parameters.
#[derive(Clone, Debug)]
pub struct Effect {
    /// The kind of effect.
    pub kind: &'static EffectKind,
    /// One of its forms.
    pub form: &'static Form,
    /// The values of the form's parameters, in the form's order.
    pub values: Vec<f64>,
}

impl Effect {
    /// An effect with each parameter at its typical value.
    pub fn typical(kind: &'static EffectKind, form: &'static Form) -> Effect {
        Effect {
            kind,
            form,
            values: form.parameters.iter().map(|p| p.typical).collect(),
        }
    }

    /// The term that it adds to its subsystem.
    pub fn term(&self) -> Term {
        (self.form.build)(&self.values)
    }

    /// What a diagnosis needs beside the term, if anything.
    pub fn observation(&self) -> Option<Box<dyn Observation>> {
        self.form.observation.map(|observe| observe(&self.values))
    }

    /// The value of a parameter, if the form has it.
    pub fn value(&self, parameter: &str) -> Option<f64> {
        let mut parameters = self.form.parameters.iter().zip(&self.values);
        parameters
            .find(|(known, _)| known.name == parameter)
            .map(|(_, value)| *value)
    }
}

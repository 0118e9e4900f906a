//! What an effect declares of itself: its place, its signature, its forms and their parameters.

use crate::subsystem::Term;

/// One parameter of a form, as it stands in `[[effect]]` of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Its key; the unit is part of it.
    pub name: &'static str,
    /// Its unit, in the field's notation.
    pub unit: &'static str,
    /// Smallest value that it may have.
    pub min: f64,
    /// Largest value that it may have.
    pub max: f64,
    /// A usual size: where a fit starts, and the scale of its steps.
    pub usual: f64,
    /// It spans decades and is fitted by its logarithm; then `min` is above 0.
    pub log: bool,
    /// Its value in a rig without the effect. The effect vanishes where all parameters that have
    /// such a value are at it; where none has, it does not vanish.
    pub neutral: Option<f64>,
    /// Whether the effect ends at `min`, and at `max`: what is beyond is another, or none.
    pub ends: [bool; 2],
}

impl Parameter {
    /// A parameter with its range and a typical value, fitted linearly.
    pub const fn new(
        name: &'static str,
        unit: &'static str,
        (min, max): (f64, f64),
        usual: f64,
    ) -> Parameter {
        Parameter {
            name,
            unit,
            min,
            max,
            usual,
            log: false,
            neutral: None,
            ends: [false; 2],
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

    /// What is below its least value is another effect, or none.
    pub const fn ends_at_min(self) -> Parameter {
        let [_, above] = self.ends;
        Parameter {
            ends: [true, above],
            ..self
        }
    }

    /// What is above its largest value is another effect, or none.
    pub const fn ends_at_max(self) -> Parameter {
        let [below, _] = self.ends;
        Parameter {
            ends: [below, true],
            ..self
        }
    }
}

/// One set of equations of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Form {
    /// Its name, unique within the effect.
    pub name: &'static str,
    /// Its parameters, all required.
    pub parameters: &'static [Parameter],
    /// Where it comes from, and what it leaves out.
    pub source: &'static str,
    /// Makes the term from the values of `parameters`, in their order.
    pub build: fn(&[f64]) -> Term,
}

/// One kind of effect.
#[derive(Clone, Copy, Debug)]
pub struct EffectKind {
    /// Its name, as other programs know it.
    pub name: &'static str,
    /// The subsystem it belongs to.
    pub place: &'static str,
    /// The signature it leaves in data, in words.
    pub signature: &'static str,
    /// The test signal that tells it from what it is confused with.
    pub test_signal: &'static str,
    /// Its forms; the first is the one meant where a rig names none.
    pub forms: &'static [Form],
}

impl EffectKind {
    /// Share of the effect by which a rig's may have another form than any here. An offset that
    /// depends on anything is a gain or a drift, so that its name says its form. A rig's hysteresis
    /// and creep are of many elements, unequal ones, and up to a tenth was seen to be left of them;
    /// no other form is known better than 5 %.
    pub fn form_doubt(&self) -> f64 {
        match self.name {
            "pressure-sensor-offset" | "contraction-sensor-offset" | "force-sensor-offset" => 0.0,
            "hysteresis" | "creep" => 0.1,
            _ => 0.05,
        }
    }

    /// The form of that name.
    pub fn form(&self, name: &str) -> Option<&'static Form> {
        self.forms.iter().find(|form| form.name == name)
    }
}

/// An effect of a rig: a kind, one of its forms, and values of the form's parameters.
#[derive(Clone, Debug)]
pub struct Effect {
    /// Which effect.
    pub kind: &'static EffectKind,
    /// Which of its forms.
    pub form: &'static Form,
    /// The values of the form's parameters, in the form's order.
    pub values: Vec<f64>,
}

impl Effect {
    /// The term that it adds to its subsystem.
    pub fn term(&self) -> Term {
        (self.form.build)(&self.values)
    }
}

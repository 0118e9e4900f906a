//! The catalogue of effects that can be added to the plant, one file each.
//!
//! An effect is what a rig does and the nominal model does not. It has a name, the block it belongs
//! to, the mark it leaves in data, and one or more forms: equations that have been used for it,
//! each a term for the plant with few parameters. Adding an effect is a file here and its line in
//! [`CATALOGUE`]; adding a form is one entry in the effect's file.
//!
//! A measured rig follows none of the forms exactly: each says where it comes from and what it
//! leaves out.

mod backlash;
mod bladder_elasticity;
mod contraction_sensor_offset;
mod creep;
mod dead_band;
mod flow_limit;
mod force_sensor_offset;
mod friction;
mod heat_exchange;
mod hysteresis;
mod leak;
mod line_dynamics;
mod orifice;
mod payload;
mod pressure_sensor_drift;
mod pressure_sensor_gain;
mod pressure_sensor_offset;
mod run_in;
mod slack;
mod supply_droop;
mod transport_delay;
mod valve_dead_zone;
mod valve_lag;

use crate::plant::Term;

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
    const fn new(
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

    const fn log(self) -> Parameter {
        Parameter { log: true, ..self }
    }

    const fn neutral(self, value: f64) -> Parameter {
        Parameter {
            neutral: Some(value),
            ..self
        }
    }

    /// What is below its least value is another effect, or none.
    const fn ends_at_min(self) -> Parameter {
        let [_, above] = self.ends;
        Parameter {
            ends: [true, above],
            ..self
        }
    }

    /// What is above its largest value is another effect, or none.
    const fn ends_at_max(self) -> Parameter {
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
    /// The block it belongs to.
    pub block: &'static str,
    /// The mark it leaves in data, in words.
    pub mark: &'static str,
    /// The experiment that shows it apart from what it is taken for.
    pub experiment: &'static str,
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

/// Every effect that a rig may name, block by block.
pub const CATALOGUE: &[EffectKind] = &[
    hysteresis::KIND,
    creep::KIND,
    dead_band::KIND,
    bladder_elasticity::KIND,
    slack::KIND,
    run_in::KIND,
    friction::KIND,
    payload::KIND,
    backlash::KIND,
    valve_dead_zone::KIND,
    flow_limit::KIND,
    valve_lag::KIND,
    transport_delay::KIND,
    line_dynamics::KIND,
    leak::KIND,
    heat_exchange::KIND,
    supply_droop::KIND,
    pressure_sensor_offset::KIND,
    pressure_sensor_gain::KIND,
    pressure_sensor_drift::KIND,
    contraction_sensor_offset::KIND,
    force_sensor_offset::KIND,
];

/// The effect of that name, if the catalogue has it.
pub fn find(name: &str) -> Option<&'static EffectKind> {
    CATALOGUE.iter().find(|kind| kind.name == name)
}

/// Pressure at which a force that grows with pressure has the size its parameter states \[Pa\].
const REFERENCE_PRESSURE_PA: f64 = 3e5;
/// Contraction at which a force that grows with it has the size its parameter states \[-\].
const REFERENCE_CONTRACTION: f64 = 0.25;
/// Unit of pressures in states \[Pa\].
const STATE_PA: f64 = 1e5;
/// Temperature of air outside the muscle \[K\].
const AIR_TEMPERATURE_K: f64 = 293.0;
/// What is faster than this is taken to follow at once \[s\].
const INSTANT_S: f64 = 2e-5;

/// Where what lags behind a drive has come to after a stretch of time in which the drive went
/// straight from one value to another.
fn lagged(state: f64, [from, to]: [f64; 2], length_s: f64, time_constant_s: f64) -> f64 {
    if length_s <= 0.0 {
        return state;
    }
    let behind = (to - from) * time_constant_s / length_s;
    state + (to - from) + (state - from + behind) * (-length_s / time_constant_s).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::gas::GasBlock;
    use crate::plant::muscle::MusclePoint;
    use crate::plant::term::Terms;
    use crate::rig::Rig;
    use model_core::pressure::GaugePa;

    fn air() -> GasBlock {
        let rig = Rig::reference();
        GasBlock {
            gas: *rig.require_gas().expect("gas"),
            volume: *rig.require_volume().expect("a volume"),
            initial_length_m: rig.muscle.initial_length_m,
            terms: Terms::default(),
        }
    }

    /// What follows its inputs comes to where its rates would bring it, whatever the steps: every
    /// term of the muscle that has states, by the midpoint rule in 5000 of them.
    #[test]
    fn terms_follow_their_inputs_as_their_rates_say() {
        let at = |time_s: f64, direction: f64| MusclePoint {
            time_s,
            contraction: 0.06 + 0.04 * direction * time_s,
            contraction_rate_per_s: 0.04 * direction,
            direction,
            pressure: GaugePa(1e5 + 4e5 * time_s),
        };
        let mut compared = Vec::new();
        for kind in CATALOGUE {
            for form in kind.forms {
                let values: Vec<f64> = form.parameters.iter().map(|p| p.usual).collect();
                let term = match (form.build)(&values) {
                    Term::Muscle(term) => Some(term),
                    Term::Line(term) => term.with_measured_pressure(Some(air())),
                    _ => None,
                };
                let Some(term) = term.filter(|term| term.states() > 0) else {
                    continue;
                };
                for direction in [1.0, -1.0] {
                    let mut followed = vec![0.0; term.states()];
                    term.settle(&at(0.0, direction), &mut followed);
                    term.lean(&at(0.0, direction), 0.3, &mut followed);
                    let mut integrated = followed.clone();
                    term.follow(&at(0.0, direction), &at(0.5, direction), &mut followed);
                    let step_s = 1e-4;
                    for step in 0..5000 {
                        let begin_s = f64::from(step) * step_s;
                        let mut moved = integrated.clone();
                        for (time_s, length_s) in
                            [(begin_s, 0.5 * step_s), (begin_s + 0.5 * step_s, step_s)]
                        {
                            let mut rates = vec![0.0; moved.len()];
                            term.rates(&at(time_s, direction), &moved, &mut rates);
                            let begins = integrated.iter().zip(&rates);
                            moved = begins.map(|(own, rate)| own + length_s * rate).collect();
                        }
                        integrated = moved;
                        term.commit(&at(begin_s + step_s, direction), &mut integrated);
                    }
                    for (a, b) in followed.iter().zip(&integrated) {
                        assert!(
                            (a - b).abs() < 1e-5,
                            "{} {}: {a}, {b}",
                            kind.name,
                            form.name
                        );
                    }
                }
                compared.push(form.name);
            }
        }
        assert!(compared.len() >= 12, "{compared:?}");
    }
}

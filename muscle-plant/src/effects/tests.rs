//! Properties of all effects.

use super::testing::{
    CLAMPED, STEP_S, TOLERANCE, bench, driven, effect, force_n, largest_difference, through,
    try_run,
};
use super::*;
use crate::nominal::Nominal;
use crate::simulation::{Plant, Simulated};
use crate::subsystem::Term;
use crate::subsystem::gas::GasSubsystem;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Terms;
use model_core::pressure::GaugePa;

fn every_form() -> impl Iterator<Item = (&'static EffectKind, &'static Form)> {
    Catalogue::standard()
        .kinds()
        .flat_map(|kind| kind.forms.iter().map(move |form| (kind, form)))
}

/// Other programs rely on these names and subsystems, and the fault campaign on their order.
#[test]
fn the_catalogue_has_every_name_in_its_subsystem_and_order() {
    let expected = [
        (
            "muscle-force",
            "hysteresis creep dead-band bladder-elasticity slack run-in",
        ),
        ("load", "friction payload backlash"),
        ("valve", "valve-dead-zone flow-limit valve-lag"),
        ("line", "transport-delay line-dynamics"),
        ("gas", "leak heat-exchange"),
        ("supply", "supply-droop"),
        (
            "sensor",
            "pressure-sensor-offset pressure-sensor-gain pressure-sensor-drift \
             contraction-sensor-offset force-sensor-offset",
        ),
    ];
    let expected: Vec<_> = expected
        .iter()
        .flat_map(|(place, names)| names.split_whitespace().map(move |name| (name, *place)))
        .collect();
    let found: Vec<_> = Catalogue::standard()
        .kinds()
        .map(|kind| (kind.name, kind.subsystem.name()))
        .collect();
    assert_eq!(found, expected);
}

#[test]
fn every_kind_and_parameter_is_declared_consistently() {
    for kind in Catalogue::standard().kinds() {
        assert!(!kind.equations.is_empty(), "{}", kind.name);
        assert!(
            (0.0..1.0).contains(&kind.discrepancy_ratio),
            "{}",
            kind.name
        );
    }
    for (kind, form) in every_form() {
        let what = format!("{} {}", kind.name, form.name);
        // A diagnosis resolves no more.
        assert!(form.parameters.len() <= 5, "{what}");
        let same_name = kind.forms.iter().filter(|other| other.name == form.name);
        assert_eq!(same_name.count(), 1, "{what}");
        for parameter in form.parameters {
            let what = format!("{what} {}", parameter.name);
            let is_inside = |value: f64| (parameter.min..=parameter.max).contains(&value);
            assert!(is_inside(parameter.typical), "{what}");
            assert!(parameter.neutral.is_none_or(is_inside), "{what}");
            assert!(!parameter.log || parameter.min > 0.0, "{what}");
        }
    }
}

/// Each effect that the controller compensates has sizes for it at its typical values, in every
/// form.
#[test]
fn every_form_has_a_size_for_its_compensation() {
    for (kind, form) in every_form() {
        let typical = Effect::typical(kind, form);
        let has_size = match kind.compensation {
            CompensationMethod::Friction(added) => added(&typical).coulomb_n > 0.0,
            CompensationMethod::Payload(mass_kg) => mass_kg(&typical) > 0.0,
            CompensationMethod::ValveDeadZone(widths) => {
                widths(&typical).filling_pa > 0.0 && widths(&typical).exhausting_pa > 0.0
            }
            CompensationMethod::PressureSensorOffset(offset_pa) => offset_pa(&typical) > 0.0,
            CompensationMethod::PressureSensorGain(error) => error(&typical) > 0.0,
            CompensationMethod::HysteresisLoop | CompensationMethod::Lag => true,
            CompensationMethod::Unavailable(reason) => !reason.is_empty(),
        };
        assert!(has_size, "{} {}", kind.name, form.name);
    }
}

/// Readings of a whole rig and of a clamped one under a reference, and of a muscle with pressure
/// and contraction as inputs, each relative to its range; `None` if a plant has no solution.
fn signals(effects: &[Effect], tolerance: f64) -> Option<Vec<f64>> {
    let busy = || {
        driven(4.0, |time_s| {
            [2e5, 3e5, 2.4e5, 4.9e5, 2.5e5, 0.5e5, 2e5][(2.0 * time_s) as usize % 7]
        })
    };
    let strokes = through([
        (0.0, 0.0),
        (1.0, 0.15),
        (2.0, 0.05),
        (2.4, 0.09),
        (2.8, 0.05),
        (4.0, 0.15),
    ]);
    let wave = |time_s: f64| 2e5 + 1.9e5 * (5.0 * time_s).sin();
    let mut signals = Vec::new();
    for (nominal, inputs) in [
        (Nominal::REFERENCE, busy()),
        (CLAMPED, busy()),
        (CLAMPED, bench(STEP_S, 401, strokes, wave)),
    ] {
        let found = try_run(&nominal, effects, &inputs, tolerance)?;
        for (values, range) in [
            (found.pressure_pa, 4e5),
            (found.contraction, 0.25),
            (found.force_n, 400.0),
        ] {
            signals.extend(values.iter().map(|value| value / range));
        }
    }
    Some(signals)
}

#[test]
fn every_form_changes_the_signals_and_none_does_at_its_neutral_values() {
    let nominal = signals(&[], TOLERANCE).expect("a solution");
    let difference = |effect: Effect| {
        let found = signals(&[effect], TOLERANCE).expect("a solution");
        largest_difference(&found, &nominal)
    };
    for (kind, form) in every_form() {
        let what = format!("{} {}", kind.name, form.name);
        let mut effect = Effect::typical(kind, form);
        let changed = difference(effect.clone());
        assert!(changed > 9e-4, "{what}: {changed}");
        for (value, parameter) in effect.values.iter_mut().zip(form.parameters) {
            *value = parameter.neutral.unwrap_or(*value);
        }
        if form.parameters.iter().any(|p| p.neutral.is_some()) {
            let remaining = difference(effect);
            assert!(remaining < 1e-6, "{what}: {remaining}");
        } else {
            // A muscle that cannot push, a check valve, and bristles that carry the nominal
            // friction do not vanish.
            let is_unilateral = kind.name == "slack" || form.name.starts_with("checked");
            assert!(is_unilateral || form.name == "lugre", "{what}");
        }
    }
}

/// Static friction that falls as the weight starts makes the motion sensitive to the time of the
/// start: the Stribeck form comes near this bound, the others are far below.
const CONVERGED: f64 = 3e-4;

#[test]
fn every_form_converges_with_the_tolerance() {
    for (kind, form) in every_form() {
        let effect = [Effect::typical(kind, form)];
        let [coarse, fine] =
            [1e-6, TOLERANCE].map(|tolerance| signals(&effect, tolerance).expect("a solution"));
        let difference = largest_difference(&coarse, &fine);
        assert!(
            difference < CONVERGED,
            "{} {}: {difference}",
            kind.name,
            form.name
        );
    }
}

/// A fit may go anywhere within the range of a parameter: the result is numbers or an error.
#[test]
fn no_form_panics_at_the_ends_of_its_parameters() {
    let inputs = driven(0.6, |time_s| [4.9e5, 0.0, 2e5][(5.0 * time_s) as usize]);
    for (kind, form) in every_form() {
        for (index, parameter) in form.parameters.iter().enumerate() {
            for value in [parameter.min, parameter.max] {
                let mut effect = Effect::typical(kind, form);
                effect.values[index] = value;
                let effect = [effect];
                for nominal in [Nominal::REFERENCE, CLAMPED] {
                    let found = try_run(&nominal, &effect, &inputs, 1e-4);
                    let force_n = found.map_or(Vec::new(), |signals| signals.force_n);
                    assert!(force_n.iter().all(|n| n.is_finite()), "{effect:?}");
                }
            }
        }
    }
}

#[test]
fn an_effect_of_a_subsystem_that_is_not_simulated_is_ignored() {
    let inputs = bench(STEP_S, 101, |_| 0.1, |time_s| 2e5 + 1e5 * time_s);
    let leak = effect(&leak::KIND, "linear", &[("conductance_kg_per_pa_s", 4e-9)]);
    assert_eq!(force_n(&[leak], &inputs), force_n(&[], &inputs));
}

fn air() -> GasSubsystem {
    let nominal = Nominal::REFERENCE;
    GasSubsystem {
        gas: nominal.gas.expect("gas"),
        volume: nominal.volume.expect("a volume"),
        initial_length_m: nominal.muscle.initial_length_m,
        terms: Terms::default(),
    }
}

/// The term with states that a form adds to the muscle force where the pressure is an input.
fn muscle_term(effect: &Effect) -> Option<Box<dyn MuscleTerm>> {
    let term = match effect.term() {
        Term::Muscle(term) => Some(term),
        Term::Line(term) => term.with_measured_pressure(Some(air())),
        _ => None,
    };
    term.filter(|term| term.states() > 0)
}

/// Propagation gives the states that integration of the rates gives, here by the midpoint rule in
/// 5000 steps: for every form that has states in a muscle whose inputs are measured.
#[test]
fn states_propagate_as_their_rates_say() {
    let mut compared = Vec::new();
    for (kind, form) in every_form() {
        let effect = Effect::typical(kind, form);
        if let Some(term) = muscle_term(&effect) {
            for direction in [1.0, -1.0] {
                assert_propagates(&*term, direction, form.name);
            }
            compared.push(form.name);
        }
    }
    let with_states: Vec<_> = every_form()
        .filter(|(kind, form)| {
            let term = Effect::typical(kind, form).term();
            let plant = Plant::new(&CLAMPED, [term], Simulated::FORCE_ONLY).expect("a plant");
            plant.muscle.terms.have_states()
        })
        .map(|(_, form)| form.name)
        .collect();
    assert_eq!(compared, with_states);
}

fn assert_propagates(term: &dyn MuscleTerm, direction: f64, what: &str) {
    let point = |time_s: f64| MusclePoint {
        time_s,
        contraction: 0.06 + 0.04 * direction * time_s,
        contraction_rate_per_s: 0.04 * direction,
        direction,
        pressure: GaugePa(1e5 + 4e5 * time_s),
    };
    let mut propagated = vec![0.0; term.states()];
    term.steady_state(&point(0.0), &mut propagated);
    term.bias_memory(&point(0.0), 0.3, &mut propagated);
    let mut integrated = propagated.clone();
    term.propagate(&point(0.0), &point(0.5), &mut propagated);
    let step_s = 1e-4;
    for step in 0..5000 {
        let begin_s = f64::from(step) * step_s;
        let mut moved = integrated.clone();
        for (time_s, length_s) in [(begin_s, 0.5 * step_s), (begin_s + 0.5 * step_s, step_s)] {
            let mut rates = vec![0.0; moved.len()];
            term.rates(&point(time_s), &moved, &mut rates);
            let states = integrated.iter().zip(&rates);
            moved = states
                .map(|(state, rate)| state + length_s * rate)
                .collect();
        }
        integrated = moved;
        term.accept_step(&point(begin_s + step_s), &mut integrated);
    }
    let difference = largest_difference(&propagated, &integrated);
    assert!(difference < 1e-5, "{what}: {difference}");
}

#[test]
fn every_equation_names_all_keys_of_its_form() {
    for (kind, form) in every_form() {
        let name = (kind.name, form.name);
        let mut words = form
            .equation
            .split(|character: char| !(character.is_ascii_alphanumeric() || character == '_'));
        for parameter in form.parameters {
            let found = words.clone().any(|word| word == parameter.name);
            assert!(found, "{name:?}: {}", parameter.name);
        }
        assert!(words.any(|word| !word.is_empty()), "{name:?}");
        assert!(!form.source.contains("Leaves out"), "{name:?}");
        let ends_as_a_phrase = !form.leaves_out.is_empty() && !form.leaves_out.ends_with('.');
        assert!(ends_as_a_phrase, "{name:?}");
    }
}

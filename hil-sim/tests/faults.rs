//! The fault campaign in short; and that it can fail. The whole one: `hil-sim faults`.

use hil_sim::faults::Case;
use hil_sim::faults::campaign::{run_all, run_case};
use hil_sim::faults::kind::{KINDS, Kind};
use hil_sim::faults::outcome::Outcome;
use model_core::safety::SafetyFunction;
use muscle_plant::effects::Catalogue;
use muscle_plant::effects::Effect;
use rayon::prelude::*;

fn outside(outcomes: &[Outcome]) -> Vec<&Outcome> {
    let outside = outcomes.iter().filter(|case| !case.outside.is_empty());
    outside.collect()
}

#[test]
fn no_case_is_outside_its_bounds() {
    let cases = (0..6 * KINDS.len() as u64).into_par_iter();
    let outcomes = run_all(cases.map(|n| Case::new(3, n)), None, || {}).expect("it runs");
    assert!(outside(&outcomes).is_empty(), "{:#?}", outside(&outcomes));
}

#[test]
fn the_same_case_gives_the_same_outcome() {
    let pairs = KINDS.par_iter().map(|kind| {
        [(); 2].map(|()| run_case(&Case::of(kind, 1, 0), None, |_| {}).expect("it runs"))
    });
    for [once, again] in pairs.collect::<Vec<_>>() {
        assert_eq!(once, again);
    }
}

fn kind(name: &str) -> &'static Kind {
    let found = KINDS.iter().find(|kind| kind.name == name);
    found.unwrap_or_else(|| panic!("no kind of fault is called {name}"))
}

/// Every form of every effect at its usual size, in lifts as people do them: no false alarm.
#[test]
fn a_healthy_rig_raises_no_alarm() {
    let healthy = kind("healthy");
    let forms = Catalogue::standard()
        .kinds()
        .flat_map(|kind| kind.forms.iter().map(move |form| (kind, form)));
    let forms: Vec<_> = forms.collect();
    let cases = forms.par_iter().flat_map(|(kind, form)| {
        (0..4).into_par_iter().map(|number| {
            let mut case = Case::of(healthy, 5, number);
            case.rig
                .effects
                .retain(|effect| effect.kind.name == "slack");
            let values = form.parameters.iter().map(|p| p.usual).collect();
            case.rig.effects.push(Effect { kind, form, values });
            case
        })
    });
    let outcomes = run_all(cases, None, || {}).expect("it runs");
    assert!(outside(&outcomes).is_empty(), "{:#?}", outside(&outcomes));
}

/// Cases in which a fault is looked for that shows the need of a safety function.
const TRIED: u64 = 600;

/// The safety functions, each with a kind of fault and the bound that a case of it violates without
/// the function. Of the last five no case is known that violates another bound than the reason's.
const NEEDED: [(SafetyFunction, &str, &str); 12] = [
    (
        SafetyFunction::SensorRange,
        "gauge drifting",
        "not let down",
    ),
    (SafetyFunction::SensorStuck, "gauge frozen", "not let down"),
    (
        SafetyFunction::ReferenceSpeed,
        "gauge drifting",
        "speed down",
    ),
    (SafetyFunction::VentRamp, "gauge drifting", "speed down"),
    (SafetyFunction::RestWatch, "valve ajar", "begun"),
    (SafetyFunction::SelfCheck, "gauge jumps", "begun"),
    (
        SafetyFunction::MemoryVote,
        "bit flip in the settings",
        "not let down",
    ),
    (
        SafetyFunction::SensorStep,
        "encoder home lost",
        "reason wrong",
    ),
    (
        SafetyFunction::PressureWatch,
        "valve stuck at the exhaust",
        "reason wrong",
    ),
    (
        SafetyFunction::WeightWatch,
        "payload doubled",
        "reason late",
    ),
    (SafetyFunction::SpeedTrip, "payload lost", "reason late"),
    (SafetyFunction::MissedTicks, "ticks missed", "reason late"),
];

#[test]
fn without_any_safety_function_a_case_violates_a_bound() {
    for function in SafetyFunction::ALL {
        assert!(NEEDED.iter().any(|(named, ..)| *named == function));
    }
    let not_needed = NEEDED.into_par_iter().filter(|(function, fault, bound)| {
        let cases = (0..TRIED).map(|number| Case::of(kind(fault), 1, number));
        let is_needed = |case: &Case| {
            let run = |without| run_case(case, without, |_| {}).expect("it runs");
            let is_outside = run(Some(*function)).outside.contains(bound);
            is_outside && run(None).outside.is_empty()
        };
        let shown = cases.into_iter().find(is_needed);
        println!(
            "{function:?}: {:?}",
            shown.as_ref().map(|c| (c.number, c.size, c.moment))
        );
        shown.is_none()
    });
    assert_eq!(not_needed.collect::<Vec<_>>(), []);
}

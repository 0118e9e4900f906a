//! The fault campaign in short; and that it can fail. The whole one: `hil-sim faults`.

use hil_sim::effects::CATALOGUE;
use hil_sim::faults::Case;
use hil_sim::faults::campaign::{run_all, run_case};
use hil_sim::faults::kind::{KINDS, Kind};
use hil_sim::faults::outcome::Outcome;
use hil_sim::rig::Effect;
use model_core::safety::SafetyFunction;
use rayon::prelude::*;

/// Cases `numbers` of the kind `name`, without a safety function if one is named.
fn of_kind(name: &str, cases: u64, without: Option<SafetyFunction>) -> Vec<Outcome> {
    let kind = KINDS.iter().find(|kind| kind.name == name).expect(name);
    let cases = (0..cases).into_par_iter().map(|n| Case::of(kind, 1, n));
    run_all(cases, without, || {}).expect("the reference rig runs")
}

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
fn a_case_is_its_number() {
    for number in [0, 7, 400] {
        let once = run_case(&Case::new(1, number), None, |_| {}).expect("it runs");
        let mut ticks = 0;
        let again = run_case(&Case::new(1, number), None, |_| ticks += 1).expect("it runs");
        assert_eq!(once, again);
        assert!(ticks > 100);
    }
}

/// Every form of every effect at its usual size, in lifts as people do them: no false alarm.
#[test]
fn a_healthy_rig_raises_no_alarm() {
    let healthy: &'static Kind = &KINDS[0];
    assert_eq!(healthy.name, "healthy");
    let forms = CATALOGUE
        .iter()
        .flat_map(|kind| kind.forms.iter().map(move |form| (kind, form)));
    let forms: Vec<_> = forms.collect();
    assert!(forms.len() >= 45);
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

/// Each safety function is needed: without it these kinds have cases outside their bounds, and with
/// it none.
#[test]
fn without_any_safety_function_cases_are_outside() {
    let needed = [
        (SafetyFunction::SensorRange, "gauge running away", 40),
        (SafetyFunction::SensorStep, "encoder home lost", 40),
        (SafetyFunction::SensorStuck, "gauge frozen", 20),
        (SafetyFunction::PressureWatch, "DAC at zero", 60),
        (SafetyFunction::WeightWatch, "payload doubled", 120),
        (SafetyFunction::SpeedTrip, "payload lost", 60),
        (SafetyFunction::ReferenceSpeed, "gauge jumps", 60),
        (SafetyFunction::VentRamp, "pressure sensor open", 40),
        (SafetyFunction::MissedTicks, "ticks missed", 20),
        (SafetyFunction::RestWatch, "valve ajar", 40),
        (SafetyFunction::SelfCheck, "lever slammed", 60),
        (SafetyFunction::MemoryVote, "bit flip in the state", 20),
    ];
    assert_eq!(needed.map(|(function, ..)| function), SafetyFunction::ALL);
    let mut useless = Vec::new();
    for (function, kind, cases) in needed {
        let with = of_kind(kind, cases, None);
        assert!(outside(&with).is_empty(), "{kind}: {:#?}", outside(&with));
        let without = of_kind(kind, cases, Some(function));
        let found = outside(&without);
        println!(
            "without {function:?}: {} of {cases} cases of `{kind}` outside: {:?}",
            found.len(),
            found.first().map(|case| &case.outside)
        );
        if found.is_empty() {
            useless.push(function);
        }
    }
    assert!(useless.is_empty(), "nothing shows the need of {useless:?}");
}

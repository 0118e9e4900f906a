//! The fault campaign in short; and that it can fail. The whole one: `hil-sim faults`.

use hil_sim::faults::Case;
use hil_sim::faults::ablation::SafetyFunction;
use hil_sim::faults::campaign::{run_all, run_case};
use hil_sim::faults::kind::{KINDS, Kind};
use hil_sim::faults::outcome::Outcome;
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
    let forms = Catalogue::standard()
        .kinds()
        .flat_map(|kind| kind.forms.iter().map(move |form| (kind, form)));
    let forms: Vec<_> = forms.collect();
    assert!(forms.len() >= 49);
    let cases = forms.par_iter().flat_map(|(kind, form)| {
        (0..4).into_par_iter().map(|number| {
            let mut case = Case::of(healthy, 5, number);
            case.rig
                .effects
                .retain(|effect| effect.kind.name == "slack");
            case.rig.effects.push(Effect::typical(kind, form));
            case
        })
    });
    let outcomes = run_all(cases, None, || {}).expect("it runs");
    assert!(outside(&outcomes).is_empty(), "{:#?}", outside(&outcomes));
}

/// Each safety function is needed: without it a case that is within its bounds is outside of one.
/// Of the last five no case is known that is outside of another bound than the reason's.
#[test]
fn without_any_safety_function_a_case_is_outside() {
    let needed = [
        (SafetyFunction::SensorRange, 5, "not let down"),
        (SafetyFunction::SensorStuck, 491, "not let down"),
        (SafetyFunction::ReferenceSpeed, 2933, "speed down"),
        (SafetyFunction::VentRamp, 432, "speed down"),
        (SafetyFunction::RestWatch, 2038, "begun"),
        (SafetyFunction::SelfCheck, 2510, "begun"),
        (SafetyFunction::MemoryVote, 2377, "not let down"),
        (SafetyFunction::SensorStep, 1661, "reason wrong"),
        (SafetyFunction::PressureWatch, 2832, "reason wrong"),
        (SafetyFunction::WeightWatch, 1379, "reason late"),
        (SafetyFunction::SpeedTrip, 95, "reason late"),
        (SafetyFunction::MissedTicks, 655, "reason late"),
    ];
    for function in SafetyFunction::ALL {
        assert!(needed.iter().any(|(named, ..)| *named == function));
    }
    let found = needed.into_par_iter().map(|(function, number, bound)| {
        let run = |without| run_case(&Case::new(1, number), without, |_| {}).expect("it runs");
        (function, bound, run(None), run(Some(function)))
    });
    let found: Vec<(SafetyFunction, &str, Outcome, Outcome)> = found.collect();
    for (function, bound, with, without) in found {
        println!("without {function:?}: {} {:?}", with.fault, without.outside);
        assert!(with.outside.is_empty(), "{with:#?}");
        assert!(
            without.outside.contains(&bound),
            "{function:?}: {without:#?}"
        );
    }
}

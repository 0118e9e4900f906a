//! A short fault campaign, and tests that each bound can be violated. `hil-sim faults` runs the
//! whole campaign.

use hil_sim::bench::person::Finger;
use hil_sim::faults::ablation::SafetyFunction;
use hil_sim::faults::bounds::bounds;
use hil_sim::faults::campaign::{run_all, run_case};
use hil_sim::faults::kind::{KINDS, Kind, LimitedBy};
use hil_sim::faults::outcome::Outcome;
use hil_sim::faults::{Case, Moment};
use model_core::controller::{Control, Controller};
use model_core::io::Sensors;
use model_core::settings::{Settings, SettingsValues};
use model_core::supervisor::Mode;
use muscle_plant::effects::Catalogue;
use muscle_plant::effects::Effect;
use muscle_plant::nominal::Load;
use rayon::prelude::*;

fn violating(outcomes: &[Outcome]) -> Vec<&Outcome> {
    let violating = outcomes.iter().filter(|case| !case.violations.is_empty());
    violating.collect()
}

#[test]
fn no_case_violates_its_bounds() {
    let cases = (0..6 * KINDS.len() as u64).into_par_iter();
    let outcomes = run_all(cases.map(|n| Case::new(3, n)), None, || {}).expect("it runs");
    assert!(
        violating(&outcomes).is_empty(),
        "{:#?}",
        violating(&outcomes)
    );
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

/// Every form of every effect at its typical size, in lifts of typical height and speed.
#[test]
fn a_healthy_rig_causes_no_false_alarm() {
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
            case.rig.effects.push(Effect::typical(kind, form));
            case
        })
    });
    let outcomes = run_all(cases, None, || {}).expect("it runs");
    assert!(
        violating(&outcomes).is_empty(),
        "{:#?}",
        violating(&outcomes)
    );
}

/// Number of cases that are searched for one that shows the need of a safety function.
const TRIED: u64 = 600;

/// The safety functions, each with a kind of fault and the bound that a case of it violates without
/// the function. Of the last seven no case is known that violates another bound than the reason's.
const NEEDED: [(SafetyFunction, &str, &str); 14] = [
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
        "bit flips in all copies of the settings",
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
    (
        SafetyFunction::EmergencyStop,
        "emergency stop pressed",
        "reason late",
    ),
    (SafetyFunction::ReadBack, "DAC off", "reason late"),
];

#[test]
fn without_any_safety_function_a_case_violates_a_bound() {
    for function in SafetyFunction::ALL {
        // No limb is in the way in these cases; the sequences show its need.
        let is_named = NEEDED.iter().any(|(named, ..)| *named == function);
        assert_eq!(is_named, !function.needs_limb());
    }
    let not_needed = NEEDED.into_par_iter().filter(|(function, fault, bound)| {
        let cases = (0..TRIED).map(|number| Case::of(kind(fault), 1, number));
        let is_needed = |case: &Case| {
            let run = |without| run_case(case, without, |_| {}).expect("it runs");
            let is_violated = run(Some(*function)).violations.contains(bound);
            is_violated && run(None).violations.is_empty()
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

/// The first case of `kind` whose fault falls at `moment`.
fn case_at(kind: &'static Kind, moment: Moment) -> Case {
    let mut cases = (0..).map(|number| Case::of(kind, 1, number));
    let found = cases.find(|case| case.moment == moment);
    found.expect("every moment is drawn at some number")
}

/// The same kind of fault, with the bounds of a motion that the controller limits.
fn limited_by_controller(name: &str) -> &'static Kind {
    Box::leak(Box::new(Kind {
        limited_by: LimitedBy::Controller,
        ..*kind(name)
    }))
}

/// With the narrow bounds for a fault that only energy limits, or on a rig that does not match the
/// controller's settings. "speed down" and the other bounds are in [`NEEDED`].
#[test]
fn every_bound_of_the_weight_and_the_pressure_can_be_violated() {
    let lost = case_at(limited_by_controller("payload lost"), Moment::Holding);
    let mut strong = case_at(limited_by_controller("valve stuck open"), Moment::Holding);
    if let Some(valve) = &mut strong.rig.nominal.valve {
        valve.supply_pressure.0 = 8e5;
    }
    let healthy = case_at(kind("healthy"), Moment::Lifting);
    // The lift lasts longer than the case.
    let cut_off = Case {
        ends_s: healthy.fault_s,
        finger: Finger::Lift {
            start_s: healthy.fault_s + 2.5,
            travel_m: 0.12,
            rise_s: 1.5,
            hold_s: 0.0,
            lower_s: 1.5,
        },
        ..healthy.clone()
    };
    let mut heavy = healthy.clone();
    if let Load::Weight(weight) = &mut heavy.rig.nominal.load {
        weight.mass_kg *= 2.0;
    }
    for (case, bound) in [
        (&lost, "speed up"),
        (&strong, "height"),
        (&strong, "pressure"),
        (&cut_off, "not at rest"),
        (&heavy, "false alarm"),
    ] {
        let outcome = run_case(case, None, |_| {}).expect("it runs");
        assert!(outcome.violations.contains(&bound), "{bound}: {outcome:#?}");
    }
}

/// If only energy limits the motion, the bounds in its direction are wider.
#[test]
fn bounds_are_wider_if_only_energy_limits_the_motion() {
    let values = SettingsValues::reference();
    let bounds_of = |kind| bounds(&case_at(kind, Moment::Holding), &values);
    let kept = bounds_of(limited_by_controller("payload lost"));
    let flung = bounds_of(kind("payload lost"));
    let dropped = bounds_of(kind("supply lost"));
    assert!(flung.speed_up_m_per_s > kept.speed_up_m_per_s && flung.height_m > kept.height_m);
    assert!(dropped.speed_down_m_per_s > kept.speed_down_m_per_s);
    assert_eq!(dropped.speed_up_m_per_s, kept.speed_up_m_per_s);
    assert_eq!(dropped.height_m, kept.height_m);
    // Three halves of the reference's speed, and free fall for three ticks.
    assert!((kept.speed_up_m_per_s - (1.5 * 0.25 + 9.80665 * 0.03)).abs() < 1e-12);
    // Free fall through the stroke, 0.099 m, from the speed that the controller permits.
    let squared_speed = 2.0 * 9.80665 * kept.height_m + kept.speed_down_m_per_s.powi(2);
    assert!((dropped.speed_down_m_per_s - squared_speed.sqrt()).abs() < 1e-12);
    assert!((kept.pressure_pa - 5.5e5).abs() < 1e-6);
}

#[test]
fn a_reference_beyond_its_limit_is_not_passed_on() {
    let settings = Settings::new(SettingsValues::reference()).expect("the reference is valid");
    let mut controller = Controller::new(settings);
    let mut state = *controller.state();
    (state.mode, state.pressure_ref_pa) = (Mode::Holding, 6e5);
    controller.memory_mut().state.set(state);
    let output = controller.tick(&Sensors::default());
    assert_eq!(output.pressure_ref.0, settings.values().pressure_pa_max);
}

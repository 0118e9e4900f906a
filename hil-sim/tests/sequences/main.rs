//! Sequences of faults and of what persons do, against the bounds of the body.
//!
//! docs/safety.md has the tables that they print, and the command for all 40 000 cases.

mod body;
mod case;
mod event;
mod plant;

use case::{Case, Outcome};
use event::{Event, What};
use hil_sim::faults::ablation::{AblatedController, SafetyFunction};
use model_core::controller::Controller;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::time::Instant;

/// What the controller keeps, whatever happens, unless only hardware limits the energy. Forces on a
/// limb that the weight meets are not among them: see docs/safety.md.
const KEPT: [&str; 4] = [
    "speed up",
    "speed down",
    "height not asked for",
    "lasting force",
];

fn run(case: &Case, without: Option<SafetyFunction>) -> Outcome {
    let settings = case.settings();
    match without {
        None => case.run(Controller::new(settings), &settings),
        Some(function) => case.run(AblatedController::new(settings, function), &settings),
    }
}

/// The cases with what happens in them, of which `is_run` selects some.
fn run_all(
    count: u64,
    without: Option<SafetyFunction>,
    is_run: fn(&Case) -> bool,
) -> Vec<(Case, Outcome)> {
    let cases = (0..count).into_par_iter().map(Case::new).filter(is_run);
    let ran = cases.map(|case| {
        let outcome = run(&case, without);
        (case, outcome)
    });
    ran.collect()
}

/// Number of cases: `SEQUENCES`; a few by default.
fn count() -> u64 {
    let asked = std::env::var("SEQUENCES").ok();
    asked.map_or(1_000, |asked| asked.parse().expect("SEQUENCES: a number"))
}

/// Only the controller limits it, and the person has an enabling device.
fn is_controlled(case: &Case) -> bool {
    case.enabling && !case.events.iter().any(|event| event.what.needs_hardware())
}

fn kept(case: &Case, outcome: &Outcome) -> Vec<&'static str> {
    let mut violations = outcome.violations(case);
    violations.retain(|violation| KEPT.contains(violation));
    violations
}

fn most(outcomes: &[(Case, Outcome)], value: fn(&Outcome) -> f64) -> f64 {
    let values = outcomes.iter().map(|(_, outcome)| value(outcome));
    values.fold(0.0, f64::max)
}

#[test]
fn what_the_controller_can_limit_stays_within_the_bounds_of_the_body() {
    let start = Instant::now();
    let outcomes = run_all(count(), None, |_| true);
    println!(
        "{} cases in {:.0} s",
        outcomes.len(),
        start.elapsed().as_secs_f64()
    );
    for (needs_hardware, enabling) in [(false, true), (false, false), (true, true), (true, false)] {
        let of = |(case, outcome): &&(Case, Outcome)| {
            outcome.needs_hardware == needs_hardware && case.enabling == enabling
        };
        let outcomes: Vec<_> = outcomes.iter().filter(of).cloned().collect();
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for (case, outcome) in &outcomes {
            for violation in outcome.violations(case) {
                *counts.entry(violation).or_default() += 1;
            }
        }
        println!(
            "needs hardware: {needs_hardware}, enabling device: {enabling}: {} cases, \
             {:.2} m/s up, {:.2} m/s down, {:.0} mm not asked for, {:.0} N; {counts:?}",
            outcomes.len(),
            most(&outcomes, |one| one.up_m_per_s),
            most(&outcomes, |one| one.down_m_per_s),
            most(&outcomes, |one| 1e3 * one.unasked_m),
            most(&outcomes, |one| one.limb_n),
        );
    }
    let violating = outcomes
        .iter()
        .filter(|(case, outcome)| is_controlled(case) && !kept(case, outcome).is_empty());
    let violating: Vec<_> = violating
        .map(|(case, outcome)| (case.seed, kept(case, outcome), &case.events))
        .collect();
    assert!(violating.is_empty(), "seed, bounds, events: {violating:#?}");
}

#[test]
fn the_same_seed_gives_the_same_outcome() {
    for seed in 0..20 {
        assert_eq!(
            run(&Case::new(seed), None),
            run(&Case::new(seed), None),
            "seed {seed}"
        );
    }
}

/// Which bounds of the body are violated without each safety function, and with all of them.
#[test]
#[ignore = "takes minutes"]
fn bounds_that_are_violated_without_each_safety_function() {
    let all = SafetyFunction::ALL.map(Some);
    for without in std::iter::once(None).chain(all) {
        let outcomes = run_all(count(), without, |case| {
            !case.events.iter().any(|event| event.what.needs_hardware())
        });
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for (case, outcome) in &outcomes {
            for violation in outcome.violations(case) {
                *counts.entry(violation).or_default() += 1;
            }
        }
        println!(
            "| `{}` | {} | {counts:?} | {:.2} / {:.2} | {:.0} | {:.0} |",
            without.map_or("none", SafetyFunction::name),
            outcomes.len(),
            most(&outcomes, |one| one.up_m_per_s),
            most(&outcomes, |one| one.down_m_per_s),
            most(&outcomes, |one| 1e3 * one.unasked_m),
            most(&outcomes, |one| one.limb_n),
        );
    }
}

/// The ramp keeps the force on a foot that is below when the person lets the enabling device go.
#[test]
fn without_the_ramp_the_weight_hurts_a_foot() {
    let scenarios = scenarios();
    let foot = scenarios.iter().find(|one| one.foot_m.is_some());
    let foot = foot.expect("a scenario with a foot");
    for without in [None, Some(SafetyFunction::VentRamp)] {
        let outcomes = of_scenario(foot, true, without);
        let hit = outcomes
            .iter()
            .filter(|(case, one)| one.violations(case).contains(&"transient force"));
        assert_eq!(hit.count() > 0, without.is_some(), "{without:?}");
    }
}

/// A scenario of the audit.
struct Scenario {
    name: &'static str,
    events: Vec<(What, f64, f64)>,
    hand_m: Option<f64>,
    foot_m: Option<f64>,
}

fn scenarios() -> Vec<Scenario> {
    let of = |name, events| Scenario {
        name,
        events,
        hand_m: None,
        foot_m: None,
    };
    let alone = |what| vec![(What::LetsGo, 1.25, 9.8), (what, 1.3, 9.8)];
    let lets_go = (What::LetsGo, 3.0, 9.8);
    vec![
        of("a snag of 1 s", vec![(What::Snag, 2.0, 3.0)]),
        of("a snag of 2 s", vec![(What::Snag, 2.0, 4.0)]),
        of("valve shut for 0.6 s", vec![(What::ValveShut, 2.0, 2.6)]),
        of("valve shut for 2 s", vec![(What::ValveShut, 2.0, 4.0)]),
        of(
            "supply 0.3 and 1, every 0.4 s",
            vec![(What::Supply(0.3, Some(0.4)), 1.5, 5.0)],
        ),
        of(
            "a helper, 100 N for 0.5 s",
            vec![(What::Force(100.0), 2.5, 3.0)],
        ),
        of(
            "a helper, 118 N for 1 s",
            vec![(What::Force(118.0), 2.5, 3.5)],
        ),
        of(
            "a hand, ±60 mm at 2 Hz",
            vec![(What::Shakes(0.06, 2.0), 1.5, 5.0)],
        ),
        of("DAC bit 10 at 0", vec![(What::DacBit(10), 2.5, 6.0)]),
        of(
            "valve at 0.6 of the supply",
            vec![(What::ValveAt(0.6), 2.5, 6.0)],
        ),
        of(
            "every second tick missed, payload lost",
            vec![
                (What::TicksHalting(2), 2.4, 6.0),
                (What::Exchanged(0.05), 2.5, 6.0),
            ],
        ),
        of(
            "gauge creeps 3 N/s to 7 N, nobody there",
            alone(What::GaugeCreep(3.0, 7.0)),
        ),
        of(
            "ripple of 6 N at 99.9 Hz, nobody there",
            alone(What::GaugeRipple(6.0, 99.9)),
        ),
        of("gauge 7 N off, nobody there", alone(What::GaugeZero(7.0))),
        Scenario {
            hand_m: Some(0.03),
            ..of("a hand above the weight", vec![])
        },
        Scenario {
            hand_m: Some(0.03),
            ..of("the same, then lets go", vec![lets_go])
        },
        Scenario {
            foot_m: Some(0.02),
            ..of("a foot below, then lets go", vec![lets_go])
        },
    ]
}

fn of_scenario(
    scenario: &Scenario,
    enabling: bool,
    without: Option<SafetyFunction>,
) -> Vec<(Case, Outcome)> {
    let seeds = (0..16).into_par_iter();
    let cases = seeds.map(|seed| {
        let events = scenario.events.iter().map(|(what, from_s, to_s)| Event {
            what: *what,
            during_s: *from_s..*to_s,
        });
        Case {
            enabling,
            hand_m: scenario.hand_m,
            foot_m: scenario.foot_m,
            ..Case::with(events.collect(), seed)
        }
    });
    cases
        .map(|case| {
            let outcome = run(&case, without);
            (case, outcome)
        })
        .collect()
}

#[test]
fn scenarios_of_the_audit() {
    for scenario in scenarios() {
        for enabling in [false, true] {
            let outcomes = of_scenario(&scenario, enabling, None);
            let mut violations: BTreeMap<&str, usize> = BTreeMap::new();
            for (case, outcome) in &outcomes {
                for violation in outcome.violations(case) {
                    *violations.entry(violation).or_default() += 1;
                }
            }
            let reasons = outcomes
                .iter()
                .filter(|(_, one)| one.fault.is_some())
                .count();
            println!(
                "| {} | {enabling} | {:.2} / {:.2} | {:.0} | {:.0}, {:.2} s, {:.1} s | {reasons} | \
                 {violations:?} |",
                scenario.name,
                most(&outcomes, |one| one.up_m_per_s),
                most(&outcomes, |one| one.down_m_per_s),
                most(&outcomes, |one| 1e3 * one.unasked_m),
                most(&outcomes, |one| one.limb_n),
                most(&outcomes, |one| one.pressed_s),
                most(&outcomes, |one| one.contact_s),
            );
            // Nobody at the lever, and nobody holds the enabling device.
            if enabling {
                assert!(
                    !violations.contains_key("height not asked for"),
                    "{}",
                    scenario.name
                );
            }
        }
    }
}

//! Sequences of faults and of what persons do, against the bounds of the body.
//!
//! docs/safety.md has the tables that they print, and the command for all 40 000 cases.

mod body;
mod case;
mod event;
mod plant;
mod run;
mod scenario;

use body::CONTROLLED_M_PER_S;
use case::{Case, Outcome};
use hil_sim::faults::ablation::SafetyFunction;
use run::{Ran, is_controlled, kept, most, run, run_all, tally};
use scenario::{of_scenario, scenarios};
use std::time::Instant;

/// Number of cases: `SEQUENCES`; a few by default.
fn count() -> u64 {
    let asked = std::env::var("SEQUENCES").ok();
    asked.map_or(1_000, |asked| asked.parse().expect("SEQUENCES: a number"))
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
        let of = |(case, outcome): &&Ran| {
            outcome.needs_hardware == needs_hardware && case.enabling == enabling
        };
        let outcomes: Vec<_> = outcomes.iter().filter(of).cloned().collect();
        let counts = tally(&outcomes);
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

/// A lever that is shaken with the weight's own frequency drives the weight up to 0.72 m/s within
/// half a period, unless the reference stops driving it on.
#[test]
fn a_shaken_lever_does_not_drive_the_weight_beyond_its_speed() {
    for seed in [6_452, 6_981, 18_473, 18_916, 24_404] {
        let case = Case::new(seed);
        let speeds = |outcome: Outcome| outcome.up_m_per_s.max(outcome.down_m_per_s);
        let m_per_s = speeds(run(&case, None));
        assert!(m_per_s < CONTROLLED_M_PER_S, "seed {seed}: {m_per_s} m/s");
        let m_per_s = speeds(run(&case, Some(SafetyFunction::ReferenceSpeed)));
        assert!(m_per_s > CONTROLLED_M_PER_S, "seed {seed}: {m_per_s} m/s");
    }
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
        let counts = tally(&outcomes);
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

/// In this scenario, with an enabling device, the function keeps the bound: with it no case
/// violates it, without it some do.
fn assert_needed(function: SafetyFunction, scenario: &str, bound: &str) {
    let scenarios = scenarios();
    let scenario = scenarios.iter().find(|one| one.name == scenario);
    let scenario = scenario.expect("a scenario");
    for without in [None, Some(function)] {
        let outcomes = of_scenario(scenario, true, without);
        let violating = tally(&outcomes).get(bound).copied().unwrap_or(0);
        assert_eq!(violating > 0, without.is_some(), "{without:?}: {violating}");
    }
}

/// A foot is below when the person lets the enabling device go.
const FOOT: &str = "a foot below, then lets go";

#[test]
fn without_the_ramp_the_weight_hurts_a_foot() {
    assert_needed(SafetyFunction::VentRamp, FOOT, "transient force");
}

#[test]
fn without_the_retreat_a_foot_stays_below_the_weight() {
    assert_needed(SafetyFunction::Retreat, FOOT, "not released");
}

/// The valve in the muscle's port closes before the weight is on the foot, and keeps it above.
#[test]
fn without_the_pressure_watch_a_foot_stays_below_the_weight() {
    let scenario = "a foot below, the valve leaks to the exhaust, with a valve in the port";
    assert_needed(SafetyFunction::PressureWatch, scenario, "not released");
}

#[test]
fn without_the_emergency_stop_a_hand_stays_clamped() {
    let scenario = "the same, the lever stays up, then the emergency stop";
    assert_needed(SafetyFunction::EmergencyStop, scenario, "not released");
}

#[test]
fn scenarios_of_the_audit() {
    for scenario in scenarios() {
        for enabling in [false, true] {
            let outcomes = of_scenario(&scenario, enabling, None);
            let violations = tally(&outcomes);
            let reasons = outcomes
                .iter()
                .filter(|(_, one)| one.fault.is_some())
                .count();
            println!(
                "| {} | {} | {enabling} | {:.2} / {:.2} | {:.0} | {:.0}, {:.2} s, {:.1} s | \
                 {reasons} | {violations:?} |",
                scenario.name,
                scenario.before,
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

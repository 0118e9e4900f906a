//! Sequences of faults and of what persons do, against the bounds of the body.
//!
//! docs/safety.md has the tables that they print, and the command for all 40 000 cases.

mod body;
mod case;
mod event;
mod plant;
mod run;
mod scenario;

use body::{CONTROLLED_M_PER_S, FOOT};
use case::Case;
use event::{Event, What};
use hil_sim::faults::ablation::SafetyFunction;
use run::{Draw, Ran, is_controlled, kept, most, run, run_all, tally};
use scenario::{needed, of_scenario, scenarios};
use std::time::Instant;

/// Number of cases: `SEQUENCES`; a few by default.
fn count() -> u64 {
    let asked = std::env::var("SEQUENCES").ok();
    asked.map_or(1_000, |asked| asked.parse().expect("SEQUENCES: a number"))
}

/// Prints what happened, by what limits it and whether there is an enabling device.
fn print(outcomes: &[Ran]) {
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
}

#[test]
fn what_the_controller_can_limit_stays_within_the_bounds_of_the_body() {
    let start = Instant::now();
    let outcomes = run_all(Case::new, count(), None, |_| true);
    println!(
        "{} cases in {:.0} s",
        outcomes.len(),
        start.elapsed().as_secs_f64()
    );
    print(&outcomes);
    let violating = outcomes
        .iter()
        .filter(|(case, outcome)| is_controlled(case) && !kept(case, outcome).is_empty());
    let violating: Vec<_> = violating
        .map(|(case, outcome)| (case.seed, kept(case, outcome), &case.events))
        .collect();
    assert!(violating.is_empty(), "seed, bounds, events: {violating:#?}");
}

/// Two bounds are others on some rigs (docs/safety.md): a weight that by itself may rest on a foot
/// with more than the lasting force does so if nothing lifts it off, and one that swings slowly
/// goes on by more than 25 mm when the person lets go.
#[test]
fn other_rigs_stay_within_the_bounds_too() {
    let outcomes = run_all(Case::on_another_rig, count(), None, |_| true);
    print(&outcomes);
    let kept = |(case, outcome): &Ran| {
        let mut violations = kept(case, outcome);
        let rests_on_foot = case.foot_m.is_some() && case.resting_n() > FOOT.lasting_n;
        let swings = outcome.unasked_m < case.swing_m();
        violations.retain(|violation| match *violation {
            "lasting force" => !rests_on_foot,
            "height not asked for" => !swings,
            _ => true,
        });
        violations
    };
    let controlled = outcomes.iter().filter(|(case, _)| is_controlled(case));
    let violating: Vec<_> = controlled
        .map(|ran| (ran.0.seed, kept(ran), &ran.0.events))
        .filter(|(_, violations, _)| !violations.is_empty())
        .collect();
    assert!(violating.is_empty(), "seed, bounds, events: {violating:#?}");
}

/// Also on a rig without an enabling device, on which it does not depend; and with a frozen
/// encoder, which tells no speed until it is found, but for one of the cases on other rigs.
#[test]
fn a_foot_is_met_with_no_more_than_it_may_be() {
    for draw in [Case::new, Case::on_another_rig] {
        let outcomes = run_all(draw, count(), None, |case| case.foot_m.is_some());
        print(&outcomes);
        let violating: Vec<_> = outcomes
            .iter()
            .filter(|(case, outcome)| {
                !outcome.needs_hardware && outcome.violations(case).contains(&"transient force")
            })
            .collect();
        let told: Vec<_> = violating
            .iter()
            .map(|(case, outcome)| (case.seed, outcome.limb_n, &case.events))
            .collect();
        let is_excused = |(case, outcome): &&Ran| !kept(case, outcome).contains(&"transient force");
        assert!(
            violating.len() <= 1 && violating.iter().all(is_excused),
            "seed, force, events: {told:#?}"
        );
    }
}

/// An encoder that loses counts on the way down shows a weight above its stop that is on it. What
/// it shows of a lift is too little then, which matters if it has lost most.
#[test]
fn an_encoder_that_loses_counts_lifts_no_further_than_it_may() {
    const MOST: f64 = 0.8;
    let case = |draw: Draw, share, lowered_m, seed| {
        let event = |what, from_s| Event {
            what,
            during_s: from_s..9.8,
        };
        let events = vec![
            event(What::Pushes(lowered_m), 1.5),
            event(What::EncoderLoses(share), 3.0),
            event(What::LetsGo, 3.0),
        ];
        let mut case = Case::with(draw(seed).nominal, events, seed);
        case.enabling = true;
        case
    };
    let mut with_most = 0;
    for draw in [Case::new, Case::on_another_rig] {
        for share in [0.05, 0.1, 0.2, 0.3, 0.5, MOST, 1.0] {
            for lowered_m in [0.02, 0.05, 0.1] {
                for seed in 0..8 {
                    let case = case(draw, share, lowered_m, seed);
                    let outcome = run(&case, None);
                    if kept(&case, &outcome).is_empty() {
                        continue;
                    }
                    let millimetres = 1e3 * outcome.unasked_m;
                    println!("{share}, {lowered_m} m, {seed}: {millimetres:.0} mm");
                    assert!(share == MOST, "{outcome:?}");
                    with_most += 1;
                }
            }
        }
    }
    assert!(with_most <= 1, "{with_most} of 48");
}

/// A lever that is shaken with the weight's own frequency drives the weight up to 0.72 m/s within
/// half a period, unless the reference stops driving it on. The limit of energy helps, too; without
/// it the speed is kept as well.
#[test]
fn a_shaken_lever_does_not_drive_the_weight_beyond_its_speed() {
    let cases = [6_452, 6_981, 18_473, 18_916, 24_404].map(Case::new);
    let fastest_m_per_s = |without| {
        let outcomes = cases.iter().map(|case| run(case, without));
        let speeds = outcomes.map(|outcome| outcome.up_m_per_s.max(outcome.down_m_per_s));
        speeds.fold(0.0, f64::max)
    };
    for without in [None, Some(SafetyFunction::ContactEnergy)] {
        let m_per_s = fastest_m_per_s(without);
        assert!(
            m_per_s < CONTROLLED_M_PER_S,
            "without {without:?}: {m_per_s} m/s"
        );
    }
    let m_per_s = fastest_m_per_s(Some(SafetyFunction::ReferenceSpeed));
    assert!(m_per_s > CONTROLLED_M_PER_S, "{m_per_s} m/s");
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
        let outcomes = run_all(Case::new, count(), without, |case| {
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

/// In its scenario no case violates the bound with the function, and some do without it.
#[test]
fn each_safety_function_keeps_a_bound_of_the_body() {
    let needed = needed();
    let functions: Vec<_> = needed.iter().map(|one| one.function).collect();
    for function in SafetyFunction::ALL {
        assert!(functions.contains(&function), "{function:?}");
    }
    for one in needed {
        let violating = [None, Some(one.function)].map(|without| {
            let outcomes = of_scenario(&one.scenario, one.enabling, without);
            tally(&outcomes).get(one.bound).copied().unwrap_or(0)
        });
        let (function, [with, without]) = (one.function, violating);
        println!(
            "{function:?}, {}: {} {with}, without it {without}",
            one.scenario.name, one.bound
        );
        assert!(with == 0 && without > 0, "{function:?}: {with}, {without}");
    }
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

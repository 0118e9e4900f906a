//! Runs cases, and tells what they violate.

use super::case::{Case, Outcome};
use super::event::What;
use hil_sim::faults::ablation::{AblatedController, SafetyFunction};
use model_core::controller::Controller;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// What the controller keeps, whatever happens, unless only hardware limits the energy.
pub const KEPT: [&str; 5] = [
    "speed up",
    "speed down",
    "height not asked for",
    "lasting force",
    "transient force",
];

/// A case and what has happened in it.
pub type Ran = (Case, Outcome);

pub fn run(case: &Case, without: Option<SafetyFunction>) -> Outcome {
    let settings = case.settings();
    match without {
        None => case.run(Controller::new(settings), &settings),
        Some(function) => case.run(AblatedController::new(settings, function), &settings),
    }
}

/// Makes the case of a seed.
pub type Draw = fn(u64) -> Case;

/// The cases with what happens in them, of which `is_run` selects some.
pub fn run_all(
    draw: Draw,
    count: u64,
    without: Option<SafetyFunction>,
    is_run: fn(&Case) -> bool,
) -> Vec<Ran> {
    let cases = (0..count).into_par_iter().map(draw).filter(is_run);
    let ran = cases.map(|case| {
        let outcome = run(&case, without);
        (case, outcome)
    });
    ran.collect()
}

/// Only the controller limits it, and the person has an enabling device.
pub fn is_controlled(case: &Case) -> bool {
    case.enabling && !case.events.iter().any(|event| event.what.needs_hardware())
}

/// The bounds that are to be kept and are not. A frozen encoder tells no speed, and so no energy,
/// until the pressure tells that it is frozen: then the transient force is not kept.
pub fn kept(case: &Case, outcome: &Outcome) -> Vec<&'static str> {
    let freezes = case
        .events
        .iter()
        .any(|event| event.what == What::EncoderFrozen);
    let mut violations = outcome.violations(case);
    violations.retain(|violation| KEPT.contains(violation));
    violations.retain(|violation| *violation != "transient force" || !freezes);
    violations
}

pub fn most(outcomes: &[Ran], value: fn(&Outcome) -> f64) -> f64 {
    let values = outcomes.iter().map(|(_, outcome)| value(outcome));
    values.fold(0.0, f64::max)
}

/// How many cases violate each bound.
pub fn tally(outcomes: &[Ran]) -> BTreeMap<&'static str, usize> {
    let mut counts = BTreeMap::new();
    for (case, outcome) in outcomes {
        for violation in outcome.violations(case) {
            *counts.entry(violation).or_default() += 1;
        }
    }
    counts
}

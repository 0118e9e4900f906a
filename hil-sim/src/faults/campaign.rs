//! Runs cases of the campaign, in parallel on all cores.

use super::Case;
use super::ablation::{AblatedController, SafetyFunction};
use super::outcome::Outcome;
use super::run::{run, settings};
use super::unit::OnPc;
use crate::bench::tick::Tick;
use crate::error::BadInput;
use model_core::controller::Controller;
use rayon::prelude::*;

/// Runs one case on this PC, with the board's controller or with one without a safety function.
/// `on_tick` is called with each tick.
///
/// # Errors
/// The case's rig does not fit.
pub fn run_case(
    case: &Case,
    without: Option<SafetyFunction>,
    on_tick: impl FnMut(&Tick),
) -> Result<Outcome, BadInput> {
    let (settings, are_valid) = settings(case)?;
    let mut outcome = match without {
        None => {
            let controller = Controller::new(settings);
            run(case, &settings, &mut OnPc::new(controller), on_tick)
        }
        Some(function) => {
            let controller = AblatedController::new(settings, function);
            run(case, &settings, &mut OnPc::new(controller), on_tick)
        }
    }?;
    if !are_valid {
        outcome.violations.push("unknown settings");
    }
    Ok(outcome)
}

/// Runs `cases` on all cores and returns their outcomes in the same order. `on_case` is called
/// after each case.
///
/// # Errors
/// The first case whose rig does not fit.
pub fn run_all(
    cases: impl ParallelIterator<Item = Case>,
    without: Option<SafetyFunction>,
    on_case: impl Fn() + Sync,
) -> Result<Vec<Outcome>, BadInput> {
    cases
        .map(|case| {
            let outcome = run_case(&case, without, |_| {});
            on_case();
            outcome
        })
        .collect()
}

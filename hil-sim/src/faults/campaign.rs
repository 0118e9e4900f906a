//! Many cases, on all cores.

use super::Case;
use super::ablation::{AblatedController, SafetyFunction};
use super::outcome::Outcome;
use super::run::{run, settings};
use super::unit::OnPc;
use crate::bench::tick::Tick;
use crate::error::BadInput;
use model_core::controller::Controller;
use rayon::prelude::*;

/// Runs one case on this PC, on the board's controller or on one that lacks a safety function.
///
/// # Errors
/// The case's rig does not fit.
pub fn run_case(
    case: &Case,
    without: Option<SafetyFunction>,
    seen: impl FnMut(&Tick),
) -> Result<Outcome, BadInput> {
    let (settings, known) = settings(case)?;
    let mut outcome = match without {
        None => {
            let controller = Controller::new(settings);
            run(case, &settings, &mut OnPc::new(controller), seen)
        }
        Some(function) => {
            let controller = AblatedController::new(settings, function);
            run(case, &settings, &mut OnPc::new(controller), seen)
        }
    }?;
    if !known {
        outcome.outside.push("unknown settings");
    }
    Ok(outcome)
}

/// Runs `cases` on all cores, `done` told of each; in their order.
///
/// # Errors
/// The first case whose rig does not fit.
pub fn run_all(
    cases: impl ParallelIterator<Item = Case>,
    without: Option<SafetyFunction>,
    done: impl Fn() + Sync,
) -> Result<Vec<Outcome>, BadInput> {
    cases
        .map(|case| {
            let outcome = run_case(&case, without, |_| {});
            done();
            outcome
        })
        .collect()
}

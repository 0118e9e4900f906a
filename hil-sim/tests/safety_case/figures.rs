//! The campaigns' figures on this commit: a part of each, small enough for every run of the tests.

use super::sequences::case::Case;
use super::sequences::run::{Ran, run_all as run_sequences};
use super::sequences::scenario::{Needed, Scenario, needed, of_scenario, scenarios};
use hil_sim::faults;
use hil_sim::faults::campaign::run_all;
use hil_sim::faults::kind::KINDS;
use hil_sim::faults::outcome::Outcome as FaultOutcome;
use rayon::prelude::*;

/// Seed of the campaign.
pub const SEED: u64 = 1;
/// Cases of each kind of fault.
pub const CASES_PER_KIND: u64 = 10;
/// Sequences.
pub const SEQUENCES: u64 = 400;

pub struct Figures {
    pub campaign: Vec<FaultOutcome>,
    pub sequences: Vec<Ran>,
    pub on_other_rigs: Vec<Ran>,
    /// Without and with an enabling device.
    pub scenarios: Vec<(Scenario, [Vec<Ran>; 2])>,
    /// With and without the function.
    pub needed: Vec<(Needed, [Vec<Ran>; 2])>,
}

fn campaign() -> Vec<FaultOutcome> {
    let numbers = (0..CASES_PER_KIND * KINDS.len() as u64).into_par_iter();
    let cases = numbers.map(|number| faults::Case::new(SEED, number));
    run_all(cases, None, || {}).expect("the campaign runs")
}

impl Figures {
    pub fn new() -> Figures {
        Figures {
            campaign: campaign(),
            sequences: run_sequences(Case::new, SEQUENCES, None, |_| true),
            on_other_rigs: run_sequences(Case::on_another_rig, SEQUENCES, None, |_| true),
            scenarios: scenarios()
                .into_iter()
                .map(|scenario| {
                    let outcomes = [false, true].map(|held| of_scenario(&scenario, held, None));
                    (scenario, outcomes)
                })
                .collect(),
            needed: needed()
                .into_iter()
                .map(|one| {
                    let outcomes = [None, Some(one.function)]
                        .map(|without| of_scenario(&one.scenario, one.enabling, without));
                    (one, outcomes)
                })
                .collect(),
        }
    }
}

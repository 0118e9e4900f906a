//! `hil-sim faults`.

use super::Failure;
use super::{Progress, REFERENCE_RIG, Results, whole};
use hil_sim::bench::recorder::Recorder;
use hil_sim::error::{BadInput, one_of};
use hil_sim::faults::ablation::SafetyFunction;
use hil_sim::faults::campaign::{run_all, run_case};
use hil_sim::faults::kind::{KINDS, Kind, LimitedBy};
use hil_sim::faults::outcome::Outcome;
use hil_sim::faults::report::{AblationSummary, Summary, report, report_ablation, report_case};
use hil_sim::faults::{Case, Hardware};
use hil_sim::output::{write_atomically, written_at};
use hil_sim::record::mcap::Origin;
use rayon::prelude::*;

/// Run the fault campaign: simulate one fault at a time in the closed loop, and check its bounds
///
/// The cases run through all kinds of fault; the size and moment of the fault, the lift, the hand
/// and the rig's values within their tolerances are drawn from the seed. docs/safety.md derives
/// the bounds. Writes report.html and faults.json, worst cases first. Ends with status 1 if a case
/// violates its bounds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim faults                                the whole campaign
  hil-sim faults --cases 2000 --seed 7 --json
  hil-sim faults --case 1139                    repeat one case, with a record as CSV and MCAP
  hil-sim faults --case 1139 --without SpeedTrip
  hil-sim faults --without-each --cases 6200    the need of each safety function")]
pub struct Args {
    #[command(flatten)]
    results: Results,
    /// Number of cases
    #[arg(long, default_value_t = 23_000,
        value_parser = whole(1, 10_000_000))]
    cases: u64,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 1, value_parser = whole(0, u64::MAX))]
    seed: u64,
    /// Run only this case, and write its record
    #[arg(long, value_name = "N", value_parser = whole(0, u64::MAX), conflicts_with = "cases")]
    case: Option<u64>,
    /// Switch this safety function off
    #[arg(long, value_name = "FUNCTION", value_parser = function)]
    without: Option<SafetyFunction>,
    /// Run the campaign once for each safety function, with that function switched off
    #[arg(long, conflicts_with_all = ["case", "without"])]
    without_each: bool,
}

fn function(name: &str) -> Result<SafetyFunction, String> {
    SafetyFunction::from_name(name).ok_or_else(|| {
        let names = SafetyFunction::ALL.map(SafetyFunction::name);
        format!("expected {}", one_of(&names, name))
    })
}

/// Number of cases of each kind that are repeated with protective hardware.
const WITH_HARDWARE: u64 = 40;

/// Runs the command; true if no case violates its bounds.
pub fn run(args: &Args) -> Result<bool, Failure> {
    super::note(format_args!("seed: {}", args.seed));
    let results = &args.results;
    super::check_folder(&results.out)?;
    if let Some(number) = args.case {
        return run_one(args, number);
    }
    if args.without_each {
        return without_each(args);
    }
    let outcomes = run_cases(args, args.without)?;
    let mut with_hardware = Vec::new();
    for kind in KINDS
        .iter()
        .filter(|kind| kind.limited_by != LimitedBy::Controller)
    {
        let outcomes = |hardware| run_with_hardware(args.seed, kind, hardware);
        let mut by_hardware = vec![(Hardware::None, outcomes(Hardware::None)?)];
        for hardware in Hardware::ALL {
            by_hardware.push((hardware, outcomes(hardware)?));
        }
        with_hardware.push((kind, by_hardware));
    }
    let summary = Summary::new(args.seed, outcomes, &with_hardware);
    let path = results.path("faults.json")?;
    let json = serde_json::to_vec_pretty(&summary).unwrap_or_default();
    write_atomically(&path, &json)?;
    let all_within = summary.violating == 0;
    results.finish(report(&summary), &summary.without_cases())?;
    super::note(format_args!("cases: {}", path.display()));
    Ok(all_within)
}

/// Runs all cases.
fn run_cases(args: &Args, without: Option<SafetyFunction>) -> Result<Vec<Outcome>, BadInput> {
    let progress = Progress::new("simulating", args.cases);
    let cases = (0..args.cases).into_par_iter();
    let cases = cases.map(|number| Case::new(args.seed, number));
    run_all(cases, without, || progress.step())
}

/// Runs the campaign without each safety function; true if each time a case violates a bound.
fn without_each(args: &Args) -> Result<bool, Failure> {
    let (mut summaries, mut all_needed) = (Vec::new(), true);
    for function in SafetyFunction::ALL {
        let outcomes = run_cases(args, Some(function))?;
        let summary = AblationSummary::new(function, &outcomes);
        all_needed &= summary.violating > 0 || function.needs_limb();
        summaries.push(summary);
    }
    let report = report_ablation(args.seed, &summaries);
    args.results.finish(report, &summaries)?;
    Ok(all_needed)
}

fn run_with_hardware(
    seed: u64,
    kind: &'static Kind,
    hardware: Hardware,
) -> Result<Vec<Outcome>, BadInput> {
    let cases = (0..WITH_HARDWARE).into_par_iter().map(|number| Case {
        hardware,
        ..Case::of(kind, seed, number)
    });
    run_all(cases, None, || {})
}

fn run_one(args: &Args, number: u64) -> Result<bool, Failure> {
    let case = Case::new(args.seed, number);
    let path = args.results.path(&format!("fault-{number}.csv"))?;
    let origin = Origin {
        rig: Some(format!("{REFERENCE_RIG}, fault of case {number}")),
        seed: Some(args.seed),
        started: written_at()?,
        ..Origin::default()
    };
    let mut recorder = Recorder::create(&path, &origin)?;
    let mut written = Ok(());
    let outcome = run_case(&case, args.without, |tick| {
        if written.is_ok() {
            written = recorder.push(&tick.row());
        }
    });
    let outcome = outcome?;
    written?;
    recorder.finish()?;
    args.results.print(&report_case(&outcome), &outcome)?;
    super::note(format_args!(
        "record: {}, and as MCAP beside it",
        path.display()
    ));
    Ok(outcome.violations.is_empty())
}

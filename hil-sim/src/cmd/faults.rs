//! `hil-sim faults`.

use super::Failure;
use super::{Common, Progress, print};
use hil_sim::bench::recorder::Recorder;
use hil_sim::error::BadInput;
use hil_sim::faults::ablation::SafetyFunction;
use hil_sim::faults::campaign::{run_all, run_case};
use hil_sim::faults::kind::{Decides, KINDS, Kind};
use hil_sim::faults::outcome::Outcome;
use hil_sim::faults::report::{Lacking, Summary, report, report_lacking};
use hil_sim::faults::{Case, Hardware};
use hil_sim::output::write_atomically;
use rayon::prelude::*;

/// The fault campaign: one fault at a time in the closed loop, and what becomes of the weight
///
/// Every kind of fault takes turns, with its size, its moment, the lift, the hand and the rig's
/// tolerances drawn from the seed. docs/safety.md derives the bounds. Writes report.html and
/// faults.json, worst cases first. Ends with status 1 if a case is outside its bounds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim faults                                the whole campaign
  hil-sim faults --cases 2000 --seed 7 --json
  hil-sim faults --case 1139                    one case again, its record as CSV and MCAP
  hil-sim faults --case 1139 --without SpeedTrip
  hil-sim faults --without-each --cases 6200    what each safety function is for")]
pub struct Args {
    /// Folder for the report and records, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: std::path::PathBuf,
    /// Print a machine-readable summary instead of words
    #[arg(long)]
    json: bool,
    /// How many cases
    #[arg(long, default_value_t = 23_000,
        value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    cases: u64,
    /// Seed of all that is drawn
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this case, with its record
    #[arg(long, value_name = "N", conflicts_with = "cases")]
    case: Option<u64>,
    /// Switch this safety function off
    #[arg(long, value_name = "FUNCTION", value_parser = function)]
    without: Option<SafetyFunction>,
    /// Switch each safety function off in turn, and say what becomes of the cases
    #[arg(long, conflicts_with_all = ["case", "without"])]
    without_each: bool,
}

fn function(name: &str) -> Result<SafetyFunction, String> {
    SafetyFunction::from_name(name).ok_or_else(|| {
        let names = SafetyFunction::ALL.map(SafetyFunction::name);
        format!("expected one of {}", names.join(", "))
    })
}

/// Cases of each kind that are run again with hardware.
const WITH_HARDWARE: u64 = 40;

/// Runs the command; true if every case is within its bounds.
pub fn run(args: &Args) -> Result<bool, Failure> {
    eprintln!("seed: {}", args.seed);
    let common = Common {
        out: args.out.clone(),
        json: args.json,
        ..Common::default()
    };
    if let Some(number) = args.case {
        return one(args, &common, number);
    }
    if args.without_each {
        return without_each(args, &common);
    }
    let outcomes = all(args, args.without)?;
    let mut with_hardware = Vec::new();
    for kind in KINDS
        .iter()
        .filter(|kind| kind.decides != Decides::Controller)
    {
        let of_kind = |hardware| again(args.seed, kind, hardware);
        let mut columns = vec![(Hardware::None, of_kind(Hardware::None)?)];
        for hardware in Hardware::ALL {
            columns.push((hardware, of_kind(hardware)?));
        }
        with_hardware.push((kind, columns));
    }
    let summary = Summary::new(args.seed, outcomes, &with_hardware);
    let path = common.path("faults.json")?;
    let json = serde_json::to_vec_pretty(&summary).unwrap_or_default();
    write_atomically(&path, &json)?;
    let all_within = summary.outside == 0;
    common.finish(report(&summary), &summary.without_cases())?;
    eprintln!("cases: {}", path.display());
    Ok(all_within)
}

/// Every case.
fn all(args: &Args, without: Option<SafetyFunction>) -> Result<Vec<Outcome>, BadInput> {
    let progress = Progress::new("breaking", args.cases);
    let cases = (0..args.cases).into_par_iter();
    let cases = cases.map(|number| Case::new(args.seed, number));
    run_all(cases, without, || progress.step())
}

/// True if the campaign notices that any of them is gone.
fn without_each(args: &Args, common: &Common) -> Result<bool, Failure> {
    let mut lacking = Vec::new();
    for function in SafetyFunction::ALL {
        lacking.push(Lacking::new(function, &all(args, Some(function))?));
    }
    let all_noticed = lacking.iter().all(|lacking| lacking.outside > 0);
    common.finish(report_lacking(args.seed, &lacking), &lacking)?;
    Ok(all_noticed)
}

fn again(seed: u64, kind: &'static Kind, hardware: Hardware) -> Result<Vec<Outcome>, BadInput> {
    let cases = (0..WITH_HARDWARE).into_par_iter().map(|number| Case {
        hardware,
        ..Case::of(kind, seed, number)
    });
    run_all(cases, None, || {})
}

fn one(args: &Args, common: &Common, number: u64) -> Result<bool, Failure> {
    let case = Case::new(args.seed, number);
    let path = common.path(&format!("fault-{number}.csv"))?;
    let mut recorder = Recorder::create(&path)?;
    let mut written = Ok(());
    let outcome = run_case(&case, args.without, |tick| {
        if written.is_ok() {
            written = recorder.push(&tick.row());
        }
    });
    let outcome = outcome?;
    written?;
    recorder.finish()?;
    // A plain struct of numbers and words.
    print(&(serde_json::to_string_pretty(&outcome).unwrap_or_default() + "\n"))?;
    eprintln!("record: {}, and as MCAP beside it", path.display());
    Ok(outcome.outside.is_empty())
}

//! `hil-sim run`.

use super::Failure;
use super::{Common, Progress, between};
use hil_sim::bench::assist_run::{AssistRun, assist, assist_plots, tracking_table};
use hil_sim::bench::closed_loop::Run;
use hil_sim::bench::person::{CHECKED_S, Finger};
use hil_sim::bench::tick::TICK_S;
use hil_sim::bench::tick::record;
use hil_sim::bench::tracking::Tracking;
use hil_sim::error::BadInput;
use hil_sim::output::same_file;
use hil_sim::paper::both_valves;
use hil_sim::record::FINGER_M;
use hil_sim::report::{Report, Section};
use hil_sim::rig::Rig;
use model_core::controller::Controller;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Run the assist experiment: a finger lifts, holds and lowers the weight through the muscle
///
/// Without --rig it runs the paper's Fig 8, with valve A and with valve B.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim run
  hil-sim run --rig rig.toml --travel 0.08 --rise 0.6 --duration 12
  hil-sim run --finger measured.csv --arm-stiffness 500")]
pub struct Args {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    scenario: Scenario,
}

/// The motion of the hand, the person's arm and the noise.
#[derive(clap::Args)]
pub struct Scenario {
    /// A record whose column `finger_m` is the motion of the finger, instead of the parameters
    /// below
    #[arg(long, value_name = "REC.csv", conflicts_with_all = ["travel", "rise", "hold", "lower"])]
    finger: Option<PathBuf>,
    /// Travel of the finger [m]
    #[arg(
        long,
        default_value_t = 0.12,
        value_parser = between(-1.0, 1.0),
        allow_negative_numbers = true
    )]
    travel: f64,
    /// Duration of the lift [s]
    #[arg(long, default_value_t = 1.0, value_parser = between(0.0, 1e3))]
    rise: f64,
    /// Duration of the hold [s]
    #[arg(long, default_value_t = 4.0, value_parser = between(0.0, 1e3))]
    hold: f64,
    /// Duration of the lowering [s]
    #[arg(long, default_value_t = 1.5, value_parser = between(0.0, 1e3))]
    lower: f64,
    /// Duration [s]; until the end of the finger's motion if omitted
    #[arg(long, value_parser = between(TICK_S, DURATION_S_MAX))]
    duration: Option<f64>,
    /// Stiffness of the person's arm [N/m]; infinite if omitted
    #[arg(long, value_parser = between(0.0, 1e5))]
    arm_stiffness: Option<f64>,
    /// Time from sampling to the valve [s], within one tick
    #[arg(
        long,
        default_value_t = Run::PAPER.output_delay_s,
        value_parser = between(0.0, TICK_S)
    )]
    output_delay: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = Run::PAPER.seed, value_parser = super::whole(0, u64::MAX))]
    pub seed: u64,
}

/// The longest run \[s\].
const DURATION_S_MAX: f64 = 1e3;

#[derive(Serialize)]
struct Summary {
    seed: u64,
    runs: Vec<RunSummary>,
}

#[derive(Serialize)]
struct RunSummary {
    name: String,
    tracking: Tracking,
    /// The controller's mode at the end.
    mode: Option<String>,
    /// The latched fault.
    fault: Option<String>,
    record: String,
}

impl Scenario {
    /// The run that the arguments define.
    pub fn experiment(&self) -> Result<Run, BadInput> {
        let (finger, ends_s) = match &self.finger {
            None => {
                let finger = Finger::Lift {
                    start_s: CHECKED_S,
                    travel_m: self.travel,
                    rise_s: self.rise.max(TICK_S),
                    hold_s: self.hold,
                    lower_s: self.lower.max(TICK_S),
                };
                (finger, CHECKED_S + self.rise + self.hold + self.lower + 1.0)
            }
            Some(path) => {
                let recorded = super::read_record(path, None)?;
                let path = recorded.require(FINGER_M)?.iter().zip(recorded.time_s());
                let present = path.filter(|(finger_m, _)| !finger_m.is_nan());
                let (finger_m, time_s): (Vec<f64>, Vec<f64>) = present.unzip();
                let finger = Finger::recorded(&time_s, finger_m);
                let ends_s = finger.followed_s().end;
                if ends_s > DURATION_S_MAX && self.duration.is_none() {
                    let expected =
                        format!("a path of at most {DURATION_S_MAX} s, or --duration, found more");
                    return Err(recorded.bad(FINGER_M, &expected));
                }
                (finger, ends_s)
            }
        };
        Ok(Run {
            finger,
            arm_stiffness_n_per_m: self.arm_stiffness.unwrap_or(f64::INFINITY),
            duration_s: self.duration.unwrap_or(ends_s),
            output_delay_s: self.output_delay,
            seed: self.seed,
            ..Run::PAPER
        })
    }

    /// Refuses to overwrite the finger's record with an output at `path`.
    pub fn refuse_overwriting(&self, path: &Path) -> Result<(), BadInput> {
        match &self.finger {
            Some(finger) if same_file(finger, path) => {
                let expected = "another --out, as the finger's record would be overwritten";
                Err(BadInput::file(path.display().to_string(), expected))
            }
            _ => Ok(()),
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let common = &args.common;
    let rig = common.rig()?;
    let experiment = args.scenario.experiment()?;
    let runs = runs(args, &rig, &experiment)?;
    super::note(format_args!("seed: {}", args.scenario.seed));
    let mut summary = Summary {
        seed: args.scenario.seed,
        runs: Vec::new(),
    };
    for run in &runs {
        let path = common.results.record_path(&run.name)?;
        args.scenario.refuse_overwriting(&path)?;
        record(&run.settings, &run.ticks).write(&path)?;
        summary.runs.push(RunSummary {
            name: run.name.clone(),
            tracking: run.tracking,
            mode: run.ticks.last().map(|tick| tick.output.mode.name().into()),
            fault: run.fault(),
            record: path.display().to_string(),
        });
    }
    let report = Report {
        title: "The assist experiment".into(),
        verdict: runs.iter().map(AssistRun::verdict).collect(),
        sections: vec![Section {
            heading: "Runs".into(),
            text: vec!["The runs use the controller that is flashed to the board.".into()],
            tables: vec![tracking_table(&runs)],
            plots: assist_plots(&runs),
            ..Section::default()
        }],
        repeat: Vec::new(),
    };
    common.results.finish(report, &summary)
}

/// Both of the paper's valves, or the rig's.
fn runs(args: &Args, rig: &Rig, experiment: &Run) -> Result<Vec<AssistRun>, BadInput> {
    let both = args.common.is_reference();
    let valves = if both { 2.0 } else { 1.0 };
    let ticks = (valves * experiment.duration_s / TICK_S) as u64;
    let progress = Progress::new("running", ticks);
    let tick_done = || progress.step();
    if both {
        both_valves(rig, experiment, Controller::new, &tick_done)
    } else {
        Ok(vec![assist(
            "assist",
            rig,
            experiment,
            Controller::new,
            &tick_done,
        )?])
    }
}

//! The `hil-sim` command: results on stdout, everything else on stderr.
//!
//! Exit status 0: it ran. 1: a case of the fault campaign is out of its bounds, or a board no
//! longer answers. 2: bad input, or a place that cannot be written, in one line that says where.

mod cmd;

use clap::{Parser, Subcommand};
use cmd::Failure;
use std::process::ExitCode;

/// Simulates a pneumatic-muscle power assist with the controller that runs on its board.
///
/// Without a command it runs the paper's experiments and writes out/report.html.
#[derive(Parser)]
#[command(version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

const EXAMPLES: &str = "\
Examples:
  hil-sim                                          the paper, ours beside it
  hil-sim run --arm-stiffness 500 --seed 7         the assist experiment, other hands
  hil-sim hil                                      the same with the firmware on an emulated board
  hil-sim rig new my-rig.toml                      a commented rig file to edit
  hil-sim design --rig my-rig.toml                 which valve must I buy?
  hil-sim simulate --rig my-rig.toml --drive measured.csv --out sim.csv";

#[derive(Subcommand)]
enum Command {
    /// The assist experiment: a finger lifts and holds the weight through the muscle
    Run(cmd::run::Args),
    /// The assist experiment with the controller on a board, real or emulated
    Hil(cmd::hil::Args),
    /// Record what a board tells of each tick
    Record(cmd::record::Args),
    /// Run a record's inputs through the controller again, and compare
    Replay(cmd::replay::Args),
    /// One fault at a time in the closed loop, and what becomes of the weight
    Faults(cmd::faults::Args),
    /// The paper's figures and numbers, ours beside what it says
    Paper(cmd::paper::Args),
    /// The flow gain a valve must have, and how stiff the input may be
    Design(cmd::design::Args),
    /// Is a record fit for a diagnosis?
    Check(cmd::check::Args),
    /// Make a record of a CSV or MATLAB file with other names and units
    Import(cmd::import::Args),
    /// Write the reference pressure of the next experiment
    Experiment(cmd::experiment::Args),
    /// Run the plant from a record's inputs alone
    Simulate(cmd::simulate::Args),
    /// Find where simulation and measurement disagree, and name the missing effect
    Diagnose(cmd::diagnose::Args),
    /// Turn a fitted rig into the controller's settings, proved in the closed loop
    Compensate(cmd::compensate::Args),
    /// Read a board's settings, or store others on it
    Settings(cmd::settings::Args),
    /// Rig files
    Rig(cmd::rig::Args),
    /// Shell completions
    Completions(cmd::completions::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        None => cmd::paper::run(&cmd::paper::Args::default()),
        Some(Command::Run(args)) => cmd::run::run(&args),
        Some(Command::Hil(args)) => cmd::hil::run(&args),
        Some(Command::Record(args)) => cmd::record::run(&args),
        Some(Command::Replay(args)) => cmd::replay::run(&args),
        Some(Command::Faults(args)) => match cmd::faults::run(&args) {
            Ok(false) => return ExitCode::FAILURE,
            ran => ran.map(drop),
        },
        Some(Command::Paper(args)) => cmd::paper::run(&args),
        Some(Command::Design(args)) => cmd::design::run(&args),
        Some(Command::Check(args)) => cmd::check::run(&args),
        Some(Command::Import(args)) => cmd::import::run(&args),
        Some(Command::Experiment(args)) => cmd::experiment::run(&args),
        Some(Command::Simulate(args)) => cmd::simulate::run(&args),
        Some(Command::Diagnose(args)) => cmd::diagnose::run(&args),
        Some(Command::Compensate(args)) => cmd::compensate::run(&args),
        Some(Command::Settings(args)) => cmd::settings::run(&args),
        Some(Command::Rig(args)) => cmd::rig::run(&args),
        Some(Command::Completions(args)) => cmd::completions::run::<Cli>(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("hil-sim: {failure}");
            // Status 1: a board that stopped answering is not bad input.
            ExitCode::from(if matches!(failure, Failure::Link(_)) {
                1
            } else {
                2
            })
        }
    }
}

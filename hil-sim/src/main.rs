//! The `hil-sim` command: results on stdout, everything else on stderr.
//!
//! Exit status 0: success. 1: a case of the fault campaign violates its bounds, or a board does not
//! respond. 2: bad input, or a file that cannot be written, reported in one line.

mod cmd;

use clap::{Parser, Subcommand};
use cmd::Failure;
use muscle_plant::effects::Catalogue;
use std::process::ExitCode;

/// Simulates a pneumatic-muscle power assist with the controller that runs on its board.
///
/// Without a command it runs the paper's experiments and writes out/report.html.
#[derive(Parser)]
#[command(version, args_conflicts_with_subcommands = true, after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    paper: cmd::paper::Args,
    #[command(subcommand)]
    command: Option<Command>,
}

const EXAMPLES: &str = "\
Examples:
  hil-sim                                          compare with the paper
  hil-sim run --arm-stiffness 500 --seed 7         the assist experiment with another person
  hil-sim hil                                      the same with the firmware on an emulated board
  hil-sim rig new my-rig.toml                      a commented rig file to edit
  hil-sim design --rig my-rig.toml                 required flow gain of the valve
  hil-sim simulate --rig my-rig.toml --drive measured.csv --out sim.csv";

#[derive(Subcommand)]
enum Command {
    /// Run the assist experiment: a finger lifts, holds and lowers the weight through the muscle
    Run(cmd::run::Args),
    /// Run the assist experiment with the controller on a board, real or emulated
    Hil(cmd::hil::Args),
    /// Record the telemetry of a board
    Record(cmd::record::Args),
    /// Repeat a record's inputs with the controller, and compare its outputs
    Replay(cmd::replay::Args),
    /// Run the fault campaign: simulate one fault at a time, and check its bounds
    Faults(cmd::faults::Args),
    /// Compare the simulation with the paper's figures and numbers
    Paper(cmd::paper::Args),
    /// Compute the required flow gain of the valve, and the permitted stiffness of the input
    Design(cmd::design::Args),
    /// Check whether a record is suitable for a diagnosis
    Check(cmd::check::Args),
    /// Convert a CSV or MATLAB file with other names and units into a record
    Import(cmd::import::Args),
    /// Write the test signal of the next experiment
    Experiment(cmd::experiment::Args),
    /// Simulate the plant with the inputs of a record
    Simulate(cmd::simulate::Args),
    /// Find where simulation and measurement disagree, and which effect the simulation lacks
    Diagnose(cmd::diagnose::Args),
    /// Derive the controller's compensation from a fitted rig, and test it in the closed loop
    Compensate(cmd::compensate::Args),
    /// Read the settings of a board, or store new ones on it
    Settings(cmd::settings::Args),
    /// List the effects that a rig may have, or show one
    Effects(cmd::effects::Args),
    /// Create and check rig files
    Rig(cmd::rig::Args),
    /// Print shell completions
    Completions(cmd::completions::Args),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match cli.command {
        None => cmd::paper::run(&cli.paper),
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
        Some(Command::Effects(args)) => cmd::effects::run(&args, &Catalogue::standard()),
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

//! The `hil-sim` command: results on stdout, everything else on stderr.
//!
//! Exit status 0: success. 1: a case of the fault campaign violates its bounds, a commissioning
//! ended early, or a board does not respond. 2: bad input, or a file that cannot be written,
//! reported in one line. 130: interrupted.

mod cmd;

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand};
use cmd::Failure;
use std::io::IsTerminal;
use std::process::ExitCode;

/// Simulates a pneumatic-muscle power assist with the controller that runs on its board.
///
/// Without a command it runs the paper's experiments and writes out/report.html.
#[derive(Parser)]
#[command(version, after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    paper: cmd::paper::Args,
    /// Print results and errors only: no progress, no names of written files
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Take numbers that cannot be in the units that their names say, with a warning
    #[arg(long, global = true)]
    accept: bool,
    /// Colour help and errors
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto")]
    color: ColorChoice,
    #[command(subcommand)]
    command: Option<Command>,
}

/// Of a command that has commands of its own: its help is the answer.
const MISSING_SUBCOMMAND: ErrorKind = ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;

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
    /// Convert a CSV, xlsx, MATLAB, HDF5 or MCAP file into a record
    Import(cmd::import::Args),
    /// Write the test signal of the next experiment
    Experiment(cmd::experiment::Args),
    /// Simulate the plant with the inputs of a record
    Simulate(cmd::simulate::Args),
    /// Write a rig as an FMU, for other simulators
    #[cfg(feature = "formats")]
    Export(cmd::export::Args),
    /// Find where simulation and measurement disagree, and which effect the simulation lacks
    Diagnose(cmd::diagnose::Args),
    /// Compare two diagnoses: verdicts, effects with their intervals, and gaps by signal
    Compare(cmd::compare::Args),
    /// Derive the controller's compensation from a fitted rig, and test it in the closed loop
    Compensate(cmd::compensate::Args),
    /// Lead through the first use of a board on its rig: wiring, scales, valve, first lift
    Commission(cmd::commission::Args),
    /// Read the settings of a board, or store new ones on it
    Settings(cmd::settings::Args),
    /// List the effects that a rig may have, or show one
    Effects(cmd::effects::Args),
    /// Create and check rig files
    Rig(cmd::rig::Args),
    /// Print shell completions, or write them and the man pages to a folder
    Completions(cmd::completions::Args),
}

/// What the arguments say of colours, before clap has parsed them: its errors are coloured, too.
fn color(arguments: impl Iterator<Item = String>) -> ColorChoice {
    let words: Vec<_> = arguments.collect();
    let after = words.iter().zip(words.iter().skip(1));
    let apart = after.filter_map(|(option, when)| (option == "--color").then_some(when.as_str()));
    let joined = words
        .iter()
        .filter_map(|word| word.strip_prefix("--color="));
    match apart.chain(joined).last() {
        Some("always") => ColorChoice::Always,
        Some("never") => ColorChoice::Never,
        _ => ColorChoice::Auto,
    }
}

/// Options of `paper` do not act on another command. clap's own conflict of options and commands
/// would refuse the global ones, too.
fn refuse_options_before_a_command(
    command: &mut clap::Command,
    matches: &clap::ArgMatches,
) -> Result<(), clap::Error> {
    let Some(name) = matches.subcommand_name() else {
        return Ok(());
    };
    let given = |argument: &&clap::Arg| {
        let id = argument.get_id().as_str();
        !argument.is_global_set() && matches.value_source(id) == Some(ValueSource::CommandLine)
    };
    let first = command.get_arguments().find(given).map(ToString::to_string);
    first.map_or(Ok(()), |option| {
        let what = format!("the option '{option}' stands before the command: `hil-sim {name} …`");
        Err(command.error(ErrorKind::ArgumentConflict, what))
    })
}

/// The arguments.
fn parse(color: ColorChoice) -> Result<Cli, clap::Error> {
    // `--duration -3` is a number out of range and no unknown option.
    let mut command = Cli::command().color(color);
    let names: Vec<_> = command
        .get_subcommands()
        .map(|one| one.get_name().to_owned())
        .collect();
    for name in names {
        command = command.mut_subcommand(name, |one| one.allow_negative_numbers(true));
    }
    let matches = command.try_get_matches_from_mut(std::env::args_os())?;
    refuse_options_before_a_command(&mut command, &matches)?;
    Cli::from_arg_matches(&matches)
}

/// What is wrong with the arguments, in one line: what clap says, and where it shows the usage the
/// command whose help has it.
fn in_one_line(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let (mut told, mut help) = (Vec::new(), String::new());
    for part in text.split("\n\n") {
        let words: Vec<_> = part.split_whitespace().collect();
        match words.first() {
            Some(&"Usage:") => {
                let names = words[1..]
                    .iter()
                    .take_while(|word| !word.starts_with(['-', '<', '[']));
                let command = names.copied().collect::<Vec<_>>().join(" ");
                help = format!(" (`{command} --help`)");
            }
            None | Some(&"For") => {}
            Some(_) => told.push(words.join(" ")),
        }
    }
    let told = told.join("; ");
    told.strip_prefix("error: ").unwrap_or(&told).to_owned() + &help
}

/// Prints a failure to stderr.
fn print_failure(failure: &impl std::fmt::Display, color: ColorChoice) {
    let on_terminal = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let red = match color {
        ColorChoice::Always => true,
        ColorChoice::Auto => on_terminal,
        ColorChoice::Never => false,
    };
    if red {
        eprintln!("\x1b[1;31mhil-sim:\x1b[0m {failure}");
    } else {
        eprintln!("hil-sim: {failure}");
    }
}

fn main() -> ExitCode {
    let color = color(std::env::args_os().map(|word| word.to_string_lossy().into_owned()));
    let cli = match parse(color) {
        Ok(cli) => cli,
        // Help and version are no errors, nor is a command without its subcommand.
        Err(error) if !error.use_stderr() => error.exit(),
        Err(error) if error.kind() == MISSING_SUBCOMMAND => error.exit(),
        Err(error) => {
            print_failure(&in_one_line(&error), color);
            return ExitCode::from(2);
        }
    };
    cmd::set_quiet(cli.quiet);
    cmd::set_accept(cli.accept);
    #[cfg(feature = "terminal")]
    cmd::interrupt::handle();
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
        Some(Command::Commission(args)) => match cmd::commission::run(&args) {
            Ok(false) => return ExitCode::FAILURE,
            ran => ran.map(drop),
        },
        Some(Command::Paper(args)) => cmd::paper::run(&args),
        Some(Command::Design(args)) => cmd::design::run(&args),
        Some(Command::Check(args)) => cmd::check::run(&args),
        Some(Command::Import(args)) => cmd::import::run(&args),
        Some(Command::Experiment(args)) => cmd::experiment::run(&args),
        Some(Command::Simulate(args)) => cmd::simulate::run(&args),
        #[cfg(feature = "formats")]
        Some(Command::Export(args)) => cmd::export::run(&args),
        Some(Command::Diagnose(args)) => cmd::diagnose::run(&args),
        Some(Command::Compare(args)) => cmd::compare::run(&args),
        Some(Command::Compensate(args)) => cmd::compensate::run(&args),
        Some(Command::Settings(args)) => cmd::settings::run(&args),
        Some(Command::Effects(args)) => cmd::effects::run(&args),
        Some(Command::Rig(args)) => cmd::rig::run(&args),
        Some(Command::Completions(args)) => cmd::completions::run::<Cli>(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            print_failure(&failure, cli.color);
            // Status 1: a board that stopped answering is not bad input.
            ExitCode::from(if matches!(failure, Failure::Link(_)) {
                1
            } else {
                2
            })
        }
    }
}

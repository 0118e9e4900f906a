//! Scores `hil-sim diagnose` on hidden effects: results on stdout, everything else on stderr.
//!
//! Exit status 0: scored. 1: scored, and `--check` found a figure outside its required range. 2:
//! not scored because of an error.

use clap::{Args, Parser, Subcommand};
use hil_sim::bench::test_signal::Part;
use hil_sim::output::write_atomically;
use hil_sim::report::Report;
use scorer::answer::Kind;
use scorer::compare::{Method, markdown};
use scorer::figures::Score;
use scorer::report::{Origin, full, summary};
use scorer::run::{Collected, Error, Selection, Tool, collect_all, program_crc32, run};
use scorer::scored::Scored;
use scorer::{shuffled, without};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use truth::Family;

/// Measures how well `hil-sim diagnose` finds hidden effects in simulated rigs that it does not
/// know
#[derive(Parser)]
#[command(version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// Where `cargo build --release` puts the program that is measured.
const PROGRAM: &str = "target/release/hil-sim";

const EXAMPLES: &str = "\
Examples:
  score run --seed 7 --count 200                 the whole benchmark
  score run --seed 1 --count 10 --check          a small subset, for CI
  score run --kind none --count 100              one kind, for a sharp figure
  score run --effect leak --count 9 -- --threads 1
  score run --diagnose ./my-method --simulate target/release/hil-sim --count 20
  score report                                   the cases already run, scored again
  score compare out/calibration out/mine         a table of methods, as Markdown
  score shuffled                                 what chance would reach
  score without leak creep --count 3             effects taken out of the catalogue
  score without leak --experiment shut-holds     the same, after the experiment that is advised";

#[derive(Subcommand)]
enum Command {
    /// Run the tool on cases and score it
    Run(RunArgs),
    /// Score what has been run, without running anything
    Report(ReportArgs),
    /// Print a Markdown table of methods that were run on the same cases
    Compare(CompareArgs),
    /// Ablation: answers permuted among the cases that have been run
    Shuffled(ShuffledArgs),
    /// Ablation: the tool without an effect, on that effect's own cases
    Without(WithoutArgs),
}

#[derive(Args)]
struct ToolArgs {
    /// The program whose `diagnose` is measured
    #[arg(long, value_name = "PATH", default_value = PROGRAM)]
    diagnose: PathBuf,
    /// The program whose `simulate` tells what a fitted rig predicts; that of --diagnose if omitted
    #[arg(long, value_name = "PATH")]
    simulate: Option<PathBuf>,
    /// Cases at a time
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Longest that a diagnosis may take, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 120)]
    time_limit_s: u64,
    /// Run cases again that have been run before
    #[arg(long)]
    again: bool,
    /// Give it one record more to fit, of this part of its own experiment; may be given more than
    /// once
    #[arg(long, value_enum)]
    experiment: Vec<Part>,
    /// More arguments for `diagnose`
    #[arg(last = true, value_name = "ARGUMENTS")]
    arguments: Vec<String>,
}

impl ToolArgs {
    /// The arguments that name the programs, unless they are the usual ones.
    fn programs(&self) -> String {
        let mut arguments = String::new();
        if self.diagnose != Path::new(PROGRAM) {
            arguments += &format!(" --diagnose {}", self.diagnose.display());
        }
        if let Some(simulate) = &self.simulate {
            arguments += &format!(" --simulate {}", simulate.display());
        }
        arguments
    }

    fn tool(&self) -> Tool {
        Tool {
            program: self.diagnose.clone(),
            simulator: self.simulate.as_ref().unwrap_or(&self.diagnose).clone(),
            arguments: self.arguments.clone(),
            experiment: self.experiment.clone(),
            limit: Duration::from_secs(self.time_limit_s),
            jobs: self.jobs,
            again: self.again,
        }
    }
}

#[derive(Args)]
struct RunArgs {
    /// How the laws of effects are made
    #[arg(long, value_enum, default_value_t = Family::Drawn)]
    family: Family,
    /// Seed of all cases; of drawn ones, 10000 and above are the reporting set
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How many cases
    #[arg(long, default_value_t = 200)]
    count: usize,
    /// Number of the first case that may be taken
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Only this kind of cases; may be given more than once
    #[arg(long)]
    kind: Vec<Kind>,
    /// Only cases that hide this effect; may be given more than once
    #[arg(long, value_name = "NAME")]
    effect: Vec<String>,
    /// Only cases whose records have at most so many rows each
    #[arg(long, value_name = "ROWS")]
    max_rows: Option<usize>,
    /// Folder of the cases and the score
    #[arg(long, value_name = "DIR", default_value = "out/score")]
    out: PathBuf,
    /// Exit with status 1 if a figure is not reached
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    tool: ToolArgs,
}

#[derive(Args)]
struct ReportArgs {
    /// Folder of the cases and the score
    #[arg(long, value_name = "DIR", default_value = "out/score")]
    out: PathBuf,
    /// Exit with status 1 if a figure is not reached
    #[arg(long)]
    check: bool,
}

#[derive(Args)]
struct CompareArgs {
    /// Folders of the methods' cases, each with its method's name
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
}

#[derive(Args)]
struct ShuffledArgs {
    /// Folder of the cases
    #[arg(long, value_name = "DIR", default_value = "out/score")]
    out: PathBuf,
    /// How often the answers are permuted
    #[arg(long, default_value_t = 1000)]
    permutations: usize,
    /// Seed of the permutations
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Args)]
struct WithoutArgs {
    /// Effects to take out, each in turn; all if none is named
    names: Vec<String>,
    /// How the laws of effects are made
    #[arg(long, value_enum, default_value_t = Family::Drawn)]
    family: Family,
    /// Seed of all cases; of drawn ones, 10000 and above are the reporting set
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Cases of each effect
    #[arg(long, default_value_t = 3)]
    count: usize,
    /// Number of the first case that may be taken
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Folder of the cases and the score
    #[arg(long, value_name = "DIR", default_value = "out/score-without")]
    out: PathBuf,
    #[command(flatten)]
    tool: ToolArgs,
}

fn command_line() -> String {
    std::env::args().collect::<Vec<_>>().join(" ")
}

/// Writes `name.json` and `name.html`.
fn write(out: &Path, name: &str, value: &impl Serialize, html: &Report) -> Result<(), Error> {
    // plain structs of numbers and words always have a JSON form
    let json = serde_json::to_string_pretty(value).unwrap_or_default();
    write_atomically(
        &out.join(format!("{name}.json")),
        format!("{json}\n").as_bytes(),
    )?;
    write_atomically(&out.join(format!("{name}.html")), html.to_html().as_bytes())?;
    Ok(())
}

/// Scores cases; true if all is reached.
fn score(
    cases: &[Collected],
    out: &Path,
    programs: String,
    mut warnings: Vec<String>,
) -> Result<bool, Error> {
    let builds: BTreeSet<u32> = cases.iter().map(|case| case.run.program_crc32).collect();
    if builds.len() > 1 {
        let count = builds.len();
        warnings.push(format!(
            "Warning: the cases were run by {count} builds of the program."
        ));
    }
    let score = Score::of(cases.iter().map(Scored::new).collect());
    let origin = Origin {
        command: command_line(),
        out: out.display().to_string(),
        programs,
        warnings,
    };
    write(out, "score", &score, &full(&score, &origin))?;
    print!("{}", summary(&score, &origin).to_text());
    eprintln!("{}", out.join("score.html").display());
    Ok(score.reached())
}

/// The seed, and of drawn cases the set that it belongs to.
fn say_seed(family: Family, seed: u64) {
    match family {
        Family::Drawn => eprintln!("seed {seed}, {} set", truth::drawn::set(seed)),
        Family::CatalogueLike => eprintln!("seed {seed}"),
    }
}

fn run_and_score(args: &RunArgs) -> Result<bool, Error> {
    say_seed(args.family, args.seed);
    let selection = Selection {
        family: args.family,
        seed: args.seed,
        first: args.first,
        count: args.count,
        kinds: args.kind.clone(),
        effects: args.effect.clone(),
        max_rows: args.max_rows,
    };
    let cases = run(&args.out, &selection, &args.tool.tool())?;
    let crc32 = program_crc32(&args.tool.diagnose)?;
    let stale = cases
        .iter()
        .filter(|case| case.run.program_crc32 != crc32)
        .count();
    let mut warnings = Vec::new();
    if stale > 0 {
        warnings.push(format!(
            "Warning: {stale} cases were run by another build of the program; --again renews them."
        ));
    }
    let reached = score(&cases, &args.out, args.tool.programs(), warnings)?;
    Ok(reached || !args.check)
}

fn report(args: &ReportArgs) -> Result<bool, Error> {
    let cases = collect_all(&args.out)?;
    Ok(score(&cases, &args.out, String::new(), Vec::new())? || !args.check)
}

fn compare(args: &CompareArgs) -> Result<bool, Error> {
    let method = |folder: &PathBuf| {
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        let cases = collect_all(folder)?;
        Ok(Method::new(name.to_string_lossy().into_owned(), &cases))
    };
    let methods: Result<Vec<Method>, Error> = args.folders.iter().map(method).collect();
    print!("{}", markdown(&methods?)?);
    Ok(true)
}

fn shuffle(args: &ShuffledArgs) -> Result<bool, Error> {
    eprintln!("seed {}", args.seed);
    let cases = collect_all(&args.out)?;
    let chances = shuffled::shuffled(&cases, args.permutations, args.seed);
    let report = shuffled::report(&chances, args.permutations, &command_line());
    write(&args.out, "shuffled", &chances, &report)?;
    print!("{}", report.to_text());
    Ok(true)
}

fn take_out(args: &WithoutArgs) -> Result<bool, Error> {
    say_seed(args.family, args.seed);
    let names: Vec<&str> = match args.names.as_slice() {
        [] => without::listed(args.family),
        names => names.iter().map(String::as_str).collect(),
    };
    let tool = args.tool.tool();
    let mut parts = Vec::new();
    for (i, name) in names.iter().enumerate() {
        eprintln!("without {name} ({} of {})", i + 1, names.len());
        let seeds = [args.seed, args.first];
        let part = without::without(&args.out, name, args.family, seeds, args.count, &tool)?;
        parts.push(part);
    }
    let report = without::report(&parts, &command_line());
    write(&args.out, "without", &parts, &report)?;
    print!("{}", report.to_text());
    Ok(true)
}

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Run(args) => run_and_score(&args),
        Command::Report(args) => report(&args),
        Command::Compare(args) => compare(&args),
        Command::Shuffled(args) => shuffle(&args),
        Command::Without(args) => take_out(&args),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("score: {error}");
            ExitCode::from(2)
        }
    }
}

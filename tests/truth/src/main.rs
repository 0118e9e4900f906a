//! Writes cases to a directory: `cases/<id>/` for the tool, `answers/<id>.json` for the scorer.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand, ValueEnum};
use rayon::prelude::*;
use truth::{CATALOGUE, Case, Kind, Plan};

#[derive(Parser)]
#[command(about, version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Directory to write to
    #[arg(long, value_name = "DIR", required = true)]
    out: Option<PathBuf>,
    /// Seed of all cases
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Which kind of cases
    #[arg(long, value_enum, default_value_t = Cases::All)]
    cases: Cases,
    /// How many cases
    #[arg(long, default_value_t = 10)]
    count: usize,
    /// Number of the first case that may be written
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Only cases that hide this effect
    #[arg(long)]
    effect: Option<String>,
    /// Only cases that hide an effect in this form
    #[arg(long)]
    form: Option<String>,
}

#[derive(Subcommand)]
enum Command {
    /// Prints the effects and their forms
    List,
}

#[derive(Clone, Copy, ValueEnum)]
enum Cases {
    All,
    Single,
    Pair,
    None,
    Unlisted,
}

impl Cases {
    fn has(self, kind: Kind) -> bool {
        match self {
            Cases::All => true,
            Cases::Single => kind == Kind::Single,
            Cases::Pair => kind == Kind::Pair,
            Cases::None => kind == Kind::None,
            Cases::Unlisted => kind == Kind::Unlisted,
        }
    }
}

impl Arguments {
    fn wants(&self, plan: &Plan) -> bool {
        let named = self.effect.is_none() && self.form.is_none();
        let hides = plan.effects.iter().any(|planned| {
            self.effect
                .as_deref()
                .is_none_or(|name| name == planned.entry.name)
                && self
                    .form
                    .as_deref()
                    .is_none_or(|name| name == planned.form.name)
        });
        self.cases.has(plan.kind) && (named || hides)
    }
}

fn list() {
    for entry in CATALOGUE {
        let forms: Vec<&str> = entry.forms.iter().map(|form| form.name).collect();
        let kind = if entry.listed { "listed" } else { "unlisted" };
        println!(
            "{kind:9} {:13} {:26} {}",
            entry.place,
            entry.name,
            forms.join(", ")
        );
    }
}

fn write(out: &Path, case: &Case) -> io::Result<()> {
    let folder = out.join("cases").join(&case.id);
    fs::create_dir_all(&folder)?;
    fs::write(folder.join("rig.toml"), &case.rig_toml)?;
    for (name, records) in [
        ("fit", &case.fit),
        ("validate", &case.validate),
        ("unseen", &case.unseen),
    ] {
        for (i, text) in records.iter().enumerate() {
            fs::write(folder.join(format!("{name}-{}.csv", i + 1)), text)?;
        }
    }
    let answer = format!("{:#}\n", case.answer);
    fs::write(
        out.join("answers").join(format!("{}.json", case.id)),
        answer,
    )
}

fn write_all(arguments: &Arguments, out: &Path) -> io::Result<usize> {
    println!("seed {}", arguments.seed);
    fs::create_dir_all(out.join("answers"))?;
    // a filter that nothing passes must not search for ever
    let numbers: Vec<u64> = (arguments.first..arguments.first + 100_000)
        .filter(|index| arguments.wants(&truth::plan(arguments.seed, *index)))
        .take(arguments.count)
        .collect();
    numbers
        .par_iter()
        .map(|index| write(out, &truth::case(arguments.seed, *index)))
        .collect::<io::Result<Vec<()>>>()?;
    Ok(numbers.len())
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (None, Some(out)) = (&arguments.command, &arguments.out) else {
        list();
        return ExitCode::SUCCESS;
    };
    match write_all(&arguments, out) {
        Ok(0) if arguments.count > 0 => {
            eprintln!("no such case: see `truth list` for effects and forms");
            ExitCode::from(2)
        }
        Ok(count) => {
            println!("{count} cases in {}", out.display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{}: {error}", out.display());
            ExitCode::from(2)
        }
    }
}

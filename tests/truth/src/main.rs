//! Writes cases to a directory: `cases/<id>/` contains the inputs of the measured tool,
//! `held-back/<id>/` the records that the tool must not see and `truth.json`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand, ValueEnum};
use rayon::prelude::*;
use truth::{CATALOGUE, Case, Family, Kind, drawn};

#[derive(Parser)]
#[command(about, version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Directory to write to
    #[arg(long, value_name = "DIR", required = true)]
    out: Option<PathBuf>,
    /// Seed of all cases; of drawn ones, 10000 and above are the reporting set
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How the laws of effects are made
    #[arg(long, value_enum, default_value_t = Family::Drawn)]
    family: Family,
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
    /// Only cases that hide an effect in this form, of the catalogue-like family
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
    Triple,
    None,
    Unlisted,
}

impl Cases {
    fn has(self, kind: Kind) -> bool {
        match self {
            Cases::All => true,
            Cases::Single => kind == Kind::Single,
            Cases::Pair => kind == Kind::Pair,
            Cases::Triple => kind == Kind::Triple,
            Cases::None => kind == Kind::None,
            Cases::Unlisted => kind == Kind::Unlisted,
        }
    }
}

impl Arguments {
    fn wants(&self, index: u64) -> bool {
        let named = |name: &str| self.effect.as_deref().is_none_or(|wanted| wanted == name);
        let free = self.effect.is_none() && self.form.is_none();
        match self.family {
            Family::Drawn => {
                let plan = drawn::plan(self.seed, index);
                let hides = plan.effects.iter().any(|(entry, _)| named(entry.name));
                self.cases.has(plan.kind) && self.form.is_none() && (free || hides)
            }
            Family::CatalogueLike => {
                let plan = truth::plan(self.seed, index);
                let shaped = |form: &str| self.form.as_deref().is_none_or(|wanted| wanted == form);
                let hides = plan
                    .effects
                    .iter()
                    .any(|planned| named(planned.entry.name) && shaped(planned.form.name));
                self.cases.has(plan.kind) && (free || hides)
            }
        }
    }
}

fn list() {
    let row = |listed: bool, place: &str, name: &str, forms: &str| {
        let kind = if listed { "listed" } else { "unlisted" };
        println!("{kind:9} {place:13} {name:26} {forms}");
    };
    for entry in drawn::DRAWN {
        row(entry.listed, entry.place, entry.name, "drawn");
    }
    for entry in CATALOGUE {
        let forms: Vec<&str> = entry.forms.iter().map(|form| form.name).collect();
        row(entry.listed, entry.place, entry.name, &forms.join(", "));
    }
}

/// Writes records, numbered from 1 if there may be several.
fn write_records(folder: &Path, name: &str, texts: &[String]) -> io::Result<()> {
    for (i, text) in texts.iter().enumerate() {
        fs::write(folder.join(format!("{name}_{}.csv", i + 1)), text)?;
    }
    Ok(())
}

fn write(out: &Path, case: &Case) -> io::Result<()> {
    let given = out.join("cases").join(&case.id);
    let held_back = out.join("held-back").join(&case.id);
    fs::create_dir_all(&given)?;
    fs::create_dir_all(&held_back)?;
    fs::write(given.join("rig.toml"), &case.rig_toml)?;
    write_records(&given, "fit", &case.fit)?;
    write_records(&given, "validate", &case.validate)?;
    fs::write(held_back.join("unseen.csv"), case.unseen.concat())?;
    let answer = format!("{:#}\n", case.answer);
    fs::write(held_back.join("truth.json"), answer)
}

fn write_all(arguments: &Arguments, out: &Path) -> io::Result<usize> {
    let (seed, family) = (arguments.seed, arguments.family);
    match family {
        Family::Drawn => println!("seed {seed}, {} set", drawn::set(seed)),
        Family::CatalogueLike => println!("seed {seed}"),
    }
    // a filter that nothing passes must not search for ever
    let numbers: Vec<u64> = (arguments.first..arguments.first + 100_000)
        .filter(|index| arguments.wants(*index))
        .take(arguments.count)
        .collect();
    numbers
        .par_iter()
        .map(|index| write(out, &family.case(seed, *index)))
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

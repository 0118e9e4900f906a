//! `hil-sim diagnose`.

use super::Failure;
use super::Progress;
use hil_sim::error::{BadInput, one_of};
use hil_sim::identify::diagnosis::{Diagnosis, Options};
use hil_sim::identify::files::{Files, diagnose_files};
use hil_sim::identify::formula::as_own_effects;
use hil_sim::identify::leak_down::leak_down;
use hil_sim::identify::provenance::file_hash;
use hil_sim::identify::report;
use hil_sim::output::{NotWritten, same_file, write_atomically};
use hil_sim::record::Record;
use hil_sim::rig::{FileHash, Rig};
use model_discrepancy::verdict::{Costs, Step, Watch};
use muscle_plant::effects::Catalogue;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Find where simulation and measurement disagree, and which effect the simulation lacks
///
/// Needs a nominal rig, records to fit and records to validate with. Writes diagnosis.json,
/// rig.fitted.toml and report.html.
///
/// Without a rig: a leak-down. The records have the pressure of a closed chamber alone; the result
/// is its time constant, without rig.fitted.toml, and records to validate with are optional.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  hil-sim diagnose --rig rig.toml --fit a.csv --fit b.csv --validate c.csv --out diagnosis
  hil-sim diagnose --fit shut.csv --out leak")]
pub struct Args {
    /// The nominal rig
    #[arg(long, value_name = "RIG", requires = "validate")]
    rig: Option<PathBuf>,
    /// A record to fit to; may be given more than once
    #[arg(long, value_name = "REC.csv", required = true)]
    fit: Vec<PathBuf>,
    /// A record to validate with, which is not fitted; may be given more than once
    #[arg(long, value_name = "REC.csv")]
    validate: Vec<PathBuf>,
    /// Folder for the results, created if it does not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A file to write the formula to, if one was found for what has no name: effects of your own,
    /// to be renamed
    #[arg(long, value_name = "EFFECTS.toml", requires = "rig")]
    add: Option<PathBuf>,
    /// Look for no formula of what has no name, which takes about as long again
    #[arg(long, requires = "rig", conflicts_with = "add")]
    no_formula: bool,
    /// Take a rig without tolerances: every nominal value is exact. Refused if the rig has some
    #[arg(long, requires = "rig")]
    exact: bool,
    /// Remove an effect from the catalogue; may be given more than once
    #[arg(long, value_name = "NAME")]
    without: Vec<String>,
    /// What it costs to name an effect that is not there, in units of the next option
    #[arg(long, value_name = "COST", value_parser = cost,
          default_value_t = Costs::default().wrong_name)]
    cost_wrong_name: f64,
    /// What it costs not to name an effect that is there
    #[arg(long, value_name = "COST", value_parser = cost,
          default_value_t = Costs::default().missing_name)]
    cost_missing_name: f64,
    /// Number of threads; all cores if omitted
    #[arg(long, value_name = "COUNT", value_parser = super::whole(1, 1000))]
    threads: Option<u64>,
    /// Print the diagnosis as JSON instead of text
    #[arg(long)]
    json: bool,
}

/// What records to validate with are called in the report.
const VALIDATION: &str = "Validation record";

fn cost(text: &str) -> Result<f64, String> {
    let cost: f64 = text.parse().map_err(|_| "expected a number above 0")?;
    if cost > 0.0 && cost.is_finite() {
        Ok(cost)
    } else {
        Err("expected a number above 0".into())
    }
}

/// Checks that the effects to do without are in `catalogue`.
fn check_without(args: &Args, catalogue: &Catalogue) -> Result<(), BadInput> {
    let known: Vec<_> = catalogue.kinds().map(|kind| kind.name).collect();
    let unknown = args
        .without
        .iter()
        .find(|name| !known.contains(&name.as_str()));
    unknown.map_or(Ok(()), |name| {
        Err(BadInput::file("--without", one_of(&known, name)))
    })
}

/// The records at `paths`, and what the fitted rig says of their files.
fn read(paths: &[PathBuf], rig: Option<&Rig>) -> Result<(Vec<Record>, Vec<FileHash>), BadInput> {
    let read = paths.iter().map(|path| {
        // Once: a pipe cannot be read again.
        let bytes = Record::read_bytes(path)?;
        let record = Record::parse(&path.display().to_string(), &bytes)?;
        super::check_record(&record, rig)?;
        Ok((record, file_hash(path, &bytes)))
    });
    read.collect()
}

/// Checks that no record is fitted and validated with.
fn check_apart(args: &Args) -> Result<(), BadInput> {
    let is_fitted = |path: &&PathBuf| args.fit.iter().any(|fitted| same_file(fitted, path));
    match args.validate.iter().find(is_fitted) {
        Some(path) => {
            let file = path.display().to_string();
            Err(BadInput::file(file, "a record that is not fitted too"))
        }
        None => Ok(()),
    }
}

fn options(args: &Args) -> Options {
    Options {
        without: args.without.clone(),
        costs: Costs {
            wrong_name: args.cost_wrong_name,
            missing_name: args.cost_missing_name,
        },
        no_formula: args.no_formula,
    }
}

/// Runs `diagnose` with its threads, told of its progress.
fn watched<T: Send>(
    args: &Args,
    diagnose: impl FnOnce(Watch) -> Result<T, BadInput> + Send,
) -> Result<T, Failure> {
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = args.threads {
        pool = pool.num_threads(threads as usize);
    }
    let pool = pool
        .build()
        .map_err(|error| BadInput::file("--threads", error.to_string()))?;
    let progress = Progress::new("diagnosing", 1);
    let stage = Mutex::new("");
    let watch = |step| match step {
        Step::Stage(name, sets) => {
            *stage.lock().unwrap_or_else(PoisonError::into_inner) = name;
            progress.stage(name, sets as u64);
        }
        Step::Try(names) => {
            let stage = *stage.lock().unwrap_or_else(PoisonError::into_inner);
            progress.say(format!("{stage}: {}", names.join(" + ")));
            progress.step();
        }
    };
    Ok(pool.install(|| diagnose(&watch))?)
}

/// Writes the results, of which the report shows `validate` beside their free runs, and prints
/// them.
fn write(
    args: &Args,
    diagnosis: &Diagnosis,
    catalogue: &Catalogue,
    shown: (&str, &[Record], &[[Record; 2]]),
    rig_toml: Option<&str>,
) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(diagnosis)
        .map_err(|error| BadInput::file("diagnosis.json", error.to_string()))?;
    let mut report = report::report(diagnosis, catalogue, shown, rig_toml);
    report.repeat = vec![super::this_command()];
    std::fs::create_dir_all(&args.out).map_err(|error| NotWritten::new(&args.out, error))?;
    if let Some(toml) = rig_toml {
        write_atomically(&args.out.join("rig.fitted.toml"), toml.as_bytes())?;
    }
    write_atomically(
        &args.out.join("diagnosis.json"),
        format!("{json}\n").as_bytes(),
    )?;
    write_atomically(&args.out.join("report.html"), report.to_html().as_bytes())?;
    if args.json {
        super::print_json(diagnosis)?;
    } else {
        super::print(&report.to_text())?;
    }
    Ok(())
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    super::check_folder(&args.out)?;
    check_apart(args)?;
    match &args.rig {
        Some(path) => of_rig(args, path),
        None => of_chamber(args),
    }
}

fn of_chamber(args: &Args) -> Result<(), Failure> {
    let catalogue = Catalogue::standard();
    check_without(args, &catalogue)?;
    let (fit, _) = read(&args.fit, None)?;
    let (validate, _) = read(&args.validate, None)?;
    let (diagnosis, free_runs) = watched(args, |watch| {
        leak_down(&fit, &validate, &options(args), watch)
    })?;
    let (name, records) = if validate.is_empty() {
        ("Record", &fit[..])
    } else {
        (VALIDATION, &validate[..])
    };
    let shown = (name, records, &free_runs[..]);
    write(args, &diagnosis, &catalogue, shown, None)?;
    super::note_left_out(fit.iter().chain(&validate));
    Ok(())
}

fn of_rig(args: &Args, path: &Path) -> Result<(), Failure> {
    let text = Rig::read_text(path)?;
    let name = path.display().to_string();
    let rig = Rig::parse(&name, &text)?;
    super::accepted(rig.check_units())?;
    check_without(args, &rig.catalogue)?;
    let (fit, fit_files) = read(&args.fit, Some(&rig))?;
    let (validate, validate_files) = read(&args.validate, Some(&rig))?;
    let files = Files {
        rig: (&rig, &name, &text),
        records: [&fit, &validate],
        hashes: [fit_files, validate_files],
        rig_hash: file_hash(path, text.as_bytes()),
        exact: args.exact,
    };
    let (diagnosed, rig_toml) =
        watched(args, |watch| diagnose_files(files, &options(args), watch))?;
    let shown = (VALIDATION, &validate[..], &diagnosed.free_runs[..]);
    let catalogue = &diagnosed.fitted.catalogue;
    let diagnosis = &diagnosed.diagnosis;
    write(args, diagnosis, catalogue, shown, Some(&rig_toml))?;
    if let Some(path) = &args.add {
        match as_own_effects(&diagnosed.fitted) {
            Some(declared) => write_atomically(path, declared.as_bytes())?,
            None => super::note(format_args!("{}: not written, no formula", path.display())),
        }
    }
    super::note_left_out(fit.iter().chain(&validate));
    Ok(())
}

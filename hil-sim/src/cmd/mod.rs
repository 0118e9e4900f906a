//! The commands, one per file.

pub mod board;
pub mod check;
pub mod commission;
pub mod compare;
pub mod compensate;
pub mod completions;
pub mod design;
pub mod diagnose;
pub mod effects;
pub mod experiment;
#[cfg(feature = "formats")]
pub mod export;
pub mod faults;
pub mod hil;
pub mod import;
#[cfg(feature = "terminal")]
pub mod interrupt;
pub mod paper;
mod progress;
pub mod record;
pub mod replay;
pub mod rig;
pub mod run;
#[cfg(feature = "terminal")]
pub mod screen;
pub mod settings;
pub mod simulate;

use hil_sim::error::BadInput;
use hil_sim::output::{NotWritten, write_atomically};
use hil_sim::record::Record;
use hil_sim::record::check::{check, refuse_units};
use hil_sim::report::Report;
use hil_sim::rig::Rig;
use progress::Progress;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a command ended early.
pub type Failure = hil_sim::bench::error::Error;

/// Whether only results and errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Prints results and errors only, or also progress and notes.
pub fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Whether numbers that cannot be in the units that their names say are taken as they are.
static ACCEPT: AtomicBool = AtomicBool::new(false);

/// Takes or refuses numbers that cannot be in the units that their names say.
pub fn set_accept(accept: bool) {
    ACCEPT.store(accept, Ordering::Relaxed);
}

fn accepts() -> bool {
    ACCEPT.load(Ordering::Relaxed)
}

/// Lets an error about units pass as a warning if such numbers are to be accepted.
fn accepted(checked: Result<(), BadInput>) -> Result<(), BadInput> {
    match checked {
        Err(error) if accepts() => {
            eprintln!("hil-sim: warning: {error}");
            Ok(())
        }
        checked => checked,
    }
}

/// Reads the rig at `path` and checks the units of its values.
fn read_rig(path: &Path) -> Result<Rig, BadInput> {
    let rig = Rig::read(path)?;
    accepted(rig.check_units())?;
    Ok(rig)
}

/// Reads the record at `path` and checks the names and units of its columns.
fn read_record(path: &Path, rig: Option<&Rig>) -> Result<Record, BadInput> {
    let record = Record::read(path)?;
    check_record(&record, rig)?;
    Ok(record)
}

/// Checks the names and units of a record's columns; warns of units that are accepted.
fn check_record(record: &Record, rig: Option<&Rig>) -> Result<(), BadInput> {
    record.check_names()?;
    accepted(refuse_units(&check(record).units(record, rig), record))
}

/// Says which columns of `records` nothing has read.
fn note_left_out<'a>(records: impl IntoIterator<Item = &'a Record>) {
    for record in records {
        let left_out = record.left_out().join(", ");
        if !left_out.is_empty() {
            let left_out = left_out.escape_debug();
            note(format_args!("{}: left out: {left_out}", record.file()));
        }
    }
}

/// Prints a note beside the results to stderr.
fn note(text: impl std::fmt::Display) {
    if !is_quiet() {
        eprintln!("{text}");
    }
}

/// Arguments for the rig and the results.
#[derive(clap::Args)]
pub struct Common {
    /// The rig; the paper's if omitted (see `hil-sim rig new`)
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

impl Common {
    fn rig(&self) -> Result<Rig, BadInput> {
        self.rig
            .as_deref()
            .map_or_else(|| Ok(Rig::reference()), read_rig)
    }

    /// The rig as records name it: its file, or the paper's.
    fn rig_name(&self) -> String {
        let file = self.rig.as_deref().map(|path| path.display().to_string());
        file.unwrap_or_else(|| REFERENCE_RIG.into())
    }

    /// True without --rig.
    fn is_reference(&self) -> bool {
        self.rig.is_none()
    }
}

/// How records name the rig that is used without --rig.
const REFERENCE_RIG: &str = "the paper's";

/// Arguments for the results: files in a folder, and a summary on stdout.
#[derive(clap::Args)]
pub struct Results {
    /// Folder for the report and records, created if it does not exist
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Print a machine-readable summary instead of text
    #[arg(long)]
    json: bool,
}

impl Results {
    /// The path of a result file; creates its folder.
    fn path(&self, file: &str) -> Result<PathBuf, BadInput> {
        make_folder(&self.out)?;
        Ok(self.out.join(file))
    }

    /// The path of the record of the run `name`.
    fn record_path(&self, name: &str) -> Result<PathBuf, BadInput> {
        self.path(&record_name(name))
    }

    /// Prints the summary, as the report's text or as JSON.
    fn print(&self, report: &Report, summary: &impl Serialize) -> Result<(), NotWritten> {
        if self.json {
            print_json(summary)
        } else {
            print(&report.to_text())
        }
    }

    /// Writes report.html and prints the summary.
    fn finish(&self, mut report: Report, summary: &impl Serialize) -> Result<(), Failure> {
        let path = self.path("report.html")?;
        report.repeat = vec![this_command()];
        write_atomically(&path, report.to_html().as_bytes())?;
        self.print(&report, summary)?;
        note(format_args!("report: {}", path.display()));
        Ok(())
    }
}

/// File name of the record of the run `name`.
fn record_name(name: &str) -> String {
    name.replace(' ', "-") + ".csv"
}

/// The command line of this run, quoted for a shell.
fn this_command() -> String {
    let words = std::env::args_os().map(|word| {
        let word = word.to_string_lossy().into_owned();
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./=:,+@%".contains(&byte);
        if !word.is_empty() && word.bytes().all(plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', "'\\''"))
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

/// Reads a number from `min` to `max`.
fn between(min: f64, max: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| match text.parse() {
        Ok(value) if (min..=max).contains(&value) => Ok(value),
        Err(_) if text.replacen(',', ".", 1).parse::<f64>().is_ok() => {
            Err("expected a decimal point".into())
        }
        // `{}` would write 1e-12 with all its zeros.
        _ => Err(format!("expected a number from {min:?} to {max:?}")),
    }
}

/// Reads a length from `min` to `max` \[m\].
fn length_m(min: f64, max: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        between(min, max)(text).map_err(|error| {
            let in_mm = text.parse().map(|value: f64| value / 1000.0);
            match in_mm {
                Ok(value) if (min..=max).contains(&value) => {
                    format!("{error} m; if this is mm, write {value:?}")
                }
                _ => error,
            }
        })
    }
}

/// Reads a whole number from `min` to `max`.
fn whole(min: u64, max: u64) -> impl Fn(&str) -> Result<u64, String> + Clone {
    move |text| match text.parse() {
        Ok(value) if (min..=max).contains(&value) => Ok(value),
        _ if max == u64::MAX => Err(format!("expected a whole number of at least {min}")),
        _ => Err(format!("expected a whole number from {min} to {max}")),
    }
}

/// Refuses a file in the place of the folder `out`, before what is written there is computed.
fn check_folder(out: &Path) -> Result<(), BadInput> {
    if out.exists() && !out.is_dir() {
        return Err(BadInput::file(
            out.display().to_string(),
            "a folder, found a file",
        ));
    }
    Ok(())
}

/// Makes `folder` unless it exists.
fn make_folder(folder: &Path) -> Result<(), BadInput> {
    check_folder(folder)?;
    std::fs::create_dir_all(folder).map_err(|error| {
        let name = folder.display().to_string();
        BadInput::file(name, format!("a folder that can be made, {error}"))
    })
}

/// Prints results. A closed pipe (`| head`) is not an error.
fn print(text: &str) -> Result<(), NotWritten> {
    use std::io::{ErrorKind, Write};
    let mut stdout = std::io::stdout();
    let written = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
    match written {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => {
            Err(NotWritten::new("stdout", source))
        }
        _ => Ok(()),
    }
}

fn print_json(summary: &impl Serialize) -> Result<(), NotWritten> {
    // Summaries are plain structs of numbers and strings, which are always valid JSON.
    let json = serde_json::to_string_pretty(summary).unwrap_or_default();
    print(&(json + "\n"))
}

/// A number with four digits.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = 3 - value.abs().max(1e-3).log10().floor() as i32;
        format!("{value:.*}", digits.clamp(0, 6) as usize)
    } else {
        format!("{value:.3e}")
    }
}

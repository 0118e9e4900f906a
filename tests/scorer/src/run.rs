//! Runs the tool on cases.
//!
//! The folder of a case contains `given/` (the inputs of the tool), `out/` (its output files), what
//! it printed, and, written only after it has ended, `answer.json`, the unseen records and
//! `run.json`.

use crate::answer::{Answer, Kind};
use crate::child::{self, Ended};
use crate::diagnosis::Diagnosis;
use crate::gap::{self, Gaps};
use crate::shared::forms;
use hil_sim::bench::test_signal::{CONTRACTION_MAX, Limits, Part, RATE_HZ, test_signal};
use hil_sim::error::BadInput;
use hil_sim::output::{NotWritten, write_atomically};
use hil_sim::record::PRESSURE_REF_PA;
use hil_sim::rig::Rig;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;
use truth::{Case, Drive, Family};

/// Number of cases that are searched for those that match a selection.
const SEARCHED: u64 = 100_000;

/// As much of stderr as tells why it failed.
const LAST_LINES: usize = 3;
/// The same, in one table cell.
const LAST_CHARACTERS: usize = 300;

/// The errors of running or reading cases.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or folder.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// A file that was to be written.
    #[error(transparent)]
    NotWritten(#[from] NotWritten),
    /// A file of an earlier run that cannot be understood.
    #[error("{path}: {source}")]
    Json {
        /// Which.
        path: String,
        /// Why.
        source: serde_json::Error,
    },
    /// An experiment that a rig does not allow.
    #[error(transparent)]
    BadInput(#[from] BadInput),
    /// Anything else, in words.
    #[error("{0}")]
    Other(String),
}

fn at(path: &Path) -> impl FnOnce(io::Error) -> Error {
    let path = path.display().to_string();
    move |source| Error::File { path, source }
}

/// A selection of cases.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// How the laws of effects are made.
    pub family: Family,
    /// Seed of all cases.
    pub seed: u64,
    /// Number of the first case that may be taken.
    pub first: u64,
    /// How many.
    pub count: usize,
    /// Only these kinds, if any.
    pub kinds: Vec<Kind>,
    /// Only cases that hide one of these effects, if any.
    pub effects: Vec<String>,
    /// Only cases whose records have at most so many rows each, if given.
    pub max_rows: Option<usize>,
}

impl Selection {
    /// Numbers of the cases.
    ///
    /// # Errors
    /// There are not so many.
    pub fn indices(&self) -> Result<Vec<u64>, Error> {
        let fits = |index: &u64| {
            let (of_kind, names) = self.family.plan(self.seed, *index);
            let kind = |kind: &Kind| truth::Kind::from(*kind) == of_kind;
            let hides = |effect: &String| names.iter().any(|name| name == effect);
            (self.kinds.is_empty() || self.kinds.iter().any(kind))
                && (self.effects.is_empty() || self.effects.iter().any(hides))
                && self
                    .max_rows
                    .is_none_or(|most| self.family.rows(self.seed, *index) <= most)
        };
        // a selection that nothing fits must not be searched for ever
        let searched = self.first..self.first.saturating_add(SEARCHED);
        let indices: Vec<u64> = searched.filter(fits).take(self.count).collect();
        if indices.len() < self.count {
            let why = format!(
                "only {} such cases: expected an effect that there is, and records of so few rows",
                indices.len()
            );
            return Err(Error::Other(why));
        }
        Ok(indices)
    }
}

/// The tool that is measured.
#[derive(Clone, Debug)]
pub struct Tool {
    /// The program.
    pub program: PathBuf,
    /// The program that simulates fitted rigs.
    pub simulator: PathBuf,
    /// Arguments of `diagnose` besides the rig, the records and the folder.
    pub arguments: Vec<String>,
    /// Parts of its own experiment, of which it is given one record more to fit, if any.
    pub experiment: Vec<Part>,
    /// Longest that a diagnosis may take.
    pub limit: Duration,
    /// Cases at a time.
    pub jobs: usize,
    /// Run cases again that have been run before.
    pub again: bool,
}

/// One run of the tool on a case.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Run {
    /// Arguments in addition to those of the case.
    pub arguments: Vec<String>,
    /// Parts of its own experiment, of which it was given a record, too.
    #[serde(default)]
    pub experiment: Vec<String>,
    /// Checksum of the program.
    pub program_crc32: u32,
    /// How the program ended.
    pub ended: Ended,
    /// The last lines that it wrote to stderr.
    pub last_words: String,
    /// Gaps on the validation records, or why there are none.
    pub validation: Result<Gaps, String>,
    /// Gaps on records that the tool was never given, or why there are none.
    pub unseen: Result<Gaps, String>,
}

/// A case that has been run, with its answer.
#[derive(Clone, Debug)]
pub struct Collected {
    /// The answer.
    pub answer: Answer,
    /// How the tool ran.
    pub run: Run,
    /// The diagnosis, or the reason why it cannot be read.
    pub diagnosis: Result<Diagnosis, String>,
    /// The form of each effect in the fitted rig, where it names one.
    pub forms: BTreeMap<String, String>,
}

fn read_json<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, Error> {
    let text = fs::read_to_string(path).map_err(at(path))?;
    serde_json::from_str(&text).map_err(|source| Error::Json {
        path: path.display().to_string(),
        source,
    })
}

fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), Error> {
    // plain structs of numbers and words always have a JSON form
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    Ok(write_atomically(path, format!("{text}\n").as_bytes())?)
}

/// Checksum of the program, to tell its builds apart.
///
/// # Errors
/// It cannot be read.
pub fn program_crc32(program: &Path) -> Result<u32, Error> {
    let bytes = fs::read(program).map_err(at(program))?;
    Ok(crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes))
}

/// Writes records under `folder`, numbered from 1, and tells where they are.
fn write_records(folder: &Path, name: &str, texts: &[String]) -> Result<Vec<PathBuf>, Error> {
    let write = |(i, text): (usize, &String)| {
        let path = folder.join(format!("{name}-{}.csv", i + 1));
        fs::write(&path, text).map_err(at(&path))?;
        Ok(path)
    };
    texts.iter().enumerate().map(write).collect()
}

/// Parts of an experiment as on the command line.
fn part_names(parts: &[Part]) -> Vec<String> {
    parts.iter().map(|part| part.name()).collect()
}

/// The tool's own experiment for the rig that it is given.
fn advised(case: &Case, parts: &[Part]) -> Result<Drive, Error> {
    let rig = Rig::parse(&format!("{}/rig.toml", case.id), &case.rig_toml)?;
    let limits = Limits::of(&rig, CONTRACTION_MAX)?;
    let written = test_signal(&limits, parts).record;
    Ok(Drive {
        period_s: RATE_HZ.recip(),
        reference_pa: written.require(PRESSURE_REF_PA)?.to_vec(),
        shut: written.shut(),
    })
}

/// The folder of one case.
struct Folder(PathBuf);

impl Folder {
    fn diagnose(&self, tool: &Tool, case: &Case) -> Result<(Ended, Vec<PathBuf>), Error> {
        let (given, out) = (self.0.join("given"), self.0.join("out"));
        for folder in [&given, &out] {
            fs::create_dir_all(folder).map_err(at(folder))?;
        }
        let rig = given.join("rig.toml");
        fs::write(&rig, &case.rig_toml).map_err(at(&rig))?;
        let validate = write_records(&given, "validate", &case.validate)?;
        let mut command = Command::new(&tool.program);
        command.arg("diagnose").arg("--rig").arg(&rig);
        for path in write_records(&given, "fit", &case.fit)? {
            command.arg("--fit").arg(path);
        }
        for path in &validate {
            command.arg("--validate").arg(path);
        }
        command
            .arg("--out")
            .arg(&out)
            .args(&tool.arguments)
            .stdin(Stdio::null());
        // files, not pipes, which remaining child processes could keep open
        let printed = |name: &str| {
            let path = self.0.join(name);
            File::create(&path).map_err(at(&path))
        };
        command
            .stdout(printed("stdout.txt")?)
            .stderr(printed("stderr.txt")?);
        let ended = child::run(&mut command, tool.limit).map_err(at(&tool.program))?;
        Ok((ended, validate))
    }

    fn last_words(&self) -> String {
        let bytes = fs::read(self.0.join("stderr.txt")).unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text
            .lines()
            .filter(|line| !line.trim().is_empty())
            .collect();
        let last = &lines[lines.len().saturating_sub(LAST_LINES)..];
        last.join(" / ").chars().take(LAST_CHARACTERS).collect()
    }

    /// Runs the tool on case `index` and keeps what came of it.
    fn run(&self, tool: &Tool, crc32: u32, of: &Selection, index: u64) -> Result<(), Error> {
        if self.0.exists() {
            // removes the results of an earlier run
            fs::remove_dir_all(&self.0).map_err(at(&self.0))?;
        }
        let mut case = of.family.case(of.seed, index);
        if !tool.experiment.is_empty() {
            let drive = advised(&case, &tool.experiment)?;
            let record = of.family.experiment(of.seed, index, drive);
            case.fit.push(record);
        }
        let (ended, validate) = self.diagnose(tool, &case)?;
        let unseen = write_records(&self.0, "unseen", &case.unseen)?;
        write_json(&self.0.join("answer.json"), &case.answer)?;
        let signals = case.answer["noise"].as_object();
        let signals: Vec<&str> = signals
            .into_iter()
            .flatten()
            .map(|(name, _)| &**name)
            .collect();
        let rigs = [
            self.0.join("given/rig.toml"),
            self.0.join("out/rig.fitted.toml"),
        ];
        let gaps = |records: &[PathBuf]| {
            let rigs = [rigs[0].as_path(), rigs[1].as_path()];
            gap::measure(&tool.simulator, rigs, records, &signals, tool.limit)
        };
        let run = Run {
            arguments: tool.arguments.clone(),
            experiment: part_names(&tool.experiment),
            program_crc32: crc32,
            ended,
            last_words: self.last_words(),
            validation: gaps(&validate),
            unseen: gaps(&unseen),
        };
        // written last, as it marks the case as run
        write_json(&self.0.join("run.json"), &run)
    }

    /// Whether it has been run with these arguments and records.
    fn is_done(&self, tool: &Tool) -> bool {
        let run: Result<Run, Error> = read_json(&self.0.join("run.json"));
        run.is_ok_and(|run| {
            run.arguments == tool.arguments && run.experiment == part_names(&tool.experiment)
        })
    }

    fn collect(&self) -> Result<Collected, Error> {
        let run: Run = read_json(&self.0.join("run.json"))?;
        let answer: Answer = read_json(&self.0.join("answer.json"))?;
        let diagnosis = self.diagnosis(&run, &answer);
        let rig_toml = fs::read_to_string(self.0.join("out/rig.fitted.toml"));
        Ok(Collected {
            answer,
            run,
            diagnosis,
            forms: forms(&rig_toml.unwrap_or_default()),
        })
    }

    fn diagnosis(&self, run: &Run, answer: &Answer) -> Result<Diagnosis, String> {
        if let Some(fault) = run.ended.fault() {
            return Err(format!("{fault}: {}", run.last_words)
                .trim_end_matches(": ")
                .into());
        }
        let out = self.0.join("out");
        let text = fs::read_to_string(out.join("diagnosis.json"))
            .map_err(|error| format!("diagnosis.json: {error}"))?;
        let diagnosis = Diagnosis::parse(&text)?;
        diagnosis.covers(answer.noise.keys().map(String::as_str))?;
        if !out.join("rig.fitted.toml").is_file() {
            return Err("no rig.fitted.toml".into());
        }
        Ok(diagnosis)
    }
}

/// Runs the tool on the selected cases that it has not been run on, and collects them all.
///
/// # Errors
/// The tool cannot be started or a file be written; what the tool does wrong is no error.
pub fn run(out: &Path, selection: &Selection, tool: &Tool) -> Result<Vec<Collected>, Error> {
    let crc32 = program_crc32(&tool.program)?;
    let indices = selection.indices()?;
    fs::create_dir_all(out).map_err(at(out))?;
    let of = |index: u64| Folder(out.join(selection.family.id(selection.seed, index)));
    let due: Vec<u64> = indices
        .iter()
        .copied()
        .filter(|index| tool.again || !of(*index).is_done(tool))
        .collect();
    let style = "{elapsed_precise} {bar:30} {pos}/{len} cases, {eta} left {msg}";
    let style = ProgressStyle::with_template(style).unwrap_or(ProgressStyle::default_bar());
    let bar = ProgressBar::new(due.len() as u64).with_style(style);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(tool.jobs);
    let pool = pool
        .build()
        .map_err(|error| Error::Other(error.to_string()))?;
    pool.install(|| {
        due.par_iter().with_max_len(1).try_for_each(|index| {
            of(*index).run(tool, crc32, selection, *index)?;
            bar.inc(1);
            Ok(())
        })
    })
    .inspect_err(|_: &Error| bar.abandon())?;
    bar.finish_and_clear();
    indices.iter().map(|index| of(*index).collect()).collect()
}

/// Collects every case that has been run under `out`, by name.
///
/// # Errors
/// There is none, or a file of one cannot be read.
pub fn collect_all(out: &Path) -> Result<Vec<Collected>, Error> {
    let mut folders = Vec::new();
    for entry in fs::read_dir(out).map_err(at(out))? {
        let path = entry.map_err(at(out))?.path();
        if path.join("run.json").is_file() {
            folders.push(path);
        }
    }
    folders.sort();
    if folders.is_empty() {
        return Err(Error::Other(format!(
            "{}: no case has been run",
            out.display()
        )));
    }
    folders
        .into_iter()
        .map(|path| Folder(path).collect())
        .collect()
}

//! One file a command.

pub mod board;
pub mod completions;
pub mod design;
pub mod hil;
pub mod paper;
pub mod record;
pub mod replay;
pub mod rig;
pub mod run;
pub mod simulate;

use crate::Failure;
use hil_sim::error::BadInput;
use hil_sim::output::write_atomically;
use hil_sim::report::Report;
use hil_sim::rig::Rig;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Which rig, and where results go.
#[derive(clap::Args)]
pub struct Common {
    /// The rig; the paper's if left out (see `hil-sim rig new`)
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Folder for the report and records, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Print a machine-readable summary instead of words
    #[arg(long)]
    json: bool,
}

impl Default for Common {
    fn default() -> Self {
        Common {
            rig: None,
            out: "out".into(),
            json: false,
        }
    }
}

impl Common {
    fn rig(&self) -> Result<Rig, BadInput> {
        self.rig
            .as_deref()
            .map_or_else(|| Ok(Rig::reference()), Rig::read)
    }

    /// True without --rig.
    fn is_reference(&self) -> bool {
        self.rig.is_none()
    }

    /// The path of a result, its folder made.
    fn path(&self, file: &str) -> Result<PathBuf, BadInput> {
        std::fs::create_dir_all(&self.out).map_err(|error| {
            let folder = self.out.display().to_string();
            BadInput::file(folder, format!("a folder that can be made, {error}"))
        })?;
        Ok(self.out.join(file))
    }

    /// Writes report.html and prints the summary, in words or as JSON.
    fn finish(&self, report: &Report, summary: &impl Serialize) -> Result<(), Failure> {
        let path = self.path("report.html")?;
        write_atomically(&path, report.to_html().as_bytes())?;
        if self.json {
            print_json(summary);
        } else {
            print(&report.to_text());
        }
        eprintln!("report: {}", path.display());
        Ok(())
    }
}

/// Prints results. A reader that has gone (`| head`) is no error.
fn print(text: &str) {
    use std::io::Write;
    let _ = std::io::stdout().write_all(text.as_bytes());
}

fn print_json(summary: &impl Serialize) {
    // Summaries are plain structs of numbers and words, which JSON can always hold.
    let json = serde_json::to_string_pretty(summary).unwrap_or_default();
    print(&(json + "\n"));
}

/// Rewrites a path for a message.
fn shown(path: &Path) -> String {
    path.display().to_string()
}

//! `hil-sim commission`.

use super::Failure;
use super::board::{connect, describe};
use hil_sim::bench::settings_file;
use hil_sim::commission::cause::Step;
use hil_sim::commission::person::{Person, Question};
use hil_sim::commission::session::{Seen, Session};
use hil_sim::commission::written;
use hil_sim::error::BadInput;
use hil_sim::output::write_atomically;
use hil_sim::rig::Rig;
use model_core::settings::Settings;
use serde::Serialize;
use std::io::{BufRead, IsTerminal};
use std::path::PathBuf;

/// Lead through the first use of a board on its rig, up to the first lift
///
/// Each step says what to do, what it saw, what was expected and what is probably wrong, and can be
/// repeated. The first air goes into the plugged hose, the first lift is 4 mm high. The board keeps
/// its settings until the end: it gets trial settings for each step with air, then its own again.
/// At the end, if you agree, the measured settings are stored, and DIR gets settings.toml, rig.toml
/// with the tolerances of what was measured, and report.html. See docs/commissioning.md.
///
/// Answers are read from stdin, a line each, so that a script can give them; lines that begin with
/// # are skipped. Exit status 1: ended before the last step, nothing was written.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim commission --port /dev/ttyACM0 --rig my-rig.toml --out commissioned
  hil-sim commission --port /dev/ttyACM0 --check        does a slow lift contradict the settings?
  hil-sim commission --port COM3 --json < answers.txt")]
pub struct Args {
    /// The board's serial port
    #[arg(long, value_name = "PORT")]
    port: String,
    /// The rig as it is supposed to be; the paper's with the tolerances of `hil-sim rig new` if
    /// omitted
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Only check the settings that the board has: start-up test and slow lift
    #[arg(long)]
    check: bool,
    /// Folder for settings, rig and report, created if it does not exist
    #[arg(
        long,
        value_name = "DIR",
        default_value = "commissioned",
        conflicts_with = "check"
    )]
    out: PathBuf,
    /// Print a machine-readable summary instead of text
    #[arg(long)]
    json: bool,
}

/// Answers from stdin.
struct Terminal;

impl Person for Terminal {
    fn ask(&mut self, question: &Question) -> Result<String, Failure> {
        let scripted = !std::io::stdin().is_terminal();
        eprint!("[{}] {}: ", question.name, question.text);
        if scripted {
            eprintln!();
        }
        loop {
            let mut line = String::new();
            let read = std::io::stdin().lock().read_line(&mut line);
            if !read.is_ok_and(|bytes| bytes > 0) {
                let expected = format!("an answer to [{}], found the end", question.name);
                return Err(BadInput::file("stdin", expected).into());
            }
            if !line.starts_with('#') {
                return Ok(line.trim().into());
            }
        }
    }

    fn tell(&mut self, text: &str) {
        eprint!("{text}");
    }
}

#[derive(Serialize)]
struct Summary<'a> {
    board: &'a str,
    complete: bool,
    steps: Vec<StepSummary<'a>>,
    /// Files that were written.
    written: Vec<String>,
}

#[derive(Serialize)]
struct StepSummary<'a> {
    step: Step,
    accepted: bool,
    /// What was looked at, what was seen, what was expected.
    seen: &'a [[String; 3]],
    probably_wrong: Vec<&'static str>,
}

fn summary(seen: &Seen) -> StepSummary<'_> {
    StepSummary {
        step: seen.step,
        accepted: seen.accepted,
        seen: &seen.rows,
        probably_wrong: seen.causes.iter().map(|cause| cause.words()).collect(),
    }
}

/// Runs the command; false if it ended before its last step.
pub fn run(args: &Args) -> Result<bool, Failure> {
    let (name, text) = match &args.rig {
        Some(path) => (path.display().to_string(), Rig::read_text(path)?),
        None => ("rig.toml".into(), Rig::template()),
    };
    let rig = Rig::parse(&name, &text)?;
    let mut board = connect(Some(&args.port))?;
    let words = describe(&board.identity);
    super::note(format_args!("board: {words}"));
    let steps: &[Step] = if args.check { &Step::CHECK } else { &Step::ALL };
    let mut person = Terminal;
    let mut session = Session::new(&mut board.line, &mut person, &rig, args.check)?;
    let complete = session.run(steps)?;
    let mut report = written::report(&session.seen, &session.values, complete);
    report.repeat = vec![super::this_command()];
    let mut files = Vec::new();
    if complete && !args.check {
        let settings = Settings::new(session.values).map_err(|error| {
            BadInput::file(&args.port, format!("measured settings that pass, {error}"))
        })?;
        let rig = written::rig_toml(&text, &session.values, &session.measured)?;
        if session.agrees("Store these settings on the board, and write the files? y, n")? {
            session.store(settings.values())?;
            super::make_folder(&args.out)?;
            let settings = settings_file::to_toml(settings.values());
            for (file, text) in [
                ("settings.toml", settings),
                ("rig.toml", rig),
                ("report.html", report.to_html()),
            ] {
                let path = args.out.join(file);
                write_atomically(&path, text.as_bytes())?;
                files.push(path.display().to_string());
            }
        }
    }
    if args.json {
        super::print_json(&Summary {
            board: &words,
            complete,
            steps: session.seen.iter().map(summary).collect(),
            written: files,
        })?;
    } else {
        super::print(&report.to_text())?;
        for file in files {
            super::note(format_args!("written: {file}"));
        }
    }
    Ok(complete)
}

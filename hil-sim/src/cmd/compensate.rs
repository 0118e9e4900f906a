//! `hil-sim compensate`.

use super::Failure;
use hil_sim::bench::assist_run::{AssistRun, assist_plots};
use hil_sim::bench::compensate::{Compensated, Corners, OFF_BY, Part, Quality, SPAN_S, compensate};
use hil_sim::bench::settings_file;
use hil_sim::error::BadInput;
use hil_sim::output::{NotWritten, same_file, write_atomically};
use hil_sim::report::{Report, Section, Table};
use hil_sim::rig::Rig;
use model_core::settings::SettingsValues;
use serde::Serialize;
use std::path::PathBuf;

/// Derive the controller's compensation from a fitted rig, and test it in the closed loop
///
/// Each effect that the board can compensate is tried on the simulated plant of the rig. It is
/// compensated if that reduces the error of the assistance and the loop keeps its stability
/// margins, also with every parameter off by 30 %. Writes settings.toml, compensation.json and
/// report.html.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim compensate --rig diagnosis/rig.fitted.toml --out compensation
  hil-sim compensate --rig rig.fitted.toml --settings board.toml --out compensation
  hil-sim settings --port /dev/ttyACM0 --write compensation/settings.toml")]
pub struct Args {
    /// The fitted rig, as `hil-sim diagnose` writes it
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// The board's settings; those of the reference board if omitted
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Folder for the results, created if it does not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the test results as JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Summary<'a> {
    settings: String,
    parts: &'a [Part],
    before: Quality,
    after: Quality,
    parameters_off_by: f64,
    corners: Corners,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    super::check_folder(&args.out)?;
    let path = args.out.join("settings.toml");
    for input in [Some(&args.rig), args.settings.as_ref()]
        .into_iter()
        .flatten()
    {
        if same_file(input, &path) {
            let expected = "another --out, as an input would be overwritten";
            return Err(BadInput::file(path.display().to_string(), expected).into());
        }
    }
    let rig = super::read_rig(&args.rig)?;
    let board = match &args.settings {
        Some(file) => *settings_file::read(file)?.values(),
        None => SettingsValues::reference(),
    };
    let done = compensate(&rig, &board)?;
    let summary = Summary {
        settings: path.display().to_string(),
        parts: &done.parts,
        before: done.before,
        after: done.after,
        parameters_off_by: OFF_BY,
        corners: done.corners,
    };
    std::fs::create_dir_all(&args.out).map_err(|error| NotWritten::new(&args.out, error))?;
    let json = serde_json::to_string_pretty(&summary).unwrap_or_default() + "\n";
    write_atomically(&args.out.join("compensation.json"), json.as_bytes())?;
    let toml = settings_file::to_toml(done.settings.values());
    write_atomically(&path, toml.as_bytes())?;
    let mut report = report(&rig, &done, toml);
    report.repeat = vec![super::this_command()];
    write_atomically(&args.out.join("report.html"), report.to_html().as_bytes())?;
    if args.json {
        super::print_json(&summary)?;
    } else {
        super::print(&report.to_text())?;
    }
    Ok(())
}

fn verdict(done: &Compensated) -> Vec<String> {
    let compensated: Vec<&str> = done
        .parts
        .iter()
        .filter(|part| part.compensated)
        .map(|part| part.name.as_str())
        .collect();
    let (before, after, corners) = (&done.before, &done.after, &done.corners);
    if compensated.is_empty() {
        return vec!["No effect is compensated: the settings are unchanged.".into()];
    }
    vec![
        format!(
            "Compensated: {}. The error of the force at the load against K F_b falls from {:.1} to \
             {:.1} N RMS, F_c − F of the muscle from {:.1} to {:.1} N RMS.",
            compensated.join(", "),
            before.load_error_n_rms,
            after.load_error_n_rms,
            before.tracking.error_n_rms,
            after.tracking.error_n_rms
        ),
        format!(
            "With each parameter off by {:.0} %, {} combinations: gain margin at least {:.1} \
             (without compensation {:.1}), delay margin at least {:.0} ms ({:.0} ms), and at most \
             {:.1} N RMS.",
            100.0 * OFF_BY,
            corners.count,
            corners.gain_margin_min,
            before.gain_margin,
            1e3 * corners.delay_margin_s_min,
            1e3 * before.delay_margin_s,
            corners.load_error_n_rms_max
        ),
    ]
}

fn parts_table(parts: &[Part]) -> Table {
    let row = |part: &Part| {
        let state = if part.compensated {
            "compensated"
        } else {
            "not compensated"
        };
        vec![part.name.clone(), state.into(), part.words.clone()]
    };
    Table {
        caption: "Effects of the rig and their compensation".into(),
        columns: ["effect", "result", "details"].map(String::from).into(),
        rows: parts.iter().map(row).collect(),
    }
}

fn quality_table(before: &Quality, after: &Quality) -> Table {
    let row =
        |name: &str, value: fn(&Quality) -> String| vec![name.into(), value(before), value(after)];
    Table {
        caption: format!(
            "From {:.1} to {:.1} s: the weight is lifted, held and lowered as in the paper",
            SPAN_S.start, SPAN_S.end
        ),
        columns: ["", "before", "after"].map(String::from).into(),
        rows: vec![
            row("RMS of K F_b less the force at the load", |quality| {
                format!("{:.2} N", quality.load_error_n_rms)
            }),
            row("RMS of F_c − F of the muscle", |quality| {
                format!("{:.2} N", quality.tracking.error_n_rms)
            }),
            row("lag of F while it rises", |quality| {
                let lag_s = quality.tracking.lag_s;
                lag_s.map_or_else(|| "none".into(), |lag_s| format!("{:.0} ms", 1e3 * lag_s))
            }),
            row("ripple of F while held", |quality| {
                format!("{:.2} N", quality.ripple_n_rms)
            }),
            row("RMS error of the pressure reading", |quality| {
                format!("{:.0} Pa", quality.reading_error_pa_rms)
            }),
            row("gain margin", |quality| {
                format!("{:.2}", quality.gain_margin)
            }),
            row("delay margin", |quality| {
                format!("{:.0} ms", 1e3 * quality.delay_margin_s)
            }),
        ],
    }
}

fn report(rig: &Rig, done: &Compensated, toml: String) -> Report {
    let names = ["before", "after"];
    let runs: Vec<AssistRun> = names
        .into_iter()
        .zip(&done.runs)
        .zip([&done.before, &done.after])
        .map(|((name, ticks), quality)| AssistRun {
            name: name.into(),
            rig: rig.clone(),
            settings: done.settings,
            ticks: ticks.clone(),
            tracking: quality.tracking,
        })
        .collect();
    Report {
        title: "Compensation of a fitted rig".into(),
        verdict: verdict(done),
        sections: vec![
            Section {
                heading: "Test in the closed loop".into(),
                text: vec![
                    "Simulated with the plant of the fitted rig. F_c is K F_b plus the \
                     compensation of friction and payload. The force at the load is the force that \
                     would move the nominal load in the same way. Margins: the factor of K_s·K, \
                     and the added delay, up to which a lifted weight comes to rest without dry \
                     friction."
                        .into(),
                ],
                tables: vec![
                    parts_table(&done.parts),
                    quality_table(&done.before, &done.after),
                ],
                plots: assist_plots(&runs),
                ..Section::default()
            },
            Section {
                heading: "Settings".into(),
                code: toml,
                ..Section::default()
            },
        ],
        repeat: Vec::new(),
    }
}

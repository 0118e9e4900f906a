//! Runs of the assist device: results, table and plots.

use crate::bench::board_settings;
use crate::bench::closed_loop::{Run, run_in_process};
use crate::bench::tick::Tick;
use crate::bench::tracking::{Tracking, tracking};
use crate::error::BadInput;
use crate::report::{Axis, Plot, Series, Table};
use crate::rig::Rig;
use model_core::controller::Control;
use model_core::settings::Settings;

/// A run of the assist device and its result.
#[derive(Clone, Debug)]
pub struct AssistRun {
    /// Its name in reports.
    pub name: String,
    /// The rig it ran on.
    pub rig: Rig,
    /// The controller's settings.
    pub settings: Settings,
    /// The ticks.
    pub ticks: Vec<Tick>,
    /// Tracking of F_c by F.
    pub tracking: Tracking,
}

/// Executes `run` on `rig` with a `controller`, in this program; `tick_done` is called in each
/// tick.
///
/// # Errors
/// The rig lacks a section; the plant has no solution.
pub fn assist<C: Control>(
    name: &str,
    rig: &Rig,
    run: &Run,
    controller: fn(Settings) -> C,
    tick_done: &dyn Fn(),
) -> Result<AssistRun, BadInput> {
    let settings = board_settings::from_rig(rig)?;
    let mut controller = controller(settings);
    let ticks = run_in_process(rig, &settings, run, |sensors| {
        tick_done();
        controller.tick(sensors)
    })?;
    AssistRun::new(name, rig, settings, run, ticks)
}

impl AssistRun {
    /// The result of `run` on `rig` with `settings`.
    ///
    /// # Errors
    /// The rig has no weight.
    pub fn new(
        name: &str,
        rig: &Rig,
        settings: Settings,
        run: &Run,
        ticks: Vec<Tick>,
    ) -> Result<AssistRun, BadInput> {
        Ok(AssistRun {
            name: name.into(),
            rig: rig.clone(),
            settings,
            tracking: tracking(rig, &ticks, &run.finger.followed_s())?,
            ticks,
        })
    }

    /// The result as a sentence.
    pub fn verdict(&self) -> String {
        let lag = self.tracking.lag_s.map_or_else(
            || "never rises with it".into(),
            |lag_s| format!("lags by {:.0} ms", 1e3 * lag_s),
        );
        let fault = self.fault().map_or(String::new(), |fault| {
            format!("the controller stopped assisting ({fault}); ")
        });
        let (name, error_n) = (&self.name, self.tracking.error_n_rms);
        format!("{name}: {fault}the force {lag}; RMS of F_c − F {error_n:.1} N.")
    }

    /// The fault that the controller has latched at the end.
    pub fn fault(&self) -> Option<String> {
        let fault = self.ticks.last()?.output.fault?;
        Some(fault.name().into())
    }
}

/// A lag as text.
pub(crate) fn milliseconds(lag_s: Option<f64>) -> String {
    match lag_s {
        None => "F never rises".into(),
        Some(lag_s) => format!("{:.0} ms", 1e3 * lag_s),
    }
}

/// A table of the results of `runs`.
pub fn tracking_table(runs: &[AssistRun]) -> Table {
    let row = |run: &AssistRun| {
        let tracking = &run.tracking;
        let modes = run
            .ticks
            .last()
            .map(|tick| (tick.output.mode, tick.output.fault));
        vec![
            run.name.clone(),
            milliseconds(tracking.lag_s),
            format!("{:.1} N", tracking.error_n_rms),
            format!("{:.0} N", tracking.reference_force_n_max),
            format!("{:.1} mm", 1e3 * tracking.lift_m_max),
            match modes {
                Some((mode, None)) => mode.name().into(),
                Some((mode, Some(fault))) => format!("{}: {}", mode.name(), fault.name()),
                None => String::new(),
            },
        ]
    };
    Table {
        caption: "Tracking of the reference F_c by the muscle's force F".into(),
        columns: [
            "run",
            "lag of F",
            "RMS of F_c − F",
            "peak of F_c",
            "lift",
            "at the end",
        ]
        .map(String::from)
        .into(),
        rows: runs.iter().map(row).collect(),
    }
}

fn series(run: &AssistRun, name: &str, value: fn(&Tick) -> f64) -> Series {
    let times: Vec<f64> = run.ticks.iter().map(|tick| tick.time_s).collect();
    let values: Vec<f64> = run.ticks.iter().map(value).collect();
    Series::thinned(name, &times, &values)
}

/// Plots of `runs`, with a common time axis.
pub fn assist_plots(runs: &[AssistRun]) -> Vec<Plot> {
    let plot = |title: String, caption: String, y: Axis, series: Vec<Series>| Plot {
        title,
        caption,
        x: Axis::new("time", "s", 1.0),
        y,
        series,
        markers: Vec::new(),
        sync: Some("assist".into()),
    };
    let mut plots = Vec::new();
    for run in runs {
        let caption = format!(
            "F lags F_c by {}; RMS of F_c − F {:.1} N while the finger lifts and holds.",
            milliseconds(run.tracking.lag_s),
            run.tracking.error_n_rms
        );
        let forces = vec![
            series(run, "F_c", |tick| tick.output.reference_force_n.into()).dashed(),
            series(run, "F", |tick| tick.force_n),
        ];
        plots.push(plot(
            format!("Force, {}", run.name),
            caption,
            Axis::new("force", "N", 1.0),
            forces,
        ));
        let pressures = vec![
            series(run, "P_r", |tick| tick.valve_reference.0).dashed(),
            series(run, "P", |tick| tick.pressure.0),
        ];
        plots.push(plot(
            format!("Pressure, {}", run.name),
            "Reference that the controller sends to the valve, and pressure in the muscle.".into(),
            Axis::new("gauge pressure", "kPa", 1e-3),
            pressures,
        ));
    }
    let all = |value: fn(&Tick) -> f64| -> Vec<Series> {
        runs.iter()
            .map(|run| series(run, &run.name, value))
            .collect()
    };
    plots.push(plot(
        "Contraction".into(),
        "Travel of the weight relative to the muscle's length.".into(),
        Axis::new("contraction", "%", 100.0),
        all(|tick| tick.contraction),
    ));
    plots.push(plot(
        "Finger force".into(),
        "Force between finger and lever.".into(),
        Axis::new("finger force", "N", 1.0),
        all(|tick| tick.finger_force_n),
    ));
    plots
}

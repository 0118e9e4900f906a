//! The paper's experiments and figures, ours beside what the paper says.

use crate::bench::closed_loop::{self, Experiment, TICK_S, Tick, Tracking};
use crate::design::{self, Linearisation};
use crate::error::BadInput;
use crate::report::{Axis, Marker, Plot, Report, Section, Series, Table};
use crate::rig::Rig;
use model_core::controller::Controller;
use model_core::pressure::GaugePa;
use model_core::settings::Settings;
use muscle_plant::simulation::{Drive, Plant, Simulated};
use muscle_plant::simulation::{Initial, Simulation, TOLERANCE};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use serde::Serialize;

/// Flow gain of valve A, a nozzle flapper \[kg/(Pa·s)\] (§3.1).
pub const VALVE_A_FLOW_GAIN_KG_PER_PA_S: f64 = 6.1e-9;
/// Flow gain of valve B, two on-off valves with a built-in controller \[kg/(Pa·s)\] (§3.1).
pub const VALVE_B_FLOW_GAIN_KG_PER_PA_S: f64 = 1.3e-7;
/// The paper's valves.
const VALVES: [(&str, f64); 2] = [
    ("valve A", VALVE_A_FLOW_GAIN_KG_PER_PA_S),
    ("valve B", VALVE_B_FLOW_GAIN_KG_PER_PA_S),
];
/// Equilibrium pressure of Fig 7 (which the print calls supply pressure).
const FIG_7_PRESSURE: GaugePa<f64> = GaugePa(4e5);
/// Contraction at which the paper compares volumes \[-\].
const FIG_2_CONTRACTION: f64 = 0.25;

/// One valve in the assist experiment.
#[derive(Clone, Debug, Serialize)]
pub struct ValveResult {
    /// Its name.
    pub name: String,
    /// K_G \[kg/(Pa·s)\].
    pub flow_gain_kg_per_pa_s: f64,
    /// K_G is at least what is needed.
    pub sufficient: bool,
    /// How F followed F_c.
    pub tracking: Tracking,
}

/// The paper's numbers, from our model.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// ω₂/2π at 400 kPa \[Hz\].
    pub natural_frequency_hz: f64,
    /// V(0.25)/V(0) \[-\].
    pub volume_ratio: f64,
    /// Flow gain at which ω₁ = ω₂ at 400 kPa \[kg/(Pa·s)\].
    pub flow_gain_needed_kg_per_pa_s: f64,
    /// Width in ε at equal pressure that friction alone gives the static curve \[-\].
    pub friction_loop_contraction: f64,
    /// Both valves.
    pub valves: Vec<ValveResult>,
}

/// `rig` with another valve.
///
/// # Errors
/// The rig has no valve to replace.
pub fn with_flow_gain(rig: &Rig, flow_gain_kg_per_pa_s: f64) -> Result<Rig, BadInput> {
    let mut rig = rig.clone();
    let mut valve = *rig.require_valve()?;
    valve.flow_gain_kg_per_pa_s = flow_gain_kg_per_pa_s;
    rig.nominal.valve = Some(valve);
    Ok(rig)
}

/// An assist run with its name.
#[derive(Clone, Debug)]
pub struct AssistRun {
    /// What is shown.
    pub name: String,
    /// The rig it ran on.
    pub rig: Rig,
    /// The controller's settings.
    pub settings: Settings,
    /// Its ticks.
    pub ticks: Vec<Tick>,
    /// How F followed F_c.
    pub tracking: Tracking,
}

/// Runs `experiment` on `rig` with the controller that is flashed to the board; `tick_done` is
/// called after each of its ticks.
///
/// # Errors
/// The rig lacks something; the plant has no solution.
pub fn assist(
    name: &str,
    rig: &Rig,
    experiment: &Experiment,
    tick_done: &dyn Fn(),
) -> Result<AssistRun, BadInput> {
    let settings = closed_loop::settings(rig)?;
    let mut controller = Controller::new(settings);
    let ticks = closed_loop::run(rig, &settings, experiment, |sensors| {
        tick_done();
        controller.tick(sensors)
    })?;
    AssistRun::new(name, rig, settings, experiment, ticks)
}

impl AssistRun {
    /// What came of `experiment`, run on `rig` with `settings`.
    ///
    /// # Errors
    /// The rig has no weight.
    pub fn new(
        name: &str,
        rig: &Rig,
        settings: Settings,
        experiment: &Experiment,
        ticks: Vec<Tick>,
    ) -> Result<AssistRun, BadInput> {
        Ok(AssistRun {
            name: name.into(),
            rig: rig.clone(),
            settings,
            tracking: closed_loop::tracking(rig, &ticks, &experiment.finger.followed_s())?,
            ticks,
        })
    }

    /// What followed, in words.
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

    /// The fault that the controller had latched at the end.
    pub fn fault(&self) -> Option<String> {
        let fault = self.ticks.last()?.output.fault?;
        Some(fault.name().into())
    }
}

/// The rigs of the paper's two valves, with their names.
///
/// # Errors
/// The rig has no valve to replace.
pub fn valves(rig: &Rig) -> Result<[(&'static str, Rig); 2], BadInput> {
    Ok([
        (VALVES[0].0, with_flow_gain(rig, VALVES[0].1)?),
        (VALVES[1].0, with_flow_gain(rig, VALVES[1].1)?),
    ])
}

/// Both valves of the paper in `experiment` (Fig 8).
///
/// # Errors
/// As [`assist`].
pub fn both_valves(
    rig: &Rig,
    experiment: &Experiment,
    tick_done: &dyn Fn(),
) -> Result<Vec<AssistRun>, BadInput> {
    VALVES
        .iter()
        .map(|(name, gain)| assist(name, &with_flow_gain(rig, *gain)?, experiment, tick_done))
        .collect()
}

fn milliseconds(lag_s: Option<f64>) -> String {
    match lag_s {
        None => "F never rises".into(),
        Some(lag_s) => format!("{:.0} ms", 1e3 * lag_s),
    }
}

/// The table of what assist runs did.
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
        caption: "How the muscle's force F followed its reference F_c".into(),
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

/// Plots of assist runs, all on one time axis.
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
            "What the controller asks of the valve, and what is in the muscle.".into(),
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
        "The weight's way, in parts of the muscle's length: it follows the finger.".into(),
        Axis::new("contraction", "%", 100.0),
        all(|tick| tick.contraction),
    ));
    plots.push(plot(
        "Finger force".into(),
        "What the person feels at the lever.".into(),
        Axis::new("finger force", "N", 1.0),
        all(|tick| tick.finger_force_n),
    ));
    plots
}

/// `count` values from `from` to `to`.
pub(crate) fn linear(from: f64, to: f64, count: usize) -> Vec<f64> {
    let step = (to - from) / (count - 1) as f64;
    (0..count)
        .map(|number| from + step * number as f64)
        .collect()
}

/// Fig 1: contraction over pressure at constant load, and the loop that friction alone makes.
fn fig_1(rig: &Rig) -> Result<(Plot, f64), BadInput> {
    let pressures = linear(0.0, 5e5, 251);
    let mut lines = Vec::new();
    let weight_n = design::weight(rig)?.mass_kg * GRAVITY_M_PER_S2;
    for force_n in [50.0, weight_n, 200.0] {
        let at = |pressure_pa: &f64| {
            let mass_kg = force_n / GRAVITY_M_PER_S2;
            design::equilibrium(&rig.nominal.muscle, GaugePa(*pressure_pa), mass_kg).unwrap_or(0.0)
        };
        let contractions = pressures.iter().map(at).collect();
        let name = format!("Eq 1, {force_n:.0} N");
        lines.push(Series::new(&name, pressures.clone(), contractions).dashed());
    }
    // Slowly up and down, 10 kPa/s: the whole plant with its friction.
    let plant = rig.plant(Simulated::LOAD_ONLY)?;
    let initial = at_rest(0.0, GaugePa(0.0), &plant);
    let mut simulation = Simulation::new(plant, &initial, &Drive::default(), TOLERANCE);
    let mut branches = [Vec::new(), Vec::new()];
    for (branch, rate_pa_per_s) in branches.iter_mut().zip([1e4, -1e4]) {
        let drive = Drive {
            pressure_rate_pa_per_s: rate_pa_per_s,
            ..Drive::default()
        };
        for _ in 0..250 {
            branch.push(simulation.contraction());
            let advanced = simulation.advance(&drive, simulation.time_s() + 0.2);
            advanced.map_err(|error| rig.unsolvable(error))?;
        }
        branch.push(simulation.contraction());
    }
    let [up, mut down] = branches;
    down.reverse();
    let widths = up.iter().zip(&down).map(|(up, down)| down - up);
    let width = widths.fold(0.0, f64::max);
    lines.push(Series::new("plant, rising", pressures.clone(), up));
    lines.push(Series::new("plant, falling", pressures, down));
    let plot = Plot {
        title: "Fig 1: pressure and contraction at constant load".into(),
        caption: format!(
            "Friction opens the plant's loop by at most {width:.3} in ε at equal pressure; the \
             paper's muscle shows up to 0.05, its own hysteresis, which the model leaves out."
        ),
        x: Axis::new("gauge pressure", "kPa", 1e-3),
        y: Axis::new("contraction", "%", 100.0),
        series: lines,
        markers: Vec::new(),
        sync: None,
    };
    Ok((plot, width))
}

fn at_rest(contraction: f64, pressure: GaugePa<f64>, plant: &Plant) -> Initial {
    Initial {
        time_s: 0.0,
        contraction,
        contraction_rate_per_s: 0.0,
        pressure,
        temperature_k: plant.ambient_temperature_k,
    }
}

/// Fig 2: volume over contraction.
fn fig_2(rig: &Rig) -> Result<(Plot, f64), BadInput> {
    let volume = rig.require_volume()?;
    let contractions = linear(0.0, 0.3, 61);
    let ratio = |contraction: f64| volume.volume_m3(contraction) / volume.volume_m3(0.0);
    let ratios = contractions
        .iter()
        .map(|contraction| ratio(*contraction))
        .collect();
    let plot = Plot {
        title: "Fig 2: volume and contraction".into(),
        caption: format!(
            "V(0.25)/V(0) = {:.2}; the paper: «6 times larger».",
            ratio(FIG_2_CONTRACTION)
        ),
        x: Axis::new("contraction", "%", 100.0),
        y: Axis::new("V/V(0)", "", 1.0),
        series: vec![Series::new("V/V(0)", contractions, ratios)],
        markers: vec![Marker {
            vertical: true,
            value: FIG_2_CONTRACTION,
            label: "25 %".into(),
        }],
        sync: None,
    };
    Ok((plot, ratio(FIG_2_CONTRACTION)))
}

/// Fig 5: steps of the reference pressure, both valves.
fn fig_5(rig: &Rig) -> Result<Vec<Plot>, BadInput> {
    let mut pressures = Vec::new();
    let mut contractions = Vec::new();
    let weight = design::weight(rig)?;
    let start = GaugePa(2e5);
    let contraction =
        design::equilibrium(&rig.nominal.muscle, start, weight.mass_kg).unwrap_or(0.0);
    for (name, gain) in VALVES {
        let rig = with_flow_gain(rig, gain)?;
        let plant = rig.plant(Simulated::WHOLE)?;
        let initial = at_rest(contraction, start, &plant);
        let mut drive = Drive {
            reference: start,
            ..Drive::default()
        };
        let mut simulation = Simulation::new(plant, &initial, &drive, TOLERANCE);
        let (mut times, mut p, mut c) = (Vec::new(), Vec::new(), Vec::new());
        for tick in 0..600_u32 {
            let time_s = f64::from(tick) * 0.5 * TICK_S;
            drive.reference = if (0.2..1.6).contains(&time_s) {
                GaugePa(4e5)
            } else {
                start
            };
            times.push(time_s);
            p.push(simulation.pressure().0);
            c.push(simulation.contraction());
            let advanced = simulation.advance(&drive, f64::from(tick + 1) * 0.5 * TICK_S);
            advanced.map_err(|error| rig.unsolvable(error))?;
        }
        pressures.push(Series::new(name, times.clone(), p));
        contractions.push(Series::new(name, times, c));
    }
    let caption = format!(
        "200 → 400 → 200 kPa with {} kg. The dip and bump are the muscle's own volume change.",
        weight.mass_kg
    );
    let plot = |title: &str, caption: &str, y: Axis, series: Vec<Series>| Plot {
        title: title.into(),
        caption: caption.into(),
        x: Axis::new("time", "s", 1.0),
        y,
        series,
        markers: Vec::new(),
        sync: Some("fig 5".into()),
    };
    Ok(vec![
        plot(
            "Fig 5: step of the reference, pressure",
            &caption,
            Axis::new("gauge pressure", "kPa", 1e-3),
            pressures,
        ),
        plot(
            "Fig 5: step of the reference, contraction",
            "The weight rings at ω₂ on the muscle's stiffness and stops where friction holds it.",
            Axis::new("contraction", "%", 100.0),
            contractions,
        ),
    ])
}

/// Bode plots of G for each of `lines`, with ω₂ marked, and of H for the first.
pub(crate) fn bode(lines: &[(String, Linearisation)]) -> Vec<Plot> {
    let frequencies: Vec<f64> = linear(-1.0, 2.0, 301)
        .into_iter()
        .map(|exponent| 10_f64.powf(exponent))
        .collect();
    let response = |value: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let omegas = frequencies.iter().map(|hz| 2.0 * std::f64::consts::PI * hz);
        omegas.map(value).collect()
    };
    let mut gains = Vec::new();
    let mut phases = Vec::new();
    for (name, linear) in lines {
        let gain = response(&|omega| 20.0 * linear.pressure_response(omega).norm().log10());
        let phase = response(&|omega| linear.pressure_response(omega).arg().to_degrees());
        gains.push(Series::new(
            &format!("G, {name}"),
            frequencies.clone(),
            gain,
        ));
        phases.push(Series::new(
            &format!("G, {name}"),
            frequencies.clone(),
            phase,
        ));
    }
    let mut markers = Vec::new();
    if let Some((_, linear)) = lines.first() {
        let still = linear.contraction_response(0.0).norm();
        let gain =
            response(&|omega| 20.0 * (linear.contraction_response(omega).norm() / still).log10());
        let phase = response(&|omega| linear.contraction_response(omega).arg().to_degrees());
        gains.push(Series::new("H/H(0)", frequencies.clone(), gain).dashed());
        phases.push(Series::new("H", frequencies.clone(), phase).dashed());
        let natural_hz = linear.omega2_rad_per_s / (2.0 * std::f64::consts::PI);
        markers.push(Marker {
            vertical: true,
            value: natural_hz,
            label: format!("ω₂ {natural_hz:.1} Hz"),
        });
    }
    let plot = |title: &str, caption: &str, y: Axis, series: Vec<Series>| Plot {
        title: title.into(),
        caption: caption.into(),
        x: Axis::new("frequency", "Hz", 1.0).log(),
        y,
        series,
        markers: markers.clone(),
        sync: Some("bode".into()),
    };
    vec![
        plot(
            "Gain of pressure control G and of weight on muscle H",
            "A valve is fast enough if G still follows where H resonates.",
            Axis::new("gain", "dB", 1.0),
            gains,
        ),
        plot(
            "Phase of G and H",
            "The phase that G loses at ω₂ is the delay the person feels.",
            Axis::new("phase", "°", 1.0),
            phases,
        ),
    ]
}

/// Everything at once: the report of the paper, its numbers, and Fig 8's runs.
///
/// # Errors
/// The rig lacks something; a run left physics.
pub fn paper(
    rig: &Rig,
    experiment: &Experiment,
) -> Result<(Report, Summary, Vec<AssistRun>), BadInput> {
    let (fig_1, friction_loop_contraction) = fig_1(rig)?;
    let (fig_2, volume_ratio) = fig_2(rig)?;
    let mass_kg = design::weight(rig)?.mass_kg;
    let at_400_kpa = |gain: f64| -> Result<Linearisation, BadInput> {
        let linear = design::linearise(&with_flow_gain(rig, gain)?, FIG_7_PRESSURE, mass_kg)?;
        linear.ok_or_else(|| rig.bad("muscle.alpha_m2", "a muscle that lifts at 400 kPa"))
    };
    let runs = both_valves(rig, experiment, &|| ())?;
    let [a, b] = VALVES.map(|(_, gain)| at_400_kpa(gain));
    let (a, b) = (a?, b?);
    let needed = a.flow_gain_needed_kg_per_pa_s;
    let valves = runs.iter().map(|run| {
        let flow_gain_kg_per_pa_s = run
            .rig
            .nominal
            .valve
            .map_or(0.0, |valve| valve.flow_gain_kg_per_pa_s);
        ValveResult {
            name: run.name.clone(),
            flow_gain_kg_per_pa_s,
            sufficient: flow_gain_kg_per_pa_s >= needed,
            tracking: run.tracking,
        }
    });
    let summary = Summary {
        natural_frequency_hz: a.omega2_rad_per_s / (2.0 * std::f64::consts::PI),
        volume_ratio,
        flow_gain_needed_kg_per_pa_s: needed,
        friction_loop_contraction,
        valves: valves.collect(),
    };
    let lines = [("valve A".to_owned(), a), ("valve B".to_owned(), b)];
    let report = report(
        rig,
        &summary,
        &runs,
        [fig_1, fig_2],
        fig_5(rig)?,
        bode(&lines),
    )?;
    Ok((report, summary, runs))
}

fn report(
    rig: &Rig,
    summary: &Summary,
    runs: &[AssistRun],
    statics: [Plot; 2],
    steps: Vec<Plot>,
    bode: Vec<Plot>,
) -> Result<Report, BadInput> {
    let section = |heading: &str, text: &str, tables: Vec<Table>, plots: Vec<Plot>| Section {
        heading: heading.into(),
        text: vec![text.into()],
        tables,
        plots,
        ..Section::default()
    };
    Ok(Report {
        title: "Power assist with a rubber artificial muscle (Kagawa, Fujita, Kawashima)".into(),
        verdict: verdict(summary),
        sections: vec![
            section(
                "The paper's numbers",
                "What the paper states, in its words, and what this model gives.",
                vec![comparison(summary)],
                Vec::new(),
            ),
            section(
                "Fig 8: the assist experiment",
                "A finger lifts by 0.12 m in 1 s and holds. The controller is the one that is \
                 flashed to the board: 10 ms ticks, 12-bit converters, bridge and sensor noise.",
                vec![tracking_table(runs)],
                assist_plots(runs),
            ),
            section(
                "Fig 7: which valve is fast enough",
                "The circuit linearised at 400 kPa (Eqs 10 and 11).",
                Vec::new(),
                bode,
            ),
            section(
                "Fig 5: step responses",
                "The plant alone.",
                Vec::new(),
                steps,
            ),
            section(
                "Figs 1 and 2: the muscle at rest",
                "The static model.",
                Vec::new(),
                statics.into(),
            ),
            section(
                "Table 1: parameters",
                "The paper's values, and those it leaves out.",
                vec![table_1(rig)?],
                Vec::new(),
            ),
        ],
        repeat: vec!["hil-sim paper".into()],
    })
}

fn verdict(summary: &Summary) -> Vec<String> {
    let judged = summary.valves.iter().map(|valve| {
        let verdict = if valve.sufficient {
            "is sufficient"
        } else {
            "is not"
        };
        format!(
            "{} ({:.1e}) {verdict}",
            valve.name, valve.flow_gain_kg_per_pa_s
        )
    });
    let needed = summary.flow_gain_needed_kg_per_pa_s;
    let felt = summary.valves.iter().map(|valve| {
        format!(
            "with {} the force lags by {} and misses its reference by {:.1} N RMS",
            valve.name,
            milliseconds(valve.tracking.lag_s),
            valve.tracking.error_n_rms
        )
    });
    vec![
        format!(
            "The circuit needs a flow gain of {needed:.1e} kg/(Pa·s): {}.",
            judged.collect::<Vec<_>>().join(", ")
        ),
        format!(
            "That is what the person feels: {}.",
            felt.collect::<Vec<_>>().join("; ")
        ),
    ]
}

fn comparison(summary: &Summary) -> Table {
    let row = |cells: [&str; 3]| cells.map(String::from).to_vec();
    let lag = |number: usize| {
        summary.valves.get(number).map_or(String::new(), |valve| {
            format!(
                "lag {}, RMS {:.1} N, peak of F_c {:.0} N",
                milliseconds(valve.tracking.lag_s),
                valve.tracking.error_n_rms,
                valve.tracking.reference_force_n_max
            )
        })
    };
    let needed = format!("{:.2e} kg/(Pa·s)", summary.flow_gain_needed_kg_per_pa_s);
    let judged = summary.valves.iter().map(|valve| {
        let verdict = if valve.sufficient {
            "sufficient"
        } else {
            "insufficient"
        };
        format!("{}: {verdict}", valve.name)
    });
    Table {
        caption: "Ours beside the paper's".into(),
        columns: ["quantity", "the paper", "this model"]
            .map(String::from)
            .into(),
        rows: vec![
            row([
                "natural frequency ω₂ at 400 kPa",
                "4 Hz",
                &format!("{:.2} Hz", summary.natural_frequency_hz),
            ]),
            row([
                "V(0.25)/V(0)",
                "«6 times larger»",
                &format!("{:.2}", summary.volume_ratio),
            ]),
            row([
                "flow gain at which ω₁ = ω₂",
                "between valves A and B",
                &needed,
            ]),
            row([
                "which valve",
                "A «does not satisfy», B does",
                &judged.collect::<Vec<_>>().join(", "),
            ]),
            row([
                "Fig 8 (a), valve A",
                "F «lags behind»: «human feels strange»",
                &lag(0),
            ]),
            row(["Fig 8 (b), valve B", "F «traces F_b very well»", &lag(1)]),
            row([
                "width of Fig 1's loop in ε",
                "up to 0.05 (hysteresis, left out of the model)",
                &format!("{:.3} (friction alone)", summary.friction_loop_contraction),
            ]),
        ],
    }
}

/// Name, value, unit, and where the paper's rig has it from.
type Parameter = (&'static str, f64, &'static str, &'static str);

fn parameters(rig: &Rig) -> Result<Vec<Parameter>, BadInput> {
    let weight = design::weight(rig)?;
    let (assist, valve, gas) = (
        rig.require_assist()?,
        rig.require_valve()?,
        rig.require_gas()?,
    );
    const PRINTED: &str = "Table 1";
    const CHOSEN: &str = "chosen: the paper leaves it out";
    let muscle = &rig.nominal.muscle;
    let supply_kpa = valve.supply_pressure.0 / 1e3;
    let rows: [Parameter; 14] = [
        ("mass M", weight.mass_kg, "kg", PRINTED),
        (
            "viscous damping C",
            weight.viscous_damping_ns_per_m,
            "N·s/m",
            PRINTED,
        ),
        ("main lever length l", assist.lever_length_m, "m", PRINTED),
        ("Coulomb friction", weight.coulomb_friction_n, "N", PRINTED),
        ("static friction", weight.static_friction_n, "N", PRINTED),
        ("supply pressure P_s", supply_kpa, "kPa", "Table 1 («kPs»)"),
        ("temperature θ_a", gas.ambient_temperature_k, "K", PRINTED),
        ("initial length L", muscle.initial_length_m, "m", PRINTED),
        ("power assist gain K", assist.gain, "", PRINTED),
        ("α", muscle.alpha_m2, "m²", CHOSEN),
        ("β", muscle.beta_m2, "m²", CHOSEN),
        ("γ", muscle.gamma_n, "N", CHOSEN),
        ("spring K_s", assist.input_stiffness_n_per_m, "N/m", CHOSEN),
        ("pulley diameter d", assist.pulley_diameter_m, "m", CHOSEN),
    ];
    Ok(rows.to_vec())
}

/// Table 1: `rig`'s parameters, and which of them are the paper's.
fn table_1(rig: &Rig) -> Result<Table, BadInput> {
    let (rows, papers) = (parameters(rig)?, parameters(&Rig::reference())?);
    let row = |((name, value, unit, source), paper): (&Parameter, &Parameter)| {
        let source = if value == &paper.1 { source } else { "the rig" };
        vec![(*name).into(), format!("{value} {unit}"), source.into()]
    };
    Ok(Table {
        caption: "Parameters".into(),
        columns: ["parameter", "value", "source"].map(String::from).into(),
        rows: rows.iter().zip(&papers).map(row).collect(),
    })
}

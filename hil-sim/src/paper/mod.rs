//! The paper's experiments and figures, compared with the simulation.

mod figures;

use crate::bench::assist_run::{AssistRun, assist, assist_plots, milliseconds, tracking_table};
use crate::bench::closed_loop::Run;
use crate::bench::tracking::Tracking;
use crate::design::bode::bode;
use crate::design::{self, Linearisation};
use crate::error::BadInput;
use crate::faults::ablation::{AblatedController, SafetyFunction};
use crate::report::{Plot, Report, Section, Table};
use crate::rig::Rig;
use figures::{fig_1, fig_2, fig_5};
use model_core::controller::Control;
use model_core::pressure::GaugePa;
use model_core::settings::Settings;
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
    /// Whether K_G is sufficient.
    pub sufficient: bool,
    /// Tracking of F_c by F.
    pub tracking: Tracking,
}

/// The paper's numbers, from the simulation.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// ω₂/2π at 400 kPa \[Hz\].
    pub natural_frequency_hz: f64,
    /// V(0.25)/V(0) \[-\].
    pub volume_ratio: f64,
    /// Flow gain at which ω₁ = ω₂ at 400 kPa \[kg/(Pa·s)\].
    pub flow_gain_needed_kg_per_pa_s: f64,
    /// Width in ε of the static loop at equal pressure, due to friction alone \[-\].
    pub friction_loop_contraction: f64,
    /// Results of both valves.
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

/// The controller without the limit of the energy that a limb may receive, which the paper's does
/// not have: valve A's reference goes further from balance than that permits.
pub fn papers_controller(settings: Settings) -> AblatedController {
    AblatedController::new(settings, SafetyFunction::ContactEnergy)
}

/// Both valves of the paper with a `controller` in `run` (Fig 8).
///
/// # Errors
/// As [`assist`].
pub fn both_valves<C: Control>(
    rig: &Rig,
    run: &Run,
    controller: fn(Settings) -> C,
    tick_done: &dyn Fn(),
) -> Result<Vec<AssistRun>, BadInput> {
    VALVES
        .iter()
        .map(|(name, gain)| {
            let rig = with_flow_gain(rig, *gain)?;
            assist(name, &rig, run, controller, tick_done)
        })
        .collect()
}

/// The report of the comparison, its numbers, and the runs of Fig 8.
///
/// # Errors
/// The rig lacks a section; the plant has no solution.
pub fn paper(rig: &Rig, run: &Run) -> Result<(Report, Summary, Vec<AssistRun>), BadInput> {
    let (fig_1, friction_loop_contraction) = fig_1(rig)?;
    let (fig_2, volume_ratio) = fig_2(rig)?;
    let mass_kg = design::weight(rig)?.mass_kg;
    let at_400_kpa = |gain: f64| -> Result<Linearisation, BadInput> {
        let linear = design::linearise(&with_flow_gain(rig, gain)?, FIG_7_PRESSURE, mass_kg)?;
        linear.ok_or_else(|| rig.bad("muscle.alpha_m2", "a muscle that lifts at 400 kPa"))
    };
    let runs = both_valves(rig, run, papers_controller, &|| ())?;
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
                "Quotations from the paper, and the results of this model.",
                vec![comparison(summary)],
                Vec::new(),
            ),
            section(
                "Fig 8: the assist experiment",
                "A finger lifts by 0.12 m in 1 s and holds. The controller is the one that is \
                 flashed to the board, without its limit of the energy that a limb may receive, \
                 which the paper's does not have: 10 ms ticks, 12-bit converters, bridge and \
                 sensor noise.",
                vec![tracking_table(runs)],
                assist_plots(runs),
            ),
            section(
                "Fig 7: bandwidth of the valves",
                "The circuit linearised at 400 kPa (Eqs 10 and 11).",
                Vec::new(),
                bode,
            ),
            section(
                "Fig 5: step responses",
                "The plant without the controller.",
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
                "The paper's values, and those that it does not state.",
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
            "is not sufficient"
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
            "With the paper's finger motion, {}.",
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
        caption: "Comparison with the paper".into(),
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
                "up to 0.05 (hysteresis, not in the model)",
                &format!("{:.3} (friction alone)", summary.friction_loop_contraction),
            ]),
        ],
    }
}

/// Name, value, unit and source of a parameter.
type Parameter = (&'static str, f64, &'static str, &'static str);

fn parameters(rig: &Rig) -> Result<Vec<Parameter>, BadInput> {
    let weight = design::weight(rig)?;
    let (assist, valve, gas) = (
        rig.require_assist()?,
        rig.require_valve()?,
        rig.require_gas()?,
    );
    const PRINTED: &str = "Table 1";
    const CHOSEN: &str = "chosen, as the paper does not state it";
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

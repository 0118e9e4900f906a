//! Required flow gain of the valve: the linearised circuit over a range of pressures and loads.

use super::bode::{bode, linspace};
use crate::bench::tick::TICK_S;
use crate::datasheet::valve::{Rounding, ValveSheet, ValveWords};
use crate::design::{self, Linearisation};
use crate::error::BadInput;
use crate::report::{Axis, Marker, Plot, Report, Section, Series, Table};
use crate::rig::{MASS_KG, Rig};
use model_core::pressure::GaugePa;
use serde::Serialize;

/// The range of equilibria to examine.
#[derive(Clone, Debug, Default)]
pub struct Question {
    /// Lowest equilibrium pressure (gauge) \[Pa\]; a tenth of the supply if `None`.
    pub pressure_pa_min: Option<f64>,
    /// Highest equilibrium pressure (gauge) \[Pa\]; the supply if none.
    pub pressure_pa_max: Option<f64>,
    /// Masses \[kg\]; the rig's if empty.
    pub masses_kg: Vec<f64>,
}

/// The result of the design.
#[derive(Clone, Debug, Serialize)]
pub struct Answer {
    /// The largest flow gain that any equilibrium requires \[kg/(Pa·s)\].
    pub flow_gain_needed_kg_per_pa_s: f64,
    /// The same in the words of a valve's data sheet.
    pub valve_needed: ValveWords,
    /// The equilibrium that requires it.
    pub worst: Linearisation,
    /// Flow gain of the rig's valve \[kg/(Pa·s)\].
    pub flow_gain_kg_per_pa_s: f64,
    /// Whether it is sufficient at all equilibria.
    pub sufficient: bool,
    /// Stability limits of K_s·K, the lowest over the equilibria; `None` if there is no lever.
    pub stiffness_gain_limits: Option<StiffnessLimits>,
    /// All examined equilibria.
    pub equilibria: Vec<Linearisation>,
}

/// The largest K_s·K with which the sampled loop is stable: 0 if it is stable with none, `None` if
/// with all.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StiffnessLimits {
    /// Without delay of the valve's reference \[N/m\].
    pub without_delay_n_per_m: Option<f64>,
    /// With a delay of one tick \[N/m\].
    pub with_one_tick_n_per_m: Option<f64>,
}

/// Number of examined equilibria per mass.
const PRESSURES: usize = 41;
/// Number of those at which the stability limit is computed.
const STABILITY_STRIDE: usize = 5;

/// The design of `rig` for the equilibria of `question`, with its report.
///
/// # Errors
/// The rig lacks a section, or has no equilibrium in the range.
pub fn design_report(rig: &Rig, question: &Question) -> Result<(Report, Answer), BadInput> {
    let weight_kg = design::weight(rig)?.mass_kg;
    let valve = *rig.require_valve()?;
    let supply_pa = valve.supply_pressure.0;
    let min_pa = question.pressure_pa_min.unwrap_or(0.1 * supply_pa);
    let max_pa = question.pressure_pa_max.unwrap_or(supply_pa);
    let asked = |name: &str, expected: String| BadInput {
        file: "hil-sim design".into(),
        line: None,
        place: Some(format!("option `{name}`")),
        expected,
    };
    if !(min_pa > 0.0 && min_pa < max_pa && max_pa <= 1e8) {
        let expected = format!("increasing pressures above 0, found {min_pa} to {max_pa} Pa");
        return Err(asked("--pressure-min", expected));
    }
    let masses_kg = match question.masses_kg.as_slice() {
        [] => vec![weight_kg],
        masses => masses.to_vec(),
    };
    if let Some(mass) = masses_kg.iter().find(|mass| !MASS_KG.contains(*mass)) {
        let (min, max) = (MASS_KG.start(), MASS_KG.end());
        let expected = format!("a mass from {min} to {max} kg, found {mass:e}");
        return Err(asked("--mass", expected));
    }
    let mut equilibria = Vec::new();
    for mass_kg in &masses_kg {
        for pressure_pa in linspace(min_pa, max_pa, PRESSURES) {
            equilibria.extend(design::linearise(rig, GaugePa(pressure_pa), *mass_kg)?);
        }
    }
    let needed = |linear: &Linearisation| linear.flow_gain_needed_kg_per_pa_s;
    let worst = equilibria
        .iter()
        .copied()
        .max_by(|a, b| needed(a).total_cmp(&needed(b)));
    let Some(worst) = worst else {
        let expected = format!("a muscle that lifts {masses_kg:?} kg from {min_pa} to {max_pa} Pa");
        return Err(rig.bad("muscle.alpha_m2", &expected));
    };
    let answer = Answer {
        flow_gain_needed_kg_per_pa_s: needed(&worst),
        valve_needed: ValveSheet::of_gain(needed(&worst)).words(),
        worst,
        flow_gain_kg_per_pa_s: valve.flow_gain_kg_per_pa_s,
        sufficient: valve.flow_gain_kg_per_pa_s >= needed(&worst),
        stiffness_gain_limits: stiffness_limits(rig, &equilibria)?,
        equilibria,
    };
    Ok((report(rig, &masses_kg, &answer), answer))
}

fn stiffness_limits(
    rig: &Rig,
    equilibria: &[Linearisation],
) -> Result<Option<StiffnessLimits>, BadInput> {
    let Some(assist) = &rig.assist else {
        return Ok(None);
    };
    let mut limits = [f64::INFINITY; 2];
    for (delay_ticks, limit) in limits.iter_mut().enumerate() {
        for linear in equilibria.iter().step_by(STABILITY_STRIDE) {
            let here =
                design::stiffness_gain_limit_n_per_m(rig, assist, linear, TICK_S, delay_ticks)?;
            *limit = limit.min(here.unwrap_or(f64::INFINITY));
        }
    }
    let [without_delay_n_per_m, with_one_tick_n_per_m] =
        limits.map(|limit| limit.is_finite().then_some(limit));
    Ok(Some(StiffnessLimits {
        without_delay_n_per_m,
        with_one_tick_n_per_m,
    }))
}

/// The result as sentences.
fn verdict(rig: &Rig, answer: &Answer) -> Vec<String> {
    let (has, needs) = (
        answer.flow_gain_kg_per_pa_s,
        answer.flow_gain_needed_kg_per_pa_s,
    );
    let worst = &answer.worst;
    let enough = if answer.sufficient {
        "is sufficient"
    } else {
        "is not sufficient"
    };
    let sheet = &answer.valve_needed;
    let omega2_hz = worst.omega2_rad_per_s / (2.0 * std::f64::consts::PI);
    let mut verdict = vec![
        format!(
            "The valve needs a flow gain of at least {needs:.1e} kg/(Pa·s): \
             the rig's {has:.1e} {enough}."
        ),
        format!(
            "On a data sheet that is at least {}.",
            sheet.sheet(Rounding::Up)
        ),
        format!(
            "Such is {}; it must also follow its reference faster than {omega2_hz:.1} Hz.",
            sheet.class()
        ),
        format!(
            "Assumed: the flow gain is the nominal flow over its drop of 1 bar; b = {}, as spool \
             valves have 0.2 to 0.4; C by ISO 6358-1, Kv and Cv by IEC 60534-2-1; ANR is air at \
             20 °C and 100 kPa. A valve passes more per bar over a smaller drop and less over a \
             larger one.",
            sheet.critical_ratio
        ),
        sheet.limits(),
        format!(
            "This is required at {:.0} kPa with {:.1} kg, where ω₂ = {:.2} Hz.",
            worst.pressure_pa / 1e3,
            worst.mass_kg,
            omega2_hz
        ),
    ];
    if let (Some(limits), Some(assist)) = (&answer.stiffness_gain_limits, &rig.assist) {
        let product_n_per_m = assist.input_stiffness_n_per_m * assist.gain;
        verdict.push(stability(limits, product_n_per_m));
    }
    if !rig.effects.is_empty() {
        verdict.push("The design uses the nominal circuit, without the rig's effects.".into());
    }
    verdict
}

/// The stability limits and the K_s·K of the rig as a sentence.
fn stability(limits: &StiffnessLimits, product_n_per_m: f64) -> String {
    let up_to = |limit: Option<f64>| match limit {
        None => "at any K_s·K".to_owned(),
        Some(0.0) => "at no K_s·K".to_owned(),
        Some(limit) => format!("up to K_s·K = {limit:.0} N/m"),
    };
    let below = |limit: Option<f64>| limit.is_none_or(|limit| product_n_per_m < limit);
    let stable = if product_n_per_m < *design::STIFFNESS_GAIN_N_PER_M.start() {
        "is below the examined range"
    } else if below(limits.with_one_tick_n_per_m) {
        "is stable"
    } else if below(limits.without_delay_n_per_m) {
        "is stable only without delay"
    } else {
        "is not stable"
    };
    format!(
        "The sampled loop is stable {} ({} with a tick of delay): the rig's {:.0} N/m {stable}.",
        up_to(limits.without_delay_n_per_m),
        up_to(limits.with_one_tick_n_per_m),
        product_n_per_m,
    )
}

/// Required flow gain and natural frequency over the equilibrium pressure, one line per mass.
fn plots(masses_kg: &[f64], answer: &Answer) -> Vec<Plot> {
    let of_mass = |mass_kg: f64, value: fn(&Linearisation) -> f64| {
        let points = answer
            .equilibria
            .iter()
            .filter(move |linear| linear.mass_kg == mass_kg);
        let (x, y) = points
            .map(|linear| (linear.pressure_pa, value(linear)))
            .unzip();
        Series::new(&format!("{mass_kg} kg"), x, y)
    };
    let over_pressure =
        |title: &str, caption: &str, y: Axis, value: fn(&Linearisation) -> f64| Plot {
            title: title.into(),
            caption: caption.into(),
            x: Axis::new("equilibrium pressure", "kPa", 1e-3),
            y,
            series: masses_kg
                .iter()
                .map(|mass_kg| of_mass(*mass_kg, value))
                .collect(),
            markers: Vec::new(),
            sync: Some("pressure".into()),
        };
    let mut needed = over_pressure(
        "Flow gain at which ω₁ = ω₂",
        "A valve above the line is faster than the weight on the muscle.",
        Axis::new("flow gain", "kg/(Pa·s)", 1.0).log(),
        |linear| linear.flow_gain_needed_kg_per_pa_s,
    );
    needed.markers.push(Marker {
        vertical: false,
        value: answer.flow_gain_kg_per_pa_s,
        label: format!("the rig's valve, {:.1e}", answer.flow_gain_kg_per_pa_s),
    });
    let natural = over_pressure(
        "Natural frequency of the weight on the muscle",
        "ω₂ rises with the pressure, as the stiffness of the muscle does.",
        Axis::new("ω₂/2π", "Hz", 1.0 / (2.0 * std::f64::consts::PI)),
        |linear| linear.omega2_rad_per_s,
    );
    vec![needed, natural]
}

fn report(rig: &Rig, masses_kg: &[f64], answer: &Answer) -> Report {
    let worst = &answer.worst;
    let lines = [(
        format!("{:.0} kPa, {} kg", worst.pressure_pa / 1e3, worst.mass_kg),
        *worst,
    )];
    Report {
        title: "Designing the power-assist circuit".into(),
        verdict: verdict(rig, answer),
        sections: vec![
            Section {
                heading: "Required flow gain of the valve".into(),
                text: vec![
                    "The person feels a delay unless the pressure control (G, bandwidth ω₁) is \
                     faster than the weight on the muscle's own stiffness (H, natural frequency \
                     ω₂)."
                        .into(),
                ],
                tables: vec![table(&answer.equilibria)],
                plots: plots(masses_kg, answer),
                ..Section::default()
            },
            Section {
                heading:
                    "Frequency responses at the equilibrium that requires the highest flow gain"
                        .into(),
                plots: bode(&lines),
                ..Section::default()
            },
        ],
        repeat: Vec::new(),
    }
}

/// A table of every fifth equilibrium.
fn table(equilibria: &[Linearisation]) -> Table {
    let row = |linear: &Linearisation| {
        let hz = |omega: f64| format!("{:.2} Hz", omega / (2.0 * std::f64::consts::PI));
        vec![
            format!("{:.1} kg", linear.mass_kg),
            format!("{:.0} kPa", linear.pressure_pa / 1e3),
            format!("{:.3}", linear.contraction),
            hz(linear.omega2_rad_per_s),
            hz(linear.omega1_rad_per_s),
            format!("{:.3}", linear.damping_ratio),
            format!("{:.2e}", linear.flow_gain_needed_kg_per_pa_s),
        ]
    };
    Table {
        caption: "Equilibria".into(),
        columns: [
            "mass",
            "pressure",
            "ε₀",
            "ω₂/2π",
            "ω₁/2π",
            "ζ",
            "needed K_G [kg/(Pa·s)]",
        ]
        .map(String::from)
        .into(),
        rows: equilibria
            .iter()
            .step_by(STABILITY_STRIDE)
            .map(row)
            .collect(),
    }
}

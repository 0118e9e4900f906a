//! What commissioning writes at its end: settings, rig and report.

use crate::bench::settings_file;
use crate::commission::cause::Step;
use crate::commission::curve::Curve;
use crate::commission::lift::Lift;
use crate::commission::scale::{Line, Point};
use crate::commission::session::{Measured, Seen};
use crate::error::BadInput;
use crate::report::{Axis, Plot, Report, Role, Section, Series};
use crate::rig::{Rig, set_numbers};
use model_core::settings::SettingsValues;

/// Least friction that can be measured \[N\]: a count of the pressure sensor.
const FRICTION_N: f64 = 0.5;
/// A load weighed on a workshop scale, and a supply read off a gauge of class 1.6: as the default
/// tolerances of a rig.
const WEIGHED: f64 = 0.005;
const GAUGE: f64 = 0.016;
/// Least relative tolerance of a supply that the pressure sensor has measured.
const SENSOR: f64 = 0.01;
/// Least relative tolerance of friction: it changes from one breakaway to the next.
const FRICTION: f64 = 0.1;

/// The rig file `text` with what was measured, and the tolerances of that.
///
/// # Errors
/// The text is not a rig any more.
pub fn rig_toml(
    text: &str,
    values: &SettingsValues,
    measured: &Measured,
) -> Result<String, BadInput> {
    let supply = match measured.curve.as_ref().and_then(|curve| curve.supply_pa) {
        Some(_) => SENSOR,
        None => GAUGE,
    };
    let supply_pa = rounded(values.supply_pressure_pa);
    let mut numbers = vec![
        ("valve", "supply_pressure_pa", supply_pa, supply),
        ("load", "mass_kg", rounded(values.load_kg), WEIGHED),
    ];
    let friction = measured.friction.as_ref().filter(|friction| {
        // A rig without friction that could be measured keeps its nominal values.
        friction.static_friction().0 > FRICTION_N
    });
    if let Some(friction) = friction {
        let (static_n, sd_n) = friction.static_friction();
        let coulomb_n = friction.coulomb_n.clamp(0.0, static_n.max(0.0));
        let relative = (sd_n / static_n).max(FRICTION);
        let coulomb = (1.0 - coulomb_n / static_n).max(relative);
        let short = |force_n: f64| rounded((100.0 * force_n).round() as f32 / 100.0);
        numbers.push(("load", "static_friction_n", short(static_n), relative));
        numbers.push(("load", "coulomb_friction_n", short(coulomb_n), coulomb));
    }
    let digits = |share: f64| (1e4 * share).round() / 1e4;
    let numbers = numbers
        .into_iter()
        .map(|(section, key, number, sigma)| (section, key, number, digits(sigma)));
    let bad = |error: &dyn std::fmt::Display| {
        BadInput::file(
            "rig.toml",
            format!("a rig with the measured values, {error}"),
        )
    };
    let text = set_numbers(text, numbers, ("", &[])).map_err(|error| bad(&error))?;
    Rig::parse("rig.toml", &text)?;
    Ok(text)
}

/// The shortest decimal that is this single-precision number.
fn rounded(value: f32) -> f64 {
    value.to_string().parse().unwrap_or_else(|_| value.into())
}

/// The report of a session.
pub fn report(seen: &[Seen], values: &SettingsValues, complete: bool) -> Report {
    let sections = Step::ALL
        .iter()
        .filter_map(|step| seen.iter().find(|seen| seen.step == *step));
    let section = |seen: &Seen| Section {
        heading: seen.step.heading().into(),
        text: seen
            .causes
            .iter()
            .map(|cause| {
                let accepted = if seen.accepted { " (accepted)" } else { "" };
                format!(
                    "Probably wrong{accepted}: {}. {}.",
                    cause.words(),
                    cause.remedy()
                )
            })
            .collect(),
        tables: vec![seen.table()],
        plots: seen.plots.clone(),
        code: String::new(),
    };
    let mut sections: Vec<Section> = sections.map(section).collect();
    sections.push(Section {
        heading: "settings".into(),
        code: settings_file::to_toml(values),
        ..Section::default()
    });
    let open = seen.iter().flat_map(|seen| {
        let open = seen.causes.iter().filter(|_| !seen.accepted);
        open.map(move |cause| format!("{}: {}.", seen.step.heading(), cause.words()))
    });
    let headline = match complete {
        true => "Every step is right or accepted.".into(),
        false => "Ended before its last step.".to_string(),
    };
    Report {
        title: "Commissioning".into(),
        verdict: std::iter::once(headline).chain(open).collect(),
        sections,
        repeat: Vec::new(),
    }
}

fn plot(title: &str, caption: &str, [x, y]: [Axis; 2], series: Vec<Series>) -> Plot {
    Plot {
        title: title.into(),
        caption: caption.into(),
        x,
        y,
        series,
        markers: Vec::new(),
        sync: None,
    }
}

/// A scale's points and line.
pub fn line_plot(quantity: &str, unit: &str, points: &[Point], line: &Line) -> Plot {
    let mut points = points.to_vec();
    points.sort_by(|one, next| one.level.count.total_cmp(&next.level.count));
    let counts: Vec<f64> = points.iter().map(|point| point.level.count).collect();
    let known = points.iter().map(|point| point.quantity).collect();
    let zero = f64::from(line.scale.zero_count);
    let read = counts
        .iter()
        .map(|count| (count - zero) * f64::from(line.scale.per_count));
    let read = read.collect();
    plot(
        &format!("{quantity} over counts"),
        "The points, and the line through them.",
        [
            Axis::new("reading", "counts", 1.0),
            Axis::new(quantity, unit, 1.0),
        ],
        vec![
            Series::new("applied", counts.clone(), known).role(Role::Measured),
            Series::new("line", counts, read)
                .role(Role::Fitted)
                .dashed(),
        ],
    )
}

/// A valve's curve.
pub fn curve_plot(curve: &Curve) -> Plot {
    let way = |down: bool| {
        let mut levels: Vec<_> = curve
            .levels
            .iter()
            .filter(|level| level.down == down)
            .collect();
        levels.sort_by(|one, next| one.reference_pa.total_cmp(&next.reference_pa));
        let x = levels.iter().map(|level| level.reference_pa).collect();
        let y = levels.iter().map(|level| level.pressure_pa).collect();
        (x, y)
    };
    let ((up_x, up_y), (down_x, down_y)) = (way(false), way(true));
    let kpa = |label: &str| Axis::new(label, "kPa", 1e-3);
    plot(
        "valve",
        "Pressure over reference, on the plugged hose.",
        [kpa("reference"), kpa("pressure")],
        vec![
            Series::new("up", up_x, up_y).role(Role::Measured),
            Series::new("down", down_x, down_y).dashed(),
        ],
    )
}

/// A lift in time.
pub fn lift_plots(lift: &Lift) -> Vec<Plot> {
    let time_s: Vec<f64> = (0..lift.samples.len())
        .map(|row| 0.01 * row as f64)
        .collect();
    let of = |value: fn(&crate::commission::lift::Sample) -> f64| {
        lift.samples.iter().map(value).collect::<Vec<f64>>()
    };
    let time = || Axis::new("time", "s", 1.0);
    vec![
        plot(
            "travel",
            "Of the weight, as the encoder reads it.",
            [time(), Axis::new("travel", "mm", 1e3)],
            vec![
                Series::thinned("travel", &time_s, &of(|sample| sample.travel_m))
                    .role(Role::Measured),
            ],
        ),
        plot(
            "pressure",
            "Measured, and its reference.",
            [time(), Axis::new("pressure", "kPa", 1e-3)],
            vec![
                Series::thinned("pressure", &time_s, &of(|sample| sample.pressure_pa))
                    .role(Role::Measured),
                Series::thinned("reference", &time_s, &of(|sample| sample.reference_pa))
                    .role(Role::Nominal)
                    .dashed(),
            ],
        ),
    ]
}

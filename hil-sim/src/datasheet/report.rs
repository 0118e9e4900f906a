//! The report of a rig from data sheets: what was fitted, and how well.

use super::muscle::{MuscleFit, Point, force_n, ideal_m2};
use super::rig::{DIGITS, DataSheets, NewValue, Summary};
use super::volume::VolumeFit;
use crate::report::{Axis, Plot, Report, Role, Section, Series, Table};

/// Points of a fitted line in a plot.
const LINE_POINTS: u32 = 60;

/// The report of `sheets` and of the rig that was made from them.
pub fn report(sheets: &DataSheets, summary: &Summary) -> Report {
    let mut plots = Vec::new();
    let mut text = Vec::new();
    if let Some((fit, _)) = &sheets.muscle {
        plots.push(force_plot(fit));
        if let Some(braid) = &sheets.braid {
            let [alpha_m2, beta_m2] = ideal_m2(braid.diameter_m, braid.angle_rad);
            text.push(format!(
                "The braid alone, without rubber, would have alpha = {alpha_m2:.3e} m² and beta = \
                 {beta_m2:.3e} m². If the fit differs by a multiple, a unit or an angle is wrong."
            ));
        }
    }
    if let Some((fit, _)) = &sheets.volume {
        plots.push(volume_plot(fit));
    }
    Report {
        title: "A rig from data sheets".into(),
        verdict: summary.sentences.clone(),
        sections: vec![Section {
            heading: "Values and tolerances".into(),
            text,
            tables: vec![table(&summary.values)],
            plots,
            ..Section::default()
        }],
        repeat: Vec::new(),
    }
}

fn table(values: &[NewValue]) -> Table {
    let row = |new: &NewValue| {
        vec![
            format!("{}.{}", new.section, new.key),
            format!("{:.*e}", DIGITS - 1, new.value),
            new.unit.into(),
            format!("{:.1} %", 100.0 * new.relative_sigma),
            new.source.clone(),
            new.tolerance_source.into(),
        ]
    };
    Table {
        caption: "Written values, with one relative standard deviation as tolerance".into(),
        columns: [
            "key",
            "value",
            "unit",
            "tolerance",
            "value from",
            "tolerance from",
        ]
        .map(String::from)
        .into(),
        rows: values.iter().map(row).collect(),
    }
}

/// The table's forces and the fitted ones over contraction, a line for each pressure.
fn force_plot(fit: &MuscleFit) -> Plot {
    let mut series = Vec::new();
    for points in &fit.curves {
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            continue;
        };
        let sum_pa: f64 = points.iter().map(|at| at.pressure_pa).sum();
        let pressure_pa = sum_pa / points.len() as f64;
        let name = format!("{:.0} kPa", pressure_pa / 1e3);
        let (x, y) = points.iter().map(|at| (at.contraction, at.force_n)).unzip();
        series.push(Series::new(&name, x, y).role(Role::Measured));
        let fitted = |step: u32| {
            let share = f64::from(step) / f64::from(LINE_POINTS);
            let contraction = first.contraction + share * (last.contraction - first.contraction);
            let at = Point {
                contraction,
                pressure_pa,
                ..*first
            };
            (contraction, force_n(&fit.muscle, &at))
        };
        let (x, y) = (0..=LINE_POINTS).map(fitted).unzip();
        let name = format!("Eq 1, {name}");
        series.push(Series::new(&name, x, y).role(Role::Fitted).dashed());
    }
    Plot {
        title: "Force over contraction".into(),
        caption: "The table's points, joined by pressure, and Eq 1 with the fitted constants."
            .into(),
        x: Axis::new("contraction", "", 1.0),
        y: Axis::new("force", "N", 1.0),
        series,
        markers: Vec::new(),
        sync: None,
    }
}

fn volume_plot(fit: &VolumeFit) -> Plot {
    let mut points = fit.points.clone();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
    let fitted = x
        .iter()
        .map(|contraction| fit.volume.volume_m3(*contraction));
    let fitted = Series::new("Eq 2", x.clone(), fitted.collect());
    Plot {
        title: "Volume over contraction".into(),
        caption: "The geometry or the measured volumes, and Eq 2 with the fitted constants.".into(),
        x: Axis::new("contraction", "", 1.0),
        y: Axis::new("volume", "ml", 1e6),
        series: vec![
            Series::new("given", x, y).role(Role::Measured),
            fitted.role(Role::Fitted).dashed(),
        ],
        markers: Vec::new(),
        sync: None,
    }
}

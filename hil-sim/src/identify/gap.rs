//! The gap between a simulated record and the measured one.

use crate::error::significant;
use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA, Record};
use crate::report::{Axis, Plot, Report, Role, Section, Series, Table};
use muscle_plant::simulation::Simulated;
use serde::Serialize;

/// A signal that is compared: column, name, unit in reports, factor from the SI value to it.
pub(crate) type Signal = (&'static str, &'static str, &'static str, f64);

/// The signals that are compared.
pub(crate) const SIGNALS: [Signal; 3] = [
    (PRESSURE_PA, "gauge pressure", "kPa", 1e-3),
    (CONTRACTION, "contraction", "%", 100.0),
    (FORCE_N, "force", "N", 1.0),
];

/// The gap of one signal, in the column's unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// The column.
    pub signal: &'static str,
    /// Number of measured samples.
    pub samples: usize,
    /// Root mean square of simulated − measured.
    pub rms: f64,
    /// Largest magnitude of simulated − measured.
    pub max: f64,
    /// Largest − smallest measured value.
    pub range: f64,
}

/// The gap of each measured signal that is not an input of the simulation (see
/// [`crate::identify::simulate::simulated`]).
pub fn gaps(measured: &Record, simulated: &Record, which: Simulated) -> Vec<Gap> {
    let outputs = SIGNALS.iter().filter(|(signal, ..)| match *signal {
        PRESSURE_PA => which.pressure,
        CONTRACTION => which.motion,
        _ => true,
    });
    let gaps = outputs.filter_map(|(signal, ..)| {
        let (measured, simulated) = (measured.column(signal)?, simulated.column(signal)?);
        let pairs = measured.iter().zip(simulated);
        let (mut squares, mut max, mut samples) = (0.0, 0.0_f64, 0);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (measured, simulated) in pairs.filter(|(measured, _)| !measured.is_nan()) {
            let gap = simulated - measured;
            squares += gap * gap;
            max = max.max(gap.abs());
            (low, high) = (low.min(*measured), high.max(*measured));
            samples += 1;
        }
        (samples > 0).then(|| Gap {
            signal,
            samples,
            rms: (squares / samples as f64).sqrt(),
            max,
            range: high - low,
        })
    });
    gaps.collect()
}

/// A report with plots of both records and a table of their gaps.
pub fn report(measured: &Record, simulated: &Record, gaps: &[Gap]) -> Report {
    let time_s = measured.time_s();
    let mut plots = Vec::new();
    let mut rows = Vec::new();
    let mut verdict = Vec::new();
    for gap in gaps {
        let shown = SIGNALS.iter().find(|(signal, ..)| *signal == gap.signal);
        let (Some((_, name, unit, factor)), Some(measured), Some(simulated)) = (
            shown,
            measured.column(gap.signal),
            simulated.column(gap.signal),
        ) else {
            continue;
        };
        let percent = match gap.range {
            // A clamped bench or a constant load: no share of the range.
            0.0 => String::new(),
            range => format!(", {:.1} % of its range", 100.0 * gap.rms / range),
        };
        let number = |value: f64| format!("{} {unit}", significant(factor * value));
        verdict.push(format!(
            "The simulated {name} misses the measured one by {} RMS{percent}.",
            number(gap.rms)
        ));
        rows.push(vec![
            (*name).into(),
            number(gap.rms),
            number(gap.max),
            number(gap.range),
        ]);
        let differences = simulated
            .iter()
            .zip(measured)
            .map(|(simulated, measured)| simulated - measured);
        let differences: Vec<f64> = differences.collect();
        let plot = |title: String, series: Vec<Series>| Plot {
            title,
            caption: String::new(),
            x: Axis::new("time", "s", 1.0),
            y: Axis::new(name, unit, *factor),
            series,
            markers: Vec::new(),
            sync: Some("gap".into()),
        };
        let lines = vec![
            Series::thinned("measured", time_s, measured).role(Role::Measured),
            Series::thinned("simulated", time_s, simulated)
                .role(Role::Nominal)
                .dashed(),
        ];
        plots.push(plot(format!("Measured and simulated {name}"), lines));
        let gap = Series::thinned("simulated − measured", time_s, &differences).role(Role::Nominal);
        plots.push(plot(format!("Gap in {name}"), vec![gap]));
    }
    let columns = ["signal", "RMS of the gap", "largest", "measured range"];
    Report {
        title: "Simulated against measured".into(),
        verdict,
        sections: vec![Section {
            heading: "Signals".into(),
            text: Vec::new(),
            tables: vec![Table {
                caption: "The gap of each measured signal that is not an input".into(),
                columns: columns.map(String::from).to_vec(),
                rows,
            }],
            plots,
            ..Section::default()
        }],
        repeat: Vec::new(),
    }
}

//! A rig file from data sheets, and what was fitted for it as a report.

use super::muscle::{MuscleFit, Point, force_n, ideal_m2};
use super::valve::ValveSheet;
use super::volume::{Braid, VolumeFit};
use crate::error::BadInput;
use crate::report::{Axis, Plot, Report, Role, Section, Series, Table};
use crate::rig::{KEYS, Key, Rig, set_numbers};
use serde::Serialize;

/// Points of a fitted line in a plot.
const LINE_POINTS: u32 = 60;
/// A misfit of this share of the largest force is worth a warning.
const POOR_RATIO: f64 = 0.05;
/// The comment on the template's valve.
const TEMPLATE_VALVE: &str = "Eq 9, the paper's valve B; its valve A has 6.1e-9";
/// Digits that are written: a tolerance is seldom below 0.1 %.
const DIGITS: usize = 5;

/// What is known of a rig from data sheets. What is absent stays as it is in the template.
#[derive(Clone, Debug, Default)]
pub struct DataSheets {
    /// The muscle's forces and the name of their table.
    pub muscle: Option<(MuscleFit, String)>,
    /// The geometry of the muscle's braid.
    pub braid: Option<Braid>,
    /// The muscle's volume, and where it comes from.
    pub volume: Option<(VolumeFit, String)>,
    /// The valve.
    pub valve: Option<ValveSheet>,
    /// The tables were measured on this muscle and do not describe its type: muscles of a type
    /// differ, and without this that adds to the tolerances.
    pub measured: bool,
}

/// A value for the rig file.
#[derive(Clone, Debug, Serialize)]
pub struct NewValue {
    /// Section of the file.
    pub section: &'static str,
    /// Name of the key.
    pub key: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The value.
    pub value: f64,
    /// Relative standard deviation \[-\].
    pub relative_sigma: f64,
    /// Where both come from.
    pub source: String,
}

/// The values that replace those of the template.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The values, in the order of the file.
    pub values: Vec<NewValue>,
    /// Root mean square of the forces' misfit \[N\], if there is a table of them.
    pub misfit_n: Option<f64>,
    /// What is not from a data sheet.
    pub still_from_template: Vec<&'static str>,
}

impl DataSheets {
    /// The rig file: `template` with the values of the data sheets and their tolerances, its
    /// report, and a summary.
    ///
    /// # Errors
    /// The values are no rig: one is outside its range, or the volume is negative at a contraction.
    pub fn rig(&self, template: &str) -> Result<(String, Report, Summary), BadInput> {
        let values = self.values();
        // Eq 2 of the template's muscle would be wrong for another one.
        let without: &[&str] = if self.muscle.is_some() && self.volume.is_none() {
            &["volume_d1_m3", "volume_d2_m3", "volume_d3_m3"]
        } else {
            &[]
        };
        let numbers = values
            .iter()
            .map(|new| (new.section, new.key, new.value, new.relative_sigma));
        let text = set_numbers(template, numbers, ("muscle", without))
            .map_err(|error| BadInput::file("the template", format!("TOML, {error}")))?;
        // The template's first comment, and that on its valve, are about another rig.
        let start = text.find("schema = ").unwrap_or(0);
        let still_from_template = self.still_from_template();
        let mut head = format!(
            "# A rig from data sheets, by hil-sim {}. SI units; pressures are gauge unless the\n\
             # name says absolute or atmospheric.\n",
            env!("CARGO_PKG_VERSION")
        );
        for sentence in self.sentences() {
            head += &comment(&sentence);
        }
        head += &comment(&format!(
            "Still the paper's, to be replaced by yours: {}.",
            still_from_template.join(", ")
        ));
        let text = head + &text[start..].replace(TEMPLATE_VALVE, "Eq 9");
        Rig::parse("the rig of these data sheets", &text)?;
        let summary = Summary {
            misfit_n: self.muscle.as_ref().map(|(fit, _)| fit.misfit_n),
            still_from_template,
            values,
        };
        Ok((text, self.report(&summary), summary))
    }

    fn values(&self) -> Vec<NewValue> {
        let mut values = Vec::new();
        let of_type = |key: &Key, fit_ratio: f64| match key.tolerance {
            Some(default) if !self.measured => fit_ratio.hypot(default.relative_sigma),
            _ => fit_ratio,
        };
        let mut push = |name: &str, value: f64, sigma: Option<f64>, source: &str| {
            let Some(key) = KEYS.iter().find(|key| key.name == name) else {
                return;
            };
            let default = key.tolerance.map_or(0.0, |known| known.relative_sigma);
            let relative_sigma = match sigma {
                // A value near 0 has no relative tolerance; 10 is the largest a rig may have.
                Some(sigma) => of_type(key, (sigma / value.abs()).min(10.0)).min(10.0),
                None => default,
            };
            values.push(NewValue {
                section: key.section,
                key: key.name,
                unit: key.unit,
                value: rounded(value, DIGITS),
                relative_sigma: rounded(relative_sigma, 2),
                source: source.into(),
            });
        };
        if let Some((fit, table)) = &self.muscle {
            let muscle = &fit.muscle;
            let source = format!("fit to {table}");
            push("alpha_m2", muscle.alpha_m2, Some(fit.sigmas[0]), &source);
            push("beta_m2", muscle.beta_m2, Some(fit.sigmas[1]), &source);
            push("gamma_n", muscle.gamma_n, Some(fit.sigmas[2]), &source);
        }
        if let Some((fit, source)) = &self.volume {
            let sigma = |place: usize| (fit.sigmas[place] > 0.0).then_some(fit.sigmas[place]);
            push("volume_d1_m3", fit.volume.d1_m3, sigma(0), source);
            push("volume_d2_m3", fit.volume.d2_m3, sigma(1), source);
            push("volume_d3_m3", fit.volume.d3_m3, sigma(2), source);
        }
        if let Some((fit, _)) = &self.muscle {
            push(
                "initial_length_m",
                fit.muscle.initial_length_m,
                None,
                "--length",
            );
        }
        if let Some(sheet) = &self.valve {
            let gain = sheet.flow_gain_kg_per_pa_s();
            push("flow_gain_kg_per_pa_s", gain, None, "--valve");
        }
        values
    }

    fn still_from_template(&self) -> Vec<&'static str> {
        let all = [
            (self.muscle.is_none(), "[muscle]"),
            (true, "[load]"),
            (self.valve.is_none(), "the valve's flow gain"),
            (true, "supply_pressure_pa"),
            (true, "[gas]"),
            (true, "[assist]"),
        ];
        all.iter()
            .filter(|(is, _)| *is)
            .map(|(_, what)| *what)
            .collect()
    }

    /// What was taken from where, as sentences.
    fn sentences(&self) -> Vec<String> {
        let mut sentences = Vec::new();
        if let Some((fit, table)) = &self.muscle {
            let largest_n = fit.points.iter().map(|at| at.force_n).fold(0.0, f64::max);
            let ratio = fit.misfit_n / largest_n;
            let worst = &fit.worst;
            sentences.push(format!(
                "Eq 1 fits the {} forces of {table} to {:.1} N RMS, {:.1} % of the largest; worst \
                 at {:.0} kPa and a contraction of {:.3}, {:+.1} N.",
                fit.points.len(),
                fit.misfit_n,
                100.0 * ratio,
                worst.pressure_pa / 1e3,
                worst.contraction,
                worst.force_n - force_n(&fit.muscle, worst),
            ));
            if ratio > POOR_RATIO {
                sentences.push(
                    "That is a poor fit: the plot shows where Eq 1 does not hold for this muscle \
                     (a threshold pressure, the elasticity of the bladder), and a diagnosis will \
                     name it."
                        .into(),
                );
            }
            if fit.slack > 0 {
                sentences.push(format!(
                    "{} points where the muscle is slack were left out.",
                    fit.slack
                ));
            }
            sentences.push(match self.measured {
                true => "Tolerances are those of the fit.".into(),
                false => "Tolerances are those of the fit and of muscles of one type.".into(),
            });
            if self.volume.is_none() {
                sentences.push(
                    "Without --diameter and --braid-angle, or --volume, there is no volume: the \
                     pressure cannot be simulated."
                        .into(),
                );
            }
        }
        if let Some((fit, source)) = &self.volume {
            let at_rest_m3 = fit.volume.d3_m3;
            sentences.push(format!(
                "Eq 2 fits the volume by {source} to {:.2} % of its {:.1} ml at rest, RMS.",
                100.0 * fit.misfit_m3 / at_rest_m3,
                1e6 * at_rest_m3
            ));
        }
        if let Some(sheet) = &self.valve {
            sentences.push(format!(
                "The valve passes {}. Its flow gain is the chord from 6 to 5 bar; over \
                 0.2 bar it passes {:.1} times as much per bar, over 4 bar {:.2} times.",
                sheet.catalogue().words(),
                sheet.chord_ratio(0.2),
                sheet.chord_ratio(4.0)
            ));
        }
        sentences
    }

    fn report(&self, summary: &Summary) -> Report {
        let mut plots = Vec::new();
        let mut text = Vec::new();
        if let Some((fit, _)) = &self.muscle {
            plots.push(force_plot(fit));
            if let Some(braid) = &self.braid {
                let [alpha_m2, beta_m2] = ideal_m2(braid.diameter_m, braid.angle_rad);
                text.push(format!(
                    "The braid alone, without rubber, would have alpha = {alpha_m2:.3e} m² and \
                     beta = {beta_m2:.3e} m². If the fit differs by a multiple, a unit or an angle \
                     is wrong."
                ));
            }
        }
        if let Some((fit, _)) = &self.volume {
            plots.push(volume_plot(fit));
        }
        Report {
            title: "A rig from data sheets".into(),
            verdict: self.sentences(),
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
}

/// `text` as comment lines of at most 100 columns.
fn comment(text: &str) -> String {
    let mut comment = String::new();
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > 100 {
            comment += &(std::mem::replace(&mut line, "#".into()) + "\n");
        }
        line += " ";
        line += word;
    }
    comment + &line + "\n"
}

/// `value` with so many significant digits.
fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

fn table(values: &[NewValue]) -> Table {
    let row = |new: &NewValue| {
        vec![
            format!("{}.{}", new.section, new.key),
            format!("{:.*e}", DIGITS - 1, new.value),
            new.unit.into(),
            format!("{:.1} %", 100.0 * new.relative_sigma),
            new.source.clone(),
        ]
    };
    Table {
        caption: "Written values, with one relative standard deviation as tolerance".into(),
        columns: ["key", "value", "unit", "tolerance", "from"]
            .map(String::from)
            .into(),
        rows: values.iter().map(row).collect(),
    }
}

/// The table's forces and the fitted ones over contraction, a line for each pressure.
fn force_plot(fit: &MuscleFit) -> Plot {
    let mut series = Vec::new();
    for points in fit.points.chunk_by(|a, b| a.pressure_pa == b.pressure_pa) {
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            continue;
        };
        let name = format!("{:.0} kPa", first.pressure_pa / 1e3);
        let (x, y) = points.iter().map(|at| (at.contraction, at.force_n)).unzip();
        series.push(Series::new(&name, x, y).role(Role::Measured));
        let fitted = |step: u32| {
            let share = f64::from(step) / f64::from(LINE_POINTS);
            let contraction = first.contraction + share * (last.contraction - first.contraction);
            let at = Point {
                contraction,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_are_broken_at_words() {
        let text = "word ".repeat(40);
        let comment = comment(&text);
        assert!(
            comment
                .lines()
                .all(|line| line.starts_with("# word") && line.len() <= 100)
        );
        assert_eq!(comment.matches("word").count(), 40);
    }

    #[test]
    fn a_valve_alone_changes_one_value_of_the_template() {
        let sheets = DataSheets {
            valve: Some("Q=700".parse().expect("a valve")),
            ..DataSheets::default()
        };
        let (text, _, summary) = sheets.rig(Rig::REFERENCE_TOML).expect("a rig");
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        let mut reference = Rig::reference();
        for key in KEYS {
            let (found, before) = ((key.value)(&mut rig), (key.value)(&mut reference));
            match key.name {
                "flow_gain_kg_per_pa_s" => assert_eq!(found.map(|v| *v), Some(1.3825e-7)),
                _ => assert_eq!(found, before, "{}", key.name),
            }
        }
        assert_eq!(summary.values.len(), 1);
        assert!(Rig::REFERENCE_TOML.contains(TEMPLATE_VALVE) && !text.contains("valve B"));
        let sigma = |tolerance: &crate::rig::Tolerance| tolerance.relative_sigma;
        let mut tolerances = rig.tolerances.iter();
        let valve = tolerances.find(|known| known.key == "flow_gain_kg_per_pa_s");
        assert_eq!(valve.map(sigma), Some(0.1));
    }
}

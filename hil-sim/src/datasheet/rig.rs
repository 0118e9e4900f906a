//! A rig file from data sheets.

use super::muscle::{MuscleFit, force_n};
use super::valve::{Rounding, ValveSheet};
use super::volume::{Braid, VolumeFit};
use crate::error::BadInput;
use crate::rig::{KEYS, Rig, set_numbers};
use serde::Serialize;

/// A misfit of this share of the largest force is worth a warning.
const POOR_RATIO: f64 = 0.05;
/// The comment on the template's valve.
const TEMPLATE_VALVE: &str = "Eq 9, the paper's valve B; its valve A has 6.1e-9";
/// Digits that are written: a tolerance is seldom below 0.1 %.
pub(super) const DIGITS: usize = 5;
/// The largest tolerance that a rig may have. A value near 0 has no relative tolerance.
const SIGMA_MAX: f64 = 10.0;

/// Where a tolerance comes from: the fit.
const OF_FIT: &str = "the fit";
/// The fit, and how muscles of a type differ.
const OF_FIT_AND_TYPE: &str = "the fit and muscles of one type";
/// How uncalibrated values differ.
const OF_TYPE: &str = "uncalibrated values";
/// A catalogue's nominal flow, and the chord of which Eq 9 has one.
const OF_CHORD: &str = "a nominal flow and the chords over 0.2 to 4 bar";

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
    /// Where the value comes from.
    pub source: String,
    /// Where the standard deviation comes from.
    pub tolerance_source: &'static str,
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
    /// What was taken from where, and how well it fits, in words.
    pub sentences: Vec<String>,
}

impl DataSheets {
    /// The rig file: `template` with the values of the data sheets and their tolerances, and a
    /// summary. Without data sheets it is the template.
    ///
    /// # Errors
    /// The values are no rig: one is outside its range, or the volume is negative at a contraction.
    /// A table that was measured on the muscle does not tell how well it determines the values.
    pub fn rig(&self, template: &str) -> Result<(String, Summary), BadInput> {
        self.check_measured()?;
        let values = self.values();
        let summary = Summary {
            misfit_n: self.muscle.as_ref().map(|(fit, _)| fit.misfit_n),
            still_from_template: self.still_from_template(),
            sentences: self.sentences(&values),
            values,
        };
        if summary.values.is_empty() {
            return Ok((template.into(), summary));
        }
        // Eq 2 of the template's muscle would be wrong for another one.
        let without: &[&str] = if self.muscle.is_some() && self.volume.is_none() {
            &["volume_d1_m3", "volume_d2_m3", "volume_d3_m3"]
        } else {
            &[]
        };
        let numbers = summary
            .values
            .iter()
            .map(|new| (new.section, new.key, new.value, new.relative_sigma));
        let text = set_numbers(template, numbers, ("muscle", without))
            .map_err(|error| BadInput::file("the template", format!("TOML, {error}")))?;
        // The template's first comment, and that on its valve, are about another rig.
        let start = text.find("schema = ").unwrap_or(0);
        let mut head = format!(
            "# A rig from data sheets, by hil-sim {}. SI units; pressures are gauge unless the\n\
             # name says absolute or atmospheric.\n",
            env!("CARGO_PKG_VERSION")
        );
        for sentence in &summary.sentences {
            head += &comment(sentence);
        }
        head += &comment(&format!(
            "Still the paper's, to be replaced by yours: {}.",
            summary.still_from_template.join(", ")
        ));
        let text = head + &text[start..].replace(TEMPLATE_VALVE, "Eq 9");
        Rig::parse("the rig of these data sheets", &text)?;
        Ok((text, summary))
    }

    /// Refuses tables measured on this muscle that have no tolerances of their own: those of a type
    /// would say less than is known, and none that all is exact.
    fn check_measured(&self) -> Result<(), BadInput> {
        let bad = |table: &str, expected: &str| {
            let expected = format!(
                "{expected} with --measured, so that each can be left out to see what it \
                 contributes: without --measured the tolerances are those of muscles of one type"
            );
            Err(BadInput::file(table, expected))
        };
        match (&self.muscle, &self.volume) {
            (Some((fit, table)), _) if self.measured && fit.sigmas.is_none() => bad(
                table,
                "curves at three pressures and three contractions or more",
            ),
            (_, Some((fit, table)))
                if self.measured && self.braid.is_none() && fit.sigmas.is_none() =>
            {
                bad(table, "volumes at four contractions or more")
            }
            _ => Ok(()),
        }
    }

    fn values(&self) -> Vec<NewValue> {
        let mut values = Vec::new();
        // `tolerance` gives a standard deviation, that of uncalibrated values and the source.
        let mut push = |name: &str,
                        value: f64,
                        source: &str,
                        tolerance: &dyn Fn(f64) -> (f64, &'static str)| {
            let Some(key) = KEYS.iter().find(|key| key.name == name) else {
                return;
            };
            let default = key.tolerance.map_or(0.0, |known| known.relative_sigma);
            let (relative_sigma, tolerance_source) = tolerance(default);
            values.push(NewValue {
                section: key.section,
                key: key.name,
                unit: key.unit,
                value: rounded(value, DIGITS),
                relative_sigma: rounded(relative_sigma.min(SIGMA_MAX), 2),
                source: source.into(),
                tolerance_source,
            });
        };
        let mut fitted = |name: &str, value: f64, sigma: Option<f64>, source: &str| {
            push(name, value, source, &|default| match sigma {
                Some(sigma) if self.measured => (sigma / value.abs(), OF_FIT),
                Some(sigma) => ((sigma / value.abs()).hypot(default), OF_FIT_AND_TYPE),
                None => (default, OF_TYPE),
            });
        };
        if let Some((fit, table)) = &self.muscle {
            let muscle = &fit.muscle;
            let source = format!("fit to {table}");
            let sigma = |place: usize| fit.sigmas.map(|sigmas| sigmas[place]);
            fitted("alpha_m2", muscle.alpha_m2, sigma(0), &source);
            fitted("beta_m2", muscle.beta_m2, sigma(1), &source);
            fitted("gamma_n", muscle.gamma_n, sigma(2), &source);
        }
        if let Some((fit, source)) = &self.volume {
            let sigma = |place: usize| fit.sigmas.map(|sigmas| sigmas[place]);
            fitted("volume_d1_m3", fit.volume.d1_m3, sigma(0), source);
            fitted("volume_d2_m3", fit.volume.d2_m3, sigma(1), source);
            fitted("volume_d3_m3", fit.volume.d3_m3, sigma(2), source);
        }
        if let Some((fit, _)) = &self.muscle {
            let length_m = fit.muscle.initial_length_m;
            fitted("initial_length_m", length_m, None, "--length");
        }
        if let Some(sheet) = &self.valve {
            let gain = sheet.flow_gain_kg_per_pa_s();
            push("flow_gain_kg_per_pa_s", gain, "--valve", &|default| {
                (sheet.chord_sigma().hypot(default), OF_CHORD)
            });
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
    fn sentences(&self, values: &[NewValue]) -> Vec<String> {
        let mut sentences = Vec::new();
        if let Some((fit, table)) = &self.muscle {
            sentences.extend(force_sentences(fit, table));
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
        if self.muscle.is_some() {
            sentences.extend(self.tolerance_sentences(values));
        }
        if let Some(sheet) = &self.valve {
            let words = sheet.words();
            let [most, least] = sheet.working_chord_ratios();
            let new = values.iter().find(|new| new.tolerance_source == OF_CHORD);
            sentences.push(format!(
                "The valve passes {}. Its flow gain is the chord from 6 to 5 bar; over 0.2 bar it \
                 passes {most:.1} times as much per bar, over 4 bar {least:.2} times. Its \
                 tolerance, {:.0} %, is that of a nominal flow and of this range.",
                words.sheet(Rounding::Nearest),
                100.0 * new.map_or(0.0, |new| new.relative_sigma)
            ));
            sentences.push(words.limits());
        }
        sentences
    }

    /// Which tolerances are those of a fit.
    fn tolerance_sentences(&self, values: &[NewValue]) -> Vec<String> {
        let mut sentences = Vec::new();
        let forces = self.muscle.as_ref().map(|(fit, table)| (fit.sigmas, table));
        // A geometry has no scatter.
        let volumes = self.volume.as_ref().filter(|_| self.braid.is_none());
        let volumes = volumes.map(|(fit, table)| (fit.sigmas, table));
        for (sigmas, table) in [forces, volumes].into_iter().flatten() {
            if sigmas.is_none() {
                sentences.push(format!(
                    "{table} does not tell how well it determines its values, as no curve can be \
                     left out: their tolerances are those of uncalibrated values."
                ));
            }
        }
        let fitted = |new: &&NewValue| [OF_FIT, OF_FIT_AND_TYPE].contains(&new.tolerance_source);
        let keys: Vec<_> = values.iter().filter(fitted).map(|new| new.key).collect();
        if !keys.is_empty() {
            let and = match self.measured {
                true => "",
                false => " and of muscles of one type",
            };
            sentences.push(format!(
                "The tolerances of {} are those of the fit{and}; the others are those of \
                 uncalibrated values.",
                keys.join(", ")
            ));
        }
        sentences
    }
}

/// How well Eq 1 fits the forces of a table.
fn force_sentences(fit: &MuscleFit, table: &str) -> Vec<String> {
    let mut sentences = Vec::new();
    let largest_n = fit.points().map(|at| at.force_n).fold(0.0, f64::max);
    let ratio = fit.misfit_n / largest_n;
    let worst = &fit.worst;
    sentences.push(format!(
        "Eq 1 fits the {} forces of {table} to {:.1} N RMS, {:.1} % of the largest; worst at \
         {:.0} kPa and a contraction of {:.3}, {:+.1} N.",
        fit.points().count(),
        fit.misfit_n,
        100.0 * ratio,
        worst.pressure_pa / 1e3,
        worst.contraction,
        worst.force_n - force_n(&fit.muscle, worst),
    ));
    if ratio > POOR_RATIO {
        sentences.push(
            "That is a poor fit: the plot shows where Eq 1 does not hold for this muscle (a \
             threshold pressure, the elasticity of the bladder), and a diagnosis will name it."
                .into(),
        );
    }
    if fit.slack > 0 {
        sentences.push(format!(
            "Left out, as the muscle is slack there: points without force, {} in number.",
            fit.slack
        ));
    }
    sentences
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

#[cfg(test)]
mod tests {
    use super::super::muscle;
    use super::*;
    use model_core::pressure::GaugePa;

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
        let (text, summary) = sheets.rig(&Rig::template()).expect("a rig");
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        let mut reference = Rig::parse("rig.toml", &Rig::template()).expect("a rig");
        for key in KEYS {
            let (found, before) = ((key.value)(&mut rig), (key.value)(&mut reference));
            match key.name {
                "flow_gain_kg_per_pa_s" => assert_eq!(found.map(|v| *v), Some(1.3825e-7)),
                _ => assert_eq!(found, before, "{}", key.name),
            }
        }
        assert_eq!(summary.values.len(), 1);
        assert!(Rig::REFERENCE_TOML.contains(TEMPLATE_VALVE) && !text.contains("valve B"));
        // The chords from 2.34 to 0.41, uniform, and the 10 % of a nominal flow.
        for tolerance in &mut reference.tolerances {
            if tolerance.key == "flow_gain_kg_per_pa_s" {
                tolerance.relative_sigma = 0.57;
            }
        }
        assert_eq!(
            rig.tolerances, reference.tolerances,
            "in the order of the file"
        );
        // Its reason was that of another number.
        assert!(text.contains("\nflow_gain_kg_per_pa_s = 0.57\n"), "{text}");
    }

    #[test]
    fn without_data_sheets_the_template_stays() {
        let (text, summary) = DataSheets::default().rig(&Rig::template()).expect("a rig");
        assert_eq!(text, Rig::template());
        assert!(summary.values.is_empty());
    }

    /// Eq 1 with the paper's constants at the given pressures in kPa.
    fn sheets(pressures_kpa: &[u32], measured: bool) -> DataSheets {
        let mut table = String::from("contraction,pressure_kpa,force_n\n");
        let muscle = Rig::reference().nominal.muscle;
        for pressure_kpa in pressures_kpa {
            let pressure = GaugePa(1e3 * f64::from(*pressure_kpa));
            for contraction in [0.0, 0.05, 0.1, 0.15] {
                let force_n = muscle.force_n(contraction, pressure).round();
                table += &format!("{contraction},{pressure_kpa},{force_n}\n");
            }
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table.csv");
        std::fs::write(&path, table).expect("written");
        let fit = muscle::read(&path, 0.3).expect("a fit");
        DataSheets {
            muscle: Some((fit, "table.csv".into())),
            measured,
            ..DataSheets::default()
        }
    }

    /// The tolerances of a fit that needs every curve would be 0 or arbitrary.
    #[test]
    fn two_curves_have_the_tolerances_of_a_type_or_are_refused() {
        let (text, summary) = sheets(&[400, 500], false)
            .rig(&Rig::template())
            .expect("a rig");
        for key in KEYS.iter().take(3) {
            let new = summary.values.iter().find(|new| new.key == key.name);
            let new = new.expect("a fitted value");
            let default = key.tolerance.expect("a tolerance").relative_sigma;
            assert_eq!(
                (new.relative_sigma, new.tolerance_source),
                (default, OF_TYPE)
            );
        }
        assert!(text.contains("table.csv does not tell how well"), "{text}");
        let error = sheets(&[400, 500], true).rig(&Rig::template());
        let error = error.expect_err("no tolerances").to_string();
        let says = "table.csv: expected curves at three pressures and three contractions or more";
        assert!(error.contains(says), "{error}");
    }

    #[test]
    fn the_fitted_tolerances_are_named() {
        let pressures_kpa = [200, 300, 400, 500];
        for (measured, says) in [
            (
                true,
                "alpha_m2, beta_m2, gamma_n are those of the fit; the others are",
            ),
            (
                false,
                "alpha_m2, beta_m2, gamma_n are those of the fit and of muscles of one type;",
            ),
        ] {
            let sheets = sheets(&pressures_kpa, measured);
            let (_, summary) = sheets.rig(&Rig::template()).expect("a rig");
            let sentences = summary.sentences.join(" ");
            assert!(sentences.contains(says), "{sentences}");
        }
    }
}

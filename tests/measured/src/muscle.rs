//! Pneumatic muscles on a bench, and similar actuators.

use crate::{Found, Outcome, set_of};
use hil_sim::error::BadInput;
use hil_sim::identify::diagnosis::{Diagnosed, Options, diagnose};
use hil_sim::record::{FORCE_N, Record};
use hil_sim::report::{Axis, Plot, Role, Series};
use hil_sim::rig::Rig;
use muscle_plant::effects::Catalogue;
use std::path::Path;
use std::time::Instant;

/// Sizes that are published, by effect.
const PUBLISHED: [(&str, &str); 10] = [
    (
        "bladder-elasticity",
        "20 to 250 N below Eq 1 at some contraction",
    ),
    ("dead-band", "8 to 40 kPa"),
    ("line-dynamics", "1 to 20 ms, ringing at 5 to 50 Hz"),
    ("creep", "8 to 19 N per decade of seconds"),
    ("run-in", "2 to 10 % of force"),
    ("hysteresis", "11 to 13 % of force range"),
    ("pressure-sensor-offset", "1 to 3 % of span"),
    ("pressure-sensor-gain", "1 to 3 % of span"),
    ("pressure-sensor-drift", "some 100 Pa/s in a bad one"),
    ("contraction-sensor-offset", "0.002 to 0.02"),
];

/// A set: which runs of which muscle are fitted, and which are held out.
struct Set {
    name: &'static str,
    folder: &'static str,
    diameter_m: f64,
    length_m: f64,
    prefix: &'static str,
    fit: &'static [&'static str],
    validate: &'static [&'static str],
}

const M20: Set = Set {
    name: "",
    folder: "pam_isometric_20mm",
    diameter_m: 0.02,
    length_m: 0.275,
    prefix: "d20_cut30cm_",
    fit: &[
        "unkinked_test5",
        "kinked14mm_test5",
        "kinked23mm_test5",
        "kinked34mm_test5",
    ],
    validate: &[],
};

const M10: Set = Set {
    name: "",
    folder: "pam_isometric_10mm",
    diameter_m: 0.01,
    length_m: 0.2,
    prefix: "d10_cut",
    fit: &[],
    validate: &[],
};

const SETS: [Set; 9] = [
    Set {
        name: "20 mm muscle, four lengths, run in",
        validate: &["unkinked_test9", "kinked23mm_test9"],
        ..M20
    },
    Set {
        name: "20 mm muscle, four lengths, against its first runs",
        validate: &[
            "unkinked_test1",
            "kinked14mm_test1",
            "kinked14mm_test2",
            "kinked34mm_test1",
        ],
        ..M20
    },
    Set {
        name: "20 mm muscle at rest length",
        fit: &["unkinked_test5"],
        validate: &["unkinked_test1", "unkinked_test9"],
        ..M20
    },
    Set {
        name: "20 mm muscle, 5 % contracted, first run and second",
        fit: &["kinked14mm_test1"],
        validate: &["kinked14mm_test2"],
        ..M20
    },
    Set {
        name: "20 mm muscle, 12 % contracted",
        fit: &["kinked34mm_test5"],
        validate: &["kinked34mm_test1"],
        ..M20
    },
    Set {
        name: "10 mm muscle at rest length, fast steps",
        fit: &["20cm_kink0_test8"],
        validate: &["20cm_kink0_test10"],
        ..M10
    },
    Set {
        name: "10 mm muscle of 20 cm, four lengths",
        fit: &[
            "20cm_kink0_test10",
            "20cm_kink25_test10",
            "20cm_kink75_test10",
        ],
        validate: &["20cm_kink50_test10", "20cm_kink0_test8"],
        ..M10
    },
    Set {
        name: "10 mm muscle of 30 cm, four lengths",
        length_m: 0.3,
        fit: &[
            "30cm_kink0_test10",
            "30cm_kink25_test10",
            "30cm_kink75_test8",
        ],
        validate: &["30cm_kink50_test10"],
        ..M10
    },
    Set {
        name: "coiled muscle (cavatappi) under three weights",
        folder: "cavatappi_isotonic",
        diameter_m: 1e-3,
        length_m: 0.1,
        prefix: "",
        fit: &["sample1_100g", "sample1_500g"],
        validate: &["sample1_300g"],
    },
];

/// Sets without the signals that a diagnosis needs: the message of the tool is their outcome.
const REFUSED: [(&str, &str, &str); 3] = [
    (
        "20 mm muscle, filled: pressure alone",
        "pam_fill_leak_20mm",
        "fill_1",
    ),
    (
        "20 mm muscle, shut off for 120 s: pressure alone",
        "pam_fill_leak_20mm",
        "leak_1",
    ),
    (
        "10 mm muscle, force sensor without pressure",
        "pam_isometric_10mm",
        "d10_cut20cm_kink0_offset",
    ),
];

/// Angle between the threads of a braid at rest and its axis \[rad\]: 20° to 30° are made (Tondu
/// 2012), which α and β of half their size each way hold.
const BRAID_ANGLE_RAD: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// γ over α of the paper's muscle \[N/m²\]: how much goes into the bladder.
const GAMMA_OVER_ALPHA_N_PER_M2: f64 = -183.0 / 3.7718e-3;

impl Set {
    /// A rig of known geometry and unknown force law: α = A·3/tan²θ and β = −A/sin²θ of an ideal
    /// braid (Chou & Hannaford 1996; Tondu & Lopez 2000), A being its cross-section at rest.
    fn rig(&self) -> Result<Rig, BadInput> {
        let area_m2 = std::f64::consts::FRAC_PI_4 * self.diameter_m * self.diameter_m;
        let alpha_m2 = 3.0 * area_m2 / BRAID_ANGLE_RAD.tan().powi(2);
        let beta_m2 = -area_m2 / BRAID_ANGLE_RAD.sin().powi(2);
        let gamma_n = GAMMA_OVER_ALPHA_N_PER_M2 * alpha_m2;
        let text = format!(
            "schema = 1\n[muscle]\nalpha_m2 = {alpha_m2:?}\nbeta_m2 = {beta_m2:?}\n\
             gamma_n = {gamma_n:?}\ninitial_length_m = {:?}\n[load]\nkind = \"prescribed\"\n\
             [tolerance.muscle]\nalpha_m2 = 0.5\nbeta_m2 = 0.5\ngamma_n = 0.5\n",
            self.length_m
        );
        Rig::parse(self.name, &text)
    }

    fn records(&self, folder: &Path, names: &[&str]) -> Result<Vec<Record>, BadInput> {
        let path = |name: &&str| folder.join(format!("{}{name}.csv", self.prefix));
        names.iter().map(|name| Record::read(&path(name))).collect()
    }

    fn outcome(&self, folder: &Path) -> Result<Outcome, BadInput> {
        let begin = Instant::now();
        let rig = self.rig()?;
        let (fit, validate) = (
            self.records(folder, self.fit)?,
            self.records(folder, self.validate)?,
        );
        let everything: Vec<String> = Catalogue::standard()
            .kinds()
            .map(|kind| kind.name.into())
            .collect();
        let run = |without: Vec<String>| {
            let options = Options {
                // Calibrated values alone.
                no_formula: !without.is_empty(),
                without,
                ..Options::default()
            };
            diagnose(&rig, &fit, &validate, &options, &|_| ())
        };
        let full = run(Vec::new())?;
        let spent_s = begin.elapsed().as_secs_f64();
        let alone = run(everything)?;
        let of = |from: &Diagnosed| from.diagnosis.gap_of(FORCE_N).copied();
        let (Some(gap), Some(gap_alone)) = (of(&full), of(&alone)) else {
            return Err(rig.bad_file("records with a force"));
        };
        let forces_n = || {
            validate
                .iter()
                .filter_map(|record| record.column(FORCE_N))
                .flatten()
        };
        let range_n = forces_n().copied().fold(f64::NEG_INFINITY, f64::max)
            - forces_n().copied().fold(f64::INFINITY, f64::min);
        let words = |names: &[&str]| names.iter().map(|name| (*name).into()).collect();
        let diagnosis = &full.diagnosis;
        let remaining = &diagnosis.remaining;
        Ok(Outcome {
            set: self.name.into(),
            fitted: words(self.fit),
            held_out: words(self.validate),
            signal: FORCE_N,
            unit: "N",
            range: range_n,
            calibrated: gap_alone.after,
            after: gap.after,
            noise: gap.noise,
            verdict: diagnosis.verdict.name().into(),
            effects: found(&full),
            remains: match remaining.places.is_empty() {
                true => String::new(),
                false => format!(
                    "Left in {}: {}.",
                    remaining.places.join(", "),
                    remaining.when
                ),
            },
            next_experiment: diagnosis.next_experiment.clone(),
            warnings: diagnosis.warnings.clone(),
            spent_s,
            plots: plots(&validate[0], &alone.free_runs[0][1], &full.free_runs[0][1]),
        })
    }
}

/// A value with its significant digits.
fn significant(value: f64) -> String {
    match value.abs() {
        size if size == 0.0 || (1e-2..1e6).contains(&size) => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}

fn found(diagnosed: &Diagnosed) -> Vec<Found> {
    let of = |named: &hil_sim::identify::diagnosis::Named| {
        let sizes = named.parameters.iter().map(|(name, estimate)| {
            let ends = [estimate.value, estimate.ci95[0], estimate.ci95[1]];
            let [value, least, most] = ends.map(significant);
            format!("{name} {value} ({least} to {most})")
        });
        let sizes: Vec<String> = sizes.collect();
        let known = PUBLISHED.iter().find(|(name, _)| *name == named.name);
        Found {
            name: named.name.into(),
            size: sizes.join(", "),
            published: known.map_or("", |(_, words)| words),
            alternatives: named.alternatives.clone(),
        }
    };
    diagnosed.diagnosis.effects.iter().map(of).collect()
}

fn plots(measured: &Record, alone: &Record, full: &Record) -> Vec<Plot> {
    let force_n = |record: &Record| record.column(FORCE_N).unwrap_or_default().to_vec();
    let line = |name: &str, record| Series::thinned(name, measured.time_s(), &force_n(record));
    vec![Plot {
        title: "Force on the first held-out record".into(),
        caption: String::new(),
        x: Axis::new("time", "s", 1.0),
        y: Axis::new("force", "N", 1.0),
        series: vec![
            line("measured", measured).role(Role::Measured),
            line("Eq 1 alone, calibrated", alone)
                .role(Role::Nominal)
                .dashed(),
            line("as fitted", full).role(Role::Fitted).dashed(),
        ],
        markers: Vec::new(),
        sync: None,
    }]
}

/// All sets of muscles.
pub fn all(folder: &Path) -> Vec<Outcome> {
    let mut outcomes = Vec::new();
    for set in &SETS {
        let Some(folder) = set_of(folder, set.folder) else {
            continue;
        };
        let outcome = set.outcome(&folder);
        outcomes.push(outcome.unwrap_or_else(|why| Outcome::refused(set.name, why.to_string())));
    }
    for (name, set, file) in REFUSED {
        let Some(folder) = set_of(folder, set) else {
            continue;
        };
        let refusal = |record: Record| hil_sim::record::check::check(&record).refuse(&record);
        let read = Record::read(&folder.join(format!("{file}.csv")));
        let why = match read.and_then(refusal) {
            Ok(()) => "Fit for a diagnosis, but of nothing: no pressure moves.".into(),
            Err(why) => why.to_string(),
        };
        outcomes.push(Outcome::refused(name, why));
    }
    outcomes
}

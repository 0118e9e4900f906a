//! The diagnosis as a person reads it.

use super::diagnosis::{self, Diagnosed, Diagnosis, Named};
use crate::identify::gap::{SIGNALS, significant};
use crate::record::Record;
use crate::report::{Axis, Plot, Report, Role, Section, Series, Table};
use model_discrepancy::left::Profile;
use model_discrepancy::verdict::Verdict;

/// Candidates that are shown.
const SHOWN: usize = 12;

/// A value with its unit, in digits one can read.
fn quantity(value: f64, unit: &str) -> String {
    let size = value.abs();
    let number = if size != 0.0 && !(1e-3..1e6).contains(&size) {
        format!("{value:.2e}")
    } else {
        significant(value)
    };
    if unit == "1" {
        number
    } else {
        format!("{number} {unit}")
    }
}

/// Share of the gap above the noise that is gone, the median over signals that had one.
fn removed(diagnosis: &Diagnosis) -> Option<f64> {
    let above = |gap: f64, noise: f64| (gap * gap - noise * noise).max(0.0).sqrt();
    let gaps = diagnosis.gap.values();
    let seen = gaps.filter(|gap| gap.before > 1.2 * gap.noise);
    let shares = seen.map(|g| 1.0 - above(g.after, g.noise) / above(g.before, g.noise));
    let mut shares: Vec<f64> = shares.collect();
    shares.sort_by(f64::total_cmp);
    shares.get(shares.len() / 2).copied()
}

fn named(effect: &Named) -> String {
    let parameters = effect.parameters.iter().map(|(name, estimate)| {
        let name = name
            .strip_suffix(&key_unit(estimate.unit))
            .unwrap_or(name)
            .replace('_', " ");
        format!("{name} {}", quantity(estimate.value, estimate.unit))
    });
    let parameters: Vec<String> = parameters.collect();
    if parameters.is_empty() {
        effect.name.into()
    } else {
        format!("{} ({})", effect.name, parameters.join(", "))
    }
}

/// A unit as it stands at the end of a key.
fn key_unit(unit: &str) -> String {
    let word = unit
        .to_lowercase()
        .replace("·", "_")
        .replace("/(", "_per_")
        .replace('/', "_per_");
    format!(
        "_{}",
        word.replace([')', '('], "")
            .replace('³', "3")
            .replace('²', "2")
    )
}

/// What was found, in sentences; the first is the headline.
pub fn sentences(diagnosis: &Diagnosis) -> Vec<String> {
    let gone = removed(diagnosis).filter(|share| *share > 0.0);
    let gone = gone.map(|share| format!("{:.0} % of the gap", 100.0 * share));
    let mut said = vec![match diagnosis.verdict {
        Verdict::Consistent => {
            let gone = gone.map(|gone| format!(" Calibrating it removes {gone}."));
            format!(
                "Consistent: within its tolerances the nominal model explains the records.{}",
                gone.unwrap_or_default()
            )
        }
        Verdict::Explained => {
            let names: Vec<String> = diagnosis.effects.iter().map(named).collect();
            let gone = gone.map(|gone| format!("; adding it removes {gone}"));
            format!(
                "The rig shows {}{}.",
                names.join(" and "),
                gone.unwrap_or_default()
            )
        }
        Verdict::Unexplained => format!(
            "Unexplained: something is left in {} that no known effect explains, {}.",
            diagnosis.remaining.places.join(" and "),
            diagnosis.remaining.when
        ),
    }];
    for effect in &diagnosis.effects {
        if !effect.alternatives.is_empty() {
            let others = effect.alternatives.join(" or ");
            said.push(format!(
                "These records cannot tell {} from {others}.",
                effect.name
            ));
        }
    }
    said.extend(
        diagnosis
            .warnings
            .iter()
            .map(|warning| format!("Note: {warning}.")),
    );
    said.push(format!("Next experiment: {}", diagnosis.next_experiment));
    said
}

fn gap_table(diagnosis: &Diagnosis) -> Table {
    let shown = |name: &str| SIGNALS.iter().find(|signal| signal.0 == name);
    let row = |(name, gap): (&&'static str, &diagnosis::GapOf)| {
        let (_, label, unit, factor) = shown(name)?;
        let values = [gap.before, gap.after, gap.noise];
        let cells = values.map(|value| format!("{} {unit}", significant(factor * value)));
        Some([vec![(*label).to_string()], cells.to_vec()].concat())
    };
    let columns = ["signal", "nominal rig", "fitted rig", "noise"];
    Table {
        caption:
            "Root mean square of simulated − measured over the validation records, which were \
                  never fitted"
                .into(),
        columns: columns.map(String::from).to_vec(),
        rows: diagnosis.gap.iter().filter_map(row).collect(),
    }
}

/// Each signal of a validation record, measured and as both rigs run freely.
fn over_time(measured: &Record, runs: &[Record; 2], number: usize) -> Vec<Plot> {
    let time_s = measured.time_s();
    let plot = |signal: &(&str, &str, &str, f64)| {
        let (name, label, unit, factor) = *signal;
        let was = measured.column(name)?;
        let [nominal, fitted] = [0, 1].map(|place| runs[place].column(name));
        let (nominal, fitted) = (nominal?, fitted?);
        // An input comes out as it came.
        if nominal == was && fitted == was {
            return None;
        }
        let plot = |title: String, series: Vec<Series>| Plot {
            title,
            caption: String::new(),
            x: Axis::new("time", "s", 1.0),
            y: Axis::new(label, unit, factor),
            series,
            markers: Vec::new(),
            sync: Some(format!("validation {number}")),
        };
        let gap = |name: &str, role: Role, is: &[f64]| {
            let gap: Vec<f64> = is.iter().zip(was).map(|(is, was)| is - was).collect();
            Series::thinned(name, time_s, &gap).role(role)
        };
        let lines = vec![
            Series::thinned("measured", time_s, was).role(Role::Measured),
            Series::thinned("nominal rig", time_s, nominal)
                .role(Role::Nominal)
                .dashed(),
            Series::thinned("fitted rig", time_s, fitted)
                .role(Role::Fitted)
                .dashed(),
        ];
        let gaps = vec![
            gap("nominal rig", Role::Nominal, nominal),
            gap("fitted rig", Role::Fitted, fitted),
        ];
        Some([
            plot(format!("Validation record {number}: {label}"), lines),
            plot(format!("Its gap in {label}, simulated − measured"), gaps),
        ])
    };
    SIGNALS.iter().filter_map(plot).flatten().collect()
}

/// Mean square residual of a block against a coordinate.
fn against(block: &str, before: &Profile, after: &Profile) -> Plot {
    let line = |name: &str, profile: &Profile| {
        let middle = |bin: &[f64; 3]| 0.5 * (bin[0] + bin[1]);
        let x = profile.bins.iter().map(middle).collect();
        Series::new(
            name,
            x,
            profile.bins.iter().map(|bin| bin[2].sqrt()).collect(),
        )
    };
    let (unit, factor) = match before.unit {
        "Pa" => ("kPa", 1e-3),
        unit => (unit, 1.0),
    };
    Plot {
        title: format!("{block}: residual against {}", before.coordinate),
        caption: "Root mean square in units of the noise".into(),
        x: Axis::new(before.coordinate, unit, factor),
        y: Axis::new("residual", "σ", 1.0),
        series: vec![
            line("nominal, calibrated", before).role(Role::Nominal),
            line("fitted", after).role(Role::Fitted).dashed(),
        ],
        markers: Vec::new(),
        sync: None,
    }
}

fn effect_table(diagnosis: &Diagnosis) -> Table {
    let rows = diagnosis.effects.iter().flat_map(|effect| {
        effect.parameters.iter().map(move |(name, estimate)| {
            let [low, high] = estimate.ci95.map(|end| quantity(end, estimate.unit));
            vec![
                effect.name.into(),
                effect.form.into(),
                (*name).into(),
                quantity(estimate.value, estimate.unit),
                format!("{low} to {high}"),
            ]
        })
    });
    let columns = ["effect", "form", "parameter", "value", "95 % interval"];
    Table {
        caption: "What is missing from the nominal model".into(),
        columns: columns.map(String::from).to_vec(),
        rows: rows.collect(),
    }
}

fn tried_table(diagnosis: &Diagnosis) -> Table {
    let best = diagnosis
        .tried
        .first()
        .map_or(0.0, |tried| tried.cost.iter().sum());
    let row = |tried: &diagnosis::Tried| {
        let names = tried.effects.join(" + ");
        let sum: f64 = tried.cost.iter().sum();
        vec![
            if names.is_empty() {
                "none".into()
            } else {
                names
            },
            format!("{:.0}", tried.cost[0]),
            format!("{:.0}", tried.cost[1]),
            format!("{:+.0}", sum - best),
        ]
    };
    let columns = ["effects", "cost fitted", "cost predicted", "above the best"];
    Table {
        caption: "Half the sum of squared residuals in units of the noise; small differences mean \
                  that the records cannot tell"
            .into(),
        columns: columns.map(String::from).to_vec(),
        rows: diagnosis.tried.iter().take(SHOWN).map(row).collect(),
    }
}

fn calibrated_table(diagnosis: &Diagnosis) -> Table {
    let row = |value: &super::muscle::Calibrated| {
        let [nominal, fitted] = value.values.map(|value| quantity(value, "1"));
        vec![
            value.key.clone(),
            nominal,
            fitted,
            format!("{:+.1} σ", value.deviation),
        ]
    };
    let columns = ["value", "nominal", "calibrated", "moved by"];
    Table {
        caption: "Nominal values, calibrated within their tolerances".into(),
        columns: columns.map(String::from).to_vec(),
        rows: diagnosis.calibrated.iter().map(row).collect(),
    }
}

/// What is missing, why, and what else it could be.
fn missing(diagnosed: &Diagnosed) -> Section {
    let diagnosis = &diagnosed.diagnosis;
    let marks = diagnosis.effects.iter().map(|effect| {
        let evidence = &effect.evidence;
        format!(
            "{} ({}): {} Without it the cost is {:.0}, with it {:.0}. {} \
             Leaves out {}.",
            effect.name,
            effect.place,
            evidence.mark,
            evidence.cost_without,
            evidence.cost,
            evidence.source,
            evidence.leaves_out
        )
    });
    let others = diagnosis
        .effects
        .iter()
        .flat_map(|effect| &effect.alternatives);
    let others = others.filter_map(|name| diagnosed.fitted.catalogue.find(name));
    let others = others.map(|kind| format!("It could also be {}: {}", kind.name, kind.signature));
    let mut section = Section {
        heading: "What is missing".into(),
        text: marks.chain(others).collect(),
        ..Section::default()
    };
    if !diagnosis.effects.is_empty() {
        section.tables.push(effect_table(diagnosis));
    }
    section
}

/// The report of a diagnosis; `rig_toml` is the fitted rig's file.
pub fn report(diagnosed: &Diagnosed, validate: &[Record], rig_toml: &str) -> Report {
    let diagnosis = &diagnosed.diagnosis;
    let mut gap = Section {
        heading: "The gap".into(),
        tables: vec![gap_table(diagnosis)],
        ..Section::default()
    };
    for (number, (record, runs)) in validate.iter().zip(&diagnosed.free_runs).enumerate() {
        gap.plots.extend(over_time(record, runs, number + 1));
    }
    let mut where_it_lives = Section {
        heading: "Where the residual lives".into(),
        text: vec![
            "Each block is run alone on measured inputs; its residual is what it misses then, in \
             units of the noise. One is as good as the sensors."
                .into(),
        ],
        ..Section::default()
    };
    for block in &diagnosis.blocks {
        let [before, after] = &block.profiles;
        let pairs = before.iter().zip(after);
        where_it_lives
            .plots
            .extend(pairs.map(|(b, a)| against(block.block, b, a)));
    }
    let stages = diagnosis
        .stages
        .iter()
        .map(|s| format!("{} {:.1} s", s.stage, s.spent_s));
    let stages: Vec<String> = stages.collect();
    Report {
        title: "Diagnosis".into(),
        verdict: sentences(diagnosis),
        sections: vec![
            gap,
            missing(diagnosed),
            where_it_lives,
            Section {
                heading: "What was tried".into(),
                text: vec![format!("Time spent: {}.", stages.join(", "))],
                tables: vec![tried_table(diagnosis), calibrated_table(diagnosis)],
                ..Section::default()
            },
            Section {
                heading: "The fitted rig".into(),
                text: vec!["rig.fitted.toml, which every command takes.".into()],
                code: rig_toml.into(),
                ..Section::default()
            },
        ],
        repeat: Vec::new(),
    }
}

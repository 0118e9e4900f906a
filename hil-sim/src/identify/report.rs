//! The diagnosis as a person reads it.

use super::diagnosis::{Diagnosis, GapOf, Hypothesis, Named};
use super::formula::Formula;
use crate::error::significant;
use crate::identify::gap::{SIGNALS, Signal};
use crate::record::Record;
use crate::report::{Axis, Marker, Plot, Report, Role, Section, Series, Table};
use model_discrepancy::left::Profile;
use model_discrepancy::verdict::Verdict;
use muscle_plant::effects::Catalogue;

/// Sets that are shown in the table, and in words.
const SHOWN: usize = 12;
const SHOWN_IN_WORDS: usize = 4;
/// Names of the directions of a motion.
const DIRECTIONS: [(f64, &str); 3] = [(-1.0, "extending"), (0.0, "at rest"), (1.0, "contracting")];

/// A value with its unit, in digits one can read.
pub(crate) fn quantity(value: f64, unit: &str) -> String {
    let (value, unit) = said(value, unit);
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

/// A value in the unit in which one says it: kPa, mm, ms.
fn said(value: f64, unit: &str) -> (f64, &str) {
    let size = value.abs();
    match unit {
        "Pa" if size >= 1e3 => (value * 1e-3, "kPa"),
        "Pa/s" if size >= 1e3 => (value * 1e-3, "kPa/s"),
        "m" if size < 1.0 => (value * 1e3, "mm"),
        "s" if size < 0.1 => (value * 1e3, "ms"),
        _ => (value, unit),
    }
}

/// A signal's gap in the unit of reports.
fn gap_size(signal: &Signal, value: f64) -> String {
    let (_, _, unit, factor) = signal;
    format!("{} {unit}", significant(factor * value))
}

/// Each compared signal with its gap, the worst first.
fn gaps(diagnosis: &Diagnosis) -> impl Iterator<Item = (&'static Signal, &GapOf)> {
    let signal = |name: &str| SIGNALS.iter().find(|signal| signal.0 == name);
    let gaps = diagnosis.gap.iter();
    gaps.filter_map(move |(name, gap)| Some((signal(name)?, gap)))
}

/// What the fitted rig does to the gap of each signal, the worst first; none if no signal had a
/// gap.
fn gap_in_words(diagnosis: &Diagnosis) -> Option<String> {
    let (worse, better): (Vec<_>, Vec<_>) = gaps(diagnosis).partition(|(_, gap)| gap.is_worse());
    let worse = worse.into_iter().map(|(signal, gap)| {
        let [after, before] = [gap.after, gap.before].map(|value| gap_size(signal, value));
        let name = signal.1;
        format!("predicts {name} worse ({after} RMS, nominal rig {before})")
    });
    let better = better
        .into_iter()
        .filter_map(|(signal, gap)| Some((100.0 * gap.removed?, signal.1)));
    let mut words: Vec<String> = worse.collect();
    let better = better.enumerate().map(|(place, (removed, name))| {
        let of_what = if place == 0 {
            " of the gap above the noise"
        } else {
            ""
        };
        format!("{removed:.0} %{of_what} in {name}")
    });
    let better: Vec<String> = better.collect();
    if !better.is_empty() {
        words.push(format!("removes {}", better.join(" and ")));
    }
    (!words.is_empty()).then(|| {
        let words = words.join(" and ");
        format!("on the validation records the fitted rig {words}")
    })
}

/// The parameters of a named effect with their intervals, as one sentence.
fn parameters(effect: &Named) -> Option<String> {
    let parameters = effect.parameters.iter().map(|(name, estimate)| {
        let name = name
            .strip_suffix(&key_unit(estimate.unit))
            .unwrap_or(name)
            .replace('_', " ");
        let [low, high] = estimate.ci95.map(|end| quantity(end, estimate.unit));
        let value = quantity(estimate.value, estimate.unit);
        format!("{name} {value} ({low} to {high})")
    });
    let parameters: Vec<String> = parameters.collect();
    let listed = || format!("{}: {}.", effect.name, parameters.join(", "));
    (!parameters.is_empty()).then(listed)
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

/// A part of a sentence behind a comma, if there is one.
fn with_comma(words: &str) -> String {
    if words.is_empty() {
        String::new()
    } else {
        format!(", {words}")
    }
}

/// A set of effects and unknowns in words.
fn set_in_words(hypothesis: &Hypothesis) -> String {
    let effects = hypothesis.effects.iter().map(|name| (*name).to_owned());
    let unknown = hypothesis.unknown.join(" or ");
    let unknown = (!unknown.is_empty()).then(|| format!("unknown in {unknown}"));
    let all: Vec<String> = effects.chain(unknown).collect();
    if all.is_empty() {
        "no effect".into()
    } else {
        all.join(" + ")
    }
}

/// A probability, rounded away from certainty.
fn percent(probability: f64) -> String {
    match 100.0 * probability {
        percent if percent > 99.9 => "> 99.9 %".into(),
        percent if percent < 0.1 => "< 0.1 %".into(),
        percent => format!("{percent:.1} %"),
    }
}

/// The most probable sets.
fn posterior_in_words(diagnosis: &Diagnosis) -> String {
    let shown = diagnosis.hypotheses.iter().take(SHOWN_IN_WORDS);
    let shown = shown.map(|own| format!("{} {}", set_in_words(own), percent(own.probability)));
    let shown: Vec<String> = shown.collect();
    format!("Probabilities: {}.", shown.join(", "))
}

/// What a formula adds, how much of the gap it removes, and where it holds.
fn formula_in_words(formula: &Formula) -> String {
    let terms = formula.terms.iter().map(|term| {
        let values = term.parameters.iter().map(|(name, own)| {
            let [low, high] = own.ci95.map(significant);
            format!(
                "{name} = {} {} ({low} to {high})",
                significant(own.value),
                own.unit
            )
        });
        let constants = term.constants.iter();
        let constants = constants
            .map(|(name, own)| format!("{name} = {} {}", significant(own.value), own.unit));
        let values: Vec<_> = values.chain(constants).collect();
        let certain = percent(term.probability);
        format!("{} ({certain}): {}", term.expression, values.join(", "))
    });
    let removed = formula.removed.iter().filter_map(|(signal, share)| {
        let share = share.as_ref()?;
        Some(format!(
            "{:.0} % of what was left of {signal}",
            100.0 * share
        ))
    });
    let supported = formula.supported.iter();
    let supported = supported.map(|(input, [low, high])| {
        format!(
            "{input} from {} to {}",
            significant(*low),
            significant(*high)
        )
    });
    let removed: Vec<_> = removed.collect();
    let removes = match removed.as_slice() {
        // Where the gap was hardly above the noise there is no share.
        [] => String::new(),
        shares => format!(
            "It removes {} on records that were not fitted. ",
            shares.join(" and ")
        ),
    };
    format!(
        "No name, but a formula, which rig.fitted.toml has: {}. {removes}It holds for {}.",
        terms.collect::<Vec<_>>().join("; "),
        supported.collect::<Vec<_>>().join(", ")
    )
}

/// What was found, in sentences; the first is the headline.
pub fn sentences(diagnosis: &Diagnosis) -> Vec<String> {
    let gaps = gap_in_words(diagnosis).map_or_else(String::new, |words| format!("; {words}"));
    let mut said = vec![match diagnosis.verdict {
        Verdict::Consistent => format!(
            "Consistent: within its tolerances the nominal model explains the records{gaps}."
        ),
        Verdict::Explained => {
            let names: Vec<&str> = diagnosis.effects.iter().map(|e| e.name).collect();
            format!("The rig shows {}{gaps}.", names.join(" and "))
        }
        Verdict::Partial => {
            let names: Vec<&str> = diagnosis.effects.iter().map(|e| e.name).collect();
            format!(
                "The rig shows {}, and something else is left in {}{}{gaps}.",
                names.join(" and "),
                diagnosis.remaining.places.join(" and "),
                with_comma(&diagnosis.remaining.when)
            )
        }
        Verdict::Unexplained => format!(
            "Unexplained: something is left in {} that no known effect explains{}{gaps}.",
            diagnosis.remaining.places.join(" and "),
            with_comma(&diagnosis.remaining.when)
        ),
    }];
    said.push(posterior_in_words(diagnosis));
    said.extend(diagnosis.effects.iter().filter_map(parameters));
    for effect in &diagnosis.effects {
        if !effect.alternatives.is_empty() {
            let others = effect.alternatives.join(" or ");
            said.push(format!(
                "These records cannot tell {} from {others}.",
                effect.name
            ));
        }
    }
    said.extend(diagnosis.formula.as_ref().map(formula_in_words));
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
    let row = |(signal, gap): (&Signal, &GapOf)| {
        let [before, after, noise] =
            [gap.before, gap.after, gap.noise].map(|value| gap_size(signal, value));
        let removed = match gap.removed {
            _ if gap.is_worse() => "worse".into(),
            Some(removed) => format!("{:.0} %", 100.0 * removed),
            None => "at the noise".into(),
        };
        vec![signal.1.into(), before, after, noise, removed]
    };
    let columns = ["signal", "nominal rig", "fitted rig", "noise", "removed"];
    Table {
        caption:
            "Root mean square of simulated − measured over the validation records, which were \
                  never fitted, and the share of it above the noise that is removed; the worst \
                  first"
                .into(),
        columns: columns.map(String::from).to_vec(),
        rows: gaps(diagnosis).map(row).collect(),
    }
}

/// Each signal of a record, measured and as both rigs run freely.
fn over_time(
    diagnosis: &Diagnosis,
    measured: &Record,
    runs: &[Record; 2],
    record: &str,
) -> Vec<Plot> {
    let time_s = measured.time_s();
    let plot = |signal: &Signal| {
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
            sync: Some(record.into()),
        };
        let noise = diagnosis.gap_of(name).map_or(0.0, |gap| gap.noise);
        let gap = |name: &str, role: Role, is: &[f64]| {
            let gap: Vec<f64> = is.iter().zip(was).map(|(is, was)| is - was).collect();
            Series::thinned(name, time_s, &gap).role(role)
        };
        let lines = vec![
            Series::thinned("measured ± 2 σ of its noise", time_s, was)
                .role(Role::Measured)
                .band(2.0 * noise),
            Series::thinned("nominal rig", time_s, nominal)
                .role(Role::Nominal)
                .dashed(),
            Series::thinned("fitted rig", time_s, fitted)
                .role(Role::Fitted)
                .dashed(),
        ];
        let gaps = vec![
            Series::thinned("± 2 σ of the noise", time_s, &vec![0.0; time_s.len()])
                .role(Role::Noise)
                .band(2.0 * noise),
            gap("nominal rig", Role::Nominal, nominal),
            gap("fitted rig", Role::Fitted, fitted),
        ];
        Some([
            plot(format!("{record}: {label}"), lines),
            plot(format!("Its gap in {label}, simulated − measured"), gaps),
        ])
    };
    SIGNALS.iter().filter_map(plot).flatten().collect()
}

fn coordinate_axis(coordinate: &str, unit: &str) -> Axis {
    let (unit, factor) = match (coordinate, unit) {
        (_, "Pa") => ("kPa", 1e-3),
        (_, "Pa/s") => ("kPa/s", 1e-3),
        ("contraction", _) => ("%", 100.0),
        ("rate", _) => ("%/s", 100.0),
        (_, unit) => (unit, 1.0),
    };
    Axis::new(coordinate, unit, factor)
}

/// Mean square residual of a block against a coordinate.
fn against(block: &str, before: &Profile, after: &Profile) -> Plot {
    let directions = before.coordinate == "direction";
    let line = |name: &str, profile: &Profile| {
        let bins = profile.bins.iter();
        let mut points: Vec<(f64, f64)> = bins
            .map(|[from, to, square]| (0.5 * (from + to), square.sqrt()))
            .collect();
        if directions {
            // Room beside the outermost.
            points.insert(0, (-1.5, f64::NAN));
            points.push((1.5, f64::NAN));
        }
        let (x, y) = points.into_iter().unzip();
        let line = Series::new(name, x, y);
        if directions { line.points() } else { line }
    };
    let axis = coordinate_axis(before.coordinate, before.unit);
    let axis = if directions {
        axis.named(DIRECTIONS.to_vec())
    } else {
        axis
    };
    Plot {
        title: format!("{block}: residual against {}", before.coordinate),
        caption: "Root mean square in units of the noise".into(),
        x: axis,
        y: Axis::new("residual", "σ", 1.0),
        series: vec![
            line("nominal, calibrated", before).role(Role::Nominal),
            line("fitted", after).role(Role::Fitted).dashed(),
        ],
        markers: vec![Marker {
            vertical: false,
            value: 1.0,
            label: "noise".into(),
        }],
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

/// How large a named effect is over a quantity, beside its form.
fn shape_plot(effect: &Named) -> Option<Plot> {
    let shape = effect.shape.as_ref()?;
    let series = |name: &str, values: &[f64]| Series::new(name, shape.at.clone(), values.to_vec());
    let ends = |sign: f64| -> Vec<f64> {
        let pairs = shape.value.iter().zip(&shape.sd);
        pairs.map(|(value, sd)| value + sign * 1.96 * sd).collect()
    };
    Some(Plot {
        title: format!("{}: size over {}", effect.name, shape.coordinate),
        caption: format!(
            "In the size that the form {} has with its parameters, and its 95 % interval",
            effect.form
        ),
        x: coordinate_axis(shape.coordinate, shape.unit),
        y: Axis::new("size", "1", 1.0),
        series: vec![
            series("form", &vec![1.0; shape.at.len()]).role(Role::Nominal),
            series("found", &shape.value).role(Role::Fitted),
            series("95 % interval, low", &ends(-1.0))
                .role(Role::Fitted)
                .dashed(),
            series("95 % interval, high", &ends(1.0))
                .role(Role::Fitted)
                .dashed(),
        ],
        markers: Vec::new(),
        sync: None,
    })
}

fn posterior_table(diagnosis: &Diagnosis) -> Table {
    let row = |own: &Hypothesis| vec![set_in_words(own), percent(own.probability)];
    Table {
        caption: "Posterior probabilities of sets of effects, alone and beside something that no \
                  effect of the catalogue explains"
            .into(),
        columns: ["set", "probability"].map(String::from).to_vec(),
        rows: diagnosis.hypotheses.iter().take(SHOWN).map(row).collect(),
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
fn missing(diagnosis: &Diagnosis, catalogue: &Catalogue) -> Section {
    let marks = diagnosis.effects.iter().map(|effect| {
        let evidence = &effect.evidence;
        let gain = evidence.gain_nats.map_or_else(String::new, |nats| {
            format!(" The most probable set without it is less probable by {nats:.0} nats.")
        });
        format!(
            "{} ({}, {}): {}{gain} {} Leaves out {}.",
            effect.name,
            effect.place,
            percent(effect.probability),
            evidence.signature,
            evidence.source,
            evidence.leaves_out
        )
    });
    let others = diagnosis
        .effects
        .iter()
        .flat_map(|effect| &effect.alternatives);
    let others = others.filter_map(|name| catalogue.find(name));
    let others = others.map(|kind| format!("It could also be {}: {}", kind.name, kind.signature));
    let terms = diagnosis.formula.iter().flat_map(|formula| &formula.terms);
    let terms = terms.map(|term| {
        format!(
            "A term without a name, {}: {}.",
            term.place, term.expression
        )
    });
    let mut section = Section {
        heading: "What is missing".into(),
        text: marks.chain(others).chain(terms).collect(),
        ..Section::default()
    };
    if !diagnosis.effects.is_empty() {
        section.tables.push(effect_table(diagnosis));
    }
    section
        .plots
        .extend(diagnosis.effects.iter().filter_map(shape_plot));
    section
}

/// The report of a diagnosis by the effects of `catalogue`, with records, of this name, and their
/// free runs; `rig_toml` is the fitted rig's file, if there is a rig.
pub fn report(
    diagnosis: &Diagnosis,
    catalogue: &Catalogue,
    (name, records, free_runs): (&str, &[Record], &[[Record; 2]]),
    rig_toml: Option<&str>,
) -> Report {
    let mut gap = Section {
        heading: "The gap".into(),
        ..Section::default()
    };
    if !diagnosis.gap.is_empty() {
        gap.tables.push(gap_table(diagnosis));
    }
    for (number, (record, runs)) in records.iter().zip(free_runs).enumerate() {
        let name = format!("{name} {}", number + 1);
        gap.plots.extend(over_time(diagnosis, record, runs, &name));
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
    let fitted = rig_toml.map(|toml| Section {
        heading: "The fitted rig".into(),
        text: vec!["rig.fitted.toml, which every command takes.".into()],
        code: toml.into(),
        ..Section::default()
    });
    Report {
        title: "Diagnosis".into(),
        verdict: sentences(diagnosis),
        sections: vec![
            gap,
            missing(diagnosis, catalogue),
            where_it_lives,
            Section {
                heading: "How probable it is".into(),
                text: vec![format!("Time spent: {}.", stages.join(", "))],
                tables: vec![posterior_table(diagnosis), calibrated_table(diagnosis)],
                ..Section::default()
            },
        ]
        .into_iter()
        .chain(fitted)
        .collect(),
        repeat: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::diagnosis::Remaining;
    use super::*;
    use crate::record::{CONTRACTION, FORCE_N, PRESSURE_PA};

    fn diagnosis(verdict: Verdict, gap: Vec<(&'static str, GapOf)>) -> Diagnosis {
        Diagnosis {
            schema: 2,
            verdict,
            effects: Vec::new(),
            gap,
            remaining: Remaining::default(),
            next_experiment: "none.".into(),
            calibrated: Vec::new(),
            blocks: Vec::new(),
            formula: None,
            hypotheses: Vec::new(),
            warnings: Vec::new(),
            stages: Vec::new(),
        }
    }

    #[test]
    fn the_first_sentence_has_each_signal_and_one_that_got_worse_first() {
        let gaps = vec![
            (FORCE_N, GapOf::new([2.58, 5.79, 0.5])),
            (CONTRACTION, GapOf::new([5e-3, 2.5e-3, 3e-5])),
            (PRESSURE_PA, GapOf::new([9000.0, 250.0, 250.0])),
        ];
        for verdict in [
            Verdict::Consistent,
            Verdict::Explained,
            Verdict::Unexplained,
        ] {
            let diagnosis = diagnosis(verdict, gaps.clone());
            let first = &sentences(&diagnosis)[0];
            let said = "on the validation records the fitted rig predicts force worse (5.790 N \
                        RMS, nominal rig 2.580 N) and removes 50 % of the gap above the noise in \
                        contraction and 100 % in gauge pressure.";
            assert!(first.ends_with(said), "{first}");
            // Programs get them in the same order.
            let json = serde_json::to_string(&diagnosis).expect("JSON");
            let places = gaps.iter().map(|(signal, _)| json.find(signal));
            assert!(places.is_sorted(), "{json}");
        }
    }

    #[test]
    fn a_gap_within_the_noise_has_no_share() {
        let gaps = vec![(PRESSURE_PA, GapOf::new([260.0, 240.0, 250.0]))];
        let diagnosis = diagnosis(Verdict::Consistent, gaps);
        let sentences = sentences(&diagnosis);
        assert!(!sentences[0].contains('%'), "{}", sentences[0]);
        assert_eq!(gap_table(&diagnosis).rows[0][4], "at the noise");
    }

    #[test]
    fn quantities_have_the_unit_that_one_says() {
        for (value, unit, said) in [
            (6e6, "Pa/s", "6000 kPa/s"),
            (20e3, "Pa", "20.00 kPa"),
            (250.0, "Pa", "250.0 Pa"),
            (2.5e-3, "m", "2.500 mm"),
            (0.04, "s", "40.00 ms"),
            (12.0, "s", "12.00 s"),
            (0.3, "1", "0.3000"),
        ] {
            assert_eq!(quantity(value, unit), said);
        }
    }
}

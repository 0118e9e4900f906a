//! Reports of the score: a summary for the terminal, and a complete report as HTML.

use crate::figures::{Confusion, Dimension, Figure, Figures, Outcomes, REACH, Score};
use crate::outcome::Outcome;
use crate::reliability::{Bin, Reliability};
use crate::scored::Scored;
use crate::statistics::{Median, Rate};
use hil_sim::report::{Axis, Marker, Plot, Report, Section, Series, Table};

/// Origin of the score, for the report.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The command that reproduces it.
    pub command: String,
    /// The folder of the cases; a repeated case is written to a folder beside it.
    pub out: String,
    /// The arguments that name the programs; empty for the usual ones.
    pub programs: String,
    /// Notes for the reader.
    pub warnings: Vec<String>,
}

fn percent(share: f64) -> String {
    // no "-0"
    format!("{:.0}", (100.0 * share).round() + 0.0)
}

fn interval(ci95: Option<[f64; 2]>) -> String {
    ci95.map_or_else(String::new, |[low, high]| {
        format!(" ({}–{})", percent(low), percent(high))
    })
}

/// A share with its interval, in percent.
pub(crate) fn rate(rate: Rate) -> String {
    let of = |value| {
        let share = percent(value);
        format!(
            "{}/{} = {share} %{}",
            rate.hits,
            rate.of,
            interval(rate.ci95)
        )
    };
    rate.value.map_or_else(String::new, of)
}

/// A median with its interval, in percent.
pub(crate) fn median(median: Median) -> String {
    let of = |value| format!("{} %{}", percent(value), interval(median.ci95));
    median.value.map_or_else(String::new, of)
}

fn figure(figure: Figure) -> String {
    match figure {
        Figure::Rate(value) => rate(value),
        Figure::Median(value) => median(value),
        Figure::Number(value) => value.map_or_else(String::new, |v| format!("{:.1} %", 100.0 * v)),
    }
}

fn table(caption: &str, columns: &[&str], rows: Vec<Vec<String>>) -> Table {
    Table {
        caption: caption.into(),
        columns: columns.iter().map(|name| (*name).into()).collect(),
        rows,
    }
}

/// Required ranges of the figures, and their values.
fn headline(score: &Score) -> Table {
    let row = |reach: &crate::figures::Reach| {
        let of = |figures: &Figures| figure((reach.pick)(figures));
        let met = match reach.met(&score.visible) {
            Some(true) => "reached",
            Some(false) => "NOT REACHED",
            None => "no case",
        };
        let (all, with) = (of(&score.visible), of(&score.with_force));
        let without = of(&score.without_force);
        vec![
            reach.name.into(),
            reach.target(),
            met.into(),
            all,
            with,
            without,
        ]
    };
    table(
        "Of cases in which what is hidden changes a held-out signal by more than 3 × its noise; \
         in brackets the 95 % interval",
        &[
            "figure",
            "to reach",
            "",
            "all",
            "with force",
            "without force",
        ],
        REACH.iter().map(row).collect(),
    )
}

fn besides(figures: &Figures) -> Table {
    let rows = [
        ("consistent where nothing is hidden", figures.consistent),
        (
            "unexplained where something unlisted is hidden",
            figures.abstained,
        ),
        ("true name only among the alternatives", figures.ambiguous),
        (
            "right names, yet verdict unexplained",
            figures.right_with_remainder,
        ),
        (
            "fitted in the true form, where the tool has it",
            figures.forms_shared,
        ),
        ("parameters not given", figures.parameters_missing),
    ];
    let rows = rows.map(|(name, value)| vec![name.into(), rate(value)]);
    table("Besides", &["figure", "all"], rows.into())
}

fn outcomes(caption: &str, counts: &Outcomes) -> Table {
    let used = |outcome: &Outcome| counts.values().any(|row| row.contains_key(outcome));
    let used: Vec<Outcome> = Outcome::ALL.into_iter().filter(used).collect();
    let mut columns = vec!["hidden"];
    columns.extend(used.iter().map(|outcome| outcome.name()));
    let row = |(kind, row): (&crate::answer::Kind, &std::collections::BTreeMap<_, _>)| {
        let count = |outcome| row.get(outcome).map_or_else(String::new, usize::to_string);
        let cells = used.iter().map(count);
        std::iter::once(kind.name().to_owned())
            .chain(cells)
            .collect()
    };
    table(caption, &columns, counts.iter().map(row).collect())
}

/// The cases that are not visible, if there are any.
fn faint(score: &Score) -> Option<Table> {
    let caption = "Apart: what is hidden hardly shows";
    let any = !score.faint_outcomes.is_empty();
    any.then(|| outcomes(caption, &score.faint_outcomes))
}

/// The cases in which an effect cannot be distinguished from another, if there are any.
fn tied(score: &Score) -> Option<Table> {
    let caption = "Apart: what is hidden can be taken for another effect by any method";
    let any = !score.tied_outcomes.is_empty();
    any.then(|| outcomes(caption, &score.tied_outcomes))
}

/// Bins of both reliability diagrams.
fn reliability(score: &Score) -> Table {
    let cells = |bin: &Bin| match bin.count {
        0 => [String::new(), String::new(), String::new()],
        count => [
            count.to_string(),
            format!("{:.3}", bin.mean),
            format!("{:.3}", bin.right),
        ],
    };
    let row = |(i, (names, hypotheses)): (usize, (&Bin, &Bin))| {
        let (low, high) = (i as f64 / 10.0, (i + 1) as f64 / 10.0);
        let mut row = vec![format!("{low:.1} to {high:.1}")];
        row.extend(cells(names));
        row.extend(cells(hypotheses));
        row
    };
    let both = score.names.bins.iter().zip(&score.hypotheses.bins);
    let error = |reliability: &Reliability| match reliability.error {
        Some(error) => format!("{error:.3}"),
        None => "none".into(),
    };
    let caption = format!(
        "Probabilities given and how often they are right, all cases; expected calibration error: \
         {} of names, {} of hypotheses",
        error(&score.names),
        error(&score.hypotheses)
    );
    let columns = [
        "probability",
        "names",
        "mean",
        "right",
        "hypotheses",
        "mean",
        "right",
    ];
    table(&caption, &columns, both.enumerate().map(row).collect())
}

fn reliability_plot(score: &Score) -> Plot {
    let series = |name: &str, reliability: &Reliability| {
        let bins = || reliability.bins.iter().filter(|bin| bin.count > 0);
        let (mean, right) = (bins().map(|bin| bin.mean), bins().map(|bin| bin.right));
        Series::new(name, mean.collect(), right.collect())
    };
    Plot {
        title: "Reliability diagram".into(),
        caption: "How often what is given a probability is so, in bins of a tenth; probabilities \
                  that hold are on the dashed line."
            .into(),
        x: Axis::new("probability", "%", 100.0),
        y: Axis::new("right", "%", 100.0),
        series: vec![
            series("names", &score.names),
            series("hypotheses", &score.hypotheses),
            Series::new("right as often as said", vec![0.0, 1.0], vec![0.0, 1.0]).dashed(),
        ],
        markers: Vec::new(),
        sync: None,
    }
}

fn cost(score: &Score) -> Table {
    let cells = |name: &str, scale: f64, values: [f64; 3]| {
        let shown = values.map(|value| format!("{:.1}", scale * value));
        std::iter::once(name.to_owned()).chain(shown).collect()
    };
    let rows = vec![
        cells("time [s]", 1.0, score.cost.wall_s),
        cells("time on processors [s]", 1.0, score.cost.cpu_s),
        cells("peak memory [MB]", 1e-6, score.cost.peak_memory_bytes),
    ];
    let caption = "Cost of a diagnosis, all cases; times to quote are those of --jobs 1";
    table(caption, &["", "median", "95 %", "most"], rows)
}

/// The text of a table cell from figures.
type Cell = fn(&Figures) -> String;

fn dimension(dimension: &Dimension) -> Table {
    const CELLS: [(&str, Cell); 10] = [
        ("cases", |f| f.cases.to_string()),
        ("single, exact", |f| rate(f.single)),
        ("pair, both", |f| rate(f.pair)),
        ("triple, all", |f| rate(f.triple)),
        ("none, consistent", |f| rate(f.consistent)),
        ("none, false alarm", |f| rate(f.false_alarms)),
        ("unlisted, unnamed", |f| rate(f.unnamed)),
        ("gap removed, validation", |f| median(f.share_validation)),
        ("gap removed, unseen", |f| median(f.share_unseen)),
        ("inside ci95", |f| rate(f.inside_ci95)),
    ];
    let parts = &dimension.parts;
    let used = |(_, cell): &(&str, Cell)| parts.values().any(|f| !cell(f).is_empty());
    let used: Vec<(&str, Cell)> = CELLS.into_iter().filter(used).collect();
    let mut columns = vec![dimension.name];
    columns.extend(used.iter().map(|(name, _)| *name));
    let row = |(name, figures): (&String, &Figures)| {
        let cells = used.iter().map(|(_, cell)| cell(figures));
        std::iter::once(name.clone()).chain(cells).collect()
    };
    let caption = format!("By {}", dimension.name);
    table(&caption, &columns, parts.iter().map(row).collect())
}

/// Columns of the confusion matrix that are no names, last.
const NO_NAMES: [&str; 4] = ["several", "unexplained", "none", "no answer"];

/// Labels of the rows, the columns after them: listed names in the generator's order.
fn labels(confusion: &Confusion) -> (Vec<String>, Vec<String>) {
    // drawn effects have all names of the other family
    let known = truth::drawn::DRAWN.iter().map(|e| e.name.to_owned());
    let known: Vec<String> = known.chain(["none".to_owned()]).collect();
    let rows = known
        .iter()
        .filter(|name| confusion.contains_key(*name))
        .cloned()
        .collect();
    let said: Vec<&String> = confusion.values().flat_map(|row| row.keys()).collect();
    let no_name = |name: &&String| NO_NAMES.contains(&name.as_str());
    let named = known
        .iter()
        .filter(|name| said.contains(name) && !no_name(name))
        .cloned();
    let mut columns: Vec<String> = named.collect();
    let mut others: Vec<&String> = said
        .iter()
        .copied()
        .filter(|name| !known.contains(name) && !no_name(name))
        .collect();
    others.sort();
    others.dedup();
    columns.extend(others.into_iter().cloned());
    let last = NO_NAMES.into_iter().map(str::to_owned);
    columns.extend(last.filter(|name| said.contains(&name)));
    (rows, columns)
}

/// The matrix; names over the columns are numbered, as they would not fit.
fn confusion(confusion: &Confusion) -> Table {
    let (rows, columns) = labels(confusion);
    let number = |name: &String| columns.iter().position(|column| column == name);
    let is_name = |name: &str| !NO_NAMES.contains(&name);
    let heading = |(i, name): (usize, &String)| {
        if is_name(name) {
            format!("{}", i + 1)
        } else {
            name.clone()
        }
    };
    let row = |name: &String| {
        let label = match number(name) {
            Some(i) if is_name(name) => format!("{name} [{}]", i + 1),
            _ => name.clone(),
        };
        let count = |column: &String| match confusion[name].get(column) {
            Some(count) => count.to_string(),
            None => "·".into(),
        };
        std::iter::once(label)
            .chain(columns.iter().map(count))
            .collect()
    };
    let names = columns.iter().enumerate().filter(|(_, name)| is_name(name));
    let names: Vec<String> = names.map(|(i, name)| format!("{} {name}", i + 1)).collect();
    Table {
        caption: format!(
            "What was said of what is hidden. Columns: {}",
            names.join(", ")
        ),
        columns: std::iter::once("hidden".to_owned())
            .chain(columns.iter().enumerate().map(heading))
            .collect(),
        rows: rows.iter().map(row).collect(),
    }
}

/// The matrix as one line a row, for a terminal.
fn confusion_lines(confusion: &Confusion) -> Table {
    let (rows, columns) = labels(confusion);
    let row = |name: &String| {
        let said = columns.iter().filter_map(|column| {
            let count = confusion[name].get(column)?;
            Some(format!("{column} {count}"))
        });
        vec![name.clone(), said.collect::<Vec<_>>().join(", ")]
    };
    table(
        "Confusion",
        &["hidden", "said"],
        rows.iter().map(row).collect(),
    )
}

/// The command that repeats a case and scores it alone.
fn repeat(case: &Scored, origin: &Origin) -> String {
    let answer = &case.answer;
    let (seed, index) = (answer.seed, answer.index);
    let mut command = format!(
        "cargo run --release -p scorer -- run --family {} --seed {seed} --first {index} --count 1 \
         --again --out {}-again",
        answer.family, origin.out
    );
    command += &origin.programs;
    for part in &case.experiment {
        command += &format!(" --experiment {part}");
    }
    if !case.arguments.is_empty() {
        command += &format!(" -- {}", case.arguments.join(" "));
    }
    command
}

fn wrong(score: &Score, origin: &Origin) -> Table {
    let row = |case: &Scored| {
        let answer = &case.answer;
        let forms = answer.effects.iter().map(|e| {
            format!(
                "{} ({}, size {:.2}, {:.0} × noise)",
                e.name, e.form, e.size, e.most_over_noise
            )
        });
        let hidden = forms.collect::<Vec<_>>().join(" + ");
        vec![
            if hidden.is_empty() {
                "none".into()
            } else {
                hidden
            },
            case.said(),
            case.outcome.name().into(),
            if answer.force_channel {
                "with"
            } else {
                "without"
            }
            .into(),
            repeat(case, origin),
        ]
    };
    let columns = ["hidden", "said", "", "force", "to repeat"];
    table(
        "Cases that are not right",
        &columns,
        score.wrong().map(row).collect(),
    )
}

/// Gaps and noise that the diagnosis claims, compared with those that the scorer computed.
fn claims(score: &Score) -> Table {
    let cases = || score.cases.iter().filter(|case| case.fault.is_none());
    let compared = || cases().filter_map(|case| case.claim_difference);
    let agree = Rate::among(compared(), |difference| *difference < 0.05);
    let ratios = || cases().flat_map(|case| case.noise_ratio.values().copied());
    let noise = Rate::among(ratios(), |ratio| (0.8..1.25).contains(ratio));
    let simulated = Rate::among(cases(), |case| case.gap_fault.is_none());
    let rows = [
        (
            "gaps in diagnosis.json within 5 % of those measured by the scorer",
            agree,
        ),
        ("noise within a quarter of the true one", noise),
        ("rig.fitted.toml can be simulated", simulated),
    ];
    let rows = rows.map(|(name, value)| vec![name.into(), rate(value)]);
    table(
        "What the tool says of itself, all cases",
        &["claim", "holds"],
        rows.into(),
    )
}

fn signals(score: &Score) -> Table {
    let mut rows = Vec::new();
    for signal in ["pressure_pa", "contraction", "force_n"] {
        let listed = score
            .cases
            .iter()
            .filter(|case| case.visible && case.listed());
        let shares = listed.filter_map(|case| case.share_by_signal.get(signal).copied());
        let share = Median::new(shares);
        rows.push(vec![signal.into(), share.of.to_string(), median(share)]);
    }
    let caption = "Gap above the noise removed on validation records, by signal";
    table(caption, &["signal", "cases", "median"], rows)
}

fn parameters(score: &Score) -> Table {
    let visible = score.cases.iter().filter(|case| case.visible);
    let mut names: Vec<(&str, &str)> = Vec::new();
    let all: Vec<_> = visible.flat_map(|case| &case.parameters).collect();
    for parameter in &all {
        names.push((&parameter.effect, &parameter.parameter));
    }
    names.sort_unstable();
    names.dedup();
    let row = |(effect, name): (&str, &str)| {
        let of = || {
            all.iter()
                .filter(|p| p.effect == effect && p.parameter == name)
        };
        let error = |(value, truth): (f64, f64)| ((value - truth) / truth).abs();
        let estimates = of().filter_map(|p| Some((p.estimate?.0, p.truth)));
        let inside = Rate::among(of().filter_map(|p| p.inside()), |inside| *inside);
        let missing = of().filter(|p| p.estimate.is_none()).count();
        let name = format!("{effect}: {name}");
        vec![
            name,
            rate(inside),
            median(Median::new(estimates.map(error))),
            missing.to_string(),
        ]
    };
    let caption = "Parameters of rightly named effects that were fitted in their true form";
    let columns = [
        "parameter",
        "truth inside ci95",
        "median error",
        "not given",
    ];
    table(caption, &columns, names.into_iter().map(row).collect())
}

/// The share of right cases against an abscissa, in bins `edges`.
fn rate_by(title: &str, caption: &str, x: Axis, edges: &[f64], cases: &[(f64, &Scored)]) -> Plot {
    let mut lines = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
    for edge in edges.windows(2) {
        let inside = cases
            .iter()
            .filter(|(at, _)| (edge[0]..edge[1]).contains(at));
        let rate = Rate::among(inside, |(_, case)| case.outcome == Outcome::Right);
        let (Some(value), Some([low, high])) = (rate.value, rate.ci95) else {
            continue;
        };
        let middle = if x.log {
            (edge[0] * edge[1]).sqrt()
        } else {
            (edge[0] + edge[1]) / 2.0
        };
        for (line, value) in lines.iter_mut().zip([middle, value, low, high]) {
            line.push(value);
        }
    }
    let [at, value, low, high] = lines;
    Plot {
        title: title.into(),
        caption: caption.into(),
        x,
        y: Axis::new("right", "%", 100.0),
        series: vec![
            Series::new("right", at.clone(), value),
            Series::new("95 % interval, low", at.clone(), low).dashed(),
            Series::new("95 % interval, high", at, high).dashed(),
        ],
        markers: Vec::new(),
        sync: None,
    }
}

fn rate_plots(score: &Score) -> Vec<Plot> {
    let named = || {
        score
            .cases
            .iter()
            .filter(|case| !case.answer.effects.is_empty())
    };
    let by_size: Vec<(f64, &Scored)> = named()
        .filter(|case| case.visible)
        .filter_map(|case| Some((case.answer.least_size()?, case)))
        .collect();
    let by_noise: Vec<(f64, &Scored)> = named()
        .filter_map(|case| Some((case.answer.least_over_noise()?, case)))
        .collect();
    let fifths: Vec<f64> = (0..=5)
        .map(|i| f64::from(i) / 5.0 + f64::from(i / 5) * 1e-9)
        .collect();
    let doublings: Vec<f64> = (-2..=14).map(|i| 2.0_f64.powi(i)).collect();
    let mut over_noise = rate_by(
        "Right by what the effect changes",
        "Largest change of a validation signal over its noise, of a pair's lesser effect; left of \
         the line cases do not count.",
        Axis::new("change over noise", "", 1.0).log(),
        &doublings,
        &by_noise,
    );
    over_noise.markers.push(Marker {
        vertical: true,
        value: crate::answer::VISIBLE_OVER_NOISE,
        label: "3 × noise".into(),
    });
    let size = rate_by(
        "Right by size",
        "From barely visible to plain; of a pair the lesser size. Singles, pairs and unlisted.",
        Axis::new("size", "", 1.0),
        &fifths,
        &by_size,
    );
    vec![size, over_noise]
}

/// Cumulative distribution of values.
fn distribution(name: &str, values: impl Iterator<Item = f64>) -> Series {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len() as f64;
    let shares = (1..=sorted.len()).map(|i| i as f64 / count).collect();
    Series::new(name, sorted, shares)
}

fn share_plot(score: &Score) -> Plot {
    let listed = || {
        score
            .cases
            .iter()
            .filter(|case| case.visible && case.listed())
    };
    // negative shares are clipped on this scale
    let seen = |share: Option<f64>| share.map(|share| share.max(-0.5));
    let series = vec![
        distribution(
            "validation",
            listed().filter_map(|case| seen(case.share_validation)),
        ),
        distribution(
            "unseen",
            listed().filter_map(|case| seen(case.share_unseen)),
        ),
    ];
    let marker = Marker {
        vertical: true,
        value: 0.9,
        label: "90 %".into(),
    };
    Plot {
        title: "Gap above the noise that is removed".into(),
        caption: "Share of cases with a listed effect in which at most so much is removed.".into(),
        x: Axis::new("removed", "%", 100.0),
        y: Axis::new("cases", "%", 100.0),
        series,
        markers: vec![marker],
        sync: None,
    }
}

/// A histogram as an outline.
fn histogram(values: &[f64], bins: usize) -> (Vec<f64>, Vec<f64>) {
    let most = values.iter().copied().fold(0.0, f64::max).max(1e-9);
    let width = most / bins as f64;
    let mut counts = vec![0.0; bins];
    for value in values {
        counts[((value / width) as usize).min(bins - 1)] += 1.0;
    }
    let (mut x, mut y) = (vec![0.0], vec![0.0]);
    for (bin, count) in counts.into_iter().enumerate() {
        x.extend([bin as f64 * width, (bin + 1) as f64 * width]);
        y.extend([count, count]);
    }
    x.push(most);
    y.push(0.0);
    (x, y)
}

fn time_plot(score: &Score) -> Plot {
    let times_s: Vec<f64> = score.cases.iter().map(|case| case.wall_s).collect();
    let (x, y) = histogram(&times_s, 30);
    Plot {
        title: "Time of a diagnosis".into(),
        caption: "Of all cases; several at a time share the processors.".into(),
        x: Axis::new("time", "s", 1.0),
        y: Axis::new("cases", "", 1.0),
        series: vec![Series::new("cases", x, y)],
        markers: Vec::new(),
        sync: None,
    }
}

fn section(heading: &str, tables: Vec<Table>, plots: Vec<Plot>) -> Section {
    Section {
        heading: heading.into(),
        tables,
        plots,
        ..Section::default()
    }
}

fn verdict(score: &Score, origin: &Origin) -> Vec<String> {
    let missed = REACH
        .iter()
        .filter(|reach| reach.met(&score.visible) == Some(false));
    let missed: Vec<&str> = missed.map(|reach| reach.name).collect();
    let mut verdict = vec![match missed.as_slice() {
        [] => "All that there are cases for is reached.".into(),
        missed => format!("Not reached: {}.", missed.join("; ")),
    }];
    let fallen = score.cases.iter().filter(|case| case.fault.is_some());
    match fallen.count() {
        0 => {}
        fallen => verdict.push(format!(
            "{fallen} cases have no diagnosis that can be read."
        )),
    }
    let visible = score.visible.cases;
    verdict.push(format!(
        "{} cases; in {visible} of them what is hidden shows, or nothing is hidden.",
        score.cases.len()
    ));
    verdict.extend(origin.warnings.iter().cloned());
    verdict
}

/// The summary for a terminal.
pub fn summary(score: &Score, origin: &Origin) -> Report {
    let by = |name: &'static str| {
        score
            .dimensions
            .iter()
            .filter(move |d| d.name == name)
            .map(dimension)
    };
    Report {
        title: "Diagnosis of hidden effects".into(),
        verdict: verdict(score, origin),
        sections: vec![
            section("Reach", vec![headline(score)], Vec::new()),
            section("Besides", vec![besides(&score.visible)], Vec::new()),
            section("Outcomes", vec![outcomes("", &score.outcomes)], Vec::new()),
            section(
                "Faint, apart",
                faint(score).into_iter().chain(tied(score)).collect(),
                Vec::new(),
            ),
            section("By size", by("size").collect(), Vec::new()),
            section("By effect", by("effect").collect(), Vec::new()),
            section(
                "Confusion",
                vec![confusion_lines(&score.confusion)],
                Vec::new(),
            ),
            section("Probabilities", vec![reliability(score)], Vec::new()),
            section("Claims", vec![claims(score)], Vec::new()),
            section("Cost", vec![cost(score)], Vec::new()),
            section("Not right", vec![wrong(score, origin)], Vec::new()),
        ],
        repeat: vec![origin.command.clone()],
    }
}

/// The complete report.
pub fn full(score: &Score, origin: &Origin) -> Report {
    let mut outcomes = vec![outcomes("Outcomes by what is hidden", &score.outcomes)];
    outcomes.extend(faint(score).into_iter().chain(tied(score)));
    let gaps = vec![signals(score), claims(score)];
    Report {
        title: "Diagnosis of hidden effects".into(),
        verdict: verdict(score, origin),
        sections: vec![
            section(
                "Reach",
                vec![headline(score), besides(&score.visible)],
                rate_plots(score),
            ),
            section("Outcomes", outcomes, Vec::new()),
            section(
                "Confusion of names",
                vec![confusion(&score.confusion)],
                Vec::new(),
            ),
            section("The gap", gaps, vec![share_plot(score)]),
            section(
                "Probabilities",
                vec![reliability(score)],
                vec![reliability_plot(score)],
            ),
            section("Parameters", vec![parameters(score)], Vec::new()),
            section(
                "Parts",
                score.dimensions.iter().map(dimension).collect(),
                Vec::new(),
            ),
            section("Cost", vec![cost(score)], vec![time_plot(score)]),
            section("What is not right", vec![wrong(score, origin)], Vec::new()),
        ],
        repeat: vec![origin.command.clone()],
    }
}

//! The campaign in words, tables and JSON.

use super::Hardware;
use super::ablation::SafetyFunction;
use super::kind::{Decides, KINDS, Kind};
use super::outcome::Outcome;
use crate::report::{Report, Section, Table};
use serde::Serialize;
use std::cmp::Ordering;

/// Cases listed in the report.
const LISTED: usize = 40;

/// A kind of fault, over its cases.
#[derive(Clone, Debug, Serialize)]
pub struct OfKind {
    /// Its name.
    pub kind: &'static str,
    /// Energy alone decides how fast the weight is.
    pub physics_decides: bool,
    /// Cases.
    pub cases: usize,
    /// Cases outside their bounds.
    pub outside: usize,
    /// Cases in which a reason was latched.
    pub latched: usize,
    /// Median and longest time to the reason \[s\].
    pub latched_after_s: Option<[f64; 2]>,
    /// Fastest upwards \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Fastest downwards \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Fastest at the end \[m/s\].
    pub speed_m_per_s_final_max: f64,
    /// Furthest rise above the place at the fault \[m\].
    pub rise_m_max: f64,
    /// Highest pressure \[Pa\].
    pub pressure_pa_max: f64,
    /// Final modes, and in how many cases.
    pub modes: Vec<(String, usize)>,
    /// Latched reasons, and in how many cases.
    pub reasons: Vec<(String, usize)>,
    /// The worst case: the one nearest to a bound, or furthest beyond.
    pub worst_case: u64,
    /// Its largest share of a bound \[-\].
    pub worst_share: f64,
}

/// A kind with a piece of hardware.
#[derive(Clone, Debug, Serialize)]
pub struct WithHardware {
    /// The fault.
    pub kind: &'static str,
    /// The hardware.
    pub hardware: Hardware,
    /// Fastest upwards \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Fastest downwards \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Highest place \[m\].
    pub height_m_max: f64,
    /// Highest pressure \[Pa\].
    pub pressure_pa_max: f64,
}

/// A kind's cases, with each piece of hardware.
pub type Columns = Vec<(Hardware, Vec<Outcome>)>;

/// The whole campaign.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// Cases.
    pub cases: usize,
    /// Cases outside their bounds.
    pub outside: usize,
    /// By kind, worst first.
    pub kinds: Vec<OfKind>,
    /// What hardware does where physics decides.
    pub hardware: Vec<WithHardware>,
    /// Each case, worst first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outcomes: Vec<Outcome>,
}

/// The largest share of a bound that a case takes.
fn share(outcome: &Outcome) -> f64 {
    let bounds = &outcome.bounds;
    [
        outcome.speed_up_m_per_s_max / bounds.speed_up_m_per_s,
        outcome.speed_down_m_per_s_max / bounds.speed_down_m_per_s,
        outcome.height_m_max / bounds.height_m,
        outcome.pressure_pa_max / bounds.pressure_pa,
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

fn largest(outcomes: &[Outcome], value: impl Fn(&Outcome) -> f64) -> f64 {
    outcomes.iter().map(value).fold(0.0, f64::max)
}

/// How often each word comes, the most frequent first.
fn tally(words: impl Iterator<Item = String>) -> Vec<(String, usize)> {
    let mut tally: Vec<(String, usize)> = Vec::new();
    for word in words {
        match tally.iter_mut().find(|(known, _)| *known == word) {
            Some((_, times)) => *times += 1,
            None => tally.push((word, 1)),
        }
    }
    tally.sort_by_key(|(_, times)| std::cmp::Reverse(*times));
    tally
}

impl OfKind {
    fn new(kind: &Kind, outcomes: &[Outcome]) -> OfKind {
        let mut after_s: Vec<f64> = outcomes.iter().filter_map(|o| o.latched_after_s).collect();
        after_s.sort_by(f64::total_cmp);
        let worst = outcomes.iter().max_by(|a, b| share(a).total_cmp(&share(b)));
        OfKind {
            kind: kind.name,
            physics_decides: kind.decides != Decides::Controller,
            cases: outcomes.len(),
            outside: outcomes.iter().filter(|o| !o.outside.is_empty()).count(),
            latched: after_s.len(),
            latched_after_s: after_s
                .last()
                .map(|last| [after_s[after_s.len() / 2], *last]),
            speed_up_m_per_s_max: largest(outcomes, |o| o.speed_up_m_per_s_max),
            speed_down_m_per_s_max: largest(outcomes, |o| o.speed_down_m_per_s_max),
            speed_m_per_s_final_max: largest(outcomes, |o| o.speed_m_per_s_final),
            rise_m_max: largest(outcomes, |o| o.rise_m),
            pressure_pa_max: largest(outcomes, |o| o.pressure_pa_max),
            modes: tally(outcomes.iter().map(|o| o.mode.name().into())),
            reasons: tally(
                outcomes
                    .iter()
                    .filter_map(|o| Some(o.reason?.name().into())),
            ),
            worst_case: worst.map_or(0, |worst| worst.case),
            worst_share: worst.map_or(0.0, share),
        }
    }
}

impl Summary {
    /// Of `outcomes`, and of cases that were run again with hardware.
    pub fn new(
        seed: u64,
        mut outcomes: Vec<Outcome>,
        with_hardware: &[(&'static Kind, Columns)],
    ) -> Summary {
        let of = |outcome: &Outcome| (outcome.case % KINDS.len() as u64) as usize;
        let mut kinds: Vec<OfKind> = KINDS
            .iter()
            .enumerate()
            .map(|(place, kind)| {
                let own: Vec<Outcome> = outcomes
                    .iter()
                    .filter(|o| of(o) == place)
                    .cloned()
                    .collect();
                OfKind::new(kind, &own)
            })
            .filter(|kind| kind.cases > 0)
            .collect();
        let rank = |outside: bool, share: f64| (u8::from(outside) as f64) * 1e3 + share;
        kinds.sort_by(|a, b| {
            let rank = |kind: &OfKind| rank(kind.outside > 0, kind.worst_share);
            rank(b).total_cmp(&rank(a))
        });
        outcomes.sort_by(|a, b| {
            let rank = |outcome: &Outcome| rank(!outcome.outside.is_empty(), share(outcome));
            rank(b).total_cmp(&rank(a))
        });
        let hardware = with_hardware.iter().flat_map(|(kind, columns)| {
            columns.iter().map(|(hardware, outcomes)| WithHardware {
                kind: kind.name,
                hardware: *hardware,
                speed_up_m_per_s_max: largest(outcomes, |o| o.speed_up_m_per_s_max),
                speed_down_m_per_s_max: largest(outcomes, |o| o.speed_down_m_per_s_max),
                height_m_max: largest(outcomes, |o| o.height_m_max),
                pressure_pa_max: largest(outcomes, |o| o.pressure_pa_max),
            })
        });
        Summary {
            seed,
            cases: outcomes.len(),
            outside: outcomes.iter().filter(|o| !o.outside.is_empty()).count(),
            kinds,
            hardware: hardware.collect(),
            outcomes,
        }
    }

    /// The same without each single case.
    pub fn without_cases(&self) -> Summary {
        Summary {
            outcomes: Vec::new(),
            ..self.clone()
        }
    }
}

/// What becomes of the cases without a safety function.
#[derive(Clone, Debug, Serialize)]
pub struct Lacking {
    /// The function.
    pub without: String,
    /// Cases.
    pub cases: usize,
    /// Cases outside of any bound.
    pub outside: usize,
    /// Of these, cases in which not only the reason is.
    pub moved: usize,
    /// The bounds that they are outside of, and how many.
    pub bounds: Vec<(String, usize)>,
    /// Their kinds, and how many.
    pub kinds: Vec<(String, usize)>,
    /// The one that shows most, and its largest share of a bound.
    pub worst: Option<(u64, f64)>,
}

impl Lacking {
    /// Of the `outcomes` without `function`.
    pub fn new(function: SafetyFunction, outcomes: &[Outcome]) -> Lacking {
        let outside = outcomes.iter().filter(|o| !o.outside.is_empty());
        let outside: Vec<&Outcome> = outside.collect();
        let kind = |outcome: &&Outcome| KINDS[(outcome.case % KINDS.len() as u64) as usize].name;
        let bounds = outside.iter().flat_map(|outcome| &outcome.outside);
        let worst = outside.iter().max_by(|a, b| {
            let rank = |outcome: &Outcome| (outcome.has_moved(), share(outcome));
            rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal)
        });
        Lacking {
            without: function.name().into(),
            cases: outcomes.len(),
            outside: outside.len(),
            moved: outside.iter().filter(|o| o.has_moved()).count(),
            bounds: tally(bounds.map(|bound| bound.to_string())),
            kinds: tally(outside.iter().map(|outcome| kind(outcome).into())),
            worst: worst.map(|worst| (worst.case, share(worst))),
        }
    }
}

/// What each safety function is for, as a report.
pub fn report_lacking(seed: u64, lacking: &[Lacking]) -> Report {
    let row = |lacking: &Lacking| {
        vec![
            lacking.without.clone(),
            format!("{} / {}", lacking.outside, lacking.cases),
            lacking.moved.to_string(),
            counted(&lacking.bounds),
            counted(&lacking.kinds),
            lacking.worst.map_or("–".into(), |(case, share)| {
                format!("{case} ({:.0} %)", 100.0 * share)
            }),
        ]
    };
    let table = Table {
        caption: format!(
            "The worst again: hil-sim faults --seed {seed} --case N --without FUNCTION; in its \
             share of a bound"
        ),
        columns: [
            "without",
            "outside / cases",
            "not only the reason",
            "of these bounds",
            "of these kinds",
            "worst case",
        ]
        .map(String::from)
        .into(),
        rows: lacking.iter().map(row).collect(),
    };
    Report {
        title: "Each safety function switched off".into(),
        verdict: vec![format!(
            "Without {} of {} safety functions cases are outside, without {} not only by a reason.",
            lacking.iter().filter(|lacking| lacking.outside > 0).count(),
            lacking.len(),
            lacking.iter().filter(|lacking| lacking.moved > 0).count(),
        )],
        sections: vec![Section {
            heading: "What each is for".into(),
            tables: vec![table],
            ..Section::default()
        }],
        repeat: Vec::new(),
    }
}

fn counted(words: &[(String, usize)]) -> String {
    let words = words.iter().map(|(word, times)| format!("{word} {times}"));
    words.collect::<Vec<_>>().join(", ")
}

fn kinds_table(summary: &Summary, physics: bool) -> Table {
    let row = |kind: &OfKind| {
        let after = kind
            .latched_after_s
            .map_or("–".into(), |[median, longest]| {
                format!("{median:.2} / {longest:.2} s")
            });
        vec![
            kind.kind.into(),
            format!("{} / {}", kind.outside, kind.cases),
            format!(
                "{:.2} / {:.2} m/s",
                kind.speed_up_m_per_s_max, kind.speed_down_m_per_s_max
            ),
            format!("{:.2} m/s", kind.speed_m_per_s_final_max),
            format!("{:.0} mm", 1e3 * kind.rise_m_max),
            format!("{:.0} kPa", 1e-3 * kind.pressure_pa_max),
            format!("{} of {}", kind.latched, kind.cases),
            after,
            counted(&kind.modes),
            counted(&kind.reasons),
            format!("{} ({:.0} %)", kind.worst_case, 100.0 * kind.worst_share),
        ]
    };
    let kinds = summary
        .kinds
        .iter()
        .filter(|kind| kind.physics_decides == physics);
    Table {
        caption: "Speeds, rise and pressure are the worst after the fault; the worst case is the \
                  one nearest to a bound, in its share of it"
            .into(),
        columns: [
            "fault",
            "outside / cases",
            "fastest up / down",
            "at the end",
            "rise",
            "pressure",
            "latched",
            "after: median / longest",
            "final mode",
            "reason",
            "worst case",
        ]
        .map(String::from)
        .into(),
        rows: kinds.map(row).collect(),
    }
}

fn hardware_table(summary: &Summary) -> Table {
    let row = |with: &WithHardware| {
        let hardware = serde_json::to_value(with.hardware).unwrap_or_default();
        vec![
            with.kind.into(),
            hardware.as_str().unwrap_or_default().replace('-', " "),
            format!(
                "{:.2} / {:.2} m/s",
                with.speed_up_m_per_s_max, with.speed_down_m_per_s_max
            ),
            format!("{:.0} mm", 1e3 * with.height_m_max),
            format!("{:.0} kPa", 1e-3 * with.pressure_pa_max),
        ]
    };
    Table {
        caption: "The same cases with hardware".into(),
        columns: [
            "fault",
            "hardware",
            "fastest up / down",
            "highest place",
            "pressure",
        ]
        .map(String::from)
        .into(),
        rows: summary.hardware.iter().map(row).collect(),
    }
}

fn cases_table(summary: &Summary) -> Table {
    let row = |outcome: &Outcome| {
        vec![
            outcome.case.to_string(),
            outcome.fault.clone(),
            format!("{:?}, {:.2} s", outcome.moment, outcome.fault_s),
            outcome.outside.join(", "),
            format!(
                "{:.2} / {:.2} m/s",
                outcome.speed_up_m_per_s_max, outcome.speed_down_m_per_s_max
            ),
            format!(
                "{:.2} / {:.2} m/s",
                outcome.bounds.speed_up_m_per_s, outcome.bounds.speed_down_m_per_s
            ),
            outcome
                .reason
                .map_or("–".into(), |reason| reason.name().into()),
        ]
    };
    Table {
        caption: format!(
            "Again, with its record: hil-sim faults --seed {} --case N",
            summary.seed
        ),
        columns: [
            "case",
            "fault",
            "when",
            "outside",
            "fastest up / down",
            "bounds",
            "reason",
        ]
        .map(String::from)
        .into(),
        rows: summary.outcomes.iter().take(LISTED).map(row).collect(),
    }
}

/// The campaign as a report.
pub fn report(summary: &Summary) -> Report {
    let section = |heading: &str, text: &str, table| Section {
        heading: heading.into(),
        text: vec![text.into()],
        tables: vec![table],
        ..Section::default()
    };
    Report {
        title: "The fault campaign".into(),
        verdict: vec![
            format!(
                "{} of {} cases are outside their bounds.",
                summary.outside, summary.cases
            ),
            "The controller in these cases is the one that is flashed to the board.".into(),
        ],
        sections: vec![
            section(
                "Where the controller decides",
                "The weight stays below the trip speed and a free fall until that is noticed, \
                 within the muscle's stroke and a tenth above the supply's pressure.",
                kinds_table(summary, false),
            ),
            section(
                "Where physics decides",
                "No controller helps a hose that is off. The bounds are energies: what the \
                 supply's pressure can do to the weight, and what falling from there does.",
                kinds_table(summary, true),
            ),
            section(
                "What hardware would do",
                "The check valve sits in the muscle's port and shuts 10 ms after air or voltage is \
                 lost; the stop begins at a contraction of 0.28, the relief valve at 420 kPa; the \
                 throttle lets 3e-8 kg/(Pa·s) pass, the damper 0.25 m/s under the weight.",
                hardware_table(summary),
            ),
            section(
                "Worst cases",
                "Nearest to their bounds first.",
                cases_table(summary),
            ),
        ],
        repeat: Vec::new(),
    }
}

//! Summaries of the campaign, and its reports as text, tables and JSON.

use super::Hardware;
use super::ablation::SafetyFunction;
use super::kind::{KINDS, Kind, LimitedBy};
use super::outcome::Outcome;
use crate::report::{Report, Section, Table};
use serde::Serialize;
use std::cmp::Ordering;

/// Number of cases listed in the report.
const LISTED: usize = 40;

/// Summary of the cases of one kind of fault.
#[derive(Clone, Debug, Serialize)]
pub struct KindSummary {
    /// Name of the kind.
    pub kind: &'static str,
    /// Whether only the available energy limits the motion, not the controller.
    #[serde(rename = "physics_decides")]
    pub limited_by_physics: bool,
    /// Number of cases.
    pub cases: usize,
    /// Number of cases that violate a bound.
    #[serde(rename = "outside")]
    pub violating: usize,
    /// Number of cases in which a reason was latched.
    pub latched: usize,
    /// Median and longest time from the fault to the reason \[s\].
    pub latched_after_s: Option<[f64; 2]>,
    /// Highest speed upwards \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Highest speed downwards \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Highest speed in the final interval \[m/s\].
    pub speed_m_per_s_final_max: f64,
    /// Largest rise above the position at the fault \[m\].
    pub rise_m_max: f64,
    /// Highest gauge pressure \[Pa\].
    pub pressure_pa_max: f64,
    /// Final modes, each with its number of cases.
    pub modes: Vec<(String, usize)>,
    /// Latched reasons, each with its number of cases.
    pub reasons: Vec<(String, usize)>,
    /// Number of the worst case: the one with the largest ratio of a value to its bound.
    pub worst_case: u64,
    /// That ratio \[-\].
    pub worst_share: f64,
}

/// Summary of the cases of one kind of fault with protective hardware.
#[derive(Clone, Debug, Serialize)]
pub struct HardwareSummary {
    /// Name of the kind.
    pub kind: &'static str,
    /// The hardware.
    pub hardware: Hardware,
    /// Highest speed upwards \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Highest speed downwards \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Highest position \[m\].
    pub height_m_max: f64,
    /// Highest gauge pressure \[Pa\].
    pub pressure_pa_max: f64,
}

/// The outcomes of a kind's cases with each piece of hardware.
pub type HardwareOutcomes = Vec<(Hardware, Vec<Outcome>)>;

/// Summary of the campaign.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// Number of cases.
    pub cases: usize,
    /// Number of cases that violate a bound.
    #[serde(rename = "outside")]
    pub violating: usize,
    /// The kinds of fault, worst first.
    pub kinds: Vec<KindSummary>,
    /// The kinds whose motion only the available energy limits, with protective hardware.
    pub hardware: Vec<HardwareSummary>,
    /// The outcomes of all cases, worst first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outcomes: Vec<Outcome>,
}

/// The largest ratio of a value to its bound in a case.
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

/// Number of occurrences of each word, the most frequent first.
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

fn violating(outcomes: &[Outcome]) -> usize {
    let violating = outcomes.iter().filter(|o| !o.violations.is_empty());
    violating.count()
}

impl KindSummary {
    fn new(kind: &Kind, outcomes: &[Outcome]) -> KindSummary {
        let mut after_s: Vec<f64> = outcomes.iter().filter_map(|o| o.latched_after_s).collect();
        after_s.sort_by(f64::total_cmp);
        let worst = outcomes.iter().max_by(|a, b| share(a).total_cmp(&share(b)));
        KindSummary {
            kind: kind.name,
            limited_by_physics: kind.limited_by != LimitedBy::Controller,
            cases: outcomes.len(),
            violating: violating(outcomes),
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
    /// The summary of `outcomes`, and of the cases that were repeated with protective hardware.
    pub fn new(
        seed: u64,
        mut outcomes: Vec<Outcome>,
        with_hardware: &[(&'static Kind, HardwareOutcomes)],
    ) -> Summary {
        let kind_index = |outcome: &Outcome| (outcome.case % KINDS.len() as u64) as usize;
        let mut kinds: Vec<KindSummary> = KINDS
            .iter()
            .enumerate()
            .map(|(index, kind)| {
                let of_kind: Vec<Outcome> = outcomes
                    .iter()
                    .filter(|outcome| kind_index(outcome) == index)
                    .cloned()
                    .collect();
                KindSummary::new(kind, &of_kind)
            })
            .filter(|kind| kind.cases > 0)
            .collect();
        let rank = |is_violated: bool, share: f64| f64::from(u8::from(is_violated)) * 1e3 + share;
        kinds.sort_by(|a, b| {
            let rank = |kind: &KindSummary| rank(kind.violating > 0, kind.worst_share);
            rank(b).total_cmp(&rank(a))
        });
        outcomes.sort_by(|a, b| {
            let rank = |outcome: &Outcome| rank(!outcome.violations.is_empty(), share(outcome));
            rank(b).total_cmp(&rank(a))
        });
        let hardware = with_hardware.iter().flat_map(|(kind, outcomes)| {
            outcomes.iter().map(|(hardware, outcomes)| HardwareSummary {
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
            violating: violating(&outcomes),
            kinds,
            hardware: hardware.collect(),
            outcomes,
        }
    }

    /// The same summary without the outcomes of single cases.
    pub fn without_cases(&self) -> Summary {
        Summary {
            outcomes: Vec::new(),
            ..self.clone()
        }
    }
}

/// Summary of the cases in which one safety function is switched off.
#[derive(Clone, Debug, Serialize)]
pub struct AblationSummary {
    /// Name of the safety function.
    pub without: String,
    /// Number of cases.
    pub cases: usize,
    /// Number of cases that violate a bound.
    #[serde(rename = "outside")]
    pub violating: usize,
    /// Number of cases in which the weight or the pressure violates a bound.
    #[serde(rename = "moved")]
    pub violating_physically: usize,
    /// The violated bounds, each with its number of cases.
    pub bounds: Vec<(String, usize)>,
    /// The kinds of the violating cases, each with its number of cases.
    pub kinds: Vec<(String, usize)>,
    /// Number of the worst violating case, and its largest ratio of a value to its bound.
    pub worst: Option<(u64, f64)>,
}

impl AblationSummary {
    /// The summary of the `outcomes` without `function`.
    pub fn new(function: SafetyFunction, outcomes: &[Outcome]) -> AblationSummary {
        let violating = outcomes.iter().filter(|o| !o.violations.is_empty());
        let violating: Vec<&Outcome> = violating.collect();
        let kind = |outcome: &&Outcome| KINDS[(outcome.case % KINDS.len() as u64) as usize].name;
        let bounds = violating.iter().flat_map(|outcome| &outcome.violations);
        let worst = violating.iter().max_by(|a, b| {
            let rank = |outcome: &Outcome| (outcome.has_physical_violation(), share(outcome));
            rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal)
        });
        AblationSummary {
            without: function.name().into(),
            cases: outcomes.len(),
            violating: violating.len(),
            violating_physically: violating
                .iter()
                .filter(|o| o.has_physical_violation())
                .count(),
            bounds: tally(bounds.map(|bound| bound.to_string())),
            kinds: tally(violating.iter().map(|outcome| kind(outcome).into())),
            worst: worst.map(|worst| (worst.case, share(worst))),
        }
    }
}

/// The report of an ablation: the violations with each safety function switched off.
pub fn report_ablation(seed: u64, summaries: &[AblationSummary]) -> Report {
    let row = |summary: &AblationSummary| {
        vec![
            summary.without.clone(),
            format!("{} / {}", summary.violating, summary.cases),
            summary.violating_physically.to_string(),
            counted(&summary.bounds),
            counted(&summary.kinds),
            summary.worst.map_or("–".into(), |(case, share)| {
                format!("{case} ({:.0} %)", 100.0 * share)
            }),
        ]
    };
    let table = Table {
        caption: format!(
            "Worst case: its number N, and the largest ratio of a value to its bound. To repeat \
             it: hil-sim faults --seed {seed} --case N --without FUNCTION"
        ),
        columns: [
            "without",
            "violations / cases",
            "not only of the reason",
            "of which bounds",
            "kinds of fault",
            "worst case",
        ]
        .map(String::from)
        .into(),
        rows: summaries.iter().map(row).collect(),
    };
    Report {
        title: "Each safety function switched off".into(),
        verdict: vec![format!(
            "Cases violate bounds if any one of {} of the {} safety functions is switched \
             off; for {} of them not only the latched reason is affected, but the weight or the \
             pressure.",
            summaries
                .iter()
                .filter(|summary| summary.violating > 0)
                .count(),
            summaries.len(),
            summaries
                .iter()
                .filter(|summary| summary.violating_physically > 0)
                .count(),
        )],
        sections: vec![Section {
            heading: "Violations without each safety function".into(),
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

fn kinds_table(summary: &Summary, limited_by_physics: bool) -> Table {
    let row = |kind: &KindSummary| {
        let after = kind
            .latched_after_s
            .map_or("–".into(), |[median, longest]| {
                format!("{median:.2} / {longest:.2} s")
            });
        vec![
            kind.kind.into(),
            format!("{} / {}", kind.violating, kind.cases),
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
        .filter(|kind| kind.limited_by_physics == limited_by_physics);
    Table {
        caption: "Largest speeds, rise and pressure after the fault. Worst case: its number, and \
                  the largest ratio of a value to its bound"
            .into(),
        columns: [
            "fault",
            "violations / cases",
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
    let row = |with: &HardwareSummary| {
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
        caption: "The same cases with protective hardware".into(),
        columns: [
            "fault",
            "hardware",
            "fastest up / down",
            "highest position",
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
            outcome.violations.join(", "),
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
            "To repeat case N and record it: hil-sim faults --seed {} --case N",
            summary.seed
        ),
        columns: [
            "case",
            "fault",
            "when",
            "violations",
            "fastest up / down",
            "bounds",
            "reason",
        ]
        .map(String::from)
        .into(),
        rows: summary.outcomes.iter().take(LISTED).map(row).collect(),
    }
}

/// One case as a report.
pub fn report_case(outcome: &Outcome) -> Report {
    let bounds = &outcome.bounds;
    let speed = |m_per_s: f64| format!("{m_per_s:.2} m/s");
    let height = |m: f64| format!("{:.0} mm", 1e3 * m);
    let pressure = |pa: f64| format!("{:.0} kPa", 1e-3 * pa);
    let row = |name: &str, highest, bound| vec![name.into(), highest, bound];
    let table = Table {
        caption: "Highest values after the fault".into(),
        columns: ["after the fault", "highest", "bound"]
            .map(String::from)
            .into(),
        rows: vec![
            row(
                "speed up",
                speed(outcome.speed_up_m_per_s_max),
                speed(bounds.speed_up_m_per_s),
            ),
            row(
                "speed down",
                speed(outcome.speed_down_m_per_s_max),
                speed(bounds.speed_down_m_per_s),
            ),
            row(
                "height",
                height(outcome.height_m_max),
                height(bounds.height_m),
            ),
            row(
                "pressure",
                pressure(outcome.pressure_pa_max),
                pressure(bounds.pressure_pa),
            ),
        ],
    };
    let latched = match (outcome.reason, outcome.latched_after_s) {
        (Some(reason), Some(after_s)) => format!("{} latched after {after_s:.2} s", reason.name()),
        (Some(reason), None) => format!("{} latched", reason.name()),
        (None, _) => "no fault latched".into(),
    };
    Report {
        title: format!("Case {} of the fault campaign", outcome.case),
        verdict: vec![
            match outcome.violations.as_slice() {
                [] => "It violates none of its bounds.".into(),
                violations => format!("It violates bounds: {}.", violations.join(", ")),
            },
            format!(
                "Fault: {}, {:?}, {:.2} s.",
                outcome.fault, outcome.moment, outcome.fault_s
            ),
            format!("Controller: {latched}, final mode {}.", outcome.mode.name()),
        ],
        sections: vec![Section {
            heading: "Motion and pressure".into(),
            tables: vec![table],
            ..Section::default()
        }],
        repeat: Vec::new(),
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
                "{} of {} cases violate their bounds.",
                summary.violating, summary.cases
            ),
            "The cases use the controller that is flashed to the board.".into(),
        ],
        sections: vec![
            section(
                "Faults whose effect the controller limits",
                "Bounds: the trip speed plus free fall during its detection, the muscle's stroke, \
                 and 1.1 times the supply pressure.",
                kinds_table(summary, false),
            ),
            section(
                "Faults whose effect only energy limits",
                "The controller cannot influence the motion, for example if the hose is off. \
                 Bounds: the work of the supply pressure on the weight, and free fall from the \
                 height that this reaches.",
                kinds_table(summary, true),
            ),
            section(
                "What hardware would do",
                "The check valve sits in the muscle's port and shuts 10 ms after air, voltage or \
                 the pulses of the ticks are lost; the stop begins at a contraction of 0.28, the \
                 relief valve at 420 kPa; the throttle lets 3e-8 kg/(Pa·s) pass, the damper \
                 0.25 m/s under the weight.",
                hardware_table(summary),
            ),
            section(
                "Worst cases",
                "Sorted by the largest ratio of a value to its bound.",
                cases_table(summary),
            ),
        ],
        repeat: Vec::new(),
    }
}

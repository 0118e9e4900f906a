//! Whether a record is fit for a diagnosis: sampling, noise, signs of defective sensors, and the
//! range over which its signals move.
//!
//! No limit is tuned to a rig. A limit follows from the noise, from the typical size of an effect
//! (see the catalogue, [`muscle_plant::effects`]), or from what is visible in a plot.

mod signal;
mod units;

pub use signal::Signal;
pub use units::refuse_units;

use crate::error::BadInput;
use crate::record::{
    CONTRACTION, FINGER_M, FORCE_N, INPUT_FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA,
    TEMPERATURE_K,
};
use crate::rig::Rig;
use muscle_plant::effects::{Catalogue, Equation, Requirement};
use muscle_plant::nominal::Load;
use serde::Serialize;
pub(crate) use signal::quantile;
use std::collections::BTreeMap;

/// The columns that are checked.
const SIGNALS: [&str; 8] = [
    PRESSURE_REF_PA,
    PRESSURE_PA,
    CONTRACTION,
    FORCE_N,
    FINGER_M,
    INPUT_FORCE_N,
    SUPPLY_PA,
    TEMPERATURE_K,
];

/// Fewer rows do not determine the dozen nominal values of a rig.
const ROWS_MIN: usize = 100;
/// The estimate of the initial state alone needs the first second \[s\].
const LENGTH_S_MIN: f64 = 1.0;
/// Where a record that is too short may come from.
const IN_MINUTES: &str = " (in min or h? `hil-sim import --unit time_s=min` converts it)";
/// The fastest effects (valve lag, transport delay) have times of at least 10 ms, typically 20 ms
/// \[s\].
const PERIOD_S_MAX: f64 = 0.02;
/// Allowance for times that are written with few digits.
const ROUNDING: f64 = 1.05;
/// Standard deviation of the times between rows over their median. Beyond it rows are displaced by
/// up to a third of the period, and rates from row to row have errors of the same size.
const JITTER_MAX: f64 = 0.2;
/// A gap is longer than this many times the 90 % quantile of the times between rows; a single
/// missed row gives 2.
const GAP_PERIODS: f64 = 1.5;
const GAP_SHARE: f64 = 0.9;
/// With fewer sensor steps in its range, a signal's rounding error exceeds 1 % of the range:
/// 100/√12.
const STEPS_MIN: f64 = 29.0;
/// Creep is identified per decade of time: the decade after the first second \[s\].
const HOLD_S: f64 = 10.0;
/// A vented muscle is below this gauge pressure, at which dead bands begin \[Pa\].
const VENTED_PA: f64 = 8e3;
/// Reversals in a closed loop.
const LOOP_REVERSALS: usize = 2;
/// Reversals in three cycles, over which run-in decays.
const CYCLE_REVERSALS: usize = 5;

/// The sampling of a record.
#[derive(Clone, Debug, Serialize)]
pub struct Sampling {
    /// Number of rows.
    pub rows: usize,
    /// Time from the first row to the last \[s\].
    pub length_s: f64,
    /// Median time from row to row \[s\]; 0 for a single row.
    pub period_s: f64,
    /// RMS deviation of the times between rows from their median, without gaps, over the median
    /// \[-\].
    pub jitter: f64,
    /// Number of gaps.
    pub gaps: usize,
    /// Longest time between two rows \[s\].
    pub longest_s: f64,
}

/// A defect of a record.
#[derive(Clone, Debug, PartialEq, Serialize, thiserror::Error)]
#[serde(tag = "finding", rename_all = "kebab-case")]
pub enum Finding {
    /// Error: fewer rows than a diagnosis needs.
    #[error("fewer than {} rows: {rows}", ROWS_MIN)]
    FewRows {
        /// Number of rows.
        rows: usize,
    },
    /// Error: shorter than a diagnosis needs.
    #[error("only {length_s:.3} s, less than {} s{IN_MINUTES}", LENGTH_S_MIN)]
    Short {
        /// Length of the record \[s\].
        length_s: f64,
    },
    /// Error: a column without a sample.
    #[error("`{signal}` has no sample")]
    Empty {
        /// The column.
        signal: &'static str,
    },
    /// Error: neither reference nor pressure, one of which is the input of a simulation.
    #[error("neither `pressure_ref_pa` nor `pressure_pa`")]
    NoInput,
    /// Error: no signal to compare a simulation with.
    #[error("no signal that depends on the pressure was measured")]
    NoResponse,
    /// Error: constant, while a signal that it depends on changes.
    #[error("`{signal}` is {value} throughout, while `{while_moves}` changes")]
    Dead {
        /// The column.
        signal: &'static str,
        /// Its value.
        value: f64,
        /// A column that changes.
        while_moves: &'static str,
    },
    /// Error: numbers that cannot be in the unit that the column's name says.
    #[error("`{signal}`: expected {expected}{}; `{command}` converts it", most_likely(.likely))]
    Unit {
        /// The column.
        signal: &'static str,
        /// What was expected, and what was found.
        expected: String,
        /// The likely unit; empty if there is none.
        likely: String,
        /// The command that converts the record.
        command: String,
    },
    /// Gaps between rows.
    #[error("gaps: {count}, the first at {first_s} s, the longest {longest_s:.4} s")]
    Gaps {
        /// Number of gaps.
        count: usize,
        /// Start of the first gap \[s\].
        first_s: f64,
        /// Length of the longest gap \[s\].
        longest_s: f64,
    },
    /// Rows with the time of the row before, as rounded clocks have.
    #[error(
        "{count} rows with the time of the row before, the first on line {first_line}: half a \
             row later is taken"
    )]
    Repeated {
        /// Number of rows.
        count: usize,
        /// Line of the first.
        first_line: usize,
    },
    /// Unequal times between rows.
    #[error("times between rows differ by {:.0} % RMS", 100.0 * .jitter)]
    Uneven {
        /// See [`Sampling::jitter`].
        jitter: f64,
    },
    /// Sampling too slow for the fastest effects.
    #[error("one row every {:.0} ms, some valves and lines are faster", 1e3 * .period_s)]
    Slow {
        /// Median time from row to row \[s\].
        period_s: f64,
    },
    /// Empty cells.
    #[error(
        "`{signal}` lacks {:.2} % of its samples, for up to {longest_gap_s:.3} s",
        100.0 * .share
    )]
    Missing {
        /// The column.
        signal: &'static str,
        /// Share of all cells \[-\].
        share: f64,
        /// The longest time between two samples \[s\].
        longest_gap_s: f64,
    },
    /// Constant, which may be correct: a clamped bench, a constant weight.
    #[error("`{signal}` is {value} throughout: held, or a defective sensor")]
    Constant {
        /// The column.
        signal: &'static str,
        /// Its value.
        value: f64,
    },
    /// No change beyond the noise.
    #[error("`{signal}` does not change by more than its noise")]
    Still {
        /// The column.
        signal: &'static str,
    },
    /// Few sensor steps in the signal's range.
    #[error("`{signal}` has only {steps} steps of its sensor in its range")]
    Coarse {
        /// The column.
        signal: &'static str,
        /// Number of steps.
        steps: f64,
    },
    /// The signal stays at its exact extreme, without noise.
    #[error(
        "`{signal}` is at {value} without its noise for {:.1} % of its samples: clipped, or a stop",
        100.0 * .share
    )]
    Clipped {
        /// The column.
        signal: &'static str,
        /// The value.
        value: f64,
        /// Share of all samples \[-\].
        share: f64,
    },
    /// Single samples far from their neighbours.
    #[error("spikes in `{signal}`: {count}, the first at {first_s} s")]
    Spikes {
        /// The column.
        signal: &'static str,
        /// Number of spikes.
        count: usize,
        /// Time of the first spike \[s\].
        first_s: f64,
    },
}

/// Whether a record is sufficient to diagnose one subsystem of the plant.
#[derive(Clone, Debug, Serialize)]
pub struct Subsystem {
    /// Name of the subsystem.
    #[serde(rename = "block")]
    pub name: &'static str,
    /// Whether the record is sufficient.
    pub enough: bool,
    /// The signals and conditions that are missing.
    pub missing: Vec<&'static str>,
    /// Effects that the record hardly shows, or hardly distinguishes from others, with what it
    /// lacks for them.
    pub blind_to: Vec<String>,
}

/// The result of [`check`].
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// Sampling of the record.
    pub sampling: Sampling,
    /// The columns with samples.
    pub signals: Vec<Signal>,
    /// Whether a shut-off valve between valve and muscle was closed at some time (see
    /// [`crate::record::VALVE_OPEN`]).
    pub shutoff_valve_closed: bool,
    /// Findings that make a diagnosis impossible.
    pub errors: Vec<Finding>,
    /// Findings that make a diagnosis less accurate.
    pub warnings: Vec<Finding>,
}

/// What a diagnosis can make of a record: its check, with units, and the subsystems that it shows.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Sampling of the record.
    pub sampling: Sampling,
    /// The columns with samples.
    pub signals: Vec<Signal>,
    /// Findings that make a diagnosis impossible.
    pub errors: Vec<Finding>,
    /// Findings that make a diagnosis less accurate.
    pub warnings: Vec<Finding>,
    /// Subsystems that can be diagnosed.
    pub blocks: Vec<Subsystem>,
    /// Columns that nothing reads.
    pub left_out: Vec<String>,
}

/// The summary of `record`, of `rig` if that is known. Numbers that cannot be in the units that
/// their names say are errors, or warnings if they are to be taken as they are (`accept`).
///
/// # Errors
/// A column has almost the name of a known one that is absent.
pub fn summary(record: &Record, rig: Option<&Rig>, accept: bool) -> Result<Summary, BadInput> {
    record.check_names()?;
    let mut check = check(record);
    let doubted = check.units(record, rig);
    match accept {
        true => check.warnings.extend(doubted),
        false => check.errors.extend(doubted),
    }
    Ok(Summary {
        blocks: check.subsystems(
            &rig.map_or_else(Catalogue::standard, |rig| rig.catalogue.clone()),
            rig,
        ),
        sampling: check.sampling,
        signals: check.signals,
        errors: check.errors,
        warnings: check.warnings,
        left_out: record.left_out().into_iter().map(str::to_owned).collect(),
    })
}

/// Checks the sampling and the signals of `record`.
pub fn check(record: &Record) -> Check {
    let mut warnings = Vec::new();
    let repeated = record.repeated_times();
    warnings.extend(repeated.map(|(count, first_line)| Finding::Repeated { count, first_line }));
    let sampling = sampling(record.time_s(), &mut warnings);
    let signals = SIGNALS.iter().filter_map(|name| {
        let values = record.column(name)?;
        Some(Signal::of(name, record.time_s(), values, &mut warnings))
    });
    let mut check = Check {
        sampling,
        signals: signals.collect(),
        shutoff_valve_closed: !record.shut().is_empty(),
        errors: Vec::new(),
        warnings,
    };
    check.errors = check.find_errors(record);
    check
}

fn sampling(time_s: &[f64], warnings: &mut Vec<Finding>) -> Sampling {
    let steps_s: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let period_s = quantile(steps_s.clone(), 0.5);
    let gap_s = GAP_PERIODS * quantile(steps_s.clone(), GAP_SHARE);
    let (gaps, even): (Vec<usize>, Vec<usize>) =
        (0..steps_s.len()).partition(|row| steps_s[*row] > gap_s);
    let squares: f64 = even
        .iter()
        .map(|row| (steps_s[*row] - period_s).powi(2))
        .sum();
    let sampling = Sampling {
        rows: time_s.len(),
        length_s: time_s[time_s.len() - 1] - time_s[0],
        period_s,
        // Of no steps the sum is -0.
        jitter: (squares.abs() / even.len().max(1) as f64).sqrt() / period_s.max(f64::MIN_POSITIVE),
        gaps: gaps.len(),
        longest_s: steps_s.iter().copied().fold(0.0, f64::max),
    };
    if let Some(first) = gaps.first() {
        warnings.push(Finding::Gaps {
            count: gaps.len(),
            first_s: time_s[*first],
            longest_s: sampling.longest_s,
        });
    }
    if sampling.jitter > JITTER_MAX {
        warnings.push(Finding::Uneven {
            jitter: sampling.jitter,
        });
    }
    if period_s > PERIOD_S_MAX * ROUNDING {
        warnings.push(Finding::Slow { period_s });
    }
    sampling
}

impl Check {
    /// The signal of a column, if it has samples.
    pub fn signal(&self, name: &str) -> Option<&Signal> {
        self.signals.iter().find(|signal| signal.name == name)
    }

    fn has(&self, name: &str) -> bool {
        self.signal(name).is_some()
    }

    fn moves(&self, name: &str) -> bool {
        self.signal(name).is_some_and(Signal::moves)
    }

    /// The findings that make a diagnosis of `record` impossible.
    fn find_errors(&self, record: &Record) -> Vec<Finding> {
        let mut errors = Vec::new();
        let Sampling { rows, length_s, .. } = self.sampling;
        if rows < ROWS_MIN {
            errors.push(Finding::FewRows { rows });
        }
        if length_s < LENGTH_S_MIN {
            errors.push(Finding::Short { length_s });
        }
        let empty = |name: &&&str| record.is_empty_column(name);
        let empty = SIGNALS.iter().filter(empty);
        errors.extend(empty.map(|signal| Finding::Empty { signal }));
        let driven = self.has(PRESSURE_REF_PA);
        if !driven && !self.has(PRESSURE_PA) {
            errors.push(Finding::NoInput);
            return errors;
        }
        let follows = [CONTRACTION, FORCE_N];
        let followed = follows.iter().any(|name| self.has(name));
        if !(followed || driven && self.has(PRESSURE_PA)) {
            errors.push(Finding::NoResponse);
            return errors;
        }
        // The pressure changes if the reference, the contraction or the force does. Contraction or
        // force alone may be constant, as on a bench that clamps the muscle or at a stop; both
        // together may not while the pressure changes.
        let is_constant = |name: &str| self.signal(name).is_none_or(Signal::is_constant);
        let (judged, by): (&[&str], &[&'static str]) =
            if self.has(PRESSURE_PA) && is_constant(PRESSURE_PA) {
                (&[PRESSURE_PA], &[PRESSURE_REF_PA, CONTRACTION, FORCE_N])
            } else if !driven && follows.iter().all(|name| is_constant(name)) {
                (&follows, &[PRESSURE_PA])
            } else {
                return errors;
            };
        if let Some(while_moves) = by.iter().find(|name| self.moves(name)) {
            let dead = judged.iter().filter_map(|name| self.signal(name));
            errors.extend(dead.map(|signal| Finding::Dead {
                signal: signal.name,
                value: signal.min,
                while_moves,
            }));
        }
        errors
    }

    /// Refuses a record that cannot be diagnosed.
    ///
    /// # Errors
    /// The first of [`Check::errors`](field@Check::errors).
    pub fn refuse(&self, record: &Record) -> Result<(), BadInput> {
        self.errors
            .first()
            .map_or(Ok(()), |error| Err(error.refusal(record)))
    }

    /// Which subsystems of the plant can be diagnosed, of `rig` if one is given, and which effects
    /// of `catalogue` the record hardly shows.
    pub fn subsystems(&self, catalogue: &Catalogue, rig: Option<&Rig>) -> Vec<Subsystem> {
        let weight = rig.is_some_and(|rig| matches!(rig.nominal.load, Load::Weight(_)));
        let unless = |present: bool, missing: &'static str| (!present).then_some(missing);
        let pressure = || {
            [
                unless(self.has(PRESSURE_PA), "pressure_pa"),
                unless(self.moves(PRESSURE_PA), "a pressure that moves"),
            ]
        };
        let contraction = unless(self.has(CONTRACTION), "contraction");
        let mut gas = pressure().into_iter().chain([
            unless(self.has(PRESSURE_REF_PA), "pressure_ref_pa"),
            contraction,
        ]);
        let mut force = pressure().into_iter().chain([
            contraction,
            unless(
                self.has(FORCE_N) || weight,
                "force_n, or a rig with a weight",
            ),
        ]);
        let mut load = pressure().into_iter().chain([
            contraction,
            unless(self.moves(CONTRACTION), "a contraction that moves"),
            unless(weight, "a rig with a weight (--rig)"),
        ]);
        let subsystem = |name, missing: &mut dyn Iterator<Item = _>, equation, others: &[_]| {
            let missing: Vec<&'static str> = missing.flatten().collect();
            let blind_to = match missing.is_empty() {
                true => self.blind_to(catalogue, equation, others),
                false => Vec::new(),
            };
            Subsystem {
                name,
                enough: missing.is_empty() && self.errors.is_empty(),
                missing,
                blind_to,
            }
        };
        // What the record lacks for more than an effect.
        let of_force = [
            (Requirement::MeasuredForce, "muscle against load"),
            (Requirement::Motion, "what else depends on the contraction"),
        ];
        vec![
            subsystem("valve and gas", &mut gas, Equation::Gas, &[]),
            subsystem("muscle force", &mut force, Equation::MuscleForce, &of_force),
            subsystem("load", &mut load, Equation::Load, &[]),
        ]
    }

    /// What the record hardly shows of `equation`, effects of the catalogue and `others`: see
    /// [`Subsystem::blind_to`].
    fn blind_to(
        &self,
        catalogue: &Catalogue,
        equation: Equation,
        others: &[(Requirement, &'static str)],
    ) -> Vec<String> {
        let kinds = catalogue.kinds();
        let required = kinds
            .filter(|kind| kind.equations.contains(&equation))
            .flat_map(|kind| kind.requires.iter().map(|required| (*required, kind.name)));
        let mut names: BTreeMap<Requirement, Vec<&str>> = BTreeMap::new();
        for (requirement, name) in required.chain(others.iter().copied()) {
            names.entry(requirement).or_default().push(name);
        }
        let blind = names.iter().filter_map(|(requirement, names)| {
            let lack = self.lack(*requirement)?;
            Some(format!("{}: {lack}", names.join(", ")))
        });
        blind.collect()
    }

    /// What the record lacks of `requirement`, if anything.
    fn lack(&self, requirement: Requirement) -> Option<String> {
        let Sampling { period_s, .. } = self.sampling;
        let passes = |name, test: fn(&Signal) -> bool| self.signal(name).is_some_and(test);
        let is_held = |name| passes(name, |signal| signal.longest_hold_s >= HOLD_S);
        let (is_met, lack) = match requirement {
            Requirement::MeasuredForce => (self.has(FORCE_N), format!("no {FORCE_N}")),
            Requirement::Motion => (self.moves(CONTRACTION), "one contraction only".into()),
            Requirement::MeasuredSupply => (
                self.has(SUPPLY_PA),
                format!("hard to distinguish without {SUPPLY_PA}"),
            ),
            Requirement::FastSampling => (
                period_s <= PERIOD_S_MAX * ROUNDING,
                format!(
                    "nothing shorter than two rows, with one every {:.0} ms",
                    1e3 * period_s
                ),
            ),
            Requirement::ReferenceStep => (
                passes(PRESSURE_REF_PA, |signal| signal.steps > 0),
                "no step of the reference".into(),
            ),
            Requirement::ReferenceHold => (
                self.shutoff_valve_closed || is_held(PRESSURE_REF_PA),
                format!("no hold of the reference for {HOLD_S} s"),
            ),
            Requirement::PressureHold => (
                is_held(PRESSURE_PA),
                format!("no hold of the pressure for {HOLD_S} s"),
            ),
            Requirement::Vented => (
                passes(PRESSURE_PA, |signal| signal.min <= VENTED_PA),
                format!(
                    "hard to distinguish, never vented (below {} kPa)",
                    1e-3 * VENTED_PA
                ),
            ),
            Requirement::TwoReversals => (
                passes(CONTRACTION, |signal| signal.reversals >= LOOP_REVERSALS),
                "the contraction does not reverse twice".into(),
            ),
            Requirement::ThreeCycles => (
                passes(CONTRACTION, |signal| signal.reversals >= CYCLE_REVERSALS),
                "fewer than three cycles".into(),
            ),
        };
        (!is_met).then_some(lack)
    }
}

/// The likely unit, at the end of a sentence.
fn most_likely(unit: &str) -> String {
    match unit {
        "" => String::new(),
        unit => format!(", most likely {unit}"),
    }
}

impl Finding {
    /// The finding as bad input of `record`, with the place and what was expected.
    pub fn refusal(&self, record: &Record) -> BadInput {
        let file = |expected: String| record.bad_file(&expected);
        match self {
            Finding::FewRows { rows } => file(format!("at least {ROWS_MIN} rows, found {rows}")),
            Finding::Short { length_s } => file(format!(
                "at least {LENGTH_S_MIN} s of samples, found {length_s:.3} s{IN_MINUTES}"
            )),
            Finding::Empty { signal } => record.bad(signal, "at least one sample, found none"),
            Finding::NoInput => file(format!(
                "a column `{PRESSURE_REF_PA}` or `{PRESSURE_PA}`, found neither"
            )),
            Finding::NoResponse => file(format!(
                "a signal that depends on the pressure, `{CONTRACTION}` or `{FORCE_N}`, found \
                 neither"
            )),
            Finding::Dead {
                signal,
                value,
                while_moves,
            } => record.bad(
                signal,
                &format!("samples that change, as `{while_moves}` does, found {value} throughout"),
            ),
            Finding::Unit {
                signal,
                expected,
                likely,
                ..
            } => record.bad(signal, &(expected.clone() + &most_likely(likely))),
            warning => file(format!("a record without this: {warning}")),
        }
    }
}

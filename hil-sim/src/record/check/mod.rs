//! Is a record fit for a diagnosis? Sampling, noise, the marks of broken sensors, and how far it
//! has moved what it measures.
//!
//! Nothing here is tuned to a rig: a limit is where noise ends, where an effect's usual size begins
//! (the sizes of the catalogue, [`muscle_plant::effects`]), or what the reader of a plot would call one.

mod signal;

pub use signal::Signal;

use crate::error::BadInput;
use crate::record::{
    CONTRACTION, FINGER_M, FORCE_N, INPUT_FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA,
    TEMPERATURE_K,
};
use crate::rig::Rig;
use muscle_plant::nominal::Load;
use serde::Serialize;
pub(crate) use signal::quantile;

/// The columns that are looked at.
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

/// Fewer rows cannot tell the dozen numbers of a rig from each other.
const ROWS_MIN: usize = 100;
/// The initial state alone takes the first second \[s\].
const LENGTH_S_MIN: f64 = 1.0;
/// The fastest effects (valve lag, transport delay) take 10 ms and more, mostly 20 \[s\].
const PERIOD_S_MAX: f64 = 0.02;
/// Times are written with few digits.
const ROUNDING: f64 = 1.05;
/// Spread of the times between rows, to their median: beyond it a row is a third of the way to its
/// neighbour at times, and rates that are taken from row to row are wrong by as much.
const JITTER_MAX: f64 = 0.2;
/// A gap is this much longer than nine of ten times between rows are: a missed row makes two.
const GAP_PERIODS: f64 = 1.5;
const GAP_SHARE: f64 = 0.9;
/// With fewer of its sensor's steps in its range a signal is wrong by 1 % of it: 100/√12.
const STEPS_MIN: f64 = 29.0;
/// Creep is told per decade of time: the one after the first second \[s\].
const HOLD_S: f64 = 10.0;
/// Dead bands begin here (gauge) \[Pa\]: a vented muscle is below.
const VENTED_PA: f64 = 8e3;
/// Run-in fades over cycles: three of them.
const CYCLE_REVERSALS: usize = 5;

/// How a record was sampled.
#[derive(Clone, Debug, Serialize)]
pub struct Sampling {
    /// Rows of samples.
    pub rows: usize,
    /// From the first to the last \[s\].
    pub length_s: f64,
    /// The median time from row to row \[s\]; 0 of a single row.
    pub period_s: f64,
    /// Root mean square of what the times between rows are off their median, gaps left out, to the
    /// median \[-\].
    pub jitter: f64,
    /// How many gaps there are.
    pub gaps: usize,
    /// The longest time between two rows \[s\].
    pub longest_s: f64,
}

/// What is wrong with a record.
#[derive(Clone, Debug, PartialEq, Serialize, thiserror::Error)]
#[serde(tag = "finding", rename_all = "kebab-case")]
pub enum Finding {
    /// Error: fewer rows than a diagnosis needs.
    #[error("only {rows} rows, fewer than {}", ROWS_MIN)]
    FewRows {
        /// How many.
        rows: usize,
    },
    /// Error: shorter than a diagnosis needs.
    #[error("only {length_s:.3} s, less than {} s", LENGTH_S_MIN)]
    Short {
        /// How long \[s\].
        length_s: f64,
    },
    /// Error: a column without a sample.
    #[error("`{signal}` has no sample")]
    Empty {
        /// The column.
        signal: &'static str,
    },
    /// Error: neither reference nor pressure, so nothing to drive a simulation with.
    #[error("neither `pressure_ref_pa` nor `pressure_pa`")]
    NoInput,
    /// Error: only inputs, so nothing to compare a simulation with.
    #[error("nothing that follows the pressure was measured")]
    NoResponse,
    /// Error: one value throughout, while what must move it or moves with it does.
    #[error("`{signal}` is {value} throughout, while `{while_moves}` moves")]
    Dead {
        /// The column.
        signal: &'static str,
        /// Its value.
        value: f64,
        /// A column that moves.
        while_moves: &'static str,
    },
    /// Times without rows.
    #[error("gaps: {count}, the first at {first_s} s, the longest {longest_s:.4} s")]
    Gaps {
        /// How many.
        count: usize,
        /// When the first begins \[s\].
        first_s: f64,
        /// The longest \[s\].
        longest_s: f64,
    },
    /// Times between rows differ.
    #[error("times between rows differ by {:.0} % RMS", 100.0 * .jitter)]
    Uneven {
        /// See [`Sampling::jitter`].
        jitter: f64,
    },
    /// Too slow for the fastest effects.
    #[error("a row each {:.0} ms, some valves and lines are faster", 1e3 * .period_s)]
    Slow {
        /// Median time from row to row \[s\].
        period_s: f64,
    },
    /// Empty cells.
    #[error("`{signal}` lacks {:.2} %, up to {longest_gap_s:.3} s at a time", 100.0 * .share)]
    Missing {
        /// The column.
        signal: &'static str,
        /// Of all cells.
        share: f64,
        /// The longest time between two samples \[s\].
        longest_gap_s: f64,
    },
    /// One value throughout, which may be so: a clamped bench, a constant weight.
    #[error("`{signal}` is {value} throughout: held, or a dead sensor")]
    Constant {
        /// The column.
        signal: &'static str,
        /// Its value.
        value: f64,
    },
    /// Noise, and no motion beyond it.
    #[error("`{signal}` does not leave its noise")]
    Still {
        /// The column.
        signal: &'static str,
    },
    /// The sensor has few steps in the range.
    #[error("`{signal}` has only {steps} steps of its sensor in its range")]
    Coarse {
        /// The column.
        signal: &'static str,
        /// How many.
        steps: f64,
    },
    /// The signal sits at its exact extreme without its noise.
    #[error(
        "`{signal}` is at {value} without its noise for {:.1} % of its samples: clipped, or a stop",
        100.0 * .share
    )]
    Clipped {
        /// The column.
        signal: &'static str,
        /// The value.
        value: f64,
        /// Of all samples.
        share: f64,
    },
    /// Single samples far from their neighbours.
    #[error("spikes in `{signal}`: {count}, the first at {first_s} s")]
    Spikes {
        /// The column.
        signal: &'static str,
        /// How many.
        count: usize,
        /// When the first is \[s\].
        first_s: f64,
    },
}

/// What can be said of one block of the plant.
#[derive(Clone, Debug, Serialize)]
pub struct Block {
    /// Its name.
    pub block: &'static str,
    /// The record is enough to diagnose it.
    pub enough: bool,
    /// What is missing for that.
    pub missing: Vec<&'static str>,
    /// What the record cannot show in it, and why.
    pub blind_to: Vec<&'static str>,
}

/// What [`check`] found.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// How it was sampled.
    pub sampling: Sampling,
    /// The columns with samples.
    pub signals: Vec<Signal>,
    /// A cock between valve and muscle was shut (see [`crate::record::VALVE_OPEN`]).
    pub cock_shut: bool,
    /// Why it cannot be diagnosed at all.
    pub errors: Vec<Finding>,
    /// What a diagnosis will suffer from.
    pub warnings: Vec<Finding>,
}

/// Looks at what `record` measured.
pub fn check(record: &Record) -> Check {
    let mut warnings = Vec::new();
    let sampling = sampling(record.time_s(), &mut warnings);
    let signals = SIGNALS.iter().filter_map(|name| {
        let values = record.column(name)?;
        Some(Signal::of(name, record.time_s(), values, &mut warnings))
    });
    let mut check = Check {
        sampling,
        signals: signals.collect(),
        cock_shut: !record.shut().is_empty(),
        errors: Vec::new(),
        warnings,
    };
    check.errors = check.errors(record);
    check
}

fn sampling(time_s: &[f64], warnings: &mut Vec<Finding>) -> Sampling {
    let steps_s: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let period_s = quantile(steps_s.clone(), 0.5);
    let off = |step_s: &f64| (step_s - period_s).abs();
    let gap_s = GAP_PERIODS * quantile(steps_s.clone(), GAP_SHARE);
    let (gaps, even): (Vec<usize>, Vec<usize>) =
        (0..steps_s.len()).partition(|row| steps_s[*row] > gap_s);
    let squares: f64 = even.iter().map(|row| off(&steps_s[*row]).powi(2)).sum();
    let sampling = Sampling {
        rows: time_s.len(),
        length_s: time_s[time_s.len() - 1] - time_s[0],
        period_s,
        jitter: (squares / even.len().max(1) as f64).sqrt() / period_s.max(f64::MIN_POSITIVE),
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

    fn errors(&self, record: &Record) -> Vec<Finding> {
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
        // The pressure of a muscle that is driven, lifts or pulls moves. What follows it may rest:
        // a bench that clamps the muscle, a stop. But then something else has to follow.
        let rests = |name: &str| self.signal(name).is_none_or(Signal::is_constant);
        let (judged, by): (&[&str], &[&'static str]) =
            if self.has(PRESSURE_PA) && rests(PRESSURE_PA) {
                (&[PRESSURE_PA], &[PRESSURE_REF_PA, CONTRACTION, FORCE_N])
            } else if !driven && follows.iter().all(|name| rests(name)) {
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

    /// Refuses a record that cannot be diagnosed, by the first of its errors.
    ///
    /// # Errors
    /// There is one.
    pub fn refuse(&self, record: &Record) -> Result<(), BadInput> {
        self.errors
            .first()
            .map_or(Ok(()), |error| Err(error.refusal(record)))
    }

    /// Which blocks of the plant can be diagnosed, of `rig` if one is given.
    pub fn blocks(&self, rig: Option<&Rig>) -> Vec<Block> {
        let weight = rig.is_some_and(|rig| matches!(rig.nominal.load, Load::Weight(_)));
        let unless = |there: bool, missing: &'static str| (!there).then_some(missing);
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
        let block = |block, missing: &mut dyn Iterator<Item = _>, blind_to: Vec<_>| {
            let missing: Vec<&'static str> = missing.flatten().collect();
            Block {
                block,
                enough: missing.is_empty() && self.errors.is_empty(),
                blind_to: blind_to
                    .into_iter()
                    .filter(|_| missing.is_empty())
                    .collect(),
                missing,
            }
        };
        vec![
            block("valve and gas", &mut gas, self.gas_is_blind_to()),
            block("muscle force", &mut force, self.force_is_blind_to()),
            block("load", &mut load, self.load_is_blind_to()),
        ]
    }

    fn gas_is_blind_to(&self) -> Vec<&'static str> {
        let of = |name: &str, what: fn(&Signal) -> bool| self.signal(name).is_some_and(what);
        let mut blind = Vec::new();
        if !of(PRESSURE_REF_PA, |signal| signal.steps > 0) {
            blind.push("lag, delay and flow limit: no step of the reference");
        } else if self.sampling.period_s > PERIOD_S_MAX * ROUNDING {
            blind.push("lag and delay below two samples");
        }
        if !self.cock_shut && !of(PRESSURE_REF_PA, |signal| signal.longest_hold_s >= HOLD_S) {
            blind.push("leak and dead zone of the valve: no hold of the reference for 10 s");
        }
        if !self.has(SUPPLY_PA) {
            blind.push("supply against flow limit: no supply_pa");
        }
        blind
    }

    fn force_is_blind_to(&self) -> Vec<&'static str> {
        let Some(pressure) = self.signal(PRESSURE_PA) else {
            return Vec::new();
        };
        let mut blind = Vec::new();
        let reversals = pressure
            .reversals
            .max(self.signal(CONTRACTION).map_or(0, |c| c.reversals));
        if reversals < 2 {
            blind.push("hysteresis: the direction does not change twice");
        }
        if reversals < CYCLE_REVERSALS {
            blind.push("run-in: fewer than three cycles");
        }
        if pressure.longest_hold_s < HOLD_S {
            blind.push("creep: no hold of the pressure for 10 s");
        }
        if pressure.min > VENTED_PA {
            blind.push("dead band and slack against sensor offsets: never vented (below 8 kPa)");
        }
        if !self.has(FORCE_N) {
            blind.push("muscle against load: no force_n");
        }
        if !self.moves(CONTRACTION) {
            blind.push("what depends on the contraction: one contraction only");
        }
        blind
    }

    fn load_is_blind_to(&self) -> Vec<&'static str> {
        let reversals = self
            .signal(CONTRACTION)
            .map_or(0, |signal| signal.reversals);
        let blind = (reversals < 2).then_some("friction and backlash: no two reversals");
        blind.into_iter().collect()
    }
}

impl Finding {
    /// The finding as bad input of `record`: what was expected, and where.
    pub fn refusal(&self, record: &Record) -> BadInput {
        let file = |expected: String| record.bad_file(&expected);
        match self {
            Finding::FewRows { rows } => file(format!("at least {ROWS_MIN} rows, found {rows}")),
            Finding::Short { length_s } => file(format!(
                "at least {LENGTH_S_MIN} s of samples, found {length_s:.3} s"
            )),
            Finding::Empty { signal } => record.bad(signal, "at least one sample, found none"),
            Finding::NoInput => file(format!(
                "a column `{PRESSURE_REF_PA}` or `{PRESSURE_PA}`, found neither"
            )),
            Finding::NoResponse => file(format!(
                "something that follows the pressure, `{CONTRACTION}` or `{FORCE_N}`, found neither"
            )),
            Finding::Dead {
                signal,
                value,
                while_moves,
            } => record.bad(
                signal,
                &format!("samples that change, as `{while_moves}` does, found {value} throughout"),
            ),
            warning => file(format!("a record without this: {warning}")),
        }
    }
}

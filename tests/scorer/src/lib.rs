//! Measures how well `hil-sim diagnose` finds hidden effects in simulated rigs that it does not
//! know.
//!
//! The cases are those of the family whose laws are drawn: of ten always three with one effect, two
//! with two, one with three, two with none and two with an unlisted one. Seeds below 10000 are the
//! working set; the others are run for figures alone:
//!
//! ```text
//! cargo build --release && cargo run --release -p scorer -- run --seed 1 --count 200
//! cargo run --release -p scorer -- run --seed 10000 --count 1000 --out out/score-reported
//! cargo run --release -p scorer -- run --seed 10001 --kind none --count 400 \
//!     --out out/score-healthy
//! ```
//!
//! It prints a summary and writes `out/score/score.{json,html}`. An interrupted run is continued. A
//! small subset for CI, with exit status 1 if a figure is outside its required range:
//!
//! ```text
//! cargo run --release -p scorer -- run --family catalogue-like --count 10 --out out/small --check
//! ```
//!
//! More cases of one kind (`--kind none --count 100 --out out/score-none`) reduce the uncertainty
//! of its figures. The ablations:
//!
//! ```text
//! cargo run --release -p scorer -- shuffled
//! cargo run --release -p scorer -- without --count 3
//! ```
//!
//! Methods that were run on the same cases are compared in a Markdown table, a row for each:
//!
//! ```text
//! cargo run --release -p scorer -- compare out/calibration out/mine
//! ```
//!
//! # Scoring
//!
//! A case counts if each hidden effect changes a signal of the held-out records by at least three
//! times its noise, and each can be distinguished from the others according to the generator's
//! answer; the other cases are reported separately.
//!
//! | hidden | right | wrong |
//! |---|---|---|
//! | one effect | its name and no other | any other name, more names, none |
//! | two or three | all names and no other | some of them, more, any other |
//! | none | `consistent` | any name (a false alarm), `unexplained` |
//! | unlisted | `unexplained` and no name | any name, `consistent` |
//!
//! A true name among the `alternatives` makes a case ambiguous: reported, not right. An output that
//! is missing, late or malformed, or that contradicts itself, is wrong.
//!
//! The gap is measured here, by simulating the nominal and the fitted rig on the validation records
//! and on one that the tool was not given, relative to the generator's own noise: (before − after)
//! / (before − noise), each a sum over the signals in units of their noise, and 0 without an
//! answer. Rates have Wilson's 95 % intervals, medians those of the order statistics.
//!
//! A signal is worse than before if its gap on validation or unseen records has grown by more than
//! 5 % and is more than a tenth above the noise; an entry of `warnings` in `diagnosis.json` that
//! has the signal's column name warns of it. Probabilities of names and of whole hypotheses, from
//! schema 2 on, are compared with the shares that are right, in ten bins.

pub mod answer;
pub mod child;
pub mod compare;
pub mod diagnosis;
pub mod figures;
pub mod gap;
pub mod outcome;
pub mod reliability;
pub mod report;
pub mod run;
pub mod scored;
pub mod shared;
pub mod shuffled;
pub mod statistics;
#[cfg(test)]
mod tests;
pub mod without;

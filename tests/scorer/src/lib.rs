//! Measures how well `hil-sim diagnose` names what is hidden in rigs it has never seen.
//!
//! The whole benchmark, from a seed that no one has looked at (200 cases, of ten always five with
//! one effect, two with two, one with none and two with an unlisted one):
//!
//! ```text
//! cargo build --release && cargo run --release -p scorer -- run --seed 1 --count 200
//! ```
//!
//! It prints a summary and writes `out/score/score.{json,html}`. A run that was interrupted goes on
//! where it was. A small subset for CI, whose exit status is 1 if a figure is not reached:
//!
//! ```text
//! cargo run --release -p scorer -- run --seed 1 --count 10 --out out/score-small --check
//! ```
//!
//! More cases of one kind make its figure sharper (`--kind none --count 100 --out out/score-none`).
//! The ablations:
//!
//! ```text
//! cargo run --release -p scorer -- shuffled
//! cargo run --release -p scorer -- without --count 3
//! ```
//!
//! # What is scored how
//!
//! A case counts if each hidden effect changes a signal of the validation records by more than
//! three times its noise, as the generator's answer says; the others are reported apart.
//!
//! | hidden | right | wrong |
//! |---|---|---|
//! | one effect | its name and no other | any other name, more names, none |
//! | two | both names and no other | one of two, more, any other |
//! | nothing | `consistent` | any name (a false alarm), `unexplained` |
//! | unlisted | `unexplained` and no name | any name, `consistent` |
//!
//! A true name among the `alternatives` makes a case ambiguous: reported, not right. An output that
//! is missing, late or malformed, or that contradicts itself, is wrong.
//!
//! The gap is measured here, by simulating the nominal and the fitted rig on the validation records
//! and on one that the tool was never given, against the generator's own noise: (before − after) /
//! (before − noise), each a sum over the signals in units of their noise, and 0 without an answer.
//! Rates have Wilson's 95 % intervals, medians those of the order statistics.

pub mod answer;
pub mod child;
pub mod diagnosis;
pub mod figures;
pub mod gap;
pub mod outcome;
pub mod report;
pub mod run;
pub mod scored;
pub mod shared;
pub mod shuffled;
pub mod statistics;
#[cfg(test)]
mod tests;
pub mod without;

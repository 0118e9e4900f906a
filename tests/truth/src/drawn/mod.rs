//! Cases with randomly drawn laws: each effect keeps its signature, while the shape of its
//! dependence, its kernel and its asymmetry are drawn from families of functions.
//!
//! # Drawn properties
//!
//! - Modulations by pressure, contraction, speed, direction or flow: random smooth functions
//!   (Fourier sums, Gaussian processes, splines, powers) of a logarithm, whose extremes differ by
//!   up to a factor of three in all.
//! - Kernels: thresholds of hysteresis over a decade and more with random densities, Bouc–Wen and
//!   Duhem with random numbers, and sums of these; relaxations over up to three decades of time
//!   constants, of strain or pressure or both; stages, layers, cells, paths.
//! - Rigs of 10 to 40 mm and 3 to 50 kg that lift their load, with valves of a factor of 30 in flow
//!   gain; the true values off the nominal by draws of the tolerances in `rig.toml`.
//! - Clocks of 20 Hz to 1 kHz, 15 % of them uneven; records of 20 s to 5 min, of at most 30 000
//!   rows; a quarter to six times the reference sensors' noise; with and without the force.
//! - Drives: steps, holds, bursts, triangles, sines, random sines, and an assist controller that
//!   closes the loop.
//! - Imperfections of every bench: a zero of each sensor with the error of the mean of 4 to 16
//!   readings, of pressure and force in each run, of contraction once per case; and in half of the
//!   cases a memory of motion before the record.
//!
//! # Two sets
//!
//! Seeds below [`REPORTING_SEED`] are the working set, for the development of a diagnosis; the
//! others are the reporting set, used only for published figures.

pub(crate) mod bench;
mod case;
mod drive;
mod effects;
mod record;
mod shape;
#[cfg(test)]
mod tests;

pub use case::{Plan, case, experiment, plan, rows};
pub use effects::{DRAWN, Entry};

/// First seed of the reporting set.
pub const REPORTING_SEED: u64 = 10_000;

/// The set that a seed belongs to, `working` or `reporting`.
#[must_use]
pub fn set(seed: u64) -> &'static str {
    if seed < REPORTING_SEED {
        "working"
    } else {
        "reporting"
    }
}

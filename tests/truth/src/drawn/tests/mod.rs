//! Tests of the drawn family: the integrator, the shapes, the law of each effect, and the cases.

mod cases;
mod integrator;
mod laws;
mod shapes;

use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::bench::{self, Bench};
use super::effects::{DRAWN, Entry, Law};
use crate::hidden::Moment;

/// Number of laws of an effect per test.
const LAWS: u64 = 40;

pub(super) fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

pub(super) fn entry(name: &str) -> &'static Entry {
    let entry = DRAWN.iter().find(|entry| entry.name == name);
    entry.expect("an effect")
}

pub(super) fn bench(seed: u64, near_supply: bool) -> Bench {
    Bench::of(bench::pair(near_supply, &mut rng(seed)).actual)
}

/// Laws of an effect, each on a rig of its own.
pub(super) fn laws(name: &str) -> Vec<(Bench, Law)> {
    let entry = entry(name);
    let law = |seed| {
        let bench = bench(seed, entry.near_supply);
        let law = (entry.draw)(&bench, seed as f64 / LAWS as f64, &mut rng(1000 + seed));
        (bench, law)
    };
    (0..LAWS).map(law).collect()
}

/// Halfway up at rest, at the middle pressure.
pub(super) fn moment(bench: &Bench) -> Moment {
    let contraction = 0.35 * bench.contraction_most;
    Moment {
        contraction,
        pressure_pa: bench.middle_pa(),
        temperature_k: bench.rig.ambient_temperature_k,
        ambient_k: bench.rig.ambient_temperature_k,
        area_m2: bench.rig.alpha_m2 * (1.0 - contraction).powi(2) + bench.rig.beta_m2,
        surface_m2: 0.02,
        command_pa: bench.middle_pa(),
        reference_pa: bench.middle_pa(),
        ..Moment::default()
    }
}

/// Steady states of a law at `now`.
pub(super) fn settled(law: &Law, now: &Moment) -> Vec<f64> {
    let mut x = vec![0.0; law.hidden.states()];
    law.hidden.settle(now, &mut x);
    x
}

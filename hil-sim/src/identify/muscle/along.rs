//! States of the load's terms along a measured motion.
//!
//! The deflection of a friction's bristles follows the way alone, so that a measured contraction
//! tells it where the weight does not visibly move either. What it was when the record began is
//! forgotten within some deflections; until then it may be anything between its bounds.

use muscle_plant::nominal::Weight;
use muscle_plant::subsystem::load::{LoadPoint, LoadSubsystem};
use muscle_plant::subsystem::term::Update;

/// By how much a state is moved to see how its rate depends on it.
const STEP: f64 = 1e-4;

/// States on their way from row to row, from the two ends of what they may be at the begin.
pub(super) struct Along {
    ends: [Vec<f64>; 2],
    /// When and where the last row was \[s\], \[-\].
    last: Option<(f64, f64)>,
    /// Rates \[1/s\], and with one state moved.
    rates: [Vec<f64>; 2],
}

impl Along {
    /// For terms with so many states.
    pub(super) fn new(states: usize) -> Along {
        let none = || [vec![0.0; states], vec![0.0; states]];
        Along {
            ends: none(),
            last: None,
            rates: none(),
        }
    }

    /// Takes the states on to the next row, in which the weight is at the contraction `place`: its
    /// constants and the external force that lifts it there \[N\], and by how much that may be off
    /// either way \[N\].
    pub(super) fn advance(
        &mut self,
        load: &LoadSubsystem,
        at: &LoadPoint,
        place: f64,
    ) -> (Weight, f64, f64) {
        if self.ends[0].is_empty() {
            let (weight, lifting_n) = load.constants(at, &[]);
            return (weight, lifting_n, 0.0);
        }
        for (end, share) in [1.0, -1.0].into_iter().enumerate() {
            let Some((time_s, last)) = self.last else {
                load.terms
                    .update(Update::SteadyState, at, &mut self.ends[end]);
                load.terms
                    .update(Update::BiasMemory(share), at, &mut self.ends[end]);
                continue;
            };
            // In a gap the way is not known; it is gone when that ends.
            if !place.is_finite() {
                continue;
            }
            let length_s = at.time_s - time_s;
            let way = place - last;
            let moving = LoadPoint {
                contraction: place,
                contraction_rate_per_s: way / length_s,
                direction: if way == 0.0 { 0.0 } else { way.signum() },
                ..*at
            };
            self.step(end, load, &moving, length_s);
        }
        if place.is_finite() {
            self.last = Some((at.time_s, place));
        }
        let lifted = |end: &Vec<f64>| load.constants(at, end);
        let [(weight, a_n), (_, b_n)] = [&self.ends[0], &self.ends[1]].map(lifted);
        (weight, 0.5 * (a_n + b_n), 0.5 * (a_n - b_n).abs())
    }

    /// Takes the states of `end` on by `length_s` at the rates of `at`: each for itself, exact
    /// where its rate is linear in it (exponential Euler), so that no step is too long.
    fn step(&mut self, end: usize, load: &LoadSubsystem, at: &LoadPoint, length_s: f64) {
        let [base, moved] = &mut self.rates;
        let state = &mut self.ends[end];
        base.fill(0.0);
        load.terms.rates(at, state, base);
        for i in 0..state.len() {
            let own = state[i];
            state[i] += STEP;
            moved.fill(0.0);
            load.terms.rates(at, state, moved);
            state[i] = own;
            let exponent = (moved[i] - base[i]) / STEP * length_s;
            let share = if exponent.abs() < 1e-9 {
                1.0
            } else {
                exponent.exp_m1() / exponent
            };
            base[i] *= length_s * share;
        }
        for (state, change) in state.iter_mut().zip(base) {
            *state += *change;
        }
        load.terms.update(Update::AcceptStep, at, state);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use muscle_plant::effects::Catalogue;
    use muscle_plant::subsystem::Term;
    use muscle_plant::subsystem::term::Terms;

    /// Bristles of a Coulomb force of 10 N that bend by 0.3 mm, on a muscle of 0.3 m.
    fn bristles() -> LoadSubsystem {
        let kind = Catalogue::standard().find("friction").expect("friction");
        let form = kind.form("lugre").expect("bristles");
        let mut terms = Terms::default();
        if let Term::Load(term) = (form.build)(&[10.0, 1.0, 3e-4]) {
            terms.push(term, 0);
        }
        LoadSubsystem {
            weight: Weight {
                mass_kg: 10.0,
                viscous_damping_ns_per_m: 0.0,
                coulomb_friction_n: 0.0,
                static_friction_n: 0.0,
            },
            initial_length_m: 0.3,
            terms,
        }
    }

    /// The force and its doubt \[N\], row by row, on the way through `places`.
    fn forces_n(places: &[f64]) -> Vec<(f64, f64)> {
        let load = bristles();
        let mut along = Along::new(1);
        let rows = places.iter().enumerate().map(|(row, place)| {
            let at = LoadPoint {
                time_s: 0.01 * row as f64,
                contraction: *place,
                contraction_rate_per_s: 0.0,
                direction: 0.0,
                initial_length_m: 0.3,
            };
            let (_, lifting_n, doubt_n) = along.advance(&load, &at, *place);
            (lifting_n, doubt_n)
        });
        rows.collect()
    }

    #[test]
    fn bristles_follow_the_way_and_forget_how_they_began() {
        // At rest, up by 12 deflections, a rest, and back by one.
        let found = forces_n(&[0.1, 0.1, 0.106, 0.112, 0.112, 0.1115, 0.111]);
        let back_n = 10.0 * (1.0 - 2.0 * (-1.0_f64).exp());
        let expected = [
            (0, (0.0, 10.0)),
            (1, (0.0, 10.0)),
            (2, (-10.0, 0.0)),
            (3, (-10.0, 0.0)),
            (4, (-10.0, 0.0)),
            (6, (back_n, 0.0)),
        ];
        for (row, (lifting_n, doubt_n)) in expected {
            assert!((found[row].0 - lifting_n).abs() < 0.05, "{found:?}");
            assert!((found[row].1 - doubt_n).abs() < 0.05, "{found:?}");
        }
    }

    #[test]
    fn a_gap_at_the_begin_is_gone_when_it_ends() {
        let found = forces_n(&[f64::NAN, f64::NAN, 0.1, 0.106]);
        for (row, expected) in [(2, (0.0, 10.0)), (3, (-10.0, 0.0))] {
            assert!((found[row].0 - expected.0).abs() < 0.05, "{found:?}");
            assert!((found[row].1 - expected.1).abs() < 0.05, "{found:?}");
        }
    }
}

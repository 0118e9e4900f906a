//! The muscle's force along a measured motion.

use crate::identify::inputs::Inputs;
use crate::record::Record;
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use muscle_plant::effects::{DecayingForce, Effect, Observation};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{CONTRACTION, Drive, PRESSURE, Plant, STATES_MAX, Simulated};
use muscle_plant::subsystem::sensors::Reading;
use muscle_plant::subsystem::term::Update;
use std::borrow::Cow;
use std::ops::Range;

/// States that differ by less are the same.
const SAME: f64 = 1e-8;
/// Change of the pressure's reading from which the slope of the force is taken \[Pa\].
const PRESSURE_STEP_PA: f64 = 100.0;

/// Rows for which the slope of the force is taken once: noise is weighed by it, and it changes
/// little in so many.
const SLOPE_ROWS: usize = 8;

/// Which force.
#[derive(Clone, Copy)]
pub(super) enum Force {
    /// That which the sensor reads.
    Read,
    /// That which the muscle has.
    True,
}

/// The force that a muscle may have at a row.
#[derive(Clone, Copy, Debug)]
pub(super) struct ForceRange {
    pub(super) least_n: f64,
    pub(super) most_n: f64,
    /// Its slope by the pressure's reading \[m²\]; 0 where the force itself is read.
    pub(super) per_pressure_m2: f64,
}

/// What a state that fades adds where it was one unit too large at the begin.
#[derive(Default)]
pub(super) struct Fading {
    /// To the force, row by row \[N\].
    pub(super) force_n: Vec<f64>,
    /// To its slope by the pressure's reading \[m²\].
    pub(super) per_pressure_m2: Vec<f64>,
}

/// A muscle that is driven through a record.
struct Driven<'a> {
    plant: Plant,
    /// Of each effect that has one, with where its states stand.
    observations: Vec<(Range<usize>, Box<dyn Observation>)>,
    inputs: Inputs<'a>,
    force: Force,
}

/// Forces \[N\], row by row, of a muscle that began with its memory at −1 and at 1.
struct Ends {
    forces_n: [Vec<f64>; 2],
    per_pressure_m2: Vec<f64>,
    /// From this row on they are the same: the begin is forgotten.
    met: usize,
}

/// Forces \[N\] and, of the first, slopes by the pressure's reading \[m²\], row by row, of a muscle
/// with several begins.
struct Ran<const N: usize> {
    forces_n: [Vec<f64>; N],
    per_pressure_m2: Vec<f64>,
    met: usize,
}

/// Whether the muscle of `rig` has a memory of the motion.
pub(super) fn remembers(rig: &Rig) -> bool {
    let mut observations = rig.effects.iter().filter_map(Effect::observation);
    observations.any(|effect| effect.has_motion_memory())
}

/// The muscle's force along a motion that is known but for what an encoder's play leaves open.
pub(super) struct Forces<'a>(Vec<Driven<'a>>);

/// The same from either end of what its memory may be at the begin.
pub(super) struct ForceEnds(Vec<Ends>);

/// The least and the most of forces \[N\], row by row, each with its slopes by pressure \[m²\].
fn spanned(mut all: impl Iterator<Item = Option<(Vec<f64>, Vec<f64>)>>) -> Option<Vec<ForceRange>> {
    let (first_n, slopes_m2) = all.next()??;
    let range = |(n, per_pressure_m2): (f64, f64)| ForceRange {
        least_n: n,
        most_n: n,
        per_pressure_m2,
    };
    let mut ranges: Vec<ForceRange> = first_n.into_iter().zip(slopes_m2).map(range).collect();
    for own in all {
        let (forces_n, _) = own?;
        for (range, n) in ranges.iter_mut().zip(forces_n) {
            range.least_n = range.least_n.min(n);
            range.most_n = range.most_n.max(n);
        }
    }
    Some(ranges)
}

impl<'a> Forces<'a> {
    /// Of the muscle of `rig`, along any of `records`.
    pub(super) fn new(rig: &Rig, records: &'a [Cow<Record>], force: Force) -> Option<Forces<'a>> {
        let driven = records.iter().map(|record| Driven::new(rig, record, force));
        Some(Forces(driven.collect::<Option<_>>()?))
    }

    /// Settled at the begin.
    pub(super) fn settled_n(&self) -> Option<Vec<ForceRange>> {
        spanned(self.0.iter().map(|driven| driven.begun_n(None)))
    }

    /// With the memory at either end at the begin.
    pub(super) fn ends(&self) -> Option<ForceEnds> {
        let ends = self.0.iter().map(Driven::ends);
        Some(ForceEnds(ends.collect::<Option<_>>()?))
    }

    /// With the memory at this share between `ends` at the begin.
    pub(super) fn between_n(&self, ends: &ForceEnds, share: f64) -> Option<Vec<ForceRange>> {
        let pairs = self.0.iter().zip(&ends.0);
        spanned(pairs.map(|(driven, ends)| driven.between_n(ends, share)))
    }

    /// With the memory at this share at the begin.
    pub(super) fn begun_n(&self, share: f64) -> Option<Vec<ForceRange>> {
        spanned(self.0.iter().map(|driven| driven.begun_n(Some(share))))
    }

    /// What each state of the muscle that fades adds to the force where it was one unit too large
    /// at the begin.
    pub(super) fn fading(&self) -> Option<Vec<Fading>> {
        self.0.first().map_or(Some(Vec::new()), Driven::fading)
    }
}

impl ForceEnds {
    /// From −1 (0) or from 1 (1).
    pub(super) fn forces_n(&self, end: usize) -> Option<Vec<ForceRange>> {
        let of = |ends: &Ends| (ends.forces_n[end].clone(), ends.per_pressure_m2.clone());
        spanned(self.0.iter().map(|ends| Some(of(ends))))
    }
}

impl<'a> Driven<'a> {
    fn new(rig: &Rig, record: &'a Record, force: Force) -> Option<Driven<'a>> {
        let mut rig = rig.clone();
        rig.nominal.load = Load::Prescribed;
        let inputs = Inputs::new(&rig, record).ok()?;
        let plant = rig.plant(Simulated::FORCE_ONLY).ok()?;
        let observations = rig
            .effects
            .iter()
            .enumerate()
            .filter_map(|(number, effect)| {
                Some((plant.term_states(number), effect.observation()?))
            });
        let observations = observations.collect();
        (inputs.simulated == Simulated::FORCE_ONLY).then_some(Driven {
            plant,
            observations,
            inputs,
            force,
        })
    }

    /// Settled at the begin, or with the memory at a share.
    fn begun_n(&self, share: Option<f64>) -> Option<(Vec<f64>, Vec<f64>)> {
        let Ran {
            forces_n: [forces_n],
            per_pressure_m2,
            ..
        } = self.forces_n([share], self.inputs.time_s.len())?;
        Some((forces_n, per_pressure_m2))
    }

    fn ends(&self) -> Option<Ends> {
        let begins = [Some(-1.0), Some(1.0)];
        let Ran {
            forces_n,
            per_pressure_m2,
            met,
        } = self.forces_n(begins, self.inputs.time_s.len())?;
        Some(Ends {
            forces_n,
            per_pressure_m2,
            met,
        })
    }

    fn between_n(&self, ends: &Ends, share: f64) -> Option<(Vec<f64>, Vec<f64>)> {
        let Ran {
            forces_n: [mut forces_n],
            ..
        } = self.forces_n([Some(share)], ends.met)?;
        forces_n.extend(&ends.forces_n[0][ends.met..]);
        Some((forces_n, ends.per_pressure_m2.clone()))
    }

    fn fading(&self) -> Option<Vec<Fading>> {
        let Driven { plant, inputs, .. } = self;
        let mut all: Vec<Fading> = Vec::new();
        let mut states = [vec![0.0; plant.states()]];
        let (mut slopes_m2, mut sloped) = (Vec::new(), states[0].clone());
        for row in 0..inputs.time_s.len() {
            self.advance(row, &mut states, [None])?;
            let (time_s, since_s) = (inputs.time_s[row], inputs.time_s[row] - inputs.time_s[0]);
            let forces_n = |state: &[f64]| -> Vec<f64> {
                let at = plant.muscle_point(time_s, state);
                let of = |(range, effect): &(Range<usize>, Box<dyn Observation>)| {
                    effect.decaying_forces(&at, &plant.muscle.law, &state[range.clone()])
                };
                let decaying = self.observations.iter().flat_map(of);
                let left =
                    |own: DecayingForce| own.force_n * (-since_s / own.time_constant_s).exp();
                decaying.map(left).collect()
            };
            let own_n = forces_n(&states[0]);
            if own_n.is_empty() {
                break;
            }
            if row % SLOPE_ROWS == 0 {
                let rows = row.saturating_sub(SLOPE_ROWS)..row;
                let raised = self.raised(rows, &sloped, None)?;
                let [own_n, raised_n] = raised.map(|state| forces_n(&state));
                let pairs = own_n.iter().zip(raised_n);
                slopes_m2 = pairs
                    .map(|(own, raised)| (raised - own) / PRESSURE_STEP_PA)
                    .collect();
                sloped.copy_from_slice(&states[0]);
            }
            all.resize_with(own_n.len(), Fading::default);
            for ((own, n), slope_m2) in all.iter_mut().zip(own_n).zip(&slopes_m2) {
                own.force_n.push(n);
                own.per_pressure_m2.push(*slope_m2);
            }
        }
        Some(all)
    }

    /// Takes states on to `row`, or begins with them.
    fn advance<const N: usize>(
        &self,
        row: usize,
        states: &mut [Vec<f64>],
        begins: [Option<f64>; N],
    ) -> Option<()> {
        let mut both = states.iter_mut().zip(begins);
        let rows = row.saturating_sub(1)..row;
        both.try_for_each(|(state, begin)| self.advance_one((rows.clone(), 0.0), state, begin))
    }

    /// Takes the state in a row on to another, with a pressure that is so much higher there
    /// \[Pa\], or begins with it.
    fn advance_one(
        &self,
        (rows, more_pa): (Range<usize>, f64),
        state: &mut [f64],
        begin: Option<f64>,
    ) -> Option<()> {
        let Driven { plant, inputs, .. } = self;
        let (row, time_s) = (rows.end, inputs.time_s[rows.end]);
        let pressure = inputs.pressure(row)?.to_absolute(plant.atmospheric);
        let mut before = [0.0; STATES_MAX];
        let before = &mut before[..state.len()];
        before.copy_from_slice(state);
        state[CONTRACTION] = inputs.contraction(row)?;
        state[PRESSURE] = pressure.0 + more_pa;
        if row > 0 {
            plant.propagate((inputs.time_s[rows.start], before), time_s, state);
            return Some(());
        }
        plant.steady_state(time_s, &Drive::default(), state);
        if let Some(share) = begin {
            plant.update_terms(Update::BiasMemory(share), time_s, &Drive::default(), state);
        }
        Some(())
    }

    /// The state in a row, taken on from an earlier one, and that of a muscle whose pressure reads
    /// [`PRESSURE_STEP_PA`] more all the while: noise counts by what comes of it in the mean of
    /// some rows, also where a line lets it through late.
    fn raised(
        &self,
        rows: Range<usize>,
        before: &[f64],
        begin: Option<f64>,
    ) -> Option<[Vec<f64>; 2]> {
        let contraction = self.inputs.contraction(rows.end)?;
        let truth_pa = |pressure_pa| {
            let reading = Reading {
                pressure: GaugePa(pressure_pa),
                contraction,
                force_n: 0.0,
            };
            let truth = self
                .plant
                .sensors
                .truth(self.inputs.time_s[rows.end], reading);
            truth.pressure.0
        };
        let step_pa = truth_pa(PRESSURE_STEP_PA) - truth_pa(0.0);
        let mut states = [before.to_vec(), before.to_vec()];
        for (state, more_pa) in states.iter_mut().zip([0.0, step_pa]) {
            state[PRESSURE] += more_pa;
            self.advance_one((rows.clone(), more_pa), state, begin)?;
        }
        Some(states)
    }

    /// The force that is asked for, of the muscle in `state` \[N\].
    fn force_n(&self, time_s: f64, state: &[f64]) -> f64 {
        match self.force {
            Force::Read => self.plant.read(time_s, &Drive::default(), state).force_n,
            Force::True => self.plant.force_n(time_s, state),
        }
    }

    /// Forces in the first rows from several begins, settled or leaning by a share, and from which
    /// row on all are the same.
    fn forces_n<const N: usize>(&self, begins: [Option<f64>; N], rows: usize) -> Option<Ran<N>> {
        let Driven { plant, inputs, .. } = self;
        let mut per_pressure_m2 = Vec::with_capacity(rows);
        let mut states = [(); N].map(|()| vec![0.0; plant.states()]);
        let mut forces_n = [(); N].map(|()| Vec::with_capacity(inputs.time_s.len()));
        let mut met = inputs.time_s.len();
        // The slope, and the state in the row where it was taken.
        let (mut slope_m2, mut sloped) = (0.0, states[0].clone());
        for row in 0..rows {
            let time_s = inputs.time_s[row];
            let apart = if row < met { N } else { 1 };
            self.advance(row, &mut states[..apart], begins)?;
            for (forces_n, state) in forces_n.iter_mut().zip(&states[..apart]) {
                forces_n.push(self.force_n(time_s, state));
            }
            if row % SLOPE_ROWS == 0 {
                let rows = row.saturating_sub(SLOPE_ROWS)..row;
                let raised = self.raised(rows, &sloped, begins[0])?;
                let [own_n, raised_n] = raised.map(|state| self.force_n(time_s, &state));
                slope_m2 = (raised_n - own_n) / PRESSURE_STEP_PA;
                sloped.copy_from_slice(&states[0]);
            }
            per_pressure_m2.push(slope_m2);
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < SAME;
            let same = |pair: &[Vec<f64>]| pair[0].iter().zip(&pair[1]).all(near);
            if N > 1 && row < met && states.windows(2).all(same) {
                met = row + 1;
            }
        }
        if let Some((first, others)) = forces_n.split_first_mut() {
            for other in others {
                other.extend(&first[other.len()..]);
            }
        }
        Some(Ran {
            forces_n,
            per_pressure_m2,
            met,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{CONTRACTION, PRESSURE_PA};

    /// A begin that both ends have forgotten is not run through to the end of the record, and what
    /// is taken from them instead is what would have come of it.
    #[test]
    fn a_begin_is_forgotten_where_both_its_ends_have_met() {
        for form in [
            "maxwell-slip\"\nspread = 4.0\ntaper = 0.5",
            "duhem\"\nasymmetry = 1.5",
            "bouc-wen\"\nsharpness = 2.0",
        ] {
            let effect = format!(
                "[[effect]]\nname = \"hysteresis\"\nform = \"{form}\nforce_n = 20.0\n\
                 reach = 0.005\nbase_share = 0.2\n"
            );
            let rig = Rig::parse("rig.toml", &format!("{}{effect}", Rig::REFERENCE_TOML));
            let time_s: Vec<f64> = (0..1000).map(|row| 0.01 * f64::from(row)).collect();
            let mut record = Record::new(time_s.clone());
            let contraction = time_s.iter().map(|t| 0.1 + 0.08 * (2.0 * t).sin());
            record.set(CONTRACTION, contraction.collect());
            record.set(PRESSURE_PA, vec![2e5; time_s.len()]);
            let driven = Driven::new(&rig.expect("a rig"), &record, Force::True).expect("driven");
            let ends = driven.ends().expect("forces");
            assert!((10..400).contains(&ends.met), "{form}: {}", ends.met);
            assert!(ends.forces_n[0][0] - ends.forces_n[1][0] > 10.0);
            let between_n = driven.between_n(&ends, 0.3).expect("forces");
            let ran = driven.forces_n([Some(0.3)], 1000).expect("forces");
            assert_eq!(between_n.0.len(), 1000);
            for (a, b) in between_n.0.iter().zip(&ran.forces_n[0]) {
                assert!((a - b).abs() < 1e-4, "{form}: {a}, {b}");
            }
        }
    }

    /// Of the nominal muscle, the law's own; a sensor that reads too much makes less of a reading;
    /// behind a line that lags by an interval between rows the noise arrives late, and no less.
    #[test]
    fn a_force_depends_on_the_reading_of_the_pressure() {
        let time_s = (0..=SLOPE_ROWS).map(|row| 0.01 * row as f64);
        let mut record = Record::new(time_s.collect());
        record.set(CONTRACTION, vec![0.1; SLOPE_ROWS + 1]);
        record.set(PRESSURE_PA, vec![2e5; SLOPE_ROWS + 1]);
        let slope_m2 = |effect: &str| {
            let rig = Rig::parse("rig.toml", &format!("{}{effect}", Rig::REFERENCE_TOML));
            let driven = Driven::new(&rig.expect("a rig"), &record, Force::True).expect("driven");
            driven.begun_n(None).expect("forces").1[SLOPE_ROWS]
        };
        let nominal_m2 = Rig::reference().nominal.muscle.force_per_pressure_m2(0.1);
        // The law is linear in pressure.
        assert!((slope_m2("") / nominal_m2 - 1.0).abs() < 1e-9);
        let gain = "[[effect]]\nname = \"pressure-sensor-gain\"\nform = \"proportional\"\n\
                    gain_error = 0.25\n";
        assert!((slope_m2(gain) * 1.25 / nominal_m2 - 1.0).abs() < 1e-9);
        let line = "[[effect]]\nname = \"line-dynamics\"\nform = \"resistance\"\n\
                    lag_s = 0.01\nhose_volume_m3 = 1e-5\n";
        assert!((slope_m2(line) / nominal_m2 - 1.0).abs() < 1e-3);
    }
}

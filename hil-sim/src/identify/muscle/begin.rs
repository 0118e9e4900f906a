//! What each record has of its own: the zeros of its sensors, and what the muscle has behind it.
//!
//! A zero is set at rest, to the mean of some readings, before each run: it is off by up to their
//! noise, the same in each row. In thousands of rows that shows, and is no effect of the rig.
//!
//! Where all records begin at rest they are taken to begin after a long one, and effects are
//! settled then. Where one begins in motion nobody knows what states that take seconds to settle
//! have come to, nor how much of a run-in is over. What they are off by acts on the force in
//! proportion and fades with their own time constants, or as the run-in goes on. So does the memory
//! of a hysteresis, which no rest settles.
//!
//! All of it is estimated from each record, the predicted ones too, and counts by how likely it is.

use super::force::{Fading, ForceEnds, ForceRange, Forces};
use crate::rig::Rig;
use model_discrepancy::least_squares::{Linearized, Prior, Residuals, Slopes, loss};
use muscle_plant::effects::Effect;
use muscle_plant::nominal::{Load, Nominal};
use muscle_plant::subsystem::Term;
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

/// Standard deviation of what a state may be off by at the begin, in units of its drive's usual
/// size; for a run-in, of what is left of it.
const SPREAD: f64 = 0.5;
/// Standard deviations by which a zero or a state may be off at most: one in 370 is farther. A law
/// that misses thousands of rows by more than their noise would take any zero to make up for it.
const DEVIATIONS_MOST: f64 = 3.0;
/// Begins of a memory that are tried at most, until one costs what was expected of it, to within so
/// many nats.
const BEGINS: usize = 8;
const KNOWN: f64 = 0.5;
/// Shares, or deviations, so near to each other are the same.
const NARROW: f64 = 1e-3;
/// How often slopes are taken again at most.
const SLOPES: usize = 8;
/// Step of the difference quotient by a share.
const SHARE_STEP: f64 = 0.01;
/// Forces along a record that are kept: of some fits that go on at once, each about a place.
const KEPT_FORCES: usize = 6;
/// Unknowns of a record at most: the zeros of three sensors, two of the pressure between rows, six
/// states of each of three effects, as many as one may have, and the memory of a hysteresis.
pub(super) const UNKNOWNS: usize = 3 + 2 + 3 * 6 + 1;

/// Where the memory of a record begins.
pub(super) struct Begin {
    /// From −1 to 1.
    share: f64,
    /// How residuals change there by [`SPREAD`] of it; none at an end, from which it does not move.
    along: Option<Vec<f64>>,
}

impl Begin {
    fn at(share: f64) -> Begin {
        Begin { share, along: None }
    }

    /// Where the memory began, from −1 to 1.
    pub(super) fn share(&self) -> f64 {
        self.share
    }

    /// Where a record began of which the memory is so many standard deviations off, with the slope
    /// of `residuals` there.
    pub(super) fn found(
        forces: &Forces,
        deviation: f64,
        residuals: impl Fn(&[ForceRange]) -> Option<Residuals>,
    ) -> Option<Begin> {
        let share = SPREAD * deviation;
        if share.abs() > 1.0 - NARROW {
            return Some(Begin::at(share.clamp(-1.0, 1.0)));
        }
        let step = -SHARE_STEP.copysign(share);
        let [own, moved] = [share, share + step].map(|share| residuals(&forces.begun_n(share)?));
        let (own, moved) = (own?.values, moved?.values);
        let slopes = own
            .iter()
            .zip(&moved)
            .map(|(own, moved)| (moved - own) / step);
        Some(Begin {
            share,
            along: Some(slopes.map(|slope| SPREAD * slope).collect()),
        })
    }
}

/// What the forces of a muscle depend on: not on a weight and its frictions.
struct MuscleKey {
    nominal: Nominal,
    effects: Vec<Effect>,
    /// Where its memory began.
    share: Option<f64>,
}

impl MuscleKey {
    fn new(rig: &Rig, share: Option<f64>) -> MuscleKey {
        let is_of_load = |effect: &&Effect| {
            let is_term = || matches!((effect.form.build)(&effect.values), Term::Load(_));
            effect.form.observation.is_none() && is_term()
        };
        let effects = rig.effects.iter();
        MuscleKey {
            nominal: Nominal {
                load: Load::Prescribed,
                ..rig.nominal
            },
            effects: effects.filter(|own| !is_of_load(own)).cloned().collect(),
            share,
        }
    }

    fn is_same(&self, other: &MuscleKey) -> bool {
        let is_same = |(own, other): (&Effect, &Effect)| {
            std::ptr::eq(own.form, other.form) && own.values == other.values
        };
        let mut effects = self.effects.iter().zip(&other.effects);
        self.nominal == other.nominal
            && self.share == other.share
            && self.effects.len() == other.effects.len()
            && effects.all(is_same)
    }
}

/// The forces last computed along a record: they stay the same while only values and effects of the
/// weight move.
#[derive(Default)]
pub(super) struct KeptForces(Mutex<VecDeque<(MuscleKey, Arc<KnownForces>)>>);

impl KeptForces {
    /// Those of the muscle of `rig` whose memory, if it has one, began at this share.
    pub(super) fn get_or_compute(
        &self,
        rig: &Rig,
        share: Option<f64>,
        compute: impl FnOnce() -> Option<KnownForces>,
    ) -> Option<Arc<KnownForces>> {
        let key = MuscleKey::new(rig, share);
        {
            let mut kept = self.0.lock().ok()?;
            if let Some(place) = kept.iter().position(|own| own.0.is_same(&key)) {
                let latest = kept.remove(place)?;
                let forces = Arc::clone(&latest.1);
                kept.push_front(latest);
                return Some(forces);
            }
        }
        let forces = Arc::new(compute()?);
        let mut kept = self.0.lock().ok()?;
        kept.truncate(KEPT_FORCES - 1);
        kept.push_front((key, Arc::clone(&forces)));
        Some(forces)
    }
}

/// The forces of a muscle whose memory, if it has one, began at a known place, and what states that
/// fade add to them.
pub(super) struct KnownForces {
    forces: Vec<ForceRange>,
    fading: Vec<Fading>,
}

impl KnownForces {
    /// With a memory that began at this share, if it has one.
    pub(super) fn new(
        forces: &Forces,
        fading: Vec<Fading>,
        share: Option<f64>,
    ) -> Option<KnownForces> {
        let forces = match share {
            Some(share) => forces.begun_n(share)?,
            None => forces.settled_n()?,
        };
        Some(KnownForces { forces, fading })
    }

    /// See [`begun`]: for a memory that moves from the place of `begin` in proportion only.
    pub(super) fn residuals(
        &self,
        zeros: &[Vec<f64>],
        begin: Option<&Begin>,
        residuals: impl Fn(&[ForceRange]) -> Option<Residuals>,
    ) -> Option<Residuals> {
        with_slopes(&self.fading, zeros.len(), |off| {
            let own = Own {
                fading: &self.fading,
                zeros,
                off,
                residuals: &residuals,
            };
            own.without(&self.forces, begin)
        })
    }
}

/// Residuals, by the forces that the muscle may have, for the zeros and the memory that fit best:
/// with what a motion before may have left in effects with a memory and in those that fade, as
/// `fading` says for each of their states. `zeros` says the same of each sensor's zero, off by its
/// standard deviation.
pub(super) fn begun(
    forces: &Forces,
    fading: &[Fading],
    zeros: &[Vec<f64>],
    residuals: impl Fn(&[ForceRange]) -> Option<Residuals>,
) -> Option<Residuals> {
    let ends = forces.ends()?;
    with_slopes(fading, zeros.len(), |off| {
        let own = Own {
            fading,
            zeros,
            off,
            residuals: &residuals,
        };
        own.begun_best(forces, &ends)
    })
}

/// The residuals that are `found` where states that fade are so many deviations off. That changes
/// the force's slope by pressure, too: residuals are taken again with the slope that it has where
/// the states are found, after so many `zeros`. With that of an effect which its begin has taken
/// back all residuals would look smaller.
fn with_slopes(
    fading: &[Fading],
    zeros: usize,
    found: impl Fn(&[f64]) -> Option<Residuals>,
) -> Option<Residuals> {
    let mut off = vec![0.0; fading.len()];
    let mut left = found(&off)?;
    for _ in 0..SLOPES {
        let first = left.values.len() - UNKNOWNS + zeros;
        let now = &left.values[first..first + fading.len()];
        let mut pairs = now.iter().zip(&off);
        if pairs.all(|(now, off)| (now - off).abs() < NARROW) {
            break;
        }
        off = now.to_vec();
        left = found(&off)?;
    }
    Some(left)
}

/// What a record has of its own, and the residuals that its muscle's forces leave, with the slopes
/// that these have where states that fade are so many deviations off.
struct Own<'a, R> {
    fading: &'a [Fading],
    zeros: &'a [Vec<f64>],
    off: &'a [f64],
    residuals: &'a R,
}

impl<R: Fn(&[ForceRange]) -> Option<Residuals>> Own<'_, R> {
    fn residuals(&self, forces: &[ForceRange]) -> Option<Residuals> {
        if self.off.iter().all(|off| *off == 0.0) {
            return (self.residuals)(forces);
        }
        let mut forces = forces.to_vec();
        for (fading, off) in self.fading.iter().zip(self.off) {
            for (force, slope_m2) in forces.iter_mut().zip(&fading.per_pressure_m2) {
                force.per_pressure_m2 += SPREAD * off * slope_m2;
            }
        }
        (self.residuals)(&forces)
    }

    /// How residuals change by what is unknown, each off by its standard deviation.
    fn unknown(&self, forces: &[ForceRange], left: &Residuals) -> Option<Vec<Vec<f64>>> {
        let mut unknown = self.zeros.to_vec();
        for fading in self.fading {
            let added = |(force, n): (&ForceRange, &f64)| ForceRange {
                least_n: force.least_n + SPREAD * n,
                most_n: force.most_n + SPREAD * n,
                ..*force
            };
            let off: Vec<ForceRange> = forces.iter().zip(&fading.force_n).map(added).collect();
            let off = self.residuals(&off)?.values;
            unknown.push(off.iter().zip(&left.values).map(|(a, b)| a - b).collect());
        }
        Some(unknown)
    }

    fn without(&self, forces: &[ForceRange], memory: Option<&Begin>) -> Option<Residuals> {
        let left = self.residuals(forces)?;
        let unknown = self.unknown(forces, &left)?;
        Some(without(left, &unknown, memory))
    }

    /// The same with the memory that fits best.
    fn begun_best(&self, forces: &Forces, ends: &ForceEnds) -> Option<Residuals> {
        let out_n = ends.forces_n(0)?;
        let out = self.residuals(&out_n)?;
        let unknown = self.unknown(&out_n, &out)?;
        let mut around = [(-1.0, out), (1.0, self.residuals(&ends.forces_n(1)?)?)];
        let mut expected = between(&around, &unknown);
        let mut best: Option<(f64, Residuals)> = None;
        for _ in 0..BEGINS {
            let (share, cost) = expected;
            let begun = self.residuals(&forces.between_n(ends, share)?)?;
            let left = without(begun.clone(), &unknown, Some(&Begin::at(share)));
            let found = left.outside().map(loss).sum::<f64>();
            let is_known = (found - cost).abs() < KNOWN;
            if best.as_ref().is_none_or(|(least, _)| found < *least) {
                best = Some((found, left));
            }
            if is_known {
                break;
            }
            // No law is in proportion to the share: on which side of this one there is more to
            // gain.
            let [low, high] = around.clone();
            let sides = [[low, (share, begun.clone())], [(share, begun), high]];
            let wide = sides
                .into_iter()
                .filter(|[low, high]| high.0 - low.0 > NARROW);
            let sought = wide.map(|side| (between(&side, &unknown), side));
            let Some(next) = sought.min_by(|a, b| a.0.1.total_cmp(&b.0.1)) else {
                break;
            };
            let width = |around: &[(f64, Residuals); 2]| around[1].0 - around[0].0;
            let is_slow = width(&next.1) > 0.5 * width(&around);
            (expected, around) = next;
            if is_slow {
                // From one end alone it would be approached in small steps.
                expected = (0.5 * (around[0].0 + around[1].0), f64::NAN);
            }
        }
        best.map(|(_, left)| left)
    }
}

/// At which share the memory most likely begins between two at which the residuals are known, as if
/// they were in proportion, and what they cost there.
fn between([low, high]: &[(f64, Residuals); 2], unknown: &[Vec<f64>]) -> (f64, f64) {
    let half = |of: fn(&Residuals) -> &[f64], sign: f64| -> Vec<f64> {
        let pairs = of(&low.1).iter().zip(of(&high.1));
        pairs.map(|(a, b)| 0.5 * (b + sign * a)).collect()
    };
    let middle = Residuals {
        values: half(|own| &own.values, 1.0),
        slack: half(|own| &own.slack, 1.0),
    };
    let (centre, reach) = (0.5 * (low.0 + high.0), 0.5 * (high.0 - low.0));
    let mut columns = unknown.to_vec();
    let along = half(|own| &own.values, -1.0).into_iter();
    columns.push(along.map(|n| SPREAD / reach * n).collect());
    let mut priors = vec![(0.0, 1.0); columns.len()];
    priors[unknown.len()].0 = centre / SPREAD;
    let slopes = slopes(&columns);
    let linearized = linearized(&middle, &slopes, &priors);
    let mut found = linearized.exact_minimum(DEVIATIONS_MOST);
    // No memory is beyond its ends.
    let most = reach / SPREAD;
    let last = found.len() - 1;
    found[last] = found[last].clamp(-most, most);
    (centre + SPREAD * found[last], linearized.cost(&found))
}

fn linearized<'a>(
    residuals: &'a Residuals,
    slopes: &'a Slopes,
    priors: &'a [Prior],
) -> Linearized<'a> {
    Linearized {
        residuals,
        slopes,
        priors,
        damping: DVector::zeros(priors.len()),
    }
}

/// Slopes of residuals by unknowns, of which there is one at least.
fn slopes(unknown: &[Vec<f64>]) -> Slopes {
    let (rows, columns) = (unknown[0].len(), unknown.len());
    Slopes {
        values: DMatrix::from_fn(rows, columns, |row, column| unknown[column][row]),
        slack: DMatrix::zeros(rows, columns),
    }
}

/// `residuals` without what the unknowns of a record explain of them, each of which acts as
/// `unknown` says, off by its standard deviation. What these then are follows, with the `memory` it
/// began with, as [`UNKNOWNS`] more: who needs an unlikely record is no better for it.
pub(super) fn without(
    mut residuals: Residuals,
    unknown: &[Vec<f64>],
    memory: Option<&Begin>,
) -> Residuals {
    let mut deviations = vec![0.0; UNKNOWNS];
    let begun = memory.map_or(0.0, |begin| begin.share / SPREAD);
    deviations[UNKNOWNS - 1] = begun;
    let along = memory.and_then(|begin| begin.along.clone());
    let mut priors = vec![(0.0, 1.0); unknown.len()];
    priors.extend(along.iter().map(|_| (begun, 1.0)));
    let columns: Vec<Vec<f64>> = unknown.iter().cloned().chain(along).collect();
    if !columns.is_empty() {
        let slopes = slopes(&columns);
        let found = linearized(&residuals, &slopes, &priors).exact_minimum(DEVIATIONS_MOST);
        let change = slopes.values * &found;
        for (value, change) in residuals.values.iter_mut().zip(&change) {
            *value += change;
        }
        for (place, found) in found.iter().enumerate() {
            let of_memory = place == unknown.len();
            deviations[if of_memory { UNKNOWNS - 1 } else { place }] += found;
        }
    }
    residuals.extend(Residuals::exact(deviations));
    residuals
}

#[cfg(test)]
mod tests {
    use super::super::force::Force;
    use super::*;
    use crate::identify::simulate::simulate;
    use crate::record::FORCE_N;
    use crate::record::{CONTRACTION, PRESSURE_PA, Record};
    use crate::rig::Rig;
    use std::borrow::Cow;

    fn fading_n(rig: &Rig, record: &Record) -> Vec<Vec<f64>> {
        let records = [Cow::Borrowed(record)];
        let forces = Forces::new(rig, &records, Force::True).expect("driven");
        let fading = forces.fading().expect("fading").into_iter();
        fading.map(|own| own.force_n).collect()
    }

    /// The begin of a record is off by what a step before it has left: `fading_n` says how that
    /// acts on the force, and how it fades.
    #[test]
    fn what_a_step_before_has_left_fades_as_it_is_said_to() {
        let (step_s, rows, time_constant_s) = (0.01, 301, 0.8);
        let time_s: Vec<f64> = (0..rows).map(|row| f64::from(row) * step_s).collect();
        // Both steps are over in the first row.
        let contraction = time_s.iter().map(|t| 0.05 + 0.02 * t);
        let contraction: Vec<f64> = [0.0].into_iter().chain(contraction.skip(1)).collect();
        let pressure_pa = [1e5].into_iter().chain(vec![3e5; time_s.len() - 1]);
        let pressure_pa: Vec<f64> = pressure_pa.collect();
        let from = |first: usize| {
            let mut record = Record::new(time_s[first..].to_vec());
            record.set(CONTRACTION, contraction[first..].to_vec());
            record.set(PRESSURE_PA, pressure_pa[first..].to_vec());
            record
        };
        let drives = [2e5 / 3e5, (contraction[1] - contraction[0]) / 0.25];
        for (form, step) in ["relaxation", "strain-relaxation"].into_iter().zip(drives) {
            let effect = format!(
                "[[effect]]\nname = \"creep\"\nform = \"{form}\"\nforce_n = 20.0\n\
                 time_constant_s = {time_constant_s:?}\n"
            );
            let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
            let rig = Rig::parse("rig.toml", &(text + &effect)).expect("a rig");
            let force_n = |record: &Record| {
                let simulated = simulate(&rig, record, 1e-9).expect("simulated");
                simulated.require(FORCE_N).expect("a force").to_vec()
            };
            let (whole_n, cut_n) = (force_n(&from(0)), force_n(&from(1)));
            let fading_n = fading_n(&rig, &from(1));
            assert_eq!(fading_n.len(), 1);
            let way = time_constant_s / step_s;
            let off = step * way * (1.0 - (-1.0 / way).exp());
            assert!((cut_n[0] - whole_n[1]).abs() > 2.0);
            for (row, cut_n) in cut_n.iter().enumerate() {
                let error_n = cut_n - whole_n[row + 1] - off * fading_n[0][row];
                assert!(error_n.abs() < 1e-4, "{form}, row {row}: {error_n}");
            }
        }
    }

    /// A run-in that was under way before the record has less of it left, in one proportion.
    #[test]
    fn a_run_in_that_has_begun_is_off_by_a_share() {
        let effect = "[[effect]]\nname = \"run-in\"\nform = \"exponential\"\nshare = 0.1\n\
                      distance = 0.2\n";
        let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
        let rig = Rig::parse("rig.toml", &(text + effect)).expect("a rig");
        let time_s: Vec<f64> = (0..400).map(|row| 0.01 * f64::from(row)).collect();
        let from = |first: usize| {
            let mut record = Record::new(time_s[first..].to_vec());
            let contraction = time_s[first..].iter().map(|t| 0.05 + 0.03 * t);
            record.set(CONTRACTION, contraction.collect());
            record.set(PRESSURE_PA, vec![3e5; time_s.len() - first]);
            record
        };
        let force_n = |record: &Record| {
            let simulated = simulate(&rig, record, 1e-9).expect("simulated");
            simulated.require(FORCE_N).expect("a force").to_vec()
        };
        let (whole_n, cut_n) = (force_n(&from(0)), force_n(&from(200)));
        let fading_n = fading_n(&rig, &from(200));
        // A way of 0.06 before, less the play in which a motion is none.
        let off = (-(0.06_f64 - 5e-4) / 0.2).exp() - 1.0;
        assert!((cut_n[0] - whole_n[200]).abs() > 5.0);
        // The play is passed once more.
        for row in 50..200 {
            let error_n = cut_n[row] + off * fading_n[0][row] - whole_n[200 + row];
            assert!(error_n.abs() < 0.1, "row {row}: {error_n}");
        }
    }

    /// A zero that is off by two of its standard deviations costs what that is unlikely, and no
    /// more; what no zero is off by stays, and so does a slope.
    #[test]
    fn a_zero_of_a_record_is_its_own() {
        let rows = 2000_usize;
        let zero = vec![vec![1.0; rows]];
        let flat = without(Residuals::exact(vec![2.0; rows]), &zero, None);
        let (rest, told) = flat.values.split_at(rows);
        assert!(rest.iter().all(|value| value.abs() < 2e-3));
        assert!((told[0] + 2.0).abs() < 2e-3, "{told:?}");
        // A law that is wrong by fifty noises is no zero.
        let wrong = without(Residuals::exact(vec![50.0; rows]), &zero, None);
        let (rest, told) = wrong.values.split_at(rows);
        assert!(rest.iter().all(|value| (value - 47.0).abs() < 1e-6));
        assert!((told[0] + 3.0).abs() < 1e-6, "{told:?}");
        let slope = (0..rows).map(|row| row as f64 / rows as f64 - 0.5);
        let slope: Vec<f64> = slope.collect();
        let kept = without(Residuals::exact(slope.clone()), &zero, None);
        let mut pairs = kept.values.iter().zip(&slope);
        assert!(pairs.all(|(kept, slope)| (kept - slope).abs() < 1e-3));
    }

    #[test]
    fn what_fades_is_forgotten_and_what_stays_is_not() {
        let rows = 0..400;
        let fading: Vec<f64> = rows
            .map(|row| 30.0 * (-0.02 * f64::from(row)).exp())
            .collect();
        let unknown = vec![fading.iter().map(|n| SPREAD * n).collect::<Vec<f64>>()];
        let of = |begun: f64, stays: f64| {
            let row =
                |(row, fading): (usize, &f64)| begun * fading + stays * (0.3 * row as f64).sin();
            Residuals::exact(fading.iter().enumerate().map(row).collect())
        };
        let size = |residuals: &Residuals| {
            let squares = residuals.values.iter().map(|value| value * value);
            (squares.sum::<f64>() / 400.0).sqrt()
        };
        assert!(size(&of(0.4, 0.0)) > 2.0);
        let mut forgiven = without(of(0.4, 0.0), &unknown, None);
        // What it took is told: -0.4 of a state that is known to within 0.5.
        let told = forgiven.values.split_off(400);
        assert_eq!(told.len(), UNKNOWNS);
        assert!((told[0] + 0.8).abs() < 0.01, "{told:?}");
        assert!(size(&forgiven) < 0.01);
        let left = size(&without(of(0.4, 1.0), &unknown, None));
        assert!((left - 0.5_f64.sqrt()).abs() < 0.02, "{left}");
    }

    /// Sensors, the pressure between rows and three effects, a state of which is in each row.
    #[test]
    fn states_of_three_effects_leave_the_memory_its_place() {
        let of = |own: usize| (0..40).map(move |row| f64::from(u8::from(row == own)));
        let unknown: Vec<Vec<f64>> = (0..UNKNOWNS - 1).map(|own| of(own).collect()).collect();
        let residuals = Residuals::exact(vec![1.0; 40]);
        let told = without(residuals, &unknown, None).values.split_off(40);
        let (memory, states) = told.split_last().expect("unknowns");
        assert_eq!(*memory, 0.0);
        assert!(
            states.iter().all(|own| (own + 0.5).abs() < 1e-6),
            "{told:?}"
        );
    }
}

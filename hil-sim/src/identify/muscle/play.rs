//! What the instruments leave open: an encoder's play, when the muscle surely takes it along, and
//! where the muscle is else; a sensor that rings.

use super::prepared::{Prepared, without_vacuum};
use crate::record::{CONTRACTION, PRESSURE_PA, Record};
use crate::rig::Rig;
use muscle_plant::effects::{Effect, Observation};
use std::borrow::Cow;

/// An encoder that has moved by so many times its noise is taken along, over one of these times
/// before and after \[s\].
const CONTACT_NOISES: f64 = 6.0;
const CONTACTS_S: [f64; 4] = [0.01, 0.02, 0.04, 0.08];
/// Share of the motion that its nearer half has at least: else fast motion meets a rest.
const CONTACT_SHARE: f64 = 0.125;
/// An encoder that rests for longer than this has more to it than a turn of the motion \[s\].
const TURN_LONG_S: f64 = 0.3;

/// The times over which contacts are looked for, in rows.
pub(super) fn reaches(time_s: &[f64]) -> [usize; 4] {
    let last = time_s.len() - 1;
    let step_s = (time_s[last] - time_s[0]) / last.max(1) as f64;
    CONTACTS_S.map(|reach_s| (reach_s / step_s).round().max(1.0) as usize)
}

/// Which way the muscle surely takes an encoder with play along: +1, −1, or 0 where it may not.
/// Over one of the `reaches`, numbers of rows: slow motion shows over many only.
pub(super) fn contacts(contraction: &[f64], noise: f64, reaches: &[usize]) -> Vec<f64> {
    let last = contraction.len() - 1;
    // By how much it moves towards a row, if that is more than noise and not all far from there.
    let moved = |row: usize, near: usize, far: usize| {
        let way = contraction[far] - contraction[row];
        let share = (contraction[near] - contraction[row]) / way;
        if way.abs() > CONTACT_NOISES * noise && share > CONTACT_SHARE {
            way.signum()
        } else {
            0.0
        }
    };
    let contact = |row: usize| {
        let mut ways = reaches.iter().map(|reach| {
            let before = [reach.div_ceil(2), *reach].map(|rows| row.saturating_sub(rows));
            let after = [reach.div_ceil(2), *reach].map(|rows| (row + rows).min(last));
            let (before, after) = (
                -moved(row, before[0], before[1]),
                moved(row, after[0], after[1]),
            );
            if before == after { before } else { 0.0 }
        });
        ways.find(|way| *way != 0.0).unwrap_or(0.0)
    };
    (0..=last).map(contact).collect()
}

/// The rows in which the encoder moves: between two of them it rests.
fn moving(directions: &[f64]) -> Vec<usize> {
    let rows = 0..directions.len();
    rows.filter(|row| directions[*row] != 0.0).collect()
}

/// Directions with each rest of the encoder crossed: in a short one the motion turns, with a steady
/// acceleration; in a long one the muscle goes with the pressure.
pub(super) fn bridged(time_s: &[f64], directions: &[f64], pressure_pa: Option<&[f64]>) -> Vec<f64> {
    let moving = moving(directions);
    let mut sides = directions.to_vec();
    let (Some(first), Some(last)) = (moving.first(), moving.last()) else {
        return sides;
    };
    sides[..*first].fill(directions[*first]);
    sides[*last..].fill(directions[*last]);
    for pair in moving.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        for row in from + 1..to {
            let by_time = (time_s[row] - time_s[from]) / (time_s[to] - time_s[from]);
            let long = time_s[to] - time_s[from] > TURN_LONG_S;
            let by_pressure = pressure_pa.map(|p| (p[row] - p[from]) / (p[to] - p[from]));
            let by_pressure = by_pressure.filter(|share| long && share.is_finite());
            let share = by_pressure.unwrap_or(by_time * by_time);
            let whole = directions[to] - directions[from];
            sides[row] = directions[from] + share.clamp(0.0, 1.0) * whole;
        }
    }
    sides
}

/// Rows in which the encoder rests, and not for long, between two contacts on one side: behind its
/// play the muscle may have gone back and come again.
pub(super) fn dips(time_s: &[f64], directions: &[f64]) -> Vec<bool> {
    let mut dips = vec![false; directions.len()];
    let moving = moving(directions);
    for pair in moving.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let same = directions[from] == directions[to];
        dips[from + 1..to].fill(same && time_s[to] - time_s[from] <= TURN_LONG_S);
    }
    dips
}

/// What the effects of `rig` tell of its readings.
fn observations(rig: &Rig) -> impl Iterator<Item = Box<dyn Observation>> {
    rig.effects.iter().filter_map(Effect::observation)
}

/// How far the encoder of `rig` may be behind the muscle, either way, while it rests \[-\].
pub(super) fn play(rig: &Rig) -> f64 {
    let length_m = rig.nominal.muscle.initial_length_m;
    observations(rig)
        .map(|effect| effect.backlash(length_m))
        .sum()
}

/// `record` with the contraction that an encoder with only the [`play`] would have read.
pub(super) fn without_further_play<'a>(rig: &Rig, record: &'a Record) -> Cow<'a, Record> {
    let length_m = rig.nominal.muscle.initial_length_m;
    let mut record = Cow::Borrowed(record);
    for effect in observations(rig) {
        let contraction = record.column(CONTRACTION);
        let near = contraction.and_then(|read| effect.without_further_backlash(length_m, read));
        if let Some(near) = near {
            record.to_mut().set(CONTRACTION, near);
        }
    }
    record
}

impl Prepared {
    /// The smooth record, or what it may be at the ends where the instruments of `rig` leave that
    /// open: an encoder its play, a sensor that rings all between its reading and what it lags.
    pub(super) fn ways(&self, rig: &Rig) -> Vec<Cow<'_, Record>> {
        let of = |may| self.unplayed(rig, &self.smooth, may);
        let mut ways = if play(rig) == 0.0 {
            vec![of(None)]
        } else {
            [1.0, -1.0].map(|end| of(Some(end))).to_vec()
        };
        // Without the gas nothing tells how the reading rings, and all could lie between.
        if self.gas.is_none() || self.smooth_pressure_pa.is_empty() {
            return ways;
        }
        for effect in observations(rig) {
            let ahead = ways.iter().filter_map(|way| {
                // Also what was left out, as no gas has it.
                let read_pa = &self.smooth_pressure_pa;
                let before_pa = effect.before_sensor_pa(way.time_s(), read_pa)?;
                let mut way = way.clone().into_owned();
                way.set(PRESSURE_PA, before_pa);
                without_vacuum(rig, &mut way);
                Some(Cow::Owned(way))
            });
            let ahead: Vec<_> = ahead.collect();
            ways.extend(ahead);
        }
        ways
    }

    /// `record` with the contraction that the encoder of `rig` has read so; where that rests the
    /// muscle is where it `may` be in the play, from −1 to 1, or where it most likely is.
    pub(super) fn unplayed<'a>(
        &self,
        rig: &Rig,
        record: &'a Record,
        may: Option<f64>,
    ) -> Cow<'a, Record> {
        let play = play(rig);
        let mut record = without_further_play(rig, record);
        let Some(contraction) = record.column(CONTRACTION).filter(|_| play > 0.0) else {
            return record;
        };
        let place = |row: usize| may.filter(|_| !self.in_contact[row]);
        let rows = contraction.iter().zip(&self.sides).enumerate();
        let true_contraction = rows
            .map(|(row, (c, side))| c + play * place(row).unwrap_or(*side))
            .collect();
        record.to_mut().set(CONTRACTION, true_contraction);
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: [usize; 4] = [1, 2, 4, 8];

    /// Up, then 80 ms of rest, then up again or down.
    fn paused(again: f64) -> Vec<f64> {
        let at = |row: i32| {
            let (before, after) = (f64::from(row.min(50)), f64::from((row - 58).max(0)));
            0.05 + 2e-3 * before + again * 2e-3 * after + 3e-5 * (3.7 * f64::from(row)).sin()
        };
        (0..100).map(at).collect()
    }

    #[test]
    fn reaches_are_times() {
        let rows = |step_s: f64| {
            let time_s: Vec<f64> = (0..50).map(|row| step_s * f64::from(row)).collect();
            reaches(&time_s)
        };
        assert_eq!(rows(0.01), ROWS);
        assert_eq!(rows(0.001), [10, 20, 40, 80]);
        assert_eq!(rows(0.1), [1; 4]);
        assert_eq!(reaches(&[0.0]), [usize::MAX; 4]);
    }

    /// A fast motion before and after it is seen over many rows, and is none.
    #[test]
    fn a_short_rest_in_fast_motion_is_a_rest() {
        for again in [1.0, -1.0] {
            let contacts = contacts(&paused(again), 3e-5, &ROWS);
            assert!(contacts[..49].iter().skip(1).all(|way| *way == 1.0));
            assert!(
                contacts[51..58].iter().all(|way| *way == 0.0),
                "{contacts:?}"
            );
            assert!(contacts[60..98].iter().all(|way| *way == again));
        }
    }

    #[test]
    fn a_slow_motion_takes_the_encoder_along() {
        let slow: Vec<f64> = (0..100).map(|row| 0.05 + 4e-5 * f64::from(row)).collect();
        let contacts = contacts(&slow, 3e-5, &ROWS);
        assert!(contacts[5..95].iter().all(|way| *way == 1.0));
    }

    #[test]
    fn a_muscle_may_dip_where_it_goes_on_and_not_where_it_turns() {
        let time_s: Vec<f64> = (0..100).map(|row| 0.01 * f64::from(row)).collect();
        let dips = |again| super::dips(&time_s, &contacts(&paused(again), 3e-5, &ROWS));
        assert!(dips(1.0)[51..58].iter().all(|dips| *dips));
        assert!(!dips(1.0)[..48].contains(&true) && !dips(1.0)[60..].contains(&true));
        assert!(!dips(-1.0).contains(&true));
    }
}

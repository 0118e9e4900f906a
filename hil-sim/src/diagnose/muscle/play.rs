//! What the instruments leave open: an encoder's play, when the muscle surely takes it along, and
//! where the muscle is else; a sensor that rings.

use super::prepared::Prepared;
use crate::plant::Term;
use crate::record::{CONTRACTION, PRESSURE_PA, Record};
use crate::rig::Rig;
use std::borrow::Cow;

/// An encoder that has moved by so many times its noise is taken along, over one of these numbers
/// of rows before and after.
const CONTACT_NOISES: f64 = 6.0;
pub(super) const CONTACT_ROWS: [usize; 4] = [1, 2, 4, 8];
/// An encoder that rests for longer than this has more to it than a turn of the motion \[s\].
const TURN_LONG_S: f64 = 0.3;

/// Which way the muscle surely takes an encoder with play along: +1, −1, or 0 where it may not.
/// Over one of the `reaches`, numbers of rows: slow motion shows over many only.
pub(super) fn contacts(contraction: &[f64], noise: f64, reaches: &[usize]) -> Vec<f64> {
    let last = contraction.len() - 1;
    let moved = |from: usize, to: usize| {
        let way = contraction[to] - contraction[from];
        if way.abs() > CONTACT_NOISES * noise {
            way.signum()
        } else {
            0.0
        }
    };
    let contact = |row: usize| {
        let mut ways = reaches.iter().map(|reach| {
            let (from, to) = (row.saturating_sub(*reach), (row + reach).min(last));
            let (before, after) = (moved(from, row), moved(row, to));
            if before == after { before } else { 0.0 }
        });
        ways.find(|way| *way != 0.0).unwrap_or(0.0)
    };
    (0..=last).map(contact).collect()
}

/// Directions with each rest of the encoder crossed: in a short one the motion turns, with a steady
/// acceleration; in a long one the muscle goes with the pressure.
pub(super) fn bridged(time_s: &[f64], directions: &[f64], pressure_pa: Option<&[f64]>) -> Vec<f64> {
    let moving: Vec<usize> = (0..directions.len())
        .filter(|row| directions[*row] != 0.0)
        .collect();
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

/// How far the encoder of `rig` may be behind the muscle, either way \[-\].
pub(super) fn play(rig: &Rig) -> f64 {
    let length_m = rig.muscle.initial_length_m;
    let plays = rig
        .effects
        .iter()
        .map(|effect| match (effect.form.build)(&effect.values) {
            Term::Sensor(term) => term.play(length_m),
            _ => 0.0,
        });
    plays.sum()
}

impl Prepared {
    /// The measured record, or what it may be at the ends where the instruments of `rig` leave that
    /// open: an encoder its play, a sensor that rings all between its reading and what it lags.
    pub(super) fn ways(&self, rig: &Rig) -> Vec<Cow<'_, Record>> {
        let play = play(rig);
        let of = |may| self.unplayed(play, &self.measured, Some(may));
        let mut ways = if play == 0.0 {
            vec![Cow::Borrowed(&self.measured)]
        } else {
            [1.0, -1.0].map(of).to_vec()
        };
        // Without the gas nothing tells how the reading rings, and all could lie between.
        if self.gas.is_none() {
            return ways;
        }
        for effect in &rig.effects {
            let Term::Line(term) = (effect.form.build)(&effect.values) else {
                continue;
            };
            let ahead = ways.iter().filter_map(|way| {
                let read_pa = way.column(PRESSURE_PA)?;
                let before_pa = term.before_sensor_pa(way.time_s(), read_pa)?;
                let mut way = way.clone().into_owned();
                way.set(PRESSURE_PA, before_pa);
                Some(Cow::Owned(way))
            });
            let ahead: Vec<_> = ahead.collect();
            ways.extend(ahead);
        }
        ways
    }

    /// `record` with the contraction that an encoder with `play` has read so; where the encoder
    /// rests the muscle is where it `may` be in the play, from −1 to 1, or where it most likely is.
    pub(super) fn unplayed<'a>(
        &self,
        play: f64,
        record: &'a Record,
        may: Option<f64>,
    ) -> Cow<'a, Record> {
        let Some(contraction) = record.column(CONTRACTION).filter(|_| play > 0.0) else {
            return Cow::Borrowed(record);
        };
        let place = |row: usize| may.filter(|_| !self.in_contact[row]);
        let rows = contraction.iter().zip(&self.sides).enumerate();
        let true_contraction = rows
            .map(|(row, (c, side))| c + play * place(row).unwrap_or(*side))
            .collect();
        let mut record = record.clone();
        record.set(CONTRACTION, true_contraction);
        Cow::Owned(record)
    }
}

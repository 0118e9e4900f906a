//! The pressure between the rows of a record.
//!
//! A reference that is written at each row makes the pressure rise and settle between rows.
//! Readings at the rows alone all see the same part of that: taken to be straight in between, the
//! pressure is late by up to half an interval, which looks like a damping of the load. The
//! simulated valve tells how it went, as far as it is the rig's: where it misses the next reading,
//! it may have missed it from the begin of the interval on, or at its end only: by chance in each,
//! and in all of a record alike, as a sensor's gain makes the valve seem to miss on and on.

use super::finer::{cubic, finer, parts};
use super::prepared::Prepared;
use super::residuals::{gas_pressures_pa, is_far, pressures_pa};
use crate::identify::inputs::Inputs;
use crate::record::{CONTRACTION, PRESSURE_PA, Record};
use crate::rig::Rig;
use muscle_plant::nominal::Load;

/// Half a part of an interval is at most so long \[s\]: less than valve and muscle take.
const HALF_PART_S: f64 = 0.005;
/// So many standard deviations of a reading's noise are no miss.
const MISS_NOISES: f64 = 3.0;

/// Rows at half the distance leave a share of what the gas is off by, an RMS over rows, that is
/// taken to be within these: a quarter, as neither a straight line nor a cubic follows a curvature
/// that jumps, where a motion begins; and 2^(−3/2) where its speed jumps, as on a stop, beside
/// which half as many rows lie then.
const LEFT: [f64; 2] = [0.25, 0.354];

/// What is known of the pressure between rows, in each interval or about each row.
#[derive(Clone, Copy, Default)]
struct Between {
    /// Its mean above the straight line between the rows \[Pa\].
    bow_pa: f64,
    /// By how much more that is if the simulated valve has missed the next reading from the begin
    /// on, by one standard deviation of when it has \[Pa\].
    missed_pa: f64,
    /// The same whatever its sign is: a standard deviation \[Pa\].
    doubt_pa: f64,
}

/// Tells `record` the mean pressure about each of its rows, and how far its balances of forces can
/// be trusted for it. Without a reference nothing is known.
pub(super) fn tell(record: &mut Prepared, rig: &Rig) {
    let Some(intervals) = record.gas.as_ref().and_then(|gas| {
        let noise_pa = record.noise.pressure_pa;
        intervals(gas, rig, noise_pa)
    }) else {
        return;
    };
    if let Some(doubts_pa) = gas_doubts_pa(record, rig) {
        // Of rows far apart: there the contraction is not known well enough to tell anything.
        let time_s = record.measured.time_s();
        let is_far = |row: usize| row > 0 && is_far(time_s[row] - time_s[row - 1]);
        let noise_pa = record.noise.pressure_pa;
        let rows = record.gas_rows.len();
        record
            .gas_rows
            .retain(|row| !is_far(*row) || doubts_pa[*row] <= noise_pa);
        let left_out = rows - record.gas_rows.len();
        if left_out > 0 {
            let percent = 100.0 * left_out as f64 / rows as f64;
            record.warnings.push(format!(
                "{percent:.0} % of the pressures are not compared: the rows are too far apart to \
                 know the contraction between them"
            ));
        }
        record.gas_doubts_pa = doubts_pa;
    }
    let time_s = record.measured.time_s();
    let rows = about_rows(time_s, &intervals);
    let read_pa = record.measured.column(PRESSURE_PA).unwrap_or_default();
    let above_smooth =
        |(row, own): (usize, &Between)| own.bow_pa - smooth_bow_pa(time_s, read_pa, row);
    record.between_pa = rows.iter().enumerate().map(above_smooth).collect();
    record.missed_pa = rows.iter().map(|own| own.missed_pa).collect();
    let Load::Weight(weight) = rig.nominal.load else {
        return;
    };
    let doubted = std::mem::take(&mut record.places)
        .into_iter()
        .map(|mut place| {
            let own = place
                .kernel
                .value
                .iter()
                .zip(&rows[place.kernel.rows.clone()]);
            let doubt_pa: f64 = own.map(|(weight, row)| weight * row.doubt_pa).sum();
            place.pressure_doubt_pa = place.pressure_doubt_pa.hypot(doubt_pa);
            record.weighed(rig, &weight, place)
        });
    let doubted = doubted.collect();
    record.places = doubted;
}

/// How far the gas may be off for what the contraction does between its rows, row by row \[Pa\]:
/// what leaving out every second row changes, by what rows at half the distance leave less of it
/// (Richardson). How much they leave is told by that change and the one before it, of leaving out
/// half of the rest.
fn gas_doubts_pa(record: &Prepared, rig: &Rig) -> Option<Vec<f64>> {
    let gas = record.gas.as_ref()?;
    let of = |gas: &Record| gas_pressures_pa(record, rig.clone(), gas, 0.0);
    let thinned_pa = |first: usize, step: usize| of(&filled(gas, first, step)?);
    let whole_pa = of(gas)?;
    let (mut squares, mut before) = (vec![0.0; whole_pa.len()], 0.0);
    for first in 0..2 {
        let (half_pa, quarter_pa) = (thinned_pa(first, 2)?, thinned_pa(first, 4)?);
        let rows = squares.iter_mut().zip(&whole_pa);
        for ((square, whole), (half, quarter)) in rows.zip(half_pa.iter().zip(&quarter_pa)) {
            *square += 0.5 * (half - whole).powi(2);
            before += 0.5 * (quarter - half).powi(2);
        }
    }
    let changed = squares.iter().sum::<f64>();
    // Where nothing changes there is no doubt.
    let left = (changed / before.max(f64::MIN_POSITIVE)).sqrt();
    let left = left.clamp(LEFT[0], LEFT[1]);
    // It goes through zero between two places of doubt.
    let about = |row: usize| {
        let rows = row.saturating_sub(2)..(row + 3).min(squares.len());
        let count = rows.len() as f64;
        let changed_pa = (squares[rows].iter().sum::<f64>() / count).sqrt();
        changed_pa * left / (1.0 - left)
    };
    Some((0..squares.len()).map(about).collect())
}

/// `gas` with one of `step` rows from the `first` on, and between these the contraction as it is
/// taken to be between rows.
fn filled(gas: &Record, first: usize, step: usize) -> Option<Record> {
    let (time_s, contraction) = (gas.time_s(), gas.column(CONTRACTION)?);
    let kept: Vec<usize> = (first..time_s.len()).step_by(step).collect();
    let of = |values: &[f64]| kept.iter().map(|row| values[*row]).collect::<Vec<f64>>();
    let (kept_s, known) = (of(time_s), of(contraction));
    let mut filled = contraction.to_vec();
    for (place, pair) in kept.windows(2).enumerate() {
        for row in pair[0] + 1..pair[1] {
            let share = (time_s[row] - kept_s[place]) / (kept_s[place + 1] - kept_s[place]);
            filled[row] = match is_far(time_s[row] - time_s[row - 1]) {
                true => cubic(&kept_s, &known, place, share),
                false => known[place] + share * (known[place + 1] - known[place]),
            };
        }
    }
    let mut other = gas.clone();
    other.set(CONTRACTION, filled);
    Some(other)
}

/// By how much the mean of a smooth pressure about a row is above straight lines between the rows
/// \[Pa\]: what a kernel makes of the rows has that in it. 0 at an end or where a reading is
/// missing.
fn smooth_bow_pa(time_s: &[f64], read_pa: &[f64], row: usize) -> f64 {
    if row == 0 || row + 1 >= read_pa.len() {
        return 0.0;
    }
    let (before_s, after_s) = (time_s[row] - time_s[row - 1], time_s[row + 1] - time_s[row]);
    let slope = |from: usize, length_s: f64| (read_pa[from + 1] - read_pa[from]) / length_s;
    let half_second = (slope(row, after_s) - slope(row - 1, before_s)) / (before_s + after_s);
    // A parabola is a sixth of that times the squared length below its chord, in the mean.
    let squares = (before_s.powi(3) + after_s.powi(3)) / (before_s + after_s);
    let bow_pa = -half_second * squares / 6.0;
    if bow_pa.is_finite() { bow_pa } else { 0.0 }
}

/// The mean of both intervals beside each row.
fn about_rows(time_s: &[f64], intervals: &[Between]) -> Vec<Between> {
    let length_s = |row: usize| time_s[row + 1] - time_s[row];
    let about = |row: usize| {
        let before = row.checked_sub(1);
        let after = (row < intervals.len()).then_some(row);
        let both = || before.into_iter().chain(after);
        let whole_s: f64 = both().map(length_s).sum();
        let mean = |of: fn(&Between) -> f64| -> f64 {
            let parts = both().map(|own| of(&intervals[own]) * length_s(own));
            parts.sum::<f64>() / whole_s
        };
        Between {
            bow_pa: mean(|own| own.bow_pa),
            missed_pa: mean(|own| own.missed_pa),
            doubt_pa: mean(|own| own.doubt_pa),
        }
    };
    (0..time_s.len()).map(about).collect()
}

/// The simulated pressure in each interval between rows, from readings with a noise of `noise_pa`.
fn intervals(gas: &Record, rig: &Rig, noise_pa: f64) -> Option<Vec<Between>> {
    let parts = parts(gas.time_s(), |length_s| {
        2 * (length_s / (2.0 * HALF_PART_S)).ceil().max(1.0) as usize
    });
    let (fine, _) = finer(gas, &parts)?;
    let read_pa = gas.column(PRESSURE_PA)?;
    let mut rig = rig.clone();
    rig.nominal.load = Load::Prescribed;
    let inputs = Inputs::new(&rig, &fine).ok()?;
    let simulated_pa = pressures_pa(&rig, inputs, &fine, Some(fine.column(PRESSURE_PA)?), 0.0)?;
    let mut first = 0;
    let bow = |(row, parts): (usize, &usize)| {
        let begin_pa = if read_pa[row].is_nan() {
            simulated_pa[first]
        } else {
            read_pa[row]
        };
        let value_pa = |part: usize| match part {
            0 => begin_pa,
            _ => simulated_pa[first + part],
        };
        let end_pa = value_pa(*parts);
        let mean_pa = mean(*parts, value_pa);
        first += *parts;
        let missed_pa = read_pa[row + 1] - end_pa;
        let surely_pa = (missed_pa.abs() - MISS_NOISES * noise_pa).max(0.0);
        // The mean is off by a share between −½ and ½ of what was missed; a gap tells nothing.
        let doubt_pa = surely_pa / 12.0_f64.sqrt();
        Between {
            bow_pa: mean_pa - 0.5 * (begin_pa + end_pa),
            missed_pa: doubt_pa.copysign(missed_pa),
            doubt_pa,
        }
    };
    Some(parts.iter().enumerate().map(bow).collect())
}

/// The mean of `value` over so many parts, by Simpson's rule over pairs of them; of a straight line
/// over one.
fn mean(parts: usize, value: impl Fn(usize) -> f64) -> f64 {
    if parts == 1 {
        return 0.5 * (value(0) + value(1));
    }
    let weight = |part: usize| match part {
        _ if part == 0 || part == parts => 1.0,
        _ if part % 2 == 1 => 4.0,
        _ => 2.0,
    };
    let sum: f64 = (0..=parts).map(|part| weight(part) * value(part)).sum();
    sum / (3.0 * parts as f64)
}

#[cfg(test)]
mod tests {
    use super::super::begin::without;
    use super::super::force::{Force, Forces};
    use super::super::kernel::Kernel;
    use super::super::residuals::balances;
    use super::*;
    use crate::identify::simulate::simulate;
    use crate::record::PRESSURE_REF_PA;
    use muscle_plant::simulation::TOLERANCE;
    use std::borrow::Cow;

    const FINER: usize = 50;

    /// One of [`FINER`] rows of a reference and of what came of it.
    fn coarse(drive: &Record, run: &Record) -> Record {
        let mut coarse = Record::new(drive.time_s().iter().step_by(FINER).copied().collect());
        for name in [PRESSURE_REF_PA, PRESSURE_PA, CONTRACTION] {
            let values = drive.column(name).filter(|_| name == PRESSURE_REF_PA);
            let values = values.or_else(|| run.column(name)).expect("the column");
            coarse.set(name, values.iter().step_by(FINER).copied().collect());
        }
        coarse
    }

    /// Ten seconds of a reference in steps of 50 ms: as `rig` follows it, with a row each
    /// millisecond, and what is left of that with a row at each step.
    fn stepped(rig: &Rig) -> (Record, Record) {
        let time_s: Vec<f64> = (0..10_000).map(|row| 1e-3 * f64::from(row)).collect();
        let reference_pa = |row: usize| {
            let held_s = time_s[row / FINER * FINER];
            2.5e5 + 5e4 * (4.0 * held_s).sin()
        };
        let mut drive = Record::new(time_s.clone());
        drive.set(
            PRESSURE_REF_PA,
            (0..time_s.len()).map(reference_pa).collect(),
        );
        drive.set(PRESSURE_PA, vec![2.5e5; time_s.len()]);
        drive.set(CONTRACTION, vec![0.1; time_s.len()]);
        let fine = simulate(rig, &drive, TOLERANCE).expect("a simulation");
        let coarse = coarse(&drive, &fine);
        (fine, coarse)
    }

    /// A weight that swings at 3 Hz after steps: what its motion between rows 50 ms apart makes of
    /// the gas is as large as it is said to be, to within a quarter.
    #[test]
    fn what_is_not_known_between_rows_is_doubted_as_much_as_it_is_off() {
        let rig = Rig::reference();
        let time_s: Vec<f64> = (0..20_000).map(|row| 1e-3 * f64::from(row)).collect();
        let mut drive = Record::new(time_s.clone());
        let step_pa = |t: &f64| [2.5e5, 3.2e5, 2.8e5, 3.6e5][(t / 1.5) as usize % 4];
        drive.set(PRESSURE_REF_PA, time_s.iter().map(step_pa).collect());
        let first = |value: f64| {
            let rows = (0..time_s.len()).map(|row| if row == 0 { value } else { f64::NAN });
            rows.collect()
        };
        drive.set(PRESSURE_PA, first(2.5e5));
        drive.set(CONTRACTION, first(0.1));
        let run = simulate(&rig, &drive, TOLERANCE).expect("a run");
        let coarse = coarse(&drive, &run);
        let prepared = Prepared::all(&rig, [&coarse].into_iter(), None).expect("prepared");
        let gas = prepared[0].gas.as_ref().expect("a reference");
        let doubts_pa = gas_doubts_pa(&prepared[0], &rig).expect("doubts");
        let simulated_pa = gas_pressures_pa(&prepared[0], rig, gas, 0.0).expect("pressures");
        let read_pa = coarse.column(PRESSURE_PA).expect("a pressure");
        let rms = |of: &dyn Fn(usize) -> f64| {
            let rows = 20..read_pa.len();
            let count = rows.len() as f64;
            (rows.map(|row| of(row).powi(2)).sum::<f64>() / count).sqrt()
        };
        let (off_pa, doubt_pa) = (
            rms(&|row| simulated_pa[row] - read_pa[row]),
            rms(&|row| doubts_pa[row]),
        );
        assert!(off_pa > 200.0, "{off_pa}");
        let ratio = doubt_pa / off_pa;
        assert!((0.8..1.25).contains(&ratio), "{doubt_pa} of {off_pa}");
    }

    /// A valve that is later than the rig's by 12 ms: each reading misses a sixtieth of a step, and
    /// the mean between them a fifth of one. The balance of the load is met with another bow.
    #[test]
    fn a_slower_valve_leaves_nothing_in_the_balance_of_the_load() {
        let rig = Rig::reference();
        let lag = "\n[[effect]]\nname = \"valve-lag\"\nform = \"first-order\"\n\
                   time_constant_s = 0.012\n";
        let text = format!("{}{lag}", Rig::REFERENCE_TOML);
        let late = Rig::parse("late.toml", &text).expect("a rig");
        let (_, coarse) = stepped(&late);
        let mut prepared = Prepared::all(&rig, [&coarse].into_iter(), None).expect("prepared");
        let record = &mut prepared[0];
        tell(record, &rig);
        let zeros = record.zeros_of_balances(&rig, false);
        let (bow, others) = zeros.split_last().expect("a bow");
        let [with, by_zeros] =
            [&[bow.clone()][..], others].map(|unknown| missed_n(record, &rig, unknown));
        assert!(with < 0.25 * by_zeros, "{with} of {by_zeros}");
    }

    /// RMS of what is left of the balance of the load beside what is `unknown` \[N\].
    fn missed_n(record: &Prepared, rig: &Rig, unknown: &[Vec<f64>]) -> f64 {
        let read = [Cow::Borrowed(&record.measured)];
        let forces = Forces::new(rig, &read, Force::True).expect("forces");
        let missed = balances(record, rig, &forces.settled_n().expect("forces"));
        let left = without(missed.expect("a balance"), unknown, None);
        let outside = left.outside().zip(&record.places);
        let squares = outside.map(|(value, place)| (value / place.per_noise).powi(2));
        (squares.sum::<f64>() / record.places.len() as f64).sqrt()
    }

    /// A reference that is read 10 kPa too low: from each reading the simulated valve falls that
    /// far within the interval, the same in all. What it makes of the balance is one unknown.
    #[test]
    fn a_valve_that_misses_all_readings_leaves_nothing_in_the_balance_of_the_load() {
        let rig = Rig::reference();
        let (_, mut coarse) = stepped(&rig);
        let reference_pa = coarse.column(PRESSURE_REF_PA).expect("a reference");
        let low_pa = reference_pa.iter().map(|pa| pa - 1e4).collect();
        coarse.set(PRESSURE_REF_PA, low_pa);
        let mut prepared = Prepared::all(&rig, [&coarse].into_iter(), None).expect("prepared");
        let record = &mut prepared[0];
        tell(record, &rig);
        let mut zeros = record.zeros_of_balances(&rig, false);
        let with = missed_n(record, &rig, &zeros);
        zeros.remove(zeros.len() - 2);
        let by_others = missed_n(record, &rig, &zeros);
        assert!(with < 0.25 * by_others, "{with} of {by_others}");
    }

    /// Rows through a kernel, with what the pressure does between them, are what fifty times as
    /// many rows are: what is smooth of that the kernel knows from the rows.
    #[test]
    fn what_a_kernel_knows_of_the_pressure_is_not_counted_twice() {
        let rig = Rig::reference();
        let (fine, coarse) = stepped(&rig);
        let mut prepared = Prepared::all(&rig, [&coarse].into_iter(), None).expect("prepared");
        let record = &mut prepared[0];
        tell(record, &rig);
        let [all_pa, read_pa] = [&fine, &coarse].map(|own| own.column(PRESSURE_PA).expect("it"));
        let rows = read_pa.iter().zip(&record.between_pa);
        let above_pa: Vec<f64> = rows.map(|(read, between)| read + between).collect();
        let smooth = |row| smooth_bow_pa(coarse.time_s(), read_pa, row);
        let smooth_pa: Vec<f64> = (0..read_pa.len()).map(smooth).collect();
        let (mut squares, mut twice) = (0.0, 0.0);
        for place in 0..80 {
            let at = |own: &Record| Kernel::at(own.time_s(), 1.0 + 0.1 * f64::from(place), 0.04);
            let kernel = at(&coarse);
            let off_pa = kernel.value(&above_pa) - at(&fine).value(all_pa);
            squares += off_pa.powi(2);
            twice += (off_pa + kernel.value(&smooth_pa)).powi(2);
        }
        // Were it counted twice, `twice` would have it thrice: a ratio of a quarter.
        assert!(squares < 0.12 * twice, "{squares} of {twice}");
    }

    #[test]
    fn a_smooth_pressure_is_a_parabola_about_a_row() {
        let time_s = [0.0, 0.03, 0.09];
        let read_pa = time_s.map(|t: f64| 1e5 + 2e4 * t - 3e6 * t * t);
        // In the mean a parabola is −f″ L²/12 above its chord.
        let above_pa = [0.03_f64, 0.06].map(|length| 6e6 * length * length / 12.0);
        let expected_pa = (0.03 * above_pa[0] + 0.06 * above_pa[1]) / 0.09;
        assert!((smooth_bow_pa(&time_s, &read_pa, 1) - expected_pa).abs() < 1e-6);
        assert_eq!(smooth_bow_pa(&time_s, &read_pa, 0), 0.0);
        assert_eq!(smooth_bow_pa(&time_s, &[1e5, f64::NAN, 1e5], 1), 0.0);
    }

    /// A reference in steps of 50 ms, and rows as far apart: what lies between two rows is that of
    /// a simulation with fifty times as many.
    #[test]
    fn the_pressure_between_rows_is_that_of_finer_rows() {
        let rig = Rig::reference();
        let (fine, coarse) = stepped(&rig);
        let prepared = Prepared::all(&rig, [&coarse].into_iter(), None).expect("prepared");
        let mut prepared = prepared;
        let trusted = |prepared: &Prepared| -> f64 {
            let places = prepared.places.iter();
            places.map(|place| place.per_noise.powi(-2)).sum()
        };
        let (before, mut late) = (trusted(&prepared[0]), rig.clone());
        tell(&mut prepared[0], &rig);
        // The valve is the rig's: away from the begin what it says is trusted.
        assert!(trusted(&prepared[0]) < 1.01 * before);
        if let Some(valve) = &mut late.nominal.valve {
            valve.flow_gain_kg_per_pa_s *= 0.3;
        }
        let mut doubted = Prepared::all(&late, [&coarse].into_iter(), None).expect("prepared");
        tell(&mut doubted[0], &late);
        assert!(trusted(&doubted[0]) > 4.0 * before);
        let between_pa = &prepared[0].between_pa;
        let fine_pa = fine.column(PRESSURE_PA).expect("a pressure");
        let bow_pa = |row: usize| {
            let own = &fine_pa[row * FINER..=(row + 1) * FINER];
            let ends_pa = own[0] + own[FINER];
            let sum_pa: f64 = own.iter().sum();
            (sum_pa - 0.5 * ends_pa) / FINER as f64 - 0.5 * ends_pa
        };
        // After the begin, and away from the end, where the motion is not smooth.
        let rows = 40..between_pa.len() - 3;
        let squares =
            |value: &dyn Fn(usize) -> f64| rows.clone().map(|row| value(row).powi(2)).sum::<f64>();
        let truth_pa = |row: usize| 0.5 * (bow_pa(row - 1) + bow_pa(row));
        let size = squares(&truth_pa).sqrt();
        let error = squares(&|row| between_pa[row] - truth_pa(row)).sqrt();
        assert!(size > 1e3, "{size}");
        assert!(error < 0.1 * size, "{error} of {size}");
    }
}

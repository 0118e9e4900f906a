//! A record with no more rows than tell something: all others would only cost time.

use super::prepared::Noise;
use crate::record::{
    CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA, VALVE_OPEN,
};
use std::ops::Range;

/// What a record may have.
const SIGNALS: [&str; 6] = [
    PRESSURE_REF_PA,
    PRESSURE_PA,
    CONTRACTION,
    FORCE_N,
    SUPPLY_PA,
    VALVE_OPEN,
];
/// The least time between rows that are compared \[s\]: the fastest effects take a few of them, and
/// rows between them would cost time and tell little.
const PERIOD_S: f64 = 0.008 - ROUNDING_S;
/// Rows of all records together from which on there are fewer of them, if they would not be further
/// apart than a time \[s\] between which straight lines cut off little of a motion.
const ROWS: f64 = 20_000.0;
const PERIOD_MOST_S: f64 = 0.024;
/// How far times that are written in decimals may be off \[s\].
const ROUNDING_S: f64 = 1e-6;
/// The same where nothing changes by so many times its noise \[s\].
const REST_S: f64 = 0.1;
pub(super) const CHANGE_NOISES: f64 = 6.0;

/// What changes by so many times its noise from one row to another is no straight line between
/// them, for the gas.
const BENT_NOISES: f64 = 3.0;

/// The time between rows that are compared, of records that together take so long \[s\]: long ones
/// have more rows than are needed to know what is missing.
pub(super) fn period_s(together_s: f64) -> f64 {
    (together_s / ROWS).clamp(PERIOD_S, PERIOD_MOST_S)
}

/// Whether what is held from each row on is another from `row` on.
fn switches(record: &Record, row: usize) -> bool {
    let held = [PRESSURE_REF_PA, VALVE_OPEN].map(|name| record.column(name));
    let mut held = held.into_iter().flatten();
    held.any(|values| values[row] != values[row - 1] && !values[row].is_nan())
}

/// Rows of `gas`, whose contraction is smooth as is `pressure_pa`, from one of which to the next it
/// may be simulated, and its pressure is a straight line within a part of its noise: all but those
/// at rest between two changes of the reference. All where something is missing or the supply
/// moves.
pub(super) fn gas_told(gas: &Record, pressure_pa: &[f64], noise: &Noise) -> Vec<usize> {
    let time_s = gas.time_s();
    let contraction = gas.column(CONTRACTION).unwrap_or_default();
    let signals = [
        (pressure_pa, noise.pressure_pa),
        (contraction, noise.contraction),
    ];
    let known = |(values, _): &(&[f64], f64)| {
        values.len() == time_s.len() && values.iter().all(|value| value.is_finite())
    };
    if !signals.iter().all(known) || gas.column(SUPPLY_PA).is_some() {
        return (0..time_s.len()).collect();
    }
    let changes = |from: usize, to: usize| {
        let mut signals = signals.iter();
        signals.any(|(values, noise)| (values[to] - values[from]).abs() > BENT_NOISES * noise)
    };
    let mut told = vec![0];
    for row in 1..time_s.len() {
        let last = told[told.len() - 1];
        let ends = row + 1 == time_s.len() || time_s[row + 1] > time_s[last] + REST_S;
        if switches(gas, row) || changes(last, row) || ends {
            // What comes at once is not spread over the time before it.
            if last + 1 < row {
                told.push(row - 1);
            }
            told.push(row);
        }
    }
    told
}

/// `record` with these of its rows only.
pub(super) fn at_rows(record: &Record, rows: &[usize]) -> Record {
    let of = |values: &[f64]| rows.iter().map(|row| values[*row]).collect::<Vec<f64>>();
    let mut some = Record::new(of(record.time_s()));
    for name in SIGNALS {
        if let Some(values) = record.column(name) {
            some.set(name, of(values));
        }
    }
    some
}

/// Each value, or the last one before it where there is none.
fn held(values: &[f64]) -> Vec<f64> {
    let mut last = f64::NAN;
    let value = |value: &f64| {
        if !value.is_nan() {
            last = *value;
        }
        last
    };
    values.iter().map(value).collect()
}

/// `record` with no more rows than the fastest effects ask for, and as many as are `period_s` apart
/// at most. On a `bench`, where the pressure is
/// an input, rows in which nothing has changed are rarer; with a reference there is one where that
/// steps or the valve's cock changes. A reference that moves on all the time is held at its mean
/// over a row: a pressure that follows it within 30 ms, at 600 kPa/s, is off by 160 Pa at most. Any
/// other cell without a sample has the next one before the next such row.
pub(super) fn thinned(record: &Record, noise: &Noise, period_s: f64, bench: bool) -> Record {
    let time_s = record.time_s();
    let reference_pa = record.column(PRESSURE_REF_PA).map(held);
    let step_pa = CHANGE_NOISES * noise.pressure_pa;
    let valve_open = record.column(VALVE_OPEN).map(held);
    let steps = |row: usize| {
        let by = |values: &Option<Vec<f64>>| {
            let change = |values: &Vec<f64>| (values[row] - values[row - 1]).abs();
            values.as_ref().map_or(0.0, change)
        };
        by(&reference_pa) > step_pa || by(&valve_open) > 0.0
    };
    let signals = [PRESSURE_PA, CONTRACTION, FORCE_N];
    let signals = signals.map(|name| (record.column(name), CHANGE_NOISES * noise.of(name)));
    let changes = |from: usize, to: usize| {
        let mut signals = signals.iter();
        signals.any(|(values, change)| {
            values.is_some_and(|values| (values[to] - values[from]).abs() > *change)
        })
    };
    let is_far = |row: usize, last: usize| {
        let next_s = time_s.get(row + 1).copied().unwrap_or(f64::INFINITY);
        time_s[row] >= time_s[last] + PERIOD_S && next_s > time_s[last] + period_s + ROUNDING_S
    };
    let mut begins = vec![0];
    let mut last = 0;
    for row in 1..time_s.len() {
        let due = match &reference_pa {
            Some(_) => is_far(row, last) || steps(row),
            None if !is_far(row, last) => false,
            // A weight's balance at rest bounds its static friction.
            None if !bench => true,
            None => {
                let changed = changes(last, row);
                // What comes at once is not spread over the time before it.
                if changed && time_s[row - 1] >= time_s[last] + PERIOD_S {
                    begins.push(row - 1);
                }
                changed || time_s[row] >= time_s[last] + REST_S
            }
        };
        if due {
            begins.push(row);
            last = row;
        }
    }
    if begins.len() == time_s.len() {
        return record.clone();
    }
    let mut thin = Record::new(begins.iter().map(|row| time_s[*row]).collect());
    let ends = begins.iter().skip(1).copied().chain([time_s.len()]);
    let stretches: Vec<_> = begins.iter().zip(ends).map(|(a, b)| *a..b).collect();
    for name in SIGNALS {
        if let Some(values) = record.column(name) {
            let first = |rows: &Range<usize>| {
                let mut present = values[rows.clone()].iter().filter(|value| !value.is_nan());
                present.next().copied().unwrap_or(f64::NAN)
            };
            thin.set(name, stretches.iter().map(first).collect());
        }
    }
    if let Some(values) = reference_pa {
        let mean = |rows: &Range<usize>| {
            let values = &values[rows.clone()];
            values.iter().sum::<f64>() / values.len() as f64
        };
        thin.set(PRESSURE_REF_PA, stretches.iter().map(mean).collect());
    }
    thin
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_held_begins_in_its_own_row() {
        let time_s: Vec<f64> = (0..100).map(|row| 1e-3 * f64::from(row)).collect();
        let after = |row: usize, before: f64, then: f64| {
            let values = (0..100).map(|r| if r < row { before } else { then });
            values.collect::<Vec<f64>>()
        };
        let mut record = Record::new(time_s);
        record.set(PRESSURE_REF_PA, after(21, 1e5, 2e5));
        record.set(VALVE_OPEN, after(51, 1.0, 0.0));
        let noise = Noise {
            pressure_pa: 250.0,
            ..Noise::default()
        };
        let thin = thinned(&record, &noise, PERIOD_S, false);
        assert!(thin.time_s().len() < 20, "{:?}", thin.time_s());
        for row in [21, 51] {
            assert!(thin.time_s().contains(&(1e-3 * f64::from(row))), "{row}");
        }
        let later = thin.time_s().iter().map(|time_s| *time_s > 0.0505);
        assert_eq!(thin.shut(), later.collect::<Vec<_>>());
    }

    /// At 500 Hz a reference that moves on all the time has a row every 8 ms, and the same
    /// integral.
    #[test]
    fn a_reference_that_moves_on_is_held_at_its_mean() {
        let time_s: Vec<f64> = (0..4000).map(|row| 2e-3 * f64::from(row)).collect();
        let reference_pa: Vec<f64> = time_s.iter().map(|s| 2e5 + 1e5 * (3.0 * s).sin()).collect();
        let mut record = Record::new(time_s);
        record.set(PRESSURE_REF_PA, reference_pa.clone());
        let noise = Noise {
            pressure_pa: 250.0,
            ..Noise::default()
        };
        let thin = thinned(&record, &noise, PERIOD_S, false);
        assert_eq!(thin.time_s().len(), 1000);
        let held_pa = thin.column(PRESSURE_REF_PA).expect("a reference");
        for (row, held_pa) in held_pa.iter().enumerate() {
            let mean_pa = reference_pa[4 * row..][..4].iter().sum::<f64>() / 4.0;
            assert!((held_pa - mean_pa).abs() < 1e-6, "{row}");
        }
    }

    /// Four records of two minutes at 250 Hz have rows of 24 ms, a minute in all has them of 8 ms,
    /// and samples that are 20 ms apart are all kept.
    #[test]
    fn long_records_have_fewer_rows() {
        let apart_s = |step_s: f64, together_s: f64| {
            let mut record = Record::new((0..1000).map(|row| step_s * f64::from(row)).collect());
            record.set(PRESSURE_REF_PA, vec![2e5; 1000]);
            let thin = thinned(&record, &Noise::default(), period_s(together_s), false);
            thin.time_s()[1]
        };
        for (step_s, together_s, expected_s) in [
            (0.004, 480.0, 0.024),
            (0.004, 60.0, 0.008),
            (0.02, 480.0, 0.02),
            (0.01, 280.0, 0.01),
        ] {
            let found_s = apart_s(step_s, together_s);
            assert!((found_s - expected_s).abs() < 1e-9, "{step_s}: {found_s}");
        }
    }
}

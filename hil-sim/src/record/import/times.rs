//! The times of an imported file: in seconds, rising.

use super::source::Source;
use super::{BadInput, Map, Repeated, Restarted, TIME, TIME_S, TimeMap, in_range, unit_of};
use crate::error::shown;
use crate::record::check::quantile;
use serde::Serialize;

/// Report on rows whose time does not rise.
#[derive(Clone, Debug, Serialize)]
pub struct Mended {
    /// Number of rows.
    pub count: usize,
    /// Position of the first: line of a text file, row of a MATLAB file.
    pub first: Option<usize>,
    /// The correction: `dropped`, `spread` or `continued`.
    pub done: &'static str,
}

impl Mended {
    /// Counts a row, whose `place` is looked up for the first.
    fn found(&mut self, place: impl Fn() -> usize) {
        self.count += 1;
        self.first.get_or_insert_with(place);
    }
}

/// The rows that are kept and their times.
pub(super) struct Times {
    /// As `u32`: files of gigabytes are refused before.
    pub rows: Vec<u32>,
    pub rows_read: usize,
    pub time_s: Vec<f64>,
    pub repeated: Mended,
    pub restarted: Mended,
    /// Source of the times, in words.
    pub source: String,
}

impl Map {
    /// The times of the rows.
    pub(super) fn times(&self, source: &Source) -> Result<Times, BadInput> {
        let map = self.time.get_ref();
        let mut times = Times::new(map);
        // The mapping has either a rate or a column.
        if let Some(rate_hz) = map.rate_hz {
            times.source = format!("the row's number, at {rate_hz} Hz");
            if let Some(first) = self.columns.values().next() {
                times.rows_read = source.column(&first.column)?.1.len();
            }
            times.rows = (0..times.rows_read as u32).collect();
            times.time_s = times
                .rows
                .iter()
                .map(|row| f64::from(*row) / rate_hz)
                .collect();
        } else if let Some(selector) = &map.column {
            let section = self.time.span();
            let (unit, factor, _) =
                unit_of(&self.place, "time", map.unit.as_ref(), TIME, &section)?;
            let (name, read_s) = source.column(selector)?;
            let mut read_s = read_s.into_owned();
            for time_s in &mut read_s {
                *time_s *= factor;
            }
            times.source = format!("{name}, in {unit}");
            times.read(
                map,
                &read_s,
                |row, why| source.bad(row, &name, why),
                |row| source.place(row),
            )?;
            if times.time_s.windows(2).any(|pair| pair[0] >= pair[1]) {
                let expected = "times that differ, found one for all rows";
                return Err(source.bad_column(&name, expected));
            }
        }
        Ok(times)
    }
}

impl Times {
    fn new(map: &TimeMap) -> Times {
        let mended = |done| Mended {
            count: 0,
            first: None,
            done,
        };
        Times {
            rows: Vec::new(),
            rows_read: 0,
            time_s: Vec::new(),
            repeated: mended(match map.repeated {
                Repeated::Spread => "spread",
                Repeated::Drop | Repeated::Refuse => "dropped",
            }),
            restarted: mended(match map.restarted {
                Restarted::Continue => "continued",
                Restarted::Drop | Restarted::Refuse => "dropped",
            }),
            source: String::new(),
        }
    }

    /// Reads times that may not rise. `bad` is the error for a row, `place` the position of a row.
    fn read(
        &mut self,
        map: &TimeMap,
        read_s: &[f64],
        bad: impl Fn(usize, &str) -> BadInput,
        place: impl Fn(usize) -> usize,
    ) -> Result<(), BadInput> {
        self.rows_read = read_s.len();
        let steps = read_s.windows(2).map(|pair| pair[1] - pair[0]);
        let period_s = quantile(steps.filter(|step| *step > 0.0).collect(), 0.5);
        let mut shift_s = 0.0;
        for (row, time_s) in read_s.iter().enumerate() {
            if time_s.is_nan() {
                return Err(bad(row, "a time in every row, found none"));
            }
            let mut time_s = time_s + shift_s;
            in_range(TIME_S, time_s).map_err(|why| bad(row, &why))?;
            let last_s = self.time_s.last().copied().unwrap_or(f64::NEG_INFINITY);
            let refused = |key: &str| {
                let [last_s, time_s] = [last_s, time_s].map(shown);
                let expected =
                    format!("a time after {last_s} s, or `{key}` in the mapping, found {time_s} s");
                Err(bad(row, &expected))
            };
            if time_s < last_s {
                self.restarted.found(|| place(row));
                match map.restarted {
                    Restarted::Refuse => return refused("time.restarted"),
                    Restarted::Drop => continue,
                    Restarted::Continue => {
                        shift_s += last_s + period_s - time_s;
                        time_s = last_s + period_s;
                    }
                }
            } else if time_s == last_s {
                self.repeated.found(|| place(row));
                match map.repeated {
                    Repeated::Refuse => return refused("time.repeated"),
                    Repeated::Drop => continue,
                    Repeated::Spread => {}
                }
            }
            self.rows.push(row as u32);
            self.time_s.push(time_s);
        }
        spread(&mut self.time_s, period_s);
        Ok(())
    }
}

/// Spreads equal times evenly up to the next time, those at the end over a period.
fn spread(time_s: &mut [f64], period_s: f64) {
    let mut begin = 0;
    while begin < time_s.len() {
        let from_s = time_s[begin];
        let count = time_s[begin..]
            .iter()
            .take_while(|next_s| **next_s == from_s)
            .count();
        let to_s = time_s
            .get(begin + count)
            .copied()
            .unwrap_or(from_s + period_s);
        for step in 1..count {
            time_s[begin + step] = from_s + (to_s - from_s) * step as f64 / count as f64;
        }
        begin += count;
    }
}

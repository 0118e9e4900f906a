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

/// The times of the rows that are kept.
pub(super) struct Times {
    pub rows_read: usize,
    /// The rows that are not kept, rising; as `u32`, as files of gigabytes are refused before.
    pub dropped: Vec<u32>,
    /// Those of a column, or the rate.
    time_s: Vec<f64>,
    rate_hz: Option<f64>,
    pub repeated: Mended,
    pub restarted: Mended,
    /// Source of the times, in words.
    pub source: String,
}

impl Map {
    /// The times of the rows.
    pub(super) fn times(&self, source: &mut Source) -> Result<Times, BadInput> {
        let map = self.time.get_ref();
        let mut times = Times::new(map);
        // The mapping has either a rate or a column.
        if let Some(rate_hz) = map.rate_hz {
            times.source = format!("the row's number, at {rate_hz} Hz");
            let first = self.columns.values().next();
            times.rows_read = first.map_or(0, |first| source.rows(&first.column));
        } else if let Some(selector) = &map.column {
            let section = self.time.span();
            let (unit, factor, _) =
                unit_of(&self.place, "time", map.unit.as_ref(), TIME, &section)?;
            let (name, mut read_s) = source.column(selector)?;
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
            rows_read: 0,
            dropped: Vec::new(),
            time_s: Vec::new(),
            rate_hz: map.rate_hz,
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

    /// The times of the rows that are kept \[s\].
    pub fn time_s(self) -> Vec<f64> {
        match self.rate_hz {
            Some(rate_hz) => {
                let rows = 0..self.rows_read;
                rows.map(|row| row as f64 / rate_hz).collect()
            }
            None => self.time_s,
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
                    Restarted::Drop => {
                        self.dropped.push(row as u32);
                        continue;
                    }
                    Restarted::Continue => {
                        shift_s += last_s + period_s - time_s;
                        time_s = last_s + period_s;
                    }
                }
            } else if time_s == last_s {
                self.repeated.found(|| place(row));
                match map.repeated {
                    Repeated::Refuse => return refused("time.repeated"),
                    Repeated::Drop => {
                        self.dropped.push(row as u32);
                        continue;
                    }
                    Repeated::Spread => {}
                }
            }
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

//! Unknown columns whose names resemble those of known columns that the record lacks.

use super::units::{TARGETS, TIME, Unit};
use super::{Cells, Record, TIME_S};
use crate::error::BadInput;

/// A word may have one typing error per so many letters: short words are one letter from others
/// (`ref` and `rel`).
const LETTERS_PER_ERROR: usize = 5;

/// Other spellings of units.
const SPELLINGS: [(&str, &str); 4] = [
    ("percent", "%"),
    ("sec", "s"),
    ("c", "degC"),
    ("celsius", "degC"),
];

impl Record {
    /// Refuses a record in which an unknown column has almost the name of a known one that is
    /// absent: a typing error, or another unit.
    ///
    /// # Errors
    /// There is such a column.
    pub fn check_names(&self) -> Result<(), BadInput> {
        let absent = TARGETS
            .iter()
            .filter(|(known, _)| self.find(known).is_none());
        let absent: Vec<_> = absent.copied().collect();
        let mut columns = self.columns.iter().flatten();
        let found = columns.find_map(|(name, cells)| match cells {
            Cells::Numbers(_) => None,
            Cells::Text(_) => misnamed(&self.file, name, &absent),
        });
        found.map_or(Ok(()), Err)
    }
}

/// The column of a header without `time_s` that has almost this name.
pub(super) fn misnamed_time<'a>(
    file: &str,
    mut header: impl Iterator<Item = &'a str>,
) -> Option<BadInput> {
    header.find_map(|name| misnamed(file, name, &[(TIME_S, TIME)]))
}

/// What is wrong with the name of an unknown column, if it resembles one of the `absent` ones.
fn misnamed(file: &str, name: &str, absent: &[(&str, &[Unit])]) -> Option<BadInput> {
    let (_, known, unit, does) = absent
        .iter()
        .filter_map(|(known, units)| {
            let (errors, unit) = resemblance(name, known, units)?;
            let own = units[0].0;
            let does = match unit.is_some_and(|unit| unit != own) {
                true => "converts",
                false => "renames",
            };
            Some((errors, *known, unit.unwrap_or(own), does))
        })
        .min_by_key(|(errors, ..)| *errors)?;
    let section = match known {
        TIME_S => "time".into(),
        _ => format!("columns.{known}"),
    };
    let expected = format!(
        "the name of a known column: did you mean `{known}`? `hil-sim import {file} --map map.toml \
         --out new.csv` {does} it if map.toml has column = {name:?} and unit = {unit:?} in \
         [{section}]"
    );
    Some(BadInput {
        line: Some(1),
        place: Some(format!("column `{name}`")),
        ..BadInput::file(file, expected)
    })
}

/// The number of typing errors by which the stem of `name`, its unit apart, differs from that of
/// `known`, and the unit of `name`, if it has one. `None` if they are different names: what
/// follows the stem is no unit of this quantity, or there are too many errors.
fn resemblance<'a>(name: &str, known: &str, units: &'a [Unit]) -> Option<(usize, Option<&'a str>)> {
    let known_unit = format!("_{}", units[0].0.to_lowercase());
    let known_stem = known.strip_suffix(&known_unit).unwrap_or(known);
    let lower = name.to_lowercase();
    let words = lower.split(|letter: char| !letter.is_alphanumeric() && letter != '%');
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    let (last, before) = words.split_last()?;
    let spelled = SPELLINGS.iter().find(|(spelling, _)| spelling == last);
    let last = spelled.map_or(*last, |(_, unit)| unit);
    let unit = units
        .iter()
        .map(|(unit, ..)| *unit)
        .find(|unit| unit.eq_ignore_ascii_case(last));
    let stem = if unit.is_some() { before } else { &words };
    let known_words: Vec<&str> = known_stem.split('_').collect();
    if stem.len() != known_words.len() {
        return None;
    }
    let mut errors = 0;
    for (word, known) in stem.iter().zip(known_words) {
        let differs = strsim::osa_distance(word, known);
        if differs > known.len() / LETTERS_PER_ERROR {
            return None;
        }
        errors += differs;
    }
    Some((errors, unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known column and the unit to convert from that a record with the column `name` and the
    /// columns `present` is told.
    fn told(name: &str, present: &[&str]) -> Option<String> {
        let columns = [&["time_s", name], present].concat();
        let cells = vec!["0"; columns.len()].join(",");
        let text = format!("{}\n{cells}\n", columns.join(","));
        let record = Record::parse("a.csv", text.as_bytes()).expect("kept");
        assert!(record.text(name).is_some(), "an unknown column is kept");
        let message = record.check_names().err()?.to_string();
        let start = format!("a.csv:1: column `{name}`: expected the name of a known column: ");
        Some(message.strip_prefix(&start).expect("the place").to_owned())
    }

    #[test]
    fn a_typing_error_is_named_with_the_column_that_was_meant() {
        for (name, known, unit) in [
            ("presure_pa", "pressure_pa", "Pa"),
            ("Pressure_Pa", "pressure_pa", "Pa"),
            ("pressure [Pa]", "pressure_pa", "Pa"),
            ("pressure", "pressure_pa", "Pa"),
            ("pressrue_ref_pa", "pressure_ref_pa", "Pa"),
            ("contarction", "contraction", "1"),
            ("vavle_open", "valve_open", "1"),
            ("forces_n", "force_n", "N"),
        ] {
            let expected = format!(
                "did you mean `{known}`? `hil-sim import a.csv --map map.toml --out new.csv` \
                 renames it if map.toml has column = \"{name}\" and unit = \"{unit}\" in \
                 [columns.{known}]"
            );
            assert_eq!(told(name, &[]), Some(expected), "{name}");
            assert_eq!(told(name, &[known]), None, "{name} beside {known}");
        }
    }

    #[test]
    fn another_unit_is_named_with_the_command_that_converts_it() {
        for (name, known, unit) in [
            ("pressure_bar", "pressure_pa", "bar"),
            ("presure_kpa", "pressure_pa", "kPa"),
            ("Pressure (mbar)", "pressure_pa", "mbar"),
            ("pressure_ref_bar", "pressure_ref_pa", "bar"),
            ("contraction_percent", "contraction", "%"),
            ("temperature_c", "temperature_k", "degC"),
            ("finger_mm", "finger_m", "mm"),
        ] {
            let expected = format!(
                "did you mean `{known}`? `hil-sim import a.csv --map map.toml --out new.csv` \
                 converts it if map.toml has column = \"{name}\" and unit = \"{unit}\" in \
                 [columns.{known}]"
            );
            assert_eq!(told(name, &[]), Some(expected));
        }
    }

    #[test]
    fn a_time_in_another_unit_is_named() {
        let refused = |header: &str| {
            let text = format!("{header}\n0,1\n");
            let bad = Record::parse("a.csv", text.as_bytes()).expect_err("no time_s");
            bad.to_string()
        };
        let message = refused("force_n,time_ms");
        assert!(
            message.starts_with("a.csv:1: column `time_ms`: ")
                && message.contains("did you mean `time_s`? `hil-sim import a.csv ")
                && message.ends_with("column = \"time_ms\" and unit = \"ms\" in [time]"),
            "{message}"
        );
        assert!(refused("force_n,t").contains("a header line with a column `time_s`"));
    }

    /// Columns that are no slips: they are kept, as the interface says.
    #[test]
    fn other_unknown_columns_are_kept() {
        for name in [
            "pressure_raw",
            "pressure_rel_pa",
            "pressure_count_2",
            "force_command",
            "force_2",
            "contraction_rate",
            "contraction_mm",
            "supply_voltage",
            "temperature_room_k",
            "torque_nm",
            "remark",
            "note_pa",
            "%",
            "_",
        ] {
            assert_eq!(told(name, &[]), None, "{name}");
        }
    }
}

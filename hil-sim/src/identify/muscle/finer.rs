//! A record of the gas with more rows: what drives it between two rows that are far apart.

use crate::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record, SUPPLY_PA, VALVE_OPEN};

/// An interval of more parts is a gap.
const PARTS_MAX: usize = 20;

/// Into how many parts each interval is cut: `of` its length, and one if it is a gap.
pub(super) fn parts(time_s: &[f64], of: impl Fn(f64) -> usize) -> Vec<usize> {
    let parts = time_s.windows(2).map(|pair| of(pair[1] - pair[0]));
    let cut = |parts| if parts > PARTS_MAX { 1 } else { parts };
    parts.map(cut).collect()
}

/// `gas` with each interval in so many parts: the contraction by cubics, the reference and the cock
/// held, pressures in its rows only. Beside it whether each of its rows is one of `gas`.
pub(super) fn finer(gas: &Record, parts: &[usize]) -> Option<(Record, Vec<bool>)> {
    let time_s = gas.time_s();
    let contraction = gas.column(CONTRACTION)?;
    let mut fine_s = Vec::new();
    let mut origin = Vec::new();
    let mut fine_contraction = Vec::new();
    for (row, parts) in parts.iter().enumerate() {
        let length_s = time_s[row + 1] - time_s[row];
        for part in 0..*parts {
            let share = part as f64 / *parts as f64;
            fine_s.push(time_s[row] + share * length_s);
            origin.push((row, part == 0));
            fine_contraction.push(cubic(time_s, contraction, row, share));
        }
    }
    let last = time_s.len() - 1;
    fine_s.push(time_s[last]);
    origin.push((last, true));
    fine_contraction.push(contraction[last]);
    let at_rows = |values: &[f64]| -> Vec<f64> {
        let value = |(row, is_row): &(usize, bool)| if *is_row { values[*row] } else { f64::NAN };
        origin.iter().map(value).collect()
    };
    let held = |values: &[f64]| origin.iter().map(|(row, _)| values[*row]).collect();
    let mut fine = Record::new(fine_s);
    fine.set(CONTRACTION, fine_contraction);
    fine.set(PRESSURE_PA, at_rows(gas.column(PRESSURE_PA)?));
    fine.set(PRESSURE_REF_PA, held(gas.column(PRESSURE_REF_PA)?));
    if let Some(supply_pa) = gas.column(SUPPLY_PA) {
        fine.set(SUPPLY_PA, at_rows(supply_pa));
    }
    if let Some(open) = gas.column(VALVE_OPEN) {
        fine.set(VALVE_OPEN, held(open));
    }
    Some((fine, origin.into_iter().map(|(_, is_row)| is_row).collect()))
}

/// `values` at a `share` of the interval after `row`, by the cubic through the rows about it, or
/// linear beside an end.
pub(super) fn cubic(time_s: &[f64], values: &[f64], row: usize, share: f64) -> f64 {
    let linear = values[row] + share * (values[row + 1] - values[row]);
    if share == 0.0 || row == 0 || row + 2 >= values.len() {
        return linear;
    }
    let at_s = time_s[row] + share * (time_s[row + 1] - time_s[row]);
    let of = |own: usize| {
        let others = (row - 1..=row + 2).filter(|other| *other != own);
        let basis = others.map(|other| (at_s - time_s[other]) / (time_s[own] - time_s[other]));
        values[own] * basis.product::<f64>()
    };
    let smooth: f64 = (row - 1..=row + 2).map(of).sum();
    if smooth.is_finite() { smooth } else { linear }
}

//! Columns of records, filters without phase, and a memory.

use std::path::Path;

/// Samples before and after a place that tell the value there.
const TAPS: usize = 12;

/// The columns `names` of a CSV file; `None` if the file or a column is not there.
pub fn columns<const N: usize>(path: &Path, names: [&str; N]) -> Option<[Vec<f64>; N]> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut lines = text.lines();
    let heads: Vec<&str> = lines.next()?.split(',').collect();
    let mut columns = [const { Vec::new() }; N];
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        for (column, name) in columns.iter_mut().zip(names) {
            let place = heads.iter().position(|head| *head == name)?;
            column.push(cells.get(place)?.parse().ok()?);
        }
    }
    Some(columns)
}

/// Three moving averages over `width` samples, an odd number.
pub fn smooth(values: &[f64], width: usize) -> Vec<f64> {
    let mut values = values.to_vec();
    for _ in 0..3 {
        let mut sums = vec![0.0];
        for value in &values {
            sums.push(sums[sums.len() - 1] + value);
        }
        values = (0..values.len())
            .map(|row| {
                let from = row.saturating_sub(width / 2);
                let to = (row + width / 2 + 1).min(values.len());
                (sums[to] - sums[from]) / (to - from) as f64
            })
            .collect();
    }
    values
}

/// Difference quotients of `values` over two samples.
pub fn rate(values: &[f64], sample_s: f64) -> Vec<f64> {
    let last = values.len() - 1;
    let difference = |row: usize| values[(row + 1).min(last)] - values[row.saturating_sub(1)];
    (0..=last)
        .map(|row| difference(row) / (2.0 * sample_s))
        .collect()
}

/// The value at a place between samples, on a straight line.
pub fn at(values: &[f64], place: f64) -> f64 {
    let place = place.max(0.0);
    let (row, share) = (place as usize, place.fract());
    let next = (row + 1).min(values.len() - 1);
    values[row] * (1.0 - share) + values[next] * share
}

/// The share, −1 to 1, of a force that comes back over a distance after a reversal, when what had
/// come back `before` has moved on: presliding by Dahl.
pub fn slid(before: f64, moved_m: f64, distance_m: f64) -> f64 {
    let way = moved_m.signum();
    way + (before - way) * (-moved_m.abs() / distance_m.max(1e-12)).exp()
}

/// `values` with so many for each, by a sinc in a window (Hann).
pub fn between(values: &[f64], count: usize) -> Vec<f64> {
    let of = |place: usize| {
        let row = place / count;
        let share = |other: usize| {
            let x = std::f64::consts::PI * (place as f64 / count as f64 - other as f64);
            let sinc = if x == 0.0 { 1.0 } else { x.sin() / x };
            sinc * (0.5 * x / (TAPS + 1) as f64).cos().powi(2)
        };
        let taps = row.saturating_sub(TAPS)..=(row + TAPS).min(values.len() - 1);
        taps.map(|other| values[other] * share(other)).sum()
    };
    (0..=count * values.len()).map(of).collect()
}

/// Root mean square.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0_f64), |(sum, count), v| (sum + v * v, count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

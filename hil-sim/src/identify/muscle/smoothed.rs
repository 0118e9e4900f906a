//! A measured motion with less noise, where it is smooth.
//!
//! A motion that drives a simulation brings its noise in. Where what is simulated cannot go either
//! way alike, noise goes one way: beyond the edge of a valve's dead zone it is let out, and what is
//! left lies inside, so that the zone would be found too wide.

use nalgebra::{Matrix3, Vector3};

/// Rows to each side of a row through which a parabola is laid: from the fewest that leave a
/// scatter, to the longest rest between two drives.
const REACHES: [usize; 5] = [2, 4, 8, 16, 32];
/// By how many of its standard deviations the scatter about a parabola may be above its mean.
const SCATTER_ERRORS: f64 = 3.0;

/// `values` with a standard deviation of `noise`, each replaced by that of the parabola through the
/// longest stretch about its row that is one within the noise, as are all shorter ones.
pub(super) fn smoothed(time_s: &[f64], values: &[f64], noise: f64) -> Vec<f64> {
    let smooth = |row: usize| {
        let mut value = values[row];
        for reach in REACHES {
            let rows = row.saturating_sub(reach)..row + reach + 1;
            if row < reach || rows.end > values.len() {
                break;
            }
            let found = parabola(&time_s[rows.clone()], &values[rows], reach);
            let free = (2 * reach - 2) as f64;
            let most = free + SCATTER_ERRORS * (2.0 * free).sqrt();
            match found {
                Some((middle, squares)) if squares <= most * noise * noise => value = middle,
                _ => break,
            }
        }
        value
    };
    (0..values.len()).map(smooth).collect()
}

/// `values` without the ways back that are shorter than `least`: noise that goes to and fro is no
/// way. From one turn to the next they only rise, or only fall; a gap stays one.
pub(super) fn without_short_ways(values: &[f64], least: f64) -> Vec<f64> {
    let mut out = values.to_vec();
    // The farthest value since the last turn, its row, and which way it went there.
    let mut far: Option<(f64, usize)> = None;
    let mut sign = 0.0;
    for (row, value) in values
        .iter()
        .enumerate()
        .filter(|(_, value)| !value.is_nan())
    {
        let Some((farthest, at)) = far else {
            far = Some((*value, row));
            continue;
        };
        let way = value - farthest;
        if way * sign >= 0.0 && sign != 0.0 {
            far = Some((*value, row));
        } else if way.abs() > least {
            // It has turned, there.
            sign = way.signum();
            far = Some((*value, row));
            let mut last = farthest;
            for (own, value) in out[at..=row].iter_mut().zip(&values[at..=row]) {
                if !value.is_nan() {
                    last = if (value - last) * sign > 0.0 {
                        *value
                    } else {
                        last
                    };
                    *own = last;
                }
            }
            continue;
        }
        out[row] = far.map_or(*value, |(farthest, _)| farthest);
    }
    out
}

/// The parabola through `values` by least squares: its value in the row `middle`, and the sum of
/// the squares about it.
fn parabola(time_s: &[f64], values: &[f64], middle: usize) -> Option<(f64, f64)> {
    let whole_s = time_s[time_s.len() - 1] - time_s[0];
    let powers = |row: usize| {
        let t = (time_s[row] - time_s[middle]) / whole_s;
        Vector3::new(1.0, t, t * t)
    };
    let mut square = Matrix3::zeros();
    let mut product = Vector3::zeros();
    for (row, value) in values.iter().enumerate() {
        let powers = powers(row);
        square += powers * powers.transpose();
        product += powers * (value - values[middle]);
    }
    let found = square.cholesky()?.solve(&product);
    let squares = values.iter().enumerate().map(|(row, value)| {
        let off = value - values[middle] - found.dot(&powers(row));
        off * off
    });
    Some((values[middle] + found[0], squares.sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: f64 = 1e-4;

    /// Rows of 10 ms: a rest, a ramp from 2 s on, with noise.
    fn rows() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..400).map(|row| 0.01 * f64::from(row)).collect();
        let ramp = time_s.iter().map(|t| 0.1 * (t - 2.0).max(0.0));
        let ramp: Vec<f64> = ramp.collect();
        let read = ramp.iter().enumerate().map(|(row, value)| {
            let noise = (row as f64 * 12.9898).sin() * 43_758.547;
            value + 12.0_f64.sqrt() * NOISE * (noise - noise.floor() - 0.5)
        });
        let read = read.collect();
        (time_s, ramp, read)
    }

    #[test]
    fn ways_back_are_left_out_if_they_are_short() {
        let values = [
            0.0,
            0.1,
            1.0,
            0.9,
            1.1,
            f64::NAN,
            1.0,
            1.05,
            0.2,
            0.3,
            0.1,
            0.5,
        ];
        let found = without_short_ways(&values, 0.3);
        let expected = [
            0.0,
            0.1,
            1.0,
            1.0,
            1.1,
            f64::NAN,
            1.0,
            1.0,
            0.2,
            0.2,
            0.1,
            0.5,
        ];
        for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let is_same = found == expected || found.is_nan() && expected.is_nan();
            assert!(is_same, "row {row}: {found}, expected {expected}");
        }
    }

    #[test]
    fn noise_goes_and_a_corner_stays() {
        let (time_s, truth, read) = rows();
        let smooth = smoothed(&time_s, &read, NOISE);
        let error = |from: usize, to: usize| {
            let rows = smooth[from..to].iter().zip(&truth[from..to]);
            let squares = rows.map(|(own, truth)| (own - truth).powi(2));
            (squares.sum::<f64>() / (to - from) as f64).sqrt() / NOISE
        };
        // 0.19 where the longest stretch fits; a few rows keep a shorter one.
        assert!(error(40, 160) < 0.4, "{}", error(40, 160));
        assert!(error(240, 360) < 0.4, "{}", error(240, 360));
        // As good as the readings.
        assert!(error(190, 210) < 1.5, "{}", error(190, 210));
    }

    #[test]
    fn a_gap_stays_and_is_not_smoothed_over() {
        let (time_s, _, mut read) = rows();
        read[100] = f64::NAN;
        let smooth = smoothed(&time_s, &read, NOISE);
        assert!(smooth[100].is_nan());
        assert_eq!(smooth.iter().filter(|value| value.is_nan()).count(), 1);
        assert_eq!(smooth[99], read[99]);
    }
}

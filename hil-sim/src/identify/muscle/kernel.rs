//! Smooth kernels: value, slope and curvature of a noisy signal.

use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// The kernel reaches so many widths.
pub(super) const KERNEL_REACH: f64 = 4.0;

/// Parts of an interval between rows at whose ends a jump is tried.
const JUMPS: u32 = 4;

/// A Gaussian and its derivatives as weights of rows: what value, slope and curvature of a signal
/// smoothed by the Gaussian are. Smoothing a balance of forces with the first leaves its other two
/// to the contraction.
pub(super) struct Kernel {
    pub(super) rows: Range<usize>,
    pub(super) value: Vec<f64>,
    pub(super) first: Vec<f64>,
    pub(super) second: Vec<f64>,
}

impl Kernel {
    pub(super) fn at(time_s: &[f64], at_s: f64, width_s: f64) -> Kernel {
        let reach_s = KERNEL_REACH * width_s;
        let start = time_s.partition_point(|t| *t < at_s - reach_s);
        let end = time_s.partition_point(|t| *t <= at_s + reach_s);
        let last = time_s.len() - 1;
        let base = |row: usize| {
            let z = (time_s[row] - at_s) / width_s;
            let span_s = 0.5 * (time_s[(row + 1).min(last)] - time_s[row.saturating_sub(1)]);
            (z, span_s * (-0.5 * z * z).exp())
        };
        let rows: Vec<(f64, f64)> = (start..end).map(base).collect();
        // Whatever the rows' times and wherever they end, exact for all polynomials up to `degree`:
        // of a fast motion a little of the slope would be much of the curvature.
        let weights = |moment: usize, degree: usize| -> Option<Vec<f64>> {
            if rows.len() <= degree {
                return None;
            }
            let size = degree + 1;
            let moments = DMatrix::from_fn(size, size, |i, j| {
                rows.iter().map(|(z, g)| g * z.powi((i + j) as i32)).sum()
            });
            let mut asked = DVector::zeros(size);
            // The factorial: what a derivative makes of its power.
            asked[moment] = [1.0, 1.0, 2.0][moment] / width_s.powi(moment as i32);
            let polynomial = moments.cholesky()?.solve(&asked);
            let at = |(z, g): &(f64, f64)| {
                let powers = polynomial.iter().rev();
                g * powers.fold(0.0, |sum, factor| sum * z + factor)
            };
            Some(rows.iter().map(at).collect())
        };
        let none = || vec![f64::NAN; rows.len()];
        let value = weights(0, 1).or_else(|| weights(0, 0));
        let first = weights(1, 2).or_else(|| weights(1, 1));
        Kernel {
            rows: start..end,
            value: value.unwrap_or_else(none),
            first: first.unwrap_or_else(none),
            second: weights(2, 2).unwrap_or_else(none),
        }
    }

    /// Where a signal jumps by 1, what its kernel makes of it and what the curvature of its second
    /// integral is differ by at most this; it jumps only after rows that `may_jump`.
    pub(super) fn jump_share(&self, time_s: &[f64], may_jump: impl Fn(usize) -> bool) -> f64 {
        // Of a jump at a time after a row and not after the next.
        let difference = |(row, at_s): (usize, f64)| {
            let weights = self.value.iter().zip(&self.second);
            let rows = weights.zip(&time_s[self.rows.clone()]);
            let after = rows.skip(row + 1 - self.rows.start);
            let of = |((value, second), t): ((&f64, &f64), &f64)| {
                value - second * 0.5 * (t - at_s).powi(2)
            };
            after.map(of).sum::<f64>().abs()
        };
        let last = self.rows.end - 1;
        let jumps = (self.rows.start..last).filter(|row| may_jump(*row));
        // Between two rows it is a parabola in the place of the jump.
        let places = jumps.flat_map(|row| {
            let (from_s, length_s) = (time_s[row], time_s[row + 1] - time_s[row]);
            let at_s = move |n| from_s + length_s * f64::from(n) / f64::from(JUMPS);
            (0..=JUMPS).map(move |n| (row, at_s(n)))
        });
        places.map(difference).fold(0.0, f64::max)
    }

    /// The row in the middle.
    pub(super) fn middle(&self) -> usize {
        self.rows.start + self.rows.len() / 2
    }

    pub(super) fn value(&self, values: &[f64]) -> f64 {
        dot(&self.value, &values[self.rows.clone()])
    }

    pub(super) fn first(&self, values: &[f64]) -> f64 {
        dot(&self.first, &values[self.rows.clone()])
    }

    pub(super) fn second(&self, values: &[f64]) -> f64 {
        dot(&self.second, &values[self.rows.clone()])
    }
}

pub(super) fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

fn dot(weights: &[f64], values: &[f64]) -> f64 {
    weights
        .iter()
        .zip(values)
        .map(|(weight, value)| weight * value)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A force that jumps moves a mass by its second integral: the balance of both through the
    /// kernel is off by less than the share of the jump, and in one place by all of it.
    #[test]
    fn a_jump_is_off_by_its_share_at_most() {
        for (step_s, most) in [(0.01, 0.1), (0.05, 0.5)] {
            let time_s: Vec<f64> = (0..60).map(|row| step_s * f64::from(row)).collect();
            let at_s = time_s[30];
            let kernel = Kernel::at(&time_s, at_s, 0.04);
            let share = kernel.jump_share(&time_s, |_| true);
            let off = |n: u32| {
                let jump_s = at_s + step_s * (f64::from(n) / 100.0 - 3.0);
                let force = |t: &f64| if *t > jump_s { 1.0 } else { 0.0 };
                let way = |t: &f64| 0.5 * (t - jump_s).max(0.0).powi(2);
                let force: Vec<f64> = time_s.iter().map(force).collect();
                let way: Vec<f64> = time_s.iter().map(way).collect();
                (kernel.value(&force) - kernel.second(&way)).abs()
            };
            let largest = (0..600).map(off).fold(0.0, f64::max);
            assert!(
                (0.95 * share..share + 1e-9).contains(&largest),
                "{largest}, {share}"
            );
            assert!((0.01..most).contains(&share), "{share}");
            // Of the interval after row 30 alone.
            let one = kernel.jump_share(&time_s, |row| row == 30);
            let largest = (301..400).map(off).fold(0.0, f64::max);
            assert!(
                (0.95 * one..one + 1e-9).contains(&largest),
                "{largest}, {one}"
            );
        }
    }

    /// A swing of 6.8 Hz in rows of 50 ms, which look like one of 13.2 Hz as well: through a kernel
    /// as wide as the rows are apart its force is its curvature, but for the share of that mirror.
    #[test]
    fn a_swing_in_few_rows_keeps_its_balance() {
        let step_s = 0.05;
        let time_s: Vec<f64> = (0..60).map(|row| step_s * f64::from(row)).collect();
        let per_s = std::f64::consts::TAU * 6.8;
        let off = |width_s: f64, phase: f64| {
            let swing: Vec<f64> = time_s.iter().map(|t| (per_s * t + phase).cos()).collect();
            let force: Vec<f64> = swing.iter().map(|place| -per_s.powi(2) * place).collect();
            let kernel = Kernel::at(&time_s, 1.513, width_s);
            (kernel.value(&force) - kernel.second(&swing)) / per_s.powi(2)
        };
        let largest = |width_s: f64| {
            let phases = (0..60).map(|n| 0.1 * f64::from(n));
            phases
                .map(|phase| off(width_s, phase).abs())
                .fold(0.0, f64::max)
        };
        let mirror = |width_s: f64| {
            let per_s = std::f64::consts::TAU / step_s - per_s;
            (-0.5 * (per_s * width_s).powi(2)).exp()
        };
        let ratio = (13.2_f64 / 6.8).powi(2) - 1.0;
        assert!(
            largest(step_s) < 4.0 * ratio * mirror(step_s),
            "{}",
            largest(step_s)
        );
        assert!(largest(0.8 * step_s) > 10.0 * largest(step_s));
    }

    /// Rows of 10 ms about a width of as much, one of the outermost left out by a rounded time.
    #[test]
    fn curvature_and_slope_are_exact_where_the_rows_are_not_even() {
        let time_s: Vec<f64> = (0..40).map(|row| 0.01 * f64::from(row)).collect();
        let jitter = |t: &f64| t + 2e-3 * (77.0 * t).sin();
        for time_s in [time_s.clone(), time_s.iter().map(jitter).collect()] {
            for at_s in [0.2, 0.200_1, 0.204, 0.02] {
                let kernel = Kernel::at(&time_s, at_s, 0.01);
                let falls: Vec<f64> = time_s
                    .iter()
                    .map(|t| 0.1 - 2.0 * (t - at_s) + 3.0 * (t - at_s).powi(2))
                    .collect();
                assert!((kernel.first(&falls) + 2.0).abs() < 1e-9);
                assert!((kernel.second(&falls) - 6.0).abs() < 1e-7);
                // Smoothed as the others are.
                let away = kernel.value(&falls) - 0.1;
                assert!((0.0..6e-4).contains(&away), "{away}");
            }
        }
    }
}

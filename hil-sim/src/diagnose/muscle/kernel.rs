//! Smooth kernels: value, slope and curvature of a noisy signal.

use std::ops::Range;

/// The kernel reaches so many widths.
pub(super) const KERNEL_REACH: f64 = 4.0;

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
        let weights = |polynomial: fn(f64) -> f64, moment: i32, of: f64| -> Vec<f64> {
            let rows = (start..end).map(base);
            let mut weights: Vec<f64> = rows.clone().map(|(z, g)| polynomial(z) * g).collect();
            // Exact for constants, whatever the rows' times.
            if moment > 0 {
                let excess =
                    weights.iter().sum::<f64>() / rows.clone().map(|(_, g)| g).sum::<f64>();
                for (weight, (_, g)) in weights.iter_mut().zip(rows.clone()) {
                    *weight -= excess * g;
                }
            }
            let found: f64 = weights
                .iter()
                .zip(rows)
                .map(|(w, (z, _))| w * z.powi(moment))
                .sum();
            weights.iter().map(|weight| weight * of / found).collect()
        };
        Kernel {
            rows: start..end,
            value: weights(|_| 1.0, 0, 1.0),
            first: weights(|z| z, 1, 1.0 / width_s),
            second: weights(|z| z * z - 1.0, 2, 2.0 / (width_s * width_s)),
        }
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

//! The parameters of one form of an effect, fitted to rows that the common columns explain first.
//!
//! The span of a [`Signature`](super::signature::Signature) is made of examples. An effect that is
//! not linear in its parameters, such as a delay, lies between examples that were chosen beforehand
//! by more than the noise. Examples about fitted parameters contain it.

use super::least_squares::{Goal, Prior, Problem, Residuals, Slopes, at, minimize};
use super::rows::Rows;
use nalgebra::{DMatrix, DVector};

/// Step of the difference quotients, in a parameter's usual range.
const STEP: f64 = 0.01;
/// The middle of the usual range and its prior standard deviation.
const PRIOR: [f64; 2] = [0.5, 0.5];
/// How far a parameter may be from its usual range, in widths of it.
const BEYOND: f64 = 0.5;
const GOAL: Goal = Goal {
    relative: 1e-3,
    absolute: 0.1,
    evaluations: 12,
    certain: false,
};

/// Rows of one block, whitened, of which the common columns are projected out.
pub struct Projected<'a> {
    rows: &'a Rows,
    amplitude: f64,
    time_constant_s: f64,
    /// Orthonormal columns that span the common ones with their prior.
    common: DMatrix<f64>,
    residual: DVector<f64>,
}

impl<'a> Projected<'a> {
    /// Of `rows` with a process of `amplitude` bases and a time constant \[s\], and the `common`
    /// columns of this block, whose weights have unit prior variance.
    pub fn new(
        rows: &'a Rows,
        common: &[&[f64]],
        amplitude: f64,
        time_constant_s: f64,
    ) -> Projected<'a> {
        let count = rows.residual.len();
        let signals = DMatrix::from_fn(common.len(), count, |signal, row| common[signal][row]);
        let (whitened, _) = rows.whitened(signals, amplitude, time_constant_s);
        let mut with_prior = DMatrix::zeros(count + common.len(), common.len());
        with_prior
            .rows_mut(0, count)
            .copy_from(&whitened.transpose());
        with_prior
            .rows_mut(count, common.len())
            .fill_with_identity();
        let mut projected = Projected {
            rows,
            amplitude,
            time_constant_s,
            common: with_prior.qr().q(),
            residual: DVector::zeros(0),
        };
        projected.residual = projected.of(&rows.residual);
        projected
    }

    /// `values` of the rows, whitened, less what the common columns explain.
    fn of(&self, values: &[f64]) -> DVector<f64> {
        let signal = DMatrix::from_row_slice(1, values.len(), values);
        let (whitened, _) = self
            .rows
            .whitened(signal, self.amplitude, self.time_constant_s);
        let mut out = DVector::zeros(self.common.nrows());
        out.rows_mut(0, values.len())
            .copy_from(&whitened.transpose());
        &out - &self.common * self.common.tr_mul(&out)
    }
}

struct Fit<'a, F> {
    projected: &'a Projected<'a>,
    column: F,
}

impl<F: FnMut(&[f64]) -> Option<Vec<f64>>> Problem for Fit<'_, F> {
    fn residuals(&mut self, x: &DVector<f64>) -> Option<Residuals> {
        let column = (self.column)(x.as_slice())?;
        let left = &self.projected.residual - self.projected.of(&column);
        Some(Residuals::exact(left.iter().copied().collect()))
    }

    fn slopes(&mut self, x: &DVector<f64>, residuals: &Residuals) -> Option<Slopes> {
        // Towards the middle, so that it stays in the range.
        let step = |x: f64| if x > PRIOR[0] { -STEP } else { STEP };
        Slopes::by_differences(x, residuals, step, |moved| self.residuals(moved))
    }

    fn priors(&self, x: &DVector<f64>) -> Vec<Prior> {
        let [middle, sigma] = PRIOR;
        x.iter()
            .map(|x| ((x - middle) / sigma, sigma.recip()))
            .collect()
    }

    fn bounded(&self, x: DVector<f64>) -> DVector<f64> {
        x.map(|x| x.clamp(-BEYOND, 1.0 + BEYOND))
    }
}

/// Places of the parameters in their usual ranges, from 0 to 1, at which `column` explains the rows
/// best, and the cost: found from the best of `starts` on. `None` if `column` has no value at any.
pub fn fitted_places(
    projected: &Projected,
    starts: &[Vec<f64>],
    column: impl FnMut(&[f64]) -> Option<Vec<f64>>,
) -> Option<(Vec<f64>, f64)> {
    let mut fit = Fit { projected, column };
    let begun = starts
        .iter()
        .filter_map(|start| at(&mut fit, DVector::from_column_slice(start)));
    let begun = begun.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    let found = minimize(&mut fit, begun.x, GOAL)?;
    Some((found.x.iter().copied().collect(), found.cost))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sine that is late by 0.37 periods of the usual range, beside a common column of any size.
    #[test]
    fn a_delay_between_the_starts_is_found() {
        let time_s: Vec<f64> = (0..2000).map(|row| 0.01 * f64::from(row)).collect();
        let wave = |late: f64| -> Vec<f64> {
            let value = |t: &f64| 50.0 * ((3.0 * t - late).sin() - (3.0 * t).sin());
            time_s.iter().map(value).collect()
        };
        let common: Vec<f64> = time_s.iter().map(|t| (0.5 * t).cos()).collect();
        let residual = wave(0.37).iter().zip(&common).map(|(a, b)| a + b).collect();
        let rows = Rows {
            begins: (0..time_s.len()).map(|row| row == 0).collect(),
            residual,
            base: vec![0.3; time_s.len()],
            in_process: vec![true; time_s.len()],
            time_s: time_s.clone(),
        };
        let projected = Projected::new(&rows, &[&common], 1.0, 0.1);
        let starts = [vec![0.1], vec![0.9]];
        let (places, cost) =
            fitted_places(&projected, &starts, |places| Some(wave(places[0]))).expect("a fit");
        assert!((places[0] - 0.37).abs() < 1e-3, "{places:?}");
        // What is left is the prior: of the common column's weight, ½, and of the place.
        assert!(cost < 1.0, "{cost}");
    }
}

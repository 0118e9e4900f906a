//! Rows of residuals in time, and the process that a model which is not exact leaves in them.

use nalgebra::DMatrix;

/// When the residuals of a block over a record were measured, and how far they may be off in a
/// sound rig.
#[derive(Clone, Debug, Default)]
pub struct Timeline {
    /// Time of each residual \[s\], ascending where `base` is not 0.
    pub time_s: Vec<f64>,
    /// RMS that the nominal model of a sound rig may leave, in units of the residual's noise; 0 for
    /// a residual that is a prior or a reading, and has no part in the process.
    pub base: Vec<f64>,
}

/// The rows of one block over all records.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    /// Time of each row \[s\].
    pub(crate) time_s: Vec<f64>,
    /// Whether the row begins a record, of whose process the one before tells nothing.
    pub(crate) begins: Vec<bool>,
    /// Standard deviation of the row's white noise.
    pub(crate) deviation: Vec<f64>,
    /// RMS of the process of amplitude 1.
    pub(crate) base: Vec<f64>,
    /// How many residuals were left out, as those that are here tell what they do.
    pub(crate) left_out: usize,
}

impl Rows {
    /// The first of them.
    pub(crate) fn first(&self, count: usize) -> Rows {
        let of = |values: &[f64]| values[..count].to_vec();
        Rows {
            time_s: of(&self.time_s),
            begins: self.begins[..count].to_vec(),
            deviation: of(&self.deviation),
            base: of(&self.base),
            left_out: 0,
        }
    }

    /// `values`, a column for each row, whitened, and half the log determinant of the covariance:
    /// of white noise and an Ornstein–Uhlenbeck process of this amplitude, in bases, by a scalar
    /// Kalman filter.
    pub(crate) fn whitened(
        &self,
        mut values: DMatrix<f64>,
        amplitude: f64,
        time_constant_s: f64,
    ) -> (DMatrix<f64>, f64) {
        let stationary = amplitude * amplitude;
        let mut expected = vec![0.0; values.nrows()];
        let (mut variance, mut half_log_determinant) = (stationary, 0.0);
        let mut last_s = 0.0;
        for row in 0..values.ncols() {
            if self.begins[row] {
                expected.fill(0.0);
                variance = stationary;
            } else if self.base[row] > 0.0 {
                let kept = (-(self.time_s[row] - last_s).max(0.0) / time_constant_s).exp();
                expected.iter_mut().for_each(|value| *value *= kept);
                variance = kept * kept * variance + stationary * (1.0 - kept * kept);
            }
            let gain = self.base[row];
            if gain > 0.0 {
                last_s = self.time_s[row];
            }
            let innovation = gain * gain * variance + self.deviation[row].powi(2);
            half_log_determinant += 0.5 * innovation.ln();
            let per_deviation = innovation.sqrt().recip();
            let correction = gain * variance / innovation;
            for (value, expected) in values.column_mut(row).iter_mut().zip(&mut expected) {
                let difference = *value - gain * *expected;
                *value = difference * per_deviation;
                *expected += correction * difference;
            }
            variance *= 1.0 - correction * gain;
        }
        (values, half_log_determinant)
    }
}

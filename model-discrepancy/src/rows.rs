//! What evidence is computed from: residuals, and columns that change them.

use nalgebra::DMatrix;

/// The rows of one block over all records.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Time of each row \[s\].
    pub time_s: Vec<f64>,
    /// Whether the row begins a record, of whose process the one before tells nothing.
    pub begins: Vec<bool>,
    /// What is measured less what the nominal model says, in units of the row's noise.
    pub residual: Vec<f64>,
    /// RMS that the nominal model of a sound rig may leave, in units of the row's noise.
    pub base: Vec<f64>,
    /// Whether the row has a part in the process that its block leaves.
    pub in_process: Vec<bool>,
}

/// A column over the rows of each block, in units of the rows' noise; empty where it changes none.
pub type Column = Vec<Vec<f64>>;

impl Rows {
    /// `values`, a column for each row, whitened, and half the log determinant of the covariance.
    pub(crate) fn whitened(
        &self,
        mut values: DMatrix<f64>,
        amplitude: f64,
        time_constant_s: f64,
    ) -> (DMatrix<f64>, f64) {
        let stationary = amplitude * amplitude;
        let mut expected = vec![0.0; values.nrows()];
        let (mut variance, mut half_log_determinant) = (stationary, 0.0);
        for row in 0..values.ncols() {
            if row > 0 {
                let passed_s = self.time_s[row] - self.time_s[row - 1];
                let kept = if self.begins[row] {
                    0.0
                } else {
                    (-passed_s / time_constant_s).exp()
                };
                expected.iter_mut().for_each(|value| *value *= kept);
                variance = kept * kept * variance + stationary * (1.0 - kept * kept);
            }
            let gain = if self.in_process[row] {
                self.base[row]
            } else {
                0.0
            };
            let innovation = gain * gain * variance + 1.0;
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

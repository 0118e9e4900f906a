//! The span in which the free shape of an effect lies.

use super::rows::{Column, Rows};
use nalgebra::{DMatrix, SymmetricEigen};

/// Largest number of columns of a signature.
const RANK: usize = 8;
/// A principal component with less than this share of the variance of the first is left out.
const VARIANCE_MIN: f64 = 1e-6;
/// Every so many rows determine the principal components.
const STRIDE: usize = 5;
/// RMS of an example, in units of the base, below which it shows nothing.
const RMS_MIN: f64 = 1e-6;

/// An effect of which a signature is made.
#[derive(Clone, Copy, Debug)]
pub struct EffectTraits {
    /// Its name.
    pub effect: &'static str,
    /// It occurs with either sign. Otherwise it has the sign of its examples.
    pub signed: bool,
    /// Its name determines its law, so that the examples span it exactly.
    pub exact: bool,
}

/// The space of residuals that an effect can cause, whichever law it has.
#[derive(Clone, Debug)]
pub struct Signature {
    /// The effect.
    pub of: EffectTraits,
    /// Columns with independent weights of equal prior variance.
    pub columns: Vec<Column>,
    /// Inner products of the columns with the mean of the examples.
    pub mean: Vec<f64>,
    /// Logarithm of the share of its prior that the examples stand for: 0 unless they were made
    /// about fitted parameters.
    pub log_prior: f64,
}

impl Signature {
    /// The principal components of examples, which are columns of the effect in some of its laws:
    /// the first `plain` as they are, then variations of them. `None` if no plain example changes a
    /// row of `blocks`.
    ///
    /// All examples have equal weight, whatever their size. The weights of the components with unit
    /// variance make an effect with the RMS of the base.
    pub fn new(
        of: EffectTraits,
        examples: &[Column],
        plain: usize,
        blocks: &[Rows],
    ) -> Option<Signature> {
        let scaled: Vec<Vec<f64>> = examples
            .iter()
            .map(|column| in_bases(column, blocks))
            .collect();
        let norm = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>().sqrt();
        let norms: Vec<f64> = scaled.iter().map(|values| norm(values)).collect();
        let shows = |number: &usize| norms[*number].is_finite() && norms[*number] > RMS_MIN;
        let kept: Vec<usize> = (0..examples.len()).filter(shows).collect();
        let plain = kept.iter().filter(|number| **number < plain).count();
        if plain == 0 {
            return None;
        }
        let rows = scaled[kept[0]].len();
        let matrix = DMatrix::from_fn(rows, kept.len(), |row, place| {
            scaled[kept[place]][row] / norms[kept[place]]
        });
        let count = kept.len() as f64;
        let eigen = SymmetricEigen::new(matrix.tr_mul(&matrix) / count);
        let mut order: Vec<usize> = (0..kept.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let least = VARIANCE_MIN * eigen.eigenvalues[order[0]];
        order.truncate(RANK);
        order.retain(|place| eigen.eigenvalues[*place] > least);
        let mut signature = Signature {
            of,
            columns: Vec::new(),
            mean: Vec::new(),
            log_prior: 0.0,
        };
        for place in order {
            let shares = eigen.eigenvectors.column(place) / count.sqrt();
            let factors = kept.iter().zip(shares.iter());
            let factors = factors.map(|(number, share)| (*number, share / norms[*number]));
            signature
                .columns
                .push(combination(examples, factors, blocks.len()));
            let inner = matrix.columns(0, plain).tr_mul(&(&matrix * &shares)).sum();
            signature.mean.push(inner / plain as f64);
        }
        Some(signature)
    }
}

/// Some rows of a column, in units of the base, so that their norm is an RMS.
fn in_bases(column: &Column, blocks: &[Rows]) -> Vec<f64> {
    let mut out = Vec::new();
    for (values, rows) in column.iter().zip(blocks) {
        let used = rows.base.iter().enumerate().step_by(STRIDE);
        let per_count = (used.len() as f64).sqrt().recip();
        let value = |row: usize| values.get(row).copied().unwrap_or(0.0);
        out.extend(used.map(|(row, base)| value(row) / base * per_count));
    }
    out
}

/// The sum of examples with factors.
fn combination(
    examples: &[Column],
    factors: impl Iterator<Item = (usize, f64)>,
    blocks: usize,
) -> Column {
    let mut sum: Column = vec![Vec::new(); blocks];
    for (number, factor) in factors {
        for (own, values) in sum.iter_mut().zip(&examples[number]) {
            own.resize(values.len().max(own.len()), 0.0);
            for (own, value) in own.iter_mut().zip(values) {
                *own += factor * value;
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: u32) -> Rows {
        Rows {
            time_s: (0..count).map(|row| 0.01 * f64::from(row)).collect(),
            begins: (0..count).map(|row| row == 0).collect(),
            residual: vec![0.0; count as usize],
            base: vec![0.5; count as usize],
            in_process: vec![true; count as usize],
        }
    }

    fn sine(times: f64, size: f64) -> Column {
        vec![
            (0..1000)
                .map(|row| size * (times * 0.01 * f64::from(row)).sin())
                .collect(),
        ]
    }

    const TRAITS: EffectTraits = EffectTraits {
        effect: "any",
        signed: false,
        exact: false,
    };

    #[test]
    fn examples_lie_in_the_span_whatever_their_size() {
        let examples = [sine(3.0, 1.0), sine(5.0, 1e-3), sine(7.0, 1e3)];
        let signature = Signature::new(TRAITS, &examples, 3, &[rows(1000)]).expect("a signature");
        let columns: Vec<&[f64]> = signature.columns.iter().map(|c| &c[0][..]).collect();
        assert_eq!(columns.len(), 3);
        let matrix = DMatrix::from_fn(1000, 3, |row, column| columns[column][row]);
        for example in &examples {
            let target = DMatrix::from_column_slice(1000, 1, &example[0]);
            let normal = matrix
                .tr_mul(&matrix)
                .try_inverse()
                .expect("independent columns");
            let left = &target - &matrix * normal * matrix.tr_mul(&target);
            assert!(left.norm() < 1e-6 * target.norm());
        }
    }

    /// Unit variance of each weight makes the RMS of the base: the mean square over the rows is the
    /// sum of the mean squares of the columns.
    #[test]
    fn weights_are_in_units_of_the_base() {
        let examples = [sine(3.0, 20.0), sine(4.0, 0.1)];
        let signature = Signature::new(TRAITS, &examples, 2, &[rows(1000)]).expect("a signature");
        let square: f64 = signature
            .columns
            .iter()
            .flat_map(|c| &c[0])
            .map(|v| v * v)
            .sum();
        let base_square = 1000.0 * 0.5 * 0.5;
        // Every fifth row of a few periods: sums over them differ by a few percent.
        assert!(
            (square / base_square - 1.0).abs() < 0.05,
            "{}",
            square / base_square
        );
    }

    #[test]
    fn what_changes_nothing_has_no_signature() {
        let nothing = vec![Vec::new()];
        assert!(Signature::new(TRAITS, &[nothing, sine(3.0, 0.0)], 2, &[rows(1000)]).is_none());
    }
}

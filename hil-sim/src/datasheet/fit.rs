//! Linear least squares with standard deviations that hold if neighbouring points share an error.

use nalgebra::{DMatrix, DVector};

/// Columns that are equal to this share cannot be told from each other.
const RANK_RATIO: f64 = 1e-6;

/// Coefficients of a linear law, and how well the points determine them.
#[derive(Clone, Debug)]
pub(super) struct Fit<const N: usize> {
    /// The coefficients.
    pub values: [f64; N],
    /// Their standard deviations.
    pub sigmas: [f64; N],
    /// Root mean square of the residuals.
    pub rms: f64,
}

/// The coefficients that fit `y` = Σ coefficient · column of `rows`.
///
/// A law that is not exact leaves residuals that are alike along a curve of a table. Each of
/// `groupings` gives the group of each row; the standard deviation of a coefficient is the largest
/// of those by a jackknife over the groups of one of them. `None` if the rows do not determine the
/// coefficients.
pub(super) fn fit<const N: usize>(
    rows: &[[f64; N]],
    y: &[f64],
    groupings: &[Vec<u64>],
) -> Option<Fit<N>> {
    let values = solve(rows, y)?;
    let squares = rows.iter().zip(y).map(|(row, y)| {
        let fitted: f64 = row.iter().zip(&values).map(|(a, b)| a * b).sum();
        (y - fitted).powi(2)
    });
    let rms = (squares.sum::<f64>() / y.len() as f64).sqrt();
    let mut sigmas = [0.0_f64; N];
    for groups in groupings {
        for (sigma, here) in sigmas.iter_mut().zip(jackknife(rows, y, groups, &values)) {
            *sigma = sigma.max(here);
        }
    }
    Some(Fit {
        values,
        sigmas,
        rms,
    })
}

/// Standard deviations by leaving out one group after the other; 0 if no coefficients are left
/// without a group.
fn jackknife<const N: usize>(
    rows: &[[f64; N]],
    y: &[f64],
    groups: &[u64],
    values: &[f64; N],
) -> [f64; N] {
    let mut names = groups.to_vec();
    names.sort_unstable();
    names.dedup();
    let without = |name: &u64| {
        let kept = || (0..y.len()).filter(|row| groups[*row] != *name);
        let rows: Vec<_> = kept().map(|row| rows[row]).collect();
        solve(&rows, &kept().map(|row| y[row]).collect::<Vec<_>>())
    };
    let fits: Vec<[f64; N]> = names.iter().filter_map(without).collect();
    let count = fits.len() as f64;
    std::array::from_fn(|place| {
        let squares = fits.iter().map(|fit| (fit[place] - values[place]).powi(2));
        ((count - 1.0).max(0.0) / count.max(1.0) * squares.sum::<f64>()).sqrt()
    })
}

fn solve<const N: usize>(rows: &[[f64; N]], y: &[f64]) -> Option<[f64; N]> {
    if rows.len() < N {
        return None;
    }
    let mut matrix = DMatrix::from_fn(rows.len(), N, |row, column| rows[row][column]);
    // Columns of one size, so that the rank does not depend on units.
    let sizes: Vec<f64> = matrix.column_iter().map(|column| column.norm()).collect();
    for (mut column, size) in matrix.column_iter_mut().zip(&sizes) {
        column /= *size;
    }
    let svd = matrix.svd(true, true);
    let largest = svd.singular_values.max();
    if svd.rank(RANK_RATIO * largest) < N {
        return None;
    }
    let solution = svd.solve(&DVector::from_column_slice(y), 0.0).ok()?;
    Some(std::array::from_fn(|place| solution[place] / sizes[place]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64Mcg;

    /// y = 3 + 2 x.
    fn line(x: &[f64]) -> Vec<f64> {
        x.iter().map(|x| 3.0 + 2.0 * x).collect()
    }

    #[test]
    fn an_exact_law_is_found_exactly() {
        let x = [0.0, 1.0, 2.0, 5.0];
        let rows = x.map(|x| [1.0, x]);
        let fit = fit(&rows, &line(&x), &[(0..4).collect()]).expect("determined");
        for (value, expected) in fit.values.iter().zip([3.0, 2.0]) {
            assert!((value - expected).abs() < 1e-12);
        }
        assert!(fit.rms < 1e-12 && fit.sigmas.iter().all(|sigma| *sigma < 1e-12));
    }

    #[test]
    fn columns_that_cannot_be_told_apart_are_no_fit() {
        let rows = [[1.0, 2.0], [1.0, 2.0], [1.0, 2.0]];
        assert!(fit(&rows, &[1.0, 2.0, 3.0], &[]).is_none());
        assert!(fit(&rows[..1], &[1.0], &[]).is_none());
    }

    /// Errors that the five points of a group share: the mean of six groups is uncertain by
    /// 1/√6 = 0.41, not by the 1/√30 = 0.18 of independent points. The mean over 200 draws of the
    /// squared standard deviation is within 20 % (its scatter is √(2/5)/√200 = 4.5 %).
    #[test]
    fn shared_errors_widen_the_standard_deviation() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let normal = Normal::new(0.0, 1.0).expect("a deviation");
        let groups: Vec<u64> = (0..30).map(|row| row / 5).collect();
        let mut variance = 0.0;
        for _ in 0..200 {
            let shared: Vec<f64> = (0..6).map(|_| normal.sample(&mut random)).collect();
            let y: Vec<f64> = groups.iter().map(|group| shared[*group as usize]).collect();
            let fit = fit(&[[1.0]; 30], &y, &[groups.clone(), (0..30).collect()]);
            variance += fit.expect("determined").sigmas[0].powi(2) / 200.0;
        }
        assert!((variance * 6.0 - 1.0).abs() < 0.2, "{variance}");
    }
}

//! Linear least squares with standard deviations that hold if neighbouring points share an error.

use nalgebra::{DMatrix, DVector};

/// Columns that are equal to this share cannot be told from each other.
const RANK_RATIO: f64 = 1e-6;
/// Values within this share of the range of all belong to one curve: measured ones scatter by less,
/// and the lines of a diagram are further apart.
const NEAR_RATIO: f64 = 0.02;

/// Coefficients of a linear law, and how well the points determine them.
#[derive(Clone, Debug)]
pub(super) struct Fit<const N: usize> {
    /// The coefficients.
    pub values: [f64; N],
    /// Their standard deviations; `None` if the rows do not tell.
    pub sigmas: Option<[f64; N]>,
    /// Root mean square of the residuals.
    pub rms: f64,
}

/// The coefficients that fit `y` = Σ coefficient · column of `rows`.
///
/// A law that is not exact leaves residuals that are alike along a curve of a table. Each of
/// `groupings` gives the group of each row; the standard deviation of a coefficient is the largest
/// of those by a jackknife over the groups of one of them. A group without which the rows do not
/// determine the coefficients matters most, and leaves no standard deviation. `None` if all rows do
/// not determine the coefficients.
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
    let mut sigmas = (!groupings.is_empty()).then_some([0.0_f64; N]);
    for groups in groupings {
        let here = jackknife(rows, y, groups, &values);
        sigmas = sigmas
            .zip(here)
            .map(|(known, here)| std::array::from_fn(|place| known[place].max(here[place])));
    }
    Some(Fit {
        values,
        sigmas,
        rms,
    })
}

/// The group of each value: values within a small share of the range of all are of one group.
pub(super) fn groups(values: &[f64]) -> Vec<u64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let ends = order.first().zip(order.last());
    let width = ends.map_or(0.0, |(first, last)| {
        NEAR_RATIO * (values[*last] - values[*first])
    });
    let mut groups = vec![0; values.len()];
    let (mut group, mut smallest) = (0, f64::NEG_INFINITY);
    for place in order {
        if values[place] - smallest > width {
            group += 1;
            smallest = values[place];
        }
        groups[place] = group;
    }
    groups
}

/// Standard deviations by leaving out one group after the other; `None` if the rows without a group
/// do not determine the coefficients.
fn jackknife<const N: usize>(
    rows: &[[f64; N]],
    y: &[f64],
    groups: &[u64],
    values: &[f64; N],
) -> Option<[f64; N]> {
    let mut names = groups.to_vec();
    names.sort_unstable();
    names.dedup();
    let without = |name: &u64| {
        let kept = || (0..y.len()).filter(|row| groups[*row] != *name);
        let rows: Vec<_> = kept().map(|row| rows[row]).collect();
        solve(&rows, &kept().map(|row| y[row]).collect::<Vec<_>>())
    };
    let fits: Vec<[f64; N]> = names.iter().map(without).collect::<Option<_>>()?;
    let count = fits.len() as f64;
    Some(std::array::from_fn(|place| {
        let squares = fits.iter().map(|fit| (fit[place] - values[place]).powi(2));
        ((count - 1.0) / count * squares.sum::<f64>()).sqrt()
    }))
}

fn solve<const N: usize>(rows: &[[f64; N]], y: &[f64]) -> Option<[f64; N]> {
    if rows.len() < N {
        return None;
    }
    let mut matrix = DMatrix::from_fn(rows.len(), N, |row, column| rows[row][column]);
    // Columns of one size, so that the rank does not depend on units.
    let sizes: Vec<f64> = matrix.column_iter().map(|column| column.norm()).collect();
    // A column of zeros has no coefficient.
    if !sizes.iter().all(|size| *size > 0.0 && size.is_finite()) {
        return None;
    }
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
        let sigmas = fit.sigmas.expect("every row can be left out");
        assert!(fit.rms < 1e-12 && sigmas.iter().all(|sigma| *sigma < 1e-12));
    }

    #[test]
    fn a_column_of_zeros_is_no_fit() {
        let rows = [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]];
        assert!(fit(&rows, &[1.0, 2.0, 3.0], &[]).is_none());
    }

    /// Without the last row the second column is 0; without the first group it is constant.
    #[test]
    fn a_group_that_cannot_be_left_out_leaves_no_standard_deviation() {
        let x = [0.0, 0.0, 0.0, 1.0];
        let rows = x.map(|x| [1.0, x]);
        let alone = (0..4).collect();
        let fitted = fit(&rows, &line(&x), &[alone]).expect("determined");
        assert!((fitted.values[1] - 2.0).abs() < 1e-12);
        assert_eq!(fitted.sigmas, None);
        // Neither does a grouping that can be left out help.
        let x = [0.0, 0.5, 1.0, 2.0];
        let rows = x.map(|x| [1.0, x]);
        let groupings = [(0..4).collect(), vec![0; 4]];
        let fitted = fit(&rows, &line(&x), &groupings[..1]).expect("determined");
        assert!(fitted.sigmas.is_some());
        let fitted = fit(&rows, &line(&x), &groupings).expect("determined");
        assert_eq!(fitted.sigmas, None);
    }

    #[test]
    fn values_that_scatter_are_one_group() {
        let pressures_bar = [2.003, 1.0, 2.001, 3.002, 1.02, 3.0, 1.998];
        let found = groups(&pressures_bar);
        assert_eq!(found, [2, 1, 2, 3, 1, 3, 2]);
        // A fine diagram keeps its lines, and a sweep is several groups.
        let contractions: Vec<f64> = (0..41).map(|step| 0.01 * f64::from(step)).collect();
        assert_eq!(groups(&contractions), (1..=41).collect::<Vec<_>>());
        let sweep: Vec<f64> = (0..1000).map(f64::from).collect();
        let last = groups(&sweep).last().copied();
        assert!((40..=50).contains(&last.expect("groups")), "{last:?}");
        assert_eq!(groups(&[2.0, 2.0]), [1, 1]);
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
            variance += fit.expect("determined").sigmas.expect("groups")[0].powi(2) / 200.0;
        }
        assert!((variance * 6.0 - 1.0).abs() < 0.2, "{variance}");
    }
}

//! Shares and medians with their 95 % intervals.

use serde::Serialize;

/// The normal distribution's 97.5 % quantile.
const Z_95: f64 = 1.959_963_985;

/// A share of cases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Rate {
    /// How many did.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
    /// Their ratio.
    pub value: Option<f64>,
    /// Wilson's score interval.
    pub ci95: Option<[f64; 2]>,
}

impl Rate {
    /// `hits` of `of`.
    pub fn new(hits: usize, of: usize) -> Rate {
        if of == 0 {
            return Rate::default();
        }
        let (n, share) = (of as f64, hits as f64 / of as f64);
        let centre = share + Z_95 * Z_95 / (2.0 * n);
        let half = Z_95 * (share * (1.0 - share) / n + (Z_95 / (2.0 * n)).powi(2)).sqrt();
        let scale = 1.0 + Z_95 * Z_95 / n;
        // rounding may leave the ends beyond a share that is 0 or 1
        let low = ((centre - half) / scale).clamp(0.0, share);
        let high = ((centre + half) / scale).clamp(share, 1.0);
        Rate {
            hits,
            of,
            value: Some(share),
            ci95: Some([low, high]),
        }
    }

    /// The share of `items` that `hit`.
    pub fn among<T>(items: impl IntoIterator<Item = T>, hit: impl Fn(&T) -> bool) -> Rate {
        let (mut hits, mut of) = (0, 0);
        for item in items {
            hits += usize::from(hit(&item));
            of += 1;
        }
        Rate::new(hits, of)
    }
}

/// The middle of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Median {
    /// Of how many.
    pub of: usize,
    /// The median.
    pub value: Option<f64>,
    /// Its interval from the order statistics, for any distribution; none of fewer than six.
    pub ci95: Option<[f64; 2]>,
}

impl Median {
    /// The median of `values`.
    pub fn new(values: impl IntoIterator<Item = f64>) -> Median {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let of = sorted.len();
        let rank = (of as f64 / 2.0 - Z_95 * (of as f64).sqrt() / 2.0).floor();
        let ci95 = (of >= 6).then(|| {
            let low = rank.max(0.0) as usize;
            [sorted[low], sorted[of - 1 - low]]
        });
        Median {
            of,
            value: quantile(&sorted, 0.5),
            ci95,
        }
    }
}

/// The `share` quantile of `sorted`, between neighbours by a line.
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = share * last as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    Some(sorted[low] + (place - place.floor()) * (sorted[high] - sorted[low]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_intervals_equal_published_values() {
        // Agresti & Coull 1998: none of 10 and 15 of 20
        let none = Rate::new(0, 10).ci95.expect("ten");
        assert!(none[0] == 0.0 && (none[1] - 0.2775).abs() < 1e-4);
        let most = Rate::new(15, 20).ci95.expect("twenty");
        assert!((most[0] - 0.5313).abs() < 1e-4 && (most[1] - 0.8881).abs() < 1e-4);
        assert_eq!(Rate::new(0, 0).value, None);
        assert_eq!(Rate::among([1, 2, 3, 4], |n| *n > 1), Rate::new(3, 4));
    }

    #[test]
    fn the_interval_of_a_median_is_from_order_statistics() {
        let median = Median::new((0..101).rev().map(f64::from));
        assert_eq!(median.value, Some(50.0));
        assert_eq!(median.ci95, Some([40.0, 60.0]));
        assert_eq!(Median::new([2.0, 1.0]).value, Some(1.5));
        assert_eq!(Median::new([2.0, 1.0]).ci95, None);
        assert_eq!(Median::new([]).value, None);
    }
}

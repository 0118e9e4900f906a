//! Reliability diagrams: probabilities compared with relative frequencies.

use serde::Serialize;

/// Bins of equal width.
const BINS: usize = 10;

/// Probabilities of one bin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bin {
    /// Their number.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// Share of them that is right.
    pub right: f64,
}

/// A reliability diagram.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Reliability {
    /// Bins from 0 to 1.
    pub bins: Vec<Bin>,
    /// Expected calibration error: mean of |right − mean| over all probabilities, each with its
    /// bin's (Guo et al. 2017); `None` without probabilities.
    pub error: Option<f64>,
}

impl Reliability {
    /// The diagram of probabilities, each with whether its event is true.
    pub fn of(probabilities: impl IntoIterator<Item = (f64, bool)>) -> Reliability {
        let mut sums = [(0_usize, 0.0, 0_usize); BINS];
        for (probability, right) in probabilities {
            let place = ((probability * BINS as f64) as usize).min(BINS - 1);
            sums[place].0 += 1;
            sums[place].1 += probability;
            sums[place].2 += usize::from(right);
        }
        let bins = sums.map(|(count, sum, right)| {
            let of = count.max(1) as f64;
            Bin {
                count,
                mean: sum / of,
                right: right as f64 / of,
            }
        });
        let count: usize = bins.iter().map(|bin| bin.count).sum();
        let off = bins
            .iter()
            .map(|bin| bin.count as f64 * (bin.right - bin.mean).abs());
        let error = (count > 0).then(|| off.sum::<f64>() / count as f64);
        Reliability {
            bins: bins.into(),
            error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_is_the_mean_distance_of_bins_from_the_diagonal() {
        // of four with 0.95 three are right, of two with 0.25 one
        let sure = [true, true, true, false].map(|right| (0.95, right));
        let unsure = [(0.25, true), (0.25, false)];
        let reliability = Reliability::of(sure.into_iter().chain(unsure));
        assert_eq!(reliability.bins[9].count, 4);
        assert!((reliability.bins[9].right - 0.75).abs() < 1e-12);
        let expected = (4.0 * 0.2 + 2.0 * 0.25) / 6.0;
        assert!((reliability.error.expect("some") - expected).abs() < 1e-12);
    }

    #[test]
    fn certainty_is_in_the_last_bin_and_nothing_has_no_error() {
        assert_eq!(Reliability::of([(1.0, true)]).bins[9].count, 1);
        assert_eq!(Reliability::of([(1.0, true)]).error, Some(0.0));
        assert_eq!(Reliability::of([]).error, None);
    }
}

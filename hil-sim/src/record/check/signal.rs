//! Statistics of one column's samples.

use super::Finding;
use crate::record::PRESSURE_REF_PA;
use serde::Serialize;

/// A signal changes if its range exceeds this many standard deviations of the noise: white noise
/// alone has a smaller range over some 10⁸ samples.
const NOISE_SPAN: f64 = 12.0;
/// Least size of a step and of the return after a reversal, as a share of the range: 5 % is visible
/// in a plot.
const PROMINENT: f64 = 0.05;
/// A signal within this share of its range is held.
const HELD: f64 = 0.02;
/// Number of differences in one estimate of the noise: at 20 Hz, a second of rest.
const NOISE_STRETCH: usize = 20;
/// The quantile of the estimates that is taken, as some tenth of a record is quiet, and what it is
/// for white noise as a share of the noise's variance: by simulation, which a test repeats.
const QUIET: f64 = 0.1;
const QUIET_VARIANCE: f64 = 0.476;
/// Longest duration of a step \[s\]: a valve lags by tens of milliseconds, and the board limits the
/// rate of its reference.
const STEP_S: f64 = 0.05;
/// Rates and holds are determined from means over this time \[s\], which average out noise.
const PIECE_S: f64 = 0.1;
/// The quantile of the rates that is reported.
const RATE_SHARE: f64 = 0.95;
/// Number of consecutive samples at the exact extreme that do not occur by chance if the noise is
/// at least half a sensor step: then the most likely value has a probability of 0.68 at most.
const PLATEAU: usize = 50;
const DITHER: f64 = 0.5;
/// Least height of a spike, in standard deviations of the noise and in changes of the samples
/// around it.
const SPIKE: f64 = 10.0;
const SPIKE_ALONE: f64 = 4.0;

/// Statistics of one column, in its unit.
#[derive(Clone, Debug, Serialize)]
pub struct Signal {
    /// The column.
    pub name: &'static str,
    /// Number of cells with a sample.
    pub samples: usize,
    /// Number of cells without a sample.
    pub missing: usize,
    /// The longest time between two samples \[s\].
    pub longest_gap_s: f64,
    /// The smallest sample.
    pub min: f64,
    /// The largest sample.
    pub max: f64,
    /// Standard deviation of the noise, from squared third differences where they are smallest: a
    /// smooth signal contributes little to them there. At least the rounding error, quantum/√12.
    pub noise: f64,
    /// Step of the sensor, if values repeat.
    pub quantum: Option<f64>,
    /// 95 % quantile of the rates of change over a tenth of a second \[1/s\].
    pub rate_per_s: f64,
    /// Number of changes by 5 % of the range within 50 ms, or to the next sample.
    pub steps: usize,
    /// Number of changes of direction that are followed by 5 % of the range.
    pub reversals: usize,
    /// Longest time within 2 % of the range, or within the noise \[s\].
    pub longest_hold_s: f64,
}

/// The samples of a column, without missing ones.
struct Samples {
    time_s: Vec<f64>,
    values: Vec<f64>,
}

impl Signal {
    /// The statistics of `values`, NaN where one is missing, of which at least one is present. Adds
    /// findings to `warnings`.
    pub(super) fn of(
        name: &'static str,
        time_s: &[f64],
        values: &[f64],
        warnings: &mut Vec<Finding>,
    ) -> Signal {
        let present = time_s
            .iter()
            .zip(values)
            .filter(|(_, value)| !value.is_nan());
        let (time_s, present): (Vec<f64>, Vec<f64>) = present.unzip();
        let missing = values.len() - present.len();
        let samples = Samples {
            time_s,
            values: present,
        };
        let (min, max) = extremes(&samples.values);
        let (step, repeats) = step_of(&samples.values);
        let mut noise = noise(&samples.values);
        for value in [min, max]
            .into_iter()
            .filter(|_| is_measured(name) && min < max)
        {
            let off = off_plateaus(&samples.values, value);
            let noise_off = self::noise(&off);
            let clipped = samples.values.len() - off.len();
            if clipped > 0 && noise_off > DITHER * step {
                warnings.push(Finding::Clipped {
                    signal: name,
                    value,
                    share: clipped as f64 / samples.values.len() as f64,
                });
                noise = noise_off.max(noise);
            }
        }
        // A command and a constant have no noise.
        let noise = match is_measured(name) && min < max {
            true => noise.max(step / 12.0_f64.sqrt()),
            false => 0.0,
        };
        let mut signal = Signal {
            name,
            samples: samples.values.len(),
            missing,
            longest_gap_s: differences(&samples.time_s).fold(0.0, f64::max),
            min,
            max,
            noise,
            quantum: repeats.then_some(step),
            rate_per_s: 0.0,
            steps: 0,
            reversals: 0,
            longest_hold_s: 0.0,
        };
        let prominent = (PROMINENT * signal.range()).max(NOISE_SPAN * noise);
        if signal.moves() {
            signal.steps = samples.steps(prominent);
        }
        signal.reversals = reversals(&samples.values, prominent);
        let pieces = samples.pieces();
        signal.rate_per_s = if min < max { pieces.rate_per_s() } else { 0.0 };
        signal.longest_hold_s =
            pieces.longest_hold_s((HELD * signal.range()).max(NOISE_SPAN * noise));
        signal.warn(&samples, warnings);
        signal
    }

    /// Adds the findings on this signal to `warnings`.
    fn warn(&self, samples: &Samples, warnings: &mut Vec<Finding>) {
        let signal = self.name;
        if self.missing > 0 {
            warnings.push(Finding::Missing {
                signal,
                share: self.missing as f64 / (self.missing + self.samples) as f64,
                longest_gap_s: self.longest_gap_s,
            });
        }
        // A command may be constant, at its limits or jump.
        if !is_measured(signal) {
            return;
        }
        if self.is_constant() {
            warnings.push(Finding::Constant {
                signal,
                value: self.min,
            });
            return;
        }
        if !self.moves() {
            warnings.push(Finding::Still { signal });
            return;
        }
        if let Some(quantum) = self.quantum
            && self.range() < super::STEPS_MIN * quantum
        {
            let steps = (self.range() / quantum).round();
            warnings.push(Finding::Coarse { signal, steps });
        }
        let spikes = spikes(&samples.values, SPIKE * self.noise);
        if let Some(first) = spikes.first() {
            warnings.push(Finding::Spikes {
                signal,
                count: spikes.len(),
                first_s: samples.time_s[*first],
            });
        }
    }

    /// Largest less smallest sample.
    pub fn range(&self) -> f64 {
        self.max - self.min
    }

    /// Whether all samples have the same value.
    pub fn is_constant(&self) -> bool {
        self.min == self.max
    }

    /// Whether the signal changes by more than its noise.
    pub fn moves(&self) -> bool {
        self.range() > NOISE_SPAN * self.noise
    }
}

fn extremes(values: &[f64]) -> (f64, f64) {
    let begin = (f64::INFINITY, f64::NEG_INFINITY);
    values.iter().fold(begin, |(min, max), value| {
        (min.min(*value), max.max(*value))
    })
}

fn differences(values: &[f64]) -> impl Iterator<Item = f64> {
    values.windows(2).map(|pair| pair[1] - pair[0])
}

/// The quantile of `values` at `share`; 0 if there are none.
pub(crate) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let place = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Standard deviation of white noise on a signal, from a low quantile over stretches of the mean
/// squared third difference: some stretches that are no smooth motion hardly raise it, and it is
/// not granular as a quantile over rounded samples would be. Where only half of the stretches are
/// smooth it is 12 % too large, as the quantile is then one of 20 %.
fn noise(values: &[f64]) -> f64 {
    let third = |v: &[f64]| (v[3] - 3.0 * v[2] + 3.0 * v[1] - v[0]).powi(2);
    let squares: Vec<f64> = values.windows(4).map(third).collect();
    let mean = |stretch: &[f64]| stretch.iter().sum::<f64>() / stretch.len() as f64;
    let whole = squares.chunks_exact(NOISE_STRETCH.min(squares.len().max(1)));
    let means: Vec<f64> = whole.map(mean).collect();
    if means.is_empty() {
        return 0.0;
    }
    // Third differences of white noise have the variance σ²(1 + 9 + 9 + 1).
    (quantile(means, QUIET) / (20.0 * QUIET_VARIANCE)).sqrt()
}

/// The sensor's step, and whether values repeat. If they do, the step is the 10 % quantile of the
/// changes from sample to sample (averaged and interpolated samples have smaller changes);
/// otherwise an upper bound: the same quantile of the distances between neighbouring values.
fn step_of(values: &[f64]) -> (f64, bool) {
    let mut distinct = values.to_vec();
    distinct.sort_unstable_by(f64::total_cmp);
    distinct.dedup();
    let repeats = distinct.len() > 1 && 2 * distinct.len() <= values.len();
    let changes = differences(if repeats { values } else { &distinct }).map(f64::abs);
    let step = quantile(changes.filter(|change| *change > 0.0).collect(), 0.1);
    (step, repeats)
}

/// Whether a column is measured; the reference is a command.
fn is_measured(name: &str) -> bool {
    name != PRESSURE_REF_PA
}

/// Number of changes of direction, each followed by a change of at least `prominent`.
fn reversals(values: &[f64], prominent: f64) -> usize {
    let (mut low, mut high) = (values[0], values[0]);
    // `None` until the first prominent change.
    let mut upwards = None;
    let mut count = 0;
    for value in values {
        (low, high) = (low.min(*value), high.max(*value));
        let (fell, rose) = (high - value >= prominent, value - low >= prominent);
        let now = match upwards {
            Some(true) if fell => Some(false),
            Some(false) if rose => Some(true),
            None if prominent > 0.0 && (fell || rose) => Some(rose),
            same => same,
        };
        if now != upwards {
            count += usize::from(upwards.is_some());
            (low, high, upwards) = (*value, *value, now);
        }
    }
    count
}

/// The samples without plateaus at `extreme`.
fn off_plateaus(values: &[f64], extreme: f64) -> Vec<f64> {
    let mut off = Vec::new();
    for run in values.chunk_by(|one, next| one == next) {
        if run[0] != extreme || run.len() < PLATEAU {
            off.extend_from_slice(run);
        }
    }
    off
}

/// The rows of single samples that differ from their neighbours by at least `height`.
fn spikes(values: &[f64], height: f64) -> Vec<usize> {
    let windows = values.windows(5).enumerate();
    let alone = windows.filter(|(_, v)| {
        let (up, down) = (v[2] - v[1], v[2] - v[3]);
        let around = (v[1] - v[0])
            .abs()
            .max((v[4] - v[3]).abs())
            .max((v[3] - v[1]).abs());
        let above = up.abs().min(down.abs());
        up * down > 0.0 && above > height.max(SPIKE_ALONE * around)
    });
    alone.map(|(row, _)| row + 2).collect()
}

impl Samples {
    /// Means over [`PIECE_S`], or the samples themselves if they are farther apart.
    fn pieces(&self) -> Samples {
        let mut pieces = Samples {
            time_s: Vec::new(),
            values: Vec::new(),
        };
        let mut row = 0;
        while row < self.values.len() {
            let rest = &self.time_s[row..];
            let count = rest.partition_point(|time_s| time_s - rest[0] < PIECE_S);
            let mean = |values: &[f64]| values.iter().sum::<f64>() / count as f64;
            pieces.time_s.push(mean(&rest[..count]));
            pieces.values.push(mean(&self.values[row..row + count]));
            row += count;
        }
        pieces
    }

    /// Number of stretches in which the signal changes by `prominent` within [`STEP_S`].
    fn steps(&self, prominent: f64) -> usize {
        let (mut steps, mut fast, mut last) = (0, false, 0);
        for (row, time_s) in self.time_s.iter().enumerate() {
            // Allows half a per mille for rounded times.
            let within = |later: &f64| later - time_s <= 1.0005 * STEP_S;
            while self.time_s.get(last + 1).is_some_and(within) {
                last += 1;
            }
            let later = last.max(row + 1).min(self.values.len() - 1);
            let was_fast = fast;
            fast = (self.values[later] - self.values[row]).abs() >= prominent;
            steps += usize::from(fast && !was_fast);
        }
        steps
    }

    /// The quantile [`RATE_SHARE`] of the rates between samples.
    fn rate_per_s(&self) -> f64 {
        let steps = differences(&self.values).zip(differences(&self.time_s));
        quantile(steps.map(|(step, s)| step.abs() / s).collect(), RATE_SHARE)
    }

    /// Longest time within a band of height `band`.
    fn longest_hold_s(&self, band: f64) -> f64 {
        let (mut begin, mut longest_s) = (0, 0.0_f64);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (row, value) in self.values.iter().enumerate() {
            (low, high) = (low.min(*value), high.max(*value));
            if high - low > band {
                // Go back to the start of the band around this value.
                (low, high, begin) = (*value, *value, row);
                while let Some(before) = begin.checked_sub(1).map(|before| self.values[before]) {
                    if high.max(before) - low.min(before) > band {
                        break;
                    }
                    (low, high, begin) = (low.min(before), high.max(before), begin - 1);
                }
            }
            longest_s = longest_s.max(self.time_s[row] - self.time_s[begin]);
        }
        longest_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    fn white(count: usize) -> impl Iterator<Item = f64> {
        let mut random = Pcg64::seed_from_u64(7);
        (0..count).map(move |_| StandardNormal.sample(&mut random))
    }

    /// Of 10⁵ stretches the quantile is known to within 0.3 %.
    #[test]
    fn the_noise_of_white_noise_is_its_own() {
        let values: Vec<f64> = white(2_000_000).collect();
        assert!((noise(&values) - 1.0).abs() < 0.005, "{}", noise(&values));
    }

    /// At 20 Hz, a swing of two seconds every eight. In two thirds of the stretches there is none
    /// of it; a tenth of all is 15 % of these, which is √(0.55 / 0.476) = 1.07 times the noise, and
    /// some 130 stretches tell it to within 8 %.
    #[test]
    fn a_motion_that_samples_do_not_resolve_is_no_noise() {
        let swing = |row: usize| match row % 160 {
            within @ 0..40 => 500.0 * (1.9 * within as f64).sin(),
            _ => 0.0,
        };
        let values = white(4000).enumerate().map(|(row, n)| swing(row) + n);
        let values: Vec<f64> = values.collect();
        assert!((noise(&values) - 1.07).abs() < 0.16, "{}", noise(&values));
    }
}

//! Rhythms in residuals: the period of an oscillation, and of pulses, on the records' clock, so
//! that records which begin at 0 have theirs at the same times.

use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// Frequencies are apart by this part of the inverse of the span.
const FINER: usize = 4;
/// The slowest rhythm, in these frequencies: 1.5 periods in the span.
const SLOWEST: usize = 6;
/// Frequencies whose power is compared with each other: up to this ratio, and so many at least.
const BAND: (f64, usize) = (1.3, 32);
/// Harmonics that tell pulses.
const HARMONICS: usize = 8;
/// Steps either way in which a frequency is refined, twice.
const REFINED: i32 = 10;
/// Records on a clock that runs for so many times their time have no common rhythm.
const APART: f64 = 10.0;
/// Parts of a period.
const PARTS: usize = 40;
/// Of periods that are multiples of each other the shortest is taken that has so much of the
/// largest pulses: a period twice too short has 0.7 of them in pulses that are narrow, one twice
/// too long as much in those that are wide.
const ALIKE: f64 = 0.8;

/// What is left of one record: when, and how much in units of the noise.
pub(super) type Left = (Vec<f64>, Vec<f64>);

/// The strongest rhythms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rhythm {
    /// Period of the oscillation \[s\].
    pub period_s: f64,
    /// Period of the pulses \[s\].
    pub pulse_period_s: f64,
    /// When a pulse is \[s\].
    pub pulse_at_s: f64,
}

impl Rhythm {
    /// A part of the pulses' period \[s\].
    pub fn part_s(&self) -> f64 {
        self.pulse_period_s / PARTS as f64
    }
}

/// What is left of all records, less its mean, in equal steps.
struct Sum {
    begin_s: f64,
    step_s: f64,
    left: Vec<f64>,
}

impl Sum {
    /// `None` of less than two rows, and of records that are far from each other on one clock.
    fn of(records: &[Left]) -> Option<Sum> {
        let is_known =
            |(time_s, left): &&Left| time_s.len() > 1 && left.iter().all(|left| left.is_finite());
        let records: Vec<&Left> = records.iter().filter(is_known).collect();
        let ends = records
            .iter()
            .map(|(time_s, _)| [time_s[0], time_s[time_s.len() - 1]]);
        let measured_s: f64 = ends.clone().map(|[begin_s, end_s]| end_s - begin_s).sum();
        let [begin_s, end_s] = ends.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        let residuals = || records.iter().flat_map(|(_, left)| left);
        let count = residuals().count();
        let step_s = measured_s / (count - records.len()) as f64;
        let is_one = measured_s > 0.0 && end_s - begin_s <= APART * measured_s;
        is_one.then_some(())?;
        let rows = ((end_s - begin_s) / step_s).round() as usize + 1;
        let mean = residuals().sum::<f64>() / count as f64;
        let mut left = vec![0.0; rows];
        for (time_s, own) in &records {
            for (time_s, own) in time_s.iter().zip(own) {
                left[(((time_s - begin_s) / step_s).round() as usize).min(rows - 1)] += own - mean;
            }
        }
        Some(Sum {
            begin_s,
            step_s,
            left,
        })
    }

    /// The power at a frequency.
    fn power(&self, frequency_hz: f64) -> f64 {
        let (mut real, mut imaginary) = (0.0, 0.0);
        for (row, left) in self.left.iter().enumerate() {
            let (sine, cosine) = (TAU * frequency_hz * self.step_s * row as f64).sin_cos();
            real += left * cosine;
            imaginary += left * sine;
        }
        real.hypot(imaginary).powi(2)
    }

    /// The power at the frequencies of a [`FINER`] transform, each as times the median of those
    /// about it.
    fn spectrum(&self) -> Option<Vec<f64>> {
        let mut padded = self.left.clone();
        padded.resize(FINER * padded.len(), 0.0);
        let transform = RealFftPlanner::new().plan_fft_forward(padded.len());
        let mut transformed = transform.make_output_vec();
        transform.process(&mut padded, &mut transformed).ok()?;
        let mut powers: Vec<f64> = transformed.iter().map(|value| value.norm_sqr()).collect();
        let mut begin = 0;
        while begin < powers.len() {
            let wide = (begin as f64 * (BAND.0 - 1.0)) as usize;
            let end = (begin + wide.max(BAND.1)).min(powers.len());
            let band = &mut powers[begin..end];
            let mut sorted = band.to_vec();
            sorted.sort_by(f64::total_cmp);
            let median = sorted[sorted.len() / 2].max(f64::MIN_POSITIVE);
            band.iter_mut().for_each(|power| *power /= median);
            begin = end;
        }
        Some(powers)
    }

    /// The share of a period, from the begin on, at which most is left on average, and how much
    /// that is beside what chance leaves there.
    fn largest_at(&self, frequency_hz: f64) -> (f64, f64) {
        let mut parts = [(0.0, 0.0_f64); PARTS];
        for (row, left) in self.left.iter().enumerate() {
            let share = (self.step_s * row as f64 * frequency_hz).fract();
            let part = &mut parts[((share * PARTS as f64) as usize).min(PARTS - 1)];
            *part = (part.0 + left, part.1 + 1.0);
        }
        let parts = parts.map(|(sum, rows)| sum.abs() / rows.sqrt().max(1.0));
        let place = largest(parts.into_iter()).unwrap_or(0);
        ((place as f64 + 0.5) / PARTS as f64, parts[place])
    }
}

/// The place with the largest value.
fn largest(places: impl Iterator<Item = f64>) -> Option<usize> {
    let places = places.enumerate();
    let (place, _) = places.max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    Some(place)
}

/// The rhythms of what is left of `records`; none where these are too short for one.
pub(super) fn rhythm(records: &[Left]) -> Option<Rhythm> {
    let sum = Sum::of(records)?;
    let spectrum = sum.spectrum()?;
    let step_hz = 1.0 / (sum.step_s * (FINER * sum.left.len()) as f64);
    let finer = |of: &dyn Fn(f64) -> f64, about_hz: f64, step_hz: f64| {
        let near = |part: i32| about_hz + f64::from(part) / f64::from(REFINED) * step_hz;
        let near_hz = (-REFINED..=REFINED).map(near);
        let with_power = near_hz.map(|hz| (hz, of(hz)));
        let largest = with_power.max_by(|a, b| a.1.total_cmp(&b.1));
        largest.map_or(about_hz, |(hz, _)| hz)
    };
    let refined = |place: usize, of: &dyn Fn(f64) -> f64| {
        let about_hz = finer(of, place as f64 * step_hz, step_hz);
        finer(of, about_hz, step_hz / f64::from(REFINED))
    };
    let tones = spectrum.get(SLOWEST..)?.iter().copied();
    let tone_hz = refined(SLOWEST + largest(tones)?, &|hz| sum.power(hz));
    let harmonics = |place: usize| (1..=HARMONICS).map(move |times| times * place);
    let comb = |place| harmonics(place).map(|place| spectrum[place].ln()).sum();
    let combs = SLOWEST..spectrum.len().div_ceil(HARMONICS);
    let comb_hz = refined(SLOWEST + largest(combs.map(comb))?, &|hz| {
        let harmonics = 1..=HARMONICS;
        harmonics.map(|times| sum.power(times as f64 * hz)).sum()
    });
    // Every second or third harmonic is a comb, too.
    let slower = [1.0, 2.0, 3.0].map(|times| comb_hz / times);
    let is_slow_enough = |hz: &f64| *hz >= SLOWEST as f64 * step_hz || *hz == comb_hz;
    let slower = slower.into_iter().filter(is_slow_enough);
    let pulses: Vec<_> = slower.map(|hz| (hz, sum.largest_at(hz))).collect();
    let most = pulses
        .iter()
        .map(|(_, (_, size))| *size)
        .fold(0.0, f64::max);
    let mut pulses = pulses.into_iter();
    let (pulses_hz, (share, _)) = pulses.find(|(_, (_, size))| *size >= ALIKE * most)?;
    let pulse_period_s = 1.0 / pulses_hz;
    Some(Rhythm {
        period_s: 1.0 / tone_hz,
        pulse_period_s,
        pulse_at_s: (sum.begin_s + share * pulse_period_s).rem_euclid(pulse_period_s),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left(of: impl Fn(f64, usize) -> f64) -> Vec<Left> {
        let record = |number: usize| {
            let time_s: Vec<f64> = (0..4000).map(|row| 0.01 * f64::from(row)).collect();
            // Something slow that differs from record to record.
            let slow = |time_s: f64| 3.0 * (0.4 * time_s + number as f64).sin();
            let left = time_s.iter().enumerate();
            let left = left.map(|(row, time_s)| of(*time_s, row + 4000 * number) + slow(*time_s));
            (time_s.clone(), left.collect())
        };
        (0..3).map(record).collect()
    }

    /// Between −1 and 1, without a rhythm.
    fn noise(row: usize) -> f64 {
        let mixed = (row as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((mixed >> 32) as f64) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    #[test]
    fn an_oscillation_and_pulses_are_found_in_noise() {
        let found = rhythm(&left(|time_s, row| {
            (TAU * 3.7 * time_s + 0.4).sin() + noise(row)
        }));
        let found = found.expect("a rhythm");
        assert!((found.period_s - 1.0 / 3.7).abs() < 1e-3, "{found:?}");
        let pulses = |time_s: f64, row| {
            let is_on = time_s.rem_euclid(2.3) < 0.15;
            if is_on { 4.0 } else { noise(row) }
        };
        let found = rhythm(&left(pulses)).expect("a rhythm");
        assert!((found.pulse_period_s - 2.3).abs() < 2e-3, "{found:?}");
        assert!((0.0..0.2).contains(&found.pulse_at_s), "{found:?}");
        // Wide ones have all of their size in twice their period, too.
        let wide = |time_s: f64, row| {
            let is_on = time_s.rem_euclid(2.3) < 0.5;
            noise(row) + if is_on { 4.0 } else { 0.0 }
        };
        let found = rhythm(&left(wide)).expect("a rhythm");
        assert!((found.pulse_period_s - 2.3).abs() < 2e-3, "{found:?}");
        // On a clock that began before.
        let mut later = left(pulses);
        let times_s = later.iter_mut().flat_map(|(time_s, _)| time_s);
        times_s.for_each(|time_s| *time_s += 1.0);
        let found = rhythm(&later).expect("a rhythm");
        assert!((1.0..1.2).contains(&found.pulse_at_s), "{found:?}");
    }

    #[test]
    fn a_short_record_has_none() {
        let unknown: Left = (vec![0.0, 0.1, 0.2], vec![1.0, f64::NAN, 0.0]);
        assert_eq!(rhythm(&[unknown]), None);
        let short: Left = (vec![0.0, 0.1], vec![1.0, -1.0]);
        assert_eq!(rhythm(&[short]), None);
        assert_eq!(rhythm(&[]), None);
    }
}

//! Oversampling: the conversions of a tick become one reading of each input, independent of the
//! supply voltage.
//!
//! The converter measures in parts of its supply. In each scan it also measures its internal
//! reference, whose count at 3.3 V is known from the factory: the readings are counts at 3.3 V.
//!
//! The valve's voltage is read back in each scan, too. The converter that makes it divides the same
//! supply, so that its reading is the last conversion as it is.
//!
//! What rounding removes from a reading is added to the next one. Otherwise a mean of so many
//! conversions would stand still although they are noisy, which looks like a frozen converter.

use crate::limits::ADC_VALID;
use crate::signal::{AdcCount, COUNT_MAX};

/// The inputs of a scan, in turn: bridge, pressure sensor, internal reference, valve's voltage.
pub const INPUTS: usize = 4;
/// Scans of a tick, at equal intervals over its whole period.
pub const SCANS: usize = 16;
/// Conversions of a tick.
pub const SAMPLES: usize = INPUTS * SCANS;
/// The same as words of two, the first one in the lower half: as the memory has them.
pub const WORDS: usize = SAMPLES / 2;
/// Words of a scan.
const SCAN_WORDS: usize = INPUTS / 2;
/// What the reader leaves in place of a period's last two conversions: no counts. If it is still
/// there a period later, the conversions no longer reach the memory, and what is in it is old.
/// Rounding alternates between two counts, so that old conversions would not look frozen.
pub const NOT_CONVERTED: u32 = u32::MAX;

/// Share of a tick's conversions of the reference in its mean: 1 / 64, a time constant of 0.64 s.
/// The supply drifts; the reference's noise must not become noise of the readings.
const REFERENCE_TICKS: u32 = 64;
/// The supply may differ from 3.3 V by this share: 1 / 10. Beyond it nothing is known.
const SUPPLY_SHARE_MAX: u32 = 10;

/// Whether the supply is 2.97 to 3.63 V, by the internal reference as measured and at 3.3 V.
pub(crate) fn is_supply_valid(reference: u32, calibrated: u32) -> bool {
    // The count goes as 3.3 V / supply: off / reference is the supply's relative error.
    let off = reference.abs_diff(calibrated);
    reference != 0 && off * SUPPLY_SHARE_MAX <= reference
}

/// The sums of the conversions of each input. Two are added at once: sixteen counts are at most
/// 65 520, so that nothing is carried from one half of a word to the other, and the product of two
/// sums is a u32.
fn sums(samples: &[u32; WORDS]) -> [u32; INPUTS] {
    let (scans, _) = samples.as_chunks::<SCAN_WORDS>();
    let add = |[a, b]: [u32; SCAN_WORDS], [first, second]: &[u32; SCAN_WORDS]| {
        [a.wrapping_add(*first), b.wrapping_add(*second)]
    };
    let [first, second] = scans.iter().fold([0; SCAN_WORDS], add);
    let low = |word: u32| word & 0xffff;
    [low(first), first >> 16, low(second), second >> 16]
}

/// Makes readings of conversions.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    /// Sum of the reference's conversions in a tick at 3.3 V.
    calibrated_sum: u32,
    /// The same as measured, averaged over some ticks, times [`REFERENCE_TICKS`]; 0 before the
    /// first tick.
    reference_sum: u32,
    /// What rounding has removed from the last readings, in parts of a count: the divisor's units.
    rest: [u32; 2],
}

impl Sampler {
    /// A sampler for a converter whose internal reference has `calibrated` counts at 3.3 V.
    pub const fn new(calibrated: u16) -> Sampler {
        Sampler {
            calibrated_sum: if calibrated > COUNT_MAX {
                COUNT_MAX as u32 * SCANS as u32
            } else {
                calibrated as u32 * SCANS as u32
            },
            reference_sum: 0,
            rest: [0; 2],
        }
    }

    /// The readings of bridge, pressure sensor and valve's voltage. The first two are 0, which is
    /// out of range, if the supply is not 3.3 V within 10 %; all are if the last conversions are
    /// [`NOT_CONVERTED`].
    pub fn readings(&mut self, samples: &[u32; WORDS]) -> [AdcCount; 3] {
        let [.., last] = samples;
        if *last == NOT_CONVERTED {
            return Default::default();
        }
        // The last one: the first ones of a late tick are of the voltage before.
        let valve = AdcCount(((last >> 16) as u16).min(COUNT_MAX));
        let [bridge, pressure, reference, _] = sums(samples);
        self.reference_sum = if self.reference_sum == 0 {
            reference * REFERENCE_TICKS
        } else {
            self.reference_sum - self.reference_sum / REFERENCE_TICKS + reference
        };
        let reference = self.reference_sum / REFERENCE_TICKS;
        if !is_supply_valid(reference, self.calibrated_sum) {
            return [AdcCount(0), AdcCount(0), valve];
        }
        [
            self.reading(bridge, 0, reference),
            self.reading(pressure, 1, reference),
            valve,
        ]
    }

    /// A reading at an end of the scale stays there: that is how an open wire is detected.
    fn reading(&mut self, sum: u32, input: usize, reference: u32) -> AdcCount {
        let mean = (sum / SCANS as u32) as u16;
        let Some(rest) = self.rest.get_mut(input) else {
            return AdcCount(mean);
        };
        if !ADC_VALID.contains(&mean) {
            return AdcCount(mean);
        }
        let divisor = (reference * SCANS as u32).max(1);
        let product = (sum * self.calibrated_sum).saturating_add((*rest).min(divisor - 1));
        *rest = product % divisor;
        let count = (product / divisor).min(COUNT_MAX.into()) as u16;
        AdcCount(count.clamp(*ADC_VALID.start(), *ADC_VALID.end()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CALIBRATED: u16 = 1502;

    /// Conversions as the memory has them, of each scan; the valve's voltage is at 700 counts.
    fn samples(of: impl Fn(usize) -> [u16; INPUTS - 1]) -> [u32; WORDS] {
        words(|n| of(n / INPUTS).get(n % INPUTS).copied().unwrap_or(700))
    }

    fn words(conversion: impl Fn(usize) -> u16) -> [u32; WORDS] {
        core::array::from_fn(|n| [1, 0].map(|odd| u32::from(conversion(2 * n + odd))))
            .map(|[high, low]: [u32; 2]| high << 16 | low)
    }

    #[test]
    fn inputs_are_separated_averaged_and_rounded() {
        let mut samples = samples(|scan| [1000 + scan as u16, 2000, CALIBRATED]);
        // 1000 to 1015: the mean is 1007.5, and every second reading is rounded up.
        let mut sampler = Sampler::new(CALIBRATED);
        for expected in [1007, 1008, 1007, 1008] {
            let readings = [expected, 2000, 700].map(AdcCount);
            assert_eq!(sampler.readings(&samples), readings);
        }
        samples[0] -= 8;
        for expected in [1007; 4] {
            assert_eq!(sampler.readings(&samples)[0], AdcCount(expected));
        }
    }

    /// A noise of half a count in single conversions: 50 equal readings would be a frozen sensor.
    #[test]
    fn noisy_conversions_never_stand_still() {
        let mut seed = 1_u32;
        let mut sampler = Sampler::new(CALIBRATED);
        let (mut same, mut last) = (0, 0);
        for _ in 0..10_000 {
            let mut noise = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 31) as u16
            };
            let noises: [u16; SAMPLES] = core::array::from_fn(|_| noise());
            let samples = words(|n| match n % INPUTS {
                2 => CALIBRATED,
                _ => 2000 + noises[n],
            });
            let [AdcCount(reading), ..] = sampler.readings(&samples);
            same = if reading == last { same + 1 } else { 0 };
            last = reading;
            assert!(same < 50);
        }
    }

    /// All counts of a converter grow as its supply falls.
    #[test]
    fn readings_do_not_depend_on_the_supply() {
        for supply_v in [2.975, 3.2, 3.3, 3.4, 3.625] {
            let count = |volts: f64| (volts / supply_v * 4095.0).round() as u16;
            let at_3v3 = |volts: f64| (volts / 3.3 * 4095.0).round() as i32;
            let reference = f64::from(CALIBRATED) * 3.3 / 4095.0;
            let samples = samples(|_| [count(1.65), count(0.9), count(reference)]);
            let [bridge, pressure, _] = Sampler::new(CALIBRATED).readings(&samples);
            // Half a count of the reference is 0.03 %.
            for (reading, volts) in [(bridge, 1.65), (pressure, 0.9)] {
                let off = i32::from(reading.0) - at_3v3(volts);
                assert!(off.abs() <= 2, "{supply_v} V: {off} counts");
            }
        }
    }

    #[test]
    fn supply_beyond_ten_percent_is_no_reading() {
        for reference in [0, 1_365, 1_669, 4095] {
            let samples = samples(|_| [2000, 1000, reference]);
            let readings = Sampler::new(CALIBRATED).readings(&samples);
            assert_eq!(readings, [0, 0, 700].map(AdcCount), "{reference}");
        }
    }

    /// Nothing of it reaches later readings.
    #[test]
    fn old_conversions_are_no_reading() {
        let fresh = samples(|_| [2000, 1000, CALIBRATED]);
        let mut old = fresh;
        old[WORDS - 1] = NOT_CONVERTED;
        let mut sampler = Sampler::new(CALIBRATED);
        let expected = [2000, 1000, 700].map(AdcCount);
        for (samples, expected) in [
            (fresh, expected),
            (old, [AdcCount(0); 3]),
            (fresh, expected),
        ] {
            assert_eq!(sampler.readings(&samples), expected);
        }
    }

    /// Sixteen counts at an end of their scale do not change the sum beside them. Of a tick that is
    /// late the first scan is of the voltage before.
    #[test]
    fn valve_is_read_last_and_full_scales_stay_apart() {
        let samples = words(|n| match (n % INPUTS, n / INPUTS) {
            (3, 0) => 100,
            (3, _) => 3000,
            (2, _) => CALIBRATED,
            _ => COUNT_MAX,
        });
        let readings = Sampler::new(CALIBRATED).readings(&samples);
        assert_eq!(readings, [COUNT_MAX, COUNT_MAX, 3000].map(AdcCount));
    }

    #[test]
    fn open_wire_stays_at_its_end_of_the_scale_whatever_the_supply() {
        for reference in [1400, 1502, 1600] {
            let samples = samples(|_| [4095, 0, reference]);
            let readings = Sampler::new(CALIBRATED).readings(&samples);
            assert_eq!(readings, [4095, 0, 700].map(AdcCount));
        }
    }

    /// The square of the noise in the readings grows by less than 2 % for an input of full scale.
    #[test]
    fn noise_of_the_reference_hardly_reaches_the_readings() {
        let mut sampler = Sampler::new(CALIBRATED);
        let constant = samples(|_| [3000, 3000, CALIBRATED]);
        sampler.readings(&constant);
        for tick in 0..1000_u16 {
            let noise = if tick % 2 == 0 { 15 } else { 0 };
            let noisy = samples(|_| [3000, 3000, CALIBRATED + noise - 7]);
            let [bridge, ..] = sampler.readings(&noisy);
            assert!(bridge.0.abs_diff(3000) <= 2, "{bridge:?}");
        }
    }

    proptest! {
        #[test]
        fn any_samples_give_a_count_on_the_scale(
            samples in proptest::collection::vec(any::<u32>(), WORDS),
            calibrated: u16,
        ) {
            let samples: [u32; WORDS] = samples.try_into().unwrap();
            let mut sampler = Sampler::new(calibrated);
            for _ in 0..3 {
                for reading in sampler.readings(&samples) {
                    prop_assert!(reading.0 <= COUNT_MAX);
                }
            }
        }
    }
}

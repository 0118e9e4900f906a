//! Oversampling: the conversions of a tick become one reading of each input, independent of the
//! supply voltage.
//!
//! The converter measures in parts of its supply. In each scan it also measures its internal
//! reference, whose count at 3.3 V is known from the factory: the readings are counts at 3.3 V.
//!
//! What rounding removes from a reading is added to the next one. Otherwise a mean of so many
//! conversions would stand still although they are noisy, which looks like a frozen converter.

use crate::limits::ADC_VALID;
use crate::signal::{AdcCount, COUNT_MAX};

/// The inputs of a scan, in turn: bridge, pressure sensor, internal reference.
pub const INPUTS: usize = 3;
/// Scans of a tick, at equal intervals over its whole period.
pub const SCANS: usize = 16;
/// Conversions of a tick.
pub const SAMPLES: usize = INPUTS * SCANS;
/// What the reader leaves in place of a period's last conversion: no count. If it is still there a
/// period later, the conversions no longer reach the memory, and what is in it is old. Rounding
/// alternates between two counts, so that old conversions would not look frozen.
pub const NOT_CONVERTED: u16 = u16::MAX;

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

/// The sum of the conversions of one input.
fn sum(samples: &[u16; SAMPLES], input: usize) -> u32 {
    let of_input = samples.iter().skip(input).step_by(INPUTS);
    // At most 65 520: the product of two such sums is a u32.
    of_input
        .map(|sample| u32::from((*sample).min(COUNT_MAX)))
        .sum()
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

    /// The readings of bridge and pressure sensor. Both are 0, which is out of range, if the supply
    /// is not 3.3 V within 10 %, or if the last conversion is [`NOT_CONVERTED`].
    pub fn readings(&mut self, samples: &[u16; SAMPLES]) -> (AdcCount, AdcCount) {
        if samples.last() == Some(&NOT_CONVERTED) {
            return Default::default();
        }
        let reference = sum(samples, 2);
        self.reference_sum = if self.reference_sum == 0 {
            reference * REFERENCE_TICKS
        } else {
            self.reference_sum - self.reference_sum / REFERENCE_TICKS + reference
        };
        let reference = self.reference_sum / REFERENCE_TICKS;
        if !is_supply_valid(reference, self.calibrated_sum) {
            return Default::default();
        }
        (
            self.reading(samples, 0, reference),
            self.reading(samples, 1, reference),
        )
    }

    /// A reading at an end of the scale stays there: that is how an open wire is detected.
    fn reading(&mut self, samples: &[u16; SAMPLES], input: usize, reference: u32) -> AdcCount {
        let sum = sum(samples, input);
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

    fn samples(of: impl Fn(usize) -> [u16; INPUTS]) -> [u16; SAMPLES] {
        core::array::from_fn(|n| of(n / INPUTS)[n % INPUTS])
    }

    #[test]
    fn inputs_are_separated_averaged_and_rounded() {
        let mut samples = samples(|scan| [1000 + scan as u16, 2000, CALIBRATED]);
        // 1000 to 1015: the mean is 1007.5, and every second reading is rounded up.
        let mut sampler = Sampler::new(CALIBRATED);
        for expected in [1007, 1008, 1007, 1008] {
            let readings = (AdcCount(expected), AdcCount(2000));
            assert_eq!(sampler.readings(&samples), readings);
        }
        samples[0] -= 8;
        for expected in [1007; 4] {
            assert_eq!(sampler.readings(&samples).0, AdcCount(expected));
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
            let samples = core::array::from_fn(|n| match n % INPUTS {
                2 => CALIBRATED,
                _ => 2000 + noise(),
            });
            let (AdcCount(reading), _) = sampler.readings(&samples);
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
            let (bridge, pressure) = Sampler::new(CALIBRATED).readings(&samples);
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
            assert_eq!(readings, (AdcCount(0), AdcCount(0)), "{reference}");
        }
    }

    /// Nothing of it reaches later readings.
    #[test]
    fn old_conversions_are_no_reading() {
        let fresh = samples(|_| [2000, 1000, CALIBRATED]);
        let mut old = fresh;
        old[SAMPLES - 1] = NOT_CONVERTED;
        let mut sampler = Sampler::new(CALIBRATED);
        for (samples, expected) in [(fresh, (2000, 1000)), (old, (0, 0)), (fresh, (2000, 1000))] {
            let (bridge, pressure) = sampler.readings(&samples);
            assert_eq!((bridge.0, pressure.0), expected);
        }
    }

    #[test]
    fn open_wire_stays_at_its_end_of_the_scale_whatever_the_supply() {
        for reference in [1400, 1502, 1600] {
            let samples = samples(|_| [4095, 0, reference]);
            let readings = Sampler::new(CALIBRATED).readings(&samples);
            assert_eq!(readings, (AdcCount(4095), AdcCount(0)));
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
            let (bridge, _) = sampler.readings(&noisy);
            assert!(bridge.0.abs_diff(3000) <= 2, "{bridge:?}");
        }
    }

    proptest! {
        #[test]
        fn any_samples_give_a_count_on_the_scale(
            samples in proptest::collection::vec(any::<u16>(), SAMPLES),
            calibrated: u16,
        ) {
            let samples: [u16; SAMPLES] = samples.try_into().unwrap();
            let mut sampler = Sampler::new(calibrated);
            for _ in 0..3 {
                let (bridge, pressure) = sampler.readings(&samples);
                prop_assert!(bridge.0 <= COUNT_MAX && pressure.0 <= COUNT_MAX);
            }
        }
    }
}

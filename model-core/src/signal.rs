//! Counts of the converters and what they mean, both ways.
//!
//! Newtypes are used at the electrical interface only; inside, quantities are SI numbers. The
//! simulator and hardware in the loop use the conversion from quantities to counts.

use crate::limits::{ADC_VALID, READ_BACK_OFF_COUNTS, READ_BACK_OFF_SHARE};
use crate::number::Number;
use crate::pressure::GaugePa;
use serde::{Deserialize, Serialize};

/// Full scale of the 12-bit converters.
pub const COUNT_MAX: u16 = 4095;

/// A reading of the 12-bit ADC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AdcCount(pub u16);

/// The encoder's position, which wraps at 2³².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EncoderCount(pub u32);

impl EncoderCount {
    /// Counts from `home` to here, across the wrap too.
    pub fn since(self, home: EncoderCount) -> i32 {
        self.0.wrapping_sub(home.0) as i32
    }
}

/// A value for the 12-bit DAC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DacCount(u16);

impl DacCount {
    /// `count`, but at most full scale.
    pub fn new(count: u16) -> DacCount {
        DacCount(count.min(COUNT_MAX))
    }

    /// The count.
    pub fn get(self) -> u16 {
        self.0
    }

    /// Whether the voltage of this count may be read back as `read`. Both converters divide the
    /// same supply, so that it does not matter.
    pub fn may_be_read_as(self, read: AdcCount) -> bool {
        let off_max = READ_BACK_OFF_COUNTS + self.0 / READ_BACK_OFF_SHARE;
        self.0.abs_diff(read.0) <= off_max
    }
}

/// The nearest count on a 12-bit scale; 0 for NaN.
fn nearest(count: f32) -> u16 {
    // Both bounds take the number of a number and a NaN; `at_least` is first, so that NaN is 0.
    libm::roundf(count.at_least(0.0).at_most(COUNT_MAX as f32)) as u16
}

/// A straight line between an ADC's counts and a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdcScale {
    /// Counts where the quantity is zero.
    pub zero_count: f32,
    /// Quantity per count, in its SI unit; negative for a bridge wired the other way.
    pub per_count: f32,
}

impl AdcScale {
    /// The quantity that `count` stands for.
    pub fn value(&self, count: AdcCount) -> f32 {
        (count.0 as f32 - self.zero_count) * self.per_count
    }

    /// The lowest and the highest quantity that can be read with an intact wire.
    pub fn ends(&self) -> (f32, f32) {
        let first = self.value(AdcCount(*ADC_VALID.start()));
        let last = self.value(AdcCount(*ADC_VALID.end()));
        (first.at_most(last), first.at_least(last))
    }

    /// The count nearest to `value`, limited to the scale.
    pub fn count(&self, value: f32) -> AdcCount {
        AdcCount(nearest(value / self.per_count + self.zero_count))
    }
}

/// The way from a reference pressure to the DAC: valve characteristic, amplifier, converter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValveDrive {
    /// Pressure per volt at the valve's input \[Pa/V\].
    pub pa_per_v: f32,
    /// Amplification between DAC and valve \[-\].
    pub amplifier_gain: f32,
    /// DAC voltage at full scale \[V\].
    pub dac_full_scale_v: f32,
}

impl ValveDrive {
    /// Pressure per DAC count \[Pa\].
    fn pa_per_count(&self) -> f32 {
        self.pa_per_v * self.amplifier_gain * self.dac_full_scale_v / COUNT_MAX as f32
    }

    /// Voltage at the valve's input for `pressure` \[V\].
    pub fn valve_v(&self, pressure: GaugePa<f32>) -> f32 {
        pressure.0 / self.pa_per_v
    }

    /// The DAC count nearest to `pressure`; 0 (the vented valve) for NaN.
    pub fn count(&self, pressure: GaugePa<f32>) -> DacCount {
        let dac_v = self.valve_v(pressure) / self.amplifier_gain;
        DacCount(nearest(dac_v / self.dac_full_scale_v * COUNT_MAX as f32))
    }

    /// The pressure that a DAC count stands for.
    pub fn pressure(&self, count: DacCount) -> GaugePa<f32> {
        GaugePa(count.0 as f32 * self.pa_per_count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn encoder_difference_is_right_across_both_wraps() {
        for home in [0, 5, u32::MAX - 3, i32::MAX as u32, 1 << 31] {
            for moved in [-1000, -1, 0, 1, 1000] {
                let count = EncoderCount(home.wrapping_add_signed(moved));
                assert_eq!(count.since(EncoderCount(home)), moved);
            }
        }
    }

    proptest! {
        #[test]
        fn adc_scale_inverts_itself(count in 0..=COUNT_MAX, zero in 0.0_f32..4095.0,
                                    per in prop_oneof![1e-3_f32..1e3, -1e3_f32..-1e-3]) {
            let scale = AdcScale { zero_count: zero, per_count: per };
            prop_assert_eq!(scale.count(scale.value(AdcCount(count))), AdcCount(count));
        }

        #[test]
        fn any_float_gives_a_count_on_the_scale(bits: u32, value_bits: u32) {
            let drive = ValveDrive { pa_per_v: f32::from_bits(bits), amplifier_gain: 3.0,
                                     dac_full_scale_v: 3.3 };
            prop_assert!(drive.count(GaugePa(f32::from_bits(value_bits))).get() <= COUNT_MAX);
            let scale = AdcScale { zero_count: 0.0, per_count: f32::from_bits(bits) };
            prop_assert!(scale.count(f32::from_bits(value_bits)).0 <= COUNT_MAX);
        }

        #[test]
        fn valve_drive_is_within_half_a_count(pressure in 0.0_f32..5e5) {
            let drive = ValveDrive { pa_per_v: 5e4, amplifier_gain: 10.0 / 3.3,
                                     dac_full_scale_v: 3.3 };
            let back = drive.pressure(drive.count(GaugePa(pressure))).0;
            // Half a count is 61 Pa; rounding of f32 adds a few parts in 1e7 of full scale.
            prop_assert!((back - pressure).abs() <= 0.5 * 5e5 / 4095.0 + 0.5);
        }
    }
}

//! Oversampling: several conversions of one input become one reading.

use crate::signal::AdcCount;

/// The inputs that a scan converts, in turn.
pub const INPUTS: usize = 2;
/// Conversions of one scan; the longest sequence of the STM32's ADC.
pub const SCAN_LEN: usize = 16;

/// The mean count of one input (bridge 0, pressure 1) in a scan that takes the inputs in turn.
pub fn mean(scan: &[u16; SCAN_LEN], input: usize) -> AdcCount {
    let samples = scan.iter().skip(input).step_by(INPUTS);
    let (sum, number) = samples.fold((0_u32, 0_u32), |(sum, number), sample| {
        (sum + u32::from(*sample), number + 1)
    });
    // Rounded; sixteen u16 cannot overflow, and their mean is a u16.
    AdcCount(((sum + number / 2) / number.max(1)) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn inputs_are_told_apart_and_rounded() {
        let mut scan = [0; SCAN_LEN];
        for (n, sample) in scan.iter_mut().enumerate() {
            *sample = if n % 2 == 0 { 1000 + n as u16 } else { 4095 };
        }
        // 1000, 1002 … 1014: the mean is 1007.
        assert_eq!(mean(&scan, 0), AdcCount(1007));
        assert_eq!(mean(&scan, 1), AdcCount(4095));
        scan[0] += 4;
        assert_eq!(mean(&scan, 0), AdcCount(1008), "7.5 is rounded up");
    }

    proptest! {
        #[test]
        fn mean_lies_among_the_samples(scan: [u16; SCAN_LEN], input in 0_usize..INPUTS) {
            let samples = || scan.iter().skip(input).step_by(INPUTS).copied();
            let AdcCount(mean) = mean(&scan, input);
            prop_assert!(samples().min() <= Some(mean) && Some(mean) <= samples().max());
        }
    }
}

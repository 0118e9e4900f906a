//! The core's clock compared with the chip's slow oscillator, which is also the watchdog's.
//!
//! Ticks, ramps and speeds are as fast as the core's clock, and nothing that runs from it can tell
//! that it is wrong. The slow oscillator is another circuit, so that one of the two that changes is
//! found. It differs from chip to chip, so that its first reading is what later ones are compared
//! with.

use core::ops::RangeInclusive;

/// Nominal frequency of the slow count \[Hz\]: 32 kHz, divided by 32.
const SLOW_HZ: f32 = 1000.0;
/// The slow count that is followed by zero.
pub const SLOW_COUNT_MAX: u16 = 0x7fff;
/// The slow count's frequency as the core's clock measures it, relative to [`SLOW_HZ`]: 17 to
/// 47 kHz by the data sheets of the F407, F411 and F446, with a core's clock within 4 %, are 0.511
/// to 1.530; one count of a reading is 0.004.
const RATIO: RangeInclusive<f32> = 0.505..=1.54;
/// Largest change of that since the first reading, relative. The data sheets state no drift of a
/// single chip. The STM32L1's, of a similar oscillator, is -10 to 4 % from 0 to 85 °C; with the 4 %
/// of the core's clock, and one count of 250, that is 15 %.
const CHANGE_MAX: f32 = 0.2;
/// Readings a second.
const READINGS_PER_S: u32 = 4;

/// Compares two clocks.
#[derive(Clone, Copy, Debug)]
pub struct ClockCheck {
    core_hz: u32,
    /// Cycles of the core and the slow count at the last reading.
    last: Option<(u32, u16)>,
    first_ratio: Option<f32>,
}

impl ClockCheck {
    /// A check of a core that should have this frequency.
    pub const fn new(core_hz: u32) -> ClockCheck {
        ClockCheck {
            core_hz,
            last: None,
            first_ratio: None,
        }
    }

    /// Whether the clocks agree, at this count of the core's cycles. Reads the slow count, which
    /// rises, every quarter of a second. The core's counter must not pass the last reading again
    /// between two calls, which takes it 23 s at 180 MHz, nor the slow one, 22 s at 47 kHz.
    pub fn step(&mut self, core_cycles: u32, slow_count: impl FnOnce() -> u16) -> bool {
        let cycles = self
            .last
            .map(|(cycles, _)| core_cycles.wrapping_sub(cycles));
        if cycles.is_some_and(|cycles| cycles < self.core_hz / READINGS_PER_S) {
            return true;
        }
        let count = slow_count();
        let last = self.last.replace((core_cycles, count));
        let (Some(cycles), Some((_, before))) = (cycles, last) else {
            return true;
        };
        let counts = count.wrapping_sub(before) & SLOW_COUNT_MAX;
        let ratio = f32::from(counts) / SLOW_HZ * self.core_hz as f32 / cycles as f32;
        let first = *self.first_ratio.get_or_insert(ratio);
        RATIO.contains(&ratio) && (ratio - first).abs() <= CHANGE_MAX * first
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORE_HZ: u32 = 144_000_000;

    /// A check that is called every millisecond, of clocks with these frequencies; the time of the
    /// first finding \[ms\], if there is one within 100 s. Both are changed after 10 s.
    fn found_ms(core_hz: [f64; 2], slow_hz: [f64; 2]) -> Option<u32> {
        let mut check = ClockCheck::new(CORE_HZ);
        let (mut cycles, mut counts) = (4.2e9, 32_000.0);
        (0..100_000).find(|ms| {
            let now = usize::from(*ms >= 10_000);
            cycles += core_hz[now] / 1e3;
            counts += slow_hz[now] / 32e3;
            let slow = (counts as u64 % 0x8000) as u16;
            !check.step(cycles as u64 as u32, || slow)
        })
    }

    fn steady(core: f64, slow_hz: f64) -> Option<u32> {
        found_ms([core * f64::from(CORE_HZ); 2], [slow_hz; 2])
    }

    #[test]
    fn any_chip_within_its_tolerances_is_right() {
        for core in [0.96, 1.0, 1.04] {
            for slow_hz in [17_000.0, 32_000.0, 47_000.0] {
                assert_eq!(steady(core, slow_hz), None, "{core} {slow_hz}");
            }
        }
        // Drifts of one chip.
        let core = f64::from(CORE_HZ);
        for slow in [0.9, 1.04] {
            for relative in [0.96, 1.04] {
                let found = found_ms([core, relative * core], [30_000.0, slow * 30_000.0]);
                assert_eq!(found, None, "{slow} {relative}");
            }
        }
    }

    #[test]
    fn a_clock_that_is_wrong_from_the_start_is_found_at_the_first_reading() {
        // Half and twice the frequency of a usual oscillator, one that stands, and the watchdog's.
        for (core, slow_hz) in [
            (0.5, 32_000.0),
            (2.0, 32_000.0),
            (1.0, 0.0),
            (1.0, 64_000.0),
        ] {
            let found = steady(core, slow_hz).expect("found");
            assert!(
                found <= (250.0 / core) as u32 + 1,
                "{core} {slow_hz}: {found} ms"
            );
        }
    }

    #[test]
    fn a_clock_that_changes_by_more_than_a_quarter_is_found_within_half_a_second() {
        let core = f64::from(CORE_HZ);
        for slow_hz in [17_000.0, 32_000.0, 47_000.0] {
            for (relative, slow) in [
                (0.75, 1.0),
                (1.3, 1.0),
                (1.0, 0.75),
                (1.0, 1.25),
                (1.0, 0.0),
            ] {
                let changed = [slow_hz, slow * slow_hz];
                let found = found_ms([core, relative * core], changed).expect("found");
                let latest = 10_000 + (500.0 / relative) as u32 + 2;
                assert!(
                    (10_000..=latest).contains(&found),
                    "{relative} {slow}: {found} ms"
                );
            }
        }
    }
}

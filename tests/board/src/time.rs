//! Exact time: one unit is 1 / 50.4 GHz, which divides the period of every clock of the board.

/// A point in time, or a duration, in units of 1/50.4 GHz since power was first applied.
pub type Time = u64;

/// Units per second: a common multiple of 8, 16, 36, 72, 96, 144 and 180 MHz and of 32 kHz.
pub const UNITS_PER_S: Time = 50_400_000_000;

/// Later than any event.
pub const NEVER: Time = Time::MAX;

/// The first unit at or after `time_ns`.
pub fn from_ns(time_ns: u64) -> Time {
    (u128::from(time_ns) * 504).div_ceil(10) as Time
}

/// Whole nanoseconds in `time`.
pub fn to_ns(time: Time) -> u64 {
    (u128::from(time) * 10 / 504) as u64
}

/// Units in one period of `clock_hz`, and whether that is exact.
pub fn period(clock_hz: u64) -> (Time, bool) {
    (UNITS_PER_S / clock_hz, UNITS_PER_S.is_multiple_of(clock_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversion_of_nanoseconds_and_back_is_exact() {
        for time_ns in [0, 1, 9, 10_000_000, 123_456_789_012_345] {
            assert_eq!(to_ns(from_ns(time_ns)), time_ns);
        }
    }

    #[test]
    fn periods_of_the_clocks_are_exact() {
        for hz in [
            8_000_000,
            16_000_000,
            36_000_000,
            72_000_000,
            96_000_000,
            144_000_000,
            180_000_000,
            32_000,
        ] {
            assert!(period(hz).1, "{hz}");
        }
    }
}

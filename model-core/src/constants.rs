//! Constants that the controller, the firmware and the simulator share.

/// Period of the controller's tick \[ms\]: the paper's sampling time.
pub const TICK_PERIOD_MS: u32 = 10;

/// The same \[s\], as the controller computes with it.
pub const TICK_S: f32 = TICK_PERIOD_MS as f32 / 1e3;

/// Standard gravity g \[m/s²\] (ISO 80000-3). Code in `f32` converts it.
pub const GRAVITY_M_PER_S2: f64 = 9.80665;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversions_round_as_literals_do() {
        assert_eq!(TICK_S.to_bits(), 0.01_f32.to_bits());
        assert_eq!(
            (f64::from(TICK_PERIOD_MS) / 1e3).to_bits(),
            0.01_f64.to_bits()
        );
        assert_eq!((GRAVITY_M_PER_S2 as f32).to_bits(), 9.80665_f32.to_bits());
    }
}

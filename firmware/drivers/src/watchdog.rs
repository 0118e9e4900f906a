//! The watchdog: it resets the chip, and so brings the valve to 0 V, if ticks do not complete.

/// Nominal time in which a tick must complete \[ms\]: four ticks may be missed.
pub const TICK_TIMEOUT_MS: u32 = 50;
/// The same while no ticks run \[ms\]: erasing a sector may take 4 s.
pub const LONG_TIMEOUT_MS: u32 = 20_000;

/// A running watchdog timer; `embedded-hal` 1.0 has no such trait.
pub trait WatchdogTimer {
    /// Changes the timeout, and restarts it.
    fn set_timeout_ms(&mut self, timeout_ms: u32);

    /// Restarts the timeout.
    fn feed(&mut self);
}

/// The watchdog.
pub struct Watchdog<T>(T);

impl<T: WatchdogTimer> Watchdog<T> {
    /// Begins with the long timeout.
    pub fn new(mut timer: T) -> Watchdog<T> {
        timer.set_timeout_ms(LONG_TIMEOUT_MS);
        Watchdog(timer)
    }

    /// Switches to the short timeout: from now on ticks must complete.
    pub fn expect_ticks(&mut self) {
        self.0.set_timeout_ms(TICK_TIMEOUT_MS);
    }

    /// Restarts the timeout. Call it after a complete tick and nowhere else: the link task is not
    /// monitored, because a reset vents the muscle and lowers the weight, whereas the tick can
    /// assist without the PC.
    pub fn feed(&mut self) {
        self.0.feed();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Timeouts set, and times fed since the last one.
    #[derive(Default)]
    struct Timer(u32, u32);

    impl WatchdogTimer for &mut Timer {
        fn set_timeout_ms(&mut self, timeout_ms: u32) {
            **self = Timer(timeout_ms, 0);
        }
        fn feed(&mut self) {
            self.1 += 1;
        }
    }

    #[test]
    fn timeout_is_long_until_ticks_are_expected() {
        let mut timer = Timer::default();
        let mut watchdog = Watchdog::new(&mut timer);
        assert_eq!(watchdog.0.0, LONG_TIMEOUT_MS);
        watchdog.expect_ticks();
        assert_eq!(watchdog.0.0, TICK_TIMEOUT_MS);
        watchdog.feed();
        assert_eq!(timer.1, 1);
    }
}

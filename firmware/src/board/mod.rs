//! The board: clocks, times, pins and flash sectors. Constants and types only; the drivers use
//! them. Each board has its own file, selected by a cargo feature.

mod pins;

#[cfg(feature = "nucleo-f446re")]
mod nucleo_f446re;
#[cfg(feature = "nucleo-f446re")]
pub use nucleo_f446re::*;

#[cfg(all(feature = "stm32f407", not(feature = "nucleo-f446re")))]
mod stm32f407;
#[cfg(all(feature = "stm32f407", not(feature = "nucleo-f446re")))]
pub use stm32f407::*;

use core::num::NonZeroU32;
use model_core::constants::TICK_PERIOD_MS;

/// Clock of the timers on APB1 \[Hz\]: APB1 runs at SYSCLK / 4, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ / 2;

/// Tick period \[µs\].
pub const TICK_US: u32 = 1_000 * TICK_PERIOD_MS;
/// CPU cycles per tick.
pub const TICK_CYCLES: NonZeroU32 = NonZeroU32::new(SYSCLK_HZ / 1_000_000 * TICK_US).unwrap();
/// Counts of the tick timer per tick: one per microsecond.
pub const TICK_COUNTS: u32 = TICK_US;

/// Baud rate of the link \[bit/s\]: telemetry takes 7 % of it.
pub const LINK_BAUD: u32 = 921_600;
/// Period of the link task \[ms\].
pub const LINK_PERIOD_MS: u32 = 1;

const _: () = {
    // The tick timer divides its clock to 10 ms without a remainder.
    let counts = TIMER_HZ as u64 * TICK_US as u64;
    assert!(counts == TICK_PRESCALER as u64 * TICK_COUNTS as u64 * 1_000_000);
    assert!(TICK_PRESCALER <= 1 << 16);
    assert!(SYSCLK_HZ as u64 * TICK_US as u64 == TICK_CYCLES.get() as u64 * 1_000_000);
};

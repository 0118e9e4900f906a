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
use model_core::sampling::SCANS;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// CPU clock \[Hz\], by PLL from the chip's own oscillator (HSI, 16 MHz): no plug, probe or crystal
/// can take it away. HSI is within 1 % at 25 °C and within 4 % from -10 to 85 °C (datasheets of the
/// F405 and F446); at 4 % more every clock is still within the chips' limits: CPU 150 of 168 MHz
/// with 4 wait states of the flash, APB1 37.5 of 42 MHz. From 144 MHz the divider of [`LINK_BAUD`]
/// is off by 0.16 %, exactly as the ST-LINK's is from its 72 MHz.
pub const SYSCLK_HZ: u32 = 144_000_000;

/// Clock of the timers on APB1 \[Hz\]: APB1 runs at SYSCLK / 4, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ / 2;

/// Tick period \[µs\].
pub const TICK_US: u32 = 1_000 * TICK_PERIOD_MS;
/// CPU cycles per tick.
pub const TICK_CYCLES: NonZeroU32 = NonZeroU32::new(SYSCLK_HZ / 1_000_000 * TICK_US).unwrap();
/// Counts of the tick timer from one scan of the converter to the next: one per microsecond.
pub const SCAN_COUNTS: u32 = TICK_US / SCANS as u32;
/// Prescaler of the tick timer: to 1 MHz.
pub const TICK_PRESCALER: u32 = TIMER_HZ / 1_000_000;

/// Baud rate of the link \[bit/s\]: telemetry takes 7 % of it.
pub const LINK_BAUD: u32 = 921_600;
/// Period of the link task \[ms\].
pub const LINK_PERIOD_MS: u32 = 1;

/// The clocks.
pub fn clocks() -> Config {
    Config::hsi().sysclk(SYSCLK_HZ.Hz())
}

const _: () = {
    // The tick timer divides its clock to 10 ms without a remainder.
    let counts = TIMER_HZ as u64 * TICK_US as u64;
    let scan_counts = TICK_PRESCALER as u64 * SCAN_COUNTS as u64;
    assert!(counts == scan_counts * SCANS as u64 * 1_000_000);
    assert!(TICK_PRESCALER <= 1 << 16);
    assert!(SYSCLK_HZ as u64 * TICK_US as u64 == TICK_CYCLES.get() as u64 * 1_000_000);
};

//! The board: clocks, times, pins and flash sectors. Constants, types and configuration only; the
//! drivers use them. Each board has its own file, selected by a cargo feature, and its memory
//! beside it (the default board's is memory.x in the repository's root).
//!
//! What is the same on every STM32F4, and fixed in the drivers: the update event of TIM2 starts a
//! scan of ADC1; after sixteen of them DMA2 stream 0 requests the interrupt of the tick. TIM3
//! requests the interrupt of the link task every millisecond. TIM5 counts the encoder's edges.

#[cfg(feature = "nucleo-f446re")]
mod nucleo_f446re;
#[cfg(feature = "nucleo-f446re")]
pub use nucleo_f446re::*;

#[cfg(feature = "stm32f407")]
mod stm32f407;
#[cfg(feature = "stm32f407")]
pub use stm32f407::*;

#[cfg(feature = "nucleo-f411re")]
mod nucleo_f411re;
#[cfg(feature = "nucleo-f411re")]
pub use nucleo_f411re::*;

use core::num::NonZeroU32;
use model_core::constants::TICK_PERIOD_MS;
use model_core::sampling::SCANS;
use stm32f4xx_hal::pac::{GPIOA, GPIOB, GPIOC};

/// Tick period \[µs\].
pub const TICK_US: u32 = 1_000 * TICK_PERIOD_MS;
/// CPU cycles per tick.
pub const TICK_CYCLES: NonZeroU32 = NonZeroU32::new(SYSCLK_HZ / 1_000_000 * TICK_US).unwrap();
/// Clock of APB1, on which USART2, SPI2 and SPI3 are \[Hz\]: half that of its timers on every
/// board.
pub const PCLK1_HZ: u32 = TIMER_HZ / 2;
/// Counts of the tick timer from one scan of the converter to the next: one per microsecond.
pub const SCAN_COUNTS: u32 = TICK_US / SCANS as u32;
/// Prescaler of the tick timer: to 1 MHz.
pub const TICK_PRESCALER: u32 = TIMER_HZ / 1_000_000;

/// Baud rate of the link \[bit/s\]: telemetry takes 7 % of it.
pub const LINK_BAUD: u32 = 921_600;
/// Period of the link task \[ms\].
pub const LINK_PERIOD_MS: u32 = 1;

/// The ports that boards use.
pub struct Ports {
    /// Port A.
    pub a: GPIOA,
    /// Port B.
    pub b: GPIOB,
    /// Port C.
    pub c: GPIOC,
}

/// All pins in use, configured.
pub struct Pins {
    /// Strain bridge.
    pub bridge: BridgePin,
    /// Pressure sensor.
    pub pressure: PressurePin,
    /// Encoder A and B.
    pub encoder: EncoderPins,
    /// Valve.
    pub valve: ValvePins,
    /// The bridge's converter.
    #[cfg(feature = "ads1220")]
    pub bridge_converter: BridgeConverterPins,
    /// Link TX and RX.
    pub link: LinkPins,
    /// User button.
    pub button: ButtonPin,
    /// Emergency stop.
    pub stop: StopPins,
    /// Enabling device.
    pub enabling: EnablingPin,
    /// Valve in the muscle's port, low.
    pub port: PortPin,
    /// Status lamp, dark.
    pub lamp: LampPin,
}

const _: () = {
    // The tick timer divides its clock to 10 ms without a remainder.
    let counts = TIMER_HZ as u64 * TICK_US as u64;
    let scan_counts = TICK_PRESCALER as u64 * SCAN_COUNTS as u64;
    assert!(counts == scan_counts * SCANS as u64 * 1_000_000);
    assert!(TIMER_HZ.is_multiple_of(1_000_000) && TICK_PRESCALER <= 1 << 16);
    assert!(SYSCLK_HZ as u64 * TICK_US as u64 == TICK_CYCLES.get() as u64 * 1_000_000);
    // The link's nearest baud rate is within 1 %: both ends tolerate 3.33 % together.
    let divider = (PCLK1_HZ + LINK_BAUD / 2) / LINK_BAUD;
    assert!((divider * LINK_BAUD).abs_diff(PCLK1_HZ) <= PCLK1_HZ / 100);
};

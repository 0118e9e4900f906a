//! The NUCLEO-F446RE: which pin, timer, DMA stream and interrupt does what. docs/wiring.md draws it.
//!
//! | signal          | pin      | peripheral             | served by                        |
//! |-----------------|----------|------------------------|----------------------------------|
//! | strain bridge   | PC0 (A5) | ADC1 channel 10        | DMA2 stream 0 channel 0          |
//! | pressure sensor | PC1 (A4) | ADC1 channel 11        | the same                         |
//! | encoder A, B    | PA0, PA1 | TIM5 channels 1, 2     | 32-bit counter, encoder mode 3   |
//! | valve           | PA4 (A2) | DAC channel 1          | written by the tick              |
//! | link TX         | PA2      | USART2 (the ST-LINK's) | DMA1 stream 6 channel 4          |
//! | link RX         | PA3      | USART2                 | DMA1 stream 5 channel 4          |
//! | user button B1  | PC13     | input, low if pressed  | read by the tick                 |
//!
//! TIM2's update starts the ADC, sixteen conversions later DMA2 stream 0 interrupts: that is the
//! tick. TIM3 interrupts every millisecond: that is the link's turn.

/// The ST-LINK's 8 MHz clock output drives HSE.
pub const HSE_HZ: u32 = 8_000_000;
/// The fastest that an F446 runs, with over-drive.
pub const SYSCLK_HZ: u32 = 180_000_000;
/// APB1 runs at a quarter of SYSCLK, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ / 2;

/// The controller's period.
pub const TICK_US: u32 = 10_000;
/// CPU cycles in a tick.
pub const TICK_CYCLES: u32 = SYSCLK_HZ / 1_000_000 * TICK_US;
/// TIM2 counts microseconds.
pub const TICK_PRESCALER: u32 = 90;
/// Counts of TIM2 in a tick.
pub const TICK_COUNTS: u32 = 10_000;

const _: () = {
    // Exactly: 10 ms × 90 MHz, without a remainder.
    let counts = TIMER_HZ as u64 * TICK_US as u64;
    assert!(counts == TICK_PRESCALER as u64 * TICK_COUNTS as u64 * 1_000_000);
    assert!(TICK_PRESCALER <= 1 << 16);
    assert!(SYSCLK_HZ as u64 * TICK_US as u64 == TICK_CYCLES as u64 * 1_000_000);
    // The controller's own period is the same.
    let tick_s = model_core::settings::TICK_S as f64;
    let error_s = tick_s - TICK_US as f64 * 1e-6;
    assert!(error_s < 1e-9 && error_s > -1e-9);
};

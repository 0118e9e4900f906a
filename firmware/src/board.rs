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

use crate::adc::Scanner;
use crate::encoder::Encoder;
use crate::flash::Store;
use crate::link::Link;
use crate::valve::Valve;
use crate::watchdog::Watchdog;
use core::num::NonZeroU32;
use model_core::link::{Board, Crash, Identity, ResetCause, SettingsSource};
use stm32f4xx_hal::dma::StreamsTuple;
use stm32f4xx_hal::gpio::{Input, PC13};
use stm32f4xx_hal::pac::{self, TIM2, TIM3};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::{Config, Rcc};
use stm32f4xx_hal::timer::{CounterUs, Event};

/// The ST-LINK's 8 MHz clock output drives HSE.
pub const HSE_HZ: u32 = 8_000_000;
/// The fastest that an F446 runs, with over-drive.
pub const SYSCLK_HZ: u32 = 180_000_000;
/// APB1 runs at a quarter of SYSCLK, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ / 2;

/// The controller's period.
pub const TICK_US: u32 = 10_000;
/// CPU cycles in a tick.
pub const TICK_CYCLES: NonZeroU32 = NonZeroU32::new(SYSCLK_HZ / 1_000_000 * TICK_US).unwrap();
/// TIM2 counts microseconds.
pub const TICK_PRESCALER: u32 = 90;
/// Counts of TIM2 in a tick.
pub const TICK_COUNTS: u32 = 10_000;

/// Bits per second of the link: telemetry takes 7 % of it.
pub const LINK_BAUD: u32 = 921_600;
/// How often the link has its turn.
const LINK_TURN_MS: u32 = 1;

const _: () = {
    // Exactly: 10 ms × 90 MHz, without a remainder.
    let counts = TIMER_HZ as u64 * TICK_US as u64;
    assert!(counts == TICK_PRESCALER as u64 * TICK_COUNTS as u64 * 1_000_000);
    assert!(TICK_PRESCALER <= 1 << 16);
    assert!(SYSCLK_HZ as u64 * TICK_US as u64 == TICK_CYCLES.get() as u64 * 1_000_000);
    // The controller's own period is the same.
    let error_s = model_core::settings::TICK_S as f64 - TICK_US as f64 * 1e-6;
    assert!(error_s < 1e-9 && error_s > -1e-9);
};

/// What the application uses, ready for use.
pub struct Parts {
    /// Clocks.
    pub rcc: Rcc,
    /// The watchdog, running, with a long time.
    pub watchdog: Watchdog,
    /// Settings.
    pub store: Store,
    /// Strain bridge and pressure sensor.
    pub scanner: Scanner,
    /// Encoder.
    pub encoder: Encoder,
    /// Button B1, low while pressed.
    pub button: PC13<Input>,
    /// Valve, at zero volts.
    pub valve: Valve,
    /// Link.
    pub link: Link,
    /// The link's turn, running.
    pub link_timer: CounterUs<TIM3>,
    /// What is to start the ticks.
    pub tick_timer: TIM2,
}

impl Parts {
    /// Sets up all of the board.
    pub fn new(device: pac::Peripherals, mut core: cortex_m::Peripherals) -> Parts {
        let watchdog = Watchdog::start(device.IWDG, &device.DBGMCU);
        // The CPU's clock, and with it the cycle counter, runs on in sleep.
        device.DBGMCU.cr().modify(|_, w| w.dbg_sleep().set_bit());
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();

        let config = Config::hse(HSE_HZ.Hz())
            .bypass_hse_oscillator()
            .sysclk(SYSCLK_HZ.Hz());
        let mut rcc = device.RCC.freeze(config);
        assert!(rcc.clocks.sysclk().raw() == SYSCLK_HZ && rcc.clocks.timclk1().raw() == TIMER_HZ);
        let a = device.GPIOA.split(&mut rcc);
        let c = device.GPIOC.split(&mut rcc);
        let valve = Valve::new(device.DAC, a.pa4.into_analog(), &mut rcc);
        let dma1 = StreamsTuple::new(device.DMA1, &mut rcc);
        let dma2 = StreamsTuple::new(device.DMA2, &mut rcc);
        let (bridge, pressure) = (c.pc0.into_analog(), c.pc1.into_analog());
        let scanner = Scanner::new(device.ADC1, dma2.0, bridge, pressure, &mut rcc);
        let encoder = Encoder::new(device.TIM5, a.pa0, a.pa1, &mut rcc);
        let link = Link::new(device.USART2, (a.pa2, a.pa3), (dma1.5, dma1.6), &mut rcc);
        let mut link_timer = device.TIM3.counter_us(&mut rcc);
        link_timer.listen(Event::Update);
        let started = link_timer.start(LINK_TURN_MS.millis());
        assert!(started.is_ok());
        Parts {
            rcc,
            watchdog,
            store: Store::new(device.FLASH),
            scanner,
            encoder,
            button: c.pc13,
            valve,
            link,
            link_timer,
            tick_timer: device.TIM2,
        }
    }
}

/// What the board tells of itself; its counters are still zero.
pub fn identity(reset: ResetCause, crash: Option<Crash>, settings: SettingsSource) -> Identity {
    let number = |text: &str| text.parse().unwrap_or(0);
    Identity {
        firmware: [
            number(env!("CARGO_PKG_VERSION_MAJOR")),
            number(env!("CARGO_PKG_VERSION_MINOR")),
            number(env!("CARGO_PKG_VERSION_PATCH")),
        ],
        commit: u32::from_str_radix(env!("COMMIT"), 16).unwrap_or(0),
        board: Board::NucleoF446re,
        cpu_hz: SYSCLK_HZ,
        reset,
        crash,
        settings,
        stack_free_bytes: 0,
        frames_rejected: 0,
        messages_dropped: 0,
    }
}

//! The board: clocks and times, asserted at compile time, and all devices set up. What differs
//! between boards stands in a file of its own, chosen by a cargo feature; those we have share
//! their pins.

mod pins;

#[cfg(feature = "nucleo-f446re")]
mod nucleo_f446re;
#[cfg(feature = "nucleo-f446re")]
pub use nucleo_f446re::*;

#[cfg(all(feature = "stm32f407", not(feature = "nucleo-f446re")))]
mod stm32f407;
#[cfg(all(feature = "stm32f407", not(feature = "nucleo-f446re")))]
pub use stm32f407::*;

use crate::adc::Scanner;
use crate::encoder::Encoder;
use crate::flash::Store;
use crate::link::Link;
use crate::valve::Valve;
use crate::watchdog::Watchdog;
use core::num::NonZeroU32;
use model_core::constants::TICK_PERIOD_MS;
use model_core::link::{Identity, Note, ResetCause, SettingsSource};
use stm32f4xx_hal::dma::StreamsTuple;
use stm32f4xx_hal::pac::{self, TIM2, TIM3};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;
use stm32f4xx_hal::timer::{CounterUs, Event};

/// APB1 runs at a quarter of SYSCLK, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ / 2;

/// The controller's period.
pub const TICK_US: u32 = 1_000 * TICK_PERIOD_MS;
/// CPU cycles in a tick.
pub const TICK_CYCLES: NonZeroU32 = NonZeroU32::new(SYSCLK_HZ / 1_000_000 * TICK_US).unwrap();
/// Counts of TIM2 in a tick: microseconds.
pub const TICK_COUNTS: u32 = 10_000;

/// Bits per second of the link: telemetry takes 7 % of it.
pub const LINK_BAUD: u32 = 921_600;
/// How often the link has its turn.
const LINK_TURN_MS: u32 = 1;

const _: () = {
    // Exactly 10 ms, without a remainder.
    let counts = TIMER_HZ as u64 * TICK_US as u64;
    assert!(counts == TICK_PRESCALER as u64 * TICK_COUNTS as u64 * 1_000_000);
    assert!(TICK_PRESCALER <= 1 << 16);
    assert!(SYSCLK_HZ as u64 * TICK_US as u64 == TICK_CYCLES.get() as u64 * 1_000_000);
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
    /// The button.
    pub button: Button,
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

        let mut rcc = device.RCC.freeze(clock_source().sysclk(SYSCLK_HZ.Hz()));
        assert!(rcc.clocks.sysclk().raw() == SYSCLK_HZ && rcc.clocks.timclk1().raw() == TIMER_HZ);
        let pins = Pins::new(device.GPIOA, device.GPIOC, &mut rcc);
        let valve = Valve::new(device.DAC, pins.valve, &mut rcc);
        let dma1 = StreamsTuple::new(device.DMA1, &mut rcc);
        let dma2 = StreamsTuple::new(device.DMA2, &mut rcc);
        let scanner = Scanner::new(device.ADC1, dma2.0, pins.bridge, pins.pressure, &mut rcc);
        let encoder = Encoder::new(device.TIM5, pins.encoder, &mut rcc);
        let link = Link::new(device.USART2, pins.link, (dma1.5, dma1.6), &mut rcc);
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
            button: pins.button,
            valve,
            link,
            link_timer,
            tick_timer: device.TIM2,
        }
    }
}

/// What the board tells of itself; its counters are still zero.
pub fn identity(reset: ResetCause, note: Note, settings: SettingsSource) -> Identity {
    let number = |text: &str| text.parse().unwrap_or(0);
    Identity {
        firmware: [
            number(env!("CARGO_PKG_VERSION_MAJOR")),
            number(env!("CARGO_PKG_VERSION_MINOR")),
            number(env!("CARGO_PKG_VERSION_PATCH")),
        ],
        commit: u32::from_str_radix(env!("COMMIT"), 16).unwrap_or(0),
        board: BOARD,
        cpu_hz: SYSCLK_HZ,
        reset,
        crash: note.crash,
        fault: note.fault,
        settings,
        stack_free_bytes: 0,
        frames_rejected: 0,
        messages_dropped: 0,
    }
}

//! Device drivers, one file per device. They implement what the HAL lacks and take
//! `embedded-hal` 1.0 traits where one exists; it has none for an ADC, a DAC, an encoder, a
//! watchdog, flash or DMA. Pins, clocks and sectors come from [`board`].

pub mod adc;
pub mod button;
pub mod encoder;
pub mod flash;
pub mod output;
pub mod serial;
pub mod stop;
pub mod tick_timer;
pub mod valve;
pub mod watchdog;

use crate::board::{self, ButtonPin, LampPin, Pins, PortPin, StopPins};
use adc::Adc;
use button::Button;
use encoder::Encoder;
use flash::Store;
use output::Output;
use serial::Serial;
use stm32f4xx_hal::dma::StreamsTuple;
use stm32f4xx_hal::pac::{self, TIM3};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::timer::{CounterUs, Event, SysDelay};
use stop::Stop;
use tick_timer::TickTimer;
use valve::Valve;
use watchdog::Watchdog;

/// All devices of the board, ready for use.
pub struct Devices {
    /// Watchdog, running with the long timeout.
    pub watchdog: Watchdog,
    /// Stored settings.
    pub store: Store,
    /// Strain bridge and pressure sensor.
    pub adc: Adc,
    /// Encoder, counting.
    pub encoder: Encoder,
    /// User button.
    pub button: Button<ButtonPin>,
    /// Emergency stop.
    pub stop: Stop<StopPins>,
    /// Valve, at 0 V.
    pub valve: Valve,
    /// Pulses for the valve in the muscle's port, low.
    pub port: Output<PortPin>,
    /// Status lamp, dark.
    pub lamp: Output<LampPin>,
    /// Serial port of the link, receiving.
    pub serial: Serial,
    /// Timer of the link task, running.
    pub link_timer: CounterUs<TIM3>,
    /// Timer of the ticks, stopped.
    pub tick_timer: TickTimer,
    /// SysTick as a delay.
    pub delay: SysDelay,
}

impl Devices {
    /// Starts the watchdog, then the clocks, then all other devices.
    pub fn new(device: pac::Peripherals, mut core: cortex_m::Peripherals) -> Devices {
        // Keeps the CPU clock, and with it the cycle counter, running in sleep mode.
        device.DBGMCU.cr().modify(|_, w| w.dbg_sleep().set_bit());
        let watchdog = Watchdog::start(device.IWDG, device.DBGMCU);
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();

        let mut rcc = device.RCC.freeze(board::clocks());
        assert!(rcc.clocks.sysclk().raw() == board::SYSCLK_HZ);
        assert!(rcc.clocks.timclk1().raw() == board::TIMER_HZ);
        let pins = Pins::new(device.GPIOA, device.GPIOB, device.GPIOC, &mut rcc);
        let valve = Valve::new(device.DAC, pins.valve, &mut rcc);
        let dma1 = StreamsTuple::new(device.DMA1, &mut rcc);
        let dma2 = StreamsTuple::new(device.DMA2, &mut rcc);
        let adc = Adc::new(device.ADC1, dma2.0, pins.bridge, pins.pressure, &mut rcc);
        let encoder = Encoder::new(device.TIM5, pins.encoder, &mut rcc);
        let serial = Serial::new(device.USART2, pins.link, (dma1.5, dma1.6), &mut rcc);
        let mut link_timer = device.TIM3.counter_us(&mut rcc);
        link_timer.listen(Event::Update);
        let started = link_timer.start(board::LINK_PERIOD_MS.millis());
        assert!(started.is_ok());
        Devices {
            watchdog,
            store: Store::new(device.FLASH),
            adc,
            encoder,
            button: Button(pins.button),
            stop: Stop(pins.stop),
            valve,
            port: Output(pins.port),
            lamp: Output(pins.lamp),
            serial,
            link_timer,
            tick_timer: TickTimer::new(device.TIM2, &mut rcc),
            delay: core.SYST.delay(&rcc.clocks),
        }
    }
}

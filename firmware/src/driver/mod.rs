//! What binds devices to the chip: the units of the STM32F4 behind the traits of `rig-drivers`, and
//! what has no such trait (converter, serial port, tick timer), one file per unit. Pins, clocks and
//! sectors come from [`board`].

pub mod adc;
#[cfg(feature = "ads1220")]
pub mod bridge_converter;
pub mod counter;
pub mod flash;
pub mod iwdg;
pub mod serial;
pub mod slow_counter;
pub mod tick_timer;

#[cfg(not(feature = "mcp4922"))]
pub mod dac;
#[cfg(not(feature = "mcp4922"))]
pub use dac as valve;
#[cfg(any(feature = "mcp4922", feature = "ads1220"))]
pub mod spi_bus;
#[cfg(feature = "mcp4922")]
pub mod spi_dac;
#[cfg(feature = "mcp4922")]
pub use spi_dac as valve;

use crate::board::{self, ButtonPin, EnablingPin, LampPin, PortPin, Ports, StopPins};
use crate::{crash, ram};
use adc::Adc;
#[cfg(feature = "ads1220")]
use bridge_converter::BridgeConverter;
use counter::Counter;
use flash::Flash;
use iwdg::Iwdg;
use model_core::link;
use model_core::start::StartFindings;
use rig_drivers::button::Button;
use rig_drivers::contact::Contact;
use rig_drivers::encoder::Encoder;
use rig_drivers::output::Output;
use rig_drivers::stop::Stop;
use rig_drivers::store::Store;
use rig_drivers::watchdog::Watchdog;
use serial::Serial;
use slow_counter::SlowCounter;
use stm32f4xx_hal::dma::StreamsTuple;
use stm32f4xx_hal::pac::{self, PWR, RCC, TIM3};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;
use stm32f4xx_hal::timer::{CounterUs, Event, SysDelay};
use tick_timer::TickTimer;
use valve::Valve;

/// All devices of the board, ready for use.
pub struct Devices {
    /// Watchdog, running with the long timeout.
    pub watchdog: Watchdog<Iwdg>,
    /// Stored settings.
    pub store: Store<Flash>,
    /// Strain bridge and pressure sensor.
    pub adc: Adc,
    /// Encoder, counting.
    pub encoder: Encoder<Counter>,
    /// User button.
    pub button: Button<ButtonPin>,
    /// Emergency stop.
    pub stop: Stop<StopPins>,
    /// Enabling device.
    pub enabling: Contact<EnablingPin>,
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
    #[cfg(not(feature = "ads1220"))]
    pub tick_timer: TickTimer,
    /// The bridge's converter, with the timer of the ticks, stopped.
    #[cfg(feature = "ads1220")]
    pub bridge_converter: BridgeConverter,
    /// Counter on the watchdog's oscillator.
    pub slow_counter: SlowCounter,
    /// What the start-up self-test has measured.
    pub findings: StartFindings,
    /// SysTick as a delay.
    pub delay: SysDelay,
}

impl Devices {
    /// Starts the watchdog, then the clocks, then all other devices.
    pub fn new(device: pac::Peripherals, mut core: cortex_m::Peripherals) -> Devices {
        // Keeps the CPU clock, and with it the cycle counter, running in sleep mode.
        device.DBGMCU.cr().modify(|_, w| w.dbg_sleep().set_bit());
        let watchdog = Watchdog::new(Iwdg::start(device.IWDG, device.DBGMCU));
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();

        let (mut rcc, regulator) = start_clocks(device.RCC, &device.PWR);
        assert!(rcc.clocks.sysclk().raw() == board::SYSCLK_HZ);
        assert!(rcc.clocks.timclk1().raw() == board::TIMER_HZ);
        assert!(rcc.clocks.pclk1().raw() == board::PCLK1_HZ);
        // Before any DMA.
        let stack_free_bytes = crash::stack_free_bytes();
        let ram = ram::holds_patterns();
        let flash = Flash::new(device.FLASH);
        let image = link::check_image(flash::program());
        let ports = Ports {
            a: device.GPIOA,
            b: device.GPIOB,
            c: device.GPIOC,
        };
        let pins = board::pins(ports, &mut rcc);
        #[cfg(not(feature = "mcp4922"))]
        let unit: valve::Unit = device.DAC;
        #[cfg(feature = "mcp4922")]
        let unit: valve::Unit = device.SPI2;
        let mut delay = core.SYST.delay(&rcc.clocks);
        let mut valve = Valve::new(unit, pins.valve, &mut rcc);
        let dma1 = StreamsTuple::new(device.DMA1, &mut rcc);
        let dma2 = StreamsTuple::new(device.DMA2, &mut rcc);
        let adc = Adc::new(
            device.ADC1,
            dma2.0,
            pins.bridge,
            pins.pressure,
            &mut valve,
            &mut delay,
            &mut rcc,
        );
        let findings = StartFindings {
            image,
            ram,
            stack_free_bytes,
            reference: (adc.start_reference, adc::calibrated_reference()),
            regulator,
            valve: adc.start_valve,
            valve_limits: valve::READ_BACK,
            brown_out_level: flash.brown_out_level(),
        };
        let encoder = Encoder::new(Counter::new(device.TIM5, pins.encoder, &mut rcc));
        let serial = Serial::new(device.USART2, pins.link, (dma1.5, dma1.6), &mut rcc);
        let mut link_timer = device.TIM3.counter_us(&mut rcc);
        link_timer.listen(Event::Update);
        let started = link_timer.start(board::LINK_PERIOD_MS.millis());
        assert!(started.is_ok());
        let tick_timer = TickTimer::new(device.TIM2, &mut rcc);
        let slow_counter = SlowCounter::start(device.RTC, &rcc, &device.PWR);
        Devices {
            watchdog,
            store: Store(flash),
            slow_counter,
            findings,
            adc,
            encoder,
            button: Button(pins.button),
            stop: Stop(pins.stop),
            enabling: Contact(pins.enabling),
            valve,
            port: Output(pins.port),
            lamp: Output(pins.lamp),
            serial,
            link_timer,
            #[cfg(not(feature = "ads1220"))]
            tick_timer,
            #[cfg(feature = "ads1220")]
            bridge_converter: BridgeConverter::new(
                device.SPI3,
                pins.bridge_converter,
                tick_timer,
                &mut rcc,
            ),
            delay,
        }
    }
}

/// Reads of the regulator's flag before it counts as missing: more than 4 ms at 72 MHz, if each
/// takes three cycles.
const REGULATOR_READS: u32 = 100_000;

/// Starts the clocks; false if the regulator of the core does not report its voltage.
///
/// The regulator leaves its lowest voltage only when the PLL is on, and the HAL does not wait for
/// it. The CPU's clock is therefore halved until then, which the lowest voltage allows: 64 MHz
/// (F411), 120 MHz (F446). The second time nothing but this divider changes.
fn start_clocks(rcc: RCC, power: &PWR) -> (Rcc, bool) {
    rcc.apb1enr().modify(|_, w| w.pwren().set_bit());
    // A unit takes two cycles to get its clock.
    cortex_m::asm::dsb();
    let config = board::clocks(power);
    let (mut rcc, mut ready) = (rcc.constrain(), false);
    // A loop, so that the image has this function of the HAL only once.
    for divider in [2, 1] {
        rcc = rcc.freeze(config.hclk((board::SYSCLK_HZ / divider).Hz()));
        ready = (0..REGULATOR_READS).any(|_| power.csr().read().vosrdy().bit_is_set());
    }
    (rcc, ready)
}

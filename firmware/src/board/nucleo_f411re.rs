//! NUCLEO-F411RE: STM32F411RET6. The chip has no DAC: the valve's voltage comes from an MCP4922 at
//! SPI2. Its image runs on the emulated board, and has never run on a real one: measure before use.
//!
//! | signal          | pin      | peripheral             | served by                        |
//! |-----------------|----------|------------------------|----------------------------------|
//! | strain bridge   | PC0 (A5) | ADC1 channel 10        | DMA2 stream 0 channel 0          |
//! | pressure sensor | PC1 (A4) | ADC1 channel 11        | DMA2 stream 0 channel 0          |
//! | encoder A, B    | PA0, PA1 | TIM5 channels 1, 2     | 32-bit counter, encoder mode 3   |
//! | valve: SCK, SDI | PB13, PB15 | SPI2, to an MCP4922 | written by the tick              |
//! | valve: CS, SHDN | PB12, PB14 | outputs, CS high if idle; SHDN low shuts down | the same |
//! | valve, read back | PA4 (A2) | ADC1 channel 4        | DMA2 stream 0 channel 0         |
//! | link TX         | PA2      | USART2 (the ST-LINK's) | DMA1 stream 6 channel 4          |
//! | link RX         | PA3      | USART2                 | DMA1 stream 5 channel 4          |
//! | user button B1  | PC13     | input, low if pressed  | read by the tick                 |
//! | emergency stop  | PB10 (D6), PA8 (D7) | inputs, low if open | read by the tick         |
//! | enabling device | PC7 (D9) | input, low if open    | read by the tick                 |
//! | valve in the port | PB5 (D4) | output, alternates   | written by the tick              |
//! | status lamp     | PA5 (D13, LD2) | output, high is lit | written by the tick              |
//!
//! With the feature `ads1220` an ADS1220 at SPI3 reads the strain bridge, and PC0 half of the
//! bridge's supply:
//!
//! | signal          | pin      | peripheral             | served by                        |
//! |-----------------|----------|------------------------|----------------------------------|
//! | bridge: SCLK, DOUT, DIN | PC10, PC11, PC12 | SPI3, to an ADS1220 | read at each scan   |
//! | bridge: CS, DRDY | PB7, PC2 | output, high if idle; input, low if ready | the same        |
//!
//! Chip and memory are in `nucleo_f411re.x`.

use super::{Pins, Ports};
use core::ops::Range;
use stm32f4xx_hal::gpio::{
    Alternate, Analog, Input, Output, PA0, PA1, PA2, PA3, PA4, PA5, PA8, PB5, PB10, PB12, PB13,
    PB14, PB15, PC0, PC1, PC7, PC13, Speed,
};
#[cfg(feature = "ads1220")]
use stm32f4xx_hal::gpio::{PB7, PC2, PC10, PC11, PC12};
use stm32f4xx_hal::pac::{GPIOB, PWR};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::{Config, Rcc};

/// The board's name, as the link reports it.
pub const NAME: &str = "NUCLEO-F411RE";

/// Flash sectors of the settings: number, and range as offset from the start of the flash.
/// nucleo_f411re.x keeps the program out of them.
pub const SETTINGS_SECTORS: [(u8, Range<usize>); 2] =
    [(6, 0x4_0000..0x6_0000), (7, 0x6_0000..0x8_0000)];

/// CPU clock \[Hz\], by PLL from the chip's own oscillator (HSI, 16 MHz): no plug, probe or crystal
/// can take it away. HSI is within 1 % at 25 °C, within 4 % from -10 to 85 °C (datasheet): at most
/// 99.8 of 100 MHz, with 3 wait states of the flash; APB1 49.9 of 50 MHz, and the PLL's oscillator,
/// of which the HAL makes 384 MHz, 399 of 432 MHz. (From 72 MHz the HAL would make 432 MHz: above
/// the limit with any HSI that is fast.) The divider of [`super::LINK_BAUD`] is off by 0.16 %,
/// exactly as the ST-LINK's is.
pub const SYSCLK_HZ: u32 = 96_000_000;
/// PWR_CR.VOS for up to 100 MHz.
const VOS_SCALE_1: u8 = 0b11;
/// Clock of the timers on APB1 \[Hz\]: APB1 runs at SYSCLK / 2, its timers at twice that.
pub const TIMER_HZ: u32 = SYSCLK_HZ;

/// The clocks. Sets the regulator to scale 1 first, which the HAL does not: scale 2, the one after
/// a reset, is for 84 MHz. The scale takes effect when the PLL starts.
pub fn clocks(power: &PWR) -> Config {
    // SAFETY: the register's manual has this value.
    #[allow(unsafe_code)]
    power
        .cr()
        .modify(|_, w| unsafe { w.vos().bits(VOS_SCALE_1) });
    Config::hsi().sysclk(SYSCLK_HZ.Hz())
}

/// Strain bridge.
pub type BridgePin = PC0<Analog>;
/// Pressure sensor.
pub type PressurePin = PC1<Analog>;
/// Encoder A and B.
pub type EncoderPins = (PA0<Alternate<2>>, PA1<Alternate<2>>);
/// Chip select of the valve's converter.
pub type ValveSelectPin = PB12<Output>;
/// Shutdown of the valve's converter, with a pull-down of 10 kΩ.
pub type ValveShutdownPin = PB14<Output>;
/// The valve's voltage, read back.
pub type ValveReadBackPin = PA4<Analog>;

/// The valve's converter.
pub struct ValvePins {
    /// SCK.
    pub clock: PB13<Alternate<5>>,
    /// SDI.
    pub data: PB15<Alternate<5>>,
    /// CS.
    pub select: ValveSelectPin,
    /// SHDN.
    pub shutdown: ValveShutdownPin,
    /// VOUTA.
    pub read_back: ValveReadBackPin,
}

/// Chip select of the bridge's converter.
#[cfg(feature = "ads1220")]
pub type BridgeSelectPin = PB7<Output>;
/// Data ready of the bridge's converter, with pull-up.
#[cfg(feature = "ads1220")]
pub type BridgeReadyPin = PC2<Input>;

/// The bridge's converter.
#[cfg(feature = "ads1220")]
pub struct BridgeConverterPins {
    /// SCLK.
    pub clock: PC10<Alternate<6>>,
    /// DOUT.
    pub data_out: PC11<Alternate<6>>,
    /// DIN.
    pub data_in: PC12<Alternate<6>>,
    /// CS.
    pub select: BridgeSelectPin,
    /// DRDY.
    pub ready: BridgeReadyPin,
}

/// Link TX and RX.
pub type LinkPins = (PA2, PA3);
/// User button, with pull-up.
pub type ButtonPin = PC13<Input>;
/// Contacts of the emergency stop, with pull-down.
pub type StopPins = (PB10<Input>, PA8<Input>);
/// Contact of the enabling device, with pull-down.
pub type EnablingPin = PC7<Input>;
/// Pulses for the valve in the muscle's port.
pub type PortPin = PB5<Output>;
/// Status lamp.
pub type LampPin = PA5<Output>;

/// Configures the pins.
pub fn pins(ports: Ports, rcc: &mut Rcc) -> Pins {
    let a = ports.a.split(rcc);
    let b = ports.b.split(rcc);
    let c = ports.c.split(rcc);
    Pins {
        bridge: c.pc0.into_analog(),
        pressure: c.pc1.into_analog(),
        encoder: (
            a.pa0.into_alternate().internal_pull_up(true),
            a.pa1.into_alternate().internal_pull_up(true),
        ),
        valve: ValvePins {
            // At the lowest speed a pin is for up to 4 MHz.
            clock: b.pb13.into_alternate().speed(Speed::Medium),
            data: b.pb15.into_alternate().speed(Speed::Medium),
            select: b.pb12.into_push_pull_output(),
            shutdown: b.pb14.into_push_pull_output(),
            read_back: a.pa4.into_analog(),
        },
        #[cfg(feature = "ads1220")]
        bridge_converter: BridgeConverterPins {
            clock: c.pc10.into_alternate().speed(Speed::Medium),
            data_out: c.pc11.into_alternate(),
            data_in: c.pc12.into_alternate().speed(Speed::Medium),
            select: b.pb7.into_push_pull_output(),
            ready: c.pc2.into_pull_up_input(),
        },
        link: (a.pa2, a.pa3),
        button: c.pc13.into_pull_up_input(),
        stop: (b.pb10.into_pull_down_input(), a.pa8.into_pull_down_input()),
        enabling: c.pc7.into_pull_down_input(),
        port: b.pb5.into_push_pull_output(),
        lamp: a.pa5.into_push_pull_output(),
    }
}

/// Shuts the valve's converter down, from any context.
pub fn shut_valve_converter_down() {
    // SAFETY: a single write, which changes the output PB14 only.
    #[allow(unsafe_code)]
    let port = unsafe { GPIOB::steal() };
    port.bsrr().write(|w| w.br14().set_bit());
}

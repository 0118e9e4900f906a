//! Strain bridge, pressure sensor, internal reference and valve's voltage: the tick timer triggers
//! scans of ADC1 at equal intervals over the whole period of a tick, and the DMA writes them to
//! RAM.

use super::valve::Valve;
use crate::board::{BridgePin, PressurePin};
use core::ops::Range;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embedded_hal::delay::DelayNs;
use model_core::sampling::{INPUTS, NOT_CONVERTED, SAMPLES, Sampler, WORDS};
use model_core::signal::{AdcCount, DacCount};
use model_core::start::{VALVE_LEVELS, valve_level};
use rig_drivers::valve::AnalogOutput;
use stm32f4xx_hal::adc::config::{
    AdcConfig, Clock, Dma, ExternalTrigger, SampleTime, Scan, Sequence, TriggerMode,
};
use stm32f4xx_hal::dma::{
    DmaChannel, DmaDataSize, DmaDirection, DmaEvent, DmaFlag, Stream0, config::Priority,
    traits::Stream,
};
use stm32f4xx_hal::pac::{ADC1, DMA2};
use stm32f4xx_hal::rcc::Rcc;
use stm32f4xx_hal::signature::VrefCal;
use stm32f4xx_hal::{ClearFlags, Listen, adc};

/// The buffer of the DMA, half-words in pairs: atomics, because the CPU reads while the DMA may
/// write.
static CONVERSIONS: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// Addresses of that buffer.
pub fn buffer() -> Range<u32> {
    let Range { start, end } = CONVERSIONS.as_ptr_range();
    start as u32..end as u32
}

/// Time for the reference and for the valve's voltage to settle \[µs\].
const SETTLE_US: u32 = 20;

/// The converter, [`SAMPLES`] conversions per tick.
pub struct Adc {
    stream: Stream0<DMA2>,
    sampler: Sampler,
    /// Before the first tick: the internal reference \[counts\].
    pub start_reference: u16,
    /// The valve's voltage at each of [`VALVE_LEVELS`] \[counts\].
    pub start_valve: [u16; VALVE_LEVELS.len()],
}

impl Adc {
    /// Sets up ADC and DMA; the conversions start with the tick timer.
    pub fn new(
        adc1: ADC1,
        mut stream: Stream0<DMA2>,
        bridge: BridgePin,
        pressure: PressurePin,
        valve: &mut Valve,
        delay: &mut impl DelayNs,
        rcc: &mut Rcc,
    ) -> Adc {
        let config = AdcConfig::default()
            .clock(Clock::Pclk2_div_4)
            .scan(Scan::Enabled)
            .external_trigger(TriggerMode::RisingEdge, ExternalTrigger::Tim_2_trgo)
            .dma(Dma::Continuous);
        let mut adc = adc::Adc::new(adc1, true, config, rcc);
        adc.enable_temperature_and_vref();
        let (start_reference, start_valve) = first_readings(&mut adc, valve, delay);
        // At 18 MHz (24 MHz, F411) 84 cycles are 4.7 µs (3.5 µs), and 480 are 26 µs (20 µs): the
        // reference needs 10 µs. Through the 15 kΩ of the chip's DAC 84 cycles are 32 time
        // constants of the sampling capacitor (F411: its converter has a buffer).
        adc.configure_channel(&bridge, Sequence::One, SampleTime::Cycles_84);
        adc.configure_channel(&pressure, Sequence::Two, SampleTime::Cycles_84);
        adc.configure_channel(&adc::Vref, Sequence::Three, SampleTime::Cycles_480);
        adc.configure_channel(&valve.read_back, Sequence::Four, SampleTime::Cycles_84);
        const { assert!(INPUTS == 4) };
        stream.set_channel(DmaChannel::Channel0);
        stream.set_direction(DmaDirection::PeripheralToMemory);
        stream.set_peripheral_address(adc.data_register_address());
        stream.set_memory_address(CONVERSIONS.as_ptr() as u32);
        stream.set_number_of_transfers(SAMPLES as u16);
        stream.set_memory_increment(true);
        // Circular: a late tick reads newer conversions, and the stream needs no restart.
        stream.set_circular_mode(true);
        stream.set_priority(Priority::VeryHigh);
        stream.listen(DmaEvent::TransferComplete);
        // SAFETY: address and length are those of the static CONVERSIONS; the item sizes match.
        #[allow(unsafe_code)]
        unsafe {
            stream.set_memory_size(DmaDataSize::HalfWord);
            stream.set_peripheral_size(DmaDataSize::HalfWord);
            stream.enable();
        }
        let sampler = Sampler::new(calibrated_reference());
        Adc {
            stream,
            sampler,
            start_reference,
            start_valve,
        }
    }

    /// The readings of bridge and pressure sensor over the last period, and of the valve's voltage
    /// at its end. Clears the interrupt of the DMA stream.
    pub fn read(&mut self) -> [AdcCount; 3] {
        self.stream.clear_flags(DmaFlag::TransferComplete);
        let conversions = core::array::from_fn(|n| CONVERSIONS[n].load(Relaxed));
        // Only the last ones, which the DMA replaces just before the next tick: a late tick must
        // not overwrite conversions of the period that has begun.
        CONVERSIONS[WORDS - 1].store(NOT_CONVERTED, Relaxed);
        let readings = self.sampler.readings(&conversions);
        #[cfg(feature = "ads1220")]
        let readings = {
            let [half_supply, pressure, read_back] = readings;
            [
                super::bridge_converter::read(half_supply),
                pressure,
                read_back,
            ]
        };
        readings
    }
}

/// The internal reference at 3.3 V, measured in the factory \[counts\].
pub fn calibrated_reference() -> u16 {
    VrefCal::get().read()
}

/// The internal reference, and the valve's voltage at each of [`VALVE_LEVELS`], for the start-up
/// self-test. Leaves the valve at 0 V.
fn first_readings(
    adc: &mut adc::Adc<ADC1>,
    valve: &mut Valve,
    delay: &mut impl DelayNs,
) -> (u16, [u16; VALVE_LEVELS.len()]) {
    // The reference starts in 10 µs.
    delay.delay_us(SETTLE_US);
    let reference = adc.convert(&adc::Vref, SampleTime::Cycles_480);
    // The first level is 0 V: a converter that hangs does so before the voltage rises.
    let levels = core::array::from_fn(|index| {
        valve.set(valve_level(index));
        delay.delay_us(SETTLE_US);
        adc.convert(&valve.read_back, SampleTime::Cycles_480)
    });
    valve.set(DacCount::default());
    (reference, levels)
}

//! Strain bridge and pressure sensor: the tick timer triggers a scan of ADC1, and the DMA
//! writes it to RAM.

use crate::board::{BridgePin, PressurePin};
use core::sync::atomic::{AtomicU16, Ordering::Relaxed};
use model_core::sampling::{self, INPUTS, SCAN_LEN};
use model_core::signal::AdcCount;
use stm32f4xx_hal::adc::config::{
    AdcConfig, Clock, Dma, ExternalTrigger, SampleTime, Scan, Sequence, TriggerMode,
};
use stm32f4xx_hal::dma::{
    DmaChannel, DmaDataSize, DmaDirection, DmaEvent, DmaFlag, Stream0, config::Priority,
    traits::Stream,
};
use stm32f4xx_hal::pac::{ADC1, DMA2};
use stm32f4xx_hal::rcc::Rcc;
use stm32f4xx_hal::{ClearFlags, Listen, adc};

/// The buffer of the DMA: atomics, because the CPU reads while the DMA may write.
static SCAN: [AtomicU16; SCAN_LEN] = [const { AtomicU16::new(0) }; SCAN_LEN];

/// The converter, one scan of [`SCAN_LEN`] conversions per tick.
pub struct Adc {
    stream: Stream0<DMA2>,
}

impl Adc {
    /// Sets up ADC and DMA; the conversions start with the tick timer.
    pub fn new(
        adc1: ADC1,
        mut stream: Stream0<DMA2>,
        bridge: BridgePin,
        pressure: PressurePin,
        rcc: &mut Rcc,
    ) -> Adc {
        let config = AdcConfig::default()
            .clock(Clock::Pclk2_div_4)
            .scan(Scan::Enabled)
            .external_trigger(TriggerMode::RisingEdge, ExternalTrigger::Tim_2_trgo)
            .dma(Dma::Continuous);
        let mut adc = adc::Adc::new(adc1, true, config, rcc);
        for rank in (0..SCAN_LEN as u8).step_by(INPUTS) {
            let time = SampleTime::Cycles_84;
            adc.configure_channel(&bridge, Sequence::from(rank), time);
            adc.configure_channel(&pressure, Sequence::from(rank + 1), time);
        }
        stream.set_channel(DmaChannel::Channel0);
        stream.set_direction(DmaDirection::PeripheralToMemory);
        stream.set_peripheral_address(adc.data_register_address());
        stream.set_memory_address(SCAN.as_ptr() as u32);
        stream.set_number_of_transfers(SCAN_LEN as u16);
        stream.set_memory_increment(true);
        // Circular: a late tick reads a newer scan, and the stream needs no restart.
        stream.set_circular_mode(true);
        stream.set_priority(Priority::VeryHigh);
        stream.listen(DmaEvent::TransferComplete);
        // SAFETY: address and length are those of the static SCAN; the item sizes match.
        #[allow(unsafe_code)]
        unsafe {
            stream.set_memory_size(DmaDataSize::HalfWord);
            stream.set_peripheral_size(DmaDataSize::HalfWord);
            stream.enable();
        }
        Adc { stream }
    }

    /// The mean readings of bridge and pressure sensor in the completed scan. Clears the
    /// interrupt of the DMA stream.
    pub fn read(&mut self) -> (AdcCount, AdcCount) {
        self.stream.clear_flags(DmaFlag::TransferComplete);
        let scan = core::array::from_fn(|rank| SCAN[rank].load(Relaxed));
        (sampling::mean(&scan, 0), sampling::mean(&scan, 1))
    }
}

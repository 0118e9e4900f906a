//! Strain bridge and pressure sensor: the timer starts a scan, DMA brings it to RAM.

use crate::board::{self, BridgePin, PressurePin};
use core::sync::atomic::{AtomicU16, Ordering::Relaxed};
use model_core::sampling::{self, INPUTS, SCAN_LEN};
use model_core::signal::AdcCount;
use stm32f4xx_hal::adc::{
    Adc,
    config::{AdcConfig, Clock, Dma, ExternalTrigger, SampleTime, Scan, Sequence, TriggerMode},
};
use stm32f4xx_hal::dma::{
    DmaChannel, DmaDataSize, DmaDirection, DmaEvent, DmaFlag, Stream0, config::Priority,
    traits::Stream,
};
use stm32f4xx_hal::pac::{ADC1, DMA2, TIM2};
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};
use stm32f4xx_hal::{ClearFlags, Listen};

/// What the DMA writes: atomics, as the CPU reads it meanwhile.
static SCAN: [AtomicU16; SCAN_LEN] = [const { AtomicU16::new(0) }; SCAN_LEN];

/// The conversions of each tick.
pub struct Scanner {
    stream: Stream0<DMA2>,
}

impl Scanner {
    /// Prepares ADC and DMA; nothing is converted until [`start_ticks`].
    pub fn new(
        adc: ADC1,
        mut stream: Stream0<DMA2>,
        bridge: BridgePin,
        pressure: PressurePin,
        rcc: &mut Rcc,
    ) -> Scanner {
        let config = AdcConfig::default()
            .clock(Clock::Pclk2_div_4)
            .scan(Scan::Enabled)
            .external_trigger(TriggerMode::RisingEdge, ExternalTrigger::Tim_2_trgo)
            .dma(Dma::Continuous);
        let mut adc = Adc::new(adc, true, config, rcc);
        for place in (0..SCAN_LEN as u8).step_by(INPUTS) {
            let time = SampleTime::Cycles_84;
            adc.configure_channel(&bridge, Sequence::from(place), time);
            adc.configure_channel(&pressure, Sequence::from(place + 1), time);
        }
        stream.set_channel(DmaChannel::Channel0);
        stream.set_direction(DmaDirection::PeripheralToMemory);
        stream.set_peripheral_address(adc.data_register_address());
        stream.set_memory_address(SCAN.as_ptr() as u32);
        stream.set_number_of_transfers(SCAN_LEN as u16);
        stream.set_memory_increment(true);
        // Circular: a tick that comes late finds a newer scan, and nothing has to be restarted.
        stream.set_circular_mode(true);
        stream.set_priority(Priority::VeryHigh);
        stream.listen(DmaEvent::TransferComplete);
        // SAFETY: address and length are those of SCAN, which lives for ever; sizes match.
        #[allow(unsafe_code)]
        unsafe {
            stream.set_memory_size(DmaDataSize::HalfWord);
            stream.set_peripheral_size(DmaDataSize::HalfWord);
            stream.enable();
        }
        Scanner { stream }
    }

    /// The readings of bridge and pressure sensor of the scan that has ended.
    pub fn read(&mut self) -> (AdcCount, AdcCount) {
        self.stream.clear_flags(DmaFlag::TransferComplete);
        let scan = core::array::from_fn(|n| SCAN[n].load(Relaxed));
        (sampling::mean(&scan, 0), sampling::mean(&scan, 1))
    }
}

/// From now on TIM2 starts a scan every 10 ms.
pub fn start_ticks(timer: TIM2, rcc: &mut Rcc) {
    TIM2::enable(rcc);
    TIM2::reset(rcc);
    timer
        .psc()
        .write(|w| w.psc().set((board::TICK_PRESCALER - 1) as u16));
    timer.arr().write(|w| w.set(board::TICK_COUNTS - 1));
    timer.cr2().write(|w| w.mms().update());
    // An update takes the prescaler over, and is the first trigger.
    timer.egr().write(|w| w.ug().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
}

//! The strain bridge with a converter of its own: an ADS1220 on SPI3, read whenever the tick timer
//! starts a scan of ADC1. So a tick's reading is the mean over the same sixteen times as the
//! pressure's.

use super::spi_bus::{self, Bus};
use super::tick_timer::TickTimer;
use crate::board::{BridgeConverterPins, BridgeReadyPin, BridgeSelectPin};
use core::sync::atomic::{AtomicI32, AtomicUsize, Ordering::Relaxed};
use model_core::sampling::SCANS;
use model_core::signal::AdcCount;
use rig_drivers::ads1220::{Ads1220, CLOCK_HZ_MAX, MODE, NOT_CONVERTED, reading};
use stm32f4xx_hal::pac::SPI3;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;

/// The conversions since the last tick, and the count of the scans. Atomics, because two tasks have
/// them; the tasks have the same priority, so that neither interrupts the other.
static BRIDGE_CODES: [AtomicI32; SCANS] = [const { AtomicI32::new(NOT_CONVERTED) }; SCANS];
static SCANNED: AtomicUsize = AtomicUsize::new(0);

/// SPI clock \[Hz\]: a conversion with the registers takes 12 µs.
const CLOCK_HZ: u32 = 6_000_000;
// Also if the chip's oscillator is 4 % fast.
const _: () = assert!(CLOCK_HZ / 100 * 104 <= CLOCK_HZ_MAX && spi_bus::divides_to(CLOCK_HZ));

/// The converter, and the timer at whose pace it is read.
pub struct BridgeConverter {
    converter: Ads1220<Bus<SPI3>, BridgeSelectPin, BridgeReadyPin>,
    timer: TickTimer,
}

impl BridgeConverter {
    /// The converter is set up by the first scans.
    pub fn new(
        spi: SPI3,
        pins: BridgeConverterPins,
        timer: TickTimer,
        rcc: &mut Rcc,
    ) -> BridgeConverter {
        let wires = (Some(pins.clock), Some(pins.data_out), Some(pins.data_in));
        let bus = Bus(spi.spi(wires, MODE, CLOCK_HZ.Hz(), rcc));
        BridgeConverter {
            converter: Ads1220::new(bus, pins.select, pins.ready),
            timer,
        }
    }

    /// Starts the scans.
    pub fn start(&self) {
        self.timer.start();
    }

    /// Reads a conversion. Clears the interrupt of the timer.
    pub fn scan(&mut self) {
        self.timer.clear_update();
        let code = self.converter.poll().unwrap_or(NOT_CONVERTED);
        let scan = SCANNED.load(Relaxed);
        // None if the tick is late.
        if let Some(slot) = BRIDGE_CODES.get(scan) {
            slot.store(code, Relaxed);
            SCANNED.store(scan + 1, Relaxed);
        }
    }
}

/// The reading of the bridge since the last tick. The chip's converter reads half of its supply.
pub fn read(half_supply: AdcCount) -> AdcCount {
    SCANNED.store(0, Relaxed);
    let codes = core::array::from_fn(|n| BRIDGE_CODES[n].swap(NOT_CONVERTED, Relaxed));
    reading(half_supply, &codes)
}

//! The self-test in the background: a slice of the image in flash and of the RAM whenever the core
//! wakes, which the link task does every millisecond. What the tests at the start have found intact
//! is tested again while the program runs. The core's clock is compared with the watchdog's.

use crate::board;
use crate::driver::flash;
use crate::driver::iwdg::STOPS_IN_DEBUG;
use crate::driver::slow_counter::SlowCounter;
use crate::ram::RamTest;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use cortex_m::peripheral::DWT;
use model_core::clock::ClockCheck;
use model_core::link::{ImageCheck, ImageState};
use model_core::start::StartFault;

/// Bytes of the image in a slice: 64 KiB take 2 s.
const IMAGE_BYTES: usize = 32;

/// What was found: nothing, or one of these.
static FOUND: AtomicU8 = AtomicU8::new(0);
const IMAGE: u8 = 1;
const RAM: u8 = 2;
const CLOCK: u8 = 3;

/// The fault that was found; it stays.
pub fn found() -> Option<StartFault> {
    match FOUND.load(Relaxed) {
        0 => None,
        IMAGE => Some(StartFault::Image),
        CLOCK => Some(StartFault::Clock),
        _ => Some(StartFault::Ram),
    }
}

/// What is tested next.
pub struct SelfTest {
    image: ImageCheck,
    ram: RamTest,
    clock: ClockCheck,
    slow_counter: SlowCounter,
}

impl SelfTest {
    /// A test from the begin of image and RAM, and of the clock by this counter.
    pub fn new(slow_counter: SlowCounter) -> SelfTest {
        SelfTest {
            image: ImageCheck::default(),
            ram: RamTest::default(),
            clock: ClockCheck::new(board::SYSCLK_HZ),
            slow_counter,
        }
    }

    /// Tests a slice of each, and the clock.
    pub fn step(&mut self) {
        let image = self.image.step(flash::program(), IMAGE_BYTES);
        if image == ImageState::Sealed(false) {
            FOUND.store(IMAGE, Relaxed);
        }
        if !self.ram.step() {
            FOUND.store(RAM, Relaxed);
        }
        // A halt stops the core's counter, but not the slow one.
        let counter = &self.slow_counter;
        if !STOPS_IN_DEBUG && !self.clock.step(DWT::cycle_count(), || counter.count()) {
            FOUND.store(CLOCK, Relaxed);
        }
    }
}

//! The self-test in the background: a slice of the image in flash and of the RAM whenever the core
//! wakes, which the link task does every millisecond. What the tests at the start have found intact
//! is tested again while the program runs.

use crate::driver::flash;
use crate::ram::RamTest;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use model_core::link::{ImageCheck, ImageState};
use model_core::start::StartFault;

/// Bytes of the image in a slice: 64 KiB take 2 s.
const IMAGE_BYTES: usize = 32;

/// What was found: nothing, or one of these.
static FOUND: AtomicU8 = AtomicU8::new(0);
const IMAGE: u8 = 1;
const RAM: u8 = 2;

/// The fault that was found; it stays.
pub fn found() -> Option<StartFault> {
    match FOUND.load(Relaxed) {
        0 => None,
        IMAGE => Some(StartFault::Image),
        _ => Some(StartFault::Ram),
    }
}

/// What is tested next.
#[derive(Default)]
pub struct SelfTest {
    image: ImageCheck,
    ram: RamTest,
}

impl SelfTest {
    /// Tests a slice of each.
    pub fn step(&mut self) {
        let image = self.image.step(flash::program(), IMAGE_BYTES);
        if image == ImageState::Sealed(false) {
            FOUND.store(IMAGE, Relaxed);
        }
        if !self.ram.step() {
            FOUND.store(RAM, Relaxed);
        }
    }
}

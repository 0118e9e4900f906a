//! model-core, its tests, and a battery of inputs, on a Cortex-M4F: machine mps2-an386 of QEMU.
//!
//! `tests/tests/cortex_m.rs` starts it on the PC, reads its output, and compares the checksums of
//! the battery with those of the PC. The build script generates `model_core.rs` with the tests.
#![no_std]
#![no_main]

extern crate alloc;
// The name by which the tests import it.
extern crate self as model_core;

mod battery;
mod host;

include!(concat!(env!("OUT_DIR"), "/model_core.rs"));

use controller::Controller;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{ExceptionFrame, exception};
use cortex_m_semihosting::{debug, hprintln};
use embedded_alloc::LlffHeap as Heap;
use panic_semihosting as _;
use settings::{Settings, SettingsValues};

#[global_allocator]
static HEAP: Heap = Heap::empty();
const HEAP_LEN: usize = 2 << 20;

/// With QEMU's option `-icount shift=0` an instruction takes 1 ns, a count of the 25 MHz SysTick
/// 40 ns.
const INSTRUCTIONS_PER_COUNT: u32 = 40;
const COUNTED_TICKS: u32 = 2_000;

#[cortex_m_rt::entry]
fn main() -> ! {
    // SAFETY: called once, before the first allocation.
    #[allow(unsafe_code)]
    unsafe {
        embedded_alloc::init!(HEAP, HEAP_LEN);
    }
    for (name, test) in TESTS.iter().copied().flatten() {
        // Printed before the test runs: if it panics, the last line is its name.
        hprintln!("test {}", name);
        test();
    }
    for (name, checksum) in battery::PARTS {
        hprintln!("battery {}: {:016x}", name, checksum());
    }
    if let Some(core) = cortex_m::Peripherals::take() {
        count_instructions(core.SYST);
    }
    hprintln!("passed");
    debug::exit(debug::EXIT_SUCCESS);
    loop {
        cortex_m::asm::wfi();
    }
}

// SAFETY: the handler does not return.
#[allow(unsafe_code)]
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    panic!("{frame:?}")
}

/// Counts and prints the instructions of [`Controller::tick`], including the call.
fn count_instructions(mut timer: SYST) {
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(0x00FF_FFFF);
    timer.clear_current();
    timer.enable_counter();
    let Ok(settings) = Settings::new(SettingsValues::reference()) else {
        return;
    };
    let mut controller = Controller::new(settings);
    let mut readings = battery::Readings::new(1);
    let (mut sum, mut longest) = (0, 0);
    for _ in 0..COUNTED_TICKS {
        let sensors = readings.next(controller.state().valve);
        let begin = SYST::get_current();
        core::hint::black_box(controller.tick(core::hint::black_box(&sensors)));
        let counts = begin.wrapping_sub(SYST::get_current()) & 0x00FF_FFFF;
        sum += counts * INSTRUCTIONS_PER_COUNT;
        longest = longest.max(counts * INSTRUCTIONS_PER_COUNT);
    }
    let mean = sum / COUNTED_TICKS;
    hprintln!(
        "instructions of a tick: {} in the mean, {} at most",
        mean,
        longest
    );
}

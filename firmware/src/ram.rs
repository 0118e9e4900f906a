//! The tests of the RAM: of all of it at the start, and of a few words at a time in the background.

use crate::driver::{adc, serial};
use core::ops::Range;

/// Bytes below the stack pointer that are not tested: the test itself uses them.
const IN_USE_BYTES: u32 = 256;

/// Each bit as 0 and as 1, with the other value in its neighbours.
const PATTERNS: [u32; 2] = [0x5555_5555, 0xaaaa_aaaa];

/// Words that a step of the test in the background tests: 128 KiB take 4 s.
const STEP_WORDS: u32 = 8;

/// Whether every word of the RAM holds [`PATTERNS`], except those of the stack in use. Keeps the
/// content. Call it with interrupts masked and without DMA.
pub fn holds_patterns() -> bool {
    let (stack, rest) = (stack(), rest());
    let unused = stack.start..in_use(&stack).start;
    [unused, rest].into_iter().all(|mut range| {
        // Not `step_by`: it is four times slower.
        while range.start < range.end {
            if !word_holds_patterns(range.start as *mut u32) {
                return false;
            }
            range.start += 4;
        }
        true
    })
}

/// The test in the background: of all words but those of the stack in use, and of the buffers that
/// a DMA stream accesses.
pub struct RamTest {
    next: u32,
}

impl Default for RamTest {
    fn default() -> RamTest {
        RamTest {
            next: stack().start,
        }
    }
}

impl RamTest {
    /// Whether the next words hold [`PATTERNS`]. Each keeps its content; interrupts are masked
    /// meanwhile, for some 15 cycles.
    pub fn step(&mut self) -> bool {
        let skipped = [in_use(&stack()), adc::buffer(), serial::buffers()];
        (0..STEP_WORDS).all(|_| {
            let address = self.next;
            self.next = match address.wrapping_add(4) {
                next if rest().contains(&next) || stack().contains(&next) => next,
                _ => stack().start,
            };
            skipped.iter().any(|range| range.contains(&address))
                || cortex_m::interrupt::free(|_| word_holds_patterns(address as *mut u32))
        })
    }
}

/// Addresses of the stack, at the begin of the RAM.
pub fn stack() -> Range<u32> {
    #[allow(unsafe_code)]
    // SAFETY: memory.x defines these symbols; only their addresses are used.
    unsafe extern "C" {
        static _stack_end: u8;
        static _stack_start: u8;
    }
    (&raw const _stack_end) as u32..(&raw const _stack_start) as u32
}

/// The part of the stack in use, and what a call may use more.
#[inline(always)]
fn in_use(stack: &Range<u32>) -> Range<u32> {
    let pointer = cortex_m::register::msp::read();
    pointer.saturating_sub(IN_USE_BYTES) & !3..stack.end
}

/// The RAM after the stack.
fn rest() -> Range<u32> {
    #[allow(unsafe_code)]
    // SAFETY: as above.
    unsafe extern "C" {
        static _ram_start: u8;
        static _ram_end: u8;
    }
    (&raw const _ram_start) as u32..(&raw const _ram_end) as u32
}

#[inline(always)]
fn word_holds_patterns(word: *mut u32) -> bool {
    #[allow(unsafe_code)]
    // SAFETY: an aligned word of the RAM, which has its value again at the end. The program only
    // accesses it here: interrupts are masked, and no DMA runs, or none that has this word. A probe
    // may access it: it can read a pattern in place of an offset of the log, and its own write of
    // one can be lost, or seen as a stuck bit. That garbles the log or prevents assistance; no
    // invariant of the program is the probe's to keep.
    unsafe {
        let before = word.read_volatile();
        let holds = PATTERNS.iter().all(|pattern| {
            word.write_volatile(*pattern);
            word.read_volatile() == *pattern
        });
        word.write_volatile(before);
        holds
    }
}

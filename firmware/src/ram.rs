//! The test of the RAM at start-up.

/// Bytes below the stack pointer that are not tested: the test itself uses them.
const IN_USE_BYTES: u32 = 256;

/// Each bit as 0 and as 1, with the other value in its neighbours.
const PATTERNS: [u32; 2] = [0x5555_5555, 0xaaaa_aaaa];

/// Whether every word of the RAM holds [`PATTERNS`], except those of the stack in use. Keeps the
/// content. Call it with interrupts masked and without DMA.
pub fn holds_patterns() -> bool {
    #[allow(unsafe_code)]
    // SAFETY: memory.x defines these symbols; only their addresses are used.
    unsafe extern "C" {
        static _stack_end: u8;
        static _ram_start: u8;
        static _ram_end: u8;
    }
    let in_use = cortex_m::register::msp::read() - IN_USE_BYTES;
    let stack = (&raw const _stack_end) as u32..in_use & !3;
    let rest = (&raw const _ram_start) as u32..(&raw const _ram_end) as u32;
    [stack, rest].into_iter().all(|mut range| {
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

#[inline(always)]
fn word_holds_patterns(word: *mut u32) -> bool {
    #[allow(unsafe_code)]
    // SAFETY: an aligned word of the RAM, which has its value again at the end. The program only
    // accesses it here: interrupts are masked, and no DMA runs. A probe may access it: it can read
    // a pattern in place of an offset of the log, and its own write of one can be lost, or seen as
    // a stuck bit. That garbles the log or prevents assistance; no invariant of the program is the
    // probe's to keep.
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

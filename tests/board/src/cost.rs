//! What the executed instructions take at most on a real core.
//!
//! The cycles of an instruction are those of the Cortex-M4's technical reference manual (Arm
//! 100166, table 3-1), each at its most: a branch 1 + P with P = 3, as if taken; a division 12,
//! VDIV and VSQRT 14; one more where the next instruction may wait for a floating-point result.
//!
//! The flash (ST RM0090 and RM0383, «Adaptive real-time memory accelerator») is read in lines of
//! 128 bits, one read at a time. Its caches are taken as empty, always: each line that is entered
//! is read anew, a line that is branched to, too, if it is the one before; each load from the flash
//! is a read. A read that was begun for something else, by the prefetch or by the core's own
//! buffer, is completed first: a branch and a load wait for two reads, the next line in sequence
//! for its own.

/// Counts since the start.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Cost {
    /// Cycles of the core, with no waiting.
    pub core_cycles: u64,
    /// Lines of the flash that were branched to.
    pub branches: u64,
    /// Lines of the flash that were entered in sequence.
    pub lines: u64,
    /// Loads from the flash.
    pub loads: u64,
    /// Accesses to registers of peripherals.
    pub registers: u64,
}

/// Cycles in which the bus to a peripheral answers: two of the slower bus, at most four times the
/// core's, twice for its synchronisation.
const REGISTER_CYCLES: u64 = 16;

impl Cost {
    /// What was added since `before`.
    pub fn since(&self, before: &Cost) -> Cost {
        Cost {
            core_cycles: self.core_cycles - before.core_cycles,
            branches: self.branches - before.branches,
            lines: self.lines - before.lines,
            loads: self.loads - before.loads,
            registers: self.registers - before.registers,
        }
    }

    /// Cycles at most, with a flash of so many wait states.
    pub fn cycles(&self, wait_states: u64) -> u64 {
        let reads = 2 * self.branches + self.lines + 2 * self.loads;
        self.core_cycles + (wait_states + 1) * reads + REGISTER_CYCLES * self.registers
    }
}

/// Follows the addresses of the instructions.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Follower {
    pub cost: Cost,
    /// Address behind the last instruction.
    next: u32,
}

/// Bytes of a line of the flash.
const LINE: u32 = 16;

impl Follower {
    /// The next instruction.
    pub fn follow(&mut self, address: u32, size: u32, cycles: u8, is_in_flash: bool) {
        self.cost.core_cycles += u64::from(cycles);
        let in_sequence = address == self.next;
        self.next = address + size;
        if is_in_flash {
            let crossed = (self.next - 1) / LINE - address / LINE;
            self.cost.branches += u64::from(!in_sequence);
            self.cost.lines +=
                u64::from(crossed + u32::from(in_sequence && address.is_multiple_of(LINE)));
        }
    }

    /// A load from the flash. The line of the instructions is read again after it.
    pub fn load(&mut self) {
        self.cost.loads += 1;
        self.cost.lines += 1;
    }
}

/// P of a branch, at most.
const REFILL: u8 = 3;

/// Cycles of an instruction at most, without waiting.
pub(crate) fn cycles([first, second]: [u16; 2]) -> u8 {
    if first >> 11 >= 0x1d {
        wide(first, second)
    } else {
        narrow(first)
    }
}

fn narrow(first: u16) -> u8 {
    let registers = (first & 0xff).count_ones() as u8;
    match first >> 8 {
        // ADD and MOV to PC
        0x44 | 0x46 if first & 0x87 == 0x87 => 1 + REFILL,
        0x47 => 1 + REFILL,
        0x48..=0x9f => 2,
        // CBZ, CBNZ
        0xb1 | 0xb3 | 0xb9 | 0xbb => 1 + REFILL,
        // PUSH, POP
        0xb4 | 0xbc => 1 + registers,
        0xb5 => 2 + registers,
        0xbd => 2 + registers + REFILL,
        // CPS
        0xb6 => 2,
        0xc0..=0xcf => 1 + registers,
        0xd0..=0xe7 => 1 + REFILL,
        _ => 1,
    }
}

fn wide(first: u16, second: u16) -> u8 {
    match first {
        // LDM, STM
        0xe800..=0xe9ff if first & 0x40 == 0 => {
            let refill = if second >> 15 == 1 { REFILL } else { 0 };
            1 + second.count_ones() as u8 + refill
        }
        // TBB, TBH
        0xe8d0..=0xe8df if second & 0xffe0 == 0xf000 => 2 + REFILL,
        // two words, exclusive
        0xe800..=0xe9ff => 3,
        0xea00..=0xebff => 1,
        0xec00..=0xefff | 0xfc00..=0xffff => float(first, second),
        // branches, MRS, MSR, barriers
        0xf000..=0xf7ff if second >> 15 == 1 => 1 + REFILL,
        0xf000..=0xf7ff => 1,
        0xf850..=0xf85f | 0xf8d0..=0xf8df if second >> 12 == 15 => 2 + REFILL,
        0xf800..=0xf9ff => 2,
        // SDIV, UDIV
        0xfb90..=0xfb9f | 0xfbb0..=0xfbbf if second & 0xf0 == 0xf0 => 12,
        _ => 1,
    }
}

/// Floating point, with the cycle for which the next instruction may wait.
fn float(first: u16, second: u16) -> u8 {
    let (group, words) = (first & 0xffb0, (second & 0xff) as u8);
    match first {
        // two core registers
        0xec40..=0xec5f => 3,
        // VLDR, VSTR
        0xed00..=0xedff if first & 0x20 == 0 => 4,
        // VLDM, VSTM
        0xec00..=0xedff => 2 + words,
        _ if group == 0xee80 => 15,
        _ if first & 0xffbf == 0xeeb1 && second & 0xd0 == 0xc0 => 15,
        // VMLA, VMLS, VNMLA, VNMLS, VFMA, VFMS, VFNMA, VFNMS
        _ if matches!(group, 0xee00 | 0xee10 | 0xee90 | 0xeea0) => 4,
        _ => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Encodings by the assembler, cycles by the manual's table.
    #[test]
    fn instructions_take_what_the_manual_says_at_most() {
        for (code, most, name) in [
            ([0x1840, 0], 1, "adds r0, r0, r1"),
            ([0x4687, 0], 4, "mov pc, r0"),
            ([0x4770, 0], 4, "bx lr"),
            ([0x4801, 0], 2, "ldr r0, [pc, #4]"),
            ([0x6008, 0], 2, "str r0, [r1]"),
            ([0xb5f0, 0], 6, "push {r4-r7, lr}"),
            ([0xbdf0, 0], 9, "pop {r4-r7, pc}"),
            ([0xd0fe, 0], 4, "beq"),
            ([0xb108, 0], 4, "cbz"),
            ([0xe92d, 0x4ff0], 10, "push.w {r4-r11, lr}"),
            ([0xe8bd, 0x8ff0], 13, "pop.w {r4-r11, pc}"),
            ([0xe8df, 0xf000], 5, "tbb [pc, r0]"),
            ([0xe9d0, 0x0100], 3, "ldrd r0, r1, [r0]"),
            ([0xf000, 0xf800], 4, "bl"),
            ([0xf8df, 0xf000], 5, "ldr.w pc, [pc]"),
            ([0xf8d0, 0x1004], 2, "ldr.w r1, [r0, #4]"),
            ([0xfb90, 0xf0f1], 12, "sdiv r0, r0, r1"),
            ([0xfb00, 0xf001], 1, "mul r0, r0, r1"),
            ([0xee80, 0x0a20], 15, "vdiv.f32 s0, s0, s1"),
            ([0xeeb1, 0x0ac0], 15, "vsqrt.f32 s0, s0"),
            ([0xee30, 0x0a20], 2, "vadd.f32 s0, s0, s1"),
            ([0xee00, 0x0a20], 4, "vmla.f32 s0, s0, s1"),
            ([0xed90, 0x0a01], 4, "vldr s0, [r0, #4]"),
            ([0xed2d, 0x8b02], 4, "vpush {d8}"),
        ] {
            assert_eq!(cycles(code), most, "{name}");
        }
    }

    #[test]
    fn lines_are_counted_where_they_are_entered() {
        let mut follower = Follower::default();
        let counts = |follower: &Follower| (follower.cost.branches, follower.cost.lines);
        follower.follow(0x0800_0008, 4, 1, true);
        assert_eq!(counts(&follower), (1, 0));
        // to the end of the line, across it, and behind it
        follower.follow(0x0800_000c, 2, 1, true);
        follower.follow(0x0800_000e, 4, 1, true);
        assert_eq!(counts(&follower), (1, 1));
        follower.follow(0x0800_0012, 4, 1, true);
        assert_eq!(counts(&follower), (1, 1));
        // a branch within the line
        follower.follow(0x0800_0010, 2, 1, true);
        assert_eq!(counts(&follower), (2, 1));
        follower.load();
        assert_eq!((counts(&follower), follower.cost.loads), ((2, 2), 1));
        // to the next line in sequence
        follower.follow(0x0800_0012, 14, 1, true);
        follower.follow(0x0800_0020, 2, 1, true);
        assert_eq!(counts(&follower), (2, 3));
        // 7 cycles of the core; two reads a branch, one a line, two a load
        assert_eq!(follower.cost.cycles(3), 7 + 4 * (4 + 3 + 2));
    }
}

//! FLASH: keys, erasing and programming with their durations, and the effect of a power cut
//! (RM0390 chapter 3; durations: STM32F446 datasheet, flash memory programming, typical).
//!
//! The chip has one bank: while the flash is busy, every fetch from it stalls the core.

use crate::errors::Context;
use crate::time::{NEVER, Time, from_ns};
use std::ops::Range;

/// Start address of the flash.
pub const BASE: u32 = 0x0800_0000;
/// Length of the flash, 512 KiB.
pub const LEN: usize = 512 << 10;

const PG: u32 = 1;
const SER: u32 = 2;
const MER: u32 = 4;
const STRT: u32 = 1 << 16;
const EOPIE: u32 = 1 << 24;
const LOCK: u32 = 1 << 31;
const EOP: u32 = 1;
const WRPERR: u32 = 1 << 4;
const PGPERR: u32 = 1 << 6;
const PGSERR: u32 = 1 << 7;
const BSY: u32 = 1 << 16;
const PROGRAM_NS: u64 = 16_000;
/// ACR: data cache on, and its reset.
const DCEN: u32 = 1 << 10;
const DCRST: u32 = 1 << 12;

/// An operation in progress, with the previous content of the cells from `start` on.
struct Operation {
    start: usize,
    before: Vec<u8>,
    erases: bool,
    begun: Time,
    done_at: Time,
}

#[derive(PartialEq, Clone, Copy)]
enum Lock {
    Locked,
    HalfOpen,
    Open,
    /// Locked until the next reset, after a wrong key.
    LockedUntilReset,
}

/// Cells and registers.
pub struct Flash {
    /// Content as the core reads it.
    pub cells: Vec<u8>,
    /// Ranges of `cells` that are newer than the engine's copy.
    pub changed: Vec<Range<usize>>,
    /// Sectors erased since the board was created.
    pub erase_count: u64,
    /// The option BOR_LEV; a new chip has 3, which is off.
    pub brown_out_level: u8,
    acr: u32,
    sr: u32,
    cr: u32,
    lock: Lock,
    operation: Option<Operation>,
    /// The data cache may hold what the cells no longer contain.
    cache_is_stale: bool,
    /// Cells that keep their content when they are programmed.
    pub worn: Range<usize>,
}

/// First byte and length of a sector: 4 × 16, 64, 3 × 128 KiB.
pub fn sector(number: u32) -> Option<(usize, usize)> {
    Some(match number {
        0..=3 => (number as usize * (16 << 10), 16 << 10),
        4 => (64 << 10, 64 << 10),
        5..=7 => ((number as usize - 4) * (128 << 10), 128 << 10),
        _ => return None,
    })
}

/// Typical duration of a sector erase. `psize` 0 to 3 is the parallelism, 8 to 64 bits.
fn erase_ns(len: usize, psize: u32) -> u64 {
    let row = match len >> 10 {
        16 => [400, 300, 250, 250],
        64 => [1200, 700, 550, 550],
        128 => [2000, 1300, 1000, 1000],
        _ => [8_000, 5_500, 4_000, 4_000],
    };
    row[psize as usize] * 1_000_000
}

/// The next number of a deterministic pseudo-random sequence (splitmix64).
pub(crate) fn mix(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*seed ^ (*seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Flash {
    /// A flash with `cells`, which are truncated or extended with 0xff to the size of the chip.
    pub fn new(mut cells: Vec<u8>) -> Flash {
        cells.resize(LEN, 0xff);
        Flash {
            cells,
            changed: vec![],
            erase_count: 0,
            brown_out_level: 3,
            acr: 0,
            sr: 0,
            cr: LOCK,
            lock: Lock::Locked,
            operation: None,
            cache_is_stale: false,
            worn: 0..0,
        }
    }

    /// Resets the registers; an operation in progress is interrupted.
    pub fn reset(&mut self, now: Time) {
        self.cut(now);
        (self.acr, self.sr, self.cr, self.lock) = (0, 0, LOCK, Lock::Locked);
        self.cache_is_stale = false;
    }

    /// Time until which the core stalls.
    pub fn busy_until(&self) -> Time {
        self.operation
            .as_ref()
            .map_or(0, |operation| operation.done_at)
    }

    /// Time of the next event.
    pub fn next(&self) -> Time {
        self.operation
            .as_ref()
            .map_or(NEVER, |operation| operation.done_at)
    }

    /// Completes an operation that is due.
    pub fn fire(&mut self, now: Time) {
        if self.next() <= now {
            self.operation = None;
            self.cr &= !STRT;
            if self.cr & EOPIE != 0 {
                self.sr |= EOP;
            }
        }
    }

    /// Level of the interrupt line.
    pub fn irq(&self) -> bool {
        self.sr & EOP != 0 && self.cr & EOPIE != 0
    }

    /// Configured wait states.
    pub fn latency(&self) -> u64 {
        u64::from(self.acr & 15)
    }

    /// Reads a register.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.acr,
            0x0c => self.sr | if self.operation.is_some() { BSY } else { 0 },
            0x10 => self.cr,
            0x14 => 0x0fff_aae1 | u32::from(self.brown_out_level) << 2,
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) {
        match offset {
            0x00 => self.set_access(value, cx),
            0x04 => self.key(value, cx),
            0x0c => self.sr &= !(value & 0xf3),
            0x10 => self.control(value, cx),
            0x14 => cx.error("FLASH: option bytes are not modelled"),
            _ => {}
        }
    }

    fn set_access(&mut self, value: u32, cx: &mut Context) {
        if value & DCRST != 0 {
            if value & DCEN != 0 {
                cx.error("FLASH: data cache reset while it is on: ignored");
            } else {
                self.cache_is_stale = false;
            }
        }
        if value & DCEN != 0 && self.cache_is_stale {
            cx.error("FLASH: data cache on, and not reset since the cells have changed");
        }
        self.acr = value;
    }

    /// Cells change: what the data cache holds may be outdated.
    fn outdate_cache(&mut self, cx: &mut Context) {
        self.cache_is_stale = true;
        if self.acr & DCEN != 0 {
            cx.error("FLASH: erased or programmed with the data cache on");
        }
    }

    fn key(&mut self, value: u32, cx: &mut Context) {
        self.lock = match (self.lock, value) {
            (Lock::Locked, 0x4567_0123) => Lock::HalfOpen,
            (Lock::HalfOpen, 0xcdef_89ab) => Lock::Open,
            _ => {
                cx.error("FLASH: wrong key; locked until the next reset");
                Lock::LockedUntilReset
            }
        };
        if self.lock == Lock::Open {
            self.cr &= !LOCK;
        }
    }

    fn control(&mut self, value: u32, cx: &mut Context) {
        if self.cr & LOCK != 0 {
            return cx.error("FLASH: CR written while locked: ignored");
        }
        if self.operation.is_some() {
            // a real bus stalls until the operation ends; code in flash cannot get here
            return cx.error("FLASH: CR written while busy");
        }
        self.cr = value;
        if value & LOCK != 0 {
            self.lock = Lock::Locked;
        }
        if value & STRT == 0 {
            return;
        }
        let psize = value >> 8 & 3;
        match value & (SER | MER) {
            SER => match sector(value >> 3 & 31) {
                Some((start, len)) => self.erase(start, len, psize, cx),
                None => cx.error("FLASH: no such sector"),
            },
            MER => self.erase(0, LEN, psize, cx),
            _ => cx.error("FLASH: STRT without SER or MER, or with both"),
        }
    }

    fn erase(&mut self, start: usize, len: usize, psize: u32, cx: &mut Context) {
        if psize == 3 {
            cx.error("FLASH: parallelism x64 needs an external programming voltage");
        }
        self.outdate_cache(cx);
        let range = start..start + len;
        let before = self.cells[range.clone()].to_vec();
        self.cells[range.clone()].fill(0xff);
        self.changed.push(range);
        self.erase_count += 1;
        let done_at = cx.now + from_ns(erase_ns(len, psize));
        self.operation = Some(Operation {
            start,
            before,
            erases: true,
            begun: cx.now,
            done_at,
        });
    }

    /// Programs the flash by a store to its address range. Bits can only be cleared.
    pub fn program(&mut self, address: u32, size: usize, value: u64, cx: &mut Context) {
        let start = (address - BASE) as usize;
        let range = start..(start + size).min(LEN);
        // the engine has already stored to its copy, which must be corrected in any case
        self.changed.push(range.clone());
        if self.cr & PG == 0 || self.cr & LOCK != 0 {
            self.sr |= PGSERR;
            return cx.error("FLASH: store without PG");
        }
        if self.sr & (WRPERR | PGPERR | PGSERR) != 0 {
            return cx.error("FLASH: store while an error flag is set: ignored");
        }
        if size != 1 << (self.cr >> 8 & 3) {
            self.sr |= PGPERR;
            return cx.error(format!("FLASH: store of {size} bytes does not fit PSIZE"));
        }
        self.outdate_cache(cx);
        let before = self.cells[range.clone()].to_vec();
        for (index, byte) in range.zip(value.to_le_bytes()) {
            if !self.worn.contains(&index) {
                self.cells[index] &= byte;
            }
        }
        // a store while busy waits until the operation ends
        let begun = cx.now.max(self.busy_until());
        let done_at = begun + from_ns(PROGRAM_NS);
        self.operation = Some(Operation {
            start,
            before,
            erases: false,
            begun,
            done_at,
        });
    }

    /// Interrupts an operation, as a power cut does. Programming has cleared some of its bits. An
    /// erase first programs all cells to 0, for which this model assumes a quarter of its time,
    /// then sets the bits. Each word is at random complete, unchanged, or a mixture.
    pub fn cut(&mut self, now: Time) {
        let Some(operation) = self.operation.take() else {
            return;
        };
        let total = operation.done_at - operation.begun;
        let done = now.saturating_sub(operation.begun).min(total);
        let mut seed = now ^ operation.start as u64;
        let start = operation.start;
        for (i, old) in operation.before.chunks(4).enumerate() {
            let offset = start + 4 * i;
            let new = self.cells[offset..offset + old.len()].to_vec();
            let torn = if !operation.erases {
                between(old, &new, done, total, &mut seed)
            } else if done < total / 4 {
                between(old, &[0; 4], done, total / 4, &mut seed)
            } else {
                between(
                    &[0; 4],
                    &new,
                    done - total / 4,
                    total - total / 4,
                    &mut seed,
                )
            };
            self.cells[offset..offset + old.len()].copy_from_slice(&torn[..old.len()]);
        }
        self.changed.push(start..start + operation.before.len());
    }
}

/// A word during the change from `old` to `new`: either of them, or some bits of each.
fn between(old: &[u8], new: &[u8], done: Time, total: Time, seed: &mut u64) -> [u8; 4] {
    let chance = mix(seed);
    let share = (u128::from(done) * 256 / u128::from(total)) as u64;
    let mask = match chance >> 32 & 3 {
        0 => mix(seed) as u32,
        _ if chance % 256 < share => u32::MAX,
        _ => 0,
    };
    let mut word = [0; 4];
    for (i, byte) in word.iter_mut().enumerate().take(old.len().min(new.len())) {
        let mask = mask.to_le_bytes()[i];
        *byte = old[i] & !mask | new[i] & mask;
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    fn open(flash: &mut Flash, errors: &mut Errors) {
        for key in [0x4567_0123, 0xcdef_89ab] {
            flash.write(4, key, &mut test_context(errors, 0));
        }
    }

    fn filled() -> (Flash, Errors) {
        let (mut flash, mut errors) = (Flash::new(vec![0x5a; LEN]), Errors::default());
        open(&mut flash, &mut errors);
        (flash, errors)
    }

    #[test]
    fn sectors_cover_the_flash_without_a_gap() {
        let mut end = 0;
        for number in 0..8 {
            let (start, len) = sector(number).unwrap();
            assert_eq!(start, end);
            end += len;
        }
        assert_eq!((end, sector(8)), (LEN, None));
    }

    #[test]
    fn wrong_key_locks_until_reset() {
        let (mut flash, mut errors) = (Flash::new(vec![]), Errors::default());
        flash.write(4, 1, &mut test_context(&mut errors, 0));
        open(&mut flash, &mut errors);
        assert_ne!(flash.read(0x10) & LOCK, 0);
        flash.reset(0);
        open(&mut flash, &mut errors);
        assert_eq!(flash.read(0x10) & LOCK, 0);
    }

    #[test]
    fn sector_erase_takes_the_time_of_the_datasheet() {
        let (mut flash, mut errors) = filled();
        let x32 = 2 << 8;
        flash.write(
            0x10,
            x32 | SER | STRT | 2 << 3,
            &mut test_context(&mut errors, 0),
        );
        assert_eq!(flash.busy_until(), from_ns(250_000_000));
        assert_ne!(flash.read(0x0c) & BSY, 0);
        flash.fire(flash.busy_until());
        assert_eq!(flash.read(0x0c) & BSY, 0);
        assert_eq!(flash.read(0x10) & STRT, 0);
        let (start, len) = sector(2).unwrap();
        assert!(flash.cells[start..start + len].iter().all(|b| *b == 0xff));
        assert_eq!(
            (flash.cells[start - 1], flash.cells[start + len]),
            (0x5a, 0x5a)
        );
        assert!(errors.list.is_empty());
    }

    #[test]
    fn programming_clears_bits_only_and_needs_the_right_width() {
        let (mut flash, mut errors) = filled();
        flash.write(0x10, PG | 2 << 8, &mut test_context(&mut errors, 0));
        flash.program(BASE + 8, 4, 0xffff_ff0f, &mut test_context(&mut errors, 0));
        assert_eq!(flash.cells[8..12], [0x0a, 0x5a, 0x5a, 0x5a]);
        assert_eq!(flash.busy_until(), from_ns(PROGRAM_NS));
        flash.program(BASE + 16, 1, 0, &mut test_context(&mut errors, 0));
        assert_eq!(flash.cells[16], 0x5a);
        assert_ne!(flash.read(0x0c) & PGPERR, 0);
    }

    #[test]
    fn interrupted_erase_leaves_a_mixture_of_words() {
        // after 10 % and after 90 % of 400 ms
        for (cut_ns, from, to) in [(40_000_000, 0x5a, 0), (360_000_000, 0, 0xff)] {
            let (mut flash, mut errors) = filled();
            flash.write(0x10, SER | STRT, &mut test_context(&mut errors, 0));
            flash.reset(from_ns(cut_ns));
            let cells = &flash.cells[..16 << 10];
            let count = |value: u8| cells.iter().filter(|b| **b == value).count();
            assert!(count(from) > 1000 && count(to) > 1000, "{from} {to}");
            let torn = cells.len() - count(from) - count(to);
            assert!(torn > 1000, "{torn} cells are mixtures");
        }
    }

    #[test]
    fn interrupted_programming_leaves_only_bits_of_the_old_or_new_word() {
        for cut_ns in (0..16_000).step_by(500) {
            let (mut flash, mut errors) = filled();
            flash.write(0x10, PG | 2 << 8, &mut test_context(&mut errors, 0));
            flash.program(BASE, 4, 0, &mut test_context(&mut errors, 0));
            flash.reset(from_ns(cut_ns));
            assert!(flash.cells[..4].iter().all(|b| b & !0x5a == 0));
        }
    }

    #[test]
    fn cells_changed_behind_the_data_cache_are_reported() {
        let (mut flash, mut errors) = filled();
        flash.write(0, DCEN, &mut test_context(&mut errors, 0));
        flash.write(0x10, PG | 2 << 8, &mut test_context(&mut errors, 0));
        flash.program(BASE, 4, 0, &mut test_context(&mut errors, 0));
        assert_eq!(errors.list.len(), 1, "{:?}", errors.list);
        for value in [0, DCEN, 0, DCRST, 0, DCEN] {
            flash.write(0, value, &mut test_context(&mut errors, 0));
        }
        assert_eq!(errors.list.len(), 2, "{:?}", errors.list);
    }

    #[test]
    fn worn_cells_keep_their_content() {
        let (mut flash, mut errors) = filled();
        flash.worn = 4..8;
        flash.write(0x10, PG | 2 << 8, &mut test_context(&mut errors, 0));
        for address in [BASE, BASE + 4] {
            flash.program(address, 4, 0, &mut test_context(&mut errors, 0));
        }
        assert_eq!(flash.cells[..8], [0, 0, 0, 0, 0x5a, 0x5a, 0x5a, 0x5a]);
    }
}

//! The engine that executes instructions, its memory map, and the hooks that stop it.
//!
//! The engine has no NVIC, no SysTick and no exception entry, and does not stop by itself. A hook
//! before each instruction advances time by one cycle, and stops the engine if an event is due, an
//! exception is pending, the flash is busy or the core sleeps.

use crate::cost::{self, Follower};
use crate::flash;
use crate::nvic::Masks;
use crate::soc::{Soc, is_flash};
use crate::time::Time;
use unicorn_engine::{Arch, HookType, Mode, Prot, Unicorn, uc_error};

/// SRAM1 and SRAM2.
pub const RAM: u32 = 0x2000_0000;
/// 128 KiB.
pub const RAM_LEN: usize = 128 << 10;
const FACTORY: u64 = 0x1fff_7000;

/// An instruction that the engine must not execute itself.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Special {
    /// WFI
    Sleep,
    /// WFE, SEV, YIELD: executed as no operation.
    Hint,
    /// MRS of IPSR or a combination with it, which the engine always reads as 0.
    ReadXpsr { to: u8, which: u8 },
    /// A floating-point instruction while CPACR disables the unit.
    NoCoprocessor,
}

/// Data that the hooks share with the loop around the engine.
pub(crate) struct Hooked {
    /// The chip.
    pub soc: Soc,
    /// The instructions in flash.
    pub instructions: Vec<Instruction>,
    /// What they take at most.
    pub follower: Follower,
    /// The engine must stop before the next instruction at or after this time.
    pub deadline: Time,
    /// An exception or a transfer may have become possible: stop before the next instruction.
    pub recheck: bool,
    /// Remaining instructions of an IT block. It is not interrupted, because the engine cannot
    /// resume within one.
    pub it_left: u32,
    pub special: Option<Special>,
    /// Number of an engine exception.
    pub trap: Option<u32>,
    /// Address of an access to unmapped memory.
    pub unmapped: Option<u32>,
    /// Stores to the flash.
    pub stores: Vec<(u32, usize, u64)>,
}

pub(crate) type Engine<'a> = Unicorn<'a, Hooked>;

/// Unwraps a result of the engine that cannot be an error.
pub(crate) fn must<T>(result: Result<T, uc_error>) -> T {
    result.expect("a call that the engine accepts")
}

/// `size` bytes of a word, from byte `offset & 3`.
pub(crate) fn part(word: u32, offset: u64, size: usize) -> u64 {
    let word = u64::from(word >> (8 * (offset & 3)));
    if size >= 4 {
        word
    } else {
        word & ((1 << (8 * size)) - 1)
    }
}

/// Word and bit that an address in the bit-band alias of the peripherals refers to.
fn bit_band(offset: u64) -> (u32, u32) {
    let byte = 0x4000_0000 + (offset / 32) as u32;
    (byte & !3, (byte & 3) * 8 + (offset / 4 % 8) as u32)
}

impl Hooked {
    /// Updates deadline and pending checks after a register access.
    fn after_access(&mut self) {
        self.deadline = self.deadline.min(self.soc.next_event());
        // the loop checks the masks
        self.recheck |= self.soc.reset.is_some()
            || self.soc.nvic.to_enter(Masks::default()).is_some()
            || self.soc.is_transfer_pending();
    }

    fn read(&mut self, address: u32, size: usize) -> u64 {
        self.follower.cost.registers += 1;
        let word = self.soc.read(address & !3);
        self.after_access();
        part(word, u64::from(address), size)
    }

    fn write(&mut self, address: u32, value: u64) {
        self.follower.cost.registers += 1;
        self.soc
            .write(address & !3, (value as u32) << (8 * (address & 3)));
        self.after_access();
    }
}

fn map_memories(uc: &mut Engine<'static>) {
    let flash = uc.get_data().soc.flash.cells.clone();
    must(uc.mem_map(
        flash::BASE.into(),
        flash::LEN as u64,
        Prot::READ | Prot::EXEC,
    ));
    must(uc.mem_write(flash::BASE.into(), &flash));
    must(uc.mem_map(RAM.into(), RAM_LEN as u64, Prot::ALL));
    must(uc.mem_map(FACTORY, 0x1000, Prot::READ));
    // unique identifier, size of the flash in KiB, calibration of VREFINT and temperature sensor
    let vrefint = (1.21_f64 / 3.3 * 4095.0).round() as u16;
    for (address, value) in [
        (0xa10, 0x0042),
        (0xa22, 512),
        (0xa2a, vrefint),
        (0xa2c, 943),
        (0xa2e, 1200),
    ] {
        must(uc.mem_write(FACTORY + address, &u16::to_le_bytes(value)));
    }
    // after a reset the flash is also mapped at 0
    must(
        uc.mmio_map_ro(0, flash::LEN as u64, |uc: &mut Engine, offset, size| {
            let mut bytes = [0; 8];
            let cells = &uc.get_data().soc.flash.cells;
            bytes[..size].copy_from_slice(&cells[offset as usize..offset as usize + size]);
            u64::from_le_bytes(bytes)
        }),
    );
}

fn map_registers(uc: &mut Engine<'static>) {
    const PERIPHERALS: u32 = 0x4000_0000;
    const CORE: u32 = 0xe000_0000;
    must(uc.mmio_map(
        PERIPHERALS.into(),
        0x8_0000,
        Some(|uc: &mut Engine, offset: u64, size: usize| {
            uc.get_data_mut().read(PERIPHERALS + offset as u32, size)
        }),
        Some(|uc: &mut Engine, offset: u64, _: usize, value: u64| {
            uc.get_data_mut().write(PERIPHERALS + offset as u32, value);
        }),
    ));
    must(uc.mmio_map(
        0x4200_0000,
        0x100_0000,
        Some(|uc: &mut Engine, offset: u64, _: usize| {
            let (word, bit) = bit_band(offset);
            uc.get_data_mut().read(word, 4) >> bit & 1
        }),
        Some(|uc: &mut Engine, offset: u64, _: usize, value: u64| {
            let (word, bit) = bit_band(offset);
            let hooked = uc.get_data_mut();
            let old = hooked.read(word, 4);
            hooked.write(word, old & !(1 << bit) | (value & 1) << bit);
        }),
    ));
    must(uc.mmio_map(
        CORE.into(),
        0x10_0000,
        Some(|uc: &mut Engine, offset: u64, size: usize| {
            let hooked = uc.get_data_mut();
            let word = hooked.soc.read_private((CORE + offset as u32) & !3);
            hooked.after_access();
            part(word, offset, size)
        }),
        Some(|uc: &mut Engine, offset: u64, size: usize, value: u64| {
            let hooked = uc.get_data_mut();
            hooked
                .soc
                .write_private(CORE + offset as u32, value as u32, size);
            hooked.after_access();
        }),
    ));
}

/// The half-words of an instruction that is not in the flash.
fn fetch_from_ram(uc: &Engine, address: u32) -> [u16; 2] {
    let mut bytes = [0; 4];
    // at the end of the RAM there may be only one; executing an unreadable one causes a fault
    let _ = uc.mem_read(address.into(), &mut bytes[..2]);
    let _ = uc.mem_read(u64::from(address) + 2, &mut bytes[2..]);
    let [a, b, c, d] = bytes;
    [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]
}

/// Kind of an instruction, as far as the hook distinguishes them.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Kind {
    Plain,
    /// May clear interrupt masks: CPS, MSR.
    Unmasks,
    /// IT, with the count of instructions in its block.
    IfThen(u8),
    /// Floating point.
    Float,
    Special(Special),
}

fn kind([first, second]: [u16; 2]) -> Kind {
    match first {
        0xbf30 => Kind::Special(Special::Sleep),
        0xbf10 | 0xbf20 | 0xbf40 => Kind::Special(Special::Hint),
        it @ 0xbf00..=0xbfff if it & 0xf != 0 => {
            Kind::IfThen(4 - (it & 0xf).trailing_zeros() as u8)
        }
        0xb660..=0xb677 | 0xf380..=0xf39f => Kind::Unmasks,
        0xf3ef if second & 0xf0f9 == 0x8001 => {
            let (to, which) = ((second >> 8 & 15) as u8, (second & 7) as u8);
            Kind::Special(Special::ReadXpsr { to, which })
        }
        0xec00..=0xefff | 0xfc00..=0xffff if second & 0x0e00 == 0x0a00 => Kind::Float,
        _ => Kind::Plain,
    }
}

/// What the hook has to know of an instruction.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Instruction {
    kind: Kind,
    /// Cycles at most.
    cycles: u8,
}

fn instruction(code: [u16; 2]) -> Instruction {
    Instruction {
        kind: kind(code),
        cycles: cost::cycles(code),
    }
}

/// All instructions in flash, computed in advance because the hook runs for each.
pub(crate) fn instructions(cells: &[u8]) -> Vec<Instruction> {
    let half = |i: usize| match cells.get(i..i + 2) {
        Some(bytes) => u16::from_le_bytes([bytes[0], bytes[1]]),
        None => 0,
    };
    (0..cells.len())
        .step_by(2)
        .map(|i| instruction([half(i), half(i + 2)]))
        .collect()
}

/// Runs before every instruction.
fn before_instruction(uc: &mut Engine, address: u64, size: u32) {
    let address = address as u32;
    let in_flash = (address.wrapping_sub(flash::BASE) / 2) as usize;
    let Instruction { kind, cycles } = match uc.get_data().instructions.get(in_flash) {
        Some(instruction) => *instruction,
        None => instruction(fetch_from_ram(uc, address)),
    };
    let hooked = uc.get_data_mut();
    let now = hooked.soc.now;
    let interrupted = hooked.it_left == 0 && (hooked.recheck || now >= hooked.deadline);
    let stalls = hooked.soc.flash.busy_until() > now && is_flash(address);
    let special = match kind {
        Kind::Special(special) => Some(special),
        Kind::Float if !hooked.soc.scb.is_fpu_on() => Some(Special::NoCoprocessor),
        _ => None,
    };
    if interrupted || stalls || special.is_some() {
        hooked.special = special.filter(|_| !interrupted && !stalls);
        must(uc.emu_stop());
        return;
    }
    hooked.soc.pc = address;
    hooked.soc.now += hooked.soc.cycle;
    hooked.soc.instructions += 1;
    hooked
        .follower
        .follow(address, size, cycles, is_flash(address));
    hooked.it_left = hooked.it_left.saturating_sub(1);
    match kind {
        Kind::Unmasks => hooked.recheck |= hooked.soc.nvic.is_anything_pending(),
        Kind::IfThen(count) => hooked.it_left = count.into(),
        _ => {}
    }
}

fn add_hooks(uc: &mut Engine<'static>) {
    must(uc.add_code_hook(1, 0, before_instruction));
    must(
        uc.add_mem_hook(HookType::MEM_UNMAPPED, 1, 0, |uc, _, address, _, _| {
            uc.get_data_mut().unmapped = Some(address as u32);
            false
        }),
    );
    // stores to the flash reach the engine's copy, which is then corrected by `flush_flash`
    must(uc.add_mem_hook(
        HookType::MEM_WRITE_PROT,
        1,
        0,
        |uc, _, address, size, value| {
            let hooked = uc.get_data_mut();
            if !is_flash(address as u32) {
                hooked.unmapped = Some(address as u32);
                return false;
            }
            hooked.stores.push((address as u32, size, value as u64));
            hooked.recheck = true;
            true
        },
    ));
    must(uc.add_intr_hook(|uc, number| {
        uc.get_data_mut().trap = Some(number);
        must(uc.emu_stop());
    }));
}

/// An engine with the memories and registers of the chip.
pub(crate) fn new(soc: Soc) -> Engine<'static> {
    let hooked = Hooked {
        instructions: instructions(&soc.flash.cells),
        follower: Follower::default(),
        soc,
        deadline: 0,
        recheck: false,
        it_left: 0,
        special: None,
        trap: None,
        unmapped: None,
        stores: vec![],
    };
    let mode = Mode::THUMB | Mode::MCLASS;
    let mut uc = must(Unicorn::new_with_data(Arch::ARM, mode, hooked));
    map_memories(&mut uc);
    map_registers(&mut uc);
    add_hooks(&mut uc);
    uc
}

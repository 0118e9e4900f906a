//! The core: instructions by the unicorn engine; exceptions, sleep, faults and time by hand.
//!
//! The engine knows no NVIC, SysTick or exception entry, and stops at nothing by itself. A hook
//! before each instruction advances time by one cycle and stops the engine when something else
//! has to happen: an event is due, an exception is pending, the flash is busy, the core sleeps.

use crate::flash::{self, mix};
use crate::nvic::{BUS_FAULT, HARD_FAULT, Masks, SV_CALL, USAGE_FAULT};
use crate::rcc::ResetCause;
use crate::scb;
use crate::soc::{Soc, is_flash};
use crate::time::Time;
use unicorn_engine::{Arch, HookType, Mode, Prot, RegisterARM as R, Unicorn, uc_error};

/// SRAM1 and SRAM2.
pub const RAM: u32 = 0x2000_0000;
/// 128 KiB.
pub const RAM_LEN: usize = 128 << 10;
const FACTORY: u64 = 0x1fff_7000;
const ENTRY_CYCLES: u64 = 12;
const EXIT_CYCLES: u64 = 10;
const TAIL_CHAIN_CYCLES: u64 = 6;

/// Why the engine stopped before an instruction that it must not execute itself.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Special {
    /// WFI
    Sleep,
    /// WFE, SEV, YIELD: nothing.
    Hint,
    /// MRS of IPSR or a combination with it, which the engine always reads as 0.
    ReadXpsr { to: u8, which: u8 },
    /// Floating point while CPACR forbids it.
    NoCoprocessor,
}

/// What the engine's hooks tell the loop around it.
pub(crate) struct Hooked {
    /// The chip.
    pub soc: Soc,
    /// What the instructions in flash are.
    kinds: Vec<Kind>,
    /// The engine must stop before the next instruction at or after this.
    deadline: Time,
    /// An exception or a transfer may have become possible: stop before the next instruction.
    recheck: bool,
    /// Instructions left of an IT block: it is not interrupted, the engine cannot resume in one.
    it_left: u32,
    special: Option<Special>,
    /// Number of an engine exception.
    trap: Option<u32>,
    /// Address of an access where nothing is.
    unmapped: Option<u32>,
    /// Stores to the flash.
    stores: Vec<(u32, usize, u64)>,
}

/// One exception entered or left.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ExceptionEvent {
    /// When, in exact units.
    pub at: Time,
    /// 16 + the interrupt's number, or a system exception.
    pub exception: usize,
    /// Entered, or left.
    pub entered: bool,
    /// Instructions executed so far.
    pub instructions: u64,
}

/// The core with its memories.
pub(crate) struct Cpu {
    uc: Unicorn<'static, Hooked>,
    asleep: bool,
    locked_up: bool,
    /// Where exceptions are written down, if anybody wants to know.
    pub trace: Option<Vec<ExceptionEvent>>,
}

type Engine<'a> = Unicorn<'a, Hooked>;

fn must<T>(result: Result<T, uc_error>) -> T {
    result.expect("the engine accepts what it always accepts")
}

/// Bytes `offset & 3` and up of a word, `size` of them.
fn part(word: u32, offset: u64, size: usize) -> u64 {
    let word = u64::from(word >> (8 * (offset & 3)));
    if size >= 4 {
        word
    } else {
        word & ((1 << (8 * size)) - 1)
    }
}

/// Word and bit behind an address of the bit-band alias of the peripherals.
fn bit_band(offset: u64) -> (u32, u32) {
    let byte = 0x4000_0000 + (offset / 32) as u32;
    (byte & !3, (byte & 3) * 8 + (offset / 4 % 8) as u32)
}

impl Hooked {
    /// After a register access: whatever it started must be noticed in time.
    fn after_access(&mut self) {
        self.deadline = self.deadline.min(self.soc.next_event());
        // the masks are looked at by the loop
        self.recheck |= self.soc.reset.is_some()
            || self.soc.nvic.to_enter(Masks::default()).is_some()
            || self.soc.is_asked_for_transfer();
    }

    fn read(&mut self, address: u32, size: usize) -> u64 {
        let word = self.soc.read(address & !3);
        self.after_access();
        part(word, u64::from(address), size)
    }

    fn write(&mut self, address: u32, value: u64) {
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
    // at reset the flash also answers at 0
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

/// The half-words of an instruction outside of the flash.
fn fetch_from_ram(uc: &Engine, address: u32) -> [u16; 2] {
    let mut bytes = [0; 4];
    // at the end of the RAM there may be only one; what cannot be read will fault by itself
    let _ = uc.mem_read(address.into(), &mut bytes[..2]);
    let _ = uc.mem_read(u64::from(address) + 2, &mut bytes[2..]);
    let [a, b, c, d] = bytes;
    [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]
}

/// What the hook has to know of an instruction.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Kind {
    Plain,
    /// Opens masks: CPS, MSR.
    Unmasks,
    /// IT, and how many instructions belong to it.
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

/// The kinds of all instructions in flash, told beforehand as the hook runs so often.
fn kinds(cells: &[u8]) -> Vec<Kind> {
    let half = |i: usize| match cells.get(i..i + 2) {
        Some(bytes) => u16::from_le_bytes([bytes[0], bytes[1]]),
        None => 0,
    };
    (0..cells.len())
        .step_by(2)
        .map(|i| kind([half(i), half(i + 2)]))
        .collect()
}

/// Runs before every instruction.
fn before_instruction(uc: &mut Engine, address: u64, _size: u32) {
    let address = address as u32;
    let in_flash = (address.wrapping_sub(flash::BASE) / 2) as usize;
    let kind = match uc.get_data().kinds.get(in_flash) {
        Some(kind) => *kind,
        None => kind(fetch_from_ram(uc, address)),
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
    // stores to the flash reach the engine's copy; what they really do is put there afterwards
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

impl Cpu {
    /// A core whose flash and peripherals are those of `soc`, before its first reset.
    pub fn new(soc: Soc) -> Cpu {
        let hooked = Hooked {
            kinds: kinds(&soc.flash.cells),
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
        let mut cpu = Cpu {
            uc,
            asleep: false,
            locked_up: false,
            trace: None,
        };
        cpu.scramble_ram(0);
        cpu.boot();
        cpu
    }

    /// The chip.
    pub fn soc(&self) -> &Soc {
        &self.uc.get_data().soc
    }

    /// The chip.
    pub fn soc_mut(&mut self) -> &mut Soc {
        &mut self.uc.get_data_mut().soc
    }

    fn reg(&self, register: R) -> u32 {
        must(self.uc.reg_read(register)) as u32
    }

    fn set_reg(&mut self, register: R, value: u32) {
        must(self.uc.reg_write(register, value.into()));
    }

    /// Bytes of RAM, flash or factory area; none if nothing is there.
    pub fn memory(&self, address: u32, len: usize) -> Option<Vec<u8>> {
        self.uc.mem_read_as_vec(address.into(), len).ok()
    }

    /// Overwrites RAM.
    pub fn set_memory(&mut self, address: u32, bytes: &[u8]) {
        must(self.uc.mem_write(address.into(), bytes));
    }

    fn word(&self, address: u32) -> u32 {
        // the flash's alias at 0
        let address = if address < flash::LEN as u32 {
            address + flash::BASE
        } else {
            address
        };
        let bytes = self.memory(address, 4).unwrap_or_default();
        bytes.try_into().map_or(0, u32::from_le_bytes)
    }

    /// RAM that has lost its supply: no word can be relied on.
    pub fn scramble_ram(&mut self, seed: u64) {
        let mut seed = seed;
        let bytes: Vec<u8> = (0..RAM_LEN / 8)
            .flat_map(|_| mix(&mut seed).to_le_bytes())
            .collect();
        self.set_memory(RAM, &bytes);
    }

    /// Resets the chip; RAM stays as it is.
    pub fn reset(&mut self, cause: ResetCause) {
        self.soc_mut().reset(cause);
        self.boot();
    }

    /// Registers of the core as after a reset, PC and SP from the vector table.
    fn boot(&mut self) {
        self.flush_flash();
        let hooked = self.uc.get_data_mut();
        (hooked.recheck, hooked.it_left, hooked.trap, hooked.unmapped) = (false, 0, None, None);
        hooked.stores.clear();
        (self.asleep, self.locked_up) = (false, false);
        for register in [
            R::PRIMASK,
            R::BASEPRI,
            R::FAULTMASK,
            R::CONTROL,
            R::XPSR_NZCVQG,
            R::FPSCR,
        ] {
            self.set_reg(register, 0);
        }
        for i in 0..13 {
            must(self.uc.reg_write(R::R0 as i32 + i, 0));
        }
        self.set_reg(R::SP, self.word(0) & !3);
        self.set_reg(R::LR, 0xffff_ffff);
        self.set_reg(R::PC, self.word(4) | 1);
    }

    /// Overwrites cells of the flash, code included.
    pub fn write_flash(&mut self, start: usize, bytes: &[u8]) {
        let range = start..start + bytes.len();
        let flash = &mut self.soc_mut().flash;
        flash.cells[range.clone()].copy_from_slice(bytes);
        flash.changed.push(range);
        self.flush_flash();
        must(self.uc.ctl_flush_tb());
    }

    /// Brings the engine's copy of the flash up to date.
    fn flush_flash(&mut self) {
        for range in std::mem::take(&mut self.soc_mut().flash.changed) {
            let bytes = self.soc().flash.cells[range.clone()].to_vec();
            self.set_memory(flash::BASE + range.start as u32, &bytes);
            // an instruction may span two words
            let (from, to) = (range.start.saturating_sub(2) & !1, (range.end + 1) & !1);
            let hooked = self.uc.get_data_mut();
            let cells = &hooked.soc.flash.cells[from..(to + 2).min(flash::LEN)];
            let new = kinds(cells);
            hooked.kinds[from / 2..to / 2].copy_from_slice(&new[..(to - from) / 2]);
        }
    }

    fn masks(&self) -> Masks {
        Masks {
            primask: self.reg(R::PRIMASK) & 1 != 0,
            faultmask: self.reg(R::FAULTMASK) & 1 != 0,
            basepri: (self.reg(R::BASEPRI) & 0xf0) as u8,
        }
    }

    /// Runs to `end`, or to a reset that the chip asks for.
    pub fn run_until(&mut self, end: Time) -> Option<ResetCause> {
        loop {
            self.soc_mut().fire_due();
            self.serve_dma();
            if let Some(cause) = self.soc_mut().reset.take() {
                return Some(cause);
            }
            let now = self.soc().now;
            if now >= end {
                return None;
            }
            let next = self.soc().next_event().min(end);
            let busy_until = self.soc().flash.busy_until();
            if self.locked_up || busy_until > now && is_flash(self.reg(R::PC)) {
                // a core that waits for the flash takes no exceptions either
                self.soc_mut().now = next;
                continue;
            }
            let masks = self.masks();
            if self.asleep {
                if !self.soc().nvic.wakes(masks) {
                    self.pass_asleep(next);
                    continue;
                }
                self.asleep = false;
            }
            if let Some(exception) = self.soc().nvic.to_enter(masks) {
                self.enter(exception);
                continue;
            }
            self.execute(next);
        }
    }

    fn pass_asleep(&mut self, until: Time) {
        let soc = self.soc_mut();
        let now = soc.now;
        soc.cycles.advance(now, false);
        soc.cycles.advance(until, true);
        soc.now = until;
    }

    fn serve_dma(&mut self) {
        while let Some((controller, stream, transfer)) = self.soc_mut().next_transfer() {
            let done = self
                .bus_read(transfer.from, transfer.size)
                .is_some_and(|value| self.bus_write(transfer.to, transfer.size, value));
            if !done {
                self.soc_mut().transfer_failed(controller, stream, transfer);
            }
        }
    }

    fn bus_read(&mut self, address: u32, size: usize) -> Option<u32> {
        if (0x4000_0000..0x4008_0000).contains(&address) {
            return Some(part(self.soc_mut().read(address & !3), address.into(), size) as u32);
        }
        let mut word = [0; 4];
        word[..size].copy_from_slice(&self.memory(address, size)?);
        Some(u32::from_le_bytes(word))
    }

    fn bus_write(&mut self, address: u32, size: usize, value: u32) -> bool {
        if (0x4000_0000..0x4008_0000).contains(&address) {
            self.soc_mut()
                .write(address & !3, value << (8 * (address & 3)));
            return true;
        }
        let in_ram = address >= RAM && address as usize + size <= RAM as usize + RAM_LEN;
        in_ram
            && self
                .uc
                .mem_write(address.into(), &value.to_le_bytes()[..size])
                .is_ok()
    }

    /// Lets the engine execute until something else has to happen.
    fn execute(&mut self, deadline: Time) {
        let hooked = self.uc.get_data_mut();
        (hooked.deadline, hooked.recheck, hooked.it_left) = (deadline, false, 0);
        let pc = self.reg(R::PC);
        let result = self.uc.emu_start(u64::from(pc | 1), 0, 0, 0);
        let hooked = self.uc.get_data_mut();
        let (special, trap) = (hooked.special.take(), hooked.trap.take());
        let unmapped = hooked.unmapped.take();
        for (address, size, value) in std::mem::take(&mut hooked.stores) {
            hooked.soc.program(address, size, value);
        }
        self.flush_flash();
        match (trap, special, result) {
            (Some(8), ..) => self.exception_return(),
            (Some(2), ..) => self.soc_mut().nvic.pend(SV_CALL),
            (Some(7), ..) => {
                self.soc_mut().scb.hfsr |= scb::DEBUGEVT;
                self.fault(HARD_FAULT, 0, None);
            }
            (Some(number), ..) => {
                let cfsr = if number == 18 {
                    scb::INVSTATE
                } else {
                    scb::UNDEFINSTR
                };
                self.fault(USAGE_FAULT, cfsr, None);
            }
            (_, _, Err(error)) => self.engine_error(error, unmapped),
            (_, Some(special), _) => self.emulate(special),
            _ => {}
        }
    }

    fn engine_error(&mut self, error: uc_error, unmapped: Option<u32>) {
        match error {
            uc_error::INSN_INVALID => self.fault(USAGE_FAULT, scb::UNDEFINSTR, None),
            uc_error::EXCEPTION => self.fault(USAGE_FAULT, scb::INVSTATE, None),
            uc_error::FETCH_UNMAPPED | uc_error::FETCH_PROT => {
                self.fault(BUS_FAULT, scb::IBUSERR, None);
            }
            _ => self.fault(BUS_FAULT, scb::PRECISERR, Some(unmapped.unwrap_or(0))),
        }
    }

    fn emulate(&mut self, special: Special) {
        let pc = self.reg(R::PC);
        let soc = self.soc_mut();
        soc.now += soc.cycle;
        soc.instructions += 1;
        let len = match special {
            Special::NoCoprocessor => return self.fault(USAGE_FAULT, scb::NOCP, None),
            Special::Sleep => {
                self.asleep = true;
                2
            }
            Special::Hint => 2,
            Special::ReadXpsr { to, which } => {
                let flags = if which & 4 == 0 {
                    self.reg(R::XPSR) & 0xf80f_0000
                } else {
                    0
                };
                let value = flags | self.soc().nvic.running() as u32;
                must(
                    self.uc
                        .reg_write(R::R0 as i32 + i32::from(to), value.into()),
                );
                4
            }
        };
        self.set_reg(R::PC, (pc + len) | 1);
    }

    // ---- exceptions ----------------------------------------------------------------------------

    /// A fault at the present instruction: its own exception if enabled, else a hard fault, and
    /// in a hard fault the core locks up.
    fn fault(&mut self, kind: usize, cfsr: u32, address: Option<u32>) {
        let pc = self.reg(R::PC);
        let priority = self.soc().nvic.execution_priority(self.masks());
        let soc = self.soc_mut();
        soc.pc = pc;
        soc.scb.cfsr |= cfsr;
        if let Some(address) = address {
            soc.scb.bfar = address;
        }
        let text = match address {
            Some(address) => format!("fault: nothing answers at {address:#010x}"),
            None => format!("fault: exception {kind}, CFSR {cfsr:#x}"),
        };
        soc.error(text);
        let enabled = match kind {
            BUS_FAULT => soc.scb.shcsr & 1 << 17 != 0,
            USAGE_FAULT => soc.scb.shcsr & 1 << 18 != 0,
            _ => false,
        };
        if enabled && soc.nvic.priority(kind) < priority {
            return self.enter(kind);
        }
        if priority < 0 {
            soc.error("lock-up: a fault in a fault handler");
            self.locked_up = true;
            return;
        }
        if kind != HARD_FAULT {
            soc.scb.hfsr |= scb::FORCED;
        }
        self.enter(HARD_FAULT);
    }

    fn note(&mut self, exception: usize, entered: bool) {
        let (at, instructions) = (self.soc().now, self.soc().instructions);
        if let Some(trace) = &mut self.trace {
            trace.push(ExceptionEvent {
                at,
                exception,
                entered,
                instructions,
            });
        }
    }

    fn spend(&mut self, cycles: u64) {
        let soc = self.soc_mut();
        soc.now += cycles * soc.cycle;
    }

    /// Stacks a frame and jumps to the handler of `exception`.
    fn enter(&mut self, exception: usize) {
        let control = self.reg(R::CONTROL);
        let floats = control & 4 != 0;
        if control & 2 != 0 {
            self.soc_mut()
                .error("model: the process stack is not modelled");
        }
        let old_sp = self.reg(R::SP);
        let padded = old_sp & 4 != 0;
        let sp = (old_sp.wrapping_sub(if floats { 0x68 } else { 0x20 })) & !7;
        let frame = self.frame(padded, floats);
        let thread = self.soc().nvic.depth() == 0;
        let lr = 0xffff_ffe1 | u32::from(!floats) << 4 | u32::from(thread) << 3;
        self.set_reg(R::SP, sp);
        self.set_reg(R::LR, lr);
        self.set_reg(R::CONTROL, control & !4);
        let mut exception = exception;
        if self.uc.mem_write(sp.into(), &frame).is_err() {
            // the handler that was meant stays pending behind the hard fault
            let soc = self.soc_mut();
            soc.error(format!("fault: no stack at {sp:#010x}"));
            soc.scb.cfsr |= scb::STKERR;
            soc.scb.hfsr |= scb::FORCED;
            exception = HARD_FAULT;
        }
        self.spend(ENTRY_CYCLES);
        self.start_handler(exception);
    }

    fn start_handler(&mut self, exception: usize) {
        self.soc_mut().nvic.enter(exception);
        self.note(exception, true);
        let handler = self.word(self.soc().scb.vtor + 4 * exception as u32);
        self.set_reg(R::PC, handler | 1);
    }

    /// The registers that an exception saves. The engine's lazy saving is not needed.
    fn frame(&self, padded: bool, floats: bool) -> Vec<u8> {
        let running = self.soc().nvic.running() as u32;
        let flags = self.reg(R::XPSR) & 0xf80f_0000;
        let xpsr = flags | 1 << 24 | u32::from(padded) << 9 | running;
        let mut words = [R::R0, R::R1, R::R2, R::R3, R::R12, R::LR]
            .map(|r| self.reg(r))
            .to_vec();
        words.extend([self.reg(R::PC) & !1, xpsr]);
        if floats {
            let single = |i: i32| must(self.uc.reg_read(R::S0 as i32 + i)) as u32;
            words.extend((0..16).map(single));
            words.extend([self.reg(R::FPSCR), 0]);
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }

    /// The handler branched to EXC_RETURN: on to the next handler, or back.
    fn exception_return(&mut self) {
        let exc_return = self.reg(R::PC) | 1;
        let left = self.soc().nvic.running();
        self.soc_mut().nvic.leave();
        if left != 2 {
            self.set_reg(R::FAULTMASK, 0);
        }
        self.note(left, false);
        if let Some(next) = self.soc().nvic.to_enter(self.masks()) {
            // tail-chaining: the frame stays for the next handler
            self.set_reg(R::LR, exc_return);
            self.spend(TAIL_CHAIN_CYCLES);
            return self.start_handler(next);
        }
        let floats = exc_return & 0x10 == 0;
        let sp = self.reg(R::SP);
        let len = if floats { 0x68 } else { 0x20 };
        let Some(frame) = self.memory(sp, len) else {
            return self.fault(BUS_FAULT, scb::UNSTKERR, Some(sp));
        };
        self.unstack(&frame, sp + len as u32, floats);
        self.spend(EXIT_CYCLES);
        let sleeps = self.soc().scb.scr & scb::SLEEPONEXIT != 0;
        self.asleep = sleeps && self.soc().nvic.depth() == 0;
    }

    fn unstack(&mut self, frame: &[u8], sp: u32, floats: bool) {
        let word = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| frame[4 * i + k]));
        for (i, register) in [R::R0, R::R1, R::R2, R::R3, R::R12, R::LR]
            .into_iter()
            .enumerate()
        {
            self.set_reg(register, word(i));
        }
        if floats {
            for i in 0..16 {
                must(
                    self.uc
                        .reg_write(R::S0 as i32 + i as i32, word(8 + i).into()),
                );
            }
            self.set_reg(R::FPSCR, word(24));
        }
        let control = self.reg(R::CONTROL) & !4 | u32::from(floats) << 2;
        self.set_reg(R::CONTROL, control);
        self.set_reg(R::SP, sp + if word(7) >> 9 & 1 != 0 { 4 } else { 0 });
        self.set_reg(R::XPSR_NZCVQG, word(7));
        self.set_reg(R::PC, word(6) | 1);
    }

    /// Whether the core waits for an interrupt.
    pub fn is_asleep(&self) -> bool {
        self.asleep
    }

    /// Whether a fault in a fault handler has stopped the core.
    pub fn is_locked_up(&self) -> bool {
        self.locked_up
    }

    /// The next instruction's address.
    pub fn pc(&self) -> u32 {
        self.reg(R::PC) & !1
    }

    /// Runs out the clock while there is no supply.
    pub fn pass_unpowered(&mut self, until: Time) {
        self.soc_mut().now = until;
    }
}

//! The core: the engine executes instructions; this adds what the engine lacks: sleep, stalls,
//! resets, DMA.

use crate::cost::Cost;
use crate::engine::{self, Engine, RAM, RAM_LEN, Special, instructions, must, part};
use crate::flash::{self, mix};
use crate::nvic::{BUS_FAULT, HARD_FAULT, Masks, SV_CALL, USAGE_FAULT};
use crate::rcc::ResetCause;
use crate::scb;
use crate::soc::{Soc, is_flash};
use crate::time::Time;
use unicorn_engine::{HookType, RegisterARM as R, uc_error};

/// One exception entered or left.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ExceptionEvent {
    /// Time of the event.
    pub time_ns: u64,
    /// Exception number: 16 plus the interrupt number, or a system exception.
    pub exception: usize,
    /// True if entered, false if left.
    pub entered: bool,
    /// Instructions executed so far.
    pub instructions: u64,
    /// What these take at most; without loads from the flash unless they are counted.
    pub cost: Cost,
}

/// The core with its memories.
pub(crate) struct Cpu {
    pub(crate) uc: Engine<'static>,
    pub(crate) asleep: bool,
    pub(crate) locked_up: bool,
    /// True while the core executes nothing; everything else continues.
    pub held: bool,
    /// A debugger halts the core at a hard fault.
    pub catches_hard_fault: bool,
    /// Recorded exceptions; none while they are not recorded.
    pub trace: Option<Vec<ExceptionEvent>>,
}

impl Cpu {
    /// A core with the flash and the peripherals of `soc`, before its first reset.
    pub fn new(soc: Soc) -> Cpu {
        let uc = engine::new(soc);
        let mut cpu = Cpu {
            uc,
            asleep: false,
            locked_up: false,
            held: false,
            catches_hard_fault: false,
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

    pub(crate) fn reg(&self, register: R) -> u32 {
        must(self.uc.reg_read(register)) as u32
    }

    pub(crate) fn set_reg(&mut self, register: R, value: u32) {
        must(self.uc.reg_write(register, value.into()));
    }

    /// Bytes of RAM, flash or factory area; none if the address is not mapped.
    pub fn memory(&self, address: u32, len: usize) -> Option<Vec<u8>> {
        self.uc.mem_read_as_vec(address.into(), len).ok()
    }

    /// From now on `bits` of the word at `address` read as 1.
    pub fn stick_ram(&mut self, address: u32, bits: u32) {
        let (begin, end) = (u64::from(address), u64::from(address) + 3);
        let stuck = HookType::MEM_READ;
        must(
            self.uc
                .add_mem_hook(stuck, begin, end, move |uc, _, _, _, _| {
                    let mut word = [0; 4];
                    must(uc.mem_read(begin, &mut word));
                    let read = u32::from_le_bytes(word) | bits;
                    must(uc.mem_write(begin, &read.to_le_bytes()));
                    true
                }),
        );
        // Code that is translated already would not call the hook.
        must(self.uc.ctl_flush_tb());
    }

    /// From now on loads from the flash are counted, which makes every load slow.
    pub fn count_loads(&mut self) {
        let (begin, end) = (
            u64::from(flash::BASE),
            u64::from(flash::BASE) + flash::LEN as u64 - 1,
        );
        must(
            self.uc
                .add_mem_hook(HookType::MEM_READ, begin, end, |uc, _, _, _, _| {
                    uc.get_data_mut().follower.load();
                    true
                }),
        );
        // Code that is translated already would not call the hook.
        must(self.uc.ctl_flush_tb());
    }

    /// Overwrites RAM.
    pub fn set_memory(&mut self, address: u32, bytes: &[u8]) {
        must(self.uc.mem_write(address.into(), bytes));
    }

    pub(crate) fn word(&self, address: u32) -> u32 {
        // the alias of the flash at 0
        let address = if address < flash::LEN as u32 {
            address + flash::BASE
        } else {
            address
        };
        let bytes = self.memory(address, 4).unwrap_or_default();
        bytes.try_into().map_or(0, u32::from_le_bytes)
    }

    /// Fills the RAM with random words, as after power-on.
    pub fn scramble_ram(&mut self, seed: u64) {
        let mut seed = seed;
        let bytes: Vec<u8> = (0..RAM_LEN / 8)
            .flat_map(|_| mix(&mut seed).to_le_bytes())
            .collect();
        self.set_memory(RAM, &bytes);
    }

    /// Resets the chip; RAM keeps its content.
    pub fn reset(&mut self, cause: ResetCause) {
        self.soc_mut().reset(cause);
        self.boot();
    }

    /// Sets the core registers to their reset values, PC and SP from the vector table.
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

    /// Overwrites cells of the flash, which may contain code.
    pub fn write_flash(&mut self, start: usize, bytes: &[u8]) {
        let range = start..start + bytes.len();
        let flash = &mut self.soc_mut().flash;
        flash.cells[range.clone()].copy_from_slice(bytes);
        flash.changed.push(range);
        self.flush_flash();
        must(self.uc.ctl_flush_tb());
    }

    /// Updates the engine's copy of the flash.
    fn flush_flash(&mut self) {
        for range in std::mem::take(&mut self.soc_mut().flash.changed) {
            let bytes = self.soc().flash.cells[range.clone()].to_vec();
            self.set_memory(flash::BASE + range.start as u32, &bytes);
            // an instruction may span two words
            let (from, to) = (range.start.saturating_sub(2) & !1, (range.end + 1) & !1);
            let hooked = self.uc.get_data_mut();
            let cells = &hooked.soc.flash.cells[from..(to + 2).min(flash::LEN)];
            let new = instructions(cells);
            hooked.instructions[from / 2..to / 2].copy_from_slice(&new[..(to - from) / 2]);
        }
    }

    pub(crate) fn masks(&self) -> Masks {
        Masks {
            primask: self.reg(R::PRIMASK) & 1 != 0,
            faultmask: self.reg(R::FAULTMASK) & 1 != 0,
            basepri: (self.reg(R::BASEPRI) & 0xf0) as u8,
        }
    }

    /// Runs until `end`, or until the chip requests a reset.
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
            let waits = busy_until > now && is_flash(self.reg(R::PC));
            let stopped = self.held || self.soc().halted || !self.soc().rcc.is_clocked();
            if self.locked_up || stopped || waits {
                // while the core waits for the flash it takes no exceptions either
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

    /// Lets the engine execute until a hook stops it.
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

    /// Whether the core waits for an interrupt.
    pub fn is_asleep(&self) -> bool {
        self.asleep
    }

    /// Whether the core is in lock-up, after a fault in a fault handler.
    pub fn is_locked_up(&self) -> bool {
        self.locked_up
    }

    /// Address of the next instruction.
    pub fn pc(&self) -> u32 {
        self.reg(R::PC) & !1
    }

    /// Stack pointer.
    pub fn sp(&self) -> u32 {
        self.reg(R::SP)
    }

    /// Advances time while the supply is off.
    pub fn pass_unpowered(&mut self, until: Time) {
        self.soc_mut().now = until;
    }
}

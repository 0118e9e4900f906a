//! Exception entry and return, and faults (ARMv7-M, B1.5).

use crate::cpu::{Cpu, ExceptionEvent};
use crate::engine::must;
use crate::nvic::{BUS_FAULT, HARD_FAULT, USAGE_FAULT};
use crate::scb;
use crate::time::to_ns;
use unicorn_engine::RegisterARM as R;

const ENTRY_CYCLES: u64 = 12;
const EXIT_CYCLES: u64 = 10;
const TAIL_CHAIN_CYCLES: u64 = 6;

impl Cpu {
    /// Raises a fault at the current instruction: its own exception if that is enabled, else a hard
    /// fault; within a hard fault the core locks up.
    pub(crate) fn fault(&mut self, kind: usize, cfsr: u32, address: Option<u32>) {
        let pc = self.reg(R::PC);
        let priority = self.soc().nvic.execution_priority(self.masks());
        let soc = self.soc_mut();
        soc.pc = pc;
        soc.scb.cfsr |= cfsr;
        if let Some(address) = address {
            soc.scb.bfar = address;
        }
        let text = match address {
            Some(address) => format!("fault: no memory at {address:#010x}"),
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

    fn record(&mut self, exception: usize, entered: bool) {
        let (time_ns, instructions) = (to_ns(self.soc().now), self.soc().instructions);
        let cost = self.uc.get_data().follower.cost;
        if let Some(trace) = &mut self.trace {
            trace.push(ExceptionEvent {
                time_ns,
                exception,
                entered,
                instructions,
                cost,
            });
        }
    }

    fn spend(&mut self, cycles: u64) {
        self.uc.get_data_mut().follower.cost.core_cycles += cycles;
        let soc = self.soc_mut();
        soc.now += cycles * soc.cycle;
    }

    /// Pushes a frame and jumps to the handler of `exception`.
    pub(crate) fn enter(&mut self, exception: usize) {
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
            // the original exception stays pending during the hard fault
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
        if exception == HARD_FAULT && self.catches_hard_fault {
            self.soc_mut().halt(true);
        }
        self.record(exception, true);
        let handler = self.word(self.soc().scb.vtor + 4 * exception as u32);
        self.set_reg(R::PC, handler | 1);
    }

    /// The stack frame of an exception. Floating-point registers are saved at once, not lazily.
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

    /// Handles a branch to EXC_RETURN: enters the next handler, or returns.
    pub(crate) fn exception_return(&mut self) {
        let exc_return = self.reg(R::PC) | 1;
        let left = self.soc().nvic.running();
        self.soc_mut().nvic.leave();
        if left != 2 {
            self.set_reg(R::FAULTMASK, 0);
        }
        self.record(left, false);
        if let Some(next) = self.soc().nvic.to_enter(self.masks()) {
            // tail-chaining: the next handler uses the same frame
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
}

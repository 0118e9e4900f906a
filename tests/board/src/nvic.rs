//! NVIC and the exception part of the SCB: selects the next exception (ARMv7-M, B1.5 and B3.4).

/// System exceptions and the 97 interrupts of the F446.
pub const EXCEPTIONS: usize = 16 + 97;
/// Exception numbers of the core.
pub const HARD_FAULT: usize = 3;
/// See [`HARD_FAULT`].
pub const BUS_FAULT: usize = 5;
/// See [`HARD_FAULT`].
pub const USAGE_FAULT: usize = 6;
/// See [`HARD_FAULT`].
pub const SV_CALL: usize = 11;
/// See [`HARD_FAULT`].
pub const PEND_SV: usize = 14;
/// See [`HARD_FAULT`].
pub const SYS_TICK: usize = 15;
/// Priority of thread mode: below every exception.
pub const THREAD_PRIORITY: i32 = 256;

/// The mask registers of the core, which raise its priority.
#[derive(Clone, Copy, Default, Debug)]
pub struct Masks {
    /// PRIMASK
    pub primask: bool,
    /// FAULTMASK
    pub faultmask: bool,
    /// BASEPRI
    pub basepri: u8,
}

/// State of all exceptions; bit n of a set stands for exception n.
pub struct Nvic {
    enabled: u128,
    pending: u128,
    /// Interrupt lines that are high.
    lines: u128,
    /// Running and preempted exceptions; the running one is the last.
    active: Vec<usize>,
    priority: [u8; EXCEPTIONS],
    /// AIRCR.PRIGROUP
    pub prigroup: u32,
}

impl Default for Nvic {
    fn default() -> Self {
        Nvic {
            enabled: 0xffff,
            pending: 0,
            lines: 0,
            active: vec![],
            priority: [0; EXCEPTIONS],
            prigroup: 0,
        }
    }
}

impl Nvic {
    /// Priority of an exception; a lower number is more urgent.
    pub fn priority(&self, exception: usize) -> i32 {
        match exception {
            0..=3 => exception as i32 - 4,
            _ => i32::from(self.priority[exception]),
        }
    }

    /// The group part of a priority, which determines preemption.
    fn group(&self, priority: i32) -> i32 {
        if priority < 0 {
            priority
        } else {
            priority & !((2 << self.prigroup) - 1)
        }
    }

    /// The running exception; 0 in thread mode.
    pub fn running(&self) -> usize {
        self.active.last().copied().unwrap_or(0)
    }

    /// Count of running and preempted exceptions.
    pub fn depth(&self) -> usize {
        self.active.len()
    }

    /// The execution priority of the core.
    pub fn execution_priority(&self, masks: Masks) -> i32 {
        let active = self
            .active
            .iter()
            .map(|e| self.group(self.priority(*e)))
            .min();
        let mut priority = active.unwrap_or(THREAD_PRIORITY);
        if masks.basepri != 0 {
            priority = priority.min(self.group(i32::from(masks.basepri)));
        }
        if masks.primask {
            priority = priority.min(0);
        }
        if masks.faultmask {
            priority = priority.min(-1);
        }
        priority
    }

    /// The most urgent pending exception regardless of masks; of equal ones the lowest number.
    fn candidate(&self) -> Option<usize> {
        let mut set = self.pending & self.enabled;
        let mut best: Option<usize> = None;
        while set != 0 {
            let exception = set.trailing_zeros() as usize;
            set &= set - 1;
            if best.is_none_or(|b| self.priority(exception) < self.priority(b)) {
                best = Some(exception);
            }
        }
        best
    }

    /// Whether an enabled exception is pending.
    pub fn is_anything_pending(&self) -> bool {
        self.pending & self.enabled != 0
    }

    /// The exception to enter now, if one is more urgent than the execution priority.
    pub fn to_enter(&self, masks: Masks) -> Option<usize> {
        let exception = self.candidate()?;
        let urgent = self.group(self.priority(exception)) < self.execution_priority(masks);
        urgent.then_some(exception)
    }

    /// Whether WFI wakes up: like `to_enter`, but ignores PRIMASK.
    pub fn wakes(&self, masks: Masks) -> bool {
        self.to_enter(Masks {
            primask: false,
            ..masks
        })
        .is_some()
    }

    /// Marks an exception as running.
    pub fn enter(&mut self, exception: usize) {
        self.pending &= !(1 << exception);
        self.active.push(exception);
    }

    /// Ends the running exception; a line that is still high makes it pending again.
    pub fn leave(&mut self) {
        if let Some(exception) = self.active.pop() {
            self.pending |= self.lines & (1 << exception);
        }
    }

    /// Makes an exception pending.
    pub fn pend(&mut self, exception: usize) {
        self.pending |= 1 << exception;
    }

    /// Sets the levels of the interrupt lines (bit n: interrupt n).
    pub fn set_lines(&mut self, lines: u128) {
        self.lines = lines << 16;
        let running = self.active.iter().fold(0, |set, e| set | 1u128 << e);
        self.pending |= self.lines & !running;
    }

    fn word(set: u128, offset: u32) -> u32 {
        (set >> 16 >> (8 * (offset & 0x7c))) as u32
    }

    /// Reads a register of the NVIC; `address` is the low part after 0xE000_Exxx.
    pub fn read(&self, address: u32) -> u32 {
        match address {
            0x100..=0x10f | 0x180..=0x18f => Self::word(self.enabled, address),
            0x200..=0x20f | 0x280..=0x28f => Self::word(self.pending, address),
            0x300..=0x30f => {
                let active = self.active.iter().fold(0, |set, e| set | 1u128 << e);
                Self::word(active, address)
            }
            0x400..=0x463 => self.priorities(16 + (address as usize - 0x400)),
            0xd18..=0xd23 => self.priorities(4 + (address as usize - 0xd18)),
            _ => 0,
        }
    }

    fn priorities(&self, first: usize) -> u32 {
        let byte = |i: usize| u32::from(self.priority.get(first + i).copied().unwrap_or(0));
        (0..4).fold(0, |word, i| word | byte(i) << (8 * i))
    }

    /// Writes a register of the NVIC; priorities take bytes, half-words and words.
    pub fn write(&mut self, address: u32, value: u32, size: usize) {
        let bits = u128::from(value) << (8 * (address & 0x7c)) << 16;
        let known = (1 << EXCEPTIONS) - 1;
        match address {
            0x100..=0x10f => self.enabled |= bits & known,
            0x180..=0x18f => self.enabled &= !bits,
            0x200..=0x20f => self.pending |= bits & known,
            0x280..=0x28f => {
                let running = self.active.iter().fold(0, |set, e| set | 1u128 << e);
                self.pending = self.pending & !bits | self.lines & !running;
            }
            0x400..=0x463 => self.set_priorities(16 + (address as usize - 0x400), value, size),
            0xd18..=0xd23 => self.set_priorities(4 + (address as usize - 0xd18), value, size),
            _ => {}
        }
    }

    /// The F446 has four bits of priority.
    fn set_priorities(&mut self, first: usize, value: u32, size: usize) {
        for (i, byte) in value.to_le_bytes().into_iter().take(size).enumerate() {
            if let Some(priority) = self.priority.get_mut(first + i) {
                *priority = byte & 0xf0;
            }
        }
    }

    /// Reads ICSR: running and pending exceptions.
    pub fn icsr(&self) -> u32 {
        let pending = |exception: usize| (self.pending >> exception) as u32 & 1;
        self.running() as u32
            | (self.candidate().unwrap_or(0) as u32) << 12
            | u32::from(self.depth() == 1) << 11
            | u32::from(self.pending >> 16 != 0) << 22
            | pending(SYS_TICK) << 26
            | pending(PEND_SV) << 28
    }

    /// Writes ICSR: sets or clears PendSV and SysTick.
    pub fn write_icsr(&mut self, value: u32) {
        for (bit, exception) in [(28, PEND_SV), (26, SYS_TICK)] {
            if value >> bit & 1 != 0 {
                self.pend(exception);
            }
            if value >> (bit - 1) & 1 != 0 {
                self.pending &= !(1 << exception);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nvic(priorities: &[(usize, u8)]) -> Nvic {
        let mut nvic = Nvic::default();
        for (irq, priority) in priorities {
            nvic.write(0x100 + *irq as u32 / 32 * 4, 1 << (irq % 32), 4);
            nvic.write(0x400 + *irq as u32, u32::from(*priority), 1);
        }
        nvic
    }

    #[test]
    fn most_urgent_exception_is_first_and_of_equals_the_lowest_number() {
        let mut nvic = nvic(&[(38, 0x20), (56, 0x10), (57, 0x10)]);
        nvic.set_lines(1 << 38 | 1 << 56 | 1 << 57);
        assert_eq!(nvic.to_enter(Masks::default()), Some(16 + 56));
    }

    #[test]
    fn equal_priority_does_not_preempt() {
        let mut nvic = nvic(&[(1, 0x20), (2, 0x20), (3, 0x10)]);
        nvic.enter(16 + 1);
        nvic.set_lines(1 << 2);
        assert_eq!(nvic.to_enter(Masks::default()), None);
        nvic.set_lines(1 << 2 | 1 << 3);
        assert_eq!(nvic.to_enter(Masks::default()), Some(16 + 3));
    }

    #[test]
    fn masks_delay_exceptions() {
        let mut nvic = nvic(&[(1, 0x20)]);
        nvic.set_lines(1 << 1);
        let basepri = |basepri| Masks {
            basepri,
            ..Masks::default()
        };
        assert_eq!(nvic.to_enter(basepri(0x20)), None);
        assert_eq!(nvic.to_enter(basepri(0x30)), Some(17));
        let primask = Masks {
            primask: true,
            ..Masks::default()
        };
        assert_eq!(nvic.to_enter(primask), None);
        assert!(nvic.wakes(primask));
    }

    #[test]
    fn line_that_stays_high_pends_again_after_the_return() {
        let mut nvic = nvic(&[(1, 0x20)]);
        nvic.set_lines(1 << 1);
        nvic.enter(17);
        assert_eq!(nvic.to_enter(Masks::default()), None);
        nvic.leave();
        assert_eq!(nvic.to_enter(Masks::default()), Some(17));
        nvic.enter(17);
        nvic.set_lines(0);
        nvic.leave();
        assert_eq!(nvic.to_enter(Masks::default()), None);
    }

    #[test]
    fn registers_show_and_change_the_sets() {
        let mut nvic = Nvic::default();
        nvic.write(0x104, 1 << 6, 4);
        assert_eq!((nvic.read(0x104), nvic.read(0x184)), (1 << 6, 1 << 6));
        nvic.write(0x204, 1 << 6, 4);
        assert_eq!(nvic.to_enter(Masks::default()), Some(16 + 38));
        nvic.write(0x284, 1 << 6, 4);
        assert_eq!(nvic.to_enter(Masks::default()), None);
        nvic.write(0x184, 1 << 6, 4);
        assert_eq!(nvic.read(0x104), 0);
        nvic.write(0x426, 0x5f, 1);
        assert_eq!(nvic.read(0x424), 0x50 << 16);
    }

    #[test]
    fn subpriorities_do_not_preempt_each_other() {
        let mut nvic = nvic(&[(1, 0x50), (2, 0x40)]);
        nvic.prigroup = 4;
        nvic.enter(17);
        nvic.set_lines(1 << 2);
        assert_eq!(nvic.to_enter(Masks::default()), None);
    }
}

//! SCB: vector table, reset request, fault status, floating-point access (ARMv7-M, B3.2).

/// CFSR: stacking failed.
pub const STKERR: u32 = 1 << 12;
/// CFSR: unstacking failed.
pub const UNSTKERR: u32 = 1 << 11;
/// CFSR: data access, address in BFAR.
pub const PRECISERR: u32 = 1 << 9 | 1 << 15;
/// CFSR: instruction fetch.
pub const IBUSERR: u32 = 1 << 8;
/// CFSR: undefined instruction.
pub const UNDEFINSTR: u32 = 1 << 16;
/// CFSR: branch to ARM state.
pub const INVSTATE: u32 = 1 << 17;
/// CFSR: floating-point instruction while the unit is off.
pub const NOCP: u32 = 1 << 19;
/// HFSR: escalated from another fault.
pub const FORCED: u32 = 1 << 30;
/// HFSR: BKPT without a debugger.
pub const DEBUGEVT: u32 = 1 << 31;
/// SCR: sleep when the last handler returns.
pub const SLEEPONEXIT: u32 = 1 << 1;

/// The registers that have a function.
#[derive(Default)]
pub struct Scb {
    /// Vector table; 0 is the alias of the flash.
    pub vtor: u32,
    /// SCR, of which SLEEPONEXIT is used.
    pub scr: u32,
    /// Enables of MemManage, BusFault and UsageFault.
    pub shcsr: u32,
    /// CFSR: fault status.
    pub cfsr: u32,
    /// HFSR: hard fault status.
    pub hfsr: u32,
    /// Address of a bus fault.
    pub bfar: u32,
    /// Access to the floating-point unit.
    pub cpacr: u32,
    /// Whether AIRCR requested a reset.
    pub reset_requested: bool,
    ccr: u32,
}

impl Scb {
    /// Whether floating-point instructions may run.
    pub fn is_fpu_on(&self) -> bool {
        self.cpacr >> 20 & 0xf == 0xf
    }

    /// Reads a register; none if it is not one of these. `address` is the low part after
    /// 0xE000_Exxx.
    pub fn read(&self, address: u32) -> Option<u32> {
        Some(match address {
            0xd00 => 0x410f_c241,
            0xd08 => self.vtor,
            0xd0c => 0xfa05_0000,
            0xd10 => self.scr,
            0xd14 => self.ccr | 0x200,
            0xd24 => self.shcsr,
            0xd28 => self.cfsr,
            0xd2c => self.hfsr,
            0xd38 => self.bfar,
            0xd88 => self.cpacr,
            _ => return None,
        })
    }

    /// Writes a register; false if it is not one of these.
    pub fn write(&mut self, address: u32, value: u32) -> bool {
        match address {
            0xd00 => {}
            0xd08 => self.vtor = value & !0x7f,
            0xd0c => self.reset_requested |= value >> 16 == 0x05fa && value & 4 != 0,
            0xd10 => self.scr = value,
            0xd14 => self.ccr = value,
            0xd24 => self.shcsr = value,
            0xd28 => self.cfsr &= !value,
            0xd2c => self.hfsr &= !value,
            0xd38 => self.bfar = value,
            0xd88 => self.cpacr = value,
            _ => return false,
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reset_needs_the_key() {
        let mut scb = Scb::default();
        scb.write(0xd0c, 4);
        assert!(!scb.reset_requested);
        scb.write(0xd0c, 0x05fa_0004);
        assert!(scb.reset_requested);
    }

    #[test]
    fn fault_status_is_cleared_by_ones() {
        let mut scb = Scb {
            cfsr: UNDEFINSTR | STKERR,
            ..Scb::default()
        };
        scb.write(0xd28, STKERR);
        assert_eq!(scb.read(0xd28), Some(UNDEFINSTR));
    }

    #[test]
    fn floating_point_needs_both_fields() {
        let mut scb = Scb::default();
        scb.write(0xd88, 3 << 20);
        assert!(!scb.is_fpu_on());
        scb.write(0xd88, 0xf << 20);
        assert!(scb.is_fpu_on());
    }
}

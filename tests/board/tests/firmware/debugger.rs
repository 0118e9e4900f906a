//! A debugger at the board must not keep the valve from its safe state.

use crate::rig::{MS, Rig};
use emulated_board::ResetCause as Cause;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::ToDevice;

/// DBGMCU_APB1_FZ, and its bit that stops the watchdog while the core is halted.
const APB1_FZ: (u32, u32) = (0xe004_2008, 1 << 12);
/// `udf #0`
const UNDEFINED: [u8; 2] = [0x00, 0xde];

/// A board that assists, with a debugger that wants the watchdog to stop at a halt.
fn assisting_beside_a_debugger() -> Rig {
    let mut rig = Rig::after_ms(1_000);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(300);
    assert!(rig.board.dac_volts(1) > 0.1);
    let (register, stop) = APB1_FZ;
    rig.board.write_register(register, stop);
    rig.run_ms(15);
    rig
}

/// The core is halted: the watchdog must bring the valve to 0 V, at 17 kHz within 94 ms.
fn assert_reset_by_the_watchdog(rig: &mut Rig) {
    assert!(rig.board.is_halted());
    rig.board.run_for(94 * MS);
    let causes: Vec<_> = rig.board.resets().iter().map(|reset| reset.cause).collect();
    assert_eq!(causes, [Cause::Watchdog]);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn halting_the_core_does_not_stop_the_watchdog() {
    let mut rig = assisting_beside_a_debugger();
    rig.board.halt(true);
    assert_reset_by_the_watchdog(&mut rig);
}

/// The handler that writes 0 V does not run then.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn catching_a_hard_fault_does_not_stop_the_watchdog() {
    let mut rig = assisting_beside_a_debugger();
    rig.board.catch_hard_fault();
    let address = rig.code("TIM3");
    rig.board.write_flash(address, &UNDEFINED);
    rig.board.run_for(2 * MS);
    assert!(rig.board.dac_volts(1) > 0.1, "the handler has not run");
    assert_reset_by_the_watchdog(&mut rig);
}

//! Whatever stops the firmware: the valve is safe, the board comes back, and says why.

use crate::rig::{MS, Rig};
use emulated_board::ResetCause as Cause;
use model_core::link::{Crash, ResetCause};
use model_core::supervisor::Fault;

/// `b .`
const ENDLESS_LOOP: [u8; 2] = [0xfe, 0xe7];
/// `udf #0`
const UNDEFINED: [u8; 2] = [0x00, 0xde];
/// `push {lr}; b .-2`, which eats the stack.
const ENDLESS_PUSH: [u8; 4] = [0x00, 0xb5, 0xfd, 0xe7];

/// Patches code until the board resets, then puts back what was there.
fn sabotage(rig: &mut Rig, function: &str, code: &[u8]) {
    let address = rig.code(function);
    let before = rig.board.read_memory(address, code.len());
    let resets = rig.board.resets().len();
    rig.board.write_flash(address, code);
    let give_up_ns = rig.board.time_ns() + 1_000 * MS;
    while rig.board.resets().len() == resets {
        rig.board.run_for(MS / 10);
        assert!(rig.board.time_ns() < give_up_ns, "no reset in a second");
    }
    rig.board.write_flash(address, &before);
    rig.board.reset_pin();
}

/// The same, but the board comes up by itself with the code put back, so that it tells the cause.
fn sabotage_once(rig: &mut Rig, function: &str, code: &[u8]) -> (Cause, u64) {
    let address = rig.code(function);
    let before = rig.board.read_memory(address, code.len());
    let (resets, began_ns) = (rig.board.resets().len(), rig.board.time_ns());
    rig.board.write_flash(address, code);
    while rig.board.resets().len() == resets {
        rig.board.run_for(MS / 100);
        assert!(
            rig.board.time_ns() < began_ns + 1_000 * MS,
            "no reset in a second"
        );
    }
    rig.board.write_flash(address, &before);
    let reset = rig.board.resets()[resets];
    (reset.cause, reset.time_ns - began_ns)
}

#[test]
fn watchdog_bites_when_ticks_do_not_end() {
    let Some(mut rig) = Rig::after_ms(1_000) else {
        return;
    };
    let (cause, after_ns) = sabotage_once(&mut rig, "DMA2_STREAM0", &ENDLESS_LOOP);
    println!("bitten after {:.1} ms", after_ns as f64 * 1e-6);
    assert_eq!(cause, Cause::Watchdog);
    assert!((40 * MS..61 * MS).contains(&after_ns), "{after_ns} ns");
    assert_eq!(rig.board.dac_volts(1), 0.0);
    rig.run_ms(50);
    let identity = rig.identity();
    assert_eq!(
        (identity.reset, identity.crash),
        (ResetCause::Watchdog, None)
    );
    rig.assert_no_errors();
}

#[test]
fn link_that_hangs_does_not_stop_the_ticks() {
    let Some(mut rig) = Rig::after_ms(1_000) else {
        return;
    };
    let address = rig.code("TIM3");
    rig.board.write_flash(address, &ENDLESS_LOOP);
    rig.board.trace_exceptions(true);
    rig.run_ms(500);
    let entered = rig.board.exceptions().iter().filter(|e| e.entered).count();
    assert!(entered >= 50, "{entered}");
    assert_eq!(rig.board.resets(), []);
}

#[test]
fn undefined_instruction_is_noted_with_its_place() {
    let Some(mut rig) = Rig::after_ms(1_000) else {
        return;
    };
    let place = rig.code("TIM3");
    let (cause, _) = sabotage_once(&mut rig, "TIM3", &UNDEFINED);
    assert_eq!((cause, rig.board.dac_volts(1)), (Cause::Software, 0.0));
    rig.run_ms(50);
    match rig.identity().crash {
        Some(Crash::HardFault { pc, cfsr, .. }) => {
            assert_eq!((pc, cfsr & 0xffff_0000), (place, 1 << 16));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn stack_overflow_is_noted_as_such() {
    let Some(mut rig) = Rig::after_ms(1_000) else {
        return;
    };
    let (cause, _) = sabotage_once(&mut rig, "TIM3", &ENDLESS_PUSH);
    assert_eq!((cause, rig.board.dac_volts(1)), (Cause::Software, 0.0));
    assert!(!rig.board.is_locked_up());
    rig.run_ms(50);
    let crash = rig.identity().crash;
    assert!(
        matches!(crash, Some(Crash::StackOverflow { .. })),
        "{crash:?}"
    );
}

/// Lets the encoder leap to `position`, which is a fault; returns it.
fn provoke_a_fault(rig: &mut Rig, position: i64) -> Option<Fault> {
    rig.board.set_encoder(position);
    rig.run_ms(100);
    let fault = rig.last_telemetry().output.fault;
    assert!(matches!(fault, Some(Fault::Encoder(_))), "{fault:?}");
    fault
}

#[test]
fn latched_fault_survives_any_reset_but_not_the_power() {
    let Some(mut rig) = Rig::after_ms(1_000) else {
        return;
    };
    assert_eq!(rig.identity().fault, None);
    let fault = provoke_a_fault(&mut rig, 1 << 20);
    sabotage_once(&mut rig, "TIM3", &UNDEFINED);
    rig.run_ms(50);
    let identity = rig.identity();
    assert!(identity.crash.is_some());
    assert_eq!(identity.fault, fault);
    rig.run_ms(1_000);
    let fault = provoke_a_fault(&mut rig, 0);
    sabotage_once(&mut rig, "DMA2_STREAM0", &ENDLESS_LOOP);
    rig.run_ms(50);
    let identity = rig.identity();
    assert_eq!(
        (identity.reset, identity.crash, identity.fault),
        (ResetCause::Watchdog, None, fault)
    );
    rig.run_ms(1_000);
    provoke_a_fault(&mut rig, 1 << 20);
    rig.board.power_cut();
    rig.board.power_on();
    rig.run_ms(50);
    assert_eq!(rig.identity().fault, None);
}

#[test]
fn note_is_told_once() {
    let Some(mut rig) = Rig::after_ms(1_000) else {
        return;
    };
    sabotage(&mut rig, "TIM3", &UNDEFINED);
    rig.run_ms(50);
    rig.board.reset_pin();
    rig.run_ms(50);
    assert_eq!(rig.identity().crash, None);
}

//! Crashes of the firmware: the valve goes to 0 V, the board restarts and reports the cause.

use crate::rig::{MS, Rig};
use emulated_board::ResetCause as Cause;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::{Crash, ResetCause, ToDevice};
use model_core::supervisor::{Fault, Mode};

/// Control register of TIM2, which starts the conversions, and of TIM3, the link task's timer.
const TIM2_CR1: u32 = 0x4000_0000;
const TIM3_CR1: u32 = 0x4000_0400;
/// Sets interrupts 0 to 31 pending.
const NVIC_ISPR0: u32 = 0xe000_e200;
const TIM3_IRQ: u32 = 29;
/// `b .`
const ENDLESS_LOOP: [u8; 2] = [0xfe, 0xe7];
/// `udf #0`
const UNDEFINED: [u8; 2] = [0x00, 0xde];
/// `push {lr}; b .-2`: stack overflow.
const ENDLESS_PUSH: [u8; 4] = [0x00, 0xb5, 0xfd, 0xe7];

/// Patches code until the board resets, then restores it and resets the board once more.
fn patch_and_reset(rig: &mut Rig, function: &str, code: &[u8]) {
    let address = rig.code(function);
    let before = rig.board.read_memory(address, code.len());
    let resets = rig.board.resets().len();
    rig.board.write_flash(address, code);
    let timeout_ns = rig.board.time_ns() + 1_000 * MS;
    while rig.board.resets().len() == resets {
        rig.board.run_for(MS / 10);
        assert!(rig.board.time_ns() < timeout_ns, "no reset in a second");
    }
    rig.board.write_flash(address, &before);
    rig.board.reset_pin();
}

/// Patches code until the board resets, then restores it, so that the board starts and reports the
/// cause. Returns the cause and the time to the reset \[ns\].
fn patch_until_reset(rig: &mut Rig, function: &str, code: &[u8]) -> (Cause, u64) {
    let address = rig.code(function);
    let before = rig.board.read_memory(address, code.len());
    let (resets, start_ns) = (rig.board.resets().len(), rig.board.time_ns());
    rig.board.write_flash(address, code);
    while rig.board.resets().len() == resets {
        rig.board.run_for(MS / 100);
        assert!(
            rig.board.time_ns() < start_ns + 1_000 * MS,
            "no reset in a second"
        );
    }
    rig.board.write_flash(address, &before);
    let reset = rig.board.resets()[resets];
    (reset.cause, reset.time_ns - start_ns)
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn watchdog_resets_the_board_when_ticks_do_not_complete() {
    let mut rig = Rig::after_ms(1_000);
    let (cause, after_ns) = patch_until_reset(&mut rig, "DMA2_STREAM0", &ENDLESS_LOOP);
    println!("reset after {:.1} ms", after_ns as f64 * 1e-6);
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
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn hanging_link_task_does_not_stop_the_ticks() {
    let mut rig = Rig::after_ms(1_000);
    let address = rig.code("TIM3");
    rig.board.write_flash(address, &ENDLESS_LOOP);
    rig.board.trace_exceptions(true);
    rig.run_ms(500);
    let entered = rig.board.exceptions().iter().filter(|e| e.entered).count();
    assert!(entered >= 50, "{entered}");
    assert_eq!(rig.board.resets(), []);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn hard_fault_is_reported_with_its_address() {
    let mut rig = Rig::after_ms(1_000);
    let address = rig.code("TIM3");
    let (cause, _) = patch_until_reset(&mut rig, "TIM3", &UNDEFINED);
    assert_eq!((cause, rig.board.dac_volts(1)), (Cause::Software, 0.0));
    rig.run_ms(50);
    match rig.identity().crash {
        Some(Crash::HardFault { pc, cfsr, .. }) => {
            assert_eq!((pc, cfsr & 0xffff_0000), (address, 1 << 16));
        }
        other => panic!("{other:?}"),
    }
}

/// `movw` and `movt`: load a register.
fn load(register: u32, value: u32) -> Vec<u8> {
    let half = |opcode: u32, value: u32| {
        let first = opcode | (value >> 11 & 1) << 10 | value >> 12;
        let second = (value >> 8 & 7) << 12 | register << 8 | value & 0xff;
        [(first as u16).to_le_bytes(), (second as u16).to_le_bytes()].concat()
    };
    [half(0xf240, value & 0xffff), half(0xf2c0, value >> 16)].concat()
}

/// Reads, writes or executes where no memory is.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn bus_fault_ends_at_zero_volts_and_is_reported_with_its_cause() {
    const NOWHERE: u32 = 0x6000_0000;
    // ldr r0, [r0]; str r0, [r0]; bx r0
    let accesses = [
        ("load", [0x00, 0x68], 1 << 9 | 1 << 15),
        ("store", [0x00, 0x60], 1 << 9 | 1 << 15),
        ("fetch", [0x00, 0x47], 1 << 8),
    ];
    for (what, access, expected_cfsr) in accesses {
        let mut rig = Rig::after_ms(1_000);
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(300);
        assert!(rig.board.dac_volts(1) > 0.1);
        rig.board.dac_events();
        let mut code = load(0, NOWHERE | u32::from(what == "fetch"));
        let at = rig.code("TIM3") + code.len() as u32;
        code.extend(access);
        let (cause, after_ns) = patch_until_reset(&mut rig, "TIM3", &code);
        assert_eq!(cause, Cause::Software, "{what}");
        assert!(after_ns < 2 * MS, "{what}: {after_ns} ns");
        let reset_ns = rig.board.resets()[0].time_ns;
        let volts = volts_until(&mut rig, reset_ns);
        assert_eq!(volts.last(), Some(&0.0), "{what}: {volts:?}");
        rig.run_ms(50);
        match rig.identity().crash {
            Some(Crash::HardFault { pc, cfsr, .. }) => {
                let place = if what == "fetch" { NOWHERE } else { at };
                assert_eq!((pc, cfsr), (place, expected_cfsr), "{what}");
            }
            other => panic!("{what}: {other:?}"),
        }
        rig.run_ms(1_000);
        assert_eq!(rig.last_telemetry().output.mode, Mode::Ready, "{what}");
    }
}

/// The supply sinks in the middle of a lift, and returns.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn brown_out_while_assisting_ends_at_zero_volts_and_is_reported() {
    for off_ms in [0, 5, 500] {
        let mut rig = Rig::after_ms(1_000);
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(300);
        assert!(rig.board.dac_volts(1) > 0.1);
        rig.board.power_cut();
        assert_eq!(rig.board.dac_volts(1), 0.0);
        rig.board.run_for(off_ms * MS);
        rig.board.power_on();
        rig.run_ms(50);
        let identity = rig.identity();
        let reason = (identity.reset, identity.crash, identity.fault);
        assert_eq!(reason, (ResetCause::Power, None, None));
        rig.run_ms(1_000);
        assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
        assert_eq!(rig.board.dac_volts(1), 0.0);
    }
}

/// A file name, and code that panics with line 1234 of this file.
fn panic_in(rig: &Rig) -> (&'static str, Vec<u8>) {
    // A call of core's panic function for a division by zero. Its only argument is a Location,
    // which is placed after the code: file name, line and column.
    let file = "some/folder/of/a_file.rs";
    let panic = rig.board.symbol_with("panic_const_div_by_zero");
    let begin = rig.code("TIM3");
    let location = (begin + 20).next_multiple_of(4);
    let words = [location + 16, file.len() as u32, 1234, 5].map(u32::to_le_bytes);
    let mut code = load(0, location);
    code.extend(load(
        3,
        panic.expect("the firmware contains a checked division"),
    ));
    // bx r3
    code.extend([0x18, 0x47]);
    code.resize((location - begin) as usize, 0);
    code.extend(words.concat());
    code.extend(file.bytes());
    (file, code)
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn panic_is_reported_with_file_and_line() {
    let mut rig = Rig::after_ms(1_000);
    let (file, code) = panic_in(&rig);
    let (cause, _) = patch_until_reset(&mut rig, "TIM3", &code);
    assert_eq!((cause, rig.board.dac_volts(1)), (Cause::Software, 0.0));
    rig.run_ms(50);
    let crash = Crash::Panic {
        line: 1234,
        file_end: *file.as_bytes().last_chunk().expect("long enough"),
    };
    assert_eq!(rig.identity().crash, Some(crash));
}

/// The link's task goes on, and must not be what keeps the board alive.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn watchdog_resets_the_board_when_ticks_no_longer_start() {
    let mut rig = Rig::after_ms(1_000);
    rig.board.write_register(TIM2_CR1, 0);
    rig.board.run_for(62 * MS);
    let causes: Vec<_> = rig.board.resets().iter().map(|reset| reset.cause).collect();
    assert_eq!(causes, [Cause::Watchdog]);
}

/// A crash of the link's task, at any time before a tick is due.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn no_tick_raises_the_valve_once_a_crash_has_lowered_it() {
    let mut caught_in_the_crash = 0;
    for before_tick_ns in (0..60_000).step_by(1_500) {
        let mut rig = Rig::after_ms(1_000);
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(300);
        let code = panic_in(&rig).1;
        let address = rig.code("TIM3");
        let tick_ns = rig.next_tick_ns();
        // From here on only this test requests the link's task.
        rig.board.write_register(TIM3_CR1, 0);
        rig.board.write_flash(address, &code);
        rig.board.run_until(tick_ns - before_tick_ns);
        rig.board.dac_events();
        rig.board.write_register(NVIC_ISPR0, 1 << TIM3_IRQ);
        rig.board.run_for(MS);
        assert_eq!(rig.board.resets().len(), 1);
        let reset_ns = rig.board.resets()[0].time_ns;
        caught_in_the_crash += usize::from(reset_ns > tick_ns);
        let volts = volts_until(&mut rig, reset_ns);
        let lowered = volts.iter().position(|volts| *volts == 0.0);
        let after = &volts[lowered.expect("0 V before the reset")..];
        let stays = after.iter().all(|volts| *volts == 0.0);
        assert!(stays, "{before_tick_ns} ns: {volts:?}");
    }
    println!("a tick was due within the crash in {caught_in_the_crash} of 40 cases");
    assert!(caught_in_the_crash > 0);
}

/// Changes of the valve's voltage before `end_ns`; a converter that is shut down leaves 0 V.
fn volts_until(rig: &mut Rig, end_ns: u64) -> Vec<f64> {
    let events = rig.board.dac_events();
    let before = events.iter().filter(|event| event.time_ns < end_ns);
    before.map(|event| event.volts.unwrap_or(0.0)).collect()
}

/// The reset itself would also remove the voltage, but later.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn valve_is_at_zero_volts_before_a_crash_resets_the_board() {
    for crash in 0..3 {
        let mut rig = Rig::after_ms(1_000);
        let assist = Command::Request(Request::Assist);
        rig.send(&ToDevice::Command(assist));
        rig.run_ms(300);
        assert!(rig.board.dac_volts(1) > 0.1);
        rig.board.dac_events();
        let code = match crash {
            0 => UNDEFINED.to_vec(),
            1 => ENDLESS_PUSH.to_vec(),
            _ => panic_in(&rig).1,
        };
        patch_until_reset(&mut rig, "TIM3", &code);
        let reset_ns = rig.board.resets()[0].time_ns;
        let volts = volts_until(&mut rig, reset_ns);
        assert_eq!(volts.last(), Some(&0.0), "{crash}: {volts:?}");
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn stack_overflow_is_reported_as_such() {
    let mut rig = Rig::after_ms(1_000);
    let (cause, _) = patch_until_reset(&mut rig, "TIM3", &ENDLESS_PUSH);
    assert_eq!((cause, rig.board.dac_volts(1)), (Cause::Software, 0.0));
    assert!(!rig.board.is_locked_up());
    rig.run_ms(50);
    let crash = rig.identity().crash;
    assert!(
        matches!(crash, Some(Crash::StackOverflow { .. })),
        "{crash:?}"
    );
}

/// Moves the encoder to `position` in one step, which is a fault, and returns the fault.
fn provoke_a_fault(rig: &mut Rig, position: i64) -> Option<Fault> {
    rig.board.set_encoder(position);
    rig.run_ms(100);
    let fault = rig.last_telemetry().output.fault;
    assert!(matches!(fault, Some(Fault::Encoder(_))), "{fault:?}");
    fault
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn latched_fault_survives_every_reset_except_power_on() {
    let mut rig = Rig::after_ms(1_000);
    assert_eq!(rig.identity().fault, None);
    let fault = provoke_a_fault(&mut rig, 1 << 20);
    patch_until_reset(&mut rig, "TIM3", &UNDEFINED);
    rig.run_ms(50);
    let identity = rig.identity();
    assert!(identity.crash.is_some());
    assert_eq!(identity.fault, fault);
    rig.run_ms(1_000);
    let fault = provoke_a_fault(&mut rig, 0);
    patch_until_reset(&mut rig, "DMA2_STREAM0", &ENDLESS_LOOP);
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
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn crash_is_reported_once() {
    let mut rig = Rig::after_ms(1_000);
    patch_and_reset(&mut rig, "TIM3", &UNDEFINED);
    rig.run_ms(50);
    rig.board.reset_pin();
    rig.run_ms(50);
    assert_eq!(rig.identity().crash, None);
}

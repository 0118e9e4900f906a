//! From power-up to the first tick.

use crate::budget::stack;
use crate::rig::Rig;
use emulated_board::Chip;
use model_core::link::{FRAME_LEN_MAX, ResetCause, SettingsSource, ToDevice, board_name, encode};
use model_core::supervisor::Mode;

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn boots_to_its_clock_and_reports_its_identity() {
    let mut rig = Rig::after_ms(30);
    let (name, hz) = match rig.board.chip() {
        Chip::F446 => ("NUCLEO-F446RE", 144_000_000),
        Chip::F407 => ("STM32F407", 144_000_000),
        Chip::F411 => ("NUCLEO-F411RE", 96_000_000),
    };
    assert_eq!(rig.board.core_clock_hz(), hz);
    let identity = rig.identity();
    assert_eq!(
        (identity.board, identity.cpu_hz),
        (board_name(name), hz as u32)
    );
    assert_eq!(identity.reset, ResetCause::Power);
    assert_eq!(identity.crash, None);
    assert_eq!(identity.settings, SettingsSource::Reference);
    assert!(rig.board.logs().iter().any(|line| line.contains("Power")));
    assert_eq!(rig.rejected, 0);
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn becomes_ready_and_stays_ready() {
    let mut rig = Rig::after_ms(3_000);
    let telemetry = rig.last_telemetry();
    assert_eq!(
        (telemetry.output.mode, telemetry.output.fault),
        (Mode::Ready, None)
    );
    assert_eq!(rig.board.resets(), []);
    // A handler may run just now: none takes 100 µs.
    assert!((0..10).any(|_| {
        rig.board.run_for(10_000);
        rig.board.is_asleep()
    }));
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn reset_button_and_power_on_are_distinguished() {
    let mut rig = Rig::after_ms(50);
    rig.board.reset_pin();
    rig.run_ms(50);
    assert_eq!(rig.identity().reset, ResetCause::Pin);
    rig.board.power_cut();
    rig.run_ms(50);
    assert_eq!(rig.board.dac_volts(1), 0.0);
    rig.board.power_on();
    rig.run_ms(50);
    assert_eq!(rig.identity().reset, ResetCause::Power);
    rig.assert_no_errors();
}

/// Painted words at the bottom of the stack.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn identity_reports_the_free_stack() {
    let mut rig = Rig::after_ms(500);
    let reported = usize::from(rig.identity().stack_free_bytes);
    let (size, used) = stack(&rig);
    assert_eq!(reported, size - used);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn two_runs_with_the_same_inputs_are_identical() {
    let mut buffer = [0; FRAME_LEN_MAX];
    let frame = encode(&ToDevice::Identify, &mut buffer).expect("short enough");
    // Frames of every length, from nothing to the whole frame.
    let bytes = [&[0], frame].concat();
    let run = || {
        let mut rig = Rig::new();
        let mut log = vec![];
        for step in 0..200_i64 {
            rig.board.set_encoder(step * step % 1000 - 300);
            rig.board
                .link_send(&bytes[..step as usize % (bytes.len() + 1)]);
            rig.run_ms(10);
            log.push((
                rig.board.instructions(),
                rig.board.pc(),
                rig.board.link_receive(),
            ));
        }
        (log, rig.board.dac_events(), rig.board.logs())
    };
    let first = run();
    assert!(first.0.iter().any(|(_, _, bytes)| !bytes.is_empty()));
    assert_eq!(first, run());
}

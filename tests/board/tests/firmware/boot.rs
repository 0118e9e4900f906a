//! From power-up to the first tick.

use crate::rig::Rig;
use model_core::link::{FRAME_LEN_MAX, ResetCause, SettingsSource, ToDevice, encode};
use model_core::supervisor::Mode;

#[test]
fn boots_to_180_mhz_and_says_who_it_is() {
    let Some(mut rig) = Rig::after_ms(30) else {
        return;
    };
    assert_eq!(rig.board.core_clock_hz(), 180_000_000);
    let identity = rig.identity();
    assert_eq!(identity.cpu_hz, 180_000_000);
    assert_eq!(identity.reset, ResetCause::Power);
    assert_eq!(identity.crash, None);
    assert_eq!(identity.settings, SettingsSource::Reference);
    assert!(rig.board.logs().iter().any(|line| line.contains("Power")));
    assert_eq!(rig.rejected, 0);
    rig.assert_no_errors();
}

#[test]
fn becomes_ready_and_stays_so() {
    let Some(mut rig) = Rig::after_ms(3_000) else {
        return;
    };
    let telemetry = rig.last_telemetry();
    assert_eq!(
        (telemetry.output.mode, telemetry.output.fault),
        (Mode::Ready, None)
    );
    assert_eq!(rig.board.resets(), []);
    assert!(rig.board.is_asleep());
    rig.assert_no_errors();
}

#[test]
fn reset_button_and_power_are_told_apart() {
    let Some(mut rig) = Rig::after_ms(50) else {
        return;
    };
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

#[test]
fn two_runs_are_equal_to_the_last_instruction() {
    let mut buffer = [0; FRAME_LEN_MAX];
    let frame = encode(&ToDevice::Identify, &mut buffer).expect("short enough");
    // Whole in the end, and cut off anywhere before.
    let bytes = [&[0], frame].concat();
    let run = || {
        let mut rig = Rig::new()?;
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
        Some((log, rig.board.dac_events(), rig.board.logs()))
    };
    let Some(first) = run() else { return };
    assert!(first.0.iter().any(|(_, _, bytes)| !bytes.is_empty()));
    assert_eq!(Some(first), run());
}

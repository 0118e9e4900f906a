//! Every pin has the function that docs/wiring.md states.

use crate::rig::{BRIDGE, BUTTON, PRESSURE, Rig, volts};
use emulated_board::pin;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::Mode;

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn sensor_voltages_are_read_exactly_to_the_count() {
    let mut rig = Rig::after_ms(15);
    for (bridge, pressure) in [(0, 4095), (1, 2), (2048, 409), (3333, 1234), (4095, 0)] {
        rig.board.set_analog(BRIDGE, volts(bridge));
        rig.board.set_analog(PRESSURE, volts(pressure));
        rig.board.run_for(25_000_000);
        let sensors = rig.telemetry().pop().expect("telemetry").sensors;
        assert_eq!(
            (sensors.bridge, sensors.pressure),
            (AdcCount(bridge), AdcCount(pressure))
        );
    }
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn encoder_counts_in_both_directions_from_its_position_at_reset() {
    let mut rig = Rig::after_ms(15);
    for position in [1, 5, -1, -70_000, 70_000, i64::from(i32::MAX), 0] {
        rig.board.set_encoder(position);
        let counted = rig.last_telemetry().sensors.encoder;
        assert_eq!(counted, EncoderCount(position as i32 as u32));
    }
    rig.board.set_encoder(1_000);
    rig.board.reset_pin();
    rig.run_ms(50);
    rig.board.set_encoder(1_010);
    assert_eq!(rig.last_telemetry().sensors.encoder, EncoderCount(10));
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn encoder_with_swapped_or_disconnected_wires_is_detected() {
    let mut rig = Rig::after_ms(15);
    rig.board.wire_encoder(pin('A', 1), pin('A', 0));
    rig.board.set_encoder(100);
    assert_eq!(
        rig.last_telemetry().sensors.encoder,
        EncoderCount(-100_i32 as u32)
    );
    rig.board.wire_encoder(pin('A', 0), pin('B', 9));
    rig.board.set_encoder(200);
    assert_eq!(
        rig.last_telemetry().sensors.encoder,
        EncoderCount(-100_i32 as u32)
    );
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn button_starts_assisting_and_the_link_stops_it() {
    let mut rig = Rig::after_ms(1_500);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    rig.board.set_level(BUTTON, Some(false));
    rig.run_ms(60);
    rig.board.set_level(BUTTON, Some(true));
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    rig.send(&ToDevice::Command(Command::Request(Request::Vent)));
    assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
    rig.assert_no_errors();
}

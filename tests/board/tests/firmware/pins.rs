//! Every pin leads where docs/wiring.md says.

use crate::rig::{BRIDGE, BUTTON, PRESSURE, Rig, volts};
use emulated_board::pin;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::Mode;

#[test]
fn voltages_reach_their_own_reading_to_the_count() {
    let Some(mut rig) = Rig::after_ms(15) else {
        return;
    };
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
fn encoder_counts_both_ways_from_where_it_was_at_reset() {
    let Some(mut rig) = Rig::after_ms(15) else {
        return;
    };
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
fn encoder_with_swapped_or_cut_wires_is_seen() {
    let Some(mut rig) = Rig::after_ms(15) else {
        return;
    };
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
fn button_begins_to_assist_and_the_link_ends_it() {
    let Some(mut rig) = Rig::after_ms(1_500) else {
        return;
    };
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    rig.board.set_level(BUTTON, Some(false));
    rig.run_ms(60);
    rig.board.set_level(BUTTON, Some(true));
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    rig.send(&ToDevice::Command(Command::Request(Request::Vent)));
    assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
    rig.assert_no_errors();
}

//! The serial link: wrong baud rate, hardware in the loop, timeout.

use crate::rig::{MS, Rig};
use model_core::device::{Command, SimulatedSensors};
use model_core::io::{Request, Sensors};
use model_core::link::{FromDevice, Source, ToDevice};
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::Mode;

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn messages_at_a_wrong_baud_rate_have_no_effect() {
    let mut rig = Rig::after_ms(1_500);
    rig.board.set_link_baud(115_200);
    for _ in 0..100 {
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(10);
    }
    rig.board.set_link_baud(921_600);
    rig.run_ms(100);
    rig.messages();
    let last = rig.last_telemetry();
    assert_eq!(last.output.mode, Mode::Ready);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn hardware_in_the_loop_reads_sensors_from_the_link_and_ends_after_a_timeout() {
    let mut rig = Rig::after_ms(1_500);
    rig.send(&ToDevice::Command(Command::EnterHil));
    let mut compared = 0;
    for sequence in 1..=100 {
        let sensors = Sensors {
            bridge: AdcCount(2000 + sequence as u16 % 7),
            pressure: AdcCount(400 + sequence as u16 % 5),
            encoder: EncoderCount(sequence),
            read_back: AdcCount(0),
            missed_ticks: 0,
            request: Request::None,
        };
        let simulated = SimulatedSensors { sequence, sensors };
        rig.send(&ToDevice::Command(Command::Sensors(simulated)));
        rig.run_ms(10);
        // At the edge of a tick one may come in the next 10 ms.
        for telemetry in rig.telemetry().into_iter().filter(|_| sequence > 3) {
            assert_eq!(telemetry.source, Source::Link(telemetry.sensors.encoder.0));
            compared += 1;
        }
    }
    assert!((96..=98).contains(&compared), "{compared}");
    assert_eq!(rig.board.dac_volts(1), 0.0);
    rig.run_ms(700);
    rig.telemetry();
    assert_eq!(rig.last_telemetry().source, Source::Pins);
    rig.assert_no_errors();
}

/// More commands in one tick than its queue holds, the request to vent last.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn request_to_vent_passes_a_full_queue_of_commands() {
    let mut rig = Rig::after_ms(1_500);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(100);
    let dropped = rig.identity().messages_dropped;
    let tick_ns = rig.next_tick_ns();
    rig.board.run_until(tick_ns + MS);
    for _ in 0..30 {
        rig.send(&ToDevice::Command(Command::Request(Request::None)));
    }
    rig.send(&ToDevice::Command(Command::Request(Request::Vent)));
    rig.board.run_until(tick_ns + 9 * MS);
    assert_eq!(rig.board.link_unsent(), 0, "all arrived before the tick");
    rig.telemetry();
    assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
    assert_eq!(rig.identity().messages_dropped - dropped, 15);
}

/// Requests whose answers are longer than the line can carry.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn answers_never_displace_telemetry() {
    let mut rig = Rig::after_ms(100);
    let dropped = rig.identity().messages_dropped;
    let mut ticks = vec![];
    for _ in 0..1_000 {
        while rig.board.link_unsent() < 200 {
            rig.send(&ToDevice::ReadSettings);
        }
        rig.run_ms(1);
        ticks.extend(rig.telemetry().iter().map(|telemetry| telemetry.tick));
    }
    assert!(ticks.len() >= 98, "{}", ticks.len());
    for pair in ticks.windows(2) {
        assert_eq!(pair[1], pair[0] + 1, "telemetry is missing");
    }
    rig.run_ms(100);
    let dropped = rig.identity().messages_dropped - dropped;
    assert!(dropped > 1_000, "{dropped} answers dropped and counted");
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn vent_requested_once_vents_once() {
    let mut rig = Rig::after_ms(1_500);
    rig.send(&ToDevice::Command(Command::Request(Request::Vent)));
    rig.run_ms(100);
    rig.telemetry();
    assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
    rig.send(&ToDevice::Command(Command::Request(Request::Reset)));
    rig.run_ms(1_000);
    rig.telemetry();
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn identity_is_sent_after_each_reset_without_being_asked() {
    let mut rig = Rig::after_ms(50);
    for _ in 0..2 {
        let messages = rig.messages();
        let identities = messages
            .iter()
            .filter(|(_, message)| matches!(message, FromDevice::Identity(_)));
        assert_eq!(identities.count(), 1);
        rig.board.reset_pin();
        rig.run_ms(50);
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn changes_of_the_mode_are_logged() {
    let mut rig = Rig::after_ms(1_500);
    let logs = rig.board.logs();
    assert!(
        logs.iter().any(|line| line.contains("mode: Ready")),
        "{logs:?}"
    );
}

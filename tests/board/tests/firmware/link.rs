//! The serial link: wrong baud rate, hardware in the loop, timeout.

use crate::rig::Rig;
use model_core::device::{Command, SimulatedSensors};
use model_core::io::{Request, Sensors};
use model_core::link::{Source, ToDevice};
use model_core::signal::{AdcCount, EncoderCount};

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
    assert_eq!(last.output.mode, model_core::supervisor::Mode::Ready);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn hardware_in_the_loop_reads_sensors_from_the_link_and_ends_after_a_timeout() {
    let mut rig = Rig::after_ms(1_500);
    rig.send(&ToDevice::Command(Command::EnterHil));
    for sequence in 1..=100 {
        let sensors = Sensors {
            bridge: AdcCount(2000 + sequence as u16 % 7),
            pressure: AdcCount(400 + sequence as u16 % 5),
            encoder: EncoderCount(sequence),
            missed_ticks: 0,
            request: Request::None,
        };
        let simulated = SimulatedSensors { sequence, sensors };
        rig.send(&ToDevice::Command(Command::Sensors(simulated)));
        rig.run_ms(10);
        if sequence > 3 {
            let telemetry = rig.telemetry().pop().expect("telemetry");
            assert_eq!(telemetry.source, Source::Link(telemetry.sensors.encoder.0));
        }
    }
    assert_eq!(rig.board.dac_volts(1), 0.0);
    rig.run_ms(700);
    rig.telemetry();
    assert_eq!(rig.last_telemetry().source, Source::Pins);
    rig.assert_no_errors();
}

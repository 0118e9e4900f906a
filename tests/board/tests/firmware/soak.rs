//! Random use of the release firmware. A long run:
//! `SOAK_HOURS=24 FIRMWARE=… cargo test --release --test firmware soak -- --ignored --nocapture`.

#[path = "../../../../hil-sim/tests/board/soak.rs"]
mod random_use;

use crate::faults::OnBoard;
use hil_sim::faults::unit::{Unit, frame};
use model_core::device::{Command, Pins};
use model_core::io::{Request, Sensors};
use model_core::link::ToDevice;
use model_core::settings::{Settings, SettingsValues};

/// Duration in hours of board time; the environment variable SOAK_HOURS overrides it.
const HOURS: f64 = 30.0 / 3600.0;

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn random_use_misses_no_tick() {
    let mut board = OnBoard::new(None);
    let hours = std::env::var("SOAK_HOURS").map_or(HOURS, |hours| hours.parse().expect("hours"));
    let settings = Settings::new(SettingsValues::reference()).expect("the reference is valid");
    let mut ticks = 0;
    random_use::soak(hours, &settings, |sensors| {
        let output = board
            .tick(&pins(sensors), 0, 0.0, &request_frame(sensors.request))
            .output;
        let [telemetry] = board.telemetry[..] else {
            panic!(
                "tick {ticks}: {} telemetries, expected 1",
                board.telemetry.len()
            );
        };
        ticks += 1;
        assert_eq!((telemetry.tick, telemetry.timing.missed_ticks), (ticks, 0));
        output
    });
    board.rig.assert_no_errors();
}

fn pins(sensors: &Sensors) -> Pins {
    Pins {
        bridge: sensors.bridge,
        pressure: sensors.pressure,
        encoder: sensors.encoder,
        read_back: sensors.read_back,
        button_pressed: false,
        stop_open: [false; 2],
        enabling_closed: false,
    }
}

fn request_frame(request: Request) -> Vec<u8> {
    match request {
        Request::None => Vec::new(),
        request => frame(&ToDevice::Command(Command::Request(request))),
    }
}

//! Random use of the image that would be flashed. For the whole:
//! `SOAK_HOURS=24 FIRMWARE=… cargo test --release --test firmware soak -- --nocapture`.

#[path = "../../../../hil-sim/tests/board/soak.rs"]
mod random_use;

use crate::faults::OnBoard;
use hil_sim::faults::unit::{Unit, frame};
use model_core::device::{Command, Pins};
use model_core::io::{Request, Sensors};
use model_core::link::ToDevice;
use model_core::settings::{Settings, SettingsValues};

/// Hours of the board, unless SOAK_HOURS says otherwise: half a minute.
const HOURS: f64 = 30.0 / 3600.0;

#[test]
fn hours_of_use_miss_no_tick() {
    let Some(mut board) = OnBoard::new(None) else {
        return;
    };
    let hours = std::env::var("SOAK_HOURS").map_or(HOURS, |hours| hours.parse().expect("hours"));
    let settings = Settings::new(SettingsValues::reference()).expect("the reference is valid");
    let mut ticks = 0;
    random_use::soak(hours, &settings, |sensors| {
        let output = board
            .tick(&pins(sensors), 0, 0.0, &asked(sensors.request))
            .output;
        let [telemetry] = board.telemetry[..] else {
            panic!("tick {ticks} was told so often: {}", board.telemetry.len());
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
        button_pressed: false,
    }
}

fn asked(request: Request) -> Vec<u8> {
    match request {
        Request::None => Vec::new(),
        asked => frame(&ToDevice::Command(Command::Request(asked))),
    }
}

//! Link-time proof that the functions of model-core that tick and link call, and the reading of the
//! bridge's converter, cannot panic: the panic handler calls an undefined function, so that this
//! links only if the optimiser has removed every panic. It is never run.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::num::NonZeroU32;
use core::panic::PanicInfo;
use model_core::device::{Device, Pins};
use model_core::gate::{Decision, SettingsGate};
use model_core::limits::safety_hash;
use model_core::link::{
    Decoder, FRAME_LEN_MAX, FromDevice, Identity, ImageCheck, ImageState, ResetCause,
    SettingsSource, Signature, ToDevice, board_name, check_image, encode,
};
use model_core::sampling::{SCANS, Sampler, WORDS};
use model_core::settings::Settings;
use model_core::start::{StartFault, StartFindings, VALVE_LEVELS, valve_level};
use model_core::store;
use model_core::timing::{LinkLoad, TickClock};
use rig_drivers::ads1220::reading;
use stm32f4xx_hal as _;

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    #[allow(unsafe_code)]
    // SAFETY: undefined, hence never called.
    unsafe extern "C" {
        safe fn model_core_can_panic() -> !;
    }
    model_core_can_panic()
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut decoder = Decoder::new();
    let mut clock = TickClock::new(NonZeroU32::MIN);
    // black_box hides the values from the optimiser.
    let values = black_box(model_core::settings::SettingsValues::reference());
    let Ok(settings) = Settings::new(values) else {
        cortex_m::peripheral::SCB::sys_reset()
    };
    let _ = black_box(settings.encode(black_box(&mut [0; 256])));
    let _ = black_box(Settings::decode(black_box(&[0; 200])));
    let findings = StartFindings {
        image: check_image(black_box(&[0; 64])),
        ram: black_box(true),
        stack_free_bytes: black_box(0),
        reference: black_box((0, 0)),
        regulator: black_box(true),
        valve: black_box([0; VALVE_LEVELS.len()]),
        valve_limits: black_box([(0, 0); VALVE_LEVELS.len()]),
        brown_out_level: black_box(0),
    };
    let start = findings.fault();
    black_box(valve_level(black_box(0)).get());
    let identity = Identity {
        firmware: [0; 3],
        commit: 0,
        board: board_name("board"),
        cpu_hz: 0,
        reset: ResetCause::Power,
        crash: None,
        fault: None,
        start,
        settings: SettingsSource::Stored,
        safety_hash: safety_hash(&values),
        stack_free_bytes: 0,
        frames_rejected: 0,
        messages_dropped: 0,
    };
    let mut load = LinkLoad::new(black_box(NonZeroU32::MIN));
    let start = black_box(Some(StartFault::Ram));
    let mut device = Device::new(settings).started(start);
    let mut gate = SettingsGate::default();
    let mut image = ImageCheck::default();
    let mut sampler = Sampler::new(black_box(0));
    loop {
        let [bridge, pressure, read_back] = sampler.readings(&black_box([0; WORDS]));
        black_box(reading(bridge, &black_box([0; SCANS])));
        let timing = clock.begin(black_box(0));
        clock.end(black_box(0), black_box(0));
        let pins = Pins {
            bridge,
            pressure,
            encoder: black_box(Pins::default().encoder),
            read_back,
            button_pressed: black_box(false),
            stop_open: black_box([false; 2]),
            enabling_closed: black_box(false),
        };
        let message = decoder.push::<ToDevice>(black_box(0));
        let command = match message {
            Some(Ok(ToDevice::Command(command))) => Some(command),
            _ => None,
        };
        if let Some(Ok(ToDevice::WriteSettings(offered))) = message {
            let offer = gate.offer(&values, offered, Signature::default(), black_box(false));
            if let Decision::Ask(number) = black_box(offer) {
                device.propose(Some(number));
            }
        }
        let change = store::change(black_box([&[], &[]]), black_box(0));
        let _ = black_box(encode(&FromDevice::Change(change), &mut [0; FRAME_LEN_MAX]));
        if black_box(image.step(black_box(&[0; 64]), black_box(8))) == ImageState::Sealed(false) {
            device.fail(black_box(StartFault::Image));
        }
        let tick = device.tick(&pins, timing, command.into_iter());
        black_box(tick.verdict.and_then(|verdict| gate.decide(verdict)));
        let telemetry = FromDevice::Telemetry(tick.telemetry);
        let _ = black_box(encode(&telemetry, &mut [0; FRAME_LEN_MAX]));
        let _ = black_box(encode(
            black_box(&FromDevice::Settings(values)),
            &mut [0; 255],
        ));
        let identity = FromDevice::Identity(black_box(identity));
        let _ = black_box(encode(&identity, &mut [0; FRAME_LEN_MAX]));
        load.sent(black_box(0));
        load.received();
        black_box(load.tick());
        black_box((tick.valve.get(), tick.port_pulse, tick.lamp));
    }
}

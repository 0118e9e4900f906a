//! Link-time proof that the functions of model-core that tick and link call cannot panic: the panic
//! handler calls an undefined function, so that this links only if the optimiser has removed every
//! panic. It is never run.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::num::NonZeroU32;
use core::panic::PanicInfo;
use model_core::device::{Device, Pins};
use model_core::link::{Decoder, FRAME_LEN_MAX, FromDevice, ToDevice, encode};
use model_core::sampling::{SAMPLES, Sampler};
use model_core::settings::Settings;
use model_core::timing::TickClock;
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
    let mut device = Device::new(settings);
    let mut sampler = Sampler::new(black_box(0));
    loop {
        let (bridge, pressure) = sampler.readings(&black_box([0; SAMPLES]));
        let timing = clock.begin(black_box(0));
        clock.end(black_box(0), black_box(0));
        let pins = Pins {
            bridge,
            pressure,
            encoder: black_box(Pins::default().encoder),
            button_pressed: black_box(false),
            stop_open: black_box([false; 2]),
        };
        let message = decoder.push::<ToDevice>(black_box(0));
        let command = match message {
            Some(Ok(ToDevice::Command(command))) => Some(command),
            _ => None,
        };
        let tick = device.tick(&pins, timing, command.into_iter());
        let telemetry = FromDevice::Telemetry(tick.telemetry);
        let _ = black_box(encode(&telemetry, &mut [0; FRAME_LEN_MAX]));
        let _ = black_box(encode(
            black_box(&FromDevice::Settings(values)),
            &mut [0; 255],
        ));
        black_box((tick.valve.get(), tick.port_pulse, tick.lamp));
    }
}

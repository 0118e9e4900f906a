//! Bytes on the link: no panic, and a device that heard only invalid frames is as it was.
#![no_main]

use libfuzzer_sys::fuzz_target;
use model_core::device::{Device, Pins};
use model_core::link::{Decoder, FromDevice, ToDevice};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, EncoderCount};
use model_core::timing::Timing;

fuzz_target!(|bytes: &[u8]| {
    let Ok(settings) = Settings::new(SettingsValues::reference()) else {
        return;
    };
    let (mut device, mut quiet) = (Device::new(settings), Device::new(settings));
    let (mut decoder, mut at_pc) = (Decoder::new(), Decoder::new());
    let pins = Pins {
        bridge: AdcCount(2048),
        pressure: AdcCount(410),
        encoder: EncoderCount(7),
        button_pressed: false,
    };
    let mut heard = false;
    for chunk in bytes.chunks(16) {
        let mut commands = Vec::new();
        for byte in chunk {
            let _ = at_pc.push::<FromDevice>(*byte);
            match decoder.push::<ToDevice>(*byte) {
                Some(Ok(ToDevice::Command(command))) => commands.push(command),
                Some(Ok(ToDevice::WriteSettings(values))) => drop(Settings::new(values)),
                _ => {}
            }
        }
        heard |= !commands.is_empty();
        let told = device.tick(&pins, Timing::default(), commands.into_iter());
        let same = quiet.tick(&pins, Timing::default(), core::iter::empty());
        assert!(heard || told == same);
    }
});

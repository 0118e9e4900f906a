//! Flash of any content: no panic, only valid settings come out, and what is written next lies
//! within its slot and is read again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use model_core::settings::{Settings, SettingsValues};
use model_core::store::{self, SLOT_LEN};

const SECTOR_LEN: usize = 2 * SLOT_LEN;

fuzz_target!(|bytes: &[u8]| {
    let mut flash = [[0xFF_u8; SECTOR_LEN]; 2];
    for (cell, byte) in flash.iter_mut().flatten().zip(bytes) {
        *cell = *byte;
    }
    if let Ok(settings) = Settings::decode(bytes) {
        assert!(Settings::new(*settings.values()).is_ok());
    }
    if let Ok(Some(settings)) = store::load([&flash[0], &flash[1]]) {
        assert!(Settings::new(*settings.values()).is_ok());
    }
    let Ok(settings) = Settings::new(SettingsValues::reference()) else {
        return;
    };
    let Ok(write) = store::store([&flash[0], &flash[1]], &settings) else {
        unreachable!("settings fit into a slot")
    };
    assert!(write.sector < 2 && write.offset + write.bytes().len() <= SECTOR_LEN);
    assert!(write.offset % SLOT_LEN == 0 && write.bytes().len() <= SLOT_LEN);
    if write.erase {
        flash[write.sector] = [0xFF; SECTOR_LEN];
    }
    flash[write.sector][write.offset..][..write.bytes().len()].copy_from_slice(write.bytes());
    assert_eq!(store::load([&flash[0], &flash[1]]), Ok(Some(settings)));
});

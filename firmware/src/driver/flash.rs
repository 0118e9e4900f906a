//! The stored settings, in two flash sectors. `model_core::store` decides where to write.

use crate::board::SETTINGS_SECTORS;
use model_core::link::SettingsSource;
use model_core::settings::{Settings, SettingsValues};
use model_core::store;
use stm32f4xx_hal::flash::FlashExt;
use stm32f4xx_hal::pac::FLASH;

/// The store of the settings.
pub struct Store(FLASH);

impl Store {
    /// Makes the store of the flash controller.
    pub fn new(flash: FLASH) -> Store {
        Store(flash)
    }

    /// The stored settings; the reference settings if none are stored or they are unreadable.
    pub fn load(&self) -> (Settings, SettingsSource) {
        let source = match store::load(self.sectors()) {
            Ok(Some(settings)) => return (settings, SettingsSource::Stored),
            Ok(None) => SettingsSource::Reference,
            Err(_) => SettingsSource::ReferenceAsUnreadable,
        };
        match Settings::new(SettingsValues::reference()) {
            Ok(settings) => (settings, source),
            Err(_) => unreachable!("model-core tests that the reference is valid"),
        }
    }

    /// Stores settings and reads them back; false if that fails. The CPU stalls for milliseconds,
    /// or for seconds if a sector must be erased.
    pub fn store(&mut self, settings: &Settings) -> bool {
        let Ok(write) = store::store(self.sectors(), settings) else {
            return false;
        };
        // The data cache is not coherent with flash writes: off here, and flushed afterwards.
        self.0.acr().modify(|_, w| w.dcen().clear_bit());
        let (number, range) = &SETTINGS_SECTORS[write.sector];
        let mut flash = self.0.unlocked();
        let erased = !write.erase || flash.erase(*number).is_ok();
        let offset = range.start + write.offset;
        let written = erased && flash.program(offset, write.bytes().iter()).is_ok();
        drop(flash);
        self.0.acr().modify(|_, w| w.dcrst().set_bit());
        self.0.acr().modify(|_, w| w.dcrst().clear_bit());
        self.0.acr().modify(|_, w| w.dcen().set_bit());
        written && store::load(self.sectors()) == Ok(Some(*settings))
    }

    fn sectors(&self) -> [&[u8]; 2] {
        SETTINGS_SECTORS.map(|(_, range)| &self.0.read()[range])
    }
}

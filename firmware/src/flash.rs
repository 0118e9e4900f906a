//! The settings' place: the flash's last two sectors. model-core's `store` decides what goes where.

use core::ops::Range;
use model_core::link::SettingsSource;
use model_core::settings::{Settings, SettingsValues};
use model_core::store;
use stm32f4xx_hal::flash::FlashExt;
use stm32f4xx_hal::pac::FLASH;

/// Sectors 6 and 7; memory.x leaves them free.
const SECTORS: [Sector; 2] = [
    Sector {
        number: 6,
        range: 0x4_0000..0x6_0000,
    },
    Sector {
        number: 7,
        range: 0x6_0000..0x8_0000,
    },
];

struct Sector {
    number: u8,
    /// From the flash's beginning.
    range: Range<usize>,
}

/// The settings' store.
pub struct Store(FLASH);

impl Store {
    /// The store.
    pub fn new(flash: FLASH) -> Store {
        Store(flash)
    }

    /// The settings that are stored, or the reference.
    pub fn load(&self) -> (Settings, SettingsSource) {
        let source = match store::load(self.sectors()) {
            Ok(Some(settings)) => return (settings, SettingsSource::Stored),
            Ok(None) => SettingsSource::Reference,
            Err(_) => SettingsSource::ReferenceAsUnreadable,
        };
        match Settings::new(SettingsValues::reference()) {
            Ok(settings) => (settings, source),
            Err(_) => unreachable!("the reference is valid: model-core tests it"),
        }
    }

    /// Stores settings. Takes milliseconds, or seconds where a sector has to be erased, in which
    /// the CPU stands still. False where the flash fails.
    pub fn store(&mut self, settings: &Settings) -> bool {
        let Ok(write) = store::store(self.sectors(), settings) else {
            return false;
        };
        // The data cache does not notice that the flash changes.
        self.0.acr().modify(|_, w| w.dcen().clear_bit());
        let sector = &SECTORS[write.sector];
        let mut flash = self.0.unlocked();
        let erased = !write.erase || flash.erase(sector.number).is_ok();
        let offset = sector.range.start + write.offset;
        let written = erased && flash.program(offset, write.bytes().iter()).is_ok();
        drop(flash);
        self.0.acr().modify(|_, w| w.dcrst().set_bit());
        self.0.acr().modify(|_, w| w.dcrst().clear_bit());
        self.0.acr().modify(|_, w| w.dcen().set_bit());
        written && store::load(self.sectors()) == Ok(Some(*settings))
    }

    fn sectors(&self) -> [&[u8]; 2] {
        SECTORS.map(|sector| &self.0.read()[sector.range])
    }
}

//! Settings in the flash's last two sectors: appended, so that a power cut at any moment leaves
//! the old ones or the new ones.

use core::ops::Range;
use embassy_futures::block_on;
use embedded_storage::nor_flash::{NorFlash as _, ReadNorFlash as _};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use model_core::link::SettingsSource;
use model_core::settings::{ENCODED_LEN_MAX, Settings, SettingsValues};
use sequential_storage::cache::{Cache, CacheImpl};
use sequential_storage::map::{MapConfig, MapStorage};
use stm32f4xx_hal::flash::{self, FlashExt, UnlockedFlash};
use stm32f4xx_hal::pac::FLASH;

/// Sectors 6 and 7, from the flash's beginning; memory.x leaves them free.
const SECTORS: Range<u32> = 0x4_0000..0x8_0000;
/// The only key of the map.
const KEY: u8 = 0;

/// The settings' store.
pub struct Store(FLASH);

impl Store {
    /// The store.
    pub fn new(flash: FLASH) -> Store {
        Store(flash)
    }

    /// The settings that are stored, or the reference.
    pub fn load(&mut self) -> (Settings, SettingsSource) {
        let mut buffer = [0; ENCODED_LEN_MAX];
        let stored = self.with_flash(|flash| {
            let mut map = map(flash);
            let bytes = block_on(map.fetch_item::<&[u8]>(&mut buffer, &KEY)).map_err(drop)?;
            bytes.map(Settings::decode).transpose().map_err(drop)
        });
        let source = match stored {
            Ok(Some(settings)) => return (settings, SettingsSource::Stored),
            Ok(None) => SettingsSource::Reference,
            Err(()) => SettingsSource::ReferenceAsUnreadable,
        };
        match Settings::new(SettingsValues::reference()) {
            Ok(settings) => (settings, source),
            Err(_) => unreachable!("the reference is valid: model-core tests it"),
        }
    }

    /// Stores settings. Takes milliseconds, or seconds where a sector has to be erased, in which
    /// the CPU stands still. False where the flash fails.
    pub fn store(&mut self, settings: &Settings) -> bool {
        let mut encoded = [0; ENCODED_LEN_MAX];
        let Ok(encoded) = settings.encode(&mut encoded) else {
            return false;
        };
        let mut buffer = [0; 2 * ENCODED_LEN_MAX];
        self.with_flash(|flash| {
            let mut map = map(flash);
            let mut store = || block_on(map.store_item(&mut buffer, &KEY, &encoded));
            if store().is_ok() {
                return true;
            }
            // What is there cannot be repaired.
            block_on(map.erase_all()).is_ok()
                && block_on(map.store_item(&mut buffer, &KEY, &encoded)).is_ok()
        })
    }

    /// Lets `f` use the flash. The data cache does not notice that the flash changes.
    fn with_flash<R>(&mut self, f: impl FnOnce(Blocking) -> R) -> R {
        self.0.acr().modify(|_, w| w.dcen().clear_bit());
        let result = f(Blocking(self.0.unlocked()));
        self.0.acr().modify(|_, w| w.dcrst().set_bit());
        self.0.acr().modify(|_, w| w.dcrst().clear_bit());
        self.0.acr().modify(|_, w| w.dcen().set_bit());
        result
    }
}

fn map(flash: Blocking) -> MapStorage<u8, Blocking, impl CacheImpl<u8>> {
    const CONFIG: MapConfig<Blocking> = MapConfig::new(SECTORS);
    MapStorage::new(flash, CONFIG, Cache::new_uncached())
}

/// The HAL's flash, which blocks, behind the traits that the store wants.
struct Blocking<'a>(UnlockedFlash<'a>);

impl ErrorType for Blocking<'_> {
    type Error = flash::Error;
}

impl ReadNorFlash for Blocking<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), flash::Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Blocking<'_> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = 128 * 1024;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), flash::Error> {
        embedded_storage::nor_flash::NorFlash::erase(&mut self.0, from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), flash::Error> {
        self.0.write(offset, bytes)
    }
}

//! The flash sectors of the settings.

use crate::board::SETTINGS_SECTORS;
use rig_drivers::store::Sectors;
use stm32f4xx_hal::flash::FlashExt;
use stm32f4xx_hal::pac::FLASH;

/// Address of the flash.
const FLASH_START: usize = 0x0800_0000;

/// The program: what is flashed below the settings.
pub fn program() -> &'static [u8] {
    let [(_, settings), _] = SETTINGS_SECTORS;
    let address = FLASH_START as *const u8;
    #[allow(unsafe_code)]
    // SAFETY: the flash is readable there, and nothing in this program writes to it.
    unsafe {
        core::slice::from_raw_parts(address, settings.start)
    }
}

/// The flash controller.
pub struct Flash(FLASH);

impl Flash {
    /// Takes the flash controller.
    pub fn new(flash: FLASH) -> Flash {
        Flash(flash)
    }

    /// The option BOR_LEV: 0 resets the chip below 2.7 V, 3 only below 1.8 V.
    pub fn brown_out_level(&self) -> u8 {
        (self.0.optcr().read().bits() >> 2 & 3) as u8
    }

    /// Changes the flash. The data cache is not coherent with that: off here, and emptied
    /// afterwards.
    fn change(&mut self, operation: impl FnOnce(&mut FLASH) -> bool) -> bool {
        self.0.acr().modify(|_, w| w.dcen().clear_bit());
        let done = operation(&mut self.0);
        self.0.acr().modify(|_, w| w.dcrst().set_bit());
        self.0.acr().modify(|_, w| w.dcrst().clear_bit());
        self.0.acr().modify(|_, w| w.dcen().set_bit());
        done
    }
}

impl Sectors for Flash {
    fn sectors(&self) -> [&[u8]; 2] {
        SETTINGS_SECTORS.map(|(_, range)| &self.0.read()[range])
    }

    fn erase(&mut self, sector: usize) -> bool {
        let (number, _) = SETTINGS_SECTORS[sector];
        self.change(|flash| flash.unlocked().erase(number).is_ok())
    }

    fn program(&mut self, sector: usize, offset: usize, bytes: &[u8]) -> bool {
        let (_, range) = &SETTINGS_SECTORS[sector];
        let offset = range.start + offset;
        self.change(|flash| flash.unlocked().program(offset, bytes.iter()).is_ok())
    }
}

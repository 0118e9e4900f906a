//! The stored settings, in two flash sectors. `model_core::store` decides where to write.

use model_core::link::{Change, SettingsSource, Signature};
use model_core::settings::{Settings, SettingsValues};
use model_core::store;

/// Two flash sectors; `embedded-hal` 1.0 has no trait for flash. A call may stall the CPU for
/// milliseconds, or for seconds if it erases.
pub trait Sectors {
    /// What the sectors contain.
    fn sectors(&self) -> [&[u8]; 2];

    /// Erases a sector; false if that fails.
    fn erase(&mut self, sector: usize) -> bool;

    /// Programs erased bytes of a sector; false if that fails.
    fn program(&mut self, sector: usize, offset: usize, bytes: &[u8]) -> bool;
}

/// The store of the settings.
pub struct Store<F>(pub F);

impl<F: Sectors> Store<F> {
    /// The stored settings; the reference settings if none are stored or they are unreadable.
    pub fn load(&self) -> (Settings, SettingsSource) {
        let source = match store::load(self.0.sectors()) {
            Ok(Some(settings)) => return (settings, SettingsSource::Stored),
            Ok(None) => SettingsSource::Reference,
            Err(_) => SettingsSource::ReferenceAsUnreadable,
        };
        match Settings::new(SettingsValues::reference()) {
            Ok(settings) => (settings, source),
            Err(_) => unreachable!("model-core tests that the reference is valid"),
        }
    }

    /// The settings so many changes before those in force.
    pub fn change(&self, back: u16) -> Option<Change> {
        store::change(self.0.sectors(), back)
    }

    /// Stores settings, with who has changed them and when, and reads them back; false if that
    /// fails.
    pub fn store(&mut self, settings: &Settings, signature: &Signature) -> bool {
        let Ok(write) = store::store_signed(self.0.sectors(), settings, signature) else {
            return false;
        };
        let erased = !write.erase || self.0.erase(write.sector);
        let written = erased && self.0.program(write.sector, write.offset, write.bytes());
        written && store::load(self.0.sectors()) == Ok(Some(*settings))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    extern crate std;

    /// Flash whose operations may fail, or pretend to succeed.
    struct Memory {
        cells: [Vec<u8>; 2],
        erases: bool,
        programs: bool,
        sticks: bool,
    }

    impl Sectors for Memory {
        fn sectors(&self) -> [&[u8]; 2] {
            [&self.cells[0], &self.cells[1]]
        }
        fn erase(&mut self, sector: usize) -> bool {
            self.cells[sector].fill(0xff);
            self.erases
        }
        fn program(&mut self, sector: usize, offset: usize, bytes: &[u8]) -> bool {
            for (cell, byte) in self.cells[sector][offset..].iter_mut().zip(bytes) {
                *cell &= if self.sticks { 0xff } else { *byte };
            }
            self.programs
        }
    }

    fn erased() -> Store<Memory> {
        Store(Memory {
            cells: [vec![0xff; 4096], vec![0xff; 4096]],
            erases: true,
            programs: true,
            sticks: false,
        })
    }

    fn settings(gain: f32) -> Settings {
        let values = SettingsValues {
            gain,
            ..SettingsValues::reference()
        };
        Settings::new(values).unwrap()
    }

    #[test]
    fn newest_settings_are_loaded_also_after_sectors_were_reused() {
        let mut store = erased();
        assert_eq!(store.load().1, SettingsSource::Reference);
        for n in 0..100 {
            let settings = settings(0.1 + 0.001 * n as f32);
            assert!(store.store(&settings, &Signature::default()));
            assert_eq!(store.load(), (settings, SettingsSource::Stored));
        }
    }

    #[test]
    fn failure_to_program_or_cells_that_stick_are_reported() {
        for (programs, sticks) in [(false, false), (true, true)] {
            let mut store = erased();
            (store.0.programs, store.0.sticks) = (programs, sticks);
            assert!(!store.store(&settings(0.2), &Signature::default()));
        }
    }

    #[test]
    fn failure_to_erase_is_reported_and_the_old_settings_stay() {
        let mut store = erased();
        store.0.erases = false;
        let mut last = None;
        for n in 0..100 {
            let settings = settings(0.1 + 0.001 * n as f32);
            if !store.store(&settings, &Signature::default()) {
                assert_eq!(Some(store.load().0), last, "a failed erase loses nothing");
                return;
            }
            last = Some(settings);
        }
        panic!("no sector had to be erased");
    }
}

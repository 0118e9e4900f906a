//! Settings survive resets and power cuts.

use crate::rig::{MS, Rig};
use model_core::link::{FromDevice, SettingsSource, ToDevice, Written};
use model_core::settings::SettingsValues;

/// Range of the settings sectors in the flash.
const SECTORS: std::ops::Range<usize> = 0x4_0000..0x8_0000;

const FLASH: u32 = 0x0800_0000;

/// Settings with a gain that depends on `number`.
fn numbered(number: u32) -> SettingsValues {
    let mut values = SettingsValues::reference();
    values.gain = 10.0 + (number % 1000) as f32 * 0.01;
    values
}

/// Requests the settings in force.
fn read(rig: &mut Rig) -> SettingsValues {
    rig.messages();
    rig.send(&ToDevice::ReadSettings);
    // the board may have to erase a sector before it answers
    for _ in 0..500 {
        rig.run_ms(10);
        for (_, message) in rig.messages() {
            if let FromDevice::Settings(values) = message {
                return values;
            }
        }
    }
    panic!("no answer in 5 s");
}

fn write_result(rig: &mut Rig) -> Option<Written> {
    rig.messages()
        .into_iter()
        .find_map(|(_, message)| match message {
            FromDevice::Written(written) => Some(written),
            _ => None,
        })
}

/// The next pseudo-random number (xorshift).
fn random(seed: &mut u64) -> u64 {
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    *seed
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn settings_are_stored_and_survive_reset_and_power_cut() {
    let mut rig = Rig::after_ms(100);
    assert_eq!(read(&mut rig), SettingsValues::reference());
    rig.send(&ToDevice::WriteSettings(numbered(7)));
    rig.run_ms(500);
    assert_eq!(write_result(&mut rig), Some(Written::Stored));
    for cut in [false, true] {
        assert_eq!(read(&mut rig), numbered(7));
        assert_eq!(rig.identity().settings, SettingsSource::Stored);
        if cut {
            rig.board.power_cut();
            rig.run_ms(10);
            rig.board.power_on();
        } else {
            rig.board.reset_pin();
        }
        rig.run_ms(50);
    }
    assert_eq!(read(&mut rig), numbered(7));
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn invalid_settings_and_settings_while_assisting_are_rejected() {
    let mut rig = Rig::after_ms(1_500);
    let mut invalid = SettingsValues::reference();
    invalid.gain = f32::NAN;
    rig.send(&ToDevice::WriteSettings(invalid));
    rig.run_ms(20);
    assert_eq!(write_result(&mut rig), Some(Written::Invalid));
    let assist = model_core::device::Command::Request(model_core::io::Request::Assist);
    rig.send(&ToDevice::Command(assist));
    rig.run_ms(50);
    rig.messages();
    rig.send(&ToDevice::WriteSettings(numbered(1)));
    rig.run_ms(20);
    assert_eq!(write_result(&mut rig), Some(Written::Armed));
    assert_eq!(rig.board.resets(), []);
}

/// Interrupts the supply while settings are written, and checks that the old or the new ones are
/// stored.
struct PowerCuts {
    rig: Rig,
    seed: u64,
    number: u32,
    stored: SettingsValues,
    /// Cuts after which the new settings are stored.
    new_count: usize,
    /// Cuts during a flash operation.
    busy_count: usize,
}

impl PowerCuts {
    fn new(rig: Rig, seed: u64) -> PowerCuts {
        let stored = SettingsValues::reference();
        PowerCuts {
            rig,
            seed,
            number: 0,
            stored,
            new_count: 0,
            busy_count: 0,
        }
    }

    /// Writes settings and cuts the supply at a random time within `window_ns`.
    fn cut(&mut self, window_ns: u64) {
        self.number += 1;
        let rig = &mut self.rig;
        let new = numbered(self.number);
        rig.send(&ToDevice::WriteSettings(new));
        let cut_after_ns = random(&mut self.seed) % window_ns;
        rig.board.run_for(cut_after_ns);
        self.busy_count += usize::from(rig.board.is_flash_busy());
        rig.board.power_cut();
        rig.board.run_for(MS);
        rig.board.power_on();
        rig.run_ms(20);
        let values = read(rig);
        let intact = values == new || values == self.stored;
        assert!(
            intact,
            "cut {} after {cut_after_ns} ns: gain {}",
            self.number, values.gain
        );
        self.new_count += usize::from(values == new);
        self.stored = values;
    }
}

/// A board with the given content of the settings sectors; erased if none is given.
fn cuts(sectors: Option<&[u8]>, seed: u64) -> PowerCuts {
    let mut rig = Rig::new();
    if let Some(sectors) = sectors {
        rig.board.write_flash(FLASH + SECTORS.start as u32, sectors);
    }
    rig.run_ms(20);
    let mut cuts = PowerCuts::new(rig, seed);
    cuts.stored = read(&mut cuts.rig);
    cuts
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn power_cuts_leave_the_old_or_the_new_settings() {
    let (mut new_count, mut busy) = (0, 0);
    for round in 0..10 {
        let mut cuts = cuts(None, 0x5eed + round);
        for _ in 0..100 {
            cuts.cut(8 * MS);
        }
        new_count += cuts.new_count;
        busy += cuts.busy_count;
    }
    println!("1000 cuts, {busy} in a flash operation, {new_count} with the new settings stored");
    assert!((100..900).contains(&new_count) && busy > 100);
}

/// Content of the settings sectors for which the next write must erase one.
fn store_before_an_erase(rig: &mut Rig) -> Vec<u8> {
    let store = |rig: &Rig| rig.board.flash()[SECTORS].to_vec();
    let mut before = store(rig);
    for number in 1..2_000 {
        let (erases, resets) = (rig.board.flash_erase_count(), rig.board.resets().len());
        rig.send(&ToDevice::WriteSettings(numbered(number)));
        let timeout_ns = rig.board.time_ns() + 10_000 * MS;
        while rig.board.resets().len() == resets {
            rig.run_ms(1);
            assert!(rig.board.time_ns() < timeout_ns, "no restart after a write");
        }
        rig.run_ms(20);
        if rig.board.flash_erase_count() > erases {
            return before;
        }
        before = store(rig);
    }
    panic!("no write has erased a sector");
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn power_cuts_while_a_sector_is_erased_leave_the_old_or_the_new_settings() {
    let mut rig = Rig::after_ms(20);
    let before = store_before_an_erase(&mut rig);
    let mut busy = 0;
    for round in 0..100 {
        let mut cuts = cuts(Some(&before), 0xe4a5e + round);
        // an erase takes 2 s; the second cut may interrupt the recovery from the first
        cuts.cut(2_100 * MS);
        cuts.cut(2_100 * MS);
        busy += cuts.busy_count;
    }
    println!("200 cuts, {busy} in a flash operation");
    assert!(busy > 50);
}

//! Settings survive resets and power cuts.

use crate::rig::{MS, Rig};
use model_core::link::{FromDevice, SettingsSource, ToDevice, Written};
use model_core::settings::SettingsValues;

/// Where the firmware keeps its settings.
const SECTORS: std::ops::Range<usize> = 0x4_0000..0x8_0000;

/// Settings that can be told from each other by their gain.
fn numbered(number: u32) -> SettingsValues {
    let mut values = SettingsValues::reference();
    values.gain = 10.0 + (number % 1000) as f32 * 0.01;
    values
}

/// The settings that the board says are in force.
fn read(rig: &mut Rig) -> SettingsValues {
    rig.messages();
    rig.send(&ToDevice::ReadSettings);
    // a board that boots may have to erase before it answers
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

fn written(rig: &mut Rig) -> Option<Written> {
    rig.messages()
        .into_iter()
        .find_map(|(_, message)| match message {
            FromDevice::Written(written) => Some(written),
            _ => None,
        })
}

/// Noise (xorshift).
fn random(seed: &mut u64) -> u64 {
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    *seed
}

#[test]
fn settings_are_stored_and_survive_reset_and_power_cut() {
    let Some(mut rig) = Rig::after_ms(100) else {
        return;
    };
    assert_eq!(read(&mut rig), SettingsValues::reference());
    rig.send(&ToDevice::WriteSettings(numbered(7)));
    rig.run_ms(500);
    assert_eq!(written(&mut rig), Some(Written::Stored));
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
fn settings_are_refused_while_assisting_and_when_they_make_no_sense() {
    let Some(mut rig) = Rig::after_ms(1_500) else {
        return;
    };
    let mut senseless = SettingsValues::reference();
    senseless.gain = f32::NAN;
    rig.send(&ToDevice::WriteSettings(senseless));
    rig.run_ms(20);
    assert_eq!(written(&mut rig), Some(Written::Invalid));
    let assist = model_core::device::Command::Request(model_core::frame::Request::Assist);
    rig.send(&ToDevice::Command(assist));
    rig.run_ms(50);
    rig.messages();
    rig.send(&ToDevice::WriteSettings(numbered(1)));
    rig.run_ms(20);
    assert_eq!(written(&mut rig), Some(Written::Armed));
    assert_eq!(rig.board.resets(), []);
}

/// Cuts the power while settings are written, and checks that the old or the new ones are there.
struct Cutter {
    rig: Rig,
    seed: u64,
    number: u32,
    held: SettingsValues,
    new_ones: usize,
    busy: usize,
}

impl Cutter {
    fn new(rig: Rig, seed: u64) -> Cutter {
        let held = SettingsValues::reference();
        Cutter {
            rig,
            seed,
            number: 0,
            held,
            new_ones: 0,
            busy: 0,
        }
    }

    /// One cut within `window_ns` after the write is sent.
    fn cut(&mut self, window_ns: u64) {
        self.number += 1;
        let rig = &mut self.rig;
        let new = numbered(self.number);
        rig.send(&ToDevice::WriteSettings(new));
        let cut_after_ns = random(&mut self.seed) % window_ns;
        rig.board.run_for(cut_after_ns);
        self.busy += usize::from(rig.board.is_flash_busy());
        rig.board.power_cut();
        rig.board.run_for(MS);
        rig.board.power_on();
        rig.run_ms(20);
        let values = read(rig);
        let whole = values == new || values == self.held;
        assert!(
            whole,
            "cut {} after {cut_after_ns} ns: gain {}",
            self.number, values.gain
        );
        self.new_ones += usize::from(values == new);
        self.held = values;
    }

    fn report(&self, what: &str) {
        let (cuts, new, busy) = (self.number, self.new_ones, self.busy);
        let erases = self.rig.board.flash_erase_count();
        println!(
            "{what}: {cuts} cuts, {new} left the new settings, {busy} in a flash operation, {erases} erases"
        );
    }
}

#[test]
fn power_cuts_leave_the_old_or_the_new_settings() {
    let Some(rig) = Rig::after_ms(20) else { return };
    let mut cutter = Cutter::new(rig, 0x5eed);
    for _ in 0..1_000 {
        cutter.cut(12 * MS);
    }
    cutter.report("writing");
    assert!(cutter.new_ones > 100 && cutter.busy > 100);
}

#[test]
fn power_cuts_while_a_sector_is_erased_leave_the_old_or_the_new_settings() {
    let Some(mut rig) = Rig::after_ms(20) else {
        return;
    };
    // fill the store until its next write needs an erased sector
    let mut number = 0;
    let mut before = rig.board.flash()[SECTORS].to_vec();
    loop {
        number += 1;
        let (erases, resets) = (rig.board.flash_erase_count(), rig.board.resets().len());
        rig.send(&ToDevice::WriteSettings(numbered(number)));
        while rig.board.resets().len() == resets {
            rig.run_ms(1);
        }
        rig.run_ms(12);
        if rig.board.flash_erase_count() > erases {
            break;
        }
        before = rig.board.flash()[SECTORS].to_vec();
        assert!(number < 5_000, "the store never erases");
    }
    println!("first erase at write {number}");
    let full_ns = 2_500 * MS;
    for round in 0..100 {
        let mut rig = Rig::new().expect("the firmware is there");
        rig.board
            .write_flash(0x0800_0000 + SECTORS.start as u32, &before);
        rig.run_ms(20);
        let mut cutter = Cutter::new(rig, 0xe4a5e + round);
        cutter.held = read(&mut cutter.rig);
        cutter.number = number;
        // the cut may come in the erase, or in the second attempt to repair it
        cutter.cut(full_ns);
        cutter.cut(full_ns);
    }
}

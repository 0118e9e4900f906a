//! Settings survive resets and power cuts.

use crate::rig::{MS, Rig};
use model_core::link::{FromDevice, SettingsSource, ToDevice, Written};
use model_core::settings::SettingsValues;

/// Where the firmware keeps its settings.
const SECTORS: std::ops::Range<usize> = 0x4_0000..0x8_0000;

const FLASH: u32 = 0x0800_0000;

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
    let assist = model_core::device::Command::Request(model_core::io::Request::Assist);
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
}

/// A board whose store contains `sectors`, and who holds them.
fn cutter(sectors: Option<&[u8]>, seed: u64) -> Option<Cutter> {
    let mut rig = Rig::new()?;
    if let Some(sectors) = sectors {
        rig.board.write_flash(FLASH + SECTORS.start as u32, sectors);
    }
    rig.run_ms(20);
    let mut cutter = Cutter::new(rig, seed);
    cutter.held = read(&mut cutter.rig);
    Some(cutter)
}

#[test]
fn power_cuts_leave_the_old_or_the_new_settings() {
    let (mut new_ones, mut busy) = (0, 0);
    for round in 0..10 {
        let Some(mut cutter) = cutter(None, 0x5eed + round) else {
            return;
        };
        for _ in 0..100 {
            cutter.cut(8 * MS);
        }
        new_ones += cutter.new_ones;
        busy += cutter.busy;
    }
    println!("1000 cuts, {busy} in a flash operation, {new_ones} left the new settings");
    assert!((100..900).contains(&new_ones) && busy > 100);
}

/// What the store's sectors hold when its next write has to erase one.
fn store_before_an_erase(rig: &mut Rig) -> Vec<u8> {
    let store = |rig: &Rig| rig.board.flash()[SECTORS].to_vec();
    let mut before = store(rig);
    for number in 1..2_000 {
        let (erases, resets) = (rig.board.flash_erase_count(), rig.board.resets().len());
        rig.send(&ToDevice::WriteSettings(numbered(number)));
        let give_up_ns = rig.board.time_ns() + 10_000 * MS;
        while rig.board.resets().len() == resets {
            rig.run_ms(1);
            assert!(rig.board.time_ns() < give_up_ns, "no restart after a write");
        }
        rig.run_ms(20);
        if rig.board.flash_erase_count() > erases {
            return before;
        }
        before = store(rig);
    }
    panic!("the store never erases");
}

#[test]
fn power_cuts_while_a_sector_is_erased_leave_the_old_or_the_new_settings() {
    let Some(mut rig) = Rig::after_ms(20) else {
        return;
    };
    let before = store_before_an_erase(&mut rig);
    let mut busy = 0;
    for round in 0..100 {
        let mut cutter = cutter(Some(&before), 0xe4a5e + round).expect("the firmware is there");
        // an erase takes 2 s; the second cut may hit its repair
        cutter.cut(2_100 * MS);
        cutter.cut(2_100 * MS);
        busy += cutter.busy;
    }
    println!("200 cuts, {busy} in a flash operation");
    assert!(busy > 50);
}

//! Settings survive resets and power cuts.

use crate::rig::{BUTTON, LAMP, MS, Rig, TICK_EXCEPTION};
use emulated_board::{Oscillators, ResetCause};
use model_core::limits::safety_hash;
use model_core::link::{Change, FromDevice, SettingsSource, Signature, ToDevice, Written};
use model_core::settings::SettingsValues;
use model_core::supervisor::Mode;

/// Range of the settings sectors in the flash.
const SECTORS: std::ops::Range<usize> = 0x4_0000..0x8_0000;

const FLASH: u32 = 0x0800_0000;

/// Settings with a value outside the safety block that depends on `number`.
fn numbered(number: u32) -> SettingsValues {
    let mut values = SettingsValues::reference();
    values.compensation.friction_n = 10.0 + (number % 1000) as f32 * 0.01;
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

/// The level of the button, and of the lamp after each millisecond, for so long.
fn lamp(rig: &mut Rig, pressed: bool, ms: u64) -> Vec<bool> {
    rig.board.set_level(BUTTON, Some(!pressed));
    let lit = |rig: &mut Rig| {
        rig.run_ms(1);
        rig.board.level(LAMP) == Some(true)
    };
    (0..ms).map(|_| lit(rig)).collect()
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn settings_of_the_safety_block_are_stored_when_the_button_is_held() {
    let mut rig = Rig::after_ms(1_000);
    let faster = SettingsValues {
        reference_speed_m_per_s_max: 0.5,
        ..SettingsValues::reference()
    };
    let before = rig.identity().safety_hash;
    assert_eq!(before, safety_hash(&SettingsValues::reference()));
    // A short press, and nobody: 30 s.
    for hold_ms in [1_500, 0] {
        rig.send(&ToDevice::WriteSettings(faster));
        rig.run_ms(30);
        assert_eq!(write_result(&mut rig), Some(Written::AwaitsButton));
        let asked = lamp(&mut rig, false, 1_000);
        let changes = asked.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(
            (19..=21).contains(&changes),
            "{changes} changes of the lamp in 1 s"
        );
        lamp(&mut rig, true, hold_ms);
        lamp(&mut rig, false, if hold_ms > 0 { 50 } else { 29_100 });
        assert_eq!(write_result(&mut rig), Some(Written::NotConfirmed));
    }
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    assert_eq!(rig.board.resets(), []);
    let signature = Signature {
        utc_s: 1_800_000_000,
        author: *b"somebody\0\0\0\0\0\0\0\0",
        is_confirmed: false,
    };
    rig.send(&ToDevice::Sign(signature));
    rig.store(faster);
    rig.run_ms(50);
    assert_eq!(read(&mut rig), faster);
    assert_eq!(rig.identity().safety_hash, safety_hash(&faster));
    rig.messages();
    rig.send(&ToDevice::ReadChange(0));
    rig.run_ms(50);
    let messages = rig.messages();
    let change = messages.iter().find_map(|(_, message)| match message {
        FromDevice::Change(change) => *change,
        _ => None,
    });
    let is_confirmed = true;
    let expected = Change {
        number: 0,
        signature: Signature {
            is_confirmed,
            ..signature
        },
        values: faster,
    };
    assert_eq!(change, Some(expected));
    rig.assert_no_errors();
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
            "cut {} after {cut_after_ns} ns: {} N",
            self.number, values.compensation.friction_n
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

/// Times from the arrival of settings to the reset, at any phase of the tick.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn no_tick_runs_while_settings_are_stored() {
    let mut rig = Rig::after_ms(100);
    for number in 1..=10_u32 {
        let tick_ns = rig.next_tick_ns();
        rig.board
            .run_until(tick_ns + u64::from(number) * MS - MS / 2);
        rig.board.exceptions();
        rig.board.trace_exceptions(true);
        let resets = rig.board.resets().len();
        rig.send(&ToDevice::WriteSettings(numbered(number)));
        while !rig.board.is_flash_busy() {
            rig.board.run_for(MS / 100);
        }
        let begun_ns = rig.board.time_ns();
        while rig.board.resets().len() == resets {
            rig.board.run_for(MS / 10);
        }
        let events = rig.board.exceptions();
        let tick = events.iter().find(|e| {
            let stored_ns = begun_ns..rig.board.resets()[resets].time_ns;
            e.exception == TICK_EXCEPTION && stored_ns.contains(&e.time_ns)
        });
        assert_eq!(tick, None, "settings {number}");
        rig.run_ms(50);
    }
    assert_eq!(read(&mut rig), numbered(10));
    rig.assert_no_errors();
}

/// The watchdog's oscillator may run at 47 kHz instead of 32.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn erasing_a_sector_does_not_trip_the_fastest_watchdog() {
    let mut rig = Rig::new();
    let before = store_before_an_erase(&mut Rig::after_ms(20));
    rig.board.write_flash(FLASH + SECTORS.start as u32, &before);
    rig.board.set_oscillators(Oscillators {
        lsi_hz: 47_000,
        ..Oscillators::default()
    });
    rig.run_ms(100);
    let (erases, sent_ns) = (rig.board.flash_erase_count(), rig.board.time_ns());
    rig.send(&ToDevice::WriteSettings(numbered(999)));
    while rig.board.resets().is_empty() {
        rig.run_ms(1);
    }
    let reset = rig.board.resets()[0];
    assert_eq!(reset.cause, ResetCause::Software);
    assert!(
        reset.time_ns - sent_ns > 1_000 * MS,
        "an erase takes seconds"
    );
    assert_eq!(rig.board.flash_erase_count(), erases + 1);
    assert_eq!(write_result(&mut rig), Some(Written::Stored));
    rig.run_ms(50);
    assert_eq!(read(&mut rig), numbered(999));
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn settings_that_the_flash_does_not_take_are_reported_and_the_old_ones_stay() {
    let mut rig = Rig::after_ms(100);
    rig.send(&ToDevice::WriteSettings(numbered(1)));
    rig.run_ms(500);
    // All but the slots that are written, at the start of each sector.
    rig.board.wear_flash(SECTORS.start + 600..SECTORS.end);
    rig.messages();
    rig.send(&ToDevice::WriteSettings(numbered(2)));
    rig.run_ms(500);
    assert_eq!(write_result(&mut rig), Some(Written::FlashFailed));
    assert_eq!(read(&mut rig), numbered(1));
}

/// The sector that holds the settings in force must not be the one that is erased.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn power_cut_in_the_middle_of_an_erase_leaves_the_old_settings() {
    let mut rig = Rig::new();
    let before = store_before_an_erase(&mut Rig::after_ms(20));
    rig.board.write_flash(FLASH + SECTORS.start as u32, &before);
    rig.run_ms(100);
    let (old, erases) = (read(&mut rig), rig.board.flash_erase_count());
    assert_ne!(old, SettingsValues::reference());
    rig.send(&ToDevice::WriteSettings(numbered(999)));
    while rig.board.flash_erase_count() == erases {
        rig.board.run_for(MS);
    }
    rig.board.run_for(500 * MS);
    assert!(rig.board.is_flash_busy());
    rig.board.power_cut();
    rig.board.run_for(MS);
    rig.board.power_on();
    rig.run_ms(50);
    assert_eq!(read(&mut rig), old);
}

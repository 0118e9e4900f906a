//! The fault campaign on the image that would be flashed, beside the same cases on the PC.
//!
//! Sensors break at the pins, bits flip in the RAM, stored settings in the flash; ticks are late or
//! missing as the core is held. Where a program hangs, the reset that the watchdog makes (crash.rs)
//! comes when the case has it.

use crate::rig::{BRIDGE, MS, PRESSURE, Rig, TICK_NS, volts};
use hil_sim::faults::Case;
use hil_sim::faults::campaign::run_case;
use hil_sim::faults::kind::{Inject, KINDS, Memory};
use hil_sim::faults::outcome::Outcome;
use hil_sim::faults::run::{run, settings, stored};
use hil_sim::faults::unit::{Told, Unit};
use model_core::device::{Device, Pins};
use model_core::io::Output;
use model_core::link::Telemetry;
use model_core::signal::{COUNT_MAX, DacCount};
use std::collections::BTreeMap;

/// Cases, unless FAULT_CASES says otherwise.
const CASES: u64 = 60;
/// From a reset to the end of the first conversions, rounded up; the others keep that distance.
const CONVERTED_NS: u64 = 1_200_000;
/// From a tick to its telemetry's end.
const TOLD_NS: u64 = 3 * MS;
/// Where settings lie: the flash's last two sectors.
const SECTORS: [u32; 2] = [0x0804_0000, 0x0806_0000];
/// The firmware's device in RAM, by the name that RTIC gives it.
const DEVICE: &str = "rtic_internal_local_resource_device";

/// The board, a tick at a time.
pub struct OnBoard {
    /// It.
    pub rig: Rig,
    /// What it told in the last tick.
    pub telemetry: Vec<Telemetry>,
    /// When it was reset, and so many ticks later.
    tick_ns: u64,
    held: bool,
    output: Output,
}

impl OnBoard {
    /// A board with nothing in its settings' sectors but what is stored there.
    pub fn new(stored: Option<[Vec<u8>; 2]>) -> Option<OnBoard> {
        let mut rig = Rig::new()?;
        for (sector, address) in stored.iter().flatten().zip(SECTORS) {
            rig.board.write_flash(address, sector);
        }
        Some(OnBoard {
            rig,
            telemetry: Vec::new(),
            tick_ns: 0,
            held: false,
            output: Output::default(),
        })
    }

    fn device(&self) -> u32 {
        let address = self.rig.board.symbol_with(DEVICE);
        address.unwrap_or_else(|| panic!("no {DEVICE} in the ELF"))
    }
}

impl Unit for OnBoard {
    /// The core is held beyond the tick's time.
    fn skip(&mut self) {
        self.rig.board.hold_core(true);
        self.held = true;
        self.rig
            .board
            .run_until(self.tick_ns + CONVERTED_NS + TOLD_NS);
        self.tick_ns += TICK_NS;
    }

    fn tick(&mut self, pins: &Pins, _: u8, late_s: f64, bytes: &[u8]) -> Told {
        let board = &mut self.rig.board;
        board.set_analog(BRIDGE, volts(pins.bridge.0));
        board.set_analog(PRESSURE, volts(pins.pressure.0));
        board.set_encoder(i64::from(pins.encoder.0 as i32));
        board.link_send(bytes);
        let late_ns = (1e9 * late_s) as u64;
        if self.held || late_ns > 0 {
            board.hold_core(true);
            // What was pending from a tick before is this one then.
            board.run_until(self.tick_ns + CONVERTED_NS + late_ns);
            board.hold_core(false);
            self.held = false;
        }
        // Of a very late one the telemetry is read with the next: then the next conversions begin.
        let told_ns = (CONVERTED_NS + late_ns + TOLD_NS).min(TICK_NS + CONVERTED_NS - MS / 5);
        board.run_until(self.tick_ns + told_ns);
        self.tick_ns += TICK_NS;
        self.telemetry = self.rig.telemetry();
        if let Some(telemetry) = self.telemetry.last() {
            self.output = telemetry.output;
        }
        let scale = self.rig.board.dac_volts(1) / 3.3;
        Told {
            valve: DacCount::new((scale * f64::from(COUNT_MAX)).round() as u16),
            output: self.output,
        }
    }

    fn restart(&mut self) {
        self.rig.board.reset_pin();
        self.tick_ns = self.rig.board.time_ns();
        self.output = Output::default();
    }

    /// Any bit of the device: what the copies do not hold is in the way too.
    fn damage(&mut self, _: Memory, copy: usize, bit: usize) {
        let place = (bit * 7919 + copy * 104_729) % (8 * size_of::<Device>());
        let address = self.device() + (place / 8) as u32;
        let byte = self.rig.board.read_memory(address, 1)[0] ^ 1 << (place % 8);
        self.rig.board.write_ram(address, &[byte]);
    }
}

/// What must be the same there and here.
fn verdict(outcome: &Outcome) -> String {
    format!(
        "{:?} {:?} {:?} {:?}",
        outcome.mode, outcome.reason, outcome.latched_after_s, outcome.outside
    )
}

#[test]
fn faults_end_on_the_board_as_they_do_on_the_pc() {
    if crate::rig::firmware().is_none() {
        return;
    }
    let cases = std::env::var("FAULT_CASES").map_or(CASES, |n| n.parse().expect("a number"));
    let (mut compared, mut kinds) = (0, BTreeMap::new());
    for number in 0..cases {
        let case = Case::new(2, number);
        let (settings, _) = settings(&case).expect("the reference rig is a board's");
        let stored = stored(&case).map(|stored| stored.sectors);
        let mut board = OnBoard::new(stored).expect("the firmware is there");
        let there = run(&case, &settings, &mut board, |_| {}).expect("it runs");
        *kinds.entry(case.kind.name).or_insert(0) += 1;
        // Where a random bit flips is not the same here; all else is.
        if matches!(case.kind.inject, Inject::Damage(_)) {
            let weight = there
                .outside
                .iter()
                .find(|bound| !bound.starts_with("reason"));
            assert_eq!(weight, None, "case {number}: {there:?}");
            continue;
        }
        assert!(there.outside.is_empty(), "case {number}: {there:?}");
        let here = run_case(&case, None, |_| {}).expect("it runs");
        assert_eq!(
            verdict(&there),
            verdict(&here),
            "case {number}: {}",
            case.words()
        );
        let speeds = [
            there.speed_up_m_per_s_max - here.speed_up_m_per_s_max,
            there.speed_down_m_per_s_max - here.speed_down_m_per_s_max,
        ];
        assert!(
            speeds.iter().all(|by| by.abs() < 1e-3),
            "case {number}: {speeds:?}"
        );
        compared += 1;
    }
    println!(
        "{compared} of {cases} cases compared, {} of {} kinds",
        kinds.len(),
        KINDS.len()
    );
    assert!(compared > 0);
}

//! The fault campaign on the release firmware, compared with the same cases on the PC.
//!
//! Sensor faults are applied at the pins, bit flips in RAM and flash; ticks are delayed or missed
//! by stopping the core. If a case lets the program hang, the reset is triggered at the time that
//! the case states; crash.rs tests the watchdog itself.

use crate::rig::{ENABLING, MS, PORT, Rig, STOP, TICK_NS, volts};
use hil_sim::faults::Case;
use hil_sim::faults::campaign::run_case;
use hil_sim::faults::kind::{Inject, KINDS, Memory};
use hil_sim::faults::outcome::Outcome;
use hil_sim::faults::run::{run, settings, stored};
use hil_sim::faults::unit::{DeviceOutput, Unit};
use model_core::device::{Device, Pins};
use model_core::io::Output;
use model_core::link::Telemetry;
use model_core::signal::{AdcCount, COUNT_MAX, DacCount};
use std::collections::BTreeMap;

/// Count of cases; the environment variable FAULT_CASES overrides it.
const CASES: u64 = 60;
/// The board's readings are means over a tick, half a tick older than those of the PC: in 5 ms a
/// weight that swings at 10 rad/s on its muscle, at up to 0.25 m/s, changes its speed by so much.
const SPEED_M_PER_S: f64 = 0.005 * 10.0 * 0.25;
/// Time from a period's start to its tick, rounded up. The first tick is at this time or later
/// after a reset, as the start takes some milliseconds; later ones follow every 10 ms.
const CONVERTED_NS: u64 = 10_700_000;
/// Time from a tick to the end of its telemetry.
const TELEMETRY_NS: u64 = 3 * MS;
/// Addresses of the two flash sectors of the settings.
const SECTORS: [u32; 2] = [0x0804_0000, 0x0806_0000];
/// Part of the symbol that RTIC generates for the `Device` in RAM.
pub const DEVICE: &str = "rtic_internal_local_resource_device";

/// What happens to a board.
pub type Happening = Box<dyn FnOnce(&mut Rig)>;

/// The board as a unit of the campaign, one tick per call.
pub struct OnBoard {
    /// The board and its PC.
    pub rig: Rig,
    /// Telemetry of the last tick.
    pub telemetry: Vec<Telemetry>,
    /// Time of the next tick, relative to which the constants above apply.
    tick_ns: u64,
    held: bool,
    output: Output,
    /// The valve's voltage after the last tick.
    valve: DacCount,
    /// What happens to the board while it executes the next tick.
    pub in_tick: Option<Happening>,
}

impl OnBoard {
    /// A board with the given content of the settings sectors; erased if none is given.
    pub fn new(stored: Option<[Vec<u8>; 2]>) -> OnBoard {
        let mut rig = Rig::new();
        for (sector, address) in stored.iter().flatten().zip(SECTORS) {
            rig.board.write_flash(address, sector);
        }
        // The start takes some milliseconds, which depend on the board's clock.
        let first_tick_ns = Rig::new().next_tick_ns() - TICK_NS;
        OnBoard {
            rig,
            telemetry: Vec::new(),
            tick_ns: first_tick_ns.saturating_sub(CONVERTED_NS),
            held: false,
            output: Output::default(),
            valve: DacCount::default(),
            in_tick: None,
        }
    }

    fn device(&self) -> u32 {
        let address = self.rig.board.symbol_with(DEVICE);
        address.unwrap_or_else(|| panic!("no {DEVICE} in the ELF"))
    }
}

impl Unit for OnBoard {
    /// Stops the core for the duration of a tick.
    fn skip(&mut self) {
        self.rig.board.hold_core(true);
        self.held = true;
        self.rig
            .board
            .run_until(self.tick_ns + CONVERTED_NS + TELEMETRY_NS);
        self.tick_ns += TICK_NS;
    }

    fn tick(&mut self, pins: &Pins, _: u8, late_s: f64, bytes: &[u8]) -> DeviceOutput {
        self.rig
            .set_analog_since_tick([pins.bridge.0, pins.pressure.0]);
        let board = &mut self.rig.board;
        // A DAC that is wrong: its output is what the case says.
        let is_wrong = pins.read_back != AdcCount(self.valve.get());
        board.load_valve(is_wrong.then(|| volts(pins.read_back.0)));
        board.set_encoder(i64::from(pins.encoder.0 as i32));
        for (contact, open) in STOP.into_iter().zip(pins.stop_open) {
            board.set_level(contact, (!open).then_some(true));
        }
        board.set_level(ENABLING, Some(pins.enabling_closed));
        board.link_send(bytes);
        let late_ns = (1e9 * late_s) as u64;
        if self.held || late_ns > 0 {
            board.hold_core(true);
            // A tick that is still pending from before now runs as this one.
            board.run_until(self.tick_ns + CONVERTED_NS + late_ns);
            board.hold_core(false);
            self.held = false;
        }
        if let Some(happens) = self.in_tick.take() {
            let before_ns = CONVERTED_NS - MS / 2;
            self.rig.board.run_until(self.tick_ns + before_ns);
            self.rig.run_into_tick();
            happens(&mut self.rig);
        }
        // The telemetry of a very late tick is read with the next one, as the next scan begins.
        let telemetry_ns =
            (CONVERTED_NS + late_ns + TELEMETRY_NS).min(TICK_NS + CONVERTED_NS - MS / 2);
        self.rig.board.run_until(self.tick_ns + telemetry_ns);
        self.tick_ns += TICK_NS;
        self.telemetry = self.rig.telemetry();
        if let Some(telemetry) = self.telemetry.last() {
            self.output = telemetry.output;
        }
        let scale = self.rig.board.dac_volts(1) / 3.3;
        self.valve = DacCount::new((scale * f64::from(COUNT_MAX)).round() as u16);
        DeviceOutput {
            valve: self.valve,
            output: self.output,
            port_pulse: self.rig.board.level(PORT) == Some(true),
        }
    }

    fn restart(&mut self) {
        self.rig.board.reset_pin();
        self.tick_ns = self.rig.board.time_ns();
        (self.output, self.valve) = Default::default();
        self.rig.board.load_valve(None);
    }

    /// Flips any bit of the device, also outside the redundant copies.
    fn damage(&mut self, _: Memory, copy: usize, bit: usize) {
        let position = (bit * 7919 + copy * 104_729) % (8 * size_of::<Device>());
        let address = self.device() + (position / 8) as u32;
        let byte = self.rig.board.read_memory(address, 1)[0] ^ 1 << (position % 8);
        self.rig.board.write_ram(address, &[byte]);
    }
}

/// The part of an outcome that must be the same on board and PC.
fn verdict(outcome: &Outcome) -> String {
    format!(
        "{:?} {:?} {:?} {:?}",
        outcome.mode, outcome.reason, outcome.latched_after_s, outcome.violations
    )
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn faults_end_on_the_board_as_they_do_on_the_pc() {
    let cases = std::env::var("FAULT_CASES").map_or(CASES, |n| n.parse().expect("a number"));
    let (mut compared, mut kinds) = (0, BTreeMap::new());
    for number in 0..cases {
        let case = Case::new(2, number);
        let (settings, _) = settings(&case).expect("the reference rig has settings of a board");
        let stored = stored(&case).map(|stored| stored.sectors);
        let mut board = OnBoard::new(stored);
        let on_board = run(&case, &settings, &mut board, |_| {}).expect("it runs");
        *kinds.entry(case.kind.name).or_insert(0) += 1;
        // Damaged memory differs between board and PC: only the bounds are checked.
        if matches!(case.kind.inject, Inject::Damage(..)) {
            let weight = on_board
                .violations
                .iter()
                .find(|bound| !bound.starts_with("reason"));
            assert_eq!(weight, None, "case {number}: {on_board:?}");
            continue;
        }
        assert!(
            on_board.violations.is_empty(),
            "case {number}: {on_board:?}"
        );
        let on_pc = run_case(&case, None, |_| {}).expect("it runs");
        assert_eq!(
            verdict(&on_board),
            verdict(&on_pc),
            "case {number}: {}",
            case.description()
        );
        let speed_differences = [
            on_board.speed_up_m_per_s_max - on_pc.speed_up_m_per_s_max,
            on_board.speed_down_m_per_s_max - on_pc.speed_down_m_per_s_max,
        ];
        assert!(
            speed_differences
                .iter()
                .all(|speed| speed.abs() < SPEED_M_PER_S),
            "case {number}: {speed_differences:?}"
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

//! The paper's experiment with the firmware in the loop: the plant drives the pins, the DAC drives
//! the valve, in lockstep.

#[path = "../../../../hil-sim/tests/board/wander.rs"]
mod wander;

use crate::rig::{MS, Rig, TICK_NS};
use hil_sim::bench::board_settings;
use hil_sim::bench::closed_loop::{Run, run_in_process};
use hil_sim::bench::tracking::tracking;
use hil_sim::rig::Rig as PlantRig;
use model_core::controller::Controller;
use model_core::io::{Output, Sensors};
use model_core::link::Telemetry;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::COUNT_MAX;
use std::collections::BTreeSet;
use wander::wander;

/// The board in place of the controller: each call is one tick.
pub struct BoardInTheLoop {
    /// The board.
    pub rig: Rig,
    /// Time at which the telemetry of the next tick has arrived.
    telemetry_ns: u64,
    /// Highest valve voltage \[V\].
    volts_max: f64,
}

impl BoardInTheLoop {
    /// A board that starts.
    pub fn new() -> BoardInTheLoop {
        let rig = Rig::new();
        // The first tick is a period after the end of init, which depends on the board's clock. The
        // others follow every 10 ms.
        let mut same = Rig::new();
        while same.telemetry().is_empty() {
            same.run_ms(1);
        }
        // With 1 ms one telemetry of a hundred thousand was not there in time, that of tick 99 431
        // in `hundred_thousand_ticks_on_the_board_equal_those_on_the_pc`; it came within the next
        // millisecond. Why was not traced.
        let telemetry_ns = same.board.time_ns() + 2 * MS;
        BoardInTheLoop {
            rig,
            telemetry_ns,
            volts_max: 0.0,
        }
    }

    /// The telemetry of the next tick, with `sensors` at the pins.
    pub fn telemetry(&mut self, sensors: &Sensors) -> Telemetry {
        self.rig.apply(sensors);
        self.rig.board.run_until(self.telemetry_ns);
        self.telemetry_ns += TICK_NS;
        let received = self.rig.telemetry();
        let [telemetry] = &received[..] else {
            panic!("expected one telemetry per tick, received {received:?}")
        };
        *telemetry
    }

    /// One tick of the board, which must have read `sensors`.
    pub fn tick(&mut self, sensors: &Sensors) -> Output {
        let telemetry = self.telemetry(sensors);
        // An MCP4922 has 4096 steps to its full scale, of which the converter reads 4095.
        let read_back = telemetry.sensors.read_back;
        assert!(read_back.0.abs_diff(sensors.read_back.0) <= 1);
        let expected = Sensors {
            read_back,
            ..*sensors
        };
        assert_eq!(telemetry.sensors, expected, "tick {}", telemetry.tick);
        let valve_volts = f64::from(telemetry.output.valve.get()) * 3.3 / f64::from(COUNT_MAX);
        // An MCP4922 has 4096 steps to its full scale, the DAC 4095.
        let off_volts = (self.rig.board.dac_volts(1) - valve_volts).abs();
        assert!(off_volts <= valve_volts / 4096.0 + 1e-9);
        self.volts_max = self.volts_max.max(valve_volts);
        telemetry.output
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn assist_on_the_board_equals_the_controller_on_the_pc_bit_for_bit() {
    let mut board = BoardInTheLoop::new();
    let plant = PlantRig::reference();
    let settings =
        board_settings::from_rig(&plant).expect("the reference rig has settings of a board");
    assert_eq!(
        *settings.values(),
        SettingsValues::reference(),
        "the board runs on its reference settings"
    );
    let mut controller = Controller::new(settings);
    let mut ticks = 0;
    let run = run_in_process(&plant, &settings, &Run::PAPER, |sensors| {
        let (on_pc, on_board) = (controller.tick(sensors), board.tick(sensors));
        assert_eq!(bits(&on_pc), bits(&on_board), "tick {ticks}: {on_pc:?}");
        ticks += 1;
        on_board
    })
    .expect("the reference rig runs");
    let tracking = tracking(&plant, &run, &(1.0..f64::INFINITY)).expect("a weight");
    println!("{tracking:?}, valve up to {:.2} V", board.volts_max);
    assert!(tracking.lift_m_max > 0.03 && board.volts_max > 0.5);
    board.rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn hundred_thousand_ticks_on_the_board_equal_those_on_the_pc() {
    let mut board = BoardInTheLoop::new();
    let settings = Settings::new(SettingsValues::reference()).expect("the reference is valid");
    let mut controller = Controller::new(settings);
    let mut modes = BTreeSet::new();
    let mut before = Output::default();
    for tick in 0..100_000 {
        let sensors = wander(tick, &before);
        let (on_pc, on_board) = (controller.tick(&sensors), board.tick(&sensors));
        before = on_pc;
        assert_eq!(bits(&on_pc), bits(&on_board), "tick {tick}: {sensors:?}");
        modes.insert(format!("{:?} {:?}", on_pc.mode, on_pc.fault));
    }
    // What the requests of `wander` lead to, and its pressure that is out of range.
    let expected = [
        "Assisting None",
        "Holding None",
        "Ready None",
        "SelfCheck None",
        "Venting None",
        "Venting Some(Pressure(Range))",
    ];
    assert!(modes.iter().eq(expected), "{modes:?}");
    board.rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn valve_voltage_changes_within_one_percent_of_the_tick_period() {
    let mut board = BoardInTheLoop::new();
    let first_ns = board.telemetry_ns;
    let mut before = Output::default();
    for tick in 0..1_000 {
        before = board.tick(&wander(tick, &before));
    }
    let events = board.rig.board.dac_events();
    // All changes by ticks have the same phase in the period. Before them the self-test changes the
    // voltage.
    let by_ticks = events.iter().filter(|e| e.time_ns > first_ns);
    let phases: Vec<u64> = by_ticks.map(|e| e.time_ns % TICK_NS).collect();
    let (first, last) = (phases.iter().min(), phases.iter().max());
    let spread_ns = last.zip(first).map(|(last, first)| last - first);
    println!("{} changes, spread {spread_ns:?} ns", phases.len());
    assert!(phases.len() > 100 && spread_ns < Some(100_000));
}

/// An output as text, floating-point numbers as their bits.
pub fn bits(output: &Output) -> String {
    let floats = [
        output.pressure_ref.0,
        output.finger_force_n,
        output.reference_force_n,
        output.contraction,
        output.pressure.0,
    ];
    let rest = (output.valve, output.mode, output.fault);
    format!("{:x?} {rest:?}", floats.map(f32::to_bits))
}

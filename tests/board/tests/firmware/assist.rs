//! The paper's experiment with the firmware in the loop: the plant moves the pins, the DAC moves
//! the valve, in lockstep.

#[path = "../../../../hil-sim/tests/board/wander.rs"]
mod wander;

use crate::rig::{MS, Rig, TICK_NS};
use hil_sim::bench::closed_loop::{self, Experiment};
use hil_sim::rig::Rig as PlantRig;
use model_core::controller::Controller;
use model_core::io::{Output, Sensors};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::COUNT_MAX;
use std::collections::BTreeSet;
use wander::wander;

/// The board in place of the controller: each call is one tick.
struct BoardInTheLoop {
    rig: Rig,
    /// When the next tick is over and told.
    told_ns: u64,
    /// Highest valve voltage \[V\].
    volts_max: f64,
}

impl BoardInTheLoop {
    fn new() -> Option<BoardInTheLoop> {
        let rig = Rig::new()?;
        // the first tick comes with the end of init, the others at a distance of 10 ms
        let told_ns = 5 * MS;
        Some(BoardInTheLoop {
            rig,
            told_ns,
            volts_max: 0.0,
        })
    }

    fn tick(&mut self, sensors: &Sensors) -> Output {
        self.rig.apply(sensors);
        self.rig.board.run_until(self.told_ns);
        self.told_ns += TICK_NS;
        let told = self.rig.telemetry();
        let [telemetry] = &told[..] else {
            panic!("one telemetry a tick, not {told:?}")
        };
        assert_eq!(telemetry.sensors, *sensors, "tick {}", telemetry.tick);
        let valve_volts = f64::from(telemetry.output.valve.get()) * 3.3 / f64::from(COUNT_MAX);
        assert!((self.rig.board.dac_volts(1) - valve_volts).abs() < 1e-9);
        self.volts_max = self.volts_max.max(valve_volts);
        telemetry.output
    }
}

#[test]
fn assist_on_the_board_equals_the_controller_on_the_pc_bit_for_bit() {
    let Some(mut board) = BoardInTheLoop::new() else {
        return;
    };
    let plant = PlantRig::reference();
    let settings = closed_loop::settings(&plant).expect("the reference rig is a board's");
    assert_eq!(
        *settings.values(),
        SettingsValues::reference(),
        "the board runs on its reference settings"
    );
    let mut controller = Controller::new(settings);
    let mut ticks = 0;
    let run = closed_loop::run(&plant, &settings, &Experiment::PAPER, |sensors| {
        let (here, there) = (controller.tick(sensors), board.tick(sensors));
        assert_eq!(bits(&here), bits(&there), "tick {ticks}: {here:?}");
        ticks += 1;
        there
    })
    .expect("the reference rig runs");
    let tracking = closed_loop::tracking(&plant, &run, &(1.0..f64::INFINITY)).expect("a weight");
    println!("{tracking:?}, valve up to {:.2} V", board.volts_max);
    assert!(tracking.lift_m_max > 0.03 && board.volts_max > 0.5);
    board.rig.assert_no_errors();
}

#[test]
fn hundred_thousand_ticks_on_the_board_equal_those_on_the_pc() {
    let Some(mut board) = BoardInTheLoop::new() else {
        return;
    };
    let settings = Settings::new(SettingsValues::reference()).expect("the reference is valid");
    let mut controller = Controller::new(settings);
    let mut modes = BTreeSet::new();
    for tick in 0..100_000 {
        let sensors = wander(tick);
        let (here, there) = (controller.tick(&sensors), board.tick(&sensors));
        assert_eq!(bits(&here), bits(&there), "tick {tick}: {sensors:?}");
        modes.insert(format!("{:?} {:?}", here.mode, here.fault));
    }
    println!("{modes:?}");
    assert!(modes.len() >= 6, "{modes:?}");
    board.rig.assert_no_errors();
}

#[test]
fn valve_changes_within_a_hundredth_of_the_tick() {
    let Some(mut board) = BoardInTheLoop::new() else {
        return;
    };
    for tick in 0..1_000 {
        board.tick(&wander(tick));
    }
    let events = board.rig.board.dac_events();
    // within a period all changes fall together; the first is the DAC's being switched on
    let phases: Vec<u64> = events[1..].iter().map(|e| e.time_ns % TICK_NS).collect();
    let (first, last) = (phases.iter().min(), phases.iter().max());
    let spread_ns = last.zip(first).map(|(last, first)| last - first);
    println!("{} changes, spread {spread_ns:?} ns", phases.len());
    assert!(phases.len() > 100 && spread_ns < Some(100_000));
}

/// All of an output, floating-point numbers as their bits.
fn bits(output: &Output) -> String {
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

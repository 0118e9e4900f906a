//! A bridge with a converter of its own, and what can be wrong with it and its wires. These tests
//! need the image of a board with the feature `ads1220`.

use crate::assist::BoardInTheLoop;
use crate::rig::{BRIDGE, MS, Rig, TICK_NS, volts};
use crate::timing::{HandlerRun, runs, ticks};
use emulated_board::ConverterFaults;
use hil_sim::bench::board_settings;
use hil_sim::bench::closed_loop::{Run, run_in_process};
use hil_sim::bench::tick::TICK_S;
use hil_sim::rig::Rig as PlantRig;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::plausibility::Doubt;
use model_core::supervisor::{Fault, Mode};

/// Exception number of the scan: the interrupt of TIM2.
const SCAN_EXCEPTION: usize = 16 + 28;
/// Switches interrupts 0 to 31 off.
const NVIC_ICER0: u32 = 0xe000_e180;
/// Switches SPI3 on.
const SPI3_CR1: u32 = 0x4000_3c00;
/// From a scan's begin to the tick, the duration of the chip's own conversions \[ns\].
const SCAN_NS: u64 = 29_000;

/// A converter of which one thing is wrong.
fn with(change: impl Fn(&mut ConverterFaults)) -> ConverterFaults {
    let mut faults = ConverterFaults::default();
    change(&mut faults);
    faults
}

/// What can be wrong, and is noticed at once: within the ticks that a reading may be suspect.
fn noticed() -> [(&'static str, ConverterFaults); 13] {
    [
        ("hangs", with(|f| f.hangs = true)),
        ("no supply", with(|f| f.powered = false)),
        ("bridge without its supply", with(|f| f.bridge_volts = 0.0)),
        ("SCLK broken", with(|f| f.wired[0] = false)),
        ("DIN broken", with(|f| f.wired[1] = false)),
        ("CS broken", with(|f| f.wired[2] = false)),
        // Read as codes, these are -1 and 0: no force.
        ("DOUT stuck high", with(|f| f.data_out = Some(true))),
        ("DOUT stuck low", with(|f| f.data_out = Some(false))),
        ("DRDY stuck high", with(|f| f.ready = Some(true))),
        ("DRDY stuck low", with(|f| f.ready = Some(false))),
        (
            "a wire of the bridge open, one way",
            with(|f| f.clipped = Some(true)),
        ),
        (
            "a wire of the bridge open, the other",
            with(|f| f.clipped = Some(false)),
        ),
        (
            "hangs and DRDY stuck low",
            with(|f| (f.hangs, f.ready) = (true, Some(false))),
        ),
    ]
}

fn assist(rig: &mut Rig) {
    for request in [Request::Reset, Request::Assist] {
        rig.send(&ToDevice::Command(Command::Request(request)));
        rig.run_ms(300);
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn fault_in_a_lift_lets_the_weight_down() {
    let plant = PlantRig::reference();
    let settings =
        board_settings::from_rig(&plant).expect("the reference rig has settings of a board");
    for (what, faults) in noticed() {
        let mut board = BoardInTheLoop::new();
        let (mut good_after, mut latched_after) = (None, None);
        let ticks = run_in_process(&plant, &settings, &Run::PAPER, |sensors| {
            let telemetry = board.telemetry(sensors);
            let output = telemetry.output;
            match (&mut good_after, output.fault) {
                (None, None) if output.contraction > 0.1 => {
                    good_after = Some(telemetry.tick);
                    board.rig.board.set_bridge_converter(faults);
                }
                (Some(tick), Some(fault)) if latched_after.is_none() => {
                    latched_after = Some((telemetry.tick - *tick, fault, output.mode));
                }
                _ => {}
            }
            output
        })
        .expect("the reference rig runs");
        let (after, fault, mode) = latched_after.expect(what);
        assert_eq!(
            (fault, mode),
            (Fault::Bridge(Doubt::Range), Mode::Venting),
            "{what}"
        );
        // The third suspect reading latches. Half of the first tick's conversions may be good.
        assert!(after <= 4, "{what}: after {after} ticks");
        let length_m = f64::from(settings.values().muscle.initial_length_m);
        let speeds_m_per_s = ticks
            .windows(2)
            .map(|pair| (pair[1].contraction - pair[0].contraction).abs() * length_m / TICK_S);
        let fastest_m_per_s = speeds_m_per_s.fold(0.0, f64::max);
        let end = ticks.last().expect("ticks");
        println!("{what}: after {after} ticks, at most {fastest_m_per_s:.2} m/s");
        // The bound for motions that the controller determines.
        assert!(fastest_m_per_s < 0.67, "{what}: {fastest_m_per_s} m/s");
        assert!(end.contraction < f64::from(settings.values().contraction_trip));
        assert_eq!(board.rig.board.resets(), [], "{what}");
        board.rig.assert_no_errors();
    }
}

/// Without a reset of the board: the converter is set up again as soon as it answers.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn converter_that_comes_back_is_set_up_again() {
    for (what, faults) in noticed() {
        let mut rig = Rig::after_ms(1_000);
        assist(&mut rig);
        assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
        rig.board.set_bridge_converter(faults);
        // The ramp down, and the self-check after the request below.
        rig.run_ms(3_000);
        let output = rig.last_telemetry().output;
        assert_eq!(output.fault, Some(Fault::Bridge(Doubt::Range)), "{what}");
        rig.board.set_bridge_converter(ConverterFaults::default());
        rig.run_ms(50);
        rig.send(&ToDevice::Command(Command::Request(Request::Reset)));
        rig.run_ms(1_500);
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(100);
        let output = rig.last_telemetry().output;
        assert_eq!(
            (output.mode, output.fault),
            (Mode::Assisting, None),
            "{what}"
        );
        rig.assert_no_errors();
    }
}

/// It loses its registers, which costs a reading or two: the controller holds for as long.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn short_loss_of_the_converters_supply_is_bridged() {
    for phase_ms in 0..10 {
        let mut rig = Rig::after_ms(1_000);
        assist(&mut rig);
        rig.run_ms(phase_ms);
        rig.telemetry();
        rig.board.set_bridge_converter(with(|f| f.powered = false));
        rig.board.run_for(MS);
        rig.board.set_bridge_converter(ConverterFaults::default());
        rig.run_ms(200);
        let telemetry = rig.telemetry();
        let lost = telemetry.iter().filter(|t| t.sensors.bridge.0 == 0).count();
        println!("after {phase_ms} ms: {lost} readings lost");
        assert!(lost <= 2, "{lost}");
        let end = telemetry.last().expect("telemetry").output;
        assert_eq!((end.mode, end.fault), (Mode::Assisting, None));
    }
}

/// Registers and signals are right, and every conversion is the same. The bridge's noise is what
/// tells it from a bridge at rest.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn frozen_converter_is_a_fault_and_a_quiet_bridge_is_none() {
    let mut rig = Rig::after_ms(1_000);
    assist(&mut rig);
    rig.board.set_bridge_converter(with(|f| f.frozen = true));
    rig.run_ms(700);
    let output = rig.last_telemetry().output;
    assert_eq!(output.fault, Some(Fault::Bridge(Doubt::Stuck)));

    // 0.3 µV of 5 V, a tenth of a count: the mean over a tick would stand still.
    let mut rig = Rig::after_ms(1_000);
    assist(&mut rig);
    let quiet = with(|f| f.noise_codes = 100.0);
    rig.board.set_bridge_converter(quiet);
    rig.telemetry();
    let mut readings = vec![];
    for _ in 0..4_000 {
        // Only the pressure sensor has noise of its own.
        rig.dither();
        rig.board.set_analog(BRIDGE, volts(2048));
        rig.board.run_for(5 * MS);
        readings.extend(rig.telemetry());
    }
    let fault = readings.iter().find_map(|t| t.output.fault);
    assert_eq!(fault, None);
    let mean = readings
        .iter()
        .map(|t| f64::from(t.sensors.bridge.0))
        .sum::<f64>()
        / readings.len() as f64;
    // The deviation of one is 2/√12 counts, and of the rounding 1/√12; 2000 readings, four standard
    // errors, and half a step of the 256 that are added.
    let error = 4.0 * (5.0_f64 / 12.0 / readings.len() as f64).sqrt() + 1.0 / 256.0;
    // The voltage is that of the middle of the count.
    assert!((mean - 2048.0).abs() < error + 8.0 / 1024.0, "{mean}");
}

/// The tick follows the last scan, and is not delayed by it.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn scan_of_the_bridge_ends_before_the_tick() {
    let mut rig = Rig::after_ms(100);
    rig.board.trace_exceptions(true);
    rig.run_ms(1_000);
    let events = rig.board.exceptions();
    let durations_ns: Vec<u64> = runs(&events, SCAN_EXCEPTION)
        .iter()
        .map(|scan| scan.duration_ns)
        .collect();
    let longest_ns = durations_ns.iter().max().expect("scans");
    let share = durations_ns.iter().sum::<u64>() as f64 / 1e9;
    let ticks = ticks(&events);
    println!(
        "scan at most {:.1} µs, {:.2} % of the time; {} ticks",
        *longest_ns as f64 / 1e3,
        100.0 * share,
        ticks.len()
    );
    assert!((1_590..=1_610).contains(&durations_ns.len()));
    assert!(*longest_ns < SCAN_NS);
    let grid = |pair: &[HandlerRun]| pair[1].time_ns - pair[0].time_ns;
    assert!(
        ticks
            .windows(2)
            .all(|pair| grid(pair).abs_diff(TICK_NS) < 100)
    );
    rig.assert_no_errors();
}

/// Late ticks, also all of them, read the conversions that were made; one that is nearly a whole
/// period late has too few, and the controller holds.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn late_tick_reads_the_conversions_that_there_are() {
    for (late_ns, lost_max) in [(MS, 0), (4 * MS, 0), (9 * MS, 2)] {
        let mut rig = Rig::after_ms(1_000);
        assist(&mut rig);
        let due_ns = rig.next_tick_ns();
        rig.telemetry();
        for tick in 0..10 {
            if tick == 0 || lost_max == 0 {
                rig.board.run_until(due_ns + tick * TICK_NS - MS / 100);
                rig.board.hold_core(true);
                rig.board.run_until(due_ns + tick * TICK_NS + late_ns);
                rig.board.hold_core(false);
            }
        }
        rig.run_ms(100);
        let telemetry = rig.telemetry();
        let lost = telemetry.iter().filter(|t| t.sensors.bridge.0 == 0).count();
        assert!(lost <= lost_max, "{late_ns} ns late: {lost}");
        let fault = telemetry.iter().find_map(|t| t.output.fault);
        assert_eq!(fault, None, "{late_ns} ns late");
    }
}

/// The interrupt of the scans is switched off. What is left of the last ones is not read again.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn scans_that_stop_are_a_fault_of_the_bridge() {
    let mut rig = Rig::after_ms(1_000);
    assist(&mut rig);
    rig.board.write_register(NVIC_ICER0, 1 << 28);
    rig.run_ms(60);
    let output = rig.last_telemetry().output;
    assert_eq!(output.fault, Some(Fault::Bridge(Doubt::Range)));
    assert_eq!(rig.board.resets(), []);
}

/// SPI3 is switched off, as an interference may do. No tick waits for it.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn bus_that_is_switched_off_is_a_fault_of_the_bridge() {
    let mut rig = Rig::after_ms(1_000);
    assist(&mut rig);
    rig.telemetry();
    rig.board.write_register(SPI3_CR1, 0);
    rig.run_ms(500);
    let telemetry = rig.telemetry();
    let output = telemetry.last().expect("telemetry").output;
    assert_eq!(output.fault, Some(Fault::Bridge(Doubt::Range)));
    assert!(telemetry.iter().all(|t| t.timing.missed_ticks == 0));
    assert_eq!(rig.board.resets(), []);
}

/// The valve's converter has another bus.
#[test]
#[ignore = "needs FIRMWARE, the ELF of a firmware with the feature ads1220"]
fn board_without_its_converter_starts_and_does_not_assist() {
    let mut rig = Rig::new();
    rig.board.set_bridge_converter(with(|f| f.powered = false));
    rig.run_ms(1_500);
    let identity = rig.identity();
    assert_eq!(identity.start, None);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(100);
    let output = rig.last_telemetry().output;
    assert_eq!(output.fault, Some(Fault::Bridge(Doubt::Range)));
    assert_eq!((output.mode, rig.board.dac_volts(1)), (Mode::Venting, 0.0));
    rig.assert_no_errors();
}

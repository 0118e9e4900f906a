//! Units of the chip that stop, or write where nobody reads: streams of the DMA, the converter,
//! timers. A register that an interference changes does this to a real chip.

use crate::assist::BoardInTheLoop;
use crate::rig::{MS, Rig, TICK_EXCEPTION};
use emulated_board::ResetCause as Cause;
use hil_sim::bench::board_settings;
use hil_sim::bench::closed_loop::{Run, run_in_process};
use hil_sim::bench::tick::TICK_S;
use hil_sim::rig::Rig as PlantRig;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::{ResetCause, ToDevice};
use model_core::plausibility::Doubt;
use model_core::supervisor::{Fault, Mode};

/// DMA2 stream 0, which stores the conversions: clears its flags, its configuration, its address.
const DMA2_LIFCR: u32 = 0x4002_6408;
const STREAM_CR: u32 = 0x4002_6410;
const STREAM_M0AR: u32 = 0x4002_641c;
const ENABLED: u32 = 1;
const MEMORY_INCREMENT: u32 = 1 << 10;
/// Switches the converter on.
const ADC_CR2: u32 = 0x4001_2008;
/// USART2: requests to the DMA for bytes to send.
const USART2_CR3: u32 = 0x4000_4414;
/// TIM2 starts the conversions, TIM3 the link's task, TIM5 counts the encoder.
const TIM2_CR1: u32 = 0x4000_0000;
const TIM3_CR1: u32 = 0x4000_0400;
const TIM5_CR1: u32 = 0x4000_0c00;
/// RAM that the firmware does not use, and no memory.
const ELSEWHERE: u32 = 0x2001_0000;
const NOWHERE: u32 = 0x6000_0000;

fn assisting() -> Rig {
    let mut rig = Rig::after_ms(1_000);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(300);
    assert!(rig.board.dac_volts(1) > 0.1);
    rig
}

/// Stops the stream of the conversions, and starts it with another configuration and address.
fn restart_stream(rig: &mut Rig, cr: impl Fn(u32) -> u32, address: u32) {
    let board = &mut rig.board;
    let before = board.read_register(STREAM_CR);
    board.write_register(STREAM_CR, before & !ENABLED);
    board.write_register(DMA2_LIFCR, 0x3d);
    board.write_register(STREAM_M0AR, address);
    board.write_register(STREAM_CR, cr(before));
}

/// Without conversions there are no ticks: the watchdog brings the valve to 0 V, and the next start
/// tells so.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn conversions_that_stop_end_in_a_reset_with_its_reason() {
    type Stop = (&'static str, fn(&mut Rig));
    let stops: [Stop; 4] = [
        ("the stream stops", |rig| {
            rig.board.write_register(STREAM_CR, 0);
        }),
        ("the stream's address is no memory", |rig| {
            restart_stream(rig, |cr| cr, NOWHERE);
        }),
        ("the converter is off", |rig| {
            rig.board.write_register(ADC_CR2, 0);
        }),
        ("the timer stops", |rig| {
            rig.board.write_register(TIM2_CR1, 0);
        }),
    ];
    for (what, stop) in stops {
        let mut rig = assisting();
        let stopped_ns = rig.board.time_ns();
        stop(&mut rig);
        while rig.board.resets().is_empty() {
            rig.board.run_for(MS / 10);
            // At the watchdog's nominal 50 ms, from the last tick.
            assert!(rig.board.time_ns() < stopped_ns + 61 * MS, "{what}");
        }
        assert_eq!(rig.board.resets()[0].cause, Cause::Watchdog, "{what}");
        assert_eq!(rig.board.dac_volts(1), 0.0, "{what}");
        rig.run_ms(50);
        let identity = rig.identity();
        let reason = (identity.reset, identity.crash);
        assert_eq!(reason, (ResetCause::Watchdog, None), "{what}");
        rig.run_ms(1_000);
        assert_eq!(rig.last_telemetry().output.mode, Mode::Ready, "{what}");
    }
}

/// Ticks go on with what is left in the buffer. It is not used: the fault is that of a bridge out
/// of its range, after three ticks, and the weight is let down.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn conversions_that_go_elsewhere_are_not_read_again() {
    type Divert = (&'static str, fn(&mut Rig, u32));
    let diversions: [Divert; 2] = [
        ("another address", |rig, _| {
            restart_stream(rig, |cr| cr, ELSEWHERE);
        }),
        ("one address for all", |rig, buffer| {
            restart_stream(rig, |cr| cr & !MEMORY_INCREMENT, buffer);
        }),
    ];
    for (what, divert) in diversions {
        let mut rig = assisting();
        let buffer = rig.board.read_register(STREAM_M0AR);
        rig.telemetry();
        divert(&mut rig, buffer);
        rig.run_ms(60);
        let telemetry = rig.telemetry();
        let latched = telemetry.iter().find(|t| t.output.fault.is_some());
        let latched = latched.expect(what);
        assert_eq!(latched.output.fault, Some(Fault::Bridge(Doubt::Range)));
        assert_eq!(latched.output.mode, Mode::Venting, "{what}");
        let readings = (latched.sensors.bridge.0, latched.sensors.pressure.0);
        assert_eq!(readings, (0, 0), "{what}");
        // The ramp takes 2.5 s from 500 kPa; at rest less is in the muscle.
        rig.run_ms(2_500);
        assert_eq!(rig.board.dac_volts(1), 0.0, "{what}");
        assert_eq!(rig.board.resets(), [], "{what}");
    }
}

/// A late tick reads the conversions of its period, and leaves those of the next alone.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn late_tick_does_not_make_conversions_old() {
    for late_ns in [MS / 2, 3 * MS, 9 * MS] {
        let mut rig = assisting();
        let due_ns = rig.next_tick_ns();
        rig.telemetry();
        rig.board.run_until(due_ns - MS / 100);
        rig.board.hold_core(true);
        rig.board.run_until(due_ns + late_ns);
        rig.board.hold_core(false);
        rig.run_ms(100);
        let telemetry = rig.telemetry();
        assert!(telemetry.len() >= 9, "{late_ns} ns late");
        for tick in telemetry {
            assert_eq!(tick.output.fault, None, "{late_ns} ns late");
            assert!(tick.sensors.bridge.0 > 2_000 && tick.sensors.pressure.0 > 400);
        }
    }
}

/// Neither the stream that sends nor the timer of the link's task holds the ticks up.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn link_that_stops_does_not_stop_the_ticks() {
    for register in [USART2_CR3, TIM3_CR1] {
        let mut rig = assisting();
        rig.board.write_register(register, 0);
        rig.run_ms(20);
        rig.telemetry();
        rig.board.exceptions();
        rig.board.trace_exceptions(true);
        rig.run_ms(500);
        assert_eq!(rig.telemetry(), [], "the link has stopped");
        let events = rig.board.exceptions();
        let ticks = events
            .iter()
            .filter(|e| e.entered && e.exception == TICK_EXCEPTION);
        assert_eq!(ticks.count(), 50, "{register:#x}");
        assert_eq!(rig.board.resets(), []);
    }
}

/// In the middle of a lift the counter of the encoder stops. That is «encoder frozen» of
/// docs/safety.md: within the tolerance of the force balance no reason is latched, and the weight
/// keeps its bounds.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn counter_of_the_encoder_that_stops_in_a_lift_leaves_the_weight_within_its_bounds() {
    let mut board = BoardInTheLoop::new();
    let plant = PlantRig::reference();
    let settings =
        board_settings::from_rig(&plant).expect("the reference rig has settings of a board");
    let mut stopped = false;
    let ticks = run_in_process(&plant, &settings, &Run::PAPER, |sensors| {
        let output = board.telemetry(sensors).output;
        if !stopped && output.contraction > 0.1 {
            stopped = true;
            board.rig.board.write_register(TIM5_CR1, 0);
        }
        output
    })
    .expect("the reference rig runs");
    let values = settings.values();
    let length_m = f64::from(values.muscle.initial_length_m);
    let speeds_m_per_s = ticks
        .windows(2)
        .map(|pair| (pair[1].contraction - pair[0].contraction).abs() * length_m / TICK_S);
    let fastest_m_per_s = speeds_m_per_s.fold(0.0, f64::max);
    let end = ticks.last().expect("ticks");
    println!(
        "at most {fastest_m_per_s:.2} m/s, {:.3} at the end, read {:.3}",
        end.contraction, end.output.contraction
    );
    assert!(stopped && end.contraction > f64::from(end.output.contraction) + 0.02);
    // The bound for motions that the controller determines.
    assert!(fastest_m_per_s < 0.67);
    assert!(end.contraction < f64::from(values.contraction_trip));
}

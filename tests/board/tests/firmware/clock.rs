//! The clock: what can fail about it, and what its tolerance does.

use crate::assist::{BoardInTheLoop, bits};
use crate::rig::{MS, Rig};
use crate::timing::ticks;
use emulated_board::{Oscillators, ResetCause as Cause};
use hil_sim::bench::board_settings;
use hil_sim::bench::closed_loop::{Run, run_in_process};
use hil_sim::bench::tracking::tracking;
use hil_sim::rig::Rig as PlantRig;
use model_core::controller::Controller;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::{ResetCause, ToDevice};
use model_core::supervisor::Mode;

fn without_hse() -> Oscillators {
    Oscillators {
        hse_runs: false,
        ..Oscillators::default()
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn board_without_the_clock_of_the_st_link_becomes_ready() {
    let mut rig = Rig::new();
    rig.board.set_oscillators(without_hse());
    rig.run_ms(1_500);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    assert_eq!(rig.board.resets(), []);
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn losing_the_clock_of_the_st_link_in_a_lift_changes_nothing() {
    let mut board = BoardInTheLoop::new();
    let plant = PlantRig::reference();
    let settings =
        board_settings::from_rig(&plant).expect("the reference rig has settings of a board");
    let mut controller = Controller::new(settings);
    let mut ticks = 0;
    let mut contraction_at_loss = 0.0;
    let run = run_in_process(&plant, &settings, &Run::PAPER, |sensors| {
        let (on_pc, on_board) = (controller.tick(sensors), board.tick(sensors));
        assert_eq!(bits(&on_pc), bits(&on_board), "tick {ticks}");
        if contraction_at_loss == 0.0 && on_board.contraction > 0.1 {
            contraction_at_loss = on_board.contraction;
            board.rig.board.set_oscillators(without_hse());
        }
        ticks += 1;
        on_board
    })
    .expect("the reference rig runs");
    assert!(contraction_at_loss > 0.0);
    let tracking = tracking(&plant, &run, &(1.0..f64::INFINITY)).expect("a weight");
    assert!(tracking.lift_m_max > 0.03);
    board.rig.assert_no_errors();
}

/// Without a system clock only the watchdog, which has its own oscillator, is left.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn oscillator_that_stops_ends_in_a_reset_with_its_reason() {
    let mut rig = Rig::after_ms(1_000);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(300);
    assert!(rig.board.dac_volts(1) > 0.1);
    let stopped_ns = rig.board.time_ns();
    rig.board.set_oscillators(Oscillators {
        hsi_runs: false,
        ..Oscillators::default()
    });
    rig.board.run_for(200 * MS);
    let [reset] = rig.board.resets() else {
        panic!("{:?}", rig.board.resets());
    };
    assert_eq!(reset.cause, Cause::Watchdog);
    // 50 ms and one count, from the last tick.
    let after_ns = reset.time_ns - stopped_ns;
    assert!((40 * MS..52 * MS).contains(&after_ns), "{after_ns} ns");
    assert_eq!(rig.board.dac_volts(1), 0.0);
    rig.board.set_oscillators(Oscillators::default());
    rig.run_ms(50);
    assert_eq!(rig.identity().reset, ResetCause::Watchdog);
}

/// A board whose oscillator has this frequency, the mean period of its ticks \[ns\], and whether it
/// answered.
fn with_hsi(hsi_hz: u64) -> (Rig, f64, bool) {
    let mut rig = Rig::new();
    rig.board.set_oscillators(Oscillators {
        hsi_hz,
        ..Oscillators::default()
    });
    rig.run_ms(1_500);
    rig.board.trace_exceptions(true);
    rig.run_ms(1_000);
    let ticks = ticks(&rig.board.exceptions());
    let span_ns = ticks.last().map_or(0, |tick| tick.time_ns) - ticks[0].time_ns;
    rig.messages();
    rig.send(&ToDevice::Identify);
    rig.run_ms(50);
    let answered = !rig.messages().is_empty();
    assert_eq!(rig.board.resets(), []);
    let period_ns = span_ns as f64 / (ticks.len() - 1) as f64;
    (rig, period_ns, answered)
}

/// The guaranteed 1 % at 25 °C, and nearly all of the 3.33 % that both ends of the link tolerate.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn tick_and_link_bear_the_tolerance_of_the_oscillator() {
    // 50.4 GHz is a multiple of each board's CPU clock for these, as the emulated board needs.
    for period_units in [3060, 3114, 3150, 3186, 3240] {
        let hsi_hz = 50_400_000_000 / period_units;
        let (rig, period_ns, answered) = with_hsi(hsi_hz);
        let relative = hsi_hz as f64 / 16e6;
        println!(
            "HSI {:+.2} %: tick {period_ns:.0} ns",
            100.0 * (relative - 1.0)
        );
        assert!((period_ns * relative / 1e7 - 1.0).abs() < 1e-3);
        let rejected = rig.rejected;
        assert!(answered && rejected == 0, "{hsi_hz} Hz: {rejected} frames");
        rig.assert_no_errors();
    }
}

/// Beyond that the link is lost, the ticks are not, and every clock is within its limits.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn ticks_go_on_where_the_link_no_longer_bears_the_oscillator() {
    for period_units in [3024, 3276] {
        let (rig, period_ns, answered) = with_hsi(50_400_000_000 / period_units);
        assert!((9.5e6..10.5e6).contains(&period_ns), "{period_ns} ns");
        assert!(!answered);
        let errors = rig.board.errors();
        let of_the_link = errors.iter().all(|e| e.text.starts_with("USART2: "));
        assert!(of_the_link, "{}", rig.board.error_report());
    }
}

//! Mains at the strain bridge, and why the controller does not take its mean over two ticks.

use hil_sim::bench::board_settings;
use hil_sim::bench::closed_loop::{Run, run_in_process};
use hil_sim::bench::tick::Tick;
use hil_sim::paper::papers_controller;
use hil_sim::rig::Rig;
use model_core::controller::{Control, Controller};
use model_core::settings::Settings;
use model_core::signal::AdcCount;
use model_core::supervisor::Fault;
use std::f64::consts::{PI, TAU};

/// The paper's lift with an input lever of this stiffness \[N/m\]; the bridge's readings are means
/// over so many ticks and contain so much \[N\] of an interference at this frequency \[Hz\].
fn lift<C: Control>(
    controller: fn(Settings) -> C,
    stiffness_n_per_m: f64,
    ticks: usize,
    (mains_n, mains_hz): (f64, f64),
) -> Vec<Tick> {
    let mut rig = Rig::reference();
    let assist = rig.assist.as_mut().expect("a lever");
    assist.input_stiffness_n_per_m = stiffness_n_per_m;
    let settings = board_settings::from_rig(&rig).expect("settings of a board");
    let per_count_n = f64::from(settings.values().bridge.per_count);
    let span_s = 0.01 * ticks as f64;
    let x = PI * mains_hz * span_s;
    let left_n = mains_n * if x == 0.0 { 1.0 } else { x.sin() / x };
    let mut controller = controller(settings);
    // The plant is read at the ticks: between them its force is interpolated.
    let (mut last, mut rest, mut time_s) = (Vec::new(), 0.0, 0.0);
    run_in_process(&rig, &settings, &Run::PAPER, |sensors| {
        let now = f64::from(sensors.bridge.0);
        last.resize(ticks + 1, now);
        last.rotate_right(1);
        last[0] = now;
        let ends = 0.5 * (last[0] + last[ticks]);
        let mean = (ends + last[1..ticks].iter().sum::<f64>()) / ticks as f64;
        let phase = TAU * mains_hz * (time_s - 0.5 * span_s) + 0.9;
        let count = mean + left_n * phase.sin() / per_count_n + rest;
        rest = count - count.round();
        time_s += 0.01;
        let mut sensors = *sensors;
        sensors.bridge = AdcCount(count.round() as u16);
        controller.tick(&sensors)
    })
    .expect("the reference rig runs")
}

fn fault(ticks: &[Tick]) -> Option<Fault> {
    ticks.iter().find_map(|tick| tick.output.fault)
}

/// 1 N of it, a 25th of the bridge's scale.
#[test]
fn mains_at_the_bridge_does_not_move_the_weight() {
    for mains_hz in [50.0, 49.9, 60.0, 59.9] {
        let ticks = lift(Controller::new, 200.0, 1, (1.0, mains_hz));
        assert_eq!(fault(&ticks), None);
        let held = ticks[ticks.len() - 150..].iter();
        let travel_m = held.map(|tick| 0.3 * tick.contraction);
        let highest_m = travel_m.clone().fold(f64::MIN, f64::max);
        let moved_mm = 1e3 * (highest_m - travel_m.fold(f64::MAX, f64::min));
        println!("{mains_hz} Hz: {moved_mm:.3} mm");
        assert!(moved_mm < 0.06, "{mains_hz} Hz: {moved_mm} mm");
    }
}

/// Half a tick more delay in the finger's force takes this much of what the lever may stiffen,
/// without the limit of energy, which ends the oscillation before it is too fast.
#[test]
fn a_mean_over_two_ticks_costs_gain_margin() {
    for (stiffness_n_per_m, ticks, expected) in [
        (380.0, 1, None),
        (400.0, 1, Some(Fault::OverSpeed)),
        (320.0, 2, None),
        (340.0, 2, Some(Fault::OverSpeed)),
    ] {
        let found = fault(&lift(
            papers_controller,
            stiffness_n_per_m,
            ticks,
            (0.0, 50.0),
        ));
        assert_eq!(found, expected, "{stiffness_n_per_m} N/m, {ticks} ticks");
    }
}

//! The controller over its whole input range, and through each of its modes.

use model_core::compensation::Compensation;
use model_core::consistency::ForceBalance;
use model_core::controller::{Control as _, Controller};
use model_core::device::{Command, Device, Pins};
use model_core::error::SettingsError;
use model_core::io::{Output, Request, Sensors};
use model_core::limits::{LIMITS, PLAY_SILENCE_TICKS};
use model_core::plausibility::Doubt;
use model_core::pressure::GaugePa;
use model_core::settings::{ENCODED_LEN_MAX, Settings, SettingsValues};
use model_core::signal::{AdcCount, DacCount, EncoderCount};
use model_core::supervisor::{Fault, Mode};
use model_core::timing::Timing;
use proptest::prelude::*;

fn reference() -> Settings {
    Settings::new(SettingsValues::reference()).expect("the reference is valid")
}

/// A bench that produces counts of given quantities, with a flicker of one count as from noise.
struct Bench {
    controller: Controller,
    home: u32,
    ticks: u32,
    finger_n: f32,
    pressure_pa: f32,
    contraction: f32,
    request: Request,
}

impl Bench {
    fn new() -> Bench {
        Bench {
            controller: Controller::new(reference()),
            home: u32::MAX - 100,
            ticks: 0,
            finger_n: 0.5,
            pressure_pa: 0.0,
            contraction: 0.0,
            request: Request::None,
        }
    }

    fn sensors(&self) -> Sensors {
        let values = *self.controller.settings();
        let flicker = (self.ticks % 2) as u16;
        let moved = self.contraction * values.muscle.initial_length_m / values.encoder_m_per_count;
        Sensors {
            bridge: AdcCount(values.bridge.count(self.finger_n).0 + flicker),
            pressure: AdcCount(values.pressure_sensor.count(self.pressure_pa).0 + flicker),
            encoder: EncoderCount(self.home.wrapping_add_signed(moved.round() as i32)),
            read_back: AdcCount(self.controller.state().valve.get()),
            missed_ticks: 0,
            request: self.request,
        }
    }

    fn tick(&mut self) -> Output {
        let sensors = self.sensors();
        self.tick_with(&sensors)
    }

    fn tick_with(&mut self, sensors: &Sensors) -> Output {
        self.ticks += 1;
        self.controller.tick(sensors)
    }

    /// A tick of a muscle that follows its reference at once, in balance with its weight.
    fn tick_in_balance(&mut self) -> Output {
        self.tick_with_valve(1.0)
    }

    /// The same with a valve that reaches `share` of the way to its reference in a tick.
    fn tick_with_valve(&mut self, share: f32) -> Output {
        let output = self.tick();
        self.pressure_pa += share * (output.pressure_ref.0 - self.pressure_pa);
        let square = ((117.7 + 183.0) / self.pressure_pa + 1.39e-3) / 3.7718e-3;
        let mut shortened = 1.0 - self.contraction;
        // Newton's square root, from the tick before: no_std has none.
        for _ in 0..5 {
            shortened = 0.5 * (shortened + square / shortened);
        }
        self.contraction = (1.0 - shortened).max(0.0);
        output
    }

    /// Ticks until `done`, at most `ticks` times.
    fn until(&mut self, ticks: u32, mut done: impl FnMut(&Output) -> bool) -> Output {
        for _ in 0..ticks {
            let output = self.tick();
            // The muscle follows its reference, as with a fast valve.
            self.pressure_pa = output.pressure_ref.0;
            if done(&output) {
                return output;
            }
        }
        panic!("not within {ticks} ticks: {:?}", self.controller.state());
    }

    fn assisting() -> Bench {
        let mut bench = Bench::new();
        bench.until(60, |output| output.mode == Mode::Ready);
        bench.request = Request::Assist;
        bench.finger_n = 2.5;
        let engaged = |output: &Output| output.pressure_ref.0 > 9e4;
        bench.until(100, engaged);
        bench.request = Request::None;
        bench
    }
}

#[test]
fn self_check_takes_the_zeros_and_assisting_begins_at_the_measured_pressure() {
    let mut bench = Bench::new();
    let ready = bench.until(51, |output| output.mode == Mode::Ready);
    assert_eq!(ready.contraction, 0.0);
    // The tare is the lever's 0.5 N; one count is 0.0122 N.
    assert!(ready.finger_force_n.abs() < 0.0123);
    bench.request = Request::Assist;
    let mut last_pa = 0.0;
    for _ in 0..100 {
        let output = bench.tick();
        // The reference begins at the measured pressure, within two counts (427 Pa) of zero.
        assert!(
            output.pressure_ref.0 - last_pa <= 2.5e5 * 0.01 + 427.0,
            "gently"
        );
        last_pa = output.pressure_ref.0;
    }
    // No finger, no force: Eq 8 at F_c = 0 is γ/(α + β) = 76.8 kPa; a count of force is 0.1 kPa.
    assert!((last_pa - 76_832.0).abs() < 250.0, "{last_pa}");
}

/// Settings that allow an experiment up to 400 kPa.
fn values_with_experiment() -> SettingsValues {
    SettingsValues {
        play_pressure_pa_max: 4e5,
        ..SettingsValues::reference()
    }
}

/// A bench that is ready, with these settings.
fn ready(values: SettingsValues) -> Bench {
    let mut bench = Bench::new();
    bench.controller = Controller::new(Settings::new(values).expect("valid settings"));
    bench.until(60, |output| output.mode == Mode::Ready);
    bench
}

/// A bench in an experiment at 100 kPa, where the weight rests on its stop.
fn playing() -> Bench {
    let mut bench = ready(values_with_experiment());
    bench.request = Request::Play(100_000);
    bench.until(60, |output| output.pressure_ref.0 == 1e5);
    bench
}

#[test]
fn an_experiment_is_refused_unless_the_settings_allow_it_and_the_check_has_passed() {
    let mut bench = ready(SettingsValues::reference());
    bench.request = Request::Play(100_000);
    for _ in 0..200 {
        let output = bench.tick();
        assert_eq!((output.mode, output.valve.get()), (Mode::Ready, 0));
    }
    let mut bench = Bench::new();
    bench.controller =
        Controller::new(Settings::new(values_with_experiment()).expect("valid settings"));
    bench.request = Request::Play(100_000);
    let modes: Vec<Mode> = (0..52).map(|_| bench.tick().mode).collect();
    assert!(modes[..50].iter().all(|mode| *mode == Mode::SelfCheck));
    assert_eq!(modes[51], Mode::Playing);
    let mut assisting = Bench::assisting();
    assisting.request = Request::Play(400_000);
    assert_eq!(assisting.tick().mode, Mode::Assisting);
}

#[test]
fn an_experiment_stays_within_its_pressure_and_rate() {
    let mut bench = ready(values_with_experiment());
    let values = *bench.controller.settings();
    let mut last_pa = 0.0;
    for (pressure_pa, ends_pa) in [
        (150_000, 1.5e5),
        (20_000, 2e4),
        (300_000, 3e5),
        (u32::MAX, 4e5),
        (0, 0.0),
    ] {
        bench.request = Request::Play(pressure_pa);
        let mut fastest = 0.0_f32;
        for _ in 0..200 {
            let output = bench.tick_in_balance();
            let most_pa = 0.01 * moving_rate(&values, output.contraction, last_pa);
            let change_pa = (output.pressure_ref.0 - last_pa).abs();
            assert!(change_pa <= most_pa + 0.1, "{change_pa}");
            fastest = fastest.max(change_pa / most_pa);
            last_pa = output.pressure_ref.0;
        }
        assert_eq!(last_pa, ends_pa);
        assert!(fastest > 0.99, "as fast as it may, {fastest}");
    }
}

#[test]
fn an_experiment_without_further_requests_vents() {
    let mut bench = playing();
    bench.request = Request::None;
    for _ in 1..PLAY_SILENCE_TICKS {
        let output = bench.tick();
        assert_eq!((output.mode, output.pressure_ref.0), (Mode::Playing, 1e5));
    }
    assert_eq!(bench.tick().mode, Mode::Venting);
    bench.until(60, |output| output.pressure_ref.0 == 0.0);
    bench.request = Request::Play(100_000);
    for _ in 0..100 {
        let output = bench.tick();
        assert_eq!((output.mode, output.valve.get()), (Mode::Venting, 0));
    }
}

#[test]
fn an_experiment_ends_with_venting_and_with_every_fault() {
    let mut bench = playing();
    bench.request = Request::Vent;
    assert_eq!(bench.tick().mode, Mode::Venting);

    type Break = fn(&mut Sensors);
    let faults: [(Break, Fault); 3] = [
        (
            |sensors| sensors.pressure.0 = 0,
            Fault::Pressure(Doubt::Range),
        ),
        (
            |sensors| sensors.bridge.0 = 4095,
            Fault::Bridge(Doubt::Range),
        ),
        (|sensors| sensors.missed_ticks = 9, Fault::MissedTicks),
    ];
    for (breaks, fault) in faults {
        let mut bench = playing();
        let mut last = bench.tick();
        for _ in 0..10 {
            let mut sensors = Sensors {
                request: Request::Play(300_000),
                ..bench.sensors()
            };
            breaks(&mut sensors);
            let output = bench.tick_with(&sensors);
            assert!(
                output.pressure_ref.0 <= last.pressure_ref.0,
                "suspect: it may only fall"
            );
            last = output;
        }
        assert_eq!((last.mode, last.fault), (Mode::Venting, Some(fault)));
    }
}

#[test]
fn beyond_the_limit_of_travel_an_experiment_may_only_lower_the_pressure() {
    let mut bench = ready(SettingsValues {
        contraction_max: 0.15,
        ..values_with_experiment()
    });
    bench.request = Request::Play(400_000);
    let mut last_pa = 0.0;
    for _ in 0..200 {
        last_pa = bench.tick_in_balance().pressure_ref.0;
    }
    // In balance at 0.15: 300.7 N over (3.7718e-3 · 0.85² − 1.39e-3) m².
    assert!((last_pa - 225_300.0).abs() < 1e4, "{last_pa}");
    bench.request = Request::Play(200_000);
    bench.tick_in_balance();
    assert!(bench.tick_in_balance().pressure_ref.0 < last_pa - 1e3);
}

#[test]
fn self_check_reports_the_disturbance() {
    type Disturb = fn(&mut Bench);
    let disturbances: [(Disturb, Fault); 3] = [
        (|bench| bench.finger_n = 5.0, Fault::LoadedLever),
        (|bench| bench.pressure_pa = 1e5, Fault::NotVented),
        (
            |bench| bench.contraction = (bench.ticks % 7) as f32 * 1e-3,
            Fault::NotStill,
        ),
    ];
    for (disturb, reason) in disturbances {
        let mut bench = Bench::new();
        let found = (0..600).find_map(|_| {
            disturb(&mut bench);
            let output = bench.tick();
            assert_eq!(output.valve.get(), 0);
            assert_ne!(output.mode, Mode::Ready);
            output.fault
        });
        assert_eq!(found, Some(reason));
    }
}

#[test]
fn holding_keeps_the_reference_and_resumes_at_the_engage_rate() {
    let mut bench = Bench::assisting();
    bench.request = Request::Hold;
    let held = bench.tick();
    assert_eq!(held.mode, Mode::Holding);
    bench.finger_n = 6.0;
    bench.request = Request::None;
    for _ in 0..100 {
        assert_eq!(bench.tick().pressure_ref, held.pressure_ref);
    }
    bench.request = Request::Assist;
    let resumed = bench.tick();
    assert_eq!(resumed.mode, Mode::Assisting);
    assert!(resumed.pressure_ref.0 - held.pressure_ref.0 <= 2.5e5 * 0.01 + 0.1);
}

#[test]
fn a_single_bad_reading_holds_the_reference_and_assisting_resumes() {
    let mut bench = Bench::assisting();
    let before = bench.tick();
    let mut sensors = bench.sensors();
    sensors.bridge = AdcCount(4095);
    let during = bench.tick_with(&sensors);
    assert_eq!(during.mode, Mode::Holding);
    assert_eq!(during.pressure_ref, before.pressure_ref);
    let after = bench.tick();
    assert_eq!((after.mode, after.fault), (Mode::Assisting, None));
}

/// Ticks `bench` with sensors changed by `corrupt` until a fault, at most `ticks` times.
fn fault_after(mut bench: Bench, ticks: u32, corrupt: fn(&mut Sensors, u32)) -> (Fault, u32) {
    for tick in 0..ticks {
        let mut sensors = bench.sensors();
        corrupt(&mut sensors, tick);
        if let Some(fault) = bench.tick_with(&sensors).fault {
            return (fault, tick + 1);
        }
    }
    panic!("no fault in {ticks} ticks");
}

#[test]
fn broken_sensors_are_faults_with_their_reason() {
    let range = |fault: fn(Doubt) -> Fault| (fault(Doubt::Range), 3);
    type Corrupt = fn(&mut Sensors, u32);
    let cases: [(Corrupt, (Fault, u32)); 9] = [
        (
            |sensors, _| sensors.bridge = AdcCount(0),
            range(Fault::Bridge),
        ),
        (
            |sensors, _| sensors.pressure = AdcCount(4095),
            range(Fault::Pressure),
        ),
        // A rejected reading within range does not widen the step: it fails however long it lasts.
        (
            |sensors, _| sensors.pressure = AdcCount(3600),
            (Fault::Pressure(Doubt::Step), 3),
        ),
        (
            |sensors, _| sensors.encoder.0 = sensors.encoder.0.wrapping_add(1 << 20),
            (Fault::Encoder(Doubt::Step), 3),
        ),
        // 7 mm below the stop.
        (
            |sensors, _| sensors.encoder.0 = sensors.encoder.0.wrapping_sub(560),
            range(Fault::Encoder),
        ),
        // −21 kPa: the valve draws no vacuum.
        (
            |sensors, tick| sensors.pressure = AdcCount(310 + (tick % 2) as u16),
            range(Fault::Pressure),
        ),
        // 50 equal readings, of which the third from then on is the failure.
        (
            |sensors, _| sensors.bridge = AdcCount(2300),
            (Fault::Bridge(Doubt::Stuck), 53),
        ),
        (
            |sensors, _| sensors.pressure = AdcCount(840),
            (Fault::Pressure(Doubt::Stuck), 53),
        ),
        (
            |sensors, _| sensors.missed_ticks = 3,
            (Fault::MissedTicks, 1),
        ),
    ];
    for (corrupt, expected) in cases {
        assert_eq!(fault_after(Bench::assisting(), 60, corrupt), expected);
    }
}

#[test]
fn a_frozen_encoder_is_detected_by_the_pressure() {
    let mut bench = Bench::assisting();
    bench.contraction = 0.1;
    // Move there within the step limit.
    for step in 0..=20 {
        bench.contraction = 0.005 * step as f32;
        bench.pressure_pa = 8e4 + 5e2 * step as f32;
        assert_eq!(bench.tick().fault, None);
    }
    let found = fault_of(&mut bench, pull_harder).map(|(fault, _)| fault);
    assert_eq!(found, Some(Fault::Encoder(Doubt::Stuck)));
    assert_pulls_with_the_weight(&bench);
}

#[test]
fn trips_vent_at_the_limited_rate_until_a_reset_once_vented() {
    let mut bench = Bench::assisting();
    bench.finger_n = 17.0;
    for _ in 0..400 {
        let before = bench.contraction;
        let output = bench.tick_in_balance();
        // At the highest pressure an external force lifts the weight further.
        if bench.pressure_pa > 4.99e5 {
            bench.contraction = before + 0.01;
        }
        if output.fault.is_some() {
            break;
        }
    }
    let mut last = bench.tick();
    assert_eq!(
        (last.mode, last.fault),
        (Mode::Venting, Some(Fault::OverContraction))
    );
    for request in [
        Request::Assist,
        Request::Hold,
        Request::Reset,
        Request::None,
    ] {
        bench.request = request;
        let output = bench.tick();
        assert_eq!((output.mode, output.fault), (last.mode, last.fault));
        let fall_pa = last.pressure_ref.0 - output.pressure_ref.0;
        assert!((0.0..=2e5 * 0.01 + 0.1).contains(&fall_pa), "{fall_pa}");
        last = output;
    }
    bench.contraction = 0.0;
    bench.request = Request::None;
    bench.until(400, |output| output.pressure_ref.0 == 0.0);
    bench.finger_n = 0.0;
    bench.request = Request::Reset;
    let reset = bench.until(10, |output| output.mode != Mode::Venting);
    assert_eq!((reset.mode, reset.fault), (Mode::SelfCheck, None));
}

#[test]
fn missed_ticks_do_not_raise_the_rate_of_the_reference() {
    for (missed_ticks, mode, step_pa) in [(255, Mode::Venting, 2e3), (2, Mode::Assisting, 5e4)] {
        let mut bench = Bench::assisting();
        let before = bench.tick();
        bench.pressure_pa = before.pressure_ref.0 + 1e3;
        bench.finger_n = 15.0;
        let mut sensors = bench.sensors();
        sensors.missed_ticks = missed_ticks;
        let after = bench.tick_with(&sensors);
        assert_eq!(after.mode, mode);
        let change_pa = (after.pressure_ref.0 - before.pressure_ref.0).abs();
        assert!((1.0..=step_pa + 0.1).contains(&change_pa), "{change_pa}");
    }
}

#[test]
fn a_muscle_that_moves_without_a_request_is_a_fault() {
    type Disturb = fn(&mut Bench);
    // A valve that is stuck open; the same with a pressure sensor that reads zero.
    let disturbances: [Disturb; 2] = [
        |bench| bench.pressure_pa += 5e3,
        |bench| bench.contraction += 0.005,
    ];
    for disturb in disturbances {
        let mut bench = Bench::new();
        bench.until(60, |output| output.mode == Mode::Ready);
        for _ in 0..6 {
            disturb(&mut bench);
            bench.tick();
        }
        // Assistance does not begin in this state.
        bench.request = Request::Assist;
        let output = bench.tick();
        assert_eq!(
            (output.mode, output.fault),
            (Mode::Venting, Some(Fault::Uncommanded))
        );
    }
}

#[test]
fn assistance_does_not_begin_under_pressure() {
    let mut bench = Bench::new();
    bench.until(60, |output| output.mode == Mode::Ready);
    bench.pressure_pa = 1e5;
    bench.request = Request::Assist;
    assert_eq!(bench.tick().mode, Mode::Ready);
}

#[test]
fn an_encoder_that_counts_the_wrong_way_is_a_fault() {
    let mut bench = Bench::assisting();
    for step in 0..10 {
        bench.contraction = -0.005 * step as f32;
        if let Some(fault) = bench.tick().fault {
            assert_eq!(fault, Fault::Encoder(Doubt::Range));
            return;
        }
    }
    panic!("no fault at {}", bench.contraction);
}

#[test]
fn a_vacuum_is_not_a_vented_muscle() {
    let mut bench = Bench::new();
    bench.pressure_pa = -8e4;
    let outputs = [bench.tick(), bench.tick(), bench.tick()];
    assert_eq!(outputs[2].fault, Some(Fault::Pressure(Doubt::Range)));
}

#[test]
fn a_requested_hold_lasts_longer_than_a_suspect_reading() {
    // Requested while the reading is suspect, and in the tick in which it is good again.
    for bad_again in [true, false] {
        let mut bench = Bench::assisting();
        let mut sensors = bench.sensors();
        sensors.bridge = AdcCount(4095);
        assert_eq!(bench.tick_with(&sensors).mode, Mode::Holding);
        bench.request = Request::Hold;
        let mut sensors = bench.sensors();
        if bad_again {
            sensors.bridge = AdcCount(4095);
        }
        bench.tick_with(&sensors);
        bench.request = Request::None;
        assert_eq!(bench.tick().mode, Mode::Holding, "bad again: {bad_again}");
        assert_eq!(bench.tick().fault, None);
    }
}

#[test]
fn a_fault_while_venting_on_request_is_latched_and_keeps_the_rate() {
    let mut bench = Bench::assisting();
    bench.request = Request::Vent;
    let mut last = bench.tick();
    assert_eq!((last.mode, last.fault), (Mode::Venting, None));
    bench.request = Request::None;
    for _ in 0..20 {
        let mut sensors = bench.sensors();
        sensors.bridge = AdcCount(0);
        // The muscle empties faster than its reference falls.
        bench.pressure_pa *= 0.9;
        let output = bench.tick_with(&sensors);
        // A reference above the muscle's pressure falls faster, but within the weight's rate.
        let fall_pa = last.pressure_ref.0 - output.pressure_ref.0;
        let values = *bench.controller.settings();
        let moving_pa = 0.01 * moving_rate(&values, 0.0, last.pressure_ref.0);
        assert!((0.0..=moving_pa + 0.1).contains(&fall_pa), "{fall_pa}");
        last = output;
    }
    assert_eq!(last.fault, Some(Fault::Bridge(Doubt::Range)));
}

#[test]
fn an_intermittent_reading_is_a_fault() {
    let intermittent = |sensors: &mut Sensors, tick| {
        if tick % 3 != 0 {
            sensors.bridge = AdcCount(4095);
        }
    };
    let (fault, ticks) = fault_after(Bench::assisting(), 12, intermittent);
    assert_eq!(fault, Fault::Bridge(Doubt::Range));
    assert!(ticks > 3, "{ticks}");
}

#[test]
fn a_rare_bad_reading_is_not_a_fault() {
    let mut bench = Bench::assisting();
    for tick in 0..1000 {
        let mut sensors = bench.sensors();
        if tick % 20 == 0 {
            sensors.bridge = AdcCount(4095);
        }
        assert_eq!(bench.tick_with(&sensors).fault, None, "tick {tick}");
    }
}

#[test]
fn a_frozen_encoder_that_flickers_is_detected_by_the_pressure() {
    let mut bench = Bench::assisting();
    for step in 0..=20 {
        bench.contraction = 0.005 * step as f32;
        assert_eq!(bench.tick().fault, None);
    }
    for tick in 0..100 {
        pull_harder(&mut bench);
        let mut sensors = bench.sensors();
        sensors.encoder.0 = sensors.encoder.0.wrapping_add(tick % 2);
        if let Some(fault) = bench.tick_with(&sensors).fault {
            assert_eq!(fault, Fault::Encoder(Doubt::Stuck));
            assert_pulls_with_the_weight(&bench);
            return;
        }
    }
    panic!("unnoticed");
}

#[test]
fn a_muscle_under_pressure_is_not_vented_however_long_it_takes() {
    let mut bench = Bench::assisting();
    bench.request = Request::Vent;
    bench.tick();
    bench.request = Request::Reset;
    for _ in 0..1000 {
        assert_eq!(bench.tick().mode, Mode::Venting);
    }
}

#[test]
fn with_a_failed_pressure_sensor_the_wait_begins_at_the_end_of_the_ramp() {
    let mut bench = Bench::assisting();
    let (mut ticks, mut emptied) = (0, 0);
    bench.request = Request::Reset;
    loop {
        let mut sensors = bench.sensors();
        sensors.pressure = AdcCount(4095);
        let output = bench.tick_with(&sensors);
        if output.mode == Mode::SelfCheck {
            break;
        }
        ticks += 1;
        emptied += u32::from(output.pressure_ref.0 == 0.0);
        assert!(ticks < 1000, "never");
    }
    assert_eq!(emptied, 500);
}

#[test]
fn a_frozen_encoder_at_the_stop_is_detected_by_the_force_balance() {
    let mut bench = Bench::assisting();
    bench.finger_n = 13.0;
    // (117.7 + 105 + 183) N over 2.38e-3 m²: 170 kPa, and a tenth of a second's mean.
    let fault = bench.until(100, |output| output.fault.is_some());
    assert_eq!(fault.fault, Some(Fault::ForceBalance));
    assert!(bench.pressure_pa < 2.2e5, "{}", bench.pressure_pa);
}

#[test]
fn a_pressure_that_does_not_follow_is_a_fault() {
    let mut bench = Bench::assisting();
    bench.finger_n = 15.0;
    for _ in 0..100 {
        // A valve that stays shut.
        if let Some(fault) = bench.tick().fault {
            assert_eq!(fault, Fault::PressureControl);
            return;
        }
    }
    panic!("unnoticed");
}

#[test]
fn a_pressure_sensor_that_falls_does_not_drop_the_weight() {
    let mut bench = Bench::assisting();
    bench.finger_n = 5.5;
    bench.until(200, |output| output.pressure_ref.0 > 1.1e5);
    let mut last = bench.tick();
    bench.request = Request::Vent;
    // A step that a valve could make: the reading is used, and the reference keeps its rate.
    bench.pressure_pa = 0.0;
    for _ in 0..20 {
        let output = bench.tick();
        let values = *bench.controller.settings();
        let moving_pa = 0.01 * moving_rate(&values, 0.0, last.pressure_ref.0);
        assert!(last.pressure_ref.0 - output.pressure_ref.0 <= moving_pa + 0.1);
        last = output;
    }
}

/// Settings with which the reference engages at 500 Pa a tick.
fn values_with_slow_engagement() -> SettingsValues {
    SettingsValues {
        engage_rate_pa_per_s: 5e4,
        ..SettingsValues::reference()
    }
}

#[test]
fn the_reference_is_slow_until_it_has_met_the_law_and_after_a_hold() {
    let mut bench = ready(values_with_slow_engagement());
    bench.request = Request::Assist;
    let mut last_pa = bench.tick().pressure_ref.0;
    for _ in 0..200 {
        let output = bench.tick_in_balance();
        assert!(output.pressure_ref.0 - last_pa <= 500.1, "engaging");
        last_pa = output.pressure_ref.0;
    }
    assert!(bench.controller.state().engaged);
    bench.request = Request::Hold;
    bench.tick();
    bench.finger_n = 6.0;
    bench.request = Request::Assist;
    let resumed_pa = bench.tick().pressure_ref.0 - last_pa;
    assert!((1.0..=500.1).contains(&resumed_pa), "{resumed_pa}");
}

#[test]
fn the_reference_is_fast_again_after_a_bridged_reading() {
    let mut bench = ready(values_with_slow_engagement());
    bench.request = Request::Assist;
    for _ in 0..200 {
        bench.tick_in_balance();
    }
    bench.request = Request::None;
    let mut sensors = bench.sensors();
    sensors.bridge = AdcCount(4095);
    let held = bench.tick_with(&sensors);
    assert_eq!(held.mode, Mode::Holding);
    bench.finger_n = 6.0;
    let resumed_pa = bench.tick().pressure_ref.0 - held.pressure_ref.0;
    assert!(resumed_pa > 1e3, "{resumed_pa}");
}

/// At the vent rate the reference falls by 2 kPa per tick.
#[test]
fn venting_is_slow_only_for_pressure_that_the_muscle_may_have() {
    let mut bench = ready(values_with_experiment());
    bench.request = Request::Play(350_000);
    let ahead_pa = |bench: &Bench| bench.controller.state().pressure_ref_pa - bench.pressure_pa;
    while ahead_pa(&bench) < 8e4 {
        bench.tick_with_valve(0.04);
    }
    bench.request = Request::Vent;
    let before_pa = bench.controller.state().pressure_ref_pa;
    let fall_pa = before_pa - bench.tick().pressure_ref.0;
    assert!(
        fall_pa > 2.1e3,
        "the muscle does not have it yet: {fall_pa}"
    );

    // A lower reading does not imply a lower pressure in the muscle.
    let mut bench = lifted();
    for _ in 0..200 {
        bench.tick_in_balance();
    }
    bench.request = Request::Vent;
    bench.pressure_pa = 5e4;
    // In the first tick the reference is above the slowest valve's pressure by a rounding error.
    let mut last_pa = bench.tick().pressure_ref.0;
    for _ in 0..20 {
        let output = bench.tick();
        assert!(last_pa - output.pressure_ref.0 <= 2e3 + 0.1);
        last_pa = output.pressure_ref.0;
    }
}

#[test]
fn a_board_is_armed_until_its_reference_is_zero() {
    let settings = Settings::new(SettingsValues {
        stuck_ticks: 0,
        ..SettingsValues::reference()
    });
    let mut device = Device::new(settings.expect("valid settings"));
    let pins = Pins {
        bridge: AdcCount(2048),
        pressure: AdcCount(410),
        ..Pins::default()
    };
    let mut read_back = AdcCount::default();
    let mut tick = |request: Request| {
        let command = Command::Request(request);
        let pins = Pins { read_back, ..pins };
        let tick = device.tick(&pins, Timing::default(), core::iter::once(command));
        read_back = AdcCount(tick.valve.get());
        tick
    };
    for _ in 0..60 {
        assert!(!tick(Request::None).armed);
    }
    for _ in 0..20 {
        assert!(tick(Request::Assist).armed);
    }
    let mut venting = tick(Request::Vent);
    assert!(venting.telemetry.output.pressure_ref.0 > 0.0);
    while venting.telemetry.output.pressure_ref.0 > 0.0 {
        assert!(venting.armed, "{:?}", venting.telemetry.output);
        venting = tick(Request::None);
    }
    assert!(!venting.armed);
}

/// A heavy weight that oscillates by 3 mm at 4 Hz: the force of its acceleration is five times the
/// tolerance. `missing` gives the missed ticks.
fn balance_of_a_swing(missing: fn(u32) -> bool) -> bool {
    let values = SettingsValues {
        load_kg: 300.0,
        ..SettingsValues::reference()
    };
    let mut balance = ForceBalance::default();
    let (mut ticks, mut has_failed) = (0, false);
    // sin and cos step by step: no_std has none. A tick turns by 2π · 4 Hz · 10 ms.
    let (turn_sin, turn_cos) = (0.248_689_89_f64, 0.968_583_16_f64);
    let (mut sin, mut cos) = (0.0, 1.0);
    for tick in 0..200 {
        (sin, cos) = (
            sin * turn_cos + cos * turn_sin,
            cos * turn_cos - sin * turn_sin,
        );
        let contraction = 0.15 + 0.01 * sin;
        // The acceleration that differences of ticks have: 2(cos − 1)/T² in place of −ω².
        let acceleration_m_per_s2 = 0.3 * 0.01 * sin * 2.0 * (turn_cos - 1.0) / 1e-4;
        let force_n = 300.0 * (9.80665 + acceleration_m_per_s2);
        let shortened = 1.0 - contraction;
        let pressure_pa = (force_n + 183.0) / (3.7718e-3 * shortened * shortened - 1.39e-3);
        ticks += 1;
        if missing(tick) {
            continue;
        }
        balance = balance.next(&values, contraction as f32, pressure_pa as f32, ticks);
        has_failed |= balance.has_failed(&values);
        ticks = 0;
    }
    has_failed
}

#[test]
fn a_weight_that_swings_is_in_balance_with_its_acceleration() {
    assert!(!balance_of_a_swing(|_| false));
}

#[test]
fn ticks_that_are_missed_do_not_look_like_an_acceleration() {
    assert!(!balance_of_a_swing(|tick| tick % 5 == 0));
    assert!(!balance_of_a_swing(|tick| tick % 2 == 0));
}

/// The first fault of a bench whose weight moves by `step` in a tick, and how many ticks have
/// passed until then; of `of` ticks one is missed. The pressure is that of the weight in balance.
fn fault_with_missed_ticks(step: f32, of: u32) -> Option<(Fault, u32)> {
    let mut bench = lifted();
    let mut missed_ticks = 0;
    (1..=2000).find_map(|tick| {
        bench.contraction -= step;
        if tick % of == 0 {
            missed_ticks += 1;
            return None;
        }
        let mut sensors = bench.sensors();
        sensors.missed_ticks = core::mem::take(&mut missed_ticks);
        let output = bench.tick_with(&sensors);
        output.fault.map(|fault| (fault, tick))
    })
}

/// Missed ticks hide no speed: 0.5 m/s is found within the time that four ticks take.
#[test]
fn a_weight_that_is_too_fast_is_found_between_missed_ticks() {
    for of in [2, 3, 10, 2001] {
        let found = fault_with_missed_ticks(5e-3 / 0.3, of);
        let (fault, ticks) = found.expect("a fault");
        assert!(fault == Fault::OverSpeed && ticks <= 4, "{of}: {found:?}");
    }
}

/// Ticks that are missed again and again are a fault, from one of ten on; fewer are none.
#[test]
fn ticks_that_are_missed_again_and_again_are_a_fault() {
    for (of, latest) in [(2, 20), (3, 40), (10, 800)] {
        let found = fault_with_missed_ticks(0.0, of);
        let (fault, ticks) = found.expect("a fault");
        assert!(
            fault == Fault::MissedTicks && ticks <= latest,
            "{of}: {found:?}"
        );
    }
    for of in [12, 2001] {
        assert_eq!(fault_with_missed_ticks(0.0, of), None);
    }
}

/// A bench in an experiment whose weight hangs at 200 kPa, at ε = 0.124.
fn lifted() -> Bench {
    let mut bench = ready(values_with_experiment());
    bench.request = Request::Play(200_000);
    for _ in 0..200 {
        assert_eq!(bench.tick_in_balance().fault, None);
    }
    bench
}

/// The person pulls harder, and the pressure follows the reference.
fn pull_harder(bench: &mut Bench) {
    bench.finger_n += 0.2;
    bench.pressure_pa = bench.controller.state().pressure_ref_pa;
}

/// The muscle pulls with four fifths of the weight, or with what four ticks more make of that.
fn assert_pulls_with_the_weight(bench: &Bench) {
    let muscle = &bench.controller.settings().muscle;
    let force_n = muscle.force_n(bench.contraction, GaugePa(bench.pressure_pa));
    assert!((94.0..120.0).contains(&force_n), "{force_n} N");
}

/// The first fault and after how many ticks, each of them after a call of `change`.
fn fault_of(bench: &mut Bench, change: fn(&mut Bench)) -> Option<(Fault, u32)> {
    (1..=200).find_map(|ticks| {
        change(bench);
        bench.tick().fault.map(|fault| (fault, ticks))
    })
}

/// Requests to vent, and lets the weight down until it meets something at ε = 0.1 that gives way by
/// this stiffness; from the second of contact on `change` is called. Returns ε over 6 s.
fn let_down_on(stiffness_n_per_m: f32, change: fn(&mut Bench)) -> Vec<f32> {
    const MET_AT: f32 = 0.1;
    let mut bench = lifted();
    let muscle = bench.controller.settings().muscle;
    let weight_n = 12.0 * 9.80665;
    let mut touched_ticks = 0;
    let contractions = (0..600).map(|_| {
        bench.request = Request::Vent;
        if touched_ticks > 10 {
            change(&mut bench);
        }
        let output = bench.tick_in_balance();
        let pressure = GaugePa(output.pressure_ref.0);
        let carried_n =
            |contraction: f32| weight_n - muscle.force_n(contraction, pressure).max(0.0);
        if bench.contraction < MET_AT && carried_n(MET_AT) > 0.0 {
            touched_ticks += 1;
            // Where the limb carries what the muscle does not, by bisection.
            let (mut low, mut high) = (0.0, MET_AT);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                let limb_n = stiffness_n_per_m * (MET_AT - middle) * muscle.initial_length_m;
                *(if limb_n > carried_n(middle) {
                    &mut low
                } else {
                    &mut high
                }) = middle;
            }
            bench.contraction = high;
        }
        bench.contraction
    });
    contractions.collect()
}

/// Ticks in a row below ε = 0.1, at most, and the highest ε after the first of them.
fn contact_and_retreat(contractions: &[f32]) -> (usize, f32) {
    let is_met = |contraction: &f32| *contraction < 0.1;
    let first = contractions.iter().position(is_met).expect("it is met");
    let after = &contractions[first..];
    let longest = after
        .chunk_by(|a, b| is_met(a) == is_met(b))
        .filter(|run| is_met(&run[0]));
    let longest = longest.map(<[f32]>::len).max().expect("a contact");
    (longest, after.iter().copied().fold(0.0, f32::max))
}

/// A limb is free again in 1.1 s: the ramp of 200 kPa/s takes 56 kPa to put nine tenths of the
/// weight on it, where it rests for 0.15 s; by then they are 90 kPa, which it takes as long to
/// bring back. From a chest to a skull: ISO/TS 15066, table A.3.
#[test]
fn weight_that_is_let_down_on_a_limb_is_lifted_off_it() {
    for stiffness_n_per_m in [25e3, 75e3, 150e3] {
        let contractions = let_down_on(stiffness_n_per_m, |_| {});
        let (contact_ticks, highest) = contact_and_retreat(&contractions);
        assert!(
            contact_ticks <= 110,
            "{stiffness_n_per_m}: {contact_ticks} ticks"
        );
        // It rises by the retreat from where it was carried, which is below 0.1.
        assert!(highest > 0.1 && highest < 0.1 + 0.015 / 0.3, "{highest}");
    }
}

/// With one that has failed, or is off, later than with a right one, and within the 3.4 s in which
/// what is clamped has to be free.
#[test]
fn a_retreat_needs_no_pressure_sensor() {
    let wrong: [fn(&mut Bench); 3] = [
        |bench| bench.pressure_pa = -1e5,
        |bench| bench.pressure_pa += 3e4,
        |bench| bench.pressure_pa -= 3e4,
    ];
    for change in wrong {
        let (contact_ticks, highest) = contact_and_retreat(&let_down_on(75e3, change));
        assert!(contact_ticks <= 340, "{contact_ticks} ticks");
        assert!(highest > 0.1 && highest < 0.1 + 0.015 / 0.3, "{highest}");
    }
}

/// A valve that keeps the pressure: the weight hangs. Another reason is latched already.
#[test]
fn nothing_retreats_with_a_valve_that_is_stuck_and_the_port_closes() {
    let mut bench = lifted();
    let mut sensors = bench.sensors();
    sensors.missed_ticks = 9;
    assert_eq!(bench.tick_with(&sensors).fault, Some(Fault::MissedTicks));
    let mut before_pa = f32::MAX;
    for _ in 0..600 {
        let reference_pa = bench.tick().pressure_ref.0;
        assert!(reference_pa <= before_pa);
        before_pa = reference_pa;
    }
    assert!(!bench.controller.state().port_open);
}

/// An encoder that stands still is no limb; and nothing rises by an encoder that has failed.
#[test]
fn nothing_retreats_without_a_limb_or_with_an_encoder_in_doubt() {
    let stands_still = let_down_on(1e9, |_| {});
    let no_encoder = let_down_on(75e3, |bench| bench.contraction = -0.1);
    for contractions in [stands_still, no_encoder] {
        let (contact_ticks, highest) = contact_and_retreat(&contractions);
        assert!(
            contact_ticks > 200 && highest < 0.1,
            "{contact_ticks} ticks, {highest}"
        );
    }
}

#[test]
fn a_pressure_above_its_trip_level_is_a_fault() {
    // In steps that the sensor's step limit allows; a tick earlier it would be another fault.
    let found = fault_of(&mut Bench::assisting(), |bench| bench.pressure_pa += 1.6e5);
    assert_eq!(found, Some((Fault::OverPressure, 3)));
}

#[test]
fn a_weight_that_is_too_fast_is_a_fault_in_either_direction() {
    // 5 mm a tick, 0.5 m/s, over 0.375 m/s: over two ticks from the second one on.
    let changes: [fn(&mut Bench); 2] = [
        |bench| bench.contraction += 5e-3 / 0.3,
        |bench| bench.contraction -= 5e-3 / 0.3,
    ];
    for change in changes {
        let found = fault_of(&mut lifted(), change);
        assert_eq!(found, Some((Fault::OverSpeed, 3)));
    }
}

#[test]
fn forces_out_of_balance_are_a_fault_in_either_direction() {
    // An encoder that drifts by 0.6 mm a tick: the muscle would pull too little, or too much.
    let changes: [fn(&mut Bench); 2] = [
        |bench| bench.contraction += 2e-3,
        |bench| bench.contraction -= 2e-3,
    ];
    for change in changes {
        let found = fault_of(&mut lifted(), change).map(|(fault, _)| fault);
        assert_eq!(found, Some(Fault::ForceBalance));
    }
}

#[test]
fn a_pressure_beyond_its_reference_is_a_fault() {
    let found = fault_of(&mut Bench::assisting(), |bench| bench.pressure_pa += 2e4);
    assert_eq!(found.map(|(fault, _)| fault), Some(Fault::PressureControl));
}

#[test]
fn a_slow_valve_is_not_a_fault() {
    let mut bench = ready(values_with_experiment());
    let mut furthest_pa = 0.0_f32;
    for pressure_pa in [350_000, 100_000] {
        bench.request = Request::Play(pressure_pa);
        for _ in 0..200 {
            // A time constant of 0.25 s, where 0.3 s will do.
            let output = bench.tick_with_valve(0.04);
            assert_eq!(output.fault, None);
            furthest_pa = furthest_pa.max((output.pressure_ref.0 - bench.pressure_pa).abs());
        }
    }
    assert!(
        furthest_pa > 9e4,
        "further than a valve at rest may be: {furthest_pa}"
    );
}

#[test]
fn an_encoder_that_stands_still_while_the_pressure_falls_is_a_fault() {
    let found = fault_of(&mut lifted(), |bench| {
        bench.request = Request::Play(0);
        bench.pressure_pa = bench.controller.state().pressure_ref_pa;
    });
    assert_eq!(
        found.map(|(fault, _)| fault),
        Some(Fault::Encoder(Doubt::Stuck))
    );
}

/// The reference has not changed: the pressure of a weight that rests is wrong.
#[test]
fn a_pressure_that_drifts_off_is_not_blamed_on_the_encoder() {
    let drifts: [fn(&mut Bench); 2] = [
        |bench| bench.pressure_pa -= 2e3,
        |bench| bench.pressure_pa += 2e3,
    ];
    for drift in drifts {
        let found = fault_of(&mut lifted(), drift).map(|(fault, _)| fault);
        assert_eq!(found, Some(Fault::PressureControl));
    }
}

/// The encoder is constant, too, but with a wrong pressure that does not indicate its failure.
#[test]
fn a_pressure_that_falls_at_once_is_not_blamed_on_the_encoder() {
    let found = fault_of(&mut lifted(), |bench| bench.pressure_pa = 6e4);
    assert_eq!(found.map(|(fault, _)| fault), Some(Fault::PressureControl));
}

#[test]
fn nothing_begins_on_a_suspect_reading_or_under_pressure() {
    for request in [Request::Assist, Request::Play(100_000)] {
        for is_suspect in [true, false] {
            let mut bench = ready(values_with_experiment());
            bench.request = request;
            let mut sensors = bench.sensors();
            if is_suspect {
                sensors.bridge = AdcCount(4095);
            } else {
                sensors.pressure = AdcCount(600);
            }
            assert_eq!(bench.tick_with(&sensors).mode, Mode::Ready);
            assert_ne!(
                bench.tick().mode,
                Mode::Ready,
                "as soon as it is good again"
            );
        }
    }
}

#[test]
fn a_hold_does_not_end_on_a_suspect_reading() {
    let mut bench = Bench::assisting();
    bench.request = Request::Hold;
    assert_eq!(bench.tick().mode, Mode::Holding);
    bench.request = Request::Assist;
    let mut sensors = bench.sensors();
    sensors.bridge = AdcCount(4095);
    assert_eq!(bench.tick_with(&sensors).mode, Mode::Holding);
    assert_eq!(bench.tick().mode, Mode::Assisting);
}

#[test]
fn a_reset_waits_for_the_reference_though_the_pressure_reads_zero() {
    let mut bench = Bench::assisting();
    bench.request = Request::Vent;
    bench.tick();
    bench.request = Request::Reset;
    bench.pressure_pa = 0.0;
    let mut output = bench.tick();
    while output.pressure_ref.0 > 0.0 {
        assert_eq!(output.mode, Mode::Venting);
        output = bench.tick();
    }
    assert_eq!(bench.tick().mode, Mode::SelfCheck);
}

#[test]
fn the_finger_force_is_limited_in_either_direction() {
    for (finger_n, limited_n) in [(24.0, 20.0), (-24.0, -20.0)] {
        let mut bench = Bench::assisting();
        bench.finger_n = 0.4 * finger_n;
        bench.tick();
        bench.finger_n = finger_n;
        assert_eq!(bench.tick().finger_force_n, limited_n);
    }
}

#[test]
fn a_step_is_suspect_in_either_direction() {
    for step_n in [17.0, -17.0] {
        let mut bench = Bench::assisting();
        bench.finger_n += step_n;
        assert_eq!(bench.tick().mode, Mode::Holding);
    }
}

/// 15 N a tick are plausible; over a tick that was missed or not seen, 30 N.
#[test]
fn a_step_may_be_larger_after_ticks_that_were_missed_or_out_of_range() {
    let step = |missed_ticks: u8, is_blind: bool| {
        let mut bench = Bench::assisting();
        if is_blind {
            let mut sensors = bench.sensors();
            sensors.bridge = AdcCount(4095);
            bench.tick_with(&sensors);
        }
        bench.finger_n += 17.0;
        let sensors = Sensors {
            missed_ticks,
            ..bench.sensors()
        };
        bench.tick_with(&sensors).mode
    };
    assert_eq!(step(0, false), Mode::Holding, "suspect");
    assert_eq!(step(1, false), Mode::Assisting);
    assert_eq!(step(0, true), Mode::Assisting);
}

#[test]
fn a_lever_that_is_pushed_down_disturbs_the_self_check() {
    let mut bench = Bench::new();
    let found = fault_of_self_check(&mut bench, |bench| bench.finger_n = -5.0);
    assert_eq!(found, Some(Fault::LoadedLever));
}

/// A reading that is repeatedly suspect, but never long enough to be a fault.
#[test]
fn the_self_check_does_not_pass_on_suspect_readings() {
    let mut bench = Bench::new();
    for tick in 0..400 {
        let mut sensors = bench.sensors();
        if tick % 20 == 0 {
            sensors.bridge = AdcCount(4095);
        }
        assert_eq!(bench.tick_with(&sensors).mode, Mode::SelfCheck);
    }
}

fn fault_of_self_check(bench: &mut Bench, disturb: fn(&mut Bench)) -> Option<Fault> {
    (0..600).find_map(|_| {
        disturb(bench);
        bench.tick().fault
    })
}

#[test]
fn settings_that_disable_a_check_are_refused() {
    type Change = fn(&mut SettingsValues);
    let changes: [(&str, Change); 23] = [
        ("bridge.per_count", |v| v.bridge.per_count = 1e-20),
        ("bridge.per_count", |v| v.bridge.zero_count = 100.0),
        ("bridge.per_count", |v| v.finger_force_n_max = 25.0),
        ("bridge_step_n_max", |v| v.bridge_step_n_max = 50.0),
        ("pressure_trip_pa", |v| {
            v.pressure_sensor.zero_count = 4095.0
        }),
        ("pressure_trip_pa", |v| v.pressure_sensor.per_count = 150.0),
        ("pressure_trip_pa", |v| v.pressure_trip_pa = 8e5),
        ("pressure_step_pa_max", |v| v.pressure_step_pa_max = 6e5),
        ("reference_speed_m_per_s_max", |v| {
            v.reference_speed_m_per_s_max = 10.0
        }),
        ("pressure_error_pa_max", |v| v.pressure_error_pa_max = 6e5),
        ("vent_rate_pa_per_s", |v| v.vent_rate_pa_per_s = 1e7),
        ("vented_pa", |v| {
            (v.pressure_pa_max, v.vented_pa) = (5e4, 1e5)
        }),
        ("encoder_m_per_count", |v| v.encoder_m_per_count = -1e-20),
        ("force_error_n_max", |v| v.force_error_n_max = 2e3),
        ("valve_drive.pa_per_v", |v| v.valve_drive.pa_per_v = 1e7),
        ("stuck_ticks", |v| v.stuck_ticks = 65_535),
        ("contraction_max", |v| {
            (v.contraction_max, v.contraction_trip) = (0.36, 0.37)
        }),
        ("contraction_trip", |v| v.contraction_trip = 0.30),
        ("pressure_pa_max", |v| v.supply_pressure_pa = 4e5),
        ("pressure_pa_max", |v| v.valve_drive.amplifier_gain = 2.0),
        ("play_pressure_pa_max", |v| v.play_pressure_pa_max = 6e5),
        ("pressure_trip_pa", |v| v.pressure_trip_pa = 5e5),
        ("self_check_ticks_max", |v| v.self_check_ticks_max = 40),
    ];
    for (setting, change) in changes {
        let mut values = SettingsValues::reference();
        change(&mut values);
        match Settings::new(values) {
            Err(
                SettingsError::OutOfRange { name, .. } | SettingsError::Contradiction { name, .. },
            ) => assert_eq!(name, setting),
            other => panic!("{setting}: {other:?}"),
        }
    }
}

#[test]
fn settings_survive_a_round_trip_and_no_flipped_bit_or_cut_does() {
    let mut buffer = [0; ENCODED_LEN_MAX];
    let bytes = reference().encode(&mut buffer).expect("it fits").to_vec();
    assert_eq!(Settings::decode(&bytes), Ok(reference()));
    for bit in 0..8 * bytes.len() {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(Settings::decode(&flipped).is_err(), "bit {bit}");
    }
    for length in 0..bytes.len() {
        assert!(
            Settings::decode(&bytes[..length]).is_err(),
            "length {length}"
        );
        assert_eq!(
            reference().encode(&mut buffer[..length]),
            Err(SettingsError::Length)
        );
    }
}

/// As much compensation as the limits allow.
const COMPENSATION_MOST: Compensation = Compensation {
    hysteresis_area_m2: 5e-4,
    hysteresis_reach: 1e-3,
    friction_n: 50.0,
    friction_reach_m: 1e-5,
    payload_kg: 10.0,
    force_n_max: 200.0,
    lead_s: 0.2,
    dead_zone_filling_pa: 3e4,
    dead_zone_exhausting_pa: 3e4,
    pressure_pa_max: 1e5,
};

/// The reference with one value's bytes replaced by any others, with and without compensation.
fn any_settings() -> impl Strategy<Value = SettingsValues> {
    let mut buffer = [0; ENCODED_LEN_MAX];
    let bytes = postcard::to_slice(&values_with_experiment(), &mut buffer).expect("it fits");
    let bytes = bytes.to_vec();
    let special = prop_oneof![
        any::<u32>(),
        (-10.0_f32..10.0).prop_map(f32::to_bits),
        (-1e6_f32..1e6).prop_map(f32::to_bits),
        Just(f32::NAN.to_bits()),
        Just(f32::INFINITY.to_bits()),
    ];
    // 33 floats come first, four bytes each.
    let compensation = prop_oneof![Just(Compensation::OFF), Just(COMPENSATION_MOST)];
    let parts = (0..33_usize, special, compensation);
    parts.prop_filter_map("not settings", move |(place, bits, compensation)| {
        let mut bytes = bytes.clone();
        bytes[4 * place..4 * place + 4].copy_from_slice(&bits.to_le_bytes());
        let values: SettingsValues = postcard::from_bytes(&bytes).ok()?;
        Some(SettingsValues {
            compensation,
            ..values
        })
    })
}

/// dP/dt at which a weight in balance moves as fast as it may: (v/L)·f_c/f_p of Eq 1.
fn moving_rate(values: &SettingsValues, contraction: f32, pressure_pa: f32) -> f32 {
    let muscle = &values.muscle;
    let contraction = contraction.clamp(0.0, values.contraction_max);
    let pulls_from_pa = -muscle.gamma_n / muscle.force_per_pressure_m2(0.0);
    let slope_n = muscle.stiffness_n(contraction, GaugePa(pressure_pa.max(pulls_from_pa)));
    values.reference_speed_m_per_s_max / muscle.initial_length_m * slope_n
        / muscle.force_per_pressure_m2(contraction)
}

fn any_sensors() -> impl Strategy<Value = (Sensors, bool)> {
    let request = prop_oneof![
        Just(Request::None),
        Just(Request::Assist),
        Just(Request::Hold),
        Just(Request::Vent),
        Just(Request::Reset),
        any::<u32>().prop_map(Request::Play),
        (0..600_000_u32).prop_map(Request::Play),
    ];
    // Plausible readings among implausible ones, so that every mode is reached.
    let adc = |usual: std::ops::Range<u16>| prop_oneof![4 => usual, 1 => any::<u16>()];
    let encoder = prop_oneof![8 => 0..20_u32, 1 => any::<u32>()];
    let read_back = prop_oneof![4 => Just(None), 1 => any::<u16>().prop_map(Some)];
    let readings = (adc(2040..2100), adc(409..500), encoder);
    (readings, read_back, 0..4_u8, request).prop_map(
        |((bridge, pressure, encoder), read_back, missed_ticks, request)| {
            let sensors = Sensors {
                bridge: AdcCount(bridge),
                pressure: AdcCount(pressure),
                encoder: EncoderCount(encoder),
                read_back: AdcCount(read_back.unwrap_or_default()),
                missed_ticks,
                request,
            };
            (sensors, read_back.is_some())
        },
    )
}

proptest! {
    #[test]
    fn settings_outside_any_limit_cannot_be_built(values in any_settings()) {
        match Settings::new(values) {
            Ok(settings) => for limit in LIMITS {
                let value = (limit.value)(settings.values());
                prop_assert!((limit.min..=limit.max).contains(&value), "{}", limit.name);
            },
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn for_any_input_the_command_is_safe(
        values in any_settings(),
        start in 0..80_usize,
        run in prop::collection::vec(any_sensors(), 1..200),
    ) {
        let Ok(settings) = Settings::new(values) else { return Ok(()) };
        let mut bench = Bench::new();
        bench.controller = Controller::new(settings);
        for tick in 0..start {
            bench.request = if tick > 60 { Request::Assist } else { Request::None };
            bench.tick();
        }
        let values = settings.values();
        let max_pa = settings.values().pressure_pa_max;
        let mut last = bench.tick();
        for (mut sensors, is_wrong) in run {
            if !is_wrong {
                sensors.read_back = AdcCount(bench.controller.state().valve.get());
            }
            let output = bench.tick_with(&sensors);
            prop_assert!((0.0..=max_pa).contains(&output.pressure_ref.0));
            for value in [output.finger_force_n, output.reference_force_n, output.contraction,
                          output.pressure.0] {
                prop_assert!(value.is_finite());
            }
            if output.mode == Mode::Playing {
                prop_assert!(output.pressure_ref.0 <= values.play_pressure_pa_max);
            }
            let sent = values.valve_drive.pressure(output.valve).0;
            // The DAC is within half a count of the reference.
            prop_assert!(sent <= max_pa * 1.0002 + 0.51 * values.valve_drive.pressure(
                model_core::signal::DacCount::new(1)).0);
            let rise = output.pressure_ref.0 - last.pressure_ref.0;
            // No faster than the weight may move; rounding of references up to 2 MPa besides. An
            // engagement begins at the measured pressure.
            let step = 0.01 * moving_rate(values, output.contraction, last.pressure_ref.0) + 0.5;
            let begins = last.mode == Mode::Ready && output.mode == Mode::Assisting;
            prop_assert!(rise <= if begins { values.vented_pa + step } else { step }, "{rise}");
            prop_assert!(rise >= -step, "{rise}");
            if output.mode == Mode::Venting && last.pressure_ref.0 <= output.pressure.0 {
                prop_assert!(rise >= -values.vent_rate_pa_per_s * 0.01 - 0.5, "{rise}");
            }
            if matches!(output.mode, Mode::SelfCheck | Mode::Ready) {
                prop_assert_eq!(output.valve.get(), 0);
            }
            if last.fault.is_some() && output.mode != Mode::SelfCheck {
                prop_assert_eq!(output.fault, last.fault);
                prop_assert_eq!(output.mode, Mode::Venting);
            }
            last = output;
        }
    }
}

#[test]
fn a_damaged_memory_is_a_fault_and_lets_the_weight_down_if_nothing_is_known() {
    let settings = reference();
    let values = settings.values();
    let mut controller = Controller::new(settings);
    controller.memory_mut().state.plain_mut()[0].pressure_ref_pa = 1e5;
    assert_eq!(
        controller.tick(&Sensors::default()).fault,
        Some(Fault::Memory)
    );
    let mut controller = Controller::new(settings);
    let copies = controller.memory_mut().state.plain_mut();
    for (state, pressure_ref_pa) in copies.iter_mut().zip([1e5, 2e5, 3e5]) {
        state.pressure_ref_pa = pressure_ref_pa;
    }
    // The muscle has 250 kPa, and is vented from there at the settings' rate.
    let sensors = Sensors {
        bridge: values.bridge.count(0.0),
        pressure: values.pressure_sensor.count(2.5e5),
        ..Sensors::default()
    };
    let mut before_pa = values.pressure_sensor.value(sensors.pressure);
    for _ in 0..10 {
        let output = controller.tick(&sensors);
        assert_eq!(
            (output.mode, output.fault),
            (Mode::Venting, Some(Fault::Memory))
        );
        let step_pa = before_pa - output.pressure_ref.0;
        let most_pa = values.vent_rate_pa_per_s * 0.01;
        assert!((0.0..=most_pa + 0.1).contains(&step_pa), "{step_pa}");
        before_pa = output.pressure_ref.0;
    }
    assert!(before_pa > 2e5, "{before_pa}");
}

/// Of a controller that assists: the tick in which `off_counts` beside the valve's voltage are a
/// fault, if they are one.
fn found_after(off_counts: i32, missed_ticks: u8) -> Option<u32> {
    let mut bench = Bench::assisting();
    for tick in 1..=100 {
        let valve = i32::from(bench.controller.state().valve.get());
        // The muscle is above its reference: the ramp is the slow one.
        bench.pressure_pa = bench.controller.state().pressure_ref_pa + 500.0;
        let sensors = Sensors {
            read_back: AdcCount((valve + off_counts) as u16),
            missed_ticks,
            ..bench.sensors()
        };
        let before = *bench.controller.state();
        let output = bench.tick_with(&sensors);
        if output.fault == Some(Fault::ValveVoltage) {
            // Let down along the ramp.
            let step_pa = before.pressure_ref_pa - output.pressure_ref.0;
            let ramp_pa = bench.controller.settings().vent_rate_pa_per_s * 0.01;
            assert!((0.0..=ramp_pa + 0.1).contains(&step_pa), "{step_pa}");
            assert_eq!(output.mode, Mode::Venting);
            assert!(before.port_open && !bench.controller.state().port_open);
            return Some(tick);
        }
        assert_eq!(output.fault, None);
    }
    None
}

/// 90 kPa are 740 counts, for which the tolerance is 64 and 11 more.
#[test]
fn a_voltage_of_the_valve_that_was_not_set_is_a_fault_in_the_third_tick() {
    for off_counts in [-730, -90, 90, 2_000] {
        assert_eq!(found_after(off_counts, 0), Some(3), "{off_counts}");
        assert_eq!(found_after(off_counts, 1), Some(2), "ticks are missed");
    }
    for off_counts in [-70, 0, 70] {
        assert_eq!(found_after(off_counts, 0), None, "{off_counts}");
    }
}

/// The tolerance holds for every count, and lets the errors of healthy converters pass.
#[test]
fn tolerance_of_the_valves_voltage_is_that_of_its_converters() {
    for count in 0..=4095_u16 {
        let (valve, most) = (DacCount::new(count), 64 + count / 64);
        for (off, may) in [(most, true), (most + 1, false)] {
            let low = count.checked_sub(off).map(AdcCount);
            let high = AdcCount(count + off);
            assert_eq!(valve.may_be_read_as(high), may, "{count} + {off}");
            let is_low = low.is_none_or(|low| valve.may_be_read_as(low) == may);
            assert!(is_low, "{count} - {off}");
        }
    }
    // Through the DAC's 15 kΩ, with all its errors: what the tolerance must let pass.
    for count in [0.0, 512.0, 2048.0, 4095.0_f64] {
        let loaded = count / (1.0 + 15e3 / 1e6) * 0.995 - (12.0 + 4.0 + 5.0 + 19.0);
        let read = AdcCount(loaded.max(0.0) as u16);
        assert!(DacCount::new(count as u16).may_be_read_as(read), "{count}");
    }
}

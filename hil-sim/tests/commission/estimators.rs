//! The estimators by themselves, on telemetry whose truth is known.

use hil_sim::commission::air::{lifting, limited, plugged};
use hil_sim::commission::cause::Cause;
use hil_sim::commission::curve::{Curve, Level as CurveLevel, at_zero, curve, valve};
use hil_sim::commission::lift::{Known, Lift, TOP_M, contradiction, lift};
use hil_sim::commission::readings::{
    Level, Movement, Readings, at_rest, hose_pumped, lever_pressed, movement, readings,
    stop_pressed, stop_released, weight_lifted,
};
use hil_sim::commission::scale::{self, Point, line, loss_per_s};
use model_core::io::{Output, Request, Sensors};
use model_core::link::{Source, Telemetry};
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::Mode;
use model_core::timing::Timing;

const EXPECTED: SettingsValues = SettingsValues::reference();

fn tick(bridge: f64, pressure: f64, encoder: i32) -> Telemetry {
    Telemetry {
        tick: 0,
        source: Source::Pins,
        sensors: Sensors {
            bridge: AdcCount(bridge.round() as u16),
            pressure: AdcCount(pressure.round() as u16),
            encoder: EncoderCount(encoder as u32),
            ..Sensors::default()
        },
        output: Output::default(),
        timing: Timing::default(),
    }
}

fn level(count: f64) -> Level {
    Level { count, sd: 2.0 }
}

fn at(bridge: f64, pressure: f64) -> Readings {
    Readings {
        bridge: level(bridge),
        pressure: level(pressure),
        encoder: EncoderCount(0),
    }
}

#[test]
fn readings_at_rest_tell_loose_wires_and_swapped_ones() {
    let ticks = [tick(2047.0, 410.0, 7), tick(2049.0, 410.0, 7)];
    let seen = readings(&ticks);
    assert_eq!((seen.bridge.count, seen.bridge.sd), (2048.0, 1.0));
    let noisy = Readings {
        bridge: Level {
            count: 2048.0,
            sd: 21.0,
        },
        ..at(2048.0, 410.0)
    };
    for (rest, cause) in [
        (seen, None),
        (at(0.0, 410.0), Some(Cause::BridgeOpen)),
        (at(4095.0, 410.0), Some(Cause::BridgeOpen)),
        (at(2048.0, 3.0), Some(Cause::PressureOpen)),
        (at(2048.0, 4090.0), Some(Cause::PressureHigh)),
        (at(410.0, 2048.0), Some(Cause::BridgeAndPressureSwapped)),
        // The next steps calibrate both.
        (at(1800.0, 819.0), None),
        (noisy, Some(Cause::Noisy)),
    ] {
        assert_eq!(at_rest(&rest, &EXPECTED), cause, "{rest:?}");
    }
}

#[test]
fn a_movement_is_that_of_the_last_second() {
    let rest = at(2048.0, 410.0);
    let mut ticks = vec![tick(2048.0, 410.0, 0); 300];
    for (number, tick) in ticks.iter_mut().enumerate().skip(100) {
        tick.sensors.bridge.0 += 400;
        tick.sensors.encoder.0 = (number % 2) as u32;
    }
    let moved = movement(&rest, &ticks);
    assert_eq!((moved.bridge, moved.pressure), (400.0, 0.0));
    assert_eq!((moved.encoder, moved.encoder_changes), (1, 199));
}

#[test]
fn the_channel_that_moves_and_its_sign_name_the_wire() {
    let moved = |bridge, pressure, encoder, encoder_changes| Movement {
        bridge,
        pressure,
        encoder,
        encoder_changes,
    };
    type Judge = fn(&Movement, &SettingsValues) -> Option<Cause>;
    let (lever, lifted, pumped): (Judge, Judge, Judge) =
        (lever_pressed, weight_lifted, hose_pumped);
    for (judge, moved, cause) in [
        (lever, moved(400.0, 0.0, 0, 0), None),
        (lever, moved(-400.0, 0.0, 0, 0), Some(Cause::BridgeInverted)),
        (
            lever,
            moved(0.0, 400.0, 0, 0),
            Some(Cause::BridgeAndPressureSwapped),
        ),
        (lever, moved(30.0, 0.0, 0, 0), Some(Cause::BridgeSilent)),
        (lifted, moved(0.0, 0.0, 800, 60), None),
        (
            lifted,
            moved(0.0, 0.0, -800, 60),
            Some(Cause::EncoderSwapped),
        ),
        (
            lifted,
            moved(0.0, 0.0, 1, 40),
            Some(Cause::EncoderOneChannel),
        ),
        (lifted, moved(0.0, 0.0, 0, 0), Some(Cause::EncoderSilent)),
        (pumped, moved(0.0, 400.0, 0, 0), None),
        (
            pumped,
            moved(0.0, -300.0, 0, 0),
            Some(Cause::PressureInverted),
        ),
        (
            pumped,
            moved(400.0, 0.0, 0, 0),
            Some(Cause::BridgeAndPressureSwapped),
        ),
        (pumped, moved(0.0, 10.0, 0, 0), Some(Cause::PressureSilent)),
    ] {
        assert_eq!(judge(&moved, &EXPECTED), cause, "{moved:?}");
    }
    // What was accepted is expected from then on.
    let mut mirrored = EXPECTED;
    mirrored.encoder_m_per_count *= -1.0;
    assert_eq!(weight_lifted(&moved(0.0, 0.0, -800, 60), &mirrored), None);
}

#[test]
fn the_emergency_stop_must_be_seen_with_both_contacts() {
    let with = |request| {
        let mut ticks = vec![tick(2048.0, 410.0, 0); 3];
        ticks[1].sensors.request = request;
        ticks
    };
    let [none, stop, differ] =
        [Request::None, Request::Stop, Request::StopContactsDiffer].map(with);
    assert_eq!(stop_pressed(&none), Some(Cause::StopSilent));
    assert_eq!(stop_pressed(&stop), None);
    assert_eq!(stop_pressed(&differ), Some(Cause::StopContact));
    assert_eq!(stop_released(&none), None);
    assert_eq!(stop_released(&stop), Some(Cause::StopOpen));
    assert_eq!(stop_released(&differ), Some(Cause::StopOpen));
}

fn points(of: &[(f64, f64)]) -> Vec<Point> {
    let point = |(count, quantity): &(f64, f64)| Point {
        level: level(*count),
        quantity: *quantity,
    };
    of.iter().map(point).collect()
}

#[test]
fn a_line_through_points_has_their_zero_and_gain() {
    let found = line(&points(&[(2048.0, 0.0), (2448.0, 5.0), (2848.0, 10.0)]));
    assert!((found.scale.zero_count - 2048.0).abs() < 1e-3);
    assert!((found.scale.per_count / 0.0125 - 1.0).abs() < 1e-6);
    assert!(found.curved < 1e-9);
    // Slope of three points at −400, 0 and 400 counts with 0.2 counts each.
    let sd = 0.2 * 2.0_f64.sqrt() * 400.0 / (2.0 * 400.0 * 400.0);
    assert!((found.relative_sd / sd - 1.0).abs() < 1e-9);
}

#[test]
fn a_bridge_is_wrong_by_its_gain_its_curve_or_its_zero() {
    let gain = f64::from(EXPECTED.bridge.per_count);
    let judge = |zero: f64, factor: f64, second_n: f64| {
        let count = |force_n: f64| zero + force_n / (factor * gain);
        let known = [(zero, 0.0), (count(5.0), 5.0), (count(second_n), 10.0)];
        scale::bridge(&line(&points(&known)), &EXPECTED)
    };
    assert_eq!(judge(2048.0, 1.0, 10.0), None);
    assert_eq!(judge(2048.0, 1.2, 10.0), None);
    assert_eq!(judge(2048.0, 1.4, 10.0), Some(Cause::BridgeGain));
    assert_eq!(judge(2048.0, 0.7, 10.0), Some(Cause::BridgeGain));
    assert_eq!(judge(2048.0, -1.0, 10.0), Some(Cause::BridgeInverted));
    // 1 kg typed for 0.9 kg.
    assert_eq!(judge(2048.0, 1.0, 9.0), Some(Cause::BridgeCurved));
    // 22 N need 1802 counts to either side.
    assert_eq!(judge(2400.0, 1.0, 10.0), Some(Cause::BridgeZero));
}

#[test]
fn a_pressure_sensor_is_wrong_by_its_zero_or_its_range() {
    let gain = f64::from(EXPECTED.pressure_sensor.per_count);
    let judge = |zero: f64, factor: f64| {
        let known = [(zero, 0.0), (zero + 2e5 / (factor * gain), 2e5)];
        scale::pressure(&line(&points(&known)), &EXPECTED)
    };
    assert_eq!(judge(409.6, 1.0), None);
    assert_eq!(judge(440.0, 1.04), None);
    assert_eq!(judge(409.6, 10.0 / 7.0), Some(Cause::PressureRange));
    assert_eq!(judge(819.0, 1.0), Some(Cause::PressureZero));
    assert_eq!(judge(409.6, -1.0), Some(Cause::PressureInverted));
}

#[test]
fn a_leak_is_the_share_of_pressure_that_is_lost_in_a_second() {
    for (share, is_leak) in [(0.0, false), (0.005, false), (0.02, true), (0.5, true)] {
        let count =
            |number: i32| 410.0 + 1200.0 * (1.0_f64 - share).powf(f64::from(number) / 100.0);
        let ticks: Vec<_> = (0..300)
            .map(|number| tick(2048.0, count(number), 0))
            .collect();
        let loss = loss_per_s(level(410.0), &ticks);
        assert_eq!(scale::leaks(loss), is_leak, "{share}: {loss}");
    }
}

#[test]
fn an_encoder_is_wrong_by_its_scale_its_sign_or_its_home() {
    for (um, home, cause) in [
        (12.5, 0, None),
        (12.7, 8, None),
        (12.5, 9, Some(Cause::EncoderLosesCounts)),
        (25.0, 0, Some(Cause::EncoderScale)),
        (6.25, 0, Some(Cause::EncoderScale)),
        (-12.5, 0, Some(Cause::EncoderSwapped)),
    ] {
        assert_eq!(
            scale::encoder(1e-6 * um, home, &EXPECTED),
            cause,
            "{um} µm, {home}"
        );
    }
}

/// Telemetry of a play with the reference and the pressure of each tick, and the travel \[m\].
fn played(of: impl Iterator<Item = (f64, f64, f64)>) -> Vec<Telemetry> {
    of.map(|(reference_pa, pressure_pa, travel_m)| {
        let count = f64::from(EXPECTED.pressure_sensor.zero_count)
            + pressure_pa / f64::from(EXPECTED.pressure_sensor.per_count);
        let counts = travel_m / f64::from(EXPECTED.encoder_m_per_count);
        let mut tick = tick(2048.0, count, counts.round() as i32);
        let reference = GaugePa(reference_pa as f32);
        tick.output = Output {
            valve: EXPECTED.valve_drive.count(reference),
            mode: Mode::Playing,
            pressure_ref: reference,
            ..Output::default()
        };
        tick
    })
    .collect()
}

fn staircase(pressure_pa: impl Fn(f64) -> f64) -> Curve {
    let levels = (0..=8)
        .chain((0..8).rev())
        .map(|step| 6e4 * f64::from(step));
    let ticks = levels.flat_map(|level_pa| {
        let point = (level_pa, pressure_pa(level_pa), 0.0);
        std::iter::repeat_n(point, 60)
    });
    curve(&EXPECTED, &played(ticks))
}

#[test]
fn a_staircase_tells_gain_and_supply() {
    let right = staircase(|reference_pa| reference_pa);
    // The counts of DAC and converter are 122 and 214 Pa.
    assert!((right.gain - 1.0).abs() < 1e-3 && right.offset_pa.abs() < 200.0);
    assert_eq!((right.levels.len(), right.supply_pa), (17, None));
    assert_eq!(valve(&right, 5e5), None);
    let down = right.levels.iter().filter(|level: &&CurveLevel| level.down);
    assert_eq!(down.count(), 8);

    let low = staircase(|reference_pa| reference_pa.min(2.5e5));
    assert!((low.gain - 1.0).abs() < 1e-2, "{}", low.gain);
    assert!(low.supply_pa.is_some_and(|pa| (pa - 2.5e5).abs() < 300.0));
    assert_eq!(valve(&low, 5e5), Some(Cause::LowSupply));
    assert_eq!(valve(&low, 2.5e5), None);

    let weak = staircase(|reference_pa| 0.7 * reference_pa);
    assert!((weak.gain - 0.7).abs() < 1e-3);
    assert_eq!(valve(&weak, 5e5), Some(Cause::AmplifierGain));
    let cause = |curve: Curve| valve(&curve, 5e5);
    assert_eq!(cause(staircase(|_| 0.0)), Some(Cause::NoAir));
    assert_eq!(cause(staircase(|_| 2e5)), Some(Cause::ValveStuck));
    let reversed = staircase(|reference_pa| 5e5 - reference_pa);
    assert_eq!(cause(reversed), Some(Cause::ValveReversed));
    assert_eq!(
        (at_zero(1e4), at_zero(5e5)),
        (None, Some(Cause::ValveReversed))
    );
}

fn known() -> Known {
    Known {
        values: EXPECTED,
        muscle_sd: [0.01, 0.01, 0.02],
    }
}

/// A lift of `mass_kg` by Eq 1 without inertia: the travel follows the balance with Coulomb
/// friction of 5 N, which is the static one, too. The pressure is `drive` of its reference; what is
/// read differs by the factors `sensor` and `encoder`.
fn slow_lift(mass_kg: f64, drive: f64, sensor: f64, encoder: f64) -> Lift {
    let muscle = EXPECTED.muscle;
    let friction_n = 5.0;
    let balance_m = |pressure_pa: f64, friction_n: f64| {
        let force_n = mass_kg * 9.806_65 + friction_n - f64::from(muscle.gamma_n);
        let area_m2 = force_n / pressure_pa - f64::from(muscle.beta_m2);
        let share = (area_m2 / f64::from(muscle.alpha_m2)).sqrt();
        f64::from(muscle.initial_length_m) * (1.0 - share)
    };
    let mut travel_m: f64 = 0.0;
    let mut points = vec![];
    let (mut reference_pa, mut rising) = (5e4, true);
    while reference_pa > 4.9e4 {
        reference_pa += if rising { 50.0 } else { -50.0 };
        let pressure_pa = drive * reference_pa;
        let upper_m = balance_m(pressure_pa, friction_n).max(0.0);
        let lower_m = balance_m(pressure_pa, -friction_n).max(0.0);
        travel_m = travel_m.clamp(upper_m.min(lower_m), upper_m.max(lower_m));
        rising = rising && travel_m < TOP_M && reference_pa < 3e5;
        points.push((reference_pa, sensor * pressure_pa, encoder * travel_m));
    }
    lift(&known(), &played(points.into_iter()))
}

#[test]
fn a_lift_weighs_and_tells_what_contradicts_the_settings() {
    let right = slow_lift(12.0, 1.0, 1.0, 1.0);
    // Half a count of the pressure is 0.25 N, and the travel of Eq 1 is not quite a line.
    let mass_kg = right.mass_kg.expect("lifted");
    assert!((mass_kg - 12.0).abs() < 0.05, "{mass_kg}");
    assert!((right.coulomb_n - 5.0).abs() < 0.4, "{}", right.coulomb_n);
    let (static_n, sd_n) = right.static_friction();
    assert!(
        (static_n - 5.0).abs() < 0.8 && sd_n < 1.0,
        "{static_n} {sd_n}"
    );
    assert!(
        (right.travel_ratio - 1.0).abs() < 0.1,
        "{}",
        right.travel_ratio
    );
    let cause = |lift: &Lift| contradiction(&known(), lift, false);
    assert_eq!(cause(&right), None);
    for (lift, expected) in [
        (slow_lift(6.0, 1.0, 1.0, 1.0), Cause::LoadLighter),
        (slow_lift(15.0, 1.0, 1.0, 1.0), Cause::LoadHeavier),
        (slow_lift(12.0, 0.7, 1.0, 1.0), Cause::AmplifierGain),
        (slow_lift(12.0, 1.4, 1.0, 1.0), Cause::AmplifierGain),
        (slow_lift(12.0, 1.0, 0.8, 1.0), Cause::PressureScale),
        (slow_lift(12.0, 1.0, 1.2, 1.0), Cause::PressureScale),
        (slow_lift(12.0, 1.0, 1.0, 0.5), Cause::Travel),
        (slow_lift(12.0, 1.0, 1.0, 2.0), Cause::Travel),
        (slow_lift(12.0, 1.0, 1.0, -1.0), Cause::EncoderSwapped),
        (slow_lift(12.0, 1.0, 1.0, 0.0), Cause::NotLifted),
        (slow_lift(12.0, 0.0, 1.0, 1.0), Cause::NoAir),
    ] {
        assert_eq!(cause(&lift), Some(expected), "{:?}", lift.mass_kg);
    }
    // The amplifier is known by then: what is missing leaks.
    let leaks = slow_lift(12.0, 0.9, 1.0, 1.0);
    assert_eq!(
        contradiction(&known(), &leaks, true),
        Some(Cause::MuscleLeak)
    );
}

/// If a board keeps its trial settings by accident, the weight does not rise by 10 mm: above
/// `contraction_max` the pressure may only fall, and above `contraction_trip` the board vents.
#[test]
fn trial_settings_pass_and_bound_the_travel() {
    for (values, top_m) in [
        (plugged(limited(EXPECTED, 5e5)), 0.003),
        (plugged(limited(EXPECTED, 2.5e5)), 0.003),
        (lifting(limited(EXPECTED, 5e5)), 0.0045),
    ] {
        let values = *Settings::new(values).expect("settings that pass").values();
        let length_m = values.muscle.initial_length_m;
        assert!((values.contraction_max * length_m - top_m).abs() < 1e-5);
        assert!(values.contraction_trip * length_m < 0.007);
        assert_eq!(values.play_pressure_pa_max, values.pressure_pa_max);
        // All that watches the sensors, the speed and the stop stays.
        let kept = SettingsValues {
            contraction_max: EXPECTED.contraction_max,
            contraction_trip: EXPECTED.contraction_trip,
            play_pressure_pa_max: EXPECTED.play_pressure_pa_max,
            force_error_n_max: EXPECTED.force_error_n_max,
            pressure_error_pa_max: EXPECTED.pressure_error_pa_max,
            ..values
        };
        assert_eq!(kept, limited(EXPECTED, values.supply_pressure_pa.into()));
    }
}

#[test]
fn limits_follow_the_supply_the_amplifier_and_the_sensor() {
    let limited = |change: fn(&mut SettingsValues), supply_pa| {
        let mut values = EXPECTED;
        change(&mut values);
        *Settings::new(limited(values, supply_pa))
            .expect("settings that pass")
            .values()
    };
    assert_eq!(limited(|_| {}, 3e5).pressure_pa_max, 3e5);
    assert_eq!(limited(|_| {}, 6e5).pressure_pa_max, 5e5);
    let weak = limited(|values| values.valve_drive.amplifier_gain *= 0.7, 5e5);
    assert!((weak.pressure_pa_max - 3.5e5).abs() < 10.0);
    // 400 kPa at the end of the scale.
    let small = limited(|values| values.pressure_sensor.per_count *= 0.5, 5e5);
    assert!(small.pressure_trip_pa < small.pressure_sensor.ends().1);
    assert!(small.pressure_pa_max > 3.3e5 && small.pressure_pa_max < small.pressure_trip_pa);
}

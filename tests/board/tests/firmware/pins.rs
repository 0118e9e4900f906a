//! Every pin has the function that docs/wiring.md states.

use crate::rig::{BRIDGE, BUTTON, PRESSURE, Rig, volts};
use emulated_board::{Imperfection, pin};
use hil_sim::commission::readings::SECOND_TICKS;
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::Mode;

/// Inputs 1 and 2 of TIM5.
const TIM5_CCMR1: u32 = 0x4000_0c18;
/// Input levels of port A.
const GPIOA_IDR: u32 = 0x4002_0010;
/// Conversions of each input in a tick.
const CONVERSIONS: f64 = 16.0;
/// Counts of the internal reference at 3.3 V.
const REFERENCE: f64 = 1502.0;

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn sensor_voltages_are_read_exactly_to_the_count() {
    let mut rig = Rig::after_ms(15);
    for (bridge, pressure) in [(0, 4095), (1, 2), (2048, 409), (3333, 1234), (4095, 0)] {
        rig.board.set_analog(BRIDGE, volts(bridge));
        rig.board.set_analog(PRESSURE, volts(pressure));
        rig.board.run_for(25_000_000);
        let sensors = rig.telemetry().pop().expect("telemetry").sensors;
        assert_eq!(
            (sensors.bridge, sensors.pressure),
            (AdcCount(bridge), AdcCount(pressure))
        );
    }
    rig.assert_no_errors();
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn encoder_counts_in_both_directions_from_its_position_at_reset() {
    let mut rig = Rig::after_ms(15);
    for position in [1, 5, -1, -70_000, 70_000, i64::from(i32::MAX), 0] {
        rig.board.set_encoder(position);
        let counted = rig.last_telemetry().sensors.encoder;
        assert_eq!(counted, EncoderCount(position as i32 as u32));
    }
    rig.board.set_encoder(1_000);
    rig.board.reset_pin();
    rig.run_ms(50);
    rig.board.set_encoder(1_010);
    assert_eq!(rig.last_telemetry().sensors.encoder, EncoderCount(10));
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn encoder_with_swapped_or_disconnected_wires_is_detected() {
    let mut rig = Rig::after_ms(15);
    rig.board.wire_encoder(pin('A', 1), pin('A', 0));
    rig.board.set_encoder(100);
    assert_eq!(
        rig.last_telemetry().sensors.encoder,
        EncoderCount(-100_i32 as u32)
    );
    rig.board.wire_encoder(pin('A', 0), pin('B', 9));
    rig.board.set_encoder(200);
    assert_eq!(
        rig.last_telemetry().sensors.encoder,
        EncoderCount(-100_i32 as u32)
    );
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn button_starts_assisting_and_the_link_stops_it() {
    let mut rig = Rig::after_ms(1_500);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    rig.board.set_level(BUTTON, Some(false));
    rig.run_ms(60);
    rig.board.set_level(BUTTON, Some(true));
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    rig.send(&ToDevice::Command(Command::Request(Request::Vent)));
    assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
    rig.assert_no_errors();
}

/// A wire of the encoder breaks: its input keeps one level and does not count what it picks up.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn encoder_inputs_are_pulled_up() {
    let mut rig = Rig::after_ms(15);
    assert_eq!(rig.board.read_register(GPIOA_IDR) & 3, 3);
    for number in [0, 1] {
        rig.board.set_level(pin('A', number), Some(false));
    }
    assert_eq!(rig.board.read_register(GPIOA_IDR) & 3, 0);
}

/// Noise of ±40 counts in each conversion, 23 counts rms, is reduced by the mean of all of them.
/// The converter's offset is in the reference, too.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn readings_are_the_mean_of_all_conversions_of_a_tick() {
    let mut rig = Rig::after_ms(15);
    rig.board.set_converter(Imperfection {
        offset_counts: 3.0,
        noise_counts: 40.0,
        ..Imperfection::default()
    });
    rig.board.set_analog(BRIDGE, volts(2000));
    rig.board.set_analog(PRESSURE, volts(1000));
    // The mean of the reference has a time constant of 0.64 s.
    rig.board.run_for(5_000_000_000);
    rig.telemetry();
    rig.board.run_for(4_000_000_000);
    let telemetry = rig.telemetry();
    let readings: [Vec<f64>; 2] = [
        telemetry
            .iter()
            .map(|t| f64::from(t.sensors.bridge.0))
            .collect(),
        telemetry
            .iter()
            .map(|t| f64::from(t.sensors.pressure.0))
            .collect(),
    ];
    for (readings, expected) in readings.iter().zip([2003.0, 1003.0]) {
        let expected = expected * REFERENCE / (REFERENCE + 3.0);
        let count = readings.len() as f64;
        let mean = readings.iter().sum::<f64>() / count;
        let square = readings.iter().map(|r| (r - mean).powi(2)).sum::<f64>();
        let (deviation, single) = ((square / count).sqrt(), 40.0 / 3_f64.sqrt());
        println!("mean {mean:.2}, standard deviation {deviation:.2}");
        // Of 400 readings the mean is within four of its standard errors, and the standard
        // deviation within 15 %, also with the rounding's. The reference's mean over 64 ticks has
        // 1/127 of the variance of one.
        let expected_deviation = single / CONVERSIONS.sqrt();
        let of_reference = expected_deviation / 127_f64.sqrt() * expected / REFERENCE;
        let error = (expected_deviation.powi(2) / count + of_reference.powi(2)).sqrt();
        assert!((mean - expected).abs() < 4.0 * error);
        assert!((deviation / expected_deviation - 1.0).abs() < 0.15);
    }
}

/// A wire to another button breaks: the input reads «not pressed».
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn button_without_its_wire_is_not_pressed() {
    let mut rig = Rig::after_ms(1_500);
    rig.board.set_level(BUTTON, None);
    rig.run_ms(100);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
}

/// The sensors' voltages stay, the converter's supply changes.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn readings_do_not_depend_on_the_supply_of_the_converter() {
    for vref_volts in [3.1, 3.5] {
        let mut rig = Rig::after_ms(15);
        rig.board.set_analog(BRIDGE, volts(2000));
        rig.board.set_analog(PRESSURE, volts(1000));
        rig.board.set_converter(Imperfection {
            vref_volts,
            ..Imperfection::default()
        });
        rig.board.run_for(5_000_000_000);
        let sensors = rig.telemetry().pop().expect("telemetry").sensors;
        let off = [
            i32::from(sensors.bridge.0) - 2000,
            i32::from(sensors.pressure.0) - 1000,
        ];
        assert!(
            off.iter().all(|off| off.abs() <= 2),
            "{vref_volts} V: {off:?}"
        );
    }
}

/// A ripple of the bridge: what is left of it in the readings is the response of a mean over 10 ms.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn ripple_is_averaged_over_the_whole_period() {
    const AMPLITUDE: f64 = 400.0;
    for frequency_hz in [60.0, 99.9, 145.0, 245.0] {
        let mut rig = Rig::after_ms(15);
        let mut readings = vec![];
        let begun_ns = rig.board.time_ns();
        for step in 0..20_000_u64 {
            let time_s = step as f64 * 1e-4;
            let phase = std::f64::consts::TAU * frequency_hz * time_s;
            let count = 2048.0 + AMPLITUDE * phase.sin();
            rig.board.set_analog(BRIDGE, count * 3.3 / 4095.0);
            rig.board.run_until(begun_ns + (step + 1) * 100_000);
            readings.extend(
                rig.telemetry()
                    .iter()
                    .map(|t| f64::from(t.sensors.bridge.0)),
            );
        }
        let readings = &readings[2..];
        let mean = readings.iter().sum::<f64>() / readings.len() as f64;
        let square = readings.iter().map(|r| (r - mean).powi(2)).sum::<f64>();
        let left = (2.0 * square / readings.len() as f64).sqrt() / AMPLITUDE;
        // The mean of sixteen samples, 0.625 ms apart.
        let x = std::f64::consts::PI * frequency_hz * 0.01 / CONVERSIONS;
        let expected = ((CONVERSIONS * x).sin() / (CONVERSIONS * x.sin())).abs();
        println!("{frequency_hz} Hz: {left:.4}, expected {expected:.4}");
        // A count of rounding is 0.0025, and the steps of the signal are a sixth of a sample apart.
        assert!((left - expected).abs() < 0.01, "{frequency_hz} Hz: {left}");
    }
}

/// What commissioning takes for zeros and scales: means over a second, whole periods of the mains.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn means_over_a_second_are_free_of_mains() {
    const AMPLITUDE: f64 = 400.0;
    for frequency_hz in [50.0, 60.0] {
        let mut rig = Rig::after_ms(15);
        let mut readings = vec![];
        let begun_ns = rig.board.time_ns();
        for step in 0..12_000_u64 {
            let phase = std::f64::consts::TAU * frequency_hz * step as f64 * 1e-4;
            let count = 2048.0 + AMPLITUDE * phase.sin();
            rig.board.set_analog(BRIDGE, count * 3.3 / 4095.0);
            rig.board.run_until(begun_ns + (step + 1) * 100_000);
            let telemetry = rig.telemetry();
            readings.extend(telemetry.iter().map(|t| f64::from(t.sensors.bridge.0)));
        }
        let second = &readings[2..2 + SECOND_TICKS];
        let mean = second.iter().sum::<f64>() / second.len() as f64;
        println!("{frequency_hz} Hz: {:.3} counts", mean - 2048.0);
        // The reference is rounded to a count: 0.03 % of the reading.
        assert!((mean - 2048.0).abs() < 1.0, "{frequency_hz} Hz: {mean}");
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn encoder_inputs_are_filtered() {
    let mut rig = Rig::after_ms(15);
    let filters = rig.board.read_register(TIM5_CCMR1) & 0xf0f0;
    assert_eq!(filters, 0xf0f0, "f/32, eight samples, for both inputs");
}

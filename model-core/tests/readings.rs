//! The controller with every count that its converters can read, in every mode.

use model_core::controller::Controller;
use model_core::io::{Output, Request, Sensors};
use model_core::limits::ADC_VALID;
use model_core::plausibility::Doubt;
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, COUNT_MAX, EncoderCount};
use model_core::supervisor::{Fault, Mode};

/// Ticks in which a reading stays as it is: more than it may be suspect.
const TICKS: u32 = 6;

fn values() -> SettingsValues {
    SettingsValues {
        play_pressure_pa_max: 4e5,
        ..SettingsValues::reference()
    }
}

/// A rig on its stop at a pressure, after a tick with this output, with a flicker of a count as
/// from noise.
fn sensors(tick: u32, before: &Output, pressure_pa: f32, request: Request) -> Sensors {
    let flicker = (tick % 2) as u16;
    Sensors {
        bridge: AdcCount(values().bridge.count(0.5).0 + flicker),
        pressure: AdcCount(values().pressure_sensor.count(pressure_pa).0 + flicker),
        encoder: EncoderCount(0),
        read_back: AdcCount(before.valve.get()),
        missed_ticks: 0,
        request,
    }
}

/// A controller in `mode` with its last output, on the stop; the pressure is the reference.
fn in_mode(mode: Mode) -> (Controller, Output) {
    let settings = Settings::new(values()).expect("valid settings");
    let mut controller = Controller::new(settings);
    let mut output = controller.tick(&sensors(0, &Output::default(), 0.0, Request::None));
    for tick in 1..200 {
        let request = match (mode, output.mode) {
            (Mode::SelfCheck, _) if tick > 10 => break,
            (Mode::Ready, Mode::Ready) => break,
            (Mode::Playing, Mode::Ready | Mode::Playing) => Request::Play(100_000),
            (_, Mode::Ready) => Request::Assist,
            (Mode::Holding, Mode::Assisting) if tick > 100 => Request::Hold,
            (Mode::Venting, Mode::Assisting) if tick > 100 => Request::Vent,
            _ => Request::None,
        };
        output = controller.tick(&sensors(tick, &output, output.pressure_ref.0, request));
        assert_eq!(output.fault, None);
        if output.mode == mode && tick > 100 {
            break;
        }
    }
    assert_eq!(output.mode, mode);
    (controller, output)
}

/// Where a step of the reference may lead in a tick.
fn is_within_its_rate(values: &SettingsValues, before: &Output, after: &Output) -> bool {
    let rate_pa_per_s = values.muscle.moving_rate_pa_per_s(
        values.reference_speed_m_per_s_max,
        after.contraction.clamp(0.0, values.contraction_max),
        before.pressure_ref,
    );
    let step_pa = after.pressure_ref.0 - before.pressure_ref.0;
    step_pa.abs() <= 0.01 * rate_pa_per_s + 0.1
}

/// Whatever a converter reads, the reference is one that the settings allow, and moves no faster
/// than they do; a count at an end of the scale raises it in no mode and is a fault in time.
#[test]
fn every_count_in_every_mode_leaves_the_reference_within_its_limits() {
    let values = values();
    type Set = fn(&mut Sensors, u16);
    let read: [(Set, Fault); 2] = [
        (
            |sensors, count| sensors.bridge = AdcCount(count),
            Fault::Bridge(Doubt::Range),
        ),
        (
            |sensors, count| sensors.pressure = AdcCount(count),
            Fault::Pressure(Doubt::Range),
        ),
    ];
    for (mode, _) in Mode::NAMED {
        let (begun, first) = in_mode(*mode);
        for (set, fault) in read {
            for count in 0..=COUNT_MAX {
                let (mut controller, mut before) = (begun, first);
                let open = !ADC_VALID.contains(&count);
                for tick in 0..TICKS {
                    let request = match mode {
                        Mode::Playing => Request::Play(200_000),
                        _ => Request::None,
                    };
                    let mut read = sensors(tick, &before, first.pressure_ref.0, request);
                    set(&mut read, count);
                    let after = controller.tick(&read);
                    let reference = after.pressure_ref;
                    let allowed = GaugePa(0.0)..=GaugePa(values.pressure_pa_max);
                    assert!(
                        allowed.contains(&reference),
                        "{mode:?}, {count}: {reference:?}"
                    );
                    assert!(
                        is_within_its_rate(&values, &before, &after),
                        "{mode:?}, {count}: {before:?}, {after:?}"
                    );
                    if open {
                        assert!(reference.0 <= before.pressure_ref.0, "{mode:?}, {count}");
                    }
                    before = after;
                }
                if open {
                    let expected = (Mode::Venting, Some(fault));
                    assert_eq!((before.mode, before.fault), expected, "{mode:?}, {count}");
                }
            }
        }
    }
}

/// Whatever is read back of the valve's voltage: what may not be is a fault in the third tick in
/// every mode, and the reference moves no faster than the settings allow.
#[test]
fn every_count_of_the_valves_voltage_is_judged_in_every_mode() {
    let values = values();
    for (mode, _) in Mode::NAMED {
        let (begun, first) = in_mode(*mode);
        for count in 0..=COUNT_MAX {
            let (mut controller, mut before) = (begun, first);
            // In a row, and the most of them.
            let (mut wrong, mut most) = (0, 0);
            for tick in 0..TICKS {
                let mut read = sensors(tick, &before, first.pressure_ref.0, Request::None);
                read.read_back = AdcCount(count);
                let is_wrong = !before.valve.may_be_read_as(read.read_back);
                wrong = if is_wrong { wrong + 1 } else { 0 };
                most = most.max(wrong);
                let after = controller.tick(&read);
                assert!(
                    is_within_its_rate(&values, &before, &after),
                    "{mode:?}, {count}: {before:?}, {after:?}"
                );
                if wrong >= 3 {
                    let expected = (Mode::Venting, Some(Fault::ValveVoltage));
                    assert_eq!((after.mode, after.fault), expected, "{mode:?}, {count}");
                    assert!(after.pressure_ref.0 <= before.pressure_ref.0);
                }
                before = after;
            }
            assert!(most > 0 || before.fault.is_none(), "{mode:?}, {count}");
        }
    }
}

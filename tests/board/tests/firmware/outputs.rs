//! The emergency stop, the pulses for the valve in the muscle's port, and the status lamp.

use crate::faults::DEVICE;
use crate::rig::{ENABLING, LAMP, MS, PORT, Rig, STOP, TICK_NS};
use emulated_board::Imperfection;
use model_core::device::{Command, Device};
use model_core::io::{Request, Sensors};
use model_core::lamp;
use model_core::link::ToDevice;
use model_core::settings::SettingsValues;
use model_core::signal::AdcCount;
use model_core::supervisor::{Fault, Mode};

/// Pull-up and pull-down registers of ports A and B, and the field of a pin that is pulled down.
const PUPDR: [u32; 2] = [0x4002_000c, 0x4002_040c];
const PULLED_DOWN: u32 = 2;

fn assisting() -> Rig {
    let mut rig = Rig::after_ms(1_000);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(300);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    rig
}

/// Count of the edges of the pulses in `ms`.
fn edges(rig: &mut Rig, ms: u64) -> usize {
    let mut levels = vec![rig.board.level(PORT) == Some(true)];
    for _ in 0..ms {
        rig.run_ms(1);
        levels.push(rig.board.level(PORT) == Some(true));
    }
    levels.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn each_tick_has_an_edge_for_the_valve_in_the_port_once_the_self_check_has_passed() {
    let mut rig = Rig::after_ms(100);
    assert_eq!(rig.last_telemetry().output.mode, Mode::SelfCheck);
    assert_eq!(edges(&mut rig, 100), 0);
    rig.run_ms(900);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    assert_eq!(edges(&mut rig, 1_000), 100);
    rig.assert_no_errors();
}

/// Neither a hanging tick, with the pin at either level, nor the reset that follows has an edge.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn edges_end_with_the_ticks() {
    for level in [true, false] {
        let mut rig = assisting();
        while rig.board.level(PORT) != Some(level) {
            rig.run_ms(1);
        }
        rig.board.hold_core(true);
        assert_eq!(edges(&mut rig, 40), 0);
        rig.board.run_for(60 * MS);
        assert_eq!(rig.board.resets().len(), 1);
        rig.board.hold_core(false);
        // After the reset the valve is at its exhaust, and the port stays closed.
        assert_eq!(edges(&mut rig, 100), 0);
    }
}

/// Pressed, and each wire broken: an open wire is pulled down.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn emergency_stop_and_each_of_its_wires_let_the_weight_down() {
    for open in [&STOP[..], &STOP[..1], &STOP[1..]] {
        let mut rig = assisting();
        for contact in open {
            rig.board.set_level(*contact, None);
        }
        rig.run_ms(3 * TICK_NS / MS);
        let output = rig.last_telemetry().output;
        assert_eq!(
            (output.mode, output.fault),
            (Mode::Venting, Some(Fault::EmergencyStop))
        );
        rig.assert_no_errors();
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn inputs_of_the_emergency_stop_are_pulled_down() {
    let mut rig = Rig::after_ms(15);
    for contact in STOP {
        let word = rig.board.read_register(PUPDR[usize::from(contact.port)]);
        assert_eq!(word >> (2 * contact.number) & 3, PULLED_DOWN, "{contact}");
    }
}

/// The lamp is that of model-core in each tick.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn lamp_shows_the_mode() {
    let mut rig = Rig::new();
    rig.run_ms(15);
    let mut seen = [false; 2];
    for _ in 0..150 {
        rig.run_ms(10);
        let last = rig.telemetry().pop().expect("telemetry");
        let output = last.output;
        let expected = lamp::is_lit(output.mode, output.fault, Request::None, false, last.tick);
        assert_eq!(rig.board.level(LAMP), Some(expected), "tick {}", last.tick);
        seen[usize::from(expected)] = true;
    }
    assert_eq!(seen, [true, true]);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn enabling_device_begins_and_ends_what_moves() {
    let mut rig = Rig::after_ms(100);
    rig.store(SettingsValues {
        enabling_device: 1,
        ..SettingsValues::reference()
    });
    rig.run_ms(1_000);
    let assist = ToDevice::Command(Command::Request(Request::Assist));
    // The input is pulled down: a missing plug is a hand that has let go.
    rig.send(&assist);
    rig.run_ms(50);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Ready);
    rig.board.set_level(ENABLING, Some(true));
    rig.run_ms(100);
    rig.send(&assist);
    rig.run_ms(300);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    rig.board.set_level(ENABLING, Some(false));
    rig.run_ms(30);
    let output = rig.last_telemetry().output;
    assert_eq!((output.mode, output.fault), (Mode::Venting, None));
    rig.assert_no_errors();
}

/// All that the device knows is overwritten with zeros: the weight is let down from the measured
/// pressure, at 200 kPa/s, and nothing begins after it.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn memory_that_is_overwritten_lets_the_weight_down() {
    let mut rig = assisting();
    let pressure = SettingsValues::reference().pressure_sensor.count(2e5);
    let device = rig.board.symbol_with(DEVICE).expect("the device");
    // After a tick.
    rig.next_tick_ns();
    rig.board.run_for(MS);
    rig.apply(&Sensors {
        bridge: AdcCount(2048),
        pressure,
        ..Sensors::default()
    });
    rig.board.write_ram(device, &[0; size_of::<Device>()]);
    // Without the noise of a sensor at rest.
    rig.board.run_for(30 * MS);
    // 200 kPa are 1.32 V, and each tick of the ramp takes 13 mV.
    let volts = rig.board.dac_volts(1);
    assert!((1.26..=1.32).contains(&volts), "{volts} V");
    let output = rig.last_telemetry().output;
    let expected = (Mode::Venting, Some(Fault::Memory));
    assert_eq!((output.mode, output.fault), expected);
    for request in [Request::Reset, Request::Assist, Request::Reset] {
        rig.run_ms(300);
        rig.send(&ToDevice::Command(Command::Request(request)));
    }
    assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
    rig.assert_no_errors();
}

/// Another voltage than the one that was set: in the third tick the weight is let down along the
/// ramp, and the port closes.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn voltage_of_the_valve_that_was_not_set_lets_the_weight_down() {
    for off_volts in [-0.1, 0.1] {
        let mut rig = assisting();
        rig.run_ms(700);
        let set_volts = rig.board.dac_volts(1);
        assert!(set_volts > 0.4, "{set_volts} V");
        rig.next_tick_ns();
        rig.run_ms(3);
        rig.telemetry();
        rig.board.load_valve(Some(set_volts + off_volts));
        rig.run_ms(50);
        let faults: Vec<_> = rig.telemetry().iter().map(|t| t.output.fault).collect();
        let latched = Some(Fault::ValveVoltage);
        assert_eq!(faults[..3], [None, None, latched], "{off_volts} V");
        // 200 kPa/s are 13 mV in a tick.
        let volts = rig.board.dac_volts(1);
        assert!((set_volts - 0.1..set_volts).contains(&volts), "{volts} V");
        assert_eq!(rig.last_telemetry().output.mode, Mode::Venting);
        assert_eq!(edges(&mut rig, 100), 0);
        rig.assert_no_errors();
    }
}

/// What converters, the resistor at the amplifier and the supply do to it is none of that.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn voltage_of_the_valve_may_be_off_as_its_converters_are() {
    for (offset_counts, share, vref_volts) in [(10.0, 1.0, 3.1), (-10.0, 0.97, 3.3)] {
        let mut rig = Rig::new();
        rig.board.set_converter(Imperfection {
            offset_counts,
            noise_counts: 5.0,
            vref_volts,
        });
        rig.run_ms(1_000);
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(1_000);
        let set_volts = rig.board.dac_volts(1);
        assert!(set_volts > 0.4, "{set_volts} V");
        rig.board.load_valve(Some(share * set_volts));
        rig.run_ms(1_000);
        let output = rig.last_telemetry().output;
        assert_eq!((output.mode, output.fault), (Mode::Assisting, None));
        rig.assert_no_errors();
    }
}

//! The self-tests at the start and in the background: each thing that can be wrong, and what the
//! board then does.

use crate::rig::{LAMP, MS, Rig, TICK_NS};
use crate::timing::ticks;
use emulated_board::{Board, Imperfection, Oscillators};
use model_core::device::Command;
use model_core::io::Request;
use model_core::link::{IMAGE_CHECKSUM_AT, IMAGE_LENGTH_AT, ToDevice};
use model_core::start::StartFault;
use model_core::supervisor::{Fault, Mode};

const FLASH: u32 = 0x0800_0000;
/// Pattern with which cortex-m-rt fills the stack.
const PAINT: [u8; 4] = [0xCC; 4];

/// The fault reported after a reset with `change`, and the mode that a request to assist ends in.
fn started(change: impl Fn(&mut Board)) -> (Option<StartFault>, Mode) {
    let mut rig = Rig::new();
    change(&mut rig.board);
    rig.run_ms(1_200);
    let fault = rig.identity().start;
    for request in [Request::Reset, Request::Assist] {
        rig.send(&ToDevice::Command(Command::Request(request)));
        rig.run_ms(100);
    }
    let output = rig.last_telemetry().output;
    let latched = fault.filter(|fault| fault.prevents_assistance());
    assert_eq!(output.fault, latched.map(Fault::Start));
    if latched.is_some() {
        assert_eq!((output.valve.get(), rig.board.dac_volts(1)), (0, 0.0));
    }
    rig.assert_no_errors();
    (fault, output.mode)
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn healthy_board_starts_and_its_valve_has_no_time_to_open() {
    assert_eq!(started(|_| {}), (None, Mode::Assisting));
    let rig = &mut Rig::after_ms(100);
    let events = rig.board.dac_events();
    let raised: Vec<_> = events.iter().filter(|e| e.volts > Some(0.0)).collect();
    let [raised] = raised[..] else {
        panic!("{events:?}")
    };
    assert!(raised.volts < Some(0.42), "{raised:?}");
    let lowered = events.iter().find(|e| e.time_ns > raised.time_ns);
    let raised_ns = lowered.expect("0 V again").time_ns - raised.time_ns;
    assert!(raised_ns < MS / 5, "{raised_ns} ns");
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn valve_that_does_not_have_its_voltage_prevents_assistance() {
    let expected = (Some(StartFault::ValveVoltage), Mode::Venting);
    // Shorted to ground or to the supply; an offset; a load of 100 kΩ at the 15 kΩ of the output.
    for volts in [0.0, 3.3, 0.05, 0.36] {
        assert_eq!(
            started(|board| board.load_valve(Some(volts))),
            expected,
            "{volts} V"
        );
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn supply_that_is_off_by_more_than_ten_percent_prevents_assistance() {
    let faulty = (Some(StartFault::Supply), Mode::Venting);
    let healthy = (None, Mode::Assisting);
    // A count of the reference is 2 mV of the supply.
    for (vref_volts, expected) in [
        (2.965, faulty),
        (2.975, healthy),
        (3.625, healthy),
        (3.635, faulty),
    ] {
        let off = Imperfection {
            vref_volts,
            ..Imperfection::default()
        };
        assert_eq!(
            started(|board| board.set_converter(off)),
            expected,
            "{vref_volts} V"
        );
    }
}

/// The CPU's clock is raised when the regulator is ready, and not before, however long it takes.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn clock_waits_for_the_regulator() {
    for regulator_ns in [0, 10_000, 1_000_000, 3_000_000] {
        let seen = started(|board| board.set_regulator_ns(Some(regulator_ns)));
        assert_eq!(seen, (None, Mode::Assisting), "{regulator_ns} ns");
    }
}

/// The wait is bounded. The link tells the reason, at a clock that the voltage may not allow: the
/// valve stays at 0 V.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn regulator_that_does_not_get_ready_prevents_assistance() {
    let mut rig = Rig::new();
    rig.board.set_regulator_ns(None);
    rig.run_ms(1_200);
    assert_eq!(rig.identity().start, Some(StartFault::Supply));
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(100);
    let output = rig.last_telemetry().output;
    let (mode, fault) = (output.mode, output.fault);
    assert_eq!(fault, Some(Fault::Start(StartFault::Supply)));
    assert_eq!((mode, rig.board.dac_volts(1)), (Mode::Venting, 0.0));
    let errors = rig.board.errors();
    let of_the_voltage = errors.iter().all(|e| e.text.starts_with("PWR: "));
    assert!(of_the_voltage, "{}", rig.board.error_report());
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn stuck_bit_in_any_part_of_the_ram_prevents_assistance() {
    let expected = (Some(StartFault::Ram), Mode::Venting);
    // The stack's end, between statics and the end of the RAM, and its last word.
    for address in [0x2000_0100, 0x2001_0000, 0x2001_fffc] {
        for bits in [1, 1 << 31] {
            let seen = started(|board| board.stick_ram(address, bits));
            assert_eq!(seen, expected, "{address:#x}, {bits:#x}");
        }
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn stack_without_its_pattern_prevents_assistance() {
    let seen = started(|board| {
        let end = board.symbol("_stack_end").expect("a symbol of memory.x");
        while board.read_memory(end, 4) != PAINT {
            board.run_for(MS / 100);
        }
        board.run_for(MS / 2);
        board.write_ram(end, &[0; 4]);
    });
    assert_eq!(seen, (Some(StartFault::Stack), Mode::Venting));
}

/// Length and checksum that scripts/seal-image.sh writes into the image: as bytes of the flash.
fn seal() -> [[u8; 4]; 2] {
    let path = std::env::var_os("FIRMWARE").expect("FIRMWARE: the path of the firmware's ELF");
    let folder = tempfile::tempdir().expect("a folder");
    let elf = folder.path().join("firmware");
    std::fs::copy(path, &elf).expect("a copy of the image");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scripts/seal-image.sh");
    let status = std::process::Command::new(script).arg(&elf).status();
    assert!(status.expect("the script").success());
    let sealed = Board::new(&std::fs::read(&elf).expect("the image")).expect("an image");
    [IMAGE_LENGTH_AT, IMAGE_CHECKSUM_AT].map(|at| {
        let bytes = sealed.read_memory(FLASH + at as u32, 4);
        bytes.try_into().expect("four bytes")
    })
}

/// From the reset to the start of the first tick's period, in cycles as the emulated board counts
/// them: one per instruction.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn self_test_of_a_sealed_image_ends_in_time() {
    let [length, checksum] = seal();
    let mut rig = Rig::new();
    rig.board
        .write_flash(FLASH + IMAGE_LENGTH_AT as u32, &length);
    rig.board
        .write_flash(FLASH + IMAGE_CHECKSUM_AT as u32, &checksum);
    rig.board.trace_exceptions(true);
    rig.run_ms(200);
    let first_tick_ns = ticks(&rig.board.exceptions())[0].time_ns;
    let start_ms = (first_tick_ns - TICK_NS) as f64 / MS as f64;
    println!("{:?}: {start_ms:.1} ms", rig.board.chip());
    assert!(start_ms < 15.0);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn any_changed_bit_of_a_sealed_image_prevents_assistance() {
    let [length, checksum] = seal();
    let bytes = u32::from_le_bytes(length);
    assert!((30_000..70_000).contains(&bytes), "{bytes}");
    let sealed = |board: &mut Board| {
        board.write_flash(FLASH + IMAGE_LENGTH_AT as u32, &length);
        board.write_flash(FLASH + IMAGE_CHECKSUM_AT as u32, &checksum);
    };
    assert_eq!(started(sealed), (None, Mode::Assisting));
    // A reserved word of the vector table, the last byte, the seal itself.
    for at in [
        0x28,
        bytes - 1,
        IMAGE_LENGTH_AT as u32,
        IMAGE_CHECKSUM_AT as u32,
    ] {
        let seen = started(|board| {
            sealed(board);
            let cell = board.read_memory(FLASH + at, 1)[0];
            board.write_flash(FLASH + at, &[cell ^ 1]);
        });
        assert_eq!(seen, (Some(StartFault::Image), Mode::Venting), "{at:#x}");
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn chip_that_brown_outs_do_not_reset_assists_and_warns() {
    for level in 1..4 {
        let seen = started(|board| board.set_brown_out_level(level));
        assert_eq!(
            seen,
            (Some(StartFault::BrownOut), Mode::Assisting),
            "{level}"
        );
    }
    let mut rig = Rig::new();
    rig.board.set_brown_out_level(3);
    rig.run_ms(1_200);
    let mut rises = 0;
    let mut last = rig.board.level(LAMP);
    for _ in 0..400 {
        rig.run_ms(5);
        let now = rig.board.level(LAMP);
        rises += usize::from((last, now) == (Some(false), Some(true)));
        last = now;
    }
    assert_eq!(rises, 3, "flashes in 2 s");
}

/// A board that assists, with `change` before and after that: how long it takes to find it \[ms\],
/// and what. The weight is let down along the ramp, and nothing begins after it.
fn found_while_assisting(
    before: impl Fn(&mut Board),
    after: impl Fn(&mut Board),
) -> Option<(u64, StartFault)> {
    let mut rig = Rig::new();
    before(&mut rig.board);
    rig.run_ms(1_200);
    rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
    rig.run_ms(1_000);
    assert_eq!(rig.last_telemetry().output.mode, Mode::Assisting);
    let assisting_volts = rig.board.dac_volts(1);
    assert!(assisting_volts > 0.4, "{assisting_volts} V");
    after(&mut rig.board);
    for ms in 0..5_000 {
        rig.run_ms(1);
        let telemetries = rig.telemetry();
        let Some(fault) = telemetries.iter().find_map(|t| t.output.fault) else {
            continue;
        };
        let Fault::Start(found) = fault else {
            panic!("{fault:?}")
        };
        // 200 kPa/s are 13 mV in a tick; the ramp is not skipped.
        let volts = rig.board.dac_volts(1);
        assert!(volts > assisting_volts - 0.03, "{volts} V");
        for request in [Request::Reset, Request::Assist, Request::Reset] {
            rig.run_ms(300);
            rig.send(&ToDevice::Command(Command::Request(request)));
        }
        let output = rig.last_telemetry().output;
        assert_eq!((output.mode, output.fault), (Mode::Venting, Some(fault)));
        assert_eq!(rig.board.dac_volts(1), 0.0);
        rig.assert_no_errors();
        return Some((ms, found));
    }
    None
}

/// In the stack, which interrupts use meanwhile, after the statics, and in the last word.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn bit_that_gets_stuck_while_assisting_lets_the_weight_down() {
    for address in [0x2000_0100, 0x2001_0000, 0x2001_fffc] {
        let found = found_while_assisting(|_| {}, |board| board.stick_ram(address, 1 << 7));
        let (ms, fault) = found.unwrap_or_else(|| panic!("{address:#x}: not found"));
        println!("{address:#x}: after {ms} ms");
        assert_eq!(fault, StartFault::Ram, "{address:#x}");
    }
    assert_eq!(found_while_assisting(|_| {}, |_| {}), None);
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn bit_of_the_image_that_changes_while_assisting_lets_the_weight_down() {
    let [length, checksum] = seal();
    let sealed = |board: &mut Board| {
        board.write_flash(FLASH + IMAGE_LENGTH_AT as u32, &length);
        board.write_flash(FLASH + IMAGE_CHECKSUM_AT as u32, &checksum);
    };
    let last = u32::from_le_bytes(length) - 1;
    for at in [0x28, last] {
        let found = found_while_assisting(sealed, |board| {
            let cell = board.read_memory(FLASH + at, 1)[0];
            board.write_flash(FLASH + at, &[cell ^ 1]);
        });
        let (ms, fault) = found.unwrap_or_else(|| panic!("{at:#x}: not found"));
        println!("{at:#x}: after {ms} ms");
        assert_eq!(fault, StartFault::Image, "{at:#x}");
    }
    assert_eq!(found_while_assisting(sealed, |_| {}), None);
}

fn with_slow_oscillator(board: &mut Board, lsi_hz: u64) {
    board.set_oscillators(Oscillators {
        lsi_hz,
        ..board.oscillators()
    });
}

/// The slow oscillator, which is the watchdog's, as the core's clock sees it.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn oscillator_that_changes_while_assisting_lets_the_weight_down() {
    for lsi_hz in [100, 24_000, 40_000] {
        let found = found_while_assisting(|_| {}, |board| with_slow_oscillator(board, lsi_hz));
        let (ms, fault) = found.unwrap_or_else(|| panic!("{lsi_hz} Hz: not found"));
        println!("{lsi_hz} Hz: after {ms} ms");
        assert_eq!(fault, StartFault::Clock, "{lsi_hz} Hz");
        // Two readings of 250 ms, two ticks, and the telemetry.
        assert!(ms <= 530, "{lsi_hz} Hz: {ms} ms");
    }
    for lsi_hz in [17_000, 47_000] {
        let found = found_while_assisting(|board| with_slow_oscillator(board, lsi_hz), |_| {});
        assert_eq!(found, None, "{lsi_hz} Hz");
    }
}

/// The link is lost with the core's clock, so that the valve's voltage tells.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn core_whose_clock_changes_while_assisting_lets_the_weight_down() {
    // 50.4 GHz is a multiple of each board's CPU clock for these.
    for (period_units, is_right) in [(3_276, true), (4_212, false), (2_340, false)] {
        let mut rig = Rig::after_ms(1_200);
        rig.send(&ToDevice::Command(Command::Request(Request::Assist)));
        rig.run_ms(1_000);
        rig.board.set_oscillators(Oscillators {
            hsi_hz: 50_400_000_000 / period_units,
            ..rig.board.oscillators()
        });
        // Half a second, and 2.5 s of the ramp, at a clock that is a third slower.
        rig.run_ms(4_500);
        let volts = rig.board.dac_volts(1);
        assert_eq!(volts > 0.0, is_right, "{period_units}: {volts} V");
        assert_eq!(rig.board.resets(), []);
    }
}

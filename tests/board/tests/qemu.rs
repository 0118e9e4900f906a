//! A second opinion: the start-up and the panic path of the image on QEMU's STM32F405, which has
//! other models of CPU and memory than the emulated board.
//!
//! It has no clock registers: the test supplies the two that the start waits for, as a debugger.
//! It has no factory data either: the start ends in a bus fault there, or in a panic to which the
//! test leads it. Further it cannot go, and ticks cannot run: the converter completes no
//! conversion, and there is no DMA, DAC, encoder or watchdog.
//!
//! Needs `qemu-system-arm` and `FIRMWARE`, the image of a board with a DAC.
#![cfg(unix)]

use emulated_board::Board;
use model_core::link::{Crash, Decoder, Note};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const RCC_CR: u32 = 0x4002_3800;
const RCC_CFGR: u32 = 0x4002_3808;
/// Factory data: what the converter reads of its reference.
const REFERENCE_CALIBRATION: u32 = 0x1fff_7a2a;
/// RAM that the firmware does not use.
const FREE: u32 = 0x2001_0000;
/// DAC channel 1.
const DHR12R1: u32 = 0x4000_7408;
/// Address of a bus fault, and its bits in CFSR.
const BFAR: u32 = 0xe000_ed38;
const PRECISERR: u32 = 1 << 9 | 1 << 15;
/// Requests a reset.
const AIRCR: u32 = 0xe000_ed0c;
const RESET: u32 = 0x05fa_0004;
/// The RAM that the firmware uses.
const RAM: (u32, usize) = (0x2000_0000, 16 << 10);
/// Where the panic says that it is.
const FILE: &str = "some/folder/of/a_file.rs";
const LINE: u32 = 1234;
/// Number of the program counter.
const PC: u32 = 15;

/// QEMU, and the debugger's line to it.
struct Qemu {
    child: Child,
    line: UnixStream,
}

impl Drop for Qemu {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Qemu {
    fn start(socket: &std::path::Path, image: &std::ffi::OsStr) -> Qemu {
        let chardev = format!("socket,id=gdb,path={},server=on,wait=off", socket.display());
        let child = Command::new("qemu-system-arm")
            .args(["-machine", "netduinoplus2", "-display", "none"])
            .args(["-monitor", "none", "-serial", "none", "-S"])
            .args(["-chardev", &chardev, "-gdb", "chardev:gdb", "-kernel"])
            .arg(image)
            .stdout(Stdio::null())
            .spawn()
            .expect("qemu-system-arm starts");
        let connected = (0..100).find_map(|_| {
            std::thread::sleep(Duration::from_millis(50));
            UnixStream::connect(socket).ok()
        });
        let line = connected.expect("the debugger's line");
        let timeout = Some(Duration::from_secs(30));
        line.set_read_timeout(timeout).expect("a timeout");
        let mut qemu = Qemu { child, line };
        // Registers can be accessed one by one only after this.
        qemu.ask("qSupported:xmlRegisters=arm");
        qemu.ask("qXfer:features:read:target.xml:0,ffb");
        qemu
    }

    /// The answer to a packet of the GDB remote protocol.
    fn ask(&mut self, packet: &str) -> String {
        let sum = packet.bytes().fold(0_u8, u8::wrapping_add);
        write!(self.line, "${packet}#{sum:02x}").expect("QEMU reads");
        let mut byte = [0];
        let mut next = || {
            self.line.read_exact(&mut byte).expect("an answer of QEMU");
            byte[0]
        };
        while next() != b'$' {}
        let mut answer = String::new();
        loop {
            match next() {
                b'#' => break,
                byte => answer.push(byte.into()),
            }
        }
        // The checksum.
        next();
        next();
        self.line.write_all(b"+").expect("QEMU reads");
        answer
    }

    fn bytes(&mut self, packet: &str) -> Vec<u8> {
        let answer = self.ask(packet);
        let digits = answer.as_bytes().chunks(2);
        digits
            .map(|pair| {
                let pair = std::str::from_utf8(pair).expect("ASCII");
                u8::from_str_radix(pair, 16).expect("hexadecimal digits")
            })
            .collect()
    }

    fn register(&mut self, number: u32) -> u32 {
        let bytes = self.bytes(&format!("p{number:x}"));
        u32::from_le_bytes(bytes.try_into().expect("a word"))
    }

    fn set_register(&mut self, number: u32, value: u32) {
        let value = value.swap_bytes();
        assert_eq!(self.ask(&format!("P{number:x}={value:08x}")), "OK");
    }

    /// Runs to the next access of a watched register; its address.
    fn run(&mut self) -> u32 {
        let stop = self.ask("c");
        let address = stop
            .split_once("watch:")
            .and_then(|(_, rest)| u32::from_str_radix(rest.split(';').next()?, 16).ok());
        address.unwrap_or_else(|| panic!("expected a watched access, found {stop}"))
    }

    /// The load or store before which QEMU has stopped: its register, whether it loads,
    /// its length.
    fn access(&mut self) -> (u32, bool, u32) {
        let pc = self.register(PC);
        let code = self.bytes(&format!("m{pc:x},4"));
        let half = |at: usize| u32::from(u16::from_le_bytes([code[at], code[at + 1]]));
        let (first, second) = (half(0), half(2));
        match first & 0xf800 {
            0x6000 => (first & 7, false, 2),
            0x6800 => (first & 7, true, 2),
            0x8800 => (first & 7, true, 2),
            // ldr.w, str.w and ldrh.w; immediate and register offsets.
            0xf800 if matches!(first & 0x60, 0x20 | 0x40) => (second >> 12, first & 0x10 != 0, 4),
            _ => panic!("at {pc:#x}: {first:#x} {second:#x} is no load or store"),
        }
    }
}

/// Continues with a call of core's panic function for a division by zero, at [`LINE`] of [`FILE`].
fn lead_to_a_panic(qemu: &mut Qemu, image: &std::ffi::OsStr) {
    let elf = std::fs::read(image).expect("the image");
    let board = Board::new(&elf).expect("an image for this board");
    let panic = board.symbol_with("panic_const_div_by_zero");
    // A Location: file name, line and column.
    let words = [FREE + 16, FILE.len() as u32, LINE, 5].map(u32::to_le_bytes);
    let location = [&words.concat(), FILE.as_bytes()].concat();
    let digits: String = location.iter().map(|byte| format!("{byte:02x}")).collect();
    let write = format!("M{FREE:x},{:x}:{digits}", location.len());
    assert_eq!(qemu.ask(&write), "OK");
    qemu.set_register(0, FREE);
    let panic = panic.expect("the firmware contains a checked division");
    qemu.set_register(PC, panic & !1);
}

/// Runs the image up to its first request for a reset: what it wrote to the DAC, its note in RAM,
/// and the address of a bus fault.
fn run(panics: bool) -> (Vec<u32>, Option<Crash>, u32) {
    let image = std::env::var_os("FIRMWARE").expect("FIRMWARE: the path of the firmware's ELF");
    let folder = tempfile::tempdir().expect("a folder");
    let mut qemu = Qemu::start(&folder.path().join("gdb"), &image);
    let mut watch = |kind: u32, register: u32, len: u32| {
        assert_eq!(qemu.ask(&format!("Z{kind},{register:x},{len}")), "OK");
    };
    for register in [RCC_CR, RCC_CFGR] {
        watch(4, register, 4);
    }
    for register in [DHR12R1, AIRCR] {
        watch(2, register, 4);
    }
    if panics {
        watch(3, REFERENCE_CALIBRATION, 2);
    }
    // HSI on, as after a reset.
    let (mut cr, mut cfgr) = (0x83, 0);
    let mut valve = vec![];
    loop {
        let address = qemu.run();
        let (register, loads, length) = qemu.access();
        let value = qemu.register(register);
        match (address, loads) {
            // What is on is ready, and the clock that is asked for is used.
            (RCC_CR, true) => qemu.set_register(register, cr | (cr & 0x0101_0001) << 1),
            (RCC_CFGR, true) => qemu.set_register(register, cfgr | (cfgr & 3) << 2),
            (RCC_CR, false) => cr = value,
            (RCC_CFGR, false) => cfgr = value,
            (REFERENCE_CALIBRATION, _) => {
                lead_to_a_panic(&mut qemu, &image);
                continue;
            }
            (DHR12R1, _) => valve.push(value),
            _ => {
                assert_eq!((address, value), (AIRCR, RESET));
                break;
            }
        }
        let pc = qemu.register(PC);
        qemu.set_register(PC, pc + length);
    }
    assert_eq!(cfgr & 3, 2, "the PLL is the clock");
    let (start, len) = RAM;
    let ram: Vec<u8> = (0..len as u32)
        .step_by(1 << 10)
        .flat_map(|offset| qemu.bytes(&format!("m{:x},400", start + offset)))
        .collect();
    // The note is a frame anywhere in it.
    let crash = (0..ram.len()).find_map(|at| {
        let mut decoder = Decoder::new();
        let frame = ram[at..].iter().take(48);
        let note = frame
            .filter_map(|byte| decoder.push::<Note>(*byte))
            .next()?;
        note.ok()?.crash
    });
    let address = qemu.bytes(&format!("m{BFAR:x},4"));
    let address = u32::from_le_bytes(address.try_into().expect("a word"));
    println!("DAC {valve:?}, {crash:x?}, {address:#x}");
    (valve, crash, address)
}

/// The calibration of the converter, which the start reads, is no memory there.
#[test]
#[ignore = "needs FIRMWARE and qemu-system-arm"]
fn a_bus_fault_at_the_start_is_noted_at_zero_volts() {
    let (valve, crash, address) = run(false);
    // At the handler's entry, and once more before the note.
    assert_eq!(valve, [0, 0]);
    assert_eq!(address, REFERENCE_CALIBRATION);
    let Some(Crash::HardFault { cfsr, .. }) = crash else {
        panic!("{crash:?}");
    };
    assert_eq!(cfsr, PRECISERR);
}

#[test]
#[ignore = "needs FIRMWARE and qemu-system-arm"]
fn a_panic_at_the_start_is_noted_at_zero_volts() {
    let (valve, crash, _) = run(true);
    assert!(
        valve.len() >= 2 && valve.iter().all(|count| *count == 0),
        "{valve:?}"
    );
    let expected = Crash::Panic {
        line: LINE,
        file_end: *FILE.as_bytes().last_chunk().expect("long enough"),
    };
    assert_eq!(crash, Some(expected));
}

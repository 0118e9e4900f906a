//! Panics, faults and unexpected interrupts: set the valve to 0 V, write a note to RAM that
//! survives the reset, then reset. The note also holds the latched fault of the controller.

use crate::driver::valve;
use crate::ram::stack;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use model_core::link::{self, Crash, FRAME_LEN_MAX, Note};
use model_core::supervisor::Fault;

/// Length of the note: enough for any [`Note`] as a frame.
const NOTE_LEN: usize = 48;

/// The note as a link frame. Its checksum distinguishes it from the random content of the RAM
/// after power-on.
#[allow(unsafe_code)]
// SAFETY: start-up code does not initialise this section; every byte value is a valid AtomicU8.
#[unsafe(link_section = ".uninit.crash")]
static NOTE: [AtomicU8; NOTE_LEN] = [const { AtomicU8::new(0) }; NOTE_LEN];

/// Takes the note from before this reset, and erases it.
pub fn take_note() -> Note {
    let note = read_note();
    for byte in &NOTE {
        byte.store(0, Relaxed);
    }
    note
}

/// Writes the latched fault to the note, or that none is latched.
pub fn note_fault(fault: Option<Fault>) {
    write_note(&Note { crash: None, fault });
}

fn read_note() -> Note {
    let mut decoder = link::Decoder::new();
    let mut bytes = NOTE.iter().map(|byte| byte.load(Relaxed));
    let note = bytes.find_map(|byte| decoder.push::<Note>(byte));
    note.and_then(Result::ok).unwrap_or_default()
}

fn write_note(note: &Note) {
    if let Ok(frame) = link::encode(note, &mut [0; FRAME_LEN_MAX]) {
        for (cell, byte) in NOTE.iter().zip(frame) {
            cell.store(*byte, Relaxed);
        }
    }
}

fn stop(crash: Crash) -> ! {
    cortex_m::interrupt::disable();
    valve::make_safe();
    write_note(&Note {
        crash: Some(crash),
        ..read_note()
    });
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    // First, or a tick in between would raise the valve again.
    cortex_m::interrupt::disable();
    valve::make_safe();
    let (file, line) = info.location().map_or(("", 0), |l| (l.file(), l.line()));
    let mut file_end = [0; 16];
    for (target, byte) in file_end.iter_mut().rev().zip(file.bytes().rev()) {
        *target = byte;
    }
    stop(Crash::Panic { line, file_end })
}

/// Entry of the hard fault. The stack pointer may be outside the RAM: resets it before anything is
/// pushed.
#[allow(unsafe_code)]
// SAFETY: the vector table refers to this name. The handler does not return, so that it may
// overwrite the stack.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
unsafe extern "C" fn hard_fault_entry() -> ! {
    core::arch::naked_asm!(
        "mrs r0, msp",
        "ldr r1, =_stack_start",
        "msr msp, r1",
        "b {hard_fault}",
        hard_fault = sym hard_fault,
    )
}

extern "C" fn hard_fault(sp: u32) -> ! {
    valve::make_safe();
    let stack = stack();
    // The CPU has pushed eight registers in this order: r0 to r3, r12, lr, pc, xpsr.
    if !(stack.start..stack.end - 32).contains(&sp) {
        stop(Crash::StackOverflow { sp });
    }
    #[allow(unsafe_code)]
    // SAFETY: these eight words are within the stack.
    let (lr, pc) = unsafe {
        let pushed = sp as *const u32;
        (pushed.add(5).read(), pushed.add(6).read())
    };
    #[allow(unsafe_code)]
    // SAFETY: this register may be read at any time.
    let cfsr = unsafe { (*SCB::PTR).cfsr.read() };
    stop(Crash::HardFault { pc, lr, cfsr })
}

#[allow(unsafe_code)]
// SAFETY: the handler does not return, so that it cannot disturb what it interrupted.
#[exception]
unsafe fn DefaultHandler(interrupt: i16) -> ! {
    stop(Crash::Interrupt(interrupt))
}

/// Bytes of the stack that were never used: they still hold the pattern of the start-up code.
pub fn stack_free_bytes() -> u16 {
    let words = stack().step_by(4);
    let painted = words.take_while(|address| {
        #[allow(unsafe_code)]
        // SAFETY: the address is aligned and within the stack.
        let word = unsafe { (*address as *const u32).read_volatile() };
        word == cortex_m_rt::STACK_PAINT_VALUE
    });
    (painted.count() * 4) as u16
}

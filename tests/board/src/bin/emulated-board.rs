//! The emulated board as a program: its serial link over stdin and stdout, in virtual time.
//!
//!     emulated-board FIRMWARE.elf
//!
//! `hil-sim` documents the protocol on the pipes beside its client of this program. The pins are at
//! rest: no finger force, no pressure, a constant encoder position. The button is pressed only when
//! the lamp asks to hold it, as settings that change the safety block are confirmed.

use emulated_board::{Board, Pin, pin};
use std::io::{self, ErrorKind, Read, Write};
use std::process::ExitCode;

const LINK_BAUD: u32 = 921_600;
/// Step in which the end of a frame is looked for: the PC receives it at most this much later.
const STEP_US: u32 = 500;
/// Inputs at rest \[V\], docs/wiring.md.
const BRIDGE_V: f64 = 1.65;
const PRESSURE_V: f64 = 0.33;

const BUTTON: Pin = pin('C', 13);
const LAMP: Pin = pin('A', 5);
/// The lamp asks by changes 50 ms apart (model-core/src/lamp.rs); self-check is twice as slow.
const ASKS_US: std::ops::RangeInclusive<u32> = 40_000..=60_000;
/// Such changes in a row that are taken for the question.
const CHANGES: u32 = 6;
/// Time for which the button is held: 2 s are asked for.
const HOLD_US: u32 = 2_200_000;

/// Who holds the button when the lamp asks.
#[derive(Default)]
struct Hand {
    was_lit: bool,
    since_us: u32,
    changes: u32,
    holds_us: u32,
}

impl Hand {
    fn pass(&mut self, board: &mut Board, step_us: u32) {
        self.since_us = self.since_us.saturating_add(step_us);
        self.holds_us = self.holds_us.saturating_sub(step_us);
        let is_lit = board.level(LAMP) == Some(true);
        if is_lit != self.was_lit {
            let asks = ASKS_US.contains(&self.since_us);
            self.changes = if asks { self.changes + 1 } else { 0 };
            (self.was_lit, self.since_us) = (is_lit, 0);
            if self.changes == CHANGES {
                (self.changes, self.holds_us) = (0, HOLD_US);
            }
        }
        board.set_level(BUTTON, Some(self.holds_us == 0));
    }
}

/// Runs until a frame has ended, at most for `time_us`; returns the time passed and the bytes
/// received.
fn run_until_frame(board: &mut Board, hand: &mut Hand, time_us: u32) -> (u32, Vec<u8>) {
    let mut received = Vec::new();
    let mut passed_us = 0;
    while passed_us < time_us && !received.contains(&0) {
        let step_us = STEP_US.min(time_us - passed_us);
        board.run_for(u64::from(step_us) * 1_000);
        passed_us += step_us;
        hand.pass(board, step_us);
        received.extend(board.link_receive().iter().map(|received| received.byte));
    }
    (passed_us, received)
}

/// New lines of the log, and new errors.
fn text(board: &mut Board, errors_reported: &mut usize) -> String {
    let mut lines = board.logs();
    let errors = board.errors().iter().skip(*errors_reported);
    lines.extend(errors.map(|error| format!("MISTAKE {}", error.text)));
    *errors_reported = board.errors().len();
    lines.iter().map(|line| format!("{line}\n")).collect()
}

fn number(input: &mut impl Read) -> io::Result<u32> {
    let mut bytes = [0; 4];
    input.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

fn serve(board: &mut Board, input: &mut impl Read, output: &mut impl Write) -> io::Result<()> {
    let (mut errors_reported, mut hand) = (0, Hand::default());
    loop {
        let time_us = match number(input) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            time_us => time_us?,
        };
        let len = number(input)?;
        let mut bytes = Vec::new();
        input.take(len.into()).read_to_end(&mut bytes)?;
        board.link_send(&bytes);
        let (passed_us, received) = run_until_frame(board, &mut hand, time_us);
        let text = text(board, &mut errors_reported);
        output.write_all(&passed_us.to_le_bytes())?;
        for field in [&received, text.as_bytes()] {
            output.write_all(&(field.len() as u32).to_le_bytes())?;
            output.write_all(field)?;
        }
        output.flush()?;
    }
}

fn run(path: &std::ffi::OsStr) -> Result<(), String> {
    let elf = std::fs::read(path).map_err(|error| format!("{path:?}: {error}"))?;
    let mut board = Board::new(&elf).map_err(|error| format!("{path:?}: {error:?}"))?;
    board.set_link_baud(LINK_BAUD);
    board.set_brown_out_level(0);
    // The button is not pressed, and the contacts of the emergency stop are closed.
    for high in [BUTTON, pin('B', 10), pin('A', 8)] {
        board.set_level(high, Some(true));
    }
    board.set_analog(pin('C', 0), BRIDGE_V);
    board.set_analog(pin('C', 1), PRESSURE_V);
    let mut output = io::BufWriter::new(io::stdout().lock());
    serve(&mut board, &mut io::stdin().lock(), &mut output).map_err(|error| error.to_string())
}

fn main() -> ExitCode {
    let mut args = std::env::args_os().skip(1);
    let (Some(path), None) = (args.next(), args.next()) else {
        eprintln!("usage: emulated-board FIRMWARE.elf");
        return ExitCode::from(2);
    };
    match run(&path) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("emulated-board: {message}");
            ExitCode::FAILURE
        }
    }
}

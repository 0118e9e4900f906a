//! The emulated board: another program, which runs the firmware's ELF in virtual time.
//!
//! It is a program of its own because of its engine's licence; both communicate over its stdin and
//! stdout. All numbers are u32, little endian.
//!
//! ```text
//! to it:    time to pass [µs] │ length │ bytes for the board's link
//! from it:  time passed [µs] │ length │ bytes from the link │ length │ text
//! ```
//!
//! It sends the bytes to the board and lets time pass until the board has ended a frame, at most
//! for the given time. The text holds the board's log and the errors that the emulator found, a
//! line each. The program ends when its stdin ends.

use crate::bench::port::client::{Transport, TransportError};
use crate::error::BadInput;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

/// Longest field that is accepted \[bytes\].
const LEN_MAX: u32 = 1 << 24;

/// A running emulator.
pub struct Emulated {
    child: Child,
    stdin: Option<ChildStdin>,
    stdout: BufReader<ChildStdout>,
    to_send: Vec<u8>,
    log: Vec<String>,
}

impl Emulated {
    /// Starts `program` with the firmware `elf`.
    ///
    /// # Errors
    /// The program does not start.
    pub fn start(program: &Path, elf: &Path) -> Result<Emulated, BadInput> {
        let bad = |why: &dyn std::fmt::Display| {
            let file = program.display().to_string();
            BadInput::file(file, format!("the emulated board, {why}"))
        };
        let mut command = Command::new(program);
        command
            .arg(elf)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        // Ctrl-C at the terminal must reach this program only, which then ends the emulator.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|error| bad(&error))?;
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        let stdout = stdout.ok_or_else(|| bad(&"its output cannot be read"))?;
        Ok(Emulated {
            child,
            stdin,
            stdout: BufReader::new(stdout),
            to_send: Vec::new(),
            log: Vec::new(),
        })
    }

    fn pass(&mut self, received: &mut Vec<u8>, wait: Duration) -> io::Result<Duration> {
        let wait_us = wait.as_micros().clamp(1, u128::from(u32::MAX)) as u32;
        let len = self.to_send.len() as u32;
        let mut request = [wait_us.to_le_bytes(), len.to_le_bytes()].concat();
        request.append(&mut self.to_send);
        let stdin = self.stdin.as_mut().ok_or(io::ErrorKind::BrokenPipe)?;
        stdin.write_all(&request)?;
        stdin.flush()?;
        let (passed, lines) = answer(&mut self.stdout, received)?;
        self.log.extend(lines);
        Ok(passed)
    }
}

/// Reads an answer of the program: the time that has passed, and the lines of the log. Bytes from
/// the link are appended to `received`.
///
/// # Errors
/// The answer is cut off, or a field is longer than any valid one.
pub fn answer(from: &mut impl Read, received: &mut Vec<u8>) -> io::Result<(Duration, Vec<String>)> {
    let passed_us = number(from)?.max(1);
    field(from, received)?;
    let mut text = Vec::new();
    field(from, &mut text)?;
    let lines = String::from_utf8_lossy(&text)
        .lines()
        .map(String::from)
        .collect();
    Ok((Duration::from_micros(passed_us.into()), lines))
}

fn number(from: &mut impl Read) -> io::Result<u32> {
    let mut bytes = [0; 4];
    from.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

fn field(from: &mut impl Read, into: &mut Vec<u8>) -> io::Result<()> {
    let len = number(from)?;
    if len > LEN_MAX || from.take(len.into()).read_to_end(into)? as u64 != u64::from(len) {
        return Err(io::ErrorKind::InvalidData.into());
    }
    Ok(())
}

impl Transport for Emulated {
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError> {
        self.to_send.extend_from_slice(bytes);
        Ok(())
    }

    fn receive(
        &mut self,
        received: &mut Vec<u8>,
        wait: Duration,
    ) -> Result<Duration, TransportError> {
        self.pass(received, wait).map_err(|error| {
            TransportError(format!("the emulated board's program has ended: {error}"))
        })
    }

    fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}

impl Drop for Emulated {
    fn drop(&mut self) {
        // The program ends when its input ends; waiting leaves no zombie process.
        self.stdin = None;
        let _ = self.child.wait();
    }
}

const TARGET: &str = "thumbv7em-none-eabihf";
const HOW_FIRMWARE: &str = "the firmware's ELF, found none: build it with `cargo firmware` \
    (docs/wiring.md), or set FIRMWARE to its path";
const HOW_PROGRAM: &str = "the emulated board's program, found none: build it with \
    scripts/emulated-hil.sh (tests/board/README.md), or set EMULATED_BOARD to its path";

/// The firmware's ELF and the emulated board's program: as the variables FIRMWARE and
/// EMULATED_BOARD name them, else where cargo puts them.
///
/// # Errors
/// A file is missing; the message says how to build it.
pub fn find() -> Result<(PathBuf, PathBuf), BadInput> {
    let elf = PathBuf::from(TARGET).join("release/firmware");
    let elf = locate("FIRMWARE", "target", &elf, HOW_FIRMWARE)?;
    let mut magic = [0; 4];
    let read = std::fs::File::open(&elf).and_then(|mut file| file.read_exact(&mut magic));
    if read.is_err() || magic != *b"\x7fELF" {
        let why = "the firmware's ELF, found another file";
        return Err(BadInput::file(elf.display().to_string(), why));
    }
    let name = format!("release/emulated-board{}", std::env::consts::EXE_SUFFIX);
    let program = locate(
        "EMULATED_BOARD",
        "tests/board/target",
        Path::new(&name),
        HOW_PROGRAM,
    )?;
    Ok((program, elf))
}

fn locate(variable: &str, target: &str, file: &Path, how: &str) -> Result<PathBuf, BadInput> {
    let named = std::env::var_os(variable).map(PathBuf::from);
    let candidates: Vec<PathBuf> = match &named {
        Some(path) => vec![path.clone()],
        None => {
            let shared = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
            let here = std::env::current_dir().unwrap_or_default();
            let above = here.ancestors().map(|folder| folder.join(target));
            let folders = shared.into_iter().chain(above);
            folders.map(|folder| folder.join(file)).collect()
        }
    };
    let found = candidates.into_iter().find(|path| path.is_file());
    found.ok_or_else(|| {
        let name = named.map_or_else(|| file.display().to_string(), |p| p.display().to_string());
        BadInput::file(name, how)
    })
}

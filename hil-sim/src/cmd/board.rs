//! Connects a command to a board, real or emulated.

use super::Failure;
use hil_sim::bench::port::client::{Client, LinkError, Transport};
use hil_sim::bench::port::emulated::{self, Emulated};
#[cfg(feature = "serial")]
use hil_sim::bench::port::serial::Serial;
use hil_sim::bench::settings_file;
use hil_sim::error::BadInput;
use hil_sim::output::written_at;
use hil_sim::record::columns::{Firmware, Software};
use hil_sim::record::mcap::Origin;
use model_core::limits::safety_hash;
use model_core::link::Identity;
use model_core::settings::SettingsValues;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// A board that sends nothing for this time is considered lost.
const TIMEOUT: Duration = Duration::from_secs(60);

/// The link to a board.
pub type Line = Client<Box<dyn Transport + Send>>;

/// A connected board and its identity.
pub struct Connected {
    /// The link to it.
    pub line: Line,
    /// The identity that it reports.
    pub identity: Identity,
    /// Name of the port.
    pub port: String,
    /// Set by an interrupt, to end early.
    pub stop: Arc<AtomicBool>,
}

#[cfg(feature = "serial")]
fn serial(name: &str) -> Result<Box<dyn Transport + Send>, BadInput> {
    Ok(Box::new(Serial::open(name)?))
}

#[cfg(not(feature = "serial"))]
fn serial(name: &str) -> Result<Box<dyn Transport + Send>, BadInput> {
    let expected = "no port, as this hil-sim was built without the feature `serial`";
    Err(BadInput::file(name, expected))
}

/// Connects to the real board at `port`, or to an emulated one if it is `None`.
pub fn connect(port: Option<&str>) -> Result<Connected, Failure> {
    let line: Box<dyn Transport + Send> = match port {
        Some(name) => serial(name)?,
        None => {
            let (program, elf) = emulated::find()?;
            Box::new(Emulated::start(&program, &elf)?)
        }
    };
    let stop = Arc::new(AtomicBool::new(false));
    #[cfg(feature = "terminal")]
    super::interrupt::ask_first(&stop);
    let user = ["USER", "USERNAME"]
        .into_iter()
        .find_map(|name| std::env::var(name).ok());
    let mut line = Client::new(line, TIMEOUT, Arc::clone(&stop))
        .with_person(user.as_deref().unwrap_or("hil-sim"), |words| {
            eprintln!("{words}")
        });
    let name = port.unwrap_or("the emulated board").to_string();
    let identity = match line.identity() {
        Err(LinkError::NoAnswer(waited_s)) => {
            let why = format!("a board with this firmware, heard no answer for {waited_s:.0} s");
            return Err(BadInput::file(name, why).into());
        }
        identity => identity?,
    };
    Ok(Connected {
        line,
        identity,
        port: name,
        stop,
    })
}

/// What a record says of its board: firmware, safety block, and who has changed it and when.
///
/// # Errors
/// The board does not answer, or the PC's clock is unusable.
pub fn origin(board: &mut Connected, values: &SettingsValues) -> Result<Origin, Failure> {
    let changed = match board.line.change(0)? {
        Some(change) if change.values == *values => settings_file::signed(&change.signature),
        _ => "not known".into(),
    };
    Ok(Origin {
        board: vec![
            ("board", describe(&board.identity)),
            ("safety_block", format!("{:08x}", safety_hash(values))),
            ("settings_changed", changed),
        ],
        software: Software {
            firmware: Some(Firmware::from(&board.identity)),
        },
        started: written_at()?,
        ..Origin::default()
    })
}

/// The board's name, firmware and last faults as text.
pub fn describe(identity: &Identity) -> String {
    let name = identity.board.iter().take_while(|byte| **byte != 0);
    let board: String = name
        .map(|byte| match byte {
            0x20..0x7f => char::from(*byte),
            _ => '?',
        })
        .collect();
    let mut words = format!("{board}, {}", Firmware::from(identity));
    if let Some(crash) = identity.crash {
        words += &format!(", which has crashed before: {crash:?}");
    }
    if let Some(fault) = identity.fault {
        words += &format!(", whose controller had latched {fault} before the reset");
    }
    if let Some(fault) = identity.start {
        words += &format!(". Start-up self-test: {fault}: {}", fault.help());
    }
    words
}

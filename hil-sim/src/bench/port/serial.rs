//! A serial port that may be unplugged and come back.

use crate::bench::port::client::{Transport, TransportError};
use crate::error::BadInput;
use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

/// Speed of the link \[bit/s\].
const LINK_BAUD: u32 = 921_600;
/// How often an unplugged port is looked for.
const REOPEN_EVERY: Duration = Duration::from_millis(100);
/// A port that takes no bytes for this time is broken.
const SEND_TIMEOUT: Duration = Duration::from_millis(100);

/// A serial port by its name.
pub struct Serial {
    name: String,
    port: Option<Box<dyn serialport::SerialPort>>,
    log: Vec<String>,
}

impl Serial {
    /// Opens the port.
    ///
    /// # Errors
    /// The port does not exist, or another program has it open.
    pub fn open(name: &str) -> Result<Serial, BadInput> {
        let port = open(name).map_err(|error| {
            BadInput::file(name, format!("a serial port that can be opened, {error}"))
        })?;
        Ok(Serial {
            name: name.into(),
            port: Some(port),
            log: Vec::new(),
        })
    }

    /// Runs `act` on the port. If that fails, the port is closed, to be opened again later.
    fn with_port<T>(
        &mut self,
        act: impl FnOnce(&mut dyn serialport::SerialPort) -> io::Result<T>,
    ) -> Option<T> {
        match act(self.port.as_deref_mut()?) {
            Ok(done) => Some(done),
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                None
            }
            Err(error) => {
                self.log.push(format!("{} has gone: {error}", self.name));
                self.port = None;
                None
            }
        }
    }
}

fn open(name: &str) -> serialport::Result<Box<dyn serialport::SerialPort>> {
    let port = serialport::new(name, LINK_BAUD)
        .timeout(SEND_TIMEOUT)
        .open()?;
    // Discard bytes that arrived before the port was opened.
    port.clear(serialport::ClearBuffer::Input)?;
    Ok(port)
}

impl Transport for Serial {
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError> {
        self.with_port(|port| {
            port.set_timeout(SEND_TIMEOUT)?;
            port.write_all(bytes)
        });
        Ok(())
    }

    fn receive(
        &mut self,
        received: &mut Vec<u8>,
        wait: Duration,
    ) -> Result<Duration, TransportError> {
        let start = Instant::now();
        if self.port.is_none() {
            std::thread::sleep(wait.min(REOPEN_EVERY));
            if let Ok(port) = open(&self.name) {
                self.log.push(format!("{} is back", self.name));
                self.port = Some(port);
            }
            return Ok(start.elapsed());
        }
        let mut buffer = [0; 1024];
        let read = self.with_port(|port| {
            port.set_timeout(wait.max(Duration::from_millis(1)))?;
            match port.read(&mut buffer)? {
                0 => Err(ErrorKind::UnexpectedEof.into()),
                read => Ok(read),
            }
        });
        received.extend_from_slice(&buffer[..read.unwrap_or(0)]);
        // Never zero: the caller adds these times up to its timeout.
        Ok(start.elapsed().max(Duration::from_micros(1)))
    }

    fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}

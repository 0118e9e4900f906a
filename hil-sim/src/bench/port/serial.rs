//! A serial port that may be unplugged and come back.

use crate::bench::link::{Port, PortError};
use crate::error::BadInput;
use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

/// Speed of the link \[bit/s\].
const LINK_BAUD: u32 = 921_600;
/// How often a port that has gone is looked for.
const REOPEN_EVERY: Duration = Duration::from_millis(100);
/// A line that takes nothing for so long is broken.
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
    /// It is not there, or belongs to somebody else.
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

    /// Runs `act` on the port; where that fails the port is closed, to be opened again.
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
    // What came before anybody listened is nobody's.
    port.clear(serialport::ClearBuffer::Input)?;
    Ok(port)
}

impl Port for Serial {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.with_port(|port| {
            port.set_timeout(SEND_TIMEOUT)?;
            port.write_all(bytes)
        });
        Ok(())
    }

    fn receive(&mut self, received: &mut Vec<u8>, wait: Duration) -> Result<Duration, PortError> {
        let begin = Instant::now();
        if self.port.is_none() {
            std::thread::sleep(wait.min(REOPEN_EVERY));
            if let Ok(port) = open(&self.name) {
                self.log.push(format!("{} is back", self.name));
                self.port = Some(port);
            }
            return Ok(begin.elapsed());
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
        // Never nothing: whoever waits adds these up.
        Ok(begin.elapsed().max(Duration::from_micros(1)))
    }

    fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}

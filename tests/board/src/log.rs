//! The firmware's defmt log, out of the RTT buffer in its RAM.

use defmt_decoder::{DecodeError, Table};

/// Decodes what the firmware writes; none if it does not log with defmt.
pub(crate) struct Log {
    table: Table,
    control_block: u32,
    /// Bytes of a frame that is not whole yet.
    rest: Vec<u8>,
    /// Decoded lines that nobody took yet.
    pub lines: Vec<String>,
}

/// The fields of the first up-channel that are needed.
pub(crate) struct Channel {
    pub buffer: u32,
    pub size: u32,
    pub write: u32,
    pub read: u32,
}

/// Length of what [`Log::channel`] looks at.
pub(crate) const CONTROL_BLOCK_LEN: usize = 24 + 24;
/// Where the host notes how far it has read.
pub(crate) const READ_OFFSET: u32 = 24 + 16;

impl Log {
    pub fn new(elf: &[u8], symbols: &[(String, u32)]) -> Option<Log> {
        let table = Table::parse(elf).ok().flatten()?;
        let control_block = symbols.iter().find(|(name, _)| name == "_SEGGER_RTT")?.1;
        Some(Log {
            table,
            control_block,
            rest: vec![],
            lines: vec![],
        })
    }

    pub fn control_block(&self) -> u32 {
        self.control_block
    }

    /// The channel, once the firmware has set it up.
    pub fn channel(block: &[u8]) -> Option<Channel> {
        let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| block[at + k]));
        let channel = Channel {
            buffer: word(28),
            size: word(32),
            write: word(36),
            read: word(40),
        };
        let sane = channel.write < channel.size && channel.read < channel.size;
        (block.starts_with(b"SEGGER RTT") && sane && channel.size <= 1 << 16).then_some(channel)
    }

    /// The chip was reset: what is not whole never will be.
    pub fn cut(&mut self) {
        self.rest.clear();
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.rest.extend(bytes);
        // each frame ends with a zero byte
        let Some(last) = self.rest.iter().rposition(|byte| *byte == 0) else {
            return;
        };
        let whole: Vec<u8> = self.rest.drain(..=last).collect();
        let mut decoder = self.table.new_stream_decoder();
        decoder.received(&whole);
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    self.lines
                        .push(format!("{level} {}", frame.display_message()));
                }
                Err(DecodeError::UnexpectedEof) => return,
                Err(DecodeError::Malformed) => self.lines.push("(malformed log frame)".into()),
            }
        }
    }
}

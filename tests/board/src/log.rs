//! The defmt log of the firmware, read from the RTT buffer in its RAM.

use defmt_decoder::{DecodeError, Table};

/// Decoder of the log.
pub(crate) struct Log {
    table: Table,
    control_block: u32,
    /// Bytes of an incomplete frame.
    rest: Vec<u8>,
    /// Decoded lines not yet taken by the caller.
    pub lines: Vec<String>,
}

/// The fields of the first up-channel that are used.
pub(crate) struct Channel {
    pub buffer: u32,
    pub size: u32,
    pub write: u32,
    pub read: u32,
}

/// Length of the control block that [`Log::channel`] reads.
pub(crate) const CONTROL_BLOCK_LEN: usize = 24 + 24;
/// Offset of the read position, which the host writes.
pub(crate) const READ_OFFSET: u32 = 24 + 16;

impl Log {
    /// A decoder for an ELF file; none if the firmware does not log with defmt.
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

    /// The channel; none before the firmware has initialised it.
    pub fn channel(block: &[u8]) -> Option<Channel> {
        let word = |offset: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| block[offset + k]));
        let channel = Channel {
            buffer: word(28),
            size: word(32),
            write: word(36),
            read: word(40),
        };
        let valid = channel.write < channel.size && channel.read < channel.size;
        (block.starts_with(b"SEGGER RTT") && valid && channel.size <= 1 << 16).then_some(channel)
    }

    /// Discards an incomplete frame, after a reset of the chip.
    pub fn cut(&mut self) {
        self.rest.clear();
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.rest.extend(bytes);
        // each frame ends with a zero byte
        let Some(last) = self.rest.iter().rposition(|byte| *byte == 0) else {
            return;
        };
        let frames: Vec<u8> = self.rest.drain(..=last).collect();
        let mut decoder = self.table.new_stream_decoder();
        decoder.received(&frames);
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

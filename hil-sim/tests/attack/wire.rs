//! Bytes for the link, made with nothing but docs/link.md: no function of the code that decodes
//! them.

use rand::{Rng, RngExt};

/// Version of the messages that the page describes.
const VERSION: u8 = 9;

/// CRC-32 (ISO-HDLC), bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    let mut sum = u32::MAX;
    for byte in bytes {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = (sum >> 1) ^ (0xEDB8_8320 & (sum & 1).wrapping_neg());
        }
    }
    !sum
}

/// COBS, with its zero.
fn stuffed(bytes: &[u8]) -> Vec<u8> {
    let mut frame = Vec::new();
    for group in bytes.split(|byte| *byte == 0) {
        let mut chunks = group.chunks(254).peekable();
        if group.is_empty() {
            frame.push(1);
        }
        while let Some(chunk) = chunks.next() {
            frame.push(chunk.len() as u8 + 1);
            frame.extend(chunk);
            // A full chunk ends without a zero.
            if chunk.len() == 254 && chunks.peek().is_none() {
                frame.push(1);
            }
        }
    }
    frame.push(0);
    frame
}

/// What a frame contains, without its zero: version and body.
fn contents(frame: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = frame.strip_suffix(&[0]).unwrap_or(frame);
    while let Some((code, behind)) = rest.split_first() {
        let (chunk, others) = behind.split_at(usize::from(*code) - 1);
        bytes.extend(chunk);
        if *code < 255 && !others.is_empty() {
            bytes.push(0);
        }
        rest = others;
    }
    bytes.truncate(bytes.len().saturating_sub(4));
    bytes
}

/// A frame with a right CRC.
fn frame_of(version: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![version];
    bytes.extend(body);
    bytes.extend(crc(&bytes).to_le_bytes());
    stuffed(&bytes)
}

fn varint(mut number: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

/// A request, at the end of a body.
fn request(random: &mut impl Rng) -> Vec<u8> {
    let number = random.random_range(0..8);
    let mut bytes = vec![number];
    if number == 5 {
        bytes.extend(varint(random.next_u32() % 600_000));
    }
    bytes
}

/// Somebody at the link, who has read the board's settings and hears what is sent.
pub struct Attacker {
    /// The body of `Settings` as the board sent it.
    settings: Vec<u8>,
    sent: Vec<Vec<u8>>,
    sequence: u32,
}

impl Attacker {
    /// Who has heard this frame, the board's answer to `ReadSettings`.
    pub fn new(settings: &[u8]) -> Attacker {
        Attacker {
            settings: contents(settings).split_off(2),
            sent: Vec::new(),
            sequence: 0,
        }
    }

    /// A body that the page allows.
    fn body(&mut self, random: &mut impl Rng) -> Vec<u8> {
        match random.random_range(0..12) {
            0 => vec![0],
            1 => vec![1],
            2..5 => self.changed_settings(random),
            5..8 => [vec![3, 0], request(random)].concat(),
            8 => vec![3, random.random_range(1..3)],
            9 => {
                self.sequence += random.random_range(0..3);
                let count = |random: &mut dyn Rng| varint(random.next_u32() % 4096);
                let readings = [
                    count(random),
                    count(random),
                    varint(random.next_u32() % 100),
                    count(random),
                ];
                let sensors = [readings.concat(), vec![0], request(random)].concat();
                [vec![3, 3], varint(self.sequence), sensors].concat()
            }
            10 => {
                let author = random.random::<[u8; 16]>().to_vec();
                [vec![4], varint(random.next_u32()), author, vec![1]].concat()
            }
            _ => [vec![5], varint(random.next_u32() % 300)].concat(),
        }
    }

    /// Settings in which some numbers are others. The first 49 values of the page's list are of
    /// four bytes but for some; whatever the bytes mean, the rest stays.
    fn changed_settings(&self, random: &mut impl Rng) -> Vec<u8> {
        let mut body = vec![2];
        let mut settings = self.settings.clone();
        for _ in 0..random.random_range(0..4) {
            let at = random.random_range(0..settings.len() - 4);
            match random.random_range(0..3) {
                0 => settings[at] = random.random(),
                1 => settings[at] ^= 1 << random.random_range(0..8),
                _ => {
                    // Four times, half, or the negative of a number that may begin there.
                    let bytes = [0, 1, 2, 3].map(|n| settings[at + n]);
                    let number = f32::from_le_bytes(bytes);
                    let other = number * [4.0, 0.5, -1.0][random.random_range(0..3)];
                    settings[at..at + 4].copy_from_slice(&other.to_le_bytes());
                }
            }
        }
        body.extend(settings);
        body
    }

    /// The next bytes.
    pub fn bytes(&mut self, random: &mut impl Rng) -> Vec<u8> {
        let body = self.body(random);
        let mut frame = frame_of(VERSION, &body);
        match random.random_range(0..16) {
            // Wrong fields with a right checksum.
            0 | 1 => {
                let mut wrong = body.clone();
                let at = random.random_range(0..wrong.len());
                wrong[at] = random.random();
                frame = frame_of(VERSION, &wrong);
            }
            2 => frame = frame_of(random.random(), &body),
            3 => {
                let length = random.random_range(0..40);
                let body: Vec<u8> = (0..length).map(|_| random.random()).collect();
                frame = frame_of(VERSION, &body);
            }
            // Too much behind it, or too little.
            4 => frame = frame_of(VERSION, &[&body[..], &[random.random()]].concat()),
            5 => frame = frame_of(VERSION, &body[..body.len() - 1]),
            6 => frame.truncate(random.random_range(0..frame.len())),
            7 => {
                let at = random.random_range(0..frame.len());
                frame[at] ^= 1 << random.random_range(0..8);
            }
            // Within another one.
            8 if !self.sent.is_empty() => {
                let other = &self.sent[random.random_range(0..self.sent.len())];
                let at = random.random_range(0..frame.len());
                frame.splice(at..at, other.iter().copied());
            }
            9 | 10 if !self.sent.is_empty() => {
                frame = self.sent[random.random_range(0..self.sent.len())].clone();
            }
            11 => {
                let length = random.random_range(0..400);
                frame = (0..length).map(|_| random.random()).collect();
            }
            12 => frame.insert(0, 0),
            _ => {}
        }
        self.sent.push(frame.clone());
        if self.sent.len() > 50 {
            self.sent.swap_remove(random.random_range(0..50));
        }
        frame
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frames of the page.
    #[test]
    fn frames_are_those_of_the_page() {
        let identify = [0x02, 0x09, 0x05, 0xB6, 0xA9, 0x1B, 0x90, 0x00];
        assert_eq!(frame_of(VERSION, &[0]), identify);
        let vent = [0x03, 0x09, 0x03, 0x06, 0x03, 0x75, 0x7F, 0x03, 0xC7, 0x00];
        assert_eq!(frame_of(VERSION, &[3, 0, 3]), vent);
        assert_eq!(contents(&vent), [9, 3, 0, 3]);
    }
}

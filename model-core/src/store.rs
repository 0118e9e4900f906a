//! Layout of settings in flash: a power cut at any moment leaves the old or the new ones.
//!
//! Two sectors are divided into slots. Each write goes to the next empty slot, with a number one
//! higher. When a sector is full, the other one is erased and used. The valid slot of the highest
//! number holds the settings, wherever it is. What a power cut leaves in a slot or in a sector is
//! either not valid or has a lower number, and the newest settings are never erased. The slots
//! before the newest tell what was changed, by whom and when.
//!
//! ```text
//! slot: mark │ length u16 │ number u32 │ settings as encoded │ signature │ CRC-32 │ 0xFF …
//! ```

use crate::error::SettingsError;
use crate::link::{Change, Signature};
use crate::settings::{ENCODED_LEN_MAX, Settings};
use crc::{CRC_32_ISO_HDLC, Crc};

/// Bytes of a slot.
pub const SLOT_LEN: usize = 512;

const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const CHECKSUM_LEN: usize = 4;
/// Torn flash tends to 0x00 and 0xFF, and the CRC-32 of FF FF FF FF 00 00 is FF FF FF FF.
const MARK: [u8; 2] = [0x5E, 0x77];
const HEADER_LEN: usize = MARK.len() + 2 + 4;
/// Seconds, author, and whether it was confirmed.
const SIGNATURE_LEN: usize = 4 + 16 + 1;
const BLANK: u8 = 0xFF;

const _: () = assert!(HEADER_LEN + ENCODED_LEN_MAX + SIGNATURE_LEN + CHECKSUM_LEN <= SLOT_LEN);

/// A valid slot.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Found<'a> {
    number: u32,
    sector: usize,
    slot: usize,
    encoded: &'a [u8],
    signature: Signature,
}

/// Operations on the flash, in this order: erase, program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Write {
    /// The sector, 0 or 1.
    pub sector: usize,
    /// It must be erased first.
    pub erase: bool,
    /// Where in the sector the slot begins.
    pub offset: usize,
    /// The slot's first bytes; the rest stays blank.
    bytes: [u8; SLOT_LEN],
    len: usize,
}

impl Write {
    /// The bytes to be programmed.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

/// The settings in the two `sectors`; none if none were ever stored.
///
/// # Errors
/// The newest settings are of another version or no longer valid.
pub fn load(sectors: [&[u8]; 2]) -> Result<Option<Settings>, SettingsError> {
    newest(sectors)
        .map(|found| Settings::decode(found.encoded))
        .transpose()
}

/// The settings that were in force `back` changes before the newest, if the sectors still hold them
/// and this version can read them.
pub fn change(sectors: [&[u8]; 2], back: u16) -> Option<Change> {
    let newest = newest(sectors)?.number;
    let number = newest.checked_sub(back.into())?;
    let found = all(sectors).find(|found| found.number == number)?;
    Some(Change {
        number,
        signature: found.signature,
        values: *Settings::decode(found.encoded).ok()?.values(),
    })
}

/// The operations that add `settings` to the two `sectors`.
///
/// # Errors
/// None in practice: settings fit into a slot.
pub fn store(sectors: [&[u8]; 2], settings: &Settings) -> Result<Write, SettingsError> {
    store_signed(sectors, settings, &Signature::default())
}

/// As [`store`], with who has changed them and when.
///
/// # Errors
/// As [`store`].
pub fn store_signed(
    sectors: [&[u8]; 2],
    settings: &Settings,
    signature: &Signature,
) -> Result<Write, SettingsError> {
    let newest = newest(sectors);
    let (sector, from) = newest.map_or((0, 0), |found| (found.sector, found.slot + 1));
    let content = if sector == 0 { sectors[0] } else { sectors[1] };
    let is_blank = |slot: &[u8]| slot.iter().all(|byte| *byte == BLANK);
    let mut slots = content.chunks_exact(SLOT_LEN).enumerate().skip(from);
    let (sector, erase, slot) = match (slots.find(|(_, slot)| is_blank(slot)), newest) {
        (Some((slot, _)), _) => (sector, false, slot),
        (None, None) => (0, true, 0),
        (None, Some(_)) => (1 - sector, true, 0),
    };
    let mut write = Write {
        sector,
        erase,
        offset: slot * SLOT_LEN,
        bytes: [BLANK; SLOT_LEN],
        len: 0,
    };
    let number = newest.map_or(0, |found| found.number.wrapping_add(1));
    write.len = fill(&mut write.bytes, number, settings, signature)?;
    Ok(write)
}

/// Seconds, author, and whether it was confirmed, in this order.
fn signed_bytes(signature: &Signature) -> [u8; SIGNATURE_LEN] {
    let mut bytes = [u8::from(signature.is_confirmed); SIGNATURE_LEN];
    let fields = signature.utc_s.to_le_bytes().into_iter();
    for (target, byte) in bytes.iter_mut().zip(fields.chain(signature.author)) {
        *target = byte;
    }
    bytes
}

/// Reverses [`signed_bytes`].
fn signature(bytes: &[u8; SIGNATURE_LEN]) -> Signature {
    let [t0, t1, t2, t3, author @ .., is_confirmed] = *bytes;
    Signature {
        utc_s: u32::from_le_bytes([t0, t1, t2, t3]),
        author,
        is_confirmed: is_confirmed != 0,
    }
}

/// Writes a slot's bytes; returns how many.
fn fill(
    slot: &mut [u8],
    number: u32,
    settings: &Settings,
    signature: &Signature,
) -> Result<usize, SettingsError> {
    let (header, rest) = slot
        .split_first_chunk_mut::<HEADER_LEN>()
        .ok_or(SettingsError::Length)?;
    let settings_len = settings.encode(rest)?.len();
    let signed = rest
        .get_mut(settings_len..)
        .and_then(|rest| rest.first_chunk_mut::<SIGNATURE_LEN>())
        .ok_or(SettingsError::Length)?;
    *signed = signed_bytes(signature);
    let len = settings_len + SIGNATURE_LEN;
    let [n0, n1, n2, n3] = number.to_le_bytes();
    let [l0, l1] = (len as u16).to_le_bytes();
    *header = [MARK[0], MARK[1], l0, l1, n0, n1, n2, n3];
    let (covered, rest) = slot
        .split_at_mut_checked(HEADER_LEN + len)
        .ok_or(SettingsError::Length)?;
    let checksum = rest
        .first_chunk_mut::<CHECKSUM_LEN>()
        .ok_or(SettingsError::Length)?;
    *checksum = CHECKSUM.checksum(covered).to_le_bytes();
    Ok(HEADER_LEN + len + CHECKSUM_LEN)
}

/// The valid slot of the highest number. Out of line, as it is large.
#[inline(never)]
fn newest<'a>(sectors: [&'a [u8]; 2]) -> Option<Found<'a>> {
    all(sectors).max_by_key(|found| found.number)
}

/// The valid slots.
fn all<'a>(sectors: [&'a [u8]; 2]) -> impl Iterator<Item = Found<'a>> {
    sectors
        .into_iter()
        .enumerate()
        .flat_map(|(sector, content)| {
            let slots = content.chunks_exact(SLOT_LEN).enumerate();
            slots.filter_map(move |(slot, bytes)| {
                let (number, content) = valid(bytes)?;
                let (encoded, signed) = content.split_last_chunk::<SIGNATURE_LEN>()?;
                Some(Found {
                    number,
                    sector,
                    slot,
                    encoded,
                    signature: signature(signed),
                })
            })
        })
}

/// Number and encoded settings of a slot, if it is valid.
fn valid(slot: &[u8]) -> Option<(u32, &[u8])> {
    let ([m0, m1, l0, l1, number @ ..], rest) = slot.split_first_chunk::<HEADER_LEN>()?;
    let len = usize::from(u16::from_le_bytes([*l0, *l1]));
    let (encoded, rest) = rest.split_at_checked(len)?;
    let covered = slot.get(..HEADER_LEN + len)?;
    let checksum = CHECKSUM.checksum(covered).to_le_bytes();
    let is_valid = [*m0, *m1] == MARK && rest.starts_with(&checksum);
    is_valid.then_some((u32::from_le_bytes(*number), encoded))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::SettingsValues;
    use proptest::prelude::*;

    /// Small, so that sectors fill up and are erased often.
    const SECTOR_LEN: usize = 4 * SLOT_LEN;

    type Flash = [Vec<u8>; 2];

    fn blank() -> Flash {
        [vec![BLANK; SECTOR_LEN], vec![BLANK; SECTOR_LEN]]
    }

    fn settings(gain: u16) -> Settings {
        Settings::new(SettingsValues {
            gain: f32::from(gain) / 1000.0,
            ..SettingsValues::reference()
        })
        .unwrap()
    }

    fn loaded(flash: &Flash) -> Option<Settings> {
        load([&flash[0], &flash[1]]).unwrap()
    }

    fn planned(flash: &Flash, settings: &Settings) -> Write {
        store([&flash[0], &flash[1]], settings).unwrap()
    }

    /// Programming can only clear bits.
    fn program(flash: &mut Flash, write: &Write, done: usize) {
        let target = &mut flash[write.sector][write.offset..][..write.bytes().len()];
        for (cell, byte) in target.iter_mut().zip(write.bytes()).take(done) {
            *cell &= byte;
        }
    }

    #[test]
    fn a_thousand_writes_and_each_is_read() {
        let mut flash = blank();
        assert_eq!(loaded(&flash), None);
        let mut erased = 0;
        for gain in 0..1000 {
            let write = planned(&flash, &settings(gain));
            if write.erase {
                flash[write.sector].fill(BLANK);
                erased += 1;
            }
            let slot = &flash[write.sector][write.offset..][..SLOT_LEN];
            assert!(slot.iter().all(|byte| *byte == BLANK));
            program(&mut flash, &write, usize::MAX);
            assert_eq!(loaded(&flash), Some(settings(gain)));
        }
        // Eight slots before the first, then one in four.
        assert_eq!(erased, (1000 - 4) / 4);
    }

    #[test]
    fn settings_of_another_version_are_not_those_before_them() {
        let mut flash = blank();
        for gain in 0..2 {
            let write = planned(&flash, &settings(gain));
            program(&mut flash, &write, usize::MAX);
        }
        // The second one, as a later firmware would have written it.
        let slot = &mut flash[0][SLOT_LEN..];
        slot[HEADER_LEN] += 1;
        let end = HEADER_LEN + usize::from(u16::from_le_bytes([slot[2], slot[3]]));
        let signed = end - SIGNATURE_LEN;
        let inner = CHECKSUM.checksum(&slot[HEADER_LEN..signed - CHECKSUM_LEN]);
        slot[signed - CHECKSUM_LEN..signed].copy_from_slice(&inner.to_le_bytes());
        let outer = CHECKSUM.checksum(&slot[..end]);
        slot[end..end + CHECKSUM_LEN].copy_from_slice(&outer.to_le_bytes());
        let other = crate::settings::VERSION + 1;
        let read = load([&flash[0], &flash[1]]);
        assert_eq!(read, Err(SettingsError::Version(other)));
    }

    #[test]
    fn changes_tell_what_was_stored_by_whom_and_when() {
        let mut flash = blank();
        let signed = |gain: u16| Signature {
            utc_s: 1_800_000_000 + u32::from(gain),
            author: [gain as u8; 16],
            is_confirmed: gain.is_multiple_of(2),
        };
        for gain in 0..6 {
            let sectors = [&flash[0][..], &flash[1]];
            let write = store_signed(sectors, &settings(gain), &signed(gain)).unwrap();
            program(&mut flash, &write, usize::MAX);
        }
        let change = |back| change([&flash[0], &flash[1]], back);
        for back in 0..6 {
            let gain = 5 - back;
            let expected = Change {
                number: gain.into(),
                signature: signed(gain),
                values: *settings(gain).values(),
            };
            assert_eq!(change(back), Some(expected));
        }
        assert_eq!(change(6), None);
    }

    /// What a power cut leaves of a cell.
    fn torn(old: u8, new: u8, progress: u8, chance: u8, bits: u8) -> u8 {
        match chance % 4 {
            0 => old & !bits | new & bits,
            _ if chance < progress => new,
            _ => old,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        /// Cuts while programming and while erasing (over zero, as the cells do): what is read is
        /// what was there before or what was being written, and the next write succeeds.
        #[test]
        fn a_cut_leaves_the_old_or_the_new(
            cuts in prop::collection::vec((any::<bool>(), any::<bool>(), any::<u8>()), 1..60),
            seed: u64,
        ) {
            let mut flash = blank();
            let mut old = None;
            let mut random = seed;
            let mut chance = || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (random >> 56) as u8
            };
            for (gain, (is_cut, to_zero, progress)) in cuts.into_iter().enumerate() {
                let new = settings(gain as u16);
                let write = planned(&flash, &new);
                if write.erase && is_cut {
                    for cell in &mut flash[write.sector] {
                        let (from, to) = if to_zero { (*cell, 0) } else { (0, BLANK) };
                        *cell = torn(from, to, progress, chance(), chance());
                    }
                } else {
                    if write.erase {
                        flash[write.sector].fill(BLANK);
                    }
                    let len = write.bytes().len();
                    let done = if is_cut { usize::from(progress) % len } else { len };
                    program(&mut flash, &write, done);
                    if is_cut {
                        // The byte that was being programmed.
                        let cell = &mut flash[write.sector][write.offset + done];
                        *cell &= write.bytes()[done] | chance();
                    }
                }
                let read = loaded(&flash);
                let gain = read.map(|settings| settings.values().gain);
                prop_assert!(read == old || read == Some(new), "{:?}", gain);
                prop_assert!(is_cut || read == Some(new));
                old = read;
            }
        }

        #[test]
        fn any_flash_at_all_can_be_read_and_written(
            seed in prop::collection::vec(any::<u8>(), SECTOR_LEN), gain in 0..1000_u16,
        ) {
            let mut flash = [seed.clone(), seed];
            let write = planned(&flash, &settings(gain));
            if write.erase {
                flash[write.sector].fill(BLANK);
            }
            program(&mut flash, &write, usize::MAX);
            prop_assert_eq!(loaded(&flash), Some(settings(gain)));
        }
    }
}

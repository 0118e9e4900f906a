//! The strain bridge's own converter, as an option: ADS1220 (data sheet SBAS501), 24 bits, with an
//! amplifier of gain 128. Its reference is the bridge's supply, measured at the bridge: readings do
//! not depend on that supply.
//!
//! A reset of the chip does not reset this converter, and its supply may fail while the chip's goes
//! on. So each conversion counts only if the converter answers with its registers, too, and the
//! polls that read it set it up, at first and whenever it does not answer; no call waits.

use core::ops::RangeInclusive;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::spi::{MODE_1, Mode, SpiBus};
use model_core::sampling::SCANS;
use model_core::signal::{AdcCount, COUNT_MAX};

/// The SPI mode.
pub const MODE: Mode = MODE_1;
/// Highest SPI clock \[Hz\]: a period of 150 ns.
pub const CLOCK_HZ_MAX: u32 = 6_666_666;

/// In place of a conversion that is missing: not a code of 24 bits.
pub const NOT_CONVERTED: i32 = i32::MIN;
/// A reading is the mean of at least so many of a tick's [`SCANS`] conversions: a late tick misses
/// polls.
pub const CONVERSIONS_MIN: usize = SCANS / 2;
/// After so many polls in a row without a conversion the converter is set up again.
const LOST_MAX: u8 = 4;

/// Half of the bridge's supply at the chip's own converter \[counts\]: 4 to 5.5 V. Readings do not
/// depend on it, but without it the reference is missing, and conversions are anything.
const HALF_SUPPLY: RangeInclusive<u16> = 2_482..=3_413;

/// Conversions of one count: the 4096 counts of a reading are ±1.953 mV/V of the bridge, a quarter
/// of the converter's range. 512 would be ±0.98 mV/V, 2048 ±3.9 mV/V, 4096 ±7.8 mV/V.
const CODES_PER_COUNT: i32 = 1024;
/// The reading of a balanced bridge.
const ZERO_COUNT: i32 = (COUNT_MAX / 2 + 1) as i32;
/// Ends of the converter's scale.
const CODE_MIN: i32 = -(1 << 23);
const CODE_MAX: i32 = (1 << 23) - 1;

const RESET: u8 = 0x06;
const START: u8 = 0x08;
const READ_DATA: u8 = 0x10;
const READ_ALL_REGISTERS: u8 = 0x23;
const WRITE_ALL_REGISTERS: u8 = 0x43;
/// AIN0 − AIN1 at gain 128; 2000 conversions per second (turbo mode), continuously; reference
/// REFP0 − REFN0, no current sources; ready is told by its own pin only.
const REGISTERS: [u8; 4] = [0x0e, 0xd4, 0x40, 0x00];

/// What the next poll does.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    Reset,
    /// The converter has been reset, which takes it 60 µs.
    SetUp,
    /// Polls in a row in which no new conversion was seen.
    Convert(u8),
}

/// The converter on its bus: `select` is CS, `ready` is DRDY, low if there is a new conversion.
pub struct Ads1220<B, S, R> {
    bus: B,
    select: S,
    ready: R,
    step: Step,
}

impl<B: SpiBus, S: OutputPin, R: InputPin> Ads1220<B, S, R> {
    /// A converter that the first two polls set up.
    pub fn new(bus: B, mut select: S, ready: R) -> Ads1220<B, S, R> {
        let _ = select.set_high();
        Ads1220 {
            bus,
            select,
            ready,
            step: Step::Reset,
        }
    }

    /// The conversion that was made since the last poll; none while the converter is set up, if it
    /// does not answer with its registers, and if DRDY shows no new conversion twice in a row.
    /// Polls must be 0.52 ms apart or more: then there is a new one each time.
    ///
    /// DRDY is high for 4 µs before a conversion is complete, and low after a read in which another
    /// one is completed: a poll may meet either, but two in a row do not.
    pub fn poll(&mut self) -> Option<i32> {
        match self.step {
            Step::Reset => {
                self.exchange(&mut [RESET])?;
                self.step = Step::SetUp;
                None
            }
            Step::SetUp => {
                let [a, b, c, d] = REGISTERS;
                self.exchange(&mut [WRITE_ALL_REGISTERS, a, b, c, d, START])?;
                self.step = Step::Convert(1);
                None
            }
            Step::Convert(lost) => {
                let conversion = self.conversion();
                let is_new = conversion.is_some_and(|(_, is_new)| is_new);
                let lost = if is_new { 0 } else { lost.saturating_add(1) };
                self.step = if lost < LOST_MAX {
                    Step::Convert(lost)
                } else {
                    Step::Reset
                };
                conversion.filter(|_| lost <= 1).map(|(code, _)| code)
            }
        }
    }

    /// A conversion, and whether DRDY shows that it is new: low before, and high after it. None if
    /// the converter does not hold its registers: a supply that is missing or was, a broken wire,
    /// or a data line that is stuck, which reads 0 or -1, a balanced bridge.
    fn conversion(&mut self) -> Option<(i32, bool)> {
        let mut bytes = [READ_DATA, 0, 0, 0, READ_ALL_REGISTERS, 0, 0, 0, 0];
        let was_ready = self.ready.is_low().ok()?;
        self.exchange(&mut bytes)?;
        let is_ready = self.ready.is_low().ok()?;
        let [_, high, middle, low, _, registers @ ..] = bytes;
        let code = i32::from_be_bytes([high, middle, low, 0]) >> 8;
        (registers == REGISTERS).then_some((code, was_ready && !is_ready))
    }

    /// None on any failure of a pin or the bus.
    fn exchange(&mut self, bytes: &mut [u8]) -> Option<()> {
        self.select.set_low().ok()?;
        let exchanged = self.bus.transfer_in_place(bytes);
        let flushed = self.bus.flush();
        self.select.set_high().ok()?;
        exchanged.ok().and(flushed.ok())
    }
}

/// The reading: the mean of a tick's conversions, on the 12-bit scale of the chip's own converter,
/// which reads `half_supply` of the bridge. 0, which is out of range, without that supply, and if
/// too many conversions are [`NOT_CONVERTED`]; an end of the scale if one of them is at the
/// converter's.
///
/// The mean resolves far less than a count, and would stand still for seconds: to the controller a
/// frozen sensor. So up to one count either way is added before it is rounded, from the lowest bits
/// of the conversions' sum, which are noise: nothing is added on average, and a converter that is
/// frozen adds always the same, and is found.
pub fn reading(half_supply: AdcCount, codes: &[i32; SCANS]) -> AdcCount {
    let converted = || codes.iter().filter(|code| **code != NOT_CONVERTED);
    let conversions = converted().count();
    if !HALF_SUPPLY.contains(&half_supply.0) || conversions < CONVERSIONS_MIN {
        return AdcCount::default();
    }
    if converted().any(|code| *code >= CODE_MAX) {
        return AdcCount(COUNT_MAX);
    }
    if converted().any(|code| *code <= CODE_MIN) {
        return AdcCount::default();
    }
    // At most 2^27.
    let sum: i32 = converted().sum();
    let mean = sum.checked_div(conversions as i32).unwrap_or(CODE_MIN);
    // 256 values, of which the middle one is 0.
    let dither = ((sum & 0xff) - 0x80) * (CODES_PER_COUNT / 0x80);
    let count = ZERO_COUNT + (mean + dither).div_euclid(CODES_PER_COUNT);
    AdcCount(count.clamp(0, COUNT_MAX.into()) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as PinState};
    use embedded_hal_mock::eh1::spi::{Mock as Spi, Transaction};
    use std::vec::Vec;

    extern crate std;

    /// What a poll does on the bus: bytes out, and bytes in.
    type Exchange = (&'static [u8], &'static [u8]);

    const RESET: Exchange = (&[0x06], &[0xff]);
    const SET_UP: Exchange = (&[0x43, 0x0e, 0xd4, 0x40, 0x00, 0x08], &[0xff; 6]);
    const READ: &[u8] = &[0x10, 0, 0, 0, 0x23, 0, 0, 0, 0];
    const TWO: Exchange = (READ, &[9, 0, 0, 2, 9, 0x0e, 0xd4, 0x40, 0x00]);
    /// Levels of DRDY before and after a read.
    const NEW: [State; 2] = [State::Low, State::High];

    /// Runs `test` with a converter that must exchange just this, each framed by CS; `ready` are
    /// the levels of DRDY as they are read.
    fn with(
        exchanges: &[Exchange],
        ready: &[[State; 2]],
        test: impl FnOnce(&mut Ads1220<Spi<u8>, Pin, Pin>),
    ) {
        let exchanged = |(sent, received): &Exchange| {
            [
                Transaction::transfer_in_place(sent.to_vec(), received.to_vec()),
                Transaction::flush(),
            ]
        };
        let mut bus = Spi::new(&exchanges.iter().flat_map(exchanged).collect::<Vec<_>>());
        let frames = [State::Low, State::High].repeat(exchanges.len());
        let levels = [State::High].into_iter().chain(frames).map(PinState::set);
        let mut select = Pin::new(&levels.collect::<Vec<_>>());
        let levels = ready.iter().flatten().copied().map(PinState::get);
        let mut ready = Pin::new(&levels.collect::<Vec<_>>());
        test(&mut Ads1220::new(
            bus.clone(),
            select.clone(),
            ready.clone(),
        ));
        bus.done();
        select.done();
        ready.done();
    }

    #[test]
    fn two_polls_set_the_converter_up_and_later_ones_read_it() {
        let data: [Exchange; 3] = [
            (READ, &[0, 0x12, 0x34, 0x56, 0, 0x0e, 0xd4, 0x40, 0x00]),
            (READ, &[0, 0xff, 0xff, 0xfe, 0, 0x0e, 0xd4, 0x40, 0x00]),
            (READ, &[0, 0x80, 0x00, 0x00, 0, 0x0e, 0xd4, 0x40, 0x00]),
        ];
        let exchanges = [RESET, SET_UP, data[0], data[1], data[2]];
        with(&exchanges, &[NEW; 3], |converter| {
            let polls = [(); 5].map(|()| converter.poll());
            assert_eq!(
                polls,
                [None, None, Some(0x12_3456), Some(-2), Some(-0x80_0000)]
            );
        });
    }

    /// DRDY may miss a conversion, not two: then it is broken, or the converter hangs. After four
    /// the converter is set up again.
    #[test]
    fn conversion_counts_only_if_it_is_new() {
        use State::{High, Low};
        for old in [[Low, Low], [High, High], [High, Low]] {
            let reads = [TWO; 7];
            let exchanges = [&[RESET, SET_UP], &reads[..], &[RESET, SET_UP]].concat();
            let ready = [NEW, old, NEW, old, old, old, old];
            with(&exchanges, &ready, |converter| {
                let polls = [(); 11].map(|()| converter.poll());
                let seen = [true, true, true, true, false, false, false, false, false];
                let expected = [false, false].into_iter().chain(seen);
                assert!(expected.eq(polls.iter().map(|poll| *poll == Some(2))));
            });
        }
        // A first one that is not there.
        with(&[RESET, SET_UP, TWO], &[[High; 2]], |converter| {
            assert_eq!([(); 3].map(|()| converter.poll()), [None; 3]);
        });
    }

    #[test]
    fn converter_that_does_not_hold_its_registers_is_set_up_again() {
        let wrong: [&[u8]; 4] = [
            &[0; 9],
            &[0xff; 9],
            // One bit; after a reset of the converter.
            &[0, 0, 0, 2, 0, 0x0e, 0xd4, 0x40, 0x01],
            &[0, 0, 0, 2, 0, 0, 0, 0, 0],
        ];
        for answer in wrong {
            let reads = [TWO, (READ, answer), TWO];
            let lost = [(READ, answer); 4];
            let again = [RESET, SET_UP, TWO];
            let exchanges = [&[RESET, SET_UP], &reads[..], &lost, &again].concat();
            with(&exchanges, &[NEW; 8], |converter| {
                let polls = [(); 12].map(|()| converter.poll());
                let seen = [2, 4, 11].map(|n| polls[n]);
                assert_eq!(seen, [Some(2); 3]);
                assert_eq!(polls.iter().flatten().count(), 3);
            });
        }
    }

    /// A bus that fails.
    struct Broken;

    impl embedded_hal::spi::ErrorType for Broken {
        type Error = embedded_hal::spi::ErrorKind;
    }

    impl SpiBus for Broken {
        fn read(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn write(&mut self, _: &[u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn transfer(&mut self, _: &mut [u8], _: &[u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn transfer_in_place(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
            Err(embedded_hal::spi::ErrorKind::ModeFault)
        }
        fn flush(&mut self) -> Result<(), Self::Error> {
            Ok(())
        }
    }

    #[test]
    fn failure_of_the_bus_is_no_conversion_and_ends_the_frame() {
        let levels = [State::High, State::Low, State::High].map(PinState::set);
        let (mut select, mut ready) = (Pin::new(&levels), Pin::new(&[]));
        let mut converter = Ads1220::new(Broken, select.clone(), ready.clone());
        assert_eq!(converter.poll(), None);
        select.done();
        ready.done();
    }

    /// Half of 5 V.
    const SUPPLIED: AdcCount = AdcCount(3_102);

    #[test]
    fn bridge_without_its_supply_has_no_reading() {
        for (volts, supplied) in [
            (0.0, false),
            (3.9, false),
            (4.1, true),
            (5.4, true),
            (5.6, false),
        ] {
            let half = AdcCount((volts / 2.0 / 3.3 * 4095.0) as u16);
            let expected = if supplied { 3000 } else { 0 };
            assert_eq!(
                reading(half, &[code(3000); SCANS]),
                AdcCount(expected),
                "{volts} V"
            );
        }
    }

    /// The code in the middle of a count, of which 16 add nothing.
    fn code(count: i32) -> i32 {
        (count - 2048) * 1024 + 0x208
    }

    #[test]
    fn counts_are_those_of_the_chips_converter() {
        for count in [0, 1, 16, 2047, 2048, 2049, 4079, 4095] {
            assert_eq!(
                reading(SUPPLIED, &[code(count); SCANS]),
                AdcCount(count as u16)
            );
        }
        for (code, end) in [(-3_000_000, 0), (3_000_000, 4095)] {
            assert_eq!(reading(SUPPLIED, &[code; SCANS]), AdcCount(end));
        }
    }

    #[test]
    fn missing_and_clipped_conversions_are_no_reading_of_a_bridge() {
        let mut codes = [code(3000); SCANS];
        for lost in 0..SCANS {
            codes[lost] = NOT_CONVERTED;
            let seen = reading(SUPPLIED, &codes).0;
            // What is added is not 0 for any number of them.
            let expected = if lost < CONVERSIONS_MIN {
                2999..=3001
            } else {
                0..=0
            };
            assert!(expected.contains(&seen), "{lost}: {seen}");
        }
        for (clipped, end) in [(CODE_MIN, 0), (CODE_MAX, COUNT_MAX)] {
            let mut codes = [code(2048); SCANS];
            codes[5] = clipped;
            assert_eq!(reading(SUPPLIED, &codes), AdcCount(end));
        }
    }

    /// Noise of 60 codes rms, 0.3 µV, a third of the least that the converter has: readings never
    /// stand still for 50 ticks, and their mean is that of the bridge, also between two counts.
    /// Without noise they stand still at once.
    #[test]
    fn noise_moves_readings_and_not_their_mean() {
        let mut seed = 1_u32;
        let mut noise = || {
            // The sum of twelve uniform values has the variance of one.
            let uniform = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(seed) / f64::from(u32::MAX) - 0.5
            };
            (60.0 * core::iter::repeat_with(uniform).take(12).sum::<f64>()) as i32
        };
        for part in [0, 256, 512, 700, 1023] {
            let (mut same, mut last, mut sum) = (0, 0, 0.0);
            for _ in 0..20_000 {
                let AdcCount(count) = reading(
                    SUPPLIED,
                    &core::array::from_fn(|_| 300 * 1024 + part + noise()),
                );
                same = if count == last { same + 1 } else { 0 };
                assert!(same < 50);
                last = count;
                // The middle of the count.
                sum += f64::from(count) - 2048.0 + 0.5;
            }
            let off = sum / 20_000.0 - (300.0 + f64::from(part) / 1024.0);
            // A deviation of 2/√12 and a rounding of 1/√12 counts, and four standard errors; the
            // 256 values of the dither are half a step, 1/256 count, off their middle.
            let error = (5.0_f64 / 12.0 / 20_000.0).sqrt();
            assert!(off.abs() < 4.0 * error + 1.0 / 256.0, "{part}: {off}");
        }
        let frozen = reading(SUPPLIED, &[300 * 1024 + 77; SCANS]);
        assert_eq!(reading(SUPPLIED, &[300 * 1024 + 77; SCANS]), frozen);
    }
}

//! ADS1220 (data sheet SBAS501), the strain bridge's converter of a board that has one: commands,
//! registers, continuous conversions, and what can be wrong with it and its wires.
//!
//! It samples when it is read, and converts in turbo mode only.

use crate::errors::Context;
use crate::flash::mix;
use crate::time::{NEVER, Time, UNITS_PER_S};

/// Shortest period of SCLK: 150 ns.
pub const CLOCK_HZ_MAX: u64 = 6_666_667;
/// Its oscillator's clock.
const CLOCK: Time = UNITS_PER_S / 4_096_000;
/// From a START command to the first conversion's begin.
const START: Time = 114 * CLOCK;
/// A conversion at 2000 per second in turbo mode.
const CONVERSION: Time = 2_072 * CLOCK;
/// DRDY is high for so long before a conversion completes, if the one before was not read.
const PAUSE: Time = 16 * CLOCK;
/// From a RESET command to the next command: 50 µs and 32 clocks.
const RESET: Time = 50 * UNITS_PER_S / 1_000_000 + 32 * CLOCK;
/// Lowest reference \[V\].
const REFERENCE_VOLTS_MIN: f64 = 0.75;
/// What the firmware must have set: 2000 conversions per second in turbo mode, continuously, and
/// the reference at REFP0 and REFN0, which is the bridge's supply.
const RATE: (u8, u8) = (1, 0xd4);
const REFERENCE: (u8, u8) = (2, 0x40);
/// AIN0 - AIN1 at gain 128.
const INPUTS: (u8, u8) = (0, 0x0e);

/// What is wrong with the converter or its wires; resets of the chip do not change it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ConverterFaults {
    /// It has its supply. Without it, it loses its registers.
    pub powered: bool,
    /// The bridge's supply, which is the converter's reference \[V\]. PC0 has half of it.
    pub bridge_volts: f64,
    /// It makes no more conversions.
    pub hangs: bool,
    /// All conversions are the same.
    pub frozen: bool,
    /// Each conversion is off by up to this, either way \[codes\].
    pub noise_codes: f64,
    /// The converter's level at an end of its scale, as if a wire of the bridge were open.
    pub clipped: Option<bool>,
    /// Level to which DOUT is shorted.
    pub data_out: Option<bool>,
    /// Level to which DRDY is shorted.
    pub ready: Option<bool>,
    /// SCLK, DIN and CS arrive.
    pub wired: [bool; 3],
}

impl Default for ConverterFaults {
    fn default() -> ConverterFaults {
        ConverterFaults {
            powered: true,
            bridge_volts: 5.0,
            hangs: false,
            frozen: false,
            noise_codes: 0.0,
            clipped: None,
            data_out: None,
            ready: None,
            wired: [true; 3],
        }
    }
}

/// What the next byte at DIN is.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
enum Expected {
    #[default]
    Command,
    /// Registers from this one on, and their count.
    Registers(usize, usize),
    /// So many bytes that are not looked at, as data are read by command.
    Read(usize),
}

/// The converter. A reset of the chip does not reset it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ads1220 {
    registers: [u8; 4],
    selected: bool,
    expected: Expected,
    /// Bytes that DOUT sends next, the first one highest.
    out: u64,
    /// Begin of the first conversion.
    started: Option<Time>,
    /// Conversions completed when the last one was read.
    seen: u64,
    /// The same when CS fell: that conversion is read.
    loaded: u64,
    /// The last conversion that was read.
    code: i32,
    /// End of a reset.
    resets_until: Time,
    seed: u64,
}

impl Ads1220 {
    /// Loses what it holds, as it does without its supply.
    pub fn switch_off(&mut self) {
        *self = Ads1220 {
            seed: self.seed,
            ..Ads1220::default()
        };
    }

    /// Conversions completed.
    fn completed(&self, now: Time) -> u64 {
        let since = self.started.map_or(0, |at| now.saturating_sub(at));
        since / CONVERSION
    }

    /// Level of DRDY.
    pub fn ready(&self, now: Time, faults: &ConverterFaults) -> bool {
        let completed = self.completed(now);
        let until_next = match self.started {
            Some(at) => CONVERSION - now.saturating_sub(at) % CONVERSION,
            None => NEVER,
        };
        let fresh = completed > self.seen && !faults.hangs && until_next > PAUSE;
        // Without its supply the pin's diode pulls it down.
        faults.ready.unwrap_or(faults.powered && !fresh)
    }

    /// Takes the level of CS.
    pub fn select(&mut self, low: bool, now: Time, faults: &ConverterFaults, volts_per_volt: f64) {
        let low = low && faults.wired[2] && faults.powered;
        if low && !self.selected {
            self.expected = Expected::Command;
            if self.completed(now) > self.seen && !faults.hangs {
                self.code = self.convert(faults, volts_per_volt);
            }
            self.loaded = self.completed(now);
            self.load();
        }
        self.selected = low;
    }

    fn load(&mut self) {
        self.out = u64::from(self.code as u32 & 0xff_ffff) << 40;
    }

    /// The bridge's signal as a code: at gain 128 the scale ends at ±1/128 of the reference.
    fn convert(&mut self, faults: &ConverterFaults, volts_per_volt: f64) -> i32 {
        // Without a reference a conversion is anything: the last one is.
        if faults.frozen || faults.bridge_volts < REFERENCE_VOLTS_MIN {
            return self.code;
        }
        let noise = (mix(&mut self.seed) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
        let code = volts_per_volt * 128.0 * 8_388_608.0 + noise * faults.noise_codes;
        match faults.clipped {
            Some(true) => 0x7f_ffff,
            Some(false) => -0x80_0000,
            None => (code.round() as i32).clamp(-0x80_0000, 0x7f_ffff),
        }
    }

    /// Takes a byte from DIN; the byte at DOUT in the same time.
    pub fn exchange(&mut self, byte: u8, faults: &ConverterFaults, cx: &mut Context) -> u8 {
        let [clock, data_in, _] = faults.wired;
        let sent = if self.selected && clock {
            let byte = if data_in { byte } else { 0 };
            let sent = (self.out >> 56) as u8;
            self.out <<= 8;
            // The first edge of SCLK ends DRDY.
            self.seen = self.loaded;
            self.receive(byte, cx);
            sent
        } else {
            // DOUT floats; the chip's input is pulled down, or reads what it likes.
            0
        };
        match faults.data_out {
            Some(high) => u8::from(high) * 0xff,
            None => sent,
        }
    }

    fn receive(&mut self, byte: u8, cx: &mut Context) {
        match self.expected {
            Expected::Registers(first, count) => {
                self.registers[first % 4] = byte;
                // Writing a register restarts a conversion.
                self.restart(self.started.is_some(), cx.now);
                self.expected = match count {
                    1 => Expected::Command,
                    _ => Expected::Registers(first + 1, count - 1),
                };
            }
            Expected::Read(1) => self.expected = Expected::Command,
            Expected::Read(count) => self.expected = Expected::Read(count - 1),
            Expected::Command => self.command(byte, cx),
        }
    }

    fn command(&mut self, byte: u8, cx: &mut Context) {
        let (first, count) = (usize::from(byte >> 2 & 3), usize::from(byte & 3) + 1);
        if byte != 0 && cx.now < self.resets_until {
            cx.error("ADS1220: command during its reset");
        }
        match byte {
            0 => {}
            0x06 | 0x07 => {
                self.switch_off();
                self.selected = true;
                self.resets_until = cx.now + RESET;
            }
            0x08 | 0x09 => {
                for (register, expected) in [INPUTS, RATE, REFERENCE] {
                    if self.registers[usize::from(register)] != expected {
                        cx.error(format!("model: ADS1220: register {register} as it is set"));
                    }
                }
                self.restart(true, cx.now);
            }
            0x10..=0x1f => {
                self.load();
                self.expected = Expected::Read(3);
            }
            0x20..=0x2f => {
                let register = |n: usize| u64::from(self.registers[(first + n) % 4]);
                self.out = (0..count).fold(0, |out, n| out | register(n) << (56 - 8 * n));
                self.expected = Expected::Read(count);
            }
            0x40..=0x4f => self.expected = Expected::Registers(first, count),
            _ => cx.error(format!("model: ADS1220: command {byte:#04x}")),
        }
    }

    fn restart(&mut self, converts: bool, now: Time) {
        self.started = converts.then_some(now + START);
        (self.seen, self.loaded) = (0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    const HEALTHY: ConverterFaults = ConverterFaults {
        powered: true,
        bridge_volts: 5.0,
        hangs: false,
        frozen: false,
        noise_codes: 0.0,
        clipped: None,
        data_out: None,
        ready: None,
        wired: [true; 3],
    };

    struct Bench {
        converter: Ads1220,
        errors: Errors,
        faults: ConverterFaults,
        now: Time,
        volts_per_volt: f64,
    }

    impl Bench {
        fn new() -> Bench {
            Bench {
                converter: Ads1220::default(),
                errors: Errors::default(),
                faults: HEALTHY,
                now: 0,
                volts_per_volt: 1.0 / 256.0,
            }
        }

        fn frame(&mut self, bytes: &[u8]) -> Vec<u8> {
            let (now, faults, signal) = (self.now, self.faults, self.volts_per_volt);
            self.converter.select(true, now, &faults, signal);
            let mut cx = test_context(&mut self.errors, now);
            let answers = bytes
                .iter()
                .map(|byte| self.converter.exchange(*byte, &faults, &mut cx))
                .collect();
            self.converter.select(false, now, &faults, signal);
            answers
        }

        fn ready(&self) -> bool {
            !self.converter.ready(self.now, &self.faults)
        }
    }

    fn converting() -> Bench {
        let mut bench = Bench::new();
        bench.frame(&[0x43, 0x0e, 0xd4, 0x40, 0x00, 0x08]);
        bench
    }

    #[test]
    fn registers_are_read_back_until_a_reset() {
        let mut bench = converting();
        assert_eq!(bench.frame(&[0x23, 0, 0, 0, 0])[1..], [0x0e, 0xd4, 0x40, 0]);
        assert_eq!(bench.frame(&[0x24, 0])[1..], [0xd4]);
        bench.frame(&[0x06]);
        assert!(bench.errors.list.is_empty());
        assert_eq!(bench.frame(&[0x23, 0, 0, 0, 0])[1..], [0; 4]);
        assert_eq!(bench.errors.list.len(), 1, "too early");
    }

    #[test]
    fn conversion_is_ready_until_it_is_read() {
        let mut bench = converting();
        assert!(!bench.ready());
        bench.now = START + CONVERSION - 1;
        assert!(!bench.ready());
        bench.now += 1;
        assert!(bench.ready());
        // Half of the scale.
        assert_eq!(bench.frame(&[0; 3]), [0x40, 0, 0]);
        assert!(!bench.ready());
        bench.now += CONVERSION;
        assert!(bench.ready());
        bench.now += CONVERSION - PAUSE;
        assert!(!bench.ready(), "a pause before the next one");
        bench.now += PAUSE;
        bench.volts_per_volt = -1.0;
        let answer = bench.frame(&[0x10, 0, 0, 0, 0x23, 0, 0, 0, 0]);
        assert_eq!(answer[1..], [0x80, 0, 0, 0, 0x0e, 0xd4, 0x40, 0]);
        assert!(bench.errors.list.is_empty(), "{:?}", bench.errors.list);
    }

    #[test]
    fn faults_are_those_of_their_wire() {
        let faults = [
            (
                ConverterFaults {
                    hangs: true,
                    ..HEALTHY
                },
                false,
                [0x40, 0, 0],
            ),
            (
                ConverterFaults {
                    ready: Some(false),
                    ..HEALTHY
                },
                true,
                [0x40, 0, 0],
            ),
            (
                ConverterFaults {
                    data_out: Some(true),
                    ..HEALTHY
                },
                true,
                [0xff; 3],
            ),
            (
                ConverterFaults {
                    wired: [false, true, true],
                    ..HEALTHY
                },
                true,
                [0; 3],
            ),
            (
                ConverterFaults {
                    wired: [true, true, false],
                    ..HEALTHY
                },
                true,
                [0; 3],
            ),
            (
                ConverterFaults {
                    clipped: Some(true),
                    ..HEALTHY
                },
                true,
                [0x7f, 0xff, 0xff],
            ),
        ];
        for (faults, ready, data) in faults {
            let mut bench = converting();
            bench.now = START + CONVERSION;
            bench.frame(&[0; 3]);
            bench.now += CONVERSION;
            bench.faults = faults;
            assert_eq!(
                (bench.ready(), &bench.frame(&[0; 3])[..]),
                (ready, &data[..])
            );
        }
        let mut bench = converting();
        bench.converter.switch_off();
        bench.now = 10 * CONVERSION;
        assert!(!bench.ready());
    }
}

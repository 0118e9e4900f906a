//! USART2: receiver and transmitter with exact byte times, DMA requests
//! (RM0390 chapter 25).

use crate::errors::Context;
use crate::time::{NEVER, Time, UNITS_PER_S};
use std::collections::VecDeque;

const FE: u32 = 1 << 1;
const ORE: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const UE: u32 = 1 << 13;
const DMAR: u32 = 1 << 6;
const DMAT: u32 = 1 << 7;
/// Baud rate difference that a receiver tolerates (RM0390, USART receiver tolerance: 8 data bits,
/// oversampling by 16, a divider with a fraction).
const BAUD_TOLERANCE: f64 = 0.0333;

/// A byte on the line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TimedByte {
    /// End of its stop bit.
    pub at: Time,
    /// Its value.
    pub byte: u8,
}

/// The other end of the line: the PC, through the ST-LINK.
pub struct Host {
    /// Baud rate \[bit/s\].
    pub baud: u32,
    /// Bytes sent to the board that have not arrived.
    to_board: VecDeque<u8>,
    /// Arrival time of the first of them.
    arrives_at: Time,
    /// Bytes received from the board.
    pub received: Vec<TimedByte>,
}

impl Default for Host {
    fn default() -> Self {
        Host {
            baud: 115_200,
            to_board: VecDeque::new(),
            arrives_at: NEVER,
            received: vec![],
        }
    }
}

impl Host {
    fn byte_time(&self) -> Time {
        UNITS_PER_S * 10 / u64::from(self.baud)
    }

    /// Sends bytes after those that have not arrived yet.
    pub fn send(&mut self, bytes: &[u8], now: Time) {
        if self.to_board.is_empty() && !bytes.is_empty() {
            self.arrives_at = now + self.byte_time();
        }
        self.to_board.extend(bytes);
    }

    /// Count of the bytes that have not arrived yet.
    pub fn unsent(&self) -> usize {
        self.to_board.len()
    }

    fn take(&mut self) -> Option<TimedByte> {
        let (at, byte) = (self.arrives_at, self.to_board.pop_front()?);
        self.arrives_at = if self.to_board.is_empty() {
            NEVER
        } else {
            at + self.byte_time()
        };
        Some(TimedByte { at, byte })
    }
}

/// The registers.
pub struct Usart {
    sr: u32,
    brr: u32,
    cr: [u32; 3],
    gtpr: u32,
    rdr: u8,
    sr_was_read: bool,
    shift: Option<(u8, Time)>,
    held: Option<u8>,
    idle_at: Time,
    /// Duration of one clock of APB1.
    pclk1: Time,
}

impl Usart {
    /// The state after a reset.
    pub fn new(pclk1: Time) -> Usart {
        Usart {
            sr: TXE | TC,
            brr: 0,
            cr: [0; 3],
            gtpr: 0,
            rdr: 0,
            sr_was_read: false,
            shift: None,
            held: None,
            idle_at: NEVER,
            pclk1,
        }
    }

    /// Sets the clock of the bus, which applies from the next byte.
    pub fn set_clock(&mut self, pclk1: Time) {
        self.pclk1 = pclk1;
    }

    /// Duration of a bit: BRR clocks, for either oversampling.
    fn bit_time(&self) -> Time {
        let over8 = self.cr[0] & 1 << 15 != 0;
        let clocks = if over8 {
            (self.brr >> 4) * 8 + (self.brr & 7)
        } else {
            self.brr
        };
        self.pclk1 * u64::from(clocks)
    }

    fn byte_time(&self) -> Time {
        let data = if self.cr[0] & 1 << 12 != 0 { 9 } else { 8 };
        let stop = if self.cr[1] >> 12 & 3 == 2 { 2 } else { 1 };
        self.bit_time() * (1 + data + stop)
    }

    /// Baud rate \[bit/s\]; 0 if none is set.
    pub fn baud(&self) -> u64 {
        UNITS_PER_S.checked_div(self.bit_time()).unwrap_or(0)
    }

    fn fits(&self, host: &Host) -> bool {
        (self.baud() as f64 / f64::from(host.baud) - 1.0).abs() < BAUD_TOLERANCE
    }

    /// Time of the next event.
    pub fn next(&self, host: &Host) -> Time {
        let shifted = self.shift.map_or(NEVER, |(_, at)| at);
        shifted.min(self.idle_at).min(host.arrives_at)
    }

    /// Level of the interrupt line.
    pub fn irq(&self) -> bool {
        let enabled = self.cr[0] & (TXE | TC | RXNE | IDLE);
        self.sr & enabled != 0
            || self.sr & ORE != 0 && enabled & RXNE != 0
            || self.sr & (FE | ORE) != 0 && self.cr[2] & 1 != 0 && self.cr[2] & DMAR != 0
    }

    /// Whether the receiver has a byte for the DMA.
    pub fn wants_rx_dma(&self) -> bool {
        self.cr[2] & DMAR != 0 && self.sr & RXNE != 0
    }

    /// Whether the transmitter requests a byte from the DMA.
    pub fn wants_tx_dma(&self) -> bool {
        self.cr[2] & DMAT != 0 && self.sr & TXE != 0 && self.cr[0] & (UE | TE) == UE | TE
    }

    /// Executes the events that are due; `wired` is whether TX and RX are connected to their pins.
    pub fn fire(&mut self, host: &mut Host, wired: (bool, bool), cx: &mut Context) {
        if let Some((byte, at)) = self.shift.filter(|(_, at)| *at <= cx.now) {
            self.deliver(host, TimedByte { at, byte }, wired.0, cx);
            self.shift = self.held.take().map(|byte| (byte, at + self.byte_time()));
            self.sr |= TXE;
            if self.shift.is_none() {
                self.sr |= TC;
            }
        }
        if host.arrives_at <= cx.now
            && let Some(timed) = host.take()
        {
            self.receive(host, timed, wired.1, cx);
        }
        if self.idle_at <= cx.now {
            self.idle_at = NEVER;
            self.sr |= IDLE;
        }
    }

    fn deliver(&self, host: &mut Host, timed: TimedByte, wired: bool, cx: &mut Context) {
        if !wired {
            return cx.error("USART2: a byte is sent, but PA2 is not configured as TX (AF7)");
        }
        if !self.fits(host) {
            let (ours, theirs) = (self.baud(), host.baud);
            return cx.error(format!(
                "USART2: sends at {ours} baud, the PC receives at {theirs}"
            ));
        }
        host.received.push(timed);
    }

    fn receive(&mut self, host: &Host, timed: TimedByte, wired: bool, cx: &mut Context) {
        if self.cr[0] & (UE | RE) != UE | RE {
            return;
        }
        if !wired {
            return cx.error("USART2: a byte arrives, but PA3 is not configured as RX (AF7)");
        }
        self.idle_at = if host.to_board.is_empty() {
            timed.at + self.byte_time()
        } else {
            NEVER
        };
        if self.sr & RXNE != 0 {
            self.sr |= ORE;
            return cx.error("USART2: overrun, a received byte was lost");
        }
        self.rdr = timed.byte;
        self.sr |= RXNE;
        if !self.fits(host) {
            self.rdr ^= 0x55;
            self.sr |= FE;
            let (ours, theirs) = (self.baud(), host.baud);
            cx.error(format!(
                "USART2: receives at {ours} baud, the PC sends at {theirs}"
            ));
        }
    }

    /// Reads a register; reading SR and then DR clears the error flags and IDLE.
    pub fn read(&mut self, offset: u32) -> u32 {
        match offset {
            0x00 => {
                self.sr_was_read = true;
                self.sr
            }
            0x04 => {
                if std::mem::take(&mut self.sr_was_read) {
                    self.sr &= !(FE | ORE | IDLE | 5);
                }
                self.sr &= !RXNE;
                u32::from(self.rdr)
            }
            0x08 => self.brr,
            0x0c..=0x14 => self.cr[(offset as usize - 0x0c) / 4],
            0x18 => self.gtpr,
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) {
        match offset {
            0x00 => self.sr &= value | !(RXNE | TC),
            0x04 => self.transmit(value as u8, cx),
            0x08 => self.brr = value & 0xffff,
            0x0c..=0x14 => {
                self.cr[(offset as usize - 0x0c) / 4] = value;
                if self.cr[0] & 1 << 10 != 0 || self.cr[2] & 0x32a != 0 {
                    cx.error("model: USART2 has no parity, flow control or half duplex");
                }
            }
            0x18 => self.gtpr = value,
            _ => {}
        }
    }

    fn transmit(&mut self, byte: u8, cx: &mut Context) {
        if self.cr[0] & (UE | TE) != UE | TE {
            return cx.error("USART2: DR written while the transmitter is off: lost");
        }
        self.sr &= !TC;
        if self.shift.is_none() {
            self.shift = Some((byte, cx.now + self.byte_time()));
        } else {
            if self.held.is_some() {
                cx.error("USART2: DR written before it was empty: a byte is lost");
            }
            self.held = Some(byte);
            self.sr &= !TXE;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    /// One clock of 45 MHz.
    const PCLK1: Time = 1120;
    /// 115 385 baud.
    const BRR: u32 = 390;

    fn usart() -> (Usart, Host, Errors) {
        let (mut usart, mut errors) = (Usart::new(PCLK1), Errors::default());
        for (offset, value) in [(0x08, BRR), (0x0c, UE | TE | RE)] {
            usart.write(offset, value, &mut test_context(&mut errors, 0));
        }
        (usart, Host::default(), errors)
    }

    fn run(usart: &mut Usart, host: &mut Host, errors: &mut Errors, until: Time) {
        while usart.next(host) <= until {
            let now = usart.next(host);
            usart.fire(host, (true, true), &mut test_context(errors, now));
        }
    }

    #[test]
    fn brr_sets_the_baud_rate() {
        let (mut usart, mut host, mut errors) = usart();
        for byte in [1, 2] {
            usart.write(4, byte, &mut test_context(&mut errors, 0));
        }
        assert_eq!(usart.read(0) & (TXE | TC), 0);
        run(&mut usart, &mut host, &mut errors, UNITS_PER_S);
        let byte_time = PCLK1 * u64::from(BRR) * 10;
        let expected =
            [(byte_time, 1), (2 * byte_time, 2)].map(|(at, byte)| TimedByte { at, byte });
        assert_eq!(host.received, expected);
        assert_eq!(usart.read(0) & (TXE | TC), TXE | TC);
        assert!(errors.list.is_empty());
    }

    #[test]
    fn idle_line_is_detected_after_a_byte() {
        let (mut usart, mut host, mut errors) = usart();
        host.send(b"a", 0);
        run(&mut usart, &mut host, &mut errors, UNITS_PER_S);
        assert_eq!(usart.read(0) & (RXNE | IDLE), RXNE | IDLE);
        assert_eq!(usart.read(4), u32::from(b'a'));
        assert_eq!(usart.read(0) & (RXNE | IDLE), 0);
    }

    #[test]
    fn byte_that_was_not_read_causes_an_overrun() {
        let (mut usart, mut host, mut errors) = usart();
        host.send(b"ab", 0);
        run(&mut usart, &mut host, &mut errors, UNITS_PER_S);
        assert_eq!((usart.read(0) & ORE, usart.read(4)), (ORE, u32::from(b'a')));
        assert_eq!(errors.list.len(), 1);
    }

    #[test]
    fn wrong_baud_rate_and_wrong_pin_are_reported() {
        let (mut usart, mut host, mut errors) = usart();
        host.baud = 9600;
        usart.write(4, 1, &mut test_context(&mut errors, 0));
        run(&mut usart, &mut host, &mut errors, UNITS_PER_S);
        assert_eq!((host.received.len(), errors.list.len()), (0, 1));
        host.baud = 115_200;
        usart.write(4, 1, &mut test_context(&mut errors, 0));
        usart.fire(
            &mut host,
            (false, true),
            &mut test_context(&mut errors, UNITS_PER_S),
        );
        assert_eq!((host.received.len(), errors.list.len()), (0, 2));
    }

    #[test]
    fn dma_is_requested_only_if_enabled() {
        let (mut usart, mut host, mut errors) = usart();
        assert!(!usart.wants_tx_dma());
        usart.write(0x14, DMAT | DMAR, &mut test_context(&mut errors, 0));
        assert!(usart.wants_tx_dma() && !usart.wants_rx_dma());
        host.send(b"a", 0);
        run(&mut usart, &mut host, &mut errors, UNITS_PER_S);
        assert!(usart.wants_rx_dma());
    }
}

//! DMA1 and DMA2: eight streams each, between a peripheral and memory (RM0390 chapter 9).

use crate::errors::Context;

const EN: u32 = 1;
const CIRC: u32 = 1 << 8;
const PINC: u32 = 1 << 9;
const MINC: u32 = 1 << 10;
const DBM: u32 = 1 << 18;
const CT: u32 = 1 << 19;
/// Flags of a stream, in the order of the interrupt enables shifted by one.
const TEIF: u64 = 1 << 3;
const HTIF: u64 = 1 << 4;
const TCIF: u64 = 1 << 5;
const SHIFTS: [u32; 8] = [0, 6, 16, 22, 32, 38, 48, 54];

/// One item to transfer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Transfer {
    /// Address to read.
    pub from: u32,
    /// Address to write.
    pub to: u32,
    /// Length in bytes.
    pub size: usize,
    /// Whether it is the last item of the stream.
    pub last: bool,
}

#[derive(Default, Clone, Copy)]
struct Stream {
    cr: u32,
    /// Items left, and the count at the start of a transfer.
    ndtr: u32,
    reload: u32,
    par: u32,
    memory: [u32; 2],
    fcr: u32,
}

/// One controller.
pub struct Dma {
    number: usize,
    flags: u64,
    streams: [Stream; 8],
}

impl Dma {
    /// Controller 1 or 2 in the state after a reset.
    pub fn new(number: usize) -> Dma {
        let stream = Stream {
            fcr: 0x21,
            ..Stream::default()
        };
        Dma {
            number,
            flags: 0,
            streams: [stream; 8],
        }
    }

    /// Level of the interrupt line of `stream`.
    pub fn irq(&self, stream: usize) -> bool {
        let enables = u64::from(self.streams[stream].cr >> 1 & 0xf) << 2;
        (self.flags >> SHIFTS[stream]) & enables & (TCIF | HTIF | TEIF) != 0
    }

    /// Whether `stream` would serve a request of `channel`.
    pub fn listens(&self, stream: usize, channel: u32) -> bool {
        let cr = self.streams[stream].cr;
        cr & EN != 0 && cr >> 25 & 7 == channel
    }

    /// Handles a request of a peripheral: the item to transfer, if the stream serves the request.
    pub fn request(&mut self, stream: usize, channel: u32) -> Option<Transfer> {
        if !self.listens(stream, channel) {
            return None;
        }
        let flags = SHIFTS[stream];
        let s = &mut self.streams[stream];
        let size = 1 << (s.cr >> 11 & 3);
        let index = s.reload - s.ndtr;
        let step = |inc: u32| {
            if s.cr & inc != 0 {
                index * size as u32
            } else {
                0
            }
        };
        let memory = s.memory[(s.cr & CT != 0) as usize] + step(MINC);
        let peripheral = s.par + step(PINC);
        let (from, to) = match s.cr >> 6 & 3 {
            0 => (peripheral, memory),
            _ => (memory, peripheral),
        };
        s.ndtr -= 1;
        if s.ndtr == s.reload / 2 {
            self.flags |= HTIF << flags;
        }
        let last = s.ndtr == 0;
        if last {
            self.flags |= TCIF << flags;
            if s.cr & (CIRC | DBM) != 0 {
                s.ndtr = s.reload;
            } else {
                s.cr &= !EN;
            }
            if s.cr & DBM != 0 {
                s.cr ^= CT;
            }
        }
        Some(Transfer {
            from,
            to,
            size,
            last,
        })
    }

    /// Handles a bus error in a transfer of `stream`.
    pub fn failed(&mut self, stream: usize) {
        self.streams[stream].cr &= !EN;
        self.flags |= TEIF << SHIFTS[stream];
    }

    /// Reads a register.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.flags as u32,
            0x04 => (self.flags >> 32) as u32,
            0x10..=0xcf => {
                let s = &self.streams[(offset as usize - 0x10) / 0x18];
                match (offset - 0x10) % 0x18 {
                    0x00 => s.cr,
                    0x04 => s.ndtr,
                    0x08 => s.par,
                    0x0c => s.memory[0],
                    0x10 => s.memory[1],
                    _ => s.fcr,
                }
            }
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, cx: &mut Context) {
        match offset {
            0x08 => self.flags &= !u64::from(value),
            0x0c => self.flags &= !(u64::from(value) << 32),
            0x10..=0xcf => {
                let stream = (offset as usize - 0x10) / 0x18;
                self.write_stream(stream, (offset - 0x10) % 0x18, value, cx);
            }
            _ => {}
        }
    }

    fn write_stream(&mut self, stream: usize, offset: u32, value: u32, cx: &mut Context) {
        let name = format!("DMA{} stream {stream}", self.number);
        let s = &mut self.streams[stream];
        let enabled = s.cr & EN != 0;
        // the alternate address may change while its buffer is not in use
        let idle_half = s.cr & DBM != 0 && offset == if s.cr & CT != 0 { 0x0c } else { 0x10 };
        if enabled && offset != 0 && !idle_half {
            return cx.error(format!("{name}: written while enabled: ignored"));
        }
        match offset {
            0x00 if enabled && value & EN == 0 => {
                s.cr = value;
                self.flags |= TCIF << SHIFTS[stream];
            }
            0x00 if !enabled && value & EN != 0 => self.enable(stream, value, &name, cx),
            0x00 => s.cr = value,
            0x04 => (s.ndtr, s.reload) = (value & 0xffff, value & 0xffff),
            0x08 => s.par = value,
            0x0c => s.memory[0] = value,
            0x10 => s.memory[1] = value,
            _ => s.fcr = s.fcr & 0x38 | value & 0x87,
        }
    }

    fn enable(&mut self, stream: usize, value: u32, name: &str, cx: &mut Context) {
        if self.flags >> SHIFTS[stream] & (TCIF | TEIF) != 0 {
            cx.error(format!(
                "{name}: enabled with flags of the last transfer still set"
            ));
        }
        let s = &mut self.streams[stream];
        s.cr = value;
        s.reload = if s.ndtr == 0 { s.reload } else { s.ndtr };
        s.ndtr = s.reload;
        if value >> 11 & 3 != value >> 13 & 3 {
            cx.error(format!("model: {name} has no packing of different widths"));
        }
        if value >> 6 & 3 > 1 {
            cx.error(format!("model: {name} has no memory-to-memory transfers"));
        }
        if s.reload == 0 {
            s.cr &= !EN;
            cx.error(format!("{name}: enabled with nothing to transfer"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::{Errors, test_context};

    /// Peripheral to memory, 16 bits, memory incremented, channel 0.
    const CONFIG: u32 = 1 << 13 | 1 << 11 | MINC | 1 << 4;

    fn dma(cr: u32, items: u32) -> Dma {
        let mut dma = Dma::new(2);
        let mut errors = Errors::default();
        for (offset, value) in [
            (0x14, items),
            (0x18, 0x4001_204c),
            (0x1c, 0x2000_0000),
            (0x10, cr),
        ] {
            dma.write(offset, value, &mut test_context(&mut errors, 0));
        }
        assert!(errors.list.is_empty(), "{:?}", errors.list);
        dma
    }

    #[test]
    fn stream_transfers_its_count_then_stops_and_interrupts() {
        let mut dma = dma(CONFIG | EN, 4);
        let addresses: Vec<u32> = (0..4).map(|_| dma.request(0, 0).unwrap().to).collect();
        assert_eq!(
            addresses,
            [0x2000_0000, 0x2000_0002, 0x2000_0004, 0x2000_0006]
        );
        assert_eq!(dma.request(0, 0), None);
        assert!(dma.irq(0));
        assert_eq!(dma.read(0), (TCIF | HTIF) as u32);
        dma.write(0x08, 0x3d, &mut test_context(&mut Errors::default(), 0));
        assert!(!dma.irq(0));
    }

    #[test]
    fn circular_stream_restarts() {
        let mut dma = dma(CONFIG | CIRC | EN, 2);
        let addresses: Vec<u32> = (0..3).map(|_| dma.request(0, 0).unwrap().to).collect();
        assert_eq!(addresses, [0x2000_0000, 0x2000_0002, 0x2000_0000]);
    }

    #[test]
    fn double_buffer_changes_the_target() {
        let mut dma = dma(CONFIG | DBM, 1);
        let mut errors = Errors::default();
        dma.write(0x20, 0x2000_1000, &mut test_context(&mut errors, 0));
        dma.write(0x10, CONFIG | DBM | EN, &mut test_context(&mut errors, 0));
        let addresses: Vec<u32> = (0..3).map(|_| dma.request(0, 0).unwrap().to).collect();
        assert_eq!(addresses, [0x2000_0000, 0x2000_1000, 0x2000_0000]);
    }

    #[test]
    fn requests_of_another_channel_are_not_served() {
        assert_eq!(dma(CONFIG | EN, 4).request(0, 1), None);
    }

    #[test]
    fn stale_flags_and_writes_while_enabled_are_reported() {
        let (mut dma, mut errors) = (dma(CONFIG | EN, 1), Errors::default());
        dma.write(0x1c, 0, &mut test_context(&mut errors, 0));
        dma.request(0, 0);
        dma.write(0x10, CONFIG | EN, &mut test_context(&mut errors, 0));
        assert_eq!(errors.list.len(), 2, "{:?}", errors.list);
    }
}

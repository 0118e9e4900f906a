//! The serial port of the link: USART2 with a DMA stream and a ring buffer in each direction. No
//! call but [`Serial::flush`] blocks, which is why it does not implement the traits of
//! `embedded-io`.

use crate::board::{self, LinkPins};
use core::ops::Range;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use embedded_hal::delay::DelayNs;
use stm32f4xx_hal::ClearFlags;
use stm32f4xx_hal::dma::{
    DmaChannel, DmaDirection, DmaFlag, Stream5, Stream6,
    traits::{PeriAddress, Stream},
};
use stm32f4xx_hal::pac::{DMA1, USART2};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;
use stm32f4xx_hal::serial::{self, config::Config, config::DmaConfig};

/// Length of each buffer: eleven periods of the link task at full rate. It divides 2³², so that
/// the byte counts may wrap.
const BUFFER_LEN: usize = 1024;

/// Time that three bytes of ten bits take \[µs\]: the two in the USART, and one in reserve.
const LAST_BYTES_US: u32 = (3 * 10 * 1_000_000_u32).div_ceil(board::LINK_BAUD);

/// The buffers of the DMA: atomics, because the CPU accesses them at the same time.
static RECEIVED: [AtomicU8; BUFFER_LEN] = [const { AtomicU8::new(0) }; BUFFER_LEN];
static TO_SEND: [AtomicU8; BUFFER_LEN] = [const { AtomicU8::new(0) }; BUFFER_LEN];

/// Addresses of these buffers, and what lies between them.
pub fn buffers() -> Range<u32> {
    let [received, to_send] = [&RECEIVED, &TO_SEND].map(|buffer| buffer.as_ptr_range());
    let start = received.start.min(to_send.start) as u32;
    start & !3..(received.end.max(to_send.end) as u32).next_multiple_of(4)
}

/// The serial port.
pub struct Serial {
    rx: Stream5<DMA1>,
    tx: Stream6<DMA1>,
    /// Index in `RECEIVED` of the next byte to read.
    read_index: usize,
    /// Count of the bytes ever written to `TO_SEND`, wrapping.
    written: usize,
    /// Count of the bytes ever sent, wrapping.
    sent: usize,
    /// Length of the DMA transfer in progress; its bytes are not yet counted as sent.
    sending: usize,
}

impl Serial {
    /// Configures port and streams, and starts receiving.
    pub fn new(
        usart: USART2,
        pins: LinkPins,
        (mut rx, mut tx): (Stream5<DMA1>, Stream6<DMA1>),
        rcc: &mut Rcc,
    ) -> Serial {
        let config = Config::default()
            .baudrate(board::LINK_BAUD.bps())
            .dma(DmaConfig::TxRx);
        let Ok(serial) = serial::Serial::<_, u8>::new(usart, pins, config, rcc) else {
            unreachable!("the clock of the port can be divided to this baud rate");
        };
        let (usart_tx, usart_rx) = serial.split();

        rx.set_channel(DmaChannel::Channel4);
        rx.set_direction(DmaDirection::PeripheralToMemory);
        rx.set_peripheral_address(usart_rx.address());
        rx.set_memory_address(RECEIVED.as_ptr() as u32);
        rx.set_number_of_transfers(BUFFER_LEN as u16);
        rx.set_memory_increment(true);
        rx.set_circular_mode(true);
        // SAFETY: address and length are those of the static RECEIVED.
        #[allow(unsafe_code)]
        unsafe {
            rx.enable();
        }
        tx.set_channel(DmaChannel::Channel4);
        tx.set_direction(DmaDirection::MemoryToPeripheral);
        tx.set_peripheral_address(usart_tx.address());
        tx.set_memory_increment(true);
        Serial {
            rx,
            tx,
            read_index: 0,
            written: 0,
            sent: 0,
            sending: 0,
        }
    }

    /// The next received byte, if there is one.
    pub fn read(&mut self) -> Option<u8> {
        let write_index = BUFFER_LEN - usize::from(self.rx.number_of_transfers());
        if self.read_index == write_index % BUFFER_LEN {
            return None;
        }
        let byte = RECEIVED[self.read_index].load(Relaxed);
        self.read_index = (self.read_index + 1) % BUFFER_LEN;
        Some(byte)
    }

    /// Free bytes in the send buffer.
    pub fn room(&self) -> usize {
        BUFFER_LEN - self.written.wrapping_sub(self.sent)
    }

    /// Writes to the send buffer. [`Serial::room`] must be at least the length of `bytes`.
    pub fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            TO_SEND[self.written % BUFFER_LEN].store(*byte, Relaxed);
            self.written = self.written.wrapping_add(1);
        }
    }

    /// Starts the next DMA transfer if none is in progress and there are bytes to send.
    pub fn pump(&mut self) {
        if self.tx.is_enabled() {
            return;
        }
        self.sent = self.sent.wrapping_add(self.sending);
        let start = self.sent % BUFFER_LEN;
        self.sending = self.written.wrapping_sub(self.sent).min(BUFFER_LEN - start);
        if self.sending == 0 {
            return;
        }
        self.tx
            .clear_flags(DmaFlag::TransferComplete | DmaFlag::HalfTransfer);
        self.tx
            .clear_flags(DmaFlag::FifoError | DmaFlag::TransferError);
        self.tx.set_memory_address(TO_SEND[start..].as_ptr() as u32);
        self.tx.set_number_of_transfers(self.sending as u16);
        // SAFETY: address and length are within the static TO_SEND.
        #[allow(unsafe_code)]
        unsafe {
            self.tx.enable();
        }
    }

    /// Sends everything in the buffer, and waits until the last bit has left the pin.
    pub fn flush(&mut self, delay: &mut impl DelayNs) {
        while self.tx.is_enabled() || self.written != self.sent {
            self.pump();
        }
        // When the DMA has ended, the USART still holds two bytes.
        delay.delay_us(LAST_BYTES_US);
    }
}

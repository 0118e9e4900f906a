//! The serial link: USART2 with DMA both ways, served once a millisecond below the tick.

use crate::board::{self, LinkPins};
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use model_core::link::{self, Decoder, FRAME_LEN_MAX, FromDevice, Telemetry, ToDevice};
use stm32f4xx_hal::ClearFlags;
use stm32f4xx_hal::dma::{
    DmaChannel, DmaDirection, DmaFlag, Stream5, Stream6,
    traits::{PeriAddress, Stream},
};
use stm32f4xx_hal::pac::{DMA1, USART2};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Rcc;
use stm32f4xx_hal::serial::{Serial, config::Config, config::DmaConfig};

/// Bytes each way: eleven turns' worth at full rate. The length divides 2³².
const BUFFER_LEN: usize = 1024;

/// What the DMA writes and reads, while the CPU does too.
static RECEIVED: [AtomicU8; BUFFER_LEN] = [const { AtomicU8::new(0) }; BUFFER_LEN];
static TO_SEND: [AtomicU8; BUFFER_LEN] = [const { AtomicU8::new(0) }; BUFFER_LEN];

/// The link.
pub struct Link {
    rx: Stream5<DMA1>,
    tx: Stream6<DMA1>,
    decoder: Decoder,
    /// Where the next byte is read from.
    read_at: usize,
    /// Bytes that were ever put into `TO_SEND`, that have left it, and that are leaving.
    put: usize,
    sent: usize,
    sending: usize,
    /// Frames that were damaged.
    pub frames_rejected: u32,
    /// Messages for which there was no room.
    pub messages_dropped: u32,
}

impl Link {
    /// Begins to listen.
    pub fn new(
        usart: USART2,
        pins: LinkPins,
        (mut rx, mut tx): (Stream5<DMA1>, Stream6<DMA1>),
        rcc: &mut Rcc,
    ) -> Link {
        let config = Config::default()
            .baudrate(board::LINK_BAUD.bps())
            .dma(DmaConfig::TxRx);
        let Ok(serial) = Serial::<_, u8>::new(usart, pins, config, rcc) else {
            unreachable!("a rate that this clock can divide to");
        };
        let (usart_tx, usart_rx) = serial.split();

        rx.set_channel(DmaChannel::Channel4);
        rx.set_direction(DmaDirection::PeripheralToMemory);
        rx.set_peripheral_address(usart_rx.address());
        rx.set_memory_address(RECEIVED.as_ptr() as u32);
        rx.set_number_of_transfers(BUFFER_LEN as u16);
        rx.set_memory_increment(true);
        rx.set_circular_mode(true);
        // SAFETY: address and length are those of RECEIVED, which lives for ever.
        #[allow(unsafe_code)]
        unsafe {
            rx.enable();
        }
        tx.set_channel(DmaChannel::Channel4);
        tx.set_direction(DmaDirection::MemoryToPeripheral);
        tx.set_peripheral_address(usart_tx.address());
        tx.set_memory_increment(true);
        Link {
            rx,
            tx,
            decoder: Decoder::new(),
            read_at: 0,
            put: 0,
            sent: 0,
            sending: 0,
            frames_rejected: 0,
            messages_dropped: 0,
        }
    }

    /// The next message that has come, if any.
    pub fn receive(&mut self) -> Option<ToDevice> {
        let write_at = BUFFER_LEN - usize::from(self.rx.number_of_transfers());
        while self.read_at != write_at % BUFFER_LEN {
            let byte = RECEIVED[self.read_at].load(Relaxed);
            self.read_at = (self.read_at + 1) % BUFFER_LEN;
            match self.decoder.push(byte) {
                Some(Ok(message)) => return Some(message),
                Some(Err(link::Rejected)) => {
                    self.frames_rejected = self.frames_rejected.saturating_add(1);
                }
                None => {}
            }
        }
        None
    }

    /// Puts telemetry where [`Link::pump`] takes it; drops it where there is no room.
    pub fn send(&mut self, telemetry: Telemetry) {
        self.enqueue(&FromDevice::Telemetry(telemetry), 0);
    }

    /// The same for an answer, which leaves room for telemetry: who asks too often cannot crowd
    /// it out.
    pub fn answer(&mut self, message: &FromDevice) {
        self.enqueue(message, 2 * FRAME_LEN_MAX);
    }

    fn enqueue(&mut self, message: &FromDevice, room_left_min: usize) {
        let mut buffer = [0; FRAME_LEN_MAX];
        let frame = link::encode(message, &mut buffer).unwrap_or_default();
        let room = BUFFER_LEN - self.put.wrapping_sub(self.sent);
        if frame.is_empty() || frame.len() + room_left_min > room {
            self.messages_dropped = self.messages_dropped.saturating_add(1);
            return;
        }
        for byte in frame {
            TO_SEND[self.put % BUFFER_LEN].store(*byte, Relaxed);
            self.put = self.put.wrapping_add(1);
        }
    }

    /// Hands over to the DMA what waits to be sent.
    pub fn pump(&mut self) {
        if self.tx.is_enabled() {
            return;
        }
        self.sent = self.sent.wrapping_add(self.sending);
        let from = self.sent % BUFFER_LEN;
        self.sending = self.put.wrapping_sub(self.sent).min(BUFFER_LEN - from);
        if self.sending == 0 {
            return;
        }
        self.tx
            .clear_flags(DmaFlag::TransferComplete | DmaFlag::HalfTransfer);
        self.tx
            .clear_flags(DmaFlag::FifoError | DmaFlag::TransferError);
        self.tx.set_memory_address(TO_SEND[from..].as_ptr() as u32);
        self.tx.set_number_of_transfers(self.sending as u16);
        // SAFETY: address and length are within TO_SEND, which lives for ever.
        #[allow(unsafe_code)]
        unsafe {
            self.tx.enable();
        }
    }

    /// Sends all that waits, and waits for it.
    pub fn flush(&mut self) {
        while self.tx.is_enabled() || self.put != self.sent {
            self.pump();
        }
        // The last two bytes are still in the USART.
        cortex_m::asm::delay(board::SYSCLK_HZ / board::LINK_BAUD * 10 * 3);
    }
}

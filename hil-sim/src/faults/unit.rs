//! The unit under test: the device of the firmware, on this PC or on a board.

use super::kind::{Memory, SettingsFault};
use super::memory::{flip, flip_copy, flip_hil};
use model_core::controller::Control;
use model_core::device::{Command, Device, Pins};
use model_core::io::{Output, Request};
use model_core::link::{Decoder, FRAME_LEN_MAX, ToDevice, encode};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{DacCount, EncoderCount};
use model_core::store::{self, SLOT_LEN};
use model_core::timing::Timing;
use rand::{Rng, RngExt};

/// Output of the device in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceOutput {
    /// Count of the DAC that drives the valve.
    pub valve: DacCount,
    /// The controller's output.
    pub output: Output,
    /// Level for the valve in the muscle's port.
    pub port_pulse: bool,
}

/// The unit under test.
pub trait Unit {
    /// Runs one tick that is late by `late_s`, with the pins, the number of ticks missed before it
    /// and the bytes received over the link.
    fn tick(&mut self, pins: &Pins, missed_ticks: u8, late_s: f64, bytes: &[u8]) -> DeviceOutput;

    /// Misses one tick.
    fn skip(&mut self);

    /// Resets the chip, so that its program restarts.
    fn restart(&mut self);

    /// Flips a bit in one copy of the memory.
    fn damage(&mut self, memory: Memory, copy: usize, bit: usize);
}

/// The firmware's device on this PC, with any controller.
pub struct OnPc<C> {
    /// The device at power-on.
    at_power_on: Device<C>,
    device: Device<C>,
    decoder: Decoder,
    /// Count of the encoder at the start of the device, whose counter starts at zero.
    counts_from: Option<EncoderCount>,
}

/// Length of the firmware's queue of commands for a tick.
const QUEUE_LEN: usize = 15;

impl<C: Control + Clone> OnPc<C> {
    /// A device at power-on.
    pub fn new(controller: C) -> OnPc<C> {
        let at_power_on = Device::with_controller(controller);
        OnPc {
            device: at_power_on.clone(),
            at_power_on,
            decoder: Decoder::new(),
            counts_from: None,
        }
    }
}

impl<C: Control + Clone> Unit for OnPc<C> {
    fn skip(&mut self) {}

    fn tick(&mut self, pins: &Pins, missed_ticks: u8, _: f64, bytes: &[u8]) -> DeviceOutput {
        let timing = Timing {
            missed_ticks,
            ..Timing::default()
        };
        let (mut vent, mut queue) = (None, Vec::new());
        for byte in bytes {
            match self.decoder.push::<ToDevice>(*byte) {
                Some(Ok(ToDevice::Command(command @ Command::Request(Request::Vent)))) => {
                    vent = Some(command);
                }
                Some(Ok(ToDevice::Command(command))) if queue.len() < QUEUE_LEN => {
                    queue.push(command);
                }
                _ => {}
            }
        }
        let counts_from = *self.counts_from.get_or_insert(pins.encoder);
        let pins = Pins {
            encoder: EncoderCount(pins.encoder.since(counts_from) as u32),
            ..*pins
        };
        let tick = self
            .device
            .tick(&pins, timing, vent.into_iter().chain(queue));
        DeviceOutput {
            valve: tick.valve,
            output: tick.telemetry.output,
            port_pulse: tick.port_pulse,
        }
    }

    fn restart(&mut self) {
        self.device = self.at_power_on.clone();
        self.decoder = Decoder::new();
        self.counts_from = None;
    }

    fn damage(&mut self, memory: Memory, copy: usize, bit: usize) {
        let controller = self.device.controller_mut().memory_mut();
        match memory {
            Memory::State => flip_copy(&mut controller.state, copy, |state| flip(state, bit)),
            Memory::Settings => flip_copy(&mut controller.settings, copy, |one| flip(one, bit)),
            Memory::Hil => flip_copy(self.device.hil_mut(), copy, flip_hil),
        }
    }
}

/// The frame that carries `message` over the link.
pub fn frame(message: &ToDevice) -> Vec<u8> {
    let mut buffer = [0; FRAME_LEN_MAX];
    // Every message of the link fits into a frame.
    encode(message, &mut buffer).unwrap_or_default().to_vec()
}

/// The two flash sectors of a board's settings, intact or after a fault.
pub struct Stored {
    /// The first slots of each sector; the rest is blank.
    pub sectors: [Vec<u8>; 2],
    /// The settings that may be loaded: the previous, the newly written, and the reference ones.
    allowed: [Settings; 3],
}

impl Stored {
    /// Sectors with these settings.
    pub fn new(values: &SettingsValues) -> Stored {
        let settings = valid(*values);
        let mut sectors = [(); 2].map(|()| vec![0xFF_u8; 4 * SLOT_LEN]);
        write(&mut sectors, &settings, 1.0);
        Stored {
            sectors,
            allowed: [settings; 3],
        }
    }

    /// Sectors with these settings, but other gains, after `fault` of the given size.
    pub fn after(
        values: &SettingsValues,
        fault: SettingsFault,
        size: f64,
        random: &mut impl Rng,
    ) -> Stored {
        let with_gain = |gain: f32| SettingsValues { gain, ..*values };
        let old = valid(with_gain(18.0));
        let new = valid(with_gain(19.0));
        let reference = valid(SettingsValues::reference());
        let Stored { mut sectors, .. } = Stored::new(old.values());
        match fault {
            SettingsFault::Erased => sectors[0].fill(0xFF),
            SettingsFault::HalfWritten => write(&mut sectors, &new, size),
            SettingsFault::Flipped => {
                write(&mut sectors, &new, 1.0);
                for _ in 0..size as usize {
                    let bit = random.random_range(0..8 * 2 * SLOT_LEN);
                    sectors[0][bit / 8] ^= 1 << (bit % 8);
                }
            }
            SettingsFault::OtherVersion => {
                // The version comes first in the encoded settings, which the checksum covers.
                sectors[0][8] = sectors[0][8].wrapping_add(1);
            }
            SettingsFault::CutWhileErasing => {
                for cell in sectors.iter_mut().flatten() {
                    if random.random_bool(size) {
                        *cell = 0xFF;
                    }
                }
            }
        }
        Stored {
            sectors,
            allowed: [old, new, reference],
        }
    }

    /// The settings that a board loads, and whether it may load them.
    pub fn load(&self) -> (Settings, bool) {
        let [old, new, reference] = self.allowed;
        let found = store::load([&self.sectors[0], &self.sectors[1]]);
        let found = found.ok().flatten().unwrap_or(reference);
        (found, [old, new, reference].contains(&found))
    }
}

/// The settings of a case, which are always within their limits.
fn valid(values: SettingsValues) -> Settings {
    match Settings::new(values) {
        Ok(settings) => settings,
        Err(error) => unreachable!("{error}"),
    }
}

/// Writes settings, but only the given share of their bytes.
fn write(sectors: &mut [Vec<u8>; 2], settings: &Settings, share: f64) {
    if let Ok(write) = store::store([&sectors[0], &sectors[1]], settings) {
        let bytes = write.bytes();
        let len = (share * bytes.len() as f64) as usize;
        sectors[write.sector][write.offset..][..len].copy_from_slice(&bytes[..len]);
    }
}

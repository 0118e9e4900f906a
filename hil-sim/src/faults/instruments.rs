//! Signals at the pins and bytes on the link, correct or changed by a fault.

use super::Case;
use super::kind::{Inject, Instrument, LinkFault};
use super::unit::frame;
use model_core::device::{Command, Pins};
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::settings::SettingsValues;
use model_core::signal::{AdcCount, COUNT_MAX, EncoderCount};
use rand::{Rng, RngExt};
use std::ops::RangeInclusive;

/// Output range of an amplifier that saturates 5 mV from its rails \[counts\]; one count of the
/// converter's noise is added.
const OUTPUT_RANGE: RangeInclusive<f64> = 6.0..=4089.0;

/// The instruments and their electronics, between the plant and the pins.
pub(super) struct Instruments<'a> {
    values: &'a SettingsValues,
    inject: Inject,
    size: f64,
    /// Counts of the analog inputs and of the encoder when the fault occurred.
    frozen: Option<([u16; 2], i64)>,
    /// Counts that the encoder has lost.
    lost: f64,
    /// The encoder's last true count.
    last: i64,
}

impl<'a> Instruments<'a> {
    pub(super) fn new(case: &Case, values: &'a SettingsValues) -> Instruments<'a> {
        Instruments {
            values,
            inject: case.kind.inject,
            size: case.size,
            frozen: None,
            lost: 0.0,
            last: 0,
        }
    }

    /// The pins for the true finger force \[N\], pressure \[Pa\] and travel \[m\], at `since_s`
    /// after the fault if it has occurred.
    pub(super) fn pins(
        &mut self,
        truth: [f64; 3],
        since_s: Option<f64>,
        mut normal: impl FnMut() -> f64,
    ) -> Pins {
        let size = self.size;
        let mut truth = truth;
        let index = |instrument| match instrument {
            Instrument::Bridge => 0,
            Instrument::Pressure => 1,
            Instrument::Encoder => 2,
        };
        if let Some(since_s) = since_s {
            match self.inject {
                Inject::Drift(instrument) => truth[index(instrument)] += size * since_s,
                Inject::Noise(instrument) => truth[index(instrument)] += size * normal(),
                Inject::AnalogGain(instrument) => truth[index(instrument)] *= size,
                Inject::Reversed(instrument) => truth[index(instrument)] *= -1.0,
                Inject::Jump(instrument) => truth[index(instrument)] += size,
                _ => {}
            }
        }
        let [bridge_n, pressure_pa, travel_m] = truth;
        let values = self.values;
        let mut adc = [
            values.bridge.count(bridge_n as f32).0,
            values.pressure_sensor.count(pressure_pa as f32).0,
        ];
        let mut encoder = (travel_m / f64::from(values.encoder_m_per_count)).round() as i64;
        let moved = encoder - std::mem::replace(&mut self.last, encoder);
        if since_s.is_some() {
            let flicker = |normal: f64| (size * normal).round() as i64;
            let (frozen, frozen_encoder) = *self.frozen.get_or_insert((adc, encoder));
            match self.inject {
                Inject::Reading(instrument, noise) => {
                    let count = size + noise * normal();
                    adc[index(instrument)] = count.round().clamp(0.0, COUNT_MAX.into()) as u16;
                }
                Inject::Drift(instrument) => {
                    let count = f64::from(adc[index(instrument)]);
                    if !OUTPUT_RANGE.contains(&count) {
                        let count =
                            count.clamp(*OUTPUT_RANGE.start(), *OUTPUT_RANGE.end()) + normal();
                        adc[index(instrument)] = count.round() as u16;
                    }
                }
                Inject::Freeze(Instrument::Encoder) => encoder = frozen_encoder + flicker(normal()),
                Inject::Freeze(instrument) => {
                    let count = i64::from(frozen[index(instrument)]) + flicker(normal());
                    adc[index(instrument)] = count.clamp(0, COUNT_MAX.into()) as u16;
                }
                Inject::EncoderLoses => self.lost += size * moved as f64,
                _ => {}
            }
        }
        Pins {
            bridge: AdcCount(adc[0]),
            pressure: AdcCount(adc[1]),
            encoder: EncoderCount((encoder - self.lost.round() as i64) as i32 as u32),
            read_back: AdcCount::default(),
            button_pressed: false,
            stop_open: [false; 2],
            enabling_closed: false,
        }
    }
}

/// Bytes that arrive in one tick over a faulty link; `first` in the tick in which the fault occurs.
pub(super) fn noise_on_link(
    fault: LinkFault,
    size: f64,
    first: bool,
    random: &mut impl Rng,
) -> Vec<u8> {
    let mut bytes = Vec::new();
    let valid = [
        ToDevice::Identify,
        ToDevice::ReadSettings,
        ToDevice::Command(Command::EnterHil),
        ToDevice::Command(Command::LeaveHil),
    ];
    match fault {
        LinkFault::Cut => {
            if first {
                let whole = frame(&valid[2]);
                bytes.extend(&whole[..whole.len() / 2]);
            }
        }
        LinkFault::Flooded => {
            for _ in 0..size as usize {
                bytes.extend(frame(&valid[random.random_range(0..valid.len())]));
            }
        }
        LinkFault::Corrupted => {
            for _ in 0..size as usize {
                let requests = [
                    Request::Assist,
                    Request::Reset,
                    Request::Hold,
                    Request::Vent,
                ];
                let request = requests[random.random_range(0..requests.len())];
                let mut damaged = frame(&ToDevice::Command(Command::Request(request)));
                let position = random.random_range(0..damaged.len());
                damaged[position] ^= random.random_range(1..=u8::MAX);
                bytes.extend(damaged);
                bytes.extend((0..random.random_range(0..8)).map(|_| random.random::<u8>()));
            }
            bytes.push(0);
        }
    }
    bytes
}

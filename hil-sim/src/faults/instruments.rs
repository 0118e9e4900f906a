//! What the pins and the link get: the truth, or what a fault makes of it.

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

/// An amplifier ends 5 mV short of its rails \[counts\], with a count of the converter's noise.
const SWING: RangeInclusive<f64> = 6.0..=4089.0;

/// The electrical side: what the pins get of the plant.
pub(super) struct Instruments<'a> {
    values: &'a SettingsValues,
    inject: Inject,
    size: f64,
    /// Readings in physical units and counts when the fault fell.
    frozen: Option<([u16; 2], i64)>,
    /// Counts that the encoder has lost, and its last true count.
    lost: f64,
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

    /// The pins, `since_s` after the fault where it has fallen.
    pub(super) fn pins(
        &mut self,
        truth: [f64; 3],
        since_s: Option<f64>,
        mut normal: impl FnMut() -> f64,
    ) -> Pins {
        let size = self.size;
        let mut truth = truth;
        let place = |instrument| match instrument {
            Instrument::Bridge => 0,
            Instrument::Pressure => 1,
            Instrument::Encoder => 2,
        };
        if let Some(since_s) = since_s {
            match self.inject {
                Inject::Drift(instrument) => truth[place(instrument)] += size * since_s,
                Inject::Noise(instrument) => truth[place(instrument)] += size * normal(),
                Inject::AnalogGain(instrument) => truth[place(instrument)] *= size,
                Inject::Reversed(instrument) => truth[place(instrument)] *= -1.0,
                Inject::Jump(instrument) => truth[place(instrument)] += size,
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
            let (frozen, home) = *self.frozen.get_or_insert((adc, encoder));
            match self.inject {
                Inject::Reading(instrument, noise) => {
                    let count = size + noise * normal();
                    adc[place(instrument)] = count.round().clamp(0.0, COUNT_MAX.into()) as u16;
                }
                Inject::Drift(instrument) => {
                    let count = f64::from(adc[place(instrument)]);
                    if !SWING.contains(&count) {
                        let count = count.clamp(*SWING.start(), *SWING.end()) + normal();
                        adc[place(instrument)] = count.round() as u16;
                    }
                }
                Inject::Freeze(Instrument::Encoder) => encoder = home + flicker(normal()),
                Inject::Freeze(instrument) => {
                    let count = i64::from(frozen[place(instrument)]) + flicker(normal());
                    adc[place(instrument)] = count.clamp(0, COUNT_MAX.into()) as u16;
                }
                Inject::EncoderLoses => self.lost += size * moved as f64,
                _ => {}
            }
        }
        Pins {
            bridge: AdcCount(adc[0]),
            pressure: AdcCount(adc[1]),
            encoder: EncoderCount((encoder - self.lost.round() as i64) as i32 as u32),
            button_pressed: false,
        }
    }
}

/// Bytes on the link in a tick of a broken one.
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
                let asked = [
                    Request::Assist,
                    Request::Reset,
                    Request::Hold,
                    Request::Vent,
                ];
                let asked = asked[random.random_range(0..asked.len())];
                let mut damaged = frame(&ToDevice::Command(Command::Request(asked)));
                let place = random.random_range(0..damaged.len());
                damaged[place] ^= random.random_range(1..=u8::MAX);
                bytes.extend(damaged);
                bytes.extend((0..random.random_range(0..8)).map(|_| random.random::<u8>()));
            }
            bytes.push(0);
        }
    }
    bytes
}

//! Random smooth shapes, from which the laws of effects are drawn.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::ser::{Serialize, SerializeSeq, Serializer};

use super::bench::Bench;
use crate::hidden::Moment;

/// Largest ratio of a modulation's extremes over the range of its coordinates.
pub(crate) const MODULATION: f64 = 3.0;
/// Intervals of a tabulated shape.
const INTERVALS: usize = 128;
/// Speed of contraction at which a speed coordinate is half way \[1/s\].
const SPEED_PER_S: f64 = 0.15;
/// The same of the coordinate that tells directions apart \[1/s\].
const TURN_PER_S: f64 = 0.03;

/// A uniform draw.
pub(crate) fn between(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

/// A draw with a uniform logarithm.
pub(crate) fn log_between(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    log_scale(rng.random_range(0.0..1.0), low, high)
}

/// From `low` at 0 to `high` at 1 by equal ratios.
pub(crate) fn log_scale(size: f64, low: f64, high: f64) -> f64 {
    low * (high / low).powf(size)
}

/// A standard normal draw.
pub(crate) fn normal(rng: &mut Pcg64) -> f64 {
    StandardNormal.sample(rng)
}

/// Plus or minus one.
pub(crate) fn sign(rng: &mut Pcg64) -> f64 {
    if rng.random_bool(0.5) { 1.0 } else { -1.0 }
}

/// Shares that sum to one.
pub(crate) fn shares(rng: &mut Pcg64, count: usize) -> Vec<f64> {
    let raw: Vec<f64> = (0..count)
        .map(|_| -rng.random_range(1e-3_f64..1.0).ln())
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|share| share / sum).collect()
}

/// One sine of a sum: amplitude, angular frequency, phase.
type Sine = (f64, f64, f64);

fn sum_of(sines: &[Sine], at: f64) -> f64 {
    let terms = sines.iter().map(|(a, w, phase)| a * (w * at + phase).sin());
    terms.sum()
}

/// A few low frequencies with falling amplitudes.
fn fourier(rng: &mut Pcg64) -> Vec<f64> {
    let terms = rng.random_range(1..=4);
    let sines: Vec<Sine> = (1..=terms)
        .map(|k| {
            let amplitude = normal(rng) / f64::from(k);
            let angular = TAU * f64::from(k) * between(rng, 0.4, 1.0);
            (amplitude, angular, between(rng, 0.0, TAU))
        })
        .collect();
    grid().map(|u| sum_of(&sines, u)).collect()
}

/// A Gaussian process with a squared-exponential kernel, by random Fourier features.
fn gaussian_process(rng: &mut Pcg64) -> Vec<f64> {
    let length = log_between(rng, 0.15, 1.0);
    let sines: Vec<Sine> = (0..40)
        .map(|_| (1.0, normal(rng) / length, between(rng, 0.0, TAU)))
        .collect();
    grid().map(|u| sum_of(&sines, u)).collect()
}

/// A uniform cubic B-spline.
fn spline(rng: &mut Pcg64) -> Vec<f64> {
    let spans = rng.random_range(2..=6);
    let weights: Vec<f64> = (0..spans + 3).map(|_| normal(rng)).collect();
    let at = |u: f64| {
        let place = u * spans as f64;
        let first = (place as usize).min(spans - 1);
        let t = place - first as f64;
        let basis = [
            (1.0 - t).powi(3),
            3.0 * t.powi(3) - 6.0 * t * t + 4.0,
            -3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0,
            t.powi(3),
        ];
        let terms = basis.iter().zip(&weights[first..]).map(|(b, w)| b * w);
        terms.sum::<f64>() / 6.0
    };
    grid().map(at).collect()
}

/// A straight or bent slope.
fn slope(rng: &mut Pcg64) -> Vec<f64> {
    let power = log_between(rng, 0.4, 2.5);
    let direction = sign(rng);
    grid().map(|u| direction * u.powf(power)).collect()
}

fn grid() -> impl Iterator<Item = f64> {
    (0..=INTERVALS).map(|i| i as f64 / INTERVALS as f64)
}

/// A random smooth function on the grid, scaled to run from 0 to 1.
fn smooth(rng: &mut Pcg64) -> Vec<f64> {
    let values = match rng.random_range(0..20) {
        0..=5 => fourier(rng),
        6..=12 => gaussian_process(rng),
        13..=17 => spline(rng),
        _ => slope(rng),
    };
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let span = (high - low).max(1e-9);
    values.iter().map(|value| (value - low) / span).collect()
}

/// A positive function of a coordinate from 0 to 1, constant beyond, with a geometric mean of 1.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    values: Vec<f64>,
    /// Integral from 0 to each point of the grid.
    integral: Vec<f64>,
}

impl Curve {
    fn of_logarithms(logarithms: Vec<f64>) -> Self {
        let mean = logarithms.iter().sum::<f64>() / logarithms.len() as f64;
        let values: Vec<f64> = logarithms.iter().map(|l| (l - mean).exp()).collect();
        let mut integral = vec![0.0];
        for two in values.windows(2) {
            let last = integral[integral.len() - 1];
            integral.push(last + 0.5 * (two[0] + two[1]) / INTERVALS as f64);
        }
        Self { values, integral }
    }

    /// One everywhere.
    pub(crate) fn flat() -> Self {
        Self::of_logarithms(vec![0.0; INTERVALS + 1])
    }

    /// A random function whose extremes have the ratio `ratio`.
    pub(crate) fn with_ratio(rng: &mut Pcg64, ratio: f64) -> Self {
        Self::of_logarithms(smooth(rng).iter().map(|g| g * ratio.ln()).collect())
    }

    /// A random function whose extremes have a ratio of up to `most`.
    pub(crate) fn draw(rng: &mut Pcg64, most: f64) -> Self {
        let ratio = log_between(rng, 1.0, most);
        Self::with_ratio(rng, ratio)
    }

    /// A random function that rises by the ratio `ratio`.
    pub(crate) fn rising(rng: &mut Pcg64, ratio: f64) -> Self {
        let ramp = Ramp::draw(rng, 4.0);
        Self::of_logarithms(ramp.values.iter().map(|r| r * ratio.ln()).collect())
    }

    /// Its value at `u`.
    pub(crate) fn at(&self, u: f64) -> f64 {
        interpolated(&self.values, u)
    }

    /// Its integral from 0 to `u`.
    pub(crate) fn integral(&self, u: f64) -> f64 {
        if u <= 0.0 {
            return u * self.values[0];
        }
        if u >= 1.0 {
            return self.integral[INTERVALS] + (u - 1.0) * self.values[INTERVALS];
        }
        let place = u * INTERVALS as f64;
        let first = (place as usize).min(INTERVALS - 1);
        let t = place - first as f64;
        let slope = self.values[first + 1] - self.values[first];
        self.integral[first] + t * (self.values[first] + 0.5 * t * slope) / INTERVALS as f64
    }

    /// Largest over smallest value.
    pub(crate) fn ratio(&self) -> f64 {
        let low = self.values.iter().copied().fold(f64::INFINITY, f64::min);
        self.values.iter().copied().fold(0.0, f64::max) / low
    }
}

fn interpolated(values: &[f64], u: f64) -> f64 {
    let place = u.clamp(0.0, 1.0) * INTERVALS as f64;
    let first = (place as usize).min(INTERVALS - 1);
    values[first] + (place - first as f64) * (values[first + 1] - values[first])
}

/// Nine values at equal distances tell an answer's reader what a shape looks like.
fn told<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    let mut sequence = serializer.serialize_seq(Some(9))?;
    for i in 0..9 {
        sequence.serialize_element(&values[i * INTERVALS / 8])?;
    }
    sequence.end()
}

impl Serialize for Curve {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        told(&self.values, serializer)
    }
}

/// A function that rises from 0 at 0 to 1 at 1 and goes on with its last slope.
#[derive(Clone, Debug)]
pub(crate) struct Ramp {
    values: Vec<f64>,
}

impl Ramp {
    /// A random one, whose steepest slope is up to `most` times the least.
    pub(crate) fn draw(rng: &mut Pcg64, most: f64) -> Self {
        let density = Curve::draw(rng, most);
        let whole = density.integral[INTERVALS];
        let values = density.integral.iter().map(|part| part / whole).collect();
        Self { values }
    }

    /// Its value at `u`; of the other sign below zero.
    pub(crate) fn at(&self, u: f64) -> f64 {
        if u < 0.0 {
            return -self.at(-u);
        }
        let slope = (self.values[INTERVALS] - self.values[INTERVALS - 1]) * INTERVALS as f64;
        interpolated(&self.values, u) + (u - 1.0).max(0.0) * slope
    }

    /// The same up to 1, which it does not exceed.
    pub(crate) fn saturated(&self, u: f64) -> f64 {
        self.at(u.clamp(-1.0, 1.0))
    }
}

impl Serialize for Ramp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        told(&self.values, serializer)
    }
}

/// A random periodic function with amplitude 1 and mean 0, of a phase in turns.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Waveform {
    /// Amplitude, harmonic times 2π, and phase of each harmonic.
    harmonics: Vec<Sine>,
}

impl Waveform {
    pub(crate) fn draw(rng: &mut Pcg64) -> Self {
        let count = rng.random_range(1..=4);
        let raw: Vec<f64> = (1..=count)
            .map(|k| normal(rng).abs().max(0.1) / f64::from(k))
            .collect();
        let sum: f64 = raw.iter().sum();
        let harmonics = raw.iter().enumerate().map(|(i, amplitude)| {
            let angular = TAU * (i + 1) as f64;
            (amplitude / sum, angular, between(rng, 0.0, TAU))
        });
        Self {
            harmonics: harmonics.collect(),
        }
    }

    pub(crate) fn at(&self, turns: f64) -> f64 {
        sum_of(&self.harmonics, turns)
    }
}

/// What a law may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Coordinate {
    /// Gauge pressure in the muscle.
    Pressure,
    Contraction,
    /// How fast the muscle moves, either way.
    Speed,
    /// How fast and which way it moves.
    Velocity,
    /// How much flows through the valve, either way.
    Flow,
}

/// A factor that varies smoothly with one or more coordinates, by up to [`MODULATION`] in all.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Modulation {
    curves: Vec<(Coordinate, Curve)>,
    #[serde(skip)]
    scale: Scale,
}

/// Values of pressure, contraction and flow at which their coordinates are 1, 1 and one half.
#[derive(Clone, Copy, Debug, Default)]
struct Scale {
    pressure_pa: f64,
    contraction: f64,
    flow_kg_per_s: f64,
}

impl Scale {
    fn of(bench: &Bench) -> Self {
        Self {
            pressure_pa: 1.1 * bench.high_pa,
            contraction: bench.contraction_most,
            flow_kg_per_s: bench.rig.flow_gain_kg_per_pa_s * 2.0e4,
        }
    }

    fn coordinate(&self, coordinate: Coordinate, now: &Moment) -> f64 {
        let part = |value: f64, half: f64| value / (value.abs() + half);
        match coordinate {
            Coordinate::Pressure => now.pressure_pa / self.pressure_pa,
            Coordinate::Contraction => now.contraction / self.contraction,
            Coordinate::Speed => part(now.rate_per_s.abs(), SPEED_PER_S),
            Coordinate::Velocity => 0.5 + 0.5 * part(now.rate_per_s, TURN_PER_S),
            Coordinate::Flow => part(now.flow_kg_per_s.abs(), self.flow_kg_per_s),
        }
    }
}

impl Modulation {
    /// Of any of `coordinates`, none included.
    pub(crate) fn draw(rng: &mut Pcg64, coordinates: &[Coordinate], bench: &Bench) -> Self {
        let chosen: Vec<Coordinate> = coordinates
            .iter()
            .copied()
            .filter(|_| rng.random_bool(0.7))
            .collect();
        let whole = log_between(rng, 1.0, MODULATION).ln();
        let parts = shares(rng, chosen.len());
        let curve = |(coordinate, share): (Coordinate, f64)| {
            (coordinate, Curve::with_ratio(rng, (share * whole).exp()))
        };
        Self {
            curves: chosen.into_iter().zip(parts).map(curve).collect(),
            scale: Scale::of(bench),
        }
    }

    /// Of one coordinate, with which it rises.
    pub(crate) fn rising(rng: &mut Pcg64, coordinate: Coordinate, bench: &Bench) -> Self {
        let ratio = log_between(rng, 1.3, MODULATION);
        Self {
            curves: vec![(coordinate, Curve::rising(rng, ratio))],
            scale: Scale::of(bench),
        }
    }

    pub(crate) fn at(&self, now: &Moment) -> f64 {
        let factor = |(coordinate, curve): &(Coordinate, Curve)| {
            curve.at(self.scale.coordinate(*coordinate, now))
        };
        self.curves.iter().map(factor).product()
    }

    /// Product of the ratios of its curves.
    #[cfg(test)]
    pub(crate) fn ratio(&self) -> f64 {
        self.curves.iter().map(|(_, curve)| curve.ratio()).product()
    }

    /// In words, ` modulated by …` or nothing.
    pub(crate) fn words(&self) -> String {
        let names: Vec<String> = self
            .curves
            .iter()
            .map(|(coordinate, curve)| {
                let name = format!("{coordinate:?}").to_lowercase();
                format!("{name} (by a factor of {:.2})", curve.ratio())
            })
            .collect();
        if names.is_empty() {
            String::new()
        } else {
            format!(", modulated by {}", names.join(" and "))
        }
    }
}

//! Effects that are in no catalogue of a diagnosis.

use std::f64::consts::TAU;

use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Ramp, Waveform, between, log_between, log_scale, sign};
use super::Law;
use crate::hidden::{Hidden, Load, Moment, Reading};
use crate::machine::GRAVITY_M_PER_S2;

/// Times of events: one start, drawn from each interval.
#[derive(Serialize)]
struct Moments {
    interval_s: f64,
    width_s: f64,
    phases: Vec<f64>,
}

impl Moments {
    fn draw(rng: &mut Pcg64, interval_s: f64, width_s: f64) -> Self {
        Self {
            interval_s,
            width_s,
            phases: (0..16).map(|_| between(rng, 0.0, 0.6)).collect(),
        }
    }

    /// Where in a happening `time_s` is, from 0 to 1.
    fn part(&self, time_s: f64) -> Option<f64> {
        let number = (time_s / self.interval_s).floor();
        let phase = self.phases[(number as i64).rem_euclid(16) as usize];
        let since_s = time_s - (number + phase) * self.interval_s;
        (since_s >= 0.0 && since_s < self.width_s).then(|| since_s / self.width_s)
    }

    /// Up and down again without a corner.
    fn bump(&self, time_s: f64) -> f64 {
        let part = self.part(time_s);
        part.map_or(0.0, |part| 0.5 - 0.5 * (TAU * part).cos())
    }
}

/// A force on the load.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum LoadForce {
    /// Repeats along the way, as of a rack or a chain.
    AlongTheWay { waveform: Waveform, pitch: f64 },
    /// Repeats in time.
    InTime {
        waveform: Waveform,
        frequency_hz: f64,
    },
    /// Sines of random frequencies: gusts.
    Gusts { sines: Vec<(f64, f64)> },
    /// Comes now and then.
    NowAndThen(Moments),
}

#[derive(Serialize)]
struct Pushed {
    force_n: f64,
    by: LoadForce,
}

impl Hidden for Pushed {
    fn commits(&self) -> bool {
        false
    }
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        let share = match &self.by {
            LoadForce::AlongTheWay { waveform, pitch } => waveform.at(now.contraction / pitch),
            LoadForce::InTime {
                waveform,
                frequency_hz,
            } => waveform.at(now.time_s * frequency_hz),
            LoadForce::Gusts { sines } => {
                let terms = sines
                    .iter()
                    .map(|(hz, phase)| (TAU * hz * now.time_s + phase).sin());
                terms.sum::<f64>() * (2.0 / sines.len() as f64).sqrt()
            }
            LoadForce::NowAndThen(moments) => moments.bump(now.time_s),
        };
        load.pull_n += self.force_n * share;
    }
}

fn pushed(force_n: f64, by: LoadForce, form: &str) -> Law {
    Law::new(
        Pushed { force_n, by },
        form,
        format!("{force_n:.1} N on the load"),
    )
}

pub(super) fn cogging(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = log_scale(size, 0.02, 0.25) * bench.weight_n();
    let by = LoadForce::AlongTheWay {
        waveform: Waveform::draw(rng),
        pitch: log_between(rng, 0.006, 0.03),
    };
    pushed(force_n, by, "periodic")
}

pub(super) fn force_pulses(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = sign(rng) * log_scale(size, 0.05, 0.45) * bench.weight_n();
    let (interval_s, width_s) = (between(rng, 1.7, 4.5), between(rng, 0.08, 0.4));
    let by = LoadForce::NowAndThen(Moments::draw(rng, interval_s, width_s));
    pushed(force_n, by, "now-and-then")
}

pub(super) fn floor_vibration(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = log_scale(size, 0.03, 0.2) * bench.weight_n();
    let by = LoadForce::InTime {
        waveform: Waveform::draw(rng),
        frequency_hz: log_between(rng, 0.8, 7.0),
    };
    pushed(force_n, by, "periodic")
}

pub(super) fn random_gusts(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = log_scale(size, 0.03, 0.2) * bench.weight_n();
    let sine = |_| (log_between(rng, 0.05, 3.0), between(rng, 0.0, TAU));
    let sines = (0..24).map(sine).collect();
    pushed(force_n, LoadForce::Gusts { sines }, "random")
}

/// A part of the weight is a pendulum.
#[derive(Serialize)]
struct SwingingPayload {
    swinging_kg: f64,
    length_m: f64,
    start_rad: f64,
    damping_per_s: f64,
}

/// States: angle and its rate.
impl Hidden for SwingingPayload {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = self.start_rad;
        x[1] = 0.0;
    }
    fn load(&self, load: &mut Load, _: &Moment, x: &[f64], dx: &mut [f64]) {
        dx[0] = x[1];
        dx[1] = -GRAVITY_M_PER_S2 / self.length_m * x[0].sin() - self.damping_per_s * x[1];
        // the string passes on its pull's upright part only, and bears the turning; what the
        // muscle's motion does to the swing is left out
        load.mass_kg -= self.swinging_kg * x[0].sin().powi(2);
        load.pull_n += self.swinging_kg * self.length_m * x[1] * x[1] * x[0].cos();
    }
}

pub(super) fn swinging_payload(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let effect = SwingingPayload {
        swinging_kg: bench.rig.mass_kg * between(rng, 0.4, 0.8),
        length_m: between(rng, 0.25, 0.8),
        start_rad: log_scale(size, 0.2, 0.8),
        damping_per_s: between(rng, 0.005, 0.03),
    };
    let words = format!("{:.2} kg swing", effect.swinging_kg);
    Law::new(effect, "pendulum", words)
}

/// Something that happens around one contraction.
#[derive(Serialize)]
struct Place {
    /// Dry friction of the guide there.
    friction_n: f64,
    /// Force that a pinched bladder takes there.
    pinched_n: f64,
    centre: f64,
    width: f64,
    /// Flatness of its top.
    power: f64,
}

impl Place {
    fn share(&self, contraction: f64) -> f64 {
        let off = ((contraction - self.centre) / self.width).abs();
        (-off.powf(self.power)).exp()
    }
}

impl Hidden for Place {
    fn commits(&self) -> bool {
        false
    }
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        force_n - self.pinched_n * self.share(now.contraction)
    }
    fn load(&self, load: &mut Load, now: &Moment, _: &[f64], _: &mut [f64]) {
        let here_n = self.friction_n * self.share(now.contraction);
        load.coulomb_n += here_n;
        load.static_n += here_n;
    }
}

fn place(bench: &Bench, rng: &mut Pcg64) -> Place {
    Place {
        friction_n: 0.0,
        pinched_n: 0.0,
        centre: between(rng, 0.3, 0.6) * bench.contraction_most,
        width: between(rng, 0.01, 0.03),
        power: between(rng, 1.5, 4.0),
    }
}

pub(super) fn position_friction(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let friction_n = log_scale(size, 0.05, 0.4) * bench.weight_n();
    let effect = Place {
        friction_n,
        ..place(bench, rng)
    };
    Law::new(effect, "stretch", format!("{friction_n:.1} N on a stretch"))
}

pub(super) fn pinched_bladder(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let pinched_n = sign(rng) * log_scale(size, 0.01, 0.1) * bench.blocked_n;
    let effect = Place {
        pinched_n,
        ..place(bench, rng)
    };
    Law::new(effect, "stretch", format!("{pinched_n:.1} N on a stretch"))
}

/// Occasional disturbances of the reference.
#[derive(Serialize)]
struct PressurePulses {
    pulse_pa: f64,
    moments: Moments,
}

impl Hidden for PressurePulses {
    fn commits(&self) -> bool {
        false
    }
    fn reference_pa(&self, reference_pa: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        reference_pa + self.pulse_pa * self.moments.bump(now.time_s)
    }
}

pub(super) fn pressure_pulses(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let pulse_pa = sign(rng) * log_scale(size, 4.0e3, 50.0e3);
    let (interval_s, width_s) = (between(rng, 1.7, 4.5), between(rng, 0.08, 0.4));
    let moments = Moments::draw(rng, interval_s, width_s);
    let words = format!("{pulse_pa:.0} Pa every {interval_s:.1} s");
    Law::new(PressurePulses { pulse_pa, moments }, "now-and-then", words)
}

/// A valve with coarse steps and stiction.
#[derive(Serialize)]
struct StickingValve {
    step_pa: f64,
    held_pa: f64,
}

impl StickingValve {
    fn moved_pa(&self, command_pa: f64, at_pa: f64) -> f64 {
        if (command_pa - at_pa).abs() > self.held_pa {
            (command_pa / self.step_pa).round() * self.step_pa
        } else {
            at_pa
        }
    }
}

/// State: where the valve is held.
impl Hidden for StickingValve {
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.command_pa;
    }
    fn reference_pa(&self, _: f64, now: &Moment, x: &[f64], _: &mut [f64]) -> f64 {
        self.moved_pa(now.command_pa, x[0])
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        x[0] = self.moved_pa(now.command_pa, x[0]);
    }
}

pub(super) fn sticking_valve(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let step_pa = log_scale(size, 3.0e3, 25.0e3);
    let held_pa = step_pa * between(rng, 1.0, 2.0);
    let words = format!("moves by {step_pa:.0} Pa, when {held_pa:.0} Pa off");
    Law::new(StickingValve { step_pa, held_pa }, "quantised", words)
}

/// A flow of the valve that does not correspond to its opening.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Flow {
    /// Shut now and then.
    Dropout(Moments),
    /// Less and more, again and again.
    Ripple {
        share: f64,
        frequency_hz: f64,
        waveform: Waveform,
    },
    /// Less and less.
    Fade {
        share: f64,
        over_s: f64,
        shape: Ramp,
    },
}

impl Hidden for Flow {
    fn commits(&self) -> bool {
        false
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let factor = match self {
            Flow::Dropout(moments) => {
                if moments.part(now.time_s).is_some() {
                    0.0
                } else {
                    1.0
                }
            }
            Flow::Ripple {
                share,
                frequency_hz,
                waveform,
            } => 1.0 + share * waveform.at(now.time_s * frequency_hz),
            Flow::Fade {
                share,
                over_s,
                shape,
            } => 1.0 - share * shape.saturated(now.time_s.max(0.0) / over_s),
        };
        factor * flow
    }
}

pub(super) fn valve_dropout(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let (interval_s, width_s) = (between(rng, 1.7, 4.5), log_scale(size, 0.05, 0.6));
    let moments = Moments::draw(rng, interval_s, width_s);
    let words = format!("shut for {width_s:.2} s every {interval_s:.1} s");
    Law::new(Flow::Dropout(moments), "now-and-then", words)
}

pub(super) fn flow_ripple(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let share = log_scale(size, 0.2, 0.95);
    let effect = Flow::Ripple {
        share,
        frequency_hz: log_between(rng, 0.3, 5.0),
        waveform: Waveform::draw(rng),
    };
    Law::new(effect, "periodic", format!("by {:.0} %", 100.0 * share))
}

pub(super) fn valve_fade(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let share = log_scale(size, 0.2, 0.85);
    let effect = Flow::Fade {
        share,
        over_s: between(rng, 15.0, 40.0),
        shape: Ramp::draw(rng, 6.0),
    };
    Law::new(effect, "monotone", format!("by {:.0} %", 100.0 * share))
}

/// Variation of the ambient temperature, which also changes the rubber.
#[derive(Serialize)]
struct AmbientDrift {
    swing_k: f64,
    period_s: f64,
    waveform: Waveform,
    force_share_per_k: f64,
}

impl AmbientDrift {
    fn warmer_k(&self, time_s: f64) -> f64 {
        self.swing_k * self.waveform.at(time_s / self.period_s)
    }
}

impl Hidden for AmbientDrift {
    fn commits(&self) -> bool {
        false
    }
    fn ambient_k(&self, ambient_k: f64, time_s: f64) -> f64 {
        ambient_k + self.warmer_k(time_s)
    }
    fn force_n(&self, force_n: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        force_n * (1.0 - self.force_share_per_k * self.warmer_k(now.time_s))
    }
}

pub(super) fn ambient_drift(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let swing_k = log_scale(size, 3.0, 15.0);
    let effect = AmbientDrift {
        swing_k,
        period_s: between(rng, 8.0, 20.0),
        waveform: Waveform::draw(rng),
        force_share_per_k: between(rng, 0.003, 0.006),
    };
    Law::new(effect, "periodic", format!("by {swing_k:.1} K"))
}

/// A jammed encoder line: counts are lost along a stretch, one way.
#[derive(Serialize)]
struct LostCounts {
    lost_share: f64,
    from: f64,
    to: f64,
}

/// States: what the encoder has lost so far, and where it was last.
impl Hidden for LostCounts {
    fn states(&self) -> usize {
        2
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = 0.0;
        x[1] = now.contraction;
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        let jammed = now.contraction.min(self.to) - x[1].max(self.from);
        x[0] += self.lost_share * jammed.max(0.0);
        x[1] = now.contraction;
    }
    fn read(&self, reading: &mut Reading, _: &Moment, x: &[f64]) {
        reading.contraction -= x[0];
    }
}

pub(super) fn lost_counts(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let from = between(rng, 0.3, 0.5) * bench.contraction_most;
    let lost_share = log_scale(size, 0.01, 0.2);
    let effect = LostCounts {
        lost_share,
        from,
        to: from + between(rng, 0.01, 0.03),
    };
    let words = format!("{:.1} % on a stretch while drawing in", 100.0 * lost_share);
    Law::new(effect, "one-way", words)
}

/// An eccentric encoder wheel.
#[derive(Serialize)]
struct EncoderEccentricity {
    amplitude: f64,
    pitch: f64,
    waveform: Waveform,
}

impl Hidden for EncoderEccentricity {
    fn commits(&self) -> bool {
        false
    }
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        reading.contraction += self.amplitude * self.waveform.at(now.contraction / self.pitch);
    }
}

pub(super) fn encoder_eccentricity(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let amplitude = log_scale(size, 0.15e-3, 2.5e-3);
    let effect = EncoderEccentricity {
        amplitude,
        pitch: between(rng, 0.015, 0.045),
        waveform: Waveform::draw(rng),
    };
    Law::new(effect, "periodic", format!("by {amplitude:.5}"))
}

/// Occasional slip of the encoder's wheel, with a lasting error.
#[derive(Serialize)]
struct SlippedEncoder {
    /// When, and by how much.
    slips: Vec<(f64, f64)>,
}

impl Hidden for SlippedEncoder {
    fn commits(&self) -> bool {
        false
    }
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        let past = self
            .slips
            .iter()
            .filter(|(time_s, _)| now.time_s >= *time_s);
        reading.contraction += past.map(|(_, slip)| slip).sum::<f64>();
    }
}

pub(super) fn slipped_encoder(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let slip = log_scale(size, 0.4e-3, 6.0e-3);
    let mut time_s = 0.0;
    let mut one = |_| {
        time_s += between(rng, 4.0, 12.0);
        (time_s, slip * sign(rng) * between(rng, 0.6, 1.4))
    };
    let slips = (0..slip_count(size)).map(&mut one).collect();
    Law::new(
        SlippedEncoder { slips },
        "steps",
        format!("by some {slip:.5} at a time"),
    )
}

/// More slips where the effect is to be plain.
fn slip_count(size: f64) -> usize {
    2 + (4.0 * size) as usize
}

/// How fast the encoder's reading follows while it does \[1/s\].
const FOLLOWED_PER_S: f64 = 400.0;

/// Reading of the contraction that is occasionally constant.
#[derive(Serialize)]
struct FrozenReading {
    moments: Moments,
}

/// State: the reading.
impl Hidden for FrozenReading {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x[0] = now.contraction;
    }
    fn load(&self, _: &mut Load, now: &Moment, x: &[f64], dx: &mut [f64]) {
        let follows = self.moments.part(now.time_s).is_none();
        dx[0] = f64::from(u8::from(follows)) * FOLLOWED_PER_S * (now.contraction - x[0]);
    }
    fn read(&self, reading: &mut Reading, _: &Moment, x: &[f64]) {
        reading.contraction = x[0];
    }
}

pub(super) fn frozen_reading(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let width_s = log_scale(size, 0.1, 0.8);
    let interval_s = between(rng, 1.7, 4.5);
    let moments = Moments::draw(rng, interval_s, width_s);
    let words = format!("for {width_s:.2} s");
    Law::new(FrozenReading { moments }, "now-and-then", words)
}

/// Interference on the pressure's cable.
#[derive(Serialize)]
struct PressureHum {
    amplitude_pa: f64,
    frequency_hz: f64,
    waveform: Waveform,
}

impl Hidden for PressureHum {
    fn commits(&self) -> bool {
        false
    }
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        let turns = self.frequency_hz * now.time_s;
        reading.pressure_pa += self.amplitude_pa * self.waveform.at(turns);
    }
}

pub(super) fn pressure_hum(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let amplitude_pa = log_scale(size, 0.8e3, 10.0e3);
    let effect = PressureHum {
        amplitude_pa,
        frequency_hz: log_between(rng, 0.3, 6.0),
        waveform: Waveform::draw(rng),
    };
    Law::new(effect, "periodic", format!("by {amplitude_pa:.0} Pa"))
}

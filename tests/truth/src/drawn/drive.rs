//! Drives of a drawn rig: reference pressures, written in advance or by a controller.

use std::f64::consts::{PI, TAU};

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::bench::{Bench, Clock};
use super::shape::{between, log_between};
use crate::hidden::Reading;
use crate::machine::GRAVITY_M_PER_S2;

/// Largest step up, as a share of the pressures at which the weight hangs free: a larger one
/// throws the weight.
const LARGEST_RISE: f64 = 0.4;
/// Resolution of the valve's electronics.
const COUNT_PA: f64 = 10.0;
/// Longest sampling period of a controller in the loop.
const LEAST_LOOP_HZ: f64 = 100.0;

/// The shape of a section of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Style {
    /// Small and large steps with holds, occasionally down to zero.
    Steps,
    /// Long holds.
    Holds,
    /// Fast large steps near the highest pressure.
    Bursts,
    /// Up and down at several rates, with minor loops.
    Triangles,
    /// One sine, whose frequency rises or falls.
    Sine,
    /// Sines of random frequencies.
    Random,
    /// A finger lifts and lowers the weight through an assist controller.
    Assist,
}

use Style::{Assist, Bursts, Holds, Random, Sine, Steps, Triangles};

/// Styles of each of a case's records.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) fit: [Vec<Style>; 2],
    pub(crate) validate: [Vec<Style>; 2],
    pub(crate) unseen: Vec<Style>,
}

impl Plan {
    /// Mixed records in most cases, in the others one style a record; with bursts where only they
    /// bring an effect to light.
    pub(crate) fn draw(clock: &Clock, near_supply: bool, rng: &mut Pcg64) -> Self {
        let mut pure = vec![Steps, Triangles, Sine, Random];
        if clock.rate_hz >= LEAST_LOOP_HZ {
            pure.push(Assist);
        }
        pure.shuffle(rng);
        let mixed = rng.random_bool(0.7);
        let mut record = |rng: &mut Pcg64| {
            let mut styles = if mixed {
                let mut all = vec![Steps, Holds, Bursts, Triangles, Sine, Random];
                all.shuffle(rng);
                all.truncate(rng.random_range(2..=4));
                all
            } else {
                // no two neighbours alike
                pure.rotate_left(1);
                vec![pure[0]]
            };
            if near_supply && !styles.contains(&Bursts) && styles != [Assist] {
                styles.push(Bursts);
            }
            styles
        };
        let mut fit = [record(rng), record(rng)];
        let validate = [record(rng), record(rng)];
        let unseen = record(rng);
        if mixed && clock.rate_hz >= LEAST_LOOP_HZ && rng.random_bool(0.25) {
            fit[1] = vec![Assist];
        }
        Self {
            fit,
            validate,
            unseen,
        }
    }
}

/// The beginning of a run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    /// The record begins some seconds after the run.
    pub(crate) moving: bool,
    /// The weight is let down on its stop now and then.
    pub(crate) vents: bool,
    /// The run begins there, with the muscle empty.
    pub(crate) vented: bool,
}

/// A finger and its controller (Eqs 6 to 8): the force asked for rises with what the weight lags
/// the finger, by a gain that valve and muscle allow.
#[derive(Clone, Debug)]
pub(crate) struct Finger {
    /// Times, and the contractions that the finger asks for, joined by half cosines.
    way: Vec<(f64, f64)>,
    gain_n: f64,
    rig: crate::Rig,
    high_pa: f64,
}

impl Finger {
    fn draw(bench: &Bench, (from_s, until_s): (f64, f64), rng: &mut Pcg64) -> Self {
        let reached = 0.6 * bench.contraction_most;
        let mut way = vec![(from_s, between(rng, 0.1, 0.5) * reached)];
        let mut time_s = from_s + 1.0;
        while time_s < until_s {
            let (_, height) = way[way.len() - 1];
            way.push((time_s, height));
            time_s += between(rng, 0.8, 3.0);
            way.push((time_s, between(rng, 0.02, 1.0) * reached));
            time_s += log_between(rng, 0.3, 4.0);
        }
        // Routh's criterion for the weight's oscillation behind the gas's lag
        let lag = bench.gas_s() * bench.angular_per_s();
        let damping =
            bench.rig.viscous_damping_ns_per_m / (bench.rig.mass_kg * bench.angular_per_s());
        let largest = (1.0 + damping * lag) * (damping + lag) / lag - 1.0;
        let gain = (between(rng, 0.3, 0.6) * largest).min(4.0);
        Self {
            way,
            gain_n: gain * bench.stiffness_n(),
            rig: bench.rig.clone(),
            high_pa: bench.high_pa,
        }
    }

    fn height(&self, time_s: f64) -> f64 {
        let next = self.way.partition_point(|(at_s, _)| *at_s <= time_s);
        let Some(&(to_s, to)) = self.way.get(next) else {
            return self.way[self.way.len() - 1].1;
        };
        let (from_s, from) = self.way[next.saturating_sub(1)];
        let part = ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
        from + (to - from) * (0.5 - 0.5 * (PI * part).cos())
    }

    /// The reference for what the encoder reads.
    pub(crate) fn reference_pa(&self, time_s: f64, reading: &Reading) -> f64 {
        let rig = &self.rig;
        let contraction = reading.contraction.clamp(0.0, 0.9);
        let weight_n = rig.mass_kg * GRAVITY_M_PER_S2;
        let force_n = weight_n + self.gain_n * (self.height(time_s) - contraction);
        let area_m2 = rig.alpha_m2 * (1.0 - contraction).powi(2) + rig.beta_m2;
        // Eq 8 is singular where the muscle has no force left
        let least_m2 = 0.1 * (rig.alpha_m2 + rig.beta_m2);
        let pressure_pa = (force_n - rig.gamma_n) / area_m2.max(least_m2);
        counted(pressure_pa.clamp(0.0, self.high_pa))
    }
}

fn counted(pressure_pa: f64) -> f64 {
    (pressure_pa / COUNT_PA).round() * COUNT_PA
}

/// A reference that holds from each row until the next, and when the rows are.
#[derive(Clone, Debug)]
pub(crate) struct Run {
    pub(crate) times_s: Vec<f64>,
    /// Number of rows before the record begins.
    pub(crate) unrecorded: usize,
    pub(crate) reference_pa: Vec<f64>,
    /// For each row whether the shut-off valve is shut; empty if it never is.
    pub(crate) shut: Vec<bool>,
    /// Writes the reference instead, if there is one.
    pub(crate) finger: Option<Finger>,
}

impl Run {
    /// Draws a run in `styles`, any order, the rest of its time at rest.
    pub(crate) fn draw(
        bench: &Bench,
        clock: &Clock,
        styles: &[Style],
        start: Start,
        rng: &mut Pcg64,
    ) -> Self {
        let unrecorded_s = if start.moving {
            between(rng, 2.0, 6.0)
        } else {
            0.0
        };
        let (times_s, unrecorded) = clock.times_s(unrecorded_s, rng);
        let (from_s, until_s) = (times_s[0], times_s[times_s.len() - 1]);
        let mut styles = styles.to_vec();
        styles.shuffle(rng);
        let mut pen = Pen {
            bench,
            vents: start.vents,
            times_s: &times_s,
            reference_pa: Vec::new(),
            due_s: from_s,
        };
        let first_pa = if start.vented || start.vents && rng.random_bool(0.4) {
            0.0
        } else {
            pen.level(rng)
        };
        pen.hold(first_pa, 1.2);
        let parts = between_parts(styles.len(), rng);
        let left_s = until_s - pen.due_s;
        for (style, part) in styles.iter().zip(parts) {
            pen.style(*style, pen.due_s + part * left_s, rng);
        }
        let last_pa = pen.last_pa();
        let mut reference_pa = pen.reference_pa;
        reference_pa.resize(times_s.len(), last_pa);
        let finger = (styles == [Assist]).then(|| Finger::draw(bench, (from_s, until_s), rng));
        Self {
            times_s,
            unrecorded,
            reference_pa,
            shut: Vec::new(),
            finger,
        }
    }

    /// The same, its pressures drawn towards their lowest to `share` of the way.
    pub(crate) fn softened(&mut self, low_pa: f64, share: f64) {
        for pa in &mut self.reference_pa {
            if *pa > low_pa {
                *pa = counted(low_pa + share * (*pa - low_pa));
            }
        }
        if let Some(finger) = &mut self.finger {
            for (_, height) in &mut finger.way {
                *height *= share;
            }
        }
    }
}

/// Shares of a record's time, none of them tiny.
fn between_parts(count: usize, rng: &mut Pcg64) -> Vec<f64> {
    let raw: Vec<f64> = (0..count).map(|_| between(rng, 1.0, 2.5)).collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|part| part / sum).collect()
}

/// Where a drive is being written.
struct Pen<'a> {
    bench: &'a Bench,
    vents: bool,
    times_s: &'a [f64],
    reference_pa: Vec<f64>,
    due_s: f64,
}

impl Pen<'_> {
    fn last_pa(&self) -> f64 {
        *self.reference_pa.last().unwrap_or(&0.0)
    }

    fn low_pa(&self) -> f64 {
        1.08 * self.bench.lift_pa
    }

    fn span_pa(&self) -> f64 {
        self.bench.high_pa - self.low_pa()
    }

    /// A pressure by its place between the lowest and the highest.
    fn pressure_pa(&self, place: f64) -> f64 {
        self.low_pa() + place * self.span_pa()
    }

    fn level(&self, rng: &mut Pcg64) -> f64 {
        self.pressure_pa(between(rng, 0.0, 1.0))
    }

    /// Writes `duration_s` of a shape.
    fn write(&mut self, duration_s: f64, shape: impl Fn(f64) -> f64) {
        let from_s = self.due_s;
        self.due_s += duration_s;
        while let Some(time_s) = self.times_s.get(self.reference_pa.len())
            && *time_s < self.due_s - 1.0e-9
        {
            let pressure_pa = shape(time_s - from_s).clamp(0.0, self.bench.high_pa);
            self.reference_pa.push(counted(pressure_pa));
        }
    }

    /// Steps and holds; far up in two steps.
    fn hold(&mut self, pressure_pa: f64, duration_s: f64) {
        let from_pa = if self.reference_pa.is_empty() {
            pressure_pa
        } else {
            self.last_pa()
        };
        let rise_pa = LARGEST_RISE * self.span_pa();
        if pressure_pa - from_pa.max(self.low_pa()) > rise_pa {
            let between_pa = pressure_pa - rise_pa;
            let share_s = 0.4 * duration_s;
            self.write(share_s, |_| between_pa);
            return self.write(duration_s - share_s, |_| pressure_pa);
        }
        self.write(duration_s, |_| pressure_pa);
    }

    fn ramp(&mut self, to_pa: f64, duration_s: f64) {
        let from_pa = self.last_pa();
        self.write(duration_s, |time_s| {
            from_pa + (to_pa - from_pa) * time_s / duration_s
        });
    }

    fn style(&mut self, style: Style, until_s: f64, rng: &mut Pcg64) {
        match style {
            Steps => self.steps(until_s, rng),
            Holds => self.holds(until_s, rng),
            Bursts => self.bursts(until_s, rng),
            Triangles => self.triangles(until_s, rng),
            Sine => self.sine(until_s, rng),
            Random => self.random(until_s, rng),
            Assist => {}
        }
    }

    fn steps(&mut self, until_s: f64, rng: &mut Pcg64) {
        let vent_at_s = between(rng, self.due_s, until_s);
        let mut vented = !self.vents;
        while self.due_s < until_s - 0.3 {
            let hold_s = log_between(rng, 0.4, 4.0).min(until_s - self.due_s);
            let level_pa = if !vented && self.due_s >= vent_at_s {
                vented = true;
                between(rng, 0.0, 0.3) * self.low_pa()
            } else if rng.random_bool(0.4) {
                let small_pa = between(rng, 0.03, 0.1) * self.span_pa();
                let up = self.last_pa() < self.pressure_pa(0.3) || rng.random_bool(0.5);
                self.last_pa() + if up { small_pa } else { -small_pa }
            } else {
                self.level(rng)
            };
            self.hold(level_pa, hold_s);
        }
    }

    fn holds(&mut self, until_s: f64, rng: &mut Pcg64) {
        let count = rng.random_range(2..=3);
        let hold_s = (until_s - self.due_s) / f64::from(count);
        let mut high = rng.random_bool(0.5);
        for _ in 0..count {
            let place = if high {
                between(rng, 0.6, 1.0)
            } else {
                between(rng, 0.0, 0.35)
            };
            self.hold(self.pressure_pa(place), hold_s);
            high = !high;
        }
    }

    fn bursts(&mut self, until_s: f64, rng: &mut Pcg64) {
        while self.due_s < until_s - 0.2 {
            let hold_s = between(rng, 0.35, 0.8).min(until_s - self.due_s);
            let place = if self.last_pa() < self.pressure_pa(0.75) {
                between(rng, 0.92, 1.0)
            } else {
                between(rng, 0.2, 0.55)
            };
            self.hold(self.pressure_pa(place), hold_s);
        }
    }

    fn triangles(&mut self, until_s: f64, rng: &mut Pcg64) {
        let mut up = self.last_pa() < self.pressure_pa(0.5);
        loop {
            let left_s = until_s - self.due_s;
            if left_s < 0.2 {
                return;
            }
            let leg_s = log_between(rng, 0.6, 5.0).min(left_s);
            let place = if up {
                between(rng, 0.65, 1.0)
            } else {
                between(rng, 0.0, 0.3)
            };
            let (from_pa, to_pa) = (self.last_pa(), self.pressure_pa(place));
            if left_s > 2.0 * leg_s && rng.random_bool(0.5) {
                // a minor loop on the way
                let turn_pa = from_pa + between(rng, 0.4, 0.75) * (to_pa - from_pa);
                let back_pa = turn_pa - between(rng, 0.15, 0.4) * (to_pa - from_pa);
                self.ramp(turn_pa, 0.5 * leg_s);
                self.ramp(back_pa, 0.25 * leg_s);
                self.ramp(to_pa, 0.75 * leg_s);
            } else {
                self.ramp(to_pa, leg_s);
            }
            up = !up;
        }
    }

    fn sine(&mut self, until_s: f64, rng: &mut Pcg64) {
        let middle_pa = self.pressure_pa(between(rng, 0.4, 0.6));
        let amplitude_pa = between(rng, 0.15, 0.38) * self.span_pa();
        let start_s = 0.8_f64.min(0.4 * (until_s - self.due_s));
        self.ramp(middle_pa, start_s);
        let whole_s = until_s - self.due_s;
        let (first_hz, last_hz) = if rng.random_bool(0.4) {
            let hz = log_between(rng, 0.15, 1.2);
            (hz, hz)
        } else {
            (log_between(rng, 0.1, 1.5), log_between(rng, 0.1, 1.5))
        };
        self.write(whole_s, |time_s| {
            let turns = first_hz * time_s + 0.5 * (last_hz - first_hz) * time_s * time_s / whole_s;
            middle_pa + amplitude_pa * (TAU * turns).sin()
        });
    }

    fn random(&mut self, until_s: f64, rng: &mut Pcg64) {
        let middle_pa = self.pressure_pa(between(rng, 0.4, 0.6));
        let count = rng.random_range(4..=10);
        let top_hz = log_between(rng, 0.8, 4.0);
        let sines: Vec<(f64, f64, f64)> = (0..count)
            .map(|_| {
                let hz = log_between(rng, 0.05, top_hz);
                // slow ones are larger
                (hz, between(rng, 0.0, TAU), (0.1 / hz).powf(0.4))
            })
            .collect();
        let power: f64 = sines.iter().map(|(_, _, a)| 0.5 * a * a).sum();
        let scale_pa = between(rng, 0.12, 0.22) * self.span_pa() / power.sqrt();
        let shape = move |time_s: f64| {
            let terms = sines
                .iter()
                .map(|(hz, phase, a)| a * (TAU * hz * time_s + phase).sin());
            middle_pa + scale_pa * terms.sum::<f64>()
        };
        let start_s = 0.8_f64.min(0.4 * (until_s - self.due_s));
        let first_pa = shape(0.0);
        self.ramp(first_pa, start_s);
        self.write(until_s - self.due_s, shape);
    }
}

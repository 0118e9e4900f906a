//! Muscle force with memory: hysteresis, creep, run-in.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{
    Coordinate, Curve, Modulation, Ramp, between, log_between, log_scale, shares, sign,
};
use super::Law;
use crate::hidden::{Hidden, Moment};

/// Ratio of the largest to the smallest density of a drawn kernel.
const KERNEL: f64 = 30.0;

/// Elastoplastic elements in parallel (Prandtl–Ishlinskii stops, Maxwell slip): each yields at
/// thresholds that differ between the directions.
#[derive(Serialize)]
struct Stops {
    /// Contraction at which an element yields, one for each way.
    reach: Vec<[f64; 2]>,
    /// Of the whole, at yield while drawing in.
    share: Vec<f64>,
}

impl Stops {
    fn draw(rng: &mut Pcg64, count: usize) -> Self {
        let first = log_between(rng, 0.0008, 0.004);
        let last = first * log_between(rng, 8.0, 30.0);
        let density = Curve::draw(rng, KERNEL);
        let asymmetry = log_between(rng, 1.0 / 1.7, 1.7);
        let place = |i: usize| i as f64 / (count - 1).max(1) as f64;
        let raw: Vec<f64> = (0..count).map(|i| density.at(place(i))).collect();
        let sum: f64 = raw.iter().sum();
        let reach = |i: usize| {
            let reach = first * (last / first).powf(place(i));
            [reach, asymmetry * reach]
        };
        Self {
            reach: (0..count).map(reach).collect(),
            share: raw.iter().map(|share| share / sum).collect(),
        }
    }

    /// Stretch of element `i` with its slider at `slider`.
    fn stretch(&self, i: usize, slider: f64, at: f64) -> f64 {
        let [inward, outward] = self.reach[i];
        (at - slider).clamp(-outward, inward)
    }

    fn pull(&self, at: f64, sliders: &[f64]) -> f64 {
        let terms = sliders
            .iter()
            .enumerate()
            .map(|(i, slider)| self.share[i] * self.stretch(i, *slider, at) / self.reach[i][0]);
        terms.sum()
    }
}

/// Bouc–Wen, whose parameters keep it dissipative.
#[derive(Serialize)]
struct BoucWen {
    reach: f64,
    sharpness: f64,
    softening: f64,
}

impl BoucWen {
    fn draw(rng: &mut Pcg64) -> Self {
        Self {
            reach: log_between(rng, 0.003, 0.03),
            sharpness: log_between(rng, 0.6, 3.0),
            softening: between(rng, 0.5, 1.0),
        }
    }

    fn rate(&self, rate: f64, z: f64) -> f64 {
        let along = (rate * z).signum();
        let bent = z.abs().powf(self.sharpness);
        rate / self.reach * (1.0 - bent * (self.softening * along + 1.0 - self.softening))
    }
}

/// Duhem: an approach of its own to a limit of its own each way.
#[derive(Serialize)]
struct Duhem {
    reach: [f64; 2],
    limit: [f64; 2],
    power: [f64; 2],
}

impl Duhem {
    fn draw(rng: &mut Pcg64) -> Self {
        let mut two = |low, high| [log_between(rng, low, high), log_between(rng, low, high)];
        Self {
            reach: two(0.003, 0.03),
            power: two(0.7, 2.0),
            limit: [1.0, two(0.7, 1.7)[0]],
        }
    }

    fn rate(&self, rate: f64, z: f64) -> f64 {
        let way = usize::from(rate < 0.0);
        let towards = if way == 0 { z } else { -z };
        let left = (1.0 - towards / self.limit[way]).max(0.0);
        rate / self.reach[way] * left.powf(self.power[way])
    }
}

/// Rate-independent memory of the contraction, as wide as pressure makes it.
///
/// The operators are driven by the integral of `along` over contraction, and their force is in
/// proportion to `along`: a loop at constant pressure cannot give work (virtual work of the
/// operators, each of which is dissipative).
#[derive(Serialize)]
struct Hysteresis {
    half_width_n: f64,
    with_pressure: Modulation,
    /// Of contraction.
    along: Curve,
    contraction_most: f64,
    stops: Option<(f64, Stops)>,
    bouc_wen: Option<(f64, BoucWen)>,
    duhem: Option<(f64, Duhem)>,
}

impl Hysteresis {
    fn elements(&self) -> usize {
        self.stops
            .as_ref()
            .map_or(0, |(_, stops)| stops.share.len())
    }

    /// The coordinate that drives the operators, and its slope.
    fn drive(&self, contraction: f64) -> (f64, f64) {
        let u = contraction / self.contraction_most;
        (
            self.contraction_most * self.along.integral(u),
            self.along.at(u),
        )
    }
}

/// States: sliders, Bouc–Wen's and Duhem's variable.
impl Hidden for Hysteresis {
    fn states(&self) -> usize {
        self.elements() + 2
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        let (at, _) = self.drive(now.contraction);
        x.fill(at);
        let n = self.elements();
        x[n..].fill(0.0);
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let (at, slope) = self.drive(now.contraction);
        let (n, rate) = (self.elements(), slope * now.rate_per_s);
        let mut pull = 0.0;
        if let Some((share, stops)) = &self.stops {
            pull += share * stops.pull(at, &x[..n]);
        }
        if let Some((share, bouc_wen)) = &self.bouc_wen {
            dx[n] = bouc_wen.rate(rate, x[n]);
            pull += share * x[n];
        }
        if let Some((share, duhem)) = &self.duhem {
            dx[n + 1] = duhem.rate(rate, x[n + 1]);
            pull += share * x[n + 1];
        }
        force_n - self.half_width_n * self.with_pressure.at(now) * slope * pull
    }
    fn commit(&self, now: &Moment, x: &mut [f64]) {
        let (at, _) = self.drive(now.contraction);
        if let Some((_, stops)) = &self.stops {
            for (i, slider) in x[..stops.share.len()].iter_mut().enumerate() {
                *slider = at - stops.stretch(i, *slider, at);
            }
        }
    }
}

pub(super) fn hysteresis(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let family = rng.random_range(0..6);
    let count = if rng.random_bool(0.3) {
        rng.random_range(3..=5)
    } else {
        rng.random_range(8..=14)
    };
    let used = [
        [true, false, false],
        [false, true, false],
        [false, false, true],
        [true, true, false],
        [true, false, true],
        [false, true, true],
    ][family];
    let parts = shares(rng, used.iter().filter(|used| **used).count());
    let mut parts = parts.into_iter();
    let mut part = |i: usize| used[i].then(|| parts.next().unwrap_or(1.0));
    let (stops, bouc_wen, duhem) = (part(0), part(1), part(2));
    let effect = Hysteresis {
        half_width_n: log_scale(size, 0.004, 0.07) * bench.blocked_n,
        with_pressure: Modulation::rising(rng, Coordinate::Pressure, bench),
        along: if rng.random_bool(0.6) {
            Curve::draw(rng, 2.0)
        } else {
            Curve::flat()
        },
        contraction_most: bench.contraction_most,
        stops: stops.map(|share| (share, Stops::draw(rng, count))),
        bouc_wen: bouc_wen.map(|share| (share, BoucWen::draw(rng))),
        duhem: duhem.map(|share| (share, Duhem::draw(rng))),
    };
    let names = ["stops", "bouc-wen", "duhem"];
    let named = names.iter().zip(used).filter(|(_, used)| *used);
    let form: Vec<&str> = named.map(|(name, _)| *name).collect();
    let words = format!(
        "rate-independent, half-width {:.1} N, {count} thresholds where there are stops, by a \
         factor of {:.2} along contraction{}",
        effect.half_width_n,
        effect.along.ratio(),
        effect.with_pressure.words()
    );
    Law::new(effect, form.join("+"), words)
}

/// Relaxations of strain and of pressure over a spectrum of time constants.
#[derive(Serialize)]
struct Creep {
    time_constant_s: Vec<f64>,
    /// Of the force of strain and pressure.
    share: Vec<f64>,
    /// Force of a unit of strain that has not relaxed.
    strain_n: f64,
    /// Share of Eq 1's pressure force that comes late.
    pressure_share: f64,
    /// How much faster the relaxations go when they rise.
    faster_up: f64,
    modulation: Modulation,
}

impl Creep {
    fn relax(&self, i: usize, off: f64) -> f64 {
        let way = if off > 0.0 { self.faster_up } else { 1.0 };
        way * off / self.time_constant_s[i]
    }
}

/// States: relaxed strain and relaxed pressure of each branch.
impl Hidden for Creep {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        2 * self.share.len()
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        let n = self.share.len();
        x[..n].fill(now.contraction);
        x[n..].fill(now.pressure_pa);
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let n = self.share.len();
        let (mut strain, mut late_pa) = (0.0, 0.0);
        for i in 0..n {
            let off = now.contraction - x[i];
            dx[i] = self.relax(i, off);
            strain += self.share[i] * off;
            let off_pa = now.pressure_pa - x[n + i];
            dx[n + i] = self.relax(i, off_pa);
            late_pa += self.share[i] * off_pa;
        }
        let lost_n = self.strain_n * strain + self.pressure_share * now.area_m2 * late_pa;
        force_n - self.modulation.at(now) * lost_n
    }
}

/// Time constants and shares, and what the spectrum is called.
fn spectrum(rng: &mut Pcg64) -> (Vec<f64>, Vec<f64>, &'static str) {
    let branches = rng.random_range(8..=11);
    let first_s = log_between(rng, 0.2, 1.0);
    let last_s = log_between(rng, 25.0, 150.0);
    let place = |i: usize| i as f64 / (branches - 1) as f64;
    let time_constant_s = |i: usize| first_s * (last_s / first_s).powf(place(i));
    let times_s: Vec<f64> = (0..branches).map(time_constant_s).collect();
    let (raw, name): (Vec<f64>, _) = match rng.random_range(0..4) {
        0 => (vec![1.0; branches], "logarithmic"),
        1 => {
            let power = between(rng, -0.45, 0.45);
            let share = |s: &f64| s.powf(power);
            (times_s.iter().map(share).collect(), "fractional")
        }
        2 => {
            let density = Curve::with_ratio(rng, KERNEL);
            let share = |i: usize| density.at(place(i));
            ((0..branches).map(share).collect(), "spectrum")
        }
        _ => {
            // one or two branches of the textbook
            let count = rng.random_range(1..=2);
            let mut times_s: Vec<f64> = (0..count).map(|_| log_between(rng, 0.8, 25.0)).collect();
            times_s.sort_by(f64::total_cmp);
            return (times_s, shares(rng, count), "branches");
        }
    };
    let sum: f64 = raw.iter().sum();
    (times_s, raw.iter().map(|share| share / sum).collect(), name)
}

pub(super) fn creep(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let (time_constant_s, share, name) = spectrum(rng);
    let strain = match rng.random_range(0..5) {
        0..=1 => 1.0,
        2..=3 => 0.0,
        _ => between(rng, 0.2, 0.8),
    };
    let coordinates = [Coordinate::Pressure, Coordinate::Contraction];
    let modulation = Modulation::draw(rng, &coordinates, bench);
    let strain_n = strain * log_scale(size, 0.05, 0.6) * bench.blocked_n;
    let pressure_share = (1.0 - strain) * log_scale(size, 0.015, 0.2);
    let words = format!(
        "{name} of {} time constants from {:.2} to {:.1} s; {strain_n:.0} N per strain and {:.1} % \
         of the pressure's force{}",
        share.len(),
        time_constant_s[0],
        time_constant_s[time_constant_s.len() - 1],
        100.0 * pressure_share,
        modulation.words()
    );
    let form = match strain {
        1.0 => "strain",
        0.0 => "pressure",
        _ => "both",
    };
    let faster_up = if rng.random_bool(0.5) {
        log_between(rng, 0.5, 2.0)
    } else {
        1.0
    };
    Law::new(
        Creep {
            time_constant_s,
            share,
            strain_n,
            pressure_share,
            faster_up,
            modulation,
        },
        format!("{name}-{form}"),
        words,
    )
}

/// How the share falls with the cycles done.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Fading {
    /// exp(−n^power)
    Stretched(f64),
    /// (1 + n)^−power
    Power(f64),
    /// One less a random rising shape, done after these cycles.
    Monotone(f64, Ramp),
}

impl Fading {
    fn at(&self, cycles: f64) -> f64 {
        let cycles = cycles.max(0.0);
        match self {
            Fading::Stretched(power) => (-cycles.powf(*power)).exp(),
            Fading::Power(power) => (1.0 + cycles).powf(-power),
            Fading::Monotone(done, ramp) => 1.0 - ramp.saturated(cycles / done),
        }
    }
}

/// Pressure's force off by a share that fades with the way travelled.
#[derive(Serialize)]
struct RunIn {
    share: f64,
    /// Way up and down of one cycle, in contraction.
    cycle: f64,
    /// Cycles over which it fades.
    cycles: f64,
    fading: Fading,
    wear: Modulation,
}

/// State: cycles done.
impl Hidden for RunIn {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = 0.0;
    }
    fn force_n(&self, force_n: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        dx[0] = self.wear.at(now) * now.rate_per_s.abs() / self.cycle;
        let left = self.fading.at(x[0] / self.cycles);
        force_n + self.share * left * now.area_m2 * now.pressure_pa
    }
}

pub(super) fn run_in(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let share = sign(rng) * log_scale(size, 0.008, 0.1);
    let cycles = log_between(rng, 0.7, 3.5);
    let fading = match rng.random_range(0..3) {
        0 => Fading::Stretched(between(rng, 0.6, 1.4)),
        1 => Fading::Power(between(rng, 0.8, 2.5)),
        _ => Fading::Monotone(between(rng, 1.5, 4.0), Ramp::draw(rng, 10.0)),
    };
    let form = match fading {
        Fading::Stretched(_) => "stretched-exponential",
        Fading::Power(_) => "power",
        Fading::Monotone(..) => "monotone",
    };
    let wear = Modulation::draw(rng, &[Coordinate::Pressure, Coordinate::Speed], bench);
    let words = format!(
        "{:.1} % of the pressure's force at first, gone after some {cycles:.1} cycles{}",
        100.0 * share,
        wear.words()
    );
    Law::new(
        RunIn {
            share,
            cycle: bench.contraction_most,
            cycles,
            fading,
            wear,
        },
        form,
        words,
    )
}

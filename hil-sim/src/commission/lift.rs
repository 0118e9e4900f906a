//! The slow lift: load mass, friction, and what contradicts the settings.
//!
//! The weight in balance is carried by F = f_p(ε)P + γ (Eq 1), plus friction against its motion. So
//! the mean of the forces on the way up and on the way down is the weight, half their difference is
//! Coulomb friction, and the forces at which the weight breaks away are further apart by static
//! friction. How fast F at constant ε would rise with the travel is known, too: 2αP/L, without γ
//! and mass; a travel that is read too small or too large shows in it.

use crate::commission::cause::Cause;
use model_core::link::Telemetry;
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use model_core::supervisor::Mode;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;

/// Height of the lift \[m\]: the weight slips by up to 1.5 mm beyond, and the encoder may have
/// twice the scale; the weight then still moves by less than 10 mm.
pub const TOP_M: f64 = 3.5e-3;
/// Largest lift that the highest reference causes if nothing is read of it \[m\].
const UNSEEN_M: f64 = 9e-3;
/// Travel that is a motion \[m\]: four counts of the paper's encoder.
const MOVED_M: f64 = 5e-5;
/// Travel in the wrong direction that ends the lift \[m\].
pub const WRONG_WAY_M: f64 = 5e-4;
/// Ticks before a breakaway that are averaged.
const BREAK_TICKS: usize = 5;
/// Ratio of read to true travel, either way: stick-slip makes it uncertain by some 10 %.
const TRAVEL: f64 = 1.33;
/// Slope of pressure over reference on the stop, either way.
const DRIVE: f64 = 1.05;
/// Smallest difference of a mass that is told, relative.
const MASS: f64 = 0.05;
/// Least friction that is allowed for \[N\].
const FRICTION_N: f64 = 5.0;
/// Share of the pressure at which the muscle begins to pull from which the reference rises slowly.
const SLOW_SHARE: f64 = 0.75;

/// What is known of the muscle and its load before the lift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Settings in force: muscle, load and scales.
    pub values: SettingsValues,
    /// Relative standard deviations of α, β and γ.
    pub muscle_sd: [f64; 3],
}

impl Known {
    fn weight_n(&self) -> f64 {
        f64::from(self.values.load_kg) * GRAVITY_M_PER_S2
    }

    fn force_per_pressure_m2(&self) -> f64 {
        f64::from(self.values.muscle.force_per_pressure_m2(0.0))
    }

    /// Pressure at which the muscle on the stop pulls with `force_n` \[Pa\].
    fn pressure_pa(&self, force_n: f64) -> f64 {
        (force_n - f64::from(self.values.muscle.gamma_n)) / self.force_per_pressure_m2()
    }

    /// Pressure at which the muscle begins to pull \[Pa\].
    pub fn begins_pa(&self) -> f64 {
        self.pressure_pa(0.0)
    }

    /// Pressure at which the weight lifts \[Pa\].
    pub fn lifts_pa(&self) -> f64 {
        self.pressure_pa(self.weight_n())
    }

    /// Force per travel at constant pressure \[N/m\].
    fn stiffness_n_per_m(&self, pressure_pa: f64) -> f64 {
        let muscle = &self.values.muscle;
        let stiffness_n = muscle.stiffness_n(0.0, GaugePa(pressure_pa as f32));
        f64::from(stiffness_n / muscle.initial_length_m)
    }

    /// Rise of the pressure beyond `lifts_pa` that lifts the weight by the height that may be
    /// unseen \[Pa\].
    pub fn unseen_pa(&self) -> f64 {
        UNSEEN_M * self.stiffness_n_per_m(self.lifts_pa()) / self.force_per_pressure_m2()
    }

    /// Standard deviation of the muscle's force at `pressure_pa` \[N\]. Errors of α and β come from
    /// one braid angle, so both rise together.
    pub fn force_sd_n(&self, pressure_pa: f64) -> f64 {
        let muscle = &self.values.muscle;
        let [alpha, beta, gamma] = self.muscle_sd;
        let braid_n =
            pressure_pa * (alpha * f64::from(muscle.alpha_m2) + beta * f64::from(muscle.beta_m2));
        braid_n.hypot(gamma * f64::from(muscle.gamma_n))
    }

    /// Travel from the count `home` \[m\].
    pub fn travel_m(&self, tick: &Telemetry, home: &Telemetry) -> f64 {
        let counts = tick.sensors.encoder.since(home.sensors.encoder);
        f64::from(counts) * f64::from(self.values.encoder_m_per_count)
    }

    fn pressure_of(&self, tick: &Telemetry) -> f64 {
        f64::from(self.values.pressure_sensor.value(tick.sensors.pressure))
    }
}

/// A tick of the lift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Travel from the stop \[m\].
    pub travel_m: f64,
    /// f_p(0)P + γ \[N\]: the force that the pressure would have on the stop.
    pub force_n: f64,
    /// Measured pressure \[Pa\].
    pub pressure_pa: f64,
    /// Reference of the tick before \[Pa\].
    pub reference_pa: f64,
}

/// What a lift has shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lift {
    /// Each tick of the play.
    pub samples: Vec<Sample>,
    /// Rise of the pressure over that of its reference, on the stop \[-\].
    pub drive_ratio: f64,
    /// Highest and lowest travel that was read \[m\].
    pub top_m: f64,
    /// See `top_m`.
    pub bottom_m: f64,
    /// The load, if it has been lifted \[kg\].
    pub mass_kg: Option<f64>,
    /// Coulomb friction \[N\].
    pub coulomb_n: f64,
    /// Static friction of each breakaway \[N\].
    pub static_n: Vec<f64>,
    /// Travel that was read over the travel that Eq 1 predicts \[-\].
    pub travel_ratio: f64,
}

impl Lift {
    /// Mean and standard deviation of the static friction \[N\].
    pub fn static_friction(&self) -> (f64, f64) {
        let n = self.static_n.len().max(1) as f64;
        let mean = self.static_n.iter().sum::<f64>() / n;
        let square = self.static_n.iter().map(|force_n| (force_n - mean).powi(2));
        (mean, (square.sum::<f64>() / n).sqrt())
    }
}

/// The ticks of the play in `ticks`.
fn samples(known: &Known, ticks: &[Telemetry]) -> Vec<Sample> {
    let playing: Vec<_> = ticks
        .iter()
        .filter(|tick| tick.output.mode == Mode::Playing)
        .collect();
    let Some(home) = playing.first() else {
        return Vec::new();
    };
    let sample = |pair: &[&Telemetry]| {
        let pressure_pa = known.pressure_of(pair[1]);
        Sample {
            travel_m: known.travel_m(pair[1], home),
            force_n: known.force_per_pressure_m2() * pressure_pa
                + f64::from(known.values.muscle.gamma_n),
            pressure_pa,
            reference_pa: f64::from(pair[0].output.pressure_ref.0),
        }
    };
    playing.windows(2).map(sample).collect()
}

/// A stretch of the lift in which the reference goes one way, with the hold after it.
struct Stretch<'a> {
    up: bool,
    samples: &'a [Sample],
    /// The first sample that has moved, and the force before it; none if none has.
    breakaway: Option<(usize, f64)>,
}

/// The stretches of `samples`.
fn stretches(samples: &[Sample], force_per_pressure_m2: f64) -> Vec<Stretch<'_>> {
    let mut starts = Vec::new();
    let mut up = false;
    for (at, pair) in samples.windows(2).enumerate() {
        let change_pa = pair[1].reference_pa - pair[0].reference_pa;
        if change_pa != 0.0 && (change_pa > 0.0) != up {
            up = change_pa > 0.0;
            starts.push((at, up));
        }
    }
    let ends = starts.iter().skip(1).map(|(at, _)| *at);
    let ends = ends.chain([samples.len()]);
    let stretch = |((from, up), to): (&(usize, bool), usize)| {
        let samples = &samples[*from..to];
        Stretch {
            up: *up,
            breakaway: breakaway(samples, *up, force_per_pressure_m2),
            samples,
        }
    };
    starts.iter().zip(ends).map(stretch).collect()
}

/// The first sample that has moved in the direction of the reference, and the force just before:
/// the mean over some ticks, and what the reference has changed by since.
fn breakaway(samples: &[Sample], up: bool, force_per_pressure_m2: f64) -> Option<(usize, f64)> {
    let sign = if up { 1.0 } else { -1.0 };
    let start_m = samples.first()?.travel_m;
    let moved = |sample: &Sample| sign * (sample.travel_m - start_m) > MOVED_M;
    let at = samples.iter().position(moved).filter(|at| *at > 0)?;
    let before = &samples[at.saturating_sub(BREAK_TICKS)..at];
    let mean = |of: fn(&Sample) -> f64| before.iter().map(of).sum::<f64>() / before.len() as f64;
    let since_pa = samples[at].reference_pa - mean(|sample| sample.reference_pa);
    let force_n = mean(|sample| sample.force_n) + force_per_pressure_m2 * since_pa;
    Some((at, force_n))
}

/// Sums of points, for a line.
#[derive(Default)]
struct Sums {
    count: f64,
    x: f64,
    y: f64,
    square: f64,
    product: f64,
}

impl Sums {
    fn add(&mut self, x: f64, y: f64) {
        self.count += 1.0;
        self.x += x;
        self.y += y;
        self.square += x * x;
        self.product += x * y;
    }

    /// Sums of squares and products about the means.
    fn central(&self) -> (f64, f64) {
        let square = self.square - self.x.powi(2) / self.count;
        (square, self.product - self.x * self.y / self.count)
    }

    /// The line of this slope at x = 0.
    fn at_zero(&self, slope: f64) -> f64 {
        (self.y - slope * self.x) / self.count
    }
}

/// What the play in `ticks` has shown.
pub fn lift(known: &Known, ticks: &[Telemetry]) -> Lift {
    let samples = samples(known, ticks);
    let travel = samples.iter().map(|sample| sample.travel_m);
    let mut lift = Lift {
        drive_ratio: drive_ratio(&samples, SLOW_SHARE * known.begins_pa()),
        top_m: travel.clone().fold(0.0, f64::max),
        bottom_m: travel.fold(0.0, f64::min),
        travel_ratio: 1.0,
        ..Lift::default()
    };
    let stretches = stretches(&samples, known.force_per_pressure_m2());
    let [mut up, mut down] = [Sums::default(), Sums::default()];
    let mut pressure = (0.0, 0.0);
    for stretch in &stretches {
        let from = stretch
            .breakaway
            .map_or(stretch.samples.len(), |(at, _)| at);
        let sums = if stretch.up { &mut up } else { &mut down };
        // On its stop the weight is carried by it.
        let lifted = |sample: &&Sample| sample.travel_m > 4.0 * MOVED_M;
        for sample in stretch.samples[from..].iter().filter(lifted) {
            sums.add(sample.travel_m, sample.force_n);
            pressure = (pressure.0 + sample.pressure_pa, pressure.1 + 1.0);
        }
    }
    if up.count < 2.0 || down.count < 2.0 {
        lift.samples = samples;
        return lift;
    }
    let model = known.stiffness_n_per_m(pressure.0 / pressure.1);
    let (square, product) = (
        up.central().0 + down.central().0,
        up.central().1 + down.central().1,
    );
    lift.travel_ratio = model * square / product;
    // The model's slope is the better one if nothing contradicts it.
    let n_per_m = match is_off(lift.travel_ratio, TRAVEL) {
        true => product / square,
        false => model,
    };
    let (up_n, down_n) = (up.at_zero(n_per_m), down.at_zero(n_per_m));
    let weight_n = 0.5 * (up_n + down_n);
    lift.mass_kg = Some(weight_n / GRAVITY_M_PER_S2);
    lift.coulomb_n = 0.5 * (up_n - down_n);
    for stretch in &stretches {
        if let Some((_, force_n)) = stretch.breakaway {
            let start_m = stretch.samples[0].travel_m;
            let sign = if stretch.up { 1.0 } else { -1.0 };
            lift.static_n
                .push(sign * (force_n - n_per_m * start_m - weight_n));
        }
    }
    lift.samples = samples;
    lift
}

/// Slope of the pressure over its reference before the weight moves, from `from_pa` on; 0 if the
/// reference never was there. An offset of sensor or valve has no influence.
fn drive_ratio(samples: &[Sample], from_pa: f64) -> f64 {
    let mut on_stop = Sums::default();
    let on = samples
        .iter()
        .take_while(|sample| sample.travel_m.abs() <= MOVED_M)
        .filter(|sample| sample.reference_pa > from_pa);
    for sample in on {
        on_stop.add(sample.reference_pa, sample.pressure_pa);
    }
    let (square, product) = on_stop.central();
    if square > 0.0 { product / square } else { 0.0 }
}

/// True if `ratio` is further from 1 than `limit`, either way.
fn is_off(ratio: f64, limit: f64) -> bool {
    !(1.0 / limit..=limit).contains(&ratio)
}

/// What contradicts `known`; `curve_known` if encoder and valve have been measured before.
pub fn contradiction(known: &Known, lift: &Lift, curve_known: bool) -> Option<Cause> {
    let drive_is_off = is_off(lift.drive_ratio, DRIVE);
    if lift.drive_ratio < 0.1 {
        return Some(Cause::NoAir);
    }
    if lift.bottom_m < -WRONG_WAY_M {
        return Some(Cause::EncoderSwapped);
    }
    let Some(mass_kg) = lift.mass_kg else {
        let read = lift.samples.iter().map(|sample| sample.pressure_pa);
        let should_lift = read.fold(0.0, f64::max) > known.lifts_pa();
        return Some(match (drive_is_off, curve_known) {
            (false, _) => Cause::NotLifted,
            (true, true) if lift.drive_ratio < 1.0 => Cause::MuscleLeak,
            (true, true) => Cause::PressureScale,
            (true, false) if should_lift => Cause::PressureScale,
            (true, false) => Cause::AmplifierGain,
        });
    };
    let weight_n = known.weight_n();
    let off_n = mass_kg * GRAVITY_M_PER_S2 - weight_n;
    let sd_n = known.force_sd_n(known.lifts_pa());
    let allowed_n = (2.0 * sd_n + FRICTION_N).max(MASS * weight_n);
    let mass_is_off = off_n.abs() > allowed_n;
    if drive_is_off && curve_known && lift.drive_ratio < 1.0 {
        return Some(Cause::MuscleLeak);
    }
    if drive_is_off {
        // A wrong scale of the pressure sensor changes the pressure at which the weight seems to
        // lift, too; a wrong amplifier does not.
        let by_sensor_n =
            (lift.drive_ratio - 1.0) * known.lifts_pa() * known.force_per_pressure_m2();
        return Some(match off_n.abs() < (off_n - by_sensor_n).abs() {
            true => Cause::AmplifierGain,
            false => Cause::PressureScale,
        });
    }
    // If the encoder has been measured, only the muscle is left, which a diagnosis explains.
    if is_off(lift.travel_ratio, TRAVEL) && !curve_known {
        return Some(Cause::Travel);
    }
    mass_is_off.then_some(match off_n > 0.0 {
        true => Cause::LoadHeavier,
        false => Cause::LoadLighter,
    })
}

//! A drawn case: its hidden effects, its records and its answer.

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde_json::{Value, json};

use super::bench::{self, Bench, Clock};
use super::drive::{self, Run, Start, Style};
use super::effects::{DRAWN, Entry, Law};
use super::record::zero;
use crate::case::{Case, Kind, by_signal, differences, generator};
use crate::hidden::{Hidden, Reading};
use crate::record::{Sensor, Sensors};
use crate::rig::Pair;

/// Kinds by the last digit of a case's number.
const ROUND: [Kind; 10] = [
    Kind::Single,
    Kind::Pair,
    Kind::None,
    Kind::Single,
    Kind::Unlisted,
    Kind::Triple,
    Kind::Single,
    Kind::None,
    Kind::Pair,
    Kind::Unlisted,
];

/// Purposes of the generators; those of the other family are below.
const EFFECTS: u64 = 101;
const SCENE: u64 = 102;
const NOISE: u64 = 103;
const EXPERIMENT: u64 = 104;
/// One for the whole seed, not for a case.
const SIZES: u64 = 105;

/// The effects of a case, determined before any simulation.
pub struct Plan {
    /// Seed of the whole benchmark.
    pub seed: u64,
    /// Number of the case.
    pub index: u64,
    /// Kind of case.
    pub kind: Kind,
    /// Effects in the order in which they act, with sizes from 0, barely visible, to 1, plain.
    pub effects: Vec<(&'static Entry, f64)>,
}

fn places(listed: bool) -> Vec<usize> {
    let all = DRAWN.iter().enumerate();
    let of_kind = all.filter(|(_, entry)| entry.listed == listed);
    of_kind.map(|(i, _)| i).collect()
}

/// The `turn`-th of a round through all entries, with evenly spread sizes.
fn in_turn(listed: bool, turn: usize, seed: u64) -> Vec<(&'static Entry, f64)> {
    let mut order = places(listed);
    // each seed goes round in an order of its own
    order.shuffle(&mut generator(seed, u64::MAX, SIZES));
    let place = order[turn % order.len()];
    let lap = turn / order.len();
    let start: f64 = generator(seed, u64::MAX - 1 - place as u64, SIZES).random();
    // the golden ratio spreads any number of laps evenly
    let size = (start + lap as f64 * 0.618_033_988_75).fract();
    vec![(&DRAWN[place], size)]
}

/// `count` listed effects, no two alike.
fn together(count: usize, rng: &mut Pcg64) -> Vec<(&'static Entry, f64)> {
    let mut order = places(true);
    order.shuffle(rng);
    order.truncate(count);
    order.sort_unstable();
    let with_size = |place: usize| (&DRAWN[place], rng.random_range(0.3..1.0));
    order.into_iter().map(with_size).collect()
}

/// The hidden effects of case `index`.
#[must_use]
pub fn plan(seed: u64, index: u64) -> Plan {
    let (lap, place) = ((index / 10) as usize, (index % 10) as usize);
    let kind = ROUND[place];
    let count = |round: &[Kind]| round.iter().filter(|other| **other == kind).count();
    let turn = lap * count(&ROUND) + count(&ROUND[..place]);
    let rng = &mut generator(seed, index, EFFECTS);
    let effects = match kind {
        Kind::Single => in_turn(true, turn, seed),
        Kind::Unlisted => in_turn(false, turn, seed),
        Kind::Pair => together(2, rng),
        Kind::Triple => together(3, rng),
        Kind::None => Vec::new(),
    };
    Plan {
        seed,
        index,
        kind,
        effects,
    }
}

/// The rig of a case with its hidden effects and sensors.
struct Scene {
    pair: Pair,
    bench: Bench,
    sensors: Sensors,
    clock: Clock,
    with_force: bool,
    start: Start,
    styles: drive::Plan,
    laws: Vec<Law>,
}

impl Scene {
    fn draw(plan: &Plan) -> Self {
        let rng = &mut generator(plan.seed, plan.index, SCENE);
        let any = |which: fn(&Entry) -> bool| plan.effects.iter().any(|(entry, _)| which(entry));
        let near_supply = any(|entry| entry.near_supply);
        let pair = bench::pair(near_supply, rng);
        let bench = Bench::of(pair.actual.clone());
        let sensors = bench::sensors(&pair.nominal, rng);
        let clock = Clock::draw(rng);
        let with_force = rng.random_bool(0.5) || any(|entry| entry.needs_force);
        // a slack muscle shows on the stop, before it pulls
        let vented = any(|entry| entry.name == "slack");
        let start = Start {
            moving: rng.random_bool(0.5) && !vented,
            vents: rng.random_bool(0.5),
            vented,
        };
        let styles = drive::Plan::draw(&clock, near_supply, rng);
        let law = |(entry, size): &(&Entry, f64)| (entry.draw)(&bench, *size, rng);
        let laws = plan.effects.iter().map(law).collect();
        Self {
            pair,
            bench,
            sensors,
            clock,
            with_force,
            start,
            styles,
            laws,
        }
    }

    fn hidden(&self) -> Vec<&dyn Hidden> {
        self.laws.iter().map(|law| law.hidden.as_ref()).collect()
    }

    /// Draws and runs a drive; one that takes the rig out of its stroke is softened until it
    /// does not.
    fn run(&self, styles: &[Style], rng: &mut Pcg64) -> (Run, Vec<Reading>) {
        let actual = &self.pair.actual;
        let hidden = self.hidden();
        let drawn = Run::draw(&self.bench, &self.clock, styles, self.start, rng);
        for softer in 0..12 {
            let mut run = drawn.clone();
            run.softened(self.bench.lift_pa, 0.85_f64.powi(softer));
            let readings = run.simulate(actual, &hidden);
            let plain = run.repeat(actual, &[]);
            let most = 0.97 * self.bench.contraction_most;
            let kept = |reading: &Reading| {
                let sum = reading.pressure_pa + reading.contraction + reading.force_n;
                sum.is_finite() && reading.contraction < most
            };
            if readings.iter().chain(&plain).all(kept) {
                return (run, readings);
            }
        }
        panic!("no drive keeps the rig within its stroke");
    }

    fn noise(&self) -> [f64; 3] {
        let sensors = &self.sensors;
        [&sensors.pressure_pa, &sensors.contraction, &sensors.force_n].map(Sensor::noise)
    }
}

/// Rows of each record of case `index` of `seed`, known without simulating it.
#[must_use]
pub fn rows(seed: u64, index: u64) -> usize {
    Scene::draw(&plan(seed, index)).clock.rows()
}

/// An additional record of case `index` of `seed` with the given test signal, as CSV. If the signal
/// may shut the shut-off valve between valve and muscle, the record has a column `valve_open`.
///
/// # Panics
/// If the drive has no sample, or leads to a state that is not physical.
#[must_use]
pub fn experiment(seed: u64, index: u64, drive: crate::Drive) -> String {
    let scene = Scene::draw(&plan(seed, index));
    let rows = 0..drive.reference_pa.len();
    let run = Run {
        times_s: rows.map(|i| i as f64 * drive.period_s).collect(),
        unrecorded: 0,
        reference_pa: drive.reference_pa,
        shut: drive.shut,
        finger: None,
    };
    let readings = run.repeat(&scene.pair.actual, &scene.hidden());
    let rng = &mut generator(seed, index, EXPERIMENT);
    let zeros = Zeros::draw(&scene.sensors, rng).of_run(&scene.sensors, rng);
    run.csv(&readings, &scene.sensors, &zeros, scene.with_force, rng)
}

/// Errors of the sensors' zeros.
struct Zeros {
    /// Readings whose mean a zero is set to.
    samples: f64,
    /// Of the one set-up.
    contraction: f64,
}

impl Zeros {
    fn draw(sensors: &Sensors, rng: &mut Pcg64) -> Self {
        let samples = rng.random_range(4..=16).into();
        Self {
            samples,
            contraction: zero(sensors.contraction.noise(), samples, rng),
        }
    }

    fn of_run(&self, sensors: &Sensors, rng: &mut Pcg64) -> Reading {
        Reading {
            pressure_pa: zero(sensors.pressure_pa.noise(), self.samples, rng),
            contraction: self.contraction,
            force_n: zero(sensors.force_n.noise(), self.samples, rng),
        }
    }
}

/// The part of the answer about one effect; `difference` is the change of the readings that it
/// causes.
fn effect_answer(scene: &Scene, plan: &Plan, i: usize, difference: [f64; 3]) -> Value {
    let (entry, size) = plan.effects[i];
    let law = &scene.laws[i];
    let noise = scene.noise();
    let ratio: [f64; 3] = std::array::from_fn(|signal| difference[signal] / noise[signal]);
    let seen = if scene.with_force {
        &ratio[..]
    } else {
        &ratio[..2]
    };
    json!({
        "name": entry.name,
        "form": law.form,
        "where": entry.place,
        "listed": entry.listed,
        "size": size,
        "law": law.words,
        "parameters": law.numbers,
        "standard": {},
        "difference": by_signal(difference, scene.with_force),
        "difference_over_noise": by_signal(ratio, scene.with_force),
        "most_over_noise": seen.iter().copied().fold(0.0, f64::max),
        "shows": seen.iter().any(|over_noise| *over_noise >= 3.0),
        // the best fit of another effect's law to this one's data is not computed yet
        "indistinguishable_from": [],
    })
}

fn answer(scene: &Scene, plan: &Plan, effects: Vec<Value>, id: &str) -> Value {
    let clock = &scene.clock;
    let rate = match clock.rate_hz {
        ..60.0 => "up to 60 Hz",
        60.0..260.0 => "60 to 260 Hz",
        _ => "above 260 Hz",
    };
    let styles = |styles: &[Vec<Style>]| json!(styles);
    json!({
        "schema": 1,
        "family": "drawn",
        "set": super::set(plan.seed),
        "id": id,
        "seed": plan.seed,
        "index": plan.index,
        "kind": plan.kind.name(),
        "force_channel": scene.with_force,
        "records": rate,
        "starts_moving": scene.start.moving,
        "rate_hz": clock.rate_hz,
        "jitter": clock.jitter,
        "duration_s": clock.duration_s,
        "drives": {
            "fit": styles(&scene.styles.fit),
            "validate": styles(&scene.styles.validate),
            "unseen": styles(std::slice::from_ref(&scene.styles.unseen)),
        },
        "effects": effects,
        "noise": by_signal(scene.noise(), scene.with_force),
        "true_rig": scene.pair.actual,
    })
}

/// Simulates case `index` of `seed`.
#[must_use]
pub fn case(seed: u64, index: u64) -> Case {
    let plan = plan(seed, index);
    let scene = Scene::draw(&plan);
    let rng = &mut generator(seed, index, SCENE + 100);
    let mut runs = |styles: &[Vec<Style>]| -> Vec<(Run, Vec<Reading>)> {
        styles.iter().map(|styles| scene.run(styles, rng)).collect()
    };
    let fit = runs(&scene.styles.fit);
    let validate = runs(&scene.styles.validate);
    let unseen = runs(std::slice::from_ref(&scene.styles.unseen));
    let hidden = scene.hidden();
    let held_out = || validate.iter().chain(&unseen);
    let with: Vec<Vec<Reading>> = held_out().map(|(_, readings)| readings.clone()).collect();
    let effect = |i: usize| {
        let mut others = hidden.clone();
        others.remove(i);
        let repeat = |(run, _): &(Run, Vec<Reading>)| run.repeat(&scene.pair.actual, &others);
        let without: Vec<Vec<Reading>> = held_out().map(repeat).collect();
        effect_answer(&scene, &plan, i, differences(&with, &without))
    };
    let effects = (0..hidden.len()).map(effect).collect();
    let noise_rng = &mut generator(seed, index, NOISE);
    let zeros = Zeros::draw(&scene.sensors, noise_rng);
    let mut texts = |runs: &[(Run, Vec<Reading>)]| -> Vec<String> {
        let text = |(run, readings): &(Run, Vec<Reading>)| {
            let zeros = zeros.of_run(&scene.sensors, noise_rng);
            run.csv(
                readings,
                &scene.sensors,
                &zeros,
                scene.with_force,
                noise_rng,
            )
        };
        runs.iter().map(text).collect()
    };
    let id = format!("d{seed}-{index:05}");
    Case {
        fit: texts(&fit),
        validate: texts(&validate),
        unseen: texts(&unseen),
        rig_toml: scene.pair.toml(),
        answer: answer(&scene, &plan, effects, &id),
        id,
    }
}

//! A case: a nominal rig, records of the true rig, and the answer, which is kept separately.

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde_json::{Map, Value, json};

use crate::drive::{Drive, FIT, Recipe, UNSEEN, VALIDATE};
use crate::effects::{CATALOGUE, Drawn, Entry, Form};
use crate::hidden::{Hidden, Reading};
use crate::record::{Run, Sensors};
use crate::rig::Pair;

/// The kind of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One listed effect.
    Single,
    /// Two listed effects.
    Pair,
    /// Three listed effects; only in the drawn family.
    Triple,
    /// No hidden effect.
    None,
    /// One effect that is in no catalogue of a diagnosis.
    Unlisted,
}

impl Kind {
    /// Its name on the command line and in the answer.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Kind::Single => "single",
            Kind::Pair => "pair",
            Kind::Triple => "triple",
            Kind::None => "none",
            Kind::Unlisted => "unlisted",
        }
    }
}

/// Kinds by the last digit of a case's number: of ten cases five single, two pairs.
const ROUND: [Kind; 10] = [
    Kind::Single,
    Kind::Pair,
    Kind::Single,
    Kind::None,
    Kind::Single,
    Kind::Unlisted,
    Kind::Single,
    Kind::Pair,
    Kind::Single,
    Kind::Unlisted,
];

/// One effect of a plan.
pub struct Planned {
    /// The effect.
    pub entry: &'static Entry,
    /// Its form.
    pub form: &'static Form,
    /// From 0, barely visible, to 1, plain.
    pub size: f64,
}

/// The effects of a case, determined before any simulation.
pub struct Plan {
    /// Seed of the whole benchmark.
    pub seed: u64,
    /// Number of the case.
    pub index: u64,
    /// Kind of case.
    pub kind: Kind,
    /// Effects in the catalogue's order.
    pub effects: Vec<Planned>,
}

/// A case as the texts of its files.
pub struct Case {
    /// Name, which does not reveal the answer.
    pub id: String,
    /// Nominal rig with tolerances.
    pub rig_toml: String,
    /// Records to fit to, as CSV.
    pub fit: Vec<String>,
    /// Records to validate on, as CSV.
    pub validate: Vec<String>,
    /// Unseen records, which a diagnosis does not get, as CSV.
    pub unseen: Vec<String>,
    /// The answer, for the scorer only.
    pub answer: Value,
}

/// A generator for one purpose of one case.
pub(crate) fn generator(seed: u64, index: u64, purpose: u64) -> Pcg64 {
    // seed_from_u64 spreads the bits; the odd multiplier keeps neighbours apart
    let case = seed.wrapping_add(index.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    Pcg64::seed_from_u64(case.rotate_left(17).wrapping_add(purpose))
}

fn entries(listed: bool) -> Vec<&'static Entry> {
    CATALOGUE
        .iter()
        .filter(|entry| entry.listed == listed)
        .collect()
}

/// The `turn`-th of a round through all entries, their forms, and evenly spread sizes.
fn in_turn(entries: &[&'static Entry], turn: usize, seed: u64) -> Planned {
    let entry = entries[turn % entries.len()];
    let lap = turn / entries.len();
    let form = &entry.forms[lap % entry.forms.len()];
    // the golden ratio spreads any number of laps evenly
    let start: f64 = generator(seed, u64::MAX, (turn % entries.len()) as u64).random();
    let size = (start + lap as f64 * 0.618_033_988_75).fract();
    Planned { entry, form, size }
}

fn pair(turn: usize, rng: &mut Pcg64) -> Vec<Planned> {
    let listed = entries(true);
    let same_place = turn % 2 == 1;
    loop {
        let first = rng.random_range(0..listed.len());
        let second = rng.random_range(0..listed.len());
        let same = listed[first].place == listed[second].place;
        if first >= second || same != same_place {
            continue;
        }
        return [first, second]
            .into_iter()
            .map(|i| {
                let entry = listed[i];
                let form = &entry.forms[rng.random_range(0..entry.forms.len())];
                Planned {
                    entry,
                    form,
                    size: rng.random_range(0.3..1.0),
                }
            })
            .collect();
    }
}

/// The hidden effects of case `index`.
#[must_use]
pub fn plan(seed: u64, index: u64) -> Plan {
    let (lap, place) = ((index / 10) as usize, (index % 10) as usize);
    let kind = ROUND[place];
    let a_lap = ROUND.iter().filter(|other| **other == kind).count();
    let before = ROUND[..place]
        .iter()
        .filter(|other| **other == kind)
        .count();
    let turn = lap * a_lap + before;
    let effects = match kind {
        Kind::Single => vec![in_turn(&entries(true), turn, seed)],
        Kind::Unlisted => vec![in_turn(&entries(false), turn, seed)],
        Kind::Pair => pair(turn, &mut generator(seed, index, 1)),
        Kind::None | Kind::Triple => Vec::new(),
    };
    Plan {
        seed,
        index,
        kind,
        effects,
    }
}

/// Length, clock and beginning of a case's records.
struct Variant {
    name: &'static str,
    duration_s: f64,
    period_s: f64,
    moving: bool,
}

fn variant(rng: &mut Pcg64) -> Variant {
    let (name, duration_s, period_s) = match rng.random_range(0..20) {
        0..=1 => ("short", 25.0, 0.01),
        2 => ("long", 60.0, 0.01),
        3 => ("fast-clock", 40.0, 0.005),
        _ => ("usual", 40.0, 0.01),
    };
    Variant {
        name,
        duration_s,
        period_s,
        moving: rng.random_bool(0.2),
    }
}

impl Variant {
    fn run(&self, recipe: Recipe, rng: &mut Pcg64) -> Run {
        let unrecorded_s = if self.moving {
            rng.random_range(2.0..6.0)
        } else {
            0.0
        };
        let unrecorded = (unrecorded_s / self.period_s) as usize;
        let whole_s = self.duration_s + unrecorded as f64 * self.period_s;
        Run {
            drive: Drive::draw(recipe, whole_s, self.period_s, rng),
            unrecorded,
        }
    }
}

/// Root mean square differences of three signals over all readings.
pub(crate) fn differences(one: &[Vec<Reading>], other: &[Vec<Reading>]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    let mut count = 0.0;
    for (a, b) in one.iter().flatten().zip(other.iter().flatten()) {
        sums[0] += (a.pressure_pa - b.pressure_pa).powi(2);
        sums[1] += (a.contraction - b.contraction).powi(2);
        sums[2] += (a.force_n - b.force_n).powi(2);
        count += 1.0;
    }
    sums.map(|sum: f64| (sum / count).sqrt())
}

pub(crate) fn by_signal(values: [f64; 3], with_force: bool) -> Value {
    let mut map = Map::new();
    for (name, value) in ["pressure_pa", "contraction", "force_n"]
        .into_iter()
        .zip(values)
    {
        if name != "force_n" || with_force {
            map.insert(name.into(), json!(value));
        }
    }
    Value::Object(map)
}

/// The part of the answer about one effect; `difference` is the change of the readings that it
/// causes.
fn effect_answer(
    planned: &Planned,
    drawn: &Drawn,
    difference: [f64; 3],
    noise: [f64; 3],
    with_force: bool,
) -> Value {
    let mut ratio = [0.0; 3];
    for i in 0..3 {
        ratio[i] = difference[i] / noise[i];
    }
    let seen = if with_force { &ratio[..] } else { &ratio[..2] };
    let most = seen.iter().copied().fold(0.0, f64::max);
    let standard: Map<String, Value> = planned
        .form
        .standard
        .iter()
        .map(|name| ((*name).to_owned(), drawn.parameters[*name].clone()))
        .collect();
    json!({
        "name": planned.entry.name,
        "form": planned.form.name,
        "where": planned.entry.place,
        "listed": planned.entry.listed,
        "size": planned.size,
        "parameters": drawn.parameters,
        "standard": standard,
        "difference": by_signal(difference, with_force),
        "difference_over_noise": by_signal(ratio, with_force),
        "most_over_noise": most,
    })
}

/// The rig of a case with its hidden effects.
struct Scene {
    pair: Pair,
    variant: Variant,
    with_force: bool,
    drawn: Vec<Drawn>,
}

impl Scene {
    fn draw(plan: &Plan, rng: &mut Pcg64) -> Self {
        let pair = Pair::draw(rng);
        let variant = variant(rng);
        let with_force = rng.random_bool(0.5);
        let draw = |planned: &Planned| (planned.form.draw)(planned.size, &pair.actual, rng);
        let drawn = plan.effects.iter().map(draw).collect();
        Self {
            pair,
            variant,
            with_force,
            drawn,
        }
    }

    fn hidden(&self) -> Vec<&dyn Hidden> {
        let drawn = self.drawn.iter();
        drawn.map(|drawn| drawn.hidden.as_ref()).collect()
    }
}

/// Rows of each record of case `index` of `seed`, known without simulating it.
#[must_use]
pub fn rows(seed: u64, index: u64) -> usize {
    let scene = Scene::draw(&plan(seed, index), &mut generator(seed, index, 2));
    Drive::samples(scene.variant.duration_s, scene.variant.period_s)
}

/// An additional record of case `index` of `seed` with the given test signal, as CSV. If the signal
/// may shut the shut-off valve between valve and muscle, the record has a column `valve_open`.
///
/// # Panics
/// If the drive has no sample, or leads to a state that is not physical.
#[must_use]
pub fn experiment(seed: u64, index: u64, drive: Drive) -> String {
    let scene = Scene::draw(&plan(seed, index), &mut generator(seed, index, 2));
    let unrecorded = 0;
    let run = Run { drive, unrecorded };
    let readings = run.simulate(&scene.pair.actual, &scene.hidden());
    let noise_rng = &mut generator(seed, index, 4);
    run.csv(&readings, &Sensors::default(), scene.with_force, noise_rng)
}

/// Simulates case `index` of `seed`.
#[must_use]
pub fn case(seed: u64, index: u64) -> Case {
    let plan = plan(seed, index);
    let rng = &mut generator(seed, index, 2);
    let scene = Scene::draw(&plan, rng);
    let Scene {
        ref pair,
        ref variant,
        with_force,
        ref drawn,
    } = scene;
    let sensors = Sensors::default();
    let hidden = scene.hidden();
    let mut runs = |recipes: &[Recipe]| -> Vec<Run> {
        recipes
            .iter()
            .map(|recipe| variant.run(recipe, rng))
            .collect()
    };
    let (fit, validate, unseen) = (runs(&FIT), runs(&VALIDATE), runs(&UNSEEN));
    let simulate = |runs: &[Run], hidden: &[&dyn Hidden]| -> Vec<Vec<Reading>> {
        runs.iter()
            .map(|run| run.simulate(&pair.actual, hidden))
            .collect()
    };
    let validated = simulate(&validate, &hidden);
    let noise = [&sensors.pressure_pa, &sensors.contraction, &sensors.force_n].map(|s| s.noise());
    let effects: Vec<Value> = (0..hidden.len())
        .map(|i| {
            let mut others = hidden.clone();
            others.remove(i);
            let difference = differences(&validated, &simulate(&validate, &others));
            effect_answer(&plan.effects[i], &drawn[i], difference, noise, with_force)
        })
        .collect();
    let noise_rng = &mut generator(seed, index, 3);
    let mut texts = |runs: &[Run], readings: &[Vec<Reading>]| -> Vec<String> {
        let both = runs.iter().zip(readings);
        both.map(|(run, readings)| run.csv(readings, &sensors, with_force, noise_rng))
            .collect()
    };
    let id = format!("s{seed}-{index:05}");
    Case {
        fit: texts(&fit, &simulate(&fit, &hidden)),
        validate: texts(&validate, &validated),
        unseen: texts(&unseen, &simulate(&unseen, &hidden)),
        rig_toml: pair.toml(),
        answer: json!({
            "schema": 1,
            "family": "catalogue-like",
            "id": id,
            "seed": seed,
            "index": index,
            "kind": plan.kind.name(),
            "force_channel": with_force,
            "records": variant.name,
            "starts_moving": variant.moving,
            "effects": effects,
            "noise": by_signal(noise, with_force),
            "true_rig": pair.actual,
        }),
        id,
    }
}

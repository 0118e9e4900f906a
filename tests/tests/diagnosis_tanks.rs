//! The engine of the diagnosis is general: here it diagnoses two cascaded tanks.
//!
//! Water is pumped into the upper tank, runs into the lower one and out of it:
//! h1' = −k1 √h1 + k2 u, h2' = k1 √h1 − k3 √h2. Both levels are measured with noise. The truth is
//! simulated as a whole with short steps, the model block by block with the records' steps.

use model_discrepancy::engine::{Active, Candidate, Coordinate, Engine, Model, Parameter};
use model_discrepancy::least_squares::Residuals;
use model_discrepancy::verdict::{Costs, Selection, Verdict, select};
use rand_distr::{Distribution, Normal, Uniform};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;

/// Outflow of the upper tank \[√m/s\], inflow over voltage \[m/(s·V)\], outflow of the lower one.
const NOMINAL: [f64; 3] = [0.05, 0.006, 0.055];
/// Relative standard deviation of each.
const TOLERANCE: f64 = 0.03;
/// The true ones, in standard deviations.
const TRUE: [f64; 3] = [0.8, -1.2, 0.5];
const NOISE_M: f64 = 0.002;
const PERIOD_S: f64 = 1.0;
const ROWS: usize = 400;
/// The voltage changes every so many rows: about the time constant of a tank.
const HELD_ROWS: usize = 25;
/// Steps of the truth in one row.
const FINE: usize = 20;
const RECORDS: usize = 4;
const FITTED: usize = 2;

const UPPER: usize = 0;
const LOWER: usize = 1;
const BLOCKS: [&str; 2] = ["upper", "lower"];

/// What may be wrong with the tanks; nothing by default.
#[derive(Clone, Copy)]
struct Tanks {
    k: [f64; 3],
    leak_per_s: f64,
    overflow_m: f64,
    offset_m: f64,
    saturation_v: f64,
    /// Amplitude of an inflow to the lower tank that comes and goes \[m/s\]; in no catalogue.
    swell_m_per_s: f64,
}

const SWELL_PERIOD_S: f64 = 15.0;

impl Tanks {
    fn new(deviations: &[f64]) -> Tanks {
        Tanks {
            k: [0, 1, 2].map(|i| NOMINAL[i] * (1.0 + TOLERANCE * deviations[i])),
            leak_per_s: 0.0,
            overflow_m: f64::INFINITY,
            offset_m: 0.0,
            saturation_v: f64::INFINITY,
            swell_m_per_s: 0.0,
        }
    }

    /// With an effect of the catalogue of this size.
    fn with(mut self, effect: &str, size: f64) -> Tanks {
        match effect {
            "leak" => self.leak_per_s = size,
            "overflow" => self.overflow_m = size,
            "sensor-offset" => self.offset_m = size,
            "valve-saturation" => self.saturation_v = size,
            _ => unreachable!("{effect} is not in the catalogue"),
        }
        self
    }

    fn upper(&self, h1_m: f64, voltage_v: f64) -> f64 {
        self.k[1] * voltage_v.min(self.saturation_v) - self.k[0] * h1_m.max(0.0).sqrt()
    }

    fn lower(&self, h1_m: f64, h2_m: f64) -> f64 {
        self.k[0] * h1_m.max(0.0).sqrt() - self.k[2] * h2_m.max(0.0).sqrt() - self.leak_per_s * h2_m
    }
}

/// One step of the classical Runge–Kutta method; `rate` is told the share of the step.
fn rk4<const N: usize>(
    state: [f64; N],
    step_s: f64,
    rate: impl Fn(f64, [f64; N]) -> [f64; N],
) -> [f64; N] {
    let moved = |by_s: f64, slope: [f64; N]| std::array::from_fn(|i| state[i] + by_s * slope[i]);
    let a = rate(0.0, state);
    let b = rate(0.5, moved(0.5 * step_s, a));
    let c = rate(0.5, moved(0.5 * step_s, b));
    let d = rate(1.0, moved(step_s, c));
    moved(
        step_s / 6.0,
        std::array::from_fn(|i| a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]),
    )
}

/// A run from empty tanks: the voltage, held from row to row, and the measured levels.
struct Run {
    voltage_v: Vec<f64>,
    h1_m: Vec<f64>,
    h2_m: Vec<f64>,
}

fn run(tanks: &Tanks, rng: &mut Pcg64) -> Run {
    let voltages = Uniform::new(2.0, 8.0).expect("a range");
    let noise = Normal::new(0.0, NOISE_M).expect("a spread");
    let mut run = Run {
        voltage_v: Vec::new(),
        h1_m: Vec::new(),
        h2_m: Vec::new(),
    };
    let (mut state, mut voltage_v) = ([0.0; 2], 0.0);
    let step_s = PERIOD_S / FINE as f64;
    for row in 0..ROWS {
        if row % HELD_ROWS == 0 {
            voltage_v = voltages.sample(rng);
        }
        run.voltage_v.push(voltage_v);
        run.h1_m.push(state[0] + noise.sample(rng));
        run.h2_m.push(state[1] + tanks.offset_m + noise.sample(rng));
        for fine in 0..FINE {
            let begin_s = row as f64 * PERIOD_S + fine as f64 * step_s;
            state = rk4(state, step_s, |share, [h1_m, h2_m]| {
                let phase = (begin_s + share * step_s) / SWELL_PERIOD_S;
                let swell = tanks.swell_m_per_s * (std::f64::consts::TAU * phase).sin();
                [
                    tanks.upper(h1_m, voltage_v),
                    tanks.lower(h1_m, h2_m) + swell,
                ]
            });
            state[0] = state[0].min(tanks.overflow_m);
        }
    }
    run
}

struct TankModel {
    runs: Vec<Run>,
    nominal_blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
}

fn catalogue() -> Vec<Candidate> {
    let candidate = |effect, block: usize, unit, range, usual, log| Candidate {
        effect,
        form: "only",
        parameters: vec![Parameter {
            name: "size",
            unit,
            range,
            usual,
            log,
            neutral: (!log).then_some(0.0),
            // A sensor that hangs lower would be wet.
            ends: [effect == "sensor-offset", false],
        }],
        blocks: vec![block],
        form_doubt: if effect == "sensor-offset" { 0.0 } else { 0.05 },
    };
    vec![
        candidate("leak", LOWER, "1/s", (1e-4, 0.1), 0.005, true),
        candidate("overflow", UPPER, "m", (0.05, 2.0), 0.5, true),
        candidate("sensor-offset", LOWER, "m", (-0.2, 0.2), 0.05, false),
        candidate("valve-saturation", UPPER, "V", (1.0, 20.0), 6.0, true),
    ]
}

impl TankModel {
    /// Runs of `tanks`, to be diagnosed with all effects but `without`.
    fn new(tanks: &Tanks, seed: u64, without: &[&str]) -> TankModel {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut candidates = catalogue();
        candidates.retain(|candidate| !without.contains(&candidate.effect));
        TankModel {
            runs: (0..RECORDS).map(|_| run(tanks, &mut rng)).collect(),
            nominal_blocks: vec![vec![UPPER, LOWER], vec![UPPER], vec![LOWER]],
            candidates,
        }
    }
}

impl Model for TankModel {
    fn records(&self) -> usize {
        RECORDS
    }

    fn fitted(&self) -> usize {
        FITTED
    }

    fn blocks(&self) -> &[&'static str] {
        &BLOCKS
    }

    fn nominal_blocks(&self) -> &[Vec<usize>] {
        &self.nominal_blocks
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn residuals(
        &self,
        record: usize,
        block: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        let mut tanks = Tanks::new(nominal);
        for (candidate, values) in effects {
            tanks = tanks.with(self.candidates[*candidate].effect, values[0]);
        }
        let run = &self.runs[record];
        let mut level = [0.0];
        let mut residuals = Vec::with_capacity(ROWS);
        for row in 0..ROWS {
            let (measured_m, reading_m) = match block {
                UPPER => (run.h1_m[row], level[0]),
                _ => (run.h2_m[row], level[0] + tanks.offset_m),
            };
            residuals.push((measured_m - reading_m) / NOISE_M);
            let h1_m = [run.h1_m[row], run.h1_m[(row + 1).min(ROWS - 1)]];
            level = rk4(level, PERIOD_S, |share, [level_m]| match block {
                UPPER => [tanks.upper(level_m, run.voltage_v[row])],
                _ => [tanks.lower(h1_m[0] + share * (h1_m[1] - h1_m[0]), level_m)],
            });
            if block == UPPER {
                level[0] = level[0].min(tanks.overflow_m);
            }
        }
        Some(Residuals::exact(residuals))
    }

    fn rows(&self, _: usize, _: usize) -> usize {
        ROWS
    }

    fn proportional(&self, block: usize) -> bool {
        // Both effects of the upper tank begin at a threshold.
        block == LOWER
    }

    fn context(&self, record: usize, _: usize) -> Vec<Coordinate> {
        vec![Coordinate {
            name: "voltage",
            unit: "V",
            values: self.runs[record].voltage_v.clone(),
        }]
    }
}

fn names(model: &TankModel, selection: &Selection) -> Vec<&'static str> {
    let named = selection.named.candidates.iter();
    named.map(|c| model.candidates[*c].effect).collect()
}

fn selected(engine: &Engine<TankModel>) -> Selection {
    select(engine, Costs::default(), &|_| ()).expect("a model with a solution")
}

fn chosen(model: &TankModel) -> Selection {
    selected(&Engine::new(model))
}

/// Sizes that show: 6 to 30 times the noise, or a limit that is met.
const HIDDEN: [(&str, f64); 4] = [
    ("leak", 0.003),
    ("overflow", 0.45),
    ("sensor-offset", -0.03),
    ("valve-saturation", 6.2),
];
const SEEDS: u64 = 3;

#[test]
fn healthy_tanks_are_consistent() {
    for seed in 0..SEEDS {
        let model = TankModel::new(&Tanks::new(&TRUE), seed, &[]);
        let choice = chosen(&model);
        assert_eq!(choice.verdict, Verdict::Consistent, "seed {seed}");
        // Their values are off within the tolerance: that is calibrated, not named.
        for (found, known) in choice.null.fit.nominal.iter().zip(TRUE) {
            assert!((found - known).abs() < 0.3, "seed {seed}: {found}, {known}");
        }
    }
}

#[test]
fn a_hidden_effect_is_named_with_its_size() {
    let mut inside = 0;
    for (effect, size) in HIDDEN {
        for seed in 0..SEEDS {
            let tanks = Tanks::new(&TRUE).with(effect, size);
            let model = TankModel::new(&tanks, seed, &[]);
            let engine = Engine::new(&model);
            let choice = selected(&engine);
            let found = (choice.verdict, names(&model, &choice));
            let expected = (Verdict::Explained, vec![effect]);
            assert_eq!(found, expected, "seed {seed}: {:?}", choice.posterior);
            let others = &choice.alternatives[0];
            assert!(others.is_empty(), "{effect}, seed {seed}: {others:?}");
            let [low, high] = engine.intervals(&choice.named).expect("intervals")[0][0];
            let value = choice.named.fit.effects[0].1[0];
            assert!(
                (value - size).abs() < 0.1 * size.abs() && high - low < 0.3 * size.abs(),
                "{effect}, seed {seed}: {value} in {low} to {high}, hidden {size}"
            );
            inside += usize::from((low..=high).contains(&size));
        }
    }
    // Of 12 intervals of 95 %, fewer than 10 hold with a probability below 2 %.
    assert!(inside >= 10, "{inside} of 12");
}

fn assert_named(pair: [(&str, f64); 2]) {
    let tanks = pair
        .iter()
        .fold(Tanks::new(&TRUE), |tanks, (effect, size)| {
            tanks.with(effect, *size)
        });
    let model = TankModel::new(&tanks, 7, &[]);
    let selection = chosen(&model);
    let found = names(&model, &selection).join(", ");
    let expected = catalogue_order(&pair.map(|(effect, _)| effect));
    assert_eq!(found, expected, "{:?}", selection.posterior);
}

#[test]
fn two_hidden_effects_are_both_named() {
    let [_, overflow, offset, saturation] = HIDDEN;
    assert_named([offset, saturation]);
    assert_named([overflow, offset]);
    assert_named([("leak", 0.006), overflow]);
}

#[test]
fn a_small_effect_beside_a_large_one_is_named() {
    let [leak, overflow, ..] = HIDDEN;
    assert_named([leak, overflow]);
}

#[test]
fn what_is_there_promises_nothing_and_the_rest_is_found_without_it() {
    let [_, overflow, offset, _] = HIDDEN;
    let tanks = Tanks::new(&TRUE).with(overflow.0, overflow.1);
    let model = TankModel::new(&tanks.with(offset.0, offset.1), 7, &[]);
    let engine = Engine::new(&model);
    let effects = catalogue();
    let place = |name| effects.iter().position(|c| c.effect == name).expect(name);
    let own = [place(overflow.0), place(offset.0)];
    let alone = |place: usize| engine.hypothesis(&[own[place]]).expect("a fit");
    let promises = engine.promises(&alone(0)).expect("promises");
    assert_eq!(promises[own[0]], 0.0);
    assert!(promises[own[1]] > 1000.0, "{promises:?}");
    // Each alone is where it was, there being one valley.
    let reduced = engine.reduced(&engine.hypothesis(&own).expect("a fit"));
    assert_eq!(reduced.len(), 2);
    for (place, found) in [1, 0].into_iter().zip(&reduced) {
        assert_eq!(found.candidates, [own[place]]);
        let (found, known) = (found.fit.score(), alone(place).fit.score());
        assert!(
            (found - known).abs() < 1e-3 * known + 1.0,
            "{found}, {known}"
        );
    }
}

fn catalogue_order(names: &[&str]) -> String {
    let all = catalogue().into_iter().map(|candidate| candidate.effect);
    let ours: Vec<_> = all.filter(|effect| names.contains(effect)).collect();
    ours.join(", ")
}

#[test]
fn an_effect_that_the_catalogue_lacks_is_left_unexplained() {
    let mut tanks = Tanks::new(&TRUE);
    tanks.swell_m_per_s = 0.005;
    for seed in 0..SEEDS {
        let model = TankModel::new(&tanks, seed, &[]);
        let choice = chosen(&model);
        assert_eq!(choice.verdict, Verdict::Unexplained, "seed {seed}");
        assert_eq!(names(&model, &choice), [""; 0], "seed {seed}");
        assert_eq!(choice.left, [LOWER], "seed {seed}");
    }
}

/// A value off by twelve tolerances: it can be calibrated, but that is no rig within them.
#[test]
fn a_value_far_outside_its_tolerance_is_left_unexplained() {
    for seed in 0..SEEDS {
        let deviations = [TRUE[0], -12.0, TRUE[2]];
        let model = TankModel::new(&Tanks::new(&deviations), seed, &[]);
        let choice = chosen(&model);
        let found = (choice.verdict, names(&model, &choice));
        assert_eq!(found, (Verdict::Unexplained, vec![]), "seed {seed}");
        assert_eq!(choice.left, [UPPER], "seed {seed}");
    }
}

#[test]
fn an_effect_taken_out_of_the_catalogue_is_not_named_as_another() {
    // Without `leak`, an offset takes up most of it: at a low level both act alike.
    for (effect, size) in &HIDDEN[1..] {
        let tanks = Tanks::new(&TRUE).with(effect, *size);
        let model = TankModel::new(&tanks, 1, &[effect]);
        let choice = chosen(&model);
        let found = names(&model, &choice);
        assert_eq!(
            choice.verdict,
            Verdict::Unexplained,
            "{effect} as {found:?}"
        );
    }
}

#[test]
fn what_is_left_beside_a_named_effect_is_said() {
    let (effect, size) = HIDDEN[3];
    let mut tanks = Tanks::new(&TRUE).with(effect, size);
    // The saturation explains nearly all of what is above the noise, and nothing of the swell.
    tanks.swell_m_per_s = 0.004;
    let model = TankModel::new(&tanks, 1, &[]);
    let choice = chosen(&model);
    assert_eq!(choice.verdict, Verdict::Partial, "{:?}", choice.posterior);
    assert_eq!(names(&model, &choice), [effect]);
    assert_eq!(choice.left, [LOWER]);
}

#[test]
fn an_estimate_where_its_effect_ends_is_not_named() {
    let named = (Verdict::Explained, &["sensor-offset"][..]);
    let refused = (Verdict::Unexplained, &[][..]);
    // At −0.2 m it ends; 0.2 m is the largest that the catalogue knows.
    for (size, expected) in [
        (-0.19, named),
        (-0.2, refused),
        (0.19, named),
        (0.2, refused),
    ] {
        let tanks = Tanks::new(&TRUE).with("sensor-offset", size);
        let model = TankModel::new(&tanks, 1, &[]);
        let choice = chosen(&model);
        let found = names(&model, &choice);
        assert_eq!((choice.verdict, &found[..]), expected, "{size} m");
    }
}

/// The costs of wrong answers decide how probable a name must be: dear enough, none is.
#[test]
fn a_name_costs_what_it_is_said_to() {
    let (effect, size) = HIDDEN[0];
    let model = TankModel::new(&Tanks::new(&TRUE).with(effect, 0.3 * size), 1, &[]);
    let engine = Engine::new(&model);
    let named = |wrong_name: f64| {
        let costs = Costs {
            wrong_name,
            missing_name: 1.0,
        };
        let selection = select(&engine, costs, &|_| ()).expect("a model with a solution");
        let sum: f64 = selection.posterior.iter().map(|set| set.probability).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        names(&model, &selection)
    };
    assert_eq!(named(1.0), [effect]);
    assert_eq!(named(1e300), [""; 0]);
}

//! Published identification benchmarks with their official split: the estimation record is all that
//! the estimator sees, the test records only measure the result.
//!
//! The plants are those of `tests/plants`, which use the packaged estimator alone.

use crate::plants::signal::{at, rate, rms, slid};
use crate::plants::{Law, Plant, Present, axis, formula, oscillator, tanks};
use crate::{Outcome, range, set_of};
use hil_sim::report::{Axis, Plot, Role, Series};
use model_discrepancy::engine::{Engine, Fit, Hypothesis};
use model_discrepancy::verdict::{Costs, Selection, select};
use std::path::Path;
use std::time::Instant;

/// One figure of a benchmark.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Figure {
    /// The benchmark, and what is measured on its test record.
    pub measure: &'static str,
    /// The method.
    pub method: String,
    /// Its figure.
    pub value: f64,
    /// The unit.
    pub unit: &'static str,
    /// Whether it is computed here, and not as published.
    pub computed: bool,
}

/// Figures of others, by a measure: method, value; and whether they are computed here.
const TANKS: &str = "cascaded tanks: RMSE of the simulated level";
const TANKS_PUBLISHED: [(&str, f64); 7] = [
    ("linear", 0.75),
    ("Volterra series", 0.54),
    ("state space with Gaussian process", 0.45),
    ("gated recurrent unit", 0.396),
    ("nonlinear least squares, state space (NLSS2)", 0.34),
    ("neural state space", 0.33),
    ("grey box with overflow (Rogers 2017)", 0.18),
];
const FORCE: &str = "EMPS: residual of the force, at 100 Hz";
const POSITION: &str = "EMPS: RMSE of the simulated position";
const POSITION_PUBLISHED: [(&str, f64); 3] = [
    ("recurrent network, worst", 220.0),
    ("recurrent network, best", 74.0),
    ("dynoNet", 2.64),
];
const MULTISINE: &str = "Bouc–Wen: RMSE on the multisine";
const MULTISINE_PUBLISHED: [(&str, f64); 3] = [
    ("nonlinear FIR", 16.3),
    ("dynoNet", 4.52),
    ("polynomial nonlinear state space", 1.87),
];
const SWEEP: &str = "Bouc–Wen: RMSE on the sine sweep";
/// M \[kg\], Fv \[N·s/m\], Fc and F0 \[N\] as published for the axis (Janot et al. 2019).
const AXIS_PUBLISHED: [f64; 4] = [95.11, 203.5, 20.39, -3.16];
/// Pass band of the axis' measures \[Hz\], and rows at either end that are left out.
const BAND_HZ: f64 = 100.0;
const EDGE: usize = 100;
/// Steps of the axis' simulation in a sample.
const STEPS: usize = 10;

fn published(measure: &'static str, unit: &'static str, figures: &[(&str, f64)]) -> Vec<Figure> {
    let figure = |(method, value): &(&str, f64)| Figure {
        measure,
        method: (*method).into(),
        value: *value,
        unit,
        computed: false,
    };
    figures.iter().map(figure).collect()
}

fn computed(measure: &'static str, unit: &'static str, method: &str, value: f64) -> Figure {
    Figure {
        measure,
        method: method.into(),
        value,
        unit,
        computed: true,
    }
}

/// The names of what was found, for the table.
fn named(outcome: &Outcome) -> String {
    let names: Vec<&str> = outcome.effects.iter().map(|own| &own.name[..]).collect();
    if names.is_empty() {
        "this method, which names nothing".into()
    } else {
        format!("this method: {}", names.join(", "))
    }
}

fn selected<L: Law>(plant: &Plant<L>) -> Option<(Selection, f64)> {
    let begin = Instant::now();
    let selection = select(&Engine::new(plant), Costs::default(), &|_| ())?;
    Some((selection, begin.elapsed().as_secs_f64()))
}

/// The most probable set of effects and terms of a formula.
fn by_formula<L: Law>(plant: &Plant<L>) -> Option<(String, Hypothesis)> {
    let engine = Engine::new(plant);
    let selection = select(&engine, Costs::default(), &|_| ())?;
    let found = selection.most_probable(&engine)?;
    let names = found.candidates.iter();
    let names: Vec<&str> = names.map(|own| plant.candidates[*own].effect).collect();
    let method = format!("this method, by a formula: {}", names.join(", "));
    Some((method, found))
}

/// Both tanks: named by predictions over 16 s, then fitted as simulated.
fn tanks_of(folder: &Path) -> Option<(Outcome, Vec<Figure>)> {
    let read = |name: &str, simulated| tanks::Tanks::read(&folder.join(name), simulated);
    let plant = Plant::new(vec![read("est.csv", false)?], 1);
    let (selection, spent_s) = selected(&plant)?;
    let simulated = Plant::new(vec![read("est.csv", true)?], 1);
    let engine = Engine::new(&simulated);
    let test = read("val.csv", true)?;
    let error = |engine: &Engine<Plant<tanks::Tanks>>, hypothesis: &Hypothesis| {
        let fit = engine.polished(hypothesis)?.fit;
        let effects = Present::new(&engine.model.candidates, &fit.effects);
        let run = test.run(&fit.nominal, &effects);
        let pairs = run.iter().zip(&test.level_v);
        Some(rms(pairs.map(|(is, was)| is.min(tanks::MOST_V) - was)))
    };
    let mut outcome = Outcome {
        set: "cascaded tanks".into(),
        fitted: vec!["est".into()],
        held_out: vec!["val".into()],
        signal: "lower_tank_level_volt",
        unit: "V",
        range: range(test.level_v.iter().copied()),
        calibrated: error(&engine, &selection.null)?,
        after: error(&engine, &selection.named)?,
        noise: 0.02,
        next_experiment: "Fill the upper tank until it runs over, with its level measured.".into(),
        spent_s,
        ..Outcome::default()
    };
    outcome.selected(&plant, &selection, &[]);
    let mut figures = published(TANKS, "V", &TANKS_PUBLISHED);
    figures.push(computed(TANKS, "V", "Torricelli", outcome.calibrated));
    figures.push(computed(TANKS, "V", &named(&outcome), outcome.after));
    let unnamed = |plant: Plant<_>| plant.with_formulas(&["outflow-law"], formula::outflows());
    if let Some((method, found)) = by_formula(&unnamed(plant)) {
        let left = error(&Engine::new(&unnamed(simulated)), &found)?;
        figures.push(computed(TANKS, "V", &method, left));
    }
    Some((outcome, figures))
}

/// A second-order low pass at a share of the sampling frequency, forth and back.
fn low_pass(values: &[f64], share: f64, quality: f64) -> Vec<f64> {
    let k = (std::f64::consts::PI * share).tan();
    let norm = 1.0 / (1.0 + k / quality + k * k);
    let (b, a1) = (k * k * norm, 2.0 * (k * k - 1.0) * norm);
    let a2 = (1.0 - k / quality + k * k) * norm;
    let pass = |values: Vec<f64>| {
        let (mut x, mut y) = ([values[0]; 2], [values[0]; 2]);
        let mut step = |value: f64| {
            let out = b * (value + 2.0 * x[0] + x[1]) - a1 * y[0] - a2 * y[1];
            (x, y) = ([value, x[0]], [out, y[0]]);
            out
        };
        let mut passed: Vec<f64> = values.into_iter().map(&mut step).collect();
        passed.reverse();
        passed
    };
    pass(pass(values.to_vec()))
}

/// Residual of the force over a record as a share of its RMS, with the motion by a Butterworth
/// filter of fourth order forth and back, and the force as it was recorded.
fn force_share(record: &axis::Axis, nominal: &[f64], effects: &Present) -> f64 {
    let share = BAND_HZ * axis::SAMPLE_S;
    // The qualities of a Butterworth filter of fourth order.
    let half = low_pass(&record.position_m, share, 0.541_196_1);
    let smooth_m = low_pass(&half, share, 1.306_563);
    let speed = rate(&smooth_m, axis::SAMPLE_S);
    let acceleration = rate(&speed, axis::SAMPLE_S);
    let delay = effects.size("delay") / axis::SAMPLE_S;
    let distance_m = effects.value("low-speed-friction", 3);
    let rows = EDGE..record.force_n.len() - EDGE;
    let missed = rows.clone().scan(0.0, |share, row| {
        *share = slid(*share, speed[row] * axis::SAMPLE_S, distance_m);
        let resistance = axis::resistance(nominal, effects, (smooth_m[row], speed[row]), *share);
        let force = at(&record.force_n, row as f64 - delay);
        Some(axis::values(nominal)[0] * acceleration[row] + resistance - force)
    });
    rms(missed) / rms(rows.map(|row| record.force_n[row]))
}

/// Position over a record in open loop \[m\].
fn position_m(record: &axis::Axis, nominal: &[f64], effects: &Present) -> Vec<f64> {
    let mass = axis::values(nominal)[0];
    // A held sample is late by half of one already.
    let late = (effects.size("delay") / axis::SAMPLE_S - 0.5).max(0.0);
    let step_s = axis::SAMPLE_S / STEPS as f64;
    let mut x = record.position_m[0];
    let mut v = (record.position_m[1] - x) / axis::SAMPLE_S;
    let distance_m = effects.value("low-speed-friction", 3);
    let mut share = 0.0;
    let mut run = Vec::with_capacity(record.force_n.len());
    for row in 0..record.force_n.len() {
        run.push(x);
        for step in 0..STEPS {
            let place = row as f64 + step as f64 / STEPS as f64 - late;
            let force = record.force_n[place.max(0.0) as usize];
            let way = if v == 0.0 { force.signum() } else { v.signum() };
            let along = if v == 0.0 { way * f64::MIN_POSITIVE } else { v };
            share = slid(share, step_s * along, distance_m);
            let net = force - axis::resistance(nominal, effects, (x, along), share);
            let next = v + step_s * net / mass;
            // It stops, or stays at rest, where friction is larger than the force.
            v = if next * way <= 0.0 { 0.0 } else { next };
            x += step_s * v;
        }
    }
    run
}

fn axis_of(folder: &Path) -> Option<(Outcome, Vec<Figure>)> {
    let plant = Plant::new(vec![axis::Axis::read(&folder.join("est.csv"))?], 1);
    let (selection, spent_s) = selected(&plant)?;
    let test = axis::Axis::read(&folder.join("test.csv"))?;
    // In standard deviations, as the nominal values of a fit are.
    let origin = axis::values(&[0.0; 4]);
    let unit = axis::values(&[1.0; 4]);
    let deviation = |i: usize| (AXIS_PUBLISHED[i] - origin[i]) / (unit[i] - origin[i]);
    let known: Vec<f64> = (0..4).map(deviation).collect();
    let both = |nominal: &[f64], effects: &Present| {
        let run = position_m(&test, nominal, effects);
        let missed = run.iter().zip(&test.position_m).map(|(is, was)| is - was);
        (
            100.0 * force_share(&test, nominal, effects),
            1e3 * rms(missed),
        )
    };
    let of = |plant: &Plant<_>, fit: &Fit| {
        both(&fit.nominal, &Present::new(&plant.candidates, &fit.effects))
    };
    let (before, after) = (
        of(&plant, &selection.null.fit),
        of(&plant, &selection.named.fit),
    );
    let by_four = both(&known, &Present::new(&plant.candidates, &[]));
    let force_n = rms(test.force_n.iter().copied());
    let mut outcome = Outcome {
        set: "EMPS".into(),
        fitted: vec!["est".into()],
        held_out: vec!["test".into()],
        signal: "force_n",
        unit: "N",
        range: range(test.force_n.iter().copied()),
        calibrated: 0.01 * before.0 * force_n,
        after: 0.01 * after.0 * force_n,
        noise: axis::NOISE_N,
        next_experiment: "Move at constant speeds, of which each is driven both ways.".into(),
        spent_s,
        ..Outcome::default()
    };
    outcome.selected(
        &plant,
        &selection,
        &[("delay", "half a sample of the hold: 0.5 ms")],
    );
    let method = named(&outcome);
    let mut figures = vec![
        computed(FORCE, "%", "the four published parameters", by_four.0),
        computed(FORCE, "%", "nominal model, fitted", before.0),
        computed(FORCE, "%", &method, after.0),
    ];
    figures.extend(published(POSITION, "mm", &POSITION_PUBLISHED));
    figures.push(computed(
        POSITION,
        "mm",
        "the four published parameters",
        by_four.1,
    ));
    figures.push(computed(POSITION, "mm", "nominal model, fitted", before.1));
    figures.push(computed(POSITION, "mm", &method, after.1));
    let unnamed = ["asymmetric-friction", "drag", "friction-along-screw"];
    let plant = plant.with_formulas(&unnamed, formula::friction());
    if let Some((method, found)) = by_formula(&plant) {
        let (force, position) = of(&plant, &found.fit);
        figures.push(computed(FORCE, "%", &method, force));
        figures.push(computed(POSITION, "mm", &method, position));
    }
    figures.sort_by_key(|figure| figure.measure != FORCE);
    Some((outcome, figures))
}

/// The hysteretic force over the position while this is largest, as points.
fn loop_of(run: &[[f64; 2]]) -> Plot {
    let size = |i: &usize| run[*i][0].abs();
    let largest = (0..run.len()).max_by(|a, b| size(a).total_cmp(&size(b)));
    let from = largest.unwrap_or(0).saturating_sub(50);
    let mut points = run[from..(from + 100).min(run.len())].to_vec();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (x, y) = points.iter().map(|[x, z]| (*x, *z)).unzip();
    Plot {
        title: "The loop that was found".into(),
        caption: "Hysteretic force over the position where the sine sweep is largest.".into(),
        x: Axis::new("position", "mm", 1e3),
        y: Axis::new("hysteretic force", "N", 1.0),
        series: vec![Series::new("as fitted", x, y).role(Role::Fitted).points()],
        markers: Vec::new(),
        sync: None,
    }
}

/// With all forms of the catalogue, or without the one by which the record was made.
fn oscillator_by(folder: &Path, has_own: bool) -> Option<(Outcome, Vec<Figure>)> {
    let read = |name: &str, n| oscillator::Oscillator::read(&folder.join(name), n);
    let mut plant = Plant::new(vec![read("train.csv", 5)?], 1);
    plant
        .candidates
        .retain(|own| has_own || own.form != "bouc-wen");
    let (selection, spent_s) = selected(&plant)?;
    let (multisine, sweep) = (
        read("test_multisine.csv", 1)?,
        read("test_sinesweep.csv", 0)?,
    );
    let run = |test: &oscillator::Oscillator, fit: &Fit| {
        test.run(&fit.nominal, &Present::new(&plant.candidates, &fit.effects))
    };
    let error = |test: &oscillator::Oscillator, fit: &Fit| {
        let run = run(test, fit);
        rms(run
            .iter()
            .zip(&test.position_m)
            .map(|([is, _], was)| is - was))
    };
    let (null, fit) = (&selection.null.fit, &selection.named.fit);
    let mut outcome = Outcome {
        set: "Bouc–Wen".into(),
        fitted: vec!["train, the mean of its periods".into()],
        held_out: vec!["test_multisine".into(), "test_sinesweep".into()],
        signal: "displacement_m",
        unit: "mm",
        range: 1e3 * range(multisine.position_m.iter().copied()),
        calibrated: 1e3 * error(&multisine, null),
        after: 1e3 * error(&multisine, fit),
        noise: 1e3 * oscillator::NOISE_M,
        next_experiment: "A sine so slow that only the spring and the loop are left.".into(),
        spent_s,
        plots: vec![loop_of(&run(&sweep, fit))],
        ..Outcome::default()
    };
    outcome.selected(
        &plant,
        &selection,
        &[("hysteresis", "5e4 N/m, 800 1/m, −1100 1/m")],
    );
    let suffix = if has_own {
        ""
    } else {
        ", without the form of Bouc and Wen"
    };
    let method = format!("{}{suffix}", named(&outcome));
    let mut figures = Vec::new();
    for (measure, test) in [(MULTISINE, &multisine), (SWEEP, &sweep)] {
        if has_own {
            figures.push(computed(
                measure,
                "10⁻⁵ m",
                "linear, fitted",
                1e5 * error(test, null),
            ));
        }
        figures.push(computed(measure, "10⁻⁵ m", &method, 1e5 * error(test, fit)));
    }
    Some((outcome, figures))
}

fn oscillator_of(folder: &Path) -> Option<(Outcome, Vec<Figure>)> {
    let (outcome, own) = oscillator_by(folder, true)?;
    let (_, without) = oscillator_by(folder, false)?;
    let mut figures = published(MULTISINE, "10⁻⁵ m", &MULTISINE_PUBLISHED);
    figures.extend(own);
    figures.extend(without);
    figures.sort_by_key(|figure| figure.measure);
    Some((outcome, figures))
}

/// All benchmarks in `folder`; missing ones are reported on stderr.
pub fn all(folder: &Path) -> (Vec<Outcome>, Vec<Figure>) {
    type Of = fn(&Path) -> Option<(Outcome, Vec<Figure>)>;
    let sets: [(&str, Of); 3] = [
        ("cascaded_tanks", tanks_of),
        ("emps", axis_of),
        ("bouc_wen", oscillator_of),
    ];
    let (mut outcomes, mut figures) = (Vec::new(), Vec::new());
    for (name, of) in sets {
        let Some(folder) = set_of(folder, name) else {
            continue;
        };
        if let Some((outcome, own)) = of(&folder) {
            outcomes.push(outcome);
            figures.extend(own);
        } else {
            let why = "expected the benchmark's files with its columns";
            outcomes.push(Outcome::refused(name, why.into()));
        }
    }
    (outcomes, figures)
}

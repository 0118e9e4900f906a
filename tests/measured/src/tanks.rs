//! The cascaded tanks of the nonlinear identification benchmark (Schoukens & Noël 2017): a pump
//! fills the upper tank, which drains into the lower one, whose level is measured.
//!
//! h1' = k4 u − k1 √h1, h2' = k2 √h1 − k3 √h2 in volts of the level sensor (Torricelli). The
//! first half of the record is fitted, the second is simulated by the same run from the start.

use crate::{Outcome, candidate, held_out, noise_of, parameter, range, set_of};
use hil_sim::error::BadInput;
use hil_sim::record::Record;
use model_discrepancy::engine::{Active, Candidate, Coordinate, Engine, Model};
use model_discrepancy::least_squares::Residuals;
use model_discrepancy::verdict::{Costs, select};
use std::path::Path;
use std::time::Instant;

/// k1, k2, k3 \[√V/s\], k4 \[1/s\] and initial h1 \[V\]: of tanks that empty in some minutes and
/// are half full at half the pump's voltage.
const NOMINAL: [f64; 5] = [0.05, 0.05, 0.05, 0.04, 5.0];
/// Relative standard deviation of each, as the values of the tanks are not published.
const SIGMA: f64 = 0.5;
const LEAST_SHARE: f64 = 0.02;
/// Upper limit of the level sensor \[V\].
const MOST_V: f64 = 10.0;
/// Steps of the integration in a sample.
const STEPS: usize = 4;

struct Tanks {
    time_s: Vec<f64>,
    pump_v: Vec<f64>,
    level_v: Vec<f64>,
    noise_v: f64,
    nominal_blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
}

fn catalogue() -> Vec<Candidate> {
    let level = || parameter("level_v", "V", (2.0, 30.0), 10.0);
    let all = [
        ("overflow", "lost", vec![level()]),
        (
            "overflow",
            "into-lower",
            vec![level(), parameter("share", "1", (0.0, 1.0), 0.5)],
        ),
        ("lower-overflow", "lost", vec![level()]),
        (
            "pump-dead-zone",
            "sharp",
            vec![parameter("dead_v", "V", (0.0, 3.0), 0.3)],
        ),
        (
            "level-sensor-offset",
            "constant",
            vec![parameter("offset_v", "V", (-5.0, 5.0), 0.5)],
        ),
        (
            "leak",
            "linear",
            vec![parameter("per_s", "1/s", (0.0, 0.1), 2e-3)],
        ),
    ];
    all.into_iter().map(candidate).collect()
}

impl Tanks {
    fn value(&self, effects: &[Active], effect: &str, parameter: usize) -> Option<f64> {
        let own = |active: &&Active| self.candidates[active.0].effect == effect;
        effects.iter().find(own)?.1.get(parameter).copied()
    }

    /// The lower level as its sensor reads it \[V\].
    fn run(&self, nominal: &[f64], effects: &[Active]) -> Vec<f64> {
        let moved = |i: usize| NOMINAL[i] * (1.0 + SIGMA * nominal[i]).max(LEAST_SHARE);
        let [k1, k2, k3, k4, upper_v] = std::array::from_fn(moved);
        let most_upper_v = self.value(effects, "overflow", 0).unwrap_or(f64::INFINITY);
        let share = self.value(effects, "overflow", 1).unwrap_or(0.0);
        let most_v = self
            .value(effects, "lower-overflow", 0)
            .unwrap_or(f64::INFINITY);
        let dead_v = self.value(effects, "pump-dead-zone", 0).unwrap_or(0.0);
        let offset_v = self.value(effects, "level-sensor-offset", 0).unwrap_or(0.0);
        let leak_per_s = self.value(effects, "leak", 0).unwrap_or(0.0);
        let (mut upper_v, mut lower_v) = (upper_v, self.level_v[0] - offset_v);
        let mut read_v = Vec::with_capacity(self.time_s.len());
        for row in 0..self.time_s.len() {
            read_v.push((lower_v + offset_v).min(MOST_V));
            let next_s = self
                .time_s
                .get(row + 1)
                .copied()
                .unwrap_or(self.time_s[row]);
            let step_s = (next_s - self.time_s[row]) / STEPS as f64;
            let pump_v = (self.pump_v[row] - dead_v).max(0.0);
            for _ in 0..STEPS {
                let out = upper_v.max(0.0).sqrt();
                let full_v = upper_v + step_s * (k4 * pump_v - k1 * out);
                let over_v = (full_v - most_upper_v).max(0.0);
                upper_v = (full_v - over_v).max(0.0);
                let lower_rate = k2 * out - k3 * lower_v.max(0.0).sqrt() - leak_per_s * lower_v;
                // What runs over keeps its volume; k2 over k1 is the tanks' ratio of areas.
                lower_v += step_s * lower_rate + share * over_v * k2 / k1;
                lower_v = lower_v.clamp(0.0, most_v);
            }
        }
        read_v
    }

    /// The rows of the first half, or of the second.
    fn half(&self, record: usize) -> std::ops::Range<usize> {
        let middle = self.time_s.len() / 2;
        if record == 0 {
            0..middle
        } else {
            middle..self.time_s.len()
        }
    }
}

impl Model for Tanks {
    fn records(&self) -> usize {
        2
    }

    fn fitted(&self) -> usize {
        1
    }

    fn blocks(&self) -> &[&'static str] {
        &["level"]
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
        _: usize,
        nominal: &[f64],
        effects: &[Active],
    ) -> Option<Residuals> {
        let read_v = self.run(nominal, effects);
        let residual = |row: usize| (read_v[row] - self.level_v[row]) / self.noise_v;
        Some(Residuals::exact(self.half(record).map(residual).collect()))
    }

    fn rows(&self, record: usize, _: usize) -> usize {
        self.half(record).len()
    }

    /// An overflow depends on the level, not in proportion.
    fn proportional(&self, _: usize) -> bool {
        false
    }

    fn context(&self, record: usize, _: usize) -> Vec<Coordinate> {
        vec![Coordinate {
            name: "time",
            unit: "s",
            values: self.half(record).map(|row| self.time_s[row]).collect(),
        }]
    }
}

fn outcome(folder: &Path) -> Result<Outcome, BadInput> {
    let begin = Instant::now();
    let record = Record::read(&folder.join("est.csv"))?;
    let numbers = |name: &str| -> Result<Vec<f64>, BadInput> {
        let words = record.require_text(name)?.iter();
        Ok(words.map(|word| word.parse().unwrap_or(f64::NAN)).collect())
    };
    let level_v = numbers("lower_tank_level_volt")?;
    let model = Tanks {
        time_s: record.time_s().to_vec(),
        pump_v: numbers("pump_volt")?,
        noise_v: noise_of(&level_v),
        level_v,
        nominal_blocks: vec![vec![0]; NOMINAL.len()],
        candidates: catalogue(),
    };
    let engine = Engine::new(&model);
    let expected = "a record that the tanks can follow";
    let selection =
        select(&engine, Costs::default(), &|_| ()).ok_or_else(|| record.bad_file(expected))?;
    let left = |fit| held_out(&model, fit, model.noise_v);
    let mut outcome = Outcome {
        set: "cascaded tanks".into(),
        fitted: vec!["the first half of est".into()],
        held_out: vec!["the second half of est".into()],
        signal: "lower_tank_level_volt",
        unit: "V",
        range: range(model.level_v[model.half(1)].iter().copied()),
        calibrated: left(&selection.null.fit),
        after: left(&selection.named.fit),
        noise: model.noise_v,
        next_experiment: "Fill the upper tank until it runs over, with its level measured.".into(),
        spent_s: begin.elapsed().as_secs_f64(),
        ..Outcome::default()
    };
    outcome.selected(&model, &selection, &[]);
    Ok(outcome)
}

/// The outcome of the set, if it exists.
pub fn all(folder: &Path) -> Vec<Outcome> {
    let Some(folder) = set_of(folder, "cascaded_tanks") else {
        return Vec::new();
    };
    let outcome = outcome(&folder);
    vec![outcome.unwrap_or_else(|why| Outcome::refused("cascaded tanks", why.to_string()))]
}

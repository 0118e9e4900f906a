//! A pneumatic cylinder at constant pressure, moved in both directions: diagnosis of its friction.
//!
//! The law is F = A P on the rod. The engine of the diagnosis uses it with a separate catalogue, as
//! the muscle's does not apply.

use crate::{Outcome, candidate, held_out, noise_of, parameter, range, set_of};
use hil_sim::error::BadInput;
use hil_sim::record::{FORCE_N, PRESSURE_PA, Record};
use model_discrepancy::engine::{Active, Candidate, Coordinate, Engine, Model};
use model_discrepancy::least_squares::Residuals;
use model_discrepancy::rows::Timeline;
use model_discrepancy::verdict::{Costs, select};
use std::path::Path;
use std::time::Instant;

/// Relative tolerance of the bore: 0.1 mm of 25 mm.
const AREA_SIGMA: f64 = 0.01;
/// By how much the mean force differs between runs of one seal, which was mounted anew between them
/// \[N\].
const REMOUNTING_N: f64 = 0.5;
/// Number of rows before and after a row over which its speed is estimated: 60 ms.
const SPEED_ROWS: usize = 3;
/// Speed below which the motion may reverse \[m/s\].
const TURNING_M_PER_S: f64 = 1e-3;
const PUBLISHED: [(&str, &str); 2] = [
    ("friction", "5 to 20 N"),
    ("pressure-sensor-offset", "1 to 3 % of span"),
];

/// One run: rod force, pressure, position and speed.
struct Run {
    time_s: Vec<f64>,
    pressure_pa: Vec<f64>,
    position_m: Vec<f64>,
    speed_m_per_s: Vec<f64>,
    force_n: Vec<f64>,
}

impl Run {
    fn read(path: &Path) -> Result<Run, BadInput> {
        let record = Record::read(path)?;
        let time_s = record.time_s().to_vec();
        let words = record.require_text("position_m")?.iter();
        let position_m: Vec<f64> = words.map(|word| word.parse().unwrap_or(f64::NAN)).collect();
        let speed = |row: usize| {
            let (from, to) = (
                row.saturating_sub(SPEED_ROWS),
                (row + SPEED_ROWS).min(time_s.len() - 1),
            );
            (position_m[to] - position_m[from]) / (time_s[to] - time_s[from])
        };
        Ok(Run {
            speed_m_per_s: (0..time_s.len()).map(speed).collect(),
            pressure_pa: record.require(PRESSURE_PA)?.to_vec(),
            force_n: record.require(FORCE_N)?.to_vec(),
            time_s,
            position_m,
        })
    }
}

struct Cylinder {
    area_m2: f64,
    runs: Vec<Run>,
    fitted: usize,
    noise_n: f64,
    nominal_blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
}

fn catalogue() -> Vec<Candidate> {
    let reach = || parameter("reach_m", "m", (1e-5, 2e-2), 1e-3);
    let size = || parameter("force_n", "N", (0.0, 100.0), 5.0);
    let share = || parameter("per_pressure_m2", "m²", (0.0, 1e-4), 1e-5);
    let all = [
        ("friction", "coulomb", vec![size()]),
        ("friction", "dahl", vec![size(), reach()]),
        ("friction-with-pressure", "coulomb", vec![share()]),
        ("friction-with-pressure", "dahl", vec![share(), reach()]),
        (
            "viscous",
            "linear",
            vec![parameter("n_s_per_m", "N·s/m", (0.0, 5e3), 100.0)],
        ),
        (
            "force-sensor-offset",
            "constant",
            vec![parameter("offset_n", "N", (-50.0, 50.0), 2.0)],
        ),
        (
            "pressure-sensor-offset",
            "constant",
            vec![parameter("offset_pa", "Pa", (-1e5, 1e5), 5e3)],
        ),
    ];
    all.into_iter().map(candidate).collect()
}

/// Direction of motion, smooth at reversals.
fn direction(speed_m_per_s: f64) -> f64 {
    (speed_m_per_s / TURNING_M_PER_S).clamp(-1.0, 1.0)
}

/// Direction with pre-sliding: dz = dx/reach · (1 − z sgn dx) (Dahl 1968).
fn dahl(position_m: &[f64], reach_m: f64) -> Vec<f64> {
    let mut z = 0.0;
    let mut last_m = position_m[0];
    let step = |place_m: &f64| {
        let way = (place_m - last_m) / reach_m;
        last_m = *place_m;
        z = way.signum() + (z - way.signum()) * (-way.abs()).exp();
        z
    };
    position_m.iter().map(step).collect()
}

impl Cylinder {
    /// Rod force \[N\]: pressure on the piston, and friction.
    fn force_n(&self, run: &Run, nominal: &[f64], effects: &[Active]) -> Vec<f64> {
        let area_m2 = self.area_m2 * (1.0 + AREA_SIGMA * nominal[0]);
        let mut offset_pa = 0.0;
        let mut force_n = vec![0.0; run.time_s.len()];
        for (candidate, values) in effects {
            let Candidate { effect, form, .. } = &self.candidates[*candidate];
            let ways: Vec<f64> = match *form {
                "dahl" => dahl(&run.position_m, values[1]),
                "linear" => run.speed_m_per_s.clone(),
                "coulomb" => run.speed_m_per_s.iter().map(|v| direction(*v)).collect(),
                _ => vec![1.0; run.time_s.len()],
            };
            if *effect == "pressure-sensor-offset" {
                offset_pa = values[0];
                continue;
            }
            let with_pressure = *effect == "friction-with-pressure";
            for ((force_n, way), pressure_pa) in force_n.iter_mut().zip(ways).zip(&run.pressure_pa)
            {
                let pressed = if with_pressure { *pressure_pa } else { 1.0 };
                *force_n += values[0] * pressed * way;
            }
        }
        let pairs = force_n.iter().zip(&run.pressure_pa);
        pairs
            .map(|(more_n, p)| area_m2 * (p - offset_pa) + more_n)
            .collect()
    }
}

impl Model for Cylinder {
    fn records(&self) -> usize {
        self.runs.len()
    }

    fn fitted(&self) -> usize {
        self.fitted
    }

    fn blocks(&self) -> &[&'static str] {
        &["rod force"]
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
        let run = &self.runs[record];
        let force_n = self.force_n(run, nominal, effects);
        let pairs = force_n.iter().zip(&run.force_n);
        Some(Residuals::exact(
            pairs.map(|(is, was)| (is - was) / self.noise_n).collect(),
        ))
    }

    fn rows(&self, record: usize, _: usize) -> usize {
        self.runs[record].time_s.len()
    }

    fn proportional(&self, _: usize) -> bool {
        true
    }

    fn timeline(&self, record: usize, _: usize) -> Timeline {
        let time_s = self.runs[record].time_s.clone();
        Timeline {
            base: vec![REMOUNTING_N / self.noise_n; time_s.len()],
            time_s,
        }
    }

    fn context(&self, record: usize, _: usize) -> Vec<Coordinate> {
        let run = &self.runs[record];
        vec![Coordinate {
            name: "pressure",
            unit: "Pa",
            values: run.pressure_pa.clone(),
        }]
    }
}

fn outcome(
    folder: &Path,
    (name, bore_m): (&str, f64),
    fit: &[&str],
    validate: &[&str],
) -> Result<Outcome, BadInput> {
    let begin = Instant::now();
    let names = fit.iter().chain(validate);
    let runs = names.map(|run| Run::read(&folder.join(format!("{run}.csv"))));
    let runs = runs.collect::<Result<Vec<_>, _>>()?;
    let area_m2 = std::f64::consts::FRAC_PI_4 * bore_m * bore_m;
    let noise = |run: &Run| noise_of(&run.force_n).hypot(area_m2 * noise_of(&run.pressure_pa));
    let noise_n = runs.iter().map(noise).fold(0.0, f64::max);
    let model = Cylinder {
        area_m2,
        runs,
        fitted: fit.len(),
        noise_n,
        nominal_blocks: vec![vec![0]],
        candidates: catalogue(),
    };
    let engine = Engine::new(&model);
    let expected = "runs that the law can follow";
    let selection =
        select(&engine, Costs::default(), &|_| ()).ok_or_else(|| BadInput::file(name, expected))?;
    let left = |fit| held_out(&model, fit, noise_n);
    let words = |names: &[&str]| names.iter().map(|name| (*name).into()).collect();
    let mut outcome = Outcome {
        set: name.into(),
        fitted: words(fit),
        held_out: words(validate),
        signal: FORCE_N,
        unit: "N",
        range: range(
            model.runs[fit.len()..]
                .iter()
                .flat_map(|run| run.force_n.iter().copied()),
        ),
        calibrated: left(&selection.null.fit),
        after: left(&selection.named.fit),
        noise: noise_n,
        next_experiment: "Drive at three speeds and at no pressure: what stays is the seal's own."
            .into(),
        spent_s: begin.elapsed().as_secs_f64(),
        ..Outcome::default()
    };
    outcome.selected(&model, &selection, &PUBLISHED);
    Ok(outcome)
}

/// Both pistons of the set.
pub fn all(folder: &Path) -> Vec<Outcome> {
    let Some(folder) = set_of(folder, "cylinder_friction") else {
        return Vec::new();
    };
    let of = |piston: (&str, f64), fit: &[&str], validate: &[&str]| {
        let outcome = outcome(&folder, piston, fit, validate);
        outcome.unwrap_or_else(|why| Outcome::refused(piston.0, why.to_string()))
    };
    vec![
        of(
            ("cylinder, O-ring, 25.7 mm", 0.0257),
            &["oring257_1bar", "oring257_5bar"],
            &["oring257_3bar", "oring257_7bar"],
        ),
        of(
            ("cylinder, seal NAPN, 25 mm", 0.025),
            &["napn_1bar", "napn_7bar"],
            &["napn_3bar"],
        ),
    ]
}

//! `diagnose` on records of a bench: the muscle is clamped, its pressure is the input, and the
//! force is measured. The truth here is written out by hand.

use hil_sim::identify::diagnosis::{Diagnosis, Options, diagnose};
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use model_discrepancy::verdict::Verdict;
use muscle_plant::effects::Catalogue;
use rand_distr::{Distribution, Normal, Uniform};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;

const ALPHA_M2: f64 = 4e-3;
const BETA_M2: f64 = -1.5e-3;
const GAMMA_N: f64 = -100.0;
const FORCE_NOISE_N: f64 = 1.0;
const PRESSURE_NOISE_PA: f64 = 200.0;

/// Deviations of the bench from Eq 1.
#[derive(Clone, Copy, Default)]
struct Bench {
    dead_pa: f64,
    lag_s: f64,
    /// Upper limit of the load cell, if any \[N\].
    most_n: Option<f64>,
}

/// Sampling and pressure of a run.
#[derive(Clone, Copy)]
struct Run {
    period_s: f64,
    /// Largest jitter of a sample as a share of the period.
    uneven: f64,
    length_s: f64,
    steps: bool,
    contraction: f64,
    seed: u64,
}

const LEVELS_PA: [f64; 8] = [0.0, 2e5, 4.5e5, 3e5, 5e5, 1e5, 3.5e5, 0.5e5];

/// Steps of one second with the lag of a valve, or a triangle.
fn pressure_pa(run: &Run, time_s: f64) -> f64 {
    if !run.steps {
        let share = 2.0 * time_s / run.length_s;
        return 5e5 * share.min(2.0 - share);
    }
    let number = time_s.floor();
    let level = |number: f64| LEVELS_PA[(number.max(0.0) as usize + run.seed as usize) % 8];
    let before = if number < 1.0 {
        level(0.0)
    } else {
        level(number - 1.0)
    };
    level(number) + (before - level(number)) * (-(time_s - number) / 0.03).exp()
}

fn record(bench: Bench, run: Run) -> Record {
    let mut rng = Pcg64::seed_from_u64(run.seed);
    let late = Uniform::new(-run.uneven, run.uneven.max(1e-9)).expect("a range");
    let normal = |size| Normal::new(0.0, size).expect("a spread");
    let (force, pressure) = (normal(FORCE_NOISE_N), normal(PRESSURE_NOISE_PA));
    let rows = (run.length_s / run.period_s) as usize;
    let place = |row: usize| row as f64 + 0.5;
    let mut times: Vec<f64> = (0..rows)
        .map(|row| run.period_s * (place(row) + 0.5 * late.sample(&mut rng)))
        .collect();
    times.dedup();
    let (mut behind_pa, mut at_s) = (pressure_pa(&run, 0.0), 0.0);
    let (mut pressures, mut forces) = (Vec::new(), Vec::new());
    for time_s in &times {
        while at_s < *time_s {
            let step_s = (time_s - at_s).min(1e-4);
            at_s += step_s;
            let share = if bench.lag_s > 0.0 {
                (step_s / bench.lag_s).min(1.0)
            } else {
                1.0
            };
            behind_pa += share * (pressure_pa(&run, at_s) - behind_pa);
        }
        let inside_pa = (behind_pa - bench.dead_pa).max(0.0);
        let area_m2 = ALPHA_M2 * (1.0 - run.contraction).powi(2) + BETA_M2;
        let read_n = area_m2 * inside_pa + GAMMA_N + force.sample(&mut rng);
        pressures.push(pressure_pa(&run, *time_s) + pressure.sample(&mut rng));
        forces.push(bench.most_n.map_or(read_n, |most_n| read_n.min(most_n)));
    }
    let mut record = Record::new(times);
    record.set(PRESSURE_PA, pressures);
    record.set(CONTRACTION, vec![run.contraction; forces.len()]);
    record.set(FORCE_N, forces);
    record
}

/// Eq 1 with values that are wrong by 3, −2 and 4 %, and tolerances of `sigma`.
fn rig(sigma: f64) -> Rig {
    let text = format!(
        "schema = 1\n[muscle]\nalpha_m2 = {:?}\nbeta_m2 = {:?}\ngamma_n = {:?}\n\
         initial_length_m = 0.3\n[load]\nkind = \"prescribed\"\n[tolerance.muscle]\n\
         alpha_m2 = {sigma}\nbeta_m2 = {sigma}\ngamma_n = {sigma}\n",
        1.03 * ALPHA_M2,
        0.98 * BETA_M2,
        1.04 * GAMMA_N
    );
    Rig::parse("rig.toml", &text).expect("a rig")
}

/// Diagnosed from runs at three lengths, with one more held out.
fn diagnosed(bench: Bench, run: Run, sigma: f64) -> Diagnosis {
    diagnosed_as(bench, run, sigma, |record| record)
}

/// The same from records changed by `seen`.
fn diagnosed_as(bench: Bench, run: Run, sigma: f64, seen: fn(Record) -> Record) -> Diagnosis {
    // Without optimisation the complete catalogue would take too long.
    const FEW: [&str; 6] = [
        "hysteresis",
        "backlash",
        "dead-band",
        "creep",
        "line-dynamics",
        "pressure-sensor-offset",
    ];
    let names = Catalogue::standard()
        .kinds()
        .map(|kind| kind.name.to_owned());
    let without: Vec<String> = names.filter(|name| !FEW.contains(&name.as_str())).collect();
    let at = |(seed, contraction): (u64, f64)| {
        let run = Run {
            seed,
            contraction,
            ..run
        };
        seen(record(bench, run))
    };
    let fit: Vec<Record> = [(1, 0.0), (2, 0.05), (3, 0.12)].map(at).into();
    let validate = vec![at((4, 0.08))];
    let options = Options {
        without,
        ..Options::default()
    };
    let diagnosed = diagnose(&rig(sigma), &fit, &validate, &options, &|_| ());
    diagnosed.expect("a diagnosis").diagnosis
}

const UNEVEN_1_KHZ: Run = Run {
    period_s: 1e-3,
    uneven: 0.4,
    length_s: 9.0,
    steps: true,
    contraction: 0.0,
    seed: 0,
};
const RAMPS_10_HZ: Run = Run {
    period_s: 0.1,
    length_s: 40.0,
    steps: false,
    ..UNEVEN_1_KHZ
};

fn names(diagnosis: &Diagnosis) -> Vec<&str> {
    diagnosis.effects.iter().map(|effect| effect.name).collect()
}

/// A cell without a sample, and a reference pressure although the rig has no valve.
#[test]
fn missing_samples_and_unused_columns_do_not_change_the_result() {
    let seen = |mut record: Record| {
        let pressure_pa = record.require(PRESSURE_PA).expect("a column").to_vec();
        record.set(PRESSURE_REF_PA, pressure_pa);
        let mut contraction = record.require(CONTRACTION).expect("a column").to_vec();
        contraction[200] = f64::NAN;
        record.set(CONTRACTION, contraction);
        record
    };
    let bench = Bench {
        dead_pa: 3e4,
        ..Bench::default()
    };
    let diagnosis = diagnosed_as(bench, RAMPS_10_HZ, 0.05, seen);
    assert_eq!(names(&diagnosis), ["dead-band"]);
}

#[test]
fn a_dead_band_is_found_at_any_rate_in_steps_and_ramps() {
    let bench = Bench {
        dead_pa: 3e4,
        ..Bench::default()
    };
    for run in [UNEVEN_1_KHZ, RAMPS_10_HZ] {
        let diagnosis = diagnosed(bench, run, 0.05);
        assert_eq!(diagnosis.verdict, Verdict::Explained);
        assert_eq!(names(&diagnosis), ["dead-band"], "each {} s", run.period_s);
        // γ is known to 5 N, which are 2 kPa of 2.5e-3 m²: three of them.
        let found = &diagnosis.effects[0].parameters["pressure_pa"];
        assert!((found.value - 3e4).abs() < 6e3, "{found:?}");
        let gap = diagnosis.gap_of(FORCE_N).expect("a force");
        assert!(
            gap.after < 1.5 * gap.noise && gap.before > 10.0 * gap.noise,
            "{gap:?}"
        );
    }
}

#[test]
fn a_force_law_within_its_tolerance_is_calibrated_without_an_effect() {
    for run in [UNEVEN_1_KHZ, RAMPS_10_HZ] {
        let diagnosis = diagnosed(Bench::default(), run, 0.5);
        assert_eq!(
            diagnosis.verdict,
            Verdict::Consistent,
            "{:?}",
            names(&diagnosis)
        );
        let gap = diagnosis.gap_of(FORCE_N).expect("a force");
        assert!(gap.after < 1.3 * gap.noise, "{gap:?}");
    }
}

#[test]
fn a_force_that_lags_its_pressure_is_line_dynamics_and_not_hysteresis() {
    let bench = Bench {
        lag_s: 0.02,
        ..Bench::default()
    };
    let diagnosis = diagnosed(bench, UNEVEN_1_KHZ, 0.05);
    assert_eq!(names(&diagnosis), ["line-dynamics"]);
    let found = &diagnosis.effects[0].parameters["lag_s"];
    // A row each 8 ms where the pressure moves, linear between them: half of that.
    assert!((found.value - 0.02).abs() < 4e-3, "{found:?}");
}

#[test]
fn a_saturated_load_cell_does_not_change_the_force_law() {
    let bench = Bench {
        most_n: Some(700.0),
        ..Bench::default()
    };
    let diagnosis = diagnosed(bench, UNEVEN_1_KHZ, 0.5);
    assert_eq!(
        diagnosis.verdict,
        Verdict::Consistent,
        "{:?}",
        names(&diagnosis)
    );
    let alpha = &diagnosis.calibrated[0];
    // Noise of 1 N on hundreds of rows of 1000 N.
    assert!((alpha.values[1] / ALPHA_M2 - 1.0).abs() < 0.02, "{alpha:?}");
}

#[test]
fn a_rounded_clock_may_repeat_a_time_occasionally() {
    let file = |repeated: &[usize]| {
        let mut text = String::from("time_s,pressure_pa\n");
        for row in 0..2000 {
            let time = if repeated.contains(&row) {
                row - 1
            } else {
                row
            };
            text += &format!("{},{row}\n", 0.002 * time as f64);
        }
        Record::parse("a.csv", text.as_bytes())
    };
    let record = file(&[17]).expect("a record");
    assert!((record.time_s()[17] - 0.034).abs() < 1e-12);
    assert!(record.time_s().windows(2).all(|pair| pair[0] < pair[1]));
    // On the line after the header and 17 rows.
    assert_eq!(record.repeated_times(), Some((1, 19)));
    for often in [&[17, 50, 80][..], &[1999]] {
        let why = file(often).expect_err("a clock that stands").to_string();
        assert!(
            why.contains("a.csv:") && why.contains("`hil-sim import` corrects"),
            "{why}"
        );
    }
}

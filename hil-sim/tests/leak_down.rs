//! A leak-down is diagnosed without a rig.
//!
//! The truth is a chamber whose air leaves through an opening, simulated by its mass with short
//! steps.

use hil_sim::identify::diagnosis::{Diagnosis, Options};
use hil_sim::identify::leak_down::leak_down;
use hil_sim::record::Record;
use model_discrepancy::verdict::Verdict;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use std::path::Path;
use std::process::{Command, Output};

const ATMOSPHERE_PA: f64 = 101_325.0;
const PERIOD_S: f64 = 0.2;
const NOISE_PA: f64 = 250.0;
/// The room warms and cools by so much [K], once in so many seconds.
const ROOM_K: f64 = 0.1;
const ROOM_PERIOD_S: f64 = 70.0;

/// How fast the pressure of a chamber falls [1/s], by its absolute pressure [Pa].
type Law = fn(f64) -> f64;

/// Of a laminar leak that loses `1/TIME_CONSTANT_S` of the gauge pressure.
fn laminar(absolute_pa: f64) -> f64 {
    (absolute_pa - ATMOSPHERE_PA) / TIME_CONSTANT_S
}
const TIME_CONSTANT_S: f64 = 90.0;

/// Of a hole that is choked above twice the atmosphere, as ISO 6358 has it with b = 0.5.
fn hole(absolute_pa: f64) -> f64 {
    let ratio = ATMOSPHERE_PA / absolute_pa;
    let share = if ratio <= 0.5 {
        1.0
    } else {
        (1.0 - ((ratio - 0.5) / 0.5).powi(2)).max(0.0).sqrt()
    };
    share * absolute_pa / 60.0
}

fn tight(_: f64) -> f64 {
    0.0
}

/// A record of a chamber that begins at this gauge pressure.
fn record(law: Law, begin_pa: f64, seed: u64) -> Record {
    const STEPS: usize = 50;
    let mut rng = Pcg64::seed_from_u64(seed);
    let noise = Normal::new(0.0, NOISE_PA).expect("a spread");
    let mut absolute_pa = begin_pa + ATMOSPHERE_PA;
    let time_s: Vec<f64> = (0..600).map(|row| PERIOD_S * f64::from(row)).collect();
    let mut pressure_pa = Vec::new();
    for time_s in &time_s {
        let phase = std::f64::consts::TAU * time_s / ROOM_PERIOD_S + seed as f64;
        let warm = 1.0 + ROOM_K / 293.0 * phase.sin();
        let reading_pa = absolute_pa * warm - ATMOSPHERE_PA + noise.sample(&mut rng);
        pressure_pa.push(reading_pa.round());
        for _ in 0..STEPS {
            absolute_pa -= law(absolute_pa) * PERIOD_S / STEPS as f64;
        }
    }
    let mut record = Record::new(time_s);
    record.set("pressure_pa", pressure_pa);
    record
}

fn diagnosed(fit: &[Record], validate: &[Record]) -> Diagnosis {
    let (diagnosis, free_runs) =
        leak_down(fit, validate, &Options::default(), &|_| ()).expect("a diagnosis");
    let shown = if validate.is_empty() { fit } else { validate };
    assert_eq!(free_runs.len(), shown.len());
    diagnosis
}

/// The time constant and its interval.
fn found(diagnosis: &Diagnosis) -> (f64, [f64; 2]) {
    let [leak] = &diagnosis.effects[..] else {
        panic!("{diagnosis:?}");
    };
    assert_eq!((leak.name, leak.place), ("leak", "gas"));
    let estimate = &leak.parameters["time_constant_s"];
    (estimate.value, estimate.ci95)
}

/// Of forty intervals at least 34 have the true value: with 95 % of them one set of 300 has fewer.
#[test]
fn a_laminar_leak_has_its_time_constant_within_its_interval() {
    let within = (0..40).filter(|seed| {
        let diagnosis = diagnosed(&[record(laminar, 5e5, *seed)], &[]);
        let (value, [low, high]) = found(&diagnosis);
        assert!((value / TIME_CONSTANT_S - 1.0).abs() < 0.05, "{value}");
        assert!(high / low < 1.2, "{low} {high}");
        (low..=high).contains(&TIME_CONSTANT_S)
    });
    let within = within.count();
    assert!(within >= 34, "{within}");
}

/// One chamber, filled to two pressures, of which one record is predicted.
#[test]
fn another_record_is_predicted() {
    let fit = [record(laminar, 5e5, 1)];
    let diagnosis = diagnosed(&fit, &[record(laminar, 3e5, 2)]);
    assert_eq!(diagnosis.verdict, Verdict::Explained, "{diagnosis:?}");
    let gap = diagnosis.gap_of("pressure_pa").expect("a gap");
    assert!(gap.removed.expect("a share") > 0.95, "{gap:?}");
}

#[test]
fn a_hole_leaks_too_but_not_exponentially() {
    let diagnosis = diagnosed(&[record(hole, 6e5, 3)], &[]);
    assert_eq!(diagnosis.verdict, Verdict::Partial, "{diagnosis:?}");
    let (_, [low, high]) = found(&diagnosis);
    // What is lost in a second of the gauge pressure, at the beginning and at the end.
    let local = |gauge_pa: f64| gauge_pa / hole(gauge_pa + ATMOSPHERE_PA);
    assert!(high / low > 1.2, "{low} {high}");
    assert!(low < local(5e5) && high > local(2e5), "{low} {high}");
    let note = &diagnosis.warnings[0];
    assert!(note.contains("time constants of its thirds"), "{note}");
}

#[test]
fn a_tight_chamber_does_not_leak() {
    for seed in 0..10 {
        let diagnosis = diagnosed(&[record(tight, 5e5, seed)], &[]);
        assert_eq!(diagnosis.verdict, Verdict::Consistent, "{diagnosis:?}");
    }
}

fn command(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .arg("diagnose")
        .args(args)
        .output()
        .expect("the program runs")
}

#[test]
fn the_command_needs_no_rig_and_writes_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("shut.csv");
    record(laminar, 5e5, 4).write(&path).expect("written");
    let run = command(folder.path(), &["--fit", "shut.csv", "--out", "out"]);
    assert!(run.status.success(), "{run:?}");
    let names = std::fs::read_dir(folder.path().join("out")).expect("a folder");
    let mut names: Vec<_> = names.map(|own| own.expect("a file").file_name()).collect();
    names.sort();
    assert_eq!(names, ["diagnosis.json", "report.html"]);
    let told = String::from_utf8_lossy(&run.stdout);
    assert!(told.contains("leak: time constant"), "{told}");

    let mut moves = record(laminar, 5e5, 4);
    let rows = moves.time_s().len();
    moves.set("contraction", vec![0.1; rows]);
    moves.write(&path).expect("written");
    let run = command(folder.path(), &["--fit", "shut.csv", "--out", "out2"]);
    assert_eq!(run.status.code(), Some(2));
    let told = String::from_utf8_lossy(&run.stderr);
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(
        told.contains("shut.csv: column `contraction`: expected `--rig`"),
        "{told}"
    );
    assert!(!folder.path().join("out2").exists());
}

//! What the packaged estimator names on the estimation records of published benchmarks, which are
//! in a folder that MEASURED_DATA_DIR names; without it nothing is tested, and stderr says so.

use model_discrepancy::engine::Engine;
use model_discrepancy::verdict::{Costs, Verdict, select};
use plants::{Law, Plant, axis::Axis, oscillator::Oscillator, tanks::Tanks};
use std::path::PathBuf;

fn folder(set: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("MEASURED_DATA_DIR").map(|data| PathBuf::from(data).join(set));
    let found = folder.filter(|folder| folder.is_dir());
    if found.is_none() {
        eprintln!("SKIPPED: expected {set} in the folder that MEASURED_DATA_DIR names");
    }
    found
}

fn assert_named<L: Law>(record: Option<L>, names: &[&str]) {
    let plant = Plant::new(vec![record.expect("a record")], 1);
    let selection = select(&Engine::new(&plant), Costs::default(), &|_| ()).expect("a diagnosis");
    let named = selection.named.candidates.iter();
    let named: Vec<&str> = named.map(|own| plant.candidates[*own].effect).collect();
    assert_eq!(named, names);
    assert_eq!(
        selection.verdict,
        Verdict::Explained,
        "{:?}",
        selection.left
    );
}

#[test]
fn two_tanks_have_an_overflow_and_an_outflow_that_is_no_root() {
    if let Some(folder) = folder("cascaded_tanks") {
        let record = Tanks::read(&folder.join("est.csv"), false);
        assert_named(record, &["overflow", "outflow-law"]);
    }
}

#[test]
fn an_axis_has_uneven_friction_and_a_delay() {
    if let Some(folder) = folder("emps") {
        let record = Axis::read(&folder.join("est.csv"));
        assert_named(record, &["asymmetric-friction", "delay", "stribeck"]);
    }
}

#[test]
fn an_oscillator_has_a_hysteresis() {
    if let Some(folder) = folder("bouc_wen") {
        let record = Oscillator::read(&folder.join("train.csv"), 5);
        assert_named(record, &["hysteresis"]);
    }
}

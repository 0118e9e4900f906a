//! What the packaged estimator names on the estimation records of published benchmarks.

use model_discrepancy::engine::Engine;
use model_discrepancy::verdict::{Costs, Verdict, select};
use plants::{Law, Plant, axis::Axis, oscillator::Oscillator, tanks::Tanks};
use std::path::PathBuf;

fn folder(set: &str) -> PathBuf {
    let data = std::env::var_os("MEASURED_DATA_DIR").expect("MEASURED_DATA_DIR names the folder");
    PathBuf::from(data).join(set)
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
#[ignore = "needs the measured sets at MEASURED_DATA_DIR"]
fn two_tanks_have_an_overflow_and_an_outflow_that_is_no_root() {
    let record = Tanks::read(&folder("cascaded_tanks").join("est.csv"), false);
    assert_named(record, &["overflow", "outflow-law"]);
}

#[test]
#[ignore = "needs the measured sets at MEASURED_DATA_DIR"]
fn an_axis_has_uneven_friction_and_a_delay() {
    let record = Axis::read(&folder("emps").join("est.csv"));
    assert_named(
        record,
        &["asymmetric-friction", "delay", "low-speed-friction"],
    );
}

#[test]
#[ignore = "needs the measured sets at MEASURED_DATA_DIR"]
fn an_oscillator_has_a_hysteresis() {
    let record = Oscillator::read(&folder("bouc_wen").join("train.csv"), 5);
    assert_named(record, &["hysteresis"]);
}

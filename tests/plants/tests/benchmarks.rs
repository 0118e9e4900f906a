//! What the packaged estimator names on the estimation records of published benchmarks.

use model_discrepancy::engine::{Active, Candidate, Engine};
use model_discrepancy::verdict::{Costs, Verdict, probability, select};
use plants::axis::{Axis, SPEED_M_PER_S};
use plants::{Law, Plant, formula, oscillator::Oscillator, tanks::Tanks};
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

/// The most probable set where these effects have no name but the terms of a formula: each with the
/// 95 % interval of its first value and its probability.
fn formula_of<L: Law>(
    record: Option<L>,
    unnamed: &[&str],
    terms: Vec<Candidate>,
) -> Vec<(&'static str, [f64; 2], f64)> {
    let plant = Plant::new(vec![record.expect("a record")], 1).with_formulas(unnamed, terms);
    let engine = Engine::new(&plant);
    let selection = select(&engine, Costs::default(), &|_| ()).expect("a diagnosis");
    let found = selection.most_probable(&engine).expect("a set of terms");
    let intervals = engine.intervals(&found).expect("intervals");
    let of = |((own, _), intervals): (&Active, &Vec<[f64; 2]>)| {
        let name = plant.candidates[*own].effect;
        let with = probability(&selection.posterior, |set| set.effects.contains(&name));
        (name, intervals[0], with)
    };
    found.fit.effects.iter().zip(&intervals).map(of).collect()
}

fn assert_found(found: &[(&str, [f64; 2], f64)], names: &[&str]) {
    let of_found: Vec<&str> = found.iter().map(|(name, ..)| *name).collect();
    assert_eq!(of_found, names);
    let mut probabilities = found.iter().map(|(.., probability)| *probability);
    assert!(probabilities.all(|own| own > 0.95), "{found:?}");
}

/// Without a name for it, the outflow is found as a formula, beside the overflow.
#[test]
#[ignore = "needs the measured sets at MEASURED_DATA_DIR"]
fn outflow_of_tanks_is_found_as_a_formula() {
    let record = Tanks::read(&folder("cascaded_tanks").join("est.csv"), false);
    let found = formula_of(record, &["outflow-law"], formula::outflows());
    assert_found(&found, &["overflow", "lower-outflow-constant"]);
}

/// So is the friction that grows with speed, by 38 N·s/m more one way than on average where this
/// has a name.
#[test]
#[ignore = "needs the measured sets at MEASURED_DATA_DIR"]
fn friction_of_an_axis_is_found_as_a_formula() {
    let record = Axis::read(&folder("emps").join("est.csv"));
    let unnamed = ["asymmetric-friction", "drag", "friction-along-screw"];
    let found = formula_of(record, &unnamed, formula::friction());
    assert_found(&found, &["delay", "low-speed-friction", "friction-size"]);
    let ([least_n, most_n], expected_n) = (found[2].1, -37.8 * SPEED_M_PER_S);
    assert!((least_n..most_n).contains(&expected_n), "{found:?}");
}

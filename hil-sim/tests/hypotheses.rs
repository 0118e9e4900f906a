//! Probabilities of effects on a rig that lacks nothing, and on one with a leak.

use hil_sim::identify::hypotheses::{Hypothesis, hypotheses};
use hil_sim::identify::simulate::simulate;
use hil_sim::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use muscle_plant::simulation::TOLERANCE;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;

const PRESSURE_NOISE_PA: f64 = 250.0;
const CONTRACTION_NOISE: f64 = 3e-5;

/// The paper's rig with tolerances, and what it lacks.
fn rig(effect: &str) -> Rig {
    let tolerances = "[tolerance.muscle]\nalpha_m2 = 0.01\nbeta_m2 = 0.01\ngamma_n = 0.01\n\
                      [tolerance.load]\nviscous_damping_ns_per_m = 0.1\n\
                      coulomb_friction_n = 0.05\n[tolerance.valve]\nflow_gain_kg_per_pa_s = 0.05\n";
    let text = format!("{}\n{tolerances}{effect}", Rig::REFERENCE_TOML);
    Rig::parse("rig.toml", &text).expect("a rig")
}

/// The effects that are tried: time grows with their number.
const TRIED: [&str; 5] = [
    "leak",
    "valve-dead-zone",
    "pressure-sensor-gain",
    "payload",
    "hysteresis",
];

/// A record of 12 s: steps of the reference that lift and lower the weight, with noise.
fn record(rig: &Rig, seed: u64) -> Record {
    let time_s: Vec<f64> = (0..1200).map(|row| 0.01 * f64::from(row)).collect();
    let steps_pa = [2.0e5, 2.6e5, 3.2e5, 2.4e5, 3.6e5, 2.2e5, 3.0e5, 2.5e5];
    let reference_pa = |t: &f64| steps_pa[(t / 1.5 + seed as f64) as usize % steps_pa.len()];
    let mut drive = Record::new(time_s.clone());
    drive.set(PRESSURE_REF_PA, time_s.iter().map(reference_pa).collect());
    drive.set(PRESSURE_PA, vec![reference_pa(&0.0); time_s.len()]);
    drive.set(CONTRACTION, vec![0.1; time_s.len()]);
    let mut measured = simulate(rig, &drive, TOLERANCE).expect("a simulation");
    let mut random = Pcg64::seed_from_u64(seed);
    for (name, sigma) in [
        (PRESSURE_PA, PRESSURE_NOISE_PA),
        (CONTRACTION, CONTRACTION_NOISE),
    ] {
        let noise = Normal::new(0.0, sigma).expect("a spread");
        let values = measured.column(name).expect("the column").iter();
        let noisy = values.map(|value| value + noise.sample(&mut random));
        let noisy = noisy.collect();
        measured.set(name, noisy);
    }
    measured
}

fn of(effect: &str) -> Vec<Hypothesis> {
    let truth = rig(effect);
    let records = [record(&truth, 1), record(&truth, 2)];
    let nominal = rig("");
    let names = nominal.catalogue.kinds().map(|kind| kind.name);
    let without = names.filter(|name| !TRIED.contains(name)).map(String::from);
    let without: Vec<String> = without.collect();
    let posterior = hypotheses(&nominal, &records, &without).expect("a posterior");
    assert_eq!(posterior.warnings, [""; 0]);
    posterior.hypotheses
}

#[test]
fn a_rig_that_lacks_nothing_most_probably_does() {
    let hypotheses = of("");
    assert_eq!(hypotheses[0].effects, [""; 0]);
    assert_eq!(hypotheses[0].unknown, [""; 0]);
    assert!(hypotheses[0].probability > 0.9, "{hypotheses:?}");
    let sum: f64 = hypotheses.iter().map(|own| own.probability).sum();
    assert!((sum - 1.0).abs() < 1e-3, "{sum}");
}

/// A steady error of 14 kPa at 3 bar.
#[test]
fn a_leak_is_the_most_probable_effect() {
    let leak = "[[effect]]\nname = \"leak\"\nform = \"linear\"\nconductance_kg_per_pa_s = 4e-9\n";
    let hypotheses = of(leak);
    assert_eq!(hypotheses[0].effects, ["leak"]);
    assert!(hypotheses[0].probability > 0.9, "{hypotheses:?}");
}

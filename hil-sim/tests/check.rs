//! `check` reports each defect in a record that has it, and none in a record without defects.

use hil_sim::record::check::{Check, Finding, check};
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record, VALVE_OPEN};
use hil_sim::rig::Rig;
use muscle_plant::effects::Catalogue;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use std::process::Command;

const NOISE_N: f64 = 0.8;
const STEP_PA: f64 = 244.14;
const PERIOD_S: f64 = 0.01;

/// A bench with steps, holds and a vented zero: pressure in steps of its sensor, force with noise.
struct Bench {
    time_s: Vec<f64>,
    reference_pa: Vec<f64>,
    pressure_pa: Vec<f64>,
    contraction: Vec<f64>,
    force_n: Vec<f64>,
}

impl Bench {
    fn new(rows: usize) -> Bench {
        let mut noise = Pcg64::seed_from_u64(5);
        let normal = Normal::new(0.0, 1.0).expect("a spread");
        let mut draw = |sigma: f64| sigma * normal.sample(&mut noise);
        let mut bench = Bench {
            time_s: (0..rows).map(|row| row as f64 * PERIOD_S).collect(),
            reference_pa: Vec::new(),
            pressure_pa: Vec::new(),
            contraction: Vec::new(),
            force_n: Vec::new(),
        };
        let mut pressure_pa = 0.0;
        for row in 0..rows {
            let reference_pa = [0.0, 3e5, 1.5e5, 4e5][row / 1200 % 4];
            pressure_pa += (reference_pa - pressure_pa) * PERIOD_S / 0.08;
            let contraction = 0.1 + 0.1 * (0.5 * bench.time_s[row]).sin();
            let force_n = 1e-3 * pressure_pa * (1.0 - contraction);
            bench.reference_pa.push(reference_pa);
            let read_pa = ((pressure_pa + draw(150.0)) / STEP_PA).round() * STEP_PA;
            bench.pressure_pa.push(read_pa);
            bench.contraction.push((contraction * 3e4).round() / 3e4);
            bench.force_n.push(force_n + draw(NOISE_N));
        }
        bench
    }

    fn record(self) -> Record {
        let mut record = Record::new(self.time_s);
        record.set(PRESSURE_REF_PA, self.reference_pa);
        record.set(PRESSURE_PA, self.pressure_pa);
        record.set(CONTRACTION, self.contraction);
        record.set(FORCE_N, self.force_n);
        record
    }

    fn check(self) -> Check {
        check(&self.record())
    }
}

fn only(found: &[Finding]) -> &Finding {
    assert_eq!(found.len(), 1, "{found:?}");
    &found[0]
}

#[test]
fn a_clean_record_has_no_findings() {
    let check = Bench::new(4800).check();
    assert!(
        check.errors.is_empty() && check.warnings.is_empty(),
        "{check:?}"
    );
    assert_eq!(check.sampling.rows, 4800);
    assert!((check.sampling.period_s - PERIOD_S).abs() < 1e-9 && check.sampling.jitter < 1e-6);
    let force = check.signal(FORCE_N).expect("the column");
    assert!((force.noise / NOISE_N - 1.0).abs() < 0.1, "{force:?}");
    assert!(force.quantum.is_none());
    let pressure = check.signal(PRESSURE_PA).expect("the column");
    assert!((pressure.quantum.expect("a step") - STEP_PA).abs() < 1e-6);
    assert!(pressure.noise >= STEP_PA / 12.0_f64.sqrt() && pressure.noise < 2.0 * STEP_PA);
    // 0 → 300 → 150 → 400 kPa, each held for 12 s.
    let reference = check.signal(PRESSURE_REF_PA).expect("the column");
    assert_eq!((reference.steps, reference.reversals), (3, 2));
    assert!(
        (reference.longest_hold_s - 12.0).abs() < 0.2,
        "{reference:?}"
    );
    assert_eq!(reference.noise, 0.0);
    // 48 s of a sine of 0.5 rad/s: the eighth turn, at 47.1 s, has not gone back far.
    let contraction = check.signal(CONTRACTION).expect("the column");
    assert_eq!(contraction.reversals, 7);
    // Its rate is 0.05/s times a cosine, and 5 % of the time above the cosine of 4.5°.
    assert!(
        (contraction.rate_per_s / 0.05 - 1.0).abs() < 0.02,
        "{contraction:?}"
    );
}

/// The effects of muscle-plant that a record hardly shows, of a rig with a weight.
fn blind_to(check: &Check) -> [Vec<String>; 3] {
    let blocks = check.subsystems(&Catalogue::standard(), Some(&Rig::reference()));
    [0, 1, 2].map(|block| blocks[block].blind_to.clone())
}

#[test]
fn subsystems_report_missing_signals() {
    let subsystems =
        |check: &Check, rig: Option<&Rig>| check.subsystems(&Catalogue::standard(), rig);
    let enough = |check: &Check, rig: Option<&Rig>| {
        let blocks = subsystems(check, rig);
        [0, 1, 2].map(|block| blocks[block].enough)
    };
    let rig = Rig::reference();
    let whole = Bench::new(4800).check();
    assert_eq!(enough(&whole, None), [true, true, false]);
    assert_eq!(enough(&whole, Some(&rig)), [true, true, true]);

    let bench = Bench::new(4800);
    let mut without = Record::new(bench.time_s);
    without.set(PRESSURE_PA, bench.pressure_pa);
    without.set(CONTRACTION, bench.contraction);
    let without = check(&without);
    assert_eq!(enough(&without, None), [false, false, false]);
    assert_eq!(enough(&without, Some(&rig)), [false, true, true]);
    assert_eq!(subsystems(&without, None)[0].missing, ["pressure_ref_pa"]);

    let mut short = Bench::new(99).check();
    assert_eq!(enough(&short, Some(&rig)), [false; 3]);
    short.errors.clear();
    assert!(
        !subsystems(&short, None)[0].enough,
        "the pressure has not moved"
    );
}

#[test]
fn effects_that_a_record_hardly_shows_are_listed_with_what_is_missing() {
    let supply = "flow-limit, supply-droop: hard to distinguish without supply_pa";
    let [gas, force, load] = blind_to(&Bench::new(4800).check());
    assert_eq!(gas, [supply]);
    assert!(force.is_empty() && load.is_empty(), "{force:?} {load:?}");

    let mut clamped = Bench::new(2400);
    clamped.contraction.fill(0.1);
    let [_, force, load] = blind_to(&clamped.check());
    assert_eq!(
        force,
        [
            "hysteresis, backlash, what else depends on the contraction: one contraction only",
            "hysteresis, backlash: the contraction does not reverse twice",
            "run-in: fewer than three cycles",
        ]
    );
    assert!(load.is_empty(), "it cannot be diagnosed at all: {load:?}");

    // All but motion: a slow rise, a row each 30 ms, from a pressure that lifts the weight.
    let shares: Vec<f64> = (0..1000).map(|row| f64::from(row) / 1e3).collect();
    let rise = |from: f64, to: f64| shares.iter().map(|s| from + (to - from) * s).collect();
    let mut slow = Record::new(shares.iter().map(|share| 30.0 * share).collect());
    slow.set(PRESSURE_REF_PA, rise(2e5, 3e5));
    slow.set(PRESSURE_PA, rise(2e5, 3e5));
    slow.set(CONTRACTION, rise(0.1, 0.2));
    let rows = "nothing shorter than two rows, with one every 30 ms";
    let vented = "hard to distinguish, never vented (below 8 kPa)";
    let [gas, force, load] = blind_to(&check(&slow));
    assert_eq!(
        gas,
        [
            supply.to_owned(),
            format!("valve-lag, transport-delay, line-dynamics: {rows}"),
            "flow-limit, valve-lag, transport-delay, heat-exchange: no step of the reference"
                .to_owned(),
            "valve-dead-zone, leak: no hold of the reference for 10 s".to_owned(),
            format!("pressure-sensor-offset, contraction-sensor-offset: {vented}"),
            "backlash: the contraction does not reverse twice".to_owned(),
        ]
    );
    assert_eq!(
        force,
        [
            "force-sensor-offset, muscle against load: no force_n".to_owned(),
            format!("line-dynamics: {rows}"),
            "creep: no hold of the pressure for 10 s".to_owned(),
            format!(
                "dead-band, slack, pressure-sensor-offset, contraction-sensor-offset, \
                 force-sensor-offset: {vented}"
            ),
            "hysteresis, backlash: the contraction does not reverse twice".to_owned(),
            "run-in: fewer than three cycles".to_owned(),
        ]
    );
    assert_eq!(
        load,
        [
            "force-sensor-offset: no force_n".to_owned(),
            format!("contraction-sensor-offset, force-sensor-offset: {vented}"),
            "friction, backlash: the contraction does not reverse twice".to_owned(),
        ]
    );
    // A shut valve holds the gas as a held reference does.
    slow.set(
        VALVE_OPEN,
        shares.iter().map(|share| f64::from(*share < 0.5)).collect(),
    );
    let [shut, ..] = blind_to(&check(&slow));
    assert!(gas.iter().any(|lack| lack.contains("leak")));
    assert!(!shut.iter().any(|lack| lack.contains("leak")), "{shut:?}");
}

#[test]
fn a_record_that_is_too_short_is_an_error() {
    let few = Bench::new(99).check();
    assert!(few.errors.contains(&Finding::FewRows { rows: 99 }));
    let bench = Bench::new(150);
    let mut fast = Record::new(bench.time_s.iter().map(|time_s| 0.1 * time_s).collect());
    fast.set(PRESSURE_PA, bench.pressure_pa);
    fast.set(FORCE_N, bench.force_n);
    assert!(matches!(only(&check(&fast).errors), Finding::Short { .. }));
    assert!(Bench::new(150).check().errors.is_empty());
}

#[test]
fn missing_signals_are_errors() {
    let mut empty = Bench::new(2400);
    empty.force_n = vec![f64::NAN; 2400];
    assert_eq!(
        only(&empty.check().errors),
        &Finding::Empty { signal: FORCE_N }
    );

    let bench = Bench::new(2400);
    let mut inputs = Record::new(bench.time_s.clone());
    inputs.set(CONTRACTION, bench.contraction);
    assert_eq!(only(&check(&inputs).errors), &Finding::NoInput);
    let mut inputs = Record::new(bench.time_s);
    inputs.set(PRESSURE_PA, bench.pressure_pa);
    assert_eq!(only(&check(&inputs).errors), &Finding::NoResponse);
    inputs.set(PRESSURE_REF_PA, bench.reference_pa);
    assert!(
        check(&inputs).errors.is_empty(),
        "the pressure follows its reference"
    );
}

#[test]
fn a_constant_sensor_is_an_error_if_another_signal_must_change_it() {
    let mut dead = Bench::new(2400);
    dead.pressure_pa.fill(1e5);
    let record = dead.record();
    let found = check(&record);
    let Finding::Dead {
        signal,
        while_moves,
        ..
    } = only(&found.errors)
    else {
        panic!("{found:?}");
    };
    assert_eq!((*signal, *while_moves), (PRESSURE_PA, PRESSURE_REF_PA));
    let refusal = found.refuse(&record).expect_err("an error").to_string();
    assert_eq!(
        refusal,
        "record: column `pressure_pa`: expected samples that change, as `pressure_ref_pa` does, \
         found 100000 throughout"
    );

    // A clamped muscle: the force follows the pressure.
    let mut clamped = Bench::new(2400);
    clamped.contraction.fill(0.1);
    let found = clamped.check();
    assert!(found.errors.is_empty());
    let constant = Finding::Constant {
        signal: CONTRACTION,
        value: 0.1,
    };
    assert_eq!(only(&found.warnings), &constant);

    // A weight on its stop: the pressure follows its reference.
    let mut rests = Bench::new(2400);
    rests.contraction.fill(0.0);
    rests.force_n.fill(3.0);
    let rests = rests.record();
    assert!(check(&rests).errors.is_empty());
    let mut undriven = Record::new(rests.time_s().to_vec());
    for name in [PRESSURE_PA, CONTRACTION, FORCE_N] {
        undriven.set(name, rests.column(name).expect("the column").to_vec());
    }
    assert_eq!(
        check(&undriven).errors.len(),
        2,
        "nothing follows the pressure"
    );

    // Only noise: a warning.
    let mut still = Bench::new(2400);
    let noise: Vec<f64> = Bench::new(600).force_n;
    still.force_n = noise.iter().cycle().take(2400).copied().collect();
    assert_eq!(
        only(&still.check().warnings),
        &Finding::Still { signal: FORCE_N }
    );
}

#[test]
fn gaps_and_uneven_and_slow_sampling_are_reported() {
    let mut gap = Bench::new(2400);
    for time_s in &mut gap.time_s[1000..] {
        *time_s += 0.25;
    }
    let Finding::Gaps {
        count: 1,
        first_s,
        longest_s,
    } = *only(&gap.check().warnings)
    else {
        panic!("a gap");
    };
    assert!((first_s - 9.99).abs() < 1e-9 && (longest_s - 0.26).abs() < 1e-9);
    let mut one_missed = Bench::new(2400);
    for time_s in &mut one_missed.time_s[1000..] {
        *time_s += PERIOD_S;
    }
    assert!(matches!(
        only(&one_missed.check().warnings),
        Finding::Gaps { count: 1, .. }
    ));

    // Each other row is late by a quarter of the period.
    let mut uneven = Bench::new(2400);
    for time_s in uneven.time_s.iter_mut().step_by(2) {
        *time_s += 0.25 * PERIOD_S;
    }
    assert!(matches!(
        only(&uneven.check().warnings),
        Finding::Uneven { .. }
    ));

    let mut slow = Bench::new(2400);
    for time_s in &mut slow.time_s {
        *time_s *= 3.0;
    }
    let found = slow.check();
    assert!(found.warnings.contains(&Finding::Slow {
        period_s: found.sampling.period_s
    }));
}

#[test]
fn missing_samples_are_reported() {
    let mut missing = Bench::new(2400);
    missing.force_n[100..124].fill(f64::NAN);
    let Finding::Missing {
        signal: FORCE_N,
        share,
        longest_gap_s,
    } = *only(&missing.check().warnings)
    else {
        panic!("missing samples");
    };
    assert!((share - 0.01).abs() < 1e-9 && (longest_gap_s - 0.25).abs() < 1e-9);
}

#[test]
fn clipping_is_distinguished_from_rest() {
    // The amplifier saturates at 250 N.
    let mut clipped = Bench::new(4800);
    for force_n in &mut clipped.force_n {
        *force_n = force_n.min(250.0);
    }
    let found = clipped.check();
    let Finding::Clipped {
        signal: FORCE_N,
        value: 250.0,
        share,
    } = *only(&found.warnings)
    else {
        panic!("{found:?}");
    };
    assert!((0.25..0.5).contains(&share), "{share}");
    let noise = found.signal(FORCE_N).expect("the column").noise;
    assert!(
        (noise / NOISE_N - 1.0).abs() < 0.15,
        "of the samples that are not clipped: {noise}"
    );
    // An encoder without noise may rest at the end of its range.
    let mut rests = Bench::new(4800);
    for contraction in &mut rests.contraction {
        *contraction = contraction.min(0.15);
    }
    assert!(rests.check().warnings.is_empty());
}

#[test]
fn spikes_are_distinguished_from_steps() {
    let mut spiky = Bench::new(2400);
    spiky.force_n[700] += 60.0;
    spiky.force_n[900] -= 60.0;
    let spikes = Finding::Spikes {
        signal: FORCE_N,
        count: 2,
        first_s: spiky.time_s[700],
    };
    assert_eq!(only(&spiky.check().warnings), &spikes);
    let mut step = Bench::new(2400);
    for force_n in &mut step.force_n[700..] {
        *force_n += 60.0;
    }
    assert!(step.check().warnings.is_empty());
}

#[test]
fn a_coarse_sensor_is_reported() {
    let mut coarse = Bench::new(4800);
    for force_n in &mut coarse.force_n {
        *force_n = (*force_n / 20.0).round() * 20.0;
    }
    let found = coarse.check();
    assert!(
        matches!(
            only(&found.warnings),
            Finding::Coarse {
                signal: FORCE_N,
                ..
            }
        ),
        "{found:?}"
    );
    let noise = found.signal(FORCE_N).expect("the column").noise;
    assert!((noise - 20.0 / 12.0_f64.sqrt()).abs() < 1e-9);
}

#[test]
fn the_command_prints_findings_as_text_and_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bench.csv");
    let mut bench = Bench::new(2400);
    bench.pressure_pa.fill(1e5);
    bench.record().write(&path).expect("written");
    let run = |more: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .current_dir(folder.path())
            .args(["check", "bench.csv"])
            .args(more)
            .output()
            .expect("the command runs");
        assert!(output.status.success());
        String::from_utf8(output.stdout).expect("text")
    };
    let words = run(&[]);
    let error = "Error: `pressure_pa` is 100000 throughout, while `pressure_ref_pa` changes.";
    assert!(words.contains(error), "{words}");
    let json: serde_json::Value = serde_json::from_str(&run(&["--json"])).expect("JSON");
    assert_eq!(json["errors"][0]["finding"], "dead");
    assert_eq!(json["errors"][0]["signal"], "pressure_pa");
    assert_eq!(json["sampling"]["rows"], 2400);
    assert_eq!(json["blocks"][0]["enough"], false);
}

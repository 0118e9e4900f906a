//! The drive of an experiment stays within the rig's limits, and moves what it says.

use hil_sim::bench::test_signal::{Limits, Part, test_signal};
use hil_sim::identify::simulate::simulate;
use hil_sim::record::check::check;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use muscle_plant::simulation::TOLERANCE;

const CONTRACTION_MAX: f64 = 0.3;

fn rig() -> Rig {
    Rig::reference()
}

fn drive(parts: &[Part]) -> (Limits, Record) {
    let limits = Limits::of(&rig(), CONTRACTION_MAX).expect("limits");
    (limits, test_signal(&limits, parts).record)
}

fn reference(record: &Record) -> &[f64] {
    record.column(PRESSURE_REF_PA).expect("the column")
}

#[test]
fn the_limits_are_the_rigs() {
    let limits = Limits::of(&rig(), CONTRACTION_MAX).expect("limits");
    // 12 kg leave the stop at 126.3 kPa without friction; 7 N of it are 2.9 kPa more.
    assert!((limits.low_pa - 1.293e5).abs() < 500.0, "{limits:?}");
    // Eq 1 with 12 kg at 0.3, below 95 % of 500 kPa.
    let high_pa = (12.0 * 9.80665 + 183.0) / (3.7718e-3 * 0.49 - 1.39e-3);
    assert!(high_pa > 4.75e5 && limits.high_pa == 4.75e5, "{limits:?}");
    let less = Limits::of(&rig(), 0.2).expect("limits");
    let at_fifth_pa = (12.0 * 9.80665 + 183.0) / (3.7718e-3 * 0.64 - 1.39e-3);
    assert!((less.high_pa - at_fifth_pa).abs() <= 1.0, "{less:?}");

    let with = |from: &str, to: &str| {
        let text = Rig::REFERENCE_TOML.replace(from, to);
        Limits::of(
            &Rig::parse("rig.toml", &text).expect("a rig"),
            CONTRACTION_MAX,
        )
    };
    let heavy = with("mass_kg = 12.0", "mass_kg = 120.0")
        .expect_err("too heavy")
        .to_string();
    assert!(
        heavy.contains("key `valve.supply_pressure_pa`: expected a supply that"),
        "{heavy}"
    );
    let bench = with("kind = \"weight\"", "kind = \"prescribed\"").expect("limits");
    assert_eq!((bench.low_pa, bench.high_pa), (0.0, 4.75e5));
}

#[test]
fn pressure_and_its_rate_stay_within_the_limits_and_both_ends_are_vented() {
    for parts in [&Part::DEFAULT[..], &[Part::ShutHolds]] {
        let (mut limits, _) = drive(&[]);
        for rate_pa_per_s_max in [None, Some(1e5)] {
            limits.rate_pa_per_s_max = rate_pa_per_s_max;
            let record = test_signal(&limits, parts).record;
            let reference_pa = reference(&record);
            assert_eq!(
                (reference_pa[0], reference_pa[reference_pa.len() - 1]),
                (0.0, 0.0)
            );
            assert!(
                reference_pa
                    .iter()
                    .all(|pa| (0.0..=limits.high_pa).contains(pa))
            );
            assert!(reference_pa.windows(2).all(|pair| {
                let most_pa = 0.01 * limits.rate_pa_per_s(pair[0]);
                (pair[1] - pair[0]).abs() <= most_pa
            }));
            assert!(
                reference_pa.iter().all(|pa| pa.fract() == 0.0),
                "whole pascals are read"
            );
        }
    }
}

/// The nominal rig, which is damped less than a real one.
#[test]
fn the_weight_is_neither_thrown_nor_dropped() {
    let (limits, drive) = drive(&Part::DEFAULT);
    let mut begin = Record::new(drive.time_s().to_vec());
    begin.set(PRESSURE_REF_PA, reference(&drive).to_vec());
    for name in [PRESSURE_PA, CONTRACTION] {
        begin.set(name, vec![0.0; drive.time_s().len()]);
    }
    let simulated = simulate(&rig(), &begin, TOLERANCE).expect("a simulation");
    let contraction = simulated.column(CONTRACTION).expect("the column");
    let greatest = contraction.iter().copied().fold(0.0, f64::max);
    assert!(greatest <= CONTRACTION_MAX, "{greatest}");
    assert!(
        greatest > 0.8 * CONTRACTION_MAX,
        "{greatest}: the range is made use of"
    );
    let force_n = simulated.column(FORCE_N).expect("the column");
    // Off its stop the weight hangs on the muscle.
    let lifted = force_n
        .iter()
        .zip(contraction)
        .filter(|(_, contraction)| **contraction > 0.005);
    assert!(lifted.clone().count() > 20_000);
    assert!(
        lifted
            .map(|(force_n, _)| *force_n)
            .fold(f64::INFINITY, f64::min)
            > 0.0
    );

    // What is simulated here is what a diagnosis wants.
    let found = check(&simulated);
    assert!(found.errors.is_empty());
    for block in found.subsystems(Some(&rig())) {
        assert!(block.enough, "{block:?}");
        let blind = block
            .blind_to
            .iter()
            .filter(|why| !why.ends_with("supply_pa"));
        assert_eq!(blind.count(), 0, "{block:?}");
    }
    assert!(limits.low_pa < limits.high_pa);
}

#[test]
fn each_part_does_what_it_is_for() {
    let (_, zero) = drive(&[Part::Zero]);
    assert!(zero.time_s().len() > 1000 && reference(&zero).iter().all(|pa| *pa == 0.0));

    let look = |part: Part| {
        let (limits, record) = drive(&[part]);
        let found = check(&{
            let mut record = record.clone();
            record.set(PRESSURE_PA, reference(&record).to_vec());
            record
        });
        (
            limits,
            record,
            found.signal(PRESSURE_REF_PA).expect("the column").clone(),
        )
    };
    // Twelve legs, half of them with a minor loop that turns twice; the last leg goes on to zero.
    let (limits, _, signal) = look(Part::Triangles);
    assert_eq!(signal.reversals, 11 + 6 * 2);
    assert_eq!((signal.min, signal.max), (0.0, limits.high_pa));
    let (_, _, signal) = look(Part::Holds);
    assert!((59.0..61.0).contains(&signal.longest_hold_s), "{signal:?}");
    assert!(signal.steps >= 4, "{signal:?}");
    let (_, record, _) = look(Part::ShutHolds);
    let shut = record.shut();
    assert_eq!(shut.iter().filter(|shut| **shut).count(), 4 * 6000);
    let rows = reference(&record).windows(2).zip(&shut[1..]);
    let held = rows
        .filter(|(_, shut)| **shut)
        .all(|(pair, _)| pair[0] == pair[1]);
    assert!(held, "with the cock shut the reference rests");
    let (limits, _, signal) = look(Part::Sweep);
    assert!(
        signal.steps >= 8 && signal.max < limits.high_pa,
        "{signal:?}"
    );
    assert!(drive(&Part::DEFAULT).1.shut().is_empty());
}

//! Test signals stay within the rig's limits, and contain the motions of their parts.

use hil_sim::bench::test_signal::{Limits, Part, TestSignal, test_signal};
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
fn limits_follow_from_the_rig() {
    let limits = Limits::of(&rig(), CONTRACTION_MAX).expect("limits");
    // 12 kg leave the stop at 126.3 kPa without friction; 7 N of friction add 2.9 kPa.
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
                "whole pascals"
            );
        }
    }
}

/// On the nominal rig, which has less damping than a real one.
#[test]
fn the_weight_is_neither_thrown_nor_dropped() {
    let limits = Limits::of(&rig(), CONTRACTION_MAX).expect("limits");
    let TestSignal {
        record: drive,
        parts,
    } = test_signal(&limits, &Part::DEFAULT);
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
        "{greatest}: the range is not used"
    );
    let force_n = simulated.column(FORCE_N).expect("the column");
    // Off its stop the weight hangs on the muscle, and the rope stays taut. Triangles and holds
    // begin with 6 s towards the lowest pressure, at which it rests, and the signal ends with 4 s
    // towards none. In between it stays off, but for the first second of the slowest rise, which
    // takes 16 s.
    let is_lifted = |row: usize| contraction[row] > 0.005;
    let rows = force_n.len();
    assert!((0..rows).all(|row| !is_lifted(row) || force_n[row] > 0.0));
    let start_s = |wanted| {
        let part = parts.iter().find(|(part, _)| *part == wanted);
        part.expect("the part").1
    };
    let end_s = drive.time_s()[rows - 1];
    for (from_s, to_s) in [
        (start_s(Part::Triangles), start_s(Part::Holds)),
        (start_s(Part::Holds), end_s - 4.0),
    ] {
        let between = from_s + 6.0 + 1.0..to_s;
        let rests =
            (0..rows).find(|row| between.contains(&drive.time_s()[*row]) && !is_lifted(*row));
        assert_eq!(rests.map(|row| drive.time_s()[row]), None);
    }

    // The simulated record is sufficient for a diagnosis.
    let found = check(&simulated);
    assert!(found.errors.is_empty());
    for block in found.subsystems(&rig().catalogue, Some(&rig())) {
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
fn each_part_contains_its_motions() {
    let (_, zero) = drive(&[Part::Zero]);
    // 2 s to zero, 10 s there, and at the end 2 s to zero and 2 s there.
    assert_eq!(zero.time_s().len(), (2 + 10 + 2 + 2) * 100 + 1);
    assert!(reference(&zero).iter().all(|pa| *pa == 0.0));

    let checked = |part: Part| {
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
    // Twelve ramps, half of them with a minor loop of two reversals; the last ramp continues to
    // zero.
    let (limits, _, signal) = checked(Part::Triangles);
    assert_eq!(signal.reversals, 11 + 6 * 2);
    assert_eq!((signal.min, signal.max), (0.0, limits.high_pa));
    let (_, _, signal) = checked(Part::Holds);
    assert!((59.0..61.0).contains(&signal.longest_hold_s), "{signal:?}");
    assert_eq!(signal.steps, 4, "one for each hold");
    let (_, record, _) = checked(Part::ShutHolds);
    let shut = record.shut();
    assert_eq!(shut.iter().filter(|shut| **shut).count(), 4 * 6000);
    let rows = reference(&record).windows(2).zip(&shut[1..]);
    let held = rows
        .filter(|(_, shut)| **shut)
        .all(|(pair, _)| pair[0] == pair[1]);
    assert!(
        held,
        "the reference changes while the shut-off valve is shut"
    );
    let (limits, _, signal) = checked(Part::Sweep);
    // Five sizes, of which the largest ends at the maximum, 36 kPa off the middle; of the middle
    // one, a quarter, each step from side to side is more than 5 % of the maximum. Four each of the
    // three largest, and the return.
    assert_eq!(signal.steps, 3 * 4 + 1);
    assert!(signal.max < limits.high_pa, "{signal:?}");
    assert!(drive(&Part::DEFAULT).1.shut().is_empty());
}

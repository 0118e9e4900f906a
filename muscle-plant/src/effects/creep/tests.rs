use super::super::testing::{
    CLAMPED, Inputs, STEP_S, added_n, assert_near, bench, effect, largest_difference, through,
};
use super::KIND;

/// A step over one row at 1 s.
fn step(from: f64, to: f64) -> impl Fn(f64) -> f64 {
    through([(0.0, from), (1.0, from), (1.0 + STEP_S, to)])
}

fn pressure_step(step_s: f64, rows: usize) -> Inputs {
    bench(step_s, rows, |_| 0.1, step(1e5, 4e5))
}

fn strain_step(step_s: f64, rows: usize) -> Inputs {
    bench(step_s, rows, step(0.0, 0.125), |_| 2e5)
}

/// Force per pressure at a contraction of 0.1, relative to that at no contraction.
fn braid() -> f64 {
    let muscle = CLAMPED.muscle;
    muscle.force_per_pressure_m2(0.1) / muscle.force_per_pressure_m2(0.0)
}

/// After a step over one row of h the force lacks size · (1 − e^(−h/τ))/(h/τ), which decays as
/// e^(−t/τ).
#[test]
fn relaxations_decay_after_a_step() {
    let (size_n, time_constant_s) = (15.0, 2.0);
    let remaining = |since_s: f64, time_constant_s: f64| {
        let relative = STEP_S / time_constant_s;
        -(-relative).exp_m1() / relative * (-(since_s - STEP_S) / time_constant_s).exp()
    };
    let one = [("force_n", size_n), ("time_constant_s", time_constant_s)];
    let two = [
        ("force_n", 0.5 * size_n),
        ("time_constant_s", 0.5),
        ("second_force_n", 0.5 * size_n),
        ("second_time_constant_s", 20.0),
    ];
    let pressure = || (pressure_step(STEP_S, 501), braid());
    let strain = || (strain_step(STEP_S, 501), 0.5);
    for (form, parameters, (inputs, share), times_s) in [
        ("relaxation", &one[..], pressure(), [time_constant_s; 2]),
        ("two-relaxations", &two[..], pressure(), [0.5, 20.0]),
        (
            "strain-relaxation",
            &one[..],
            strain(),
            [time_constant_s; 2],
        ),
        ("two-strain-relaxations", &two[..], strain(), [0.5, 20.0]),
    ] {
        let added = added_n(&effect(&KIND, form, parameters), &inputs);
        assert_near(added[50], 0.0, 1e-4, form);
        for row in [101, 150, 300, 500] {
            let since_s = (row as f64 - 100.0) * STEP_S;
            let sum: f64 = times_s
                .map(|time_s| remaining(since_s, time_s))
                .iter()
                .sum();
            assert_near(added[row], -0.5 * size_n * share * sum, 1e-4, form);
        }
    }
}

/// Within the range of their time constants, branches a decade apart follow the logarithm to 8 % of
/// the drift in a decade.
#[test]
fn logarithmic_creep_drifts_by_the_same_force_in_each_decade() {
    let row = |since_s: f64| ((since_s + 1.0) / 0.1_f64).round() as usize;
    let pressure = [("force_per_decade_n", 10.0)];
    let strain = [
        ("force_per_decade_n", 10.0),
        ("shortest_time_constant_s", 0.5),
        ("longest_time_constant_s", 500.0),
    ];
    for (form, parameters, inputs, expected_n) in [
        (
            "logarithmic",
            &pressure[..],
            pressure_step(0.1, 2001),
            10.0 * braid(),
        ),
        (
            "logarithmic-strain",
            &strain[..],
            strain_step(0.1, 2001),
            5.0,
        ),
    ] {
        let added = added_n(&effect(&KIND, form, parameters), &inputs);
        for (from_s, to_s) in [(1.0, 10.0), (3.0, 30.0), (10.0, 100.0), (19.0, 190.0)] {
            let drift_n = added[row(to_s)] - added[row(from_s)];
            assert_near(drift_n, expected_n, 0.08 * expected_n, form);
        }
    }
}

#[test]
fn two_relaxations_with_a_second_size_of_zero_are_one() {
    let first = [("force_n", 20.0), ("time_constant_s", 3.0)];
    let none = [("second_force_n", 0.0), ("second_time_constant_s", 15.0)];
    let lift = through([(0.0, 0.0), (5.0, 0.2)]);
    let inputs = bench(STEP_S, 501, lift, through([(0.0, 1e5), (5.0, 4e5)]));
    for [single, double] in [
        ["relaxation", "two-relaxations"],
        ["strain-relaxation", "two-strain-relaxations"],
    ] {
        let two = effect(&KIND, double, &[&first[..], &none[..]].concat());
        let one_n = added_n(&effect(&KIND, single, &first), &inputs);
        assert_eq!(one_n, added_n(&two, &inputs), "{double}");
        assert!(largest_difference(&one_n, &vec![0.0; 501]) > 1.0);
    }
}

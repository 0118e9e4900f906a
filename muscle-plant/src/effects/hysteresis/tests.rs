use super::super::testing::{
    Inputs, STEP_S, added_n, assert_near, bench, driven, effect, largest_difference, run, through,
};
use super::KIND;
use crate::effects::Effect;
use crate::nominal::{Load, Nominal};
use crate::subsystem::load::GRAVITY_M_PER_S2;

const FORCE_N: f64 = 20.0;
const PRESLIDING: f64 = 0.03;
const ASYMMETRY: f64 = 1.5;

/// Contracts, extends, contracts again, with a minor loop on the way.
const STROKES: [(f64, f64); 6] = [
    (0.0, 0.0),
    (1.0, 0.15),
    (2.0, 0.05),
    (2.4, 0.09),
    (2.8, 0.05),
    (4.0, 0.15),
];

fn strokes(pressure_pa: f64) -> Inputs {
    bench(STEP_S, 401, through(STROKES), |_| pressure_pa)
}

fn hysteresis(form: &str, parameters: &[(&str, f64)], base_share: f64) -> Effect {
    let common = [
        ("force_n", FORCE_N),
        ("reach", PRESLIDING),
        ("base_share", base_share),
    ];
    effect(&KIND, form, &[&common, parameters].concat())
}

/// Each form with its name and its bound while extending, relative to that while contracting.
fn forms(base_share: f64) -> [(&'static str, Effect, f64); 3] {
    let with = |form, parameters: &[(&str, f64)]| hysteresis(form, parameters, base_share);
    [
        (
            "maxwell-slip",
            with("maxwell-slip", &[("spread", 2.0), ("taper", 0.5)]),
            1.0,
        ),
        ("bouc-wen", with("bouc-wen", &[("sharpness", 2.0)]), 1.0),
        (
            "duhem",
            with("duhem", &[("asymmetry", ASYMMETRY)]),
            ASYMMETRY,
        ),
    ]
}

#[test]
fn hysteresis_depends_on_the_path_and_not_on_the_speed() {
    for (form, effect, _) in forms(0.0) {
        let fast = bench(0.1 * STEP_S, 401, |t| through(STROKES)(10.0 * t), |_| 3e5);
        let (slow_n, fast_n) = (added_n(&effect, &strokes(3e5)), added_n(&effect, &fast));
        let difference_n = largest_difference(&slow_n, &fast_n);
        assert!(difference_n < 1e-4, "{form}: {difference_n}");
    }
}

#[test]
fn hysteresis_opposes_the_motion_in_proportion_to_pressure() {
    for (form, effect, extending) in forms(0.0) {
        let [low_n, high_n] = [1e5, 3e5].map(|pressure_pa| added_n(&effect, &strokes(pressure_pa)));
        let tripled: Vec<f64> = low_n.iter().map(|n| 3.0 * n).collect();
        assert!(largest_difference(&tripled, &high_n) < 1e-5, "{form}");
        // A stroke of five presliding distances: e⁻⁵ of the force is missing at most.
        assert_near(high_n[100], -FORCE_N, 0.01 * FORCE_N, form);
        // After 3.3 of them, or 2.2 where they are longer: both bounds less e⁻²·² of their sum.
        let missing_n = FORCE_N * (1.0 + extending) * (-0.1 / PRESLIDING / extending).exp();
        assert_near(high_n[200], FORCE_N * extending, missing_n, form);
    }
}

/// At a pressure p the force is s + (1 − s) · p / 300 kPa of that at 300 kPa.
#[test]
fn the_base_share_of_the_hysteresis_does_not_need_pressure() {
    for ((form, with, _), (_, without, _)) in forms(0.3).into_iter().zip(forms(0.0)) {
        let expected_n: Vec<f64> = added_n(&without, &strokes(3e5))
            .iter()
            .map(|n| n * (0.3 + 0.7 / 3.0))
            .collect();
        let found_n = added_n(&with, &strokes(1e5));
        assert!(largest_difference(&found_n, &expected_n) < 1e-5, "{form}");
    }
}

/// Each element: 1 − min(x/r, 2) at a distance x from a reversal at its bound, with a height that
/// falls with the taper's power of its threshold r.
#[test]
fn maxwell_slip_is_the_sum_of_its_elements_and_closes_minor_loops() {
    for (spread, taper) in [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0)] {
        let parameters = [("spread", spread), ("taper", taper)];
        let added = added_n(&hysteresis("maxwell-slip", &parameters, 0.0), &strokes(3e5));
        for (row, added) in added.iter().enumerate().take(201).skip(101) {
            let distance = 0.1 * (row - 100) as f64 * STEP_S;
            let threshold = |i: i32| PRESLIDING * f64::powf(spread, f64::from(i) / 5.0 - 0.5);
            let height = |i: i32| threshold(i).powf(-taper);
            let force = |i: i32| height(i) * (1.0 - (distance / threshold(i)).min(2.0));
            let expected_n =
                -FORCE_N * (0..6).map(force).sum::<f64>() / (0..6).map(height).sum::<f64>();
            assert_near(*added, expected_n, 1e-6, "after the reversal");
        }
        assert_near(added[280], added[200], 1e-6, "after the minor loop");
    }
}

#[test]
fn bouc_wen_and_duhem_follow_their_closed_forms() {
    let there_and_back = through([(0.0, 0.0), (1.0, 0.1), (2.0, 0.0)]);
    let inputs = bench(STEP_S, 201, there_and_back, |_| 3e5);
    let contraction = |row: usize| 0.1 * row as f64 * STEP_S;
    let tanh = added_n(&hysteresis("bouc-wen", &[("sharpness", 2.0)], 0.0), &inputs);
    let dahl = added_n(&hysteresis("duhem", &[("asymmetry", 2.0)], 0.0), &inputs);
    for row in 0..=100 {
        let relative = contraction(row) / PRESLIDING;
        assert_near(tanh[row], -FORCE_N * relative.tanh(), 1e-5, "contracting");
        assert_near(
            dahl[row],
            FORCE_N * (-relative).exp_m1(),
            1e-5,
            "contracting",
        );
    }
    for row in 100..=200 {
        let relative = (0.1 - contraction(200 - row)) / PRESLIDING;
        let turned = -dahl[100] / FORCE_N;
        let remaining = (turned + 2.0) * (-relative / 2.0).exp();
        assert_near(dahl[row], -FORCE_N * (remaining - 2.0), 1e-4, "extending");
    }
}

/// The memory at the begin is unknown; a weight at rest determines it.
#[test]
fn a_weight_at_rest_stays_at_rest_with_hysteresis() {
    let nominal = Nominal::REFERENCE;
    let Load::Weight(weight) = nominal.load else {
        panic!("the reference rig has a weight");
    };
    let muscle = nominal.muscle;
    // The pressure at which the weight rests with 10 N of hysteresis, more than its friction.
    let force_n = weight.mass_kg * GRAVITY_M_PER_S2 + 10.0;
    let holding_pa = (force_n - muscle.gamma_n) / muscle.force_per_pressure_m2(0.1);
    let mut inputs = driven(1.0, |_| holding_pa);
    inputs.pressure_pa.fill(holding_pa);
    for (form, effect, _) in forms(0.0) {
        let contraction = run(&nominal, &[effect], &inputs).contraction;
        let start = vec![0.1; contraction.len()];
        assert!(largest_difference(&contraction, &start) < 1e-9, "{form}");
    }
    let moving = run(&nominal, &[], &inputs).contraction;
    assert!(moving[moving.len() - 1] > 0.101);
}

//! Signatures of the muscle's force law, hysteresis, creep and run-in.

use super::{
    Rig, at, bare, draw, force_residual_n, forms, frictionless, holds, isometric, mean, near,
    pieces, residuals_at, with,
};

/// Slow triangles between two pressures.
fn triangles(low_pa: f64, high_pa: f64, leg_s: f64, cycles: usize) -> super::Run {
    let mut all = vec![(1.0, low_pa, low_pa)];
    for _ in 0..cycles {
        all.push((leg_s, low_pa, high_pa));
        all.push((leg_s, high_pa, low_pa));
    }
    pieces(&all)
}

#[test]
fn dead_band_lowers_the_force_by_a_constant_above_its_threshold() {
    let rig = isometric();
    let run = holds(&[(1.0, 0.0), (1.0, 2.0e5), (1.0, 4.0e5)]);
    let area_m2 = rig.alpha_m2 + rig.beta_m2;
    for form in forms("dead-band") {
        let drawn = draw(form, 0.8, &rig);
        let readings = with(&run, &rig, &drawn);
        let lost_n = -area_m2 * drawn.number("threshold_pa");
        near(force_residual_n(&rig, &at(&readings, 0.9)), 0.0, 1e-6);
        // the rounded form's corner adds a twentieth of its threshold
        near(
            force_residual_n(&rig, &at(&readings, 1.9)),
            lost_n,
            0.05 * lost_n.abs(),
        );
        near(
            force_residual_n(&rig, &at(&readings, 2.9)),
            force_residual_n(&rig, &at(&readings, 1.9)),
            1e-3 * lost_n.abs(),
        );
    }
}

#[test]
fn bladder_force_grows_with_contraction_in_either_direction() {
    let rig = frictionless();
    let run = triangles(1.6e5, 4.8e5, 2.0, 1);
    for form in forms("bladder-elasticity") {
        let drawn = draw(form, 0.7, &rig);
        let readings = with(&run, &rig, &drawn);
        let mut before_n = 0.0;
        for contraction in [0.09, 0.13, 0.17] {
            let (inward, outward) = residuals_at(&rig, &readings, contraction);
            near(mean(&inward), mean(&outward), 0.05);
            assert!(mean(&inward) < before_n, "{}", form.name);
            before_n = mean(&inward);
        }
    }
}

#[test]
fn slack_removes_negative_forces() {
    let rig = isometric();
    let run = holds(&[(1.0, 0.0), (1.0, 4.0e5)]);
    let plain = bare(&run, &rig);
    assert!(at(&plain, 0.9).force_n < -180.0);
    for form in forms("slack") {
        let readings = with(&run, &rig, &draw(form, 0.9, &rig));
        let least_n = if form.name == "buckled" {
            -0.1 * 183.0
        } else {
            0.0
        };
        assert!(at(&readings, 0.9).force_n >= least_n, "{}", form.name);
        near(at(&readings, 1.9).force_n, at(&plain, 1.9).force_n, 1e-6);
    }
}

#[test]
fn hysteresis_depends_on_direction_not_on_rate_and_grows_with_pressure() {
    let rig = frictionless();
    for form in forms("hysteresis") {
        let drawn = draw(form, 0.7, &rig);
        let loop_n = |leg_s: f64, rig: &Rig| {
            let readings = with(&triangles(1.8e5, 4.2e5, leg_s, 2), rig, &drawn);
            let (inward, outward) = residuals_at(rig, &readings, 0.15);
            outward.last().expect("a pass") - inward.last().expect("a pass")
        };
        let slow_n = loop_n(4.0, &rig);
        assert!(
            slow_n > 0.5 * drawn.number("half_width_n"),
            "{} {slow_n}",
            form.name
        );
        // what is left of rates: the weight's inertia moves the ends a little
        near(loop_n(2.0, &rig), slow_n, 0.05 * slow_n);
        // a heavier weight needs more pressure at the same contraction
        let heavy_n = loop_n(
            4.0,
            &Rig {
                mass_kg: 15.0,
                ..rig.clone()
            },
        );
        assert!(heavy_n > 1.03 * slow_n, "{}: {heavy_n} {slow_n}", form.name);
    }
}

#[test]
fn creep_continues_after_a_step_at_constant_pressure() {
    let rig = frictionless();
    let run = holds(&[(1.0, 2.0e5), (12.0, 3.5e5), (12.0, 2.0e5)]);
    let plain = bare(&run, &rig);
    near(
        at(&plain, 12.5).contraction,
        at(&plain, 7.0).contraction,
        3e-5,
    );
    for form in forms("creep") {
        let readings = with(&run, &rig, &draw(form, 0.7, &rig));
        for (from_s, sign) in [(4.0, 1.0), (16.0, -1.0)] {
            let path: Vec<f64> = [0.0, 3.0, 6.0]
                .iter()
                .map(|s| at(&readings, from_s + s).contraction)
                .collect();
            assert!(sign * (path[1] - path[0]) > 3e-4, "{} {path:?}", form.name);
            assert!(sign * (path[2] - path[1]) > 1e-4, "{} {path:?}", form.name);
            // at a decreasing rate
            assert!(
                sign * (path[2] - path[1]) < sign * (path[1] - path[0]),
                "{}",
                form.name
            );
            let held_pa = at(&readings, from_s + 6.0).pressure_pa;
            near(at(&readings, from_s + 3.0).pressure_pa, held_pa, 20.0);
        }
    }
}

#[test]
fn run_in_falls_with_cycles_not_with_time() {
    let rig = frictionless();
    let hold = (3.0, 3.6e5, 3.6e5);
    let cycle = [(0.8, 3.6e5, 1.8e5), (0.8, 1.8e5, 3.6e5), hold];
    let mut all = vec![hold];
    for _ in 0..3 {
        all.extend(cycle);
    }
    let run = pieces(&all);
    for form in forms("run-in") {
        let readings = with(&run, &rig, &draw(form, 0.8, &rig));
        let residual_n = |time_s: f64| force_residual_n(&rig, &at(&readings, time_s)).abs();
        let ends_s = [2.95, 7.55, 12.15];
        for end_s in ends_s {
            // still rocking by a thousandth at the beginning of a hold
            near(
                residual_n(end_s),
                residual_n(end_s - 1.0),
                0.03 * residual_n(end_s),
            );
        }
        assert!(
            residual_n(ends_s[1]) < 0.95 * residual_n(ends_s[0]),
            "{}",
            form.name
        );
        assert!(
            residual_n(ends_s[2]) < 0.95 * residual_n(ends_s[1]),
            "{}",
            form.name
        );
    }
}

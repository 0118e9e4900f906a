//! Signatures of valve, supply, line and gas.

use super::{PERIOD_S, Rig, at, bare, draw, forms, holds, isometric, near, with};
use crate::effects::Drawn;
use crate::hidden::Reading;

/// Time from the step at 1 s until pressure has gone `share` of the way, or `None`.
fn reached_s(readings: &[Reading], share: f64, from_pa: f64, to_pa: f64) -> Option<f64> {
    let goal = |reading: &Reading| (reading.pressure_pa - from_pa) / (to_pa - from_pa) - share;
    let i = readings
        .windows(2)
        .position(|two| goal(&two[0]) < 0.0 && goal(&two[1]) >= 0.0)?;
    let part = goal(&readings[i]) / (goal(&readings[i]) - goal(&readings[i + 1]));
    Some((i as f64 + part) * PERIOD_S - 1.0)
}

fn half_time_s(rig: &Rig, drawn: Option<&Drawn>, step_pa: f64) -> f64 {
    let run = holds(&[(1.0, 2.0e5), (1.5, 2.0e5 + step_pa)]);
    let readings = match drawn {
        Some(drawn) => with(&run, rig, drawn),
        None => bare(&run, rig),
    };
    reached_s(&readings, 0.5, 2.0e5, 2.0e5 + step_pa).expect("half way is reached")
}

#[test]
fn leak_lowers_the_steady_pressure_and_empties_a_shut_muscle() {
    let rig = isometric();
    let levels_pa = [1.5e5, 3.0e5, 4.5e5];
    let run = holds(&levels_pa.map(|level_pa| (1.0, level_pa)));
    for form in forms("leak") {
        let drawn = draw(form, 0.8, &rig);
        let readings = with(&run, &rig, &drawn);
        let short =
            [0, 1, 2].map(|i| 1.0 - at(&readings, i as f64 + 0.95).pressure_pa / levels_pa[i]);
        assert!(
            short.iter().all(|short| *short > 0.005),
            "{} {short:?}",
            form.name
        );
        if form.name == "linear" {
            let leak = drawn.number("conductance_kg_per_pa_s");
            let expected = leak / (leak + rig.flow_gain_kg_per_pa_s);
            for short in short {
                near(short, expected, 1e-4);
            }
        }
        let shut = Rig {
            flow_gain_kg_per_pa_s: 0.0,
            ..rig.clone()
        };
        near(at(&bare(&run, &shut), 3.0).pressure_pa, 1.5e5, 1.0);
        let emptied = with(&run, &shut, &drawn);
        assert!(at(&emptied, 3.0).pressure_pa < 0.9 * 1.5e5, "{}", form.name);
    }
}

#[test]
fn heat_exchange_changes_only_the_transient_after_a_fast_step() {
    let rig = isometric();
    let run = holds(&[(1.0, 1.0e5), (4.0, 4.5e5)]);
    // shut after filling, the gas would cool; here the valve makes up for it, with more mass
    let plain = bare(&run, &rig);
    for form in forms("heat-exchange") {
        let readings = with(&run, &rig, &draw(form, 0.8, &rig));
        let off_pa =
            |time_s| (at(&readings, time_s).pressure_pa - at(&plain, time_s).pressure_pa).abs();
        let soon_pa = (1..20)
            .map(|i| off_pa(1.0 + 0.01 * f64::from(i)))
            .fold(0.0, f64::max);
        assert!(soon_pa > 100.0, "{}: {soon_pa}", form.name);
        assert!(
            off_pa(4.9) < 0.1 * soon_pa,
            "{}: {}",
            form.name,
            off_pa(4.9)
        );
    }
}

#[test]
fn valve_lag_is_independent_of_the_amplitude() {
    let rig = isometric();
    for form in forms("valve-lag") {
        let drawn = draw(form, 0.8, &rig);
        let small_s = half_time_s(&rig, Some(&drawn), 1.0e4);
        let large_s = half_time_s(&rig, Some(&drawn), 1.5e5);
        assert!(
            small_s > half_time_s(&rig, None, 1.0e4) + 0.01,
            "{}",
            form.name
        );
        near(large_s, small_s, 0.05 * small_s);
        if form.name == "first-order" {
            let lag_s = drawn.number("time_constant_s");
            // the gas follows within its own few milliseconds
            near(small_s, lag_s * 2.0_f64.ln(), 0.006);
        }
    }
}

#[test]
fn delay_shifts_the_response_by_its_time() {
    let rig = Rig::default();
    let run = holds(&[(1.0, 2.0e5), (1.0, 3.0e5)]);
    for form in forms("transport-delay") {
        let drawn = draw(form, 0.8, &rig);
        let readings = with(&run, &rig, &drawn);
        let delay_s = drawn.number("delay_s");
        let still = at(&readings, 1.0 + (delay_s / PERIOD_S).floor() * PERIOD_S);
        near(still.pressure_pa, at(&readings, 0.9).pressure_pa, 1.0);
        let added_s = half_time_s(&rig, Some(&drawn), 1.0e5) - half_time_s(&rig, None, 1.0e5);
        if form.name == "pure" {
            // the gas rises within a sample, so half way is good to half of one
            near(added_s, delay_s, 0.005);
        }
        assert!(
            added_s > delay_s - 0.005 && added_s < 1.6 * delay_s,
            "{} {added_s}",
            form.name
        );
    }
}

#[test]
fn dead_zone_leaves_a_pressure_error_on_either_side() {
    let rig = isometric();
    let run = holds(&[(1.0, 1.5e5), (3.0, 3.0e5), (1.0, 4.5e5), (3.0, 3.0e5)]);
    for form in forms("valve-dead-zone") {
        let drawn = draw(form, 0.9, &rig);
        let readings = with(&run, &rig, &drawn);
        let below_pa = 3.0e5 - at(&readings, 3.95).pressure_pa;
        let above_pa = at(&readings, 7.95).pressure_pa - 3.0e5;
        let (fill_pa, vent_pa) = (drawn.number("width_pa"), drawn.number("venting_width_pa"));
        if form.name == "rounded" {
            // leaks on, slower and slower
            assert!(below_pa > 20.0 && below_pa < fill_pa, "{below_pa}");
            assert!(above_pa > 20.0 && above_pa < vent_pa, "{above_pa}");
        } else {
            // the gas cools or warms after the valve has shut, within the zone
            near(below_pa, fill_pa, 0.3 * fill_pa);
            near(above_pa, vent_pa, 0.3 * vent_pa);
        }
    }
}

#[test]
fn flow_limit_slows_large_steps_more_than_small_ones() {
    let rig = Rig::default();
    for form in forms("flow-limit") {
        let drawn = draw(form, 0.7, &rig);
        let slower = |step_pa: f64| {
            half_time_s(&rig, Some(&drawn), step_pa) - half_time_s(&rig, None, step_pa)
        };
        assert!(
            slower(1.5e5) > 5.0 * slower(3.0e3).max(1e-4),
            "{}",
            form.name
        );
    }
}

#[test]
fn supply_droop_limits_the_pressure_only_after_high_air_consumption() {
    let rig = Rig::default();
    let mut all = vec![(1.0, 2.0e5)];
    for _ in 0..4 {
        all.extend([(0.3, 4.8e5), (0.3, 2.0e5)]);
    }
    all.extend([(0.3, 4.8e5), (1.0, 2.5e5)]);
    let run = holds(&all);
    let plain = bare(&run, &rig);
    for form in forms("supply-droop") {
        let readings = with(&run, &rig, &draw(form, 0.9, &rig));
        let short_pa = |time_s| at(&plain, time_s).pressure_pa - at(&readings, time_s).pressure_pa;
        assert!(short_pa(3.65) > 3.0e3, "{} {}", form.name, short_pa(3.65));
        near(short_pa(4.65), 0.0, 30.0);
    }
}

#[test]
fn line_dynamics_change_the_reading_relative_to_the_force() {
    let rig = isometric();
    let run = holds(&[(1.0, 1.5e5), (2.0, 3.5e5)]);
    let plain = bare(&run, &rig);
    for form in forms("line-dynamics") {
        let drawn = draw(form, 0.6, &rig);
        let readings = with(&run, &rig, &drawn);
        let residual_n = |i: usize| super::force_residual_n(&rig, &readings[i]);
        near(residual_n(299), 0.0, 0.1);
        if form.name.starts_with("ringing") {
            // the muscle itself is as without; the reading swings about it both ways
            assert!(
                readings
                    .iter()
                    .zip(&plain)
                    .all(|(a, b)| a.force_n == b.force_n)
            );
            let residuals: Vec<f64> = (100..150).map(residual_n).collect();
            assert!(residuals.iter().any(|n| *n > 5.0), "{}", form.name);
            assert!(residuals.iter().any(|n| *n < -5.0), "{}", form.name);
        } else {
            // force lags what the sensor sees
            assert!((101..104).all(|i| residual_n(i) < -1.0), "{}", form.name);
        }
    }
}

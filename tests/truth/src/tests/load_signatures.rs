//! Signatures of friction, payload, backlash and the sensors.

use super::{Rig, at, bare, draw, forms, frictionless, holds, mean, near, pieces, with};
use crate::hidden::Reading;
use crate::machine::GRAVITY_M_PER_S2;

/// Slowly up and down.
fn slow() -> super::Run {
    pieces(&[
        (0.5, 2.0e5, 2.0e5),
        (3.0, 2.0e5, 4.0e5),
        (3.0, 4.0e5, 2.0e5),
    ])
}

/// Mean force between two times.
fn force_n(readings: &[Reading], from_s: f64, to_s: f64) -> f64 {
    let part = &readings[(from_s * 100.0) as usize..(to_s * 100.0) as usize];
    mean(
        &part
            .iter()
            .map(|reading| reading.force_n)
            .collect::<Vec<_>>(),
    )
}

#[test]
fn friction_increases_the_force_difference_between_up_and_down() {
    let rig = Rig::default();
    let run = slow();
    let width_n = |readings: &[Reading]| force_n(readings, 2.0, 3.4) - force_n(readings, 5.0, 6.4);
    let plain_n = width_n(&bare(&run, &rig));
    for form in forms("friction") {
        let drawn = draw(form, 0.6, &rig);
        let added_n = 0.5 * (width_n(&with(&run, &rig, &drawn)) - plain_n);
        // Stribeck and LuGre add more at this speed of 1 cm/s than fast
        let most = if form.name == "coulomb" { 1.05 } else { 2.2 };
        let coulomb_n = drawn.number("coulomb_n");
        let within = added_n > 0.9 * coulomb_n && added_n < most * coulomb_n;
        assert!(within, "{}: {added_n} for {coulomb_n}", form.name);
    }
}

#[test]
fn payload_adds_weight_and_lowers_the_natural_frequency() {
    let rig = frictionless();
    let run = holds(&[(3.0, 3.0e5), (3.0, 3.2e5)]);
    for form in forms("payload") {
        let drawn = draw(form, 0.9, &rig);
        let mass_kg = rig.mass_kg + drawn.number("mass_kg");
        let readings = with(&run, &rig, &drawn);
        near(at(&readings, 2.9).force_n, mass_kg * GRAVITY_M_PER_S2, 0.1);
        // swings about the rest as the square root of mass over stiffness 2α(1−ε)P
        let rest = at(&readings, 5.9).contraction;
        let mut crossings = readings[300..]
            .windows(2)
            .enumerate()
            .filter(|(_, two)| two[0].contraction < rest && two[1].contraction >= rest)
            .map(|(i, two)| {
                let rise = two[1].contraction - two[0].contraction;
                0.01 * (i as f64 + (rest - two[0].contraction) / rise)
            });
        let first_s = crossings.next().expect("a swing");
        let period_s = crossings.next().expect("a swing") - first_s;
        let spring_n = 2.0 * rig.alpha_m2 * (1.0 - rest) * 3.2e5;
        let expected_s = std::f64::consts::TAU * (mass_kg * rig.initial_length_m / spring_n).sqrt();
        near(period_s, expected_s, 0.06 * expected_s);
    }
}

#[test]
fn backlash_delays_only_the_reading_by_its_gap() {
    let rig = Rig::default();
    let run = slow();
    let plain = bare(&run, &rig);
    for form in forms("backlash") {
        let drawn = draw(form, 0.7, &rig);
        let readings = with(&run, &rig, &drawn);
        for (a, b) in readings.iter().zip(&plain) {
            assert_eq!((a.pressure_pa, a.force_n), (b.pressure_pa, b.force_n));
        }
        let behind = |time_s| at(&plain, time_s).contraction - at(&readings, time_s).contraction;
        let gap = drawn.number("gap_m") / rig.initial_length_m;
        near(behind(3.4) - behind(6.4), gap, 1e-9);
    }
}

#[test]
fn sensor_errors_change_only_the_readings() {
    let rig = Rig::default();
    let run = slow();
    let plain = bare(&run, &rig);
    for effect in [
        "pressure-sensor-offset",
        "pressure-sensor-gain",
        "pressure-sensor-drift",
        "contraction-sensor-offset",
    ] {
        for form in forms(effect) {
            let drawn = draw(form, 0.8, &rig);
            let readings = with(&run, &rig, &drawn);
            for (i, (a, b)) in readings.iter().zip(&plain).enumerate() {
                let off_pa = a.pressure_pa - b.pressure_pa;
                let off = a.contraction - b.contraction;
                assert_eq!(a.force_n, b.force_n);
                let time_s = i as f64 * super::PERIOD_S;
                match (effect, form.name) {
                    (_, "linear") => {
                        near(a.pressure_pa / b.pressure_pa, drawn.number("gain"), 1e-9)
                    }
                    (_, "steady") => near(off_pa, drawn.number("drift_pa_per_s") * time_s, 1e-3),
                    ("pressure-sensor-offset", _) => near(off_pa, drawn.number("offset_pa"), 1e-6),
                    ("contraction-sensor-offset", _) => near(off, drawn.number("offset"), 1e-12),
                    _ => assert!(off_pa != 0.0 || time_s < 1e-6),
                }
                assert!(off == 0.0 || off_pa == 0.0);
            }
        }
    }
}

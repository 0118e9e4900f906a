//! Tests of the properties of random shapes.

use super::super::shape::{Coordinate, Curve, MODULATION, Modulation, Ramp, Waveform, shares};
use super::{bench, moment, rng};
use crate::hidden::Moment;

#[test]
fn a_curve_has_its_given_ratio_and_no_jumps() {
    for seed in 0..300 {
        let curve = Curve::with_ratio(&mut rng(seed), 3.0);
        assert!((curve.ratio() - 3.0).abs() < 1e-9);
        let steps = (0..1000).map(|i| f64::from(i) / 1000.0);
        for u in steps {
            let change = (curve.at(u + 1e-3) / curve.at(u)).ln().abs();
            // a tenth of the whole range in a hundredth of the coordinate would be a jump
            assert!(change < 0.1 * 3.0_f64.ln(), "{seed}: {change} at {u}");
        }
        let mean = (0..=128)
            .map(|i| curve.at(f64::from(i) / 128.0).ln())
            .sum::<f64>()
            / 129.0;
        assert!(mean.abs() < 1e-9);
    }
}

#[test]
fn a_curves_integral_is_the_sum_of_its_values() {
    let curve = Curve::with_ratio(&mut rng(3), 3.0);
    for (from, to) in [(0.0, 0.3), (0.3, 0.31), (-0.2, 0.1), (0.9, 1.4)] {
        let steps = 20_000;
        let width = (to - from) / f64::from(steps);
        let sum: f64 = (0..steps)
            .map(|i| width * curve.at(from + (f64::from(i) + 0.5) * width))
            .sum();
        let integral = curve.integral(to) - curve.integral(from);
        assert!((integral - sum).abs() < 1e-6, "{integral} {sum}");
    }
}

#[test]
fn a_rising_curve_rises_and_a_ramp_goes_from_zero_to_one() {
    for seed in 0..200 {
        let rng = &mut rng(seed);
        let curve = Curve::rising(rng, 2.5);
        let ramp = Ramp::draw(rng, 6.0);
        assert!((curve.ratio() - 2.5).abs() < 1e-9);
        assert_eq!(ramp.at(0.0), 0.0);
        assert!((ramp.at(1.0) - 1.0).abs() < 1e-12);
        for i in 0..150 {
            let u = f64::from(i) / 100.0;
            assert!(curve.at(u + 0.01) >= curve.at(u));
            assert!(ramp.at(u + 0.01) > ramp.at(u), "goes on beyond one");
            assert!(ramp.saturated(u) <= 1.0 + 1e-12);
        }
        assert_eq!(ramp.at(-0.4), -ramp.at(0.4));
    }
}

#[test]
fn a_modulation_stays_within_a_factor_of_three_over_all_coordinates() {
    let coordinates = [
        Coordinate::Pressure,
        Coordinate::Contraction,
        Coordinate::Speed,
        Coordinate::Velocity,
        Coordinate::Flow,
    ];
    let mut widest = 1.0_f64;
    for seed in 0..300 {
        let bench = bench(seed, false);
        let modulation = Modulation::draw(&mut rng(seed), &coordinates, &bench);
        assert!(modulation.ratio() <= MODULATION * (1.0 + 1e-9));
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for i in 0..2000_u32 {
            let part = |step: u32| f64::from(i * step % 101) / 100.0;
            let now = Moment {
                pressure_pa: 1.5 * part(7) * bench.high_pa,
                contraction: 1.2 * part(13) * bench.contraction_most,
                rate_per_s: 4.0 * part(17) - 2.0,
                flow_kg_per_s: 0.1 * part(29) - 0.05,
                ..moment(&bench)
            };
            let factor = modulation.at(&now);
            low = low.min(factor);
            high = high.max(factor);
        }
        assert!(high / low <= MODULATION * (1.0 + 1e-9), "{seed}");
        widest = widest.max(high / low);
    }
    assert!(widest > 2.0, "the range is used: {widest}");
}

#[test]
fn a_waveform_repeats_and_has_no_mean() {
    for seed in 0..100 {
        let waveform = Waveform::draw(&mut rng(seed));
        let values: Vec<f64> = (0..200)
            .map(|i| waveform.at(f64::from(i) / 200.0))
            .collect();
        assert!(values.iter().all(|value| value.abs() <= 1.0 + 1e-9));
        assert!(values.iter().sum::<f64>().abs() < 1e-6);
        assert!((waveform.at(7.3) - waveform.at(0.3)).abs() < 1e-9);
    }
}

#[test]
fn shares_are_positive_and_sum_to_one() {
    for seed in 0..100 {
        let parts = shares(&mut rng(seed), 5);
        assert!(parts.iter().all(|part| *part > 0.0));
        assert!((parts.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}

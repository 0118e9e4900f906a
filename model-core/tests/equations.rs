//! Tests of the paper's equations: values computed by hand, and properties.

use model_core::assist::{Assist, reference_force_n};
use model_core::muscle::{Muscle, Volume};
use model_core::pressure::GaugePa;
use model_core::reference::reference_pressure;
use model_core::settings::SettingsValues;
use model_core::valve::mass_flow_kg_per_s;
use proptest::prelude::*;

const MUSCLE: Muscle<f64> = Muscle {
    alpha_m2: 3.7718e-3,
    beta_m2: -1.39e-3,
    gamma_n: -183.0,
    initial_length_m: 0.3,
};

#[test]
fn force_by_hand() {
    // (3.7718e-3·0.8² − 1.39e-3)·3e5 − 183
    assert!((MUSCLE.force_n(0.2, GaugePa(3e5)) - 124.1856).abs() < 1e-9);
    assert_eq!(MUSCLE.force_n(0.1, GaugePa(0.0)), -183.0);
}

#[test]
fn volume_by_hand() {
    let volume = Volume {
        d1_m3: -9.9e-4,
        d2_m3: 7.005e-4,
        d3_m3: 2.3e-5,
    };
    // −9.9e-4/16 + 7.005e-4/4 + 2.3e-5 = 1.3625e-4, which is 5.924 of the volume at rest.
    assert!((volume.volume_m3(0.25_f64) - 1.3625e-4).abs() < 1e-18);
    assert!((volume.slope_m3(0.25_f64) - 2.055e-4).abs() < 1e-18);
}

#[test]
fn finger_and_reference_force_by_hand() {
    let assist = Assist {
        gain: 20.0,
        input_stiffness_n_per_m: 200.0,
        lever_length_m: 0.3,
        pulley_diameter_m: 0.1,
    };
    assert!((assist.lever_travel_m(0.3_f64) - 0.45).abs() < 1e-15);
    // 200·(0.12 − 0.45·0.2) = 6 N, twenty times which is 120 N.
    let finger_n = assist.finger_force_n(0.12, 0.2, 0.3);
    assert!((finger_n - 6.0).abs() < 1e-12);
    assert!((reference_force_n(assist.gain, finger_n) - 120.0).abs() < 1e-10);
}

#[test]
fn valve_flow_by_hand() {
    let flow = mass_flow_kg_per_s(1.3e-7, GaugePa(4e5), GaugePa(3e5));
    assert!((flow - 0.013_f64).abs() < 1e-15);
}

proptest! {
    /// Where nothing limits it, the reference pressure makes exactly the reference force.
    #[test]
    fn eq_8_inverts_eq_1(force_n in -150.0_f64..250.0, contraction in 0.0_f64..0.25) {
        let pressure = reference_pressure(&MUSCLE, force_n, contraction, 0.3, GaugePa(1e7));
        prop_assert!((MUSCLE.force_n(contraction, pressure) - force_n).abs() < 1e-9);
    }

    /// Any bit pattern, anywhere: the reference pressure is a number from zero to supply.
    #[test]
    fn reference_pressure_is_limited_for_any_input(
        force: u32, contraction: u32, contraction_max: u32, alpha: u32, beta: u32, gamma: u32,
        supply_pa in 0.0_f32..1e7,
    ) {
        let [force_n, contraction, contraction_max, alpha_m2, beta_m2, gamma_n] =
            [force, contraction, contraction_max, alpha, beta, gamma].map(f32::from_bits);
        for muscle in [
            Muscle { alpha_m2, beta_m2, gamma_n, initial_length_m: 0.3 },
            SettingsValues::reference().muscle,
        ] {
            let pressure = reference_pressure(
                &muscle, force_n, contraction, contraction_max, GaugePa(supply_pa),
            );
            prop_assert!((0.0..=supply_pa).contains(&pressure.0));
        }
    }

    /// f32 and f64 are the same equation: they differ by rounding only.
    #[test]
    fn single_and_double_precision_agree(pressure_pa in 0.0_f32..5e5, contraction in 0.0_f32..0.3) {
        let single = SettingsValues::reference().muscle.force_n(contraction, GaugePa(pressure_pa));
        let double = MUSCLE.force_n(contraction.into(), GaugePa(pressure_pa.into()));
        // Six roundings of terms up to 1900 N.
        prop_assert!((f64::from(single) - double).abs() < 6.0 * 1900.0 * f64::from(f32::EPSILON));
    }
}

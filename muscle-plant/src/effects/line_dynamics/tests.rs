use super::super::testing::{
    CLAMPED, FLOW_GAIN_KG_PER_PA_S, STEP_S, added_n, assert_near, bench, driven_every, effect,
    force_n, largest_difference, run, through,
};
use super::{KIND, RT_J_PER_KG};
use crate::effects::{DISCREPANCY_RATIO, Effect};
use crate::subsystem::gas::{GAS_CONSTANT_J_PER_KG_K, HEAT_RATIO};
use std::f64::consts::TAU;

/// Interval between rows in these tests \[s\].
const ROW_S: f64 = 1e-3;

fn volume_m3() -> f64 {
    CLAMPED.volume.expect("a volume").volume_m3(0.1)
}

/// Pressure in the muscle from its force at a contraction of 0.1 \[Pa\].
fn muscle_pa(force_n: &[f64]) -> Vec<f64> {
    let muscle = CLAMPED.muscle;
    force_n
        .iter()
        .map(|force_n| (force_n - muscle.gamma_n) / muscle.force_per_pressure_m2(0.1))
        .collect()
}

/// Pressure at the sensor and in the muscle for 5 s after a step from 200 to 300 kPa at 0.5 s.
fn sensor_and_muscle(effects: &[Effect]) -> (Vec<f64>, Vec<f64>) {
    let step = driven_every(ROW_S, 5.5, |time_s| if time_s < 0.5 { 2e5 } else { 3e5 });
    let signals = run(&CLAMPED, effects, &step);
    (signals.pressure_pa, muscle_pa(&signals.force_n))
}

/// Time integral of the pressure at the sensor less that in the muscle, over the step \[s\].
fn moment_s(effect: Effect) -> f64 {
    let (sensor_pa, muscle_pa) = sensor_and_muscle(&[effect]);
    assert_near(sensor_pa[5499], 3e5, 30.0, "sensor");
    assert_near(muscle_pa[5499], 3e5, 30.0, "muscle");
    let differences = sensor_pa.iter().zip(&muscle_pa).map(|(a, b)| a - b);
    differences.sum::<f64>() * ROW_S / 1e5
}

fn resistance(lag_s: f64, hose_volume_m3: f64) -> Effect {
    let parameters = [("lag_s", lag_s), ("hose_volume_m3", hose_volume_m3)];
    effect(&KIND, "resistance", &parameters)
}

fn conductance(conductance_kg_per_pa_s: f64) -> Effect {
    let parameters = [
        ("conductance_kg_per_pa_s", conductance_kg_per_pa_s),
        ("hose_volume_m3", 1e-6),
    ];
    effect(&KIND, "conductance", &parameters)
}

/// ∫(P_port − P) dt = R ΔW: the mean delay is the lag. The port jumps at once to a pressure between
/// reference and muscle; the row of the step is before that.
#[test]
fn a_resistance_delays_the_muscle_by_its_lag() {
    let lag_s = 0.02;
    let hose_kg_per_pa_s = volume_m3() / (RT_J_PER_KG * lag_s);
    let jump = FLOW_GAIN_KG_PER_PA_S / (FLOW_GAIN_KG_PER_PA_S + hose_kg_per_pa_s);
    let moment_s = moment_s(resistance(lag_s, 1e-5)) + 0.5 * ROW_S * jump;
    assert_near(moment_s, lag_s, 0.01 * lag_s, "moment");
}

/// The first moment is 2ζ/ω times the ratio of the volumes, and the mean of 1/P between both
/// pressures relative to that at 300 kPa. Some of the air comes later, at the higher pressure,
/// while the gas cools: 5 %.
#[test]
fn an_inertance_delays_the_muscle_by_its_resistance() {
    let (period_s, damping_ratio, hose_volume_m3) = (0.05, 0.2, 2e-5);
    let parameters = [
        ("period_s", period_s),
        ("damping_ratio", damping_ratio),
        ("hose_volume_m3", hose_volume_m3),
    ];
    let thinness = (401_325.0_f64 / 301_325.0).ln() * 4.01325;
    let laminar_s = 2.0 * damping_ratio * period_s / TAU;
    let expected_s = laminar_s * volume_m3() / hose_volume_m3 * thinness;
    let found_s = moment_s(effect(&KIND, "inertance", &parameters));
    assert_near(found_s, expected_s, 0.05 * expected_s, "moment");
}

/// The first moment of a resonator is 2ζ/ω.
#[test]
fn a_sensor_tube_rings_and_the_muscle_does_not() {
    let parameters = [("period_s", 0.05), ("damping_ratio", 0.2)];
    let tube = || effect(&KIND, "sensor-tube", &parameters);
    assert_near(-moment_s(tube()), 2.0 * 0.2 * 0.05 / TAU, 2e-4, "moment");
    let (sensor_pa, muscle_pa) = sensor_and_muscle(&[tube()]);
    assert!(largest_difference(&muscle_pa, &sensor_and_muscle(&[]).1) < 0.1);
    let highest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    assert!(highest(&sensor_pa) > highest(&muscle_pa) + 1e4);
}

/// ẍ = ω²(P − x) − 2ω(ζ + κ|ẋ|/ω) ẋ under the muscle's own pressure, by Heun's method in steps of
/// 10 µs.
#[test]
fn a_turbulent_tube_damps_large_oscillations() {
    let (period_s, damping_ratio, turbulent_per_pa) = (0.05, 0.05, 5e-6);
    let parameters = [
        ("period_s", period_s),
        ("damping_ratio", damping_ratio),
        ("turbulent_damping_per_pa", turbulent_per_pa),
    ];
    let turbulent = effect(&KIND, "turbulent-sensor-tube", &parameters);
    let laminar = effect(&KIND, "sensor-tube", &parameters[..2]);
    let (read_pa, muscle_pa) = sensor_and_muscle(&[turbulent]);
    let laminar_pa = sensor_and_muscle(&[laminar]).0;
    let omega_per_s = TAU / period_s;
    let steps = 100;
    let step_s = ROW_S / f64::from(steps);
    let rates = |pressure_pa: f64, [sensor, swing]: [f64; 2]| {
        let ratio = damping_ratio + turbulent_per_pa * f64::abs(swing);
        let pull = pressure_pa - sensor - 2.0 * ratio * swing;
        [omega_per_s * swing, omega_per_s * pull]
    };
    let mut state = [muscle_pa[0], 0.0];
    let mut solved_pa = vec![state[0]];
    for row in 1..muscle_pa.len() {
        let [from, to] = [muscle_pa[row - 1], muscle_pa[row]];
        for step in 0..steps {
            let pressure_pa = |step: i32| from + (to - from) * f64::from(step) / f64::from(steps);
            let a = rates(pressure_pa(step), state);
            let ahead = [0, 1].map(|i| state[i] + step_s * a[i]);
            let b = rates(pressure_pa(step + 1), ahead);
            state = [0, 1].map(|i| state[i] + 0.5 * step_s * (a[i] + b[i]));
        }
        solved_pa.push(state[0]);
    }
    // Linear between rows of 1 ms, a pressure that rises by 100 kPa in 9 ms is off by 150 Pa.
    assert!(largest_difference(&read_pa, &solved_pa) < 150.0);
    assert!(largest_difference(&read_pa, &laminar_pa) > 5e3);
}

/// Pressure at the port and in the muscle for 1 s after a step from 200 to 300 kPa at 0.5 s, by
/// Heun's method in steps of 5 µs: Eqs 3, 4 and 9, with a volume at the port or, without one,
/// K_G (P_r − P_port) = C (P_port − P).
fn solved(hose_volume_m3: Option<f64>, hose_kg_per_pa_s: f64) -> (Vec<f64>, Vec<f64>) {
    let gas = CLAMPED.gas.expect("gas");
    let muscle_m3 = volume_m3();
    let length_m = 0.9 * CLAMPED.muscle.initial_length_m;
    let wall_m2 = 2.0 * (std::f64::consts::PI * muscle_m3 * length_m).sqrt();
    let air_pa = gas.atmospheric_pressure.0;
    let per_kg = GAS_CONSTANT_J_PER_KG_K;
    let heat = per_kg / (HEAT_RATIO - 1.0);
    let gain = FLOW_GAIN_KG_PER_PA_S;
    let at_once = |reference: f64, muscle: f64| {
        (gain * reference + hose_kg_per_pa_s * muscle) / (gain + hose_kg_per_pa_s)
    };
    // Gauge pressures of port and muscle, and the temperature.
    let rates = |reference: f64, [port, muscle, kelvin]: [f64; 3]| {
        let port = hose_volume_m3.map_or(at_once(reference, muscle), |_| port);
        let flow = hose_kg_per_pa_s * (port - muscle);
        let ambient = gas.ambient_temperature_k;
        let (enters, transfer) = if flow > 0.0 {
            (ambient, gas.heat_transfer_charging_w_per_m2_k)
        } else {
            (kelvin, gas.heat_transfer_discharging_w_per_m2_k)
        };
        let warmed = transfer * wall_m2 * (ambient - kelvin);
        let energy = HEAT_RATIO * heat * flow * enters + warmed;
        let pressure = energy * per_kg / heat / muscle_m3;
        let mass = (muscle + air_pa) * muscle_m3 / (per_kg * kelvin);
        let temperature = kelvin * (pressure / (muscle + air_pa) - flow / mass);
        let stored = gain * (reference - port) - flow;
        let at_port = hose_volume_m3.map_or(0.0, |volume| stored * per_kg * ambient / volume);
        [at_port, pressure, temperature]
    };
    let step_s = 5e-6;
    let mut state = [2e5, 2e5, gas.ambient_temperature_k];
    let (mut port_pa, mut muscle_pa) = (Vec::new(), Vec::new());
    for row in 0..1500 {
        let port = if row > 500 {
            at_once(3e5, state[1])
        } else {
            state[0]
        };
        port_pa.push(hose_volume_m3.map_or(port, |_| state[0]));
        muscle_pa.push(state[1]);
        let reference = if row < 500 { 2e5 } else { 3e5 };
        for _ in 0..200 {
            let a = rates(reference, state);
            let b = rates(reference, [0, 1, 2].map(|i| state[i] + step_s * a[i]));
            state = [0, 1, 2].map(|i| state[i] + 0.5 * step_s * (a[i] + b[i]));
        }
    }
    (port_pa, muscle_pa)
}

/// A hose without volume at the port, one of 2e-4 m³, which is simulated, and one of 1e-6 m³, which
/// fills in 0.04 ms and is neglected: its air is then in the muscle.
#[test]
fn the_port_has_its_own_pressure_or_that_of_equal_flows() {
    let lag_s = 0.03;
    let hose_kg_per_pa_s = volume_m3() / (RT_J_PER_KG * lag_s);
    let neglected_pa = HEAT_RATIO * 1e-6 / volume_m3() * 1e5;
    for (what, hose, volume_m3, hose_kg_per_pa_s, tolerance_pa) in [
        ("no volume", conductance(1e-7), None, 1e-7, 1.0),
        (
            "large volume",
            resistance(lag_s, 2e-4),
            Some(2e-4),
            hose_kg_per_pa_s,
            1.0,
        ),
        (
            "small volume",
            resistance(lag_s, 1e-6),
            Some(1e-6),
            hose_kg_per_pa_s,
            neglected_pa,
        ),
    ] {
        let (port_pa, muscle_pa) = sensor_and_muscle(&[hose]);
        let (solved_port_pa, solved_muscle_pa) = solved(volume_m3, hose_kg_per_pa_s);
        for (found, solved) in [(port_pa, solved_port_pa), (muscle_pa, solved_muscle_pa)] {
            let error_pa = largest_difference(&found[..1500], &solved);
            assert!(error_pa < tolerance_pa, "{what}: {error_pa}");
        }
    }
}

/// The force from a measured pressure at the port is that of the muscle behind the hose. Linear
/// interpolation in the row in which the port jumps delays it by half a row; the muscle follows
/// with the time constant V/(κRTC).
#[test]
fn a_conductance_fills_the_muscle_from_a_measured_pressure() {
    let (port_pa, solved_pa) = solved(None, 1e-7);
    let row = |time_s: f64| (time_s / ROW_S).round() as usize;
    let inputs = bench(ROW_S, 1500, |_| 0.1, |time_s| port_pa[row(time_s)]);
    let found_pa = muscle_pa(&force_n(&[conductance(1e-7)], &inputs));
    let time_constant_s = volume_m3() / (HEAT_RATIO * RT_J_PER_KG * 1e-7);
    let jump_pa = port_pa[501] - port_pa[500];
    let error_pa = largest_difference(&found_pa, &solved_pa);
    let tolerance_pa = 0.55 * jump_pa * ROW_S / time_constant_s;
    assert!(error_pa < tolerance_pa, "{error_pa}, {tolerance_pa}");
    assert_near(found_pa[1499], solved_pa[1499], 5.0, "at the end");
    assert!(largest_difference(&port_pa, &solved_pa) > 5e4);
}

#[test]
fn a_resistance_delays_the_force_behind_a_measured_pressure() {
    let ramp = through([(0.0, 1e5), (1.0, 1e5), (2.0, 3e5)]);
    let inputs = bench(STEP_S, 201, |_| 0.1, ramp);
    let added = added_n(&resistance(0.02, 1e-5), &inputs);
    let expected_n = -CLAMPED.muscle.force_per_pressure_m2(0.1) * 2e5 * 0.02;
    assert_near(added[100], 0.0, 1e-9, "before the ramp");
    assert_near(added[200], expected_n, 1e-4, "on the ramp");
}

/// Along a motion and a pressure that is linear between rows 10 ms apart, a muscle that fills in 5
/// to 40 ms, in the middle of its motion, is filled and emptied as with ten times as many steps, to
/// a tenth of what a form may leave.
#[test]
fn a_muscle_is_filled_in_few_steps() {
    const FINE: u32 = 40;
    let coarse_s = FINE as f64 * ROW_S;
    let row = |time_s: f64| (time_s / coarse_s + 1e-9).floor();
    let between = |of: fn(f64) -> f64, time_s: f64| {
        let (from, to) = (
            of(coarse_s * row(time_s)),
            of(coarse_s * (row(time_s) + 1.0)),
        );
        from + (time_s / coarse_s - row(time_s)) * (to - from)
    };
    let contraction = |time_s: f64| 0.1 + 0.08 * (TAU * time_s).sin();
    let port_pa = |time_s: f64| 2.5e5 + 1.5e5 * (3.0 * TAU * time_s).sin().signum();
    for fills_s in [5e-3, 10e-3, 40e-3] {
        let effect = conductance(volume_m3() / (RT_J_PER_KG * fills_s));
        let along = |fine: u32| {
            let step_s = coarse_s / f64::from(fine);
            let motion = |time_s: f64| between(contraction, time_s);
            let pressure = |time_s: f64| between(port_pa, time_s);
            let inputs = bench(step_s, 200 * fine as usize + 1, motion, pressure);
            let missing_n = added_n(&effect, &inputs);
            missing_n
                .into_iter()
                .step_by(fine as usize)
                .collect::<Vec<f64>>()
        };
        let (found_n, fine_n) = (along(1), along(FINE));
        let most_n = fine_n.iter().fold(0.0_f64, |most, n| most.max(n.abs()));
        let error_n = largest_difference(&found_n, &fine_n);
        assert!(
            error_n < 0.1 * DISCREPANCY_RATIO * most_n,
            "{fills_s}: {error_n} of {most_n}"
        );
    }
}

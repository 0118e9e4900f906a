//! Each effect changes its block as its equation says, and nothing else.

use hil_sim::plant::gas::GAS_CONSTANT_J_PER_KG_K;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::Rig;
use hil_sim::simulate::simulate;
use model_core::pressure::GaugePa;

const TOLERANCE: f64 = 1e-9;
const STEP_S: f64 = 0.01;

/// The reference rig with an effect, and with its lines changed.
fn rig(effect: &str, changes: &[(&str, &str)]) -> Rig {
    let mut text = Rig::REFERENCE_TOML.to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    Rig::parse("rig.toml", &(text + effect)).expect("a rig")
}

const CLAMPED: (&str, &str) = ("kind = \"weight\"", "kind = \"prescribed\"");

/// A drive of `seconds`: reference by time, the muscle clamped at 0.1 or its weight at rest there.
fn drive(seconds: f64, reference_pa: impl Fn(f64) -> f64) -> Record {
    let rows = (seconds / STEP_S).round() as usize;
    let time_s: Vec<f64> = (0..rows).map(|row| row as f64 * STEP_S).collect();
    let references = time_s.iter().map(|time_s| reference_pa(*time_s)).collect();
    let mut record = Record::new(time_s);
    record.set(PRESSURE_REF_PA, references);
    record.set(CONTRACTION, vec![0.1; rows]);
    let pressure_pa = (0..rows).map(|row| if row == 0 { 2e5 } else { f64::NAN });
    record.set(PRESSURE_PA, pressure_pa.collect());
    record
}

fn steps(time_s: f64) -> f64 {
    [2e5, 3e5, 2.4e5, 2.6e5][(2.0 * time_s) as usize % 4]
}

fn simulated(rig: &Rig, record: &Record, column: &str) -> Vec<f64> {
    let simulated = simulate(rig, record, TOLERANCE).expect("simulated");
    simulated.require(column).expect("the column").to_vec()
}

/// Largest difference of two signals.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

/// K_G (P_r − P) = g P at rest.
#[test]
fn leak_settles_below_the_reference_in_proportion_to_pressure() {
    let (flow_gain, conductance) = (1.3e-7, 4e-9);
    let leaking = rig(
        "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4e-9\n",
        &[CLAMPED],
    );
    for reference_pa in [1e5, 3e5] {
        let pressure_pa = simulated(&leaking, &drive(5.0, |_| reference_pa), PRESSURE_PA);
        let settled_pa = reference_pa * flow_gain / (flow_gain + conductance);
        let last_pa = pressure_pa[pressure_pa.len() - 1];
        assert!(
            (last_pa - settled_pa).abs() < 1e-4 * settled_pa,
            "{last_pa} {settled_pa}"
        );
    }
}

#[test]
fn transport_delay_shifts_the_response() {
    let delayed = rig(
        "[[effect]]\nname = \"transport-delay\"\ndelay_s = 0.07\n",
        &[CLAMPED],
    );
    let now = simulated(&rig("", &[CLAMPED]), &drive(4.0, steps), PRESSURE_PA);
    let then = simulated(&delayed, &drive(4.0, steps), PRESSURE_PA);
    let shift = (0.07_f64 / STEP_S).round() as usize;
    let apart_pa = apart(&now[..now.len() - shift], &then[shift..]);
    assert!(apart_pa < 0.1, "{apart_pa}");
    assert!(apart(&now, &then) > 1e4);
}

/// The lag's own solution, held at the middle of 0.1 ms rows, drives the nominal valve.
#[test]
fn valve_lag_is_a_lagging_reference() {
    const TIME_CONSTANT_S: f64 = 0.05;
    let lagging = rig(
        "[[effect]]\nname = \"valve-lag\"\ntime_constant_s = 0.05\n",
        &[CLAMPED],
    );
    let coarse = drive(2.0, |time_s| if time_s < 0.995 { 2e5 } else { 3e5 });
    let lagged = simulated(&lagging, &coarse, PRESSURE_PA);
    let time_s: Vec<f64> = (0..20_000).map(|row| f64::from(row) * 1e-4).collect();
    let reference_pa = |time_s: &f64| match time_s + 0.5e-4 - 1.0 {
        since_s if since_s < 0.0 => 2e5,
        since_s => 3e5 - 1e5 * (-since_s / TIME_CONSTANT_S).exp(),
    };
    let mut fine = Record::new(time_s.clone());
    fine.set(PRESSURE_REF_PA, time_s.iter().map(reference_pa).collect());
    fine.set(CONTRACTION, vec![0.1; time_s.len()]);
    fine.set(PRESSURE_PA, vec![2e5; time_s.len()]);
    let held = simulated(&rig("", &[CLAMPED]), &fine, PRESSURE_PA);
    let held: Vec<f64> = held.iter().step_by(100).copied().collect();
    // A ramp of s = 2 MPa/s held for h at its middle leaves s·h²·λ/12 behind a pole of λ ≤ 600/s.
    assert!(apart(&lagged, &held) < 1.0, "{}", apart(&lagged, &held));
}

#[test]
fn payload_is_mass() {
    let loaded = rig("[[effect]]\nname = \"payload\"\nmass_kg = 2.0\n", &[]);
    let heavier = rig("", &[("mass_kg = 12.0", "mass_kg = 14.0")]);
    let record = drive(4.0, steps);
    for column in [PRESSURE_PA, CONTRACTION, FORCE_N] {
        let loaded = simulated(&loaded, &record, column);
        assert_eq!(loaded, simulated(&heavier, &record, column), "{column}");
        assert_ne!(
            loaded,
            simulated(&rig("", &[]), &record, column),
            "{column}"
        );
    }
}

#[test]
fn dead_band_takes_the_threshold_off_the_pressure() {
    let dead = rig(
        "[[effect]]\nname = \"dead-band\"\npressure_pa = 2e4\n",
        &[CLAMPED],
    );
    let record = drive(4.0, |time_s| 2e5 + 5e4 * (3.0 * time_s).sin());
    let pressure_pa = simulated(&dead, &record, PRESSURE_PA);
    assert_eq!(
        pressure_pa,
        simulated(&rig("", &[CLAMPED]), &record, PRESSURE_PA)
    );
    let force_n = simulated(&dead, &record, FORCE_N);
    let law = |pressure_pa: &f64| dead.muscle.force_n(0.1, GaugePa(pressure_pa - 2e4));
    let expected_n: Vec<f64> = pressure_pa.iter().map(law).collect();
    assert!(apart(&force_n, &expected_n) < 1e-9);
}

#[test]
fn sensor_offset_is_read_and_taken_off_an_input() {
    let effect = "[[effect]]\nname = \"pressure-sensor-offset\"\noffset_pa = 3000.0\n";
    let (offset, nominal) = (rig(effect, &[CLAMPED]), rig("", &[CLAMPED]));
    let mut record = drive(2.0, steps);
    let started_pa = vec![2e5; record.time_s().len()];
    let start = |record: &mut Record, offset_pa: f64| {
        let pressure_pa = started_pa.iter().map(|pa| pa + offset_pa).collect();
        record.set(PRESSURE_PA, pressure_pa);
    };
    // Only the first row is measured at rest, so the fit of the begin sees no more.
    let mut first = started_pa.clone();
    first[1..].fill(f64::NAN);
    record.set(PRESSURE_PA, first.clone());
    let truth_pa = simulated(&nominal, &record, PRESSURE_PA);
    first[0] += 3000.0;
    record.set(PRESSURE_PA, first);
    let read_pa = simulated(&offset, &record, PRESSURE_PA);
    let shifted_pa: Vec<f64> = truth_pa.iter().map(|pa| pa + 3000.0).collect();
    assert!(
        apart(&read_pa, &shifted_pa) < 0.1,
        "{}",
        apart(&read_pa, &shifted_pa)
    );

    // As an input it is the truth plus the offset.
    let mut bench = Record::new(record.time_s().to_vec());
    bench.set(CONTRACTION, vec![0.1; bench.time_s().len()]);
    start(&mut bench, 0.0);
    let true_n = simulated(&nominal, &bench, FORCE_N);
    start(&mut bench, 3000.0);
    assert!(apart(&true_n, &simulated(&offset, &bench, FORCE_N)) < 1e-6);
}

/// Without a refill in sight the reservoir has lost what the muscle took in.
#[test]
fn supply_droop_is_the_mass_that_was_drawn() {
    let (volume_m3, temperature_k) = (1e-3, 293.0);
    let effect = "[[effect]]\nname = \"supply-droop\"\nreservoir_volume_m3 = 1e-3\n\
                  recovery_time_s = 1000.0\n";
    // Isothermal in effect: after 20 s the air is at ambient temperature again.
    let droop = rig(effect, &[CLAMPED]);
    let record = drive(20.0, |time_s| if time_s < 0.5 { 2e5 } else { 5e5 });
    let pressure_pa = simulated(&droop, &record, PRESSURE_PA);
    let muscle_m3 = droop.require_volume().expect("a volume").volume_m3(0.1);
    let gas = GAS_CONSTANT_J_PER_KG_K * temperature_k;
    let last_pa = pressure_pa[pressure_pa.len() - 1];
    let drawn_kg = (last_pa - 2e5) * muscle_m3 / gas;
    let droop_pa = 5e5 - last_pa;
    let lost_pa = drawn_kg * gas / volume_m3;
    // 2 % come back in 20 of 1000 s.
    assert!(
        (droop_pa - lost_pa).abs() < 0.03 * lost_pa,
        "{droop_pa} {lost_pa}"
    );
}

#[test]
fn an_effect_on_a_block_that_is_measured_rests() {
    let effect = "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4e-9\n";
    let mut bench = drive(1.0, steps);
    bench.set(PRESSURE_PA, vec![2e5; bench.time_s().len()]);
    let time_s = bench.time_s().to_vec();
    let mut no_valve = Record::new(time_s);
    for name in [PRESSURE_PA, CONTRACTION] {
        no_valve.set(name, bench.require(name).expect("the column").to_vec());
    }
    let leaking = simulated(&rig(effect, &[CLAMPED]), &no_valve, FORCE_N);
    assert_eq!(leaking, simulated(&rig("", &[CLAMPED]), &no_valve, FORCE_N));
}

/// A cold gas at the end of a fill, warmed by one coefficient while charging and by another while
/// not: with either the flow would turn, so it stays at its reversal.
#[test]
fn a_flow_that_neither_heat_transfer_lets_go_stays_at_its_reversal() {
    let rough = [
        ("coulomb_friction_n = 4.5 ", "coulomb_friction_n = 12.5 "),
        ("static_friction_n = 7.0 ", "static_friction_n = 15.0 "),
    ];
    let pressure_pa = simulated(&rig("", &rough), &drive(2.5, steps), PRESSURE_PA);
    // Held at the reference for a row, while gas and weight are on their way, and then let go.
    for pressure_pa in &pressure_pa[221..=222] {
        assert!((pressure_pa - 2e5).abs() < 0.01, "{pressure_pa}");
    }
    assert!(pressure_pa[224] < 1.9999e5);
}

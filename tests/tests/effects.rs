//! Each effect changes its block as its equation says, and nothing else.

use hil_sim::identify::simulate::simulate;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::{Rig, effect_toml};
use model_core::pressure::GaugePa;
use muscle_plant::effects::Effect;
use muscle_plant::effects::{Catalogue, EffectKind, Form};
use muscle_plant::simulation::Simulated;
use muscle_plant::subsystem::gas::{GAS_CONSTANT_J_PER_KG_K, HEAT_RATIO};
use muscle_plant::subsystem::sensors::{Reading, SensorPoint};

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

/// Contraction and pressure that are both measured, so that the muscle's force alone is simulated.
fn bench(
    step_s: f64,
    rows: usize,
    contraction: impl Fn(f64) -> f64,
    pressure_pa: impl Fn(f64) -> f64,
) -> Record {
    let time_s: Vec<f64> = (0..rows).map(|row| row as f64 * step_s).collect();
    let contractions = time_s.iter().map(|time_s| contraction(*time_s)).collect();
    let pressures = time_s.iter().map(|time_s| pressure_pa(*time_s)).collect();
    let mut record = Record::new(time_s);
    record.set(CONTRACTION, contractions);
    record.set(PRESSURE_PA, pressures);
    record
}

/// `[[effect]]` with these lines.
fn effect(name: &str, form: &str, parameters: &[(&str, f64)]) -> String {
    let keys = parameters
        .iter()
        .map(|(key, value)| format!("{key} = {value:?}\n"));
    let keys: String = keys.collect();
    format!("[[effect]]\nname = \"{name}\"\nform = \"{form}\"\n{keys}")
}

/// The force that an effect adds on the bench.
fn added_n(effect: &str, record: &Record) -> Vec<f64> {
    let with = simulated(&rig(effect, &[CLAMPED]), record, FORCE_N);
    let without = simulated(&rig("", &[CLAMPED]), record, FORCE_N);
    with.iter()
        .zip(&without)
        .map(|(with, without)| with - without)
        .collect()
}

/// A line through corners `(time, value)`.
fn through<const N: usize>(corners: [(f64, f64); N]) -> impl Fn(f64) -> f64 {
    move |time_s| {
        let after = corners.iter().position(|(corner_s, _)| *corner_s > time_s);
        match after {
            Some(0) => corners[0].1,
            None => corners[N - 1].1,
            Some(to) => {
                let ((from_s, from), (to_s, to)) = (corners[to - 1], corners[to]);
                from + (to - from) * (time_s - from_s) / (to_s - from_s)
            }
        }
    }
}

fn assert_near(found: f64, expected: f64, tolerance: f64, what: &str) {
    let apart = (found - expected).abs();
    assert!(
        apart <= tolerance,
        "{what}: {found}, expected {expected} to {tolerance}"
    );
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

/// The pressure that the nominal valve gives in 2 s, every 10 ms, under a reference that is held at
/// its middle for 0.1 ms.
fn nominal_under(reference_pa: impl Fn(f64) -> f64) -> Vec<f64> {
    let time_s: Vec<f64> = (0..20_000).map(|row| f64::from(row) * 1e-4).collect();
    let middle_pa = time_s.iter().map(|time_s| reference_pa(time_s + 0.5e-4));
    let mut fine = Record::new(time_s.clone());
    fine.set(PRESSURE_REF_PA, middle_pa.collect());
    fine.set(CONTRACTION, vec![0.1; time_s.len()]);
    fine.set(PRESSURE_PA, vec![2e5; time_s.len()]);
    let pressure_pa = simulated(&rig("", &[CLAMPED]), &fine, PRESSURE_PA);
    pressure_pa.iter().step_by(100).copied().collect()
}

/// Both lags' own solution drives the nominal valve: the delay is the mean of its rate, and the
/// dispersion's share of that its standard deviation.
#[test]
fn a_dispersed_delay_arrives_spread_about_it() {
    let (delay_s, dispersion) = (0.08, 0.25);
    let lag_s = dispersion * delay_s / 2.0_f64.sqrt();
    let pure_s = delay_s - 2.0 * lag_s;
    let parameters = [("delay_s", delay_s), ("dispersion", dispersion)];
    let dispersed = effect("transport-delay", "dispersed", &parameters);
    let coarse = drive(2.0, |time_s| if time_s < 0.995 { 2e5 } else { 3e5 });
    let late = simulated(&rig(&dispersed, &[CLAMPED]), &coarse, PRESSURE_PA);
    let arrived = |since_s: f64| {
        let lags = (since_s / lag_s).max(0.0);
        1.0 - (1.0 + lags) * (-lags).exp()
    };
    let expected = nominal_under(|time_s| 2e5 + 1e5 * arrived(time_s - 1.0 - pure_s));
    let apart_pa = apart(&late, &expected);
    // As for the lag: the reference rises at 2.6 MPa/s at most.
    assert!(apart_pa < 1.0, "{apart_pa}");
}

/// The lag's own solution drives the nominal valve.
#[test]
fn valve_lag_is_a_lagging_reference() {
    const TIME_CONSTANT_S: f64 = 0.05;
    let lagging = rig(
        "[[effect]]\nname = \"valve-lag\"\ntime_constant_s = 0.05\n",
        &[CLAMPED],
    );
    let coarse = drive(2.0, |time_s| if time_s < 0.995 { 2e5 } else { 3e5 });
    let lagged = simulated(&lagging, &coarse, PRESSURE_PA);
    let held = nominal_under(|time_s| match time_s - 1.0 {
        since_s if since_s < 0.0 => 2e5,
        since_s => 3e5 - 1e5 * (-since_s / TIME_CONSTANT_S).exp(),
    });
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
    let law = |pressure_pa: &f64| dead.nominal.muscle.force_n(0.1, GaugePa(pressure_pa - 2e4));
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

/// A valve that stays open to its supply lets air flow back as the muscle is pulled out: a
/// reservoir has it again, and a check valve keeps it in the muscle.
#[test]
fn air_that_flows_back_is_the_reservoirs_or_stays_in_the_muscle() {
    let mut record = drive(40.0, |time_s| if time_s < 0.5 { 2e5 } else { 5e5 });
    let there_and_back = through([
        (0.0, 0.1),
        (15.0, 0.1),
        (16.0, 0.2),
        (26.0, 0.2),
        (27.0, 0.1),
    ]);
    let contraction: Vec<f64> = record.time_s().iter().map(|t| there_and_back(*t)).collect();
    record.set(CONTRACTION, contraction);
    let ends_pa = |form: &str, refill: (&str, f64)| {
        let droop = effect(
            "supply-droop",
            form,
            &[("reservoir_volume_m3", 1e-3), refill],
        );
        let pressure_pa = simulated(&rig(&droop, &[CLAMPED]), &record, PRESSURE_PA);
        [15.0, 26.0, 40.0].map(|time_s: f64| {
            let row = (time_s / STEP_S).round() as usize - 1;
            pressure_pa[row] + 101_325.0
        })
    };
    let [before_pa, out_pa, after_pa] = ends_pa("linear", ("recovery_time_s", 1e3));
    assert!(out_pa < 0.97 * before_pa, "{out_pa} {before_pa}");
    // In 40 of 1000 s a little comes in.
    assert_near(after_pa, before_pa, 0.01 * before_pa, "reservoir");
    let [_, out_pa, after_pa] = ends_pa("checked", ("recovery_time_s", 1e3));
    let volume = *rig("", &[]).require_volume().expect("a volume");
    let kept_pa = out_pa * volume.volume_m3(0.2) / volume.volume_m3(0.1);
    assert_near(after_pa, kept_pa, 0.01 * kept_pa, "check valve");
    // An orifice that lets in as little.
    let little = ("conductance_kg_per_pa_s", 1e-12);
    let [before_pa, _, after_pa] = ends_pa("orifice", little);
    assert_near(after_pa, before_pa, 0.01 * before_pa, "orifice");
    let [_, out_pa, after_pa] = ends_pa("checked-orifice", little);
    let kept_pa = out_pa * volume.volume_m3(0.2) / volume.volume_m3(0.1);
    assert_near(
        after_pa,
        kept_pa,
        0.01 * kept_pa,
        "check valve behind an orifice",
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
        assert_near(*pressure_pa, 2e5, 0.01, "held");
    }
    assert!(pressure_pa[224] < 1.9999e5);
}

const REACH: f64 = 0.03;

/// Draws in, pays out, draws in again, and a minor loop on the way.
const STROKES: [(f64, f64); 6] = [
    (0.0, 0.0),
    (1.0, 0.15),
    (2.0, 0.05),
    (2.4, 0.09),
    (2.8, 0.05),
    (4.0, 0.15),
];

fn hysteresis(form: &str, own: &[(&str, f64)]) -> String {
    with_base(form, own, 0.0)
}

fn with_base(form: &str, own: &[(&str, f64)], base_share: f64) -> String {
    let all = [("force_n", 20.0), ("reach", REACH)];
    let parameters = [&all, own, &[("base_share", base_share)]].concat();
    effect("hysteresis", form, &parameters)
}

fn hystereses() -> [String; 3] {
    [
        hysteresis("maxwell-slip", &[("spread", 2.0), ("taper", 0.5)]),
        hysteresis("bouc-wen", &[("sharpness", 2.0)]),
        hysteresis("duhem", &[("asymmetry", 1.5)]),
    ]
}

#[test]
fn hysteresis_depends_on_the_way_and_not_on_the_speed() {
    for effect in hystereses() {
        let slow = bench(STEP_S, 401, through(STROKES), |_| 3e5);
        let fast = bench(0.1 * STEP_S, 401, |t| through(STROKES)(10.0 * t), |_| 3e5);
        let (slow_n, fast_n) = (added_n(&effect, &slow), added_n(&effect, &fast));
        assert!(
            apart(&slow_n, &fast_n) < 1e-4,
            "{effect} {}",
            apart(&slow_n, &fast_n)
        );
    }
}

#[test]
fn hysteresis_opposes_the_motion_in_proportion_to_pressure() {
    for effect in hystereses() {
        let at = |pressure_pa: f64| {
            added_n(
                &effect,
                &bench(STEP_S, 401, through(STROKES), |_| pressure_pa),
            )
        };
        let (low_n, high_n) = (at(1e5), at(3e5));
        let tripled: Vec<f64> = low_n.iter().map(|n| 3.0 * n).collect();
        assert!(apart(&tripled, &high_n) < 1e-5);
        // Its reach after a reversal is gone by the end of a stroke.
        assert_near(high_n[100], -20.0, 0.2, &effect);
        let asymmetry = if effect.contains("duhem") { 1.5 } else { 1.0 };
        assert_near(high_n[200], 20.0 * asymmetry, 6.0, &effect);
    }
}

/// At pressure p it is s + (1 − s) · p / 300 kPa of what it is at 300 kPa.
#[test]
fn a_share_of_the_hysteresis_is_there_without_pressure() {
    for (form, own) in [
        ("maxwell-slip", &[("spread", 2.0), ("taper", 0.5)][..]),
        ("bouc-wen", &[("sharpness", 2.0)]),
        ("duhem", &[("asymmetry", 1.5)]),
    ] {
        let at = |pressure_pa: f64, base_share: f64| {
            let record = bench(STEP_S, 401, through(STROKES), |_| pressure_pa);
            added_n(&with_base(form, own, base_share), &record)
        };
        let (with, without) = (at(1e5, 0.3), at(3e5, 0.0));
        let expected: Vec<f64> = without.iter().map(|n| n * (0.3 + 0.7 / 3.0)).collect();
        assert!(apart(&with, &expected) < 1e-5, "{form}");
    }
}

/// Each element: 1 − min(x/r, 2) at a distance x from a reversal that was reached in full, its
/// height falling with the taper's power of r.
#[test]
fn maxwell_slip_is_the_sum_of_its_elements_and_closes_minor_loops() {
    for (spread, taper) in [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0)] {
        let added = added_n(
            &hysteresis("maxwell-slip", &[("spread", spread), ("taper", taper)]),
            &bench(STEP_S, 401, through(STROKES), |_| 3e5),
        );
        for (row, added) in added.iter().enumerate().take(201).skip(101) {
            let way = 0.1 * (row - 100) as f64 * STEP_S;
            let reach = |i: i32| REACH * f64::powf(spread, f64::from(i) / 5.0 - 0.5);
            let height = |i: i32| reach(i).powf(-taper);
            let held = |i: i32| height(i) * (1.0 - (way / reach(i)).min(2.0));
            let expected_n =
                -20.0 * (0..6).map(held).sum::<f64>() / (0..6).map(height).sum::<f64>();
            assert_near(*added, expected_n, 1e-6, "on the way out");
        }
        assert_near(added[280], added[200], 1e-6, "the minor loop");
    }
}

#[test]
fn bouc_wen_and_duhem_follow_their_closed_forms() {
    let record = bench(
        STEP_S,
        201,
        through([(0.0, 0.0), (1.0, 0.1), (2.0, 0.0)]),
        |_| 3e5,
    );
    let contraction = |row: usize| 0.1 * row as f64 * STEP_S;
    let tanh = added_n(&hysteresis("bouc-wen", &[("sharpness", 2.0)]), &record);
    let dahl = added_n(&hysteresis("duhem", &[("asymmetry", 2.0)]), &record);
    for row in 0..=100 {
        let ways = contraction(row) / REACH;
        assert_near(tanh[row], -20.0 * ways.tanh(), 1e-5, "drawing in");
        assert_near(dahl[row], 20.0 * (-ways).exp_m1(), 1e-5, "drawing in");
    }
    for row in 100..=200 {
        let ways = (0.1 - contraction(200 - row)) / REACH;
        let begun = -dahl[100] / 20.0;
        let left = (begun + 2.0) * (-ways / 2.0).exp();
        assert_near(dahl[row], -20.0 * (left - 2.0), 1e-4, "paying out");
    }
}

/// Where the memory stands is unknown; a weight that was at rest says where.
#[test]
fn a_weight_at_rest_stays_there_with_hysteresis() {
    for effect in hystereses() {
        let held = rig(&effect, &[]);
        let muscle = held.nominal.muscle;
        let weight_n = 12.0 * 9.80665;
        // The pressure that holds the weight with 10 N of help, more than friction has.
        let holding_pa = (weight_n + 10.0 - muscle.gamma_n) / muscle.force_per_pressure_m2(0.1);
        let mut record = drive(1.0, |_| holding_pa);
        let first = |row| if row == 0 { holding_pa } else { f64::NAN };
        record.set(PRESSURE_PA, (0..record.time_s().len()).map(first).collect());
        let contraction = simulated(&held, &record, CONTRACTION);
        assert!(
            apart(&contraction, &vec![0.1; contraction.len()]) < 1e-9,
            "{effect}"
        );
        let slips = simulated(&rig("", &[]), &record, CONTRACTION);
        assert!(slips[slips.len() - 1] > 0.101);
    }
}

/// How much less the braid makes of a pressure at a contraction of 0.1 than without one.
fn braid() -> f64 {
    let muscle = rig("", &[]).nominal.muscle;
    muscle.force_per_pressure_m2(0.1) / muscle.force_per_pressure_m2(0.0)
}

/// A step over one row leaves size · (1 − e^(−h/τ))/(h/τ) behind, which decays as e^(−t/τ).
#[test]
fn creep_relaxes_after_a_step() {
    let (size_n, time_constant_s) = (15.0, 2.0);
    let left = |since_s: f64, time_constant_s: f64| {
        let rows = STEP_S / time_constant_s;
        -(-rows).exp_m1() / rows * (-(since_s - STEP_S) / time_constant_s).exp()
    };
    let step = |from, to| through([(0.0, from), (1.0, from), (1.0 + STEP_S, to)]);
    let pressure = bench(STEP_S, 501, |_| 0.1, step(1e5, 4e5));
    let strain = bench(STEP_S, 501, step(0.0, 0.125), |_| 2e5);
    let one = [("force_n", size_n), ("time_constant_s", time_constant_s)];
    let two = [
        ("force_n", 0.5 * size_n),
        ("time_constant_s", 0.5),
        ("second_force_n", 0.5 * size_n),
        ("second_time_constant_s", 20.0),
    ];
    for (form, parameters, record, share, times_s) in [
        (
            "relaxation",
            &one[..],
            &pressure,
            braid(),
            [time_constant_s; 2],
        ),
        ("two-relaxations", &two[..], &pressure, braid(), [0.5, 20.0]),
        (
            "strain-relaxation",
            &one[..],
            &strain,
            0.5,
            [time_constant_s; 2],
        ),
        (
            "two-strain-relaxations",
            &two[..],
            &strain,
            0.5,
            [0.5, 20.0],
        ),
    ] {
        let added = added_n(&effect("creep", form, parameters), record);
        for row in [50, 101, 150, 300, 500] {
            let since_s = (row as f64 - 100.0) * STEP_S;
            let expected_n = match row {
                50 => 0.0,
                _ => -0.5 * size_n * share * times_s.map(|t| left(since_s, t)).iter().sum::<f64>(),
            };
            assert_near(added[row], expected_n, 1e-4, form);
        }
    }
}

#[test]
fn logarithmic_creep_drifts_by_the_same_in_each_decade() {
    let step = through([(0.0, 1e5), (1.0, 1e5), (1.01, 4e5)]);
    let record = bench(0.1, 2001, |_| 0.1, step);
    let parameters = [("force_per_decade_n", 10.0)];
    let added = added_n(&effect("creep", "logarithmic", &parameters), &record);
    for (from_s, to_s) in [(1.0, 10.0), (3.0, 30.0), (10.0, 100.0), (19.0, 190.0)] {
        let at = |since_s: f64| added[((since_s + 1.0) / 0.1_f64).round() as usize];
        let decade_n = (at(to_s) - at(from_s)) / braid();
        assert_near(decade_n, 10.0, 0.8, "a decade");
    }
    let step = through([(0.0, 0.0), (1.0, 0.0), (1.01, 0.125)]);
    let record = bench(0.1, 2001, step, |_| 2e5);
    let parameters = [
        ("force_per_decade_n", 10.0),
        ("shortest_time_constant_s", 0.5),
        ("longest_time_constant_s", 500.0),
    ];
    let added = added_n(&effect("creep", "logarithmic-strain", &parameters), &record);
    for (from_s, to_s) in [(1.0, 10.0), (3.0, 30.0), (10.0, 100.0), (19.0, 190.0)] {
        let at = |since_s: f64| added[((since_s + 1.0) / 0.1_f64).round() as usize];
        assert_near(at(to_s) - at(from_s), 5.0, 0.4, "a decade");
    }
}

#[test]
fn static_terms_of_the_force_are_their_formulas() {
    let record = bench(STEP_S, 101, through([(0.0, 0.0), (1.0, 0.25)]), |t| 2e5 * t);
    let law = rig("", &[]).nominal.muscle;
    let check = |effect: String, expected_n: &dyn Fn(f64, f64) -> f64| {
        let added = added_n(&effect, &record);
        for (row, added) in added.iter().enumerate() {
            let share = row as f64 * STEP_S;
            assert_near(*added, expected_n(0.25 * share, 2e5 * share), 1e-8, &effect);
        }
    };
    let parameters = [("pressure_pa", 2e4)];
    check(
        effect("dead-band", "rounded", &parameters),
        &|contraction, pressure_pa| {
            -law.force_per_pressure_m2(contraction) * 2e4 * (1.0 - (-pressure_pa / 2e4).exp())
        },
    );
    // What the thresholds that spread about 20 kPa leave on average.
    let (dead_pa, sharpness) = (2e4, 2.0_f64);
    let centre_pa = sharpness * dead_pa / (1.0 + (-sharpness).exp()) / (1.0 + sharpness.exp()).ln();
    let above = |pressure_pa: f64| {
        let share = |pa: f64| 1.0 / (1.0 + (sharpness * (pa / centre_pa - 1.0)).exp());
        share(pressure_pa) / share(0.0)
    };
    let parameters = [("pressure_pa", dead_pa), ("sharpness", sharpness)];
    check(
        effect("dead-band", "spread", &parameters),
        &|contraction, pressure_pa| {
            let step_pa = pressure_pa / 1e5;
            let places = (0..100_000).map(|i| (f64::from(i) + 0.5) * step_pa);
            let lost_pa = places.map(|pa| above(pa) * step_pa).sum::<f64>();
            -law.force_per_pressure_m2(contraction) * lost_pa
        },
    );
    let parameters = [("force_n", 60.0), ("growth", 12.0)];
    check(
        effect("bladder-elasticity", "exponential", &parameters),
        &|contraction, _| -60.0 * ((12.0 * contraction).exp() - 1.0) / (3.0_f64.exp() - 1.0),
    );
    let parameters = [("linear_n", 30.0), ("quadratic_n", -80.0)];
    check(
        effect("bladder-elasticity", "polynomial", &parameters),
        &|contraction, _| -30.0 * (contraction / 0.25) + 80.0 * (contraction / 0.25).powi(2),
    );
    check(
        effect("slack", "sharp", &[]),
        &|contraction, pressure_pa| (-law.force_n(contraction, GaugePa(pressure_pa))).max(0.0),
    );
    check(
        effect("slack", "rounded", &[("rounding_n", 10.0)]),
        &|contraction, pressure_pa| {
            let force_n = law.force_n(contraction, GaugePa(pressure_pa));
            0.5 * (force_n.hypot(10.0) - force_n)
        },
    );
    check(
        effect("slack", "folded", &[("push_share", 0.2)]),
        &|contraction, pressure_pa| {
            (-0.8 * law.force_n(contraction, GaugePa(pressure_pa))).max(0.0)
        },
    );
}

#[test]
fn slack_holds_against_effects_that_come_after_it() {
    let parameters = [("linear_n", 300.0), ("quadratic_n", 0.0)];
    let both =
        effect("slack", "sharp", &[]) + &effect("bladder-elasticity", "polynomial", &parameters);
    let record = bench(STEP_S, 101, through([(0.0, 0.0), (1.0, 0.2)]), |_| 1e5);
    let force_n = simulated(&rig(&both, &[CLAMPED]), &record, FORCE_N);
    assert!(force_n.iter().all(|force_n| *force_n >= 0.0) && force_n[100] == 0.0);
}

#[test]
fn run_in_falls_with_the_way_and_not_with_time() {
    // Motion within this to either side is taken for noise.
    const PLAY: f64 = 5e-4;
    // One second of rest between two strokes.
    let path = [(0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0), (4.0, 0.1)];
    let record = bench(STEP_S, 401, through(path), |_| 3e5);
    let nominal_n = simulated(&rig("", &[CLAMPED]), &record, FORCE_N);
    // The way and, of two strokes each, the cycles.
    let distances = [
        (0, 0.0, 0.0),
        (50, 0.05 - PLAY, 0.5),
        (100, 0.1 - PLAY, 0.5),
        (200, 0.1 - PLAY, 0.5),
        (300, 0.2 - 3.0 * PLAY, 1.0),
        (400, 0.3 - 5.0 * PLAY, 1.5),
    ];
    for (form, key, left) in [
        (
            "exponential",
            "distance",
            (|ways| (-ways).exp()) as fn(f64) -> f64,
        ),
        ("hyperbolic", "distance", |ways| 1.0 / (1.0 + ways)),
        ("cyclic", "cycles", |ways| (-ways).exp()),
    ] {
        let parameters = [("share", 0.05), (key, 0.2)];
        let added = added_n(&effect("run-in", form, &parameters), &record);
        for (row, way, cycles) in distances {
            let done = if form == "cyclic" { cycles } else { way };
            assert_near(
                added[row] / nominal_n[row],
                0.05 * left(done / 0.2),
                1e-6,
                form,
            );
        }
    }
}

/// A stroke goes on after a rest, and a short one is less of a cycle.
#[test]
fn run_in_counts_strokes_from_turn_to_turn() {
    let path = [
        (0.0, 0.0),
        (1.0, 0.01),
        (2.0, 0.01),
        (3.0, 0.05),
        (4.0, 0.04),
    ];
    let record = bench(STEP_S, 401, through(path), |_| 3e5);
    let nominal_n = simulated(&rig("", &[CLAMPED]), &record, FORCE_N);
    let cyclic = effect("run-in", "cyclic", &[("share", 0.05), ("cycles", 0.2)]);
    let added = added_n(&cyclic, &record);
    // A play of 0.0005 to either side, and 0.04 of ways that count in a cycle.
    for (row, counted) in [(100, 0.0095), (200, 0.0095), (300, 0.02), (400, 0.029)] {
        let left = (-counted / 0.04 / 0.2_f64).exp();
        assert_near(added[row] / nominal_n[row], 0.05 * left, 1e-6, "cyclic");
    }
}

/// The first of two relaxations may be the only one.
#[test]
fn two_relaxations_are_one_where_the_second_is_none() {
    let one = [("force_n", 20.0), ("time_constant_s", 3.0)];
    let none = [("second_force_n", 0.0), ("second_time_constant_s", 15.0)];
    let lift = through([(0.0, 0.0), (5.0, 0.2)]);
    let record = bench(STEP_S, 501, lift, through([(0.0, 1e5), (5.0, 4e5)]));
    for [single, double] in [
        ["relaxation", "two-relaxations"],
        ["strain-relaxation", "two-strain-relaxations"],
    ] {
        let two = effect("creep", double, &[&one[..], &none[..]].concat());
        let one = effect("creep", single, &one);
        assert_eq!(added_n(&one, &record), added_n(&two, &record), "{double}");
    }
}

#[test]
fn friction_is_that_of_a_rig_with_more_of_it() {
    let more = [
        ("coulomb_friction_n = 4.5 ", "coulomb_friction_n = 12.5 "),
        ("static_friction_n = 7.0 ", "static_friction_n = 15.0 "),
    ];
    let record = drive(4.0, steps);
    let rough = simulated(&rig("", &more), &record, CONTRACTION);
    let coulomb = effect("friction", "coulomb", &[("force_n", 8.0)]);
    assert_eq!(simulated(&rig(&coulomb, &[]), &record, CONTRACTION), rough);
    // At a Stribeck speed far above any, the excess is Coulomb friction; far below, static only.
    let stribeck = |static_ratio: f64, speed_m_per_s: f64| {
        let parameters = [
            ("force_n", 8.0 / static_ratio),
            ("static_ratio", static_ratio),
            ("speed_m_per_s", speed_m_per_s),
        ];
        let effect = effect("friction", "stribeck", &parameters);
        simulated(&rig(&effect, &[]), &record, CONTRACTION)
    };
    assert_eq!(stribeck(1.0, 0.01), rough);
    let some = stribeck(4.0, 0.01);
    assert!(apart(&stribeck(4.0, 1.0), &rough) < 0.2 * apart(&some, &rough));
    // Bristles that hardly bend are Coulomb friction but for the static part.
    let parameters = [
        ("force_n", 8.0),
        ("static_ratio", 1.0),
        ("deflection_m", 2e-5),
    ];
    let lugre = effect("friction", "lugre", &parameters);
    let bristles = simulated(&rig(&lugre, &[]), &record, CONTRACTION);
    let nominal = simulated(&rig("", &[]), &record, CONTRACTION);
    assert!(apart(&bristles, &rough) < 0.3 * apart(&nominal, &rough));
}

#[test]
fn backlash_is_a_play_of_what_is_read() {
    let path = [(0.0, 0.02), (1.0, 0.1), (2.0, 0.03), (3.0, 0.1)];
    let record = bench(STEP_S, 301, through(path), |_| 2e5);
    let truth = record.require(CONTRACTION).expect("the column").to_vec();
    let half = 0.5 * 1.2e-3 / 0.3;
    for (form, start) in [
        ("play", 0.0),
        ("play-from-a-side", -1.0),
        ("play-from-a-side", 1.0),
    ] {
        let mut parameters = vec![("play_m", 1.2e-3)];
        parameters.extend((form != "play").then_some(("start", start)));
        let loose = rig(&effect("backlash", form, &parameters), &[CLAMPED]);
        let read = simulated(&loose, &record, CONTRACTION);
        let mut encoder = truth[0] + start * half;
        for (read, truth) in read.iter().zip(&truth) {
            encoder = encoder.clamp(truth - half, truth + half);
            assert_near(*read, encoder, 1e-12, form);
        }
        assert_eq!(
            simulated(&loose, &record, FORCE_N),
            simulated(&rig("", &[CLAMPED]), &record, FORCE_N)
        );
    }
}

/// What the shares of a graded play read, each computed apart, and on average.
#[test]
fn a_graded_backlash_is_a_sum_of_two() {
    let path = [
        (0.0, 0.02),
        (1.0, 0.1),
        (2.0, 0.097),
        (3.0, 0.1),
        (4.0, 0.03),
    ];
    let record = bench(STEP_S, 401, through(path), |_| 2e5);
    let truth = record.require(CONTRACTION).expect("the column").to_vec();
    let (half, grade, far_share) = (0.5 * 1.2e-3 / 0.3, 0.8, 0.3);
    let near = half * 0.76;
    let far = near + half * grade;
    assert_near(0.7 * near + 0.3 * far, half, 1e-15, "on average");
    let parameters = [
        ("play_m", 1.2e-3),
        ("grade", grade),
        ("far_share", far_share),
        ("start", 1.0),
    ];
    let loose = rig(&effect("backlash", "graded", &parameters), &[CLAMPED]);
    let read = simulated(&loose, &record, CONTRACTION);
    let mut shares = [truth[0] + near, truth[0] + far];
    for (read, truth) in read.iter().zip(&truth) {
        for (share, reach) in shares.iter_mut().zip([near, far]) {
            *share = share.clamp(truth - reach, truth + reach);
        }
        assert_near(*read, 0.7 * shares[0] + 0.3 * shares[1], 1e-12, "graded");
    }
}

/// The pressure that is reached from 2e5 Pa in 10 s.
fn settled_pa(effect: &str, reference_pa: f64) -> f64 {
    let record = drive(10.0, |time_s| if time_s < 0.5 { 2e5 } else { reference_pa });
    let pressure_pa = simulated(&rig(effect, &[CLAMPED]), &record, PRESSURE_PA);
    pressure_pa[pressure_pa.len() - 1]
}

#[test]
fn dead_zone_stops_short_of_the_reference_from_either_side() {
    let sharp = effect("valve-dead-zone", "sharp", &[("half_width_pa", 8e3)]);
    assert_near(settled_pa(&sharp, 3e5), 2.92e5, 1.0, "up");
    assert_near(settled_pa(&sharp, 1e5), 1.08e5, 1.0, "down");
    let sides = [("filling_pa", 5e3), ("exhausting_pa", 12e3)];
    let asymmetric = effect("valve-dead-zone", "asymmetric", &sides);
    assert_near(settled_pa(&asymmetric, 3e5), 2.95e5, 1.0, "up");
    assert_near(settled_pa(&asymmetric, 1e5), 1.12e5, 1.0, "down");
    // A rounded one goes on, slowly.
    let round = [("half_width_pa", 8e3), ("rounding_pa", 1e3)];
    let rounded = effect("valve-dead-zone", "rounded", &round);
    assert!(settled_pa(&rounded, 3e5) > 2.94e5);
    let half_open = drive(0.7, |time_s| if time_s < 0.5 { 2e5 } else { 3e5 });
    let tail = simulated(&rig(&rounded, &[CLAMPED]), &half_open, PRESSURE_PA);
    assert_near(tail[tail.len() - 1], 2.92e5, 2e3, "begin of the tail");
}

/// The rate of the pressure right after a step, over κRθ/V: the flow.
fn flow_kg_per_s(effect: &str, from_pa: f64, to_pa: f64) -> f64 {
    const FINE_S: f64 = 1e-4;
    let nominal = rig(effect, &[CLAMPED]);
    let rows: Vec<f64> = (0..80).map(|row| f64::from(row) * FINE_S).collect();
    let mut record = Record::new(rows.clone());
    let reference = |time_s: &f64| {
        if *time_s < 40.0 * FINE_S {
            from_pa
        } else {
            to_pa
        }
    };
    record.set(PRESSURE_REF_PA, rows.iter().map(reference).collect());
    record.set(CONTRACTION, vec![0.1; rows.len()]);
    let first = rows
        .iter()
        .map(|t| if *t == 0.0 { from_pa } else { f64::NAN });
    record.set(PRESSURE_PA, first.collect());
    let pressure_pa = simulated(&nominal, &record, PRESSURE_PA);
    let volume_m3 = nominal.require_volume().expect("a volume").volume_m3(0.1);
    let rate_pa_per_s = (pressure_pa[41] - pressure_pa[40]) / FINE_S;
    rate_pa_per_s * volume_m3 / (HEAT_RATIO * GAS_CONSTANT_J_PER_KG_K * 293.0)
}

#[test]
fn flow_limit_chokes_large_steps_alone() {
    let (flow_gain, atmospheric_pa) = (1.3e-7, 101_325.0);
    let ports = |critical_ratio| {
        [
            ("filling_conductance_kg_per_pa_s", 2e-9),
            ("exhausting_conductance_kg_per_pa_s", 3e-9),
            ("critical_ratio", critical_ratio),
        ]
    };
    let filling = 2e-9 * (5e5 + atmospheric_pa);
    let exhausting = 3e-9 * (3e5 + atmospheric_pa);
    let choked = effect("flow-limit", "choked-orifice", &ports(0.3));
    // 1 % for what the pressure gains within the first row.
    assert_near(
        flow_kg_per_s(&choked, 5e4, 2e5),
        filling,
        0.01 * filling,
        "fill",
    );
    assert_near(
        flow_kg_per_s(&choked, 3e5, 1e5),
        -exhausting,
        0.01 * exhausting,
        "exhaust",
    );
    let small = flow_kg_per_s("", 5e4, 5.5e4);
    assert_near(
        flow_kg_per_s(&choked, 5e4, 5.5e4),
        small,
        1e-6 * small,
        "small",
    );
    // From 4e5 Pa the supply port is not choked: the ellipse.
    let ratio: f64 = (4e5 + atmospheric_pa) / (5e5 + atmospheric_pa);
    for critical_ratio in [0.3, 0.5] {
        let place = (ratio - critical_ratio) / (1.0 - critical_ratio);
        let subsonic = filling * (1.0 - place.powi(2)).sqrt();
        let own = effect("flow-limit", "choked-orifice", &ports(critical_ratio));
        assert_near(
            flow_kg_per_s(&own, 4e5, 5e5),
            subsonic,
            0.01 * subsonic,
            "subsonic",
        );
    }

    let rounded = effect("flow-limit", "rounded", &ports(0.3));
    let linear = flow_gain * 1e4;
    let series = linear * filling / linear.hypot(filling);
    assert_near(
        flow_kg_per_s(&rounded, 5e4, 6e4),
        series,
        0.02 * series,
        "rounded",
    );

    let saturation = effect("flow-limit", "saturation", &[("flow_kg_per_s", 1e-3)]);
    let saturated = 1e-3 * (linear / 1e-3).tanh();
    assert_near(
        flow_kg_per_s(&saturation, 5e4, 6e4),
        saturated,
        0.02 * saturated,
        "tanh",
    );
}

/// A spool that lags uncovers its ports late, whichever effect the rig names first.
#[test]
fn a_lagging_valve_keeps_its_dead_zone() {
    let half_width_pa = 1e4;
    let lag = effect("valve-lag", "first-order", &[("time_constant_s", 0.05)]);
    let zone = effect(
        "valve-dead-zone",
        "sharp",
        &[("half_width_pa", half_width_pa)],
    );
    let mut record = drive(20.0, steps);
    record.set(CONTRACTION, vec![0.1; record.time_s().len()]);
    let pressure_pa = |effects: &str| simulated(&rig(effects, &[CLAMPED]), &record, PRESSURE_PA);
    let both_pa = pressure_pa(&(lag.clone() + &zone));
    assert!(apart(&both_pa, &pressure_pa(&(zone.clone() + &lag))) < 1.0);
    assert!(apart(&both_pa, &pressure_pa(&lag)) > 0.9 * half_width_pa);
    assert!(apart(&both_pa, &pressure_pa(&zone)) > 0.9 * half_width_pa);
}

/// The lag's own solution drives the nominal valve.
#[test]
fn valve_lag_of_second_order_is_a_lagging_reference() {
    const TIME_CONSTANT_S: f64 = 0.02;
    let parameters = [("time_constant_s", TIME_CONSTANT_S), ("damping_ratio", 1.0)];
    let lagging = rig(
        &effect("valve-lag", "second-order", &parameters),
        &[CLAMPED],
    );
    let coarse = drive(2.0, |time_s| if time_s < 0.995 { 2e5 } else { 3e5 });
    let lagged = simulated(&lagging, &coarse, PRESSURE_PA);
    let held = nominal_under(|time_s| match (time_s - 1.0) / TIME_CONSTANT_S {
        ways if ways < 0.0 => 2e5,
        // Two equal poles.
        ways => 3e5 - 1e5 * (1.0 + ways) * (-ways).exp(),
    });
    assert!(apart(&lagged, &held) < 1.0, "{}", apart(&lagged, &held));
}

/// Time integral of a signal from rows of `step_s`.
fn integral(values: impl Iterator<Item = f64>, step_s: f64) -> f64 {
    values.sum::<f64>() * step_s
}

/// Port and muscle pressure in 1 ms rows, 5 s after a step of 1e5 Pa at 0.5 s.
fn port_and_muscle(effect: &str) -> (Vec<f64>, Vec<f64>) {
    let time_s: Vec<f64> = (0..5500).map(|row| f64::from(row) * 1e-3).collect();
    let reference = |time_s: &f64| if *time_s < 0.5 { 2e5 } else { 3e5 };
    let mut record = Record::new(time_s.clone());
    record.set(PRESSURE_REF_PA, time_s.iter().map(reference).collect());
    record.set(CONTRACTION, vec![0.1; time_s.len()]);
    let first = time_s
        .iter()
        .map(|t| if *t == 0.0 { 2e5 } else { f64::NAN });
    record.set(PRESSURE_PA, first.collect());
    let hose = rig(effect, &[CLAMPED]);
    let port_pa = simulated(&hose, &record, PRESSURE_PA);
    let force_n = simulated(&hose, &record, FORCE_N);
    let muscle = hose.nominal.muscle;
    let pressure = |n: &f64| (n - muscle.gamma_n) / muscle.force_per_pressure_m2(0.1);
    (port_pa, force_n.iter().map(pressure).collect())
}

/// What flows through a resistance in the end is what its pressure was over time: ∫(P_port − P) dt
/// = R ΔW, and a resonator's first moment is 2ζ/ω.
#[test]
fn line_dynamics_delay_the_muscle_by_their_first_moment() {
    let volume_m3 = rig("", &[])
        .require_volume()
        .expect("a volume")
        .volume_m3(0.1);
    let moment_s = |effect: &str, sign: f64| {
        let (port_pa, muscle_pa) = port_and_muscle(effect);
        assert_near(port_pa[5499], 3e5, 30.0, "port");
        assert_near(muscle_pa[5499], 3e5, 30.0, "muscle");
        let differences = port_pa
            .iter()
            .zip(&muscle_pa)
            .map(|(port, muscle)| port - muscle);
        sign * integral(differences, 1e-3) / 1e5
    };
    let parameters = [("lag_s", 0.02), ("hose_volume_m3", 1e-5)];
    let resistance = effect("line-dynamics", "resistance", &parameters);
    // The port jumps at once to between reference and muscle; the row of the step is before that.
    let hose_kg_per_pa_s = volume_m3 / (GAS_CONSTANT_J_PER_KG_K * 293.0 * 0.02);
    let jump = 1.3e-7 / (1.3e-7 + hose_kg_per_pa_s);
    let moment = moment_s(&resistance, 1.0) + 0.5e-3 * jump;
    assert_near(moment, 0.02, 2e-4, "resistance");

    let over_angular_s = |damping: f64| 2.0 * damping * 0.05 / std::f64::consts::TAU;
    let parameters = [
        ("period_s", 0.05),
        ("damping_ratio", 0.2),
        ("hose_volume_m3", 2e-5),
    ];
    let inertance = effect("line-dynamics", "inertance", &parameters);
    // The mean of 1/P between the two pressures, on that at 300 kPa; some of the air comes later,
    // at the higher one, while the gas cools.
    let thinness = (401_325.0_f64 / 301_325.0).ln() * 4.01325;
    let expected_s = over_angular_s(0.2) * volume_m3 / 2e-5 * thinness;
    assert_near(
        moment_s(&inertance, 1.0),
        expected_s,
        0.05 * expected_s,
        "inertance",
    );

    let parameters = [("period_s", 0.05), ("damping_ratio", 0.2)];
    let tube = effect("line-dynamics", "sensor-tube", &parameters);
    assert_near(moment_s(&tube, -1.0), over_angular_s(0.2), 2e-4, "tube");
    // It rings, and the muscle does not.
    let (sensor_pa, muscle_pa) = port_and_muscle(&tube);
    let nominal = port_and_muscle("").1;
    assert!(apart(&muscle_pa, &nominal) < 0.1);
    let highest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    assert!(highest(&sensor_pa) > highest(&muscle_pa) + 1e4);
}

/// ẍ = ω²(P − x) − 2ω(ζ + κ|ẋ|/ω) ẋ in steps of 10 µs by Heun's method, under the muscle's own
/// pressure: what is left of a ringing is less with turbulence, and the same as solved here.
#[test]
fn a_turbulent_tube_damps_what_swings_far() {
    let (period_s, damping_ratio, turbulent_per_pa) = (0.05, 0.05, 5e-6);
    let parameters = [
        ("period_s", period_s),
        ("damping_ratio", damping_ratio),
        ("turbulent_damping_per_pa", turbulent_per_pa),
    ];
    let turbulent = effect("line-dynamics", "turbulent-sensor-tube", &parameters);
    let laminar = effect("line-dynamics", "sensor-tube", &parameters[..2]);
    let (read_pa, muscle_pa) = port_and_muscle(&turbulent);
    let laminar_pa = port_and_muscle(&laminar).0;
    let omega_per_s = std::f64::consts::TAU / period_s;
    let steps = 100;
    let step_s = 1e-3 / f64::from(steps);
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
            let at = |step: i32| from + (to - from) * f64::from(step) / f64::from(steps);
            let a = rates(at(step), state);
            let b = rates(at(step + 1), [0, 1].map(|i| state[i] + step_s * a[i]));
            state = [0, 1].map(|i| state[i] + 0.5 * step_s * (a[i] + b[i]));
        }
        solved_pa.push(state[0]);
    }
    // Straight between rows of 1 ms, a pressure that fills 1e5 Pa in 9 ms is off by 150 Pa.
    assert!(apart(&read_pa, &solved_pa) < 150.0);
    assert!(apart(&read_pa, &laminar_pa) > 5e3);
}

/// Port and muscle pressure in 1 ms rows of a clamped muscle behind a hose, 1 s after a step of the
/// reference from 2e5 to 3e5 Pa at 0.5 s, by Heun's method in steps of 5 µs: Eqs 3, 4 and 9, with a
/// volume at the port or, without one, K_G (P_r − P_port) = C (P_port − P).
fn hose_solved(volume_m3: Option<f64>, hose_kg_per_pa_s: f64) -> (Vec<f64>, Vec<f64>) {
    let rig = rig("", &[CLAMPED]);
    let (gas, valve) = (
        rig.nominal.gas.expect("gas"),
        rig.nominal.valve.expect("a valve"),
    );
    let muscle_m3 = rig.require_volume().expect("a volume").volume_m3(0.1);
    let length_m = 0.9 * rig.nominal.muscle.initial_length_m;
    let wall_m2 = 2.0 * (std::f64::consts::PI * muscle_m3 * length_m).sqrt();
    let air_pa = gas.atmospheric_pressure.0;
    let per_kg = GAS_CONSTANT_J_PER_KG_K;
    let heat = per_kg / (HEAT_RATIO - 1.0);
    let gain = valve.flow_gain_kg_per_pa_s;
    let at_once = |reference: f64, muscle: f64| {
        (gain * reference + hose_kg_per_pa_s * muscle) / (gain + hose_kg_per_pa_s)
    };
    // Gauge pressures of port and muscle, and the temperature.
    let rates = |reference: f64, [port, muscle, kelvin]: [f64; 3]| {
        let port = volume_m3.map_or(at_once(reference, muscle), |_| port);
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
        let at_port = volume_m3.map_or(0.0, |volume| stored * per_kg * 293.0 / volume);
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
        port_pa.push(volume_m3.map_or(port, |_| state[0]));
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

/// A hose without volume at the port, and two that differ in it: 2e-4 m³ are seen, 1e-6 m³ fill in
/// 0.04 ms and are none.
#[test]
fn a_port_has_its_own_pressure_or_the_one_that_valve_and_hose_agree_on() {
    let muscle_m3 = rig("", &[])
        .require_volume()
        .expect("a volume")
        .volume_m3(0.1);
    let lag_s = 0.03;
    let of_lag = muscle_m3 / (GAS_CONSTANT_J_PER_KG_K * 293.0 * lag_s);
    let conductance = effect(
        "line-dynamics",
        "conductance",
        &[("conductance_kg_per_pa_s", 1e-7), ("hose_volume_m3", 1e-6)],
    );
    let resistance = |hose_volume_m3: f64| {
        let parameters = [("lag_s", lag_s), ("hose_volume_m3", hose_volume_m3)];
        effect("line-dynamics", "resistance", &parameters)
    };
    // The air that 1e-6 m³ take is left to the muscle where they are none.
    let left_pa = HEAT_RATIO * 1e-6 / muscle_m3 * 1e5;
    for (hose, volume_m3, hose_kg_per_pa_s, near_pa) in [
        (conductance, None, 1e-7, 1.0),
        (resistance(2e-4), Some(2e-4), of_lag, 1.0),
        (resistance(1e-6), Some(1e-6), of_lag, left_pa),
    ] {
        let (port_pa, muscle_pa) = port_and_muscle(&hose);
        let (port_solved_pa, muscle_solved_pa) = hose_solved(volume_m3, hose_kg_per_pa_s);
        let near = |found: &[f64], solved: &[f64]| {
            let farthest_pa = apart(&found[..1500], solved);
            assert!(farthest_pa < near_pa, "{hose}: {farthest_pa}");
        };
        near(&port_pa, &port_solved_pa);
        near(&muscle_pa, &muscle_solved_pa);
    }
}

/// What the force says of a muscle behind a hose, from a port's pressure that was solved apart, is
/// the muscle's own: to what straight lines between 1 ms rows miss in the one in which the port
/// jumps, half of 1 ms over the time constant in which the muscle follows, V/(κRTC).
#[test]
fn a_conductance_fills_the_muscle_from_a_measured_pressure() {
    let (port_pa, muscle_pa) = hose_solved(None, 1e-7);
    let hose = effect(
        "line-dynamics",
        "conductance",
        &[("conductance_kg_per_pa_s", 1e-7), ("hose_volume_m3", 1e-6)],
    );
    let record = bench(
        1e-3,
        1500,
        |_| 0.1,
        |time_s| port_pa[(time_s * 1e3).round() as usize],
    );
    let force_n = simulated(&rig(&hose, &[CLAMPED]), &record, FORCE_N);
    let rig = rig("", &[CLAMPED]);
    let per_pressure_m2 = rig.nominal.muscle.force_per_pressure_m2(0.1);
    let found_pa: Vec<f64> = force_n
        .iter()
        .map(|n| (n - rig.nominal.muscle.gamma_n) / per_pressure_m2)
        .collect();
    let volume_m3 = rig.require_volume().expect("a volume").volume_m3(0.1);
    let follows_s = volume_m3 / (HEAT_RATIO * GAS_CONSTANT_J_PER_KG_K * 293.0 * 1e-7);
    let jump_pa = port_pa[501] - port_pa[500];
    let farthest_pa = apart(&found_pa, &muscle_pa);
    let most_pa = 0.55 * jump_pa * 1e-3 / follows_s;
    assert!(farthest_pa < most_pa, "{farthest_pa}, {most_pa}");
    assert_near(found_pa[1499], muscle_pa[1499], 5.0, "in the end");
    assert!(apart(&port_pa, &muscle_pa) > 5e4);
}

#[test]
fn a_resistance_lags_the_force_behind_a_measured_pressure() {
    let parameters = [("lag_s", 0.02), ("hose_volume_m3", 1e-5)];
    let resistance = effect("line-dynamics", "resistance", &parameters);
    let record = bench(
        STEP_S,
        201,
        |_| 0.1,
        through([(0.0, 1e5), (1.0, 1e5), (2.0, 3e5)]),
    );
    let added = added_n(&resistance, &record);
    let behind_pa = 2e5 * 0.02;
    let expected_n = -rig("", &[]).nominal.muscle.force_per_pressure_m2(0.1) * behind_pa;
    assert_near(added[100], 0.0, 1e-9, "before the ramp");
    assert_near(added[200], expected_n, 1e-4, "on the ramp");
}

/// K_G (P_r − P) = c (P + P_a) at rest.
#[test]
fn a_leak_through_a_hole_chokes() {
    let (flow_gain, conductance) = (1.3e-7, 4e-9);
    let hole = effect(
        "leak",
        "orifice",
        &[("conductance_kg_per_pa_s", conductance)],
    );
    for reference_pa in [2.5e5, 4e5] {
        let expected_pa =
            (flow_gain * reference_pa - conductance * 101_325.0) / (flow_gain + conductance);
        assert_near(
            settled_pa(&hole, reference_pa),
            expected_pa,
            20.0,
            "settled",
        );
    }
}

/// The paper's valve A, with which the gas has time to cool.
const SMALL_VALVE: (&str, &str) = (
    "flow_gain_kg_per_pa_s = 1.3e-7",
    "flow_gain_kg_per_pa_s = 6.1e-9",
);

#[test]
fn heat_exchange_is_another_coefficient() {
    let coefficients = |charging: f64, discharging: f64| {
        let lines = [
            ("charging_w_per_m2_k = 120.0", charging),
            ("discharging_w_per_m2_k = 80.0", discharging),
        ];
        let mut text = Rig::REFERENCE_TOML.to_owned();
        for (from, to) in [CLAMPED, SMALL_VALVE] {
            text = text.replace(from, to);
        }
        for (line, value) in lines {
            let key = line.split(" = ").next().expect("a key");
            text = text.replace(
                &format!("heat_transfer_{line}"),
                &format!("heat_transfer_{key} = {value:?}"),
            );
        }
        Rig::parse("rig.toml", &text).expect("a rig")
    };
    let record = drive(4.0, steps);
    let factor = rig(
        &effect("heat-exchange", "factor", &[("factor", 5.0)]),
        &[CLAMPED, SMALL_VALVE],
    );
    let factor_pa = simulated(&factor, &record, PRESSURE_PA);
    let replaced_pa = simulated(&coefficients(600.0, 400.0), &record, PRESSURE_PA);
    assert_eq!(factor_pa, replaced_pa);
    assert!(
        apart(
            &factor_pa,
            &simulated(&rig("", &[CLAMPED, SMALL_VALVE]), &record, PRESSURE_PA)
        ) > 1e3
    );
    // A wall with little heat capacity passes on what the outside takes: two resistances in series.
    let parameters = [("factor", 5.0), ("wall_heat_capacity_j_per_m2_k", 1.0)];
    let wall = rig(
        &effect("heat-exchange", "wall", &parameters),
        &[CLAMPED, SMALL_VALVE],
    );
    let series = |inside: f64| inside * 10.0 / (inside + 10.0);
    let both = coefficients(series(600.0), series(400.0));
    let [wall_pa, both_pa, factor_pa] =
        [&wall, &both, &factor].map(|rig| simulated(rig, &record, PRESSURE_PA));
    // The little heat capacity is a tenth of the gas's.
    let share = apart(&wall_pa, &both_pa) / apart(&wall_pa, &factor_pa);
    assert!(share < 0.1, "{share}");
}

/// A leak draws on the supply for ever: what the orifice then passes is what leaks.
#[test]
fn a_supply_behind_an_orifice_droops_by_what_is_drawn() {
    let (flow_gain, leak, orifice) = (1.3e-7, 2e-9, 4e-9);
    let parameters = [
        ("reservoir_volume_m3", 1e-4),
        ("conductance_kg_per_pa_s", orifice),
    ];
    let droop = effect("supply-droop", "orifice", &parameters)
        + &effect("leak", "linear", &[("conductance_kg_per_pa_s", leak)]);
    let pressure_pa = settled_pa(&droop, 5e5);
    let supply_pa = pressure_pa * (flow_gain + leak) / flow_gain;
    assert!(supply_pa < 4.9e5, "{supply_pa}");
    let upstream_pa = 5e5 + 101_325.0;
    let ratio: f64 = (supply_pa + 101_325.0) / upstream_pa;
    let passed = orifice * upstream_pa * (1.0 - ((ratio - 0.5) / 0.5).powi(2)).sqrt();
    assert_near(passed, leak * pressure_pa, 1e-3 * passed, "flow");
}

#[test]
fn quadratic_pressure_gain_bends_and_is_taken_off() {
    let parameters = [("gain_error", 0.03), ("nonlinearity", 0.02)];
    let effect = effect("pressure-sensor-gain", "quadratic", &parameters);
    let sensors = rig(&effect, &[CLAMPED]).plant(Simulated::GAS_ONLY);
    let sensors = sensors.expect("a plant").sensors;
    for (truth_pa, read_pa) in [(1e5, 1e5 * (1.03 + 0.02 / 3.0)), (3e5, 3.15e5)] {
        let truth = Reading {
            pressure: GaugePa(truth_pa),
            contraction: 0.1,
            force_n: 200.0,
        };
        let at = SensorPoint {
            time_s: 0.0,
            initial_length_m: sensors.initial_length_m,
            truth,
        };
        let read = sensors.read(&at, &[]);
        assert_near(read.pressure.0, read_pa, 1e-6, "reading");
        assert_eq!((read.contraction, read.force_n), (0.1, 200.0));
        let found_pa = sensors.truth(0.0, read).pressure.0;
        assert_near(found_pa, truth_pa, 1e-6, "truth");
    }
}

/// What is read of a truth at a time \[s\].
type Read = fn(f64, f64) -> f64;

/// Effects on sensors, and what these read of pressure and contraction.
fn sensors() -> [(String, Read, Read); 5] {
    let same = |value: f64, _: f64| value;
    [
        (
            effect(
                "pressure-sensor-gain",
                "proportional",
                &[("gain_error", 0.05)],
            ),
            |pressure_pa, _| 1.05 * pressure_pa,
            same,
        ),
        (
            effect(
                "pressure-sensor-drift",
                "linear",
                &[("drift_pa_per_s", 200.0)],
            ),
            |pressure_pa, time_s| pressure_pa + 200.0 * time_s,
            same,
        ),
        (
            effect(
                "pressure-sensor-drift",
                "quadratic",
                &[("drift_pa_per_s", 200.0), ("growth_pa_per_s2", -30.0)],
            ),
            |pressure_pa, time_s| pressure_pa + 200.0 * time_s - 15.0 * time_s * time_s,
            same,
        ),
        (
            effect(
                "pressure-sensor-drift",
                "warm-up",
                &[("drift_pa", 4e3), ("time_constant_s", 2.0)],
            ),
            |pressure_pa, time_s| pressure_pa + 4e3 * (1.0 - (-time_s / 2.0).exp()),
            same,
        ),
        (
            effect("contraction-sensor-offset", "constant", &[("offset", 0.01)]),
            same,
            |contraction, _| contraction + 0.01,
        ),
    ]
}

#[test]
fn sensors_read_and_inputs_are_read_back() {
    let path = through([(0.0, 0.02), (1.0, 0.1)]);
    let truth = bench(STEP_S, 101, &path, through([(0.0, 1e5), (1.0, 3e5)]));
    let true_n = simulated(&rig("", &[CLAMPED]), &truth, FORCE_N);
    for (effect, pressure, contraction) in sensors() {
        let mut read = truth.clone();
        for (name, sensor) in [(PRESSURE_PA, pressure), (CONTRACTION, contraction)] {
            let values = truth.require(name).expect("the column").iter();
            let times = truth.time_s().iter();
            read.set(
                name,
                values
                    .zip(times)
                    .map(|(value, t)| sensor(*value, *t))
                    .collect(),
            );
        }
        let sensed = rig(&effect, &[CLAMPED]);
        assert!(
            apart(&simulated(&sensed, &read, FORCE_N), &true_n) < 1e-6,
            "{effect}"
        );
        for name in [PRESSURE_PA, CONTRACTION] {
            let expected = read.require(name).expect("the column");
            assert!(
                apart(&simulated(&sensed, &read, name), expected) < 1e-6,
                "{effect}"
            );
        }
    }
}

fn every_form() -> impl Iterator<Item = (&'static EffectKind, &'static Form)> {
    let forms = |kind: &'static EffectKind| kind.forms.iter().map(move |form| (kind, form));
    Catalogue::standard().kinds().flat_map(forms)
}

fn usual(kind: &'static EffectKind, form: &'static Form) -> Effect {
    let values = form.parameters.iter().map(|parameter| parameter.typical);
    Effect {
        kind,
        form,
        values: values.collect(),
    }
}

#[test]
fn the_catalogue_has_every_name_and_its_parameters_are_in_order() {
    let blocks = [
        (
            "muscle-force",
            "hysteresis creep dead-band bladder-elasticity slack run-in",
        ),
        ("load", "friction payload backlash"),
        ("valve", "valve-dead-zone flow-limit valve-lag"),
        ("line", "transport-delay line-dynamics"),
        ("gas", "leak heat-exchange"),
        ("supply", "supply-droop"),
        (
            "sensor",
            "pressure-sensor-offset pressure-sensor-gain pressure-sensor-drift \
             contraction-sensor-offset force-sensor-offset",
        ),
    ];
    let named = blocks
        .iter()
        .flat_map(|(block, names)| names.split_whitespace().map(move |name| (name, *block)));
    let found: Vec<_> = Catalogue::standard()
        .kinds()
        .map(|kind| (kind.name, kind.subsystem.name()))
        .collect();
    assert_eq!(found, named.collect::<Vec<_>>());
    for (kind, form) in every_form() {
        let what = format!("{} {}", kind.name, form.name);
        assert!(form.parameters.len() <= 5, "{what}");
        let same_name = kind.forms.iter().filter(|other| other.name == form.name);
        assert_eq!(same_name.count(), 1, "{what}");
        for parameter in form.parameters {
            let inside = |value: f64| (parameter.min..=parameter.max).contains(&value);
            assert!(inside(parameter.typical), "{what} {}", parameter.name);
            assert!(
                parameter.neutral.is_none_or(inside),
                "{what} {}",
                parameter.name
            );
            assert!(
                !parameter.log || parameter.min > 0.0,
                "{what} {}",
                parameter.name
            );
        }
    }
}

#[test]
fn a_force_sensor_reads_its_offset_where_the_muscle_hangs_loose_too() {
    let record = bench(STEP_S, 101, |_| 0.2, |time_s| 3e5 * time_s);
    let loose = "[[effect]]\nname = \"slack\"\n";
    let offset = "[[effect]]\nname = \"force-sensor-offset\"\noffset_n = -7.0\n";
    let true_n = simulated(&rig(loose, &[CLAMPED]), &record, FORCE_N);
    let read_n = simulated(
        &rig(&[offset, loose].concat(), &[CLAMPED]),
        &record,
        FORCE_N,
    );
    assert!(true_n[0] == 0.0 && true_n[100] > 100.0);
    assert!(
        true_n
            .iter()
            .zip(&read_n)
            .all(|(is, read)| (read - is + 7.0).abs() < 1e-9)
    );
}

#[test]
fn every_form_is_written_and_read_back() {
    for (kind, form) in every_form() {
        let mut effect = usual(kind, form);
        for value in &mut effect.values {
            *value *= 1.0 - 1e-15;
        }
        let read = rig(&effect_toml(&effect), &[]).effects;
        assert_eq!(read.len(), 1);
        assert_eq!(
            (read[0].kind.name, read[0].form.name),
            (kind.name, form.name)
        );
        assert_eq!(read[0].values, effect.values);
    }
}

/// Runs with everything simulated, with the muscle clamped, and with force alone.
fn runs(effect: &str, tolerance: f64) -> Vec<f64> {
    let busy =
        |time_s: f64| [2e5, 3e5, 2.4e5, 4.9e5, 2.5e5, 0.5e5, 2e5][(2.0 * time_s) as usize % 7];
    let path = bench(STEP_S, 401, through(STROKES), |t| {
        2e5 + 1.9e5 * (5.0 * t).sin()
    });
    let mut signals = Vec::new();
    for (rig, record) in [
        (rig(effect, &[]), drive(4.0, busy)),
        (rig(effect, &[CLAMPED]), drive(4.0, busy)),
        (rig(effect, &[CLAMPED]), path),
    ] {
        let simulated = simulate(&rig, &record, tolerance).expect("simulated");
        for (column, range) in [(PRESSURE_PA, 4e5), (CONTRACTION, 0.25), (FORCE_N, 400.0)] {
            let values = simulated.require(column).expect("the column").iter();
            signals.extend(values.map(|value| value / range));
        }
    }
    signals
}

#[test]
fn every_form_leaves_its_mark_and_none_at_its_neutral_values() {
    let nominal = runs("", TOLERANCE);
    for (kind, form) in every_form() {
        let what = format!("{} {}", kind.name, form.name);
        let mut effect = usual(kind, form);
        let changed = apart(&runs(&effect_toml(&effect), TOLERANCE), &nominal);
        assert!(changed > 9e-4, "{what}: {changed}");
        let parameters = form.parameters.iter();
        let mut neutral = false;
        for (value, parameter) in effect.values.iter_mut().zip(parameters) {
            *value = parameter.neutral.unwrap_or(*value);
            neutral |= parameter.neutral.is_some();
        }
        if neutral {
            let left = apart(&runs(&effect_toml(&effect), TOLERANCE), &nominal);
            assert!(left < 1e-6, "{what}: {left}");
        } else {
            assert!(
                kind.name == "slack" || form.name.starts_with("checked"),
                "{what}"
            );
        }
    }
}

/// Static friction that falls away as the weight starts makes it sensitive to when it does: with
/// the Stribeck form this is reached, with the others far from it.
const LIMIT: f64 = 3e-4;

#[test]
fn every_form_converges_with_the_tolerance() {
    for (kind, form) in every_form() {
        let effect = effect_toml(&usual(kind, form));
        let apart = apart(&runs(&effect, 1e-6), &runs(&effect, 1e-9));
        println!("{:22} {:18} {apart:.1e}", kind.name, form.name);
        assert!(apart < LIMIT, "{} {}: {apart}", kind.name, form.name);
    }
}

/// A fit may go anywhere inside the bounds: what comes back is numbers, or a message.
#[test]
fn no_form_panics_at_the_ends_of_its_parameters() {
    let record = drive(0.6, |time_s| [4.9e5, 0.0, 2e5][(5.0 * time_s) as usize]);
    for (kind, form) in every_form() {
        for (i, parameter) in form.parameters.iter().enumerate() {
            for value in [parameter.min, parameter.max] {
                let mut effect = usual(kind, form);
                effect.values[i] = value;
                for changes in [&[][..], &[CLAMPED]] {
                    let Ok(simulated) =
                        simulate(&rig(&effect_toml(&effect), changes), &record, 1e-4)
                    else {
                        continue;
                    };
                    let force_n = simulated.require(FORCE_N).expect("the column");
                    assert!(
                        force_n.iter().all(|n| n.is_finite()),
                        "{}",
                        effect_toml(&effect)
                    );
                }
            }
        }
    }
}

/// A rig with these lines at its end is refused there.
fn assert_refused(text: &str, line: usize, key: &str, says: &str) {
    let parsed = Rig::parse("rig.toml", &(Rig::REFERENCE_TOML.to_owned() + text));
    let drive = drive(0.1, steps);
    let error = parsed.and_then(|rig| simulate(&rig, &drive, TOLERANCE));
    let message = error.expect_err("a malformed effect").to_string();
    let place = format!("rig.toml:{line}: key `{key}`: expected ");
    assert!(
        message.starts_with(&place) && message.contains(says),
        "{message}\n{place}{says}"
    );
}

#[test]
fn malformed_effects_are_refused_with_line_and_key() {
    let first = Rig::REFERENCE_TOML.lines().count() + 1;
    let leak = "[[effect]]\nname = \"leak\"\n";
    let hysteresis = "[[effect]]\nname = \"hysteresis\"\nform = \"duhem\"\nforce_n = 20\n";
    let many = "[[effect]]\nname = \"valve-lag\"\ntime_constant_s = 0.1\n".repeat(37);
    for (text, line, key, says) in [
        (
            "[[effect]]\n".to_owned(),
            0,
            "effect.name",
            "a string, found no such key",
        ),
        (
            "[[effect]]\nname = \"leek\"\n".into(),
            1,
            "effect.name",
            "one of hysteresis, creep,",
        ),
        (
            leak.to_owned() + "form = 2\n",
            2,
            "effect.form",
            "a string, found integer",
        ),
        (
            leak.to_owned() + "form = \"slit\"\n",
            2,
            "effect.form",
            "one of linear, orifice, power, found",
        ),
        (
            leak.to_owned(),
            0,
            "effect.conductance_kg_per_pa_s",
            "a number [kg/(Pa·s)], found no",
        ),
        (
            leak.to_owned() + "conductance_kg_per_pa_s = -1e-9\n",
            2,
            "effect.conductance_kg_per_pa_s",
            "a number from 0e0 to 1e-6",
        ),
        (
            hysteresis.to_owned() + "reach = 0.02\nsharpness = 2\n",
            5,
            "effect.sharpness",
            "one of the keys name, form, force_n, reach, asymmetry, base_share, \
             found this",
        ),
        (
            hysteresis.to_owned() + "reach = \"far\"\nasymmetry = 1\n",
            4,
            "effect.reach",
            "a number, found string",
        ),
        (
            hysteresis.to_owned() + "reach = 0.02\n",
            0,
            "effect.asymmetry",
            "a number [1], found no",
        ),
        (many, 0, "effect", "effects with at most 36 states together"),
    ] {
        assert_refused(&text, first + line, key, says);
    }
}

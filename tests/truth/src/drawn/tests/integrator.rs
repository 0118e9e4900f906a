//! Tests of the adaptive integrator: agreement with fixed steps, conservation, error with each
//! effect.

use rayon::prelude::*;

use super::super::bench::{Bench, Clock};
use super::super::drive::{Run, Start, Style};
use super::super::effects::DRAWN;
use super::{bench, rng};
use crate::hidden::{Hidden, Reading};
use crate::machine::{GRAVITY_M_PER_S2, Machine};
use crate::record::Sensors;
use crate::rig::Rig;

/// Least noise of a drawn case over that of the reference sensors.
const LEAST_NOISE: f64 = 0.25;

fn run(bench: &Bench, seed: u64) -> Run {
    let clock = Clock {
        rate_hz: 100.0,
        duration_s: 16.0,
        jitter: 0.2,
    };
    let start = Start {
        moving: false,
        vents: true,
        vented: false,
    };
    let styles = [Style::Steps, Style::Triangles, Style::Random];
    Run::draw(bench, &clock, &styles, start, &mut rng(seed))
}

/// Root mean squares of differences over the least noise, of pressure, contraction and force.
fn off(one: &[Reading], other: &[Reading], bench: &Bench) -> [f64; 3] {
    let sensors = Sensors::default();
    let relative = Rig::default().initial_length_m / bench.rig.initial_length_m;
    let noise = [
        sensors.pressure_pa.noise(),
        sensors.contraction.noise() * relative,
        sensors.force_n.noise(),
    ];
    let differences = crate::case::differences(&[one.to_vec()], &[other.to_vec()]);
    std::array::from_fn(|i| differences[i] / (LEAST_NOISE * noise[i]))
}

#[test]
fn integration_errors_stay_far_below_the_least_noise_with_every_effect() {
    let all: Vec<(usize, u64)> = (0..DRAWN.len())
        .flat_map(|i| (0..3).map(move |seed| (i, seed)))
        .collect();
    let errors: Vec<(String, [f64; 3])> = all
        .par_iter()
        .map(|&(i, seed)| {
            let entry = &DRAWN[i];
            let bench = bench(100 * seed + i as u64, entry.near_supply);
            let law = (entry.draw)(&bench, 0.7, &mut rng(seed));
            let run = run(&bench, seed);
            let hidden: [&dyn Hidden; 1] = [law.hidden.as_ref()];
            let usual = run.repeat(&bench.rig, &hidden);
            let exact = run.repeat_within(&bench.rig, &hidden, 0.01);
            let name = format!("{} {} {seed}", entry.name, law.form);
            (name, off(&usual, &exact, &bench))
        })
        .collect();
    let bad: Vec<_> = errors
        .iter()
        .filter(|(_, off)| off.iter().any(|off| *off > 0.5))
        .collect();
    assert!(bad.is_empty(), "{bad:?}");
}

#[test]
fn adaptive_and_fixed_steps_agree() {
    let rig = Rig::default();
    let mut adaptive = Machine::at_rest(&rig, &[], 0.0, 2.0e5);
    let mut fixed = Machine::at_rest(&rig, &[], 0.0, 2.0e5);
    for (row, command_pa) in [2.0e5, 3.0e5, 2.5e5, 0.5e5, 1.8e5].into_iter().enumerate() {
        adaptive.advance(row as f64 + 1.0, command_pa);
        for _ in 0..100_000 {
            fixed.step(1.0e-5, command_pa);
        }
        let (one, other) = (adaptive.truth(), fixed.truth());
        assert!(
            (one.pressure_pa - other.pressure_pa).abs() < 5.0,
            "{one:?} {other:?}"
        );
        assert!(
            (one.contraction - other.contraction).abs() < 2.0e-6,
            "{one:?} {other:?}"
        );
    }
}

#[test]
fn shut_valve_keeps_mass_and_total_energy() {
    let rig = Rig {
        flow_gain_kg_per_pa_s: 0.0,
        viscous_damping_ns_per_m: 0.0,
        coulomb_friction_n: 0.0,
        static_friction_n: 0.0,
        heat_transfer_charging_w_per_m2_k: 0.0,
        heat_transfer_discharging_w_per_m2_k: 0.0,
        ..Rig::default()
    };
    let mut machine = Machine::at_rest(&rig, &[], 0.0, 4.0e5);
    let (mass_kg, energy_j) = machine.mass_and_energy();
    let (mut gas_j, mut muscle_j, mut highest) = (0.0, 0.0, 0.0_f64);
    let power = |machine: &Machine| {
        let now = machine.now();
        let slope_m3 = 2.0 * rig.volume_d1_m3 * now.contraction + rig.volume_d2_m3;
        let absolute_pa = now.pressure_pa + rig.atmospheric_pressure_pa;
        let speed_m_per_s = rig.initial_length_m * now.rate_per_s;
        (
            absolute_pa * slope_m3 * now.rate_per_s,
            now.force_n * speed_m_per_s,
        )
    };
    let mut before = power(&machine);
    for i in 1..=2_000 {
        machine.advance(f64::from(i) * 1.0e-4, 4.0e5);
        let after = power(&machine);
        gas_j += 0.5e-4 * (before.0 + after.0);
        muscle_j += 0.5e-4 * (before.1 + after.1);
        before = after;
        highest = highest.max(machine.now().contraction);
    }
    let (mass_after_kg, energy_after_j) = machine.mass_and_energy();
    assert!(highest > 0.05, "the weight was to move");
    assert!((mass_after_kg / mass_kg - 1.0).abs() < 1.0e-12);
    assert!((energy_after_j - (energy_j - gas_j)).abs() < 1.0e-3);
    let now = machine.now();
    let speed_m_per_s = rig.initial_length_m * now.rate_per_s;
    let height_m = rig.initial_length_m * now.contraction;
    let kinetic_j = 0.5 * rig.mass_kg * speed_m_per_s * speed_m_per_s;
    let stored_j = kinetic_j + rig.mass_kg * GRAVITY_M_PER_S2 * height_m;
    assert!(
        (stored_j - muscle_j).abs() < 1.0e-3,
        "{stored_j} {muscle_j}"
    );
}

//! Conservation and convergence of the rig without effects, and convergence with each of them.

use rayon::prelude::*;

use super::{PERIOD_S, Rig, draw, forms, frictionless, holds, near, pieces, with};
use crate::Hiding;
use crate::effects::CATALOGUE;
use crate::hidden::{Hidden, Reading};
use crate::machine::{
    GRAVITY_M_PER_S2, HEAT_CAPACITY_P_J_PER_KG_K, HEAT_CAPACITY_V_J_PER_KG_K, Machine,
};
use crate::record::{STEP_S, Sensors};

fn volume_m3(rig: &Rig, contraction: f64) -> f64 {
    rig.volume_d1_m3 * contraction * contraction + rig.volume_d2_m3 * contraction + rig.volume_d3_m3
}

#[test]
fn shut_valve_keeps_mass_entropy_and_mechanical_energy() {
    let rig = Rig {
        flow_gain_kg_per_pa_s: 0.0,
        viscous_damping_ns_per_m: 0.0,
        heat_transfer_charging_w_per_m2_k: 0.0,
        heat_transfer_discharging_w_per_m2_k: 0.0,
        ..frictionless()
    };
    let mut machine = Machine::at_rest(&rig, &[], 0.0, 4.0e5);
    let kappa = HEAT_CAPACITY_P_J_PER_KG_K / HEAT_CAPACITY_V_J_PER_KG_K;
    let adiabat = |machine: &Machine| {
        let now = machine.now();
        now.temperature_k * volume_m3(&rig, now.contraction).powf(kappa - 1.0)
    };
    let (mass_kg, energy_j) = machine.mass_and_energy();
    let start = adiabat(&machine);
    let (mut muscle_j, mut gas_j, mut highest) = (0.0, 0.0, 0.0_f64);
    let power = |machine: &Machine| {
        let now = machine.now();
        let speed_m_per_s = rig.initial_length_m * now.rate_per_s;
        let area_m2 = 2.0 * rig.volume_d1_m3 * now.contraction + rig.volume_d2_m3;
        let absolute_pa = now.pressure_pa + rig.atmospheric_pressure_pa;
        (
            now.force_n * speed_m_per_s,
            absolute_pa * area_m2 * now.rate_per_s,
        )
    };
    let mut before = power(&machine);
    for _ in 0..2_000 {
        machine.step(STEP_S, 4.0e5);
        let after = power(&machine);
        // trapezoids: good to the square of the step
        muscle_j += 0.5 * STEP_S * (before.0 + after.0);
        gas_j += 0.5 * STEP_S * (before.1 + after.1);
        before = after;
        highest = highest.max(machine.now().contraction);
    }
    let now = machine.now();
    let (mass_after_kg, energy_after_j) = machine.mass_and_energy();
    assert!(highest > 0.05, "the weight was to move");
    assert!((mass_after_kg - mass_kg).abs() <= 1e-15 * mass_kg);
    assert!((adiabat(&machine) / start - 1.0).abs() < 1e-8);
    // a square of the step over twelve, times a slope of power of some 10⁵ W/s
    super::near(energy_after_j, energy_j - gas_j, 2e-4);
    let speed_m_per_s = rig.initial_length_m * now.rate_per_s;
    let height_m = rig.initial_length_m * now.contraction;
    let stored_j =
        rig.mass_kg * (0.5 * speed_m_per_s * speed_m_per_s + GRAVITY_M_PER_S2 * height_m);
    super::near(stored_j, muscle_j, 2e-4);
}

#[test]
fn filling_a_fixed_volume_adds_the_enthalpy_of_what_flows_in() {
    let rig = Rig {
        heat_transfer_charging_w_per_m2_k: 0.0,
        heat_transfer_discharging_w_per_m2_k: 0.0,
        ..super::isometric()
    };
    let mut machine = Machine::at_rest(&rig, &[], 0.0, 0.0);
    let (mass_kg, energy_j) = machine.mass_and_energy();
    // less than it takes to reach the reference: gas only flows in
    for _ in 0..200 {
        machine.step(STEP_S, 4.0e5);
    }
    let (filled_kg, filled_j) = machine.mass_and_energy();
    assert!(filled_kg > 2.0 * mass_kg);
    let inflow_j_per_kg = HEAT_CAPACITY_P_J_PER_KG_K * rig.ambient_temperature_k;
    let expected_j = energy_j + inflow_j_per_kg * (filled_kg - mass_kg);
    super::near(filled_j, expected_j, 1e-9 * filled_j);
}

#[test]
fn the_papers_equilibrium_is_reproduced() {
    // at 400 kPa the reference rig stands at 0.246
    let readings = super::bare(&holds(&[(3.0, 4.0e5)]), &frictionless());
    let last = readings.last().expect("samples");
    super::near(last.contraction, 0.246, 0.0005);
    super::near(last.pressure_pa, 4.0e5, 1.0);
    super::near(last.force_n, 12.0 * GRAVITY_M_PER_S2, 0.05);
}

#[test]
fn static_friction_and_the_stop_hold_the_weight() {
    let rig = Rig::default();
    // 5 N of static friction are not overcome by 3 kPa at 0.25 (∂F/∂P is 0.73e-3 m²)
    let readings = super::bare(&holds(&[(1.0, 4.0e5), (1.0, 4.03e5), (1.0, 0.0)]), &rig);
    let before = super::at(&readings, 0.9).contraction;
    assert_eq!(super::at(&readings, 1.9).contraction, before);
    assert_eq!(readings.last().expect("samples").contraction, 0.0);
    assert!(readings.iter().all(|reading| reading.contraction >= 0.0));
}

/// Largest differences over noise.
fn worst(one: &[Reading], other: &[Reading]) -> f64 {
    let sensors = Sensors::default();
    let mut worst = 0.0_f64;
    for (a, b) in one.iter().zip(other) {
        worst = worst
            .max((a.pressure_pa - b.pressure_pa).abs() / sensors.pressure_pa.noise())
            .max((a.contraction - b.contraction).abs() / sensors.contraction.noise())
            .max((a.force_n - b.force_n).abs() / sensors.force_n.noise());
    }
    worst
}

#[test]
fn smooth_motion_converges_with_the_fourth_power_of_the_step() {
    let rig = Rig {
        heat_transfer_charging_w_per_m2_k: 100.0,
        heat_transfer_discharging_w_per_m2_k: 100.0,
        ..frictionless()
    };
    // always filling: the flow's enthalpy has a corner where it turns
    let run = pieces(&[(0.5, 2.5e5, 2.5e5), (0.5, 4.0e5, 4.0e5)]);
    let exact = run.simulate_in_steps(&rig, &[], 6.25e-5);
    let coarse = worst(&run.simulate_in_steps(&rig, &[], 1.0e-3), &exact);
    let fine = worst(&run.simulate_in_steps(&rig, &[], 5.0e-4), &exact);
    assert!(fine < coarse / 10.0, "{coarse} {fine}");
}

#[test]
fn halving_the_step_changes_less_than_the_noise_whatever_the_effect() {
    let run = pieces(&[
        (0.5, 3.0e5, 3.0e5),
        (1.0, 4.2e5, 4.2e5),
        (0.5, 4.2e5, 2.0e5),
        (0.5, 0.2e5, 0.2e5),
        (1.0, 1.6e5, 2.8e5),
        (0.5, 4.7e5, 4.7e5),
    ]);
    let rig = Rig::default();
    let mut all = vec![("nothing", "", super::bare(&run, &rig), {
        run.simulate_in_steps(&rig, &[], 0.5 * STEP_S)
    })];
    let forms: Vec<_> = CATALOGUE
        .iter()
        .flat_map(|entry| entry.forms.iter().map(move |form| (entry, form)))
        .collect();
    all.par_extend(forms.par_iter().map(|(entry, form)| {
        let drawn = super::draw(form, 0.9, &rig);
        let hidden: [&dyn Hidden; 1] = [drawn.hidden.as_ref()];
        let half = run.simulate_in_steps(&rig, &hidden, 0.5 * STEP_S);
        (entry.name, form.name, super::with(&run, &rig, &drawn), half)
    }));
    for (effect, form, whole, half) in &all {
        let worst = worst(whole, half);
        assert!(worst < 0.5, "{effect} {form}: {worst}");
    }
}

/// A controller that plays a drive gets the readings of the drive's record.
#[test]
fn closed_loop_and_record_use_the_same_rig() {
    let rig = Rig::default();
    let effect = ("transport-delay", "pure");
    let form = forms(effect.0).iter().find(|form| form.name == effect.1);
    let hiding = Hiding {
        rig: &rig,
        effect: form.map(|form| (form, 0.5)),
        seed: 11,
    };
    let run = pieces(&[(0.5, 0.0, 0.0), (1.0, 2.0e5, 3.0e5)]);
    let recorded = with(
        &run,
        &rig,
        &draw(hiding.effect.expect("a form").0, 0.5, &rig),
    );
    let mut seen = Vec::new();
    hiding.run((PERIOD_S, 0.0), recorded.len(), |now| {
        seen.push(now.reading);
        run.drive.at(now.time_s)
    });
    for (a, b) in recorded.iter().zip(&seen) {
        // The rest before a record's first sample is nothing but rounding.
        near(a.pressure_pa, b.pressure_pa, 1e-3);
        near(a.contraction, b.contraction, 1e-9);
    }
}

//! The signature of each effect holds for every law that is drawn of it.

use super::super::bench::Bench;
use super::super::effects::{DRAWN, Law};
use super::{laws, moment, rng, settled};
use crate::hidden::{Load, Moment, Reading};
use crate::machine::GRAVITY_M_PER_S2;

const NO_LOAD: Load = Load {
    mass_kg: 0.0,
    pull_n: 0.0,
    coulomb_n: 0.0,
    static_n: 0.0,
};

/// A law with its states at a moment.
struct Held<'a> {
    law: &'a Law,
    x: Vec<f64>,
    now: Moment,
}

impl<'a> Held<'a> {
    fn new(law: &'a Law, now: Moment) -> Self {
        let x = settled(law, &now);
        Self { law, x, now }
    }

    /// Force that the effect adds to a muscle's force of `force_n`.
    fn force_n(&self, force_n: f64) -> f64 {
        let mut dx = vec![0.0; self.x.len()];
        self.law
            .hidden
            .force_n(force_n, &self.now, &self.x, &mut dx)
            - force_n
    }

    fn load(&self) -> Load {
        let mut load = NO_LOAD;
        let mut dx = vec![0.0; self.x.len()];
        self.law.hidden.load(&mut load, &self.now, &self.x, &mut dx);
        load
    }

    /// Moves to `contraction` at a steady rate, in steps of a thousandth of the way.
    fn move_to(&mut self, contraction: f64, rate_per_s: f64, mut each: impl FnMut(&Self, f64)) {
        let steps = 1000;
        let from = self.now.contraction;
        let step = (contraction - from) / f64::from(steps);
        let step_s = step.abs() / rate_per_s;
        self.now.rate_per_s = rate_per_s.copysign(step);
        for i in 0..steps {
            self.step(step_s, |held| {
                held.now.contraction = from + step * f64::from(i + 1);
            });
            each(self, step);
        }
    }

    /// One midpoint step of the states, during which `change` happens.
    fn step(&mut self, step_s: f64, change: impl FnOnce(&mut Self)) {
        let rates = |held: &Self, x: &[f64]| {
            let hidden = held.law.hidden.as_ref();
            let mut dx = vec![0.0; x.len()];
            hidden.reference_pa(held.now.command_pa, &held.now, x, &mut dx);
            hidden.flow_kg_per_s(held.now.flow_kg_per_s, &held.now, x, &mut dx);
            hidden.heat_w(0.0, &held.now, x, &mut dx);
            hidden.force_n(0.0, &held.now, x, &mut dx);
            hidden.load(&mut NO_LOAD.clone(), &held.now, x, &mut dx);
            dx
        };
        let first = rates(self, &self.x);
        let ahead = |dx: &[f64], s: f64| -> Vec<f64> {
            self.x.iter().zip(dx).map(|(x, dx)| x + s * dx).collect()
        };
        let middle = rates(self, &ahead(&first, 0.5 * step_s));
        self.x = ahead(&middle, step_s);
        self.now.time_s += step_s;
        change(self);
        self.law.hidden.commit(&self.now, &mut self.x);
    }

    /// Stays for `duration_s`.
    fn wait(&mut self, duration_s: f64, steps: usize) {
        self.now.rate_per_s = 0.0;
        for _ in 0..steps {
            self.step(duration_s / steps as f64, |_| {});
        }
    }
}

fn within(bench: &Bench, place: f64) -> f64 {
    place * bench.contraction_most
}

#[test]
fn hysteresis_is_independent_of_rate_and_time() {
    for (bench, law) in laws("hysteresis") {
        let forces = |rate_per_s: f64, wait_s: f64| {
            let mut held = Held::new(&law, moment(&bench));
            let mut forces = Vec::new();
            for place in [0.6, 0.2, 0.5, 0.4, 0.55] {
                held.move_to(within(&bench, place), rate_per_s, |_, _| {});
                held.wait(wait_s, 3);
                forces.push(held.force_n(0.0));
            }
            forces
        };
        let (slow, fast) = (forces(0.01, 100.0), forces(1.0, 0.0));
        for (slow, fast) in slow.iter().zip(&fast) {
            let scale = 1e-6 + slow.abs();
            assert!(
                (slow - fast).abs() < 1e-6 * scale.max(1.0),
                "{}: {slow} {fast}",
                law.words
            );
        }
    }
}

#[test]
fn hysteresis_dissipates_work_in_every_closed_loop() {
    for (bench, law) in laws("hysteresis") {
        // major and minor loops, small and large
        for (low, high) in [(0.05, 0.7), (0.3, 0.4), (0.5, 0.52), (0.1, 0.35)] {
            let mut held = Held::new(&law, moment(&bench));
            let mut work = [0.0; 6];
            for cycle in &mut work {
                for place in [high, low] {
                    held.move_to(within(&bench, place), 0.1, |held, step| {
                        *cycle += held.force_n(0.0) * step;
                    });
                }
            }
            // the sixth is a closed loop: memory of the way there is gone
            assert!(
                work[5] < 0.0,
                "{} gives {} in {low} to {high}",
                law.words,
                work[5]
            );
        }
    }
}

#[test]
fn hysteresis_remembers_the_last_reversal_and_grows_with_pressure() {
    for (bench, law) in laws("hysteresis") {
        let after = |reversal: f64, pressure_pa: f64| {
            let mut held = Held::new(&law, moment(&bench));
            held.now.pressure_pa = pressure_pa;
            held.move_to(within(&bench, 0.02), 0.1, |_, _| {});
            held.move_to(within(&bench, reversal), 0.1, |_, _| {});
            held.move_to(within(&bench, 0.35), 0.1, |_, _| {});
            held.force_n(0.0)
        };
        let middle_pa = bench.middle_pa();
        let up = after(0.3499, middle_pa);
        let down = after(0.7, middle_pa);
        assert!(up < 0.0 && down > up, "against motion: {up} {down}");
        let (low, high) = (after(0.3499, bench.lift_pa), after(0.3499, bench.high_pa));
        assert!(high < low, "{low} {high}");
    }
}

#[test]
fn creep_is_monotone_and_decays() {
    for (bench, law) in laws("creep") {
        let start = moment(&bench);
        for rise in [true, false] {
            let mut held = Held::new(&law, start);
            let factor = if rise { 1.2 } else { 0.8 };
            held.now.pressure_pa *= factor;
            held.now.contraction *= factor;
            let mut before_n = held.force_n(0.0);
            let first_n = before_n;
            // the force was held back in the way of the step, and comes
            assert_eq!(first_n < 0.0, rise, "{}", law.words);
            for _ in 0..60 {
                held.wait(0.5, 50);
                let force_n = held.force_n(0.0);
                assert!(
                    force_n.abs() <= before_n.abs() * (1.0 + 1e-9),
                    "{}",
                    law.words
                );
                assert_eq!(force_n < 0.0, rise);
                before_n = force_n;
            }
            assert!(before_n.abs() < 0.9 * first_n.abs(), "{}", law.words);
            held.wait(3000.0, 60_000);
            assert!(
                held.force_n(0.0).abs() < 1e-3 * first_n.abs(),
                "{}",
                law.words
            );
        }
    }
}

#[test]
fn dead_band_is_a_constant_pressure_loss_above_its_threshold() {
    for (bench, law) in laws("dead-band") {
        let mut held = Held::new(&law, moment(&bench));
        let mut lost_pa = |pressure_pa: f64, contraction: f64| {
            held.now.pressure_pa = pressure_pa;
            held.now.contraction = contraction;
            -held.force_n(0.0) / held.now.area_m2
        };
        let threshold_pa = law.numbers["threshold_pa"].as_f64().expect("a number");
        assert_eq!(lost_pa(0.0, 0.1), 0.0);
        let mut before_pa = 0.0;
        for i in 1..100 {
            let pressure_pa = 0.05 * f64::from(i) * threshold_pa;
            let lost = lost_pa(pressure_pa, 0.1);
            assert!(lost >= before_pa - 1e-9 && lost <= pressure_pa.min(threshold_pa) * 1.6);
            assert_eq!(lost, lost_pa(pressure_pa, 0.2));
            before_pa = lost;
        }
        let above = lost_pa(20.0 * threshold_pa, 0.1);
        assert!(
            (above / threshold_pa - 1.0).abs() < 0.02,
            "{above} {threshold_pa}"
        );
    }
}

#[test]
fn bladder_force_rises_with_contraction_and_has_no_memory() {
    for (bench, law) in laws("bladder-elasticity") {
        let mut held = Held::new(&law, moment(&bench));
        let force_n = |held: &mut Held, place: f64, rate_per_s: f64| {
            held.now.contraction = within(&bench, place);
            held.now.rate_per_s = rate_per_s;
            held.force_n(0.0)
        };
        assert_eq!(force_n(&mut held, 0.0, 0.0), 0.0);
        let mut before_n = 0.0;
        for i in 1..20 {
            let place = 0.04 * f64::from(i);
            let here_n = force_n(&mut held, place, 0.3);
            assert!(here_n < before_n, "{}", law.words);
            assert_eq!(here_n, force_n(&mut held, place, -0.3));
            before_n = here_n;
        }
    }
}

#[test]
fn slack_removes_only_negative_forces() {
    for (bench, law) in laws("slack") {
        let held = Held::new(&law, moment(&bench));
        let total_n = |force_n: f64| force_n + held.force_n(force_n);
        let weight_n = bench.weight_n();
        let share = law.numbers["push_share"].as_f64().expect("a number");
        assert!((total_n(3.0 * weight_n) - 3.0 * weight_n).abs() < 1e-6 * weight_n);
        let pushed_n = total_n(-3.0 * weight_n);
        assert!((pushed_n + 3.0 * share * weight_n).abs() < 1e-6 * weight_n);
        let mut before_n = pushed_n;
        for i in -300..300 {
            let force_n = total_n(0.01 * f64::from(i) * weight_n);
            assert!(force_n >= before_n - 1e-12, "{}", law.words);
            before_n = force_n;
        }
    }
}

#[test]
fn run_in_decays_with_travel_and_not_with_time() {
    for (bench, law) in laws("run-in") {
        let mut held = Held::new(&law, moment(&bench));
        let share = |held: &Held| held.force_n(0.0) / (held.now.area_m2 * held.now.pressure_pa);
        let first = share(&held);
        assert!((first - law.numbers["share"].as_f64().expect("a number")).abs() < 1e-12);
        held.wait(1000.0, 10);
        assert_eq!(share(&held), first);
        let mut before = first.abs();
        for _ in 0..40 {
            held.move_to(within(&bench, 0.7), 0.2, |_, _| {});
            held.move_to(within(&bench, 0.1), 0.2, |_, _| {});
            let left = share(&held).abs();
            assert!(left <= before);
            before = left;
        }
        assert!(
            before < 0.3 * first.abs(),
            "{}: {first} {before}",
            law.words
        );
    }
}

#[test]
fn friction_dissipates_work_independently_of_pressure_and_position() {
    for (bench, law) in laws("friction") {
        let loop_j = |pressure_pa: f64, at: f64| {
            let mut held = Held::new(&law, moment(&bench));
            held.now.pressure_pa = pressure_pa;
            held.now.contraction = at;
            let mut work = 0.0;
            for cycle in 0..3 {
                for to in [at + 0.05, at] {
                    held.move_to(to, 0.05, |held, step| {
                        let load = held.load();
                        let against_n = load.coulomb_n.copysign(step) + load.pull_n;
                        if cycle == 2 {
                            work += against_n * step;
                        }
                    });
                }
            }
            work
        };
        let work = loop_j(bench.lift_pa, 0.05);
        assert!(work > 0.0, "{}", law.words);
        assert!(
            (loop_j(bench.high_pa, 0.15) / work - 1.0).abs() < 1e-6,
            "{}",
            law.words
        );
        let load = Held::new(&law, moment(&bench)).load();
        assert!(load.static_n >= 0.0 && load.coulomb_n >= 0.0);
    }
}

#[test]
fn payload_at_rest_adds_the_weight_of_its_mass() {
    for (bench, law) in laws("payload") {
        let held = Held::new(&law, moment(&bench));
        let load = held.load();
        let weight_n = load.mass_kg * GRAVITY_M_PER_S2 + load.pull_n;
        let mass_kg = law.numbers["mass_kg"].as_f64().expect("a number");
        let ratio = weight_n / (mass_kg * GRAVITY_M_PER_S2);
        assert!((0.6..1.7).contains(&ratio), "{}: {ratio}", law.words);
        if law.form != "along-height" {
            assert!((ratio - 1.0).abs() < 1e-9, "{}: {ratio}", law.words);
        }
        assert!(bench.rig.mass_kg + load.mass_kg > 0.5 * bench.rig.mass_kg);
    }
}

/// Readings of a rig with the effect.
fn read(held: &Held) -> Reading {
    let mut reading = Reading {
        pressure_pa: held.now.pressure_pa,
        contraction: held.now.contraction,
        force_n: 100.0,
    };
    held.law.hidden.read(&mut reading, &held.now, &held.x);
    reading
}

#[test]
fn backlash_delays_the_reading_by_at_most_its_gap_at_any_rate() {
    for (bench, law) in laws("backlash") {
        let gap_m = law.numbers["gap_m"].as_f64().expect("a number");
        let gap = gap_m / bench.rig.initial_length_m;
        let ends = |rate_per_s: f64| {
            let mut held = Held::new(&law, moment(&bench));
            let mut off = Vec::new();
            for place in [0.6, 0.3, 0.5, 0.1] {
                held.move_to(within(&bench, place), rate_per_s, |held, _| {
                    let off = read(held).contraction - held.now.contraction;
                    assert!(off.abs() <= 0.5 * 3.0 * gap);
                });
                off.push(read(&held).contraction - held.now.contraction);
            }
            off
        };
        let off = ends(0.05);
        assert_eq!(off, ends(2.0));
        assert!(off[0] < 0.0 && off[1] > 0.0, "behind both ways: {off:?}");
    }
}

#[test]
fn valve_lag_is_linear_and_reaches_the_reference() {
    for (bench, law) in laws("valve-lag") {
        let answer = |step_pa: f64| {
            let mut held = Held::new(&law, moment(&bench));
            held.now.command_pa += step_pa;
            let mut path = Vec::new();
            for _ in 0..40 {
                held.wait(0.02, 200);
                let reference_pa = held.law.hidden.reference_pa(
                    held.now.command_pa,
                    &held.now,
                    &held.x,
                    &mut vec![0.0; held.x.len()],
                );
                path.push((reference_pa - bench.middle_pa()) / step_pa);
            }
            path
        };
        let (small, large) = (answer(1.0e3), answer(1.0e5));
        for (small, large) in small.iter().zip(&large) {
            assert!((small - large).abs() < 1e-6, "{}", law.words);
        }
        assert!(
            small[0] < 0.999 && (small[39] - 1.0).abs() < 0.05,
            "{}: {small:?}",
            law.words
        );
    }
}

/// The flow through an effect of one towards the muscle.
fn flow(held: &Held, flow: f64) -> f64 {
    let mut dx = vec![0.0; held.x.len()];
    held.law
        .hidden
        .flow_kg_per_s(flow, &held.now, &held.x, &mut dx)
}

#[test]
fn dead_zone_reduces_the_flow_without_changing_its_sign() {
    for (bench, law) in laws("valve-dead-zone") {
        let held = Held::new(&law, moment(&bench));
        let gain = bench.rig.flow_gain_kg_per_pa_s;
        assert_eq!(flow(&held, 0.0), 0.0);
        for way in [1.0, -1.0] {
            let mut before = 0.0;
            for i in 1..200 {
                let asked = way * gain * 500.0 * f64::from(i);
                let passed = flow(&held, asked);
                assert!(passed * way >= before && passed.abs() <= asked.abs() * (1.0 + 1e-9));
                before = passed * way;
            }
            let far = way * gain * 1.0e6;
            assert!(
                flow(&held, far) / far > 0.8,
                "open far outside: {}",
                law.words
            );
        }
    }
}

#[test]
fn flow_limit_bounds_only_large_flows() {
    for (bench, law) in laws("flow-limit") {
        let held = Held::new(&law, moment(&bench));
        let gain = bench.rig.flow_gain_kg_per_pa_s;
        for way in [1.0, -1.0] {
            let small = way * gain * 50.0;
            assert!(
                (flow(&held, small) / small - 1.0).abs() < 0.1,
                "{}",
                law.words
            );
            let large = way * gain * 1.0e9;
            let (most, more) = (flow(&held, large), flow(&held, 10.0 * large));
            assert!((more / most - 1.0).abs() < 0.01 && most * way > 0.0);
            let half = way * gain * 5.0e4;
            assert!(flow(&held, half).abs() <= half.abs());
        }
    }
}

#[test]
fn leak_has_no_inflow() {
    for (bench, law) in laws("leak") {
        let mut held = Held::new(&law, moment(&bench));
        let mut leak = |pressure_pa: f64| {
            held.now.pressure_pa = pressure_pa;
            law.hidden.leak_kg_per_s(&held.now)
        };
        assert!(leak(bench.lift_pa) > 0.0 && leak(bench.high_pa) > 0.0);
        assert_eq!((leak(0.0), leak(-1.0e4)), (0.0, 0.0));
    }
}

#[test]
fn heat_flows_from_hot_to_cold_and_is_conserved() {
    for (bench, law) in laws("heat-exchange") {
        for hotter_k in [30.0, -30.0] {
            let mut held = Held::new(&law, moment(&bench));
            held.now.temperature_k += hotter_k;
            let nominal_w = -100.0 * held.now.surface_m2 * hotter_k;
            let mut dx = vec![0.0; held.x.len()];
            let heat_w = law.hidden.heat_w(nominal_w, &held.now, &held.x, &mut dx);
            assert!(
                heat_w * hotter_k < 0.0 && heat_w.abs() > nominal_w.abs(),
                "{}",
                law.words
            );
            if held.x.is_empty() {
                continue;
            }
            // at first nothing reaches the room: the walls take it all
            let capacity = law.numbers["capacity_j_per_k"].as_array().expect("layers");
            let stored: f64 = capacity
                .iter()
                .zip(&dx)
                .map(|(c, dx)| c.as_f64().expect("a number") * dx)
                .sum();
            assert!(
                (stored + heat_w).abs() < 1e-9 * heat_w.abs(),
                "{stored} {heat_w}"
            );
        }
    }
}

#[test]
fn reservoir_supplies_the_muscles_gas_and_refills() {
    for (bench, law) in laws("supply-droop") {
        let supply_pa = bench.rig.supply_pressure_pa;
        let start = Moment {
            reference_pa: 0.9 * supply_pa,
            ..moment(&bench)
        };
        let mut held = Held::new(&law, start);
        assert_eq!(held.x[0], supply_pa);
        held.now.flow_kg_per_s = 1.0e-3;
        held.step(0.01, |_| {});
        let number = |name: &str| law.numbers[name].as_f64().expect("a number");
        let heat_j_per_kg = 287.0 * bench.rig.ambient_temperature_k;
        let taken_pa = number("polytropic") * heat_j_per_kg / number("reservoir_m3") * 1.0e-5;
        let fallen_pa = supply_pa - held.x[0];
        // refilled a little meanwhile
        assert!(fallen_pa <= taken_pa * (1.0 + 1e-9) && fallen_pa > 0.9 * taken_pa);
        held.now.flow_kg_per_s = 0.0;
        let mut before_pa = held.x[0];
        for _ in 0..100 {
            held.wait(0.2, 200);
            assert!(held.x[0] >= before_pa && held.x[0] <= supply_pa * (1.0 + 1e-12));
            before_pa = held.x[0];
        }
        assert!(
            supply_pa - before_pa < 0.05 * fallen_pa.max(1.0e3),
            "{}",
            law.words
        );
        let mut dx = [0.0];
        let limited_pa = law.hidden.reference_pa(9.0e5, &held.now, &held.x, &mut dx);
        assert_eq!(limited_pa, held.x[0]);
    }
}

#[test]
fn delayed_commands_arrive_completely_and_late() {
    for (_, law) in laws("transport-delay") {
        for sent_s in [0.0, 1.234, 7.77] {
            let arrivals = law.hidden.arrivals(sent_s);
            let whole: f64 = arrivals.iter().map(|(_, share)| share).sum();
            assert!((whole - 1.0).abs() < 1e-12);
            for (time_s, share) in arrivals {
                assert!(time_s - sent_s >= 0.008 - 1e-9 && time_s - sent_s < 0.2);
                assert!(share > 0.0);
            }
        }
    }
}

#[test]
fn line_dynamics_reach_the_muscles_pressure_and_conserve_mass() {
    for (bench, law) in laws("line-dynamics") {
        let mut held = Held::new(&law, moment(&bench));
        let settled = read(&held);
        assert!((settled.pressure_pa - bench.middle_pa()).abs() < 1e-6);
        held.now.pressure_pa += 2.0e4;
        assert!(
            (read(&held).pressure_pa - held.now.pressure_pa).abs() > 1.0e3,
            "it lags"
        );
        if law.form.starts_with("hose") {
            // what flows in flows on or is stored: p V over n R T of each cell
            let number = |name: &str| law.numbers[name].as_f64().expect("a number");
            let heat_j_per_kg = 287.0 * bench.rig.ambient_temperature_k;
            let mut dx = vec![0.0; held.x.len()];
            let on = law
                .hidden
                .flow_kg_per_s(1.0e-3, &held.now, &held.x, &mut dx);
            let stored = dx.iter().sum::<f64>() * number("cell_m3") / (1.2 * heat_j_per_kg);
            assert!((on + stored - 1.0e-3).abs() < 1e-12, "{on} {stored}");
        }
        held.wait(6.0, 60_000);
        assert!(
            (read(&held).pressure_pa - held.now.pressure_pa).abs() < 10.0,
            "{}",
            law.words
        );
    }
}

#[test]
fn sensor_errors_are_those_of_the_answer() {
    let names = [
        "pressure-sensor-offset",
        "pressure-sensor-gain",
        "pressure-sensor-drift",
        "contraction-sensor-offset",
        "force-sensor-offset",
    ];
    for name in names {
        for (bench, law) in laws(name) {
            let off = |pressure_pa: f64, time_s: f64| {
                let mut held = Held::new(&law, moment(&bench));
                (held.now.pressure_pa, held.now.time_s) = (pressure_pa, time_s);
                let reading = read(&held);
                [
                    reading.pressure_pa - pressure_pa,
                    reading.contraction - held.now.contraction,
                    reading.force_n - 100.0,
                ]
            };
            let here = off(2.0e5, 30.0);
            let erring = match name {
                "contraction-sensor-offset" => 1,
                "force-sensor-offset" => 2,
                _ => 0,
            };
            for (signal, off) in here.iter().enumerate() {
                assert_eq!(*off != 0.0, signal == erring, "{name}");
            }
            match name {
                "pressure-sensor-gain" => {
                    assert_eq!(off(0.0, 30.0)[0], 0.0);
                    let ratio = off(3.0e5, 0.0)[0] / here[0];
                    assert!((1.5 / 1.7..1.5 * 1.7).contains(&ratio), "{ratio}");
                }
                "pressure-sensor-drift" => {
                    assert_eq!(off(2.0e5, 0.0)[0], 0.0);
                    let path: Vec<f64> =
                        (0..60).map(|s| off(2.0e5, f64::from(s))[0].abs()).collect();
                    assert!(path.windows(2).all(|two| two[1] >= two[0]), "one way only");
                }
                _ => assert!((off(4.0e5, 0.0)[erring] / here[erring] - 1.0).abs() < 1e-9),
            }
        }
    }
}

#[test]
fn laws_of_each_effect_differ_and_are_reproducible() {
    for entry in DRAWN {
        let laws = laws(entry.name);
        let mut numbers: Vec<String> = laws
            .iter()
            .map(|(_, law)| law.numbers.to_string())
            .collect();
        numbers.sort();
        numbers.dedup();
        assert_eq!(numbers.len(), laws.len(), "{}", entry.name);
        let bench = super::bench(7, entry.near_supply);
        let law = |seed| (entry.draw)(&bench, 0.4, &mut rng(seed));
        assert_eq!(law(5).numbers, law(5).numbers, "{} repeats", entry.name);
    }
    assert_eq!(DRAWN.iter().filter(|entry| entry.listed).count(), 22);
}

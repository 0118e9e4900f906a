//! Tests of drawn cases: hidden effects, rigs, records and reproducibility.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::super::bench::{self, Bench, Clock};
use super::super::effects::DRAWN;
use super::super::{REPORTING_SEED, case, experiment, plan, rows, set};
use super::rng;
use crate::machine::GRAVITY_M_PER_S2;
use crate::record::Sensors;
use crate::{Case, Drive, Kind};

/// The first cases of a seed.
fn some() -> Vec<Case> {
    (0..20)
        .into_par_iter()
        .map(|index| case(4, index))
        .collect()
}

fn column(text: &str, name: &str) -> Vec<f64> {
    let header = text.lines().next().expect("a header");
    let place = header.split(',').position(|column| column == name);
    let place = place.expect("a column");
    let rows = text.lines().skip(1);
    rows.map(|row| {
        row.split(',')
            .nth(place)
            .expect("a cell")
            .parse()
            .expect("a number")
    })
    .collect()
}

#[test]
fn every_effect_is_drawn_and_combined_effects_differ() {
    let mut names = BTreeSet::new();
    let mut kinds = BTreeMap::new();
    for index in 0..400 {
        let plan = plan(9, index);
        *kinds.entry(plan.kind.name()).or_insert(0) += 1;
        let here: BTreeSet<&str> = plan.effects.iter().map(|(entry, _)| entry.name).collect();
        assert_eq!(here.len(), plan.effects.len());
        let expected = match plan.kind {
            Kind::Single | Kind::Unlisted => 1,
            Kind::Pair => 2,
            Kind::Triple => 3,
            Kind::None => 0,
        };
        assert_eq!(here.len(), expected);
        let listed = plan.kind != Kind::Unlisted;
        assert!(plan.effects.iter().all(|(entry, _)| entry.listed == listed));
        names.extend(here);
    }
    assert_eq!(names.len(), DRAWN.len());
    let expected = [
        ("none", 80),
        ("pair", 80),
        ("single", 120),
        ("triple", 40),
        ("unlisted", 80),
    ];
    assert_eq!(kinds, expected.into());
}

#[test]
fn a_seed_belongs_to_one_set() {
    assert_eq!(set(0), "working");
    assert_eq!(set(REPORTING_SEED - 1), "working");
    assert_eq!(set(REPORTING_SEED), "reporting");
}

#[test]
fn rigs_lift_their_load_over_the_stroke_within_the_supplys_pressure() {
    let (mut gains, mut masses, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..400 {
        let pair = bench::pair(seed % 5 == 0, &mut rng(seed));
        let rig = &pair.nominal;
        let bench = Bench::of(rig.clone());
        assert!((3.0..=50.0).contains(&rig.mass_kg));
        assert!(bench.lift_pa < bench.high_pa && bench.high_pa < rig.supply_pressure_pa);
        let area_m2 = rig.alpha_m2 + rig.beta_m2;
        let lifted_n = area_m2 * rig.supply_pressure_pa + rig.gamma_n;
        assert!(lifted_n > 1.5 * rig.mass_kg * GRAVITY_M_PER_S2);
        // the volume grows over all of the stroke
        let reached = 0.75 * bench.contraction_most;
        assert!(rig.volume_d2_m3 + 2.0 * rig.volume_d1_m3 * reached > 0.0);
        let sensors = bench::sensors(rig, &mut rng(seed));
        let noise = sensors.pressure_pa.noise() / Sensors::default().pressure_pa.noise();
        assert!((0.249..6.01).contains(&noise), "{noise}");
        gains.push(rig.flow_gain_kg_per_pa_s);
        masses.push(rig.mass_kg);
        areas.push(area_m2);
    }
    let span = |values: &[f64]| {
        let most = values.iter().copied().fold(0.0, f64::max);
        most / values.iter().copied().fold(f64::INFINITY, f64::min)
    };
    assert!((20.0..31.0).contains(&span(&gains)), "{}", span(&gains));
    assert!(
        span(&masses) > 12.0 && span(&areas) > 16.0,
        "{} {}",
        span(&masses),
        span(&areas)
    );
}

#[test]
fn clocks_cover_their_ranges_and_times_increase() {
    let (mut slow, mut fast, mut uneven) = (false, false, 0);
    for seed in 0..300 {
        let rng = &mut rng(seed);
        let clock = Clock::draw(rng);
        slow |= clock.rate_hz <= 20.0;
        fast |= clock.rate_hz >= 1000.0;
        uneven += u32::from(clock.jitter > 0.0);
        assert!((19.9..300.1).contains(&clock.duration_s));
        let (times_s, unrecorded) = clock.times_s(3.0, rng);
        assert!(times_s.windows(2).all(|two| two[1] > two[0]));
        assert_eq!(times_s[unrecorded], 0.0);
        assert!(times_s.len() - unrecorded <= 30_001);
    }
    assert!(slow && fast && (20..80).contains(&uneven));
}

#[test]
fn a_case_is_reproducible_and_its_records_stay_within_the_rigs_limits() {
    let (first, again) = (case(4, 1), case(4, 1));
    assert_eq!(first.answer, again.answer);
    assert_eq!(first.rig_toml, again.rig_toml);
    let records = |case: &Case| {
        let all = case.fit.iter().chain(&case.validate).chain(&case.unseen);
        all.cloned().collect::<Vec<String>>()
    };
    assert_eq!(records(&first), records(&again));
    for case in some() {
        let texts = records(&case);
        assert_eq!(
            texts.iter().collect::<BTreeSet<_>>().len(),
            5,
            "drives differ"
        );
        let number = |key: &str| case.answer[key].as_u64().expect("a number");
        let expected_rows = rows(number("seed"), number("index"));
        let supply_pa: f64 = case.answer["true_rig"]["supply_pressure_pa"]
            .as_f64()
            .expect("a number");
        for text in &texts {
            let times_s = column(text, "time_s");
            assert_eq!(times_s[0], 0.0);
            assert_eq!(times_s.len(), expected_rows);
            let reference_pa = column(text, "pressure_ref_pa");
            assert!(reference_pa.iter().all(|pa| (0.0..=supply_pa).contains(pa)));
            let contraction = column(text, "contraction");
            let most = contraction
                .iter()
                .copied()
                .fold(f64::NEG_INFINITY, f64::max);
            let least = contraction.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(
                most - least > 0.02 && most < 0.4,
                "{} {least} {most}",
                case.id
            );
            let with_force = case.answer["force_channel"].as_bool().expect("a word");
            assert_eq!(
                text.lines().next().expect("a header").contains("force_n"),
                with_force
            );
        }
        assert!(case.rig_toml.contains("[tolerance.muscle]"));
        assert!(case.id.starts_with("d4-"));
    }
}

#[test]
fn most_effects_are_visible_according_to_the_answer() {
    let (mut shown, mut all) = (0, 0);
    for case in some() {
        for effect in case.answer["effects"].as_array().expect("effects") {
            let over_noise = effect["most_over_noise"].as_f64().expect("a number");
            assert_eq!(effect["shows"].as_bool(), Some(over_noise >= 3.0));
            assert!(over_noise > 0.0, "{} changes nothing", effect["name"]);
            shown += u32::from(over_noise >= 3.0);
            all += 1;
        }
    }
    assert!(shown * 10 >= all * 7, "{shown} of {all}");
}

#[test]
fn a_test_signal_is_recorded_on_the_rig_of_its_case() {
    let drive = Drive {
        period_s: 0.01,
        reference_pa: vec![1.5e5; 300],
        shut: (0..300).map(|row| row >= 100).collect(),
    };
    let text = experiment(4, 0, drive);
    assert!(
        text.lines()
            .next()
            .expect("a header")
            .ends_with("valve_open")
    );
    assert_eq!(column(&text, "valve_open").iter().sum::<f64>(), 100.0);
    assert_eq!(column(&text, "pressure_pa").len(), 300);
}

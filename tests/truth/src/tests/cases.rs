//! Tests of cases: hidden effects, reproducibility and noise.

use std::collections::BTreeSet;

use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::{Rig, bare, draw, pieces, with};
use crate::effects::CATALOGUE;
use crate::hidden::Reading;
use crate::record::Sensors;
use crate::{Drive, Kind, case, experiment, plan, rows};

/// First number of a kind.
fn first(kind: Kind) -> u64 {
    (0..)
        .find(|index| plan(1, *index).kind == kind)
        .expect("each kind comes up")
}

#[test]
fn every_form_is_drawn_at_every_size() {
    let mut forms = BTreeSet::new();
    let mut sizes = Vec::new();
    for index in 0..2_000 {
        for planned in plan(5, index).effects {
            forms.insert((planned.entry.name, planned.form.name));
            if planned.entry.name == "creep" {
                sizes.push(planned.size);
            }
        }
    }
    let all: usize = CATALOGUE.iter().map(|entry| entry.forms.len()).sum();
    assert_eq!(forms.len(), all);
    for fifth in 0..5 {
        let low = 0.2 * f64::from(fifth);
        assert!(sizes.iter().any(|size| (low..low + 0.2).contains(size)));
    }
}

#[test]
fn pairs_are_two_listed_effects_half_of_them_in_one_subsystem() {
    let (mut same, mut pairs) = (0, 0);
    for index in 0..500 {
        let plan = plan(3, index);
        if plan.kind == Kind::Pair {
            let [one, other] = &plan.effects[..] else {
                panic!("two")
            };
            assert!(one.entry.listed && other.entry.listed && one.entry.name != other.entry.name);
            same += usize::from(one.entry.place == other.entry.place);
            pairs += 1;
        }
    }
    assert_eq!(pairs, 100);
    assert_eq!(same, 50);
}

#[test]
fn a_case_is_reproducible_and_its_files_agree() {
    let index = first(Kind::Pair);
    let (one, other) = (case(1, index), case(1, index));
    assert_eq!(one.answer, other.answer);
    assert_eq!(one.rig_toml, other.rig_toml);
    assert_eq!(
        (&one.fit, &one.validate, &one.unseen),
        (&other.fit, &other.validate, &other.unseen)
    );
    assert_eq!(
        (one.fit.len(), one.validate.len(), one.unseen.len()),
        (2, 2, 1)
    );
    assert_ne!(case(2, index).fit, one.fit);
    let texts: BTreeSet<&String> = one
        .fit
        .iter()
        .chain(&one.validate)
        .chain(&one.unseen)
        .collect();
    assert_eq!(texts.len(), 5, "drives differ");
    for text in texts {
        assert!(text.starts_with("time_s,pressure_ref_pa,pressure_pa,contraction"));
        assert_eq!(text.lines().count(), 1 + rows(1, index));
        for row in text.lines().skip(1) {
            let reference: f64 = row
                .split(',')
                .nth(1)
                .expect("a cell")
                .parse()
                .expect("a number");
            assert!((0.0..=5.0e5).contains(&reference));
        }
    }
    let effects = one.answer["effects"].as_array().expect("effects");
    assert_eq!(effects.len(), 2);
    assert!(
        effects
            .iter()
            .all(|effect| effect["most_over_noise"].as_f64() > Some(0.0))
    );
    assert_eq!(
        one.answer["force_channel"].as_bool(),
        Some(one.fit[0].contains("force_n"))
    );
}

/// A test signal is simulated on the rig of the case, and the shut-off valve keeps the pressure.
#[test]
fn a_test_signal_is_recorded_on_the_rig_of_its_case() {
    for index in 0..8 {
        let drive = Drive {
            period_s: 0.01,
            reference_pa: vec![2.0e5; 200],
            shut: (0..200).map(|row| row >= 100).collect(),
        };
        let text = experiment(1, index, drive);
        let case = case(1, index);
        let header = text.lines().next().expect("a header");
        let other = case.fit[0].lines().next().expect("a header");
        assert_eq!(header, format!("{other},valve_open"));
        assert_eq!(text.matches(",1\n").count(), 100);
    }
    let held = |shut: bool| {
        let mut run = pieces(&[(2.0, 2.0e5, 2.0e5), (2.0, 4.0e5, 4.0e5)]);
        let rows = run.drive.reference_pa.len();
        run.drive.shut = (0..rows).map(|row| shut && row >= 150).collect();
        bare(&run, &Rig::default())[rows - 1].pressure_pa
    };
    assert!((held(true) - 2.0e5).abs() < 1.0e3 && held(false) > 3.9e5);
}

#[test]
fn a_case_without_hidden_effects_has_an_empty_answer() {
    let none = case(1, first(Kind::None));
    assert!(
        none.answer["effects"]
            .as_array()
            .expect("effects")
            .is_empty()
    );
    assert!(none.rig_toml.contains("[tolerance.muscle]"));
}

#[test]
fn noise_is_that_of_the_answer() {
    let rig = Rig::default();
    let run = pieces(&[(30.0, 2.0e5, 4.0e5)]);
    let readings = bare(&run, &rig);
    let sensors = Sensors::default();
    let text = run.csv(&readings, &sensors, true, &mut Pcg64::seed_from_u64(2));
    let mut sums = [0.0; 3];
    for (row, reading) in text.lines().skip(1).zip(&readings) {
        let cells: Vec<f64> = row
            .split(',')
            .map(|cell| cell.parse().expect("a number"))
            .collect();
        let truth = [reading.pressure_pa, reading.contraction, reading.force_n];
        for i in 0..3 {
            sums[i] += (cells[i + 2] - truth[i]).powi(2);
        }
    }
    let stated = [sensors.pressure_pa, sensors.contraction, sensors.force_n].map(|s| s.noise());
    for i in 0..3 {
        let rms = (sums[i] / readings.len() as f64).sqrt();
        // of 3001 samples the mean square is good to 2.6 % (one sigma)
        assert!(
            (rms / stated[i] - 1.0).abs() < 0.05,
            "{i}: {rms} {}",
            stated[i]
        );
    }
    assert!((stated[0] - 250.0).abs() < 5.0);
}

fn seen(one: &[Reading], other: &[Reading]) -> bool {
    let sensors = Sensors::default();
    one.iter().zip(other).any(|(a, b)| {
        (a.pressure_pa - b.pressure_pa).abs() > 10.0 * sensors.pressure_pa.noise()
            || (a.contraction - b.contraction).abs() > 10.0 * sensors.contraction.noise()
    })
}

#[test]
fn unlisted_effects_are_visible() {
    let rig = Rig::default();
    let run = pieces(&[
        (1.0, 2.0e5, 3.5e5),
        (6.0, 3.5e5, 2.0e5),
        (2.0, 3.0e5, 3.0e5),
    ]);
    let plain = bare(&run, &rig);
    let mut count = 0;
    for entry in CATALOGUE.iter().filter(|entry| !entry.listed) {
        for form in entry.forms {
            let readings = with(&run, &rig, &draw(form, 0.9, &rig));
            assert!(seen(&readings, &plain), "{}", entry.name);
            count += 1;
        }
    }
    assert!(count >= 6);
}

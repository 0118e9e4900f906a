//! An effect that the catalogue of muscle-plant lacks is an effect like any other.

use hil_sim::bench::compensate::compensate;
use hil_sim::identify::diagnosis::{Options, diagnose};
use hil_sim::identify::simulate::simulate;
use hil_sim::record::check::check;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, Record};
use hil_sim::rig::Rig;
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use model_discrepancy::verdict::Verdict;
use muscle_plant::effects::{Catalogue, CompensationMethod};
use own_effect::catalogue;
use own_effect::pulley_eccentricity::KIND;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

const EFFECT: &str = "[[effect]]\nname = \"pulley-eccentricity\"\ncosine = 0.06\nsine = -0.03\n\
                      turn = 0.09\n";
/// Tolerances as of a muscle from the shelf.
const TOLERANCES: &str = "[tolerance.muscle]\nalpha_m2 = 0.01\ngamma_n = 0.02\n";

fn rig(lines: &str) -> Rig {
    let text = Rig::REFERENCE_TOML.to_owned() + lines;
    Rig::parse_with(catalogue(), "rig.toml", &text).expect("a rig")
}

/// The same on a bench that prescribes the contraction.
fn bench_rig(lines: &str) -> Rig {
    let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"") + lines;
    assert!(text.contains("prescribed"));
    Rig::parse_with(catalogue(), "rig.toml", &text).expect("a rig")
}

/// Triangles of contraction at two pressures, for 12 s at 50 Hz, without a force.
fn triangles(period_s: f64) -> Record {
    let time_s: Vec<f64> = (0..600).map(|row| 0.02 * f64::from(row)).collect();
    let contraction = time_s.iter().map(|time_s| {
        let share = (time_s / period_s).fract();
        0.02 + 0.16 * (1.0 - (2.0 * share - 1.0).abs())
    });
    let contraction: Vec<f64> = contraction.collect();
    // Between 200 and 300 kPa every 5 s, in ramps of 0.2 s.
    let pressure_pa = time_s
        .iter()
        .map(|time_s| 2.5e5 + (8e5 * (TAU * time_s / 10.0).sin()).clamp(-5e4, 5e4));
    let pressure_pa: Vec<f64> = pressure_pa.collect();
    let mut record = Record::new(time_s);
    record.set(CONTRACTION, contraction);
    record.set(PRESSURE_PA, pressure_pa);
    record
}

fn rows(record: &Record) -> Vec<(f64, f64)> {
    let column = |name| record.require(name).expect("the column").iter().copied();
    column(CONTRACTION).zip(column(PRESSURE_PA)).collect()
}

/// The reading with an eccentric pulley by its geometry, which contains higher harmonics than the
/// form: the lever arm of a rope on a circle about a point at a distance of `eccentricity` radii
/// from the axle. With noise of 0.5 N and 100 Pa.
fn hidden(record: &Record, seed: u128) -> Record {
    let (eccentricity, turn, phase) = (0.07, 0.09, 0.5);
    let muscle = Rig::reference().nominal.muscle;
    let mut random = Pcg64Mcg::new(seed);
    let mut noise = |size: f64| -> f64 {
        let normal: f64 = StandardNormal.sample(&mut random);
        size * normal
    };
    let (mut pressure_pa, mut force_n) = (Vec::new(), Vec::new());
    for (contraction, pressure) in rows(record) {
        let angle = TAU * contraction / turn + phase;
        let arm = (1.0 + eccentricity * eccentricity + 2.0 * eccentricity * angle.cos()).sqrt();
        force_n.push(arm * muscle.force_n(contraction, GaugePa(pressure)) + noise(0.5));
        pressure_pa.push(pressure + noise(100.0));
    }
    let mut record = record.clone();
    record.set(PRESSURE_PA, pressure_pa);
    record.set(FORCE_N, force_n);
    record
}

#[test]
fn it_is_not_in_the_standard_catalogue_and_is_listed_in_this_one() {
    assert!(Catalogue::standard().find(KIND.name).is_none());
    assert!(catalogue().kinds().any(|kind| kind.name == KIND.name));
    let unknown = Rig::REFERENCE_TOML.to_owned() + "[[effect]]\nname = \"pulley\"\n";
    let error = Rig::parse_with(catalogue(), "rig.toml", &unknown).expect_err("no such effect");
    assert!(error.expected.contains(KIND.name), "{}", error.expected);
}

#[test]
fn it_is_simulated_as_its_form_says() {
    let record = triangles(4.0);
    let simulated = simulate(&bench_rig(EFFECT), &record, 1e-6).expect("simulated");
    let muscle = Rig::reference().nominal.muscle;
    let force_n = simulated.require(FORCE_N).expect("a force");
    for ((contraction, pressure_pa), found_n) in rows(&record).into_iter().zip(force_n) {
        let angle = TAU * contraction / 0.09;
        let ratio = 1.0 + 0.06 * angle.cos() - 0.03 * angle.sin();
        let expected_n = ratio * muscle.force_n(contraction, GaugePa(pressure_pa));
        assert!(
            (found_n - expected_n).abs() < 1e-9,
            "{found_n} {expected_n}"
        );
    }
}

#[test]
fn it_is_named_where_other_code_hides_it() {
    let fit = [hidden(&triangles(4.0), 1)];
    let validate = [hidden(&triangles(3.1), 2)];
    let rig = bench_rig(TOLERANCES);
    let found = diagnose(&rig, &fit, &validate, &Options::default(), &|_| ()).expect("a diagnosis");
    let diagnosis = found.diagnosis;
    assert_eq!(diagnosis.verdict, Verdict::Explained);
    let names: Vec<_> = diagnosis.effects.iter().map(|effect| effect.name).collect();
    assert_eq!(names, [KIND.name]);
    let effect = &diagnosis.effects[0];
    assert_eq!(effect.place, "sensor");
    assert!(effect.alternatives.is_empty(), "{:?}", effect.alternatives);
    let turn = effect.parameters["turn"].value;
    assert!((turn - 0.09).abs() < 1e-3, "{turn}");
    // The fitted rig names it.
    let text = found.fitted.rewritten(Rig::REFERENCE_TOML).expect("TOML");
    assert!(text.contains("name = \"pulley-eccentricity\""));
}

#[test]
fn check_lists_it_where_the_record_does_not_show_it() {
    let rig = rig("");
    let told = |record: &Record| -> Vec<(&str, String)> {
        let subsystems = check(record).subsystems(&rig.catalogue, Some(&rig));
        let lacks = subsystems.into_iter().flat_map(|subsystem| {
            let blind_to = subsystem.blind_to.into_iter();
            blind_to.map(move |lack| (subsystem.name, lack))
        });
        lacks.filter(|(_, lack)| lack.contains(KIND.name)).collect()
    };
    let drive = triangles(4.0);
    assert_eq!(told(&hidden(&drive, 1)), []);
    let of_force = "force-sensor-offset, pulley-eccentricity, muscle against load: no force_n";
    let of_load = "force-sensor-offset, pulley-eccentricity: no force_n";
    assert_eq!(
        told(&drive),
        [
            ("muscle force", of_force.to_owned()),
            ("load", of_load.to_owned())
        ]
    );
    // One length, at which no load can be diagnosed.
    let mut clamped = hidden(&drive, 1);
    clamped.set(CONTRACTION, vec![0.1; 600]);
    let of_force = "hysteresis, backlash, pulley-eccentricity, what else depends on the \
                    contraction: one contraction only";
    assert_eq!(told(&clamped), [("muscle force", of_force.to_owned())]);
}

#[test]
fn malformed_lines_are_refused_with_line_and_key() {
    let first = Rig::REFERENCE_TOML.lines().count() + 1;
    for (from, to, line, expected) in [
        (
            "turn = 0.09",
            "turn = 3",
            4,
            "key `effect.turn`: expected a number from 0.02 to 0.2",
        ),
        (
            "turn = 0.09",
            "diameter_m = 0.03",
            4,
            "key `effect.diameter_m`: expected one of the keys name, form, cosine, sine, turn",
        ),
        (
            "turn = 0.09\n",
            "",
            0,
            "key `effect.turn`: expected a number [1], found no such key",
        ),
        (
            "cosine = 0.06",
            "form = \"second-harmonic\"",
            2,
            "key `effect.form`: expected one of first-harmonic, found \"second-harmonic\"",
        ),
    ] {
        let text = Rig::REFERENCE_TOML.to_owned() + &EFFECT.replace(from, to);
        let error = Rig::parse_with(catalogue(), "rig.toml", &text).expect_err("malformed");
        let start = format!("rig.toml:{}: {expected}", first + line);
        assert!(error.to_string().starts_with(&start), "{error}\n{start}");
    }
}

#[test]
fn compensate_refuses_it_with_its_own_sentence() {
    let CompensationMethod::Unavailable(reason) = KIND.compensation else {
        panic!("it is not compensated");
    };
    let done = compensate(&rig(EFFECT), &SettingsValues::reference()).expect("compensated");
    let part = done.parts.iter().find(|part| part.name == KIND.name);
    let part = part.expect("a part for every effect");
    assert_eq!((part.compensated, part.words.as_str()), (false, reason));
}

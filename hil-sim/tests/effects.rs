//! Effects in `rig.toml` and in simulations of records. Their physics is tested in muscle-plant.

use hil_sim::identify::simulate::simulate;
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::{Rig, effect_toml};
use muscle_plant::effects::{Catalogue, Effect, leak, pressure_sensor_offset};

const TOLERANCE: f64 = 1e-9;
const STEP_S: f64 = 0.01;

/// The reference rig with these lines at its end, its muscle clamped.
fn clamped(effects: &str) -> Rig {
    let text = Rig::REFERENCE_TOML.replace("kind = \"weight\"", "kind = \"prescribed\"");
    assert_ne!(text, Rig::REFERENCE_TOML);
    Rig::parse("rig.toml", &(text + effects)).expect("a rig")
}

/// A record of a muscle that is clamped at a contraction of 0.1, with its pressure in the first row
/// alone where a reference drives it.
fn driven(rows: usize) -> Record {
    let mut record = Record::new((0..rows).map(|row| row as f64 * STEP_S).collect());
    let reference_pa = (0..rows).map(|row| [2e5, 3e5, 2.4e5, 2.6e5][row / 50 % 4]);
    record.set(PRESSURE_REF_PA, reference_pa.collect());
    record.set(CONTRACTION, vec![0.1; rows]);
    let pressure_pa = (0..rows).map(|row| if row == 0 { 2e5 } else { f64::NAN });
    record.set(PRESSURE_PA, pressure_pa.collect());
    record
}

/// A record of pressure and contraction, which are then inputs.
fn measured(contraction: impl Fn(f64) -> f64, pressure_pa: impl Fn(f64) -> f64) -> Record {
    let time_s: Vec<f64> = (0..101).map(|row| f64::from(row) * STEP_S).collect();
    let mut record = Record::new(time_s.clone());
    record.set(
        CONTRACTION,
        time_s.iter().map(|t| contraction(*t)).collect(),
    );
    record.set(
        PRESSURE_PA,
        time_s.iter().map(|t| pressure_pa(*t)).collect(),
    );
    record
}

fn column(rig: &Rig, record: &Record, name: &str) -> Vec<f64> {
    let simulated = simulate(rig, record, TOLERANCE).expect("simulated");
    simulated.require(name).expect("the column").to_vec()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}

#[test]
fn a_sensor_offset_shifts_the_initial_value_and_the_readings_of_a_simulated_pressure() {
    let offset = Effect::typical(
        &pressure_sensor_offset::KIND,
        &pressure_sensor_offset::KIND.forms[0],
    );
    let offset_pa = offset.values[0];
    let truth = driven(200);
    let mut read = truth.clone();
    let pressure_pa = truth.require(PRESSURE_PA).expect("the column");
    read.set(
        PRESSURE_PA,
        pressure_pa.iter().map(|pa| pa + offset_pa).collect(),
    );
    let true_pa = column(&clamped(""), &truth, PRESSURE_PA);
    let read_pa = column(&clamped(&effect_toml(&offset)), &read, PRESSURE_PA);
    let shifted_pa: Vec<f64> = true_pa.iter().map(|pa| pa + offset_pa).collect();
    assert!(largest_difference(&read_pa, &shifted_pa) < 0.1);
}

/// A reading by the true value and the time \[s\].
type Sensor = fn(f64, f64) -> f64;

/// Effects on sensors, and the readings of pressure and contraction with them.
const SENSORS: [(&str, Sensor, Sensor); 6] = [
    (
        "name = \"pressure-sensor-offset\"\noffset_pa = 3000.0",
        |pressure_pa, _| pressure_pa + 3000.0,
        |contraction, _| contraction,
    ),
    (
        "name = \"pressure-sensor-gain\"\ngain_error = 0.05",
        |pressure_pa, _| 1.05 * pressure_pa,
        |contraction, _| contraction,
    ),
    (
        "name = \"pressure-sensor-drift\"\ndrift_pa_per_s = 200.0",
        |pressure_pa, time_s| pressure_pa + 200.0 * time_s,
        |contraction, _| contraction,
    ),
    (
        "name = \"pressure-sensor-drift\"\nform = \"quadratic\"\ndrift_pa_per_s = 200.0\n\
         growth_pa_per_s2 = -30.0",
        |pressure_pa, time_s| pressure_pa + 200.0 * time_s - 15.0 * time_s * time_s,
        |contraction, _| contraction,
    ),
    (
        "name = \"pressure-sensor-drift\"\nform = \"warm-up\"\ndrift_pa = 4000.0\n\
         time_constant_s = 2.0",
        |pressure_pa, time_s| pressure_pa + 4e3 * (1.0 - (-time_s / 2.0).exp()),
        |contraction, _| contraction,
    ),
    (
        "name = \"contraction-sensor-offset\"\noffset = 0.01",
        |pressure_pa, _| pressure_pa,
        |contraction, _| contraction + 0.01,
    ),
];

#[test]
fn readings_that_are_inputs_are_converted_to_true_values_and_back() {
    let truth = measured(|time_s| 0.02 + 0.08 * time_s, |time_s| 1e5 + 2e5 * time_s);
    let true_n = column(&clamped(""), &truth, FORCE_N);
    for (effect, pressure, contraction) in SENSORS {
        let mut read = truth.clone();
        for (name, sensor) in [(PRESSURE_PA, pressure), (CONTRACTION, contraction)] {
            let values = truth.require(name).expect("the column").iter();
            let readings = values
                .zip(truth.time_s())
                .map(|(value, t)| sensor(*value, *t));
            read.set(name, readings.collect());
        }
        let rig = clamped(&format!("[[effect]]\n{effect}\n"));
        let force_n = column(&rig, &read, FORCE_N);
        assert!(largest_difference(&force_n, &true_n) < 1e-6, "{effect}");
        for name in [PRESSURE_PA, CONTRACTION] {
            let expected = read.require(name).expect("the column");
            let found = column(&rig, &read, name);
            assert!(largest_difference(&found, expected) < 1e-6, "{effect}");
        }
    }
}

#[test]
fn every_form_is_written_and_read_back() {
    let kinds = Catalogue::standard().kinds();
    for (kind, form) in kinds.flat_map(|kind| kind.forms.iter().map(move |form| (kind, form))) {
        let mut effect = Effect::typical(kind, form);
        for value in &mut effect.values {
            // All digits are needed.
            *value *= 1.0 - 1e-15;
        }
        let read = clamped(&effect_toml(&effect)).effects;
        assert_eq!(read.len(), 1);
        let names = (read[0].kind.name, read[0].form.name);
        assert_eq!(names, (kind.name, form.name));
        assert_eq!(read[0].values, effect.values);
    }
}

#[test]
fn an_effect_of_a_valve_that_is_not_simulated_is_ignored() {
    let record = measured(|_| 0.1, |time_s| 1e5 + 2e5 * time_s);
    let leak = Effect::typical(&leak::KIND, &leak::KIND.forms[0]);
    let leaking_n = column(&clamped(&effect_toml(&leak)), &record, FORCE_N);
    assert_eq!(leaking_n, column(&clamped(""), &record, FORCE_N));
}

/// Asserts that a rig with these lines at its end is refused at a line, counted from the first of
/// them, and a key.
fn assert_refused(lines: &str, line: usize, key: &str, says: &str) {
    let parsed = Rig::parse("rig.toml", &(Rig::REFERENCE_TOML.to_owned() + lines));
    let error = parsed.and_then(|rig| simulate(&rig, &driven(10), TOLERANCE));
    let message = error.expect_err("a malformed effect").to_string();
    let line = Rig::REFERENCE_TOML.lines().count() + 1 + line;
    let place = format!("rig.toml:{line}: key `{key}`: expected ");
    assert!(
        message.starts_with(&place) && message.contains(says),
        "{message}\n{place}{says}"
    );
}

#[test]
fn a_malformed_leak_is_refused_with_line_and_key() {
    let leak = "[[effect]]\nname = \"leak\"\n";
    for (lines, line, key, says) in [
        (
            "",
            0,
            "conductance_kg_per_pa_s",
            "a number [kg/(Pa·s)], found no",
        ),
        ("form = 2\n", 2, "form", "a string, found integer"),
        (
            "form = \"slit\"\n",
            2,
            "form",
            "one of linear, orifice, power, found",
        ),
        (
            "conductance_kg_per_pa_s = -1e-9\n",
            2,
            "conductance_kg_per_pa_s",
            "a number from 0 to 1e-6",
        ),
    ] {
        assert_refused(
            &(leak.to_owned() + lines),
            line,
            &format!("effect.{key}"),
            says,
        );
    }
}

#[test]
fn malformed_effects_are_refused_with_line_and_key() {
    let hysteresis = "[[effect]]\nname = \"hysteresis\"\nform = \"duhem\"\nforce_n = 20\n";
    let with = |lines: &str| hysteresis.to_owned() + lines;
    let lag = |ms| {
        format!(
            "[[effect]]\nname = \"valve-lag\"\ntime_constant_s = {}\n",
            1e-3 * f64::from(ms)
        )
    };
    let many: String = (100..137).map(lag).collect();
    for (lines, line, key, says) in [
        (
            "[[effect]]\n".into(),
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
            with("reach = 0.02\nsharpness = 2\n"),
            5,
            "effect.sharpness",
            "one of the keys name, form, force_n, reach, asymmetry, base_share, found this",
        ),
        (
            with("reach = \"far\"\nasymmetry = 1\n"),
            4,
            "effect.reach",
            "a number, found string",
        ),
        (
            with("reach = 0.02\n"),
            0,
            "effect.asymmetry",
            "a number [1], found no",
        ),
        (many, 0, "effect", "more than 36"),
    ] {
        assert_refused(&lines, line, key, says);
    }
}

#[test]
fn every_wrong_key_of_an_effect_is_in_one_error() {
    let lines = "[[effect]]\nname = \"hysteresis\"\nform = \"duhem\"\nforce = 20\n\
                 reach = \"far\"\nasymetry = 1\nbase_share = 9\nsharpness = 2\n";
    let known = "name, form, force_n, reach, asymmetry, base_share";
    let first = Rig::REFERENCE_TOML.lines().count() + 1;
    let says = [
        // The key without its unit, and one misspelt; nothing is like the third.
        (
            3,
            "force",
            format!("one of the keys {known}, found this: did you mean force_n?"),
        ),
        (
            5,
            "asymetry",
            format!("one of the keys {known}, found this: did you mean asymmetry?"),
        ),
        (
            7,
            "sharpness",
            format!("one of the keys {known}, found this"),
        ),
        (0, "force_n", "a number [N], found no such key".into()),
        (4, "reach", "a number, found string".into()),
        (0, "asymmetry", "a number [1], found no such key".into()),
        (6, "base_share", "a number from 0 to 1, found 9".into()),
    ];
    let says = says.map(|(line, key, expected)| {
        format!("{}: key `effect.{key}`: expected {expected}", first + line)
    });
    let text = Rig::REFERENCE_TOML.to_owned() + lines;
    let error = Rig::parse("rig.toml", &text).expect_err("malformed");
    assert_eq!(
        error.to_string(),
        format!("rig.toml:{}", says.join("; line "))
    );
}

#[test]
fn a_misspelt_name_is_answered_with_all_names_and_the_nearest() {
    let names: Vec<_> = Catalogue::standard()
        .kinds()
        .map(|kind| kind.name)
        .collect();
    let listed = format!("one of {}, found ", names.join(", "));
    for (name, end) in [
        ("leek", "\"leek\": did you mean leak?"),
        ("valve_lag", "\"valve_lag\": did you mean valve-lag?"),
        ("bakclash", "\"bakclash\": did you mean backlash?"),
        ("hysteres", "\"hysteres\": did you mean hysteresis?"),
        ("inertia", "\"inertia\""),
    ] {
        let text = format!("{}[[effect]]\nname = \"{name}\"\n", Rig::REFERENCE_TOML);
        let error = Rig::parse("rig.toml", &text).expect_err("no such effect");
        assert!(
            error.to_string().ends_with(&(listed.clone() + end)),
            "{error}"
        );
    }
    let orifice = "[[effect]]\nname = \"leak\"\nform = \"orifce\"\n";
    let says = "one of linear, orifice, power, found \"orifce\": did you mean orifice?";
    assert_refused(orifice, 2, "effect.form", says);
}

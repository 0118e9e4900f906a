//! Tests of the compensation in the closed loop with the independent plant of `tests/truth`, which
//! shares no equation with the simulator.

use hil_sim::bench::board_settings::from_rig;
use hil_sim::bench::closed_loop::Run;
use hil_sim::bench::compensate::{
    AddedLoad, DELAY_MARGIN_S_MIN, GAIN_MARGIN_MIN, LoadSample, SPAN_S, compensate, load_force_n,
};
use hil_sim::bench::settings_file;
use hil_sim::bench::test_signal::{Limits, Part, test_signal};
use hil_sim::bench::tick::TICK_S;
use hil_sim::identify::diagnosis::{Options, diagnose};
use hil_sim::record::{CONTRACTION, PRESSURE_PA, PRESSURE_REF_PA, Record};
use hil_sim::rig::{Rig, effect_toml};
use model_core::compensation::Compensation;
use model_core::controller::Controller;
use model_core::io::{Request, Sensors};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcCount, EncoderCount};
use model_core::supervisor::{Fault, Mode};
use muscle_plant::nominal::Load;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use truth::Hiding;

/// Errors of an assist run with the truth's plant.
#[derive(Clone, Copy, Debug)]
struct Errors {
    /// RMS of F_c − F of the muscle \[N\].
    muscle_n: f64,
    /// RMS of K F_b less the force that reaches the nominal load \[N\].
    load_n: f64,
    /// The fault that the controller latched, if any.
    fault: Option<Fault>,
}

const TICKS: usize = 800;
const LATE_S: f64 = 1e-4;

/// The paper's rig with an effect of `tests/truth`.
fn hiding(name: &str, form: &str, size: f64) -> Hiding<'static> {
    static RIG: std::sync::LazyLock<truth::Rig> = std::sync::LazyLock::new(truth::Rig::default);
    let entry = truth::CATALOGUE.iter().find(|entry| entry.name == name);
    let forms = entry.expect("an effect").forms;
    let form = forms.iter().find(|known| known.name == form);
    Hiding {
        rig: &RIG,
        effect: Some((form.expect("a form"), size)),
        seed: 11,
    }
}

/// The paper's lift, hold and way down on the truth's plant, with a controller that has `settings`
/// on the electronics of `plain`.
fn assist(hiding: &Hiding, plain: &Settings, settings: Settings) -> Errors {
    let nominal = Rig::reference();
    let Load::Weight(weight) = nominal.nominal.load else {
        panic!("a weight");
    };
    let (lever, length_m) = (
        nominal.assist.expect("a lever"),
        nominal.nominal.muscle.initial_length_m,
    );
    let electronics = plain.values();
    let experiment = Run::PAPER;
    let mut controller = Controller::new(settings);
    let mut noise = Pcg64Mcg::seed_from_u64(1);
    let mut request = Request::None;
    let (mut reference_n, mut load_samples) = (Vec::new(), Vec::new());
    let mut fault = None;
    hiding.run((TICK_S, LATE_S), TICKS, |seen| {
        let finger_m = experiment.finger.intended_m(seen.time_s);
        let finger_n = lever.finger_force_n(finger_m, seen.truth.contraction, length_m);
        let mut normal = || -> f64 { StandardNormal.sample(&mut noise) };
        let bridge_n = finger_n + experiment.bridge_noise_n * normal();
        let pressure_pa = seen.reading.pressure_pa + experiment.pressure_noise_pa * normal();
        let travel_m = seen.reading.contraction * length_m;
        let counts = (travel_m / f64::from(electronics.encoder_m_per_count)).round();
        let output = controller.tick(&Sensors {
            bridge: electronics.bridge.count(bridge_n as f32),
            pressure: electronics.pressure_sensor.count(pressure_pa as f32),
            encoder: EncoderCount(counts as i32 as u32),
            read_back: AdcCount(controller.state().valve.get()),
            missed_ticks: 0,
            request,
        });
        fault = output.fault;
        request = match output.mode {
            Mode::Ready => Request::Assist,
            _ => Request::None,
        };
        reference_n.push(f64::from(output.reference_force_n));
        load_samples.push(LoadSample {
            required_n: lever.gain * f64::from(output.finger_force_n),
            force_n: seen.truth.force_n,
            contraction: seen.truth.contraction,
        });
        electronics.valve_drive.pressure(output.valve).0.into()
    });
    let hidden = hiding.parameters();
    let number = |key: &str| hidden[key].as_f64().unwrap_or(0.0);
    let added_load = AddedLoad {
        mass_kg: number("mass_kg"),
        friction_n: number("static_n").max(number("coulomb_n")),
    };
    let load_n = load_force_n(&weight, &added_load, length_m, &load_samples);
    let span = (SPAN_S.start / TICK_S) as usize..(SPAN_S.end / TICK_S) as usize;
    let rms = |error: &dyn Fn(usize) -> f64| {
        let squares: f64 = span.clone().map(|tick| error(tick).powi(2)).sum();
        (squares / span.len() as f64).sqrt()
    };
    Errors {
        muscle_n: rms(&|tick| reference_n[tick] - load_samples[tick].force_n),
        load_n: rms(&|tick| load_samples[tick].required_n - load_n[tick]),
        fault,
    }
}

/// The form of hil-sim that is nearest to the hidden effect, with the hidden sizes, as `[[effect]]`
/// of a rig; empty if the controller cannot compensate it.
fn nearest(name: &str, hidden: &Value) -> String {
    let number = |key: &str| hidden[key].as_f64().unwrap_or(0.0);
    let parameters = match name {
        "hysteresis" if hidden["share"].is_array() => {
            let of = |key: &str, i: usize| hidden[key][i].as_f64().unwrap_or(0.0);
            let spread = of("reach", 3) / of("reach", 0);
            format!(
                "force_n = {:?}\nreach = {:?}\nspread = {spread:?}\ntaper = {:?}\n\
                 base_share = 0.0",
                number("half_width_n"),
                (of("reach", 0) * of("reach", 3)).sqrt(),
                (of("share", 0) / of("share", 3)).ln() / spread.ln(),
            )
        }
        "hysteresis" if hidden["sharpness"].is_number() => format!(
            "form = \"bouc-wen\"\nforce_n = {:?}\nreach = {:?}\nsharpness = {:?}\nbase_share = 0.0",
            number("half_width_n"),
            number("reach"),
            number("sharpness").max(1.0)
        ),
        "hysteresis" => format!(
            "form = \"duhem\"\nforce_n = {:?}\nreach = {:?}\nasymmetry = {:?}\nbase_share = {:?}",
            number("half_width_n"),
            number("reach_in"),
            number("height_out"),
            number("share_at_zero")
        ),
        "friction" => format!("force_n = {:?}", number("coulomb_n")),
        "payload" => format!("mass_kg = {:?}", number("mass_kg")),
        "valve-dead-zone" => format!(
            "form = \"asymmetric\"\nfilling_pa = {:?}\nexhausting_pa = {:?}",
            number("width_pa"),
            number("venting_width_pa")
        ),
        "valve-lag" if hidden["frequency_hz"].is_number() => format!(
            "form = \"second-order\"\ntime_constant_s = {:?}\ndamping_ratio = {:?}",
            1.0 / (std::f64::consts::TAU * number("frequency_hz")),
            number("damping")
        ),
        "valve-lag" => format!(
            "time_constant_s = {:?}",
            number("time_constant_s") + number("second_time_constant_s")
        ),
        "transport-delay" => format!("delay_s = {:?}", number("delay_s")),
        "pressure-sensor-gain" => format!("gain_error = {:?}", number("gain") - 1.0),
        "pressure-sensor-offset" => format!("offset_pa = {:?}", number("offset_pa")),
        _ => return String::new(),
    };
    format!("\n[[effect]]\nname = \"{name}\"\n{parameters}\n")
}

fn fitted(effects: &str) -> Rig {
    let nominal = include_str!("../src/rig/reference_rig.toml");
    Rig::parse("rig.fitted.toml", &format!("{nominal}{effects}")).expect("a rig")
}

/// The settings that the command makes of `rig`.
fn compensated(rig: &Rig) -> Settings {
    let done = compensate(rig, &SettingsValues::reference()).expect("compensated");
    assert!(done.after.load_error_n_rms <= done.before.load_error_n_rms);
    assert!(done.corners.gain_margin_min >= done.before.gain_margin.min(GAIN_MARGIN_MIN));
    assert!(done.corners.delay_margin_s_min >= done.before.delay_margin_s.min(DELAY_MARGIN_S_MIN));
    // The errors of two realisations of the noise differ by up to half a percent.
    let worst_n = done.corners.load_error_n_rms_max;
    assert!(
        worst_n <= 1.005 * done.before.load_error_n_rms,
        "{worst_n} N in a corner"
    );
    done.settings
}

fn plain() -> Settings {
    from_rig(&Rig::reference()).expect("settings")
}

/// Prints one line of docs/compensation.md.
fn print_line(name: &str, form: &str, size: f64, before: Errors, after: Errors) {
    println!(
        "| {name} {form} | {size} | {:.1} | {:.1} | {:.2} | {:.1} | {:.1} | {:.2} |",
        before.load_n,
        after.load_n,
        after.load_n / before.load_n,
        before.muscle_n,
        after.muscle_n,
        after.muscle_n / before.muscle_n
    );
}

const HALVED: [&str; 3] = ["hysteresis", "valve-dead-zone", "friction"];
/// Largest ratio of two errors that differ only by the realisation of the noise: over 650 ticks,
/// each with the bridge's 0.4 N, the RMS of errors of some newtons differs by less than 1 %.
const NO_WORSE: f64 = 1.01;

/// The stage with the hidden sizes, and a lead of two ticks for hold, delay and gas.
#[test]
fn errors_of_hidden_effects_fall_by_half() {
    let cases = [
        ("hysteresis", "play-sum"),
        ("valve-dead-zone", "sharp"),
        ("friction", "coulomb"),
    ];
    for (name, form) in cases {
        let hiding = hiding(name, form, 0.7);
        let hidden = hiding.parameters();
        let number = |key: &str| hidden[key].as_f64().unwrap_or(0.0) as f32;
        let mut values = *plain().values();
        values.compensation = Compensation {
            hysteresis_area_m2: number("half_width_n") / 3e5,
            hysteresis_reach: 0.03,
            friction_n: number("coulomb_n"),
            friction_reach_m: 1e-3,
            force_n_max: 100.0,
            lead_s: 0.02,
            dead_zone_filling_pa: number("width_pa"),
            dead_zone_exhausting_pa: number("venting_width_pa"),
            pressure_pa_max: 5e4,
            ..Compensation::OFF
        };
        let before = assist(&hiding, &plain(), plain());
        let after = assist(&hiding, &plain(), Settings::new(values).expect("settings"));
        print_line(name, form, 0.7, before, after);
        assert_eq!((before.fault, after.fault), (None, None));
        assert!(after.load_n <= 0.5 * before.load_n, "{name} {form}");
    }
}

#[test]
fn a_rig_without_an_effect_becomes_no_worse() {
    let hiding = Hiding {
        effect: None,
        ..hiding("slack", "sharp", 0.0)
    };
    let before = assist(&hiding, &plain(), plain());
    let after = assist(&hiding, &plain(), compensated(&Rig::reference()));
    print_line("none", "", 0.0, before, after);
    assert_eq!((before.fault, after.fault), (None, None));
    assert!(after.load_n < before.load_n && after.muscle_n < before.muscle_n);
}

/// Two cases in which a full compensation is not the best: a hysteresis loop so wide that its full
/// compensation over the estimated distance makes the weight oscillate; and a dead zone with
/// rounded edges, a small part of which costs the lead that alone halves the error.
#[test]
fn errors_fall_by_half_if_full_compensation_is_not_robust() {
    let soft = "[[effect]]\nname = \"valve-dead-zone\"\nform = \"rounded\"\n\
         half_width_pa = 4500.0\nrounding_pa = 2300.0\n";
    let duhem = hiding("hysteresis", "duhem", 1.0);
    let wide = nearest("hysteresis", &duhem.parameters());
    let rounded = hiding("valve-dead-zone", "rounded", 0.7);
    for (hiding, effect) in [(duhem, wide.as_str()), (rounded, soft)] {
        let before = assist(&hiding, &plain(), plain());
        let after = assist(&hiding, &plain(), compensated(&fitted(effect)));
        assert_eq!((before.fault, after.fault), (None, None));
        assert!(after.load_n <= 0.5 * before.load_n, "{effect}");
        assert!(after.muscle_n <= 0.5 * before.muscle_n, "{effect}");
    }
}

/// Whether the effect `name` of the rig with `effects` is compensated.
fn is_compensated(name: &str, effects: &str) -> bool {
    let done = compensate(&fitted(effects), &SettingsValues::reference()).expect("compensated");
    let part = done.parts.iter().find(|part| part.name == name);
    part.expect("the part").compensated
}

#[test]
fn only_what_makes_the_error_noticeably_smaller_is_compensated() {
    let payload =
        |mass_kg: f64| format!("\n[[effect]]\nname = \"payload\"\nmass_kg = {mass_kg:?}\n");
    assert!(is_compensated("payload", &payload(1.0)));
    assert!(!is_compensated("payload", &payload(0.002)));
}

/// A hysteresis loop whose full compensation over the shortest distance leaves the smallest error
/// and no gain margin. [`compensated`] checks the margins.
#[test]
fn the_gain_margin_is_kept_where_more_compensation_would_leave_a_smaller_error() {
    let steep = "\n[[effect]]\nname = \"hysteresis\"\nform = \"bouc-wen\"\nforce_n = 40.0\n\
         reach = 0.01\nsharpness = 1.5\nbase_share = 0.0\n";
    let compensation = compensated(&fitted(steep)).values().compensation;
    assert!(compensation.hysteresis_area_m2 > 0.0);
}

#[test]
fn sensor_errors_are_compensated_in_full() {
    let effects = "\n[[effect]]\nname = \"pressure-sensor-offset\"\noffset_pa = 6000.0\n\
         [[effect]]\nname = \"pressure-sensor-gain\"\ngain_error = 0.05\n";
    let scale = compensated(&fitted(effects)).values().pressure_sensor;
    let plain = plain().values().pressure_sensor;
    let expected = plain.zero_count + 6000.0 / plain.per_count;
    assert!(
        (scale.zero_count - expected).abs() < 1e-3,
        "{}",
        scale.zero_count
    );
    assert!(
        (scale.per_count - plain.per_count / 1.05).abs() < 1e-4,
        "{}",
        scale.per_count
    );
}

fn hil_sim(folder: &Path, words: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .current_dir(folder)
        .args(words.split(' '))
        .output()
        .expect("the command runs")
}

/// The command's files; and what cannot be compensated is said: a contraction sensor's offset goes
/// with the self-check, which takes the encoder's zero anew.
#[test]
fn command_writes_settings_that_read_back_and_says_what_it_leaves() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let offset = "\n[[effect]]\nname = \"contraction-sensor-offset\"\noffset = 0.01\n";
    let rig = include_str!("../src/rig/reference_rig.toml").to_owned() + offset;
    std::fs::write(path.join("rig.toml"), rig).expect("written");
    let output = hil_sim(path, "compensate --rig rig.toml --out done --json");
    assert!(output.status.success(), "{output:?}");
    let summary: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let part = &summary["parts"][1];
    assert_eq!(part["name"], "contraction-sensor-offset");
    assert_eq!(part["compensated"], false);
    assert!(
        path.join("done/report.html").is_file() && path.join("done/compensation.json").is_file()
    );
    let settings = settings_file::read(&path.join("done/settings.toml")).expect("settings");
    let lead_s = settings.values().compensation.lead_s;
    // Half a tick of hold at least; more than 100 ms no valve B has.
    assert!((0.005..0.1).contains(&lead_s), "{lead_s}");
    // They are the board's settings to begin with, whose compensation is found anew.
    let bad = hil_sim(
        path,
        "compensate --rig rig.toml --settings rig.toml --out done",
    );
    assert_eq!(bad.status.code(), Some(2));
    let same = hil_sim(path, "compensate --rig done/settings.toml --out done");
    assert_eq!(same.status.code(), Some(2));
    assert!(
        String::from_utf8_lossy(&same.stderr).contains("another --out"),
        "{same:?}"
    );
}

#[test]
#[ignore = "every effect in every form, for docs/compensation.md: 10 minutes in release"]
fn no_effect_becomes_worse() {
    let untold = compensated(&Rig::reference());
    let mut bad = Vec::new();
    for entry in truth::CATALOGUE {
        for form in entry.forms {
            for size in [0.4, 0.7, 1.0] {
                let hiding = hiding(entry.name, form.name, size);
                let settings = match nearest(entry.name, &hiding.parameters()) {
                    none if none.is_empty() => untold,
                    effect => compensated(&fitted(&effect)),
                };
                let before = assist(&hiding, &plain(), plain());
                let after = assist(&hiding, &plain(), settings);
                if before.fault.is_some() {
                    println!(
                        "| {} {} | {size} | {:?} |",
                        entry.name, form.name, before.fault
                    );
                    continue;
                }
                print_line(entry.name, form.name, size, before, after);
                let worse = after.fault.is_some()
                    || after.load_n > NO_WORSE * before.load_n
                    || after.muscle_n > NO_WORSE * before.muscle_n;
                let whole = HALVED.contains(&entry.name) && after.load_n > 0.5 * before.load_n;
                if worse || whole {
                    bad.push((entry.name, form.name, size));
                }
            }
        }
    }
    assert_eq!(bad, []);
}

/// Of the drive `parts`, what the truth's instruments tell.
fn recorded(hiding: &Hiding, rig: &Rig, parts: &[Part], seed: u64) -> Record {
    let limits = Limits::of(rig, 0.25).expect("limits");
    let drive = test_signal(&limits, parts).record;
    let reference_pa = drive.require(PRESSURE_REF_PA).expect("a reference");
    let mut noise = Pcg64Mcg::seed_from_u64(seed);
    let (mut pressure_pa, mut contraction) = (Vec::new(), Vec::new());
    // 12.5 µm on 0.3 m.
    let count = 12.5e-6 / 0.3;
    hiding.run((TICK_S, LATE_S), reference_pa.len(), |seen| {
        let normal: f64 = StandardNormal.sample(&mut noise);
        let row = pressure_pa.len();
        pressure_pa.push(seen.reading.pressure_pa + 250.0 * normal);
        contraction.push((seen.reading.contraction / count).round() * count);
        reference_pa[row]
    });
    let mut record = Record::new(
        (0..reference_pa.len())
            .map(|row| row as f64 * TICK_S)
            .collect(),
    );
    record.set(PRESSURE_REF_PA, reference_pa.to_vec());
    record.set(PRESSURE_PA, pressure_pa);
    record.set(CONTRACTION, contraction);
    record
}

/// The form `form` of the truth's effect `name`, as a diagnosis of its records finds it: the error
/// at the load falls to a half, and the muscle's own where the effect enlarges it, which friction
/// does not.
fn falls_by_half_after_a_diagnosis(name: &str, form: &str) {
    let tolerance = "\n[tolerance.muscle]\nalpha_m2 = 0.01\ngamma_n = 0.02\n\
         [tolerance.valve]\nflow_gain_kg_per_pa_s = 0.03\n";
    let rig = fitted(tolerance);
    let hiding = hiding(name, form, 0.7);
    let fit = [
        recorded(&hiding, &rig, &[Part::Triangles], 1),
        recorded(&hiding, &rig, &[Part::Sweep], 2),
    ];
    let validate = [recorded(&hiding, &rig, &[Part::Multisine], 3)];
    let diagnosed =
        diagnose(&rig, &fit, &validate, &Options::default(), &|_| ()).expect("diagnosed");
    let found = diagnosed.fitted.effects.iter();
    let found: Vec<String> = found.map(effect_toml).collect();
    let found = found.join("").replace('\n', "; ");
    println!("{found}");
    let before = assist(&hiding, &plain(), plain());
    let after = assist(&hiding, &plain(), compensated(&diagnosed.fitted));
    print_line(name, form, 0.7, before, after);
    assert_eq!((before.fault, after.fault), (None, None));
    assert!(after.load_n <= 0.5 * before.load_n, "{found}");
    assert!(
        name == "friction" || after.muscle_n <= 0.5 * before.muscle_n,
        "{found}"
    );
}

/// A test for each form, as each takes minutes.
macro_rules! errors_fall_by_half_after_a_diagnosis {
    ($($test:ident: $name:literal $form:literal,)*) => {$(
        #[test]
        #[ignore = "diagnoses a rig, for docs/compensation.md: 1 to 6 minutes in release"]
        fn $test() {
            falls_by_half_after_a_diagnosis($name, $form);
        }
    )*};
}

errors_fall_by_half_after_a_diagnosis! {
    errors_fall_by_half_after_a_diagnosis_of_play_sum: "hysteresis" "play-sum",
    errors_fall_by_half_after_a_diagnosis_of_bouc_wen: "hysteresis" "bouc-wen",
    errors_fall_by_half_after_a_diagnosis_of_duhem: "hysteresis" "duhem",
    errors_fall_by_half_after_a_diagnosis_of_coulomb: "friction" "coulomb",
    errors_fall_by_half_after_a_diagnosis_of_stribeck: "friction" "stribeck",
    errors_fall_by_half_after_a_diagnosis_of_lugre: "friction" "lugre",
    errors_fall_by_half_after_a_diagnosis_of_sharp: "valve-dead-zone" "sharp",
    errors_fall_by_half_after_a_diagnosis_of_rounded: "valve-dead-zone" "rounded",
    errors_fall_by_half_after_a_diagnosis_of_asymmetric: "valve-dead-zone" "asymmetric",
}

/// The case of the tutorial: `compensate` and a board take its rig without an edit.
#[test]
fn the_tutorials_rig_has_what_a_board_needs() {
    let case = truth::case(1, 30);
    let rig = Rig::parse("rig.toml", &case.rig_toml).expect("a rig");
    let settings = hil_sim::bench::board_settings::from_rig(&rig);
    assert!(settings.is_ok(), "{:?}", settings.err());
}

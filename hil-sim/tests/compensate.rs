//! The compensation, proved on rigs that the tool has never seen: the plant of `tests/truth`, which
//! shares no equation with it, in the loop with the controller.

use hil_sim::closed_loop::{Experiment, TICK_S, settings};
use hil_sim::compensate::{Beyond, Pulled, SPAN_S, compensate, load_force_n};
use hil_sim::rig::{Load, Rig};
use model_core::controller::Controller;
use model_core::frame::{Request, Sensors};
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::EncoderCount;
use model_core::supervisor::Mode;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use truth::Hiding;

/// Errors of an assist run with the truth's plant.
#[derive(Clone, Copy, Debug)]
struct Errors {
    /// RMS of F_c − F of the muscle \[N\].
    muscle_n: f64,
    /// RMS of K F_b less the force that reaches the nominal load \[N\].
    load_n: f64,
}

const TICKS: usize = 800;
const LATE_S: f64 = 1e-4;

/// What the effect that `hiding` hides is called, and in which form.
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
    let Load::Weight(weight) = nominal.load else {
        panic!("a weight");
    };
    let (lever, length_m) = (
        nominal.assist.expect("a lever"),
        nominal.muscle.initial_length_m,
    );
    let electronics = plain.values();
    let experiment = Experiment::PAPER;
    let mut controller = Controller::new(settings);
    let mut noise = Pcg64Mcg::seed_from_u64(1);
    let mut request = Request::None;
    let (mut reference_n, mut pulled) = (Vec::new(), Vec::new());
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
            missed_ticks: 0,
            request,
        });
        assert_eq!(output.fault, None, "at {} s", seen.time_s);
        request = match output.mode {
            Mode::Ready => Request::Assist,
            _ => Request::None,
        };
        reference_n.push(f64::from(output.reference_force_n));
        pulled.push(Pulled {
            asked_n: lever.gain * f64::from(output.finger_force_n),
            force_n: seen.truth.force_n,
            contraction: seen.truth.contraction,
        });
        electronics.valve_drive.pressure(output.valve).0.into()
    });
    let hidden = hiding.parameters();
    let number = |key: &str| hidden[key].as_f64().unwrap_or(0.0);
    let beyond = Beyond {
        mass_kg: number("mass_kg"),
        friction_n: number("static_n").max(number("coulomb_n")),
    };
    let load_n = load_force_n(&weight, &beyond, length_m, &pulled);
    let span = (SPAN_S.start / TICK_S) as usize..(SPAN_S.end / TICK_S) as usize;
    let rms = |error: &dyn Fn(usize) -> f64| {
        let squares: f64 = span.clone().map(|tick| error(tick).powi(2)).sum();
        (squares / span.len() as f64).sqrt()
    };
    Errors {
        muscle_n: rms(&|tick| reference_n[tick] - pulled[tick].force_n),
        load_n: rms(&|tick| pulled[tick].asked_n - load_n[tick]),
    }
}

/// The nearest of hil-sim's forms to what is hidden, with the hidden sizes, as `[[effect]]` of a
/// rig; empty where the compensation has nothing for it, and is told nothing.
fn nearest(name: &str, hidden: &Value) -> String {
    let number = |key: &str| hidden[key].as_f64().unwrap_or(0.0);
    let parameters = match name {
        "hysteresis" if hidden["share"].is_array() => {
            let of = |key: &str, i: usize| hidden[key][i].as_f64().unwrap_or(0.0);
            let mean: f64 = (0..4).map(|i| of("share", i) * of("reach", i)).sum();
            // Of elements spread evenly up to the reach the mean is half of it.
            format!(
                "force_n = {:?}\nreach = {:?}",
                number("half_width_n"),
                2.0 * mean
            )
        }
        "hysteresis" if hidden["sharpness"].is_number() => format!(
            "form = \"bouc-wen\"\nforce_n = {:?}\nreach = {:?}\nsharpness = {:?}",
            number("half_width_n"),
            number("reach"),
            number("sharpness").max(1.0)
        ),
        "hysteresis" => format!(
            "form = \"duhem\"\nforce_n = {:?}\nreach = {:?}\nasymmetry = {:?}",
            number("half_width_n"),
            number("reach_in"),
            number("height_out")
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
    let nominal = include_str!("../src/reference_rig.toml");
    Rig::parse("rig.fitted.toml", &format!("{nominal}{effects}")).expect("a rig")
}

/// Errors before and after, with the compensation of `rig`.
fn before_and_after(hiding: &Hiding, rig: &Rig) -> (Errors, Errors) {
    let plain = settings(&Rig::reference()).expect("settings");
    let done = compensate(rig, &SettingsValues::reference()).expect("compensated");
    for part in &done.parts {
        println!("      {}: {} {}", part.name, part.compensated, part.words);
    }
    (
        assist(hiding, &plain, plain),
        assist(hiding, &plain, done.settings),
    )
}

#[test]
fn errors_of_hidden_effects_fall_by_half() {
    for (name, form) in [
        ("hysteresis", "play-sum"),
        ("valve-dead-zone", "sharp"),
        ("friction", "coulomb"),
    ] {
        let hiding = hiding(name, form, 0.7);
        let rig = fitted(&nearest(name, &hiding.parameters()));
        let (before, after) = before_and_after(&hiding, &rig);
        println!("{name} {form}: {before:.2?} {after:.2?}");
    }
}

#[test]
#[ignore = "all effects: minutes without --release"]
fn no_effect_becomes_worse() {
    for entry in truth::CATALOGUE {
        for form in entry.forms {
            for size in [0.4, 0.7, 1.0] {
                let hiding = hiding(entry.name, form.name, size);
                let rig = fitted(&nearest(entry.name, &hiding.parameters()));
                let (before, after) = before_and_after(&hiding, &rig);
                println!(
                    "{} {} {size}: muscle {:.2} {:.2} ({:.2}) load {:.2} {:.2} ({:.2})",
                    entry.name,
                    form.name,
                    before.muscle_n,
                    after.muscle_n,
                    after.muscle_n / before.muscle_n,
                    before.load_n,
                    after.load_n,
                    after.load_n / before.load_n
                );
            }
        }
    }
}

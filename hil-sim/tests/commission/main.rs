//! Commissioning of the right rig and of wrong ones, in lockstep with the controller on the PC.

#[cfg(all(unix, feature = "serial"))]
mod command;
mod device;
mod estimators;
mod world;

use device::InMemory;
use hil_sim::bench::error::Error;
use hil_sim::bench::port::client::{Client, LinkError};
use hil_sim::commission::cause::{Cause, Step};
use hil_sim::commission::session::{Measured, Session};
use hil_sim::commission::written;
use hil_sim::rig::Rig;
use model_core::limits::PLAY_SILENCE_TICKS;
use model_core::settings::{Settings, SettingsValues};
use model_core::signal::{AdcScale, ValveDrive};
use muscle_plant::effects::{Catalogue, Effect};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use world::{MISWIRED, Someone, Wiring, World};

/// How far air may move the weight of a wrong rig \[m\].
const MOVED_M_MAX: f64 = 0.01;

/// Head of the table of wrong rigs in docs/commissioning.md.
const TABLE_HEAD: &str = "| rig | step that names it | «probably wrong» | \
                          air moves the weight by at most \\[mm\\] |\n|---|---|---|---|\n";

/// How a session ended.
struct Ended {
    complete: bool,
    found: Option<(Step, Vec<Cause>)>,
    values: SettingsValues,
    measured: Measured,
    /// Settings on the board at the end.
    stored: SettingsValues,
    /// How often settings were stored.
    written: usize,
    moved_m: f64,
    told: String,
    report: String,
}

fn template() -> Rig {
    Rig::parse("rig.toml", &Rig::template()).expect("the template is a rig")
}

fn commission(
    wiring: Wiring,
    stored: SettingsValues,
    steps: &[Step],
    answers: &[(&'static str, &'static str)],
) -> Ended {
    commission_by(wiring, stored, steps, (answers, false))
}

/// As [`commission`], with other answers than the usual ones; the person may correct what is found.
fn commission_by(
    wiring: Wiring,
    stored: SettingsValues,
    steps: &[Step],
    (answers, repairs): (&[(&'static str, &'static str)], bool),
) -> Ended {
    commission_in(
        World::new(wiring),
        stored,
        steps,
        (answers, repairs),
        |_| {},
    )
}

fn commission_in(
    world: World,
    stored: SettingsValues,
    steps: &[Step],
    (answers, repairs): (&[(&'static str, &'static str)], bool),
    prepare: impl FnOnce(&mut InMemory),
) -> Ended {
    let world = Arc::new(Mutex::new(world));
    let mut board = InMemory::new(Arc::clone(&world), stored);
    prepare(&mut board);
    let log = board.log();
    let stop = Arc::new(AtomicBool::new(false));
    let mut client = Client::new(board, Duration::from_secs(5), stop);
    let mut person = Someone {
        world: Arc::clone(&world),
        told: String::new(),
        repairs,
        answers: answers.to_vec(),
    };
    let checks = steps == Step::CHECK;
    let mut session = Session::new(&mut client, &mut person, &template(), checks).expect("a board");
    let complete = session.run(steps).expect("answers");
    let (values, measured) = (session.values, session.measured.clone());
    let report = written::report(&session.seen, &values, complete).to_html();
    let last = session.seen.last();
    let found = last.map(|seen| (seen.step, seen.causes.clone()));
    let log = log.lock().expect("the log");
    Ended {
        complete,
        found: found.filter(|(_, causes)| !causes.is_empty()),
        values,
        measured,
        stored: log.settings,
        written: log.written,
        moved_m: world.lock().expect("the world").moved_m,
        told: person.told,
        report,
    }
}

/// A quantity within `relative` of its true value.
fn assert_near(name: &str, found: f64, truth: f64, relative: f64) {
    assert!(
        (found / truth - 1.0).abs() <= relative,
        "{name}: {found} for {truth}"
    );
}

#[test]
fn the_right_rig_is_commissioned() {
    let old = SettingsValues::reference();
    let ended = commission(Wiring::Right, old, &Step::ALL, &[]);
    assert!(ended.complete, "{}", ended.told);
    let values = &ended.values;
    // Noise of 2 counts in means of 100: 0.2 counts of 409 and of 1170, three times over.
    let near = |name, found: f32, truth: f32, relative| {
        assert_near(name, found.into(), truth.into(), relative);
    };
    near(
        "bridge",
        values.bridge.per_count,
        old.bridge.per_count,
        1.5e-3,
    );
    let (found, truth) = (values.pressure_sensor, old.pressure_sensor);
    near("pressure sensor", found.per_count, truth.per_count, 1.5e-3);
    assert!((found.zero_count - truth.zero_count).abs() < 1.0);
    // A count of 1600.
    near(
        "encoder",
        values.encoder_m_per_count,
        old.encoder_m_per_count,
        1e-3,
    );
    let gains = [values, &old].map(|values| values.valve_drive.amplifier_gain);
    near("amplifier", gains[0], gains[1], 3e-3);
    // 1 N of the friction that the pressure's noise and the sampling leave, of 118 N.
    let lift = ended.measured.lift.expect("a lift");
    assert_near("mass", lift.mass_kg.expect("lifted"), 12.0, 0.01);
    let friction = ended.measured.friction.expect("triangles");
    assert_near("static friction", friction.static_friction().0, 7.0, 0.1);
    assert_near("Coulomb friction", friction.coulomb_n, 4.5, 0.2);
    // Three plays, each with trial settings that are taken back; nothing else before the end.
    assert_eq!((ended.stored, ended.written), (old, 6));
    assert!(ended.report.contains("Every step is right"));
}

#[test]
fn each_wrong_rig_is_named_by_its_step_and_moves_by_less_than_10_mm() {
    let old = SettingsValues::reference();
    let mut table = String::from(TABLE_HEAD);
    for rig in &MISWIRED {
        let ended = commission(rig.wiring, old, &Step::ALL, &[]);
        let (told, moved_m) = (&ended.told, ended.moved_m);
        assert_eq!(
            ended.found,
            Some((rig.step, vec![rig.cause])),
            "{}: {told}",
            rig.words
        );
        assert!(moved_m < MOVED_M_MAX, "{}: {moved_m} m", rig.words);
        assert!(!ended.complete);
        assert_eq!(ended.stored, old, "{}", rig.words);
        let (heading, says, moved_mm) = (
            rig.step.heading(),
            rig.cause.words(),
            (1e3 * moved_m).ceil(),
        );
        table += &format!("| {} | {heading} | {says} | {moved_mm} |\n", rig.words);
    }
    let page = include_str!("../../../docs/commissioning.md");
    assert!(
        page.contains(&table),
        "the table of the page is now\n{table}"
    );
}

/// A cable that is loose for a moment is not taken for a heavy load: the board lets the weight
/// down, the step says so, and its repetition goes through.
#[test]
fn a_silent_link_in_the_middle_of_a_lift_is_named() {
    let old = SettingsValues::reference();
    let silence_ticks = 1 + u32::from(PLAY_SILENCE_TICKS);
    for (repairs, found) in [
        (false, Some((Step::Lift, vec![Cause::Interrupted]))),
        (true, None),
    ] {
        let world = World::new(Wiring::Right);
        let ended = commission_in(world, old, &Step::ALL, (&[], repairs), |board| {
            board.silence = Some((2e-3, silence_ticks));
        });
        assert_eq!(ended.found, found, "{}", ended.told);
        assert_eq!(ended.complete, repairs, "{}", ended.told);
        assert!(ended.told.contains(Cause::Interrupted.words()));
        assert!(ended.moved_m < MOVED_M_MAX, "{} m", ended.moved_m);
    }
}

/// Each step can be repeated: once what it has found is corrected, the session goes on with it, and
/// ends as that of the right rig.
#[test]
fn a_corrected_rig_is_commissioned() {
    let old = SettingsValues::reference();
    for rig in &MISWIRED {
        let ended = commission_by(rig.wiring, old, &Step::ALL, (&[], true));
        assert!(ended.complete, "{}: {}", rig.words, ended.told);
        assert!(ended.told.contains(rig.cause.words()), "{}", rig.words);
        let scales = |values: &SettingsValues| {
            [
                values.bridge.per_count,
                values.pressure_sensor.per_count,
                values.encoder_m_per_count,
                values.valve_drive.amplifier_gain,
            ]
        };
        for (found, truth) in scales(&ended.values).into_iter().zip(scales(&old)) {
            assert_near(rig.words, found.into(), truth.into(), 3e-3);
        }
        assert!(ended.moved_m < MOVED_M_MAX, "{}", rig.words);
    }
}

#[test]
fn wrong_settings_are_found_by_the_slow_lift() {
    let old = SettingsValues::reference();
    let drive = old.valve_drive;
    let amplifier = |factor: f32| SettingsValues {
        valve_drive: ValveDrive {
            amplifier_gain: drive.amplifier_gain * factor,
            ..drive
        },
        pressure_pa_max: old.pressure_pa_max * factor.min(1.0),
        ..old
    };
    let encoder = |factor: f32| SettingsValues {
        encoder_m_per_count: old.encoder_m_per_count * factor,
        ..old
    };
    let load = |load_kg: f32| SettingsValues { load_kg, ..old };
    let sensor = |factor: f32| SettingsValues {
        pressure_sensor: AdcScale {
            per_count: old.pressure_sensor.per_count * factor,
            ..old.pressure_sensor
        },
        ..old
    };
    for (stored, cause) in [
        (old, None),
        (load(6.0), Some(Cause::LoadHeavier)),
        (load(24.0), Some(Cause::LoadLighter)),
        (encoder(0.5), Some(Cause::Travel)),
        (encoder(2.0), Some(Cause::Travel)),
        (encoder(-1.0), Some(Cause::EncoderSwapped)),
        (amplifier(0.7), Some(Cause::AmplifierGain)),
        (amplifier(1.0 / 0.7), Some(Cause::AmplifierGain)),
        (sensor(1.4), Some(Cause::PressureScale)),
        (sensor(0.83), Some(Cause::PressureScale)),
    ] {
        let ended = commission(Wiring::Right, stored, &Step::CHECK, &[]);
        let expected = cause.map(|cause| (Step::Lift, vec![cause]));
        assert_eq!(ended.found, expected, "{}", ended.told);
        assert!(
            ended.moved_m < MOVED_M_MAX,
            "{cause:?}: {} m",
            ended.moved_m
        );
        assert_eq!(ended.stored, stored);
    }
}

/// What a person accepts is what the settings say then.
#[test]
fn accepted_differences_are_in_the_settings() {
    let old = SettingsValues::reference();
    let accept = [("finding", "a")];
    let ended = commission(Wiring::EncoderSwapped, old, &Step::ALL, &accept);
    assert!(ended.complete, "{}", ended.told);
    let scale = f64::from(ended.values.encoder_m_per_count);
    assert_near("encoder", scale, -12.5e-6, 1e-3);
    let ended = commission(Wiring::BridgeInverted, old, &Step::ALL, &accept);
    assert_near(
        "bridge",
        ended.values.bridge.per_count.into(),
        -50.0 / 4096.0,
        2e-3,
    );
    let ended = commission(Wiring::Amplifier, old, &Step::ALL, &accept);
    assert!(ended.complete, "{}", ended.told);
    let gain = f64::from(ended.values.valve_drive.amplifier_gain);
    assert_near("amplifier", gain, 0.7 * 10.0 / 3.3, 5e-3);
    let settings = Settings::new(ended.values).expect("valid settings");
    // The DAC's full scale is now 350 kPa.
    assert!(settings.values().pressure_pa_max < 3.55e5);
}

#[test]
fn an_interrupt_lets_the_weight_down_and_restores_the_settings() {
    let world = Arc::new(Mutex::new(World::new(Wiring::Right)));
    let old = SettingsValues::reference();
    let mut board = InMemory::new(Arc::clone(&world), old);
    let stop = Arc::new(AtomicBool::new(false));
    board.interrupt = Some((1e-3, Arc::clone(&stop)));
    let log = board.log();
    let mut client = Client::new(board, Duration::from_secs(5), stop);
    let mut person = Someone {
        world: Arc::clone(&world),
        told: String::new(),
        repairs: false,
        answers: Vec::new(),
    };
    let mut session = Session::new(&mut client, &mut person, &template(), false).expect("a board");
    let ended = session.run(&Step::ALL);
    assert!(
        matches!(ended, Err(Error::Link(LinkError::Stopped))),
        "{ended:?}"
    );
    let world = world.lock().expect("the world");
    assert!(
        world.moved_m > 1e-3 && world.travel_m() < 1e-5,
        "{}",
        world.travel_m()
    );
    assert_eq!(log.lock().expect("the log").settings, old);
}

/// Each effect of the catalogue, which a good rig may have, at its typical size.
#[test]
fn effects_that_a_good_rig_may_have_raise_no_alarm() {
    let old = SettingsValues::reference();
    for kind in Catalogue::standard().kinds() {
        let mut world = World::new(Wiring::Right);
        let effect = Effect::typical(kind, &kind.forms[0]);
        world.rig.effects.push(effect);
        let ended = commission_in(world, old, &Step::ALL, (&[], false), |_| {});
        assert_eq!(ended.found, None, "{}: {}", kind.name, ended.told);
        assert!(ended.moved_m < MOVED_M_MAX, "{}", kind.name);
    }
}

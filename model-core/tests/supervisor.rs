//! The supervisor over all of its abstract inputs: each status of each sensor, each request, each
//! finding, and both sides of each limit, in each mode.
//!
//! Assumed: a limit is only compared with, so that its two sides stand for all numbers;
//! contraction, and the pressure that an experiment asks for, decide nothing.

use model_core::io::Request;
use model_core::limits::PLAY_SILENCE_TICKS;
use model_core::plausibility::{Doubt, SensorStatus};
use model_core::settings::SettingsValues;
use model_core::supervisor::{Decision, Fault, Findings, Mode, decide};
use std::collections::{BTreeMap, BTreeSet};

const STATUSES: [SensorStatus; 5] = [
    SensorStatus::Good,
    SensorStatus::Suspect,
    SensorStatus::Failed(Doubt::Range),
    SensorStatus::Failed(Doubt::Step),
    SensorStatus::Failed(Doubt::Stuck),
];
const REQUESTS: [Request; 8] = [
    Request::None,
    Request::Assist,
    Request::Hold,
    Request::Vent,
    Request::Reset,
    Request::Play(100_000),
    Request::Stop,
    Request::StopContactsDiffer,
];
/// Findings that are true or false, and settings that allow experiments or do not.
const FLAGS: u32 = 17;
/// Inputs in a mode.
const INPUTS: usize = STATUSES.len().pow(3) * REQUESTS.len() * (1 << FLAGS);

/// Calls `check` with all inputs of the supervisor in a mode.
fn for_all(mut check: impl FnMut(&SettingsValues, &Findings)) -> usize {
    let mut inputs = 0;
    for flags in 0..1_u32 << FLAGS {
        let is = |flag: u32| flags & (1 << flag) != 0;
        let values = SettingsValues {
            play_pressure_pa_max: if is(0) { 4e5 } else { 0.0 },
            ..SettingsValues::reference()
        };
        let beyond = |flag: u32, limit: u16| if is(flag) { limit } else { limit - 1 };
        for [bridge, pressure, encoder] in statuses() {
            for request in REQUESTS {
                inputs += 1;
                let findings = Findings {
                    bridge,
                    pressure,
                    encoder,
                    contraction: 0.1,
                    request,
                    vented: is(1),
                    unready: is(2).then_some(Fault::NotStill),
                    mode_ticks: beyond(3, values.self_check_ticks_max),
                    window_ticks: beyond(4, values.self_check_ticks),
                    silent_ticks: beyond(5, PLAY_SILENCE_TICKS.into()) as u8,
                    awaits_reading: is(6),
                    latched: is(7),
                    memory_damaged: is(8),
                    over_pressure: is(9),
                    over_contraction: is(10),
                    ticks_missed: is(11),
                    uncommanded: is(12),
                    pressure_astray: is(13),
                    too_fast: is(14),
                    force_astray: is(15),
                    voltage_astray: is(16),
                };
                check(&values, &findings);
            }
        }
    }
    inputs
}

fn statuses() -> impl Iterator<Item = [SensorStatus; 3]> {
    STATUSES.into_iter().flat_map(|bridge| {
        STATUSES.into_iter().flat_map(move |pressure| {
            let encoders = STATUSES.into_iter();
            encoders.map(move |encoder| [bridge, pressure, encoder])
        })
    })
}

/// Whether `fault` was found.
fn is_found(fault: Fault, mode: Mode, findings: &Findings) -> bool {
    let moves = matches!(mode, Mode::Assisting | Mode::Holding | Mode::Playing);
    match fault {
        Fault::Bridge(doubt) => findings.bridge == SensorStatus::Failed(doubt),
        Fault::Pressure(doubt) => findings.pressure == SensorStatus::Failed(doubt),
        Fault::Encoder(doubt) => findings.encoder == SensorStatus::Failed(doubt),
        Fault::OverPressure => findings.over_pressure,
        Fault::OverContraction => findings.over_contraction,
        Fault::MissedTicks => findings.ticks_missed,
        Fault::Uncommanded => findings.uncommanded,
        Fault::PressureControl => findings.pressure_astray,
        Fault::ValveVoltage => findings.voltage_astray,
        Fault::ForceBalance => findings.force_astray,
        Fault::OverSpeed => findings.too_fast,
        Fault::Memory => findings.memory_damaged,
        Fault::EmergencyStop => moves && findings.request == Request::Stop,
        Fault::StopContactsDiffer => findings.request == Request::StopContactsDiffer,
        // These are reasons of a self-check that does not end.
        Fault::LoadedLever | Fault::NotVented | Fault::NotStill => false,
        // The device has these.
        Fault::Start(_) => false,
    }
}

/// What must hold of a decision, and what led to it if it was another mode.
fn checked(mode: Mode, findings: &Findings, decision: Decision) -> Option<(Mode, &'static str)> {
    let mut faults = Fault::NAMED.iter().map(|(fault, _)| *fault);
    let fails = !findings.latched && faults.any(|fault| is_found(fault, mode, findings));
    let statuses = [findings.bridge, findings.pressure, findings.encoder];
    let suspect = statuses.contains(&SensorStatus::Suspect);
    let failed = statuses
        .iter()
        .any(|s| matches!(s, SensorStatus::Failed(_)));
    if fails {
        let Decision::Fail(fault) = decision else {
            panic!("{mode:?}, {findings:?}: {decision:?} in spite of a fault");
        };
        assert!(is_found(fault, mode, findings), "{findings:?}: {fault:?}");
        return Some((Mode::Venting, "a fault"));
    }
    if findings.request == Request::Vent && mode != Mode::Venting {
        assert_eq!(decision, Decision::Go(Mode::Venting));
    }
    match decision {
        Decision::Stay => None,
        Decision::AwaitReading => {
            assert!(mode == Mode::Assisting && suspect);
            Some((Mode::Holding, "a suspect reading"))
        }
        Decision::Fail(fault) => {
            // The self-check has taken too long.
            assert_eq!((mode, Some(fault)), (Mode::SelfCheck, findings.unready));
            Some((Mode::Venting, "a fault"))
        }
        Decision::Go(next) => {
            let moves = matches!(next, Mode::Assisting | Mode::Playing);
            // Nothing begins to move on a reading that is not good, or without being ready.
            assert!(!(moves && suspect), "{findings:?}: {decision:?}");
            assert!(!(moves && failed && !findings.latched));
            assert!(!(moves && mode == Mode::Ready && findings.unready.is_some()));
            assert!(next != Mode::Playing || matches!(findings.request, Request::Play(_)));
            if mode == Mode::Venting {
                assert!(next == Mode::SelfCheck && findings.vented);
            }
            let why = match (findings.request, mode, next) {
                (Request::Vent, _, Mode::Venting) => "Vent",
                (_, Mode::Playing, Mode::Venting) => "half a second without Play",
                (_, Mode::SelfCheck, Mode::Ready) => "passed",
                (_, Mode::Holding, Mode::Assisting) if findings.awaits_reading => {
                    "the reading is good again"
                }
                (Request::Assist, _, Mode::Assisting) => "Assist",
                (Request::Play(_), Mode::Ready, Mode::Playing) => "Play, if settings allow it",
                (Request::Hold, _, Mode::Holding) => "Hold",
                (Request::Reset, Mode::Venting, Mode::SelfCheck) => "Reset, vented",
                _ => panic!("{mode:?}, {findings:?}: {decision:?} without a reason"),
            };
            Some((next, why))
        }
    }
}

/// All decisions hold, and what docs/safety.md draws is what the supervisor does.
#[test]
fn every_decision_holds_and_the_modes_are_as_drawn() {
    let begun = std::time::Instant::now();
    let modes: Vec<Mode> = Mode::NAMED.iter().map(|(mode, _)| *mode).collect();
    let found: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = modes
            .into_iter()
            .map(|mode| {
                scope.spawn(move || {
                    let mut ways: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
                    let mut checks = 0;
                    let inputs = for_all(|values, findings| {
                        // A fault is latched while venting only: its beginning enters that mode,
                        // and its reset is the only way out.
                        let decision = decide(values, mode, findings);
                        if findings.latched && mode != Mode::Venting {
                            return;
                        }
                        checks += 1;
                        if let Some((next, why)) = checked(mode, findings, decision)
                            && next != mode
                        {
                            ways.entry(next.name()).or_default().insert(why);
                        }
                    });
                    assert_eq!(inputs, INPUTS);
                    (mode.name(), ways, checks)
                })
            })
            .collect();
        threads
            .into_iter()
            .map(|thread| thread.join().expect("it ends"))
            .collect()
    });
    // What the page says is checked, and called.
    let checks: usize = found.iter().map(|(.., checks)| checks).sum();
    assert_eq!((checks, found.len() * INPUTS), (458_752_000, 786_432_000));
    println!(
        "{checks} decisions checked in {:.1} s",
        begun.elapsed().as_secs_f64()
    );
    let mut drawn = String::from("```mermaid\nstateDiagram-v2\n    [*] --> SelfCheck\n");
    for (mode, ways, _) in found {
        for (next, reasons) in ways {
            let reasons: Vec<&str> = reasons.into_iter().collect();
            drawn += &format!("    {mode} --> {next}: {}\n", reasons.join("; "));
        }
    }
    drawn += "```\n";
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/safety.md");
    let page = std::fs::read_to_string(page).expect("the repository's page");
    assert!(
        page.contains(&drawn),
        "docs/safety.md does not draw\n{drawn}"
    );
}

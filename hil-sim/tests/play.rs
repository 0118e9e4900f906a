//! Playing of test signals: the requests of the player, and the pressures that the controller
//! commands until the muscle is vented.

use hil_sim::bench::board_settings::from_rig_and_board;
use hil_sim::bench::closed_loop::{Run, run_in_process};
use hil_sim::bench::person::CHECKED_S;
use hil_sim::bench::player::{End, Player};
use hil_sim::bench::test_signal::{Limits, Part, test_signal};
use hil_sim::bench::tick;
use hil_sim::bench::tick::Tick;
use hil_sim::identify::simulate::simulate;
use hil_sim::record::{PRESSURE_PA, PRESSURE_REF_PA, Record, VALVE_OPEN};
use hil_sim::rig::Rig;
use model_core::controller::Controller;
use model_core::io::{Output, Request};
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use model_core::supervisor::{Fault, Mode};
use muscle_plant::simulation::TOLERANCE;

fn record(text: &str) -> Record {
    Record::parse("exp.csv", text.as_bytes()).expect("a record")
}

fn output(mode: Mode, pressure_ref_pa: f32) -> Output {
    Output {
        mode,
        pressure_ref: GaugePa(pressure_ref_pa),
        ..Output::default()
    }
}

/// A player of 0, 100 and 0 kPa, from 5 s on, that has started at tick 100.
fn started_player() -> Player {
    let text = "time_s,pressure_ref_pa,valve_open\n5,0,1\n5.02,1e5,0\n5.04,,1\n5.05,0,1\n";
    let mut player = Player::new(&record(text)).expect("a drive");
    assert_eq!(player.pressure_pa_max(), 1e5);
    assert_eq!(
        player.request(90, &output(Mode::SelfCheck, 0.0)),
        Request::None
    );
    assert_eq!(
        player.request(99, &output(Mode::Ready, 0.0)),
        Request::Play(0)
    );
    player
}

#[test]
fn each_row_is_requested_at_its_time_and_then_the_muscle_is_vented() {
    let mut player = started_player();
    let playing = Output {
        pressure: GaugePa(4.12346e4),
        ..output(Mode::Playing, 0.0)
    };
    let requests: Vec<Request> = (100..106)
        .map(|tick| player.request(tick, &playing))
        .collect();
    let play = |kpa: u32| Request::Play(1000 * kpa);
    assert_eq!(
        requests,
        [
            play(0),
            // The shut-off valve is shut: within 40 kPa of the pressure.
            Request::Play(81_235),
            Request::Play(81_235),
            Request::Play(81_235),
            Request::Play(1_235),
            Request::Vent
        ]
    );
    let shut: Vec<bool> = (100..106).map(|tick| player.is_shut(tick)).collect();
    assert_eq!(shut, [false, false, true, true, false, false]);
    assert_eq!(player.end(), None);
    player.request(106, &output(Mode::Venting, 10.0));
    assert_eq!(player.end(), None, "not vented yet");
    player.request(107, &output(Mode::Venting, 0.0));
    assert_eq!(player.end(), Some(End::Played));
}

#[test]
fn ticks_that_were_not_received_count_as_played() {
    let mut player = started_player();
    player.request(100, &output(Mode::Playing, 0.0));
    assert_eq!(
        player.request(104, &output(Mode::Playing, 0.0)),
        Request::Play(0)
    );
}

#[test]
fn an_early_end_has_its_reason() {
    let ends = |outputs: &[Output]| {
        let mut player = started_player();
        for (tick, output) in (100..).zip(outputs) {
            player.request(tick, output);
        }
        player.end()
    };
    let playing = output(Mode::Playing, 1.0);
    let vented = output(Mode::Venting, 0.0);
    let failed = Output {
        fault: Some(Fault::OverPressure),
        ..vented
    };
    assert_eq!(ends(&[playing, vented]), Some(End::Vented));
    assert_eq!(
        ends(&[playing, failed]),
        Some(End::Failed(Fault::OverPressure))
    );
    assert_eq!(ends(&[vented]), Some(End::Refused(Mode::Venting)));
    let self_check = output(Mode::SelfCheck, 0.0);
    assert_eq!(
        ends(&[playing, self_check]),
        Some(End::Refused(Mode::SelfCheck))
    );
    assert_eq!(
        ends(&[output(Mode::Ready, 0.0); 501]),
        Some(End::Refused(Mode::Ready))
    );
}

#[test]
fn a_negative_pressure_is_refused() {
    let drive = record("time_s,pressure_ref_pa\n0,0\n1,-5\n");
    let error = Player::new(&drive)
        .expect_err("a negative pressure")
        .to_string();
    assert_eq!(
        error,
        "exp.csv:3: column `pressure_ref_pa`: expected a gauge pressure from 0, found -5"
    );
}

/// A leaking rig plays the holds with the shut-off valve shut, without a fault. A simulation
/// follows its record only with the leak and with the recorded state of the shut-off valve.
#[test]
fn a_leak_behind_the_shut_off_valve_is_recorded_and_simulated() {
    let leak = "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 1e-10\n";
    let text = format!("{}{leak}", Rig::REFERENCE_TOML);
    let leaking = Rig::parse("rig.toml", &text).expect("a rig");
    let limits = Limits::of(&leaking, 0.3).expect("limits");
    let drive = test_signal(&limits, &[Part::ShutHolds]).record;
    let (settings, ticks) = played(&leaking, &drive, 0.0);
    let recorded = tick::record(&settings, &ticks);
    let shut = recorded.shut();
    let count = |rows: &[bool]| rows.iter().filter(|shut| **shut).count();
    assert_eq!(count(&shut), count(&drive.shut()));

    // Mean absolute error while the shut-off valve is shut.
    let error_pa = |rig: &Rig, record: &Record| {
        let simulated = simulate(rig, record, TOLERANCE).expect("a simulation");
        let of = |record: &Record| record.column(PRESSURE_PA).expect("the column").to_vec();
        let (simulated_pa, measured_pa) = (of(&simulated), of(record));
        let rows = (0..shut.len()).filter(|row| shut[*row]);
        let errors_pa = rows.map(|row| (simulated_pa[row] - measured_pa[row]).abs());
        errors_pa.sum::<f64>() / count(&shut) as f64
    };
    let noise_pa = Run::PAPER.pressure_noise_pa;
    let tight = Rig::reference();
    // Stick-slip occurs slightly earlier or later than recorded: twice the noise.
    let followed_pa = error_pa(&leaking, &recorded);
    assert!(followed_pa < 2.0 * noise_pa, "{followed_pa}");
    let tight_pa = error_pa(&tight, &recorded);
    assert!(tight_pa > 20.0 * noise_pa, "{tight_pa}");
    let mut open = recorded.clone();
    open.remove(VALVE_OPEN);
    let open_pa = error_pa(&leaking, &open);
    assert!(open_pa > 20.0 * noise_pa, "{open_pa}");
}

#[test]
fn valve_open_is_either_1_or_0() {
    let drive = record("time_s,pressure_ref_pa,valve_open\n0,0,\n1,0,0\n2,0,\n3,0,1\n");
    assert_eq!(drive.shut(), [false, true, true, false]);
    let text = "time_s,pressure_ref_pa,valve_open\n0,0,1\n1,0,0.5\n";
    let error = Record::parse("exp.csv", text.as_bytes()).expect_err("half open");
    assert_eq!(
        error.to_string(),
        "exp.csv:3: column `valve_open`: expected 1 (open) or 0 (shut), found 0.5"
    );
}

/// The shut-off valve is operated late, a leak has emptied the muscle, and the pressure sensor has
/// a gain error: the reference does not drift away, and the weight is not thrown when the shut-off
/// valve opens.
#[test]
fn a_shut_off_valve_that_is_operated_late_causes_no_fault() {
    for leak in [
        "",
        "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 1e-9\n",
    ] {
        for error in [-0.03, 0.03] {
            let sensor =
                format!("[[effect]]\nname = \"pressure-sensor-gain\"\ngain_error = {error}\n");
            let text = format!("{}{leak}{sensor}", Rig::REFERENCE_TOML);
            let rig = Rig::parse("rig.toml", &text).expect("a rig");
            let limits = Limits::of(&rig, 0.3).expect("limits");
            let drive = test_signal(&limits, &[Part::ShutHolds]).record;
            let (_, ticks) = played(&rig, &drive, 2.0);
            let highest = ticks
                .iter()
                .map(|tick| tick.contraction)
                .fold(0.0, f64::max);
            // The limit of 0.3, and the contraction due to the gain error of 3 %.
            assert!(highest < 0.32, "{highest}");
        }
    }
}

/// Plays a test signal on `rig` with the board's controller and a person who operates the shut-off
/// valve late by `shutoff_delay_s`.
fn played(rig: &Rig, drive: &Record, shutoff_delay_s: f64) -> (Settings, Vec<Tick>) {
    let player = Player::new(drive).expect("a drive");
    let board = SettingsValues {
        play_pressure_pa_max: player.pressure_pa_max(),
        ..SettingsValues::reference()
    };
    let settings = from_rig_and_board(rig, &board).expect("settings");
    let played = Run {
        arm_stiffness_n_per_m: 0.0,
        shutoff_delay_s,
        duration_s: CHECKED_S + player.length_s() + 1.0,
        play: Some(player),
        ..Run::PAPER
    };
    let mut controller = Controller::new(settings);
    let ticks =
        run_in_process(rig, &settings, &played, |sensors| controller.tick(sensors)).expect("a run");
    let last = ticks.last().expect("ticks").output;
    assert_eq!(
        (last.mode, last.fault, last.pressure_ref.0),
        (Mode::Venting, None, 0.0)
    );
    (settings, ticks)
}

/// The default test signal on the paper's rig: the board's controller plays it without a fault, and
/// the valve receives the pressures of the file.
#[test]
fn the_controller_plays_the_default_test_signal_without_a_fault() {
    let rig = Rig::reference();
    let limits = Limits::of(&rig, 0.3).expect("limits");
    let drive = test_signal(&limits, &Part::DEFAULT).record;
    let (_, ticks) = played(&rig, &drive, 0.0);
    let begin = ticks
        .iter()
        .position(|tick| tick.output.mode == Mode::Playing)
        .expect("it plays");
    let requested_pa = drive.column(PRESSURE_REF_PA).expect("the column");
    let count_pa = 5e5 / 4095.0;
    let mut misses = 0;
    for (tick, requested_pa) in ticks[begin..].iter().zip(requested_pa) {
        let error_pa = (tick.valve_reference.0 - requested_pa).abs();
        misses += usize::from(error_pa > count_pa);
    }
    // Both have the same rate limit; a noisy reading near the limit of travel may delay the
    // reference.
    assert!(
        misses < requested_pa.len() / 1000,
        "{misses} of {}",
        requested_pa.len()
    );
}

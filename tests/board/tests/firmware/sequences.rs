//! Sequences of faults and of what persons do (`hil-sim/tests/sequences`) on the release firmware,
//! compared with the same cases on the PC.

#[path = "../../../../hil-sim/tests/sequences/body.rs"]
mod body;
#[path = "../../../../hil-sim/tests/sequences/case.rs"]
#[allow(dead_code, reason = "the sequences' own tests use the rest")]
mod case;
#[path = "../../../../hil-sim/tests/sequences/event.rs"]
#[allow(dead_code, reason = "the sequences' own tests use the rest")]
mod event;
#[path = "../../../../hil-sim/tests/sequences/plant.rs"]
mod plant;

use crate::faults::OnBoard;
use case::{Case, Outcome, Unit};
use event::What;
use hil_sim::faults::unit::{DeviceOutput, Stored, frame};
use model_core::controller::Controller;
use model_core::device::{Command, Pins};
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::supervisor::Fault;

/// Count of cases on each kind of rig; the environment variable SEQUENCES overrides it.
const CASES: u64 = 40;
/// Difference of speed \[m/s\] between board and PC that the board's DAC and the time of its first
/// tick explain.
const SPEED_M_PER_S: f64 = 0.03;

impl Unit for OnBoard {
    fn tick(&mut self, pins: &Pins, missed_ticks: u8, request: Request) -> DeviceOutput {
        let command = ToDevice::Command(Command::Request(request));
        let bytes = if request == Request::None {
            Vec::new()
        } else {
            frame(&command)
        };
        hil_sim::faults::unit::Unit::tick(self, pins, missed_ticks, 0.0, &bytes)
    }

    fn skip(&mut self) {
        hil_sim::faults::unit::Unit::skip(self);
    }

    /// The campaign flips bits of the board.
    fn flip(&mut self, _: usize, _: usize) {}
}

/// What must be the same on board and PC: the reason, and the bounds that are violated.
fn verdict(case: &Case, outcome: &Outcome) -> (Option<Fault>, Vec<&'static str>) {
    (outcome.fault, outcome.violations(case))
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn sequences_end_on_the_board_as_they_do_on_the_pc() {
    let cases = std::env::var("SEQUENCES").map_or(CASES, |n| n.parse().expect("a number"));
    let (mut compared, mut latched, mut differing) = (0, 0, Vec::new());
    // On the reference rig, and on others.
    let draws = [Case::new, Case::on_another_rig];
    let drawn = (0..cases).flat_map(|seed| draws.map(|draw| draw(seed)));
    for case in drawn {
        let seed = case.seed;
        let flips = |what| matches!(what, What::Flip(_));
        if case.events.iter().any(|event| flips(event.what)) {
            continue;
        }
        let settings = case.settings();
        let mut board = OnBoard::new(Some(Stored::new(settings.values()).sectors));
        let on_board = case.run_on(&mut board, &settings);
        board.rig.assert_no_errors();
        let on_pc = case.run(Controller::new(settings), &settings);
        let speeds_m_per_s = [
            on_board.up_m_per_s - on_pc.up_m_per_s,
            on_board.down_m_per_s - on_pc.down_m_per_s,
        ];
        let is_slow = |m_per_s: &f64| m_per_s.abs() < SPEED_M_PER_S || m_per_s.is_nan();
        let is_same = verdict(&case, &on_board) == verdict(&case, &on_pc);
        // The tick of a core that is stopped stays pending and runs late: of ticks that halt the
        // board misses fewer than the PC, and its ramp is faster.
        let misses = |what| matches!(what, What::TicksHalting(_) | What::TicksMissed(_));
        let is_in_time = !case.events.iter().any(|event| misses(event.what));
        if !is_same || is_in_time && !speeds_m_per_s.iter().all(is_slow) {
            differing.push((seed, on_board, on_pc));
        }
        compared += 1;
        latched += u32::from(on_pc.fault.is_some());
    }
    println!(
        "{compared} of {} cases compared, {latched} with a reason",
        2 * cases
    );
    assert!(differing.is_empty(), "{differing:#?}");
    assert!(compared > 0 && latched > 0);
}

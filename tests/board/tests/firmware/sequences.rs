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
use event::{Event, What};
use hil_sim::faults::unit::{DeviceOutput, Stored, frame};
use model_core::controller::Controller;
use model_core::device::{Command, Pins};
use model_core::io::Request;
use model_core::link::ToDevice;
use model_core::supervisor::Fault;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

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

/// Count of lifts while bits of the stack flip; the environment variable STACK_LIFTS overrides it.
const STACK_LIFTS: u64 = 8;
/// A bit flips every 0.4 s \[ticks\], from the beginning of the lift on.
const BETWEEN_FLIPS_TICKS: u32 = 40;
const FIRST_FLIP_TICK: u32 = 130;
/// Time of a tick on the emulated board, at most \[ns\].
const TICK_BUSY_NS: u64 = 90_000;

/// A board of which bits of the stack in use flip, every second one while it executes a tick, the
/// others at any moment.
struct WithFlips {
    board: OnBoard,
    ticks: u32,
    flips: usize,
    /// Bytes of the stack that were in use when the core was busy, for each flip.
    busy_bytes: Rc<RefCell<Vec<u32>>>,
    random: Pcg64Mcg,
}

impl WithFlips {
    /// A flip in the tick that comes next.
    fn flip(&mut self) {
        let within_ns = [TICK_BUSY_NS, 5_000_000][self.flips % 2];
        let after_ns = self.random.random_range(0..within_ns);
        let any_bit: u64 = self.random.random();
        self.flips += 1;
        let busy_bytes = Rc::clone(&self.busy_bytes);
        self.board.in_tick = Some(Box::new(move |rig| {
            rig.board.run_for(after_ns);
            let end = rig.board.symbol("_stack_start").expect("the stack");
            let begin = rig.board.sp();
            if begin >= end {
                return;
            }
            if !rig.board.is_asleep() {
                busy_bytes.borrow_mut().push(end - begin);
            }
            let bit = any_bit % (8 * u64::from(end - begin));
            let address = begin + (bit / 8) as u32;
            if let [byte] = rig.board.read_memory(address, 1)[..] {
                rig.board.write_ram(address, &[byte ^ 1 << (bit % 8)]);
            }
        }));
    }
}

impl Unit for WithFlips {
    fn tick(&mut self, pins: &Pins, missed_ticks: u8, request: Request) -> DeviceOutput {
        self.ticks += 1;
        let is_lifted = self.ticks >= FIRST_FLIP_TICK;
        if is_lifted && self.ticks.is_multiple_of(BETWEEN_FLIPS_TICKS) {
            self.flip();
        }
        Unit::tick(&mut self.board, pins, missed_ticks, request)
    }

    fn skip(&mut self) {
        Unit::skip(&mut self.board);
    }

    fn flip(&mut self, _: usize, _: usize) {}
}

/// A person lifts, lowers and lets go, on a rig with or without the valve in the port.
fn lift(seed: u64, random: &mut Pcg64Mcg) -> Case {
    let from_s = f64::from(random.random_range(300..600)) / 100.0;
    let lets_go = Event {
        what: What::LetsGo,
        during_s: from_s..10.0,
    };
    let mut case = Case::with(hil_sim::rig::Rig::reference(), vec![lets_go], seed);
    case.enabling = random.random_bool(0.5);
    case.port = seed.is_multiple_of(2);
    case
}

/// A flip of the stack may do anything that the program can. Where the program resets, the valve
/// is at 0 V, as after any reset: the weight falls unless the port has its valve.
#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn bits_of_the_stack_in_use_may_flip() {
    let lifts = std::env::var("STACK_LIFTS").map_or(STACK_LIFTS, |n| n.parse().expect("a number"));
    let (mut ends, mut violated, mut flips) = (BTreeMap::new(), Vec::new(), 0);
    let busy_bytes = Rc::new(RefCell::new(Vec::new()));
    let mut fastest_m_per_s = [[0.0_f64; 2]; 2];
    for seed in 0..lifts {
        let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x57ac);
        let case = lift(seed, &mut random);
        let settings = case.settings();
        let mut unit = WithFlips {
            board: OnBoard::new(Some(Stored::new(settings.values()).sectors)),
            ticks: 0,
            flips: 0,
            busy_bytes: Rc::clone(&busy_bytes),
            random,
        };
        let mut outcome = case.run_on(&mut unit, &settings);
        let resets = unit.board.rig.board.resets().len();
        outcome.needs_hardware = resets > 0 && !case.port;
        let end = match (resets, outcome.fault) {
            (0, None) => "no fault".to_string(),
            (0, Some(fault)) => fault.to_string(),
            _ => "reset".to_string(),
        };
        *ends.entry(end.clone()).or_insert(0) += 1;
        flips += unit.flips;
        let [up, down] = &mut fastest_m_per_s[usize::from(case.port)];
        (*up, *down) = (up.max(outcome.up_m_per_s), down.max(outcome.down_m_per_s));
        let violations = outcome.violations(&case);
        if !violations.is_empty() {
            violated.push((seed, end, violations, outcome));
        }
    }
    let busy_bytes = busy_bytes.take();
    println!(
        "{flips} flips in the stack in use, {} of them while the core is busy with up to {:?} \
         bytes in use, in {lifts} lifts, which end with {ends:?}",
        busy_bytes.len(),
        busy_bytes.iter().max()
    );
    // Most of the ticks that are hit are not over yet.
    assert!(4 * busy_bytes.len() > flips);
    println!("fastest up, down without and with the port's valve: {fastest_m_per_s:.2?} m/s");
    assert!(violated.is_empty(), "{violated:#?}");
}

//! Commissioning of the right rig and of wrong ones with the firmware: the world of hil-sim's own
//! test is at the pins, the DAC's voltage at the valve's amplifier.

#[path = "../../../../hil-sim/tests/commission/world.rs"]
pub mod world;

use crate::rig::{BRIDGE, BUTTON, LAMP, PRESSURE, Rig as Wired, STOP, volts};
use hil_sim::bench::person::ButtonHolder;
use hil_sim::bench::port::client::{Client, Transport, TransportError};
use hil_sim::commission::cause::{Cause, Step};
use hil_sim::commission::session::Session;
use hil_sim::rig::Rig;
use model_core::settings::SettingsValues;
use model_core::signal::{COUNT_MAX, DacCount};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use world::{MISWIRED, Someone, Wiring, World};

const PERIOD_NS: u64 = 10_000_000;
/// How far air may move the weight \[m\].
const MOVED_M_MAX: f64 = 0.01;

/// The emulated board in a world.
pub struct Emulated {
    hand: ButtonHolder,
    /// The board.
    pub wired: Wired,
    world: Arc<Mutex<World>>,
    next_ns: u64,
}

impl Emulated {
    /// A board that starts.
    pub fn new(world: Arc<Mutex<World>>) -> Emulated {
        let mut wired = Wired::new();
        if world.lock().unwrap().start_fault().is_some() {
            wired.board.load_valve(Some(0.8));
        }
        let mut emulated = Emulated {
            hand: ButtonHolder::default(),
            wired,
            world,
            next_ns: 0,
        };
        emulated.pass();
        emulated
    }

    /// The world's next period begins.
    fn pass(&mut self) {
        let board = &mut self.wired.board;
        self.next_ns += PERIOD_NS;
        let count = board.dac_volts(1) / 3.3 * f64::from(COUNT_MAX);
        let valve = DacCount::new(count.round() as u16);
        let pressed = self.hand.presses(board.level(LAMP) == Some(true));
        board.set_level(BUTTON, Some(!pressed));
        let inputs = self.world.lock().unwrap().pass(valve);
        board.set_analog(BRIDGE, volts(inputs.bridge));
        board.set_analog(PRESSURE, volts(inputs.pressure));
        board.set_encoder(inputs.encoder.into());
        for (contact, open) in STOP.into_iter().zip(inputs.stop_open) {
            board.set_level(contact, Some(!open));
        }
    }
}

impl Transport for Emulated {
    fn send(&mut self, bytes: &[u8]) -> Result<(), TransportError> {
        self.wired.board.link_send(bytes);
        Ok(())
    }

    fn receive(
        &mut self,
        received: &mut Vec<u8>,
        wait: Duration,
    ) -> Result<Duration, TransportError> {
        let begin_ns = self.wired.board.time_ns();
        let end_ns = begin_ns + wait.as_nanos() as u64;
        let frame_ends = |received: &[u8]| received.contains(&0);
        while !frame_ends(received) && self.wired.board.time_ns() < end_ns {
            // Telemetry comes in the first milliseconds after a tick.
            let step_ns = end_ns
                .min(self.next_ns)
                .min(self.wired.board.time_ns() + 1_000_000);
            self.wired.board.run_until(step_ns);
            if self.wired.board.time_ns() >= self.next_ns {
                self.pass();
            }
            let bytes = self.wired.board.link_receive();
            received.extend(bytes.iter().map(|received| received.byte));
        }
        let passed_ns = self.wired.board.time_ns() - begin_ns;
        Ok(Duration::from_nanos(passed_ns.max(1)))
    }
}

struct Ended {
    found: Vec<(Step, Vec<Cause>)>,
    complete: bool,
    values: SettingsValues,
    stored: SettingsValues,
    moved_m: f64,
    told: String,
}

fn commission(wiring: Wiring) -> Ended {
    let world = Arc::new(Mutex::new(World::new(wiring)));
    let board = Emulated::new(Arc::clone(&world));
    let stop = Arc::new(AtomicBool::new(false));
    let mut client = Client::new(board, Duration::from_secs(5), stop);
    let mut person = Someone {
        world: Arc::clone(&world),
        told: String::new(),
        repairs: false,
        answers: Vec::new(),
    };
    let rig = Rig::parse("rig.toml", &Rig::template()).expect("a rig");
    let mut session = Session::new(&mut client, &mut person, &rig, false).expect("a board");
    let complete = session.run(&Step::ALL).expect("answers");
    let values = session.values;
    let wrong = session.seen.iter().filter(|seen| !seen.causes.is_empty());
    let found = wrong.map(|seen| (seen.step, seen.causes.clone())).collect();
    Ended {
        found,
        complete,
        values,
        stored: client.settings().expect("the board answers"),
        moved_m: world.lock().unwrap().moved_m,
        told: person.told,
    }
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn the_right_rig_is_commissioned_on_the_board() {
    let ended = commission(Wiring::Right);
    assert!(ended.complete, "{}", ended.told);
    assert_eq!(ended.found, []);
    let old = SettingsValues::reference();
    assert_eq!(ended.stored, old);
    let gains = [ended.values, old].map(|values| values.valve_drive.amplifier_gain);
    assert!((gains[0] / gains[1] - 1.0).abs() < 5e-3, "{gains:?}");
}

#[test]
#[ignore = "needs FIRMWARE, the ELF of the firmware"]
fn each_wrong_rig_is_named_on_the_board_and_moves_by_less_than_10_mm() {
    for rig in &MISWIRED {
        let ended = commission(rig.wiring);
        let (told, moved_m) = (&ended.told, ended.moved_m);
        let expected = vec![(rig.step, vec![rig.cause])];
        assert_eq!(ended.found, expected, "{}: {told}", rig.words);
        assert!(moved_m < MOVED_M_MAX, "{}: {moved_m} m", rig.words);
        assert!(!ended.complete);
        assert_eq!(ended.stored, SettingsValues::reference(), "{}", rig.words);
    }
}

//! The state of the controller between ticks, protected from flipped bits.

use crate::compensation::CompensationState;
use crate::consistency::{ForceBalance, PressureFollower};
use crate::number::Number;
use crate::plausibility::{BadTickCount, SensorMonitor};
use crate::retreat::Retreat;
use crate::settings::{ENCODED_LEN_MAX, Settings, SettingsValues};
use crate::signal::{DacCount, EncoderCount};
use crate::supervisor::{Decision, Fault, Mode};
use crate::voted::{PLAIN, Voted};
use serde::{Deserialize, Serialize};

/// The state of the controller between ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The mode.
    pub mode: Mode,
    /// Ticks in this mode; the count saturates.
    pub mode_ticks: u16,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Ticks for which the valve has been vented; the count saturates.
    pub empty_ticks: u16,
    /// The valve in the muscle's port is open; see [`State::apply`].
    pub port_open: bool,
    /// P_r \[Pa\] as commanded by the last tick.
    pub pressure_ref_pa: f32,
    /// The same as the valve's DAC was set to it.
    pub valve: DacCount,
    /// Ticks in which the valve's voltage was not the one of the tick before.
    pub voltage: BadTickCount,
    /// The reference has met the assist law: from then on it may move fast.
    pub engaged: bool,
    /// Holding only until a suspect reading is good again.
    pub awaits_reading: bool,
    /// The bridge's reading without a finger \[N\].
    pub tare_n: f32,
    /// The encoder's count at the stop, ε = 0.
    pub home: EncoderCount,
    /// Undisturbed ticks of the self-check, and the sum of the bridge's readings \[N\] over them.
    pub window_ticks: u16,
    /// See `window_ticks`.
    pub window_sum_n: f32,
    /// The encoder's count when it last moved by more than flicker, and the pressure \[Pa\]: as
    /// read, and limited to what a sound valve makes.
    pub moved_to: EncoderCount,
    /// See `moved_to`.
    pub moved_at_pa: f32,
    /// See `moved_to`.
    pub moved_at_valve_pa: f32,
    /// P_r \[Pa\] that an experiment requested last, and ticks since then (the count saturates).
    pub played_pa: f32,
    /// See `played_pa`.
    pub silent_ticks: u8,
    /// Ticks that were missed.
    pub missed: BadTickCount,
    /// Ticks in which the muscle had pressure, or had lifted, without a request.
    pub uncommanded: BadTickCount,
    /// Monitor of the strain-gauge bridge \[N\].
    pub bridge: SensorMonitor,
    /// Monitor of the pressure sensor \[Pa\].
    pub pressure: SensorMonitor,
    /// Monitor of the encoder \[m\], from home.
    pub encoder: SensorMonitor,
    /// Compares the pressure with its reference.
    pub follower: PressureFollower,
    /// Compares the muscle's force with the weight's.
    pub balance: ForceBalance,
    /// The retreat from what carries the weight.
    pub retreat: Retreat,
    /// State of the compensation.
    pub compensation: CompensationState,
}

impl State {
    /// Carries out `decision`: begins another mode, or counts one more tick of this one.
    ///
    /// A valve in the muscle's port that is closed by a spring keeps the air in the muscle, and so
    /// the weight where it is. It is open from a passed self-check on, and until the muscle is
    /// empty again. After a reset it stays closed: what the muscle then contains is unknown, and
    /// with the valve at its exhaust it would drop the weight. It closes at once if the pressure
    /// does not obey the valve, or the valve's voltage the controller.
    pub fn apply(&mut self, values: &SettingsValues, decision: Decision) {
        match decision {
            Decision::Stay => self.mode_ticks = self.mode_ticks.saturating_add(1),
            Decision::Go(mode) => self.enter(values, mode),
            Decision::AwaitReading => {
                self.enter(values, Mode::Holding);
                self.awaits_reading = true;
            }
            Decision::Fail(fault) => {
                self.fault = Some(fault);
                if matches!(
                    fault,
                    Fault::PressureControl | Fault::Uncommanded | Fault::ValveVoltage
                ) {
                    self.port_open = false;
                }
                if self.mode != Mode::Venting {
                    self.enter(values, Mode::Venting);
                }
            }
        }
    }

    /// Begins `mode`.
    fn enter(&mut self, values: &SettingsValues, mode: Mode) {
        match (self.mode, mode) {
            (Mode::SelfCheck, Mode::Ready) => {
                self.port_open = true;
                self.tare_n = self.window_sum_n / self.window_ticks.max(1) as f32;
            }
            // From the measured pressure on, slowly until the assist law is met.
            (Mode::Ready, Mode::Assisting) => {
                self.pressure_ref_pa = self.pressure.value();
                self.engaged = false;
            }
            // After a requested hold the assist law may be far away; after a suspect reading not.
            (Mode::Holding, Mode::Assisting) => {
                self.engaged = self.engaged && self.awaits_reading;
            }
            // As after power-on.
            (_, Mode::SelfCheck) => *self = State::default(),
            _ => {}
        }
        self.awaits_reading = false;
        self.compensation.restart_lead();
        self.mode = mode;
        self.mode_ticks = 0;
        self.pressure_ref_pa = limited_pa(values, self.pressure_ref_pa);
    }
}

/// A reference within its limits; zero for NaN.
pub(crate) fn limited_pa(values: &SettingsValues, pressure_pa: f32) -> f32 {
    within_pa(pressure_pa, values.pressure_pa_max)
}

/// A pressure from zero to `most_pa`; zero for NaN.
#[inline]
pub(crate) fn within_pa<T: Number>(pressure_pa: T, most_pa: T) -> T {
    if pressure_pa.is_nan() {
        T::zero()
    } else {
        pressure_pa.at_least(T::zero()).at_most(most_pa)
    }
}

/// Words of the settings, and of the state at most.
const SETTINGS_WORDS: usize = 49;
/// See [`SETTINGS_WORDS`].
const STATE_WORDS: usize = 68;

/// Settings and state, each in several copies: flipped bits are outvoted and detected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Memory {
    /// Values of settings that were valid when they were stored here.
    pub settings: Voted<SettingsValues, SETTINGS_WORDS>,
    /// What [`checksum`] makes of these settings, to tell them where the copies do not.
    checksum: u32,
    /// The state after the last tick.
    pub state: Voted<State, STATE_WORDS>,
}

/// The content of [`Memory`], as a tick reads it.
#[derive(Clone, Copy, Debug)]
pub struct Recalled {
    /// The settings' values.
    pub values: SettingsValues,
    /// The state after the last tick.
    pub state: State,
    /// A copy differed from the others.
    pub damaged: bool,
}

impl Memory {
    /// A memory with these settings and the state at power-on.
    pub fn new(settings: Settings) -> Memory {
        Memory {
            settings: Voted::new(*settings.values()),
            checksum: checksum(settings.values()),
            state: Voted::new(State::default()),
        }
    }

    /// Settings and state, as the copies tell. Where they do not, nothing is known and the state is
    /// that of a controller that vents, from the pressure that the muscle has; with the settings
    /// that have the checksum.
    pub fn recall(&self) -> Recalled {
        let (settings, settings_damaged) = self.settings.recall();
        let (state, state_damaged) = self.state.recall();
        let is_known = settings.is_some();
        let venting = || State {
            mode: Mode::Venting,
            ..State::default()
        };
        let mended = || mended(self.settings.plain(), self.checksum);
        // As memory that was overwritten has none, those of the documented electronics.
        let valid = || {
            let mut copies = self.settings.plain().iter();
            copies.find_map(|values| Settings::new(*values).ok())
        };
        Recalled {
            values: settings
                .copied()
                .or_else(mended)
                .or_else(|| valid().map(|settings| *settings.values()))
                .unwrap_or(SettingsValues::reference()),
            state: state.filter(|_| is_known).copied().unwrap_or_else(venting),
            damaged: settings_damaged || state_damaged,
        }
    }

    /// Writes what is to be known in the next tick; `recalled` repairs what was damaged.
    pub fn store(&mut self, recalled: &Recalled, state: State) {
        // They change in no tick: only damage asks for writing them.
        if recalled.damaged {
            self.settings.set(recalled.values);
        }
        self.state.set(state);
    }

    /// Returns to the state at power-on, with the same settings; with a fault that stays latched
    /// to that after venting.
    pub fn restart(&mut self, latched: Option<Fault>) {
        let mode = latched.map_or(Mode::default(), |_| Mode::Venting);
        self.state.set(State {
            mode,
            fault: latched,
            ..State::default()
        });
    }
}

/// The settings that have this checksum: a copy, or what most copies agree on bit by bit.
#[inline(never)]
fn mended(copies: &[SettingsValues; PLAIN], sum: u32) -> Option<SettingsValues> {
    let is_right = |values: &&SettingsValues| checksum(values) == sum;
    if let Some(values) = copies.iter().find(is_right) {
        return Some(*values);
    }
    let mut encoded = [[0; ENCODED_LEN_MAX]; PLAIN];
    for (values, buffer) in copies.iter().zip(&mut encoded) {
        postcard::to_slice(values, buffer).ok()?;
    }
    // Bits that are set in at least one and two copies.
    let mut set = [[0; ENCODED_LEN_MAX]; 2];
    let [one, two] = &mut set;
    for copy in &encoded {
        for ((one, two), byte) in one.iter_mut().zip(two.iter_mut()).zip(copy) {
            *two |= *one & byte;
            *one |= byte;
        }
    }
    let (values, _) = postcard::take_from_bytes(two).ok()?;
    Some(values).filter(|values| is_right(&values))
}

/// FNV-1a (Fowler, Noll, Vo: draft-eastlake-fnv) of encoded settings. Each step is invertible, so
/// that no change of a single byte leaves it as it is.
#[inline(never)]
fn checksum(values: &SettingsValues) -> u32 {
    let mut buffer = [0; ENCODED_LEN_MAX];
    // They fit.
    let encoded = postcard::to_slice(values, &mut buffer).unwrap_or_default();
    let step = |sum: u32, byte: &u8| (sum ^ u32::from(*byte)).wrapping_mul(0x0100_0193);
    encoded.iter().fold(0x811C_9DC5, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::LIMITS;
    use crate::plausibility::Doubt;
    use crate::pressure::GaugePa;
    use crate::voted::tests::words;

    fn assisting() -> Memory {
        let settings = Settings::new(SettingsValues::reference()).unwrap();
        let mut memory = Memory::new(settings);
        let state = State {
            mode: Mode::Assisting,
            pressure_ref_pa: 2e5,
            ..State::default()
        };
        memory.state.set(state);
        memory
    }

    #[test]
    fn a_flipped_copy_is_outvoted_and_told() {
        let intact = assisting();
        assert!(!intact.recall().damaged);
        let (mut ready, mut other) = (*intact.state.get(), *intact.settings.get());
        (ready.mode, other.gain) = (Mode::Ready, 1e3);
        for copy in 0..=PLAIN {
            let mut memory = intact;
            match memory.state.plain_mut().get_mut(copy) {
                Some(state) => *state = ready,
                None => memory.state.set_inverted(&ready),
            }
            match memory.settings.plain_mut().get_mut(copy) {
                Some(values) => *values = other,
                None => memory.settings.set_inverted(&other),
            }
            let recalled = memory.recall();
            assert_eq!(recalled.state, *intact.state.get());
            assert_eq!(recalled.values, *intact.settings.get());
            assert!(recalled.damaged);
        }
    }

    /// The same bits in two copies of the state, and other ones in all.
    #[test]
    fn a_state_of_which_nothing_is_known_is_that_of_a_controller_that_vents() {
        let venting = State {
            mode: Mode::Venting,
            ..State::default()
        };
        for pressures_pa in [[4e5, 4e5, 2e5], [2e5, 4e5, 4e5], [1e5, 3e5, 4e5]] {
            let mut memory = assisting();
            for (state, pressure_pa) in memory.state.plain_mut().iter_mut().zip(pressures_pa) {
                state.pressure_ref_pa = pressure_pa;
            }
            let recalled = memory.recall();
            assert_eq!((recalled.state, recalled.damaged), (venting, true));
        }
    }

    /// The same bit in two or three copies of the settings, and another in each.
    #[test]
    fn settings_are_told_by_their_checksum() {
        let intact = assisting();
        for damaged in [2, 3] {
            let mut memory = intact;
            for values in memory.settings.plain_mut().iter_mut().take(damaged) {
                values.gain = 1e3;
            }
            let recalled = memory.recall();
            assert!(recalled.damaged);
            // Three that agree are believed.
            let is_right = recalled.values == *intact.settings.get();
            assert_eq!(is_right, damaged == 2);
        }
        let mut memory = intact;
        let [a, b, c] = memory.settings.plain_mut();
        (a.gain, b.load_kg, c.suspect_ticks) = (-20.0, -1.0, 2);
        let recalled = memory.recall();
        assert_eq!(recalled.values, *intact.settings.get());
        assert_eq!(
            (recalled.state.mode, recalled.damaged),
            (Mode::Venting, true)
        );
    }

    /// Each number has a word, with and without what may be there.
    #[test]
    fn inverted_copies_hold_all_words() {
        let memory = assisting();
        let settings = words(&memory.settings, memory.settings.get());
        assert_eq!(settings, (SETTINGS_WORDS, SETTINGS_WORDS));
        let mut most = State {
            fault: Some(Fault::Bridge(Doubt::Range)),
            ..State::default()
        };
        for tick in 0..3 {
            let pressure = GaugePa(1e5 + tick as f32);
            most.balance = most.balance.next(memory.settings.get(), 0.1, pressure.0, 1);
            let compensation = &memory.settings.get().compensation;
            _ = most.compensation.pressure_pa(compensation, 1e5, pressure);
        }
        assert_eq!(words(&memory.state, &most), (STATE_WORDS, STATE_WORDS));
        // Reason and doubt, two readings of three numbers each, and the law's pressure.
        let (least, _) = words(&memory.state, &State::default());
        assert_eq!(STATE_WORDS - least, 2 + 2 * 3 + 1);
    }

    /// Nothing is known then: the muscle is vented from the pressure that it has, with settings
    /// that are valid.
    #[test]
    fn memory_that_was_overwritten_is_believed_nowhere() {
        let erased = Memory::new(Settings::new(SettingsValues::reference()).unwrap());
        let mut memory = assisting();
        *memory.state.plain_mut() = *erased.state.plain();
        *memory.state.inverted_mut() = [0; STATE_WORDS];
        let recalled = memory.recall();
        assert_eq!(
            (recalled.state.mode, recalled.damaged),
            (Mode::Venting, true)
        );
        assert_eq!(recalled.state.pressure_ref_pa, 0.0);
        let mut zeros = SettingsValues::reference();
        for limit in LIMITS {
            (limit.set)(&mut zeros, 0.0);
        }
        *memory.settings.plain_mut() = [zeros; PLAIN];
        *memory.settings.inverted_mut() = [0; SETTINGS_WORDS];
        let recalled = memory.recall();
        assert_eq!(recalled.values, SettingsValues::reference());
        assert_eq!(
            (recalled.state.mode, recalled.damaged),
            (Mode::Venting, true)
        );
    }
}

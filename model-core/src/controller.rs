//! One tick of the power assist: the page to read first.
//!
//! Sensors come in as counts, the valve's command goes out as counts, and everything between is
//! here: analyse the readings, decide the mode, then act. Settings are read-only, the state is
//! small and visible, and there is no other input: the same settings, state and sensors give the
//! same output, on the board and on the PC.
//!
//! The steps are public functions over plain values. The fault campaign of `hil-sim` composes them
//! into controllers that lack a safety function; this controller has all of them.
//!
//! Signs: forces lift, contraction shortens the muscle, pressure is gauge.

use crate::analysis::{ReadingLimits, analyse};
use crate::command::{Target, act};
use crate::io::{Output, Sensors};
use crate::settings::{Settings, SettingsValues};
use crate::state::{Memory, Recalled, State};
use crate::supervisor::{Findings, decide};

/// The controller: settings and state, each safe from a flipped bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controller {
    memory: Memory,
}

impl Controller {
    /// A controller that begins with its self-check.
    pub fn new(settings: Settings) -> Controller {
        Controller {
            memory: Memory::new(settings),
        }
    }

    /// One tick, to be called every 10 ms: reads `sensors`, returns the valve's command.
    ///
    /// Takes a bounded time without loops over data and never panics. For any input it commands a
    /// pressure between zero and the settings' limit. A missed tick is to be reported with the
    /// next one.
    pub fn tick(&mut self, sensors: &Sensors) -> Output {
        let recalled = self.memory.recall();
        let Recalled {
            values,
            state,
            damaged,
        } = &recalled;
        let limits = ReadingLimits::new(values);

        // Analyse: are the readings plausible, and consistent? Nothing here has an effect.
        let (mut state, findings) = analyse(values, &limits, state, sensors);
        let findings = Findings {
            memory_damaged: *damaged,
            ..findings
        };

        // Decide: which mode follows from the findings.
        let decision = decide(values, state.mode, &findings);

        // Act: the only thing that leaves is the valve's command.
        state.apply(values, decision);
        let target = Target::new(values, &mut state, findings.contraction);
        let output = act(values, &mut state, &target);
        self.memory.store(&recalled, state);
        output
    }

    /// The state after the last tick.
    pub fn state(&self) -> &State {
        self.memory.state.get()
    }

    /// The values of its settings.
    pub fn settings(&self) -> &SettingsValues {
        self.memory.settings.get()
    }
}

/// A controller in a [`Device`](crate::device::Device). The board's is [`Controller`].
pub trait Control {
    /// One tick: see [`Controller::tick`].
    fn tick(&mut self, sensors: &Sensors) -> Output;

    /// Settings and state.
    fn memory(&self) -> &Memory;

    /// Settings and state, to restart with; or to damage a copy, as the fault campaign does.
    fn memory_mut(&mut self) -> &mut Memory;
}

impl Control for Controller {
    fn tick(&mut self, sensors: &Sensors) -> Output {
        Controller::tick(self, sensors)
    }

    fn memory(&self) -> &Memory {
        &self.memory
    }

    fn memory_mut(&mut self) -> &mut Memory {
        &mut self.memory
    }
}

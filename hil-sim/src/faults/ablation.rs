//! Ablation: controllers without one of the safety functions, to show that it is needed.
//!
//! The board's controller cannot switch a safety function off. [`AblatedController`] composes the
//! same steps of model-core, and between two of them widens a limit or drops a finding.

use model_core::analysis::{ReadingLimits, analyse};
use model_core::command::{Target, act};
use model_core::controller::Control;
use model_core::io::{Output, Request, Sensors};
use model_core::settings::Settings;
use model_core::state::{Memory, Recalled, State};
use model_core::supervisor::{Findings, Mode, decide};

/// The safety functions, as listed in docs/safety.md. They prevent that a single fault hurts a
/// person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SafetyFunction {
    /// A reading at an end of its scale, or one that is physically impossible, is not used.
    SensorRange,
    /// A reading that jumps is not used.
    SensorStep,
    /// A reading that stays constant for too long is not used.
    SensorStuck,
    /// A pressure that does not follow its reference, or exceeds its trip level, is a fault.
    PressureWatch,
    /// A force that does not balance the load, or a contraction above the stroke, is a fault.
    WeightWatch,
    /// A weight that is faster than the trip level is a fault.
    SpeedTrip,
    /// The rate of the reference is limited to the permitted speed of the weight.
    ReferenceSpeed,
    /// The weight is lowered at a limited rate.
    VentRamp,
    /// Missed ticks are a fault.
    MissedTicks,
    /// Pressure or a lifted weight without a request is a fault.
    RestWatch,
    /// Assistance begins only if the muscle is vented and at rest and the lever is released.
    SelfCheck,
    /// A flipped bit is corrected by a majority of copies, and is a fault.
    MemoryVote,
    /// The emergency stop lets the weight down, and nothing begins while it is open.
    EmergencyStop,
    /// The reference puts no more energy into the weight than with which it may meet a limb.
    ContactEnergy,
    /// A weight that was let down on something, such as a foot, is lifted again.
    Retreat,
    /// A voltage of the valve, read back, that was not set is a fault.
    ReadBack,
}

impl SafetyFunction {
    /// All safety functions.
    pub const ALL: [SafetyFunction; 16] = [
        SafetyFunction::SensorRange,
        SafetyFunction::SensorStep,
        SafetyFunction::SensorStuck,
        SafetyFunction::PressureWatch,
        SafetyFunction::WeightWatch,
        SafetyFunction::SpeedTrip,
        SafetyFunction::ReferenceSpeed,
        SafetyFunction::VentRamp,
        SafetyFunction::MissedTicks,
        SafetyFunction::RestWatch,
        SafetyFunction::SelfCheck,
        SafetyFunction::MemoryVote,
        SafetyFunction::EmergencyStop,
        SafetyFunction::ContactEnergy,
        SafetyFunction::Retreat,
        SafetyFunction::ReadBack,
    ];

    /// The name on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            SafetyFunction::SensorRange => "SensorRange",
            SafetyFunction::SensorStep => "SensorStep",
            SafetyFunction::SensorStuck => "SensorStuck",
            SafetyFunction::PressureWatch => "PressureWatch",
            SafetyFunction::WeightWatch => "WeightWatch",
            SafetyFunction::SpeedTrip => "SpeedTrip",
            SafetyFunction::ReferenceSpeed => "ReferenceSpeed",
            SafetyFunction::VentRamp => "VentRamp",
            SafetyFunction::MissedTicks => "MissedTicks",
            SafetyFunction::RestWatch => "RestWatch",
            SafetyFunction::SelfCheck => "SelfCheck",
            SafetyFunction::MemoryVote => "MemoryVote",
            SafetyFunction::EmergencyStop => "EmergencyStop",
            SafetyFunction::ContactEnergy => "ContactEnergy",
            SafetyFunction::Retreat => "Retreat",
            SafetyFunction::ReadBack => "ReadBack",
        }
    }

    /// Whether it acts on a limb in the weight's way only, of which the campaign has none.
    pub fn needs_limb(self) -> bool {
        matches!(
            self,
            SafetyFunction::ContactEnergy | SafetyFunction::Retreat
        )
    }

    /// The safety function of that name, if any.
    pub fn from_name(name: &str) -> Option<SafetyFunction> {
        SafetyFunction::ALL
            .into_iter()
            .find(|function| function.name() == name)
    }
}

/// The board's controller without one safety function.
#[derive(Clone, Debug)]
pub struct AblatedController {
    memory: Memory,
    /// `None` only in the test that compares this composition with the board's controller.
    without: Option<SafetyFunction>,
}

impl AblatedController {
    /// A controller without `function`, before its self-check.
    pub fn new(settings: Settings, function: SafetyFunction) -> AblatedController {
        AblatedController {
            memory: Memory::new(settings),
            without: Some(function),
        }
    }

    /// Recalls the memory; without the majority vote from the first copy, damaged or not.
    fn recall(&self) -> Recalled {
        if self.without != Some(SafetyFunction::MemoryVote) {
            return self.memory.recall();
        }
        let ([values, ..], [state, ..]) = (self.memory.settings.plain(), self.memory.state.plain());
        Recalled {
            values: *values,
            state: *state,
            damaged: false,
        }
    }

    fn widen(&self, limits: &mut ReadingLimits) {
        match self.without {
            Some(SafetyFunction::SensorRange) => {
                limits.adc_valid = 0..=u16::MAX;
                limits.pressure_pa_min = f32::NEG_INFINITY;
                limits.travel_m_min = f32::NEG_INFINITY;
            }
            Some(SafetyFunction::SensorStep) => {
                limits.bridge_step_n_max = f32::INFINITY;
                limits.pressure_step_pa_max = f32::INFINITY;
                limits.encoder_step_m_max = f32::INFINITY;
            }
            Some(SafetyFunction::SensorStuck) => {
                limits.stuck_ticks = 0;
                limits.encoder_stuck_pa = f32::INFINITY;
                limits.encoder_held_n = f32::INFINITY;
            }
            _ => {}
        }
    }

    fn drop_findings(&self, mode: Mode, findings: &mut Findings) {
        match (self.without, mode) {
            (Some(SafetyFunction::PressureWatch), _) => {
                findings.over_pressure = false;
                findings.pressure_astray = false;
            }
            (Some(SafetyFunction::WeightWatch), _) => {
                findings.over_contraction = false;
                findings.force_astray = false;
            }
            (Some(SafetyFunction::SpeedTrip), _) => findings.too_fast = false,
            (Some(SafetyFunction::ReadBack), _) => findings.voltage_astray = false,
            (Some(SafetyFunction::MissedTicks), _) => findings.ticks_missed = false,
            (Some(SafetyFunction::EmergencyStop), _)
                if matches!(
                    findings.request,
                    Request::Stop | Request::StopContactsDiffer
                ) =>
            {
                findings.request = Request::None;
            }
            (Some(SafetyFunction::RestWatch), Mode::SelfCheck) => findings.uncommanded = false,
            (Some(SafetyFunction::RestWatch), _) => {
                findings.uncommanded = false;
                findings.unready = None;
            }
            (Some(SafetyFunction::SelfCheck), Mode::SelfCheck) => {
                findings.unready = None;
                findings.window_ticks = findings.mode_ticks;
            }
            _ => {}
        }
    }

    fn release(&self, state: &mut State, target: &mut Target) {
        match self.without {
            Some(SafetyFunction::WeightWatch) => target.may_only_fall = false,
            Some(SafetyFunction::ContactEnergy) => target.motion = None,
            Some(SafetyFunction::Retreat) => state.retreat.end(),
            Some(SafetyFunction::ReferenceSpeed) => {
                target.rate_pa_per_s_max = f32::MAX;
                target.fast_m_per_s = 0.0;
            }
            Some(SafetyFunction::VentRamp) if state.mode == Mode::Venting => {
                // Skips the ramp.
                state.pressure_ref_pa = 0.0;
            }
            _ => {}
        }
    }
}

impl Control for AblatedController {
    fn tick(&mut self, sensors: &Sensors) -> Output {
        let recalled = self.recall();
        let Recalled {
            values,
            state,
            damaged,
        } = &recalled;
        let mut limits = ReadingLimits::new(values);
        self.widen(&mut limits);
        let (mut state, mut findings) = analyse(values, &limits, state, sensors);
        findings.memory_damaged = *damaged;
        self.drop_findings(state.mode, &mut findings);
        let decision = decide(values, state.mode, &findings);
        state.apply(values, decision);
        let mut target = Target::new(values, &mut state, findings.contraction);
        self.release(&mut state, &mut target);
        let output = act(values, &mut state, &target);
        self.memory.store(&recalled, state);
        output
    }

    fn memory(&self) -> &Memory {
        &self.memory
    }

    fn memory_mut(&mut self) -> &mut Memory {
        &mut self.memory
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::Case;
    use crate::faults::kind::KINDS;
    use crate::faults::run::{run, settings};
    use crate::faults::unit::OnPc;
    use model_core::controller::Controller;

    fn outputs(case: &Case, settings: &Settings, controller: impl Control + Clone) -> Vec<Output> {
        let mut outputs = Vec::new();
        let mut unit = OnPc::new(controller);
        run(case, settings, &mut unit, |tick| outputs.push(tick.output)).expect("it runs");
        outputs
    }

    /// So the results without one function hold for the board's controller without it.
    #[test]
    fn composition_of_all_functions_equals_the_boards_controller() {
        for number in 0..KINDS.len() as u64 {
            let case = Case::new(4, number);
            let (settings, _) = settings(&case).expect("the reference rig fits a board");
            let complete = AblatedController {
                memory: Memory::new(settings),
                without: None,
            };
            let board = outputs(&case, &settings, Controller::new(settings));
            let composed = outputs(&case, &settings, complete);
            assert!(board == composed, "case {number}: {}", case.description());
        }
    }

    #[test]
    fn names_are_those_of_the_command_line() {
        let names = "SensorRange SensorStep SensorStuck PressureWatch WeightWatch SpeedTrip \
                     ReferenceSpeed VentRamp MissedTicks RestWatch SelfCheck MemoryVote \
                     EmergencyStop ContactEnergy Retreat ReadBack";
        assert!(
            names
                .split(' ')
                .eq(SafetyFunction::ALL.map(SafetyFunction::name))
        );
        for function in SafetyFunction::ALL {
            assert_eq!(SafetyFunction::from_name(function.name()), Some(function));
        }
        assert_eq!(SafetyFunction::from_name("sensorrange"), None);
    }
}

//! The safety functions by name, as docs/safety.md lists them; and switches that only tests have.

/// What keeps a single fault from hurting the person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SafetyFunction {
    /// A reading at an end of its scale, or beyond physics, is not used.
    SensorRange,
    /// A reading that jumps is not used.
    SensorStep,
    /// A reading that stands still although it must not is not used.
    SensorStuck,
    /// The pressure follows its reference, below its trip level.
    PressureWatch,
    /// Pressure, contraction and load are in balance, within the stroke.
    WeightWatch,
    /// The weight's speed has a trip level.
    SpeedTrip,
    /// The reference moves no faster than the weight may.
    ReferenceSpeed,
    /// The weight is let down at a limited rate.
    VentRamp,
    /// Ticks that did not happen are a fault.
    MissedTicks,
    /// A muscle that was not asked for has no pressure, and does not lift.
    RestWatch,
    /// Assistance begins on a muscle that is vented and still, with a lever that is let go.
    SelfCheck,
    /// A flipped bit is outvoted, and ends the assistance.
    MemoryVote,
}

impl SafetyFunction {
    /// All of them.
    pub const ALL: [SafetyFunction; 12] = [
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
    ];
}

/// All safety functions are on. Only with the feature `fault-injection`, which no firmware has, can
/// one be off, so that a test shows that it is needed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Switches {
    #[cfg(feature = "fault-injection")]
    off: Option<SafetyFunction>,
}

impl Switches {
    #[cfg(feature = "fault-injection")]
    pub(crate) fn without(function: SafetyFunction) -> Switches {
        Switches {
            off: Some(function),
        }
    }

    #[cfg(feature = "fault-injection")]
    pub(crate) fn on(self, function: SafetyFunction) -> bool {
        self.off != Some(function)
    }

    #[cfg(not(feature = "fault-injection"))]
    pub(crate) fn on(self, _: SafetyFunction) -> bool {
        true
    }
}

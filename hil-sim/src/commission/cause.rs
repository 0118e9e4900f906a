//! What is probably wrong with a rig, and what to do about it.

use model_core::start::StartFault;
use model_core::supervisor::Fault;

/// The steps of commissioning, in their order. No air is needed before [`Step::Valve`], and no
/// weight is on the air before [`Step::Lift`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Step {
    /// Start-up self-test, link, and the readings at rest.
    Start,
    /// Emergency stop and status lamp.
    Stop,
    /// Which channel moves, and which way.
    Wiring,
    /// Zero and gain of the strain-gauge bridge, by two weights.
    Bridge,
    /// Zero and gain of the pressure sensor, by a hand pump with a gauge.
    Pressure,
    /// Scale of the encoder, by a spacer.
    Encoder,
    /// First air, into the plugged hose: sign and curve of the valve, supply.
    Valve,
    /// Load mass, by a slow lift.
    Lift,
    /// Static friction, by slow triangles.
    Friction,
}

impl Step {
    /// All steps, in their order.
    pub const ALL: [Step; 9] = [
        Step::Start,
        Step::Stop,
        Step::Wiring,
        Step::Bridge,
        Step::Pressure,
        Step::Encoder,
        Step::Valve,
        Step::Lift,
        Step::Friction,
    ];
    /// The steps that check stored settings: the slow lift.
    pub const CHECK: [Step; 2] = [Step::Start, Step::Lift];

    /// Its heading.
    pub const fn heading(self) -> &'static str {
        match self {
            Step::Start => "start-up self-test and readings at rest",
            Step::Stop => "emergency stop and lamp",
            Step::Wiring => "wiring and signs",
            Step::Bridge => "bridge: zero and gain",
            Step::Pressure => "pressure sensor: two points",
            Step::Encoder => "encoder: scale",
            Step::Valve => "valve and supply, on the plugged hose",
            Step::Lift => "load: a slow lift",
            Step::Friction => "friction: slow triangles",
        }
    }
}

/// What is probably wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The start-up self-test has found something.
    StartTest(StartFault),
    /// The board has vented with this fault, which no estimator explains.
    Board(Fault),
    /// The board refuses the measured settings, or did not begin to play.
    Refused,
    /// The board has ended a play that was not over, without a fault.
    Interrupted,
    /// The bridge reads an end of its scale.
    BridgeOpen,
    /// The pressure sensor reads the lower end of its scale.
    PressureOpen,
    /// The pressure sensor reads the upper end of its scale.
    PressureHigh,
    /// A channel is much noisier than an intact one.
    Noisy,
    /// The bridge's signal is at the pressure input, and the other way round.
    BridgeAndPressureSwapped,
    /// The emergency stop reads pressed though it is not.
    StopOpen,
    /// The emergency stop is pressed and nothing happens.
    StopSilent,
    /// Only one contact of the emergency stop acts.
    StopContact,
    /// The lamp does not show its pattern.
    Lamp,
    /// The bridge does not react to the lever.
    BridgeSilent,
    /// The bridge falls where it should rise.
    BridgeInverted,
    /// No count comes from the encoder.
    EncoderSilent,
    /// The encoder goes to and fro by one count.
    EncoderOneChannel,
    /// The encoder counts down where it should count up.
    EncoderSwapped,
    /// The pressure reading is within its range and does not react.
    PressureSilent,
    /// The pressure reading falls where it should rise.
    PressureInverted,
    /// The bridge's gain is not the expected one.
    BridgeGain,
    /// Zero and two weights are not on a line.
    BridgeCurved,
    /// The bridge's zero is so far off that the scale does not hold the finger's force.
    BridgeZero,
    /// The pressure sensor has another zero.
    PressureZero,
    /// The pressure sensor has another range.
    PressureRange,
    /// The pressure does not stay in the hose.
    Leak,
    /// The encoder has another resolution.
    EncoderScale,
    /// The encoder does not come back to its count.
    EncoderLosesCounts,
    /// There is pressure at 0 V, and it falls as the voltage rises.
    ValveReversed,
    /// No pressure comes.
    NoAir,
    /// A pressure comes that does not depend on the voltage.
    ValveStuck,
    /// The pressure is proportional to its reference by another factor.
    AmplifierGain,
    /// The pressure ends below the supply that was entered.
    LowSupply,
    /// The weight moves while the hose should be plugged.
    HoseOnMuscle,
    /// The weight lifts at less pressure than it should.
    LoadLighter,
    /// The weight lifts at more pressure than it should.
    LoadHeavier,
    /// The weight does not lift.
    NotLifted,
    /// The travel does not fit the pressure.
    Travel,
    /// The muscle gets less pressure than the plugged hose did.
    MuscleLeak,
    /// Pressure and force differ from their settings by the same factor.
    PressureScale,
}

impl Cause {
    /// What is probably wrong, in words.
    pub const fn words(self) -> &'static str {
        match self {
            Cause::StartTest(_) => "the board itself, by its start-up self-test",
            Cause::Board(_) => "what the board's fault says",
            Cause::Refused => "the measured values: the board does not begin with them",
            Cause::Interrupted => {
                "the link: silent for half a second (cable, or a busy PC); or the board's button"
            }
            Cause::BridgeOpen => "a loose wire of the strain bridge, or its supply",
            Cause::PressureOpen => "a loose wire of the pressure sensor, or its supply",
            Cause::PressureHigh => "a 4–20 mA sensor at a voltage input, or a short to the supply",
            Cause::Noisy => "a floating input: a loose wire or a missing ground",
            Cause::BridgeAndPressureSwapped => "bridge and pressure sensor swapped",
            Cause::StopOpen => "a loose wire of the emergency stop, or it is pressed",
            Cause::StopSilent => "an emergency stop that is not connected (jumpers in its place)",
            Cause::StopContact => "one contact of the emergency stop, or its wire",
            Cause::Lamp => "the lamp, or its wire",
            Cause::BridgeSilent => "a strain bridge without excitation or with a loose gauge wire",
            Cause::BridgeInverted => "the strain bridge's signal wires swapped",
            Cause::EncoderSilent => "both encoder channels, or its supply",
            Cause::EncoderOneChannel => "a loose wire of one encoder channel",
            Cause::EncoderSwapped => "encoder channels swapped",
            Cause::PressureSilent => {
                "the pressure input on another output (DAC and monitor mixed up), or a hose apart"
            }
            Cause::PressureInverted => "the pressure sensor's wires, or one for vacuum",
            Cause::BridgeGain => "another bridge or amplifier gain, or a weight mistyped",
            Cause::BridgeCurved => "a weight mistyped, a lever that touches, a saturated amplifier",
            Cause::BridgeZero => "the bridge amplifier's zero",
            Cause::PressureZero => "a pressure sensor of another kind (4–20 mA at a resistor)",
            Cause::PressureRange => "a pressure sensor of another range",
            Cause::Leak => "a leaking fitting",
            Cause::EncoderScale => "an encoder of another resolution, or the spacer mistyped",
            Cause::EncoderLosesCounts => "an encoder that loses counts, or a slipping coupling",
            Cause::ValveReversed => {
                "the valve mounted the wrong way round (supply and exhaust), or stuck open"
            }
            Cause::NoAir => "no air, or the valve or its amplifier without voltage",
            Cause::ValveStuck => "a stuck valve, or a stuck DAC or amplifier",
            Cause::AmplifierGain => "the valve amplifier's gain",
            Cause::LowSupply => "the supply: its regulator or its hose",
            Cause::HoseOnMuscle => "the muscle is still on the hose",
            Cause::LoadLighter => "the mass: lighter than entered; or a stronger muscle",
            Cause::Travel => "the encoder's scale; or a muscle with much hysteresis",
            Cause::NotLifted => {
                "a blocked weight, a muscle off its hose, a shut port, or a dead encoder"
            }
            Cause::LoadHeavier => "the mass: heavier than entered; or a weaker muscle (dead band)",
            Cause::MuscleLeak => "a leaking fitting of the muscle",
            Cause::PressureScale => "the pressure sensor's scale (zero and gain)",
        }
    }

    /// What to do about it.
    pub fn remedy(self) -> &'static str {
        match self {
            Cause::StartTest(fault) => fault.help(),
            Cause::Board(_) => "see docs/wiring.md, «Status lamp», for what to look at",
            Cause::Refused => "repeat the steps before",
            Cause::Interrupted => {
                "check the cable, close other programs, leave the button; repeat this step"
            }
            Cause::BridgeOpen | Cause::BridgeSilent => {
                "measure 1.65 V at A5, 5 V at the bridge; check its four wires"
            }
            Cause::PressureOpen => "measure 0.33 V at A4 and 5 V at the sensor",
            Cause::PressureHigh => {
                "fit a resistor for the current (165 Ω at A4 in place of the divider), or a \
                 voltage sensor; then calibrate it here"
            }
            Cause::Noisy => "connect all grounds at the board; shield the bridge's cable",
            Cause::BridgeAndPressureSwapped => "exchange the wires at A4 and A5",
            Cause::StopOpen => "close it; measure 3.3 V at D6 and D7",
            Cause::StopSilent => "connect its contacts to D6 and D7, without jumpers",
            Cause::StopContact => "each contact must open D6 or D7 by itself",
            Cause::Lamp => "LD2 is on the board (D13)",
            Cause::BridgeInverted => "exchange S+ and S−, or accept a negative `bridge.per_count`",
            Cause::EncoderSilent => "measure A and B at A0 and A1 while the weight moves",
            Cause::EncoderOneChannel => "measure A0 and A1: one of them does not change",
            Cause::EncoderSwapped => {
                "exchange A and B (A0, A1), or accept a negative `encoder_m_per_count`"
            }
            Cause::PressureSilent => "A4 must be on the pressure sensor, and the pump on its hose",
            Cause::PressureInverted => "check the sensor's type and its three wires",
            Cause::BridgeGain => "check the weights; accept if the bridge is another one",
            Cause::BridgeCurved => "check the weights and the lever's clearance",
            Cause::BridgeZero => "trim the amplifier to 1.65 V without a finger",
            Cause::PressureZero | Cause::PressureRange => {
                "check the sensor's type and the gauge's unit; accept if it is meant"
            }
            Cause::Leak => "soap the fittings between pump, sensor and hose",
            Cause::EncoderScale => "check its lines per mm and the spacer; accept if it is meant",
            Cause::EncoderLosesCounts => "check the coupling, and the reading head's distance",
            Cause::ValveReversed => "shut the supply; exchange ports 1 (supply) and 3 (exhaust)",
            Cause::NoAir => "check the supply's valve, 24 V, and 0–10 V at the valve's input",
            Cause::ValveStuck => "measure A2 and the valve's input while it plays",
            Cause::AmplifierGain => {
                "measure its gain (3.03); accept to store the measured `amplifier_gain`"
            }
            Cause::LowSupply => "set the regulator; accept to work with the measured supply",
            Cause::HoseOnMuscle => "take the hose off the muscle and plug it",
            Cause::LoadLighter | Cause::LoadHeavier => {
                "weigh the load (`load_kg`); if it is right accept, and find out what the muscle \
                 lacks by `hil-sim diagnose`"
            }
            Cause::NotLifted => "look whether the weight has moved, and repeat the encoder's step",
            Cause::Travel => "measure it with a spacer: commission without --check",
            Cause::MuscleLeak => "soap the fittings of the muscle and its port",
            Cause::PressureScale => "calibrate the pressure sensor: the step with the hand pump",
        }
    }

    /// Whether the device works if the measured value is accepted.
    pub const fn may_be_accepted(self) -> bool {
        matches!(
            self,
            Cause::StartTest(StartFault::BrownOut)
                | Cause::StopSilent
                | Cause::Lamp
                | Cause::BridgeInverted
                | Cause::EncoderSwapped
                | Cause::BridgeGain
                | Cause::PressureZero
                | Cause::PressureRange
                | Cause::EncoderScale
                | Cause::AmplifierGain
                | Cause::LowSupply
                | Cause::LoadLighter
                | Cause::LoadHeavier
        )
    }
}

//! The outcome of a case: the extremes of motion and pressure, and the violated bounds.

use super::bounds::Bounds;
use super::kind::{Inject, Latched};
use super::unit::DeviceOutput;
use super::{AFTER_S, Case, Moment};
use model_core::limits::{RETREAT_TICKS, STOP_CONTRACTION};
use model_core::supervisor::{Fault, Mode};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::Simulation;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use serde::{Serialize, Serializer};

/// Final interval in which the weight must be at rest \[s\].
pub(super) const END_S: f64 = 0.3;
/// Time of a retreat \[s\].
const RETREAT_S: f64 = 0.01 * RETREAT_TICKS as f64;
/// Highest speed that counts as rest \[m/s\]: a press may close at 10 mm/s beside a person, who can
/// withdraw in time (ISO 16092-3).
const REST_M_PER_S: f64 = 0.01;

/// The outcome of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Number of the case.
    pub case: u64,
    /// Name and size of the fault.
    pub fault: String,
    /// The phase in which the fault occurred.
    pub moment: Moment,
    /// Time of the fault \[s\].
    pub fault_s: f64,
    /// Time from the fault to a latched reason \[s\].
    pub latched_after_s: Option<f64>,
    /// Highest gauge pressure after the fault \[Pa\].
    pub pressure_pa_max: f64,
    /// Highest speed upwards after the fault \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Highest speed downwards after the fault \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Highest speed in the last 0.3 s \[m/s\].
    pub speed_m_per_s_final: f64,
    /// Highest position in the last 0.3 s \[m\].
    pub height_m_final: f64,
    /// Largest rise of the weight above its position at the fault \[m\].
    pub rise_m: f64,
    /// Largest fall of the weight below its position at the fault \[m\].
    pub fall_m: f64,
    /// Highest position of the weight after the fault \[m\].
    pub height_m_max: f64,
    /// The controller's last mode.
    #[serde(serialize_with = "serialize_name")]
    pub mode: Mode,
    /// The fault that the controller has latched.
    #[serde(serialize_with = "serialize_optional_name")]
    pub reason: Option<Fault>,
    /// The bounds of the case.
    pub bounds: Bounds,
    /// The violated bounds.
    #[serde(rename = "outside")]
    pub violations: Vec<&'static str>,
}

impl Outcome {
    /// Whether the weight or the pressure violates a bound, not only the latched reason.
    pub fn has_physical_violation(&self) -> bool {
        let physical = |bound: &&str| !bound.starts_with("reason") && *bound != "false alarm";
        self.violations.iter().any(physical)
    }
}

fn serialize_name<S: Serializer>(mode: &Mode, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(mode.name())
}

fn serialize_optional_name<S: Serializer>(
    fault: &Option<Fault>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match fault {
        None => serializer.serialize_none(),
        Some(fault) => serializer.serialize_str(fault.name()),
    }
}

/// Whether the controller can lower the weight: the valve follows its reference, and static
/// friction does not carry the load.
fn can_be_lowered(case: &Case) -> bool {
    match (case.kind.inject, &case.rig.nominal.load) {
        (Inject::Valve | Inject::Dac, _) => false,
        (Inject::Load, Load::Weight(weight)) => {
            let weight_n = case.size * weight.mass_kg * GRAVITY_M_PER_S2;
            weight_n > weight.static_friction_n
        }
        _ => true,
    }
}

/// Records the extremes of a case.
pub(super) struct CaseMonitor<'a> {
    case: &'a Case,
    outcome: Outcome,
    fault_occurred: bool,
    height_at_fault_m: f64,
    /// The last reference \[Pa\].
    reference_pa: f32,
    /// The reference has last risen while the controller vents, in a retreat \[s\].
    lifted_s: Option<f64>,
    /// The weight has come to its stop so long after the fault \[s\].
    stopped_after_s: Option<f64>,
    /// Assistance has begun after the fault and before the hand moves. Later the force of the hand
    /// can cancel the error of the gauge.
    assisting_after_fault: bool,
}

/// A bound, and whether the case violates it.
type Check = (&'static str, bool);

impl CaseMonitor<'_> {
    pub(super) fn new(case: &Case, bounds: Bounds) -> CaseMonitor<'_> {
        let outcome = Outcome {
            case: case.number,
            fault: case.description(),
            moment: case.moment,
            fault_s: case.fault_s,
            latched_after_s: None,
            pressure_pa_max: 0.0,
            speed_up_m_per_s_max: 0.0,
            speed_down_m_per_s_max: 0.0,
            speed_m_per_s_final: 0.0,
            height_m_final: 0.0,
            rise_m: 0.0,
            fall_m: 0.0,
            height_m_max: 0.0,
            mode: Mode::SelfCheck,
            reason: None,
            bounds,
            violations: Vec::new(),
        };
        CaseMonitor {
            case,
            outcome,
            fault_occurred: false,
            height_at_fault_m: 0.0,
            reference_pa: 0.0,
            lifted_s: None,
            stopped_after_s: None,
            assisting_after_fault: false,
        }
    }

    /// Records the state in which the fault occurs.
    pub(super) fn record_fault(&mut self, simulation: &Simulation) {
        self.fault_occurred = true;
        self.height_at_fault_m = self.height_m(simulation);
    }

    /// Time at which the case ends \[s\].
    pub(super) fn ends_s(&self) -> f64 {
        let latched_s = self.outcome.latched_after_s.unwrap_or(0.0) + self.case.fault_s;
        let ends_s = self.case.ends_s.max(latched_s + AFTER_S);
        let let_down_s = |lifted_s| lifted_s + RETREAT_S + AFTER_S;
        self.lifted_s
            .map_or(ends_s, |lifted_s| ends_s.max(let_down_s(lifted_s)))
    }

    fn height_m(&self, simulation: &Simulation) -> f64 {
        simulation.contraction() * self.case.rig.nominal.muscle.initial_length_m
    }

    /// Height up to which the weight is on its stop \[m\].
    fn stop_m(&self) -> f64 {
        f64::from(STOP_CONTRACTION) * self.case.rig.nominal.muscle.initial_length_m
    }

    /// Records the extremes of the plant's state after the fault.
    pub(super) fn record_state(&mut self, time_s: f64, simulation: &Simulation) {
        if !self.fault_occurred {
            return;
        }
        let (height_m, ends_s) = (self.height_m(simulation), self.ends_s());
        if self.stopped_after_s.is_none() && height_m < self.stop_m() {
            self.stopped_after_s = Some(time_s - self.case.fault_s);
        }
        let speed_m_per_s =
            simulation.contraction_rate_per_s() * self.case.rig.nominal.muscle.initial_length_m;
        let outcome = &mut self.outcome;
        let record = |maximum: &mut f64, value: f64| *maximum = maximum.max(value);
        record(&mut outcome.pressure_pa_max, simulation.pressure().0);
        record(&mut outcome.speed_up_m_per_s_max, speed_m_per_s);
        record(&mut outcome.speed_down_m_per_s_max, -speed_m_per_s);
        record(&mut outcome.height_m_max, height_m);
        record(&mut outcome.rise_m, height_m - self.height_at_fault_m);
        record(&mut outcome.fall_m, self.height_at_fault_m - height_m);
        if time_s > ends_s - END_S {
            record(&mut outcome.speed_m_per_s_final, speed_m_per_s.abs());
            record(&mut outcome.height_m_final, height_m);
        } else {
            // A reason that is latched later postpones the end.
            (outcome.speed_m_per_s_final, outcome.height_m_final) = (0.0, 0.0);
        }
    }

    /// Records the mode and the latched reason of the controller.
    pub(super) fn record_output(&mut self, time_s: f64, device: &DeviceOutput) {
        let begins = self.outcome.mode == Mode::Ready && device.output.mode == Mode::Assisting;
        let before_motion = time_s < self.case.finger.followed_s().start;
        self.assisting_after_fault |= begins && self.fault_occurred && before_motion;
        self.outcome.mode = device.output.mode;
        let reference_pa = device.output.pressure_ref.0;
        if self.outcome.mode == Mode::Venting && reference_pa > self.reference_pa {
            self.lifted_s = Some(time_s);
        }
        self.reference_pa = reference_pa;
        let outcome = &mut self.outcome;
        if device.output.fault.is_some() {
            outcome.reason = device.output.fault;
            if self.fault_occurred && outcome.latched_after_s.is_none() {
                outcome.latched_after_s = Some(time_s - self.case.fault_s);
            }
        }
    }

    /// The outcome, with the violated bounds; `device` is the last output of the device.
    pub(super) fn outcome(mut self, device: &DeviceOutput) -> Outcome {
        self.outcome.mode = device.output.mode;
        let checks = [
            self.check_motion(),
            self.check_final_state(),
            self.check_reason(),
        ]
        .concat();
        let violations = checks.into_iter().filter(|(_, is_violated)| *is_violated);
        self.outcome.violations = violations.map(|(name, _)| name).collect();
        self.outcome
    }

    fn check_motion(&self) -> Vec<Check> {
        let (outcome, bounds) = (&self.outcome, &self.outcome.bounds);
        vec![
            (
                "speed up",
                outcome.speed_up_m_per_s_max > bounds.speed_up_m_per_s,
            ),
            (
                "speed down",
                outcome.speed_down_m_per_s_max > bounds.speed_down_m_per_s,
            ),
            ("height", outcome.height_m_max > bounds.height_m),
            ("pressure", outcome.pressure_pa_max > bounds.pressure_pa),
        ]
    }

    /// If the controller has ended the assistance, or should have, the weight must be on its stop;
    /// in every case it must be at rest.
    fn check_final_state(&self) -> Vec<Check> {
        let (case, outcome) = (self.case, &self.outcome);
        let in_use = matches!(
            outcome.mode,
            Mode::Assisting | Mode::Holding | Mode::Playing
        );
        let ended = !in_use || self.required_reason().is_some();
        let must_not_start = match case.moment {
            Moment::Start => case.kind.bars_start,
            _ => self.required_reason().is_some(),
        };
        vec![
            (
                "not let down",
                ended && can_be_lowered(case) && outcome.height_m_final > self.stop_m(),
            ),
            ("not at rest", outcome.speed_m_per_s_final > REST_M_PER_S),
            ("begun", must_not_start && self.assisting_after_fault),
        ]
    }

    /// The reason that must be latched in this case.
    fn required_reason(&self) -> Option<Latched> {
        self.case.kind.latched.filter(|latched| {
            let within_s = (latched.within_s)(self.case.size);
            let stopped = self
                .stopped_after_s
                .is_some_and(|after_s| after_s < within_s);
            latched.moments.contains(&self.case.moment)
                && self.height_at_fault_m >= latched.above_m
                && !(latched.is_of_hanging() && stopped)
        })
    }

    fn check_reason(&self) -> Vec<Check> {
        let (outcome, required) = (&self.outcome, self.required_reason());
        let late = required.is_some_and(|required| {
            let after_s = outcome.latched_after_s;
            after_s.is_none_or(|after_s| after_s > (required.within_s)(self.case.size))
        });
        let wrong = required.is_some_and(|required| {
            let reason = outcome.reason;
            reason.is_some_and(|reason| !(required.is_right)(reason))
        });
        let is_healthy = self.case.kind.inject == Inject::Healthy;
        vec![
            ("reason late", late),
            ("reason wrong", wrong),
            ("false alarm", is_healthy && outcome.reason.is_some()),
        ]
    }
}

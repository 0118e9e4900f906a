//! What is measured of a case, and whether it is within its bounds.

use super::bounds::Bounds;
use super::kind::{Inject, Latched};
use super::unit::Told;
use super::{AFTER_S, Case, Moment};
use model_core::limits::STOP_CONTRACTION;
use model_core::supervisor::{Fault, Mode};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::Simulation;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use serde::{Serialize, Serializer};

/// Stretch at the end over which the weight must be at rest \[s\].
pub(super) const END_S: f64 = 0.3;
/// At rest: a press may close at 10 mm/s beside a person, as one can draw back (ISO 16092-3).
const REST_M_PER_S: f64 = 0.01;

/// What has become of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Its number.
    pub case: u64,
    /// The fault in words.
    pub fault: String,
    /// When it fell.
    pub moment: Moment,
    /// The same \[s\].
    pub fault_s: f64,
    /// From the fault to a latched reason \[s\].
    pub latched_after_s: Option<f64>,
    /// Highest pressure after the fault \[Pa\].
    pub pressure_pa_max: f64,
    /// Fastest upwards after the fault \[m/s\].
    pub speed_up_m_per_s_max: f64,
    /// Fastest downwards after the fault \[m/s\].
    pub speed_down_m_per_s_max: f64,
    /// Fastest in the last 0.3 s \[m/s\].
    pub speed_m_per_s_final: f64,
    /// Highest place in the same \[m\].
    pub height_m_final: f64,
    /// How far the weight rose above its place at the fault \[m\].
    pub rise_m: f64,
    /// How far it fell below it \[m\].
    pub fall_m: f64,
    /// Its highest place \[m\].
    pub height_m_max: f64,
    /// The controller's last mode.
    #[serde(serialize_with = "in_words")]
    pub mode: Mode,
    /// The reason that it has latched.
    #[serde(serialize_with = "maybe_in_words")]
    pub reason: Option<Fault>,
    /// What it must stay within.
    pub bounds: Bounds,
    /// What it is outside of.
    pub outside: Vec<&'static str>,
}

impl Outcome {
    /// The weight or the pressure is outside, not only what was recorded.
    pub fn has_moved(&self) -> bool {
        let physical = |bound: &&str| !bound.starts_with("reason") && *bound != "false alarm";
        self.outside.iter().any(physical)
    }
}

fn in_words<S: Serializer>(mode: &Mode, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(mode.name())
}

fn maybe_in_words<S: Serializer>(fault: &Option<Fault>, serializer: S) -> Result<S::Ok, S::Error> {
    match fault {
        None => serializer.serialize_none(),
        Some(fault) => serializer.serialize_str(fault.name()),
    }
}

/// The valve obeys, and friction does not hold up what is left of the load.
fn can_be_let_down(case: &Case) -> bool {
    match (case.kind.inject, &case.rig.nominal.load) {
        (Inject::Valve | Inject::Dac, _) => false,
        (Inject::Load, Load::Weight(weight)) => {
            let left_n = case.size * weight.mass_kg * GRAVITY_M_PER_S2;
            left_n > weight.static_friction_n
        }
        _ => true,
    }
}

/// Records the extremes of a case.
pub(super) struct CaseMonitor<'a> {
    case: &'a Case,
    outcome: Outcome,
    fallen: bool,
    begins_m: f64,
    /// Assistance has begun after the fault, before the hand moves: one that pulls as much as the
    /// gauge is off makes it whole again.
    begun_after: bool,
}

/// A bound, and whether the case is outside of it.
type Check = (&'static str, bool);

impl CaseMonitor<'_> {
    pub(super) fn new(case: &Case, bounds: Bounds) -> CaseMonitor<'_> {
        let outcome = Outcome {
            case: case.number,
            fault: case.words(),
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
            outside: Vec::new(),
        };
        CaseMonitor {
            case,
            outcome,
            fallen: false,
            begins_m: 0.0,
            begun_after: false,
        }
    }

    pub(super) fn begin(&mut self, simulation: &Simulation) {
        self.fallen = true;
        self.begins_m = self.height_m(simulation);
    }

    /// When the case ends \[s\].
    pub(super) fn ends_s(&self) -> f64 {
        let latched_s = self.outcome.latched_after_s.unwrap_or(0.0) + self.case.fault_s;
        self.case.ends_s.max(latched_s + AFTER_S)
    }

    fn height_m(&self, simulation: &Simulation) -> f64 {
        simulation.contraction() * self.case.rig.nominal.muscle.initial_length_m
    }

    pub(super) fn look(&mut self, time_s: f64, simulation: &Simulation) {
        if !self.fallen {
            return;
        }
        let (height_m, ends_s) = (self.height_m(simulation), self.ends_s());
        let speed_m_per_s =
            simulation.contraction_rate_per_s() * self.case.rig.nominal.muscle.initial_length_m;
        let outcome = &mut self.outcome;
        let most = |worst: &mut f64, value: f64| *worst = worst.max(value);
        most(&mut outcome.pressure_pa_max, simulation.pressure().0);
        most(&mut outcome.speed_up_m_per_s_max, speed_m_per_s);
        most(&mut outcome.speed_down_m_per_s_max, -speed_m_per_s);
        most(&mut outcome.height_m_max, height_m);
        most(&mut outcome.rise_m, height_m - self.begins_m);
        most(&mut outcome.fall_m, self.begins_m - height_m);
        if time_s > ends_s - END_S {
            most(&mut outcome.speed_m_per_s_final, speed_m_per_s.abs());
            most(&mut outcome.height_m_final, height_m);
        } else {
            // A reason may be latched after all.
            (outcome.speed_m_per_s_final, outcome.height_m_final) = (0.0, 0.0);
        }
    }

    pub(super) fn told(&mut self, time_s: f64, told: &Told) {
        let begins = self.outcome.mode == Mode::Ready && told.output.mode == Mode::Assisting;
        self.begun_after |= begins && self.fallen && time_s < self.case.finger.followed_s().start;
        self.outcome.mode = told.output.mode;
        let outcome = &mut self.outcome;
        if told.output.fault.is_some() {
            outcome.reason = told.output.fault;
            if self.fallen && outcome.latched_after_s.is_none() {
                outcome.latched_after_s = Some(time_s - self.case.fault_s);
            }
        }
    }

    pub(super) fn outcome(mut self, told: &Told) -> Outcome {
        self.outcome.mode = told.output.mode;
        let outside = [
            self.beyond_bounds(),
            self.not_safe_at_the_end(),
            self.misjudged(),
        ]
        .concat();
        let outside = outside.into_iter().filter(|(_, is_outside)| *is_outside);
        self.outcome.outside = outside.map(|(name, _)| name).collect();
        self.outcome
    }

    fn beyond_bounds(&self) -> Vec<Check> {
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

    /// Where the controller has ended, or must have, the weight is on its stop; and it is at rest
    /// whatever has happened.
    fn not_safe_at_the_end(&self) -> Vec<Check> {
        let (case, outcome) = (self.case, &self.outcome);
        let in_use = matches!(
            outcome.mode,
            Mode::Assisting | Mode::Holding | Mode::Playing
        );
        let ended = !in_use || self.must_latch().is_some();
        let stop_m = f64::from(STOP_CONTRACTION) * case.rig.nominal.muscle.initial_length_m;
        let barred = match case.moment {
            Moment::Start => case.kind.bars_start,
            _ => self.must_latch().is_some(),
        };
        vec![
            (
                "not let down",
                ended && can_be_let_down(case) && outcome.height_m_final > stop_m,
            ),
            ("not at rest", outcome.speed_m_per_s_final > REST_M_PER_S),
            ("begun", barred && self.begun_after),
        ]
    }

    fn must_latch(&self) -> Option<Latched> {
        self.case.kind.latched.filter(|latched| {
            latched.moments.contains(&self.case.moment) && self.begins_m >= latched.above_m
        })
    }

    fn misjudged(&self) -> Vec<Check> {
        let (outcome, must) = (&self.outcome, self.must_latch());
        let late = must.is_some_and(|must| {
            let after_s = outcome.latched_after_s;
            after_s.is_none_or(|after_s| after_s > (must.within_s)(self.case.size))
        });
        let wrong = must.is_some_and(|must| {
            let reason = outcome.reason;
            reason.is_some_and(|reason| !(must.is_right)(reason))
        });
        let is_healthy = self.case.kind.inject == Inject::Healthy;
        vec![
            ("reason late", late),
            ("reason wrong", wrong),
            ("false alarm", is_healthy && outcome.reason.is_some()),
        ]
    }
}

//! What is measured of a case, and whether it is within its bounds.

use super::bounds::Bounds;
use super::kind::{Inject, Kind};
use super::unit::Told;
use super::{Case, Moment};
use crate::plant::simulation::Simulation;
use model_core::supervisor::{Fault, Mode};
use serde::{Serialize, Serializer};

/// Stretch at the end over which the weight must be at rest \[s\].
const END_S: f64 = 0.3;

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

fn in_words<S: Serializer>(mode: &Mode, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{mode:?}"))
}

fn maybe_in_words<S: Serializer>(fault: &Option<Fault>, serializer: S) -> Result<S::Ok, S::Error> {
    match fault {
        None => serializer.serialize_none(),
        Some(fault) => serializer.collect_str(&format_args!("{fault:?}")),
    }
}

/// Keeps the worst of a case.
pub(super) struct Watch<'a> {
    case: &'a Case,
    outcome: Outcome,
    fallen: bool,
    begins_m: f64,
    has_assisted: bool,
}

impl Watch<'_> {
    pub(super) fn new(case: &Case, bounds: Bounds) -> Watch<'_> {
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
            rise_m: 0.0,
            fall_m: 0.0,
            height_m_max: 0.0,
            mode: Mode::SelfCheck,
            reason: None,
            bounds,
            outside: Vec::new(),
        };
        Watch {
            case,
            outcome,
            fallen: false,
            begins_m: 0.0,
            has_assisted: false,
        }
    }

    pub(super) fn begin(&mut self, simulation: &Simulation) {
        self.fallen = true;
        self.begins_m = self.height_m(simulation);
    }

    fn height_m(&self, simulation: &Simulation) -> f64 {
        simulation.contraction() * self.case.rig.muscle.initial_length_m
    }

    pub(super) fn look(&mut self, time_s: f64, simulation: &Simulation) {
        if !self.fallen {
            return;
        }
        let height_m = self.height_m(simulation);
        let speed_m_per_s =
            simulation.contraction_rate_per_s() * self.case.rig.muscle.initial_length_m;
        let outcome = &mut self.outcome;
        let most = |worst: &mut f64, value: f64| *worst = worst.max(value);
        most(&mut outcome.pressure_pa_max, simulation.pressure().0);
        most(&mut outcome.speed_up_m_per_s_max, speed_m_per_s);
        most(&mut outcome.speed_down_m_per_s_max, -speed_m_per_s);
        most(&mut outcome.height_m_max, height_m);
        most(&mut outcome.rise_m, height_m - self.begins_m);
        most(&mut outcome.fall_m, self.begins_m - height_m);
        if time_s > self.case.ends_s - END_S {
            most(&mut outcome.speed_m_per_s_final, speed_m_per_s.abs());
        }
    }

    pub(super) fn told(&mut self, time_s: f64, told: &Told) {
        // A hand that pulls as much as the gauge is off makes it whole again.
        let assists = told.output.mode == Mode::Assisting;
        self.has_assisted |= assists && time_s < self.case.finger.followed_s().start;
        let outcome = &mut self.outcome;
        if told.output.fault.is_some() {
            outcome.reason = told.output.fault;
            if self.fallen && outcome.latched_after_s.is_none() {
                outcome.latched_after_s = Some(time_s - self.case.fault_s);
            }
        }
    }

    pub(super) fn outcome(mut self, told: &Told) -> Outcome {
        let outcome = &mut self.outcome;
        outcome.mode = told.output.mode;
        let bounds = outcome.bounds;
        let Kind {
            latched,
            bars_start,
            ..
        } = self.case.kind;
        let must = latched.filter(|latched| {
            latched.moments.contains(&self.case.moment) && self.begins_m >= latched.above_m
        });
        let late = must.is_some_and(|must| {
            let after_s = outcome.latched_after_s;
            after_s.is_none_or(|after_s| after_s > must.within_s)
        });
        let wrong = must.is_some_and(|must| {
            let reason = outcome.reason;
            reason.is_some_and(|reason| !(must.is_right)(reason))
        });
        let begun = *bars_start && self.case.moment == Moment::Start && self.has_assisted;
        let false_alarm = self.case.kind.inject == Inject::Healthy && outcome.reason.is_some();
        let checks = [
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
            ("reason late", late),
            ("reason wrong", wrong),
            ("begun", begun),
            ("false alarm", false_alarm),
        ];
        let outside = checks.into_iter().filter(|(_, is_outside)| *is_outside);
        outcome.outside = outside.map(|(name, _)| name).collect();
        self.outcome
    }
}

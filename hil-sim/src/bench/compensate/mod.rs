//! Derives the controller's compensation from a fitted rig and tests it in the closed loop.
//!
//! Each effect that the controller can compensate is tried on the simulated plant of the fitted
//! rig. It is compensated if that reduces the error of the assistance and the loop keeps its
//! stability margins, also with every parameter off by [`OFF_BY`]. Only a share of the estimated
//! size may be applied: overcompensation drives the motion, undercompensation leaves a part of the
//! error.

mod hysteresis_loop;
mod load_force;
mod selection;
mod sizes;
mod trial;

pub use load_force::{AddedLoad, LoadSample, load_force_n};
pub use trial::{Corners, DELAY_MARGIN_S_MIN, GAIN_MARGIN_MIN, Quality, SPAN_S};

use crate::bench::board_settings;
use crate::bench::tick::Tick;
use crate::design;
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::compensation::Compensation;
use model_core::settings::{Settings, SettingsValues};
use muscle_plant::effects::{CompensationMethod, Effect};
use selection::{Candidate, Order, Selection};
use serde::Serialize;
use sizes::Sizes;
use trial::Trial;

/// Relative error of every parameter with which a compensation must still be robust.
pub const OFF_BY: f64 = 0.3;

/// Result for one effect of the rig, or for the lag of the loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// The effect's name; `lag` is the lag of the whole loop, which every rig has.
    pub name: String,
    /// Whether it is compensated.
    pub compensated: bool,
    /// The applied size, or the reason why it is not compensated.
    pub words: String,
}

/// A rig's compensation and the result of its test.
#[derive(Clone, Debug)]
pub struct Compensated {
    /// The result for each effect and for the lag.
    pub parts: Vec<Part>,
    /// With the previous settings.
    pub before: Quality,
    /// With the new settings.
    pub after: Quality,
    /// With the new settings off by [`OFF_BY`].
    pub corners: Corners,
    /// The new settings.
    pub settings: Settings,
    /// The run without compensation, and with it.
    pub runs: [Vec<Tick>; 2],
}

/// A stage of the controller that compensates effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    SensorGain,
    SensorOffset,
    Hysteresis,
    Friction,
    Payload,
    DeadZone,
    Lag,
}

impl Stage {
    /// Stages with sizes from single effects, in the order in which they are tried: sensors first,
    /// as the others use their readings.
    const IN_ORDER: [Stage; 6] = [
        Stage::SensorGain,
        Stage::SensorOffset,
        Stage::Hysteresis,
        Stage::Friction,
        Stage::Payload,
        Stage::DeadZone,
    ];

    /// The stage for effects with this method, if the controller has one.
    fn for_method(method: &CompensationMethod) -> Option<Stage> {
        Some(match method {
            CompensationMethod::PressureSensorGain(_) => Stage::SensorGain,
            CompensationMethod::PressureSensorOffset(_) => Stage::SensorOffset,
            CompensationMethod::HysteresisLoop => Stage::Hysteresis,
            CompensationMethod::Friction(_) => Stage::Friction,
            CompensationMethod::Payload(_) => Stage::Payload,
            CompensationMethod::ValveDeadZone(_) => Stage::DeadZone,
            CompensationMethod::Lag => Stage::Lag,
            CompensationMethod::Unavailable(_) => return None,
        })
    }

    /// The effects of `rig` that it compensates.
    fn effects(self, rig: &Rig) -> impl Iterator<Item = &Effect> {
        rig.effects
            .iter()
            .filter(move |effect| Stage::for_method(&effect.kind.compensation) == Some(self))
    }

    fn is_sensor(self) -> bool {
        matches!(self, Stage::SensorGain | Stage::SensorOffset)
    }

    /// The error that it reduces \[Pa\] or \[N\].
    fn error(self, quality: &Quality) -> f64 {
        match self {
            Stage::SensorGain | Stage::SensorOffset => quality.reading_error_pa_rms,
            Stage::Lag => quality.tracking.error_n_rms,
            _ => quality.load_error_n_rms,
        }
    }
}

/// The compensation of `rig` for a board with the settings `board`.
///
/// # Errors
/// The rig lacks a section that the closed loop needs, or its settings are outside their limits.
pub fn compensate(rig: &Rig, board: &SettingsValues) -> Result<Compensated, BadInput> {
    let bare = SettingsValues {
        compensation: Compensation::OFF,
        ..*board
    };
    let trial = Trial {
        rig,
        weight: *design::weight(rig)?,
        added_load: AddedLoad::of(rig),
        plain: board_settings::from_rig_and_board(rig, &bare)?,
    };
    let (before, run_before) = trial.with_margins(trial.plain)?;
    let candidates = candidates(&trial)?;
    let mut best = Selection::none(&before);
    for order in Order::all(&candidates) {
        let other = Selection::new(&trial, &candidates, &before, order);
        let is_better = other.quality.load_error_n_rms < best.quality.load_error_n_rms;
        if best.parts.is_empty() || is_better {
            best = other;
        }
    }
    let Selection {
        mut parts, sizes, ..
    } = best;
    parts.extend(without_candidate(rig, sizes.have_lead()));
    let settings = sizes.settings(&trial.plain)?;
    let (after, run_after) = trial.with_margins(settings)?;
    Ok(Compensated {
        parts,
        before,
        after,
        corners: trial.corners(&sizes),
        settings,
        runs: [run_before, run_after],
    })
}

/// The candidates of a rig, in the order in which they are tried.
fn candidates(trial: &Trial) -> Result<Vec<Candidate>, BadInput> {
    let mut candidates = Vec::new();
    for stage in Stage::IN_ORDER {
        if let Some(sizes) = Sizes::for_stage(trial, stage)? {
            candidates.push(Candidate {
                name: names(stage.effects(trial.rig)).join(" and "),
                stage,
                sizes,
            });
        }
    }
    Ok(candidates)
}

/// The names of effects, each once.
fn names<'a>(effects: impl Iterator<Item = &'a Effect>) -> Vec<&'static str> {
    let mut names: Vec<&'static str> = effects.map(|effect| effect.kind.name).collect();
    names.dedup();
    names
}

/// The results for effects that are not candidates: those compensated with the lag, and those
/// that the controller cannot compensate.
fn without_candidate(rig: &Rig, have_lead: bool) -> Vec<Part> {
    let mut parts: Vec<Part> = rig
        .effects
        .iter()
        .filter_map(|effect| {
            let (compensated, words) = match effect.kind.compensation {
                CompensationMethod::Lag => (
                    have_lead,
                    "it is part of the lag of the whole loop, see `lag`",
                ),
                CompensationMethod::Unavailable(reason) => (false, reason),
                _ => return None,
            };
            Some(Part {
                name: effect.kind.name.into(),
                compensated,
                words: words.into(),
            })
        })
        .collect();
    parts.dedup();
    parts
}

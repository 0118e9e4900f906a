//! Tracking of the reference by the muscle's force.

use crate::bench::tick::{TICK_S, Tick};
use crate::design;
use crate::error::BadInput;
use crate::rig::Rig;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use serde::Serialize;
use std::ops::Range;

/// Tracking of F_c by F over an interval of time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tracking {
    /// RMS of F_c − F \[N\].
    pub error_n_rms: f64,
    /// Highest F_c \[N\].
    pub reference_force_n_max: f64,
    /// Mean delay of F behind F_c while both rise from 10 % to 90 % of the weight \[s\].
    pub lag_s: Option<f64>,
    /// Largest travel of the weight \[m\].
    pub lift_m_max: f64,
}

/// When a rising signal first reaches `level` \[s\], interpolated linearly between ticks.
fn crossing_s(ticks: &[Tick], level: f64, value: fn(&Tick) -> f64) -> Option<f64> {
    let pair = ticks
        .windows(2)
        .find(|pair| value(&pair[0]) < level && value(&pair[1]) >= level)?;
    let share = (level - value(&pair[0])) / (value(&pair[1]) - value(&pair[0]));
    Some(pair[0].time_s + share * (pair[1].time_s - pair[0].time_s))
}

/// Tracking of a run of `rig` over `span_s` (see [`crate::bench::person::Finger::followed_s`]).
///
/// # Errors
/// The rig has no weight.
pub fn tracking(rig: &Rig, ticks: &[Tick], span_s: &Range<f64>) -> Result<Tracking, BadInput> {
    let weight_n = design::weight(rig)?.mass_kg * GRAVITY_M_PER_S2;
    // Times are rounded: half a tick of tolerance.
    let index_at = |time_s: f64| ticks.partition_point(|tick| tick.time_s < time_s - 0.5 * TICK_S);
    let start = index_at(span_s.start);
    let ticks = &ticks[start..index_at(span_s.end).max(start)];
    let reference_n = |tick: &Tick| f64::from(tick.output.reference_force_n);
    let largest = |value: &dyn Fn(&Tick) -> f64| ticks.iter().map(value).fold(0.0, f64::max);
    let square_sum = ticks
        .iter()
        .map(|tick| (reference_n(tick) - tick.force_n).powi(2))
        .sum::<f64>();
    let levels = (1..10).map(|tenth| 0.1 * f64::from(tenth) * weight_n);
    let delays: Option<Vec<f64>> = levels
        .map(|level| {
            let reference_s =
                crossing_s(ticks, level, |tick| tick.output.reference_force_n.into())?;
            Some(crossing_s(ticks, level, |tick| tick.force_n)? - reference_s)
        })
        .collect();
    Ok(Tracking {
        error_n_rms: (square_sum / ticks.len().max(1) as f64).sqrt(),
        reference_force_n_max: largest(&reference_n),
        lag_s: delays.map(|delays| delays.iter().sum::<f64>() / delays.len() as f64),
        lift_m_max: rig.nominal.muscle.initial_length_m * largest(&|tick| tick.contraction),
    })
}

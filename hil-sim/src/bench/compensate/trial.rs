//! The closed loop of a rig in which compensation is tried: errors and stability margins.

use super::load_force::{AddedLoad, LoadSample, load_force_n};
use super::sizes::Sizes;
use crate::bench::closed_loop::{self, Run};
use crate::bench::person::{CHECKED_S, Finger};
use crate::bench::tick::{TICK_S, Tick};
use crate::bench::tracking::Tracking;
use crate::bench::tracking::tracking;
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::controller::Controller;
use model_core::settings::{Settings, SettingsValues};
use muscle_plant::effects::transport_delay::pure_delay;
use muscle_plant::nominal::{Load, Weight};
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;

/// Largest ratio of two errors that differ only by the realisation of the noise.
const NO_WORSE: f64 = 1.005;
/// The loop keeps this factor of K_s·K to instability (6 dB), or its margin without compensation.
pub const GAIN_MARGIN_MIN: f64 = 2.0;
/// The loop keeps its stability with so much more delay \[s\], or its margin without compensation.
pub const DELAY_MARGIN_S_MIN: f64 = 0.05;
/// Step of the search for the gain margin: a twelfth of a doubling.
const GAIN_STEP: f64 = 1.059_463_094_359_295_3;
/// First step of that search: a gain of one half.
const GAIN_STEPS_MIN: i32 = -12;
/// Upper limit of the search for the gain margin.
const GAIN_MARGIN_MAX: f64 = 4.0;
/// Upper limit of the search for the delay margin \[s\].
const DELAY_MARGIN_S_MAX: f64 = 0.1;
/// Largest peak-to-peak deviation of a held weight from a linear drift \[m\]: a larger one counts
/// as oscillation, a smaller one cannot be felt.
const SWING_M_MAX: f64 = 3e-4;
/// Ticks before and after a tick over which the force is averaged to measure its ripple.
const RIPPLE_TICKS: usize = 5;

/// Evaluated interval: from the beginning of the lift until the finger is down again \[s\].
pub const SPAN_S: Range<f64> = 1.0..7.5;
/// Interval in which the weight is held at rest \[s\].
const HELD_S: Range<f64> = 3.0..5.9;

/// The run in which compensation is tried: the paper's lift, held and lowered.
pub(super) fn experiment() -> Run {
    Run {
        duration_s: 8.0,
        ..Run::PAPER
    }
}

/// Errors of the assistance, and margins of the loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Tracking of F_c by F; F_c is K F_b with the forces of friction and payload.
    pub tracking: Tracking,
    /// RMS of K F_b less the force on the nominal load \[N\].
    pub load_error_n_rms: f64,
    /// RMS of F about its mean over 0.1 s, while the weight is held \[N\].
    pub ripple_n_rms: f64,
    /// RMS of the pressure reading of the controller less the true pressure \[Pa\].
    pub reading_error_pa_rms: f64,
    /// Gain margin: factor of K_s·K up to which the loop is stable, limited by the search.
    pub gain_margin: f64,
    /// Delay margin: added delay \[s\] up to which the loop is stable, limited by the search.
    pub delay_margin_s: f64,
    /// The controller has stopped assisting.
    pub faulted: bool,
}

/// The worst cases with all parameters off by [`OFF_BY`](super::OFF_BY).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Corners {
    /// Number of cases: each parameter up and down, with each of the others.
    pub count: usize,
    /// Smallest gain margin.
    pub gain_margin_min: f64,
    /// Smallest delay margin \[s\].
    pub delay_margin_s_min: f64,
    /// Largest of [`Quality::load_error_n_rms`].
    pub load_error_n_rms_max: f64,
}

/// A rig on which compensation is tried.
pub(super) struct Trial<'a> {
    pub rig: &'a Rig,
    /// The nominal load.
    pub weight: Weight,
    pub added_load: AddedLoad,
    /// Settings without compensation; the scales of the electronics are always taken from them.
    pub plain: Settings,
}

impl Trial<'_> {
    pub fn run(
        &self,
        rig: &Rig,
        settings: Settings,
        experiment: &Run,
    ) -> Result<Vec<Tick>, BadInput> {
        let mut controller = Controller::new(settings);
        closed_loop::run_in_process(rig, &self.plain, experiment, |sensors| {
            controller.tick(sensors)
        })
    }

    /// Errors of a run of [`experiment`], with margins of 0.
    fn quality(&self, ticks: &[Tick]) -> Result<Quality, BadInput> {
        let gain = f64::from(self.plain.values().gain);
        let load_samples: Vec<LoadSample> = ticks
            .iter()
            .map(|tick| LoadSample {
                required_n: gain * f64::from(tick.output.finger_force_n),
                force_n: tick.force_n,
                contraction: tick.contraction,
            })
            .collect();
        let length_m = self.rig.nominal.muscle.initial_length_m;
        let load_n = load_force_n(&self.weight, &self.added_load, length_m, &load_samples);
        let errors = load_samples
            .iter()
            .zip(&load_n)
            .map(|(tick, load_n)| tick.required_n - load_n);
        let reading_errors = ticks
            .iter()
            .map(|tick| f64::from(tick.output.pressure.0) - tick.pressure.0);
        let windows = ticks[span(&HELD_S)].windows(2 * RIPPLE_TICKS + 1);
        let ripples = windows.map(|window| {
            let sum: f64 = window.iter().map(|tick| tick.force_n).sum();
            window[RIPPLE_TICKS].force_n - sum / window.len() as f64
        });
        let in_span = span(&SPAN_S);
        Ok(Quality {
            tracking: tracking(self.rig, ticks, &SPAN_S)?,
            load_error_n_rms: rms(errors.skip(in_span.start).take(in_span.len())),
            ripple_n_rms: rms(ripples),
            reading_error_pa_rms: rms(reading_errors.skip(in_span.start).take(in_span.len())),
            gain_margin: 0.0,
            delay_margin_s: 0.0,
            faulted: ticks.last().is_some_and(|tick| tick.output.fault.is_some()),
        })
    }

    /// Errors with `settings`, and the run.
    pub fn evaluate(&self, settings: Settings) -> Result<(Quality, Vec<Tick>), BadInput> {
        let ticks = self.run(self.rig, settings, &experiment())?;
        Ok((self.quality(&ticks)?, ticks))
    }

    /// Errors and margins with `settings`, and the run.
    pub fn with_margins(&self, settings: Settings) -> Result<(Quality, Vec<Tick>), BadInput> {
        let (quality, ticks) = self.evaluate(settings)?;
        let (gain_margin, delay_margin_s) =
            self.margins(settings, GAIN_MARGIN_MAX, DELAY_MARGIN_S_MAX);
        let quality = Quality {
            gain_margin,
            delay_margin_s,
            ..quality
        };
        Ok((quality, ticks))
    }

    /// The gain margin to 6 % and the delay margin to a tick, up to `gain_max` and `delay_s_max`.
    fn margins(&self, settings: Settings, gain_max: f64, delay_s_max: f64) -> (f64, f64) {
        let is_calm = |step: &i32| self.is_calm(settings, GAIN_STEP.powi(*step), 0.0);
        let steps = (gain_max.ln() / GAIN_STEP.ln()).round() as i32;
        // If the loop is unstable with its own gain, a lower one.
        let step = (0..=steps).take_while(is_calm).last();
        let step = step.or_else(|| (GAIN_STEPS_MIN..0).rev().find(is_calm));
        let gain = step.map(|step| GAIN_STEP.powi(step));
        let ticks = 0..=(delay_s_max / TICK_S).round() as u32;
        let delays = ticks.map(|ticks| f64::from(ticks) * TICK_S);
        let delay_s = delays
            .take_while(|delay_s| self.is_calm(settings, 1.0, *delay_s))
            .last();
        (gain.unwrap_or(0.0), delay_s.unwrap_or(0.0))
    }

    /// Whether the weight comes to rest after two lifts of different height, with a lever that is
    /// stiffer by `gain` and a line with `delay_s` more delay. The rig's dry friction, which would
    /// hold the weight, is left out.
    fn is_calm(&self, settings: Settings, gain: f64, delay_s: f64) -> bool {
        // Without noise, constant readings do not indicate a fault.
        let noiseless = SettingsValues {
            stuck_ticks: 0,
            ..*settings.values()
        };
        let Ok(settings) = Settings::new(noiseless) else {
            return false;
        };
        let mut rig = self.rig.clone();
        if let Load::Weight(weight) = &mut rig.nominal.load {
            (weight.coulomb_friction_n, weight.static_friction_n) = (0.0, 0.0);
        }
        if let Some(assist) = &mut rig.assist {
            assist.input_stiffness_n_per_m *= gain;
        }
        if delay_s > 0.0 {
            rig.effects.push(pure_delay(delay_s));
        }
        [0.06, 0.12].into_iter().all(|travel_m| {
            let slow = Run {
                finger: Finger::Lift {
                    start_s: CHECKED_S,
                    travel_m,
                    rise_s: 2.0,
                    hold_s: 10.0,
                    lower_s: 1.0,
                },
                duration_s: 6.5,
                bridge_noise_n: 0.0,
                pressure_noise_pa: 0.0,
                ..Run::PAPER
            };
            self.run(&rig, settings, &slow).is_ok_and(|ticks| {
                let last = &ticks[ticks.len() - 150..];
                let faulted = ticks.last().is_some_and(|tick| tick.output.fault.is_some());
                !faulted && rig.nominal.muscle.initial_length_m * swing(last) <= SWING_M_MAX
            })
        })
    }

    /// Whether `sizes`, with `quality`, are robust: with every parameter off by
    /// [`OFF_BY`](super::OFF_BY) the errors are no larger than `before`, and the margins are kept.
    pub fn is_robust(&self, sizes: &Sizes, quality: &Quality, before: &Quality) -> bool {
        let (gain, delay_s) = required(before);
        let is_robust = |corner: &Sizes| {
            let Ok(settings) = corner.settings(&self.plain) else {
                return false;
            };
            let evaluated = self.evaluate(settings);
            let (gain_margin, delay_margin_s) = self.margins(settings, gain, delay_s);
            evaluated.is_ok_and(|(quality, _)| no_worse(&quality, before))
                && gain_margin >= gain
                && delay_margin_s >= delay_s
        };
        !quality.faulted && sizes.corners().par_iter().all(is_robust)
    }

    /// The worst cases with every parameter off by [`OFF_BY`](super::OFF_BY).
    pub fn corners(&self, sizes: &Sizes) -> Corners {
        let corners = sizes.corners();
        let qualities: Vec<Quality> = corners
            .par_iter()
            .filter_map(|corner| {
                let settings = corner.settings(&self.plain).ok()?;
                Some(self.with_margins(settings).ok()?.0)
            })
            .collect();
        let smallest =
            |value: fn(&Quality) -> f64| qualities.iter().map(value).fold(f64::INFINITY, f64::min);
        Corners {
            count: corners.len(),
            gain_margin_min: smallest(|quality| quality.gain_margin),
            delay_margin_s_min: smallest(|quality| quality.delay_margin_s),
            load_error_n_rms_max: -smallest(|quality| -quality.load_error_n_rms),
        }
    }
}

/// The margins that compensation must keep.
fn required(before: &Quality) -> (f64, f64) {
    (
        before.gain_margin.min(GAIN_MARGIN_MIN),
        before.delay_margin_s.min(DELAY_MARGIN_S_MIN),
    )
}

fn no_worse(quality: &Quality, before: &Quality) -> bool {
    !quality.faulted && quality.load_error_n_rms <= NO_WORSE * before.load_error_n_rms
}

/// Ticks of an interval of time.
fn span(span_s: &Range<f64>) -> Range<usize> {
    let tick = |time_s: f64| (time_s / TICK_S).round() as usize;
    tick(span_s.start)..tick(span_s.end)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (squares, count) = values.fold((0.0, 0.0), |(squares, count), value| {
        (squares + value * value, count + 1.0)
    });
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Peak-to-peak deviation of the contraction from its linear trend \[-\].
fn swing(ticks: &[Tick]) -> f64 {
    let middle = (ticks.len() - 1) as f64 / 2.0;
    let offset = |index: usize| index as f64 - middle;
    let contractions = || ticks.iter().map(|tick| tick.contraction).enumerate();
    let moment = contractions()
        .map(|(i, value)| offset(i) * value)
        .sum::<f64>();
    let slope = moment
        / contractions()
            .map(|(i, _)| offset(i) * offset(i))
            .sum::<f64>();
    let deviations = contractions().map(|(i, value)| value - slope * offset(i));
    let (low, high) = deviations.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    high - low
}

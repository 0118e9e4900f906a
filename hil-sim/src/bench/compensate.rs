//! From a fitted rig to the controller's compensation, proved in the closed loop first.
//!
//! Each part that the board can compensate is tried on the rig's own plant, and kept where it makes
//! the assistance better and leaves the loop its stability margins, also when every parameter is
//! off by [`OFF_BY`]. What is kept is a share of what was found: compensation that overshoots
//! feeds the motion, one that falls short leaves a rest.

use crate::bench::closed_loop::{self, Experiment, Finger, TICK_S, Tick, Tracking};
use crate::design;
use crate::error::BadInput;
use crate::rig::Rig;
use model_core::compensation::{Compensation, CompensationState};
use model_core::controller::Controller;
use model_core::pressure::GaugePa;
use model_core::settings::{Settings, SettingsValues};
use muscle_plant::effects::Effect;
use muscle_plant::nominal::{Load, Weight};
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;

/// What every parameter may be off by, relatively.
pub const OFF_BY: f64 = 0.3;
/// Shares of what was found that are tried, the best that holds is taken. With the second, a size
/// that was found too large by [`OFF_BY`] is compensated in full and not beyond.
const SHARES: [f64; 4] = [1.0, 1.0 / (1.0 + OFF_BY), 0.5, 0.3];
/// What is too short by [`OFF_BY`] is whole with this.
const LONGER: f64 = 1.0 / (1.0 - OFF_BY);
/// Ways are made longer by this, whichever leaves least of the error: a longer way is less steep
/// where the motion turns, and leaves the loop margins for more of the size, or for a lead.
const WAYS: [f64; 3] = [LONGER, LONGER * LONGER, LONGER * LONGER * LONGER];
/// A part is worth having if the error falls to this share of what it was without it.
const BETTER: f64 = 0.98;
/// An error that rises by no more than this is the same: another course of the same noise.
const NO_WORSE: f64 = 1.005;
/// The loop keeps this factor of K_s·K to instability (6 dB), or what it had without compensation.
pub const GAIN_MARGIN_MIN: f64 = 2.0;
/// The loop keeps bearing so much more delay \[s\], or what it bore without compensation.
pub const DELAY_MARGIN_S_MIN: f64 = 0.05;
/// Gain margins are looked for in steps of a twelfth of a doubling,
const GAIN_STEP: f64 = 1.059_463_094_359_295_3;
/// from a half,
const GAIN_STEPS_LEAST: i32 = -12;
/// to this,
const GAIN_MARGIN_MAX: f64 = 4.0;
/// and delay margins to this \[s\].
const DELAY_MARGIN_S_MAX: f64 = 0.1;
/// A weight that is held and moves by more about its drift swings \[m\]: less than is felt.
const SWING_M_MAX: f64 = 3e-4;
/// Way over which friction without pre-sliding is made to turn \[m\]: 80 of the encoder's counts.
const FRICTION_REACH_M: f64 = 1e-3;
/// Leads are tried in these steps \[s\], so many: to 120 ms.
const LEAD_STEP_S: f64 = 2.5e-3;
/// See [`LEAD_STEP_S`].
const LEAD_STEPS: u32 = 48;
/// Ticks about a tick over which a force is averaged to see its ripple.
const RIPPLE_TICKS: usize = 5;

/// What is taken of what was found.
#[derive(Clone, Copy)]
enum Taken {
    /// A share: of a size, what is too much feeds the motion.
    Share,
    /// Longer, by one of [`WAYS`]: of a way, what is too short is steep.
    Longer,
    /// As it is.
    Whole,
}

const HYSTERESIS_AREA: usize = 0;
const HYSTERESIS_REACH: usize = 1;
const FRICTION: usize = 2;
const FRICTION_REACH: usize = 3;
const PAYLOAD: usize = 4;
const FILLING: usize = 5;
const EXHAUSTING: usize = 6;
const LEAD: usize = 7;
const SENSOR_OFFSET: usize = 8;
const SENSOR_GAIN: usize = 9;

/// For each of the above.
const TAKEN: [Taken; 10] = [
    Taken::Share,
    Taken::Longer,
    Taken::Share,
    Taken::Longer,
    Taken::Share,
    Taken::Share,
    Taken::Share,
    Taken::Share,
    Taken::Whole,
    Taken::Whole,
];

/// A value for each of the above, in the settings' units; 0: not compensated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sizes([f64; TAKEN.len()]);

impl Sizes {
    /// These with the others in place of those that are 0.
    fn with(mut self, others: &Sizes, share: f64, longer: f64) -> Sizes {
        for ((value, other), taken) in self.0.iter_mut().zip(others.0).zip(TAKEN) {
            if other != 0.0 {
                *value = match taken {
                    Taken::Share => share * other,
                    Taken::Longer => longer * other,
                    Taken::Whole => other,
                };
            }
        }
        self
    }

    /// Whether there is a way among them, which may be made longer.
    fn has_way(&self) -> bool {
        let mut values = self.0.iter().zip(TAKEN);
        values.any(|(value, taken)| *value != 0.0 && matches!(taken, Taken::Longer))
    }

    /// The settings `plain` with this compensation.
    ///
    /// The bounds are what the sizes add up to; of the pressure, half of its limit more.
    fn settings(&self, plain: &Settings) -> Result<Settings, BadInput> {
        let mut values = *plain.values();
        let value = |index: usize| self.0[index] as f32;
        values.load_kg += value(PAYLOAD);
        let load_n = value(FRICTION) + value(PAYLOAD).abs() * GRAVITY_M_PER_S2 as f32;
        let hysteresis_n = value(HYSTERESIS_AREA) * values.pressure_pa_max;
        let shaped = value(LEAD) > 0.0 || value(FILLING) > 0.0 || value(EXHAUSTING) > 0.0;
        values.compensation = Compensation {
            hysteresis_area_m2: value(HYSTERESIS_AREA),
            hysteresis_reach: value(HYSTERESIS_REACH),
            friction_n: value(FRICTION),
            friction_reach_m: value(FRICTION_REACH),
            payload_kg: value(PAYLOAD),
            force_n_max: load_n.max(hysteresis_n),
            lead_s: value(LEAD),
            dead_zone_filling_pa: value(FILLING),
            dead_zone_exhausting_pa: value(EXHAUSTING),
            pressure_pa_max: if shaped { PRESSURE_PA_MAX } else { 0.0 },
        };
        let scale = &mut values.pressure_sensor;
        scale.zero_count += value(SENSOR_OFFSET) / scale.per_count;
        scale.per_count /= 1.0 + value(SENSOR_GAIN);
        Settings::new(values).map_err(|error| BadInput::file("compensation", error.to_string()))
    }

    /// All that these are with every value off by [`OFF_BY`], up or down.
    fn corners(&self) -> Vec<Sizes> {
        let active: Vec<usize> = (0..TAKEN.len()).filter(|i| self.0[*i] != 0.0).collect();
        let corner = |bits: usize| {
            let mut corner = *self;
            for (bit, index) in active.iter().enumerate() {
                let up = bits >> bit & 1 == 1;
                corner.0[*index] *= 1.0 + if up { OFF_BY } else { -OFF_BY };
            }
            corner
        };
        (0..1_usize << active.len()).map(corner).collect()
    }
}

/// Largest pressure that lead and dead zone add \[Pa\]: a tenth of the paper's supply.
const PRESSURE_PA_MAX: f32 = 5e4;

/// What the assistance and the loop are like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// How F follows F_c, which is K F_b and what friction and payload take.
    pub tracking: Tracking,
    /// RMS of K F_b less the force that reaches the load as it nominally is \[N\].
    pub load_error_n_rms: f64,
    /// RMS of F about its mean over a tenth of a second, while the weight is held \[N\].
    pub ripple_n_rms: f64,
    /// RMS of the pressure that the controller reads less the true one \[Pa\].
    pub reading_error_pa_rms: f64,
    /// Factor of K_s·K up to which the loop is stable; a bound where it is beyond.
    pub gain_margin: f64,
    /// Delay \[s\] that it bears more; the largest looked for where it bears more still.
    pub delay_margin_s: f64,
    /// The controller has stopped assisting.
    pub faulted: bool,
}

/// What was done about one thing that the rig has.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// The effect's name; `lag` is the rig's whole lag, which every rig has.
    pub name: String,
    /// It is compensated.
    pub compensated: bool,
    /// What was found, and why it is compensated or is not.
    pub words: String,
}

/// The worst of all parameters being off by [`OFF_BY`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Corners {
    /// How many were looked at: each parameter up and down, with each of the others.
    pub count: usize,
    /// Smallest gain margin.
    pub gain_margin_min: f64,
    /// Smallest delay margin \[s\].
    pub delay_margin_s_min: f64,
    /// Largest of [`Quality::load_error_n_rms`].
    pub load_error_n_rms_max: f64,
}

/// A rig's compensation and its proof.
#[derive(Clone, Debug)]
pub struct Compensated {
    /// What was done about each thing.
    pub parts: Vec<Part>,
    /// With the settings as they were.
    pub before: Quality,
    /// With the new ones.
    pub after: Quality,
    /// With the new ones off by [`OFF_BY`].
    pub corners: Corners,
    /// The new ones.
    pub settings: Settings,
    /// The run without compensation, and with it.
    pub runs: [Vec<Tick>; 2],
}

/// The proof's experiment: the paper's lift, held and let down.
fn experiment() -> Experiment {
    Experiment {
        duration_s: 8.0,
        ..Experiment::PAPER
    }
}

/// From the lift's beginning until the finger is down again \[s\].
pub const SPAN_S: Range<f64> = 1.0..7.5;
/// While the weight is held and at rest \[s\].
const HELD_S: Range<f64> = 3.0..5.9;

/// A rig on which compensation is tried.
struct Bench<'a> {
    rig: &'a Rig,
    /// The load as it nominally is, and what is beside it.
    weight: Weight,
    beyond: Beyond,
    /// The electronics, which no compensation changes.
    plain: Settings,
}

impl Bench<'_> {
    fn run(&self, rig: &Rig, settings: Settings, what: &Experiment) -> Result<Vec<Tick>, BadInput> {
        let mut controller = Controller::new(settings);
        closed_loop::run(rig, &self.plain, what, |sensors| controller.tick(sensors))
    }

    /// Errors of a run of the proof's experiment; margins are left out.
    fn quality(&self, ticks: &[Tick]) -> Result<Quality, BadInput> {
        let gain = f64::from(self.plain.values().gain);
        let pulled: Vec<Pulled> = ticks
            .iter()
            .map(|tick| Pulled {
                asked_n: gain * f64::from(tick.output.finger_force_n),
                force_n: tick.force_n,
                contraction: tick.contraction,
            })
            .collect();
        let length_m = self.rig.nominal.muscle.initial_length_m;
        let load_n = load_force_n(&self.weight, &self.beyond, length_m, &pulled);
        let errors = pulled
            .iter()
            .zip(&load_n)
            .map(|(tick, load_n)| tick.asked_n - load_n);
        let read = ticks
            .iter()
            .map(|tick| f64::from(tick.output.pressure.0) - tick.pressure.0);
        let held = ticks[span(&HELD_S)].windows(2 * RIPPLE_TICKS + 1);
        let ripples = held.map(|about| {
            let sum: f64 = about.iter().map(|tick| tick.force_n).sum();
            about[RIPPLE_TICKS].force_n - sum / about.len() as f64
        });
        let in_span = span(&SPAN_S);
        Ok(Quality {
            tracking: closed_loop::tracking(self.rig, ticks, &SPAN_S)?,
            load_error_n_rms: rms(errors.skip(in_span.start).take(in_span.len())),
            ripple_n_rms: rms(ripples),
            reading_error_pa_rms: rms(read.skip(in_span.start).take(in_span.len())),
            gain_margin: 0.0,
            delay_margin_s: 0.0,
            faulted: ticks.last().is_some_and(|tick| tick.output.fault.is_some()),
        })
    }

    fn prove(&self, settings: Settings) -> Result<(Quality, Vec<Tick>), BadInput> {
        let ticks = self.run(self.rig, settings, &experiment())?;
        Ok((self.quality(&ticks)?, ticks))
    }

    fn with_margins(&self, settings: Settings) -> Result<(Quality, Vec<Tick>), BadInput> {
        let (quality, ticks) = self.prove(settings)?;
        let (gain_margin, delay_margin_s) =
            self.margins(settings, GAIN_MARGIN_MAX, DELAY_MARGIN_S_MAX);
        let quality = Quality {
            gain_margin,
            delay_margin_s,
            ..quality
        };
        Ok((quality, ticks))
    }

    /// The gain margin to 6 %, the delay margin to a tick, looked for up to `gain_max` and
    /// `delay_s_max`.
    fn margins(&self, settings: Settings, gain_max: f64, delay_s_max: f64) -> (f64, f64) {
        let is_calm = |step: &i32| self.is_calm(settings, GAIN_STEP.powi(*step), 0.0);
        let steps = (gain_max.ln() / GAIN_STEP.ln()).round() as i32;
        // Where the lever as it is is too stiff, a softer one.
        let step = (0..=steps).take_while(is_calm).last();
        let step = step.or_else(|| (GAIN_STEPS_LEAST..0).rev().find(is_calm));
        let gain = step.map(|step| GAIN_STEP.powi(step));
        let ticks = 0..=(delay_s_max / TICK_S).round() as u32;
        let delays = ticks.map(|ticks| f64::from(ticks) * TICK_S);
        let delay_s = delays
            .take_while(|delay_s| self.is_calm(settings, 1.0, *delay_s))
            .last();
        (gain.unwrap_or(0.0), delay_s.unwrap_or(0.0))
    }

    /// With a lever stiffer by `gain` and a line later by `delay_s`, two weights that are lifted
    /// come to rest. The rig's dry friction, which would hold them, is left out.
    fn is_calm(&self, settings: Settings, gain: f64, delay_s: f64) -> bool {
        // Without noise, readings that stand still are no sign of a fault.
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
        if let Some(kind) = rig
            .catalogue
            .find("transport-delay")
            .filter(|_| delay_s > 0.0)
        {
            rig.effects.push(Effect {
                kind,
                form: &kind.forms[0],
                values: vec![delay_s],
            });
        }
        [0.06, 0.12].into_iter().all(|travel_m| {
            let slow = Experiment {
                finger: Finger::Lift {
                    start_s: closed_loop::CHECKED_S,
                    travel_m,
                    rise_s: 2.0,
                    hold_s: 10.0,
                    lower_s: 1.0,
                },
                duration_s: 6.5,
                bridge_noise_n: 0.0,
                pressure_noise_pa: 0.0,
                ..Experiment::PAPER
            };
            self.run(&rig, settings, &slow).is_ok_and(|ticks| {
                let last = &ticks[ticks.len() - 150..];
                let faulted = ticks.last().is_some_and(|tick| tick.output.fault.is_some());
                !faulted && rig.nominal.muscle.initial_length_m * swing(last) <= SWING_M_MAX
            })
        })
    }

    /// Whether `sizes`, which gave `quality`, hold: in every corner no worse than `before`, and
    /// with its margins.
    fn holds(&self, sizes: &Sizes, quality: &Quality, before: &Quality) -> bool {
        let (gain, delay_s) = required(before);
        let holds = |corner: &Sizes| {
            let Ok(settings) = corner.settings(&self.plain) else {
                return false;
            };
            let proved = self.prove(settings);
            let (gain_margin, delay_margin_s) = self.margins(settings, gain, delay_s);
            proved.is_ok_and(|(quality, _)| no_worse(&quality, before))
                && gain_margin >= gain
                && delay_margin_s >= delay_s
        };
        !quality.faulted && sizes.corners().par_iter().all(holds)
    }

    fn corners(&self, sizes: &Sizes) -> Corners {
        let corners = sizes.corners();
        let qualities: Vec<Quality> = corners
            .par_iter()
            .filter_map(|corner| {
                let settings = corner.settings(&self.plain).ok()?;
                Some(self.with_margins(settings).ok()?.0)
            })
            .collect();
        let least =
            |value: fn(&Quality) -> f64| qualities.iter().map(value).fold(f64::INFINITY, f64::min);
        Corners {
            count: corners.len(),
            gain_margin_min: least(|quality| quality.gain_margin),
            delay_margin_s_min: least(|quality| quality.delay_margin_s),
            load_error_n_rms_max: -least(|quality| -quality.load_error_n_rms),
        }
    }
}

/// The margins that compensation must leave.
fn required(before: &Quality) -> (f64, f64) {
    (
        before.gain_margin.min(GAIN_MARGIN_MIN),
        before.delay_margin_s.min(DELAY_MARGIN_S_MIN),
    )
}

fn no_worse(quality: &Quality, before: &Quality) -> bool {
    !quality.faulted && quality.load_error_n_rms <= NO_WORSE * before.load_error_n_rms
}

/// Ticks of a span of time.
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

/// How far the contraction is at most from a straight line, from end to end of its range.
fn swing(ticks: &[Tick]) -> f64 {
    let middle = (ticks.len() - 1) as f64 / 2.0;
    let place = |index: usize| index as f64 - middle;
    let contractions = || ticks.iter().map(|tick| tick.contraction).enumerate();
    let moment = contractions()
        .map(|(i, value)| place(i) * value)
        .sum::<f64>();
    let slope = moment
        / contractions()
            .map(|(i, _)| place(i) * place(i))
            .sum::<f64>();
    let left = contractions().map(|(i, value)| value - slope * place(i));
    let (low, high) = left.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    high - low
}

/// What a load has beyond its nominal self.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beyond {
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Static friction \[N\].
    pub friction_n: f64,
}

impl Beyond {
    fn of(rig: &Rig) -> Beyond {
        let friction = |parameter| total(rig, "friction", parameter);
        Beyond {
            mass_kg: total(rig, "payload", "mass_kg"),
            friction_n: friction("force_n") * friction("static_ratio").max(1.0),
        }
    }
}

/// A tick as [`load_force_n`] needs it.
#[derive(Clone, Copy, Debug)]
pub struct Pulled {
    /// K F_b \[N\].
    pub asked_n: f64,
    /// F of the muscle \[N\].
    pub force_n: f64,
    /// ε \[-\].
    pub contraction: f64,
}

/// The force that reaches the load as it nominally is \[N\], tick by tick. Without friction and
/// payload beyond the nominal it is the muscle's.
///
/// In motion it is Eq 5 solved for F with the nominal weight. At rest friction takes any part of F
/// up to its size: the one that leaves nearest to K F_b counts.
pub fn load_force_n(weight: &Weight, beyond: &Beyond, length_m: f64, ticks: &[Pulled]) -> Vec<f64> {
    let at = |index: usize| ticks[index.min(ticks.len() - 1)].contraction;
    let rest_n = weight.mass_kg * GRAVITY_M_PER_S2;
    let most_n = rest_n + weight.static_friction_n;
    let forces = ticks.iter().enumerate().map(|(index, tick)| {
        let (before, now, after) = (at(index.saturating_sub(1)), at(index), at(index + 1));
        let left_n = tick.force_n - beyond.mass_kg * GRAVITY_M_PER_S2;
        let (low_n, high_n) = (left_n - beyond.friction_n, left_n + beyond.friction_n);
        if before.min(now).min(after) <= 0.0 {
            // The stop carries what does not lift it.
            return tick.asked_n.clamp(low_n, high_n).min(most_n);
        }
        if before == after {
            let least_n = rest_n - weight.static_friction_n;
            return tick.asked_n.clamp(low_n, high_n).clamp(least_n, most_n);
        }
        let speed_m_per_s = length_m * (after - before) / (2.0 * TICK_S);
        let acceleration_m_per_s2 = length_m * (after - 2.0 * now + before) / (TICK_S * TICK_S);
        rest_n
            + weight.mass_kg * acceleration_m_per_s2
            + weight.viscous_damping_ns_per_m * speed_m_per_s
            + weight.coulomb_friction_n.copysign(speed_m_per_s)
    });
    forces.collect()
}

/// Sum of a parameter over all effects of that name.
fn total(rig: &Rig, name: &str, parameter: &str) -> f64 {
    let of_name = rig.effects.iter().filter(|effect| effect.kind.name == name);
    let values = of_name.filter_map(|effect| {
        let mut parameters = effect.form.parameters.iter();
        let index = parameters.position(|known| known.name == parameter)?;
        Some(effect.values[index])
    });
    values.sum()
}

/// What the effects of that name ask for.
fn sizes_of(bench: &Bench, name: &str) -> Result<Option<Sizes>, BadInput> {
    let sum = |parameter: &str| total(bench.rig, name, parameter);
    let mut sizes = Sizes::default();
    match name {
        "hysteresis" => {
            let (area_m2, reach) = loop_of(bench)?;
            sizes.0[HYSTERESIS_AREA] = area_m2;
            sizes.0[HYSTERESIS_REACH] = reach;
        }
        "friction" => {
            sizes.0[FRICTION] = sum("force_n");
            sizes.0[FRICTION_REACH] = sum("deflection_m").max(FRICTION_REACH_M);
        }
        "payload" => sizes.0[PAYLOAD] = sum("mass_kg"),
        "valve-dead-zone" => {
            sizes.0[FILLING] = sum("half_width_pa") + sum("filling_pa");
            sizes.0[EXHAUSTING] = sum("half_width_pa") + sum("exhausting_pa");
        }
        "pressure-sensor-offset" => sizes.0[SENSOR_OFFSET] = sum("offset_pa"),
        // Both are told at 300 kPa, in the middle of what an assist needs.
        "pressure-sensor-gain" => {
            sizes.0[SENSOR_GAIN] = sum("gain_error") + sum("nonlinearity");
        }
        _ => return Ok(None),
    }
    Ok(Some(sizes))
}

/// The device's hysteresis that is nearest, by least squares, to that of the rig's plant in its own
/// closed loop, whatever the plant's form: area over pressure \[m²\], and reach.
fn loop_of(bench: &Bench) -> Result<(f64, f64), BadInput> {
    let mut rig = bench.rig.clone();
    rig.effects
        .retain(|effect| effect.kind.name == "hysteresis");
    let ticks = bench.run(&rig, bench.plain, &experiment())?;
    let muscle = bench.plain.values().muscle;
    let fit = |reach: f64| {
        let one = Compensation {
            hysteresis_area_m2: 1.0,
            hysteresis_reach: reach as f32,
            force_n_max: f32::INFINITY,
            ..Compensation::OFF
        };
        let mut memory = CompensationState::default();
        let (mut squares, mut product, mut whole) = (0.0, 0.0, 0.0);
        for tick in &ticks {
            memory.follow(&one, &muscle, tick.contraction as f32);
            let shape = f64::from(memory.hysteresis_n(&one, GaugePa(tick.pressure.0 as f32)));
            let taken_n =
                rig.nominal.muscle.force_n(tick.contraction, tick.pressure) - tick.force_n;
            squares += shape * shape;
            product += shape * taken_n;
            whole += taken_n * taken_n;
        }
        let area_m2 = if squares > 0.0 {
            product / squares
        } else {
            0.0
        };
        (whole - area_m2 * product, area_m2.max(0.0), reach)
    };
    // From a tenth of a percent to the whole stroke, in steps of 12 %.
    let reaches = (0..56).map(|step| 1e-3 * 1.12_f64.powi(step));
    let best = reaches.map(fit).min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(best.map_or((0.0, 0.0), |(_, area_m2, reach)| (area_m2, reach)))
}

/// The lead that leaves least of F_c − F \[s\], beside what is `kept`: the rig's whole lag, of
/// hold, delay, valve and gas.
fn lag_s(bench: &Bench, kept: &Sizes) -> f64 {
    let error_n = |lead_s: f64| {
        let mut sizes = *kept;
        sizes.0[LEAD] = lead_s;
        let settings = sizes.settings(&bench.plain).ok()?;
        let (quality, _) = bench.prove(settings).ok()?;
        Some((quality.tracking.error_n_rms, lead_s))
    };
    let leads: Vec<f64> = (0..=LEAD_STEPS)
        .map(|step| f64::from(step) * LEAD_STEP_S)
        .collect();
    let tried = leads.par_iter().filter_map(|lead_s| error_n(*lead_s));
    let least = tried.min_by(|a, b| a.0.total_cmp(&b.0));
    least.map_or(0.0, |(_, lead_s)| lead_s)
}

/// Why what is not compensated is not.
fn reason(name: &str) -> &'static str {
    match name {
        "contraction-sensor-offset" => {
            "nothing to do: the self-check takes the encoder's zero where the weight rests"
        }
        "creep" | "run-in" => "it is slower than a lift, and what it has come to is not measured",
        "dead-band" | "bladder-elasticity" | "slack" => {
            "a force law that is other than Eq 1, not a loss on the way to it"
        }
        "backlash" => "the encoder that would have to see it is what it hides from",
        "flow-limit" | "supply-droop" => "air that does not come cannot be asked for",
        "leak" => "it takes a steady flow, and with it pressure, for which the stage has no term",
        "heat-exchange" => "the valve's own loop makes up for most of it",
        "line-dynamics" => "it swings faster than a tick follows",
        "pressure-sensor-drift" => "it is not the same from one run to the next",
        _ => "the board has nothing for it",
    }
}

/// The part that is no effect.
const LAG: &str = "lag";

/// What is tried in its turn: sensors first, for what the others read.
const TURNS: [&str; 6] = [
    "pressure-sensor-gain",
    "pressure-sensor-offset",
    "hysteresis",
    "friction",
    "payload",
    "valve-dead-zone",
];

fn is_sensor(name: &str) -> bool {
    name.starts_with("pressure-sensor")
}

/// The compensation of `rig` for a board with the settings `board`.
///
/// # Errors
/// The rig lacks what the closed loop needs, or asks for what no board may do.
pub fn compensate(rig: &Rig, board: &SettingsValues) -> Result<Compensated, BadInput> {
    let bare = SettingsValues {
        compensation: Compensation::OFF,
        ..*board
    };
    let bench = Bench {
        rig,
        weight: *design::weight(rig)?,
        beyond: Beyond::of(rig),
        plain: closed_loop::settings_with(rig, &bare)?,
    };
    let (before, run_before) = bench.with_margins(bench.plain)?;
    let mut found = Vec::new();
    for name in TURNS {
        if rig.effects.iter().any(|effect| effect.kind.name == name)
            && let Some(sizes) = sizes_of(&bench, name)?
        {
            found.push((name, sizes));
        }
    }
    let mut chosen = Chosen::none(&before);
    for order in orders(&found) {
        let other = Chosen::of(&bench, &found, &before, order);
        let is_better = other.quality.load_error_n_rms < chosen.quality.load_error_n_rms;
        if chosen.parts.is_empty() || is_better {
            chosen = other;
        }
    }
    let Chosen {
        mut parts, sizes, ..
    } = chosen;
    let mut left: Vec<&str> = rig.effects.iter().map(|effect| effect.kind.name).collect();
    left.retain(|name| !TURNS.contains(name));
    left.dedup();
    let by_lag = sizes.0[LEAD] > 0.0;
    parts.extend(left.into_iter().map(|name| left_to(name, by_lag)));
    let settings = sizes.settings(&bench.plain)?;
    let (after, run_after) = bench.with_margins(settings)?;
    Ok(Compensated {
        parts,
        before,
        after,
        corners: bench.corners(&sizes),
        settings,
        runs: [run_before, run_after],
    })
}

/// An order in which parts are taken, and how.
#[derive(Clone, Copy)]
struct Order {
    /// Ways are made longer by so much.
    longer: f64,
    /// How many of what was found come before the lag.
    before_lag: usize,
}

/// All that may make a difference: each of [`WAYS`], with the lag last, for it is what the others
/// leave, and right after the sensors: a little of another part can cost most of the lead.
fn orders(found: &[(&str, Sizes)]) -> Vec<Order> {
    let has_way = found.iter().any(|(_, sizes)| sizes.has_way());
    let ways = if has_way { &WAYS[..] } else { &WAYS[..1] };
    let sensors = found.iter().filter(|(name, _)| is_sensor(name)).count();
    let mut places = vec![found.len(), sensors];
    places.dedup();
    let of_way = |longer: &'static f64| {
        places.iter().map(|before_lag| Order {
            longer: *longer,
            before_lag: *before_lag,
        })
    };
    ways.iter().flat_map(of_way).collect()
}

/// What is taken, part by part.
struct Chosen {
    parts: Vec<Part>,
    sizes: Sizes,
    /// With these sizes; without margins.
    quality: Quality,
}

impl Chosen {
    fn none(before: &Quality) -> Chosen {
        Chosen {
            parts: Vec::new(),
            sizes: Sizes::default(),
            quality: *before,
        }
    }

    /// Of what was `found`, and of the lag that what is taken before it leaves.
    fn of(bench: &Bench, found: &[(&str, Sizes)], before: &Quality, order: Order) -> Chosen {
        let mut chosen = Chosen::none(before);
        let (early, late) = found.split_at(order.before_lag);
        for (name, sizes) in early {
            chosen.take(bench, name, sizes, before, order.longer);
        }
        let mut lag = Sizes::default();
        lag.0[LEAD] = lag_s(bench, &chosen.sizes);
        chosen.take(bench, LAG, &lag, before, order.longer);
        for (name, sizes) in late {
            chosen.take(bench, name, sizes, before, order.longer);
        }
        chosen
    }

    /// Adds the best share of what was `found` of `name`, if one holds.
    fn take(&mut self, bench: &Bench, name: &str, found: &Sizes, before: &Quality, longer: f64) {
        let is_sensor = is_sensor(name);
        let error = |quality: &Quality| match name {
            _ if is_sensor => quality.reading_error_pa_rms,
            LAG => quality.tracking.error_n_rms,
            _ => quality.load_error_n_rms,
        };
        let shares: &[f64] = if is_sensor { &[1.0] } else { &SHARES };
        let tried = shares.iter().filter_map(|share| {
            let sizes = self.sizes.with(found, *share, longer);
            let (quality, _) = bench.prove(sizes.settings(&bench.plain).ok()?).ok()?;
            Some((*share, sizes, quality))
        });
        let better = tried.filter(|(.., quality)| error(quality) < BETTER * error(&self.quality));
        let mut better: Vec<_> = better.collect();
        // Corners take long: those of the best first.
        better.sort_by(|(.., a), (.., b)| error(a).total_cmp(&error(b)));
        let mut better = better.into_iter();
        let taken = better.find(|(_, sizes, quality)| bench.holds(sizes, quality, before));
        let words = if let Some((share, sizes, quality)) = taken {
            let unit = if is_sensor { "Pa" } else { "N" };
            let (from, to) = (error(&self.quality), error(&quality));
            let percent = 100.0 * share;
            let way = if found.has_way() {
                format!(" over {longer:.1} times its way")
            } else {
                String::new()
            };
            (self.sizes, self.quality) = (sizes, quality);
            format!("{percent:.0} % of it{way}; the error falls from {from:.1} to {to:.1} {unit}")
        } else {
            "off: in this rig's closed loop it is not better, or not safely".into()
        };
        self.parts.push(Part {
            name: name.into(),
            compensated: taken.is_some(),
            words,
        });
    }
}

/// The part of an effect that has no turn of its own.
fn left_to(name: &str, by_lag: bool) -> Part {
    let is_lag = matches!(name, "valve-lag" | "transport-delay");
    Part {
        name: name.into(),
        compensated: is_lag && by_lag,
        words: if is_lag {
            "it is part of the lag"
        } else {
            reason(name)
        }
        .into(),
    }
}

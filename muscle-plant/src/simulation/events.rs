//! What ends a regime, located on a step's continuous extension: breakaway, standstill, the stop
//! and the flow's reversal.

use super::drive::Drive;
use super::integrate::Step;
use super::plant::{CONTRACTION, CONTRACTION_RATE, PRESSURE, Plant};
use super::trajectory::Trajectory;
use crate::subsystem::load::{LoadSubsystem, Motion};

/// Accuracy of the location of a change of motion, as a share of the step: below 1e-15 s of 10 ms.
const MOTION_FRACTION: f64 = 5e-14;
/// Accuracy of the location of a flow reversal, as a share of the step: only the heat transfer
/// jumps there, not the states.
const FLOW_FRACTION: f64 = 1e-6;
/// Contraction below which the weight touches the stop: far below the resolution of any encoder,
/// far above rounding.
const CONTACT: f64 = 1e-12;

/// An event that ends a regime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// The weight comes to rest, meets the stop, or breaks away.
    Motion,
    /// The flow into the muscle reverses.
    Flow,
}

impl<const N: usize> Trajectory<N> {
    /// Advances to `event` in `step` and into the regime that follows.
    pub(super) fn pass(
        &mut self,
        plant: &Plant,
        drive: &Drive,
        step: &Step<N>,
        fraction: f64,
        event: Event,
    ) {
        self.time_s += fraction * step.length_s;
        self.state = step.interpolate(fraction);
        match event {
            Event::Motion => self.change_motion(plant),
            Event::Flow => self.change_flow(plant, drive),
        }
        self.work.events += 1;
    }

    /// The first event in `step`, and its position as a fraction of the step.
    #[inline]
    pub(super) fn event(
        &self,
        plant: &Plant,
        drive: &Drive,
        step: &Step<N>,
    ) -> Option<(f64, Event)> {
        let motion = plant.load.as_ref().and_then(|load| {
            let end = self.motion_end(plant, load, step)?;
            Some((end, Event::Motion))
        });
        let flow = self
            .flow_end(plant, drive, step)
            .map(|end| (end, Event::Flow));
        match (motion, flow) {
            (Some(motion), Some(flow)) if flow.0 < motion.0 => Some(flow),
            (motion, flow) => motion.or(flow),
        }
    }

    /// Position in `step` at which the flow has reversed.
    #[inline]
    fn flow_end(&self, plant: &Plant, drive: &Drive, step: &Step<N>) -> Option<f64> {
        plant.pneumatics.as_ref()?;
        if self.sliding {
            return self.slide_end(plant, drive, step);
        }
        let sign = if self.regime.charging { 1.0 } else { -1.0 };
        let margin = |fraction: f64, state: &[f64]| {
            let time_s = self.time_s + fraction * step.length_s;
            sign * plant.flow_kg_per_s(time_s, drive, state) + self.flow_error_kg_per_s
        };
        (margin(1.0, &step.end) < 0.0).then(|| {
            bracket(1.0, FLOW_FRACTION, |fraction| {
                margin(fraction, &step.interpolate(fraction))
            })
            .1
        })
    }

    /// Position in `step` at which the flow leaves zero.
    #[cold]
    fn slide_end(&self, plant: &Plant, drive: &Drive, step: &Step<N>) -> Option<f64> {
        let margin = |fraction: f64, state: &[f64; N]| {
            let time_s = self.time_s + fraction * step.length_s;
            let share = plant.at_reversal(time_s, drive, self.regime, state).0;
            share.min(1.0 - share)
        };
        (margin(1.0, &step.end) < 0.0).then(|| {
            bracket(1.0, FLOW_FRACTION, |fraction| {
                margin(fraction, &step.interpolate(fraction))
            })
            .1
        })
    }

    /// Gives a flow at its reversal the other sign, or keeps it at zero: if charging makes it
    /// negative and discharging positive, it can have neither sign.
    fn change_flow(&mut self, plant: &Plant, drive: &Drive) {
        let (share, _) = plant.at_reversal(self.time_s, drive, self.regime, &self.state);
        if self.sliding {
            self.sliding = false;
            self.regime.charging = share > 0.5;
        } else {
            self.regime.charging = !self.regime.charging;
            self.sliding = share > 0.0 && share < 1.0;
        }
    }

    /// Position in `step` at which the weight comes to rest, meets the stop, or breaks away.
    #[inline]
    fn motion_end(&self, plant: &Plant, load: &LoadSubsystem, step: &Step<N>) -> Option<f64> {
        let (begin, end) = (&step.rates[0], &step.rates[6]);
        let sign = match self.regime.motion {
            Motion::Stuck => {
                let margin = |fraction: f64, state: &[f64]| {
                    let time_s = self.time_s + fraction * step.length_s;
                    -plant.breakaway_n(load, time_s, state).0
                };
                let margin_at = |fraction: f64| margin(fraction, &step.interpolate(fraction));
                // The pressure may pass a maximum within the step: check its middle too.
                let turns = begin[PRESSURE] * end[PRESSURE] < 0.0;
                return if turns && margin_at(0.5) < 0.0 {
                    Some(bracket(0.5, MOTION_FRACTION, margin_at).1)
                } else if margin(1.0, &step.end) < 0.0 {
                    Some(bracket(1.0, MOTION_FRACTION, margin_at).1)
                } else {
                    None
                };
            }
            Motion::Rising => 1.0,
            Motion::Falling => -1.0,
        };
        // The stop ends a fall, as standstill does.
        let margin = |state: &[f64; N]| {
            let speed_per_s = sign * state[CONTRACTION_RATE];
            if sign > 0.0 {
                speed_per_s
            } else {
                speed_per_s.min(state[CONTRACTION])
            }
        };
        let margin_at = |fraction: f64| margin(&step.interpolate(fraction));
        if margin(&step.end) < 0.0 {
            return Some(bracket(1.0, MOTION_FRACTION, margin_at).0);
        }
        // The speed may pass through zero and back within the step.
        if sign * begin[CONTRACTION_RATE] < 0.0 && sign * end[CONTRACTION_RATE] > 0.0 {
            let slopes = [begin, end].map(|rates| sign * step.length_s * rates[CONTRACTION_RATE]);
            let lowest = lowest(margin(&step.begin), margin(&step.end), slopes, margin_at);
            if margin_at(lowest) < 0.0 {
                return Some(bracket(lowest, MOTION_FRACTION, margin_at).0);
            }
        }
        None
    }

    /// Sets the next motion of a weight that has just come to rest, met the stop, or broken away.
    fn change_motion(&mut self, plant: &Plant) {
        let Some(load) = &plant.load else { return };
        self.state[CONTRACTION_RATE] = 0.0;
        // The weight meets the stop without rebound.
        if self.regime.motion == Motion::Falling && self.state[CONTRACTION] < CONTACT {
            self.state[CONTRACTION] = 0.0;
        }
        self.regime.motion = self.at_rest(plant, load);
    }
}

/// Position in [0, 1] of the minimum of `value`, from its values and slopes at the ends, of which
/// the first is negative and the second positive: that of the cubic through them, refined by a
/// parabola about it.
fn lowest(begin: f64, end: f64, slopes: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    let cubic = slopes[0] + slopes[1] + 2.0 * (begin - end);
    let square = 3.0 * (end - begin) - 2.0 * slopes[0] - slopes[1];
    let root = (square * square - 3.0 * cubic * slopes[0]).max(0.0).sqrt();
    let lowest = (-slopes[0] / (square + root)).clamp(0.01, 0.99);
    let half_width = 0.1 * lowest.min(1.0 - lowest);
    let [left, middle, right] = [lowest - half_width, lowest, lowest + half_width].map(value);
    let curvature = left - 2.0 * middle + right;
    if curvature > 0.0 {
        lowest + (0.5 * half_width * (left - right) / curvature).clamp(-half_width, half_width)
    } else {
        lowest
    }
}

/// Bracket of the root of `margin` in [0, `to`], where it is ≥ 0 at 0 and negative at `to`, of at
/// most `width_max`: the last position where it is not negative and the first where it is. Method
/// of Oliveira and Takahashi (ITP, ACM TOMS 47 (2020) 5): as few steps as regula falsi, and at most
/// one more than bisection.
fn bracket(to: f64, width_max: f64, margin: impl Fn(f64) -> f64) -> (f64, f64) {
    let (mut yes, mut no) = (0.0, to);
    let (mut margin_yes, mut margin_no) = (margin(yes).max(0.0), margin(no));
    let mut radius = to;
    while no - yes > width_max {
        let (width, middle) = (no - yes, 0.5 * (yes + no));
        let falsi = (yes * margin_no - no * margin_yes) / (margin_no - margin_yes);
        let truncation = (0.2 * width * width / to).min((middle - falsi).abs());
        let toward = (middle - falsi).signum();
        let truncated = falsi + toward * truncation;
        let place = if (truncated - middle).abs() <= radius - 0.5 * width + width_max {
            truncated
        } else {
            middle - toward * (radius - 0.5 * width + width_max)
        };
        // Rounding must not put the position outside the bracket or on its edge.
        let place = if place > yes && place < no {
            place
        } else {
            middle
        };
        let found = margin(place);
        if found >= 0.0 {
            (yes, margin_yes) = (place, found);
        } else {
            (no, margin_no) = (place, found);
        }
        radius *= 0.5;
    }
    (yes, no)
}

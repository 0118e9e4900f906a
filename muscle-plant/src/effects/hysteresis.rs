//! `hysteresis`: friction between braid and bladder, so that the force depends on where the last
//! reversal was.
//!
//! All forms are rate-independent and oppose the motion: the muscle pulls less while it contracts
//! than while it extends. Most of the friction is proportional to the pressure, which presses the
//! threads together; the share of the rubber itself is present without pressure.

use super::{
    CompensationMethod, EffectKind, Equation, Form, Observation, Parameter, Quantity,
    REFERENCE_PRESSURE_PA, Requirement,
};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::muscle::Muscle;

const FORCE_N: Parameter = Parameter::new("force_n", "N", (0.0, 1e3), 20.0).neutral(0.0);
/// Presliding distance. With a shorter one the effect is friction, with one as long as the stroke
/// it is elasticity.
const PRESLIDING_DISTANCE: Parameter = Parameter::new("reach", "1", (1e-4, 0.5), 0.02)
    .log()
    .physical_min()
    .physical_max();
/// What does not grow with pressure at all is `friction`.
const BASE_SHARE: Parameter = Parameter::new("base_share", "1", (0.0, 1.0), 0.2).physical_max();

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "hysteresis",
    subsystem: Subsystem::MuscleForce,
    equations: &[Equation::MuscleForce],
    requires: &[Requirement::Motion, Requirement::TwoReversals],
    signature: "The force depends on the direction and on where the last reversal was, not on the \
                speed; there are minor loops; the loop is wider at higher pressure.",
    test_signal: "triangles of pressure with minor loops at two loads; a loop in force that grows \
                  with pressure and not with speed is hysteresis.",
    discrepancy_ratio: 0.1,
    law_quantities: &[
        Quantity::Pressure,
        Quantity::Contraction,
        Quantity::ContractionRate,
    ],
    compensation: CompensationMethod::HysteresisLoop,
    forms: &[
        Form {
            name: "maxwell-slip",
            parameters: &[
                FORCE_N,
                PRESLIDING_DISTANCE,
                Parameter::new("spread", "1", (1.0, 300.0), 8.0).log(),
                Parameter::new("taper", "1", (0.0, 2.0), 0.5),
                BASE_SHARE,
            ],
            equation: "F = Eq 1 − force_n · (base_share + (1 − base_share) · P/300 kPa) · z; z = \
                       Σ wᵢ · (ε − sᵢ)/dᵢ over six elements, whose sliders sᵢ stay within dᵢ of \
                       ε; dᵢ from reach/√spread to reach·√spread at equal ratios, wᵢ proportional \
                       to dᵢ^(−taper), Σ wᵢ = 1",
            source: "Prandtl–Ishlinskii sum of stop elements (Maxwell slip) in contraction; its \
                     size is half the loop's width at 300 kPa. The thresholds are a geometric \
                     progression about the reach, the largest the spread times the smallest; the \
                     heights fall with the power `taper` of the thresholds. Shin & Kogiso 2020, \
                     Tondu 2012.",
            leaves_out: "loops that are wider in one direction",
            build: &|values| {
                let thresholds = thresholds(values[1], values[2]);
                Term::Muscle(Box::new(MaxwellSlip {
                    size: Size::new(values),
                    thresholds,
                    shares: shares(&thresholds, values[3]),
                }))
            },
            observation: Some(&|_| Box::new(MotionMemory)),
        },
        Form {
            name: "bouc-wen",
            parameters: &[
                FORCE_N,
                PRESLIDING_DISTANCE,
                Parameter::new("sharpness", "1", (1.0, 10.0), 2.0).log(),
                BASE_SHARE,
            ],
            equation: "F = Eq 1 − force_n · (base_share + (1 − base_share) · P/300 kPa) · z; \
                       dz/dε = (1 − |z|^sharpness)/reach while |z| grows, 1/reach while it falls",
            source: "Bouc–Wen with equal shares of loading and unloading (Wen 1976).",
            leaves_out: "closed minor loops: a small one drifts",
            build: &|values| {
                Term::Muscle(Box::new(BoucWen {
                    size: Size::new(values),
                    presliding_distance: values[1],
                    sharpness: values[2],
                }))
            },
            observation: Some(&|_| Box::new(MotionMemory)),
        },
        Form {
            name: "duhem",
            parameters: &[
                FORCE_N,
                PRESLIDING_DISTANCE,
                // Friction in one direction only is not a hysteresis.
                Parameter::new("asymmetry", "1", (0.2, 5.0), 1.5)
                    .log()
                    .physical_min()
                    .physical_max(),
                BASE_SHARE,
            ],
            equation: "F = Eq 1 − force_n · (base_share + (1 − base_share) · P/300 kPa) · z; \
                       dz/dε = (1 − z)/reach while ε rises, (1 + z/asymmetry)/reach while it \
                       falls",
            source: "Duhem of first order (Dahl where the asymmetry is 1): the force approaches \
                     its bound exponentially with the distance moved; bound and distance are \
                     larger by the asymmetry while the muscle extends.",
            leaves_out: "closed minor loops",
            build: &|values| {
                Term::Muscle(Box::new(Duhem {
                    size: Size::new(values),
                    presliding_distance: values[1],
                    asymmetry: values[2],
                }))
            },
            observation: Some(&|_| Box::new(MotionMemory)),
        },
    ],
};

/// The friction force as a function of the pressure.
struct Size {
    /// At 300 kPa \[N\].
    force_n: f64,
    /// Share of it at no pressure \[-\].
    base_share: f64,
}

impl Size {
    /// From the values of a form: the first is the force, the last the base share.
    fn new(values: &[f64]) -> Size {
        Size {
            force_n: values[0],
            base_share: values[values.len() - 1],
        }
    }

    /// `force_n` less friction of relative size `share`: 1 if all of it opposes contracting.
    fn opposing(&self, point: &MusclePoint, share: f64, force_n: f64) -> f64 {
        let pressure = point.pressure.0.max(0.0) / REFERENCE_PRESSURE_PA;
        let ratio = self.base_share + (1.0 - self.base_share) * pressure;
        force_n - self.force_n * ratio * share
    }
}

/// Elements of the sum: with fewer the corners between them are visible in the force.
const ELEMENTS: usize = 6;

/// A diagnosis must know that the force depends on the motion before the record.
struct MotionMemory;

impl Observation for MotionMemory {
    fn has_motion_memory(&self) -> bool {
        true
    }
}

/// Each element is a spring in series with a slider. The states are the positions of the sliders.
struct MaxwellSlip {
    size: Size,
    /// Extension of each element's spring at which its slider moves \[-\].
    thresholds: [f64; ELEMENTS],
    /// Share of the friction force that each element holds then \[-\].
    shares: [f64; ELEMENTS],
}

/// A geometric progression about `centre`, the last `spread` times the first.
fn thresholds(centre: f64, spread: f64) -> [f64; ELEMENTS] {
    let exponent = |i| i as f64 / (ELEMENTS - 1) as f64 - 0.5;
    core::array::from_fn(|i| centre * spread.powf(exponent(i)))
}

/// Shares with a sum of 1 that fall with the power `taper` of the thresholds.
fn shares(thresholds: &[f64; ELEMENTS], taper: f64) -> [f64; ELEMENTS] {
    let heights = thresholds.map(|threshold| (threshold / thresholds[0]).powf(-taper));
    let sum: f64 = heights.iter().sum();
    heights.map(|height| height / sum)
}

impl Dynamics<MusclePoint> for MaxwellSlip {
    fn states(&self) -> usize {
        ELEMENTS
    }

    // As after a contraction from the full length.
    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        for (slider, threshold) in state.iter_mut().zip(&self.thresholds) {
            *slider = point.contraction - point.contraction.clamp(-*threshold, *threshold);
        }
    }

    fn bias_memory(&self, point: &MusclePoint, share: f64, state: &mut [f64]) {
        for (slider, threshold) in state.iter_mut().zip(&self.thresholds) {
            *slider = point.contraction - share * threshold;
        }
    }

    fn accept_step(&self, point: &MusclePoint, state: &mut [f64]) {
        for (slider, threshold) in state.iter_mut().zip(&self.thresholds) {
            *slider = slider.clamp(point.contraction - threshold, point.contraction + threshold);
        }
    }
}

impl MuscleTerm for MaxwellSlip {
    fn force_n(&self, point: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        let elements = state.iter().zip(&self.thresholds).zip(&self.shares);
        let held = elements.map(|((slider, threshold), share)| {
            share * ((point.contraction - slider) / threshold).clamp(-1.0, 1.0)
        });
        self.size.opposing(point, held.sum(), force_n)
    }
}

/// dz = dε/d · (1 − |z|ⁿ) while |z| grows, dε/d while it falls; d is the presliding distance and n
/// the sharpness. The state is z.
struct BoucWen {
    size: Size,
    presliding_distance: f64,
    sharpness: f64,
}

impl BoucWen {
    /// dz over dε/d in the direction of motion.
    fn slope(&self, direction: f64, z: f64) -> f64 {
        1.0 - (direction * z).max(0.0).powf(self.sharpness)
    }

    /// z after a change of the contraction. It has no closed form: classical Runge–Kutta.
    fn moved(&self, z: f64, change: f64) -> f64 {
        let (direction, distance) = (change.signum(), change.abs() / self.presliding_distance);
        let steps = (distance / DISTANCE_STEP).ceil();
        let step = distance / steps.max(1.0);
        // z in the direction of motion, at most 1.
        let mut deflection = direction * z;
        let slope = |deflection: f64| self.slope(1.0, deflection);
        for _ in 0..steps as u64 {
            if deflection > 1.0 - SATURATED {
                break;
            }
            let first = slope(deflection);
            let second = slope(deflection + 0.5 * step * first);
            let third = slope(deflection + 0.5 * step * second);
            let last = slope(deflection + step * third);
            deflection += step * (first + 2.0 * (second + third) + last) / 6.0;
        }
        direction * deflection.min(1.0)
    }
}

/// Step over which z is integrated, in presliding distances.
const DISTANCE_STEP: f64 = 0.1;
/// Distance of z from 1 below which it no longer changes.
const SATURATED: f64 = 1e-9;

impl Dynamics<MusclePoint> for BoucWen {
    fn states(&self) -> usize {
        1
    }

    // As after a contraction from the full length.
    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        state[0] = self.moved(0.0, point.contraction.max(0.0));
    }

    fn bias_memory(&self, _: &MusclePoint, share: f64, state: &mut [f64]) {
        state[0] = share;
    }

    fn rates(&self, point: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let slope = self.slope(point.direction, state[0]);
        rates[0] = point.contraction_rate_per_s / self.presliding_distance * slope;
    }

    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        state[0] = self.moved(state[0], to.contraction - from.contraction);
    }
}

impl MuscleTerm for BoucWen {
    fn force_n(&self, point: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        self.size.opposing(point, state[0], force_n)
    }
}

/// dz = dε/d · (1 − z) while the muscle contracts, dε/d · (1 + z/asymmetry) while it extends; d is
/// the presliding distance. The state is z.
struct Duhem {
    size: Size,
    presliding_distance: f64,
    asymmetry: f64,
}

impl Dynamics<MusclePoint> for Duhem {
    fn states(&self) -> usize {
        1
    }

    // As after a contraction from the full length.
    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        state[0] = 1.0 - (-point.contraction.max(0.0) / self.presliding_distance).exp();
    }

    fn bias_memory(&self, _: &MusclePoint, share: f64, state: &mut [f64]) {
        state[0] = share * if share < 0.0 { self.asymmetry } else { 1.0 };
    }

    fn rates(&self, point: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let slope = if point.direction < 0.0 {
            1.0 + state[0] / self.asymmetry
        } else {
            1.0 - state[0]
        };
        rates[0] = point.contraction_rate_per_s / self.presliding_distance * slope;
    }

    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        let change = to.contraction - from.contraction;
        let (bound, distance) = if change < 0.0 {
            (-self.asymmetry, self.presliding_distance * self.asymmetry)
        } else {
            (1.0, self.presliding_distance)
        };
        state[0] = bound + (state[0] - bound) * (-change.abs() / distance).exp();
    }
}

impl MuscleTerm for Duhem {
    fn force_n(&self, point: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        self.size.opposing(point, state[0], force_n)
    }
}

#[cfg(test)]
mod tests;

//! `hysteresis`: braid and bladder rub, so that the force depends on where the last reversal was.
//!
//! All forms are rate-independent and oppose the motion: the muscle pulls less while it contracts
//! than while it pays out. Most of it is in proportion to the pressure, which presses the threads
//! together; the rubber's own share is there without any.

use super::{EffectKind, Form, Parameter, REFERENCE_PRESSURE_PA};
use crate::subsystem::Term;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use model_core::muscle::Muscle;

const FORCE_N: Parameter = Parameter::new("force_n", "N", (0.0, 1e3), 20.0).neutral(0.0);
/// With a shorter one it is friction, and with one as long as the muscle elasticity.
const REACH: Parameter = Parameter::new("reach", "1", (1e-4, 0.5), 0.02)
    .log()
    .ends_at_min()
    .ends_at_max();
/// What does not grow with pressure is friction.
const BASE_SHARE: Parameter = Parameter::new("base_share", "1", (0.0, 0.6), 0.2).ends_at_max();

pub(super) const KIND: EffectKind = EffectKind {
    name: "hysteresis",
    place: "muscle-force",
    signature: "The force depends on the direction and on where the last reversal was, not on the \
           speed; there are minor loops; the loop is wider at higher pressure.",
    test_signal: "triangles of pressure with minor loops at two loads; a loop in force that grows \
                 with \
                 pressure and not with speed is hysteresis.",
    forms: &[
        Form {
            name: "maxwell-slip",
            parameters: &[
                FORCE_N,
                REACH,
                Parameter::new("spread", "1", (1.0, 300.0), 8.0).log(),
                Parameter::new("taper", "1", (0.0, 2.0), 0.5),
                BASE_SHARE,
            ],
            source: "Prandtl–Ishlinskii sum of stop elements (Maxwell slip) in contraction, half \
                     the loop's width at 300 kPa as its size; the thresholds in a geometric \
                     progression about the reach, the largest the spread times the smallest, the \
                     heights falling with this power of them; Shin & Kogiso 2020, Tondu 2012. \
                     Leaves out loops that are wider one way than the other.",
            build: |values| {
                let thresholds = thresholds(values[1], values[2]);
                Term::Muscle(Box::new(MaxwellSlip {
                    size: Size::new(values),
                    thresholds,
                    shares: shares(&thresholds, values[3]),
                }))
            },
        },
        Form {
            name: "bouc-wen",
            parameters: &[
                FORCE_N,
                REACH,
                Parameter::new("sharpness", "1", (1.0, 10.0), 2.0).log(),
                BASE_SHARE,
            ],
            source: "Bouc–Wen with equal shares of loading and unloading (Wen 1976). \
                     Leaves out closed minor loops: a small one drifts.",
            build: |values| {
                Term::Muscle(Box::new(BoucWen {
                    size: Size::new(values),
                    reach: values[1],
                    sharpness: values[2],
                }))
            },
        },
        Form {
            name: "duhem",
            parameters: &[
                FORCE_N,
                REACH,
                // What acts in one direction only is not this.
                Parameter::new("asymmetry", "1", (0.2, 5.0), 1.5)
                    .log()
                    .ends_at_min()
                    .ends_at_max(),
                BASE_SHARE,
            ],
            source: "Duhem of first order (Dahl where the asymmetry is 1): the force approaches \
                     its bound exponentially with the way, the bound and the way of paying out \
                     larger by the asymmetry. Leaves out closed minor loops.",
            build: |values| {
                Term::Muscle(Box::new(Duhem {
                    size: Size::new(values),
                    reach: values[1],
                    asymmetry: values[2],
                }))
            },
        },
    ],
};

/// How large the friction is, by the pressure.
struct Size {
    /// At 300 kPa \[N\].
    force_n: f64,
    /// Share of it at no pressure \[-\].
    base_share: f64,
}

impl Size {
    /// From the values of a form, whose first and last they are.
    fn new(values: &[f64]) -> Size {
        Size {
            force_n: values[0],
            base_share: values[values.len() - 1],
        }
    }

    /// `force_n` less friction of relative size `share`, 1 when it opposes contracting in full.
    fn opposing(&self, at: &MusclePoint, share: f64, force_n: f64) -> f64 {
        let pressure = at.pressure.0.max(0.0) / REFERENCE_PRESSURE_PA;
        let of_pressure = self.base_share + (1.0 - self.base_share) * pressure;
        force_n - self.force_n * of_pressure * share
    }
}

/// Elements of the sum: with fewer the corners between them show.
const ELEMENTS: usize = 6;

/// Each element is a spring in series with a slider. The states are the sliders' places.
struct MaxwellSlip {
    size: Size,
    /// How far the spring of each element can be stretched \[-\].
    thresholds: [f64; ELEMENTS],
    /// Share of the whole that each holds then \[-\].
    shares: [f64; ELEMENTS],
}

/// A geometric progression about `reach`, the last `spread` times the first.
fn thresholds(reach: f64, spread: f64) -> [f64; ELEMENTS] {
    let place = |i| i as f64 / (ELEMENTS - 1) as f64 - 0.5;
    core::array::from_fn(|i| reach * spread.powf(place(i)))
}

/// Together 1, and falling with a power of the thresholds.
fn shares(thresholds: &[f64; ELEMENTS], taper: f64) -> [f64; ELEMENTS] {
    let heights = thresholds.map(|threshold| (threshold / thresholds[0]).powf(-taper));
    let whole: f64 = heights.iter().sum();
    heights.map(|height| height / whole)
}

impl Dynamics<MusclePoint> for MaxwellSlip {
    fn states(&self) -> usize {
        ELEMENTS
    }

    // As if it had been drawn in from its full length.
    fn steady_state(&self, at: &MusclePoint, state: &mut [f64]) {
        for (slider, threshold) in state.iter_mut().zip(&self.thresholds) {
            *slider = at.contraction - at.contraction.clamp(-*threshold, *threshold);
        }
    }

    fn bias_memory(&self, at: &MusclePoint, share: f64, state: &mut [f64]) {
        for (slider, threshold) in state.iter_mut().zip(&self.thresholds) {
            *slider = at.contraction - share * threshold;
        }
    }

    fn accept_step(&self, at: &MusclePoint, state: &mut [f64]) {
        for (slider, threshold) in state.iter_mut().zip(&self.thresholds) {
            *slider = slider.clamp(at.contraction - threshold, at.contraction + threshold);
        }
    }
}

impl MuscleTerm for MaxwellSlip {
    fn force_n(&self, at: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        let elements = state.iter().zip(&self.thresholds).zip(&self.shares);
        let held = elements.map(|((slider, threshold), share)| {
            share * ((at.contraction - slider) / threshold).clamp(-1.0, 1.0)
        });
        self.size.opposing(at, held.sum(), force_n)
    }

    fn remembers(&self) -> bool {
        true
    }
}

/// dz = dε/reach · (1 − |z|ⁿ) while z grows, dε/reach while it shrinks.
struct BoucWen {
    size: Size,
    reach: f64,
    sharpness: f64,
}

impl BoucWen {
    /// dz over dε/reach, in the direction of motion.
    fn slope(&self, direction: f64, z: f64) -> f64 {
        1.0 - (direction * z).max(0.0).powf(self.sharpness)
    }

    /// z after a way, which has no closed form.
    fn walked(&self, z: f64, way: f64) -> f64 {
        let (direction, reaches) = (way.signum(), way.abs() / self.reach);
        let steps = (reaches / WALK_STEP).ceil();
        let step = reaches / steps.max(1.0);
        // How far it leans in the direction of motion, at most 1.
        let mut leaning = direction * z;
        let slope = |leaning: f64| self.slope(1.0, leaning);
        for _ in 0..steps as u64 {
            if leaning > 1.0 - WALK_END {
                break;
            }
            let first = slope(leaning);
            let second = slope(leaning + 0.5 * step * first);
            let third = slope(leaning + 0.5 * step * second);
            let last = slope(leaning + step * third);
            leaning += step * (first + 2.0 * (second + third) + last) / 6.0;
        }
        direction * leaning.min(1.0)
    }
}

/// Steps of a Bouc–Wen's way \[reaches\], and from where on it is at its end.
const WALK_STEP: f64 = 0.1;
const WALK_END: f64 = 1e-9;

impl Dynamics<MusclePoint> for BoucWen {
    fn states(&self) -> usize {
        1
    }

    // As if it had been drawn in from its full length.
    fn steady_state(&self, at: &MusclePoint, state: &mut [f64]) {
        state[0] = self.walked(0.0, at.contraction.max(0.0));
    }

    fn bias_memory(&self, _: &MusclePoint, share: f64, state: &mut [f64]) {
        state[0] = share;
    }

    fn rates(&self, at: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let slope = self.slope(at.direction, state[0]);
        rates[0] = at.contraction_rate_per_s / self.reach * slope;
    }

    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        state[0] = self.walked(state[0], to.contraction - from.contraction);
    }
}

impl MuscleTerm for BoucWen {
    fn force_n(&self, at: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        self.size.opposing(at, state[0], force_n)
    }

    fn remembers(&self) -> bool {
        true
    }
}

/// dz = dε/reach · (1 − z) contracting, dε/reach · (1 + z/asymmetry) paying out.
struct Duhem {
    size: Size,
    reach: f64,
    asymmetry: f64,
}

impl Dynamics<MusclePoint> for Duhem {
    fn states(&self) -> usize {
        1
    }

    // As if it had been drawn in from its full length.
    fn steady_state(&self, at: &MusclePoint, state: &mut [f64]) {
        state[0] = 1.0 - (-at.contraction.max(0.0) / self.reach).exp();
    }

    fn bias_memory(&self, _: &MusclePoint, share: f64, state: &mut [f64]) {
        state[0] = share * if share < 0.0 { self.asymmetry } else { 1.0 };
    }

    fn rates(&self, at: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let left = if at.direction < 0.0 {
            1.0 + state[0] / self.asymmetry
        } else {
            1.0 - state[0]
        };
        rates[0] = at.contraction_rate_per_s / self.reach * left;
    }

    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        let way = to.contraction - from.contraction;
        let (end, reach) = if way < 0.0 {
            (-self.asymmetry, self.reach * self.asymmetry)
        } else {
            (1.0, self.reach)
        };
        state[0] = end + (state[0] - end) * (-way.abs() / reach).exp();
    }
}

impl MuscleTerm for Duhem {
    fn force_n(&self, at: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        self.size.opposing(at, state[0], force_n)
    }

    fn remembers(&self) -> bool {
        true
    }
}

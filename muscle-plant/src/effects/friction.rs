//! `friction`: more friction on the weight than the nominal rig has.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::load::{LoadPoint, LoadTerm};
use crate::subsystem::term::Dynamics;
use crate::nominal::Weight;

const FORCE_N: Parameter = Parameter::new("force_n", "N", (0.0, 1e3), 8.0).neutral(0.0);
/// What holds a weight by more than this is no friction.
const STATIC_RATIO: Parameter = Parameter::new("static_ratio", "1", (1.0, 4.0), 1.3).ends_at_max();

pub(super) const KIND: EffectKind = EffectKind {
    name: "friction",
    place: "load",
    signature: "The weight sticks at reversals and its motion is flat at the top, whatever the pressure \
           and the position.",
    test_signal: "triangles at two pressures and two weights; friction does not change with \
                 pressure.",
    forms: &[
        Form {
            name: "coulomb",
            parameters: &[FORCE_N],
            source: "The same force on top of static and Coulomb friction. Leaves out pre-sliding \
                     and any dependence on speed.",
            build: |values| {
                Term::Load(Box::new(Stribeck {
                    force_n: values[0],
                    static_ratio: 1.0,
                    speed_m_per_s: 1.0,
                }))
            },
        },
        Form {
            name: "stribeck",
            parameters: &[
                FORCE_N,
                STATIC_RATIO,
                Parameter::new("speed_m_per_s", "m/s", (1e-4, 1.0), 1e-2).log(),
            ],
            source: "Coulomb and a static excess over it that falls as a Gaussian of the speed; \
                     Olsson et al. 1998. Leaves out pre-sliding.",
            build: |values| {
                Term::Load(Box::new(Stribeck {
                    force_n: values[0],
                    static_ratio: values[1],
                    speed_m_per_s: values[2],
                }))
            },
        },
        Form {
            name: "lugre",
            parameters: &[
                FORCE_N,
                STATIC_RATIO,
                // With more it is a hysteresis.
                Parameter::new("deflection_m", "m", (2e-5, 2e-3), 2e-4)
                    .log()
                    .ends_at_max(),
            ],
            source: "Bristles that deflect before they slide (Canudas de Wit 1995, Olsson et al. \
                     1998), with a Stribeck speed of 10 mm/s. Leaves out the bristles' damping, \
                     for which the load's own stands.",
            build: |values| {
                Term::Load(Box::new(LuGre {
                    force_n: values[0],
                    static_ratio: values[1],
                    deflection_m: values[2],
                }))
            },
        },
    ],
};

struct Stribeck {
    force_n: f64,
    static_ratio: f64,
    speed_m_per_s: f64,
}

impl Dynamics<LoadPoint> for Stribeck {}

impl LoadTerm for Stribeck {
    fn change(&self, at: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        let speed_m_per_s = at.initial_length_m * at.contraction_rate_per_s;
        let relative = speed_m_per_s / self.speed_m_per_s;
        let excess = match self.static_ratio - 1.0 {
            0.0 => 0.0,
            excess => excess * (-relative * relative).exp(),
        };
        weight.coulomb_friction_n += self.force_n * (1.0 + excess);
        weight.static_friction_n += self.force_n * self.static_ratio;
    }
}

/// Stribeck speed of the LuGre form \[m/s\].
const LUGRE_SPEED_M_PER_S: f64 = 1e-2;

/// The state is the bristles' deflection over the one at which Coulomb friction is reached.
struct LuGre {
    force_n: f64,
    static_ratio: f64,
    deflection_m: f64,
}

impl Dynamics<LoadPoint> for LuGre {
    fn states(&self) -> usize {
        1
    }

    fn bias_memory(&self, _: &LoadPoint, share: f64, state: &mut [f64]) {
        state[0] = share * self.static_ratio;
    }

    fn rates(&self, at: &LoadPoint, state: &[f64], rates: &mut [f64]) {
        let speed_m_per_s = at.initial_length_m * at.contraction_rate_per_s;
        let relative = speed_m_per_s / LUGRE_SPEED_M_PER_S;
        let steady = 1.0 + (self.static_ratio - 1.0) * (-relative * relative).exp();
        rates[0] = speed_m_per_s / self.deflection_m * (1.0 - at.direction * state[0] / steady);
    }
}

impl LoadTerm for LuGre {
    fn change(&self, _: &LoadPoint, state: &[f64], _: &mut Weight, force_n: &mut f64) {
        *force_n -= self.force_n * state[0];
    }
}

//! `friction`: more dry friction on the weight than the nominal rig has, or another.

use super::{
    AddedFriction, CompensationMethod, DISCREPANCY_RATIO, Effect, EffectKind, Equation, Form,
    Parameter, Quantity, Requirement,
};
use crate::nominal::Weight;
use crate::subsystem::load::{LoadPoint, LoadTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

const FORCE_N: Parameter = Parameter::new("force_n", "N", (0.0, 1e3), 8.0).neutral(0.0);
/// A larger ratio of breakaway to sliding force is not dry friction.
const STATIC_RATIO: Parameter = Parameter::new("static_ratio", "1", (1.0, 4.0), 1.3).physical_max();

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "friction",
    subsystem: Subsystem::Load,
    equations: &[Equation::Load],
    requires: &[Requirement::Motion, Requirement::TwoReversals],
    signature: "The weight sticks at reversals and its motion is flat at the top, at any pressure \
                and position.",
    test_signal: "triangles at two pressures and two weights; friction does not change with \
                  pressure.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::ContractionRate],
    compensation: CompensationMethod::Friction(added_friction),
    forms: &[
        Form {
            name: "coulomb",
            parameters: &[FORCE_N],
            equation: "Eq 5 with coulomb_friction_n + force_n and static_friction_n + force_n",
            source: "One force added to static and to Coulomb friction.",
            leaves_out: "presliding and any dependence on speed",
            build: &|values| {
                Term::Load(Box::new(Stribeck {
                    force_n: values[0],
                    static_ratio: 1.0,
                    speed_m_per_s: 1.0,
                }))
            },
            observation: None,
        },
        Form {
            name: "stribeck",
            parameters: &[
                FORCE_N,
                STATIC_RATIO,
                Parameter::new("speed_m_per_s", "m/s", (1e-4, 1.0), 1e-2).log(),
            ],
            equation: "Eq 5 with coulomb_friction_n + force_n · (1 + (static_ratio − 1) · \
                       exp(−(v/speed_m_per_s)²)) and static_friction_n + force_n · static_ratio",
            source: "Coulomb friction and a static excess that falls as a Gaussian of the speed; \
                     Olsson et al. 1998.",
            leaves_out: "presliding",
            build: &|values| {
                Term::Load(Box::new(Stribeck {
                    force_n: values[0],
                    static_ratio: values[1],
                    speed_m_per_s: values[2],
                }))
            },
            observation: None,
        },
        Form {
            name: "lugre",
            parameters: &[
                // With none the nominal friction still deflects.
                Parameter::new("force_n", "N", (0.0, 1e3), 8.0),
                STATIC_RATIO,
                // A larger deflection is a hysteresis of the muscle.
                Parameter::new("deflection_m", "m", (2e-5, 2e-3), 2e-4)
                    .log()
                    .physical_max(),
            ],
            equation: "Eq 5 with F − (force_n + coulomb_friction_n) · z in the place of the dry \
                       friction; dz/dt = v/deflection_m · (1 − sgn(v) · z/g), g = 1 + \
                       (static_ratio − 1) · exp(−(v/(10 mm/s))²)",
            source: "Bristles that deflect before they slide (Canudas de Wit 1995, Olsson et al. \
                     1998), with a Stribeck speed of 10 mm/s. They carry the nominal friction, \
                     too, as of the same contact, and static_friction_n has no effect.",
            leaves_out: "the damping of the bristles beside that of the load: a held weight swings \
                         on them by tenths of a millimetre",
            build: &|values| {
                Term::Load(Box::new(LuGre {
                    force_n: values[0],
                    static_ratio: values[1],
                    deflection_m: values[2],
                }))
            },
            observation: None,
        },
    ],
};

/// Of bristles, which carry the nominal friction too, as if they carried the added one alone: their
/// static friction is larger by what the nominal one's ratio differs.
fn added_friction(effect: &Effect) -> AddedFriction {
    let coulomb_n = effect.value("force_n").unwrap_or(0.0);
    AddedFriction {
        coulomb_n,
        static_n: coulomb_n * effect.value("static_ratio").unwrap_or(1.0),
        presliding_m: effect.value("deflection_m").unwrap_or(0.0),
    }
}

struct Stribeck {
    force_n: f64,
    static_ratio: f64,
    speed_m_per_s: f64,
}

impl Dynamics<LoadPoint> for Stribeck {}

impl LoadTerm for Stribeck {
    fn change(&self, point: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        let speed_m_per_s = point.initial_length_m * point.contraction_rate_per_s;
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

/// The state is the deflection of the bristles, relative to the one at Coulomb friction.
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

    fn rates(&self, point: &LoadPoint, state: &[f64], rates: &mut [f64]) {
        let speed_m_per_s = point.initial_length_m * point.contraction_rate_per_s;
        let relative = speed_m_per_s / LUGRE_SPEED_M_PER_S;
        let steady = 1.0 + (self.static_ratio - 1.0) * (-relative * relative).exp();
        rates[0] = speed_m_per_s / self.deflection_m * (1.0 - point.direction * state[0] / steady);
    }
}

impl LoadTerm for LuGre {
    fn change(&self, _: &LoadPoint, state: &[f64], weight: &mut Weight, force_n: &mut f64) {
        *force_n -= (self.force_n + weight.coulomb_friction_n) * state[0];
        weight.coulomb_friction_n = 0.0;
        weight.static_friction_n = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{effect, largest_difference, run, steps};
    use super::KIND;
    use crate::effects::Effect;
    use crate::nominal::{Load, Nominal, Weight};

    fn contraction(nominal: &Nominal, effects: &[Effect]) -> Vec<f64> {
        run(nominal, effects, &steps(4.0)).contraction
    }

    /// Contraction of the reference rig with 8 N more dry friction.
    fn with_more_friction() -> Vec<f64> {
        let nominal = Nominal::REFERENCE;
        let Load::Weight(weight) = nominal.load else {
            panic!("the reference rig has a weight");
        };
        let rough = Nominal {
            load: Load::Weight(Weight {
                coulomb_friction_n: weight.coulomb_friction_n + 8.0,
                static_friction_n: weight.static_friction_n + 8.0,
                ..weight
            }),
            ..nominal
        };
        contraction(&rough, &[])
    }

    #[test]
    fn coulomb_friction_adds_to_that_of_the_rig() {
        let coulomb = effect(&KIND, "coulomb", &[("force_n", 8.0)]);
        assert_eq!(
            contraction(&Nominal::REFERENCE, &[coulomb]),
            with_more_friction()
        );
    }

    /// At a Stribeck speed far above any speed of the rig the static excess acts as Coulomb
    /// friction; far below it acts at rest only.
    #[test]
    fn stribeck_friction_is_coulomb_friction_in_its_limits() {
        let stribeck = |static_ratio: f64, speed_m_per_s: f64| {
            let parameters = [
                ("force_n", 8.0 / static_ratio),
                ("static_ratio", static_ratio),
                ("speed_m_per_s", speed_m_per_s),
            ];
            contraction(
                &Nominal::REFERENCE,
                &[effect(&KIND, "stribeck", &parameters)],
            )
        };
        let coulomb = with_more_friction();
        assert_eq!(stribeck(1.0, 0.01), coulomb);
        let slow = largest_difference(&stribeck(4.0, 0.01), &coulomb);
        assert!(largest_difference(&stribeck(4.0, 1.0), &coulomb) < 0.2 * slow);
    }

    /// Bristles with a small deflection are Coulomb friction, but for the static part.
    #[test]
    fn stiff_bristles_are_coulomb_friction() {
        let parameters = [
            ("force_n", 8.0),
            ("static_ratio", 1.0),
            ("deflection_m", 2e-5),
        ];
        let bristles = contraction(&Nominal::REFERENCE, &[effect(&KIND, "lugre", &parameters)]);
        let coulomb = with_more_friction();
        let nominal = contraction(&Nominal::REFERENCE, &[]);
        let whole = largest_difference(&nominal, &coulomb);
        assert!(largest_difference(&bristles, &coulomb) < 0.3 * whole);
    }
}

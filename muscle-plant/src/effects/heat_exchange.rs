//! `heat-exchange`: the heat transfer between the air and the muscle's wall is not the nominal one.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
use crate::subsystem::gas::{Exchange, GasPoint, GasTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

/// Heat capacity of a wall that stays at ambient temperature, to rounding \[J/(m²·K)\].
const LARGE_J_PER_M2_K: f64 = 1e12;

const FACTOR: Parameter = Parameter::new("factor", "1", (1e-2, 1e3), 5.0)
    .log()
    .neutral(1.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "heat-exchange",
    subsystem: Subsystem::Gas,
    equations: &[Equation::Gas],
    requires: &[Requirement::ReferenceStep],
    signature: "The pressure overshoots or recovers within 0.05 to 0.5 s of a fast step.",
    test_signal: "steps with the valve shut just after them; the pressure recovers within half a \
                  second.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[
        Quantity::Pressure,
        Quantity::PressureRate,
        Quantity::Contraction,
        Quantity::ContractionRate,
    ],
    compensation: CompensationMethod::Unavailable(
        "the valve's own pressure loop corrects most of it",
    ),
    forms: &[
        Form {
            name: "factor",
            parameters: &[FACTOR],
            equation: "Eq 4 with factor · h",
            source: "The nominal coefficient times a factor, with walls at ambient temperature.",
            leaves_out: "walls that warm up, and a coefficient that depends on the flow",
            build: &|values| Term::Gas(Box::new(Factor { factor: values[0] })),
            observation: None,
        },
        Form {
            name: "wall",
            parameters: &[
                FACTOR,
                Parameter::new(
                    "wall_heat_capacity_j_per_m2_k",
                    "J/(m²·K)",
                    (1.0, LARGE_J_PER_M2_K),
                    1e3,
                )
                .log()
                .neutral(LARGE_J_PER_M2_K),
            ],
            equation: "Eq 4 with factor · h and the wall's temperature θ_w; \
                       wall_heat_capacity_j_per_m2_k · dθ_w/dt = factor · h · (θ − θ_w) − 10 \
                       W/(m²·K) · (θ_w − θ_a)",
            source: "The same with a wall that stores heat and transfers it to still air outside \
                     at 10 W/(m²·K).",
            leaves_out: "the temperature profile within the wall",
            build: &|values| {
                Term::Gas(Box::new(Wall {
                    factor: values[0],
                    heat_capacity_j_per_m2_k: values[1],
                }))
            },
            observation: None,
        },
    ],
};

struct Factor {
    factor: f64,
}

impl Dynamics<GasPoint> for Factor {}

impl GasTerm for Factor {
    fn exchange(&self, _: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        exchange.heat_transfer_w_per_m2_k *= self.factor;
    }
}

/// Heat transfer of a wall to still air \[W/(m²·K)\].
const OUTSIDE_W_PER_M2_K: f64 = 10.0;
/// Unit of the state \[K\].
const STATE_K: f64 = 100.0;

/// The state is the excess of the wall temperature over the ambient one.
struct Wall {
    factor: f64,
    heat_capacity_j_per_m2_k: f64,
}

impl Dynamics<GasPoint> for Wall {
    fn states(&self) -> usize {
        1
    }

    // After a long rest gas and wall are at ambient temperature.
    fn steady_state(&self, _: &GasPoint, state: &mut [f64]) {
        state[0] = 0.0;
    }

    fn rates(&self, point: &GasPoint, state: &[f64], rates: &mut [f64]) {
        let excess_k = state[0] * STATE_K;
        let gas_excess_k = point.temperature_k - point.ambient_temperature_k;
        let inside_w_per_m2_k = self.factor * point.heat_transfer_w_per_m2_k;
        let heat_w_per_m2 =
            inside_w_per_m2_k * (gas_excess_k - excess_k) - OUTSIDE_W_PER_M2_K * excess_k;
        rates[0] = heat_w_per_m2 / (self.heat_capacity_j_per_m2_k * STATE_K);
    }
}

impl GasTerm for Wall {
    fn exchange(&self, _: &GasPoint, state: &[f64], exchange: &mut Exchange) {
        exchange.heat_transfer_w_per_m2_k *= self.factor;
        exchange.wall_temperature_k += state[0] * STATE_K;
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{CLAMPED, effect, largest_difference, run, steps};
    use super::{KIND, OUTSIDE_W_PER_M2_K};
    use crate::effects::Effect;
    use crate::nominal::{Gas, Nominal, Valve};

    const FACTOR: f64 = 5.0;

    /// The clamped rig with the paper's small valve A, with which the gas has time to cool, and
    /// with its coefficients changed.
    fn slow_rig(change: impl Fn(f64) -> f64) -> Nominal {
        let gas = CLAMPED.gas.expect("gas");
        let valve = CLAMPED.valve.expect("a valve");
        Nominal {
            valve: Some(Valve {
                flow_gain_kg_per_pa_s: 6.1e-9,
                ..valve
            }),
            gas: Some(Gas {
                heat_transfer_charging_w_per_m2_k: change(gas.heat_transfer_charging_w_per_m2_k),
                heat_transfer_discharging_w_per_m2_k: change(
                    gas.heat_transfer_discharging_w_per_m2_k,
                ),
                ..gas
            }),
            ..CLAMPED
        }
    }

    fn pressure_pa(nominal: &Nominal, effects: &[Effect]) -> Vec<f64> {
        run(nominal, effects, &steps(4.0)).pressure_pa
    }

    fn factor() -> Effect {
        effect(&KIND, "factor", &[("factor", FACTOR)])
    }

    #[test]
    fn a_factor_multiplies_both_coefficients() {
        let nominal = slow_rig(|coefficient| coefficient);
        let factor_pa = pressure_pa(&nominal, &[factor()]);
        let multiplied = slow_rig(|coefficient| FACTOR * coefficient);
        assert_eq!(factor_pa, pressure_pa(&multiplied, &[]));
        assert!(largest_difference(&factor_pa, &pressure_pa(&nominal, &[])) > 1e3);
    }

    /// A wall with a small heat capacity: the heat resistances inside and outside are in series.
    /// Its capacity of 1 J/(m²·K) is a tenth of that of the gas.
    #[test]
    fn a_thin_wall_is_two_heat_resistances_in_series() {
        let nominal = slow_rig(|coefficient| coefficient);
        let series = slow_rig(|coefficient| {
            let inside = FACTOR * coefficient;
            inside * OUTSIDE_W_PER_M2_K / (inside + OUTSIDE_W_PER_M2_K)
        });
        let parameters = [("factor", FACTOR), ("wall_heat_capacity_j_per_m2_k", 1.0)];
        let wall_pa = pressure_pa(&nominal, &[effect(&KIND, "wall", &parameters)]);
        let series_pa = pressure_pa(&series, &[]);
        let factor_pa = pressure_pa(&nominal, &[factor()]);
        let share =
            largest_difference(&wall_pa, &series_pa) / largest_difference(&wall_pa, &factor_pa);
        assert!(share < 0.1, "{share}");
    }
}

//! `valve-lag`: the valve follows its reference with a lag.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, INSTANT_S, Parameter,
    Quantity, Requirement, STATE_PA,
};
use crate::subsystem::term::Dynamics;
use crate::subsystem::valve::{ValvePoint, ValveTerm};
use crate::subsystem::{Subsystem, Term};
use model_core::pressure::GaugePa;

const TIME_CONSTANT_S: Parameter =
    Parameter::new("time_constant_s", "s", (0.0, 2.0), 0.03).neutral(0.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "valve-lag",
    subsystem: Subsystem::Valve,
    equations: &[Equation::Gas],
    requires: &[Requirement::FastSampling, Requirement::ReferenceStep],
    signature: "Every change of the pressure is rounded with the same time constant, at any \
                amplitude.",
    test_signal: "steps of 20, 50, 100 and 200 kPa; a lag rounds all of them in the same way.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::PressureRate],
    compensation: CompensationMethod::Lag,
    forms: &[
        Form {
            name: "first-order",
            parameters: &[TIME_CONSTANT_S],
            equation: "Eq 9 with R in place of P_r; time_constant_s · dR/dt = P_r − R",
            source: "First-order lag of the reference; none below 0.02 ms.",
            leaves_out: "a second-order spool",
            build: &|values| {
                Term::Valve(Box::new(FirstOrder {
                    time_constant_s: values[0],
                }))
            },
            observation: None,
        },
        Form {
            name: "second-order",
            parameters: &[
                TIME_CONSTANT_S,
                Parameter::new("damping_ratio", "1", (0.1, 5.0), 0.7).log(),
            ],
            equation: "Eq 9 with R in place of P_r; T² d²R/dt² + 2 damping_ratio · T dR/dt + R = \
                       P_r, T = time_constant_s",
            source: "Second-order lag of the reference, 1/(1 + 2ζTs + T²s²): the spool's mass on \
                     its spring; none below 0.02 ms.",
            leaves_out: "limits of travel and speed",
            build: &|values| {
                Term::Valve(Box::new(SecondOrder {
                    time_constant_s: values[0],
                    damping_ratio: values[1],
                }))
            },
            observation: None,
        },
    ],
};

/// The state is the lagging reference.
struct FirstOrder {
    time_constant_s: f64,
}

impl Dynamics<ValvePoint> for FirstOrder {
    fn states(&self) -> usize {
        usize::from(self.time_constant_s >= INSTANT_S)
    }

    fn steady_state(&self, point: &ValvePoint, state: &mut [f64]) {
        state[0] = point.reference.0 / STATE_PA;
    }

    fn rates(&self, point: &ValvePoint, state: &[f64], rates: &mut [f64]) {
        rates[0] = (point.reference.0 / STATE_PA - state[0]) / self.time_constant_s;
    }
}

impl ValveTerm for FirstOrder {
    fn reference(&self, _: &ValvePoint, state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        state
            .first()
            .map_or(reference, |lagging| GaugePa(lagging * STATE_PA))
    }
}

/// The states are the lagging reference and its rate times the time constant.
struct SecondOrder {
    time_constant_s: f64,
    damping_ratio: f64,
}

impl Dynamics<ValvePoint> for SecondOrder {
    fn states(&self) -> usize {
        if self.time_constant_s >= INSTANT_S {
            2
        } else {
            0
        }
    }

    fn steady_state(&self, point: &ValvePoint, state: &mut [f64]) {
        state.copy_from_slice(&[point.reference.0 / STATE_PA, 0.0]);
    }

    fn rates(&self, point: &ValvePoint, state: &[f64], rates: &mut [f64]) {
        let pull = point.reference.0 / STATE_PA - state[0] - 2.0 * self.damping_ratio * state[1];
        rates[0] = state[1] / self.time_constant_s;
        rates[1] = pull / self.time_constant_s;
    }
}

impl ValveTerm for SecondOrder {
    fn reference(&self, _: &ValvePoint, state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        state
            .first()
            .map_or(reference, |lagging| GaugePa(lagging * STATE_PA))
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{driven, effect, largest_difference, nominal_under, pressure_pa};
    use super::KIND;
    use crate::effects::Effect;

    /// Compares a step through the lag with the nominal valve under the step response of the lag,
    /// from 0 to 1 by time since the step \[s\].
    fn assert_step_response(lag: Effect, response: impl Fn(f64) -> f64) {
        let step = driven(2.0, |time_s| if time_s < 0.995 { 2e5 } else { 3e5 });
        let found_pa = pressure_pa(&[lag], &step);
        let expected_pa = nominal_under(|time_s| match time_s - 1.0 {
            since_s if since_s < 0.0 => 2e5,
            since_s => 2e5 + 1e5 * response(since_s),
        });
        // A ramp of s = 2 MPa/s that is held for h at its middle leaves an error of s·h²·λ/12
        // behind a pole of λ ≤ 600/s.
        let error_pa = largest_difference(&found_pa, &expected_pa);
        assert!(error_pa < 1.0, "{error_pa}");
    }

    #[test]
    fn a_first_order_lag_follows_its_step_response() {
        let time_constant_s = 0.05;
        let lag = effect(
            &KIND,
            "first-order",
            &[("time_constant_s", time_constant_s)],
        );
        assert_step_response(lag, |since_s| -(-since_s / time_constant_s).exp_m1());
    }

    /// With a damping ratio of 1, two equal poles.
    #[test]
    fn a_second_order_lag_follows_its_step_response() {
        let time_constant_s = 0.02;
        let parameters = [("time_constant_s", time_constant_s), ("damping_ratio", 1.0)];
        let lag = effect(&KIND, "second-order", &parameters);
        assert_step_response(lag, |since_s| {
            let relative = since_s / time_constant_s;
            1.0 - (1.0 + relative) * (-relative).exp()
        });
    }
}

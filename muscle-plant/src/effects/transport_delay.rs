//! `transport-delay`: the reference reaches the valve late.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, Effect, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement, STATE_PA,
};
use crate::subsystem::line::{LinePoint, LineTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::pressure::GaugePa;

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "transport-delay",
    subsystem: Subsystem::Line,
    equations: &[Equation::Gas],
    requires: &[Requirement::FastSampling, Requirement::ReferenceStep],
    signature: "Nothing moves for a fixed time after each change of the reference.",
    test_signal: "steps sampled at 1 kHz; the response starts flat after a delay, and not after a \
                  lag.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure],
    compensation: CompensationMethod::Lag,
    forms: &[
        Form {
            name: "pure",
            parameters: &[DELAY_S],
            equation: "Eq 9 with P_r(t − delay_s)",
            source: "Pure delay of the command.",
            leaves_out: "the rounding of a long hose",
            build: &|values| delay(values[0], 0.0),
            observation: None,
        },
        Form {
            name: "dispersed",
            parameters: &[
                DELAY_S,
                Parameter::new("dispersion", "1", (0.0, 0.5), 0.2).physical_max(),
            ],
            equation: "Eq 9 with R in place of P_r; R = P_r · exp(−(delay_s − 2T) s)/(1 + T s)², \
                       T = dispersion · delay_s/√2",
            source: "A delay with a standard deviation of this share of it: a shorter delay and \
                     two equal lags (tanks in series, Levenspiel 1999), none below 2.5 ms.",
            leaves_out: "the sampling of a bus",
            build: &|values| delay(values[0], values[1]),
            observation: None,
        },
    ],
};

const DELAY_S: Parameter = Parameter::new("delay_s", "s", (0.0, 1.0), 0.03).neutral(0.0);

/// Shorter lags cannot be told from a delay in rows of 10 ms, and make the equations stiff \[s\].
const LAG_S_MIN: f64 = 2.5e-3;

/// A pure delay of the reference by `delay_s` \[s\].
pub fn pure_delay(delay_s: f64) -> Effect {
    Effect {
        kind: &KIND,
        form: &KIND.forms[0],
        values: vec![delay_s],
    }
}

fn delay(delay_s: f64, dispersion: f64) -> Term {
    // The variances of the two lags add up.
    let lag_s = dispersion * delay_s * std::f64::consts::FRAC_1_SQRT_2;
    let lag_s = if lag_s < LAG_S_MIN { 0.0 } else { lag_s };
    Term::Line(Box::new(TransportDelay {
        pure_s: delay_s - 2.0 * lag_s,
        lag_s,
    }))
}

/// The states are the reference behind each lag.
struct TransportDelay {
    pure_s: f64,
    /// Time constant of each lag.
    lag_s: f64,
}

impl Dynamics<LinePoint> for TransportDelay {
    fn states(&self) -> usize {
        if self.lag_s > 0.0 { 2 } else { 0 }
    }

    fn steady_state(&self, point: &LinePoint, state: &mut [f64]) {
        state.fill(point.reference.0 / STATE_PA);
    }

    fn rates(&self, point: &LinePoint, state: &[f64], rates: &mut [f64]) {
        rates[0] = (point.reference.0 / STATE_PA - state[0]) / self.lag_s;
        rates[1] = (state[0] - state[1]) / self.lag_s;
    }
}

impl LineTerm for TransportDelay {
    fn delay_s(&self) -> f64 {
        self.pure_s
    }

    fn reference(&self, _: &LinePoint, state: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        state
            .last()
            .map_or(reference, |lagging| GaugePa(lagging * STATE_PA))
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        STEP_S, driven, effect, largest_difference, nominal_under, pressure_pa, steps,
    };
    use super::{KIND, pure_delay};

    #[test]
    fn a_pure_delay_shifts_the_response() {
        let delay_s = 0.07;
        let nominal_pa = pressure_pa(&[], &steps(4.0));
        let delayed_pa = pressure_pa(&[pure_delay(delay_s)], &steps(4.0));
        let rows = (delay_s / STEP_S).round() as usize;
        let undelayed_pa = &nominal_pa[..nominal_pa.len() - rows];
        assert!(largest_difference(undelayed_pa, &delayed_pa[rows..]) < 0.1);
        assert!(largest_difference(&nominal_pa, &delayed_pa) > 1e4);
    }

    /// The step response of the two lags drives the nominal valve: the delay is the mean of its
    /// derivative, and the dispersion's share of that its standard deviation.
    #[test]
    fn a_dispersed_delay_is_a_delay_and_two_lags() {
        let (delay_s, dispersion) = (0.08, 0.25);
        let lag_s = dispersion * delay_s / 2.0_f64.sqrt();
        let pure_s = delay_s - 2.0 * lag_s;
        let parameters = [("delay_s", delay_s), ("dispersion", dispersion)];
        let dispersed = effect(&KIND, "dispersed", &parameters);
        let step = driven(2.0, |time_s| if time_s < 0.995 { 2e5 } else { 3e5 });
        let found_pa = pressure_pa(&[dispersed], &step);
        let response = |since_s: f64| {
            let lags = (since_s / lag_s).max(0.0);
            1.0 - (1.0 + lags) * (-lags).exp()
        };
        let expected_pa = nominal_under(|time_s| 2e5 + 1e5 * response(time_s - 1.0 - pure_s));
        // As for the lag of a valve: the reference rises at 2.6 MPa/s at most.
        assert!(largest_difference(&found_pa, &expected_pa) < 1.0);
    }
}

//! The instruments of the rig: readings of pressure, contraction and force.

use super::term::{Dynamics, Terms};
use model_core::pressure::GaugePa;

/// Readings of the instruments, or the true values where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Pressure at the valve's port.
    pub pressure: GaugePa<f64>,
    /// Contraction \[-\].
    pub contraction: f64,
    /// Muscle force \[N\].
    pub force_n: f64,
}

/// The inputs of a sensor term.
#[derive(Clone, Copy, Debug)]
pub struct SensorPoint {
    /// Time \[s\].
    pub time_s: f64,
    /// L \[m\].
    pub initial_length_m: f64,
    /// The true values.
    pub truth: Reading,
}

/// A term of the sensors.
pub trait SensorTerm: Dynamics<SensorPoint> + Send + Sync {
    /// Changes the reading.
    fn read(&self, point: &SensorPoint, state: &[f64], reading: &mut Reading);
}

/// The sensors, ideal without terms.
pub struct SensorSubsystem {
    /// L \[m\].
    pub initial_length_m: f64,
    /// Added effects.
    pub terms: Terms<dyn SensorTerm>,
}

impl SensorSubsystem {
    /// The true values for which the instruments read `reading` at `time_s`: the inverse of
    /// [`SensorSubsystem::read`], for sensors without dynamics and a gain within a factor of two. A
    /// term with states (backlash) is ignored, as a single sample does not determine its state.
    pub fn truth(&self, time_s: f64, reading: Reading) -> Reading {
        let mut truth = reading;
        if self.terms.without_states().next().is_none() {
            return truth;
        }
        // Fixed-point iteration: a pass multiplies the error by the deviation of the gain from 1.
        for _ in 0..60 {
            let point = SensorPoint {
                time_s,
                initial_length_m: self.initial_length_m,
                truth,
            };
            let mut read = truth;
            for term in self.terms.without_states() {
                term.read(&point, &[], &mut read);
            }
            let before = truth;
            truth.pressure.0 += reading.pressure.0 - read.pressure.0;
            truth.contraction += reading.contraction - read.contraction;
            truth.force_n += reading.force_n - read.force_n;
            if truth == before {
                break;
            }
        }
        truth
    }

    /// The readings for `point.truth`.
    pub fn read(&self, point: &SensorPoint, state: &[f64]) -> Reading {
        let mut reading = point.truth;
        for (term, state) in self.terms.iter(state) {
            term.read(point, state, &mut reading);
        }
        reading
    }
}

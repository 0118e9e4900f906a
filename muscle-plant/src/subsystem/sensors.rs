//! The sensor block: what the rig's instruments read.

use super::term::{Dynamics, Terms};
use model_core::pressure::GaugePa;

/// What the instruments read; what comes in is the truth at their place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Pressure at the valve's port.
    pub pressure: GaugePa<f64>,
    /// Contraction \[-\].
    pub contraction: f64,
    /// Muscle force \[N\].
    pub force_n: f64,
}

/// What a term of the sensor block sees.
#[derive(Clone, Copy, Debug)]
pub struct SensorPoint {
    /// Time \[s\].
    pub time_s: f64,
    /// L \[m\].
    pub initial_length_m: f64,
    /// The truth.
    pub truth: Reading,
}

/// A term of the sensor block.
pub trait SensorTerm: Dynamics<SensorPoint> + Send + Sync {
    /// Changes what is read.
    fn read(&self, at: &SensorPoint, state: &[f64], reading: &mut Reading);

    /// Half the way \[-\] that the muscle may go without any change of what is read of its
    /// contraction, because that has play.
    fn play(&self, _initial_length_m: f64) -> f64 {
        0.0
    }

    /// The contraction \[-\] that would be read with [`SensorTerm::play`] alone, row by row, from
    /// what was read, NaN in gaps; `None` where that is the same.
    fn without_further_play(&self, _initial_length_m: f64, _read: &[f64]) -> Option<Vec<f64>> {
        None
    }
}

/// The sensors.
pub struct SensorSubsystem {
    /// L \[m\].
    pub initial_length_m: f64,
    /// Added effects.
    pub terms: Terms<dyn SensorTerm>,
}

impl SensorSubsystem {
    /// The truth that the instruments read as `reading` at `time_s`: the inverse of
    /// [`SensorSubsystem::read`], for sensors without dynamics whose gain is within a factor of two. A
    /// term with memory (backlash) is taken to read true: one sample does not tell on which side of
    /// its play it stands.
    pub fn truth(&self, time_s: f64, reading: Reading) -> Reading {
        let mut truth = reading;
        if self.terms.without_states().next().is_none() {
            return truth;
        }
        // Each pass removes the share of the error by which the gain differs from one.
        for _ in 0..60 {
            let at = SensorPoint {
                time_s,
                initial_length_m: self.initial_length_m,
                truth,
            };
            let mut read = truth;
            for term in self.terms.without_states() {
                term.read(&at, &[], &mut read);
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

    /// What is read of `at.truth`.
    pub fn read(&self, at: &SensorPoint, state: &[f64]) -> Reading {
        let mut reading = at.truth;
        for (term, own) in self.terms.iter(state) {
            term.read(at, own, &mut reading);
        }
        reading
    }
}

//! What a diagnosis needs of an effect beside its term: the plant uses none of it.

use crate::subsystem::muscle::MusclePoint;
use model_core::muscle::Muscle;

/// Inverses and initial states by which a diagnosis works back from a record to the rig. An effect
/// for which all defaults hold has no observation.
pub trait Observation {
    /// Half the distance \[-\] that the muscle may move without a change of the contraction
    /// reading.
    fn backlash(&self, _initial_length_m: f64) -> f64 {
        0.0
    }

    /// The contraction \[-\] that would be read with [`Observation::backlash`] alone, row by row,
    /// from the contraction that was read, NaN in gaps; `None` where both are the same.
    fn without_further_backlash(&self, _initial_length_m: f64, _read: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// The pressure \[Pa\] at the port of a sensor that is slower than the line and has read
    /// `read_pa` at `time_s` \[s\], as far as differences of the readings tell it; `None` where the
    /// sensor is not slower.
    fn before_sensor_pa(&self, _time_s: &[f64], _read_pa: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// Forces by which an unknown initial state acts and that decay in proportion to themselves,
    /// one for each such state; `state` is the term's own.
    fn decaying_forces(
        &self,
        _point: &MusclePoint,
        _law: &Muscle<f64>,
        _state: &[f64],
    ) -> Vec<DecayingForce> {
        Vec::new()
    }

    /// Whether the muscle's force depends on the motion before the record, which
    /// [`Dynamics::bias_memory`](crate::subsystem::term::Dynamics::bias_memory) sets.
    fn has_motion_memory(&self) -> bool {
        false
    }
}

/// How an error of one initial state acts on the muscle's force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecayingForce {
    /// Force per unit of the initial error \[N\], without its decay in time.
    pub force_n: f64,
    /// Time constant of the decay \[s\]; infinite where `force_n` already decays with the motion.
    pub time_constant_s: f64,
}

//! The interface of a hidden effect with the rig.

/// State of the rig at one time, computed in the order of the fields.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Moment {
    pub(crate) time_s: f64,
    pub(crate) contraction: f64,
    pub(crate) rate_per_s: f64,
    pub(crate) temperature_k: f64,
    /// Gauge, in the muscle.
    pub(crate) pressure_pa: f64,
    /// ∂F/∂P of Eq 1.
    pub(crate) area_m2: f64,
    /// Lateral surface of the muscle, for the heat transfer.
    pub(crate) surface_m2: f64,
    pub(crate) ambient_k: f64,
    /// Reference that acts on the valve's electronics.
    pub(crate) command_pa: f64,
    /// Reference after delays and limits.
    pub(crate) reference_pa: f64,
    /// Into the muscle.
    pub(crate) flow_kg_per_s: f64,
    /// Of the muscle on the load.
    pub(crate) force_n: f64,
}

/// The load of the muscle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Load {
    pub(crate) mass_kg: f64,
    /// Downward, beside the weight of `mass_kg`.
    pub(crate) pull_n: f64,
    pub(crate) coulomb_n: f64,
    pub(crate) static_n: f64,
}

/// The readings of the sensors.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Measured pressure, gauge.
    pub pressure_pa: f64,
    /// Measured contraction.
    pub contraction: f64,
    /// Measured force.
    pub force_n: f64,
}

/// A hidden effect. Each method modifies one quantity of the rig; the default leaves it unchanged.
///
/// `x` are the states of the effect and `dx` their rates; states that change in jumps have no rate
/// and are set in [`Hidden::commit`].
pub(crate) trait Hidden: Send + Sync {
    /// Number of states of the effect.
    fn states(&self) -> usize {
        0
    }
    /// Sets the states to their steady state at this moment.
    fn settle(&self, _now: &Moment, _x: &mut [f64]) {}
    /// Time of the command that acts at `time_s`.
    fn command_time_s(&self, time_s: f64) -> f64 {
        time_s
    }
    /// Arrival of a change of the command sent at `sent_s`: times and shares that sum to one.
    /// Without delay by default; used only by runs with adaptive steps.
    fn arrivals(&self, sent_s: f64) -> Vec<(f64, f64)> {
        vec![(sent_s, 1.0)]
    }
    fn ambient_k(&self, ambient_k: f64, _time_s: f64) -> f64 {
        ambient_k
    }
    fn reference_pa(&self, reference_pa: f64, _now: &Moment, _x: &[f64], _dx: &mut [f64]) -> f64 {
        reference_pa
    }
    /// Pressure at the outlet of the valve.
    fn valve_side_pa(&self, muscle_pa: f64, _x: &[f64]) -> f64 {
        muscle_pa
    }
    /// Flow towards the muscle.
    fn flow_kg_per_s(&self, flow: f64, _now: &Moment, _x: &[f64], _dx: &mut [f64]) -> f64 {
        flow
    }
    /// Flow out of the muscle past the valve.
    fn leak_kg_per_s(&self, _now: &Moment) -> f64 {
        0.0
    }
    /// Heat into the gas.
    fn heat_w(&self, heat_w: f64, _now: &Moment, _x: &[f64], _dx: &mut [f64]) -> f64 {
        heat_w
    }
    fn force_n(&self, force_n: f64, _now: &Moment, _x: &[f64], _dx: &mut [f64]) -> f64 {
        force_n
    }
    fn load(&self, _load: &mut Load, _now: &Moment, _x: &[f64], _dx: &mut [f64]) {}
    /// Whether [`Hidden::commit`] does anything.
    fn commits(&self) -> bool {
        true
    }
    /// Called after every accepted step.
    fn commit(&self, _now: &Moment, _x: &mut [f64]) {}
    fn read(&self, _reading: &mut Reading, _now: &Moment, _x: &[f64]) {}
}

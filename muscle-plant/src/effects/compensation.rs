//! How the controller compensates an effect.

use super::kind::Effect;

/// The part of the controller that compensates an effect, with the sizes that it needs to know.
#[derive(Clone, Copy, Debug)]
pub enum CompensationMethod {
    /// The hysteresis loop of the controller, fitted to the loop of the effect.
    HysteresisLoop,
    /// A force in the direction of motion.
    Friction(fn(&Effect) -> AddedFriction),
    /// A constant force: the added mass \[kg\].
    Payload(fn(&Effect) -> f64),
    /// A step of the reference across the dead zone.
    ValveDeadZone(fn(&Effect) -> DeadZoneWidths),
    /// The zero of the pressure reading: the reading at no pressure \[Pa\].
    PressureSensorOffset(fn(&Effect) -> f64),
    /// The scale of the pressure reading: its relative error at 300 kPa \[-\], the middle of the
    /// pressures that an assist needs.
    PressureSensorGain(fn(&Effect) -> f64),
    /// The lead, which is chosen for the lag of the whole loop.
    Lag,
    /// None, for this reason: a sentence without a full stop.
    Unavailable(&'static str),
}

/// Friction that an effect adds to the load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AddedFriction {
    /// While the load moves \[N\].
    pub coulomb_n: f64,
    /// At which it breaks away \[N\].
    pub static_n: f64,
    /// Distance over which the friction force turns round at a reversal \[m\]; 0 where it jumps.
    pub presliding_m: f64,
}

/// A dead zone of the valve, in pressure error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeadZoneWidths {
    /// Its width on the side that fills \[Pa\].
    pub filling_pa: f64,
    /// Its width on the side that exhausts \[Pa\].
    pub exhausting_pa: f64,
}

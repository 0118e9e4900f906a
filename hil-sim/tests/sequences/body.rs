//! The bounds of the body: one table, the same for every rig and all settings.

/// A region of the body that the weight may meet, by ISO/TS 15066:2016, tables A.2 and A.3.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// Permitted force, and pressed against something, for longer than [`TRANSIENT_S`] \[N\].
    pub lasting_n: f64,
    /// Permitted force for a shorter time \[N\].
    pub transient_n: f64,
    /// Stiffness \[N/m\].
    pub stiffness_n_per_m: f64,
    /// Mass that the region has if it is free \[kg\]; none if it is held.
    pub mass_kg: Option<f64>,
}

/// Hand and fingers, above the weight.
pub const HAND: Region = Region {
    lasting_n: 140.0,
    transient_n: 280.0,
    stiffness_n_per_m: 75e3,
    mass_kg: Some(0.6),
};

/// Foot, below the weight. The specification has none: the forces are those of the lower leg, the
/// next region, the stiffness is the hand's, which is the stiffest of the limbs.
pub const FOOT: Region = Region {
    lasting_n: 130.0,
    transient_n: 260.0,
    stiffness_n_per_m: 75e3,
    mass_kg: None,
};

/// What is shorter is transient contact (ISO/TS 15066, 5.5.5.3) \[s\].
pub const TRANSIENT_S: f64 = 0.5;
/// Speed at which the controller trips \[m/s\]: 1.5 times the reduced speed of ISO 10218-1.
pub const TRIP_M_PER_S: f64 = 1.5 * 0.25;
/// Fastest weight where the controller determines the motion \[m/s\]: the trip level, and free fall
/// during the 30 ms in which the controller finds that (docs/safety.md).
pub const CONTROLLED_M_PER_S: f64 = TRIP_M_PER_S + 9.80665 * 0.03;
/// Rise that no hand has asked for \[m\]: in such a gap no finger is crushed (ISO 13854, table
/// 1).
pub const UNASKED_M: f64 = 0.025;
/// Time within which what is clamped must be free again \[s\]: the ramp from the highest pressure
/// (docs/safety.md), and the muscle's three time constants.
pub const RELEASE_S: f64 = 2.5 + 0.9;

impl Region {
    /// Speed at which a free region meets `mass_kg` with its transient force \[m/s\]: F/√(kμ) with
    /// 1/μ = 1/m + 1/M (ISO/TS 15066, A.3.4).
    pub fn speed_m_per_s(&self, mass_kg: f64) -> f64 {
        let region_kg = self.mass_kg.unwrap_or(f64::INFINITY);
        let reduced_kg = 1.0 / (1.0 / region_kg + 1.0 / mass_kg);
        self.transient_n / (self.stiffness_n_per_m * reduced_kg).sqrt()
    }
}

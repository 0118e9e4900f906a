//! The force that reaches the load: its error against K F_b rates an assist run.

use crate::bench::tick::TICK_S;
use crate::rig::Rig;
use muscle_plant::effects::CompensationMethod;
use muscle_plant::nominal::Weight;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;

/// Mass and friction of the load in addition to the nominal values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AddedLoad {
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Static friction \[N\].
    pub friction_n: f64,
}

impl AddedLoad {
    /// The sum over the effects of `rig`.
    pub(super) fn of(rig: &Rig) -> AddedLoad {
        let mut added = AddedLoad::default();
        for effect in &rig.effects {
            match effect.kind.compensation {
                CompensationMethod::Payload(mass_kg) => added.mass_kg += mass_kg(effect),
                CompensationMethod::Friction(friction) => {
                    added.friction_n += friction(effect).static_n;
                }
                _ => {}
            }
        }
        added
    }
}

/// Inputs of [`load_force_n`] in one tick.
#[derive(Clone, Copy, Debug)]
pub struct LoadSample {
    /// The required force K F_b \[N\].
    pub required_n: f64,
    /// Force F of the muscle \[N\].
    pub force_n: f64,
    /// Contraction ε \[-\].
    pub contraction: f64,
}

/// The force on the nominal load \[N\], tick by tick. Without added friction and payload it is
/// the force of the muscle.
///
/// In motion it is Eq 5 solved for F with the nominal weight. At rest static friction can balance
/// any force up to its maximum; the value with which the result is nearest to K F_b is assumed.
pub fn load_force_n(
    weight: &Weight,
    added: &AddedLoad,
    length_m: f64,
    ticks: &[LoadSample],
) -> Vec<f64> {
    let contraction = |index: usize| ticks[index.min(ticks.len() - 1)].contraction;
    let rest_n = weight.mass_kg * GRAVITY_M_PER_S2;
    let breakaway_n = rest_n + weight.static_friction_n;
    let forces = ticks.iter().enumerate().map(|(index, tick)| {
        let (before, now, after) = (
            contraction(index.saturating_sub(1)),
            contraction(index),
            contraction(index + 1),
        );
        let remaining_n = tick.force_n - added.mass_kg * GRAVITY_M_PER_S2;
        let (low_n, high_n) = (
            remaining_n - added.friction_n,
            remaining_n + added.friction_n,
        );
        if before.min(now).min(after) <= 0.0 {
            // The stop carries the part of the weight that is not lifted.
            return tick.required_n.clamp(low_n, high_n).min(breakaway_n);
        }
        if before == after {
            let falling_n = rest_n - weight.static_friction_n;
            return tick
                .required_n
                .clamp(low_n, high_n)
                .clamp(falling_n, breakaway_n);
        }
        let speed_m_per_s = length_m * (after - before) / (2.0 * TICK_S);
        let acceleration_m_per_s2 = length_m * (after - 2.0 * now + before) / (TICK_S * TICK_S);
        rest_n
            + weight.mass_kg * acceleration_m_per_s2
            + weight.viscous_damping_ns_per_m * speed_m_per_s
            + weight.coulomb_friction_n.copysign(speed_m_per_s)
    });
    forces.collect()
}

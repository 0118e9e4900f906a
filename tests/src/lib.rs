//! Helpers of the tests across crates: rigs that differ from the reference rig in one part.

use hil_sim::rig::Rig;
use muscle_plant::nominal::{Gas, Load, Weight};

/// The rig's weight.
///
/// # Panics
/// If the rig has none.
pub fn weight_mut(rig: &mut Rig) -> &mut Weight {
    match &mut rig.nominal.load {
        Load::Weight(weight) => weight,
        Load::Prescribed => panic!("the reference rig has a weight"),
    }
}

/// The rig's air.
///
/// # Panics
/// If the rig has none.
pub fn gas_mut(rig: &mut Rig) -> &mut Gas {
    rig.nominal.gas.as_mut().expect("the reference rig has gas")
}

/// The reference rig with another valve.
///
/// # Panics
/// Never: the reference rig has a valve.
pub fn with_flow_gain(flow_gain_kg_per_pa_s: f64) -> Rig {
    hil_sim::paper::with_flow_gain(&Rig::reference(), flow_gain_kg_per_pa_s).expect("a valve")
}

/// The rig without heat exchange.
///
/// # Panics
/// If the rig has no air.
pub fn adiabatic(mut rig: Rig) -> Rig {
    gas_mut(&mut rig).heat_transfer_charging_w_per_m2_k = 0.0;
    gas_mut(&mut rig).heat_transfer_discharging_w_per_m2_k = 0.0;
    rig
}

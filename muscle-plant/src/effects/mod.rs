//! Effects that can be added to the plant, one file each.
//!
//! An effect is what a rig shows and the nominal model leaves out. It has a name, a subsystem, a
//! signature in data, and one or more forms: equations that have been used for it, each a term of
//! the plant with few parameters. A new effect is one file here and one line in `effects!`; a new
//! form is one entry in the effect's file.
//!
//! A measured rig follows none of the forms exactly: each states its source and what it leaves out.

mod catalogue;
mod compensation;
mod kind;
mod observation;
mod orifice;

pub use catalogue::Catalogue;
pub use compensation::{AddedFriction, CompensationMethod, DeadZoneWidths};
pub use kind::{DISCREPANCY_RATIO, Effect, EffectKind, Equation, Form, Parameter, Requirement};
pub use observation::{DecayingForce, Observation};

/// Declares the file of each effect and lists it in the catalogue, in this order.
macro_rules! effects {
    ($($effect:ident)*) => {
        $(pub mod $effect;)*
        const STANDARD: &[&EffectKind] = &[$(&$effect::KIND),*];
    };
}

effects! {
    hysteresis
    creep
    dead_band
    bladder_elasticity
    slack
    run_in
    friction
    payload
    backlash
    valve_dead_zone
    flow_limit
    valve_lag
    transport_delay
    line_dynamics
    leak
    heat_exchange
    supply_droop
    pressure_sensor_offset
    pressure_sensor_gain
    pressure_sensor_drift
    contraction_sensor_offset
    force_sensor_offset
}

/// Pressure at which a force that grows with pressure has the size its parameter states \[Pa\].
const REFERENCE_PRESSURE_PA: f64 = 3e5;
/// Contraction at which a force that grows with it has the size its parameter states \[-\].
const REFERENCE_CONTRACTION: f64 = 0.25;
/// Unit of pressures in states \[Pa\].
const STATE_PA: f64 = 1e5;
/// Temperature of air outside the muscle \[K\].
const AIR_TEMPERATURE_K: f64 = 293.0;
/// What is faster than this is taken to follow at once \[s\].
const INSTANT_S: f64 = 2e-5;

/// Where what lags behind a drive has come to after a stretch of time in which the drive went
/// straight from one value to another.
fn lagged(state: f64, [from, to]: [f64; 2], length_s: f64, time_constant_s: f64) -> f64 {
    if length_s <= 0.0 {
        return state;
    }
    let behind = (to - from) * time_constant_s / length_s;
    state + (to - from) + (state - from + behind) * (-length_s / time_constant_s).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nominal::Nominal;
    use crate::subsystem::Term;
    use crate::subsystem::gas::GasSubsystem;
    use crate::subsystem::muscle::MusclePoint;
    use crate::subsystem::term::Terms;
    use model_core::pressure::GaugePa;

    fn air() -> GasSubsystem {
        let rig = Nominal::REFERENCE;
        GasSubsystem {
            gas: rig.gas.expect("gas"),
            volume: rig.volume.expect("a volume"),
            initial_length_m: rig.muscle.initial_length_m,
            terms: Terms::default(),
        }
    }

    /// What follows its inputs comes to where its rates would bring it, whatever the steps: every
    /// term of the muscle that has states, by the midpoint rule in 5000 of them.
    #[test]
    fn terms_follow_their_inputs_as_their_rates_say() {
        let point = |time_s: f64, direction: f64| MusclePoint {
            time_s,
            contraction: 0.06 + 0.04 * direction * time_s,
            contraction_rate_per_s: 0.04 * direction,
            direction,
            pressure: GaugePa(1e5 + 4e5 * time_s),
        };
        let mut compared = Vec::new();
        for kind in Catalogue::standard().kinds() {
            for form in kind.forms {
                let values: Vec<f64> = form.parameters.iter().map(|p| p.typical).collect();
                let term = match (form.build)(&values) {
                    Term::Muscle(term) => Some(term),
                    Term::Line(term) => term.with_measured_pressure(Some(air())),
                    _ => None,
                };
                let Some(term) = term.filter(|term| term.states() > 0) else {
                    continue;
                };
                for direction in [1.0, -1.0] {
                    let mut followed = vec![0.0; term.states()];
                    term.steady_state(&point(0.0, direction), &mut followed);
                    term.bias_memory(&point(0.0, direction), 0.3, &mut followed);
                    let mut integrated = followed.clone();
                    term.propagate(
                        &point(0.0, direction),
                        &point(0.5, direction),
                        &mut followed,
                    );
                    let step_s = 1e-4;
                    for step in 0..5000 {
                        let begin_s = f64::from(step) * step_s;
                        let mut moved = integrated.clone();
                        for (time_s, length_s) in
                            [(begin_s, 0.5 * step_s), (begin_s + 0.5 * step_s, step_s)]
                        {
                            let mut rates = vec![0.0; moved.len()];
                            term.rates(&point(time_s, direction), &moved, &mut rates);
                            let begins = integrated.iter().zip(&rates);
                            moved = begins.map(|(own, rate)| own + length_s * rate).collect();
                        }
                        integrated = moved;
                        term.accept_step(&point(begin_s + step_s, direction), &mut integrated);
                    }
                    for (a, b) in followed.iter().zip(&integrated) {
                        assert!(
                            (a - b).abs() < 1e-5,
                            "{} {}: {a}, {b}",
                            kind.name,
                            form.name
                        );
                    }
                }
                compared.push(form.name);
            }
        }
        assert!(compared.len() >= 12, "{compared:?}");
    }
}

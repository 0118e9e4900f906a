//! `supply-droop`: a small reservoir behind a restriction feeds the valve.

use super::orifice::Orifice;
use super::{
    AIR_TEMPERATURE_K, CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form,
    Parameter, Quantity, Requirement, STATE_PA,
};
use crate::subsystem::gas::GAS_CONSTANT_J_PER_KG_K;
use crate::subsystem::supply::{SupplyPoint, SupplyTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::pressure::{AbsolutePa, GaugePa};

/// Volume of a reservoir whose pressure is constant, to rounding \[m³\].
const LARGE_M3: f64 = 1e9;

const RESERVOIR_VOLUME_M3: Parameter =
    Parameter::new("reservoir_volume_m3", "m³", (1e-6, LARGE_M3), 1e-3).log();

const RECOVERY_TIME_S: Parameter = Parameter::new("recovery_time_s", "s", (1e-3, 1e3), 1.0).log();

const REFILL: Parameter =
    Parameter::new("conductance_kg_per_pa_s", "kg/(Pa·s)", (1e-12, 1e-7), 2e-9).log();

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "supply-droop",
    subsystem: Subsystem::Supply,
    equations: &[Equation::Gas],
    requires: &[Requirement::MeasuredSupply],
    signature: "Upward steps near supply pressure fall short after large air consumption; downward \
                ones do not.",
    test_signal: "ten large steps up in quick succession, with the supply pressure recorded.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::PressureRate],
    compensation: CompensationMethod::Unavailable("the supply cannot deliver more air than this"),
    forms: &[
        Form {
            name: "linear",
            parameters: &[RESERVOIR_VOLUME_M3.neutral(LARGE_M3), RECOVERY_TIME_S],
            equation: "Supply P_s − d; dd/dt = R_air θ/reservoir_volume_m3 · G_s − \
                       d/recovery_time_s; G_s = G while the valve is open to its supply, P_r ≥ \
                       P_s − d, else max(G, 0)",
            source: "Isothermal reservoir with a linear restriction towards the nominal supply; \
                     air that flows back from the muscle returns to it.",
            leaves_out: "the dynamics of a regulator",
            build: &|values| linear(values, false),
            observation: None,
        },
        Form {
            name: "checked",
            // No neutral value: the check valve acts with any volume.
            parameters: &[RESERVOIR_VOLUME_M3, RECOVERY_TIME_S],
            equation: "Supply P_s − d; dd/dt = R_air θ/reservoir_volume_m3 · max(G, 0) − \
                       d/recovery_time_s; no flow back into it",
            source: "The same behind a check valve, which keeps air from flowing back.",
            leaves_out: "the dynamics of a regulator",
            build: &|values| linear(values, true),
            observation: None,
        },
        Form {
            name: "orifice",
            parameters: &[RESERVOIR_VOLUME_M3.neutral(LARGE_M3), REFILL],
            equation: "Supply P_s − d; dd/dt = R_air θ/reservoir_volume_m3 · (G_s − g), g = \
                       conductance_kg_per_pa_s · p₁ √(1 − ((q − 0.5)/0.5)²), q = max(p₂/p₁, 0.5), \
                       absolute pressures p₁ of the nominal supply and p₂ of the reservoir; G_s = \
                       G while the valve is open to its supply, P_r ≥ P_s − d, else max(G, 0)",
            source: "Isothermal reservoir that the nominal supply refills through an orifice by \
                     ISO 6358-1 with a critical ratio of 0.5: a half-shut regulator.",
            leaves_out: "the dynamics of a regulator",
            build: &|values| orifice(values, false),
            observation: None,
        },
        Form {
            name: "checked-orifice",
            parameters: &[RESERVOIR_VOLUME_M3, REFILL],
            equation: "Supply P_s − d; dd/dt = R_air θ/reservoir_volume_m3 · (max(G, 0) − g), g = \
                       conductance_kg_per_pa_s · p₁ √(1 − ((q − 0.5)/0.5)²), q = max(p₂/p₁, 0.5), \
                       absolute pressures p₁ of the nominal supply and p₂ of the reservoir; no \
                       flow back into it",
            source: "The same behind a check valve.",
            leaves_out: "the dynamics of a regulator",
            build: &|values| orifice(values, true),
            observation: None,
        },
    ],
};

fn linear(values: &[f64], checked: bool) -> Term {
    let recovery_time_s = values[1];
    reservoir(values[0], Refill::Linear { recovery_time_s }, checked)
}

fn orifice(values: &[f64], checked: bool) -> Term {
    let orifice = Orifice {
        conductance_kg_per_pa_s: values[1],
        critical_ratio: 0.5,
    };
    reservoir(values[0], Refill::Orifice(orifice), checked)
}

fn reservoir(volume_m3: f64, refill: Refill, checked: bool) -> Term {
    Term::Supply(Box::new(Reservoir {
        volume_m3,
        refill,
        checked,
    }))
}

/// The flow that refills the reservoir.
enum Refill {
    /// Proportional to the droop.
    Linear { recovery_time_s: f64 },
    /// The flow of an orifice.
    Orifice(Orifice),
}

/// The state is the droop.
struct Reservoir {
    volume_m3: f64,
    refill: Refill,
    /// A check valve keeps air from flowing back into it.
    checked: bool,
}

impl Dynamics<SupplyPoint> for Reservoir {
    fn states(&self) -> usize {
        1
    }

    fn rates(&self, point: &SupplyPoint, state: &[f64], rates: &mut [f64]) {
        let per_mass = GAS_CONSTANT_J_PER_KG_K * AIR_TEMPERATURE_K / (self.volume_m3 * STATE_PA);
        let refill_per_s = match &self.refill {
            Refill::Linear { recovery_time_s } => state[0] / recovery_time_s,
            Refill::Orifice(orifice) => {
                let supply = AbsolutePa(point.nominal.0 + point.atmospheric.0);
                let reservoir = AbsolutePa(supply.0 - state[0] * STATE_PA);
                orifice.flow_kg_per_s(supply, reservoir) * per_mass
            }
        };
        rates[0] = point.drawn_kg_per_s * per_mass - refill_per_s;
    }
}

impl SupplyTerm for Reservoir {
    fn pressure(&self, _: &SupplyPoint, state: &[f64], supply: GaugePa<f64>) -> GaugePa<f64> {
        GaugePa((supply.0 - state[0] * STATE_PA).max(0.0))
    }

    fn checks(&self) -> bool {
        self.checked
    }
}

#[cfg(test)]
mod tests {
    use super::super::leak;
    use super::super::testing::{
        ATMOSPHERIC_PA, CLAMPED, FLOW_GAIN_KG_PER_PA_S, STEP_S, assert_near, driven, effect,
        pressure_pa, steady_pa, through,
    };
    use super::{AIR_TEMPERATURE_K, KIND};
    use crate::subsystem::gas::GAS_CONSTANT_J_PER_KG_K;

    const RESERVOIR: (&str, f64) = ("reservoir_volume_m3", 1e-3);

    fn volume_m3(contraction: f64) -> f64 {
        CLAMPED.volume.expect("a volume").volume_m3(contraction)
    }

    /// Isothermal in effect, as the air is at ambient temperature again after 20 s, in which 2 % of
    /// the droop recover with a time constant of 1000 s.
    #[test]
    fn the_droop_is_the_mass_that_was_drawn() {
        let droop = effect(&KIND, "linear", &[RESERVOIR, ("recovery_time_s", 1e3)]);
        let step = driven(20.0, |time_s| if time_s < 0.5 { 2e5 } else { 5e5 });
        let last_pa = pressure_pa(&[droop], &step)[1999];
        let per_volume = GAS_CONSTANT_J_PER_KG_K * AIR_TEMPERATURE_K;
        let drawn_kg = (last_pa - 2e5) * volume_m3(0.1) / per_volume;
        let expected_pa = drawn_kg * per_volume / RESERVOIR.1;
        assert_near(5e5 - last_pa, expected_pa, 0.03 * expected_pa, "droop");
    }

    /// With the valve open to its supply, air flows back as the muscle is extended: it returns to
    /// the reservoir, or a check valve keeps it in the muscle.
    #[test]
    fn air_that_flows_back_returns_to_the_reservoir_or_stays_in_the_muscle() {
        let stroke = through([
            (0.0, 0.1),
            (15.0, 0.1),
            (16.0, 0.2),
            (26.0, 0.2),
            (27.0, 0.1),
        ]);
        let mut inputs = driven(40.0, |time_s| if time_s < 0.5 { 2e5 } else { 5e5 });
        for (row, contraction) in inputs.contraction.iter_mut().enumerate() {
            *contraction = stroke(row as f64 * STEP_S);
        }
        // Either restriction admits 1 % of the air in 40 s at most.
        let slow = ("recovery_time_s", 1e3);
        let narrow = ("conductance_kg_per_pa_s", 1e-12);
        for (form, refill, checked) in [
            ("linear", slow, false),
            ("checked", slow, true),
            ("orifice", narrow, false),
            ("checked-orifice", narrow, true),
        ] {
            let droop = effect(&KIND, form, &[RESERVOIR, refill]);
            let found_pa = pressure_pa(&[droop], &inputs);
            let [before_pa, contracted_pa, after_pa] =
                [1499, 2599, 3999].map(|row: usize| found_pa[row] + ATMOSPHERIC_PA);
            assert!(contracted_pa < 0.97 * before_pa, "{form}");
            let expected_pa = if checked {
                contracted_pa * volume_m3(0.2) / volume_m3(0.1)
            } else {
                before_pa
            };
            assert_near(after_pa, expected_pa, 0.01 * expected_pa, form);
        }
    }

    /// A leak draws on the supply permanently: the flow of the orifice is that of the leak.
    #[test]
    fn a_supply_behind_an_orifice_droops_by_what_is_drawn() {
        let (leaking, orifice) = (2e-9, 4e-9);
        let parameters = [
            ("reservoir_volume_m3", 1e-4),
            ("conductance_kg_per_pa_s", orifice),
        ];
        let leak = effect(
            &leak::KIND,
            "linear",
            &[("conductance_kg_per_pa_s", leaking)],
        );
        let pressure_pa = steady_pa(&[effect(&KIND, "orifice", &parameters), leak], 5e5);
        let supply_pa = pressure_pa * (FLOW_GAIN_KG_PER_PA_S + leaking) / FLOW_GAIN_KG_PER_PA_S;
        assert!(supply_pa < 4.9e5, "{supply_pa}");
        let upstream_pa = 5e5 + ATMOSPHERIC_PA;
        let ratio: f64 = (supply_pa + ATMOSPHERIC_PA) / upstream_pa;
        let flow = orifice * upstream_pa * (1.0 - ((ratio - 0.5) / 0.5).powi(2)).sqrt();
        assert_near(flow, leaking * pressure_pa, 1e-3 * flow, "flow");
    }
}

//! `leak`: air escapes from the muscle to the surroundings, or comes in where it is below them.

use super::orifice::Orifice;
use super::{EffectKind, Form, Parameter, REFERENCE_PRESSURE_PA};
use crate::subsystem::Term;
use crate::subsystem::gas::{Exchange, GasPoint, GasTerm};
use crate::subsystem::term::Dynamics;

const CONDUCTANCE: Parameter =
    Parameter::new("conductance_kg_per_pa_s", "kg/(Pa·s)", (0.0, 1e-6), 4e-9).neutral(0.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "leak",
    place: "gas",
    signature: "The pressure settles below its reference in proportion to itself, and falls with the \
           valve shut.",
    test_signal: "a cock between valve and pressure sensor shut at four pressures for 60 s \
                 (`hil-sim experiment --part shut-holds`); what leaks is not refilled then, and \
                 falls with the pressure.",
    forms: &[
        Form {
            name: "linear",
            parameters: &[CONDUCTANCE],
            source: "Laminar leak, flow in proportion to the gauge pressure. Leaves out choking.",
            build: |values| {
                Term::Gas(Box::new(Gap {
                    conductance_kg_per_pa_s: values[0],
                    power: 1.0,
                }))
            },
        },
        Form {
            name: "orifice",
            parameters: &[CONDUCTANCE],
            source: "A hole by ISO 6358-1, with the sonic conductance as mass flow over absolute \
                     pressure and a critical ratio of 0.5. Leaves out temperature.",
            build: |values| {
                Term::Gas(Box::new(Hole(Orifice {
                    conductance_kg_per_pa_s: values[0],
                    critical_ratio: HOLE_CRITICAL_RATIO,
                })))
            },
        },
        Form {
            name: "power",
            parameters: &[
                CONDUCTANCE,
                // What flows at any pressure is none.
                Parameter::new("power", "1", (0.2, 5.0), 1.0)
                    .log()
                    .ends_at_min(),
            ],
            source: "Flow in proportion to a power of the gauge pressure, the conductance at 300 \
                     kPa: about 0.5 where it is turbulent, above 1 where pressure opens the gap \
                     (a tear, a seal). Leaves out choking.",
            build: |values| {
                Term::Gas(Box::new(Gap {
                    conductance_kg_per_pa_s: values[0],
                    power: values[1],
                }))
            },
        },
    ],
};

/// Difference of pressures below which any leak is laminar \[Pa\]: a root would be infinitely steep
/// at none.
const LAMINAR_PA: f64 = 100.0;
/// Critical ratio of a short hole, near that of a nozzle \[-\].
const HOLE_CRITICAL_RATIO: f64 = 0.5;

struct Gap {
    conductance_kg_per_pa_s: f64,
    power: f64,
}

impl Gap {
    /// Mass flow towards the side that is `difference_pa` ≥ 0 lower \[kg/s\].
    fn flow_kg_per_s(&self, difference_pa: f64) -> f64 {
        let turbulent_pa = difference_pa.max(LAMINAR_PA);
        let share = (turbulent_pa / REFERENCE_PRESSURE_PA).powf(self.power);
        let laminar = difference_pa / turbulent_pa;
        self.conductance_kg_per_pa_s * REFERENCE_PRESSURE_PA * share * laminar
    }
}

impl Dynamics<GasPoint> for Gap {}

impl GasTerm for Gap {
    fn exchange(&self, at: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        let gauge_pa = at.pressure.to_gauge(at.atmospheric).0;
        let flow_kg_per_s = self.flow_kg_per_s(gauge_pa.abs());
        if gauge_pa >= 0.0 {
            exchange.outflow_kg_per_s += flow_kg_per_s;
        } else {
            exchange.inflow_kg_per_s += flow_kg_per_s;
        }
    }
}

struct Hole(Orifice);

impl Dynamics<GasPoint> for Hole {}

impl GasTerm for Hole {
    fn exchange(&self, at: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        exchange.outflow_kg_per_s += self.0.flow_kg_per_s(at.pressure, at.atmospheric);
        exchange.inflow_kg_per_s += self.0.flow_kg_per_s(at.atmospheric, at.pressure);
    }
}

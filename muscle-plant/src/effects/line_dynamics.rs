//! `line-dynamics`: the hose between the muscle and the port of the valve, where the pressure is
//! measured.

use super::{
    AIR_TEMPERATURE_K, CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form,
    INSTANT_S, Observation, Parameter, Quantity, REFERENCE_CONTRACTION, REFERENCE_PRESSURE_PA,
    Requirement, STATE_PA, lagged,
};
use crate::subsystem::gas::{GAS_CONSTANT_J_PER_KG_K, GasPoint, GasSubsystem, HEAT_RATIO};
use crate::subsystem::line::{LinePoint, LineTerm};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use core::f64::consts::TAU;
use model_core::muscle::{Muscle, Volume};
use model_core::pressure::{AbsolutePa, GaugePa};

const HOSE_VOLUME_M3: Parameter = Parameter::new("hose_volume_m3", "m³", (1e-6, 1e-3), 1e-5).log();
const PERIOD_S: Parameter = Parameter::new("period_s", "s", (0.0, 1.0), 0.05).neutral(0.0);
const DAMPING_RATIO: Parameter = Parameter::new("damping_ratio", "1", (0.01, 5.0), 0.2).log();

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "line-dynamics",
    subsystem: Subsystem::Line,
    equations: &[Equation::Gas, Equation::MuscleForce],
    requires: &[Requirement::FastSampling],
    signature: "The force lags the measured pressure, or the pressure rings at one frequency after \
                each fast change while the force does not.",
    test_signal: "fast steps sampled at 1 kHz with sensors at the valve and at the muscle.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::PressureRate],
    compensation: CompensationMethod::Unavailable(
        "it oscillates faster than the controller's tick of 10 ms can follow",
    ),
    forms: &[
        Form {
            name: "resistance",
            parameters: &[
                Parameter::new("lag_s", "s", (0.0, 0.5), 5e-3).neutral(0.0),
                HOSE_VOLUME_M3,
            ],
            equation: "g = (p − P) · V/(R_air θ · lag_s) flows into the muscle; \
                       hose_volume_m3/(R_air θ) · dp/dt = G − g at the port, where the pressure \
                       is read",
            source: "The volume of a hose at the port and a linear resistance behind it, given as \
                     the lag of the muscle's pressure behind that of the port.",
            leaves_out: "turbulence, a lag that changes with volume, and the air in a volume that \
                         fills within 1 ms",
            build: &|values| {
                Term::Line(Box::new(Resistance {
                    passing: Passing::Lag(values[0]),
                    hose_volume_m3: values[1],
                    stores: false,
                }))
            },
            observation: None,
        },
        Form {
            name: "conductance",
            parameters: &[
                Parameter::new(
                    "conductance_kg_per_pa_s",
                    "kg/(Pa·s)",
                    (1e-10, WIDE_KG_PER_PA_S),
                    2e-7,
                )
                .log()
                .neutral(WIDE_KG_PER_PA_S),
                // A smaller volume fills at once and cannot be estimated.
                Parameter {
                    typical: 3e-5,
                    ..HOSE_VOLUME_M3
                },
            ],
            equation: "g = conductance_kg_per_pa_s · (p − P) flows into the muscle; \
                       hose_volume_m3/(R_air θ) · dp/dt = G − g at the port, where the pressure \
                       is read",
            source: "The volume of a hose at the port and a linear resistance behind it, the same \
                     at any pressure: a larger volume of the muscle lags more.",
            leaves_out: "turbulence, a resistance that falls with density, and the air in a \
                         volume that fills within 1 ms",
            build: &|values| {
                Term::Line(Box::new(Resistance {
                    passing: Passing::Conductance(values[0]),
                    hose_volume_m3: values[1],
                    stores: false,
                }))
            },
            observation: None,
        },
        Form {
            name: "inertance",
            parameters: &[PERIOD_S, DAMPING_RATIO, HOSE_VOLUME_M3],
            equation: "dp/dt = R_air θ/hose_volume_m3 · (G − g) at the port; dg/dt = ω² · \
                       hose_volume_m3/(R_air θ) · (p − P) − 2 damping_ratio · ω · (401 kPa/P_abs) \
                       · g, ω = 2π/period_s; g flows into the muscle",
            source: "The volume of a hose at the port, then its inertance and a laminar \
                     resistance: one lump of a line (Stecki & Davis 1986). Period and damping are \
                     those of the hose's volume against a muscle at 300 kPa.",
            leaves_out: "higher modes and turbulence",
            build: &|values| {
                Term::Line(Box::new(Inertance {
                    period_s: values[0],
                    damping_ratio: values[1],
                    hose_volume_m3: values[2],
                }))
            },
            observation: None,
        },
        Form {
            name: "sensor-tube",
            parameters: &[PERIOD_S, DAMPING_RATIO],
            equation: "The sensor reads p; d²p/dt² = ω² (P − p) − 2 damping_ratio · ω dp/dt, ω = \
                       2π/period_s",
            source: "The sensor at the end of a tube with a small volume: a Helmholtz resonator \
                     with negligible flow (Bergh & Tijdeman 1965, first mode).",
            leaves_out: "higher modes and turbulence",
            build: &|values| Term::Line(Box::new(laminar_tube(values))),
            observation: Some(&|values| Box::new(laminar_tube(values))),
        },
        Form {
            name: "turbulent-sensor-tube",
            parameters: &[
                PERIOD_S,
                DAMPING_RATIO,
                Parameter::new("turbulent_damping_per_pa", "1/Pa", (0.0, 1e-3), 4e-6),
            ],
            equation: "The sensor reads p; d²p/dt² = ω² (P − p) − 2 ζ ω dp/dt, ω = 2π/period_s, ζ \
                       = damping_ratio + turbulent_damping_per_pa · |dp/dt|/ω",
            source: "The same with losses at the ends of the tube, proportional to the square of \
                     the speed (Ingard & Ising 1967): the damping ratio grows with the rate of \
                     the sensor's pressure over the angular frequency.",
            leaves_out: "higher modes",
            build: &|values| Term::Line(Box::new(turbulent_tube(values))),
            observation: Some(&|values| Box::new(turbulent_tube(values))),
        },
    ],
};

/// RT of the air in the hose \[J/kg\].
const RT_J_PER_KG: f64 = GAS_CONSTANT_J_PER_KG_K * AIR_TEMPERATURE_K;
/// No resistance, to rounding \[kg/(s·Pa)\].
const WIDE_KG_PER_PA_S: f64 = 1e-3;
/// A port that fills faster than this takes the pressure at which valve and hose have the same flow
/// \[s\]: some 5 % of the time in which a muscle fills, and a smaller value would cost steps.
const PORT_INSTANT_S: f64 = 1e-3;
/// A muscle that fills faster than this from a measured pressure is quasi-steady \[s\]: the
/// measured pressure is not known well enough between samples for a finer model.
const QUASI_STEADY_S: f64 = 2e-3;
/// Longest step in which temperature and volume are taken as in the mean of its ends \[s\]: of a
/// jump of the port's pressure 0.3 % are off at most. It is the same for all conductances, so that
/// slopes are smooth.
const FILLING_S: f64 = 2.5e-3;
/// Unit of the temperature in states \[K\].
const STATE_K: f64 = 100.0;
/// Unit of the flow in states \[kg/s\].
const STATE_KG_PER_S: f64 = 1e-3;

/// How a resistance is given.
enum Passing {
    /// By the lag of the muscle's pressure behind that of the port \[s\].
    Lag(f64),
    /// By its mass flow per pressure difference \[kg/(Pa·s)\].
    Conductance(f64),
}

/// The state is the pressure of the port, if the volume there is large enough.
///
/// A volume V_h fills in V_h/RT over the conductances of valve and hose, 0.3 ms for that of a
/// typical hose: then the port has the pressure at which valve and hose have the same flow.
struct Resistance {
    passing: Passing,
    hose_volume_m3: f64,
    stores: bool,
}

impl Resistance {
    /// Conductance from the port into the muscle \[kg/(Pa·s)\]; `None` where it is too large to
    /// have an effect.
    fn through_kg_per_pa_s(&self, volume_m3: f64) -> Option<f64> {
        match self.passing {
            Passing::Lag(lag_s) if lag_s < INSTANT_S => None,
            Passing::Lag(lag_s) => Some(volume_m3 / (RT_J_PER_KG * lag_s)),
            Passing::Conductance(conductance) => {
                (conductance < WIDE_KG_PER_PA_S).then_some(conductance)
            }
        }
    }

    /// Flow from the port into the muscle \[kg/s\].
    fn hose_flow_kg_per_s(&self, point: &LinePoint, port_pa: f64) -> f64 {
        let conductance = self.through_kg_per_pa_s(point.volume_m3).unwrap_or(0.0);
        (port_pa - point.muscle.0) * conductance
    }
}

impl Dynamics<LinePoint> for Resistance {
    fn states(&self) -> usize {
        usize::from(self.stores)
    }

    fn steady_state(&self, point: &LinePoint, state: &mut [f64]) {
        state[0] = point.muscle.0 / STATE_PA;
    }

    fn rates(&self, point: &LinePoint, state: &[f64], rates: &mut [f64]) {
        let stored_kg_per_s =
            point.valve_flow_kg_per_s - self.hose_flow_kg_per_s(point, state[0] * STATE_PA);
        rates[0] = stored_kg_per_s * RT_J_PER_KG / (self.hose_volume_m3 * STATE_PA);
    }
}

impl LineTerm for Resistance {
    fn join(&mut self, flow_gain_kg_per_pa_s: f64, volume: &Volume<f64>) {
        let hose = self.through_kg_per_pa_s(volume.volume_m3(REFERENCE_CONTRACTION));
        self.stores = hose.is_some_and(|hose| {
            let fills_s = self.hose_volume_m3 / (RT_J_PER_KG * (flow_gain_kg_per_pa_s + hose));
            fills_s >= PORT_INSTANT_S
        });
    }

    fn conductance_kg_per_pa_s(&self, point: &LinePoint) -> Option<f64> {
        if self.stores {
            return None;
        }
        self.through_kg_per_pa_s(point.volume_m3)
    }

    fn port(&self, _: &LinePoint, state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        state.first().map_or(port, |port| GaugePa(port * STATE_PA))
    }

    fn flow_kg_per_s(&self, point: &LinePoint, state: &[f64], flow_kg_per_s: f64) -> f64 {
        state.first().map_or(flow_kg_per_s, |port| {
            self.hose_flow_kg_per_s(point, port * STATE_PA)
        })
    }

    fn with_measured_pressure(&self, air: Option<GasSubsystem>) -> Option<Box<dyn MuscleTerm>> {
        match self.passing {
            Passing::Lag(lag_s) => Some(Box::new(LaggingMuscle { lag_s })),
            Passing::Conductance(conductance_kg_per_pa_s) => {
                if conductance_kg_per_pa_s >= WIDE_KG_PER_PA_S {
                    return None;
                }
                Some(Box::new(FilledMuscle {
                    conductance_kg_per_pa_s,
                    air: air?,
                }))
            }
        }
    }
}

/// A muscle whose pressure lags the measured one. The state is its pressure.
struct LaggingMuscle {
    lag_s: f64,
}

impl Dynamics<MusclePoint> for LaggingMuscle {
    fn states(&self) -> usize {
        usize::from(self.lag_s >= INSTANT_S)
    }

    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        state[0] = point.pressure.0 / STATE_PA;
    }

    fn rates(&self, point: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        rates[0] = (point.pressure.0 / STATE_PA - state[0]) / self.lag_s;
    }

    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        let drives = [from, to].map(|point| point.pressure.0 / STATE_PA);
        for state in state {
            *state = lagged(*state, drives, to.time_s - from.time_s, self.lag_s);
        }
    }
}

impl MuscleTerm for LaggingMuscle {
    fn force_n(&self, point: &MusclePoint, law: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        let missing_pa = state
            .first()
            .map_or(0.0, |lagging| point.pressure.0 - lagging * STATE_PA);
        force_n - law.force_per_pressure_m2(point.contraction) * missing_pa
    }
}

/// How the pressure of a muscle changes: toward that of the port, and by heat and motion.
#[derive(Clone, Copy)]
struct Filling {
    /// Share of the difference to the port's pressure \[1/s\].
    per_s: f64,
    /// By all else, in units of the state \[1/s\].
    else_per_s: f64,
}

/// A muscle that is filled from the measured pressure through a conductance, Eqs 3 and 4. The
/// states are its absolute pressure and the temperature of its gas.
struct FilledMuscle {
    conductance_kg_per_pa_s: f64,
    air: GasSubsystem,
}

impl FilledMuscle {
    /// Time constant of the filling at a contraction \[s\].
    fn fills_s(&self, contraction: f64) -> f64 {
        self.air.volume.volume_m3(contraction) / (RT_J_PER_KG * self.conductance_kg_per_pa_s)
    }

    /// Absolute pressure of the port, in units of the state.
    fn port(&self, point: &MusclePoint) -> f64 {
        let atmospheric = self.air.gas.atmospheric_pressure;
        point.pressure.to_absolute(atmospheric).0 / STATE_PA
    }

    /// How the muscle fills in a state, or empties: in a step the air does one of both.
    fn filling(&self, point: &MusclePoint, state: &[f64; 2], enters: bool) -> Filling {
        let temperature_k = if enters {
            self.air.gas.ambient_temperature_k
        } else {
            state[1] * STATE_K
        };
        let warmth = temperature_k / AIR_TEMPERATURE_K;
        let per_s = HEAT_RATIO * warmth / self.fills_s(point.contraction);
        let rate = self.states_rates(point, state, 1.0)[0];
        Filling {
            per_s,
            else_per_s: rate - per_s * (self.port(point) - state[0]),
        }
    }

    /// The states at the end of a step.
    fn filled(&self, ends: &[MusclePoint; 2], begin: &[f64; 2], filling: Filling) -> [f64; 2] {
        let Filling { per_s, else_per_s } = filling;
        let length_s = ends[1].time_s - ends[0].time_s;
        let toward = ends.map(|point| self.port(&point) + else_per_s / per_s);
        let end = lagged(begin[0], toward, length_s, per_s.recip());
        // Of what the port's pressure is more: all that is not by something else.
        let integral_s = (end - begin[0] - else_per_s * length_s) / per_s;
        let mass_kg = |point: &MusclePoint, pressure: f64| {
            let pressure = AbsolutePa(pressure * STATE_PA);
            self.air
                .mass_kg(point.contraction, pressure, begin[1] * STATE_K)
        };
        let entered_kg = self.conductance_kg_per_pa_s * integral_s * STATE_PA;
        let warmth = mass_kg(&ends[1], end) / (mass_kg(&ends[0], begin[0]) + entered_kg);
        [end, begin[1] * warmth]
    }

    /// Rates of the states with `share` of the conductance.
    fn states_rates(&self, point: &MusclePoint, state: &[f64], share: f64) -> [f64; 2] {
        let gas = &self.air.gas;
        let pressure = AbsolutePa(state[0] * STATE_PA);
        let port = point.pressure.to_absolute(gas.atmospheric_pressure);
        let flow_kg_per_s = share * self.conductance_kg_per_pa_s * (port.0 - pressure.0);
        let inside = GasPoint {
            time_s: point.time_s,
            pressure,
            atmospheric: gas.atmospheric_pressure,
            temperature_k: state[1] * STATE_K,
            heat_transfer_w_per_m2_k: self.air.heat_transfer_w_per_m2_k(flow_kg_per_s > 0.0),
            ambient_temperature_k: gas.ambient_temperature_k,
        };
        let exchange = self.air.exchange(&inside, flow_kg_per_s, &[]);
        let rate_per_s = point.contraction_rate_per_s;
        let (pressure_rate, temperature_rate) =
            self.air
                .rates(&inside, point.contraction, rate_per_s, &exchange);
        [pressure_rate / STATE_PA, temperature_rate / STATE_K]
    }
}

impl Dynamics<MusclePoint> for FilledMuscle {
    fn states(&self) -> usize {
        2
    }

    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        state[0] = self.port(point);
        state[1] = self.air.gas.ambient_temperature_k / STATE_K;
    }

    fn rates(&self, point: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        // The equations of a quasi-steady muscle would be stiff.
        let share = (self.fills_s(point.contraction) / QUASI_STEADY_S).min(1.0);
        rates.copy_from_slice(&self.states_rates(point, state, share));
    }

    /// Filled along a linear pressure of the port, with the rest of Eq 4 as in the mean of both
    /// ends (exponential time differencing: Cox & Matthews 2002), in steps of [`FILLING_S`]; a
    /// quasi-steady muscle lags by the pressure difference at which it changes as fast as the port.
    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        let whole_s = to.time_s - from.time_s;
        if whole_s <= 0.0 {
            return;
        }
        let point = |share: f64| MusclePoint {
            time_s: from.time_s + share * whole_s,
            contraction: from.contraction + share * (to.contraction - from.contraction),
            contraction_rate_per_s: (to.contraction - from.contraction) / whole_s,
            direction: 0.0,
            pressure: GaugePa(from.pressure.0 + share * (to.pressure.0 - from.pressure.0)),
        };
        let fills_s = self.fills_s(to.contraction);
        if fills_s < QUASI_STEADY_S {
            let port = self.port(to);
            let port_rate = (to.pressure.0 - from.pressure.0) / (whole_s * STATE_PA);
            let muscle_rate = self.states_rates(&point(1.0), &[port, state[1]], 1.0)[0];
            state[0] = port - (port_rate - muscle_rate) * fills_s / HEAT_RATIO;
            return;
        }
        // Not one more by rounding.
        let steps = (whole_s / FILLING_S - 1e-6).ceil().max(1.0);
        for step in 0..steps as u32 {
            let ends = [step, step + 1].map(|step| point(f64::from(step) / steps));
            let begin = [state[0], state[1]];
            let enters = self.port(&ends[0]) > begin[0];
            let first = self.filling(&ends[0], &begin, enters);
            let end = self.filled(&ends, &begin, first);
            let last = self.filling(&ends[1], &end, enters);
            let mean = Filling {
                per_s: 0.5 * (first.per_s + last.per_s),
                else_per_s: 0.5 * (first.else_per_s + last.else_per_s),
            };
            state.copy_from_slice(&self.filled(&ends, &begin, mean));
        }
    }
}

impl MuscleTerm for FilledMuscle {
    fn force_n(&self, point: &MusclePoint, law: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        let port = point
            .pressure
            .to_absolute(self.air.gas.atmospheric_pressure);
        let missing_pa = port.0 - state[0] * STATE_PA;
        force_n - law.force_per_pressure_m2(point.contraction) * missing_pa
    }
}

/// The states are the pressure of the port and the flow in the hose.
struct Inertance {
    period_s: f64,
    damping_ratio: f64,
    hose_volume_m3: f64,
}

impl Inertance {
    fn rings(&self) -> bool {
        self.period_s >= TAU * INSTANT_S
    }
}

impl Dynamics<LinePoint> for Inertance {
    fn states(&self) -> usize {
        if self.rings() { 2 } else { 0 }
    }

    fn steady_state(&self, point: &LinePoint, state: &mut [f64]) {
        state.copy_from_slice(&[point.muscle.0 / STATE_PA, 0.0]);
    }

    fn rates(&self, point: &LinePoint, state: &[f64], rates: &mut [f64]) {
        let per_capacity_pa_per_kg = RT_J_PER_KG / self.hose_volume_m3;
        let flow_kg_per_s = state[1] * STATE_KG_PER_S;
        rates[0] = (point.valve_flow_kg_per_s - flow_kg_per_s) * per_capacity_pa_per_kg / STATE_PA;
        let angular_per_s = TAU / self.period_s;
        let driving_pa = state[0] * STATE_PA - point.muscle.0;
        // A laminar resistance to mass flow is inversely proportional to the density.
        let muscle_pa = point.muscle.0 + point.atmospheric.0;
        let thinness = (REFERENCE_PRESSURE_PA + point.atmospheric.0) / muscle_pa;
        // 1/I = ω²·(V/RT); the resistance is 2ζωI.
        rates[1] = angular_per_s * angular_per_s * driving_pa
            / (per_capacity_pa_per_kg * STATE_KG_PER_S)
            - 2.0 * self.damping_ratio * thinness * angular_per_s * state[1];
    }
}

impl LineTerm for Inertance {
    fn port(&self, _: &LinePoint, state: &[f64], port: GaugePa<f64>) -> GaugePa<f64> {
        state.first().map_or(port, |port| GaugePa(port * STATE_PA))
    }

    fn flow_kg_per_s(&self, _: &LinePoint, state: &[f64], flow_kg_per_s: f64) -> f64 {
        state
            .get(1)
            .map_or(flow_kg_per_s, |flow| flow * STATE_KG_PER_S)
    }
}

fn laminar_tube(values: &[f64]) -> SensorTube {
    SensorTube {
        period_s: values[0],
        damping_ratio: values[1],
        turbulent_damping_per_pa: 0.0,
    }
}

fn turbulent_tube(values: &[f64]) -> SensorTube {
    SensorTube {
        turbulent_damping_per_pa: values[2],
        ..laminar_tube(values)
    }
}

/// The states are the pressure of the sensor and its swing: its rate over the angular frequency.
struct SensorTube {
    period_s: f64,
    damping_ratio: f64,
    turbulent_damping_per_pa: f64,
}

impl SensorTube {
    /// The damping ratio at a swing.
    fn damping_ratio(&self, swing_pa: f64) -> f64 {
        self.damping_ratio + self.turbulent_damping_per_pa * swing_pa.abs()
    }
}

impl Dynamics<LinePoint> for SensorTube {
    fn states(&self) -> usize {
        if self.period_s >= TAU * INSTANT_S {
            2
        } else {
            0
        }
    }

    fn steady_state(&self, point: &LinePoint, state: &mut [f64]) {
        state.copy_from_slice(&[point.muscle.0 / STATE_PA, 0.0]);
    }

    fn rates(&self, point: &LinePoint, state: &[f64], rates: &mut [f64]) {
        let angular_per_s = TAU / self.period_s;
        let damping_ratio = self.damping_ratio(state[1] * STATE_PA);
        let pull = point.muscle.0 / STATE_PA - state[0] - 2.0 * damping_ratio * state[1];
        rates[0] = angular_per_s * state[1];
        rates[1] = angular_per_s * pull;
    }
}

impl LineTerm for SensorTube {
    fn sensor(&self, _: &LinePoint, state: &[f64], sensor: GaugePa<f64>) -> GaugePa<f64> {
        state
            .first()
            .map_or(sensor, |sensor| GaugePa(sensor * STATE_PA))
    }
}

impl Observation for SensorTube {
    /// p + 2ζ/ω ṗ + p̈/ω² by differences over an eighth of a period: shorter ones would amplify the
    /// noise, longer ones miss more than 5 % of a ringing.
    fn before_sensor_pa(&self, time_s: &[f64], read_pa: &[f64]) -> Option<Vec<f64>> {
        let span_s = self.period_s / 8.0;
        let before = |row: usize| {
            let beyond = |other: &usize| (time_s[*other] - time_s[row]).abs() >= span_s;
            let from = (0..row).rev().find(beyond)?;
            let to = (row + 1..time_s.len()).find(beyond)?;
            let [back_s, on_s] = [time_s[row] - time_s[from], time_s[to] - time_s[row]];
            let back = (read_pa[row] - read_pa[from]) / back_s;
            let on = (read_pa[to] - read_pa[row]) / on_s;
            let rate = (back * on_s + on * back_s) / (back_s + on_s);
            let bend = 2.0 * (on - back) / (back_s + on_s);
            let per_angle_s = self.period_s / TAU;
            let damping_ratio = self.damping_ratio(per_angle_s * rate);
            let ahead = per_angle_s * (2.0 * damping_ratio * rate + per_angle_s * bend);
            ahead.is_finite().then_some(read_pa[row] + ahead)
        };
        let before_pa = read_pa
            .iter()
            .enumerate()
            .map(|(row, read_pa)| before(row).unwrap_or(*read_pa))
            .collect();
        Some(before_pa)
    }
}

#[cfg(test)]
mod tests;

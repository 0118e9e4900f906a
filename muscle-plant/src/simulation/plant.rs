//! The muscle plant: its subsystems and their connections (Eqs 1–5 and 9).
//!
//! ```text
//! P_r ─ line (delay) ─ valve ─ line (hose) ─ gas ─ P ─ muscle force ─ F ─ load ─ ε
//!                        │                    └──────────── ε, ε̇ ───────────┘
//!                      supply                          sensors read P, ε, F
//! ```
//!
//! A subsystem is its nominal equation and a list of terms, the effects that were added to it.
//! Terms are called out of line, with a copy of their inputs, so that the nominal plant keeps all
//! of them in registers. A subsystem can run alone on measured inputs: without a load the
//! contraction is an input, without pneumatics the pressure is ([`Simulated`]). Pressures in the
//! state are absolute.

use super::drive::{Drive, Regime, Simulated};
use crate::nominal::{Gas, Load, Nominal};
use crate::subsystem::Term;
use crate::subsystem::gas::{GasPoint, GasSubsystem};
use crate::subsystem::line::{LinePoint, LineSubsystem, PortResistance};
use crate::subsystem::load::{LoadPoint, LoadSubsystem, Motion};
use crate::subsystem::muscle::{MusclePoint, MuscleSubsystem};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorSubsystem};
use crate::subsystem::supply::{SupplyPoint, SupplySubsystem};
use crate::subsystem::term::{Terms, Update};
use crate::subsystem::valve::{ValvePoint, ValveSubsystem};
use model_core::muscle::Volume;
use model_core::pressure::{AbsolutePa, GaugePa};
use std::ops::Range;

/// Index of the contraction ε \[-\] in the state.
pub const CONTRACTION: usize = 0;
/// Index of the contraction rate \[1/s\] in the state.
pub const CONTRACTION_RATE: usize = 1;
/// Index of the absolute pressure \[Pa\] in the state.
pub const PRESSURE: usize = 2;
/// Index of the gas temperature \[K\] in the state.
pub const TEMPERATURE: usize = 3;
/// Number of states of the nominal plant; those of effects follow.
pub const NOMINAL_STATES: usize = 4;
/// Largest number of states of a plant with effects.
pub const STATES_MAX: usize = 40;

/// Time step of the difference quotient of the flow \[s\].
const FLOW_SLOPE_S: f64 = 1e-6;
/// Bisections in the search for a memory that holds the weight.
const BIAS_HALVINGS: u32 = 40;

/// Valve, line, supply and gas, which determine the pressure.
pub struct Pneumatics {
    /// The servo valve.
    pub valve: ValveSubsystem,
    /// Hose and command line.
    pub line: LineSubsystem,
    /// The air supply of the valve.
    pub supply: SupplySubsystem,
    /// The air in the muscle.
    pub gas: GasSubsystem,
}

/// The plant of one rig.
pub struct Plant {
    /// Eq 1 and its terms.
    pub muscle: MuscleSubsystem,
    /// The weight; `None` where the contraction is an input.
    pub load: Option<LoadSubsystem>,
    /// `None` where the pressure is an input.
    pub pneumatics: Option<Pneumatics>,
    /// The instruments.
    pub sensors: SensorSubsystem,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
    /// Ambient temperature \[K\].
    pub ambient_temperature_k: f64,
    /// Air and volume of the muscle, if the rig has them.
    filling: Option<(Gas, Volume<f64>)>,
    /// Position of the states of each added term, in the order of adding.
    term_states: Vec<Range<usize>>,
    states: usize,
}

/// Reasons for which no plant can be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlantError {
    /// The pressure is simulated without a valve.
    #[error("the pressure is simulated, and the rig has no valve")]
    NoValve,
    /// The pressure is simulated without the air's constants.
    #[error("the pressure is simulated, and the rig has no constants of its air")]
    NoGas,
    /// The pressure is simulated without the muscle's volume.
    #[error("the pressure is simulated, and the rig has no volume of its muscle")]
    NoVolume,
    /// The terms have more states than a plant holds.
    #[error("the effects have {found} states together, more than {max}")]
    TooManyStates {
        /// States of all terms together.
        found: usize,
        /// Largest number.
        max: usize,
    },
}

/// One instant of the pneumatics: the inputs of each subsystem, and the flow into the muscle.
struct PneumaticSignals {
    supply: SupplyPoint,
    valve: ValvePoint,
    line: LinePoint,
    gas: GasPoint,
    flow_kg_per_s: f64,
}

impl Pneumatics {
    // Always inline: most callers need a small part of the result.
    #[inline(always)]
    fn signals(
        &self,
        time_s: f64,
        drive: &Drive,
        atmospheric: AbsolutePa<f64>,
        charging: bool,
        state: &[f64],
    ) -> PneumaticSignals {
        let pressure = AbsolutePa(state[PRESSURE]);
        let mut supply = SupplyPoint {
            time_s,
            drawn_kg_per_s: 0.0,
            nominal: self.supply.nominal,
            atmospheric,
        };
        let supply_pressure = match drive.supply {
            None => self.supply.pressure(&supply, state),
            Some(ramp) => GaugePa(ramp.value + ramp.rate_per_s * (time_s - ramp.start_s)),
        };
        let mut line = LinePoint {
            time_s,
            reference: drive.reference,
            muscle: pressure.to_gauge(atmospheric),
            atmospheric,
            volume_m3: self.gas.volume.volume_m3(state[CONTRACTION]),
            valve_flow_kg_per_s: 0.0,
        };
        let mut valve = ValvePoint {
            time_s,
            reference: self.line.reference(&line, state),
            port: self.line.port(&line, state),
            supply: supply_pressure,
            atmospheric,
        };
        let limited = drive.supply.is_none() && !self.supply.terms.is_empty();
        if !drive.shut {
            if let Some(resistance) = self.line.resistance(&line) {
                valve.port = self.before(&resistance, valve, limited, state);
            }
            [line.valve_flow_kg_per_s, supply.drawn_kg_per_s] = self.flows(&valve, limited, state);
        }
        let gas = GasPoint {
            time_s,
            pressure,
            atmospheric,
            temperature_k: state[TEMPERATURE],
            heat_transfer_w_per_m2_k: self.gas.heat_transfer_w_per_m2_k(charging),
            ambient_temperature_k: self.gas.gas.ambient_temperature_k,
        };
        let flow_kg_per_s = self.line.flow_kg_per_s(&line, state);
        PneumaticSignals {
            supply,
            valve,
            line,
            gas,
            flow_kg_per_s,
        }
    }
}

impl Plant {
    /// The simulated part of a rig with these `nominal` values and `terms`. A term of a subsystem
    /// that is not simulated has no effect.
    ///
    /// # Errors
    /// A nominal value is needed and absent, or the terms have too many states.
    pub fn new(
        nominal: &Nominal,
        terms: impl IntoIterator<Item = Term>,
        simulated: Simulated,
    ) -> Result<Plant, PlantError> {
        let initial_length_m = nominal.muscle.initial_length_m;
        let pneumatics = if simulated.pressure {
            let valve = nominal.valve.ok_or(PlantError::NoValve)?;
            Some(Pneumatics {
                valve: ValveSubsystem {
                    flow_gain_kg_per_pa_s: valve.flow_gain_kg_per_pa_s,
                    terms: Terms::default(),
                },
                line: LineSubsystem::default(),
                supply: SupplySubsystem {
                    nominal: valve.supply_pressure,
                    terms: Terms::default(),
                },
                gas: GasSubsystem {
                    gas: nominal.gas.ok_or(PlantError::NoGas)?,
                    volume: nominal.volume.ok_or(PlantError::NoVolume)?,
                    initial_length_m,
                    terms: Terms::default(),
                },
            })
        } else {
            None
        };
        let load = match (nominal.load, simulated.motion) {
            (Load::Weight(weight), true) => Some(LoadSubsystem {
                weight,
                initial_length_m,
                terms: Terms::default(),
            }),
            _ => None,
        };
        let gas = nominal.gas.unwrap_or(Gas::STANDARD);
        let mut plant = Plant {
            muscle: MuscleSubsystem {
                law: nominal.muscle,
                terms: Terms::default(),
            },
            load,
            pneumatics,
            sensors: SensorSubsystem {
                initial_length_m,
                terms: Terms::default(),
            },
            atmospheric: gas.atmospheric_pressure,
            ambient_temperature_k: gas.ambient_temperature_k,
            filling: nominal.gas.zip(nominal.volume),
            term_states: Vec::new(),
            states: NOMINAL_STATES,
        };
        for term in terms {
            plant.add(term);
        }
        if plant.states > STATES_MAX {
            return Err(PlantError::TooManyStates {
                found: plant.states - NOMINAL_STATES,
                max: STATES_MAX - NOMINAL_STATES,
            });
        }
        Ok(plant)
    }

    /// Length of the state.
    pub fn states(&self) -> usize {
        self.states
    }

    /// Adds a term to its subsystem. A term of a subsystem that is not simulated is dropped.
    pub fn add(&mut self, term: Term) {
        let first = self.states;
        let states = match (term, &mut self.pneumatics, &mut self.load) {
            (Term::Muscle(term), ..) => self.muscle.terms.push(term, first),
            (Term::Sensor(term), ..) => self.sensors.terms.push(term, first),
            (Term::Load(term), _, Some(load)) => load.terms.push(term, first),
            (Term::Valve(term), Some(part), _) => part.valve.terms.push(term, first),
            (Term::Line(mut term), Some(part), _) => {
                term.join(part.valve.flow_gain_kg_per_pa_s, &part.gas.volume);
                part.line.terms.push(term, first)
            }
            (Term::Gas(term), Some(part), _) => part.gas.terms.push(term, first),
            (Term::Supply(term), Some(part), _) => part.supply.terms.push(term, first),
            (Term::Line(term), None, _) => match term.with_measured_pressure(self.air()) {
                Some(term) => self.muscle.terms.push(term, first),
                None => 0,
            },
            _ => 0,
        };
        self.term_states.push(first..first + states);
        self.states += states;
    }

    /// Position in the state of the states of the term that was added as number `number`, from 0;
    /// an empty range for a term without states or of a subsystem that is not simulated.
    pub fn term_states(&self, number: usize) -> Range<usize> {
        self.term_states.get(number).cloned().unwrap_or_default()
    }

    /// The air of the muscle where the pressure is an input, if the rig has its constants.
    fn air(&self) -> Option<GasSubsystem> {
        let (gas, volume) = self.filling?;
        Some(GasSubsystem {
            gas,
            volume,
            initial_length_m: self.muscle.law.initial_length_m,
            terms: Terms::default(),
        })
    }

    /// Inputs of the muscle-force terms in `state`.
    #[inline]
    pub fn muscle_point(&self, time_s: f64, state: &[f64]) -> MusclePoint {
        MusclePoint {
            time_s,
            contraction: state[CONTRACTION],
            contraction_rate_per_s: state[CONTRACTION_RATE],
            direction: 0.0,
            pressure: AbsolutePa(state[PRESSURE]).to_gauge(self.atmospheric),
        }
    }

    #[inline]
    fn load_point(&self, time_s: f64, state: &[f64]) -> LoadPoint {
        LoadPoint {
            time_s,
            contraction: state[CONTRACTION],
            contraction_rate_per_s: state[CONTRACTION_RATE],
            direction: 0.0,
            initial_length_m: self.muscle.law.initial_length_m,
        }
    }

    /// Muscle force \[N\] in `state`.
    #[inline]
    pub fn force_n(&self, time_s: f64, state: &[f64]) -> f64 {
        self.muscle
            .force_n(&self.muscle_point(time_s, state), state)
    }

    /// See [`LoadSubsystem::breakaway_n`].
    #[inline]
    pub fn breakaway_n(&self, load: &LoadSubsystem, time_s: f64, state: &[f64]) -> (f64, Motion) {
        let force_n = self.force_n(time_s, state);
        load.breakaway_n(&self.load_point(time_s, state), state, force_n)
    }

    /// Mass flow from the line into the muscle \[kg/s\]; 0 where the pressure is an input.
    #[inline]
    pub fn flow_kg_per_s(&self, time_s: f64, drive: &Drive, state: &[f64]) -> f64 {
        self.pneumatics.as_ref().map_or(0.0, |pneumatics| {
            let signals = pneumatics.signals(time_s, drive, self.atmospheric, false, state);
            signals.flow_kg_per_s
        })
    }

    /// Rates of the state under `drive` in `regime`.
    #[inline]
    pub fn rates<const N: usize>(
        &self,
        time_s: f64,
        drive: &Drive,
        regime: Regime,
        state: &[f64; N],
    ) -> [f64; N] {
        let mut rates = [0.0; N];
        if let Some(load) = &self.load {
            if regime.motion != Motion::Stuck {
                let force_n = self.force_n(time_s, state);
                let point = self.load_point(time_s, state);
                rates[CONTRACTION] = state[CONTRACTION_RATE];
                rates[CONTRACTION_RATE] =
                    load.acceleration_per_s2(&point, state, force_n, regime.motion);
            }
        } else {
            rates[CONTRACTION] = state[CONTRACTION_RATE];
            rates[CONTRACTION_RATE] = drive.contraction_acceleration_per_s2;
        }
        if let Some(pneumatics) = &self.pneumatics {
            let signals =
                pneumatics.signals(time_s, drive, self.atmospheric, regime.charging, state);
            let gas = &pneumatics.gas;
            let exchange = gas.exchange(&signals.gas, signals.flow_kg_per_s, state);
            let (contraction, rate) = (state[CONTRACTION], state[CONTRACTION_RATE]);
            let (pressure_rate, temperature_rate) =
                gas.rates(&signals.gas, contraction, rate, &exchange);
            rates[PRESSURE] = pressure_rate;
            rates[TEMPERATURE] = temperature_rate;
            if N > NOMINAL_STATES {
                pneumatics.term_rates(&signals, state, &mut rates);
            }
        } else {
            rates[PRESSURE] = drive.pressure_rate_pa_per_s;
        }
        if N > NOMINAL_STATES {
            let direction = match (&self.load, regime.motion) {
                (None, _) if drive.contraction_rate_per_s == 0.0 => 0.0,
                (None, _) => drive.contraction_rate_per_s.signum(),
                (Some(_), Motion::Stuck) => 0.0,
                (Some(_), Motion::Rising) => 1.0,
                (Some(_), Motion::Falling) => -1.0,
            };
            self.term_rates((time_s, drive), direction, state, &mut rates);
        }
        rates
    }

    /// At zero flow, where the heat transfer jumps: the share of charging that keeps the flow at
    /// zero, and the rates with that share. For a share in (0, 1) the flow stays at zero, as either
    /// sign would reverse it (sliding solution of Filippov); it is 0 or less where the flow becomes
    /// negative and 1 or more where it becomes positive.
    #[cold]
    pub fn at_reversal<const N: usize>(
        &self,
        time_s: f64,
        drive: &Drive,
        regime: Regime,
        state: &[f64; N],
    ) -> (f64, [f64; N]) {
        let both = [false, true].map(|charging| {
            let regime = Regime { charging, ..regime };
            self.rates(time_s, drive, regime, state)
        });
        let flow_kg_per_s = self.flow_kg_per_s(time_s, drive, state);
        let [discharging, charging] = both.map(|rates| {
            let next: [f64; N] = core::array::from_fn(|i| state[i] + FLOW_SLOPE_S * rates[i]);
            self.flow_kg_per_s(time_s + FLOW_SLOPE_S, drive, &next) - flow_kg_per_s
        });
        let share = if discharging > charging {
            discharging / (discharging - charging)
        } else if charging > 0.0 {
            1.0
        } else {
            0.0
        };
        let rates = core::array::from_fn(|i| both[0][i] + share * (both[1][i] - both[0][i]));
        (share, rates)
    }

    /// Rates of the states of the terms of muscle, load and sensors.
    fn term_rates(
        &self,
        (time_s, drive): (f64, &Drive),
        direction: f64,
        state: &[f64],
        rates: &mut [f64],
    ) {
        let mut muscle = self.muscle_point(time_s, state);
        muscle.direction = direction;
        self.muscle.terms.rates(&muscle, state, rates);
        if let Some(load) = &self.load {
            let mut point = self.load_point(time_s, state);
            point.direction = direction;
            load.terms.rates(&point, state, rates);
        }
        if self.sensors.terms.have_states() {
            let sensors = self.sensor_point(time_s, drive, state);
            self.sensors.terms.rates(&sensors, state, rates);
        }
    }

    /// Sets the states of all effects to their values after a long rest in `state`.
    pub fn steady_state(&self, time_s: f64, drive: &Drive, state: &mut [f64]) {
        // Twice: the inputs of a subsystem depend on the steady states of those before it.
        self.update_terms(Update::SteadyState, time_s, drive, state);
        self.update_terms(Update::SteadyState, time_s, drive, state);
        if state.len() > NOMINAL_STATES {
            self.bias_memory(time_s, drive, state);
        }
    }

    /// Selects, among the memories that are possible after a rest, one with which the weight rests.
    ///
    /// A rate-independent memory cannot be observed in a single instant. For a weight at rest the
    /// forces must balance to within static friction; for one that falls the memory is that of an
    /// extension.
    fn bias_memory(&self, time_s: f64, drive: &Drive, state: &mut [f64]) {
        let Some(load) = &self.load else { return };
        if state[CONTRACTION_RATE] < 0.0 {
            self.update_terms(Update::BiasMemory(-1.0), time_s, drive, state);
        }
        let held = self.breakaway_n(load, time_s, state).0 <= 0.0;
        if held || state[CONTRACTION_RATE] != 0.0 {
            return;
        }
        // The force falls with the share.
        let (mut low, mut high) = (-1.0, 1.0);
        for _ in 0..BIAS_HALVINGS {
            let share = 0.5 * (low + high);
            self.update_terms(Update::BiasMemory(share), time_s, drive, state);
            match self.breakaway_n(load, time_s, state) {
                (excess_n, _) if excess_n <= 0.0 => return,
                (_, Motion::Falling) => high = share,
                (..) => low = share,
            }
        }
    }

    /// Updates the states of all terms in one of the ways of [`Update`], from the supply to the
    /// sensors.
    pub fn update_terms(&self, how: Update, time_s: f64, drive: &Drive, state: &mut [f64]) {
        if state.len() <= NOMINAL_STATES {
            return;
        }
        if let Some(pneumatics) = &self.pneumatics {
            let signals = pneumatics.signals(time_s, drive, self.atmospheric, false, state);
            pneumatics.supply.terms.update(how, &signals.supply, state);
            pneumatics.line.terms.update(how, &signals.line, state);
            pneumatics.valve.terms.update(how, &signals.valve, state);
            pneumatics.gas.terms.update(how, &signals.gas, state);
        }
        let muscle = self.muscle_point(time_s, state);
        self.muscle.terms.update(how, &muscle, state);
        if let Some(load) = &self.load {
            let point = self.load_point(time_s, state);
            load.terms.update(how, &point, state);
        }
        if !self.sensors.terms.is_empty() {
            let sensors = self.sensor_point(time_s, drive, state);
            self.sensors.terms.update(how, &sensors, state);
        }
    }

    /// Propagates the states of muscle and sensors where pressure and contraction are inputs, from
    /// an instant to another; `state` already contains the inputs at the latter.
    pub fn propagate(&self, (from_s, before): (f64, &[f64]), to_s: f64, state: &mut [f64]) {
        let from = self.muscle_point(from_s, before);
        let to = self.muscle_point(to_s, state);
        self.muscle.terms.propagate(&from, &to, state);
        if !self.sensors.terms.is_empty() {
            let drive = Drive::default();
            let from = self.sensor_point(from_s, &drive, before);
            let to = self.sensor_point(to_s, &drive, state);
            self.sensors.terms.propagate(&from, &to, state);
        }
    }

    fn sensor_point(&self, time_s: f64, drive: &Drive, state: &[f64]) -> SensorPoint {
        let pressure = match &self.pneumatics {
            Some(pneumatics) if !pneumatics.line.terms.is_empty() => {
                let signals = pneumatics.signals(time_s, drive, self.atmospheric, false, state);
                let (line, port) = (&signals.line, signals.valve.port);
                pneumatics.line.sensor(line, port, state)
            }
            _ => AbsolutePa(state[PRESSURE]).to_gauge(self.atmospheric),
        };
        SensorPoint {
            time_s,
            initial_length_m: self.sensors.initial_length_m,
            truth: Reading {
                pressure,
                contraction: state[CONTRACTION],
                force_n: self.force_n(time_s, state),
            },
        }
    }

    /// Readings of the instruments in `state` under `drive`, without noise.
    pub fn read(&self, time_s: f64, drive: &Drive, state: &[f64]) -> Reading {
        self.sensors
            .read(&self.sensor_point(time_s, drive, state), state)
    }
}

impl Pneumatics {
    /// Mass flows through the valve into the line, and out of the supply \[kg/s\]; `limited` if the
    /// pressure of the supply is not constant.
    #[inline]
    fn flows(&self, valve: &ValvePoint, limited: bool, state: &[f64]) -> [f64; 2] {
        let flow_kg_per_s = self.valve.flow_kg_per_s(valve, state);
        if limited {
            return self.flow_back(valve, flow_kg_per_s, state);
        }
        [flow_kg_per_s, flow_kg_per_s.max(0.0)]
    }

    /// Air that flows back through a valve that is open to its supply returns to the supply, or
    /// stays in the line if there is a check valve.
    #[cold]
    fn flow_back(&self, valve: &ValvePoint, flow_kg_per_s: f64, state: &[f64]) -> [f64; 2] {
        if flow_kg_per_s >= 0.0 || !self.valve.open_to_supply(valve, state) {
            [flow_kg_per_s, flow_kg_per_s.max(0.0)]
        } else if self.supply.checks() {
            [0.0, 0.0]
        } else {
            [flow_kg_per_s, flow_kg_per_s]
        }
    }

    /// Pressure at the valve's port before a resistance without volume; `valve.port` is the
    /// pressure behind it.
    #[cold]
    fn before(
        &self,
        resistance: &PortResistance,
        valve: ValvePoint,
        limited: bool,
        state: &[f64],
    ) -> GaugePa<f64> {
        resistance.before(valve.port, valve.supply, |port| {
            self.flows(&ValvePoint { port, ..valve }, limited, state)[0]
        })
    }

    /// Rates of the states of the terms of the pneumatics.
    fn term_rates(&self, signals: &PneumaticSignals, state: &[f64], rates: &mut [f64]) {
        self.supply.terms.rates(&signals.supply, state, rates);
        self.line.terms.rates(&signals.line, state, rates);
        self.valve.terms.rates(&signals.valve, state, rates);
        self.gas.terms.rates(&signals.gas, state, rates);
    }
}

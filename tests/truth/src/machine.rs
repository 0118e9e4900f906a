//! The rig in motion: gas as mass and internal energy, weight with stiction and a stop, and the
//! integrator that finds when the weight sticks, slips and lands.

mod adaptive;

use std::f64::consts::PI;

use crate::hidden::{Hidden, Load, Moment, Reading};
use crate::rig::Rig;

/// Specific gas constant of air.
pub(crate) const GAS_CONSTANT_J_PER_KG_K: f64 = 287.0;
/// Heat capacity of air at constant volume.
pub(crate) const HEAT_CAPACITY_V_J_PER_KG_K: f64 = 718.0;
/// Heat capacity of air at constant pressure.
pub(crate) const HEAT_CAPACITY_P_J_PER_KG_K: f64 = 1005.0;
/// Standard gravity.
pub(crate) const GRAVITY_M_PER_S2: f64 = 9.80665;

/// Room for the rig's four states and those of its effects.
const STATES: usize = 64;
const MASS: usize = 0;
const ENERGY: usize = 1;
const CONTRACTION: usize = 2;
const RATE: usize = 3;
const OWN: usize = 4;
type State = [f64; STATES];

/// Tolerance of the time of a change of motion.
const EVENT_S: f64 = 1e-9;

/// Motion of the weight.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// Held by friction or by the stop.
    Rest,
    Up,
    Down,
}

/// Results of an evaluation in addition to the rates.
struct Balance {
    now: Moment,
    /// Upward on the load without dry friction.
    net_n: f64,
    static_n: f64,
}

/// A rig with its effects, in one state.
pub(crate) struct Machine<'a> {
    rig: &'a Rig,
    hidden: Vec<(&'a dyn Hidden, usize, usize)>,
    x: State,
    time_s: f64,
    command_pa: f64,
    motion: Motion,
    pace: adaptive::Pace,
}

impl<'a> Machine<'a> {
    /// The rig at rest on its stop, filled to `command_pa`.
    pub(crate) fn at_rest(
        rig: &'a Rig,
        effects: &[&'a dyn Hidden],
        time_s: f64,
        command_pa: f64,
    ) -> Self {
        let mut x = [0.0; STATES];
        let absolute_pa = command_pa + rig.atmospheric_pressure_pa;
        let heat = GAS_CONSTANT_J_PER_KG_K * rig.ambient_temperature_k;
        x[MASS] = absolute_pa * rig.volume_d3_m3 / heat;
        x[ENERGY] = x[MASS] * HEAT_CAPACITY_V_J_PER_KG_K * rig.ambient_temperature_k;
        let mut hidden = Vec::new();
        let mut next = OWN;
        for effect in effects {
            hidden.push((*effect, next, next + effect.states()));
            next += effect.states();
        }
        assert!(next <= STATES, "{next} states do not fit");
        let motion = Motion::Rest;
        let mut machine = Self {
            rig,
            hidden,
            x,
            time_s,
            command_pa,
            motion,
            pace: adaptive::Pace::default(),
        };
        machine.settle();
        machine
    }

    /// Sets the effects' states to their steady state at the present state.
    pub(crate) fn settle(&mut self) {
        let mut now = self.balance().now;
        now.rate_per_s = 0.0;
        for (effect, from, to) in &self.hidden {
            effect.settle(&now, &mut self.x[*from..*to]);
        }
    }

    fn moment(&self, time_s: f64, x: &State) -> Moment {
        let rig = self.rig;
        let contraction = x[CONTRACTION];
        let volume_m3 = rig.volume_d1_m3 * contraction * contraction
            + rig.volume_d2_m3 * contraction
            + rig.volume_d3_m3;
        let temperature_k = x[ENERGY] / (x[MASS] * HEAT_CAPACITY_V_J_PER_KG_K);
        let absolute_pa = x[MASS] * GAS_CONSTANT_J_PER_KG_K * temperature_k / volume_m3;
        let length_m = rig.initial_length_m * (1.0 - contraction);
        let mut ambient_k = rig.ambient_temperature_k;
        for (effect, ..) in &self.hidden {
            ambient_k = effect.ambient_k(ambient_k, time_s);
        }
        Moment {
            time_s,
            contraction,
            rate_per_s: x[RATE],
            temperature_k,
            pressure_pa: absolute_pa - rig.atmospheric_pressure_pa,
            area_m2: rig.alpha_m2 * (1.0 - contraction).powi(2) + rig.beta_m2,
            surface_m2: 2.0 * (PI * volume_m3 * length_m).sqrt(),
            ambient_k,
            command_pa: self.command_pa,
            ..Moment::default()
        }
    }

    /// Valve and gas: fills in the reference and the flow, and the rates of mass and energy.
    fn gas(&self, now: &mut Moment, x: &State, dx: &mut State) {
        let rig = self.rig;
        let mut reference_pa = self.command_pa.clamp(0.0, rig.supply_pressure_pa);
        let mut side_pa = now.pressure_pa;
        for &(effect, a, b) in &self.hidden {
            reference_pa = effect.reference_pa(reference_pa, now, &x[a..b], &mut dx[a..b]);
            side_pa = effect.valve_side_pa(side_pa, &x[a..b]);
        }
        now.reference_pa = reference_pa;
        let mut flow = rig.flow_gain_kg_per_pa_s * (reference_pa - side_pa);
        for &(effect, a, b) in &self.hidden {
            flow = effect.flow_kg_per_s(flow, now, &x[a..b], &mut dx[a..b]);
        }
        now.flow_kg_per_s = flow;
        let (transfer, carried_k) = if flow > 0.0 {
            (rig.heat_transfer_charging_w_per_m2_k, now.ambient_k)
        } else {
            (rig.heat_transfer_discharging_w_per_m2_k, now.temperature_k)
        };
        let mut heat_w = transfer * now.surface_m2 * (now.ambient_k - now.temperature_k);
        let mut leak = 0.0;
        for &(effect, a, b) in &self.hidden {
            heat_w = effect.heat_w(heat_w, now, &x[a..b], &mut dx[a..b]);
            leak += effect.leak_kg_per_s(now);
        }
        let volume_rate =
            (2.0 * rig.volume_d1_m3 * now.contraction + rig.volume_d2_m3) * now.rate_per_s;
        let absolute_pa = now.pressure_pa + rig.atmospheric_pressure_pa;
        let leaked_k = if leak > 0.0 {
            now.temperature_k
        } else {
            now.ambient_k
        };
        dx[MASS] = flow - leak;
        dx[ENERGY] = HEAT_CAPACITY_P_J_PER_KG_K * (flow * carried_k - leak * leaked_k)
            - absolute_pa * volume_rate
            + heat_w;
    }

    fn evaluate(&self, time_s: f64, x: &State, dx: &mut State) -> Balance {
        let rig = self.rig;
        let mut now = self.moment(time_s, x);
        self.gas(&mut now, x, dx);
        let mut force_n = now.area_m2 * now.pressure_pa + rig.gamma_n;
        let mut load = Load {
            mass_kg: rig.mass_kg,
            pull_n: 0.0,
            coulomb_n: rig.coulomb_friction_n,
            static_n: rig.static_friction_n,
        };
        for &(effect, a, b) in &self.hidden {
            force_n = effect.force_n(force_n, &now, &x[a..b], &mut dx[a..b]);
        }
        now.force_n = force_n;
        for &(effect, a, b) in &self.hidden {
            effect.load(&mut load, &now, &x[a..b], &mut dx[a..b]);
        }
        let speed_m_per_s = rig.initial_length_m * now.rate_per_s;
        let net_n = force_n
            - load.mass_kg * GRAVITY_M_PER_S2
            - load.pull_n
            - rig.viscous_damping_ns_per_m * speed_m_per_s;
        let dry_n = match self.motion {
            Motion::Rest => net_n,
            Motion::Up => load.coulomb_n,
            Motion::Down => -load.coulomb_n,
        };
        dx[CONTRACTION] = if self.motion == Motion::Rest {
            0.0
        } else {
            now.rate_per_s
        };
        dx[RATE] = (net_n - dry_n) / (load.mass_kg * rig.initial_length_m);
        Balance {
            now,
            net_n,
            static_n: load.static_n.max(load.coulomb_n),
        }
    }

    fn balance(&self) -> Balance {
        self.evaluate(self.time_s, &self.x, &mut [0.0; STATES])
    }

    /// The state after a classical Runge–Kutta step of fourth order.
    fn runge_kutta(&self, step_s: f64) -> State {
        let len = self.hidden.last().map_or(OWN, |(.., to)| *to);
        let mut sum = [0.0; STATES];
        let mut rate = [0.0; STATES];
        for (part, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            let mut x = self.x;
            for i in 0..len {
                x[i] += part * step_s * rate[i];
            }
            self.evaluate(self.time_s + part * step_s, &x, &mut rate);
            for i in 0..len {
                sum[i] += weight * rate[i];
            }
        }
        let mut x = self.x;
        for i in 0..len {
            x[i] += step_s / 6.0 * sum[i];
        }
        x
    }

    /// Direction in which a resting weight breaks away.
    fn torn(&self, balance: &Balance) -> Option<Motion> {
        if balance.net_n > balance.static_n {
            Some(Motion::Up)
        } else if balance.net_n < -balance.static_n && balance.now.contraction > 0.0 {
            Some(Motion::Down)
        } else {
            None
        }
    }

    /// Whether the present motion has ended before `x`, `step_s` later.
    fn ended(&self, step_s: f64, x: &State) -> bool {
        match self.motion {
            Motion::Rest => {
                let balance = self.evaluate(self.time_s + step_s, x, &mut [0.0; STATES]);
                self.torn(&balance).is_some()
            }
            Motion::Up => x[RATE] < 0.0,
            Motion::Down => x[RATE] > 0.0 || x[CONTRACTION] < 0.0,
        }
    }

    fn accept(&mut self, step_s: f64, x: State) {
        self.x = x;
        self.time_s += step_s;
        let now = self.balance().now;
        for (effect, from, to) in &self.hidden {
            effect.commit(&now, &mut self.x[*from..*to]);
        }
    }

    /// Takes one step under a constant command, in parts where the motion changes.
    pub(crate) fn step(&mut self, step_s: f64, command_pa: f64) {
        self.command_pa = command_pa;
        let mut left_s = step_s;
        // limits the number of changes of motion, as a chattering weight would have no end
        for _ in 0..40 {
            if self.motion == Motion::Rest
                && let Some(motion) = self.torn(&self.balance())
            {
                self.motion = motion;
            }
            let x = self.runge_kutta(left_s);
            if !self.ended(left_s, &x) {
                return self.accept(left_s, x);
            }
            let (mut before_s, mut after_s) = (0.0, left_s);
            while after_s - before_s > EVENT_S {
                let middle_s = 0.5 * (before_s + after_s);
                if self.ended(middle_s, &self.runge_kutta(middle_s)) {
                    after_s = middle_s;
                } else {
                    before_s = middle_s;
                }
            }
            let mut x = self.runge_kutta(after_s);
            x[RATE] = 0.0;
            x[CONTRACTION] = x[CONTRACTION].max(0.0);
            self.accept(after_s, x);
            self.motion = Motion::Rest;
            left_s -= after_s;
            if left_s < EVENT_S {
                return;
            }
        }
        let x = self.runge_kutta(left_s);
        self.accept(left_s, x);
    }

    /// True values.
    pub(crate) fn truth(&self) -> Reading {
        let now = self.balance().now;
        Reading {
            pressure_pa: now.pressure_pa,
            contraction: now.contraction,
            force_n: now.force_n,
        }
    }

    /// Readings of the sensors without noise.
    pub(crate) fn reading(&self) -> Reading {
        let now = self.balance().now;
        let mut reading = self.truth();
        for (effect, a, b) in &self.hidden {
            effect.read(&mut reading, &now, &self.x[*a..*b]);
        }
        reading
    }

    #[cfg(test)]
    pub(crate) fn now(&self) -> Moment {
        self.balance().now
    }

    #[cfg(test)]
    pub(crate) fn mass_and_energy(&self) -> (f64, f64) {
        (self.x[MASS], self.x[ENERGY])
    }
}

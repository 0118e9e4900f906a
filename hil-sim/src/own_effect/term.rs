//! The term of an effect of one's own: its expressions, evaluated at the inputs of its subsystem.

use super::expression::Expression;
use model_core::muscle::Muscle;
use model_core::pressure::GaugePa;
use muscle_plant::effects::{DecayingForce, Observation};
use muscle_plant::nominal::Weight;
use muscle_plant::subsystem::Term;
use muscle_plant::subsystem::gas::{Exchange, GasPoint, GasTerm};
use muscle_plant::subsystem::line::{LinePoint, LineTerm};
use muscle_plant::subsystem::load::{LoadPoint, LoadTerm};
use muscle_plant::subsystem::muscle::{MusclePoint, MuscleTerm};
use muscle_plant::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use muscle_plant::subsystem::supply::{SupplyPoint, SupplyTerm};
use muscle_plant::subsystem::term::Dynamics;
use muscle_plant::subsystem::valve::{ValvePoint, ValveTerm};

/// The largest number of inputs of a subsystem and states of an effect together.
pub(super) const VALUES_MAX: usize = 16;
/// Share of its fastest time constant in which a state is propagated by one step of fourth order.
const STEP_SHARE: f64 = 0.5;
/// Steps at most between two rows: a state that needs more has settled within them.
const STEPS_MAX: f64 = 1000.0;

/// A state, with its expressions over inputs and states.
#[derive(Clone)]
pub(super) struct State {
    /// A typical value: the unit of the state within the plant.
    pub typical: f64,
    /// Its value after a long rest.
    pub steady: Expression,
    pub change: Change,
    /// Its values after a long contraction and after a long extension, where they differ.
    pub after_motion: Option<[Expression; 2]>,
}

/// How a state changes.
#[derive(Clone)]
pub(super) enum Change {
    /// With this rate; its derivative by the state itself if that is constant and no other state
    /// is in it.
    Rate(Expression, Option<f64>),
    /// To this value at the end of each step.
    Update(Expression),
}

/// Expressions over the inputs of a subsystem, followed by the states.
#[derive(Clone)]
pub(super) struct OwnTerm {
    pub states: Vec<State>,
    /// What it adds to each quantity of its subsystem, in their order; `None` to those left out.
    pub adds: Vec<Option<Expression>>,
}

/// The inputs of a subsystem, in the order of its names.
pub(super) trait Inputs {
    fn time_s(&self) -> f64;
    fn write(&self, values: &mut [f64]);
}

impl OwnTerm {
    /// What it adds to the quantity at `index`.
    fn added(&self, index: usize, point: &impl Inputs, state: &[f64]) -> f64 {
        let Some(expression) = &self.adds[index] else {
            return 0.0;
        };
        expression.value(&self.values(point, state))
    }

    /// Inputs and states; the states in their own units.
    fn values(&self, point: &impl Inputs, state: &[f64]) -> [f64; VALUES_MAX] {
        let mut values = [0.0; VALUES_MAX];
        point.write(&mut values);
        let first = VALUES_MAX - self.states.len();
        for (value, (own, state)) in values[first..]
            .iter_mut()
            .zip(self.states.iter().zip(state))
        {
            *value = state * own.typical;
        }
        values
    }

    fn set(
        &self,
        point: &impl Inputs,
        state: &mut [f64],
        to: impl Fn(&State) -> Option<&Expression>,
    ) {
        let values = self.values(point, state);
        for (own, state) in self.states.iter().zip(state) {
            if let Some(to) = to(own) {
                *state = to.value(&values) / own.typical;
            }
        }
    }

    /// Sets the states that have a rate to their values after a long rest.
    fn settle(&self, point: &impl Inputs, state: &mut [f64]) {
        self.set(point, state, |own| match own.change {
            Change::Rate(..) => Some(&own.steady),
            Change::Update(_) => None,
        });
    }

    fn own_rates(&self, point: &impl Inputs, state: &[f64], rates: &mut [f64]) {
        let values = self.values(point, state);
        for (own, rate) in self.states.iter().zip(rates) {
            if let Change::Rate(expression, _) = &own.change {
                *rate = expression.value(&values) / own.typical;
            }
        }
    }

    /// The states that have no constant slope, by steps of the classical Runge–Kutta method.
    fn integrate<P: Inputs>(&self, from: &P, to: &P, state: &mut [f64]) {
        let length_s = to.time_s() - from.time_s();
        let (mut begin, mut end) = ([0.0; VALUES_MAX], [0.0; VALUES_MAX]);
        from.write(&mut begin);
        to.write(&mut end);
        let at = |share: f64| {
            Given(from.time_s() + share * length_s, {
                std::array::from_fn(|i| begin[i] + share * (end[i] - begin[i]))
            })
        };
        // A rate may vanish at one of them, as that of a memory where the motion turns.
        let fastest_per_s = [0.0, 0.5, 1.0]
            .map(|share| self.fastest_per_s(&at(share), state))
            .into_iter()
            .fold(0.0, f64::max);
        let steps = (length_s * fastest_per_s / STEP_SHARE).ceil().max(1.0);
        if steps > STEPS_MAX {
            return self.settle(to, state);
        }
        let step_s = length_s / steps;
        for step in 0..steps as u32 {
            let share = |part: f64| (f64::from(step) + part) / steps;
            let mut slopes = [[0.0; VALUES_MAX]; 4];
            let mut moved = [0.0; VALUES_MAX];
            let states = state.len();
            for (stage, part) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
                for i in 0..states {
                    let before = if stage == 0 {
                        0.0
                    } else {
                        slopes[stage - 1][i]
                    };
                    moved[i] = state[i] + part * step_s * before;
                }
                self.own_rates(
                    &at(share(part)),
                    &moved[..states],
                    &mut slopes[stage][..states],
                );
            }
            for i in 0..states {
                let [first, second, third, last] = slopes.map(|slopes| slopes[i]);
                state[i] += step_s * (first + 2.0 * (second + third) + last) / 6.0;
            }
        }
    }

    /// The largest sum of a row of the rates' Jacobian, by differences \[1/s\].
    pub fn fastest_per_s(&self, point: &impl Inputs, state: &[f64]) -> f64 {
        /// Share of the typical value of a state.
        const DIFFERENCE: f64 = 1e-6;
        let states = state.len();
        let (mut base, mut moved) = ([0.0; VALUES_MAX], [0.0; VALUES_MAX]);
        self.own_rates(point, state, &mut base[..states]);
        let mut sums = [0.0; VALUES_MAX];
        for column in 0..states {
            let mut other = [0.0; VALUES_MAX];
            other[..states].copy_from_slice(state);
            other[column] += DIFFERENCE;
            self.own_rates(point, &other[..states], &mut moved[..states]);
            for row in 0..states {
                sums[row] += ((moved[row] - base[row]) / DIFFERENCE).abs();
            }
        }
        sums.into_iter().fold(0.0, f64::max)
    }
}

/// Inputs as numbers, with their time.
pub(super) struct Given(pub f64, pub [f64; VALUES_MAX]);

impl Inputs for Given {
    fn time_s(&self) -> f64 {
        self.0
    }

    fn write(&self, values: &mut [f64]) {
        values.copy_from_slice(&self.1);
    }
}

impl<P: Inputs> Dynamics<P> for OwnTerm {
    fn states(&self) -> usize {
        self.states.len()
    }

    fn steady_state(&self, point: &P, state: &mut [f64]) {
        self.set(point, state, |own| Some(&own.steady));
    }

    fn bias_memory(&self, point: &P, share: f64, state: &mut [f64]) {
        let values = self.values(point, state);
        for (own, state) in self.states.iter().zip(state) {
            if let Some(after) = &own.after_motion {
                let [up, down] = [&after[0], &after[1]].map(|after| after.value(&values));
                *state = (0.5 * (up + down) + 0.5 * share * (up - down)) / own.typical;
            }
        }
    }

    fn rates(&self, point: &P, state: &[f64], rates: &mut [f64]) {
        self.own_rates(point, state, rates);
    }

    fn accept_step(&self, point: &P, state: &mut [f64]) {
        self.set(point, state, |own| match &own.change {
            Change::Update(to) => Some(to),
            Change::Rate(..) => None,
        });
    }

    /// A state of which the rate has a constant slope −1/T is propagated exactly where the rest of
    /// the rate is linear in time.
    fn propagate(&self, from: &P, to: &P, state: &mut [f64]) {
        let is_exact = |own: &State| !matches!(own.change, Change::Rate(_, None));
        if self.states.iter().all(is_exact) {
            let length_s = to.time_s() - from.time_s();
            let drives = [from, to].map(|point| self.values(point, state));
            for (own, state) in self.states.iter().zip(state.iter_mut()) {
                if let Change::Rate(rate, Some(slope_per_s)) = &own.change {
                    let [first, last] = drives
                        .map(|values| rate.value(&values) / own.typical - slope_per_s * *state);
                    *state = relaxed(*state, [first, last], length_s, *slope_per_s);
                }
            }
        } else {
            self.integrate(from, to, state);
        }
        Dynamics::accept_step(self, to, state);
    }
}

/// x after a time in which dx/dt = a x + b and b changes linearly `from` one value `to` another.
fn relaxed(x: f64, [from, to]: [f64; 2], length_s: f64, a: f64) -> f64 {
    let z = a * length_s;
    // φ₁ = (eᶻ − 1)/z and φ₂ = (eᶻ − 1 − z)/z², near 0 by their series.
    let (phi_1, phi_2) = if z.abs() < 1e-2 {
        let phi_2 = 0.5 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0 + z / 720.0)));
        (1.0 + z * phi_2, phi_2)
    } else {
        (z.exp_m1() / z, (z.exp_m1() - z) / (z * z))
    };
    x + length_s * (phi_1 * (a * x + from) + phi_2 * (to - from))
}

impl Observation for OwnTerm {
    fn has_motion_memory(&self) -> bool {
        self.states.iter().any(|own| own.after_motion.is_some())
    }

    // By the force's slope over each state that relaxes by itself.
    fn decaying_forces(
        &self,
        point: &MusclePoint,
        law: &Muscle<f64>,
        state: &[f64],
    ) -> Vec<DecayingForce> {
        let force_n = law.force_n(point.contraction, point.pressure);
        let values = self.values(&(*point, *law, force_n), state);
        let first = VALUES_MAX - self.states.len();
        let relaxing = self.states.iter().enumerate().filter_map(|(index, own)| {
            let Change::Rate(_, Some(slope_per_s)) = own.change else {
                return None;
            };
            let slope = self.adds[0].as_ref()?.derivative(first + index)?;
            (slope_per_s < 0.0).then(|| DecayingForce {
                force_n: slope.value(&values) * own.typical,
                time_constant_s: -1.0 / slope_per_s,
            })
        });
        relaxing.collect()
    }
}

/// Implements [`Inputs`] for the point of a subsystem: its names with their values.
macro_rules! inputs {
    ($names:ident, $point:ty, $this:ident, $time:expr, {
        $($name:ident: $unit:literal = $value:expr,)*
    }) => {
        /// The names of the inputs, with their units.
        pub(super) const $names: &[(&str, &str)] = &[$((stringify!($name), $unit)),*];

        impl Inputs for $point {
            fn time_s(&self) -> f64 {
                let $this = self;
                $time
            }

            fn write(&self, values: &mut [f64]) {
                let $this = self;
                let inputs = [$($value),*];
                values[..inputs.len()].copy_from_slice(&inputs);
            }
        }
    };
}

inputs!(OF_MUSCLE, (MusclePoint, Muscle<f64>, f64), own, own.0.time_s, {
    time_s: "s" = own.0.time_s,
    contraction: "1" = own.0.contraction,
    contraction_rate_per_s: "1/s" = own.0.contraction_rate_per_s,
    direction: "1" = own.0.direction,
    pressure_pa: "Pa" = own.0.pressure.0,
    force_per_pressure_m2: "m²" = own.1.force_per_pressure_m2(own.0.contraction),
    force_n: "N" = own.2,
});
// The states of a muscle's effect do not depend on its force.
inputs!(OF_MUSCLE_STATES, MusclePoint, own, own.time_s, {
    time_s: "s" = own.time_s,
    contraction: "1" = own.contraction,
    contraction_rate_per_s: "1/s" = own.contraction_rate_per_s,
    direction: "1" = own.direction,
    pressure_pa: "Pa" = own.pressure.0,
});
inputs!(OF_LOAD, (LoadPoint, Weight), own, own.0.time_s, {
    time_s: "s" = own.0.time_s,
    contraction: "1" = own.0.contraction,
    contraction_rate_per_s: "1/s" = own.0.contraction_rate_per_s,
    direction: "1" = own.0.direction,
    speed_m_per_s: "m/s" = own.0.initial_length_m * own.0.contraction_rate_per_s,
    initial_length_m: "m" = own.0.initial_length_m,
    coulomb_friction_n: "N" = own.1.coulomb_friction_n,
    static_friction_n: "N" = own.1.static_friction_n,
});
// The states of a load's effect do not depend on its friction.
inputs!(OF_LOAD_STATES, LoadPoint, own, own.time_s, {
    time_s: "s" = own.time_s,
    contraction: "1" = own.contraction,
    contraction_rate_per_s: "1/s" = own.contraction_rate_per_s,
    direction: "1" = own.direction,
    speed_m_per_s: "m/s" = own.initial_length_m * own.contraction_rate_per_s,
    initial_length_m: "m" = own.initial_length_m,
});
inputs!(OF_VALVE, ValvePoint, own, own.time_s, {
    time_s: "s" = own.time_s,
    pressure_ref_pa: "Pa" = own.reference.0,
    pressure_pa: "Pa" = own.port.0,
    supply_pa: "Pa" = own.supply.0,
    atmospheric_absolute_pa: "Pa" = own.atmospheric.0,
});
// A delay depends on nothing.
inputs!(OF_LINE, LinePoint, own, own.time_s, {
    time_s: "s" = own.time_s,
});
inputs!(OF_GAS, GasPoint, own, own.time_s, {
    time_s: "s" = own.time_s,
    pressure_pa: "Pa" = own.pressure.0 - own.atmospheric.0,
    atmospheric_absolute_pa: "Pa" = own.atmospheric.0,
    temperature_k: "K" = own.temperature_k,
    ambient_temperature_k: "K" = own.ambient_temperature_k,
    heat_transfer_w_per_m2_k: "W/(m²·K)" = own.heat_transfer_w_per_m2_k,
});
inputs!(OF_SUPPLY, SupplyPoint, own, own.time_s, {
    time_s: "s" = own.time_s,
    supply_pa: "Pa" = own.nominal.0,
    atmospheric_absolute_pa: "Pa" = own.atmospheric.0,
    drawn_kg_per_s: "kg/s" = own.drawn_kg_per_s,
});
inputs!(OF_SENSOR, SensorPoint, own, own.time_s, {
    time_s: "s" = own.time_s,
    pressure_pa: "Pa" = own.truth.pressure.0,
    contraction: "1" = own.truth.contraction,
    force_n: "N" = own.truth.force_n,
    initial_length_m: "m" = own.initial_length_m,
});

impl MuscleTerm for OwnTerm {
    fn force_n(&self, point: &MusclePoint, law: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        force_n + self.added(0, &(*point, *law, force_n), state)
    }
}

impl LoadTerm for OwnTerm {
    fn change(&self, point: &LoadPoint, state: &[f64], weight: &mut Weight, force_n: &mut f64) {
        let before = (*point, *weight);
        let added = |index| self.added(index, &before, state);
        *force_n += added(0);
        // A friction that drives, or a weight that breaks away below its Coulomb friction and
        // stops at once, would have no motion that ends.
        weight.coulomb_friction_n = (weight.coulomb_friction_n + added(1)).max(0.0);
        weight.static_friction_n =
            (weight.static_friction_n + added(2)).max(weight.coulomb_friction_n);
        weight.viscous_damping_ns_per_m = (weight.viscous_damping_ns_per_m + added(3)).max(0.0);
        weight.mass_kg = (weight.mass_kg + added(4)).max(*crate::rig::MASS_KG.start());
    }
}

impl ValveTerm for OwnTerm {
    fn reference(
        &self,
        point: &ValvePoint,
        state: &[f64],
        reference: GaugePa<f64>,
    ) -> GaugePa<f64> {
        GaugePa(
            reference.0
                + self.added(
                    0,
                    &ValvePoint {
                        reference,
                        ..*point
                    },
                    state,
                ),
        )
    }

    fn flow_kg_per_s(&self, point: &ValvePoint, state: &[f64], flow_kg_per_s: f64) -> f64 {
        flow_kg_per_s + self.added(1, point, state)
    }
}

impl LineTerm for OwnTerm {
    fn delay_s(&self) -> f64 {
        let delay = self.adds[0].as_ref();
        delay.map_or(0.0, |delay| delay.value(&[0.0; VALUES_MAX]).max(0.0))
    }
}

impl GasTerm for OwnTerm {
    fn exchange(&self, point: &GasPoint, state: &[f64], exchange: &mut Exchange) {
        let outflow_kg_per_s = self.added(0, point, state);
        exchange.outflow_kg_per_s += outflow_kg_per_s.max(0.0);
        exchange.inflow_kg_per_s += (-outflow_kg_per_s).max(0.0);
        exchange.heat_transfer_w_per_m2_k += self.added(1, point, state);
        exchange.wall_temperature_k += self.added(2, point, state);
    }
}

impl SupplyTerm for OwnTerm {
    fn pressure(&self, point: &SupplyPoint, state: &[f64], supply: GaugePa<f64>) -> GaugePa<f64> {
        let point = SupplyPoint {
            nominal: supply,
            ..*point
        };
        GaugePa((supply.0 + self.added(0, &point, state)).max(0.0))
    }
}

impl SensorTerm for OwnTerm {
    fn read(&self, point: &SensorPoint, state: &[f64], reading: &mut Reading) {
        reading.pressure.0 += self.added(0, point, state);
        reading.contraction += self.added(1, point, state);
        reading.force_n += self.added(2, point, state);
    }
}

/// The subsystem that an effect acts on: its inputs and what may be added to it.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Names and units of the inputs of what is added.
    pub inputs: &'static [(&'static str, &'static str)],
    /// Those of the states.
    pub inputs_of_states: &'static [(&'static str, &'static str)],
    /// Names and units of the quantities.
    pub adds: &'static [(&'static str, &'static str)],
    /// The term on it.
    pub term: fn(OwnTerm) -> Term,
}

/// The muscle's force.
pub(super) const MUSCLE: Place = Place {
    inputs: OF_MUSCLE,
    inputs_of_states: OF_MUSCLE_STATES,
    adds: &[("force_n", "N")],
    term: |term| Term::Muscle(Box::new(term)),
};
/// The weight.
pub(super) const LOAD: Place = Place {
    inputs: OF_LOAD,
    inputs_of_states: OF_LOAD_STATES,
    adds: &[
        ("lifting_force_n", "N"),
        ("coulomb_friction_n", "N"),
        ("static_friction_n", "N"),
        ("viscous_damping_ns_per_m", "N·s/m"),
        ("mass_kg", "kg"),
    ],
    term: |term| Term::Load(Box::new(term)),
};
/// The valve.
pub(super) const VALVE: Place = Place {
    inputs: OF_VALVE,
    inputs_of_states: OF_VALVE,
    adds: &[("pressure_ref_pa", "Pa"), ("flow_kg_per_s", "kg/s")],
    term: |term| Term::Valve(Box::new(term)),
};
/// The command line.
pub(super) const LINE: Place = Place {
    inputs: OF_LINE,
    inputs_of_states: OF_LINE,
    adds: &[("delay_s", "s")],
    term: |term| Term::Line(Box::new(term)),
};
/// The air in the muscle.
pub(super) const GAS: Place = Place {
    inputs: OF_GAS,
    inputs_of_states: OF_GAS,
    adds: &[
        ("outflow_kg_per_s", "kg/s"),
        ("heat_transfer_w_per_m2_k", "W/(m²·K)"),
        ("wall_temperature_k", "K"),
    ],
    term: |term| Term::Gas(Box::new(term)),
};
/// The supply.
pub(super) const SUPPLY: Place = Place {
    // The pressure must not depend on the flow of the same instant, which depends on the pressure.
    inputs: OF_SUPPLY.split_at(3).0,
    inputs_of_states: OF_SUPPLY,
    adds: &[("supply_pa", "Pa")],
    term: |term| Term::Supply(Box::new(term)),
};
/// The instruments.
pub(super) const SENSOR: Place = Place {
    inputs: OF_SENSOR,
    inputs_of_states: OF_SENSOR,
    adds: &[
        ("pressure_pa", "Pa"),
        ("contraction", "1"),
        ("force_n", "N"),
    ],
    term: |term| Term::Sensor(Box::new(term)),
};

#[cfg(test)]
mod tests {
    use super::*;

    /// A rate over the time, the contraction's rate and one state.
    fn term(rate: &str) -> OwnTerm {
        let mut names = vec![""; VALUES_MAX];
        (names[0], names[1], names[VALUES_MAX - 1]) = ("time_s", "rate_per_s", "x");
        let read = |text: &str| Expression::parse(text, &names).expect("an expression");
        OwnTerm {
            states: vec![State {
                typical: 1.0,
                steady: read("rate_per_s"),
                change: Change::Rate(read(rate), None),
                after_motion: None,
            }],
            adds: Vec::new(),
        }
    }

    fn given(time_s: f64, rate_per_s: f64) -> Given {
        let mut values = [0.0; VALUES_MAX];
        (values[0], values[1]) = (time_s, rate_per_s);
        Given(time_s, values)
    }

    /// dx/dt = a x + b with b = t from 0 to 1: x = x₀ eᵃ + ∫ e^(a(1−s)) s ds = x₀ eᵃ + φ₂(a), as a
    /// sum of aⁿ/(n + 2)!.
    #[test]
    fn a_relaxation_is_exact_for_any_time_constant() {
        for a in [
            -30.0, -1.0, -0.02, -9e-3, -1e-5, -1e-8, -1e-12, 0.0, 1e-7, 0.5,
        ] {
            let mut term = 0.5;
            let mut phi_2 = 0.0;
            for n in 0..200 {
                phi_2 += term;
                term *= a / f64::from(n + 3);
            }
            let expected = 0.25 * f64::exp(a) + phi_2;
            let found = relaxed(0.25, [0.0, 1.0], 1.0, a);
            // The sum cancels where a is −30.
            let rounding = if a < -5.0 { 1e-4 } else { 1e-13 };
            assert!(
                (found - expected).abs() < rounding,
                "{a}: {found} {expected}"
            );
        }
        assert_eq!(relaxed(0.25, [1.0, 1.0], 0.0, -1.0), 0.25);
    }

    /// A state that follows an input which turns in the middle, where its rate vanishes, is as
    /// after a thousand short steps.
    #[test]
    fn a_rate_that_vanishes_for_an_instant_is_resolved() {
        let term = term("200 * rate_per_s * (1 - abs(rate_per_s) * x)");
        let (mut once, mut often) = ([0.2], [0.2]);
        term.propagate(&given(0.0, -1.0), &given(0.1, 1.0), &mut once);
        for step in 0..1000 {
            let at = |step: i32| given(1e-4 * f64::from(step), -1.0 + 2e-3 * f64::from(step));
            term.propagate(&at(step), &at(step + 1), &mut often);
        }
        // Steps of half of a time constant: (1/2)⁵/5! of the state.
        assert!(
            (once[0] - often[0]).abs() < 3e-4 * often[0].abs().max(1.0),
            "{once:?} {often:?}"
        );
    }

    #[test]
    fn a_state_faster_than_can_be_resolved_has_settled() {
        let term = term("1e6 * (rate_per_s - x) * (1 + x^2)");
        let mut state = [0.2];
        term.propagate(&given(0.0, -1.0), &given(0.1, 0.5), &mut state);
        assert_eq!(state, [0.5]);
    }
}

//! The same plant under diffsol's solvers: stick, slip and reversals of the flow are found by its
//! root finder.

use crate::problem::{PER_STATE, Problem};
use diffsol::{
    NalgebraLU, NalgebraMat, NalgebraVec, OdeBuilder, OdeEquations, OdeSolverMethod,
    OdeSolverProblem, OdeSolverStopReason,
};
use muscle_plant::simulation::{CONTRACTION, CONTRACTION_RATE, Drive, Plant, Regime};
use muscle_plant::subsystem::load::Motion;
use std::cell::Cell;

type Matrix = NalgebraMat<f64>;
type Linear = NalgebraLU<f64>;

/// A solver that needs more steps has lost its way.
const STEPS_MAX: u32 = 1_000_000;

/// diffsol's methods.
#[derive(Clone, Copy, Debug)]
pub enum Method {
    /// Explicit Runge–Kutta 5(4).
    Tsit45,
    /// Variable-order backward differences.
    Bdf,
    /// Implicit Runge–Kutta of order 2.
    TrBdf2,
    /// Implicit Runge–Kutta of order 4.
    Esdirk34,
}

/// What the equations depend on besides the state; changed between steps only.
struct Circumstances {
    plant: Plant,
    drive: Cell<Drive>,
    regime: Cell<Regime>,
    /// A flow within this is no reversal [kg/s].
    flow_error_kg_per_s: f64,
}

impl Circumstances {
    fn rates(&self, time_s: f64, state: &[f64]) -> [f64; 4] {
        let state = [state[0], state[1], state[2], state[3]];
        self.plant
            .rates(time_s, &self.drive.get(), self.regime.get(), &state)
    }

    /// Negative as long as the motion and the flow's direction last.
    fn ends(&self, time_s: f64, state: &[f64]) -> [f64; 2] {
        let flow = self.plant.flow_kg_per_s(time_s, &self.drive.get(), state);
        let sign = if self.regime.get().charging {
            1.0
        } else {
            -1.0
        };
        let reversal = -sign * flow - self.flow_error_kg_per_s;
        [self.motion_ends(time_s, state), reversal]
    }

    fn motion_ends(&self, time_s: f64, state: &[f64]) -> f64 {
        let load = self.plant.load.as_ref().expect("a weight");
        match self.regime.get().motion {
            Motion::Stuck => self.plant.breakaway_n(load, time_s, state).0,
            Motion::Rising => -state[CONTRACTION_RATE],
            // The stop ends a fall as well as standstill does.
            Motion::Falling => state[CONTRACTION_RATE].max(-state[CONTRACTION]),
        }
    }

    /// After a root of the motion's: a weight at rest breaks away, a moving one stops or turns.
    fn change_motion(&self, time_s: f64, state: &mut [f64]) {
        state[CONTRACTION_RATE] = 0.0;
        if state[CONTRACTION] < 1e-9 {
            state[CONTRACTION] = 0.0;
        }
        let load = self.plant.load.as_ref().expect("a weight");
        let (beyond_n, breakaway) = self.plant.breakaway_n(load, time_s, state);
        let Regime { motion, charging } = self.regime.get();
        let moves = motion == Motion::Stuck || beyond_n > 0.0;
        let motion = if moves { breakaway } else { Motion::Stuck };
        self.regime.set(Regime { motion, charging });
    }

    fn change_flow(&self) {
        let Regime { motion, charging } = self.regime.get();
        self.regime.set(Regime {
            motion,
            charging: !charging,
        });
    }

    /// A jump of the drive gives the flow its sign anew.
    fn change_drive(&self, drive: Drive, time_s: f64, state: &[f64]) {
        self.drive.set(drive);
        let charging = self.plant.flow_kg_per_s(time_s, &drive, state) > 0.0;
        let motion = self.regime.get().motion;
        self.regime.set(Regime { motion, charging });
    }
}

/// Contraction and absolute pressure at the problem's rows; `None` where the solver gave up.
pub fn solve(problem: &Problem, method: Method, tolerance: f64) -> Option<Vec<[f64; 2]>> {
    let circumstances = Circumstances {
        plant: problem.plant(),
        drive: Cell::new(problem.drive(0)),
        regime: Cell::new(Regime {
            motion: Motion::Stuck,
            charging: false,
        }),
        flow_error_kg_per_s: problem.flow_gain_kg_per_pa_s() * tolerance * PER_STATE[2],
    };
    let start = problem.start();
    let c = &circumstances;
    let ode = OdeBuilder::<Matrix>::new()
        .rtol(0.0)
        .atol(PER_STATE.map(|range| range * tolerance))
        .h0(1e-3)
        .rhs_implicit(
            |x: &[f64], _: &[f64], t, y: &mut [f64]| y.copy_from_slice(&c.rates(t, x)),
            |x: &[f64], _: &[f64], t, v: &[f64], y: &mut [f64]| {
                let moved = |sign: f64| -> Vec<f64> {
                    x.iter().zip(v).map(|(x, v)| x + sign * 1e-6 * v).collect()
                };
                let (above, below) = (c.rates(t, &moved(1.0)), c.rates(t, &moved(-1.0)));
                for (y, (above, below)) in y.iter_mut().zip(above.iter().zip(below)) {
                    *y = (above - below) / 2e-6;
                }
            },
        )
        .init(
            move |_: &[f64], _, y: &mut [f64]| y.copy_from_slice(&start),
            4,
        )
        .root(
            |x: &[f64], _: &[f64], t, y: &mut [f64]| y.copy_from_slice(&c.ends(t, x)),
            2,
        )
        .build()
        .ok()?;
    match method {
        Method::Tsit45 => run(problem, c, &ode, ode.tsit45().ok()?),
        Method::Bdf => run(problem, c, &ode, ode.bdf::<Linear>().ok()?),
        Method::TrBdf2 => run(problem, c, &ode, ode.tr_bdf2::<Linear>().ok()?),
        Method::Esdirk34 => run(problem, c, &ode, ode.esdirk34::<Linear>().ok()?),
    }
}

fn run<'a, Eqn, S>(
    problem: &Problem,
    circumstances: &Circumstances,
    _ode: &'a OdeSolverProblem<Eqn>,
    mut solver: S,
) -> Option<Vec<[f64; 2]>>
where
    Eqn: OdeEquations<V = NalgebraVec<f64>, T = f64> + 'a,
    S: OdeSolverMethod<'a, Eqn>,
{
    let rows = problem.rows();
    let mut out = Vec::with_capacity(rows);
    out.push(problem.observed(solver.state().y.batch_as_slice(0)));
    let (mut row, mut steps) = (1, 0);
    // Stops only where the reference changes; rows between are interpolated.
    for (from, to) in problem.stretches() {
        let state = solver.state();
        circumstances.change_drive(problem.drive(from), state.t, state.y.batch_as_slice(0));
        restart(circumstances, &mut solver);
        solver.set_stop_time(problem.time_s(to)).ok()?;
        loop {
            let reason = solver.step().ok()?;
            steps += 1;
            if steps > STEPS_MAX {
                return None;
            }
            let reached_s = match reason {
                OdeSolverStopReason::RootFound(time_s, _) => time_s,
                _ => solver.state().t,
            };
            while row <= to && problem.time_s(row) <= reached_s {
                let state = solver.interpolate(problem.time_s(row)).ok()?;
                out.push(problem.observed(state.batch_as_slice(0)));
                row += 1;
            }
            match reason {
                OdeSolverStopReason::InternalTimestep => {}
                OdeSolverStopReason::TstopReached => break,
                OdeSolverStopReason::RootFound(time_s, root) => {
                    solver.state_mut_back(time_s).ok()?;
                    if root == 0 {
                        let state = solver.state_mut().y.batch_as_mut_slice(0);
                        circumstances.change_motion(time_s, state);
                    } else {
                        circumstances.change_flow();
                    }
                    restart(circumstances, &mut solver);
                    if time_s < problem.time_s(to) {
                        solver.set_stop_time(problem.time_s(to)).ok()?;
                    }
                }
            }
        }
    }
    Some(out)
}

/// Makes the rate that the solver keeps the one of the new circumstances.
fn restart<'a, Eqn, S>(circumstances: &Circumstances, solver: &mut S)
where
    Eqn: OdeEquations<V = NalgebraVec<f64>, T = f64> + 'a,
    S: OdeSolverMethod<'a, Eqn>,
{
    let state = solver.state_mut();
    let rates = circumstances.rates(*state.t, state.y.batch_as_slice(0));
    state.dy.batch_as_mut_slice(0).copy_from_slice(&rates);
    *state.h = state.h.max(1e-4);
}

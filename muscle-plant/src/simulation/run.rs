//! A plant with its state, advanced in time.

use super::drive::Drive;
use super::plant::{
    CONTRACTION, CONTRACTION_RATE, NOMINAL_STATES, PRESSURE, Plant, STATES_MAX, TEMPERATURE,
};
use super::trajectory::{Initial, SimulationError, Trajectory, Work};
use crate::subsystem::load::Motion;
use crate::subsystem::sensors::Reading;
use model_core::pressure::{AbsolutePa, GaugePa};
use std::collections::VecDeque;

/// Times that differ by less are equal: a delay of whole rows must not cause steps by rounding.
const SAME_S: f64 = 1e-9;

/// A plant with its state.
pub struct Simulation {
    plant: Plant,
    core: Core,
    delay_s: f64,
    /// References in the command line: arrival time \[s\] and value.
    pending: VecDeque<(f64, GaugePa<f64>)>,
    /// The last reference that was sent.
    sent: GaugePa<f64>,
    /// The last reference that has arrived.
    arrived: GaugePa<f64>,
    /// The last drive.
    drive: Drive,
}

/// The state in an array of the plant's size: the nominal size is the fastest.
enum Core {
    Nominal(Box<Trajectory<NOMINAL_STATES>>),
    Few(Box<Trajectory<8>>),
    Several(Box<Trajectory<16>>),
    Many(Box<Trajectory<STATES_MAX>>),
}

macro_rules! each {
    ($core:expr, $trajectory:ident => $body:expr) => {
        match $core {
            Core::Nominal($trajectory) => $body,
            Core::Few($trajectory) => $body,
            Core::Several($trajectory) => $body,
            Core::Many($trajectory) => $body,
        }
    };
}

impl Simulation {
    /// `plant` at `initial`, with its effects in their steady state under `drive`.
    ///
    /// # Panics
    /// If the effects together have more states than [`Plant::new`] admits.
    pub fn new(plant: Plant, initial: &Initial, drive: &Drive, tolerance: f64) -> Simulation {
        let core = match plant.states() {
            NOMINAL_STATES => Core::Nominal(Trajectory::new(&plant, initial, drive, tolerance)),
            5..=8 => Core::Few(Trajectory::new(&plant, initial, drive, tolerance)),
            9..=16 => Core::Several(Trajectory::new(&plant, initial, drive, tolerance)),
            17..=STATES_MAX => Core::Many(Trajectory::new(&plant, initial, drive, tolerance)),
            states => panic!("{states} states"),
        };
        let delay_s = plant.pneumatics.as_ref().map_or(0.0, |p| p.line.delay_s());
        Simulation {
            plant,
            core,
            delay_s,
            pending: VecDeque::new(),
            sent: drive.reference,
            arrived: drive.reference,
            drive: *drive,
        }
    }

    /// Runs to `until_s` under `drive`, whose reference is sent now.
    ///
    /// # Errors
    /// See [`SimulationError`].
    pub fn advance(&mut self, drive: &Drive, until_s: f64) -> Result<(), SimulationError> {
        self.drive = *drive;
        let Simulation { plant, core, .. } = self;
        if self.delay_s <= 0.0 {
            return each!(core, trajectory => trajectory.advance(plant, drive, until_s));
        }
        if drive.reference != self.sent {
            self.sent = drive.reference;
            let arrival_s = each!(core, trajectory => trajectory.time_s) + self.delay_s;
            self.pending.push_back((arrival_s, drive.reference));
        }
        let mut drive = *drive;
        loop {
            let now_s = each!(core, trajectory => trajectory.time_s);
            let next = self.pending.front().copied();
            let end_s = match next {
                Some((arrival_s, reference)) if arrival_s <= now_s + SAME_S => {
                    self.arrived = reference;
                    self.pending.pop_front();
                    continue;
                }
                Some((arrival_s, _)) if arrival_s < until_s - SAME_S => arrival_s,
                _ => until_s,
            };
            drive.reference = self.arrived;
            self.drive = drive;
            each!(core, trajectory => trajectory.advance(plant, &drive, end_s))?;
            if end_s == until_s {
                return Ok(());
            }
        }
    }

    /// Sets the contraction \[-\] and its rate \[1/s\] where they are inputs.
    pub fn prescribe_contraction(&mut self, contraction: f64, rate_per_s: f64) {
        each!(&mut self.core, trajectory => {
            trajectory.state[CONTRACTION] = contraction;
            trajectory.state[CONTRACTION_RATE] = rate_per_s;
            trajectory.rates = None;
        });
    }

    /// Sets the pressure where it is an input.
    pub fn prescribe_pressure(&mut self, pressure: GaugePa<f64>) {
        let absolute = pressure.to_absolute(self.plant.atmospheric);
        each!(&mut self.core, trajectory => {
            trajectory.state[PRESSURE] = absolute.0;
            trajectory.rates = None;
        });
    }

    /// The plant.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Time \[s\].
    pub fn time_s(&self) -> f64 {
        each!(&self.core, trajectory => trajectory.time_s)
    }

    /// Contraction ε \[-\].
    pub fn contraction(&self) -> f64 {
        self.state()[CONTRACTION]
    }

    /// Contraction rate \[1/s\].
    pub fn contraction_rate_per_s(&self) -> f64 {
        self.state()[CONTRACTION_RATE]
    }

    /// Pressure in the muscle.
    pub fn pressure(&self) -> GaugePa<f64> {
        AbsolutePa(self.state()[PRESSURE]).to_gauge(self.plant.atmospheric)
    }

    /// Gas temperature \[K\].
    pub fn temperature_k(&self) -> f64 {
        self.state()[TEMPERATURE]
    }

    /// Muscle force \[N\].
    pub fn force_n(&self) -> f64 {
        self.plant.force_n(self.time_s(), self.state())
    }

    /// Readings of the instruments, without noise, before the reference of this instant is sent.
    pub fn read(&self) -> Reading {
        self.plant.read(self.time_s(), &self.drive, self.state())
    }

    /// Motion of the weight.
    pub fn motion(&self) -> Motion {
        each!(&self.core, trajectory => trajectory.regime.motion)
    }

    /// Counts of the integrator.
    pub fn work(&self) -> Work {
        each!(&self.core, trajectory => trajectory.work)
    }

    fn state(&self) -> &[f64] {
        each!(&self.core, trajectory => &trajectory.state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::transport_delay::pure_delay;
    use crate::nominal::{Load, Nominal, Weight};
    use crate::simulation::{Simulated, TOLERANCE};

    /// A reference that arrives a little after each row divides the row; that must not cost more
    /// than one step per row.
    #[test]
    fn a_divided_row_costs_one_step_more() {
        const ROWS: u32 = 400;
        let steps_with = |delay_s: f64| {
            let clamped = Nominal {
                load: Load::Prescribed,
                ..Nominal::REFERENCE
            };
            let delay = pure_delay(delay_s).term();
            let plant = Plant::new(&clamped, [delay], Simulated::GAS_ONLY).expect("a plant");
            let drive = |row: u32| Drive {
                reference: GaugePa(2e5 + 5e3 * f64::from(row).sin()),
                contraction_rate_per_s: 0.01 * f64::from(row).cos(),
                ..Drive::default()
            };
            let initial = Initial::vented(&plant);
            let mut simulation = Simulation::new(plant, &initial, &drive(0), TOLERANCE);
            for row in 0..ROWS {
                let until_s = 0.01 * f64::from(row + 1);
                let advanced = simulation.advance(&drive(row), until_s);
                advanced.expect("a solution");
            }
            simulation.work().steps + simulation.work().refused
        };
        let (whole, cut) = (steps_with(0.03), steps_with(0.03003));
        // One step more per row, and some that are refused.
        let steps_max = whole + u64::from(ROWS) * 5 / 4;
        assert!(cut <= steps_max, "{whole}, {cut}");
    }

    /// A reference that steps to 300, 240, 260 and 200 kPa every 0.5 s, on a rig with more
    /// friction. At the end of an exhaust the gas is colder than the wall: the heat transfer of
    /// charging would let it flow out and that of discharging would let it flow in, so that there
    /// is no flow for two rows, in which the pressure is the reference.
    #[test]
    fn a_flow_that_either_heat_transfer_would_reverse_stays_at_zero() {
        let Load::Weight(weight) = Nominal::REFERENCE.load else {
            panic!("the reference rig has a weight");
        };
        let rough = Nominal {
            load: Load::Weight(Weight {
                coulomb_friction_n: 12.5,
                static_friction_n: 15.0,
                ..weight
            }),
            ..Nominal::REFERENCE
        };
        let plant = Plant::new(&rough, [], Simulated::WHOLE).expect("a plant");
        let drive = |row: usize| Drive {
            reference: GaugePa([2e5, 3e5, 2.4e5, 2.6e5][row / 50 % 4]),
            ..Drive::default()
        };
        let initial = Initial {
            contraction: 0.1,
            pressure: GaugePa(2e5),
            ..Initial::vented(&plant)
        };
        let mut simulation = Simulation::new(plant, &initial, &drive(0), 1e-9);
        let (mut pressure_pa, mut stays) = (Vec::new(), Vec::new());
        for row in 0..225 {
            pressure_pa.push(simulation.pressure().0);
            stays.push(each!(&simulation.core, trajectory => trajectory.sliding));
            let until_s = 0.01 * (row + 1) as f64;
            simulation
                .advance(&drive(row), until_s)
                .expect("a solution");
        }
        let at_zero: Vec<usize> = (0..225).filter(|row| stays[*row]).collect();
        assert_eq!(at_zero, [221, 222]);
        for row in at_zero {
            assert!(
                (pressure_pa[row] - 2e5).abs() < 0.01,
                "{}",
                pressure_pa[row]
            );
        }
        assert!(pressure_pa[224] < 1.9999e5);
    }
}

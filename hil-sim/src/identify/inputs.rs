//! The inputs that a record has for the simulation of a rig.

use crate::error::BadInput;
use crate::record::{self, Record};
use crate::rig::Rig;
use model_core::pressure::{AbsolutePa, GaugePa};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Drive, Plant, Ramp, Simulated};
use muscle_plant::simulation::{Initial, Simulation, SimulationError};
use muscle_plant::subsystem::sensors::Reading;
use std::ops::ControlFlow;

/// The inputs of a simulation, row by row: measured signals with the sensors' effects removed and
/// missing samples filled in.
pub(crate) struct Inputs<'a> {
    /// Times of the rows \[s\].
    pub time_s: &'a [f64],
    /// Which quantities are simulated; the others are inputs.
    pub simulated: Simulated,
    /// Reference pressure (gauge) \[Pa\], held from its row; empty if the pressure is an input.
    reference_pa: Vec<f64>,
    /// Contraction \[-\], linear between rows; empty if it is simulated.
    contraction: Vec<f64>,
    /// Pressure in the muscle (gauge) \[Pa\], linear between rows; empty if it is simulated.
    pressure_pa: Vec<f64>,
    /// Supply pressure (gauge) \[Pa\], linear between rows; empty if it was not measured.
    supply_pa: Vec<f64>,
    /// Whether the shut-off valve between valve and muscle is closed from its row on; empty if it
    /// never is.
    shut: Vec<bool>,
    /// The contraction is that of a mass: parabolas between rows, whose jumps in rate are smaller
    /// than those of straight lines.
    pub(crate) inert: bool,
}

/// The difference quotient of `values` between a row and the next; 0 in the last row and if
/// `values` is empty.
fn slope(time_s: &[f64], values: &[f64], row: usize) -> f64 {
    match (values.get(row), values.get(row + 1)) {
        (Some(begin), Some(end)) => (end - begin) / (time_s[row + 1] - time_s[row]),
        _ => 0.0,
    }
}

/// An interval this many times longer than its neighbours is a gap, whose motion they do not
/// determine.
const GAP: f64 = 4.0;

/// The second derivative of `values` between a row and the next: the mean of the second differences
/// at both rows, so that the error, a third derivative, averages to zero. 0 beside an end and in a
/// gap.
fn curvature(time_s: &[f64], values: &[f64], row: usize) -> f64 {
    let Some(after) = time_s.get(row + 2).filter(|_| row > 0) else {
        return 0.0;
    };
    let interval_s = time_s[row + 1] - time_s[row];
    let shorter_neighbour_s = (time_s[row] - time_s[row - 1]).min(after - time_s[row + 1]);
    if interval_s > GAP * shorter_neighbour_s {
        return 0.0;
    }
    let rate = |row: usize| slope(time_s, values, row);
    let begin = (rate(row) - rate(row - 1)) / (time_s[row + 1] - time_s[row - 1]);
    let end = (rate(row + 1) - rate(row)) / (after - time_s[row]);
    begin + end
}

/// Which quantities of `rig` are simulated from `record`, and which are its inputs.
pub fn simulated(rig: &Rig, record: &Record) -> Simulated {
    Simulated {
        pressure: record.column(record::PRESSURE_REF_PA).is_some(),
        motion: matches!(rig.nominal.load, Load::Weight(_)),
    }
}

/// `pressure`, refused if it is not above vacuum.
pub(crate) fn above_vacuum(
    atmospheric: AbsolutePa<f64>,
    record: &Record,
    row: usize,
    pressure: GaugePa<f64>,
) -> Result<GaugePa<f64>, BadInput> {
    if pressure.to_absolute(atmospheric).0 > 0.0 {
        return Ok(pressure);
    }
    let expected = format!("a gauge pressure above vacuum, found {}", pressure.0);
    Err(record.bad_cell(record::PRESSURE_PA, row, &expected))
}

impl<'a> Inputs<'a> {
    /// The inputs of `rig` in `record`.
    ///
    /// # Errors
    /// The record lacks an input, or has one that is not physical.
    pub fn new(rig: &Rig, record: &'a Record) -> Result<Self, BadInput> {
        let simulated = simulated(rig, record);
        let plant = rig.plant(simulated)?;
        let time_s = record.time_s();
        let mut inputs = Inputs {
            time_s,
            simulated,
            reference_pa: Vec::new(),
            contraction: Vec::new(),
            pressure_pa: Vec::new(),
            supply_pa: Vec::new(),
            shut: record.shut(),
            inert: false,
        };
        let truth = |row: usize, pressure_pa: f64, contraction: f64| {
            let reading = Reading {
                pressure: GaugePa(pressure_pa),
                contraction,
                force_n: 0.0,
            };
            plant.sensors.truth(time_s[row], reading)
        };
        let measured = |name: &str, simulated: bool| {
            if simulated {
                Ok(Vec::new())
            } else {
                filled(record, name)
            }
        };
        let pressure_pa = measured(record::PRESSURE_PA, simulated.pressure)?;
        let contraction = measured(record::CONTRACTION, simulated.motion)?;
        for row in 0..time_s.len() {
            let pressure_pa = pressure_pa.get(row).copied();
            let contraction = contraction.get(row).copied();
            let truth = truth(row, pressure_pa.unwrap_or(0.0), contraction.unwrap_or(0.0));
            if pressure_pa.is_some() {
                let pressure = above_vacuum(plant.atmospheric, record, row, truth.pressure)?;
                inputs.pressure_pa.push(pressure.0);
            }
            if contraction.is_some() {
                inputs.contraction.push(truth.contraction);
            }
        }
        if simulated.pressure {
            inputs.reference_pa = held(record.require(record::PRESSURE_REF_PA)?);
        }
        if simulated.pressure && record.column(record::SUPPLY_PA).is_some() {
            inputs.supply_pa = filled(record, record::SUPPLY_PA)?;
        }
        Ok(inputs)
    }

    /// The drive from `row` to the next.
    pub fn drive(&self, row: usize) -> Drive {
        Drive {
            reference: GaugePa(self.reference_pa.get(row).copied().unwrap_or(0.0)),
            contraction_rate_per_s: slope(self.time_s, &self.contraction, row),
            contraction_acceleration_per_s2: if self.inert {
                curvature(self.time_s, &self.contraction, row)
            } else {
                0.0
            },
            pressure_rate_pa_per_s: slope(self.time_s, &self.pressure_pa, row),
            supply: self.supply_pa.get(row).map(|value| Ramp {
                start_s: self.time_s[row],
                value: *value,
                rate_per_s: slope(self.time_s, &self.supply_pa, row),
            }),
            shut: self.shut.get(row).copied().unwrap_or(false),
        }
    }

    /// The prescribed contraction at `row`, if it is an input.
    pub fn contraction(&self, row: usize) -> Option<f64> {
        self.contraction.get(row).copied()
    }

    /// The prescribed pressure at `row`, if it is an input.
    pub fn pressure(&self, row: usize) -> Option<GaugePa<f64>> {
        self.pressure_pa.get(row).copied().map(GaugePa)
    }

    /// Simulates `plant` from `initial` over the first `rows` rows. `visit` gets the simulation at
    /// each row and may end the run.
    ///
    /// # Errors
    /// The integration failed.
    pub fn run(
        &self,
        plant: Plant,
        initial: &Initial,
        tolerance: f64,
        rows: usize,
        mut visit: impl FnMut(usize, &mut Simulation) -> ControlFlow<()>,
    ) -> Result<(), SimulationError> {
        let mut simulation = Simulation::new(plant, initial, &self.drive(0), tolerance);
        for row in 0..rows {
            let drive = self.drive(row);
            // Inputs are set at each row, so that rounding errors do not add up.
            if let Some(contraction) = self.contraction(row) {
                let until_s = self.time_s.get(row + 1).copied();
                let half_s = 0.5 * until_s.map_or(0.0, |until_s| until_s - self.time_s[row]);
                // The rate at the row; the drive's is the mean over the interval.
                let rate_per_s =
                    drive.contraction_rate_per_s - half_s * drive.contraction_acceleration_per_s2;
                simulation.prescribe_contraction(contraction, rate_per_s);
            }
            if let Some(pressure) = self.pressure(row) {
                simulation.prescribe_pressure(pressure);
            }
            if visit(row, &mut simulation).is_break() {
                break;
            }
            if row + 1 < rows {
                simulation.advance(&drive, self.time_s[row + 1])?;
            }
        }
        Ok(())
    }
}

/// `values` with each missing sample replaced by the last present one.
fn held(values: &[f64]) -> Vec<f64> {
    let mut last = 0.0;
    let hold = |value: &f64| {
        if !value.is_nan() {
            last = *value;
        }
        last
    };
    values.iter().map(hold).collect()
}

/// A column with missing samples interpolated linearly and held at the ends.
///
/// # Errors
/// The record lacks the column.
fn filled(record: &Record, name: &str) -> Result<Vec<f64>, BadInput> {
    let (time_s, values) = (record.time_s(), record.require(name)?);
    let mut filled = values.to_vec();
    let mut present = (0..values.len())
        .filter(|row| !values[*row].is_nan())
        .peekable();
    let first = present.peek().copied().unwrap_or(0);
    filled[..first].fill(values[first]);
    while let Some(from) = present.next() {
        let to = present.peek().copied();
        for row in from + 1..to.unwrap_or(values.len()) {
            filled[row] = match to {
                None => values[from],
                Some(to) => {
                    let share = (time_s[row] - time_s[from]) / (time_s[to] - time_s[from]);
                    values[from] + share * (values[to] - values[from])
                }
            };
        }
    }
    Ok(filled)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_is_exact_for_a_parabola_and_at_the_middle_for_a_cubic() {
        let time_s = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        let parabola = time_s.map(|t| 3.0 * t * t + t);
        let cubic = time_s.map(|t| t * t * t);
        for row in 1..4 {
            assert!((curvature(&time_s, &parabola, row) - 6.0).abs() < 1e-9);
            let middle_s = 0.5 * (time_s[row] + time_s[row + 1]);
            assert!((curvature(&time_s, &cubic, row) - 6.0 * middle_s).abs() < 1e-9);
        }
        let uneven_s = [0.0, 0.1, 0.2, 0.35, 0.4, 0.5];
        let parabola = uneven_s.map(|t| 3.0 * t * t + t);
        for row in 1..4 {
            assert!((curvature(&uneven_s, &parabola, row) - 6.0).abs() < 1e-9);
        }
        assert!(
            [0, 4, 5]
                .iter()
                .all(|row| curvature(&uneven_s, &parabola, *row) == 0.0)
        );
        // Rows beside a gap do not determine the curvature within it.
        let gap_s = [0.0, 0.1, 0.2, 5.2, 5.3, 5.4];
        let triangle = gap_s.map(|t: f64| 0.2 * t.min(5.4 - t));
        assert_eq!(curvature(&gap_s, &triangle, 2), 0.0);
    }
}

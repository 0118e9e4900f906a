//! Runs the plant from a record's inputs alone, on the record's times.

use crate::error::BadInput;
use crate::identify::initial;
use crate::record::{self, Record};
use crate::rig::Rig;
use model_core::pressure::{AbsolutePa, GaugePa};
use muscle_plant::nominal::Load;
use muscle_plant::simulation::{Drive, Plant, Ramp, Simulated};
use muscle_plant::simulation::{Initial, Simulation, SimulationError};
use muscle_plant::subsystem::sensors::Reading;
use std::ops::ControlFlow;

/// What comes in, row by row: measured signals turned into the truth at their place, gaps filled.
pub(crate) struct Inputs<'a> {
    pub time_s: &'a [f64],
    pub simulated: Simulated,
    /// Reference pressure (gauge) \[Pa\], held from its row; empty if the pressure is an input.
    reference_pa: Vec<f64>,
    /// Contraction \[-\], linear between rows; empty if it is simulated.
    contraction: Vec<f64>,
    /// Pressure in the muscle (gauge) \[Pa\], linear between rows; empty if it is simulated.
    pressure_pa: Vec<f64>,
    /// Supply pressure (gauge) \[Pa\], linear between rows; empty if it was not measured.
    supply_pa: Vec<f64>,
    /// Whether the cock between valve and muscle is shut from its row on; empty if it never is.
    shut: Vec<bool>,
    /// The contraction is a mass's: it goes from row to row in parabolas, whose corners are smaller
    /// than those of straight lines.
    pub(crate) inert: bool,
}

/// The difference quotient of `values` between a row and the next; 0 in the last and in none.
fn slope(time_s: &[f64], values: &[f64], row: usize) -> f64 {
    match (values.get(row), values.get(row + 1)) {
        (Some(begin), Some(end)) => (end - begin) / (time_s[row + 1] - time_s[row]),
        _ => 0.0,
    }
}

/// An interval that is so many times its neighbours is a gap, whose motion they do not tell.
const GAP: f64 = 4.0;

/// The second derivative of `values` between a row and the next: the mean of theirs, so that what
/// is left out, a third derivative, is nothing on average. 0 beside an end and in a gap.
fn curvature(time_s: &[f64], values: &[f64], row: usize) -> f64 {
    let Some(after) = time_s.get(row + 2).filter(|_| row > 0) else {
        return 0.0;
    };
    let own_s = time_s[row + 1] - time_s[row];
    let beside_s = (time_s[row] - time_s[row - 1]).min(after - time_s[row + 1]);
    if own_s > GAP * beside_s {
        return 0.0;
    }
    let at = |row: usize| slope(time_s, values, row);
    let begin = (at(row) - at(row - 1)) / (time_s[row + 1] - time_s[row - 1]);
    let end = (at(row + 1) - at(row)) / (after - time_s[row]);
    begin + end
}

/// What is simulated of `rig` where `record` has the inputs.
pub fn simulated(rig: &Rig, record: &Record) -> Simulated {
    Simulated {
        pressure: record.column(record::PRESSURE_REF_PA).is_some(),
        motion: matches!(rig.nominal.load, Load::Weight(_)),
    }
}

/// Refuses a pressure that no gas has.
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
    /// The inputs that `record` has for `rig`.
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
        let at_row = |row: usize, pressure_pa: f64, contraction: f64| {
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
        let of = |values: &[f64], row: usize| values.get(row).copied();
        for row in 0..time_s.len() {
            let (pressure_pa, contraction) = (of(&pressure_pa, row), of(&contraction, row));
            let truth = at_row(row, pressure_pa.unwrap_or(0.0), contraction.unwrap_or(0.0));
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

    /// Runs `rig` from `initial` over the first `rows` rows; `visit` gets each row's simulation,
    /// and
    /// may break off.
    pub fn run(
        &self,
        plant: Plant,
        initial: &Initial,
        tolerance: f64,
        rows: usize,
        mut visit: impl FnMut(usize, &Simulation) -> ControlFlow<()>,
    ) -> Result<(), SimulationError> {
        let mut simulation = Simulation::new(plant, initial, &self.drive(0), tolerance);
        for row in 0..rows {
            let drive = self.drive(row);
            // Inputs are set anew at each row, so that rounding does not add up.
            if let Some(contraction) = self.contraction(row) {
                let until_s = self.time_s.get(row + 1).copied();
                let half_s = 0.5 * until_s.map_or(0.0, |until_s| until_s - self.time_s[row]);
                let gained_per_s = half_s * drive.contraction_acceleration_per_s2;
                let rate_per_s = drive.contraction_rate_per_s - gained_per_s;
                simulation.prescribe_contraction(contraction, rate_per_s);
            }
            if let Some(pressure) = self.pressure(row) {
                simulation.prescribe_pressure(pressure);
            }
            if visit(row, &simulation).is_break() {
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

/// A column with missing samples replaced on the line between their neighbours, held at the ends.
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

/// An input that is read as it came, but for rounding, comes out as it came.
fn restore(read: &mut [f64], record: &Record, name: &str, input: bool) {
    let measured = record.column(name).filter(|_| input).unwrap_or_default();
    // Atmospheric pressure comes and goes.
    let scale = if name == record::PRESSURE_PA {
        1e5
    } else {
        1.0
    };
    for (read, measured) in read.iter_mut().zip(measured) {
        if (*read - measured).abs() <= 1e-12 * (scale + measured.abs()) {
            *read = *measured;
        }
    }
}

/// Simulates `rig` on the times of `record` from its inputs alone: the same columns, with pressure,
/// contraction and force as the rig's sensors would read them, without noise.
///
/// With `pressure_ref_pa` the valve and the gas are simulated, else the measured pressure is an
/// input; a prescribed load takes the measured contraction as an input. The initial state comes
/// from the record's first second (see [`crate::initial`]).
///
/// # Errors
/// Rig and record do not fit together, or the record's inputs take the plant out of physics.
pub fn simulate(rig: &Rig, record: &Record, tolerance: f64) -> Result<Record, BadInput> {
    simulate_with(rig, record, tolerance, || ())
}

/// As [`simulate`]; `row_done` is called after each row.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_with(
    rig: &Rig,
    record: &Record,
    tolerance: f64,
    mut row_done: impl FnMut(),
) -> Result<Record, BadInput> {
    let inputs = Inputs::new(rig, record)?;
    let initial = initial::estimate(rig, record, &inputs)?;
    let rows = record.time_s().len();
    let mut columns = [(); 4].map(|()| Vec::with_capacity(rows));
    let plant = rig.plant(inputs.simulated)?;
    let visit = |_, simulation: &Simulation| {
        let reading = simulation.read();
        let values = [
            reading.pressure.0,
            reading.contraction,
            reading.force_n,
            simulation.temperature_k(),
        ];
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
        row_done();
        ControlFlow::Continue(())
    };
    inputs
        .run(plant, &initial, tolerance, rows, visit)
        .map_err(|error| {
            record.bad_at(
                error.time_s(),
                &format!("inputs that the plant can follow, {error}"),
            )
        })?;
    let mut simulated = record.clone();
    let [mut pressure_pa, mut contraction, force_n, temperature_k] = columns;
    let which = inputs.simulated;
    restore(
        &mut pressure_pa,
        record,
        record::PRESSURE_PA,
        !which.pressure,
    );
    restore(&mut contraction, record, record::CONTRACTION, !which.motion);
    simulated.set(record::PRESSURE_PA, pressure_pa);
    simulated.set(record::CONTRACTION, contraction);
    simulated.set(record::FORCE_N, force_n);
    if inputs.simulated.pressure && record.column(record::TEMPERATURE_K).is_some() {
        simulated.set(record::TEMPERATURE_K, temperature_k);
    }
    Ok(simulated)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_keeps_its_curvature_and_a_cubic_its_mean() {
        let time_s = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        let of = |value: fn(f64) -> f64| time_s.map(value);
        let parabola = of(|t| 3.0 * t * t + t);
        let cubic = of(|t| t * t * t);
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
        // Nor does a reversal on either side of a gap swing through it.
        let gap_s = [0.0, 0.1, 0.2, 5.2, 5.3, 5.4];
        let triangle = gap_s.map(|t: f64| 0.2 * t.min(5.4 - t));
        assert_eq!(curvature(&gap_s, &triangle, 2), 0.0);
    }
}

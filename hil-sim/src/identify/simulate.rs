//! Simulates a rig from a record's inputs alone, on the record's times.

use crate::error::BadInput;
use crate::identify::initial;
use crate::identify::inputs::Inputs;
use crate::record::{self, Record};
use crate::rig::Rig;
use muscle_plant::simulation::{Initial, Simulated, Simulation};
use std::ops::ControlFlow;

pub use crate::identify::inputs::simulated;

/// Replaces readings of an input that differ from the record by rounding errors alone with the
/// recorded values.
fn restore(read: &mut [f64], record: &Record, name: &str, input: bool) {
    let measured = record.column(name).filter(|_| input).unwrap_or_default();
    // Atmospheric pressure was added and subtracted.
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

/// The initial state with which [`simulate`] begins, from the record's first second.
///
/// # Errors
/// The record lacks an input of the rig.
pub fn initial_state(rig: &Rig, record: &Record) -> Result<Initial, BadInput> {
    initial::estimate(rig, record, &Inputs::new(rig, record)?)
}

/// Simulates `rig` on the times of `record` from its inputs alone: the same columns, with pressure,
/// contraction and force as the rig's sensors would read them, without noise.
///
/// With `pressure_ref_pa` the valve and the gas are simulated, else the measured pressure is an
/// input; a prescribed load takes the measured contraction as an input. The initial state comes
/// from the record's first second.
///
/// # Errors
/// The record lacks an input of the rig, or the plant cannot follow the inputs.
pub fn simulate(rig: &Rig, record: &Record, tolerance: f64) -> Result<Record, BadInput> {
    simulate_with(rig, record, tolerance, || ())
}

/// As [`simulate`]; calls `row_done` after each row.
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
    let visit = |_, simulation: &mut Simulation| {
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
    let Simulated { pressure, motion } = inputs.simulated;
    restore(&mut pressure_pa, record, record::PRESSURE_PA, !pressure);
    restore(&mut contraction, record, record::CONTRACTION, !motion);
    simulated.set(record::PRESSURE_PA, pressure_pa);
    simulated.set(record::CONTRACTION, contraction);
    simulated.set(record::FORCE_N, force_n);
    if pressure && record.column(record::TEMPERATURE_K).is_some() {
        simulated.set(record::TEMPERATURE_K, temperature_k);
    }
    Ok(simulated)
}

//! Rigs and records from Python: text and columns, or files.

use hil_sim::error::BadInput;
use hil_sim::identify::provenance::file_hash;
use hil_sim::record::check::{check, refuse_units};
use hil_sim::record::{Record, csv_of_columns};
use hil_sim::rig::{FileHash, Rig};
use pyo3::prelude::*;

/// Columns by name, each of float64 in the machine's order.
pub type Columns = Vec<(String, Vec<u8>)>;

/// A rig: the name of its file, and its text.
#[derive(FromPyObject)]
pub struct GivenRig {
    pub name: String,
    pub text: String,
}

impl GivenRig {
    /// Reads it. Values that cannot be in the units of their names are errors, unless accepted.
    pub fn read(&self, accept: bool) -> Result<Rig, BadInput> {
        let rig = Rig::parse(&self.name, &self.text)?;
        match rig.check_units() {
            Err(error) if !accept => Err(error),
            _ => Ok(rig),
        }
    }
}

/// A record: the name of its file, and its columns unless these are in the file.
#[derive(FromPyObject)]
pub struct GivenRecord {
    name: String,
    columns: Option<Columns>,
}

/// A record with its file's hash: that of the CSV that its columns make.
pub struct Taken {
    pub record: Record,
    pub hash: FileHash,
}

impl GivenRecord {
    /// Reads it, or makes it of its columns, with the checks of a file.
    pub fn read(&self) -> Result<Taken, BadInput> {
        let bytes = match &self.columns {
            None => Record::read_bytes(self.name.as_ref())?,
            Some(columns) => csv_of_columns(&self.name, columns.iter().map(numbers))?,
        };
        Ok(Taken {
            record: Record::parse(&self.name, &bytes)?,
            hash: file_hash(self.name.as_ref(), &bytes),
        })
    }

    /// The same, with the checks of names and units before a simulation or a diagnosis.
    pub fn checked(&self, rig: &Rig, accept: bool) -> Result<Taken, BadInput> {
        let taken = self.read()?;
        taken.record.check_names()?;
        let doubted = check(&taken.record).units(&taken.record, Some(rig));
        match refuse_units(&doubted, &taken.record) {
            Err(error) if !accept => Err(error),
            _ => Ok(taken),
        }
    }
}

fn numbers((name, bytes): &(String, Vec<u8>)) -> (&str, Vec<f64>) {
    let numbers = bytes.as_chunks().0.iter();
    (
        name,
        numbers.map(|bytes| f64::from_ne_bytes(*bytes)).collect(),
    )
}

/// The known columns of a record, the time first.
pub fn columns_of(record: &Record) -> Columns {
    let columns = record.numbers();
    let bytes = |values: &[f64]| {
        values
            .iter()
            .flat_map(|value| value.to_ne_bytes())
            .collect()
    };
    columns
        .map(|(name, values)| (name.to_owned(), bytes(values)))
        .collect()
}

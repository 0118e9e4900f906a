//! What evidence is computed from: residuals, and columns that change them.

/// The rows of one block over all records.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Time of each row \[s\].
    pub time_s: Vec<f64>,
    /// Whether the row begins a record, of whose process the one before tells nothing.
    pub begins: Vec<bool>,
    /// What is measured less what the nominal model says, in units of the row's noise.
    pub residual: Vec<f64>,
    /// RMS that the nominal model of a sound rig may leave, in units of the row's noise.
    pub base: Vec<f64>,
    /// Whether the row has a part in the process that its block leaves.
    pub in_process: Vec<bool>,
}

/// A column over the rows of each block, in units of the rows' noise; empty where it changes none.
pub type Column = Vec<Vec<f64>>;

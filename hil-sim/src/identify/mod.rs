//! The muscle as a model of the estimator: simulations of records, residuals of its subsystems, and
//! the diagnosis of what is missing.

pub mod compare;
pub mod diagnosis;
pub mod files;
pub mod formula;
pub mod gap;
pub(crate) mod initial;
mod inputs;
pub mod leak_down;
pub mod muscle;
pub mod provenance;
pub mod repeats;
pub mod report;
mod rhythm;
pub mod simulate;

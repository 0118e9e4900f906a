//! The plant of a rig as an FMU for co-simulation (FMI 3.0): its variables, its state between
//! communication points, and the archive. The C functions are in the crate `fmu`; docs/fmu.md says
//! what an importer sees.

mod description;
mod instance;
#[cfg(feature = "formats")]
mod package;
mod variables;

pub use description::Experiment;
pub use instance::Instance;
#[cfg(feature = "formats")]
pub use package::{library_name, package};
pub use variables::Model;

/// Path of the rig in the FMU's folder of resources.
pub const RIG_FILE: &str = "rig.toml";
/// Path of the start values of inputs and settings in the FMU's folder of resources.
pub const STARTS_FILE: &str = "start.json";
/// The model's identifier: the name of the shared library without its extension.
pub const MODEL_IDENTIFIER: &str = "hil_sim_fmu";

//! Muscle rigs with hidden effects, to measure how well a diagnosis names them.
//!
//! Everything here is its own: the plant's equations, the integrator and the forms of the effects
//! share nothing with the program that is measured, so that agreement between them is evidence.
//! A case is reproduced by its seed and number alone; [`plan`] tells what it hides without
//! simulating it.
//!
//! In an answer, `most_over_noise` is the effect's largest difference of a measured signal on the
//! validation records, root mean square against the same rig without this effect alone, over that
//! signal's noise. `standard` repeats the parameters that mean the same in the effect's simplest
//! textbook form; only forms that are that form have any:
//!
//! | effect | parameter | meaning |
//! |---|---|---|
//! | `dead-band` | `threshold_pa` | pressure below which the muscle does not pull |
//! | `friction` | `coulomb_n` | beyond nominal, the same at rest and moving |
//! | `payload` | `mass_kg` | beyond nominal, may be negative |
//! | `backlash` | `gap_m` | whole play of the encoder |
//! | `valve-lag` | `time_constant_s`, or `frequency_hz` and `damping` | of the reference |
//! | `valve-dead-zone` | `width_pa` | half of the zone, the same each way |
//! | `transport-delay` | `delay_s` | of the reference |
//! | `line-dynamics` | `frequency_hz`, `damping` | of the reading about the muscle's pressure |
//! | `leak` | `conductance_kg_per_pa_s` | flow over gauge pressure |
//! | `heat-exchange` | `factor` | times the true rig's heat transfer, both ways |
//! | `pressure-sensor-gain` | `gain` | reading over pressure |
//! | `pressure-sensor-offset` | `offset_pa` | reading less pressure, after any gain |
//! | `pressure-sensor-drift` | `drift_pa_per_s` | from nothing at the record's first sample |
//! | `contraction-sensor-offset` | `offset` | reading less contraction |

mod case;
pub mod drawn;
mod drive;
mod effects;
mod family;
mod hidden;
mod live;
mod machine;
mod record;
mod rig;
#[cfg(test)]
mod tests;

pub use case::{Case, Kind, Plan, Planned, case, experiment, plan};
pub use drive::Drive;
pub use effects::{CATALOGUE, Entry, Form};
pub use family::Family;
pub use hidden::Reading;
pub use live::{Hiding, Seen};
pub use record::{Sensor, Sensors};
pub use rig::Rig;

//! Muscle rigs with hidden effects, to measure how well a diagnosis finds them.
//!
//! The plant's equations, the integrator and the forms of the effects share no code with the
//! measured program, so that agreement between them is evidence. A case is reproduced by its
//! family, seed and number alone.
//!
//! - [`drawn`]: the law of every effect is drawn at random, and with it rig, sensors, clock and
//!   drive. The figures of a diagnosis are measured on these.
//! - `catalogue-like`: a few forms of each effect on the paper's rig, for tests that need a known
//!   form. Eighteen of its forms are textbook forms that a diagnosis may have too, so the results
//!   say little about a diagnosis of a real rig.
//!
//! In an answer, `most_over_noise` is the effect's largest difference of a measured signal on
//! held-out records, root mean square against the same rig without this effect alone under the
//! same references, over that signal's noise. Held out are the validation records, and of drawn
//! cases the unseen one too. `indistinguishable_from` of drawn cases is kept for the names of
//! effects whose best law differs from the data by less than any method can tell; it is not
//! computed yet and therefore empty. `standard`, of the catalogue-like family, repeats the
//! parameters that mean the same in the effect's simplest textbook form; only forms that are that
//! form have any:
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

pub use case::{Case, Kind, Plan, Planned, case, experiment, plan, rows};
pub use drive::Drive;
pub use effects::{CATALOGUE, Entry, Form};
pub use family::Family;
pub use hidden::Reading;
pub use live::{Hiding, Seen};
pub use record::{Sensor, Sensors};
pub use rig::Rig;

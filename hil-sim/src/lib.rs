//! Records, rigs, the test bench around the muscle plant, its identification from data, and
//! reports.

pub mod bench;
pub mod commission;
pub mod datasheet;
pub mod design;
pub mod effect_page;
pub mod effect_plots;
pub mod error;
pub mod faults;
pub mod fmu;
pub mod identify;
pub mod input;
pub mod output;
pub mod own_effect;
pub mod paper;
mod plausible;
pub mod record;
pub mod report;
pub mod rig;

//! The muscle plant, the closed loop with the real controller, and its reports.

pub mod closed_loop;
pub mod design;
pub mod design_report;
pub mod effects;
pub mod error;
pub mod gap;
pub mod initial;
pub mod output;
pub mod paper;
pub mod plant;
pub mod record;
pub mod report;
pub mod rig;
pub mod simulate;

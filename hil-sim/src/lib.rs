//! The muscle plant, the closed loop with the real controller, and its reports.

pub mod check;
pub mod closed_loop;
pub mod design;
pub mod design_report;
pub mod effects;
pub mod emulated;
pub mod error;
pub mod experiment;
pub mod gap;
pub mod hil;
pub mod import;
pub mod initial;
pub mod link;
pub mod mcap;
pub mod output;
pub mod paper;
pub mod plant;
pub mod player;
pub mod record;
pub mod recorder;
pub mod replay;
pub mod report;
pub mod rig;
pub mod screen;
pub mod serial;
pub mod simulate;

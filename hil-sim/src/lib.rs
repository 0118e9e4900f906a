//! The muscle plant, the closed loop with the real controller, and its reports.

pub mod design;
pub mod effects;
pub mod error;
pub mod initial;
pub mod output;
pub mod plant;
pub mod record;
pub mod rig;
pub mod simulate;

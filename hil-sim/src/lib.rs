//! The muscle plant, the closed loop with the real controller, and its reports.

pub mod effects;

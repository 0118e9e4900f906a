//! Commissioning: leads a person from a bare board to the first lift, in an order that is safe
//! before the first air (docs/commissioning.md).
//!
//! The estimators are pure functions of telemetry; [`session`] asks, listens and plays; whoever
//! answers is a [`person::Person`]: a terminal, a script or a test.

pub mod air;
pub mod cause;
pub mod curve;
pub mod lift;
pub mod person;
pub mod readings;
pub mod scale;
pub mod session;
mod steps;
pub mod written;

//! The power-assist controller and the algebraic equations of Kagawa, Fujita and Kawashima.
//!
//! One crate, the same code on the microcontroller (`f32`) and in the simulator (`f64`): it
//! allocates nothing, logs nothing, never panics, and knows no hardware.
#![cfg_attr(not(test), no_std)]

pub mod assist;
pub mod muscle;
pub mod pressure;
pub mod reference;
pub mod valve;

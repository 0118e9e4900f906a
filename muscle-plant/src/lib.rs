#![doc = include_str!("../README.md")]

pub mod effects;
pub mod nominal;
pub mod simulation;
pub mod subsystem;

//! Drivers of the rig's devices, independent of the chip: over the traits of `embedded-hal` 1.0,
//! or over a small trait of their own where it has none (counter of encoder edges, analog output,
//! watchdog timer, flash). The firmware implements these for its chips.
#![no_std]

pub mod ads1220;
pub mod button;
pub mod contact;
pub mod encoder;
pub mod mcp4922;
pub mod output;
pub mod stop;
pub mod store;
pub mod valve;
pub mod watchdog;

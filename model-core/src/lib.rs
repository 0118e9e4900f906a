//! The power-assist controller and the algebraic equations of Kagawa, Fujita and Kawashima.
//!
//! The same code runs on the microcontroller (`f32`) and in the simulator (`f64`): it does not
//! allocate, log or panic, and does not depend on hardware.
//!
//! One tick, every 10 ms ([`controller::Controller::tick`] is the page to read first):
//!
//! ```text
//! counts ─ signal ─ F_b, P, ε ─ supervisor ─ mode ─┐
//!                    │                             ├─ P_r, limited ─ signal ─ DAC counts
//!                    └─ assist (Eq 7) ─ reference (Eq 8)
//! ```
//!
//! A record replays on the PC to the bit as it ran on the board: IEEE 754 defines + − × ÷,
//! comparisons and conversions, and libm, which is the same software on both, does the rest (see
//! [`number`]). `tests/cortex-m` compares.
#![cfg_attr(not(test), no_std)]
#![cfg_attr(
    not(test),
    deny(
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::unwrap_used
    )
)]

pub mod analysis;
pub mod assist;
pub mod clock;
pub mod command;
pub mod compensation;
pub mod consistency;
pub mod constants;
pub mod contact;
pub mod controller;
pub mod device;
pub mod enabling;
pub mod error;
pub mod gate;
#[cfg(test)]
mod interval;
pub mod io;
pub mod lamp;
pub mod limits;
pub mod link;
pub mod muscle;
mod names;
pub mod number;
pub mod plausibility;
pub mod pressure;
pub mod reference;
pub mod retreat;
pub mod sampling;
pub mod settings;
pub mod signal;
pub mod start;
pub mod state;
pub mod stop;
pub mod store;
pub mod supervisor;
pub mod timing;
pub mod valve;
pub mod voted;
mod words;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

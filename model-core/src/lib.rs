//! The power-assist controller and the algebraic equations of Kagawa, Fujita and Kawashima.
//!
//! One crate, the same code on the microcontroller (`f32`) and in the simulator (`f64`): it
//! allocates nothing, logs nothing, never panics, and knows no hardware.
//!
//! One tick, every 10 ms ([`controller::Controller::tick`] is the page to read first):
//!
//! ```text
//! counts ─ signal ─ F_b, P, ε ─ supervisor ─ mode ─┐
//!                    │                             ├─ P_r, limited ─ signal ─ DAC counts
//!                    └─ assist (Eq 7) ─ reference (Eq 8)
//! ```
//!
//! Arithmetic is plain: + − × ÷, comparisons and conversions, all of which IEEE 754 defines to the
//! bit, so that a record replays on the PC exactly as it ran on the board. (`max` and `min` leave
//! open which of +0 and −0 they return: no result depends on that. `tests/cortex-m` compares.)
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

pub mod assist;
pub mod compensation;
pub mod consistency;
pub mod controller;
pub mod device;
pub mod error;
pub mod io;
pub mod limits;
pub mod link;
pub mod muscle;
pub mod plausibility;
pub mod pressure;
pub mod reference;
pub mod safety;
pub mod sampling;
pub mod settings;
pub mod signal;
pub mod store;
pub mod supervisor;
pub mod timing;
pub mod valve;
pub mod voted;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

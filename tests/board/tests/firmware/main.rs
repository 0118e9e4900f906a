//! The real firmware on the emulated board.
//!
//! The tests need the ELF of the firmware, whose path is in the environment variable `FIRMWARE`:
//! `FIRMWARE=… cargo test --release -- --include-ignored`. Those of `converter` need that of a
//! board whose bridge has a converter of its own.

mod assist;
mod boot;
mod budget;
mod clock;
mod commission;
mod converter;
mod crash;
mod debugger;
mod faults;
mod link;
#[cfg(unix)]
mod live;
mod outputs;
mod pins;
mod rig;
mod sequences;
mod settings;
mod soak;
mod start;
mod timing;
mod units;

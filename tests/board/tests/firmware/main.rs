//! The real firmware on the emulated board.
//!
//! `FIRMWARE` names its ELF; without it every test here says so on stderr and proves nothing.

mod assist;
mod boot;
mod budget;
mod crash;
mod faults;
mod link;
mod pins;
mod rig;
mod settings;
mod soak;
mod timing;

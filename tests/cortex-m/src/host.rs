//! What model-core's tests expect of std.
#![allow(unused_imports)]

pub use alloc::string::{String, ToString};
pub use alloc::vec::Vec;
pub use alloc::{format, vec};
pub use num_traits::float::FloatCore;

/// A test's name and the test.
pub type Test = (&'static str, fn());

/// The paths that they use.
pub mod std {
    pub use core::ops;
}

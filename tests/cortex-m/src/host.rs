//! Replacement of what the tests of model-core use of std.
#![allow(unused_imports)]

pub use alloc::string::{String, ToString};
pub use alloc::vec::Vec;
pub use alloc::{format, vec};
pub use num_traits::float::FloatCore;

/// Name and function of a test.
pub type Test = (&'static str, fn());

/// Paths in std that the tests use.
pub mod std {
    pub use core::ops;
}

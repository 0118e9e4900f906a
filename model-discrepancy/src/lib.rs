#![doc = include_str!("../README.md")]

pub mod engine;
pub mod least_squares;
pub mod left;
pub mod verdict;

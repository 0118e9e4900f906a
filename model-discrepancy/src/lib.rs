#![doc = include_str!("../README.md")]

pub mod choice;
pub mod engine;
pub mod least_squares;
pub mod left;

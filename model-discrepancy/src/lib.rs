#![doc = include_str!("../README.md")]

pub mod engine;
pub mod evidence;
pub mod least_squares;
pub mod left;
pub mod rows;
mod search;
pub mod verdict;

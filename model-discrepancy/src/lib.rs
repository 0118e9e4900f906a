#![doc = include_str!("../README.md")]

pub mod engine;
pub mod evidence;
pub mod form_fit;
pub mod least_squares;
pub mod left;
pub mod rows;
pub mod signature;
pub mod verdict;

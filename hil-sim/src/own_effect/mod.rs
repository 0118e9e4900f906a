//! Effects of one's own, declared in a rig file as expressions: docs/own-effect.md.

mod declared;
mod dimension;
mod expression;
mod term;
mod tried;

pub(crate) use declared::QUANTITIES;
pub use declared::{FILES_KEY, KEY, from_toml, read_file, tables};
pub(crate) use dimension::Dimension;

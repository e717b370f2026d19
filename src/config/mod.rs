//! Settings: TOML to checked, typed values.
//!
//! The way of a setting is one line: preset of the method, then the file, then `--set`, each
//! overriding the one before; the merged table is checked key by key and only then typed.
//! [`KEYS`] says all of every key, [`Method::definition`] all of every method.

mod errors;
mod keys;
mod merge;
mod method;
mod range;
mod settings;
#[cfg(test)]
mod tests;
mod validate;

pub use errors::{ConfigError, Source};
pub use keys::{KEYS, Key, Resume, SECTIONS, find, is_section, nearest};
pub use merge::{Overrides, parse, preset, read, read_resolved};
pub use method::{Addition, Concern, Definition, Method, Preset};
pub use range::Range;
pub use settings::*;

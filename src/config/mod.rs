//! Settings: TOML to checked, typed values.
//!
//! The way of a setting is one line: preset of the method, then the file, then `--set`, each
//! overriding the one before; the merged table is checked key by key and only then typed.
//! See [`Config`] for every key.

mod demonstrations;
mod load;
mod method;
mod settings;
mod validate;

pub use demonstrations::DemonstrationSettings;
pub use load::{ConfigError, Overrides, Source, parse, read, read_resolved};
pub use method::{Addition, Method};
pub use settings::*;

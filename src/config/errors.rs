//! Why a configuration can't be used.

use super::Method;
use std::fmt;
use std::path::PathBuf;

/// Where a value came from, for error messages.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A configuration file.
    File(PathBuf),
    /// A command-line option, as the user wrote it.
    Option(String),
    /// A setting that an experiment gives to all its runs, as `KEY=VALUE`.
    Experiment(String),
    /// The preset of the method.
    Preset(Method),
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Source::File(path) => write!(f, "{}", path.display()),
            Source::Option(option) => write!(f, "{option}"),
            Source::Experiment(setting) => write!(f, "[settings] {setting}"),
            Source::Preset(method) => write!(f, "preset of method `{}`", method.name()),
        }
    }
}

/// Why a configuration can't be used. Every message names the source, the key, the value and what
/// would be right.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file can't be read.
    #[error(
        "{}: can't read the configuration: {error}; expected a TOML file such as configs/quickstart.toml",
        path.display()
    )]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// The file is not TOML.
    #[error("{}: not valid TOML: {error}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Position and reason.
        error: toml::de::Error,
    },
    /// `--set` without a key or an equals sign.
    #[error("--set {0}: expected KEY=VALUE, for example --set imagination.target_filter=false")]
    MalformedSet(String),
    /// No such key.
    #[error("{origin}: unknown key `{key}`{}", suggestion(nearest))]
    UnknownKey {
        /// Where the key stands.
        origin: Source,
        /// The dotted key.
        key: String,
        /// The nearest valid key.
        nearest: Option<String>,
    },
    /// A value of another type.
    #[error("{origin}: `{key}` = {value}: expected {expected}")]
    WrongValue {
        /// Where the value stands.
        origin: Source,
        /// The dotted key.
        key: String,
        /// The value as written.
        value: String,
        /// What would be right.
        expected: String,
    },
    /// A key without a default is missing.
    #[error("{origin}: missing key `{key}`: {expected}")]
    Missing {
        /// Where it should stand.
        origin: Source,
        /// The dotted key.
        key: String,
        /// What would be right.
        expected: String,
    },
}

fn suggestion(nearest: &Option<String>) -> String {
    match nearest {
        Some(key) => format!(" (did you mean `{key}`?)"),
        None => String::new(),
    }
}

//! Reading and merging: preset, file, `--set`.

use super::{Config, Method, validate};
use crate::env;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Where a value came from, for error messages.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A configuration file.
    File(PathBuf),
    /// A command-line option, as the user wrote it.
    Option(String),
    /// The preset of the method.
    Preset(Method),
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Source::File(path) => write!(f, "{}", path.display()),
            Source::Option(option) => write!(f, "{option}"),
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

/// Options of the command line that override a file, in order: later ones win.
#[derive(Debug, Default, Clone)]
pub struct Overrides(Vec<(Source, String, Value)>);

impl Overrides {
    /// Adds one `KEY=VALUE`; the value is TOML, or else a bare string.
    ///
    /// # Errors
    /// When there is no key or no equals sign.
    pub fn set(&mut self, argument: &str) -> Result<(), ConfigError> {
        let malformed = || ConfigError::MalformedSet(argument.to_owned());
        let (key, text) = argument.split_once('=').ok_or_else(malformed)?;
        let (key, text) = (key.trim(), text.trim());
        if key.is_empty() {
            return Err(malformed());
        }
        let value = toml::from_str::<Table>(&format!("value = {text}"))
            .ok()
            .and_then(|mut table| {
                if table.len() == 1 {
                    table.remove("value")
                } else {
                    None
                }
            })
            .unwrap_or_else(|| Value::String(text.to_owned()));
        self.push(format!("--set {argument}"), key, value);
        Ok(())
    }

    /// Adds the value of an option of its own, such as `--seed`.
    pub fn push(&mut self, option: String, key: &str, value: impl Into<Value>) {
        self.0
            .push((Source::Option(option), key.to_owned(), value.into()));
    }
}

/// Reads `path`, applies `overrides`, fills in the method's preset and checks everything.
///
/// # Errors
/// When the file is unreadable or not TOML, a key is unknown, a value has a wrong type or lies out
/// of range, or `task` is missing. Whether the task exists is left to the registry of tasks.
pub fn read(path: &Path, overrides: &Overrides) -> Result<Config, ConfigError> {
    parse(&text(path)?, path, overrides)
}

/// As [`read`], of a `text` that is said to come from `path`.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path, overrides: &Overrides) -> Result<Config, ConfigError> {
    given(text, path, overrides)?.resolve(Source::File(path.to_owned()))
}

/// Reads the configuration of a run, which must hold every key: nothing is filled in. Then applies
/// `overrides`.
///
/// # Errors
/// As [`read`], and when a key is missing.
pub fn read_resolved(path: &Path, overrides: &Overrides) -> Result<Config, ConfigError> {
    let text = text(path)?;
    let given = given(&text, path, &Overrides::default())?;
    let keys: Vec<String> = given.0.keys().cloned().collect();
    let config = parse(&text, path, overrides)?;
    match values(&config).into_keys().find(|key| !keys.contains(key)) {
        None => Ok(config),
        Some(key) => Err(ConfigError::Missing {
            origin: Source::File(path.to_owned()),
            key,
            expected: "the configuration of a run holds every key".into(),
        }),
    }
}

fn text(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|error| ConfigError::Unreadable {
        path: path.to_owned(),
        error,
    })
}

/// What the file and the overrides say.
fn given(text: &str, path: &Path, overrides: &Overrides) -> Result<Given, ConfigError> {
    let file: Table = toml::from_str(text).map_err(|error| ConfigError::Syntax {
        path: path.to_owned(),
        error,
    })?;

    let mut given = Given::default();
    given.add_table(&Source::File(path.to_owned()), "", file);
    for (source, key, value) in &overrides.0 {
        match value {
            Value::Table(table) => given.add_table(source, &format!("{key}."), table.clone()),
            value => given.add(source, key.clone(), value.clone()),
        }
    }
    Ok(given)
}

/// The values given by the user, by dotted key, each with its source.
#[derive(Default)]
struct Given(BTreeMap<String, (Source, Value)>);

impl Given {
    fn add_table(&mut self, source: &Source, prefix: &str, table: Table) {
        for (key, value) in table {
            let key = format!("{prefix}{key}");
            match value {
                Value::Table(inner) if !inner.is_empty() => {
                    self.add_table(source, &format!("{key}."), inner);
                }
                value => self.add(source, key, value),
            }
        }
    }

    fn add(&mut self, source: &Source, key: String, value: Value) {
        // `task` is an id, or a table that holds it beside what is done to the task.
        let key = match key.as_str() {
            "task.id" => "task".to_owned(),
            wrapper if wrapper.starts_with("task.") => wrapper["task.".len()..].to_owned(),
            _ => key,
        };
        self.0.insert(key, (source.clone(), value));
    }

    fn resolve(self, file: Source) -> Result<Config, ConfigError> {
        let method = match self.0.get("method") {
            None => Method::Mamf,
            Some((origin, value)) => {
                Method::deserialize(value.clone()).map_err(|error| ConfigError::WrongValue {
                    origin: origin.clone(),
                    key: "method".into(),
                    value: value.to_string(),
                    expected: expectation(&error),
                })?
            }
        };
        let preset = Table::try_from(Config::preset(method)).expect("a preset is a TOML table");
        let mut defaults = flattened(&preset);
        // Wrappers of the task are there only where they are asked for; this tells their types.
        defaults.insert("doubled_actions.period".into(), Value::Integer(200));

        let by_option = matches!(self.0.get("method"), Some((Source::Option(_), _)));
        let mut merged = preset;
        for (key, (origin, value)) in &self.0 {
            let Some(default) = defaults.get(key) else {
                if is_section(key, &defaults) && matches!(value, Value::Table(t) if t.is_empty()) {
                    continue;
                }
                return Err(unknown(origin, key, value, &defaults));
            };
            let value = same_type(value, default).ok_or_else(|| ConfigError::WrongValue {
                origin: origin.clone(),
                key: key.clone(),
                value: value.to_string(),
                expected: type_name(default).into(),
            })?;
            if let Some(reason) = method.ignores(key) {
                // What a file says for its own method may stay there when an option picks another.
                let overruled = matches!(origin, Source::File(_)) && by_option;
                if !overruled && value != *default {
                    return Err(ConfigError::WrongValue {
                        origin: origin.clone(),
                        key: key.clone(),
                        value: value.to_string(),
                        expected: format!("no such setting: method `{}` {reason}", method.name()),
                    });
                }
                continue;
            }
            insert(&mut merged, key, value);
        }

        let wrong = |key: &str, expected: String| {
            let (origin, value) = self.0.get(key).cloned().unwrap_or_else(|| {
                (
                    Source::Preset(method),
                    defaults.get(key).cloned().unwrap_or(Value::Boolean(false)),
                )
            });
            ConfigError::WrongValue {
                origin,
                key: key.to_owned(),
                value: value.to_string(),
                expected,
            }
        };
        let config: Config =
            serde_path_to_error::deserialize(Value::Table(merged)).map_err(|e| {
                let path = e.path().to_string();
                let key = path.split('[').next().unwrap_or(&path).to_owned();
                wrong(&key, expectation(e.inner()))
            })?;
        if !self.0.contains_key("task") {
            return Err(ConfigError::Missing {
                origin: file,
                key: "task".into(),
                expected: "the id of a task, for example task = \"HalfCheetah-v4\"".into(),
            });
        }
        env::info(&config.task).map_err(|unknown| {
            let hint = unknown
                .nearest
                .map_or(String::new(), |id| format!("; did you mean {id:?}?"));
            wrong(
                "task",
                format!("the id of a task (`mamf envs` lists them){hint}"),
            )
        })?;
        validate::check(&config).map_err(|v| wrong(v.key, v.expected))?;
        Ok(config)
    }
}

/// serde says `unknown variant `x`, expected ...` or `invalid value: ..., expected ...`; the part
/// after `expected` is what the user needs, since the value is named already.
fn expectation(error: &toml::de::Error) -> String {
    let message = error.message().trim();
    match message.split_once("expected ") {
        Some((_, expected)) => expected.to_owned(),
        None => message.to_owned(),
    }
}

/// The values of a configuration by dotted key.
pub(super) fn values(config: &Config) -> BTreeMap<String, Value> {
    flattened(&Table::try_from(config).expect("a configuration is a TOML table"))
}

/// The values of a table by dotted key.
fn flattened(table: &Table) -> BTreeMap<String, Value> {
    let mut values = BTreeMap::new();
    flatten("", table, &mut values);
    values
}

fn flatten(prefix: &str, table: &Table, out: &mut BTreeMap<String, Value>) {
    for (key, value) in table {
        let key = format!("{prefix}{key}");
        match value {
            Value::Table(inner) => flatten(&format!("{key}."), inner, out),
            value => {
                out.insert(key, value.clone());
            }
        }
    }
}

fn is_section(key: &str, defaults: &BTreeMap<String, Value>) -> bool {
    let prefix = format!("{key}.");
    defaults.keys().any(|k| k.starts_with(&prefix))
}

fn unknown(
    origin: &Source,
    key: &str,
    value: &Value,
    defaults: &BTreeMap<String, Value>,
) -> ConfigError {
    if is_section(key, defaults) {
        return ConfigError::WrongValue {
            origin: origin.clone(),
            key: key.to_owned(),
            value: value.to_string(),
            expected: format!("a section of keys, [{key}]"),
        };
    }
    ConfigError::UnknownKey {
        origin: origin.clone(),
        nearest: nearest(key, defaults.keys().map(String::as_str)).map(str::to_owned),
        key: key.to_owned(),
    }
}

/// The name among `names` that `written` was probably meant to be, if any is near.
fn nearest<'a>(written: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    // A key of another section is nearly as near as its last part.
    let last = |name: &str| name.rsplit('.').next().unwrap_or(name).to_owned();
    let likeness = |name: &str| {
        let whole = strsim::normalized_damerau_levenshtein(written, name);
        whole.max(0.95 * strsim::normalized_damerau_levenshtein(&last(written), &last(name)))
    };
    names
        .map(|name| (likeness(name), name))
        .filter(|(score, _)| *score > 0.5)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}

/// `value` as the type of `default`; whole numbers also serve as real ones.
fn same_type(value: &Value, default: &Value) -> Option<Value> {
    match (value, default) {
        (Value::Integer(i), Value::Float(_)) => Some(Value::Float(*i as f64)),
        (Value::Integer(i), Value::Integer(_)) if *i < 0 => None,
        // The lists there are hold whole numbers.
        (Value::Array(items), Value::Array(_))
            if !items
                .iter()
                .all(|item| item.as_integer().is_some_and(|i| i >= 0)) =>
        {
            None
        }
        (value, default) if value.same_type(default) => Some(value.clone()),
        _ => None,
    }
}

fn type_name(value: &Value) -> &'static str {
    match value {
        Value::String(_) => "a string",
        Value::Integer(_) => "a whole number, not negative",
        Value::Float(_) => "a number",
        Value::Boolean(_) => "true or false",
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list of whole numbers, for example [256, 256]",
        Value::Table(_) => "a section of keys",
    }
}

fn insert(table: &mut Table, key: &str, value: Value) {
    match key.split_once('.') {
        None => {
            table.insert(key.to_owned(), value);
        }
        Some((section, rest)) => {
            let section = table.entry(section).or_insert_with(|| Table::new().into());
            if let Value::Table(inner) = section {
                insert(inner, rest, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str, sets: &[&str]) -> Result<Config, ConfigError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("c.toml");
        std::fs::write(&path, text).unwrap();
        let mut overrides = Overrides::default();
        for set in sets {
            overrides.set(set)?;
        }
        read(&path, &overrides)
    }

    fn message(text: &str, sets: &[&str]) -> String {
        load(text, sets).unwrap_err().to_string()
    }

    #[test]
    fn file_overrides_preset_and_set_overrides_file() {
        let config = load(
            "task = \"Hopper-v4\"\ndiscount = 0.9\n[imagination]\ntarget_filter = true",
            &["imagination.target_filter=false", "method=td3", "tau=1"],
        )
        .unwrap();
        assert_eq!(config.discount, 0.9);
        assert_eq!(config.method, Method::Td3);
        assert!(!config.imagination.target_filter);
        assert_eq!(config.tau, 1.0);
        assert_eq!(config.batch_size, 256);
    }

    #[test]
    fn a_resolved_configuration_reads_back_equal() {
        let config = load("task = \"Hopper-v4\"", &[]).unwrap();
        let text = config.to_toml();
        assert_eq!(load(&text, &[]).unwrap(), config);
    }

    #[test]
    fn the_configuration_of_a_run_must_hold_every_key() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("config.toml");
        let config = load("task = \"Hopper-v4\"", &[]).unwrap();
        let text = config.to_toml();
        std::fs::write(&path, &text).unwrap();
        assert_eq!(read_resolved(&path, &Overrides::default()).unwrap(), config);
        for lines in 1..text.lines().count() {
            let cut: Vec<&str> = text.lines().take(lines).collect();
            std::fs::write(&path, cut.join("\n")).unwrap();
            assert!(
                read_resolved(&path, &Overrides::default()).is_err(),
                "{lines} lines"
            );
        }
    }

    #[test]
    fn unknown_keys_name_the_nearest_one() {
        let m = message("task = \"Hopper-v4\"\nbatchsize = 3", &[]);
        assert!(
            m.contains("c.toml") && m.contains("`batchsize`") && m.contains("`batch_size`"),
            "{m}"
        );
        let m = message("task = \"Hopper-v4\"", &["target_filter=false"]);
        assert!(
            m.contains("--set target_filter") && m.contains("`imagination.target_filter`"),
            "{m}"
        );
    }

    #[test]
    fn wrong_values_name_key_value_and_what_is_right() {
        let task = "task = \"Hopper-v4\"\n";
        for (set, parts) in [
            ("steps=-5", ["`steps`", "-5", "not negative"]),
            ("steps=0", ["`steps`", "0", "at least 1"]),
            ("discount=1.5", ["`discount`", "1.5", "from 0 to 1"]),
            ("discount=nan", ["`discount`", "nan", "from 0 to 1"]),
            (
                "imagination.decay_rate=1.1",
                ["`imagination.decay_rate`", "1.1", "at most 1"],
            ),
            ("batch_size=0", ["`batch_size`", "0", "at least 1"]),
            (
                "batch_size=30000",
                ["`batch_size`", "30000", "random_steps (25000)"],
            ),
            ("batch_size=big", ["`batch_size`", "big", "whole number"]),
            ("method=ppo", ["`method`", "ppo", "`mamf`"]),
            ("model.predict=all", ["`model.predict`", "all", "`delta`"]),
            (
                "networks.hidden=[256, \"a\"]",
                ["`networks.hidden`", "\"a\"", "list of whole numbers"],
            ),
            (
                "networks.hidden=[]",
                ["`networks.hidden`", "[]", "one or more widths"],
            ),
            ("imagination=3", ["`imagination`", "3", "[imagination]"]),
        ] {
            let m = message(task, &[set]);
            assert!(parts.iter().all(|p| m.contains(p)), "{set}: {m}");
        }
    }

    #[test]
    fn a_missing_task_and_malformed_input_are_named() {
        assert!(message("seed = 1", &[]).contains("missing key `task`"));
        assert!(message("seed = ", &[]).contains("not valid TOML"));
        assert!(message("task = \"x\"", &["nothing"]).contains("KEY=VALUE"));
    }
}

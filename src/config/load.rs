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
    let keys: Vec<String> = given.values.keys().cloned().collect();
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
    given.add_table(&Source::File(path.to_owned()), "", file)?;
    given.method_of_file = given.values.get("method").map(|(_, value)| value.clone());
    for (source, key, value) in &overrides.0 {
        match value {
            Value::Table(table) if !table.is_empty() => {
                given.add_table(source, &format!("{key}."), table.clone())?;
            }
            value => given.add(source, key.clone(), value.clone())?,
        }
    }
    Ok(given)
}

/// Settings that mean nothing while a switch is off. A file may hold them for when it is on.
const SWITCHED: [(&str, &str); 2] = [
    ("imagination.decay_rate", "imagination.noise_decay"),
    ("imagination.bias_factor", "imagination.optimism"),
];

/// What the user says.
#[derive(Default)]
struct Given {
    /// The values by dotted key, each with its source.
    values: BTreeMap<String, (Source, Value)>,
    /// The method that the file names, whatever an option says.
    method_of_file: Option<Value>,
}

impl Given {
    fn add_table(
        &mut self,
        source: &Source,
        prefix: &str,
        table: Table,
    ) -> Result<(), ConfigError> {
        for (key, value) in table {
            let key = format!("{prefix}{key}");
            match value {
                Value::Table(inner) if !inner.is_empty() => {
                    self.add_table(source, &format!("{key}."), inner)?;
                }
                value => self.add(source, key, value)?,
            }
        }
        Ok(())
    }

    fn add(&mut self, source: &Source, written: String, value: Value) -> Result<(), ConfigError> {
        // `task` is an id, or a table that holds it beside what is done to the task.
        let key = match written.strip_prefix("task.") {
            Some("id") => "task",
            Some(wrapper) if wrapper.split('.').next() == Some("doubled_actions") => wrapper,
            _ => &written,
        };
        let of_file = matches!(source, Source::File(_));
        if of_file && self.values.contains_key(key) {
            return Err(ConfigError::WrongValue {
                origin: source.clone(),
                value: value.to_string(),
                expected: format!("one of `{key}` and `task.{key}`, not both"),
                key: written,
            });
        }
        let key = key.to_owned();
        self.values.insert(key, (source.clone(), value));
        Ok(())
    }

    /// The file's values that an option overrules when it picks another method: those that every run of the file's
    /// own method has, and runs of the other do not. A run's `config.toml` says them all.
    fn overruled_by(&self, picked: Method) -> BTreeMap<String, Value> {
        let named = self.method_of_file.clone();
        let own = named.map_or(Some(Method::Mamf), |value| Method::deserialize(value).ok());
        let Some(own) = own.filter(|own| *own != picked) else {
            return BTreeMap::new();
        };
        let [own, picked] = [own, picked].map(|method| values(&Config::preset(method)));
        let differs = |(key, value): &(String, Value)| picked.get(key) != Some(value);
        own.into_iter().filter(differs).collect()
    }

    fn resolve(self, file: Source) -> Result<Config, ConfigError> {
        let method = match self.values.get("method") {
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

        let by_option = matches!(self.values.get("method"), Some((Source::Option(_), _)));
        let overruled = self.overruled_by(method);
        let mut merged = preset;
        for (key, (origin, value)) in &self.values {
            let Some(default) = defaults.get(key) else {
                if is_section(key, &defaults) && matches!(value, Value::Table(t) if t.is_empty()) {
                    if key == "doubled_actions" {
                        return Err(ConfigError::Missing {
                            origin: origin.clone(),
                            key: "doubled_actions.period".into(),
                            expected: "steps after which the halves change places".into(),
                        });
                    }
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
                // What a file says for its own method may stay there when an option picks another, and the
                // configuration of a run says everything.
                let of_file = matches!(origin, Source::File(_));
                let harmless = of_file && (by_option || value == *default);
                if !harmless {
                    return Err(ConfigError::WrongValue {
                        origin: origin.clone(),
                        key: key.clone(),
                        value: value.to_string(),
                        expected: format!("no such setting: method `{}` {reason}", method.name()),
                    });
                }
                continue;
            }
            if matches!(origin, Source::File(_)) && overruled.get(key) == Some(&value) {
                continue;
            }
            insert(&mut merged, key, value);
        }

        let wrong = |key: &str, expected: String| {
            let (origin, value) = self.values.get(key).cloned().unwrap_or_else(|| {
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
        for (key, switch) in SWITCHED {
            let by_option = matches!(self.values.get(key), Some((Source::Option(_), _)));
            if by_option && flattened(&merged).get(switch) == Some(&Value::Boolean(false)) {
                return Err(wrong(
                    key,
                    format!("no such setting while {switch} is false"),
                ));
            }
        }
        let config: Config =
            serde_path_to_error::deserialize(Value::Table(merged)).map_err(|e| {
                let path = e.path().to_string();
                let key = path.split('[').next().unwrap_or(&path).to_owned();
                wrong(&key, expectation(e.inner()))
            })?;
        if !self.values.contains_key("task") {
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
            &["method=td3", "tau=1"],
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

    /// The configuration of a run of any method is good for another method, whose own settings it then has.
    #[test]
    fn an_option_makes_another_method_of_a_resolved_configuration() {
        for from in Method::ALL {
            let mut config = Config::preset(from);
            config.task = "Hopper-v4".into();
            config.discount = 0.9;
            for to in Method::ALL {
                let mut expected = Config::preset(to);
                expected.task = "Hopper-v4".into();
                expected.discount = 0.9;
                let method = format!("method={}", to.name());
                assert_eq!(load(&config.to_toml(), &[&method]).unwrap(), expected);
            }
        }
        // What is not the method's own stays.
        let text = "task = \"Hopper-v4\"\n[imagination]\ntarget_filter = false\nnoise_bound = 0.3";
        let config = load(text, &["method=ma-td3"]).unwrap();
        assert_eq!(config.imagination.noise_bound, 0.3);
        let config = load(text, &["method=mamf-sac"]).unwrap();
        assert!(!config.imagination.target_filter);
    }

    #[test]
    fn a_table_of_the_task_holds_its_id_and_its_wrappers_alone() {
        let table = "[task]\nid = \"Hopper-v4\"\n";
        let doubled = "doubled_actions = { period = 7 }\n";
        let config = load(&format!("{table}{doubled}"), &[]).unwrap();
        assert_eq!(config.doubled_actions.unwrap().period, 7);
        let m = message(&format!("{table}seed = 2"), &[]);
        assert!(m.contains("`task.seed`") && m.contains("`seed`"), "{m}");
        let m = message(&format!("{doubled}{table}{doubled}"), &[]);
        assert!(
            m.contains("`task.doubled_actions.period`") && m.contains("not both"),
            "{m}"
        );
        for text in [
            format!("{table}doubled_actions = {{}}"),
            format!("doubled_actions = {{}}\n{table}"),
        ] {
            let m = message(&text, &[]);
            assert!(m.contains("missing key `doubled_actions.period`"), "{m}");
        }
        let m = message(table, &["doubled_actions={}"]);
        assert!(
            m.contains("--set doubled_actions={}") && m.contains("`doubled_actions.period`"),
            "{m}"
        );
    }

    #[test]
    fn settings_that_mean_nothing_are_refused_by_name() {
        let task = "task = \"Hopper-v4\"\n";
        for (sets, parts) in [
            (
                &["method=td3", "imagination.target_filter=false"][..],
                ["target_filter", "`td3`"],
            ),
            (
                &["method=td3", "temperature.initial=0.1"],
                ["temperature.initial", "`td3`"],
            ),
            (&["expansion.horizon=3"], ["expansion.horizon", "`mamf`"]),
            (
                &[
                    "imagination.noise_decay=false",
                    "imagination.decay_rate=0.5",
                ],
                ["imagination.decay_rate", "imagination.noise_decay is false"],
            ),
            (
                &["imagination.optimism=false", "imagination.bias_factor=0.5"],
                ["imagination.bias_factor", "imagination.optimism is false"],
            ),
        ] {
            let m = message(task, sets);
            assert!(parts.iter().all(|part| m.contains(part)), "{sets:?}: {m}");
        }
        let file = format!("{task}[imagination]\nbias_factor = 0.5\n");
        assert!(load(&file, &["imagination.optimism=false"]).is_ok());
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
            ("batch_size=1", ["`batch_size`", "1", "at least 2"]),
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

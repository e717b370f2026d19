//! From text to a configuration: the preset of the method, then the file, then options, each on top of the one
//! before.

use super::errors::{ConfigError, Source};
use super::keys::{self, KEYS, Key};
use super::method::TEXT_READINGS;
use super::range::Range;
use super::{Config, Method, validate};
use crate::core::text;
use crate::env;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;
use toml::{Table, Value};

/// Settings on top of a file, in order: later ones win.
#[derive(Debug, Default, Clone)]
pub struct Overrides(Vec<(Source, String, Value)>);

impl Overrides {
    /// Adds `--set KEY=VALUE`; the value is TOML, or else a bare string.
    ///
    /// # Errors
    /// When there is no key or no equals sign.
    pub fn set(&mut self, argument: &str) -> Result<(), ConfigError> {
        self.add(Source::Option(format!("--set {argument}")), argument)
    }

    /// Adds `KEY=VALUE`, which an experiment gives to all its runs. Like what a file says, it may mean nothing to
    /// the method of some of them.
    ///
    /// # Errors
    /// When there is no key or no equals sign.
    pub fn set_for_all(&mut self, setting: &str) -> Result<(), ConfigError> {
        self.add(Source::Experiment(setting.to_owned()), setting)
    }

    /// Adds `KEY=VALUE` of a variant of an experiment.
    ///
    /// # Errors
    /// When there is no key or no equals sign.
    pub fn set_for_variant(&mut self, setting: &str) -> Result<(), ConfigError> {
        self.add(Source::Option(format!("[variants] {setting}")), setting)
    }

    /// Adds the value of an option of its own, such as `--seed`.
    pub fn push(&mut self, option: String, key: &str, value: impl Into<Value>) {
        self.0
            .push((Source::Option(option), key.to_owned(), value.into()));
    }

    fn add(&mut self, source: Source, setting: &str) -> Result<(), ConfigError> {
        let malformed = || ConfigError::MalformedSet(setting.to_owned());
        let (key, text) = setting.split_once('=').ok_or_else(malformed)?;
        let (key, text) = (key.trim(), text.trim());
        if key.is_empty() {
            return Err(malformed());
        }
        let bare = || Value::String(text.to_owned());
        let value = toml::from_str::<Table>(&format!("value = {text}"))
            .ok()
            .filter(|table| table.len() == 1)
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(bare);
        self.0.push((source, key.to_owned(), value));
        Ok(())
    }
}

/// Reads `path`, applies `overrides`, fills in the method's preset and checks everything.
///
/// # Errors
/// When the file is unreadable or not TOML, a key is unknown, a value has a wrong type or lies out
/// of range, or `task` is missing.
pub fn read(path: &Path, overrides: &Overrides) -> Result<Config, ConfigError> {
    parse(&contents(path)?, path, overrides)
}

/// As [`read`], of a `text` that is said to come from `path`.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path, overrides: &Overrides) -> Result<Config, ConfigError> {
    given(text, path, overrides)?.resolve(Source::File(path.to_owned()))
}

/// Reads the configuration of a run, which must hold every key, but for those that are younger than the run: nothing
/// is filled in. What it says of keys that its method has no use for is the preset of the program that made it, and
/// means nothing. Then applies `overrides`.
///
/// # Errors
/// As [`read`], and when a key is missing.
pub fn read_resolved(path: &Path, overrides: &Overrides) -> Result<Config, ConfigError> {
    let text = contents(path)?;
    let there = given(&text, path, &Overrides::default())?.values;
    let mut said = given(&text, path, overrides)?;
    said.forget_unused();
    let config = said.resolve(Source::File(path.to_owned()))?;
    let is_missing = |name: &String| {
        let may_be = keys::find(name).is_some_and(|key| key.is_young);
        !may_be && !there.contains_key(name)
    };
    match values(&config).into_keys().find(is_missing) {
        None => Ok(config),
        Some(key) => Err(ConfigError::Missing {
            origin: Source::File(path.to_owned()),
            key,
            expected: "the configuration of a run holds every key".into(),
        }),
    }
}

fn contents(path: &Path) -> Result<String, ConfigError> {
    text::read(path).map_err(|error| ConfigError::Unreadable {
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
        if is_of_file(source) && self.values.contains_key(key) {
            let expected = format!("one of `{key}` and `task.{key}`, not both");
            return Err(wrong_value(source, &written, &value, expected));
        }
        let key = key.to_owned();
        self.values.insert(key, (source.clone(), value));
        Ok(())
    }

    /// Forgets what a file says of keys that the method it names has no use for.
    fn forget_unused(&mut self) {
        if let Some(method) = self.method_of_file.as_ref().and_then(method_of) {
            self.values.retain(|name, (source, _)| {
                let is_used = |key: &Key| key.refusal(method).is_none();
                !is_of_file(source) || keys::find(name).is_none_or(is_used)
            });
        }
    }

    fn resolve(self, file: Source) -> Result<Config, ConfigError> {
        let method = match self.values.get("method") {
            None => Method::Mamf,
            Some((source, value)) => method_of(value)
                .ok_or_else(|| wrong_value(source, "method", value, Range::Method.to_string()))?,
        };
        let mut merged = preset(method).clone();
        // Defaults that go with another one; what is said of each of them still wins.
        let has_use = |key: &Key| key.refusal(method).is_none();
        let readings = self.values.get("imagination.readings");
        if keys::find("imagination.readings").is_some_and(has_use)
            && readings.is_some_and(|(_, value)| value.as_str() == Some("text"))
        {
            let text = TEXT_READINGS.iter();
            merged.extend(text.map(|(name, value)| ((*name).to_owned(), keys::parsed(value))));
        }
        for (name, (source, value)) in &self.values {
            let Some(key) = keys::find(name) else {
                check_section(source, name, value)?;
                continue;
            };
            let value = admit(source, key, value)?;
            if self.is_taken(key, source, &value, method)? {
                merged.insert(name.clone(), value);
            }
        }
        for (name, (source, value)) in &self.values {
            let key = keys::find(name).filter(|_| matches!(source, Source::Option(_)));
            if let Some((switch, now)) = key.and_then(|key| key.switched_off(&merged)) {
                let expected = format!("no such setting while {switch} is {now}");
                return Err(wrong_value(source, name, value, expected));
            }
        }
        if !self.values.contains_key("task") {
            return Err(ConfigError::Missing {
                origin: file,
                key: "task".into(),
                expected: "the id of a task, for example task = \"HalfCheetah-v4\"".into(),
            });
        }
        let of_preset = |name: &str| (Source::Preset(method), merged[name].clone());
        let source_of = |name: &str| {
            let given = self.values.get(name).cloned();
            given.unwrap_or_else(|| of_preset(name))
        };
        let config = typed(&merged);
        validate::check(&config).map_err(|violation| {
            let (source, value) = source_of(violation.key);
            wrong_value(&source, violation.key, &value, violation.expected)
        })?;
        Ok(config)
    }

    /// Whether `key` gets the `value` that `source` gives it, in a run of `method`: not where the method has no use
    /// for it and the source may say it all the same.
    fn is_taken(
        &self,
        key: &Key,
        source: &Source,
        value: &Value,
        method: Method,
    ) -> Result<bool, ConfigError> {
        let Some(reason) = key.refusal(method) else {
            let gives_way = is_of_file(source) && self.gives_way(key, value, method);
            return Ok(!gives_way);
        };
        let method_is_picked =
            matches!(self.values.get("method"), Some((source, _)) if !is_of_file(source));
        let may_be_said = match source {
            // What a file says for its own method may stay there when an option picks another, and the configuration
            // of a run says everything.
            Source::File(_) => method_is_picked || preset(method).get(key.name) == Some(value),
            Source::Experiment(_) => true,
            Source::Option(_) | Source::Preset(_) => false,
        };
        if may_be_said {
            return Ok(false);
        }
        let expected = format!("no such setting: method `{}` {reason}", method.name());
        Err(wrong_value(source, key.name, value, expected))
    }

    /// Whether the file's `value` of `key` only repeats the preset of the file's own method, where another one is
    /// picked by an option: the configuration of a run says all of its method's preset.
    fn gives_way(&self, key: &Key, value: &Value, picked: Method) -> bool {
        let own = self
            .method_of_file
            .as_ref()
            .map_or(Some(Method::Mamf), method_of);
        own.is_some_and(|own| own != picked && preset(own).get(key.name) == Some(value))
    }
}

fn is_of_file(source: &Source) -> bool {
    matches!(source, Source::File(_))
}

fn method_of(value: &Value) -> Option<Method> {
    Method::named(value.as_str()?)
}

fn wrong_value(source: &Source, key: &str, value: &Value, expected: String) -> ConfigError {
    ConfigError::WrongValue {
        origin: source.clone(),
        key: key.to_owned(),
        value: value.to_string(),
        expected,
    }
}

/// `value` as the type of `key`.
fn admit(source: &Source, key: &Key, value: &Value) -> Result<Value, ConfigError> {
    key.range.admit(value).ok_or_else(|| {
        let nearest = match (key.range, value) {
            (Range::Task, Value::String(id)) => env::info(id).err().and_then(|e| e.nearest),
            _ => None,
        };
        let hint = nearest.map_or(String::new(), |id| format!("; did you mean {id:?}?"));
        let hint = quoting(source, key, value).unwrap_or(hint);
        wrong_value(source, key.name, value, format!("{}{hint}", key.range))
    })
}

/// How to say as text what an option said as a number, a date or a list, where text is wanted. `value` is TOML as it was
/// written, and a shell takes away one pair of quotes.
fn quoting(source: &Source, key: &Key, value: &Value) -> Option<String> {
    let Source::Option(option) = source else {
        return None;
    };
    let (_, written) = option.split_once('=')?;
    let is_text = matches!(key.range, Range::Text | Range::Task);
    (is_text && !value.is_str()).then(|| {
        let (kind, name, written) = (value.type_str(), key.name, written.trim());
        format!(", not a value of type {kind}; as text, in a shell: --set '{name}=\"{written}\"'")
    })
}

/// Nothing but an empty section may have a `name` that is no key's.
fn check_section(source: &Source, name: &str, value: &Value) -> Result<(), ConfigError> {
    if !keys::is_section(name) {
        return Err(ConfigError::UnknownKey {
            origin: source.clone(),
            key: name.to_owned(),
            nearest: keys::nearest(name).map(str::to_owned),
        });
    }
    if !value.is_table() {
        let expected = format!("a section of keys, [{name}]");
        return Err(wrong_value(source, name, value, expected));
    }
    if name == "doubled_actions" {
        return Err(ConfigError::Missing {
            origin: source.clone(),
            key: "doubled_actions.period".into(),
            expected: "steps after which the halves change places".into(),
        });
    }
    Ok(())
}

/// The values that `method` has where nothing else is said, for no task in particular.
pub fn preset(method: Method) -> &'static BTreeMap<String, Value> {
    static PRESETS: LazyLock<Vec<(Method, BTreeMap<String, Value>)>> =
        LazyLock::new(|| Method::ALL.map(|method| (method, assemble(method))).into());
    let found = PRESETS.iter().find(|(of, _)| *of == method);
    found
        .map(|(_, values)| values)
        .expect("every method is there")
}

fn assemble(method: Method) -> BTreeMap<String, Value> {
    let defaults = KEYS
        .iter()
        .filter_map(|key| Some((key.name, key.default()?)));
    let parts = method.definition().preset;
    let own = parts.iter().copied().flatten();
    let own = own.map(|(name, value)| (*name, keys::parsed(value)));
    let named = [
        ("task", Value::String(String::new())),
        ("method", Value::String(method.name().to_owned())),
    ];
    let values = defaults.chain(own).chain(named);
    values
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

/// A configuration of values that are within their ranges.
pub(super) fn typed(values: &BTreeMap<String, Value>) -> Config {
    let mut table = Table::new();
    for (key, value) in values {
        insert(&mut table, key, value.clone());
    }
    table
        .try_into()
        .expect("the fields of Config have the types of the table of keys")
}

/// The values of a configuration by dotted key.
pub(super) fn values(config: &Config) -> BTreeMap<String, Value> {
    let table = Table::try_from(config).expect("a configuration is a TOML table");
    let mut values = BTreeMap::new();
    flatten("", &table, &mut values);
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

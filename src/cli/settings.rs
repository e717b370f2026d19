//! `mamf settings`: the keys of a configuration.

mod markdown;

use crate::config::{self, ConfigError, KEYS, Key, Method, Range, Resume, SECTIONS, Source};
use std::fmt::Write;
use std::process::ExitCode;

/// Arguments of `mamf settings`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Key to say everything about, or section to list, for example imagination
    #[arg(value_name = "KEY")]
    key: Option<String>,
    /// List only the keys that this method has a use for, with its preset
    #[arg(long, value_name = "M", value_parser = method)]
    method: Option<Method>,
    /// Print docs/configuration.md
    #[arg(long, conflicts_with_all = ["key", "method"])]
    markdown: bool,
}

fn method(name: &str) -> Result<Method, String> {
    Method::named(name).ok_or_else(|| format!("expected {}", Range::Method))
}

/// Prints all keys, those of a section, or one in detail.
///
/// # Errors
/// If there is no such key.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut out = String::new();
    match &args.key {
        _ if args.markdown => write!(out, "{}", markdown::page())?,
        None => list(&mut out, |_| true, args.method)?,
        Some(name) if config::is_section(name) => {
            list(&mut out, |key| key.section() == name, args.method)?;
        }
        Some(name) => {
            let key = config::find(name).ok_or_else(|| ConfigError::UnknownKey {
                origin: Source::Option(format!("mamf settings {name}")),
                key: name.clone(),
                nearest: config::nearest(name).map(str::to_owned),
            })?;
            describe(&mut out, key, args.method)?;
        }
    }
    super::print(&out)?;
    Ok(ExitCode::SUCCESS)
}

/// Two lines a key: name, value and range, then what it means.
fn list(
    out: &mut String,
    asked: impl Fn(&Key) -> bool,
    method: Option<Method>,
) -> std::fmt::Result {
    let concerned = |key: &Key| method.is_none_or(|method| key.concern.includes(method));
    let shown: Vec<&Key> = KEYS.iter().filter(|k| asked(k) && concerned(k)).collect();
    let width = shown.iter().map(|key| key.name.len()).max().unwrap_or(0);
    match method {
        None => writeln!(out, "{:width$}  {:<15}  range", "key", "default")?,
        Some(method) => writeln!(out, "{:width$}  {:<15}  range", "key", method.name())?,
    }
    for (section, about) in SECTIONS {
        let mut keys = shown
            .iter()
            .filter(|key| key.section() == *section)
            .peekable();
        if keys.peek().is_none() {
            continue;
        }
        match *section {
            "" => writeln!(out, "\n{about}")?,
            section => writeln!(out, "\n[{section}] {about}")?,
        }
        for key in keys {
            let value = value(key, method);
            writeln!(out, "{:width$}  {value:<15}  {}", key.name, key.range)?;
            writeln!(out, "    {}", key.doc())?;
        }
    }
    Ok(())
}

fn describe(out: &mut String, key: &Key, method: Option<Method>) -> std::fmt::Result {
    writeln!(out, "{}\n    {}\n", key.name, key.doc())?;
    writeln!(out, "range    {}", key.range)?;
    writeln!(out, "default  {}", value(key, None))?;
    for of in Method::ALL
        .into_iter()
        .filter(|of| method.is_none_or(|m| m == *of))
    {
        let value = value(key, Some(of));
        if key.concern.includes(of) && (method.is_some() || value != self::value(key, None)) {
            writeln!(out, "preset   {value} for {}", of.name())?;
        }
    }
    if let Some(reason) = key.concern.otherwise() {
        let others = if key.tolerated {
            "takes it all the same"
        } else {
            "refuses it"
        };
        writeln!(
            out,
            "methods  {}; any other {reason} and {others}",
            concerned(key)
        )?;
    }
    if let Some((switch, value)) = key.only_while {
        writeln!(out, "only     while {switch} = {value}")?;
    }
    writeln!(out, "resume   {}", on_resume(key))
}

/// Default of a key, or its value in the preset of `method`.
fn value(key: &Key, method: Option<Method>) -> String {
    let value = match method {
        _ if key.range == Range::Task => None,
        Some(method) => config::preset(method).get(key.name).cloned(),
        None => key.default(),
    };
    match value {
        Some(value) => value.to_string(),
        None if key.range == Range::Task => "(required)".into(),
        None => "(not set)".into(),
    }
}

/// The methods that have a use for a key.
fn concerned(key: &Key) -> String {
    let concerned = Method::ALL.into_iter().filter(|m| key.concern.includes(*m));
    concerned.map(Method::name).collect::<Vec<_>>().join(", ")
}

fn on_resume(key: &Key) -> &'static str {
    match key.resume {
        Resume::Fixed => "a run goes on with the value it has",
        Resume::Forced => "a run may go on with another value, with --force",
        Resume::Free => "a run may go on with another value",
    }
}

//! Where a run's figures come from: `run.json`.

use serde::Serialize;
use serde_json::{Map, Value};
use std::path::Path;
use std::time::SystemTime;

/// Versions, commit, host and command of a run.
#[derive(Debug, Serialize)]
pub(crate) struct Provenance {
    mamf: &'static str,
    commit: Option<&'static str>,
    mujoco: String,
    rustc: &'static str,
    command: Vec<String>,
    started: String,
    host: Option<String>,
    cpu: Option<String>,
    cpus: Option<usize>,
}

/// A continuation of a run: from which step, and by which process.
#[derive(Debug, Serialize)]
struct Resumed {
    step: u64,
    #[serde(flatten)]
    by: Provenance,
}

/// Version of the program that began the run whose provenance is the file at `path`.
pub(crate) fn version(path: &Path) -> Option<String> {
    let json = std::fs::read_to_string(path).ok()?;
    let run: Value = serde_json::from_str(&json).ok()?;
    Some(run.get("mamf")?.as_str()?.to_owned())
}

impl Provenance {
    /// As the contents of the file.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("plain data is JSON")
    }

    /// The contents of a file that held `json`, with this process as one that goes on from `step`. A file
    /// that can't be read is begun anew.
    pub(crate) fn after(self, json: &str, step: u64) -> String {
        let mut run: Map<String, Value> = serde_json::from_str(json).unwrap_or_default();
        let resumed = Resumed { step, by: self };
        let resumed = serde_json::to_value(resumed).expect("plain data is JSON");
        match run
            .entry("resumed")
            .or_insert_with(|| Value::Array(Vec::new()))
        {
            Value::Array(list) => list.push(resumed),
            other => *other = Value::Array(vec![resumed]),
        }
        serde_json::to_string_pretty(&run).expect("plain data is JSON")
    }

    /// Of this process.
    pub(crate) fn here() -> Provenance {
        Provenance {
            mamf: env!("CARGO_PKG_VERSION"),
            commit: option_env!("MAMF_COMMIT"),
            mujoco: mujoco_rs::version_string(),
            rustc: env!("MAMF_RUSTC"),
            command: std::env::args_os()
                .map(|word| word.to_string_lossy().into_owned())
                .collect(),
            started: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            host: host(),
            cpu: processor(),
            cpus: std::thread::available_parallelism().ok().map(usize::from),
        }
    }
}

/// Name of this machine.
pub(crate) fn host() -> Option<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok()?;
    Some(name.trim().to_owned())
}

/// Model of the processor.
pub(crate) fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

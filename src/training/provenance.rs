//! Where a run's figures come from: `run.json`.

use serde::Serialize;
use std::time::SystemTime;

/// Versions, commit, host and command of a run.
#[derive(Debug, Serialize)]
pub(super) struct Provenance {
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

impl Provenance {
    /// Of this process.
    pub(super) fn here() -> Provenance {
        Provenance {
            mamf: env!("CARGO_PKG_VERSION"),
            commit: option_env!("MAMF_COMMIT"),
            mujoco: mujoco_rs::version_string(),
            rustc: env!("MAMF_RUSTC"),
            command: std::env::args().collect(),
            started: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            host: read_line("/proc/sys/kernel/hostname"),
            cpu: cpu_model(),
            cpus: std::thread::available_parallelism().ok().map(usize::from),
        }
    }
}

fn read_line(path: &str) -> Option<String> {
    Some(std::fs::read_to_string(path).ok()?.trim().to_owned())
}

fn cpu_model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
